"""PWM valves: samples of mean flow against the exact law, surfaces, and logs that lack something.

The tests are simulated here, by code that shares nothing with the package: the chamber of the
reference rig (thesis 3.5) under pulses whose edges fall within the integration steps exactly.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from conftest import RIG_TEXT

from sysid.blocks.figures import Words
from sysid.checks.identifiability import valves_identified
from sysid.errors import InputError, NotIdentifiedError
from sysid.identification.valve_pwm.coverage import duty_gaps, off_surface_tests
from sysid.identification.valve_pwm.remarks import Remarks
from sysid.identification.valve_pwm.samples import (
    FlowSamples,
    open_share,
    pulse_block,
    sample_tests,
)
from sysid.identification.valve_pwm.selection import select_tests
from sysid.identification.valve_pwm.shown import flow_figure
from sysid.io.logs import Trial, with_channels
from sysid.io.rig import HELD_SHARE, Rig, Sensors, rig_from_content
from sysid.surfaces import surface_from_dict
from sysid.surfaces.domain import LevelFlows
from sysid.valve_pwm import ValvePwmFit, fit_valve_pwm

P0, SUPPLY = 1.0e5, 3.0e5
ON, OFF = 0.0017, 0.0020
GAS = 287.0 * 293.15
THETA = 1.69
# Choked filling and exhaust (kg/s), c_fill, c_dis: the thesis' Table 3.6.1.
VALVES = {"a": (7.8e-4, 3.5e-4, 1.5e-6, 3.7e-9), "b": (1.3e-3, 3.9e-4, 1.5e-6, 3.7e-9)}
NOISE = 150.0
COUNT = 26.0
FEED = 1e-7  # kg/(s Pa), of what keeps a vessel next to the valve at the supply
DUTIES = tuple(np.round(np.arange(0.02, 0.99, 0.04), 2))


def make_rig(pwm_hz: float = 200.0, size: float = 1.0) -> Rig:
    """`size`: of the chambers, next to the reference rig's."""
    content = tomllib.loads(RIG_TEXT)
    content["cylinder"] |= {k: size * content["cylinder"][k] for k in ("area_a_m2", "area_b_m2")}
    content["pwm"]["period_s"] = round(1.0 / pwm_hz, 12)
    return rig_from_content(content, "rig.toml")


def volume(valve: str, theta: Any) -> Any:
    y = 0.0375 * theta
    return (0.075 + y) * 4.524e-4 if valve == "a" else (0.075 - y) * 4.207e-4


def law(
    valve: str, pressure: np.ndarray, supply: float | np.ndarray = SUPPLY
) -> tuple[np.ndarray, np.ndarray]:
    """Flow into the chamber with the valve open and closed, kg/s (3.6.6, 3.6.10)."""
    choked_fill, choked_dis, c_fill, c_dis = VALVES[valve]
    gap = np.sign(supply - pressure) * np.sqrt(np.abs(supply - pressure))
    fill = np.where(pressure <= 0.53 * supply, choked_fill * supply / SUPPLY, c_fill * gap)
    exhaust = np.where(pressure >= P0 / 0.53, -choked_dis, c_dis * (P0 - pressure))
    return fill, exhaust


@lru_cache(maxsize=64)
def chamber(
    valve: str,
    filling: bool,
    pwm_hz: float,
    supply: float,
    duration: float,
    size: float,
    vessel: float = math.inf,
) -> tuple[np.ndarray, np.ndarray]:
    """Pressures of chamber and line (n, DUTIES) at 1 kHz, without noise.

    `vessel`: volume of the line, m3, which FEED fills to `supply`.
    """
    h, period, duty = 1e-4, 1.0 / pwm_hz, np.array(DUTIES)
    pressure = np.full(len(duty), P0 if filling else supply)
    line = np.full(len(duty), supply)
    factor = 1.4 * GAS / (size * volume(valve, THETA if valve == "a" else -THETA))
    rows = []
    for step in range(round(duration / h)):
        t = step * h
        if step % 10 == 0:
            rows.append((pressure, line))
        opened = np.zeros(len(duty))
        for k in range(int(t / period) - 2, int(t / period) + 1):
            if k < 0 and filling:
                continue
            begin = k * period + ON if k > 0 or filling else -1.0
            end = max(k, 0) * period + duty * period + OFF if k >= 0 else np.full(len(duty), -1.0)
            opened += np.clip(np.minimum(end, t + h) - max(begin, t), 0.0, h)
        share = np.minimum(opened / h, 1.0)
        fill, exhaust = law(valve, pressure, line)
        pressure = pressure + h * factor * (share * fill + (1.0 - share) * exhaust)
        line = line + h * 1.4 * GAS / vessel * (FEED * (supply - line) - share * fill)
    pressures, lines = np.array(rows).swapaxes(0, 1)
    return pressures, lines


def make_trials(
    valve: str = "a",
    pwm_hz: float = 200.0,
    supply: float = SUPPLY,
    duration: float = 0.8,
    noise: float = NOISE,
    seed: int = 1,
    directions: Sequence[str] = ("fill", "dis"),
    size: float = 1.0,
    vessel: float = math.inf,
) -> list[Trial]:
    """`vessel`: of the line, whose pressure is logged if it is finite."""
    rng = np.random.default_rng(seed)
    trials = []
    for direction in directions:
        exact, line = chamber(valve, direction == "fill", pwm_hz, supply, duration, size, vessel)
        n = len(exact)
        for i, duty in enumerate(DUTIES):
            measured = exact[:, i] + noise * rng.standard_normal(n)
            other = P0 + noise * rng.standard_normal(n)
            names = ("a", "b") if valve == "a" else ("b", "a")
            label = f"{direction}-{duty:.2f}"
            trials.append(
                Trial(
                    label,
                    0.001 * np.arange(n),
                    {
                        f"duty_{names[0]}": np.full(n, duty),
                        f"duty_{names[1]}": np.zeros(n),
                        f"pressure_{names[0]}_pa": COUNT * np.round(measured / COUNT),
                        f"pressure_{names[1]}_pa": COUNT * np.round(other / COUNT),
                        "theta_rad": np.full(n, THETA if valve == "a" else -THETA),
                    }
                    | ({"supply_pressure_pa": line[:, i]} if math.isfinite(vessel) else {}),
                    f"log.csv, test {label}",
                )
            )
    return trials


def changed(
    trials: Sequence[Trial],
    which: Callable[[Trial], bool],
    change: Callable[[Trial], Trial],
) -> list[Trial]:
    return [change(t) if which(t) else t for t in trials]


def samples_of(trials: Sequence[Trial], rig: Rig, valve: str, filling: bool) -> FlowSamples:
    remarks = Remarks()
    tests = [t for t in select_tests(trials, rig, valve, remarks) if t.filling == filling]
    assert not remarks.notices()
    return sample_tests(tests, rig)


def bundled(fit: ValvePwmFit) -> dict[str, Any]:
    """The bundle's `valves`, as its file holds them."""
    valves = fit.part().valves
    assert valves is not None
    return valves.to_json()


def one_line(fit: ValvePwmFit, *words: str) -> str:
    """The one notice that holds all the words."""
    found = [n for n in fit.notices if all(w in n for w in words)]
    assert len(found) == 1, (words, fit.notices)
    return found[0]


# --- samples of mean flow ----------------------------------------------------------------


@pytest.mark.parametrize(
    ("pwm_hz", "rate_hz", "samples"),
    [(200, 1000, 5), (250, 1000, 4), (300, 1000, 10), (200, 200, 1), (200, 100, 1), (40, 1000, 25)],
)
def test_a_block_of_samples_is_whole_pwm_periods(
    pwm_hz: float, rate_hz: float, samples: int
) -> None:
    assert pulse_block(round(1.0 / pwm_hz, 12), 1.0 / rate_hz) == samples


@pytest.mark.parametrize("pwm_hz", [200.0, 250.0, 300.0])
@pytest.mark.parametrize("valve", ["a", "b"])
@pytest.mark.parametrize("filling", [True, False])
def test_samples_are_the_exact_mean_flow(pwm_hz: float, valve: str, filling: bool) -> None:
    rig = make_rig(pwm_hz)
    trials = make_trials(valve, pwm_hz, directions=("fill",) if filling else ("dis",))
    s = samples_of(trials, rig, valve, filling)
    assert len(s) > 150
    share = np.clip(s.duty + (OFF - ON) * pwm_hz, 0.0, 1.0)
    assert share == pytest.approx([open_share(u, rig) for u in s.duty])
    fill, exhaust = law(valve, s.pressure)
    error = (s.flow - share * fill - (1.0 - share) * exhaust) / (fill - exhaust)
    # Where the ripple crosses a choked boundary the mean flow is not the law at the mean.
    clear = (np.abs(s.pressure - 0.53 * SUPPLY) > 6e3) & (np.abs(s.pressure - P0 / 0.53) > 6e3)
    clear &= SUPPLY - s.pressure > 2e3
    assert clear.mean() > 0.4
    assert np.sqrt(np.mean(error[clear] ** 2)) < 0.010
    assert abs(np.mean(error[clear])) < 0.0012
    covered = pressures_covered(s)
    assert covered[1] > 0.97 * SUPPLY
    assert covered[0] < (1.3 if filling else 1.5) * P0


def pressures_covered(s: FlowSamples) -> tuple[float, float]:
    return float(s.pressure.min()), float(s.pressure.max())


@pytest.mark.parametrize("pwm_hz", [200.0, 300.0])
def test_standard_errors_are_the_scatter_over_repeated_noise(pwm_hz: float) -> None:
    rig = make_rig(pwm_hz)
    # A pulsed ramp whose mean slope is known.
    n, slope, ripple = 90, 1.0e5, 1500.0
    time = 0.001 * np.arange(n)
    saw = ripple * np.mod(time * pwm_hz, 1.0)
    trials = []
    for seed in range(150):
        noise = NOISE * np.random.default_rng(seed).standard_normal(n)
        channels = {
            "duty_a": np.full(n, 0.3),
            "pressure_a_pa": P0 + slope * time + saw + noise,
            "theta_rad": np.full(n, THETA),
        }
        trials.append(Trial(str(seed), time, channels, f"log.csv, test {seed}"))
    s = samples_of(trials, rig, "a", True)
    z = (s.flow - slope * volume("a", THETA) / (1.4 * GAS)) / s.std
    assert len(z) >= 150
    assert np.std(z) == pytest.approx(1.0, abs=0.15)
    assert abs(np.mean(z)) < 4.0 / np.sqrt(len(z))


def test_the_volume_follows_from_the_logged_angle() -> None:
    rig = make_rig()
    trials = make_trials(directions=("fill",))
    here = samples_of(trials, rig, "a", True)
    moved = [with_channels(t, theta_rad=np.full(len(t), 0.0)) for t in trials]
    centre = samples_of(moved, rig, "a", True)
    assert centre.flow / here.flow == pytest.approx(volume("a", 0.0) / volume("a", THETA))


def test_lost_samples_and_uneven_time_do_not_bend_the_flow() -> None:
    rig = make_rig()
    trials = make_trials(directions=("fill",))
    whole = samples_of(trials, rig, "a", True)
    lost = np.delete(np.arange(len(trials[0])), slice(30, 42))
    cut = [
        Trial(t.label, t.time[lost], {k: v[lost] for k, v in t.channels.items()}, t.source)
        for t in trials
    ]
    remarks = Remarks()
    s = sample_tests(select_tests(cut, rig, "a", remarks), rig)
    assert "lost samples" in remarks.notices()[0]
    choked = [f.flow[(f.pressure < 0.5 * SUPPLY) & (f.duty > 0.9)] for f in (whole, s)]
    assert np.mean(choked[1]) == pytest.approx(np.mean(choked[0]), rel=0.01)
    assert len(s) < len(whole)


def thinned(share: float) -> list[Trial]:
    """The trials without a random rest of their rows."""
    rng = np.random.default_rng(4)
    trials = []
    for t in make_trials():
        kept = rng.random(len(t)) < share
        kept[[0, -1]] = True
        channels = {name: values[kept] for name, values in t.channels.items()}
        trials.append(Trial(t.label, t.time[kept], channels, t.source))
    return trials


def test_gaps_shorter_than_half_a_pulse_period_are_bridged() -> None:
    found = fit_valve_pwm(thinned(0.6), make_rig()).averaged["a"].fit.estimates
    for name, value in zip(
        ("choked_flow_fill_kg_s", "choked_flow_dis_kg_s", "c_fill", "c_dis"),
        VALVES["a"],
        strict=True,
    ):
        assert found[name].value == pytest.approx(value, rel=0.02)


def test_chambers_that_fill_in_a_few_periods() -> None:
    """A pulse moves their pressure far: no formula of a mean over it, or a window, holds."""
    found = fit_valve_pwm(make_trials(size=0.1, duration=0.4), make_rig(size=0.1)).averaged["a"]
    names = ("choked_flow_fill_kg_s", "choked_flow_dis_kg_s", "c_fill", "c_dis")
    for name, value in zip(names, VALVES["a"], strict=True):
        assert found.fit.estimates[name].value == pytest.approx(value, rel=0.01), name
    assert found.fit.estimates["delay_difference_s"].value == pytest.approx(OFF - ON, abs=1e-5)


def test_lost_rows_not_short_tests_are_named_where_few_means_are_left() -> None:
    with pytest.raises(NotIdentifiedError, match="rows are missing or excluded") as failure:
        fit_valve_pwm(thinned(0.4), make_rig())
    assert "record longer" not in str(failure.value)


# --- surfaces ----------------------------------------------------------------------------


def test_a_fit_holds_both_directions_and_its_bundle_reads_back() -> None:
    rig = make_rig()
    fit = fit_valve_pwm([*make_trials("a"), *make_trials("b")], rig)
    assert set(fit.fits) == {(v, d) for v in "ab" for d in ("fill", "discharge")}
    valves = json.loads(json.dumps(bundled(fit), allow_nan=False))
    for (valve, direction), part in fit.fits.items():
        content = valves[valve]["pwm"][direction]["bipolynomial"]
        assert len(content["coefficients"]) == 9
        assert all({"value", "std", "unit", "interval"} <= set(c) for c in content["coefficients"])
        assert content["rmse_duty"] < 0.12
        assert content["max_relative_error_duty_percent"] > 0.0
        assert content["domain"]["duty"][0] == pytest.approx(0.02)
        surface = surface_from_dict(content)
        pressure = np.linspace(1.2e5, 2.9e5, 9)
        assert part.bipolynomial is not None
        want = part.bipolynomial.flow(0.3, pressure)[0]
        assert surface.flow(0.3, pressure)[0] == pytest.approx(want)
        fill, exhaust = law(valve, pressure)
        truth = open_share(0.3, rig) * fill + (1 - open_share(0.3, rig)) * exhaust
        assert np.abs(want - truth).max() < 0.25 * (fill - exhaust).max()
    study = fit.fits["a", "fill"].resolution
    assert study is not None and study.max_flow[0] == pytest.approx(VALVES["a"][0], rel=0.05)


def test_the_largest_flow_of_each_duty_step_is_of_the_tests_it_keeps() -> None:
    study = fit_valve_pwm(make_trials("a"), make_rig()).fits["a", "fill"].resolution
    assert study is not None
    assert study.steps[0] == pytest.approx(0.04)
    assert study.tests[0] == len(DUTIES)
    assert study.tests[1] == (len(DUTIES) + 1) // 2


def test_the_network_is_nearer_the_valve_than_nine_terms() -> None:
    fit = fit_valve_pwm(make_trials("a", directions=("fill",)), make_rig(), surface="both", seed=3)
    part = fit.fits["a", "fill"]
    assert part.comparison is not None and part.network is not None
    assert part.comparison.network.rmse < 0.4 * part.comparison.bipolynomial.rmse
    assert part.comparison.network.rmse < 0.025
    assert bundled(fit)["a"]["pwm"]["fill"]["ann"]["training"]["seed"] == 3
    assert "of the two surfaces ann" in fit.remarks[0]
    assert not bundled(fit)["a"]["pwm"]["discharge"]["identified"]
    assert "not identified: valve A, discharging" in " ".join(fit.notices)


def test_the_same_seed_gives_the_same_network() -> None:
    trials = make_trials("b", directions=("dis",))
    first, second = (fit_valve_pwm(trials, make_rig(), surface="ann", seed=7) for _ in range(2))
    assert bundled(first) == bundled(second)


def test_a_grid_of_duties_that_is_shifted_in_the_other_direction_has_no_gaps() -> None:
    filling = np.linspace(0.05, 1.0, 19)
    discharging = 1.0 - filling
    assert duty_gaps(filling, discharging) == duty_gaps(discharging, filling) == []
    assert duty_gaps([0.1, 0.2, 0.3, 0.4], [0.15, 0.25, 0.35, 0.45]) == []


# --- which valve, which tests ------------------------------------------------------------


def test_the_valve_is_told_by_what_moves_and_can_be_named() -> None:
    rig = make_rig()
    trials = make_trials("b")
    assert {v for v, _ in fit_valve_pwm(trials, rig).fits} == {"b"}
    both = [*trials, *make_trials("a")]
    assert {v for v, _ in fit_valve_pwm(both, rig, valve="a").fits} == {"a"}
    with pytest.raises(NotIdentifiedError, match="duty_a never leaves zero"):
        fit_valve_pwm(trials, rig, valve="a")


def test_a_log_without_any_duty_identifies_nothing() -> None:
    idle = [
        with_channels(t, duty_a=np.zeros(len(t)), duty_b=np.zeros(len(t))) for t in make_trials()
    ]
    with pytest.raises(NotIdentifiedError, match="one constant duty per test"):
        fit_valve_pwm(idle, make_rig())


def test_a_duty_that_varies_is_left_out_with_a_notice() -> None:
    def ramp(t: Trial) -> Trial:
        return with_channels(t, duty_a=np.linspace(0.1, 0.9, len(t)))

    trials = changed(make_trials(), lambda t: t.label == "fill-0.50", ramp)
    fit = fit_valve_pwm(trials, make_rig())
    assert "fill-0.50" in one_line(fit, "not constant")
    assert "0.46 and 0.54" in one_line(fit, "filling", "no usable test between")


@pytest.mark.parametrize("missing", ["theta_rad", "pressure_a_pa"])
def test_a_missing_channel_is_named(missing: str) -> None:
    trials = [
        replace(t, channels={k: v for k, v in t.channels.items() if k != missing})
        for t in make_trials()
    ]
    with pytest.raises(InputError, match=missing):
        fit_valve_pwm(trials, make_rig())


def test_unknown_arguments_are_refused() -> None:
    with pytest.raises(InputError, match="bipolynomial"):
        fit_valve_pwm(make_trials(), make_rig(), surface="spline")
    with pytest.raises(InputError, match="use a or b"):
        fit_valve_pwm(make_trials(), make_rig(), valve="c")


# --- what a log can lack (each a notice or exit 3) ---------------------------------------


def test_a_whole_log_needs_no_notice_but_of_tests_that_rest_at_the_supply() -> None:
    for valve in "ab":
        fit = fit_valve_pwm(make_trials(valve), make_rig())
        assert all("stays within 1 %" in n or "domain ends there" in n for n in fit.notices)


def test_a_missing_duty_is_named_with_the_gap() -> None:
    trials = [t for t in make_trials() if t.label not in ("fill-0.30", "fill-0.34", "dis-0.98")]
    fit = fit_valve_pwm(trials, make_rig())
    line = one_line(fit, "filling", "between duties 0.26 and 0.38")
    assert "domain spans the gap" in line
    assert duty_gaps([0.1, 0.2, 0.3], [0.2, 0.25, 0.3]) == [(0.2, 0.3)]


def test_a_piston_that_moves_is_left_out_or_refused() -> None:
    def move(t: Trial) -> Trial:
        return with_channels(t, theta_rad=t["theta_rad"] - np.linspace(0.0, 0.4, len(t)))

    trials = changed(make_trials(), lambda t: t.label == "dis-0.30", move)
    assert "dis-0.30" in one_line(fit_valve_pwm(trials, make_rig()), "piston moved")
    everything = changed(make_trials(), lambda t: True, move)
    with pytest.raises(NotIdentifiedError, match="piston moved") as error:
        fit_valve_pwm(everything, make_rig())
    assert error.value.exit_code == 3


def test_a_potentiometer_s_noise_is_no_motion_of_the_piston() -> None:
    """It scatters over more than a held piston may move; a coarse encoder's count does, too."""
    rng = np.random.default_rng(4)
    rig = make_rig()
    trials = [
        with_channels(t, theta_rad=t["theta_rad"] + 5e-3 * rng.standard_normal(len(t)))
        for t in make_trials()
    ]
    volumes = volume("a", trials[0]["theta_rad"])
    assert np.ptp(volumes) > HELD_SHARE * np.mean(volumes)
    assert {t.label for t in select_tests(trials, rig, "a", Remarks())} == {
        t.label for t in select_tests(make_trials(), rig, "a", Remarks())
    }
    coarse = replace(rig, sensors=Sensors(encoder_counts_per_rev=200))
    ticks = [
        with_channels(t, theta_rad=t["theta_rad"] + np.pi / 100.0 * (np.arange(len(t)) > 300))
        for t in make_trials()
    ]
    assert len(select_tests(ticks, coarse, "a", Remarks())) == len(trials)
    remarks = Remarks()
    assert not select_tests(ticks, rig, "a", remarks)
    assert "the piston moved" in remarks.notices()[0]


def test_where_a_direction_begins_is_not_asked_for() -> None:
    """Tests that fill begin at the atmosphere: what is missing there are their rows."""

    def no_start(t: Trial) -> Trial:
        supply = np.where(t["pressure_a_pa"] < 0.6 * SUPPLY, 0.9 * SUPPLY, SUPPLY)
        return with_channels(t, supply_pressure_pa=supply)

    trials = changed(make_trials(), lambda t: t.label.startswith("fill"), no_start)
    fit = fit_valve_pwm(trials, make_rig())
    said = one_line(fit, "filling: choked filling", "cannot be identified")
    assert "tests begin there, but these rows are missing or excluded" in said
    assert "steady it" in one_line(fit, "supply_pressure_pa deviates")


def test_a_duty_that_a_controller_moves_is_none_of_a_surface() -> None:
    """Whose check counted its median for a duty of its own."""

    def moved(t: Trial) -> Trial:
        return with_channels(t, duty_a=t["duty_a"] + 1e-3 * np.sin(t.time))

    by_kind = {"valve-pwm": [moved(t) for t in make_trials()]}
    found = {one.parameter: one for one in valves_identified(by_kind, make_rig())}
    fills = found["valve A PWM surface, filling"]
    assert not fills.identified
    assert "0 duties (duty_a changes within 50 of 50)" in fills.reason


@pytest.mark.parametrize("direction", ["fill", "dis"])
def test_tests_in_one_direction_identify_the_averaged_law(direction: str) -> None:
    """At rest both flows balance; the other one was bounded by a thirtieth of what is seen."""
    fit = fit_valve_pwm(make_trials(directions=(direction,)), make_rig())
    names = ("choked_flow_fill_kg_s", "choked_flow_dis_kg_s", "c_fill", "c_dis")
    for name, true in zip(names, VALVES["a"], strict=True):
        assert fit.averaged["a"].estimates[name].value == pytest.approx(true, rel=0.03)


def test_a_supply_that_dips_with_the_pulses_costs_no_rows() -> None:
    """Its mean over a period is what a surface holds at, and each sample has its own supply."""
    trials = make_trials(pwm_hz=20.0, duration=2.0, size=5.0, vessel=4e-5)
    half = next(t for t in trials if t.label == "fill-0.50")["supply_pressure_pa"]
    assert np.count_nonzero(half < 0.98 * SUPPLY) > 150
    assert np.mean(half) > 0.98 * SUPPLY
    fit = fit_valve_pwm(trials, make_rig(20.0, 5.0))
    said = [n for n in fit.notices if "supply_pressure_pa deviates" in n]
    assert all("fill-0.50" not in n for n in said)
    names = ("choked_flow_fill_kg_s", "choked_flow_dis_kg_s", "c_fill", "c_dis")
    for name, true in zip(names, VALVES["a"], strict=True):
        assert fit.averaged["a"].estimates[name].value == pytest.approx(true, rel=3e-3)
    assert one_line(fit, "at the one that was logged")


def test_a_supply_that_sagged_throughout_is_refused() -> None:
    with pytest.raises(NotIdentifiedError, match=r"280 kPa, not the rig file's 300 kPa"):
        fit_valve_pwm(make_trials(supply=SUPPLY - 2e4, directions=("dis",)), make_rig())


def test_tests_under_a_sagged_supply_are_left_out() -> None:
    sagged = {t.label: t for t in make_trials(supply=SUPPLY - 2e4)}
    names = {"fill-0.62", "fill-0.98", "dis-0.30"}
    trials = [sagged[t.label] if t.label in names else t for t in make_trials()]
    fit = fit_valve_pwm(trials, make_rig())
    text = " ".join(n for n in fit.notices if "supply" in n)
    for name in names:
        assert name in text
    good = fit_valve_pwm([t for t in make_trials() if t.label not in names], make_rig())
    for key, part in fit.fits.items():
        assert part.samples.flow == pytest.approx(good.fits[key].samples.flow)


def test_a_supply_that_sagged_while_filling_is_found_by_its_plateau() -> None:
    fill = make_trials(supply=SUPPLY - 2e4, directions=("fill",))
    fit = fit_valve_pwm([*fill, *make_trials(directions=("dis",))], make_rig())
    text = " ".join(fit.notices)
    assert "filling" not in {d for _, d in fit.fits} and "280 kPa" in text
    assert "fill-0.98" in text and "most filling tests show another supply" in text


def test_a_logged_supply_decides_row_by_row() -> None:
    def log_supply(t: Trial) -> Trial:
        supply = np.full(len(t), SUPPLY)
        if t.label == "fill-0.50":
            supply[:] = SUPPLY - 2e4
        return with_channels(t, supply_pressure_pa=supply)

    fit = fit_valve_pwm([log_supply(t) for t in make_trials()], make_rig())
    assert "fill-0.50" in one_line(fit, "supply_pressure_pa deviates")
    assert not np.any(np.isclose(fit.fits["a", "fill"].samples.duty, 0.50))


@pytest.mark.parametrize("logged_off", [None, 0.0, -3e3], ids=["no log", "logged", "sensor offset"])
def test_a_supply_near_the_rig_files_is_taken_as_the_tests_show_it(
    logged_off: float | None,
) -> None:
    """Taken for the rig file's, a supply 1.7 % above it moved the averaged law by 30 to 300 %."""
    supply = SUPPLY + 5e3
    trials = make_trials(supply=supply)
    if logged_off is not None:
        trials = [
            with_channels(t, supply_pressure_pa=np.full(len(t), supply + logged_off))
            for t in trials
        ]
    fit = fit_valve_pwm(trials, make_rig())
    choked_fill, choked_dis, c_fill, c_dis = VALVES["a"]
    found = {name: e.value for name, e in fit.averaged["a"].fit.estimates.items()}
    assert found["choked_flow_fill_kg_s"] == pytest.approx(choked_fill, rel=0.01)
    assert found["choked_flow_dis_kg_s"] == pytest.approx(choked_dis, rel=0.01)
    assert found["c_fill"] == pytest.approx(c_fill, rel=0.01)
    assert found["c_dis"] == pytest.approx(c_dis, rel=0.01)
    assert found["delay_difference_s"] == pytest.approx(OFF - ON, abs=2e-5)
    assert fit.fits["a", "discharge"].domain.duty_range[1] < 0.8
    assert one_line(fit, "305.0 kPa", "rig file's supply_pressure_pa is 300.0 kPa")
    pwm = bundled(fit)["a"]["pwm"]
    # Surfaces hold at the supply of their tests; the law is scaled to the rig file's.
    assert pwm["fill"]["supply_pressure_pa"] == pytest.approx(supply, rel=1e-3)
    assert pwm["discharge"]["supply_pressure_pa"] == pytest.approx(supply, rel=1e-3)
    assert pwm["averaged"]["supply_pressure_pa"] == SUPPLY
    assert any("one of the two sensors" in n for n in fit.notices) == bool(logged_off)


def in_log(trials: Sequence[Trial], name: str) -> list[Trial]:
    return [replace(t, source=t.source.replace("log.csv", name)) for t in trials]


@pytest.mark.parametrize("split", ["logs", "directions", "directions of one log"])
def test_supplies_that_differ_between_logs_or_directions_are_taken_each(split: str) -> None:
    """One supply for the whole valve moved the law by 7 to 50 %."""
    low, high = make_trials(), make_trials(supply=SUPPLY + 5e3)
    parts = low[::2], high[1::2]
    if split != "logs":
        parts = low[: len(DUTIES)], high[len(DUTIES) :]
    one = "one.csv" if split == "directions of one log" else "two.csv"
    fit = fit_valve_pwm([*in_log(parts[0], "one.csv"), *in_log(parts[1], one)], make_rig())
    found = fit.averaged["a"].fit.estimates
    for name, value in zip(
        ("choked_flow_fill_kg_s", "choked_flow_dis_kg_s", "c_fill", "c_dis"),
        VALVES["a"],
        strict=True,
    ):
        assert found[name].value == pytest.approx(value, rel=0.02)
    assert one_line(fit, f"{one}, discharging", "305.0 kPa")


def test_the_averaged_law_is_right_at_the_flows_jumps_and_between_the_rows() -> None:
    """Windows across the choked boundaries took 1 % from the choked flow of filling.

    The pulses' drift took 0.3 % from the exhaust's, and the few rows of a pulse's ripple as much.
    """
    trials = make_trials("b", noise=20.0)
    found = fit_valve_pwm(trials, make_rig(), law="thesis").averaged["b"].estimates
    for name, value in zip(
        ("choked_flow_fill_kg_s", "choked_flow_dis_kg_s", "c_fill", "c_dis"),
        VALVES["b"],
        strict=True,
    ):
        assert found[name].value == pytest.approx(value, rel=1e-3), name
    assert found["delay_difference_s"].value == pytest.approx(OFF - ON, abs=2e-6)


def test_starts_that_disagree_within_a_log_are_said() -> None:
    pairs = zip(make_trials(), make_trials(supply=SUPPLY + 5e3), strict=True)
    fit = fit_valve_pwm([pair[i % 2] for i, pair in enumerate(pairs)], make_rig())
    line = one_line(fit, "the supply changed between tests", "log supply_pressure_pa")
    assert line.startswith("log.csv: valve A")


def test_noise_is_no_change_of_the_supply() -> None:
    fit = fit_valve_pwm(make_trials(noise=10 * NOISE), make_rig())
    assert not [n for n in fit.notices if "the supply changed" in n or "supply was" in n]


@pytest.mark.parametrize("declared_hz", [100.0, 192.0, 250.0])
def test_a_pwm_period_that_the_ripple_contradicts_is_said(declared_hz: float) -> None:
    fit = fit_valve_pwm(make_trials(), make_rig(declared_hz))
    line = one_line(fit, "ripples with a period of 5 ms", "[pwm] period_s")
    assert line.startswith("log.csv: pressure_a_pa")
    assert f"{1e3 / declared_hz:.3g} ms" in line


@pytest.mark.parametrize("hum", [0.0, 400.0])
@pytest.mark.parametrize("noise", [NOISE, 5e3])
@pytest.mark.parametrize("rows", [1, 4])
def test_no_period_is_said_where_the_pulses_do_not_show_another(
    hum: float, noise: float, rows: int
) -> None:
    """Right, below the noise and a mains hum, and at 4 rows' distance an alias of 20 ms."""

    def thinned(t: Trial) -> Trial:
        pressure = t["pressure_a_pa"] + hum * np.sin(2 * np.pi * 50.0 * t.time)
        channels = {**t.channels, "pressure_a_pa": pressure}
        kept = {name: values[::rows] for name, values in channels.items()}
        return Trial(t.label, t.time[::rows], kept, t.source)

    remarks = Remarks()
    select_tests([thinned(t) for t in make_trials(noise=noise)], make_rig(), "a", remarks)
    assert not any("ripples" in n for n in remarks.notices())


@pytest.mark.parametrize("limit", [2.5e5, 2.0e5])
@pytest.mark.parametrize("noise", [0.0, NOISE])
def test_a_saturated_pressure_ends_the_domain(limit: float, noise: float) -> None:
    trials = [
        with_channels(t, pressure_a_pa=np.minimum(t["pressure_a_pa"], COUNT * round(limit / COUNT)))
        for t in make_trials(noise=noise)
    ]
    fit = fit_valve_pwm(trials, make_rig())
    assert f"saturated at {COUNT * round(limit / COUNT):.0f} Pa" in " ".join(fit.notices)
    part = fit.fits["a", "fill"]
    assert ("a", "discharge") in fit.fits
    assert part.samples.pressure.max() < limit
    assert part.domain.pressure_range[1] < limit
    share = np.clip(part.samples.duty + 0.06, 0.0, 1.0)
    opened, closed = law("a", part.samples.pressure)
    error = (part.samples.flow - share * opened - (1 - share) * closed) / (opened - closed)
    assert np.percentile(np.abs(error), 95) < 0.03


def test_no_saturation_is_seen_in_a_log_without_noise() -> None:
    fit = fit_valve_pwm(make_trials(noise=0.0), make_rig())
    assert "saturated" not in " ".join(fit.notices)


def test_filling_that_stays_choked_says_what_is_missing() -> None:
    short = [
        Trial(t.label, t.time[:45], {k: v[:45] for k, v in t.channels.items()}, t.source)
        for t in make_trials(directions=("fill",))
        if t["duty_a"][0] < 0.7
    ]
    fit = fit_valve_pwm(short, make_rig())
    line = one_line(fit, "unchoked filling (above 159 kPa) cannot be identified")
    assert "holds there only" in line
    assert fit.fits["a", "fill"].domain.pressure_range[1] < 0.53 * SUPPLY


def test_tests_too_short_for_a_surface_say_what_they_cover() -> None:
    short = [
        Trial(t.label, t.time[:30], {k: v[:30] for k, v in t.channels.items()}, t.source)
        for t in make_trials(directions=("fill",))
        if t["duty_a"][0] < 0.5
    ]
    with pytest.raises(NotIdentifiedError, match=r"record longer; unchoked filling .* cannot be"):
        fit_valve_pwm(short, make_rig())


def test_a_test_off_the_surface_of_the_others_is_pointed_out() -> None:
    def mislabel(t: Trial) -> Trial:
        return with_channels(t, duty_a=np.full(len(t), 0.45))

    trials = [t for t in make_trials(directions=("fill",)) if t.label != "fill-0.46"]
    trials = changed(trials, lambda t: t.label == "fill-0.54", mislabel)
    fit = fit_valve_pwm(trials, make_rig())
    assert "0.45" in one_line(fit, "from the line between its neighbours")
    healthy = samples_of(make_trials(directions=("fill",)), make_rig(), "a", True)
    assert off_surface_tests(healthy.part(healthy.duty < 0.93)) == []


def test_samples_far_apart_are_blocks_of_their_own() -> None:
    """Time in nanoseconds taken for seconds: periods of years were counted one by one."""
    assert pulse_block(0.005, 5e8) == 1


def test_a_duty_stands_at_its_own_curve_alone() -> None:
    pressure = np.linspace(1e5, 3e5, 21)
    # Discharge: the highest duty flows at the highest pressures alone, and ends in noise.
    rise = (pressure - 1e5) / 2e5
    flow = np.array([-3e-4 * (rise + 0.05), -1e-4 * rise, np.zeros(21)])
    flow[2, :-3] = np.nan
    flow[2, -3:] = -9e-6, -4e-6, -8e-6
    levels = LevelFlows(
        np.array([0.02, 0.4, 0.8]), pressure, flow, np.isfinite(flow).astype(int), np.zeros(0, int)
    )
    surface = SimpleNamespace(
        domain_=SimpleNamespace(holds_duty=lambda duty: duty >= 0.0),
        flow=lambda duty, p: (-1e-4 * (1.0 - duty),),
    )
    (panel,) = flow_figure("Valve A", "a", levels, {"averaged": surface}).panels
    words = [mark for mark in panel.marks if isinstance(mark, Words)]
    assert [word.text for word in words] == ["0.02", "0.40", "0.80"]
    assert all(word.x > 300.0 for word in words)  # beyond the end of the curves, at the same side
    # One that would lie over another curve is omitted: this one ends before the others.
    flow[2] = np.where(pressure < 2.4e5, -0.7e-4, np.nan)
    (panel,) = flow_figure("Valve A", "a", levels, {"averaged": surface}).panels
    words = [mark for mark in panel.marks if isinstance(mark, Words)]
    assert [word.text for word in words] == ["0.02", "0.40"]
