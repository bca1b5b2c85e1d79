"""What makes a test of a motion log unfit for open-loop simulation."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sysid.errors import input_error
from sysid.io.channels import CHAMBER_PRESSURES
from sysid.io.logs import Trial
from sysid.io.rig import Rig, require_inertia
from sysid.io.trial_kind import rows_per_period
from sysid.plant import base
from sysid.types import FloatArray

MARGIN_OF_STROKE = 0.01
"""Samples nearer to an end stop than this share of the stroke are left out."""
MIN_ROWS = 20

# A step this much longer than the median one is a gap.
_GAP = 1.5
# The PWM grid may wander by this share of a period against the rows, over a whole test.
_PWM_WANDER = 0.5
_START_S = 0.05
# Factor by which the efforts of cylinder and motor may exceed the log and the rig file.
_EFFORT_MARGIN = 1.2


def check_channels(trial: Trial, kind: str, rig: Rig) -> None:
    """InputError for a channel that simulating this kind of test needs, or too few rows."""
    needed = [rig.position_channel]
    if kind in ("motion-motor", "friction-motion"):
        needed.append(rig.effort_channel)
    else:
        prefix = "duty" if kind == "motion-pwm" else "valve"
        needed += [f"{prefix}_a", f"{prefix}_b", *CHAMBER_PRESSURES]
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
    if steps[gap] > _GAP * period:
        raise input_error(
            f"{trial.source}, at {trial.time[gap]:.6g} s",
            f"no sample for {steps[gap]:.4g} s (elsewhere every {period:.4g} s), and the commands "
            "in between are unknown",
            "leave the test out, or label the parts before and after the gap differently in the "
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
    if mean > pwm * (1.0 + 1e-6) or wander > _PWM_WANDER:
        raise input_error(
            trial.source,
            f"a row every {mean:.6g} s cannot follow PWM periods of {pwm:.6g} s "
            f"({pwm / mean:.4g} rows a period)",
            "check [pwm] period_s and time_s, or log a whole number of rows a period",
        )


def check_at_rest(
    source: str,
    time: FloatArray,
    motor: FloatArray,
    measured: FloatArray,
    tolerance: float,
    rig: Rig,
    fitted_inertia: float | None = None,
) -> None:
    """InputError where the shaft moves in the first 50 ms further than it could from rest.

    Arguments as those of `moves_at_start`.
    """
    moved = moves_at_start(time, motor, measured, tolerance, rig, fitted_inertia)
    if moved is None:
        return
    raise input_error(
        source,
        f"starts while moving: {moved}",
        "start each test at rest, or cut off its beginning up to a standstill",
    )


def moves_at_start(
    time: FloatArray,
    motor: FloatArray,
    measured: FloatArray,
    tolerance: float,
    rig: Rig,
    fitted_inertia: float | None = None,
) -> str | None:
    """How far the shaft moves in the first 50 ms, in words, if further than it could from rest.

    From rest it cannot have gone further than the logged effort, friction aside, would have
    driven it: the double integral of |effort|/inertia. `measured` (3, n) position and
    pressures; `tolerance` is what the encoder may show at rest, rad or m. `fitted_inertia`
    (kg m2 or kg) counts where the rig file declares none.
    """
    rows = int(np.count_nonzero(time - time[0] <= _START_S))
    time, measured = time[:rows] - time[0], measured[:, :rows]
    effort = np.abs(_applied_effort(motor[:rows], measured, rig))
    declared = rig.total_inertia()
    inertia = fitted_inertia if declared is None else declared
    rate = _EFFORT_MARGIN * effort / (require_inertia(rig) if inertia is None else inertia)
    # The greater of two neighbours: what happens between rows is unknown.
    rate = np.maximum(rate[:-1], rate[1:]) * np.diff(time)
    speed = np.cumsum(rate)
    reach = np.concatenate([[0.0], np.cumsum(speed * np.diff(time))])
    gone = np.abs(measured[0] - measured[0, 0])
    beyond = np.flatnonzero(gone > reach + tolerance)
    if beyond.size == 0:
        return None
    at = int(beyond[0])
    return (
        f"the position changes by {gone[at]:.3g} in its first {1000.0 * time[at]:.3g} ms, and "
        f"from rest the logged effort explains {reach[at]:.2g}"
    )


def _applied_effort(motor: FloatArray, measured: FloatArray, rig: Rig) -> FloatArray:
    """Cylinder + motor - gravity from the log, (n,) Nm or N."""
    effort = np.asarray(motor, dtype=float)
    if rig.cylinder is not None and rig.air is not None:
        c, atmosphere = rig.cylinder, rig.air.atmospheric_pressure_pa
        a, b = np.nan_to_num(measured[1:], nan=atmosphere)
        effort = effort + base.cylinder_effort(
            a, b, c.area_a_m2, c.area_b_m2, atmosphere, c.pitch_radius_m
        )
    gravity = rig.gravity_moment()
    moment, weight = (0.0, gravity) if rig.is_linear else (gravity, 0.0)
    return np.asarray(effort - base.gravity_effort(measured[0], moment, weight))


def near_end_stop(position: FloatArray, rig: Rig) -> NDArray[np.bool_]:
    """(n,) whether a position is within 1 % of the stroke from an end, or beyond it."""
    if rig.travel is None:
        return np.zeros(len(position), dtype=bool)
    limit = (0.5 - MARGIN_OF_STROKE) * rig.travel
    return np.asarray(np.abs(position) > limit)
