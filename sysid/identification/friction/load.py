"""The part of friction that grows with the load, from motion tests.

The effort balance has one more term, share |effort| sign(v): of the motor's effort, or of all that
the drive transmits. The effort is on both sides of the balance then, and what friction scatters is
in both: the effort that the motion needs is its instrument (two-stage least squares). Each test
has Coulomb and viscous friction and an offset of its own, so that friction that differs from test
to test is not taken for load; the tests' payloads may differ.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.balance.samples import COULOMB, INERTIA, NAMES, OFFSET, VISCOUS, MotionSamples
from sysid.errors import NotIdentifiedError
from sysid.estimation.covariance import JointCovariance
from sysid.estimation.jackknife import jackknife
from sysid.estimation.linear import Estimate
from sysid.estimation.quality import FEWEST_REPEATS
from sysid.identification.friction.motion import MotionFriction, fit_motion, separation
from sysid.io.motion import LOADS, MotionUnits
from sysid.parameters.effects import EffectEntry, entry_of
from sysid.types import FloatArray

_WANTED = (
    "the part of friction that grows with the load is not identified: give at least "
    f"{FEWEST_REPEATS} tests of motion that accelerates and brakes in both directions, best with "
    "several payloads (payload_mass_kg of each [[log]])"
)
_OWN = [COULOMB, VISCOUS, OFFSET]
# Noise of the acceleration times the inertia, as a share of Coulomb friction: only its square
# enters, and that is subtracted.
_MOST_NOISE = 0.05


@dataclass(frozen=True)
class LoadFriction:
    """The `share` of an effort that friction takes, `of` the motor's or of all that is transmitted.

    In a bundle it is the effect `load-dependent-friction`.
    """

    of: str
    share: Estimate

    @property
    def is_shown(self) -> bool:
        """Whether it is above 0 beyond its error: friction does not fall with the load."""
        return self.share.interval[0] > 0.0

    @property
    def notice(self) -> str:
        """Says that the tests show none."""
        low, high = self.share.interval
        return (
            f"friction that grows with the effort ({self.of}) is {self.share.value:.2g} of it "
            f"({low:.2g} to {high:.2g}): these tests show none, and friction is fitted without it"
        )

    def entry(self) -> EffectEntry:
        """The effect as listed in a bundle."""
        from sysid.plant.effects.friction import LoadDependentFriction

        effect = LoadDependentFriction(self.share.value, float(LOADS.index(self.of)))
        return entry_of(effect, {"load_friction": self.share})


def fit_load(
    samples: Sequence[MotionSamples], inertia: float | None, units: MotionUnits, of: str
) -> tuple[MotionFriction, LoadFriction]:
    """Friction from motion, and its part that grows with an effort (one of LOADS).

    `inertia` (kg m2, or kg) None: estimated too. Where the part is not above 0 beyond its error,
    friction is fitted without it. Raises NotIdentifiedError for fewer than three tests, for tests
    in one direction or at one speed, and where the effort follows friction's other terms.
    """
    if len(samples) < FEWEST_REPEATS or not separation(samples).full:
        raise NotIdentifiedError(_WANTED)
    load = LoadFriction(of, _share(samples, inertia, LOADS.index(of)))
    if not load.is_shown:
        return fit_motion(samples, inertia, units), load
    column = LOADS.index(of)
    left = [replace(s, effort=s.effort - load.share.value * s.carried[:, column]) for s in samples]
    return _with_error_of(load.share.std, fit_motion(left, inertia, units), samples, column), load


def is_clear(samples: Sequence[MotionSamples], inertia: float | None) -> bool:
    """Whether the acceleration's noise, times the inertia that moves, is small next to friction."""
    for chosen in samples:
        law, moving = _needed_law(chosen, inertia)
        noise = (moving + chosen.added) * math.sqrt(chosen.noise[INERTIA])
        if noise > _MOST_NOISE * abs(float(law[0])):
            return False
    return True


def _needed_law(chosen: MotionSamples, inertia: float | None) -> tuple[FloatArray, float]:
    """A test's own friction and offset (3,) without a part by load, and the inertia with them."""
    x, effort, columns = chosen.regressors, chosen.effort, [*_OWN, INERTIA]
    if inertia is not None:
        effort, columns = effort - inertia * x[:, INERTIA], _OWN
    law, *_ = np.linalg.lstsq(x[:, columns], effort, rcond=None)
    return np.asarray(law[:3], dtype=float), float(law[3]) if inertia is None else inertia


def _share(samples: Sequence[MotionSamples], inertia: float | None, column: int) -> Estimate:
    """The share, with the error that the tests' scatter shows."""
    parts = [_moments(chosen, inertia, column) for chosen in samples]
    normals, targets = (np.array(part) for part in zip(*parts, strict=True))

    def without(test: int) -> FloatArray:
        kept = np.arange(len(parts)) != test
        return np.linalg.solve(normals[kept].sum(axis=0), targets[kept].sum(axis=0))[:1]

    try:
        value = float(np.linalg.solve(normals.sum(axis=0), targets.sum(axis=0))[0])
        std = math.sqrt(float(jackknife(without, len(parts))[0, 0]))
    except np.linalg.LinAlgError:
        raise NotIdentifiedError(_WANTED) from None
    found = Estimate.symmetric(value, std, "-", len(parts) - 1.0)
    # A share is between 0 and 1: such an interval says nothing.
    if not found.interval[1] - found.interval[0] < 1.0:
        raise NotIdentifiedError(_WANTED)
    return found


def _moments(
    chosen: MotionSamples, inertia: float | None, column: int
) -> tuple[FloatArray, FloatArray]:
    """A test's products of instruments with unknowns (q, q) and with the effort (q,).

    Unknown are the share and, where not given, the inertia; the test's own friction and offset are
    projected out. The encoder's noise in speed and acceleration is subtracted, as in the fit of
    friction alone.
    """
    x, noise, rows = chosen.regressors, chosen.noise, len(chosen.effort)
    effort, further = chosen.effort, [INERTIA]
    if inertia is not None:
        effort, further = effort - inertia * x[:, INERTIA], []
    law, moving = _needed_law(chosen, inertia)
    needed = x[:, _OWN] @ law + moving * x[:, INERTIA] - chosen.helped[:, column]
    unknowns = np.column_stack([chosen.carried[:, column], x[:, further]])
    instruments = np.column_stack([np.abs(needed) * x[:, COULOMB], x[:, further]])
    own = x[:, _OWN]
    across = np.linalg.solve(own.T @ own - np.diag(rows * noise[_OWN]), own.T @ instruments)
    apart = instruments - own @ across
    normal, target = apart.T @ unknowns, apart.T @ effort
    # The acceleration's noise times an inertia is in the instruments and, negative, in the effort.
    along = float(np.sum(np.sign(needed) * x[:, COULOMB])) * (moving + chosen.added)
    common = np.array([along, *[float(rows)] * len(further)]) * noise[INERTIA]
    normal[:, 1:] -= common[:, None]
    return normal, target + common * ((inertia or 0.0) + chosen.added)


def _with_error_of(
    std: float, motion: MotionFriction, samples: Sequence[MotionSamples], column: int
) -> MotionFriction:
    """The fit with what the share's error `std` adds to the errors of the other numbers."""
    if motion.joint is None:
        return motion
    columns = [NAMES.index(name) for name in motion.joint.names]
    by_test = [
        np.linalg.lstsq(s.regressors[:, columns], s.carried[:, column], rcond=None)[0]
        for s in samples
    ]
    moved = std * np.mean(by_test, axis=0)
    wider = {
        name: getattr(motion, name).with_error(abs(float(own)))
        for name, own in zip(motion.joint.names, moved, strict=True)
        if getattr(motion, name) is not None
    }
    joint = JointCovariance(motion.joint.names, motion.joint.matrix + np.outer(moved, moved))
    return replace(motion, **wider, joint=joint)


__all__ = ["LoadFriction", "fit_load", "is_clear"]
