"""An axis tested alone: what its law lacks, told by tests that were left out."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from other_catalogues import only

import sysid.commands.diagnose
from sysid.commands.app import main
from sysid.diagnosis.actuator.signatures import candidates
from sysid.diagnosis.bench.axis import Axis, axis
from sysid.diagnosis.bench.component import Law, rmse
from sysid.diagnosis.bench.diagnose import diagnose_component
from sysid.diagnosis.bench.fitting import fit_law
from sysid.diagnosis.bench.registry import AXIS as KIND
from sysid.diagnosis.bench.selection import Attempt, Selection, select, simplest
from sysid.diagnosis.bench.unexplained import curves
from sysid.diagnosis.content import content
from sysid.diagnosis.lack_of_fit import LEAST_SHARE
from sysid.diagnosis.result import Diagnosis
from sysid.diagnosis.wording import sentence
from sysid.errors import NotIdentifiedError
from sysid.friction import fit_friction
from sysid.io.logs import Trial
from sysid.io.rig import Cylinder, Inertia, Motor, Rig
from sysid.parameters import Bundle, read_bundle
from sysid.parameters.assembled_model import effects_from_bundle
from sysid.plant.effects.catalogue import catalogue
from sysid.plant.effects.linear import for_rig
from sysid.types import FloatArray

Friction = Callable[[FloatArray], FloatArray]

RIG = Rig("axis", "horizontal", "linear")
CATALOGUE = for_rig(catalogue(), is_linear=True)
FRICTION = [
    CATALOGUE[name]
    for name in (
        "stribeck-friction", "asymmetric-viscous-friction", "power-law-friction", "cable-spring",
        "quadratic-drag", "torque-constant-error",
    )
]  # fmt: skip
SHORT = {kind.id: kind for kind in FRICTION}
MASS, COULOMB, VISCOUS, OFFSET = 90.0, 20.0, 200.0, 3.0


def plain(speed: FloatArray) -> FloatArray:
    return COULOMB * np.sign(speed) + VISCOUS * speed


def imposed(
    seed: int,
    friction: Friction,
    spring: float = 0.0,
    noise: float = 0.5,
    scale: float = 1.0,
    period: float = 0.002,
    seconds: float = 12.0,
) -> Trial:
    """A smooth motion of several speeds, 12 s at 500 Hz, and the force that it takes."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, seconds, period)
    phases = rng.uniform(0.0, 2.0 * np.pi, 3)
    waves = ((0.25, 0.045 * scale), (0.6, 0.012 * scale), (1.1, 0.006 * scale))
    position, speed, acceleration = (
        sum(
            size * (2.0 * np.pi * f) ** k * np.sin(2.0 * np.pi * f * time + p + 0.5 * np.pi * k)
            for (f, size), p in zip(waves, phases, strict=True)
        )
        for k in range(3)
    )
    force = MASS * acceleration + friction(np.asarray(speed)) + OFFSET + spring * position
    force = force + noise * rng.normal(size=len(time))
    channels = {"position_m": np.asarray(position), "motor_force_n": np.asarray(force)}
    return Trial(f"trial {seed}", time, channels, f"trial {seed}")


def built(friction: Friction, seeds: tuple[int, ...] = (1, 2, 3, 4), spring: float = 0.0) -> Axis:
    return axis([imposed(seed, friction, spring) for seed in seeds], RIG)


def test_the_law_is_found_where_nothing_is_missing() -> None:
    part = built(plain)
    fitted = fit_law(part, (), range(len(part.tests)))
    found = fitted.base_estimates()
    for name, truth in (
        ("coulomb_n", COULOMB), ("viscous_n_s_per_m", VISCOUS), ("mass_kg", MASS),
    ):  # fmt: skip
        assert found[name].value == pytest.approx(truth, rel=0.01), name
    assert found["offset_n"].value == pytest.approx(OFFSET, rel=0.05)
    selection = select(part, CATALOGUE)
    assert selection.additions == ()
    rejected = selection.rounds[-1].tried
    assert rejected and max(a.reduction for a in rejected) < 0.2


def test_friction_that_falls_with_the_speeds_of_a_fast_shaft_is_tried() -> None:
    """A fan that is never slower than a speed at which the usual form has long faded away."""

    def one_way(seed: int) -> Trial:
        time = np.arange(0.0, 6.0, 0.004)
        wave = 2.0 * np.pi * (0.1 + 0.05 * seed)
        speed = 1.5 + 40.0 * (1.0 - np.cos(wave * time))
        angle = 41.5 * time - 40.0 / wave * np.sin(wave * time)
        torque = 8e-4 * 40.0 * wave * np.sin(wave * time) + 0.12 + 2e-3 * speed
        torque += 0.25 * np.exp(-((speed / 5.0) ** 2))
        torque += 0.004 * np.random.default_rng(seed).normal(size=len(time))
        channels = {"theta_rad": angle, "motor_torque_nm": torque}
        return Trial(f"fan {seed}", time, channels, f"fan {seed}")

    part = axis([one_way(seed) for seed in (1, 2, 3)], Rig("fan", "horizontal", "rotary"))
    found = select(part, catalogue(), quick=True)
    assert [step.id for step in found.additions] == ["stribeck-friction"]
    (effect,) = found.final.law.effects
    assert effect.stribeck_torque_nm == pytest.approx(0.25, rel=0.02)  # type: ignore[attr-defined]
    assert effect.stribeck_velocity_rad_per_s == pytest.approx(5.0, rel=0.02)  # type: ignore[attr-defined]


def test_laws_at_once_leave_what_each_leaves_alone() -> None:
    part = built(plain, (1, 2))
    fitted = fit_law(part, (), range(2)).law
    for kind in part.effects(CATALOGUE):
        # As many as need several turns, the last two the same.
        some = [{q.name: k * q.typical for q in kind.strengths()} for k in (0.5, 1.0, 0.0, 0.0)]
        laws = [Law(fitted.values, (kind.typical(**own),)) for own in some]
        more = [Law({**fitted.values, "coulomb_n": 20.0 + i}, laws[0].effects) for i in range(7)]
        laws = more + laws
        together = part.residuals_of(laws, (0, 1))
        for law, found in zip(laws, together, strict=True):
            for alone, own in zip(part.residuals(law, (0, 1)), found, strict=True):
                np.testing.assert_allclose(own, alone, rtol=0.0, atol=1e-9 * np.abs(alone).max())


@pytest.mark.parametrize(
    ("name", "friction", "value"),
    [
        ("asymmetric-viscous-friction", lambda v: plain(v) - 40.0 * np.abs(v), -40.0),
        (
            "power-law-friction",
            lambda v: 10.0 * np.sign(v) + 100.0 * np.sign(v) * np.abs(v) ** 0.5,
            100.0,
        ),
    ],
)
def test_an_effect_is_found_and_predicts(name: str, friction: Friction, value: float) -> None:
    part, outside = built(friction), built(friction, (11, 12))
    selection = select(part, SHORT)
    assert [a.id for a in selection.additions] == [name]
    effect = selection.additions[0].effect
    strength = type(effect).strengths()[0].name
    assert selection.final.estimates(effect)[strength].value == pytest.approx(value, rel=0.15)
    before, after = (
        rmse(outside.residuals(fit.law, range(2))) for fit in (selection.base, selection.final)
    )
    assert after < 0.7 * before
    assert after < 1.3 * outside.noise_floor(selection.final.law)


def test_no_motor_gain_explains_everything_away() -> None:
    """Scaling force, friction and mass together changes nothing."""
    part = built(lambda v: plain(v) - 40.0 * np.abs(v))
    gain = CATALOGUE["torque-constant-error"]
    assert select(part, {gain.id: gain}).additions == ()
    law = fit_law(part, (), range(4)).law
    halved = Law({k: 0.5 * v for k, v in law.values.items()}, (gain(-0.5),))
    plain_error, scaled = (rmse(part.residuals(each, range(4))) for each in (law, halved))
    assert scaled == pytest.approx(plain_error, rel=1e-6)


def test_no_friction_that_takes_what_the_motor_gives_explains_everything_away() -> None:
    part = built(lambda v: plain(v) + 60.0 * np.abs(v) * np.sign(v) * np.sin(9.0 * v))
    kind = CATALOGUE["load-dependent-friction"]
    law = fit_law(part, (), range(4)).law
    scaled = Law({k: 0.1 * v for k, v in law.values.items()}, (kind(0.9),))
    plain_error, error = (rmse(part.residuals(each, range(4))) for each in (law, scaled))
    assert error > 0.8 * plain_error
    assert not part.is_possible(scaled)
    assert part.is_possible(Law(law.values, (kind(0.15),)))


def slide(seed: int) -> Trial:
    """At four constant speeds each way, as slow axes are tested: friction is most of the force."""
    rng = np.random.default_rng(seed)
    speeds = []
    for level in (0.03, -0.03, 0.08, -0.08, 0.16, -0.16, 0.25, -0.25):
        own = np.full(int(min(1.2, 0.28 / abs(level)) / 0.002), level)
        own[:40] = np.linspace(0.0, level, 40)
        own[-40:] = own[39::-1]
        speeds += [own, np.zeros(50)]
    speed = np.concatenate(speeds)
    time = 0.002 * np.arange(len(speed))
    position = np.concatenate([[0.0], np.cumsum(0.001 * (speed[1:] + speed[:-1]))])
    force = 3.1 * np.gradient(speed, time) + 30.0 * np.tanh(speed / 1e-3) + 110.0 * speed
    force += 4.0 * rng.standard_normal(len(time))
    return Trial(f"slide {seed}", time, {"position_m": position, "motor_force_n": force}, "slides")


@pytest.mark.parametrize("motor", [None, Motor(max_force_n=120.0)])
def test_no_limit_below_friction_explains_everything_away(motor: Motor | None) -> None:
    """It clips all that a log of slides holds, to what Coulomb friction alone explains."""
    part = axis([slide(seed) for seed in (1, 2, 3, 4)], replace(RIG, motor=motor))
    limits = {"torque-saturation": CATALOGUE["torque-saturation"]}
    assert (limits["torque-saturation"] in part.effects(limits)) == (motor is not None)
    selection = select(part, limits)
    assert selection.additions == ()
    assert selection.base.base_estimates()["mass_kg"].value == pytest.approx(3.1, rel=0.1)
    below, above = (
        Law(selection.base.law.values, (limits["torque-saturation"](1.0 / limit),))
        for limit in (20.0, 50.0)
    )
    assert part.is_possible(above) and not part.is_possible(below)


def test_what_no_effect_explains_has_a_curve() -> None:
    part = axis([imposed(seed, plain, noise=0.2) for seed in (1, 2, 3, 4)], RIG)
    bumpy = [
        Trial(
            t.label,
            t.time,
            {**t.channels, "motor_force_n": t["motor_force_n"] + 6.0 * (t["position_m"] > 0.02)},
            t.source,
        )
        for t in part.trials
    ]
    part = axis(bumpy, RIG)
    law = fit_law(part, (), range(4)).law
    best = curves(part, law, law)[0]
    assert best.regressor == "position" and best.share > 0.5
    assert best.after[-1] - best.after[len(best.after) // 2] > 2.0


# --- a cylinder that a screw drives ------------------------------------------------------

CYLINDER = Rig(
    "cylinder",
    "horizontal",
    "linear",
    air=None,
    cylinder=Cylinder(
        area_a_m2=5e-4, area_b_m2=5e-4, offset_a_m=0.1, offset_b_m=0.1, stroke_m=0.12
    ),
)


def driven(gauge: float, seed: int, seal: float = 1e-5, area: float = 5e-4) -> Trial:
    """In and out at one speed each way, slower against more pressure, at 100 Hz."""
    from dataclasses import replace

    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 20.0, 0.01)
    forth, back = 0.010 - 4e-9 * gauge, 0.012
    legs = 0.03 * np.array([0.0, 1.0 / forth, 1.0 / forth + 1.0 / back])
    place = np.interp(time % legs[2], legs, [0.0, 0.03, 0.0]) + 1e-5 * rng.normal(size=len(time))
    way = np.where(time % legs[2] < legs[1], 1.0, -1.0)
    pressure = gauge + 500.0 * rng.normal(size=len(time))
    force = area * pressure + way * (6.0 + seal * gauge) + 0.2 * rng.normal(size=len(time))
    channels = {"position_m": place, "motor_force_n": force, "pressure_b_pa": 101325.0 + pressure}
    trial = Trial(f"{gauge:g} Pa", time, channels, f"{gauge:g} Pa")
    return replace(trial)


def cylinder_rig() -> Rig:
    from dataclasses import replace

    from sysid.io.rig import Air

    return replace(
        CYLINDER,
        air=Air(
            gas_constant_j_per_kg_k=287.0,
            heat_capacity_ratio=1.4,
            temperature_k=293.15,
            atmospheric_pressure_pa=101325.0,
            supply_pressure_pa=8e5,
        ),
        inertia=None,
    )


def screw(seal: float, area: float = 5e-4, only: str | None = None) -> Axis:
    from dataclasses import replace

    rig = replace(cylinder_rig(), inertia=Inertia(mass_kg=0.2))
    trials = [driven(g, k, seal, area) for k, g in enumerate((1e5, 3e5, 5e5, 7e5))]
    return axis(trials, rig)


def test_one_speed_each_way_tells_no_law_over_speed() -> None:
    part = screw(1e-5)
    # Both directions tell an offset from friction, whatever friction is over speed.
    assert [p.name for p in part.parameters()] == ["coulomb_n", "offset_n"]
    ids = {kind.id for kind in part.effects(CATALOGUE)}
    assert "seal-friction" in ids
    assert not {"stribeck-friction", "quadratic-drag", "asymmetric-viscous-friction"} & ids
    result = fit_friction(list(part.trials), part.rig)
    assert not result["viscous_n_s_per_m"].identified
    assert not result["coulomb_n"].identified
    assert "further speeds" in (result["viscous_n_s_per_m"].reason or "")
    sliding = result.combinations[0]
    assert sliding.of == ("coulomb_n", "viscous_n_s_per_m")
    assert sliding.estimate.value == pytest.approx(6.0 + 1e-5 * 4e5, rel=0.1)
    bundle = Bundle.new(part.rig, result.part(), [])
    offset = result["offset_n"]
    assert offset.identified and offset.holds(0.0)
    held = {"coulomb_n": sliding.estimate.value, "offset_n": offset.value}
    assert part.law_of(bundle).values == held


@pytest.mark.slow
def test_seal_friction_and_a_wrong_area_are_told_apart() -> None:
    found = select(screw(1e-5), CATALOGUE)
    assert found.additions[0].id == "seal-friction"
    assert getattr(found.final.law.effects[0], "seal_torque_nm_per_pa") == pytest.approx(  # noqa: B009
        1e-5, rel=0.1
    )
    found = select(screw(0.0, area=5.1e-4), CATALOGUE)
    assert [a.id for a in found.additions] == ["area-error"]
    assert getattr(found.final.law.effects[0], "area_change_m2") == pytest.approx(  # noqa: B009
        1e-5, rel=0.1
    )
    assert "torque-constant-error" in found.additions[0].ambiguous


def test_an_axis_at_rest_is_refused() -> None:
    still = imposed(1, plain)
    nothing = Trial(
        "still", still.time, {**still.channels, "position_m": 0.0 * still["position_m"]}, "still"
    )
    with pytest.raises(NotIdentifiedError, match="hardly moves"):
        axis([nothing], RIG)


def test_a_spring_leaves_the_offset_its_number() -> None:
    """Where a spring is slack would be the same constant force again: neither was known then, and a
    bundle held the one without the other."""
    kinds = {"cable-spring": CATALOGUE["cable-spring"]}
    (found,) = select(built(plain, spring=2000.0), kinds, quick=True).additions
    offset = found.fitted.base_estimates()["offset_n"]
    assert offset.identified and abs(offset.value - OFFSET) < 4.0 * offset.std
    assert found.fitted.part().friction is not None
    numbers = found.fitted.estimates(found.effect)
    assert list(numbers) == ["stiffness_nm_per_rad"]
    stiffness = numbers["stiffness_nm_per_rad"]
    assert abs(stiffness.value - 2000.0) < 4.0 * stiffness.std
    assert pickle.loads(pickle.dumps(found.effect)) == found.effect


# --- waves over the position -------------------------------------------------------------

RIPPLES = ("torque-ripple", "gear-mesh-ripple")


def short(*effects: str, spring: float = 0.0, scale: float = 0.35) -> Selection:
    """What of these is found on a stroke of 43 mm (and less)."""
    trials = [imposed(seed, plain, spring, scale=scale, period=0.008) for seed in (1, 2, 3, 4)]
    return select(axis(trials, RIG), {name: CATALOGUE[name] for name in effects})


def test_a_ripple_has_a_period_within_the_stroke() -> None:
    """A slope is no ripple: less than a period fits any curve of low order."""
    found = short(*RIPPLES, spring=2000.0)
    part = found.base.component
    assert 0.03 < part.travel < 0.05
    for name in RIPPLES:
        (wave,) = (q for q in part.quantities_of(CATALOGUE[name]) if q.is_wave)
        assert (
            wave.lower == pytest.approx(2.0 * np.pi / part.travel) and min(wave.grid) >= wave.lower
        )
        fitted = fit_law(part, [CATALOGUE[name]], range(len(part.tests)))
        assert getattr(fitted.law.effects[0], wave.name) >= wave.lower
    assert short(*RIPPLES, "cable-spring", spring=2000.0).additions[0].id == "cable-spring"


def test_a_ripple_is_searched_up_to_what_the_sampling_resolves() -> None:
    """Of a stroke shorter than the catalogue's shortest wave; a fine wave is found."""
    part = short("cable-spring", scale=0.01).base.component
    (wave,) = (q for q in part.quantities_of(CATALOGUE["torque-ripple"]) if q.is_wave)
    assert wave.lower == pytest.approx(2.0 * np.pi / part.travel)
    assert wave.upper == pytest.approx(np.pi / part.spacing)
    number = 2.0 * np.pi / 0.0012

    def rippled(seed: int) -> Trial:
        trial = imposed(seed, plain, scale=0.02)
        force = trial["motor_force_n"] - 8.0 * np.cos(number * trial["position_m"])
        return replace(trial, channels={**trial.channels, "motor_force_n": force})

    found = select(axis([rippled(s) for s in (1, 2, 3)], RIG), {k: CATALOGUE[k] for k in RIPPLES})
    assert found.additions[0].id == "gear-mesh-ripple"
    effect = found.final.law.effects[0]
    assert getattr(effect, "mesh_wave_per_rad") == pytest.approx(number, rel=0.01)  # noqa: B009
    assert getattr(effect, "mesh_cosine_nm") == pytest.approx(8.0, rel=0.1)  # noqa: B009


def test_a_stroke_too_short_for_any_period_has_no_ripple() -> None:
    travel = 0.001
    assert CATALOGUE["torque-ripple"].within(travel) is None
    forms = candidates(CATALOGUE.values(), travel=travel)
    ids = {form.id for form in forms}
    assert not ids & {"torque-ripple", "gear-mesh-ripple"} and "cable-spring" in ids
    waves = {
        dict(f.shape).get("ripple_wave_per_rad", 1e9) for f in candidates(CATALOGUE.values(), 0.04)
    }
    assert min(waves) >= 2.0 * np.pi / 0.04 and len(waves) > 10


@pytest.mark.parametrize(
    ("gain", "squares", "chosen"),
    [
        (0.79, 1.0005, "cable-spring"),  # as good, and simpler
        (0.79, 1.1, "gear-mesh-ripple"),  # the BIC says otherwise
        (0.60, 1.0005, "gear-mesh-ripple"),  # and so do tests left out
    ],
)
def test_of_two_that_predict_as_well_the_simpler_is_taken(
    gain: float, squares: float, chosen: str
) -> None:
    def tried(id: str, gain: float, numbers: int, squares: float) -> Any:
        fit = SimpleNamespace(values=np.zeros(numbers), sum_of_squares=squares)
        attempt = Attempt(id, gain, 1e-9, np.zeros(3))
        return attempt, SimpleNamespace(fit=fit, independent_samples=200.0)

    passing = [tried("gear-mesh-ripple", 0.8, 7, 1.0), tried("cable-spring", gain, 5, squares)]
    assert simplest(passing)[0].id == chosen
    assert simplest(passing[:1])[0].id == "gear-mesh-ripple"


# --- what is left ------------------------------------------------------------------------


def forced(seed: int, law: Friction, more: Callable[[Trial], FloatArray]) -> Trial:
    trial = imposed(seed, law)
    force = trial["motor_force_n"] + more(trial)
    return replace(trial, channels={**trial.channels, "motor_force_n": force})


def verdict_on(
    laws: Sequence[Friction], more: Callable[[Trial], FloatArray], *effects: str
) -> Diagnosis:
    """Of the last two tests held out, with these effects to try; each test has its own friction."""
    trials = [forced(seed, law, more) for seed, law in enumerate(laws, start=1)]
    part = axis(trials[:-2], RIG)
    given = Bundle.new(RIG, fit_law(part, (), range(len(part.tests))).part(), [])
    kinds = {name: CATALOGUE[name] for name in effects}
    return diagnose_component(KIND, trials[:-2], trials[-2:], RIG, given, kinds)


def test_what_repeats_over_two_quantities_together_is_unexplained() -> None:
    """The mean over either alone is 0."""

    def more(trial: Trial) -> FloatArray:
        place = trial["position_m"] / 0.02
        ahead = np.gradient(trial["position_m"], trial.time)
        return np.asarray(8.0 * np.sin(place) * np.sin(ahead / 0.02))

    found = verdict_on([plain] * 6, more)
    assert found.to_json()["curves"][0]["share"] < LEAST_SHARE
    assert found.verdict == "unexplained" and found.reason == "structure"
    (rest,) = found.remainder
    assert rest.repeatable > 2.0
    assert found.unexplained[0].share == rest.share


def test_a_ripple_finer_than_a_dozen_bins_is_not_taken_for_noise() -> None:
    """The sensors are quiet: what changes within the residual is no noise of theirs."""
    found = verdict_on([plain] * 6, lambda trial: 8.0 * np.sin(trial["position_m"] / 0.0013))
    assert found.verdict == "unexplained" and found.reason == "structure"
    assert found.unexplained[0].regressor == "position" and found.unexplained[0].share > 0.5
    error = found.residual["motor_force_n"]
    assert error.noise_floor < 0.3 * error.after
    (rest,) = found.remainder
    assert rest.regressors == ("position",)


def test_friction_that_scatters_from_test_to_test_is_no_structure() -> None:
    factors = 1.0 + 0.05 * np.random.default_rng(5).normal(size=6)
    found = verdict_on([lambda v, f=f: f * plain(v) for f in factors], lambda trial: 0.0)
    assert found.verdict == "adequate" and found.reason is None
    (rest,) = found.remainder
    assert rest.rmse > 1.5 * rest.noise


SCATTERS = (0.97, 1.04, 1.0, 0.95, 1.03)


def scattering(more: Friction = lambda v: 0.0 * v, first: int = 1) -> Axis:
    """Tests each with its own share of friction, and the same `more` in all."""
    laws = [lambda v, f=f: f * plain(v) + more(v) for f in SCATTERS]
    return axis([imposed(first + i, law) for i, law in enumerate(laws)], RIG)


@pytest.mark.parametrize("first", [1, 21, 41])
def test_friction_of_each_test_makes_no_effect_significant(first: int) -> None:
    """The samples of a test share its friction: they are no evidence of a form of its own."""
    selection = select(scattering(first=first), SHORT)
    assert selection.additions == ()
    (last,) = selection.rounds
    assert min(tried.p_value for tried in last.tried) > 1e-3


def test_friction_of_each_test_hides_no_effect() -> None:
    part = scattering(lambda v: 100.0 * v * np.abs(v))
    (found,) = select(part, SHORT).additions
    assert found.id == "quadratic-drag"
    (drag,) = found.fitted.estimates(found.effect).values()
    assert abs(drag.value - 100.0) < 3.0 * drag.std and drag.std < 10.0
    # Errors are shown on the residuals as they are, with each test's own friction.
    everything = range(len(part.tests))
    shown = rmse(part.residuals(found.fitted.law, everything))
    assert shown == pytest.approx(float(np.sqrt(found.folds.mean())), rel=0.3)
    assert found.fitted.component is part


def test_a_held_out_test_with_friction_of_its_own_leaves_an_effect_as_it_is() -> None:
    """Its error is larger with the effect by chance, but for its own friction it is smaller."""
    factors = (*SCATTERS, 0.93, 0.93)
    laws = [lambda v, f=f: f * plain(v) + 100.0 * v * np.abs(v) for f in factors]
    found = verdict_on(laws, lambda trial: 0.0, "quadratic-drag")
    assert all(error.after > error.before for error in found.residual.values())
    assert [effect.id for effect in found.effects] == ["quadratic-drag"]
    assert found.verdict == "effects-found", found.to_json()


def test_errors_far_above_the_noise_are_not_adequate() -> None:
    """As of logs that do not belong together, though they share no structure."""
    offsets = (0.0, 40.0, -40.0, 0.0, 60.0, -60.0)
    found = verdict_on([lambda v, o=o: plain(v) + o for o in offsets], lambda trial: 0.0)
    assert found.verdict == "unexplained" and found.reason == "held-out errors"
    assert "a log that is not like the others" in found.notices[-1]
    assert found.effects == () and len(found.unexplained) == 1


def at_turns(trial: Trial) -> FloatArray:
    """Friction of a shaft that sticks for 8 ms where it turns, which no reading tells."""
    way = np.sign(np.gradient(trial["position_m"]))
    stuck = np.zeros(len(way))
    for turn in np.flatnonzero(np.diff(way) != 0.0):
        stuck[turn + 1 : turn + 5] = -1.5 * COULOMB * way[turn + 1]
    return stuck


def test_what_a_turn_hides_is_neither_friction_nor_structure() -> None:
    found = verdict_on([plain] * 6, at_turns)
    assert found.verdict == "adequate", found.to_json()
    error = found.residual["motor_force_n"]
    assert error.after < 1.3 * error.noise_floor


def slow_joint(seed: int) -> Trial:
    """A joint on nearly a sine, 30 s at 64 Hz, whose friction takes some rows about each turn to
    change its sign."""
    period, size = 0.0155, 0.005 * (1.0 + 0.1 * seed)
    rng = np.random.default_rng(seed)
    time = period * np.arange(1900)

    def angle(at: FloatArray) -> FloatArray:
        phase = (at / 9.8 + 0.1 * seed) % 1.0
        ramp = np.where(phase < 0.5, 4.0 * phase - 1.0, 3.0 - 4.0 * phase)
        return np.asarray(size * np.sin(0.49 * np.pi * ramp))

    # The torque acts from its row to the next.
    speed = (angle(time + period) - angle(time)) / period
    torque = 5.4 * np.tanh(speed / 1e-4) + 0.002 * rng.normal(size=len(time))
    name = f"trial {seed}"
    return Trial(name, time, {"theta_rad": angle(time), "motor_torque_nm": torque}, name)


def test_how_friction_goes_through_a_turn_is_no_spring() -> None:
    """An inertia and a spring, both free, cancel on a sine but at its turns, which they imitate."""
    kinds = {"cable-spring": catalogue()["cable-spring"]}
    part = axis([slow_joint(seed) for seed in (1, 2, 3)], Rig("joint", "horizontal", "rotary"))
    selection = select(part, kinds, quick=True)
    assert selection.additions == ()
    left = part.residuals(selection.base.law, range(3))
    assert rmse(left) < 1.2 * part.noise_floor(selection.base.law)


def test_an_inertia_that_is_hardly_there_is_tried() -> None:
    """A change beyond what is declared changes nothing more: a fit that began there stayed."""
    rig = replace(RIG, inertia=Inertia(mass_kg=MASS))
    trials = [imposed(seed, plain) for seed in (1, 2, 3)]
    for trial in trials:
        pushed = MASS * np.gradient(np.gradient(trial["position_m"], trial.time), trial.time)
        trial.channels["motor_force_n"] -= 0.999 * pushed
    part = axis(trials, rig)
    kind, tests = CATALOGUE["inertia-mismatch"], range(3)
    (change,) = (q for q in part.quantities_of(kind) if q.unit == "kg")
    assert change.anywhere == (-0.98 * MASS, np.inf)
    base = fit_law(part, (), tests)
    fitted = fit_law(part, [kind], tests)
    assert fitted.p_value(base) < 1e-10
    assert not fitted.is_plausible  # it goes behind effects that explain the tests within theirs


def test_a_cushion_at_the_ends_is_told_from_what_turns_leave() -> None:
    def pushed(trial: Trial) -> FloatArray:
        depth = np.maximum(np.abs(trial["position_m"]) - 0.035, 0.0)
        return np.asarray(2e4 * np.sign(trial["position_m"]) * depth + at_turns(trial))

    part = axis([forced(seed, plain, pushed) for seed in (1, 2, 3, 4)], RIG)
    kinds = {name: CATALOGUE[name] for name in ("end-cushion", "cable-spring", "quadratic-drag")}
    (found,) = select(part, kinds).additions
    assert found.id == "end-cushion" and found.share > 0.9


def test_an_effect_that_does_not_predict_the_held_out_tests_explains_nothing() -> None:
    name = "asymmetric-viscous-friction"
    laws = [lambda v, s=s: plain(v) - 40.0 * s * np.abs(v) for s in (1, 1, 1, 1, -1, -1)]
    found = verdict_on(laws, lambda trial: 0.0, name)
    assert [effect.id for effect in found.effects] == [name]
    assert found.verdict == "unexplained" and found.reason == "held-out errors"
    assert f"of help on the training tests alone: {name}" in sentence(content(found))


# --- the commands --------------------------------------------------------------------------


@pytest.fixture
def campaign(tmp_path: Path) -> Path:
    """Logs of an axis whose viscous friction differs by direction; one of four held out."""
    (tmp_path / "rig.toml").write_text(
        '[rig]\nname = "axis"\nmotion = "linear"\norientation = "horizontal"\n'
    )
    text = 'rig = "rig.toml"\n'
    for seed in (1, 2, 3, 4):
        trial = imposed(seed, lambda v: plain(v) - 40.0 * np.abs(v), period=0.004, seconds=4.0)
        table = pd.DataFrame({"time_s": trial.time, **trial.channels})
        table.to_csv(tmp_path / f"{seed}.csv", index=False)
        text += f'\n[[log]]\nkind = "friction-motion"\nfile = "{seed}.csv"\n'
        text += 'use = "holdout"\n' if seed == 4 else ""
    (tmp_path / "campaign.toml").write_text(text)
    return tmp_path / "campaign.toml"


@pytest.fixture
def few_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of friction and a motor: how many are tried decides nothing here."""
    only(SHORT, monkeypatch)


def test_the_commands(
    campaign: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    original, diagnosed = sysid.commands.diagnose.diagnose_campaign, []

    def once(*paths: Path, **options: Any) -> Any:
        diagnosed[:] = diagnosed or [original(*paths, **options)]  # and printed twice
        return diagnosed[0]

    monkeypatch.setattr(sysid.commands.diagnose, "diagnose_campaign", once)
    folder = campaign.parent
    bundle, extended = str(folder / "b.json"), folder / "x.json"
    assert main(["fit", str(campaign), "-o", bundle]) == 0
    capsys.readouterr()
    words = ["diagnose", str(campaign), "--bundle", bundle, "-o", str(extended)]
    assert main([*words, "--report", str(folder / "r.html"), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["verdict"] == "effects-found"
    assert [e["id"] for e in content["effects"]] == ["asymmetric-viscous-friction"]
    value = content["effects"][0]["parameters"]["viscous_asymmetry_n_s_per_m"]
    assert value["value"] == pytest.approx(-40.0, rel=0.1) and value["unit"] == "N s/m"
    error = content["residual"]["motor_force_n"]
    assert error["after"] < 0.7 * error["before"]
    assert set(content["residual"]) == {"motor_force_n", "position_m"}
    assert content["unexplained"] == []
    found = read_bundle(extended)
    (effect,) = effects_from_bundle(found)
    assert getattr(effect, "viscous_asymmetry_nm_s_per_rad") == value["value"]  # noqa: B009
    assert found.friction is not None and found.friction.mass_kg is not None
    assert found.friction.mass_kg.value == pytest.approx(MASS, rel=0.01)
    page = (folder / "r.html").read_text()
    assert "asymmetric-viscous-friction" in page and "tested alone" in page
    assert main(words) == 0
    assert "Effects found: asymmetric-viscous-friction" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.usefixtures("few_effects")
def test_a_whole_run_that_was_cut_short_is_done_again_with_more_time(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = campaign.parent / "out"

    def diagnosing(budget: str) -> tuple[dict[str, Any], str, dict[str, Any]]:
        """The stage, the notices and the diagnosis of a run with a budget."""
        assert main(["run", str(campaign), "-o", str(out), "--json", "--budget", budget]) == 0
        printed = capsys.readouterr()
        content = json.loads(printed.out)
        (stage,) = (s for s in content["stages"] if s["name"] == "diagnose")
        said = [line for line in printed.err.splitlines() if "notice: diagnose: incomplete" in line]
        return stage, "".join(said), content["diagnosis"]

    stage, said, diagnosis = diagnosing("1e-9")
    assert stage["why"] == "not done yet" and not stage["complete"] and "--budget" in said
    # The first round always ends.
    assert diagnosis["verdict"] == "incomplete" and diagnosis["because"] is None
    assert diagnosis["effects"][0]["id"] == "asymmetric-viscous-friction"
    assert diagnosis["not_done"][0] == {"stage": "fit of effects", "round": 2, "effect": None}
    for budget in ("1e-9", "1e-10"):
        stage, said, _ = diagnosing(budget)
        assert stage["why"] is None and not stage["complete"] and "--budget" in said
    stage, said, diagnosis = diagnosing("600")
    assert "incomplete after" in stage["why"] and stage["complete"] and not said
    assert diagnosis["verdict"] == "effects-found"
    assert diagnosis["effects"][0]["id"] == "asymmetric-viscous-friction"
    assert "tested alone" in (out / "report.html").read_text()
    assert "viscous_asymmetry_n_s_per_m" in (out / "export" / "model.json").read_text()
    stage, said, _ = diagnosing("900")
    assert stage["why"] is None and stage["complete"] and not said


@pytest.mark.usefixtures("few_effects")
def test_without_a_held_out_log_tests_are_left_out_in_turn(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    campaign.write_text(campaign.read_text().replace('use = "holdout"\n', ""))
    bundle = str(campaign.parent / "b.json")
    assert main(["fit", str(campaign), "-o", bundle]) == 0
    capsys.readouterr()
    assert main(["diagnose", str(campaign), "--bundle", bundle, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert any("left out of the fit in turn" in line for line in content["notices"])
    assert content["judged_on"] == "fit"
    error = content["residual"]["motor_force_n"]
    assert error["after"] < 0.7 * error["before"]


def test_kinds_of_two_parts_do_not_mix(campaign: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bundle = str(campaign.parent / "b.json")
    assert main(["fit", str(campaign), "-o", bundle]) == 0
    text = campaign.read_text()
    for kind in ("tank", "valve-time"):
        text += f'\n[[log]]\nkind = "{kind}"\nfile = "{len(kind)}x.csv"\n'
        (campaign.parent / f"{len(kind)}x.csv").write_text("time_s,duty_a\n0,0\n1,1\n")
    campaign.write_text(text)
    capsys.readouterr()
    assert main(["diagnose", str(campaign), "--bundle", bundle]) == 2
    assert "give each kind its own campaign" in capsys.readouterr().err


def test_an_axis_without_tests_in_motion_is_told_to_add_some(
    campaign: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was told to declare the air of a rig that has none."""
    bundle = str(campaign.parent / "b.json")
    assert main(["fit", str(campaign), "-o", bundle]) == 0
    slides = slide(1)
    table = pd.DataFrame({"time_s": slides.time, **slides.channels})
    table.to_csv(campaign.parent / "slides.csv", index=False)
    campaign.write_text(
        'rig = "rig.toml"\n[[log]]\nkind = "friction-sliding"\nfile = "slides.csv"\n'
    )
    capsys.readouterr()
    assert main(["diagnose", str(campaign), "--bundle", bundle]) == 3
    (line,) = [n for n in capsys.readouterr().err.splitlines() if "error: " in n]
    assert "tests of kind friction-motion" in line and "[air]" not in line
