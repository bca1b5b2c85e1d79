"""Long recordings, drawn as many values as a window has pixels and anew for each zoom.

The samples stay in the program. A window gets the least and the largest value of each pixel of what
it shows (`sysid.blocks.drawing.thinned`), so that no peak is lost, whatever the recording's length.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.blocks.drawing import thinned
from sysid.blocks.figures import Dash, Role, Scale
from sysid.blocks.interactive import (
    SCHEMES,
    TOOLBAR_STYLE,
    Scheme,
    add_zoom,
    bokeh,
    empty_plot,
    legend_widths,
    style_legend,
)
from sysid.types import FloatArray

# Buckets of a window: a least and a largest value each.
BUCKETS = 900
_DASHES: Mapping[str, Any] = {"solid": "solid", "dashed": [6, 3], "dotted": [2, 2],
                              "dash-dot": [8, 2, 2, 2]}  # fmt: skip
_OVERLAY: tuple[Role, ...] = ("model", "second", "third", "fourth", "measured", "band")
# A measured test is none of a model's colour: alone it has that of its line in the list.
_TESTS: tuple[Role, ...] = ("second", "third", "fourth", "model", "measured", "band")


@dataclass(frozen=True, eq=False)
class Curve:
    """Samples (n,) over time (n,), s; `label` is in the legend ("": not there)."""

    time: FloatArray
    values: FloatArray
    label: str
    role: Role = "model"
    dash: Dash = "solid"
    width: float = 1.3
    is_step: bool = False


@dataclass(frozen=True, eq=False)
class TracePanel:
    """Curves over one axis; `bands` are stripes along x: (from, to, role).

    `height` is relative to that of the view's panels.
    """

    y: Scale
    curves: tuple[Curve, ...]
    bands: tuple[tuple[float, float, Role], ...] = ()
    noise: float = 0.0
    height: float = 1.0


Selected = Callable[[float, float], None]


def overlay_role(number: int) -> Role:
    """The colour of one of several models over one another."""
    return _OVERLAY[number % len(_OVERLAY)]


def _wrap_legend(plot: Any) -> None:
    """As many columns of the legend as its window has room for: one of a phone has one or two."""
    legend = plot.legend[0]
    widest = max(legend_widths(legend))
    wrap = bokeh("models").CustomJS(
        args={"legend": legend, "widest": widest},
        code="legend.ncols = Math.max(1, Math.floor(cb_obj.inner_width / widest));",
    )
    plot.js_on_change("inner_width", wrap)


def trial_role(number: int) -> Role:
    """The colour of one of several measured tests over one another."""
    return _TESTS[number % len(_TESTS)]


class TraceView:
    """Panels below one another with one time axis. `selected` is told a span that is marked."""

    def __init__(
        self,
        panels: Sequence[TracePanel],
        scheme: Scheme,
        *,
        selected: Selected | None = None,
        height: int = 190,
        x: Scale | None = None,
    ) -> None:
        self.panels, self.scheme = panels, scheme
        self._selected = selected
        self.x = x or Scale("Time since the test's first row", "s")
        self.sources: list[tuple[Curve, Any]] = []
        self.marks: list[Any] = []
        self.plots: list[Any] = []
        self.lines: dict[str, Any] = {}  # those of the last legend, by their labels
        ends = [c.time[[0, -1]] for p in panels for c in p.curves if len(c.time)]
        low = float(min(e[0] for e in ends)) if ends else 0.0
        high = float(max(e[1] for e in ends)) if ends else 1.0
        self.whole = (low, high if high > low else low + 1.0)
        self.range = bokeh("models").Range1d(*self.whole, bounds=None)
        for number, panel in enumerate(panels):
            self._add(panel, height, is_last=number == len(panels) - 1)
        self.range.on_change("start", self._zoomed)
        self.range.on_change("end", self._zoomed)
        self._shown = (*self.whole, 0)

    def layout(self) -> Any:
        """All of it as one model."""
        grid = bokeh("layouts").gridplot(
            [[plot] for plot in self.plots],
            merge_tools=True,
            toolbar_location="above",
            sizing_mode="stretch_width",
            toolbar_options={"logo": None},
        )
        grid.toolbar.stylesheets = [TOOLBAR_STYLE]
        return grid

    def _add(self, panel: TracePanel, height: int, *, is_last: bool) -> None:
        parts = bokeh("models")
        x = self.x if is_last else Scale()
        plot = empty_plot(
            x, panel.y, self.scheme, int(height * panel.height) + (34 if is_last else 0),
            x_range=self.range, min_border_left=72, window_axis="x",
        )  # fmt: skip
        plot.xaxis.visible = is_last
        add_zoom(plot, along="width")
        plot.toolbar.autohide = False
        colours = SCHEMES[self.scheme]
        for low, high, role in panel.bands:
            plot.add_layout(parts.BoxAnnotation(
                left=low, right=high, fill_color=colours[role], fill_alpha=0.18, line_color=None,
            ))  # fmt: skip
        if panel.noise > 0.0:
            plot.add_layout(parts.BoxAnnotation(
                bottom=-panel.noise, top=panel.noise, fill_color=colours["band"], fill_alpha=0.25,
                line_color=None,
            ))  # fmt: skip
        # Panels of the same curves have one legend, above the first: it hides them in all.
        labels = dict.fromkeys(curve.label for curve in panel.curves if curve.label)
        is_first = bool(labels) and tuple(self.lines) != tuple(labels)
        if is_first:
            self.lines = {}
        for curve in panel.curves:
            source = parts.ColumnDataSource(_thinned(curve, *self.whole))
            has_entry = bool(curve.label) and is_first
            given: dict[str, Any] = {"legend_label": curve.label} if has_entry else {}
            draw = plot.step if curve.is_step else plot.line
            line = draw(
                "x", "y", source=source, line_color=colours[curve.role], line_width=curve.width,
                line_dash=_DASHES[curve.dash], **given,
                **({"mode": "after"} if curve.is_step else {}),
            )  # fmt: skip
            self.sources.append((curve, source))
            if curve.label in self.lines:
                self.lines[curve.label].js_link("visible", line, "visible")
            elif curve.label:
                self.lines[curve.label] = line
        if plot.legend:
            style_legend(plot, self.scheme)
            _wrap_legend(plot)
        if self._selected is not None:
            self._add_span(plot)
        self.plots.append(plot)

    def _add_span(self, plot: Any) -> None:
        parts = bokeh("models")
        mark = parts.BoxAnnotation(
            left=0.0, right=0.0, visible=False, fill_color=SCHEMES[self.scheme]["second"],
            fill_alpha=0.15, line_color=SCHEMES[self.scheme]["second"], line_dash="dashed",
        )  # fmt: skip
        plot.add_layout(mark)
        self.marks.append(mark)
        box = parts.BoxSelectTool(dimensions="width", description="Mark a span")
        plot.add_tools(box)
        plot.on_event("selectiongeometry", self._marked)

    def _marked(self, event: Any) -> None:
        geometry = event.geometry
        if self._selected is not None and event.final and geometry.get("type") == "rect":
            self.mark(geometry["x0"], geometry["x1"])
            self._selected(geometry["x0"], geometry["x1"])

    def mark(self, low: float, high: float) -> None:
        """Show a span as marked; an empty one removes the mark."""
        for mark in self.marks:
            mark.update(left=low, right=high, visible=high > low)

    def _zoomed(self, attr: str, old: float, new: float) -> None:
        low, high = self.range.start, self.range.end
        if low is None or high is None or not high > low or (low, high) == self._shown[:2]:
            return
        self._shown = (low, high, self._shown[2] + 1)
        for curve, source in self.sources:
            if len(curve.time) > 2 * BUCKETS:
                source.data = _thinned(curve, low, high)

    def replace(self, number: int, curve: Curve) -> None:
        """Other samples for one of the curves, in the order in which they were given."""
        source = self.sources[number][1]
        self.sources[number] = (curve, source)
        source.data = _thinned(curve, self.range.start, self.range.end)


def _thinned(curve: Curve, low: float, high: float) -> dict[str, FloatArray]:
    """What a window from `low` to `high` shows of a curve, and a sample beyond either end."""
    first = max(int(np.searchsorted(curve.time, low)) - 1, 0)
    last = min(int(np.searchsorted(curve.time, high, "right")) + 1, len(curve.time))
    time, values = curve.time[first:last], np.asarray(curve.values[first:last], dtype=float)
    if len(time) > 2 * BUCKETS:
        # A sample that is missing is no extreme; the line has a gap where a bucket has none else.
        rows = thinned(time, [np.nan_to_num(values, nan=float(np.nanmean(values)))
                              if np.isnan(values).any() else values], BUCKETS)  # fmt: skip
        time, values = time[rows], values[rows]
    return {"x": time, "y": values}


def sparkline(values: FloatArray, width: int = 130, height: int = 22) -> str:
    """A curve (n,) as a small picture: its least and largest value in every two pixels."""
    known = np.asarray(values, dtype=float)
    known = known[np.isfinite(known)]
    if len(known) < 2 or not np.ptp(known) > 0.0:
        return f'<svg class="spark" width="{width}" height="{height}" aria-hidden="true"></svg>'
    rows = thinned(np.arange(len(known), dtype=float), [known], width // 2)
    x = 1.0 + (width - 2) * rows / (len(known) - 1)
    y = 1.0 + (height - 2) * (known.max() - known[rows]) / np.ptp(known)
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))
    return (
        f'<svg class="spark" width="{width}" height="{height}" aria-hidden="true">'
        f'<polyline points="{points}"/></svg>'
    )


__all__ = ["BUCKETS", "Curve", "TracePanel", "TraceView", "overlay_role", "sparkline", "trial_role"]
