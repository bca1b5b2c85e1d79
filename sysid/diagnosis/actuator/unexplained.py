"""The remainder that no effect explains: the regressor it depends on most, and its curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sysid.diagnosis.actuator.equation_error import CHANNELS, EFFORT, EquationError, equation_error
from sysid.diagnosis.actuator.samples import Traces
from sysid.diagnosis.actuator.whitening import Frame
from sysid.io.rig import Rig
from sysid.types import FloatArray

if TYPE_CHECKING:
    from sysid.diagnosis.actuator.loop import Loop


BINS = 12
# Windows averaged before searching for a curve: noise falls, slow structure stays.
_GROUP = 4
_LEAST_IN_BIN = 8
# A channel's excess counts beyond this many of the twins' spreads, and beyond this share of
# what the effects explained there.
_SPREADS = 8.0
_TOLERATED = 0.2


@dataclass(frozen=True)
class ResidualCurve:
    """Mean residual over a regressor, in bins of equal count: (bins,) each, and its share.

    `share`: of the residual's variance in the channel, 0 to 1, adjusted for the bins.
    `centres` in the regressor's unit, `means` and `errors` (standard errors) in the
    residual's: Nm or N for `effort`, Pa/s for rates.
    """

    channel: str
    regressor: str
    share: float
    centres: FloatArray
    means: FloatArray
    errors: FloatArray


@dataclass(frozen=True)
class Unexplained:
    """Remaining structure: channel (log format), regressor, share of the residual's variance."""

    channel: str
    regressor: str
    share: float
    curve: ResidualCurve

    def to_json(self) -> dict[str, Any]:
        """As `sysid diagnose --json` prints it (spec/cli.md)."""
        return {"channel": self.channel, "regressor": self.regressor, "share": self.share}


def leftover(found: Loop, rig: Rig) -> tuple[Unexplained, ...]:
    """Channels whose residual still holds structure, each with its strongest regressor.

    The real form of an effect is seldom the catalogue's: a remainder that is small against
    what the effects explained is that difference, and not another effect.
    """
    search, null = found.search, found.null
    before, after = null.excess(search.first), null.excess(search.last)
    left = []
    for channel, excess in after.items():
        spread = null.spread(search.last, channel)
        if excess >= max(_SPREADS * spread, _TOLERATED * (before[channel] - excess)):
            left.append(channel)
    return _strongest(found, rig, left)


def faintest(found: Loop, rig: Rig) -> tuple[Unexplained, ...]:
    """The strongest dependence in any channel, where none is large enough to count."""
    entries = _strongest(found, rig, CHANNELS)
    return tuple(sorted(entries, key=lambda e: -e.share)[:1])


def _strongest(found: Loop, rig: Rig, channels: Sequence[str]) -> tuple[Unexplained, ...]:
    """Each channel's dependence on its strongest regressor."""
    if not channels:
        return ()
    last = found.search.last
    error = equation_error(last.frame.traces, last.model)
    entries = []
    for channel in channels:
        best = next(iter(curves(last.frame, error, channel)), None)
        if best is not None:
            name = rig.position_channel if channel == EFFORT else f"pressure_{channel[-1]}_pa"
            entries.append(Unexplained(name, best.regressor, best.share, best))
    return tuple(entries)


def regressors(traces: Traces, channel: str) -> dict[str, FloatArray]:
    """What a residual may depend on, (n,) each, by name."""
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
    found = []
    for name, regressor in regressors(frame.traces, channel).items():
        own = _grouped(view.average(regressor), view.stretch)
        found.append(_curve(channel, name, own, values))
    return sorted(found, key=lambda c: -c.share)


def _grouped(values: FloatArray, stretch: NDArray[np.intp]) -> FloatArray:
    """Means of _GROUP windows in a row; groups that span two stretches are left out."""
    count = len(values) // _GROUP
    table = values[: count * _GROUP].reshape(count, _GROUP)
    same = stretch[: count * _GROUP].reshape(count, _GROUP)
    return np.asarray(table[same[:, 0] == same[:, -1]].mean(axis=1))


def _curve(channel: str, name: str, regressor: FloatArray, values: FloatArray) -> ResidualCurve:
    edges = np.unique(np.quantile(regressor, np.linspace(0.0, 1.0, BINS + 1)))
    place = np.clip(np.searchsorted(edges, regressor, side="right") - 1, 0, max(len(edges) - 2, 0))
    counts = np.bincount(place)
    keep = counts >= _LEAST_IN_BIN
    safe = np.maximum(counts, 1)
    means = np.bincount(place, values) / safe
    centres = np.bincount(place, regressor) / safe
    inside = values - means[place]
    spread = np.bincount(place, inside**2) / np.maximum(counts - 1, 1)
    total = float(np.mean(values**2))
    freedom = max(len(values) - len(means), 1)
    share = 1.0 - float(inside @ inside) / freedom / total if total > 0.0 else 0.0
    return ResidualCurve(
        channel, name, max(share, 0.0), centres[keep], means[keep], np.sqrt(spread / safe)[keep]
    )
