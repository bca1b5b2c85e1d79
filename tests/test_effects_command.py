"""`sysid effects`: the list, one entry, its picture, and a user's own effects."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sysid.blocks.text_plot import text_plot
from sysid.commands.app import main
from sysid.plant.effects import catalogue, friction, load_user_effects, motor
from sysid.plant.effects.demonstration import demonstrate, reference_parameters
from sysid.plant.effects.linear import linear_form

PAGE = Path(__file__).resolve().parent.parent / "docs" / "how-to" / "own-effect.md"


@pytest.fixture
def example(tmp_path: Path) -> Path:
    """The effect that the documentation shows, as a file."""
    code = re.search(r"```\{file\} my_effects.py\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    assert code is not None
    path = tmp_path / "my_effects.py"
    path.write_text(code[1])
    return path


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The one line of a command that cannot be done."""
    assert main(["effects", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    line = captured.err.splitlines()[-1]
    assert line.startswith("sysid: error: ") and "Traceback" not in captured.err
    return line


# --- the catalogue ---------------------------------------------------------------------


def test_the_list_names_every_effect_and_parameter(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects"]) == 0
    shown = capsys.readouterr().out
    lines = shown.splitlines()
    for effect in catalogue().values():
        assert any(line.startswith(f"{effect.id} ") for line in lines)
    assert re.search(r"stribeck_torque_nm +0\.12 Nm", shown)


def test_the_list_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", "--json"]) == 0
    entries = json.loads(capsys.readouterr().out)["effects"]
    assert [e["id"] for e in entries] == list(catalogue())
    for entry in entries:
        assert entry["signature"] and entry["source"] and entry["law"]
        for parameter in entry["parameters"]:
            low, high = parameter["bounds"]
            assert (
                low <= parameter["typical"] <= high and parameter["unit"] and parameter["meaning"]
            )
    offset = next(e for e in entries if e["id"] == "torque-offset")
    assert (
        "mounting-tilt" in offset["ambiguous_with"]
        and "torque-offset" not in (offset["ambiguous_with"])
    )


def test_one_entry_with_its_plot(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", "torque-offset"]) == 0
    captured = capsys.readouterr()
    for part in ("Torque offset", "breakaway in both directions", "offset_nm", "area-error"):
        assert part in captured.out
    assert len(re.findall(r"[\u2801-\u28ff]", captured.out)) > 50
    assert captured.err == "sysid: simulating torque-offset\n"


@pytest.mark.parametrize(("name", "start"), [("d.svg", b"<?xml"), ("d.PNG", b"\x89PNG")])
def test_the_picture(
    name: str, start: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / name
    assert main(["effects", "torque-offset", "-o", str(output), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["written"] == str(output)
    assert output.read_bytes().startswith(start)
    assert list(tmp_path.iterdir()) == [output]
    shown = demonstrate(motor.TorqueOffset)
    for channel, unit in shown.channels:
        change = printed["changes"][channel]
        assert change["unit"] == unit
        assert change["largest"] == np.abs(shown.difference(channel)).max()
        assert 0.0 < change["rms"] < change["largest"]


def test_a_positive_offset_moves_the_arm_further() -> None:
    shown = demonstrate(motor.TorqueOffset)
    difference = shown.difference("theta_rad")
    assert difference.mean() > 0.01
    assert abs(shown.base["theta_rad"]).max() < 1.55  # off the end stops


@pytest.mark.parametrize("effect", [motor.TorqueOffset, friction.SealFriction])
def test_a_linear_axis_moves_as_the_rack_of_the_same_rig(effect: Any) -> None:
    """A position is the angle times the pinion's radius."""
    arm, rack = demonstrate(effect), demonstrate(linear_form(effect), linear=True)
    assert [unit for _, unit in rack.channels] == ["m", "Pa", "Pa"]
    radius = float(reference_parameters().pitch_radius)
    for one, other, off in ((arm.base, rack.base, 1e-6), (arm.changed, rack.changed, 0.01)):
        moved = radius * one["theta_rad"]  # usual sizes are rounded, for another radius
        assert np.abs(other["position_m"] - moved).max() < off * np.abs(moved).max()
    assert np.abs(rack.difference("position_m")).max() > 0.015 * np.abs(moved).max()


def test_effects_of_a_linear_axis(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", "torque-offset", "--linear", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["parameters"][0]["unit"] == "N"
    assert printed["changes"]["position_m"]["unit"] == "m"


def test_the_text_plot_draws_the_curve_and_its_zero_line() -> None:
    rising = text_plot(np.linspace(0.0, 1.0, 500), width=20, rows=3)
    assert [len(line) for line in rising] == [20, 20, 20]
    filled = [[cell != "\u2800" for cell in line] for line in rising]
    assert filled[0][-1] and not filled[0][0]  # high at the end only
    assert filled[2][0] and filled[2][-2]  # the zero line at the bottom
    assert text_plot(np.zeros(8), width=20, rows=1)[0].strip("\u2800")


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["stribek-friction"], "did you mean stribeck-friction?"),
        (["zzz"], "`sysid effects` lists them"),
        (["-o", "all.svg"], "give its id"),
        (["torque-offset", "-o", "offset.pdf"], "end it in .png or .svg"),
        (["torque-offset", "-o", "nowhere/offset.svg"], "does not exist"),
        (["--effects", "absent.py"], "no such file"),
        (["--effects", "."], "no such file"),
    ],
)
def test_what_cannot_be_shown(
    arguments: list[str],
    part: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert part in refused(arguments, capsys)
    assert not list(tmp_path.iterdir())


# --- a user's own ----------------------------------------------------------------------


def test_the_example_of_the_readme_runs(example: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["effects", "hose-drag", "--effects", str(example), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["id"] == "hose-drag" and printed["law"].endswith("+ d |theta| sign w.")
    assert printed["changes"]["theta_rad"]["largest"] > 1e-3
    assert main(["effects", "--effects", str(example), "--json"]) == 0
    entries = json.loads(capsys.readouterr().out)["effects"]
    assert len(entries) == len(catalogue()) + 1 and entries[-1]["id"] == "hose-drag"


def test_annotations_as_text_and_helpers_are_no_obstacle(example: Path) -> None:
    text = "from __future__ import annotations\nfrom typing import ClassVar\n"
    text += example.read_text().replace(
        "drag_nm_per_rad: float", "n: ClassVar[int] = 1\n    \\g", 1
    )
    text = text.replace("\\g", "drag_nm_per_rad: float")
    example.write_text(text)
    (effect,) = load_user_effects(example).values()
    assert effect.typical().drag_nm_per_rad == 0.05  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("class HoseDrag(CatalogueEffect):", "class HoseDrag(CatalogueEffect)", "line 6: does not"),
        ("from dataclasses", "from no_such_module", "line 1: does not run: ModuleNotFoundError"),
        ("@dataclass(frozen=True)\n", "", "is not a frozen dataclass"),
        ("@dataclass(frozen=True)\n", "@dataclass\n", "is not a frozen dataclass"),
        ("signature, source", "signature, sauce", "has no source"),
        ('"hose-drag"', '"backlash"', "takes the id backlash of the catalogue"),
        ("float = 0.0 ", "float = 0.1 ", "drag_nm_per_rad is 0.1 by default"),
        ("float = 0.0 ", "float ", "drag_nm_per_rad has no default"),
        ('Quantity("drag_nm_per_rad"', 'Quantity("drag"', "has no field drag"),
        ("float = 0.0 ", "float = 0.0; more: float = 1.0 ", "no quantity names more"),
        ('"per angle"),)', '"per angle"))', "quantities is not a tuple of Quantity"),
        ('"per angle")', '"per angle", is_strength=False)', "has no strength"),
        ('"per angle")', '"per angle", is_choice=True)', "drag_nm_per_rad is a choice without"),
        ("(CatalogueEffect):", ":", "defines no effect"),
        ("def friction_effort", "def friction_efort", "did you mean friction_effort?"),
        ("def friction_effort", "def own_law", "acts through no port"),
        ("from dataclasses", "raise SystemExit(3)\nfrom dataclasses", "line 1: does not run"),
    ],
)
def test_a_faulty_file_is_refused_in_one_line(
    old: str, new: str, part: str, example: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = example.read_text()
    assert old in text
    example.write_text(text.replace(old, new))
    line = refused(["--effects", str(example)], capsys)
    assert part in line and str(example) in line


def test_two_classes_of_one_id_are_refused(
    example: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = example.read_text()
    example.write_text(text + text.partition("\n\n")[2].replace("HoseDrag", "Other"))
    line = refused(["--effects", str(example)], capsys)
    assert "class Other: takes the id hose-drag of another class" in line


@pytest.mark.parametrize(
    ("law", "part"),
    [
        ("effort + (1 if point.velocity > 0 else -1) * self.drag_nm_per_rad", "does not simulate"),
        ("effort + 0.1 * point.direction", "at neutral strength it changes theta_rad"),
        ("effort + self.drag_nm_per_rad / self.drag_nm_per_rad", "at neutral strength"),
        ("effort - 1e300 * self.drag_nm_per_rad * point.velocity", "does not stay finite"),
    ],
)
def test_a_faulty_port_is_refused_in_one_line(
    law: str, part: str, example: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = example.read_text()
    example.write_text(re.sub(r"return .*", f"return {law}", text))
    line = refused(["hose-drag", "--effects", str(example)], capsys)
    assert part in line and str(example) in line
