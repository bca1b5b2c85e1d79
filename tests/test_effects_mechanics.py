"""Effects of friction, linkage and motor: neutral to the last bit, direction, closed forms."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import simpson, solve_ivp

from benchmarks.rigs import REFERENCE, random_runs
from sysid.plant import base, plant
from sysid.plant.effects import catalogue, class_of, friction, linkage, motor, stroke
from sysid.plant.effects.catalogue import AMBIGUOUS_CLASSES
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model, Point, join, overrides, split
from sysid.plant.simulator import Inputs, Trajectory, ValveCommand, simulate

EFFECTS = [effect for module in (friction, linkage, stroke, motor) for effect in module.EFFECTS]
IDS = [effect.id for effect in EFFECTS]
STATES = ("position", "velocity", "pressure_a", "pressure_b")
# No friction, no cylinder, no end stop within reach: the motor's torque and the inertia only.
FREE = REFERENCE.replace(
    **{f"{law}_{side}": 0.0 for law in ("choked_dis", "c_dis") for side in "ab"},
    **{"static_effort": 0.0, "coulomb_effort": 0.0, "viscous": 0.0, "stroke": 1e3},
    **{"area_a": 1e-12, "area_b": 1e-12, "offset_a": 1e3, "offset_b": 1e3},
)
VERTICAL = REFERENCE.replace(gravity_moment=1.2)


def random_point(shape: tuple[int, ...], **changes: Any) -> Point:
    rng = np.random.default_rng(11)
    direction = rng.choice([-1.0, 0.0, 1.0], shape)
    values: dict[str, Any] = {
        "time": rng.uniform(0, 60, shape),
        "position": rng.uniform(-1.6, 1.6, shape),
        "velocity": direction * rng.uniform(0, 5, shape),
        "pressure_a": rng.uniform(0.8e5, 3.3e5, shape),
        "pressure_b": rng.uniform(0.8e5, 3.3e5, shape),
        "motor": rng.uniform(-1.2, 1.2, shape) * rng.choice([0.0, 1.0], shape),
        "open_a": rng.choice([0.0, 1.0], shape),
        "open_b": rng.choice([0.0, 1.0], shape),
        "direction": direction,
        "parameters": VERTICAL,
    }
    extra = {
        "presliding_share": rng.uniform(-1, 1, shape),
        "backlash_place": rng.uniform(-1, 1, shape),
        "backlash_motor_rad": rng.uniform(-1.6, 1.6, shape),
        "backlash_motor_rad_per_s": rng.uniform(-5, 5, shape),
        "link_angle_rad": rng.uniform(-1.6, 1.6, shape),
        "link_speed_rad_per_s": rng.uniform(-5, 5, shape),
        "amplifier_effort": rng.uniform(-0.8, 0.8, shape),
        "fresh_share": rng.uniform(0, 1, shape),
    }
    return Point(**values | {"extra": extra} | changes)


def given_values(point: Point) -> dict[str, Any]:
    rng = np.random.default_rng(5)
    shape = point.time.shape
    return {
        "motor_effort": base.limit_effort(point.motor, point.parameters.max_effort),
        "friction_effort": rng.uniform(-0.5, 0.5, shape),
        "static_effort": rng.uniform(0.1, 0.5, shape),
        "external_effort": rng.uniform(-3, 3, shape),
        "pitch_radius": rng.uniform(0.01, 0.05, shape),
        "displacement": rng.uniform(-0.06, 0.06, shape),
    }


def after(effect: CatalogueEffect, point: Point, given: dict[str, Any]) -> dict[str, Any]:
    found = {port: getattr(effect, port)(value, point) for port, value in given.items()}
    return found | vars(effect.parameters(point.parameters, point.time))


def same(found: dict[str, Any], given: dict[str, Any], where: str) -> None:
    for name, value in (given | vars(VERTICAL)).items():
        wanted = np.broadcast_to(value, np.shape(found[name]))
        np.testing.assert_array_equal(np.asarray(found[name]), wanted, err_msg=f"{where}: {name}")


def forms(effect: type[CatalogueEffect]) -> list[CatalogueEffect]:
    """The effect at neutral strength in every shape of its grids."""
    names = [q.name for q in effect.shapes()]
    rows = itertools.product(*(q.grid for q in effect.shapes()))
    return [effect.neutral(**dict(zip(names, row, strict=True))) for row in rows]


# --- the catalogue ---------------------------------------------------------------------


def test_the_catalogue_holds_every_effect_of_the_contract(shared_spec: Path) -> None:
    rows = (shared_spec / "effects.md").read_text("utf-8").splitlines()
    named = {row.split("`")[1] for row in rows if row.startswith("| `")}
    assert len(named) > 40 and named <= catalogue().keys()


def test_the_catalogue_is_whole() -> None:
    effects = catalogue()
    assert len(effects) == 55 and set(IDS) < effects.keys()
    for members in AMBIGUOUS_CLASSES:
        assert members < effects.keys()
        assert all(class_of(member) == members for member in members)
    assert class_of("backlash") == {"backlash"}
    assert sum(map(len, AMBIGUOUS_CLASSES)) == len(frozenset().union(*AMBIGUOUS_CLASSES))
    for effect in effects.values():
        assert set(effect.rivals) < effects.keys(), effect.id
        assert (class_of(effect.id) - {effect.id}) <= set(effect.rivals) | {
            "supply-droop", "atmosphere-leakage", "choked-exhaust-scaling", "subsonic-flow-shape"
        }, effect.id  # fmt: skip
    model = Model(REFERENCE)
    for effect in effects.values():
        model = model + effect.neutral()  # no two of them share a state
    assert len(set(model.state_names)) == len(model.state_names)


@pytest.mark.parametrize("effect", EFFECTS, ids=IDS)
def test_the_entry_is_whole(effect: type[CatalogueEffect]) -> None:
    fields = {f.name: f.default for f in dataclasses.fields(effect)}  # type: ignore[arg-type]
    assert {q.name for q in effect.quantities} | ({"side"} & fields.keys()) == fields.keys()
    assert effect.strengths()
    for q in effect.quantities:
        assert fields[q.name] == (0.0 if q.is_strength else q.typical)
        assert q.lower <= fields[q.name] <= q.upper and q.lower <= q.typical <= q.upper
        assert all(q.lower <= g <= q.upper for g in q.grid)
        assert q.is_strength or q.grid
    assert effect.title and effect.signature and effect.source
    assert bool(effect.rivals) == bool(effect.tie_breaker)
    assert effect.id not in effect.rivals


# --- neutral ---------------------------------------------------------------------------


@pytest.mark.parametrize("effect", EFFECTS, ids=IDS)
@pytest.mark.parametrize("shape", [(400,), (6, 7)])
def test_neutral_ports_change_no_bit(effect: type[CatalogueEffect], shape: tuple[int, ...]) -> None:
    point = random_point(shape)
    given = given_values(point)
    for form in forms(effect):
        same(after(form, point, given), given, str(form))


def test_neutral_ports_change_no_bit_in_jax() -> None:
    from sysid.plant.jax_setup import jax

    point = random_point((300,))
    given = given_values(point)
    structure, numbers = split(tuple(effect.neutral() for effect in EFFECTS))

    @jax.jit
    def compiled(numbers: Any, given: Any, fields: dict[str, Any]) -> Any:
        at = dataclasses.replace(point, **fields)
        return [after(effect, at, given) for effect in join(structure, numbers)]

    names = [f.name for f in dataclasses.fields(point) if f.name != "parameters"]
    fields = {name: getattr(point, name) for name in names}
    for effect, found in zip(EFFECTS, compiled(numbers, given, fields), strict=True):
        same(found, given, effect.id)


def test_numpy_and_jax_agree_at_typical_size() -> None:
    from sysid.plant.jax_setup import jnp

    point = random_point((200,))
    fields = {f.name: getattr(point, f.name) for f in dataclasses.fields(point)}
    traced = {n: jnp.asarray(v) for n, v in fields.items() if isinstance(v, np.ndarray)}
    extra = {name: jnp.asarray(value) for name, value in point.extra.items()}
    other = dataclasses.replace(point, **traced, extra=extra)
    given = given_values(point)
    for effect in EFFECTS:
        typical = effect.typical()
        found = after(typical, other, {n: jnp.asarray(v) for n, v in given.items()})
        found |= typical.state_rates(other, {})
        expected = after(typical, point, given) | dict(typical.state_rates(point, {}))
        assert found.keys() == expected.keys()
        for name, value in expected.items():
            if value is None:  # a law that this rig does not have
                assert found[name] is None
                continue
            np.testing.assert_allclose(
                found[name], value, rtol=1e-12, atol=1e-12, err_msg=f"{effect.id}: {name}"
            )


def whole(parameters: base.Parameters, *acting: CatalogueEffect) -> Model:
    """The model with every effect, those given in place of the neutral ones: one compilation."""
    given = {type(effect): effect for effect in acting}
    model = Model(parameters)
    for effect in EFFECTS:
        model = model + given.get(effect, effect.neutral())
    return model


def one(inputs: Inputs, model: Model) -> Trajectory:
    return simulate([inputs], [model])[0]


def test_all_effects_at_neutral_strength_simulate_as_the_base_model() -> None:
    inputs, models = random_runs(seed=4, count=1, seconds=0.8)
    bare = one(inputs[0], models[0])
    neutral = one(inputs[0], whole(models[0].parameters))
    for name in STATES:
        np.testing.assert_array_equal(getattr(neutral, name), getattr(bare, name), err_msg=name)


# --- acting: the ports -----------------------------------------------------------------


def moving(**changes: Any) -> Point:
    """Moving in the positive direction at 0.07 rad/s, 1 rad from the middle."""
    values = {"time": 0.0, "position": 1.0, "velocity": 0.07, "pressure_a": 2e5}
    values |= {"pressure_b": 1.5e5, "motor": 0.5, "open_a": 0.0, "open_b": 0.0, "direction": 1.0}
    return Point(**values | {"parameters": REFERENCE} | changes)


BACK: dict[str, Any] = {"velocity": -0.07, "direction": -1.0}


def _second_of_mesh() -> float:
    twice = 2.0 * (20.0 + math.atan(0.75))
    return 0.05 * (0.4 * math.sin(twice) - 0.2 * math.cos(twice))


@pytest.mark.parametrize(
    ("effect", "port", "forth", "back"),
    [
        (friction.StribeckFriction(0.12), "friction_effort", 0.12 / math.e, -0.12 / math.e),
        (friction.AsymmetricCoulombFriction(0.017), "friction_effort", 0.017, 0.017),
        (
            friction.PositionDependentFriction(0.3, 0.1, 2.0),
            "friction_effort",
            0.208 * (0.3 * math.sin(2.0) + 0.1 * math.cos(2.0)),
            -0.208 * (0.3 * math.sin(2.0) + 0.1 * math.cos(2.0)),
        ),
        # At the crest: of the same height from trough to crest, 1 + r above none of it.
        (
            friction.PositionDependentFriction(0.3 * math.sin(2.0), 0.3 * math.cos(2.0), 2.0, 0.6),
            "friction_effort",
            0.208 * 0.3 * 1.6,
            -0.208 * 0.3 * 1.6,
        ),
        (friction.SealFriction(2e-7), "friction_effort", 0.03, -0.03),
        (
            friction.SealFriction(2e-7, 0.0, 0.85),
            "friction_effort",
            0.02 * (1.0 + 0.5**0.85),
            -0.02 * (1.0 + 0.5**0.85),
        ),
        # Of 0.5 Nm, and of that with 20.1 N of the cylinder at 37.5 mm.
        (friction.LoadDependentFriction(0.04), "friction_effort", 0.02, -0.02),
        (
            friction.LoadDependentFriction(0.04, 1.0),
            "friction_effort",
            0.04 * (0.5 + 0.0375 * (1e5 * 4.524e-4 - 0.5e5 * 4.207e-4)),
            -0.04 * (0.5 + 0.0375 * (1e5 * 4.524e-4 - 0.5e5 * 4.207e-4)),
        ),
        (friction.QuadraticDrag(0.005), "friction_effort", 0.005 * 0.0049, -0.005 * 0.0049),
        (friction.AsymmetricViscousFriction(0.01), "friction_effort", 0.0007, 0.0007),
        (
            friction.PowerLawFriction(0.05, 0.5),
            "friction_effort",
            0.05 * math.sqrt(0.07),
            -0.05 * math.sqrt(0.07),
        ),
        (
            stroke.StrokeDependentSeals(2e-7),
            "friction_effort",
            2e-7 * 1.0 * 1.5e5,
            -2e-7 * 1.0 * 1.5e5,
        ),
        (linkage.CableSpring(0.05), "external_effort", -0.05, -0.05),
        (linkage.CableSpring(0.05, -0.4), "external_effort", -0.07, -0.07),
        (
            linkage.MountingTilt(0.012, 0.02),
            "external_effort",
            -(0.012 * math.sin(1.0) + 0.02 * math.cos(1.0)),
            -(0.012 * math.sin(1.0) + 0.02 * math.cos(1.0)),
        ),
        (
            linkage.GearMeshRipple(0.02, 0.01, 20.0),
            "external_effort",
            0.02 * math.sin(20.0) + 0.01 * math.cos(20.0),
            0.02 * math.sin(20.0) + 0.01 * math.cos(20.0),
        ),
        (
            # A wave of 0.05 sin(20 theta + atan(3 / 4)), its second harmonic with a share of each.
            linkage.GearMeshRipple(0.04, 0.03, 20.0, 0.4, -0.2),
            "external_effort",
            0.05 * math.sin(20.0 + math.atan(0.75)) + _second_of_mesh(),
            0.05 * math.sin(20.0 + math.atan(0.75)) + _second_of_mesh(),
        ),
        (motor.TorqueOffset(0.01), "external_effort", 0.01, 0.01),
        (motor.TorqueConstantError(0.05), "motor_effort", 0.025, 0.025),
        (
            motor.TorqueRipple(0.02, 0.01, 12.0),
            "motor_effort",
            0.5 * (0.02 * math.sin(12.0) + 0.01 * math.cos(12.0)),
            0.5 * (0.02 * math.sin(12.0) + 0.01 * math.cos(12.0)),
        ),
    ],
    ids=lambda value: value.id if isinstance(value, CatalogueEffect) else "",
)
def test_it_adds_what_its_entry_says(
    effect: CatalogueEffect, port: str, forth: float, back: float
) -> None:
    for point, expected in ((moving(), forth), (moving(**BACK), back)):
        added = getattr(effect, port)(0.5, point) - 0.5
        assert added == pytest.approx(expected, rel=1e-9)


def test_saturation_clips_at_the_reciprocal() -> None:
    efforts = np.linspace(-0.8, 0.8, 41)
    found = motor.TorqueSaturation(1 / 0.55).motor_effort(efforts, moving())
    np.testing.assert_allclose(found, np.clip(efforts, -0.55, 0.55), rtol=1e-12)


def test_a_soft_saturation_bends_towards_the_same_limit() -> None:
    """u / (1 + |u d|^(1/s))^s: at a half a hyperbola; hard at nothing; never beyond 1/d."""
    efforts = np.linspace(-4.0, 4.0, 41)
    half = motor.TorqueSaturation(1 / 0.55, 0.5).motor_effort(efforts, moving())
    np.testing.assert_allclose(half, efforts / np.sqrt(1 + (efforts / 0.55) ** 2), rtol=1e-12)
    nearly = motor.TorqueSaturation(1 / 0.55, 1e-9).motor_effort(efforts, moving())
    np.testing.assert_allclose(nearly, np.clip(efforts, -0.55, 0.55), rtol=1e-3)
    like_tanh = motor.TorqueSaturation(1 / 0.55, 0.38).motor_effort(efforts, moving())
    np.testing.assert_allclose(like_tanh, 0.55 * np.tanh(efforts / 0.55), atol=0.03 * 0.55)
    absent = motor.TorqueSaturation(0.0, 0.4).motor_effort(efforts, moving())
    np.testing.assert_array_equal(absent, efforts)


def test_lips_press_no_less_below_the_atmosphere_where_that_does_not_lift_them() -> None:
    atmosphere = float(REFERENCE.atmosphere)
    point = moving(pressure_a=atmosphere - 4e4, pressure_b=atmosphere + 9e4, direction=1.0)
    for only_above, pressed in ((0.0, 9e4 - 4e4), (1.0, 9e4)):
        effect = friction.SealFriction(2e-7, only_above_atmosphere=only_above)
        assert effect.friction_effort(0.5, point) == pytest.approx(0.5 + 2e-7 * pressed)


def test_seals_in_proportion_are_so_through_the_atmosphere() -> None:
    """Where a chamber is vented its pressure has the slope that it has elsewhere."""
    from sysid.plant.jax_setup import jax

    effect = friction.SealFriction(2e-7)

    def torque(pressure: Any) -> Any:
        point = moving(pressure_a=pressure, pressure_b=3e5, direction=1.0)
        return effect.friction_effort(0.5, point)

    for pressure in (float(REFERENCE.atmosphere), 2e5, 5e4):
        assert float(jax.grad(torque)(pressure)) == pytest.approx(2e-7)


@pytest.mark.parametrize("share", [0.0, 1.0, 1.6])
def test_pressed_seals_hold_a_shaft_at_rest(share: float) -> None:
    """By the friction that they add while it slides, times the share that acts at rest."""
    model = Model(REFERENCE) + friction.SealFriction(2e-7, 0.0, 0.85, 0.0, share)
    point = moving(velocity=0.0, direction=0.0)
    level = float(plant.breakaway_effort(np.array(1.0), point, model))
    added = 0.02 * (1.0 + 0.5**0.85)
    assert level == pytest.approx(float(REFERENCE.static_effort) + share * added)


def test_seals_of_one_end_do_not_act_beyond_the_middle() -> None:
    """A slope and a bend of the same size cancel at negative positions, and double at others."""
    effect = stroke.StrokeDependentSeals(2e-7, 2e-7)
    for place, expected in ((0.4, 4e-7 * 0.4 * 1.5e5), (-0.4, 0.0)):
        for way in (1.0, -1.0):
            point = moving(position=place, velocity=0.1 * way, direction=way)
            added = effect.friction_effort(0.5, point) - 0.5
            assert added == pytest.approx(way * expected, abs=1e-12)


def test_displacement_is_the_integral_of_the_eccentric_radius() -> None:
    effect = linkage.PitchEccentricity(0.05, -0.03)
    angle = np.linspace(-1.6, 1.6, 3201)
    point = moving(position=angle)
    y = effect.displacement(REFERENCE.pitch_radius * angle, point)
    radius = effect.pitch_radius(np.full_like(angle, REFERENCE.pitch_radius), point)
    np.testing.assert_allclose(np.gradient(y, angle)[1:-1], radius[1:-1], rtol=1e-6)
    assert y[1600] == 0.0  # the middle stays where it was
    assert radius[1600] == pytest.approx(1.05 * REFERENCE.pitch_radius)


def test_the_lever_arm_may_vary_alone() -> None:
    """The cylinder's torque is that of an eccentric pinion; the volumes and their rates are not."""
    alone = Model(REFERENCE) + linkage.PitchEccentricity(0.05, -0.03, lever_arm_only=1.0)
    both = Model(REFERENCE) + linkage.PitchEccentricity(0.05, -0.03)
    point = moving(position=np.linspace(-1.6, 1.6, 5))
    for port in (plant.displacement, partial(plant.volume_rate, "a")):
        np.testing.assert_array_equal(port(point, alone), port(point, Model(REFERENCE)))
    np.testing.assert_allclose(
        plant.applied_effort(point, alone), plant.applied_effort(point, both), rtol=1e-12
    )
    (effect,) = alone.effects
    assert not overrides(effect, "pitch_radius", "displacement")
    assert not overrides(both.effects[0], "external_effort")


def test_a_cushion_pushes_back_at_its_own_end_only() -> None:
    """Its law in words: nothing up to the start, then a power of the depth, towards the middle."""
    for place, side, expected in (
        (0.9, "both", -0.6 * 0.5 * (0.4 / 0.5) ** 1.5),
        (-0.9, "both", 0.6 * 0.5 * (0.4 / 0.5) ** 1.5),
        (0.9, "b", -0.6 * 0.5 * (0.4 / 0.5) ** 1.5),
        (0.9, "a", 0.0),
        (-0.9, "b", 0.0),
        (0.5, "both", 0.0),
        (-0.2, "both", 0.0),
    ):
        effect = stroke.EndCushion(0.6, 0.5, 1.5, side)
        added = effect.external_effort(0.5, moving(position=place)) - 0.5
        assert added == pytest.approx(expected, abs=1e-12)


def test_a_damped_cushion_pushes_harder_on_the_way_in_and_never_pulls() -> None:
    """Hunt and Crossley: the elastic torque times 1 + c times the speed into the cushion."""
    elastic = 0.6 * 0.5 * (0.4 / 0.5) ** 1.5
    for place, speed, side, expected in (
        (0.9, 1.0, "both", -elastic * 1.4),
        (0.9, -1.0, "both", -elastic * 0.6),
        (-0.9, -1.0, "both", elastic * 1.4),
        (-0.9, 1.0, "a", elastic * 0.6),
        (0.9, -4.0, "both", 0.0),
        (-0.9, -1.0, "b", 0.0),
    ):
        effect = stroke.EndCushion(0.6, 0.5, 1.5, side, 0.4)
        added = effect.external_effort(0.5, moving(position=place, velocity=speed)) - 0.5
        assert added == pytest.approx(expected, abs=1e-12)


def test_a_mass_on_a_cushion_swings_as_on_a_spring() -> None:
    """Thrown into a linear cushion, it comes out half a period later and as fast."""
    stiffness, start = 20.0, 0.2
    free = Inputs(TIME, 0.0 * TIME, position=0.2, velocity=1.0)
    run = one(free, whole(FREE, stroke.EndCushion(stiffness, start, 1.0)))
    rate = math.sqrt(stiffness / FREE.inertia)
    inside = rate * TIME < math.pi
    swing = start + np.sin(rate * TIME[inside]) / rate
    np.testing.assert_allclose(run.position[inside], swing, atol=2e-6)
    out = np.flatnonzero(~inside)[1]
    assert run.velocity[out] == pytest.approx(-1.0, abs=1e-4)


def test_an_area_along_the_stroke_gives_the_work_that_its_volume_takes() -> None:
    """In a closed chamber at slow motion the torque's work is what the volume's change takes."""
    slope, curvature, angle = 0.08, 0.11, np.linspace(-1.5, 1.5, 3001)
    effect = stroke.StrokeDependentArea(slope, curvature)
    point = moving(position=angle)
    p = REFERENCE
    radius = effect.pitch_radius(np.full_like(angle, p.pitch_radius), point)
    areas = p.area_a * (1.0 + slope * angle + curvature * angle**2)  # the entry's law
    torque = base.cylinder_effort(2e5, 1e5, p.area_a, p.area_b, 1e5, radius)
    np.testing.assert_allclose(torque, 1e5 * areas * p.pitch_radius, rtol=1e-12)
    y = effect.displacement(p.pitch_radius * angle, point)
    volume = base.chamber_volume_a(y, p.area_a, p.offset_a, 1.0)
    work = 1e5 * (volume[-1] - volume[0])
    assert simpson(torque, x=angle) == pytest.approx(work, rel=1e-9)
    assert volume[1500] == pytest.approx(p.area_a * p.offset_a, rel=1e-12)


def test_inertia_and_area_are_added_to_the_declared_ones() -> None:
    found = linkage.InertiaMismatch(0.003).parameters(VERTICAL, 0.0)
    assert found.inertia == VERTICAL.inertia + 0.003
    assert found.gravity_moment == pytest.approx(1.2 * found.inertia / VERTICAL.inertia)
    further_out = linkage.InertiaMismatch(0.003, 0.1).parameters(VERTICAL, 0.0)
    assert further_out.inertia == found.inertia
    assert further_out.gravity_moment == pytest.approx(found.gravity_moment + 0.12)
    level = linkage.InertiaMismatch(0.003, 0.1).parameters(REFERENCE, 0.0)
    assert level.gravity_moment == level.weight == 0.0
    assert linkage.AreaError(3e-6).parameters(REFERENCE, 0.0).area_b == REFERENCE.area_b + 3e-6


# --- acting: in a simulation -----------------------------------------------------------

TIME = np.linspace(0.0, 0.8, 801)


@functools.cache
def driven() -> Inputs:
    """Motor steps and reversals, valves under PWM in turn."""
    effort = 0.6 * np.sign(np.sin(14.0 * TIME + 0.5)) * (0.4 + TIME)
    duty_a = 0.5 + 0.4 * np.sin(12.0 * TIME)
    return Inputs(TIME, effort, ValveCommand(duty_a, True), ValveCommand(1.0 - duty_a, True))


@functools.cache
def bare_run() -> Trajectory:
    return one(driven(), whole(REFERENCE))


@pytest.mark.parametrize("effect", EFFECTS, ids=IDS)
def test_at_typical_size_and_at_its_bounds_it_shows_and_stays_finite(
    effect: type[CatalogueEffect],
) -> None:
    sizes = [{q.name: getattr(q, at) for q in effect.strengths()} for at in ("lower", "upper")]
    for size in ({}, *sizes):
        run = one(driven(), whole(REFERENCE, effect.typical(**size)))
        states = np.array([getattr(run, name) for name in STATES])
        assert np.isfinite(states).all()
        assert np.abs(run.position).max() < 1.75
        if any(size.values()) or not size:
            assert np.abs(run.position - bare_run().position).max() > 1e-4  # the encoder's step


def free_run(effort: np.ndarray[Any, Any], *acting: CatalogueEffect) -> Trajectory:
    return one(Inputs(TIME, effort), whole(FREE, *acting))


@pytest.mark.parametrize("lag", [1e-3, 3e-3, 0.05])
def test_the_amplifier_is_a_first_order_lag(lag: float) -> None:
    effort = np.where(TIME < 0.1, 0.0, 0.5)
    run = free_run(effort, motor.AmplifierLag(lag))
    since = np.maximum(TIME - 0.1, 0.0)
    expected = 0.5 / FREE.inertia * (since + lag * np.expm1(-since / lag))
    # A third-order method whose step is the time constant: 4 % of what the lag takes.
    np.testing.assert_allclose(run.velocity, expected, atol=0.5 / FREE.inertia * 0.04 * 1e-3)


@pytest.mark.parametrize("lag", [1e-5, 3e-4])
def test_a_lag_below_the_step_takes_its_impulse(lag: float) -> None:
    run = free_run(np.where(TIME < 0.1, 0.0, 0.5), motor.AmplifierLag(lag))
    expected = 0.5 / FREE.inertia * (TIME - 0.1 - lag)
    late = TIME > 0.12
    np.testing.assert_allclose(run.velocity[late], expected[late], rtol=1e-6)


def test_the_amplifier_lags_what_other_effects_leave() -> None:
    run = free_run(np.full(801, 0.5), motor.TorqueConstantError(0.1), motor.AmplifierLag(0.01))
    rate = np.gradient(run.velocity, TIME)[-10:]
    np.testing.assert_allclose(rate, 0.55 / FREE.inertia, rtol=1e-6)


@pytest.mark.parametrize("gap", [1e-4, 1e-3, 4e-3, 0.02])
def test_backlash_loses_the_torque_while_the_gap_is_crossed(gap: float) -> None:
    effort = np.where(TIME < 0.3, 0.4, -0.4)
    lost = free_run(effort, linkage.Backlash(gap)).velocity - free_run(effort).velocity
    crossing = gap / (2.0 * 0.4)
    # Nine tenths of the gap at no torque, the rest as it decays.
    impulse = 0.4 * crossing * (1.0 + 1.0 / math.log(10.0))
    assert np.abs(lost[TIME < 0.3]).max() < 1e-12
    # A crossing below the simulator's step is taken at one step a time constant.
    rough = 0.02 if gap >= 4e-3 else 0.08
    np.testing.assert_allclose(lost[-1], impulse / FREE.inertia, rtol=rough)
    inside = np.searchsorted(TIME, 0.3 + 0.5 * crossing)
    expected = 0.4 * (TIME[inside] - 0.3) / FREE.inertia
    if gap >= 4e-3:
        np.testing.assert_allclose(lost[inside], expected, rtol=1e-6)


def _two_inertias(gap: float, share: float, effort: float, reversal: float) -> Any:
    """Position and speed of shaft and motor (4,) over TIME: the contact written out, fine steps."""
    motor, rate = share * FREE.inertia, 2.0 * math.pi * 60.0

    def slopes(time: float, state: Any) -> list[float]:
        shaft, speed, own, own_speed = state
        into = own - shaft - 0.5 * gap if own > shaft else own - shaft + 0.5 * gap
        force = motor * (rate**2 * into + 2.0 * 0.5 * rate * (own_speed - speed))
        touches = abs(own - shaft) > 0.5 * gap and force * into > 0.0
        force = force if touches else 0.0
        drive = effort if time < reversal else -effort
        left = FREE.inertia - motor
        return [speed, force / left, own_speed, (drive - force) / motor]

    start = [0.0, 0.0, 0.5 * gap, 0.0]
    return solve_ivp(slopes, (0.0, 0.8), start, t_eval=TIME, max_step=5e-5).y


@pytest.mark.parametrize("share", [0.08, 0.15])
@pytest.mark.parametrize("gap", [2e-3, 4e-3])
def test_a_motor_behind_the_gap_gives_back_in_the_impact_what_it_gained(
    gap: float, share: float
) -> None:
    effort = np.where(TIME < 0.3, 0.4, -0.4)
    run = free_run(effort, linkage.Backlash(gap, motor_share=share))
    rigid = free_run(effort).velocity
    reversal = 0.5 * (rigid[-1] * FREE.inertia / 0.4 + TIME[-1])
    expected = _two_inertias(gap, share, 0.4, reversal)
    lost = rigid - expected[1]
    assert np.abs(lost).max() > 0.05  # rad/s, while the gap is crossed
    np.testing.assert_allclose(rigid - run.velocity, lost, atol=0.1 * np.abs(lost).max())
    # Behind the impacts nothing is lost.
    np.testing.assert_allclose(run.velocity[TIME > 0.7], rigid[TIME > 0.7], atol=2e-3)


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_a_flexible_link_rings_as_two_inertias_do(share: float) -> None:
    run = free_run(np.full(801, 0.5), linkage.LinkFlexibility(share, 20.0, 0.0))
    rate = 2.0 * math.pi * 20.0 / math.sqrt(1.0 - share)
    ringing = share / (1.0 - share) * np.sin(rate * TIME) / rate
    expected = 0.5 / FREE.inertia * (TIME + ringing)
    np.testing.assert_allclose(run.velocity, expected, atol=0.01)  # of ringing 0.03 to 0.12


def test_gravity_pulls_at_what_hangs_behind_the_link() -> None:
    """Against the equations of motion of both inertias."""
    share, moment, effort = 0.3, 0.7, 0.3
    own = whole(FREE.replace(gravity_moment=moment), linkage.LinkFlexibility(share, 20.0, 0.05))
    start = math.asin(effort / moment)  # where the motor holds it
    run = one(Inputs(TIME, np.where(TIME < 0.1, effort, 0.0), position=start), own)
    sprung, shaft = share * FREE.inertia, (1.0 - share) * FREE.inertia
    rate = 2.0 * math.pi * 20.0

    def rates(t: float, x: Any) -> list[float]:
        bend = rate * rate * (x[0] - x[2]) + 2.0 * 0.05 * rate * (x[1] - x[3])
        given = effort if t < 0.1 else 0.0
        hanging = bend - moment / sprung * math.sin(x[2])
        return [x[1], (given - sprung * bend) / shaft, x[3], hanging]

    sag = moment / (sprung * rate * rate) * math.sin(start)
    found = solve_ivp(
        rates, (0.0, TIME[-1]), [start, 0.0, start - sag, 0.0],
        t_eval=TIME, rtol=1e-10, atol=1e-12, max_step=1e-3,
    )  # fmt: skip
    np.testing.assert_allclose(run.position, found.y[0], atol=1e-6)


def test_an_encoder_behind_the_link_shows_the_sprung_inertia() -> None:
    """Against the equation of motion, on uneven samples; and the shaft from what it shows."""
    effect, rate = linkage.LinkFlexibility(0.3, 25.0, 0.05, 1.0), 2.0 * math.pi * 25.0

    def shaft(t: Any) -> Any:
        return np.sin(3.0 * t) + 0.01 * np.sin(60.0 * t)

    def speed(t: Any) -> Any:
        return 3.0 * np.cos(3.0 * t) + 0.6 * np.cos(60.0 * t)

    def sprung(t: float, x: Any) -> list[float]:
        bend, bending = shaft(t) - x[0], speed(t) - x[1]
        return [x[1], rate * rate * bend + 2.0 * 0.05 * rate * bending]

    even = 1e-3 * np.arange(1000)
    time = np.sort(np.concatenate([even, np.random.default_rng(0).uniform(0.0, 0.999, 300)]))
    exact = solve_ivp(sprung, (0.0, 1.0), [0.0, speed(0.0)], t_eval=time, rtol=1e-10, atol=1e-12).y
    true = {"theta_rad": shaft(time), "velocity_rad_per_s": speed(time)}
    shown = effect.measure(true, time)
    assert np.abs(exact[0] - true["theta_rad"]).max() > 2e-3
    np.testing.assert_allclose(shown["theta_rad"], exact[0], atol=1e-5)
    np.testing.assert_allclose(shown["velocity_rad_per_s"], exact[1], atol=0.03)

    shown = effect.measure({"theta_rad": shaft(even)}, even)
    np.testing.assert_allclose(
        effect.unmeasured(shown, even)["theta_rad"][5:-5], shaft(even)[5:-5], atol=1e-5
    )


def test_an_encoder_on_the_shaft_is_no_sensors_error() -> None:
    on_shaft, on_link = (linkage.LinkFlexibility(0.3, encoder_on_link=e) for e in (0.0, 1.0))
    for port in ("measure", "unmeasured", "start_sensing", "sense"):
        assert overrides(on_link, port) and not overrides(on_shaft, port)
    assert overrides(on_shaft, "parameters")
    values = {"theta_rad": np.array([0.1, 0.3, 0.2])}
    time = np.array([0.0, 0.1, 0.2])
    no_link = linkage.LinkFlexibility(0.0, encoder_on_link=1.0)
    assert not overrides(no_link, "measure", "unmeasured")
    for effect in (on_shaft, no_link):
        assert effect.measure(values, time)["theta_rad"] is values["theta_rad"]


def integrated(
    effect: CatalogueEffect, points: list[Point], step: float, state: str, start: float
) -> Any:
    """An extra state along given points by Heun's method."""
    value = np.asarray(start)
    found = [value]
    for here, later in itertools.pairwise(points):
        first = effect.state_rates(dataclasses.replace(here, extra={state: value}), {})[state]
        trial = {state: value + step * first}
        second = effect.state_rates(dataclasses.replace(later, extra=trial), {})[state]
        value = value + 0.5 * step * (first + second)
        found.append(value)
    return np.array(found)


def dahl(compliance: float) -> friction.Presliding:
    """The bristle of Dahl's law: no more friction at rest, no damping."""
    return friction.Presliding(compliance, 0.0, bristle_damping_nm_s_per_rad=0.0)


def bristle_friction(effect: friction.Presliding, point: Point, share: float) -> Any:
    """All of dry friction, the bristle's with the rest of the base law's, against the motion."""
    known = dataclasses.replace(point, extra={"presliding_share": share})
    dry = REFERENCE.coulomb_effort * point.direction
    return effect.friction_effort(dry, known) - effect.external_effort(0.0, known)


@pytest.mark.parametrize("compliance", [1 / 400, 1 / 50])
def test_presliding_friction_builds_up_over_the_displacement(compliance: float) -> None:
    effect = dahl(compliance)
    span = compliance * REFERENCE.coulomb_effort
    step, speed = 5e-4, 0.05
    points = [moving(velocity=-speed, direction=-1.0)] * 200
    share = integrated(effect, points, step, "presliding_share", 1.0)
    travel = speed * step * np.arange(len(share))
    np.testing.assert_allclose(share, -1.0 + 2.0 * np.exp(-travel / span), atol=3e-3)
    # The friction is the bristle's: with the motion at first, against it in the end.
    felt = [bristle_friction(effect, p, s) for p, s in zip(points, share, strict=True)]
    np.testing.assert_allclose(felt, REFERENCE.coulomb_effort * share)


def test_a_bristle_holds_more_the_slower_it_slides() -> None:
    """g of LuGre's law, with the bristle's damping while it gives."""
    effect = friction.Presliding(1 / 400, 0.1, 0.02, 0.5)
    for speed in (0.005, 0.02, 0.1):
        point = moving(velocity=speed, direction=1.0)
        share = integrated(effect, [point] * 4000, 5e-4, "presliding_share", 0.0)
        level = REFERENCE.coulomb_effort + 0.1 * np.exp(-((speed / 0.02) ** 2))
        assert bristle_friction(effect, point, share[-1]) == pytest.approx(level, rel=1e-4)
        assert bristle_friction(effect, point, 0.0) == pytest.approx(0.5 * speed)


def test_a_bristle_at_rest_takes_up_the_applied_effort() -> None:
    effect = dahl(1 / 400)
    equal = {"pressure_a": 1e5, "pressure_b": 1e5, "velocity": 0.0, "direction": 0.0}
    share = integrated(effect, [moving(motor=0.1, **equal)] * 400, 5e-4, "presliding_share", 1.0)
    assert share[-1] == pytest.approx(0.1 / REFERENCE.coulomb_effort, rel=1e-6)


def test_a_shaft_on_a_bristle_creeps_and_springs_back() -> None:
    """Below breakaway it goes as far as the bristle gives, and back; the base model holds it."""
    rig = FREE.replace(static_effort=0.3, coulomb_effort=0.2)
    time = np.arange(8001) * 1e-3
    motor = np.interp(time, [0.0, 3.0, 5.0, 8.0], [0.0, 0.1, 0.1, 0.0])
    effect = friction.Presliding(1 / 100, 0.0, bristle_damping_nm_s_per_rad=1.0)
    path = one(Inputs(time, motor), whole(rig, effect)).position
    # At half the level it has given by ln 2 of its span, of which the way back is ln 1.5.
    span = 0.2 / 100
    assert path[4900] == pytest.approx(math.log(2.0) * span, rel=0.02)
    assert path[-1] == pytest.approx((math.log(2.0) - math.log(1.5)) * span, rel=0.05)
    assert np.ptp(one(Inputs(time, motor), whole(rig)).position) == 0.0


def test_presliding_fades_with_the_compliance() -> None:
    changes = [
        np.abs(
            one(driven(), whole(REFERENCE, friction.Presliding(c))).position - bare_run().position
        ).max()
        for c in (2.5e-3, 2.5e-4, 2.5e-6, 2.5e-8)
    ]
    assert changes[0] > changes[1] > changes[2] > changes[3]
    assert changes[3] < 1e-3 * changes[0]
