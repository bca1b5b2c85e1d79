"""Oscillations of the torque balance that go on whatever the motion does, as hum of the mains.

To a resonance they look like a response of its own; what tells them apart is that a resonance
answers to the motion, and hum does not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sysid.diagnosis.actuator.equation_error import EFFORT, EquationError, channels_of
from sysid.diagnosis.actuator.misfit import ResidualChannel
from sysid.diagnosis.actuator.projection import Projected
from sysid.plant.effects.entry import CatalogueEffect
from sysid.types import FloatArray

# Of the mains, Hz; a fit of a resonance may end next to it.
_MAINS_HZ = (50.0, 60.0)
# Frequencies around these and an effect's own, Hz: as far as they may be off, as close as a test
# of some seconds tells frequencies apart. Of a rig slower than the reference rig closer.
_OFFSETS_HZ = np.linspace(-1.0, 1.0, 41)


@dataclass(frozen=True)
class Oscillation:
    """One frequency, Hz, in all tests, and the fall of the whitened squares with an amplitude and
    a phase of its own in each of `tests`.
    """

    frequency: float
    reduction: float
    tests: int

    @property
    def numbers(self) -> int:
        """How many numbers explain so much."""
        return 2 * self.tests + 1


def steady_oscillation(
    base: Projected, channel: ResidualChannel, effect: CatalogueEffect, fall: float
) -> Oscillation | None:
    """The oscillation, near a frequency of an effect or of the mains, for which there is more
    evidence than for the effect.

    `base` is the residual without the effect, `channel` its torque balance, `fall` by how much the
    effect lowers minus twice the log likelihood there. None where there is none, and for an effect
    that has no frequency or does not act there.
    """
    own = [float(getattr(effect, q.name)) for q in type(effect).quantities if q.unit == "Hz"]
    if not own or EFFORT not in channels_of(effect):
        return None
    centres = (*own, *_MAINS_HZ)
    offsets = _OFFSETS_HZ / max(run.time_scale for run in base.frame.traces.runs)
    tried = [_of_frequency(base, f) for centre in centres for f in centre + offsets]
    best = max(tried, key=lambda one: one.reduction)
    left = float(np.sum(base.rest[base.frame.rows(EFFORT)] ** 2))
    # Schwarz's criterion: each number costs the log of how many rows tell of it, in squares of the
    # noise. Where most of what is left is misfit those explain as little of it as noise does.
    more = (best.numbers - len(type(effect).fitted())) * math.log(channel.rows)
    after = left - best.reduction + more * channel.square
    return best if float(channel.cost(left) - channel.cost(after)) > fall else None


def _of_frequency(base: Projected, frequency: float) -> Oscillation:
    """Least squares of each test's residual on a sine and a cosine of its time."""
    frame = base.frame
    time = frame.traces.time[frame.rows_used[EFFORT].index]
    phase = 2.0 * math.pi * frequency * time
    sine, cosine = (_whitened(base, wave) for wave in (np.sin(phase), np.cos(phase)))
    rest, run = base.rest[frame.rows(EFFORT)], frame.windows[EFFORT].run
    tests, place = np.unique(run, return_inverse=True)

    def total(one: FloatArray, other: FloatArray) -> FloatArray:
        return np.asarray(np.bincount(place, weights=one * other, minlength=len(tests)))

    ss, sc, cc = total(sine, sine), total(sine, cosine), total(cosine, cosine)
    rs, rc = total(rest, sine), total(rest, cosine)
    determinant = ss * cc - sc**2
    # A test of a few windows may not tell sine from cosine.
    known = determinant > 1e-6 * ss * cc
    reductions = (cc * rs**2 - 2.0 * sc * rs * rc + ss * rc**2)[known] / determinant[known]
    return Oscillation(float(frequency), float(np.sum(reductions)), int(np.count_nonzero(known)))


def _whitened(base: Projected, effort: FloatArray) -> FloatArray:
    none = np.zeros(0)
    return base.frame.channel(EFFORT, EquationError(effort, none, none, none))


__all__ = ["Oscillation", "steady_oscillation"]
