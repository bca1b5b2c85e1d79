"""The page: sections put together, and the template filled in."""

from __future__ import annotations

import datetime
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any

from sysid.blocks.sections import Block, FigureGroup, Fold, Plot, Said, Section
from sysid.blocks.standing import section_or_why
from sysid.blocks.tables import Table, table
from sysid.diagnosis.wording import effect_name, is_of_actuator
from sysid.errors import Failure, input_error, on_its_own
from sysid.io.campaign import FRICTION_KINDS, MOTION_KINDS
from sysid.parameters import Bundle, Provenance, assumptions, shown_by_logs
from sysid.parameters.provenance import family
from sysid.pipeline.pages.concerns import advised_against
from sysid.pipeline.pages.held_out import first_picture
from sysid.pipeline.pages.next_steps import next_line, unfinished
from sysid.pipeline.pages.notices import (
    by_section,
    excluded_lines,
    notices_in,
    with_notices,
)
from sysid.pipeline.pages.opening import ReportVerdict, position_rmse, verdict
from sysid.types import Progress

if TYPE_CHECKING:
    from sysid.checks.log_check import LogCheck
    from sysid.identification.valve_pwm.frequency import CampaignTests
    from sysid.io.campaign import Campaign
    from sysid.io.logs import Log
    from sysid.validation import ValidationResult


_NOT_DIAGNOSED = "the model was not diagnosed (run sysid diagnose)"
_NOT_GIVEN = (
    "the model was diagnosed, but its diagnosis was not given (sysid validate --diagnosis shows it)"
)
_NOT_REFINED = "the parameters were not refined on motion tests (run sysid refine)"


def render_report(
    *,
    campaign: Campaign,
    bundle: Bundle,
    validation: ValidationResult | None = None,
    checks: Sequence[LogCheck] = (),
    diagnosis: Mapping[str, Any] | None = None,
    advice: Mapping[str, Any] | None = None,
    notices: Sequence[str] = (),
    progress: Progress | None = None,
) -> str:
    """The report of a campaign: the text of one self-contained HTML file.

    Curves are computed anew from the campaign's fit logs and the bundle, so that a later
    process can rebuild the report; `validation` and `checks` are what `sysid.validation` and
    `sysid.checks.log_check` found, `diagnosis` what `sysid.diagnosis.content.content` made of one,
    `advice` an `AdviceResult.to_json`. `notices` are the fit's: each stands where its number does.
    Sections whose part is missing are omitted, and the page says so; one that cannot be made says
    why. Raises InputError for the bundle of a linear rig with a rotary one's campaign, or the
    reverse.
    """
    tell = progress or (lambda line: None)
    _check_units(campaign, bundle)
    from sysid.blocks import svg

    with svg.styled():
        moves = cache(partial(_moves, campaign, bundle, validation))
        parts = report_parts(campaign, bundle, validation, diagnosis, advice, moves)
        sections, left_out = _sections(campaign, bundle, checks, parts, tell)
    said = by_section(notices, campaign, {section.id for section in sections})
    is_first = not (bundle.refinement or bundle.effects)
    read = notices_in(sections)  # what the readers say of the logs is not said again
    sections = [
        with_notices(
            section,
            [line for line in said.get(section.id, ()) if line not in read],
            is_first=is_first,
        )
        for section in sections
    ]
    tell("assembling the page")
    judged = _judged(campaign, bundle, validation, diagnosis)
    off = position_rmse(validation)
    following = on_its_own(partial(next_line, bundle, diagnosis, advice, moves, off))
    said_next = ("" if isinstance(following, Failure) else following) or unfinished(
        bundle, diagnosis, is_validated=validation is not None
    )
    own_notes = [note for note in judged.notes if not _says_as_much(said_next, note)]
    judged = replace(
        judged,
        notes=(*_other_rig(campaign, bundle), *own_notes, *excluded_lines(campaign)),
        following=said_next,
    )
    picture = on_its_own(partial(first_picture, validation, diagnosis, campaign.rig.is_linear))
    shown = None if isinstance(picture, Failure) else picture
    return _fill(campaign, bundle, judged, shown, sections, left_out)


def _says_as_much(following: str, note: str) -> bool:
    """Whether what to do next names the one number that a note says is not identified."""
    about = following.about if isinstance(following, Said) else ()
    return bool(about) and isinstance(note, Said) and note.about == about


def _judged(
    campaign: Campaign,
    bundle: Bundle,
    validation: ValidationResult | None,
    diagnosis: Mapping[str, Any] | None,
) -> ReportVerdict:
    """The verdict; where it cannot be worked out, one that says why."""
    own = {} if campaign.own is None else campaign.own.columns
    judged = on_its_own(partial(verdict, bundle, validation, diagnosis, own))
    if not isinstance(judged, Failure):
        return judged
    return ReportVerdict("none", f"No verdict could be reached: {judged.reason}.", None)


def _moves(
    campaign: Campaign, bundle: Bundle, validation: ValidationResult | None
) -> Mapping[str, float]:
    """What the errors of the numbers do to the simulated position; empty where it is not known."""
    if validation is None:
        return {}
    from sysid.refinement.motion_errors import position_errors  # loads jax

    found = on_its_own(partial(position_errors, campaign, bundle))
    return {} if isinstance(found, Failure) else found


def _check_units(campaign: Campaign, bundle: Bundle) -> None:
    """The page's units are those of the campaign's rig; the bundle's numbers have to have them."""
    if bundle.is_linear != campaign.rig.is_linear:
        kinds = [bundle.units.motion, bundle.units.other.motion]
        raise input_error(
            campaign.path,
            f"is of a {kinds[1]} rig, {bundle.source} of a {kinds[0]} one",
            "give the bundle that was fitted on this rig",
        )


def _other_rig(campaign: Campaign, bundle: Bundle) -> Iterator[str]:
    other = bundle.other_sections(campaign.rig)
    if other:
        sections = ", ".join(f"[{section}]" for section in other)
        yield (
            f"The bundle was fitted with another rig file than this campaign's: {sections} differ."
        )


ReportPart = tuple[str, str, str, Callable[[], Section | None]]


def _sections(
    campaign: Campaign,
    bundle: Bundle,
    checks: Sequence[LogCheck],
    parts: Sequence[ReportPart],
    tell: Progress,
) -> tuple[list[Section], list[str]]:
    """The sections with content, and a line for each that is omitted."""
    from sysid.checks.shown import quality_section
    from sysid.parameters.shown_fits import fits_section
    from sysid.pipeline.pages.provenance import provenance_section

    against = advised_against(bundle)
    told: list[ReportPart] = [
        ("data", "Data and their quality", "", lambda: quality_section(campaign, checks)),
        ("fits", "How well the laws follow their tests", "", lambda: fits_section(bundle, against)),
        *parts,
        ("provenance", "Provenance", "", lambda: provenance_section(bundle)),
    ]
    sections: list[Section] = []
    left_out: list[str] = []
    for id, title, lacks, build in told:
        section = section_or_why(id, title, partial(_written, build))
        if section is not None:
            tell(f"drawn: {title}")
            sections.append(section)
        elif lacks:
            left_out.append(f"{title}: {lacks}.")
    return sections, left_out


def _written(build: Callable[[], Section | None]) -> Section | None:
    """A section whose plots' numbers can be written into the page."""
    built = build()
    for plot in [] if built is None else _plots(built.blocks):
        _json(plot.document)
        _json(plot.samples)
    return built


def report_parts(
    campaign: Campaign,
    bundle: Bundle,
    validation: ValidationResult | None = None,
    diagnosis: Mapping[str, Any] | None = None,
    advice: Mapping[str, Any] | None = None,
    moved_by: Callable[[], Mapping[str, float]] = dict,
) -> list[ReportPart]:
    """Each section's id, title, the line if it is missing ("": none), and its builder."""

    def friction() -> Section | None:
        from sysid.identification.friction.shown import friction_section

        return None if bundle.friction is None else friction_section(bundle)

    def discrete() -> Section | None:
        if bundle.valves is None:
            return None
        from sysid.identification.valve_discrete.shown import discrete_section

        return discrete_section(bundle, _logs(campaign, "valve-discrete"), campaign.rig)

    @cache
    def pwm_tests() -> list[CampaignTests]:
        from sysid.pipeline.pwm_frequency import campaign_tests

        return campaign_tests(campaign)

    def surfaces() -> Section | None:
        if bundle.valves is None:
            return None
        from sysid.identification.valve_pwm.frequency import at_the_rigs_period
        from sysid.identification.valve_pwm.shown import surfaces_section

        logs = [(one.valve, one.log) for one in at_the_rigs_period(pwm_tests(), campaign.rig)]
        return surfaces_section(bundle.valves, logs, campaign.rig)

    def frequencies() -> Section | None:
        if not campaign.select(("valve-pwm",)):
            return None
        from sysid.pipeline.pwm_frequency import campaign_section

        return campaign_section(pwm_tests(), campaign.rig)

    def diagnosed() -> Section | None:
        from sysid.diagnosis.shown import diagnosis_section

        if diagnosis is None or "verdict" not in diagnosis:
            return None
        return diagnosis_section(diagnosis, campaign.rig.is_linear)

    def part_alone() -> Section | None:
        from sysid.diagnosis.shown_part import fitted_axis, part_section

        shown = (diagnosis or {}).get("figures", {}).get("tests")
        content = diagnosis if shown else fitted_axis(campaign, bundle)
        if content is None:
            return None
        return part_section(content, campaign.rig.is_linear, is_alone=bool(shown))

    def next_steps() -> Section | None:
        from sysid.pipeline.pages.next_steps import next_section

        off = position_rmse(validation)
        return next_section(bundle, diagnosis, campaign.path.name, advice, moved_by, off)

    def own() -> Section | None:
        from sysid.validation.shown_own import own_section

        part = bundle.component
        return None if part is None else own_section(part, campaign, validation)

    def motion() -> Section | None:
        from sysid.pipeline.pages.motion import validation_section

        return None if validation is None else validation_section(validation, diagnosis)

    def residuals() -> Section | None:
        from sysid.validation.shown_residuals import residuals_section

        return None if validation is None else residuals_section(validation)

    def refined() -> Section | None:
        from sysid.refinement.shown import refinement_section

        part = bundle.refinement
        return None if part is None else refinement_section(part, campaign.rig)

    lacking = _NOT_GIVEN if "diagnosis" in bundle.provenance.options else _NOT_DIAGNOSED
    skipped = (diagnosis or {}).get("skipped", lacking).removeprefix("diagnosis: ")
    diagnosed_part = ("diagnosis", "Diagnosis", skipped, diagnosed)
    following = ("next", "What to do next", "", next_steps)  # the first screen says it too
    if bundle.component is not None:
        return [
            ("component", "Component", "no component was fitted", own),
            diagnosed_part,
            following,
        ]
    # A part tested alone is not missing what only a whole actuator has.
    rig = campaign.rig
    moves = is_of_actuator(diagnosis) or rig.is_motor_alone
    switches = is_of_actuator(diagnosis) and not rig.is_motor_alone
    no_friction = f"no friction was fitted (tests: {', '.join(FRICTION_KINDS)})"
    no_law = "no on/off law was fitted (tests: valve-discrete)"
    no_surface = "no surface was fitted (tests: valve-pwm)"
    not_validated = f"the model was not validated (motion logs: {', '.join(MOTION_KINDS)})"
    return [
        ("friction", "Friction", "" if rig.is_tank_alone else no_friction, friction),
        ("valves", "On/off valves", no_law if switches else "", discrete),
        ("surfaces", "PWM surfaces", no_surface if switches else "", surfaces),
        ("pwm-frequency", "PWM frequency", "", frequencies),  # of logs at several
        ("validation", "Open-loop validation", not_validated if moves else "", motion),
        ("residuals", "Residuals", "", residuals),  # missing where the validation is
        ("part", "Measured and modelled", "", part_alone),
        diagnosed_part,
        ("refinement", "Refinement on motion", _NOT_REFINED if moves else "", refined),
        following,
    ]


def _logs(campaign: Campaign, kind: str) -> list[tuple[str | None, Log]]:
    """The training logs of a kind, each with its declared valve."""
    return [(entry.valve, campaign.read(entry)) for entry in campaign.select((kind,))]


# --- the template ----------------------------------------------------------------------


def _what_rig(campaign: Campaign, bundle: Bundle) -> str:
    """What the rig is; of a component of the user's own how it moves is not known."""
    rig = campaign.rig
    if bundle.component is not None:
        return f"component, {bundle.component.kind}"
    return "tank" if rig.is_tank_alone else f"{rig.orientation}, {rig.motion}"


def _fill(
    campaign: Campaign,
    bundle: Bundle,
    judged: ReportVerdict,
    picture: FigureGroup | None,
    sections: Sequence[Section],
    left_out: Sequence[str],
) -> str:
    from markupsafe import Markup

    from sysid.blocks.html import fill, origin_text, template_text
    from sysid.blocks.standing import drawn
    from sysid.pipeline.pages.interactive import bokeh_script

    plots = [block for section in sections for block in _plots(section.blocks)]
    documents, data = _plot_data(plots)
    rig = campaign.rig
    return fill(
        "report.html",
        rig=rig,
        campaign=campaign.path.name,
        given="Campaign" if campaign.path.suffix == ".toml" else "Log",
        orientation=_what_rig(campaign, bundle),
        fitted=_moment(bundle.created),
        model=held_parts(bundle),
        verdict=judged,
        picture=None if picture is None else drawn((picture,))[0],
        assumed=_assumed(bundle),
        shown=shown_by_logs(bundle),
        origin=origin_text(_own_provenance(campaign, bundle).fitted_on),
        sections=sections,
        left_out=left_out,
        documents=documents,
        plot_section=next((s.id for s in sections if _plots(s.blocks)), ""),
        data=[(id, Markup(_json(content))) for id, content in data],
        script=Markup(template_text("report.js")),
        bokeh=Markup(bokeh_script()) if plots else "",
    )


def held_parts(bundle: Bundle) -> str:
    """What the model is made of, and from how many logs it was fitted."""
    sides = {} if bundle.valves is None else dict(sorted(bundle.valves.sides().items()))
    parts = [
        *(["friction"] if bundle.friction is not None else []),
        *(f"valve {s.upper()} on/off" for s, v in sides.items() if v.discrete is not None),
        *(f"valve {s.upper()} under PWM" for s, v in sides.items() if v.pwm is not None),
        *([] if bundle.component is None else [bundle.component.name]),
        *_effects(bundle),
    ]
    logs = bundle.provenance.logs
    training = sum(log.use != "holdout" for log in logs)
    of = f"fitted to {training} log{'s' * (training != 1)}"
    held = len(logs) - training
    judged = f"{held} more {'is' if held == 1 else 'are'} held out" if held else "none is held out"
    return f"{', '.join(parts) or 'none'}; {of}, {judged}"


def _effects(bundle: Bundle) -> list[str]:
    if not bundle.effects:
        return []
    from sysid.plant.effects.catalogue import catalogue
    from sysid.plant.effects.linear import for_rig

    titles = {id: one.title for id, one in for_rig(catalogue(), bundle.is_linear).items()}
    return [effect_name(one.id, titles) for one in bundle.effects]


def _assumed(bundle: Bundle) -> Table | None:
    """The constants that were assumed, and their influence on the numbers; None without any."""
    rows = [(one.text, one.does) for one in assumptions(bundle)]
    if not rows:
        return None
    return table("Assumed constants", ("Reference rig", "What it does"), rows, text=(0, 1))


def _own_provenance(campaign: Campaign, bundle: Bundle) -> Provenance:
    """The bundle's, of the campaign's logs alone: it may hold other parts too."""
    own = {(entry.path.name, family(entry.kind)) for entry in campaign.logs}
    whole = bundle.provenance
    return whole.replaced(logs=[log for log in whole.logs if (log.file, log.family) in own])


def _moment(text: str) -> str:
    """An ISO time to the minute, UTC; any other text unchanged."""
    from sysid.blocks.html import moment

    try:
        return moment(datetime.datetime.fromisoformat(text))
    except ValueError:
        return text


def _plots(blocks: Sequence[Block]) -> list[Plot]:
    found: list[Plot] = []
    for block in blocks:
        if isinstance(block, Plot):
            found.append(block)
        elif isinstance(block, Fold):
            found += _plots(block.blocks)
    return found


def _plot_data(plots: Sequence[Plot]) -> tuple[dict[str, str], list[tuple[str, Any]]]:
    """The id of each plot's document, and all data that the script reads, by id."""
    shared: list[dict[str, Any]] = []
    documents: dict[str, str] = {}
    data: list[tuple[str, Any]] = []
    for plot in plots:
        if not any(plot.document is known for known in shared):
            shared.append(plot.document)
            data.append((f"document-{len(shared)}", plot.document))
        place = next(i for i, known in enumerate(shared, 1) if known is plot.document)
        documents[plot.id] = f"document-{place}"
        data.append((f"{plot.id}-samples", plot.samples))
    return documents, data


def _json(item: Mapping[str, Any]) -> str:
    """JSON that is safe inside a script element: no tag can begin or end in it."""
    text = json.dumps(item, separators=(",", ":"), allow_nan=False)
    for sign in "<>&\u2028\u2029":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return text


__all__ = ["ReportPart", "held_parts", "render_report", "report_parts"]
