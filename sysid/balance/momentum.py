"""The effort balance over an interval, in momentum form: the position is not differentiated."""

from __future__ import annotations

import numpy as np

from sysid.recording.recording import Recording
from sysid.types import FloatArray

TAPER_S = 0.1


def momentum_balance(
    recording: Recording, start: int, stop: int, inertia: float | None
) -> dict[str, float]:
    """Mean friction and mean speed over samples [start, stop), in weak form (3.4.2 integrated).

    Both sides of friction = motor + cylinder - load - inertia * acceleration are averaged
    with a trapezoidal weight g, so that speed and acceleration need no differentiation:
    the integral of g v is minus that of g' x, and so on. Without an inertia (kg m2 or kg) the last
    term is omitted. Efforts in Nm or N, the speed in rad/s or m/s; a return spring's
    effort is part of gravity's.
    """
    rows = slice(start, stop)
    x, dt = recording.position[rows], recording.period
    n = len(x)
    taper = max(1, min(round(TAPER_S / dt), (n - 1) // 3))
    rise = np.minimum(np.arange(n), np.arange(n)[::-1])
    weight = np.minimum(rise / taper, 1.0)
    area = float(np.sum(weight)) * dt
    first, last = np.trapezoid(x[: taper + 1]), np.trapezoid(x[-taper - 1 :])
    speed = float(last - first) / taper / area
    gained = float((x[-1] - x[-1 - taper]) - (x[taper] - x[0])) / (taper * dt)

    def mean(effort: FloatArray) -> float:
        return float(weight @ effort[rows]) * dt / area

    inertial = 0.0 if inertia is None else (inertia + recording.added_inertia) * gained / area
    motor, cylinder, load = map(mean, (recording.motor, recording.cylinder, recording.load_effort))
    return {
        "speed": speed,
        "motor": motor,
        "cylinder": cylinder,
        "gravity": load,
        "inertial": inertial,
        "friction": motor + cylinder - load - inertial,
    }


__all__ = ["momentum_balance"]
