"""Residual: what is measured less what the model gives, over anything that was measured."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sysid import signals
from sysid.app import parts
from sysid.app.parts import pn
from sysid.app.screens.base import Screen
from sysid.app.traces import Curve, TracePanel, TraceView
from sysid.app.workbench import NOTHING_FITTED, StepMissingError
from sysid.blocks.figures import Scale
from sysid.blocks.interactive import SCHEMES, add_zoom, bokeh, empty_plot
from sysid.blocks.numbers import number
from sysid.errors import InputError
from sysid.io.channels import VALVE_COMMANDS, VELOCITY_CHANNELS, Channel, channel_of
from sysid.pipeline.explore import ExploredTest
from sysid.types import FloatArray
from sysid.validation.shown_residuals import binned
from sysid.validation.shown_tests import NOISE_BAND

_TIME, _SPEED = "time", "speed"
# Points of the cloud: what a browser moves without a stutter.
_MOST_POINTS = 6000


@dataclass(frozen=True)
class ResidualContent:
    """The training tests as the chosen bundle's model gives them."""

    tests: tuple[ExploredTest, ...]
    bundles: tuple[Path, ...]
    chosen: Path


class ResidualScreen(Screen):
    """Where a model fails, before anything is named."""

    title = "Residual"

    def __init__(self, window: Any) -> None:
        super().__init__(window)
        self.chosen: Path | None = None
        self.channel = ""
        self.regressor = _SPEED
        self.test = 0
        self.content: ResidualContent | None = None
        self.brushed: dict[int, list[int]] = {}
        self.cloud: Any = None
        self.head = parts.html("")
        self.plot = parts.column()
        self.said = parts.html("")
        self.traces = parts.column()
        self.marks: list[Any] = []

    def read(self) -> ResidualContent:
        bench = self.bench
        bench.campaign()
        bundles = tuple(bench.bundles())
        if self.chosen not in bundles:
            self.chosen = bench.best_bundle()
        if self.chosen is None:
            raise StepMissingError(NOTHING_FITTED, "fit")
        found = bench.explored(self.chosen)
        if not found:
            what = "the campaign has no training test of motion; add one"
            raise InputError(f"{what}, or look at the diagnosis of the part on the screen Effects")
        return ResidualContent(found, bundles, self.chosen)

    # --- drawing --------------------------------------------------------------------------

    def draw(self, content: ResidualContent) -> list[Any]:
        self.content = content
        known = _channels(content)
        self.channel = self.channel if self.channel in known else known[0]
        self.test = min(self.test, len(content.tests) - 1)
        self._redraw()
        return [self.head, self.plot, self.said, self.traces]

    def _redraw(self) -> None:
        content = self.content
        assert content is not None
        self.brushed = {}
        regressors = _regressors(content)
        if self.regressor not in regressors:
            self.regressor = _TIME
        bundles = [(self.bench.named(p), self.bench.named(p)) for p in content.bundles]
        channels = [(n, channel_of(n).title) for n in _channels(content)]
        chosen, unit = self.bench.named(content.chosen), channel_of(self.channel).residual_unit
        band = f"± {number(self._noise(content), 2)} {parts.words(unit)}"
        self.head.object = (
            "<h2>Residual</h2><p>Measured less simulated, open loop from the first row, on the "
            "training tests. Line: median; shaded: the middle 90 %. The sensor's noise alone would "
            f"keep 95 % of the samples within {band} (the narrow band about 0). Mark points with "
            "the box or the lasso: their rows are marked below.</p>"
            f"<div class='bar2'>{parts.select('res-channel', channels, self.channel, 'Channel')} "
            f"over {parts.select('res-over', list(regressors.items()), self.regressor, 'Over')} "
            f"of {parts.select('res-bundle', bundles, chosen, 'Bundle')}</div>"
        )
        self.plot.objects = [pn.pane.Bokeh(self._cloud(), sizing_mode="stretch_width")]
        self._draw_traces()

    def _cloud(self) -> Any:
        content, shown = self.content, channel_of(self.channel)
        assert content is not None
        x, y, tests, rows = self._points(content)
        noise = self._noise(content)
        axis = _axis(content, self.regressor)
        colours, models = SCHEMES[self.window.scheme], bokeh("models")
        plot = empty_plot(axis, Scale(f"{shown.title}, residual", shown.residual_unit),
                          self.window.scheme, 360)  # fmt: skip
        add_zoom(plot)
        plot.toolbar.autohide = False
        plot.add_layout(models.BoxAnnotation(
            bottom=-noise, top=noise, fill_color=colours["band"], fill_alpha=0.25, line_color=None,
        ))  # fmt: skip
        kept = np.random.default_rng(0).permutation(len(x))[:_MOST_POINTS]
        source = models.ColumnDataSource(
            {"x": x[kept], "y": y[kept], "test": tests[kept], "row": rows[kept]}
        )
        plot.scatter(
            "x", "y", source=source, size=3, color=colours["measured"], alpha=0.5,
            selection_color=colours["model"], selection_alpha=0.9, nonselection_alpha=0.25,
        )  # fmt: skip
        centre, low, middle, high = binned(x, y)
        plot.varea(centre, low, high, fill_color=colours["second"], fill_alpha=0.15)
        plot.line(centre, middle, line_color=colours["second"], line_width=2)
        lasso, box = models.LassoSelectTool(), models.BoxSelectTool()
        plot.add_tools(box, lasso)
        plot.toolbar.active_drag = box
        source.selected.on_change("indices", self._brush)
        self.cloud = source
        return plot

    def _points(self, content: ResidualContent) -> tuple[FloatArray, FloatArray, Any, Any]:
        """Regressor and residual of every sample, its test and its row, (n,) each."""
        scale = channel_of(self.channel).residual_scale
        found = []
        for place, test in enumerate(content.tests):
            x = _values(test, self.regressor)
            if x is None or self.channel not in test.simulated:
                continue
            y = test.residual(self.channel) * scale
            keep = np.isfinite(x) & np.isfinite(y)
            rows = np.flatnonzero(keep)
            found.append((x[keep], y[keep], np.full(len(rows), place), rows))
        if not found:
            raise InputError(f"no test has both {self.channel} and {self.regressor}; choose others")
        x, y, tests, rows = (np.concatenate(one) for one in zip(*found, strict=True))
        return x, y, tests, rows

    def _noise(self, content: ResidualContent) -> float:
        """Half of the band of the channel's own noise, in the residual's unit."""
        floors = [signals.noise_floor(test.trial[self.channel]).total
                  for test in content.tests if self.channel in test.trial]  # fmt: skip
        return float(NOISE_BAND * np.median(floors) * channel_of(self.channel).residual_scale)

    def _brush(self, attr: str, old: Any, new: list[int]) -> None:
        data = self.cloud.data
        self.brushed = {}
        for index in new:
            self.brushed.setdefault(int(data["test"][index]), []).append(int(data["row"][index]))
        if self.brushed and self.test not in self.brushed:
            self.test = max(self.brushed, key=lambda place: len(self.brushed[place]))
            self._draw_traces()
        self._mark()

    def _mark(self) -> None:
        """The brushed rows in the traces, and how many there are in each test."""
        content = self.content
        assert content is not None
        rows = np.array(sorted(self.brushed.get(self.test, [])), dtype=int)
        for source, time, values in self.marks:
            source.data = {"x": time[rows], "y": values[rows]}
        buttons = " ".join(
            parts.button(f"{content.tests[place].trial.title}: {len(own)}", f"res-test:{place}",
                         kind="small")
            for place, own in sorted(self.brushed.items())
        )  # fmt: skip
        self.said.object = f"<p>Marked points by test: {buttons}</p>" if buttons else ""

    def _draw_traces(self) -> None:
        content, channel = self.content, channel_of(self.channel)
        assert content is not None
        test = content.tests[self.test]
        if self.channel not in test.simulated:
            self.traces.objects = []
            return
        time = test.trial.since_start
        measured = test.trial[self.channel] * channel.scale
        simulated = test.simulated[self.channel] * channel.scale
        residual = test.residual(self.channel) * channel.residual_scale
        above = (Curve(time, measured, "measured", "measured", width=2.2),
                 Curve(time, simulated, "model", "model"))  # fmt: skip
        below = (Curve(time, residual, "", "model", width=1.0),)
        view = TraceView(
            (TracePanel(Scale(channel.title, channel.unit), above),
             TracePanel(Scale("Residual", channel.residual_unit), below,
                        noise=self._noise(content))),
            self.window.scheme,
        )  # fmt: skip
        self.marks = []
        for plot, values in zip(view.plots, (measured, residual), strict=True):
            source = bokeh("models").ColumnDataSource({"x": [], "y": []})
            plot.scatter(
                "x", "y", source=source, size=5, color=SCHEMES[self.window.scheme]["fourth"]
            )
            self.marks.append((source, time, values))
        titles = [(str(i), t.trial.title) for i, t in enumerate(content.tests)]
        fit = number(test.rmse()[self.channel] * channel.residual_scale)
        head = (f"<div class='bar2'>{parts.select('res-test', titles, str(self.test), 'Test')} "
                f"RMSE {fit} {parts.words(channel.residual_unit)}</div>")  # fmt: skip
        pane = pn.pane.Bokeh(view.layout(), sizing_mode="stretch_width")
        self.traces.objects = [parts.html(head), pane]
        self._mark()

    # --- what is done ---------------------------------------------------------------------

    async def do(self, what: str, value: Any) -> None:
        act, _, rest = what.partition(":")
        if act == "res-channel":
            self.channel = str(value)
            self._redraw()
        elif act == "res-over":
            self.regressor = str(value)
            self._redraw()
        elif act == "res-test":
            self.test = int(rest or value)
            self._draw_traces()
        elif act == "res-bundle":
            self.chosen = self.bench.folder / str(value)
            self.bench.changes += 1
        else:
            await super().do(what, value)


def _channels(content: ResidualContent) -> list[str]:
    return list(dict.fromkeys(name for test in content.tests for name in test.simulated))


def _regressors(content: ResidualContent) -> dict[str, str]:
    """What the residual may be drawn over, with its title."""
    names = list(dict.fromkeys(n for test in content.tests for n in test.trial.channels))
    titles = {_TIME: "time", _SPEED: "velocity"}
    return titles | {n: channel_of(n).title.lower() for n in names}


def _values(test: ExploredTest, regressor: str) -> FloatArray | None:
    trial = test.trial
    if regressor == _TIME:
        return trial.since_start
    if regressor == _SPEED:
        name = next((n for n in VELOCITY_CHANNELS if n in trial), None)
        if name is None:
            return None
        return signals.filtered_speed(trial[name] * channel_of(name).scale, trial.period)
    scale = 1.0 if regressor in VALVE_COMMANDS else channel_of(regressor).scale
    return trial[regressor] * scale if regressor in trial else None


def _axis(content: ResidualContent, regressor: str) -> Scale:
    if regressor == _TIME:
        return Scale("Time", "s")
    if regressor == _SPEED:
        name = next((n for n in VELOCITY_CHANNELS if n in content.tests[0].trial), "theta_rad")
        return Scale("Velocity", f"{channel_of(name).unit}/s")
    channel: Channel = channel_of(regressor)
    return Scale(channel.title, channel.unit)


__all__ = ["ResidualScreen"]
