"""From a campaign's tests to one bundle: each pipeline runs on its tests, and the results are
assembled."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, ClassVar

from sysid.blocks.progress import progress_or_shown
from sysid.checks.consistency.campaign import check_consistency
from sysid.components.loading import component_in
from sysid.errors import (
    Failure,
    InputError,
    Notice,
    NotIdentifiedError,
    about,
    error_of,
    on_its_own,
)
from sysid.friction import fit_friction
from sysid.identification.friction.result import FrictionResult
from sysid.io.campaign import (
    BENCH_KINDS,
    FRICTION_KINDS,
    MOTION_KINDS,
    Campaign,
    CampaignLog,
)
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.io.source import Source
from sysid.parallel import attempt_all
from sysid.parameters import Bundle, Parts
from sysid.parameters.data_sheet import with_data_sheets
from sysid.pipeline.fit_part import FittedPart, PartResult, ValvePwmOptions, bench_fit
from sysid.pipeline.request import Reported, takes
from sysid.recording.friction_kind import MOTION, balances
from sysid.types import Progress
from sysid.valve_discrete import fit_valve_discrete
from sysid.valve_pwm import fit_valve_pwm

if TYPE_CHECKING:
    from sysid.components.loading import LoadedComponent
    from sysid.diagnosis.bench.fitting import FittedLaw

_LOGGER = logging.getLogger("sysid")
_OF = "friction"  # what the notices on friction are about


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
            self.contradictions += about(entry.kind, log.contradictions)
            self.notices += about(entry.kind, log.notices)
            trials += log.trials
        return trials

    def add(self, name: str, fit: Callable[[], PartResult]) -> None:
        """Add a pipeline's part, or a notice where there is none."""
        self.progress(name)
        result = on_its_own(fit)
        if isinstance(result, Failure):
            self.lack(result, name)
        else:
            self.merge(result)

    def lack(self, why: Failure, subject: str) -> None:
        """Note why a part is missing; its `subject` is the kind of its tests."""
        self.notices.append(Notice(why.reason, subject))
        self.failures.append(why)

    def merge(self, result: PartResult) -> None:
        """Add what a pipeline found."""
        self.remarks += result.remarks
        self.notices += result.notices
        self.parts = self.parts.merged(result.part())


@dataclass(frozen=True)
class CampaignFit:
    """A campaign's bundle, with the remarks and notices of its fits.

    `contradictions` are the first of the notices: where logs and rig file disagree.
    """

    bundle: Bundle
    remarks: tuple[str, ...]
    notices: tuple[str, ...]
    contradictions: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class FitOptions(Reported):
    """`surface`: which PWM surfaces, "bipolynomial", "ann" or "both"; `seed` of their folds; `law`
    of on/off valves and tanks, "thesis", "iso6358", "thesis-series" or "auto"; `load`: friction
    with a part that grows with the effort of the "motor", or with all that is "transmitted"."""

    surface: str = "both"
    seed: int = 0
    law: str = "auto"
    load: str | None = None

    surfaces: ClassVar[tuple[str, ...]] = ValvePwmOptions.surfaces
    """What `surface` can be."""


@takes(FitOptions)
def fit(campaign: Campaign, options: FitOptions) -> Bundle:
    """Every part that a campaign's training logs can identify, in one bundle.

    `surface`: which PWM surfaces, "bipolynomial", "ann" or "both"; `seed` of their folds and
    restarts; `law` of on/off valves: "thesis", "iso6358", "thesis-series", or "auto", by which
    their tests choose;
    `load`: friction with a part that grows with the effort of the "motor", or with all that is
    "transmitted".
    Parts not fitted, and logs that contradict one another, are reported as warnings of
    the logger `sysid`. Raises InputError for a log that cannot be used, NotIdentifiedError where
    nothing can be fitted.

    >>> bundle = si.fit(campaign)
    >>> bundle.model().parameters.coulomb_effort > 0
    True
    """
    with progress_or_shown(options.progress, "fitting") as tell:
        found = fit_campaign(campaign, replace(options, progress=tell))
    for line in dict.fromkeys((*contradictions_in(campaign), *found.notices)):
        _LOGGER.warning("%s", line)
    return found.bundle


def contradictions_in(campaign: Campaign) -> tuple[str, ...]:
    """Contradictions among the training logs, or with the rig file."""
    return () if component_in(campaign) else check_consistency(campaign, "fit")


@takes(FitOptions)
def fit_campaign(campaign: Campaign, options: FitOptions) -> CampaignFit:
    """Every part that a campaign's training logs can identify, in one bundle.

    A part whose tests the campaign lacks, or that they do not identify, is omitted from the
    bundle with a notice that says why; the others are fitted. Raises InputError for a log that
    cannot be read and where no part can use its logs, NotIdentifiedError where nothing at all is
    identified. `progress` is called with the name of each part as its fit begins.
    """
    if component_in(campaign) is not None:
        return _fit_own(campaign, options)
    assembly = _Assembly(campaign, options.tell)
    sources = campaign.sources()
    assembly.notices += [*campaign.notices, *campaign.rig.notices, *campaign.copies(sources)]
    _add_friction(assembly, options.load)
    _add_valves(assembly, options)
    _add_data_sheets(assembly)
    _add_bench(assembly, options.law)
    if not assembly.parts:
        raise _nothing(assembly)
    used = [s for s in sources if _is_used(s, assembly)]
    has_surfaces = any((s.kind, s.use) == ("valve-pwm", "fit") for s in used)
    bundle = Bundle.new(
        campaign.rig,
        assembly.parts,
        used,
        seeds={"valve-pwm": options.seed} if has_surfaces else {},
        options=_recorded(options, has_surfaces),
    )
    wrong = tuple(dict.fromkeys(assembly.contradictions))
    rest = (line for line in assembly.notices if line not in wrong)
    return CampaignFit(bundle, tuple(assembly.remarks), (*wrong, *rest), wrong)


def _recorded(options: FitOptions, has_surfaces: bool) -> dict[str, dict[str, str]]:
    """What was asked of the fits, as the provenance holds it."""
    found = {"valve-pwm": {"surface": options.surface}} if has_surfaces else {}
    return found if options.law == "auto" else found | {"valve-discrete": {"law": options.law}}


def _nothing(assembly: _Assembly) -> Exception:
    """The error of a campaign without any part: each part's reason, or that no log belongs to one;
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
    """Whether a log belongs in the provenance: motion logs are for the diagnosis, unless
    friction needed them."""
    fits_nothing = source.kind in MOTION_KINDS and not assembly.motion_for_friction
    return source.use == "holdout" or not fits_nothing


def _add_friction(assembly: _Assembly, load: str | None) -> None:
    """Friction from its own tests; where they do not identify it, from the motion logs as well.

    `load`: with a part that grows with an effort (`FitOptions`).
    """
    campaign, rig = assembly.campaign, assembly.campaign.rig
    tests = _labelled(assembly, campaign.select(FRICTION_KINDS))
    if tests:
        assembly.progress("friction")
    own, why = _friction_of(tests, rig, load)
    if own is not None:
        # A cause other than friction is for the diagnosis to name, not a reason to stop.
        assembly.notices += [
            Notice(
                f"friction tests: {line}: kept for `sysid diagnose`, not to be used as it is", _OF
            )
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
        found, why_moving = _friction_of([*tests, *motion], rig, load)
    if found is not None and (found.has_sliding or own is None):
        assembly.motion_for_friction = True
        assembly.merge(found)
        reason = "" if why is None else why.reason
        why_so = (
            f"the friction tests do not identify it: {reason}" if tests else "no test is for it"
        )
        line = f"friction is taken from the motion logs, since {why_so}"
        assembly.notices.append(Notice(line, _OF))
    elif own is not None:
        assembly.merge(own)
        if why_moving is not None:
            line = f"nor do the motion logs identify sliding friction: {why_moving.reason}"
            assembly.notices.append(Notice(line, _OF))
    else:
        for lacking in dict.fromkeys(filter(None, (why, why_moving))):
            assembly.lack(lacking, _OF)


def _labelled(assembly: _Assembly, entries: Sequence[CampaignLog]) -> list[tuple[Trial, str]]:
    """The trials of these entries, each with its entry's kind."""
    return [(trial, entry.kind) for entry in entries for trial in assembly.read([entry])]


def _friction_of(
    tests: list[tuple[Trial, str]], rig: Rig, load: str | None
) -> tuple[FrictionResult | None, Failure | None]:
    """The fit of these tests by kind, and why it lacks sliding friction."""
    if not tests:
        return None, None
    trials, kinds = [trial for trial, _ in tests], [kind for _, kind in tests]
    found = on_its_own(partial(fit_friction, trials, rig, kind=kinds, load=load))
    if isinstance(found, Failure):
        return None, found
    why = found.why_no_sliding
    return found, Failure(why, error=NotIdentifiedError(why))


def _add_bench(assembly: _Assembly, law: str) -> None:
    """The law of a tank or a valve that was tested alone."""
    for kind in BENCH_KINDS:
        entries = assembly.campaign.select([kind])
        if entries:
            trials = assembly.read(entries)
            assembly.add(kind, partial(bench_fit, kind, trials, assembly.campaign.rig, law))


@dataclass(frozen=True)
class _ValveJob:
    """One valve pipeline on the trials of the entries for the same valve."""

    kind: str
    valve: str | None
    trials: list[Trial]
    rig: Rig
    options: FitOptions

    @property
    def name(self) -> str:
        return self.kind if self.valve is None else f"{self.kind}, valve {self.valve.upper()}"

    def fit(self) -> FittedPart | Failure:
        """The bundle's content from the fit, or why it failed."""
        return on_its_own(self._fit)

    def _fit(self) -> FittedPart:
        result: PartResult
        if self.kind == "valve-discrete":
            law = self.options.law
            result = fit_valve_discrete(self.trials, self.rig, valve=self.valve, law=law)
        else:
            o = self.options
            result = fit_valve_pwm(
                self.trials, self.rig, valve=self.valve, surface=o.surface, seed=o.seed, law=o.law
            )
        return FittedPart(result.part(), tuple(result.remarks), tuple(result.notices))


def _add_valves(assembly: _Assembly, options: FitOptions) -> None:
    """Both kinds of valve test, one job per valve; the jobs share the cores."""
    chosen = options.those_of(FitOptions, progress=None)  # a job goes to another process
    jobs = []
    for kind in ("valve-pwm", "valve-discrete"):
        entries = assembly.campaign.select([kind])
        # For entries that name no valve, the valve that moves decides.
        for valve in dict.fromkeys(e.valve for e in entries):
            own = [e for e in entries if e.valve == valve]
            if kind == "valve-pwm":
                own = _at_the_rigs_period(assembly, own)
                if not own:
                    continue
            trials = assembly.read(own)
            jobs.append(_ValveJob(kind, valve, trials, assembly.campaign.rig, chosen))
    if not jobs:
        return
    assembly.progress("; ".join(job.name for job in jobs))
    # The on/off laws come first in a bundle.
    fitted = zip(jobs, attempt_all(job.fit for job in jobs), strict=True)
    for job, found in reversed(list(fitted)):
        if isinstance(found, Failure):
            assembly.lack(found, job.kind)
        else:
            assembly.merge(found)


def _at_the_rigs_period(assembly: _Assembly, entries: list[CampaignLog]) -> list[CampaignLog]:
    """One valve's logs without those that are for the choice of the frequency (thesis 3.7.2)."""
    from sysid.identification.valve_pwm.frequency import CampaignTests, at_the_rigs_period

    read = assembly.campaign.read
    tests = [CampaignTests(e.valve, read(e), e.pwm_period_s) for e in entries]
    kept = at_the_rigs_period(tests, assembly.campaign.rig)
    used = [any(one is other for other in kept) for one in tests]
    assembly.notices += [
        f"{entry.path}: its pulses have another PWM period than the rig file's: it is used for the "
        "choice of the frequency, not for the surfaces"
        for entry, is_used in zip(entries, used, strict=True)
        if not is_used
    ]
    return [entry for entry, is_used in zip(entries, used, strict=True) if is_used]


def _add_data_sheets(assembly: _Assembly) -> None:
    """What the rig file's data sheets say of the valves, where no test identifies it."""
    if not assembly.parts:
        return
    valves, notices = with_data_sheets(assembly.parts.valves, assembly.campaign.rig)
    assembly.parts = replace(assembly.parts, valves=valves)
    assembly.notices += notices


# --- a component of the user's own --------------------------------------------------------


def _fit_own(campaign: Campaign, options: FitOptions) -> CampaignFit:
    """Fit a component of the user's own on its training tests: bounded least squares.

    A dynamic component by the error of its simulation. Raises InputError for logs or code that
    cannot be used, NotIdentifiedError without a training log or where it identifies nothing.
    """
    from sysid.components.own_tests import tests_of, training_part
    from sysid.components.starts import check_starts
    from sysid.diagnosis.bench.fitting import fit_law

    tests = tests_of(campaign)
    part = training_part(tests)
    check_starts(part)
    options.tell(f"{tests.loaded.kind}: {tests.loaded.name}")
    fitted = fit_law(part, (), range(len(part.tests)))
    found = fitted.part()
    if found.component is None or not any(
        e.identified for e in found.component.parameters.values()
    ):
        raise NotIdentifiedError(f"component {tests.loaded.kind}: {_why_nothing(fitted)}")
    bundle = Bundle.new(campaign.rig, found, campaign.sources())
    return CampaignFit(bundle, (), (*tests.notices, *_remarks(fitted, tests.loaded)))


def _why_nothing(fitted: FittedLaw) -> str:
    """Why no parameter is identified, and the fix."""
    at_bound = set(fitted.fit.diagnosis.at_bound) - set(fitted.at_bounds)
    if not at_bound:
        return "its tests identify none of its parameters; excite its inputs more"
    words = []
    for p in fitted.fit.parameters:
        if p.name in at_bound:
            nearest = p.nearest_bound(fitted.fit[p.name])
            words.append(f"{p.name} ends at its bound {nearest:g} {p.unit}".rstrip())
    verb = "are" if len(words) > 1 else "is"
    return (
        f"{' and '.join(words)}, and {verb} not identified there; widen the bounds, or fix the "
        "law if they are physical"
    )


def _remarks(fitted: FittedLaw, loaded: LoadedComponent) -> list[str]:
    """Remarks on parameters stuck at a bound or tied, and on a law that explains too little."""
    diagnosed = fitted.fit.diagnosis
    lines = []
    for name in diagnosed.at_bound:
        within = name in fitted.at_bounds
        why = ", within its error" if within else ", and the tests want it beyond: widen it"
        lines.append(f"{name} ends at its bound{why}")
    if len(diagnosed.tied) > 1:
        lines.append(f"{' and '.join(diagnosed.tied)} are indistinguishable in these tests")
    judged = fitted.quality()
    if judged.explains_too_little:
        lines.append(
            f"{judged.shortfall}; sysid diagnose names what the law lacks, if the data are right"
        )
    return [f"{loaded.kind}: {line}" for line in lines]


__all__ = ["CampaignFit", "FitOptions", "contradictions_in", "fit", "fit_campaign"]
