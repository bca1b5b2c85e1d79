"""Extra states along measured traces: pieces of all tests at once, in one compiled loop.

The tests are cut into pieces that are integrated side by side by Heun's method; each begins
with a run-up, at a test's own start or from the states at rest, so that its states have
forgotten their start.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from itertools import groupby
from types import SimpleNamespace
from typing import Any

import numpy as np

from sysid.diagnosis.actuator.samples import TestRun, Traces
from sysid.io.channels import SIDES
from sysid.io.rig import Load
from sysid.parallel import in_threads
from sysid.plant import base, plant
from sysid.plant.base import Array
from sysid.plant.ports import Model, Point, Structure, joined_model, overrides, split, with_load
from sysid.plant.steps import heun
from sysid.recording.motion_tests import RUN_UP_S
from sysid.types import BoolArray, FloatArray, IntArray

# As they are on a rig like the reference rig: see `TestRun.time_scale`.
_PIECE_S = 0.25
# A resonance takes longer to forget, and costs less: fewer tests, no flows. At 25 Hz and a damping
# ratio of 0.02 a start at rest is forgotten to 0.2 % (0.35 s: to a third).
_MECHANICAL_PIECE_S, _MECHANICAL_RUN_UP_S = 0.5, 2.0
# Steps of the states, s, on any rig, whose lags may be this short (`entry.state_lag`); and of what
# is faster, by its rate: at 0.2 a contact gives its force to 1 % (0.4: 4 %).
_STATE_STEP_S, _STEP_TIMES_RATE = 1e-3, 0.2
# Rows are padded to whole multiples, and so many pieces integrated at a time: few shapes are ever
# compiled.
_ROWS_A_CALL = 65536
_PIECES_A_CALL = 256
# Compiled programs that are kept: a round of the search asks for ten; each takes some 3 MB.
_MOST_PROGRAMS = 24
_SIGNALS = (
    "time",
    "position",
    "velocity",
    "pressure_a",
    "pressure_b",
    "rate_a",
    "rate_b",
    "motor",
    "open_a",
    "open_b",
    "direction",
    "supply",
    "carried",
)


def point_of(traces: Traces, model: Model) -> Point:
    """Where the model is at every sample."""
    loaded = model.parameters
    if traces.carried.size:
        loaded = with_load(loaded, Load(*traces.carried.T))
    parameters = Model(loaded, model.effects).at(traces.time)
    supply = parameters.supply + (traces.supply - model.parameters.supply)
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


def measured_flow(side: str, traces: Traces, point: Point, model: Model) -> Array:
    """Mass flow into a chamber that follows from its measured pressure, kg/s (n,).

    Unlike the valve's law it does not jump with noise near a boundary. What effects add to the rate
    is no flow.
    """
    p = point.parameters
    rate = traces.rate_a if side == "a" else traces.rate_b
    pressure, moving = point.pressure(side), plant.volume_rate(side, point, model)
    volume = plant.chamber_volume(side, plant.displacement(point, model), p)
    gas = (p.heat_capacity_ratio, p.gas_constant, p.temperature)
    flow = base.flow_from_pressure_rate(rate, pressure, volume, moving, *gas)
    if not any(overrides(effect, "pressure_rate") for effect in model.effects):
        return flow
    added = rate - plant.pressure_rate(side, flow, point, model)
    return flow + base.flow_from_pressure_rate(added, pressure, volume, 0.0 * moving, *gas)


@dataclass(frozen=True)
class StatesModel:
    """A model with extra states, equal to any whose states are the same.

    Of the numbers that a fit moves in turn, as flows and friction, states follow few.
    `follows_valves`: whether they follow the valves' opening, too. `acts_on_rates`: whether the
    pressures' rates follow the states, and not the torque balance alone.
    """

    model: Model = field(compare=False)
    followed: Hashable
    follows_valves: bool
    acts_on_rates: bool

    @classmethod
    def of(cls, model: Model, traces: Traces) -> StatesModel:
        """A model on traces like these."""
        from sysid.plant.jax_setup import jax

        structure, numbers = split((model.parameters, *model.effects))
        leaves, tree = jax.tree.flatten(numbers)
        carried = traces.carried.shape[1:]
        names = model.state_names
        follows, valves = _follows(structure, names, tree, carried)
        own = (float(v) for v, followed in zip(leaves, follows, strict=True) if followed)
        acts_on_rates = _acts_on_rates(structure, names, tree, carried)
        return cls(model, (structure, *own), valves, acts_on_rates)


@lru_cache(maxsize=_MOST_PROGRAMS)
def _follows(
    structure: Structure, names: tuple[str, ...], tree: Any, carried: tuple[int, ...]
) -> tuple[tuple[bool, ...], bool]:
    """Whether the states' start or rates follow each number of `tree`, in jax's order; and whether
    a valve's opening, other than through the flow that a measured pressure shows."""
    from sysid.plant.jax_setup import jax

    def laws(numbers: list[dict[str, Any]], here: dict[str, Any]) -> Any:
        model = joined_model(structure, numbers)
        start = _start(here, model, names)
        return start, _rates_at(here, model, names)(start)

    numbers = jax.tree.unflatten(tree, np.ones(tree.num_leaves))
    of_numbers, of_channels = _followed(laws, numbers, _one_sample(carried))
    valves = any(of_channels[f"open_{side}"] for side in SIDES)
    return tuple(jax.tree.leaves(of_numbers)), valves


@lru_cache(maxsize=_MOST_PROGRAMS)
def _acts_on_rates(
    structure: Structure, names: tuple[str, ...], tree: Any, carried: tuple[int, ...]
) -> bool:
    """Whether a chamber's pressure rate follows a state."""
    from sysid.plant.jax_setup import jax

    def rates(states: dict[str, Any], numbers: list[dict[str, Any]], here: dict[str, Any]) -> Any:
        model = joined_model(structure, numbers)
        point = replace(point_of(_as_traces(here), model), extra=states)
        flows = [plant.shared_flow(side, point.is_open(side), point, model) for side in SIDES]
        return [
            plant.pressure_rate(side, flow, point, model)
            for side, flow in zip(SIDES, flows, strict=True)
        ]

    numbers = jax.tree.unflatten(tree, np.ones(tree.num_leaves))
    states = {name: np.zeros(1) for name in names}
    of_states, *_ = _followed(rates, states, numbers, _one_sample(carried))
    return any(of_states.values())


def _one_sample(carried: tuple[int, ...]) -> dict[str, FloatArray]:
    return {name: np.zeros((1, *carried) if name == "carried" else 1) for name in _SIGNALS}


def _followed(laws: Callable[..., Any], *arguments: Any) -> tuple[Any, ...]:
    """Of each number in the arguments, in their form, whether what `laws` gives follows it."""
    from sysid.plant.jax_setup import jax, on_processor

    with on_processor():
        program = jax.make_jaxpr(laws)(*arguments).jaxpr
    wanted = {id(v) for v in program.outvars}
    for step in reversed(program.eqns):
        if any(id(v) in wanted for v in step.outvars):
            wanted |= {id(v) for v in step.invars}
    inputs = jax.tree.structure(arguments)
    found: tuple[Any, ...] = jax.tree.unflatten(inputs, [id(v) in wanted for v in program.invars])
    return found


def integrate_states(traces: Traces, model: Model, needs_flow: bool) -> dict[str, FloatArray]:
    """Extra states along the measured traces, (n,) by name.

    Without `needs_flow` only the torque balance is concerned, and held tests are left out.
    """
    from sysid.plant.jax_setup import on_processor

    found = {name: np.zeros(len(traces)) for name in model.state_names}
    structure, numbers = split((model.parameters, *model.effects))
    # As numbers of one kind: jax compiles anew for each kind.
    inputs = [{name: np.asarray(v, dtype=float) for name, v in part.items()} for part in numbers]
    with on_processor():
        signals = _signals(traces)
    fastest = max((effect.fastest_rate for effect in model.effects), default=0.0)
    step = min(_STATE_STEP_S, _STEP_TIMES_RATE / fastest) if fastest else _STATE_STEP_S

    def histories(pieces: _Pieces) -> list[FloatArray]:
        return _history_of(pieces, signals, inputs, structure, model.state_names, step)

    blocks = _all_pieces(traces.runs, needs_flow)
    for pieces, own in zip(blocks, in_threads(histories, blocks), strict=True):
        for name, history in zip(model.state_names, own, strict=True):
            found[name][pieces.rows] = history
    return found


def _history_of(
    pieces: _Pieces,
    signals: dict[str, Any],
    inputs: list[dict[str, FloatArray]],
    structure: Structure,
    names: tuple[str, ...],
    step: float,
) -> list[FloatArray]:
    """Each state at the pieces' rows, in steps of `step` s at most."""
    from sysid.plant.jax_setup import on_processor

    parts = max(1, int(np.ceil(pieces.period / step * (1 - 1e-6))))
    with on_processor():
        histories = _compiled()(
            signals,
            (pieces.low, pieces.last),
            pieces.period / parts,
            inputs,
            structure=structure,
            names=names,
            steps=pieces.steps,
            parts=parts,
        )
    return [np.asarray(history)[pieces.counts] for history in histories]


def forget() -> None:
    """Drop what is kept for the traces of a diagnosis; what is compiled serves the next."""
    _padded.cache_clear()
    _all_pieces.cache_clear()


@dataclass(frozen=True)
class _Pieces:
    """Pieces of tests in parallel: (pieces,) rows at which their run-up begins (`low`) and at
    which their test ends (`last`); `steps` from there on.

    `counts` (steps, pieces): which steps count; `rows` the rows that these are.
    """

    low: IntArray
    last: IntArray
    counts: BoolArray
    rows: IntArray
    steps: int
    period: float


@lru_cache(maxsize=4)
def _all_pieces(tests: tuple[TestRun, ...], needs_flow: bool) -> tuple[_Pieces, ...]:
    """The pieces of all tests that are concerned, so many together of one sampling period and time
    scale."""
    runs = [run for run in tests if run.moves or needs_flow]
    mechanical = _MECHANICAL_PIECE_S, _MECHANICAL_RUN_UP_S
    seconds = (_PIECE_S, RUN_UP_S) if needs_flow else mechanical
    return tuple(
        pieces
        for _, alike in groupby(sorted(runs, key=_grid), key=_grid)
        for pieces in _pieces(list(alike), *seconds)
    )


def _grid(run: TestRun) -> tuple[float, float]:
    return run.period, run.time_scale


def _pieces(runs: Sequence[TestRun], piece_s: float, run_up_s: float) -> Iterator[_Pieces]:
    count, run_up = runs[0].count(piece_s), runs[0].count(run_up_s)
    cut = [
        (first, max(rows.start, first - run_up), rows.stop - 1)
        for rows in (run.rows for run in runs)
        for first in range(rows.start, rows.stop, count)
    ]
    # Idle pieces repeat the last one.
    cut += [cut[-1]] * (-len(cut) % _PIECES_A_CALL)
    for begin in range(0, len(cut), _PIECES_A_CALL):
        first, low, last = np.array(cut[begin : begin + _PIECES_A_CALL], dtype=np.intp).T
        place = low + np.arange(run_up + count)[:, None]
        counts = (place >= first) & (place < first + count) & (place <= last)
        yield _Pieces(low, last, counts, place[counts], run_up + count, runs[0].period)


def _signals(traces: Traces) -> dict[str, Any]:
    """The channels that the states may depend on, as the compiled loop takes them."""
    return {name: _padded(_Channel(getattr(traces, name))) for name in _SIGNALS}


class _Channel:
    """A channel (n,), or several (n, k), that is equal only to itself."""

    def __init__(self, values: FloatArray) -> None:
        self.values = values

    def __hash__(self) -> int:
        return id(self.values)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Channel) and self.values is other.values


# Traces of other valve timings share all channels but the openings.
@lru_cache(maxsize=2 * len(_SIGNALS))
def _padded(channel: _Channel) -> Any:
    from sysid.plant.jax_setup import jax

    values = channel.values  # device_put compiles nothing, jnp.asarray does for each shape
    return jax.device_put(
        np.pad(values, [(0, -len(values) % _ROWS_A_CALL), *[(0, 0)] * (values.ndim - 1)])
    )


@cache
def _compiled() -> Any:
    """`_histories`, compiled; jax is loaded with the first effect that has a state."""
    from sysid.plant.programs import Programs
    from sysid.plant.simulator import COMPILER_OPTIONS

    return Programs(_histories, _MOST_PROGRAMS, COMPILER_OPTIONS)


def _histories(
    signals: dict[str, Any],
    bounds: tuple[Any, Any],
    step: Any,
    numbers: list[dict[str, Any]],
    *,
    structure: Structure,
    names: tuple[str, ...],
    steps: int,
    parts: int,
) -> tuple[Any, ...]:
    """Heun's method through all pieces at once, to be traced: each state, (steps, pieces)."""
    from sysid.plant.jax_setup import jax, jnp

    model, (low, last) = joined_model(structure, numbers), bounds

    def sample(k: Any) -> dict[str, Any]:
        rows = jnp.minimum(low + k, last)
        return {name: signal[rows] for name, signal in signals.items()}

    def advance(carry: Any, k: Any) -> tuple[Any, Any]:
        state, here = before, _ = carry
        after = sample(k + 1)
        now = _rates_at(here, model, names)
        for part in range(1, parts + 1):
            then = _rates_at(_between(here, after, part / parts), model, names)
            state, now = heun(state, now(state), then, step), then
        return (state, after), before

    first = sample(0)
    state = tuple(jnp.zeros(low.shape) + value for value in _start(first, model, names))
    return tuple(jax.lax.scan(advance, (state, first), jnp.arange(steps))[1])


def _between(here: dict[str, Any], after: dict[str, Any], share: float) -> dict[str, Any]:
    """The channels a share of the way from one sample to the next."""
    if share == 1.0:
        return after
    found = {name: row + share * (after[name] - row) for name, row in here.items()}
    return found | {"direction": here["direction"]}


def _as_traces(sampled: dict[str, Any]) -> Any:
    """Channels by name as `point_of` and `measured_flow` take traces."""
    return SimpleNamespace(**sampled)


def _start(sampled: dict[str, Any], model: Model, names: tuple[str, ...]) -> list[Any]:
    """The states at rest, where the channels are as sampled."""
    here = _as_traces(sampled)
    start = plant.initial_states(point_of(here, model), model)
    return [start[name] for name in names]


def _rates_at(
    sampled: dict[str, Any], model: Model, names: tuple[str, ...]
) -> Callable[[Any], Sequence[Any]]:
    """The states' rates there, as a function of the states."""
    here = _as_traces(sampled)
    point = point_of(here, model)

    def rates(state: Any) -> Sequence[Any]:
        now = replace(point, extra=dict(zip(names, state, strict=True)))
        flows = {side: measured_flow(side, here, now, model) for side in SIDES}
        found = plant.state_rates(now, flows, model)
        return [found[name] for name in names]

    return rates
