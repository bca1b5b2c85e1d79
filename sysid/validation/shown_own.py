"""A component of the user's own: its numbers, and its outputs as measured and as modelled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from sysid.blocks.figures import Figure, Line, Panel, Rule, Scale
from sysid.blocks.numbers import estimate_cells, number
from sysid.blocks.sections import Block, FigureGroup, Section
from sysid.blocks.tables import NotedCell, table
from sysid.blocks.titles import capital, use_word, words_of
from sysid.io.campaign import Campaign
from sysid.io.channels import Channel
from sysid.io.own_channels import channel_in, error_unit
from sysid.parameters import ComponentRecord
from sysid.parameters.table import title_of_field
from sysid.validation.results import TestResult, ValidationResult


def own_section(
    part: ComponentRecord, campaign: Campaign, validation: ValidationResult | None
) -> Section:
    """Its parameters; with a validation also the errors and the curves of held-out tests."""
    units = {} if campaign.own is None else campaign.own.columns
    blocks: list[Block] = [_parameters(part)]
    where = f"class {part.name} of {part.file}" if part.file else f"class {part.name}"
    intro = [
        f"The law is the user's own: {where}, for logs of kind {part.kind}. Its parameters were "
        "estimated by least squares of its outputs; each interval allows for correlated residuals."
    ]
    if validation is not None:
        blocks.append(_errors(validation, units))
        tests = _shown(validation)
        used = use_word(tests[0].use, before_noun=True)
        blocks += [_group(channel_in(name, units), tests, used) for name in tests[0].measured]
        intro.append("Every test is modelled as a whole, open loop, from its own measured start.")
    return Section("component", "Component of the user's own", tuple(intro), tuple(blocks))


def _parameters(part: ComponentRecord) -> Block:
    rows = []
    for name, estimate in part.parameters.items():
        value, _, interval, unit = estimate_cells(estimate)
        title = title_of_field(name) or capital(words_of(name, estimate.unit))
        rows.append((NotedCell(title, "" if title == name else name), value, interval, unit))
    return table("Parameters", ("Parameter", "Value", "95 % interval", "Unit"), rows, text=(3,))


def _errors(validation: ValidationResult, units: Mapping[str, str]) -> Block:
    errors = [(log, *one) for log in validation.logs for one in log.channels.items()]
    rows = []
    for log, name, channel in errors:
        shown = channel_in(name, units)
        unit, scale = error_unit(shown, is_alone=True)
        rows.append(
            (
                log.name,
                use_word(log.use),
                NotedCell(shown.title, plain=name),
                number(scale * channel.errors.rmse),
                number(channel.errors.fit_percentage),
                number(scale * channel.noise_floor),
                unit,
            )
        )
    columns = ("Log", "Use", "Output", "RMSE", "Fit, %", "Sensor noise", "Unit")
    return table("Errors of whole tests", columns, rows, text=(1, 2, 6))


def _shown(validation: ValidationResult) -> Sequence[TestResult]:
    logs = validation.select("holdout") or validation.logs
    return [test for log in logs for test in log.tests][:4]


def _group(channel: Channel, tests: Sequence[TestResult], used: str) -> FigureGroup:
    figures = tuple(_figure(f"{channel.key}-{i}", channel, test) for i, test in enumerate(tests))
    caption = (
        f"{channel.title} over {used} tests: as measured and as modelled; below, the residual."
    )
    return FigureGroup(caption, figures)


def _figure(key: str, channel: Channel, test: TestResult) -> Figure:
    of = f"{test.log}, test {test.test}" if test.test else test.log
    name, scale = channel.key, channel.scale
    unit, finer = error_unit(channel, is_alone=True)
    left = Line(test.time, finer * test.residual(name), "second", width=0.8)
    time = Scale("Time", "s")
    curves = (replace(curve, y=scale * curve.y) for curve in test.curves(name, "modelled"))
    panels = (
        Panel(time, Scale(channel.title, channel.unit), tuple(curves), 2.0, legend="above"),
        Panel(time, Scale("Residual", unit), (left, Rule(0.0)), legend="none"),
    )
    rmse = f"{number(finer * test.channels[name].errors.rmse)} {unit}".rstrip()
    description = f"{channel.title} of {of}, as measured and as modelled: RMSE {rmse}."
    title, heading = f"{channel.title}, measured and modelled", f"{channel.title}: {of}"
    return Figure(f"fig-own-{key}", title, description, panels, heading)


__all__ = ["own_section"]
