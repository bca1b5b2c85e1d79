"""The atmosphere added twice to a pressure that was absolute before: what the motion shows of it.

A chamber that rests at twice the atmosphere's pressure may be under a regulator. But what it
then does to the piston the motor's effort has to balance, on the way there and back: if the effort
balances none of it, the pressure does not exist.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from sysid.errors import InputError
from sysid.io.channels import CHAMBER_PRESSURES
from sysid.io.plausibility import SAME_PRESSURE, TWICE
from sysid.io.rig import Rig
from sysid.types import FloatArray

# Share of the travel in the direction with less of it.
_BOTH_WAYS = 0.1
# Share of the effort that an added atmosphere would take, and of friction, which may differ by it.
_NEAR = 0.25


def added_twice(tests: Sequence[Mapping[str, FloatArray]], rig: Rig) -> tuple[str, ...]:
    """The chamber pressures to which the atmosphere was added twice; none where it does not show.

    `tests` hold (n,) each by channel, SI, without a valve that opens. They show it by motion both
    ways, with a motor's effort and both pressures: one of these rests at twice the atmosphere, the
    other there or at the atmosphere, and motor, cylinder and gravity balance without it only.
    """
    needed = (rig.position_channel, rig.effort_channel, *CHAMBER_PRESSURES)
    own = [test for test in tests if all(name in test for name in needed)]
    if rig.air is None or rig.cylinder is None or not own:
        return ()
    ambient = float(rig.air.atmospheric_pressure_pa)
    rests = {n: float(np.median(np.concatenate([t[n] for t in own]))) for n in CHAMBER_PRESSURES}
    twice = tuple(n for n, p in rests.items() if abs(p / (2.0 * ambient) - 1.0) <= TWICE)
    others = [p for n, p in rests.items() if n not in twice]
    if not twice or any(max(p / ambient, ambient / p) > SAME_PRESSURE for p in others):
        return ()
    by_atmosphere = dict(zip(CHAMBER_PRESSURES, _effort_per_pressure(rig), strict=True))
    added = ambient * sum(by_atmosphere[name] for name in twice)
    forward, back = _each_way(own, [_applied(test, rig) for test in own], rig.position_channel)
    balance, friction = 0.5 * (forward + back), 0.5 * abs(forward - back)
    shows = abs(added) > _NEAR * friction and abs(balance - added) < _NEAR * abs(added)
    return twice if shows else ()


def _effort_per_pressure(rig: Rig) -> tuple[float, float]:
    """Effort (N or Nm) of each chamber by its pressure (Pa)."""
    c = rig.require("cylinder", "and the chambers' effort needs its areas")
    radius = 1.0 if rig.is_linear else float(c.pitch_radius_m)
    return radius * float(c.area_a_m2), -radius * float(c.area_b_m2)


def _applied(test: Mapping[str, FloatArray], rig: Rig) -> FloatArray:
    """Motor and cylinder less gravity (n,), N or Nm; NaN where gravity is not known."""
    try:
        weight = rig.gravity_moment()
    except InputError:
        weight = math.nan
    air = rig.require("air", "and pressures act against the atmosphere's")
    ambient = float(air.atmospheric_pressure_pa)
    position = test[rig.position_channel]
    gravity = weight * (np.ones(len(position)) if rig.is_linear else np.sin(position))
    pushed = [
        per * (test[name] - ambient)
        for name, per in zip(CHAMBER_PRESSURES, _effort_per_pressure(rig), strict=True)
    ]
    return np.asarray(test[rig.effort_channel] + sum(pushed) - gravity)


def _each_way(
    tests: Sequence[Mapping[str, FloatArray]], efforts: Sequence[FloatArray], position: str
) -> tuple[float, float]:
    """The means of efforts (n,) over the way forward and the way back: their mean is without
    friction, which resists in both, and without inertia. NaN without a way in both directions."""
    steps = np.concatenate([np.diff(test[position]) for test in tests])
    values = np.concatenate([effort[:-1] for effort in efforts])
    forward, back = np.maximum(steps, 0.0), np.maximum(-steps, 0.0)
    ways = float(forward.sum()), float(back.sum())
    if min(ways) <= _BOTH_WAYS * sum(ways):
        return math.nan, math.nan
    return float(values @ forward) / ways[0], float(values @ back) / ways[1]


__all__ = ["added_twice"]
