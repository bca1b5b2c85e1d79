"""The last step of a diagnosis: the numbers of the model found, estimated by simulation error.

The balances that find an effect give its numbers with the bias of their approximations. Where the
model that was found is simulated, the motion tests say them without (design, step 4). An effect to
which they give no strength is not there: the search is made again without it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from sysid.blocks.numbers import number
from sysid.diagnosis.actuator.evidence import TwinEvidence
from sysid.diagnosis.evidence import ComponentEvidence
from sysid.diagnosis.result import BeforeAfter, Diagnosis, FoundEffect
from sysid.diagnosis.search_record import SearchStage
from sysid.errors import Failure, InputError, NotIdentifiedError
from sysid.estimation.linear import LEVEL, Estimate, chi_squared_quantile
from sysid.estimation.nonlinear import AT_BOUND
from sysid.io.campaign import Campaign
from sysid.parallel import LATE, attempt, limited
from sysid.parameters import Bundle, EffectEntry
from sysid.parameters.assembled_model import effects_from_bundle
from sysid.parameters.table import effect_names
from sysid.plant.effects.entry import Catalogue, CatalogueEffect
from sysid.types import Progress, no_progress

if TYPE_CHECKING:
    from sysid.refinement.result import RefineResult

Look = Callable[[Catalogue], Diagnosis]
"""A diagnosis by the effects of a catalogue, its numbers refined."""


def without_contradicted(
    look: Look, catalogue: Catalogue, progress: Progress = no_progress
) -> Diagnosis:
    """The diagnosis of which every refined effect has a strength other than 0, within its range.

    Where one has none, the next is made without the one that is the most surely absent; so it is
    without one that grows to the limit of its range and makes an error of the training tests
    larger, and without one of such a size that it explains nothing of what it was found by.
    Held-out tests decide nothing.
    """
    found, gone, notices = look(catalogue), [], []
    # Where the budget is over nothing is searched for again.
    while not found.record.cut_short and (contradiction := _contradicted(found)) is not None:
        absent, why = contradiction
        progress(f"{absent.id}: motion contradicts it, searching without it")
        gone.append(absent.id)
        notices.append(
            f"{absent.id} was found in the balances, but motion, simulated with it, {why}: it was "
            "left out, and the search made again"
        )
        found = look({name: effect for name, effect in catalogue.items() if name not in gone})
    notices += found.notices
    return dataclasses.replace(found, contradicted=tuple(gone), notices=tuple(notices))


def _contradicted(found: Diagnosis) -> tuple[FoundEffect, str] | None:
    """An effect that motion contradicts, and how; None: it contradicts none."""
    return _absent(found) or _beyond_its_range(found) or _of_another_size(found)


def _of_another_size(found: Diagnosis) -> tuple[FoundEffect, str] | None:
    """The effect whose refined numbers explain least of the balances, if nothing; and what motion
    does with it.

    As two of opposite signs do that cancel in motion, of which balances see how they differ.
    """
    evidence = found.evidence
    if found.refinement is None or not isinstance(evidence, TwinEvidence):
        return None
    with limited():
        places = evidence.unseen([one.effect for one in found.effects])
    if not places:
        return None
    one = found.effects[places[0]]
    return one, f"gives it a size that explains nothing of them ({_sizes(one)})"


def _absent(found: Diagnosis) -> tuple[FoundEffect, str] | None:
    """The effect whose refined strengths are nearest to 0, by their errors, if they may be 0; and
    what motion does with it.
    """
    if found.refinement is None:
        return None
    count = len(found.effects)
    first = len(found.refinement.bundle.effects) - count + 1
    over_chance = [
        _over_chance(found.refinement, place, type(one.effect))
        for place, one in enumerate(found.effects, start=first)
    ]
    least = int(np.argmin(over_chance))
    if not over_chance[least] < 1.0:
        return None
    one = found.effects[least]
    return one, f"gives it no strength ({_sizes(one)})"


def _beyond_its_range(found: Diagnosis) -> tuple[FoundEffect, str] | None:
    """An effect that a refinement takes to a limit other than 0, where an error of the training
    tests rises, friction's scatter aside; and what motion does with it.

    As friction after rest grows without bound where it only has to be gone.
    """
    if found.refinement is None:
        return None
    for one in found.effects:
        if limits := ", ".join(_limits(one.effect)):
            if not found.refinement.rises:
                return None
            worse = "and training tests are simulated worse"
            return one, f"takes it to the limit of its range ({limits}) {worse}"
    return None


def _limits(effect: CatalogueEffect) -> list[str]:
    """The strengths at a limit of their range other than 0, with their values."""
    values = {q: float(getattr(effect, q.name)) for q in type(effect).strengths()}
    within = {q: q.around(value) for q, value in values.items()}
    return [
        f"{q.label} {number(value, 3)} {q.unit}".rstrip(" -")
        for q, value in values.items()
        if value and min(value - within[q][0], within[q][1] - value) <= AT_BOUND * abs(value)
    ]


def _over_chance(
    refinement: RefineResult,
    place: int,
    kind: type[CatalogueEffect],
    elsewhere: Mapping[str, float] | None = None,
) -> float:
    """Wald's statistic of an effect's strengths over what it has to exceed; infinite where no
    strength is known. `elsewhere`: strengths by name to take in place of the estimated ones.

    That is its critical value without the effect, and twice the log of how much of the prior the
    motion rules out: where it would show an effect far smaller than usual, it is more likely that
    there is none (the density ratio of Savage and Dickey: Verdinelli and Wasserman, JASA 90, 1995).
    The effect's shapes are held: without the effect they have no meaning, and a gap may be
    distinguishable from 0 even where it is confounded with the speed at which it is crossed.
    """
    of = {
        parameter.unknown.direction: i
        for i, parameter in enumerate(refinement.parameters)
        if parameter.informed
    }
    known = [q for q in kind.strengths() if (place, q.name) in of]
    strengths = [of[place, q.name] for q in known]
    shapes = [of[place, q.name] for q in kind.shapes() if (place, q.name) in of]
    if not strengths:
        return math.inf
    estimates = [refinement.parameters[i].estimate for i in strengths]
    values = [
        e.value if elsewhere is None else elsewhere[q.name]
        for q, e in zip(known, estimates, strict=True)
    ]
    z = np.array([v / e.std for v, e in zip(values, estimates, strict=True)])
    prior = np.diag([q.usual_size / e.std for q, e in zip(known, estimates, strict=True)])
    together = [*strengths, *shapes]
    inverse = np.linalg.pinv(refinement.correlation[np.ix_(together, together)])
    # Of the strengths with the shapes as they are: a block of the inverse of both.
    given_shapes = inverse[: len(z), : len(z)]
    ruled_out = float(np.linalg.slogdet(np.eye(len(z)) + prior @ given_shapes @ prior)[1])
    least = max(chi_squared_quantile(len(z), LEVEL), ruled_out)
    return float(z @ given_shapes @ z / least)


def _shown_too_little(
    balanced: Sequence[FoundEffect], refined: Sequence[FoundEffect], result: RefineResult
) -> str:
    """Of which effect motion says too little to judge it, with its refined strengths; else "".

    Its strength may be 0, but so it may be that of the balances, and motion would as likely as not
    have missed that: its errors are too large, as where friction that falls with speed makes an
    axis unstable whose controller is not in the model.
    """
    first = len(result.bundle.effects) - len(refined) + 1
    pairs = zip(balanced, refined, strict=True)
    for place, (before, after) in enumerate(pairs, start=first):
        kind = type(after.effect)
        names = [q.name for q in kind.strengths()]
        by_balances = {q: float(getattr(before.effect, q)) for q in names}
        by_motion = {q: float(getattr(after.effect, q)) for q in by_balances}
        moved = {q: by_motion[q] - value for q, value in by_balances.items()}
        over = [_over_chance(result, place, kind, v) for v in (by_motion, by_balances, moved)]
        if max(over) < 1.0:
            return f"motion says too little of {after.id} to judge it ({_sizes(after)})"
    return ""


def _sizes(found: FoundEffect) -> str:
    """An effect's strengths with their standard errors."""
    return ", ".join(
        f"{q.label} {number(e.value, 2)} +- {number(e.std, 1)} {q.unit}".rstrip(" -")
        for q in type(found.effect).strengths()
        if (e := found.estimates.get(q.name)) is not None
    )


def with_refined_numbers(
    diagnosis: Diagnosis,
    campaign: Campaign,
    extended: Bundle,
    catalogue: Catalogue,
    held_out_errors: Callable[[Bundle], Mapping[str, float]] | None,
    progress: Progress = no_progress,
) -> Diagnosis:
    """The diagnosis with its numbers, and the errors after, as a refinement has them.

    `extended` is the bundle with the effects found; `held_out_errors` are a bundle's by channel,
    in its unit, None where no test is held out. Where nothing was found, or the refinement does not
    hold, the diagnosis is as it was, with a notice that says why; so it is where the budget ends
    before the refinement has found numbers, while those of one that it cuts short count.
    """
    if not diagnosis.effects:
        return diagnosis
    evidence = diagnosis.evidence
    result = attempt(lambda: _numbers(campaign, extended, catalogue, evidence, progress))
    if isinstance(result, Failure):
        if result.out_of_budget:
            return diagnosis.with_missed(SearchStage.REFINEMENT, LATE)
        return _as_it_was(diagnosis, result.reason)
    errors = result.fits["fit"]
    if result.worse:
        why = f"the training tests would be simulated {result.worse}"
        kept = _as_it_was(diagnosis, why)
        return dataclasses.replace(kept, simulated=errors.before, misfits=result.misfits)
    count = len(diagnosis.effects)
    own = effects_from_bundle(result.bundle, catalogue)[-count:]
    refined = zip(diagnosis.effects, result.bundle.effects[-count:], own, strict=True)
    effects = tuple(_refined(effect, entry, new) for effect, entry, new in refined)  # type: ignore[arg-type]
    if silent := _shown_too_little(diagnosis.effects, effects, result):
        return dataclasses.replace(_as_it_was(diagnosis, silent), misfits=result.misfits)
    residual, notices = _errors_after(diagnosis, result.bundle, held_out_errors)
    if result.cut_short:
        diagnosis = diagnosis.with_missed(SearchStage.REFINEMENT, LATE)
    return dataclasses.replace(
        diagnosis,
        effects=effects,
        residual=residual,
        refinement=result,
        simulated=errors.after,
        misfits=result.misfits,
        notices=(*diagnosis.notices, *result.notices, *notices),
    )


def _errors_after(
    diagnosis: Diagnosis,
    refined: Bundle,
    held_out_errors: Callable[[Bundle], Mapping[str, float]] | None,
) -> tuple[dict[str, BeforeAfter], list[str]]:
    """The errors of held-out tests with a refined bundle, and notices. They only describe it: its
    numbers stand whether they can be worked out or not, and however long that takes.
    """
    if held_out_errors is None:
        notice = "errors before and after are those of the numbers before the refinement"
        return dict(diagnosis.residual), [notice] if diagnosis.residual else []
    with limited():
        after = attempt(lambda: held_out_errors(refined))
    if isinstance(after, Failure):
        return {}, [f"errors of held-out tests are not known: {after.reason}"]
    known = {
        name: dataclasses.replace(error, after=after[name])
        for name, error in diagnosis.residual.items()
        if math.isfinite(after.get(name, math.nan))
    }
    return known, []


def _numbers(
    campaign: Campaign,
    extended: Bundle,
    catalogue: Catalogue,
    evidence: ComponentEvidence,
    progress: Progress,
) -> RefineResult | Failure:
    """The refinement; why it failed where it did."""
    from sysid.refinement.refine import refine  # loads jax

    first = len(extended.effects) - len(evidence.effects)
    names = effect_names(extended.effects)[first:]
    plain = [f"{name}.{q.label}" for i, name in enumerate(names) for q in evidence.plain(i)]
    try:
        return refine(
            campaign,
            extended,
            fix=plain,
            catalogue=catalogue,
            progress=progress,
            by_differences=True,
            bench=evidence.bench_rows(),
        )
    except (InputError, NotIdentifiedError, RuntimeError) as error:
        return Failure(str(error))


def _as_it_was(diagnosis: Diagnosis, why: str) -> Diagnosis:
    notice = f"the numbers are those of the balances, not refined by simulation: {why}"
    notices = (*diagnosis.notices, notice)
    return dataclasses.replace(diagnosis, not_refined=why, notices=notices)


def _refined(found: FoundEffect, entry: EffectEntry, effect: CatalogueEffect) -> FoundEffect:
    estimates = {
        q.name: estimate
        for q in type(found.effect).quantities
        if isinstance(estimate := entry.parameters.get(q.label), Estimate)
    }
    return dataclasses.replace(found, effect=effect, estimates={**found.estimates, **estimates})


__all__ = ["Look", "with_refined_numbers", "without_contradicted"]
