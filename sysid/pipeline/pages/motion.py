"""Open-loop validation: tables, static overlays (Figures 3.19, 3.20), how the error grows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.blocks import svg
from sysid.blocks.figures import TALL_PANEL, Dash, Figure, Line, Mark, Panel, Role, Scale, Span
from sysid.blocks.numbers import MISSING, number, percent
from sysid.blocks.sections import Block, FigureGroup, Fold, Lines, Plot, Section
from sysid.blocks.tables import Table, table
from sysid.blocks.titles import use_word
from sysid.diagnosis.wording import joined, own_friction
from sysid.io.channels import Channel, channel_of
from sysid.pipeline.pages.interactive import overlay_document, overlay_samples
from sysid.validation.shown_tests import (
    MODEL_NAMES,
    NOISE_BAND,
    ShownTest,
    recommended_models,
    shown_channels,
    tests_of,
    tests_to_show,
)

if TYPE_CHECKING:
    from sysid.validation import HorizonError, LogResult, ValidationResult


_GROWTH_POINTS = 40
MODEL_LINES: dict[str, tuple[Role, Dash]] = {
    "discrete": ("model", "solid"),
    "bipolynomial": ("second", "dashed"),
    "ann": ("third", "dotted"),
    "averaged": ("fourth", "dash-dot"),
}
"""How each valve model's curves are drawn."""


def validation_section(
    validation: ValidationResult, diagnosis: Mapping[str, Any] | None = None
) -> Section:
    """Every motion log, simulated from its first row given only its commands.

    Of a held-out test it says how much of the residual is its own friction, by the `diagnosis`.
    """
    trace = (diagnosis or {}).get("figures", {}).get("trace") or {}
    recommended = recommended_models(validation)
    others = [m for m in MODEL_NAMES if validation.select(model=m) and m not in recommended]
    tests = tests_of(validation)
    shown = tests_to_show(tests)
    blocks = [*_tables(validation, recommended), _growth(validation, recommended)]
    worst = [test for test in shown if test.source == trace.get("source")] or shown[:1]
    shown = [*worst, *(test for test in shown if test not in worst)]
    plots = [_plot(i, test.under(recommended), trace) for i, test in enumerate(shown)]
    blocks += plots[:1]
    if plots[1:]:
        names = "; ".join(test.source for test in shown[1:])
        count = "1 further test" if len(plots) == 2 else f"{len(plots) - 1} further tests"
        blocks.append(Fold(f"{count} drawn: {names}", tuple(plots[1:])))
    blocks += _folded(validation, recommended, others)
    if validation.notices:
        blocks.append(Lines(tuple(dict.fromkeys(validation.notices)), "Notices"))
    intro = [
        "Each test is simulated open loop from an estimated start, given only its commands: no "
        "measurement corrects the model along the way, so that errors in position accumulate. "
        "The errors over one second are of simulations restarted from the measured state. The "
        "noise is that of a single reading: the error of a correct model's position is many times "
        "it too, by what friction differs from test to test, and the diagnosis says how large.",
    ]
    if len(shown) < len(tests):
        intro.append(
            f"{len(shown)} of {len(tests)} tests {'is' if len(shown) == 1 else 'are'} drawn: those "
            "held out, and of each kind without held-out tests the one with the worst fit."
        )
    return Section("validation", "Open-loop validation", tuple(intro), tuple(blocks))


def _tables(validation: ValidationResult, models: Sequence[str]) -> list[Block]:
    """The errors of the held-out logs under these models; of the training logs without any.

    Those of the pressures are folded: the verdict's table has them for all logs.
    """
    logs = [log for log in validation.select("holdout") or validation.logs if log.model in models]
    channels = shown_channels(validation)
    shown: list[Block] = [_table(logs, c) for c in channels]
    names = joined([channel.name for channel in channels[1:]])
    return [*shown[:1], *([Fold(f"Errors of {names}", tuple(shown[1:]))] if names else [])]


def _folded(
    validation: ValidationResult, recommended: Sequence[str], others: Sequence[str]
) -> list[Block]:
    """What limits no verdict: other models of the valves' mean flow, and the training logs."""
    channels = shown_channels(validation)
    held, training = validation.select("holdout"), validation.select("fit")
    blocks: list[Block] = []
    if others:
        rows = [log for log in held or training if log.model in others]
        names = " and ".join(MODEL_NAMES[model] for model in others)
        growth = _growth(validation, others, "-others")
        inner: list[Block] = [*(_table(rows, c) for c in channels), growth]
        blocks.append(
            Fold(f"Under the valve models that are not recommended: {names}", tuple(inner))
        )
    if held and training:
        tables: tuple[Block, ...] = tuple(_table(training, c) for c in channels)
        blocks.append(Fold("Errors on the training logs", tables))
    return [*blocks, _structure_table(validation)]


def _table(logs: Sequence[LogResult], channel: Channel) -> Table:
    unit = channel.residual_unit
    rows = []
    for log in logs:
        result = log.channels.get(channel.key)
        if result is None:
            continue
        horizons = [number(channel.residual(h.rmse)) for h in result.horizons]
        rows.append(
            (
                log.name,
                use_word(log.use),
                MODEL_NAMES[log.model],
                *horizons,
                number(channel.residual(result.errors.rmse)),
                number(channel.residual(result.errors.largest)),
                percent(result.errors.fit_percentage),
                number(channel.residual(result.noise_floor)),
                number(result.ratio),
            )
        )
    names = [f"RMSE, {number(h.horizon_s, 1)}\N{NO-BREAK SPACE}s" for h in _horizons(logs)]
    columns = (
        "Log", "Use", "Valve model", *names, "RMSE, whole", "Largest", "Fit, whole",
        "Sensor noise", "RMSE\N{NO-BREAK SPACE}/\N{NO-BREAK SPACE}noise",
    )  # fmt: skip
    return table(f"{channel.title}: errors in {unit}", columns, rows, text=(1, 2))


def _horizons(logs: Sequence[LogResult]) -> Sequence[HorizonError]:
    return next((c.horizons for log in logs for c in log.channels.values()), ())


def _structure_table(validation: ValidationResult) -> Fold:
    """Whiteness and cross-correlation: in how many tests the residual passes."""
    rows = []
    for log in validation.logs:
        for channel in shown_channels(validation):
            parts = [t.channels[channel.key] for t in log.tests if channel.key in t.channels]
            white = [p.whiteness for p in parts if p.whiteness is not None]
            inputs = [p.inputs for p in parts if p.inputs]
            rows.append(
                (
                    log.name,
                    MODEL_NAMES[log.model],
                    channel.title,
                    f"{sum(w.passed for w in white)} of {len(white)}" if white else MISSING,
                    f"{sum(all(t.passed for t in i.values()) for i in inputs)} of {len(inputs)}"
                    if inputs
                    else MISSING,
                    _loudest(log, channel.key),
                )
            )
    columns = (
        "Log",
        "Valve model",
        "Channel",
        "White",
        "Uncorrelated with inputs",
        "Strongest input",
    )
    caption = "Tests whose residual is white, and uncorrelated with every input (5 % false alarms)"
    return Fold("Structure in the residuals", (table(caption, columns, rows, text=(1, 2, 5)),))


def _loudest(log: LogResult, channel: str) -> str:
    """The input on which the residual depends most, if on any."""
    found = [
        (float(np.max(np.abs(test.correlations) / test.band)), name)
        for result in log.tests
        if channel in result.channels
        for name, test in result.channels[channel].inputs.items()
        if not test.passed
    ]
    return channel_of(max(found)[1]).name if found else MISSING


# --- figures ---------------------------------------------------------------------------


def _growth(validation: ValidationResult, models: Sequence[str], suffix: str = "") -> FigureGroup:
    """`suffix`: of the figures' ids."""
    figures = []
    for channel in shown_channels(validation):
        lines, used = _growth_lines(validation, channel, models)
        title = f"{channel.title}: how the error grows"
        description = f"{channel.title}, RMS over all starts within the tests: " + "; ".join(used)
        x = Scale("Time since the start", "s", limits=(0.0, None))
        y = Scale("RMS error", channel.residual_unit, limits=(0.0, None))
        panel = Panel(x, y, lines, legend="above")
        heading = f"{channel.title}: error over the horizon"
        id = f"fig-growth-{channel.key}{suffix}"
        figures.append(Figure(id, title, description, (panel,), heading))
    caption = (
        "How the open-loop error grows with the time since the simulation last started from the "
        "measured state; one line per valve model, over the held-out logs (all logs if none is)."
    )
    return FigureGroup(caption, tuple(figures))


def _growth_lines(
    validation: ValidationResult, channel: Channel, models: Sequence[str]
) -> tuple[tuple[Line, ...], list[str]]:
    """A line for each of the valve models, and where it ends, in words."""
    lines, used = [], []
    use = "holdout" if validation.select("holdout") else None
    for model in models:
        name = MODEL_NAMES[model]
        curves, times = [], []
        for log in validation.select(use, model):
            for test in log.tests:
                growth = test.growth.get(channel.key, np.zeros(0))
                if len(growth) > 1:
                    times.append(test.time[: len(growth)])
                    curves.append(growth)
        if not curves:
            continue
        rows = min(len(c) for c in curves)
        square = np.mean([c[:rows] ** 2 for c in curves], axis=0)
        # Means over whole PWM periods: the ripple's phase is irrelevant.
        edges = np.unique(np.linspace(0, rows, _GROWTH_POINTS + 1).astype(int))
        shown = channel.residual_scale * np.sqrt(
            np.add.reduceat(square, edges[:-1]) / np.diff(edges)
        )
        centres = 0.5 * (times[0][edges[:-1]] + times[0][edges[1:] - 1])
        role, dash = MODEL_LINES[model]
        lines.append(Line(centres, shown, role, name, dash))
        used.append(
            f"{name} {number(float(shown[-1]))} {channel.residual_unit} after "
            f"{number(float(times[0][rows - 1]))} s"
        )
    return tuple(lines), used


def _plot(index: int, test: ShownTest, trace: Mapping[str, Any]) -> Plot:
    channels = test.channels()
    static = tuple(svg.picture(_overlay(f"fig-motion-{index}", test, c)) for c in channels)
    caption = f"{test.title}: measured and simulated, residual with the 95 % band of the "
    caption += f"sensor noise.{own_friction(trace, test.source)}"
    fits = "; ".join(_fits(test, channel) for channel in channels)
    return Plot(
        id=f"plot-{index}",
        title=f"Open loop: {test.title}",
        description=f"Fit over the whole test: {fits}.",
        caption=caption,
        document=overlay_document(tuple(channels), tuple(test.results)),
        samples=overlay_samples(test, channels, NOISE_BAND),
        static=static,
    )


def _fits(test: ShownTest, channel: Channel) -> str:
    parts = [
        f"{MODEL_NAMES[m]} {percent(r.channels[channel.key].errors.fit_percentage)}"
        for m, r in test.results.items()
        if channel.key in r.channels
    ]
    return f"{channel.title.lower()}, " + ", ".join(parts)


def _overlay(prefix: str, test: ShownTest, channel: Channel) -> Figure:
    first = test.first
    noise = NOISE_BAND * first.channels[channel.key].noise_floor * channel.residual_scale
    measured = first.measured[channel.key] * channel.scale
    above: list[Mark] = [Line(first.time, measured, "measured", "measured", width=2.4)]
    below: list[Mark] = [Span(-noise, noise, alpha=0.35)]
    for model in reversed(list(test.results)):
        result, (role, dash) = test.results[model], MODEL_LINES[model]
        simulated = result.simulated[channel.key] * channel.scale
        residual = result.residual(channel.key) * channel.residual_scale
        above.append(Line(first.time, simulated, role, MODEL_NAMES[model], dash, width=1.0))
        below.append(Line(first.time, residual, role, width=0.6))
    x = Scale("Time", "s")
    panels = (
        Panel(x, Scale(channel.title, channel.unit), tuple(above), 1.8, legend="above"),
        Panel(x, Scale("Residual", channel.residual_unit), tuple(below)),
    )
    description = f"{test.kind}, measured and simulated open loop; {_fits(test, channel)}."
    id, title = f"{prefix}-{channel.key}", channel.title
    return Figure(id, title, description, panels, size=TALL_PANEL)
