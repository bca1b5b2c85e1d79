"""Pressure of one chamber with the piston held, in closed form (thesis 3.5.2 to 3.6.10).

With the volume constant, 3.5.2 is dP/dt = (k R T / V) m(P), and each regime of the valve law
has a solution: choked flow a straight line in time, unchoked filling a parabola that ends at
the supply, the unchoked exhaust an exponential. Regimes and valve edges are joined at their
exact times, so the curve depends continuously on every parameter, delays included. A direction
that obeys ISO 6358 follows `iso_curve` in the thesis' place.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from sysid.identification.valve_discrete.iso_curve import IsoPath
from sysid.plant.base import CRITICAL_RATIO
from sysid.plant.flow_control import series_exhaust_boundary, series_filling_boundary
from sysid.plant.iso6358 import ANR_TEMPERATURE, DEFAULT_INDEX, choked_flow
from sysid.plant.valve_timing import delayed
from sysid.types import FloatArray

FLOWS = ("choked_flow_fill_kg_s", "c_fill", "choked_flow_dis_kg_s", "c_dis")
"""The numbers of the thesis' law, filling first."""
DELAYS = ("on_delay_s", "off_delay_s")
# Of central differences: at the delays themselves, and before and after each.
_DELAYS_KEPT = 1 + 2 * len(DELAYS)


@dataclass(frozen=True)
class DiscreteValve:
    """One valve's discrete law, its delays and its critical ratios.

    Choked flows kg/s (filling at the reference supply), `c_fill` kg/(s Pa^0.5), `c_dis`
    kg/(s Pa), delays s. A direction with a sonic conductance, m3/(s Pa) at ANR, obeys ISO 6358
    with it, the critical ratio and the subsonic index; the thesis' numbers of it are not used.
    `valve_c_fill`, `valve_c_dis`: the coefficients of the valve alone, where its tests were made
    with a flow control in series and without; a direction `in_series` chokes by the pressure
    between the two (thesis 3.6).
    """

    choked_flow_fill_kg_s: float
    c_fill: float
    choked_flow_dis_kg_s: float
    c_dis: float
    on_delay_s: float
    off_delay_s: float
    critical_ratio_fill: float = CRITICAL_RATIO
    critical_ratio_dis: float = CRITICAL_RATIO
    sonic_conductance_fill: float | None = None
    sonic_conductance_dis: float | None = None
    subsonic_index_fill: float = DEFAULT_INDEX
    subsonic_index_dis: float = DEFAULT_INDEX
    valve_c_fill: float | None = None
    valve_c_dis: float | None = None
    in_series: tuple[str, ...] = ()

    def with_numbers(self, names: Iterable[str], values: FloatArray) -> DiscreteValve:
        """The valve with these of its numbers: `dataclasses.replace`, which a fit that asks for it
        at each of its points would spend much of its time in."""
        copy = object.__new__(type(self))
        vars(copy).update(vars(self))
        vars(copy).update(zip(names, values.tolist(), strict=False))
        return copy

    def alone(self) -> DiscreteValve:
        """The valve without its flow control."""
        own = (self.valve_c_fill, self.valve_c_dis)
        fill, dis = (
            c if c is not None else both
            for c, both in zip(own, (self.c_fill, self.c_dis), strict=True)
        )
        return replace(self, c_fill=fill, c_dis=dis, in_series=())

    def filling_boundary(self, supply: float) -> float:
        """Chamber pressure, Pa, up to which filling is choked by the thesis' law."""
        if "fill" in self.in_series and self.valve_c_fill is not None:
            return float(series_filling_boundary(supply, self.valve_c_fill, self.c_fill))
        return self.critical_ratio_fill * supply

    def exhaust_boundary(self, atmosphere: float) -> float:
        """Chamber pressure, Pa, from which on the exhaust is choked by the thesis' law."""
        if "dis" in self.in_series and self.valve_c_dis is not None:
            return float(series_exhaust_boundary(atmosphere, self.valve_c_dis, self.c_dis))
        return atmosphere / self.critical_ratio_dis

    def iso_path(self, way: str, chamber: HeldChamber) -> IsoPath | None:
        """A direction, "fill" or "dis", by ISO 6358; None where it obeys the thesis' law."""
        conductance = getattr(self, f"sonic_conductance_{way}")
        if conductance is None:
            return None
        return IsoPath(
            chamber.gain * float(choked_flow(1.0, conductance, chamber.temperature)),
            getattr(self, f"critical_ratio_{way}"),
            getattr(self, f"subsonic_index_{way}"),
        )


@dataclass(frozen=True)
class HeldChamber:
    """What drives the chamber: valve times, volume and supply.

    `time` (n,) s; the valve is commanded on in [`opens`, `closes`) (s, minus infinity: on
    before the first row); `gain` k R T / V, Pa/kg; the supply is `supply` (m,) Pa from each
    of `supply_from` (m,) s on; choked filling holds at `supply_reference` Pa; `temperature` of
    the air in K. `bleeds`: when a second valve, which empties the chamber, is commanded on, as
    opens and closes; the chamber is shut while both are off. None: off, the one valve empties it.
    """

    time: FloatArray
    opens: FloatArray
    closes: FloatArray
    gain: float
    supply_from: FloatArray
    supply: FloatArray
    supply_reference: float
    temperature: float = ANR_TEMPERATURE
    bleeds: tuple[FloatArray, FloatArray] | None = None

    @property
    def empties(self) -> tuple[FloatArray, FloatArray]:
        """When the chamber is commanded to empty: from and until, s each."""
        if self.bleeds is not None:
            return self.bleeds
        return self.closes, np.append(self.opens[1:], np.inf)[: len(self.closes)]

    def segments(self, on_delay: float, off_delay: float) -> tuple[ChamberSegment, ...]:
        """The stretches without an edge at these delays, s, in order."""
        known, delays = self._segments, (on_delay, off_delay)
        if delays not in known:
            if len(known) == _DELAYS_KEPT:
                del known[next(iter(known))]
            known[delays] = self._segments_at(*delays)
        return known[delays]

    @functools.cached_property
    def _segments(self) -> dict[tuple[float, float], tuple[ChamberSegment, ...]]:
        """Those of the last delays: a fit varies its other numbers between."""
        return {}

    def _segments_at(self, on_delay: float, off_delay: float) -> tuple[ChamberSegment, ...]:
        time = self.time
        edges = delayed(self.opens, self.closes, on_delay, off_delay)
        breaks = sorted({*edges.opens.tolist(), *edges.closes.tolist(), *self.supply_from.tolist()})
        bled = None
        if self.bleeds is not None:
            bled = delayed(*self.bleeds, on_delay, off_delay)
            breaks = sorted({*breaks, *bled.opens.tolist(), *bled.closes.tolist()})
        starts = [float(time[0]), *(b for b in breaks if time[0] < b < time[-1])]
        rows = [*np.searchsorted(time, starts).tolist(), len(time)]
        is_open = edges.is_open(np.array(starts))
        empties = ~is_open if bled is None else bled.is_open(np.array(starts))
        which = np.maximum(np.searchsorted(self.supply_from, starts, side="right") - 1, 0)
        found = []
        for i, start in enumerate(starts):
            elapsed = np.empty(rows[i + 1] - rows[i] + 1)
            elapsed[:-1] = time[rows[i] : rows[i + 1]]
            elapsed[-1] = starts[i + 1] if i + 1 < len(starts) else time[-1]
            elapsed -= start
            supply = float(self.supply[which[i]]) if is_open[i] else None
            own = slice(rows[i], rows[i + 1])
            found.append(ChamberSegment(own, elapsed, supply, bool(empties[i])))
        return tuple(found)


@dataclass(frozen=True, eq=False)
class ChamberSegment:
    """A stretch of a chamber's rows in which no valve moves.

    `elapsed` s since its start, of its `rows` and, last, of its end, where the next one starts;
    the `supply` Pa that fills the chamber (None: nothing does), and whether it `empties`.
    """

    rows: slice
    elapsed: FloatArray
    supply: float | None
    empties: bool


def pressure_curve(
    chamber: HeldChamber,
    valve: DiscreteValve,
    initial: float,
    supply_shift: float,
    atmosphere: float,
) -> FloatArray:
    """Pressure (n,) Pa at the chamber's times, from `initial` Pa at the first of them.

    `supply_shift` Pa is added to the supply.
    """
    pressure = np.empty(len(chamber.time))
    level = initial
    for segment in chamber.segments(valve.on_delay_s, valve.off_delay_s):
        elapsed = segment.elapsed
        if segment.supply is not None:
            values = _filling(chamber, valve, level, segment.supply + supply_shift, elapsed)
        elif segment.empties:
            values = _exhausting(chamber, valve, level, atmosphere, elapsed)
        else:
            values = np.full(len(elapsed), level)
        pressure[segment.rows] = values[:-1]
        level = float(values[-1])
    return pressure


def _filling(
    chamber: HeldChamber,
    valve: DiscreteValve,
    initial: float,
    supply: float,
    elapsed: FloatArray,
) -> FloatArray:
    """Filling; by the thesis' 3.6.6 P0 + b t while choked, then Ps - (sqrt(Ps - P) - g t / 2)^2."""
    if (iso := valve.iso_path("fill", chamber)) is not None:
        return iso.pressure(initial, supply, elapsed)
    half_rate = 0.5 * chamber.gain * valve.c_fill
    if initial > supply:
        root = np.maximum(math.sqrt(initial - supply) - half_rate * elapsed, 0.0)
        return np.asarray(supply + root**2)
    boundary = valve.filling_boundary(supply)
    rate = chamber.gain * valve.choked_flow_fill_kg_s * supply / chamber.supply_reference
    start = max(initial, boundary)
    rest = elapsed - (start - initial) / rate
    # `elapsed` rises: each regime is worked out where it holds.
    k = int(rest.searchsorted(0.0))
    found = np.empty(len(elapsed))
    found[:k] = initial + rate * elapsed[:k]
    root = np.maximum(math.sqrt(supply - start) - half_rate * rest[k:], 0.0)
    found[k:] = supply - root**2
    return found


def _exhausting(
    chamber: HeldChamber,
    valve: DiscreteValve,
    initial: float,
    atmosphere: float,
    elapsed: FloatArray,
) -> FloatArray:
    """Emptying; by 3.6.7 and 3.6.10 P - d t while choked, then an exponential towards P0."""
    if (iso := valve.iso_path("dis", chamber)) is not None:
        return iso.pressure(initial, atmosphere, elapsed)
    boundary = valve.exhaust_boundary(atmosphere)
    rate = chamber.gain * valve.choked_flow_dis_kg_s
    start = min(initial, boundary)
    rest = elapsed - (initial - start) / rate
    k = int(rest.searchsorted(0.0))
    found = np.empty(len(elapsed))
    found[:k] = initial - rate * elapsed[:k]
    decay = np.exp(-chamber.gain * valve.c_dis * rest[k:])
    found[k:] = atmosphere + (start - atmosphere) * decay
    return found
