"""Thresholds of what acts in steps: where they fit, and between which sizes nothing changes."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from benchmarks.rigs import REFERENCE
from sysid.diagnosis.actuator.threshold_steps import best_jump, best_near, with_steps
from sysid.estimation.linear import Estimate
from sysid.plant.effects.linkage import Backlash
from sysid.plant.effects.sensor import LostCounts
from sysid.plant.effects.valve import DutyDeadZone
from sysid.plant.ports import Model

# Pulses that were commanded, s; those up to the true dead time, 1.27 ms, were forgotten.
PULSES = np.array([0.4, 0.9, 1.23, 1.30, 1.8, 2.6]) * 1e-3
TRUE = 1.27e-3
[DEAD_TIME] = [q for q in DutyDeadZone.quantities if q.name == "dead_time_s"]


def forgotten(model: Model) -> np.ndarray[Any, Any]:
    return np.repeat(1.0 * (model.effects[-1].dead_time_s >= PULSES), 50)  # type: ignore[attr-defined]


def balances(noise: float) -> Any:
    """A frame whose residual is how the pulses that a model forgets differ from the true ones."""
    rng = np.random.default_rng(5)
    own = noise * rng.standard_normal(50 * len(PULSES))
    truth = forgotten(Model(REFERENCE, (DutyDeadZone(TRUE),)))

    def residual(model: Model, channels: tuple[str, ...]) -> np.ndarray[Any, Any]:
        return 20.0 * (forgotten(model) - truth) + own

    frame = SimpleNamespace(residual=residual, belongs=lambda channels: np.ones(len(own), bool))
    return SimpleNamespace(frame=frame, model=Model(REFERENCE))


@pytest.mark.parametrize("start", [1.16e-3, 1.24e-3, 1.37e-3])
def test_a_size_beside_the_right_step_is_moved_onto_it(start: float) -> None:
    found = best_near(DutyDeadZone(start), balances(1.0))
    assert 1.23e-3 <= found.dead_time_s < 1.30e-3  # type: ignore[attr-defined]


@pytest.mark.parametrize(("start", "most"), [(1.02, None), (1.6, 2.0), (0.6, 2.0)])
def test_a_shape_at_which_an_effect_jumps_is_moved_to_the_least_residual(
    start: float, most: float | None
) -> None:
    """Its balances have a minimum at each sample that begins to count, and a least one."""

    def residual(model: Model, channels: tuple[str, ...]) -> np.ndarray[Any, Any]:
        speed = float(model.effects[-1].counted_speed_rad_per_s)  # type: ignore[attr-defined]
        return np.array([abs(speed - 1.0) + 0.02 * math.sin(200.0 * speed) ** 2])

    frame = SimpleNamespace(residual=residual, belongs=lambda channels: np.ones(1, bool))
    base: Any = SimpleNamespace(frame=frame, model=Model(REFERENCE))
    given = {} if most is None else {"most": most}
    found = best_jump(LostCounts(0.1, start, 1.0), base, **given)
    assert found is not None
    assert abs(found.counted_speed_rad_per_s - 1.0) < 0.1 * (most or 0.1)  # type: ignore[attr-defined]


def test_a_shape_that_is_absent_jumps_nowhere() -> None:
    assert best_jump(Backlash(0.004, 2.0, 0.0), balances(1.0)) is None
    assert best_jump(DutyDeadZone(1.2e-3), balances(1.0)) is None


def test_the_interval_is_that_between_two_pulses() -> None:
    """Whatever a slope said: nothing, or what the step of a difference met."""
    base = balances(1.0)
    model = Model(REFERENCE, (DutyDeadZone(1.25e-3),))
    joint: Any = SimpleNamespace(rest=base.frame.residual(model, ()))
    nothing = Estimate(1.25e-3, math.inf, "s", (-math.inf, math.inf))
    for given in (nothing, Estimate.symmetric(1.25e-3, 1e-9, "s", 5.0)):
        found = with_steps(given, DEAD_TIME, base, model, joint, 0)
        assert found.value == given.value
        assert found.interval == pytest.approx((1.23e-3, 1.30e-3), rel=3e-4)
        assert found.std == pytest.approx(0.07e-3 / math.sqrt(12.0), rel=0.02)
    wide = Estimate.symmetric(1.25e-3, 1e-4, "s", math.inf)
    assert with_steps(wide, DEAD_TIME, base, model, joint, 0) == wide
    unknown = Estimate.unidentified("s", "the data do not depend on it")
    assert with_steps(unknown, DEAD_TIME, base, model, joint, 0) is unknown
