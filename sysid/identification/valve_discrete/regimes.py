"""The thesis' evaluation of a valve-discrete test: the interval of each regime alone (3.5.3).

Choked flow from the slope of the linear interval, c_fill from the slope of sqrt(Ps - P) over
time, c_dis from that of log(P - P0), and the delays from where the linear intervals leave
the level before them. These values start the fit of the whole curve, and show which
parameters the test can identify.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.identification.valve_discrete.trials import (
    DISCHARGING,
    EDGE_GUARD_S,
    FILLING,
    Piece,
)
from sysid.plant.base import CRITICAL_RATIO
from sysid.types import FloatArray

# Smallest number of rows of an interval that is used.
FEWEST_ROWS = 3
# Distance from a regime's ends, in standard deviations of the noise.
_MARGIN = 4.0
# Share of the way between supply and atmosphere, at its end, which noise determines.
_NEAR_REST = 0.03
_NO_ROW = "no row lies before the valve is switched on"


@dataclass
class Stretches:
    """Estimates from one piece's intervals: values by parameter, and why others are missing.

    `sparse`: flows whose interval the pressure crosses in too few samples to read a slope, and
    the delay before a choked interval of which at least one sample shows when it was crossed.
    """

    values: dict[str, float] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)
    sparse: set[str] = field(default_factory=set)

    def miss(self, name: str, why: str) -> None:
        self.reasons.setdefault(name, why)

    def miss_sparse(self, name: str, why: str) -> None:
        """The pressure crosses the flow's interval, in too few samples."""
        self.sparse.add(name)
        self.miss(name, why)

    def add(self, names: Sequence[str], each: Sequence[Stretches]) -> None:
        """What any of `each` shows of these names; why none does."""
        for name in names:
            values = [one.values[name] for one in each if name in one.values]
            if values:
                self.values[name] = values[0]
            elif all(name in one.reasons for one in each):
                self.miss(name, each[0].reasons[name])
                self.sparse |= {name} & set().union(*(one.sparse for one in each))

    def miss_choked(self, flow: str, delay: str, part: str, rows: slice) -> None:
        """Too few samples in a choked interval; `rows`: those between its very ends."""
        why = f"fewer than 3 samples lie in the linear (choked) part of {part}: log faster"
        self.miss_sparse(flow, why)
        self.miss(delay, why)
        if rows.stop > rows.start:
            self.sparse.add(delay)


_Reader = Callable[[Piece, float, float, Stretches], None]


def read_stretches(piece: Piece) -> Stretches:
    """Read every filling and every discharge of a piece: what any of them shows, it shows."""
    c, found = piece.chamber, Stretches()
    if piece.way < 0.0:
        found.miss("choked_flow_fill_kg_s", _UNCHOKED)
        found.miss("choked_flow_dis_kg_s", _UNCHOKED)
    each = zip(c.opens.tolist(), c.closes.tolist(), strict=True)
    fills = [(begin, end) for begin, end in each if begin <= c.time[-1]]
    if fills:
        filling = _filling if piece.way > 0.0 else _vacuum_filling
        found.add(FILLING, [_read(filling, piece, *each) for each in fills])
    else:
        _no_filling(found, f"the {'' if c.bleeds is None else 'fill '}valve is never switched on")
    commanded = _emptyings(piece)
    empties = [each for each in commanded if each[0] <= c.time[-1]]
    if empties:
        discharge = _discharge if piece.way > 0.0 else _vacuum_discharge
        found.add(DISCHARGING, [_read(discharge, piece, *each) for each in empties])
    elif any(math.isfinite(begin) for begin, _ in commanded):
        _no_discharge(found, _no_row_before(piece))
    elif c.bleeds is None:
        _no_discharge(found, "the valve is not switched off again: record longer")
    else:
        _no_discharge(found, "the bleed valve is never switched on")
    if c.bleeds is not None:
        _of_opening(found)
    return found


def _emptyings(piece: Piece) -> list[tuple[float, float]]:
    """From when and until when, s, the piece's chamber is commanded to empty."""
    c = piece.chamber
    if c.bleeds is None and len(c.opens) == 0:
        return [(-math.inf, math.inf)]
    return [(b, e) for b, e in zip(*(x.tolist() for x in c.empties), strict=True) if e > c.time[0]]


def _read(read: _Reader, piece: Piece, begin: float, end: float) -> Stretches:
    found = Stretches()
    read(piece, begin, end, found)
    return found


_CLOSING = (
    "no flow shows when a valve closes: the rig file's delay is used; both valves' openings show "
    "on_delay_s"
)


def _of_opening(found: Stretches) -> None:
    """The delay of a discharge by a valve of its own: that of its opening, as the other one's."""
    opening = found.values.pop("off_delay_s", None)
    found.reasons["off_delay_s"] = _CLOSING
    found.sparse.discard("off_delay_s")
    if opening is not None and "on_delay_s" not in found.values:
        found.values["on_delay_s"] = opening
        found.reasons.pop("on_delay_s", None)


_UNCHOKED = "a vacuum's flow is not choked by the thesis' law: no test identifies it"


def _vacuum_filling(piece: Piece, opened: float, closed: float, found: Stretches) -> None:
    """A chamber that a vacuum empties: sqrt(P - Ps) falls in proportion to time."""
    c = piece.chamber
    root = np.sqrt(np.maximum(piece.pressure - piece.supply, 0.0))
    slope = _fall(root, math.sqrt(_least_of_vacuum(piece)), c.time, (opened, closed))
    if slope is None:
        why = "the pressure does not fall towards the supply while the valve is on"
        _no_filling(found, f"{why}: hold it on longer, or log faster")
    else:
        found.values["c_fill"] = -2.0 * slope / c.gain
    if not np.any(c.time < opened):
        found.miss("on_delay_s", _NO_ROW)


def _vacuum_discharge(piece: Piece, begin: float, end: float, found: Stretches) -> None:
    """A chamber that the atmosphere fills again: log(P0 - P) falls in proportion to time."""
    c = piece.chamber
    below = np.maximum(piece.atmosphere - piece.pressure, 1.0)
    slope = _fall(np.log(below), math.log(_least_of_vacuum(piece)), c.time, (begin, end))
    if slope is None:
        why = f"the pressure does not rise to the atmosphere after {_emptied_by(piece)}"
        _no_discharge(found, f"{why}: record longer, or log faster")
    else:
        found.values["c_dis"] = -slope / c.gain


def _least_of_vacuum(piece: Piece) -> float:
    """Distance from rest, Pa, below which noise determines a vacuum's pressure."""
    return max(1.5 * _MARGIN * piece.noise, _NEAR_REST * (piece.atmosphere - piece.supply))


def _emptied_by(piece: Piece) -> str:
    """What begins a discharge, in words."""
    return "switching off" if piece.chamber.bleeds is None else "the bleed valve is switched on"


def _no_row_before(piece: Piece) -> str:
    hidden = ", where the sensor is saturated" if piece.saturated else ""
    return f"no usable row lies right before {_emptied_by(piece)}{hidden}"


def _fall(
    values: FloatArray, least: float, time: FloatArray, span: tuple[float, float]
) -> float | None:
    """Slope, 1/s, of values (n,) within a span of time, s, until they are first below the least;
    None where they are too few, or do not fall."""
    rows = np.flatnonzero((time >= span[0] + EDGE_GUARD_S * 0.1) & (time < span[1]))
    low = np.flatnonzero(values[rows] < least)
    rows = rows[: int(low[0])] if len(low) else rows
    if len(rows) < FEWEST_ROWS:
        return None
    slope = float(np.polyfit(time[rows] - time[rows[0]], values[rows], 1)[0])
    return slope if slope < 0.0 else None


def _no_filling(found: Stretches, why: str) -> None:
    for name in FILLING:
        found.miss(name, why)


def _no_discharge(found: Stretches, why: str) -> None:
    for name in DISCHARGING:
        found.miss(name, why)


def _filling(piece: Piece, opened: float, closed: float, found: Stretches) -> None:
    c, margin, supply = piece.chamber, _MARGIN * piece.noise, piece.supply
    rows = (c.time >= opened) & (c.time < closed)
    t, p = c.time[rows], piece.pressure[rows]
    if len(p) < FEWEST_ROWS:
        _no_filling(found, "fewer than 3 samples lie between on and off: hold the valve on longer")
        return
    boundary = CRITICAL_RATIO * supply
    before = piece.pressure[(c.time <= opened) & (c.time > opened - EDGE_GUARD_S)]
    level = float(np.median(before)) if len(before) else float(p[0])
    top = float(np.max(_smooth(p)))
    if top - level < 10.0 * piece.noise and level < boundary:
        why = f"the pressure stays at {level:.6g} Pa when the valve is switched on"
        _no_filling(found, f"{why}: is this the other valve, or another chamber's sensor?")
        return
    begun = not np.any(c.time < opened)
    if begun and level > 0.95 * supply:
        why = "the chamber is already filled in the first row: start with the valve off"
        _no_filling(found, why)
        return
    if begun:
        found.miss("on_delay_s", _NO_ROW)
    line = _line(t, p, level + margin, boundary - margin)
    if level > boundary - 2.0 * margin:
        why = f"the filling starts at {level:.6g} Pa, not below the choked boundary of"
        found.miss("choked_flow_fill_kg_s", f"{why} {boundary:.6g} Pa: start from the atmosphere")
    elif line is None:
        inside = _between(p, level + 0.5 * margin, boundary)
        found.miss_choked("choked_flow_fill_kg_s", "on_delay_s", "the filling", inside)
    else:
        flow = line.slope / c.gain
        found.values["choked_flow_fill_kg_s"] = flow * c.supply_reference / supply
        if "on_delay_s" not in found.reasons:
            found.values["on_delay_s"] = line.crossing(level) - opened
    _parabola(t - t[0], p, boundary, supply, piece, top, found)


def _parabola(
    t: FloatArray,
    p: FloatArray,
    boundary: float,
    supply: float,
    piece: Piece,
    top: float,
    found: Stretches,
) -> None:
    margin = _MARGIN * piece.noise
    ceiling = supply - max(1.5 * margin, 0.02 * (supply - boundary))
    rows = _between(p, boundary + margin, ceiling)
    if rows.stop - rows.start < FEWEST_ROWS:
        if top < boundary + 2.0 * margin:
            fix = (
                "use a sensor of a larger range" if piece.saturated else "hold the valve on longer"
            )
            found.miss(
                "c_fill",
                f"the filling never reaches the unchoked interval (highest pressure {top:.6g} Pa, "
                f"choked boundary {boundary:.6g} Pa): {fix}",
            )
        else:
            why = "fewer than 3 samples lie in the unchoked interval of the filling: log faster"
            found.miss_sparse("c_fill", why)
        return
    root = np.sqrt(np.maximum(supply - p[rows], 0.0))
    slope = float(np.polyfit(t[rows], root, 1)[0])
    if slope < 0.0:
        found.values["c_fill"] = -2.0 * slope / piece.chamber.gain
    else:
        found.miss("c_fill", "the pressure does not rise in the unchoked interval of the filling")


def _discharge(piece: Piece, closed: float, following: float, found: Stretches) -> None:
    c, margin, p0 = piece.chamber, _MARGIN * piece.noise, piece.atmosphere
    rows = (c.time >= closed) & (c.time < following)
    t, p = c.time[rows], piece.pressure[rows]
    if len(p) < FEWEST_ROWS:
        why = f"fewer than 3 samples lie after {_emptied_by(piece)}: record longer"
        _no_discharge(found, why)
        return
    boundary = p0 / CRITICAL_RATIO
    before = piece.pressure[(c.time < closed) & (c.time > closed - EDGE_GUARD_S)]
    if not len(before):
        found.miss("off_delay_s", _no_row_before(piece))
        before = p[:3]
    level, bottom = float(np.median(before)), float(np.min(_smooth(p)))
    if level < boundary + 2.0 * margin:
        why = (
            f"the discharge is never choked (it starts at {level:.6g} Pa, choked boundary "
            f"{boundary:.6g} Pa): fill further before {_emptied_by(piece)}"
        )
        found.miss("choked_flow_dis_kg_s", why)
        _exponential(t, p, boundary, piece, bottom, found)
        return
    line = _line(t, -p, -level + margin, -boundary - margin)
    if line is None:
        inside = _between(-p, -level + 0.5 * margin, -boundary)
        found.miss_choked("choked_flow_dis_kg_s", "off_delay_s", "the discharge", inside)
    else:
        found.values["choked_flow_dis_kg_s"] = line.slope / c.gain
        if "off_delay_s" not in found.reasons:
            found.values["off_delay_s"] = line.crossing(-level) - closed
    _exponential(t, p, boundary, piece, bottom, found)


def _exponential(
    t: FloatArray, p: FloatArray, boundary: float, piece: Piece, bottom: float, found: Stretches
) -> None:
    p0, margin = piece.atmosphere, _MARGIN * piece.noise
    floor = p0 + max(2.0 * margin, 0.03 * (boundary - p0))
    rows = _between(-p, -boundary + margin, -floor)
    if rows.stop - rows.start < FEWEST_ROWS:
        if bottom > boundary - 2.0 * margin:
            found.miss(
                "c_dis",
                "the discharge never reaches the unchoked interval (lowest pressure "
                f"{bottom:.6g} Pa, choked boundary {boundary:.6g} Pa): record longer after "
                f"{_emptied_by(piece)}",
            )
        else:
            why = "fewer than 3 samples lie in the unchoked interval of the discharge: log faster"
            found.miss_sparse("c_dis", why)
        return
    slope = float(np.polyfit(t[rows], np.log(np.maximum(p[rows] - p0, 1.0)), 1)[0])
    if slope < 0.0:
        found.values["c_dis"] = -slope / piece.chamber.gain
    else:
        found.miss("c_dis", "the pressure does not fall in the unchoked interval of the discharge")


@dataclass(frozen=True)
class _Line:
    """A straight line through an interval: its slope, Pa/s, and when it passes a level, s."""

    start: float
    slope: float
    level: float

    def crossing(self, level: float) -> float:
        return self.start + (level - self.level) / self.slope


def _line(t: FloatArray, p: FloatArray, low: float, high: float) -> _Line | None:
    """The line through a rising signal between two levels; None without enough rows."""
    rows = _between(p, low, high)
    if rows.stop - rows.start < FEWEST_ROWS:
        return None
    start = float(t[rows.start])
    slope, level = (float(v) for v in np.polyfit(t[rows] - start, p[rows], 1))
    return _Line(start, slope, level) if slope > 0.0 else None


def _between(p: FloatArray, low: float, high: float) -> slice:
    """Rows of a rising signal from its first above `low` to its first above `high`."""
    above, beyond = np.flatnonzero(p > low), np.flatnonzero(p > high)
    start = int(above[0]) if len(above) else len(p)
    stop = int(beyond[0]) if len(beyond) else len(p)
    return slice(start, max(stop, start))


def _smooth(p: FloatArray) -> FloatArray:
    """Moving median over 5 samples, (n - 4,)."""
    return np.median(np.lib.stride_tricks.sliding_window_view(p, min(5, len(p))), axis=1)
