"""Derivatives of the simulation: against differences of it, through every kind of event."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.rigs import random_runs
from benchmarks.tangents import NUMBERS, SIZES, column_errors
from sysid.plant.differences import simulate_differences
from sysid.plant.effects import StribeckFriction
from sysid.plant.ports import Model
from sysid.plant.preparation import Inputs
from sysid.plant.simulator import simulate
from sysid.plant.tangents import simulate_tangents
from sysid.types import FloatArray


@pytest.fixture(scope="module")
def runs() -> tuple[list[Inputs], list[Model]]:
    """Four random rigs under PWM, half a second each."""
    return random_runs(5, 4, 0.5)


def test_states_are_those_of_the_simulation(runs: tuple[list[Inputs], list[Model]]) -> None:
    inputs, models = runs
    for plain, own in zip(
        simulate(inputs, models), simulate_tangents(inputs, models, []), strict=True
    ):
        states = np.array([plain.position, plain.velocity, plain.pressure_a, plain.pressure_b])
        assert np.abs((own.states - states) / SIZES).max() < 1e-9
        assert own.slopes.shape == (4, 4, len(plain.time))


def test_columns_are_the_differences(runs: tuple[list[Inputs], list[Model]]) -> None:
    every = np.concatenate(list(column_errors(*runs).values()))
    assert np.median(every) < 1e-3
    assert np.quantile(every, 0.95) < 0.02


def test_valves_that_open_at_one_instant_have_each_their_own_slope() -> None:
    inputs, models = random_runs(5, 2, 0.3)
    same = {f"{name}_{side}": 2.3e-3 for name in ("on_delay", "off_delay") for side in "ab"}
    models = [Model(m.parameters.replace(**same)) for m in models]
    every = np.concatenate(list(column_errors(inputs, models).values()))
    assert np.quantile(every, 0.95) < 0.02
    directions = [(0, "on_delay_a"), (0, "on_delay_b")]
    for run in simulate_tangents(inputs, models, directions):
        assert all(slope.any() for slope in run.slopes[4:])


def test_a_start_state_has_its_tangent(runs: tuple[list[Inputs], list[Model]]) -> None:
    inputs, models = runs
    assert not any(r.slopes[1].any() for r in simulate_tangents(inputs, models, []))  # at rest
    inputs = [dataclasses.replace(i, velocity=0.5) for i in inputs]
    found = simulate_tangents(inputs, models, [])
    for i, name in enumerate(("position", "velocity", "pressure_a", "pressure_b")):
        step = 1e-6 * SIZES[i, 0]
        ends = []
        for sign in (1.0, -1.0):
            moved = [
                dataclasses.replace(one, **{name: float(run.states[i, 0] + sign * step)})
                for one, run in zip(inputs, found, strict=True)
            ]
            ends.append(simulate(moved, models))
        high, low = ends
        for run, h, lo in zip(found, high, low, strict=True):
            slope = (h.pressure_a - lo.pressure_a) / (2.0 * step)
            assert np.linalg.norm(run.slopes[i, 2] - slope) <= 1e-3 * np.linalg.norm(slope) + 1e-6


def test_an_effect_s_number_has_its_tangent(runs: tuple[list[Inputs], list[Model]]) -> None:
    inputs, models = runs
    name, size = "stribeck_torque_nm", 0.12
    effect = StribeckFriction(size, 0.07)
    with_it = [Model(m.parameters, (effect,)) for m in models]
    slopes = [run.slopes[4] for run in simulate_tangents(inputs, with_it, [(1, name)])]

    def moved(sign: float) -> list[FloatArray]:
        other = dataclasses.replace(effect, **{name: size * (1.0 + sign * 1e-5)})
        found = simulate(inputs, [Model(m.parameters, (other,)) for m in models])
        return [np.array([r.position, r.velocity, r.pressure_a, r.pressure_b]) for r in found]

    for slope, high, low in zip(slopes, moved(1.0), moved(-1.0), strict=True):
        reference = (high - low) / (2e-5 * size) / SIZES
        assert np.linalg.norm(slope / SIZES - reference) <= 0.02 * np.linalg.norm(reference) + 1e-9


# --- differences of neighbours ---------------------------------------------------------


def test_differences_are_the_derivatives(
    runs: tuple[list[Inputs], list[Model]], monkeypatch: pytest.MonkeyPatch
) -> None:
    inputs, models = runs
    inputs = [dataclasses.replace(i, velocity=0.5) for i in inputs[:2]] + inputs[2:]
    directions = [(0, name) for name in NUMBERS]
    sizes = [size or float(getattr(models[0].parameters, n)) for n, size in NUMBERS.items()]
    exact = simulate_tangents(inputs, models, directions)
    found = simulate_differences(inputs, models, directions, sizes)
    errors = []
    for one, other in zip(found, exact, strict=True):
        np.testing.assert_allclose(one.states / SIZES, other.states / SIZES, atol=1e-9)
        for slope, reference in zip(one.slopes / SIZES, other.slopes / SIZES, strict=True):
            size = np.linalg.norm(reference)
            errors.append(np.linalg.norm(slope - reference) / (size or 1.0))
    assert not any(run.slopes[1].any() for run in found[2:])  # at rest
    assert np.median(errors) < 1e-5
    assert np.quantile(errors, 0.95) < 1e-3
    monkeypatch.setattr("sysid.plant.differences._MOST_ROWS", 1)  # one run after the other
    for one, other in zip(
        simulate_differences(inputs, models, directions, sizes), found, strict=True
    ):
        np.testing.assert_array_equal(one.slopes, other.slopes)


def test_a_neighbour_that_breaks_away_elsewhere_is_no_slope() -> None:
    """The command rises in steps, and one of them is just what static friction withstands."""
    (inputs,), (model,) = random_runs(5, 1, 0.5)
    friction = float(model.parameters.static_effort)
    motor = friction * np.floor(np.linspace(0.0, 8.0, len(inputs.time))) / 4.0
    level = float(np.max(motor[motor <= friction]))
    still = dataclasses.replace(inputs, motor=motor, valve_a=None, valve_b=None, velocity=0.0)
    names = [(0, "static_effort"), (0, "coulomb_effort")]
    sizes = [friction, friction]
    ends = []
    for share in (1.0 - 1e-9, 1.0 + 1e-9):  # a neighbour of one of them lies across the jump
        own = Model(
            model.parameters.replace(
                static_effort=level * share, coulomb_effort=0.5 * level, gravity_moment=0.0
            )
        )
        (run,) = simulate_differences([still], [own], names, sizes)
        assert np.ptp(run.states[0]) > 0.01
        ends.append(run)
    assert all(np.abs(run.slopes[4] / SIZES).max() * friction < 1e3 for run in ends)
    assert all(run.slopes[5].any() for run in ends)
