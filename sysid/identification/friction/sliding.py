"""Coulomb and viscous friction from constant-effort trials (thesis 3.4.3, Table 3.4.2).

The balance of momentum over each trial's interval gives its mean friction at its mean speed,
even if the speed is not quite steady. The regression over trials must respect the design of
such tests: the experimenter sets the motor's effort, and friction scatters from trial to
trial. Speed, and the share of the effort that the moving air and the inertia take, depend on
that scatter, so that regressing effort on speed is biased. The set effort is therefore used as
the instrument for the speed; where the friction balances just the set effort, this is the
regression of speed on effort (inverse regression) and its intervals are Fieller's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sysid.errors import NotIdentifiedError
from sysid.estimation.covariance import JointCovariance, shrunk
from sysid.estimation.linear import (
    Estimate,
    FTest,
    LinearFit,
    fieller_interval,
    group_covariances,
    indicator,
    linear_fit,
    mean_estimate,
    nested_f_test,
    satterthwaite,
    t_p_value,
)
from sysid.estimation.quality import (
    FEWEST_REPEATS,
    SIGNIFICANT,
    FitQuality,
    repeated_scatter,
    repeats_lack_of_fit,
)
from sysid.identification.friction.clusters import Clusters, find_clusters
from sysid.identification.friction.effort import TrialUse
from sysid.io.motion import MotionUnits
from sysid.types import FloatArray

LEVEL_GAP = 0.03  # relative: set efforts closer than this are one level

LEVELS, WITHIN = "levels", "within trials"

ANOTHER_LEVEL = "give constant-effort trials (friction-sliding) at a second level of the effort"


@dataclass(frozen=True)
class SlidingPoints:
    """One row per trial, all (n,): direction of motion (+1, -1), the set effort, the mean
    friction effort and the mean speed (signed, N or Nm, m/s or rad/s). `laws` holds each
    trial's own friction at zero speed and slope over speed, where the speed is not steady."""

    labels: tuple[str, ...]
    direction: FloatArray
    set_effort: FloatArray
    friction: FloatArray
    speed: FloatArray
    laws: tuple[FloatArray, FloatArray] | None = None

    def __len__(self) -> int:
        return len(self.labels)


class FrictionLaw(Protocol):
    """Coulomb and viscous friction and an offset, as a fit gives them."""

    @property
    def coulomb(self) -> Estimate: ...
    @property
    def viscous(self) -> Estimate: ...
    @property
    def offset(self) -> Estimate: ...


@dataclass(frozen=True)
class SlidingFriction:
    """Coulomb and viscous friction over all trials; `offset` where both directions are present.

    `rmse` is in effort, `scatter` the standard deviation of a trial's friction relative to
    the prediction. `method` is `levels` (regression over trials) or `within trials` (the mean
    of each trial's own law, where the speed is not steady). `grouped`: each level has its
    own variance (at least three trials at each), else one relative variance is shared.
    `lack_of_fit` tests whether the levels' means deviate from the law of Coulomb and viscous
    friction by more than the scatter of the trials. `joint`: the covariance of the identified.
    """

    coulomb: Estimate
    viscous: Estimate
    offset: Estimate
    offset_p_value: float | None
    rmse: float
    scatter: float
    grouped: bool
    method: str
    clusters: tuple[Clusters, ...]
    lack_of_fit: FTest | None
    notices: tuple[str, ...]
    quality: FitQuality | None = None
    joint: JointCovariance | None = None


def missed_by(law: FrictionLaw, uses: Sequence[TrialUse]) -> tuple[FloatArray, FloatArray]:
    """Mean friction of the trials (n,) that have one, used or excluded, and its residual from a law
    of friction; in effort."""
    known = [use.values for use in uses if "friction" in use.values]
    friction, speed = (np.array([row[key] for row in known]) for key in ("friction", "speed"))
    offset = law.offset.value if law.offset.identified else 0.0
    told = law.coulomb.value * np.sign(speed) + law.viscous.value * speed + offset
    return friction, friction - told


def levels_of(set_effort: FloatArray) -> NDArray[np.intp]:
    """Number of each trial's level: magnitudes of set effort more than 3 % apart, (n,)."""
    size = np.abs(set_effort)
    order = np.argsort(size)
    steps = np.diff(size[order]) > LEVEL_GAP * size[order][1:]
    level = np.zeros(len(size), dtype=np.intp)
    level[order[1:]] = np.cumsum(steps)
    return level


def fit_sliding(points: SlidingPoints, units: MotionUnits) -> SlidingFriction:
    """Regression over trials, or the mean of their own laws where they have them.

    Raises NotIdentifiedError where all ran at one level.
    """
    if points.laws is not None:
        return _fit_laws(points, *points.laws, units)
    _require_levels(points)
    both = len(np.unique(points.direction)) == 2
    names = ["Coulomb friction", "viscous friction"] + (["offset"] if both else [])
    instruments = _instruments(points, both)
    if len(points) <= len(names):
        raise NotIdentifiedError(
            f"viscous friction: {len(points)} usable trials for {len(names)} parameters leave "
            "no estimate of the error; repeat the constant-effort trials"
        )
    # Friction scatters by a share of itself, so the error grows with it.
    weights = 1.0 / points.friction**2
    force = linear_fit(instruments, points.friction, weights, names)
    speed = linear_fit(instruments, points.speed, weights, names)
    ratios = _Ratios(force, speed, points)
    viscous = ratios.estimate(1, units.viscous_unit)
    coulomb = ratios.estimate(0, units.effort)
    offset, p_value = _offset_unknown(units), None
    if both:
        offset = ratios.estimate(2, units.effort)
        p_value = ratios.p_value(2)
    if not any(map(math.isfinite, viscous.interval)):
        raise NotIdentifiedError(
            "viscous friction: the levels of the set effort are too close for the scatter of the "
            "trials; give constant-effort trials at levels farther apart"
        )
    estimates = (coulomb, viscous, offset)
    joint = _joint(ratios.covariance(len(names)))
    return _finished(points, estimates, p_value, units, ratios.grouped, LEVELS, joint)


def _fit_laws(
    points: SlidingPoints, intercepts: FloatArray, slopes: FloatArray, units: MotionUnits
) -> SlidingFriction:
    """Mean of the trials' own laws, with errors from their scatter."""
    both = len(np.unique(points.direction)) == 2
    if len(points) < 2 + both:
        raise NotIdentifiedError(
            f"Coulomb and viscous friction: {len(points)} usable trials leave no estimate of "
            "the error; repeat the constant-effort trials"
        )
    columns = [points.direction] + ([np.ones(len(points))] if both else [])
    fit = linear_fit(np.column_stack(columns), intercepts)
    stds = np.sqrt(np.diag(fit.covariance))
    coulomb = Estimate.symmetric(float(fit.coefficients[0]), float(stds[0]), units.effort, fit.dof)
    offset, p_value = _offset_unknown(units), None
    if both:
        value, std = float(fit.coefficients[1]), float(stds[1])
        offset = Estimate.symmetric(value, std, units.effort, fit.dof)
        p_value = t_p_value(value / std, fit.dof) if std > 0.0 else 1.0
    viscous = mean_estimate(slopes, units.viscous_unit)
    joint = _joint(_covariance_of_laws(fit, slopes, points.direction))
    return _finished(points, (coulomb, viscous, offset), p_value, units, True, WITHIN, joint)


def _covariance_of_laws(fit: LinearFit, slopes: FloatArray, way: FloatArray) -> FloatArray:
    """(2 or 3, 2 or 3): Coulomb, viscous friction and offset, from each trial's law.

    A trial's friction at zero speed, along its motion, scatters together with its slope; `fit` is
    that of the signed intercepts.
    """
    n = len(slopes)
    left = np.vstack([way * fit.residuals, slopes - np.mean(slopes)])
    # Each of the two by its own degrees of freedom.
    scale = np.sqrt([fit.dof, n - 1])
    scatter = shrunk(left @ left.T / np.outer(scale, scale), fit.dof)
    influence = np.insert(way * fit.influence, 1, 1.0 / n, axis=0)
    kind = np.array([0, 1, 0])[: len(influence)]
    return np.asarray(influence @ influence.T * scatter[np.ix_(kind, kind)])


def _joint(matrix: FloatArray) -> JointCovariance:
    """Joint covariance of Coulomb and viscous friction and, where it is estimated, the offset."""
    return JointCovariance(("coulomb", "viscous", "offset")[: len(matrix)], matrix)


def _offset_unknown(units: MotionUnits) -> Estimate:
    """The offset of trials in one direction only."""
    return Estimate.unidentified(
        units.effort,
        "the trials run in one direction, where an offset cannot be distinguished from Coulomb "
        "friction; give constant-effort trials in the other direction",
    )


def _finished(
    points: SlidingPoints,
    estimates: tuple[Estimate, Estimate, Estimate],
    offset_p_value: float | None,
    units: MotionUnits,
    grouped: bool,
    method: str,
    joint: JointCovariance,
) -> SlidingFriction:
    """Residuals, clusters, lack of fit and notices of the fitted Coulomb, viscous and offset."""
    coulomb, viscous, offset = estimates
    residual = points.friction - (
        coulomb.value * points.direction
        + viscous.value * points.speed
        + (offset.value if offset.identified else 0.0)
    )
    relative = residual / points.friction
    dof = len(points) - 2 - offset.identified
    clusters = find_clusters(relative, levels_of(points.set_effort), points.labels)
    curved = _lack_of_fit(points, relative, offset.identified) if method == LEVELS else None
    return SlidingFriction(
        coulomb,
        viscous,
        offset,
        offset_p_value,
        float(np.sqrt(np.mean(residual**2))),
        float(np.sqrt(np.sum(relative**2) / dof)) if dof > 0 else math.inf,
        grouped,
        method,
        clusters,
        curved,
        _notices(offset, offset_p_value, clusters, curved, units),
        _quality(points, residual, curved, offset.identified, units),
        joint,
    )


def _quality(
    points: SlidingPoints,
    residual: FloatArray,
    curved: FTest | None,
    both: bool,
    units: MotionUnits,
) -> FitQuality:
    cells = 2 * levels_of(points.set_effort) + (points.direction > 0.0)
    return FitQuality.of(
        "friction of the trials",
        units.effort,
        points.friction,
        residual,
        has_constant=both,
        lack_of_fit=repeats_lack_of_fit(curved),
        scatter=repeated_scatter(residual, cells),
    )


def _instruments(points: SlidingPoints, both: bool) -> FloatArray:
    """Direction, set effort and, where both directions are present, 1; (n, 2 or 3)."""
    columns = [points.direction, points.set_effort]
    return np.column_stack([*columns, np.ones(len(points))] if both else columns)


def _require_levels(points: SlidingPoints) -> None:
    for way in np.unique(points.direction):
        if len(np.unique(levels_of(points.set_effort[points.direction == way]))) > 1:
            return
    raise NotIdentifiedError(
        "viscous friction: all constant-effort trials run at one level, which fixes only the sum "
        f"of Coulomb and viscous friction; {ANOTHER_LEVEL}"
    )


def _lack_of_fit(points: SlidingPoints, relative: FloatArray, both: bool) -> FTest | None:
    """F test of the residuals' means over level and direction, errors relative to friction."""
    instruments = _instruments(points, both)
    level = levels_of(points.set_effort)
    cells = indicator([f"{n}|{d:g}" for n, d in zip(level, points.direction, strict=True)])
    scale = 1.0 / np.abs(points.friction)[:, None]
    full = np.hstack([instruments, cells])
    return nested_f_test(full * scale, instruments * scale, relative * np.sign(points.friction))


def _notices(
    offset: Estimate,
    p_value: float | None,
    clusters: Sequence[Clusters],
    curved: FTest | None,
    units: MotionUnits,
) -> tuple[str, ...]:
    notices = [cluster.text for cluster in clusters]
    if curved is not None and curved.p_value < SIGNIFICANT:
        notices.append(
            "Coulomb and viscous friction alone do not describe the sliding tests: the levels "
            f"deviate from it by more than the scatter of the trials (F = {curved.statistic:.3g}, "
            f"p = {curved.p_value:.2g})"
        )
    if p_value is not None and p_value < 0.05:
        notices.append(
            f"friction differs with the direction: an offset of {offset.value:.3g} "
            f"{units.effort} (p = {p_value:.2g})"
        )
    return tuple(notices)


class _Ratios:
    """The structural parameters as ratios of reduced-form coefficients.

    Friction and speed are each regressed on the instruments (direction s, set effort T, 1):
    f = f_s s + f_T T + f_1, w = w_s s + w_T T + w_1. Then f = coulomb s + viscous w + offset
    gives viscous = f_T / w_T and coulomb = (f_s w_T - w_s f_T) / w_T, likewise the offset:
    ratios with one denominator, whose joint covariance comes from the scatter of friction
    and speed in each group of trials with its own variance.
    """

    def __init__(self, force: LinearFit, speed: LinearFit, points: SlidingPoints) -> None:
        self._force, self._speed = force.coefficients, speed.coefficients
        level = levels_of(points.set_effort)
        counts = np.bincount(level)
        self.grouped = bool(np.all(counts >= FEWEST_REPEATS))
        groups = level if self.grouped else np.zeros(len(points), dtype=np.intp)
        size = len(self._force)
        influence = np.vstack([force.influence, speed.influence])
        residuals = np.vstack(
            [np.tile(force.residuals, (size, 1)), np.tile(speed.residuals, (size, 1))]
        )
        self._shares, self._dofs = group_covariances(force, influence, residuals, groups)

    def _fraction(self, which: int) -> tuple[float, float, FloatArray]:
        """Numerator, denominator, and their covariance by group, (g, 2, 2)."""
        numerator, denominator, jacobian = self._terms(which)
        shares = np.einsum("ij,gjk,lk->gil", jacobian, self._shares, jacobian)
        return numerator, denominator, shares

    def _terms(self, which: int) -> tuple[float, float, FloatArray]:
        """Numerator, denominator, and their change with the coefficients, (2, 2 p)."""
        f, w, n = self._force, self._speed, len(self._force)
        jacobian = np.zeros((2, 2 * n))
        jacobian[1, n + 1] = 1.0
        if which == 1:
            jacobian[0, 1] = 1.0
            numerator = float(f[1])
        else:
            numerator = float(f[which] * w[1] - w[which] * f[1])
            jacobian[0, which], jacobian[0, 1] = w[1], -w[which]
            jacobian[0, n + which], jacobian[0, n + 1] = -f[1], f[which]
        return numerator, float(w[1]), jacobian

    def estimate(self, which: int, unit: str) -> Estimate:
        numerator, denominator, shares = self._fraction(which)
        ratio = numerator / denominator
        contrast = np.array([1.0, -ratio])
        variance = max(float(contrast @ shares.sum(axis=0) @ contrast), 0.0)
        interval = fieller_interval(numerator, denominator, shares, self._dofs)
        return Estimate(ratio, math.sqrt(variance) / abs(denominator), unit, interval)

    def covariance(self, count: int) -> FloatArray:
        """(count, count): of the first parameters together, to first order."""
        reach = np.array([self._influence(which) for which in range(count)])
        return np.asarray(reach @ self._shares.sum(axis=0) @ reach.T)

    def _influence(self, which: int) -> FloatArray:
        """(2 p,): the change of a parameter with each reduced-form coefficient."""
        numerator, denominator, jacobian = self._terms(which)
        contrast = np.array([1.0, -numerator / denominator])
        return np.asarray(contrast @ jacobian / denominator)

    def p_value(self, which: int) -> float:
        """p-value of the parameter being zero."""
        numerator, _, shares = self._fraction(which)
        variances = shares[:, 0, 0]
        if variances.sum() <= 0.0:
            return 1.0 if numerator == 0.0 else 0.0
        statistic = numerator / math.sqrt(float(variances.sum()))
        return t_p_value(statistic, satterthwaite(variances, self._dofs))
