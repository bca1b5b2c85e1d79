"""Which of a part's laws its training tests follow, by evidence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from sysid.blocks.numbers import number
from sysid.diagnosis.bench.component import Component, rmse
from sysid.diagnosis.bench.fitting import FittedLaw, fit_law
from sysid.parameters.valves import AUTO

# Twice the log of the odds from which on a law is chosen: 20 to 1, as an error of 5 % allows.
_DECIDED = 2.0 * math.log(20.0)


@dataclass(frozen=True)
class ChosenLaw:
    """The fit of the law that was chosen, and a line on why; empty where there was no choice.

    `is_decided`: whether the tests tell it from the others.
    """

    fitted: FittedLaw
    why: str = ""
    is_decided: bool = True


def chosen_law(component: Component, law: str = AUTO) -> ChosenLaw:
    """The law of a part that its tests follow; `law` requests one.

    Schwarz's criterion of each law's fit, with as many samples as the best one's correlated
    residuals are worth. Where the tests do not decide, the simplest that they do not rule out. A
    law of which they leave a number open (at a bound that no part of its kind has) is none of them.
    """
    forms = component.forms(law)
    if len(forms) == 1:
        return ChosenLaw(_fit(component.settled_as(forms[0])))
    every = [_fit(form) for form in forms]
    whole = [fit for fit in every if all(e.identified for e in fit.base_estimates().values())]
    fits = whole or every
    least = min(fits, key=lambda fit: fit.fit.sum_of_squares)
    count = max(least.independent_samples, 2.0)
    scores = [_criterion(fit, count) for fit in fits]
    best = min(scores)
    open_ones = [i for i, score in enumerate(scores) if score - best < _DECIDED]
    place = open_ones[0]
    chosen = fits[place]
    final = component.settled_as(chosen.component)
    found = chosen if final is chosen.component else _fit(final)
    is_decided = len({_kind(fits[i].component) for i in open_ones}) == 1
    is_decided &= not any(_is_more_of(fit, chosen, count) for fit in fits)
    return ChosenLaw(found, _why(fits, place, is_decided), is_decided)


def _fit(component: Component) -> FittedLaw:
    return fit_law(component, (), range(len(component.tests)))


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
    return count * math.log(max(fit.fit.sum_of_squares, 1e-300) / least) < _DECIDED


def _criterion(fitted: FittedLaw, count: float) -> float:
    squares = max(fitted.fit.sum_of_squares, 1e-300)
    return count * math.log(squares) + len(fitted.fit.values) * math.log(count)


def _why(fits: Sequence[FittedLaw], place: int, is_decided: bool) -> str:
    """The errors of the laws, and what follows."""
    unit = fits[place].component.unit
    errors = [
        f"{number(rmse([fit.fit.residuals]))} {unit} by {fit.component.law_name}" for fit in fits
    ]
    name = fits[place].component.law_name
    said = f"the training tests follow the flow law {name}"
    if not is_decided:
        said = f"the training tests do not distinguish all flow laws: {name}, the simplest, is used"
    return f"{said}; RMSE: {', '.join(errors)}"


__all__ = ["ChosenLaw", "chosen_law"]
