"""`sysid control`: the run as a log of the plant, its page, users' controllers, refusals."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from golden_folder import golden_bundle

import sysid as si
from datasets.thesis.reference_rig import bundle_content, plant
from sysid.commands.app import main
from sysid.controllers.cases import ClosedLoopRun
from sysid.controllers.interface import Commands, Controller, Reference, StateEstimate
from sysid.controllers.modes import Mode
from sysid.controllers.sensing import SensorSuite
from sysid.controllers.task import HORIZON, Choice, prepared
from sysid.controllers.tuning import Tuning
from sysid.io.bundled import REFERENCE_BUNDLE, thesis_folder
from sysid.pipeline.control import ControlledRun

SHORT_S = 1.0
PROPORTIONAL = """\
from sysid.controllers.interface import Commands, Controller


class MyController(Controller):
    def commands(self, memory, estimate, reference):
        error = reference.position - estimate.position
        none = 0.0 * error
        return memory, Commands(motor=20.0 * error, valve_a=none, valve_b=none)
"""


@pytest.fixture(scope="module")
def bundle() -> si.Bundle:
    return si.read_bundle(thesis_folder() / REFERENCE_BUNDLE)


@pytest.fixture(scope="module")
def tracked(bundle: si.Bundle) -> ControlledRun:
    """Backstepping, hybrid, trajectory 3, its first second."""
    return si.control(bundle, "backstepping", trajectory=3, mode="hybrid", duration_s=SHORT_S)


@pytest.fixture(scope="module")
def folder(tracked: ControlledRun, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("run") / "new" / "folder"
    tracked.write(place)
    return place


def refused(words: str, capsys: pytest.CaptureFixture[str], status: int = 2) -> str:
    """The one line that a command ends with."""
    assert main(words.split()) == status
    lines = capsys.readouterr().err.strip().splitlines()
    assert lines[-1].startswith("sysid: error: ")
    return lines[-1]


# --- what is written -------------------------------------------------------------------------


def test_the_bundle_of_the_thesis_rig_is_its_model(bundle: si.Bundle) -> None:
    assert bundle.model() == plant()
    unstable = ("created", "sysid_version")
    made = {k: v for k, v in bundle_content().items() if k not in unstable}
    assert {k: v for k, v in bundle.to_json().items() if k not in unstable} == made


def test_the_run_is_a_log_that_the_plant_s_bundle_predicts(folder: Path, bundle: si.Bundle) -> None:
    """Open loop from the log's commands: the plant's own bundle is off by noise only."""
    campaign = si.read_campaign(folder / "campaign.toml")
    assert campaign.notices == () and campaign.rig.content == bundle.rig.content
    checked = si.validate(campaign, bundle)
    channels = checked.logs[0].channels
    # The start's pressures are known to the noise only, and a position integrates that.
    assert channels["theta_rad"].errors.rmse < 1e-3
    for name in ("pressure_a_pa", "pressure_b_pa"):
        assert channels[name].errors.rmse == pytest.approx(200.0, rel=0.2)


def test_the_log_is_what_a_rig_records(folder: Path, tracked: ControlledRun) -> None:
    log = si.read_log(folder / "run.csv")
    assert log.notices == ()
    step = 2.0 * np.pi / 80000.0
    counts = log.trials[0]["theta_rad"] / step
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    off = log.trials[0]["theta_rad"] - tracked.run.position
    assert 0.0 < np.max(np.abs(off)) < step
    reference = pd.read_csv(folder / "reference.csv", comment="#")
    error = reference["reference_rad"] - reference["true_theta_rad"]
    assert np.sqrt(np.mean(error**2)) == pytest.approx(tracked.metrics.rmse, rel=1e-9)


def test_the_page_holds_everything(folder: Path, tracked: ControlledRun) -> None:
    page = (folder / "page.html").read_text("utf-8")
    assert tracked.headline() in page
    ids = re.findall(r' id="([^"]+)"', page)
    assert len(ids) == len(set(ids))
    figures = ("fig-position", "fig-pressures", "fig-valves", "fig-close-up", "fig-motor")
    assert {f"{name}-title" for name in figures} <= set(ids)
    assert not re.search(r'(?:src|href)="(?!#|data:)', page) and "<script" not in page


def test_the_result_shows_itself(tracked: ControlledRun) -> None:
    assert "RMSE" in str(tracked) and "<table>" in tracked._repr_html_()
    frame = tracked.to_frame()
    assert len(frame) == 1000 and {"duty_a", "motor_torque_nm"} <= set(frame)
    axes = tracked.plot()
    assert [ax.get_ylabel() for ax in axes][1] == "Error (mrad)"
    # Trajectory 3 never rests: no steady state is judged.
    assert np.isnan(tracked.metrics.sse) and tracked.to_json()["sse_rad"] is None


# --- controllers of a user's own -------------------------------------------------------------


class Motor(Controller):
    def commands(
        self, memory: Any, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        error = reference.position - estimate.position
        return memory, Commands(motor=20.0 * error, valve_a=0.0 * error, valve_b=0.0 * error)


class Stateful(Motor):
    """Integrates in itself, which a compiled loop cannot see."""

    def __init__(self) -> None:
        self.total: Any = 0.0

    def commands(
        self, memory: Any, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        self.total = self.total + 1e-3 * (reference.position - estimate.position)
        given = super().commands(memory, estimate, reference)[1]
        return memory, given._replace(motor=given.motor + 5.0 * self.total)


class Branching(Motor):
    def commands(
        self, memory: Any, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        given = super().commands(memory, estimate, reference)[1]
        if estimate.position[0] > 10.0:
            given = given._replace(motor=0.0 * given.motor)
        return memory, given


def own_run(bundle: si.Bundle, controller: str | Controller | type[Controller]) -> ControlledRun:
    return si.control(bundle, controller, trajectory=1, mode="motor", duration_s=0.3)


@pytest.fixture(scope="module")
def plain(bundle: si.Bundle) -> ClosedLoopRun:
    return own_run(bundle, Motor).run


def test_a_controller_of_one_s_own_by_file(
    bundle: si.Bundle, plain: ClosedLoopRun, tmp_path: Path
) -> None:
    file = tmp_path / "my_controller.py"
    file.write_text(PROPORTIONAL)
    found = own_run(bundle, f"{file}:MyController")
    assert found.notices == (f"{file} is run: MyController is the user's own controller",)
    np.testing.assert_array_equal(found.run.position, plain.position)


def test_one_that_branches_is_called_from_python(bundle: si.Bundle, plain: ClosedLoopRun) -> None:
    found = own_run(bundle, Branching())
    assert "called from Python" in found.notices[0] and "branches" in found.notices[0]
    np.testing.assert_allclose(found.run.position, plain.position, atol=1e-9)


def test_one_that_keeps_its_state_in_itself_is_not_compiled(bundle: si.Bundle) -> None:
    """Compiled, its integral would silently be the last error only."""
    found = own_run(bundle, Stateful)
    assert "keeps its state in itself" in found.notices[0]
    error = found.run.reference[:, 0] - found.run.measured
    np.testing.assert_allclose(
        found.run.motor, 20.0 * error + 5.0 * np.cumsum(1e-3 * error), atol=1e-9
    )


BROKEN = {
    "no_such.py:MyController": "no such file; name a Python file that defines a controller",
    "empty.py:MyController": "empty.py: defines no MyController; derive it",
    "other.py:MyControler": "other.py: defines no MyControler; it defines MyController",
    "text.py:MyController": "text.py, MyController: is not a controller",
    "abstract.py:MyController": "abstract.py, MyController: has no method commands",
    "syntax.py:MyController": "syntax.py, line 2: does not run: SyntaxError",
    "raises.py:MyController": "raises.py, line 6: does not run: ZeroDivisionError",
    "short.py:MyController": "short.py: does not run",
    "pid": "controller 'pid': is unknown; give pva, backstepping, dvmpc, force or FILE.py:CLASS",
}
FILES = {
    "empty.py": "",
    "other.py": PROPORTIONAL,
    "text.py": "MyController = 'text'\n",
    "abstract.py": PROPORTIONAL.replace("def commands", "def others"),
    "syntax.py": "\nclass MyController(:\n",
    "raises.py": PROPORTIONAL.replace("reference.position -", "1 / 0 +"),
    "short.py": PROPORTIONAL.replace("return memory,", "return"),
}


@pytest.mark.parametrize("controller", BROKEN)
def test_a_broken_one_is_the_file_s_error(
    controller: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        Path(name).write_text(text)
    reference = thesis_folder() / REFERENCE_BUNDLE
    words = f"control {reference} --controller {controller} --trajectory 1 --mode motor"
    assert BROKEN[controller] in refused(words, capsys)


# --- rigs and bundles ------------------------------------------------------------------------

Change = Callable[[dict[str, Any]], object]


def changed(tmp_path: Path, change: Change) -> Path:
    content = bundle_content()
    change(content)
    path = tmp_path / "changed.json"
    path.write_text(json.dumps(content))
    return path


def _upright(content: dict[str, Any]) -> None:
    content["rig"]["rig"]["orientation"] = "vertical"
    content["rig"]["inertia"] |= {"arm_mass_kg": 0.30, "arm_length_m": 0.46}


def _motor_alone(content: dict[str, Any]) -> None:
    content.pop("valves")
    for section in ("air", "cylinder", "valves"):
        content["rig"].pop(section, None)


REFUSED: dict[str, tuple[Change, str, int, str]] = {
    "no friction": (lambda b: b.pop("friction"), "", 3, "holds no friction"),
    "no valve law": (
        lambda b: b["valves"].pop("b"), "", 3, "valves.b.discrete is missing, which a controller"
    ),
    "a motor alone": (
        _motor_alone, "", 3, "the rig is a motor alone, and a closed loop needs a cylinder"
    ),
    "no surfaces": (lambda b: None, "--inverse ann", 3, "holds no ann surfaces"),
    "no motor": (lambda b: b["rig"].pop("motor"), "", 2, "[motor] is missing, which mode hybrid"),
    "no pwm": (lambda b: b["rig"].pop("pwm"), "", 2, "section [pwm] is missing"),
    "a short stroke": (
        lambda b: b["rig"]["cylinder"].update(stroke_m=0.03), "", 2, "the end stops are at 0.4"
    ),
    "a payload without a lever": (
        lambda b: b["rig"]["inertia"].pop("payload_length_m"), "--payload 1", 2,
        "payload_length_m is missing, and --payload needs it",
    ),
    "no number": (lambda b: None, "--payload -1", 2, "--payload"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_a_bundle_that_cannot_do_it_is_refused(
    case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change, words, status, said = REFUSED[case]
    path = changed(tmp_path, change)
    run = f"control {path} --controller backstepping --trajectory 3 --mode hybrid {words}"
    assert said in refused(run, capsys, status)


def test_linear_rigs_and_pva_s_motor_are_refused(
    capsys: pytest.CaptureFixture[str], bundle: si.Bundle
) -> None:
    linear = golden_bundle("made_linear")
    run = f"control {linear} --controller dvmpc --trajectory 1 --mode hybrid"
    assert "the rig is linear, and trajectories 1 to 4 are angles" in refused(run, capsys)
    with pytest.raises(si.InputError, match="pva drives no motor; use mode pneumatic"):
        si.control(bundle, "pva", mode="hybrid")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("", "Missing argument 'BUNDLE'"),
        ("x.json --trajectory 1 --mode motor", "Missing option '--controller'"),
        ("--table 4.5.3 --mode motor", "--mode does not go with --table"),
        ("--table 5.4.13", "'5.4.13' is not one of"),
        ("--table 4.5.3 --varying-input", "--varying-input does not go with --table"),
        ("--table 4.5.3 --type 2", "--type does not go with --table"),
    ],
)
def test_options_that_do_not_fit(words: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert said in refused(f"control {words}", capsys)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("pva --horizon 20", "option horizon: does not go with pva; use it with dvmpc"),
        ("backstepping --varying-input", "option varying_input: does not go with backstepping"),
        ("dvmpc --type 2", "option type: does not go with dvmpc; use it with backstepping"),
        ("pva --no-estimate-payload", "does not go with pva; use it with dvmpc or backstepping"),
        ("dvmpc --horizon 0", "horizon 0: is out of range; give 1 to 200 ticks"),
        ("dvmpc --varying-input --horizon 9", "with a varying input; give 11 to 200 ticks"),
        ("dvmpc --estimate-payload", "the rig is horizontal, and a payload is estimated from"),
    ],
)
def test_options_of_another_controller_are_refused(
    words: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    path = thesis_folder() / REFERENCE_BUNDLE
    run = f"control {path} --trajectory 1 --mode pneumatic --controller {words}"
    assert said in refused(run, capsys)


def made(bundle: si.Bundle, controller: str, **options: Any) -> Any:
    """The controller that the options make, without a run."""
    options = {"perfect_sensors": False} | options
    perfect = options.pop("perfect_sensors")
    choice = Choice(controller, 1, Mode.HYBRID, tuning=Tuning(**options), perfect_sensors=perfect)
    return prepared(choice, bundle)


def test_options_reach_the_controller(bundle: si.Bundle, tmp_path: Path) -> None:
    plain = made(bundle, "dvmpc").make()
    assert (plain.horizon, plain.varying, plain.predicts_delays) == (HORIZON, False, False)
    assert made(bundle, "dvmpc", horizon=20).make().horizon == 20
    varying = made(bundle, "dvmpc", varying_input=True).make()
    assert varying.varying and varying.predicts_delays and varying.predicted_steps < 160
    for number, wanted in enumerate([(False, False), (False, True), (True, False), (True, True)]):
        found = made(bundle, "backstepping", type=number + 1).make()
        assert (found.feedforward, found.compensation) == wanted and found.portion > 0.0
    task = made(bundle, "dvmpc", perfect_sensors=True, horizon=3)
    assert task.case(task.make()).sensors == SensorSuite.perfect()
    assert task.choice.words == ("horizon 3", "perfect sensors")
    upright = si.read_bundle(changed(tmp_path, _upright))
    for wanted in (True, False):
        found = made(upright, "dvmpc", estimate_payload=wanted).make()
        assert (found.estimator is not None) == wanted
    with pytest.raises(si.InputError, match="does not go with a controller of your own"):
        si.control(bundle, Motor, mode="motor", horizon=10)


def test_in_the_vertical_a_payload_is_carried_and_estimated(tmp_path: Path) -> None:
    """0.5 kg that the controller is not told of: on the plant, in rig.toml, and found."""
    upright = si.read_bundle(changed(tmp_path, _upright))
    found = si.control(
        upright, "dvmpc", trajectory=3, mode="hybrid", payload_kg=0.5, duration_s=5.0
    )
    p, carrying = upright.model().parameters, found.task.plant.parameters
    assert carrying.inertia - p.inertia == pytest.approx(0.5 * 0.37**2)
    assert carrying.gravity_moment - p.gravity_moment == pytest.approx(0.5 * 9.81 * 0.37)
    found.write(tmp_path / "run")
    rig = si.read_rig(tmp_path / "run" / "rig.toml")
    assert rig.inertia is not None and rig.inertia.payload_mass_kg == 0.5
    assert found.run.payload_kg[0] == 0.0 and 0.3 < found.run.payload_kg[-1] < 0.6


def test_a_payload_beyond_the_limit_is_said_everywhere(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """4 kg, more than the actuators hold: in the terminal, in JSON and on the page."""
    path = changed(tmp_path, _upright)
    upright = si.read_bundle(path)
    found = si.control(
        upright, "dvmpc", trajectory=3, mode="hybrid", payload_kg=4.0, duration_s=3.0
    )
    assert np.isfinite(found.run.position).all() and np.isfinite(found.run.motor).all()
    for word in ("motor: at its limit", "tracking: more than 0.2 off"):
        assert any(line.startswith(word) for line in found.faults), word
    monkeypatch.setattr("sysid.commands.control.control_bundle", lambda *a, **k: found)
    words = f"control {path} --controller dvmpc --trajectory 3 --mode hybrid".split()
    assert main([*words, "-o", str(tmp_path / "run")]) == 0
    shown = capsys.readouterr().out
    page = (tmp_path / "run" / "page.html").read_text("utf-8")
    assert main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["faults"] == list(found.faults)
    for line in found.faults:
        assert f"fault: {line}" in shown and f"Fault: {line}." in page


def test_the_plant_is_the_other_bundle_s(tmp_path: Path, bundle: si.Bundle) -> None:
    def heavier(content: dict[str, Any]) -> None:
        content["rig"]["inertia"]["equivalent_kg_m2"] *= 1.5

    other = si.read_bundle(changed(tmp_path, heavier))
    found = si.control(bundle, Motor, mode="motor", plant=other, duration_s=0.05)
    assert found.task.plant == other.model()
