"""One test: commands in, the plant integrated, samples out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from datasets.generator.effects.simulate import Way, integrated, sensed
from datasets.generator.integrator import integrate
from datasets.generator.plant import POSITION, SHUT, FloatArray, Plant
from datasets.generator.rigs import GeneratedRig
from datasets.generator.sensors import measured
from datasets.generator.timing import (
    Edges,
    merged,
    movements,
    no_edges,
    of_two_valves,
    pwm_commands,
    switched_commands,
)

NO_BAND = (-np.inf, np.inf)


@dataclass(frozen=True)
class Commands:
    """What a test commands, each (n,): the motor (Nm or N) and either valves or duties."""

    motor: FloatArray
    valve_a: FloatArray | None = None
    valve_b: FloatArray | None = None
    duty_a: FloatArray | None = None
    duty_b: FloatArray | None = None
    log_motor: bool = True
    bleed: FloatArray | None = None  # of A's second valve, which empties it: on/off, or its duty

    def columns(self, rig: GeneratedRig) -> dict[str, FloatArray]:
        """The commanded columns under the log format's names."""
        names = ("valve_a", "valve_b", "duty_a", "duty_b")
        given = {name: getattr(self, name) for name in names}
        columns = {name: value for name, value in given.items() if value is not None}
        columns = {name: value for name, value in columns.items() if name[-1] in rig.sides}
        if rig.bleeds:
            columns = {f"{name}_fill": value for name, value in columns.items()}
            if self.bleed is not None:
                stem = "valve" if self.duty_a is None else "duty"
                columns[f"{stem}_a_bleed"] = self.bleed
        if self.log_motor and "motor" in rig.content:
            columns["motor_force_n" if rig.is_linear else "motor_torque_nm"] = self.motor
        return columns


@dataclass(frozen=True)
class Start:
    """How a test starts, at rest: position (rad or m), chamber pressures (Pa), valves."""

    position: float
    pressure_a: float
    pressure_b: float
    opened: tuple[int, int] = (0, 0)
    held: bool = False


@dataclass(frozen=True)
class GeneratedTest:
    """One `test` of a log: its columns, each (n,), `time_s` first, and its own truth."""

    label: str
    columns: dict[str, FloatArray]
    truth: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.columns["time_s"])


def at_atmosphere(rig: GeneratedRig, position: float) -> Start:
    """At rest with both chambers at the atmosphere's pressure."""
    return Start(position, rig.atmosphere, rig.atmosphere)


def simulated(
    rig: GeneratedRig,
    plant: Plant,
    commands: Commands,
    start: Start,
    band: tuple[float, float] = NO_BAND,
    tolerance: float = 1.0,
) -> FloatArray:
    """States at the rows, (m, 4), m <= n: the run ends after the first row outside `band`.

    `tolerance` scales the error allowed a step. With undeclared effects it scales the step itself,
    and the states are (m, 8): the columns of `effects.simulate.integrated` after the four states.
    """
    asked = _asked(rig, commands, start)
    initial = np.array([start.position, 0.0, start.pressure_a, start.pressure_b])
    motor = np.ascontiguousarray(commands.motor, dtype=np.float64)
    if rig.effects:
        rows, plant, knobs = integrated(
            rig, plant, motor, asked, initial, start.opened, start.held, band, tolerance, Way()
        )
        return sensed(rows, motor[: len(rows)], plant, knobs, rig.row_period)
    edges = [_movements(rig, asked[i], start.opened[i]) for i in (0, 1)]
    opened = start.opened
    if rig.bleeds:
        edges, opened = [of_two_valves(*edges), no_edges()], (SHUT, 0)
    time, valve, state = merged(*edges)
    states, reached = integrate(
        plant,
        rig.row_period,
        motor,
        time,
        valve,
        state,
        initial,
        np.array(opened, dtype=np.int64),
        start.held,
        np.array(band, dtype=np.float64),
        tolerance,
    )
    if reached == 0:
        raise RuntimeError("the integration needs too many steps: is the rig plausible?")
    return np.asarray(states[:reached])


def position_after(
    rig: GeneratedRig,
    plant: Plant,
    commands: Commands,
    start: Start,
    band: tuple[float, float],
    tolerance: float,
    way: Way,
) -> float | None:
    """Position before the commands' last row, or None: outside `band` by then.

    The `way` of a rig with effects, new for each start, spares the rows that the run before it had.
    """
    if rig.effects:
        motor = np.ascontiguousarray(commands.motor[:-1], dtype=np.float64)
        initial = np.array([start.position, 0.0, start.pressure_a, start.pressure_b])
        asked = _asked(rig, commands, start)
        rows, _, _ = integrated(
            rig, plant, motor, asked, initial, start.opened, start.held, band, tolerance, way
        )
        return float(way.states[POSITION]) if len(rows) == len(motor) else None
    states = simulated(rig, plant, commands, start, band, tolerance)
    return float(states[-1, POSITION]) if len(states) == len(commands.motor) else None


def _asked(rig: GeneratedRig, commands: Commands, start: Start) -> tuple[Edges, Edges]:
    """Both valves' command edges; of a chamber with two valves, of these two."""
    asked = (
        _command_edges(rig, commands.valve_a, commands.duty_a, start.opened[0]),
        _command_edges(rig, commands.valve_b, commands.duty_b, start.opened[1]),
    )
    if rig.bleeds:
        pulsed = commands.duty_a is not None
        levels, duties = (None, commands.bleed) if pulsed else (commands.bleed, None)
        asked = asked[0], _command_edges(rig, levels, duties, 0)
    return asked


def _command_edges(
    rig: GeneratedRig, valve: FloatArray | None, duty: FloatArray | None, initial: int
) -> Edges:
    if duty is not None:
        period = float(rig.content["pwm"]["period_s"])
        edges: Edges = pwm_commands(duty, rig.row_period, period, initial)
        return edges
    if valve is not None:
        return switched_commands(valve, rig.row_period)
    return no_edges()


def _movements(rig: GeneratedRig, commands: Edges, initial: int) -> Edges:
    delays = rig.content["valves"]
    on, off = float(delays["on_delay_s"]), float(delays["off_delay_s"])
    moved: Edges = movements(*commands, on, off, initial)
    return moved


def logged(
    label: str,
    rig: GeneratedRig,
    commands: Commands,
    states: FloatArray,
    noise_pa: float,
    rng: np.random.Generator,
    truth: dict[str, Any],
) -> GeneratedTest:
    """The test as its log will hold it."""
    n = len(states)
    time = np.round(np.arange(n) * rig.row_period, 9)
    columns = {"time_s": time}
    columns |= {name: value[:n] for name, value in commands.columns(rig).items()}
    columns |= measured(states, rig, noise_pa, rng)
    return GeneratedTest(label, columns, truth)
