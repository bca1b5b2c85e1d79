"""Static friction read through a motor: what the bench says where the motor is not as declared."""

from __future__ import annotations

import math

import numpy as np
import pytest

from sysid.plant.base import Parameters
from sysid.plant.effects.demonstration import reference_parameters
from sysid.plant.effects.linkage import Backlash
from sysid.plant.effects.motor import (
    AmplifierLag,
    TorqueConstantError,
    TorqueRipple,
    TorqueSaturation,
)
from sysid.plant.ports import Effect, Model
from sysid.plant.static_reading import as_read, static_ratio
from sysid.refinement.problem import Problem
from sysid.refinement.unknowns import Unknown

TOLD = 0.333


def upright(moment: float = 0.0) -> Parameters:
    return reference_parameters().replace(gravity_moment=moment)


@pytest.mark.parametrize("moment", [0.0, 0.4])
def test_static_friction_is_what_the_motor_gave(moment: float) -> None:
    model = Model(upright(moment), (TorqueConstantError(-0.05),))
    assert static_ratio(model, TOLD) == pytest.approx(0.95, rel=1e-12)


@pytest.mark.parametrize(
    "effect", [AmplifierLag(0.02), Backlash(gap_rad=0.01, motor_share=0.3)], ids=lambda e: e.id
)
def test_what_follows_a_slow_ramp_reads_as_told(effect: Effect) -> None:
    assert static_ratio(Model(upright(), (effect,)), TOLD) == 1.0


def test_a_ripple_averages_over_the_stroke_and_a_limit_does_not() -> None:
    ripple = Model(upright(), (TorqueRipple(0.1, 0.1, 12.0),))
    assert static_ratio(ripple, TOLD) == pytest.approx(1.0, abs=0.04)
    early = Model(upright(), (TorqueSaturation(1.0 / 0.3),))
    assert static_ratio(early, TOLD) == pytest.approx(0.3 / TOLD)


def test_a_declared_limit_alone_changes_no_reading() -> None:
    """The bench clips the effort by it already."""
    low = upright().replace(max_effort=0.2)
    assert static_ratio(Model(low, (TorqueConstantError(0.0),)), TOLD) == 1.0


def test_the_reading_follows_the_effects_from_either_side() -> None:
    plain = Model(upright().replace(static_effort=TOLD))
    less = as_read(plain, Model(plain.parameters, (TorqueConstantError(-0.05),)))
    assert float(less.parameters.static_effort) == pytest.approx(0.95 * TOLD)
    back = as_read(less, Model(less.parameters))
    assert float(back.parameters.static_effort) == pytest.approx(TOLD, rel=1e-3)


def _problem(gain: float) -> Problem:
    """Static friction with a prior of 0.1 %, beside a motor's gain; no motion."""
    model = Model(upright().replace(static_effort=TOLD), (TorqueConstantError(gain),))
    static = Unknown(
        "static", (0, "static_effort"), TOLD, 1e-3 * TOLD, "Nm", 0.0, math.inf, TOLD, "friction"
    )
    motor = Unknown(
        "gain", (1, "torque_gain_error"), gain, math.nan, "-", -0.5, 0.5, 0.05, "effect",
        has_prior=False,
    )  # fmt: skip
    return Problem((), (static, motor), model, "theta_rad", (), (0.02, 0.02), 0)


def test_the_prior_of_static_friction_moves_with_the_motors_gain() -> None:
    """A gain that falls by 2 % says that static friction was read 2 % too high."""
    problem = _problem(-0.03)
    static, gain = problem.unknowns
    at = np.array([static.coordinate(TOLD * 0.95 / 0.97), gain.coordinate(-0.05)])
    rows = problem.prior(at)
    assert rows[0, -1] == pytest.approx(0.0, abs=1e-9)
    assert problem.prior_residual(at, 0) == pytest.approx(0.0, abs=1e-9)
    assert problem.prior(problem.first_point().shared)[0, -1] == 0.0
    stayed = np.array([0.0, at[1]])
    assert problem.prior_residual(stayed, 0) == pytest.approx(math.log(0.97 / 0.95) / 1e-3)
    step = 1e-5
    for i in range(2):
        moved = np.array(at)
        moved[i] += step
        slope = (problem.prior(moved)[0, -1] - rows[0, -1]) / step
        assert rows[0, i] == pytest.approx(slope, rel=1e-3)


def test_at_its_bound_the_gain_has_a_slope_too() -> None:
    problem = _problem(0.5)
    row = problem.prior(problem.first_point().shared)[0]
    assert row[1] == pytest.approx(-0.05 / 1.5 / 1e-3, rel=1e-3)
