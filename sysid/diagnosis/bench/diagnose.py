"""The diagnosis of a part: what its law lacks, and the error on held-out tests."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from sysid.diagnosis.bench.component import Component, Law, rmse
from sysid.diagnosis.bench.evidence import HeldOutEvidence
from sysid.diagnosis.bench.fitting import FittedLaw
from sysid.diagnosis.bench.registry import component_of
from sysid.diagnosis.bench.selection import Selection, select
from sysid.diagnosis.bench.starting_points import law_at
from sysid.diagnosis.bench.unexplained import BinnedResidual, curves, left_over
from sysid.diagnosis.evidence import residual
from sysid.diagnosis.lack_of_fit import LEAST_SHARE, MISFIT, Remainder
from sysid.diagnosis.result import Diagnosis, Unexplained
from sysid.diagnosis.search import full_sentence
from sysid.diagnosis.search_record import why_unexplained
from sysid.errors import Failure, NotIdentifiedError, on_its_own
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.parameters import Bundle
from sysid.parameters.assembled_model import effects_from_bundle
from sysid.parameters.scatter import MOST_SCATTER
from sysid.plant.effects.entry import Catalogue, CatalogueEffect
from sysid.signals import deviation_by_median
from sysid.types import FloatArray

_LEFT_OUT = "errors before and after are those of tests left out of the fit in turn"
_NO_LOG = "no held-out log"
_ONE_RECORDING = (
    "one recording cannot tell which effects the law lacks, as nothing is left to predict: none "
    "was tried; record the test at least twice more, from other conditions"
)
# Rounds of reweighted least squares; of the largest residual: below it all count alike.
_ROUNDS, _LEAST_WEIGHED = 20, 1e-6
_FAR_OFF_NOTICE = (
    "the errors are far above the noise, though the tests share no structure: look for a log that "
    "is not like the others (chambers exchanged, a sign, a unit, another rig)"
)


def diagnose_component(
    kind: str,
    fitted: Sequence[Trial],
    held_out: Sequence[Trial],
    rig: Rig,
    bundle: Bundle,
    catalogue: Mapping[str, type[CatalogueEffect]],
    progress: Callable[[str], None] = lambda line: None,
    *,
    quick: bool = False,
    build: Callable[[str, Sequence[Trial], Rig], Component] = component_of,
) -> Diagnosis:
    """Find what a part's law lacks on training tests, and measure it on held-out ones.

    `quick`: a first look only. `build` makes a part of a kind from tests. Held-out tests decide
    neither the effects nor their numbers: where these laws do not predict them, a notice says so.
    Raises InputError for tests that cannot be used, NotIdentifiedError where the bundle or the
    training tests do not hold the law.
    """
    if not fitted:
        raise NotIdentifiedError('diagnosis: no log has use = "fit"; give it some')
    component = build(kind, fitted, rig).in_form_of(bundle)
    given = component.law_of(bundle)
    selection = select(component, catalogue, progress, quick=quick)
    laws = [given, *(a.fitted.law for a in selection.additions)]
    progress("predicting the held-out tests, before and after")
    many = len(component.tests) > 1
    outside, lacks_outside = _outside(kind, held_out, rig, bundle, build, many)
    if outside is not None:
        predicted = on_its_own(partial(_held_out, outside, laws))
        if isinstance(predicted, Failure):
            said = f"held-out tests are not predicted: {predicted.reason}: {_LEFT_OUT}"
            outside, lacks_outside = None, (said,)
        else:
            errors, floors, missing = predicted
            floors[component.channel] = _of_correct_law(component, laws[-1], selection)
            lacks_outside = (*outside.left_out, *missing)
    if outside is None:
        errors = [{component.channel: error} for error in _cross_validated(selection)]
        floors = {component.channel: _of_correct_law(component, laws[-1], selection)}
    floor = floors[component.channel]
    notices = (*component.left_out, *lacks_outside, *_of_search(selection))
    left = curves(component, given, laws[-1])
    error = errors[-1].get(component.channel, math.nan)
    if not math.isfinite(error):
        error = selection.final.fit.residual_std
    rest = left_over(component, outside, laws[-1], component.noise_floor(laws[-1]))
    before = errors[0].get(component.channel, error)
    is_visible = error >= component.precision * _size_of(component)
    structured = _repeating(rest, left, before)
    structured = structured if is_visible else []
    found_any, ended = bool(selection.additions), not selection.record.cut_short
    undecided = ended and not (found_any or selection.record.is_decided)
    far_off = _is_far_off(component, outside, selection, laws, errors, error, floor)
    far_off &= ended and is_visible
    reason = why_unexplained(bool(structured), far_off, undecided)
    if not many:
        notices = (*notices, _ONE_RECORDING)
        reason = "one recording" if far_off else reason
    if reason == "held-out errors" and not found_any:
        notices = (*notices, _FAR_OFF_NOTICE)
    if found_any and floor > 0.0 and error > MISFIT * floor:
        notices = (
            *notices,
            f"the errors left are {error / floor:.2g} times the noise: intervals are those of the "
            "law as it stands, and other tests may give numbers further apart",
        )
    if undecided or far_off:
        structured = structured or left[:1]
    evidence = HeldOutEvidence(kind, selection, tuple(left), given, outside)
    return Diagnosis(
        effects=evidence.found(errors),
        residual=residual(errors, floors),
        unexplained=tuple(
            Unexplained(c.channel, c.regressor, c.share if many else None) for c in structured
        ),
        remainder=() if rest is None else (rest,),
        evidence=evidence,
        reason=reason,
        notices=notices,
    )


def _of_search(selection: Selection) -> Iterator[str]:
    """What a search leaves in doubt, and what it did not come to, a line each."""
    yield from (a.repeats.sentence for a in selection.additions if a.repeats.sentence)
    yield from (effect.undecided_sentence for effect in selection.undecided)
    yield from (a.limit_sentence for a in selection.additions if a.limit_sentence)
    yield from selection.record.sentences()
    if full := full_sentence(selection.additions):
        yield full


def _outside(
    kind: str,
    held_out: Sequence[Trial],
    rig: Rig,
    bundle: Bundle,
    build: Callable[[str, Sequence[Trial], Rig], Component],
    many: bool,
) -> tuple[Component | None, tuple[str, ...]]:
    """The part of the held-out tests; why there is none. `many`: whether there are several others,
    so that each has been left out in turn."""
    if not held_out:
        return None, (f"{_NO_LOG}: {_LEFT_OUT}" if many else _NO_LOG,)
    found = on_its_own(lambda: build(kind, held_out, rig).in_form_of(bundle))
    if isinstance(found, Failure):
        return None, (f"held-out tests are not predicted: {found.reason}: {_LEFT_OUT}",)
    return found, ()


def _held_out(
    outside: Component, laws: Sequence[Law]
) -> tuple[list[dict[str, float]], dict[str, float], tuple[str, ...]]:
    """RMSE by channel of each law, and of a correct one in further channels; NaN where a law cannot
    be simulated, with a notice of why."""
    known, notices = outside.further_errors_of(laws)
    names = dict.fromkeys(name for own in known for name in own)
    unknown = (math.nan, math.nan)
    errors = [
        {outside.channel: rmse(outside.residuals(law, range(len(outside.tests))))}
        | {name: own.get(name, unknown)[0] for name in names}
        for law, own in zip(laws, known, strict=True)
    ]
    floors = {name: known[-1].get(name, unknown)[1] for name in names}
    return errors, floors, notices


def held_out_errors(outside: Component, bundle: Bundle, catalogue: Catalogue) -> dict[str, float]:
    """RMSE by channel, in its unit, of a bundle's law with its effects on held-out tests."""
    effects = effects_from_bundle(bundle, catalogue)
    law = Law(outside.law_of(bundle).values, effects)  # type: ignore[arg-type]
    return _errors(outside, law)


def _repeating(
    rest: Remainder | None, left: Sequence[BinnedResidual], before: float
) -> list[BinnedResidual]:
    """The curve over the quantity over which the residual repeats, where that counts."""
    if rest is None or not rest.is_structure(before):
        return []
    # Of two quantities together the curve over the stronger alone.
    own = [curve for curve in left if curve.regressor in rest.regressors]
    return [replace(curve, share=rest.share) for curve in own[:1]]


def _is_far_off(
    component: Component,
    outside: Component | None,
    selection: Selection,
    laws: Sequence[Law],
    errors: Sequence[Mapping[str, float]],
    error: float,
    floor: float,
) -> bool:
    """Whether the error after the effects is a misfit, next to that of a correct law (`floor`).

    Or whether no held-out error, by channel, is less with the effects than without, be it next to
    what each test has of its own.
    """
    before, after = errors[0], errors[-1]
    helps = any(after[name] < own for name, own in before.items())
    if selection.additions and outside is not None and not (helps or _follows(outside, laws)):
        return True
    # A real law, or effect, seldom has the form of ours to the last: what it leaves is small then.
    least = math.sqrt(LEAST_SHARE) * before.get(component.channel, math.nan)
    if not error > MISFIT * floor or error <= least:
        return False
    return _typical(component, outside, selection.final) > MISFIT * floor


def _typical(component: Component, outside: Component | None, fitted: FittedLaw) -> float:
    """Error of the typical sample, in the component's unit: of held-out tests, else of its own.

    With the numbers that suit most of the samples (least absolute residuals), so that the few that
    the law is not about, as when friction builds up after a reversal, count neither themselves nor
    by what they do to the numbers; friction may be each test's own, up to a tenth. As an RMSE of
    normal errors.
    """
    fit = fitted.fit
    sizes = np.maximum(np.linalg.norm(fit.jacobian, axis=0), 1e-300)
    slopes, left = fit.jacobian / sizes, fit.residuals
    least = _LEAST_WEIGHED * float(np.max(np.abs(left), initial=1e-300))
    for _ in range(_ROUNDS):
        weight = 1.0 / np.sqrt(np.maximum(np.abs(left), least))
        more = np.linalg.lstsq(weight[:, None] * slopes, -weight * fit.residuals, rcond=None)[0]
        left = fit.residuals + slopes @ more
    values = zip(fit.parameters, fit.values + more / sizes, strict=True)
    numbers = np.array([np.clip(value, p.lower, p.upper) for p, value in values])
    law, shown = law_at(component.parameters(), fitted.law.effects, numbers), outside or component
    return deviation_by_median(_shared(shown, law))


def _follows(outside: Component, laws: Sequence[Law]) -> bool:
    """Whether held-out tests are nearer to the last law than to the first, next to their own."""
    first, last = (rmse([_shared(outside, law)]) for law in (laws[0], laws[-1]))
    return last < first


def _shared(component: Component, law: Law) -> FloatArray:
    """Residuals of all tests, end to end, less what each has of its own."""
    tests = range(len(component.tests))
    pairs = zip(component.residuals(law, tests), component.of_each_test(law, tests), strict=True)
    return np.concatenate([_less_its_own(*pair) for pair in pairs])


def _less_its_own(left: FloatArray, own: FloatArray) -> FloatArray:
    """A test's residual (n,) less its own multiple of what differs from test to test, (n,)."""
    acts = own != 0.0
    share = float(np.median(left[acts] / own[acts])) if acts.any() else 0.0
    return np.asarray(left - np.clip(share, -MOST_SCATTER, MOST_SCATTER) * own)


def _of_correct_law(component: Component, law: Law, selection: Selection) -> float:
    """RMSE of a correct law on tests that it was not fitted on, in the component's unit.

    The sensors' noise, what differs from test to test, and the errors of the fitted numbers.
    """
    fit = selection.final.fit
    own = math.hypot(component.noise_floor(law), component.scatter(law))
    return own * math.sqrt(1.0 + len(fit.values) / max(len(fit.residuals), 1))


def _size_of(component: Component) -> float:
    """RMS of what the law has to follow."""
    return rmse(component.measured(range(len(component.tests))))


def _cross_validated(selection: Selection) -> list[float]:
    """RMSE of tests left out of the fit, of the law and after each addition; NaN of a single test,
    as none was left out."""
    folds = [selection.folds, *(a.folds for a in selection.additions)]
    return [math.sqrt(float(np.mean(f))) if f.size else math.nan for f in folds]


def _errors(outside: Component, law: Law) -> dict[str, float]:
    predicted = rmse(outside.residuals(law, range(len(outside.tests))))
    ((further,), _) = outside.further_errors_of([law])
    simulated = {name: error for name, (error, _) in further.items()}
    return {outside.channel: predicted, **simulated}


__all__ = ["diagnose_component", "held_out_errors"]
