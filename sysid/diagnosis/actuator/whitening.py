"""Residual vectors in which noise is white and of unit variance.

The windows' equation errors are correlated (a derivative of white noise is blue) and of
unlike units. A frame turns them into one vector by the exact innovations of an
autoregressive model of the noise, channel by channel, and takes the scatter of friction
from test to test into the covariance, so that sums of squares can be compared.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.diagnosis.actuator.breakaways import breakaways
from sysid.diagnosis.actuator.choked_boundaries import near_boundaries
from sysid.diagnosis.actuator.equation_error import (
    BALANCES,
    BREAKAWAY,
    CHANNELS,
    EFFORT,
    EquationError,
    equation_error,
)
from sysid.diagnosis.actuator.samples import Rows, Traces, Windows, windows
from sysid.diagnosis.actuator.states import point_of
from sysid.diagnosis.actuator.twins import SensorNoise, retraced
from sysid.estimation.autoregression import (
    Autoregression,
    damped,
    largest_reflection,
    runs_of,
    whitening_matrix,
)
from sysid.io.channels import SIDES
from sysid.io.rig import END_MARGIN
from sysid.parallel import spend
from sysid.plant.base import sliding_friction
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model
from sysid.signals import MEDIAN_OF_SQUARES
from sysid.types import BoolArray, FloatArray, IntArray

ORDER = 6
# Share of white noise added to the autocovariance: what the noise model does not describe.
_RIDGE = 0.02
# Share of the supply, or of the atmosphere: a pressure as near to it is at it but for noise.
_NEAR_SOURCE = 0.01
_RUNAWAY = 1e4
# Tests that determine their own friction to 3 %, and how many of them a spread needs.
_LEAST_POWER = 1e3
_LEAST_TESTS = 4
# Relative: no better are the bench's static friction, and a breakaway's reading.
_STATIC_KNOWN = 0.02


@dataclass(frozen=True)
class ResidualNoise:
    """Autocovariance of each channel's windows over lags 0 to ORDER.

    `late`: by test, how much more effort a reading of a breakaway shows than it took, Nm or N.
    `sensors`: what the channels' samples err by, drawn from `seed`; where it is not known, the
    noise of all stretches is taken to be alike.
    """

    covariance: dict[str, FloatArray]
    late: dict[int, float]
    sensors: SensorNoise | None = None
    seed: int = 0

    def of_sensors(
        self, traces: Traces, model: Model, views: dict[str, Windows]
    ) -> dict[str, FloatArray]:
        """What the sensors' noise, along the traces' own motion, does to each balance's windows."""
        if self.sensors is None:
            return {}
        path, shown = retraced(traces, self.sensors, self.seed)
        noisy, true = equation_error(shown, model), equation_error(path, model)
        return {name: views[name].average(noisy[name] - true[name]) for name in BALANCES}


@dataclass(frozen=True)
class Frame:
    """Traces with their windows, and the whitening of each channel's residuals.

    `friction`, by channel (its rows,): each test's friction as the fitted model has it, sliding or
    static, whitened; `scatter` its relative spread from test to test. `late` (breakaways,): what
    their readings show too much, Nm or N. `sensors`, by balance: what their noise does to each
    window, where it is known.
    """

    traces: Traces
    windows: dict[str, Windows]
    whitening: dict[str, Any]
    friction: dict[str, FloatArray]
    scatter: float
    late: FloatArray
    sensors: dict[str, FloatArray]

    @property
    def rows_used(self) -> dict[str, Rows]:
        """The samples that each channel's windows hold."""
        return {name: view.used for name, view in self.windows.items()}

    def vector(self, error: EquationError, channels: tuple[str, ...] = CHANNELS) -> FloatArray:
        """The whitened residual, (rows,), of errors at the rows used; 0 for channels not named."""
        return np.concatenate(
            [
                self.channel(name, error) if name in channels else np.zeros(len(self.windows[name]))
                for name in CHANNELS
            ]
        )

    def residual(self, model: Model, channels: tuple[str, ...] = CHANNELS) -> FloatArray:
        """The whitened equation error of a model, (rows,).

        A trial model whose states diverge has a large one, not an undefined one. Raises
        OutOfBudgetError.
        """
        spend()
        with np.errstate(over="ignore", invalid="ignore"):
            error = equation_error(self.traces, model, channels, self.rows_used)
            found = self.vector(error, channels)
        return np.asarray(np.nan_to_num(found, nan=_RUNAWAY, posinf=_RUNAWAY, neginf=-_RUNAWAY))

    def channel(self, name: str, error: EquationError) -> FloatArray:
        """The whitened residual of one channel."""
        values = self.windows[name].matrix @ error[name]
        return self.whitened(name, values - self.late if name == BREAKAWAY else values)

    def whitened(self, name: str, values: FloatArray) -> FloatArray:
        """Windows' means (n,) of one channel, whitened."""
        white = np.asarray(self.whitening[name] @ values)
        return self._without_scatter(name, white) if name in self.friction else white

    @property
    def bare(self) -> Frame:
        """The same without friction's scatter, which `scattered` then takes into account."""
        return replace(self, friction={})

    def scattered(self, values: FloatArray) -> FloatArray:
        """Vectors (rows, k) of the `bare` frame as they are in this one."""
        parts = (self._without_scatter(name, values[self.rows(name)]) for name in self.friction)
        found = values.copy()
        for name, part in zip(self.friction, parts, strict=True):
            found[self.rows(name)] = part
        return found

    def _without_scatter(self, name: str, values: FloatArray) -> FloatArray:
        """(I + s2 f f')^-1/2 of every test, (n,) or (n, k): its friction's scatter counts as noise.

        So does, of all breakaways, what is not known of the bench's static friction.
        """
        friction, run = self.friction[name], self.windows[name].run
        if len(run) == 0:
            return values
        firsts = np.concatenate(([0], np.flatnonzero(np.diff(run)) + 1, [len(run)]))
        own = [slice(*pair) for pair in itertools.pairwise(firsts)]
        found = np.concatenate([_less(self.scatter, friction[o], values[o]) for o in own])
        if name != BREAKAWAY:
            return found
        common = np.concatenate([_less(self.scatter, friction[o], friction[o]) for o in own])
        return _less(_STATIC_KNOWN, common, found)

    @property
    def tests(self) -> IntArray:
        """The test that each row of the vector belongs to, (rows,)."""
        return np.concatenate([self.windows[name].run for name in CHANNELS])

    def belongs(self, channels: tuple[str, ...]) -> BoolArray:
        """Which rows of the vector are of these channels, (rows,)."""
        return np.concatenate([np.full(len(self.windows[c]), c in channels) for c in CHANNELS])

    def rows(self, name: str) -> slice:
        """Where a channel lies in the vector."""
        counts = [len(self.windows[c]) for c in CHANNELS]
        ends = np.cumsum([0, *counts])
        i = CHANNELS.index(name)
        return slice(int(ends[i]), int(ends[i + 1]))


def _less(spread: float, direction: FloatArray, values: FloatArray) -> FloatArray:
    """(I + s2 f f')^-1/2 of values (n,) or (n, k), for a spread s along a direction f (n,)."""
    power = float(direction @ direction)
    if power == 0.0 or spread == 0.0:
        return values
    share = 1.0 - 1.0 / np.sqrt(1.0 + spread**2 * power)
    return np.asarray(values - np.multiply.outer(direction, share / power * (direction @ values)))


def build_windows(
    traces: Traces, model: Model, moving: Sequence[CatalogueEffect] = ()
) -> dict[str, Windows]:
    """Windows of every channel.

    Effort: where the shaft moves, away from its end stops. Rates: away from the stops, and
    where the flow law is not uncertain: nor where effects that are `moving` its boundaries may
    make it so. Breakaways: one row each.
    """
    period, free = float(model.parameters.pwm_period), _off_the_stops(traces, model)
    found = {EFFORT: sliding_windows(traces, model), BREAKAWAY: breakaways(traces, model, free)}
    for run in traces.runs:
        free[run.rows] |= not run.moves
    for side in SIDES:
        doubt = _in_doubt(traces, model, side) | near_boundaries(traces, model, side, moving)
        found[f"rate_{side}"] = windows(traces, free & ~doubt, period)
    return found


def sliding_windows(traces: Traces, model: Model) -> Windows:
    """Windows of the torque balance: where the shaft moves, away from its end stops."""
    return windows(traces, _off_the_stops(traces, model) & (traces.direction != 0))


def _off_the_stops(traces: Traces, model: Model) -> BoolArray:
    p = model.parameters
    stop = 0.5 * float(p.stroke) / float(p.pitch_radius)
    return np.asarray(np.abs(traces.position) < stop * (1.0 - 2.0 * END_MARGIN))


def _in_doubt(traces: Traces, model: Model, side: str) -> BoolArray:
    """Samples at which noise determines the result of the valve's law, (n,).

    Flow near the supply pressure or the atmosphere may go with the root of a difference that
    is mostly noise.
    """
    pressure, share = traces.pressure(side), traces.is_open(side)
    if model.parameters.bleeds and side != "a":  # there is no other chamber
        return np.ones(len(traces), dtype=bool)
    vents = point_of(traces, model).vents(side)
    to_supply = np.abs(traces.supply - pressure) < _NEAR_SOURCE * traces.supply
    atmosphere = float(model.parameters.atmosphere)
    to_atmosphere = np.abs(pressure - atmosphere) < _NEAR_SOURCE * atmosphere
    return np.asarray(((share > 0.0) & to_supply) | ((vents > 0.0) & to_atmosphere))


def noise_of(
    traces: Traces, model: Model, sensors: SensorNoise | None = None, seed: int = 0
) -> ResidualNoise:
    """The noise's autocovariance in each channel, from a twin's traces.

    The median over the tests: edges and breakaways, which bias a few windows, do not count.
    """
    error, views = equation_error(traces, model), build_windows(traces, model)
    values = {name: view.average(error[name]) for name, view in views.items()}
    readings, run = values[BREAKAWAY], views[BREAKAWAY].run
    late = {int(test): float(np.mean(readings[run == test])) for test in set(run)}
    values[BREAKAWAY] = readings - _of_tests(late, views[BREAKAWAY])
    found = {name: _autocovariance(values[name], view) for name, view in views.items()}
    least = _STATIC_KNOWN * float(model.parameters.static_effort)
    found[BREAKAWAY][0] = max(found[BREAKAWAY][0], least**2)
    return ResidualNoise(found, late, sensors, seed)


def _of_tests(late: dict[int, float], view: Windows) -> FloatArray:
    """(windows,): each one's test's; the mean of all where a test has none."""
    other = float(np.mean(list(late.values()))) if late else 0.0
    return np.array([late.get(int(run), other) for run in view.run])


def build_frame(
    traces: Traces,
    model: Model,
    noise: ResidualNoise,
    scatter: float,
    moving: Sequence[CatalogueEffect] = (),
) -> Frame:
    """The frame of some traces: windows, whitening and friction of its own."""
    views = build_windows(traces, model, moving)
    own = noise.of_sensors(traces, model, views)
    whitening = {
        name: _whitening(noise.covariance[name], view, own.get(name))
        for name, view in views.items()
    }
    p = model.parameters
    friction = sliding_friction(traces.velocity, traces.direction, p.coulomb_effort, p.viscous)
    shown = {
        EFFORT: views[EFFORT].average(np.asarray(friction)),
        BREAKAWAY: np.full(len(views[BREAKAWAY]), float(p.static_effort)),
    }
    white = {name: np.asarray(whitening[name] @ values) for name, values in shown.items()}
    late = _of_tests(noise.late, views[BREAKAWAY])
    return Frame(traces, views, whitening, white, scatter, late, own)


def _autocovariance(values: FloatArray, view: Windows) -> FloatArray:
    """Autocovariance over lags 0 to ORDER, the median over stretches."""
    lengths = [own.stop - own.start for own in _stretches(view)]
    found = [_of_stretch(values[own]) for own in _stretches(view)]
    known = [i for i, gamma in enumerate(found) if gamma is not None]
    if not known:
        spread = float(np.var(values)) if len(values) else 1.0
        return np.concatenate(([max(spread, 1e-300)], np.zeros(ORDER)))
    weights = np.array([lengths[i] for i in known], dtype=float)
    return _weighted_median(np.array([found[i] for i in known]), weights)


def _stretches(view: Windows) -> list[slice]:
    """The unbroken rows of windows."""
    return runs_of(len(view), view.stretch) if len(view) else []


def _of_stretch(values: FloatArray) -> FloatArray | None:
    """Autocovariance (ORDER + 1,) of a stretch (n,); None of one too short to tell."""
    n = len(values)
    if n < 4 * ORDER:
        return None
    own = values - values.mean()
    return np.array([float(own[: n - k] @ own[k:]) / (n - k) for k in range(ORDER + 1)])


def _weighted_median(rows: FloatArray, weights: FloatArray) -> FloatArray:
    """The row whose variance is the weighted median."""
    order = np.argsort(rows[:, 0])
    cumulated = np.cumsum(weights[order])
    middle = order[np.searchsorted(cumulated, 0.5 * cumulated[-1])]
    near = np.abs(np.log(rows[:, 0] / rows[middle, 0])) < 0.3
    return np.asarray(np.average(rows[near], axis=0, weights=weights[near]))


def _model(covariance: FloatArray, count: int) -> Autoregression:
    """Of noise with an autocovariance (ORDER + 1,), fitted on so many rows."""
    shown = covariance.copy()
    shown[0] *= 1.0 + _RIDGE
    return damped(shown, largest_reflection(count)) or Autoregression.white(shown[0])


def _whitening(covariance: FloatArray, view: Windows, sensors: FloatArray | None = None) -> Any:
    """Sparse (rows, rows): each stretch's one-step prediction errors over their spread.

    `sensors` (rows,): the sensors' noise along the motion. Where a stretch holds more of it than
    most, as where an encoder's counts beat against the sampling, its noise is that much more.
    """
    plain, stretches = _model(covariance, len(view)), _stretches(view)
    models = [plain] * len(stretches)
    if sensors is not None:
        usual, own = _autocovariance(sensors, view), [_of_stretch(sensors[s]) for s in stretches]
        for i, more in enumerate(own):
            if more is not None and more[0] > usual[0]:
                models[i] = _model(covariance + more - usual, len(view))
    # A tone can be predicted, but what does not belong to it is no more certain for that.
    scales = [math.sqrt(min(1.0, own.innovation / plain.innovation)) for own in models]
    return whitening_matrix(models, stretches, scales)


def friction_scatter(frame: Frame, rest: FloatArray) -> float:
    """Relative spread of sliding friction from test to test, one standard deviation.

    `rest` (rows,) is a whitened residual of a frame without scatter. The median over the
    tests, so that an effect that shows in some of them is not mistaken for scatter.
    """
    values = rest[frame.rows(EFFORT)]
    run = frame.windows[EFFORT].run
    found = []
    for index in np.unique(run):
        f, own = frame.friction[EFFORT][run == index], values[run == index]
        power = float(f @ f)
        if power > _LEAST_POWER:
            found.append((float(f @ own) / power) ** 2 - 1.0 / power)
    if len(found) < _LEAST_TESTS:
        return 0.0
    return float(np.sqrt(max(float(np.median(found)), 0.0) / MEDIAN_OF_SQUARES))
