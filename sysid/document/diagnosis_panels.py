"""The diagnosis' figures: errors step by step, residuals over regressors, gains next to twins'.

Every panel draws numbers from `sysid.diagnosis.content.figures`. Ids of user-defined effects
are drawn without unusual characters.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.blocks.channels import Channel, channel_of
from sysid.blocks.figures import Picture
from sysid.blocks.numbers import MINUS, number
from sysid.diagnosis.wording import regressor_name
from sysid.document import svg
from sysid.document.motion import NOISE_BAND
from sysid.document.svg import COLOUR
from sysid.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MatplotlibFigure


MOST_SUSPECTS = 8
"""Suspects of one round that are drawn; the table holds all of them."""
_WIDTH = svg.PANEL[0]
_ROW = 0.33  # inches
_FRAME = 0.83  # inches above and below the rows
_LEFT = 0.16  # inches: rows carry their names inside
LEAST_GAIN = 0.1
"""Smaller gains are drawn at this value."""
_NAME = re.compile(r"[^A-Za-z0-9 ._+,:()/-]")
_LONGEST_NAME = 40
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


def waterfall(
    channel: Channel, errors: Sequence[float], steps: Sequence[str], floor: float
) -> Picture:
    """Held-out RMSE of the original bundle, its reduction by each step, and a correct model's.

    `errors` (1 + steps,) and `floor` in the channel's SI unit.
    """
    shown = [channel.residual_scale * e for e in errors]
    low = channel.residual_scale * floor
    unit = channel.residual_unit
    rows = [("original bundle", 0.0, shown[0], "measured", number(shown[0]))]
    for name, before, after in zip(steps, shown, shown[1:], strict=False):
        role = "third" if after <= before else "model"
        sign = MINUS if after <= before else "+"
        change = f"{sign}{number(abs(before - after))}"
        rows.append((drawable(name), min(before, after), max(before, after), role, change))
    if steps:
        rows.append(("extended model", 0.0, shown[-1], "second", number(shown[-1])))
    rows.append(("correct model", 0.0, low, "muted", number(low)))
    figure, ax = _rows_panel(channel.title, len(rows))
    for place, (name, start, end, role, text) in enumerate(rows):
        ax.barh(-place - 0.14, end - start, 0.36, start, color=COLOUR[role], linewidth=0)
        _name_row(ax, place, f"{name}: {text}")
        # A correct model's error, not across the names.
        ax.plot([low, low], [-place - 0.37, -place + 0.09], color=COLOUR["ink"], linewidth=0.8)
    ax.set_xlim(0.0, 1.04 * float(np.nanmax([*shown, low, 1e-12])))
    ax.set_xlabel(f"RMSE on held-out tests ({unit})")
    pairs = zip(steps, shown[1:], strict=True)
    told = "; ".join(f"after {n.removeprefix('+ ')} {number(e)}" for n, e in pairs)
    description = (
        f"The original bundle has {number(shown[0])} {unit}{'; ' + told if told else ''}; the "
        f"error of a correct model is {number(low)} {unit}."
    )
    title = f"Error of {channel.title} on held-out tests, effect by effect"
    return svg.to_figure(figure, f"fig-diagnosis-error-{channel.key}", title, description)


def suspects(place: int, look: Mapping[str, Any], titles: Mapping[str, str]) -> Picture:
    """Gains of one round's suspects on a logarithmic axis, next to the gains on the twins."""
    rows = look["suspects"][:MOST_SUSPECTS]
    figure, ax = _rows_panel(f"Round {place}", len(rows))
    for i, suspect in enumerate(rows):
        y = -i - 0.14
        twins = np.maximum(suspect["twins"], LEAST_GAIN)
        ax.plot(twins, np.full(len(twins), y), "o", color=COLOUR["muted"], ms=3.6, alpha=0.75)
        ax.plot(max(suspect["gain"], LEAST_GAIN), y, "D", color=COLOUR["second"], ms=4.6)
        if suspect["refitted"] is not None:
            value = max(suspect["refitted"], LEAST_GAIN)
            ax.plot(value, y, "x", color=COLOUR["model"], ms=5.5, markeredgewidth=1.5)
        mark = " (added)" if suspect["id"] == look["added"] else ""
        _name_row(ax, i, drawable(titles.get(suspect["id"], suspect["id"])) + mark)
    highest = max(max(s["gain"], s["refitted"] or 0.0, *s["twins"]) for s in rows)
    ax.set_xscale("log")
    ax.set_xlim(0.6 * LEAST_GAIN, 3.0 * max(highest, 10.0))
    decades = range(-1, int(np.log10(max(highest, 10.0))) + 1)
    shown = decades[:: 1 + len(decades) // 6]
    ax.set_xticks([10.0**d for d in shown], [number(10.0**d, 1) for d in shown])
    ax.minorticks_off()
    ax.set_xlabel("Gain (whitened squares)")
    told = "; ".join(
        f"{s['id']} {number(s['gain'])} against {number(max(s['twins']))}" for s in rows
    )
    title = f"Gains of the suspects, round {place}"
    description = f"On the logs, against the largest on a twin: {told}."
    return svg.to_figure(figure, f"fig-diagnosis-suspects-{place}", title, description)


def curve(id: str, content: Mapping[str, Any], is_linear: bool, extended: bool) -> Picture:
    """The mean residual over a regressor: before, and after where the model was `extended`."""
    means = [m for part in ("before", "after") for m in content[part]["means"]]
    unit, scale, title = _unit_of(content, is_linear, means)
    parts = [("before", "model", content["before"])]
    if extended:
        parts.append(("after", "second", content["after"]))
    x, x_unit, name = _regressor(content, is_linear)
    figure, ax = svg.panel(f"{title} over {name}")
    for label, role, part in parts:
        _band(ax, x, part, scale, role, label)
    _finish(ax, name, x_unit, unit)
    if content["fine"]:
        _stretch(ax, x, content["fine"] * float(x[-1]) / float(content["centres"][-1]))
    if extended:
        svg.legend_above(ax)
    told = "; ".join(
        f"{label}, it explains {number(100.0 * part['share'], 2)} % of the residual's variance and "
        f"reaches {number(scale * max(abs(m) for m in part['means']))} {unit}"
        for label, _, part in parts
    )
    description = f"Mean residual in bins of {name}: {told}."
    return svg.to_figure(figure, id, f"{title}: residual over {name}", description)


def influence(id: str, title: str, content: Mapping[str, Any], is_linear: bool) -> Picture:
    """What an effect adds to a balance, or to a part's prediction, over a regressor."""
    unit, scale, of = _unit_of(content, is_linear, content["means"])
    x, x_unit, name = _regressor(content, is_linear)
    figure, ax = svg.panel(drawable(title, _LONGEST_TITLE))
    mean, low, high = (scale * np.array(content[k]) for k in ("means", "low", "high"))
    ax.fill_between(x, low, high, color=COLOUR["third"], alpha=0.2, linewidth=0)
    ax.plot(x, mean, "o-", color=COLOUR["third"], ms=3.0, linewidth=1.3)
    _finish(ax, name, x_unit, unit)
    ax.set_ylabel(f"Added ({unit})" if unit else "Added")
    description = (
        f"It adds {number(float(mean.min()))} to {number(float(mean.max()))} {unit} to the "
        f"{of[:1].lower()}{of[1:]}, on average in bins of {name}."
    )
    return svg.to_figure(figure, id, f"{title}: what it adds over {name}", description)


def _unit_of(
    content: Mapping[str, Any], is_linear: bool, means: Sequence[float]
) -> tuple[str, float, str]:
    """Unit and scale of a residual, and what it is of: a balance, or a part's signal."""
    if "unit" in content:
        # Of a part: in the unit of what its law predicts.
        channel = channel_of(content["channel"])
        if content.get("own") or channel.residual_unit in ("", "-"):
            return content["unit"], 1.0, channel.title
        return channel.residual_unit, channel.residual_scale, channel.title
    unit, scale = _residual_unit(content["channel"], is_linear, means)
    return unit, scale, residual_title(content["channel"], is_linear)


def leftover(id: str, content: Mapping[str, Any], is_linear: bool) -> Picture:
    """The mean of an unexplained residual over the regressor on which it depends most."""
    unit, scale = _residual_unit(content["residual"], is_linear, content["means"])
    title = residual_title(content["residual"], is_linear)
    x, x_unit, name = _regressor(content, is_linear)
    figure, ax = svg.panel(f"{title} over {name}")
    _band(ax, x, content, scale, "model", "unexplained")
    _finish(ax, name, x_unit, unit)
    points = ", ".join(
        f"{number(a, 2)}: {number(scale * b, 2)}" for a, b in zip(x, content["means"], strict=True)
    )
    description = f"Mean residual ({unit}) by {name} ({x_unit}): {points}."
    return svg.to_figure(figure, id, f"Unexplained: {title} over {name}", description)


def _residual_unit(residual: str, is_linear: bool, means: Sequence[float]) -> tuple[str, float]:
    """A residual's unit as it is shown, and the scale to it."""
    if residual == "effort" and not is_linear and max(abs(m) for m in means) >= _LARGE_NM:
        return "N·m", 1.0
    return _UNITS[residual][is_linear]


def _stretch(ax: Axes, x: FloatArray, width: float) -> None:
    """An x axis that is linear within `width` of 0 and logarithmic far beyond it."""
    ax.set_xscale("asinh", linear_width=width)
    reach = float(np.max(np.abs(x)))
    decades = range(int(np.ceil(np.log10(width))), int(np.floor(np.log10(reach))) + 1)
    sizes = [10.0**d for d in decades[:: 1 + len(decades) // 3]]
    ticks = [*(-t for t in reversed(sizes)), 0.0, *sizes]
    ax.set_xticks(ticks, [number(t, 1) for t in ticks])
    ax.minorticks_off()


def _regressor(content: Mapping[str, Any], is_linear: bool) -> tuple[FloatArray, str, str]:
    """A curve's abscissae in the unit that is shown, that unit, and the regressor's name."""
    is_part, is_own = "unit" in content, bool(content.get("own"))
    name, unit, scale = regressor_axis(content["regressor"], is_linear, is_part, is_own=is_own)
    return scale * np.array(content["centres"]), unit, name


def regressor_axis(
    regressor: str, is_linear: bool, is_part: bool = True, *, is_own: bool = False
) -> tuple[str, str, float]:
    """A regressor's name in words, and the unit and the scale in which it is shown.

    A part's further regressors are named with their units, or by a user's own columns (`is_own`).
    """
    others = _AS_NAMED if is_part else _PRESSURE
    units = _AS_NAMED if is_own else _REGRESSOR_UNITS.get(regressor, others)
    unit, scale = units[is_linear]
    return regressor_name(regressor), unit, scale


def _band(
    ax: Axes, x: FloatArray, part: Mapping[str, Any], scale: float, role: str, label: str
) -> None:
    """A curve with the 95 % band of its means."""
    means = scale * np.array(part["means"])
    half = NOISE_BAND * scale * np.array(part["errors"])
    ax.fill_between(x, means - half, means + half, color=COLOUR[role], alpha=0.2, linewidth=0)
    ax.plot(x, means, "o-", color=COLOUR[role], ms=3.0, linewidth=1.3, label=label)


def _finish(ax: Axes, name: str, x_unit: str, unit: str) -> None:
    ax.axhline(0.0, color=COLOUR["muted"], linewidth=0.7)
    ax.margins(x=0.03, y=0.12)
    ax.set_xlabel(f"{name[:1].upper()}{name[1:]}{f' ({x_unit})' if x_unit else ''}")
    ax.set_ylabel(f"Residual ({unit})")


def _rows_panel(title: str, count: int) -> tuple[MatplotlibFigure, Axes]:
    """A panel of `count` rows from the top down, at y = 0, -1, ..., each with its name in it."""
    figure, axes = svg.panels(title, (1.0,), (_WIDTH, _FRAME + _ROW * count), left=_LEFT)
    ax = axes[0]
    ax.set_ylim(-count + 0.5, 0.62)
    ax.set_yticks([])
    ax.spines["left"].set_visible(False)
    return figure, ax


def _name_row(ax: Axes, place: int, text: str) -> None:
    ax.text(0.005, -place + 0.3, text, transform=ax.get_yaxis_transform(), va="center", zorder=4)


def drawable(name: str, longest: int = _LONGEST_NAME) -> str:
    """A name without unusual characters, shortened at the end of a word."""
    shown = _NAME.sub("?", name)
    if len(shown) <= longest:
        return shown
    return shown[: longest - 1].rpartition(" ")[0].rstrip(" ,") + " \N{HORIZONTAL ELLIPSIS}"


__all__ = [
    "LEAST_GAIN",
    "MOST_SUSPECTS",
    "curve",
    "drawable",
    "influence",
    "leftover",
    "regressor_axis",
    "residual_title",
    "suspects",
    "waterfall",
]
