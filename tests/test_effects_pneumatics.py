"""Effects of chambers, valves, supply and sensors: neutral to the last bit, closed forms."""

from __future__ import annotations

import dataclasses
import functools
import itertools
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.signal import lsim

from benchmarks.rigs import REFERENCE, random_runs
from sysid.plant import base
from sysid.plant.effects import chamber, sensor, supply, valve
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model, Point, join, split
from sysid.plant.simulator import Inputs, Trajectory, ValveCommand, open_intervals, simulate

MODULES = (chamber, valve, supply, sensor)
EFFECTS = [effect for module in MODULES for effect in module.EFFECTS]
IDS = [effect.id for effect in EFFECTS]
STATES = ("position", "velocity", "pressure_a", "pressure_b")
STEPPING_PA = 0.1
# Shapes that are screened at their usual value alone: a fit bends them from there.
BENT_BY_FITS = {"stroke_share", "second_order_share"}
PER_FLOW = 1.4 * 287.0 * 293.15 / (REFERENCE.offset_a * REFERENCE.area_a)
HELD = REFERENCE.replace(static_effort=1e6)  # nothing can move the piston
NO_VALVES = {
    f"{k}_{s}": 0.0 for k in ("choked_fill", "choked_dis", "c_fill", "c_dis") for s in "ab"
}


def forms(effect: type[CatalogueEffect]) -> list[CatalogueEffect]:
    """The effect at neutral strength in every shape of its grids, on every side."""
    axes: dict[str, tuple[Any, ...]] = {q.name: q.grid for q in effect.shapes()}
    if effect.has_side():
        axes["side"] = ("a", "b", "both")
    rows = itertools.product(*axes.values())
    return [effect.neutral(**dict(zip(axes, row, strict=True))) for row in rows]


def random_point(shape: tuple[int, ...], seed: int = 0, **changes: Any) -> Point:
    """Anywhere, also above the supply and below the atmosphere; valves on, off or between."""
    rng = np.random.default_rng(seed)
    values: dict[str, Any] = {
        "time": rng.uniform(0, 60, shape),
        "position": rng.uniform(-1.6, 1.6, shape),
        "velocity": rng.uniform(-5, 5, shape),
        "pressure_a": rng.uniform(0.8e5, 3.3e5, shape),
        "pressure_b": rng.uniform(0.8e5, 3.3e5, shape),
        "motor": rng.uniform(-0.8, 0.8, shape),
        "open_a": rng.choice([0.0, 0.3, 1.0], shape),
        "open_b": rng.choice([0.0, 0.3, 1.0], shape),
        "direction": rng.choice([-1.0, 0.0, 1.0], shape),
        "parameters": REFERENCE,
    }
    # On the discontinuities too.
    for value, name in zip((3e5, 1e5, 0.53 * 3e5, 1e5 / 0.53), ("pressure_a",) * 4, strict=True):
        values[name].flat[rng.integers(values[name].size)] = value
    extra = {
        **{f"wall_log_temperature_{s}": rng.uniform(-0.5, 0.4, shape) for s in "ab"},
        **{f"tube_flow_{s}": rng.uniform(-4e-4, 1e-3, shape) for s in "ab"},
    }
    return Point(**values | {"extra": extra} | changes)


def before(point: Point) -> dict[str, Any]:
    """A value for every port of the plant, by port and side."""
    rng = np.random.default_rng(7)
    sizes = {
        "filling_flow": 1e-3,
        "exhaust_flow": -4e-4,
        "chamber_flow": 5e-4,
        "pressure_rate": 1e6,
        "supply_pressure": 3e5,
        "exhaust_pressure": 1e5,
    }
    return {
        f"{port}_{side}": size * rng.uniform(0.5, 1.0, point.time.shape)
        for port, size in sizes.items()
        for side in "ab"
    }


def after(effect: CatalogueEffect, point: Point, given: dict[str, Any]) -> dict[str, Any]:
    """The same values, and the parameters, behind the effect's ports."""
    found = {}
    for name, value in given.items():
        port, side = name[:-2], name[-1]
        context = (side, 1e-4, point) if port == "pressure_rate" else (side, point)
        found[name] = getattr(effect, port)(value, *context)
    return found | vars(effect.parameters(point.parameters, point.time))


def same(found: dict[str, Any], given: dict[str, Any], where: str) -> None:
    expected = given | vars(REFERENCE)
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        wanted = np.broadcast_to(value, np.shape(found[name]))
        np.testing.assert_array_equal(np.asarray(found[name]), wanted, err_msg=f"{where}: {name}")


# --- the entries -----------------------------------------------------------------------


@pytest.mark.parametrize("effect", EFFECTS, ids=IDS)
def test_the_entry_is_whole(effect: type[CatalogueEffect]) -> None:
    fields = {f.name: f.default for f in dataclasses.fields(effect)}
    assert effect.strengths()
    assert {q.name for q in effect.quantities} | ({"side"} & fields.keys()) == fields.keys()
    for q in effect.quantities:
        assert fields[q.name] == (0.0 if q.is_strength else q.typical)
        assert q.lower <= (0.0 if q.is_strength else q.typical) <= q.upper
        assert q.lower <= q.typical <= q.upper and (q.typical != 0.0 or not q.is_strength)
        assert all(q.lower <= g <= q.upper for g in q.grid)
        assert q.is_strength or len(q.grid) >= 2 or q.name in BENT_BY_FITS
    assert effect.signature and effect.source and effect.title
    assert bool(effect.rivals) == bool(effect.tie_breaker) or effect.id == "encoder-eccentricity"
    assert effect.id not in effect.rivals


# --- neutral ---------------------------------------------------------------------------


@pytest.mark.parametrize("effect", EFFECTS, ids=IDS)
@pytest.mark.parametrize("shape", [(500,), (6, 7)])
def test_neutral_ports_change_no_bit(effect: type[CatalogueEffect], shape: tuple[int, ...]) -> None:
    point = random_point(shape)
    given = before(point)
    for form in forms(effect):
        same(after(form, point, given), given, str(form))


def test_neutral_ports_change_no_bit_in_jax() -> None:
    from sysid.plant.jax_setup import jax

    point = random_point((300,))
    given = before(point)
    structure, numbers = split(tuple(form for effect in EFFECTS for form in forms(effect)[-1:]))

    @jax.jit
    def compiled(numbers: Any, given: Any, fields: dict[str, Any]) -> Any:
        at = dataclasses.replace(point, **fields)
        return [after(effect, at, given) for effect in join(structure, numbers)]

    names = ("position", "velocity", "pressure_a", "pressure_b", "open_a", "open_b", "extra")
    fields = {name: getattr(point, name) for name in names}
    for effect, found in zip(EFFECTS, compiled(numbers, given, fields), strict=True):
        same(found, given, effect.id)


@pytest.mark.parametrize("effect", EFFECTS, ids=IDS)
def test_neutral_timing_and_sensors_change_no_bit(effect: type[CatalogueEffect]) -> None:
    rng = np.random.default_rng(3)
    edges = np.concatenate(([-np.inf], np.cumsum(rng.uniform(1e-6, 5e-3, 400)), [np.inf]))
    time = np.cumsum(rng.uniform(1e-4, 3e-3, 500))
    names = ("theta_rad", "pressure_a_pa", "pressure_b_pa")
    channels = {name: rng.uniform(1e5, 3e5, 500) for name in names}
    for form in forms(effect):
        for found, given in zip(
            form.pulses(edges[0::2], edges[1::2], "a"), (edges[0::2], edges[1::2]), strict=True
        ):
            np.testing.assert_array_equal(found, given)
        for opening in (True, False):
            delays = rng.uniform(0, 3e-3, len(edges))
            np.testing.assert_array_equal(form.delays(delays, edges, opening, "b"), delays)
        shown = form.measure(channels, time)
        for name, values in channels.items():
            np.testing.assert_array_equal(shown[name], values)
        assert form.measure({"force_n": time}, time).keys() == {"force_n"}


def whole(parameters: base.Parameters, *acting: CatalogueEffect) -> Model:
    """The model with every effect, those given in place of the neutral ones: one compilation."""
    given = {type(effect): effect for effect in acting}
    model = Model(parameters)
    for effect in EFFECTS:
        model = model + given.get(effect, effect.neutral())
    return model


def whole_by_sides(parameters: base.Parameters, acting: CatalogueEffect) -> Model:
    """As `whole`, but what has a side is there twice: acting on either, it is one compilation."""
    model = Model(parameters)
    for effect in EFFECTS:
        for side in "ab" if effect.has_side() else ("",):
            own = type(acting) is effect and getattr(acting, "side", "") == side
            given = {"side": side} if side else {}
            model = model + (acting if own else effect.neutral(**given))
    return model


def one(inputs: Inputs, model: Model) -> Trajectory:
    return simulate([inputs], [model])[0]


def test_all_effects_at_neutral_strength_simulate_as_the_base_model() -> None:
    inputs, models = random_runs(seed=4, count=1, seconds=0.6)
    bare = one(inputs[0], models[0])
    neutral = one(inputs[0], whole(models[0].parameters))
    for name in STATES:
        np.testing.assert_array_equal(getattr(neutral, name), getattr(bare, name), err_msg=name)


# --- acting ----------------------------------------------------------------------------

TIME = np.arange(801) * 1e-3


def command(on: float, off: float) -> ValveCommand:
    return ValveCommand(np.heaviside(TIME - on, 1.0) - np.heaviside(TIME - off, 1.0))


def switched(**changes: Any) -> Inputs:
    """Valve A on until 0.4 s, valve B from 0.1 to 0.3 s."""
    values: dict[str, Any] = {"valve_a": command(0.0, 0.4), "valve_b": command(0.1, 0.3)}
    return Inputs(TIME, 0.0 * TIME, **values | changes)


def shown(run: Trajectory, model: Model) -> dict[str, Any]:
    channels = {
        "theta_rad": run.position,
        "pressure_a_pa": run.pressure_a,
        "pressure_b_pa": run.pressure_b,
    }
    for effect in model.effects:
        channels = effect.measure(channels, run.time)
    return channels


@functools.cache
def bare_run() -> Trajectory:
    return one(switched(), whole(HELD))


# One needs short pulses to show, the other motion: the piston is held here.
_ELSEWHERE = (valve.DutyDeadZone, sensor.LostCounts)


@pytest.mark.parametrize("effect", [e for e in EFFECTS if e not in _ELSEWHERE])
@pytest.mark.parametrize("side", ["a", "b"])
def test_at_typical_size_it_shows_and_on_its_own_side_only(
    effect: type[CatalogueEffect], side: str
) -> None:
    acting = effect.typical(**({"side": side} if effect.has_side() else {}))
    model = whole_by_sides(HELD, acting)
    run = one(switched(), model)
    channels, bare = shown(run, model), bare_run()
    assert np.isfinite([*channels.values()]).all()
    changed_a = np.abs(channels["pressure_a_pa"] - bare.pressure_a).max()
    changed_b = np.abs(channels["pressure_b_pa"] - bare.pressure_b).max()
    if effect is sensor.EncoderEccentricity:
        expected = bare.position + 7e-4 * np.sin(bare.position) + 7e-4 * np.cos(bare.position)
        np.testing.assert_array_equal(channels["theta_rad"], expected)
        assert changed_a == changed_b == 0.0
        return
    # A delay that drifts over 20 s, and air that warms by 0.17 K/s, show little in 0.8 s.
    least = 1.0 if effect in (valve.CoilHeating, chamber.TemperatureDrift) else 100.0
    for changed, own in ((changed_a, side == "a"), (changed_b, side == "b")):
        # The other side may be stepped at other instants, no more.
        assert changed > least if own or not effect.has_side() else changed < STEPPING_PA


@pytest.mark.parametrize("effect", EFFECTS, ids=IDS)
def test_at_its_bounds_it_stays_finite(effect: type[CatalogueEffect]) -> None:
    for limits in ("lower", "upper"):
        strengths = {q.name: getattr(q, limits) for q in effect.strengths()}
        run = one(switched(), whole(HELD, effect.typical(**strengths)))
        for name in STATES:
            assert np.isfinite(getattr(run, name)).all()
        assert run.pressure_a.min() > 0.7e5 and run.pressure_a.max() < 3.5e5


def test_two_sides_may_differ() -> None:
    first, second = (chamber.WallHeatTransfer(0.4, side) for side in "ab")
    model = Model(HELD) + first + second
    assert model.state_names == ("wall_log_temperature_a", "wall_log_temperature_b")
    assert dataclasses.replace(first, side="both").states == model.state_names


# --- chambers --------------------------------------------------------------------------


def pulse(length: float, **changes: Any) -> Inputs:
    """Valve A on for a while from the first row; B closed."""
    return switched(valve_a=command(0.0, length), valve_b=None, **changes)


def test_exponent_and_dead_volume_scale_the_choked_rise() -> None:
    since = np.maximum(TIME - HELD.on_delay_a, 0.0)
    early = TIME <= 0.02
    for effect, factor in (
        (chamber.PolytropicExponent(-0.1), 1.3 / 1.4),
        (chamber.DeadVolumeError(0.003, "a"), 0.075 / 0.078),
        (chamber.DeadVolumeError(0.003, "b"), 1.0),
    ):
        run = one(pulse(0.4), whole_by_sides(HELD, effect))
        expected = 1e5 + factor * PER_FLOW * HELD.choked_fill_a * since
        np.testing.assert_allclose(run.pressure_a[early], expected[early], rtol=1e-9)


def test_temperature_drift_scales_the_flow_with_time() -> None:
    run = one(pulse(0.4), whole(HELD, chamber.TemperatureDrift(0.5)))
    early = (TIME > 0.002) & (TIME <= 0.02)
    on, end = HELD.on_delay_a, TIME[early]
    drifted = (end - on) + 0.5 / 293.15 * (end**2 - on**2) / 2
    expected = 1e5 + PER_FLOW * HELD.choked_fill_a * drifted
    # Within a step the simulator takes the parameters at its start.
    np.testing.assert_allclose(run.pressure_a[early], expected, atol=0.1)


@pytest.mark.parametrize("tau", [0.5, 4.0, 300.0])
def test_a_temperature_that_settles_has_a_decaying_slope(tau: float) -> None:
    for time in (0.0, 0.3, 7.0, 200.0):
        rise = quad(lambda t: 0.4 * np.exp(-t / tau), 0.0, time, epsabs=1e-12, limit=200)[0]
        found = chamber.TemperatureDrift(0.4, tau).parameters(HELD, time).temperature
        np.testing.assert_allclose(found, HELD.temperature + rise, rtol=1e-12)


def test_a_temperature_that_never_settles_is_the_older_law_to_the_last_bit() -> None:
    time = np.linspace(0.0, 600.0, 301)
    drifted = chamber.TemperatureDrift(0.2).parameters(HELD, time).temperature
    np.testing.assert_array_equal(drifted, HELD.temperature + 0.2 * time)
    cold = chamber.TemperatureDrift(-5.0).parameters(HELD, 1e4).temperature
    assert cold == 0.5 * HELD.temperature


@pytest.mark.parametrize("conductance", [0.1, 0.4, 2.0])
def test_after_a_fill_heat_leads_to_the_isothermal_pressure(conductance: float) -> None:
    # Nothing leaves the chamber: the mass is what the choked flow brought, in 17 ms.
    tight = HELD.replace(choked_dis_a=0.0, c_dis_a=0.0, off_delay_a=HELD.on_delay_a)
    run = one(pulse(0.017), whole(tight, chamber.WallHeatTransfer(conductance)))
    brought = tight.choked_fill_a * 0.017
    isothermal = 1e5 + brought * 287.0 * 293.15 / (tight.offset_a * tight.area_a)
    peak = 1e5 + 1.4 * (isothermal - 1e5)
    assert isothermal < run.pressure_a.max() < peak
    # The closed chamber cools as m cv dT/dt = -h (T - T0).
    mass = 1e5 * tight.offset_a * tight.area_a / (287.0 * 293.15) + brought
    rate = conductance * 0.4 / (mass * 287.0)
    closed = TIME >= 0.019
    above = run.pressure_a[closed] - isothermal
    expected = above[0] * np.exp(-rate * (TIME[closed] - TIME[closed][0]))
    np.testing.assert_allclose(above, expected, atol=0.02)


def test_compressed_gas_heats_up_as_an_adiabat() -> None:
    # dz/dt at no flow and no heat is (1-k) dlnV/dt, so Tg V^(k-1) is constant.
    point = random_point((20,))
    effect = chamber.WallHeatTransfer()
    rates = effect.state_rates(point, {"a": 0.0, "b": 0.0})
    for side in "ab":
        stretch = chamber.volume_rate(side, point) / chamber.chamber_volume(side, point)
        np.testing.assert_allclose(rates[f"wall_log_temperature_{side}"], -0.4 * stretch)


def test_a_turbulent_wall_warms_denser_gas_more() -> None:
    """Its conductance grows by a power of the pressure over the atmosphere's."""
    ratio = np.array([1.0, 2.0, 3.0])
    states = {f"wall_log_temperature_{side}": np.full(3, -0.1) for side in "ab"}
    point = dataclasses.replace(at_pressure(ratio * HELD.atmosphere, 0.0), extra=states)
    heats = [
        chamber.WallHeatTransfer(0.4, density_exponent=e).pressure_rate(0.0, "a", 0.0, point)
        for e in (0.0, 0.8)
    ]
    np.testing.assert_allclose(heats[1] / heats[0], ratio**0.8, rtol=1e-12)


@pytest.mark.parametrize("lag", [1.5e-3, 6e-3])
def test_tube_lag_is_a_first_order_lag_of_the_flow(lag: float) -> None:
    run = one(pulse(0.4), whole(HELD, chamber.TubeLag(lag)))
    since = np.maximum(TIME - HELD.on_delay_a, 0.0)
    behind = since + lag * np.expm1(-since / lag)
    early = TIME <= 0.02
    expected = 1e5 + PER_FLOW * HELD.choked_fill_a * behind
    np.testing.assert_allclose(run.pressure_a[early], expected[early], atol=60.0)


def test_a_tube_lag_below_the_step_is_right_to_first_order() -> None:
    run = one(pulse(0.4), whole(HELD, chamber.TubeLag(3e-4)))
    at = 20
    lost = PER_FLOW * HELD.choked_fill_a * 3e-4
    assert bare_run().pressure_a[at] - run.pressure_a[at] == pytest.approx(lost, rel=1e-3)


def test_what_leaks_after_the_tube_is_not_lagged() -> None:
    point = random_point((50,))
    leak, tube = chamber.AtmosphereLeakage(5e-17), chamber.TubeLag(2e-3)
    flow = before(point)["chamber_flow_a"]
    both = leak.chamber_flow(tube.chamber_flow(flow, "a", point), "a", point)
    apart = tube.chamber_flow(flow, "a", point) + (leak.chamber_flow(flow, "a", point) - flow)
    np.testing.assert_allclose(both, apart, rtol=1e-12, atol=1e-18)


def test_a_closed_chamber_leaks_by_its_closed_form() -> None:
    closed = HELD.replace(**NO_VALVES)
    leak = 7e-15
    start = switched(pressure_a=3e5, pressure_b=1e5)
    run = one(start, whole_by_sides(closed, chamber.AtmosphereLeakage(leak, "a")))
    ratio = 0.5 * np.exp(-2.0 * 1e5 * PER_FLOW * leak * TIME)  # (P - P0) / (P + P0)
    expected = 1e5 * (1 + ratio) / (1 - ratio)
    np.testing.assert_allclose(run.pressure_a, expected, rtol=1e-6)
    np.testing.assert_array_equal(run.pressure_b, 1e5)


def test_a_closed_chamber_leaks_to_its_threshold() -> None:
    """Plugged, its excess over the threshold decays exponentially; below it nothing leaks."""
    closed = HELD.replace(**NO_VALVES)
    leak, threshold = 4e-9, 1.6e5
    effect = chamber.ThresholdLeakage(leak, threshold)
    run = one(switched(pressure_a=2.6e5, pressure_b=1.4e5), whole(closed, effect))
    expected = threshold + 1e5 * np.exp(-PER_FLOW * leak * TIME)
    np.testing.assert_allclose(run.pressure_a, expected, rtol=1e-6)
    np.testing.assert_array_equal(run.pressure_b, 1.4e5)


def test_what_passes_the_piston_is_lost_on_one_side_and_gained_on_the_other() -> None:
    closed = HELD.replace(**NO_VALVES)
    start = switched(pressure_a=3e5, pressure_b=1e5)
    run = one(start, whole(closed, chamber.PistonLeakage(7e-15)))
    held = run.pressure_a * HELD.area_a + run.pressure_b * HELD.area_b
    np.testing.assert_allclose(held, held[0], rtol=1e-9)
    squares = run.pressure_a**2 - run.pressure_b**2
    lost = PER_FLOW * 7e-15 * np.trapezoid(squares, TIME)
    assert 3e5 - run.pressure_a[-1] == pytest.approx(lost, rel=1e-3)
    assert run.pressure_a[-1] == pytest.approx(run.pressure_b[-1], rel=1e-3)


def test_what_leaks_in_proportion_to_the_pressure() -> None:
    """Between the chambers, or out of one: each decays exponentially while all is shut."""
    closed, leak = HELD.replace(**NO_VALVES), 2e-9
    start = switched(pressure_a=3e5, pressure_b=1.5e5)
    one_side = one(start, whole_by_sides(closed, chamber.LaminarLeakage(leak, "a")))
    left = 2e5 * np.exp(-PER_FLOW * leak * TIME)
    np.testing.assert_allclose(one_side.pressure_a, 1e5 + left, rtol=1e-6)
    np.testing.assert_array_equal(one_side.pressure_b, 1.5e5)
    between = one(start, whole(closed, chamber.LaminarLeakage(leak)))
    held = between.pressure_a * HELD.area_a + between.pressure_b * HELD.area_b
    np.testing.assert_allclose(held, held[0], rtol=1e-9)
    apart = between.pressure_a - between.pressure_b
    rate = PER_FLOW * (1.0 + HELD.area_a / HELD.area_b) * leak
    np.testing.assert_allclose(apart, 1.5e5 * np.exp(-rate * TIME), rtol=1e-5)


# --- valves ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("ratio", "critical", "exponent", "share"),
    [
        (0.0, 0.3, 0.5, 1.0),
        (0.3, 0.3, 0.5, 1.0),
        (0.5, 0.3, 0.5, 0.9583148474999099),  # sqrt(1 - (2/7)^2)
        (0.9, 0.5, 0.5, 0.6),  # sqrt(1 - 0.8^2)
        (0.9, 0.5, 1.0, 0.36),
        (1.0, 0.3, 0.5, 0.0),
    ],
)
def test_iso_6358(ratio: float, critical: float, exponent: float, share: float) -> None:
    assert valve.iso6358_share(ratio, critical, exponent) == pytest.approx(share, abs=1e-15)


def at_pressure(pressure: Any, is_open: float) -> Point:
    pressures = np.asarray(pressure, dtype=float)
    ones = np.ones_like(pressures)
    return random_point(
        pressures.shape,
        pressure_a=pressures,
        pressure_b=1e5 * ones,
        open_a=is_open * ones,
        open_b=0.0 * ones,
    )


def base_flow(point: Point) -> Any:
    return chamber.base_valve_flow("a", point)


def test_a_whole_blend_is_isos_law_and_half_of_it_lies_midway() -> None:
    pressure = np.linspace(1.0e5, 3.2e5, 23)
    filling, exhaust = at_pressure(pressure, 1.0), at_pressure(pressure, 0.0)
    full, half = valve.SubsonicFlowShape(1.0, 1.0), valve.SubsonicFlowShape(0.5, 0.5)
    law = full.filling_flow(base_flow(filling), "a", filling)
    forward = pressure < 3e5
    expected = 7.8e-4 * valve.iso6358_share(pressure / 3e5, 0.3, 0.5)
    np.testing.assert_allclose(law[forward], expected[forward], rtol=1e-12)
    np.testing.assert_array_equal(law[~forward], base_flow(filling)[~forward])
    midway = half.filling_flow(base_flow(filling), "a", filling)
    np.testing.assert_allclose(midway, 0.5 * (law + base_flow(filling)))
    out = full.exhaust_flow(base_flow(exhaust), "a", exhaust)
    expected = -3.5e-4 * valve.iso6358_share(1e5 / pressure, 0.3, 0.5)
    np.testing.assert_allclose(out, expected, rtol=1e-12)


def test_scaled_choked_exhaust_is_proportional_to_pressure_and_continuous() -> None:
    boundary = 1e5 / 0.53
    above = at_pressure([boundary * 1.0001, 2.5e5, 3e5], 0.0)
    law = valve.ChokedExhaustScaling(1.0).exhaust_flow(base_flow(above), "a", above)
    np.testing.assert_allclose(law, -3.5e-4 * above.pressure_a / boundary, rtol=1e-12)
    below = at_pressure([0.9e5, 1.2e5, boundary * 0.9999], 0.0)
    unchanged = valve.ChokedExhaustScaling(1.0).exhaust_flow(base_flow(below), "a", below)
    np.testing.assert_array_equal(unchanged, base_flow(below))


def test_delays_move_the_edges_of_their_valve() -> None:
    inputs = switched()
    model = Model(HELD) + valve.ValveDelay(5e-4, -3e-4, "a")
    a, b = (open_intervals(inputs, side, model) for side in "ab")
    np.testing.assert_allclose([a.opens[0], a.closes[0]], [0.0022, 0.4017])
    np.testing.assert_allclose([b.opens[0], b.closes[0]], [0.1017, 0.302])


def test_heated_coils_switch_later() -> None:
    heated = valve.CoilHeating(5e-4, -2e-4, 20.0)
    times = np.array([-np.inf, 0.0, 20.0, np.inf])
    grown = 1.0 - np.exp([0.0, 0.0, -1.0, -np.inf])
    for opening, drift in ((True, 5e-4), (False, -2e-4)):
        found = heated.delays(np.full(4, 2e-3), times, opening, "a")
        np.testing.assert_allclose(found, 2e-3 + drift * grown)


@pytest.mark.parametrize(
    ("pulses", "kept"),
    [
        ([(0.0, 0.5), (5.0, 7.0)], [(5.0, 7.0)]),  # a short pulse
        ([(0.0, 4.5), (5.0, 7.0)], [(0.0, 7.0)]),  # a short pause
        ([(0.0, 0.5), (1.0, 1.5)], []),
        ([(0.0, 1.0), (5.0, 6.0)], [(0.0, 1.0), (5.0, 6.0)]),  # just long enough
        ([(-np.inf, 0.0), (0.5, 0.9)], [(-np.inf, 0.9)]),
        ([(0.0, 3.0), (3.2, np.inf)], [(0.0, np.inf)]),
        ([], []),
    ],
)
def test_a_dead_zone_swallows_short_pulses_and_pauses(pulses: Any, kept: Any) -> None:
    on, off = np.array(pulses, dtype=float).reshape(-1, 2).T * 1e-3
    dead = valve.DutyDeadZone(1e-3, "a")
    found = np.column_stack(dead.pulses(on, off, "a"))
    np.testing.assert_array_equal(found, np.array(kept, dtype=float).reshape(-1, 2) * 1e-3)
    np.testing.assert_array_equal(dead.pulses(on, off, "b"), (on, off))


@pytest.mark.parametrize(
    ("pulses", "kept"),
    [
        ([(0.0, 1.5), (5.0, 7.0)], [(0.5, 1.5), (5.0, 7.0)]),  # half of the range: 2 of 2 ms
        ([(0.0, 5.0), (6.25, 9.0)], [(0.0, 5.75), (6.25, 9.0)]),  # it closes only partly
        ([(0.0, 0.8), (5.0, 6.1)], [(5.9, 6.1)]),
        ([(-np.inf, 5.0), (6.9, np.inf)], [(-np.inf, 5.1), (6.9, np.inf)]),
        ([(0.0, 3.0), (3.2, 3.4), (3.6, 4.0)], [(0.0, 4.0)]),
    ],
)
def test_a_valve_that_opens_partly_follows_late(pulses: Any, kept: Any) -> None:
    """Dead for 1 ms, whole from 2 ms on: what is left grows from none at 1 ms to all at 2 ms."""
    on, off = np.array(pulses, dtype=float).T * 1e-3
    found = np.column_stack(valve.DutyDeadZone(1e-3, "a", 2.0).pulses(on, off, "a"))
    np.testing.assert_allclose(found, np.array(kept) * 1e-3, rtol=1e-12, atol=1e-15)


def test_a_valve_that_closes_in_any_pause_loses_short_pulses_only() -> None:
    on, off = np.array([0.0, 4.8, 7.0, 9.0]) * 1e-3, np.array([4.5, 6.8, 7.9, 9.0]) * 1e-3
    for ratio, kept in (
        (0.0, [(0.0, 4.5), (4.8, 6.8)]),
        (0.25, [(0.0, 4.5), (4.8, 7.9)]),
        (0.35, [(0.0, 7.9)]),
    ):
        found = np.column_stack(valve.DutyDeadZone(1e-3, "a", 1.0, ratio).pulses(on, off, "a"))
        np.testing.assert_allclose(found, np.array(kept) * 1e-3, rtol=1e-12)


def test_partial_opening_makes_the_open_time_continuous_in_the_duty() -> None:
    zone = valve.DutyDeadZone(1e-3, "both", 1.7)
    lengths = np.linspace(0.0, 3e-3, 3001)
    left = [float(np.sum(o - i)) for i, o in (zone.pulses([0.0], [w], "a") for w in lengths)]
    slope = np.diff(left) / np.diff(lengths)
    expected = np.where(lengths < 1e-3, 0.0, np.where(lengths < 1.7e-3, 1.7 / 0.7, 1.0))
    np.testing.assert_allclose(slope[5:], expected[5:-1], atol=1.5)
    assert left[-1] == lengths[-1] and np.max(np.diff(left)) < 3e-6


def test_a_rested_valve_opens_late_and_by_less_the_shorter_it_rested() -> None:
    effect = valve.StickingValve(2e-3, 0.1, "a")
    on = np.array([0.0, 0.3, 0.51, 0.5206])
    off = np.array([0.2, 0.5, 0.5205, 0.5209])
    later, same = effect.pulses(on, off, "a")
    rests = np.array([np.inf, 0.1, 0.01, 1e-4])
    expected = [2e-3, 2e-3 * 0.5, 2e-3 / 11.0, 2e-3 / 1001.0]  # t / (t + 0.1 s)
    np.testing.assert_allclose(later - on, expected, atol=1e-15)
    np.testing.assert_array_equal(same, off)
    assert (np.diff(rests) < 0.0).all()
    np.testing.assert_array_equal(effect.pulses(on, off, "b"), (on, off))
    # On before the test, or never: nothing of it can be late.
    before = np.array([-np.inf, 0.4])
    np.testing.assert_allclose(
        effect.pulses(before, np.array([0.3, 0.6]), "a")[0], [-np.inf, 0.4 + 1e-3]
    )


def test_a_pulse_too_short_for_a_stuck_valve_does_not_open_it() -> None:
    model = Model(HELD) + valve.StickingValve(5e-3, 0.1, "a")
    short = ValveCommand(np.heaviside(TIME - 0.1, 1.0) - np.heaviside(TIME - 0.104, 1.0))
    late = ValveCommand(np.heaviside(TIME - 0.1, 1.0) - np.heaviside(TIME - 0.108, 1.0))
    assert len(open_intervals(switched(valve_a=short), "a", model).opens) == 0
    found = open_intervals(switched(valve_a=late), "a", model)
    np.testing.assert_allclose(found.opens, 0.105 + HELD.on_delay_a, atol=1e-12)


def test_a_closed_loop_knows_a_valves_rest_as_a_whole_log_does() -> None:
    effect = valve.StickingValve(2e-3, 0.05)
    on, off = np.array([0.0, 0.1, 0.14, 0.3]), np.array([0.05, 0.12, 0.2, 0.31])
    whole_log = effect.pulses(on, off, "a")
    newest_first = effect.recent_pulses(on[::-1, None], off[::-1, None], np.array([0.4]), "a")
    for log, loop in zip(whole_log, newest_first, strict=True):
        np.testing.assert_allclose(loop[::-1, 0], log, atol=1e-15)
    # A pulse that another effect has swallowed is none to rest from.
    swallowed = on[::-1, None].copy(), off[::-1, None].copy()
    swallowed[0][2], swallowed[1][2] = -np.inf, -np.inf
    kept = effect.recent_pulses(*swallowed, np.array([0.4]), "a")[0][1, 0]
    assert kept == pytest.approx(0.14 + 2e-3 * 0.09 / (0.09 + 0.05), abs=1e-15)


# --- supply ----------------------------------------------------------------------------


def test_the_supply_droops_by_what_its_own_flow_takes() -> None:
    droop = supply.SupplyDroop(10e3 / 7.8e-4)
    pressure = np.linspace(1.7e5, 3e5, 14)
    point = at_pressure(pressure, 1.0)
    left = droop.supply_pressure(3e5, "a", point)
    drawn = HELD.c_fill_a * np.sqrt(left - pressure)
    np.testing.assert_allclose(left, 3e5 - droop.droop_pa_s_per_kg * drawn, rtol=1e-12)
    choked = droop.supply_pressure(3e5, "a", at_pressure([1.2e5], 1.0))
    np.testing.assert_allclose(choked, 3e5 - 10e3 * choked / 3e5, rtol=1e-12)


def test_droop_couples_the_chambers_and_their_flows_agree() -> None:
    droop = supply.SupplyDroop(10e3 / 7.8e-4)
    filling = at_pressure([1.2e5, 2.0e5, 2.6e5], 1.0)
    alone = droop.supply_pressure(3e5, "a", filling)
    beside = dataclasses.replace(filling, open_b=np.ones(3), pressure_b=np.full(3, 2.2e5))
    both = droop.supply_pressure(3e5, "a", beside)
    assert (both < alone - 1e3).all()
    flows = [
        base.filling_flow(beside.pressure(s), both, v.choked_fill, v.c_fill, 3e5)
        for s, v in ((s, HELD.valve(s)) for s in "ab")
    ]
    np.testing.assert_allclose(both, 3e5 - droop.droop_pa_s_per_kg * sum(flows), atol=0.1)


def test_a_chamber_behind_a_droop_still_reaches_the_supply() -> None:
    run = one(switched(), whole(HELD, supply.SupplyDroop.typical()))
    assert run.pressure_a[399] == pytest.approx(3e5, abs=30.0)


def test_a_pulsating_supply_fills_by_its_wave() -> None:
    """Choked filling is proportional to the supply: the rise is the integral of the wave."""
    sine, cosine, hertz = 2e4, -1e4, 30.0
    effect = supply.SupplyPulsation(sine, cosine, hertz)
    run = one(pulse(0.4), whole(HELD, effect))
    early, rate = (TIME > 0.002) & (TIME <= 0.016), 2.0 * np.pi * hertz
    begin = HELD.on_delay_a

    def integral(t: Any) -> Any:
        return 3e5 * t + (cosine * np.sin(rate * t) - sine * np.cos(rate * t)) / rate

    share = (integral(TIME[early]) - integral(begin)) / 3e5
    expected = 1e5 + PER_FLOW * HELD.choked_fill_a * share
    np.testing.assert_allclose(run.pressure_a[early], expected, atol=0.5)


@pytest.mark.parametrize("share", [0.0, 0.6, -0.6])
def test_a_supply_pulsates_in_strokes_by_its_harmonics(share: float) -> None:
    """The n-th harmonic is k^(n-1) / n of the first, in the phase of a wave that is shifted."""
    turns = np.arange(64) / 64
    point = dataclasses.replace(at_pressure(2e5 + 0 * turns, 1.0), time=turns / 4.0)
    shift = 0.7
    effect = supply.SupplyPulsation(8e3 * np.cos(shift), 8e3 * np.sin(shift), 4.0, share)
    wave = effect.supply_pressure(3e5, "a", point) - 3e5
    order = np.arange(1, 41)
    size = 8e3 * share ** (order - 1.0) / order
    expected = size @ np.sin(order[:, None] * (2.0 * np.pi * turns + shift))
    np.testing.assert_allclose(wave, expected, atol=0.1)


def test_a_droop_behind_a_volume_comes_with_its_time_constant() -> None:
    """Choked flow is nearly constant: the loss rises as 1 - exp(-t / tau), and lasts as long."""
    tau, droop = 0.02, 1e6
    effect = supply.SupplyDroop(droop, 0.0, tau)
    assert effect.states == ("line_flow_a", "line_flow_b")
    point = dataclasses.replace(at_pressure([1.2e5], 1.0), open_b=np.zeros(1))
    still = float(supply.SupplyDroop(droop, 0.0).supply_pressure(3e5, "a", point)[0])
    passing, step = {name: np.zeros(1) for name in effect.states}, 1e-4
    for _ in range(400):
        rates = effect.state_rates(dataclasses.replace(point, extra=passing), {})
        passing = {name: value + step * rates[name] for name, value in passing.items()}
    here = dataclasses.replace(point, extra=passing)
    lost = 3e5 - float(effect.supply_pressure(3e5, "a", here)[0])
    assert lost == pytest.approx((3e5 - still) * (1.0 - np.exp(-400 * step / tau)), rel=5e-3)
    assert effect.supply_pressure(3e5, "b", here)[0] == 3e5


def test_what_states_leave_where_they_have_settled() -> None:
    """A tube's lag is gone; a line's loss stays: controllers count with it."""
    model = Model(HELD) + supply.SupplyDroop(1e6, 0.5, 0.02) + chamber.TubeLag(1e-3, "both")
    assert model.state_names
    assert model.settled() == Model(HELD) + supply.SupplyDroop(1e6, 0.5)


def test_a_droop_without_a_volume_has_no_state() -> None:
    """So that controllers and exports take it as before; nor does one need a state to be traced."""
    effect = supply.SupplyDroop(1e6)
    assert effect.states == () and Model(HELD, (effect,)).state_names == ()
    point = at_pressure([1.2e5], 1.0)
    assert dataclasses.replace(effect, line_time_s=np.zeros(1)).state_rates(point, {}) == {}


def test_a_full_chamber_follows_a_pulsating_supply() -> None:
    """Near the supply, where its equation is stiff, as scipy's implicit method has it."""
    from scipy.integrate import solve_ivp

    inputs = pulse(1.0)
    run = one(inputs, whole(HELD, supply.SupplyPulsation(8e3, 8e3, 2.0)))

    def rate(t: float, pressure: Any) -> Any:
        wave = 8e3 * (np.sin(4.0 * np.pi * t) + np.cos(4.0 * np.pi * t))
        return PER_FLOW * HELD.c_fill_a * base.signed_sqrt(3e5 + wave - pressure)

    span, begin = TIME[TIME >= 0.25], run.pressure_a[TIME >= 0.25][0]
    found = solve_ivp(rate, (span[0], span[-1]), [begin], "Radau", span, rtol=1e-8, atol=1e-3)
    np.testing.assert_allclose(run.pressure_a[TIME >= 0.25], found.y[0], atol=30.0)
    assert np.ptp(found.y[0]) > 2e4


@pytest.mark.parametrize("beside", [1.01e5, 1.3e5, 2.9e5])
def test_one_silencer_couples_the_chambers(beside: float) -> None:
    """Into one that is below the silencer's pressure flows some of what the other one exhausts."""
    backed = supply.ExhaustBackPressure.typical()
    off = at_pressure(np.array([1.5e5, 2.5e5]), 0.0)
    both = dataclasses.replace(off, pressure_b=np.full(2, beside))
    back = backed.exhaust_pressure(1e5, "a", both)

    def flow(valve: base.ValveParameters, pressure: Any) -> Any:
        unchoked = valve.c_dis * (pressure - back)
        return np.where(pressure >= back / 0.53, valve.choked_dis, unchoked)

    flows = flow(HELD.valve("a"), off.pressure_a), flow(HELD.valve("b"), both.pressure_b)
    assert (flows[1] < 0.0).all() == (beside < 1.02e5)
    risen = backed.back_pressure_pa_s_per_kg * sum(flows)
    np.testing.assert_allclose(back - 1e5, risen, rtol=1e-3)


def test_a_valve_is_choked_by_the_back_pressure_that_it_causes() -> None:
    """Where neither flow goes with its own rise, the rise is at the boundary, and it is not."""
    backed = supply.ExhaustBackPressure.typical(common_share=0.0)
    jumps = HELD.replace(choked_dis_a=1.2 * HELD.c_dis_a * 1e5 * (1.0 / 0.53 - 1.0))
    rise = backed.back_pressure_pa_s_per_kg * jumps.choked_dis_a
    pressure = (1e5 + 0.95 * rise) / 0.53
    point = dataclasses.replace(at_pressure([pressure], 0.0), parameters=jumps)
    back = backed.exhaust_pressure(1e5, "a", point)
    np.testing.assert_allclose(back, 0.53 * pressure, rtol=1e-9)
    assert not base.is_exhaust_choked(pressure, back).any()


def test_the_exhaust_backs_up_by_its_own_flow() -> None:
    backed = supply.ExhaustBackPressure.typical(common_share=0.0)
    pressure = np.array([1.0e5, 1.2e5, 1.8e5])
    back = backed.exhaust_pressure(1e5, "a", at_pressure(pressure, 0.0))
    flow = HELD.c_dis_a * (pressure - back)
    np.testing.assert_allclose(back, 1e5 + backed.back_pressure_pa_s_per_kg * flow, rtol=1e-12)
    choked = backed.exhaust_pressure(1e5, "a", at_pressure([2.5e5], 0.0))
    np.testing.assert_allclose(choked, 1.05e5)


def _flow_against(pressure: float, rise: Any) -> float:
    """Flow out of A by the base law against the back pressure that it causes itself: bisected."""

    def law(flow: float) -> float:
        back = 1e5 + rise(flow)
        choked = pressure >= back / 0.53
        return HELD.choked_dis_a if choked else HELD.c_dis_a * (pressure - back)

    return float(brentq(lambda flow: law(flow) - flow, 0.0, 1.0, xtol=1e-16))


@pytest.mark.parametrize("share", [1.0, 0.4, 0.0])
@pytest.mark.parametrize("pressure", [1.02e5, 1.2e5, 1.7e5, 2.6e5])
def test_a_silencer_backs_up_by_the_flow_and_its_square(share: float, pressure: float) -> None:
    backed = supply.ExhaustBackPressure(3e7, 0.0, share)
    back = backed.exhaust_pressure(1e5, "a", at_pressure([pressure], 0.0))

    def rise(flow: float) -> float:
        return 3e7 * flow * (share + (1.0 - share) * flow / 3.5e-4)

    np.testing.assert_allclose(back, 1e5 + rise(_flow_against(pressure, rise)), rtol=1e-11)


@pytest.mark.parametrize(("strength", "beside"), [(5e6, 1.5e5), (3e7, 1.5e5), (3e7, 1.75e5)])
def test_one_turbulent_silencer_sees_both_flows(strength: float, beside: float) -> None:
    """What it holds back is the square of the sum of the flows against it."""
    off = at_pressure([1.3e5], 0.0)
    both = dataclasses.replace(off, pressure_b=np.array([beside]))
    back = supply.ExhaustBackPressure(strength, 1.0, 0.0).exhaust_pressure(1e5, "a", both)
    flow = HELD.c_dis_a * (1.3e5 - back) + HELD.c_dis_b * (beside - back)
    assert back > 1.01e5
    np.testing.assert_allclose(back, 1e5 + strength * flow**2 / 3.5e-4, atol=1.0)


def test_the_laminar_form_is_the_older_law_to_the_last_bit() -> None:
    point = random_point((300,), seed=5)
    pressure, beside = point.pressure_a, 2e-4
    valve_a, resistance = HELD.valve("a"), 1.7e7
    against = 1e5 + resistance * beside
    unchoked = valve_a.c_dis * (pressure - against) / (1.0 + resistance * valve_a.c_dis)
    choked = base.is_exhaust_choked(pressure, against + resistance * valve_a.choked_dis)
    expected = np.maximum(np.where(choked, valve_a.choked_dis, unchoked), -beside)
    found = supply.ExhaustBackPressure(resistance)._flow("a", 1e5, beside, point)
    np.testing.assert_array_equal(found, expected)


def test_a_model_without_a_discrete_law_stays_as_it_is() -> None:
    unknown = dict.fromkeys(NO_VALVES, np.nan)
    point = random_point((50,), parameters=REFERENCE.replace(**unknown))
    given = before(point)
    for effect in (
        chamber.TubeLag,
        valve.SubsonicFlowShape,
        supply.SupplyDroop,
        supply.ExhaustBackPressure,
    ):
        found = after(effect.typical(), point, given)
        for name, value in given.items():
            if not name.startswith("chamber_flow"):
                np.testing.assert_array_equal(found[name], value, err_msg=name)
            assert np.isfinite(found[name]).all()


# --- sensors ---------------------------------------------------------------------------


@pytest.mark.parametrize(("of_all", "rate"), [(0.0, 2.0), (1.0, 3.0)])
def test_counts_beyond_the_speed_are_lost_for_good(of_all: float, rate: float) -> None:
    """Out at 3 rad/s, of which 2 are beyond the counter, back at 0.5 rad/s."""
    time = np.arange(0.0, 0.701, 1e-3)
    position = np.where(time < 0.1, 3.0 * time, 0.3 - 0.5 * (time - 0.1))
    effect = sensor.LostCounts(0.1, 1.0, of_all)
    shown = effect.measure({"theta_rad": position, "pressure_a_pa": time}, time)
    lost = 0.1 * rate * np.minimum(time, 0.1)
    np.testing.assert_allclose(shown["theta_rad"], position - lost, atol=1e-12)
    assert shown["pressure_a_pa"] is time
    assert shown["theta_rad"][-1] == pytest.approx(-0.01 * rate)  # 0 again, and short


def test_a_lagged_sensor_follows_steps_and_ramps_exactly() -> None:
    rng = np.random.default_rng(1)
    lag = 2e-3
    time = np.concatenate(
        ([0.0, 0.01, 0.01 + 1e-9], 0.011 + np.cumsum(rng.uniform(1e-4, 4e-3, 40)))
    )
    step = np.where(time > 0.01, 1e5, 0.0)
    after_step = time > 0.0101
    expected = -1e5 * np.expm1(-(time - 0.01) / lag)
    found = sensor.lagged(step, time, lag)
    np.testing.assert_allclose(found[after_step], expected[after_step], rtol=1e-6)
    assert found[1] == 0.0
    ramp = sensor.lagged(1e6 * time, time, lag)
    np.testing.assert_allclose(ramp, 1e6 * (time + lag * np.expm1(-time / lag)), atol=1e-6)


@pytest.mark.parametrize("even", [True, False])
def test_a_lag_is_the_recursion_of_its_equation(even: bool) -> None:
    rng = np.random.default_rng(2)
    steps = np.full(400, 1e-3) if even else rng.uniform(2e-4, 3e-3, 400)
    time = 7.0 + np.concatenate(([0.0], np.cumsum(steps)))
    values, lag = 1e5 + 1e4 * rng.standard_normal(401), 2e-3
    behind, expected = 0.0, [values[0]]
    for step, change, value in zip(np.diff(time), np.diff(values), values[1:], strict=True):
        kept = np.exp(-step / lag)
        behind = kept * behind + change * (lag / step) * (1.0 - kept)
        expected.append(value - behind)
    np.testing.assert_allclose(sensor.lagged(values, time, lag), expected, rtol=1e-12)


@pytest.mark.parametrize("order", [0.0, 0.6, 1.0])
def test_a_sensor_lags_by_a_second_order_of_its_time_constant(order: float) -> None:
    time = 1e-3 * np.arange(400)
    true = 2e5 + 3e4 * np.sin(2.0 * np.pi * 15.0 * time) * (time > 0.05)
    effect = sensor.PressureLag(4e-3, "a", order)
    shown = effect.measure({"pressure_a_pa": true, "pressure_b_pa": true}, time)
    law = ([1.0], [order * 4e-3**2 / 4.0, 4e-3, 1.0] if order else [4e-3, 1.0])
    _, expected, _ = lsim(law, true - true[0], time)
    np.testing.assert_allclose(shown["pressure_a_pa"] - true[0], expected, atol=1.0)
    assert shown["pressure_b_pa"] is true


@pytest.mark.parametrize(
    "effect",
    [
        sensor.PressureLag(5e-3, "both", 1.0),
        sensor.PressureLag(5e-3),
        sensor.TimeSkew(4.5e-3),
    ],
)
def test_slow_sensors_have_an_inverse(effect: Any) -> None:
    """Of a motion at 10 Hz: iterating, which multiplies what is wrong by 0.3, would not do."""
    time = 1e-3 * np.arange(600)
    true = {"pressure_a_pa": 2e5 + 3e4 * np.sin(2.0 * np.pi * 10.0 * time)}
    shown = effect.measure(true, time)
    found = effect.unmeasured(shown, time)
    middle = slice(100, -100)
    gap = {
        name: row["pressure_a_pa"][middle] - true["pressure_a_pa"][middle]
        for name, row in (("shown", shown), ("found", found))
    }
    assert np.max(np.abs(gap["shown"])) > 5e3
    assert np.max(np.abs(gap["found"])) < 1e2


def test_a_lag_does_not_depend_on_how_lines_are_sampled() -> None:
    coarse = np.array([0.0, 0.004, 0.005, 0.02])
    values = np.array([1e5, 3e5, 2e5, 2.2e5])
    fine = np.union1d(np.linspace(0.0, 0.02, 501), coarse)
    dense = sensor.lagged(np.interp(fine, coarse, values), fine, 3e-3)
    np.testing.assert_allclose(
        dense[np.searchsorted(fine, coarse)], sensor.lagged(values, coarse, 3e-3), rtol=1e-10
    )


def test_a_skewed_channel_is_late_and_holds_its_first_value() -> None:
    time = np.cumsum(np.full(50, 1e-3)) + 4.0
    channels = {"pressure_a_pa": 1e6 * time, "pressure_b_pa": 2e6 * time, "position_m": time}
    found = sensor.TimeSkew(2.5e-3, "b").measure(channels, time)
    np.testing.assert_array_equal(found["pressure_a_pa"], channels["pressure_a_pa"])
    np.testing.assert_allclose(found["pressure_b_pa"][3:], 2e6 * (time[3:] - 2.5e-3))
    np.testing.assert_array_equal(found["pressure_b_pa"][:3], 2e6 * time[0])
    early = sensor.TimeSkew(-2.5e-3).measure(channels, time)["pressure_a_pa"]
    np.testing.assert_array_equal(early[-3:], 1e6 * time[-1])


def test_offset_and_gain_and_ambient_pressure() -> None:
    time = np.arange(3.0)
    channels = {"pressure_a_pa": np.array([1e5, 2e5, 3e5])}
    found = sensor.PressureOffset(1.7e3).measure(channels, time)
    np.testing.assert_array_equal(found["pressure_a_pa"], [1.017e5, 2.017e5, 3.017e5])
    found = sensor.PressureGain(5e-3, "a").measure(channels, time)
    np.testing.assert_allclose(found["pressure_a_pa"], [1.005e5, 2.01e5, 3.015e5])
    found = sensor.PressureGain(5e-3, "a", 1e5).measure(channels, time)
    np.testing.assert_allclose(found["pressure_a_pa"], [1e5, 2.005e5, 3.01e5])
    np.testing.assert_array_equal(channels["pressure_a_pa"], [1e5, 2e5, 3e5])
    assert sensor.AmbientPressureError(1e3).parameters(HELD, 0.0).atmosphere == 1.01e5


@pytest.mark.parametrize(
    "effect", [supply.SupplyDroop(4e6), supply.ExhaustBackPressure(4e6, 1.0)], ids=["droop", "back"]
)
def test_a_flow_that_moves_its_own_pressure_stays_finite(effect: CatalogueEffect) -> None:
    """Both valves cross the choked boundary again and again."""
    time = np.arange(0.0, 2.0, 1e-3)
    valves = [
        ValveCommand((np.sin(2.0 * np.pi * f * time) > 0.0).astype(float), is_duty=False)
        for f in (2.0, 3.1)
    ]
    parameters = REFERENCE.replace(static_effort=50.0)
    inputs = Inputs(time, np.zeros(len(time)), *valves)
    (plain,) = simulate([inputs], [Model(parameters)])
    (changed,) = simulate([inputs], [Model(parameters) + effect])
    gap = changed.pressure_a - plain.pressure_a
    assert np.isfinite(gap).all() and 500.0 < np.max(np.abs(gap)) < 5e4
