"""What a bundle's effects do, as expressions: their ports evaluated on names of the header.

An effect is included if its action depends on the model's current point alone. It is not if it
has a state, needs the signals or pulses of a whole test, or a constant that is not known;
`Laws.reasons` says which.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import sympy

from sysid.exporters.c_constants import (
    GAS,
    K_R_T,
    header_constants,
    own_constants,
    parameter_values,
    read_constants,
    with_parameters,
)
from sysid.exporters.c_ports import ACTED_ON, ARGUMENTS, DIRECTION, Port, ports
from sysid.exporters.c_printer import Reduced, reduced
from sysid.exporters.c_text import Names
from sysid.exporters.flat import Flat, NumberTable
from sysid.exporters.symbolic import Symbolic, expression, forget_expressions, symbol
from sysid.plant.base import Parameters
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Effect, Point, overrides

VALUE = "value"
_UNKNOWN = "unknown_"
_DUTY_DIRECTIONS = ("duty_direction_a", "duty_direction_b")
_NO_EFFECT = "its entry is not that of a known effect"
_PORTS = tuple(name for name in vars(Effect) if callable(getattr(Effect, name)))
# Ports that belong to states alone.
_OF_STATES = {"initial_states", "state_rates", "settled"}
# Ports that say how other ports act.
_OF_PORTS = {"unmeasured", "is_idle"}


class _NotContainedError(Exception):
    """Why an effect is not contained."""


@dataclass(frozen=True)
class EffectLaw:
    """The change of `value` by one effect. `is_sensor`: the reading, to be solved for `value`."""

    place: int
    law: Reduced
    is_sensor: bool = False


@dataclass(frozen=True)
class Laws:
    """The laws of a bundle's effects, places counted from 0 in the bundle's order.

    `reasons`: place -> why it is not contained. `constants`: with the effects that change
    them, by `changed_by` (constant -> places). `drifts`: constants that change over a test.
    """

    constants: NumberTable
    reasons: Mapping[int, str] = field(default_factory=dict)
    changed_by: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    drifts: Mapping[str, Reduced] = field(default_factory=dict)
    stages: Mapping[str, tuple[EffectLaw, ...]] = field(default_factory=dict)


def effect_laws(flat: Flat, effects: Sequence[CatalogueEffect | None], n: Names) -> Laws:
    """The laws of a bundle's effects (None: an invalid entry), in the bundle's order."""
    forget_expressions()
    made = _Maker(flat, n)
    reasons: dict[int, str] = {}
    held: dict[int, CatalogueEffect] = {}
    for place, effect in enumerate(effects):
        try:
            held[place] = made.checked(place, effect)
        except _NotContainedError as reason:
            reasons[place] = str(reason)
    for place, effect in list(held.items()):
        try:
            made.fold(place, effect, effects[place])
        except _NotContainedError as reason:
            reasons[place] = str(reason)
            del held[place]
    stages = {port.name: tuple(made.stages(port, held)) for port in ports()}
    return Laws(
        constants=made.constants,
        reasons=reasons,
        changed_by={name: tuple(places) for name, places in made.changed_by.items()},
        drifts=made.drifts(),
        stages={name: found for name, found in stages.items() if found},
    )


def constant_name(place: int, label: str, n: Names) -> str:
    """An effect's own parameter, numbered by its place in the bundle."""
    return f"{n.lower}effect_{place + 1}_{label}"


def on_names(effect: CatalogueEffect, place: int, flat: Flat, n: Names) -> CatalogueEffect:
    """The effect with its own parameters' names as numbers.

    A parameter that is newer than the bundle has no name there: its number is known.
    """
    given = flat.effects[place].values
    names = {
        q.name: symbol(constant_name(place, q.label, n))
        for q in effect.quantities
        if q.label in given
    }
    named: CatalogueEffect = dataclasses.replace(effect, **names)  # type: ignore[type-var]
    return named


class _Maker:
    """The constants and parameters so far, and the stages that they give."""

    def __init__(self, flat: Flat, n: Names) -> None:
        self._flat, self._n = flat, n
        self.constants = header_constants(flat)
        self.changed_by: dict[str, list[int]] = {}
        self._drifting: dict[str, Symbolic] = {}
        self._made: dict[tuple[str, int], EffectLaw | None] = {}

    def checked(self, place: int, effect: CatalogueEffect | None) -> CatalogueEffect:
        """The effect with its parameters' names as numbers. Raises _NotContainedError."""
        if effect is None:
            raise _NotContainedError(_NO_EFFECT)
        if effect.states:
            raise _NotContainedError(f"has a state: {', '.join(effect.states)}")
        beyond = [
            p for p in _PORTS if p not in ACTED_ON | _OF_STATES | _OF_PORTS and overrides(effect, p)
        ]
        if beyond:
            raise _NotContainedError(f"acts on the {', '.join(beyond)} of a whole test")
        if not overrides(effect, *ACTED_ON):
            raise _NotContainedError("acts on nothing that the header holds")
        named = on_names(effect, place, self._flat, self._n)
        for port in ports():
            if overrides(named, port.port):
                self._stage(port, place, named)
        return named

    def fold(self, place: int, named: CatalogueEffect, effect: CatalogueEffect | None) -> None:
        """The constants with what an effect does to the model's parameters."""
        if effect is None or not overrides(effect, "parameters"):
            return
        before = self._parameters()
        after = _called(named, "parameters", before, symbol("time_s"))
        names = own_constants(self._flat)
        changed = {
            f.name: value
            for f in dataclasses.fields(Parameters)
            if getattr(before, f.name) is not None
            and expression(value := getattr(after, f.name)) != expression(getattr(before, f.name))
        }
        if unheld := [key for key in changed if key not in names]:
            raise _NotContainedError(f"changes {', '.join(unheld)}, which is no constant here")
        known = {key: v for key, v in changed.items() if self._known(names[key])}
        if not known:
            raise _NotContainedError(f"changes {', '.join(changed)}, which is not known")
        laws = {key: reduced(expression(value)) for key, value in known.items()}
        for law in laws.values():
            _check_names(law, "")
        drifting = {k: known[k] for k, law in laws.items() if "time_s" in law.names()}
        now = effect.parameters(self._numbers(), 0.0)
        fixed = {key: float(getattr(now, key)) for key in known if key not in drifting}
        if not all(map(math.isfinite, fixed.values())):
            raise _NotContainedError("makes a constant something that is not a number")
        self.constants = with_parameters(self._flat, self.constants, fixed)
        self._drifting |= drifting
        for key in known:
            self.changed_by.setdefault(names[key], []).append(place)
        if any(key in fixed for key in GAS):
            self.changed_by.setdefault(K_R_T, []).append(place)

    def stages(self, port: Port, held: Mapping[int, CatalogueEffect]) -> list[EffectLaw]:
        """The laws of the effects at a port, in the order in which they act there."""
        found = [
            stage
            for place, effect in held.items()
            if overrides(effect, port.port) and (stage := self._stage(port, place, effect))
        ]
        return found[::-1] if port.channels else found

    def drifts(self) -> dict[str, Reduced]:
        """The constants that change over a test, by their names, in the time and themselves."""
        names = own_constants(self._flat)
        found = {names[key]: reduced(v.expr) for key, v in self._drifting.items()}
        if any(key in self._drifting for key in GAS) and self._known(K_R_T):
            parameters = self._parameters()
            product = sympy.Mul(*(expression(getattr(parameters, key)) for key in GAS))
            found[K_R_T] = reduced(product)
        return found

    def _stage(self, port: Port, place: int, effect: CatalogueEffect) -> EffectLaw | None:
        """The law of an effect at a port, computed anew only where constants drift."""
        key = (port.name, place)
        if key not in self._made or self._drifting:
            self._made[key] = self._new_stage(port, place, effect)
        return self._made[key]

    def _new_stage(self, port: Port, place: int, effect: CatalogueEffect) -> EffectLaw | None:
        value = _at_port(port, effect, self._point(), self._flat.rig.is_linear)
        if value is None or expression(value) == sympy.Symbol(VALUE):
            return None
        law, is_sensor = expression(value), bool(port.channels)
        if is_sensor:
            law, is_sensor = _solved(law)
        stage = EffectLaw(place, reduced(law), is_sensor)
        _check_names(stage.law, "other channels" if port.channels else "")
        return stage

    def _known(self, name: str) -> bool:
        return name in self.constants and self.constants[name].value is not None

    def _numbers(self) -> Parameters:
        return Parameters(**parameter_values(self._flat, self.constants))

    def _parameters(self) -> Parameters:
        """The model's parameters by the names of the constants that hold them."""
        found: dict[str, Any] = parameter_values(self._flat, self.constants)
        for key, name in read_constants(self._flat).items():
            is_known = self._known(name)
            found[key] = symbol(f"{self._n.lower}{name}" if is_known else f"{_UNKNOWN}{key}")
        return Parameters(**found | self._drifting)

    def _point(self) -> Point:
        return Point(
            time=symbol("time_s"),
            position=symbol("position"),
            velocity=symbol("velocity"),
            pressure_a=symbol("pressure_a_pa"),
            pressure_b=symbol("pressure_b_pa"),
            motor=symbol("motor_command"),
            open_a=symbol("open_a"),
            open_b=symbol("open_b"),
            direction=symbol(DIRECTION),
            parameters=self._parameters(),
            extra={name: symbol(name) for name in _DUTY_DIRECTIONS},
        )


def _at_port(port: Port, effect: CatalogueEffect, point: Point, is_linear: bool) -> Any:
    """The `value` at a port with an effect; None where a sensor's channel is absent."""
    value = symbol(VALUE)
    if port.channels:
        own = port.channels[is_linear and len(port.channels) > 1]
        position = "position_m" if is_linear else "theta_rad"
        channels = {name: symbol(name) for name in (position, "pressure_a_pa", "pressure_b_pa")}
        shown = _called(effect, "measure", channels | {own: value}, point.time)
        return shown.get(own)
    if port.port == "delays":
        return _called(effect, "delays", value, point.time, port.is_opening, port.side)
    side = () if port.side is None else (port.side,)
    flow = (symbol("flow_kg_s"),) if port.port == "pressure_rate" else ()
    return _called(effect, port.port, value, *side, *flow, point)


def _called(effect: CatalogueEffect, port: str, *arguments: Any) -> Any:
    """A port's answer; whatever the effect's code raises says that it has no C form."""
    try:
        return getattr(effect, port)(*arguments)
    except Exception as error:
        reason = str(error).strip().partition("\n")[0][:80]
        over = "needs a signal over time, or " if port == "measure" else ""
        raise _NotContainedError(f"{port} {over}has no law in C ({reason})") from None


def _solved(shown: Any) -> tuple[Any, bool]:
    """What a sensor shows, solved for `value` where it is linear in it; else as it is, True."""
    value = sympy.Symbol(VALUE)
    slope = shown.diff(value)
    if value in slope.free_symbols:
        return shown, True
    return (value - shown.subs(value, 0)) / slope, False


def _check_names(law: Reduced, why: str) -> None:
    """Raises _NotContainedError where a law reads what the header does not know."""
    names = law.names()
    if unknown := sorted(name for name in names if name.startswith(_UNKNOWN)):
        keys = ", ".join(name.removeprefix(_UNKNOWN) for name in unknown)
        raise _NotContainedError(f"needs {keys}, which is not known")
    channels = {"theta_rad", "position_m"} | ({"pressure_a_pa", "pressure_b_pa"} if why else set())
    if names & channels:
        raise _NotContainedError(f"a sensor reads {why}")


def arguments_of(port: Port, stages: Sequence[EffectLaw]) -> tuple[str, ...]:
    """The arguments of a port's function: its own, then what else its effects read."""
    read = {name for stage in stages for name in stage.law.names()}
    if DIRECTION in read:
        read.add("velocity")
    more = (name for name in ARGUMENTS if name in read and name not in port.arguments)
    return (*port.arguments, *more)
