"""The page of a closed loop: how the reference was followed, and what it took."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sysid.blocks.figures import Picture
from sysid.blocks.numbers import number
from sysid.blocks.sections import Block, FigureGroup, Section
from sysid.blocks.tables import Table, table
from sysid.controllers.cases import PERIOD_S, ClosedLoopRun
from sysid.document import svg
from sysid.document.html import fill
from sysid.document.standing import section_or_why
from sysid.document.svg import COLOUR
from sysid.io.files import write_atomic
from sysid.io.rig import Rig
from sysid.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WIDE = (8.6, 2.5)
_TALL = (8.6, 3.9)
_BUCKETS = 400
_MEAN_S = 0.05
_CLOSE_UP_S = (2.0, 2.2)
_TIME = "Time (s)"


@dataclass(frozen=True)
class ControlPage:
    """What the page shows: `metrics` in rad by name, `facts` for its head by term."""

    run: ClosedLoopRun
    rig: Rig
    title: str
    metrics: Mapping[str, float]
    facts: Mapping[str, str]
    notices: tuple[str, ...]
    has_valves: bool
    has_motor: bool


def write_control_page(path: Path, page: ControlPage) -> None:
    """Write the page, whole or not at all. Raises InputError where that is not possible."""
    write_atomic(path, control_page(page))


def control_page(page: ControlPage) -> str:
    """One self-contained HTML page."""
    run = page.run
    with svg.styled():
        parts = (
            section_or_why("tracking", "Tracking", lambda: _tracking(page)),
            section_or_why("pressures", "Chambers", lambda: _chambers(page)),
            section_or_why("commands", "Commands", lambda: _commands(page)),
        )
        sections = list(filter(None, parts))
    faults = [f"Fault: {line}." for line in run.faults]
    notes = faults + [f"Notice: {line}." for line in page.notices]
    return fill(
        "control.html",
        name=page.rig.name,
        subject="closed loop, simulated",
        facts=list(page.facts.items()),
        level="fair" if faults else "good",
        sentence=f"{page.title}. {_fault_sentence(len(faults))}",
        metrics=_metrics(page.metrics),
        notes=notes,
        sections=sections,
    )


def _fault_sentence(count: int) -> str:
    if not count:
        return "The loop reports no fault."
    return f"The loop reports {count} fault{'s' if count > 1 else ''}."


def _metrics(metrics: Mapping[str, float]) -> Table:
    rows = [(n, number(1e3 * v)) for n, v in metrics.items() if not math.isnan(v)]
    return table("Errors of the true position", ("Metric", "mrad"), rows)


# --- sections ------------------------------------------------------------------------------


def _tracking(page: ControlPage) -> Section:
    run = page.run
    figure, (top, bottom) = svg.panels("Position and error", (1.7, 1.0), _TALL)
    error = 1e3 * (run.reference[:, 0] - run.position)
    lines = {"Reference": run.reference[:, 0], "Position": run.position}
    styles = ((COLOUR["measured"], "-"), (COLOUR["model"], "-"))
    for (name, values), (colour, dashes) in zip(lines.items(), styles, strict=True):
        _line(top, run.time, values, label=name, color=colour, linestyle=dashes)
    top.lines[0].set_linewidth(2.4)
    _line(bottom, run.time, error, color=COLOUR["second"])
    bottom.axhline(0.0, color=COLOUR["muted"], linewidth=0.6)
    top.set_ylabel("Position (rad)")
    bottom.set_ylabel("Error (mrad)")
    bottom.set_xlabel(_TIME)
    _legend(top)
    said = f"Largest error {number(float(np.max(np.abs(error))))} mrad."
    shown = svg.to_figure(figure, "fig-position", "Position and reference", said)
    intro = ("Position as it is on the plant, over the reference; the error is the difference.",)
    group = FigureGroup("Reference, position, and the error between them.", (shown,))
    blocks: list[Block] = [group]
    if np.isfinite(run.payload_kg).all() and np.ptp(run.payload_kg) > 0.0:
        blocks.append(FigureGroup("What the controller takes the payload for.", (_payload(page),)))
    return Section("tracking", "Tracking", intro, tuple(blocks))


def _payload(page: ControlPage) -> Picture:
    run, inertia = page.run, page.rig.inertia
    carried = inertia.payload_mass_kg if inertia else 0.0

    def draw(ax: Axes) -> None:
        ax.axhline(carried, color=COLOUR["measured"], linewidth=2.4, label="On the plant")
        _line(ax, run.time, run.payload_kg, color=COLOUR["model"], label="Estimated")
        ax.set_ylabel("Payload (kg)")

    said = f"Estimate at the end {number(float(run.payload_kg[-1]))} kg of {number(carried)} kg."
    return _figure("fig-payload", "Payload", said, draw)


def _chambers(page: ControlPage) -> Section:
    run, air = page.run, page.rig.air

    def draw(ax: Axes) -> None:
        if air is not None:
            for level in (air.atmospheric_pressure_pa, air.supply_pressure_pa):
                ax.axhline(1e-3 * level, color=COLOUR["muted"], linewidth=0.6)
        for side, values, role in (
            ("A", run.measured_a, "model"),
            ("B", run.measured_b, "second"),
        ):
            _line(ax, run.time, 1e-3 * values, color=COLOUR[role], label=f"Chamber {side}")
        ax.set_ylabel("Pressure (kPa)")

    spans = " and ".join(
        f"{number(1e-3 * float(p.min()))} kPa to {number(1e-3 * float(p.max()))} kPa"
        for p in (run.measured_a, run.measured_b)
    )
    shown = _figure("fig-pressures", "Pressures", f"Chambers A and B: {spans}.", draw)
    caption = "Pressures as the sensors show them; thin lines: the atmosphere and the supply."
    return Section("pressures", "Chambers", (), (FigureGroup(caption, (shown,)),))


def _commands(page: ControlPage) -> Section:
    figures: list[Picture] = []
    if page.has_valves:
        figures += [_valves(page), _close_up(page)]
    if page.has_motor:
        figures.append(_motor(page))
    word = "duties" if page.run.is_duty else "on/off commands"
    intro = (
        f"The valves' {word} are shown as means over {1e3 * _MEAN_S:.0f} ms, "
        "and a close-up as they were given."
        if page.has_valves
        else "The valves stay off.",
    )
    group = FigureGroup("Commands to the actuators.", tuple(figures))
    return Section("commands", "Commands", intro, (group,))


def _valves(page: ControlPage) -> Picture:
    run = page.run
    rows = max(round(_MEAN_S / PERIOD_S), 1)

    def draw(ax: Axes) -> None:
        time = _means(run.time, rows)
        ax.plot(time, _means(run.command_a, rows), color=COLOUR["model"], label="Valve A")
        ax.plot(time, _means(run.command_b, rows), color=COLOUR["second"], label="Valve B")
        ax.set_ylabel("Mean command (-)")
        ax.set_ylim(-0.03, 1.03)

    said = (
        f"Mean over the run: valve A {number(float(run.command_a.mean()))}, "
        f"valve B {number(float(run.command_b.mean()))}."
    )
    return _figure("fig-valves", "Valves, mean over 50 ms", said, draw)


def _close_up(page: ControlPage) -> Picture:
    run = page.run
    start, end = _CLOSE_UP_S if run.time[-1] >= _CLOSE_UP_S[1] else (0.0, 0.2)
    rows = (run.time >= start) & (run.time <= end)

    def draw(ax: Axes) -> None:
        for side, command, role, base in (
            ("A", run.command_a, "model", 1.4),
            ("B", run.command_b, "second", 0.0),
        ):
            values = base + command[rows]
            ax.step(run.time[rows], values, where="post", color=COLOUR[role], label=f"Valve {side}")
        ax.set_yticks([0.0, 1.0, 1.4, 2.4], ["B: 0", "B: 1", "A: 0", "A: 1"])
        ax.set_ylim(-0.15, 2.55)

    changes = int(np.sum(np.diff(run.command_a[rows]) != 0.0))
    said = f"Valve A's command changes {changes} times in {1e3 * (end - start):.0f} ms."
    return _figure("fig-close-up", f"Valves from {start:g} s to {end:g} s", said, draw)


def _motor(page: ControlPage) -> Picture:
    run, limit = page.run, page.rig.max_effort

    def draw(ax: Axes) -> None:
        if limit is not None and np.max(np.abs(run.motor)) > 0.8 * limit:
            for level in (-limit, limit):
                ax.axhline(level, color=COLOUR["muted"], linewidth=0.6)
        _line(ax, run.time, run.motor, color=COLOUR["third"])
        ax.set_ylabel("Motor (N·m)")

    said = f"Largest torque {number(float(np.max(np.abs(run.motor))))} N·m."
    return _figure("fig-motor", "Motor", said, draw)


# --- figures -------------------------------------------------------------------------------


def _figure(id: str, title: str, said: str, draw: Callable[[Axes], None]) -> Picture:
    figure, ax = svg.panel(title, _WIDE)
    draw(ax)
    ax.set_xlabel(_TIME)
    _legend(ax)
    return svg.to_figure(figure, id, title, said)


def _legend(ax: Axes) -> None:
    """Above the panel, on the right: nothing is hidden."""
    svg.legend(ax, loc="lower right", bbox_to_anchor=(1.0, 0.99), ncols=3)


def _line(ax: Axes, time: FloatArray, values: FloatArray, **style: object) -> None:
    rows = svg.thinned(time, [values], _BUCKETS)
    ax.plot(time[rows], values[rows], **style)  # type: ignore[arg-type]


def _means(values: FloatArray, rows: int) -> FloatArray:
    """Means of stretches of `rows` samples; what does not fill one is left out."""
    whole = len(values) // rows * rows
    return np.asarray(values[:whole].reshape(-1, rows).mean(axis=1))


__all__ = ["ControlPage", "control_page", "write_control_page"]
