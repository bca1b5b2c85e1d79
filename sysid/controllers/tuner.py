"""Gains found by search: closed loops of many candidates at once, by differential evolution.

What is minimised is the mean over the loops of the logarithm of RMSE over that of the gains to
start from, with a rise counted three times: what helps one motion and harms another is no
improvement. A loop that is lost counts as a thousand times worse. With several plants a motion's
RMSE is the largest over them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.controllers.cases import Case, ClosedLoopRun
from sysid.controllers.gains import TunableGain, values_of, with_gains
from sysid.controllers.metrics import LOST_RAD, is_lost
from sysid.types import FloatArray, Progress, no_progress

# Each gain is searched within this factor of where it starts, up and down.
_FACTOR = 8.0
# Spread of the first candidates, in logarithms.
_SPREAD = 0.5
_CANDIDATES_A_GAIN, _FEWEST = 5, 12
_LOST = 1e3
# Counts of ticks, over the one to start from.
_SHARES = (0.625, 0.75, 0.875, 1.0, 1.25, 1.5)


@dataclass(frozen=True)
class Bench:
    """The loops that judge gains: `motions` of each (a trajectory on one or more plants).

    `gains` that are searched; a case's controller holds those to start from. `duration` s of each
    loop; `reach` rad beyond which a loop is lost.
    """

    motions: tuple[tuple[Case, ...], ...]
    gains: tuple[TunableGain, ...]
    duration: float
    reach: float

    @property
    def start(self) -> dict[str, float]:
        """The gains to start from."""
        return values_of(self.motions[0][0].controller, self.gains)

    def rmse(self, candidates: Sequence[Mapping[str, float]]) -> FloatArray:
        """RMSE, rad, (candidates, motions): the largest over a motion's plants; lost: infinite."""
        from sysid.controllers.loop import closed_loop

        cases = [
            replace(case, controller=with_gains(case.controller, self.gains, values))
            for values in candidates
            for motion in self.motions
            for case in motion
        ]
        found = [_rmse(run, self.reach) for run in closed_loop(cases, self.duration)]
        sizes = np.cumsum([0, *(len(motion) for motion in self.motions)])
        rows = np.array(found).reshape(len(candidates), -1)
        return np.maximum.reduceat(rows, sizes[:-1], axis=1)


def _rmse(run: ClosedLoopRun, reach: float) -> float:
    return np.inf if is_lost(run.position, run.reference[:, 0], reach) else run.metrics.rmse


def score(rmse: FloatArray, start: FloatArray) -> FloatArray:
    """What is minimised, (candidates,), of RMSE (candidates, motions) over the start's (motions,).

    A motion that the start loses is judged against the error from which on it is lost.
    """
    known = np.where(np.isfinite(start), start, LOST_RAD)
    ratio = np.where(np.isfinite(rmse), rmse / known, _LOST)
    log = np.log(ratio)
    return np.asarray(np.mean(log + 2.0 * np.maximum(log, 0.0), axis=1))


def search(
    bench: Bench, generations: int, seed: int, progress: Progress = no_progress
) -> dict[str, float]:
    """The best gains of a search; those to start from if none is better. Deterministic by seed."""
    best = dict(bench.start)
    for gain in bench.gains:
        if gain.choices:
            best = _best_count(bench, gain, best, progress)
    smooth = tuple(gain for gain in bench.gains if not gain.choices)
    if not smooth:
        return best
    chosen = replace(
        bench,
        gains=smooth,
        motions=tuple(
            tuple(
                replace(c, controller=with_gains(c.controller, bench.gains, best)) for c in motion
            )
            for motion in bench.motions
        ),
    )
    return best | _evolved(chosen, generations, seed, progress)


def _best_count(
    bench: Bench, gain: TunableGain, best: dict[str, float], progress: Progress
) -> dict[str, float]:
    """The best of several counts of ticks, the other gains as they are."""
    counts = sorted({max(1, round(share * best[gain.name])) for share in _SHARES})
    progress(f"trying {gain.name} of {', '.join(map(str, counts))} ticks")
    rows = bench.rmse([best | {gain.name: float(count)} for count in counts])
    own = rows[counts.index(round(best[gain.name]))]
    return best | {gain.name: float(counts[int(np.argmin(score(rows, own)))])}


def _evolved(bench: Bench, generations: int, seed: int, progress: Progress) -> dict[str, float]:
    from scipy.optimize import differential_evolution

    names = [gain.name for gain in bench.gains]
    # A gain of 0 has no logarithm: it stays.
    names = [name for name in names if bench.start[name] > 0.0]
    middle = np.log([bench.start[name] for name in names])
    count = max(_FEWEST, _CANDIDATES_A_GAIN * len(names))
    first = middle + _SPREAD * np.random.default_rng(seed).standard_normal((count, len(names)))
    first[0] = middle
    own = bench.rmse([bench.start] * count)[0]
    done = 0

    def misfit(logs: FloatArray) -> FloatArray:
        nonlocal done
        rows = np.atleast_2d(logs.T)
        found = bench.rmse([dict(zip(names, np.exp(row), strict=True)) for row in rows])
        done += 1
        scores = score(found, own)
        progress(f"generation {done} of {generations + 1}: best {np.exp(scores.min()):.3g}")
        return scores

    reach = np.log(_FACTOR)
    result = differential_evolution(
        misfit,
        list(zip(middle - reach, middle + reach, strict=True)),
        init=np.clip(first, middle - reach, middle + reach),
        maxiter=generations,
        vectorized=True,
        updating="deferred",
        polish=False,
        tol=0.0,
        mutation=(0.4, 0.9),
        recombination=0.8,
        seed=np.random.default_rng(seed),
    )
    if not result.fun < 0.0:
        return {}
    return dict(zip(names, map(float, np.exp(result.x)), strict=True))


__all__ = ["Bench", "score", "search"]
