"""Pressure of one chamber with the piston held, in closed form (thesis 3.5.2 to 3.6.10).

With the volume constant, 3.5.2 is dP/dt = (k R T / V) m(P), and each regime of the valve law
has a solution: choked flow a straight line in time, unchoked filling a parabola that ends at
the supply, the unchoked exhaust an exponential. Regimes and valve edges are joined at their
exact times, so the curve depends continuously on every parameter, delays included. A direction
that obeys ISO 6358 follows `iso_curve` in the thesis' place.
"""

from __future__ import annotations

import math
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
    time = chamber.time
    edges = delayed(chamber.opens, chamber.closes, valve.on_delay_s, valve.off_delay_s)
    breaks = sorted({*edges.opens.tolist(), *edges.closes.tolist(), *chamber.supply_from.tolist()})
    bled = None
    if chamber.bleeds is not None:
        bled = delayed(*chamber.bleeds, valve.on_delay_s, valve.off_delay_s)
        breaks = sorted({*breaks, *bled.opens.tolist(), *bled.closes.tolist()})
    starts = [float(time[0]), *(b for b in breaks if time[0] < b < time[-1])]
    rows = [*np.searchsorted(time, starts).tolist(), len(time)]
    is_open = edges.is_open(np.array(starts))
    empties = ~is_open if bled is None else bled.is_open(np.array(starts))
    which = np.maximum(np.searchsorted(chamber.supply_from, starts, side="right") - 1, 0)
    pressure = np.empty(len(time))
    level = initial
    for i, start in enumerate(starts):
        # The rows of this segment and, last, its end, where the next one starts.
        elapsed = np.empty(rows[i + 1] - rows[i] + 1)
        elapsed[:-1] = time[rows[i] : rows[i + 1]]
        elapsed[-1] = starts[i + 1] if i + 1 < len(starts) else time[-1]
        elapsed -= start
        if is_open[i]:
            supply = float(chamber.supply[which[i]]) + supply_shift
            values = _filling(chamber, valve, level, supply, elapsed)
        elif empties[i]:
            values = _exhausting(chamber, valve, level, atmosphere, elapsed)
        else:
            values = np.full(len(elapsed), level)
        pressure[rows[i] : rows[i + 1]] = values[:-1]
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
    root = np.maximum(math.sqrt(supply - start) - half_rate * rest, 0.0)
    return np.where(rest < 0.0, initial + rate * elapsed, supply - root**2)


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
    decay = np.exp(-chamber.gain * valve.c_dis * np.maximum(rest, 0.0))
    fallen = atmosphere + (start - atmosphere) * decay
    return np.where(rest < 0.0, initial - rate * elapsed, fallen)
