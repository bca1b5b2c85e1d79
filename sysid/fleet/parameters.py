"""The numbers of a bundle by their places, and how their errors go together."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from sysid.estimation.linear import LEVEL, Estimate, t_quantile
from sysid.io.channels import SIDES
from sysid.parameters import Bundle
from sysid.parameters.correlation import CorrelatedPart
from sysid.parameters.effects import SIDE, EffectEntry
from sysid.types import FloatArray

# An interval this little wider than the normal one is one: 1.96 for the quantile, for example.
_NORMAL = 1e-3


@dataclass(frozen=True)
class NumbersOfPart:
    """The numbers that one fit gave, by key; `correlation` (k, k) of the errors of `correlated`."""

    place: str
    estimates: dict[str, Estimate]
    correlated: tuple[str, ...] = ()
    correlation: FloatArray | None = None

    def covariance(self, keys: tuple[str, ...]) -> FloatArray:
        """Covariance (k, k) of the errors of these; independent where nothing is known."""
        found = np.eye(len(keys))
        if self.correlation is not None:
            for i, one in enumerate(keys):
                for j, other in enumerate(keys):
                    if i != j and {one, other} <= set(self.correlated):
                        places = self.correlated.index(one), self.correlated.index(other)
                        found[i, j] = self.correlation[places]
        std = np.array([self.estimates[key].std for key in keys])
        return np.asarray(found * np.outer(std, std))


def parts_of(bundle: Bundle) -> dict[str, NumbersOfPart]:
    """The parts of a bundle that hold fitted numbers, by place; effects by `effect_name`.

    Effects of one name are numbered from the second on, in the bundle's order.
    """
    found = {} if bundle.friction is None else {"friction": _part("friction", bundle.friction)}
    for side in SIDES:
        valve = bundle.valve(side)
        laws = (("discrete", valve.discrete), ("steady", valve.steady), ("timing", valve.timing))
        for name, law in laws:
            if law is not None:
                place = f"valves.{side}.{name}"
                found[place] = _part(place, law)
    if bundle.component is not None:
        place = f"component {bundle.component.name}"
        found[place] = NumbersOfPart(place, bundle.component.estimates())
    count: Counter[str] = Counter()
    for effect in bundle.effects:
        place = f"effect {effect_name(effect)}"
        count[place] += 1
        place += f" {count[place]}" if count[place] > 1 else ""
        found[place] = _effect(place, effect, bundle)
    return found


def _effect(place: str, effect: EffectEntry, bundle: Bundle) -> NumbersOfPart:
    """An effect's numbers; a refinement knows how their errors go together."""
    refined = bundle.refinement
    known = [] if refined is None else [value.name for value in refined.values()]
    names = {f"{effect.id}.{key}": key for key in effect.numbers()}
    if refined is None or not refined.correlations() or any(known.count(n) != 1 for n in names):
        return NumbersOfPart(place, effect.numbers())
    places = [known.index(name) for name in names]
    matrix = np.array(refined.correlations())[np.ix_(places, places)]
    return NumbersOfPart(place, effect.numbers(), tuple(names.values()), matrix)


def effect_name(effect: EffectEntry) -> str:
    """An effect's id, with the side where it has one: `atmosphere-leakage (a)`."""
    side = effect.parameters.get(SIDE)
    return f"{effect.id} ({side})" if isinstance(side, str) else effect.id


def _part(place: str, part: object) -> NumbersOfPart:
    estimates = {
        key: value
        for key, value in part.estimates().items()  # type: ignore[attr-defined]
        if not key.startswith(("jump_", "critical_ratio_"))  # checks, not parameters
    }
    known = part.correlation if isinstance(part, CorrelatedPart) else None
    if known is None:
        return NumbersOfPart(place, estimates)
    return NumbersOfPart(place, estimates, tuple(known.names), known.array())


def has_error(estimate: Estimate) -> bool:
    """Whether it is a number with a standard error above 0."""
    return estimate.identified and math.isfinite(estimate.std) and estimate.std > 0.0


def degrees_of_freedom(estimate: Estimate) -> float:
    """Those of an estimate's standard error: the ones that its 95 % interval is Student's with.

    A bundle keeps no degrees of freedom, but half the interval over the standard error is the
    quantile that they give. Infinite without a finite interval, or with a normal one.
    """
    from scipy.special import stdtridf

    low, high = estimate.interval
    quantile = 0.5 * (high - low) / estimate.std
    if not math.isfinite(quantile) or quantile <= t_quantile(math.inf) * (1.0 + _NORMAL):
        return math.inf
    return float(stdtridf(0.5 * (1.0 + LEVEL), quantile))


__all__ = ["NumbersOfPart", "degrees_of_freedom", "effect_name", "has_error", "parts_of"]
