"""Static friction where a motion begins again after a rest, for rigs that no motor ramps (3.4.2).

A shaft that rests between two motions breaks away as it does at the end of a ramp. Under PWM it
does so at a crest of the pressure's ripple, and a log holds few samples of a pulse: the effort of
the rest is fitted by a trend and the harmonics of the PWM frequency, and read at the crest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from sysid.errors import NotIdentifiedError
from sysid.estimation.linear import Estimate, Variance
from sysid.estimation.quality import FEWEST_REPEATS
from sysid.identification.friction.static import (
    AVERAGE_S,
    Onset,
    StaticFriction,
    find_onset,
    rested,
    resting,
)
from sysid.io.motion import MotionUnits
from sysid.recording.recording import Recording
from sysid.signals import deviation_by_median
from sysid.types import FloatArray

# Of PWM before the onset, in periods: enough for the ripple, few for a trend's curvature.
_RIPPLES = 20
_CREST_POINTS = 41
CRITERION = (
    "end of a rest within a motion, by the onset of sustained motion; the efforts before it are "
    f"fitted over {_RIPPLES} PWM periods by a trend and the ripple, and read at its last crest; "
    "the median of all rests"
)


def static_of_rests(
    trials: Sequence[Recording], units: MotionUnits, notices: list[str]
) -> StaticFriction:
    """Static friction from the rests within motions: the median of what ended them.

    A reading may be of a slip, or of an effort that changed too fast: the median and the median
    deviation do not follow a few of these. Raises NotIdentifiedError where fewer than three rests
    end within a test.
    """
    by_trial = [np.array(list(_readings(trial))) for trial in trials]
    found = np.concatenate([np.zeros(0), *by_trial])
    if len(found) < FEWEST_REPEATS:
        raise NotIdentifiedError(
            f"static friction: {len(found)} of {FEWEST_REPEATS} rests that end in motion: give "
            "slow changes of the pressure, to and fro, with the piston at rest in between"
        )
    middle = float(np.median(found))
    spread = deviation_by_median(found, middle)
    # What a reading is off by, the crest above all, is much the same in all: no mean shrinks it.
    estimate = Estimate.symmetric(middle, spread, units.effort, len(found) - 1)
    notices.append(
        f"static friction is that of {len(found)} rests of friction-motion tests, at whose ends "
        "the shaft begins to move: the rig file declares no motor that could ramp its effort"
    )
    hidden = [
        line
        for trial, own in zip(trials, by_trial, strict=True)
        if len(own) and (line := _hidden_crests(trial))
    ]
    if hidden:
        estimate = replace(estimate, interval=(estimate.interval[0], math.inf))
        notices.append(hidden[0])
    medians = np.array([np.median(own) for own in by_trial if len(own)])
    return StaticFriction(
        estimate,
        spread,
        (),
        {},
        {},
        criterion=CRITERION,
        repeats=Variance.of(medians / middle),
        rested_in=len(medians),
    )


def _harmonics(trial: Recording) -> int:
    """The harmonics of the PWM frequency that a log's readings show."""
    pwm = trial.rig.pwm
    return 0 if pwm is None else max(0, math.ceil(0.5 * pwm.period_s / trial.period - 1e-6) - 1)


def _hidden_crests(trial: Recording) -> str:
    """What a ripple of the pressure that the readings do not resolve hides; empty without one."""
    pwm = trial.rig.pwm
    if pwm is None or not trial.is_pulsed or _harmonics(trial):
        return ""
    return (
        "static friction is at least what these rests show: the shaft breaks away at a crest of "
        f"the pulses' ripple, of which a reading each {1e3 * trial.period:g} ms shows nothing "
        f"(PWM period {1e3 * pwm.period_s:g} ms): log more than two readings a period, or ramp the "
        "pressure by on/off commands"
    )


def _readings(trial: Recording) -> Iterator[float]:
    """The effort that ended each rest of a test, in the direction in which it then moved."""
    rests = resting(trial)
    for place, (first, _) in enumerate(rests):
        if first == 0:  # how long it had rested before the log, nobody knows
            continue
        end = rests[place + 1][0] if place + 1 < len(rests) else len(trial)
        part = trial.part(first, end, trial.label)
        onset = find_onset(part)
        if isinstance(onset, str) or not rested(part, onset.index):
            continue
        value = _crest(part, onset)
        if value > 0.0:
            yield value


def _crest(rest: Recording, onset: Onset) -> float:
    """The largest effort just before an onset, Nm or N along the motion; NaN of a short rest."""
    pwm = rest.rig.pwm
    period = AVERAGE_S / _RIPPLES if pwm is None else pwm.period_s
    harmonics = _harmonics(rest)
    first = max(0, onset.index + 1 - round(_RIPPLES * period / rest.period))
    rows = slice(first, onset.index + 1)
    columns = _columns(rest.time[rows] - onset.time, period, harmonics)
    if len(columns) < 2 * columns.shape[1]:
        return math.nan
    effort = onset.direction * rest.applied[rows]
    law = np.linalg.lstsq(columns, effort, rcond=None)[0]
    # Under pulses pressure rises and falls in ramps: their crest is above that of the harmonics.
    odd = np.arange(1, harmonics + 1, 2, dtype=float)
    law[3:] *= 1.0 if harmonics == 0 else math.pi**2 / (8.0 * float(np.sum(odd**-2.0)))
    last = np.linspace(-period, 0.0, _CREST_POINTS)
    return float(np.max(_columns(last, period, harmonics) @ law))


def _columns(time: FloatArray, period: float, harmonics: int) -> FloatArray:
    """(n, 3 + 2 harmonics): a trend of second order, and the ripple."""
    angles = 2.0 * np.pi / period * np.outer(time, np.arange(1, harmonics + 1))
    return np.hstack([np.vander(time, 3), np.cos(angles), np.sin(angles)])


__all__ = ["static_of_rests"]
