"""Whether the choice of an effect repeats on parts of the tests that it was chosen on.

The tests are cut into three parts. Where each holds at least two tests, the chosen effect and
its best rivals are fitted to one part and predict the others; else they are fitted to two and
predict the third. A part names the contender that predicts best, if its strength differs
significantly from 0 and it removes as large a share of the error as is required of the whole.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from sysid.diagnosis.bench.component import Component
from sysid.diagnosis.bench.fitting import FittedLaw, fit_law
from sysid.diagnosis.thresholds import DIGITS, LEAST_REDUCTION, RIVAL_SHARE, SIGNIFICANCE
from sysid.errors import Failure, OutOfBudgetError
from sysid.parallel import attempt_all

PARTS = 3
# Below it a part is two thirds of the tests, not one.
_FEWEST_IN_PART = 2


@dataclass(frozen=True)
class Repeats:
    """What each part of the tests names where all of them name `id`; None: no effect.

    No parts where there are too few tests to cut.
    """

    id: str
    named: tuple[str | None, ...]

    @property
    def agree(self) -> int:
        """Parts that name the effect itself."""
        return self.named.count(self.id)

    @property
    def others(self) -> tuple[str, ...]:
        """Effects that parts name instead, each once."""
        return tuple(sorted({n for n in self.named if n is not None} - {self.id}))

    @property
    def sentence(self) -> str:
        """The effects that parts name instead, in words; empty where all name the effect."""
        counts = {n or "no effect": self.named.count(n) for n in self.named if n != self.id}
        if not counts:
            return ""
        said = ", ".join(f"{count} name{'s' * (count == 1)} {n}" for n, count in counts.items())
        return f"{self.id}: ambiguous: of {len(self.named)} parts of the fitted tests {said}"

    @property
    def undecided_sentence(self) -> str:
        """The sentence for an effect that parts name and all of the tests together do not."""
        return (
            f"{self.id}: ambiguous: it fits the tests and {self.agree} of {len(self.named)} parts "
            "of them name it, but it does not improve the prediction of tests left out in turn: "
            "not added"
        )

    def to_json(self) -> dict[str, Any]:
        """As JSON types: `parts`, `agree`, and what each part names."""
        return {"parts": len(self.named), "agree": self.agree, "named": list(self.named)}


def repeats(component: Component, without: FittedLaw, contenders: Sequence[FittedLaw]) -> Repeats:
    """What parts of the tests name, of contenders fitted to all of them, the winner first.

    A contender has one effect beyond `without`, the last of its law. Raises OutOfBudgetError.
    """
    found = attempt_all(
        partial(_named, component, without, contenders, part) for part in parts(component)
    )
    named = []
    for one in found:
        if isinstance(one, Failure):
            raise OutOfBudgetError if one.out_of_budget else RuntimeError(one.reason)
        named.append(one)
    return Repeats(_id(contenders[0]), tuple(named))


def parts(component: Component) -> list[list[int]]:
    """The tests that each part is fitted to; none where there are fewer tests than parts."""
    count = len(component.tests)
    thirds = [list(range(k, count, PARTS)) for k in range(PARTS)]
    if count < PARTS:
        return []
    if count >= _FEWEST_IN_PART * PARTS:
        return thirds
    return [[t for t in range(count) if t not in third] for third in thirds]


def pieces_of(tests: int) -> int:
    """Into how many stretches each of so many tests is cut: few give each part several."""
    return 1 if tests >= PARTS else math.ceil(_FEWEST_IN_PART * PARTS / max(tests, 1))


def _named(
    component: Component, without: FittedLaw, contenders: Sequence[FittedLaw], part: Sequence[int]
) -> str | None:
    rest = [t for t in range(len(component.tests)) if t not in part]
    lone = _again(without, part)
    error = _error(lone, rest)
    passing: list[tuple[str, float, bool]] = []
    for contender in contenders:
        fitted = _again(contender, part)
        reduction = 1.0 - _error(fitted, rest) / error
        if fitted.p_value(lone) * len(contenders) < SIGNIFICANCE and reduction > LEAST_REDUCTION:
            passing.append((_id(contender), round(reduction, DIGITS), fitted.is_plausible))
    if not passing:
        return None
    sound = any(plausible for _, _, plausible in passing)
    reductions = {name: share for name, share, plausible in passing if plausible or not sound}
    best, winner = max(reductions, key=lambda name: reductions[name]), _id(contenders[0])
    return winner if reductions.get(winner, 0.0) > RIVAL_SHARE * reductions[best] else best


def _again(fitted: FittedLaw, tests: Sequence[int]) -> FittedLaw:
    """The same effects fitted to other tests."""
    kinds = [type(effect) for effect in fitted.law.effects]
    return fit_law(fitted.component, kinds, tests, fitted.law)


def _error(fitted: FittedLaw, tests: Sequence[int]) -> float:
    """Mean square of the prediction of some tests."""
    return float(np.mean(np.concatenate(fitted.component.residuals(fitted.law, tests)) ** 2))


def _id(fitted: FittedLaw) -> str:
    return fitted.law.effects[-1].id


__all__ = ["PARTS", "Repeats", "parts", "pieces_of", "repeats"]
