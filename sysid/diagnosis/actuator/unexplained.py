"""The remainder that no effect explains: the regressor it depends on most, and its curve."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from sysid.diagnosis.actuator.breakaways import rest_before
from sysid.diagnosis.actuator.equation_error import (
    BALANCES,
    BREAKAWAY,
    CHANNELS,
    EFFORT,
    EquationError,
    equation_error,
)
from sysid.diagnosis.actuator.free_curves import best_curve
from sysid.diagnosis.actuator.null_distribution import TOLERATED
from sysid.diagnosis.actuator.projection import channel_squares
from sysid.diagnosis.actuator.samples import Traces
from sysid.diagnosis.actuator.whitening import Frame
from sysid.diagnosis.binning import binned_means
from sysid.diagnosis.lack_of_fit import (
    PER_DIRECTION,
    Remainder,
    ResidualTable,
    dependences,
    per_direction,
    remainder,
)
from sysid.io.rig import Rig
from sysid.types import FloatArray

if TYPE_CHECKING:
    from sysid.diagnosis.actuator.loop import Loop


_RATE = "Pa/s"


@dataclass(frozen=True)
class ResidualCurve:
    """Mean residual over a regressor, in bins of equal count: (bins,) each, and its share.

    `share`: of the residual's squares in the channel, predicted from other tests, 0 to 1.
    `centres` in the regressor's unit, `means` and `errors` (standard errors) in the
    residual's: Nm or N for `effort`, Pa/s for rates.
    """

    channel: str
    regressor: str
    share: float
    centres: FloatArray
    means: FloatArray
    errors: FloatArray


def leftover(found: Loop) -> tuple[ResidualCurve, ...]:
    """Channels whose residual still holds structure, each with its strongest regressor."""
    search = found.search
    return _strongest(found, found.null.structured(search.first, search.last))


def imitated(found: Loop) -> tuple[ResidualCurve, ...]:
    """Channels in which effects found may imitate together a law of one quantity.

    A curve over it explains far more without them than they do, alone or next to one of them.
    `share` is of the squares that they leave, and the curve what of it they leave.
    """
    search, null = found.search, found.null
    first, last = search.first, search.last
    before, after = (
        dict(zip(CHANNELS, channel_squares(base, base.rest), strict=True)) for base in (first, last)
    )
    entries = []
    for channel in BALANCES if search.steps else ():
        explained = before[channel] - after[channel]
        if explained < null.least_structure(last, channel):
            continue
        tried = regressors(first.frame.traces, channel)
        rivals = [best_curve(first, channel, tried, own) for own in _one_of_several(found)]
        best = min(filter(None, rivals), key=lambda curve: curve.squares, default=None)
        if best is None or after[channel] - best.squares < TOLERATED * explained:
            continue
        share = 1.0 - best.squares / after[channel]
        own = (c for c in curves(last.frame, found.error, channel) if c.regressor == best.regressor)
        entries += [replace(curve, share=share) for curve in own]
    return tuple(entries)


def _one_of_several(found: Loop) -> Iterator[FloatArray]:
    """What may be known next to an unknown law, (rows, k): nothing, or one effect of several more.

    One whose law is right may be next to others that imitate another law.
    """
    first = found.search.first
    yield np.zeros((len(first.residual), 0))
    added = found.search.model.effects[len(first.model.effects) :]
    for effect in added if len(added) > 2 else ():
        yield (first.frame.residual(first.model + effect) - first.residual)[:, None]


def faintest(found: Loop) -> tuple[ResidualCurve, ...]:
    """The strongest dependence in any channel, where none is large enough to count."""
    entries = _strongest(found, BALANCES)
    return tuple(sorted(entries, key=lambda e: -e.share)[:1])


def _strongest(found: Loop, channels: Sequence[str]) -> tuple[ResidualCurve, ...]:
    """Each channel's dependence on its strongest regressor."""
    if not channels:
        return ()
    frame = found.search.last.frame
    strongest = (next(iter(curves(frame, found.error, channel)), None) for channel in channels)
    return tuple(curve for curve in strongest if curve is not None)


def remainders(found: Loop, rig: Rig) -> tuple[Remainder, ...]:
    """How much of each balance's residual repeats from training test to training test.

    Of its windows' means, in the balance's unit; noise is that of the sensors, as a twin shows it.
    """
    frame = found.search.last.frame
    rests = []
    for channel in BALANCES:
        table = _table(frame, found.error, channel)
        noise = math.sqrt(float(found.colour.covariance[channel][0]))
        unit = _RATE if channel != EFFORT else rig.units.effort
        name = log_channel(channel, rig)
        rests.append(remainder(table, dependences(table), noise, name, unit))
    return tuple(rest for rest in rests if rest is not None)


def repeating(
    found: Loop, rests: Sequence[Remainder], structured: Sequence[ResidualCurve], rig: Rig
) -> tuple[ResidualCurve, ...]:
    """The strongest curve of each further channel whose remainder repeats, and is large.

    In addition to those that are `structured` already. Large: more than the noise, and than a tenth
    of the model's remainder without effects.
    """
    known = {log_channel(curve.channel, rig) for curve in structured}
    channels = {log_channel(channel, rig): channel for channel in BALANCES}
    first = found.search.first
    error = equation_error(first.frame.traces, first.model)
    large = []
    for rest in rests:
        if rest.channel in known or rest.repeatable <= rest.noise:
            continue
        channel = channels[rest.channel]
        before = first.frame.windows[channel].average(error[channel])
        if rest.is_structure(math.sqrt(float(np.mean(before**2)))):
            large.append(channel)
    return _strongest(found, large)


def log_channel(channel: str, rig: Rig) -> str:
    """The channel of the log format whose balance a residual is of."""
    return rig.position_channel if channel == EFFORT else f"pressure_{channel[-1]}_pa"


def regressors(traces: Traces, channel: str) -> dict[str, FloatArray]:
    """What a residual may depend on, (n,) each, by name."""
    if channel == BREAKAWAY:
        return {"rest": rest_before(traces), "angle": traces.position, "time": traces.time}
    # Neither the acceleration nor the motor's effort for the effort, nor a pressure's own rate for
    # its rate: they hold what the residual holds.
    t = traces
    found = {"velocity": t.velocity, "angle": t.position, "pressure_a": t.pressure_a}
    if np.ptp(t.pressure_b) > 0.0:  # where there is no chamber B it is the atmosphere's
        found |= {
            "pressure_b": t.pressure_b,
            "pressure_difference": t.pressure_a - t.pressure_b,
        }
    found["time"] = t.time
    if channel == EFFORT:
        found["pressure_sum times direction"] = (t.pressure_a + t.pressure_b) * t.direction
        found["angle" + PER_DIRECTION] = per_direction(t.position, t.direction)
    else:
        if np.any(t.motor):
            found["motor"] = t.motor
        found["valve_opening"] = t.open_a if channel.endswith("a") else t.open_b
        found["acceleration"] = t.acceleration
    return found


def curves(frame: Frame, error: EquationError, channel: str) -> list[ResidualCurve]:
    """The residual's dependence on every regressor, the strongest first."""
    view, found = frame.windows[channel], []
    table = _table(frame, error, channel)
    for own in dependences(table):
        name = own.regressors[0]
        centres = np.bincount(own.cell, table.columns[name]) / np.bincount(own.cell)
        means = binned_means(own.cell, table.left, view.stretch)
        curve, errors = (np.array(means[key]) for key in ("means", "errors"))
        share = own.share if own.is_significant else 0.0
        found.append(ResidualCurve(channel, name, share, centres, curve, errors))
    return found


def _table(frame: Frame, error: EquationError, channel: str) -> ResidualTable:
    """Means of a balance's windows, (windows,)."""
    view = frame.windows[channel]
    columns = {n: view.average(v) for n, v in regressors(frame.traces, channel).items()}
    return ResidualTable(columns, view.average(error[channel]), view.run)
