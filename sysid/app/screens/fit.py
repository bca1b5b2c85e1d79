"""Fit: the three pipelines and the campaign as a whole; what they fitted, and to which tests."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.app import parts
from sysid.app.parts import pn
from sysid.app.screens.base import Screen
from sysid.app.screens.look import LookScreen, TestRow, test_rows
from sysid.app.traces import TraceView
from sysid.blocks.figures import Figure, Points
from sysid.blocks.sections import Section
from sysid.blocks.titles import capital
from sysid.errors import Failure, InputError, on_its_own
from sysid.io.campaign import Campaign, CampaignLog
from sysid.io.files import make_folder, stamp_of
from sysid.io.kinds import FRICTION_KINDS
from sysid.parameters import Bundle
from sysid.pipeline.pages.report import held_parts, report_parts
from sysid.pipeline.run import RunOptions, expected_seconds

PIPELINES: Mapping[str, tuple[str, tuple[str, ...]]] = {
    "friction": ("Friction", FRICTION_KINDS),
    "valve-discrete": ("On/off valves", ("valve-discrete",)),
    "valve-pwm": ("PWM surfaces", ("valve-pwm",)),
}
# The sections of the report that are of a fit; the others have screens of their own.
_SECTIONS = ("friction", "valves", "surfaces", "component", "part", "refinement")

_NOTHING = (
    "Nothing was fitted yet. A part, or all of them, takes seconds; everything, with checks, "
    "diagnosis, validation on the held-out logs and report, minutes."
)


@dataclass(frozen=True)
class FitContent:
    """The campaign, the bundles that there are, and what the chosen one holds."""

    campaign: Campaign
    bundles: tuple[Path, ...]
    bundle: Bundle | None
    sections: tuple[Section, ...]


class FitScreen(Screen):
    """From tests to parameters."""

    title = "Fit"

    def __init__(self, window: Any) -> None:
        super().__init__(window)
        self.chosen: Path | None = None
        self.quick = False
        self.trace = parts.column()

    def read(self) -> FitContent:
        bench, campaign = self.bench, self.bench.campaign()
        bundles = tuple(bench.bundles())
        if self.chosen not in bundles:
            self.chosen = bench.best_bundle()
        if self.chosen is None:
            return FitContent(campaign, bundles, None, ())
        bundle = bench.bundle(self.chosen)
        key = ("sections", bench.campaign_key(), stamp_of(self.chosen))
        sections = bench.kept(key, lambda: tuple(_sections(campaign, bundle)))
        return FitContent(campaign, bundles, bundle, sections)

    # --- drawing --------------------------------------------------------------------------

    def draw(self, content: FitContent) -> list[Any]:
        self.trace.objects = []
        panes = [parts.html(self._head(content))]
        if content.bundle is None:
            panes.append(parts.html(parts.note(_NOTHING)))
            return panes
        panes.append(self.trace)
        for section in content.sections:
            panes.append(self.section_place(section, self._point))
        return panes

    def _head(self, content: FitContent) -> str:
        buttons = ""
        for name, (title, kinds) in PIPELINES.items():
            logs = content.campaign.select(kinds)
            hint = f"sysid fit {name}, {len(logs)} training logs"
            if not logs:
                hint = f"No training log of {' or '.join(kinds)} in the campaign"
            buttons += parts.button(title, f"fit-part:{name}", off=not logs, title=hint)
        buttons += parts.button("All of these", "fit-campaign",
                                title="sysid fit campaign.toml")  # fmt: skip
        buttons += parts.button(
            "Run everything", "fit-run", kind="primary",
            title="Checks, fit, diagnosis, refinement, validation, report and exports",
        )  # fmt: skip
        buttons += parts.tick("fit-quick", "quick diagnosis", self.quick)
        menu = ""
        if content.bundles:
            names = [(self.bench.named(p), self.bench.named(p)) for p in content.bundles]
            chosen = "" if self.chosen is None else self.bench.named(self.chosen)
            menu = "<p>Shown: " + parts.select("fit-bundle", names, chosen, "Bundle") + "</p>"
        said = ""
        if content.bundle is not None:
            held = held_parts(content.bundle)
            said = f"<p class='sentence'>{parts.words(capital(held))}.</p>"
        return f"<h2>Fit</h2><div class='bar2'>{buttons}</div>{menu}{said}"

    def _point(self, figure: Figure, cloud: int, index: int) -> None:
        """The trace of the test that a clicked point is of."""
        clouds = [m for panel in figure.panels for m in panel.marks if isinstance(m, Points)]
        tests = clouds[cloud].tests
        if index >= len(tests):
            return
        kind, label = tests[index]
        found = [r for r in test_rows(self) if r.trial is not None and _is(r, kind, label)]
        if not found:
            raise InputError(f"{kind}, test {label}: is not in the campaign's logs any more")
        self._show(found[0])

    def _show(self, row: TestRow) -> None:
        assert row.trial is not None
        look = LookScreen(self.window)
        view = TraceView(look.panels_of([row]), self.window.scheme, height=120)
        self.trace.objects = [
            parts.html(f"<h3>{parts.words(row.trial.title)} ({row.entry.kind})</h3>"),
            pn.pane.Bokeh(view.layout(), sizing_mode="stretch_width"),
        ]

    # --- what is done ---------------------------------------------------------------------

    async def do(self, what: str, value: Any) -> None:
        act, _, rest = what.partition(":")
        if act == "fit-bundle":
            self.chosen = self.bench.folder / str(value)
            self.bench.changes += 1
        elif act == "fit-quick":
            self.quick = bool(value)
        elif act == "fit-part":
            self._fit_part(rest)
        elif act == "fit-campaign":
            self._fit_campaign()
        elif act == "fit-run":
            self._run()
        else:
            await super().do(what, value)

    def _fit_part(self, name: str) -> None:
        bench, campaign = self.bench, self.bench.campaign()
        title, kinds = PIPELINES[name]
        entries = campaign.select(kinds)
        words = ["fit", name, *part_words(campaign, entries)]
        words += ["--rig", bench.named(Path(campaign.rig.source))]
        output = bench.result(f"{name}.json")
        make_folder(bench.results)
        words += ["-o", bench.named(output), "--no-report"]
        self.window.start(f"fitting {title}", words)
        self.chosen = output

    def _fit_campaign(self) -> None:
        bench, campaign = self.bench, self.bench.campaign()
        make_folder(bench.results)
        output = bench.result("fitted.json")
        words = ["fit", campaign.path.name, "-o", bench.named(output)]
        self.window.start("fitting the campaign", [*words, *bench.own_words(effects=False)])
        self.chosen = output

    def _run(self) -> None:
        bench = self.bench
        expected = expected_seconds(bench.results, RunOptions(quick=self.quick))
        self.window.start("running everything", bench.run_words(quick=self.quick), expected)
        self.chosen = bench.result("bundle.json")


def part_words(campaign: Campaign, entries: Sequence[CampaignLog]) -> Iterator[str]:
    """The logs of a part with their columns and what is excluded of them, for `sysid fit`.

    Raises InputError where the logs have columns of different names, which only a campaign says.
    """
    maps = [{**entry.shared, **entry.mapping} for entry in entries]
    if any(other != maps[0] for other in maps):
        what = "these logs have columns of different names"
        raise InputError(f"{what}; fit all of the parts instead")
    for entry in entries:
        yield entry.file
    for one in maps[0].values():
        yield from ("--map", str(one))
    for entry in entries:
        for exclusion in entry.exclude:
            span = ""
            if not exclusion.is_whole:
                ends = ("" if v is None else f"{v:g}" for v in (exclusion.from_s, exclusion.to_s))
                span = "@" + ":".join(ends)
            yield from ("--exclude", f"{entry.file}/{exclusion.test}{span}")


def _sections(campaign: Campaign, bundle: Bundle) -> Iterator[Section]:
    """What the report says of a fit, its figures not drawn yet."""
    for id, title, _, build in report_parts(campaign, bundle):
        if id not in _SECTIONS:
            continue
        section = on_its_own(build)
        if isinstance(section, Failure):
            yield Section(id, title, (f"This cannot be shown: {section.reason}.",))
        elif section is not None:
            yield section


def _is(row: TestRow, kind: str, label: str) -> bool:
    assert row.trial is not None
    named = row.trial.label
    return row.entry.kind == kind and label in (named, row.trial.title, f"{row.entry.file}/{named}")


__all__ = ["FitScreen", "part_words"]
