"""`sysid run`: stages, resuming, staleness, and what an interruption leaves behind."""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
from small_campaign import write_small

from sysid.commands.app import main
from sysid.commands.printing import grouped_notices
from sysid.commands.run import show_run
from sysid.errors import InputError, NotIdentifiedError
from sysid.io.campaign import read_campaign
from sysid.parameters import Bundle, EffectEntry, read_bundle, write_bundle
from sysid.pipeline.run import (
    EXPORTS,
    PipelineRun,
    RunOptions,
    RunReport,
    _may_do_more,
    digests,
    has_whole_diagnosis,
    perform,
    run_campaign,
    stages_of,
)

# Without the refinement of the whole model, which takes longer than the others together:
# `test_refine_command.py` has its stage.
STAGES = ("check", "fit", "diagnose", "validate", "report", "export")


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One that a test may change."""
    return write_small(tmp_path_factory.mktemp("campaign"))


@pytest.fixture(scope="module")
def first(campaign: Path, tmp_path_factory: pytest.TempPathFactory) -> RunReport:
    return run_campaign(campaign, tmp_path_factory.mktemp("results"), refine=False)


BY_BUDGET = {"cut_short_after_s": 10.0, "cut_short_by_count": False}
BY_COUNT = BY_BUDGET | {"cut_short_by_count": True}


@pytest.mark.parametrize(
    ("record", "budget", "again"),
    [
        ({}, None, False),
        ({}, 20.0, False),
        ({"cut_short_after_s": 10.0}, None, True),  # of an earlier program
        (BY_BUDGET, None, True),
        (BY_BUDGET, 10.0, False),
        (BY_BUDGET, 20.0, True),
        (BY_COUNT, None, False),
        (BY_COUNT, 5.0, False),
        (BY_COUNT, 20.0, True),
    ],
)
def test_what_was_cut_short_is_done_again_where_more_can_be_done(
    record: dict[str, Any], budget: float | None, again: bool
) -> None:
    assert _may_do_more(budget, record) is again


def done(run: RunReport) -> list[str]:
    return [stage.name for stage in run.stages if stage.why is not None]


def rows(shown: str) -> dict[str, str]:
    """What a summary's table says of each stage."""
    found = (re.fullmatch(r"(\w+) +(\S.*?) +\d+\.\d *", line) for line in shown.splitlines())
    return {match[1]: match[2] for match in found if match and match[1] in STAGES}


def test_the_summary_says_what_was_done(
    first: RunReport, capsys: pytest.CaptureFixture[str]
) -> None:
    show_run(first, as_json=False)
    assert rows(capsys.readouterr().out) == dict.fromkeys(STAGES, "done")


def test_the_summary_ends_with_the_verdict_in_three_lines(
    first: RunReport, capsys: pytest.CaptureFixture[str]
) -> None:
    show_run(first, as_json=False)
    last = capsys.readouterr().out.splitlines()[-3:]
    assert [line.partition(": ")[0] for line in last] == ["Model", "Diagnosis", "Next"]
    assert "position fits to" in last[0] and "held-out" in last[0]
    assert first.diagnosis is not None
    assert all(effect["id"] in last[1] for effect in first.diagnosis["effects"])


def test_what_nobody_asked_for_is_counted_and_shown_with_v(
    first: RunReport, capsys: pytest.CaptureFixture[str]
) -> None:
    assert first.unasked and set(first.unasked) < set(first.notices)
    show_run(first, as_json=False)
    short = capsys.readouterr().err
    assert f"{len(first.unasked)} notices on what the exports omit" in short
    assert not any(line in short for line in first.unasked)
    show_run(first, as_json=False, verbose=True)
    whole = capsys.readouterr()
    assert all(line in whole.err for line in first.notices)
    assert "Open-loop validation" in whole.out
    assert first.to_json()["notices"] == list(first.notices)


def test_notices_of_one_kind_are_one_with_what_differs(capsys: pytest.CaptureFixture[str]) -> None:
    grouped_notices(
        [
            "valve A: no test above duty 0.74",
            "valve B: no test above duty 0.98",
            "runs/b.csv, tests 45, 46: excluded",
            "other.csv, tests 3, 4: excluded",
            "another thing",
        ]
    )
    assert capsys.readouterr().err.splitlines() == [
        "sysid: notice: valve A: no test above duty 0.74 (likewise valve B, duty 0.98)",
        "sysid: notice: runs/b.csv, tests 45, 46: excluded (likewise other.csv, tests 3, 4)",
        "sysid: notice: another thing",
    ]
    grouped_notices([f"{i}.csv: {i} samples lack" for i in range(9)])
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("(likewise 1.csv, 1; 2.csv, 2; 3.csv, 3; and 5 more: -v shows them)")


def test_a_quick_diagnosis_says_what_it_left_out_and_is_made_anew(
    first: RunReport, campaign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(first.folder, tmp_path, dirs_exist_ok=True)
    read = read_campaign(campaign)
    said: list[str] = []
    inputs = digests(read)
    asked = RunOptions(refine=False, quick=True, progress=said.append)
    quick = PipelineRun(read, tmp_path, asked, inputs)
    assert has_whole_diagnosis(quick)
    assert not has_whole_diagnosis(PipelineRun(read, tmp_path, replace(asked, seed=1), inputs))
    quick = PipelineRun(read, tmp_path, replace(asked, refine=True), inputs)
    state = json.loads((tmp_path / "run.json").read_text())
    del state["diagnose"]
    (tmp_path / "run.json").write_text(json.dumps(state))
    stage = next(s for s in stages_of(quick) if s.name == "diagnose")
    report = perform(quick, stage)
    assert not report.complete and report.outcome == "done, incomplete"
    assert any("without --quick" in line for line in quick.notices)
    content = json.loads((tmp_path / "diagnosis.json").read_text())
    missed = {entry["stage"]: entry["reason"] for entry in content["search"]["missed"]}
    assert not content["search"]["complete"]
    assert set(missed.values()) == {"left out by --quick"}
    assert "simulation of twins" in missed and "refinement of the numbers by simulation" in missed
    assert not has_whole_diagnosis(quick)
    assert perform(quick, stage).why is None

    def stop(*_: Any, **__: Any) -> None:
        raise NotIdentifiedError("stopped by the test")

    monkeypatch.setattr("sysid.pipeline.run.diagnose", stop)
    whole = PipelineRun(read, tmp_path, replace(asked, quick=False), inputs)
    assert perform(whole, stage).why == "a quick diagnosis (--quick)"


def test_a_first_run_does_every_stage(first: RunReport) -> None:
    assert tuple(done(first)) == STAGES
    assert first.report.stat().st_size < 6_000_000
    for name in EXPORTS.values():
        assert (first.folder / name).stat().st_size > 1000
    assert first.bundle.validation is not None
    uses = {log.file: log.use for log in first.bundle.validation.validated()}
    assert uses["motion_discrete_2.csv"] == "holdout"
    assert uses["motion_discrete.parquet"] == "fit"


def test_held_out_logs_are_only_validated_on(first: RunReport) -> None:
    fitted = read_bundle(first.folder / "fitted.json").provenance.logs
    assert all(e.kind for e in fitted)
    assert not [e for e in fitted if e.use == "fit" and e.family.startswith("motion-")]
    listed = {e.sha256 for e in first.bundle.provenance.logs}
    assert {e.sha256 for e in fitted} < listed
    held_out = {e.sha256 for e in fitted if e.use == "holdout"}
    assert len(held_out) == 1
    assert not held_out & {e.sha256 for e in fitted if e.use == "fit"}


def test_a_second_run_does_nothing(
    first: RunReport, campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = run_campaign(campaign, first.folder, refine=False)
    assert done(again) == []
    show_run(again, as_json=False)
    assert rows(capsys.readouterr().out) == dict.fromkeys(STAGES, "up to date")


def test_a_resumed_report_shows_the_diagnosis_without_diagnosing_again(
    first: RunReport, campaign: Path
) -> None:
    diagnosis = json.loads((first.folder / "diagnosis.json").read_text())
    assert first.diagnosis == diagnosis
    first.report.unlink()
    assert done(run_campaign(campaign, first.folder, refine=False)) == ["report"]
    html = first.report.read_text("utf-8")
    assert '<section id="diagnosis"' in html and "fig-diagnosis-curve-0" in html


def test_a_later_report_shows_the_diagnosis_that_it_is_given(
    first: RunReport, campaign: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, found = tmp_path / "page.html", first.folder / "diagnosis.json"
    words = ["validate", str(campaign), "--bundle", str(first.folder / "bundle.json")]
    assert main([*words, "--report", str(page)]) == 0
    html = page.read_text("utf-8")
    assert '<section id="diagnosis"' not in html and "its diagnosis was not given" in html
    words += ["--diagnosis", str(found)]
    assert main([*words, "--report", str(page)]) == 0
    html = page.read_text("utf-8")
    assert '<section id="diagnosis"' in html and "fig-diagnosis-curve-0" in html
    capsys.readouterr()
    assert main(words) == 2 and "add --report" in capsys.readouterr().err
    words[3] = str(first.folder / "fitted.json")
    assert main([*words, "--report", str(page)]) == 2
    said = capsys.readouterr().err
    assert f"error: {found}: found seal-friction, {words[3]} has no effect; give" in said


def test_the_extended_bundle_is_what_is_validated(first: RunReport) -> None:
    """Effects that a diagnosis file says were found are in the bundle that the run ends in."""
    diagnosis = json.loads((first.folder / "diagnosis.json").read_text())
    effects = [entry.id for entry in read_bundle(first.folder / "bundle.json").effects]
    assert effects == [effect["id"] for effect in diagnosis["effects"]]
    assert first.to_json()["diagnosis"]["verdict"] == diagnosis["verdict"]
    assert "figures" not in first.to_json()["diagnosis"]


def test_an_effect_in_the_extended_bundle_reaches_the_later_stages(
    first: RunReport, campaign: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The stage's own work is put in the place of the diagnosis: a bundle with drag in it."""
    from sysid.pipeline import run as stages

    def with_drag(run: Any) -> None:
        bundle = read_bundle(run.path("fitted.json"))
        parameters = {"drag_nm_s2_per_rad2": {"value": 0.02, "unit": "Nm s2/rad2"}}
        drag = EffectEntry.model_validate({"id": "quadratic-drag", "parameters": parameters})
        write_bundle(bundle.with_effects([drag]), run.path("extended.json"))
        run.path("diagnosis.json").write_text((first.folder / "diagnosis.json").read_text())

    monkeypatch.setattr(stages, "_diagnose", with_drag)
    shutil.copytree(first.folder, tmp_path, dirs_exist_ok=True)
    state = json.loads((tmp_path / "run.json").read_text())
    del state["diagnose"]
    (tmp_path / "run.json").write_text(json.dumps(state))
    run = run_campaign(campaign, tmp_path, refine=False)
    assert done(run) == ["diagnose", "validate", "report", "export"]
    assert [entry.id for entry in run.bundle.effects] == ["quadratic-drag"]
    assert "quadratic-drag" in (tmp_path / EXPORTS["json"]).read_text()

    def error(bundle: Bundle) -> float:
        assert bundle.validation is not None
        return float(bundle.validation.validated()[0].channels["theta_rad"].rmse)

    assert error(run.bundle) > 1.2 * error(first.bundle)


def test_without_a_diagnosis_the_fitted_bundle_stands(
    campaign: Path, first: RunReport, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(first.folder, tmp_path, dirs_exist_ok=True)
    arguments = ["run", str(campaign), "-o", str(tmp_path), "--no-diagnose"]
    arguments += ["--no-refine", "--json"]
    assert main(arguments) == 0
    printed = json.loads(capsys.readouterr().out)
    assert [stage["name"] for stage in printed["stages"]] == [s for s in STAGES if s != "diagnose"]
    assert printed["diagnosis"] is None
    html = (tmp_path / "report.html").read_text("utf-8")
    assert '<section id="diagnosis"' not in html and "the model was not diagnosed" in html


def test_a_campaign_that_cannot_be_diagnosed_goes_on_without(
    campaign: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "campaign"
    shutil.copytree(campaign.parent, folder)
    path = folder / "campaign.toml"
    head, *blocks = path.read_text().split("[[log]]")
    kept = [b for b in blocks if "friction-static" in b or "friction-sliding" in b]
    path.write_text("[[log]]".join([head, *kept]))
    run = run_campaign(path, tmp_path / "results")
    assert tuple(done(run)) == (*STAGES[:3], "refine", *STAGES[3:])
    assert any(n.startswith("not refined: ") and "motion log" in n for n in run.notices)
    assert run.bundle.refinement is None
    assert any(n.startswith("not diagnosed: ") and "valve-discrete" in n for n in run.notices)
    assert run.diagnosis is None
    html = run.report.read_text("utf-8")
    assert "no discrete law of both valves" in html


def test_a_file_of_effects_is_read_before_the_work(
    campaign: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    effects = tmp_path / "own.py"
    effects.write_text("raise ValueError('not ready')\n")
    results = tmp_path / "results"
    arguments = ["run", str(campaign), "-o", str(results), "--effects", str(effects)]
    assert main(arguments) == 2
    assert "own.py, line 1" in capsys.readouterr().err
    assert not results.exists()


def test_what_is_missing_is_made_again(first: RunReport, campaign: Path) -> None:
    (first.folder / EXPORTS["c"]).unlink()
    again = run_campaign(campaign, first.folder, refine=False)
    assert done(again) == ["export"]
    assert "is missing" in (again.stages[-1].why or "")


def test_a_stage_is_done_again_with_a_reason(
    first: RunReport, campaign: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "results"
    shutil.copytree(first.folder, folder)
    (folder / EXPORTS["mat"]).unlink()
    state = json.loads((folder / "run.json").read_text())
    del state["report"]
    (folder / "run.json").write_text(json.dumps(state))
    said: list[str] = []
    again = run_campaign(campaign, folder, refine=False, progress=said.append)
    assert [stage.outcome for stage in again.stages[-2:]] == [
        "done",
        f"{EXPORTS['mat']} is missing: repeated",
    ]
    assert "check: up to date" in said and "report: starts" in said
    assert f"export: {EXPORTS['mat']} is missing; starts again" in said


def test_a_changed_log_makes_the_run_stale(
    first: RunReport,
    campaign: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The diagnosis, the longest stage, is begun again too; what it found stands in for it."""
    from sysid.pipeline import run as stages

    former = {n: (first.folder / n).read_text() for n in ("diagnosis.json", "extended.json")}

    def diagnosed_again(run: Any) -> None:
        for name, text in former.items():
            run.path(name).write_text(text)

    monkeypatch.setattr(stages, "_diagnose", diagnosed_again)
    path = campaign.parent / "motion_discrete_2.csv"
    path.write_text("# a remark that changes nothing but the file\n" + path.read_text())
    arguments = ["run", str(campaign), "-o", str(first.folder)]
    assert main([*arguments, "--no-refine", "--json"]) == 0
    captured = capsys.readouterr()
    stages = json.loads(captured.out)["stages"]
    assert all("motion_discrete_2.csv" in (stage["why"] or "") for stage in stages)
    assert "sysid: check: stale, changed: motion_discrete_2.csv; starts again\n" in captured.err


def test_a_file_of_another_layout_is_made_anew(tmp_path: Path) -> None:
    from sysid.pipeline.run import Stage, perform

    made: list[int] = []

    def write(run: Any) -> None:
        made.append(1)
        run.path("one.json").write_text("{}")

    run: Any = SimpleNamespace(
        inputs={}, options=RunOptions(surface="ann"), folder=tmp_path, notices=[], unasked=[],
        campaign=SimpleNamespace(own=None), path=lambda name: tmp_path / name,
    )  # fmt: skip
    old, new = (Stage("one", ("one.json",), (), write, layout=n) for n in (1, 2))
    assert perform(run, old).why and perform(run, old).why is None
    assert "layout" in (perform(run, new).why or "")
    assert perform(run, new).why is None and len(made) == 2


def test_another_flow_law_is_fitted_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`run --law` and `--load` reach the fit, and what was made without them is stale."""
    from sysid.commands import run as command
    from sysid.pipeline.run import Stage, made_from

    asked: list[RunOptions] = []

    def noted(campaign: Path, folder: Path, options: RunOptions) -> None:
        asked.append(options)
        raise InputError("enough")

    monkeypatch.setattr(command, "run_campaign", noted)
    arguments = ["run", "campaign.toml", "-o", str(tmp_path)]
    for more in ([], ["--law", "iso6358", "--load", "motor"]):
        assert main([*arguments, *more]) == 2
    capsys.readouterr()
    assert [(o.law, o.load) for o in asked] == [("auto", None), ("iso6358", "motor")]
    stage = Stage("fit", ("fitted.json",), (), lambda run: None)
    first, second = (
        made_from(
            cast(
                "PipelineRun",
                SimpleNamespace(inputs={}, options=o, campaign=SimpleNamespace(own=None)),
            ),
            stage,
        )
        for o in asked
    )
    assert dict(second.items() - first.items()) == {"--law": "iso6358", "--load": "motor"}


def test_an_unusable_folder_is_one_line(
    campaign: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert main(["run", str(campaign), "-o", str(tmp_path / "file" / "results")]) == 2
    assert "choose another with -o" in capsys.readouterr().err


def test_a_killed_run_leaves_whole_files_and_is_finished_by_the_next(
    campaign: Path, tmp_path: Path
) -> None:
    command = [sys.executable, "-m", "sysid", "run", str(campaign), "-o", str(tmp_path)]
    for seconds in (3.0, 7.0):
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as run:
            time.sleep(seconds)
            run.send_signal(signal.SIGKILL)
        for path in tmp_path.rglob("*.json"):
            json.loads(path.read_text())
    finished = run_campaign(campaign, tmp_path, diagnose=False, refine=False)
    assert finished.report.read_text().rstrip().endswith("</html>")
    assert not list(tmp_path.rglob(".sysid-*"))
