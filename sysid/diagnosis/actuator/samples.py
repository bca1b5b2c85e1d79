"""The logs of a campaign as one long table of smoothed samples, and windows that average it.

Equation errors are taken in weak form: a residual that is computed sample by sample is
averaged under Hann windows, which weigh the measured and the modelled side alike. All tests
lie end to end in the same arrays, so that the model's ports are evaluated once for all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid import signals
from sysid.errors import input_error
from sysid.io.channels import SIDES
from sysid.io.logs import Trial
from sysid.io.rig import NO_LOAD, Rig
from sysid.io.trial_kind import is_held
from sysid.plant.effects.rig_sizes import RigSizes
from sysid.plant.ports import Model
from sysid.plant.preparation import Inputs, Shared, open_intervals
from sysid.plant.valve_timing import OpenIntervals
from sysid.recording.even import on_even_grid
from sysid.types import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from scipy.sparse import csr_array


# Times and frequencies are those of a rig like the reference rig: a test has them so many times as
# long, and as low, as `TestRun.time_scale` says.
# Smoothing of the channels before they enter the equations, Hz. The commands are not
# smoothed: laws that are nonlinear in pressure or velocity need the true ones.
PRESSURE_CUTOFF_HZ = 350.0
POSITION_CUTOFF_HZ = 150.0
VELOCITY_CUTOFF_HZ = 60.0
WINDOW_S = 0.020
# At rest: slower than this share of the rig's high speed.
_REST_SPEED = 0.004
# Around a reversal the shaft may stick, however short.
_REVERSAL_S = 0.012
# Time at a test's ends where smoothing is one-sided.
_SEAM_S = 0.015
# Rows in a window of the reference rig: a faster one's is no shorter than so many rows.
_WINDOW_ROWS = 20
# Between tests that are measured as one, s: long against a lag, short enough to count it in.
_GAP_S = 1e4


@dataclass(frozen=True, eq=False)
class Rows:
    """A selection of samples: `index` (m,) into the arrays of traces; equal only to itself."""

    index: IntArray


# Equal only to itself, so that what follows from the tests alone is cached under them.
@dataclass(frozen=True, eq=False)
class TestRun:
    """One test of the campaign: its log's kind, its rows in the arrays, and its commands.

    `moves`: the shaft is free (not held), so that its torque balance counts. `stamps` are the
    times (m,) s of the log's own rows where they are not those of the arrays. `time_scale`: how
    many times as slow as the reference rig it is taken to be.
    """

    label: str
    file: str
    kind: str
    rows: slice
    period: float
    inputs: Inputs
    moves: bool
    stamps: FloatArray | None = None
    time_scale: float = 1.0

    def count(self, reference_s: float) -> int:
        """The samples in a time, given in s as it is on the reference rig."""
        return round(reference_s * self.time_scale / self.period)

    @cached_property
    def commanded(self) -> Shared:
        """What its commands come to, whatever the valves' delays: worked out once."""
        return Shared()


# Equal only to itself: results derived from traces are cached under them.
@dataclass(frozen=True, eq=False)
class Traces:
    """Samples of all tests end to end, arrays (n,), SI; what the ports are evaluated at.

    `position`, `pressure_a`, `pressure_b` are smoothed; `velocity`, `acceleration`,
    `rate_a`, `rate_b` are their central differences; `motor` is the command's mean around
    the sample and `open_a`, `open_b` the share of the time around it in which a valve is
    open. `direction` is the velocity's sign, 0 at rest. `supply` is the line's
    pressure in each test, the declared one where it is not logged, and `logged_supply` what was
    logged of it, NaN where nothing was. `carried` (n, 3) is what a payload is
    more than the rig file's, as a `Load` has it; (n, 0) where no test's is another.
    """

    runs: tuple[TestRun, ...]
    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    pressure_a: FloatArray
    pressure_b: FloatArray
    rate_a: FloatArray
    rate_b: FloatArray
    motor: FloatArray
    open_a: FloatArray
    open_b: FloatArray
    direction: FloatArray
    supply: FloatArray
    logged_supply: FloatArray
    carried: FloatArray

    def __len__(self) -> int:
        return len(self.time)

    @cached_property
    def time_with_gaps(self) -> FloatArray:
        """Time (n,) s that goes on from test to test, with a long gap between them.

        Of rows of no test in particular: as it is.
        """
        if not self.runs:
            return self.time
        found, start = np.empty(len(self)), 0.0
        for run in self.runs:
            own = self.time[run.rows]
            found[run.rows] = start + own - own[0]
            start = found[run.rows][-1] + _GAP_S
        return found

    def pressure(self, side: str) -> FloatArray:
        """Chamber pressure, Pa."""
        return self.pressure_a if side == "a" else self.pressure_b

    def is_open(self, side: str) -> FloatArray:
        """Share of the time around every sample in which a valve is open, 0 to 1."""
        return self.open_a if side == "a" else self.open_b

    @property
    def travel(self) -> float:
        """How much of the position is visited in motion, rad or m."""
        moving = self.position[self.direction != 0.0]
        return float(np.ptp(moving)) if len(moving) else 0.0

    def is_finite(self) -> bool:
        """Whether every channel is a number everywhere."""
        channels = (self.acceleration, self.rate_a, self.rate_b)
        return all(bool(np.isfinite(channel).all()) for channel in channels)

    def at(self, rows: Rows) -> Traces:
        """These rows alone, of no test in particular; the last few selections are kept."""
        return selected(self, rows)

    def with_measured(
        self, position: FloatArray, pressure_a: FloatArray, pressure_b: FloatArray
    ) -> Traces:
        """The same tests with other positions and pressures as measured."""
        return replace(self, **_derived(self.runs, position, pressure_a, pressure_b))

    def with_channels(
        self, position: FloatArray, pressure_a: FloatArray, pressure_b: FloatArray
    ) -> Traces:
        """The same tests with other smoothed positions and pressures, their derivatives renewed.

        What follows from a channel that is the same stays, and is shared.
        """
        changed: dict[str, Any] = {}
        if position is not self.position:
            changed |= _of_position(self.runs, position)
        if pressure_a is not self.pressure_a:
            changed |= {"pressure_a": pressure_a, "rate_a": _slope(self.runs, pressure_a)}
        if pressure_b is not self.pressure_b:
            changed |= {"pressure_b": pressure_b, "rate_b": _slope(self.runs, pressure_b)}
        return replace(self, **changed)

    def with_opening(self, open_a: FloatArray, open_b: FloatArray) -> Traces:
        """The same tests with the valves open at other times."""
        return replace(self, open_a=open_a, open_b=open_b)


# All threads share the few that are kept, those of each channel: most look at the same traces, one
# is large, and where sensors are fitted their traces are gone with the next numbers.
@lru_cache(maxsize=4)
def selected(traces: Traces, rows: Rows) -> Traces:
    """`selection`; `equation_error.forget` ends what is kept."""
    return selection(traces, rows)


def selection(traces: Traces, rows: Rows) -> Traces:
    """These rows alone, of no test in particular."""
    names = [f.name for f in fields(traces) if f.name != "runs"]
    return replace(
        traces, runs=(), **{n: getattr(traces, n).take(rows.index, axis=0) for n in names}
    )


def prepare(tests: Sequence[tuple[str, str, Trial]], rig: Rig, model: Model) -> Traces:
    """Traces of tests, each given as (file, kind, trial). Raises InputError.

    A test that does not log a pressure has its chamber at the atmosphere. Tests too short
    for a window are left out.
    """
    from sysid.plant.trials import inputs_from_trial, starts_on_supply

    runs: list[TestRun] = []
    parts: list[dict[str, FloatArray]] = []
    start = 0
    slowness = RigSizes.of(model.parameters).slowness
    for file, kind, trial in tests:
        scale = _time_scale(slowness, trial.period)
        if len(trial) * trial.period < 3.0 * WINDOW_S * scale:
            continue
        uniform = on_even_grid(trial, rig)
        on = starts_on_supply(uniform, rig) if kind == "valve-pwm" else (False, False)
        inputs = inputs_from_trial(uniform, rig, on)
        stop = start + len(uniform)
        moves = not kind.startswith("valve") and not is_held(trial, rig)
        period = float(uniform.time[1] - uniform.time[0])
        stamps = None if signals.is_even(trial.time, uniform.time) else trial.time
        rows = slice(start, stop)
        runs.append(TestRun(trial.label, file, kind, rows, period, inputs, moves, stamps, scale))
        parts.append(_channels(uniform, rig, inputs))
        start = stop
    if not runs:
        raise input_error("diagnosis", "no test is long enough", "log tests of a second or more")
    joined = {name: np.concatenate([p[name] for p in parts]) for name in parts[0]}
    return Traces(
        runs=tuple(runs),
        time=joined["time"],
        motor=joined["motor"],
        open_a=opening(runs, model, "a"),
        open_b=opening(runs, model, "b"),
        supply=joined["supply"],
        logged_supply=joined["logged_supply"],
        carried=_carried(runs),
        **_derived(tuple(runs), *(joined[n] for n in ("position", "pressure_a", "pressure_b"))),
    )


def _time_scale(slowness: float, period: float) -> float:
    """How many times as slow as the reference rig a test is taken to be, by how slow its rig is.

    A fast rig's windows hold as many rows as the reference rig's, or last as long as those.
    """
    return max(slowness, min(1.0, _WINDOW_ROWS * period / WINDOW_S))


def _carried(runs: Sequence[TestRun]) -> FloatArray:
    loads = [run.inputs.load for run in runs]
    columns = 0 if all(load == NO_LOAD for load in loads) else 3
    found = np.zeros((runs[-1].rows.stop, columns))
    for run, load in zip(runs, loads, strict=True):
        if columns:
            found[run.rows] = load.inertia, load.gravity_moment, load.weight
    return found


def _channels(trial: Trial, rig: Rig, inputs: Inputs) -> dict[str, FloatArray]:
    """A test's channels as logged; missing ones as the log format defines them."""
    air = rig.require("air", "which the chamber equations need")
    defaults = {
        rig.position_channel: 0.0,
        "pressure_a_pa": air.atmospheric_pressure_pa,
        "pressure_b_pa": air.atmospheric_pressure_pa,
    }
    names = ("position", "pressure_a", "pressure_b")
    found = {
        name: np.asarray(trial.channels.get(channel, np.full(len(trial), default)), dtype=float)
        for name, (channel, default) in zip(names, defaults.items(), strict=True)
    }
    for name, (channel, _) in zip(names, defaults.items(), strict=True):
        missing = ~np.isfinite(found[name])
        if missing.any():
            raise input_error(
                trial.source,
                f"{channel} is missing at {trial.time[int(np.argmax(missing))]:g} s",
                "fill the gap, or take the test out of the campaign",
            )
    supply = air.supply_pressure_pa if inputs.supply is None else inputs.supply
    found["supply"] = np.full(len(trial), supply)
    unknown = np.full(len(trial), math.nan)
    found["logged_supply"] = np.asarray(trial.channels.get("supply_pressure_pa", unknown))
    found["motor"] = signals.held_about_rows(inputs.motor)
    found["time"] = trial.since_start
    return found


def smooth(runs: Sequence[TestRun], values: FloatArray, cutoff_hz: float) -> FloatArray:
    """A channel (n,) under a Gaussian that halves the amplitude at the cut-off, test by test."""
    from scipy.ndimage import gaussian_filter1d

    found = np.empty(len(values))
    for run in runs:
        cutoff = cutoff_hz / run.time_scale
        sigma = math.sqrt(2.0 * math.log(2.0)) / (2.0 * math.pi * cutoff * run.period)
        gaussian_filter1d(
            values[run.rows], sigma, mode="nearest", truncate=3.5, output=found[run.rows]
        )
    return found


def _derived(
    runs: tuple[TestRun, ...],
    position: FloatArray,
    pressure_a: FloatArray,
    pressure_b: FloatArray,
) -> dict[str, Any]:
    """Smoothed channels and their derivatives."""
    found = _of_position(runs, smooth(runs, position, POSITION_CUTOFF_HZ))
    for side, pressure in zip(SIDES, (pressure_a, pressure_b), strict=True):
        found[f"pressure_{side}"] = own = smooth(runs, pressure, PRESSURE_CUTOFF_HZ)
        found[f"rate_{side}"] = _slope(runs, own)
    return found


def _of_position(runs: tuple[TestRun, ...], position: FloatArray) -> dict[str, Any]:
    """A smoothed position and its derivatives, test by test."""
    velocity = smooth(runs, _slope(runs, position), VELOCITY_CUTOFF_HZ)
    return {
        "position": position,
        "velocity": velocity,
        "acceleration": _curvature(runs, position),
        "direction": directions(runs, velocity),
    }


def _slope(runs: Sequence[TestRun], values: FloatArray) -> FloatArray:
    """`np.gradient` of each test, of all in one go: (n,)."""
    period, first, last = _ends(runs)
    found = np.gradient(values) / period
    found[first] = (values[first + 1] - values[first]) / period[first]
    found[last] = (values[last] - values[last - 1]) / period[last]
    return np.asarray(found)


def _curvature(runs: Sequence[TestRun], values: FloatArray) -> FloatArray:
    """`signals.second_derivative` of each test, of all in one go: (n,)."""
    period, first, last = _ends(runs)
    found = signals.second_derivative(values, 1.0) / period**2
    found[first], found[last] = found[first + 1], found[last - 1]
    return found


def _ends(runs: Sequence[TestRun]) -> tuple[FloatArray, IntArray, IntArray]:
    """Each sample's period (n,) s, and the tests' first and last samples."""
    first, stop = np.array([(run.rows.start, run.rows.stop) for run in runs]).T
    return np.repeat([run.period for run in runs], stop - first), first, stop - 1


def directions(runs: Sequence[TestRun], slow_velocity: FloatArray) -> FloatArray:
    """Sign of the smoothed velocity, 0 where the shaft rests or may rest: around reversals too."""
    from scipy.ndimage import binary_dilation

    rests, sign = is_slow(runs, slow_velocity), np.sign(slow_velocity)
    rests[1:] |= sign[1:] != sign[:-1]
    for run in runs:
        if run.moves:
            guard = max(1, run.count(_REVERSAL_S))
            rests[run.rows] = binary_dilation(rests[run.rows], iterations=guard)
        else:
            rests[run.rows] = True
    return np.where(rests, 0.0, sign)


def is_slow(runs: Sequence[TestRun], velocity: FloatArray) -> BoolArray:
    """Where a smoothed velocity (n,) is that of a shaft at rest, by the speeds of all tests."""
    speeds = [np.abs(velocity[run.rows]) for run in runs if run.moves]
    if not speeds:
        return np.ones(len(velocity), dtype=bool)
    fast = float(np.quantile(np.concatenate(speeds), 0.98))
    return np.asarray(np.abs(velocity) < _REST_SPEED * fast)


def opening(runs: Sequence[TestRun], model: Model, side: str) -> FloatArray:
    """Share of the time around every sample in which a valve is open, (n,)."""
    found = np.zeros(runs[-1].rows.stop)
    for run in runs:
        intervals = open_intervals(run.inputs, side, model, shared=run.commanded)
        if len(intervals.opens):
            time, half = run.inputs.time, 0.5 * run.period
            # Some edges lie at infinity.
            low, high = time[0] - 1.0, time[-1] + 1.0
            bounded = OpenIntervals(
                np.clip(intervals.opens, low, high), np.clip(intervals.closes, low, high)
            )
            bounds = np.concatenate(([time[0] - half], time + half))
            found[run.rows] = bounded.between(bounds) / run.period
    return found


def commanded_lengths(runs: Sequence[TestRun], model: Model) -> FloatArray:
    """How long the valves' commands and the pauses between them last, (n,) s."""
    found, bare = [np.zeros(0)], Model(model.parameters)
    for run in runs:
        for side in SIDES:
            commands = open_intervals(run.inputs, side, bare, (0.0, 0.0), run.commanded)
            edges = np.column_stack((commands.opens, commands.closes)).ravel()
            found.append(np.diff(edges[np.isfinite(edges)]))
    return np.concatenate(found)


@dataclass(frozen=True)
class Windows:
    """Hann windows over the samples: `average` maps (n,) to (windows,).

    Only windows that lie within one stretch of usable samples exist. `matrix` averages the
    samples that any window holds, `used`. `run` (windows,) is the test's index, `stretch`
    (windows,) numbers the unbroken rows of windows, `centre` (windows,) the middle sample.
    """

    matrix: csr_array
    used: Rows
    run: IntArray
    stretch: IntArray
    centre: IntArray

    def average(self, values: FloatArray) -> FloatArray:
        """Mean of each window, (windows,) or (windows, m) from (n,) or (n, m)."""
        return np.asarray(self.matrix @ values[self.used.index])

    def __len__(self) -> int:
        return len(self.run)


def window_width(pwm_period: float, wanted: float = WINDOW_S, row: float = 0.0) -> float:
    """Width of a window, s: the whole number of PWM periods (s) next to the wanted, from two on.

    An even one where an odd one is an odd number of rows (of `row` s): the two halves of a window
    are whole rows. The wanted one where a period is too long for that: one alone would not average
    its ripple.
    """
    periods = round(wanted / pwm_period)
    if periods < 2:
        return wanted
    rows = round(periods * pwm_period / row) if row > 0.0 else 0
    if rows % 2 and abs(rows * row - periods * pwm_period) < 0.1 * row:
        periods += 1 if wanted > periods * pwm_period else -1
    return periods * pwm_period


def windows(traces: Traces, usable: BoolArray, pwm_period: float | None = None) -> Windows:
    """Windows over the usable samples (n,), none across a test's ends or a sample left out.

    With a PWM period (s) each is a whole number of them wide, so that the ripple of the pulses
    averages out, and is on a grid of its test: wherever a stretch of usable samples begins, the
    windows of a log and of its twins see the same phase of the pulses. Without one they begin with
    each stretch: next to a reversal the smoothed balance is biased, and less so in a wider window.
    """
    from scipy.sparse import csr_array

    lengths, columns, weights, of_run, of_stretch, centres = [], [], [], [], [], []
    count = stretch = 0
    for index, run in enumerate(traces.runs):
        width = WINDOW_S * run.time_scale
        if pwm_period is not None:
            width = window_width(pwm_period, width, run.period)
        step = max(1, round(0.5 * width / run.period))
        # A Hann window of exactly this width is 0 at both ends: `half` is what lies between.
        half = step if pwm_period is None else max(1, step - 1)
        kernel = 1.0 + np.cos(np.pi * np.arange(-half, half + 1) / (half + 1))
        kernel /= kernel.sum()
        reach = np.arange(-half, half + 1)
        good = usable[run.rows].copy()
        seam = max(2, run.count(_SEAM_S))
        good[:seam] = good[-seam:] = False
        edges = np.flatnonzero(np.diff(np.concatenate(([0], good.astype(int), [0]))))
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            begin = first + half
            if pwm_period is not None:
                begin = -(-begin // step) * step
            middles = np.arange(begin, last - half, step) + run.rows.start
            if len(middles) == 0:
                continue
            lengths.append(np.full(len(middles), len(kernel), dtype=np.int32))
            columns.append((middles[:, None] + reach).ravel().astype(np.int32))
            weights.append(np.tile(kernel, len(middles)))
            of_run.append(np.full(len(middles), index))
            of_stretch.append(np.full(len(middles), stretch))
            centres.append(middles)
            count += len(middles)
            stretch += 1
    empty = np.zeros(0, dtype=np.intp)
    none = np.zeros(0, dtype=np.int32)  # half the memory: a diagnosis keeps many of them
    held = np.concatenate([none, *columns])
    is_used = np.zeros(len(traces), dtype=bool)
    is_used[held] = True
    used = np.flatnonzero(is_used).astype(np.intp)
    # In the order of compressed rows, among the samples that some window holds.
    place = np.cumsum(is_used, dtype=np.int32) - np.int32(1)
    ends = np.cumsum(np.concatenate([np.zeros(1, dtype=np.int32), *lengths]), dtype=np.int32)
    matrix = csr_array(
        (np.concatenate([np.zeros(0), *weights]), place[held], ends), shape=(count, len(used))
    )
    return Windows(
        matrix,
        Rows(used),
        np.concatenate([empty, *of_run]),
        np.concatenate([empty, *of_stretch]),
        np.concatenate([empty, *centres]),
    )
