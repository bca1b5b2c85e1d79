"""A set of effects fitted together, each channel by its weight, with its marginal likelihood."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.diagnosis.actuator.bent_waves import bent_waves
from sysid.diagnosis.actuator.between_tests import Support, supports
from sysid.diagnosis.actuator.equation_error import CHANNELS, RATES, channels_of
from sysid.diagnosis.actuator.misfit import ResidualChannel, cost, weights_of
from sysid.diagnosis.actuator.projection import Projected, channel_squares
from sysid.diagnosis.actuator.refit import Refit, has_threshold, refit
from sysid.diagnosis.actuator.threshold_steps import best_jump, best_near
from sysid.estimation.nonlinear import AT_BOUND
from sysid.plant.effects.entry import CatalogueEffect, Quantity
from sysid.plant.ports import Model, overrides
from sysid.types import FloatArray

_PASSES = 2
# Weights that change by less than this factor move no number by much of its error.
_SAME_WEIGHT = 1.3
# Factor within which a shape at which an effect jumps is tried anew where a misfit is left.
_FAR = 2.0


@dataclass(frozen=True)
class FittedSet:
    """Effects with their numbers, fitted together.

    `refit` with the channels as they count; `squares` (channels,) of what is left, as they are;
    `complexity`: minus twice the log of the prior at the numbers, and of the share of it that the
    data leave (Laplace's approximation); `supports`: what speaks for the effects' strengths.
    """

    refit: Refit
    squares: FloatArray
    complexity: float
    supports: tuple[Support, ...]

    @property
    def effects(self) -> tuple[CatalogueEffect, ...]:
        return self.refit.effects

    @property
    def names(self) -> frozenset[str]:
        return frozenset(effect.id for effect in self.effects)

    @property
    def is_whole(self) -> bool:
        """Whether every effect has a strength other than 0."""
        return not any(_is_absent(effect) for effect in self.effects)

    def evidence(self, channels: Sequence[ResidualChannel], none: FloatArray) -> float:
        """Twice the log of the marginal likelihood over that of no effect, which leaves the squares
        `none` (channels,); -inf where one of the effects is absent."""
        return self.gained(channels, none) - self.of_few_tests(channels)

    def gained(self, channels: Sequence[ResidualChannel], none: FloatArray) -> float:
        """The same, were the strengths known as well as noise lets them be."""
        if not self.is_whole:
            return -math.inf
        return float(cost(channels, none) - cost(channels, self.squares)) - self.complexity

    def of_few_tests(self, channels: Sequence[ResidualChannel]) -> float:
        """What of it is beyond what their strengths' scatter between tests allows.

        Each direction counts by its share of what all gain together. The cost rises less and less
        with the squares: what one direction gains next to the others adds up to more.
        """
        if not self.supports:
            return 0.0
        parts = np.array([s.squares for s in self.supports]) - self.squares
        alone, together = (
            cost(channels, self.squares + some) - cost(channels, self.squares)
            for some in (parts, np.sum(parts, axis=0))
        )
        beyond = np.maximum(alone - [s.most for s in self.supports], 0.0)
        share = float(np.sum(beyond)) / max(float(np.sum(alone)), np.finfo(float).tiny)
        return share * max(float(together), 0.0)


def fit_set(
    first: Projected,
    channels: Sequence[ResidualChannel],
    starts: Sequence[CatalogueEffect],
    squares: FloatArray,
) -> FittedSet:
    """Fit effects together in addition to a model's; `squares` (channels,): what they may leave.

    Raises OutOfBudgetError.
    """
    effects, weights = tuple(starts), weights_of(channels, squares)
    best: FittedSet | None = None
    for number in range(_PASSES):
        if number == 0:
            effects = tuple(_with_steps(first, effects, i) for i in range(len(effects)))
        base = weighed(first, weights)
        found = refit(base, effects)
        others = [*_jumped(base, found.effects)]
        if number == 0:
            left = channel_squares(first, found.rest) / weights
            others += _other_starts(first, found.effects, channels, left)
        ends = [refit(base, start) for start in others]
        found = min([found, *ends], key=lambda end: end.fit.sum_of_squares)
        slopes = found.own_slopes()
        own = _fitted(first, base, found, slopes, weights)
        if plain := _plain_shapes(found, slopes):
            found = _refitted_plain(base, found, plain)
            again = _fitted(first, base, found, found.own_slopes(), weights)
            own = max(again, own, key=lambda one: one.evidence(channels, squares))
        found, left = own.refit, own.squares
        if best is not None and own.evidence(channels, left) < best.evidence(channels, left):
            break
        best, effects = own, found.effects
        before, weights = weights, weights_of(channels, left)
        if np.max(np.abs(np.log(weights / before))) < math.log(_SAME_WEIGHT):
            break
    assert best is not None
    return best


def _fitted(
    first: Projected, base: Projected, found: Refit, slopes: FloatArray, weights: FloatArray
) -> FittedSet:
    """The set of what was fitted to the residual `base`, `first` by its channels' `weights`;
    `slopes` as in `_log_volume`."""
    left = channel_squares(first, found.rest) / weights
    complexity = _prior_cost(found.effects) + _log_volume(found, slopes)
    return FittedSet(found, left, complexity, supports(base, found, slopes, weights))


def _refitted_plain(base: Projected, found: Refit, plain: Sequence[tuple[int, Quantity]]) -> Refit:
    """Fitted effects with these shapes of theirs, by the effect's place, at their plain form."""
    effects = list(found.effects)
    for place, q in plain:
        effects[place] = replace(effects[place], **{q.name: q.absent})  # type: ignore[type-var]
    return refit(base, effects, [f"{effects[place].id}/{q.name}" for place, q in plain])


def fall_on_twin(
    twin: Projected, weights: FloatArray, starts: Sequence[CatalogueEffect]
) -> FloatArray:
    """By how much effects, fitted from these numbers, lower the squares of a twin, (channels,).

    `weights` (channels,) of the channels in the fit. Raises OutOfBudgetError.
    """
    left = channel_squares(twin, refit(weighed(twin, weights), starts).rest) / weights
    return np.asarray(channel_squares(twin, twin.rest) - left)


def weighed(base: Projected, weights: FloatArray) -> Projected:
    """A residual with the squares of its channels times weights (channels,).

    Each base parameter acts in one channel, so that what is projected out stays so.
    """
    scales = dict(zip(CHANNELS, np.sqrt(weights), strict=True))
    white = {name: scales[name] * matrix for name, matrix in base.frame.whitening.items()}
    rows = np.ones(len(base.rest))
    for name in CHANNELS:
        rows[base.frame.rows(name)] = scales[name]
    frame = replace(base.frame, whitening=white)
    return replace(base, frame=frame, residual=rows * base.residual, rest=rows * base.rest)


def _prior_cost(effects: Sequence[CatalogueEffect]) -> float:
    return sum(
        (float(getattr(e, q.name)) / q.usual_size) ** 2 for e in effects for q in e.strengths()
    )


def _is_absent(effect: CatalogueEffect) -> bool:
    return all(
        abs(float(getattr(effect, q.name))) < AT_BOUND * q.usual_size for q in effect.strengths()
    )


def _log_volume(found: Refit, slopes: FloatArray) -> float:
    """Log determinant of the effects' information in units of their priors, by their `slopes`
    (rows, k) with the base parameters at their best: how much of the prior the data rule out."""
    own = slopes * _priors(found)
    return float(np.linalg.slogdet(np.eye(own.shape[1]) + own.T @ own)[1])


def _priors(found: Refit) -> FloatArray:
    """Standard deviations of the numbers' priors, (k,): 0 of one that was not fitted."""
    numbers = [q for e in found.effects for q in type(e).quantities]
    return np.where(found.free, [_prior(q) for q in numbers], 0.0)


def _plain_shapes(found: Refit, slopes: FloatArray) -> list[tuple[int, Quantity]]:
    """The shapes, by their effect's place, that are likelier at its plain form.

    Of those that a fit bends from there; by the density at it, after the data over before (the
    ratio of Savage and Dickey: Verdinelli and Wasserman, JASA 90, 1995).
    """
    numbers = [(i, q) for i, e in enumerate(found.effects) for q in type(e).quantities]
    priors = _priors(found)
    begin = np.array([q.begins_plain for _, q in numbers])
    bent = np.flatnonzero(begin & (priors > 0.0) & slopes.any(axis=0)).tolist()
    if not bent:
        return []
    own = slopes * priors
    covariance = np.linalg.inv(np.eye(len(numbers)) + own.T @ own)
    off = np.zeros(len(numbers))
    for k in bent:
        place, q = numbers[k]
        off[k] = (float(getattr(found.effects[place], q.name)) - q.grid[0]) / priors[k]

    def gained(some: Sequence[int]) -> float:
        part, away = covariance[np.ix_(some, some)], off[list(some)]
        return float(-np.linalg.slogdet(part)[1] - away @ np.linalg.solve(part, away))

    every = (s for count in range(1, len(bent) + 1) for s in itertools.combinations(bent, count))
    best = max(every, key=gained)
    return [numbers[k] for k in best] if gained(best) > 0.0 else []


def _prior(quantity: Quantity) -> float:
    """Standard deviation of a number's prior, in its unit: of a shape half its usual range."""
    if quantity.is_choice:
        return 0.0
    if quantity.is_strength or len(quantity.grid) < 2:
        return quantity.usual_size
    return 0.5 * (max(quantity.grid) - min(quantity.grid))


def _with_steps(
    first: Projected, effects: tuple[CatalogueEffect, ...], place: int
) -> CatalogueEffect:
    """An effect with its threshold where it acts best together with the others: it has no slope."""
    effect = effects[place]
    if not (has_threshold(effect) and overrides(effect, "pulses")):
        return effect
    return best_near(effect, _with_others(first, effects, place))


def _with_others(first: Projected, effects: tuple[CatalogueEffect, ...], place: int) -> Projected:
    """The residual next to which the effect at `place` is tried: all others are the model's."""
    others = tuple(e for i, e in enumerate(effects) if i != place)
    model = Model(first.model.parameters, (*first.model.effects, *others))
    return replace(first, model=model)


def _jumped(
    base: Projected, effects: tuple[CatalogueEffect, ...]
) -> Iterator[tuple[CatalogueEffect, ...]]:
    """Fitted effects with one nearer the shape at which it jumps than its slope leads."""
    for place, effect in enumerate(effects):
        jump = best_jump(effect, _with_others(base, effects, place))
        if jump is not None:
            yield (*effects[:place], jump, *effects[place + 1 :])


def _other_starts(
    first: Projected,
    effects: tuple[CatalogueEffect, ...],
    channels: Sequence[ResidualChannel],
    squares: FloatArray,
) -> Iterator[tuple[CatalogueEffect, ...]]:
    """Fitted effects with one at another shape, from which a fit may end in a lower minimum, where
    they leave squares (channels,) that it may explain."""
    for place, effect in enumerate(effects):
        names = channels_of(effect, effects)
        if any(_has_misfit(channels[c], squares[c]) for c in map(CHANNELS.index, names)):
            forms = (*bent_waves(first, effects, place), *_otherwise_obeyed(first, effects, place))
            far = best_jump(effect, _with_others(first, effects, place), _FAR)
            forms = forms if far is None else (*forms, far)
            yield from ((*effects[:place], form, *effects[place + 1 :]) for form in forms)


def _has_misfit(channel: ResidualChannel, squares: float) -> bool:
    """Whether a channel holds more than its noise and a model's own error may leave."""
    return float(channel.excess(squares)) > max(channel.misfit, channel.draws)


def _otherwise_obeyed(
    first: Projected, effects: tuple[CatalogueEffect, ...], place: int
) -> Iterator[CatalogueEffect]:
    """The effect at `place`, none where it does not change pulses, at each of its shapes that are
    screened, on its side and on both: between a pulse that is shortened and one that is lost lies
    no slope."""
    effect = effects[place]
    if not (has_threshold(effect) and overrides(effect, "pulses")):
        return
    rows = (first.frame.rows(name) for name in RATES)
    both = ("both",) if all(own.stop > own.start for own in rows) else ()
    shapes = [q for q in type(effect).shapes() if q.grid and not q.is_choice]
    sides = dict.fromkeys((getattr(effect, "side", ""), *both))
    for side, *values in itertools.product(sides, *(q.grid for q in shapes)):
        own = {q.name: value for q, value in zip(shapes, values, strict=True)}
        own |= {"side": side} if type(effect).has_side() else {}
        form = replace(effect, **own)  # type: ignore[type-var]
        yield _with_steps(first, (*effects[:place], form, *effects[place + 1 :]), place)


__all__ = ["FittedSet", "fall_on_twin", "fit_set", "weighed"]
