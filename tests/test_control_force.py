"""Force control: the effort is the wanted one, free and in contact."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

import sysid as si
from datasets.thesis.reference_rig import design, plant
from datasets.thesis.reference_rig import rig as thesis_rig
from sysid.commands.app import main
from sysid.controllers.backstepping import BacksteppingController
from sysid.controllers.cases import Case, ClosedLoopRun
from sysid.controllers.error_budget import stability_of
from sysid.controllers.force import effort_errors, force_controller
from sysid.controllers.loop import closed_loop
from sysid.controllers.modes import Mode
from sysid.controllers.trajectories import Cycloidal, Sine
from sysid.errors import InputError
from sysid.io.bundled import REFERENCE_BUNDLE, thesis_folder
from sysid.plant.effects.linkage import CableSpring
from sysid.plant.ports import Model

SHORT_S = 1.5
WALL = 8.0
"""Stiffness of what the arm presses against, Nm/rad."""
WAY = Cycloidal(travel=0.25, lasts=0.5, starts=(0.1, 5.0))


@pytest.fixture(scope="module")
def runs() -> dict[str, tuple[Case, ClosedLoopRun]]:
    """Free motion and contact: all plants have the spring, which is none where it is free."""
    own, soft, stiff = (force_controller(design(), thesis_rig(), s) for s in (None, 4.0, 16.0))

    def held(stiffness: float) -> Model:
        return Model(plant().parameters, (CableSpring(stiffness),))

    made = {
        "free": Case(own, held(0.0), Sine(0.2, 1.0), Mode.HYBRID),
        "free, valves alone": Case(own, held(0.0), Sine(0.2, 1.0), Mode.PNEUMATIC),
        "soft": Case(soft, held(WALL), WAY, Mode.HYBRID),
        "stiff": Case(stiff, held(WALL), WAY, Mode.HYBRID),
    }
    found = closed_loop(list(made.values()), SHORT_S)
    return dict(zip(made, zip(made.values(), found, strict=True), strict=True))


def test_the_effort_follows_the_wanted_one(runs: dict[str, tuple[Case, ClosedLoopRun]]) -> None:
    """Within a tenth of what the cylinder can give; the motor makes it better."""
    rms = {
        name: float(np.sqrt(np.mean(effort_errors(case, run)[200:] ** 2)))
        for name, (case, run) in runs.items()
    }
    whole = 1e5 * (4.524e-4 + 4.207e-4) * 0.0375
    assert max(rms.values()) < 0.1 * whole
    assert rms["free"] < 0.5 * rms["free, valves alone"]


@pytest.mark.parametrize(("name", "stiffness"), [("soft", 4.0), ("stiff", 16.0)])
def test_in_contact_it_presses_with_its_stiffness(
    runs: dict[str, tuple[Case, ClosedLoopRun]], name: str, stiffness: float
) -> None:
    """At rest the spring's effort is the stiffness times the missing way, but for friction."""
    run = runs[name][1]
    position = float(np.mean(run.position[-200:]))
    given = WALL * position
    wanted = stiffness * (0.25 - position)
    assert given == pytest.approx(wanted, abs=0.333 + 0.05)
    assert given > 0.3


def test_the_default_stiffness_follows_from_the_rig() -> None:
    """The cylinder's whole effort, 3.27 Nm, at a tenth of the travel of 3.39 rad."""
    made = force_controller(design(), thesis_rig())
    assert made.stiffness == pytest.approx(1e5 * 8.731e-4 * 0.0375 / (0.1 * 0.127 / 0.0375))
    assert made.damping == pytest.approx(2.0 * np.sqrt(made.stiffness * 0.02368))


def test_force_control_from_the_command_line(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    runs: dict[str, tuple[Case, ClosedLoopRun]],
) -> None:
    case, run = runs["free"]
    with pytest.raises(InputError, match="stability"):
        stability_of(case, run)
    seen: list[Any] = []

    def stand(task: Any, *_: Any) -> tuple[ClosedLoopRun, tuple[str, ...]]:
        seen.append(task.make())
        return run, ()

    monkeypatch.setattr("sysid.pipeline.control.run_task", stand)
    bundle = str(thesis_folder() / REFERENCE_BUNDLE)
    words = ["control", bundle, "--trajectory", "3", "--mode", "hybrid"]
    assert main([*words, "--controller", "force", "--stiffness", "12", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert seen[0].stiffness == 12.0 and content["options"] == ["stiffness 12.0"]
    assert 0.0 < content["effort_rmse_nm"] < 1.0
    assert main([*words, "--controller", "force"]) == 0
    assert "effort, wanted" in capsys.readouterr().out
    assert main([*words, "--controller", "backstepping", "--stiffness", "12"]) == 2
    assert "stiffness" in capsys.readouterr().err
    tracked = si.control(si.read_bundle(bundle), "backstepping", trajectory=3, mode="hybrid")
    assert isinstance(seen[-1], BacksteppingController) and np.isnan(tracked.effort_rmse_nm)
