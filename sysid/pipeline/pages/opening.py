"""The report's first sentence and its small table: how well the model follows the rig."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.blocks.numbers import number, percent, span
from sysid.blocks.quality import quality_name
from sysid.blocks.sections import Said
from sysid.blocks.tables import Table, table
from sysid.blocks.titles import within
from sysid.diagnosis.lack_of_fit import MISFIT
from sysid.diagnosis.wording import (
    floor_text,
    is_of_actuator,
    joined,
    judged_tests,
    own_of,
    sentence,
)
from sysid.io.channels import VELOCITY_CHANNELS, Channel, channel_of
from sysid.io.motion import LINEAR, ROTARY
from sysid.io.own_channels import Own, channel_in, error_unit
from sysid.parameters import Bundle, ComponentRecord
from sysid.parameters.base import read_number
from sysid.parameters.table import in_words
from sysid.parameters.titles import title_of
from sysid.pipeline.pages import concerns
from sysid.pipeline.pages.concerns import Concern, level_of_fit
from sysid.validation.results import Errors
from sysid.validation.shown_tests import MODEL_NAMES, recommended_models, shown_channels

if TYPE_CHECKING:
    from sysid.validation import ChannelResult, LogResult, ValidationResult


# What moves, and what moves it.
_TOLD = {*VELOCITY_CHANNELS, *(units.effort_channel for units in (ROTARY, LINEAR))}
# A refinement that raises a held-out error by less than this is told by its table alone.
_WORSE = 1.01


@dataclass(frozen=True)
class ReportVerdict:
    """`level` ("good", "fair", "poor" or "none") is that of the worst of what is below.

    `sentence` says how well the model follows the rig, `notes` are reservations. `diagnosis` is
    its verdict in one sentence, `refined` what a refinement made worse, `following` what to do
    next, `held_back` what makes the level worse than the sentence, else empty. `concerns` are all
    findings from which the level was chosen.
    """

    level: str
    sentence: str
    table: Table | None
    notes: tuple[str, ...] = ()
    diagnosis: str = ""
    refined: str = ""
    following: str = ""
    held_back: str = ""
    concerns: tuple[Concern, ...] = ()


@dataclass(frozen=True)
class _Pooled:
    """One channel over the judged logs, in shown units of the residual."""

    channel: Channel
    rmse: float
    rmse_second: float | None
    largest: float
    fit: float | None
    noise: float


def verdict(
    bundle: Bundle,
    validation: ValidationResult | None,
    diagnosis: Mapping[str, Any] | None = None,
    own: Own = MappingProxyType({}),
) -> ReportVerdict:
    """Judged on the held-out logs; without any, on the training logs, which the text states.

    `own`: the units by name of the columns of a user's own component.
    """
    judged = replace(_validated(bundle, validation, own), refined=worsened(bundle))
    if diagnosis is not None and "verdict" in diagnosis:
        said = sentence(diagnosis, _titles(diagnosis))
        judged = replace(judged, diagnosis=said)
        if not is_of_actuator(diagnosis) and validation is None:
            followed = _part_followed(diagnosis)
            alone = _ALONE.format(tests=judged_tests(diagnosis))
            if followed:
                judged = replace(judged, sentence=followed, notes=(*judged.notes, alone))
            else:
                judged = replace(judged, sentence=said, diagnosis=alone)
    asked = _asked(diagnosis)
    missing = [name for name, _ in unidentified(bundle) if asked is None or _last(name) in asked]
    found = (
        *judged.concerns,
        *concerns.of_bundle(bundle, missing),
        *concerns.of_diagnosis(diagnosis),
    )
    level = concerns.worst((judged.level, *(c.level for c in found)))
    held_back = concerns.sentence(level, found, judged.level)
    return replace(judged, level=level, concerns=found, held_back=held_back)


def _asked(diagnosis: Mapping[str, Any] | None) -> Collection[str] | None:
    """The parameters that the tests of a part alone are for; None where all are asked for."""
    found: Collection[str] | None = (diagnosis or {}).get("figures", {}).get("law")
    return found


def _last(name: str) -> str:
    return name.rpartition(".")[2]


def _titles(diagnosis: Mapping[str, Any]) -> Mapping[str, str]:
    titles: Mapping[str, str] = diagnosis.get("figures", {}).get("titles", {})
    return titles


_ALONE = (
    "The part was tested alone: its law was fitted to its own tests and judged on {tests}; there "
    "is no actuator whose motion it could be compared with."
)


def _part_followed(diagnosis: Mapping[str, Any]) -> str:
    """How well the law of a part follows its held-out tests; empty where none is drawn."""
    figures = diagnosis.get("figures", {})
    errors = diagnosis["residual"].get(figures.get("channel"))
    tests = figures.get("tests") or ()
    if figures.get("use") != "holdout" or not tests or errors is None:
        return ""
    drawn = [[np.array(test[key], dtype=float) for key in ("measured", "after")] for test in tests]
    fit = Errors.pooled([Errors.of(m, m - after) for m, after in drawn]).fit_percentage
    if fit is None:
        return ""
    channel = channel_in(figures["channel"], own_of(diagnosis))
    unit, scale = error_unit(channel, is_alone=True)
    rmse, floor = (scale * errors[key] for key in ("after", "noise_floor"))
    how = {"good": "follows its held-out tests well", "fair": "follows its held-out tests roughly",
           "poor": "does not follow its held-out tests"}[level_of_fit(fit)]  # fmt: skip
    said = (
        f"The part, tested alone, {how}: {channel.name} to {percent(fit)}, with an RMSE of "
        f"{number(rmse)} {unit}"
    )
    if not floor:
        return f"{said}."
    correct = f"{floor_text(floor, rmse)} {unit}"
    if rmse > MISFIT * floor:
        return f"{said}, which is {rmse / floor:.0f} times what a correct model leaves ({correct})."
    return f"{said} (a correct model: {correct})."


def own_verdict(
    part: ComponentRecord, validation: ValidationResult, own: Own = MappingProxyType({})
) -> ReportVerdict:
    """On a component of the user's own: by the output that is followed worst."""
    held = validation.select("holdout")
    logs = held or validation.logs
    fits = {}
    for name in dict.fromkeys(n for log in logs for n in log.channels):
        fit = Errors.pooled([log.channels[name].errors for log in logs]).fit_percentage
        if fit is not None:
            fits[name] = fit
    if not fits:
        return ReportVerdict("none", "No output of the component varies in the tests.", None)
    worst = min(fits, key=lambda name: fits[name])
    level = level_of_fit(fits[worst])
    how = {"good": "follows", "fair": "roughly follows", "poor": "does not follow"}[level]
    basis = "the held-out tests" if held else "its training tests (none is held out)"
    more = ", its worst output" if len(fits) > 1 else ""
    said = f"The component {part.name} {how} {basis}, open loop: fit {percent(fits[worst])} in "
    return ReportVerdict(level, f"{said}{channel_in(worst, own).name}{more}.", None)


def _validated(bundle: Bundle, validation: ValidationResult | None, own: Own) -> ReportVerdict:
    notes = (*_doubtful(bundle), *_unidentified(bundle))
    if bundle.component is not None and validation is not None:
        return replace(own_verdict(bundle.component, validation, own), notes=notes)
    if validation is None:
        parts = [
            n
            for k, n in (
                ("friction", "friction"),
                ("valves", "the valves"),
                ("component", "the component"),
            )
            if k in bundle.given()
        ]
        said = (
            f"Parameters of {' and '.join(parts) or 'nothing'} were identified{_own_fits(bundle)}; "
            "whether the model follows the rig's motion was not tested."
        )
        return ReportVerdict("none", said, None, notes)
    held = validation.select("holdout")
    logs = _primary(held or validation.logs)
    present = {name for log in logs for name in log.channels}
    pooled = [_pool(logs, c) for c in shown_channels(validation) if c.key in present]
    if not pooled:
        return ReportVerdict("none", "No motion log could be simulated.", None, notes)
    level = _level(pooled)
    tests = sum(len(log.tests) for log in logs)
    basis = f"{tests} {'held-out ' if held else ''}test{'s' * (tests != 1)}" + (
        "" if held else " (all used for training: none is held out)"
    )
    said = f"{_opening(level)} on {basis}, simulated open loop, {_figures(pooled)}."
    models = sorted({MODEL_NAMES[log.model] for log in logs})
    best = recommended_models(validation)[1:]
    said_of_others, found = _other_models(held or validation.logs, logs, best)
    notes = (*said_of_others, *notes)
    return ReportVerdict(level, said, _table(pooled, models, bundle), notes, concerns=found)


def _own_fits(bundle: Bundle) -> str:
    """How well the laws that are recommended follow their own tests, in a few words."""
    against = concerns.advised_against(bundle)
    own = [one for place, one in bundle.qualities().items() if place not in against]
    said = " or ".join(dict.fromkeys(one.verdict.partition(":")[0] for one in own))
    shares = [100.0 * one.rmse_share for one in own if one.rmse_share is not None]
    if not said or not shares:
        return f", their fits to their own tests are {said}" if said else ""
    ends = [number(f(shares), 2) for f in (min, max)]
    size = ends[0] if ends[0] == ends[1] else span(min(shares), max(shares), 2)
    return f", their fits to their own tests are {said} (errors of {size} % of the spread)"


def _primary(logs: Sequence[LogResult]) -> list[LogResult]:
    """Each log once, under the first valve model that simulated it."""
    order = list(MODEL_NAMES)
    chosen: dict[tuple[str, str], LogResult] = {}
    for log in sorted(logs, key=lambda g: order.index(g.model)):
        chosen.setdefault((log.name, log.kind), log)
    return list(chosen.values())


def _pool(logs: Sequence[LogResult], channel: Channel) -> _Pooled:
    parts = [log.channels[channel.key] for log in logs if channel.key in log.channels]
    errors = Errors.pooled([p.errors for p in parts])
    scale = channel.residual_scale
    return _Pooled(
        channel=channel,
        rmse=scale * errors.rmse,
        rmse_second=channel.residual(_second(parts)),
        largest=scale * errors.largest,
        fit=errors.fit_percentage,
        noise=scale * sum(p.noise_floor * p.errors.samples for p in parts) / errors.samples,
    )


def _second(parts: Sequence[ChannelResult]) -> float | None:
    """RMSE over the longest horizon below the whole log (1 s), over all segments."""
    known = [p.horizons[-1] for p in parts if p.horizons and p.horizons[-1].rmse is not None]
    segments = sum(h.segments for h in known)
    if not segments:
        return None
    return math.sqrt(sum(h.segments * (h.rmse or 0.0) ** 2 for h in known) / segments)


def _level(pooled: Sequence[_Pooled]) -> str:
    fits = [p.fit for p in pooled if p.fit is not None]
    if not fits:
        return "none"
    return level_of_fit(min(fits))


def _opening(level: str) -> str:
    return {
        "good": "The model follows this rig well:",
        "fair": "The model follows this rig roughly:",
        "poor": "The model does not follow this rig:",
        "none": "The rig did not move:",
    }[level]


def _figures(pooled: Sequence[_Pooled]) -> str:
    """The fit percentage of each channel over whole tests."""
    said = [f"{p.channel.name} to {percent(p.fit)}" for p in pooled]
    return f"it fits {', '.join(said[:-1])}{' and ' if len(said) > 1 else ''}{said[-1]}"


def _table(pooled: Sequence[_Pooled], models: Sequence[str], bundle: Bundle) -> Table:
    rows = [
        (
            f"{p.channel.title} ({p.channel.residual_unit})",
            number(p.rmse_second),
            number(p.rmse),
            number(p.largest),
            percent(p.fit),
            number(p.noise),
        )
        for p in pooled
    ]
    columns = (
        "Channel", "RMSE over 1 s", "RMSE, whole tests", "Largest error", "Fit, whole tests",
        "Sensor noise",
    )  # fmt: skip
    valves = "" if bundle.rig.is_motor_alone else f", valves by the {' and the '.join(models)}"
    return table(f"Open loop{valves}", columns, rows)


def _other_models(
    logs: Sequence[LogResult], primary: Sequence[LogResult], recommended: Sequence[str]
) -> tuple[tuple[str, ...], tuple[Concern, ...]]:
    """Which model of the valves' mean flow to use, by the position's fit on the logs under PWM.

    The concern is on that one alone: a model that is not recommended limits nothing.
    """
    found: dict[str, tuple[_Pooled, _Pooled, str]] = {}
    for model, name in MODEL_NAMES.items():
        own = [g for g in logs if g.model == model and not any(g is p for p in primary)]
        channels = [c for g in own for c in g.channels]
        if not own or not channels:
            continue
        files = {(g.name, g.kind) for g in own}
        base = [g for g in primary if (g.name, g.kind) in files]
        channel = next((channel_of(k) for k in VELOCITY_CHANNELS if k in channels), None)
        if channel is None or not base:
            continue
        pooled = _pool(own, channel), _pool(base, channel)
        found[name] = (*pooled, MODEL_NAMES[base[0].model])
    best = next((MODEL_NAMES[m] for m in recommended if MODEL_NAMES[m] in found), None)
    if best is None:
        return (), ()
    there, here, usual = found[best]
    others = [f"{name} {percent(found[name][0].fit)}" for name in found if name != best]
    said = (
        f"For the valves' mean flow under PWM use the {best}: position fits to "
        f"{percent(there.fit)} on the tests under PWM ({'; '.join([*others, ''])}"
        f"{usual}, pulse by pulse, {percent(here.fit)})."
    )
    level = "none" if there.fit is None else level_of_fit(there.fit)
    return (said,), (Concern(level, f"the position under PWM with the {best}"),)


def worsened(bundle: Bundle) -> str:
    """What the refinement made worse on held-out tests, with what to do; empty where it did not.

    The position's error, and where a motor alone drives that of the equation of motion.
    """
    part = bundle.refinement
    if part is None:
        return ""
    for errors in (part.errors(), part.effort_errors()):
        for name, found in errors.get("holdout", {}).items():
            before, after = read_number(found.before), read_number(found.after)
            if name not in _TOLD or not before or after is None or after < _WORSE * before:
                continue
            channel = channel_of(name)
            sizes = span(channel.residual(before), channel.residual(after), 3)
            return (
                f"It made the held-out {channel.name} worse: RMSE from {sizes} "
                f"{channel.residual_unit}. The numbers before it follow held-out tests better; "
                "where the training tests gained, they make up for something that the model lacks."
            )
    return ""


def position_rmse(validation: ValidationResult | None) -> float | None:
    """Open-loop RMSE of an actuator's position over whole held-out tests, rad or m; None without
    any."""
    logs = [] if validation is None else validation.select("holdout")
    held = _primary([log for log in logs if log.model in MODEL_NAMES])
    present = {name for log in held for name in log.channels}
    for key in VELOCITY_CHANNELS:
        if key in present:
            channel = channel_of(key)
            return _pool(held, channel).rmse / channel.residual_scale
    return None


def _doubtful(bundle: Bundle) -> Iterator[str]:
    """One line per fit that does not follow its own tests, or is impossible."""
    left_out = concerns.advised_against(bundle)
    for place, one in bundle.qualities().items():
        if one.is_doubtful and place not in left_out:
            yield f"{quality_name(place)}: {one.verdict}"


def _unidentified(bundle: Bundle) -> Iterator[str]:
    """What the data do not identify of the bundle, a line a reason, except for a tank."""
    if bundle.rig.is_tank_alone:
        return
    found: dict[str, list[str]] = {}
    for name, reason in unidentified(bundle):
        found.setdefault(reason, []).append(name)
    for reason, names in found.items():
        first, *more = map(title_of, names)
        said = f"Not identified: {joined([first, *map(within, more)])}: {in_words(reason)}"
        yield Said(said, *names)


def unidentified(bundle: Bundle) -> Iterator[tuple[str, str]]:
    """The parameters of the bundle that the data do not identify, and why.

    What the cross-check of another kind of test lacks, no model lacks.
    """
    asked = bundle.parameters.where(
        lambda row: (
            row.origin in ("friction", "valve") and not row.path.startswith("friction.cross_check")
        )
    )
    yield from asked.unidentified()
