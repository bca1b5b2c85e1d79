"""Which of two sets of effects motion speaks for, simulated with refined numbers.

What the balances hardly distinguish their own bias may decide. Each segment of the training tests
says how well it is simulated, whatever friction its test has of its own: what it is off by is one
draw in each channel, of an unknown size, as its rows err together.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtrc

from sysid.diagnosis.actuator.evidence import TwinEvidence
from sysid.diagnosis.result import Diagnosis, FoundEffect
from sysid.diagnosis.search_record import SearchStage
from sysid.estimation.law_evidence import ODDS
from sysid.estimation.multiple_tests import LEAST_P
from sysid.parallel import LATE
from sysid.types import FloatArray, Progress, no_progress

if TYPE_CHECKING:
    from sysid.diagnosis.actuator.search import Rival


def may_be_better(found: Diagnosis, rival: Rival) -> bool:
    """Whether a refinement of a rival may show it to be likelier, or leave doubt: not where motion
    is followed so well with the first that nothing is left which could pay for it."""
    if found.misfits is None:
        return True
    least = rival.behind - _behind(found) - _cost(found.misfits)
    return least < (-ODDS if _is_longer(rival.names, found) else ODDS)


def simulating_best(
    found: Diagnosis, rival: Diagnosis, progress: Progress = no_progress
) -> Diagnosis:
    """Of two diagnoses that the balances hardly distinguish, the one that they and the segments
    of the training tests, simulated with refined numbers, speak for.

    Where that leaves doubt, the other's effect may be there in the place of its own; one with more
    effects is taken beyond doubt only. Where a refinement does not hold, of as many effects those
    that simulate whole tests better; where that is unknown for the first, the other if its
    refinement holds.
    """
    evidence = _evidence_over(found, rival)
    best, worse = (rival, found) if _is_better(rival, found, evidence) else (found, rival)
    if best is rival:
        names = " and ".join(one.id for one in rival.effects)
        progress(f"{names}: motion with refined numbers is simulated better")
        best = _shown_by_motion(rival, found)
    elif rival.missed:  # the budget ended before it could be judged
        best = found.with_missed(SearchStage.RIVALS, LATE)
    return best if evidence is None or abs(evidence) >= ODDS else _in_doubt(best, worse)


def _is_better(rival: Diagnosis, found: Diagnosis, evidence: float | None) -> bool:
    """Whether a rival is better: by twice the log evidence against it, where that is known."""
    from sysid.refinement.whole_tests import times  # loads jax

    if rival.simulated is None:
        return False
    is_longer = _is_longer(rival.effects, found)
    if evidence is not None:
        return evidence < (-ODDS if is_longer else 0.0)
    if is_longer:
        return False
    if found.simulated is None:
        return rival.refinement is not None
    return times(found.simulated, rival.simulated) < 1.0


def _evidence_over(found: Diagnosis, rival: Diagnosis) -> float | None:
    """Twice the log evidence of a diagnosis over its rival: of the balances, and of the segments of
    motion with refined numbers. None where the rival's were not taken, or there are none."""
    own, other = found.misfits, rival.misfits
    if own is None or other is None or rival.refinement is None or own.shape != other.shape:
        return None
    return _behind(rival) - _behind(found) + _cost(other) - _cost(own)


def _cost(misfits: FloatArray) -> float:
    """Minus twice the log likelihood of segments by how many times the noise they are off,
    (segments, channels), over that of such as are off by the noise."""
    return 2.0 * float(np.nansum(np.log(np.maximum(misfits, 1.0))))


def _behind(one: Diagnosis) -> float:
    """By how much of twice the log evidence of the balances it is behind the set found first."""
    evidence = one.evidence
    return evidence.loop.search.behind if isinstance(evidence, TwinEvidence) else 0.0


def _is_longer(effects: Collection[object], found: Diagnosis) -> bool:
    return len(effects) > len(found.effects)


def _shown_by_motion(best: Diagnosis, found: Diagnosis) -> Diagnosis:
    """A diagnosis whose effects that motion added to those found are as likely by chance as motion
    says, where the balances say more."""
    if not _is_longer(best.effects, found) or best.misfits is None or found.misfits is None:
        return best
    known = {one.id for one in found.effects}
    added = [e for e in best.effects if e.id not in known]
    count = sum(len(type(e.effect).strengths()) for e in added)
    fall = _cost(found.misfits) - _cost(best.misfits)
    chance = max(float(chdtrc(count, fall)), LEAST_P)
    effects = tuple(
        dataclasses.replace(e, p_value=min(e.p_value, chance)) if e in added else e
        for e in best.effects
    )
    return dataclasses.replace(best, effects=effects)


def _in_doubt(best: Diagnosis, worse: Diagnosis) -> Diagnosis:
    """A diagnosis whose effect may be that of another one, which differs by that alone."""
    mine, others = ({one.id for one in d.effects} for d in (best, worse))
    if not len(mine - others) == len(others - mine) == 1:
        return best
    (name,) = others - mine
    effects = (e if e.id in others else _or_else(e, name) for e in best.effects)
    return dataclasses.replace(best, effects=tuple(effects))


def _or_else(effect: FoundEffect, name: str) -> FoundEffect:
    """An effect in whose place another one may be there."""
    names = tuple(sorted({*effect.ambiguous_with, name}))
    advice = type(effect.effect).tie_breaker
    return dataclasses.replace(effect, ambiguous_with=names, advice=advice)


__all__ = ["may_be_better", "simulating_best"]
