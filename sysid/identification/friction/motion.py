"""Friction and inertia from any motion by inverse dynamics (Janot, Gautier, Brunot 2019).

inertia a + coulomb sign(v) + viscous v + offset = motor + cylinder - gravity, thesis 3.4.2
with the law of 3.4.1 inserted, is linear in its parameters. Both sides go through the same
zero-phase filter: the effort, and every regressor, sign(v) among them, so that a reversal
within the filter's length biases nothing.

Two small biases are removed. A command holds from its row to the next, so that the effort
at a row is the mean of the row's and the one before; half a sample of delay would appear as
viscous friction. The encoder's noise in speed and acceleration, which attenuates their
coefficients, is known: its share is subtracted from the normal matrix (Fuller 1987, 2.2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sysid import signals
from sysid.errors import NotIdentifiedError
from sysid.estimation.linear import (
    Estimate,
    LinearFit,
    linear_fit,
)
from sysid.estimation.quality import FitQuality, runs_test
from sysid.identification.friction.effort import MIN_SAMPLES, MOTION, EvenTrial, TrialUse, Units
from sysid.types import FloatArray

REST_NOISE_TIMES = 5.0
REST_S = 0.005
MIN_TRIALS_APART = 3
_HALVINGS = 6
# Samples that are kept of each length of the filter.
_A_LENGTH = 4
# Share of the samples of one direction beyond those of the other.
_MOST_ONE_WAY = 0.98
_REST_SHARE = 0.5
# A direction's upper over lower quartile of speed from which a law over speed is identified.
_LEAST_SPAN = 1.5
# Correlation of speed and load beyond which the two cannot be distinguished.
_TIED = 0.6
COULOMB, VISCOUS, OFFSET, INERTIA = range(4)
NAMES = ("Coulomb friction", "viscous friction", "offset", "inertia")

RULE = (
    f"samples count where the filtered speed exceeds {REST_NOISE_TIMES:g} times its own noise; "
    f"where it does not for at least {1000.0 * REST_S:g} ms the shaft may rest, its friction is "
    "anything up to static friction, and these samples are left out, with the filter's length on "
    "either side; so are samples within 1 % of the stroke from an end and the log's ends"
)


@dataclass(frozen=True)
class MotionSamples:
    """One trial, filtered: regressors (n, 4) for Coulomb, viscous, offset and inertia, and
    the effort (n,) that they balance; only samples that count, thinned so that the filter
    leaves them independent. `noise` (4,) is the variance of the regressors' noise,
    `rest_speed` the rule's limit, `load` (n,) the cylinder's effort."""

    regressors: FloatArray
    effort: FloatArray
    noise: FloatArray
    rest_speed: float
    load: FloatArray

    @property
    def speed(self) -> FloatArray:
        """(n,), in the rig's unit."""
        return self.regressors[:, VISCOUS]


@dataclass(frozen=True)
class MotionFriction:
    """Friction from motion; `inertia` is None where the rig file's was used.

    `explained` is the share of the filtered effort's variance that the law explains (R2).
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
    quality: FitQuality | None = None


def motion_samples(trial: EvenTrial, cutoff_hz: float) -> MotionSamples:
    """Filter both sides of the torque balance and select the samples that count."""
    dt = trial.period
    length = signals.filter_length(dt, cutoff_hz)
    position = signals.lowpass(trial.position, dt, cutoff_hz)
    speed = signals.first_derivative(position, dt)
    acceleration = signals.second_derivative(position, dt)
    speed_noise, acceleration_noise = (
        trial.position_noise.total * gain for gain in _noise_gains(dt, cutoff_hz)
    )
    sign = signals.lowpass(np.sign(speed), dt, cutoff_hz)
    regressors = np.column_stack([sign, speed, np.ones(len(speed)), acceleration])
    effort = signals.lowpass(
        signals.held_about_rows(trial.motor) + trial.cylinder - trial.gravity, dt, cutoff_hz
    )
    rows = np.flatnonzero(~left_out(trial, cutoff_hz))[:: max(1, length // _A_LENGTH)]
    noise = np.array([0.0, speed_noise**2, 0.0, acceleration_noise**2])
    return MotionSamples(
        regressors[rows], effort[rows], noise, REST_NOISE_TIMES * speed_noise, trial.cylinder[rows]
    )


def left_out(trial: EvenTrial, cutoff_hz: float) -> NDArray[np.bool_]:
    """Samples (n,) that do not count, by `RULE`."""
    dt = trial.period
    length = signals.filter_length(dt, cutoff_hz)
    speed = signals.first_derivative(signals.lowpass(trial.position, dt, cutoff_hz), dt)
    rest_speed = REST_NOISE_TIMES * trial.position_noise.total * _noise_gains(dt, cutoff_hz)[0]
    rests = _long_runs(np.abs(speed) <= rest_speed, max(1, round(REST_S / dt)))
    found = _widened(rests | ~trial.inside, length)
    found[:length] = found[-length:] = True
    return found


def default_cutoff(trial: EvenTrial, highest_hz: float) -> float:
    """The highest cut-off up to `highest_hz`, Hz, at which the motion exceeds the noise.

    It stays clear of the Nyquist frequency, and is halved until the limit of rest is well
    below the speeds of the motion.
    """
    dt = trial.period
    cutoff = min(highest_hz, 0.2 / dt)
    for _ in range(_HALVINGS):
        speed = signals.first_derivative(signals.lowpass(trial.position, dt, cutoff), dt)
        fast = float(np.quantile(np.abs(speed), 0.5))
        noise = trial.position_noise.total * _noise_gains(dt, cutoff)[0]
        if REST_NOISE_TIMES * noise < _REST_SHARE * fast:
            break
        cutoff *= 0.5
    return cutoff


def tells_speeds(speed: FloatArray, load: FloatArray) -> bool:
    """Whether speeds (n,) differ enough within a direction to identify friction over speed.

    Where a screw drives the axis at one speed each way, Coulomb friction, viscous friction
    and an offset reduce to two numbers, and the remaining variation of the speed follows the
    `load` (n,), the cylinder's effort.
    """
    for way in (1.0, -1.0):
        own = way * speed[way * speed > 0.0]
        pushed = load[way * speed > 0.0]
        if len(own) < MIN_SAMPLES:
            continue
        spans = np.quantile(own, 0.75) > _LEAST_SPAN * np.quantile(own, 0.25)
        steady = np.ptp(pushed) == 0.0 or np.ptp(own) == 0.0
        tied = not steady and abs(float(np.corrcoef(own, pushed)[0, 1])) > _TIED
        if spans and not tied:
            return True
    return False


@lru_cache(maxsize=32)
def _noise_gains(period: float, cutoff_hz: float) -> tuple[float, float]:
    """Noise of the filtered speed (1/s) and acceleration (1/s2) over that of the position."""
    half = 10 * signals.filter_length(period, cutoff_hz)
    impulse = np.zeros(2 * half + 1)
    impulse[half] = 1.0
    smooth = signals.lowpass(impulse, period, cutoff_hz)
    speed = signals.first_derivative(smooth, period)
    acceleration = signals.second_derivative(smooth, period)
    return math.sqrt(float(speed @ speed)), math.sqrt(float(acceleration @ acceleration))


def _long_runs(mask: NDArray[np.bool_], least: int) -> NDArray[np.bool_]:
    """`mask` without its runs that are shorter than `least` samples."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    kept = np.zeros(len(mask), dtype=bool)
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        kept[start:stop] = stop - start >= least
    return kept


def _widened(mask: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """`mask` extended by `reach` samples on either side of what is set."""
    count = np.concatenate([[0], np.cumsum(mask)])
    rows = np.arange(len(mask))
    high, low = np.minimum(rows + reach + 1, len(mask)), np.maximum(rows - reach, 0)
    return np.asarray(count[high] > count[low])


def fit_motion(
    trials: Sequence[EvenTrial],
    inertia: float | None,
    units: Units,
    cutoff_hz: float,
    notices: list[str],
) -> tuple[MotionFriction, list[TrialUse]]:
    """Coulomb, viscous, offset, and the inertia unless it is given (kg m2, or kg).

    At least three trials are fitted one by one: the mean is reported, with the error from the
    scatter of the trials. Fewer are fitted together, with errors that allow for autocorrelated
    residuals. Raises NotIdentifiedError where the motion does not separate the parameters.
    """
    uses, samples = [], []
    for trial in trials:
        use = TrialUse(trial.label, trial.source, MOTION)
        uses.append(use)
        if len(trial) < MIN_SAMPLES:
            use.leave_out("it is too short")
        else:
            chosen = motion_samples(trial, cutoff_hz)
            use.values = {"samples": float(len(chosen.effort)), "rest_speed": chosen.rest_speed}
            if len(chosen.effort) < MIN_SAMPLES:
                use.leave_out("it hardly moves")
            else:
                samples.append(chosen)
        if not use.used:
            notices.append(f"{use.title}: left out of friction from motion, {use.reason}")
    if not samples:
        raise NotIdentifiedError(
            "Coulomb and viscous friction: the shaft hardly moves in these tests; give motion "
            "tests that cross the stroke in both directions"
        )
    result = _fit_samples(samples, inertia, units)
    notices.extend(result.notices)
    return result, uses


def _fit_samples(
    samples: Sequence[MotionSamples], inertia: float | None, units: Units
) -> MotionFriction:
    names = (units.effort, units.viscous_unit, units.effort, units.inertia_unit)
    notices: list[str] = []
    speed, load = (np.concatenate([getattr(s, n) for s in samples]) for n in ("speed", "load"))
    if inertia is not None and not tells_speeds(speed, load):
        return _coulomb_alone(samples, inertia, units)
    fits = _fit_apart(samples, inertia)
    pooled = _regression(_weighted(samples, inertia), inertia)
    if fits is not None:
        table = np.array([fit.coefficients for fit in fits])
        values, n = table.mean(axis=0), len(fits)
        stds, dofs = table.std(axis=0, ddof=1) / math.sqrt(n), np.full(table.shape[1], n - 1.0)
    else:
        values = pooled.coefficients
        covariance = pooled.correlated_covariance(_trial_numbers(samples))
        stds, dofs = np.sqrt(np.diag(covariance.matrix)), covariance.dof
        notices.append(
            "friction from motion: the intervals hold for these tests; variation from one "
            f"test to the next shows only in at least {MIN_TRIALS_APART} tests"
        )
    estimates = [
        Estimate.symmetric(float(v), float(s), unit, float(dof))
        for v, s, unit, dof in zip(values, stds, names, dofs, strict=False)
    ]
    rmse, count = _rmse(samples, values, inertia)
    return MotionFriction(
        estimates[COULOMB],
        estimates[VISCOUS],
        estimates[OFFSET],
        estimates[INERTIA] if inertia is None else None,
        rmse,
        count,
        fits is not None,
        _explained(samples, rmse, values, inertia),
        tuple(notices),
        _quality(samples, values, inertia, units, has_constant=True),
    )


def _coulomb_alone(
    samples: Sequence[MotionSamples], inertia: float, units: Units
) -> MotionFriction:
    """One speed each way: friction is one number, with an unknown viscous share."""
    signs = np.sign(np.concatenate([s.regressors[:, COULOMB] for s in samples]))
    if abs(float(np.mean(signs))) > _MOST_ONE_WAY:
        raise NotIdentifiedError(
            "Coulomb friction: the motion has one direction, where it is indistinguishable from an "
            "offset; give a motion that reverses"
        )
    x = np.concatenate([s.regressors[:, COULOMB] for s in samples])[:, None]
    y = np.concatenate([s.effort - inertia * s.regressors[:, INERTIA] for s in samples])
    fit = linear_fit(x, y, names=NAMES[:1])
    covariance = fit.correlated_covariance(_trial_numbers(samples))
    coulomb = Estimate.symmetric(
        float(fit.coefficients[0]), covariance.std(0), units.effort, float(covariance.dof[0])
    )
    reason = "the axis slides at one speed each way: give motion at more than one speed"
    values = np.array([coulomb.value, 0.0, 0.0])
    rmse, count = _rmse(samples, values, inertia)
    return MotionFriction(
        coulomb,
        Estimate.unidentified(units.viscous_unit, reason),
        Estimate.unidentified(units.effort, reason),
        None,
        rmse,
        count,
        False,
        _explained(samples, rmse, values, inertia),
        (f"friction from motion: {reason}; the Coulomb friction holds at that speed",),
        _quality(samples, values, inertia, units, has_constant=False),
    )


def _trial_numbers(samples: Sequence[MotionSamples]) -> NDArray[np.intp]:
    """(n,): which trial each row of all samples belongs to."""
    return np.repeat(np.arange(len(samples)), [len(s.effort) for s in samples])


def _fit_apart(samples: Sequence[MotionSamples], inertia: float | None) -> list[LinearFit] | None:
    """One fit per trial, where there are enough trials and each identifies everything."""
    if len(samples) < MIN_TRIALS_APART:
        return None
    try:
        return [_regression(_weighted([chosen], inertia), inertia) for chosen in samples]
    except NotIdentifiedError:
        return None


@dataclass(frozen=True)
class _Rows:
    """Regressors (n, p), target and weights (n,), and the regressors' noise variance (p,),
    summed over the rows with their weights."""

    regressors: FloatArray
    target: FloatArray
    weights: FloatArray
    noise: FloatArray


def _weighted(samples: Sequence[MotionSamples], inertia: float | None) -> _Rows:
    """All trials' rows; each trial is weighted by the residual variance of its own fit."""
    parts = []
    for chosen in samples:
        x, y = chosen.regressors, chosen.effort
        if inertia is not None:
            x, y = x[:, :INERTIA], y - inertia * x[:, INERTIA]
        noise = chosen.noise[: x.shape[1]] * len(y)
        parts.append(_Rows(x, y, np.ones(len(y)), noise))
    if len(parts) > 1:
        parts = [_scaled(part, 1.0 / max(_variance(part), 1e-300)) for part in parts]
    return _Rows(
        np.vstack([p.regressors for p in parts]),
        np.concatenate([p.target for p in parts]),
        np.concatenate([p.weights for p in parts]),
        np.sum([p.noise for p in parts], axis=0),
    )


def _scaled(rows: _Rows, weight: float) -> _Rows:
    return replace(rows, weights=rows.weights * weight, noise=rows.noise * weight)


def _variance(rows: _Rows) -> float:
    solution, *_ = np.linalg.lstsq(rows.regressors, rows.target, rcond=None)
    return float(np.mean((rows.target - rows.regressors @ solution) ** 2))


def _regression(rows: _Rows, inertia: float | None) -> LinearFit:
    names = NAMES if inertia is None else NAMES[:INERTIA]
    signs = np.sign(rows.regressors[:, COULOMB])
    if np.all(signs > 0.0) or np.all(signs < 0.0):
        raise NotIdentifiedError(
            "Coulomb friction: the motion has one direction, where it is indistinguishable from an "
            "offset; give a motion that reverses"
        )
    fit = linear_fit(rows.regressors, rows.target, rows.weights, names)
    x, weighted = rows.regressors, rows.regressors * rows.weights[:, None]
    normal = weighted.T @ x
    if np.any(rows.noise > 0.5 * np.diag(normal)):
        raise NotIdentifiedError(
            "the parameters' regressors: speed or acceleration is mostly the encoder's noise; "
            "lower the cut-off or give faster motion"
        )
    unscaled = np.asarray(np.linalg.inv(normal - np.diag(rows.noise)), dtype=float)
    coefficients = unscaled @ (weighted.T @ rows.target)
    return replace(
        fit, coefficients=coefficients, residuals=rows.target - x @ coefficients, unscaled=unscaled
    )


def _rmse(
    samples: Sequence[MotionSamples], values: FloatArray, inertia: float | None
) -> tuple[float, int]:
    full = values if inertia is None else np.append(values, inertia)
    squares = [(s.effort - s.regressors @ full) ** 2 for s in samples]
    count = sum(map(len, squares))
    return math.sqrt(sum(float(np.sum(part)) for part in squares) / count), count


def _explained(
    samples: Sequence[MotionSamples], rmse: float, values: FloatArray, inertia: float | None
) -> float:
    """R2 of the effort that the parameters balance; what a given inertia takes is not explained."""
    known = 0.0 if inertia is None or len(values) > INERTIA else inertia
    effort = np.concatenate([s.effort - known * s.regressors[:, INERTIA] for s in samples])
    spread = float(np.var(effort))
    return 1.0 - rmse**2 / spread if spread > 0.0 else 0.0


def _quality(
    samples: Sequence[MotionSamples],
    values: FloatArray,
    inertia: float | None,
    units: Units,
    *,
    has_constant: bool,
) -> FitQuality:
    """Of the effort that friction (and an estimated inertia) balances."""
    full, known = (values, 0.0) if inertia is None else (np.append(values, inertia), inertia)
    left = [s.effort - s.regressors @ full for s in samples]
    # Neighbouring samples share the filter's noise; those a filter's length apart do not.
    return FitQuality.of(
        "effort in motion",
        units.effort,
        np.concatenate([s.effort - known * s.regressors[:, INERTIA] for s in samples]),
        np.concatenate(left),
        has_constant=has_constant,
        lack_of_fit=runs_test([part[::_A_LENGTH] for part in left]),
    )


def effort_rmse(
    trials: Sequence[EvenTrial],
    coulomb: float,
    viscous: float,
    offset: float,
    inertia: float,
    cutoff_hz: float,
) -> float:
    """RMSE (N or Nm) of the filtered effort, predicted by given parameters, on held-out trials."""
    samples = [motion_samples(trial, cutoff_hz) for trial in trials]
    values = np.array([coulomb, viscous, offset, inertia])
    return _rmse(samples, values, None)[0]
