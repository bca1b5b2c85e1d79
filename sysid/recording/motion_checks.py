"""What makes a test of a motion log unfit for open-loop simulation."""

from __future__ import annotations

import math

import numpy as np

from sysid import signals
from sysid.errors import input_error
from sysid.io.logs import Trial
from sysid.io.rig import Rig, require_inertia
from sysid.io.trial_kind import is_active, rows_per_period
from sysid.recording.recording import Recording

MIN_ROWS = 20
# Factor by which the efforts of cylinder and motor may exceed the log and the rig file.
_EFFORT_MARGIN = 1.2


def driven_kind(trial: Trial, kind: str, rig: Rig) -> str:
    """The kind of motion test that a `friction-motion` test is, by what drives it.

    A valve may drive it in place of a motor; then its commands are duties, or on and off.
    """
    if kind != "friction-motion":
        return kind
    if is_active(trial, *(f"duty_{name}" for name in rig.valve_names)):
        return "motion-pwm"
    without_motor = rig.motor is None and rig.effort_channel not in trial
    return "motion-discrete" if without_motor else kind


def check_channels(trial: Trial, kind: str, rig: Rig) -> None:
    """InputError for a channel that simulating this kind of test needs, or too few rows."""
    needed = [rig.position_channel]
    if kind in ("motion-motor", "friction-motion"):
        needed.append(rig.effort_channel)
    else:
        prefix = "duty" if kind == "motion-pwm" else "valve"
        needed += [*(f"{prefix}_{name}" for name in rig.valve_names), *rig.pressure_channels]
    trial.require(needed, f"which simulating a {kind} test needs")
    if len(trial) < MIN_ROWS:
        raise input_error(
            trial.source, f"holds {len(trial)} rows", f"a motion test needs at least {MIN_ROWS}"
        )


def check_sampling(trial: Trial, kind: str, rig: Rig) -> None:
    """InputError for gaps, and for rows that cannot follow the PWM periods of a pulsed test."""
    steps = np.diff(trial.time)
    period = float(np.median(steps))
    gap = int(np.argmax(steps))
    if steps[gap] > signals.SAMPLE_MISSING * period:
        raise input_error(
            f"{trial.source}, at {trial.time[gap]:.6g} s",
            f"no sample for {steps[gap]:.4g} s (elsewhere every {period:.4g} s), and the commands "
            "in between are unknown",
            "exclude the test, or label the parts before and after the gap differently in the "
            "column `test` if each starts at rest",
        )
    if kind != "motion-pwm":
        return
    pwm = rig.require("pwm", f"which {trial.source} needs: when a PWM period starts").period_s
    span = float(trial.time[-1] - trial.time[0])
    mean = span / len(steps)
    ratio = rows_per_period(pwm, mean)
    # The deviation from the nearest simple ratio adds up from period to period.
    wander = abs(pwm / mean / float(ratio) - 1.0) * span / pwm if ratio else math.inf
    # The PWM grid may wander by half a period against the rows, over a whole test.
    if mean > pwm * (1.0 + 1e-6) or wander > 0.5:
        raise input_error(
            trial.source,
            f"a row every {mean:.6g} s cannot follow PWM periods of {pwm:.6g} s "
            f"({pwm / mean:.4g} rows a period)",
            "check [pwm] period_s and time_s, or log a whole number of rows a period",
        )


def check_at_rest(test: Recording, tolerance: float, fitted_inertia: float | None = None) -> None:
    """InputError where the shaft moves in the first 50 ms further than it could from rest.

    Arguments as those of `moves_at_start`.
    """
    moved = moves_at_start(test, tolerance, fitted_inertia)
    if moved is None:
        return
    raise input_error(
        test.source,
        f"starts while moving: {moved}",
        "start each test at rest, or cut off its beginning up to a standstill",
    )


def moves_at_start(
    test: Recording, tolerance: float, fitted_inertia: float | None = None
) -> str | None:
    """How far the shaft moves in the first 50 ms, in words, if further than it could from rest.

    From rest it cannot have gone further than the logged effort, friction aside, would have
    driven it: the double integral of |effort|/inertia. `tolerance` is what the encoder may show at
    rest, rad or m. `fitted_inertia` (kg m2 or kg) counts where the rig file declares none.
    """
    rows = slice(0, int(np.count_nonzero(test.time <= 0.05)))
    time, position = test.time[rows], test.position[rows]
    effort = np.abs(test.commanded + test.cylinder - test.load_effort)[rows]
    rig = test.rig.carrying(test.trial.payload_kg)
    declared = rig.total_inertia()
    inertia = fitted_inertia if declared is None else declared
    rate = _EFFORT_MARGIN * effort / (require_inertia(rig) if inertia is None else inertia)
    # The greater of two neighbours: what happens between rows is unknown.
    rate = np.maximum(rate[:-1], rate[1:]) * np.diff(time)
    speed = np.cumsum(rate)
    reach = np.concatenate([[0.0], np.cumsum(speed * np.diff(time))])
    gone = np.abs(position - position[0])
    beyond = np.flatnonzero(gone > reach + tolerance)
    if beyond.size == 0:
        return None
    at = int(beyond[0])
    return (
        f"the position changes by {gone[at]:.3g} in its first {1000.0 * time[at]:.3g} ms, and "
        f"from rest the logged effort explains {reach[at]:.2g}"
    )
