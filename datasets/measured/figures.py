"""The figures of the measured sets' page, in the style of `sysid.blocks.svg`.

All functions are to be called within `sysid.blocks.svg.styled()`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from datasets.measured.findings import Errors
from sysid.blocks import svg
from sysid.blocks.figures import Picture
from sysid.blocks.numbers import number
from sysid.blocks.svg import COLOUR
from sysid.blocks.titles import capital
from sysid.diagnosis.figures import regressor_axis
from sysid.diagnosis.wording import regressor_key, regressor_name
from sysid.io.channels import channel_of
from sysid.io.motion import ROTARY
from sysid.io.own_channels import error_unit
from sysid.io.units import CANONICAL_UNITS
from sysid.types import FloatArray

_BAR = 0.26  # of a campaign's width
_CAMPAIGN, _MARGINS = 0.4, 0.8  # inches
_BARS = (
    ("before", "before", "measured"),
    ("after", "after", "model"),
    ("noise_floor", "correct model", "band"),
)
# Room above the bars for the legend.
_HEADROOM = 1.32
# Prefixes of the units that accept one.
_PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"))
_SCALED = ("Pa", "N", "V", "m", "s", "W", "A")
_NAME = re.compile(r"[^\w .,;:/()+-]")


def bars(id: str, errors: Mapping[int, Errors]) -> Picture:
    """RMSE of one channel before, after and of noise alone, by the campaign's number."""
    channel = next(iter(errors.values())).channel
    sizes = [getattr(e, key) for e in errors.values() for key, _, _ in _BARS]
    unit, scale = shown_in(channel, [s for s in sizes if s is not None])
    width = max(svg.PANEL[0], _MARGINS + _CAMPAIGN * len(errors))
    figure, ax = svg.panel(f"RMSE of {title_of(channel)}", (width, svg.PANEL[1]))
    for place, (key, label, role) in enumerate(_BARS):
        heights = [_or_nan(getattr(e, key)) * scale for e in errors.values()]
        x = np.arange(len(errors)) + (place - 1) * _BAR
        ax.bar(x, heights, 0.92 * _BAR, color=COLOUR[role], linewidth=0, label=label)
    ax.set_xticks(range(len(errors)), [str(place) for place in errors])
    ax.tick_params(axis="x", length=0)
    ax.grid(visible=False, axis="x")
    highest = max((scale * s for s in sizes if s is not None), default=1.0)
    ax.set_xlim(-0.6, max(len(errors), 2) - 0.4)
    ax.set_ylim(0.0, _HEADROOM * (highest or 1.0))
    ax.set_xlabel("Campaign")
    ax.set_ylabel(f"RMSE ({unit})" if unit else "RMSE")
    svg.legend(ax, loc="upper left", ncols=3, columnspacing=0.9, handlelength=1.0)
    told = "; ".join(
        f"campaign {place}: {number(e.before)} before, {number(e.after)} after, "
        f"correct model {number(e.noise_floor)}"
        for place, e in errors.items()
    )
    title = f"Held-out RMSE of {title_of(channel)}"
    return svg.to_figure(figure, id, title, f"In {unit_of(channel) or 'its unit'}. {told}.")


def curve(id: str, content: Mapping[str, Any]) -> Picture:
    """The mean residual over a regressor, before and after, in the units of a report's figures.

    `centres`, `before` and `after` are lists of equal length, an empty bin None.
    """
    channel, name = str(content["channel"]), regressor_name(str(content["regressor"]))
    centres = _array(content["centres"])
    before, after = _array(content["before"]), _array(content["after"])
    means = [float(m) for m in (*before, *after) if np.isfinite(m)]
    unit, scale = shown_in(channel, means)
    is_linear = channel not in (ROTARY.effort_channel, ROTARY.position_channel)
    axis, x_scale = regressor_axis(regressor_key(str(content["regressor"])), is_linear)
    x_unit = axis.unit
    of = _drawable(title_of(channel))
    figure, ax = svg.panel(f"{capital(of)} over {_drawable(name)}")
    ax.axhline(0.0, color=COLOUR["muted"], linewidth=0.7)
    for label, role, values in (("before", "measured", before), ("after", "model", after)):
        ax.plot(
            x_scale * centres,
            scale * values,
            "o-",
            color=COLOUR[role],
            ms=3.0,
            linewidth=1.3,
            label=label,
        )
    ax.margins(x=0.03, y=0.12)
    label = _drawable(capital(name))
    ax.set_xlabel(f"{label} ({_drawable(x_unit)})" if x_unit not in ("", "-") else label)
    ax.set_ylabel(f"Mean residual ({unit})" if unit else "Mean residual")
    svg.legend(ax)
    told = "; ".join(
        f"{word} it reaches {number(float(np.nanmax(np.abs(part))) if part.size else None)}"
        for word, part in (("before", before), ("after", after))
    )
    title = f"{title_of(channel)}: residual over {name}"
    return svg.to_figure(figure, id, title, f"Mean residual in bins of {name}: {told}.")


def unit_of(channel: str) -> str:
    """A channel's SI unit, empty where it has none."""
    unit = CANONICAL_UNITS.get(channel, "")
    return "" if unit in (None, "dimensionless", "-") else str(unit).replace("*", "·")


def title_of(channel: str) -> str:
    """A channel within a sentence, as reports call it."""
    return channel_of(channel).name


def shown_in(channel: str, errors: Sequence[float]) -> tuple[str, float]:
    """The unit in which reports show a channel's errors, and the scale to it from SI."""
    shown = channel_of(channel)
    if shown.residual_unit:
        unit, scale = error_unit(shown, is_alone=True)
        name, more = scaled("" if unit == "-" else unit, [scale * e for e in errors])
        return name, scale * more
    return scaled(unit_of(channel), errors)


def scaled(unit: str, values: Sequence[float]) -> tuple[str, float]:
    """The unit with a prefix in which values are neither huge nor tiny, and the scale to it."""
    largest = max((abs(v) for v in values if np.isfinite(v)), default=0.0)
    if unit not in _SCALED or largest == 0.0:
        return unit, 1.0
    size, prefix = next(((s, p) for s, p in _PREFIXES if largest >= s), _PREFIXES[-1])
    return prefix + unit, 1.0 / size


def _array(values: Any) -> FloatArray:
    """Numbers, None made NaN; the `means` of a curve that has errors too."""
    if isinstance(values, Mapping):
        values = values["means"]
    return np.array([_or_nan(v) for v in values], dtype=float)


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else float(value)


def _drawable(text: str) -> str:
    return _NAME.sub("?", text)[:40]


__all__ = ["bars", "curve", "scaled", "title_of", "unit_of"]
