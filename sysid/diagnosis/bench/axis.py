"""An axis: motor, friction and inertia, with or without a cylinder whose pressures are logged.

The law is the effort balance of thesis 3.4.1 and 3.4.2,

    inertia a + coulomb sign(v) + viscous v + offset = motor + cylinder - gravity,

taken along the measured motion, which is imposed: effects act on it through the model's
ports. Both sides go through the same zero-phase filter; what it makes of the turns of the motion,
at which the shaft may rest, counts for nothing (`ImposedMotion.without_turns`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import cast

import numpy as np

from sysid import signals
from sysid.balance.imposed import (
    ImposedMotion,
    effort_gaps,
    effort_noise,
    effort_that_arrives,
    imposed_motion,
)
from sysid.balance.samples import only_way, tells_speeds
from sysid.diagnosis.bench.component import (
    NOT_SIMULATED,
    Component,
    Further,
    Law,
    law_held,
    rmse,
    shapes,
    smallest_probe,
)
from sysid.diagnosis.bench.stability import pieces_of
from sysid.errors import Failure, NotIdentifiedError, SimulationError, on_its_own
from sysid.estimation.linear import Estimate
from sysid.estimation.nonlinear import Parameter
from sysid.estimation.quality import FitQuality
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.parameters import Bundle, Friction, Parts
from sysid.parameters.assembled_model import require_moving_inertia
from sysid.parameters.quality import quality_field
from sysid.plant.base import Parameters, bare_parameters
from sysid.plant.effects.entry import CatalogueEffect, Quantity
from sysid.plant.effects.friction import LoadDependentFriction, SealFriction
from sysid.plant.effects.linear import ROTARY_ONLY, linear_form
from sysid.plant.effects.linkage import LEAST_INERTIA, CableSpring, InertiaMismatch, SpringAtZero
from sysid.plant.effects.motor import TorqueSaturation
from sysid.plant.ports import Model, Point, overrides
from sysid.recording.even import recorded
from sysid.recording.friction_kind import MOTION
from sysid.recording.recording import Recording
from sysid.types import FloatArray, IntArray

# Of the speeds of all samples, without the spikes of a few.
_HARDLY_ANY = 0.99
_LEAST_CHANGE = 1e-9
# A command that is so much larger has to move the motor's effort by this share of that, for all but
# so many of the samples.
_MORE, _ANSWERS, _MOST_DEAF = 1e-3, 0.5, 0.5
_TESTS = "friction-motion or friction-sliding tests"
_PORTS = ("parameters", "motor_effort", "friction_effort", "external_effort", "pitch_radius")


@dataclass(frozen=True)
class Axis(Component):
    """An axis on its tests; `axis` builds one from trials.

    `has_speeds`: whether they tell friction over speed. `only_way`: the one direction, 1 or -1, in
    which they move, 0 for both; in one direction, as at one speed, the law's Coulomb friction is
    the sum that such tests identify. `scattering`: the direction (n,) of a test's residual along
    which its own friction lies, as long as the share that `whitened` takes off; none as measured.
    """

    rig: Rig
    cases: tuple[ImposedMotion, ...]
    trials: tuple[Trial, ...]
    has_speeds: bool
    only_way: float = 0.0
    scattering: Mapping[int, FloatArray] = field(default_factory=dict)
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

    @property
    def fastest(self) -> float:
        """The speed that hardly any sample exceeds, rad/s or m/s."""
        speeds = [np.abs(np.asarray(c.point.velocity)[c.rows]) for c in self.cases]
        return float(np.quantile(np.concatenate(speeds), _HARDLY_ANY))

    def quantities_of(self, kind: type[CatalogueEffect]) -> tuple[Quantity, ...]:
        """A speed that shapes an effect lies among those of this axis, whatever its size.

        A change of the inertia ends where nothing is left of it, or a fit would stay beyond.
        Seals keep their plain form: tests of an axis alone hold a few pressures, one each.
        """
        found = tuple(q.at_speeds(self.fastest) for q in super().quantities_of(kind))
        if kind.id == SealFriction.id:
            held = [dataclasses.replace(q, is_choice=True) if q.begins_plain else q for q in found]
            found = tuple(held)
        declared = self.rig.total_inertia()
        if kind.id != InertiaMismatch.id or declared is None:
            return found
        least = (LEAST_INERTIA - 1.0) * declared
        own = self.rig.units.inertia_unit
        return tuple(dataclasses.replace(q, least=least) if q.unit == own else q for q in found)

    @property
    def spacing(self) -> float:
        places = [np.asarray(c.point.position)[c.rows] for c in self.cases]
        return float(np.median(np.abs(np.concatenate([np.diff(place) for place in places]))))

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
        if not self.only_way:
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
        kinds = map(self._form_of, catalogue.values())
        return tuple(kind for kind in kinds if not kind.states and self._feels(kind))

    def _form_of(self, kind: type[CatalogueEffect]) -> type[CatalogueEffect]:
        """The effect without what is a number of the law, too.

        A spring that is slack elsewhere differs by a constant force: the offset's, or that of
        Coulomb friction where all motion is one way.
        """
        if kind.id != CableSpring.id:
            return kind
        return linear_form(SpringAtZero) if self.rig.is_linear else SpringAtZero

    def _feels(self, kind: type[CatalogueEffect]) -> bool:
        if not overrides(kind, *_PORTS):
            return False
        if self.rig.is_linear and kind.id in ROTARY_ONLY:
            return False
        if kind.id == TorqueSaturation.id and self.rig.motor is None:
            return False  # the log holds the force as it was, beyond any limit of it
        if kind.id == InertiaMismatch.id and self.rig.total_inertia() is None:
            return False  # nothing is declared, and the inertia is fitted
        if kind.id == LoadDependentFriction.id and self.rig.cylinder is not None:
            return False  # the motor carries the pressures: friction by either is the seals'
        # In its usual form, else in one of this axis' speeds: friction of slow motion alone acts on
        # none of a fast shaft's.
        usual = smallest_probe(kind, self.side())
        if (effect := self._acting([usual])) is None:
            forms = shapes(self.quantities_of(kind))
            effect = self._acting([smallest_probe(kind, self.side(), form) for form in forms])
        if effect is None:
            return False
        return self.has_speeds or not _depends_on_speed(effect, self.cases[0].point)

    def _acting(self, probes: Sequence[CatalogueEffect]) -> CatalogueEffect | None:
        """The first of these that changes the balance beyond rounding."""
        law, plain = self._unprobed
        least = _LEAST_CHANGE * np.max(np.abs(plain))
        laws = [Law(law.values, (probe,)) for probe in probes]
        changed = self.residuals_of(laws, range(len(self.cases)))
        for probe, own in zip(probes, changed, strict=True):
            if np.max(np.abs(np.concatenate(own) - plain)) > least:
                return probe
        return None

    @cached_property
    def _unprobed(self) -> tuple[Law, FloatArray]:
        """The law at its first guess without effects, and its residual on all tests, (n,)."""
        law = Law({p.name: p.value for p in self.parameters()})
        return law, np.concatenate(self.residuals(law, range(len(self.cases))))

    def side(self) -> str:
        return "both"

    def is_possible(self, law: Law) -> bool:
        """Not if the shaft would hardly feel most of the commands that moved the axis.

        As with a limit of the motor below friction, or with friction that takes what it gives: such
        an effect explains a log by taking away what it holds.
        """
        model, deaf, count = self._model(law), 0, 0
        for case in self.cases:
            parameters = model.at(case.point.time)
            point = dataclasses.replace(case.point, parameters=parameters)
            more = dataclasses.replace(point, motor=(1.0 + _MORE) * point.motor)
            answer = effort_that_arrives(more, model) - effort_that_arrives(point, model)
            own = np.abs(_MORE * point.motor)[case.rows]
            deaf += int(np.count_nonzero(np.abs(answer)[case.rows] < _ANSWERS * own))
            count += int(np.count_nonzero(own))
        return deaf <= _MOST_DEAF * count

    def residuals(self, law: Law, tests: Sequence[int]) -> list[FloatArray]:
        return self.residuals_of([law], tests)[0]

    def residuals_of(self, laws: Sequence[Law], tests: Sequence[int]) -> list[list[FloatArray]]:
        """All laws go through the balance at once."""
        models, cases = [self._model(law) for law in laws], [self.cases[i] for i in tests]
        # Stretches of one trial share its motion.
        motions = {id(case.point): case for case in cases}
        whole = dict(zip(motions, effort_gaps(list(motions.values()), models), strict=True))
        return [
            [
                self._less_scatter(i, case.without_turns(whole[id(case.point)][k, case.rows]))
                for i, case in zip(tests, cases, strict=True)
            ]
            for k in range(len(laws))
        ]

    def _less_scatter(self, test: int, left: FloatArray) -> FloatArray:
        """A test's residual (n,) with its own friction weighed as one error of the test."""
        along = self.scattering.get(test)
        return left if along is None else left - along * float(along @ left)

    def whitened(self, law: Law) -> Axis:
        """Friction differs by some per cent from test to test: within a test these errors are one,
        however many its samples (a random effect; Laird, Ware, Biometrics 38 (1982) 963-974).

        By C^-1/2 of C = noise^2 I + scatter^2 g g', g a test's friction by the law. Stretches of
        one recording share its friction: of these nothing is taken off.
        """
        scatter = self.relative_scatter(law)
        if len(self.recordings) < len(self.tests) or not scatter > 0.0:
            return self
        every = range(len(self.tests))
        own, left = self.of_each_test(law, every), self.residuals(law, every)
        lengths = [float(np.linalg.norm(part)) for part in own]
        units = [part / max(length, 1e-300) for part, length in zip(own, lengths, strict=True)]
        noise = rmse([part - u * float(u @ part) for u, part in zip(units, left, strict=True)])
        weights = [noise / max(math.hypot(noise, scatter * length), 1e-300) for length in lengths]
        along = {i: math.sqrt(1.0 - weights[i]) * units[i] for i in every}
        return dataclasses.replace(self, scattering=along)

    def measured(self, tests: Sequence[int]) -> list[FloatArray]:
        """What friction, and an inertia that is not declared, balance."""
        nothing = Law({p.name: 0.0 for p in self.parameters()})
        return self.residuals(nothing, tests)

    @cached_property
    def _bare(self) -> Parameters:
        return bare_parameters(self.rig)

    def _model(self, law: Law) -> Model:
        u = self.rig.units
        values = law.values
        inertia = values.get(u.key("inertia"), self.rig.total_inertia())
        parameters = self._bare.replace(
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
                self.rig.units.place: p.position,
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
        """Of the channels' noise in the balance after its filter, N or Nm."""
        model = self._model(law)
        # Stretches of one trial share its sensors.
        own = {id(case.point): effort_noise(case, model) for case in self.cases}
        squares = [len(case.rows) * own[id(case.point)] ** 2 for case in self.cases]
        return math.sqrt(sum(squares) / sum(len(case.rows) for case in self.cases))

    def of_each_test(self, law: Law, tests: Sequence[int]) -> list[FloatArray]:
        u = self.rig.units
        free = {u.key("coulomb"): 0.0, u.key("viscous"): 0.0}
        without = Law({k: free.get(k, v) for k, v in law.values.items()}, law.effects)
        pairs = zip(self.residuals(without, tests), self.residuals(law, tests), strict=True)
        return [more - left for more, left in pairs]

    def part(self, estimates: Mapping[str, Estimate], quality: FitQuality | None = None) -> Parts:
        judged = quality_field(quality, MOTION)
        return Parts(friction=Friction.model_validate({**estimates, **judged}))

    def renewed(
        self, bundle: Bundle, estimates: Mapping[str, Estimate], quality: FitQuality | None = None
    ) -> Bundle:
        """The law's Coulomb friction stays a sum where the fit could identify only that."""
        found, before = super().renewed(bundle, estimates, quality), bundle.friction
        if before is None or found.friction is None:
            return found
        return found.replaced(friction=found.friction.with_sum_of(before))

    def law_of(self, bundle: Bundle) -> Law:
        """Numbers that cannot be are held at what physics allows (`parameters.possible`)."""
        u, part = self.rig.units, bundle.friction
        names = [p.name for p in self.parameters()]
        offset = None if part is None else part.in_motion("offset")
        along = offset.value if offset is not None and offset.identified else 0.0
        assumed = {u.key("offset"): along} if u.key("offset") in names else {}
        if part is not None and (held := part.sum_in_motion) is not None:
            # In one direction or at one speed all friction is Coulomb friction of the law.
            assumed |= {u.key("coulomb"): held.estimate.value}
            if "viscous" in u.named(held.of) and u.key("viscous") in names:
                assumed |= {u.key("viscous"): 0.0}
        if part is not None and part.inertia is not None and not part.inertia.identified:
            # Its share of the effort is neglected, as in the fit.
            assumed |= {u.key("inertia"): 0.0} if u.key("inertia") in names else {}
        law = law_held("friction", part, names, _TESTS, **assumed)
        values = {p.name: max(law.values[p.name], p.lower) for p in self.parameters()}
        if self.only_way and u.key("offset") not in names:
            values[u.key("coulomb")] += self.only_way * along
        return Law(values)

    def further_errors_of(self, laws: Sequence[Law]) -> tuple[list[Further], tuple[str, ...]]:
        """Of the position, simulated open loop over each whole trial from its first row.

        Only where no pressure acts: a logged chamber's pressure is not the simulator's. A trial
        that a law cannot simulate counts for none; a law that can simulate none has no error.
        """
        if self.rig.cylinder is not None:
            return [{} for _ in laws], ()
        gaps = [
            [on_its_own(partial(self._gap, law, trial)) for trial in self.trials] for law in laws
        ]
        lost = [[isinstance(gap, Failure) for gap in own] for own in gaps]
        some = [not all(own) for own in lost]
        left_out = np.any([own for own, any_ in zip(lost, some, strict=True) if any_], axis=0)
        known = np.flatnonzero(~left_out) if any(some) else np.zeros(0, dtype=int)
        found: list[Further] = [
            self._further([cast(FloatArray, own[i]) for i in known], known) if any_ else {}
            for own, any_ in zip(gaps, some, strict=True)
        ]
        return found, tuple(self._not_simulated(gaps, some))

    def _gap(self, law: Law, trial: Trial) -> FloatArray:
        """Position (n,) of a trial, measured less simulated. Raises NotIdentifiedError for an
        inertia that cannot be, and where the simulation has no end or does not stay finite."""
        from sysid.plant.simulator import ENDLESS, Inputs, simulate

        model = self._model(law)
        require_moving_inertia(float(model.parameters.inertia), self.rig, "the law")
        # Motion does not determine breakaway: it is set to sliding friction.
        model = Model(
            model.parameters.replace(static_effort=model.parameters.coulomb_effort), model.effects
        )
        position = trial[self.rig.position_channel]
        inputs = Inputs(
            time=trial.time,
            motor=np.asarray(trial[self.rig.effort_channel]),
            position=float(position[0]),
        )
        gap = position - simulate([inputs], [model], nan_if_endless=True)[0].position
        if not np.isfinite(gap).all():
            raise SimulationError(ENDLESS)
        return np.asarray(gap)

    def _further(self, gaps: Sequence[FloatArray], known: IntArray) -> Further:
        """Error and noise of the position of the trials `known` by number, with these gaps."""
        name = self.rig.position_channel
        trials = [self.trials[i] for i in known]
        noise = [signals.noise_floor(t[name], stride=t.stride_of(name)).total for t in trials]
        if not trials:
            return {}
        return {name: (rmse(gaps), math.hypot(*noise) / math.sqrt(len(noise)))}

    def _not_simulated(
        self, gaps: Sequence[Sequence[FloatArray | Failure]], some: Sequence[bool]
    ) -> Iterator[str]:
        """Notices of laws that simulate no trial, and of trials that others do not."""
        for own, any_ in zip(gaps, some, strict=True):
            if not any_:
                reasons = dict.fromkeys(gap.reason for gap in own if isinstance(gap, Failure))
                yield from (f"{NOT_SIMULATED}: {why}" for why in reasons)
                continue
            for gap, trial in zip(own, self.trials, strict=True):
                if isinstance(gap, Failure):
                    yield (
                        f"{trial.title} is not simulated: {gap.reason}; errors of "
                        f"{self.rig.position_channel} are those of the other held-out tests"
                    )


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
    by_trial: list[list[ImposedMotion]] = []
    pieces = pieces_of(len(trials))
    for trial in trials:
        # The friction fit has already reported notices about its channels.
        by_trial.append(_cases(recorded(trial, rig, []), pieces))
    by_trial = [own for own in by_trial if own]
    cases = [case for own in by_trial for case in own]
    if not cases:
        raise NotIdentifiedError(
            "friction: the axis hardly moves in these tests; give motion that crosses the stroke "
            "in both directions"
        )
    speeds = [
        np.concatenate([np.asarray(c.point.velocity)[c.rows] for c in own]) for own in by_trial
    ]
    loads = [np.concatenate([c.recording.cylinder[c.rows] for c in own]) for own in by_trial]
    way = only_way(np.concatenate(speeds))
    if way:
        # The few samples against it are those of a start or an end, blurred by the filter.
        cases = [_along(case, way) for case in cases]
    return Axis(rig, tuple(cases), tuple(trials), tells_speeds(speeds, loads), way)


def _along(case: ImposedMotion, way: float) -> ImposedMotion:
    """A case without its rows against a direction."""
    speed = np.asarray(case.point.velocity)[case.rows]
    return dataclasses.replace(case, rows=case.rows[way * speed > 0.0])


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
