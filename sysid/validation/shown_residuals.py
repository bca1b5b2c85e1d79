"""What the open-loop residual depends on: velocity, angle, pressure and time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from sysid.blocks.figures import SMALL_PANEL, Band, Figure, Line, Panel, Points, Rule, Scale
from sysid.blocks.numbers import number
from sysid.blocks.sections import Block, FigureGroup, Fold, Section
from sysid.io.channels import Channel, channel_of
from sysid.types import FloatArray
from sysid.validation.shown_tests import (
    MODEL_NAMES,
    NOISE_BAND,
    ShownTest,
    shown_channels,
    speed,
    tests_of,
)

if TYPE_CHECKING:
    from sysid.validation import ValidationResult


_BINS = 28


@dataclass(frozen=True)
class _Regressor:
    key: str
    title: str
    axis: Scale


def residuals_section(validation: ValidationResult) -> Section:
    """Residuals of the held-out tests (of all tests without held-out ones) over regressors."""
    tests = tests_of(validation)
    held = [t for t in tests if t.use == "holdout"] or tests
    blocks: list[Block] = []
    for channel in shown_channels(validation):
        usable = [t for t in held if channel.key in t.first.measured]
        if usable:
            blocks.append(_group(usable, channel))
    model = MODEL_NAMES[held[0].first.model]
    many = "s" if len(held) > 1 else ""
    is_held_out = held[0].use == "holdout"
    used = f"held-out test{many}" if is_held_out else f"test{many}, all used for training"
    intro = (
        f"Measured less simulated, over the whole of {len(held)} {used}, valves by the {model}. "
        "Line: median; shaded: the middle 90 %; dots: a sample of the data; dashed: the "
        "95 % band of the sensor noise. A median that varies systematically may be an effect that "
        "the model lacks, or small errors of its numbers, which add up in open loop: the diagnosis "
        "judges which.",
    )
    return Section("residuals", "Residuals", intro, tuple(blocks))


def _group(tests: Sequence[ShownTest], channel: Channel) -> Block:
    """A channel's residual over each regressor; folded where no median leaves the noise's band."""
    figures = []
    is_noise = True
    for regressor in _regressors(tests[0], channel):
        parts = [_values(t, channel, regressor.key) for t in tests]
        known = [p for p in parts if p is not None]
        if known:
            x, y = (np.concatenate(c) for c in zip(*known, strict=True))
            noise = float(np.median([t.first.channels[channel.key].noise_floor for t in tests]))
            noise *= channel.residual_scale
            means = binned(x, y)
            figures.append(_panel(channel, regressor, x, y, means, noise))
            is_noise = is_noise and bool(np.all(np.abs(means[2]) <= NOISE_BAND * noise))
    group = FigureGroup(f"{channel.title}: residual over possible regressors.", tuple(figures))
    if not is_noise:
        return group
    return Fold(f"{channel.title}: no median leaves the band of the sensor noise", (group,))


def _regressors(test: ShownTest, channel: Channel) -> list[_Regressor]:
    position = test.channels()[0]
    linear = position.key == "position_m"
    pressure = channel.key if channel.is_pressure else "pressure_a_pa"
    side = pressure.removeprefix("pressure_")[0].upper()
    return [
        _Regressor("speed", "velocity", Scale("Velocity", "mm/s" if linear else "rad/s")),
        _Regressor(position.key, "position", Scale(position.title, position.unit)),
        _Regressor(pressure, f"pressure {side}", Scale(f"Pressure {side}", "kPa")),
        _Regressor("time", "time", Scale("Time", "s")),
    ]  # fmt: skip


def _values(
    test: ShownTest, channel: Channel, regressor: str
) -> tuple[FloatArray, FloatArray] | None:
    """Regressor and residual of the counted samples, in shown units; None if not measured."""
    result = test.first
    rows = slice(0, result.counted)
    residual = result.residual(channel.key)[rows] * channel.residual_scale
    position = test.channels()[0]
    if regressor == "time":
        return result.time[rows], residual
    if regressor == "speed":
        return speed(result, position.key)[rows] * position.scale, residual
    if regressor not in result.measured:
        return None
    return result.measured[regressor][rows] * channel_of(regressor).scale, residual


def _panel(
    channel: Channel,
    regressor: _Regressor,
    x: FloatArray,
    y: FloatArray,
    means: tuple[FloatArray, ...],
    noise: float,
) -> Figure:
    heading = f"{channel.title} over {regressor.title}"
    shown = np.random.default_rng(0).permutation(len(x))[:3000]
    centre, low, middle, high = means
    marks = (
        Points(x[shown], y[shown], "measured", marker=".", size=1.6, alpha=0.35, is_cloud=True),
        Band(centre, low, high, "second"),
        Line(centre, middle, "second", width=1.4),
        Rule(NOISE_BAND * noise, dash="dashed"),
        Rule(-NOISE_BAND * noise, dash="dashed"),
    )
    first, last = np.percentile(x, [0.2, 99.8])
    reach = max(1.15 * float(np.percentile(np.abs(y), 99.5)), 2.5 * noise)
    axis = replace(regressor.axis, limits=(float(first), float(last)))
    residual = Scale("Residual", channel.residual_unit, limits=(-reach, reach))
    panel = Panel(axis, residual, marks)
    unit = channel.residual_unit
    description = (
        f"The median residual lies between {number(float(middle.min()))} and "
        f"{number(float(middle.max()))} {unit}; the sensor noise's 95 % band is "
        f"{number(NOISE_BAND * noise)} {unit} either way."
    )
    id = f"fig-residual-{channel.key}-{regressor.key}"
    return Figure(id, f"Residual: {heading}", description, (panel,), heading, SMALL_PANEL)


def binned(x: FloatArray, y: FloatArray) -> tuple[FloatArray, ...]:
    """Centres (m,) and the 5, 50 and 95 % points of y in even bins of x that hold enough."""
    first, last = (float(p) for p in np.percentile(x, [0.5, 99.5]))
    edges = np.linspace(first, last, _BINS + 1)
    place = np.searchsorted(edges, x) - 1
    order = np.argsort(place, kind="stable")
    bounds = np.searchsorted(place[order], np.arange(_BINS + 1))
    rows = []
    for i in range(_BINS):
        values = y[order[bounds[i] : bounds[i + 1]]]
        if len(values) >= 20:
            rows.append((0.5 * (edges[i] + edges[i + 1]), *np.percentile(values, [5, 50, 95])))
    if not rows:
        rows = [(float(np.median(x)), *np.percentile(y, [5, 50, 95]))]
    return tuple(np.array(rows).T)
