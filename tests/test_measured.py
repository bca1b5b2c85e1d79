"""The command that runs the measured sets: on a set made here, on canned results, on the real."""

from __future__ import annotations

import contextlib
import json
import shutil
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import own_components
import pytest
from measured_samples import (
    COULOMB,
    DROP,
    MASS,
    PERIOD,
    RECIPE,
    SPEED,
    campaign,
    canned,
    diagnosis,
    effect,
    make_set,
)

from datasets.measured import __main__ as command
from datasets.measured import run
from datasets.measured.findings import (
    BEGIN,
    COLUMNS,
    END,
    agreement,
    base_text,
    mains,
    markdown_table,
    overview,
    with_agreement,
    write_readme_table,
)
from datasets.measured.page import render_page
from datasets.measured.run import failed, law_of, run_sets
from datasets.measured.sets import SETS_FOLDER
from sysid.errors import InputError
from sysid.io.tables import read_table
from sysid.parameters.files import bundle_from_json

REPOSITORY = Path(__file__).resolve().parent.parent

# --- running --------------------------------------------------------------------------------


_ONE_AT_A_TIME = threading.Lock()


def _in_this_process(
    words: Sequence[str], *, cwd: Path, **_: Any
) -> subprocess.CompletedProcess[str]:
    """What `python -m sysid ...` would print and return; conversions ask for it from threads."""
    assert list(words[:3]) == [sys.executable, "-m", "sysid"]
    with _ONE_AT_A_TIME, contextlib.chdir(cwd):
        found = own_components.run(*words[3:])
    return subprocess.CompletedProcess(list(words), found.code, found.out, found.err)


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Commands are not started anew, for what does not depend on it."""
    monkeypatch.setattr(run, "subprocess", SimpleNamespace(run=_in_this_process))


def test_a_set_is_converted_fitted_and_diagnosed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Real conversions and fits, these started as a user starts them; what diagnose prints is
    canned, its arguments are checked."""
    file = make_set(tmp_path) / "set.toml"
    file.write_text(file.read_text().replace('"axis_3.csv"\n', '"axis_3.csv"\nrows = "0:4000"\n'))
    real, asked = run._sysid, []

    def sysid(arguments: list[str], folder: Path) -> dict[str, Any]:
        if arguments[0] != "diagnose":
            return real(arguments, folder)
        asked.append(arguments)
        assert (folder / arguments[arguments.index("--bundle") + 1]).is_file()
        return {**diagnosis(effect("stribeck-friction")), "written": [str(tmp_path)]}

    def begun(words: Sequence[str], **options: Any) -> subprocess.CompletedProcess[str]:
        begin = _in_this_process if words[3] == "convert" else subprocess.run
        return begin(words, **options)

    monkeypatch.setattr(run, "subprocess", SimpleNamespace(run=begun))
    monkeypatch.setattr(run, "_sysid", sysid)
    output, readme = tmp_path / "out" / "measured.html", tmp_path / "README.md"
    readme.write_text(f"# x\n{BEGIN}\n{END}\nend\n")
    options = ["--data", tmp_path / "data", "--sets", tmp_path / "sets", "-o", output]
    options += ["--work", tmp_path / "work", "--readme", readme]
    assert command.main([str(o) for o in options]) == 0
    said = capsys.readouterr()
    assert (
        "stribeck-friction, is named by 1 of 1 repeats" in said.out
        and "converting run3.txt" in said.err
    )
    logs = {
        k: read_table(tmp_path / "work" / "axis" / f"axis_{k}.csv", ("time_s",)) for k in (2, 3)
    }
    assert {k: len(log.frame) for k, log in logs.items()} == {2: 5000, 3: 4000}
    assert [arguments[1] for arguments in asked] == ["campaign.toml", "repeat_1.toml"]
    assert all("--report" in arguments and "-o" in arguments for arguments in asked)
    written = json.loads(output.with_suffix(".json").read_text())
    first = written["sets"][0]["campaigns"][0]
    law = first["law"]["friction.coulomb_n"]
    assert COULOMB < law["value"] < COULOMB + DROP  # a mean of the falling curve
    assert abs(first["law"]["friction.mass_kg"]["value"] / MASS - 1.0) < 0.05
    assert first["percent_down"] == {"motor_force_n": 75.0}
    assert "written" not in first["diagnosis"]
    for text in (output.read_text(), output.with_suffix(".json").read_text(), readme.read_text()):
        assert str(tmp_path) not in text and "stribeck-friction" in text


@pytest.mark.slow
@pytest.mark.usefixtures("in_this_process")
def test_a_set_through_the_ordinary_commands(tmp_path: Path) -> None:
    """Nothing canned: the friction that the test put in is found, and predicts what is held out."""
    make_set(tmp_path, period=2.0 * PERIOD)
    results = run_sets([tmp_path / "sets" / "axis"], tmp_path / "data", tmp_path / "work")
    assert not failed(results), [c["problem"] for c in results["sets"][0]["campaigns"]]
    for found in results["sets"][0]["campaigns"]:
        first = found["diagnosis"]["effects"][0]
        assert first["id"] == "stribeck-friction"
        assert abs(first["parameters"]["stribeck_force_n"]["value"] / DROP - 1.0) < 0.1
        assert abs(first["parameters"]["stribeck_velocity_m_per_s"]["value"] / SPEED - 1.0) < 0.1
        error = found["diagnosis"]["residual"]["motor_force_n"]
        assert error["after"] < 0.5 * error["before"]
    answer = agreement(results["sets"][0], results["sets"][0]["campaigns"][0])
    assert answer is not None and answer.agree == 1
    render_page(results)


def test_the_data_folder_is_absent(tmp_path: Path) -> None:
    """One line, exit 2, and nothing written."""
    make_set(tmp_path)
    output = tmp_path / "measured.html"
    options = ["--sets", str(tmp_path / "sets"), "--data", str(tmp_path / "none")]
    done = subprocess.run(
        [sys.executable, "-m", "datasets.measured", *options, "-o", str(output)],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1 and "none: the folder" in done.stderr
    assert "--data" in done.stderr and not output.exists() and not done.stdout


@pytest.mark.usefixtures("in_this_process")
def test_a_set_that_fails_says_so_and_the_others_go_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A recipe that names no column; a set.toml without a question; one campaign of two."""
    bad = make_set(tmp_path, "bad_recipe")
    (bad / "recipe.toml").write_text(RECIPE.replace('"#2:mm"', '"#9:mm"'))
    (make_set(tmp_path, "bad_set") / "set.toml").write_text('title = "No more than this"\n')
    broken = make_set(tmp_path, "one_campaign")
    (broken / "repeat_1.toml").write_text('rig = "rig.toml"\n')
    real = run._sysid

    def sysid(arguments: list[str], folder: Path) -> dict[str, Any]:
        return diagnosis() if arguments[0] == "diagnose" else real(arguments, folder)

    monkeypatch.setattr(run, "_sysid", sysid)
    output, readme = tmp_path / "measured.html", tmp_path / "README.md"
    readme.write_text(f"{BEGIN}\n{END}\n")
    options = ["--data", tmp_path / "data", "--sets", tmp_path / "sets", "-o", output]
    options += ["--work", tmp_path / "work", "--readme", readme]
    assert command.main([str(o) for o in options]) == 1
    assert "is unchanged" in capsys.readouterr().err
    assert readme.read_text() == f"{BEGIN}\n{END}\n"
    sets = json.loads(output.with_suffix(".json").read_text())["sets"]
    assert [s["name"] for s in sets] == ["bad_recipe", "bad_set", "one_campaign"]
    assert "sysid convert: error:" in sets[0]["problem"] and "#9" in sets[0]["problem"]
    assert "question is missing" in sets[1]["problem"] or "source is missing" in sets[1]["problem"]
    first, second = sets[2]["campaigns"]
    assert first["problem"] is None and first["diagnosis"]["verdict"] == "adequate"
    assert second["status"] == 2 and "no [[log]] entry" in second["problem"]
    page = output.read_text()
    assert str(tmp_path) not in page and page.count("Failed: ") == 2
    assert str(tmp_path) not in output.with_suffix(".json").read_text()


# --- what the runs say together -------------------------------------------------------------


def test_the_law_is_read_out_of_a_bundle() -> None:
    coulomb = {"value": 12.0, "std": 0.1, "unit": "N"}
    static = {"value": None, "identified": False, "reason": "no test at rest", "unit": "N"}
    flow = {"value": 1e-3, "std": 1e-5, "unit": "kg/s"}
    bundle = {
        "schema": "sysid-bundle/1",
        "created": "2026-01-02T03:04:05+00:00",
        "sysid_version": "0",
        "rig": {"rig": {"name": "axis", "motion": "linear"}},
        "friction": {
            "coulomb_n": coulomb,
            "static_n": static,
            "viscous_n_s_per_m": {"value": 3.0, "std": 0.2, "unit": "N s/m"},
            "static_by_position": [],
        },
        "valves": {"a": {"steady": {"full_flow_kg_s": flow}}},
        "effects": [{"id": "x", "parameters": {"x": {"value": 1.0, "unit": "-"}}}],
        "provenance": {"logs": [], "options": {"value": 3, "unit": "-"}},
    }
    law = law_of(bundle_from_json(bundle, Path("bundle.json")))
    assert list(law) == [
        "friction.coulomb_n",
        "friction.static_n",
        "friction.viscous_n_s_per_m",
        "valves.a.steady.full_flow_kg_s",
    ]
    assert law["friction.coulomb_n"] == coulomb and law["friction.static_n"] == static
    said = "friction: coulomb_n, viscous_n_s_per_m; valves.a.steady: full_flow_kg_s"
    assert base_text(law) == said


def test_repeats_are_counted() -> None:
    """By the same id, by one that either's recordings cannot tell from it, by none."""
    main = campaign("campaign.toml", diagnosis(effect("stribeck", ("dahl",)), effect("spring")))
    found = [
        diagnosis(effect("stribeck"), effect("spring")),
        diagnosis(effect("dahl")),
        diagnosis(effect("drag", ("spring",)), effect("ripple")),
        None,
    ]
    repeats = [campaign(f"r{i}.toml", d, "campaign.toml") for i, d in enumerate(found)]
    other = campaign("other.toml", diagnosis())
    measured = canned(main, *repeats, other)["sets"][0]
    answer = agreement(measured, main)
    assert answer is not None
    stribeck, spring = answer.namings
    assert (stribeck.same, stribeck.ambiguous, stribeck.agree) == (1, 1, 2)
    assert (spring.same, spring.ambiguous, spring.agree) == (1, 1, 2)
    assert (answer.agree, answer.repeats, answer.failed) == (1, 4, 1)
    assert answer.others == {"ripple": 1}
    assert "all named by 1 of 4 repeats: stribeck by 2 (1 by one" in answer.sentence
    assert agreement(measured, other) is None
    assert len(mains(measured)) == 2


def test_a_verdict_that_does_not_repeat_says_so_or_not() -> None:
    """By parts of its own fitted tests, not by an effect that is like it."""

    def found(agree: int) -> dict[str, Any]:
        named = {"parts": 3, "agree": agree, "named": []}
        return {**effect("drag", ("dahl",)), "repeats": named}

    repeats = [
        campaign("r1.toml", diagnosis(effect("spring")), "campaign.toml"),
        campaign("r2.toml", diagnosis(effect("spring"), effect("drag")), "campaign.toml"),
    ]

    def answer(agree: int) -> tuple[list[str], str]:
        main = campaign("campaign.toml", diagnosis(effect("spring"), found(agree)))
        got = agreement(canned(main, *repeats)["sets"][0], main)
        assert got is not None
        assert [n["status"] for n in got.to_json()["namings"]] == [n.status for n in got.namings]
        return [n.status for n in got.namings], got.sentence

    statuses, sentence = answer(2)
    assert statuses == ["repeated", "ambiguous"]
    assert sentence.endswith("The verdict itself says ambiguous of drag.")
    statuses, sentence = answer(3)
    assert statuses == ["repeated", "neither"]
    assert sentence.endswith("The verdict neither repeats nor says ambiguous of drag.")
    left_open = {**diagnosis(effect("spring")), "undecided": [{"id": "drag"}]}
    repeats[0] = campaign("r1.toml", left_open, "campaign.toml")
    statuses, sentence = answer(3)
    assert statuses == ["repeated", "ambiguous"]
    assert sentence.endswith("The repeats that do not name it say ambiguous of drag.")


def test_repeats_of_an_adequate_model_are_counted() -> None:
    main = campaign("campaign.toml", diagnosis())
    found = [diagnosis(), diagnosis(effect("dahl"))]
    repeats = [campaign(f"r{i}.toml", d, "campaign.toml") for i, d in enumerate(found)]
    answer = agreement(canned(main, *repeats)["sets"][0], main)
    assert answer is not None and (answer.agree, answer.repeats) == (1, 2)
    assert "No effect is named either by 1 of 2" in answer.sentence


def test_the_overview_has_a_row_a_campaign() -> None:
    rest = {"channel": "motor_force_n", "regressor": "velocity", "share": 0.123}
    found = diagnosis(effect("stribeck-friction", ("dahl",)))
    results = canned(campaign("campaign.toml", {**found, "unexplained": [rest]}))
    (row,) = overview(results)
    assert dict(zip(COLUMNS, row, strict=True)) == {
        "Set": "axis",
        "Found": "stribeck-friction (or dahl)",
        "Held-out RMSE of": "motor_force_n",
        "Before": "4.00",
        "After": "1.00",
        "Correct model": "0.500",
        "After / correct": "2.0",
        "Down by": "75 %",
        "Remains": "force over velocity (12 %)",
        "Base model": "friction: coulomb_n",
    }
    results["sets"][0]["campaigns"][0]["known"] = "the seal was changed"
    (row,) = overview(results)
    assert row[COLUMNS.index("Remains")].endswith("(12 %); known: the seal was changed")
    assert with_agreement(results)["sets"][0]["agreement"] == []


# --- the README -----------------------------------------------------------------------------


def test_the_readme_table_stands_between_its_markers(tmp_path: Path) -> None:
    results = canned(campaign("campaign.toml", diagnosis(effect("a|b"))))
    table = markdown_table(results)
    assert "a\\|b" in table and len(table.splitlines()) == 3
    path = tmp_path / "README.md"
    path.write_text(f"above\n{BEGIN}\nold\n{END}\nbelow\n")
    write_readme_table(path, table)
    assert path.read_text() == f"above\n{BEGIN}\n\n{table}\n\n{END}\nbelow\n"
    write_readme_table(path, "new")
    assert path.read_text() == f"above\n{BEGIN}\n\nnew\n\n{END}\nbelow\n"


@pytest.mark.parametrize("text", ["", BEGIN, f"{END}\n{BEGIN}", f"{BEGIN}{BEGIN}{END}"])
def test_a_readme_without_its_markers_stays(tmp_path: Path, text: str) -> None:
    path = tmp_path / "README.md"
    path.write_text(text)
    with pytest.raises(InputError, match="once each"):
        write_readme_table(path, "new")
    assert path.read_text() == text


def test_the_projects_readme_has_the_markers() -> None:
    text = (REPOSITORY / "README.md").read_text("utf-8")
    assert text.count(BEGIN) == 1 and text.count(END) == 1
    assert text.index(BEGIN) < text.index(END)


# --- the sets themselves --------------------------------------------------------------------

# Of a set's first campaign, what its channel's held-out RMSE has to come down to: a share of
# `before`, or as it is where `absolute`. The tank takes minutes: test_components_tank.py has it.
ASKED: dict[str, tuple[str, float, bool]] = {
    "emps": ("motor_force_n", 0.7, False),
    "cylinder": ("motor_force_n", 0.5, False),
    "valve_pwm": ("log_time_to_pressure", 0.5, True),
    "valve_surface": ("flow_a_kg_s", 0.5, False),
}


# Real recordings take a minute each: `make slow` has them all.
QUICK = "valve_surface"


@pytest.mark.parametrize(
    "name", [n if n == QUICK else pytest.param(n, marks=pytest.mark.slow) for n in ASKED]
)
def test_a_measured_set(name: str, shared_data: Path, tmp_path: Path) -> None:
    """The first campaign of a real set runs through, and reaches what is asked of it."""
    folder = tmp_path / "sets" / name
    shutil.copytree(SETS_FOLDER / name, folder)
    head, first, *_ = (folder / "set.toml").read_text().split("[[campaign]]")
    (folder / "set.toml").write_text(f"{head}[[campaign]]{first}")
    results = run_sets([folder], shared_data, tmp_path / "work")
    measured = results["sets"][0]
    assert measured["problem"] is None
    (found,) = measured["campaigns"]
    assert found["problem"] is None
    channel, limit, absolute = ASKED[name]
    error = found["diagnosis"]["residual"][channel]
    assert error["after"] <= (limit if absolute else limit * error["before"])
