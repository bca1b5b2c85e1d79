"""The ports through which an effect acts on the model, and the model as base plus effects.

An effect is a frozen dataclass that derives from `Effect`, holds its own parameters as
fields, and overrides the ports that it acts through. Each port gets the value so far and
the point where the model is, and returns the new value; effects compose in the order in
which they were added. At neutral strength a port must return its value to the last bit.
Ports are written with `array_namespace`, so that they serve numpy and jax alike.
"""

from __future__ import annotations

import dataclasses
import functools
import operator
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table, table
from sysid.io.channels import SIDES
from sysid.io.rig import NO_LOAD, Load
from sysid.plant.base import Array, Parameters
from sysid.types import FloatArray, IntArray


@dataclass(frozen=True)
class Point:
    """The state of the model: what every port may read. Fields broadcast over runs.

    `motor` is the commanded effort; `open_a`, `open_b` whether a valve is on (with an
    averaged valve model: the duty); `direction` -1, 0 (at rest) or 1, to be used in place
    of the sign of the velocity; `extra` the states that the effects added.
    """

    time: Array
    position: Array
    velocity: Array
    pressure_a: Array
    pressure_b: Array
    motor: Array
    open_a: Array
    open_b: Array
    direction: Array
    parameters: Parameters
    extra: Mapping[str, Array] = field(default_factory=dict)

    @classmethod
    def at_rest(cls, parameters: Parameters, zero: Array, **given: Array) -> Point:
        """Where nothing moves or is commanded and the chambers are at the atmosphere, but for what
        is `given`; `zero`: 0, of the fields' shape."""
        air = zero + parameters.atmosphere
        still = dict.fromkeys(("time", "position", "velocity", "motor", "direction"), zero)
        shut = dict.fromkeys(("open_a", "open_b"), zero)
        usual = {**still, **shut, "pressure_a": air, "pressure_b": air}
        return cls(**{**usual, **given}, parameters=parameters)

    def pressure(self, side: str) -> Array:
        """Chamber pressure, Pa; `side` is "a" or "b"."""
        return self.pressure_a if side == "a" else self.pressure_b

    def is_open(self, side: str) -> Array:
        """Whether the valve is on (averaged valve model: the duty)."""
        return self.open_a if side == "a" else self.open_b

    def vents(self, side: str) -> Array:
        """Whether a chamber's valve lets air out (averaged valve model: the share of the time)."""
        if not self.parameters.bleeds:
            return 1.0 - self.is_open(side)
        return self.open_b if side == "a" else 0.0 * self.open_b


class Effect:
    """Every port, neutral. Derive, add fields (floats or arrays over runs), override.

    `states` names the extra states; a name must be unique among the effects of a model.
    """

    states: ClassVar[tuple[str, ...]] = ()
    # Rate of its states along a motion that is given, 1/s, where steps of 1 ms are too long for it.
    fastest_rate: ClassVar[float] = 0.0
    # Whether `measure` begins anew after a long gap of time: many tests are then measured as one.
    forgets_in_gaps: ClassVar[bool] = False
    # Whether `measure` shows each row by itself, whatever the time: it is asked for some rows then.
    measures_each_row: ClassVar[bool] = False

    def parameters(self, parameters: Parameters, time: Array) -> Parameters:
        """The base model's own numbers at `time` (s since the first row)."""
        return parameters

    def motor_effort(self, effort: Array, point: Point) -> Array:
        """Motor effort at the output, Nm or N, after the declared limit."""
        return effort

    def friction_effort(self, effort: Array, point: Point) -> Array:
        """Friction while moving in `point.direction`, Nm or N."""
        return effort

    def static_effort(self, effort: Array, point: Point) -> Array:
        """Breakaway effort, Nm or N."""
        return effort

    def external_effort(self, effort: Array, point: Point) -> Array:
        """Any other effort in the direction of positive motion, Nm or N."""
        return effort

    def pitch_radius(self, radius: Array, point: Point) -> Array:
        """dy/dtheta, m: lever of the cylinder's force and rate of the volumes."""
        return radius

    def displacement(self, displacement: Array, point: Point) -> Array:
        """y, m: the piston's place, which must be the integral of pitch_radius."""
        return displacement

    def supply_pressure(self, pressure: Array, side: str, point: Point) -> Array:
        """Supply pressure at the valve of a side, Pa.

        Asked too for a chamber at 0 Pa: where choked flow leaves the supply.
        """
        return pressure

    def exhaust_pressure(self, pressure: Array, side: str, point: Point) -> Array:
        """Pressure that the valve of a side exhausts to, Pa.

        Asked too for a chamber at 1e9 Pa: where choked flow leaves the exhaust.
        """
        return pressure

    def filling_flow(self, flow: Array, side: str, point: Point) -> Array:
        """Flow into the chamber through the open valve, kg/s."""
        return flow

    def exhaust_flow(self, flow: Array, side: str, point: Point) -> Array:
        """Flow into the chamber (negative: out) through the valve when off, kg/s."""
        return flow

    def chamber_flow(self, flow: Array, side: str, point: Point) -> Array:
        """Whole mass flow into a chamber, kg/s: leakage adds here, a tube's lag replaces."""
        return flow

    def pressure_rate(self, rate: Array, side: str, flow: Array, point: Point) -> Array:
        """dP/dt from the chamber's energy balance, Pa/s."""
        return rate

    def initial_states(self, point: Point) -> dict[str, Array]:
        """The extra states at the start of a test, by the names in `states`."""
        return {}

    def state_rates(self, point: Point, flows: Mapping[str, Array]) -> dict[str, Array]:
        """Time derivatives of the extra states; `flows` holds kg/s by side."""
        return {}

    def settled(self) -> Effect | None:
        """The effect where its states have settled, without them; None where it is gone then."""
        return None if self.states else self

    def pulses(self, on: Array, off: Array, side: str) -> tuple[Array, Array]:
        """Commanded on-intervals of a valve, start and end times in s (numpy only)."""
        return on, off

    def delays(self, delays: Array, times: Array, opening: bool, side: str) -> Array:
        """Delay of each command edge at `times`, s (numpy only)."""
        return delays

    def measure(self, channels: Mapping[str, Array], time: Array) -> dict[str, Array]:
        """Measured channels from true ones; arrays (n,) by log-format names, time in s.

        A channel that is not asked for may be absent.
        """
        return dict(channels)

    def unmeasured(self, channels: Mapping[str, Array], time: Array) -> dict[str, Array]:
        """True channels of one test, evenly sampled, from measured ones: the inverse of `measure`.

        To be overridden where undoing it by iteration does not converge; before other sensors.
        """
        return dict(channels)

    def is_idle(self, port: str) -> bool:
        """Whether the effect in this form does nothing at a port that its class overrides.

        Its numbers may be traced by jax: then it is not idle.
        """
        return False

    def recent_pulses(self, on: Array, off: Array, until: Array, side: str) -> tuple[Array, Array]:
        """`pulses` as a closed loop knows them: the last intervals (kept, lanes), newest first.

        `until` (lanes,): when the next pulse may start, s. An interval that does not exist, or
        no longer, is at minus infinity; one whose end is not decided ends at infinity. To be
        overridden together with `pulses`.
        """
        return on, off

    def start_sensing(self, channels: Mapping[str, Array], step: float) -> tuple[Array, ...]:
        """Memory of `sense` at rest at these true channels; none if rows are independent.

        Where it is overridden, `measure` gets simulated channels between a log's rows as well.
        """
        return ()

    def sense(
        self,
        channels: Mapping[str, Array],
        memory: tuple[Array, ...],
        time: Array,
        step: float,
    ) -> tuple[dict[str, Array], tuple[Array, ...]]:
        """`measure` a sample at a time, `step` s apart, as a closed loop does; arrays (lanes,).

        To be overridden, with `start_sensing`, where `measure` needs more than one row.
        """
        return self.measure(channels, time), memory


def overrides(effect: Effect | type[Effect], *ports: str) -> bool:
    """Whether an effect acts through any of these ports; of a class: whether one of it may."""
    kind = effect if isinstance(effect, type) else type(effect)
    own = [p for p in ports if getattr(kind, p) is not getattr(Effect, p)]
    return bool(own) and (isinstance(effect, type) or not all(effect.is_idle(p) for p in own))


@dataclass(frozen=True, repr=False)
class Model(Shown):
    """The base model with its parameters (SI) and effects; `+` adds an effect.

    Raises ValueError where two effects add the same state.

    >>> model = bundle.model() + si.effects.TorqueOffset(0.01)
    >>> [effect.id for effect in model.effects]
    ['torque-offset']
    >>> model.parameters.stroke == campaign.rig.cylinder.stroke_m
    True
    """

    parameters: Parameters
    effects: tuple[Effect, ...] = ()

    def __add__(self, effect: Effect) -> Model:
        taken = {name for e in self.effects for name in e.states}
        clash = taken.intersection(effect.states)
        if clash:
            raise ValueError(f"two effects add the state {', '.join(sorted(clash))}")
        return Model(self.parameters, (*self.effects, effect))

    def headline(self) -> str:
        """The base model, and the effects in it."""
        ids = [str(getattr(e, "id", type(e).__name__)) for e in self.effects]
        return f"base model with {', '.join(ids)}" if ids else "base model without effects"

    def records(self) -> list[dict[str, Any]]:
        """One record per number: its part, name and value (SI); None where it differs by run."""
        return [
            {"part": part, "name": name, "value": value if isinstance(value, float) else None}
            for part, name, value in self._numbers()
        ]

    def tables(self) -> Iterable[Table]:
        """The numbers, one row per part of the plant and per effect; SI."""
        said: dict[str, list[str]] = {}
        for part, name, value in self._numbers():
            shown = f"{value:.4g}" if isinstance(value, float) else "by run"
            said.setdefault(part, []).append(f"{name}={shown}")
        rows = [
            (part, textwrap.fill(", ".join(numbers), _LINE, break_on_hyphens=False))
            for part, numbers in said.items()
        ]
        yield table("", ("part", "numbers, SI"), rows, text=(1,))

    def _numbers(self) -> Iterator[tuple[str, str, Any]]:
        """Part, name and value of each number that is known: not None, not NaN."""
        parts: list[tuple[str, Any]] = [("", self.parameters)]
        parts += ((type(e).__name__, e) for e in self.effects)
        for title, part in parts:
            known = dataclasses.fields(part) if dataclasses.is_dataclass(part) else ()
            for name in (f.name for f in known):
                value = getattr(part, name)
                if value is None or isinstance(value, bool | str | tuple):
                    continue
                if isinstance(value, float | int | np.floating):
                    value = float(value)
                    if np.isnan(value):
                        continue
                yield title or _part_of(name), name, value

    @property
    def has_remembering_sensor(self) -> bool:
        """Whether a sensor shows at a row what was before it (a lag, a delay)."""
        return any(overrides(effect, "start_sensing") for effect in self.effects)

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the extra states, in order."""
        return tuple(name for effect in self.effects for name in effect.states)

    def through(self, port: str, value: Any, *context: Any) -> Any:
        """A value passed through one port of every effect."""
        for effect in self.effects:
            value = getattr(effect, port)(value, *context)
        return value

    def settled(self) -> Model:
        """The model where the states of its effects have settled, without them."""
        left = (effect.settled() for effect in self.effects)
        return Model(self.parameters, tuple(effect for effect in left if effect is not None))

    def carrying(self, load: Load) -> Model:
        """The model with more of a payload than its own; itself without any."""
        if load == NO_LOAD:
            return self
        return Model(with_load(self.parameters, load), self.effects)

    def supplied_at(self, pressure: float | None) -> Model:
        """The model on a line of another pressure, Pa; itself where that is None."""
        if pressure is None:
            return self
        return Model(self.parameters.replace(supply=pressure), self.effects)

    def at(self, time: Array) -> Parameters:
        """The parameters in force at a time."""
        parameters: Parameters = self.through("parameters", self.parameters, time)
        return parameters


# Letters in a line of a model's numbers, as it shows itself.
_LINE = 80
# Parts of the plant by the names of their numbers in `Parameters`; the rest is of a valve.
_PARTS = {
    "mechanics": (
        "static_effort coulomb_effort viscous inertia gravity_moment weight offset max_effort "
        "stiffness preload"
    ),
    "cylinder": "area_a area_b offset_a offset_b stroke pitch_radius",
    "air": "gas_constant heat_capacity_ratio temperature atmosphere supply supply_reference",
    "PWM": "pwm_period",
}


def _part_of(name: str) -> str:
    held = (part for part, names in _PARTS.items() if name in names.split())
    return next(held, f"valve {name[-1].upper()}")


def with_load(parameters: Parameters, load: Load) -> Parameters:
    """Parameters with more of a payload than their own; that of each sample, where it has (n,)."""
    return parameters.replace(
        inertia=parameters.inertia + load.inertia,
        gravity_moment=parameters.gravity_moment + load.gravity_moment,
        weight=parameters.weight + load.weight,
    )


Structure = tuple[tuple[type, tuple[tuple[str, Any], ...]], ...]


def split(parts: tuple[Any, ...]) -> tuple[Structure, list[dict[str, Any]]]:
    """Dataclass instances split into a hashable structure and their numbers.

    The structure (classes and fields that are not numbers) decides what is compiled; the
    numbers are its inputs, those of a dataclass within another as a dict. `join` is the inverse.
    """
    apart = [_split_one(part) for part in parts]
    return tuple(structure for structure, _ in apart), [numbers for _, numbers in apart]


def _split_one(part: Any) -> tuple[Any, dict[str, Any]]:
    kind: type = type(part)
    fixed: list[tuple[str, Any]] = []
    values: dict[str, Any] = {}
    for name in _field_names(kind):
        value = getattr(part, name)
        if value is None or isinstance(value, str | bool | tuple):
            fixed.append((name, value))
        elif dataclasses.is_dataclass(value):
            structure, values[name] = _split_one(value)
            fixed.append((name, _Nested(*structure)))
        else:
            values[name] = value
    return (kind, tuple(fixed)), values


class _Nested(NamedTuple):
    """The structure of a dataclass within another."""

    kind: type
    fixed: tuple[tuple[str, Any], ...]


@functools.cache
def _field_names(kind: type) -> tuple[str, ...]:
    return tuple(f.name for f in dataclasses.fields(kind))


def join(structure: Structure, numbers: list[dict[str, Any]]) -> tuple[Any, ...]:
    """Rebuild what `split` took apart."""
    return tuple(_join_one(*one, values) for one, values in zip(structure, numbers, strict=True))


def joined_model(structure: Structure, numbers: list[dict[str, Any]]) -> Model:
    """The model whose parameters and effects `split` took apart."""
    parameters, *effects = join(structure, numbers)
    return Model(parameters, tuple(effects))


def _join_one(kind: type, fixed: tuple[tuple[str, Any], ...], values: dict[str, Any]) -> Any:
    known = {
        name: _join_one(*value, values[name]) if isinstance(value, _Nested) else value
        for name, value in fixed
    }
    return kind(**{**values, **known})


def stack_models(models: list[Model]) -> Model:
    """One model whose every number is an array over runs, from models of one structure.

    Raises ValueError where the models differ in more than numbers.
    """
    own = list({id(model): model for model in models}.values())  # idle runs repeat a model
    place = {id(model): i for i, model in enumerate(own)}
    which = np.array([place[id(model)] for model in models])
    parts = [(model.parameters, *model.effects) for model in own]
    structure, first = split(parts[0])
    if any(len(part) != len(structure) for part in parts):
        raise ValueError(_UNLIKE)
    stacked = [
        _columns(one, tuple(numbers), column, which)
        for one, numbers, column in zip(structure, first, zip(*parts, strict=True), strict=True)
    ]
    return joined_model(structure, stacked)


def in_rows(models: list[Model]) -> Model:
    """Models of one structure as one whose ports take points (n,) and give (models, n).

    A number that all have in common stays one. Raises ValueError as `stack_models`.
    """
    if len(models) == 1:
        return models[0]
    stacked = stack_models(models)
    structure, numbers = split((stacked.parameters, *stacked.effects))
    rows = [{name: _row(values) for name, values in part.items()} for part in numbers]
    return joined_model(structure, rows)


def _row(values: FloatArray) -> float | FloatArray:
    first = float(values[0])
    common = (values == first) | np.isnan(values) & np.isnan(first)
    return first if common.all() else values[:, None]


_FIXED = frozenset((type(None), bool, str, tuple))
_UNLIKE = "models of one batch must have the same effects, and valves of one law"


def _columns(
    structure: Any, names: tuple[str, ...], parts: tuple[Any, ...], which: IntArray
) -> dict[str, FloatArray]:
    """Each number of parts of one structure, (runs,): those of the part `which` (runs,) says."""
    kind, fixed = structure
    values = [value for _, value in fixed]
    known = _values_of(tuple(name for name, _ in fixed))
    if any(type(part) is not kind or known(part) != values for part in parts):
        raise ValueError(_UNLIKE)
    numbers = _values_of(names)
    rows = [numbers(part) for part in parts]
    if not _FIXED.isdisjoint(set().union(*(map(type, row) for row in rows))):
        raise ValueError(_UNLIKE)
    columns = np.array(rows, dtype=float).reshape(len(rows), len(names)).T[:, which]
    return dict(zip(names, columns, strict=True))


@functools.cache
def _values_of(names: tuple[str, ...]) -> Callable[[Any], list[Any]]:
    """What reads the attributes of these names, as a list."""
    if len(names) < 2:
        return lambda part: [getattr(part, name) for name in names]
    several = operator.attrgetter(*names)
    return lambda part: list(several(part))


def has_discrete_law(parameters: Parameters) -> bool:
    """Whether both valves have the flow parameters of their law."""
    return all(has_law(parameters, side) for side in SIDES)


def has_law(parameters: Parameters, side: str) -> bool:
    """Whether valve A or B has the flow parameters of its law."""
    law = parameters.valve(side)
    flows = (getattr(law, field.name) for field in dataclasses.fields(law))
    return not any(flow is not None and np.isnan(flow).any() for flow in flows)
