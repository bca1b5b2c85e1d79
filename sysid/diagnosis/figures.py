"""The diagnosis' figures: errors step by step, residuals over regressors, reductions by suspects.

Every panel draws numbers from `sysid.diagnosis.content.figures`. Ids of user-defined effects
are drawn without unusual characters.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from sysid.blocks.figures import (
    Band,
    Bars,
    Figure,
    Line,
    Mark,
    Panel,
    Points,
    Role,
    Rule,
    Scale,
    Words,
    grouped_bars,
    rows_figure,
)
from sysid.blocks.numbers import MINUS, fixed, number, span
from sysid.blocks.titles import capital, within
from sysid.diagnosis.wording import (
    errors_by_step,
    floor_text,
    is_of_actuator,
    judged_tests,
    judged_use,
    own_of,
    regressor_key,
    regressor_name,
    steps,
)
from sysid.estimation.linear import LEVEL, t_quantile
from sysid.io.channels import Channel
from sysid.io.own_channels import RATE_OF, Own, channel_in, error_unit, shown_unit
from sysid.types import FloatArray

MOST_SUSPECTS = 8
"""Suspects of one round that are drawn; the table holds all of them."""
LEAST_REDUCTION = 0.1
"""Smaller reductions are drawn at this value."""
_NAME = re.compile(r"[^A-Za-z0-9 ._+,:()'/-]")
# Letters of a heading that a panel has room for.
_LONGEST_TITLE = 41

_TITLES = {
    "effort": "Torque balance",
    "rate_a": "Chamber A's balance",
    "rate_b": "Chamber B's balance",
    "breakaway": "Effort of breakaways",
}
_LARGE_NM = 0.5
# Unit and scale of each residual and regressor, on a rotary and on a linear rig.
_UNITS = {
    "effort": (("mN·m", 1e3), ("N", 1.0)),
    "rate_a": (("kPa/s", 1e-3), ("kPa/s", 1e-3)),
    "rate_b": (("kPa/s", 1e-3), ("kPa/s", 1e-3)),
    "breakaway": (("mN·m", 1e3), ("N", 1.0)),
}
_REGRESSOR_UNITS = {
    "velocity": (("rad/s", 1.0), ("mm/s", 1e3)),
    "angle": (("rad", 1.0), ("mm", 1e3)),
    "position": (("rad", 1.0), ("mm", 1e3)),
    "angle times direction": (("rad", 1.0), ("mm", 1e3)),
    "acceleration": (("rad/s²", 1.0), ("m/s²", 1.0)),
    "motor": (("N·m", 1.0), ("N", 1.0)),
    "time": (("s", 1.0), ("s", 1.0)),
    "rest": (("s", 1.0), ("s", 1.0)),
    "valve_opening": (("share", 1.0), ("share", 1.0)),
    "pressure_sum times direction": (("kPa", 1e-3), ("kPa", 1e-3)),
    "gauge_pressure_sum times direction": (("kPa", 1e-3), ("kPa", 1e-3)),
    "pressure_a_pa": (("kPa", 1e-3), ("kPa", 1e-3)),
    "flow_a_kg_s": (("g/s", 1e3), ("g/s", 1e3)),
    "pressure_rate": (("kPa/s", 1e-3), ("kPa/s", 1e-3)),
}
_PRESSURE = (("kPa", 1e-3), ("kPa", 1e-3))
_AS_NAMED = (("", 1.0), ("", 1.0))


def residual_title(residual: str, is_linear: bool) -> str:
    """The balance that a residual is of."""
    if residual == "effort" and is_linear:
        return "Force balance"
    return _TITLES[residual]


def steps_panel(content: Mapping[str, Any]) -> Panel:
    """RMSE on held-out logs by channel, one bar a step, over that of a correct model.

    Over that of the original bundle where a correct model's is not known of any channel.
    """
    errors = errors_by_step(content)
    floors = {name: content["residual"][name].get("noise_floor") or math.nan for name in errors}
    of = "correct model"
    if all(map(math.isnan, floors.values())):
        of, floors = "original bundle", {name: first for name, (first, *_) in errors.items()}
    heights: dict[str, Sequence[float]] = {
        step: [errors[name][i] / floors[name] for name in errors]
        for i, step in enumerate(["original bundle", *steps(content)])
    }
    shown, ticks = grouped_bars(list(errors), heights)
    y = Scale(f"RMSE / {of}", kind="log")
    return Panel(Scale(ticks=ticks), y, (*shown, Rule(1.0)), legend="right")


def waterfall(
    channel: Channel,
    errors: Sequence[float],
    steps: Sequence[str],
    floor: float,
    content: Mapping[str, Any] | None = None,
) -> Figure:
    """RMSE of the original bundle, its reduction by each step, and a correct model's.

    `errors` (1 + steps,) and `floor` in the channel's SI unit; `content` of the diagnosis, None: of
    an actuator.
    """
    unit, scale = error_unit(channel, is_alone=not is_of_actuator(content))
    shown, low = [scale * e for e in errors], scale * floor
    lowest = floor_text(low, shown[-1])
    rows: list[tuple[str, float, float, Role, str]] = [
        ("original bundle", 0.0, shown[0], "measured", number(shown[0]))
    ]
    for name, before, after in zip(steps, shown, shown[1:], strict=False):
        role: Role = "third" if after <= before else "fourth"
        sign = MINUS if after <= before else "+"
        # To the last digit that the errors are written with.
        _, point, decimals = number(before).partition(".")
        is_short = not point or decimals.isdigit()
        change = abs(before - after)
        size = fixed(change, len(decimals)) if is_short else number(change)
        rows.append((drawable(name), min(before, after), max(before, after), role, sign + size))
    if steps:
        rows.append(("extended model", 0.0, shown[-1], "model", number(shown[-1])))
    rows.append(("correct model", 0.0, low, "muted", lowest))
    marks: list[Mark] = []
    for place, (name, start, end, role, text) in enumerate(rows):
        y = np.array([-place - 0.14])
        bar = Bars(y, np.array([end]), role, "", 0.36, np.array([start]), is_across=True)
        # A correct model's error, not across the names.
        edge = np.array([-place - 0.37, -place + 0.09])
        marks += [
            bar,
            _name(place, f"{name}: {text}"),
            Line(np.full(2, low), edge, "ink", width=0.8),
        ]
    reach = 1.04 * float(np.nanmax([*shown, low, 1e-12]))
    # What training tests were excluded from stands in the caption: the axis has no room for it.
    x = Scale(f"RMSE on {judged_use(content or {})}", unit, (0.0, reach))
    pairs = zip(steps, shown[1:], strict=True)
    told = "; ".join(f"after {n.removeprefix('+ ')} {number(e)}" for n, e in pairs)
    description = (
        f"The original bundle has {number(shown[0])} {unit}{'; ' + told if told else ''}; the "
        f"error of a correct model is {lowest} {unit}."
    )
    title = f"Error of {channel.title} on {judged_tests(content or {})}, effect by effect"
    return rows_figure(
        f"fig-diagnosis-error-{channel.key}", title, description, channel.title, x, marks, len(rows)
    )


def suspects(place: int, look: Mapping[str, Any], titles: Mapping[str, str]) -> Figure:
    """Reductions by one round's suspects on a logarithmic axis, next to those on the twins."""
    rows = look["suspects"][:MOST_SUSPECTS]
    marks: list[Mark] = []
    for i, suspect in enumerate(rows):
        twins = np.maximum(suspect["twins"], LEAST_REDUCTION)
        y = np.full(len(twins), -i - 0.14)
        reduction = np.array([max(suspect["gain"], LEAST_REDUCTION)])
        marks.append(Points(twins, y, "muted", size=3.6, is_filled=True, alpha=0.75))
        marks.append(Points(reduction, y[:1], "second", marker="D", size=4.6, is_filled=True))
        if suspect["refitted"] is not None:
            value = np.array([max(suspect["refitted"], LEAST_REDUCTION)])
            marks.append(Points(value, y[:1], "model", marker="x", size=5.5))
        mark = " (added)" if suspect["id"] == look["added"] else ""
        marks.append(_name(i, drawable(titles.get(suspect["id"], suspect["id"])) + mark))
    highest = max(max(s["gain"], s["refitted"] or 0.0, *s["twins"]) for s in rows)
    decades = range(-1, int(np.log10(max(highest, 10.0))) + 1)
    ticks = tuple((10.0**d, number(10.0**d, 1)) for d in decades[:: 1 + len(decades) // 6])
    limits = (0.6 * LEAST_REDUCTION, 3.0 * max(highest, 10.0))
    x = Scale("Reduction (whitened squares)", limits=limits, kind="log", ticks=ticks)
    told = "; ".join(
        f"{s['id']} {number(s['gain'])} against {number(max(s['twins']))}" for s in rows
    )
    title = f"Reductions by the suspects, round {place}"
    description = f"On the logs, against the largest on a twin: {told}."
    id = f"fig-diagnosis-suspects-{place}"
    return rows_figure(id, title, description, f"Round {place}", x, marks, len(rows))


def curve(id: str, content: Mapping[str, Any], is_linear: bool, extended: bool) -> Figure:
    """The mean residual over a regressor: before, and after where the model was `extended`."""
    means = [m for part in ("before", "after") for m in content[part]["means"]]
    unit, scale, title = _unit_of(content, is_linear, means)
    parts: list[tuple[str, Role, Any]] = [("before", "second", content["before"])]
    if extended:
        parts.append(("after", "model", content["after"]))
    x, axis = _regressor(content, is_linear)
    if is_stretched(content):
        axis = _stretched(axis, x, content["fine"] * float(x[-1]) / float(content["centres"][-1]))
    marks = [mark for label, role, part in parts for mark in _means(x, part, scale, role, label)]
    told = "; ".join(
        f"{label}, it explains {number(100.0 * part['share'], 2)} % of the residual's variance and "
        f"reaches {number(scale * max(abs(m) for m in part['means']))} {unit}"
        for label, _, part in parts
    )
    name = regressor_name(content["regressor"], own_of(content))
    description = f"Mean residual in bins of {name}: {told}."
    heading = f"{title} over {name}"
    return _residual_figure(
        id,
        f"{title}: residual over {name}",
        description,
        heading if len(heading) <= _LONGEST_TITLE else title,
        axis,
        unit,
        marks,
        has_legend=extended,
    )


def influence(id: str, title: str, content: Mapping[str, Any], is_linear: bool) -> Figure:
    """What an effect adds to a balance, or to a part's prediction, over a regressor."""
    unit, scale, of = _unit_of(content, is_linear, content["means"])
    x, axis = _regressor(content, is_linear)
    name = regressor_name(content["regressor"], own_of(content))
    mean, low, high = (scale * np.array(content[k]) for k in ("means", "low", "high"))
    marks: list[Mark] = [
        Band(x, low, high, "third"),
        Line(x, mean, "third", width=1.3, marker="o"),
    ]
    description = (
        f"It adds {span(float(mean.min()), float(mean.max()))} {unit} to the "
        f"{within(of)}, on average in bins of {name}."
    )
    heading = drawable(title, _LONGEST_TITLE)
    whole = f"{title}: what it adds over {name}"
    return _residual_figure(id, whole, description, heading, axis, unit, marks, y_name="Added")


def leftover(id: str, content: Mapping[str, Any], is_linear: bool) -> Figure:
    """The mean of an unexplained residual over the regressor on which it depends most."""
    unit, scale = _residual_unit(content["residual"], is_linear, content["means"])
    title = residual_title(content["residual"], is_linear)
    x, axis = _regressor(content, is_linear)
    name = regressor_name(content["regressor"], own_of(content))
    marks = _means(x, content, scale, "model", "")
    points = ", ".join(
        f"{number(a, 2)}: {number(scale * b, 2)}" for a, b in zip(x, content["means"], strict=True)
    )
    description = f"Mean residual ({unit}) by {name} ({axis.unit}): {points}."
    heading = f"{title} over {name}"
    return _residual_figure(id, f"Unexplained: {heading}", description, heading, axis, unit, marks)


def _unit_of(
    content: Mapping[str, Any], is_linear: bool, means: Sequence[float]
) -> tuple[str, float, str]:
    """Unit and scale of a residual, and what it is of: a balance, or a part's signal."""
    if "unit" in content:
        # Of a part: in the unit of what its law predicts.
        channel = channel_in(content["channel"], own_of(content))
        if channel.residual_unit in ("", "-"):
            return content["unit"], 1.0, channel.title
        return *error_unit(channel, is_alone=True), channel.title
    unit, scale = _residual_unit(content["channel"], is_linear, means)
    return unit, scale, residual_title(content["channel"], is_linear)


def _residual_unit(residual: str, is_linear: bool, means: Sequence[float]) -> tuple[str, float]:
    """A residual's unit as it is shown, and the scale to it."""
    if residual == "effort" and not is_linear and max(abs(m) for m in means) >= _LARGE_NM:
        return "N·m", 1.0
    return _UNITS[residual][is_linear]


def is_stretched(content: Mapping[str, Any]) -> bool:
    """Whether the axis of a curve is stretched about 0: where it has means there."""
    fine = content["fine"]
    return bool(fine) and min(map(abs, content["centres"])) < fine


def _stretched(axis: Scale, x: FloatArray, width: float) -> Scale:
    """An axis that is linear within `width` of 0 and logarithmic far beyond it."""
    reach = float(np.max(np.abs(x)))
    decades = range(int(np.ceil(np.log10(width))), int(np.floor(np.log10(reach))) + 1)
    sizes = [10.0**d for d in decades[:: 1 + len(decades) // 3]]
    places = [*(-t for t in reversed(sizes)), 0.0, *sizes]
    ticks = tuple((t, number(t, 1)) for t in places)
    return replace(axis, kind="asinh", linear_width=width, ticks=ticks)


def _regressor(content: Mapping[str, Any], is_linear: bool) -> tuple[FloatArray, Scale]:
    """A curve's abscissae in the unit that is shown, and their axis."""
    is_part, own = "unit" in content, own_of(content)
    axis, scale = regressor_axis(content["regressor"], is_linear, is_part, own=own)
    return scale * np.array(content["centres"]), replace(axis, margin=0.03)


def regressor_axis(
    regressor: str, is_linear: bool, is_part: bool = True, *, own: Own = MappingProxyType({})
) -> tuple[Scale, float]:
    """A regressor in words with the unit in which it is shown, and the scale to it.

    A part's further regressors are named with their units, those of a user's `own` columns have
    the units of these.
    """
    others = _AS_NAMED if is_part else _PRESSURE
    unit, scale = _REGRESSOR_UNITS.get(regressor_key(regressor), others)[is_linear]
    column = regressor.removeprefix(RATE_OF)
    if column in own:
        unit, scale = shown_unit(own[column])
        unit = f"{unit}/s" if unit and column != regressor else unit
    name = regressor_name(regressor, own)
    return Scale(capital(name), unit), scale


def _means(
    x: FloatArray, part: Mapping[str, Any], scale: float, role: Role, label: str
) -> list[Mark]:
    """A curve with the 95 % band of its means."""
    means = scale * np.array(part["means"])
    half = t_quantile(math.inf, LEVEL) * scale * np.array(part["errors"])
    line = Line(x, means, role, label, width=1.3, marker="o")
    return [Band(x, means - half, means + half, role), line]


def _residual_figure(
    id: str,
    title: str,
    description: str,
    heading: str,
    x: Scale,
    unit: str,
    marks: Sequence[Mark],
    *,
    y_name: str = "Residual",
    has_legend: bool = False,
) -> Figure:
    y = Scale(y_name, unit, margin=0.12)
    legend: Any = "above" if has_legend else "none"
    panel = Panel(x, y, (*marks, Rule(0.0)), legend=legend)
    return Figure(id, title, description, (panel,), heading)


def _name(place: int, text: str) -> Words:
    return Words(0.0, -place + 0.3, text, is_at_edge=True)


def drawable(name: str, longest: int = 40) -> str:
    """A name without unusual characters, shortened at the end of a word."""
    shown = _NAME.sub("?", name)
    if len(shown) <= longest:
        return shown
    return shown[: longest - 1].rpartition(" ")[0].rstrip(" ,") + " \N{HORIZONTAL ELLIPSIS}"


__all__ = [
    "LEAST_REDUCTION",
    "MOST_SUSPECTS",
    "curve",
    "drawable",
    "influence",
    "is_stretched",
    "leftover",
    "regressor_axis",
    "residual_title",
    "steps_panel",
    "suspects",
    "waterfall",
]
