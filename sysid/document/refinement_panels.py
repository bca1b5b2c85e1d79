"""The refinement's figures: movement of the parameters, correlation of their errors, profiles.

Names of parameters come from a file: they are drawn without unusual characters.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.blocks.figures import Picture
from sysid.blocks.numbers import number, unit
from sysid.document import svg
from sysid.document.svg import COLOUR
from sysid.estimation.linear import LEVEL, t_quantile
from sysid.parameters.base import read_number
from sysid.parameters.refinement import ProfileRecord, RefinedValue

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEAST_WRITTEN = 0.5
"""Correlations of this size and above are written into their cells."""
_WIDTH = svg.PANEL[0]
_ROW = 0.32  # inches
_FRAME = 0.83  # inches above and below the rows
_LEFT = 0.16  # inches: rows carry their names inside
_CELL_PT = 6.4
_MOST_NUMBERED = 16
# Movements beyond this are drawn on an axis that is stretched about 0.
_LARGE = 12.0
_NAME = re.compile(r"[^A-Za-z0-9 ._+-]")
_LONGEST_NAME = 40


def movement(values: Sequence[RefinedValue]) -> Picture:
    """Each parameter's movement and its interval after, in its standard errors before."""
    count = len(values)
    size = (_WIDTH, _FRAME + _ROW * count)
    figure, (ax,) = svg.panels("From bench to motion", (1.0,), size, left=_LEFT)
    ax.set_ylim(-count + 0.5, 0.62)
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    ax.grid(False, axis="y")
    limit = t_quantile(math.inf, LEVEL)
    ax.axvspan(-limit, limit, color=COLOUR["band"], alpha=0.25, linewidth=0)
    ax.axvline(0.0, color=COLOUR["muted"], linewidth=0.7)
    reach = limit
    for place, value in enumerate(values):
        moved, half = _moved(value)
        name = f"{place + 1}  {_drawable(value.name)}"
        y = -place - 0.16
        if moved is None:
            name += " (no error before)"
        else:
            role = "second" if value.informed_by_motion else "muted"
            ax.plot([moved - half, moved + half], [y, y], color=COLOUR[role], linewidth=1.6)
            ax.plot(moved, y, "D", color=COLOUR[role], markersize=4.0)
            reach = max(reach, abs(moved) + half)
        across = ax.get_yaxis_transform()
        ax.text(0.005, -place + 0.24, name, fontsize=7.4, transform=across, va="center", zorder=4)
    if reach > _LARGE:
        _stretch(ax, reach)
    ax.set_xlim(-1.12 * reach, 1.12 * reach)
    ax.set_xlabel("Movement (standard errors before)")
    told = "; ".join(f"{v.name} {number(_moved(v)[0], 2)}" for v in values)
    description = (
        f"Movement in standard errors of the value before: {told}. Blue: informed by the motion "
        "tests; grey: by the bench tests alone."
    )
    title = "Movement of each parameter from bench to motion"
    return svg.to_figure(figure, "fig-refinement-movement", title, description)


def _moved(value: RefinedValue) -> tuple[float | None, float]:
    """Movement, and half of the 95 % interval after, in standard errors before."""
    moved, std = read_number(value.movement), read_number(value.before_std)
    if moved is None or not std:
        return None, 0.0
    half = t_quantile(math.inf, LEVEL) * value.after.std / std
    return moved, half if math.isfinite(half) else 0.0


def _stretch(ax: Axes, reach: float) -> None:
    """An x axis that is linear near 0 and logarithmic far from it."""
    ax.set_xscale("asinh", linear_width=3.0)
    decades = range(int(np.floor(np.log10(reach))) + 1)
    sizes = [1.0, *(f * 10.0**d for d in decades[1:] for f in (1.0, 3.0))]
    sizes = [3.0, *(s for s in sizes[1:] if s <= 1.05 * reach)]
    ticks = [*(-s for s in reversed(sizes)), 0.0, *sizes]
    ax.set_xticks(ticks, [number(t, 1) for t in ticks])
    ax.minorticks_off()


def correlation(values: Sequence[RefinedValue], matrix: Sequence[Sequence[float]]) -> Picture:
    """The correlation matrix: blue positive, orange negative, the stronger the darker."""
    count = len(values)
    size = (_WIDTH, _FRAME + _ROW * count)
    figure, (ax,) = svg.panels("Correlation of the errors", (1.0,), size, left=0.3)
    ax.grid(False)
    for i, row in enumerate(matrix):
        for j, value in enumerate(row):
            _cell(ax, i, j, value, count <= _MOST_NUMBERED)
    ax.set_xlim(0.5, count + 0.5)
    ax.set_ylim(count + 0.5, 0.5)
    places = list(range(1, count + 1, 1 + count // 24))
    ax.set_xticks(places, [str(p) for p in places])
    ax.set_yticks(places, [str(p) for p in places])
    ax.tick_params(length=0)
    for spine in ax.spines.values():
        spine.set_visible(False)
    ax.set_xlabel("Parameter (number in the table)")
    pairs = sorted(
        ((abs(matrix[i][j]), i, j) for i in range(count) for j in range(i)), reverse=True
    )
    told = "; ".join(
        f"{values[j].name} and {values[i].name} {number(float(matrix[i][j]), 2)}"
        for _, i, j in pairs[:5]
    )
    description = f"Blue: positive, orange: negative. The strongest correlations: {told}."
    title = "Correlation of the parameters' errors"
    return svg.to_figure(figure, "fig-refinement-correlation", title, description)


def _cell(ax: Axes, i: int, j: int, value: float, written: bool) -> None:
    from matplotlib.patches import Rectangle

    role = "second" if value > 0.0 else "model"
    colour = COLOUR["measured"] if i == j else COLOUR[role]
    strength = 0.35 if i == j else 0.85 * min(abs(value), 1.0)
    corner = (j + 1 - 0.47, i + 1 - 0.47)
    ax.add_patch(Rectangle(corner, 0.94, 0.94, color=COLOUR["grid"], alpha=0.5, linewidth=0))
    ax.add_patch(Rectangle(corner, 0.94, 0.94, color=colour, alpha=strength, linewidth=0))
    if written and i != j and abs(value) >= LEAST_WRITTEN:
        ax.text(j + 1, i + 1, number(value, 1 if abs(value) < 0.95 else 2), ha="center",
                va="center", fontsize=_CELL_PT)  # fmt: skip


def profile(place: int, value: RefinedValue, found: ProfileRecord) -> Picture:
    """The rise over a parameter's values, the 95 % line, and the standard error's parabola."""
    name = _drawable(value.name)
    x, rise = np.array(found.values, dtype=float), np.array(found.rise, dtype=float)
    scale, prefix = _readable_scale(float(np.max(np.abs(x))))
    figure, ax = svg.panel(name)
    line = t_quantile(math.inf, LEVEL) ** 2
    low, high = (read_number(limit) for limit in found.interval)
    ends = (x[0] if low is None else low, x[-1] if high is None else high)
    ax.axvspan(ends[0] * scale, ends[1] * scale, color=COLOUR["band"], alpha=0.25, linewidth=0)
    ax.axhline(line, color=COLOUR["muted"], linewidth=0.9)
    best, std = value.after.value, value.after.std
    if math.isfinite(std) and std > 0.0:
        fine = np.linspace(x[0], x[-1], 121)
        ax.plot(fine * scale, ((fine - best) / std) ** 2, color=COLOUR["model"],
                linestyle=(0, (5, 1.5)), label="standard error")  # fmt: skip
    ax.plot(x * scale, rise, "o-", color=COLOUR["second"], markersize=3.5, label="profile")
    ax.set_ylim(0.0, 1.25 * max(float(rise.max()), line))
    ax.set_xlabel(f"Value ({prefix}{unit(value.after.unit)})".replace(" ()", ""))
    ax.set_ylabel("Rise of the cost")
    svg.legend(ax, loc="upper center", ncols=2)
    shown = [number(limit, 5) for limit in (low, high)]
    description = (
        f"{value.name}: 95 % interval by profile likelihood from {shown[0]} to {shown[1]} "
        f"{unit(value.after.unit)}, best value {number(best, 5)}."
    )
    title = f"Profile of {value.name}"
    return svg.to_figure(figure, f"fig-refinement-profile-{place}", title, description)


def _readable_scale(size: float) -> tuple[float, str]:
    """A power of ten for small numbers, and how the axis says so."""
    if size <= 0.0 or 1e-2 <= size < 1e5:
        return 1.0, ""
    exponent = 3 * math.floor(math.log10(size) / 3.0)
    power = number(10.0**exponent, 1).removeprefix("1 × ")
    return 10.0**-exponent, f"{power} "


def _drawable(name: str) -> str:
    return _NAME.sub("?", name)[:_LONGEST_NAME]


__all__ = ["LEAST_WRITTEN", "correlation", "movement", "profile"]
