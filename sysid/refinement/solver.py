"""Levenberg and Marquardt's method over the reduced unknowns, by optimistix.

The simulation is not traced: when optimistix's next step needs the residual, it is evaluated with
its derivatives and passed as an affine function, which is all that a Gauss-Newton method uses.
Start states are eliminated (`reduction`), each with separate damping. A run that switches between
a moving and a resting shaft from step to step must not block the others: it is set aside until the
model follows it again; meanwhile only its start is adjusted.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sysid.errors import OutOfBudgetError
from sysid.parallel import spend
from sysid.refinement.problem import Iterate, Linearised, Problem
from sysid.refinement.reduction import ReducedEquations, reduced
from sysid.types import BoolArray, FloatArray

# The number of directions is a whole multiple of this.
_SIZES = 8
_MOST_REFUSED = 6
_MOST_CHORDS = 3
# Steps in all, over evaluations: where the simulation switches between rest and motion at every
# step, runs would be set aside and followed again without end.
_MOST_STEPS = 1.5
# At most this share of the runs may be set aside.
_MOST_ASIDE = 0.25
# The descent ends after this many steps that together lower the cost by less than this share.
_STILL, _LEAST_LOWERING = 4, 3e-5
# Steps of less than this, in standard errors, are negligible against the interval.
_NEAR_ENOUGH = 0.25
# A run is followed again where its cost per row is at most this many times the counted ones'.
_FOLLOWED = 2.0
# Damping of a start after its first refusal, its growth and its bounds.
_FIRST, _GROWTH, _LARGEST = 1e-3, 10.0, 1e6
_LOSS = 0.5


@dataclass(frozen=True)
class Solution:
    """Where the solver ended: the equations there, and the runs that count (runs,).

    `evaluations` of all runs with their derivatives; `converged` false where they ran out or no
    step helped; `cut_short`: the budget ended first.
    """

    at: ReducedEquations
    evaluations: int
    converged: bool
    counted: BoolArray
    cut_short: bool = False

    @property
    def point(self) -> Iterate:
        return self.at.point


class _Trial(NamedTuple):
    """A step `y` that optimistix proposes along `directions` (m, k), columns of reduced unknowns,
    and what it needs for the answer.
    """

    directions: FloatArray
    y: Any
    state: Any

    @property
    def step(self) -> FloatArray:
        """The step of the reduced unknowns (m,)."""
        return np.asarray(self.directions @ np.asarray(self.y))


def _affine(y: Any, at: tuple[Any, Any, Any]) -> tuple[Any, None]:
    """The residual as linearised at the point where it was evaluated."""
    point, residual, jacobian = at
    return residual + jacobian @ (y - point), None


@functools.lru_cache(maxsize=4)
def _optimistix(size: int) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Proposal and answer, compiled for `size` directions."""
    import equinox
    import lineax
    import optimistix

    from sysid.plant.jax_setup import jax, jnp

    solver: Any = optimistix.LevenbergMarquardt(rtol=1e-6, atol=1e-6, linear_solver=lineax.QR())
    shape: Any = jax.eval_shape(lambda: jnp.zeros(size + 1))

    def propose(at: Any, step_size: Any) -> Any:
        y = at[0]
        state = solver.init(_affine, y, at, {}, shape, None, frozenset())
        state = equinox.tree_at(lambda s: s.search_state.step_size, state, step_size)
        _, state, _ = solver.step(_affine, y, at, {}, state, frozenset())
        return state

    def answer(at: Any, there: Any, state: Any, y_eval: Any) -> Any:
        state = equinox.tree_at(lambda s: s.y_eval, state, y_eval)
        _, after, _ = solver.step(_affine, at[0], there, {}, state, frozenset())
        return after.num_accepted_steps > state.num_accepted_steps, after.search_state.step_size

    return equinox.filter_jit(propose), equinox.filter_jit(answer)


def _at(base: ReducedEquations, y: Any, directions: FloatArray) -> tuple[Any, Any, Any]:
    """The equations along these directions; of those that are 0, without slopes."""
    from sysid.plant.jax_setup import jax

    rows = (0, directions.shape[1] - len(directions))
    residual, slopes = np.pad(base.r, rows), np.pad(base.jacobian @ directions, (rows, (0, 0)))
    return y, jax.device_put(residual), jax.device_put(slopes)


def _none(directions: FloatArray) -> Any:
    """No step along these directions. Nothing is compiled to make it, as `jnp.zeros` would be."""
    from sysid.plant.jax_setup import jax

    return jax.device_put(np.zeros(directions.shape[1]))


def _directions(problem: Problem, base: ReducedEquations) -> FloatArray:
    """Directions along which a step is damped, (m, k), each column scaled by one over its slope,
    and further ones that are 0: few sizes k are ever compiled.

    Damping means the same to each unknown then (Marquardt 1963). Friction's mean and each test's
    about it, of which the tests know the sum, would hardly move under any, so their difference is
    a separate direction.
    """
    found = np.eye(base.jacobian.shape[1])
    stopped, unseen = base.stopped(problem), problem.unseen_friction(base.point)
    if unseen is not None and not (stopped & (unseen != 0.0)).any():
        found[:, int(np.argmax(unseen != 0.0))] = unseen
    found /= np.maximum(np.linalg.norm(base.jacobian @ found, axis=0), 1e-12)
    found[:, stopped] = 0.0
    return np.pad(found, ((0, 0), (0, -len(found) % _SIZES)))


def _propose(problem: Problem, base: ReducedEquations, step_size: float) -> _Trial:
    from sysid.plant.jax_setup import jax, on_processor

    directions = _directions(problem, base)
    propose, _ = _optimistix(directions.shape[1])
    with on_processor():
        state = propose(_at(base, _none(directions), directions), jax.device_put(step_size))
    return _Trial(directions, state.y_eval, state)


def _answer(
    base: ReducedEquations, trial: ReducedEquations, given: _Trial, step_size: float
) -> tuple[bool, float]:
    """Whether the trial is accepted, and the next step's size.

    `base` may count fewer runs than that which the step was proposed from.
    """
    from sysid.plant.jax_setup import jax, on_processor

    propose, answer = _optimistix(given.directions.shape[1])
    with on_processor():
        at = _at(base, _none(given.directions), given.directions)
        state = propose(at, jax.device_put(step_size))
        accepted, size = answer(at, _at(trial, given.y, given.directions), state, given.y)
    return bool(accepted), float(size)


def solve(
    problem: Problem,
    point: Iterate,
    most: int,
    near: float,
    *,
    least: int = 1,
    first_step: float = 1.0,
    chords: bool = False,
    roughly: bool = False,
    partly: bool = False,
    known: Sequence[Linearised] | None = None,
) -> Solution:
    """Minimise a problem's cost from a point, with `least` to `most` evaluations.

    It ends where the linearised equations would move every shared unknown by less than `near`
    standard errors, and has converged where by less than a quarter. `first_step`: optimistix' first
    step size, one over the damping. `known`: the runs' errors at the point, where they are known.

    With `chords`, for a start near the solution, up to three steps are taken with the same slopes
    (the chord method: Ortega, Rheinboldt 1970, 7.1), which only a simulation is needed for; the end
    is decided with the slopes there, or `roughly` with these. Raises OutOfBudgetError;
    `partly` only before the first evaluation, later the descent stops at its current point.
    """
    count = len(problem.runs)
    counted, damping = np.ones(count, dtype=bool), np.zeros(count)
    first = problem.equations([k.errors for k in known], point) if known else None
    base = reduced(problem, point, first or problem.linearised(point), damping, counted)
    step_size, refused, evaluations, chord = first_step, 0, int(not known), 0
    steps = 0
    changes, costs = np.zeros(count, dtype=int), [base.cost]
    cut_short = False
    try:
        while evaluations < most and refused < _MOST_REFUSED and steps < _MOST_STEPS * most:
            spend(0)
            ended = (known or evaluations >= least) and (
                _is_near(problem, base, near) or _stagnates(costs)
            )
            if ended and (roughly or not chord):
                break
            if chord and (ended or refused or chord == _MOST_CHORDS):
                base, chord = _with_own_slopes(problem, base, damping, counted), 0
                evaluations += 1
                continue
            steps += 1
            given = _propose(problem, base, step_size)
            to = base.moved(problem, given.step, counted)
            runs = problem.linearised(to, base.runs if chords else None)
            evaluations += not chords
            damping = _next_damping(damping, problem, base, to, runs)
            aside = _to_set_aside(problem, base, to, runs, counted)
            fewer = counted & ~aside
            trial = reduced(problem, to, runs, damping, fewer)
            comparable = reduced(problem, base.point, base.runs, damping, fewer)
            accepted, step_size = _answer(comparable, trial, given, step_size)
            refused = 0 if accepted else refused + 1
            if accepted:
                # A run that was set aside this often stays so.
                back = _followed(problem, trial, fewer) & (changes < 2)
                costs = [] if (aside | back).any() else [*costs, trial.cost]
                changes += aside
                base, counted, chord = trial, fewer | back, chord + chords
            base = reduced(problem, base.point, base.runs, damping, counted)
    except OutOfBudgetError:
        if not partly:
            raise
        cut_short = True
    if chord and not (roughly or cut_short):
        base = _with_own_slopes(problem, base, damping, counted)
        evaluations += 1
    converged = _is_near(problem, base, max(near, _NEAR_ENOUGH))
    return Solution(base, evaluations, converged, counted, cut_short)


def _with_own_slopes(
    problem: Problem, base: ReducedEquations, damping: FloatArray, counted: BoolArray
) -> ReducedEquations:
    """The equations at the same point with the slopes there."""
    return reduced(problem, base.point, problem.linearised(base.point), damping, counted)


def _is_near(problem: Problem, base: ReducedEquations, near: float) -> bool:
    return float(np.max(base.shared_step(problem), initial=0.0)) < near


def _stagnates(costs: Sequence[float]) -> bool:
    """Whether the last accepted steps lowered the cost only negligibly."""
    return len(costs) > _STILL and costs[-1] > costs[-1 - _STILL] * (1.0 - _LEAST_LOWERING)


def _next_damping(
    damping: FloatArray,
    problem: Problem,
    base: ReducedEquations,
    to: Iterate,
    runs: Sequence[Linearised],
) -> FloatArray:
    """Damping of the starts (runs,): more where a run's cost differs from its linear prediction."""
    before = np.array([run.cost for run in base.runs])
    after, predicted = np.array([run.cost for run in runs]), base.predicted(problem, to)
    lost = after - predicted > _LOSS * np.abs(before - predicted) + 1.0
    more = np.clip(damping * _GROWTH, _FIRST, _LARGEST)
    return np.where(lost, more, np.where(damping > _FIRST, damping / _GROWTH, 0.0))


def _to_set_aside(
    problem: Problem,
    base: ReducedEquations,
    to: Iterate,
    runs: Sequence[Linearised],
    counted: BoolArray,
) -> BoolArray:
    """The fewest runs (runs,) without which the trial's cost is lower, if they are few."""
    pairs = zip(runs, base.runs, strict=True)
    rise = np.where(counted, [after.cost - before.cost for after, before in pairs], 0.0)
    excess = float(rise.sum()) + problem.prior_cost(to) - problem.prior_cost(base.point)
    found = np.zeros(len(rise), dtype=bool)
    room = _MOST_ASIDE * len(rise) - np.count_nonzero(~counted)
    for i in np.argsort(-rise):
        if excess < 0.0:
            return found
        if rise[i] <= 0.0 or np.count_nonzero(found) + 1 > room:
            break
        found[i] = True
        excess -= rise[i]
    return np.zeros(len(rise), dtype=bool)


def _followed(problem: Problem, base: ReducedEquations, counted: BoolArray) -> BoolArray:
    """Runs set aside that the model follows as it does the others."""
    per_row = np.array(
        [run.cost / len(own.inputs.time) for run, own in zip(base.runs, problem.runs, strict=True)]
    )
    limit = _FOLLOWED * float(np.median(per_row[counted]))
    return ~counted & (per_row <= limit)


__all__ = ["Solution", "solve"]
