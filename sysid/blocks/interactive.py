"""Figures drawn with Bokeh, for a page that a server keeps alive (`sysid app`).

Bokeh is imported when used. Bokeh's annotations do not know the keyword arguments that its models
take: its objects are left untyped here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from typing import Any, Literal

import numpy as np

from sysid.blocks import figures
from sysid.blocks.drawing import COLOURS, thinned
from sysid.blocks.figures import Figure, Panel, Scale
from sysid.blocks.plots import MOST_IN_LEGEND

Scheme = Literal["light", "dark"]
BokehModel = Any

# As style.css has them in its dark scheme.
_DARK: Mapping[str, str] = {
    "ink": "#e3e7eb",
    "muted": "#9fa9b4",
    "grid": "#2a3037",
    "measured": "#8b97a3",
    "model": "#f0883e",
    "second": "#56b4e9",
    "third": "#2bc49a",
    "fourth": "#e0a3c4",
    "band": "#3d83b0",
}
SCHEMES: Mapping[Scheme, Mapping[str, str]] = {"light": COLOURS, "dark": _DARK}
"""A colour for each role in either scheme."""
_DASHES: Mapping[str, Any] = {
    "solid": "solid",
    "dashed": [6, 3],
    "dotted": [2, 2],
    "dash-dot": [8, 2, 2, 2],
}
_MARKERS = {"o": "circle", "s": "square", "D": "diamond", "x": "x", "_": "dash", ".": "circle"}
_PIXELS_PER_INCH = 96
# Pixels of a figure with several panels: left of them, of the x axis, of the title and the legend;
# the lowest panel in which an axis's name has room; from one tick to the next.
_LEFT, _AXIS, _TITLE, _LEAST, _PER_TICK = 62, 46, 40, 92, 30
# Pixels of a legend in the narrowest place of a figure; of a letter, and of a line's sample.
_LEGEND, _LETTER, _SAMPLE = 300, 5.6, 30
# Between the tools: Bokeh's own is a light grey, the brightest thing of a dark page.
TOOLBAR_STYLE = ".bk-divider { background-color: rgb(128 128 128 / 50%); }"
# Values of a line in a figure: two a pixel of a wide page.
_BUCKETS = 2000


@dataclass
class Drawn:
    """A figure's plots, one a panel, and what its points are drawn from, in the marks' order."""

    plots: list[BokehModel]
    layout: BokehModel
    points: list[BokehModel] = field(default_factory=list)


def bokeh(name: str) -> Any:
    """A module of Bokeh."""
    return import_module(f"bokeh.{name}")


def empty_plot(x: Scale, y: Scale, scheme: Scheme, height: int, **options: Any) -> BokehModel:
    """A plot as wide as its place, in the colours of a scheme, with tools to zoom and pan."""
    colours = SCHEMES[scheme]
    plot = bokeh("plotting").figure(
        height=height,
        sizing_mode="stretch_width",
        x_axis_type="log" if x.kind == "log" else "linear",
        y_axis_type="log" if y.kind == "log" else "linear",
        tools="",
        background_fill_color=None,
        border_fill_color=None,
        outline_line_color=None,
        min_border_right=12,
        **options,
    )
    plot.toolbar.stylesheets = [TOOLBAR_STYLE]
    plot.xaxis.axis_label, plot.yaxis.axis_label = x.label or None, y.label or None
    for axis in plot.axis:
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size = axis.major_label_text_font_size = "12px"
        axis.axis_label_text_color = axis.major_label_text_color = colours["ink"]
        axis.axis_line_color = axis.major_tick_line_color = colours["muted"]
        axis.minor_tick_line_color = None
    for grid in plot.grid:
        grid.grid_line_color = colours["grid"]
    return plot


def add_zoom(plot: BokehModel, *, along: Literal["both", "width"] = "both") -> None:
    """Drag to zoom into a box, wheel to zoom, shift and drag to move, and back."""
    parts = bokeh("models")
    box = parts.BoxZoomTool(dimensions=along)
    wheel = parts.WheelZoomTool(dimensions=along, modifiers={"ctrl": True})
    plot.add_tools(box, wheel, parts.PanTool(), parts.ResetTool(), parts.SaveTool())
    plot.toolbar.active_drag, plot.toolbar.active_scroll = box, wheel
    plot.toolbar.logo = None
    plot.toolbar.autohide = True


def draw(figure: Figure, scheme: Scheme = "light", height: int | None = None) -> Drawn:
    """A figure's panels below one another; `height` of all, pixels (None: the figure's own)."""
    whole = height or int(figure.size[1] * _PIXELS_PER_INCH)
    shares = sum(panel.height for panel in figure.panels)
    plots: list[BokehModel] = []
    sources: list[BokehModel] = []
    several = {"min_border_left": _LEFT} if len(figure.panels) > 1 else {}
    for panel in map(_on_even_axis, figure.panels):
        shared = {"x_range": plots[0].x_range} if plots else {}
        inner = max(int((whole - _AXIS - _TITLE) * panel.height / shares), _LEAST)
        plot = _panel(panel, scheme, inner, {**several, **shared}, sources)
        if panel.y.ticks is None:
            plot.yaxis.ticker.desired_num_ticks = max(inner // _PER_TICK, 3)
        plots.append(plot)
    # One time axis below, a title above; the panels' own areas keep their shares of the height.
    for plot in plots[:-1]:
        plot.xaxis.visible = False
    plots[-1].height += _AXIS
    plots[0].height += _TITLE
    plots[0].title = bokeh("models").Title(
        text=figure.heading or figure.title,
        text_font_size="13px",
        text_color=SCHEMES[scheme]["ink"],
    )
    layout = bokeh("layouts").column(plots, sizing_mode="stretch_width")
    return Drawn(plots, layout, sources)


def _panel(
    panel: Panel,
    scheme: Scheme,
    height: int,
    shared: Mapping[str, Any],
    sources: list[BokehModel],
) -> BokehModel:
    plot = empty_plot(panel.x, panel.y, scheme, height, **shared)
    add_zoom(plot)
    for mark in panel.marks:
        made = _DRAWN[type(mark)](plot, mark, SCHEMES[scheme], panel)
        if isinstance(mark, figures.Points):
            sources.append(made)
    _limits(plot.x_range, panel.x)
    _limits(plot.y_range, panel.y)
    _ticks(plot.xaxis, panel.x)
    _ticks(plot.yaxis, panel.y)
    if panel.has_names:
        plot.yaxis.visible = False
    _legend(plot, panel, scheme)
    return plot


def _on_even_axis(panel: Panel) -> Panel:
    """A panel whose x axis is linear and then logarithmic, in the places of its values.

    Bokeh has no such axis: the marks are moved, and the ticks keep their names.
    """
    scale = panel.x
    if scale.kind != "asinh":
        return panel

    def placed(value: Any) -> Any:
        return None if value is None else np.arcsinh(np.asarray(value) / scale.linear_width)

    moved = tuple(_moved(mark, placed) for mark in panel.marks)
    low, high = scale.limits
    axis = replace(
        scale,
        kind="linear",
        limits=(placed(low), placed(high)),
        ticks=None if scale.ticks is None else tuple((float(placed(x)), n) for x, n in scale.ticks),
    )
    return replace(panel, x=axis, marks=moved)


def _moved(mark: figures.Mark, placed: Callable[[Any], Any]) -> figures.Mark:
    """A mark with its values along x where `placed` puts them."""
    if isinstance(mark, figures.Bars) and mark.is_across:
        starts = np.zeros(len(mark.ends)) if mark.starts is None else mark.starts
        return replace(mark, ends=placed(mark.ends), starts=placed(starts))
    if isinstance(mark, figures.Rule) and mark.is_upright:
        return replace(mark, value=float(placed(mark.value)))
    if isinstance(mark, figures.Span) and mark.is_upright:
        return replace(mark, low=float(placed(mark.low)), high=float(placed(mark.high)))
    if isinstance(mark, figures.Line | figures.Points | figures.Band | figures.Intervals):
        return replace(mark, x=placed(mark.x))
    if isinstance(mark, figures.Words):
        return replace(mark, x=float(placed(mark.x)))
    return mark


def _limits(reach: BokehModel, scale: Scale) -> None:
    low, high = scale.limits
    if low is not None:
        reach.start = low
    if high is not None:
        reach.end = high
    if scale.margin is not None and hasattr(reach, "range_padding"):
        reach.range_padding = 2.0 * scale.margin


def _ticks(axis: BokehModel, scale: Scale) -> None:
    if scale.ticks is None:
        return
    axis.ticker = bokeh("models").FixedTicker(ticks=[place for place, _ in scale.ticks])
    axis.major_label_overrides = dict(scale.ticks)


def _legend(plot: BokehModel, panel: Panel, scheme: Scheme) -> None:
    if not plot.legend:
        return
    legend = plot.legend[0]
    if panel.legend == "none" or not 0 < len(legend.items) <= MOST_IN_LEGEND:
        legend.visible = False
        return
    style_legend(plot, scheme)
    columns = len(legend.items)
    widths = legend_widths(legend)
    if sum(widths) > _LEGEND:
        columns = max(int(_LEGEND / max(widths)), 1)
        legend.spacing = 8
        plot.height += 22 * (math.ceil(len(widths) / columns) - 1)
    legend.ncols = columns


def legend_widths(legend: BokehModel) -> list[float]:
    """How wide each entry of a legend is, pixels."""
    return [_LETTER * len(item.label["value"]) + _SAMPLE for item in legend.items]


def style_legend(plot: BokehModel, scheme: Scheme) -> None:
    """A legend in a row above the plot; a click hides its line."""
    legend = plot.legend[0]
    plot.add_layout(legend, "above")
    legend.orientation = "horizontal"
    legend.click_policy = "hide"
    legend.label_text_font_size = "12px"
    legend.label_text_color = SCHEMES[scheme]["ink"]
    legend.border_line_color = legend.background_fill_color = None
    legend.padding, legend.spacing, legend.margin = 0, 14, 0
    legend.glyph_height = 12


def _labelled(label: str) -> dict[str, str]:
    return {"legend_label": label} if label else {}


def _values(values: Any) -> Any:
    return np.asarray(values, dtype=float)


def _line(plot: Any, mark: figures.Line, colours: Mapping[str, str], _: Panel) -> Any:
    x, y = _values(mark.x), _values(mark.y)
    given = {
        "line_color": colours[mark.role],
        "line_width": mark.width + 0.4,
        "line_alpha": mark.alpha,
        "line_dash": _DASHES[mark.dash],
        **_labelled(mark.label),
    }
    if mark.is_step:
        return plot.step(x, y, mode="after", **given)
    rows = thinned(x, [y], _BUCKETS) if np.isfinite(y).all() else np.arange(len(x))
    if mark.marker:
        plot.scatter(x[rows], y[rows], size=5, color=colours[mark.role])
    return plot.line(x[rows], y[rows], **given)


def _points(plot: Any, mark: figures.Points, colours: Mapping[str, str], _: Panel) -> Any:
    colour: Any = colours[mark.role]
    data = {"x": _values(mark.x), "y": _values(mark.y), "row": np.arange(len(mark.x))}
    if mark.shades is not None:
        palette = bokeh("palettes").Viridis256
        data["colour"] = [palette[int(255 * s)] for s in np.clip(mark.shades, 0.0, 1.0)]
        colour = "colour"
    source = bokeh("models").ColumnDataSource(data)
    filled = mark.is_filled or mark.is_cloud or mark.shades is not None
    plot.scatter(
        "x", "y", source=source, size=max(mark.size * 1.8, 3.0), alpha=mark.alpha,
        marker=_MARKERS.get(mark.marker, "circle"), line_color=colour,
        fill_color=colour if filled else None, **_labelled(mark.label),
    )  # fmt: skip
    return source


def _band(plot: Any, mark: figures.Band, colours: Mapping[str, str], _: Panel) -> Any:
    return plot.varea(
        _values(mark.x), _values(mark.low), _values(mark.high),
        fill_color=colours[mark.role], fill_alpha=mark.alpha, **_labelled(mark.label),
    )  # fmt: skip


def _intervals(plot: Any, mark: figures.Intervals, colours: Mapping[str, str], _: Panel) -> Any:
    x, y = _values(mark.x), _values(mark.y)
    known = np.isfinite(mark.low) & np.isfinite(mark.high)
    colour = colours[mark.role]
    plot.segment(x[known], _values(mark.low)[known], x[known], _values(mark.high)[known],
                 line_color=colour)  # fmt: skip
    marker = _MARKERS.get(mark.marker, "circle")
    return plot.scatter(x, y, size=7, marker=marker, color=colour, **_labelled(mark.label))


def _bars(plot: Any, mark: figures.Bars, colours: Mapping[str, str], panel: Panel) -> Any:
    starts = np.zeros(len(mark.ends)) if mark.starts is None else _values(mark.starts)
    scale = panel.x if mark.is_across else panel.y
    if scale.kind == "log" and mark.starts is None:  # a logarithm has no zero to start from
        ends = _values(mark.ends)
        positive = ends[np.isfinite(ends) & (ends > 0.0)]
        starts = np.full(len(ends), 0.3 * float(positive.min()) if len(positive) else 1.0)
    given = {"fill_color": colours[mark.role], "line_color": None, **_labelled(mark.label)}
    places, ends = _values(mark.places), _values(mark.ends)
    if mark.is_across:
        return plot.hbar(y=places, left=starts, right=ends, height=mark.thickness, **given)
    return plot.vbar(x=places, bottom=starts, top=ends, width=mark.thickness, **given)


def _rule(plot: Any, mark: figures.Rule, colours: Mapping[str, str], _: Panel) -> Any:
    span = bokeh("models").Span(
        location=mark.value, dimension="height" if mark.is_upright else "width",
        line_color=colours[mark.role], line_width=mark.width + 0.3, line_dash=_DASHES[mark.dash],
    )  # fmt: skip
    plot.add_layout(span)
    return span


def _span(plot: Any, mark: figures.Span, colours: Mapping[str, str], _: Panel) -> Any:
    ends = ("left", "right") if mark.is_upright else ("bottom", "top")
    box = bokeh("models").BoxAnnotation(
        **dict(zip(ends, (mark.low, mark.high), strict=True)),
        fill_color=colours[mark.role], fill_alpha=mark.alpha, line_color=None,
    )  # fmt: skip
    plot.add_layout(box)
    return box


def _map(plot: Any, mark: figures.ColourMap, colours: Mapping[str, str], _: Panel) -> Any:
    parts, palettes = bokeh("models"), bokeh("palettes")
    signed = palettes.interp_palette(tuple(reversed(palettes.PuOr11)), 256)
    palette = signed if mark.is_signed else palettes.Viridis256
    plot.background_fill_color = colours["grid"]  # where a value is missing
    low, high = mark.limits
    mapper = parts.LinearColorMapper(
        palette=palette, low=low, high=high, nan_color="rgba(0, 0, 0, 0)"
    )
    x, y = _values(mark.x), _values(mark.y)
    dx, dy = np.median(np.diff(x)), np.median(np.diff(y))
    plot.image(
        [_values(mark.values)], x=x[0] - dx / 2, y=y[0] - dy / 2,
        dw=x[-1] - x[0] + dx, dh=y[-1] - y[0] + dy, color_mapper=mapper,
    )  # fmt: skip
    bar = parts.ColorBar(
        color_mapper=mapper, title=mark.unit, width=8, background_fill_color=None,
        major_label_text_color=colours["ink"], title_text_color=colours["ink"],
        title_standoff=8, title_text_font_style="normal",
    )  # fmt: skip
    plot.add_layout(bar, "right")
    return bar


def _squares(plot: Any, mark: figures.Squares, colours: Mapping[str, str], _: Panel) -> Any:
    x, y, strength = _values(mark.x), _values(mark.y), _values(mark.strength)
    for role, alpha in (("grid", np.full(len(x), 0.5)), (mark.role, strength)):
        plot.rect(
            x=x, y=y, width=0.94, height=0.94, fill_color=colours[role], fill_alpha=alpha,
            line_color=None,
        )  # fmt: skip
    return None


def _words(plot: Any, mark: figures.Words, colours: Mapping[str, str], _: Panel) -> Any:
    parts = bokeh("models")
    label = parts.Label(
        x=4 if mark.is_at_edge else mark.x, y=mark.y, text=mark.text,
        x_units="screen" if mark.is_at_edge else "data",
        text_align="left" if mark.is_at_edge else "center", text_baseline="middle",
        text_font_size="11px" if mark.is_small else "12px", text_color=colours["ink"],
    )  # fmt: skip
    plot.add_layout(label)
    return label


_DRAWN: Mapping[type, Callable[..., Any]] = {
    figures.Line: _line,
    figures.Points: _points,
    figures.Band: _band,
    figures.Intervals: _intervals,
    figures.Bars: _bars,
    figures.Rule: _rule,
    figures.Span: _span,
    figures.ColourMap: _map,
    figures.Squares: _squares,
    figures.Words: _words,
}


__all__ = [
    "SCHEMES",
    "TOOLBAR_STYLE",
    "BokehModel",
    "Drawn",
    "Scheme",
    "add_zoom",
    "bokeh",
    "draw",
    "empty_plot",
    "legend_widths",
    "style_legend",
]
