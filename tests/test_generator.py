"""The generator of campaigns: its plant against exact solutions and scipy, and its files."""

from __future__ import annotations

import ast
import itertools
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow
import pyarrow.parquet as pq
import pytest
from scipy.integrate import solve_ivp

from datasets.generator import bundled
from datasets.generator.__main__ import main
from datasets.generator.campaign import (
    KINDS,
    MOTION_KINDS,
    STANDARD,
    make_campaign,
    make_friction_tests,
    size_of,
)
from datasets.generator.files import Dialect, log_frame, write_log
from datasets.generator.integrator import integrate
from datasets.generator.plant import (
    BOUNDARY,
    CRITICAL_RATIO,
    FloatArray,
    Plant,
    boundary_rates,
    next_regime,
)
from datasets.generator.rigs import GeneratedRig, reference_rig
from datasets.generator.runs import Commands, Start, at_atmosphere, simulated
from datasets.generator.timing import merged, movements, pwm_commands, switched_commands
from datasets.generator.valve_tests import held_start
from sysid.io.rig import rig_from_content

P0, PS = 1.0e5, 3.0e5
ROW_S = 0.001
TINY = size_of(0.3)


def reference_plant(**changes: float) -> Plant:
    return reference_rig().plant()._replace(**changes)  # type: ignore[arg-type]


def commanded(motor: FloatArray, given: dict[str, FloatArray]) -> Commands:
    """Commands from the columns that are there."""
    g = given
    return Commands(motor, g.get("valve_a"), g.get("valve_b"), g.get("duty_a"), g.get("duty_b"))


def rows(seconds: float) -> FloatArray:
    return np.zeros(round(seconds / ROW_S))


# --- The plant against solutions in closed form ---------------------------------------------


@pytest.mark.parametrize("valve", ["a", "b"])
def test_filling_and_discharging_follow_the_exact_solution(valve: str) -> None:
    """Held piston: choked P is linear, filling sqrt(Ps - P) is, and exhaust is exponential."""
    rig = reference_rig()
    n, on, off = 6000, 1000, 4000
    command = np.zeros(n)
    command[on:off] = 1.0
    commands = commanded(np.zeros(n), {f"valve_{valve}": command})
    states = simulated(rig, rig.plant(), commands, held_start(rig, valve, False))
    pressure = states[:, 2 if valve == "a" else 3]
    law = rig.truth.valve_a if valve == "a" else rig.truth.valve_b
    area = 4.524e-4 if valve == "a" else 4.207e-4
    gain = 1.4 * 287.0 * 293.15 / ((0.075 + 0.0635) * area)

    t = np.arange(n) * ROW_S
    filling = np.clip(t - (1.0 + 0.0017), 0.0, None)
    choked_for = (CRITICAL_RATIO * PS - P0) / (gain * law.choked_flow_fill_kg_s)
    root = np.sqrt((1.0 - CRITICAL_RATIO) * PS)
    root_left = root - 0.5 * gain * law.c_fill * (filling - choked_for)
    fill = np.where(
        filling < choked_for,
        P0 + gain * law.choked_flow_fill_kg_s * filling,
        PS - np.clip(root_left, 0.0, None) ** 2,
    )
    emptying = t - (4.0 + 0.0020)
    choked_exhaust_for = (PS - P0 / CRITICAL_RATIO) / (gain * law.choked_flow_dis_kg_s)
    rest = P0 / CRITICAL_RATIO - P0
    empty = np.where(
        emptying < choked_exhaust_for,
        PS - gain * law.choked_flow_dis_kg_s * emptying,
        P0 + rest * np.exp(-gain * law.c_dis * (emptying - choked_exhaust_for)),
    )
    exact = np.where(emptying < 0.0, fill, empty)
    assert np.max(np.abs(pressure - exact)) < 1e-2
    assert np.all(states[:, 0] == states[0, 0])


def test_air_above_the_supply_flows_back_and_below_the_atmosphere_flows_in() -> None:
    rig = reference_rig()
    n = 200
    commands = Commands(np.zeros(n), valve_a=np.ones(n))
    states = simulated(rig, rig.plant(), commands, Start(0.0, 3.2e5, 0.9e5, (1, 0), held=True))
    gain = 1.4 * 287.0 * 293.15 / 0.075
    t = np.arange(n) * ROW_S
    root = np.sqrt(0.2e5) - 0.5 * gain / 4.524e-4 * 1.5e-6 * t
    assert np.max(np.abs(states[:, 2] - (PS + np.clip(root, 0.0, None) ** 2))) < 1e-2
    inflow = P0 - 0.1e5 * np.exp(-gain / 4.207e-4 * 3.7e-9 * t)
    assert np.max(np.abs(states[:, 3] - inflow)) < 1e-4


def test_ramp_breaks_away_at_static_friction() -> None:
    rig = reference_rig()
    ramp = np.asarray(np.arange(2500) * 2e-4, dtype=np.float64)
    states = simulated(rig, rig.plant(), Commands(ramp), at_atmosphere(rig, 0.0))
    first = int(np.flatnonzero(states[:, 0] != 0.0)[0])
    # The torque of row 1666 is the first above 0.333 Nm; the shaft has moved a row later.
    assert first == int(np.floor(0.333 / 2e-4)) + 2
    # In that row it is driven by the torque less Coulomb friction (viscosity is negligible yet).
    acceleration = (ramp[first - 1] - 0.208) / 0.02368
    assert states[first, 1] == pytest.approx(acceleration * ROW_S, rel=2e-2)


def test_coulomb_friction_alone_stops_the_arm_where_it_should() -> None:
    """Pushed for 0.1 s, then free: constant accelerations, and stuck ever after."""
    rig = reference_rig()
    plant = reference_plant(viscous_friction=0.0, radius=1e-9, half_travel=1e3)
    torque = rows(1.0)
    torque[:100] = 0.6
    states = simulated(rig, plant, Commands(torque), at_atmosphere(rig, 0.0))
    up, down = (0.6 - 0.208) / 0.02368, 0.208 / 0.02368
    speed = up * 0.1
    stop = 0.1 + speed / down
    t = np.arange(1000) * ROW_S
    slowing = np.clip(t, 0.1, stop) - 0.1
    exact = np.where(
        t < 0.1, 0.5 * up * t**2, 0.05 * speed + speed * slowing - 0.5 * down * slowing**2
    )
    assert np.max(np.abs(states[:, 0] - exact)) < 1e-9
    assert np.all(states[t > stop, 1] == 0.0)


def test_sealed_frictionless_cylinder_keeps_energy_and_entropy() -> None:
    rig = reference_rig()
    base = reference_plant(static_friction=0.0, coulomb_friction=0.0, viscous_friction=0.0)
    sealed = {"c_dis": 0.0, "choked_dis": 0.0, "c_fill": 0.0, "choked_fill": 0.0}
    plant = base._replace(a=base.a._replace(**sealed), b=base.b._replace(**sealed))
    x = simulated(rig, plant, Commands(rows(5.0)), Start(0.3, 1.4e5, 1.1e5))
    volumes = (0.075 + 0.0375 * x[:, 0]) * 4.524e-4, (0.075 - 0.0375 * x[:, 0]) * 4.207e-4
    for volume, pressure in zip(volumes, (x[:, 2], x[:, 3]), strict=True):
        entropy = pressure * volume**1.4
        assert np.ptp(entropy) / entropy[0] < 1e-7
    gas = (x[:, 2] * volumes[0] + x[:, 3] * volumes[1]) / 0.4
    energy = (
        0.5 * plant.inertia * x[:, 1] ** 2 + gas + P0 * (4.524e-4 - 4.207e-4) * 0.0375 * x[:, 0]
    )
    assert np.ptp(x[:, 0]) > 0.3
    assert np.ptp(energy) < 1e-6 * np.ptp(gas)


def test_end_stop_takes_the_speed_and_holds() -> None:
    rig = reference_rig()
    torque = np.full(3000, 0.795)
    torque[1500:] = -0.795
    x = simulated(rig, rig.plant(), Commands(torque), at_atmosphere(rig, 1.0))
    at_stop = np.flatnonzero(x[:, 0] == rig.half_travel)
    assert at_stop.size > 500 and np.all(x[at_stop, 1] == 0.0)
    assert at_stop[-1] == 1500 and x[-1, 0] < rig.half_travel - 0.1
    assert np.max(x[:, 0]) == rig.half_travel


def test_gravity_pulls_towards_zero_and_friction_holds_small_angles() -> None:
    rig = reference_rig("vertical")
    hold = np.arcsin(0.333 / (0.30 * 0.23 * 9.81))
    held = simulated(rig, rig.plant(), Commands(rows(1.0)), at_atmosphere(rig, 0.98 * hold))
    falls = simulated(rig, rig.plant(), Commands(rows(1.0)), at_atmosphere(rig, 1.02 * hold))
    assert np.ptp(held[:, 0]) == 0.0
    assert falls[-1, 0] < falls[0, 0] - 0.01


def test_pressure_stays_on_the_choked_boundary_where_both_laws_push_it_there() -> None:
    """Fast expansion between the two laws' flows: Filippov, found and left again."""
    plant = reference_plant(
        static_friction=0.0, coulomb_friction=0.0, viscous_friction=50.0, max_effort=2e3,
        half_travel=1.7, inertia=1e-3,
    )  # fmt: skip
    boundary = CRITICAL_RATIO * PS
    speed = 6.7e-4 * 287.0 * 293.15 / (boundary * 4.524e-4 * 0.0375)  # between 5.6 and 7.8e-4 kg/s
    x = np.array([-1.0, speed, boundary + 1.0, P0])
    choked, unchoked = boundary_rates(x, 1, plant.a, plant)
    assert choked > 0.0 > unchoked
    assert next_regime(x, 2, 1, 1, plant.a, plant) == BOUNDARY and x[2] == boundary
    torque = np.full(90, 50.0 * speed)
    torque[70:] = 0.0
    states, count = integrate(
        plant, ROW_S, torque, np.empty(0), np.empty(0, np.int64), np.empty(0, np.int64),
        np.array([-1.6, 0.0, P0, P0]), np.array([1, 0]), False, np.array([-9.0, 9.0]), 1.0,
    )  # fmt: skip
    assert count == 90
    assert np.count_nonzero(states[:70, 2] == boundary) > 20
    assert states[-1, 2] > boundary + 1e4


# --- Valve timing ---------------------------------------------------------------------------


def test_an_edge_that_overtakes_another_cancels_it() -> None:
    command = np.array([0.0, 1.0, 1.0, 0.0, 1.0])
    times, states = switched_commands(command, 0.0002)  # off for 0.2 ms: the valve never closes
    moved, to = movements(times, states, 0.0017, 0.0020, 0)
    assert moved == pytest.approx([0.0019]) and list(to) == [1]
    times, states = switched_commands(command, 0.0004)  # off for 0.4 ms: it does, for 0.1 ms
    moved, to = movements(times, states, 0.0017, 0.0020, 0)
    assert moved == pytest.approx([0.0021, 0.0032, 0.0033]) and list(to) == [1, 0, 1]


@pytest.mark.parametrize("frequency", [200.0, 250.0, 300.0])
def test_pwm_opens_for_duty_and_the_difference_of_delays(frequency: float) -> None:
    period = 1.0 / frequency
    times, states = pwm_commands(np.full(1000, 0.3), ROW_S, period, 0)
    moved, to = movements(times, states, 0.0017, 0.0020, 0)
    assert len(moved) == 2 * round(frequency)
    assert np.allclose(moved[0::2], np.arange(frequency) * period + 0.0017, atol=1e-12)
    assert np.allclose(moved[1::2] - moved[0::2], 0.3 * period + 0.0003, atol=1e-12)
    assert list(to[:2]) == [1, 0]


def test_pwm_reads_the_duty_when_a_period_starts() -> None:
    duty = np.array([0.2, 0.9, 0.9, 0.9, 0.9, 0.4, 0.1, 0.1, 0.1, 0.1])
    times, states = pwm_commands(duty, ROW_S, 0.005, 0)
    assert times == pytest.approx([0.0, 0.001, 0.005, 0.007]) and list(states) == [1, 0, 1, 0]
    assert pwm_commands(np.zeros(10), ROW_S, 0.005, 0)[0].size == 0
    assert pwm_commands(np.ones(10), ROW_S, 0.005, 0)[0] == pytest.approx([0.0])
    assert pwm_commands(np.ones(10), ROW_S, 0.005, 1)[0].size == 0


# --- The plant against scipy, and against itself with finer steps ---------------------------


def scipy_states(rig: GeneratedRig, plant: Plant, commands: Commands, start: Start) -> FloatArray:
    """The same motion by DOP853 with scipy's own events, the equations written out once more."""
    g, d = rig.content["air"], rig.content["valves"]
    p0, ps = g["atmospheric_pressure_pa"], g["supply_pressure_pa"]
    krt = 1.4 * g["gas_constant_j_per_kg_k"] * g["temperature_k"]
    c, r = rig.content["cylinder"], rig.radius
    areas, laws = (c["area_a_m2"], c["area_b_m2"]), (rig.truth.valve_a, rig.truth.valve_b)

    def applied(y: FloatArray, motor: float) -> float:
        cylinder = (y[2] * areas[0] - y[3] * areas[1] - p0 * (areas[0] - areas[1])) * r
        return float(motor + cylinder - rig.gravity() * np.sin(y[0]))

    def flow(i: int, p: float, on: int, choked: bool) -> float:
        if on:
            root = float(np.sign(ps - p) * np.sqrt(abs(ps - p)))
            return laws[i].choked_flow_fill_kg_s if choked else laws[i].c_fill * root
        return -laws[i].choked_flow_dis_kg_s if choked else float(laws[i].c_dis * (p0 - p))

    def edge(on: int) -> float:
        return float(CRITICAL_RATIO * ps if on else p0 / CRITICAL_RATIO)

    def is_choked(p: float, on: int) -> bool:
        return p <= edge(on) if on else p >= edge(on)

    moves = []
    for duty in (commands.duty_a, commands.duty_b):
        assert duty is not None
        times, to = pwm_commands(duty, ROW_S, 0.005, 0)
        moves.append(movements(times, to, d["on_delay_s"], d["off_delay_s"], 0))
    edge_time, edge_valve, edge_state = merged(*moves)
    t_rows = np.arange(len(commands.motor)) * ROW_S
    stops = np.unique(np.concatenate((t_rows, edge_time[edge_time < t_rows[-1]])))
    y = np.array([start.position, 0.0, start.pressure_a, start.pressure_b])
    on, choked, slide, states = [0, 0], [is_choked(y[2], 0), is_choked(y[3], 0)], 0, [y]
    for t, until in itertools.pairwise(stops):
        for v, s in zip(edge_valve[edge_time == t], edge_state[edge_time == t], strict=True):
            on[v], choked[v] = int(s), is_choked(y[2 + v], int(s))
        motor = commands.motor[int(t / ROW_S + 1e-6)]
        while t < until - 1e-13:
            if slide == 0 and abs(applied(y, motor)) > plant.static_friction:
                slide = int(np.sign(applied(y, motor)))

            def rhs(_: float, y: FloatArray, s: int = slide, motor: float = motor) -> list[float]:
                w = y[1] if s else 0.0
                friction = plant.coulomb_friction * s + plant.viscous_friction * w
                dw = (applied(y, motor) - friction) / plant.inertia if s else 0.0
                rates = []
                for i, sign in enumerate((1.0, -1.0)):
                    volume = (c["offset_" + "ab"[i] + "_m"] + sign * r * y[0]) * areas[i]
                    m = flow(i, y[2 + i], on[i], choked[i])
                    rates.append((krt * m - 1.4 * y[2 + i] * sign * r * w * areas[i]) / volume)
                return [w, dw, *rates]

            def stick(_: float, y: FloatArray, slide: int = slide, motor: float = motor) -> float:
                return slide * y[1] if slide else plant.static_friction - abs(applied(y, motor))

            events: list[Any] = [stick]
            for i in (0, 1):
                side = (1 if on[i] else -1) * (1 if choked[i] else -1)
                events.append(lambda _, y, i=i, side=side: side * (edge(on[i]) - y[2 + i]))
            for event in events:
                event.terminal, event.direction = True, -1
            solution = solve_ivp(
                rhs, (t, until), y, "DOP853", rtol=1e-10, atol=[1e-11, 1e-10, 1e-5, 1e-5],
                events=events,
            )  # fmt: skip
            t, y = float(solution.t[-1]), solution.y[:, -1]
            if solution.t_events[0].size:
                y[1] = 0.0
                big = abs(applied(y, motor)) > (0.99 if slide == 0 else 1.0) * plant.static_friction
                slide = int(np.sign(applied(y, motor))) if big else 0
            for i in (0, 1):
                if solution.t_events[1 + i].size:
                    choked[i] = not choked[i]
        if np.min(np.abs(t_rows - until)) < 1e-12:
            states.append(y)
    return np.array(states)


def pwm_motion(seed: int, orientation: str) -> tuple[GeneratedRig, Plant, Commands, Start]:
    made = make_campaign(seed, orientation=orientation, stems=("motion_pwm_2",))
    test = made.logs[0].tests[1]
    commands = commanded(test.columns["motor_torque_nm"], test.columns)
    plant = made.rig.plant(test.truth["static_factor"], test.truth["sliding_factor"])
    return made.rig, plant, commands, at_atmosphere(made.rig, test.truth["position"])


@pytest.mark.parametrize(("seed", "orientation"), [(3, "horizontal"), (4, "vertical")])
def test_pwm_motion_agrees_with_scipy(seed: int, orientation: str) -> None:
    rig, plant, commands, start = pwm_motion(seed, orientation)
    n = 1000
    short = Commands(
        commands.motor[:n],
        duty_a=None if commands.duty_a is None else commands.duty_a[:n],
        duty_b=None if commands.duty_b is None else commands.duty_b[:n],
    )
    own, other = simulated(rig, plant, short, start), scipy_states(rig, plant, short, start)
    assert np.ptp(own[:, 0]) > 0.1 and 0.01 < np.mean(own[:, 1] == 0.0) < 0.9
    assert np.max(own[:, 2]) > CRITICAL_RATIO * rig.content["air"]["supply_pressure_pa"]
    error = np.max(np.abs(own - other), axis=0)
    assert error[0] < 1e-7 and error[1] < 1e-6 and max(error[2:]) < 1e-2


@pytest.mark.parametrize("kind", ["pwm", "discrete"])
def test_result_does_not_depend_on_the_tolerance(kind: str) -> None:
    made = make_campaign(6, stems=(f"motion_{kind}_2",))
    test, rig = made.logs[0].tests[0], made.rig
    commands = commanded(test.columns["motor_torque_nm"], test.columns)
    plant = rig.plant(test.truth["static_factor"], test.truth["sliding_factor"])
    start = at_atmosphere(rig, test.truth["position"])
    usual = simulated(rig, plant, commands, start)
    finer = simulated(rig, plant, commands, start, tolerance=1.0 / 64.0)
    error = np.max(np.abs(usual - finer), axis=0)
    assert error[0] < 1e-6 and max(error[2:]) < 1.0
    # And it is the logged test: the same run, read by the sensors.
    count = 2.0 * np.pi / 80000
    assert np.max(np.abs(usual[:, 0] - test.columns["theta_rad"])) <= 0.5001 * count


# --- What the tests hold --------------------------------------------------------------------


def test_friction_trials_scatter_and_break_away_as_recorded() -> None:
    factors = []
    for seed in range(6):
        made = make_friction_tests(seed, kinds=("friction-static",))
        static = made.truth["friction"]["static_nm"]
        for test in made.kinds["friction-static"]:
            c, truth = test.columns, test.truth
            moved = int(np.flatnonzero(c["theta_rad"] != c["theta_rad"][0])[0])
            torque = truth["direction"] * c["motor_torque_nm"]
            breakaway = truth["direction"] * truth["breakaway_effort"]
            assert breakaway == pytest.approx(static * truth["static_factor"])
            # One count of motion comes within 30 ms of breakaway, on a ramp of 0.19 Nm/s.
            assert 0.0 < torque[moved] - breakaway < 0.008
            assert 0.298 < c["time_s"][-1] - c["time_s"][moved] < 0.502
            factors.append(truth["static_factor"])
    assert 0.015 < np.std(factors) < 0.025 and abs(np.mean(factors) - 1.0) < 0.006


def test_sliding_trials_settle_at_their_levels() -> None:
    made = make_friction_tests(2, scatter=0.0, kinds=("friction-sliding",))
    friction = made.truth["friction"]
    rig = made.generated_rig
    levels = set()
    for test in made.kinds["friction-sliding"]:
        c = test.columns
        late = slice(len(test) // 2, None)
        speed = np.polyfit(c["time_s"][late], c["theta_rad"][late], 1)[0]
        area_a, area_b = (rig.content["cylinder"][f"area_{s}_m2"] for s in "ab")
        p0 = rig.content["air"]["atmospheric_pressure_pa"]
        forces = (c["pressure_a_pa"] - p0) * area_a - (c["pressure_b_pa"] - p0) * area_b
        torque = np.mean(c["motor_torque_nm"][late] + forces[late] * rig.radius)
        expected = friction["coulomb_nm"] + friction["viscous_nm_s_per_rad"] * abs(speed)
        assert np.sign(speed) == test.truth["direction"]
        assert abs(torque) == pytest.approx(expected, rel=0.03)
        levels.add(abs(float(c["motor_torque_nm"][-1])))
    assert len(levels) == 3


def test_sensors_have_the_declared_noise_and_steps() -> None:
    made = make_campaign(8, size=TINY, noise_pa=180.0, kinds=("valve-discrete",))
    test = made.log("valve_discrete_a").tests[0]
    pressure, theta = test.columns["pressure_a_pa"], test.columns["theta_rad"]
    assert np.all(pressure % 26.0 == 0.0)
    assert np.std(pressure[:900]) == pytest.approx(np.hypot(180.0, 26.0 / np.sqrt(12.0)), rel=0.08)
    counts = theta * 80000 / (2.0 * np.pi)
    assert np.max(np.abs(counts - np.round(counts))) < 1e-6
    assert made.truth["pressure_noise_pa"] == 180.0


@pytest.mark.parametrize("orientation", ["horizontal", "vertical"])
@pytest.mark.parametrize("motion", ["rotary", "linear"])
def test_every_kind_of_test_of_every_kind_of_rig(orientation: str, motion: str) -> None:
    made = make_campaign(11, size=TINY, orientation=orientation, motion=motion)
    assert {log.kind for log in made.logs} == set(KINDS)
    assert {log.kind for log in made.logs if log.use == "holdout"} == set(MOTION_KINDS)
    rig = rig_from_content(made.rig.content, "generated")
    assert rig.notices == () and rig.orientation == orientation and rig.motion == motion
    assert rig.total_inertia() == pytest.approx(made.rig.inertia())
    assert rig.gravity_moment() == pytest.approx(made.rig.gravity())
    stroke = 2.0 * made.rig.half_travel
    for log in made.logs:
        for test in log.tests:
            assert rig.position_channel in test.columns
            position = test.columns[rig.position_channel]
            if log.kind in VALVE_COLUMNS:
                assert set(VALVE_COLUMNS[log.kind]) <= set(test.columns)
            if log.kind.startswith("motion"):
                assert np.max(np.abs(position)) < 0.5 * stroke - 0.01 * stroke
                assert np.ptp(position) > 0.1 * stroke
            if not log.kind.startswith("valve"):
                assert np.max(np.abs(test.columns[rig.effort_channel])) <= made.rig.max_effort


VALVE_COLUMNS = {
    "valve-discrete": ("valve_a", "valve_b"),
    "valve-pwm": ("duty_a", "duty_b"),
    "motion-motor": ("valve_a", "valve_b"),
    "motion-pwm": ("duty_a", "duty_b"),
    "motion-discrete": ("valve_a", "valve_b"),
}


def test_valve_pwm_log_has_both_directions_and_every_duty() -> None:
    made = make_campaign(12, size=size_of(0.5), kinds=("valve-pwm",), pwm_frequency=250.0)
    assert made.rig.content["pwm"]["period_s"] == 0.004
    supply = made.rig.content["air"]["supply_pressure_pa"]
    tests = made.log("valve_pwm_b").tests
    fill = [t.columns["duty_b"][0] for t in tests if t.columns["pressure_b_pa"][0] < 1.1e5]
    empty = [t.columns["duty_b"][0] for t in tests if t.columns["pressure_b_pa"][0] > supply - 2e3]
    assert fill == empty and len(fill) == 25 and fill[0] == 0.02 and fill[-1] == 0.98
    ends = [np.mean(t.columns["pressure_b_pa"][-100:]) for t in tests[:25]]
    assert np.all(np.diff(ends) > -100.0) and ends[-1] - ends[0] > 1e5


def test_sizes() -> None:
    assert size_of("standard") == STANDARD == size_of(1.0)
    assert size_of("large").duty_step == 0.01 < size_of("small").duty_step == 0.04
    for bad in ("huge", "0", "-1", "nan"):
        with pytest.raises(ValueError, match=r"size|convert"):
            size_of(bad)


def test_same_seed_same_bits_whatever_is_left_out() -> None:
    whole = make_campaign(13, size=TINY, kinds=("motion-motor", "friction-static"))
    part = make_campaign(13, size=TINY, stems=("motion_motor_2",))
    other = make_campaign(14, size=TINY, stems=("motion_motor_2",))
    ours, theirs = whole.log("motion_motor_2").tests[0], part.log("motion_motor_2").tests[0]
    assert all(np.array_equal(ours.columns[k], theirs.columns[k]) for k in theirs.columns)
    assert whole.rig.content == part.rig.content != other.rig.content


# --- Files ----------------------------------------------------------------------------------


def test_dialects(tmp_path: Path) -> None:
    made = make_campaign(15, size=TINY, stems=("friction_static",))
    tests, rig = made.logs[0].tests, made.rig
    plain = log_frame(tests, rig)
    odd = log_frame(
        tests,
        rig,
        Dialect(counts=True, volts=True, text_labels=True, running_time=True, supply=True),
    )
    assert list(plain.columns[:3]) == ["time_s", "test", "motor_torque_nm"]
    assert np.allclose(
        odd["encoder_counts"] * rig.position_per_count, plain["theta_rad"], atol=1e-7
    )
    assert np.allclose(
        odd["motor_volts"] * rig.effort_per_volt, plain["motor_torque_nm"], atol=1e-7
    )
    assert np.all(np.diff(odd["time_s"]) > 0.0) and not np.all(np.diff(plain["time_s"]) > 0.0)
    assert odd["test"].iloc[0] == "t1" and plain["test"].iloc[0] == 1
    assert np.mean(odd["supply_pressure_pa"]) == pytest.approx(
        rig.content["air"]["supply_pressure_pa"], rel=1e-3
    )
    csv, parquet = tmp_path / "a.csv", tmp_path / "a.parquet"
    write_log(csv, tests, rig, Dialect(comments=True))
    write_log(parquet, tests, rig, Dialect(parquet=True))
    assert csv.read_bytes().startswith(b"# ") and b"\r" not in csv.read_bytes()
    for frame in (pd.read_csv(csv, comment="#"), pd.read_parquet(parquet)):
        assert np.allclose(frame.to_numpy(float), plain.to_numpy(float), atol=1e-12)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.csv", "a.parquet"]


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, truth = tmp_path / "campaign", tmp_path / "truth.json"
    given = ["-o", str(folder), "--seed", "16", "--size", "0.3", "--kinds", "valve-discrete"]
    assert main([*given, "--truth", str(truth), "--pwm-frequency", "300"]) == 0
    assert "5 files" in capsys.readouterr().out
    names = {path.name for path in folder.iterdir()}
    assert names == {"rig.toml", "campaign.toml", "valve_discrete_a.csv", "valve_discrete_b.csv"}
    text = (folder / "campaign.toml").read_text()
    assert "--seed 16" in text and str(tmp_path) not in text
    content = json.loads(truth.read_text())
    assert content["seed"] == 16 and set(content["valves"]) == {"a", "b"}
    assert "period_s = 0.003333333333" in (folder / "rig.toml").read_text()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["-o", "c"], "--seed"),
        (["-o", "c", "--seed", "1", "--truth", "c/truth.json"], "outside"),
        (["-o", "c", "--seed", "-1"], "whole number"),
        (["-o", "c", "--seed", "1", "--size", "0"], "positive factor"),
        (["-o", "c", "--seed", "1", "--kinds", "valve"], "valve-pwm"),
        (["-o", "c", "--seed", "1", "--scatter", "nan"], "0 or more"),
        (["-o", "c", "--seed", "1", "--pwm-frequency", "1"], "500 Hz"),
    ],
)
def test_command_line_refuses(
    arguments: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    assert stopped.value.code == 2 and said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_bundled_campaign_is_made_again_bit_for_bit(tmp_path: Path) -> None:
    stems = ("motion_motor_2", "motion_discrete_2", "valve_discrete_a", "friction_static")
    written = [p for p in bundled.write_bundled(tmp_path, stems) if p.name != "campaign.toml"]
    assert {path.suffix for path in written} == {".csv", ".parquet", ".toml"}
    for path in written:
        kept = bundled.BUNDLED_FOLDER / path.name
        if path.suffix == ".parquet":
            # Parquet files name the library that wrote them: another version, other bytes.
            assert pq.read_table(path).equals(pq.read_table(kept))
            writer = pq.read_metadata(kept).created_by
            if not re.search(rf"\b{re.escape(pyarrow.__version__)}\b", writer):
                continue
        assert path.read_bytes() == kept.read_bytes(), path.name


def test_bundled_campaign_is_small_and_whole() -> None:
    files = list(bundled.BUNDLED_FOLDER.iterdir())
    assert sum(path.stat().st_size for path in files) < 4e6
    text = (bundled.BUNDLED_FOLDER / "campaign.toml").read_text()
    named = set(re.findall(r'file = "(.+)"', text))
    assert named | {"campaign.toml", "rig.toml"} == {path.name for path in files}
    assert set(re.findall(r'kind = "(.+)"', text)) == set(KINDS)
    assert bundled.BUNDLED_COMMAND in text


def test_generator_shares_no_code_with_what_it_checks() -> None:
    folder = Path(bundled.__file__).parent
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in getattr(node, "names", [])]
            names.append(getattr(node, "module", None) or "")
            assert not any(name.split(".")[0] in ("sysid", "jax") for name in names), path.name
