"""The refinement's figures: movement of the parameters, correlation of their errors, profiles.

Names of parameters come from a file: they are drawn without unusual characters.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.blocks.figures import (
    PANEL,
    Figure,
    Line,
    Mark,
    Panel,
    Points,
    Role,
    Rule,
    Scale,
    Span,
    Squares,
    Words,
    height_of_rows,
    rows_figure,
)
from sysid.blocks.numbers import number, unit
from sysid.estimation.linear import LEVEL, t_quantile
from sysid.parameters.base import read_number
from sysid.parameters.refinement import ProfileRecord, RefinedValue
from sysid.parameters.titles import short_title, title_of
from sysid.types import BoolArray, FloatArray

LEAST_WRITTEN = 0.5
"""Correlations of this size and above are written into their cells."""
# Height of a parameter's row, inches.
_PARAMETER_ROW = 0.32
_NAME = re.compile(r"[^A-Za-z0-9 ._+,:;()'/\N{HORIZONTAL ELLIPSIS}-]")


def movement(values: Sequence[RefinedValue]) -> Figure:
    """Each parameter's movement and its interval after, in its standard errors before."""
    count = len(values)
    limit = t_quantile(math.inf, LEVEL)
    marks: list[Mark] = [Span(-limit, limit, is_upright=True), Rule(0.0, is_upright=True)]
    reach = limit
    for place, value in enumerate(values):
        moved, half = _moved(value)
        name = f"{place + 1}  {_drawable(value.name)}"
        if moved is None:
            name += " (no error before)"
        else:
            role: Role = "second" if value.informed_by_motion else "muted"
            y = np.full(2, -place - 0.16)
            ends = np.array([moved - half, moved + half])
            marks.append(Line(ends, y, role, width=1.6))
            middle = np.array([moved])
            marks.append(Points(middle, y[:1], role, marker="D", size=4.0, is_filled=True))
            reach = max(reach, abs(moved) + half)
        marks.append(Words(0.0, -place + 0.24, name, is_at_edge=True))
    x = Scale("Movement", "standard errors before", (-1.12 * reach, 1.12 * reach))
    told = "; ".join(f"{title_of(v.name)} {number(_moved(v)[0], 2)}" for v in values)
    description = (
        f"Movement in standard errors of the value before: {told}. Blue: informed by the motion "
        "tests; grey: by the bench tests alone."
    )
    title = "Movement of each parameter from bench to motion"
    return rows_figure(
        "fig-refinement-movement", title, description, "From bench to motion",
        _stretched(x, reach), marks, count, _PARAMETER_ROW,
    )  # fmt: skip


def _moved(value: RefinedValue) -> tuple[float | None, float]:
    """Movement, and half of the 95 % interval after, in standard errors before."""
    moved, std = read_number(value.movement), read_number(value.before_std)
    if moved is None or not std:
        return None, 0.0
    half = t_quantile(math.inf, LEVEL) * value.after.std / std
    return moved, half if math.isfinite(half) else 0.0


def _stretched(axis: Scale, reach: float) -> Scale:
    """An axis that is linear near 0 and logarithmic far from it, where it reaches far."""
    # Larger movements are drawn on an axis that is stretched about 0.
    if reach <= 12.0:
        return axis
    decades = range(int(np.floor(np.log10(reach))) + 1)
    sizes = [3.0, *(f * 10.0**d for d in decades[1:] for f in (1.0, 3.0))]
    sizes = [s for s in sizes if s <= max(1.05 * reach, 3.0)]
    places = [*(-s for s in reversed(sizes)), 0.0, *sizes]
    ticks = tuple((t, number(t, 1)) for t in places)
    return replace(axis, kind="asinh", linear_width=3.0, ticks=ticks)


def correlation(values: Sequence[RefinedValue], matrix: Sequence[Sequence[float]]) -> Figure:
    """The correlation matrix: blue positive, orange negative, the stronger the darker."""
    count = len(values)
    found = np.array(matrix, dtype=float)
    places = np.arange(1.0, count + 1.0)
    columns, rows = np.meshgrid(places, places)
    own = np.eye(count, dtype=bool)

    def squares(chosen: BoolArray, role: Role, strength: FloatArray) -> Squares:
        return Squares(columns[chosen], rows[chosen], strength[chosen], role)

    strength = 0.85 * np.minimum(np.abs(found), 1.0)
    marks: list[Mark] = [
        squares(own, "measured", np.full(found.shape, 0.35)),
        squares(~own & (found > 0.0), "second", strength),
        squares(~own & (found <= 0.0), "model", strength),
    ]
    if count <= 16:
        for i, j in np.argwhere(~own & (np.abs(found) >= LEAST_WRITTEN)):
            size = float(found[i, j])
            # Without its zero, as it is usual: a square has room for three signs.
            text = number(size, 1 if abs(size) < 0.95 else 2).replace("0.", ".")
            marks.append(Words(j + 1.0, i + 1.0, text, is_small=True))
    ticks = tuple((float(p), str(p)) for p in range(1, count + 1, 1 + count // 24))
    x = Scale("Parameter", "number in the table", (0.5, count + 0.5), ticks=ticks)
    y = Scale(limits=(count + 0.5, 0.5), ticks=ticks)
    pairs = sorted(
        ((abs(matrix[i][j]), i, j) for i in range(count) for j in range(i)), reverse=True
    )
    told = "; ".join(
        f"{title_of(values[j].name)} and {title_of(values[i].name)} "
        f"{number(float(matrix[i][j]), 2)}"
        for _, i, j in pairs[:5]
    )
    description = f"Blue: positive, orange: negative. The strongest correlations: {told}."
    return Figure(
        "fig-refinement-correlation",
        "Correlation of the parameters' errors",
        description,
        (Panel(x, y, tuple(marks), legend="none"),),
        "Correlation of the errors",
        (PANEL[0], height_of_rows(count, _PARAMETER_ROW)),
    )


def profile(place: int, value: RefinedValue, found: ProfileRecord) -> Figure:
    """The rise over a parameter's values, the 95 % line, and the standard error's parabola."""
    x, rise = np.array(found.values, dtype=float), np.array(found.rise, dtype=float)
    scale, prefix = _readable_scale(float(np.max(np.abs(x))))
    line = t_quantile(math.inf, LEVEL) ** 2
    low, high = (read_number(limit) for limit in found.interval)
    ends = (x[0] if low is None else low, x[-1] if high is None else high)
    marks: list[Mark] = [Span(ends[0] * scale, ends[1] * scale, is_upright=True), Rule(line)]
    best, std = value.after.value, value.after.std
    if math.isfinite(std) and std > 0.0:
        fine = np.linspace(x[0], x[-1], 121)
        parabola = ((fine - best) / std) ** 2
        marks.append(Line(fine * scale, parabola, "model", "standard error", "dashed"))
    marks.append(Line(x * scale, rise, "second", "profile", marker="o"))
    y = Scale("Rise of the cost", limits=(0.0, 1.25 * max(float(rise.max()), line)))
    shown = [number(limit, 5) for limit in (low, high)]
    description = (
        f"{title_of(value.name)}: 95 % interval by profile likelihood from {shown[0]} to "
        f"{shown[1]} {unit(value.after.unit)}, best value {number(best, 5)}."
    )
    axis = Scale("Value", f"{prefix}{unit(value.after.unit)}".strip())
    return Figure(
        f"fig-refinement-profile-{place}",
        f"Profile of {title_of(value.name)}",
        description,
        (Panel(axis, y, tuple(marks)),),
        _drawable(value.name),
    )


def _readable_scale(size: float) -> tuple[float, str]:
    """A power of ten for small numbers, and how the axis says so."""
    if size <= 0.0 or 1e-2 <= size < 1e5:
        return 1.0, ""
    exponent = 3 * math.floor(math.log10(size) / 3.0)
    power = number(10.0**exponent, 1).removeprefix("1 × ")
    return 10.0**-exponent, f"{power} "


def _drawable(name: str) -> str:
    """A number's title without unusual characters."""
    return _NAME.sub("?", short_title(name))


__all__ = ["LEAST_WRITTEN", "correlation", "movement", "profile"]
