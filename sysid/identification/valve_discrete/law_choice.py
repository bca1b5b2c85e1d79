"""Which flow law a valve obeys, by evidence on its tests: the thesis' two regimes or ISO 6358.

Both laws have as many numbers: the difference of their log likelihoods is the evidence. With what
is known of the valve without its flow control, that of the two in series is a third one of as many.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sysid import signals
from sysid.errors import NotIdentifiedError
from sysid.estimation.law_evidence import DECISIVE, twice_log_evidence
from sysid.estimation.quality import MOST_STD, root_mean_square
from sysid.identification.denied_ratio import denied_sentence, denied_ways
from sysid.identification.valve_discrete.curve import (
    CurveFit,
    fit_curves,
    fitted_valve,
    iso_names,
    thesis_names,
)
from sysid.identification.valve_discrete.held_chamber import DELAYS, DiscreteValve
from sysid.identification.valve_discrete.quality import qualities, rows_of
from sysid.identification.valve_discrete.trials import Piece
from sysid.parameters.valves import (
    AUTO,
    DIRECTIONS,
    ISO6358,
    LAWS,
    SERIES,
    THESIS,
    WAYS,
    LawDecision,
    RejectedLaw,
)
from sysid.plant.iso6358 import choked_flow
from sysid.types import BoolArray, FloatArray

# Critical ratios of real valves, from which the fit starts; the best fit counts.
_STARTS = (0.15, 0.35)
_DIRECTION = {"fill": "filling", "dis": "exhaust"}


@dataclass(frozen=True)
class LawChoice:
    """The law of each direction and why: twice the log evidence for ISO 6358 by direction.

    `laws`: by direction, "fill" and "dis"; `evidence` of directions of which both were fitted;
    `rms` Pa of each law by direction, over the rows in motion; `series`: twice the log evidence for
    a flow control in series over the better of the two (None: not fitted); `rejected`: the fits by
    the laws that were not chosen; `better`: by direction, of these the law that follows it
    decidedly better than the law that is kept, because it was asked for or as the directions
    disagree; `delays`: the fits from which delays are taken, by name, in place of the kept law's;
    `denied`: directions that no critical ratio of ISO 6358 follows, whatever the thesis' law does.
    """

    laws: Mapping[str, str]
    evidence: Mapping[str, float]
    rms: Mapping[str, Mapping[str, float]]
    asked: str = AUTO
    series: float | None = None
    rejected: Mapping[str, CurveFit] = field(default_factory=dict)
    better: Mapping[str, str] = field(default_factory=dict)
    delays: Mapping[str, CurveFit] = field(default_factory=dict)
    denied: tuple[str, ...] = ()

    @property
    def total(self) -> float:
        """Twice the log evidence for ISO 6358, of all directions that it can be the law of."""
        return float(sum(v for way, v in self.evidence.items() if way not in self.denied))

    @property
    def disagrees(self) -> bool:
        """Whether one direction is decidedly of one law and the other one of the other."""
        if SERIES in self.laws.values():
            return False
        values = [v for way, v in self.evidence.items() if way not in self.denied]
        against = bool(self.denied) or any(v < -DECISIVE for v in values)
        return against and any(v > DECISIVE for v in values)

    @property
    def undecided(self) -> bool:
        """Whether the tests do not distinguish the laws."""
        if SERIES in self.laws.values() or self.denied or self.disagrees:
            return False
        return bool(self.evidence) and abs(self.total) <= DECISIVE

    def why(self) -> str:
        """The choice in words: what was chosen, and by which evidence."""
        if SERIES in self.laws.values():
            return self._why_series()
        found = "; ".join(
            f"{_DIRECTION[way]} {self.rms[way][THESIS]:.3g} Pa rms by the thesis' law, "
            f"{self.rms[way][ISO6358]:.3g} Pa by ISO 6358"
            for way in self.evidence
        )
        if self.asked != AUTO:
            return f"the law was asked for (--law {self.asked}): {found}" if found else ""
        size = f"twice the log evidence for ISO 6358 {self.total:.3g}"
        if self.denied:
            return f"{denied_sentence(self.denied)} ({found}); --law iso6358 takes the other"
        if self.disagrees:
            return (
                f"the two directions obey different laws, so the thesis' is kept ({found}); "
                "--law iso6358 takes the other"
            )
        if self.undecided:
            return f"the laws are indistinguishable in these tests ({size}; {found})"
        if ISO6358 in self.laws.values():
            return f"ISO 6358 follows these tests better ({size}; {found})"
        return f"the thesis' law follows these tests better ({size}; {found})"

    def decision(self) -> LawDecision | None:
        """The choice as a bundle holds it; None where no law was rejected."""
        rejected = [
            RejectedLaw(law=law, numbers=_numbers(fit), rmse_pa=_rmse(fit))  # type: ignore[arg-type]
            for law, fit in self.rejected.items()
        ]
        return LawDecision(why=self.why(), rejected=rejected) if rejected else None

    def _why_series(self) -> str:
        if self.series is None:
            return "valve and flow control are identified in combination only (--law thesis-series)"
        size = f"twice the log evidence for it {self.series:.3g}"
        if self.asked != AUTO:
            return f"a flow control is in series (--law {self.asked}; {size})"
        better = "follows these tests better" if self.series > DECISIVE else "follows these tests"
        return f"the law of a flow control in series {better} ({size})"


def chosen(
    thesis: CurveFit, asked: str, series: CurveFit | None = None
) -> tuple[CurveFit, LawChoice]:
    """The fit by the law that is asked for or that the tests show, and why.

    `thesis`: the fit by the thesis' law; `asked`: one of LAWS, or "auto"; `series`: the fit with a
    flow control in series, where the valve is known without: it is chosen unless the tests are
    evidence against it, as its tests without a flow control say that there is one.
    """
    curves, choice = _of_two(thesis, AUTO if asked == SERIES else asked)
    if series is None:
        if asked != SERIES:
            return curves, choice
        # Their combination is fitted by the chamber's own pressure (thesis 3.6.2).
        return thesis, LawChoice(dict.fromkeys(WAYS, SERIES), {}, {}, asked)
    if asked not in (AUTO, SERIES):
        return curves, choice
    ways = series.problem.start.in_series
    total = sum(_evidence(curves, series, way) or 0.0 for way in ways)
    others = {THESIS: thesis, **choice.rejected}
    if curves is not thesis:
        others[ISO6358] = curves
    if asked == AUTO and total < -DECISIVE:
        rejected = {**choice.rejected, SERIES: series}
        return curves, dataclasses.replace(choice, series=total, rejected=rejected)
    laws = {way: SERIES if way in ways else THESIS for way in WAYS}
    known = dataclasses.replace(choice, laws=laws, asked=asked, series=total, rejected=others)
    return series, known


def _numbers(fit: CurveFit) -> dict[str, float]:
    """The numbers of the fitted law and its delays, by the names of `DiscreteValve`."""
    valve, problem = fitted_valve(fit), fit.problem
    names = dict.fromkeys(name for way in WAYS for name in problem.flow_names(way))
    return {name: float(getattr(valve, name)) for name in (*names, *DELAYS)}


def _rmse(fit: CurveFit) -> float:
    """Pa, over all rows."""
    return root_mean_square(fit.fit.residuals)


def _of_two(thesis: CurveFit, asked: str) -> tuple[CurveFit, LawChoice]:
    """`chosen` of the thesis' law and ISO 6358."""
    ways = [way for way in WAYS if set(thesis_names(way)) & set(thesis.problem.free)]
    plain = dict.fromkeys(WAYS, THESIS)
    if not ways or (asked == THESIS and not _misses_more_than_noise(thesis)):
        return thesis, LawChoice(plain, {}, {}, asked)
    iso = iso_fit(thesis, ways)
    if iso is None:
        if asked == ISO6358:
            raise NotIdentifiedError(
                "no critical ratio and conductance of ISO 6358 follow these tests: use --law thesis"
            )
        return thesis, LawChoice(plain, {}, {}, asked)
    known = _evidences(thesis, iso, ways)
    if asked == ISO6358 or any(value > DECISIVE for value in known.values()):
        iso = _with_indices(iso, ways)
        known = _evidences(thesis, iso, ways)
    rms = {way: {THESIS: _rms(thesis, iso, way), ISO6358: _rms(iso, thesis, way)} for way in known}
    takes_iso = {way: ISO6358 if way in ways else THESIS for way in WAYS}
    ratios = {way: iso_names(way)[1] for way in known}
    denied = denied_ways(iso.fit, ratios, lambda way: _misses_more_than_noise(iso, [way]))
    choice = LawChoice(takes_iso, known, rms, asked, denied=denied)
    better = asked == AUTO and choice.total > DECISIVE and not choice.disagrees
    if asked == ISO6358 or better:
        return _with_delays_of_the_better(iso, choice, thesis)
    return _with_delays_of_the_better(thesis, dataclasses.replace(choice, laws=plain), iso)


def _misses_more_than_noise(curves: CurveFit, ways: Iterable[str] = WAYS) -> bool:
    """Whether the law misses one of these directions by more than the sensor's noise."""
    found, names = qualities(curves), dict(zip(WAYS, DIRECTIONS, strict=True))
    return any(found[names[w]].lack_of_fit.is_significant for w in ways if names[w] in found)


def _with_delays_of_the_better(
    kept: CurveFit, choice: LawChoice, rejected: CurveFit
) -> tuple[CurveFit, LawChoice]:
    """The law that is kept, and the choice. A direction that the rejected law follows decidedly
    better has the delay of that law: when a valve opens does not depend on its flow, and a wrong
    law moves the delay to make good for its curve. The rest is fitted again with it."""
    name = ISO6358 if THESIS in choice.laws.values() else THESIS
    sign = 1.0 if name == ISO6358 else -1.0
    better = {
        way: name
        for way, value in choice.evidence.items()
        if sign * value > DECISIVE and not (name == ISO6358 and way in choice.denied)
    }
    if choice.asked == AUTO and not choice.disagrees:
        better = {}
    found = dataclasses.replace(choice, rejected={name: rejected}, better=better)
    delays = [delay for way, delay in zip(WAYS, DELAYS, strict=True) if way in better]
    held = [d for d in delays if d in kept.problem.free and rejected.estimate(d)[0].identified]
    if not held:
        return kept, found
    theirs: dict[str, Any] = {name: rejected.fit[name] for name in held}
    start = dataclasses.replace(fitted_valve(kept), **theirs)
    free = [n for n in kept.problem.free if n not in held]
    again = fit_curves(kept.problem.pieces, start, free)
    rms = {
        way: {**own, choice.laws[way]: _rms(again, rejected, way)}
        for way, own in choice.rms.items()
    }
    return again, dataclasses.replace(found, delays=dict.fromkeys(held, rejected), rms=rms)


def iso_fit(thesis: CurveFit, ways: Sequence[str]) -> CurveFit | None:
    """The fit with ISO 6358 in these directions, from where the thesis' law ended."""
    problem = thesis.problem
    free = [name for name in problem.free if name in DELAYS]
    for way in ways:
        _, unchoked = thesis_names(way)
        conductance, ratio, _ = iso_names(way)
        free += [conductance] + ([ratio] if unchoked in problem.free else [])
    best = None
    for ratio_start in _STARTS:
        start = _iso_start(thesis, ways, ratio_start)
        found = fit_curves(problem.pieces, start, free)
        if not math.isfinite(found.fit.sum_of_squares):
            continue
        if best is None or found.fit.sum_of_squares < best.fit.sum_of_squares:
            best = found
    return best if best is None else _with_ratios(best, ways)


def _with_ratios(iso: CurveFit, ways: Sequence[str]) -> CurveFit:
    """The fit with each critical ratio that its tests show, though by the thesis' law, whose
    boundary is at 0.53, all of their flow in that direction would be choked."""
    for way in ways:
        _, ratio, _ = iso_names(way)
        if ratio in iso.problem.free:
            continue
        found = fit_curves(iso.problem.pieces, fitted_valve(iso), [*iso.problem.free, ratio])
        own, _ = found.estimate(ratio)
        if found.fit.converged and own.identified and own.std <= MOST_STD:
            iso = found
    return iso


def _with_indices(iso: CurveFit, ways: Sequence[str]) -> CurveFit:
    """The fit with a subsonic index of its own in each direction whose tests are evidence for one;
    else that of the standard, 1/2."""
    problem = iso.problem
    free = [way for way in ways if iso_names(way)[1] in problem.free]
    while free:
        names = [*problem.free, *(iso_names(way)[2] for way in free)]
        found = fit_curves(problem.pieces, fitted_valve(iso), names)
        shown = [way for way in free if _shows_index(iso, found, way)]
        if shown == free:
            return found
        free = shown
    return iso


def _shows_index(fixed: CurveFit, free: CurveFit, way: str) -> bool:
    """Whether the tests are evidence for an index of its own and identify it."""
    _, ratio, index = iso_names(way)
    if not free.fit.converged or {ratio, index} & set(free.fit.diagnosis.at_bound):
        return False
    value, _ = free.estimate(index)
    evidence = _evidences(fixed, free, [way]).get(way, 0.0)
    return evidence > DECISIVE and value.identified and value.std < MOST_STD * value.value


def _evidences(one: CurveFit, other: CurveFit, ways: Sequence[str]) -> dict[str, float]:
    """Twice the log evidence for the other in each direction with rows in motion; a number that it
    has more, the index, takes the log of their count (Schwarz)."""
    found = {}
    for way in ways:
        evidence = _evidence(one, other, way)
        if evidence is None:
            continue
        if iso_names(way)[2] in other.problem.free:
            pieces = enumerate(one.problem.pieces)
            rows = sum(np.count_nonzero(rows_of(way, p, (one, other), i)) for i, p in pieces)
            evidence -= math.log(rows)
        found[way] = evidence
    return found


def _iso_start(thesis: CurveFit, ways: Sequence[str], ratio: float) -> DiscreteValve:
    """A valve of ISO 6358 with the mean choked flow of the thesis' law."""
    valve, pieces = fitted_valve(thesis), thesis.problem.pieces
    per_pressure = float(np.mean([choked_flow(1.0, 1.0, p.chamber.temperature) for p in pieces]))
    supply = float(np.mean([p.supply for p in pieces]))
    changes: dict[str, Any] = {}
    for way in ways:
        conductance, name, _ = iso_names(way)
        flow = getattr(valve, thesis_names(way)[0])
        # Choked exhaust falls from the highest pressure to the choked boundary.
        highest = float(np.mean([np.max(p.pressure) for p in pieces]))
        rest = float(np.mean([p.atmosphere for p in pieces]))
        upstream = pieces[0].chamber.supply_reference if way == "fill" else 0.5 * (highest + rest)
        changes |= {conductance: flow / (per_pressure * max(upstream, 0.1 * supply)), name: ratio}
    return dataclasses.replace(valve, **changes)


def _evidence(one: CurveFit, other: CurveFit, way: str) -> float | None:
    """Twice the log evidence for the other in one direction, on the first's tests, which begin the
    other's; None without rows in motion.

    A valve's flow differs a little from test to test: what such a factor leaves in a test is no
    fault of either law, and would make a whole test's residual one independent sample.
    """
    old, new, least = [], [], []
    for index, piece in enumerate(one.problem.pieces):
        rows = rows_of(way, piece, (one, other), index)
        old.append(_without_own_factor(piece, one.residuals(index), rows))
        new.append(_without_own_factor(piece, other.residuals(index), rows))
        # A record finer than its sensor's noise shows no more than that.
        least.append(0.1 * piece.noise)
    return twice_log_evidence(old, new, least)


def _without_own_factor(piece: Piece, residuals: FloatArray, rows: BoolArray) -> FloatArray:
    """The rows' residuals, Pa, less what a factor of the test's flow explains of them: with a flow
    larger by e the fitted pressure p is ahead by e t dp/dt, t since the valve switched."""
    time = piece.chamber.time
    rate = np.gradient(piece.pressure + residuals, time)
    ahead = np.zeros(len(time))
    for first, stop in signals.runs(rows):
        ahead[first:stop] = (time[first:stop] - time[first]) * rate[first:stop]
    own, along = residuals[rows], ahead[rows]
    size = float(along @ along)
    return np.asarray(own - along * (float(along @ own) / size) if size > 0.0 else own)


def _rms(fit: CurveFit, other: CurveFit, way: str) -> float:
    """Pa, over the rows of a direction in motion."""
    parts = [
        fit.residuals(i)[rows_of(way, piece, (fit, other), i)]
        for i, piece in enumerate(fit.problem.pieces)
    ]
    return root_mean_square(np.concatenate(parts))


__all__ = ["AUTO", "LAWS", "SERIES", "LawChoice", "chosen", "iso_fit"]
