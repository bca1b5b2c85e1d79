"""Compare: bundles over one another, their numbers, what moved, and the tests under each."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.app import parts
from sysid.app.parts import pn
from sysid.app.screens.base import Screen
from sysid.app.traces import Curve, TracePanel, TraceView, overlay_role
from sysid.app.workbench import NOTHING_FITTED, StepMissingError, command_line
from sysid.blocks.figures import Scale
from sysid.blocks.html import block_html
from sysid.blocks.numbers import number
from sysid.errors import Failure, InputError, grouped, on_its_own, together
from sysid.io.channels import channel_of
from sysid.pipeline.compare import compare
from sysid.pipeline.explore import ExploredTest

_MOST_BUNDLES = 5
# Height of the panel of the residuals, which shows what the curves above hide.
_RESIDUAL_HEIGHT = 0.65
_USUAL = ("fitted.json", "bundle.json")


@dataclass(frozen=True)
class CompareContent:
    """The bundles that there are, those chosen, their comparison, and the tests under each."""

    paths: tuple[Path, ...]
    chosen: tuple[Path, ...]
    compared: Any
    tests: tuple[tuple[ExploredTest, ...], ...]
    why: str


class CompareScreen(Screen):
    """Two models or more next to each other."""

    title = "Compare"

    def __init__(self, window: Any) -> None:
        super().__init__(window)
        self.chosen: list[str] | None = None
        self.test = 0
        self.content: CompareContent | None = None
        self.head = parts.html("")
        self.plot = parts.column()

    def read(self) -> CompareContent:
        bench = self.bench
        paths = tuple(bench.bundles())
        names = {bench.named(path): path for path in paths}
        if not paths:
            raise StepMissingError(NOTHING_FITTED, "fit")
        if self.chosen is None:
            # What a diagnosis and a refinement have changed of the fit.
            usual = [n for n in map(bench.named, map(bench.result, _USUAL)) if n in names]
            self.chosen = usual if len(usual) == len(_USUAL) else list(names)[:2]
        chosen = tuple(names[name] for name in self.chosen if name in names)
        bundles = [bench.bundle(path) for path in chosen]
        if len(bundles) < 2:
            return CompareContent(paths, chosen, None, (), "")
        found = compare(*bundles)
        tests = on_its_own(lambda: self._tests(chosen))
        if isinstance(tests, Failure):
            return CompareContent(paths, chosen, found, (), tests.reason)
        return CompareContent(paths, chosen, found, tests, "")

    def _tests(self, chosen: tuple[Path, ...]) -> tuple[tuple[ExploredTest, ...], ...]:
        found = tuple(self.bench.explored(path) for path in chosen)
        if not found[0]:
            raise InputError("the campaign has no training test of motion to simulate")
        return found

    # --- drawing --------------------------------------------------------------------------

    def draw(self, content: CompareContent) -> list[Any]:
        self.content = content
        self.head.object = self._head(content)
        if content.compared is None:
            return [self.head, parts.html(parts.note("Choose two bundles or more."))]
        self._draw_traces()
        tables = "".join(block_html(t) for t in content.compared.tables() if t.rows)
        notices = parts.listed(grouped(together(content.compared.notices)))
        responses = content.compared.responses
        # Where no number has an error in both, none was compared: there is nothing to draw.
        against = [content.compared.figure()] if content.compared.movements else []
        figures = [*against, *(responses.figures() if responses else ())]
        panes = [parts.figure_pane(figure, self.window.scheme) for figure in figures]
        heading = (
            f"<p class='sentence'>{parts.words(content.compared.headline(is_titled=True))}</p>"
        )
        why = parts.note(content.why, "warn") if content.why else ""
        return [
            self.head, parts.html(heading + why), self.plot, parts.grid(panes),
            parts.html(tables + notices),
        ]  # fmt: skip

    def _head(self, content: CompareContent) -> str:
        ticks = "".join(
            parts.tick(f"cmp:{i}", self.bench.named(path), path in content.chosen)
            for i, path in enumerate(content.paths)
        )
        words = ["compare", *map(self.bench.named, content.chosen)]
        line = f"<p><code>{parts.words(command_line(words))}</code></p>" if content.chosen else ""
        return f"<h2>Compare</h2><div class='bar2'>{ticks}</div>{line}"

    def _draw_traces(self) -> None:
        content = self.content
        assert content is not None
        if not content.tests:
            self.plot.objects = []
            return
        self.test = min(self.test, len(content.tests[0]) - 1)
        first = content.tests[0][self.test]
        time, panels = first.trial.since_start, []
        names = [self.bench.named(path) for path in content.chosen]
        for channel in map(channel_of, first.simulated):
            curves = [Curve(time, first.trial[channel.key] * channel.scale, "measured", "measured",
                            width=2.4)]  # fmt: skip
            off = []
            for place, (name, tests) in enumerate(zip(names, content.tests, strict=True)):
                test, role = tests[self.test], overlay_role(place)
                values = test.simulated[channel.key] * channel.scale
                curves.append(Curve(time, values, name, role))
                residual = test.residual(channel.key) * channel.residual_scale
                off.append(Curve(time, residual, "", role, width=1.0))
            below = Scale("Residual", channel.residual_unit)
            panels.append(TracePanel(Scale(channel.title, channel.unit), tuple(curves)))
            panels.append(TracePanel(below, tuple(off), height=_RESIDUAL_HEIGHT))
        titles = [(str(i), t.trial.title) for i, t in enumerate(content.tests[0])]
        head = parts.select("cmp-test", titles, str(self.test), "Test")
        view = TraceView(panels, self.window.scheme, height=170)
        self.plot.objects = [
            parts.html(f"<div class='bar2'>{head}</div>{self._errors(names)}"),
            pn.pane.Bokeh(view.layout(), sizing_mode="stretch_width"),
        ]

    def _errors(self, names: list[str]) -> str:
        content = self.content
        assert content is not None
        lines = []
        for name, tests in zip(names, content.tests, strict=True):
            test = tests[self.test]
            rmse = test.rmse()
            cells = [number(rmse[n] * channel_of(n).residual_scale) for n in test.simulated]
            lines.append([f"<b>{parts.words(name)}</b>", *cells])
        first = content.tests[0][self.test]
        heads = [f"{channel_of(n).title}, {channel_of(n).residual_unit}" for n in first.simulated]
        return parts.rows(("RMSE on this training test", *heads), lines)

    # --- what is done ---------------------------------------------------------------------

    async def do(self, what: str, value: Any) -> None:
        act, _, rest = what.partition(":")
        if act == "cmp":
            assert self.content is not None and self.chosen is not None
            name = self.bench.named(self.content.paths[int(rest)])
            if name in self.chosen:
                self.chosen.remove(name)
            elif len(self.chosen) >= _MOST_BUNDLES:
                raise InputError(f"{_MOST_BUNDLES} bundles are shown; take one away first")
            else:
                self.chosen.append(name)
            self.bench.changes += 1
        elif act == "cmp-test":
            self.test = int(value)
            self._draw_traces()
        else:
            await super().do(what, value)


__all__ = ["CompareScreen"]
