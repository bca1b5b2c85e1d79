"""A closed loop as it is shown: how the reference was followed, and what it took."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.blocks.figures import Figure, Line, Mark, Panel, Role, Rule, Scale
from sysid.blocks.numbers import number
from sysid.blocks.sections import FigureGroup, Section
from sysid.controllers.cases import PERIOD_S, ClosedLoopRun
from sysid.controllers.modes import Mode
from sysid.io.rig import Rig
from sysid.types import FloatArray

_MEAN_S = 0.05
_CLOSE_UP_S = (2.0, 2.2)
_TIME = Scale("Time", "s")
_SIDES: tuple[tuple[str, Role], ...] = (("A", "model"), ("B", "second"))


@dataclass(frozen=True)
class ShownLoop:
    """The figures of a closed loop on `rig`, and the sections that hold them."""

    run: ClosedLoopRun
    rig: Rig
    mode: Mode

    def panels(self) -> tuple[Panel, ...]:
        """Position over its reference, the error, pressures, commands."""
        run = self.run
        marks = [*_pair(run.time, (run.command_a, run.command_b), "valve")]
        marks.append(Line(run.time, run.motor, "third", "motor, N·m"))
        commands = Panel(_TIME, Scale("Command"), tuple(marks))
        return (*self.position().panels, *self.pressures().panels, commands)

    # --- sections --------------------------------------------------------------------------

    def tracking(self) -> Section:
        """How the reference was followed."""
        run = self.run
        intro = ("True position over the reference; the error is the difference.",)
        caption = "Reference, position, and the error between them."
        groups = [FigureGroup(caption, (self.position(),))]
        if np.isfinite(run.payload_kg).all() and np.ptp(run.payload_kg) > 0.0:
            caption = "The payload that the controller assumes."
            groups.append(FigureGroup(caption, (self.payload(),)))
        return Section("tracking", "Tracking", intro, tuple(groups))

    def chambers(self) -> Section:
        """The pressures."""
        caption = "Pressures as the sensors show them; thin lines: the atmosphere and the supply."
        group = FigureGroup(caption, (self.pressures(),))
        return Section("pressures", "Chambers", (), (group,))

    def commands(self) -> Section:
        """The commands to the actuators."""
        figures: list[Figure] = []
        if self.mode.uses_valves:
            figures += [self.valves(), self.close_up()]
        if self.mode.uses_motor:
            figures.append(self.motor())
        word = "duties" if self.run.is_duty else "on/off commands"
        intro = (
            f"The valves' {word} are shown as means over {1e3 * _MEAN_S:.0f} ms, "
            "and a close-up as they were given."
            if self.mode.uses_valves
            else "The valves stay off.",
        )
        group = FigureGroup("Commands to the actuators.", tuple(figures))
        return Section("commands", "Commands", intro, (group,))

    # --- figures ---------------------------------------------------------------------------

    def position(self) -> Figure:
        """Position over its reference, and the error."""
        run = self.run
        reference = run.reference[:, 0]
        error = 1e3 * (reference - run.position)
        top = (
            Line(run.time, reference, "measured", "Reference", width=2.4),
            Line(run.time, run.position, "model", "Position"),
        )
        panels = (
            Panel(_TIME, Scale("Position", "rad"), top, 1.7, "over"),
            Panel(_TIME, Scale("Error", "mrad"), (Line(run.time, error, "second"), Rule(0.0))),
        )
        said = f"Largest error {number(float(np.max(np.abs(error))))} mrad."
        title, heading = "Position and reference", "Position and error"
        return Figure("fig-position", title, said, panels, heading, (8.6, 3.9))

    def payload(self) -> Figure:
        """The payload that the controller estimates."""
        run, inertia = self.run, self.rig.inertia
        carried = inertia.payload_mass_kg if inertia else 0.0
        end = number(float(run.payload_kg[-1]))
        said = f"Estimate at the end {end} kg of {number(carried)} kg."
        marks = (
            Rule(carried, "measured", "On the plant", width=2.4),
            Line(run.time, run.payload_kg, "model", "Estimated"),
        )
        return _wide("fig-payload", "Payload", said, Scale("Payload", "kg"), marks)

    def pressures(self) -> Figure:
        """Both pressures as the sensors show them."""
        run, air = self.run, self.rig.air
        levels = (air.atmospheric_pressure_pa, air.supply_pressure_pa) if air is not None else ()
        found = 1e-3 * run.measured_a, 1e-3 * run.measured_b
        marks = [*(Rule(1e-3 * level) for level in levels), *_pair(run.time, found, "Chamber")]
        spans = " and ".join(
            f"{number(float(p.min()))} kPa to {number(float(p.max()))} kPa" for p in found
        )
        said = f"Chambers A and B: {spans}."
        return _wide("fig-pressures", "Pressures", said, Scale("Pressure", "kPa"), marks)

    def valves(self) -> Figure:
        """Means of the valves' commands."""
        run, rows = self.run, max(round(_MEAN_S / PERIOD_S), 1)
        means = _means(run.command_a, rows), _means(run.command_b, rows)
        marks = _pair(_means(run.time, rows), means, "Valve")
        said = (
            f"Mean over the run: valve A {number(float(run.command_a.mean()))}, "
            f"valve B {number(float(run.command_b.mean()))}."
        )
        y = Scale("Mean command", "-", (-0.03, 1.03))
        return _wide("fig-valves", "Valves, mean over 50 ms", said, y, marks)

    def close_up(self) -> Figure:
        """The valves' commands as they were given, over a short time."""
        run = self.run
        start, end = _CLOSE_UP_S if run.time[-1] >= _CLOSE_UP_S[1] else (0.0, 0.2)
        rows = (run.time >= start) & (run.time <= end)
        bases = zip(_SIDES, (run.command_a, run.command_b), (1.4, 0.0), strict=True)
        marks = [
            Line(run.time[rows], base + command[rows], role, f"Valve {side}", is_step=True)
            for (side, role), command, base in bases
        ]
        ticks = ((0.0, "B: 0"), (1.0, "B: 1"), (1.4, "A: 0"), (2.4, "A: 1"))
        changes = int(np.sum(np.diff(run.command_a[rows]) != 0.0))
        said = f"Valve A's command changes {changes} times in {1e3 * (end - start):.0f} ms."
        title = f"Valves from {start:g} s to {end:g} s"
        return _wide("fig-close-up", title, said, Scale(limits=(-0.15, 2.55), ticks=ticks), marks)

    def motor(self) -> Figure:
        """The motor's torque; its limit where it comes near."""
        run, limit = self.run, self.rig.max_effort
        largest = float(np.max(np.abs(run.motor)))
        marks: list[Mark] = [Line(run.time, run.motor, "third")]
        if limit is not None and largest > 0.8 * limit:
            marks += [Rule(-limit), Rule(limit)]
        said = f"Largest torque {number(largest)} N·m."
        return _wide("fig-motor", "Motor", said, Scale("Motor", "N·m"), marks)


def _wide(id: str, title: str, said: str, y: Scale, marks: Sequence[Mark]) -> Figure:
    panel = Panel(_TIME, y, tuple(marks), legend="over")
    return Figure(id, title, said, (panel,), size=(8.6, 2.5))


def _pair(time: FloatArray, values: Sequence[FloatArray], of: str) -> list[Mark]:
    """A line for each side."""
    return [
        Line(time, one, role, f"{of} {side}")
        for (side, role), one in zip(_SIDES, values, strict=True)
    ]


def _means(values: FloatArray, rows: int) -> FloatArray:
    """Means of stretches of `rows` samples; an incomplete one is dropped."""
    whole = len(values) // rows * rows
    return np.asarray(values[:whole].reshape(-1, rows).mean(axis=1))


__all__ = ["ShownLoop"]
