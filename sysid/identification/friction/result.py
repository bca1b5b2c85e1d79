"""The result of a friction fit: parameters by name, and the evidence for them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.balance.motion import RULE
from sysid.blocks.drawing import plot
from sysid.blocks.quality import quality_table
from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table, estimate_records, estimate_table
from sysid.errors import NotIdentifiedError
from sysid.estimation.combinations import Combination
from sysid.estimation.linear import Estimate, FTest
from sysid.estimation.named import NamedEstimates
from sysid.estimation.quality import (
    CONTRADICTED,
    LEAST_EXPLAINED,
    ExcludedData,
    FitQuality,
    root_mean_square,
)
from sysid.identification.friction.effort import TrialUse, excluded_tests, exclusion_lines
from sysid.identification.friction.load import LoadFriction
from sysid.identification.friction.low_speed import RULE as LOW_SPEED_RULE
from sysid.identification.friction.motion import MotionFriction
from sysid.identification.friction.shown import parameters_figure, speed_figure
from sysid.identification.friction.sliding import SlidingFriction, missed_by
from sysid.identification.friction.static import StaticFriction, breakaway_of
from sysid.io.motion import MotionUnits
from sysid.io.rig import Rig
from sysid.parameters import Correlation, Friction, Parts
from sysid.parameters.possible import (
    another_time,
    doubtful_inertia,
    negative_friction,
    weighs_too_much,
)
from sysid.parameters.quality import records_of
from sysid.recording.friction_kind import KINDS, MOTION, SLIDING, STATIC
from sysid.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# From there on the numbers describe something else than friction.
_MOST_SCATTER = 0.5
_MOST_INERTIAL = 0.3
# Breakaway is at most a few times sliding friction (Stribeck: about twice).
_MOST_STATIC = 10.0
# Breakaway that repeats to this share of the motor's limit, at that limit, is the limit.
_AT_LIMIT = 0.01


@dataclass(frozen=True, repr=False)
class FrictionResult(NamedEstimates, Shown):
    """Friction parameters by their names in the bundle, and the evidence for them.

    `parameters` holds `static`, `coulomb`, `viscous`, `offset` and, where estimated, `inertia`; as
    items and attributes they have their keys in a bundle (`coulomb_nm`, linear: `coulomb_n`). One
    that the tests do not identify gives the reason. Coulomb and viscous friction come from `source`
    (the constant-effort tests where these identify them); `cross_check` holds the estimates of the
    other kind of test, `combinations` the sums that are identified where their parts are not.
    `trials` gives the outcome of every test. `most_effort` is what the rig's motor and cylinder can
    give, `motor_limit` the motor alone, N or Nm. `contradicted`: whether a log contradicts the rig
    file. `load`: friction that grows with an effort, where asked for and shown. `reversed_sign`:
    which channel's sign is reversed, where the fit with the other sign is good; else empty.
    `wrong_time`: that time_s is not in s, as the fitted inertia is too heavy for what carries it,
    or so many times the rig file's; else empty.
    """

    units: MotionUnits
    parameters: dict[str, Estimate]
    source: str
    static: StaticFriction | None
    sliding: SlidingFriction | None
    motion: MotionFriction | None
    cross_check: dict[str, Estimate]
    trials: tuple[TrialUse, ...]
    notices: tuple[str, ...]
    cutoff_hz: float
    combinations: tuple[Combination, ...] = ()
    most_effort: float = math.inf
    motor_limit: float = math.inf
    contradicted: bool = False
    reversed_sign: str = ""
    wrong_time: str = ""
    load: LoadFriction | None = None

    @property
    def rmse(self) -> dict[str, float]:
        """RMSE of each fit, in units of effort; of static friction, its repeatability."""
        ramped = None if self.static is None or self.static.quality is None else self.static
        found = {
            STATIC: None if ramped is None else ramped.repeatability,
            SLIDING: None if self.sliding is None else self.sliding.rmse,
            MOTION: None if self.motion is None else self.motion.rmse,
        }
        return {k: v for k, v in found.items() if v is not None and math.isfinite(v)}

    @property
    def remarks(self) -> tuple[str, ...]:
        """The remarks of a summary in addition to the numbers, one line each."""
        lines = []
        for kind in KINDS:
            uses = [use for use in self.trials if use.kind == kind]
            if uses:
                used = sum(use.used for use in uses)
                count = f"{kind}: {used} of {len(uses)} tests used"
                lines.append("; ".join([count, *exclusion_lines(uses)]))
        if self.static is not None:
            lines += [*self.static.remarks, f"breakaway: {self.static.criterion}"]
        if self.sliding is not None:
            lines.append(
                f"sliding friction scatters by {100.0 * self.sliding.scatter:.2g} % from trial "
                "to trial"
            )
        if self.motion is not None:
            lines.append(f"friction from motion: {RULE}; {LOW_SPEED_RULE}")
        for name, estimate in self.cross_check.items():
            if estimate.identified:
                lines.append(
                    f"cross-check, from motion: {self.units.key(name)} {estimate.value:.4g} +- "
                    f"{estimate.std:.2g} {estimate.unit}"
                )
        for k, v in self._rmse():
            share = f", R2 {self.explained[k]:.4g}" if k in self.explained else ""
            lines.append(f"RMSE of the fit of {k}: {v:.3g} {self.units.effort}{share}")
        return tuple(lines)

    @property
    def quality(self) -> dict[str, FitQuality]:
        """How well each kind of test is described, and which of its numbers are impossible."""
        fits = {STATIC: self.static, SLIDING: self.sliding, MOTION: self.motion}
        judged = {k: f.quality for k, f in fits.items() if f is not None}
        wrong = self._impossible()
        return {
            k: replace(
                quality,
                impossible=tuple(wrong.get(k, ())),
                left_out=(*quality.left_out, *self._excluded(k)),
                contradicted=self.contradicted,
            )
            for k, quality in judged.items()
            if quality is not None
        }

    def _excluded(self, kind: str) -> Iterator[ExcludedData]:
        """The tests of a kind that its fit excluded, as far as its law predicts them."""
        uses = [use for use in self.trials if use.kind == kind]
        if not all(use.used for use in uses):
            yield excluded_tests(uses, self._missed(kind, uses))
        if kind == MOTION == self.source:
            yield from self._set_aside()

    def _set_aside(self) -> Iterator[ExcludedData]:
        """The constant-effort tests that the law from motion covers."""
        uses = [use for use in self.trials if use.kind == SLIDING]
        if not uses or any(use.used for use in uses) or self.motion is None:
            return
        measured, left = missed_by(self.motion, uses)
        out = ExcludedData(f"{SLIDING} tests", len(uses), len(uses), len(uses) - len(measured))
        if len(measured):
            out = replace(out, rmse=root_mean_square(left), spread=root_mean_square(measured))
        yield out

    def _missed(self, kind: str, uses: Sequence[TrialUse]) -> tuple[FloatArray, FloatArray]:
        """Measured effort, and its residual under the law, of the tests that it covers;
        (n,) each."""
        if kind == STATIC and self.static is not None:
            measured = np.array([breakaway_of(u) for u in uses if "breakaway" in u.values])
            return measured, measured - self.static.estimate.value
        if kind == SLIDING and self.sliding is not None:
            return missed_by(self.sliding, uses)
        return np.zeros(0), np.zeros(0)

    @property
    def impossible(self) -> tuple[str, ...]:
        """Impossible estimates, one line each: the tests then show something else."""
        lines = [line for lines in self._impossible().values() for line in lines]
        return tuple([self.reversed_sign, *lines] if lines and self.reversed_sign else lines)

    def _impossible(self) -> dict[str, list[str]]:
        """The same by the kind of test that shows it."""
        u = self.units
        found: dict[str, list[str]] = {kind: [] for kind in KINDS}
        for name, kind in (("static", STATIC), ("coulomb", self.source), ("viscous", self.source)):
            e, key = self.parameters[name], u.key(name)
            if e.identified and e.interval[1] < 0.0:
                found[kind].append(f"{key} is {e.value:.3g} {e.unit}, significantly negative")
            if e.identified and name != "viscous" and e.value > self.most_effort:
                found[kind].append(
                    f"{key} is {e.value:.3g} {e.unit}, but motor and cylinder together give at "
                    f"most {self.most_effort:.3g} {u.effort}"
                )
        found[MOTION] += [self.wrong_time] if self.wrong_time else []
        found[STATIC] += self._start_up()
        found[SLIDING] += self._unsteady()
        for kind, part in ((STATIC, self.static), (SLIDING, self.sliding)):
            judged = None if part is None else part.quality
            if judged is not None and judged.explains_too_little:
                found[kind].append(judged.shortfall)
        found[self.source] += [
            f"{c.expression} is {c.estimate.value:.3g} {c.estimate.unit}, significantly negative"
            for c in self.combinations
            if "offset" not in c.terms and c.estimate.interval[1] < 0.0
        ]
        # With motion in one direction the effort need not vary.
        told = self.motion is not None and self.motion.both_ways
        if self.motion is not None and told and self.motion.explained < LEAST_EXPLAINED:
            share = max(100.0 * self.motion.explained, 0.0)
            found[MOTION].append(
                f"the law explains {share:.0f} % of the effort in motion "
                f"(RMSE {self.motion.rmse:.3g} {u.effort})"
            )
        return found

    def _start_up(self) -> list[str]:
        """Breakaway at the motor's limit, or out of all proportion to sliding friction."""
        u = self.units
        static, coulomb = self.parameters["static"], self.parameters["coulomb"]
        key = u.key("static")
        if self.static is not None and static.identified:
            scatter = self.static.repeatability
            off = abs(static.value - self.motor_limit)
            if max(off, scatter) < _AT_LIMIT * self.motor_limit < math.inf:
                return [
                    f"{key} is the motor's declared limit, {self.motor_limit:.3g} {u.effort}, "
                    f"in every test ({static.value / max(scatter, 1e-12):.0f} times its scatter): "
                    "the logged effort goes beyond that limit"
                ]
        known = static.identified and coulomb.identified and 0.0 < coulomb.interval[1] < math.inf
        if not known or static.value <= _MOST_STATIC * coulomb.interval[1]:
            return []
        most = coulomb.interval[1]
        return [
            f"{key} is {static.value:.3g} {u.effort}, {static.value / most:.0f} times what "
            f"{u.key('coulomb')} is at most, {most:.3g} {u.effort}"
        ]

    def _unsteady(self) -> list[str]:
        """Impossible constant-effort trials: scatter, or inertia, as large as friction."""
        found = []
        if self.sliding is not None and self.sliding.scatter > _MOST_SCATTER:
            found.append(
                "friction scatters by "
                f"{100.0 * self.sliding.scatter:.0f} % from constant-effort trial to trial"
            )
        share = self._inertial_share()
        if share > _MOST_INERTIAL:
            found.append(
                f"the change of momentum is {100.0 * share:.0f} % of the friction in trials of "
                "steady speed: the rig file's inertia is too large"
            )
        return found

    def _inertial_share(self) -> float:
        """Median share of the inertia in the balance of the steady trials, 0 without any."""
        steady = [u.values for u in self.trials if u.used and u.values.get("steady")]
        return float(np.median([abs(v["inertial"] / v["friction"]) for v in steady] or [0.0]))

    @property
    def is_negative(self) -> bool:
        """Whether Coulomb friction, or the sum that holds it, is significantly negative."""
        return any(e.interval[1] < 0.0 for e in self._of_coulomb())

    def _of_coulomb(self) -> list[Estimate]:
        """Coulomb friction, or the sums that hold it, as far as they are identified."""
        own = self.parameters["coulomb"]
        sums = [c.estimate for c in self.combinations if "coulomb" in c.terms]
        return [e for e in (own, *sums) if e.identified]

    @property
    def is_beyond_doubt(self) -> bool:
        """Whether all that was fitted is good or usable, and friction is significantly
        positive: a log with another fault does not show this by chance."""
        static, viscous = self.parameters["static"], self.parameters["viscous"]
        # At one speed each way, what resists is one sum: the effort turns with the motion.
        turns = self.source == MOTION and self.motion is not None and self.motion.both_ways
        told = self._of_coulomb() if viscous.identified or turns else []
        if self.source == STATIC:
            told = [static] if static.identified else []
        doubted = any(q.verdict.startswith(("poor", "imp")) for q in self.quality.values())
        return bool(told) and min(e.interval[0] for e in told) > 0.0 and not doubted

    def another_time(self, rig: Rig) -> str:
        """That time_s is in another unit, as the inertia that explains the motion would then be the
        rig file's; or empty."""
        motion = self.motion
        if motion is None or motion.inertia is None or motion.explained < LEAST_EXPLAINED:
            return ""
        return another_time(motion.inertia, rig)

    def require_possible(self) -> None:
        """Raise NotIdentifiedError where an estimate cannot be friction (`impossible`)."""
        if self.impossible and self.reversed_sign:
            raise NotIdentifiedError(f"friction: {self.reversed_sign}")
        if self.impossible and self.wrong_time:
            raise NotIdentifiedError(f"friction: {self.wrong_time}")
        if self.impossible:
            raise NotIdentifiedError(f"friction: {'; '.join(self.impossible)}: {self._causes()}")

    def _causes(self) -> str:
        """Causes of impossible friction, by what the log shows; the likeliest first."""
        if self.contradicted:
            return f"{CONTRADICTED}, as the first notice says: correct that first"
        lacks = "list the logs in a campaign, and `sysid diagnose` names what the law lacks"
        viscous = self.parameters["viscous"]
        falls = viscous.identified and viscous.interval[1] < 0.0
        # An effort that drives nothing leaves no Coulomb friction either.
        slides = any(e.interval[0] > 0.0 for e in self._of_coulomb())
        if falls and slides and len(self.impossible) == 1:
            return (
                "friction that falls with speed or changes along the stroke can be the "
                f"cause, or an effort other than the one that drives the motion; {lacks}"
            )
        return (
            "check for a wrong unit or time base, swapped or wrong pressures, an unlogged effort, "
            "or a load missing from the rig file; friction that changes along the stroke "
            f"can also be the cause: {lacks}"
        )

    @property
    def why_no_sliding(self) -> str:
        """Why Coulomb or viscous friction is not identified; empty where both are."""
        own = (self.parameters[name] for name in ("coulomb", "viscous"))
        return next((e.reason or "" for e in own if not e.identified), "")

    @property
    def misses(self) -> float:
        """RMSE of the fit that gave Coulomb friction, else of the breakaway, N or Nm."""
        return self.rmse.get(self.source, self.rmse.get(STATIC, 0.0))

    def of_sliding(self) -> dict[str, Estimate]:
        """Coulomb and viscous friction by name, as far as they are identified."""
        own = ("coulomb", "viscous")
        return {name: self.parameters[name] for name in own if self.parameters[name].identified}

    @property
    def has_sliding(self) -> bool:
        """Whether Coulomb and viscous friction are both identified."""
        return not self.why_no_sliding

    def _rmse(self) -> list[tuple[str, float]]:
        return [(k, v) for k, v in self.rmse.items() if k != STATIC]

    @property
    def explained(self) -> dict[str, float]:
        """R2 by kind: share of the variance of the effort in motion that the law explains."""
        return {} if self.motion is None else {MOTION: self.motion.explained}

    @property
    def correlation(self) -> Correlation | None:
        """Correlation of the errors of what `source` gave; None for fewer than two."""
        fit = {SLIDING: self.sliding, MOTION: self.motion}.get(self.source)
        if fit is None or fit.joint is None:
            return None
        known = [name for name, e in self.parameters.items() if e.identified]
        return Correlation.of(fit.joint, known, self.units.keys)

    def part(self) -> Parts:
        """The bundle's `friction` (`docs/reference/bundle.md`), with the supporting tables."""
        table: dict[str, Any] = self.by_name()
        table["source"] = self.source
        table[f"rmse_{self.units.suffix}"] = self.rmse
        table["cross_check"] = self.units.keyed(self.cross_check)
        if self.combinations:
            table["combinations"] = [c.to_json() for c in self.combinations]
        if (correlation := self.correlation) is not None:
            table["correlation"] = correlation
        table["quality"] = records_of(self.quality)
        table["trials"] = [use.to_json() for use in self.trials]
        if self.static is not None:
            table["static_by_position"] = [p.to_json() for p in self.static.by_position]
            table["static_tests"] = {k: _test(t) for k, t in self.static.tests.items()}
            table["static_criterion"] = self.static.criterion
        if self.sliding is not None:
            table["clusters"] = [c.to_json() for c in self.sliding.clusters]
            table["offset_p_value"] = self.sliding.offset_p_value
            curved = self.sliding.lack_of_fit
            table["sliding_lack_of_fit"] = None if curved is None else _test(curved)
        if self.motion is not None:
            table["explained"] = self.explained
            table["motion_rule"] = f"{RULE}; {LOW_SPEED_RULE}"
            if self.motion.limits is not None:
                table["motion_limits"] = asdict(self.motion.limits)
            table["cutoff_hz"] = self.cutoff_hz
        effects = () if self.load is None else (self.load.entry(),)
        return Parts(friction=Friction(**table), effects=effects)

    def __getitem__(self, name: str) -> Estimate:
        """A parameter by its name (`coulomb`) or by its key in a bundle (`coulomb_nm`)."""
        return self.parameters[name] if name in self.parameters else super().__getitem__(name)

    def by_name(self) -> dict[str, Estimate]:
        """The parameters by their keys in a bundle."""
        return self.units.keyed(self.parameters)

    def headline(self) -> str:
        """The number of tests."""
        used = sum(use.used for use in self.trials)
        return f"friction from {used} of {len(self.trials)} tests"

    def records(self) -> list[dict[str, Any]]:
        """One record per parameter: value, std, limits of the 95 % interval, unit."""
        return estimate_records(self.by_name())

    def tables(self) -> Iterable[Table]:
        """The parameters, and their estimates from motion where both kinds of test were made."""
        yield estimate_table("", self.by_name())
        sums = {c.expression: c.estimate for c in self.combinations}
        yield estimate_table("Identified only together", sums)
        if self.load is not None:
            entry = self.load.entry()
            yield estimate_table(entry.id, entry.numbers())
        yield estimate_table("Cross-check, from motion", self.units.keyed(self.cross_check))
        yield quality_table(self.quality)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Friction over speed: one point per constant-effort test, one fitted line per direction.

        Without such tests the parameters with their 95 % intervals, side by side.
        """
        fitted = self.part().friction
        figure = None if fitted is None else speed_figure(fitted)
        return plot(figure or parameters_figure(self.by_name()), ax)[0]


def too_heavy(parameters: Mapping[str, Estimate], rig: Rig) -> str:
    """That the fitted mass is too heavy for what carries it, by the parameters' names; or empty."""
    return weighs_too_much(parameters, rig)


def doubtful(parameters: Mapping[str, Estimate], rig: Rig) -> list[str]:
    """Notices of impossible numbers and those indistinguishable from zero; significantly negative
    friction is in the verdict on the fit."""
    near = {rig.units.key(name): e for name, e in parameters.items() if not e.interval[1] < 0.0}
    return [*negative_friction(near, rig), *doubtful_inertia(parameters.get("inertia"), rig)]


def _test(test: FTest) -> dict[str, float]:
    return {
        "f": test.statistic,
        "dof_numerator": test.dof_numerator,
        "dof_denominator": test.dof_denominator,
        "p_value": test.p_value,
    }


__all__ = ["FrictionResult", "doubtful", "too_heavy"]
