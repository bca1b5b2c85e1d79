"""The model that a bundle describes: parameters, and its valves' flow laws under PWM."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from sysid.errors import NotIdentifiedError, input_error
from sysid.io.channels import SIDES
from sysid.io.motion import FRICTION
from sysid.io.rig import Rig, require_inertia
from sysid.parameters.base import Part
from sysid.parameters.content import BundleContent
from sysid.parameters.effects import effect_from_entry
from sysid.parameters.friction import Friction
from sysid.parameters.possible import impossible, is_possible, stated
from sysid.parameters.valves import (
    AVERAGED,
    DIRECTIONS,
    LAW_KEYS,
    SURFACE_KINDS,
    VALVE_ALONE,
    DirectionalLaw,
    DiscreteLaw,
    PwmSurfaces,
    Valve,
)
from sysid.plant.base import (
    Parameters,
    ValveParameters,
    bare_parameters,
    exhaust_jump,
    filling_jump,
    parameters_from_rig,
)
from sysid.plant.effects.catalogue import catalogue_with
from sysid.plant.effects.entry import Catalogue
from sysid.plant.effects.linear import for_rig
from sysid.plant.iso6358 import USUAL_RATIO
from sysid.plant.ports import Effect, Model, has_discrete_law
from sysid.plant.trials import DISCRETE
from sysid.surfaces.averaged import AveragedLaw
from sysid.surfaces.domain import SAME_SUPPLY
from sysid.surfaces.hull import NoValve, ValveLaw

MEAN_FLOW_MODELS = (AVERAGED, *SURFACE_KINDS)
VALVE_MODELS = (DISCRETE, *MEAN_FLOW_MODELS)

_OTHER_REGIME = {
    "choked_fill": "c_fill",
    "c_fill": "choked_fill",
    "choked_dis": "c_dis",
    "c_dis": "choked_dis",
}


def parameters_from_bundle(bundle: BundleContent, rig: Rig, held: bool = False) -> Parameters:
    """The base model's parameters: fitted ones from `bundle`, the others from `rig`.

    `held`: of a shaft that is fixed, for tests in which nothing moves, where neither friction nor
    an inertia is needed.

    A fitted inertia holds with the payload of the bundle's rig: what `rig`'s differs by is added.
    Choked filling holds at the supply of the bundle's rig, and is proportional to `rig`'s.
    A valve without a discrete law gets NaN flows, so that it cannot be used by mistake; see
    `has_discrete_law`. The offset that a friction fit estimates in addition is omitted: the base
    model has none, and an offset that is only noise would make an open-loop position drift
    (the effect `torque-offset` is for a real one). A motor alone (`Rig.is_motor_alone`) has it:
    the motion that gave its law gave the offset too. Negative friction is set to 0, static friction
    that is not identified to Coulomb friction, Coulomb friction of which only a sum is identified
    to that sum, a fitted inertia that is not above 0 to the rig file's, a valve's flow that its
    on/off tests do not identify, or that is below 0, to that of its PWM tests or of the other
    regime (`assumed_parameters` says so). Raises InputError where the rig file lacks a section,
    NotIdentifiedError where the bundle has no friction.
    """
    if held:
        return _with_valves(bundle, rig, dict.fromkeys(FRICTION, 0.0), 1.0).with_held_shaft()
    friction, where = bundle.friction, bundle.source
    rig.require_motion()
    if friction is None:
        raise NotIdentifiedError(f"{where}: holds no friction; {friction_wanted(rig)}")
    taken = {name: name for name in FRICTION}
    if _lacks_static_alone(friction):
        taken["static"] = "coulomb"
    values = {
        name: max(_of_motion(friction, own, f"{where}, friction", rig.friction_tests[name]), 0.0)
        for name, own in taken.items()
    }
    if rig.is_motor_alone:
        return _motor_alone(bundle, friction, rig, values)
    return _with_valves(bundle, rig, values, _inertia(bundle, rig))


def _with_valves(
    bundle: BundleContent, rig: Rig, friction: Mapping[str, float], inertia: float
) -> Parameters:
    """Parameters of a rig with chambers; `friction` by short name."""
    parameters = parameters_from_rig(
        rig,
        static_effort=friction["static"],
        coulomb_effort=friction["coulomb"],
        viscous=friction["viscous"],
        valve_a=_discrete_law(bundle, rig, "a"),
        valve_b=_discrete_law(bundle, rig, "b"),
        inertia=inertia,
    )
    return parameters.replace(supply_reference=_supply_of_fit(bundle, rig))


def _motor_alone(
    bundle: BundleContent, friction: Friction, rig: Rig, values: Mapping[str, float]
) -> Parameters:
    """Parameters of a rig without pneumatics; `values` of friction by short name."""
    offset = friction.in_motion("offset")
    return bare_parameters(rig).replace(
        static_effort=values["static"],
        coulomb_effort=values["coulomb"],
        viscous=values["viscous"],
        inertia=_inertia(bundle, rig),
        # A friction fit counts the offset against the motion, the model along it.
        offset=-offset.value if offset is not None and offset.identified else 0.0,
    )


def _inertia(bundle: BundleContent, rig: Rig) -> float:
    """The inertia (kg m2, or kg) that was fitted, with another payload if `rig`'s is; else `rig`'s,
    as where the fitted one is impossible.

    Raises InputError without either, NotIdentifiedError where the fitted one is impossible and
    `rig` declares none.
    """
    inertia = fitted_inertia(bundle)
    if inertia is not None:
        return inertia + rig.payload_inertia() - bundle.rig.payload_inertia()
    own = None if bundle.friction is None else bundle.friction.inertia
    if own is not None and own.identified and rig.total_inertia() is None:
        require_moving_inertia(own.value, rig, f"{bundle.source}, friction")
    return require_inertia(rig)


def require_moving_inertia(inertia: float, rig: Rig, where: str) -> None:
    """NotIdentifiedError, naming `where`, for an impossible fitted inertia (kg m2, or kg)."""
    if not inertia > 0.0:
        u, what = rig.units, "mass" if rig.is_linear else "inertia"
        raise NotIdentifiedError(
            f"{where}: the fitted {what} is {inertia:.3g} {u.inertia_unit}, which is impossible, "
            f"so no motion is simulated with it; declare [inertia] {u.rig_inertia} in "
            f"{rig.source}, or give motion that accelerates more"
        )


def _supply_of_fit(bundle: BundleContent, rig: Rig) -> float:
    """Supply pressure, Pa, at which the bundle's choked filling holds: its own rig file's."""
    air = bundle.rig.air or rig.require("air", "which the chamber equations need")
    return air.supply_pressure_pa


def fitted_inertia(bundle: BundleContent) -> float | None:
    """The inertia (kg m2) or mass (kg) that friction tests gave; None where they did not, or gave
    one that cannot be."""
    inertia = None if bundle.friction is None else bundle.friction.inertia
    possible = inertia is not None and inertia.identified and inertia.value > 0.0
    return inertia.value if inertia is not None and possible else None


def _lacks_static_alone(friction: Friction) -> bool:
    """Whether the tests identify sliding friction and not breakaway: motion alone does not."""
    static, coulomb = friction.static, friction.in_motion("coulomb")
    unknown = static is not None and not static.identified
    return unknown and coulomb is not None and coulomb.identified


def assumed_parameters(bundle: BundleContent, rig: Rig | None = None) -> list[str]:
    """Notices of what models set otherwise than estimated: friction to 0 where it is negative, an
    inertia that cannot be to the rig file's, static friction to Coulomb friction where it is not
    identified, Coulomb friction to the sum that holds it where only that is, and a valve's flow
    that its on/off tests do not identify, or that is below 0, to that of its PWM tests, or of the
    other regime, without a jump at the choked boundary. `rig`: the one in use, by default the
    bundle's."""
    return [
        *_assumed_sum(bundle),
        *_assumed_static(bundle),
        *impossible(bundle, rig or bundle.rig),
        *_assumed_flows(bundle),
    ]


def _assumed_sum(bundle: BundleContent) -> Iterator[str]:
    held = None if bundle.friction is None else bundle.friction.sum_in_motion
    if held is not None:
        yield (
            f"{bundle.source}: only {stated(held.expression, held.estimate)} is identified: the "
            f"model takes it for {bundle.units.key('coulomb')}, which holds for motion like that "
            f"of the tests; {held.test} would separate its parts"
        )


def _assumed_static(bundle: BundleContent) -> Iterator[str]:
    friction = bundle.friction
    if friction is not None and _lacks_static_alone(friction):
        key = bundle.units.key
        yield (
            f"{bundle.source}: {key('static')} is not identified: the model uses "
            f"{key('coulomb')} instead; give {bundle.rig.friction_tests['static']}"
        )


def _assumed_flows(bundle: BundleContent) -> Iterator[str]:
    for side in SIDES:
        law = bundle.valve(side).discrete
        if law is None:
            continue
        yield from _assumed_ratios(bundle, side, law)
        for name, key in law.thesis_keys().items():
            if bundle.rig.supply_way < 0.0 and name.startswith("choked"):
                continue  # out of a vacuum's reach
            taken = _taken_from(bundle.valve(side), name, bundle.rig)
            own = getattr(bundle.valve(side).discrete, key)
            what = f"{key} is not identified"
            if own is not None and own.identified:
                what = f"{stated(key, own)}, but a flow is never negative"
            if taken:
                yield (
                    f"{bundle.source}: valves.{side}.discrete: {what}: the model "
                    f"uses {taken}; valve-discrete tests of valve {side} would identify it"
                )


def _assumed_ratios(bundle: BundleContent, side: str, law: DiscreteLaw) -> Iterator[str]:
    estimates = law.estimates()
    for name, key in law.iso_keys().items():
        if name.startswith("critical_ratio") and not estimates[key].identified:
            yield (
                f"{bundle.source}: valves.{side}.discrete: {key} is not identified: the model uses "
                f"{USUAL_RATIO:g}, as is usual; tests that reach the line's pressure would "
                "identify it"
            )


def model_from_bundle(
    bundle: BundleContent, rig: Rig, catalogue: Catalogue | None = None, held: bool = False
) -> Model:
    """The model with a bundle's parameters and effects, these in the bundle's order.

    `catalogue` maps ids to effects; None is the project's own. `held`: see
    `parameters_from_bundle`. Raises as that and `effects_from_bundle` do.
    """
    effects = effects_from_bundle(bundle, catalogue)
    return Model(parameters_from_bundle(bundle, rig, held), effects)


def effects_from_bundle(
    bundle: BundleContent, catalogue: Catalogue | None = None
) -> tuple[Effect, ...]:
    """The effects that a bundle lists, in its order.

    Raises InputError for an effect that `catalogue` lacks, one with foreign
    parameters (`effect_from_entry`), and two that need the same state.
    """
    if bundle.component is not None:
        raise input_error(
            bundle.source,
            f"holds a component of your own ({bundle.component.name}), not an actuator",
            "check, fit, diagnose, refine, validate and run take it with --component",
        )
    if not bundle.effects:
        return ()
    if catalogue is None:
        catalogue = catalogue_with(None)
    catalogue = for_rig(catalogue, bundle.is_linear)
    effects: list[Effect] = []
    for entry in bundle.effects:
        effect = effect_from_entry(entry, bundle.source, catalogue)
        taken = {state for other in effects for state in other.states}
        if taken.intersection(effect.states):
            raise input_error(
                f"{bundle.source}, effect {effect.id}",
                "is listed twice for one side",
                "remove one of them",
            )
        effects.append(effect)
    return tuple(effects)


def surfaces_from_bundle(bundle: BundleContent, rig: Rig, kind: str) -> tuple[Any, Any] | None:
    """Valve A's and B's mean flow under PWM by one of MEAN_FLOW_MODELS, for `simulate`.

    None where the bundle lacks one of the four surfaces, or one of the two laws. Raises
    InputError where surfaces were fitted at another PWM period or supply than the rig's, at which
    they do not hold.
    """
    if rig.bleeds:
        return None  # its valves are followed pulse by pulse
    if kind == AVERAGED:
        laws = {side: _averaged_law(bundle, rig, side) for side in rig.sides}
        a, b = laws["a"], laws.get("b", _no_averaged_law(rig))
        return None if a is None or b is None else (a, b)
    found: list[Any] = []
    for side in SIDES:
        if side not in rig.sides:
            found.append(NoValve())
            continue
        parts = [bundle.valve(side).surfaces(direction) for direction in DIRECTIONS]
        held = [part for part in parts if part is not None and kind in part.given()]
        if len(held) < len(DIRECTIONS):
            return None
        where = f"{bundle.source}, valves.{side}"
        for direction, part in zip(DIRECTIONS, held, strict=True):
            _check_conditions(part, rig, f"{where}.pwm.{direction}")
        pair = [
            _surface(part, kind, f"{where}, {name}").law.for_simulation()
            for name, part in zip(("filling", "discharging"), held, strict=True)
        ]
        found.append(ValveLaw(*pair))
    return found[0], found[1]


def _averaged_law(bundle: BundleContent, rig: Rig, side: str) -> AveragedLaw | None:
    """A valve's averaged law: of its on/off law where that is known, else as fitted under PWM.

    The fitted one holds at any PWM period, as only the delays' difference depends on time.
    """
    valve, timing = bundle.valve(side), rig.valves
    on, off = (timing.on_delay_s, timing.off_delay_s) if timing else (0.0, 0.0)
    law: Part | None = valve.discrete
    if law is None or not _all_possible(law):
        fitted = valve.averaged()
        if fitted is None or not fitted.delay_difference_s.identified or not _all_possible(fitted):
            return None
        law, off = fitted, on + fitted.delay_difference_s.value
    air = rig.require("air", "which the averaged law needs")
    flows = {**dict.fromkeys(LAW_KEYS, 0.0), **_flows(law)}
    return AveragedLaw(
        temperature=air.temperature_k,
        **flows,
        supply=air.supply_pressure_pa,
        supply_reference=_supply_of_fit(bundle, rig),
        atmosphere=air.atmospheric_pressure_pa,
        on_delay=on,
        off_delay=off,
        period=rig.require("pwm", "which the averaged law needs").period_s,
    )


def _no_averaged_law(rig: Rig) -> AveragedLaw:
    """The averaged law that stands for the valve of a chamber that a rig lacks: it passes nothing,
    at the delays of the other one."""
    still = parameters_from_rig(
        rig, static_effort=0.0, coulomb_effort=0.0, viscous=0.0, inertia=1.0
    )
    return AveragedLaw.of(still, "b")


def _flow_keys(law: Part) -> dict[str, str]:
    """The numbers of a law: the model's names, and their keys."""
    return law.flow_keys() if isinstance(law, DirectionalLaw) else LAW_KEYS


def _flows(law: Part) -> dict[str, float]:
    """The numbers of a law, by the model's names."""
    estimates = law.estimates()
    found = {name: estimates[key] for name, key in _flow_keys(law).items()}
    return {
        name: float(estimate.value) if estimate.identified else USUAL_RATIO
        for name, estimate in found.items()
    }


def _all_possible(law: Part) -> bool:
    """Whether a law's flows are known; a critical ratio that is not is the usual one."""
    estimates = law.estimates()
    needed = [key for name, key in _flow_keys(law).items() if not name.startswith("critical_ratio")]
    return all(is_possible(estimates.get(key)) for key in needed)


def _surface(part: PwmSurfaces, kind: str, where: str) -> Any:
    held = part.surface(kind)
    if held is None:
        raise input_error(where, f"{kind} is not a surface", "fit the surface again")
    return held.model(where)


def _check_conditions(part: PwmSurfaces, rig: Rig, where: str) -> None:
    fitted, period = part.pwm_period_s, rig.pwm.period_s if rig.pwm else None
    if _differs(fitted, period, 1e-6):
        raise input_error(
            where,
            f"was fitted at a PWM period of {fitted:g} s, but {rig.source} declares {period:g} s",
            "fit valve-pwm tests at the rig's period",
        )
    fitted, supply = part.supply_pressure_pa, rig.air.supply_pressure_pa if rig.air else None
    if _differs(fitted, supply, SAME_SUPPLY):
        raise input_error(
            where,
            f"was fitted at a supply of {fitted:g} Pa, but {rig.source} declares {supply:g} Pa",
            "fit valve-pwm tests at the rig's supply, or use the averaged law, which is scaled",
        )


def _differs(fitted: object, declared: float | None, tolerance: float) -> bool:
    """Whether both are known and differ by more than that share."""
    if not isinstance(fitted, int | float) or declared is None:
        return False
    return abs(fitted / declared - 1.0) >= tolerance


def _discrete_law(bundle: BundleContent, rig: Rig, side: str) -> ValveParameters:
    """The on/off law; NaN flows without one. A flow that its tests do not identify is that of the
    PWM tests (their averaged law, else a choked one of their surface), else it follows from that of
    the other regime: the law is assumed continuous unless tests show a jump."""
    if side not in rig.sides:
        return ValveParameters(0.0, 0.0, 0.0, 0.0)
    valve = bundle.valve(side)
    law = valve.discrete
    if law is None:
        return ValveParameters(math.nan, math.nan, math.nan, math.nan)
    place = f"{bundle.source}, valves.{side}.discrete"
    test = f"valve-discrete tests of valve {side.upper()} ({rig.valve_steps}) would identify it"
    values: dict[str, float] = dict.fromkeys(LAW_KEYS, 0.0)
    estimates = law.estimates()
    for name, key in law.iso_keys().items():
        own = estimates[key]
        if not own.identified and not name.startswith("critical_ratio"):
            raise NotIdentifiedError(f"{place}.{key} is not identified ({own.reason}); {test}")
        values[name] = float(own.value) if own.identified else USUAL_RATIO
    values |= {name: float(estimates[key].value) for name, key in law.series_keys().items()}
    for name, key in law.thesis_keys().items():
        measured = _measured_flow(valve, name, rig)
        if measured is not None:
            values[name] = measured
            continue
        other = _of_other_regime(valve, name, rig)
        if other is None:
            # Under a vacuum no test identifies a choked flow: what the other regime lacks is why.
            asked = LAW_KEYS[_OTHER_REGIME[name]] if _is_never_shown(name, rig) else key
            # One below zero, without anything else that says it, is held at 0.
            values[name] = max(_identified(law, asked, place, test), 0.0)
            continue
        boundary = _unit_boundary_flow(name, bundle, rig)
        values[name] = other * boundary if name.startswith("choked") else other / boundary
    return ValveParameters(**values)


def _is_never_shown(name: str, rig: Rig) -> bool:
    """Whether a flow is choked, which a vacuum's is never by the thesis' law."""
    return name.startswith("choked") and rig.air is not None and rig.supply_way < 0.0


def _of_other_regime(valve: Valve, name: str, rig: Rig) -> float | None:
    """The number of the other regime, which gives that of `name` where the law is continuous.

    Behind a flow control the choked boundary is where the valve alone has it.
    """
    law, own = valve.discrete, VALVE_ALONE[name.rsplit("_", 1)[1]]
    if law is not None and own in law.series_keys():
        return float(law.estimates()[own].value) if name.startswith("choked") else None
    return _measured_flow(valve, _OTHER_REGIME[name], rig)


def _measured_flow(valve: Valve, name: str, rig: Rig) -> float | None:
    """A flow or coefficient as the on/off tests give it, else as the PWM tests do."""
    for law in (valve.discrete, valve.averaged()):
        own = None if law is None else getattr(law, LAW_KEYS[name])
        if own is not None and is_possible(own):
            return float(own.value)
    return _choked_on_surface(valve, name, rig)


def _choked_on_surface(valve: Valve, name: str, rig: Rig) -> float | None:
    """A choked flow as a surface has it where the valve is open the most and nothing flows the
    other way: into an empty chamber, and out of a full one. None of an unchoked coefficient."""
    direction = {"choked_fill": "fill", "choked_dis": "discharge"}.get(name)
    part = None if direction is None else valve.surfaces(direction)
    longer = rig.valves.off_delay_s - rig.valves.on_delay_s if rig.valves else 0.0
    gain = longer / rig.pwm.period_s if rig.pwm else 0.0
    for kind in reversed(SURFACE_KINDS):  # the network follows its tests more closely
        held = None if part is None else part.surface(kind)
        if held is None:
            continue
        surface = held.model(f"the surface of {direction}")
        empty, full = surface.domain_.pressure_range
        pressure = empty if direction == "fill" else full
        low, high = (float(limit[0]) for limit in surface.domain_.duty_limits(np.array([pressure])))
        duty, share = (high, high + gain) if direction == "fill" else (low, 1.0 - low - gain)
        flow = abs(float(surface.flow(duty, pressure)[0]))
        return flow / share if flow > 0.0 and share > 0.0 else None
    return None


def _taken_from(valve: Valve, name: str, rig: Rig) -> str:
    """The source of a flow that the on/off tests do not identify; empty if they do,
    or if there is none."""
    own = getattr(valve.discrete, LAW_KEYS[name])
    if own is None or is_possible(own):
        return ""
    averaged = valve.averaged()
    if averaged is not None and is_possible(getattr(averaged, LAW_KEYS[name])):
        return "that of the averaged law of its PWM tests"
    if _measured_flow(valve, name, rig) is not None:
        return "that of the surface of its PWM tests at the largest opening"
    other = _OTHER_REGIME[name]
    if _of_other_regime(valve, name, rig) is not None:
        return f"what {LAW_KEYS[other]} gives at the choked boundary"
    return "0" if own.identified else ""


def _unit_boundary_flow(name: str, bundle: BundleContent, rig: Rig) -> float:
    """Flow at the choked boundary, kg/s, by a coefficient of 1, in the direction of `name`."""
    if name.endswith("fill"):
        return 1.0 + float(filling_jump(_supply_of_fit(bundle, rig), 1.0, 1.0))
    atmosphere = rig.require("air", "which the valve law needs").atmospheric_pressure_pa
    return 1.0 + float(exhaust_jump(atmosphere, 1.0, 1.0))


def _of_motion(friction: Friction, name: str, where: str, test: str) -> float:
    """Friction by its short name; the sum that stands for it where only that is identified."""
    found, key = friction.in_motion(name), friction.units.key(name)
    if found is not None and found.identified:
        return float(found.value)
    return _identified(friction, key, where, test)  # raises


def _identified(part: Part, key: str, where: str, test: str) -> float:
    estimate = getattr(part, key)
    if estimate is None:
        raise input_error(where, f"{key} is missing", "fit again to rewrite the bundle")
    if not estimate.identified:
        raise NotIdentifiedError(f"{where}: {key} is not identified ({estimate.reason}); {test}")
    return float(estimate.value)


def friction_wanted(rig: Rig) -> str:
    """What to do about a bundle without friction, as an error says it."""
    tests = dict.fromkeys(test.split(" ")[0] for test in rig.friction_tests.values())
    return f"fit {' and '.join(tests)} tests into it"


def _everywhere(rig: Rig) -> str:
    if len(rig.sides) > 1:
        return "both valves and directions"
    return f"{rig.all_valves} and both directions"


def surfaces_for(bundle: BundleContent, rig: Rig, valve_model: str) -> tuple[Any, ...]:
    """The surfaces of a valve model ("discrete": none) out of a bundle, for simulate_trials.

    Raises InputError for an unknown name, NotIdentifiedError where the bundle lacks one.
    """
    if valve_model not in VALVE_MODELS:
        raise input_error(
            f"valve model {valve_model!r}", "is unknown", f"use {', '.join(VALVE_MODELS)}"
        )
    if valve_model == DISCRETE:
        return ()
    surfaces = surfaces_from_bundle(bundle, rig, valve_model)
    if surfaces is None:
        raise NotIdentifiedError(
            f"{bundle.source}: holds no {valve_model} surfaces for {_everywhere(rig)}; "
            "fit valve-pwm tests into it"
        )
    return surfaces


def first_valve_model(bundle: BundleContent, rig: Rig, parameters: Parameters) -> str:
    """The discrete law where the bundle has it of all valves, else the first of its surfaces.

    Raises NotIdentifiedError where it has neither.
    """
    if has_discrete_law(parameters):
        return DISCRETE
    for name in MEAN_FLOW_MODELS:
        if surfaces_from_bundle(bundle, rig, name) is not None:
            return name
    raise NotIdentifiedError(
        f"{bundle.source}: holds no model of {rig.all_valves}; fit valve-discrete tests of "
        f"{'both' if len(rig.sides) > 1 else 'valve A'} into it"
    )


__all__ = [
    "DISCRETE",
    "MEAN_FLOW_MODELS",
    "VALVE_MODELS",
    "assumed_parameters",
    "effects_from_bundle",
    "first_valve_model",
    "fitted_inertia",
    "friction_wanted",
    "model_from_bundle",
    "parameters_from_bundle",
    "require_moving_inertia",
    "surfaces_for",
    "surfaces_from_bundle",
]
