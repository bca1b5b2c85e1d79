"""Hand-made friction tests with known friction."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from benchmarks.soft_contacts import bristled
from sysid.io.logs import Trial
from sysid.io.rig import Cylinder, Inertia, Rig
from sysid.types import FloatArray

PERIOD = 1e-3
# Options of a fit that writes nothing.
UNWRITTEN = ("-o", "none", "--no-report")
COUNT = 2.0 * np.pi / 80000
INERTIA = 0.024
RADIUS, STROKE = 0.0375, 0.127
CYLINDER = Cylinder(
    area_a_m2=4.5e-4,
    area_b_m2=4.2e-4,
    offset_a_m=0.075,
    offset_b_m=0.075,
    stroke_m=STROKE,
    pitch_radius_m=RADIUS,
)
RIG = Rig(
    "arm",
    "horizontal",
    "rotary",
    cylinder=CYLINDER,
    inertia=Inertia(equivalent_kg_m2=INERTIA),
)
BARE = Rig("axis", "horizontal", "rotary")


def trial(label: str, effort: FloatArray, theta: FloatArray) -> Trial:
    counts = np.round(theta / COUNT) * COUNT
    time = PERIOD * np.arange(len(effort))
    return Trial(label, time, {"motor_torque_nm": effort, "theta_rad": counts}, f"log: {label}")


def simulated(
    effort: FloatArray,
    static: float,
    coulomb: float,
    viscous: float,
    start: float = 0.0,
    offset: float = 0.0,
    cushion: float = math.inf,
) -> FloatArray:
    """Angle of an arm with breakaway, (n,): ten Euler steps a sample, effort held.

    Beyond the angle `cushion`, above it or, where it is negative, below, a spring of 2 Nm/rad
    pushes back.
    """
    net = np.asarray(effort - offset, dtype=float)
    numbers = (float(n) for n in (static, coulomb, viscous, start, cushion))
    theta: FloatArray = _stepped(net, *numbers)
    return theta


@njit(cache=True)
def _stepped(
    effort: FloatArray,
    static: float,
    coulomb: float,
    viscous: float,
    start: float,
    cushion: float,
) -> FloatArray:
    theta = np.empty(len(effort))
    x, w, h = start, 0.0, PERIOD / 10
    side = math.copysign(1.0, cushion)
    for k, torque in enumerate(effort):
        theta[k] = x
        for _ in range(10):
            net = torque - 2.0 * math.copysign(max(side * x - abs(cushion), 0.0), side)
            if w == 0.0 and abs(net) <= static:
                break
            sign = math.copysign(1.0, w if w != 0.0 else net)
            new = w + h * (net - sign * coulomb - viscous * w) / INERTIA
            # Friction stops the shaft, it does not turn it round.
            w = 0.0 if w * new < 0.0 else new
            x += h * w
    return theta


def ramp(static: float, coulomb: float, start: float, way: int, rate: float = 0.19) -> Trial:
    """A ramp that ends 0.15 s after breakaway."""
    n = round((static / rate + 0.15) / PERIOD)
    effort = way * rate * PERIOD * np.arange(n)
    return trial(f"{start:g}{way:+d}", effort, simulated(effort, static, coulomb, 0.05, start))


def creeping_ramp(stiffness: float, way: int, rate: float) -> Trial:
    """A ramp on contacts that give way before they slide (LuGre): 0.5 Nm, 0.4 sliding."""
    effort = rate * PERIOD * np.arange(round(0.8 / rate / PERIOD))
    theta, _ = bristled(effort, INERTIA, 0.5, 0.4, 0.05, stiffness, 0.1)
    return trial(f"{way:+d}", way * effort[: len(theta)], way * theta)


def constant(
    level: float,
    scatter: float,
    label: str = "c",
    offset: float = 0.0,
    seconds: float = 1.6,
    kick_s: float = 0.06,
    cushion: float = math.inf,
) -> Trial:
    """A kick, then a constant effort; friction 0.208 + 0.0488 w times 1 + scatter."""
    way = math.copysign(1.0, level)
    effort = np.full(round(seconds / PERIOD), level)
    effort[: round(kick_s / PERIOD)] = way * 0.6
    share = 1.0 + scatter
    start = -way * 1.3
    friction = (0.3 * share, 0.208 * share, 0.0488 * share)
    theta = simulated(effort, *friction, start, offset, way * cushion)
    return trial(label, effort, theta)


def swing(seconds: float = 6.0, offset: float = 0.0, phase: float = 0.0) -> Trial:
    t = PERIOD * np.arange(round(seconds / PERIOD))
    effort = 0.6 * np.clip(1.4 * np.sin(4.0 * t + phase), -1.0, 1.0)
    return trial(f"{phase:g}", effort, simulated(effort, 0.3, 0.208, 0.0488, 0.0, offset))


def stirred(size: float, share: float = 1.0, rest_s: float = 0.0) -> Trial:
    """Three times 2 s to and fro by an effort of this size, and a rest; friction `share` of
    `swing`'s."""
    t = PERIOD * np.arange(round(2.0 / PERIOD))
    once = [size * np.clip(1.4 * np.sin(4.0 * t), -1.0, 1.0), np.zeros(round(rest_s / PERIOD))]
    effort = np.tile(np.concatenate(once), 3)
    static, coulomb, viscous = (share * f for f in (0.3, 0.208, 0.0488))
    return trial(f"{size:g}", effort, simulated(effort, static, coulomb, viscous))
