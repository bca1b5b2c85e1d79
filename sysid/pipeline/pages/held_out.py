"""The picture on a report's first screen: one held-out test, measured, before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.blocks.figures import Dash, Figure, Line, Mark, Panel, Role, Rule, Scale
from sysid.blocks.numbers import number, percent
from sysid.blocks.sections import FigureGroup
from sysid.diagnosis.wording import own_friction
from sysid.io.channels import Channel, channel_of
from sysid.types import FloatArray

if TYPE_CHECKING:
    from sysid.validation import ValidationResult

Content = Mapping[str, Any]
Curve = tuple[str, FloatArray, Role, Dash]

_SIZE = (4.6, 3.1)


def first_picture(
    validation: ValidationResult | None, diagnosis: Content | None, is_linear: bool
) -> FigureGroup | None:
    """Of the tests held out the one that the fitted model follows worst; None without any test.

    Of an actuator: its position, by the diagnosis' trace (before and after its effects) or by the
    validation. Of a part tested alone: what its law predicts.
    """
    figures = (diagnosis or {}).get("figures", {})
    if "trace" in figures:
        return _of_trace(figures["trace"], bool((diagnosis or {}).get("effects")))
    if figures.get("tests"):
        return _of_part(diagnosis or {}, is_linear)
    return None if validation is None else _of_validation(validation)


def _of_trace(trace: Content, is_extended: bool) -> FigureGroup:
    """From what `sysid.diagnosis.actuator.holdout.trace` made."""
    channel = channel_of(trace["channel"])
    curves: list[Curve] = [
        ("the model as it was fitted", np.array(trace["before"]), "second", "dashed"),
        ("with the effects found", np.array(trace["after"]), "model", "solid"),
    ]
    fits = f"fits to {percent(trace['fit']['after'])}"
    if is_extended:
        fits += f", {percent(trace['fit']['before'])} before"
    else:
        curves = [("model", np.array(trace["after"]), "model", "solid")]
    figure = _figure(channel, np.array(trace["time"]), np.array(trace["measured"]), curves)
    count, worst = trace["tests"], "fitted model" if is_extended else "model"
    of = f"Of {count} held-out tests the one that the {worst} follows worst: " if count > 1 else ""
    which = f"{of}{trace['source']}, held out, simulated open loop"
    caption = f"{which}; {channel.title.lower()} {fits}.{own_friction(trace, trace['source'])}"
    return FigureGroup(caption, (figure,))


def _of_validation(validation: ValidationResult) -> FigureGroup | None:
    from sysid.validation.shown_tests import ShownTest, tests_of

    tests = tests_of(validation)
    held = [test for test in tests if test.use == "holdout"] or tests
    moving = [test for test in held if test.channels()]
    if not moving:
        return None
    test = max(moving, key=ShownTest.lack_of_fit)
    channel, first = test.channels()[0], test.first
    simulated = first.simulated[channel.key]
    curves: list[Curve] = [("model", simulated, "model", "solid")]
    figure = _figure(channel, first.time, first.measured[channel.key], curves)
    fit = first.channels[channel.key].errors.fit_percentage
    return FigureGroup(
        f"The test that the model follows worst: {test.title}, simulated open loop; "
        f"{channel.title.lower()} fits to {percent(fit)}.",
        (figure,),
    )


def _of_part(diagnosis: Content, is_linear: bool) -> FigureGroup:
    from sysid.diagnosis.shown_part import figures_of_tests, tests_caption

    figure = figures_of_tests(diagnosis, is_linear)[0]
    return FigureGroup(tests_caption(diagnosis, 1), (replace(figure, id="fig-first", size=_SIZE),))


def _figure(
    channel: Channel, time: FloatArray, measured: FloatArray, curves: Sequence[Curve]
) -> Figure:
    above: list[Mark] = [Line(time, channel.scale * measured, "measured", "measured", width=3.0)]
    below: list[Mark] = [Rule(0.0)]
    told = []
    for label, curve, role, dash in curves:
        above.append(Line(time, channel.scale * curve, role, label, dash, 1.3))
        residual = channel.residual_scale * (measured - curve)
        below.append(Line(time, residual, role, dash=dash, width=0.9))
        rms = float(np.sqrt(np.mean(residual**2)))
        told.append(f"{label} {number(rms)} {channel.residual_unit}")
    x = Scale("Time", "s")
    panels = (
        Panel(x, Scale(channel.title, channel.unit), tuple(above), 1.9, legend="above"),
        Panel(x, Scale("Residual", channel.residual_unit), tuple(below), legend="none"),
    )
    description = f"{channel.title} over time, measured and simulated; RMSE: {'; '.join(told)}."
    title = f"{channel.title} in a held-out test"
    return Figure("fig-first", title, description, panels, size=_SIZE)


__all__ = ["first_picture"]
