"""Which effects a part lacks: one after another, judged by tests that were left out.

Each effect of the catalogue that acts on the part is fitted beside the law and what was
added before, and predicts tests that it was not fitted on. The one that predicts best is
added if its strength is off 0 beyond doubt, over all that were tried (Bonferroni), and it
takes a real share of the error of prediction.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.components.component import Component
from sysid.components.fitting import Fitted, cross_validated, fit_law
from sysid.model.effects.catalogue import class_of
from sysid.model.effects.entry import CatalogueEffect

FloatArray = NDArray[np.float64]
Kind = type[CatalogueEffect]

SIGNIFICANCE = 1e-3
MOST_EFFECTS = 3
# Of the mean square error of prediction: what an effect has to take of it to be added, and
# how much of what the winner takes makes a rival that these tests cannot tell from it.
LEAST_GAIN = 0.2
RIVAL_SHARE = 0.9
_DIGITS = 4


@dataclass(frozen=True)
class Attempt:
    """An effect that was tried: its fitted p-value, and the share of the error that it takes.

    `gain`: of the mean square error of the tests left out, negative where it predicts worse.
    `folds` (k,) the mean square error of each fold with it.
    """

    id: str
    p_value: float
    gain: float
    folds: FloatArray


@dataclass(frozen=True)
class Addition:
    """An effect that was added: the fit with it and all before it, and what else was tried."""

    kind: Kind
    fitted: Fitted
    attempt: Attempt
    ambiguous: tuple[str, ...]
    attempts: tuple[Attempt, ...]

    @property
    def effect(self) -> CatalogueEffect:
        """The effect with its numbers."""
        return self.fitted.law.effects[-1]


@dataclass(frozen=True)
class Selection:
    """The law without effects, the additions in order, and the last, fruitless look.

    `folds` (k,): mean square error of each fold, predicted by the law without effects.
    """

    base: Fitted
    folds: FloatArray
    additions: tuple[Addition, ...]
    rejected: tuple[Attempt, ...]

    @property
    def final(self) -> Fitted:
        """The law with all that was added."""
        return self.additions[-1].fitted if self.additions else self.base


def select(
    component: Component,
    catalogue: Mapping[str, Kind],
    progress: Callable[[str], None] = lambda line: None,
) -> Selection:
    """Add effects to a part's law for as long as they predict tests that were left out.

    Raises NotIdentifiedError where the law itself is not identified.
    """
    everything = range(len(component.tests))
    folds = folds_of(component)
    base = fit_law(component, (), everything)
    kinds = component.effects(catalogue)
    chosen: list[Kind] = []
    additions: list[Addition] = []
    first = error = cross_validated(component, (), folds, base.law)
    while True:
        open_ones = [k for k in kinds if k not in chosen]
        so_far = additions[-1].fitted if additions else base
        attempts = _attempts(component, chosen, open_ones, so_far, folds, error)
        passing = [a for a in attempts if _passes(a, len(open_ones), error)]
        if not passing or len(chosen) == MOST_EFFECTS:
            return Selection(base, first, tuple(additions), tuple(attempts))
        winner = passing[0]
        kind = next(k for k in open_ones if k.id == winner.id)
        chosen.append(kind)
        progress(f"{winner.id}: takes {100 * winner.gain:.0f} % of the error of prediction")
        additions.append(
            Addition(
                kind,
                fit_law(component, chosen, everything, so_far.law),
                winner,
                _ambiguous(winner, passing, {k.id for k in kinds}),
                tuple(attempts),
            )
        )
        error = winner.folds


def folds_of(component: Component) -> list[list[int]]:
    """Tests that are left out together: each by itself, or as evenly as the parts allow."""
    count = len(component.tests)
    parts = min(count, component.most_folds)
    return [list(range(k, count, parts)) for k in range(parts)] if parts > 1 else []


def _attempts(
    component: Component,
    chosen: Sequence[Kind],
    kinds: Sequence[Kind],
    without: Fitted,
    folds: Sequence[Sequence[int]],
    error: FloatArray,
) -> list[Attempt]:
    """Every open effect, the best prediction first; spread over the machine's cores."""
    from joblib import Parallel, delayed

    found = Parallel(n_jobs=-1)(
        delayed(_attempt)(component, [*chosen, kind], without, folds, error) for kind in kinds
    )
    # Of two that are one and the same on these tests the catalogue's first counts.
    return sorted((a for a in found if a is not None), key=lambda a: -round(a.gain, _DIGITS))


def _attempt(
    component: Component,
    kinds: Sequence[Kind],
    without: Fitted,
    folds: Sequence[Sequence[int]],
    error: FloatArray,
) -> Attempt | None:
    """One effect beside those before it; None where these tests do not identify it."""
    fitted = fit_law(component, kinds, range(len(component.tests)), without.law)
    if not np.isfinite(fitted.fit.sum_of_squares):
        return None
    p_value = fitted.p_value(without)
    if p_value >= SIGNIFICANCE:
        # What is not there needs no prediction.
        return Attempt(kinds[-1].id, p_value, 0.0, error)
    squares = cross_validated(component, kinds, folds, fitted.law)
    gain = 1.0 - float(squares.mean() / error.mean())
    return Attempt(kinds[-1].id, p_value, gain, squares)


def _passes(attempt: Attempt, tried: int, error: FloatArray) -> bool:
    better = int(np.count_nonzero(attempt.folds < error))
    return (
        attempt.p_value * tried < SIGNIFICANCE
        and attempt.gain > LEAST_GAIN
        and 2 * better > len(error)
    )


def _ambiguous(winner: Attempt, passing: Sequence[Attempt], known: set[str]) -> tuple[str, ...]:
    """Members of the winner's class that act here, and rivals that predict as well."""
    near = (class_of(winner.id) & known) - {winner.id}
    near |= {a.id for a in passing if a.id != winner.id and a.gain > RIVAL_SHARE * winner.gain}
    return tuple(sorted(near))


__all__ = ["Addition", "Attempt", "Selection", "folds_of", "select"]
