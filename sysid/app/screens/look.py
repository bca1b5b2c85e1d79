"""Look: every test as a row, and the traces of those that are chosen, over one another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Any

import numpy as np

from sysid import signals
from sysid.app import edits, parts
from sysid.app.parts import pn
from sysid.app.screens.base import Screen
from sysid.app.traces import Curve, TracePanel, TraceView, sparkline, trial_role
from sysid.blocks import numbers
from sysid.blocks.figures import Scale
from sysid.errors import InputError
from sysid.io.campaign import Campaign, CampaignLog
from sysid.io.channels import CHAMBER_PRESSURES, VALVE_COMMANDS, VELOCITY_CHANNELS, channel_of
from sysid.io.rig import Rig
from sysid.io.samples import Trial
from sysid.io.trial_kind import is_held

# More tests than these over one another are not distinguished.
_MOST_OVERLAID = 6
# More rows than these are folded by log.
_MOST_ROWS = 400


@dataclass(frozen=True, eq=False)
class TestRow:
    """A test as it is listed: the log's number, its entry, and its samples; or why it has none."""

    __test__ = False

    number: int
    entry: CampaignLog
    trial: Trial | None
    why: str = ""

    @property
    def key(self) -> str:
        """Which test it is, over changes of other logs."""
        return f"{self.entry.file}\n{self.trial.label if self.trial else ''}"


def test_rows(screen: Screen) -> list[TestRow]:
    """Every test of the campaign, with all of its rows where those can be read."""
    campaign = screen.bench.campaign()
    return list(_rows(screen, campaign))


def _rows(screen: Screen, campaign: Campaign) -> Iterator[TestRow]:
    for number, entry in enumerate(campaign.logs):
        try:
            try:  # what is excluded is shown too, shaded
                log = screen.bench.log(replace(entry, exclude=()))
            except InputError:
                log = screen.bench.log(entry)
        except InputError as error:
            yield TestRow(number, entry, None, str(error))
            continue
        for trial in log.trials:
            yield TestRow(number, entry, trial)


def main_channel(trial: Trial, rig: Rig) -> str:
    """The channel that shows best what a test is: the motion, a pressure where nothing moves."""
    places = [name for name in (rig.position_channel,) if name in trial]
    pressures = [name for name in CHAMBER_PRESSURES if name in trial]
    pressures.sort(key=lambda name: -float(np.ptp(trial[name])))
    order = [*pressures, *places] if is_held(trial, rig) else [*places, *pressures]
    return next((n for n in order if np.ptp(trial[n]) > 0.0), next(iter(trial.channels)))


class LookScreen(Screen):
    """The tests of a campaign by eye; spans and tests are excluded with a reason, or held out."""

    title = "Look"

    def __init__(self, window: Any) -> None:
        super().__init__(window)
        self.chosen: list[str] = []
        self.filtered = False
        self.derivative = False
        self.span: tuple[float, float] | None = None
        self.why = ""
        self.rows: list[TestRow] = []
        self.sparks: dict[int, str] = {}
        self.traces: TraceView | None = None
        self.list = parts.html("")
        self.bar = parts.html("")
        self.plot = parts.column()

    def read(self) -> list[TestRow]:
        return test_rows(self)

    def draw(self, content: list[TestRow]) -> list[Any]:
        self.rows = content
        self.sparks = {}
        known = {row.key for row in content}
        self.chosen = [key for key in self.chosen if key in known]
        if not self.chosen:
            self.chosen = [row.key for row in content if row.trial is not None][:1]
        self.list.object = self._list()
        self._draw_traces()
        return [parts.beside([self.list], [self.bar, self.plot])]

    # --- the list -------------------------------------------------------------------------

    def _list(self) -> str:
        lines = []
        for row in self.rows[:_MOST_ROWS]:
            lines.append(self._line(row))
        head = ("", "Test", "", "Length", "Use")
        more = len(self.rows) - _MOST_ROWS
        said = parts.note(f"and {more} more tests") if more > 0 else ""
        return "<h2>Tests</h2>" + parts.rows(head, lines) + said

    def _line(self, row: TestRow) -> list[str]:
        place = next(i for i, r in enumerate(self.rows) if r is row)
        entry, trial = row.entry, row.trial
        held = entry.use == "holdout"
        use = parts.button(
            "held out" if held else "training", f"look-use:{row.number}", kind="small",
            title="Train on this log" if held else "Hold this log out",
        )  # fmt: skip
        if trial is None:
            why = f'<span class="error">{parts.words(row.why)}</span>'
            return ["class:broken", "", parts.words(entry.file), why, "", use]
        on = row.key in self.chosen
        name = parts.words(PurePath(entry.file).stem)
        label = f" <b>{parts.words(trial.label)}</b>" if trial.label else ""
        box = (
            f'<input type="checkbox" data-do="look-over:{place}"{" checked" if on else ""} '
            f'aria-label="Show over the others">'
        )
        show = parts.button("", f"look-show:{place}", kind="row", title="Show this test alone")
        show = show.replace("></button>", f">{name}{label}<small>{entry.kind}</small></button>")
        excluded = [e for e in entry.exclude if e.test in ("", trial.label)]
        mark = f'<small class="warn">{len(excluded)} excluded</small>' if excluded else ""
        spark = self.sparks.get(id(trial))
        if spark is None:
            spark = self.sparks[id(trial)] = sparkline(trial[main_channel(trial, self.bench.rig())])
        length = f"{numbers.number(float(trial.time[-1] - trial.time[0]))} s{mark}"
        return ["class:on" if on else "class:", box, show, spark, length, use]

    # --- the traces -----------------------------------------------------------------------

    def _shown(self) -> list[TestRow]:
        return [r for r in self.rows if r.key in self.chosen and r.trial is not None]

    def _draw_traces(self) -> None:
        shown = self._shown()
        self.bar.object = self._bar(shown)
        if not shown:
            self.plot.objects = [parts.html(parts.note("Choose a test."))]
            return
        self.traces = TraceView(self.panels_of(shown), self.window.scheme, selected=self._select)
        if self.span is not None:
            self.traces.mark(*self.span)
        self.plot.objects = [pn.pane.Bokeh(self.traces.layout(), sizing_mode="stretch_width")]

    def panels_of(self, shown: Sequence[TestRow]) -> list[TracePanel]:
        trials = [row.trial for row in shown if row.trial is not None]
        names = list(dict.fromkeys(name for t in trials for name in t.channels))
        names.sort(key=lambda n: (n in VALVE_COMMANDS, not n.endswith(("_rad", "_m"))))
        bands = tuple(_excluded(shown[0])) if len(shown) == 1 else ()
        panels = []
        for name in names:
            channel = channel_of(name)
            curves: list[Curve] = []
            for number, trial in enumerate(trials):
                if name in trial:
                    label = trial.title if len(trials) > 1 else ""
                    curves += self._curves(trial, name, channel.scale, number, label)
            if not curves:
                continue
            unit = channel.unit
            panels.append(TracePanel(Scale(channel.title, unit), tuple(curves), bands))
            if self.derivative and name in VELOCITY_CHANNELS:
                panels.append(self._speed(trials, name, channel.scale, unit))
        return panels

    def _curves(
        self, trial: Trial, name: str, scale: float, number: int, label: str
    ) -> Iterator[Curve]:
        role = trial_role(number)
        is_step = name in VALVE_COMMANDS
        values, time = trial[name] * scale, trial.since_start
        if self.filtered and not is_step and len(values) > 30:
            raw = _raw_role(role)
            yield Curve(time, values, "raw" if not label else "", raw, width=1.0)
            smooth = signals.lowpass(values, trial.period)
            yield Curve(time, smooth, label or "filtered", role)
            return
        yield Curve(time, values, label, role, is_step=is_step)

    def _speed(self, trials: Sequence[Trial], name: str, scale: float, unit: str) -> TracePanel:
        curves = []
        for number, trial in enumerate(trials):
            if name in trial and len(trial) > 30:
                speed = signals.filtered_speed(trial[name] * scale, trial.period)
                curves.append(Curve(trial.since_start, speed, "", trial_role(number)))
        return TracePanel(Scale("Velocity, filtered", f"{unit}/s"), tuple(curves))

    def _bar(self, shown: Sequence[TestRow]) -> str:
        ticks = parts.tick("look-filtered", "filtered over raw", self.filtered)
        ticks += parts.tick("look-derivative", "velocity", self.derivative)
        head = f'<div class="bar2">{ticks}</div>'
        if len(shown) != 1:
            hint = "Tests over one another; show one alone to exclude a span of it."
            return head + (parts.note(hint) if shown else "")
        row = shown[0]
        assert row.trial is not None
        is_out = any(
            one.test in ("", row.trial.label) and one.from_s is None and one.to_s is None
            for one in row.entry.exclude
        )
        low, high = ("", "") if self.span is None else (f"{v:.6g}" for v in self.span)
        form = (
            f"<span>From {parts.entry('look-from', low, 'From, s', size=7)} s</span> "
            f"<span>to {parts.entry('look-to', high, 'To, s', size=7)} s because</span> "
            f"{parts.entry('look-why', self.why, 'Reason', size=22, hint='reason')} "
            + parts.button("Exclude the span", "look-exclude-span", off=is_out or self.span is None)
            + " "
            + parts.button("Exclude the whole test", "look-exclude-test", off=is_out)
        )
        named = parts.words(row.trial.title)
        listed = "".join(self._exclusion(row, i) for i in range(len(row.entry.exclude)))
        hint = parts.note("Drag with the box tool ▭ to mark a span, or type its times.")
        listed = f"<ul>{listed}</ul>" if listed else ""
        return f"<h3>{named}</h3>{head}<div class='bar2'>{form}</div>{hint}{listed}"

    def _exclusion(self, row: TestRow, place: int) -> str:
        one = row.entry.exclude[place]
        if row.trial is None or one.test not in ("", row.trial.label):
            return ""
        why = f": {one.why}" if one.why else ""
        again = parts.button("use it again", f"look-include:{place}", kind="small")
        return f"<li>excluded: {parts.words(one.title + why)} {again}</li>"

    def _select(self, low: float, high: float) -> None:
        start = self.traces.whole if self.traces else (low, high)
        self.span = (max(low, start[0]), min(high, start[1]))
        self.bar.object = self._bar(self._shown())

    # --- what is done ---------------------------------------------------------------------

    async def do(self, what: str, value: Any) -> None:
        act, _, rest = what.partition(":")
        if act in ("look-over", "look-show"):
            self._choose(self.rows[int(rest)].key, alone=act == "look-show")
        elif act == "look-filtered":
            self.filtered = bool(value)
            self._draw_traces()
        elif act == "look-derivative":
            self.derivative = bool(value)
            self._draw_traces()
        elif act in ("look-from", "look-to"):
            self._type_span(act, str(value))
        elif act == "look-why":
            self.why = str(value)
        elif act == "look-use":
            self._turn_use(int(rest))
        elif act in ("look-exclude-span", "look-exclude-test"):
            self._exclude(whole=act == "look-exclude-test")
        elif act == "look-include":
            (row,) = self._shown()
            edit = edits.included(row.number, row.entry.file, int(rest))
            self._change(f"{row.entry.file}: used again", edit)

    def _choose(self, key: str, *, alone: bool) -> None:
        if alone:
            self.chosen = [key]
        elif key in self.chosen:
            self.chosen.remove(key)
        elif len(self.chosen) >= _MOST_OVERLAID:
            raise InputError(f"{_MOST_OVERLAID} tests are shown; take one away first")
        else:
            self.chosen.append(key)
        self.span, self.why = None, ""
        self.list.object = self._list()
        self._draw_traces()

    def _type_span(self, act: str, text: str) -> None:
        try:
            number = float(text)
        except ValueError:
            raise InputError(f"{text!r} is no time; give seconds since the first row") from None
        whole = self.traces.whole if self.traces else (0.0, number)
        low, high = self.span or whole
        self.span = (number, high) if act == "look-from" else (low, number)
        if self.traces:
            self.traces.mark(*self.span)
        self.bar.object = self._bar(self._shown())

    def _turn_use(self, number: int) -> None:
        entry = self.bench.campaign().logs[number]
        held = entry.use == "holdout"
        edit = edits.log_changed(number, entry.file, "use", "fit" if held else "holdout")
        self._change(f"{entry.file}: {'training' if held else 'held out'}", edit)

    def _exclude(self, *, whole: bool) -> None:
        (row,) = self._shown()
        assert row.trial is not None
        span = (
            None if whole or self.span is None else (round(self.span[0], 6), round(self.span[1], 6))
        )
        if span is not None and not span[1] > span[0]:
            raise InputError("the span ends before it begins; mark it again")
        label, entry = row.trial.label, row.entry
        what = f"{entry.file}: {'test' if span is None else 'a span of test'} {label} excluded"
        self._change(what, edits.excluded(row.number, entry.file, label, span, self.why))
        self.span, self.why = None, ""

    def _change(self, what: str, edit: edits.Edit) -> None:
        assert self.bench.campaign_file is not None
        self.bench.change(self.bench.campaign_file, what, edit)


def _raw_role(role: Any) -> Any:
    """The colour of raw samples behind filtered ones."""
    return "measured" if role != "measured" else "band"


def _excluded(row: TestRow) -> Iterator[tuple[float, float, Any]]:
    """The stripes of what is excluded of a test."""
    assert row.trial is not None
    time = row.trial.since_start
    for one in row.entry.exclude:
        if one.test in ("", row.trial.label):
            low = time[0] if one.from_s is None else one.from_s
            high = time[-1] if one.to_s is None else one.to_s
            yield float(low), float(high), "model"


__all__ = ["LookScreen", "TestRow", "main_channel", "test_rows"]
