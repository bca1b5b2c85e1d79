"""A component of the user's own: its numbers, and its outputs as measured and as modelled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from sysid.blocks.figures import Figure, Line, Panel, Rule, Scale
from sysid.blocks.numbers import number, prefixed, span
from sysid.blocks.numbers import unit as shown_unit
from sysid.blocks.sections import Block, FigureGroup, Section
from sysid.blocks.tables import table
from sysid.blocks.titles import use_word
from sysid.io.campaign import Campaign
from sysid.parameters import ComponentRecord
from sysid.types import FloatArray
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
        blocks += [_group(name, tests, units.get(name, ""), used) for name in tests[0].measured]
        intro.append("Every test is modelled as a whole, open loop, from its own measured start.")
    return Section("component", "Component of the user's own", tuple(intro), tuple(blocks))


def _parameters(part: ComponentRecord) -> Block:
    rows = []
    for name, estimate in part.parameters.items():
        if estimate.identified:
            low, high = estimate.interval
            numbers = (number(estimate.value), span(low, high), shown_unit(estimate.unit))
        else:
            numbers = ("not identified", estimate.reason or "", shown_unit(estimate.unit))
        rows.append((name, *numbers))
    return table("Parameters", ("Parameter", "Value", "95 % interval", "Unit"), rows, text=(3,))


def _errors(validation: ValidationResult, units: Mapping[str, str]) -> Block:
    errors = [(log, *one) for log in validation.logs for one in log.channels.items()]
    largest: dict[str, float] = {}
    for _, name, channel in errors:
        largest[name] = max(largest.get(name, 0.0), channel.errors.rmse)
    rows = []
    for log, name, channel in errors:
        unit, scale = prefixed(units.get(name, ""), largest[name])
        rows.append(
            (
                log.name,
                use_word(log.use),
                name,
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


def _group(name: str, tests: Sequence[TestResult], unit: str, used: str) -> FigureGroup:
    figures = tuple(_figure(f"{name}-{i}", name, test, unit) for i, test in enumerate(tests))
    caption = f"{name} over {used} tests: as measured and as modelled; below, the residual."
    return FigureGroup(caption, figures)


def _figure(key: str, name: str, test: TestResult, unit: str) -> Figure:
    of = f"{test.log}, test {test.test}" if test.test else test.log
    residual = test.residual(name)
    own, scale = prefixed(unit, _size(test.measured[name]))
    less, finer = prefixed(unit, _size(residual))
    left = Line(test.time, finer * residual, "second", width=0.8)
    time = Scale("Time", "s")
    curves = (replace(curve, y=scale * curve.y) for curve in test.curves(name, "modelled"))
    panels = (
        Panel(time, Scale(name, own), tuple(curves), 2.0, legend="above"),
        Panel(time, Scale("Residual", less), (left, Rule(0.0)), legend="none"),
    )
    rmse = f"{number(finer * test.channels[name].errors.rmse)} {less}".rstrip()
    description = f"{name} of {of}, as measured and as modelled: RMSE {rmse}."
    title, heading = f"{name}, measured and modelled", f"{name}: {of}"
    return Figure(f"fig-own-{key}", title, description, panels, heading)


def _size(values: FloatArray) -> float:
    return float(np.nanmax(np.abs(values), initial=0.0))


__all__ = ["own_section"]
