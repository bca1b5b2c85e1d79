"""From a campaign's tests to one bundle: every pipeline on its tests, the results assembled."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

from sysid.bundle import Bundle, Parts
from sysid.errors import NotIdentifiedError
from sysid.friction import fit_friction
from sysid.io.campaign import (
    BENCH_KINDS,
    FRICTION_KINDS,
    MOTION_KINDS,
    Campaign,
    CampaignLog,
)
from sysid.io.logs import Trial
from sysid.io.rig import Rig
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

    def read(self, entries: Sequence[CampaignLog]) -> list[Trial]:
        """All trials of these entries."""
        trials: list[Trial] = []
        for entry in entries:
            log = self.campaign.read(entry)
            self.notices += log.notices
            trials += log.trials
        return trials

    def add(self, name: str, fit: Callable[[], PartResult]) -> None:
        """Add a pipeline's part, or a notice where the tests do not identify it."""
        self.progress(name)
        try:
            result = fit()
        except NotIdentifiedError as error:
            self.notices.append(str(error))
            return
        self.remarks += result.remarks
        self.notices += result.notices
        self.parts = self.parts.merged(result.part())


@dataclass(frozen=True)
class CampaignFit:
    """A campaign's bundle, with the remarks and notices of its fits."""

    bundle: Bundle
    remarks: tuple[str, ...]
    notices: tuple[str, ...]


def fit_campaign(
    campaign: Campaign,
    *,
    surface: str = "both",
    seed: int = 0,
    progress: Progress = no_progress,
) -> CampaignFit:
    """Every part that a campaign's training logs can identify, in one bundle.

    A part whose tests the campaign lacks, or that they cannot identify, is left out of the
    bundle with a notice. Raises NotIdentifiedError where nothing at all can be fitted.
    `progress` is called with the name of each part as its fit begins.
    """
    assembly = _Assembly(campaign, progress)
    assembly.notices += [*campaign.notices, *campaign.rig.notices]
    _add_friction(assembly)
    _add_valves(assembly, surface, seed)
    _add_bench(assembly)
    if not assembly.parts:
        raise NotIdentifiedError(
            f"{campaign.path}: no training log identifies anything; add friction or valve tests "
            'with use = "fit"'
        )
    bundle = Bundle.new(
        campaign.rig,
        assembly.parts,
        # Only a diagnosis fits on motion logs.
        [s for s in campaign.sources() if s.use == "holdout" or s.kind not in MOTION_KINDS],
        seeds={"valve-pwm": seed},
        options={"valve-pwm": {"surface": surface}},
    )
    return CampaignFit(bundle, tuple(assembly.remarks), tuple(assembly.notices))


def _add_friction(assembly: _Assembly) -> None:
    entries = assembly.campaign.select(FRICTION_KINDS)
    if not entries:
        return
    trials: list[Trial] = []
    kinds: list[str] = []
    for entry in entries:
        own = assembly.read([entry])
        trials += own
        kinds += [entry.kind] * len(own)
    rig = assembly.campaign.rig
    assembly.add("friction", lambda: fit_friction(trials, rig, kind=kinds))


@dataclass(frozen=True)
class _BenchFit:
    """The law of a part on a bench, as a pipeline returns it."""

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
            assembly.add(kind, partial(_bench_fit, kind, trials, assembly.campaign.rig))


def _bench_fit(kind: str, trials: list[Trial], rig: Rig) -> _BenchFit:
    from sysid.diagnosis.bench.fitting import fit_law
    from sysid.diagnosis.bench.registry import component_of

    component = component_of(kind, trials, rig)
    fitted = fit_law(component, (), range(len(component.tests)))
    return _BenchFit(component.part(fitted.base_estimates()))


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

    def fit(self) -> tuple[Parts, tuple[str, ...], tuple[str, ...]]:
        """The part, remarks and notices; an empty part where nothing is identified."""
        try:
            result: PartResult
            if self.kind == "valve-discrete":
                result = fit_valve_discrete(self.trials, self.rig, valve=self.valve)
            else:
                result = fit_valve_pwm(
                    self.trials, self.rig, valve=self.valve, surface=self.surface, seed=self.seed
                )
        except NotIdentifiedError as error:
            return Parts(), (), (str(error),)
        return result.part(), tuple(result.remarks), tuple(result.notices)


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
    import joblib

    assembly.progress("; ".join(job.name for job in jobs))
    workers = min(len(jobs), joblib.cpu_count())
    found = joblib.Parallel(n_jobs=workers)(joblib.delayed(job.fit)() for job in jobs)
    for part, remarks, notices in reversed(found):
        assembly.parts = assembly.parts.merged(part)
        assembly.remarks += remarks
        assembly.notices += notices
