"""Equation errors of a model along measured traces: torque balance, chambers, breakaways.

Every term comes from `sysid.plant` through its ports, so that an effect of any kind acts
here as it does in a simulation. Extra states are integrated along the measured trace;
sensor effects are undone before the equations use a channel.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.balance.residuals import breakaway_residual, effort_residual, modelled_rate
from sysid.diagnosis.actuator import states as extra_states
from sysid.diagnosis.actuator.samples import Rows, Traces, opening, selected, selection, smooth
from sysid.diagnosis.actuator.states import StatesModel, integrate_states, point_of
from sysid.io.channels import SIDES
from sysid.parallel import give_back, kept_per_thread
from sysid.plant.effects.entry import of_side
from sysid.plant.ports import Effect, Model, Point, overrides
from sysid.plant.sensors import without_errors
from sysid.types import FloatArray

EFFORT, RATE_A, RATE_B = "effort", "rate_a", "rate_b"
RATES = (RATE_A, RATE_B)
BALANCES = (EFFORT, *RATES)
BREAKAWAY = "breakaway"
CHANNELS = (*BALANCES, BREAKAWAY)

_SENSOR_CUTOFF_HZ = 80.0
_INVERSE_CUTOFF_HZ = 45.0
_TIMING_PORTS = ("pulses", "delays")

FRICTION_PARAMETERS = ("coulomb_effort", "viscous")
FLOW_PARAMETERS = tuple(
    f"{law}_{side}"
    for side in SIDES
    for law in (
        "choked_fill",
        "choked_dis",
        "c_fill",
        "c_dis",
        # Of a direction that obeys ISO 6358; others have none.
        "sonic_conductance_fill",
        "critical_ratio_fill",
        "sonic_conductance_dis",
        "critical_ratio_dis",
    )
)
_FITTED = FRICTION_PARAMETERS + FLOW_PARAMETERS


@dataclass(frozen=True)
class EquationError:
    """Residuals sample by sample, measured less modelled: effort in Nm or N, rates in Pa/s.

    (n,) each, or one per requested row. `effort` is the effort that the model does not
    explain, in the direction of positive motion; `rate_a` and `rate_b` are the pressure rates
    that it does not explain. `breakaway`: at a row where the shaft is about to break away, the
    effort that is applied beyond that at which the model does, in Nm or N.
    """

    effort: FloatArray
    rate_a: FloatArray
    rate_b: FloatArray
    breakaway: FloatArray

    def __getitem__(self, channel: str) -> FloatArray:
        values: FloatArray = getattr(self, channel)
        return values


# Ports that reach one of the balances only; all others reach both.
_EFFORT_PORTS = ("motor_effort", "friction_effort", "external_effort")
_BREAKAWAY_PORTS = ("static_effort",)
_RATE_PORTS = (
    "supply_pressure",
    "exhaust_pressure",
    "filling_flow",
    "exhaust_flow",
    "chamber_flow",
    "pressure_rate",
    "pulses",
    "delays",
)
_BOTH_PORTS = ("parameters", "pitch_radius", "displacement", "measure")


# Through these an effect without a side couples one side to the other.
_COUPLING_PORTS = ("supply_pressure", "exhaust_pressure", "chamber_flow")


def channels_of(effect: Effect, others: Sequence[Effect] = ()) -> tuple[str, ...]:
    """The channels whose residual an effect can change, given the effects in `others`.

    An effect of one side does not change the other's rate, unless another couples the sides.
    What acts in motion is judged by motion: the few breakaways are for what acts on them alone.
    """
    if overrides(effect, *_BREAKAWAY_PORTS) and not overrides(
        effect, *_EFFORT_PORTS, *_RATE_PORTS, *_BOTH_PORTS
    ):
        return (BREAKAWAY,)
    effort = overrides(effect, *_EFFORT_PORTS, *_BOTH_PORTS)
    rates = overrides(effect, *_RATE_PORTS, *_BOTH_PORTS)
    coupled = any(overrides(e, *_COUPLING_PORTS) and not hasattr(e, "side") for e in others)
    chosen = "both" if coupled else getattr(effect, "side", "both")
    sides = [side for side in SIDES if rates and chosen in (side, "both")]
    return (EFFORT,) * effort + tuple(f"rate_{side}" for side in sides)


def equation_error(
    traces: Traces,
    model: Model,
    channels: tuple[str, ...] = CHANNELS,
    rows: Mapping[str, Rows] | None = None,
) -> EquationError:
    """Residuals of a model at every sample of the traces, or at a channel's own `rows`.

    Zeros where not requested. At rest friction is whatever holds the shaft: the effort
    residual means nothing there, and `Traces.direction` is 0.
    """
    sensors = tuple(e for e in model.effects if overrides(e, "measure"))
    timing = tuple(e for e in model.effects if overrides(e, *_TIMING_PORTS))
    seen = whole = _without_sensors(traces, sensors)
    if timing:
        # Fitted numbers do not affect the timing; as part of the key they would defeat the cache.
        known = [n for n in _FITTED if getattr(model.parameters, n) is not None]
        fixed = model.parameters.replace(**dict.fromkeys(known, 0.0))
        whole = _with_timing(seen, traces, Model(fixed, timing))
    states: dict[str, FloatArray] = {}
    for concerned in _with_states(model, traces):
        # States that do not follow the timing serve each that is tried.
        states |= _states(whole if concerned.follows_valves else seen, concerned)
    found = {name: np.zeros(len(rows[name].index) if rows else len(traces)) for name in CHANNELS}
    for name in channels:
        own = rows[name] if rows else None
        shows = () if name in _MECHANICAL else _of_pressure(sensors, name[-1])
        # A sensor that remembers needs its input without gaps.
        gaps = own if all(e.measures_each_row for e in shows) else None
        here, extra = whole, states
        if gaps is not None:
            # What does not depend on the timing is the same for all that are tried.
            here = _selected(seen, gaps) if sensors else seen.at(gaps)
            extra = {n: v[gaps.index] for n, v in states.items()}
            if timing:
                here = here.with_opening(whole.open_a[gaps.index], whole.open_b[gaps.index])
        point = replace(point_of(here, model), extra=extra)
        if name in _MECHANICAL:
            found[name] = _MECHANICAL[name](here, point, model)
            continue
        side = name[-1]
        rate = modelled_rate(side, point, model)
        if shows:
            rate = _as_shown(here, side, rate, shows)
        shown = getattr(traces, name)
        if own is not None:
            shown = shown[own.index]
            rate = rate if gaps is own else rate[own.index]
        found[name] = np.asarray(shown - rate)
    return EquationError(**found)


def _effort_error(traces: Traces, point: Point, model: Model) -> FloatArray:
    return effort_residual(point, traces.acceleration, model)


def _breakaway_error(_traces: Traces, point: Point, model: Model) -> FloatArray:
    return breakaway_residual(point, model)


_MECHANICAL = {EFFORT: _effort_error, BREAKAWAY: _breakaway_error}


def _of_pressure(sensors: tuple[Effect, ...], side: str) -> tuple[Effect, ...]:
    """Those of the sensors that change what is shown of a chamber's pressure."""
    name, asked = f"pressure_{side}_pa", np.array([0.0, 1.0, 0.0])
    channels = {"theta_rad": np.zeros(3), name: asked}
    time = np.arange(3.0)
    return tuple(e for e in sensors if e.measure(channels, time)[name] is not asked)


def _as_shown(
    traces: Traces, side: str, rate: FloatArray, sensors: tuple[Effect, ...]
) -> FloatArray:
    """The model's pressure rate (n,) as the pressure sensor would show it.

    The sensors are applied to the model's side: undone on the measured rate, a lag would
    raise its noise.
    """
    name = f"pressure_{side}_pa"
    # The other chamber's sensor is not asked.
    moved = _measured(traces, sensors, {"theta_rad": traces.position, name: rate})
    return np.asarray(moved[name] - _shown_of_none(traces, sensors, name))


@kept_per_thread(4)
def _shown_of_none(traces: Traces, sensors: tuple[Effect, ...], name: str) -> FloatArray:
    """What the sensors show of a channel (n,) that is 0."""
    none = {"theta_rad": traces.position, name: np.zeros(len(traces))}
    return _measured(traces, sensors, none)[name]


def _measured(
    traces: Traces, sensors: tuple[Effect, ...], channels: Mapping[str, FloatArray]
) -> Mapping[str, FloatArray]:
    """Channels (n,) of all tests as the sensors show them, each test from its own first row."""
    if all(effect.forgets_in_gaps for effect in sensors):
        for effect in sensors:
            channels = effect.measure(channels, traces.time_with_gaps)
        return channels
    found = {name: np.empty(len(traces)) for name in channels}
    for run in traces.runs:
        own: Mapping[str, FloatArray] = {name: c[run.rows] for name, c in channels.items()}
        for effect in sensors:
            own = effect.measure(own, traces.time[run.rows])
        for name, shown in found.items():
            shown[run.rows] = own[name]
    return found


def _unmeasured(
    traces: Traces, sensors: Sequence[Effect], channels: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """The channels (n,) before sensors that have an inverse of their own."""
    true = dict(channels)
    for effect in reversed(sensors):
        whole = {name: np.empty(len(traces)) for name in true}
        for run in traces.runs:
            own = {name: shown[run.rows] for name, shown in true.items()}
            for name, values in effect.unmeasured(own, traces.time[run.rows]).items():
                whole[name][run.rows] = values
        for name, shown in true.items():
            gap = whole[name] - shown
            if gap.any():
                # Twice: what is slow passes nearly whole (twicing; Tukey, 1977).
                near = smooth(traces.runs, gap, _INVERSE_CUTOFF_HZ)
                true[name] = shown + near + smooth(traces.runs, gap - near, _INVERSE_CUTOFF_HZ)
    return true


def forget() -> None:
    """Drop the caches kept for the traces of a diagnosis, and the memory that it has freed."""
    for kept in (_without_sensors, _opening, *_OF_SENSORS_TRACES):
        kept.forget()
    selected.cache_clear()
    extra_states.forget()
    give_back()


def _with_states(model: Model, traces: Traces) -> Iterator[StatesModel]:
    """The model with only those effects that influence the extra states: once with those whose
    states act on the pressures' rates, once with those whose do not, which need fewer tests."""
    ports = ("parameters", "pitch_radius", "displacement")
    acting: dict[bool, list[Effect]] = {True: [], False: []}
    for effect in model.effects:
        if effect.states:
            alone = StatesModel.of(Model(model.parameters, (effect,)), traces)
            acting[alone.acts_on_rates].append(effect)
        elif overrides(effect, *ports):
            acting[True].append(effect)
            acting[False].append(effect)
    for effects in acting.values():
        if any(effect.states for effect in effects):
            yield StatesModel.of(Model(model.parameters, tuple(effects)), traces)


@kept_per_thread(4)
def _states(traces: Traces, own: StatesModel) -> dict[str, FloatArray]:
    return integrate_states(traces, own.model, needs_flow=own.acts_on_rates)


@kept_per_thread(2)
def _with_timing(seen: Traces, traces: Traces, model: Model) -> Traces:
    opened = []
    for side in SIDES:
        own = tuple(e for e in model.effects if of_side(side, getattr(e, "side", "both")))
        opened.append(_opening(traces, Model(model.parameters, own), side))
    return seen.with_opening(*opened)


# Most models that are tried one after the other have one valve, or both, as the model before.
@kept_per_thread(4)
def _opening(traces: Traces, model: Model, side: str) -> FloatArray:
    """`opening` of the tests by the effects that act on the valve of this side."""
    return opening(traces.runs, model, side)


@kept_per_thread(4)
def _selected(seen: Traces, rows: Rows) -> Traces:
    """`Traces.at` of traces that are gone with the next sensors."""
    return selection(seen, rows)


# What is worked out from traces that other sensors make useless.
_OF_SENSORS_TRACES = (_with_timing, _states, _selected, _shown_of_none)


# Most models that are tried one after the other have the same sensors; each takes 14 channels.
@kept_per_thread(1)
def _without_sensors(traces: Traces, sensors: tuple[Effect, ...]) -> Traces:
    """The traces as they were before the sensors: the `measure` ports undone by iteration, where
    an effect has no inverse of its own.

    The sensors' attenuation is undone up to a cut-off, above which this would amplify the
    noise without bound.
    """
    for kept in _OF_SENSORS_TRACES:
        kept.forget()
    if not sensors:
        return traces
    names = ("theta_rad", "pressure_a_pa", "pressure_b_pa")
    logged = (traces.position, traces.pressure_a, traces.pressure_b)
    invertible = [e for e in sensors if overrides(e, "unmeasured")]
    others = tuple(e for e in sensors if e not in invertible)
    shown = _unmeasured(traces, invertible, dict(zip(names, logged, strict=True)))

    def error(true: dict[str, FloatArray]) -> dict[str, FloatArray]:
        after = _measured(traces, others, true)
        gaps = {name: after[name] - row for name, row in true.items()}
        return {
            name: smooth(traces.runs, gap, _SENSOR_CUTOFF_HZ) if gap.any() else gap
            for name, gap in gaps.items()
        }

    true = without_errors(shown, error) if others else shown
    found = traces.with_channels(*(true[name] for name in names))
    # Where it hardly moves without the sensors' errors it goes the way that is measured: elsewhere
    # no window is.
    if found.direction is traces.direction:
        return found
    moving = np.where(found.direction == 0.0, traces.direction, found.direction)
    return replace(found, direction=moving)
