"""Which kind of test a trial is, by its content (`docs/reference/command-line.md`)."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from sysid import signals
from sysid.io.logs import Trial, smallest_step
from sysid.io.measured_speed import moves
from sysid.io.rig import HELD_SHARE, Rig
from sysid.types import FloatArray

_HELD_STEPS = 20.0
# Share of half a stroke: a piston held farther in is not at an end.
_NEAR_AN_END = 0.9


def is_held(trial: Trial, rig: Rig) -> bool:
    """Whether the piston stayed in place; assumed where neither position nor speed is logged."""
    name, speed = rig.position_channel, rig.units.speed_channel
    if name not in trial:
        return speed not in trial or not moves(trial[speed])
    moved = signals.travel(trial[name])
    step = smallest_step(trial[name]) or 0.0
    give = HELD_SHARE * rig.travel if rig.travel is not None else 0.0
    return moved <= max(give, _HELD_STEPS * step)


def away_from_ends(trials: Sequence[Trial], rig: Rig) -> str | None:
    """A notice of tests whose piston is held, but at neither end of its stroke; None without any.

    The chamber's volume follows from the place: a flow is as wrong as the encoder's zero makes it.
    """
    name, travel = rig.position_channel, rig.travel
    if travel is None:
        return None
    places = [float(np.median(t[name])) for t in trials if name in t and is_held(t, rig)]
    away = [place for place in places if abs(place) < _NEAR_AN_END * 0.5 * travel]
    if not away:
        return None
    unit = rig.units.position
    return (
        f"the piston is held at {away[0]:.4g} {unit} in {len(away)} of {len(trials)} tests, away "
        f"from both ends ({0.5 * travel:.4g} {unit} from the middle): if it stood at one, "
        "flows are wrong by the chamber's volume; set the encoder's zero"
    )


def is_active(trial: Trial, *names: str) -> bool:
    """Whether any of these commands is ever other than zero."""
    return any(name in trial and bool(np.any(trial[name] != 0.0)) for name in names)


def is_one_duty(duty: FloatArray) -> bool:
    """Whether a duty (n,) is the same in all rows."""
    return float(np.ptp(duty)) <= 1e-6


def rows_per_period(pwm_period: float, sampling_period: float) -> Fraction:
    """Rows per PWM period (both in s), as a ratio of small numbers: 10/3 at 300 Hz and 1 kHz."""
    # At most so many PWM periods are searched for a whole number of rows.
    return Fraction(pwm_period / sampling_period).limit_denominator(4)


def rows_per_ripple(trial: Trial, rig: Rig) -> int:
    """Rows after which the PWM ripple repeats: those of one period, or of a few."""
    pwm = rig.require("pwm", "which a test under PWM needs").period_s
    mean = float(trial.time[-1] - trial.time[0]) / (len(trial) - 1)
    return max(1, rows_per_period(pwm, mean).numerator)
