"""An axis: motor, friction and inertia, with or without a cylinder whose pressures are logged.

The law is the effort balance of thesis 3.4.1 and 3.4.2,

    inertia a + coulomb sign(v) + viscous v + offset = motor + cylinder - gravity,

taken along the measured motion, which is imposed: effects act on it through the model's
ports. Both sides go through the same zero-phase filter.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sysid import signals
from sysid.balance.imposed import ImposedMotion, effort_gap, imposed_motion
from sysid.balance.samples import tells_speeds
from sysid.diagnosis.bench.component import Component, Law, bends, law_held, rmse, smallest_probe
from sysid.errors import NotIdentifiedError
from sysid.estimation.linear import Estimate
from sysid.estimation.nonlinear import Parameter
from sysid.estimation.quality import FitQuality
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.parameters import Bundle, Friction, Parts
from sysid.parameters.assembled_model import require_moving_inertia
from sysid.parameters.quality import quality_field
from sysid.plant import plant
from sysid.plant.base import bare_parameters
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.effects.linear import ROTARY_ONLY
from sysid.plant.effects.linkage import InertiaMismatch
from sysid.plant.effects.motor import TorqueSaturation
from sysid.plant.ports import Model, Point, overrides
from sysid.recording.even import recorded
from sysid.recording.friction_kind import MOTION
from sysid.recording.recording import Recording
from sysid.types import FloatArray

# Fewest tests: fewer trials than this are cut into stretches.
_FEWEST_TESTS = 3
_STRETCHES = 6
_LEAST_CHANGE = 1e-9
# A command that is so much larger has to move the motor's effort by this share of that, for all but
# so many of the samples.
_MORE, _ANSWERS, _MOST_DEAF = 1e-3, 0.5, 0.5
# Motion turns at the ends of what it visits: what the filter leaves of a reversal looks like one.
_LIKE_REVERSALS = ("end-cushion",)
_PORTS = ("parameters", "motor_effort", "friction_effort", "external_effort", "pitch_radius")


@dataclass(frozen=True)
class Axis(Component):
    """An axis on its tests; `axis` builds one from trials."""

    rig: Rig
    cases: tuple[ImposedMotion, ...]
    trials: tuple[Trial, ...]
    has_speeds: bool
    # Filters and derivatives leave as much of an exact law on logs without noise.
    precision = 0.0025
    channel: str = field(default="", init=False)
    unit: str = field(default="", init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "channel", self.rig.effort_channel)
        object.__setattr__(self, "unit", self.rig.units.effort)

    @property
    def tests(self) -> tuple[str, ...]:
        return tuple(case.recording.trial.title for case in self.cases)

    @property
    def travel(self) -> float:
        places = [np.asarray(c.point.position)[c.rows] for c in self.cases]
        return float(np.ptp(np.concatenate(places)))

    def parameters(self) -> list[Parameter]:
        u = self.rig.units
        effort = float(np.mean([np.mean(np.abs(c.point.motor)) for c in self.cases]))
        speed = float(np.mean([np.mean(np.abs(c.point.velocity)) for c in self.cases]))
        found = [
            Parameter(u.key("coulomb"), 0.3 * effort, u.effort, 0.0, scale=effort),
        ]
        if self.has_speeds:
            steep = effort / speed
            found.append(Parameter(u.key("viscous"), 0.1 * steep, u.viscous_unit, 0.0, scale=steep))
            found.append(Parameter(u.key("offset"), 0.0, u.effort, scale=effort))
        if self.rig.total_inertia() is None:
            steep = float(np.mean([np.std(c.seen.acceleration) for c in self.cases]))
            start = 0.1 * effort / steep if steep > 0.0 else 1.0
            found.append(Parameter(u.key("inertia"), start, u.inertia_unit, 0.0))
        return found

    def effects(
        self, catalogue: Mapping[str, type[CatalogueEffect]]
    ) -> tuple[type[CatalogueEffect], ...]:
        """Those without states of their own that change the balance beyond rounding."""
        return tuple(kind for kind in catalogue.values() if not kind.states and self._feels(kind))

    def _feels(self, kind: type[CatalogueEffect]) -> bool:
        if not overrides(kind, *_PORTS):
            return False
        if kind.id in _LIKE_REVERSALS or (self.rig.is_linear and kind.id in ROTARY_ONLY):
            return False
        if kind.id == TorqueSaturation.id and self.rig.motor is None:
            return False  # the log holds the force as it was, beyond any limit of it
        if kind.id == InertiaMismatch.id and self.rig.total_inertia() is None:
            return False  # nothing is declared, and the inertia is fitted
        values = {p.name: p.value for p in self.parameters()}
        effect = smallest_probe(kind, self.side())
        plain, changed = (
            np.concatenate(self.residuals(Law(values, effects), range(len(self.cases))))
            for effects in ((), (effect,))
        )
        if np.max(np.abs(changed - plain)) <= _LEAST_CHANGE * np.max(np.abs(plain)):
            return False
        return self.has_speeds or not _depends_on_speed(effect, self.cases[0].point)

    def side(self) -> str:
        return "both"

    def is_possible(self, law: Law) -> bool:
        """Not if the motor would hardly answer to most of the commands that moved the axis.

        As with a limit below friction: such an effect explains a log by taking away what it holds.
        """
        model, deaf, count = self._model(law), 0, 0
        for case in self.cases:
            parameters = model.at(case.point.time)
            point = dataclasses.replace(case.point, parameters=parameters)
            more = dataclasses.replace(point, motor=(1.0 + _MORE) * point.motor)
            answer = plant.motor_effort(more, model) - plant.motor_effort(point, model)
            own = np.abs(_MORE * point.motor)[case.rows]
            deaf += int(np.count_nonzero(np.abs(answer)[case.rows] < _ANSWERS * own))
            count += int(np.count_nonzero(own))
        return deaf <= _MOST_DEAF * count

    def residuals(self, law: Law, tests: Sequence[int]) -> list[FloatArray]:
        # Stretches of one trial share its motion.
        whole: dict[int, FloatArray] = {}
        for i in tests:
            case = self.cases[i]
            if id(case.point) not in whole:
                whole[id(case.point)] = self._residual(case, law)
        return [whole[id(self.cases[i].point)][self.cases[i].rows] for i in tests]

    def measured(self, tests: Sequence[int]) -> list[FloatArray]:
        """What friction, and an inertia that is not declared, balance."""
        nothing = Law({p.name: 0.0 for p in self.parameters()})
        return self.residuals(nothing, tests)

    def _residual(self, case: ImposedMotion, law: Law) -> FloatArray:
        """Of the whole trial that a stretch belongs to, (n,)."""
        return effort_gap(case, self._model(law))

    def _model(self, law: Law) -> Model:
        u = self.rig.units
        values = law.values
        inertia = values.get(u.key("inertia"), self.rig.total_inertia())
        parameters = bare_parameters(self.rig).replace(
            coulomb_effort=values[u.key("coulomb")],
            viscous=values.get(u.key("viscous"), 0.0),
            # A friction bundle counts it against the motion, the model along it.
            offset=-values.get(u.key("offset"), 0.0),
            inertia=inertia,
        )
        return Model(parameters, law.effects)

    def regressors(self, tests: Sequence[int]) -> dict[str, FloatArray]:
        found: dict[str, list[FloatArray]] = {}
        for i in tests:
            case = self.cases[i]
            p = case.point
            own = {
                "velocity": p.velocity,
                "position" if self.rig.is_linear else "angle": p.position,
                "acceleration": case.seen.acceleration,
                "motor": p.motor,
                "time": p.time,
            }
            if self.rig.cylinder is not None:
                atmosphere = float(p.parameters.atmosphere)
                gauge = p.pressure_a + p.pressure_b - 2.0 * atmosphere
                own["gauge_pressure_sum times direction"] = gauge * p.direction
            for name, values in own.items():
                found.setdefault(name, []).append(np.asarray(values)[case.rows])
        return {name: np.concatenate(parts) for name, parts in found.items()}

    def noise_floor(self, law: Law) -> float:
        """What changes over more than the filter's length, beyond a straight line (N or Nm).

        Samples closer together share the filter's noise.
        """
        found = []
        for case, left in zip(self.cases, self.residuals(law, range(len(self.cases))), strict=True):
            step = max(1, int(np.median(np.diff(case.rows)))) if len(case.rows) > 1 else 1
            lag = max(1, math.ceil(case.balanced.length / step))
            if len(left) > 2 * lag:
                near = np.ptp(np.stack([case.rows[2 * lag :], case.rows[: -2 * lag]]), axis=0)
                found.append(bends(left, lag)[near <= 3 * lag * step])
        return rmse(found)

    def part(self, estimates: Mapping[str, Estimate], quality: FitQuality | None = None) -> Parts:
        # What the fit could identify only together the law has as one number.
        sums: dict[str, Any] = {} if self.has_speeds else {"combinations": []}
        judged = quality_field(quality, MOTION)
        return Parts(friction=Friction.model_validate({**estimates, **sums, **judged}))

    def law_of(self, bundle: Bundle) -> Law:
        u = self.rig.units
        tests = "friction-motion or friction-sliding tests"
        names = [p.name for p in self.parameters()]
        assumed = {u.key("offset"): 0.0} if u.key("offset") in names else {}
        if not self.has_speeds and bundle.friction is not None:
            # At one speed the law's Coulomb friction is all friction at that speed.
            for one in bundle.friction.sums().values():
                if one.of == [u.key("coulomb"), u.key("viscous")]:
                    assumed[u.key("coulomb")] = one.estimate.value
        return law_held("friction", bundle.friction, names, tests, **assumed)

    def further_errors(self, law: Law) -> dict[str, tuple[float, float]]:
        """Of the position, simulated open loop over each whole trial from its first row.

        Only where no pressure acts: a logged chamber's pressure is not the simulator's. Raises
        NotIdentifiedError for an inertia that cannot be.
        """
        from sysid.plant.simulator import Inputs, simulate

        if self.rig.cylinder is not None:
            return {}
        model = self._model(law)
        require_moving_inertia(float(model.parameters.inertia), self.rig, "the law")
        # Motion does not determine breakaway: it is set to sliding friction.
        model = Model(
            model.parameters.replace(static_effort=model.parameters.coulomb_effort), model.effects
        )
        gaps = []
        for trial in self.trials:
            position = trial[self.rig.position_channel]
            inputs = Inputs(
                time=trial.time,
                motor=np.asarray(trial[self.rig.effort_channel]),
                position=float(position[0]),
            )
            gaps.append(position - simulate([inputs], [model])[0].position)
        name = self.rig.position_channel
        noise = [signals.noise_floor(t[name], stride=t.stride_of(name)).total for t in self.trials]
        return {self.rig.position_channel: (rmse(gaps), math.hypot(*noise) / math.sqrt(len(noise)))}


def _depends_on_speed(effect: CatalogueEffect, point: Point) -> bool:
    """Whether an effect's friction changes with speed, all else equal."""
    faster = dataclasses.replace(point, velocity=1.5 * np.asarray(point.velocity))
    nothing = np.zeros(len(np.asarray(point.time)))
    slow, fast = (np.asarray(effect.friction_effort(nothing, p)) for p in (point, faster))
    return bool(np.any(slow != fast))


def axis(trials: Sequence[Trial], rig: Rig) -> Axis:
    """An axis from friction-motion trials. Raises InputError, NotIdentifiedError.

    Three or more trials are left out one by one; fewer are cut into stretches.
    """
    cases: list[ImposedMotion] = []
    pieces = 1 if len(trials) >= _FEWEST_TESTS else math.ceil(_STRETCHES / max(len(trials), 1))
    for trial in trials:
        # The friction fit has already reported notices about its channels.
        cases += _cases(recorded(trial, rig, []), pieces)
    if not cases:
        raise NotIdentifiedError(
            "friction: the axis hardly moves in these tests; give motion that crosses the stroke "
            "in both directions"
        )
    speed = np.concatenate([np.asarray(c.point.velocity)[c.rows] for c in cases])
    load = np.concatenate([c.recording.cylinder[c.rows] for c in cases])
    return Axis(rig, tuple(cases), tuple(trials), tells_speeds(speed, load))


def _cases(recording: Recording, pieces: int) -> list[ImposedMotion]:
    """A recording as one test, or cut into stretches of equal length."""
    whole = imposed_motion(recording)
    rows = whole.rows
    edges = np.linspace(0, len(recording), pieces + 1)
    found = []
    for k in range(pieces):
        own = rows[(rows >= edges[k]) & (rows < edges[k + 1])]
        if len(own):
            found.append(dataclasses.replace(whole, rows=own))
    return found


__all__ = ["Axis", "axis"]
