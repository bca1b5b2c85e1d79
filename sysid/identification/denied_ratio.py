"""Whether tests deny ISO 6358 in a direction: no critical ratio makes its curve theirs.

Then the fit ends at the largest ratio that is tried, which is no valve's, and the law misses the
direction all the same: it only bends towards the curve of another law.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

from sysid.estimation.nonlinear import LeastSquaresFit
from sysid.plant.iso6358 import HIGHEST_RATIO

_DIRECTION = {"fill": "filling", "dis": "exhaust"}


def denied_ways(
    fit: LeastSquaresFit,
    ratios: dict[str, str],
    misses_more_than_noise: Callable[[str], bool],
) -> tuple[str, ...]:
    """The directions, "fill" and "dis", that no critical ratio follows.

    `fit` by ISO 6358; `ratios`: the name of each direction's critical ratio in it;
    `misses_more_than_noise`: whether the law misses a direction by more.
    """
    at_bound = fit.diagnosis.at_bound
    return tuple(
        way
        for way, name in ratios.items()
        if name in at_bound and fit[name] >= 0.5 * HIGHEST_RATIO and misses_more_than_noise(way)
    )


def denied_sentence(ways: Iterable[str]) -> str:
    """What the tests deny, and which law is kept for it."""
    what = " and ".join(_DIRECTION[way] for way in ways)
    return f"no critical ratio of ISO 6358 follows the {what}, so the thesis' law is kept"


__all__ = ["denied_sentence", "denied_ways"]
