"""The distribution of scores and sums where nothing is missing: screening the twins."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial

import numpy as np
from scipy.special import ndtr

from sysid.diagnosis.actuator.equation_error import BALANCES, CHANNELS
from sysid.diagnosis.actuator.screening import Projected, screen_group
from sysid.diagnosis.actuator.signatures import Candidate
from sysid.diagnosis.looked import Book
from sysid.parallel import attempt_in_threads, spend
from sysid.types import FloatArray

_SMALLEST_P = 1e-300
# Real noise may be this much stronger than the twins' before it counts as structure.
_NOISIEST = 1.6
# Only a gain beyond this many times the first twin's warrants screening the others.
_ASK_AGAIN = 2.0
# Of one beyond so many times that the others would say the same.
_BEYOND_DOUBT = 100.0
# A gain that noise alone may give.
_NOISE_ALONE = 10.0
# A rig's numerics may bias a gain's root by this factor against its twins'.
MARGIN = 1.3
# A balance's excess is structure beyond this many of the twins' spreads, and beyond this share of
# what the effects explained there.
_SPREADS = 8.0
_TOLERATED = 0.2


class Null:
    """Twins' residuals, and the gain of each effect on them where it is needed.

    `sums` maps a channel to the twins' whitened sums of squares a row, (twins,), `sensors` to
    that of the sensors' noise along the logs' own motion. `family` is the number of forms
    screened. `twins_of`: twins of a model with further effects, next to its residual.
    """

    def __init__(
        self,
        twins: Sequence[Projected],
        forms: Sequence[Candidate],
        sensors: Mapping[str, float],
        twins_of: Callable[[Projected], Sequence[Projected]] | None = None,
    ) -> None:
        self.sensors = dict(sensors)
        self._twins_of = twins_of
        self._twins = tuple(twins)
        self._forms = tuple(forms)
        self._gains: dict[str, FloatArray] = {}
        self.family = len(forms)
        self.sums = _by_channel(_mean_square, twins)
        self._expected = self.sums, _by_channel(typical_square, twins)

    def beside(self, base: Projected) -> Null:
        """The same, but that twins of this residual's own model say what is expected.

        A model that lacks an effect moves otherwise, and its twins leave another residual than one
        that holds it. Raises SimulationError, OutOfBudgetError.
        """
        twins = self._twins_of(base) if self._twins_of is not None else ()
        if not twins:
            return self
        found = copy.copy(self)
        found._expected = _by_channel(_mean_square, twins), _by_channel(typical_square, twins)
        return found

    def calibrate(self, gains: Mapping[str, float], least: float, book: Book) -> list[str]:
        """Screen the twins for these effects, given with their gains on the logs.

        Where the first twin gains as much, or next to nothing against it, or the gain is below
        `least`, the others are not screened. Returns those that could be screened. Raises
        OutOfBudgetError.
        """
        self._screen(gains, self._twins[:1], book)
        known = [e for e in gains if e in self._gains]
        first = {e: float(self._gains[e][0]) for e in known}
        in_doubt = [
            e
            for e in known
            if max(_ASK_AGAIN * first[e], least)
            < gains[e]
            <= _BEYOND_DOUBT * max(first[e], _NOISE_ALONE)
        ]
        self._screen(in_doubt, self._twins[1:], book)
        return known

    def take(self, gains: dict[str, FloatArray]) -> None:
        """Share gains of these twins that are known, and add to them."""
        self._gains = gains

    def release(self) -> None:
        """Drop the twins: no further effect can be calibrated, all that was found stays."""
        self._twins = ()

    def _screen(self, effects: Iterable[str], twins: Sequence[Projected], book: Book) -> None:
        known = 0 if twins and twins[0] is self._twins[0] else 1
        wanted = [e for e in effects if len(self._gains.get(e, ())) == known]
        forms = {e: [f for f in self._forms if f.id == e] for e in wanted}
        jobs = [(e, twin) for e in wanted for twin in twins]
        tried = attempt_in_threads(partial(screen_group, twin, forms[e]) for e, twin in jobs)
        spend(0)
        for e, results in book.results([e for e, _ in jobs], tried):
            best = max((r.gain for r in results), default=0.0)
            self._gains[e] = np.append(self._gains.get(e, np.zeros(0)), best)

    def gains(self, effect: str) -> FloatArray:
        """The best gain of an effect on each screened twin, (twins,)."""
        return self._gains[effect]

    def p_value(self, effect: str, gain: float, strengths: int) -> float:
        """Probability that any form in the catalogue gains as much where nothing is missing.

        The root of an effect's gain is taken as normal about its mean among the twins,
        which a real rig's own numerics may exceed by some share; the family is controlled by
        Bonferroni's bound.
        """
        roots = np.sqrt(np.maximum(self.gains(effect), float(strengths)))
        spread = max(1.0, float(np.std(roots, ddof=1)) if len(roots) > 1 else 1.0)
        distance = (math.sqrt(gain) - MARGIN * float(np.mean(roots))) / spread
        return min(1.0, max(self.family * float(ndtr(-distance)), _SMALLEST_P))

    def ratio(self, effect: str, gain: float) -> float:
        """A gain over the largest that a twin shows, or over that of noise alone."""
        return gain / max(float(np.max(self.gains(effect))), _NOISE_ALONE)

    def excess(self, base: Projected) -> dict[str, float]:
        """Each channel's sum of squares beyond that of any twin (`beside`: of the residual's own
        model); negative where below."""
        left = base.rest**2 - self.expected(base)
        return {name: float(np.sum(left[base.frame.rows(name)])) for name in CHANNELS}

    def expected(self, base: Projected) -> FloatArray:
        """The whitened square of each row, (rows,), in the twin with most."""
        found = np.zeros(len(base.rest))
        sums, typical = self._expected
        for name in CHANNELS:
            level = max(1.0, typical_square(base, name) / float(np.median(typical[name])))
            expected = float(np.max(sums[name])) * min(level, _NOISIEST)
            found[base.frame.rows(name)] = max(expected, self.sensors.get(name, 0.0))
        return found

    def structured(self, first: Projected, last: Projected) -> list[str]:
        """The balances that still hold structure beside effects (`last`).

        The real form of an effect is seldom the catalogue's: a remainder that is small against
        what the effects explained (from `first` on) is that difference, and not another effect.
        The few breakaways are for what acts on them alone.
        """
        before, after = self.excess(first), self.excess(last)
        found = []
        for channel in BALANCES:
            tolerated = _TOLERATED * (before[channel] - after[channel])
            if after[channel] >= max(_SPREADS * self.spread(last, channel), tolerated):
                found.append(channel)
        return found

    def spread(self, base: Projected, channel: str) -> float:
        """Spread of the twins' sums of squares in a channel: one standard deviation.

        Of those of the given model: the few twins beside an effect say little of it.
        """
        rows = base.frame.rows(channel)
        count = rows.stop - rows.start
        sums = self.sums[channel]
        relative = 1.48 * float(np.median(np.abs(sums - np.median(sums))))
        return float(count) * max(relative, math.sqrt(2.0 / max(count, 1)))


def typical_square(base: Projected, channel: str) -> float:
    """Whitened square per row in the median stretch of a channel: noise, where most are calm."""
    view = base.frame.windows[channel]
    if len(view) == 0:
        return 1.0
    squares = base.rest[base.frame.rows(channel)] ** 2
    counts = np.bincount(view.stretch)
    means = np.bincount(view.stretch, squares) / np.maximum(counts, 1)
    return float(np.median(np.repeat(means, counts)))


def _by_channel(
    square: Callable[[Projected, str], float], twins: Sequence[Projected]
) -> dict[str, FloatArray]:
    """(twins,) of each channel."""
    return {name: np.array([square(twin, name) for twin in twins]) for name in CHANNELS}


def _mean_square(base: Projected, channel: str) -> float:
    own = base.rest[base.frame.rows(channel)]
    return float(own @ own) / max(len(own), 1)
