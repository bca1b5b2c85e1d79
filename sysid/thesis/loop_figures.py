"""The counterparts of the thesis' figures of closed loops, as small multiples."""

from __future__ import annotations

import numpy as np

from sysid.blocks.figures import SMALL_PANEL, Figure, Line, Mark, Panel, Role, Scale
from sysid.blocks.numbers import number
from sysid.blocks.sections import FigureGroup
from sysid.blocks.titles import capital
from sysid.controllers.cases import ClosedLoopRun
from sysid.thesis.computed import ThesisTable
from sysid.thesis.figures import FigureSet, Runs, ThesisFigure
from sysid.types import FloatArray

# Colours of loops by name; the first two are for others.
_ROLES: dict[str, Role] = {"Backstepping": "model", "DVMPC": "second", "PVA": "third"}
_PAIR: tuple[Role, Role] = ("model", "second")
_TIME = Scale("Time", "s")


def figure_groups(part: FigureSet, runs: Runs) -> tuple[FigureGroup, ...]:
    """The figures of a set, four in a group."""
    made = [_figure(figure, f"{part.id}-{i}", runs) for i, figure in enumerate(part.figures)]
    groups = [tuple(made[i : i + 4]) for i in range(0, len(made), 4)]
    return tuple(FigureGroup("", group) for group in groups)


_Chosen = list[tuple[str, ClosedLoopRun]]


def _figure(figure: ThesisFigure, place: str, runs: Runs) -> Figure:
    chosen = [(name, runs[loop]) for name, loop in figure.loops]
    title = capital(figure.title)
    if figure.number:
        title = f"{figure.number} {title}"
    draw = {
        "tracking": _tracking,
        "errors": _errors,
        "pressures": _pressures,
        "payload": _payload,
    }[figure.view]
    panels, said = draw(chosen)
    size = SMALL_PANEL if figure.view in ("errors", "payload") else (2.62, 3.5)
    return Figure(f"fig-{place}", title, said, panels, size=size)


_Drawn = tuple[tuple[Panel, ...], str]


def _tracking(chosen: _Chosen) -> _Drawn:
    """Position over its reference, the error, and both pressures, of one loop."""
    run = chosen[0][1]
    top = (
        _line(run, run.reference[:, 0], "measured", width=2.0),
        _line(run, run.position, "model"),
    )
    panels = (
        Panel(_TIME, Scale(unit="rad"), top, 1.15),
        Panel(_TIME, Scale("Error", "mrad"), (_line(run, 1e3 * _error(run), "second"),), 0.9),
        Panel(_TIME, Scale(unit="kPa"), _both(run, is_named=False), 0.8),
    )
    return panels, _said(chosen)


def _errors(chosen: _Chosen) -> _Drawn:
    marks = tuple(
        _line(run, 1e3 * _error(run), _ROLES.get(name) or _PAIR[i], capital(name))
        for i, (name, run) in enumerate(chosen)
    )
    return (Panel(_TIME, Scale("Error", "mrad"), marks, legend="above"),), _said(chosen)


def _pressures(chosen: _Chosen) -> _Drawn:
    run = chosen[0][1]
    means = f"{number(1e-3 * float(run.pressure_a.mean()))} kPa in chamber A"
    said = f"Means: {means}, {number(1e-3 * float(run.pressure_b.mean()))} kPa in chamber B."
    panel = Panel(_TIME, Scale("Pressure", "kPa"), _both(run, is_named=True), legend="above")
    return (panel,), said


def _payload(chosen: _Chosen) -> _Drawn:
    marks = tuple(
        _line(run, run.payload_kg, role, name.capitalize())
        for (name, run), role in zip(chosen, _PAIR, strict=False)
    )
    ends = ", ".join(f"{name} {number(float(run.payload_kg[-1]))} kg" for name, run in chosen)
    panel = Panel(_TIME, Scale("Payload", "kg"), marks, legend="above")
    return (panel,), f"Estimates at the end: {ends}."


def horizon_figure(found: ThesisTable, id: str) -> Figure:
    """Figure 5.4: RMSE over the horizon (Table 5.3.1), ours and printed."""
    horizons = np.array([int(row.label) for row in found.rows])
    marks: list[Mark] = []
    for i, (column, role) in enumerate(zip(found.columns, _PAIR, strict=True)):
        ours, theirs = (
            1e3 * np.array([getattr(row, name)[i] for row in found.rows])
            for name in ("ours", "printed")
        )
        title = column.title.capitalize()
        marks.append(
            Line(horizons, theirs, role, f"{title}, printed", "dashed", marker="o", alpha=0.45)
        )
        marks.append(Line(horizons, ours, role, f"{title}, ours", marker="o"))
    x = Scale("Horizon", "ticks of 1 ms")
    panel = Panel(x, Scale("RMSE", "mrad", kind="log"), tuple(marks))
    best = [horizons[int(np.nanargmin([row.ours[i] for row in found.rows]))] for i in (0, 1)]
    said = f"Best of these: {best[0]} ticks on trajectory 1, {best[1]} on trajectory 4."
    title, heading = "RMSE of DVMPC by its horizon", "5.4 RMSE of DVMPC by its horizon"
    return Figure(id, title, said, (panel,), heading, size=(8.6, 3.0))


def _error(run: ClosedLoopRun) -> FloatArray:
    return np.asarray(run.reference[:, 0] - run.position)


def _said(chosen: _Chosen) -> str:
    parts = (
        f"{name + ': ' if name else ''}RMSE {number(1e3 * run.metrics.rmse)} mrad, largest error "
        f"{number(1e3 * run.metrics.mae)} mrad"
        for name, run in chosen
    )
    return "; ".join(parts) + "."


def _both(run: ClosedLoopRun, is_named: bool) -> tuple[Line, ...]:
    sides = zip("AB", (run.pressure_a, run.pressure_b), _PAIR, strict=True)
    return tuple(
        _line(run, 1e-3 * pressure, role, f"Chamber {side}" if is_named else "", 0.75)
        for side, pressure, role in sides
    )


def _line(
    run: ClosedLoopRun, values: FloatArray, role: Role, label: str = "", width: float = 0.9
) -> Line:
    return Line(run.time, values, role, label, width=width)


__all__ = ["figure_groups", "horizon_figure"]
