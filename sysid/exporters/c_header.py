"""A bundle's content as one self-contained C99 header: constants and static functions.

The functions are the laws of `sysid.plant.base` and `sysid.surfaces`, evaluated on names. A
law whose parameters are not all known is absent, and its feature macro is 0. Effects are their
own classes, printed (`effect_laws`). Numbers are of the type SYSID_REAL, double by default.
"""

from __future__ import annotations

import textwrap
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sysid.exporters.base_laws import BaseLaw, chamber, mechanics, valve_flows
from sysid.exporters.c_effects import EffectsInC
from sysid.exporters.c_guard import guarded
from sysid.exporters.c_maths import mathematics
from sysid.exporters.c_surfaces import macro, slots, surfaces
from sysid.exporters.c_text import Names, comment_text, constant, has, names, real
from sysid.exporters.flat import Flat, NumberTable, inertia_name, values
from sysid.io.channels import SIDES
from sysid.parameters import Bundle, assumptions
from sysid.plant.effects.entry import Catalogue, CatalogueEffect

if TYPE_CHECKING:  # sympy is loaded where a header is written
    from sysid.exporters.c_monitor import MonitorInC
    from sysid.exporters.control_model import ControlModel

_MEANING = {
    "critical_ratio": "downstream over upstream pressure of choked flow (3.5.1)",
    "k_r_t_j_per_kg": "k R T of the pressure equations (3.3.6)",
    "area_a_m2": "piston area, chamber A",
    "area_b_m2": "piston area, chamber B",
    "offset_a_m": "chamber A is (offset + y) area",
    "offset_b_m": "chamber B is (offset - y) area",
    "pitch_radius_m": "y is this times the position",
    "inertia_kg_m2": "payload included (3.3.5)",
    "mass_kg": "payload included",
    "gravity_moment_nm": "gravity is this times sin(theta) (3.3.8-10)",
    "supply_pressure_pa": "absolute; choked filling holds at it",
    "atmospheric_pressure_pa": "absolute",
    "declared_on_delay_s": "from the valve's manual; command to opening",
    "declared_off_delay_s": "command to closing",
    **{
        f"valve_{side}_{quantity}_{way}": f"{said}, {what} (ISO 6358)"
        for side in SIDES
        for way, what in (("fill", "filling"), ("dis", "exhaust"))
        for quantity, said in (
            ("sonic_conductance", "at the reference atmosphere ANR"),
            ("critical_ratio", "downstream over upstream pressure of choked flow"),
            ("subsonic_index", "exponent of the subsonic flow"),
        )
    },
    **{
        f"valve_{side}_valve_c_{way}": f"of the valve alone, without its flow control, {what}"
        for side in SIDES
        for way, what in (("fill", "filling"), ("dis", "exhaust"))
    },
    "friction_offset_nm": "constant torque against positive motion; what is applied is less by it",
    "friction_offset_n": "constant force against positive motion; what is applied is less by it",
}


# A space after the #, so that nothing else that a file holds can be taken for it.
_NO_FAST_MATH = """\
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) \\
    || defined(_M_FP_FAST)
# error "compile without -ffast-math: it drops the checks for numbers that are not finite"
#endif
"""
_NOT_FINITE = (
    "",
    "Numbers that are not finite (NaN, infinite): where an input is one, or what follows from it,",
    "a law answers NaN and a duty is 0. -ffast-math drops these checks and is an error.",
)
_LETTING_GO = (
    "A controller lets go: motor 0, valves off, 0 returned in place of 1, its state as it was but",
    "for rejected, which counts such ticks. sense() leaves its memory as it was, counts, and makes",
    "the estimate NaN, at which the controllers let go. OFF IS NOT SAFE EVERYWHERE: an arm in the",
    "vertical falls, and so does a load on a linear axis. Watch rejected and what is returned, and",
    "brake, or stop the rig, where they say so.",
)
_USE = (
    "",
    "On a microcontroller: include this file in one source file, compile it with -std=c99 -O2,",
    "and -DSYSID_REAL=float where the unit for floating point is single. Nothing is allocated, and",
    "nothing is global but constants. The folder ..._check next to this file replays numbers of",
    "the Python package through it: cmake and ctest on a computer, or check.c with its vectors.h",
    "on the target itself.",
)
_USE_OF_CONTROLLERS = (
    "Controllers: each loop keeps its own structs. Each tick (1 ms) sense() turns readings into an",
    "estimate; then pva_control() or backstepping_control(), at the start of each PWM period, or",
    "dvmpc_control(), at each tick, gives the commands. For other gains copy ..._defaults and",
    "change the copy.",
)


@dataclass(frozen=True)
class _Law:
    """A feature: its macro (no prefix), the constants it needs, its functions."""

    feature: str
    needs: tuple[str, ...]
    text: str = ""


@dataclass(frozen=True)
class Header:
    """The header's text, notices, features, constants, and the controllers' model, if any.

    The notices say what it omits, and which effects it does not hold; `why_no_control`: why there
    are no controllers.
    """

    text: str
    notices: list[str]
    features: frozenset[str]
    constants: NumberTable
    control: ControlModel | None
    why_no_control: str = ""
    has_monitor: bool = False


def render(
    flat: Flat,
    prefix: str,
    effects: Sequence[CatalogueEffect | None],
    bundle: Bundle,
    *,
    accept_assumed: bool = False,
    catalogue: Catalogue | None = None,
    monitor: bool = True,
) -> Header:
    """The header of a bundle's content, with a `monitor` where it has the controllers' model.

    `effects` are the bundle's, None for an invalid entry. Without `accept_assumed` it holds no
    controllers if these would use an assumed constant. Raises InputError for a prefix that is not a
    C name.
    """
    n = names(prefix)
    held = EffectsInC(flat, effects, n)
    laws = _laws(flat, n)
    features = _features(flat, held, laws)
    control = _control(bundle, flat, held, effects, n, accept_assumed)
    features["HAS_CONTROLLERS"] = not isinstance(control, str)
    watch = _monitor(bundle, control, catalogue) if monitor else "it was not asked for"
    guard = f"{n.upper}CONTROLLER_H"
    functions = [
        *(law.text for law in laws if law.text and features[law.feature]),
        held.text(),
        surfaces(flat, n),
        "" if isinstance(control, str) else _controllers(flat, control, n),
        "" if isinstance(control, str) or isinstance(watch, str) else _monitor_laws(control, n),
    ]
    parts = [
        _title(bundle, flat, held, features["HAS_CONTROLLERS"]),
        f"#ifndef {guard}\n#define {guard}\n\n#include <math.h>\n",
        _NO_FAST_MATH,
        _feature_lines(features, held, watch if monitor else None, n),
        mathematics(n),
        _constant_lines(held, flat.rig.assumed, n),
        guarded("\n".join(part for part in functions if part), n),
        "" if isinstance(watch, str) else _monitor_text(watch, n),
        f"#endif /* {guard} */\n",
    ]
    text = "\n".join(part for part in parts if part)
    notices = _notices(flat, held, features, n)
    present = frozenset(name for name, is_held in features.items() if is_held)
    if isinstance(control, str):
        notices.append(f"no controllers in the C header: {control}")
        return Header(text, notices, present, held.constants, None, control)
    notices += _of_controllers(flat)
    if control.ignored:
        ids = ", ".join(control.ignored)
        notices.append(f"the controllers in C omit {ids}, whose code has no form in C")
    has_monitor = not isinstance(watch, str)
    return Header(text, notices, present, held.constants, control, has_monitor=has_monitor)


def _monitor(
    bundle: Bundle, control: ControlModel | str, catalogue: Catalogue | None
) -> MonitorInC | str:
    from sysid.exporters.c_monitor import monitor_of

    return monitor_of(bundle, control, catalogue)


def _monitor_laws(control: ControlModel, n: Names) -> str:
    from sysid.exporters.c_monitor import monitor_laws

    return monitor_laws(control, n)


def _monitor_text(made: MonitorInC, n: Names) -> str:
    from sysid.exporters.c_monitor import monitor_text

    return monitor_text(made, n)


def _control(
    bundle: Bundle,
    flat: Flat,
    held: EffectsInC,
    effects: Sequence[CatalogueEffect | None],
    n: Names,
    accept_assumed: bool,
) -> ControlModel | str:
    """The controllers' model, or why it cannot be made."""
    from sysid.exporters.control_model import control_model

    named = held.contained_places()
    known = [(effect, place in named) for place, effect in enumerate(effects)]
    return control_model(bundle, flat, held.constants, known, n, accept_assumed)


def _controllers(flat: Flat, control: ControlModel, n: Names) -> str:
    from sysid.exporters.c_control import controllers

    return controllers(flat, control, n)


def _of_controllers(flat: Flat) -> list[str]:
    """Assumptions of the controllers that the rig file does not state."""
    notices = []
    if flat.rig.valves is None:
        notices.append(
            "the rig file has no [valves]: the controllers in C assume valves without delays; give "
            "on_delay_s and off_delay_s"
        )
    if flat.rig.is_linear:
        notices.append(
            "the rig is linear: the controllers' default gains and the payload's estimator are "
            "those of an arm (rad, Nm); set your own"
        )
    return notices


def _notices(flat: Flat, held: EffectsInC, features: dict[str, bool], n: Names) -> list[str]:
    notices = flat.absences("omitted")
    absent = [k for k, present in features.items() if not present]
    if absent:
        notices.append("0 in the header: " + ", ".join(n.upper + feature for feature in absent))
    ids = ", ".join(effect.id for effect, _ in held.not_contained())
    if ids:
        notices.append(
            f"the C header does not hold the laws of these effects of the bundle: {ids};"
            " its functions ignore them"
        )
    return notices


def _features(flat: Flat, held: EffectsInC, laws: Iterable[_Law]) -> dict[str, bool]:
    """Feature macro without prefix -> whether the header holds it."""
    known = {name for name, value in values(held.constants).items() if value is not None}
    features = {law.feature: known.issuperset(law.needs) for law in laws}
    features |= {macro(name, kind): surface is not None for name, kind, surface in slots(flat)}
    return features


def _title(bundle: Bundle, flat: Flat, effects: EffectsInC, has_controllers: bool) -> str:
    """The opening comment: contents, bundle and rig, and the assumed constants."""
    made = flat.provenance
    absent = effects.not_contained()
    lines = [
        "Identified model of a pneumatic actuator, for a controller. Written by sysid export.",
        f"rig: {flat.rig.name} ({flat.rig.motion}, {flat.rig.orientation})",
        f"bundle: {made['bundle_schema']}, created {made['bundle_created']} "
        f"by sysid {made['bundle_sysid_version']}",
        f"bundle SHA-256: {made['bundle_sha256']}",
        "SI, absolute pressures. Equation numbers are those of the thesis, as corrected.",
        "Unknown numbers are absent, and their HAS macros are 0. C99, link with the maths library.",
        "Numbers are double; -DSYSID_REAL=float makes them single precision.",
        *_USE,
        *(_USE_OF_CONTROLLERS if has_controllers else ()),
        *_NOT_FINITE,
        *(_LETTING_GO if has_controllers else ()),
    ]
    if effects.contained():
        ids = ", ".join(effect.id for effect in effects.contained())
        lines.append("Effects, in the constants and the functions that end with _with_effects:")
        lines += textwrap.wrap(ids, 90, break_on_hyphens=False)
    if absent:
        ids = ", ".join(effect.id for effect, _ in absent)
        lines.append(f"NOT CONTAINED: the laws of these effects of the bundle: {ids}")
        lines += [f"{effect.id}: {reason}" for effect, reason in absent]
    if assumed := assumptions(bundle):
        lines.append("ASSUMED, not declared for this rig: constants of a reference rig.")
        for one in assumed:
            for text in (one.line, f"  keys: {', '.join(one.keys)}"):
                lines += textwrap.wrap(text, 90, subsequent_indent="    ", break_long_words=False)
    body = "\n".join(f" * {comment_text(line)}".rstrip() for line in lines)
    return f"/*\n{body}\n */"


def _feature_lines(
    features: dict[str, bool], effects: EffectsInC, watch: MonitorInC | str | None, n: Names
) -> str:
    lines = ["/* --- contained (1) or absent (0) in this header --- */", ""]
    lines += [has(f"{n.upper}{feature}", present) for feature, present in features.items()]
    lines += effects.features()
    if watch is not None:
        why = f" /* {comment_text(watch, 300)} */" if isinstance(watch, str) else ""
        lines.append(has(f"{n.upper}HAS_MONITOR", not why) + why)
    return "\n".join(lines) + "\n"


_DERIVED = {
    "k_r_t_j_per_kg": (
        "air.gas_constant_j_per_kg_k",
        "air.heat_capacity_ratio",
        "air.temperature_k",
    ),
    "inertia_kg_m2": ("inertia.equivalent_kg_m2",),
    "declared_on_delay_s": ("valves.on_delay_s",),
    "declared_off_delay_s": ("valves.off_delay_s",),
    "pwm_period_s": ("pwm.period_s",),
}
"""Keys of the rig file by the constant that follows from them, where it has another name."""


def _rests_on(name: str) -> set[str]:
    """The keys of the rig file that a constant of the header may be or follow from."""
    sections = ("air", "cylinder", "inertia", "motor", "sensors")
    return {*_DERIVED.get(name, ()), *(f"{section}.{name}" for section in sections)}


def _constant_lines(effects: EffectsInC, assumed: Collection[str], n: Names) -> str:
    lines = ["/* --- constants --- */", ""]
    for name, quantity in effects.constants.items():
        if quantity.value is not None:
            meaning = f"; {_MEANING[name]}" if name in _MEANING else ""
            changed = effects.changes(name)
            comment = quantity.unit + meaning + (f"; with {changed}" if changed else "")
            comment += "; ASSUMED" if _rests_on(name).intersection(assumed) else ""
            lines.append(constant(f"{n.lower}{name}", quantity.value, comment, n))
    return "\n".join(lines) + "\n"


# --- laws ------------------------------------------------------------------------------


def _laws(flat: Flat, n: Names) -> Sequence[_Law]:
    def made(laws: Iterable[BaseLaw]) -> list[_Law]:
        return [_Law(law.feature, law.needs, law.text(flat, n)) for law in laws]

    laws = [*made(mechanics(flat)), _motor(flat, n)]
    laws.append(_Law("HAS_INERTIA", (inertia_name(flat.rig)[0],)))
    for side in flat.rig.sides:
        flows, valve = made(valve_flows(flat, side)), f"HAS_VALVE_{side.upper()}"
        delays = tuple(f"valve_{side}_{edge}_delay_s" for edge in ("on", "off"))
        laws += [
            *flows,
            _Law(f"{valve}_DISCRETE", flows[0].needs + flows[1].needs),
            _Law(f"{valve}_DELAYS", delays),
            *made(chamber(flat, side)),
        ]
    return laws


def _motor(flat: Flat, n: Names) -> _Law:
    u, p = flat.rig.units, n.lower
    word, unit = u.word, u.effort
    gain, limit = u.effort_per_volt, u.max_effort
    if flat.constants[limit].value is None:
        within, body = "no limit is declared", f"return volts * {p}{gain};"
    else:
        within = "within its declared limit"
        body = f"""{real(n)} effort = volts * {p}{gain};
    return {p}maximum({p}minimum(effort, {p}{limit}), -{p}{limit});"""
    text = f"""\
/* {word.capitalize()} of the motor at the output, {unit}, from volts (3.3.4); {within}. */
static inline {real(n)} {p}motor_{word}({real(n)} volts)
{{
    {body}
}}
"""
    return _Law("HAS_MOTOR", (gain,), text)
