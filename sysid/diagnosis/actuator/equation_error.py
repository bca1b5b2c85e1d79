"""Equation errors of a model along measured traces: torque balance and chamber balances.

Every term comes from `sysid.model` through its ports, so that an effect of any kind acts
here as it does in a simulation. Extra states are integrated along the measured trace;
sensor effects are undone before the equations use a channel.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from sysid.diagnosis.actuator.samples import Rows, Traces, opening, smooth
from sysid.io.channels import SIDES
from sysid.model import base, plant
from sysid.model.ports import Effect, Model, Point, overrides
from sysid.types import FloatArray, IntArray

EFFORT, RATE_A, RATE_B = "effort", "rate_a", "rate_b"
CHANNELS = (EFFORT, RATE_A, RATE_B)

# States are integrated in pieces, all at once, each after a run-up from rest.
_PIECE_S = 0.25
_RUN_UP_S = 0.35
# A resonance takes longer to forget, and costs less: fewer tests, no flows.
_MECHANICAL_RUN_UP_S = 1.0
_STATE_STEP_S = 1e-3
_SENSOR_ROUNDS = 2
_SENSOR_CUTOFF_HZ = 80.0
_TIMING_PORTS = ("pulses", "delays")

FRICTION_PARAMETERS = ("coulomb_effort", "viscous")
FLOW_PARAMETERS = tuple(
    f"{law}_{side}" for side in SIDES for law in ("choked_fill", "choked_dis", "c_fill", "c_dis")
)
_FITTED = FRICTION_PARAMETERS + FLOW_PARAMETERS


@dataclass(frozen=True)
class EquationError:
    """Residuals sample by sample, measured less modelled: effort in Nm or N, rates in Pa/s.

    (n,) each, or one per requested row. `effort` is the effort that the model does not
    explain, in the direction of positive motion; `rate_a` and `rate_b` are the pressure rates
    that it does not explain.
    """

    effort: FloatArray
    rate_a: FloatArray
    rate_b: FloatArray

    def __getitem__(self, channel: str) -> FloatArray:
        values: FloatArray = getattr(self, channel)
        return values


# Ports that reach one of the balances only; all others reach both.
_EFFORT_PORTS = ("motor_effort", "friction_effort", "static_effort", "external_effort")
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


def channels_of(effect: Effect, beside: Sequence[Effect] = ()) -> tuple[str, ...]:
    """The channels whose residual an effect can change, given the effects in `beside`.

    An effect of one side does not change the other's rate, unless another couples the sides.
    """
    effort = overrides(effect, *_EFFORT_PORTS, *_BOTH_PORTS)
    rates = overrides(effect, *_RATE_PORTS, *_BOTH_PORTS)
    coupled = any(overrides(e, *_COUPLING_PORTS) and not hasattr(e, "side") for e in beside)
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
    seen = _without_sensors(traces, sensors)
    if timing:
        # Fitted numbers do not affect the timing; as part of the key they would defeat the cache.
        fixed = model.parameters.replace(**dict.fromkeys(_FITTED, 0.0))
        seen = _with_timing(seen, traces, Model(fixed, timing))
    states = _states(seen, _with_part_in_states(model)) if model.state_names else {}
    found = {name: np.zeros(len(rows[name].index) if rows else len(traces)) for name in CHANNELS}
    for name in channels:
        own = rows[name] if rows else None
        # A sensor with memory needs its input without gaps.
        gaps = None if sensors and name != EFFORT else own
        here, extra = seen, states
        if gaps is not None:
            here, extra = seen.at(gaps), {n: v[gaps.index] for n, v in states.items()}
        point = replace(point_of(here, model), extra=extra)
        if name == EFFORT:
            found[name] = _effort_error(here, point, model)
            continue
        side = name[-1]
        rate = plant.pressure_rate(side, chamber_flow(side, point, model), point, model)
        if sensors:
            rate = _as_shown(here, side, np.asarray(rate), sensors)
        shown = getattr(traces, name)
        if own is not None:
            shown = shown[own.index]
            rate = rate if gaps is own else rate[own.index]
        found[name] = np.asarray(shown - rate)
    return EquationError(**found)


def point_of(traces: Traces, model: Model) -> Point:
    """Where the model is at every sample."""
    parameters = model.at(traces.time)
    supply = parameters.supply + (traces.supply - parameters.supply_reference)
    return Point(
        time=traces.time,
        position=traces.position,
        velocity=traces.velocity,
        pressure_a=traces.pressure_a,
        pressure_b=traces.pressure_b,
        motor=traces.motor,
        open_a=traces.open_a,
        open_b=traces.open_b,
        direction=traces.direction,
        parameters=parameters.replace(supply=supply),
    )


def chamber_flow(side: str, point: Point, model: Model) -> FloatArray:
    """Mean flow into a chamber over the time around a sample, kg/s (n,).

    Each sample holds a share of filling and one of exhaust; the law is taken at both.
    """
    share = np.asarray(point.is_open(side))
    pressure = point.pressure(side)
    ones = np.ones_like(share)
    # A port reads both valves: where one effect couples the sides, the other keeps its share.
    full: dict[str, Any] = {f"open_{side}": ones}
    none: dict[str, Any] = {f"open_{side}": 0.0 * ones}
    opened, closed = replace(point, **full), replace(point, **none)
    fill_choked = pressure <= plant.filling_boundary(side, opened, model)
    dis_choked = pressure >= plant.exhaust_boundary(side, closed, model)
    fill = plant.discrete_flow(side, fill_choked, opened, model)
    exhaust = plant.discrete_flow(side, dis_choked, closed, model)
    return np.asarray(share * fill + (1.0 - share) * exhaust)


def _effort_error(traces: Traces, point: Point, model: Model) -> FloatArray:
    applied = plant.applied_effort(point, model)
    friction = plant.sliding_friction(point, model)
    return np.asarray(point.parameters.inertia * traces.acceleration - (applied - friction))


def _as_shown(
    traces: Traces, side: str, rate: FloatArray, sensors: tuple[Effect, ...]
) -> FloatArray:
    """The model's pressure rate (n,) as the pressure sensor would show it.

    The sensors are applied to the model's side: undone on the measured rate, a lag would
    raise its noise.
    """
    nothing, name = np.zeros(len(traces)), f"pressure_{side}_pa"
    found = np.empty(len(traces))
    for run in traces.runs:
        rows = run.rows
        time = traces.time[rows]
        zero: Mapping[str, FloatArray] = {
            "theta_rad": traces.position[rows],
            "pressure_a_pa": nothing[rows],
            "pressure_b_pa": nothing[rows],
        }
        moved: Mapping[str, FloatArray] = {**zero, name: rate[rows]}
        for effect in sensors:
            zero, moved = effect.measure(zero, time), effect.measure(moved, time)
        found[rows] = moved[name] - zero[name]
    return found


def forget() -> None:
    """Drop the caches kept for the traces of a diagnosis."""
    for kept in (_without_sensors, _with_timing, _states, Traces.at):
        kept.cache_clear()


def _with_part_in_states(model: Model) -> Model:
    """The model with only those effects that influence the extra states."""
    ports = ("parameters", "pitch_radius", "displacement")
    return Model(
        model.parameters, tuple(e for e in model.effects if e.states or overrides(e, *ports))
    )


@lru_cache(maxsize=4)
def _states(traces: Traces, model: Model) -> dict[str, FloatArray]:
    return integrate_states(traces, model)


@lru_cache(maxsize=2)
def _with_timing(seen: Traces, traces: Traces, model: Model) -> Traces:
    return seen.with_opening(*(opening(traces.runs, model, side) for side in SIDES))


@lru_cache(maxsize=2)
def _without_sensors(traces: Traces, sensors: tuple[Effect, ...]) -> Traces:
    """The traces as they were before the sensors: the `measure` ports undone by iteration.

    The sensors' attenuation is undone up to a cut-off, above which this would amplify the
    noise without bound.
    """
    if not sensors:
        return traces
    names = ("theta_rad", "pressure_a_pa", "pressure_b_pa")
    shown = (traces.position, traces.pressure_a, traces.pressure_b)
    true = list(shown)
    for _ in range(_SENSOR_ROUNDS):
        lost = [np.zeros(len(traces)) for _ in names]
        for run in traces.runs:
            rows = run.rows
            before = {name: channel[rows] for name, channel in zip(names, true, strict=True)}
            after: Mapping[str, FloatArray] = before
            for effect in sensors:
                after = effect.measure(after, traces.time[rows])
            for channel, name in zip(lost, names, strict=True):
                channel[rows] = before[name] - after[name]
        true = [
            channel + smooth(traces.runs, gap, _SENSOR_CUTOFF_HZ) if gap.any() else channel
            for channel, gap in zip(shown, lost, strict=True)
        ]
    return traces.with_channels(*true)


# --- extra states ----------------------------------------------------------------------


def integrate_states(traces: Traces, model: Model) -> dict[str, FloatArray]:
    """Extra states along the measured traces, (n,) by name.

    The tests are cut into pieces that are integrated side by side by Heun's method; each
    begins with a run-up, at a test's own start or from the states at rest, so that its states
    have forgotten their start. Where only the torque balance is concerned, held tests are
    left out.
    """
    found = {name: np.zeros(len(traces)) for name in model.state_names}
    owners = [e for e in model.effects if e.states]
    needs_flow = any(channel != EFFORT for e in owners for channel in channels_of(e))
    run_up = _RUN_UP_S if needs_flow else _MECHANICAL_RUN_UP_S
    point = point_of(traces, model)
    flows = {side: measured_flow(side, traces, point, model) for side in SIDES}
    runs = [run for run in traces.runs if run.moves or needs_flow]
    for period in sorted({run.period for run in runs}):
        rows = [run.rows for run in runs if run.period == period]
        _integrate(point, flows, model, _pieces(rows, period, run_up), found)
    return found


def measured_flow(side: str, traces: Traces, point: Point, model: Model) -> FloatArray:
    """Mass flow into a chamber that follows from its measured pressure, kg/s (n,).

    Unlike the valve's law it does not jump with noise near a boundary.
    """
    p = point.parameters
    flow = base.flow_from_pressure_rate(
        traces.rate_a if side == "a" else traces.rate_b,
        point.pressure(side),
        plant.chamber_volume(side, plant.displacement(point, model), p),
        plant.volume_rate(side, point, model),
        p.heat_capacity_ratio,
        p.gas_constant,
        p.temperature,
    )
    return np.asarray(flow)


@dataclass(frozen=True)
class _Pieces:
    """Pieces of tests in parallel: (pieces,) rows at which each begins to count and ends.

    `low` is where its run-up begins, `last` its test's last row; `steps` from there on.
    """

    first: IntArray
    low: IntArray
    last: IntArray
    count: int
    steps: int
    period: float


def _pieces(runs: Sequence[slice], period: float, run_up_s: float) -> _Pieces:
    count, run_up = round(_PIECE_S / period), round(run_up_s / period)
    found = [
        (first, max(rows.start, first - run_up), rows.stop - 1)
        for rows in runs
        for first in range(rows.start, rows.stop, count)
    ]
    first, low, last = np.array(found, dtype=np.intp).reshape(-1, 3).T
    return _Pieces(first, low, last, count, run_up + count, period)


def _integrate(
    whole: Point,
    flows: Mapping[str, FloatArray],
    model: Model,
    pieces: _Pieces,
    found: dict[str, FloatArray],
) -> None:
    """Heun's method through all pieces at once; writes the states of the rows that count."""
    names = model.state_names
    parts = max(1, int(np.ceil(pieces.period / _STATE_STEP_S * (1 - 1e-6))))
    step = pieces.period / parts
    rows = np.minimum(pieces.low + np.arange(pieces.steps + 1)[:, None], pieces.last)
    take = _taker(whole, rows)
    here = take(0)
    initial = plant.initial_states(here, model)
    state = {n: np.zeros(len(pieces.low)) + initial[n] for n in names}

    own = {side: flow[rows] for side, flow in flows.items()}

    def rates(at: Point, k: int) -> dict[str, FloatArray]:
        return plant.state_rates(at, {side: flow[k] for side, flow in own.items()}, model)

    history = {n: np.empty((pieces.steps, len(pieces.low))) for n in names}
    for k in range(pieces.steps):
        after = take(k + 1)
        for n in names:
            history[n][k] = state[n]
        for _ in range(parts):
            slope = rates(replace(here, extra=state), k)
            trial = {n: state[n] + step * slope[n] for n in names}
            slope_after = rates(replace(after, extra=trial), k + 1)
            state = {n: state[n] + 0.5 * step * (slope[n] + slope_after[n]) for n in names}
        here = after
    place = pieces.low + np.arange(pieces.steps)[:, None]
    counts = (place >= pieces.first) & (place < pieces.first + pieces.count)
    counts &= place <= pieces.last
    for n in names:
        found[n][place[counts]] = history[n][counts]


def _taker(point: Point, rows: IntArray) -> Callable[[int], Point]:
    """A function from a step to the point at that row of `rows` (steps, pieces)."""
    count = len(np.asarray(point.time))

    def gathered(value: object) -> object:
        array = np.asarray(value)
        return array[rows] if array.shape == (count,) else value

    def at(value: object, step: int) -> object:
        return value[step] if isinstance(value, np.ndarray) and value.ndim == 2 else value

    parameters = {n: gathered(v) for n, v in vars(point.parameters).items()}
    fields = {n: gathered(getattr(point, n)) for n in _POINT_FIELDS}
    varying = [n for n, v in parameters.items() if isinstance(v, np.ndarray) and v.ndim == 2]

    def take(step: int) -> Point:
        changes = {n: at(parameters[n], step) for n in varying}
        own = point.parameters.replace(**changes)
        return Point(parameters=own, **{n: at(v, step) for n, v in fields.items()})  # type: ignore[arg-type]

    return take


_POINT_FIELDS = (
    "time",
    "position",
    "velocity",
    "pressure_a",
    "pressure_b",
    "motor",
    "open_a",
    "open_b",
    "direction",
)
