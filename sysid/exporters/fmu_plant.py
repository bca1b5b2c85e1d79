"""A bundle's plant as a model of FMI: its variables by the names of logs and bundles."""

from __future__ import annotations

import dataclasses
import html
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from importlib import resources

from sysid import __version__
from sysid.errors import NotIdentifiedError, input_error
from sysid.exporters.c_constants import SAME_NAMES
from sysid.exporters.c_text import LARGEST, number
from sysid.exporters.fmu import FmuContent, FmuVariable, Role
from sysid.exporters.plant_c import plant_header
from sysid.exporters.plant_laws import TracedPlant, effect_number, traced_plant
from sysid.io.channels import SIDES, VELOCITY_CHANNELS
from sysid.io.rig import Rig
from sysid.parameters import Bundle
from sysid.parameters.table import ParameterRow, effect_names
from sysid.plant.base import MAX_STEP, Parameters, parameter_names
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model, has_discrete_law, overrides

IDENTIFIER = "sysid_plant"
_UNUSED = {True: "gravity_moment", False: "weight"}  # by whether the rig is linear
_UNITS = {"m2": "m2", "m": "m", "s": "s", "pa": "Pa", "k": "K", "nm": "Nm", "n": "N", "kg": "kg"}
_NAMES = {
    "supply": "supply_pressure_pa",
    "supply_reference": "supply_of_choked_flow_pa",
    "gravity_moment": "gravity_moment_nm",
    "weight": "weight_n",
}
_MEANING = {
    "supply_of_choked_flow_pa": "the supply at which choked filling holds, which is proportional "
    "to the supply",
    "gravity_moment_nm": "gravity is this times sin(position)",
}


def plant_fmu(bundle: Bundle, effects: Sequence[CatalogueEffect], model: Model) -> FmuContent:
    """The plant of a bundle; `effects` are the model's, in the bundle's order.

    Raises InputError for an effect without a form in C, NotIdentifiedError where valves have no
    on/off law.
    """
    rig = bundle.rig
    _require_held(bundle, effects, model)
    traced = traced_plant(model, effects, rig)
    variables = (*_inputs(rig, traced), *_outputs(rig), *_start(rig, model))
    variables += tuple(_parameters(bundle, effects, traced))
    start = (0.0, 0.0, model.parameters.atmosphere, model.parameters.atmosphere)
    text = resources.files("sysid.exporters").joinpath("fmu_plant.h.in").read_text("utf-8")
    text = text.replace("@start@", ", ".join(number(float(v)) for v in start))
    text = text.replace("@is_pwm@", str(int(rig.pwm is not None)))
    title = f"Identified plant of {rig.name}"
    origin = f"bundle created {bundle.created} by sysid {bundle.sysid_version}"
    ids = ", ".join(effect.id for effect in effects) or "none"
    lines = [title, origin, f"effects: {ids}", "SI, absolute pressures. Written by sysid export."]
    return FmuContent(
        identifier=IDENTIFIER,
        title=title,
        sources={"model.h": text, "plant.h": plant_header(traced, lines)},
        variables=variables,
        step=MAX_STEP,
        created=bundle.created.replace("+00:00", "Z"),
        tool=f"sysid {__version__}",
        notes=_notes(title, origin, ids),
    )


def _require_held(bundle: Bundle, effects: Sequence[CatalogueEffect], model: Model) -> None:
    if not has_discrete_law(model.parameters):
        raise NotIdentifiedError(
            f"{bundle.source}: holds no on/off law of {bundle.rig.all_valves}, which a plant that "
            "follows pulses needs; fit valve-discrete tests of each valve into it"
        )
    unknown = [
        name
        for name in parameter_names(model.parameters)
        if math.isnan(float(getattr(model.parameters, name)))
    ]
    if unknown:
        raise NotIdentifiedError(
            f"{bundle.source}: {', '.join(unknown)} of the model is not identified; fit the tests "
            "that identify it"
        )
    ahead = [e.id for e in effects if overrides(e, "pulses") > overrides(e, "recent_pulses")]
    if ahead:
        raise input_error(
            bundle.source,
            f"a plant in C cannot hold {', '.join(ahead)}, which act on the pulses of a whole test",
            "export a bundle without them, or simulate in Python",
        )


def _inputs(rig: Rig, traced: TracedPlant) -> Iterator[FmuVariable]:
    unit = rig.units.effort
    yield FmuVariable(
        rig.effort_channel, "motor", f"commanded {rig.units.word} of the motor", "input", unit, 0.0
    )
    for k, (name, title) in enumerate(_valves(rig)):
        yield FmuVariable(
            f"valve_{name}",
            f"valve[{k}]",
            f"{title} on, where pwm_{name} is false",
            "input",
            start=0.0,
            kind="b",
        )
        if rig.pwm is not None:
            yield FmuVariable(
                f"duty_{name}",
                f"duty[{k}]",
                f"duty of {title}, taken at the start of each PWM period, where pwm_{name} is true",
                "input",
                start=0.0,
                bounds=(0.0, 1.0),
                is_held=True,
            )
    if traced.load is not None:
        own = traced.own_payload_kg
        said = f"payload; the rig's own is {own:g} kg"
        yield FmuVariable("payload_kg", "payload_kg", said, "input", "kg", own, is_held=True)


def _outputs(rig: Rig) -> Iterator[FmuVariable]:
    u, position = rig.units, rig.position_channel
    has_chambers = not rig.is_motor_alone

    def output(name: str, place: str, meaning: str, unit: str) -> FmuVariable:
        return FmuVariable(name, f"plant.shown.{place}", meaning, "output", unit)

    for begin, shown, how in (("", "", "as its sensor shows it"), ("true_", "true_", "as it is")):
        yield output(begin + position, f"{shown}position", f"position, {how}", u.position)
        yield output(
            begin + VELOCITY_CHANNELS[position], f"{shown}velocity", f"speed, {how}", u.speed
        )
        for k, side in enumerate(_sides(rig)):
            yield output(
                f"{begin}pressure_{side}_pa",
                f"{shown}pressure[{k}]",
                f"absolute pressure of chamber {side.upper()}, {how}",
                "Pa",
            )
    for k, side in enumerate(_sides(rig)):
        upper = side.upper()
        yield output(f"flow_{side}_kg_s", f"flow[{k}]", f"flow into chamber {upper}", "kg/s")
    for k, (own, title) in enumerate(_valves(rig)):
        yield FmuVariable(
            f"open_{own}", f"is_open[{k}]", f"{title} is really open", "output", kind="b"
        )
    efforts = {
        "motor": "of the motor",
        "gravity": "of gravity and a return spring, against positive motion",
        "friction": "of friction, against positive motion; at rest, what it holds",
    }
    if has_chambers:
        efforts = {"cylinder": "of the cylinder", **efforts}
    for name, what in efforts.items():
        key = f"{name}_{u.word}_{u.suffix}"
        key = f"real_{key}" if name == "motor" else key
        yield output(key, name, f"{u.word} {what}", u.effort)


def _start(rig: Rig, model: Model) -> Iterator[FmuVariable]:
    """Start values as the sensors show them, and what a valve's command means."""
    position = rig.position_channel
    names = [(position, rig.units.position), (VELOCITY_CHANNELS[position], rig.units.speed)]
    values = [0.0, 0.0]
    if not rig.is_motor_alone:
        names += [(f"pressure_{side}_pa", "Pa") for side in _sides(rig)]
        values += [float(model.parameters.atmosphere)] * len(_sides(rig))
    for k, ((name, unit), value) in enumerate(zip(names, values, strict=True)):
        said = "at the start, as its sensor shows it"
        yield FmuVariable(f"start.{name}", f"start[{k}]", said, "fixed", unit, value)
    for k, (own, title) in enumerate(_valves(rig)):
        if rig.pwm is not None:
            said = f"{title} follows its duty; false: it is switched on and off"
            yield FmuVariable(f"pwm_{own}", f"is_pwm[{k}]", said, "fixed", start=1.0, kind="b")
        said = f"{title} was on before the start"
        yield FmuVariable(f"start.open_{own}", f"was_open[{k}]", said, "fixed", start=0.0, kind="b")


# --- parameters ------------------------------------------------------------------------


def _parameters(
    bundle: Bundle, effects: Sequence[CatalogueEffect], traced: TracedPlant
) -> Iterator[FmuVariable]:
    """Every number of the model: fitted ones by their paths in the bundle, with their intervals."""
    rig = bundle.rig
    rows = {
        row.field: row
        for row in bundle.parameters.fitted().rows
        if row.origin in ("friction", "valve")
        and row.name != "offset"
        # The bundle has one delay for both valves of a chamber.
        and not (rig.bleeds and row.field in _delays(rig))
    }
    absent = {f.name for f in dataclasses.fields(Parameters) if f.name[-2:] in _ends(rig)}
    absent -= set(_delays(rig))
    of_effects = {name: (path, row) for name, path, row in _effect_rows(bundle, effects)}
    for one in traced.numbers:
        if one.name == _UNUSED[rig.is_linear] or one.name in absent:
            continue
        place = f"plant.own.{one.name}"
        role: Role = "fixed" if one.name == "pwm_period" else "tunable"
        if one.name in of_effects:
            path, row = of_effects[one.name]
        elif one.name in rows:
            row = rows[one.name]
            path = f"{row.part}.{row.key}"
        else:
            path, row = f"rig.{_rig_name(one.name, rig)}", None
        if row is None:
            name = path.partition(".")[2]
            meaning = _MEANING.get(name, "constant of the rig")
            meaning += "; 1e30: no limit" if one.value == LARGEST else ""
            yield FmuVariable(path, place, meaning, role, _unit_of(name), one.value)
            continue
        said = "as fitted" if row.estimate.value == one.value else "as the model uses it"
        bounds = _bounds(row, one.value)
        said += "; the bounds are its 95 % interval" if bounds else ""
        unit = "" if row.estimate.unit == "-" else row.estimate.unit
        yield FmuVariable(path, place, f"{row.title}, {said}", role, unit, one.value, bounds)


def _sides(rig: Rig) -> tuple[str, ...]:
    """The chambers that the rig has; none of a motor alone."""
    return () if rig.is_motor_alone else rig.sides


def _valves(rig: Rig) -> Iterator[tuple[str, str]]:
    """What its valves' commands are named after, and what they are in words."""
    for name in () if rig.is_motor_alone else rig.valve_names:
        side, _, what = name.partition("_")
        yield name, f"{what} valve of chamber {side.upper()}" if what else f"valve {side.upper()}"


def _ends(rig: Rig) -> set[str]:
    """How the names of the parameters of chambers end that the rig lacks."""
    return {f"_{side}" for side in SIDES if side not in _sides(rig)}


def _delays(rig: Rig) -> dict[str, str]:
    """The model's delays of its valves, and what they are called here."""
    names = zip(SIDES, (name for name, _ in _valves(rig)), strict=False)
    return {f"{e}_delay_{s}": f"valve_{n}_{e}_delay_s" for s, n in names for e in ("on", "off")}


def _effect_rows(
    bundle: Bundle, effects: Sequence[CatalogueEffect]
) -> Iterator[tuple[str, str, ParameterRow]]:
    """The struct's field of each effect's number, its name here, and its row."""
    rows = {row.alias: row for row in bundle.parameters.rows if row.origin == "effect"}
    ids = [effect.id for effect in effects]
    seen: Counter[str] = Counter()
    for place, (effect, alias) in enumerate(
        zip(effects, effect_names(bundle.effects), strict=True)
    ):
        seen[effect.id] += 1
        own = effect.id.replace("-", "_")
        own += f"_{seen[effect.id]}" if ids.count(effect.id) > 1 else ""
        for quantity in type(effect).quantities:
            row = rows.get(f"{alias}.{quantity.label}")
            if row is not None:
                name = effect_number(place, quantity.label)
                yield name, f"effects.{own}.{quantity.label}", row


def _bounds(row: ParameterRow, value: float) -> tuple[float, float] | None:
    """The interval, where it is known and holds the model's value."""
    low, high = row.estimate.interval
    if not row.estimate.has_interval or not low <= value <= high:
        return None
    return low, high


def _rig_name(name: str, rig: Rig) -> str:
    u = rig.units
    own = {
        "stiffness": f"spring_{u.stiffness}",
        "preload": f"spring_{u.preload}",
        "inertia": "mass_kg" if rig.is_linear else "inertia_kg_m2",
        "offset": f"{u.word}_offset_{u.suffix}",
        "max_effort": u.max_effort,
        "static_effort": f"static_{u.suffix}",
        "coulomb_effort": f"coulomb_{u.suffix}",
    }
    return own.get(name) or _delays(rig).get(name) or _NAMES.get(name) or SAME_NAMES.get(name, name)


def _unit_of(name: str) -> str:
    if name.endswith("kg_m2"):
        return "kg m2"
    if name.endswith("j_per_kg_k"):
        return "J/(kg K)"
    return _UNITS.get(name.rsplit("_", 1)[-1], "")


def _notes(title: str, origin: str, ids: str) -> str:
    said = [
        f"{title}; {origin}. Effects: {ids}.",
        "The equations are those of sysid's simulator, printed from its Python, and so is the "
        "method: Kutta's third order in steps of 1 ms at most, each cut at the first event in it "
        "(choking, sticking, breakaway, an end stop), which is located on the method's own cubic. "
        "Two events are at least 1e-4 of a step apart; valve edges and PWM periods are known to "
        "1e-9 s. At equal inputs and communication points the results are those of sysid simulate.",
        "Inputs are held during a step. Duties count at the start of each PWM period, which are "
        "counted from the start of the simulation; a valve follows after its delays.",
        "A number that is not finite is refused (error), and so is a step in which the model "
        "leaves the finite numbers.",
    ]
    body = "\n".join(f"<p>{html.escape(text)}</p>" for text in said)
    return f'<!DOCTYPE html>\n<meta charset="utf-8">\n<title>{html.escape(title)}</title>\n{body}\n'


__all__ = ["IDENTIFIER", "plant_fmu"]
