"""Interactive overlays: Bokeh documents as JSON, drawn by the page's script when in view.

Colours are set again by the script, from the page's scheme, by the role in a model's tags.
Everything that is drawn comes from numbers and from names in this package; text from a file
stays outside, in text that the template escapes.

One document serves all tests with the same channels and valve models; the script puts each
test's samples into it. They travel whole, so that zooming in shows every one: 16-bit whole
numbers with a scale for each column, and of measured, simulated and residual only two are
carried; the script makes the third.
"""

from __future__ import annotations

import base64
import importlib
from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from sysid.blocks import svg
from sysid.blocks.interactive import TOOLBAR_STYLE
from sysid.io.channels import Channel
from sysid.types import FloatArray
from sysid.validation.shown_tests import MODEL_NAMES, ShownTest

# Bokeh's annotations do not know the keyword arguments that its models take: its objects and
# modules are left untyped here.
BokehModel = Any

# A longer test is thinned to its extremes: this many samples.
_MOST_SAMPLES = 12_000
# Sixteen bits, except the least value, which means "not a number".
_LARGEST, _NOT_A_NUMBER = 32_767, -32_768
_HEIGHTS = (176, 104)
_LEFT = 78
# As style.css has them in the light scheme; the script sets those of the scheme in use.
_COLOURS = {
    "measured": "#7d8894",
    "model": "#d55e00",
    "second": "#0072b2",
    "third": "#009e73",
    "fourth": "#cc79a7",
    "muted": "#59636e",
}
_ROLES = {"discrete": "model", "averaged": "fourth", "bipolynomial": "second", "ann": "third"}
_DASHES = {"discrete": "solid", "averaged": [8, 2, 2, 2], "bipolynomial": [6, 2], "ann": [2, 2]}


def bokeh_script() -> str:
    """BokehJS, for use inside a script element."""
    from bokeh.resources import Resources

    text = "\n".join(Resources(mode="inline", components=["bokeh"]).js_raw)
    return text.replace("</script", "<\\/script").replace("<!--", "<\\!--")


def overlay_samples(
    test: ShownTest, channels: Sequence[Channel], noise_band: float
) -> dict[str, Any]:
    """A test's samples by channel, as `report.js` reads them; `last` is its end, s."""
    return {
        "last": float(test.first.time[-1]),
        "channels": {channel.key: _samples(test, channel, noise_band) for channel in channels},
    }


@lru_cache(maxsize=16)
def overlay_document(channels: tuple[Channel, ...], models: tuple[str, ...]) -> dict[str, Any]:
    """Overlay and residual of each channel, below one another, with one time axis; no data."""
    from bokeh.embed import json_item

    parts, layouts = _module("models"), _module("layouts")
    x_range = parts.Range1d(start=0.0, end=1.0)
    cursor = parts.Span(dimension="height", line_dash="dotted", line_width=1, tags=["muted"])
    rows = []
    for number, channel in enumerate(channels):
        is_last = number == len(channels) - 1
        rows += [[f] for f in _pair(channel, models, x_range, cursor, is_last)]
    grid = layouts.gridplot(
        rows, merge_tools=True, toolbar_location="above", sizing_mode="stretch_width"
    )
    grid.toolbar.stylesheets = [TOOLBAR_STYLE]
    return dict(json_item(grid))


def _module(name: str) -> Any:
    return importlib.import_module(f"bokeh.{name}")


def _pair(
    channel: Channel,
    models: tuple[str, ...],
    x_range: BokehModel,
    cursor: BokehModel,
    is_last: bool,
) -> tuple[BokehModel, BokehModel]:
    parts = _module("models")
    names = ["time", "measured", *(f"{part}_{m}" for m in models for part in ("sim", "res"))]
    source = parts.ColumnDataSource({name: [] for name in names}, name=channel.key)
    digits = "0.0000" if channel.unit == "rad" else "0.00"
    tips = [("time", "@time{0.0000} s"), ("measured", f"@measured{{{digits}}} {channel.unit}")]
    tips += [(MODEL_NAMES[m], f"@sim_{m}{{{digits}}} {channel.unit}") for m in models]
    top = _figure(x_range, _HEIGHTS[0], f"{channel.title} ({channel.unit})", False)
    measured = top.line(
        "time", "measured", source=source, line_width=3, color=_COLOURS["measured"],
        legend_label="measured", tags=["measured"],
    )  # fmt: skip
    for model in reversed(models):
        _line(top, source, f"sim_{model}", model, MODEL_NAMES[model])
    _tools(top, measured, tips, cursor)
    _place_legend(top)
    top.tags = ["tall"]  # on a phone the script makes it lower
    bottom = _figure(x_range, _HEIGHTS[1], f"Residual ({channel.residual_unit})", is_last)
    band = parts.BoxAnnotation(
        bottom=0.0, top=0.0, fill_color=_COLOURS["second"], fill_alpha=0.25, line_color=None,
        name=channel.key, tags=["band"],
    )  # fmt: skip
    bottom.add_layout(band)
    lines = {m: _line(bottom, source, f"res_{m}", m, None) for m in reversed(models)}
    for line in lines.values():
        line.glyph.update(line_width=1, line_dash="solid")
    tips = [("time", "@time{0.0000} s")]
    tips += [(MODEL_NAMES[m], f"@res_{m}{{0.000}} {channel.residual_unit}") for m in models]
    _tools(bottom, lines[models[0]], tips, cursor)
    return top, bottom


def _samples(test: ShownTest, channel: Channel, noise_band: float) -> dict[str, Any]:
    """Time, measured and residuals; `factor` takes a residual to the channel's shown unit."""
    first = test.first
    residuals = {m: r.residual(channel.key) for m, r in test.results.items()}
    measured = first.measured[channel.key]
    kept: Any = slice(None)
    if len(measured) > _MOST_SAMPLES:
        curves = [measured, *residuals.values()]
        kept = svg.thinned(first.time, curves, _MOST_SAMPLES // (2 * len(curves)))
    time = np.asarray(first.time[kept], dtype="<f4")
    return {
        "factor": channel.scale / channel.residual_scale,
        "noise": noise_band * first.channels[channel.key].noise_floor * channel.residual_scale,
        "time": base64.b64encode(time.tobytes()).decode("ascii"),
        "measured": packed(measured[kept] * channel.scale),
        "residuals": {
            model: packed(residual[kept] * channel.residual_scale)
            for model, residual in residuals.items()
        },
    }


def packed(values: FloatArray) -> dict[str, Any]:
    """Values (n,) as 16-bit whole numbers: value = offset + scale * number, within scale/2."""
    finite = np.isfinite(values)
    known = values[finite] if finite.any() else np.zeros(1)
    low, high = float(known.min()), float(known.max())
    offset, scale = 0.5 * (low + high), max(0.5 * (high - low) / _LARGEST, 1e-300)
    numbers = np.full(len(values), _NOT_A_NUMBER, dtype="<i2")
    numbers[finite] = np.rint((values[finite] - offset) / scale).astype("<i2")
    data = base64.b64encode(numbers.tobytes()).decode("ascii")
    return {"data": data, "offset": offset, "scale": scale}


def _figure(x_range: BokehModel, height: int, label: str, is_last: bool) -> BokehModel:
    plot = _module("plotting").figure(
        height=height + (34 if is_last else 0),
        x_range=x_range,
        tools="",
        min_border_left=_LEFT,
        min_border_right=12,
        sizing_mode="stretch_width",
        window_axis="x",  # the other axis follows what the zoom shows
        background_fill_color=None,
        border_fill_color=None,
        outline_line_color=None,
    )
    plot.yaxis.axis_label = label
    plot.xaxis.axis_label = "Time (s)" if is_last else None
    plot.xaxis.visible = is_last
    plot.yaxis.ticker.desired_num_ticks = 4
    for axis in plot.axis:
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size = axis.major_label_text_font_size = "11px"
        axis.minor_tick_line_color = None
    return plot


def _line(plot: BokehModel, source: Any, column: str, model: str, label: str | None) -> Any:
    role = _ROLES[model]
    options = {} if label is None else {"legend_label": label}
    return plot.line(
        "time", column, source=source, line_width=1.4, color=_COLOURS[role],
        line_dash=_DASHES[model], tags=[role], **options,
    )  # fmt: skip


def _tools(
    plot: BokehModel, renderer: Any, tips: list[tuple[str, str]], cursor: BokehModel
) -> None:
    parts = _module("models")
    box, wheel = parts.BoxZoomTool(dimensions="width"), parts.WheelZoomTool(dimensions="width")
    hover = parts.HoverTool(
        renderers=[renderer], tooltips=tips, mode="vline", line_policy="nearest"
    )
    plot.add_tools(
        box,
        wheel,
        parts.PanTool(),
        parts.ResetTool(),
        parts.SaveTool(),
        hover,
        parts.CrosshairTool(overlay=cursor),
    )
    plot.toolbar.active_drag = box
    plot.toolbar.active_scroll = wheel
    plot.toolbar.logo = None


def _place_legend(plot: BokehModel) -> None:
    legend = plot.legend[0]
    plot.add_layout(legend, "above")
    legend.orientation = "horizontal"
    legend.click_policy = "hide"
    legend.label_text_font_size = "11px"
    legend.border_line_color = None
    legend.background_fill_color = None
    legend.padding, legend.spacing, legend.margin = 0, 14, 0
    legend.glyph_height = 12
    legend.items = [legend.items[0], *reversed(legend.items[1:])]
