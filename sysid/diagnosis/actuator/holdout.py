"""Before and after: open-loop simulation of the held-out motion logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import PurePath
from typing import Any

import numpy as np

from sysid.diagnosis.actuator.twins import Scatter, SensorNoise, scattered
from sysid.errors import Failure, SimulationError, on_its_own
from sysid.io.campaign import MOTION_KINDS
from sysid.io.channels import COMPARED
from sysid.io.logs import Log
from sysid.io.rig import Rig
from sysid.plant.ports import Model
from sysid.recording.motion_tests import MotionTest, prepare_all
from sysid.recording.simulation import NOT_FINITE, simulate_segments
from sysid.types import FloatArray

_HORIZON_S = 1.0
# Draws of the tests' friction for the noise floor; the squares of these many are averaged.
_DRAWS = 8
# Points of a curve that is drawn.
_DRAWN = 600


@dataclass(frozen=True)
class HeldOut:
    """Motion tests of a campaign, held out or not, ready for the simulator.

    `notices`: which tests were left out, and why.
    """

    rig: Rig
    tests: tuple[MotionTest, ...]
    notices: tuple[str, ...] = ()

    def simulated(
        self, model: Model | Sequence[Model], times: int = 1, *, nan_if_endless: bool = False
    ) -> list[FloatArray]:
        """(3, n) position and pressures of every test, `times` over (models in that order)."""
        runs = [(test, test.whole) for _ in range(times) for test in self.tests]
        position = self.rig.position_channel
        return simulate_segments(runs, model, (), position, nan_if_endless=nan_if_endless)

    def simulable(self, models: Sequence[Model]) -> HeldOut:
        """The tests that each of the models simulates to their ends, with notices of the others;
        a model that simulates none counts for nothing."""
        found = []
        for model in models:
            own = self.simulated(model, nan_if_endless=True)
            ended = np.array([bool(np.isfinite(run).all()) for run in own])
            if ended.any():
                found.append(ended)
        kept = np.all(found, axis=0) if found else np.ones(len(self.tests), dtype=bool)
        lost = [
            f"{test.source}: is not simulated, and left out of the errors: {NOT_FINITE}"
            for test, own in zip(self.tests, kept, strict=True)
            if not own
        ]
        tests = tuple(test for test, own in zip(self.tests, kept, strict=True) if own)
        return replace(self, tests=tests, notices=(*self.notices, *lost))

    def rmse(self, model: Model) -> FloatArray:
        """Open-loop RMSE of each channel, (3,), pooled over the tests; NaN where not logged.

        A test counts up to where it comes to an end stop (the model has none). Raises
        SimulationError where one is not simulated to its end.
        """
        squares, count = np.zeros((2, 1 + len(COMPARED)))
        for test, run in zip(self.tests, self.simulated(model), strict=True):
            gap = test.residual_of(test.whole, run)
            logged = np.isfinite(test.measured_in(test.whole)).all(axis=1)
            squares[logged] += np.sum(gap[logged] ** 2, axis=1)
            count[logged] += gap.shape[1]
        with np.errstate(invalid="ignore"):
            return np.asarray(np.sqrt(squares / count))

    def noise_floor(
        self, model: Model, noise: SensorNoise, scatter: Scatter, seed: int
    ) -> FloatArray:
        """RMSE of each channel, (3,), that a correct model would show.

        Sensor noise and quantisation, and the open-loop error due to friction's scatter from
        test to test.
        """
        if scatter.static == scatter.sliding == 0.0:
            return noise.total
        return self.fitted_floor([model] * _DRAWS, model, noise, scatter, seed)

    def fitted_floor(
        self,
        drawn: Sequence[Model],
        model: Model,
        noise: SensorNoise,
        scatter: Scatter,
        seed: int,
    ) -> FloatArray:
        """The same, (3,), where the model's numbers are fitted: `drawn` are off by their errors."""
        draws = self.draws(drawn, model, noise, scatter, seed)
        return np.asarray(np.sqrt(np.mean(draws**2, axis=0)))

    def draws(
        self,
        drawn: Sequence[Model],
        model: Model,
        noise: SensorNoise,
        scatter: Scatter,
        seed: int,
    ) -> FloatArray:
        """RMSE, (draws, 3), of each of the `drawn` models with friction of each test's own.

        A test that a drawn model does not simulate to its end does not count in that draw. Raises
        SimulationError where `model` does not, or where no draw is left.
        """
        rng = np.random.default_rng(seed)
        count = len(self.tests)
        models = [scattered(one, scatter, rng) for one in drawn for _ in range(count)]
        nominal = self.simulated(model)
        runs = self.simulated(models, len(drawn), nan_if_endless=True)
        counted = [test.counted(test.whole) for test in self.tests]
        squares, rows = np.zeros((len(drawn), 1 + len(COMPARED))), np.zeros((len(drawn), 1))
        for i, run in enumerate(runs):
            n = counted[i % count]
            gap = (run - nominal[i % count])[:, :n]
            if np.isfinite(gap).all():
                squares[i // count] += np.sum(gap**2, axis=1)
                rows[i // count] += n
        some = rows[:, 0] > 0.0
        if not some.any():
            raise SimulationError(NOT_FINITE)
        return np.asarray(np.sqrt(squares[some] / rows[some] + noise.total**2))


def trace(
    tests: HeldOut, before: Model, after: Model, scatter: float = 0.0
) -> dict[str, Any] | None:
    """The position in one test: measured, and as two models simulate it open loop.

    Of the tests the one whose position the first model follows worst, by RMSE over the spread.
    `source` names it; `channel` of `time`, `measured`, `before` and `after`, (n,) each and thinned,
    in SI units; `fit` percentages by the same names, over the rows that count; `tests`: of how
    many. `friction`, where the tests' friction scatters by a share `scatter`: of each test
    (`source`) the share by which its own is off (`own`), and the RMSE with it (`rmse`), next to
    that without (`of`). None without a test whose position varies.
    """
    measured = [test.measured_in(test.whole)[0] for test in tests.tests]
    runs = [
        [run[0, : len(m)] for run, m in zip(tests.simulated(model), measured, strict=True)]
        for model in (before, after)
    ]
    spreads = [float(np.linalg.norm(m - m.mean())) for m in measured]
    off = [
        [float(np.linalg.norm(m - run)) / spread if spread > 0.0 else np.nan for run in pair]
        for m, spread, *pair in zip(measured, spreads, *runs, strict=True)
    ]
    known = [i for i, pair in enumerate(off) if np.isfinite(pair).all()]
    if not known:
        return None
    at = max(known, key=lambda i: off[i][0])
    kept = np.unique(np.linspace(0, len(measured[at]) - 1, _DRAWN).astype(int))
    named = {"measured": measured[at], "before": runs[0][at], "after": runs[1][at]}
    fits = [100.0 * (1.0 - share) for share in off[at]]
    return {
        "source": _named(tests.tests[at]),
        "channel": tests.rig.position_channel,
        "tests": len(tests.tests),
        "time": (tests.tests[at].period * kept).tolist(),
        **{name: curve[kept].tolist() for name, curve in named.items()},
        "fit": dict(zip(("before", "after"), fits, strict=True)),
        "friction": _own_friction(tests, after, measured, runs[1], scatter),
    }


def _named(test: MotionTest) -> str:
    """A test by its file, without the folder, and its label."""
    return PurePath(test.source).name


def _own_friction(
    tests: HeldOut,
    model: Model,
    measured: Sequence[FloatArray],
    simulated: Sequence[FloatArray],
    scatter: float,
) -> list[dict[str, Any]]:
    """The friction of each test with which a model follows its position best.

    By two steps of Gauss and Newton, within three times the `scatter`; none without scatter, and
    none of a test that is followed no better with its own.
    """
    if not scatter > 0.0:
        return []

    def run(shares: FloatArray) -> list[FloatArray]:
        models = [_with_friction(model, float(share)) for share in shares]
        found = tests.simulated(models, nan_if_endless=True)
        return [own[0, : len(m)] for own, m in zip(found, measured, strict=True)]

    def errors(curves: Sequence[FloatArray]) -> FloatArray:
        pairs = zip(measured, curves, strict=True)
        return np.array([float(np.sqrt(np.mean((m - c) ** 2))) for m, c in pairs])

    shares, curves = np.zeros(len(measured)), list(simulated)
    first = errors(curves)
    best, own = first.copy(), shares.copy()
    for _ in range(2):
        moved = run(shares + 0.1 * scatter)
        for i, (m, curve, other) in enumerate(zip(measured, curves, moved, strict=True)):
            slope = (other - curve) / (0.1 * scatter)
            size = float(slope @ slope)
            if np.isfinite(size) and size > 0.0:
                shares[i] += float(slope @ (m - curve)) / size
        shares = np.clip(shares, -3.0 * scatter, 3.0 * scatter)
        curves = run(shares)
        now = errors(curves)
        better = now < best
        best, own = np.where(better, now, best), np.where(better, shares, own)
    return [
        {"source": _named(test), "own": o, "scatter": scatter, "rmse": after, "of": was}
        for test, o, after, was in zip(
            tests.tests, own.tolist(), best.tolist(), first.tolist(), strict=True
        )
        if after < was
    ]


def _with_friction(model: Model, share: float) -> Model:
    """A model whose friction is larger by a share, at rest and sliding."""
    factor = 1.0 + share
    return Model(model.parameters.with_friction(factor, factor), model.effects)


def motion_tests(rig: Rig, logs: Sequence[tuple[str, Log]]) -> HeldOut:
    """The motion tests of logs, given as (kind, log); notices of those left out."""
    tests: list[MotionTest] = []
    notices: list[str] = []
    for kind, log in logs:
        if kind not in MOTION_KINDS:
            continue
        own = on_its_own(partial(prepare_all, log.trials, kind, rig, _HORIZON_S))
        if isinstance(own, Failure):
            notices.append(f"excluded: {own.reason}")
            continue
        tests += own[0]
        notices += own[1]
    return HeldOut(rig, tuple(t for t in tests if t.counted(t.whole) >= 2), tuple(notices))
