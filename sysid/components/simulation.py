"""The right-hand side of a dynamic component, compiled: many tests, and many laws, in one loop.

Steps of Rodas3 from row to row: of order 3 and L-stable, as smoothed friction and air in a small
volume are stiff. The model holds every term, those that a law lacks at strength 0, so that one
compilation serves fit, screening and diagnosis; derivatives are those of the same loop, forwards.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid import signals
from sysid.components.definition import DynamicComponent, LogColumn
from sysid.io.logs import Trial
from sysid.plant.steps import rodas3
from sysid.types import FloatArray

# Laws and directions that one call takes: the rest of a smaller batch is padding.
_LAWS, _DIRECTIONS = 8, 4
# Rows on each side of a start through which it may be smoothed, and how far, in times the noise,
# the rows may lie off the parabola.
_HALF_WINDOWS = (3, 6, 10, 15)
_NOISE_TIMES = 1.5


@dataclass(frozen=True)
class Runs:
    """Tests, or stretches of them, to simulate from their own starts.

    `time` (runs, n) s and `inputs` (runs, n, inputs), the last row repeated where a run is shorter;
    `first` and `rates` (runs, columns): the columns at the start, and their time derivatives;
    `lengths` (runs,) in rows.
    """

    time: FloatArray
    inputs: FloatArray
    first: FloatArray
    rates: FloatArray
    lengths: tuple[int, ...]

    @property
    def arrays(self) -> tuple[FloatArray, ...]:
        """What the compiled loop takes."""
        return self.time, self.inputs, self.first, self.rates


def simulated(made: DynamicComponent, laws: FloatArray, runs: Runs) -> FloatArray:
    """The outputs (laws, runs, n, outputs) of laws (laws, numbers)."""
    many = _compiled(_identity(made)).many
    zero = np.zeros((len(runs.lengths), len(made.states)))
    found = []
    for k in range(0, len(laws), _LAWS):
        batch = laws[k : k + _LAWS]
        size = 1 if len(batch) == 1 else _LAWS
        padded = np.concatenate([batch, np.repeat(batch[-1:], size - len(batch), axis=0)])
        found.append(np.asarray(many(padded, zero, *runs.arrays))[: len(batch)])
    return np.concatenate(found)


def with_starts(
    made: DynamicComponent, law: FloatArray, starts: FloatArray, runs: Runs
) -> FloatArray:
    """The outputs (runs, n, outputs) from starts that lie `starts` (runs, states) off their own."""
    found = _compiled(_identity(made)).many(law[None], starts, *runs.arrays)
    outputs: FloatArray = np.asarray(found)[0]
    return outputs


def slopes(
    made: DynamicComponent, law: FloatArray, starts: FloatArray, runs: Runs, directions: FloatArray
) -> FloatArray:
    """Derivatives (k, runs, n, outputs) along directions (k, numbers + states).

    A direction in the states moves the start of every run, and each run's output with it.
    """
    along = _compiled(_identity(made)).along
    found = []
    for k in range(0, len(directions), _DIRECTIONS):
        batch = directions[k : k + _DIRECTIONS]
        padded = np.zeros((_DIRECTIONS, directions.shape[1]))
        padded[: len(batch)] = batch
        found.append(np.asarray(along(law, starts, padded, *runs.arrays))[: len(batch)])
    return np.concatenate(found)


@dataclass(frozen=True)
class _Identity:
    """The key of a compiled model: the class, and what it and the object declare."""

    kind: type
    own: str
    made: DynamicComponent

    def __hash__(self) -> int:
        return hash((self.kind, self.own))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Identity) and (self.kind, self.own) == (other.kind, other.own)


def _identity(made: DynamicComponent) -> _Identity:
    declared: dict[str, Any] = {}
    for base in reversed(type(made).__mro__):
        declared |= {k: v for k, v in vars(base).items() if k[0] != "_" and not callable(v)}
    declared |= vars(made)
    own = sorted((name, _text(value)) for name, value in declared.items())
    return _Identity(type(made), repr(own), made)


def _text(value: Any) -> str:
    """A value in full: an array's own text omits its middle."""
    if hasattr(value, "__array__"):
        array = np.asarray(value)
        return f"{array.shape} {array.dtype} {array.tobytes().hex()}"
    return repr(value)


@dataclass(frozen=True)
class _Compiled:
    """`many` simulates several laws, `along` gives the derivatives of one."""

    many: Callable[..., Any]
    along: Callable[..., Any]


@functools.lru_cache(maxsize=16)
def _compiled(identity: _Identity) -> _Compiled:
    from sysid.plant.jax_setup import jax, jnp, on_processor

    made = identity.made
    one = functools.partial(_one_run, made)
    each = jax.vmap(one, (None, 0, 0, 0, 0, 0))

    def along(law: Any, starts: Any, directions: Any, *arrays: Any) -> Any:
        def moved(direction: Any) -> Any:
            numbers, states = direction[: law.shape[0]], direction[law.shape[0] :]
            tangent = (numbers, jnp.broadcast_to(states, starts.shape))
            return jax.jvp(lambda a, b: each(a, b, *arrays), (law, starts), tangent)[1]

        return jax.vmap(moved)(directions)

    many = jax.vmap(each, (0, None, None, None, None, None))
    there = on_processor()
    return _Compiled(there(jax.jit(many)), there(jax.jit(along)))


def _one_run(
    made: DynamicComponent, law: Any, off: Any, time: Any, inputs: Any, first: Any, rates: Any
) -> Any:
    """The outputs (n, outputs) of one run of a law (numbers,)."""
    from sysid.plant.jax_setup import jax, jnp

    own, added = _split(made, law)
    columns = dict(zip(made.columns, first, strict=True)) | {"time_s": time[0]}
    begun = made.start(columns, dict(zip(made.columns, rates, strict=True)), own)
    state = jnp.stack([jnp.asarray(begun[n], float) for n in made.states]) + off
    lines = jnp.array([made.columns[n].between == "line" for n in made.inputs], dtype=bool)

    def rate(x: Any, given: dict[str, Any]) -> Any:
        named = dict(zip(made.states, x, strict=True))
        found = made.derivative(named, given, own)
        for term, numbers in added:
            more = term.adds(named, given, {**own, **numbers})
            found = {n: v + more.get(n, 0.0) for n, v in found.items()}
        return jnp.stack([jnp.asarray(found[n], float) for n in made.states])

    def step(x: Any, row: Any) -> tuple[Any, Any]:
        t0, t1, u0, u1 = row

        def part(y: Any, share: Any) -> tuple[Any, None]:
            # Inputs that change within a step are taken at its middle.
            mixed = jnp.where(lines, u0 + share * (u1 - u0), u0)
            given = dict(zip(made.inputs, mixed, strict=True)) | {"time_s": t0 + share * (t1 - t0)}
            return y + rodas3(lambda z: rate(z, given), y, (t1 - t0) / made.substeps), None

        middles = (jnp.arange(made.substeps) + 0.5) / made.substeps
        x, _ = jax.lax.scan(part, x, middles)
        return x, x

    rows = (time[:-1], time[1:], inputs[:-1], inputs[1:])
    _, later = jax.lax.scan(step, state, rows)
    path = jnp.concatenate([state[None], later])

    def shown(x: Any, u: Any, t: Any) -> Any:
        given = dict(zip(made.inputs, u, strict=True)) | {"time_s": t}
        found = made.measure(dict(zip(made.states, x, strict=True)), given, own)
        return jnp.stack([jnp.asarray(found[n], float) for n in made.outputs])

    return jax.vmap(shown)(path, inputs, time)


def _split(
    made: DynamicComponent, law: Any
) -> tuple[dict[str, Any], list[tuple[Any, dict[str, Any]]]]:
    """The parameters by name, and every term with its quantities by name."""
    own = {p.name: law[i] for i, p in enumerate(made.parameters)}
    place, added = len(own), []
    for term in made.terms:
        numbers = {q.name: law[place + i] for i, q in enumerate(term.quantities)}
        place += len(numbers)
        added.append((term, numbers))
    return own, added


def runs_of(made: DynamicComponent, pieces: Sequence[tuple[Trial, int, int]]) -> Runs:
    """Runs from (trial, start row, stop row); the start is a parabola through the rows about it.

    Through as many as it follows to within the noise: a window across a kink would shift it.
    """
    lengths = tuple(stop - start for _, start, stop in pieces)
    n = max(lengths)
    time = np.empty((len(pieces), n))
    inputs = np.empty((len(pieces), n, len(made.inputs)))
    first, rates = np.empty((2, len(pieces), len(made.columns)))
    noise = {id(t): _noise_of(t, made) for t, _, _ in pieces}
    for k, (trial, start, stop) in enumerate(pieces):
        rows = np.minimum(np.arange(start, start + n), stop - 1)
        time[k] = trial.since_start[rows]
        for i, name in enumerate(made.inputs):
            inputs[k, :, i] = trial[name][rows]
        for i, (name, column) in enumerate(made.columns.items()):
            first[k, i], rates[k, i] = _at(trial, name, start, column, noise[id(trial)][name])
    return Runs(time, inputs, first, rates, lengths)


def _noise_of(trial: Trial, made: DynamicComponent) -> dict[str, float]:
    """The noise of each column, in its unit; 0 in a test too short to show it."""
    if len(trial) < signals.FEWEST_FOR_NOISE:
        return dict.fromkeys(made.columns, 0.0)
    return {n: signals.noise_floor(trial[n], stride=trial.stride_of(n)).total for n in made.columns}


def _at(trial: Trial, name: str, row: int, column: LogColumn, noise: float) -> tuple[float, float]:
    """A column and its time derivative at a row; a command as it is, without one."""
    here = float(trial[name][row])
    if column.role == "input" and column.between == "held":
        return here, 0.0
    found, is_first = (here, 0.0), True
    for half in _HALF_WINDOWS:
        near = slice(max(0, row - half), row + half + 1)
        t = trial.time[near] - trial.time[row]
        if len(t) < 4:
            continue
        scale = float(np.max(np.abs(t)))
        curve = np.polynomial.polynomial.polyfit(t / scale, trial[name][near], 2)
        gaps = trial[name][near] - np.polynomial.polynomial.polyval(t / scale, curve)
        # The first counts whatever it leaves.
        if not is_first and float(np.sqrt(np.mean(gaps**2))) > _NOISE_TIMES * noise:
            break
        found, is_first = (float(curve[0]), float(curve[1] / scale)), False
    return found


__all__ = ["Runs", "runs_of", "simulated", "slopes", "with_starts"]
