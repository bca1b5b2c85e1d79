"""Effects: what the diagnosis found, and an effect tried by hand, with what it changes at once."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sysid.app import parts
from sysid.app.parts import pn
from sysid.app.screens.base import Screen
from sysid.app.traces import Curve, TracePanel, TraceView
from sysid.blocks.figures import Scale
from sysid.blocks.numbers import number
from sysid.blocks.sections import Section
from sysid.errors import Failure, InputError, on_its_own
from sysid.io.campaign import Campaign
from sysid.io.channels import channel_of
from sysid.io.files import make_folder
from sysid.parameters import Bundle
from sysid.pipeline.effects import known_effects
from sysid.pipeline.explore import ExploredTest, chosen_bundle, explore, motion_tests
from sysid.pipeline.files import write_bundle
from sysid.pipeline.pages.report import report_parts
from sysid.pipeline.run import RunOptions, expected_seconds

_LOOKS = "held-out looks"
EXPLORED = "explored.json"
# A slider of a strength without a bound reaches so many typical sizes.
_REACH = 4.0


@dataclass(frozen=True)
class EffectsContent:
    """The campaign and its base bundle; tests without the effect; the diagnosis; the catalogue."""

    campaign: Campaign
    base: Path | None
    bundle: Bundle | None
    tests: tuple[ExploredTest, ...]
    why: str
    diagnosis: dict[str, Any] | None
    section: Section | None
    known: dict[str, Any] = field(default_factory=dict)


class EffectsScreen(Screen):
    """An effect by its name: found, or tried."""

    title = "Effects"

    def __init__(self, window: Any) -> None:
        super().__init__(window)
        self.content: EffectsContent | None = None
        self.effect: Any = None
        self.channel = ""
        self.test = 0
        self.frozen = False
        self.view: TraceView | None = None
        self.head = parts.html("")
        self.list = parts.html("")
        self.controls = parts.html("")
        self.values = parts.html("")
        self.table = parts.html("")
        self.plot = parts.column()
        self.held_out = parts.html("")

    def read(self) -> EffectsContent:
        bench, campaign = self.bench, self.bench.campaign()
        linear = campaign.rig.is_linear
        known = {e.id: e for e in known_effects(bench.effects_file(), linear=linear).effects}
        found = bench.diagnosis()
        base = next((p for p in (bench.result("fitted.json"), bench.best_bundle())
                     if p is not None and p in bench.bundles()), None)  # fmt: skip
        if base is None:
            why = "Nothing was fitted yet: an effect is tried on a fitted model. Fit the campaign, "
            why += "or run the diagnosis, which fits it first."
            return EffectsContent(campaign, None, None, (), why, found, None, known)
        bundle, why = bench.bundle(base), ""
        path = base
        tests: Any = on_its_own(lambda: bench.explored(path))
        if isinstance(tests, Failure):
            tests, why = (), tests.reason
        elif not tests:
            why = "the campaign has no training test of motion to simulate"
        section = _diagnosed(campaign, bundle, found)
        return EffectsContent(campaign, base, bundle, tests, why, found, section, known)

    # --- drawing --------------------------------------------------------------------------

    def draw(self, content: EffectsContent) -> list[Any]:
        self.content = content
        self.head.object = self._head(content)
        self.list.object = self._list(content)
        inner = (self.controls, self.values, self.table, self.plot, self.held_out)
        self._draw_choice()
        panes = [self.head, parts.beside([self.list], inner)]
        if content.section is not None:
            # Its sentence stands at the top.
            panes.append(self.section_place(dataclasses.replace(content.section, intro=())))
        return panes

    def _head(self, content: EffectsContent) -> str:
        run = parts.button("Run the diagnosis", "fx-run", kind="primary",
                           title="sysid run: what is missing of it is done")  # fmt: skip
        said = "The diagnosis has not been run: it gives the verdict."
        if content.section is not None:
            said = " ".join(content.section.intro[:1])
        return f"<h2>Effects</h2><p class='sentence'>{parts.words(said)}</p><p>{run}</p>"

    def _list(self, content: EffectsContent) -> str:
        """The suspects of the diagnosis by their evidence, then the rest of the catalogue."""
        gains = _gains(content.diagnosis)
        found = {e["id"] for e in (content.diagnosis or {}).get("effects", ())}

        def rank(id: str) -> tuple[bool, float, float]:
            gain, chance = gains.get(id, (-math.inf, 1.0))
            return id not in found, chance, -gain

        order = sorted(content.known, key=rank)
        lines = []
        for id in order:
            effect = content.known[id]
            on = self.effect is not None and self.effect.id == id
            show = parts.button("", f"fx-choose:{id}", kind="row", title=effect.signature)
            mark = " <b>(found)</b>" if id in found else ""
            named = f">{parts.words(effect.title)}{mark}<small>{id}</small></button>"
            show = show.replace("></button>", named)
            row = ["class:on" if on else "class:", show]
            if gains or found:
                cells = ["", ""]
                if id in gains:
                    gain, chance = gains[id]
                    cells = [f"<nobr>{one}</nobr>" for one in (number(gain, 3), _rounded(chance))]
                row += cells
            lines.append(row)
        if not gains and not found:  # before a diagnosis no effect has any evidence
            return parts.rows(("Effect",), lines)
        said = _CAPTION if gains else ""
        return parts.rows(("Effect", "Evidence", "p"), lines, said)

    def _draw_choice(self) -> None:
        content = self.content
        assert content is not None
        if self.effect is None or not content.tests:
            hint = content.why or "Choose an effect to see what it would change."
            self.controls.object = parts.note(hint, "warn" if content.why else "muted")
            self.values.object = self.table.object = self.held_out.object = ""
            self.plot.objects = []
            return
        self.controls.object = self._controls()
        self._simulate(anew=True)

    def _controls(self) -> str:
        effect = self.effect
        lines = []
        for place, quantity in enumerate(type(effect).quantities):
            value = getattr(effect, quantity.name)
            low, high = _reach(quantity)
            if quantity.is_choice:
                options = [(repr(v), quantity.form(v) or f"{v:g}") for v in quantity.grid]
                control = parts.select(f"fx-set:{place}", options, repr(value), quantity.label)
            else:
                step = (high - low) / 200
                control = parts.slider(f"fx-set:{place}", low, high, step, value, quantity.label)
            kind = "strength" if quantity.is_strength else "shape"
            lines.append([f"<b>{parts.words(quantity.label)}</b><small>{kind}: "
                          f"{parts.words(quantity.title)}</small>", control])  # fmt: skip
        if type(effect).has_side():
            sides = [("a", "A"), ("b", "B"), ("both", "both")]
            lines.append(["<b>side</b>", parts.select("fx-side", sides, effect.side, "Side")])
        label = "<span class='label-exploration'>exploration</span>"
        text = f"<h3>{parts.words(effect.title)} {label}</h3>"
        text += parts.note(f"Shows in: {effect.signature}")
        return text + parts.rows(("", ""), lines)

    def _simulate(self, *, anew: bool = False) -> None:
        """The tests with the effect as it stands, over those without it."""
        content, effect = self.content, self.effect
        assert content is not None and content.bundle is not None
        pairs = [(test.entry, test.trial) for test in content.tests]
        after = explore(pairs, content.campaign.rig, content.bundle, [effect],
                        self.bench.effects_file())  # fmt: skip
        self.values.object = "<p><code>" + parts.words(_said(effect)) + "</code></p>"
        names = list(dict.fromkeys(n for test in content.tests for n in test.simulated))
        self.channel = self.channel if self.channel in names else names[0]
        self.test = min(self.test, len(after) - 1)
        self.table.object = self._errors(content.tests, after, names)
        self._draw_trace(content.tests[self.test], after[self.test], anew=anew)
        self.held_out.object = self._freeze()

    def _errors(self, before: Any, after: Any, names: list[str]) -> str:
        lines = []
        for place, (one, two) in enumerate(zip(before, after, strict=True)):
            title = parts.button(one.trial.title, f"fx-test:{place}", kind="row")
            cells = [f"class:{'on' if place == self.test else ''}", title]
            for name in names:
                cells.append(_change(one, two, name))
            lines.append(cells)
        heads = [f"{channel_of(n).title}, {channel_of(n).residual_unit}" for n in names]
        return parts.rows(("RMSE without → with", *heads), lines)

    def _draw_trace(self, before: ExploredTest, after: ExploredTest, *, anew: bool) -> None:
        name = self.channel if self.channel in before.simulated else next(iter(before.simulated))
        channel = channel_of(name)
        time = before.trial.since_start
        scale, residual_scale = channel.scale, channel.residual_scale
        curves = (
            Curve(time, before.trial[name] * scale, "measured", "measured", width=2.4),
            Curve(time, before.simulated[name] * scale, "without", "second", "dashed"),
            Curve(time, after.simulated[name] * scale, "with", "model"),
            Curve(time, before.residual(name) * residual_scale, "", "second", width=1.0),
            Curve(time, after.residual(name) * residual_scale, "", "model", width=1.0),
        )
        if not anew and self.view is not None:
            for place in (2, 4):
                self.view.replace(place, curves[place])
            return
        panels = (
            TracePanel(Scale(channel.title, channel.unit), curves[:3]),
            TracePanel(Scale("Residual", channel.residual_unit), curves[3:]),
        )
        self.view = TraceView(panels, self.window.scheme)
        titles = [(n, channel_of(n).title) for n in before.simulated]
        head = parts.select("fx-channel", titles, name, "Channel")
        pane = pn.pane.Bokeh(self.view.layout(), sizing_mode="stretch_width")
        self.plot.objects = [parts.html(f"<div class='bar2'>{head}</div>"), pane]

    def _freeze(self) -> str:
        looks = int(self.bench.journal.kept.get(_LOOKS, 0))
        refit = parts.button("Refit base", "fx-refit", title="sysid refine, from this choice")
        text = f"<div class='bar2'>{parts.button('Freeze this choice', 'fx-freeze')} {refit} "
        text += parts.button("Look at the held-out tests", "fx-held-out", off=not self.frozen)
        text += f"</div><p class='muted'>Held-out tests looked at: {_times(looks)}. "
        text += "They are shown once the choice is frozen; the count is in the report. "
        text += f"A frozen choice is results/{EXPLORED}, marked <code>chosen_by: user</code>.</p>"
        return text

    # --- what is done ---------------------------------------------------------------------

    async def do(self, what: str, value: Any) -> None:
        act, _, rest = what.partition(":")
        if act == "fx-choose":
            self._choose(rest)
        elif act == "fx-set":
            self._set(int(rest), value)
        elif act == "fx-side":
            self.frozen = False
            self.effect = dataclasses.replace(self.effect, side=str(value))
            self._simulate()
        elif act in ("fx-channel", "fx-test"):
            self.channel = str(value) if act == "fx-channel" else self.channel
            self.test = int(rest) if act == "fx-test" else self.test
            self._simulate(anew=True)
        elif act == "fx-freeze":
            self._write()
            self.frozen = True
            self._simulate()
        elif act == "fx-refit":
            self._refit()
        elif act == "fx-held-out" and self.frozen:
            self._look_at_held_out()
        elif act == "fx-run":
            self._run()
        else:
            await super().do(what, value)

    def _choose(self, id: str) -> None:
        content = self.content
        assert content is not None
        kind = content.known[id]
        found = {e["id"]: e for e in (content.diagnosis or {}).get("effects", ())}
        given = found.get(id, {}).get("parameters", {})
        values = {q.name: given[q.label]["value"] for q in kind.quantities
                  if isinstance(given.get(q.label), dict)}  # fmt: skip
        side = {"side": given["side"]} if isinstance(given.get("side"), str) else {}
        self.effect = kind.typical(**values, **side)
        self.frozen = False
        self.list.object = self._list(content)
        self._draw_choice()

    def _set(self, place: int, value: Any) -> None:
        quantity = type(self.effect).quantities[place]
        self.effect = dataclasses.replace(self.effect, **{quantity.name: float(value)})
        self.frozen = False
        self._simulate()

    def _write(self) -> Path:
        """The base bundle with the choice, written where it is frozen."""
        content = self.content
        assert content is not None and content.bundle is not None
        make_folder(self.bench.results)
        path = self.bench.result(EXPLORED)
        looks = int(self.bench.journal.kept.get(_LOOKS, 0))
        write_bundle(chosen_bundle(content.bundle, [self.effect], looks), path)
        self.bench.show(f"{self.bench.named(path)}: {_said(self.effect)}, chosen_by user")
        return path

    def _refit(self) -> None:
        path = self.bench.named(self._write())
        campaign = self.bench.campaign().path.name
        words = ["refine", campaign, "--bundle", path, "-o", path]
        self.window.start("refitting the base", [*words, *self.bench.own_words(component=False)])

    def _look_at_held_out(self) -> None:
        """The errors on the held-out tests, counted; the count goes into the bundle."""
        content, bench = self.content, self.bench
        assert content is not None and content.bundle is not None
        tests = motion_tests(content.campaign, "holdout")
        if not tests:
            raise InputError("the campaign has no held-out test of motion; hold one out")
        bench.journal.keep(_LOOKS, int(bench.journal.kept.get(_LOOKS, 0)) + 1)
        self._write()
        rig, files = content.campaign.rig, bench.effects_file()
        before = explore(tests, rig, content.bundle, effects=files)
        after = explore(tests, rig, content.bundle, [self.effect], files)
        names = list(dict.fromkeys(n for test in before for n in test.simulated))
        lines = [[parts.words(one.trial.title), *(_change(one, two, n) for n in names)]
                 for one, two in zip(before, after, strict=True)]  # fmt: skip
        heads = [f"{channel_of(n).title}, {channel_of(n).residual_unit}" for n in names]
        table = parts.rows(("Held out: RMSE without → with", *heads), lines)
        self.held_out.object = self._freeze() + table

    def _run(self) -> None:
        bench = self.bench
        expected = expected_seconds(bench.results, RunOptions())
        self.window.start("diagnosing", bench.run_words(), expected)


def _change(before: ExploredTest, after: ExploredTest, name: str) -> str:
    """An error without and with the effect, in the residual's unit."""
    if name not in before.simulated:
        return ""
    scale = channel_of(name).residual_scale
    one, two = before.rmse()[name] * scale, after.rmse()[name] * scale
    if not np.isfinite(two):
        return f"{number(one)} → does not end"
    kind = "good" if two < one else "poor" if two > one else ""
    return f'{number(one)} → <span class="{kind}">{number(two)}</span>'


def _said(effect: Any) -> str:
    """The effect with its numbers."""
    numbers = (
        f"{q.label} = {getattr(effect, q.name):.4g} {'' if q.unit == '-' else q.unit}".rstrip()
        for q in type(effect).quantities
    )
    side = (f"side = {effect.side}",) if type(effect).has_side() else ()
    return f"{effect.id}: {', '.join((*numbers, *side))}"


_CAPTION = (
    "Evidence beyond that on logs that lack nothing, next to what was found; "
    "p: how often those show as much"
)


def _times(count: int) -> str:
    return "never" if count == 0 else "once" if count == 1 else f"{count} times"


def _reach(quantity: Any) -> tuple[float, float]:
    """Where a slider begins and ends: within its bounds, a few typical sizes about zero."""
    if not quantity.is_strength:
        grid = (*quantity.grid, quantity.typical)
        low, high = min(grid), max(grid)
        return (low, high) if high > low else (0.5 * low, 2.0 * high)
    size = _REACH * abs(quantity.typical or max(map(abs, quantity.grid), default=1.0))
    low = max(quantity.lower, -size) if quantity.lower < 0.0 else max(quantity.lower, 0.0)
    return low, min(quantity.upper, size)


def _rounded(p: float) -> str:
    """A p-value; what extrapolates from a few twins is not written out."""
    return number(p, 2) if p >= 1e-3 else "< 0.001"


def _gains(diagnosis: dict[str, Any] | None) -> dict[str, tuple[float, float]]:
    """The evidence for each suspect, beyond that on twins, with its p-value.

    Of an effect that was added, in the round that added it; of another, next to all that were.
    """
    found: dict[str, tuple[float, float]] = {}
    added: set[Any] = set()
    for look in (diagnosis or {}).get("figures", {}).get("looks", ()):
        for suspect in look["suspects"]:
            if isinstance(suspect.get("gain"), int | float) and suspect["id"] not in added:
                beyond = float(suspect["gain"]) - max(suspect.get("twins", ()), default=0.0)
                found[suspect["id"]] = max(beyond, 0.0), float(suspect.get("p_value", 1.0))
        added = {*added, look.get("added")} - set(look.get("removed", ()))
    return found


def _diagnosed(
    campaign: Campaign, bundle: Bundle, diagnosis: dict[str, Any] | None
) -> Section | None:
    """What the report says of the diagnosis, its figures not drawn yet."""
    if diagnosis is None:
        return None
    for id, title, _, build in report_parts(campaign, bundle, None, diagnosis):
        if id == "diagnosis":
            section = on_its_own(build)
            if isinstance(section, Failure):
                return Section(id, title, (f"This cannot be shown: {section.reason}.",))
            return section
    return None


__all__ = ["EffectsScreen"]
