"""Motion logs as runs of the simulator: commands, start states, segments.

A test is simulated open loop from its first row, and in segments that start within it. Every
start state is estimated from the samples around it; that a test starts at rest
(`docs/reference/log-format.md`) is checked against these samples.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np

from sysid import signals
from sysid.errors import Failure, error_of, input_error, on_its_own
from sysid.io.channels import CHAMBER_PRESSURES, COMPARED, LOG_COLUMNS, simulated_channels
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.io.trial_kind import rows_per_ripple
from sysid.plant import valve_timing
from sysid.plant.effects.rig_sizes import RigSizes
from sysid.plant.ports import Model
from sysid.recording.motion_checks import (
    MIN_ROWS,
    check_at_rest,
    check_channels,
    check_sampling,
    driven_kind,
    moves_at_start,
)
from sysid.recording.recording import Recording
from sysid.recording.start_states import (
    ChannelNoise,
    InitialState,
    ValveEdges,
    half_window,
    state_at_rest,
    state_within,
    valve_edges,
)
from sysid.types import FloatArray, IntArray

Commands = tuple[FloatArray | None, FloatArray | None]

# A segment may start this share of its length after its place on the even grid.
_SLACK = 0.25
RUN_UP_S = 0.35
"""A run-up, s, in which flows and pressures forget their start: of a segment that is simulated, and
of states along measured motion."""
_MOVING = "{0}: starts while moving ({1}): its first samples give the velocity that it starts with"


@dataclass(frozen=True)
class Segment:
    """Rows [start, stop) of a test, the state at its start, and which valves were open there.

    `settled`: no valve had an edge under way at the start, so that the commands from there
    on determine the valves. `run_up`: the rows simulated before it, up to its first row, in which
    an effect's internal states forget their initial values. None for a test's first row.
    """

    start: int
    stop: int
    state: InitialState
    starts_on: tuple[bool, bool] = (False, False)
    settled: bool = True
    run_up: Segment | None = None


@dataclass(frozen=True, kw_only=True)
class MotionTest(Recording):
    """One test of a motion log on its own time, checked and ready for the simulator.

    `pulsed`: its valves are commanded by duties, else by 0 or 1. `noise` is that of position and
    pressures. `whole` starts at the first row, `segments` within the test; of a test whose start is
    excluded `whole` starts as segments do, after what a start state and a run-up need. Run-ups last
    `slowness` times as long as on the reference rig.
    """

    pulsed: bool
    noise: ChannelNoise
    whole: Segment
    segments: tuple[Segment, ...] = ()
    notices: tuple[str, ...] = ()
    slowness: float = 1.0

    @property
    def run_up_rows(self) -> int:
        """How many rows a run-up has."""
        return round(RUN_UP_S * self.slowness / self.period)

    @cached_property
    def commands(self) -> Commands:
        """Commands (n,) of valves A and B, None for a valve that stays off."""
        return commands_of(self.trial, self.pulsed, self.rig)

    @cached_property
    def measured(self) -> FloatArray:
        """(3, n) position and pressures, NaN where not logged."""
        return measured_channels(self.trial, self.rig)

    def counted(self, segment: Segment) -> int:
        """How many rows of a segment count: those before the arm comes near an end stop.

        A spring rests the piston at one: there a test may begin, which counts until it is back.
        """
        near, left = self.near_stop[segment.start : segment.stop], 0
        if self.rig.spring is not None and segment.start == 0 and near[0]:
            left = int(np.argmin(near))
            if near[left]:
                return 0
        back = np.flatnonzero(near[left:])
        return left + int(back[0]) if back.size else segment.stop - segment.start

    def measured_in(self, segment: Segment) -> FloatArray:
        """(3, rows) position and pressures of a segment's rows that count."""
        return self.measured[:, segment.start : segment.start + self.counted(segment)]

    def residual_of(self, segment: Segment, run: FloatArray) -> FloatArray:
        """(3, rows): measured less simulated (3, n), of the segment's rows that count."""
        measured = self.measured_in(segment)
        return measured - run[:, : measured.shape[1]]


def slowness_of(rig: Rig, model: Model) -> float:
    """How many times as slow as the reference rig its chambers fill, 1 where they are no slower.

    Within a segment flows must show: of a slow rig's pressures a second holds a fraction of the
    time in which they change. A fast rig's start states need as many rows as any.
    """
    if rig.is_motor_alone:
        return 1.0
    return max(1.0, RigSizes.of(model.parameters).slowness)


def prepare(
    trial: Trial,
    kind: str,
    rig: Rig,
    horizon: float,
    inertia: float | None = None,
    slowness: float = 1.0,
) -> MotionTest:
    """A test of a motion log, its noise, and its start states about every `horizon` s.

    `inertia` (kg m2 or kg) is the bundle's, for a rig file that declares none. On a rig that takes
    `slowness` times as long as the reference rig to fill, start states are as many times as rare.
    Raises InputError, which names the test, for missing channels, gaps, a sampling that
    cannot follow the PWM grid, or a test that does not start at rest (with a motor alone it may:
    its first samples show the velocity).
    """
    kind = driven_kind(trial, kind, rig)
    check_channels(trial, kind, rig)
    check_sampling(trial, kind, rig)
    _check_commands(trial, kind, rig)
    pulsed = kind == "motion-pwm"
    stride = rows_per_ripple(trial, rig) if pulsed else None
    measured = measured_channels(trial, rig)
    noise = channel_noise(measured, stride or 1, rig.sensors.pressure_noise_pa)
    a, b = (valve_edges(trial.time, u, pulsed, rig) for u in commands_of(trial, pulsed, rig))
    edges, notices = (a, b), _not_logged(trial, rig)
    test = MotionTest(
        trial=trial,
        rig=rig,
        period=float(trial.time[-1] - trial.time[0]) / (len(trial) - 1),
        lost=np.zeros(len(trial), dtype=bool),
        gravity_moment=rig.carrying(trial.payload_kg).gravity_moment(),
        pulsed=pulsed,
        noise=noise,
        whole=Segment(0, len(trial), state_at_rest(trial.time, measured, noise, edges)),
        slowness=slowness,
    )
    test = replace(test, whole=_whole(test, edges, inertia, stride, notices))
    if test.near_stop.any() and test.counted(test.whole) < test.whole.stop - test.whole.start:
        notices.append(_stop_notice(test))
    segments = _segments(test, edges, horizon * slowness, rig, stride)
    return replace(test, segments=segments, notices=tuple(notices))


def _whole(
    test: MotionTest,
    edges: tuple[ValveEdges, ValveEdges],
    inertia: float | None,
    stride: int | None,
    notices: list[str],
) -> Segment:
    """All of a test, from rest; with a motor alone it may move at its start, by a notice."""
    tolerance = 2.0 * test.noise.still
    if not test.trial.has_its_start:
        return _whole_of_part(test, edges, test.rig, stride)
    if not test.rig.is_motor_alone:
        check_at_rest(test, tolerance, inertia)
        return test.whole
    moved = moves_at_start(test, tolerance, inertia)
    if moved is None:
        return test.whole
    notices.append(_MOVING.format(test.source, moved))
    start = _state_in_motion(test.trial.time, test.measured, test.noise, edges)
    return replace(test.whole, state=start)


def prepare_all(
    trials: Sequence[Trial],
    kind: str,
    rig: Rig,
    horizon: float,
    inertia: float | None = None,
    slowness: float = 1.0,
) -> tuple[list[MotionTest], list[str]]:
    """`prepare` of each test of a log; one that cannot be simulated is skipped with a notice.

    This is so for a gap, or a test that does not start at rest. Raises the first test's error if
    no test can be simulated.
    """
    found: list[MotionTest] = []
    left_out: list[Failure] = []
    for trial in trials:
        test = on_its_own(partial(prepare, trial, kind, rig, horizon, inertia, slowness))
        if isinstance(test, Failure):
            left_out.append(test)
        else:
            found.append(test)
    if left_out and not found:
        raise error_of(left_out[:1], left_out[0].reason)
    return found, [f"excluded: {why.reason}" for why in left_out]


def _state_in_motion(
    time: FloatArray,
    measured: FloatArray,
    noise: ChannelNoise,
    edges: tuple[ValveEdges, ValveEdges],
) -> InitialState:
    """State at a test's first row from its first samples: a motor alone has no hidden states."""
    near = slice(0, half_window(float(time[1] - time[0]), None) + 1)
    return state_within(float(time[0]), time[near], measured[:, near], noise, edges, None)


def _whole_of_part(
    test: MotionTest, edges: tuple[ValveEdges, ValveEdges], rig: Rig, stride: int | None
) -> Segment:
    """Where a simulation of part of a test starts if the state at its first row is unknown.

    It starts from a state estimated from its samples, once pending edges have taken effect, and
    after a run-up. Raises InputError where the part is too short, or a pressure is not logged.
    """
    if not _shows_its_state(test):
        raise input_error(
            test.source,
            "starts after excluded rows, and a chamber's pressure there is not logged",
            "log the chambers' pressures, or exclude the test as a whole",
        )
    delays = (rig.valves.on_delay_s, rig.valves.off_delay_s) if rig.valves else (0.0,)
    half = half_window(test.period, stride)
    first = half + math.ceil(max(delays) / test.period)
    run_up = test.run_up_rows
    allowed = _allowed_starts(test, rig)
    allowed = allowed[(allowed >= first) & (allowed < len(test) - half)]
    last = first + run_up + round(_SLACK * run_up)
    near = allowed[(allowed >= first + run_up) & (allowed <= last)]
    row = _best_start(test, edges, near, half * test.period)
    if row is None or len(test) - row < MIN_ROWS:
        raise input_error(
            test.source,
            f"is the remainder of a test after exclusion, too short to be simulated ({len(test)} "
            f"rows; its first {run_up * test.period:g} s only give its start)",
            "exclude less of it, or the test as a whole",
        )
    whole = _segment(test, edges, slice(row, len(test)), stride)
    return replace(whole, run_up=_run_up(test, edges, row, allowed, stride))


def _stop_notice(test: MotionTest) -> str:
    begins = test.rig.spring is not None and test.near_stop[0]
    first = test.counted(test.whole) if begins else int(np.argmax(test.near_stop))
    return (
        f"{test.source}: within 1 % of the stroke from an end stop at "
        f"{test.trial.time[first] - test.trial.time[0]:.3f} s ({int(test.near_stop.sum())} of "
        f"{len(test)} rows); a simulation counts until the arm comes that near"
    )


def _check_commands(trial: Trial, kind: str, rig: Rig) -> None:
    other = "valve" if kind == "motion-pwm" else "duty"
    for valve in rig.valve_names:
        name = f"{other}_{valve}"
        if name in trial and bool(np.any(trial[name] != 0.0)):
            raise input_error(
                trial.source,
                f"{name} is commanded in a {kind} test",
                "name its kind in the campaign: motion-pwm for duties, motion-discrete for valves",
            )


def commands_of(trial: Trial, pulsed: bool, rig: Rig) -> Commands:
    """Commands (n,) of a rig's two valves, None for one that stays off or that there is not."""
    prefix = "duty" if pulsed else "valve"
    found = [trial.channels.get(f"{prefix}_{name}") for name in rig.valve_names]
    a, b = [*found, None][:2]
    return a, b


def measured_channels(trial: Trial, rig: Rig) -> FloatArray:
    """(3, n) position and pressures of a trial, NaN where not logged, or there is no chamber."""
    names = simulated_channels(rig.position_channel)
    found = np.full((len(names), len(trial)), np.nan)
    for i, name in enumerate(names):
        there = name not in CHAMBER_PRESSURES or name in rig.pressure_channels
        if there and name in trial:
            found[i] = trial[name]
    return found


def _not_logged(trial: Trial, rig: Rig) -> list[str]:
    """Notices of chambers whose pressure is not logged."""
    return [
        f"{trial.source}: {name} is not logged; the chamber is assumed to start at the "
        "atmosphere's pressure, and the test is simulated as a whole only"
        for name in rig.pressure_channels
        if name not in trial
    ]


def channel_noise(
    measured: FloatArray, stride: int = 1, declared_pa: float | None = None
) -> ChannelNoise:
    """ChannelNoise of one sample of position and pressures (3, n), from the samples themselves.

    Where the rig file declares the pressure sensors' noise (`declared_pa`), that is taken.
    Under PWM the pressures ripple with the pulses, which is not noise: rows `stride` apart lie at
    the same point of a pulse. Two such combs, half a period apart, are used.
    NaN for a channel that is not logged.
    """
    totals = [signals.position_floor(measured[0]).total]
    for name, row in zip(COMPARED, measured[1:], strict=True):
        if np.isnan(row).any():
            totals.append(math.nan)
            continue
        step = signals.quantum(row)
        if declared_pa is not None and LOG_COLUMNS[name].is_pressure:
            totals.append(signals.NoiseFloor(declared_pa, step).total)
            continue
        combs = [row[start::stride] for start in {0, stride // 2}]
        long_enough = [c for c in combs if len(c) >= MIN_ROWS] or [row]
        floors = [signals.noise_floor(c, step).total for c in long_enough]
        totals.append(math.sqrt(float(np.mean(np.square(floors)))))
    return ChannelNoise(np.array(totals), signals.quantum(measured[0]))


def _shows_its_state(test: MotionTest) -> bool:
    """Whether a start within a test is known: its position, and the pressure of each chamber."""
    own = 1 + len(test.rig.pressure_channels)
    return not bool(np.isnan(test.measured[:own]).any())


# --- where segments start --------------------------------------------------------------


def _segments(
    test: MotionTest,
    edges: tuple[ValveEdges, ValveEdges],
    horizon: float,
    rig: Rig,
    stride: int | None,
) -> tuple[Segment, ...]:
    """Segments of `horizon` s, one after another, each from an estimated state."""
    if not _shows_its_state(test):
        return ()
    rows, n = round(horizon / test.period), len(test)
    half = half_window(test.period, stride)
    allowed = _allowed_starts(test, rig)
    segments = []
    for first in range(max(half, test.whole.start), n - rows + 1, rows):
        last = min(first + round(_SLACK * rows), n - rows, n - half - 1)
        near = allowed[(allowed >= first) & (allowed <= last)]
        start = _best_start(test, edges, near, half * test.period)
        if start is None:
            continue
        segment = _segment(test, edges, slice(start, start + rows), stride)
        segments.append(replace(segment, run_up=_run_up(test, edges, start, allowed, stride)))
    return tuple(segments)


def _segment(
    test: MotionTest, edges: tuple[ValveEdges, ValveEdges], rows: slice, stride: int | None
) -> Segment:
    """These rows, from the state estimated at the first."""
    half, time = half_window(test.period, stride), test.trial.time
    at, part = float(time[rows.start]), slice(rows.start - half, rows.start + half + 1)
    state = state_within(at, time[part], test.measured[:, part], test.noise, edges, stride)
    starts_on = (edges[0].was_open(at), edges[1].was_open(at))
    settled = not any(e.pending(at) for e in edges)
    return Segment(rows.start, rows.stop, state, starts_on, settled)


def _run_up(
    test: MotionTest,
    edges: tuple[ValveEdges, ValveEdges],
    start: int,
    allowed: IntArray,
    stride: int | None,
) -> Segment | None:
    """The rows before a segment up to its first, or from the test's start on."""
    half = half_window(test.period, stride)
    first = start - test.run_up_rows
    if first < half:
        return replace(test.whole, stop=start + 1) if test.trial.begun_s == 0.0 else None
    near = allowed[(allowed >= max(first - half, half)) & (allowed <= first)]
    row = _best_start(test, edges, near[::-1], half * test.period)
    return None if row is None else _segment(test, edges, slice(row, start + 1), stride)


def _allowed_starts(test: MotionTest, rig: Rig) -> IntArray:
    """Rows at which a separate run may start: under PWM, those that start a period."""
    if not test.pulsed:
        return np.arange(len(test))
    period = rig.require("pwm", "which a test under PWM needs").period_s
    starts, _ = valve_timing.period_duties(test.trial.time, np.zeros(len(test)), period)
    row = np.searchsorted(test.trial.time, starts - 1e-3 * test.period)
    row = np.minimum(row, len(test) - 1)
    return np.unique(row[np.abs(test.trial.time[row] - starts) < 1e-3 * test.period])


def _best_start(
    test: MotionTest, edges: tuple[ValveEdges, ValveEdges], rows: IntArray, window: float
) -> int | None:
    """The first of these rows with no valve edge under way; None without rows.

    Valves that do not pulse should not move within the smoothing window either, where the
    pressures bend; this second condition is dropped first.
    """
    clearances = (0.0,) if test.pulsed else (window, 0.25 * window, 0.0)
    for clearance in clearances:
        for row in rows:
            if not any(e.moves_near(float(test.trial.time[row]), clearance) for e in edges):
                return int(row)
    return int(rows[0]) if rows.size else None


__all__ = ["MotionTest", "Segment", "channel_noise", "prepare", "slowness_of"]
