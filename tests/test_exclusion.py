"""`exclude` and `--exclude`: what is excluded is used for nothing, and what is left as before."""

from __future__ import annotations

import json
import math
import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from friction_trials import UNWRITTEN
from golden_folder import BUNDLED

import sysid as si
from datasets.generator.campaign import SMALL, GeneratedCampaign, make_campaign
from datasets.generator.files import write_log
from datasets.generator.rigs import rig_toml
from sysid.checks.log_check import LogCheck, check_log
from sysid.commands.app import main
from sysid.errors import InputError
from sysid.friction import fit_friction
from sysid.io.bare_rig import read_bare_logs
from sysid.io.campaign import MOTION_KINDS, Campaign, read_campaign
from sysid.io.exclusion import Exclusion, exclusions_of, parse_exclusion, shared_out
from sysid.io.log_constants import shown_constants
from sysid.io.logs import read_log
from sysid.io.own_kind import OwnKind, read_own_log
from sysid.io.rig import read_rig
from sysid.parameters import read_bundle
from sysid.pipeline.pages.report import render_report
from sysid.plant.trials import inputs_from_trial
from sysid.recording.motion_tests import prepare, prepare_all
from sysid.validation.open_loop import validate
from sysid.valve_discrete import fit_valve_discrete
from sysid.valve_pwm import fit_valve_pwm

# --- how it is given -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "test", "span"),
    [
        ("7", "7", (None, None)),
        ("12@3:4.5", "12", (3.0, 4.5)),
        ("12@3:", "12", (3.0, None)),
        ("12@:4.5", "12", (None, 4.5)),
        ("@1:2", "", (1.0, 2.0)),
        ("a@b@1:2", "a@b", (1.0, 2.0)),
        ("x@-1:2e-1", "x", (-1.0, 0.2)),
    ],
)
def test_texts_of_the_option(text: str, test: str, span: tuple[Any, Any]) -> None:
    found = parse_exclusion(text)
    assert (found.test, (found.from_s, found.to_s)) == (test, span)


@pytest.mark.parametrize("text", ["7@3", "7@:", "7@a:b", "7@4:3", "7@1:nan", "7@1:2:3"])
def test_texts_that_are_none(text: str) -> None:
    with pytest.raises(InputError, match=re.escape(f"--exclude {text}: ")):
        parse_exclusion(text)


def test_the_key_of_a_campaign() -> None:
    given = ["7", 8, {"test": "12", "from_s": 3, "to_s": 4.5, "why": "valve  stuck"}, {"to_s": 1}]
    found = exclusions_of(given, "[[log]] entry 1 (a.csv)", "c.toml")
    assert [(e.test, e.from_s, e.to_s, e.why) for e in found] == [
        ("7", None, None, ""),
        ("8", None, None, ""),
        ("12", 3.0, 4.5, "valve stuck"),
        ("", None, 1.0, ""),
    ]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("7", "exclude is not a list"),
        ([1.5], r"exclude\[1\] is neither a test nor a table"),
        ([True], r"exclude\[1\] is neither"),
        ([{"test": "1", "form_s": 1}], r"exclude\[1\]: form_s is not a key; did you mean .*from_s"),
        ([{"test": "1", "reason": "x"}], r"exclude\[1\] has a key that is none of test, from_s"),
        ([{"test": "1", "from_s": "1"}], r"from_s = '1' is not a time"),
        ([{"test": "1", "from_s": math.inf}], "from_s = inf is not a time"),
        (["2", {"test": "1", "from_s": 2, "to_s": 1}], r"exclude\[2\]: its span ends before"),
        ([{"test": ["1"]}], r"test = \['1'\] is not a label"),
        ([{"test": "1", "why": 3}], "why = 3 is not text"),
    ],
)
def test_keys_that_cannot_be_used(given: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        exclusions_of(given, "[[log]] entry 1 (a.csv)", "c.toml")


def test_the_option_means_every_log_that_has_the_test() -> None:
    logs = [(("a.csv",), ["1", "2"]), (("b.csv",), ["2", "a.csv/1"]), (("c.csv",), [""])]

    def of(*texts: str) -> list[list[str]]:
        return [[e.test for e in own] for own in shared_out(texts, logs)]

    assert of("2") == [["2"], ["2"], []]
    assert of("b.csv/2") == [[], ["2"], []]
    assert of("a.csv/1") == [["1"], ["a.csv/1"], []]
    assert of("@1:2") == [[], [], [""]]
    with pytest.raises(InputError, match=r"--exclude 9: no log holds a test '9'; .*a.csv: 1, 2;"):
        of("9")
    with pytest.raises(
        InputError, match=r"--exclude b.csv/1: b.csv holds no test '1'; .*tests are"
    ):
        of("b.csv/1")


# --- rows of a log -------------------------------------------------------------------------


@pytest.fixture
def folder(tmp_path: Path, rig_text: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "rig.toml").write_text(rig_text)
    monkeypatch.chdir(tmp_path)
    return tmp_path


ROWS = 100


def put(folder: Path, tests: Sequence[str] = ("1", "2"), **columns: Any) -> Path:
    """Tests of a second each at 10 ms; the position counts the file's rows."""
    n = ROWS * len(tests)
    frame = {
        "time_s": np.tile(np.arange(ROWS) / 100, len(tests)),
        "test": np.repeat(tests, ROWS),
        "theta_rad": 1e-3 * np.arange(n),
        "motor_torque_nm": np.full(n, 0.1),
        **columns,
    }
    table = pd.DataFrame({k: v for k, v in frame.items() if v is not None})
    table.to_csv(folder / "log.csv", index=False)
    return folder / "log.csv"


def left(folder: Path, *exclude: str) -> dict[str, tuple[int, float]]:
    """(rows, begun_s) of each test that is left."""
    log = si.read_log(folder / "log.csv", exclude=exclude)
    return {t.label: (len(t), round(t.begun_s, 9)) for t in log.trials}


def test_whole_tests_and_spans(folder: Path) -> None:
    put(folder)
    assert left(folder, "2") == {"1": (100, 0.0)}
    assert left(folder, "1@0:0.2") == {"1": (79, 0.21), "2": (100, 0.0)}
    assert left(folder, "1@0.5:") == {"1": (50, 0.0), "2": (100, 0.0)}
    assert left(folder, "1@0.2:0.3") == {
        "1 to 0.2 s": (20, 0.0),
        "1 from 0.3 s": (69, 0.31),
        "2": (100, 0.0),
    }
    assert list(left(folder, "1@0.2:0.3", "1@0.5:0.6", "2")) == [
        "1 to 0.2 s",
        "1 from 0.3 to 0.5 s",
        "1 from 0.6 s",
    ]
    log = si.read_log(folder / "log.csv", exclude=["1@0.2:0.3", "2"])
    first, second = log.trials
    # Position in the file, so that each row is the one that is meant.
    assert second["theta_rad"][0] == pytest.approx(31e-3)
    np.testing.assert_allclose(second.since_start, second.time, atol=1e-12)
    assert (first.has_its_start, second.has_its_start) == (True, False)
    assert [(e.exclusion.test, e.rows) for e in log.excluded] == [("1", 11), ("2", 100)]
    assert [n.split(": ", 1)[1] for n in log.notices if "excluded" in n] == [
        "test 1, from 0.2 to 0.3 s: 11 rows are excluded",
        "test 2: 100 rows are excluded",
    ]


def test_a_file_without_labels(folder: Path) -> None:
    put(folder, ["1"], test=None)
    assert list(left(folder, "@0.2:0.3")) == ["to 0.2 s", "from 0.3 s"]
    assert left(folder, "@0:0.2") == {"": (79, 0.21)}
    with pytest.raises(InputError, match="holds no test '1'; the file is one test without a label"):
        left(folder, "1")


def test_labels_stay_different(folder: Path) -> None:
    put(folder, ["1", "1 to 0.2 s"])
    assert list(left(folder, "1@0.2:0.3")) == ["1 to 0.2 s (2)", "1 from 0.3 s", "1 to 0.2 s"]


def test_times_run_on_and_are_of_a_calendar(folder: Path) -> None:
    put(folder, time_s=1.7e9 + np.arange(2 * ROWS) / 100)
    assert left(folder, "2@0.2:0.3")["2 from 0.3 s"] == (69, pytest.approx(0.31, abs=1e-6))


@pytest.mark.parametrize(
    ("exclude", "said"),
    [
        (["3"], "--exclude 3: .*log.csv holds no test '3'; its tests are 1, 2"),
        (["1@2:3"], "no row of test 1, from 2 to 3 s exists; it runs from 0 to 0.99 s"),
        (["1", "2"], "--exclude 1, --exclude 2: all of .*log.csv is excluded"),
        (["1@0:5", "2"], "all of .*log.csv is excluded"),
    ],
)
def test_what_does_not_exist(folder: Path, exclude: list[str], said: str) -> None:
    put(folder)
    with pytest.raises(InputError, match=said):
        left(folder, *exclude)


def wild(n: int = 2 * ROWS) -> dict[str, Any]:
    """Columns that are each refused, all in rows 20 to 30 of the first test."""
    time = np.tile(np.arange(ROWS) / 100, n // ROWS).astype(object)
    angle = (1e-3 * np.arange(n)).astype(object)
    effort = np.full(n, 0.1)
    time[24], time[26], time[28] = 0.05, "", 5e3
    angle[22], angle[23], angle[25] = "---", 1e9, ""
    effort[21] = 1e6
    return {"time_s": time, "theta_rad": angle, "motor_torque_nm": effort}


def test_excluded_rows_may_hold_anything(folder: Path) -> None:
    put(folder, **wild())
    with pytest.raises(InputError):
        left(folder)
    found = left(folder, "1@0.2:0.3")
    assert found == {"1 to 0.2 s": (20, 0.0), "1 from 0.3 s": (69, 0.31), "2": (100, 0.0)}
    assert left(folder, "1") == {"2": (100, 0.0)}


def test_the_rest_is_still_judged_in_its_own_line(folder: Path) -> None:
    columns = wild()
    columns["theta_rad"][150] = "x"
    put(folder, **columns)
    with pytest.raises(InputError, match="line 152: theta_rad = 'x' is not a number"):
        left(folder, "1@0.2:0.3")


def test_a_clock_that_starts_again_is_said(folder: Path) -> None:
    """Which of both passes is meant is not guessed, and a part has to begin at a known time."""
    time = np.tile(np.arange(ROWS) / 100, 2)
    time[30:ROWS] -= 0.3
    put(folder, time_s=time)
    with pytest.raises(InputError, match="line 52: time_s of test 1 starts again and runs through"):
        left(folder, "1@0.2:0.29")
    time[30:ROWS] = 0.001 * np.arange(ROWS - 30)
    put(folder, time_s=time)
    with pytest.raises(
        InputError, match=r"goes back across the excluded rows before, from 0.19 to"
    ):
        left(folder, "1@0.2:0.29")


def test_a_single_row_is_left_out(folder: Path) -> None:
    put(folder)
    log = si.read_log(folder / "log.csv", exclude=["1@0.01:0.2"])
    assert [t.label for t in log.trials] == ["1", "2"]
    assert any("fewer than two rows of test 1 remain there" in n for n in log.notices)


def test_a_component_of_ones_own(folder: Path) -> None:
    put(folder, u=np.r_[0.0, 1e300, np.zeros(2 * ROWS - 2)], theta_rad=None)
    own, rig = OwnKind("part", {"u": ""}), read_rig(folder / "rig.toml")
    with pytest.raises(InputError, match="beyond anything measured"):
        read_own_log(folder / "log.csv", rig, own)
    log = read_own_log(folder / "log.csv", rig, own, exclude=[Exclusion("1", 0.0, 0.5)])
    assert [(t.label, len(t)) for t in log.trials] == [("1", 49), ("2", 100)]
    assert log.trials[0].since_start[0] == pytest.approx(0.51)


def test_parquet(folder: Path) -> None:
    put(folder)
    pd.read_csv(folder / "log.csv").to_parquet(folder / "log.parquet")
    log = si.read_log(folder / "log.parquet", exclude=["1@0.2:0.3"])
    assert [(t.label, len(t)) for t in log.trials][:2] == [("1 to 0.2 s", 20), ("1 from 0.3 s", 69)]


# --- what a part is used for ----------------------------------------------------------------


def bundled(stem: str, *exclude: str) -> Any:
    return si.read_log(BUNDLED / f"{stem}.parquet", exclude=exclude)


RIG = read_rig(BUNDLED / "rig.toml")


def test_a_ramp_without_its_start_is_left_out() -> None:
    log = bundled("friction_static", "1@0:0.3", "2@0.2:0.3")
    found = fit_friction(log.trials, RIG)
    parts = [u for u in found.trials if u.reason.startswith("its start is excluded")]
    assert [u.label for u in parts] == ["1", "2 from 0.3 s"]
    assert {u.kind for u in found.trials} == {"friction-static"}
    assert found.static is not None


def test_constant_effort_goes_on_after_a_span() -> None:
    whole = fit_friction(bundled("friction_sliding").trials, RIG)
    log = bundled("friction_sliding", "1@0.5:0.6", "3@0:0.4")
    cut = fit_friction(log.trials, RIG)
    for name in ("coulomb_nm", "viscous_nm_s_per_rad"):
        assert abs(cut[name].value - whole[name].value) < 2.0 * whole[name].std


def test_valve_tests_after_a_span() -> None:
    """The delays are those of the edges that are left: one excluded is none at its part's start."""
    whole = fit_valve_discrete(bundled("valve_discrete_a").trials, RIG, find_ratio=False)
    labels = [t.label for t in bundled("valve_discrete_a").trials]
    spans = [f"{label}@0.9:1.05" for label in labels[1:]] + [f"{labels[0]}@2:2.5"]
    cut = fit_valve_discrete(bundled("valve_discrete_a", *spans).trials, RIG, find_ratio=False)
    for name in ("on_delay_s", "off_delay_s", "c_fill", "choked_flow_dis_kg_s"):
        one, other = whole["a"].estimates[name], cut["a"].estimates[name]
        assert other.identified
        assert abs(one.value - other.value) < 3.0 * math.hypot(one.std, other.std), name


def test_pulses_need_their_start() -> None:
    log = bundled("valve_pwm_a", "3@0:0.1", "4@0.1:0.2")
    found = fit_valve_pwm(log.trials, RIG, surface="bipolynomial")
    lines = [n for n in found.notices if "its start is excluded" in n]
    assert len(lines) == 1 and "tests 3, 4 from 0.2 s: excluded" in lines[0]


def test_constants_of_a_bare_log_come_from_what_is_left(tmp_path: Path) -> None:
    """A test's start is no rest where a part begins, and an excluded fault is no supply."""
    frame = pd.read_parquet(BUNDLED / "valve_discrete_a.parquet")
    clean = shown_constants([bundled("valve_discrete_a")], "theta_rad", "motor_torque_nm")
    since = frame.time_s - frame.groupby("test").time_s.transform("first")
    frame.loc[(since > 2.0) & (since < 3.0), "pressure_a_pa"] = 8e5
    frame.to_csv(tmp_path / "run.csv", index=False)
    tests = [str(t) for t in frame.test.unique()]
    exclude = [[Exclusion(t, 1.9, 3.1) for t in tests]]
    wrong = read_bare_logs([tmp_path / "run.csv"], {})
    right = read_bare_logs([tmp_path / "run.csv"], {}, exclude=exclude)
    assert right.rig.air is not None and wrong.rig.air is not None
    assert right.rig.air.supply_pressure_pa == pytest.approx(clean.supply_pa, rel=2e-3)
    assert right.rig.air.atmospheric_pressure_pa == pytest.approx(clean.atmosphere_pa, rel=2e-3)


# --- motion ---------------------------------------------------------------------------------

STEMS = ("motion_motor_2", "motion_pwm_2", "motion_discrete_2")
# A span in which nothing that the log shows is true.
FROM_S, TO_S = 1.0012, 1.2973


@pytest.fixture(scope="module")
def made() -> GeneratedCampaign:
    return make_campaign(1, size=SMALL, scatter=0.0, kinds=MOTION_KINDS, stems=STEMS)


@pytest.fixture(scope="module")
def campaign(made: GeneratedCampaign, tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    """Motion logs with a fault in each test, which their entries exclude."""
    folder = tmp_path_factory.mktemp("faulty")
    (folder / "rig.toml").write_text(rig_toml(made.rig.content))
    lines = ['rig = "rig.toml"']
    for log in made.logs:
        path = folder / f"{log.stem}.csv"
        write_log(path, log.tests, made.rig)
        frame = pd.read_csv(path, comment="#")
        labels = list(frame.test.astype(str).unique()) if "test" in frame else [""]
        inside = (frame.time_s >= FROM_S) & (frame.time_s <= TO_S)
        frame.loc[inside, "theta_rad"] = 30.0
        for name in ("pressure_a_pa", "pressure_b_pa"):
            frame[name] = frame[name].astype(float)
            frame.loc[inside, name] = -5e6
        frame.to_csv(path, index=False)
        spans = ", ".join(
            f'{{test = "{t}", from_s = {FROM_S}, to_s = {TO_S}, why = "cable out"}}' for t in labels
        )
        lines += ["[[log]]", f'kind = "{log.kind}"', f'file = "{log.stem}.csv"']
        lines += ['use = "holdout"', f"exclude = [{spans}]"]
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n")
    return read_campaign(folder / "campaign.toml")


def true_bundle(made: GeneratedCampaign, campaign: Campaign) -> Any:
    from test_validation import true_bundle as bundle_of

    return bundle_of(made, campaign.rig)


def test_a_part_is_simulated_from_the_state_that_it_has(
    made: GeneratedCampaign, campaign: Campaign
) -> None:
    """With the true parameters pressures differ by noise alone: phase, edges, state are right."""
    found = validate(campaign, true_bundle(made, campaign))
    noise = np.hypot(made.rig.truth.pressure_noise_pa, 26.0 / np.sqrt(12.0))
    tests = [t for log in found.select(model="discrete") for t in log.tests]
    parts = [t for t in tests if " from " in f" {t.test}"]
    assert len(tests) == 8 and len(parts) == 4
    for test in parts:
        assert test.time[0] > TO_S + 0.35
        assert len(test.time) == len(test.measured["theta_rad"]) == len(test.simulated["theta_rad"])
        for name in ("pressure_a_pa", "pressure_b_pa"):
            assert test.channels[name].errors.rmse == pytest.approx(noise, rel=0.06)
        assert test.channels["theta_rad"].errors.rmse < 2e-3


def test_pulses_go_on_as_before_the_span(campaign: Campaign) -> None:
    entry = next(e for e in campaign.logs if e.kind == "motion-pwm")
    assert campaign.rig.pwm is not None
    period = campaign.rig.pwm.period_s
    parts = [t for t in campaign.read(entry).trials if not t.has_its_start]
    assert len(parts) == 2
    for part in parts:
        periods = part.begun_s / period
        assert periods == pytest.approx(round(periods), abs=1e-6)
        assert 0.0 <= part.begun_s - TO_S < period + 1e-3


def test_effects_count_time_from_the_tests_start(campaign: Campaign) -> None:
    entry = campaign.logs[0]
    part = campaign.read(entry).trials[1]
    test = prepare(part, entry.kind, campaign.rig, 1.0)
    assert test.since_start[0] == part.begun_s == inputs_from_trial(part, campaign.rig).elapsed
    assert test.whole.run_up is not None
    assert all(s.start >= test.whole.start for s in test.segments)


def test_a_part_that_is_too_short_is_left_out(campaign: Campaign) -> None:
    entry = campaign.logs[0]
    log = campaign.excluding([f"{entry.file}/@1.5:"]).read(
        campaign.excluding([f"{entry.file}/@1.5:"]).logs[0]
    )
    tests, notices = prepare_all(log.trials, entry.kind, campaign.rig, 1.0)
    assert len(tests) == 1
    assert any("too short to be simulated" in n for n in notices)


# --- files and commands ----------------------------------------------------------------------


@pytest.fixture
def friction(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in ("rig.toml", "friction_sliding.parquet", "friction_static.parquet"):
        shutil.copy(BUNDLED / name, tmp_path)
    (tmp_path / "campaign.toml").write_text(
        'rig = "rig.toml"\n'
        '[[log]]\nkind = "friction-sliding"\nfile = "friction_sliding.parquet"\n'
        'exclude = ["2", {test = "3", from_s = 1.0, to_s = 1.2, why = "bumped <the> bench"}]\n'
        '[[log]]\nkind = "friction-static"\nfile = "friction_static.parquet"\n'
    )
    return tmp_path


def test_provenance_and_report_list_it(friction: Path) -> None:
    args = ["fit", "campaign.toml", "-o", "b.json", "--report", "r.html"]
    assert main([*args, "--exclude", "friction_static.parquet/1"]) == 0
    logs = {log.file: log.excluded for log in read_bundle(friction / "b.json").provenance.logs}
    content = json.loads((friction / "b.json").read_text())["provenance"]["logs"]
    assert content[0]["excluded"] == [
        {"test": "2"},
        {"test": "3", "from_s": 1.0, "to_s": 1.2, "why": "bumped <the> bench"},
    ]
    assert content[1]["excluded"] == [{"test": "1"}]
    assert all(logs.values())
    page = (friction / "r.html").read_text()
    rows = page.split("<caption>Excluded, not used at all")[1].split("</table>")[0]
    assert "bumped &lt;the&gt; bench" in rows and "from 1 to 1.2 s" in rows and "201" in rows
    assert rows.count("<tr") == 4


def test_a_page_without_a_check_lists_it_too(friction: Path) -> None:
    campaign = read_campaign(friction / "campaign.toml")
    bundle = si.fit(campaign)
    assert "bumped &lt;the&gt; bench" in render_report(campaign=campaign, bundle=bundle)


def test_nothing_is_added_where_nothing_is_excluded(friction: Path) -> None:
    assert main(["fit", "friction", "friction_sliding.parquet", "-o", "b.json", "--no-report"]) == 0
    (log,) = json.loads((friction / "b.json").read_text())["provenance"]["logs"]
    assert "excluded" not in log


def test_partial_fits_and_their_default_files(
    friction: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = "friction_sliding.parquet"
    assert main(["fit", "friction", log]) == 0
    assert main(["fit", "friction", log, "--exclude", "2", "--exclude", "1@0:0.5"]) == 0
    capsys.readouterr()
    bundle = read_bundle(friction / "friction_sliding.friction.bundle.json")
    (record,) = bundle.provenance.logs
    assert record.excluded is not None and [e.test for e in record.excluded] == ["2", "1"]
    page = (friction / "friction_sliding.friction.report.html").read_text()
    assert "Excluded, not used at all" in page
    assert main(["fit", "friction", log, *UNWRITTEN, "--exclude", "99"]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.startswith("sysid: error: --exclude 99: ") and "its tests are 1, 2, 3" in said


def test_check_shows_it(friction: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "friction_sliding.parquet", "--exclude", "2", "--json"]) == 0
    (content,) = json.loads(capsys.readouterr().out)["logs"]
    assert content["excluded"] == [{"test": "2", "rows": content["excluded"][0]["rows"]}]
    assert LogCheck.from_json(content).to_json()["excluded"] == content["excluded"]
    assert main(["check", "campaign.toml", "--exclude", "friction_static.parquet/1@0:0.1"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "excluded: test 3, from 1 to 1.2 s (201 rows): bumped <the> bench" in out
    assert "excluded: test 1, from 0 to 0.1 s (101 rows)" in out


def test_excluded_rows_count_in_no_range(friction: Path) -> None:
    rig = read_rig(friction / "rig.toml")
    frame = pd.read_parquet(friction / "friction_sliding.parquet")
    frame.loc[frame.test == frame.test.iloc[0], "theta_rad"] *= 1.5
    frame.to_csv(friction / "log.csv", index=False)
    label = str(frame.test.iloc[0])
    log = read_log(friction / "log.csv", rig, exclude=[Exclusion(label)])
    shown = next(c for c in check_log(log, rig).channels if c.name == "theta_rad")
    rest = frame[frame.test != frame.test.iloc[0]].theta_rad
    assert (shown.low, shown.high) == (rest.min(), rest.max())


def test_a_campaign_names_the_entry(friction: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = friction / "campaign.toml"
    path.write_text(path.read_text().replace('"2", ', '"2", "77", '))
    assert main(["fit", "campaign.toml"]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert re.search(
        r"campaign.toml, \[\[log\]\] entry 1 \(friction_sliding.parquet\): exclude\[2\]: .*holds "
        r"no test '77'; its tests are 1, 2",
        said,
    )
    path.write_text(path.read_text().replace("exclude =", "exclud ="))
    assert main(["fit", "campaign.toml"]) == 2
    assert "exclud is not a key; did you mean" in capsys.readouterr().err
