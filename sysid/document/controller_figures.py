"""The counterparts of the thesis' figures of closed loops, as small multiples."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sysid.blocks.figures import Picture
from sysid.blocks.numbers import number
from sysid.blocks.sections import FigureGroup
from sysid.controllers.cases import ClosedLoopRun
from sysid.document import svg
from sysid.document.svg import COLOUR
from sysid.thesis import ThesisTable
from sysid.thesis.figures import FigureSet, Runs, ThesisFigure
from sysid.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_TRACKING = (2.62, 3.5)
_PAIR = (2.62, 2.3)
_WIDE = (8.6, 3.0)
# Buckets of a line: about two pixels each.
_BUCKETS = 130
# A loop's colour by its name; the first two for others.
_ROLES = {"Backstepping": "model", "DVMPC": "second", "PVA": "third"}
_OTHERS = ("model", "second")
_TIME = "Time (s)"


def figure_groups(part: FigureSet, runs: Runs) -> tuple[FigureGroup, ...]:
    """The figures of a set, four in a group. To be called within `svg.styled()`."""
    made = [_figure(figure, f"{part.id}-{i}", runs) for i, figure in enumerate(part.figures)]
    groups = [tuple(made[i : i + 4]) for i in range(0, len(made), 4)]
    return tuple(FigureGroup("", group) for group in groups)


def _figure(figure: ThesisFigure, place: str, runs: Runs) -> Picture:
    chosen = [(name, runs[loop]) for name, loop in figure.loops]
    title = figure.title[:1].upper() + figure.title[1:]
    if figure.number:
        title = f"{figure.number} {title}"
    draw = {
        "tracking": _tracking,
        "errors": _errors,
        "pressures": _pressures,
        "payload": _payload,
    }[figure.view]
    return draw(title, f"fig-{place}", chosen)


_Chosen = list[tuple[str, ClosedLoopRun]]


def _tracking(title: str, id: str, chosen: _Chosen) -> Picture:
    """Position over its reference, the error, and both pressures, of one loop."""
    run = chosen[0][1]
    made, (top, middle, bottom) = svg.panels(title, (1.15, 0.9, 0.8), _TRACKING)
    reference = run.reference[:, 0]
    _line(top, run, reference, "measured", linewidth=2.0)
    _line(top, run, run.position, "model")
    _line(middle, run, 1e3 * _error(run), "second")
    for pressure, role in ((run.pressure_a, "model"), (run.pressure_b, "second")):
        _line(bottom, run, 1e-3 * pressure, role, linewidth=0.7)
    top.set_ylabel("rad")
    middle.set_ylabel("Error (mrad)")
    bottom.set_ylabel("kPa")
    bottom.set_xlabel(_TIME)
    return svg.to_figure(made, id, title, _said(chosen))


def _errors(title: str, id: str, chosen: _Chosen) -> Picture:
    made, ax = svg.panel(title, _PAIR)
    for i, (name, run) in enumerate(chosen):
        role = _ROLES.get(name) or _OTHERS[i]
        _line(ax, run, 1e3 * _error(run), role, label=name[:1].upper() + name[1:])
    ax.set_ylabel("Error (mrad)")
    ax.set_xlabel(_TIME)
    _above(ax)
    return svg.to_figure(made, id, title, _said(chosen))


def _pressures(title: str, id: str, chosen: _Chosen) -> Picture:
    run = chosen[0][1]
    made, ax = svg.panel(title, _TRACKING)
    for side, pressure, role in (("A", run.pressure_a, "model"), ("B", run.pressure_b, "second")):
        _line(ax, run, 1e-3 * pressure, role, label=f"Chamber {side}", linewidth=0.8)
    ax.set_ylabel("Pressure (kPa)")
    ax.set_xlabel(_TIME)
    _above(ax)
    means = f"{number(1e-3 * float(run.pressure_a.mean()))} kPa in chamber A"
    said = f"Means: {means}, {number(1e-3 * float(run.pressure_b.mean()))} kPa in chamber B."
    return svg.to_figure(made, id, title, said)


def _payload(title: str, id: str, chosen: _Chosen) -> Picture:
    made, ax = svg.panel(title, _PAIR)
    for (name, run), role in zip(chosen, _OTHERS, strict=False):
        _line(ax, run, run.payload_kg, role, label=name.capitalize())
    ax.set_ylabel("Payload (kg)")
    ax.set_xlabel(_TIME)
    _above(ax)
    ends = ", ".join(f"{name} {number(float(run.payload_kg[-1]))} kg" for name, run in chosen)
    return svg.to_figure(made, id, title, f"Estimates at the end: {ends}.")


def horizon_figure(found: ThesisTable, id: str) -> Picture:
    """Figure 5.4: RMSE over the horizon (Table 5.3.1), ours and printed."""
    made, ax = svg.panel("5.4 RMSE of DVMPC by its horizon", _WIDE)
    horizons = [int(row.label) for row in found.rows]
    for i, (column, role) in enumerate(zip(found.columns, ("model", "second"), strict=True)):
        ours, theirs = (
            [1e3 * getattr(row, name)[i] for row in found.rows] for name in ("ours", "printed")
        )
        ax.plot(horizons, theirs, "o--", color=COLOUR[role], alpha=0.45, markersize=3.5)
        ax.plot(horizons, ours, "o-", color=COLOUR[role], markersize=3.5)
        ax.lines[-2].set_label(f"{column.title.capitalize()}, printed")
        ax.lines[-1].set_label(f"{column.title.capitalize()}, ours")
    ax.set_yscale("log")
    ax.yaxis.set_major_formatter(lambda value, _: number(value, 1))
    ax.set_ylabel("RMSE (mrad)")
    ax.set_xlabel("Horizon (ticks of 1 ms)")
    svg.legend(ax, loc="upper right", ncols=2)
    best = [horizons[int(np.nanargmin([row.ours[i] for row in found.rows]))] for i in (0, 1)]
    said = f"Best of these: {best[0]} ticks on trajectory 1, {best[1]} on trajectory 4."
    return svg.to_figure(made, id, "RMSE of DVMPC by its horizon", said)


def _error(run: ClosedLoopRun) -> FloatArray:
    return np.asarray(run.reference[:, 0] - run.position)


def _said(chosen: _Chosen) -> str:
    parts = (
        f"{name + ': ' if name else ''}RMSE {number(1e3 * run.metrics.rmse)} mrad, largest error "
        f"{number(1e3 * run.metrics.mae)} mrad"
        for name, run in chosen
    )
    return "; ".join(parts) + "."


def _line(ax: Axes, run: ClosedLoopRun, values: FloatArray, role: str, **style: object) -> None:
    rows = svg.thinned(run.time, [values], _BUCKETS)
    options = {"linewidth": 0.9, **style}
    ax.plot(run.time[rows], values[rows], color=COLOUR[role], **options)  # type: ignore[arg-type]


def _above(ax: Axes) -> None:
    """A legend on top of the curves' panel, in room that is made for it."""
    low, high = ax.get_ylim()
    ax.set_ylim(low, high + 0.22 * (high - low))
    svg.legend(ax, loc="upper left", ncols=2, columnspacing=0.9, handlelength=1.2)


__all__ = ["figure_groups", "horizon_figure"]
