"""Figures as they are described: panels with a common x axis, and the marks in them.

A figure says what it shows, not how: each renderer draws it (`sysid.blocks.drawing` with
matplotlib, `sysid.pipeline.pages.interactive` with Bokeh). Values are in the units of the axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sysid.types import FloatArray

Role = Literal["ink", "muted", "grid", "measured", "model", "second", "third", "fourth", "band"]
"""What a mark stands for; a page's scheme gives each role its colour."""
Dash = Literal["solid", "dashed", "dotted", "dash-dot"]

PANEL = (3.5, 2.6)
"""Width and height, inches: three in a row on a desktop, one on a phone."""
TALL_PANEL = (3.5, 3.35)
SMALL_PANEL = (2.62, 2.3)
"""Four in a row."""


@dataclass(frozen=True)
class Scale:
    """A quantity on an axis, with its unit. `limits` None: those of the data.

    `ticks`: places with their names, instead of round numbers. `linear_width` belongs to "asinh",
    an axis that is linear within it and logarithmic far beyond. `margin`: what stays free beyond
    the data, as a share of their range.
    """

    name: str = ""
    unit: str = ""
    limits: tuple[float | None, float | None] = (None, None)
    kind: Literal["linear", "log", "asinh"] = "linear"
    linear_width: float = 1.0
    ticks: tuple[tuple[float, str], ...] | None = None
    margin: float | None = None
    is_date: bool = False

    @property
    def label(self) -> str:
        """Name and unit."""
        return f"{self.name} ({self.unit})" if self.name and self.unit else (self.name or self.unit)


@dataclass(frozen=True, eq=False)
class Line:
    """A line through points (n,); `is_step`: each value holds until the next."""

    x: FloatArray
    y: FloatArray
    role: Role = "model"
    label: str = ""
    dash: Dash = "solid"
    width: float = 1.1
    marker: str = ""
    alpha: float = 1.0
    is_step: bool = False


@dataclass(frozen=True, eq=False)
class Points:
    """Single points (n,); `shades` (n,) of 0 to 1 colours each. `marker`: matplotlib's "o", "s",
    "D", "x", "_". `is_cloud`: so many that a page holds them as a bitmap. `tests`: the kind and the
    label of the test that each is of, where a page may show it."""

    x: FloatArray
    y: FloatArray
    role: Role = "measured"
    label: str = ""
    marker: str = "o"
    size: float = 3.5
    is_filled: bool = False
    alpha: float = 1.0
    is_cloud: bool = False
    shades: FloatArray | None = None
    tests: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, eq=False)
class Band:
    """The area between two lines, `low` and `high` (n,)."""

    x: FloatArray
    low: FloatArray
    high: FloatArray
    role: Role = "second"
    label: str = ""
    alpha: float = 0.2


@dataclass(frozen=True, eq=False)
class Intervals:
    """Points (n,) with an interval each: `low` and `high` are its ends, NaN where unknown."""

    x: FloatArray
    y: FloatArray
    low: FloatArray
    high: FloatArray
    role: Role = "ink"
    label: str = ""
    marker: str = "o"


@dataclass(frozen=True, eq=False)
class Bars:
    """Bars at `places` (n,) from `starts` (0 if None) to `ends` (n,); `is_across`: along x."""

    places: FloatArray
    ends: FloatArray
    role: Role = "model"
    label: str = ""
    thickness: float = 0.8
    starts: FloatArray | None = None
    is_across: bool = False


@dataclass(frozen=True)
class Rule:
    """A straight line through the whole panel at a value of y, or of x (`is_upright`)."""

    value: float
    role: Role = "muted"
    label: str = ""
    dash: Dash = "solid"
    width: float = 0.7
    is_upright: bool = False


@dataclass(frozen=True)
class Span:
    """A stripe through the whole panel between two values of y, or of x (`is_upright`)."""

    low: float
    high: float
    role: Role = "band"
    alpha: float = 0.25
    is_upright: bool = False


@dataclass(frozen=True, eq=False)
class ColourMap:
    """A map: `values` (len(y), len(x)) in `unit`, NaN if missing; colours end at `limits`.

    `is_signed`: the colours part at zero.
    """

    x: FloatArray
    y: FloatArray
    values: FloatArray
    limits: tuple[float, float]
    unit: str = ""
    is_signed: bool = False


@dataclass(frozen=True, eq=False)
class Squares:
    """The squares of a matrix, of side 1 about their places (n,); `strength` (n,) of 0 to 1 tints
    each."""

    x: FloatArray
    y: FloatArray
    strength: FloatArray
    role: Role = "second"


@dataclass(frozen=True)
class Words:
    """Text at a place; `is_at_edge`: at the panel's left edge, whatever x is."""

    x: float
    y: float
    text: str
    is_at_edge: bool = False
    is_small: bool = False


Mark = Line | Points | Band | Intervals | Bars | Rule | Span | ColourMap | Squares | Words


@dataclass(frozen=True, eq=False)
class Panel:
    """Marks over one pair of axes. `height` is relative to the other panels' of the figure.

    `legend`: "best" hides no data, "above" has a row of its own in the panel, "right" and "over"
    are outside.
    `has_names`: rows carry their names inside, so that the y axis is not drawn.
    """

    x: Scale
    y: Scale
    marks: tuple[Mark, ...]
    height: float = 1.0
    legend: Literal["best", "above", "right", "over", "none"] = "best"
    has_names: bool = False


@dataclass(frozen=True, eq=False)
class Figure:
    """Panels below one another that share their x axis.

    `title` names the figure, `description` puts it in words for those who do not see it, `heading`
    is in the figure (the title where it is empty). `id` is its own in a page, `size` its width
    and height in inches.
    """

    id: str
    title: str
    description: str
    panels: tuple[Panel, ...]
    heading: str = ""
    size: tuple[float, float] = PANEL


@dataclass(frozen=True)
class Picture:
    """A figure that is drawn: `svg` is safe markup."""

    id: str
    title: str
    description: str
    svg: str


def rows_figure(
    id: str,
    title: str,
    description: str,
    heading: str,
    x: Scale,
    marks: Sequence[Mark],
    count: int,
    row: float = 0.33,
) -> Figure:
    """A panel of `count` rows from the top down, at y = 0, -1, ..., each with its name in it.

    `row`: the height of one, inches.
    """
    y = Scale(limits=(-count + 0.5, 0.62))
    panel = Panel(x, y, tuple(marks), legend="none", has_names=True)
    size = (PANEL[0], height_of_rows(count, row))
    return Figure(id, title, description, (panel,), heading, size)


def height_of_rows(count: int, row: float) -> float:
    """Inches of a figure with so many rows, their heading and axis among them."""
    return 0.83 + row * count


def grouped_bars(
    names: Sequence[str], series: dict[str, Sequence[float]]
) -> tuple[tuple[Bars, ...], tuple[tuple[float, str], ...]]:
    """Bars side by side: a place for each name, a bar in it for each of the series; and ticks."""
    width = 0.8 / max(len(series), 1)
    roles: tuple[Role, ...] = ("model", "second", "third", "fourth", "measured", "band", "muted")
    places = np.arange(len(names), dtype=float)
    bars = tuple(
        Bars(
            places - 0.4 + (i + 0.5) * width,
            np.asarray(values, dtype=float),
            roles[i % len(roles)],
            label,
            width,
        )
        for i, (label, values) in enumerate(series.items())
    )
    return bars, tuple((float(i), name) for i, name in enumerate(names))


__all__ = [
    "PANEL",
    "SMALL_PANEL",
    "TALL_PANEL",
    "Band",
    "Bars",
    "ColourMap",
    "Dash",
    "Figure",
    "Intervals",
    "Line",
    "Mark",
    "Panel",
    "Picture",
    "Points",
    "Role",
    "Rule",
    "Scale",
    "Span",
    "Squares",
    "Words",
    "grouped_bars",
    "height_of_rows",
    "rows_figure",
]
