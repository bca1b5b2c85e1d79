"""From a campaign's tests to one bundle: every pipeline on its tests, the results assembled."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Protocol

from sysid.errors import InputError, NotIdentifiedError
from sysid.friction import fit_friction
from sysid.identification.friction.result import FrictionResult
from sysid.io.campaign import (
    BENCH_KINDS,
    FRICTION_KINDS,
    MOTION_KINDS,
    Campaign,
    CampaignLog,
)
from sysid.io.logs import Trial, any_contradiction
from sysid.io.rig import Rig
from sysid.io.source import Source
from sysid.parallel import Failure, attempt_all, error_of, on_its_own
from sysid.parameters import Bundle, Parts
from sysid.recording.friction_kind import MOTION, balances
from sysid.types import Progress, no_progress
from sysid.valve_discrete import fit_valve_discrete
from sysid.valve_pwm import fit_valve_pwm


class PartResult(Protocol):
    """The result of any pipeline."""

    @property
    def remarks(self) -> tuple[str, ...]: ...

    @property
    def notices(self) -> tuple[str, ...]: ...

    def part(self) -> Parts: ...


@dataclass
class _Assembly:
    """A campaign's bundle while its parts are collected."""

    campaign: Campaign
    progress: Progress
    parts: Parts = field(default_factory=Parts)
    remarks: list[str] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)
    contradictions: list[str] = field(default_factory=list)
    failures: list[Failure] = field(default_factory=list)
    motion_for_friction: bool = False

    def read(self, entries: Sequence[CampaignLog]) -> list[Trial]:
        """All trials of these entries."""
        trials: list[Trial] = []
        for entry in entries:
            log = self.campaign.read(entry)
            self.contradictions += log.contradictions
            self.notices += log.notices
            trials += log.trials
        return trials

    def add(self, name: str, fit: Callable[[], PartResult]) -> None:
        """Add a pipeline's part, or a notice where it cannot be had."""
        self.progress(name)
        result = on_its_own(fit)
        if isinstance(result, Failure):
            self.lack(result)
        else:
            self.merge(result)

    def lack(self, why: Failure) -> None:
        """Note why a part is not there."""
        self.notices.append(why.reason)
        self.failures.append(why)

    def merge(self, result: PartResult) -> None:
        """Add what a pipeline found."""
        self.remarks += result.remarks
        self.notices += result.notices
        self.parts = self.parts.merged(result.part())


@dataclass(frozen=True)
class CampaignFit:
    """A campaign's bundle, with the remarks and notices of its fits.

    `contradictions` are the first of the notices: what logs and rig file say differently.
    """

    bundle: Bundle
    remarks: tuple[str, ...]
    notices: tuple[str, ...]
    contradictions: tuple[str, ...] = ()


def fit_campaign(
    campaign: Campaign,
    *,
    surface: str = "both",
    seed: int = 0,
    progress: Progress = no_progress,
) -> CampaignFit:
    """Every part that a campaign's training logs can identify, in one bundle.

    A part whose tests the campaign lacks, or that cannot be had from them, is left out of the
    bundle with a notice that says why; the others are fitted. Raises InputError for a log that
    cannot be read and where no part can use its logs, NotIdentifiedError where nothing at all is
    identified. `progress` is called with the name of each part as its fit begins.
    """
    assembly = _Assembly(campaign, progress)
    sources = campaign.sources()
    assembly.notices += [*campaign.notices, *campaign.rig.notices, *campaign.copies(sources)]
    _add_friction(assembly)
    _add_valves(assembly, surface, seed)
    _add_bench(assembly)
    if not assembly.parts:
        raise _nothing(assembly)
    used = [s for s in sources if _is_used(s, assembly)]
    has_surfaces = any((s.kind, s.use) == ("valve-pwm", "fit") for s in used)
    bundle = Bundle.new(
        campaign.rig,
        assembly.parts,
        used,
        seeds={"valve-pwm": seed} if has_surfaces else {},
        options={"valve-pwm": {"surface": surface}} if has_surfaces else {},
    )
    wrong = tuple(dict.fromkeys(assembly.contradictions))
    rest = (line for line in assembly.notices if line not in wrong)
    return CampaignFit(bundle, tuple(assembly.remarks), (*wrong, *rest), wrong)


def _nothing(assembly: _Assembly) -> Exception:
    """The error of a campaign without any part: each part's reason, or that no log is for any;
    unusable input in its own words."""
    why = [*assembly.contradictions, *(failure.reason for failure in assembly.failures)]
    reasons = "; ".join(dict.fromkeys(why)) if assembly.failures else ""
    error = error_of(assembly.failures, reasons)
    if isinstance(error, InputError):
        return error
    start = f"{assembly.campaign.path}: no training log identifies anything"
    if reasons:
        return type(error)(f"{start}: {reasons}")
    return NotIdentifiedError(f'{start}; add friction or valve tests with use = "fit"')


def _is_used(source: Source, assembly: _Assembly) -> bool:
    """Whether a log belongs in the provenance: motion logs are for a diagnosis to fit on, unless
    friction needed them."""
    fits_nothing = source.kind in MOTION_KINDS and not assembly.motion_for_friction
    return source.use == "holdout" or not fits_nothing


def _add_friction(assembly: _Assembly) -> None:
    """Friction from its own tests; where they do not identify it, from the motion logs as well."""
    campaign, rig = assembly.campaign, assembly.campaign.rig
    tests = _labelled(assembly, campaign.select(FRICTION_KINDS))
    if tests:
        assembly.progress("friction")
    own, why = _friction_of(tests, rig)
    if own is not None:
        # What cannot be friction alone is for the diagnosis to name, not a reason to stop.
        assembly.notices += [
            f"friction tests: {line}: kept for `sysid diagnose`, not to be used as it is"
            for line in own.impossible
        ]
    if own is not None and own.has_sliding:
        assembly.merge(own)
        return
    moving = _labelled(assembly, campaign.select(MOTION_KINDS))
    motion = [(trial, MOTION) for trial, _ in moving if balances(trial, rig)]
    found, why_moving = None, None
    if motion:
        assembly.progress("friction, from motion")
        found, why_moving = _friction_of([*tests, *motion], rig)
    if found is not None and (found.has_sliding or own is None):
        assembly.motion_for_friction = True
        assembly.merge(found)
        reason = "" if why is None else why.reason
        assembly.notices.append(
            "friction is taken from the motion logs, since "
            + (f"the friction tests do not identify it: {reason}" if tests else "no test is for it")
        )
    elif own is not None:
        assembly.merge(own)
    else:
        for lacking in dict.fromkeys(filter(None, (why, why_moving))):
            assembly.lack(lacking)


def _labelled(assembly: _Assembly, entries: Sequence[CampaignLog]) -> list[tuple[Trial, str]]:
    """The trials of these entries, each with its entry's kind."""
    return [(trial, entry.kind) for entry in entries for trial in assembly.read([entry])]


def _friction_of(
    tests: list[tuple[Trial, str]], rig: Rig
) -> tuple[FrictionResult | None, Failure | None]:
    """The fit of these tests by kind, and why it lacks sliding friction."""
    if not tests:
        return None, None
    trials, kinds = [trial for trial, _ in tests], [kind for _, kind in tests]
    found = on_its_own(partial(fit_friction, trials, rig, kind=kinds))
    if isinstance(found, Failure):
        return None, found
    why = found.why_no_sliding
    return found, Failure(why, error=NotIdentifiedError(why))


@dataclass(frozen=True)
class _FittedPart:
    """What a bundle takes of a pipeline's result."""

    parts: Parts
    remarks: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()

    def part(self) -> Parts:
        return self.parts


def _add_bench(assembly: _Assembly) -> None:
    """The law of a tank or a valve that was tested alone."""
    for kind in BENCH_KINDS:
        entries = assembly.campaign.select([kind])
        if entries:
            trials = assembly.read(entries)
            assembly.add(kind, partial(bench_fit, kind, trials, assembly.campaign.rig))


def bench_fit(kind: str, trials: Sequence[Trial], rig: Rig) -> PartResult:
    """The law of a part on a bench from its tests of a kind, with how well it follows them.

    Raises InputError for a missing column, NotIdentifiedError where the tests identify no law.
    """
    from sysid.diagnosis.bench.fitting import fit_law
    from sysid.diagnosis.bench.registry import component_of

    component = component_of(kind, trials, rig)
    fitted = fit_law(component, (), range(len(component.tests)))
    judged = replace(fitted.quality(), contradicted=any_contradiction(trials))
    # A missing effect may cause it, which the diagnosis then names from this number.
    asks = "sysid diagnose names what the law lacks, if the data are right"
    short = [f"{kind}: {judged.shortfall}; {asks}"] if judged.explains_too_little else []
    part = component.part(fitted.base_estimates(), judged)
    return _FittedPart(part, notices=(*component.left_out, *short))


@dataclass(frozen=True)
class _ValveJob:
    """One valve pipeline on the trials of the entries for the same valve."""

    kind: str
    valve: str | None
    trials: list[Trial]
    rig: Rig
    surface: str
    seed: int

    @property
    def name(self) -> str:
        return self.kind if self.valve is None else f"{self.kind}, valve {self.valve.upper()}"

    def fit(self) -> _FittedPart | Failure:
        """What a bundle takes of the fit, or why there is none."""
        return on_its_own(self._fit)

    def _fit(self) -> _FittedPart:
        result: PartResult
        if self.kind == "valve-discrete":
            result = fit_valve_discrete(self.trials, self.rig, valve=self.valve)
        else:
            result = fit_valve_pwm(
                self.trials, self.rig, valve=self.valve, surface=self.surface, seed=self.seed
            )
        return _FittedPart(result.part(), tuple(result.remarks), tuple(result.notices))


def _add_valves(assembly: _Assembly, surface: str, seed: int) -> None:
    """Both kinds of valve test, one job per valve; the jobs share the cores."""
    jobs = []
    for kind in ("valve-pwm", "valve-discrete"):
        entries = assembly.campaign.select([kind])
        # For entries that name no valve, the valve that moves decides.
        for valve in dict.fromkeys(e.valve for e in entries):
            trials = assembly.read([e for e in entries if e.valve == valve])
            jobs.append(_ValveJob(kind, valve, trials, assembly.campaign.rig, surface, seed))
    if not jobs:
        return
    assembly.progress("; ".join(job.name for job in jobs))
    # The on/off laws come first in a bundle.
    for found in reversed(attempt_all(job.fit for job in jobs)):
        if isinstance(found, Failure):
            assembly.lack(found)
        else:
            assembly.merge(found)
