"""The laws of a bundle's effects in C, as far as they are plain algebraic ones.

A table of snippets, one or more per effect, each at one port of the model: a C expression of
`value`, the port's value so far, of the port's inputs and of the effect's parameters, in
braces. The effects of one port act in the bundle's order, as in the model. An effect that has
a state, or an unknown parameter, is not contained.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from string import Formatter

from sysid.export.c_text import Names, comment_text, constant, has
from sysid.export.flat import ExportedEffect, Flat
from sysid.io.channels import SIDES
from sysid.model.effects.linear import linear_name


@dataclass(frozen=True)
class _Port:
    """A function of the header: its name without prefix, arguments, and result.

    The first argument is the value without effects. `local` (name, C expression) is worked
    out first. `backward`: the effects are undone, the last one first.
    """

    name: str
    arguments: tuple[str, ...]
    meaning: str
    local: tuple[str, str] | None = None
    backward: bool = False


@dataclass(frozen=True)
class _Snippet:
    """An effect's action at a port. `side` "a" or "b" if the effect has a side."""

    port: str
    law: str
    side: str | None = None


def _ports() -> Iterable[_Port]:
    yield _Port(
        "sliding_friction",
        ("friction", "position", "velocity", "pressure_a_pa", "pressure_b_pa"),
        "Friction while moving, Nm (linear rig: N), from that of the base law",
        local=("direction", "(double)((velocity > 0.0) - (velocity < 0.0))"),
    )
    yield _Port(
        "external",
        ("effort", "position"),
        "Effort in the positive direction, Nm (linear rig: N), from that without effects",
    )
    yield _Port(
        "motor",
        ("effort",),
        "Effort of the motor, Nm (linear rig: N), from that of the base law",
    )
    for side in SIDES:
        upper = side.upper()
        yield _Port(
            f"chamber_flow_{side}",
            ("flow_kg_s", "pressure_a_pa", "pressure_b_pa"),
            f"Whole flow into chamber {upper}, kg/s, from that through its valve",
        )
        yield _Port(
            f"true_pressure_{side}",
            ("measured_pa",),
            f"Pressure in chamber {upper}, Pa, absolute, from what its sensor shows",
            backward=True,
        )
        for edge, moment in (("on", "opening"), ("off", "closing")):
            yield _Port(
                f"valve_{side}_{edge}_delay",
                ("delay_s",),
                f"Delay of valve {upper} from command to {moment}, s, from the one without effects",
            )


def _both_sides(port: str, law: str) -> tuple[_Snippet, ...]:
    """One snippet per side; `law` with <s> for the side."""
    return tuple(_Snippet(port.replace("<s>", s), law.replace("<s>", s), s) for s in SIDES)


_SNIPPETS: dict[str, tuple[_Snippet, ...]] = {
    "stribeck-friction": (
        _Snippet(
            "sliding_friction",
            "value + {stribeck_torque_nm} * direction * exp(-pow(fabs(velocity)"
            " / {stribeck_velocity_rad_per_s}, {stribeck_exponent}))",
        ),
    ),
    "asymmetric-coulomb-friction": (
        _Snippet("sliding_friction", "value + {asymmetry_nm} * direction * direction"),
    ),
    "position-dependent-friction": (
        _Snippet(
            "sliding_friction",
            "value + {coulomb} * direction"
            " * ({friction_sine} * sin({friction_wave_per_rad} * position)"
            " + {friction_cosine} * cos({friction_wave_per_rad} * position))",
        ),
    ),
    "seal-friction": (
        _Snippet(
            "sliding_friction",
            "value + {seal_torque_nm_per_pa} * direction"
            " * ((1.0 - {difference_share}) * (pressure_a_pa + pressure_b_pa - 2.0 * {atmosphere})"
            " + {difference_share} * fabs(pressure_a_pa - pressure_b_pa))",
        ),
    ),
    "quadratic-drag": (
        _Snippet("sliding_friction", "value + {drag_nm_s2_per_rad2} * velocity * fabs(velocity)"),
    ),
    "asymmetric-viscous-friction": (
        _Snippet(
            "sliding_friction",
            "value + {viscous_asymmetry_nm_s_per_rad} * velocity * direction",
        ),
    ),
    "power-law-friction": (
        _Snippet(
            "sliding_friction",
            "value + {power_law_nm} * direction * pow(fabs(velocity), {power_law_exponent})",
        ),
    ),
    "gear-mesh-ripple": (
        _Snippet(
            "external",
            "value + {mesh_sine_nm} * sin({mesh_wave_per_rad} * position)"
            " + {mesh_cosine_nm} * cos({mesh_wave_per_rad} * position)",
        ),
    ),
    "cable-spring": (_Snippet("external", "value - {stiffness_nm_per_rad} * position"),),
    "mounting-tilt": (
        _Snippet(
            "external",
            "value - ({tilt_sine_nm} * sin(position) + {tilt_cosine_nm} * cos(position))",
        ),
    ),
    "torque-offset": (_Snippet("external", "value + {offset_nm}"),),
    "torque-constant-error": (_Snippet("motor", "value + {torque_gain_error} * value"),),
    "piston-leakage": tuple(
        _Snippet(
            f"chamber_flow_{side}",
            f"value {sign} {{piston_leakage_kg_per_s_pa2}}"
            " * (pressure_a_pa * pressure_a_pa - pressure_b_pa * pressure_b_pa)",
        )
        for side, sign in zip(SIDES, "-+", strict=True)
    ),
    "atmosphere-leakage": _both_sides(
        "chamber_flow_<s>",
        "value - {atmosphere_leakage_kg_per_s_pa2} * (pressure_<s>_pa * pressure_<s>_pa"
        " - {atmosphere} * {atmosphere})",
    ),
    "pressure-offset": _both_sides("true_pressure_<s>", "value - {pressure_offset_pa}"),
    "pressure-gain": _both_sides("true_pressure_<s>", "value / (1.0 + {pressure_gain_error})"),
    "valve-delay": (
        *_both_sides("valve_<s>_on_delay", "value + {on_delay_s}"),
        *_both_sides("valve_<s>_off_delay", "value + {off_delay_s}"),
    ),
}


def contained(flat: Flat) -> tuple[ExportedEffect, ...]:
    """The effects whose laws the header holds, in the bundle's order."""
    return tuple(effect for effect in flat.effects if _is_contained(effect, flat))


def not_contained(flat: Flat) -> tuple[ExportedEffect, ...]:
    """The effects whose laws the header does not hold."""
    return tuple(effect for effect in flat.effects if not _is_contained(effect, flat))


def features(flat: Flat, n: Names) -> list[str]:
    """One macro per port, 1 if an effect acts there and its function exists, and two counts."""
    lines = [has(f"{n.upper}{_feature(port)}", bool(_acting(port, flat))) for port in _ports()]
    lines.append(f"#define {n.upper}EFFECTS_CONTAINED {len(contained(flat))}")
    lines.append(f"#define {n.upper}EFFECTS_NOT_CONTAINED {len(not_contained(flat))}")
    return lines


def effects(flat: Flat, n: Names) -> str:
    """The parameters of the contained effects and a function for each port where they act."""
    held = contained(flat)
    if not held:
        return ""
    parts = ["/* --- effects that the laws above do not include --- */\n"]
    for effect in held:
        parts.append(_constants(effect, flat, n))
    parts += [
        _function(port, acting, flat, n) for port in _ports() if (acting := _acting(port, flat))
    ]
    return "\n".join(parts)


def _feature(port: _Port) -> str:
    return f"EFFECTS_ACT_ON_{port.name.upper()}"


def _is_contained(effect: ExportedEffect, flat: Flat) -> bool:
    snippets = _laws(effect.id, flat)
    known = {name for name, value in effect.values.items() if isinstance(value, float)}
    known |= _base_constants(flat).keys()
    sided = any(snippet.side for snippet in snippets)
    return (
        bool(snippets)
        and all(known.issuperset(_names_in(snippet.law)) for snippet in snippets)
        and (not sided or effect.values.get("side") in (*SIDES, "both"))
    )


def _base_constants(flat: Flat) -> dict[str, str]:
    """Quantities that laws need besides their own parameters -> C name; the known ones."""
    coulomb = "coulomb_n" if flat.rig.is_linear else "coulomb_nm"
    found = {}
    if flat.constants["atmospheric_pressure_pa"].value is not None:
        found["atmosphere"] = "atmospheric_pressure_pa"
    if flat.friction[coulomb].value is not None:
        found["coulomb"] = f"friction_{coulomb}"
    return found


def _names_in(law: str) -> set[str]:
    return {name for _, name, _, _ in Formatter().parse(law) if name}


def _laws(effect_id: str, flat: Flat) -> tuple[_Snippet, ...]:
    """The effect's laws, in the names of the rig's own units."""
    snippets = _SNIPPETS.get(effect_id, ())
    if not flat.rig.is_linear:
        return snippets
    return tuple(replace(s, law=_linear_law(s.law)) for s in snippets)


def _linear_law(law: str) -> str:
    return re.sub(r"\{(\w+)\}", lambda match: f"{{{linear_name(match.group(1))}}}", law)


def _acting(port: _Port, flat: Flat) -> list[tuple[ExportedEffect, str]]:
    """The effects that act at a port and their laws, in the order in which they act there."""
    found = [
        (effect, snippet.law)
        for effect in contained(flat)
        for snippet in _laws(effect.id, flat)
        if snippet.port == port.name
        and (snippet.side is None or effect.values["side"] in (snippet.side, "both"))
    ]
    return found[::-1] if port.backward else found


def _constant_name(effect: ExportedEffect, name: str, flat: Flat, n: Names) -> str:
    """The effect's own parameter, numbered by its place in the bundle, or the rig's constant."""
    if name not in effect.values:
        return f"{n.lower}{_base_constants(flat)[name]}"
    place = 1 + next(k for k, other in enumerate(flat.effects) if other is effect)
    return f"{n.lower}effect_{place}_{name}"


def _constants(effect: ExportedEffect, flat: Flat, n: Names) -> str:
    lines = [f"/* {comment_text(_words(effect))} */"]
    for name, value in effect.values.items():
        if isinstance(value, float):
            lines.append(constant(_constant_name(effect, name, flat, n), value, effect.units[name]))
    return "\n".join(lines) + "\n"


def _words(effect: ExportedEffect) -> str:
    side = effect.values.get("side")
    return effect.id if side is None else f"{effect.id}, side {side}"


def _function(port: _Port, acting: list[tuple[ExportedEffect, str]], flat: Flat, n: Names) -> str:
    inputs = ", ".join(f"double {name}" for name in port.arguments)
    ids = ", ".join(dict.fromkeys(effect.id for effect, _ in acting))
    lines = [
        f"/* {comment_text(port.meaning)}.",
        f"   Effects: {comment_text(ids)}. */",
        f"static inline double {n.lower}{port.name}_with_effects({inputs})",
        "{",
        f"    double value = {port.arguments[0]};",
    ]
    text = " ".join(law for _, law in acting)
    unused = [*port.arguments[1:]]
    if port.local is not None:
        name, expression = port.local
        text += f" {expression}"
        lines.append(f"    double {name} = {expression};")
        unused.append(name)
    lines += [f"    (void){name};" for name in unused if not re.search(rf"\b{name}\b", text)]
    for effect, law in acting:
        names = {name: _constant_name(effect, name, flat, n) for name in _names_in(law)}
        lines.append(f"    value = {law.format(**names)};")
    return "\n".join([*lines, "    return value;", "}\n"])


__all__ = ["contained", "effects", "features", "not_contained"]
