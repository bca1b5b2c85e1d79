"""Suspects: effects that explain more of the logs' residual than of the twins'."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from scipy.special import chdtrc

from sysid.diagnosis.actuator.null_distribution import Null
from sysid.diagnosis.actuator.screening import Explained
from sysid.diagnosis.looked import Book
from sysid.diagnosis.search import Tried

SIGNIFICANCE = 1e-3
MOST_SUSPECTS = 5
# So many more in balances that the first does not reach.
_MOST_APART = 2
# A suspect whose signature explains less than this share of the best one's is not refitted.
WORTH_REFITTING = 0.15
# The twins are screened for this many effects at most, those that gain most.
_CALIBRATED = 14
CLEAR_RATIO = 2.5


@dataclass(frozen=True)
class Suspect(Tried):
    """An effect that was screened: `ratio` of its gain over the twins' largest.

    `is_fitted`: whether its numbers were fitted; `refitted`: what it gained then, None where the
    tests do not agree on it, or nothing was added.
    """

    ratio: float
    is_fitted: bool = False
    refitted: float | None = None


def suspects_of(best: Mapping[str, Explained], null: Null, book: Book) -> tuple[Suspect, ...]:
    """Effects whose gain noise alone is unlikely to give, judged by the twins; the best first."""
    remarkable = [
        name
        for name, result in best.items()
        if null.family * chdtrc(len(result.coefficients), result.gain) < SIGNIFICANCE
    ][:_CALIBRATED]
    gains = {name: best[name].gain for name in remarkable}
    known = null.calibrate(gains, WORTH_REFITTING * max(gains.values(), default=0.0), book)
    found = [
        Suspect(
            name,
            best[name].gain,
            null.p_value(name, best[name].gain, len(best[name].coefficients)),
            null.ratio(name, best[name].gain),
        )
        for name in known
    ]
    return tuple(sorted(found, key=lambda s: -s.gain))


def worth_refitting(
    suspects: Sequence[Suspect], reached: Mapping[str, frozenset[str]]
) -> list[str]:
    """Those that gain most, and most of those in a balance which the first does not reach."""
    found: list[str] = []
    apart = [s for s in suspects if reached[s.id] - reached[suspects[0].id]]
    for some, most in ((suspects, MOST_SUSPECTS), (apart, _MOST_APART)):
        passing = [s.id for s in some if _passes(s, some[0])]
        found += [name for name in passing[:most] if name not in found]
    return found


def _passes(suspect: Suspect, best: Suspect) -> bool:
    """Whether a suspect gains more than the twins, and enough to be refitted."""
    return (
        suspect.p_value < SIGNIFICANCE
        and suspect.ratio > CLEAR_RATIO
        and suspect.gain > WORTH_REFITTING * best.gain
    )


__all__ = [
    "CLEAR_RATIO",
    "MOST_SUSPECTS",
    "SIGNIFICANCE",
    "WORTH_REFITTING",
    "Suspect",
    "suspects_of",
    "worth_refitting",
]
