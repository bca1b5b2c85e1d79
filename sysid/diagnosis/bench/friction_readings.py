"""Friction from readings taken by hand: breakaway efforts, or steady speeds (thesis 3.4).

The law is Coulomb and viscous friction with breakaway,

    breakaway = static direction,    effort = coulomb direction + viscous velocity,

and what it lacks acts through the ports of static and sliding friction. Of a breakaway the
torque is predicted. Of a steady motion the torque was set and the speed followed (3.4.3), so
the speed is predicted: a line through torque over speed would be too flat, since it is the
speeds that scatter (Table 3.4.2).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.diagnosis.bench.component import Component, Law, law_held, probes, shapes
from sysid.diagnosis.thresholds import ACTS
from sysid.errors import NotIdentifiedError, input_error
from sysid.estimation.linear import Estimate
from sysid.estimation.nonlinear import Parameter
from sysid.estimation.quality import FitQuality
from sysid.io.logs import Trial
from sysid.io.motion import FRICTION, MotionUnits
from sysid.io.rig import Rig
from sysid.parameters import Bundle, Friction, Parts
from sysid.parameters.quality import quality_field
from sysid.plant import plant
from sysid.plant.base import Parameters, bare_parameters
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model, Point
from sysid.types import FloatArray, IntArray

KIND = "friction-points"
SPEED = "velocity_rad_per_s"
TORQUE = "motor_torque_nm"
# A modelled speed is searched for up to this many times the fastest reading.
_FASTEST = 4.0
_HALVINGS = 50


@dataclass(frozen=True)
class FrictionPoints(Component):
    """Readings, all of breakaway or all of sliding: (n,) each, rad, rad/s, Nm; a row is a test.

    `direction` is 1 or -1; `number` counts the readings of a log. Residuals of breakaway are
    torques, Nm, those of sliding speeds at the torque that was set, rad/s.
    """

    base_parameters: Parameters
    units: MotionUnits
    labels: tuple[str, ...]
    angle: FloatArray
    velocity: FloatArray
    torque: FloatArray
    direction: FloatArray
    number: FloatArray
    has_constant = False
    channel: str = field(default="", init=False)
    unit: str = field(default="", init=False)

    def __post_init__(self) -> None:
        channel, unit = (TORQUE, "Nm") if self.is_breakaway else (SPEED, "rad/s")
        object.__setattr__(self, "channel", channel)
        object.__setattr__(self, "unit", unit)

    @property
    def tests(self) -> tuple[str, ...]:
        return self.labels

    @property
    def travel(self) -> float:
        return float(np.ptp(self.angle))

    @property
    def most_folds(self) -> int:
        """Each reading is left out by itself."""
        return len(self.labels)

    @property
    def is_breakaway(self) -> bool:
        """Whether the axis was at rest up to the effort that was read."""
        return not self.velocity.any()

    def parameters(self) -> list[Parameter]:
        u, effort, speed = self.units, np.abs(self.torque), np.abs(self.velocity)
        size = float(effort.mean())
        if self.is_breakaway:
            return [Parameter(u.key("static"), size, u.effort, 0.0, scale=size)]
        centred = effort - size
        if len(np.unique(effort)) < 2:
            raise NotIdentifiedError(
                f"{u.key('coulomb')} and {u.key('viscous')} are not identified: all readings are "
                f"at {size:g} {u.effort}; take some at another torque"
            )
        mean = float(speed.mean())
        rise = float(centred @ speed)
        slope = float(centred @ centred) / rise if rise > 0.0 else math.inf
        # A start from which the fit can move: a law that holds the axis at rest has no slope.
        slope = slope if slope * mean < size else 0.5 * size / mean
        return [
            Parameter(u.key("coulomb"), size - slope * mean, u.effort, 0.0, scale=size),
            Parameter(u.key("viscous"), slope, u.viscous_unit, 0.0, scale=size / mean),
        ]

    @property
    def _followed(self) -> FloatArray:
        return self.torque if self.is_breakaway else self.velocity

    @property
    def _cells(self) -> IntArray:
        """Which readings repeat one another, (n,): at one angle, one way, one torque set."""
        torque = np.zeros_like(self.torque) if self.is_breakaway else self.torque
        conditions = np.column_stack((self.angle, self.direction, torque))
        return np.unique(conditions, axis=0, return_inverse=True)[1].reshape(-1)

    def effects(
        self, catalogue: Mapping[str, type[CatalogueEffect]]
    ) -> tuple[type[CatalogueEffect], ...]:
        """Those without states whose effort differs from the law's at the conditions read.

        Judged at the mean of each condition: the scatter over speed of readings at one torque
        contains no information on how friction depends on speed.
        """
        law = Law({p.name: p.value for p in self.parameters()})
        cells = self._cells
        count = np.bincount(cells)
        angle, velocity, direction = (
            np.bincount(cells, v) / count for v in (self.angle, self.velocity, self.direction)
        )
        own = [direction] if self.is_breakaway else [direction, velocity]
        basis = np.linalg.qr(np.column_stack(own))[0]
        without = self._effort(law, angle, velocity, direction)

        def acts(probe: CatalogueEffect) -> bool:
            there = Law(law.values, (probe,))
            more = self._effort(there, angle, velocity, direction) - without
            beyond = more - basis @ (basis.T @ more)
            return bool(np.abs(beyond).max() > ACTS * np.abs(without).max())

        return tuple(
            kind
            for kind in catalogue.values()
            if not kind.states
            and any(
                acts(probe) for probe in probes(kind, self.side(), shapes(self.quantities_of(kind)))
            )
        )

    def side(self) -> str:
        return "both"

    def _effort(
        self, law: Law, angle: FloatArray, velocity: FloatArray, direction: FloatArray
    ) -> FloatArray:
        """Breakaway or friction, Nm, with the sign of the motion that it resists; (n,) each.

        A breakaway is the friction of the first instant of a motion, so what varies Coulomb
        friction (along the travel, by direction) varies it by the same share: its Coulomb
        part is the static effort, its velocity 0.
        """
        zero = np.zeros_like(velocity)
        if self.is_breakaway:
            static = self._value(law, "static")
            parameters = self.base_parameters.replace(static_effort=static, coulomb_effort=static)
        else:
            parameters = self.base_parameters.replace(
                coulomb_effort=self._value(law, "coulomb"),
                viscous=self._value(law, "viscous"),
            )
        ambient = zero + parameters.atmosphere
        point = Point(
            time=zero,
            position=angle,
            velocity=velocity,
            pressure_a=ambient,
            pressure_b=ambient,
            motor=zero,
            open_a=zero,
            open_b=zero,
            direction=direction,
            parameters=parameters,
        )
        model = Model(parameters, law.effects)
        if not self.is_breakaway:
            return np.asarray(plant.sliding_friction(point, model))
        held = model.through("static_effort", parameters.static_effort, point)
        return np.asarray(model.through("friction_effort", held * direction, point))

    def _value(self, law: Law, name: str) -> float:
        key = self.units.key(name)
        if key not in law.values:
            what = "breakaway" if self.is_breakaway else "sliding"
            raise NotIdentifiedError(
                f"{key} is not identified: the readings to predict are of {what}, the fitted "
                f"ones are not; fit {what} readings too, in a separate campaign"
            )
        return law.values[key]

    def _speed(self, law: Law, rows: IntArray) -> FloatArray:
        """Velocity, rad/s, at which friction is as large as the torque set; (rows,).

        0 where that does not start the axis.
        """
        way, angle = self.direction[rows], self.angle[rows]
        wanted = np.abs(self.torque[rows])
        low = np.zeros(len(rows))
        high = np.full(len(rows), _FASTEST * float(np.abs(self.velocity).max()))
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            below = way * self._effort(law, angle, way * middle, way) <= wanted
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.asarray(way * 0.5 * (low + high))

    def residuals(self, law: Law, tests: Sequence[int]) -> list[FloatArray]:
        rows = np.asarray(tests, dtype=np.intp)
        if self.is_breakaway:
            modelled = self._effort(
                law, self.angle[rows], np.zeros(len(rows)), self.direction[rows]
            )
        else:
            modelled = self._speed(law, rows)
        return list((self._followed[rows] - modelled).reshape(-1, 1))

    def measured(self, tests: Sequence[int]) -> list[FloatArray]:
        return list(self._followed[np.asarray(tests, dtype=np.intp)].reshape(-1, 1))

    def repeats(self) -> IntArray:
        return self._cells

    def regressors(self, tests: Sequence[int]) -> dict[str, FloatArray]:
        """What was set for a reading; the residual is of what followed."""
        rows = np.asarray(tests, dtype=np.intp)
        known = {
            "angle": self.angle,
            "direction": self.direction,
            "number of the reading": self.number,
        }
        if not self.is_breakaway:
            known["torque"] = self.torque
        return {name: values[rows] for name, values in known.items()}

    def noise_floor(self, law: Law) -> float:
        """Spread of readings that repeat one another; without such, between neighbours."""
        cells = self._cells
        count = np.bincount(cells)
        dof = len(cells) - len(count)
        if dof > 0:
            means = np.bincount(cells, self._followed) / count
            return math.sqrt(float(np.sum((self._followed - means[cells]) ** 2)) / dof)
        steps = np.diff(self._followed[np.argsort(cells)])
        return math.sqrt(0.5 * float(np.mean(steps**2))) if len(steps) else math.nan

    def part(self, estimates: Mapping[str, Estimate], quality: FitQuality | None = None) -> Parts:
        wanted = "steady motion" if self.is_breakaway else "breakaway"
        reason = f"no reading shows it; {wanted} readings in a separate campaign would identify it"
        unread = {
            self.units.key(name): Estimate.unidentified(self.units.unit(name), reason)
            for name in FRICTION
        }
        found = {key: estimates.get(key, absent) for key, absent in unread.items()}
        judged = quality_field(quality, KIND)
        return Parts(friction=Friction.model_validate({**found, **judged}))

    def law_of(self, bundle: Bundle) -> Law:
        names = [p.name for p in self.parameters()]
        return law_held("friction", bundle.friction, names, f"{KIND} readings")


def friction_points(trials: Sequence[Trial], rig: Rig) -> FrictionPoints:
    """The readings of `trials`: `velocity_rad_per_s` (0: breakaway) and the motor torque, Nm.

    `theta_rad` is used where it is there. Raises InputError for a missing column, a reading
    without a direction, and breakaway mixed with sliding; NotIdentifiedError without a test.
    """
    if not trials:
        raise NotIdentifiedError(f"no {KIND} test to fit; give breakaway or sliding readings")
    if rig.is_linear:
        raise input_error(
            rig.source, f"the rig is linear, {KIND} readings need a rotary one", "log the motion"
        )
    for trial in trials:
        trial.require((SPEED, TORQUE), f"which a {KIND} test needs")
        _check(trial)
    velocity, torque = (np.concatenate([t[name] for t in trials]) for name in (SPEED, TORQUE))
    at_rest = velocity == 0.0
    if at_rest.any() and not at_rest.all():
        raise input_error(
            trials[int(np.argmax([bool(t[SPEED].any()) for t in trials]))].source,
            "breakaway readings (velocity 0) are mixed with sliding ones",
            "give each kind its own campaign",
        )
    channel = rig.position_channel
    return FrictionPoints(
        base_parameters=bare_parameters(rig),
        units=rig.units,
        labels=tuple(t.title for t in trials for _ in range(len(t))),
        angle=np.concatenate([t[channel] if channel in t else np.zeros(len(t)) for t in trials]),
        velocity=velocity,
        torque=torque,
        direction=np.sign(torque if at_rest.all() else velocity),
        number=np.concatenate([np.arange(1.0, len(t) + 1.0) for t in trials]),
    )


def _check(trial: Trial) -> None:
    """InputError for a reading that contains no information on friction."""
    velocity, torque = trial[SPEED], trial[TORQUE]
    bad = np.flatnonzero((torque == 0.0) | (velocity * torque < 0.0))
    if bad.size:
        i = int(bad[0])
        said = "is zero" if torque[i] == 0.0 else f"is against the motion at {velocity[i]:g} rad/s"
        raise input_error(
            f"{trial.source}, reading {i + 1}",
            f"{TORQUE} = {torque[i]:g} {said}",
            "give the torque that overcame friction, with the sign of the motion",
        )


__all__ = ["KIND", "SPEED", "FrictionPoints", "friction_points"]
