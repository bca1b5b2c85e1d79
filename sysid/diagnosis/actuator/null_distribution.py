"""What the balances leave where nothing is missing: the sums of twins."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from sysid.diagnosis.actuator.equation_error import BALANCES, CHANNELS
from sysid.diagnosis.actuator.projection import Projected
from sysid.signals import deviation_by_median
from sysid.types import FloatArray

# Real noise may be this much stronger than the twins' before it counts as structure.
_NOISIEST = 1.6
# A rig's numerics may bias a reduction's root by this factor against its twins'.
MARGIN = 1.3
TOLERATED = 0.2
"""Share of what effects explained in a balance that may remain: the real form of an effect is
seldom the catalogue's."""
# A balance's excess is structure beyond this many of the twins' spreads.
_SPREADS = 8.0


class Null:
    """Twins' residuals, and the squares that they leave.

    `sums` maps a channel to the twins' whitened sums of squares a row, (twins,), `sensors` to
    that of the sensors' noise along the logs' own motion. `twins_of`: twins of a model with further
    effects, next to its residual. `is_of_twins` false where none could be simulated: the twins are
    the logs then.
    """

    def __init__(
        self,
        twins: Sequence[Projected],
        sensors: Mapping[str, float],
        twins_of: Callable[[Projected], Sequence[Projected]] | None = None,
        *,
        is_of_twins: bool = True,
    ) -> None:
        self.is_of_twins = is_of_twins
        self.sensors = dict(sensors)
        self._twins_of = twins_of
        self._twins = tuple(twins)
        self.sums = _by_channel(_mean_square, twins)
        self._expected = self.sums, _by_channel(typical_square, twins)

    @property
    def twins(self) -> tuple[Projected, ...]:
        """The twins' residuals; `given`: of its residual's own model."""
        return self._twins

    def given(self, base: Projected) -> Null:
        """The same, but that twins of this residual's own model say what is expected.

        A model that lacks an effect moves otherwise, and its twins leave another residual than one
        that holds it. Raises SimulationError, OutOfBudgetError.
        """
        twins = self._twins_of(base) if self._twins_of is not None else ()
        if not twins:
            return self
        found = copy.copy(self)
        found._expected = _by_channel(_mean_square, twins), _by_channel(typical_square, twins)
        for name in CHANNELS:
            # With other friction a twin may break away where nothing can be read.
            if not any(len(twin.frame.windows[name]) for twin in twins):
                for own, given in zip(found._expected, self._expected, strict=True):
                    own[name] = given[name]
        found._twins = tuple(twins)
        return found

    def alone(self) -> Null:
        """What is expected without the twins themselves, which are large."""
        found = copy.copy(self)
        found._twins, found._twins_of = (), None
        return found

    def excess(self, base: Projected) -> dict[str, float]:
        """Each channel's sum of squares beyond that of any twin (`given`: of the residual's own
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
        """The balances that still hold structure given effects (`last`).

        A remainder that is small against what the effects explained (from `first` on) is how their
        form differs from the real one (`TOLERATED`), and not another effect.
        The few breakaways are for what acts on them alone.
        """
        before, after = self.excess(first), self.excess(last)
        found = []
        for channel in BALANCES:
            tolerated = TOLERATED * (before[channel] - after[channel])
            if after[channel] >= max(self.least_structure(last, channel), tolerated):
                found.append(channel)
        return found

    def least_structure(self, base: Projected, channel: str) -> float:
        """The squares in a channel beyond those of twins from which on they are structure."""
        return _SPREADS * self.spread(base, channel)

    def spread(self, base: Projected, channel: str) -> float:
        """Spread of the twins' sums of squares in a channel: one standard deviation.

        Of those of the given model: the few twins given an effect say little of it.
        """
        rows = base.frame.rows(channel)
        count = rows.stop - rows.start
        sums = self.sums[channel]
        relative = deviation_by_median(sums, float(np.median(sums)))
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
