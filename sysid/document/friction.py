"""The friction section: parameters, constant-effort tests against the fit, breakaway."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.blocks.figures import Picture
from sysid.blocks.numbers import MISSING, estimate_cells, fixed, number, unit
from sysid.blocks.sections import Block, FigureGroup, Lines, Section
from sysid.blocks.tables import Table, table
from sysid.document import svg
from sysid.document.svg import COLOUR
from sysid.errors import NotIdentifiedError
from sysid.estimation.jackknife import jackknife
from sysid.estimation.linear import t_quantile
from sysid.io.motion import MotionUnits
from sysid.parameters import Bundle, Friction
from sysid.parameters.friction import StaticAtPosition, TestUse
from sysid.parameters.table import ParameterTable
from sysid.types import FloatArray

if TYPE_CHECKING:
    from sysid.friction import SlidingPoints


_PARAMETER_COLUMNS = ("Parameter", "Value", "Std. error", "95 % interval", "Unit", "Key")
_DIRECTIONS = ((1.0, "forwards", "o", "model"), (-1.0, "backwards", "s", "second"))


def friction_section(bundle: Bundle) -> Section:
    """From a bundle that holds friction."""
    friction, units, parts = bundle.friction, bundle.units, bundle.parameters.parts()
    assert friction is not None
    blocks: list[Block] = [parameters_table("Friction parameters", parts["friction"])]
    blocks += _combinations(friction)
    if (check := parts.get("friction.cross_check")) is not None:
        caption = "Cross-check: the same parameters from general motion"
        blocks.append(parameters_table(caption, check))
    figures = _figures(friction, units)
    if figures:
        caption = (
            "Friction over speed, one point per constant-effort test, with the fit to these tests "
            "alone and its 95 % band (jackknife over the tests); breakaway by starting position, "
            "with each position's mean and its 95 % interval."
        )
        blocks.append(FigureGroup(caption, tuple(figures)))
    blocks += _position_table(friction, units)
    blocks += _left_out(friction)
    source = {
        "friction-sliding": "Coulomb and viscous friction come from the constant-effort tests.",
        "friction-motion": "Coulomb and viscous friction come from general motion, by inverse "
        "dynamics.",
    }.get(str(friction.source))
    intro = (source,) if source else ()
    return Section("friction", "Friction", intro, tuple(blocks))


def parameters_table(caption: str, part: ParameterTable) -> Table:
    """One row per parameter of a part of the bundle, with its interval and its key there."""
    rows = [(row.title, *estimate_cells(row.estimate), row.key) for row in part.rows]
    return table(caption, _PARAMETER_COLUMNS, rows, text=(4, 5), code=(5,))


def _combinations(friction: Friction) -> list[Block]:
    """The sums that the tests identify, with the test that would separate their parts."""
    rows = [
        (name, *estimate_cells(row.estimate), row.test) for name, row in friction.sums().items()
    ]
    if not rows:
        return []
    caption = "Identified only together, and the test that would separate the parts"
    columns = ("Sum", "Value", "Std. error", "95 % interval", "Unit", "Test")
    return [table(caption, columns, rows, text=(0, 4, 5), code=(0,))]


def _position_table(friction: Friction, units: MotionUnits) -> list[Block]:
    rows = [
        (fixed(row.position, 3), str(row.tests or MISSING), *estimate_cells(row.static)[:3])
        for row in friction.positions()
    ]
    if not rows:
        return []
    effort_unit = unit(units.effort)
    columns = (f"Position ({units.position})", "Tests", "Mean", "Std. error", "95 % interval")
    return [table(f"Static friction by position ({effort_unit})", columns, rows)]


def _left_out(friction: Friction) -> list[Block]:
    lines = [f"{t.kind}, test {t.test}: {t.reason or ''}" for t in friction.tests() if not t.used]
    if not lines:
        return []
    return [Lines(tuple(lines), f"{len(lines)} tests left out")]


# --- figures ---------------------------------------------------------------------------


def _figures(friction: Friction, units: MotionUnits) -> list[Picture]:
    figures = []
    sliding, static = friction.used("friction-sliding"), friction.used("friction-static")
    if sliding and friction.coulomb is not None and friction.coulomb.identified:
        figures.append(_sliding_figure(sliding, friction, units))
    if static:
        figures.append(_static_figure(static, friction, units))
    return figures


def _sliding_figure(trials: Sequence[TestUse], friction: Friction, units: MotionUnits) -> Picture:
    speed, effort = _readings(trials, "speed"), _readings(trials, "friction")
    effort_unit = unit(units.effort)
    law = (friction.coulomb, friction.viscous, friction.offset)
    values = [e.value if e is not None and e.identified else 0.0 for e in law]
    figure, ax = svg.panel("Friction over speed")
    grid = np.linspace(0.0, 1.06 * float(np.abs(speed).max()), 60)
    spread = _scatter(trials, units)
    for way, name, marker, role in _DIRECTIONS:
        rows = np.sign(speed) == way
        if not rows.any():
            continue
        line = values[0] + values[1] * grid + way * values[2]
        if spread is not None:
            half = _half_width(spread, grid, way, len(trials))
            ax.fill_between(
                grid, line - half, line + half, color=COLOUR[role], alpha=0.16, linewidth=0
            )
        ax.plot(grid, line, color=COLOUR[role])
        ax.plot(
            np.abs(speed[rows]), np.abs(effort[rows]), marker, color=COLOUR[role],
            markersize=3.5, markerfacecolor="none", label=name,
        )  # fmt: skip
    ax.set_xlabel(f"Speed ({units.speed})")
    ax.set_ylabel(f"Friction {units.word} ({effort_unit})")
    svg.legend(ax, loc="upper left")
    description = (
        f"Friction of {len(trials)} constant-effort tests, {number(float(np.abs(effort).min()))} "
        f"to {number(float(np.abs(effort).max()))} {effort_unit}, at speeds from "
        f"{number(float(np.abs(speed).min()))} to {number(float(np.abs(speed).max()))} "
        f"{units.speed}. The fitted line starts at {number(values[0])} {effort_unit} "
        f"and rises by {number(values[1])} {effort_unit} per {units.speed}."
    )
    return svg.to_figure(figure, "fig-sliding", "Friction over speed", description)


def _readings(trials: Sequence[TestUse], name: str) -> FloatArray:
    """What was read from each test, (n,); NaN where it was not."""
    return np.array([t.reading(name) for t in trials], dtype=float)


def _points(trials: Sequence[TestUse]) -> SlidingPoints:
    """The bundle's trials as the regression takes them (`sysid.friction`)."""
    from sysid.friction import SlidingPoints

    table = {k: _readings(trials, k) for k in ("motor", "gravity", "cylinder")}
    set_effort = table["motor"] - table["gravity"]
    applied = set_effort + table["cylinder"]
    if float(np.ptp(set_effort)) < 0.3 * float(np.ptp(applied)):
        set_effort = applied
    speed, effort = _readings(trials, "speed"), _readings(trials, "friction")
    labels = tuple(t.test for t in trials)
    return SlidingPoints(labels, np.sign(speed), set_effort, effort, speed)


def _scatter(trials: Sequence[TestUse], units: MotionUnits) -> FloatArray | None:
    """Covariance (3, 3) of Coulomb, viscous, offset: the fit again without each test."""
    from sysid.friction import fit_sliding

    def without(i: int) -> FloatArray:
        fit = fit_sliding(_points([*trials[:i], *trials[i + 1 :]]), units)
        offset = fit.offset.value if fit.offset.identified else 0.0
        return np.array([fit.coulomb.value, fit.viscous.value, offset])

    try:
        found = jackknife(without, len(trials))
    except NotIdentifiedError:
        return None
    return found if len(trials) > len(found) and np.isfinite(found).all() else None


def _half_width(spread: FloatArray, speed: FloatArray, way: float, tests: int) -> FloatArray:
    """Half of the 95 % band of the fitted friction at each speed, (n,)."""
    columns = np.column_stack([np.ones_like(speed), speed, np.full_like(speed, way)])
    variance = np.einsum("ij,jk,ik->i", columns, spread, columns)
    half = t_quantile(tests - 3) * np.sqrt(np.maximum(variance, 0.0))
    return np.asarray(half, dtype=float)


def _static_figure(trials: Sequence[TestUse], friction: Friction, units: MotionUnits) -> Picture:
    place, way = _readings(trials, "position"), _readings(trials, "direction")
    effort, effort_unit = np.abs(_readings(trials, "breakaway")), unit(units.effort)
    figure, ax = svg.panel("Breakaway by position")
    for direction, name, marker, role in _DIRECTIONS:
        rows = way == direction
        if rows.any():
            ax.plot(
                place[rows], effort[rows], marker, color=COLOUR[role], markersize=3.5,
                markerfacecolor="none", label=name,
            )  # fmt: skip
    for row in friction.positions():
        _mean_bar(ax, row)
    span = max(float(np.ptp(place)), 1e-9)
    ax.set_xlim(float(place.min()) - 0.12 * span, float(place.max()) + 0.12 * span)
    ax.set_xlabel(f"Starting position ({units.position})")
    ax.set_ylabel(f"Breakaway {units.word} ({effort_unit})")
    ax.margins(y=0.25)
    svg.legend(ax, loc="upper right", ncols=2)
    description = (
        f"Breakaway {units.word} of {len(trials)} ramps from "
        f"{len(friction.positions())} positions, between "
        f"{number(float(effort.min()))} and {number(float(effort.max()))} {effort_unit}."
    )
    return svg.to_figure(figure, "fig-static", "Breakaway by position", description)


def _mean_bar(ax: Any, row: StaticAtPosition) -> None:
    value, (low, high) = row.static.value, row.static.interval
    known = math.isfinite(low) and math.isfinite(high)
    bars = [[value - low], [high - value]] if known else [[0.0], [0.0]]
    if math.isfinite(value):
        ax.errorbar(
            [row.position], [value], yerr=bars, fmt="_", color=COLOUR["ink"], capsize=3,
            markersize=9, elinewidth=1.0,
        )  # fmt: skip


__all__ = ["friction_section", "parameters_table"]
