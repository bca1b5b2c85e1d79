"""Friction from readings taken by hand: breakaway efforts, or steady speeds (thesis 3.4).

The law is Coulomb and viscous friction with breakaway,

    breakaway = static direction,    effort = coulomb direction + viscous velocity + offset,

the offset where readings of both directions show it, and what it lacks acts through the ports of
static and sliding friction. Readings at one speed or effort identify the sum of Coulomb and viscous
friction there, which stands for Coulomb friction then, and in both directions the offset. Of a
breakaway the effort is predicted. Of a steady motion one of the two was set and the other followed,
which is predicted: a line through what was set over what followed would be too flat, since it is
the latter that scatters. In the thesis the torque was set (3.4.3, Table 3.4.2), under a controller
of the speed it is the speed. A linear axis has forces and speeds along its way.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sysid.diagnosis.bench.component import Component, Law, law_held, probes, shapes
from sysid.diagnosis.thresholds import ACTS
from sysid.errors import Notice, NotIdentifiedError, input_error
from sysid.estimation.combinations import Sums, mean_friction, unidentified
from sysid.estimation.linear import (
    LEVEL,
    RANK_TOLERANCE,
    Estimate,
    linear_fit,
    t_quantile,
)
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
# A modelled speed is searched for up to this many times the fastest reading.
_FASTEST = 4.0
_HALVINGS = 50
_OTHER_WAY = " and in the other direction"


@dataclass(frozen=True)
class FrictionPoints(Component):
    """Readings, all of breakaway or all of sliding: (n,) each, in the rig's units of position,
    speed and effort; a row is a test. `is_certain`: whether it is known which of speed and effort
    was set; `tells_speeds`: whether Coulomb and viscous friction are numbers of their own.

    `direction` is 1 or -1; `number` counts the readings of a log. Residuals are efforts of
    breakaway and of motion whose speed was set, else speeds at the effort that was set.
    """

    base_parameters: Parameters
    units: MotionUnits
    labels: tuple[str, ...]
    position: FloatArray
    velocity: FloatArray
    effort: FloatArray
    direction: FloatArray
    number: FloatArray
    is_speed_set: bool
    is_certain: bool = True
    tells_speeds: bool = field(default=True, init=False)
    has_constant: bool = field(default=False, init=False)
    channel: str = field(default="", init=False)
    unit: str = field(default="", init=False)

    def __post_init__(self) -> None:
        u = self.units
        object.__setattr__(self, "tells_speeds", self.is_breakaway or self._tells_speeds())
        by_effort = self._effort_follows
        follows = (u.effort_channel, u.effort) if by_effort else (u.speed_channel, u.speed)
        own = (*follows, not self.is_breakaway and self._goes_both_ways)
        for name, value in zip(("channel", "unit", "has_constant"), own, strict=True):
            object.__setattr__(self, name, value)

    @property
    def _goes_both_ways(self) -> bool:
        return len(np.unique(self.direction)) == 2

    def _tells_speeds(self) -> bool:
        """Whether the readings tell viscous from Coulomb friction, and from an offset in both
        directions: not where what was set has one level each way, nor where viscous friction may be
        anything from none to all of it, as it may without readings, or no speed rises with the
        effort. Where it is not certain what was set, the two regressions have to agree.
        """
        over_speed = self._slope(self.velocity, self.effort)
        over_effort = self._slope(self.effort, self.velocity)
        if (over_speed if self.is_speed_set else over_effort) is None:
            return False
        if over_speed is not None and (self.is_speed_set or not self.is_certain):
            low, high = over_speed
            if low <= 0.0 and high >= np.abs(self.effort).mean() / np.abs(self.velocity).mean():
                return False
        if over_effort is not None and (not self.is_speed_set or not self.is_certain):
            low, high = over_effort
            if low <= 0.0 <= high:
                return False
            if not self.is_certain and over_speed is not None and low > 0.0:
                return over_speed[0] <= 2.0 / (low + high) <= over_speed[1]
        return True

    def _slope(self, level: FloatArray, followed: FloatArray) -> tuple[float, float] | None:
        """The 95 % interval of how what followed rises with levels (n,); None at one level each
        way. Without repeats the line itself."""
        columns = [self.direction, level]
        columns += [np.ones_like(level)] if self._goes_both_ways else []
        both = np.column_stack(columns)
        scaled = both / np.linalg.norm(both, axis=0)
        if int(np.linalg.matrix_rank(scaled, RANK_TOLERANCE)) < both.shape[1]:
            return None
        fit = linear_fit(both, followed)
        half = t_quantile(fit.dof) * math.sqrt(fit.covariance[1, 1]) if fit.dof else 0.0
        return float(fit.coefficients[1] - half), float(fit.coefficients[1] + half)

    @property
    def tests(self) -> tuple[str, ...]:
        return self.labels

    @property
    def travel(self) -> float:
        return float(np.ptp(self.position))

    @property
    def most_folds(self) -> int:
        """Each reading is left out by itself."""
        return len(self.labels)

    @property
    def is_breakaway(self) -> bool:
        """Whether the axis was at rest up to the effort that was read."""
        return not self.velocity.any()

    @property
    def _effort_follows(self) -> bool:
        # At one level all friction is one number, that of the efforts.
        return self.is_breakaway or self.is_speed_set or not self.tells_speeds

    def in_form_of(self, bundle: Bundle) -> FrictionPoints:
        """The readings, of which that followed which followed in those that a bundle was fitted to:
        few held-out readings do not show it."""
        judged = bundle.friction.quality if bundle.friction is not None else None
        record = judged.get(KIND) if isinstance(judged, dict) else None
        u = self.units
        if record is None or record.signal not in (u.speed_channel, u.effort_channel):
            return self
        return replace(self, is_speed_set=record.signal == u.effort_channel)

    def parameters(self) -> list[Parameter]:
        u, effort, speed = self.units, np.abs(self.effort), np.abs(self.velocity)
        largest = size = float(effort.mean())
        if self.is_breakaway:
            return [Parameter(u.key("static"), size, u.effort, 0.0, scale=size)]
        if not self.tells_speeds:
            found = [Parameter(u.key("coulomb"), size, u.effort, 0.0, scale=size)]
            if self.has_constant:
                found.append(
                    Parameter(u.key("offset"), float(self.effort.mean()), u.effort, scale=size)
                )
            return found
        mean = float(speed.mean())
        offset = self._guessed_offset() if self.has_constant else 0.0
        effort = self.direction * (self.effort - offset)
        size = float(effort.mean())
        rise = float((effort - size) @ (speed - mean))
        if self.is_speed_set:
            slope = max(rise, 0.0) / float(np.sum((speed - mean) ** 2))
        else:
            slope = float(np.sum((effort - size) ** 2)) / rise if rise > 0.0 else math.inf
        # A start from which the fit can move: a law that holds the axis at rest has no slope.
        slope = slope if slope * mean < size else 0.5 * size / mean
        found = [
            Parameter(u.key("coulomb"), size - slope * mean, u.effort, 0.0, scale=largest),
            Parameter(u.key("viscous"), slope, u.viscous_unit, 0.0, scale=largest / mean),
        ]
        if self.has_constant:
            found.append(Parameter(u.key("offset"), offset, u.effort, scale=largest))
        return found

    def _guessed_offset(self) -> float:
        """By a plane through what followed, over what was set and its direction."""
        level = self.velocity if self.is_speed_set else self.effort
        columns = np.column_stack((level, self.direction, np.ones_like(level)))
        slope, _, constant = np.linalg.lstsq(columns, self._followed, rcond=None)[0]
        if self.is_speed_set:
            return float(constant)
        # Where no speed rises with the effort, nothing is known of it yet.
        return -float(constant / slope) if slope > 0.0 else 0.0

    @property
    def _followed(self) -> FloatArray:
        return self.effort if self._effort_follows else self.velocity

    @property
    def _cells(self) -> IntArray:
        """Which readings repeat one another, (n,): at one place, one way, one effort or speed
        set."""
        level = self.velocity if self._effort_follows else self.effort  # of breakaway 0
        conditions = np.column_stack((self.direction, self.position, level))
        return np.unique(conditions, axis=0, return_inverse=True)[1].reshape(-1)

    def effects(
        self, catalogue: Mapping[str, type[CatalogueEffect]]
    ) -> tuple[type[CatalogueEffect], ...]:
        """Those without states whose effort differs from the law's at the conditions read.

        Judged at the mean of each condition: the scatter over speed of readings at one effort that
        was set contains no information on how friction depends on speed.
        """
        law = Law({p.name: p.value for p in self.parameters()})
        cells = self._cells
        count = np.bincount(cells)
        place, velocity, direction = (
            np.bincount(cells, v) / count for v in (self.position, self.velocity, self.direction)
        )
        own = [direction] if self.is_breakaway else [direction, velocity]
        own += [np.ones_like(velocity)] if self.has_constant else []
        basis = np.linalg.qr(np.column_stack(own))[0]
        without = self._friction(law, place, velocity, direction)

        def acts(probe: CatalogueEffect) -> bool:
            there = Law(law.values, (probe,))
            more = self._friction(there, place, velocity, direction) - without
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

    def _friction(
        self, law: Law, place: FloatArray, velocity: FloatArray, direction: FloatArray
    ) -> FloatArray:
        """Breakaway or friction with the sign of the motion that it resists; (n,) each.

        A breakaway is the friction of the first instant of a motion, so what varies Coulomb
        friction (along the travel, by direction) varies it by the same share: its Coulomb
        part is the static effort, its velocity 0.
        """
        if self.is_breakaway:
            static = self._value(law, "static")
            parameters = self.base_parameters.replace(static_effort=static, coulomb_effort=static)
        else:
            parameters = self.base_parameters.replace(
                coulomb_effort=self._value(law, "coulomb"),
                # Of a law of one speed the sum is all Coulomb friction.
                viscous=law.values.get(self.units.key("viscous"), 0.0),
            )
        point = Point.at_rest(
            parameters,
            np.zeros_like(velocity),
            position=place,
            velocity=velocity,
            direction=direction,
        )
        model = Model(parameters, law.effects)
        if not self.is_breakaway:
            return np.asarray(plant.sliding_friction(point, model))
        held = model.through("static_effort", parameters.static_effort, point)
        return np.asarray(model.through("friction_effort", held * direction, point))

    def _offset(self, law: Law) -> float:
        """The constant part of the effort; of a breakaway none is known."""
        return 0.0 if self.is_breakaway else law.values.get(self.units.key("offset"), 0.0)

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
        """Velocity at which friction is as large as the effort set; (rows,).

        0 where that does not start the axis.
        """
        way, place = self.direction[rows], self.position[rows]
        wanted = way * (self.effort[rows] - self._offset(law))
        low = np.zeros(len(rows))
        high = np.full(len(rows), _FASTEST * float(np.abs(self.velocity).max()))
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            below = way * self._friction(law, place, way * middle, way) <= wanted
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return np.asarray(way * 0.5 * (low + high))

    def residuals(self, law: Law, tests: Sequence[int]) -> list[FloatArray]:
        rows = np.asarray(tests, dtype=np.intp)
        if self._effort_follows:
            modelled = self._offset(law) + self._friction(
                law, self.position[rows], self.velocity[rows], self.direction[rows]
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
        u = self.units
        known = {
            u.place: self.position,
            "direction": self.direction,
            "number of the reading": self.number,
        }
        if self.is_speed_set:
            known["velocity"] = self.velocity
        elif not self.is_breakaway:
            known[u.word] = self.effort
        return {name: values[rows] for name, values in known.items()}

    def noise_floor(self, law: Law) -> float:
        """Spread of readings that repeat one another; without such, of neighbours one way."""
        cells = self._cells
        count = np.bincount(cells)
        dof = len(cells) - len(count)
        if dof > 0:
            means = np.bincount(cells, self._followed) / count
            return math.sqrt(float(np.sum((self._followed - means[cells]) ** 2)) / dof)
        order = np.argsort(cells)
        one_way = np.diff(self.direction[order]) == 0.0
        steps = np.diff(self._followed[order])[one_way]
        return math.sqrt(0.5 * float(np.mean(steps**2))) if len(steps) else math.nan

    def _sums(self, estimates: Mapping[str, Estimate]) -> Sums:
        """What readings at one level identify, with the law's numbers; of others nothing."""
        if self.tells_speeds or self.is_breakaway:
            return Sums()
        u = self.units
        known = mean_friction(self.effort, self.velocity, self.direction, u)
        # With an effect next to it the sum differs from the mean of the readings.
        own = known.rows[0].estimate
        own = own.shifted(estimates[u.key("coulomb")].value - own.value)
        other = "speed" if self.is_speed_set else u.word
        test = f"readings at another {other}" + ("" if self.has_constant else _OTHER_WAY)
        return Sums((replace(known.rows[0], estimate=own, test=test),), known.offset)

    def identified(self, estimates: Mapping[str, Estimate]) -> Mapping[str, Estimate]:
        sums = self._sums(estimates)
        if not sums:
            return estimates
        u = self.units
        names = [name for name in (*FRICTION, "offset") if name != "static"]
        found = {u.key(name): unidentified(name, u.unit(name), sums.rows, "") for name in names}
        if sums.offset is not None:
            found[u.key("offset")] = sums.offset
        return found

    def part(self, estimates: Mapping[str, Estimate], quality: FitQuality | None = None) -> Parts:
        wanted = "steady motion" if self.is_breakaway else "breakaway"
        reason = f"no reading shows it; {wanted} readings in a separate campaign would identify it"
        unread = {
            self.units.key(name): Estimate.unidentified(self.units.unit(name), reason)
            for name in FRICTION
        }
        known = self.identified(estimates)
        found: dict[str, Any] = {key: known.get(key, absent) for key, absent in unread.items()}
        offset = self.units.key("offset")
        found |= {offset: known[offset]} if offset in known else {}
        if sums := self._sums(estimates):
            found["combinations"] = [row.to_json() for row in sums.rows]
        judged = quality_field(quality, KIND)
        return Parts(friction=Friction.model_validate({**found, **judged}))

    def law_of(self, bundle: Bundle) -> Law:
        if self.is_breakaway:
            names = [self.units.key("static")]
            return law_held("friction", bundle.friction, names, f"{KIND} readings")
        held, u = bundle.friction, self.units
        offset = u.key("offset")
        if not self.tells_speeds and held is not None and held.sum_in_motion is not None:
            known = {u.key(name): held.in_motion(name) for name in ("coulomb", "viscous", "offset")}
            return Law({k: 0.0 if e is None else e.value for k, e in known.items()})
        names = [u.key("coulomb"), u.key("viscous")]
        own = held.offset if held is not None else None
        # Readings of one direction have the offset that those of both have shown.
        if self.has_constant or (own is not None and own.identified):
            names.append(offset)
        absent = {offset: 0.0} if self.has_constant else {}
        return law_held("friction", held, names, f"{KIND} readings", **absent)

    def said_of(self, estimates: Mapping[str, Estimate]) -> tuple[str, ...]:
        key = self.units.key("offset")
        offset = self.identified(estimates).get(key)
        sums = tuple(row.notice for row in self._sums(estimates).rows)
        if offset is None or not offset.identified or offset.holds(0.0):
            return sums
        low, high = offset.interval
        line = (
            f"friction differs with the direction: an offset of {offset.value:.3g} "
            f"({low:.3g} to {high:.3g}) {offset.unit}"
        )
        return (*sums, Notice(line, f"friction.{key}"))


def friction_points(trials: Sequence[Trial], rig: Rig) -> FrictionPoints:
    """The readings of `trials`: the speed (0: breakaway) and the motor's effort, in the rig's
    channels.

    The position is used where it is there. Raises InputError for a missing column, a reading
    without a direction, and breakaway mixed with sliding; NotIdentifiedError without a test.
    """
    if not trials:
        raise NotIdentifiedError(f"no {KIND} test to fit; give breakaway or sliding readings")
    u = rig.units
    names = (u.speed_channel, u.effort_channel)
    for trial in trials:
        trial.require(names, f"which a {KIND} test needs")
        _check(trial, u)
    velocity, effort = (np.concatenate([t[name] for t in trials]) for name in names)
    at_rest = velocity == 0.0
    if at_rest.any() and not at_rest.all():
        raise input_error(
            trials[int(np.argmax([bool(t[names[0]].any()) for t in trials]))].source,
            "breakaway readings (velocity 0) are mixed with sliding ones",
            "give each kind its own campaign",
        )
    channel = rig.position_channel
    direction = np.sign(effort if at_rest.all() else velocity)
    set_speed = not at_rest.any() and _is_speed_set(velocity, effort, direction)
    return FrictionPoints(
        base_parameters=bare_parameters(rig),
        units=u,
        labels=tuple(t.title for t in trials for _ in range(len(t))),
        position=np.concatenate([t[channel] if channel in t else np.zeros(len(t)) for t in trials]),
        velocity=velocity,
        effort=effort,
        direction=direction,
        number=np.concatenate([np.arange(1.0, len(t) + 1.0) for t in trials]),
        is_speed_set=bool(set_speed),
        is_certain=set_speed is not None,
    )


def _is_speed_set(velocity: FloatArray, effort: FloatArray, direction: FloatArray) -> bool | None:
    """Whether the readings (n,) are of speeds that were set, whose effort followed; None: perhaps.

    What was set takes levels, which repeat. Where both do or neither, what followed is the smoother
    course over what was set: a friction curve that falls and rises again has one effort at each
    speed, but two speeds at an effort. Without a decision the effort is taken to be what was set,
    as in the thesis.
    """
    from scipy.special import fdtri

    speed_repeats, effort_repeats = map(_repeats, (np.abs(velocity), np.abs(effort)))
    if speed_repeats != effort_repeats:
        return speed_repeats
    ways = [direction == way for way in np.unique(direction)]
    steps = sum(int(np.count_nonzero(way)) - 1 for way in ways)
    over_speed, over_effort = (
        _roughness([(a[way], b[way]) for way in ways])
        for a, b in ((velocity, effort), (effort, velocity))
    )
    if steps < 1 or not math.isfinite(over_speed + over_effort):
        return None
    least = float(fdtri(steps, steps, LEVEL))
    if over_effort > least * over_speed:
        return True
    return False if over_speed > least * over_effort else None


def _repeats(values: FloatArray) -> bool:
    """Whether half of the values (n,) or more are those of others too: levels that were set."""
    count = np.unique(values, return_counts=True)[1]
    return bool(2 * count[count > 1].sum() >= len(values))


def _roughness(courses: Sequence[tuple[FloatArray, FloatArray]]) -> float:
    """Mean square of the steps of `b` in the order of `a`, over its variance, of pairs (a, b)."""
    steps = sum(float(np.sum(np.diff(b[np.argsort(a, kind="stable")]) ** 2)) for a, b in courses)
    spread = sum(float(np.sum((b - b.mean()) ** 2)) for _, b in courses)
    return steps / spread if spread > 0.0 else math.nan


def _check(trial: Trial, u: MotionUnits) -> None:
    """InputError for a reading that contains no information on friction."""
    velocity, effort = trial[u.speed_channel], trial[u.effort_channel]
    bad = np.flatnonzero((effort == 0.0) | (velocity * effort < 0.0))
    if bad.size:
        i = int(bad[0])
        against = f"is against the motion at {velocity[i]:g} {u.speed}"
        raise input_error(
            f"{trial.source}, reading {i + 1}",
            f"{u.effort_channel} = {effort[i]:g} {'is zero' if effort[i] == 0.0 else against}",
            f"give the {u.word} that overcame friction, with the sign of the motion",
        )


__all__ = ["KIND", "FrictionPoints", "friction_points"]
