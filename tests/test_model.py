"""Equations, flow control, ports and valve timing of the model."""

from __future__ import annotations

import dataclasses
import subprocess
import sys
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from benchmarks.rigs import REFERENCE
from sysid.errors import InputError
from sysid.io.rig import rig_from_content
from sysid.plant import base, flow_control, plant, valve_laws, valve_timing
from sysid.plant.ports import Effect, Model, Point, join, split, stack_models

# Table 3.6.1 with the supply pressures of figures 3.7 and 3.8.
THESIS_VALVES = {
    "a": (base.ValveParameters(7.8e-4, 3.5e-4, 1.5e-6, 3.7e-9), 251e3, -0.34, -0.063),
    "b": (base.ValveParameters(1.3e-3, 3.9e-4, 1.5e-6, 3.7e-9), 243e3, -0.61, -0.159),
}


def test_importing_the_model_does_not_import_jax_or_scipy() -> None:
    code = (
        "import sys, sysid.plant, sysid.plant.base, sysid.plant.valve_timing, sysid.plant.ports;"
        "print([m for m in ('jax', 'scipy', 'torch') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


# --- equations -------------------------------------------------------------------------


def test_cylinder_effort_is_the_thesis_formula_and_zero_in_open_air() -> None:
    pa, pb, aa, ab, p0, r = 2.1e5, 1.4e5, 4.5e-4, 4.2e-4, 1e5, 0.0375
    expected = (pa * aa - pb * ab - p0 * (aa - ab)) * r
    assert base.cylinder_effort(pa, pb, aa, ab, p0, r) == pytest.approx(expected, rel=1e-12)
    assert base.cylinder_effort(p0, p0, aa, ab, p0, r) == 0.0


@pytest.mark.parametrize(
    ("velocity", "applied", "expected"),
    [
        (0.0, 0.2, 0.2),
        (0.0, -0.2, -0.2),
        (0.0, 0.5, 0.3),
        (0.0, -0.5, -0.3),
        (2.0, 0.5, 0.2 + 0.1),
        (-2.0, 0.5, -0.2 - 0.1),
    ],
)
def test_friction_law(velocity: float, applied: float, expected: float) -> None:
    assert base.friction_effort(velocity, applied, 0.3, 0.2, 0.05) == pytest.approx(expected)


def test_pressure_rate_and_flow_are_inverse_and_adiabatic() -> None:
    air = (1.4, 287.0, 293.15)
    rate = base.pressure_rate(2e5, 4e-4, 3e-5, 1e-5, *air)
    assert rate == pytest.approx(1.4 * (287.0 * 293.15 * 4e-4 - 2e5 * 1e-5) / 3e-5)
    assert base.flow_from_pressure_rate(rate, 2e5, 3e-5, 1e-5, *air) == pytest.approx(4e-4)


def test_volumes_share_the_cylinder() -> None:
    angles = np.linspace(-1.0, 1.0, 5)
    a = base.chamber_volume_a(angles, 4e-4, 0.075, 0.0375)
    b = base.chamber_volume_b(angles, 4e-4, 0.075, 0.0375)
    np.testing.assert_allclose(a + b, 2 * 0.075 * 4e-4)
    assert (np.diff(a) > 0).all()


@pytest.mark.parametrize("side", ["a", "b"])
def test_the_printed_valves_jump_at_the_choked_boundary(side: str) -> None:
    valve, supply, filling, exhaust = THESIS_VALVES[side]
    assert base.filling_jump(supply, valve.choked_fill, valve.c_fill) == pytest.approx(
        filling, abs=0.006
    )
    assert base.exhaust_jump(1e5, valve.choked_dis, valve.c_dis) == pytest.approx(
        exhaust, abs=0.0006
    )


def test_filling_law() -> None:
    pressure = np.array([1e5, 0.53 * 3e5, 0.54 * 3e5, 3e5, 3e5 + 100.0])
    flow = base.filling_flow(pressure, 3e5, 7.8e-4, 1.5e-6)
    expected = [7.8e-4, 7.8e-4, 1.5e-6 * np.sqrt(0.46 * 3e5), 0.0, -1.5e-6 * 10.0]
    np.testing.assert_allclose(flow, expected, rtol=1e-12)


def test_choked_filling_is_proportional_to_the_supply() -> None:
    at = [base.filling_flow(1e5, s, 7.8e-4, 1.5e-6, supply_reference=3e5) for s in (3e5, 4.5e5)]
    assert at[1] / at[0] == pytest.approx(1.5)


def test_exhaust_law_lets_air_in_below_the_atmosphere() -> None:
    pressure = np.array([0.9e5, 1e5, 1.5e5, 1e5 / 0.53 + 1.0, 3e5])
    flow = base.exhaust_flow(pressure, 1e5, 3.5e-4, 3.7e-9)
    np.testing.assert_allclose(flow, [3.7e-5, 0.0, -1.85e-4, -3.5e-4, -3.5e-4], rtol=1e-12)


@given(
    pressure=st.floats(1.01e5, 2.99e5),
    valve=st.floats(1e-6, 1e-5),
    control=st.floats(1e-6, 1e-5),
)
def test_both_orifices_in_series_pass_the_combined_flow(
    pressure: float, valve: float, control: float
) -> None:
    combined = flow_control.series_filling_coefficient(valve, control)
    between = flow_control.filling_intermediate_pressure(pressure, 3e5, valve, combined)
    assert pressure <= between <= 3e5
    flow = base.unchoked_filling_flow(pressure, 3e5, combined)
    assert base.unchoked_filling_flow(between, 3e5, valve) == pytest.approx(flow, rel=1e-6)
    assert base.unchoked_filling_flow(pressure, between, control) == pytest.approx(flow, rel=1e-6)
    scale = 1e-3
    both = flow_control.series_exhaust_coefficient(valve, control) * scale
    back = flow_control.exhaust_intermediate_pressure(pressure, 1e5, valve * scale, both)
    out = base.unchoked_exhaust_flow(pressure, 1e5, both)
    assert base.unchoked_exhaust_flow(back, 1e5, valve * scale) == pytest.approx(out, rel=1e-6)


def series_valve(control: float) -> base.ValveParameters:
    """A valve with flow controls of the shares `control` of its own coefficients."""
    c_fill, c_dis = 4e-6, 4e-9
    return base.ValveParameters(
        7.8e-4,
        3.5e-4,
        flow_control.series_filling_coefficient(c_fill, control * c_fill),
        flow_control.series_exhaust_coefficient(c_dis, control * c_dis),
        valve_c_fill=c_fill,
        valve_c_dis=c_dis,
    )


@given(pressure=st.floats(0.5e5, 5e5), control=st.floats(0.2, 5.0))
def test_series_choking_is_decided_between_the_orifices(pressure: float, control: float) -> None:
    """As 3.6.6 and 3.6.10 say it: by the pressure between the two, from which the boundary in the
    chamber's pressure is worked out."""
    valve = series_valve(control)
    between = (4e-6**2 * 3e5 + (control * 4e-6) ** 2 * pressure) / (4e-6**2 + (control * 4e-6) ** 2)
    assume(abs(between / (0.53 * 3e5) - 1.0) > 1e-9)
    filling = valve_laws.filling_flow(valve, pressure, 3e5)
    unchoked = base.unchoked_filling_flow(pressure, 3e5, valve.c_fill)
    assert filling == (7.8e-4 if between <= 0.53 * 3e5 else unchoked)
    between = (1e5 + control * pressure) / (1.0 + control)
    assume(abs(between * 0.53 / 1e5 - 1.0) > 1e-9)
    exhaust = valve_laws.exhaust_flow(valve, pressure, 1e5)
    unchoked = base.unchoked_exhaust_flow(pressure, 1e5, valve.c_dis)
    assert exhaust == (-3.5e-4 if between >= 1e5 / 0.53 else unchoked)


def test_a_flow_control_that_is_wide_open_leaves_the_valves_own_law() -> None:
    open_wide = series_valve(1e6)
    own = base.ValveParameters(7.8e-4, 3.5e-4, 4e-6, 4e-9)
    pressure = np.linspace(0.5e5, 3.5e5, 61)
    for law, line in ((valve_laws.filling_flow, 3e5), (valve_laws.exhaust_flow, 1e5)):
        np.testing.assert_allclose(
            law(open_wide, pressure, line), law(own, pressure, line), rtol=1e-5
        )


def test_numpy_and_jax_give_the_same() -> None:
    from sysid.plant.jax_setup import jnp

    pressure = np.linspace(0.9e5, 3.2e5, 41)
    for function, numbers in (
        (base.filling_flow, (3e5, 7.8e-4, 1.5e-6)),
        (base.exhaust_flow, (1e5, 3.5e-4, 3.7e-9)),
        (base.gravity_effort, (0.7, 0.1)),
    ):
        there = function(jnp.asarray(pressure), *numbers)
        assert type(there).__module__.startswith("jax")
        assert there.dtype == np.float64
        np.testing.assert_allclose(there, function(pressure, *numbers), rtol=1e-12, atol=1e-15)


def test_the_sine_of_other_arrays_and_its_slope_are_right_to_rounding() -> None:
    from sysid.plant.jax_setup import jax, jnp

    angle = np.concatenate(
        (np.linspace(-7.0, 7.0, 2001), np.pi * np.arange(-9.0, 10.0), [1e3, -1e3])
    )
    there, slope = jax.jvp(base.sine, (jnp.asarray(angle),), (jnp.ones_like(angle),))
    np.testing.assert_allclose(there, np.sin(angle), rtol=1e-15, atol=5e-16)
    np.testing.assert_allclose(slope, np.cos(angle), rtol=1e-15, atol=1e-15)


def _rig_content(**changes: Any) -> dict[str, Any]:
    content: dict[str, Any] = {
        "rig": {"name": "r", "orientation": "vertical"},
        "air": {
            "gas_constant_j_per_kg_k": 287.0,
            "heat_capacity_ratio": 1.4,
            "temperature_k": 293.15,
            "atmospheric_pressure_pa": 1e5,
            "supply_pressure_pa": 3e5,
        },
        "cylinder": {
            "area_a_m2": 4.5e-4,
            "area_b_m2": 4.2e-4,
            "offset_a_m": 0.075,
            "offset_b_m": 0.075,
            "stroke_m": 0.127,
            "pitch_radius_m": 0.0375,
        },
        "inertia": {
            "arm_mass_kg": 0.3,
            "arm_length_m": 0.46,
            "block_mass_kg": 0.2,
            "payload_mass_kg": 0.5,
            "payload_length_m": 0.37,
        },
    }
    return {**content, **changes}


def test_parameters_of_a_vertical_rig_with_payload() -> None:
    rig = rig_from_content(_rig_content(), "rig.toml")
    p = base.parameters_from_rig(rig, static_effort=0.3, coulomb_effort=0.2, viscous=0.05)
    inertia = 0.3 * 0.46**2 / 3 + 0.2 * 0.0375**2 + 0.5 * 0.37**2
    assert p.inertia == pytest.approx(inertia)
    assert p.gravity_moment == pytest.approx((0.3 * 0.46 / 2 + 0.5 * 0.37) * 9.81)
    assert p.weight == 0.0


def test_parameters_of_a_linear_rig() -> None:
    content = _rig_content(
        rig={"name": "r", "orientation": "vertical", "motion": "linear"},
        inertia={"mass_kg": 2.0, "payload_mass_kg": 1.0},
    )
    del content["cylinder"]["pitch_radius_m"]
    rig = rig_from_content(content, "rig.toml")
    p = base.parameters_from_rig(rig, static_effort=5.0, coulomb_effort=4.0, viscous=20.0)
    assert (p.inertia, p.pitch_radius, p.gravity_moment) == (3.0, 1.0, 0.0)
    assert base.gravity_effort(0.05, p.gravity_moment, p.weight) == pytest.approx(3.0 * 9.81)


def test_a_rig_without_a_cylinder_is_refused() -> None:
    content = _rig_content()
    del content["cylinder"]
    with pytest.raises(InputError, match="cylinder"):
        base.parameters_from_rig(
            rig_from_content(content, "rig.toml"), static_effort=1, coulomb_effort=1, viscous=0
        )


# --- ports -----------------------------------------------------------------------------


@dataclass(frozen=True)
class Everywhere(Effect):
    """Test-only: one strength through every port, and an extra state."""

    states: ClassVar[tuple[str, ...]] = ("lagged",)
    strength: Any = 0.0
    side: str = "a"

    def parameters(self, parameters: base.Parameters, time: Any) -> base.Parameters:
        return parameters.replace(temperature=parameters.temperature + self.strength * time)

    def motor_effort(self, effort: Any, point: Point) -> Any:
        return effort * (1.0 + self.strength)

    def friction_effort(self, effort: Any, point: Point) -> Any:
        return effort + self.strength * point.direction

    def static_effort(self, effort: Any, point: Point) -> Any:
        return effort + self.strength

    def external_effort(self, effort: Any, point: Point) -> Any:
        return effort - self.strength * point.position

    def pitch_radius(self, radius: Any, point: Point) -> Any:
        return radius * (1.0 + self.strength)

    def displacement(self, displacement: Any, point: Point) -> Any:
        return displacement * (1.0 + self.strength)

    def supply_pressure(self, pressure: Any, side: str, point: Point) -> Any:
        return pressure - self.strength * 1e3

    def exhaust_pressure(self, pressure: Any, side: str, point: Point) -> Any:
        return pressure + self.strength * 1e3

    def filling_flow(self, flow: Any, side: str, point: Point) -> Any:
        return flow * (1.0 - self.strength)

    def exhaust_flow(self, flow: Any, side: str, point: Point) -> Any:
        return flow * (1.0 - self.strength) if side == self.side else flow

    def chamber_flow(self, flow: Any, side: str, point: Point) -> Any:
        return flow - self.strength * 1e-10 * (point.pressure(side) - 1e5)

    def pressure_rate(self, rate: Any, side: str, flow: Any, point: Point) -> Any:
        return rate - self.strength * (point.pressure(side) - point.extra["lagged"])

    def initial_states(self, point: Point) -> dict[str, Any]:
        return {"lagged": point.pressure_a}

    def state_rates(self, point: Point, flows: Any) -> dict[str, Any]:
        return {"lagged": (point.pressure_a - point.extra["lagged"]) / 0.05}

    def delays(self, delays: Any, times: Any, opening: bool, side: str) -> Any:
        return delays + self.strength * 1e-3

    def measure(self, channels: Any, time: Any) -> dict[str, Any]:
        return {**channels, "pressure_a_pa": channels["pressure_a_pa"] * (1.0 + self.strength)}


def _point(**changes: Any) -> Point:
    values = {
        "time": 1.0,
        "position": 0.3,
        "velocity": 0.8,
        "pressure_a": 2.2e5,
        "pressure_b": 1.3e5,
        "motor": 0.2,
        "open_a": 1.0,
        "open_b": 0.0,
        "direction": 1.0,
        "parameters": REFERENCE,
        "extra": {"lagged": 2.0e5},
    }
    return Point(**{**values, **changes})


PORTS = [
    (plant.motor_effort, ()),
    (plant.applied_effort, ()),
    (plant.sliding_friction, ()),
    (plant.pitch_radius, ()),
    (plant.displacement, ()),
]
SIDED = [plant.supply_pressure, plant.exhaust_pressure, plant.volume_rate]


def _values(model: Model) -> dict[str, Any]:
    point = _point(parameters=model.at(1.0))
    found: dict[str, Any] = {f.__name__: f(point, model) for f, _ in PORTS}
    for side in "ab":
        found.update({f"{f.__name__}_{side}": f(side, point, model) for f in SIDED})
        flow = plant.discrete_flow(side, side == "b", point, model)
        found[f"flow_{side}"] = flow
        found[f"rate_{side}"] = plant.pressure_rate(side, flow, point, model)
    found["breakaway"] = plant.breakaway_effort(0.5, point, model)
    found["temperature"] = point.parameters.temperature
    return found


def test_every_port_is_the_identity_at_neutral_strength_and_acts_otherwise() -> None:
    bare, neutral = _values(Model(REFERENCE)), _values(Model(REFERENCE) + Everywhere())
    acting = _values(Model(REFERENCE) + Everywhere(0.1))
    for name, value in bare.items():
        assert neutral[name] == value, name
        assert acting[name] != value, name


def test_effects_compose_in_order() -> None:
    model = Model(REFERENCE) + Everywhere(0.5)
    model = model + dataclasses.replace(Silent(0.25))
    flow = model.through("filling_flow", 1.0, "a", _point())
    assert flow == pytest.approx(0.5 * 0.75)


@dataclass(frozen=True)
class Silent(Effect):
    """Test-only: filling flow less a share."""

    share: Any = 0.0

    def filling_flow(self, flow: Any, side: str, point: Point) -> Any:
        return flow * (1.0 - self.share)


def test_two_effects_may_not_add_the_same_state() -> None:
    with pytest.raises(ValueError, match="lagged"):
        Model(REFERENCE) + Everywhere() + Everywhere()


def test_split_and_join_are_inverse_and_stacking_needs_one_structure() -> None:
    parts = (REFERENCE, Everywhere(0.1, "b"))
    assert join(*split(parts)) == parts
    stacked = stack_models([Model(REFERENCE) + Silent(s) for s in (0.1, 0.2)])
    np.testing.assert_array_equal(stacked.effects[0].share, [0.1, 0.2])
    with pytest.raises(ValueError, match="same effects"):
        stack_models([Model(REFERENCE), Model(REFERENCE) + Silent()])


# --- valve timing ----------------------------------------------------------------------

ON, OFF = 0.0017, 0.0020


def _open(opens: list[float], closes: list[float], on: float = ON, off: float = OFF) -> Any:
    return valve_timing.delayed(np.array(opens), np.array(closes), on, off)


def test_edges_take_effect_after_their_delays() -> None:
    found = _open([1.0], [4.0])
    np.testing.assert_allclose([found.opens, found.closes], [[1.0017], [4.002]])


def test_a_gap_too_short_never_closes_the_valve() -> None:
    found = _open([1.0, 1.5 + 0.00029], [1.5, 2.0])
    np.testing.assert_allclose([found.opens, found.closes], [[1.0017], [2.002]])
    assert len(_open([1.0, 1.5 + 0.00031], [1.5, 2.0]).opens) == 2


def test_a_pulse_too_short_never_opens_the_valve() -> None:
    assert len(_open([1.0], [1.00025], on=0.002, off=0.0017).opens) == 0
    assert len(_open([1.0], [1.00035], on=0.002, off=0.0017).opens) == 1


def test_the_duty_in_force_when_a_period_starts_holds_for_it() -> None:
    time = 10.0 + np.arange(20) / 1000.0
    duty = np.where(np.arange(20) < 7, 0.5, 0.2)  # changes within the second period
    on, off = valve_timing.pwm_intervals(time, duty, 0.005)
    np.testing.assert_allclose(on, 10.0 + np.array([0.0, 0.005, 0.010, 0.015]))
    np.testing.assert_allclose(off - on, [0.0025, 0.0025, 0.001, 0.001], atol=1e-12)


def test_full_and_zero_duty_have_no_edges_in_between() -> None:
    time = np.arange(0, 100) / 1000.0
    duty = np.where(time < 0.0499, 1.0, 0.0)
    on, off = valve_timing.pwm_intervals(time, duty, 0.005)
    np.testing.assert_allclose([on, off], [[0.0], [0.05]])


def test_a_valve_that_was_on_before_the_first_row_stays_on_until_it_is_closed() -> None:
    time = np.arange(0, 10) / 1000.0
    on, off = valve_timing.switched_intervals(time, np.zeros(10), starts_on=True)
    found = valve_timing.delayed(on, off, ON, OFF)
    assert found.is_open(np.array([0.0, 0.0019, 0.0021])).tolist() == [True, True, False]


@settings(max_examples=60)
@given(
    duties=st.lists(st.floats(0.0, 1.0), min_size=3, max_size=12),
    on=st.floats(0.0, 0.004),
    off=st.floats(0.0, 0.004),
)
def test_open_time_matches_a_valve_stepped_through_its_edges(
    duties: list[float], on: float, off: float
) -> None:
    period, rows = 0.005, 5
    time = np.arange(len(duties) * rows) / 1000.0
    opens, closes = valve_timing.pwm_intervals(time, np.repeat(duties, rows), period)
    found = valve_timing.delayed(opens, closes, on, off)
    # Edge by edge: one that overtakes the one before it takes it back.
    queue: list[tuple[float, bool]] = []
    for start, end in zip(opens, closes, strict=True):
        for at, is_open in ((start + on, True), (end + off, False)):
            if queue and at - queue[-1][0] <= valve_timing.TIME_TOLERANCE:
                queue.pop()
            else:
                queue.append((at, is_open))
    np.testing.assert_allclose(found.opens, [t for t, o in queue if o], atol=1e-12)
    np.testing.assert_allclose(found.closes, [t for t, o in queue if not o], atol=1e-12)
    whole = found.open_time(np.array([-1.0]), np.array([1.0]))[0]
    assert whole == pytest.approx((found.closes - found.opens).sum(), abs=1e-12)


def test_open_fraction_of_a_sample_is_exact() -> None:
    found = _open([0.0], [0.0025])
    starts = np.arange(6) / 1000.0
    fraction = found.open_fraction(starts, starts + 1e-3)
    np.testing.assert_allclose(fraction, [0.0, 0.3, 1.0, 1.0, 0.5, 0.0], atol=1e-9)


def test_time_open_between_bounds_is_that_of_each_pair() -> None:
    rng = np.random.default_rng(2)
    edges = np.sort(rng.uniform(-0.1, 1.1, 60))
    found = valve_timing.OpenIntervals(edges[::2], edges[1::2])
    # Some bounds lie on edges.
    bounds = np.sort(np.concatenate([rng.uniform(0.0, 1.0, 200), edges[5:15]]))
    each = found.open_time(bounds[:-1], bounds[1:])
    np.testing.assert_allclose(found.between(bounds), each, atol=1e-12)
    never = valve_timing.OpenIntervals(np.zeros(0), np.zeros(0))
    np.testing.assert_array_equal(never.between(bounds), np.zeros(len(bounds) - 1))


def test_the_grid_splits_samples_at_edges_and_at_the_longest_step() -> None:
    time = np.arange(4) / 250.0
    grid = valve_timing.split_at(time, np.array([0.0005, 0.004, 0.00402]), 1e-3)
    assert grid.duration.max() <= 1e-3 * (1 + 1e-6)
    ends = grid.start + grid.duration
    np.testing.assert_allclose(ends[grid.ends_sample], time[1:], atol=1e-12)
    np.testing.assert_allclose(grid.start[1:], ends[:-1], atol=1e-12)
    for edge in (0.0005, 0.004, 0.00402):
        assert np.abs(grid.start - edge).min() < 1e-12
    np.testing.assert_array_equal(grid.row, np.searchsorted(time, grid.start + 1e-9) - 1)


@settings(max_examples=60)
@given(
    edges=st.lists(
        st.one_of(
            st.floats(-0.01, 0.05),
            st.sampled_from([-np.inf, 0.0, 0.004, 0.004 + 5e-10, 0.008 - 5e-10, 0.02, np.inf]),
        ),
        min_size=0,
        max_size=12,
    ),
    jitter=st.floats(0.0, 3e-4),
)
def test_the_grid_has_every_row_and_edge(edges: list[float], jitter: float) -> None:
    rows = np.arange(11) * 2e-3
    time = 5.0 + rows + jitter * np.sin(rows * 1e4) * (rows > 0)
    ordered = np.array(sorted(edges)) + 5.0
    grid = valve_timing.split_at(time, ordered, 1e-3)
    middle = time[0] + grid.start + 0.5 * grid.duration
    for edge in ordered[(ordered > time[0]) & (ordered < time[-1])]:
        assert np.abs(time[0] + grid.start - edge).min() <= 12e-9
    assert grid.duration.min() > 0.0
    assert grid.duration.sum() == pytest.approx(time[-1] - time[0])
    np.testing.assert_array_equal(grid.row, np.searchsorted(time, middle) - 1)
    assert grid.ends_sample.sum() == len(time) - 1
