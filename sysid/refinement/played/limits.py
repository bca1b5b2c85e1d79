"""What no played test may exceed, on the model and on plants that differ from it.

A test runs open loop on a rig that the bundle knows only roughly: it has to stay within the limits
on plants whose every constant is off by a share, each up or down.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.io.rig import Rig
from sysid.parameters import Bundle
from sysid.plant.base import load_effort, place_at_rest
from sysid.plant.ports import Model
from sysid.refinement.candidates import CandidateMotion, inputs_of_commands, leaves_travel
from sysid.refinement.played.signals import Actuators, Drive
from sysid.refinement.unknowns import Unknown, model_at, unknowns_of
from sysid.types import BoolArray, FloatArray

OFF = 0.2
"""Share by which every constant of a plant may differ from the model's."""
# Of half the travel and of the speed: what a test is designed to stay within on the plants that it
# is tried on, as those that it then meets are others.
MARGIN = 0.85
# The same of the plants on which the chosen tests are then checked: those that it meets are others.
CHECK_MARGIN = 0.95
# Of the stroke: how far from its place a test may start.
_START = 0.02
# Between the middle and a limit, where it is asked whether friction holds.
_PLACES = 200


@dataclass(frozen=True)
class MotionLimits:
    """`position` from the middle, rad or m; `speed`, rad/s or m/s; `effort`, Nm or N.

    A speed or an effort that is infinite is not limited. Where a spring rests the piston farther
    from the middle, it may go back to there.
    """

    position: float
    speed: float
    effort: float

    def scaled(self, share: float) -> MotionLimits:
        """With a share of position and speed."""
        return dataclasses.replace(self, position=share * self.position, speed=share * self.speed)


def off_plants(
    bundle: Bundle, rig: Rig, model: Model, count: int, seed: int, off: float = OFF
) -> list[Model]:
    """`count` plants: every friction, flow, delay, constant and effect `off` up or down.

    Both areas are off by the same sign: they are those of one bore.
    """
    rng = np.random.default_rng(seed)
    own = [u for u in unknowns_of(bundle, rig, model) if u.value != 0.0]
    fields = [u.direction[1] for u in own]
    found = []
    for _ in range(count):
        signs = rng.choice([-1.0, 1.0], len(own))
        if "area_a" in fields and "area_b" in fields:
            signs[fields.index("area_b")] = signs[fields.index("area_a")]
        found.append(model_at(model, own, _moved(own, off * signs)))
    return found


def _moved(unknowns: Sequence[Unknown], shares: FloatArray) -> FloatArray:
    values = [u.value * (1.0 + s) for u, s in zip(unknowns, shares, strict=True)]
    return np.array([min(max(v, u.lower), u.upper) for v, u in zip(values, unknowns, strict=True)])


def inside(
    drives: Sequence[Drive],
    rig: Actuators,
    plants: Sequence[Model],
    limits: MotionLimits,
    seed: int,
    *,
    at_rest_too: bool = False,
) -> BoolArray:
    """(drives,): whether each stays within the limits on every plant, from near where it starts.

    With `at_rest_too` also from there.
    """
    from sysid.plant.simulator import simulate

    if not drives:
        return np.zeros(0, dtype=bool)
    rng = np.random.default_rng(seed)
    # In units of half the travel, the same of each plant.
    near = 2.0 * _START * limits.position * rng.uniform(-1.0, 1.0, len(plants))
    rests = np.array([place_at_rest(plant.parameters) for plant in plants])
    rests = np.concatenate([rests + near, *([rests] if at_rest_too else [])])
    of_starts = [*plants] * (len(rests) // len(plants))
    starts = rests + np.array([d.start for d in drives])[:, None]
    commands = [d.commands(rig) for d in drives]
    inputs = [
        inputs_of_commands(d.kind, rig.time, *c, start)
        for d, c, own in zip(drives, commands, starts, strict=True)
        for start in own
    ]
    runs = simulate(inputs, of_starts * len(drives), nan_if_endless=True)
    held = [
        bool(
            not leaves_travel(run.position, limits.position, start).any()
            and np.abs(run.velocity).max() <= limits.speed
        )
        for run, start in zip(runs, starts.ravel(), strict=True)
    ]
    stays = np.array(held).reshape(starts.shape).all(axis=1)
    weak = [float(np.abs(motor).max()) <= limits.effort for motor, _ in commands]
    return np.asarray(stays & np.array(weak))


def extremes(motions: Sequence[CandidateMotion], plants: Sequence[Model]) -> tuple[float, float]:
    """The farthest position from the middle, rad or m, and the highest speed on any plant."""
    from sysid.plant.simulator import simulate

    rests = [place_at_rest(plant.parameters) for plant in plants]
    inputs = [
        inputs_of_commands(m.kind, m.time, m.motor, m.valves, r + m.start)
        for m in motions
        for r in rests
    ]
    runs = simulate(inputs, [*plants] * len(motions))
    far = max(float(np.abs(run.position).max()) for run in runs)
    return far, max(float(np.abs(run.velocity).max()) for run in runs)


def held_reach(plants: Sequence[Model], limits: MotionLimits) -> float:
    """How far from the middle friction holds all plants, rad or m, with a margin; 0 with a spring
    that rests them elsewhere."""
    if any(place_at_rest(plant.parameters) for plant in plants):
        return 0.0
    away = limits.position * np.linspace(0.0, 1.0, _PLACES)
    holds = [
        np.abs(load_effort(side * away, p) - p.offset) <= MARGIN * p.static_effort
        for p in (plant.parameters for plant in plants)
        for side in (-1.0, 1.0)
    ]
    slips = np.flatnonzero(~np.all(holds, axis=0))
    return float(away[max(slips[0] - 1, 0)] if slips.size else away[-1])


__all__ = [
    "CHECK_MARGIN",
    "MARGIN",
    "OFF",
    "MotionLimits",
    "extremes",
    "held_reach",
    "inside",
    "off_plants",
]
