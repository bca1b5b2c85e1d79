"""The generator's undeclared effects: each acts where it should, is neutral at 0, and is listed."""

from __future__ import annotations

import dataclasses
import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from benchmarks.rigs import REFERENCE
from benchmarks.true_model import SAME_LAW, true_effects
from datasets.generator.__main__ import main
from datasets.generator.campaign import LAB, drawn_effects, make_campaign, size_of
from datasets.generator.effects import (
    FORMS,
    OUT_OF_CATALOGUE,
    Injected,
    name_of,
    parsed,
    typical,
)
from datasets.generator.effects.gas import N_EFFECT_STATES, air_temperature, backs
from datasets.generator.effects.integrator import (
    SENSED_A,
    SENSED_B,
    SENSED_POSITION,
    SENSED_SUPPLY,
)
from datasets.generator.effects.knobs import knobs_of, plant_record
from datasets.generator.effects.simulate import Way
from datasets.generator.effects.timing import (
    drifting_movements,
    partly_opening_pulses,
    shortened_pulses,
    stuck_commands,
    without_short_pulses,
)
from datasets.generator.plant import N_MODES, PRESSURE_A, PRESSURE_B, FloatArray
from datasets.generator.rigs import GeneratedRig, reference_rig
from datasets.generator.runs import (
    NO_BAND,
    Commands,
    Start,
    at_atmosphere,
    position_after,
    simulated,
)
from datasets.generator.valve_tests import held_start

ROW_S = 0.001
P0, PS = 1.0e5, 3.0e5
POSITION, PRESSURES, SUPPLY = (SENSED_POSITION,), (SENSED_A, SENSED_B), (SENSED_SUPPLY,)
NOTHING = Injected("torque-offset", "constant", "", {"torque_offset_nm": 0.0})
RUNS = ("pwm", "motor", "held", "duty")
ALL_FORMS = [(id, form) for id, forms in FORMS.items() for form in forms]

# Where each effect must show: the run, and the sensed columns.
SHOWS = {
    "stribeck-friction": ("motor", POSITION),
    "asymmetric-coulomb-friction": ("motor", POSITION),
    "position-dependent-friction": ("motor", POSITION),
    "seal-friction": ("pwm", POSITION),
    "load-dependent-friction": ("motor", POSITION),
    "stroke-dependent-seals": ("pwm", POSITION),
    "presliding": ("motor", POSITION),
    "quadratic-drag": ("motor", POSITION),
    "backlash": ("motor", POSITION),
    "gear-mesh-ripple": ("motor", POSITION),
    "pitch-eccentricity": ("motor", POSITION),
    "stroke-dependent-area": ("pwm", POSITION),
    "link-flexibility": ("motor", POSITION),
    "cable-spring": ("motor", POSITION),
    "mounting-tilt": ("motor", POSITION),
    "inertia-mismatch": ("motor", POSITION),
    "torque-ripple": ("motor", POSITION),
    "torque-saturation": ("motor", POSITION),
    "torque-constant-error": ("motor", POSITION),
    "amplifier-lag": ("motor", POSITION),
    "torque-offset": ("motor", POSITION),
    "polytropic-exponent": ("pwm", PRESSURES),
    "wall-heat-transfer": ("held", PRESSURES),
    "dead-volume-error": ("pwm", PRESSURES),
    "tube-lag": ("held", PRESSURES),
    "piston-leakage": ("held", PRESSURES),
    "atmosphere-leakage": ("pwm", PRESSURES),
    "subsonic-flow-shape": ("held", PRESSURES),
    "choked-exhaust-scaling": ("held", PRESSURES),
    "supply-droop": ("held", PRESSURES),
    "exhaust-back-pressure": ("held", PRESSURES),
    "valve-delay": ("pwm", PRESSURES),
    "duty-dead-zone": ("duty", PRESSURES),
    "sticking-valve": ("pwm", PRESSURES),
    "coil-heating": ("pwm", PRESSURES),
    "pressure-offset": ("held", PRESSURES),
    "pressure-gain": ("held", PRESSURES),
    "pressure-lag": ("pwm", PRESSURES),
    "time-skew": ("pwm", PRESSURES),
    "encoder-eccentricity": ("motor", POSITION),
    "lost-counts": ("motor", POSITION),
    "stiction-after-rest": ("motor", POSITION),
    "temperature-drift": ("held", PRESSURES),
    "ambient-pressure-error": ("pwm", PRESSURES),
    "area-error": ("pwm", POSITION),
    "supply-pulsation": ("held", SUPPLY),
    "end-cushion": ("motor", POSITION),
    "friction-warm-up": ("motor", POSITION),
    "magnetic-latch": ("motor", POSITION),
    "torque-crosstalk": ("motor", PRESSURES),
    "mains-hum": ("motor", POSITION),
    "flow-hysteresis": ("pwm", PRESSURES),
    "threshold-leakage": ("pwm", PRESSURES),
    "eddy-brake": ("motor", POSITION),
    "payload-pendulum": ("motor", POSITION),
    "exhaust-icing": ("held", PRESSURES),
}
SENSORS = (
    "pressure-offset", "pressure-gain", "pressure-lag", "time-skew", "encoder-eccentricity",
    "lost-counts", "torque-crosstalk",
)  # fmt: skip
MOTOR_ONLY = (
    "torque-ripple", "torque-saturation", "torque-constant-error", "amplifier-lag",
    "torque-crosstalk",
)  # fmt: skip
TIMING = ("valve-delay", "duty-dead-zone", "sticking-valve", "coil-heating")


def run(name: str, effects: tuple[Injected, ...], rig: GeneratedRig | None = None) -> FloatArray:
    """States of a short test: duties in antiphase, a sine of the motor, or the piston held."""
    rig = dataclasses.replace(rig or reference_rig(), effects=effects)
    n = 1500
    t = np.arange(n) * ROW_S
    motor: FloatArray = np.zeros(n)
    if name == "motor":
        motor = 0.88 * np.clip(np.sin(2.0 * np.pi * 1.1 * t), -0.9, 0.9)
        return simulated(rig, rig.plant(), Commands(motor), at_atmosphere(rig, -0.1))
    if name == "held":
        command = ((t > 0.05) & (t < 0.75)).astype(np.float64)
        commands = Commands(motor, valve_a=command, valve_b=motor)
        return simulated(rig, rig.plant(), commands, held_start(rig, "a", False))
    if name == "duty":
        duty = np.where(t < 0.4, 0.93, 0.06)  # short gaps, then short pulses
        commands = Commands(motor, duty_a=duty, duty_b=motor)
        return simulated(rig, rig.plant(), commands, held_start(rig, "a", False))
    wave = np.repeat(np.sin(2.0 * np.pi * 1.5 * t[::5]), 5)
    duty_a, duty_b = np.clip(0.15 + 0.3 * wave, 0.06, 0.9), np.clip(0.2 - 0.3 * wave, 0.1, 0.95)
    commands = Commands(motor, duty_a=duty_a, duty_b=duty_b)
    return simulated(rig, rig.plant(), commands, at_atmosphere(rig, 0.05))


@pytest.fixture(scope="module")
def plain() -> dict[str, FloatArray]:
    """The event-locating integrator's states (n, 4), without effects."""
    return {name: run(name, ()) for name in RUNS}


@pytest.fixture(scope="module")
def neutral() -> dict[str, FloatArray]:
    """The fixed-step integrator's rows (n, 8) with an effect of no size."""
    return {name: run(name, (NOTHING,)) for name in RUNS}


def drawn(id: str, form: str, scale: float = 1.0) -> Injected:
    return typical(id, form, np.random.default_rng(3), scale)


def as_plain(rows: FloatArray) -> FloatArray:
    return rows[:, [SENSED_POSITION, SENSED_A, SENSED_B]]


# --- All effects ----------------------------------------------------------------------------


def test_every_effect_has_a_place_where_it_shows() -> None:
    assert set(SHOWS) == set(FORMS) and len(FORMS) - len(OUT_OF_CATALOGUE) == 48
    assert len(OUT_OF_CATALOGUE) >= 8 and set(OUT_OF_CATALOGUE) < set(FORMS)


@pytest.mark.parametrize(
    ("id", "form"),
    [("torque-offset", "constant"), ("duty-dead-zone", "vanish"), ("time-skew", "delay")],
)
def test_a_run_that_goes_on_is_where_one_from_the_start_is(id: str, form: str) -> None:
    """To the last bit; also where a pulse that had moved the valve is cut too short to do so."""
    rig = dataclasses.replace(reference_rig(), effects=(drawn(id, form),))
    start, motor, valves = at_atmosphere(rig, 0.05), np.zeros(600), np.zeros((2, 600))
    way = Way()
    pulses = ((0, 50, 90), (1, 200, 260), (0, 205, 206), (0, 400, 450))
    for (valve, low, high), rows in zip(pulses, (200, 300, 400, 600), strict=True):
        valves[valve, low:high] = 1.0
        if low == 205:
            valves[1, 201:260] = 0.0
        commands = Commands(motor[:rows], valve_a=valves[0, :rows], valve_b=valves[1, :rows])
        went_on = position_after(rig, rig.plant(), commands, start, NO_BAND, 1.0, way)
        assert way.reached[0] == rows - 1
        assert went_on == simulated(rig, rig.plant(), commands, start)[-1, SENSED_POSITION]
    assert position_after(rig, rig.plant(), commands, start, (0.04, 0.0501), 1.0, Way()) is None


@pytest.mark.parametrize(("id", "form"), ALL_FORMS)
def test_typical_size_shows_where_it_should(
    id: str, form: str, neutral: dict[str, FloatArray], plain: dict[str, FloatArray]
) -> None:
    name, columns = SHOWS[id]
    rows = run(name, (drawn(id, form),))
    changed = max(float(np.max(np.abs(rows - neutral[name])[:, c])) for c in columns)
    # Well above what the integrators differ by, and above an encoder count or 20 Pa.
    error = np.abs(as_plain(neutral[name]) - plain[name][:, [0, 2, 3]]).max(axis=0)
    assert changed > (max(1.5e-4, 3.0 * error[0]) if columns == POSITION else 20.0)
    if columns == PRESSURES and name == "held" and id not in SENSORS:
        assert changed > 3.0 * max(error[1:])
    if id in SENSORS:
        assert np.array_equal(rows[:, :4], neutral[name][:, :4])
    if id in MOTOR_ONLY:
        assert np.array_equal(run("pwm", (drawn(id, form),)), neutral["pwm"])
    if id in TIMING:
        assert np.array_equal(run("motor", (drawn(id, form),)), neutral["motor"])


@pytest.mark.parametrize(("id", "form"), ALL_FORMS)
def test_size_zero_is_the_plain_plant(id: str, form: str, plain: dict[str, FloatArray]) -> None:
    name = SHOWS[id][0]
    rows = run(name, (drawn(id, form, 0.0),))
    error = np.abs(as_plain(rows) - plain[name][:, [0, 2, 3]]).max(axis=0)
    assert error[0] < 1e-6 and max(error[1:]) < 0.5
    assert np.all(rows[:, SENSED_SUPPLY] == PS)


@pytest.mark.parametrize("id", [id for id, forms in FORMS.items() if len(forms) > 1])
def test_forms_differ(id: str) -> None:
    names: tuple[str, ...] = (SHOWS[id][0], "held", "pwm")
    if id == "inertia-mismatch":  # they differ by gravity
        rigs, names = reference_rig("vertical"), ("motor",)
    else:
        rigs = reference_rig()
    runs = [[run(name, (drawn(id, form),), rigs) for name in names] for form in FORMS[id]]
    for one, other in itertools.combinations(runs, 2):
        distance = [np.max(np.abs(a - b)[:, 4:], axis=0) for a, b in zip(one, other, strict=True)]
        assert max(d[0] for d in distance) > 1e-5 or max(d[1:].max() for d in distance) > 5.0


# --- Single laws against what they must give -------------------------------------------------


def test_droop_is_the_fixed_point_of_the_flow_that_passes() -> None:
    drop = 2e7  # Pa s/kg
    rows = run("held", (Injected("supply-droop", "coupled", "", {
        "droop_pa_s_per_kg": drop, "use_droop": 1.0}),))  # fmt: skip
    choked = reference_rig().truth.valve_a.choked_flow_fill_kg_s
    flow = choked / (1.0 + drop * choked / PS)  # m = choked (Ps - drop m) / Ps
    gain = 1.4 * 287.0 * 293.15 / ((0.075 + 0.0635) * 4.524e-4)
    rise = rows[70:75, SENSED_A]
    assert np.diff(rise) == pytest.approx(gain * flow * ROW_S, rel=1e-3)
    assert rows[70:75, SENSED_SUPPLY] == pytest.approx(PS - drop * flow, rel=1e-4)


def knobs(*effects: Injected) -> Any:
    """What the compiled laws read of these effects, on the reference rig."""
    return knobs_of(effects, reference_rig())[0]


@pytest.mark.parametrize("form", ["quadratic", "quadratic-common"])
def test_a_turbulent_silencer_holds_back_the_square_of_its_flow(form: str) -> None:
    plant = reference_rig().plant()
    k = knobs(drawn("exhaust-back-pressure", form, 2.0))
    p, mode = plant_record(plant)[0], np.zeros(N_MODES, dtype=np.int64)
    x = np.zeros(N_EFFECT_STATES)
    x[PRESSURE_A], x[PRESSURE_B] = 1.5e5, 1.3e5
    found = backs(x, mode, p, k)
    flows = [
        c.c_dis * (pressure - back)
        for c, pressure, back in zip((plant.a, plant.b), (1.5e5, 1.3e5), found, strict=True)
    ]
    if form == "quadratic-common":
        assert found[0] == found[1]
        flows = [sum(flows)] * 2
    rises = [2.0 * 5e3 * (flow / 3.5e-4) ** 2 for flow in flows]
    assert np.asarray(found) - P0 == pytest.approx(rises, rel=1e-4)
    assert min(rises) > 10.0


def test_a_temperature_settles_where_it_is_said_to() -> None:
    plant = plant_record(reference_rig().plant())[0]
    values = {"temperature_settled_k": -8.0, "temperature_time_s": 4.0}
    k = knobs(Injected("temperature-drift", "settling", "", values))
    steps = np.linspace(0.0, 4.0, 4001)
    warming = [air_temperature(t, plant, k) for t in (0.0, 4.0, 400.0)]
    # dT/dt = (T_end - T) / tau, integrated.
    fallen = 0.0
    for step in np.diff(steps):
        fallen += step * (-8.0 - fallen) / 4.0
    assert warming == pytest.approx([293.15, 293.15 + fallen, 285.15], abs=2e-3)


def test_torque_offset_and_saturation_move_the_breakaway() -> None:
    def first_motion(effect: Injected) -> float | None:
        rig = dataclasses.replace(reference_rig(), effects=(effect,))
        ramp = np.asarray(np.arange(2500) * 2e-4, dtype=np.float64)
        rows = simulated(rig, rig.plant(), Commands(ramp), at_atmosphere(rig, 0.0))
        moved = np.flatnonzero(rows[:, 0] != 0.0)
        return float(ramp[moved[0] - 1]) if moved.size else None

    offset = Injected("torque-offset", "constant", "", {"torque_offset_nm": 0.02})
    assert first_motion(offset) == pytest.approx(0.333 - 0.02, abs=4e-4)
    weak = Injected("torque-saturation", "hard", "", {"saturation_per_nm": 1.0 / 0.33})
    strong = Injected("torque-saturation", "hard", "", {"saturation_per_nm": 1.0 / 0.35})
    assert first_motion(weak) is None
    assert first_motion(strong) == pytest.approx(0.333, abs=4e-4)


def test_late_and_lagging_sensors_follow_their_laws(neutral: dict[str, FloatArray]) -> None:
    true = neutral["pwm"][:, SENSED_A]
    late = run("pwm", (Injected("time-skew", "delay", "a", {"skew_s": 0.003}),))
    assert np.allclose(late[3:, SENSED_A], true[:-3]) and np.all(late[:3, SENSED_A] == true[0])
    assert np.array_equal(late[:, SENSED_B], neutral["pwm"][:, SENSED_B])
    lag, row = 0.02, float(np.exp(-ROW_S / 0.02))
    slow = run("pwm", (Injected("pressure-lag", "first-order", "a", {"pressure_lag_s": lag}),))
    middle = 0.5 * (true[1:] + true[:-1]) - true[0]
    exact = true[0] + lfilter([1.0 - row], [1.0, -row], middle)
    assert np.max(np.abs(slow[1:, SENSED_A] - exact)) < 0.02 * np.ptp(true)


@pytest.mark.parametrize("form", ["beyond", "all"])
def test_lost_counts_are_those_of_fast_motion(form: str, neutral: dict[str, FloatArray]) -> None:
    true = neutral["motor"][:, SENSED_POSITION]
    values = {"lost_share": 0.1, "counted_rad_s": 1.0}
    values |= {"use_lost_of_all": 1.0} if form == "all" else {}
    shown = run("motor", (Injected("lost-counts", form, "", values),))[:, SENSED_POSITION]
    speed = np.diff(true) / ROW_S
    fast = np.abs(speed) > 1.0
    assert 0.1 < np.mean(fast) < 0.9
    slower = np.sign(speed) if form == "beyond" else 0.0
    lost = np.where(fast, 0.1 * (speed - slower), 0.0)
    np.testing.assert_allclose(np.diff(shown) / ROW_S, speed - lost, atol=1e-9)


def test_heat_cools_a_chamber_that_was_filled_fast() -> None:
    """Behind the closed end the air must come back to the room's temperature: P falls again."""
    rig = reference_rig()
    heat = Injected("wall-heat-transfer", "mass-state", "", {
        "conductance_w_per_k": 0.4, "use_heat": 1.0})  # fmt: skip
    hot = dataclasses.replace(rig, effects=(heat,))
    plant = hot.plant()
    closed = plant.a._replace(c_dis=0.0, choked_dis=0.0)
    n = 3000
    command = np.zeros(n)
    command[:20] = 1.0
    start = Start(hot.half_travel, P0, P0, held=True)
    rows = simulated(hot, plant._replace(a=closed), Commands(np.zeros(n), valve_a=command), start)
    peak, end = float(rows[:, SENSED_A].max()), float(rows[-1, SENSED_A])
    # Isothermal filling raises the pressure by 1/1.4 of what adiabatic filling does.
    assert (end - P0) / (peak - P0) == pytest.approx(1.0 / 1.4, abs=0.03)


@pytest.mark.parametrize("frequency", [12.0, 25.0])
def test_arm_swings_at_its_frequency(frequency: float) -> None:
    """With the output clamped by friction only the arm moves, at its own frequency."""
    values = {"arm_period_s": 1.0 / frequency, "arm_share": 0.3, "arm_damping_ratio": 0.01,
              "use_encoder_on_arm": 1.0}  # fmt: skip
    effect = Injected("link-flexibility", "encoder-on-arm", "", values)
    rig = dataclasses.replace(reference_rig(), effects=(effect,))
    torque = np.zeros(1200)
    torque[:40] = 0.79
    rows = simulated(rig, rig.plant(), Commands(torque), at_atmosphere(rig, 0.0))
    stuck = int(np.flatnonzero(rows[:, 1] != 0.0)[-1]) + 2
    swing = rows[stuck:, SENSED_POSITION] - rows[stuck:, 0]
    up = np.flatnonzero((swing[:-1] < 0.0) & (swing[1:] >= 0.0))
    assert len(up) > 4
    assert (len(up) - 1) / ((up[-1] - up[0]) * ROW_S) == pytest.approx(frequency, rel=0.02)


def test_bristles_give_and_spring_back() -> None:
    values = {"bristle_compliance_rad_per_nm": 1.0 / 400.0, "bristle_damping_nm_s_per_rad": 1.2,
              "use_bristle": 2.0}  # fmt: skip
    rig = dataclasses.replace(
        reference_rig(), effects=(Injected("presliding", "elastoplastic", "", values),)
    )
    torque = np.zeros(2000)
    torque[200:1000] = 0.1  # well below breakaway
    rows = simulated(rig, rig.plant(), Commands(torque), at_atmosphere(rig, 0.0))
    assert rows[990, 0] == pytest.approx(0.1 / 400.0, rel=1e-2)
    assert abs(rows[-1, 0]) < 1e-6


def test_short_pulses_vanish_or_shrink() -> None:
    times = np.array([0.0, 0.0003, 0.005, 0.007, 0.0072])
    states = np.array([1, 0, 1, 0, 1])
    kept, to = without_short_pulses(times, states, 5e-4, False)
    assert list(kept) == [0.005] and list(to) == [1]
    kept, to = without_short_pulses(times, states, 5e-4, True)
    assert list(kept) == [0.005, 0.007, 0.0072] and list(to) == [1, 0, 1]
    kept, to = shortened_pulses(times, states, 5e-4)
    assert kept == pytest.approx([0.0055, 0.007, 0.0077]) and list(to) == [1, 0, 1]


def test_hardly_longer_pulses_and_pauses_open_and_close_partly() -> None:
    """Dead for 1 ms, whole from 2 ms on: of 1.5 ms half counts as if it were 1 ms."""
    times = np.array([0.0, 0.0015, 0.010, 0.0108, 0.020, 0.023, 0.02425, 0.030])
    states = np.array([1, 0, 1, 0, 1, 0, 1, 0])
    kept, to = partly_opening_pulses(times, states, 1e-3, 2.0)
    # 1.5 ms on: 1 ms; 0.8 ms on: none; 1.25 ms off: 0.5 ms.
    assert kept == pytest.approx([0.0005, 0.0015, 0.020, 0.02375, 0.02425, 0.030])
    assert list(to) == [1, 0, 1, 0, 1, 0]
    np.testing.assert_allclose(partly_opening_pulses(times, states, 1e-3, 1.0 + 1e-9)[0],
                               without_short_pulses(times, states, 1e-3, False)[0])  # fmt: skip


def test_a_stuck_spool_moves_late_or_not_at_all() -> None:
    times, states = np.array([0.0, 0.2, 0.3, 0.5, 0.6, 0.6005]), np.array([1, 0, 1, 0, 1, 0])
    when, _ = stuck_commands(times, states, 2e-3, 0.1, 0.0)
    assert when == pytest.approx([2e-3, 0.2, 0.301, 0.5, 0.601, 0.6005])
    moved, to = drifting_movements(when, states, 2e-3, 2e-3, 0.0, 0.0, 1.0, 0)
    assert moved == pytest.approx([4e-3, 0.202, 0.303, 0.502]) and list(to) == [1, 0, 1, 0]
    when, _ = stuck_commands(times, states, 2e-3, 0.1, 1.0)
    assert when[2] - times[2] == pytest.approx(2e-3 * (1.0 - np.exp(-1.0)))


# --- Campaigns ------------------------------------------------------------------------------


def test_campaign_keeps_the_rig_file_and_lists_its_effects() -> None:
    wanted = [("inertia-mismatch", "arm-end", 1.0), ("ambient-pressure-error", "ambient", 2.0),
              ("friction-warm-up", "decay", 1.0)]  # fmt: skip
    effects = drawn_effects(4, wanted)
    stems = ("valve_discrete_a",)
    bare = make_campaign(4, size=size_of(0.3), stems=stems)
    made = make_campaign(4, size=size_of(0.3), stems=stems, effects=effects)
    assert made.rig.content == bare.rig.content and bare.truth["effects"] == []
    listed = made.truth["effects"]
    assert [e["id"] for e in listed] == [id for id, _, _ in wanted]
    assert [e["in_catalogue"] for e in listed] == [True, True, False]
    assert abs(listed[1]["values"]["ambient_pa"]) == 2e3
    pressure = made.logs[0].tests[0].columns["pressure_a_pa"][:900].mean()
    declared = bare.rig.content["air"]["atmospheric_pressure_pa"]
    assert pressure == pytest.approx(declared + listed[1]["values"]["ambient_pa"], abs=40.0)
    again = make_campaign(4, size=size_of(0.3), stems=stems, effects=effects)
    columns = made.logs[0].tests[0].columns
    assert all(np.array_equal(columns[k], v) for k, v in again.logs[0].tests[0].columns.items())


@pytest.mark.parametrize("orientation", ["horizontal", "vertical"])
@pytest.mark.parametrize("motion", ["rotary", "linear"])
def test_many_effects_together_on_every_kind_of_rig(orientation: str, motion: str) -> None:
    wanted = [("stribeck-friction", "lorentzian", 0.5), ("link-flexibility", "arm", 0.5),
              ("mounting-tilt", "sine", 0.5), ("wall-heat-transfer", "turbulent", 1.0),
              ("supply-droop", "reservoir", 1.0), ("payload-pendulum", "hanging", 0.5),
              ("inertia-mismatch", "arm-end", 0.5)]  # fmt: skip
    effects = drawn_effects(9, wanted)
    stems = ("friction_sliding", "motion_motor_2")
    made = make_campaign(
        9, size=size_of(0.3), stems=stems, orientation=orientation, motion=motion, effects=effects
    )
    bare = make_campaign(9, size=size_of(0.3), stems=stems, orientation=orientation, motion=motion)
    channel = "position_m" if motion == "linear" else "theta_rad"
    for log in made.logs:
        for test in log.tests:
            assert np.ptp(test.columns[channel]) > 0.1 * made.rig.half_travel
    one, other = (m.log("motion_motor_2").tests[0].columns[channel] for m in (made, bare))
    assert not np.array_equal(one, other)


def test_lab_size_has_the_usual_counts() -> None:
    assert size_of("lab") == LAB
    made = make_campaign(3, size=LAB, kinds=("friction-static", "friction-sliding",
                                             "friction-motion", "valve-pwm"))  # fmt: skip
    counts = {log.stem: len(log.tests) for log in made.logs}
    assert counts == {
        "friction_static": 18, "friction_sliding": 14, "valve_pwm_a": 50, "valve_pwm_b": 50
    }  # fmt: skip
    directions = [t.truth["direction"] for t in made.log("friction_sliding").tests]
    assert directions.count(1) == directions.count(-1) == 7


@pytest.mark.parametrize("form", [form for form in SAME_LAW if form.split(":")[0] in FORMS])
def test_a_form_that_is_the_catalogues_law_has_its_numbers(form: str) -> None:
    """On whatever side it was drawn; the strength that intervals are judged by is not 0."""
    name, _, law = form.partition(":")
    for seed in range(6):
        (injected,) = drawn_effects(seed, [(name, law, 0.5)])
        (effect,) = true_effects([injected.content()], REFERENCE)
        assert effect.id == name_of(name, law)
        assert getattr(effect, next(iter(SAME_LAW[form]))) != 0.0
        sides = injected.side or "both"
        assert getattr(effect, "side", sides) == sides


def test_command_line_takes_effects(tmp_path: Path) -> None:
    folder, truth = tmp_path / "campaign", tmp_path / "truth.json"
    given = ["-o", str(folder), "--seed", "16", "--size", "0.3", "--kinds", "motion-motor"]
    effects = ["--effect", "torque-saturation:soft*0.5", "--effect", "mains-hum"]
    assert main([*given, *effects, "--truth", str(truth)]) == 0
    listed = json.loads(truth.read_text())["effects"]
    assert [(e["id"], e["form"]) for e in listed] == [
        ("torque-saturation", "soft"), ("mains-hum", "sine")
    ]  # fmt: skip
    assert 0.5 / 0.75 <= listed[0]["values"]["saturation_per_nm"] <= 0.5 / 0.4
    text = (folder / "campaign.toml").read_text()
    assert "torque-saturation:soft*0.5" in text


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        (["no-such-effect"], "no effect 'no-such-effect'"),
        (["tube-lag:third-order"], "first-order, second-order"),
        (["tube-lag*much"], "'much'"),
        (["tube-lag*-1"], "0 or more"),
        (["tube-lag", "tube-lag"], "two effects set tube_lag_s"),
    ],
)
def test_command_line_refuses_effects(
    effects: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["-o", str(tmp_path / "c"), "--seed", "1", "--kinds", "valve-discrete"]
    for effect in effects:
        given += ["--effect", effect]
    with pytest.raises(SystemExit) as stopped:
        main(given)
    assert stopped.value.code == 2 and said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_effect_texts() -> None:
    assert parsed("cable-spring") == ("cable-spring", "linear", 1.0)
    assert parsed("backlash:play*0.5") == ("backlash", "play", 0.5)
    big, small = (drawn("mounting-tilt", "sine", scale) for scale in (2.0, 1.0))
    assert big.values["tilt_rad"] == 2.0 * small.values["tilt_rad"]
    assert big.values["tilt_phase_rad"] == small.values["tilt_phase_rad"]
