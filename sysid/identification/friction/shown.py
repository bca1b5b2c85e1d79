"""Friction as it is shown: parameters, constant-effort tests against the fit, breakaway."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sysid.blocks.figures import Band, Figure, Intervals, Line, Mark, Panel, Points, Role, Scale
from sysid.blocks.numbers import MISSING, estimate_cells, fixed, number, span, unit
from sysid.blocks.sections import Block, FigureGroup, Fold, Lines, Notes, Section
from sysid.blocks.tables import NotedCell, TableColumn, estimate_table, table
from sysid.blocks.titles import capital
from sysid.estimation.linear import Estimate
from sysid.identification.friction.cross_check import SLIDING_FIRST, disagreement
from sysid.io.motion import MotionUnits
from sysid.parameters import Bundle, Friction
from sysid.parameters.friction import TestUse
from sysid.parameters.table import in_words
from sysid.recording.friction_kind import SLIDING, STATIC
from sysid.types import FloatArray

_DIRECTIONS: tuple[tuple[float, str, str, Role], ...] = (
    (1.0, "forwards", "o", "model"),
    (-1.0, "backwards", "s", "second"),
)


def friction_section(bundle: Bundle) -> Section:
    """The section on a bundle's friction."""
    friction, units, parts = bundle.friction, bundle.units, bundle.parameters.parts()
    assert friction is not None
    blocks: list[Block] = [parts["friction"].shown("Friction parameters")]
    blocks += _combinations(friction)
    if (check := parts.get("friction.cross_check")) is not None:
        caption = "Cross-check: the same parameters from general motion"
        blocks.append(Fold(caption, (check.shown(caption),)))
        # Of a refined or extended bundle the numbers are no longer those of the tests alone.
        blocks += [] if bundle.refinement or bundle.effects else _disagreements(friction)
    speed = speed_figure(friction)
    law = "friction over speed, one point per constant-effort test, with these parameters' law"
    if speed is not None and any(isinstance(mark, Band) for mark in speed.panels[0].marks):
        law += " and the 95 % band in which it lies (single tests scatter beyond it)"
    figures = {
        law: speed,
        "breakaway by starting position, with each position's mean and its 95 % interval": (
            breakaway_figure(friction)
        ),
    }
    drawn = {said: figure for said, figure in figures.items() if figure is not None}
    if drawn:
        caption = "; ".join(drawn)
        whole = f"{capital(caption)}."
        blocks.append(FigureGroup(whole, tuple(drawn.values())))
    blocks += _position_table(friction, units)
    blocks += _excluded(friction)
    source = {
        "friction-sliding": "Coulomb and viscous friction come from the constant-effort tests.",
        "friction-motion": "Coulomb and viscous friction come from general motion, by inverse "
        "dynamics.",
    }.get(str(friction.source))
    if check is not None and friction.source == "friction-sliding":
        source = f"{SLIDING_FIRST}."
    intro: tuple[str, ...] = (source,) if source else ()
    if bundle.refinement:
        intro += ("They were estimated again with the motion tests (Refinement on motion).",)
    return Section("friction", "Friction", intro, tuple(blocks))


def _disagreements(friction: Friction) -> list[Block]:
    """What the two kinds of tests do not agree on, under their table."""
    checked = friction.cross_check if isinstance(friction.cross_check, dict) else {}
    own = friction.estimates()
    lines = [disagreement(key, own[key], check) for key, check in checked.items() if key in own]
    found = tuple(line for line in lines if line is not None)
    return [Notes(found)] if found else []


def _combinations(friction: Friction) -> list[Block]:
    """The sums that the tests identify, with the test that would separate their parts."""
    sums = friction.sums()
    if not sums:
        return []
    caption = "Identified only together, and the test that would separate the parts"
    found: dict[str, Estimate] = {
        NotedCell(in_words(name), name): row.estimate for name, row in sums.items()
    }
    tests = (TableColumn("Test", "text"), [row.test for row in sums.values()])
    return [estimate_table(caption, found, "page", named=TableColumn("Sum", "text"), more=tests)]


def _position_table(friction: Friction, units: MotionUnits) -> list[Block]:
    rows = [
        (fixed(row.position, 3), str(row.tests or MISSING), *estimate_cells(row.static)[:3])
        for row in friction.positions()
    ]
    if not rows:
        return []
    effort_unit = unit(units.effort)
    columns = (f"Position ({units.position})", "Tests", "Mean", "Std. error", "95 % interval")
    caption = f"Static friction by position ({effort_unit})"
    return [Fold(caption, (table(caption, columns, rows),))]


def _excluded(friction: Friction) -> list[Block]:
    lines = [f"{t.kind}, test {t.test}: {t.reason or ''}" for t in friction.tests() if not t.used]
    if not lines:
        return []
    return [Lines(tuple(lines), f"{len(lines)} tests excluded")]


# --- figures ---------------------------------------------------------------------------


def speed_figure(friction: Friction) -> Figure | None:
    """Friction over speed: a point for each constant-effort test, the law and its 95 % band.

    None without such tests, or where these do not identify Coulomb friction.
    """
    trials, coulomb = friction.used(SLIDING), friction.coulomb
    if not trials or coulomb is None or not coulomb.identified:
        return None
    units, effort_unit = friction.units, unit(friction.units.effort)
    speed, effort = _readings(trials, "speed"), np.abs(_readings(trials, "friction"))
    law = (coulomb, friction.viscous, friction.offset)
    values = [e.value if e is not None and e.identified else 0.0 for e in law]
    grid = np.linspace(0.0, 1.06 * float(np.abs(speed).max()), 60)
    marks: list[Mark] = []
    for way, name, marker, role in _DIRECTIONS:
        rows = np.sign(speed) == way
        if not rows.any():
            continue
        line = values[0] + values[1] * grid + way * values[2]
        if (half := _half_width(friction, grid, way)) is not None:
            marks.append(Band(grid, line - half, line + half, role))
        marks.append(Line(grid, line, role))
        named = tuple(_named(t) for t, own in zip(trials, rows, strict=True) if own)
        marks.append(Points(np.abs(speed[rows]), effort[rows], role, name, marker, tests=named))
    description = (
        f"Friction of {len(trials)} constant-effort tests, "
        f"{span(float(effort.min()), float(effort.max()))} {effort_unit}, at speeds from "
        f"{span(float(np.abs(speed).min()), float(np.abs(speed).max()))} "
        f"{units.speed}. The fitted line starts at {number(values[0])} {effort_unit} and rises "
        f"by {number(values[1])} {effort_unit} per {units.speed}."
    )
    y = Scale(f"Friction {units.word}", effort_unit)
    panel = Panel(Scale("Speed", units.speed), y, tuple(marks))
    return Figure("fig-sliding", "Friction over speed", description, (panel,))


def breakaway_figure(friction: Friction) -> Figure | None:
    """Breakaway over the starting position, with each position's mean; None without such tests."""
    trials, units = friction.used(STATIC), friction.units
    if not trials:
        return None
    effort_unit = unit(units.effort)
    place, way = _readings(trials, "position"), _readings(trials, "direction")
    effort = np.abs(_readings(trials, "breakaway"))
    marks: list[Mark] = [
        Points(
            place[way == direction],
            effort[way == direction],
            role,
            name,
            marker,
            tests=tuple(_named(t) for t, w in zip(trials, way, strict=True) if w == direction),
        )
        for direction, name, marker, role in _DIRECTIONS
        if np.any(way == direction)
    ]
    means = friction.positions()
    if means:
        rows = [(m.position, m.static.value, *m.static.interval) for m in means]
        x, y, low, high = np.array(rows, dtype=float).T
        marks.append(Intervals(x, y, low, high, marker="_"))
    description = (
        f"Breakaway {units.word} of {len(trials)} ramps from "
        f"{len(means)} positions, between "
        f"{number(float(effort.min()))} and {number(float(effort.max()))} {effort_unit}."
    )
    x = Scale("Starting position", units.position, margin=0.12)
    y = Scale(f"Breakaway {units.word}", effort_unit, margin=0.15)
    panel = Panel(x, y, tuple(marks), legend="above")
    return Figure("fig-static", "Breakaway by position", description, (panel,))


def parameters_figure(estimates: Mapping[str, Estimate]) -> Figure:
    """The identified parameters' 95 % intervals side by side, as shares of their values.

    Their units differ: each value is in its name.
    """
    known = {name: e for name, e in estimates.items() if e.identified and e.value != 0.0}
    rows = [
        (i, 0.0, *sorted(100.0 * (end / e.value - 1.0) for end in e.interval))
        for i, e in enumerate(known.values())
    ]
    ticks = tuple(
        (float(i), f"{name}\n{estimate_cells(e)[0]} {unit(e.unit)}")
        for i, (name, e) in enumerate(known.items())
    )
    marks = (Intervals(*np.array(rows, dtype=float).reshape(-1, 4).T),)
    panel = Panel(Scale(ticks=ticks), Scale("95 % interval", "% of the value"), marks)
    return Figure("fig-friction", "Friction parameters", "", (panel,))


def _named(test: TestUse) -> tuple[str, str]:
    """The kind and the label of a test."""
    return test.kind, test.test


def _readings(trials: Sequence[TestUse], name: str) -> FloatArray:
    """A value read from each test, (n,); NaN where there is none."""
    return np.array([t.reading(name) for t in trials], dtype=float)


def _half_width(friction: Friction, speed: FloatArray, way: float) -> FloatArray | None:
    """Half of the law's 95 % band at each speed (n,), by the errors of its parameters.

    In standard errors it is as wide as the interval of Coulomb friction. None where the
    correlation of the errors is not known.
    """
    one = np.ones_like(speed)
    slopes = {"coulomb": one, "viscous": speed, "offset": way * one}
    law = {name: friction.parameter(name) for name in slopes}
    known = {name: e for name, e in law.items() if e is not None and e.identified}
    if friction.correlation is None or "coulomb" not in known or not known["coulomb"].std > 0.0:
        return None
    coulomb = known["coulomb"]
    width = (coulomb.interval[1] - coulomb.interval[0]) / (2.0 * coulomb.std)
    covariance = friction.covariance([friction.units.key(name) for name in known])
    columns = np.column_stack([slopes[name] for name in known])
    variance = np.einsum("ij,jk,ik->i", columns, covariance, columns)
    half = width * np.sqrt(np.maximum(variance, 0.0))
    return np.asarray(half) if np.isfinite(half).all() else None


__all__ = ["breakaway_figure", "friction_section", "parameters_figure", "speed_figure"]
