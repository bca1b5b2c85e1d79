"""Friction and inertia from any motion by inverse dynamics (Janot, Gautier, Brunot 2019).

The effort balance of `balance/samples` is linear in its parameters (`motion_regression`). Motion in
one direction or at one speed identifies sums of the parameters (`estimation/combinations`), which
are fitted in their place. Samples at low speed and after reversals are excluded where the law of
the others does not predict them (`low_speed`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid import signals
from sysid.balance.motion import (
    FilteredMotion,
    cutoff_for_fast,
    default_cutoff,
    fastest_cutoff,
)
from sysid.balance.samples import (
    COULOMB,
    INERTIA,
    NAMES,
    OFFSET,
    VISCOUS,
    MotionSamples,
    motion_samples,
    only_way,
    tells_speeds,
)
from sysid.errors import NotIdentifiedError
from sysid.estimation.combinations import (
    Combination,
    Separation,
    combined,
    unidentified,
)
from sysid.estimation.covariance import JointCovariance, shrunk
from sysid.estimation.jackknife import jackknife
from sysid.estimation.linear import UNKNOWN, Estimate, LinearFit, Variance, satterthwaite
from sysid.estimation.quality import (
    FEWEST_REPEATS,
    FEWEST_ROWS,
    ExcludedData,
    FitQuality,
    runs_test,
    spread,
)
from sysid.identification.friction.effort import TrialUse
from sysid.identification.friction.low_speed import SlidingLimits, bins_of_speed, sliding_only
from sysid.identification.friction.motion_regression import (
    MOST_NOISE,
    WeightedRows,
    inflation,
    own_variance,
    regression,
    scaled,
)
from sysid.io.motion import MotionUnits
from sysid.parameters.possible import stated
from sysid.recording.friction_kind import MOTION
from sysid.recording.recording import Recording
from sysid.signals import MIN_SAMPLES
from sysid.types import FloatArray

# A trial's variance inflation beyond which its parameters cannot be distinguished in practice.
_MOST_INFLATION = 100.0
# Share of the acceleration's squares up to which its noise, known to some tens of per cent as
# counts are not white, is no error of an inertia that matters.
_CLEAR = 0.1
HARDLY_MOVES = "it hardly moves"
_BINS = 10
_LATE = "an effort that acts late in the log shows as one: check the channels' times"
_LOWERED = (
    "friction from motion: the filter's cut-off is {:.3g} Hz, at which the acceleration exceeds "
    "the position's noise, so that the inertia is identified"
)
_NAMES = ("Coulomb friction", "viscous friction", "offset", "inertia")


@dataclass(frozen=True)
class MotionFriction:
    """Friction from motion; `inertia` is None where the rig file's was used.

    `combinations` are the sums that are identified where the parameters are not. `explained` is
    the share of the filtered effort's variance that the law explains (R2); `both_ways` whether
    the motion has two directions; `joint` the covariance of what is fitted; `repeats` the relative
    variance of friction from one test to the next.
    """

    coulomb: Estimate
    viscous: Estimate
    offset: Estimate
    inertia: Estimate | None
    rmse: float
    samples: int
    apart: bool
    explained: float
    notices: tuple[str, ...] = ()
    combinations: tuple[Combination, ...] = ()
    both_ways: bool = True
    limits: SlidingLimits | None = None
    quality: FitQuality | None = None
    joint: JointCovariance | None = None
    repeats: Variance = UNKNOWN


@dataclass(frozen=True)
class _Found:
    """The fitted columns: values, standard errors, degrees of freedom (p,), covariance (p, p)."""

    values: FloatArray
    stds: FloatArray
    dofs: FloatArray
    matrix: FloatArray


def usable_motion(
    trials: Sequence[Recording], cutoff_hz: float, notices: list[str]
) -> tuple[list[MotionSamples], list[TrialUse]]:
    """The samples of the trials that move, and the outcome of every trial."""
    uses, samples = [], []
    for trial in trials:
        use = TrialUse(trial.label, trial.source, MOTION)
        uses.append(use)
        if len(trial) < MIN_SAMPLES:
            use.exclude("it is too short")
        else:
            chosen = motion_samples(trial, cutoff_hz)
            use.values = {"samples": float(len(chosen.effort)), "rest_speed": chosen.rest_speed}
            if len(chosen.effort) < MIN_SAMPLES:
                use.exclude(_why_few(trial, chosen, cutoff_hz))
            else:
                samples.append(chosen)
        if not use.used:
            notices.append(f"{use.title}: excluded from friction from motion, {use.reason}")
    return samples, uses


def common_cutoff(tests: Sequence[Recording], highest_hz: float) -> float:
    """The highest cut-off up to `highest_hz`, Hz, at which each test's motion exceeds its noise."""
    cutoffs = (default_cutoff(test, highest_hz) for test in tests if len(test) > 1)
    return min(cutoffs, default=highest_hz)


def usual_cutoff(tests: Sequence[Recording], notices: list[str]) -> float:
    """`common_cutoff` up to the filter's usual one, Hz, or above it for a fast motion, with a
    notice where it is another."""
    usual = signals.DEFAULT_CUTOFF_HZ
    cutoff = common_cutoff(tests, usual)
    if cutoff == usual:
        cutoff = cutoff_for_fast([test for test in tests if len(test) >= MIN_SAMPLES], usual)
    if cutoff > usual:
        notices.append(
            f"friction from motion: the filter's cut-off is {cutoff:.3g} Hz, as the motion changes "
            f"too fast for {usual:g} Hz"
        )
    if cutoff < usual:
        notices.append(
            f"friction from motion: the filter's cut-off is {cutoff:.3g} Hz; faster "
            "motion is lost in the noise or the sampling of the position"
        )
    return cutoff


def moving_samples(
    trials: Sequence[Recording], cutoff_hz: float, inertia: float | None, notices: list[str]
) -> tuple[list[MotionSamples], list[TrialUse], float]:
    """`usable_motion` at a cut-off, Hz, at which an inertia that is not given shows; and that.

    What the inertia takes of an effort is not nothing because the encoder's noise hides the
    acceleration: a longer filter leaves less of the noise, at the price of fewer samples. As given
    where none shows it, or where it would cost a test.
    """
    said: list[str] = []
    samples, uses = usable_motion(trials, cutoff_hz, said)
    found, cutoff = samples, cutoff_hz
    while inertia is None and found and not _accelerates(found, _CLEAR):
        cutoff *= 0.5
        lower: list[str] = []
        found, others = usable_motion(trials, cutoff, lower)
        if len(found) < len(samples):
            break
        if _accelerates(found, _CLEAR):
            notices += [*lower, _LOWERED.format(cutoff)]
            return found, others, cutoff
    notices += said
    return samples, uses, cutoff_hz


def _accelerates(samples: Sequence[MotionSamples], most: float = MOST_NOISE) -> bool:
    """Whether of the squares of the trials' acceleration at most this share is noise."""
    return _shows([s.regressors[:, INERTIA] for s in samples], samples, INERTIA, most)


def _why_few(trial: Recording, chosen: MotionSamples, cutoff_hz: float) -> str:
    """Why a test has few samples that count: it rests, or its rows are too far apart.

    The latter where the time for which it moves would give enough of them at the filter's usual
    cut-off, which the sampling does not allow, nor does the noise demand a lower one.
    """
    speed = np.abs(FilteredMotion(trial, cutoff_hz).speed)
    moves = (speed > chosen.rest_speed) & trial.inside & ~trial.lost
    enough_s = MIN_SAMPLES / (signals.PER_LENGTH * signals.DEFAULT_CUTOFF_HZ)
    fastest = fastest_cutoff(trial)
    is_slow = fastest < signals.DEFAULT_CUTOFF_HZ and cutoff_hz >= 0.99 * fastest
    moved_s = np.count_nonzero(moves) * trial.period
    if moved_s < enough_s and 2 * np.count_nonzero(moves) > len(moves):
        return (
            f"it moves, but for {moved_s:.3g} s only: {len(chosen.effort)} samples remain clear of "
            f"its ends and reversals by the filter's length, and {MIN_SAMPLES} are needed; record "
            "longer motion"
        )
    if not is_slow or moved_s < enough_s:
        return HARDLY_MOVES
    return (
        f"it moves, but is sampled too slowly: with {trial.stride * trial.period:.3g} s from one "
        f"reading to the next {len(chosen.effort)} samples remain clear of its rests and reversals "
        f"by the filter's length, and {MIN_SAMPLES} are needed"
    )


def fit_motion(
    samples: Sequence[MotionSamples],
    inertia: float | None,
    units: MotionUnits,
    repeats: Variance = UNKNOWN,
) -> MotionFriction:
    """Coulomb, viscous, offset, and the inertia unless it is given (kg m2, or kg).

    At least three trials are fitted one by one: the mean is reported, with the error from the
    scatter of the trials. Two are fitted one by one as well, and weighted by their errors: fitted
    together, a friction that differs from one to the other would be taken for one that grows with
    the speed. Trials that do not identify everything alone are fitted together. Errors of fewer
    than three allow for autocorrelated residuals, and for friction that differs from test to test
    as far as these tests and the ramps to breakaway (`repeats`, its relative variance) show it.
    What the motion does not separate is given as combinations. An inertia that comes out below
    zero is held at zero, where physics ends, and the rest is fitted with that. Raises
    NotIdentifiedError where there are no samples, or where they identify not even these.
    """
    found = _fitted(samples, inertia, units, repeats)
    free = found.inertia
    if inertia is not None or free is None or not free.value < 0.0:
        return found
    held = _fitted(samples, 0.0, units, repeats)
    said = f"left free, {stated(units.key('inertia'), free)}, and none is below zero"
    with_it = "it is held at 0, and friction is fitted with that"
    if free.interval[1] < 0.0:
        why = f"{said}; {_LATE}, or declare [inertia] {units.rig_inertia}"
        none = Estimate.unidentified(units.inertia_unit, why)
        line = f"friction from motion: {said}: {with_it}; {_LATE}"
        return replace(held, inertia=none, notices=(*held.notices, line))
    # The data allow it, within its error: what cannot be negative is none, as far as they show.
    none = Estimate(0.0, free.std, free.unit, (0.0, free.interval[1]))
    line = f"friction from motion: {said}: {with_it}"
    return replace(held, inertia=none, notices=(*held.notices, line))


def _fitted(
    samples: Sequence[MotionSamples], inertia: float | None, units: MotionUnits, repeats: Variance
) -> MotionFriction:
    """`fit_motion`, whatever the sign of the inertia."""
    if not samples:
        raise NotIdentifiedError(
            "Coulomb and viscous friction: the shaft hardly moves in these tests; give motion "
            "tests that cross the stroke in both directions"
        )
    shape = separation(samples)
    if not shape.both:
        samples = [s.kept(s.speed * shape.way > 0.0) for s in samples]
        samples = _long_enough(samples)
    model = _Model.of(samples, inertia, shape)
    limits, given = SlidingLimits(), samples
    if shape.speeds:
        samples, limits = sliding_only(samples, model.law, model.separates)
        samples = _long_enough(samples)
    fits = model.apart(samples)
    apart = fits is not None and len(fits) >= FEWEST_REPEATS
    pooled = model.regression(samples)
    own = model.repeats(samples, model.start(pooled, fits))
    repeats = own.pooled(repeats)
    found = model.estimated(samples, pooled, fits, repeats)
    if VISCOUS in model.columns:
        found = model.with_model_error(samples, found, None if fits is None or apart else repeats)
    if not apart:
        found = model.of_any_test(found, repeats, len(samples))
    repeated = apart or repeats.dof > 0.0
    result = _finished(samples, given, model, apart, repeated, found, limits, units)
    return replace(result, repeats=own)


def _long_enough(samples: Sequence[MotionSamples]) -> list[MotionSamples]:
    """Trials with enough samples for their own residual variance."""
    return [s for s in samples if len(s.effort) >= FEWEST_ROWS]


def separation(samples: Sequence[MotionSamples]) -> Separation:
    """Whether the motion has both directions and several speeds."""
    way = only_way(np.concatenate([s.speed for s in samples]))
    speeds = tells_speeds([s.speed for s in samples], [s.load for s in samples])
    return Separation(not way, speeds, way or 1.0)


@dataclass(frozen=True)
class _Model:
    """Which regressors are fitted (`columns`), and the inertia where it is not.

    Where one speed identifies only sums of friction, `slope` holds the speed's projection on the
    columns of direction and 1. The speed's deviation from it, on the way to a reversal, also causes
    friction: it is fitted in addition to the sums, so that it is not mistaken for inertia.
    """

    shape: Separation
    columns: tuple[int, ...]
    inertia: float | None
    unmoved: bool = False
    slope: tuple[float, float] = (0.0, 0.0)

    @staticmethod
    def of(samples: Sequence[MotionSamples], inertia: float | None, shape: Separation) -> _Model:
        slope = (0.0, 0.0) if shape.speeds else _slope(samples, shape)
        deviates = shape.speeds or _shows(_deviations(samples, slope), samples, VISCOUS)
        columns = (COULOMB,) + (VISCOUS,) * deviates + (OFFSET,) * shape.both
        if inertia is not None:
            return _Model(shape, columns, inertia, slope=slope)
        if _accelerates(samples):
            return _Model(shape, (*columns, INERTIA), None, slope=slope)
        return _Model(shape, columns, None, unmoved=True, slope=slope)

    def rows(self, samples: Sequence[MotionSamples]) -> WeightedRows:
        """All trials' rows; each trial is weighted by the residual variance of its separate fit."""
        if not samples:
            raise NotIdentifiedError("friction from motion: too few samples remain")
        parts = [self._of_trial(chosen) for chosen in samples]
        if len(parts) > 1:
            parts = [scaled(part, 1.0 / max(own_variance(part), 1e-300)) for part in parts]
        return WeightedRows(
            np.vstack([p.regressors for p in parts]),
            np.concatenate([p.target for p in parts]),
            np.concatenate([p.weights for p in parts]),
            np.sum([p.noise for p in parts], axis=0),
        )

    def _of_trial(self, chosen: MotionSamples) -> WeightedRows:
        y, keep = self.balanced(chosen), list(self.columns)
        regressors, weights = chosen.regressors.copy(), np.ones(len(y))
        (regressors[:, VISCOUS],) = _deviations([chosen], self.slope)
        return WeightedRows(regressors[:, keep], y, weights, chosen.noise[keep] * len(y))

    def balanced(self, chosen: MotionSamples) -> FloatArray:
        """The effort (n,) that the fitted parameters balance: less what a given inertia takes."""
        if self.inertia is None:
            return chosen.effort
        return chosen.effort - self.inertia * chosen.regressors[:, INERTIA]

    def regression(self, samples: Sequence[MotionSamples]) -> LinearFit:
        return regression(self.rows(samples), [_NAMES[c] for c in self.columns])

    def apart(self, samples: Sequence[MotionSamples]) -> list[LinearFit] | None:
        """One fit per trial, where there are several and each identifies everything."""
        if len(samples) < 2:
            return None
        try:
            fits = [self.regression([chosen]) for chosen in samples]
        except NotIdentifiedError:
            return None
        return None if any(inflation(fit) > _MOST_INFLATION for fit in fits) else fits

    @staticmethod
    def start(pooled: LinearFit, fits: list[LinearFit] | None) -> FloatArray:
        """Values (p,) of a law of all trials, from which their factors are taken."""
        if fits is None:
            return pooled.coefficients
        return np.asarray(np.mean([fit.coefficients for fit in fits], axis=0))

    def estimated(
        self,
        samples: Sequence[MotionSamples],
        pooled: LinearFit,
        fits: list[LinearFit] | None,
        repeats: Variance,
    ) -> _Found:
        """Values, standard errors and degrees of freedom of the columns' coefficients."""
        if fits is not None and len(fits) < FEWEST_REPEATS:
            return self.weighted(fits, repeats)
        if fits is None:
            covariance = pooled.correlated_covariance(_trial_numbers(samples))
            matrix = covariance.matrix
            return _Found(pooled.coefficients, np.sqrt(np.diag(matrix)), covariance.dof, matrix)
        table = np.array([fit.coefficients for fit in fits])
        n = len(fits)
        stds = table.std(axis=0, ddof=1) / math.sqrt(n)
        p = table.shape[1]
        matrix = np.cov(table, rowvar=False).reshape(p, p) / n
        matrix = shrunk(matrix, n - 1.0, towards=pooled.unscaled)
        return _Found(table.mean(axis=0), stds, np.full(p, n - 1.0), matrix)

    def weighted(self, fits: Sequence[LinearFit], repeats: Variance) -> _Found:
        """The mean of separate fits, weighted by their errors and by `repeats`, the relative
        variance of friction from test to test (random effects, Hartung, Knapp, Sinha 2008); the
        errors are those of the fits alone.
        """
        table = np.array([fit.coefficients for fit in fits])
        own = [fit.correlated_covariance() for fit in fits]
        scatter = self._scatter(table.mean(axis=0), repeats)
        try:
            precisions = [np.linalg.inv(one.matrix + scatter) for one in own]
            whole = np.linalg.inv(np.sum(precisions, axis=0))
        except np.linalg.LinAlgError:  # tests without an error: none is better than the others
            precisions = [np.eye(table.shape[1]) for _ in own]
            whole = np.eye(table.shape[1]) / len(own)
        shares = [whole @ precision for precision in precisions]
        values = np.sum([share @ row for share, row in zip(shares, table, strict=True)], axis=0)
        parts = np.array([a @ one.matrix @ a.T for a, one in zip(shares, own, strict=True)])
        variances = np.array([np.diag(part) for part in parts])
        dofs = [
            satterthwaite(v, d)
            for v, d in zip(variances.T, np.array([o.dof for o in own]).T, strict=True)
        ]
        return _Found(values, np.sqrt(variances.sum(axis=0)), np.array(dofs), parts.sum(axis=0))

    def _scatter(self, values: FloatArray, repeats: Variance) -> FloatArray:
        """Covariance (p, p) of a test's values from friction that differs by factors of relative
        variance `repeats`."""
        friction = np.where(np.isin(self.columns, (COULOMB, VISCOUS)), values, 0.0)
        return np.asarray(np.outer(friction, friction) * repeats.value)

    def law(self, samples: Sequence[MotionSamples]) -> FloatArray:
        """All four coefficients (4,) of all trials together."""
        return self.full(self.regression(_long_enough(samples)).coefficients)

    def separates(self, samples: Sequence[MotionSamples]) -> bool:
        """Whether these samples still identify what is fitted."""
        found = _long_enough(samples)
        if sum(len(s.effort) for s in found) < MIN_SAMPLES:
            return False
        shape = separation(found)
        if (shape.both, shape.speeds) != (self.shape.both, self.shape.speeds):
            return False
        try:
            return inflation(self.regression(found)) < _MOST_INFLATION
        except NotIdentifiedError:
            return False

    def with_model_error(
        self, samples: Sequence[MotionSamples], found: _Found, repeats: Variance | None
    ) -> _Found:
        """Standard errors with those of a jackknife over bins of speed added: what the law does not
        describe changes from bin to bin, but not from trial to trial. `repeats` where separate fits
        were `weighted`."""
        bins = bins_of_speed(samples, _BINS)

        def without(k: int) -> FloatArray:
            some = [s.kept(own != k) for s, own in zip(samples, bins, strict=True)]
            kept = [s for s in some if len(s.effort)]
            if repeats is not None and len(kept) == len(samples):
                return self.weighted([self.regression([s]) for s in kept], repeats).values
            return self.regression(kept).coefficients

        try:
            scatter = jackknife(without, _BINS)
        except NotIdentifiedError:
            return found
        shares = np.vstack([found.stds**2, np.diag(scatter)])
        total = [
            satterthwaite(own, np.array([dof, _BINS - 1.0]))
            for own, dof in zip(shares.T, found.dofs, strict=True)
        ]
        bends = shrunk(scatter, _BINS - 1.0, towards=found.matrix)
        matrix = found.matrix + bends
        return _Found(found.values, np.sqrt(shares.sum(axis=0)), np.array(total), matrix)

    def repeats(self, samples: Sequence[MotionSamples], values: FloatArray) -> Variance:
        """The variance of the factors by which each trial's friction is that of the law."""
        law = self.full(values)
        of_friction = np.array([1.0, 1.0, 0.0, 0.0]) * law
        factors = []
        for chosen in samples:
            friction = chosen.regressors @ of_friction
            measured = chosen.effort - chosen.regressors @ (law - of_friction)
            factors.append(float(friction @ measured / (friction @ friction)))
        return Variance.of(np.array(factors))

    def of_any_test(self, found: _Found, repeats: Variance, tests: int) -> _Found:
        """Errors with that of the mean of so many tests, whose friction differs by factors of
        relative variance `repeats`."""
        if not repeats.dof:
            return found
        more = self._scatter(found.values, repeats) / tests
        shares = np.vstack([found.stds**2, np.diag(more)])
        dofs = [
            satterthwaite(own, np.array([dof, repeats.dof]))
            for own, dof in zip(shares.T, found.dofs, strict=True)
        ]
        stds = np.sqrt(shares.sum(axis=0))
        return _Found(found.values, stds, np.array(dofs), found.matrix + more)

    def full(self, values: FloatArray) -> FloatArray:
        """All four coefficients (4,), those that are not fitted at 0 or at the given inertia."""
        found = np.zeros(4)
        found[INERTIA] = self.inertia or 0.0
        found[list(self.columns)] = values
        found[[COULOMB, OFFSET]] -= found[VISCOUS] * np.array(self.slope)
        return found


def _slope(samples: Sequence[MotionSamples], shape: Separation) -> tuple[float, float]:
    """The fit of the speed on the columns of direction and 1: its factor in each sum."""
    keep = [COULOMB, OFFSET] if shape.both else [COULOMB]
    x, v = (
        np.concatenate(part)
        for part in zip(*((s.regressors[:, keep], s.speed) for s in samples), strict=True)
    )
    found, *_ = np.linalg.lstsq(x, v, rcond=None)
    mean, half = (*map(float, found), 0.0)[:2]
    return mean, half


def _deviations(samples: Sequence[MotionSamples], slope: tuple[float, float]) -> list[FloatArray]:
    """The speed (n,) of each trial less its projection `slope` on direction and 1."""
    return [s.speed - s.regressors[:, [COULOMB, OFFSET]] @ np.array(slope) for s in samples]


def _shows(
    values: Sequence[FloatArray],
    samples: Sequence[MotionSamples],
    column: int,
    most: float = MOST_NOISE,
) -> bool:
    """Whether values (n,) of each trial are more than the encoder's noise in a regressor."""
    squares = sum(float(np.sum(own**2)) for own in values)
    noise = sum(s.noise[column] * len(s.effort) for s in samples)
    return bool(squares > 0.0 and noise <= most * squares)


def _finished(
    samples: Sequence[MotionSamples],
    given: Sequence[MotionSamples],
    model: _Model,
    apart: bool,
    repeated: bool,
    found: _Found,
    limits: SlidingLimits,
    units: MotionUnits,
) -> MotionFriction:
    by_column = {
        column: Estimate.symmetric(float(value), float(std), units.unit(NAMES[column]), float(dof))
        for column, value, std, dof in zip(
            model.columns, found.values, found.stds, found.dofs, strict=True
        )
    }
    parts = [by_column[c] for c in (COULOMB, OFFSET) if c in by_column]
    known = combined(parts, model.slope, model.shape, units)
    sums = known.rows
    if known.offset is not None:
        by_column[OFFSET] = known.offset
    full = model.full(found.values)
    rmse, count = _rmse(samples, full)
    effort = np.concatenate([model.balanced(s) for s in samples])

    def estimate(column: int) -> Estimate:
        name = NAMES[column]
        if column in by_column and not any(name in c.terms for c in sums):
            return by_column[column]
        return unidentified(name, units.unit(name), sums, "")

    return MotionFriction(
        estimate(COULOMB),
        estimate(VISCOUS),
        estimate(OFFSET),
        _inertia(model, by_column, units),
        rmse,
        count,
        apart,
        _explained(effort, rmse),
        _notices(repeated, model, limits, units),
        sums,
        model.shape.both,
        limits,
        replace(
            _quality(samples, effort, full, model, units),
            left_out=_excluded(samples, given, full, model),
        ),
        _joint(model, found),
    )


def _quality(
    samples: Sequence[MotionSamples],
    effort: FloatArray,
    full: FloatArray,
    model: _Model,
    units: MotionUnits,
) -> FitQuality:
    """Quality of the fitted effort (n,) of friction (and an estimated inertia); `full` (4,)."""
    left = [s.effort - s.regressors @ full for s in samples]
    # Neighbouring samples share the filter's noise; those a filter's length apart do not.
    return FitQuality.of(
        "effort in motion",
        units.effort,
        effort,
        np.concatenate(left),
        has_constant=model.shape.both,
        lack_of_fit=runs_test([part[:: signals.PER_LENGTH] for part in left]),
    )


def _excluded(
    samples: Sequence[MotionSamples],
    given: Sequence[MotionSamples],
    full: FloatArray,
    model: _Model,
) -> tuple[ExcludedData, ...]:
    """The samples `given` but not in `samples`, with their residuals under `full` (4,)."""
    count = sum(len(s.effort) for s in given)
    out = ExcludedData("samples", count - sum(len(s.effort) for s in samples), count)
    if not out.count:
        return ()
    effort = np.concatenate([model.balanced(s) for s in given])
    around = spread(effort, model.shape.both)
    return (replace(out, rmse=_rmse(given, full)[0], spread=around),)


def _joint(model: _Model, found: _Found) -> JointCovariance:
    """Joint covariance of the fitted parameters."""
    return JointCovariance(tuple(NAMES[column] for column in model.columns), found.matrix)


def _inertia(model: _Model, by_column: dict[int, Estimate], units: MotionUnits) -> Estimate | None:
    if model.unmoved:
        return Estimate.unidentified(
            units.inertia_unit,
            "the motion hardly accelerates: give a motion that accelerates and reverses",
        )
    return by_column.get(INERTIA)


def _notices(
    repeated: bool, model: _Model, limits: SlidingLimits, units: MotionUnits
) -> tuple[str, ...]:
    found = [text] if (text := limits.text(units.position, units.speed)) else []
    if not repeated:
        found.append(
            "friction from motion: the intervals hold for this test; variation from one test to "
            "the next shows only in several"
        )
    if model.unmoved:
        found.append("friction from motion: the inertia's share of the effort is neglected")
    return tuple(found)


def _trial_numbers(samples: Sequence[MotionSamples]) -> NDArray[np.intp]:
    """(n,): which trial each row of all samples belongs to."""
    return np.repeat(np.arange(len(samples)), [len(s.effort) for s in samples])


def _rmse(samples: Sequence[MotionSamples], full: FloatArray) -> tuple[float, int]:
    squares = [(s.effort - s.regressors @ full) ** 2 for s in samples]
    count = sum(map(len, squares))
    return math.sqrt(sum(float(np.sum(part)) for part in squares) / count), count


def _explained(effort: FloatArray, rmse: float) -> float:
    """R2 of the effort (n,) that the parameters balance."""
    variance = float(np.var(effort))
    return 1.0 - rmse**2 / variance if variance > 0.0 else 0.0


def effort_rmse(
    trials: Sequence[Recording],
    coulomb: float,
    viscous: float,
    offset: float,
    inertia: float,
    cutoff_hz: float,
    share: tuple[float, int] = (0.0, 0),
) -> float:
    """RMSE (N or Nm) of the filtered effort, predicted by given parameters, on held-out trials.

    `share`: of an effort that friction takes, and the column of it in `MotionSamples.carried`.
    """
    whole = [motion_samples(trial, cutoff_hz) for trial in trials]
    part, column = share
    samples = [replace(s, effort=s.effort - part * s.carried[:, column]) for s in whole]
    return _rmse(samples, np.array([coulomb, viscous, offset, inertia]))[0]
