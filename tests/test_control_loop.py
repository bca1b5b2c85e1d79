"""The closed loop: its plant is the simulator's, lanes keep apart, speed, faults."""

from __future__ import annotations

import dataclasses
import time
from collections import OrderedDict
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest

from datasets.thesis.reference_rig import design, plant
from sysid.controllers import loop as loop_module
from sysid.controllers.backstepping import BacksteppingController
from sysid.controllers.dvmpc import DvmpcController
from sysid.controllers.faults import SensorFaults
from sysid.controllers.interface import Commands, Controller, Reference, StateEstimate
from sysid.controllers.loop import PERIOD_S, Case, ClosedLoopRun, closed_loop
from sysid.controllers.modes import Mode
from sysid.controllers.pva import PvaController
from sysid.controllers.sensing import SensorSuite
from sysid.controllers.trajectories import thesis_trajectory
from sysid.errors import InputError, NotIdentifiedError
from sysid.plant.effects.supply import SupplyDroop
from sysid.plant.simulator import Inputs, ValveCommand, simulate

MODES = (Mode.PNEUMATIC, Mode.MOTOR, Mode.HYBRID)


@dataclass(frozen=True)
class Recorded(Controller):
    """Commands that do not depend on the plant: functions of the tick."""

    is_duty: bool = True
    phase: float = 0.0

    def commands(
        self, memory: Any, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        t = estimate.tick * PERIOD_S + self.phase + 0.0 * estimate.position
        # Every duty from 0 to 1, the gaps at both ends among them; on/off at all spacings.
        swing = (7.3 * t) % 1.2 - 0.1
        other = (11.1 * t) % 1.2 - 0.1
        if not self.is_duty:
            swing, other = 1.0 * ((137.0 * t) % 1.0 > 0.5), 1.0 * ((89.0 * t) % 1.0 > 0.4)
        return memory, Commands(0.4 * (t % 0.3 > 0.15), swing, other)


def as_inputs(run: ClosedLoopRun) -> Inputs:
    """The commands of a run as the open-loop simulation takes them."""
    a, b = (ValveCommand(c, run.is_duty) for c in (run.command_a, run.command_b))
    return Inputs(run.time, run.motor, a, b, position=float(run.position[0]))


DELAYS = ((0.0017, 0.0020), (0.0024, 0.0011), (0.0, 0.0))


def test_the_loop_plant_is_the_simulator() -> None:
    """Same commands, same motion: duties from 0 to 1 and switching, delays of every order."""
    cases = [
        Case(
            Recorded(is_duty),
            plant(on_delay_a=on, on_delay_b=on, off_delay_a=off, off_delay_b=off),
            thesis_trajectory(1),
            sensors=SensorSuite.perfect(),
        )
        for is_duty in (True, False)
        for on, off in DELAYS
    ]
    runs = closed_loop(cases, 2.0)
    expected = simulate([as_inputs(run) for run in runs], [case.plant for case in cases])
    for run, other in zip(runs, expected, strict=True):
        assert np.ptp(run.position) > 0.02
        np.testing.assert_allclose(run.position, other.position, atol=1e-6)
        np.testing.assert_allclose(run.pressure_a, other.pressure_a, atol=0.1)
        np.testing.assert_allclose(run.pressure_b, other.pressure_b, atol=0.1)


def controllers(horizon: int = 40) -> list[Controller]:
    own = design()
    return [PvaController(), BacksteppingController(own), DvmpcController(own, horizon=horizon)]


SHORT = 0.1


@cache
def mixed() -> tuple[list[Case], list[ClosedLoopRun]]:
    """Two lanes of each controller, and their runs in one batch."""
    cases = [
        Case(c, plant(), thesis_trajectory(n), seed=n) for n in (3, 4) for c in controllers(10)
    ]
    return cases, closed_loop(cases, SHORT)


def test_a_run_does_not_depend_on_its_batch() -> None:
    cases, together = mixed()
    alone = closed_loop([cases[4]], SHORT)[0]
    np.testing.assert_allclose(alone.position, together[4].position, atol=1e-9)


def test_uncompiled_is_compiled() -> None:
    """The same controllers, called from Python with numpy arrays."""
    cases, fast = mixed()
    for one, other in zip(fast, closed_loop(cases, SHORT, compiled=False), strict=True):
        np.testing.assert_allclose(one.position, other.position, atol=1e-9)
        np.testing.assert_allclose(one.motor, other.motor, atol=1e-6)


class MyController(Controller):
    """A user's own, as the interface's docstring shows it; keeps its memory in the loop."""

    def start(self, lanes: int) -> Any:
        return np.zeros(lanes)

    def commands(
        self, memory: Any, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        error = reference.position - estimate.position
        integral = memory + 1e-3 * error
        effort = 30.0 * error + 0.5 * (reference.velocity - estimate.velocity) + 60.0 * integral
        return integral, Commands(effort, 0.0 * error, 0.0 * error)


@pytest.mark.parametrize("compiled", [True, False])
def test_a_users_controller(compiled: bool) -> None:
    case = Case(MyController(), plant(), thesis_trajectory(1))
    run = closed_loop([case], 1.6, compiled=compiled)[0]
    assert np.ptp(run.reference[:, 0]) > 0.1
    assert run.metrics.rmse < 0.01


def thesis_cases() -> list[Case]:
    return [
        Case(c, plant(), thesis_trajectory(n), m)
        for n in (1, 2, 3, 4)
        for m in MODES
        for c in controllers()
        if m is Mode.PNEUMATIC or not isinstance(c, PvaController)
    ]


@cache
def thesis_runs() -> list[ClosedLoopRun]:
    return closed_loop(thesis_cases())


def test_speed_of_the_thesis_cases(monkeypatch: pytest.MonkeyPatch) -> None:
    """All cells of Tables 4.5.1 to 4.5.3, 10 s at 1 kHz, in one batch, against real time.

    The bar is half of the 20 times that were asked for, in processor time, since other tests
    run beside this one; `benchmarks/controllers.py` has the figure.
    """
    assert len(thesis_runs()) == 28
    # The other tests compile without optimisations.
    monkeypatch.setitem(loop_module._COMPILER_OPTIONS, "xla_backend_optimization_level", 1)
    monkeypatch.setattr(loop_module._run, "_kept", OrderedDict())
    times = []
    for _ in range(3):
        start = time.process_time()
        closed_loop(thesis_cases())
        times.append(time.process_time() - start)
    assert min(times) < 10.0 / 10.0


def test_modes_switch_actuators_off() -> None:
    for case, run in zip(thesis_cases(), thesis_runs(), strict=True):
        assert bool(run.motor.any()) == case.mode.uses_motor
        assert bool(run.command_a.any()) == case.mode.uses_valves


def test_a_healthy_run_reports_nothing() -> None:
    for case, run in zip(thesis_cases(), thesis_runs(), strict=True):
        if case.mode is Mode.PNEUMATIC:
            assert run.faults == ()


def test_the_printed_order_of_the_controllers() -> None:
    """Pneumatic: DVMPC before backstepping before PVA, on each trajectory (Table 4.5.1)."""
    found: dict[str, list[float]] = {}
    for case, run in zip(thesis_cases(), thesis_runs(), strict=True):
        if case.mode is Mode.PNEUMATIC:
            found.setdefault(type(case.controller).__name__, []).append(run.metrics.rmse)
    pva, backstepping, dvmpc = (np.array(found[type(c).__name__]) for c in controllers())
    assert (dvmpc < backstepping).all() and (backstepping < pva).all()


def test_controllers_and_plants_differ() -> None:
    """A plant with sagging supply and more mass: worse, and better for one who knows.

    Sagging is an effect; plants of one batch must have the same.
    """
    droop = SupplyDroop(**{q.name: q.typical for q in SupplyDroop.quantities})
    heavy = plant(inertia=0.08) + droop
    told = design(inertia=0.08)
    told = dataclasses.replace(told, model=told.model + droop)
    cases = [
        Case(BacksteppingController(d, portion=0.0), p, thesis_trajectory(4), Mode.PNEUMATIC)
        for d, p in ((design(), plant() + droop), (design(), heavy), (told, heavy))
    ]
    light, wrong, right = (r.metrics.rmse for r in closed_loop(cases, 1.0))
    assert wrong > 1.2 * light and right < wrong
    with pytest.raises(InputError, match="effects"):
        closed_loop([cases[0], dataclasses.replace(cases[0], plant=plant())], 1.0)


# --- faults ---------------------------------------------------------------------------------


class Broken(MyController):
    def commands(
        self, memory: Any, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        lost = np.nan * estimate.position
        return memory, Commands(lost, np.inf + estimate.position, memory)


Fault = tuple[str, Case]


def fault_cases() -> list[Fault]:
    """What each report begins with, and the case that must have it."""
    found: list[Fault] = []
    cycloid = thesis_trajectory(1)
    for c in controllers():

        def case(
            word: str,
            faults: SensorFaults | None = None,
            mode: Mode = Mode.HYBRID,
            c: Controller = c,
            **changes: float,
        ) -> None:
            n = 3 if "inertia" in changes else 1
            given = faults or SensorFaults()
            found.append(
                (word, Case(c, plant(**changes), thesis_trajectory(n), mode, faults=given))
            )

        case("supply", mode=Mode.PNEUMATIC, supply=1.0e5)
        case("encoder", SensorFaults(encoder_sticks=1.5))
        case("sensor", SensorFaults(pressure_fails=1.0, pressure_recovers=1.2))
        case("sensor", SensorFaults(encoder_fails=1.0))
        case("tracking", inertia=3.0)
        case("tracking", gravity_moment=12.0)
    sine = thesis_trajectory(4)
    found.append(("motor", Case(DvmpcController(design()), plant(), sine, Mode.MOTOR)))
    found.append(("controller", Case(Broken(), plant(), cycloid)))
    return found


def test_faults_are_reported_and_stay_finite() -> None:
    faults = fault_cases()
    for (word, case), run in zip(faults, closed_loop([c for _, c in faults], 3.0), strict=True):
        for name in ("position", "velocity", "pressure_a", "pressure_b", "motor", "measured_a"):
            assert np.isfinite(getattr(run, name)).all(), (word, case.controller, name)
        assert any(line.startswith(word) for line in run.faults), (word, case, run.faults)


def test_what_cannot_run_is_refused() -> None:
    case = Case(PvaController(), plant(pwm_period=0.0033), thesis_trajectory(1))
    with pytest.raises(InputError, match="PWM period"):
        closed_loop([case], 0.1)
    with pytest.raises(NotIdentifiedError, match="c_fill_a"):
        closed_loop([dataclasses.replace(case, plant=plant(c_fill_a=np.nan))], 0.1)
    assert closed_loop([]) == []
