"""On/off valves: recovery, coverage, and what is said of tests that cannot be used.

The data come from `solve_ivp` with located regime switches, not from the closed form that the
fit uses.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sysid import signals
from sysid.errors import InputError, NotIdentifiedError
from sysid.identification.valve_discrete.curve import CurveFit, fit_curves
from sysid.identification.valve_discrete.held_chamber import (
    DiscreteValve,
    HeldChamber,
    pressure_curve,
)
from sysid.io.logs import Trial, read_log
from sysid.io.rig import Rig, read_rig, rig_from_content
from sysid.plant.base import CRITICAL_RATIO
from sysid.types import FloatArray
from sysid.valve_discrete import DiscreteFit, ValveDiscreteResult, fit_valve_discrete

FLOWS = ("choked_flow_fill_kg_s", "c_fill", "choked_flow_dis_kg_s", "c_dis")
DELAYS = ("on_delay_s", "off_delay_s")
ATMOSPHERE, SUPPLY = 1.0e5, 3.0e5
# Table 3.6.1, with the reference rig's delays.
VALVE_A = DiscreteValve(7.8e-4, 1.5e-6, 3.5e-4, 3.7e-9, 0.0017, 0.0020)
VALVE_B = DiscreteValve(1.3e-3, 1.5e-6, 3.9e-4, 3.7e-9, 0.0017, 0.0020)
END_RAD = 0.127 / 2.0 / 0.0375
NOISE_PA, COUNT_PA = 200.0, 26.0


@pytest.fixture
def rig(rig_text: str) -> Rig:
    return make_rig(rig_text)


def make_rig(rig_text: str, supply: float = SUPPLY) -> Rig:
    import tomllib

    content = tomllib.loads(rig_text)
    content["air"]["supply_pressure_pa"] = supply
    return rig_from_content(content, "rig.toml")


def gain(side: str) -> float:
    """k R T / V of the larger chamber with the piston at its end, Pa/kg."""
    area = 4.524e-4 if side == "a" else 4.207e-4
    return 1.4 * 287.0 * 293.15 / ((0.075 + 0.127 / 2.0) * area)


def integrated(
    valve: DiscreteValve,
    side: str,
    time: FloatArray,
    edges: list[tuple[float, bool]],
    supply: float = SUPPLY,
    initial: float = ATMOSPHERE,
) -> FloatArray:
    """Pressure (n,) Pa by DOP853: `edges` are (time, open from then on), delays included."""
    scale = gain(side)

    def rate(p: float, is_open: bool, choked: bool) -> float:
        if is_open:
            root = valve.c_fill * np.sqrt(max(supply - p, 0.0))
            return scale * (valve.choked_flow_fill_kg_s if choked else float(root))
        flow = valve.choked_flow_dis_kg_s if choked else valve.c_dis * (p - ATMOSPHERE)
        return -scale * flow

    pressure = np.empty(len(time))
    level = initial
    bounds = [(time[0], False), *edges, (time[-1] + 1e-3, False)]
    for (start, is_open), (end, _) in itertools.pairwise(bounds):
        boundary = CRITICAL_RATIO * supply if is_open else ATMOSPHERE / CRITICAL_RATIO
        choked = level <= boundary if is_open else level >= boundary
        while start < end:

            def crossing(_: float, y: FloatArray, boundary: float = boundary) -> float:
                return float(y[0] - boundary)

            crossing.terminal = True  # type: ignore[attr-defined]
            solution = solve_ivp(
                lambda _, y, o=is_open, c=choked: [rate(y[0], o, c)],
                (start, end),
                [level],
                method="DOP853",
                events=crossing if choked else None,
                dense_output=True,
                rtol=1e-10,
                atol=1e-4,
                max_step=0.05,
            )
            stop = float(solution.t[-1])
            rows = (time >= start) & (time <= stop)
            if rows.any():
                pressure[rows] = solution.sol(time[rows])[0]
            start, level, choked = stop, float(solution.y[0, -1]), False
    return pressure


def sensed(pressure: FloatArray, rng: np.random.Generator, noise: float = NOISE_PA) -> FloatArray:
    noisy = pressure + noise * rng.standard_normal(len(pressure))
    return np.asarray(np.round(noisy / COUNT_PA) * COUNT_PA)


@dataclasses.dataclass(frozen=True)
class Bench:
    """What a made test is made from; times in s."""

    valve: DiscreteValve = VALVE_A
    side: str = "a"
    on: float = 1.0
    off: float = 4.0
    end: float = 6.0
    period: float = 0.001
    supply: float = SUPPLY
    noise: float = NOISE_PA

    def trial(self, seed: int, label: str = "1") -> Trial:
        rng = np.random.default_rng(seed)
        time = np.arange(0.0, self.end, self.period)
        on, off = (round(t / self.period) * self.period for t in (self.on, self.off))
        edges = [(on + self.valve.on_delay_s, True), (off + self.valve.off_delay_s, False)]
        edges = [e for e in edges if e[0] < time[-1]]
        command = ((time > on - 1e-9) & (time < off - 1e-9)).astype(float)
        pressure = integrated(self.valve, self.side, time, edges, self.supply)
        return assembled(self.side, label, time, command, sensed(pressure, rng, self.noise), rng)

    def trials(self, seed: int, count: int = 3) -> list[Trial]:
        return [self.trial(1000 * seed + i, f"{self.side}{i}") for i in range(count)]


def assembled(
    side: str,
    label: str,
    time: FloatArray,
    command: FloatArray,
    pressure: FloatArray,
    rng: np.random.Generator,
) -> Trial:
    other = "b" if side == "a" else "a"
    channels = {
        f"valve_{side}": command,
        f"valve_{other}": np.zeros(len(time)),
        "theta_rad": np.full(len(time), END_RAD if side == "a" else -END_RAD),
        f"pressure_{side}_pa": pressure,
        f"pressure_{other}_pa": sensed(np.full(len(time), ATMOSPHERE), rng),
    }
    return Trial(label, time, channels, f"made, test {label}")


def changed(trial: Trial, **channels: FloatArray) -> Trial:
    return dataclasses.replace(trial, channels={**trial.channels, **channels})


def fed(
    supply: Callable[[float], float], seed: int = 1, valve: DiscreteValve = VALVE_A
) -> tuple[Trial, FloatArray]:
    """A test of valve A under a supply that varies in time (small steps), and the supply."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 6.0, 0.001)
    scale, dt, parts = gain("a"), 5e-5, 20
    on, off = 1.0 + valve.on_delay_s, 4.0 + valve.off_delay_s
    p, pressure = ATMOSPHERE, np.empty(len(time))
    for row, start in enumerate(time.tolist()):
        pressure[row] = p
        ps = supply(start)
        for part in range(parts):
            if on <= start + part * dt < off:
                if p <= CRITICAL_RATIO * ps:
                    flow = valve.choked_flow_fill_kg_s * ps / SUPPLY
                else:
                    flow = valve.c_fill * float(np.sign(ps - p)) * abs(ps - p) ** 0.5
            elif p >= ATMOSPHERE / CRITICAL_RATIO:
                flow = -valve.choked_flow_dis_kg_s
            else:
                flow = valve.c_dis * (ATMOSPHERE - p)
            p += dt * scale * flow
    command = ((time >= 1.0) & (time < 4.0)).astype(float)
    trial = assembled("a", "1", time, command, sensed(pressure, rng), rng)
    return trial, np.array([supply(t) for t in time.tolist()])


def fit_quickly(trials: list[Trial], rig: Rig, valve: str | None = None) -> ValveDiscreteResult:
    """Without the critical ratio, which takes longer than all the rest."""
    return fit_valve_discrete(trials, rig, valve=valve, find_ratio=False)


def errors(fit: DiscreteFit, truth: DiscreteValve) -> dict[str, float]:
    """Relative errors of the flows, and errors of the delays in s."""
    found = {n: fit[n].value / getattr(truth, n) - 1.0 for n in FLOWS}
    return found | {n: fit[n].value - getattr(truth, n) for n in DELAYS}


def assert_recovered(fit: DiscreteFit, truth: DiscreteValve, share: float = 0.02) -> None:
    found = errors(fit, truth)
    assert max(abs(found[n]) for n in FLOWS) < share, found
    assert max(abs(found[n]) for n in DELAYS) < 0.3e-3, found


# --- the closed form -----------------------------------------------------------------------


@pytest.mark.parametrize(("valve", "side"), [(VALVE_A, "a"), (VALVE_B, "b")])
def test_closed_form_against_an_integrator(valve: DiscreteValve, side: str) -> None:
    time = np.arange(0.0, 4.0, 0.001)
    edges = [(0.5017, True), (1.5020, False), (2.0017, True), (2.0420, False), (2.3017, True)]
    chamber = HeldChamber(
        time,
        np.array([0.5, 2.0, 2.3]),
        np.array([1.5, 2.04, np.inf]),
        gain(side),
        time[:1],
        np.array([SUPPLY]),
        SUPPLY,
    )
    expected = integrated(valve, side, time, edges)
    found = pressure_curve(chamber, valve, ATMOSPHERE, 0.0, ATMOSPHERE)
    assert np.max(np.abs(found - expected)) < 0.5


def test_closed_form_above_the_supply_and_below_the_atmosphere() -> None:
    """A chamber above the supply empties into it; one below the atmosphere fills from it."""
    time = np.arange(0.0, 1.0, 0.001)
    never = np.array([np.inf])
    chamber = HeldChamber(
        time, np.array([-np.inf]), never, gain("a"), time[:1], np.array([SUPPLY]), SUPPLY
    )
    high = pressure_curve(chamber, VALVE_A, SUPPLY + 2e4, 0.0, ATMOSPHERE)
    slope = np.diff(high)[0] / 0.001
    assert slope == pytest.approx(-gain("a") * VALVE_A.c_fill * np.sqrt(2e4), rel=0.02)
    assert high[-1] == pytest.approx(SUPPLY, abs=1.0)
    off = dataclasses.replace(chamber, opens=np.empty(0), closes=np.empty(0))
    low = pressure_curve(off, VALVE_A, 0.9e5, 0.0, ATMOSPHERE)
    decay = np.exp(-gain("a") * VALVE_A.c_dis * time)
    assert np.allclose(low, ATMOSPHERE - 1e4 * decay, atol=1e-6)


def test_the_curve_depends_continuously_on_the_delay() -> None:
    time = np.arange(0.0, 2.0, 0.001)
    chamber = HeldChamber(
        time, np.array([0.5]), np.array([1.5]), gain("a"), time[:1], np.array([SUPPLY]), SUPPLY
    )

    def rms_change(delay: float, step: float) -> float:
        curves = [
            pressure_curve(
                chamber, dataclasses.replace(VALVE_A, on_delay_s=d), ATMOSPHERE, 0.0, ATMOSPHERE
            )
            for d in (delay, delay + step)
        ]
        return float(np.sqrt(np.mean((curves[1] - curves[0]) ** 2)))

    # Also where the edge passes a sample (2.0 ms): no step, however small the change.
    for delay in (0.0017, 0.0019999999, 0.002):
        assert rms_change(delay, 1e-8) == pytest.approx(0.1 * rms_change(delay, 1e-7), rel=0.05)


# --- recovery ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("valve", "side", "supply"), [(VALVE_A, "a", 251e3), (VALVE_B, "b", 243e3)]
)
def test_round_trip_on_table_3_6_1(
    valve: DiscreteValve, side: str, supply: float, rig_text: str
) -> None:
    bench = Bench(valve, side, supply=supply)
    result = fit_valve_discrete(bench.trials(1), make_rig(rig_text, supply))
    fit = result.valves[side]
    assert_recovered(fit, valve, 0.01)
    assert result.notices == ()
    # What the printed constants imply at the boundary: -34 % (A) and -61 % (B); -6.3, -15.9 %.
    jumps = {"a": (-34.0, -6.3), "b": (-61.0, -15.9)}[side]
    assert fit["jump_fill_percent"].value == pytest.approx(jumps[0], abs=1.0)
    assert fit["jump_dis_percent"].value == pytest.approx(jumps[1], abs=1.0)
    for name in ("critical_ratio_fill", "critical_ratio_dis"):
        assert fit[name].value == pytest.approx(CRITICAL_RATIO, abs=0.01)


def random_valve(rng: np.random.Generator, base: DiscreteValve) -> DiscreteValve:
    flows = {n: getattr(base, n) * rng.uniform(0.8, 1.2) for n in FLOWS}
    delays = {"on_delay_s": rng.uniform(1.2e-3, 2.2e-3), "off_delay_s": rng.uniform(1.5e-3, 2.5e-3)}
    return dataclasses.replace(base, **flows, **delays)


def test_recovery_and_coverage_over_random_valves(rig: Rig) -> None:
    rng = np.random.default_rng(7)
    found: dict[str, list[float]] = {n: [] for n in (*FLOWS, *DELAYS)}
    held = []
    for seed in range(20):
        base, side = (VALVE_A, "a") if seed % 2 else (VALVE_B, "b")
        valve = random_valve(rng, base)
        bench = Bench(valve, side, on=0.3, off=1.6, end=2.8)
        fit = fit_quickly(bench.trials(seed, 2), rig).valves[side]
        for name, error in errors(fit, valve).items():
            found[name].append(abs(error))
            held.append(fit[name].holds(getattr(valve, name)))
    median = {name: float(np.median(v)) for name, v in found.items()}
    assert max(median["choked_flow_fill_kg_s"], median["choked_flow_dis_kg_s"]) < 0.02
    assert max(median["c_fill"], median["c_dis"]) < 0.03
    assert max(median["on_delay_s"], median["off_delay_s"]) < 0.3e-3
    # 120 intervals: 0.95 less three standard errors.
    assert np.mean(held) >= 0.89


def test_coloured_sensor_noise_widens_the_intervals(rig: Rig) -> None:
    trials = Bench(noise=0.0).trials(3)
    rng = np.random.default_rng(3)

    def noisy(trial: Trial, rho: float) -> Trial:
        white = rng.standard_normal(len(trial))
        noise = np.empty(len(white))
        level = 0.0
        for i, w in enumerate(white):
            level = rho * level + np.sqrt(1.0 - rho**2) * w
            noise[i] = level
        return changed(trial, pressure_a_pa=trial["pressure_a_pa"] + NOISE_PA * noise)

    white, coloured = (
        fit_quickly([noisy(t, rho) for t in trials], rig).valves["a"] for rho in (0.0, 0.6)
    )
    assert_recovered(coloured, VALVE_A)
    # An AR(1) of 0.6 doubles the standard error of a slow parameter: sqrt(1.6 / 0.4).
    for name in ("c_fill", "c_dis"):
        assert 1.6 < coloured[name].std / white[name].std < 2.4


def test_both_valves_of_one_file(rig: Rig) -> None:
    trials = [Bench(VALVE_A, "a").trial(1, "1"), Bench(VALVE_B, "b").trial(2, "2")]
    result = fit_quickly(trials, rig)
    assert sorted(result.valves) == ["a", "b"]
    assert_recovered(result.valves["a"], VALVE_A)
    assert_recovered(result.valves["b"], VALVE_B)


@pytest.mark.parametrize(("share", "is_said"), [(1.0, False), (0.95, False), (0.0, True)])
def test_a_piston_that_is_held_at_neither_end_is_said(
    rig: Rig, share: float, is_said: bool
) -> None:
    """An encoder that reads 0 at the stop has the flows of the chamber's volume in the middle."""
    trial = Bench(VALVE_A, "a").trial(1, "1")
    held = changed(trial, theta_rad=np.full(len(trial), share * END_RAD))
    notices = fit_quickly([held], rig).notices
    assert any("away from both ends" in notice for notice in notices) is is_said


def test_both_valves_switched_in_the_same_test(rig: Rig) -> None:
    """Chamber B is then the small one: its volume follows from the angle."""
    trial = Bench(VALVE_A, "a").trial(1)
    at_zero = changed(trial, theta_rad=np.full(len(trial), END_RAD))
    small = (0.075 - 0.127 / 2.0) * 4.207e-4
    large = (0.075 + 0.127 / 2.0) * 4.207e-4
    share = small / large
    scaled = {n: getattr(VALVE_B, n) / share for n in FLOWS}
    b = Bench(dataclasses.replace(VALVE_B, **scaled), "b", period=0.001).trial(2)
    both = changed(at_zero, valve_b=b["valve_b"], pressure_b_pa=b["pressure_b_pa"])
    result = fit_quickly([both], rig)
    assert_recovered(result.valves["a"], VALVE_A)
    assert abs(errors(result.valves["b"], VALVE_B)["c_dis"]) < 0.02


def test_valve_overrules(rig: Rig) -> None:
    trials = [Bench(VALVE_A, "a").trial(1, "1"), Bench(VALVE_B, "b").trial(2, "2")]
    assert list(fit_quickly(trials, rig, valve="b").valves) == ["b"]
    with pytest.raises(InputError, match="neither a nor b"):
        fit_quickly(trials, rig, valve="c")


def test_scatter_between_tests_widens_the_interval(rig: Rig) -> None:
    factors = (0.96, 1.0, 1.05)
    trials = [
        Bench(dataclasses.replace(VALVE_A, c_dis=f * VALVE_A.c_dis)).trial(i, str(i))
        for i, f in enumerate(factors)
    ]
    result = fit_quickly(trials, rig)
    fit = result.valves["a"]
    assert any("c_dis differs between tests" in n for n in result.notices)
    assert fit["c_dis"].holds(VALVE_A.c_dis)
    assert fit["c_dis"].std / fit["c_dis"].value == pytest.approx(0.026, rel=0.4)
    assert fit["c_fill"].std / fit["c_fill"].value < 0.003


def test_stretches_alone_come_near(rig: Rig) -> None:
    """The thesis' own reading (3.5.3) is within some percent of the whole curve's."""
    fit = fit_quickly(Bench().trials(5), rig).valves["a"]
    for name in FLOWS:
        assert fit.stretches[name] == pytest.approx(getattr(VALVE_A, name), rel=0.05)


def test_bundle_part_is_json_and_complete(rig: Rig) -> None:
    valves = fit_valve_discrete(Bench().trials(6, 1), rig).part().valves
    assert valves is not None
    part = valves.to_json()["a"]["discrete"]
    assert json.loads(json.dumps(part, allow_nan=False)) == part
    units = {"c_fill": "kg/(s Pa^0.5)", "c_dis": "kg/(s Pa)", "choked_flow_fill_kg_s": "kg/s"}
    for name, unit in units.items():
        assert part[name]["unit"] == unit
        low, high = part[name]["interval"]
        assert low < part[name]["value"] < high


@pytest.mark.parametrize("period", [0.0005, 0.002, 0.005])
def test_other_sampling_periods(period: float, rig: Rig) -> None:
    fit = fit_quickly(Bench(period=period).trials(8), rig).valves["a"]
    assert_recovered(fit, VALVE_A)


@pytest.mark.parametrize("valve", [VALVE_A, VALVE_B])
@pytest.mark.parametrize("period", [0.02, 0.05])
def test_a_choked_flow_with_too_few_samples_bends_no_other(
    valve: DiscreteValve, period: float, rig: Rig
) -> None:
    """Two samples, or none, of the choked filling: held at a guess, c_fill was 5 to 17 % high."""
    fit = fit_quickly(Bench(valve, period=period).trials(8), rig).valves["a"]
    assert "fewer than 3 samples" in str(fit["choked_flow_fill_kg_s"].reason)
    for name in ("c_fill", "c_dis"):
        assert fit[name].value == pytest.approx(getattr(valve, name), rel=0.006)
        assert fit[name].interval[0] < getattr(valve, name) < fit[name].interval[1]


def test_the_critical_ratio_is_that_of_the_deepest_valley(rig: Rig) -> None:
    """The profile of a law that jumps has a second, shallower minimum near 0.46."""
    fit = fit_valve_discrete(Bench(VALVE_B, period=0.02).trials(2, 2), rig).valves["a"]
    low, high = fit["critical_ratio_dis"].interval
    assert low < CRITICAL_RATIO < high and high - low < 0.02


def test_a_profile_whose_sums_depend_on_the_fits_before_has_a_ratio_all_the_same(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fit begins where the nearest one ended: made again it ends elsewhere, here ever higher."""
    calls = itertools.count()

    def drifting(*arguments: Any) -> CurveFit:
        found = fit_curves(*arguments)
        higher = found.fit.residuals * (1.0 + 0.02 * next(calls))
        return dataclasses.replace(found, fit=dataclasses.replace(found.fit, residuals=higher))

    monkeypatch.setattr("sysid.identification.valve_discrete.ratio.fit_curves", drifting)
    fit = fit_valve_discrete(Bench(VALVE_B, period=0.02).trials(2, 2), rig).valves["a"]
    assert next(calls) > 51
    assert fit["critical_ratio_fill"].unit == "-"


def test_a_declared_delay_that_is_off_is_noticed(rig: Rig) -> None:
    slow = dataclasses.replace(VALVE_A, on_delay_s=0.0031)
    result = fit_quickly(Bench(slow).trials(9), rig)
    assert any("on_delay_s is 3." in n and "declares 1.7 ms" in n for n in result.notices)


# --- tests that cannot be used as they are -------------------------------------------------


def only_notice(result: ValveDiscreteResult, text: str) -> None:
    assert any(text in n for n in result.notices), result.notices


def test_supply_low_by_20_kpa_is_said_and_allowed_for(rig: Rig) -> None:
    low = SUPPLY - 20e3
    scaled = dataclasses.replace(
        VALVE_A, choked_flow_fill_kg_s=VALVE_A.choked_flow_fill_kg_s * low / SUPPLY
    )
    result = fit_quickly(Bench(scaled, supply=low).trials(1), rig)
    only_notice(result, "fills to 280")
    only_notice(result, "supply_pressure_pa is 300000 Pa")
    only_notice(result, "c_fill is fitted with the former")
    assert_recovered(result.valves["a"], VALVE_A)


def sagging(t: float) -> float:
    return SUPPLY if t < 2.5 else SUPPLY - 20e3


def test_supply_that_sags_while_the_valve_is_on(rig: Rig) -> None:
    trial, _ = fed(sagging)
    result = fit_quickly([trial], rig)
    only_notice(result, "the supply was unsteady")
    fit = result.valves["a"]
    for name in ("choked_flow_fill_kg_s", "c_fill", "on_delay_s"):
        assert not fit[name].identified
        assert "log supply_pressure_pa" in str(fit[name].reason)
    for name in ("choked_flow_dis_kg_s", "c_dis"):
        assert fit[name].value == pytest.approx(getattr(VALVE_A, name), rel=0.02)


def test_supply_that_recovers_while_the_valve_is_on(rig: Rig) -> None:
    trial, _ = fed(lambda t: SUPPLY - 20e3 if t < 2.5 else SUPPLY)
    result = fit_quickly([trial], rig)
    only_notice(result, "Pa and then rose to")
    assert not result.valves["a"]["c_fill"].identified


def test_a_supply_that_never_holds_still_is_in_the_tests_scatter(rig: Rig) -> None:
    """Pulsation in each of four tests: the rise is fitted, and the interval says how well."""
    trials = [
        fed(lambda t, phase=phase: SUPPLY + 12e3 * math.sin(4.0 * math.pi * t + phase))[0]
        for phase in (0.3, 1.9, 3.5, 5.0)
    ]
    trials = [
        dataclasses.replace(t, label=str(i), source=f"made, test {i}") for i, t in enumerate(trials)
    ]
    result = fit_quickly(trials, rig)
    only_notice(result, "its filling is fitted to its rise, at the declared supply")
    fit = result.valves["a"]
    for name in ("choked_flow_fill_kg_s", "c_fill"):
        low, high = fit[name].interval
        truth = getattr(VALVE_A, name)
        assert low < truth < high and high - low > 0.01 * truth
        assert fit[name].value == pytest.approx(truth, rel=0.1)
    few = fit_quickly(trials[:2], rig).valves["a"]
    assert not few["c_fill"].identified


def test_a_supply_that_drifts_in_every_test_spoils_no_discharge(rig: Rig) -> None:
    """After the cut the chamber stands at the supply of that moment, 13 kPa below the declared."""
    trial, _ = fed(lambda t: SUPPLY - 20e3 * t / 6.0)
    trials = [dataclasses.replace(trial, label=str(i), source=f"made, test {i}") for i in range(3)]
    result = fit_quickly(trials, rig)
    only_notice(result, "its filling is fitted to its rise, at the declared supply")
    fit = result.valves["a"]
    for name in ("choked_flow_dis_kg_s", "c_dis"):
        assert fit[name].value == pytest.approx(getattr(VALVE_A, name), rel=0.002)
    assert fit["off_delay_s"].value == pytest.approx(VALVE_A.off_delay_s, abs=0.3e-3)
    assert not any("misses the discharge" in n for n in result.notices)


def test_a_supply_that_moves_as_the_valve_closes_moves_no_delay(rig: Rig) -> None:
    """A compressor's strokes: the supply falls by 3 kPa in the last 50 ms before the discharge."""
    trials = []
    for i, phase in enumerate((0.1, 0.35, 0.6, 0.8)):
        one, _ = fed(lambda t, phase=phase: SUPPLY + 12e3 * (1.0 - 2.0 * ((2.5 * t + phase) % 1.0)))
        trials.append(dataclasses.replace(one, label=str(i), source=f"made, test {i}"))
    delay = fit_quickly(trials, rig).valves["a"]["off_delay_s"]
    assert delay.value == pytest.approx(VALVE_A.off_delay_s, abs=0.25e-3)
    assert delay.holds(VALVE_A.off_delay_s)


def test_slow_logging_makes_no_late_command(rig: Rig) -> None:
    """A command is seen at the row after it, up to 12 ms late here."""
    thin = [
        Trial(t.label, t.time[::12], {n: v[::12] for n, v in t.channels.items()}, t.source)
        for t in Bench().trials(1, 2)
    ]
    fit = fit_quickly(thin, rig).valves["a"]
    for name in DELAYS:
        assert not fit[name].identified
        assert "to a row of 12 ms only" in str(fit[name].reason)


def test_a_pressure_that_answers_before_the_command_gives_no_delay(rig: Rig) -> None:
    trials = Bench().trials(1, 2)
    late = [changed(t, valve_a=np.roll(t["valve_a"], 5)) for t in trials]
    fit = fit_quickly(late, rig).valves["a"]
    for name in DELAYS:
        assert not fit[name].identified
        assert "responds before the command" in str(fit[name].reason)
    for name in FLOWS:
        assert fit[name].value == pytest.approx(getattr(VALVE_A, name), rel=0.01)


def test_a_sag_that_is_logged_is_allowed_for(rig: Rig) -> None:
    trial, supply = fed(sagging)
    noisy = sensed(supply, np.random.default_rng(2))
    result = fit_quickly([changed(trial, supply_pressure_pa=noisy)], rig)
    assert_recovered(result.valves["a"], VALVE_A)


def test_a_supply_that_droops_with_the_flow_is_a_misfit(rig: Rig) -> None:
    trial, _ = fed(lambda t: SUPPLY - 20e3 * float(np.exp(-max(t - 1.0, 0.0) / 0.15)))
    result = fit_quickly([trial], rig)
    only_notice(result, "the two-regime law misses the filling")
    assert not any("misses the discharge" in n for n in result.notices)


def test_a_misfit_over_few_rows_a_test_is_judged_over_all_tests(rig: Rig) -> None:
    trial, _ = fed(lambda t: SUPPLY - 40e3 * math.exp(-max(t - 1.0, 0.0) / 0.15) * (t > 1.0))
    time = trial.time[::25]
    thin = {n: v[::25] for n, v in trial.channels.items()}
    trials = [Trial(str(i), time, thin, f"made, test {i}") for i in range(4)]
    result = fit_quickly(trials, rig)
    only_notice(result, "4 tests together: the two-regime law misses the filling")
    healthy = fit_quickly(Bench(period=0.025).trials(3, 4), rig)
    assert not any("misses" in n for n in healthy.notices), healthy.notices


def test_no_misfit_is_said_of_flows_that_are_not_fitted(rig: Rig) -> None:
    """A discharge in three rows a test; its flows are held at guesses."""
    fast = dataclasses.replace(VALVE_A, choked_flow_dis_kg_s=1.0e-3, c_dis=1.0e-8)
    result = fit_quickly(Bench(fast, period=0.05).trials(1, 12), rig)
    assert not {"choked_flow_dis_kg_s", "c_dis"} & {
        n for n, e in result.valves["a"].estimates.items() if e.identified
    }
    assert not any("misses the discharge" in n for n in result.notices), result.notices


def test_piston_that_moved(rig: Rig) -> None:
    trials = Bench().trials(1)
    moved = trials[0]["theta_rad"].copy()
    moved[1200:] -= 0.05
    one_bad = [changed(trials[0], theta_rad=moved), *trials[1:]]
    result = fit_quickly(one_bad, rig)
    only_notice(result, "the piston moved")
    assert_recovered(result.valves["a"], VALVE_A)
    with pytest.raises(NotIdentifiedError, match=r"c_fill.*piston moved.*hold it at an end"):
        fit_quickly(one_bad[:1], rig)


def test_a_potentiometer_s_noise_is_no_motion_of_the_piston(rig: Rig) -> None:
    rng, trials = np.random.default_rng(2), Bench().trials(2)
    noisy = [
        changed(t, theta_rad=t["theta_rad"] + 4e-3 * rng.standard_normal(len(t.time)))
        for t in trials
    ]
    result = fit_quickly(noisy, rig)
    assert not any("the piston moved" in n for n in result.notices), result.notices
    assert_recovered(result.valves["a"], VALVE_A)


def test_pressure_clipped_below_the_supply(rig: Rig) -> None:
    trials = [
        changed(t, pressure_a_pa=np.minimum(t["pressure_a_pa"], 260000.0))
        for t in Bench().trials(1)
    ]
    result = fit_quickly(trials, rig)
    only_notice(result, "saturated (flat-topped at 260000 Pa")
    fit = result.valves["a"]
    assert not fit["off_delay_s"].identified
    why = "no usable row lies right before switching off, where the sensor is saturated"
    assert fit["off_delay_s"].reason == why
    found = errors(fit, VALVE_A)
    assert max(abs(found[n]) for n in FLOWS) < 0.02


@pytest.mark.parametrize("count", [10.0, 2000.0])
def test_a_plateau_of_few_rows_is_named_as_a_saturated_sensor(rig: Rig, count: float) -> None:
    """Some 20 rows at the sensor's end: noise repeats no reading so often, on a coarse count the
    pressure stops at its full speed."""
    bench = Bench(period=0.005, off=1.18)
    trials = [
        changed(t, pressure_a_pa=np.minimum(count * np.round(t["pressure_a_pa"] / count), 240000.0))
        for t in bench.trials(1)
    ]
    result = fit_quickly(trials, rig)
    assert sum("saturated (flat-topped at 240000 Pa" in n for n in result.notices) == len(trials)
    assert not any("does not settle" in n for n in result.notices), result.notices
    fit = result.valves["a"]
    assert fit["choked_flow_fill_kg_s"].value == pytest.approx(7.8e-4, rel=0.03)
    assert not fit["off_delay_s"].identified


@pytest.mark.parametrize("count", [0.0, 200.0, 4000.0])
@pytest.mark.parametrize("noise", [0.0, 100.0])
def test_a_pressure_that_settles_is_not_saturated(count: float, noise: float) -> None:
    """As an exponential, and as a parabola, whose end is at a finite time."""
    time = np.arange(0.0, 2.0, 0.002)
    rng = np.random.default_rng(1)
    for share in (1.0 - np.exp(-time / 0.1), 1.0 - np.maximum(1.0 - time / 0.4, 0.0) ** 2):
        for end, is_cut in ((6e5, False), (3e5, True)):
            shown = 1e5 + 5e5 * np.concatenate([np.zeros(100), share])
            shown += noise * rng.standard_normal(len(shown))
            shown = count * np.round(shown / count) if count else shown
            shown = np.minimum(shown, end) if is_cut else shown
            run = signals.longest_run(shown == shown.max())
            low = signals.longest_run(np.diff(shown[shown < np.mean(shown)]) == 0.0)
            floor = signals.noise_floor(shown)
            assert signals.is_cut_off(shown, run, floor, low[1] - low[0] + 1) == is_cut


def test_a_command_whose_rows_are_lost_may_have_come_earlier(rig: Rig) -> None:
    """Of a row lost at the switching off; the delay was 1 ms short of its 2 ms, and sure of it."""
    trials = []
    for whole in Bench().trials(2):
        edge = int(np.flatnonzero(np.diff(whole["valve_a"]) < 0.0)[0]) + 1
        kept = np.delete(np.arange(len(whole)), edge)
        channels = {name: values[kept] for name, values in whole.channels.items()}
        trials.append(Trial(whole.label, whole.time[kept], channels, whole.source))
    unsampled = dataclasses.replace(rig, sampling=None)
    result = fit_quickly(trials, unsampled)
    delay = result.valves["a"].estimates["off_delay_s"]
    assert delay.interval[0] < VALVE_A.off_delay_s < delay.interval[1] + 1e-4
    assert delay.interval[1] - delay.interval[0] > 0.00099
    said = "rows are missing before valve_a switches in 3 of 3 cases"
    assert sum(said in n for n in result.notices) == 1
    on = result.valves["a"].estimates["on_delay_s"]
    assert on.interval[1] - on.interval[0] < 5e-4


@pytest.mark.parametrize(("times", "fix"), [(1000, "its unit"), (60, '--map "time_s=time_s:min"')])
def test_a_time_of_another_unit_shows_in_the_delays(rig: Rig, times: int, fix: str) -> None:
    """Without a declared sampling period nothing else does: the flows are merely as wrong."""
    unsampled = dataclasses.replace(rig, sampling=None)
    trials = [Trial(t.label, t.time / times, t.channels, t.source) for t in Bench().trials(2)]
    result = fit_quickly(trials, unsampled)
    said = f"all delays are about {times} times too small for the rig file's: time_s is not in s"
    assert any(n.endswith(fix) for n in result.notices if said in n), result.notices
    assert sum(said in n for n in result.notices) == 1, result.notices
    assert not any("the rig file declares" in n for n in result.notices)
    assert all(q.verdict != "good" for q in result.valves["a"].quality.values())
    right = fit_quickly(Bench().trials(2), unsampled)
    assert not any("all delays" in n for n in right.notices), right.notices


def test_pressure_clipped_below_the_choked_boundary(rig: Rig) -> None:
    trials = [
        changed(t, pressure_a_pa=np.minimum(t["pressure_a_pa"], 150020.0))
        for t in Bench().trials(1)
    ]
    result = fit_quickly(trials, rig)
    fit = result.valves["a"]
    for name in ("c_fill", "choked_flow_dis_kg_s"):
        assert not fit[name].identified
    only_notice(result, "saturated")
    assert fit["choked_flow_fill_kg_s"].value == pytest.approx(7.8e-4, rel=0.02)
    assert fit["c_dis"].value == pytest.approx(3.7e-9, rel=0.02)


def test_filling_too_short_for_the_unchoked_stretch(rig: Rig) -> None:
    result = fit_quickly(Bench(off=1.035).trials(1), rig)
    fit = result.valves["a"]
    assert fit.law().to_json()["c_fill"] == {
        "value": None,
        "identified": False,
        "reason": fit["c_fill"].reason,
    }
    assert "never reaches the unchoked interval" in str(fit["c_fill"].reason)
    assert "hold the valve on longer" in str(fit["c_fill"].reason)
    assert "never choked" in str(fit["choked_flow_dis_kg_s"].reason)
    assert fit["choked_flow_fill_kg_s"].value == pytest.approx(7.8e-4, rel=0.02)
    assert fit["c_dis"].value == pytest.approx(3.7e-9, rel=0.03)
    only_notice(result, "valve A: c_fill is not identified")


def test_discharge_not_recorded(rig: Rig) -> None:
    result = fit_quickly(Bench(off=9.0, end=3.0).trials(1), rig)
    fit = result.valves["a"]
    for name in ("choked_flow_dis_kg_s", "c_dis", "off_delay_s"):
        assert not fit[name].identified
    assert fit["c_fill"].value == pytest.approx(VALVE_A.c_fill, rel=0.01)


def test_discharge_cut_short(rig: Rig) -> None:
    result = fit_quickly(Bench(off=2.5, end=2.53).trials(1), rig)
    fit = result.valves["a"]
    assert "record longer" in str(fit["c_dis"].reason)
    assert fit["choked_flow_dis_kg_s"].value == pytest.approx(3.5e-4, rel=0.02)


def test_valve_on_from_the_first_row(rig: Rig) -> None:
    trial = Bench().trial(1)
    late = slice(2500, None)
    cut = Trial("1", trial.time[late], {k: v[late] for k, v in trial.channels.items()}, "made")
    result = fit_quickly([cut], rig)
    only_notice(result, "is on in the first row")
    fit = result.valves["a"]
    for name in ("choked_flow_fill_kg_s", "c_fill", "on_delay_s"):
        assert "already filled in the first row" in str(fit[name].reason)
    assert fit["c_dis"].value == pytest.approx(3.7e-9, rel=0.01)


def test_no_edge_at_all(rig: Rig) -> None:
    trial = Bench().trial(1)
    idle = changed(trial, valve_a=np.zeros(len(trial)))
    with pytest.raises(NotIdentifiedError, match="no test switches a valve on"):
        fit_quickly([idle], rig)
    with pytest.raises(NotIdentifiedError, match="valve B: no test switches it on"):
        fit_quickly([trial], rig, valve="b")
    with pytest.raises(NotIdentifiedError, match="no test given"):
        fit_quickly([], rig)


def test_pressure_that_does_not_follow_the_valve(rig: Rig) -> None:
    trial = Bench().trial(1)
    swapped = changed(
        trial, pressure_a_pa=trial["pressure_b_pa"], pressure_b_pa=trial["pressure_a_pa"]
    )
    with pytest.raises(NotIdentifiedError, match="another chamber's sensor"):
        fit_quickly([swapped], rig)


@pytest.mark.parametrize("name", ["pressure_a_pa", "theta_rad", "valve"])
def test_missing_channels(name: str, rig: Rig) -> None:
    trial = Bench().trial(1)
    kept = {k: v for k, v in trial.channels.items() if not k.startswith(name)}
    with pytest.raises(InputError, match=name):
        fit_quickly([dataclasses.replace(trial, channels=kept)], rig)


@pytest.mark.parametrize("name", ["rig-1", "rig-2"])
def test_sample_campaigns(name: str, shared_samples: Path) -> None:
    """Logs of another generator: noise-limited fits, delays as declared, 0.53 confirmed."""
    folder = shared_samples / name
    rig = read_rig(folder / "rig.toml")
    trials = [t for v in "ab" for t in read_log(folder / f"valve_discrete_{v}.csv", rig).trials]
    result = fit_valve_discrete(trials, rig)
    for fit in result.valves.values():
        assert fit.rmse < 1.05 * fit.noise
        assert fit["on_delay_s"].value == pytest.approx(0.0017, abs=1e-4)
        assert fit["off_delay_s"].value == pytest.approx(0.0020, abs=1e-4)
        for ratio in ("critical_ratio_fill", "critical_ratio_dis"):
            assert fit[ratio].value == pytest.approx(CRITICAL_RATIO, abs=0.02)
