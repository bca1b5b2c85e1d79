"""Trajectories, metrics, sensing, stability, payload, and what a bundle must hold."""

from __future__ import annotations

import copy
import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from golden_folder import golden_bundle

from datasets.thesis.reference_rig import design, plant
from sysid.controllers.backstepping import BacksteppingController, backstepping_type
from sysid.controllers.design_model import INVERSES, design_from_bundle
from sysid.controllers.dvmpc import DvmpcController
from sysid.controllers.interface import Reference, StateEstimate
from sysid.controllers.loop import Case, closed_loop
from sysid.controllers.metrics import tracking_metrics
from sysid.controllers.modes import Mode
from sysid.controllers.payload import PayloadEstimator
from sysid.controllers.pva import PvaController
from sysid.controllers.sensing import (
    Readings,
    filter_coefficients,
    quantised,
    sense,
    start_sensing,
)
from sysid.controllers.stability import check_stability
from sysid.controllers.trajectories import thesis_trajectory
from sysid.errors import InputError, NotIdentifiedError
from sysid.parameters.bundle import Bundle
from sysid.parameters.files import bundle_from_json
from sysid.plant.simulator import Inputs, ValveCommand, simulate

# --- trajectories and metrics ------------------------------------------------------------


@pytest.mark.parametrize("number", [1, 2, 3, 4])
@pytest.mark.parametrize("vertical", [False, True])
def test_trajectories_are_their_derivatives(number: int, vertical: bool) -> None:
    time = np.arange(0.0, 10.0, 1e-4)
    rows = thesis_trajectory(number, vertical).sample(time)
    stop = 0.5 * 0.127 / 0.0375
    assert (np.abs(rows[:, 0]) < stop).all()
    assert not rows[0, 1]
    for order in range(2 if number == 2 else 3):
        slope = np.gradient(rows[:, order], time)
        off = np.abs(slope - rows[:, order + 1]) > 1e-3 * (1.0 + np.abs(rows[:, order + 1]).max())
        assert off.mean() < 0.001  # the corners alone


def test_amplitudes_and_frequencies_as_printed() -> None:
    time = np.arange(0.0, 2.0, 1e-3)
    for number, amplitude, frequency in ((3, 0.5, 1.0), (4, 0.3, 2.0)):
        position = thesis_trajectory(number).sample(time)[:, 0]
        assert np.ptp(position) == pytest.approx(2.0 * amplitude, rel=1e-4)
        crossings = np.sum(np.diff(np.sign(position)) != 0)
        assert crossings == round(4.0 * frequency)
    with pytest.raises(InputError, match="1 to 4"):
        thesis_trajectory(5)


def test_metrics_by_hand() -> None:
    time = np.linspace(0.0, 6.0, 601)
    error = np.where((time >= 5.0) & (time <= 5.5), 0.01 * np.sign(np.sin(200.0 * time)), 0.0)
    error[10] = -0.3
    found = tracking_metrics(time, np.ones(601), 1.0 - error)
    assert found.mae == pytest.approx(0.3)
    assert found.sse == pytest.approx(0.01, rel=0.1)
    assert found.ssa == pytest.approx(0.02)
    assert found.rmse == pytest.approx(np.sqrt((0.3**2 + 51 * 0.01**2) / 601), rel=0.02)
    assert np.isnan(tracking_metrics(time[:100], time[:100], time[:100]).sse)
    with pytest.raises(ValueError, match="one length"):
        tracking_metrics(time, time, time[1:])


# --- sensing -----------------------------------------------------------------------------


def test_the_filter_is_the_rigs() -> None:
    """A sine's velocity at 50 Hz comes back at 1/sqrt(2); at 2 Hz whole, some 5 ms late."""
    filters = filter_coefficients(1e-3)[:, :, None]
    for frequency, share in ((2.0, 1.0), (50.0, 1.0 / np.sqrt(2.0))):
        time = np.arange(2000) * 1e-3
        position = np.sin(2.0 * np.pi * frequency * time)
        memory = start_sensing(Readings(position[:1], position[:1], position[:1]))
        shown = []
        for tick, p in enumerate(position):
            one = np.array([p])
            memory, estimate = sense(memory, Readings(one, one, one), tick, 1e-3, filters)
            shown.append(estimate.velocity[0])
        size = np.max(np.abs(shown[1000:])) / (2.0 * np.pi * frequency)
        assert size == pytest.approx(share, rel=0.02)


def test_quantised_and_lost_readings() -> None:
    assert quantised(np.array([0.26]), np.array([0.1]))[0] == pytest.approx(0.3)
    assert quantised(np.array([0.26]), np.array([0.0]))[0] == 0.26
    filters = filter_coefficients(1e-3, np.inf)[:, :, None]
    before = start_sensing(Readings(np.array([1.0]), np.array([1e5]), np.array([1e5])))
    lost = Readings(np.array([np.nan]), np.array([np.inf]), np.array([2e5]))
    memory, estimate = sense(before, lost, 0, 1e-3, filters)
    assert np.isnan(estimate[1:]).all()
    assert memory.last == before.last and memory.rejected[0] == 1


# --- controllers -------------------------------------------------------------------------


def estimate_at(position: float = 0.0, pressure: float = 2.0e5) -> StateEstimate:
    one = np.array([1.0])
    return StateEstimate(
        0, position * one, 0.0 * one, 0.0 * one, 0.0 * one, pressure * one, pressure * one
    )


def reference_at(position: float, ahead: int, velocity: float = 0.0) -> Reference:
    rows = np.array([position, velocity, 0.0, 0.0])[:, None]
    steps = np.arange(1, ahead + 1)[:, None] * 1e-3
    later = Reference(*(np.zeros((ahead, 1)) + r for r in rows))
    later = later._replace(position=position + velocity * steps)
    return Reference(*rows, ahead=later if ahead else None)


def test_pva_passes_the_dead_zone() -> None:
    pva = PvaController()
    for position, duty_a, duty_b in ((0.01, 0.1808, 0.0), (-0.01, 0.0, 0.1696), (0.0, 0.0, 0.0)):
        _, c = pva.commands((), estimate_at(), reference_at(position, 0))
        assert c.valve_a[0] == pytest.approx(duty_a) and c.valve_b[0] == pytest.approx(duty_b)
    _, c = pva.commands((), estimate_at(), reference_at(5.0, 0))
    assert c.valve_a[0] == pytest.approx(0.80)


def test_backstepping_pushes_towards_the_reference() -> None:
    controller = BacksteppingController(design())
    _, ahead = controller.commands(controller.start(1), estimate_at(), reference_at(0.02, 5))
    _, behind = controller.commands(controller.start(1), estimate_at(), reference_at(-0.02, 5))
    assert ahead.valve_a > behind.valve_a and ahead.valve_b < behind.valve_b
    assert ahead.motor[0] == 0.795 and behind.motor[0] == -0.795


def test_backstepping_types() -> None:
    flags = [
        (c.feedforward, c.compensation)
        for c in (backstepping_type(n, design()) for n in (1, 2, 3, 4))
    ]
    assert flags == [(False, False), (False, True), (True, False), (True, True)]
    with pytest.raises(InputError, match="1 to 4"):
        backstepping_type(5, design())


def test_the_feedforward_looks_one_pwm_period_ahead() -> None:
    """Its flows are those of the motion's own rates, whatever the period."""
    at = thesis_trajectory(3).sample(1e-3 * np.arange(400, 412))[:, :, None]
    flows = {}
    for period in (0.002, 0.005, 0.010):
        own = design(pwm_period=period)
        controller = backstepping_type(3, own)
        assert controller.preview == round(1e3 * period)
        ahead = Reference(*(at[1 : controller.preview + 1, i] for i in range(4)))
        flows[period] = controller._feedforward(Reference(*at[0], ahead), own.model)[0][0]
    assert flows[0.002] == pytest.approx(flows[0.005], rel=0.1)
    assert flows[0.010] == pytest.approx(flows[0.005], rel=0.1)


def test_printed_gains_against_the_printed_conditions() -> None:
    """Table 4.3.2 meets 4.3.50 for k1 and misses it for k2 by a factor of thirty."""
    check = BacksteppingController(design()).stability()
    assert check.least_k1 == pytest.approx(85.0 / (0.02368 * np.sqrt(2.0) + 14.0))
    assert check.least_k2 == pytest.approx(1.0 + 14.0 / 0.02368)
    assert not check.printed and len(check.lines) == 2
    calm = check_stability(60.0, 20.0, 0.0, 0.0, 0.02368)
    assert calm.printed and calm.corrected and calm.lines == []
    with pytest.raises(ValueError, match="inertia"):
        check_stability(1.0, 1.0, 0.0, 0.0, 0.0)


def rollout(controller: DvmpcController, inputs: tuple[float, float]) -> np.ndarray[Any, Any]:
    """Positions by the simulator under held valves, without delays, from the estimate's state."""
    still = dict.fromkeys(("on_delay_a", "on_delay_b", "off_delay_a", "off_delay_b"), 0.0)
    model = plant(**still, static_effort=0.0, coulomb_effort=0.0)
    time = np.arange(controller.horizon + 1) * 1e-3
    a, b = (ValveCommand(np.full(len(time), u)) for u in inputs)
    run = Inputs(time, np.zeros(len(time)), a, b, pressure_a=2e5, pressure_b=2e5)
    return simulate([run], [model])[0].position[1:]


def test_predictions_are_the_simulators() -> None:
    """The cost of each combination against open-loop simulation, to Euler's error."""
    model = dataclasses.replace(design(), model=plant(static_effort=0.0, coulomb_effort=0.0))
    controller = DvmpcController(model, horizon=40)
    reference = reference_at(0.05, 40)
    costs = controller.costs((np.zeros(1),) * 2, estimate_at(), reference, model.model)
    for row, inputs in zip(costs, ((0, 0), (1, 0), (0, 1), (1, 1)), strict=True):
        assert row[0] == pytest.approx(np.sum((0.05 - rollout(controller, inputs)) ** 2), rel=0.03)


def test_varying_inputs_hold_the_constant_ones() -> None:
    """Sixteen sequences, four of them constant, within the constant variant's steps."""
    own = design()
    constant = DvmpcController(own, horizon=41)
    varying = DvmpcController(own, horizon=41, varying=True)
    assert varying.predicted_steps <= constant.predicted_steps
    before, estimate, reference = (np.zeros(1),) * 2, estimate_at(), reference_at(0.05, 41)
    four = constant.costs(before, estimate, reference, own.model)
    sixteen = varying.costs(before, estimate, reference, own.model)
    assert four.shape == (4, 1) and sixteen.shape == (16, 1)
    np.testing.assert_allclose(sixteen[::5], four, rtol=0.05)
    assert sixteen.min() <= four.min() * 1.05


def test_a_predicted_delay_shifts_the_input() -> None:
    """With the valve's delay predicted, an opening valve moves the piston later, so less."""
    own = design()
    plain, delayed = (DvmpcController(own, predicts_delays=flag) for flag in (False, True))
    reference = reference_at(0.3, 30)
    off = (np.zeros(1),) * 2
    now, later = (c.costs(off, estimate_at(), reference, own.model)[1, 0] for c in (plain, delayed))
    assert later > now
    on = (np.ones(1), np.zeros(1))
    kept = delayed.costs(on, estimate_at(), reference, own.model)[1, 0]
    assert kept == pytest.approx(now)


def test_the_printed_motor_gains() -> None:
    """Table 4.4.4's 59.2 and 2.4 are a natural frequency of 50 rad/s, damped by 1."""
    own = DvmpcController(design())
    inertia = float(own.design.parameters.inertia)
    assert inertia * own.natural_frequency**2 == pytest.approx(59.2, rel=1e-3)
    assert 2.0 * own.damping * own.natural_frequency * inertia == pytest.approx(2.4, rel=0.02)


# --- payload -----------------------------------------------------------------------------

UPRIGHT = {"orientation": "vertical"}
LOADED = {"orientation": "vertical", "payload_kg": 0.2}
QUICK = PayloadEstimator(heaviest=0.1, forgetting=0.99)


def test_the_payload_is_found() -> None:
    """Vertical, 0.2 kg unknown to the controllers: half the error, the mass within 40 %.

    In the horizontal, where a payload has no weight, the estimate stays. One beyond what the
    estimator may find is reported.
    """
    own, cycloid = design(UPRIGHT), thesis_trajectory(1, vertical=True)
    cases = []
    for given in (None, PayloadEstimator()):
        cases += [
            Case(BacksteppingController(own, estimator=given), plant(LOADED), cycloid),
            Case(DvmpcController(own, horizon=40, estimator=given), plant(LOADED), cycloid),
        ]
    flat = DvmpcController(design(), horizon=40, estimator=PayloadEstimator())
    narrow = DvmpcController(own, horizon=40, estimator=QUICK)
    cases.append(Case(narrow, plant(LOADED), cycloid))
    *runs, beyond, level = closed_loop([*cases, Case(flat, plant(), thesis_trajectory(1))], 5.6)
    assert any("payload: the estimate is at its limit of 0.1 kg" in f for f in beyond.faults)
    assert not any(f.startswith("payload") for run in runs for f in run.faults)
    for known, found in zip(runs[:2], runs[2:], strict=True):
        assert (known.payload_kg == 0.0).all() and (found.payload_kg[:1000] == 0.0).all()
        assert found.payload_kg[-1] == pytest.approx(0.2, rel=0.4)
        assert found.metrics.rmse < 0.5 * known.metrics.rmse
        detected = PayloadEstimator().detects(found.payload_kg * own.payload_length**2, own)
        assert detected[-1] and not detected[:1000].any()
    assert (level.payload_kg == 0.0).all()


def test_what_counts_as_a_payload() -> None:
    """From the mass on that weighs the threshold with the whole lever; in the vertical alone."""
    own, flat, estimator = design(UPRIGHT), design(), PayloadEstimator()
    lever = float(own.payload_length)
    least = 0.15 / (9.81 * lever)
    mass = least * np.array([0.0, 0.99, 1.01, 5.0])
    found = estimator.detects(mass * lever**2, own)
    assert found.tolist() == [False, False, True, True]
    assert not estimator.detects(mass * lever**2, flat).any()


# --- from a bundle -----------------------------------------------------------------------


def golden() -> dict[str, Any]:
    """A diagnosed bundle: friction, both valves with every law, one effect."""
    content: dict[str, Any] = json.loads(golden_bundle("diagnosed").read_text("utf-8"))
    return content


def bundle(*missing: str) -> Bundle:
    """The golden bundle without some keys."""
    content = copy.deepcopy(golden())
    for path in missing:
        *parents, last = path.split(".")
        part = content
        for key in parents:
            part = part[key]
        del part[last]
    return bundle_from_json(content, Path("bundle.json"))


def test_controllers_run_from_a_bundle() -> None:
    """Every inverse, on the plant that the bundle describes, effect and all: they track."""
    held = bundle()
    cases = []
    for inverse in INVERSES:
        own = design_from_bundle(held, inverse=inverse)
        assert own.model.effects and own.parameters == held.model().parameters
        controller = BacksteppingController(own, portion=0.0)
        cases.append(Case(controller, held.model(), thesis_trajectory(1), Mode.PNEUMATIC))
    dvmpc = DvmpcController(design_from_bundle(held), horizon=40)
    cases.append(Case(dvmpc, held.model(), thesis_trajectory(1), Mode.PNEUMATIC))
    runs = closed_loop(cases, 3.0)
    assert [r.metrics.rmse < 0.02 for r in runs] == [True] * 4, [r.metrics for r in runs]


@pytest.mark.parametrize(
    ("path", "inverse", "words"),
    [
        ("friction", "averaged", "bundle.json: holds no friction"),
        ("valves.a.discrete", "averaged", "valves.a.discrete is missing"),
        ("valves.b", "averaged", "valves.b.discrete is missing"),
        ("valves.b.pwm.fill", "bipolynomial", "no bipolynomial surfaces"),
        ("valves.a.pwm.discharge.ann", "ann", "no ann surfaces"),
        ("rig.cylinder", "averaged", "cylinder"),
        ("rig.air", "averaged", "air"),
    ],
)
def test_a_missing_key_is_named(path: str, inverse: str, words: str) -> None:
    with pytest.raises((InputError, NotIdentifiedError), match=words):
        design_from_bundle(bundle(path), inverse=inverse)


def test_an_unknown_inverse() -> None:
    with pytest.raises(InputError, match="spline"):
        design_from_bundle(bundle(), inverse="spline")
