"""Tests in, parameters with intervals out: one part of the model, alone or from its log files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from sysid.errors import Notice, NotIdentifiedError, about, subject_of
from sysid.io.campaign import FRICTION_POINTS
from sysid.io.logs import Trial, any_contradiction
from sysid.io.rig import Rig
from sysid.parameters import Parts
from sysid.parameters.data_sheet import with_data_sheets
from sysid.parameters.valves import SERIES, SURFACE_KINDS, OpenLaw
from sysid.pipeline.given_tests import Tests, rig_of, trials_of
from sysid.pipeline.request import Options, takes

if TYPE_CHECKING:
    from sysid.diagnosis.bench.law_choice import ChosenLaw
    from sysid.identification.friction.result import FrictionResult
    from sysid.identification.valve_discrete.result import ValveDiscreteResult
    from sysid.identification.valve_pwm.result import ValvePwmFit


class PartResult(Protocol):
    """The result of any pipeline."""

    @property
    def remarks(self) -> tuple[str, ...]: ...

    @property
    def notices(self) -> tuple[str, ...]: ...

    def part(self) -> Parts: ...


@dataclass(frozen=True)
class FittedPart:
    """What a bundle holds of a pipeline's result."""

    parts: Parts
    remarks: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()

    def part(self) -> Parts:
        return self.parts


@dataclass(frozen=True)
class FrictionOptions(Options):
    """How friction tests are read; `rig` None: that of the logs."""

    rig: Rig | None = None
    _: KW_ONLY
    kind: str | Sequence[str | None] | None = None
    estimate_inertia: bool = False
    cutoff_hz: float | None = None
    load: str | None = None

    part: ClassVar[str] = "friction"

    def fitted(self, trials: list[Trial], rig: Rig) -> PartResult:
        """The fit of one part's logs; rows without a time are readings."""
        if self.kind == "points" or (self.kind is None and are_readings(trials)):
            return bench_fit(FRICTION_POINTS, trials, rig)
        return fit_friction(trials, replace(self, rig=rig))

    def recorded(self) -> dict[str, Any]:
        """The options that a bundle's provenance holds."""
        load = {} if self.load is None else {"load": self.load}
        return {"cutoff_hz": self.cutoff_hz, "kind": self.kind, **load}


@takes(FrictionOptions)
def fit_friction(tests: Tests, options: FrictionOptions) -> FrictionResult:
    """Static, Coulomb and viscous friction from a log, several, or single tests.

    The result gives each estimate by its name in a bundle, `coulomb_nm` (a linear rig:
    `coulomb_n`), with `value`, `std`, `interval` (95 %) and `unit`. `rig` None: that of the logs.
    `kind` ("static", "sliding", "motion"; one, or one per test) overrides a test's content;
    `estimate_inertia` even if the rig file gives one; `cutoff_hz` of the zero-phase filter; `load`:
    with a part that grows with the effort of the "motor", or with all that is "transmitted".
    Raises InputError where a channel is missing, NotIdentifiedError where nothing is identified or
    what is found cannot be friction.

    >>> friction = si.fit_friction(log)
    >>> low, high = friction.coulomb_nm.interval
    >>> low < friction.coulomb_nm.value < high, friction.coulomb_nm.unit
    (True, 'Nm')
    """
    from sysid import friction

    found = friction.fit_friction(
        trials_of(tests),
        rig_of(tests, options.rig),
        kind=options.kind,
        estimate_inertia=options.estimate_inertia,
        cutoff_hz=options.cutoff_hz,
        load=options.load,
    )
    found.require_possible()
    return found


def are_readings(trials: Sequence[Trial]) -> bool:
    """Whether all rows are readings taken by hand, without a time."""
    return bool(trials) and all(trial.is_readings for trial in trials)


def bench_fit(kind: str, trials: Sequence[Trial], rig: Rig, law: str = "auto") -> PartResult:
    """The law of a part on a bench from its tests of a kind, with how well it follows them.

    `law` of a part that has several: by default the one that its tests are evidence for. Raises
    InputError for a missing column, NotIdentifiedError where the tests identify no law.
    """
    from sysid.diagnosis.bench.law_choice import chosen_law
    from sysid.diagnosis.bench.registry import component_of

    component = component_of(kind, trials, rig)
    # A flow control is in series with a valve; the flow of a part alone is one orifice's.
    choice = chosen_law(component, "auto" if law == SERIES else law)
    fitted = choice.fitted
    judged = replace(fitted.quality(), contradicted=any_contradiction(trials))
    if judged.explains_too_little and component.refuses_misfit:
        raise NotIdentifiedError(
            f"{kind}: nothing is identified: {judged.shortfall}, more than it explains; check "
            "units, the rig file and which rows are of the test"
        )
    # A missing effect may cause it, which the diagnosis then names from this number.
    asks = "sysid diagnose names what the law lacks, if the data are right"
    short = [f"{kind}: {judged.shortfall}; {asks}"] if judged.explains_too_little else []
    estimates = choice.estimates
    part = _with_laws(fitted.component.part(estimates, judged), choice)
    said = [f"{kind}: {choice.why}"] if choice.why else []
    more = fitted.component.said_of(estimates)
    said += [Notice(f"{kind}: {line}", subject_of(line)) for line in more]
    return FittedPart(part, notices=tuple(about(kind, (*component.left_out, *said, *short))))


def _with_laws(part: Parts, choice: ChosenLaw) -> Parts:
    """A part with what each law says of its numbers that its tests do not rule out."""
    if not choice.why or part.valves is None:
        return part
    found = []
    for fit in (choice.fitted, *choice.others):
        valves = fit.component.part(fit.base_estimates()).valves
        law = None if valves is None else valves.side("a").discrete
        if law is not None:
            numbers = {key: e for key, e in law.estimates().items() if e.has_error}
            found.append(OpenLaw(law=fit.component.law_name, numbers=numbers))
    valve = part.valves.side("a")
    if valve.discrete is None:
        return part
    held = valve.replaced(discrete=valve.discrete.replaced(by_law=found))
    return replace(part, valves=part.valves.replaced(a=held))


@dataclass(frozen=True)
class ValveDiscreteOptions(Options):
    """How tests of on/off valves are read; `rig` None: that of the logs."""

    rig: Rig | None = None
    _: KW_ONLY
    valve: str | None = None
    find_ratio: bool = True
    law: str = "auto"

    part: ClassVar[str] = "valve-discrete"

    def fitted(self, trials: list[Trial], rig: Rig) -> PartResult:
        """The fit of one part's logs, with a data sheet's numbers where these identify none."""
        found = fit_valve_discrete(trials, replace(self, rig=rig))
        parts = found.part()
        valves, notices = with_data_sheets(parts.valves, rig)
        if not notices:
            return found
        completed = replace(parts, valves=valves)
        return FittedPart(completed, found.remarks, (*found.notices, *notices))

    def recorded(self) -> dict[str, Any]:
        """The options that a bundle's provenance holds."""
        return {"valve": self.valve} | _law_recorded(self.law)


def _law_recorded(law: str) -> dict[str, Any]:
    """The law that was asked for; nothing where the tests chose."""
    return {} if law == "auto" else {"law": law}


@takes(ValveDiscreteOptions)
def fit_valve_discrete(tests: Tests, options: ValveDiscreteOptions) -> ValveDiscreteResult:
    """Flows (kg/s), coefficients and delays (s) of on/off valves, piston held.

    `rig` None: that of the logs. `valve` ("a" or "b") keeps one; `find_ratio` estimates the
    critical pressure ratio too, the slowest step. `law`: the thesis' ("thesis"), ISO 6358's
    ("iso6358"), or that of a flow control in series ("thesis-series"); by default ("auto") the
    tests choose by evidence. Raises InputError where a channel is missing, NotIdentifiedError where
    nothing is identified.

    >>> valves = si.fit_valve_discrete(si.read_log("valve_discrete_a.parquet"), find_ratio=False)
    >>> valves["a"].choked_flow_fill_kg_s.unit
    'kg/s'
    """
    from sysid import valve_discrete

    return valve_discrete.fit_valve_discrete(
        trials_of(tests),
        rig_of(tests, options.rig),
        valve=options.valve,
        find_ratio=options.find_ratio,
        law=options.law,
    )


@dataclass(frozen=True)
class ValvePwmOptions(Options):
    """How tests under PWM are read and fitted; `rig` None: that of the logs."""

    rig: Rig | None = None
    _: KW_ONLY
    valve: str | None = None
    surface: str = "both"
    seed: int = 0
    sweep: bool = False
    law: str = "auto"

    part: ClassVar[str] = "valve-pwm"
    surfaces: ClassVar[tuple[str, ...]] = (*SURFACE_KINDS, "both")
    """What `surface` can be."""

    def fitted(self, trials: list[Trial], rig: Rig) -> PartResult:
        """The fit of one part's logs."""
        return fit_valve_pwm(trials, replace(self, rig=rig))

    def recorded(self) -> dict[str, Any]:
        """The options that a bundle's provenance holds."""
        return {"valve": self.valve, "surface": self.surface} | _law_recorded(self.law)


@takes(ValvePwmOptions)
def fit_valve_pwm(tests: Tests, options: ValvePwmOptions) -> ValvePwmFit:
    """Mean flow (kg/s) under PWM over duty (0 to 1) and pressure (Pa), piston held.

    `rig` None: that of the logs. `valve` ("a" or "b") keeps one; `surface`: "bipolynomial", "ann"
    or "both" (compared on held-out tests); `seed` of folds and restarts; `sweep` tries networks
    of several sizes (slow); `law` of the averaged law, as in `fit_valve_discrete`. Raises
    InputError where a channel is missing, NotIdentifiedError where no surface is identified.

    >>> pwm = si.fit_valve_pwm(si.read_log("valve_pwm_a.parquet"), surface="bipolynomial")
    >>> flow, flags = pwm.fits["a", "fill"].bipolynomial.flow(0.5, 2e5)
    >>> bool(flow > 0)
    True
    """
    from sysid import valve_pwm

    return valve_pwm.fit_valve_pwm(
        trials_of(tests),
        rig_of(tests, options.rig),
        valve=options.valve,
        surface=options.surface,
        seed=options.seed,
        sweep=options.sweep,
        law=options.law,
    )


PartOptions = FrictionOptions | ValveDiscreteOptions | ValvePwmOptions

__all__ = [
    "FittedPart",
    "FrictionOptions",
    "PartOptions",
    "PartResult",
    "ValveDiscreteOptions",
    "ValvePwmOptions",
    "are_readings",
    "bench_fit",
    "fit_friction",
    "fit_valve_discrete",
    "fit_valve_pwm",
]
