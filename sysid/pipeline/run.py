"""The whole pipeline, stage by stage: check, fit, diagnose, refine, validate, report, export.

Where it is asked for, which test to run next is predicted before the report is written.

Each stage writes complete files and is then entered in `run.json` with the digests of all
its inputs. A later call repeats what failed, what is missing and what is stale, and says
why.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from sysid import __version__
from sysid.checks.log_check import LogCheck
from sysid.components.loading import component_in
from sysid.errors import Failure, InputError, Notice, on_its_own, subject_of, unless_failed
from sysid.io.campaign import Campaign
from sysid.io.files import make_folder, remove_leftovers, write_atomic
from sysid.io.foreign import digest_of
from sysid.io.locks import working_in
from sysid.parallel import processor_seconds
from sysid.parameters import Bundle, read_bundle, write_bundle
from sysid.pipeline.check import checks_of
from sysid.pipeline.diagnose import DiagnoseOptions, diagnose
from sysid.pipeline.export import ExportOptions, export_file
from sysid.pipeline.files import read_with
from sysid.pipeline.fit import FitOptions, fit_campaign
from sysid.pipeline.refine import RefineOptions, refine, why_not_refined
from sysid.pipeline.request import takes
from sysid.pipeline.validate import ValidateOptions, is_validated, validate
from sysid.plant.effects.catalogue import catalogue_with
from sysid.types import Progress, no_progress

if TYPE_CHECKING:
    from sysid.validation.results import ValidationResult

STATE_FILE = "run.json"
REPORT_FILE = "report.html"
BUNDLE_FILE = "bundle.json"
FITTED_FILE = "fitted.json"
_EXTENDED_FILE = "extended.json"
_REFINED_FILE = "refined.json"
DIAGNOSIS_FILE = "diagnosis.json"
_CHECKS_FILE = "checks.json"
_ADVICE_FILE = "advice.json"
_NOT_DONE_YET = "not done yet"
# In a stage's record: the processor time after which it was cut short, s; and whether that was by
# the evaluations that it may make without a budget.
_CUT_SHORT, _BY_COUNT = "cut_short_after_s", "cut_short_by_count"
# In a stage's record: that only a quick diagnosis was requested.
_QUICK = "quick"
_NOTICES, _SUBJECTS, _UNASKED = "notices", "subjects", "unasked"
Result = TypeVar("Result")

EXPORTS = {"c": "export/model.h", "mat": "export/model.mat", "json": "export/model.json"}


@dataclass(frozen=True)
class StageReport:
    """The outcome of a stage: `why` it was done (None: it was up to date), and its duration, s.

    `complete`: whether it did all of its work, not only what its budget allowed.
    """

    name: str
    why: str | None
    seconds: float
    complete: bool = True

    @property
    def outcome(self) -> str:
        """The outcome in words: done, up to date or why it was repeated, and whether in part."""
        said = "up to date" if self.why is None else f"{self.why}: repeated"
        said = "done" if self.why == _NOT_DONE_YET else said
        return said if self.complete else f"{said}, incomplete"


@dataclass(frozen=True, kw_only=True)
class RunOptions(FitOptions, DiagnoseOptions):
    """The options of a fit and of a diagnosis, and which stages there are.

    `diagnose`: whether to search for what the model lacks; `refine`: whether to estimate all
    parameters together, too; `advise`: whether the report says which test to run next; `effects`: a
    Python file with further effects, `component`: one with a user's own component; `exclude`: what
    is not read of the logs; `entered` is called with the name of each stage.
    """

    effects: Path | None = None
    diagnose: bool = True
    advise: bool = False
    component: str | None = None
    exclude: Sequence[str] = ()
    entered: Progress = no_progress


@dataclass
class PipelineRun:
    """A run under way; `unasked`: those of its `notices` that a terminal shows only with -v."""

    campaign: Campaign
    folder: Path
    options: RunOptions
    inputs: dict[str, str]
    notices: list[str] = field(default_factory=list)
    unasked: list[str] = field(default_factory=list)
    validation: ValidationResult | None = None
    not_validated: str = ""

    def path(self, name: str) -> Path:
        return self.folder / name

    def bundle(self, name: str) -> Bundle:
        """A bundle of this run, named by its file name alone: messages about it go into a report
        that is sent to others."""
        return read_bundle(self.path(name)).named(name)

    @property
    def model_file(self) -> str:
        """The bundle that is validated: the last that was made."""
        if self.options.simulates:
            return _REFINED_FILE
        return _EXTENDED_FILE if self.options.diagnose else FITTED_FILE

    def diagnosis(self) -> dict[str, Any] | None:
        """The diagnosis as written: its result, or why it was `skipped`; None without one."""
        if not self.options.diagnose:
            return None
        content: dict[str, Any] = json.loads(self.path(DIAGNOSIS_FILE).read_text("utf-8"))
        return content

    def advice(self) -> dict[str, Any] | None:
        """What to run next, as written; None where it was not asked for or cannot be said."""
        if not self.options.advise:
            return None
        content: dict[str, Any] = json.loads(self.path(_ADVICE_FILE).read_text("utf-8"))
        return None if "skipped" in content else content

    def notices_of(self, stage: str) -> list[str]:
        """The notices of a stage that was done, in this call or an earlier one."""
        record = _read_state(self.folder).get(stage, {})
        said = record.get(_NOTICES, [])
        return list(map(Notice, said, record.get(_SUBJECTS, [""] * len(said))))


def digests(campaign: Campaign) -> dict[str, str]:
    """SHA-256 of the campaign file, the rig file and every log, by their names."""
    paths = {campaign.path.name: campaign.path, "rig file": Path(campaign.rig.source)}
    paths |= {entry.file: entry.path for entry in campaign.logs}
    return {name: digest_of(path, "an input") for name, path in paths.items()}


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _digest_if_made(path: Path) -> str:
    """The digest of an output; empty for one that could not be made, so that it is tried again."""
    return _digest(path) if path.is_file() else ""


@dataclass(frozen=True)
class Stage:
    """A stage: its output, its inputs in addition to the logs, and its work.

    `reads_effects`: whether a file of further effects is one of its inputs; `reads_refine`:
    whether it does the refinement where one is asked for; `has_quick`: whether it has a quick form,
    which a call without --quick does again, as a whole; `was_cut_short`: whether its output says
    that its budget ended before all of it was done; `layout` is raised when the files that it
    writes change theirs, so that those of an earlier program are made anew.
    """

    name: str
    outputs: tuple[str, ...]
    made_from: tuple[str, ...]
    perform: Callable[[PipelineRun], None]
    reads_effects: bool = True
    reads_refine: bool = False
    has_quick: bool = False
    was_cut_short: Callable[[PipelineRun], bool] = lambda run: False
    layout: int = 1


def made_from(run: PipelineRun, stage: Stage) -> dict[str, str]:
    """What a stage's outputs depend on, by name: digests and options."""
    found = {
        **run.inputs,
        **{name: _digest(run.path(name)) for name in stage.made_from},
        "sysid": __version__,
        "--surface": run.options.surface,
        "--seed": str(run.options.seed),
    }
    # Named where they are asked for, so that what was made without them stays up to date.
    asked = {"--law": run.options.law, "--load": run.options.load}
    found |= {name: text for name, text in asked.items() if text not in (None, "auto")}
    if stage.reads_effects and run.options.effects is not None:
        found["--effects"] = _digest(run.options.effects)
    own = component_in(run.campaign)
    if own is not None:
        found["--component"] = f"{own.name} {own.sha256}"
    if run.options.exclude:
        found["--exclude"] = json.dumps(tuple(run.options.exclude))
    if stage.layout > 1:
        found["layout"] = str(stage.layout)
    if stage.reads_refine:
        found["--refine"] = str(run.options.simulates)
    return found


def perform(run: PipelineRun, stage: Stage) -> StageReport:
    """Do a stage unless its outputs are up to date; its notices are those of when it was done."""
    given = made_from(run, stage)
    state = _read_state(run.folder)
    before = state.get(stage.name, {})
    why = _stale(run, stage, given, state.get(stage.name))
    if why is None:
        run.options.tell(f"{stage.name}: up to date")
        run.notices += before.get(_NOTICES, [])
        run.unasked += before.get(_UNASKED, [])
        complete = _CUT_SHORT not in before and not before.get(_QUICK)
        if _CUT_SHORT in before:
            run.notices.append(_incomplete(stage, before))
        run.notices += [_first_look(stage)] if before.get(_QUICK) else []
        return StageReport(stage.name, None, 0.0, complete)
    run.options.tell(
        f"{stage.name}: {'starts' if why == _NOT_DONE_YET else f'{why}; starts again'}"
    )
    start, said, unasked = time.perf_counter(), len(run.notices), len(run.unasked)
    used = processor_seconds()
    stage.perform(run)
    seconds = time.perf_counter() - start
    used = processor_seconds() - used
    record = state[stage.name] = {
        "made_from": given,
        "outputs": {name: _digest_if_made(run.path(name)) for name in stage.outputs},
        "seconds": round(seconds, 3),
        _NOTICES: run.notices[said:],
        _SUBJECTS: list(map(subject_of, run.notices[said:])),
        _UNASKED: run.unasked[unasked:],
    }
    quick = stage.has_quick and run.options.quick
    if quick:
        record[_QUICK] = True
        run.notices.append(_first_look(stage))
    cut_short = stage.was_cut_short(run)
    if cut_short:
        record[_BY_COUNT] = run.options.budget is None
        record[_CUT_SHORT] = round(used, 3) if run.options.budget is None else run.options.budget
        run.notices.append(_incomplete(stage, record))
    write_atomic(run.path(STATE_FILE), json.dumps(state, indent=2) + "\n")
    whole = all(run.path(name).is_file() for name in stage.outputs)
    return StageReport(stage.name, why, seconds, whole and not (cut_short or quick))


def _incomplete(stage: Stage, record: Mapping[str, Any]) -> str:
    seconds = f"{record[_CUT_SHORT]:.3g} s of processor time"
    why, more = f"its {seconds} ran out", "a larger --budget does"
    if record.get(_BY_COUNT):
        why = f"it made all the evaluations that it may, in {seconds}"
        more = "a --budget of more than that does"
    return (
        f"{stage.name}: incomplete, as {why}: {more} it again (so does any, without "
        f"{stage.outputs[0]})"
    )


def _may_do_more(budget: float | None, record: Mapping[str, Any]) -> bool:
    """Whether a stage that was cut short is to be done again."""
    if _CUT_SHORT not in record:
        return False
    if budget is None:
        return not record.get(_BY_COUNT)
    return bool(budget > record[_CUT_SHORT])


def _first_look(stage: Stage) -> str:
    return f"{stage.name}: a quick diagnosis, incomplete: a run without --quick completes it"


def has_whole_diagnosis(run: PipelineRun) -> bool:
    """Whether the folder holds all that this run would find without --quick."""
    whole = replace(run, options=replace(run.options, quick=False))
    state = _read_state(run.folder)
    stages = [stage for stage in stages_of(whole) if stage.has_quick]
    if not all(whole.path(name).is_file() for stage in stages for name in stage.made_from):
        return False
    return all(
        _stale(whole, stage, made_from(whole, stage), state.get(stage.name)) is None
        for stage in stages
    )


# Share of the time of a complete diagnosis.
_QUICK_SHARE = 0.2
# Seconds of each stage on two processor cores, where no earlier run of the folder says more.
_USUAL = {
    "check": 4.0, "fit": 25.0, "diagnose": 60.0, "refine": 1.0, "validate": 8.0, "advise": 20.0,
    "report": 12.0, "export": 3.0,
}  # fmt: skip


def expected_seconds(folder: Path, options: RunOptions) -> dict[str, float]:
    """Approximate duration of each stage, s: as in an earlier run, else the usual one."""
    known = {
        name: float(record["seconds"])
        for name, record in _read_state(folder).items()
        if isinstance(record, dict) and isinstance(record.get("seconds"), int | float)
    }
    whole = min(_USUAL["diagnose"], options.budget or math.inf)
    usual = _USUAL | {"diagnose": _QUICK_SHARE * whole if options.quick else whole}
    done = {"diagnose": options.diagnose, "refine": options.simulates, "advise": options.advise}
    left_out = {name: not wanted for name, wanted in done.items()}
    return {n: known.get(n, usual[n]) for n in usual if not left_out.get(n)}


def _read_state(folder: Path) -> dict[str, Any]:
    """The record of earlier calls; empty where the file is missing or no longer readable."""
    try:
        state = json.loads((folder / STATE_FILE).read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return state if isinstance(state, dict) else {}


def _stale(
    run: PipelineRun, stage: Stage, made_from: Mapping[str, str], before: Mapping[str, Any] | None
) -> str | None:
    """Why a stage has to be done; None where its files are present and nothing has changed."""
    if before is None:
        return _NOT_DONE_YET
    if before.get(_QUICK) and not run.options.quick:
        return "a quick diagnosis (--quick)"
    old = before.get("made_from", {})
    changed = [k for k in {**old, **made_from} if old.get(k) != made_from.get(k)]
    if changed:
        return f"stale, changed: {', '.join(changed)}"
    if _may_do_more(run.options.budget, before):
        how = "s of processor time" if before.get(_BY_COUNT) else "s of --budget"
        return f"incomplete after {before[_CUT_SHORT]:.3g} {how}"
    for name, digest in before.get("outputs", {}).items():
        path = run.path(name)
        if not path.is_file():
            return f"{name} is missing"
        if _digest(path) != digest:
            return f"{name} was changed by hand"
    return None


def _check(run: PipelineRun) -> None:
    """Raises InputError for an unreadable log; after other failures checks are skipped."""
    checks = unless_failed("not checked", partial(checks_of, run.campaign), run.notices)
    if isinstance(checks, Failure):
        if isinstance(checks.error, InputError):
            raise checks.error
        checks = []
    run.notices += [line for check in checks for line in check.contradicts]
    run.notices += [line for check in checks for line in check.notices]
    logs = [check.to_json() for check in checks]
    write_atomic(run.path(_CHECKS_FILE), json.dumps({"logs": logs}, indent=2) + "\n")


def _fit(run: PipelineRun) -> None:
    options = replace(run.options, progress=lambda part: run.options.tell(f"fitting {part}"))
    found = fit_campaign(run.campaign, options)
    write_bundle(found.bundle, run.path(FITTED_FILE))
    run.notices += found.notices


def _diagnose(run: PipelineRun) -> None:
    """A campaign that cannot be diagnosed continues as fitted; a notice says why."""
    bundle = run.bundle(FITTED_FILE)

    def made() -> tuple[str, Bundle, tuple[str, ...]]:
        diagnosis = diagnose(run.campaign, bundle, run.options)
        return _json_text(diagnosis.content()), diagnosis.bundle, diagnosis.notices

    found = unless_failed("not diagnosed", made, run.notices)
    if isinstance(found, Failure):
        text = _json_text({"skipped": found.reason})
    else:
        text, bundle, notices = found
        run.notices += notices
    write_atomic(run.path(DIAGNOSIS_FILE), text)
    write_bundle(bundle, run.path(_EXTENDED_FILE))


def _json_text(content: dict[str, Any]) -> str:
    return json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def _was_cut_short(run: PipelineRun) -> bool:
    """Whether the diagnosis missed something as its budget ended."""
    search = (run.diagnosis() or {}).get("search", {})
    return any(entry.get("out_of_time") for entry in search.get("missed", []))


def _refine(run: PipelineRun) -> None:
    """A campaign whose motion cannot be simulated continues unrefined; a notice says why.

    So does one that refined numbers would simulate much worse.

    A part tested alone, save an axis with a motor, has no motion to simulate: its bundle continues
    as it is, and so does one that the diagnosis refined, or tried to refine and could not.
    """
    bundle = run.bundle(_EXTENDED_FILE if run.options.diagnose else FITTED_FILE)
    refined = bundle
    tried = (run.diagnosis() or {}).get("not_refined")
    if not tried and not why_not_refined(run.campaign, bundle):
        options = RefineOptions(effects=run.options.effects, progress=run.options.tell)
        work = partial(refine, run.campaign, bundle, options)
        result = unless_failed("not refined", work, run.notices)
        if not isinstance(result, Failure) and result.worse:
            run.notices.append(f"not refined: the training tests would be simulated {result.worse}")
        elif not isinstance(result, Failure):
            run.notices += result.notices
            refined = result.bundle
    write_bundle(refined, run.path(_REFINED_FILE))


def _validated(run: PipelineRun) -> ValidationResult | None:
    """The validation of the final bundle; None where nothing of it can be simulated."""
    if run.validation is not None or run.not_validated:
        return run.validation
    bundle = run.bundle(run.model_file)
    if is_validated(run.campaign, bundle):
        options = ValidateOptions(effects=run.options.effects, progress=run.options.tell)
        found = on_its_own(lambda: validate(run.campaign, bundle, options))
        if isinstance(found, Failure):
            run.not_validated = found.reason
        else:
            run.validation = found
    return run.validation


def _validate(run: PipelineRun) -> None:
    bundle = run.bundle(run.model_file)
    result = _validated(run)
    if result is None:
        why = run.not_validated or f"{run.campaign.path}: no motion log of an actuator"
        run.notices.append(f"not validated: {why}")
    else:
        run.notices += result.notices
        bundle = bundle.replaced(validation=result.record()).with_sources(run.campaign.sources())
    write_bundle(bundle, run.path(BUNDLE_FILE))


def _advise(run: PipelineRun) -> None:
    """Which test to run next; where that cannot be said a notice says why."""
    from sysid.pipeline.advise import AdviseOptions, advise

    options = AdviseOptions(effects=run.options.effects, sizes=False, progress=run.options.tell)
    work = partial(advise, run.campaign, run.bundle(BUNDLE_FILE), options)
    found = unless_failed("no advice", work, run.notices)
    content = {"skipped": found.reason} if isinstance(found, Failure) else found.to_json()
    write_atomic(run.path(_ADVICE_FILE), _json_text(content))


def _written(
    run: PipelineRun, path: Path, write: Callable[[], Result], not_done: str
) -> Result | Failure:
    """What writing a file gave; a file of an earlier call is removed where this one has none."""
    found = unless_failed(not_done, write, run.notices)
    if isinstance(found, Failure) and path.is_file():
        path.unlink()
    return found


def _report(run: PipelineRun) -> None:
    from sysid.pipeline.pages.report import render_report

    content = json.loads(run.path(_CHECKS_FILE).read_text("utf-8"))
    path = run.path(REPORT_FILE)

    def write() -> None:
        html = render_report(
            campaign=run.campaign,
            bundle=run.bundle(BUNDLE_FILE),
            validation=_validated(run),
            checks=[LogCheck.from_json(c) for c in content["logs"]],
            diagnosis=run.diagnosis(),
            advice=run.advice(),
            notices=run.notices_of("fit"),
            progress=run.options.tell,
        )
        write_atomic(path, html)

    _written(run, path, write, "no report")


def _export(run: PipelineRun) -> None:
    """Each format is independent of the others."""
    make_folder(run.path("export"))
    for kind, name in EXPORTS.items():
        path = run.path(name)
        options = ExportOptions(format=kind, effects=run.options.effects)
        write = partial(export_file, run.path(BUNDLE_FILE), path, options)
        said = _written(run, path, write, f"no {name}")
        if not isinstance(said, Failure):
            run.notices += said
            run.unasked += said


def stages_of(run: PipelineRun) -> list[Stage]:
    """The stages of a run, in turn."""
    diagnosed = (DIAGNOSIS_FILE, _EXTENDED_FILE)
    shown = (
        BUNDLE_FILE,
        _CHECKS_FILE,
        *([DIAGNOSIS_FILE] if run.options.diagnose else []),
        *([_ADVICE_FILE] if run.options.advise else []),
    )
    refined_from = _EXTENDED_FILE if run.options.diagnose else FITTED_FILE
    asked = run.options
    done = {"diagnose": asked.diagnose, "refine": asked.simulates, "advise": asked.advise}
    left_out = {name for name, wanted in done.items() if not wanted}
    stages = [
        Stage("check", (_CHECKS_FILE,), (), _check, reads_effects=False),
        Stage("fit", (FITTED_FILE,), (), _fit, reads_effects=False),
        Stage(
            "diagnose",
            diagnosed,
            (FITTED_FILE,),
            _diagnose,
            reads_refine=True,
            has_quick=True,
            was_cut_short=_was_cut_short,
            layout=4,
        ),
        Stage("refine", (_REFINED_FILE,), (refined_from,), _refine),
        Stage("validate", (BUNDLE_FILE,), (run.model_file,), _validate),
        Stage("advise", (_ADVICE_FILE,), (BUNDLE_FILE,), _advise),
        Stage("report", (REPORT_FILE,), shown, _report, layout=2),
        Stage("export", tuple(EXPORTS.values()), (BUNDLE_FILE,), _export),
    ]
    if component_in(run.campaign) is not None:
        # The law is the user's Python, and so are its files for a controller.
        left_out.add("export")
    return [stage for stage in stages if stage.name not in left_out]


# --- the whole run ------------------------------------------------------------------------


@dataclass(frozen=True)
class RunReport:
    """The result of `sysid run`: the stages, the bundle, and the files that it wrote.

    `diagnosis` is the content of its file, None without a diagnosis, `advice` likewise; `unasked`
    are those of the notices, on what an export lacks, that a terminal shows only when asked to;
    `not_diagnosed` says why a diagnosis was skipped.
    """

    folder: Path
    stages: tuple[StageReport, ...]
    bundle: Bundle
    notices: tuple[str, ...]
    diagnosis: dict[str, Any] | None = None
    unasked: tuple[str, ...] = ()
    not_diagnosed: str = ""
    advice: dict[str, Any] | None = None

    @property
    def report(self) -> Path:
        """The HTML report."""
        return self.folder / REPORT_FILE

    @property
    def exports(self) -> dict[str, Path]:
        """The files for a controller by format, without those that could not be made.

        None of a component of the user's own.
        """
        if not any(stage.name == "export" for stage in self.stages):
            return {}
        paths = {kind: self.folder / name for kind, name in EXPORTS.items()}
        return {kind: path for kind, path in paths.items() if path.is_file()}

    def to_json(self) -> dict[str, Any]:
        """The output of `sysid run --json`; `diagnosis` as in `sysid diagnose --json`, or null."""
        diagnosis = self.diagnosis and {k: v for k, v in self.diagnosis.items() if k != "figures"}
        return {
            "folder": str(self.folder),
            "report": str(self.report) if self.report.is_file() else None,
            "bundle": str(self.folder / BUNDLE_FILE),
            "exports": {kind: str(path) for kind, path in self.exports.items()},
            "stages": [asdict(s) for s in self.stages],
            "diagnosis": diagnosis,
            "validation": self.bundle.to_json().get("validation", {}),
            "notices": list(self.notices),
        }


@takes(RunOptions)
def run_campaign(campaign_path: Path, folder: Path, options: RunOptions) -> RunReport:
    """Run every stage that is not up to date. Raises what the stages raise.

    The diagnosis ends after `budget` seconds of processor time (None: after so many evaluations);
    where it missed something then, a call with more does it again. `quick`: a first diagnosis that
    skips much, and no refinement; a call without it does both. No other call works in the
    folder meanwhile.
    """
    campaign = read_with(campaign_path, options.component, options.tell, options.exclude)
    if options.effects is not None:
        catalogue_with(
            options.effects
        )  # an unusable file is reported before the work, not after it
    with working_in(folder):
        if (folder / "export").exists():  # what cannot be a folder is reported before the work
            make_folder(folder / "export")
        remove_leftovers(folder)
        remove_leftovers(folder / "export")
        run = PipelineRun(campaign, folder, options, digests(campaign))
        if options.quick and has_whole_diagnosis(run):
            # The existing result is more than a quick diagnosis.
            run.options = replace(options, quick=False)
        run.notices += [*campaign.notices, *campaign.rig.notices]
        done = []
        for stage in stages_of(run):
            options.entered(stage.name)
            done.append(perform(run, stage))
        stages = tuple(done)
        bundle = read_bundle(folder / BUNDLE_FILE)
        found = run.diagnosis()
        diagnosis = found if found and "verdict" in found else None
        skipped = "" if found is None else found.get("skipped", "")
        notices = tuple(dict.fromkeys(run.notices))
        unasked = tuple(dict.fromkeys(run.unasked))
        return RunReport(folder, stages, bundle, notices, diagnosis, unasked, skipped, run.advice())
