"""Which of a part's laws its training tests follow, by evidence."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from sysid.blocks.numbers import number
from sysid.diagnosis.bench.component import Component
from sysid.diagnosis.bench.fitting import FittedLaw, fit_law
from sysid.estimation.law_evidence import ODDS
from sysid.estimation.linear import Estimate
from sysid.parameters.valves import AUTO

# Rows beyond a law's numbers from which on its errors deny it: one alone is small by chance.
_FEWEST_SPARE = 2


@dataclass(frozen=True)
class ChosenLaw:
    """The fit of the law that was chosen, and a line on why; empty where there was no choice.

    `is_decided`: whether the tests tell it from the others; `others`: the fits of those from which
    they do not.
    """

    fitted: FittedLaw
    why: str = ""
    is_decided: bool = True
    others: tuple[FittedLaw, ...] = field(default=(), repr=False)

    @cached_property
    def estimates(self) -> dict[str, Estimate]:
        """The law's own parameters by name. As the tests do not say which of the laws is right, an
        interval covers what each of them says of that number."""
        found = self.fitted.base_estimates()
        return _covering(found, [fit.base_estimates() for fit in self.others])


def chosen_law(component: Component, law: str = AUTO) -> ChosenLaw:
    """The law of a part that its tests follow; `law` requests one.

    Schwarz's criterion of each law's fit, with as many samples as the best one's correlated
    residuals are worth. Where the tests do not decide, the simplest that they do not rule out. A
    law of which they leave a number open (at a bound that no part of its kind has) is none of them,
    nor is one of so many numbers that too few rows are left to deny it.
    """
    forms = component.forms(law)
    if len(forms) == 1:
        return ChosenLaw(_fit(component.settled_as(forms[0])))
    every = [_fit(form) for form in forms]
    spare = [fit for fit in every if _spare(fit) >= _FEWEST_SPARE] or every[:1]
    whole = [fit for fit in spare if all(e.identified for e in fit.base_estimates().values())]
    fits = whole or spare
    least = min(fits, key=lambda fit: fit.fit.sum_of_squares)
    # The numbers of the largest law, and one more row, tell nothing of any (O'Hagan 1995,
    # Fractional Bayes factors for model comparison): of few rows that is most.
    said = (min(map(_spare, fits)) - 1.0) / len(least.fit.residuals)
    count = max(said * least.independent_samples, 2.0)
    scores = [_criterion(fit, count) for fit in fits]
    best = min(scores)
    open_ones = [i for i, score in enumerate(scores) if score - best < ODDS]
    place = open_ones[0]
    chosen = fits[place]
    final = component.settled_as(chosen.component)
    found = chosen if final is chosen.component else _fit(final)
    others = [
        fit
        for i, fit in enumerate(fits)
        if i in open_ones and _kind(fit.component) != _kind(chosen.component)
    ]
    # Gas as warm as the wall is gas that there is, so that its law counts with its wall at a bound.
    others += [f for f in every if f not in others and _is_more_of(f, chosen, count)]
    # Of the law in use the error is that of the fit which is used, as in every table.
    shown = [found if fit is chosen else fit for fit in every if fit in fits or fit in others]
    return ChosenLaw(found, _why(shown, chosen, not others), not others, tuple(others))


def _covering(
    own: Mapping[str, Estimate], others: Sequence[Mapping[str, Estimate]]
) -> dict[str, Estimate]:
    """Estimates whose intervals cover those that other laws give to numbers of the same name."""
    found = dict(own)
    for name, estimate in own.items():
        same = [e for other in others if (e := other.get(name)) is not None and e.has_interval]
        if same and estimate.has_interval:
            found[name] = estimate.covering(same)
    return found


def _fit(component: Component) -> FittedLaw:
    return fit_law(component, (), range(len(component.tests)))


def _spare(fitted: FittedLaw) -> int:
    """The rows beyond a law's numbers and those of each test."""
    fit = fitted.fit
    return len(fit.residuals) - len(fit.values) - fit.taken_out


def _kind(component: Component) -> tuple[str, bool]:
    """A law's name, whether its index is fitted or not, and whether its gas has a temperature."""
    return getattr(component, "law", ""), getattr(component, "has_temperature", False)


def _is_more_of(fit: FittedLaw, chosen: FittedLaw, count: float) -> bool:
    """Whether a fit is of the law chosen with gas that has a temperature, and as good: gas as warm
    as the wall leaves the same discharge, and only its further number speaks against it."""
    (law, cools), (own, has_it) = _kind(fit.component), _kind(chosen.component)
    if law != own or not cools or has_it:
        return False
    least = max(chosen.fit.sum_of_squares, 1e-300)
    return count * math.log(max(fit.fit.sum_of_squares, 1e-300) / least) < ODDS


def _criterion(fitted: FittedLaw, count: float) -> float:
    squares = max(fitted.fit.sum_of_squares, 1e-300)
    return count * math.log(squares) + len(fitted.fit.values) * math.log(count)


def _why(fits: Sequence[FittedLaw], chosen: FittedLaw, is_decided: bool) -> str:
    """The errors of the laws, and what follows."""
    unit = chosen.component.unit
    errors = [f"{number(fit.quality().rmse)} {unit} by {fit.component.law_name}" for fit in fits]
    name = chosen.component.law_name
    said = f"the training tests follow the flow law {name}"
    if not is_decided:
        said = (
            f"the training tests do not distinguish all flow laws: {name}, the simplest, is used, "
            "with intervals that cover what the others say of the same numbers"
        )
    return f"{said}; RMSE: {', '.join(errors)}"


__all__ = ["ChosenLaw", "chosen_law"]
