"""Valves of ISO 6358 in the simulator, under effects, averaged over pulses, and in the model."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from sysid.identification.valve_discrete.iso_curve import IsoPath
from sysid.io.rig import Rig, rig_from_content
from sysid.plant import valve_laws
from sysid.plant.base import Parameters, ValveParameters, parameters_from_rig
from sysid.plant.effects.supply import backed_exhaust_flow, drooped_filling_flow
from sysid.plant.iso6358 import iso6358_flow
from sysid.plant.ports import Model
from sysid.plant.preparation import Inputs, ValveCommand
from sysid.plant.simulator import simulate
from sysid.surfaces.averaged import AveragedLaw

C_FILL, B_FILL, C_DIS, B_DIS, INDEX = 2.2e-9, 0.3, 1.6e-9, 0.22, 0.5
VALVE = ValveParameters(0.0, 0.0, 0.0, 0.0, C_FILL, B_FILL, INDEX, C_DIS, B_DIS, INDEX)
SUPPLY, ATMOSPHERE = 5e5, 1.0e5


@pytest.fixture
def rig(rig_text: str) -> Rig:
    import tomllib

    content = tomllib.loads(rig_text)
    content["air"] |= {"supply_pressure_pa": SUPPLY, "atmospheric_pressure_pa": ATMOSPHERE}
    return rig_from_content(content, "rig.toml")


def held(rig: Rig) -> Parameters:
    """An actuator whose static friction no pressure overcomes."""
    return parameters_from_rig(
        rig, static_effort=1e4, coulomb_effort=1e4, viscous=0.1, valve_a=VALVE, valve_b=VALVE
    )


def test_a_held_chamber_follows_the_closed_form(rig: Rig) -> None:
    p = held(rig)
    time = np.arange(0.0, 1.2, 1e-3)
    command = ((time >= 0.1) & (time < 0.7)).astype(float)
    inputs = Inputs(time, np.zeros(len(time)), ValveCommand(command), position=0.2)
    (run,) = simulate([inputs], [Model(p)])
    volume = float((p.offset_a + p.pitch_radius * 0.2) * p.area_a)
    gain = p.heat_capacity_ratio * p.gas_constant * p.temperature / volume
    on, off = 0.1 + p.on_delay_a, 0.7 + p.off_delay_a
    rates = [gain * float(iso6358_flow(1.0, 0.0, c, 0.3)) for c in (C_FILL, C_DIS)]
    filled = IsoPath(rates[0], B_FILL).pressure(ATMOSPHERE, SUPPLY, np.maximum(time - on, 0.0))
    top = float(IsoPath(rates[0], B_FILL).pressure(ATMOSPHERE, SUPPLY, np.array([off - on]))[0])
    left = IsoPath(rates[1], B_DIS).pressure(top, ATMOSPHERE, np.maximum(time - off, 0.0))
    assert top == pytest.approx(SUPPLY, abs=1.0)
    # By the simulator's steps of a millisecond next to the ends of both curves.
    assert np.allclose(run.pressure_a, np.where(time < off, filled, left), rtol=0.0, atol=60.0)
    assert np.allclose(run.pressure_b, ATMOSPHERE, rtol=0.0, atol=1.0)


def test_at_the_exhaust_line_the_pressure_rests(rig: Rig) -> None:
    time = np.arange(0.0, 0.5, 1e-3)
    inputs = Inputs(time, np.zeros(len(time)), pressure_a=1.02 * ATMOSPHERE)
    (run,) = simulate([inputs], [Model(held(rig))])
    settled = run.pressure_a[time > 0.3]
    assert np.ptp(settled) < 0.1 and settled[-1] == pytest.approx(ATMOSPHERE, abs=0.1)


def test_each_direction_has_its_own_law() -> None:
    mixed = ValveParameters(1e-3, 0.0, 1.5e-6, 0.0, None, None, None, C_DIS, B_DIS, INDEX)
    plain = valve_laws.filling_flow(mixed, 2e5, SUPPLY, SUPPLY)
    assert plain == 1e-3
    assert valve_laws.exhaust_flow(mixed, 3e5, ATMOSPHERE) == pytest.approx(
        -float(iso6358_flow(3e5, ATMOSPHERE, C_DIS, B_DIS))
    )
    assert valve_laws.filling_boundary(mixed, SUPPLY) == pytest.approx(0.53 * SUPPLY)
    assert valve_laws.exhaust_boundary(mixed, ATMOSPHERE) == pytest.approx(ATMOSPHERE / B_DIS)


@pytest.mark.parametrize("index", [0.5, 0.6])
def test_a_drooping_supply_and_a_silencer_balance_the_flow(index: float) -> None:
    valve = ValveParameters(0.0, 0.0, 0.0, 0.0, C_FILL, B_FILL, index, C_DIS, B_DIS, index)
    pressure = np.linspace(1.0e5, 4.9e5, 40)
    droop = 5e4 / 1.3e-3
    flow = drooped_filling_flow(pressure, SUPPLY, valve, SUPPLY, droop)
    again = iso6358_flow(SUPPLY - droop * flow, pressure, C_FILL, B_FILL, index)
    assert np.allclose(flow, again, rtol=2e-4, atol=0.0)
    resistance, curvature = 2e4 / 1e-3, 1e4 / 1e-6
    flow = backed_exhaust_flow(pressure[1:], ATMOSPHERE, valve, resistance, curvature)
    back = ATMOSPHERE + resistance * flow + curvature * flow**2
    again = iso6358_flow(pressure[1:], back, C_DIS, B_DIS, index)
    assert np.allclose(flow, again, rtol=2e-3, atol=0.0)


@pytest.mark.parametrize("resistance", [-1e8, -3e7, 0.0, 3e7])
@pytest.mark.parametrize("curvature", [0.0, 1e10])
def test_a_resistance_that_a_search_probes_gives_flows(resistance: float, curvature: float) -> None:
    valve = ValveParameters(1e-3, 4e-9, 1.5e-3, 5e-9)
    pressure = np.linspace(0.9 * ATMOSPHERE, SUPPLY, 200)
    losses = np.full(200, resistance), np.full(200, curvature)
    flow = backed_exhaust_flow(pressure, np.full(200, ATMOSPHERE), valve, *losses)
    assert np.isfinite(flow).all() and flow[-1] == valve.choked_dis


def law_of(rig: Rig, **changes: Any) -> AveragedLaw:
    p = held(rig).replace(pwm_period=0.005, **changes)
    return AveragedLaw.of(p, "a")


def test_the_averaged_law_and_its_inverse(rig: Rig) -> None:
    law = law_of(rig)
    duty, pressure = np.meshgrid(np.linspace(0.1, 0.9, 9), np.linspace(1.2e5, 4.5e5, 8))
    assert np.allclose(law.duty(law.flow(duty, pressure), pressure), duty, atol=1e-9)


def test_mean_flows_follow_the_pulses(rig: Rig) -> None:
    """The averaged law's pressure is the mean of that under real pulses."""
    p = held(rig)
    time = np.arange(0.0, 0.8, 1e-3)
    duty = ValveCommand(np.full(len(time), 0.55), is_duty=True)
    inputs = Inputs(time, np.zeros(len(time)), duty, duty)
    laws = AveragedLaw.of(p, "a"), AveragedLaw.of(p, "b")
    (pulsed,) = simulate([inputs], [Model(p)])
    (mean,) = simulate([inputs], [Model(p)], laws)
    ends = slice(200, None, 5)
    assert np.abs(pulsed.pressure_a - mean.pressure_a)[ends].max() < 0.002 * SUPPLY
