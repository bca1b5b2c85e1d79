"""Evidence for one law over another of as many numbers, from what each leaves of the same tests.

The difference of the log likelihoods, each test with a variance of its own. What a law misses is
autocorrelated, and may repeat in every test: samples and tests count for as many as are
independent.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sysid.estimation.autoregression import autoregression
from sysid.estimation.quality import root_mean_square
from sysid.types import FloatArray

ODDS = 2.0 * math.log(20.0)
"""Twice the log odds at which one of several is preferred: 20 to 1, as a level of 95 % has it."""
DECISIVE = 10.0
"""Twice the log evidence that decides: "very strong" (Kass, Raftery 1995, Bayes factors)."""
_FEWEST_SAMPLES = 10


def twice_log_evidence(
    old: Sequence[FloatArray], new: Sequence[FloatArray], least: Sequence[float]
) -> float | None:
    """Twice the log evidence for the second law over the first; None where nothing shows it.

    `old` and `new`: residuals (n,) of each test by each law, in the order of time; `least`: of each
    test, the rms below which a residual shows no more. Tests of fewer than 10 samples do not count.
    """
    found, left = [], []
    for first, second, floor in zip(old, new, least, strict=True):
        if len(first) < _FEWEST_SAMPLES:
            continue
        better = min(first, second, key=root_mean_square)
        sizes = [max(root_mean_square(r), floor) for r in (first, second)]
        if min(sizes) > 0.0:
            found.append(2.0 * _independent(better) * math.log(sizes[0] / sizes[1]))
            left.append(better)
    return sum(found) / _repeats(left) if found else None


def _independent(residuals: FloatArray) -> float:
    """How many independent samples residuals (n,) are worth."""
    most = max(1, min(int(10.0 * math.log10(len(residuals))), len(residuals) // 4))
    return autoregression([residuals], most).independent_samples([len(residuals)])


def _repeats(residuals: Sequence[FloatArray]) -> float:
    """For how many tests one counts: as what is left repeats from test to test, 1 if not at all."""
    size, count = min(map(len, residuals)), len(residuals)
    unit = [r[:size] / max(float(np.linalg.norm(r[:size])), 1e-300) for r in residuals]
    total = float(np.sum(np.sum(unit, axis=0) ** 2))
    return max(total / count, 1.0)


__all__ = ["DECISIVE", "ODDS", "twice_log_evidence"]
