"""Tanks that obey ISO 6358: which law is chosen, C, b and the wall's conductance, the verdict."""

from __future__ import annotations

import json
import warnings

import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.tanks import Draw, Tank, drawn, iso_flow
from sysid.commands.printing import print_json
from sysid.diagnosis.bench.diagnose import diagnose_component
from sysid.diagnosis.bench.tank import tank
from sysid.diagnosis.bench.tank_gas import Iso6358, grid, simulated
from sysid.errors import NotIdentifiedError
from sysid.estimation.nonlinear import Parameter, minimise
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.parameters import Bundle, DiscreteLaw
from sysid.pipeline.fit_part import bench_fit
from sysid.plant.effects.catalogue import catalogue
from sysid.plant.steps import relaxing_step

SOME = {
    key: kind
    for key, kind in catalogue().items()
    if key in ("atmosphere-leakage", "pressure-offset", "tube-lag", "wall-heat-transfer")
}


def fitted(draw: Draw, law: str = "auto") -> tuple[DiscreteLaw, Bundle]:
    parts = bench_fit("tank", draw.trials, draw.rig, law).part()
    assert parts.valves is not None
    discrete = parts.valves.side("a").discrete
    assert discrete is not None
    return discrete, Bundle.new(draw.rig, parts, [])


def test_an_isothermal_tank_gives_c_and_b_and_lacks_nothing() -> None:
    draw = drawn("iso", 205)
    law, bundle = fitted(draw)
    assert law.law_of("dis") == "iso6358"
    for key, true in draw.truth.items():
        estimate = law.estimates()[f"{key}.exhaust"]
        assert estimate.value == pytest.approx(true, rel=0.01)
        low, high = estimate.interval
        assert low < high < 1.1 * estimate.value
    assert not law.c_dis.identified
    again = Bundle.model_validate(json.loads(json.dumps(bundle.to_json()))).valve("a").discrete
    assert again is not None and again.to_json() == law.to_json()
    found = diagnose_component("tank", draw.trials, (), draw.rig, bundle, SOME)
    assert found.verdict == "adequate" and found.effects == ()
    assert not any("Error" in line for line in found.notices)


def test_one_recording_cannot_tell_and_its_json_has_no_nan(
    capsys: pytest.CaptureFixture[str],
) -> None:
    draw = drawn("warm", 203)
    law, _ = fitted(draw)
    assert law.law_of("dis") == "iso6358"
    assert law.estimates()["sonic_conductance.exhaust"].holds(draw.truth["sonic_conductance"])
    # A pressure by the thesis' law leaves far more than the noise.
    forced, other = fitted(draw, "thesis")
    assert forced.law_of("dis") == "thesis" and forced.c_dis.identified
    found = diagnose_component("tank", draw.trials, (), draw.rig, other, SOME)
    assert (found.verdict, found.reason) == ("unexplained", "one recording")
    assert any(line.startswith("one recording cannot tell") for line in found.notices)
    print_json(found.to_json() | {"unknown": [np.nan, np.inf]})
    shown = json.loads(capsys.readouterr().out)
    assert shown["unknown"] == [None, None]
    assert [entry["share"] for entry in shown["unexplained"]] == [None]


def test_pressures_that_follow_no_law_are_refused() -> None:
    draw = drawn("iso", 205)
    time = np.arange(60.0)
    pressure = 3e5 + 1e5 * np.cos(0.4 * time)
    wave = Trial("1", time, {"pressure_a_pa": pressure, "valve_a": 0.0 * time}, "wave.csv")
    with pytest.raises(NotIdentifiedError, match="more than it explains"):
        bench_fit("tank", [wave], draw.rig, "thesis")


def test_a_step_over_the_corner_of_the_choked_flow_has_the_corner() -> None:
    """Against the exact course; one cubic over the step of the corner missed it by 5 to 20 Pa."""
    from sysid.plant.ports import Model

    draw = drawn("choked", 204)
    part = tank(draw.trials, draw.rig)
    p, first = part.base_parameters, part.discharges[0]
    choked, c_dis = (draw.truth[key] for key in ("choked_flow_dis_kg_s", "c_dis"))
    model = Model(p.replace(c_dis_a=c_dis, choked_dis_a=choked))
    gain = p.heat_capacity_ratio * p.gas_constant * p.temperature / (p.offset_a * p.area_a)
    boundary = p.atmosphere / 0.53
    corner = (first.start - boundary) / (gain * choked)
    time = np.linspace(0.0, first.time[-1], 2000)
    later = (boundary - p.atmosphere) * np.exp(-gain * c_dis * (time - corner)) + p.atmosphere
    exact = np.where(time < corner, first.start - gain * choked * time, later)
    times = grid(float(time[-1]), first.bin_s, 6.0 * first.bin_s, 1.06)
    found = simulated(np.array([first.start]), times, model, None).at(time)[:, 0]
    assert np.abs(found - exact).max() < 0.5


def test_a_wall_of_any_conductance_needs_no_short_steps() -> None:
    """Against steps a tenth as long, from an adiabatic to an isothermal tank."""
    part = tank(drawn("iso", 205).trials, drawn("iso", 205).rig)
    from sysid.plant.ports import Model

    model, shares = Model(part.base_parameters), np.array([1.0, 0.6, 0.05, 1e-4, 0.0])
    one = np.ones(len(shares))
    law = Iso6358(1.5e-8 * one, 0.3 * one, 0.5 * one, shares)
    scale = part.base_parameters.offset_a * part.base_parameters.area_a / (84000.0 * 1.185 * 1.5e-8)
    ends: list[NDArray[np.float64]] = []
    for step in (0.03, 0.003):
        times = grid(2.0 * float(scale), step * float(scale), step * float(scale), 1.0)
        pressure = simulated(6e5 * one, times, model, law).pressures
        ends.append(np.array([np.interp(float(scale), times, own) for own in pressure.T]))
    assert np.abs(ends[0] / ends[1] - 1.0).max() < 2e-4
    assert np.all(np.diff(ends[1]) > 0.0)  # the colder gas has the lower pressure


def test_a_law_that_no_vessel_has_warns_of_nothing() -> None:
    """A search tries any: of a flow of tons a second exponentials overflow."""
    from sysid.plant.ports import Model

    part = tank(drawn("iso", 205).trials, drawn("iso", 205).rig)
    one = np.ones(2)
    law = Iso6358(1e8 * one, 0.3 * one, 0.5 * one, np.array([1.0, 0.0]))
    vast = part.base_parameters.replace(c_dis_a=1e5, choked_dis_a=1e5)
    times = grid(5.0, 0.01, 0.05, 1.06)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for tried in (law, None):
            course = simulated(6e5 * one, times, Model(vast), tried)
            assert np.all(course.pressures < 61e5)


def test_a_relaxing_step_is_of_fourth_order_and_exact_where_only_it_relaxes() -> None:
    def wave(share: float, state: object, step: float = 0.1) -> tuple[float, ...]:
        values = np.array(state)
        return float(values[1]), float(-values[0])

    state: tuple[float, ...] = (1.0, 0.0)
    for _ in range(10):
        state = relaxing_step(state, wave(0.0, state), (0.0, 0.0), wave, 0.1)  # type: ignore[assignment]
    assert state[0] == pytest.approx(np.cos(1.0), abs=1e-6)
    stiff = np.array([1e-3, 1.0, 1e4])
    (after,) = relaxing_step(
        (np.ones(3),), (1.0 - stiff,), (stiff,), lambda _, s: (1.0 - stiff * s[0],), 0.5
    )
    assert after == pytest.approx(np.exp(-0.5 * stiff) + (1.0 - np.exp(-0.5 * stiff)) / stiff)


def few_rows(period: float, seed: int) -> tuple[list[Trial], Rig]:
    """A 5 l tank of gas as warm as the room from 8 bar, C = 2e-8, b = 0.3, every `period` s."""
    tank, rng = Tank(5e-3, 101325.0, 293.15), np.random.default_rng(seed)
    time = np.arange(-4.0, 14.0, period)
    pressure = np.full(len(time), 8e5)
    flow = iso_flow(2e-8, 0.3, 0.5, tank.atmosphere)
    pressure[time >= 0.0] = tank.real(flow, np.inf, 8e5, time[time >= 0.0])
    pressure += 100.0 * rng.standard_normal(len(time))
    channels = {"pressure_a_pa": pressure, "valve_a": (time < 0.0) * 1.0}
    return [Trial("1", time, channels, "few.csv")], tank.rig()


def test_a_law_with_as_many_numbers_as_rows_is_not_chosen_for_its_errors() -> None:
    trials, rig = few_rows(1.5, 3)
    part = bench_fit("tank", trials, rig).part()
    assert part.valves is not None
    law = part.valves.side("a").discrete
    assert law is not None and law.law_of("dis") == "iso6358"
    found = law.estimates()
    assert not found["subsonic_index.exhaust"].has_error
    assert law.quality["discharge"].rmse > 1.0
    for key, true in (("sonic_conductance", 2e-8), ("critical_ratio", 0.3)):
        low, high = found[f"{key}.exhaust"].interval
        assert low < true < high and high - low > 1e-3 * true


def test_gas_as_warm_as_the_wall_is_a_law_though_noise_wants_it_warmer() -> None:
    # With one noise in forty: twice its error beyond a wall that conducts all.
    trials, rig = few_rows(0.5, 3)
    part = bench_fit("tank", trials, rig).part()
    assert part.valves is not None
    law = part.valves.side("a").discrete
    assert law is not None and law.law_of("dis") == "iso6358"
    assert "the room's temperature" in str(law.wall_conductance_w_per_k.reason)
    assert law.estimates()["sonic_conductance.exhaust"].value == pytest.approx(2e-8, rel=0.01)


def test_a_bound_that_there_is_is_a_value_though_the_data_want_it_beyond() -> None:
    rng, x = np.random.default_rng(3), np.linspace(0.0, 1.0, 200)
    y = 2.0 * x - 0.5 * x**2 + 0.05 * rng.standard_normal(len(x))
    parameters = [Parameter("gain", 1.0, "-"), Parameter("share", 0.1, "-", 0.0)]
    fit = minimise(lambda p: y - p[0] * x - p[1] * x**2, parameters)
    bounded = fit.at_bound_by_noise(lambda one: one.correlated_covariance(), {"share"})
    found = bounded.estimate("share", bounded.fit.correlated_covariance()).within(0.0, np.inf)
    assert found.value == 0.0 and found.interval[0] == 0.0 < found.interval[1]


def test_a_value_at_its_bound_is_a_value_unless_the_data_want_it_beyond() -> None:
    rng, x = np.random.default_rng(3), np.linspace(0.0, 1.0, 200)
    parameters = [Parameter("gain", 1.0, "-"), Parameter("leak", 0.1, "-", 0.0)]
    for leak, is_value in ((-0.03, True), (-0.5, False)):
        y = 2.0 * x + leak * x**2 + 0.05 * rng.standard_normal(len(x))
        fit = minimise(lambda p, y=y: y - p[0] * x - p[1] * x**2, parameters)  # type: ignore[misc]
        assert fit.diagnosis.at_bound == ("leak",)
        bounded = fit.at_bound_by_noise(lambda one: one.correlated_covariance())
        assert (set(bounded.steps) == {"leak"}) == is_value
        # The bound itself is said, and not where rounding made the solver stop.
        assert fit.estimate("leak").reason == "leak is stuck at its bound, 0"
        if is_value:
            covariance = bounded.fit.correlated_covariance()
            found = bounded.estimate("leak", covariance).within(0.0, np.inf)
            assert found.value == 0.0
            assert found.interval[0] == 0.0 < found.interval[1] < 0.3
            # What the leak might be is in the other number's error.
            gain = bounded.estimate("gain", covariance)
            assert gain.std > 1.5 * fit.estimate("gain").std
