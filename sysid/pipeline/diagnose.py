"""What a fitted model lacks, and the bundle extended by it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, cast

from sysid.blocks.drawing import plot_panels
from sysid.blocks.progress import progress_or_shown
from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table
from sysid.components.loading import component_in
from sysid.diagnosis import content, wording
from sysid.diagnosis.actuator.diagnose import diagnose as diagnose_actuator
from sysid.diagnosis.actuator.diagnose import (
    open_loop_errors,
    open_loop_trace,
    rivals_of,
    with_errors_after_judged,
    with_rival,
)
from sysid.diagnosis.actuator.loop import Memory
from sysid.diagnosis.actuator.search import Rival
from sysid.diagnosis.bench.diagnose import diagnose_component, held_out_errors
from sysid.diagnosis.bench.evidence import HeldOutEvidence
from sysid.diagnosis.bench.registry import AXIS, part_tested
from sysid.diagnosis.figures import steps_panel
from sysid.diagnosis.refined import (
    Look,
    with_refined_numbers,
    without_contradicted,
)
from sysid.diagnosis.result import BeforeAfter, Diagnosis, FoundEffect, Verdict
from sysid.diagnosis.rivals import may_be_better, simulating_best
from sysid.diagnosis.search_record import QUICK, SearchRecord, SearchStage, bounded
from sysid.diagnosis.tables import summary
from sysid.errors import Failure, NotIdentifiedError, input_error, on_its_own
from sysid.io.campaign import VALVE_KINDS, Campaign, CampaignLog
from sysid.io.logs import Log, Trial
from sysid.io.rig import Rig
from sysid.io.trial_kind import is_active, is_held
from sysid.parallel import attempt
from sysid.parameters import Bundle, EffectEntry, HeldOutError
from sysid.parameters.assembled_model import assumed_parameters
from sysid.parameters.effects import entry_of
from sysid.parameters.fitted_logs import check_log
from sysid.parameters.laws_of_pwm import with_laws_of_pwm
from sysid.parameters.possible import impossible
from sysid.parameters.refinement import ScatterOfFriction
from sysid.pipeline.request import Reported, takes
from sysid.plant.effects.catalogue import EffectSource, catalogue_from
from sysid.plant.effects.entry import Catalogue
from sysid.plant.effects.linear import for_rig
from sysid.plant.ports import Model, has_law
from sysid.refinement.draws import drawn_models

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Models with fitted numbers drawn by their errors; the squares of these many are averaged.
_DRAWN = 16
_HELD = (
    "the piston is held in every training test: chambers and valves alone are diagnosed, friction, "
    "inertia and efforts are not judged; motion logs would show them, and give errors of tests "
    "held out"
)
_EFFECTS = "effects act on the equations of an actuator or its parts"
_TERMS = "declare what your component may lack as its terms"


@dataclass(frozen=True, kw_only=True)
class DiagnoseOptions(Reported):
    """How long and how far a diagnosis searches; `effects`: those that the catalogue lacks."""

    effects: EffectSource = None
    refine: bool = True
    seed: int = 0
    budget: float | None = None
    quick: bool = False

    @property
    def simulates(self) -> bool:
        """Whether the numbers found minimise the simulation error; a quick diagnosis's do not."""
        return self.refine and not self.quick


@dataclass(frozen=True, repr=False)
class CampaignDiagnosis(Shown):
    """The result of `diagnose`: `verdict`, `effects`, errors before and after, extended `bundle`.

    `detail` holds the evidence.
    """

    detail: Diagnosis
    bundle: Bundle
    notices: tuple[str, ...]

    @property
    def verdict(self) -> Verdict:
        """ "adequate", "effects-found", "incomplete" or "unexplained"."""
        return self.detail.verdict

    @property
    def effects(self) -> tuple[FoundEffect, ...]:
        """The effects that were added, in turn, each with its estimates."""
        return self.detail.effects

    @property
    def residual(self) -> Mapping[str, BeforeAfter]:
        """RMSE on the held-out logs by channel, in its unit: before, after, of a correct model."""
        return self.detail.residual

    @property
    def record(self) -> SearchRecord:
        """What was examined, and what the budget or a failure left unexamined."""
        return self.detail.record

    def headline(self) -> str:
        """The verdict in one sentence."""
        return wording.sentence(self._told())

    def _told(self) -> dict[str, Any]:
        """What its sentences are made from: those of a user's own component know its columns."""
        return {**self.detail.to_json(), "own": dict(self.detail.evidence.own_columns)}

    def records(self) -> list[dict[str, Any]]:
        """One record per parameter of an effect: value, std, limits of the 95 % interval, unit."""
        return [record for effect in self.effects for record in effect.records()]

    def tables(self) -> Iterable[Table]:
        """The effects, their parameters, the errors on held-out logs, and what was tried."""
        return summary({**self.detail.to_json(), "figures": content.names(self.detail)})

    def footnotes(self) -> Iterable[str]:
        """What the remaining errors consist of, what to do next, and the notices."""
        found = self._told()
        return (*wording.remainder_lines(found), *wording.advice(found), *super().footnotes())

    def plot(self, ax: Axes | None = None) -> Axes:
        """RMSE on held-out logs over that of a correct model, before and after each effect."""
        return plot_panels((steps_panel(self.detail.to_json()),), ax)[0]

    def content(self) -> dict[str, Any]:
        """Its content as the report shows it, in JSON types."""
        return content.content(self.detail)


@takes(DiagnoseOptions)
def diagnose(campaign: Campaign, bundle: Bundle, options: DiagnoseOptions) -> CampaignDiagnosis:
    """What a bundle's model lacks by a campaign's training logs; errors of held-out ones.

    `effects`: effects in addition to the catalogue's, a Python file or the classes; `refine`:
    whether all parameters are estimated together by simulation error at the end, where an actuator
    lacked something; `seed` of the simulated twins. Takes from seconds (a part tested alone) to
    minutes; `quick`: a first diagnosis in about a fifth of that time. It ends after a number of
    evaluations, the same on any machine, or instead after `budget` seconds of processor time (of
    this process and its workers), with the best so far: `verdict` is "incomplete" then, and
    `record` says what was missed or skipped. A search that ends by itself finds the same whatever
    the budget. Raises InputError for logs that cannot be used or have changed since the fit,
    NotIdentifiedError where the bundle or the campaign is insufficient.

    >>> part = si.read_campaign("bench/campaign.toml")
    >>> found = si.diagnose(part, si.fit(part))
    >>> found.verdict, [effect.id for effect in found.effects]
    ('effects-found', ['valve-dead-band'])
    >>> sorted(found.residual["flow_a_kg_s"].to_json())
    ['after', 'before', 'noise_floor']
    """
    is_own = component_in(campaign) is not None
    given, assumed = (bundle, ()) if is_own else _with_flows(campaign, bundle)
    look = _of_own if is_own else _of_rig
    with progress_or_shown(options.progress, "diagnosing") as tell:
        found, notices = look(campaign, given, replace(options, progress=tell))
    longer = extended_bundle(given if found.effects else bundle, found, campaign)
    said = tuple(dict.fromkeys((*assumed, *notices, *found.notices)))
    return CampaignDiagnosis(found, longer, said)


def _with_flows(campaign: Campaign, bundle: Bundle) -> tuple[Bundle, tuple[str, ...]]:
    """The bundle, of an actuator with on/off laws from its PWM tests where it has no other."""
    part = part_tested(campaign.training_kinds(), bundle)
    return with_laws_of_pwm(bundle) if part is None else (bundle, ())


def _of_own(
    campaign: Campaign, bundle: Bundle, options: DiagnoseOptions
) -> tuple[Diagnosis, tuple[str, ...]]:
    """The terms that the law of a user's own component lacks, and the readers' notices.

    Terms that the bundle holds are part of the law.
    """
    from sysid.components.own_tests import part_of, tests_of, training_part
    from sysid.components.parts import OwnPart, effects_in

    if options.effects is not None:
        raise input_error(campaign.path, _EFFECTS, _TERMS)
    tests = tests_of(campaign, bundle)
    kept = [effect.id for effect in effects_in(bundle, tests.loaded)]
    scales = training_part(tests).scales

    def build(kind: str, trials: Sequence[Trial], rig: Rig) -> OwnPart:
        return part_of(tests.loaded, trials, scales, kept)

    with bounded(options.budget) as limit:
        found = diagnose_component(
            tests.loaded.kind, tests.fitted, tests.held_out, campaign.rig, bundle, {},
            options.tell, quick=options.quick, build=build,
        )  # fmt: skip
    return replace(found, evaluations=limit.made), tests.notices


def _of_rig(
    campaign: Campaign, bundle: Bundle, options: DiagnoseOptions
) -> tuple[Diagnosis, tuple[str, ...]]:
    """What the model of an actuator, or of a part of one, lacks, and the readers' notices.

    An effect that the bundle already holds is part of the model under diagnosis. Held-out logs give
    errors, and decide nothing.
    """
    with bounded(options.budget) as limit:
        found, notices = _searched(campaign, bundle, options)
    found = replace(found, evaluations=limit.made)
    if options.quick and options.refine and found.effects:
        found = found.with_missed(SearchStage.REFINEMENT, QUICK)
    return found, notices


def _searched(
    campaign: Campaign, bundle: Bundle, options: DiagnoseOptions
) -> tuple[Diagnosis, tuple[str, ...]]:
    catalogue = catalogue_from(options.effects)
    taken = {entry.id for entry in bundle.effects}
    open_ones = for_rig(
        {name: effect for name, effect in catalogue.items() if name not in taken},
        campaign.rig.is_linear,
    )
    logs: list[tuple[str, str, Log]] = []
    notices: list[str] = []
    for entry in campaign.logs:
        log = _read(campaign, entry, bundle)
        logs.append((entry.use, entry.kind, log))
        notices += log.notices
    kind = part_tested(campaign.training_kinds(), bundle)
    if kind is None and campaign.rig.air is None:
        raise NotIdentifiedError(
            f"{campaign.path}: an axis without air is diagnosed on tests of kind friction-motion, "
            "of which it holds none; add some (docs: how-to/part-alone)"
        )
    if kind is not None:
        notices += impossible(bundle, campaign.rig) if kind == AXIS else []
        look = _look_at_part(kind, campaign, bundle, logs, catalogue, options)
    else:
        notices += [*bundle.other_rig(campaign.rig), *assumed_parameters(bundle, campaign.rig)]
        has_piston = campaign.rig.cylinder is not None
        held = has_piston and bundle.friction is None and not _moves(logs, campaign.rig)
        if held:
            notices.append(_HELD)
            model = _held_model(campaign, bundle, logs, catalogue)
            look = _search_of(logs, campaign.rig, model, options, Memory())
        else:
            look = _look_at_actuator(campaign, bundle, logs, catalogue, options)
    found = without_contradicted(look, open_ones, options.tell)
    if kind is None and not held:
        found = replace(found, trace=_trace(campaign, bundle, found, logs, catalogue))
    return found, tuple(notices)


def _moves(logs: Sequence[tuple[str, str, Log]], rig: Rig) -> bool:
    """Whether the piston is free in any of the training tests."""
    return any(
        not (kind in VALVE_KINDS or is_held(trial, rig))
        for use, kind, log in logs
        if use == "fit"
        for trial in log.trials
    )


def _trace(
    campaign: Campaign,
    bundle: Bundle,
    found: Diagnosis,
    logs: Sequence[tuple[str, str, Log]],
    catalogue: Catalogue,
) -> Mapping[str, Any] | None:
    """A held-out test as it is drawn; None where it cannot be simulated."""
    longer = extended_bundle(bundle, found, campaign)
    before, after = (one.model(campaign.rig, catalogue) for one in (bundle, longer))
    known = None if longer.refinement is None else longer.refinement.friction_scatter
    scatter = float(known.sliding) if isinstance(known, ScatterOfFriction) else 0.0
    made = on_its_own(partial(open_loop_trace, logs, campaign.rig, before, after, scatter))
    return None if isinstance(made, Failure) else made


def _look_at_part(
    kind: str,
    campaign: Campaign,
    bundle: Bundle,
    logs: Sequence[tuple[str, str, Log]],
    catalogue: Catalogue,
    options: DiagnoseOptions,
) -> Look:
    trials = {
        wanted: [t for use, of, log in logs if (use, of) == (wanted, kind) for t in log.trials]
        for wanted in ("fit", "holdout")
    }
    refine = options.simulates and kind == AXIS and campaign.rig.is_motor_alone

    def look(effects: Catalogue) -> Diagnosis:
        found = diagnose_component(
            kind, trials["fit"], trials["holdout"], campaign.rig, bundle, effects,
            options.tell, quick=options.quick,
        )  # fmt: skip
        if not refine:
            return found
        extended = extended_bundle(bundle, found, campaign)
        outside = cast(HeldOutEvidence, found.evidence).outside
        after = None if outside is None else partial(held_out_errors, outside, catalogue=catalogue)
        return with_refined_numbers(found, campaign, extended, catalogue, after, options.tell)

    return look


def _held_model(
    campaign: Campaign, bundle: Bundle, logs: Sequence[tuple[str, str, Log]], catalogue: Catalogue
) -> Model:
    """An actuator whose piston is held in every test: its chambers and valves alone.

    A valve that no law is known of passes nothing where no test commands it.
    """
    model = bundle.model(campaign.rig, catalogue, held=True)
    for side in campaign.rig.sides:
        names = (f"valve_{side}", f"duty_{side}")
        acts = any(is_active(trial, *names) for _, _, log in logs for trial in log.trials)
        if not (acts or has_law(model.parameters, side)):
            model = replace(model, parameters=model.parameters.without_flow(side))
    return model


def _search_of(
    logs: Sequence[tuple[str, str, Log]],
    rig: Rig,
    model: Model,
    options: DiagnoseOptions,
    memory: Memory,
    drawn: Sequence[Model] = (),
) -> Look:
    """The search of an actuator's tests, whose looks share what they have computed."""

    def look(effects: Catalogue) -> Diagnosis:
        return diagnose_actuator(
            logs, rig, model, effects, drawn=drawn, seed=options.seed,
            quick=options.quick, memory=memory, progress=options.tell,
        )  # fmt: skip

    return look


def _look_at_actuator(
    campaign: Campaign,
    bundle: Bundle,
    logs: Sequence[tuple[str, str, Log]],
    catalogue: Catalogue,
    options: DiagnoseOptions,
) -> Look:
    model = bundle.model(campaign.rig, catalogue)
    drawn = drawn_models(bundle, campaign.rig, model, _DRAWN, options.seed)
    memory = Memory()
    search = _search_of(logs, campaign.rig, model, options, memory, drawn)

    def errors_of(other: Bundle) -> dict[str, float]:
        return open_loop_errors(logs, campaign.rig, other.model(campaign.rig, catalogue))

    def look(effects: Catalogue) -> Diagnosis:
        first = found = search(effects)
        if options.simulates:
            found = refined(first)
            for rival in rivals_of(first):
                if may_be_better(found, rival):
                    found = judged(found, first, rival)
            memory.shown = frozenset(e.id for e in found.effects)
        return with_errors_after_judged(found)

    def judged(found: Diagnosis, first: Diagnosis, rival: Rival) -> Diagnosis:
        rig = campaign.rig
        other = attempt(lambda: with_rival(first, rival, memory, logs, rig, model, drawn=drawn))
        if isinstance(other, Failure):
            return found.with_missed(SearchStage.RIVALS, other)
        return simulating_best(found, refined(other), options.tell)

    def refined(found: Diagnosis) -> Diagnosis:
        extended = extended_bundle(bundle, found, campaign)
        return with_refined_numbers(found, campaign, extended, catalogue, errors_of, options.tell)

    return look


def _read(campaign: Campaign, entry: CampaignLog, bundle: Bundle) -> Log:
    log = campaign.read(entry)
    check_log(bundle, log, entry.kind, entry.use)
    return log


def extended_bundle(bundle: Bundle, diagnosis: Diagnosis, campaign: Campaign) -> Bundle:
    """The bundle with the effects found, and the base parameters estimated together with them.

    PWM surfaces stay as they were fitted. Where no effect was found only the campaign's
    held-out logs are added to the provenance.
    """
    found = bundle.with_sources(campaign.sources(None if diagnosis.effects else "holdout"))
    if not diagnosis.effects:
        return found if diagnosis.record.is_complete else _recorded(found, diagnosis)
    entries = [_entry(effect) for effect in diagnosis.effects]
    if diagnosis.refinement is not None:
        refined = diagnosis.refinement.bundle
        found = refined.replaced(effects=[*refined.effects[: -len(entries)], *entries])
        return _recorded(found, diagnosis)
    return _recorded(diagnosis.evidence.with_base(found.with_effects(entries)), diagnosis)


def _recorded(found: Bundle, diagnosis: Diagnosis) -> Bundle:
    """The bundle with the seed, the verdict and what the search missed in its provenance."""
    made: dict[str, Any] = {"seed": diagnosis.seed, "verdict": diagnosis.verdict}
    if not diagnosis.record.is_complete:
        made["search"] = diagnosis.record.to_json()
    options = {**found.provenance.options, "diagnosis": made}
    return found.replaced(provenance=found.provenance.replaced(options=options))


def _entry(found: FoundEffect) -> EffectEntry:
    """The effect as a bundle lists it, with the evidence for it."""
    return entry_of(found.effect, found.estimates).replaced(
        p_value=found.p_value,
        holdout_rmse={name: HeldOutError(**e.to_json()) for name, e in found.holdout.items()},
        ambiguous_with=list(found.ambiguous_with),
    )


__all__ = ["CampaignDiagnosis", "DiagnoseOptions", "diagnose", "extended_bundle"]
