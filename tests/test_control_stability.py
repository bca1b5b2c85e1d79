"""The thesis' stability conditions, and what a run's errors allow, against loops and a solver."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.signal import impulse

from datasets.thesis.reference_rig import design, plant
from sysid.commands.app import main
from sysid.controllers.backstepping import backstepping_type
from sysid.controllers.cases import Case, ClosedLoopRun
from sysid.controllers.dvmpc import DvmpcController
from sysid.controllers.error_budget import Stability, stability_of
from sysid.controllers.loop import closed_loop
from sysid.controllers.modes import Mode
from sysid.controllers.pva import PvaController
from sysid.controllers.sensing import SensorSuite
from sysid.controllers.stability import largest_response
from sysid.controllers.trajectories import Cycloidal, Ramp, Sine
from sysid.errors import InputError
from sysid.io.bundled import REFERENCE_BUNDLE, thesis_folder

SHORT_S = 1.0
OWN = design()
SINE = Sine(0.2, 1.0)


def cases() -> dict[str, Case]:
    """Loops whose plants differ from what their controllers take them for."""
    heavy = plant(inertia=0.03, coulomb_effort=0.26, viscous=0.06)
    four = backstepping_type(4, OWN, portion=0.1)
    weak = dataclasses.replace(four, motor_p=20.0, motor_d=0.8)
    alone = dataclasses.replace(four, portion=0.0)
    rise = Cycloidal(starts=(0.1, 6.0), lasts=0.8)
    dvmpc = DvmpcController(OWN, horizon=40, natural_frequency=25.0, damping=0.4)
    return {
        "hybrid": Case(four, heavy, SINE, Mode.HYBRID),
        "weak motor": Case(weak, heavy, SINE, Mode.HYBRID),
        "pneumatic": Case(alone, heavy, rise, Mode.PNEUMATIC),
        "ideal": Case(weak, plant(), SINE, Mode.HYBRID, SensorSuite.perfect()),
        "corner": Case(four, plant(), Ramp(starts=(0.2, 5.0), origin=-0.5), Mode.HYBRID),
        "inverse dynamics": Case(dvmpc, heavy, SINE, Mode.HYBRID),
        "lively": Case(dataclasses.replace(dvmpc, damping=0.1), heavy, SINE, Mode.HYBRID),
    }


@pytest.fixture(scope="module")
def runs() -> dict[str, tuple[Case, ClosedLoopRun]]:
    made = cases()
    found = closed_loop(list(made.values()), SHORT_S)
    return dict(zip(made, zip(made.values(), found, strict=True), strict=True))


@pytest.fixture(scope="module")
def found(runs: dict[str, tuple[Case, ClosedLoopRun]]) -> dict[str, Stability]:
    return {name: stability_of(*pair) for name, pair in runs.items()}


def test_the_errors_are_what_drives_the_motion(
    runs: dict[str, tuple[Case, ClosedLoopRun]], found: dict[str, Stability]
) -> None:
    """No error exceeds what the sum of the sources allows, and not by being far too large."""
    for name, (_, run) in runs.items():
        budget = found[name].budget
        error = np.max(np.abs(run.reference[:, 0] - run.position))
        assert budget.largest == pytest.approx(error)
        if not budget.corners:
            assert error < budget.bound < 50.0 * error, name


@pytest.mark.parametrize("ratio", [0.05, 0.4, 2.5])
def test_the_largest_response_is_the_integral_of_the_impulse_response(ratio: float) -> None:
    inertia, stiffness = 0.03, 20.0
    damping = 2.0 * ratio * np.sqrt(inertia * stiffness)
    time = np.linspace(0.0, 8.0, 20_001)
    response = impulse(([1.0], [inertia, damping, stiffness]), T=time)[1]
    whole = np.trapezoid(np.abs(response), time)
    assert largest_response(inertia, damping, stiffness) == pytest.approx(whole, rel=2e-3)
    assert largest_response(inertia, 0.0, stiffness) == np.inf


def test_known_sources_have_their_sizes(found: dict[str, Stability]) -> None:
    """Coulomb friction 0.052 Nm off and inertia 0.0063 kg m2, along a 1 Hz sine of 0.2 rad."""
    acceleration = 0.2 * (2.0 * np.pi) ** 2
    for name in ("hybrid", "inverse dynamics"):
        sources = dict(found[name].budget.sources)
        assert sources["model of the load"] == pytest.approx(0.00632 * acceleration, rel=1e-3)
        assert 0.05 < sources["friction"] < 2.0 * 0.333
    ideal = dict(found["ideal"].budget.sources)
    assert "model of the load" not in ideal and ideal["sensors"] < 0.05 < ideal["friction"]
    assert {c.side for c in found["hybrid"].budget.chambers} == {"a", "b"}
    assert found["corner"].budget.corners and not found["hybrid"].budget.corners
    assert any("corners" in line for line in found["corner"].notes())


def test_conditions_follow_the_mode_and_the_gains(found: dict[str, Stability]) -> None:
    assert [c.holds for c in found["hybrid"].conditions] == [True, False, False]
    assert all(c.holds for c in found["pneumatic"].conditions)
    assert [c.holds for c in found["inverse dynamics"].conditions][:2] == [True, True]
    limit = found["inverse dynamics"].conditions[-1]
    assert limit.holds == (found["inverse dynamics"].budget.saturated == 0.0)


def test_others_have_no_analysis(runs: dict[str, tuple[Case, ClosedLoopRun]]) -> None:
    case, run = runs["hybrid"]
    with pytest.raises(InputError, match="backstepping"):
        stability_of(dataclasses.replace(case, controller=PvaController()), run)
    case, run = runs["inverse dynamics"]
    with pytest.raises(InputError, match="mode hybrid"):
        stability_of(dataclasses.replace(case, mode=Mode.PNEUMATIC), run)


def test_stability_from_the_command_line(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Any,
    runs: dict[str, tuple[Case, ClosedLoopRun]],
) -> None:
    """On the terminal, in `--json` and on the page: the same conditions and bound."""
    stand: Callable[..., Any] = lambda *_: (runs["hybrid"][1], ())  # noqa: E731
    monkeypatch.setattr("sysid.pipeline.control.run_task", stand)
    bundle = str(thesis_folder() / REFERENCE_BUNDLE)
    words = ["control", bundle, "--controller", "backstepping", "--trajectory", "3"]
    words += ["--mode", "hybrid", "--stability"]
    assert main([*words, "-o", str(tmp_path), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)["stability"]
    assert [c["holds"] for c in content["conditions"]] == [True, False, False]
    assert content["largest_rad"] < content["bound_rad"]
    page = (tmp_path / "page.html").read_text("utf-8")
    assert 'id="stability"' in page and "4.3.50" in page
    assert main(words) == 0
    assert "k2, as printed" in capsys.readouterr().out
    words[words.index("backstepping")] = "pva"
    words[words.index("hybrid")] = "pneumatic"
    assert main(words) == 2
    assert "stability" in capsys.readouterr().err
