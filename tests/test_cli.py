"""The command line as a user meets it: `fit friction`, bundles, campaigns, convert, JSON."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

import click
import pytest
from friction_trials import UNWRITTEN
from shared_results import bundled_fit

from datasets.generator.campaign import GeneratedTests, make_friction_tests
from datasets.generator.files import write_log
from datasets.generator.rigs import rig_toml
from sysid.commands.app import COMMANDS, app, main
from sysid.parameters import read_bundle

BUNDLED = Path(__file__).resolve().parent.parent / "datasets" / "bundled"
SEED = 7


@pytest.fixture(scope="module")
def generated() -> GeneratedTests:
    return make_friction_tests(SEED)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, generated: GeneratedTests) -> Path:
    """One rig's friction tests, a file a kind, and a campaign that holds the motion out."""
    path = tmp_path_factory.mktemp("rig")
    (path / "rig.toml").write_text(rig_toml(generated.rig))
    lines = ['rig = "rig.toml"']
    for kind, tests in generated.kinds.items():
        write_log(path / f"{kind}.csv", tests, generated.generated_rig)
        use = "holdout" if kind == "friction-motion" else "fit"
        lines += ["[[log]]", f'kind = "{kind}"', f'file = "{kind}.csv"', f'use = "{use}"']
    (path / "campaign.toml").write_text("\n".join(lines))
    return path


def test_friction_from_the_command_line(
    folder: Path, generated: GeneratedTests, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs = [str(folder / "friction-static.csv"), str(folder / "friction-sliding.csv")]
    bundle_path = tmp_path / "bundle.json"
    assert main(["fit", "friction", *logs, "-o", str(bundle_path), "--no-report", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    bundle = read_bundle(bundle_path)
    assert bundle.friction is not None
    assert printed["friction"] == bundle.friction.to_json()
    friction = bundle.friction.estimates()
    truth = generated.truth["friction"]
    for name, share in (("static_nm", 0.05), ("coulomb_nm", 0.05), ("viscous_nm_s_per_rad", 0.2)):
        assert friction[name].value == pytest.approx(truth[name], rel=share)
        assert friction[name].unit
        low, high = friction[name].interval
        assert low < friction[name].value < high
    files = {e.file for e in bundle.provenance.logs}
    assert files == {"friction-static.csv", "friction-sliding.csv"}


def test_a_fit_has_a_page_of_its_own(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, logs = tmp_path / "fit.html", ["friction-static.csv", "friction-sliding.csv"]
    words = ["fit", "friction", "-o", "none", *(str(folder / log) for log in logs)]
    words += ["--report", str(page)]
    assert main(words) == 0
    assert f"written: {page}" in capsys.readouterr().out
    text = page.read_text()
    assert all(log in text for log in logs) and "Friction over speed" in text
    assert "2 logs; none is held out" in text and "sysid advise" not in text
    assert main(["fit", str(folder / "campaign.toml"), "--report", str(page), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["report"] == str(page)
    assert "1 of them held out" in page.read_text()
    assert (
        main(
            ["fit", "friction", str(folder / logs[1]), *words[6:], "-o", "none", "--kind", "motion"]
        )
        == 0
    )
    assert "friction-motion" in page.read_text()
    assert main([*words[:-1], str(tmp_path / "none" / "fit.html")]) == 2
    assert "none" in capsys.readouterr().err


def test_summary_and_notices_go_to_their_streams(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fit", "friction", str(folder / "friction-sliding.csv"), *UNWRITTEN]) == 0
    captured = capsys.readouterr()
    assert "coulomb_nm" in captured.out
    assert "not identified" in captured.out
    assert all(line.startswith("sysid: ") for line in captured.err.splitlines())


def test_a_campaign_leaves_held_out_logs_alone(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "bundle.json"
    assert main(["fit", str(folder / "campaign.toml"), "-o", str(path)]) == 0
    used = {(e.file, e.use) for e in read_bundle(path).provenance.logs}
    fitted = {("friction-static.csv", "fit"), ("friction-sliding.csv", "fit")}
    assert used == fitted | {("friction-motion.csv", "holdout")}


def test_the_list_of_commands_says_what_each_says_of_itself() -> None:
    """`sysid --help` lists them from a table: it imports no command."""
    context = click.Context(app)
    assert {name: _first_line(app.get_command(context, name)) for name in COMMANDS} == COMMANDS
    code = "import sys; from sysid.commands.app import main; main(['--help']); "
    code += "print([m for m in sys.modules if m.split('.')[0] in ('numpy', 'rich', 'scipy')])"
    command = [sys.executable, "-c", code]
    listed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert listed.splitlines()[-1] == "[]"
    assert all(f"\n  {name} " in listed for name in COMMANDS)


def _first_line(command: click.Command | None) -> str:
    assert command is not None and command.help is not None
    return command.help.partition("\n")[0]


def test_options_may_stand_before_the_campaign(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "bundle.json"
    assert main(["fit", "-o", str(path), str(folder / "campaign.toml")]) == 0
    assert read_bundle(path).friction is not None


def test_a_reader_that_goes_away_is_no_fault(folder: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "sysid",
        "check",
        str(folder / "friction-static.csv"),
        "--json",
    ]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.close()
        said = process.stderr.read()
    assert (process.returncode, said) == (0, b"")


def test_into_replaces_one_part_only(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "bundle.json"
    first, second = str(folder / "friction-sliding.csv"), str(folder / "friction-static.csv")
    assert main(["fit", "friction", first, "-o", str(path), "--no-report"]) == 0
    before = read_bundle(path).friction
    assert main(["fit", "friction", first, second, "--into", str(path), "--no-report"]) == 0
    after = read_bundle(path).friction
    assert before is not None and before.static_nm is not None
    assert before.static_nm.to_json()["value"] is None
    assert after is not None and after.static_nm is not None
    assert after.static_nm.to_json()["value"] is not None


def test_kind_overrules_the_content(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ramps = str(folder / "friction-static.csv")
    assert main(["fit", "friction", ramps, "--kind", "static", "--json", *UNWRITTEN]) == 0
    assert json.loads(capsys.readouterr().out)["friction"]["static_nm"]["value"] > 0
    code = main(["fit", "friction", ramps, "--kind", "sliding", *UNWRITTEN])
    assert code == 3
    assert "friction-sliding" in capsys.readouterr().err


def test_logs_of_two_rigs_are_not_fitted_together(
    folder: Path, tmp_path: Path, rig_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "rig.toml").write_text(rig_text)
    (tmp_path / "run.csv").write_bytes((folder / "friction-static.csv").read_bytes())
    code = main(
        [
            "fit",
            "friction",
            str(tmp_path / "run.csv"),
            str(folder / "friction-sliding.csv"),
            *UNWRITTEN,
        ]
    )
    assert code == 2
    assert "--rig" in capsys.readouterr().err


def test_one_level_gives_the_sum_and_the_test_that_would_separate_it(
    generated: GeneratedTests, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trials = generated.kinds["friction-sliding"]
    level = max(abs(t.columns["motor_torque_nm"][-1]) for t in trials)
    same = [t for t in trials if math.isclose(abs(t.columns["motor_torque_nm"][-1]), level)]
    assert 1 < len(same) < len(trials)
    (tmp_path / "rig.toml").write_text(rig_toml(generated.rig))
    write_log(tmp_path / "run.csv", same, generated.generated_rig)
    assert main(["fit", "friction", str(tmp_path / "run.csv"), "--json", *UNWRITTEN]) == 0
    said = capsys.readouterr()
    friction = json.loads(said.out)["friction"]
    assert friction["viscous_nm_s_per_rad"]["value"] is None
    together = {"coulomb_nm", "viscous_nm_s_per_rad"}
    assert all(c["value"] is not None for c in friction["combinations"])
    assert any(together <= set(c["of"]) for c in friction["combinations"])
    assert "a second level" in said.err


def test_the_bundled_campaign_fits(tmp_path_factory: pytest.TempPathFactory) -> None:
    fitted = bundled_fit(tmp_path_factory)
    assert fitted.code == 0
    friction = json.loads(fitted.output)["friction"]
    assert friction["static_nm"]["value"] > friction["coulomb_nm"]["value"] > 0


def test_measured_axis_from_mat_to_parameters(
    shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Janot, Gautier, Brunot 2019: the published parameters of the EMPS axis."""
    log = tmp_path / "emps.csv"
    maps = ["time_s=t", "position_m=qm:m", "motor_force_n=vir:35.15 N"]
    source = str(shared_data / "emps" / "DATA_EMPS.mat")
    arguments = [part for entry in maps for part in ("--map", entry)]
    assert main(["convert", source, "-o", str(log), *arguments]) == 0
    (tmp_path / "rig.toml").write_text(
        '[rig]\nname = "EMPS"\nmotion = "linear"\norientation = "horizontal"\n'
    )
    capsys.readouterr()
    assert main(["fit", "friction", str(log), "--inertia", "--json", *UNWRITTEN]) == 0
    friction = json.loads(capsys.readouterr().out)["friction"]
    for name, published, share in (
        ("mass_kg", 95.1, 0.01),
        ("viscous_n_s_per_m", 203.5, 0.02),
        ("coulomb_n", 20.4, 0.03),
        ("offset_n", -3.2, 0.05),
    ):
        assert friction[name]["value"] == pytest.approx(published, rel=share), name
        low, high = friction[name]["interval"]
        assert low <= published <= high, name
