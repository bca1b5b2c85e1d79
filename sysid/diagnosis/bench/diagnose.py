"""The diagnosis of a part: what its law lacks, and the error on held-out tests."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.bundle import Bundle, Parts
from sysid.diagnosis.actuator.result import BeforeAfter, FoundEffect, Verdict
from sysid.diagnosis.bench.component import Component, Law, rmse
from sysid.diagnosis.bench.registry import component_of
from sysid.diagnosis.bench.remainder import Remainder, remainder
from sysid.diagnosis.bench.selection import Addition, Attempt, Selection, select
from sysid.diagnosis.bench.unexplained import LEAST_SHARE, BinnedResidual, curves
from sysid.diagnosis.looked import Because, Looked, why_unexplained
from sysid.errors import NotIdentifiedError
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.model.effects.entry import CatalogueEffect

_LEFT_OUT = (
    "no held-out log: errors before and after are those of tests left out of the fit in turn"
)
# An error this close to the noise floor leaves nothing to explain.
_AT_FLOOR = 1.1


@dataclass(frozen=True)
class ComponentDiagnosis:
    """The verdict on a part and its law, with all its evidence.

    `residual`: pooled RMSE on the held-out tests by channel, what is predicted first, then
    further channels (`Component.further_errors`). `part`: the bundle's section of the law
    refitted together with the effects. `curves`: the residual over the regressors that it
    depends on most. `remainder`: how much of what is left repeats from test to test, None where
    that cannot be said. `because`: why the verdict is `unexplained`, None where it is not.
    """

    kind: str
    verdict: Verdict
    effects: tuple[FoundEffect, ...]
    residual: Mapping[str, BeforeAfter]
    unit: str
    unexplained: tuple[BinnedResidual, ...]
    curves: tuple[BinnedResidual, ...]
    remainder: Remainder | None
    selection: Selection
    part: Parts
    notices: tuple[str, ...]
    because: Because | None = None
    seed: int = 0

    @property
    def looked(self) -> Looked:
        """What was looked at, and what was missed: for want of time, or as it failed."""
        return self.selection.looked

    def to_json(self) -> dict[str, Any]:
        """What `sysid diagnose --json` prints (spec/cli.md)."""
        return {
            "verdict": self.verdict,
            "component": self.kind,
            "effects": [
                {**effect.to_json(), "repeats": addition.repeats.to_json()}
                for effect, addition in zip(self.effects, self.selection.additions, strict=True)
            ],
            "residual": {name: errors.to_json() for name, errors in self.residual.items()},
            "unexplained": [
                {"channel": c.channel, "regressor": c.regressor, "share": c.share}
                for c in self.unexplained
            ],
            "because": self.because,
            "rejected": [_attempt(a) for a in self.selection.rejected],
            "search": self.looked.to_json(),
            "undecided": [{"id": u.id, **u.to_json()} for u in self.selection.undecided],
            "curves": [curve.to_json() for curve in self.curves],
            "remainder": None if self.remainder is None else self.remainder.to_json(),
            "seed": self.seed,
            "notices": list(self.notices),
        }

    def looks(self) -> list[dict[str, Any]]:
        """What each round tried: `added` (an id, or None in the last) and `attempts`."""
        steps: list[tuple[str | None, Sequence[Attempt]]] = [
            *((a.kind.id, a.attempts) for a in self.selection.additions),
            (None, self.selection.rejected),
        ]
        return [{"added": i, "attempts": [_attempt(a) for a in many]} for i, many in steps]


def _attempt(attempt: Attempt) -> dict[str, Any]:
    return {"id": attempt.id, "gain": attempt.gain, "p_value": attempt.p_value}


def diagnose_component(
    kind: str,
    fitted: Sequence[Trial],
    held_out: Sequence[Trial],
    rig: Rig,
    bundle: Bundle,
    catalogue: Mapping[str, type[CatalogueEffect]],
    progress: Callable[[str], None] = lambda line: None,
    *,
    build: Callable[[str, Sequence[Trial], Rig], Component] = component_of,
) -> ComponentDiagnosis:
    """Find what a part's law lacks on training tests, and measure it on held-out ones.

    `build` makes a part of a kind from tests. Raises InputError for tests that cannot be used,
    NotIdentifiedError where the bundle or the tests do not hold the law.
    """
    if not fitted:
        raise NotIdentifiedError('diagnosis: no log has use = "fit"; give it some')
    component = build(kind, fitted, rig)
    given = component.law_of(bundle)
    selection = select(component, catalogue, progress)
    outside = build(kind, held_out, rig) if held_out else None
    ambiguous = [a.repeats.sentence for a in selection.additions if a.repeats.sentence]
    ambiguous += [effect.undecided_sentence for effect in selection.undecided]
    looked = selection.looked.sentences()
    notices = (*(() if outside else (_LEFT_OUT,)), *ambiguous, *looked)
    laws = [given, *(a.fitted.law for a in selection.additions)]
    progress("predicting the held-out tests, before and after")
    floor = (outside or component).noise_floor(laws[-1])
    errors = (
        [_errors(outside, law) for law in laws]
        if outside
        else [{component.channel: error} for error in _cross_validated(selection)]
    )
    simulated = outside.further_errors(laws[-1]) if outside else {}
    floors = {component.channel: floor, **{name: noise for name, (_, noise) in simulated.items()}}
    left = curves(component, given, laws[-1])
    error = errors[-1].get(component.channel, selection.final.fit.residual_std)
    rest = remainder(component, outside, laws[-1], floor)
    structured = [c for c in left[:1] if c.share > LEAST_SHARE and error > _AT_FLOOR * floor]
    if rest is not None:
        structured = _repeating(structured, rest, left, errors[0].get(component.channel, error))
    undecided = not selection.additions and not selection.looked.is_decided
    because = why_unexplained(bool(structured), False, undecided)
    if undecided:
        structured = structured or left[:1]
    return ComponentDiagnosis(
        kind=kind,
        verdict=_verdict(selection, because is not None),
        effects=tuple(
            _found(addition, selection, before, after)
            for addition, before, after in zip(
                selection.additions, errors[:-1], errors[1:], strict=True
            )
        ),
        residual={
            name: BeforeAfter(errors[0][name], errors[-1][name], floors[name]) for name in errors[0]
        },
        unit=component.unit,
        unexplained=tuple(structured),
        curves=tuple(left),
        remainder=rest,
        selection=selection,
        part=selection.final.part(),
        notices=notices,
        because=because,
    )


def _repeating(
    structured: list[BinnedResidual],
    rest: Remainder,
    left: Sequence[BinnedResidual],
    before: float,
) -> list[BinnedResidual]:
    """What counts as structure where it is known how much repeats from test to test."""
    if not rest.is_steady:
        return []
    if not rest.is_large(before):
        return structured
    # Over several quantities together more repeats than over the strongest alone.
    return [replace(curve, share=max(curve.share, rest.share)) for curve in left[:1]]


def _cross_validated(selection: Selection) -> list[float]:
    """RMSE of tests left out of the fit, of the law and after each addition."""
    folds = [selection.folds, *(a.attempt.folds for a in selection.additions)]
    return [math.sqrt(float(np.mean(squares))) for squares in folds]


def _errors(outside: Component, law: Law) -> dict[str, float]:
    predicted = rmse(outside.residuals(law, range(len(outside.tests))))
    simulated = {name: error for name, (error, _) in outside.further_errors(law).items()}
    return {outside.channel: predicted, **simulated}


def _verdict(selection: Selection, structure_left: bool) -> Verdict:
    if structure_left:
        return "unexplained"
    return "effects-found" if selection.additions else "adequate"


def _found(
    addition: Addition,
    selection: Selection,
    before: Mapping[str, float],
    after: Mapping[str, float],
) -> FoundEffect:
    place = selection.additions.index(addition)
    final = selection.final
    effect = final.law.effects[place]
    return FoundEffect(
        effect=effect,
        estimates=final.estimates(effect),
        p_value=addition.attempt.p_value,
        share=addition.attempt.gain,
        holdout={name: BeforeAfter(before[name], after[name]) for name in before},
        ambiguous_with=addition.ambiguous,
        advice=addition.kind.tie_breaker if addition.is_ambiguous else "",
        suspects=(),
    )


__all__ = ["ComponentDiagnosis", "diagnose_component"]
