"""The remainder that no effect explains: the regressor it depends on most, and its curve."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid.diagnosis.actuator.breakaways import rest_before
from sysid.diagnosis.actuator.equation_error import (
    BALANCES,
    BREAKAWAY,
    EFFORT,
    EquationError,
    equation_error,
)
from sysid.diagnosis.actuator.samples import Traces
from sysid.diagnosis.actuator.whitening import Frame
from sysid.diagnosis.binning import binned_means, bins_of, predicted_share
from sysid.diagnosis.remainder import Remainder, ResidualTable, remainder
from sysid.io.rig import Rig
from sysid.types import FloatArray, IntArray

if TYPE_CHECKING:
    from sysid.diagnosis.actuator.loop import Loop


BINS = 12
# Windows averaged before searching for a curve: noise falls, slow structure stays.
_GROUP = 4
_LEAST_IN_BIN = 8
# Training tests are left out in so many folds, to say what repeats.
_FOLDS = 4
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


def faintest(found: Loop) -> tuple[ResidualCurve, ...]:
    """The strongest dependence in any channel, where none is large enough to count."""
    entries = _strongest(found, BALANCES)
    return tuple(sorted(entries, key=lambda e: -e.share)[:1])


def _strongest(found: Loop, channels: Sequence[str]) -> tuple[ResidualCurve, ...]:
    """Each channel's dependence on its strongest regressor."""
    if not channels:
        return ()
    last = found.search.last
    error = equation_error(last.frame.traces, last.model)
    strongest = (next(iter(curves(last.frame, error, channel)), None) for channel in channels)
    return tuple(curve for curve in strongest if curve is not None)


def remainders(found: Loop, rig: Rig) -> tuple[Remainder, ...]:
    """How much of each balance's residual repeats when training tests are left out in turn.

    Of its windows' means, in the balance's unit; noise as a twin shows it.
    """
    last = found.search.last
    frame = last.frame
    error = equation_error(frame.traces, last.model)
    rests = []
    for channel in BALANCES:
        view = frame.windows[channel]
        table = ResidualTable.of(
            {n: view.average(v) for n, v in regressors(frame.traces, channel).items()},
            view.average(error[channel]),
            view.run,
        )
        noise = math.sqrt(float(found.colour.covariance[channel][0]))
        unit = _RATE if channel != EFFORT else rig.units.effort
        name = log_channel(channel, rig)
        rests.append(remainder(table, None, _folds(view.run), noise, name, unit))
    return tuple(rest for rest in rests if rest is not None)


def repeating(
    found: Loop, rests: Sequence[Remainder], structured: Sequence[ResidualCurve], rig: Rig
) -> tuple[ResidualCurve, ...]:
    """The strongest curve of each further channel whose remainder repeats, and is large.

    Beside those that are `structured` already. Large: more than the noise, and than a tenth of
    what the model left over without effects.
    """
    known = {log_channel(curve.channel, rig) for curve in structured}
    channels = {log_channel(channel, rig): channel for channel in BALANCES}
    open_ones = [r for r in rests if r.channel not in known and r.is_steady]
    if not open_ones:
        return ()
    first = found.search.first
    error = equation_error(first.frame.traces, first.model)
    large = []
    for rest in open_ones:
        channel = channels[rest.channel]
        before = first.frame.windows[channel].average(error[channel])
        if rest.is_large(math.sqrt(float(np.mean(before**2)))):
            large.append(channel)
    return _strongest(found, large)


def log_channel(channel: str, rig: Rig) -> str:
    """The channel of the log format whose balance a residual is of."""
    return rig.position_channel if channel == EFFORT else f"pressure_{channel[-1]}_pa"


def regressors(traces: Traces, channel: str) -> dict[str, FloatArray]:
    """What a residual may depend on, (n,) each, by name."""
    if channel == BREAKAWAY:
        return {"rest": rest_before(traces), "angle": traces.position, "time": traces.time}
    # Neither the acceleration for the effort nor a pressure's own rate for its rate: they
    # hold the noise that the residual holds.
    t = traces
    found = {
        "velocity": t.velocity,
        "angle": t.position,
        "pressure_a": t.pressure_a,
        "pressure_b": t.pressure_b,
        "pressure_difference": t.pressure_a - t.pressure_b,
        "time": t.time,
        "motor": t.motor,
    }
    if channel == EFFORT:
        found["pressure_sum times direction"] = (t.pressure_a + t.pressure_b) * t.direction
        found["angle times direction"] = (t.position - t.position.min() + 0.1) * t.direction
    else:
        found["valve_opening"] = t.open_a if channel.endswith("a") else t.open_b
        found["acceleration"] = t.acceleration
    return found


def curves(frame: Frame, error: EquationError, channel: str) -> list[ResidualCurve]:
    """The residual's dependence on every regressor, the strongest first."""
    view = frame.windows[channel]
    if len(view) < _GROUP * BINS * _LEAST_IN_BIN:
        return []
    values = _grouped(view.average(error[channel]), view.stretch)
    stretch, run = (
        _grouped(labels, view.stretch).astype(np.intp) for labels in (view.stretch, view.run)
    )
    folds = _folds(run)
    found = []
    for name, regressor in regressors(frame.traces, channel).items():
        own = _grouped(view.average(regressor), view.stretch)
        place, _ = bins_of(own, BINS, _LEAST_IN_BIN)
        share = predicted_share(values, place, run, folds)
        centres = np.bincount(place, own) / np.bincount(place)
        means = binned_means(place, values, stretch)
        found.append(
            ResidualCurve(
                channel, name, share, centres, np.array(means["means"]), np.array(means["errors"])
            )
        )
    return sorted(found, key=lambda c: -c.share)


def _folds(run: IntArray) -> list[list[int]]:
    """Tests that are left out together; none of a single test."""
    tests = np.unique(run)
    folds = [tests[k::_FOLDS].tolist() for k in range(min(_FOLDS, len(tests)))]
    return folds if len(folds) > 1 else []


def _grouped(values: FloatArray | IntArray, stretch: IntArray) -> FloatArray:
    """Means of _GROUP windows in a row; groups that span two stretches are left out."""
    count = len(values) // _GROUP
    table = values[: count * _GROUP].reshape(count, _GROUP)
    same = stretch[: count * _GROUP].reshape(count, _GROUP)
    return np.asarray(table[same[:, 0] == same[:, -1]].mean(axis=1))
