"""One effect after another: screen, refit the suspects, add the best, repeat."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy.stats import chi2

from sysid.diagnosis.actuator.equation_error import channels_of
from sysid.diagnosis.actuator.null_distribution import Null
from sysid.diagnosis.actuator.refit import (
    THRESHOLD_STEP,
    Refit,
    is_threshold,
    refit,
    standard_errors,
    with_base_refitted,
)
from sysid.diagnosis.actuator.screening import (
    Explained,
    Projected,
    best_by_effect,
    projected,
    screen,
    starting_points,
)
from sysid.diagnosis.actuator.signatures import Candidate
from sysid.diagnosis.actuator.whitening import Frame
from sysid.errors import SimulationError
from sysid.estimation.linear import Estimate
from sysid.model.effects.catalogue import class_of
from sysid.model.effects.entry import CatalogueEffect
from sysid.model.ports import Model
from sysid.parallel import run_in_threads
from sysid.types import FloatArray

SIGNIFICANCE = 1e-3
MOST_EFFECTS = 3
MOST_SUSPECTS = 5
# A suspect whose signature explains less than this share of the best one's is not refitted.
WORTH_REFITTING = 0.15
# The twins are screened for this many effects at most, those that gain most.
_CALIBRATED = 14
CLEAR_RATIO = 2.5
# A strength that the tests agree on differs from 0 by this many squared standard errors; of a
# threshold that is the squared z of a sign test (`Refit.wald`).
_CLEAR_WALD = 16.0
# One that explains nearly all of the remainder may show in few tests: a drift in the longest.
_MAIN_SHARE = 0.75
_MAIN_WALD = 4.0
# Share of the remainder beyond noise that an effect must explain to be added.
LEAST_SHARE = 0.35
# A remainder that is small against the effects so far is a misfit of their form, unless a new
# effect explains all of it and it is not smaller still.
_LEAST_PART = 0.05
_WHOLE_SHARE = 0.8
_LEAST_WHOLE = 0.004
# An effect whose size changes by this factor when the next is added was not what it seemed.
_MOST_CHANGE = 2.5
# By how much the logarithm of the simulation error may rise with a further effect.
_TOLERATED_RISE = 0.01
# A rival that explains almost as much as the winner is indistinguishable from it: the real form
# of an effect is seldom the catalogue's, which costs the right one as much.
_RIVAL_SHARE = 0.9
_CLEAR_BIC = 10.0


@dataclass(frozen=True)
class Suspect:
    """An effect that was screened: its gain, also over the twins' largest, and p-value."""

    id: str
    gain: float
    ratio: float
    p_value: float
    refitted: float | None = None


@dataclass(frozen=True)
class Step:
    """One effect that was added: its numbers, its gain, and what else was tried.

    `model` holds it, all before it, and the base parameters refitted with them. `share`: how
    much it explained of the excess over noise in the balances that it reaches. `ambiguous`:
    ids that explain as much. `suspects` in descending order.
    """

    refit: Refit
    model: Model
    p_value: float
    share: float
    ambiguous: tuple[str, ...]
    suspects: tuple[Suspect, ...]


@dataclass(frozen=True)
class Search:
    """The steps, the resulting model, and its residual next to the base model's.

    `joint` holds all effects fitted together, None where there are none; `base_std` the
    standard errors of the base parameters with them, in the parameters' units; `suspects`
    are those of the last round.
    """

    steps: tuple[Step, ...]
    model: Model
    first: Projected
    last: Projected
    joint: Refit | None
    base_std: Mapping[str, float]
    suspects: tuple[Suspect, ...]

    @property
    def base_dof(self) -> int:
        """Degrees of freedom of `base_std`: rows less base parameters and effects' numbers."""
        rows, columns = self.last.basis.shape
        return int(rows - columns)

    def estimates(self, place: int) -> dict[str, Estimate]:
        """An effect's numbers by name, with intervals from leaving out one test at a time."""
        assert self.joint is not None
        fit = self.joint.fit
        effect = self.joint.effects[place]
        covariance = fit.jackknife_covariance(self.first.frame.tests)
        return {
            q.name: fit.estimate(f"{effect.id}/{q.name}", covariance)
            for q in type(effect).quantities
        }


def search(
    frame: Frame,
    model: Model,
    candidates: Sequence[Candidate],
    null: Null,
    progress: Callable[[str], None],
    simulation_error: Callable[[Model], float],
) -> Search:
    """Add effects while one passes the twins' test and explains a fair share of the excess.

    A further effect must not raise `simulation_error`, the logarithm of a model's error on the
    fitted motion logs: one that only absorbs the misfit of the first may raise it.
    """
    first = base = projected(frame, model)
    before = null.excess(first)
    steps: list[Step] = []
    while True:
        taken = {step.refit.id for step in steps}
        open_ones = [c for c in candidates if c.id not in taken and _composes(base.model, c)]
        screened = screen(base, open_ones)
        best, starts = best_by_effect(screened), starting_points(screened)
        suspects = _suspects(best, null)
        passing = [
            starts[s.id]
            for s in suspects
            if s.p_value < SIGNIFICANCE
            and s.ratio > CLEAR_RATIO
            and s.gain > WORTH_REFITTING * suspects[0].gain
        ]
        if not passing or len(steps) == MOST_EFFECTS:
            return _finished(first, base, steps, suspects)
        excess = null.excess(base)
        refits = [
            r
            for r in _refit(base, passing[:MOST_SUSPECTS])
            if r.gain > 0.0
            and r.wald(frame.tests) > (_CLEAR_WALD if steps else _least_wald(r, excess))
        ]
        if not refits:
            return _finished(first, base, steps, suspects)
        winner = max(refits, key=lambda r: r.gain - _penalty(r, base))
        progress(f"{winner.id}: tried {', '.join(r.id for r in refits)}")
        share = _share(winner, excess)
        least = _LEAST_PART if share < _WHOLE_SHARE else _LEAST_WHOLE
        # Where the effects so far do not act, nothing can be a misfit of their form.
        gone = sum(max(before[c] - excess[c], 0.0) for c in channels_of(winner.effect))
        small = winner.gain < least * gone
        if share < LEAST_SHARE or small or not _leaves_alone(first, steps, winner):
            return _finished(first, base, steps, suspects)
        extended = with_base_refitted(first, base.model + winner.effect)
        if steps and not _simulates(simulation_error, base.model, extended):
            return _finished(first, base, steps, suspects)
        step = Step(
            refit=winner,
            model=extended,
            p_value=null.p_value(winner.id, winner.gain, len(type(winner.effect).strengths())),
            share=share,
            ambiguous=_ambiguous(winner, refits, base),
            suspects=tuple(
                replace(s, refitted=next((r.gain for r in refits if r.id == s.id), None))
                for s in suspects
            ),
        )
        steps.append(step)
        base = projected(frame, extended, extra=own_columns(frame, extended))


def _finished(
    first: Projected, last: Projected, steps: Sequence[Step], suspects: Sequence[Suspect]
) -> Search:
    """All effects fitted once more, together, from the base model on."""
    if not steps:
        return Search((), first.model, first, last, None, {}, tuple(suspects))
    alone = steps[0].refit
    joint = refit(first, [s.refit.effect for s in steps]) if len(steps) > 1 else alone
    extended = Model(first.model.parameters, (*first.model.effects, *joint.effects))
    model = with_base_refitted(first, extended)
    own = own_columns(first.frame, model)
    last = projected(first.frame, model, extra=own)
    base_std = standard_errors(last, own)
    steps = [*steps[:-1], replace(steps[-1], model=model)]
    return Search(tuple(steps), model, first, last, joint, base_std, tuple(suspects))


def _leaves_alone(first: Projected, steps: Sequence[Step], winner: Refit) -> bool:
    """Whether the effects so far keep their size when another one is added.

    Two effects that grow against each other are not real: together they imitate a curve.
    """
    if not steps:
        return True
    before = [step.refit.effect for step in steps]
    joint = refit(first, [*before, winner.effect])
    for old, new in zip(before, joint.effects, strict=False):
        names = [q.name for q in type(old).quantities if q.is_strength]
        was = np.array([getattr(old, n) for n in names])
        now = np.array([getattr(new, n) for n in names])
        size = float(was @ was)
        kept = float(was @ now) / size if size > 0.0 else 0.0
        if not 1.0 / _MOST_CHANGE < kept < _MOST_CHANGE:
            return False
    return True


def _simulates(simulation_error: Callable[[Model], float], before: Model, after: Model) -> bool:
    """Whether a model simulates the fitted motion logs no worse than without its last effect."""
    try:
        return simulation_error(after) <= simulation_error(before) + _TOLERATED_RISE
    except SimulationError:
        return False


def _composes(model: Model, candidate: Candidate) -> bool:
    return not set(model.state_names).intersection(candidate.neutral().states)


def _suspects(best: dict[str, Explained], null: Null) -> list[Suspect]:
    """Effects whose gain noise alone is unlikely to give, judged by the twins."""
    remarkable = [
        name
        for name, result in best.items()
        if null.family * chi2.sf(result.gain, len(result.coefficients)) < SIGNIFICANCE
    ][:_CALIBRATED]
    gains = {name: best[name].gain for name in remarkable}
    null.calibrate(gains, WORTH_REFITTING * max(gains.values(), default=0.0))
    found = [
        Suspect(
            name,
            best[name].gain,
            null.ratio(name, best[name].gain),
            null.p_value(name, best[name].gain, len(best[name].coefficients)),
        )
        for name in remarkable
    ]
    return sorted(found, key=lambda s: -s.gain)


def _share(found: Refit, excess: Mapping[str, float]) -> float:
    """How much an effect explains of the excess over noise in the balances that it reaches."""
    own = sum(max(excess[channel], 0.0) for channel in channels_of(found.effect))
    return found.gain / max(own, found.gain)


def _least_wald(found: Refit, excess: Mapping[str, float]) -> float:
    """How far from 0 the tests must agree that an effect's strengths are."""
    return _MAIN_WALD if _share(found, excess) > _MAIN_SHARE else _CLEAR_WALD


def _refit(base: Projected, starts: Sequence[Sequence[CatalogueEffect]]) -> list[Refit]:
    """Each effect from its starting points; the best of each."""
    flat = [start for points in starts for start in points]
    found = run_in_threads(partial(refit, base, [start]) for start in flat)
    best: dict[str, Refit] = {}
    for one in found:
        if one.id not in best or one.gain > best[one.id].gain:
            best[one.id] = one
    return list(best.values())


def _penalty(found: Refit, base: Projected) -> float:
    """BIC's penalty for an effect's parameters, in whitened squares."""
    rows = len(base.rest)
    scale = max(float(found.rest @ found.rest) / rows, 1.0)
    count = sum(len(type(effect).quantities) for effect in found.effects)
    return scale * count * math.log(rows)


def _ambiguous(winner: Refit, refits: Sequence[Refit], base: Projected) -> tuple[str, ...]:
    """Members of the winner's class, and rivals that explain as much within the margins."""
    scale = max(float(winner.rest @ winner.rest) / len(base.rest), 1.0)
    near = {i for i in class_of(winner.id) if i != winner.id}
    for rival in refits:
        if rival.id == winner.id:
            continue
        bic = (winner.gain - _penalty(winner, base) - rival.gain + _penalty(rival, base)) / scale
        if bic < _CLEAR_BIC or rival.gain > _RIVAL_SHARE * winner.gain:
            near.add(rival.id)
    return tuple(sorted(near))


def own_columns(frame: Frame, model: Model) -> FloatArray:
    """Change of the residual with every parameter of the model's effects, (rows, k), in order."""
    residual = frame.residual(model)
    columns = []
    for place, effect in enumerate(model.effects):
        assert isinstance(effect, CatalogueEffect)
        for q in type(effect).quantities:
            value = float(getattr(effect, q.name))
            share = THRESHOLD_STEP if is_threshold(q) else 0.01
            move = share * (abs(value) or abs(q.typical) or 1.0)
            move = -move if value + move > q.upper else move
            changed = list(model.effects)
            changed[place] = replace(effect, **{q.name: value + move})  # type: ignore[type-var]
            other = frame.residual(Model(model.parameters, tuple(changed)))
            columns.append((other - residual) / move)
    return np.column_stack(columns)
