"""Figures drawn with matplotlib: on the caller's axes, or on new ones.

Matplotlib is imported when used. A page's print form (`sysid.blocks.svg`) draws with the same
functions in different colours.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sysid.blocks import figures
from sysid.blocks.figures import Figure, Panel, Scale
from sysid.blocks.numbers import number
from sysid.blocks.plots import MOST_IN_LEGEND, some_axes
from sysid.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Of a legend above the data: a row's height and what is around all rows, inches, and how many
# letters fit into a row of a panel.
_LEGEND_ROW, _LEGEND_EDGE, _LEGEND_LETTERS = 0.15, 0.09, 40
# Inches of a letter of a legend, and how many letters a line's sample takes.
_LETTER, _SAMPLE = 0.074, 5
# A legend wider than this share of the axes hides data wherever it is.
_WIDE = 0.7
# A bitmap's colour cannot follow a page's scheme: one that works on light and dark.
_CLOUD = "#8a96a3"
_DASHES: Mapping[str, Any] = {
    "solid": "-",
    "dashed": (0, (5, 1.5)),
    "dotted": (0, (1.5, 1)),
    "dash-dot": (0, (6, 1.5, 1.5, 1.5)),
}
COLOURS: Mapping[str, str] = {
    "ink": "#1b2026",
    "muted": "#57616c",
    "grid": "#e4e8ec",
    "measured": "#7d8894",
    "model": "#d55e00",
    "second": "#0072b2",
    "third": "#009e73",
    "fourth": "#cc79a7",
    "band": "#56b4e9",
}
"""A colour for each role, on white."""


def plot(figure: Figure, axes: Axes | Iterable[Axes] | None = None) -> list[Axes]:
    """Draw each of a figure's panels on the axes given, else on new ones; returns the axes.

    Raises InputError where the number of axes is another than that of the panels.
    """
    return plot_panels(figure.panels, axes, figure.heading)


def plot_panels(
    panels: Sequence[Panel],
    axes: Axes | Iterable[Axes] | None = None,
    heading: str = "",
    share_x: bool = True,
) -> list[Axes]:
    """Draw panels as `plot` does; without `share_x` each has its own x axis."""
    found = some_axes(len(panels), axes, share_x)
    for ax, panel in zip(found, panels, strict=True):
        draw(ax, panel)
    for ax in found[:-1] if share_x else ():
        ax.set_xlabel("")
    if heading:
        found[0].set_title(heading)
    return found


def draw(
    ax: Axes,
    panel: Panel,
    colours: Mapping[str, str] = COLOURS,
    buckets: int | None = None,
) -> Any:
    """A panel's marks on axes, in a colour for each role; the map's colours, where it holds one.

    A line is drawn through at most two values a bucket (None: through all of them).
    """
    mapped = None
    for mark in panel.marks:
        made = _DRAWN[type(mark)](ax, mark, colours, buckets)
        mapped = made if isinstance(mark, figures.ColourMap) else mapped
    _scale(ax, "x", panel.x)
    _scale(ax, "y", panel.y)
    ax.set_xlabel(panel.x.label)
    ax.set_ylabel("" if panel.has_names else panel.y.label)
    if panel.has_names:
        ax.set_yticks([])
        ax.spines["left"].set_visible(False)
    _legend(ax, panel)
    return mapped


def _line(ax: Axes, mark: figures.Line, colours: Mapping[str, str], buckets: int | None) -> None:
    x, y = mark.x, mark.y
    if buckets is not None and not mark.is_step:
        rows = thinned(x, [y], buckets)
        x, y = x[rows], y[rows]
    ax.plot(
        x, y, color=colours[mark.role], linestyle=_DASHES[mark.dash], linewidth=mark.width,
        marker=mark.marker or None, markersize=3.0, alpha=mark.alpha, label=mark.label or None,
        drawstyle="steps-post" if mark.is_step else "default",
    )  # fmt: skip


def _points(ax: Axes, mark: figures.Points, colours: Mapping[str, str], _: int | None) -> None:
    label = mark.label or None
    if mark.shades is not None:
        ax.scatter(
            mark.x, mark.y, c=mark.shades, s=mark.size**2, vmin=0.0, vmax=1.0, linewidth=0,
            rasterized=mark.is_cloud, label=label,
        )  # fmt: skip
        return
    is_drawn = mark.marker in ("x", "_")
    colour = _CLOUD if mark.is_cloud else colours[mark.role]
    ax.plot(
        mark.x, mark.y, mark.marker, color=colour, markersize=mark.size, alpha=mark.alpha,
        markerfacecolor=colour if mark.is_filled or mark.is_cloud else "none",
        markeredgewidth=0 if mark.is_cloud else 1.5 if is_drawn else None,
        rasterized=mark.is_cloud, label=label,
    )  # fmt: skip


def _band(ax: Axes, mark: figures.Band, colours: Mapping[str, str], _: int | None) -> None:
    ax.fill_between(
        mark.x, mark.low, mark.high, color=colours[mark.role], alpha=mark.alpha, linewidth=0,
        label=mark.label or None,
    )  # fmt: skip


def _intervals(
    ax: Axes, mark: figures.Intervals, colours: Mapping[str, str], _: int | None
) -> None:
    off = np.nan_to_num([mark.y - mark.low, mark.high - mark.y], posinf=0.0, neginf=0.0)
    ax.errorbar(
        mark.x, mark.y, yerr=np.maximum(off, 0.0), fmt=mark.marker, color=colours[mark.role],
        capsize=3, markersize=9 if mark.marker == "_" else 3, elinewidth=1.0,
        label=mark.label or None,
    )  # fmt: skip


def _bars(ax: Axes, mark: figures.Bars, colours: Mapping[str, str], _: int | None) -> None:
    starts = np.zeros(len(mark.ends)) if mark.starts is None else mark.starts
    bar = ax.barh if mark.is_across else ax.bar
    bar(
        mark.places, mark.ends - starts, mark.thickness, starts, color=colours[mark.role],
        linewidth=0, label=mark.label or None,
    )  # fmt: skip


def _rule(ax: Axes, mark: figures.Rule, colours: Mapping[str, str], _: int | None) -> None:
    line = ax.axvline if mark.is_upright else ax.axhline
    line(
        mark.value, color=colours[mark.role], linewidth=mark.width, linestyle=_DASHES[mark.dash],
        label=mark.label or None,
    )  # fmt: skip


def _span(ax: Axes, mark: figures.Span, colours: Mapping[str, str], _: int | None) -> None:
    span = ax.axvspan if mark.is_upright else ax.axhspan
    span(mark.low, mark.high, color=colours[mark.role], alpha=mark.alpha, linewidth=0)


def _cells(ax: Axes, mark: figures.ColourMap, colours: Mapping[str, str], _: int | None) -> Any:
    mesh = ax.pcolormesh(
        mark.x, mark.y, mark.values, shading="nearest",
        cmap="PuOr" if mark.is_signed else "viridis", vmin=mark.limits[0], vmax=mark.limits[1],
        rasterized=True,
    )  # fmt: skip
    ax.grid(False)
    # Beneath the cells: shown where a value is missing.
    ax.fill_between(
        [0.0, 1.0], 0.0, 1.0, transform=ax.transAxes, color=colours["grid"], linewidth=0, zorder=-1
    )
    return mesh


def _squares(ax: Axes, mark: figures.Squares, colours: Mapping[str, str], _: int | None) -> None:
    from matplotlib.patches import Rectangle

    side = 0.94  # the gap separates neighbours
    for x, y, strength in zip(mark.x, mark.y, mark.strength, strict=True):
        corner = (x - 0.5 * side, y - 0.5 * side)
        for role, alpha in (("grid", 0.5), (mark.role, float(strength))):
            colour = colours[role]
            ax.add_patch(Rectangle(corner, side, side, color=colour, alpha=alpha, linewidth=0))
    ax.grid(False)
    ax.tick_params(length=0)
    for spine in ax.spines.values():
        spine.set_visible(False)


def _words(ax: Axes, mark: figures.Words, *_: Any) -> None:
    if mark.is_at_edge:
        where = ax.get_yaxis_transform()
        ax.text(0.005, mark.y, mark.text, transform=where, va="center", zorder=4)
    else:
        ax.text(
            mark.x,
            mark.y,
            mark.text,
            ha="center",
            va="center",
            fontsize="small" if mark.is_small else None,
        )


_DRAWN: Mapping[type, Callable[..., Any]] = {
    figures.Line: _line,
    figures.Points: _points,
    figures.Band: _band,
    figures.Intervals: _intervals,
    figures.Bars: _bars,
    figures.Rule: _rule,
    figures.Span: _span,
    figures.ColourMap: _cells,
    figures.Squares: _squares,
    figures.Words: _words,
}


def _scale(ax: Axes, name: str, axis: Scale) -> None:
    """Scale, limits and ticks of the x or y axis."""
    drawn = getattr(ax, f"{name}axis")
    if axis.kind == "asinh":
        getattr(ax, f"set_{name}scale")("asinh", linear_width=axis.linear_width)
    elif axis.kind == "log":
        getattr(ax, f"set_{name}scale")("log")
        drawn.set_major_formatter(lambda value, _: number(value, 1))
        drawn.set_minor_formatter(
            lambda value, _: _between_decades(value, *drawn.get_view_interval())
        )
    if axis.margin is not None:
        getattr(ax, f"set_{name}margin")(axis.margin)
    if axis.limits != (None, None):
        getattr(ax, f"set_{name}lim")(*axis.limits)
    if axis.ticks is not None:
        places, names = [place for place, _ in axis.ticks], [text for _, text in axis.ticks]
        drawn.set_ticks(places, names)
        drawn.minorticks_off()
    if axis.is_date:
        from matplotlib import dates

        locator = dates.AutoDateLocator(minticks=2, maxticks=6)  # type: ignore[no-untyped-call]
        drawn.set_major_locator(locator)
        form = dates.ConciseDateFormatter(locator, show_offset=False)  # type: ignore[no-untyped-call]
        drawn.set_major_formatter(form)


def _between_decades(value: float, low: float, high: float) -> str:
    """The label of a tick within a decade: 2 and 5 are labelled where there are few decades."""
    return number(value, 1) if high < 100.0 * low and f"{value:.0e}"[0] in "25" else ""


def _legend(ax: Axes, panel: Panel) -> None:
    labels = ax.get_legend_handles_labels()[1]
    if panel.legend == "none" or not 0 < len(labels) <= MOST_IN_LEGEND:
        return
    width, height = ax.get_position().size * ax.get_figure(root=True).get_size_inches()  # type: ignore[union-attr]
    wide = _LETTER * max(len(label) + _SAMPLE for label in labels)
    if panel.legend == "above" or (panel.legend == "best" and wide > _WIDE * width):
        is_short = sum(len(label) + _SAMPLE for label in labels) <= _LEGEND_LETTERS
        columns = len(labels) if is_short else 2 if wide < 0.8 * width else 1
        rows = math.ceil(len(labels) / columns)
        room = min((_LEGEND_ROW * rows + _LEGEND_EDGE) / height, 0.5)
        low, high = ax.get_ylim()
        is_log = panel.y.kind == "log"
        share = 1.0 / (1.0 - room)
        ax.set_ylim(low, low * (high / low) ** share if is_log else low + share * (high - low))
        ax.legend(loc="upper right", ncols=columns, columnspacing=0.8, handlelength=1.2)
    elif panel.legend == "over":
        ax.legend(loc="lower right", bbox_to_anchor=(1.0, 0.99), ncols=3)
    elif panel.legend == "right":
        ax.legend(fontsize="small", loc="upper left", bbox_to_anchor=(1.0, 1.0))
    else:
        ax.legend(loc="best")


def thinned(time: FloatArray, values: Sequence[FloatArray], buckets: int) -> NDArray[np.intp]:
    """Rows (m,), sorted, that keep each curve's least and largest value in every bucket.

    `time` (n,) and every curve (n,); at most 2 `buckets` rows a curve, and the two ends. A
    line through them is indistinguishable from the whole one if a bucket is at most a pixel.
    """
    n = len(time)
    if n <= 2 * buckets:
        return np.arange(n)
    edges = np.linspace(0, n, buckets + 1).astype(np.intp)
    rows = [np.array([0, n - 1])]
    for curve in values:
        for pick in (np.argmin, np.argmax):
            rows.append(np.array([a + pick(curve[a:b]) for a, b in itertools.pairwise(edges)]))
    return np.unique(np.concatenate(rows))


__all__ = ["COLOURS", "draw", "plot", "plot_panels", "thinned"]
