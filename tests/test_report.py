"""The report: what it says, its size, and that browsers, readers and printers can use it."""

from __future__ import annotations

import base64
import dataclasses
import itertools
import json
import math
import re
from collections.abc import Callable, Iterator
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from golden_folder import golden_bundle
from page_boxes import box_faults
from part_reports import PART_NAMES, write_part_report
from shared_results import bundled_fit, made_once

from sysid.blocks import numbers, standing, svg
from sysid.blocks.html import block_html
from sysid.blocks.tables import Table, table
from sysid.checks.log_check import check_log
from sysid.diagnosis.figures import regressor_axis, waterfall
from sysid.errors import InputError
from sysid.estimation.linear import Estimate
from sysid.io.campaign import Campaign, read_campaign
from sysid.io.channels import channel_of
from sysid.io.own_channels import balance_unit, error_unit
from sysid.parameters import Bundle, FittedValves, Surface, Valve, bundle_text, read_bundle
from sysid.parameters.files import bundle_from_json
from sysid.parameters.refinement import Refinement
from sysid.parameters.validation import Validation
from sysid.parameters.valves import PwmDirections
from sysid.pipeline.pages import concerns
from sysid.pipeline.pages.interactive import packed
from sysid.pipeline.pages.next_steps import next_line, next_section, open_questions
from sysid.pipeline.pages.opening import _table, verdict
from sysid.pipeline.pages.report import _json, render_report
from sysid.pipeline.verdict import verdict_lines

REPOSITORY = Path(__file__).resolve().parent.parent
BUNDLED = REPOSITORY / "datasets" / "bundled" / "campaign.toml"
LARGEST_BYTES = 6_000_000
HOSTILE_NAME = "<script>alert(1)</script>"
HOSTILE_FILE = 'a "quoted" file\'s </script><img src=x onerror=alert(2)>.csv'


def look(added: str | None, *suspects: tuple[str, float, float | None, str]) -> dict[str, Any]:
    """One look of a diagnosis at the residual: id, gain, refitted gain and fate of each suspect."""
    return {
        "added": added,
        "suspects": [
            {"id": id, "gain": gain, "refitted": refitted, "twins": [0.0, 3.0, 9.0],
             "p_value": 1e-9, "fate": fate}
            for id, gain, refitted, fate in suspects
        ],
    }  # fmt: skip


def curve(**more: Any) -> dict[str, Any]:
    means = {"share": 0.4, "means": [-0.2, 0.1, 0.3], "errors": [0.01, 0.02, 0.01]}
    return {"regressor": "velocity", "centres": [-1.0, 0.1, 2.0]} | means | more


# Two effects, the second of which makes the position worse, and a rest in a chamber.
DIAGNOSIS: dict[str, Any] = {
    "verdict": "unexplained",
    "effects": [
        {
            "id": "stribeck-friction",
            "parameters": {
                "stribeck_torque_nm": {
                    "value": 0.1162, "std": 0.0023, "unit": "Nm", "interval": [0.1117, 0.1207],
                },
            },
            "p_value": 1e-300, "share": 0.8, "ambiguous_with": [], "advice": "",
            "holdout_rmse": {"theta_rad": {"before": 0.02, "after": 0.004}},
        },
        {
            "id": "pressure-gain",
            "parameters": {
                "pressure_gain": {"value": None, "identified": False, "reason": "no span"},
                "side": "a",
            },
            "p_value": 3e-5, "share": 0.5, "ambiguous_with": ["pressure-offset"],
            "advice": "two known pressures",
            "holdout_rmse": {"theta_rad": {"before": 0.004, "after": 0.0051}},
        },
    ],
    "residual": {"theta_rad": {"before": 0.02, "after": 0.0051, "noise_floor": 0.003}},
    "unexplained": [{"channel": "pressure_a_pa", "regressor": "velocity", "share": 0.4}],
    "notices": ["a notice of the diagnosis"],
    "figures": {
        "looks": [
            look("stribeck-friction", ("stribeck-friction", 5e4, 5.5e4, "added"),
                 ("quadratic-drag", 3e3, 2e3, "refitted, takes less")),
            look("pressure-gain", ("pressure-gain", 900.0, 1e3, "added")),
            look(None, ("backlash", 12.0, None, "gains no more than chance would")),
        ],
        "excess": {"effort": {"before": 6e4, "after": -12.0}},
        "curves": [
            {"channel": channel, "regressor": "velocity", "fine": fine,
             "centres": [-1.0, 0.1, 2.0], "before": curve(), "after": curve()}
            for channel, fine in (("effort", 0.05), ("effort", None), ("rate_a", 0.05))
        ],
        "leftover": [{"channel": "pressure_a_pa", "residual": "rate_a", **curve()}],
        "titles": {"stribeck-friction": "Stribeck friction"},
        "meanings": {"stribeck-friction": {"stribeck_torque_nm": "beyond Coulomb friction"}},
    },
}  # fmt: skip


def refined(name: str, origin: str, before: float, movement: float | None, **more: Any) -> Any:
    """A refined parameter's record: a standard error of 1 % before, of 0.2 % after."""
    after = before * (1.0 + 0.01 * (movement or 0.0))
    limits = [0.996 * after, 1.004 * after]
    record = {
        "name": name, "origin": origin, "before": before,
        "before_std": None if movement is None else 0.01 * before,
        "after": {"value": after, "std": 0.002 * after, "unit": "Nm", "interval": limits},
        "movement": movement, "informed_by_motion": True,
    }  # fmt: skip
    return record | more


def position(*values: float) -> dict[str, Any]:
    """Of the position, before and after."""
    return {"theta_rad": dict(zip(("before", "after"), values, strict=True))}


# One parameter far from where it was, one constant that the rig file has wrong, one with nothing.
REFINEMENT: dict[str, Any] = {
    "converged": False,
    "evaluations": 41,
    "segments": 30,
    "segments_left_out": 2,
    "friction_scatter": {"sliding": 0.021, "static": 0.034},
    "parameters": [
        refined("friction.coulomb_nm", "friction", 0.2, 45.0),
        refined("friction.static_nm", "friction", 0.3, -0.1, informed_by_motion=False),
        refined("rig.inertia", "rig", 0.02, 3.0),
        refined("free-play.gap_rad", "effect", 0.01, None),
    ],
    "profiles": {
        "friction.coulomb_nm": {
            "values": [0.288, 0.29, 0.292], "rise": [5.0, 0.0, 4.0], "interval": [0.2885, None],
        },
    },
    "correlation": [
        [1.0, -0.93, 0.1, 0.0], [-0.93, 1.0, 0.0, 0.6], [0.1, 0.0, 1.0, 0.0], [0.0, 0.6, 0.0, 1.0],
    ],
    "rmse": {"fit": position(0.02, 0.005), "holdout": position(0.03, 0.033)},
    "residual_autocorrelation": {"fit": position(0.99, 0.2)},
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Made:
    """A campaign with all that the report is made from, and the page."""

    campaign: Campaign
    bundle: Bundle
    validation: Any
    checks: list[Any]
    path: Path

    @property
    def html(self) -> str:
        return self.path.read_text("utf-8")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """The bundled campaign, fitted, validated and reported, once for all workers."""
    return made_once(tmp_path_factory, "report", lambda: make(tmp_path_factory))


def make(tmp_path_factory: pytest.TempPathFactory) -> Made:
    from sysid.validation.open_loop import validate

    campaign = read_campaign(BUNDLED)
    fitted = bundled_fit(tmp_path_factory).bundle
    bundle = fitted.replaced(refinement=Refinement.model_validate(REFINEMENT))
    validation = validate(campaign, bundle)
    checks = [check_log(campaign.read(entry), campaign.rig) for entry in campaign.logs]
    path = tmp_path_factory.mktemp("report") / "report.html"
    html = render_report(
        campaign=campaign,
        bundle=bundle,
        validation=validation,
        checks=checks,
        diagnosis=DIAGNOSIS,
    )
    path.write_text(html, "utf-8")
    return Made(campaign, bundle, validation, checks, path)


@pytest.fixture(scope="module")
def hostile(made: Made, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report of a rig, a file and a test whose names are markup."""
    campaign = dataclasses.replace(
        made.campaign,
        rig=dataclasses.replace(made.campaign.rig, name=HOSTILE_NAME),
        logs=tuple(
            dataclasses.replace(e, file=HOSTILE_FILE) if e.use == "holdout" else e
            for e in made.campaign.logs
        ),
        notices=(HOSTILE_NAME,),
    )
    log = made.validation.select("holdout")[0]
    test = dataclasses.replace(log.tests[0], log=HOSTILE_FILE, test='"><b>1</b>')
    validation = dataclasses.replace(
        made.validation,
        logs=(dataclasses.replace(log, name=HOSTILE_FILE, tests=(test,)),),
        notices=(HOSTILE_FILE,),
    )
    content = json.loads(bundle_text(made.bundle.without("valves")))
    content["refinement"]["parameters"][0]["name"] = HOSTILE_NAME
    content["refinement"]["profiles"] = {
        HOSTILE_NAME: REFINEMENT["profiles"]["friction.coulomb_nm"]
    }
    content["refinement"]["rmse"] = {HOSTILE_FILE: {HOSTILE_NAME: {"before": 1.0, "after": None}}}
    content["provenance"]["options"] = {HOSTILE_NAME: HOSTILE_FILE}
    content["friction"]["trials"][0].update(used=False, test=HOSTILE_NAME, reason=HOSTILE_FILE)
    bundle = bundle_from_json(content, Path(HOSTILE_FILE))
    text = json.dumps(DIAGNOSIS).replace("backlash", HOSTILE_NAME)
    diagnosis = json.loads(text.replace("pressure-gain", HOSTILE_NAME))
    diagnosis["notices"] = [HOSTILE_FILE]
    diagnosis["effects"][0]["advice"] = HOSTILE_FILE
    diagnosis["effects"][0]["ambiguous_with"] = [HOSTILE_NAME]
    path = tmp_path_factory.mktemp("hostile") / "report.html"
    html = render_report(
        campaign=campaign, bundle=bundle, validation=validation, diagnosis=diagnosis
    )
    path.write_text(html, "utf-8")
    return path


# --- the page itself --------------------------------------------------------------------


class Outline(HTMLParser):
    """What a checker of accessibility looks at: elements, ids, names."""

    def __init__(self) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, {k: v or "" for k, v in attrs}))

    def having(self, attribute: str) -> Iterator[tuple[str, str]]:
        return ((tag, a[attribute]) for tag, a in self.elements if attribute in a)

    def of(self, tag: str) -> list[dict[str, str]]:
        return [a for t, a in self.elements if t == tag]


def outline(html: str) -> Outline:
    parser = Outline()
    parser.feed(html)
    return parser


def test_size_and_self_containment(made: Made) -> None:
    page = outline(made.html)
    assert made.path.stat().st_size < LARGEST_BYTES
    for attribute in ("src", "href", "srcset", "poster", "action"):
        for tag, value in page.having(attribute):
            assert value.startswith(("#", "data:")), f"<{tag} {attribute}={value[:80]}>"
    assert "@import" not in made.html
    assert not page.of("link") or all(a["href"] == "data:," for a in page.of("link"))


def test_every_section_is_there_and_nothing_left_out(made: Made) -> None:
    page = outline(made.html)
    sections = [a["id"] for a in page.of("section")]
    assert sections == [
        "verdict", "data", "fits", "friction", "valves", "surfaces", "validation", "residuals",
        "diagnosis", "refinement", "next", "provenance",
    ]  # fmt: skip
    assert "Left out" not in made.html


def test_training_rows_are_folded(made: Made) -> None:
    first, *folds = section_of(made.html, "validation").split("<details>")
    use = re.compile(r'data-label="Use"[^>]*>\s*(training|held out)')
    assert set(use.findall(first)) == {"held out"}
    training = next(fold for fold in folds if "Errors on the training logs" in fold)
    assert set(use.findall(training)) == {"training"}
    names = {log.name for log in made.validation.select("fit")}
    assert all(name in training for name in names)


@pytest.mark.parametrize("best", [None, "ann", "averaged"])
def test_only_the_recommended_law_is_drawn_in_sight(best: str | None) -> None:
    from sysid.blocks.figures import Line, Words
    from sysid.blocks.sections import FigureGroup
    from sysid.identification.valve_pwm.shown import _figure_blocks, _Measured
    from sysid.surfaces.bipolynomial import Bipolynomial
    from sysid.surfaces.domain import level_flows

    duty, pressure = (a.ravel() for a in np.mgrid[0.1:0.9:9j, 1.1e5:2.9e5:40j])
    flow = 2e-9 * duty * (3e5 - pressure)
    surface = Bipolynomial().fit(np.column_stack((duty, pressure)), flow)

    class Judged(_Measured):
        best: Any = None

    setattr(Judged, "best", best)  # noqa: B010
    levels = level_flows(duty, pressure, flow)
    kinds = ["bipolynomial", "ann", "averaged"]
    part = Judged("a", "fill", Valve(), levels, dict.fromkeys(kinds, surface))
    (group,), folded = _figure_blocks(part, is_first=True)
    assert isinstance(group, FigureGroup)
    shown = kinds if best is None else [best]
    ids = [f.id.removeprefix("fig-a-fill-") for f in group.figures]
    maps = [name for kind in shown for name in (kind, f"{kind}-error")]
    assert ids == ["cuts", *maps, *(["measured"] if best is None else [])]
    cuts = cast(Any, group.figures[0]).panels[0].marks
    labels = [m.label for m in cuts if isinstance(m, Line) and m.label]
    assert len(labels) == len(shown)
    # Each curve carries its duty.
    assert [m.text for m in cuts if isinstance(m, Words)] == [
        "0.10",
        "0.30",
        "0.50",
        "0.70",
        "0.90",
    ]
    assert len(folded) == (best is not None)
    for inner in folded:
        assert isinstance(inner, FigureGroup) and len(inner.figures) == 2 + 2 * 2


def test_elements_have_names_and_ids_of_their_own(made: Made) -> None:
    page = outline(made.html)
    ids = [value for _, value in page.having("id")]
    assert len(ids) == len(set(ids))
    for attributes in page.of("svg"):
        assert attributes["role"] == "img"
        assert set(attributes["aria-labelledby"].split()) <= set(ids)
    for attribute in ("aria-labelledby", "aria-describedby"):
        for _, value in page.having(attribute):
            assert set(value.split()) <= set(ids)
    assert page.of("html")[0]["lang"] == "en"
    assert all(a.get("scope") in ("row", "col") for a in page.of("th"))
    assert len(page.of("caption")) == len(page.of("table"))
    assert all("alt" in a for a in page.of("img"))
    levels = [int(tag[1]) for tag, _ in page.elements if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1 and levels.count(1) == 1
    assert all(b <= a + 1 for a, b in itertools.pairwise(levels))
    body = re.sub(r"<script.*?</script>", "", made.html, flags=re.DOTALL)
    references = re.findall(r'(?:url\(#|\shref="#)([^")]+)', body)
    assert set(references) <= set(ids)


def test_figures_follow_the_page_s_colours(made: Made) -> None:
    for figure in re.findall(r"<svg.*?</svg>", made.html, re.DOTALL):
        drawn = re.sub(r'data:image/png;base64,[^"]*', "", figure)
        fixed = set(re.findall(r"#[0-9a-f]{6}", drawn))
        assert not fixed, f"colours that no scheme can change: {fixed}"


def test_text_from_files_is_escaped(hostile: Path) -> None:
    html = hostile.read_text("utf-8")
    page = outline(html)
    assert HOSTILE_NAME not in html
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in html
    assert not page.of("img") and not page.of("b")
    assert not any(name.startswith("on") for _, a in page.elements for name in a)
    assert "On/off valves: no on/off law was fitted" in html


def section_text(html: str, id: str) -> str:
    """A section's text, without its pictures."""
    found = re.search(rf'<section id="{id}".*?</section>', html, re.DOTALL)
    assert found is not None
    text = re.sub(r"<svg.*?</svg>|<[^>]*>", " ", found[0], flags=re.DOTALL)
    return re.sub(r"\s+", " ", unescape(text))


def test_the_refinement_is_told_whole(made: Made) -> None:
    text = section_text(made.html, "refinement")
    assert "4 parameters were estimated together" in text and "over 30 segments" in text
    assert "did not converge: it stalled after 41 simulations" in text
    assert "2 of 32 segments are excluded" in text
    assert "2.1 % for sliding and 3.4 % for static friction" in text
    assert "They say less than what was known before of static friction." in text
    assert "hardly distinguish: Coulomb friction and static friction (−0.93)" in text
    assert "Coulomb friction friction.coulomb_nm" in text and "1 Coulomb friction" in text
    # The inertia moved by 3 of its standard errors before, 15 after.
    assert "rig.inertia: the rig file says 0.02" in text and "[inertia] equivalent_kg_m2" in text
    assert "held out Position (mrad) 30.0 33.0 +10 %" in text
    assert "training Position (mrad) 20.0 5.00 −75 % 0.9900 0.2000" in text
    for figure in ("movement", "correlation", "profile-0"):
        assert f"fig-refinement-{figure}-title" in made.html


def test_a_refinement_of_another_form_is_left_out(made: Made) -> None:
    content = json.loads(bundle_text(made.bundle))
    content["refinement"] = {"parameters": "none of ours", "profiles": 3, "correlation": [[1]]}
    bundle = bundle_from_json(content, Path("other.json")).without("valves", "friction")
    html = render_report(campaign=made.campaign, bundle=bundle)
    assert '<section id="refinement"' not in html
    assert json.loads(bundle_text(bundle))["refinement"] == content["refinement"]


def test_json_cannot_end_its_script() -> None:
    content = {"name": "</script><!--<script>\u2028&"}
    text = _json(content)
    assert not set("<>&\u2028") & set(text)
    assert json.loads(text) == content


def test_sections_without_their_part_are_left_out_and_said_so(made: Made) -> None:
    valves = FittedValves(a=Valve(discrete=made.bundle.valve("a").discrete))
    bundle = made.bundle.without("friction", "refinement").replaced(valves=valves)
    html = render_report(campaign=made.campaign, bundle=bundle)
    sections = [a["id"] for a in outline(html).of("section")]
    assert sections == ["verdict", "data", "fits", "valves", "provenance"]
    assert "Friction: no friction was fitted" in html
    assert "the model was not validated" in html
    assert "Diagnosis: the model was not diagnosed" in html
    assert "Refinement on motion: the parameters were not refined" in html
    assert len(html) < 1_000_000  # no plotting library where there is nothing to plot


def test_a_bundle_of_another_rig_is_said_or_refused() -> None:
    campaign = read_campaign(BUNDLED)
    bundle = read_bundle(golden_bundle("diagnosed")).without("valves", "refinement")
    bundle = bundle.replaced(rig_content=campaign.rig.content)
    said = "fitted with another rig file than this campaign's: [air] differ"
    assert "another rig file" not in render_report(campaign=campaign, bundle=bundle)
    air = {**campaign.rig.content["air"], "temperature_k": 280.0}
    other = bundle.replaced(rig_content={**campaign.rig.content, "air": air})
    assert said in unescape(render_report(campaign=campaign, bundle=other))
    linear = read_bundle(golden_bundle("made_linear"))
    with pytest.raises(InputError, match=r"is of a rotary rig, .* of a linear one; give"):
        render_report(campaign=campaign, bundle=linear)


def test_the_least_certain_parameters_are_worth_another_test() -> None:
    """A friction that may be 0 is wide; an offset about 0 is not, it has no sign to be known."""
    bundle = read_bundle(golden_bundle("diagnosed"))
    assert bundle.friction is not None
    wide = Estimate(0.01, 0.008, "Nm", (-0.006, 0.026))
    friction = bundle.friction.replaced(coulomb_nm=wide, offset_nm=wide)
    section = next_section(bundle.replaced(friction=friction), None, "campaign.toml")
    assert section is not None
    (lacking,) = (b for b in section.blocks if isinstance(b, Table))
    named = {row[0]: row[1] for row in lacking.rows}
    assert "Offset of friction" not in named
    # In the parameter's unit: a share of a value about 0 says nothing.
    assert "to 0.026 Nm" in str(named["Coulomb friction"])


def test_a_part_alone_says_on_the_first_screen_what_is_missing(made: Made) -> None:
    valves = made.bundle.replaced(friction=None, validation=None, refinement=None)
    html = render_report(campaign=made.campaign, bundle=valves)
    first = html[html.index("Verdict</") : html.index("Data and their quality</h2>")]
    assert "Fit friction too, in a campaign" in first and "of the spread)" in first
    assert "What to do next" not in first.partition("Not included")[2]


def test_a_legend_over_a_wide_figure_stands_beside_its_title() -> None:
    from sysid.blocks.figures import Figure, Line, Panel, Scale

    x = np.linspace(0.0, 1.0, 5)
    marks = (Line(x, x, "model", "Valve A"), Line(x, -x, "second", "Valve B"))
    panel = Panel(Scale("Time", "s"), Scale("Command"), marks, legend="over")
    drawn = svg.picture(Figure("f", "Valves", "", (panel,), size=(8.6, 2.5))).svg
    (width,) = re.findall(r'viewBox="0 0 ([\d.]+)', drawn)
    (last,) = re.findall(r' x="([\d.]+)"[^>]*>Valve B<', drawn)
    assert float(last) < 0.4 * float(width)  # a phone shows half of the width


@pytest.mark.parametrize("name", ["on/off law", "after the seals were new/fitted.json, valve A"])
@pytest.mark.parametrize("legend", ["best", "above"])
def test_a_legend_hides_no_curve(name: str, legend: Any) -> None:
    from sysid.blocks import drawing
    from sysid.blocks.figures import PANEL, Line, Panel, Scale

    x = np.linspace(0.0, 1.0, 50)
    waves = [Line(x, 2.0 + 0.1 * np.sin(40.0 * x + i), "model", f"{name}{i}") for i in range(2)]
    panel = Panel(Scale("Time", "s"), Scale("Error", limits=(0.0, None)), (*waves,), legend=legend)
    with svg.styled():
        figure, (ax,) = svg.panels("", (1.0,), PANEL if legend == "above" else (7.0, 2.6))
        drawing.draw(ax, panel)
        figure.draw_without_rendering()
        text = [t.get_window_extent() for t in ax.get_legend().get_texts()]
        curves = ax.transData.transform(np.concatenate([np.c_[w.x, w.y] for w in waves]))
    for box in text:
        within = (curves > (box.x0, box.y0)) & (curves < (box.x1, box.y1))
        assert not within.all(axis=1).any()


def test_a_motor_alone_has_no_valves() -> None:
    bundles: list[Any] = [
        SimpleNamespace(rig=SimpleNamespace(is_motor_alone=alone)) for alone in (True, False)
    ]
    captions = [_table([], ["on/off law"], bundle).caption for bundle in bundles]
    assert captions == ["Open loop", "Open loop, valves by the on/off law"]


def test_nothing_is_left_open_only_where_it_was_looked() -> None:
    found = {"verdict": "adequate"}
    assert open_questions(found, is_validated=True) == "no open question"
    assert open_questions(None, is_validated=True) == "run sysid diagnose"
    assert open_questions(None, is_validated=False) == "run sysid validate and sysid diagnose"
    assert open_questions(found | {"component": "tank"}, is_validated=False) == "no open question"
    skipped = {"skipped": "no motion log"}
    assert open_questions(skipped, is_validated=True) == "add the tests that the diagnosis needs"


def test_provenance_holds_every_checksum(made: Made) -> None:
    assert made.bundle.provenance.logs
    for entry in made.bundle.provenance.logs:
        assert entry.sha256 in made.html


# --- what it says -----------------------------------------------------------------------


def test_verdict_pools_the_held_out_tests(made: Made) -> None:
    judged = verdict(made.bundle, made.validation)
    held = [g for g in made.validation.select("holdout") if g.model == "discrete"]
    residuals = np.concatenate(
        [t.residual("theta_rad")[: t.counted] for g in held for t in g.tests]
    )
    rmse = 1e3 * math.sqrt(float(np.mean(residuals**2)))
    assert judged.table is not None
    row = next(r for r in judged.table.rows if r[0].startswith("Position"))
    assert row[2] == numbers.number(rmse)
    assert " held-out test" in judged.sentence
    assert judged.sentence.count(". ") == 0


def test_verdict_without_held_out_logs_says_so(made: Made) -> None:
    fitted = dataclasses.replace(made.validation, logs=made.validation.select("fit"))
    assert "none is held out" in verdict(made.bundle, fitted).sentence
    assert "was not tested" in verdict(made.bundle, None).sentence


def test_verdict_falls_with_the_fit(made: Made) -> None:
    def worse(result: Any, factor: float) -> Any:
        channels = {
            name: dataclasses.replace(
                c, errors=dataclasses.replace(c.errors, squares=factor**2 * c.errors.spread)
            )
            for name, c in result.channels.items()
        }
        return dataclasses.replace(result, channels=channels)

    words = {"good": "follows this rig well", "fair": "roughly", "poor": "does not follow"}
    bare = made.bundle.without("friction", "valves")
    for share, level in ((0.05, "good"), (0.2, "fair"), (0.5, "poor")):
        logs = tuple(worse(log, share) for log in made.validation.logs)
        validation = dataclasses.replace(made.validation, logs=logs)
        judged = verdict(bare, validation)
        assert judged.level == level and words[level] in judged.sentence
        assert not judged.held_back
        open_ended = verdict(bare, validation, {**DIAGNOSIS, "because": "structure"})
        assert open_ended.level == concerns.worst((level, "fair"))
        assert bool(open_ended.held_back) is (level == "good")


def test_verdict_s_colour_is_that_of_the_model_it_recommends(made: Made) -> None:
    """Mean flows that the page advises against, with which the position is lost, limit nothing."""
    from sysid.validation.shown_tests import MODEL_NAMES, recommended_models

    best = recommended_models(made.validation)[1]
    judged = verdict(made.bundle, made.validation)
    under_pwm = [c.name for c in judged.concerns if "under PWM" in c.name]
    assert under_pwm == [f"the position under PWM with the {MODEL_NAMES[best]}"]
    own = verdict(made.bundle.without("friction", "valves"), made.validation).level
    assert judged.level == concerns.worst((own, *(c.level for c in judged.concerns)))
    assert f'class="verdict {judged.level}"' in made.html
    # So does a lack of fit that is small: the diagnosis names what it is of.
    friction = [(q.verdict, c.level) for q, c in zip(
        made.bundle.qualities().values(), concerns.of_bundle(made.bundle, ()), strict=False
    ) if "lack of fit" in q.verdict]  # fmt: skip
    assert friction and {level for _, level in friction} == {"good"}
    # What is recommended does limit it.
    logs = tuple(g for g in made.validation.logs if g.model in ("discrete", "bipolynomial"))
    only = verdict(made.bundle, dataclasses.replace(made.validation, logs=logs))
    assert [c.level for c in only.concerns if "under PWM" in c.name] == ["poor"]
    assert only.level == "poor"


def test_laws_that_are_not_recommended_are_known_by_their_places() -> None:
    from sysid.identification.valve_pwm.choice import not_recommended, recommended
    from sysid.parameters import PwmSurfaces
    from sysid.parameters.valves import DutyErrors, SurfaceChoice

    errors = DutyErrors(
        rmse=0.01, max_relative_error_percent=1.0, max_error_points=1.0, p95_error_points=1.0,
        n_parameters=9, n_points=50,
    )  # fmt: skip
    choice = SurfaceChoice(
        bipolynomial=errors, network=errors, noise_rmse=None, recommended="ann", reason="",
        n_tests=9, folds=4, seed=0,
    )  # fmt: skip
    held = PwmSurfaces(bipolynomial=Surface(), ann=Surface(), comparison=choice)
    valve = Valve(pwm=PwmDirections(fill=held))
    assert recommended(valve, "fill") == "ann" and recommended(valve, "discharge") is None
    assert not_recommended(valve, "a") == {
        "valves.a.pwm.fill.bipolynomial", "valves.a.pwm.averaged, fill",
    }  # fmt: skip
    assert not_recommended(Valve(), "a") == set()


@pytest.mark.parametrize(("share", "best"), [(0.1, "averaged"), (10.0, "bipolynomial")])
def test_one_surface_alone_is_weighed_against_the_averaged_law(share: float, best: str) -> None:
    """The verdict is on the law to use, which needs no comparison of two surfaces."""
    from sysid.identification.valve_pwm.choice import not_recommended, recommended
    from sysid.identification.valve_pwm.shown import _compared, _Measured, _obedience
    from sysid.parameters import PwmSurfaces
    from sysid.parameters.valves import AveragedRecord, DutyErrors

    def errors(rmse: float) -> DutyErrors:
        return DutyErrors(
            rmse=rmse, max_relative_error_percent=1.0, max_error_points=1.0, p95_error_points=1.0,
            n_parameters=9, n_points=50,
        )  # fmt: skip

    surface = Surface(errors_duty={"held_out": errors(0.04)})
    held = PwmSurfaces(bipolynomial=surface)
    alone = Valve(pwm=PwmDirections(fill=held))
    assert recommended(alone, "fill") == "bipolynomial"
    keys = (
        "c_fill",
        "c_dis",
        "choked_flow_fill_kg_s",
        "choked_flow_dis_kg_s",
        "delay_difference_s",
    )
    numbers = {key: Estimate.unidentified("", "not asked for") for key in keys}
    law = AveragedRecord(errors_duty={"fill": {"held_out": errors(0.04 * share)}}, **numbers)
    valve = Valve(pwm=PwmDirections(fill=held, averaged=law))
    assert recommended(valve, "fill") == best
    places = {
        "bipolynomial": "valves.a.pwm.fill.bipolynomial",
        "averaged": "valves.a.pwm.averaged, fill",
    }
    assert not_recommended(valve, "a") & set(places.values()) == {
        place for kind, place in places.items() if kind != best
    }
    parts = [_Measured("a", "fill", valve, None, {})]
    assert "bipolynomial" in " ".join(_obedience(parts))
    shown = next(block for block in _compared(parts) if isinstance(block, Table))
    assert [row[-1] for row in shown.rows] == ["use this"]
    assert "Noise alone" not in shown.headings and "noise alone" not in shown.caption


def test_notices_stand_where_their_numbers_stand() -> None:
    from sysid.blocks.sections import Lines, Notes, Section
    from sysid.errors import Notice
    from sysid.pipeline.pages.notices import by_section, notices_in, with_notices

    campaign = read_campaign(BUNDLED)
    log = next(e for e in campaign.logs if e.kind == "valve-pwm")
    pressure = f"{log.path}, test 45: excluded: the pressure stays within 1 % of its start"
    coulomb = "coulomb_nm: constant-effort tests give 0.17 Nm, motion 0.174, apart by 3.1 errors"
    notices = [
        Notice(pressure, "valve-pwm"),
        Notice(coulomb, "friction.coulomb_nm"),
        Notice("valve A: friction is not what it says", "valves.a.discrete"),
        Notice("valve B, discharging: no usable test above duty 0.74", "valves.b.pwm.averaged"),
        Notice("not identified: no motion", "friction-motion"),
        "valve: the clock runs slow",
    ]
    there = ("data", "surfaces", "friction", "valves")
    found = by_section(notices, campaign, there)
    assert {k: len(v) for k, v in found.items()} == {
        "surfaces": 2, "friction": 2, "valves": 1, "data": 1,
    }  # fmt: skip
    assert by_section(notices[1:2], campaign, ("data",)) == {"data": [coulomb]}
    assert found["surfaces"][0] == pressure.replace(str(log.path), log.path.name)
    section = Section("friction", "Friction", (), (Lines(("said",)),))
    assert with_notices(section, ["said"]) is section
    assert notices_in([section, Section("data", "", (), (Lines(("b",)),))]) == {"said", "b"}
    many = with_notices(section, [coulomb, *(f"another of kind {c}" for c in "abcdef")])
    first, folded, _ = many.blocks
    assert isinstance(first, Notes) and coulomb in first.lines and len(first.lines) == 4
    assert isinstance(folded, Lines) and folded.summary and len(folded.lines) == 3
    why = "excluded: the pressure stays within 1 % of its start"
    both = [f"b.csv, tests 44, 45, 46: {why}", "B: said", f"a.csv, tests 1, 2, 4: {why}", "A: said"]
    shown = with_notices(section, both).blocks[0]
    assert isinstance(shown, Notes)
    assert shown.lines == (f"a.csv, tests 1, 2, 4; b.csv, tests 44 to 46: {why}", "A; B: said")


TRACE: dict[str, Any] = {
    "source": "run.csv, test 2", "channel": "theta_rad", "tests": 3, "time": [0.0, 0.5, 1.0],
    "measured": [0.0, 0.5, 1.0], "before": [0.0, 0.3, 0.5], "after": [0.0, 0.45, 0.95],
    "fit": {"before": 40.0, "after": 92.0},
    "friction": [
        {"source": "run.csv, test 2", "own": -0.03, "scatter": 0.02, "rmse": 0.004, "of": 0.01},
        {"source": "run.csv, test 1", "own": 0.001, "scatter": 0.02, "rmse": 0.009, "of": 0.01},
    ],
}  # fmt: skip


def test_the_first_screen_shows_a_held_out_test_before_and_after() -> None:
    from sysid.diagnosis.wording import own_friction
    from sysid.pipeline.pages.held_out import first_picture

    shown = first_picture(None, {"figures": {"trace": TRACE}, "effects": [{}]}, False)
    assert shown is not None
    (figure,) = cast(Any, shown.figures)
    above, below = figure.panels
    assert above.marks[0].label == "measured" and len(above.marks) == 3
    assert np.allclose(below.marks[-1].y, [0.0, 50.0, 50.0])  # mrad
    assert "run.csv, test 2" in shown.caption and "92.0 %, 40.0 % before" in shown.caption
    # What friction of its own explains is said only where it is most of the residual's square.
    assert "84 % of the square" in shown.caption and "3.0 % less than the model's" in shown.caption
    assert own_friction(TRACE, "run.csv, test 1") == ""
    same = first_picture(None, {"figures": {"trace": TRACE}, "effects": []}, False)
    assert same is not None and len(cast(Any, same.figures[0]).panels[0].marks) == 2
    assert first_picture(None, None, False) is None


def test_what_to_do_next_is_what_advise_predicts(made: Made) -> None:
    advice = {
        "parameters": [{"name": "friction.coulomb_nm", "unit": "Nm", "std_now": 0.002}],
        "tests": [
            {"test": "motion-motor: sine 1 Hz, 5 s", "gain": 0.2,
             "std_after": {"friction.coulomb_nm": 0.001}},
        ],
        "ties": [],
    }  # fmt: skip
    section = next_section(made.bundle, {**DIAGNOSIS, "component": "actuator"}, "c.toml", advice)
    assert section is not None
    tests = next(b for b in section.blocks if isinstance(b, Table) and "could run" in b.caption)
    row = [str(cell) for cell in tests.rows[0]]
    assert row == ["motion-motor: sine 1 Hz, 5 s", "—", "18", "Coulomb friction, by 50 %"]
    plain = {**DIAGNOSIS, "verdict": "effects-found", "unexplained": [], "effects": []}
    assert next_line(made.bundle, plain, advice).startswith(
        "Record motion-motor: sine 1 Hz, 5 s: standard"
    )
    better = {"test": "motion-pwm: duties about 0.2, 10 s", "gain": 0.1, "motion_gain": 0.3,
              "std_after": {}}  # fmt: skip
    both = {**advice, "tests": [{**advice["tests"][0], "motion_gain": 0.05}, better]}
    # Not the test that makes numbers certain which hardly move the motion.
    assert next_line(made.bundle, plain, both).startswith("Record motion-pwm: duties about 0.2")
    # What a terminal says next is what the report says.
    printed = verdict_lines(made.bundle, plain, advice=both)[-1]
    assert f"{printed.removeprefix('Next: ')}." == next_line(made.bundle, plain, both)
    # The table begins with the test that the first screen names.
    section = next_section(made.bundle, plain, "c.toml", both)
    assert section is not None
    tests = next(b for b in section.blocks if isinstance(b, Table) and "could run" in b.caption)
    assert [str(row[0])[:10] for row in tests.rows] == ["motion-pwm", "motion-mot"]
    assert "distinguish" not in next_line(made.bundle, plain, None)
    assert "two known pressures" in next_line(made.bundle, DIAGNOSIS, advice)


def test_a_part_is_not_judged_by_a_motion_in_which_errors_add_up() -> None:
    from sysid.pipeline.pages.concerns import of_diagnosis

    far = {"before": 3.0, "after": 2.0, "noise_floor": 0.1}
    residual = {"motor_force_n": far, "position_m": {**far, "noise_floor": 1e-9}}
    found = list(of_diagnosis({"verdict": "adequate", "component": "axis", "residual": residual}))
    assert [one.name for one in found] == ["the diagnosis", "errors of force 20 times the noise"]


def test_the_next_step_is_weighed_by_what_it_does_to_the_motion() -> None:
    bundle = read_bundle(golden_bundle("diagnosed"))
    assert bundle.friction is not None
    wide = Estimate(0.003, 0.001, "Nm", (0.001, 0.005))
    bundle = bundle.replaced(friction=bundle.friction.replaced(offset_nm=wide))
    assert next_line(bundle, None).startswith("Offset of friction (95 % interval of")
    # A terminal names the same number, unless the report weighs it by validated motion.
    plain = {**DIAGNOSIS, "verdict": "effects-found", "unexplained": [], "effects": []}
    for is_validated in (False, True):
        validation = read_bundle(golden_bundle("validated")).validation if is_validated else None
        one = bundle.replaced(validation=validation)
        said = verdict_lines(one, {**plain, "component": "actuator"})[-1]
        assert ("Offset of friction (95 % interval of" in said) != is_validated
        assert ("the report weighs" in said) == is_validated
    moves = {"friction.viscous_nm_s_per_rad": 0.004, "friction.coulomb_nm": 0.001}
    line = next_line(bundle, None, None, lambda: moves, 0.006)
    assert line.startswith("Viscous friction: its standard error moves")
    assert "4.0 mrad (held-out RMSE 6.0 mrad)" in line
    assert "No number is too uncertain" in next_line(bundle, None, None, lambda: moves, 0.06)
    # That no number is too uncertain is not that nothing is missing.
    bare = bundle.replaced(effects=[])
    for given, is_told in ((None, True), ({**plain, "component": "actuator"}, False)):
        line = next_line(bare, given, None, lambda: moves, 0.06)
        assert "No number is too uncertain" in line and ("sysid diagnose" in line) == is_told
    # The section that the first screen leads to names that number too, and no command fails.
    shown = next_section(bundle, None, "run.csv", None, lambda: moves, 0.006)
    assert shown is not None
    (lacking,) = (b for b in shown.blocks if isinstance(b, Table))
    assert [str(row[0]) for row in lacking.rows if "4.0 mrad" in row[1]] == ["Viscous friction"]
    diagnosed = {**plain, "component": "actuator"}
    for file in ("campaign.toml", "run.csv"):
        shown = next_section(bundle, diagnosed, file)
        assert shown is not None
        assert any("sysid advise" in text for text in shown.intro) == (file == "campaign.toml")
    section = next_section(bundle, None, "campaign.toml", None, lambda: moves)
    assert section is not None
    assert not [text for text in section.intro if "Ordered" in text]  # of one block
    (lacking,) = (b for b in section.blocks if isinstance(b, Table))
    said = {row[0]: row[1] for row in lacking.rows}
    assert "the simulated model has no such term" in str(said["Offset of friction"])


@pytest.mark.parametrize("is_linear", [False, True])
def test_base_parameters_have_the_units_of_their_own_tables(is_linear: bool) -> None:
    from sysid.diagnosis.tables import refitted_table

    one = {"before": 6.52e-4, "after": 6.5163e-4, "std": 4.3e-7, "unit": ""}
    names = ("choked_fill_a", "c_dis_b", "coulomb_effort", "viscous", "own_number")
    found = refitted_table(
        {"figures": {"refitted": [{"name": name, **one} for name in names]}}, is_linear
    )
    friction = ["N", "N·s/m"] if is_linear else ["N·m", "N·m·s/rad"]
    assert [row[-1] for row in found.rows] == ["g/s", "kg/(s·Pa)", *friction, ""]
    assert [str(cell) for cell in found.rows[0][1:3]] == ["0.65200", "0.65163"]


def test_what_to_do_next_names_what_is_missing_by_its_key(made: Made) -> None:
    """The page says it once: by what a line is about, however it is worded."""
    from sysid.blocks.sections import Said
    from sysid.pipeline.pages.report import _says_as_much

    note = Said("Not identified: static friction: no test", "friction.static_nm")
    assert _says_as_much(Said("Static friction: record ramps.", "friction.static_nm"), note)
    assert not _says_as_much(Said("Offset: record both ways.", "friction.offset_nm"), note)
    assert not _says_as_much("No question is open.", note)
    assert not _says_as_much(Said("Ramps.", "friction.static_nm"), "Another reservation")


def test_messages_have_a_page_s_signs() -> None:
    from sysid.blocks.html import typeset

    line = "filling -5.53e+03 Pa (an offset of -0.0029 Nm); --law iso6358, 2026-11-27, run-2 1e3x"
    signs = {"-5.53e+03": "\N{MINUS SIGN}5530", "of -": "of \N{MINUS SIGN}", "Nm": "N·m"}
    shown = line
    for plain, sign in signs.items():
        shown = shown.replace(plain, sign)
    assert typeset(line) == shown
    assert typeset("keys such as coulomb_nm, 3 Nmax") == "keys such as coulomb_nm, 3 Nmax"
    assert typeset("d (P^2 - P0^2)") == "d (P² - P0²)" and typeset("2^10, x^2.5") == "2^10, x^2.5"
    # In a table a reason stands among the numbers.
    reason = "no discharge starts above the choked boundary (1.887e+05 Pa)"
    cells = block_html(table("Valve", ("Parameter", "Value"), [("Flow", reason)]))
    assert "(188700 Pa)" in cells and "e+05" not in cells


def test_unidentified_parameters_are_named(made: Made) -> None:
    assert made.bundle.friction is not None
    reason = "no ramp reaches motion"
    static = Estimate.unidentified("Nm", reason)
    bundle = made.bundle.replaced(friction=made.bundle.friction.replaced(static_nm=static))
    notes = verdict(bundle, made.validation).notes
    assert any("Static friction" in n and reason in n for n in notes)
    # On the first screen once: what to do next names it with its reason.
    html = render_report(campaign=made.campaign, bundle=bundle)
    first = plain(html[html.index("Verdict</") : html.index("Data and their quality</h2>")])
    assert first.count(reason) == 1 and "Static friction (not identified" in first


def test_the_first_screen_says_what_a_refinement_made_worse(made: Made) -> None:
    first = made.html[made.html.index("Verdict</") : made.html.index("Data and their quality</h2>")]
    said = "Refinement . It made the held-out position worse: RMSE from 30.0 to 33.0 mrad."
    assert said in plain(first)
    better = json.loads(json.dumps(REFINEMENT))
    better["rmse"]["holdout"] = position(0.03, 0.0301)
    better["effort_rmse"] = {"holdout": {"motor_torque_nm": {"before": 0.1, "after": 0.1}}}

    def refined_as(content: Any) -> str:
        bundle = made.bundle.replaced(refinement=Refinement.model_validate(content))
        return verdict(bundle, made.validation).refined

    assert refined_as(better) == ""
    better["effort_rmse"]["holdout"]["motor_torque_nm"]["after"] = 0.12
    assert "held-out torque worse: RMSE from 100 to 120 mN·m" in refined_as(better)
    assert verdict(made.bundle.replaced(refinement=None), made.validation).refined == ""


def plain(html: str) -> str:
    """The page's text, its tags taken out."""
    return unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", html)))


def section_of(html: str, id: str) -> str:
    return html[html.index(f'<section id="{id}"') :].split("</section>")[0]


def test_diagnosis_is_told_on_top_and_in_its_section(made: Made) -> None:
    top = plain(section_of(made.html, "verdict"))
    assert "Unexplained: structure remains in chamber A's balance" in top
    assert "position from 20.0 to 5.10 mrad (a correct model: 3.00)" in top
    text = plain(section_of(made.html, "diagnosis"))
    assert "0.1117 to 0.1207 N·m" in text  # an interval with its unit
    assert "< 1 × 10⁻²⁰" in text and "3 × 10⁻⁵" in text
    assert "not identified" in text and "no span" in text
    assert "gains no more than chance would" in text
    assert "a notice of the diagnosis" in text


def test_what_to_do_next_has_a_section(made: Made) -> None:
    text = plain(section_of(made.html, "next"))
    assert "pressure-gain pressure-offset two known pressures" in text
    assert "--effects FILE" in text
    assert "sysid advise campaign.toml" in text


def test_waterfall_says_what_falls_and_what_rises(made: Made) -> None:
    figure = next(
        f for f in re.findall(r"<svg.*?</svg>", made.html, re.DOTALL) if "error-theta_rad" in f
    )
    for step in (
        "original bundle: 20.0", "Stribeck friction: −16.0", "pressure-gain: +1.10",
        "extended model: 5.10", "correct model: 3.00",
    ):  # fmt: skip
        assert step in figure
    assert "after Stribeck friction 4.00; after pressure-gain 5.10" in figure


def test_an_effect_that_cannot_be_simulated_without_the_next_leaves_a_gap() -> None:
    from sysid.diagnosis.shown import diagnosis_section

    content = json.loads(json.dumps(DIAGNOSIS))
    del content["effects"][0]["holdout_rmse"]["theta_rad"]
    section = diagnosis_section(content, is_linear=False)
    groups = [b for b in standing.drawn(section.blocks) if b.kind == "figures"]
    errors = next(f for g in groups for f in g.figures if "error-theta_rad" in f.svg)
    assert "after Stribeck friction —; after pressure-gain 5.10" in errors.description


def test_a_channel_that_never_varies_has_no_fit_percentage() -> None:

    channel = {"rmse": 1.0, "fit_percent": None, "noise_floor": 0.5}
    log = {"file": "still.csv", "use": "holdout", "valve_model": "discrete"}
    content = {"logs": [{**log, "channels": {"theta_rad": channel}}]}
    table = Validation.model_validate(content).table()
    assert [row[5] for row in table.rows] == ["-"]


def test_diagnosis_of_a_linear_rig_is_in_its_units() -> None:
    from sysid.diagnosis.shown import diagnosis_section

    content = json.loads(json.dumps(DIAGNOSIS).replace("theta_rad", "position_m"))
    content["unexplained"][0]["channel"] = "position_m"
    section = diagnosis_section(content, is_linear=True)
    assert "the force balance" in section.intro[0] and " mm " in section.intro[0]
    groups = [b for b in standing.drawn(section.blocks) if b.kind == "figures"]
    curves = [f for g in groups for f in g.figures if f.title.startswith("Force balance")]
    assert curves and all(" N." in f.description for f in curves)
    assert "(mm/s)" in curves[0].svg and "mrad" not in "".join(f.svg for f in curves)


def test_an_adequate_model_without_held_out_tests_is_said_so(made: Made) -> None:
    from sysid.diagnosis.shown import diagnosis_section
    from sysid.pipeline.pages.next_steps import next_section

    empty = {"looks": [look(None)], "excess": {}, "curves": [], "leftover": [],
             "titles": {}, "meanings": {}}  # fmt: skip
    content = {"verdict": "adequate", "effects": [], "residual": {}, "unexplained": [],
               "notices": [], "figures": empty}  # fmt: skip
    section = diagnosis_section(content, is_linear=False)
    assert section.intro[0].startswith("Adequate: no test found structure above the noise")
    following = next_section(made.bundle, content, "campaign.toml")
    assert "Errors before and after are not known" in str(following)


def test_friction_band_is_that_of_the_numbers_errors(made: Made) -> None:
    """At rest it is as wide as Coulomb friction and the offset are uncertain together."""
    from sysid.identification.friction.shown import _half_width

    friction = made.bundle.friction
    assert friction is not None
    coulomb, offset = (friction.estimates()[key] for key in ("coulomb_nm", "offset_nm"))
    (half,) = np.atleast_1d(_half_width(friction, np.zeros(1), 1.0))
    low, high = (0.5 * (e.interval[1] - e.interval[0]) for e in (offset, coulomb))
    assert 0.3 * max(low, high) < half < 1.5 * (low + high)


# --- numbers and samples ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.0, 3, "0"),
        (12.345, 3, "12.3"),
        (-0.25, 2, "−0.25"),
        (0.00012345, 3, "1.23 × 10⁻⁴"),
        (9.996e-4, 3, "0.00100"),
        (123456.0, 3, "123456"),
        (1.5e7, 2, "1.5 × 10⁷"),
        (None, 3, "—"),
        (math.nan, 3, "—"),
        (-math.inf, 3, "−∞"),
    ],
)
def test_numbers(value: float | None, digits: int, text: str) -> None:
    assert numbers.number(value, digits) == text


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [
        (3.22e-4, 6.02e-4, "(3.22 to 6.02) × 10⁻⁴"),
        (0.0, 3e-4, "(0 to 3.00) × 10⁻⁴"),
        (-0.295, 5.29e-5, "−0.295 to 0.00005"),
        (-107.0, 15.1, "−107 to 15.1"),
        (None, 3e-4, "— to 3.00 × 10⁻⁴"),
    ],
)
def test_a_range_has_one_power_of_ten(low: float | None, high: float, text: str) -> None:
    assert numbers.span(low, high) == text


def test_estimates_show_two_digits_of_their_error() -> None:
    estimate = Estimate(6.51631e-4, 4.2026e-7, "kg/Pa", (6.5080e-4, 6.5246e-4))
    assert numbers.estimate_cells(estimate) == (
        "6.5163 × 10⁻⁴", "0.0042 × 10⁻⁴", "(6.5080 to 6.5246) × 10⁻⁴", "kg/Pa",
    )  # fmt: skip
    # A flow in the unit of the figures.
    flow = dataclasses.replace(estimate, unit="kg/s")
    assert numbers.estimate_cells(flow) == ("0.65163", "0.00042", "0.65080 to 0.65246", "g/s")
    delay = Estimate(0.00151, 2.1e-5, "s", (-math.inf, 0.00155))
    narrow = Estimate(0.1000000716, 9.4e-7, "1/rad2", (0.09999823, 0.10000191))
    # The value and both ends to the same decimal.
    assert numbers.si_cells(narrow)[:2] == ("0.100000", "0.099998 to 0.100002")
    for ends, text in (((2.49, math.inf), "2.49 to inf"), ((-math.inf, math.inf), "")):
        one_sided = Estimate(70.89, math.inf, "W/K", ends)
        assert numbers.si_cells(one_sided) == ("70.89", text, "W/K")
    assert numbers.si_cells(Estimate(1.0, math.nan, "-", (math.nan, 2.0)))[1] == ""
    assert numbers.estimate_cells(delay) == ("1.510", "0.021", "−∞ to 1.550", "ms")
    missing = Estimate.unidentified("Nm", "no test")
    assert numbers.estimate_cells(missing)[::2] == ("not identified", "no test")


@pytest.mark.parametrize("std", [0.0044, 0.0011])
def test_a_value_has_one_form_with_its_error_and_without(std: float) -> None:
    """However large its error is: thousandths are written out, less has a power of ten."""
    for value, plain in ((-0.0029, "−0.0029"), (0.00029, None)):
        found = numbers.estimate_cells(
            Estimate(value, std if plain else 0.1 * std, "Nm", (-1.0, 1.0))
        )
        assert found[0] == plain or (plain is None and "× 10⁻⁴" in found[0])
        assert numbers.number(value, 2) == (plain or "2.9 × 10⁻⁴")


def test_packed_samples_come_back_within_half_a_step() -> None:
    values = np.random.default_rng(3).normal(2e5, 4e4, 5000)
    values[17] = math.nan
    content = packed(values)
    stored = np.frombuffer(base64.b64decode(content["data"]), dtype="<i2")
    back = content["offset"] + content["scale"] * stored
    assert stored[17] == -32768
    known = np.isfinite(values)
    assert np.abs(back - values)[known].max() <= 0.501 * content["scale"]
    assert content["scale"] < np.ptp(values[known]) / 65_000
    assert packed(np.full(4, 3.0))["offset"] == 3.0


def test_thinning_keeps_the_extremes() -> None:
    rng = np.random.default_rng(5)
    curve, other = rng.normal(size=20_000), rng.normal(size=20_000)
    rows = svg.thinned(np.arange(20_000.0), [curve, other], 100)
    assert len(rows) <= 402 and rows[0] == 0 and rows[-1] == 19_999
    assert np.all(np.diff(rows) > 0)
    for bucket in np.array_split(np.arange(20_000), 100):
        inside = rows[(rows >= bucket[0]) & (rows <= bucket[-1])]
        assert curve[inside].max() == curve[bucket].max()
        assert other[inside].min() == other[bucket].min()


# --- in a browser -----------------------------------------------------------------------


class Watched:
    """A page with what it said on the console and asked for."""

    def __init__(self, browser: Any, path: Path, **options: Any) -> None:
        options = {"viewport": {"width": 1366, "height": 900}, **options}
        self.context = browser.new_context(**options)
        self.page = self.context.new_page()
        self.page.set_default_timeout(90_000)
        self.faults: list[str] = []
        self.requests: list[str] = []
        self.dialogs: list[str] = []
        self.page.on("console", self._said)
        self.page.on("pageerror", lambda error: self.faults.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("dialog", self._asked)
        self.page.goto(path.as_uri())
        # A phone folds the sections, and every page all plots but the first.
        unfold = (
            "for (const part of document.querySelectorAll('details.part, details:has(.plot)'))"
            " part.open = true"
        )
        self.page.evaluate(unfold)

    def _said(self, message: Any) -> None:
        if message.type in ("error", "warning"):
            self.faults.append(message.text)

    def _asked(self, dialog: Any) -> None:
        self.dialogs.append(dialog.message)
        dialog.dismiss()

    def draw_all(self) -> int:
        """Scroll every plot into view and wait until it stands; how many there are."""
        plots = self.page.locator("figure.plot")
        for i in range(plots.count()):
            plots.nth(i).scroll_into_view_if_needed()
            self.page.wait_for_function(f"window.sysidPlots.has('plot-{i}')")
        self.page.wait_for_timeout(500)
        return int(plots.count())

    def time_range(self, plot: str) -> tuple[float, float]:
        start, end = self.page.evaluate(
            "(id) => { for (const m of window.sysidPlots.get(id).model.references())"
            " if (m.type === 'Range1d') return [m.start, m.end]; }",
            plot,
        )
        return start, end

    def range_after(
        self, plot: str, before: tuple[float, float], gesture: Callable[[], None]
    ) -> tuple[float, float]:
        """After a gesture, which a busy machine may lose: it is made again."""
        for _ in range(3):
            gesture()
            for _ in range(100):
                after = self.time_range(plot)
                if after != before:
                    return after
                self.page.wait_for_timeout(100)
        raise AssertionError(f"the time range stays at {before}")

    def close(self) -> None:
        self.context.close()


@pytest.fixture(scope="module")
def drawn(made: Made, browser: Any) -> Iterator[Watched]:
    """The report in a window, every plot drawn."""
    watched = Watched(browser, made.path, color_scheme="light")
    assert watched.draw_all() >= 3
    yield watched
    watched.close()


def test_page_is_quiet_and_complete(
    made: Made, browser: Any, drawn: Watched, tmp_path: Path
) -> None:
    """No console error, no request, every figure has a box; in both schemes and on a phone."""
    cases: dict[str, dict[str, Any] | None] = {
        "light": None,
        "dark": {"color_scheme": "dark"},
        "phone": {"viewport": {"width": 390, "height": 800}, "color_scheme": "light"},
    }
    shades = {}
    for name, options in cases.items():
        watched = drawn if options is None else Watched(browser, made.path, **options)
        assert options is None or watched.draw_all() >= 3
        page = watched.page
        boxes = page.evaluate(
            "[...document.querySelectorAll('figure, figure svg, .canvas')]"
            ".filter((e) => !e.closest('[hidden]'))"
            ".map((e) => [e.getBoundingClientRect().width, e.getBoundingClientRect().height])"
        )
        assert len(boxes) > 40
        assert all(w > 50 and h > 50 for w, h in boxes)
        assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        page.evaluate("window.scrollTo(0, 0)")
        shot = tmp_path / f"{name}.png"
        page.screenshot(path=str(shot))
        assert shot.stat().st_size > 10_000
        shades[name] = page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert watched.faults == []
        assert all(u.startswith(("file:", "data:", "blob:")) for u in watched.requests)
        assert len([u for u in watched.requests if u.startswith("file:")]) == 1
        if options is not None:
            watched.close()
    assert shades["light"] != shades["dark"]


LOOKS = {
    "desktop, light": {"viewport": {"width": 1400, "height": 900}, "color_scheme": "light"},
    "desktop, dark": {"viewport": {"width": 1400, "height": 900}, "color_scheme": "dark"},
    "half a screen": {"viewport": {"width": 800, "height": 900}, "color_scheme": "light"},
    "phone, light": {"viewport": {"width": 390, "height": 800}, "color_scheme": "light"},
    "phone, dark": {"viewport": {"width": 390, "height": 800}, "color_scheme": "dark"},
    # A4 less its margins, at 96 px an inch.
    "A4": {"viewport": {"width": 688, "height": 1000}, "color_scheme": "light"},
}


@pytest.fixture(scope="module")
def part_reports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Reports of parts tested alone: an axis, a linear axis under pressure, and a tank."""
    folder = tmp_path_factory.mktemp("parts")
    return {name: write_part_report(name, folder) for name in PART_NAMES}


@pytest.mark.parametrize("size", [5.0, 2e-5, 123456.0])
def test_a_label_stands_clear_of_wide_tick_labels(size: float) -> None:
    from sysid.blocks import svg
    from sysid.blocks.figures import Figure, Line, Panel, Scale

    x = np.linspace(0.0, 1.0, 9)
    panel = Panel(Scale("Time", "s"), Scale("Residual", "kPa"), (Line(x, size * (x - 0.5)),))
    drawn = svg.picture(Figure("f", "Residual", "", (panel,))).svg
    edge = re.search(r'x="([-\d.]+)"[^>]*rotate\(-90[^>]*>Residual', drawn)
    # Turned, its letters reach from its baseline to the left by their height, 8.6 pt.
    assert edge is not None and float(edge[1]) >= 8.6


@pytest.mark.parametrize("look", LOOKS)
def test_nothing_is_clipped_and_no_texts_overlap(
    made: Made, part_reports: dict[str, Path], browser: Any, look: str
) -> None:
    for name, path in {"actuator": made.path, **part_reports}.items():
        watched = Watched(browser, path, **LOOKS[look])
        if look == "A4":
            watched.page.emulate_media(media="print")
        assert box_faults(watched.page) == [], name
        watched.close()


def test_boxes_show_what_is_wrong(browser: Any, tmp_path: Path) -> None:
    """The measure finds a clipped table, an overlap and a text that a picture cuts."""
    page = tmp_path / "page.html"
    page.write_text(
        "<body><div class='scroll' style='overflow-x:auto;width:50px'><table><tr><td>"
        "unbreakableandlong</td></tr></table></div><p>one</p><p style='margin-top:-1.9em'>two</p>"
        "<svg aria-labelledby='cut' viewBox='0 0 50 20' width='50' height='20'>"
        "<text x='30' y='12'>longer than this</text></svg></body>"
    )
    watched = Watched(browser, page)
    found = " ".join(box_faults(watched.page))
    for fault in ("table cut by its frame", "texts overlap in the page", "text cut by its picture"):
        assert fault in found
    watched.close()


def test_a_part_s_report_begins_with_its_finding_and_names_its_logs(
    part_reports: dict[str, Path],
) -> None:
    """Held-out logs by name, gauge pressures, nothing of the valves that a cylinder alone lacks."""
    text = part_reports["cylinder"].read_text()
    box = text[text.index('id="verdict"') : text.index('id="data"')]
    assert box.index("The part, tested alone, follows its held-out tests") < box.index(
        "Effects found: seal friction"
    )
    assert re.search(r": force to [\d.]+ %, with an RMSE of [\d.]+ N \(a correct model", box)
    assert "PWM surfaces" not in box and "run sysid refine" not in box
    assert "held-out test: test_4.csv" in text and "Force, test_4.csv" in text
    assert "gauge pressure sum times direction" in text
    assert "valve-pwm" not in text[text.index('id="provenance"') :]


def test_what_was_asked_for_of_a_part_gives_its_colour(part_reports: dict[str, Path]) -> None:
    """Static friction, of which there is no test, is listed, and no concern."""
    text = part_reports["cylinder"].read_text()
    box = text[text.index('id="verdict"') : text.index('id="data"')]
    assert "Not identified: Static friction" in box and "static friction not identified" not in box


def test_what_is_not_identified_is_named_and_said_once_a_reason(made: Made) -> None:
    """Two numbers of which only a sum is known are one line, in words; all limit the colour."""
    assert made.bundle.friction is not None
    lacks = Estimate.unidentified("Nm", "only coulomb_nm + 0.5 viscous_nm_s_per_rad is identified")
    static = Estimate.unidentified("Nm", "give ramps")
    friction = made.bundle.friction.replaced(
        coulomb_nm=lacks, viscous_nm_s_per_rad=lacks, static_nm=static
    )
    bundle = made.bundle.replaced(friction=friction)
    found = verdict(bundle, made.validation)
    said = "Coulomb friction + 0.5 rad/s × viscous friction is identified"
    assert [n for n in found.notes if said in n] == [
        f"Not identified: Coulomb friction and viscous friction: only {said}"
    ]
    names = "static friction, Coulomb friction and viscous friction not identified"
    assert names in [c.name for c in found.concerns]
    section = next_section(bundle, None, "campaign.toml")
    assert section is not None
    (lacking,) = (b for b in section.blocks if isinstance(b, Table))
    helps = {row[0]: row[1:] for row in lacking.rows}
    assert helps["Static friction"] == ("not identified", "ramps")


def test_effects_that_tests_do_not_distinguish_are_told_on_the_first_screen(made: Made) -> None:
    content = json.loads(json.dumps(DIAGNOSIS))
    content["effects"][0] |= {"ambiguous_with": ["backlash"], "advice": "slow ramps"}
    content["figures"]["titles"]["backlash"] = "Backlash in the motor's gear"
    said = next_line(made.bundle, content)
    assert "Stribeck friction; or backlash in the motor's gear. To distinguish them: slow" in said


def test_a_question_that_no_test_answers_is_open() -> None:
    bundle = read_bundle(golden_bundle("diagnosed"))
    assert bundle.friction is not None
    known = Estimate(0.003, 1e-4, "Nm", (0.0028, 0.0032))
    bundle = bundle.replaced(friction=bundle.friction.replaced(offset_nm=known))
    content = {**DIAGNOSIS, "verdict": "effects-found", "unexplained": []}
    first = {**DIAGNOSIS["effects"][0], "ambiguous_with": ["backlash"], "advice": ""}
    said = next_line(bundle, {**content, "effects": [first]})
    assert said.startswith("These tests do not say which it is: Stribeck friction; or backlash.")
    assert "No test is known" in said
    told = verdict_lines(bundle, {**content, "effects": [first]})[-1]
    assert told.removeprefix("Next: ") == said.removesuffix(".")
    small = {"friction.coulomb_nm": 1e-4}
    assert next_line(bundle, {**content, "effects": [first]}, None, lambda: small, 0.06) == said
    # A test that is known comes before, whichever effect it is of.
    testable = {**DIAGNOSIS["effects"][1], "advice": "two known pressures"}
    said = next_line(bundle, {**content, "effects": [first, testable]})
    assert said.endswith("To distinguish them: two known pressures.")


@pytest.mark.parametrize(
    ("repeats", "scatter", "own", "told"),
    [
        (0.9, 0.1, False, "repeats over velocity: the law's form is not quite the rig's; an"),
        (0.1, 0.9, False, "differs from test to test: log what may differ"),
        (0.9, 0.1, True, "a term of the component can add"),
    ],
)
def test_errors_above_the_noise_leave_a_question_open(
    repeats: float, scatter: float, own: bool, told: str
) -> None:
    bundle = read_bundle(golden_bundle("diagnosed"))
    errors = {"before": 4.0, "after": 1.2, "noise_floor": 0.1}
    rest = {"channel": "motor_force_n", "unit": "N", "rmse": 1.0, "noise": 0.1,
            "repeatable": repeats, "scatter": scatter, "regressors": ["velocity"]}  # fmt: skip
    content = {
        "verdict": "effects-found", "component": "axis", "effects": [], "unexplained": [],
        "because": None, "residual": {"motor_force_n": errors}, "remainder": [rest],
        "figures": {}, **({"own": {"motor_force_n": "N"}} if own else {}),
    }  # fmt: skip
    said = next_line(bundle, content)
    assert "on held-out tests are still 12 times the noise" in said and told in said
    assert verdict_lines(bundle, content)[-1] == f"Next: {said.removesuffix('.')}"
    section = next_section(bundle, content, "c.toml")
    assert section is not None and "No question is open" not in str(section)
    # A correct law's errors leave none.
    content["residual"] = {"motor_force_n": {**errors, "after": 0.2}}
    assert "times the noise" not in next_line(bundle, content)


def test_errors_of_a_channel_are_in_one_unit() -> None:
    """Of a part in Pa, of an actuator in that of its open-loop errors: in sentences, tables and
    figures, those of the law's fit and of the remainder among them."""
    pressure = channel_of("pressure_a_pa")
    part = {"component": "tank"}
    assert error_unit(pressure, is_alone=True) == ("Pa", 1.0)
    assert balance_unit("Pa", is_alone=True) == ("Pa", 1.0)
    assert balance_unit("Pa", is_alone=False) == ("kPa", 1e-3)
    assert balance_unit("Nm", is_alone=False) == ("mN·m", 1e3)
    figure = waterfall(pressure, [151.0], [], 2.07, part)
    assert figure.panels[0].x.unit == "Pa" and "correct model is 2.07 Pa" in figure.description
    assert error_unit(pressure, is_alone=False) == ("kPa", 1e-3)
    figure = waterfall(pressure, [151.0], [], 2.07)
    assert figure.panels[0].x.unit == "kPa" and "bundle has 0.151 kPa" in figure.description


@pytest.mark.parametrize("use", ["fit", "holdout"])
def test_a_part_says_which_tests_its_errors_are_of(use: str) -> None:
    from sysid.diagnosis.tables import errors_table
    from sysid.diagnosis.wording import sentence

    content = {
        "verdict": "unexplained", "because": "held-out errors", "component": "tank",
        "judged_on": use, "effects": [], "unexplained": [], "refined": False,
        "residual": {"pressure_a_pa": {"before": 634.0, "after": 634.0, "noise_floor": 5.55}},
    }  # fmt: skip
    named = {"fit": "training tests, each excluded from the fit in turn", "holdout": "held-out"}
    said = sentence(content)
    drawn = waterfall(channel_of("pressure_a_pa"), [634.0], [], 5.55, content)
    for text in (said, errors_table(content).caption, drawn.title):
        assert named[use] in text
        assert ("held-out" in text) == (use == "holdout")
    short = "training tests" if use == "fit" else "held-out tests"
    assert drawn.panels[0].x.name == f"RMSE on {short}"
    assert f"the errors on {short} are far above" in said


def test_a_regressor_has_its_unit_by_either_name() -> None:
    """A part names it in words, an actuator by its key."""
    for name in ("position times direction", "angle times direction"):
        axis, scale = regressor_axis(name, is_linear=True)
        assert (axis.unit, scale) == ("mm", 1e3)


def test_an_error_far_below_is_a_bound() -> None:
    figure = waterfall(channel_of("position_m"), [8e-3, 6e-3], ["+ one"], 9e-10)
    assert "correct model is less than 0.006 mm" in figure.description


def test_a_section_starts_an_a4_page(part_reports: dict[str, Path], browser: Any) -> None:
    path = part_reports["axis"]
    watched = Watched(browser, path)
    pdf = watched.page.pdf(prefer_css_page_size=True)
    sections = len(outline(path.read_text("utf-8")).of("section"))
    boxes = re.findall(rb"/MediaBox \[0 0 ([0-9.]+) ([0-9.]+)\]", pdf)
    assert len(boxes) >= sections
    assert {(round(float(w)), round(float(h))) for w, h in boxes} == {(595, 842)}
    watched.close()


def test_zoom_and_hover(drawn: Watched) -> None:
    page = drawn.page
    page.evaluate("document.getElementById('plot-0').scrollIntoView()")
    page.wait_for_timeout(500)
    box = page.locator("#plot-0 .canvas").bounding_box()
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 90
    whole = drawn.time_range("plot-0")

    def wheel() -> None:
        page.mouse.move(x - 10, y)
        page.mouse.move(x, y)
        page.mouse.wheel(0, -300)

    def box_zoom() -> None:
        page.mouse.move(x - 80, y)
        page.wait_for_timeout(200)
        page.mouse.down()
        page.mouse.move(x, y, steps=8)
        page.mouse.move(x + 80, y, steps=8)
        page.wait_for_timeout(200)
        page.mouse.up()

    wheeled = drawn.range_after("plot-0", whole, wheel)
    assert whole[0] < wheeled[0] < wheeled[1] < whole[1]
    page.wait_for_timeout(800)
    wheeled = drawn.time_range("plot-0")
    boxed = drawn.range_after("plot-0", wheeled, box_zoom)
    assert boxed[1] - boxed[0] < wheeled[1] - wheeled[0]
    page.mouse.move(x - 20, y)
    page.mouse.move(x - 15, y + 1)
    tooltip = page.locator(".bk-Tooltip").first
    tooltip.wait_for(state="visible")
    assert "measured" in tooltip.evaluate("(e) => e.shadowRoot.textContent")
    assert drawn.faults == []


def test_plots_by_keyboard(drawn: Watched) -> None:
    page = drawn.page
    page.locator("#plot-0 .interactive").focus()
    page.keyboard.press("0")
    whole = drawn.time_range("plot-0")
    zoomed = drawn.range_after("plot-0", whole, lambda: page.keyboard.press("+"))
    assert zoomed[1] - zoomed[0] == pytest.approx(0.5 * (whole[1] - whole[0]))
    moved = drawn.range_after("plot-0", zoomed, lambda: page.keyboard.press("ArrowRight"))
    assert moved[0] > zoomed[0]
    assert page.locator("#plot-0 output").inner_text().endswith(" s")
    assert drawn.range_after("plot-0", moved, lambda: page.keyboard.press("0")) == pytest.approx(
        whole
    )


def test_first_tab_reaches_the_skip_link(made: Made, browser: Any) -> None:
    watched = Watched(browser, made.path)
    watched.page.keyboard.press("Tab")
    assert watched.page.evaluate("document.activeElement.className") == "skip"
    box = watched.page.locator(".skip").bounding_box()
    assert box["x"] >= 0 and box["height"] > 15
    watched.page.keyboard.press("Enter")
    assert watched.page.evaluate("location.hash") == "#verdict"
    watched.close()


def test_plots_show_every_sample(made: Made, drawn: Watched) -> None:
    """What the script unpacks is what was simulated, to the 16 bits' step."""
    shown = drawn.page.evaluate(
        "() => { for (const m of window.sysidPlots.get('plot-0').model.references())"
        " if (m.type === 'ColumnDataSource' && m.name === 'theta_rad')"
        " return { time: [...m.data.time], measured: [...m.data.measured],"
        " simulated: [...m.data.sim_discrete] }; }"
    )
    first = made.validation.select("holdout", "discrete")[0].tests[0]
    assert shown["time"] == pytest.approx(first.time.tolist(), abs=1e-6)
    for key, values in (("measured", first.measured), ("simulated", first.simulated)):
        step = float(np.ptp(first.measured["theta_rad"])) / 65_000
        assert np.abs(np.array(shown[key]) - values["theta_rad"]).max() < 2 * step


def test_without_javascript_static_figures_remain(made: Made, browser: Any) -> None:
    watched = Watched(browser, made.path, java_script_enabled=False)
    for i in range(watched.page.locator("figure.plot").count()):
        plot = watched.page.locator("figure.plot").nth(i)
        assert plot.locator(".static svg").first.is_visible()
        assert not plot.locator(".interactive").is_visible()
    watched.close()


def test_print_shows_static_figures(drawn: Watched) -> None:
    drawn.page.emulate_media(media="print")
    plot = drawn.page.locator("figure.plot").first
    assert plot.locator(".static svg").first.is_visible()
    assert not plot.locator(".interactive").is_visible()
    assert not drawn.page.locator("nav").is_visible()
    assert drawn.page.pdf()[:5] == b"%PDF-"
    drawn.page.emulate_media(media="screen")


def test_hostile_names_show_as_text(hostile: Path, browser: Any) -> None:
    watched = Watched(browser, hostile)
    watched.draw_all()
    page = watched.page
    page.evaluate("document.querySelectorAll('details').forEach((d) => { d.open = true; })")
    assert HOSTILE_NAME in page.locator("h1").inner_text()
    assert HOSTILE_FILE in page.locator("main").inner_text()
    assert HOSTILE_NAME in page.title()
    assert watched.dialogs == []
    assert watched.faults == []
    assert all(u.startswith(("file:", "data:", "blob:")) for u in watched.requests)
    watched.close()
