"""A component of the user's own: its numbers, and its outputs as measured and as modelled."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from sysid.blocks.figures import Picture
from sysid.blocks.numbers import number
from sysid.blocks.sections import Block, FigureGroup, Section
from sysid.blocks.tables import table
from sysid.document import svg
from sysid.document.svg import COLOUR
from sysid.parameters import ComponentRecord

if TYPE_CHECKING:
    from sysid.io.campaign import Campaign
    from sysid.validation import ValidationResult
    from sysid.validation.results import TestResult

# Tests whose curves are drawn.
_MOST_TESTS = 4


def own_section(
    part: ComponentRecord, campaign: Campaign, validation: ValidationResult | None
) -> Section:
    """Its parameters; with a validation also the errors and the curves of held-out tests.

    To be called within `sysid.document.svg.styled()`.
    """
    units = {} if campaign.own is None else campaign.own.columns
    blocks: list[Block] = [_parameters(part)]
    where = f"class {part.name} of {part.file}" if part.file else f"class {part.name}"
    intro = [
        f"The law is the user's own: {where}, for logs of kind {part.kind}. Its parameters were "
        "estimated by least squares of its outputs; each interval allows for correlated residuals."
    ]
    if validation is not None:
        blocks.append(_errors(validation))
        tests = _shown(validation)
        used = "held-out" if tests[0].use == "holdout" else "training"
        blocks += [_group(name, tests, units.get(name, ""), used) for name in tests[0].measured]
        intro.append("Every test is modelled as a whole, open loop, from its own measured start.")
    return Section("component", "Component of the user's own", tuple(intro), tuple(blocks))


def _parameters(part: ComponentRecord) -> Block:
    rows = []
    for name, estimate in part.parameters.items():
        if estimate.identified:
            low, high = estimate.interval
            numbers = (number(estimate.value), f"{number(low)} to {number(high)}", estimate.unit)
        else:
            numbers = ("not identified", estimate.reason or "", estimate.unit)
        rows.append((name, *numbers))
    return table("Parameters", ("Parameter", "Value", "95 % interval", "Unit"), rows, text=(3,))


def _errors(validation: ValidationResult) -> Block:
    rows = [
        (
            log.name,
            "held out" if log.use == "holdout" else "fit",
            name,
            number(channel.errors.rmse),
            "-" if channel.errors.fit_percentage is None else number(channel.errors.fit_percentage),
            number(channel.noise_floor),
        )
        for log in validation.logs
        for name, channel in log.channels.items()
    ]
    columns = ("Log", "Use", "Output", "RMSE", "Fit, %", "Sensor noise")
    return table("Errors of whole tests, in each output's unit", columns, rows, text=(1, 2))


def _shown(validation: ValidationResult) -> Sequence[TestResult]:
    logs = validation.select("holdout") or validation.logs
    return [test for log in logs for test in log.tests][:_MOST_TESTS]


def _group(name: str, tests: Sequence[TestResult], unit: str, used: str) -> FigureGroup:
    figures = tuple(_figure(f"{name}-{i}", name, test, unit) for i, test in enumerate(tests))
    caption = f"{name} over {used} tests: as measured and as modelled; below, what is left."
    return FigureGroup(caption, figures)


def _figure(key: str, name: str, test: TestResult, unit: str) -> Picture:
    of = f"{test.log}, test {test.test}" if test.test else test.log
    figure, (above, below) = svg.panels(f"{name}: {of}", (2.0, 1.0))
    above.plot(test.time, test.measured[name], color=COLOUR["muted"], label="measured")
    above.plot(test.time, test.simulated[name], color=COLOUR["model"], label="modelled")
    svg.legend(above)
    left = test.residual(name)
    below.plot(test.time, left, color=COLOUR["second"], linewidth=0.8)
    below.axhline(0.0, color=COLOUR["muted"], linewidth=0.7)
    shown = f" ({unit})" if unit else ""
    above.set_ylabel(f"{name}{shown}")
    below.set_ylabel("Residual")
    below.set_xlabel("Time (s)")
    rmse = number(test.channels[name].errors.rmse)
    description = f"{name} of {of}, as measured and as modelled: RMSE {rmse} {unit}".rstrip() + "."
    return svg.to_figure(figure, f"fig-own-{key}", f"{name}, measured and modelled", description)


__all__ = ["own_section"]
