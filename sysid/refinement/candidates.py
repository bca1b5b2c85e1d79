"""Motion tests that could be run next: commands within the rig's limits, tried on the model.

Commands are tried on the bundle's model, as an operator would on the rig, until the arm moves well
and stays off its stops. Draws have fixed seeds: the same bundle gives the same tests.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid.io.channels import simulated_channels
from sysid.io.rig import Rig
from sysid.io.samples import Trial
from sysid.plant.base import place_at_rest
from sysid.plant.ports import Model
from sysid.plant.preparation import Inputs, ValveCommand
from sysid.plant.sensors import measured_channels
from sysid.plant.simulator import MAX_STEP
from sysid.recording.motion_tests import slowness_of
from sysid.types import BoolArray, FloatArray

# Times and frequencies are those of the reference rig, in which its chambers fill and empty many
# times: on a slower rig they are as many times longer.
DURATION_S = 10.0
TRAVEL_USED = 0.9
"""Share of half the travel that a proposed test never exceeds."""
# Share of it that one which moves enough reaches.
_SWING = 0.3
_MOTOR_HZ = (0.5, 1.0, 2.0)
_MOTOR_PHASES = (0.0, 0.5 * np.pi)
# An undeclared motor is driven at most at this many times static friction.
MOST_STATIC = 6.0
_DRAWS = 24
# Middle of both duties, by level; their amplitude follows.
_DUTY_LEVELS = {"low": (0.12, 0.2), "high": (0.22, 0.34)}
_PULSE_S, _PAUSE_S = (0.008, 0.15), (0.15, 0.5)
_REDRAW_S = 0.6


@dataclass(frozen=True)
class CandidateMotion:
    """A motion test that could be run: its log kind, what it is in words, its commands.

    `motor` (n,) Nm or N; `valves` (valves, n) duties (`kind` motion-pwm) or 0 and 1, None: all off.
    `channels` (3, n): position and pressures as the model shows them, without noise. `start`: how
    far from where the rig rests it begins, rad or m.
    """

    kind: str
    text: str
    time: FloatArray
    motor: FloatArray
    valves: FloatArray | None
    channels: FloatArray
    start: float = 0.0

    def first(self, seconds: float) -> CandidateMotion:
        """Its first seconds."""
        n = round(seconds / float(self.time[1] - self.time[0]))
        valves = None if self.valves is None else self.valves[:, :n]
        return CandidateMotion(
            self.kind,
            self.text,
            self.time[:n],
            self.motor[:n],
            valves,
            self.channels[:, :n],
            self.start,
        )

    @property
    def duration(self) -> float:
        """Duration of all its rows, s."""
        return round(len(self.time) * float(self.time[1] - self.time[0]), 6)

    def trial(self, rig: Rig, noise: FloatArray, seed: int) -> Trial:
        """The test as it would be logged, with noise of these standard deviations (3,).

        The position in counts where an encoder's are declared: a shaft at rest shows one.
        """
        rng = np.random.default_rng(seed)
        shown = self.channels + noise[:, None] * rng.standard_normal(self.channels.shape)
        step = rig.encoder_step
        if step is not None:
            shown[0] = step * np.round(self.channels[0] / step)
        names = (rig.position_channel, *rig.pressure_channels)
        found = {rig.effort_channel: self.motor, **dict(zip(names, shown, strict=False))}
        found |= self.valve_columns(rig)
        return Trial("1", self.time, found, f"candidate {self.kind}, {self.text}")

    def valve_columns(self, rig: Rig) -> dict[str, FloatArray]:
        """The valves' commands (n,) by their names in a log; none where all stay off."""
        if self.valves is None:
            return {}
        prefix = "duty" if self.kind == "motion-pwm" else "valve"
        names = [f"{prefix}_{name}" for name in rig.valve_names]
        return dict(zip(names, self.valves, strict=True))


def leaves_travel(position: FloatArray, limit: float, rest: float) -> BoolArray:
    """Where a position (..., n) is farther from the middle than `limit`, both rad or m.

    A spring may rest the piston farther out: there a test begins, and to there it may go back.
    """
    beyond = limit * (1.0 + 1e-9)
    low, high = min(-beyond, rest), max(beyond, rest)
    return np.asarray((position < low) | (position > high))


@dataclass(frozen=True)
class _Stage:
    """Where commands are tried: the rig, its model, whether a motor may be driven."""

    rig: Rig
    model: Model
    has_motor: bool

    @cached_property
    def slowness(self) -> float:
        """As of `slowness_of`."""
        return slowness_of(self.rig, self.model)

    @cached_property
    def row_s(self) -> float:
        """From a test's row to the next, s."""
        return row_period(self.rig)

    @cached_property
    def time(self) -> FloatArray:
        """Of a test's rows, (n,) s."""
        rows = round(usual_duration(self.slowness) / self.row_s)
        return np.asarray(np.arange(rows) * self.row_s, dtype=float)

    @property
    def motors(self) -> tuple[bool, ...]:
        """Whether the motor is driven next to the valves: not and, where there is one, driven."""
        return (False, True) if self.has_motor else (False,)

    @property
    def rest(self) -> float:
        """Where a test begins, rad or m from the middle."""
        return place_at_rest(self.model.parameters)

    @property
    def way(self) -> float:
        """How far it can move, rad or m: over its travel, or as far as the supply compresses a
        return spring."""
        p, whole = self.model.parameters, 2.0 * self.half_travel
        if p.stiffness is None or not float(p.stiffness) > 0.0:
            return whole
        gauge = abs(float(p.supply) - float(p.atmosphere))
        return min(whole, gauge * float(p.area_a) * float(p.pitch_radius) / float(p.stiffness))

    @property
    def valves(self) -> int:
        """How many valves it has."""
        return len(self.rig.valve_names)

    @property
    def half_travel(self) -> float:
        return 0.5 * float(self.rig.travel or 0.0)

    @property
    def rows(self) -> int:
        return len(self.time)

    @property
    def unit(self) -> str:
        return self.rig.units.effort

    @property
    def most_effort(self) -> float:
        static = float(self.model.parameters.static_effort)
        return min(self.rig.max_effort or np.inf, MOST_STATIC * static)

    def shown(self, commands: Sequence[tuple[str, FloatArray, FloatArray | None]]) -> FloatArray:
        """(tests, 3, n): what the sensors show under these commands (kind, motor, valves)."""
        from sysid.plant.simulator import simulate

        inputs = [self._inputs(*command) for command in commands]
        # NaN where a run has no end: it moves over nothing, and is no test to propose.
        runs = simulate(inputs, [self.model] * len(commands), nan_if_endless=True)
        names = simulated_channels(self.rig.position_channel)
        found = [measured_channels(run, self.rig.position_channel, self.model) for run in runs]
        return np.array([[channels[n] for n in names] for channels in found])

    def _inputs(self, kind: str, motor: FloatArray, valves: FloatArray | None) -> Inputs:
        return inputs_of_commands(kind, self.time, motor, valves, self.rest)

    def swing(self, shown: FloatArray) -> FloatArray:
        """(tests,): share of the way that each moves over; 0 if it comes near a stop."""
        inside = ~self.near_stop(shown).any(axis=1)
        return np.where(inside, np.ptp(shown[:, 0], axis=1) / self.way, 0.0)

    def near_stop(self, shown: FloatArray) -> BoolArray:
        """(tests, n): where each is nearer to a stop than a proposed test may come."""
        return leaves_travel(shown[:, 0], TRAVEL_USED * self.half_travel, self.rest)

    def made(
        self, text: str, command: tuple[str, FloatArray, FloatArray | None], shown: FloatArray
    ) -> CandidateMotion:
        kind, motor, valves = command
        return CandidateMotion(kind, text, self.time, motor, valves, shown)


def inputs_of_commands(
    kind: str, time: FloatArray, motor: FloatArray, valves: FloatArray | None, start: float = 0.0
) -> Inputs:
    """A test's commands as a run of the simulator, from rest at a position, rad or m."""
    own = [] if valves is None else [ValveCommand(v, kind == "motion-pwm") for v in valves]
    a, b = [*own, None, None][:2]
    return Inputs(time, motor, a, b, position=start)


def candidate_motions(rig: Rig, model: Model, has_motor: bool = True) -> list[CandidateMotion]:
    """Motion tests of every kind that the rig can do, ten seconds each, from where it rests; on a
    rig slower than the reference rig as many times longer.

    Kinds that the model cannot do are skipped: a motor that it lacks or too weak, duties without a
    PWM period, an arm that falls. Raises InputError without `[cylinder]`, whose stroke limits the
    motion.
    """
    rig.require("cylinder", "whose stroke limits a motion test")
    stage = _Stage(rig, model, has_motor)
    found = list(_motor_sweeps(stage)) if has_motor else []
    if rig.pwm is not None:
        found += _pwm_tests(stage)
    return [*found, *_on_off_tests(stage)]


def row_period(rig: Rig) -> float:
    """From a proposed test's row to the next, s: the sampling period, else the simulator's step."""
    return rig.sampling.period_s if rig.sampling is not None else MAX_STEP


def usual_duration(slowness: float) -> float:
    """Of a test on a rig so many times as slow as the reference rig, whole s."""
    return float(round(DURATION_S * slowness))


def _clipped_sine(time: FloatArray, hz: float, phase: float, clip: float) -> FloatArray:
    """A sine of amplitude 1 whose tops are cut at `clip`."""
    return np.asarray(np.clip(np.sin(2.0 * np.pi * hz * time + phase), -clip, clip))


def _motor_sweeps(stage: _Stage) -> Iterator[CandidateMotion]:
    """At each frequency the largest effort that stays off the stops, and a middle one."""
    static = float(stage.model.parameters.static_effort)
    if stage.most_effort <= 1.2 * static:
        return
    efforts = np.geomspace(1.2 * static, stage.most_effort, 10)
    frequencies = [hz / stage.slowness for hz in _MOTOR_HZ]
    plan = [(f, e, p) for f in frequencies for e in efforts for p in _MOTOR_PHASES]
    commands = [
        ("motion-motor", e * _clipped_sine(stage.time, f, p, 0.85), None) for f, e, p in plan
    ]
    shown = stage.shown(commands)
    swing = stage.swing(shown)
    for hz in frequencies:
        own = [i for i, (f, _, _) in enumerate(plan) if f == hz and swing[i] > 0.02]
        if not own:
            continue
        best = max(own, key=lambda i: swing[i])
        middle = min(own, key=lambda i: abs(swing[i] - 0.4 * swing[best]))
        for i in dict.fromkeys((best, middle)):
            text = f"sine {hz:.3g} Hz, {plan[i][1]:.3g} {stage.unit}"
            yield stage.made(text, commands[i], shown[i])


def _pwm_tests(stage: _Stage) -> Iterator[CandidateMotion]:
    """The duties as clipped sines, two about in antiphase; low and high, without and with motor."""
    for level, span in _DUTY_LEVELS.items():
        for with_motor in stage.motors:
            for attempt in range(5):
                rng = np.random.default_rng((attempt, with_motor, level == "high"))
                drawn = [_duties(stage, span, with_motor, rng) for _ in range(_DRAWS)]
                shown = stage.shown(drawn)
                swing = stage.swing(shown)
                best = int(np.argmax(swing))
                if swing[best] > _SWING:
                    motor = f", motor {np.abs(drawn[best][1]).max():.3g} {stage.unit}"
                    text = f"duties about {drawn[best][2].mean():.2f}{motor if with_motor else ''}"
                    yield stage.made(text, drawn[best], shown[best])
                    break


def _duties(
    stage: _Stage, span: tuple[float, float], with_motor: bool, rng: np.random.Generator
) -> tuple[str, FloatArray, FloatArray]:
    period = stage.rig.require("pwm", "which holds the PWM period").period_s
    number = np.floor(stage.time / period + 1e-6).astype(int)
    at = period * np.arange(number[-1] + 1)
    hz, phase = rng.uniform(0.25, 0.6) / stage.slowness, rng.uniform(0.0, 2.0 * np.pi)
    waves = []
    for own_phase in (phase, phase + np.pi + rng.uniform(-0.5, 0.5))[: stage.valves]:
        middle = rng.uniform(*span)
        sine = _clipped_sine(at, hz * rng.uniform(0.97, 1.03), own_phase, rng.uniform(0.7, 1.0))
        duty = middle + rng.uniform(0.08, 0.2) * sine
        waves.append(np.round(np.clip(duty, 0.004, 0.95), 4)[number])
    motor = _motor_with_duties(stage, hz, with_motor, rng)
    return "motion-pwm", motor, np.array(waves)


def _motor_with_duties(
    stage: _Stage, hz: float, with_motor: bool, rng: np.random.Generator
) -> FloatArray:
    if not with_motor:
        return np.zeros(stage.rows)
    effort = rng.uniform(0.15, 0.5) * stage.most_effort
    return effort * _clipped_sine(stage.time, hz, rng.uniform(0.0, 2.0 * np.pi), 0.8)


def _on_off_tests(stage: _Stage) -> Iterator[CandidateMotion]:
    for with_motor in stage.motors:
        rng = np.random.default_rng((7, with_motor))
        motor = _motor_with_duties(stage, rng.uniform(0.3, 0.8) / stage.slowness, with_motor, rng)
        found = _sequence(stage, motor, rng)
        if found is not None:
            valves, shown = found
            text = f"{int((np.diff(valves, axis=1) > 0).sum())} pulses"
            if with_motor:
                text += f", motor {np.abs(motor).max():.3g} {stage.unit}"
            yield stage.made(text, ("motion-discrete", motor, valves), shown)


def _sequence(
    stage: _Stage, motor: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray] | None:
    """Pulses that keep the arm off its stops, and what the sensors then show; None if not found.

    Of several sequences the one that stays off longest is kept until shortly before it does not,
    and drawn anew from there.
    """
    kept, rows = np.zeros((stage.valves, stage.rows)), 0
    for _ in range(20):
        drawn = [_pulses(stage, kept, rows, rng) for _ in range(_DRAWS)]
        shown = stage.shown([("motion-discrete", motor, valves) for valves in drawn])
        swing = stage.swing(shown)
        best = int(np.argmax(swing))
        if swing[best] > _SWING:
            return drawn[best], shown[best]
        near = stage.near_stop(shown)
        until = np.where(near.any(axis=1), near.argmax(axis=1), stage.rows)
        longest = int(np.argmax(until))
        back = round(_REDRAW_S * stage.slowness / stage.row_s)
        kept, rows = drawn[longest], max(int(until[longest]) - back, 0)
        if until[longest] == stage.rows:  # it hardly moves
            kept, rows = np.zeros((stage.valves, stage.rows)), 0
    return None


def _pulses(stage: _Stage, kept: FloatArray, rows: int, rng: np.random.Generator) -> FloatArray:
    """The first rows of a sequence (valves, n), then pulses of one valve and the other in turn."""
    valves = np.array(kept)
    valves[:, rows:] = 0.0
    # As long as a row is for a reference rig, of which the pauses and pulses are.
    row_s = stage.row_s / stage.slowness
    at, valve = rows + round(rng.uniform(*_PAUSE_S) / row_s), int(rng.integers(stage.valves))
    while at < stage.rows:
        length = max(round(float(np.exp(rng.uniform(*np.log(_PULSE_S)))) / row_s), 1)
        valves[valve, at : at + length] = 1.0
        # The other valve over part of it: both chambers under pressure.
        if stage.valves > 1 and rng.random() < 0.2:
            late = at + round(rng.uniform(0.3, 0.9) * length)
            valves[1 - valve, late : late + length] = 1.0
        at += length + round(rng.uniform(*_PAUSE_S) / row_s)
        valve = (valve + 1) % stage.valves if rng.random() < 0.8 else valve
    return valves


__all__ = [
    "TRAVEL_USED",
    "CandidateMotion",
    "candidate_motions",
    "inputs_of_commands",
    "leaves_travel",
    "row_period",
    "usual_duration",
]
