"""Friction that grows with the motor's effort, fitted over tests of several payloads."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from friction_trials import INERTIA, PERIOD, RIG, trial

from sysid.errors import InputError, NotIdentifiedError
from sysid.friction import fit_friction, friction_rmse
from sysid.io.logs import Trial
from sysid.io.rig import Inertia
from sysid.parameters import Bundle
from sysid.plant.effects.friction import LoadDependentFriction

COULOMB, VISCOUS, SHARE, LEVER = 0.2, 0.05, 0.06, 0.37
ARM = replace(
    RIG,
    cylinder=None,
    inertia=Inertia(equivalent_kg_m2=INERTIA, payload_length_m=LEVER),
    content={
        "rig": {"name": "arm", "orientation": "horizontal"},
        "inertia": {"equivalent_kg_m2": INERTIA, "payload_length_m": LEVER},
    },
)


def driven(seed: int, payload: float, share: float = SHARE) -> Trial:
    """An arm on a path of sines, by the torque that this takes; friction scatters by 2 %."""
    rng = np.random.default_rng(seed)
    waves = [(0.5 / k, 2.0 * np.pi * rng.uniform(0.6, 0.8) * k, 6.0 * rng.random()) for k in (1, 2)]
    time = PERIOD * np.arange(6000)
    angle = np.sum([a * np.sin(f * time + p) for a, f, p in waves], axis=0)
    time = time + 0.5 * PERIOD  # a command holds from its row to the next
    speed = np.sum([a * f * np.cos(f * time + p) for a, f, p in waves], axis=0)
    turn = np.sum([-a * f * f * np.sin(f * time + p) for a, f, p in waves], axis=0)
    way, own = np.sign(speed), 1.0 + 0.02 * rng.normal()
    needed = (INERTIA + payload * LEVER**2) * turn + own * (COULOMB * way + VISCOUS * speed)
    # What friction takes of the torque adds to what drives, and helps to brake.
    motor = needed / (1.0 - share * way * np.sign(needed))
    return replace(trial(f"{payload:g} kg, {seed}", motor, angle), payload_kg=payload)


def made_tests(share: float = SHARE, first: int = 0) -> list[Trial]:
    return [driven(first + k, payload, share) for k, payload in enumerate((0.0, 0.4, 0.8) * 2)]


def test_the_share_over_three_payloads() -> None:
    found = fit_friction(made_tests(), ARM, kind="motion", load="motor")
    assert found.load is not None
    share = found.load.share
    assert share.value == pytest.approx(SHARE, rel=0.05) and share.holds(SHARE)
    assert found["coulomb"].value == pytest.approx(COULOMB, rel=0.03)
    assert found["viscous"].value == pytest.approx(VISCOUS, rel=0.06)
    rest = [driven(50, 0.8)]
    plain = fit_friction(made_tests(), ARM, kind="motion", cutoff_hz=found.cutoff_hz)
    assert friction_rmse(found, rest, ARM) < 0.7 * friction_rmse(plain, rest, ARM)


def test_with_an_inertia_that_is_not_declared() -> None:
    found = fit_friction(made_tests(), ARM, kind="motion", load="motor", estimate_inertia=True)
    assert found.load is not None
    assert found.load.share.value == pytest.approx(SHARE, rel=0.1)
    assert found["inertia"].value == pytest.approx(INERTIA, rel=0.05)


def test_none_is_given_where_there_is_none() -> None:
    found = fit_friction(made_tests(0.0), ARM, kind="motion", load="motor")
    assert found.load is None and not found.part().effects
    assert any("these tests show none" in notice for notice in found.notices)
    assert found["coulomb"].value == pytest.approx(COULOMB, rel=0.03)


def test_the_bundle_simulates_with_it(tmp_path: Path) -> None:
    found = fit_friction(made_tests(), ARM, kind="motion", load="motor")
    bundle = Bundle.new(ARM, found.part(), [])
    assert [entry.id for entry in bundle.effects] == ["load-dependent-friction"]
    text = json.dumps(bundle.to_json(), allow_nan=False)
    assert "load_is_transmitted" in text
    (effect,) = bundle.model().effects
    assert isinstance(effect, LoadDependentFriction)
    assert found.load is not None and effect.load_friction == found.load.share.value
    assert effect.load_is_transmitted == 0.0


def test_what_cannot_show_it_is_refused() -> None:
    with pytest.raises(NotIdentifiedError, match="several payloads"):
        fit_friction(made_tests()[:2], ARM, kind="motion", load="motor")
    with pytest.raises(InputError, match="motor or transmitted"):
        fit_friction(made_tests()[:3], ARM, kind="motion", load="gear")
