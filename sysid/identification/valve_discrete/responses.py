"""Responses of candidate valves over one another (thesis 3.2.1, Figure 3.1).

Every valve fills and empties the same chamber from the same supply, by its own law with its own
delays: what differs is the valve. The chamber is held at its largest volume.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.blocks.drawing import plot_panels
from sysid.blocks.figures import PANEL, Dash, Figure, Line, Mark, Panel, Role, Rule, Scale
from sysid.blocks.numbers import estimate_cells, number
from sysid.blocks.sections import Block, FigureGroup, Fold
from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table, table
from sysid.estimation.linear import Estimate
from sysid.identification.valve_discrete.held_chamber import (
    DELAYS,
    FLOWS,
    DiscreteValve,
    HeldChamber,
    pressure_curve,
)
from sysid.io.rig import Rig
from sysid.parameters import Bundle, DiscreteLaw
from sysid.parameters.table import ParameterTable
from sysid.parameters.valves import VALVE_ALONE, WAYS
from sysid.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_DELAY_OF = dict(zip(WAYS, DELAYS, strict=True))
_WORDS = {"fill": "filling", "dis": "discharging"}
# Shares of the way to the settled pressure, whose times are listed; a curve is drawn to the last.
_LISTED_SHARES = (0.1, 0.5, 0.9)
_DRAWN_SHARE = 0.99
_CURVE_ROWS = 3000
_ROLES: tuple[Role, ...] = ("model", "second", "third", "fourth", "ink")
_DASHES: tuple[Dash, ...] = ("solid", "dashed", "dotted", "dash-dot")


@dataclass(frozen=True)
class Response:
    """One valve in one direction, "fill" or "dis": pressure (n,) Pa over time (n,) s since its
    command, and when it has gone a tenth, half and nine tenths of its way, with intervals."""

    valve: str
    way: str
    time: FloatArray
    pressure: FloatArray
    times: tuple[Estimate, ...]


@dataclass(frozen=True, repr=False)
class Responses(Shown):
    """Pressures of one chamber by several valves; `volume_m3`, `supply_pa`, `atmosphere_pa`."""

    responses: tuple[Response, ...]
    volume_m3: float
    supply_pa: float
    atmosphere_pa: float

    def headline(self) -> str:
        """Which valve is the quickest each way, in one line."""
        said = []
        for way, word in _WORDS.items():
            own = [r for r in self.responses if r.way == way]
            if len(own) > 1:
                first = min(own, key=lambda r: r.times[-1].value)
                said.append(f"{first.valve} in {number(1e3 * first.times[-1].value)} ms ({word})")
        return f"quickest to 90 % of the pressure: {', '.join(said)}"

    def records(self) -> list[dict[str, Any]]:
        """One record per valve and direction."""
        return [
            {
                "valve": r.valve,
                "direction": _WORDS[r.way],
                "volume_m3": self.volume_m3,
                "supply_pressure_pa": self.supply_pa,
                "atmospheric_pressure_pa": self.atmosphere_pa,
            }
            | {
                key: value
                for share, t in zip(_LISTED_SHARES, r.times, strict=True)
                for key, value in (
                    (f"time_to_{100 * share:.0f}_percent_s", t.value),
                    (f"time_to_{100 * share:.0f}_percent_std_s", t.std),
                )
            }
            for r in self.responses
        ]

    def tables(self) -> Iterable[Table]:
        """Times from the command, with intervals."""
        rows = [
            (r.valve, _WORDS[r.way], *(_in_ms(t) for t in r.times))
            for way in WAYS
            for r in self.responses
            if r.way == way
        ]
        columns = (
            "Valve",
            "Direction",
            *(f"{100 * s:.0f} % of the way (ms)" for s in _LISTED_SHARES),
        )
        caption = f"Responses from the command on: {self._chamber()}"
        yield table(caption, columns, rows, text=(1, *range(2, 2 + len(_LISTED_SHARES))))

    def plot(self, axes: Axes | Iterable[Axes] | None = None) -> list[Axes]:
        """Pressure over time, filling and discharging; returns the axes."""
        return plot_panels([figure.panels[0] for figure in self.figures()], axes)

    def figures(
        self, id: str = "fig-responses", size: tuple[float, float] = PANEL
    ) -> tuple[Figure, ...]:
        """Filling and discharging, a figure each (Figure 3.1)."""
        valves = list(dict.fromkeys(r.valve for r in self.responses))
        found = []
        for way, word in _WORDS.items():
            own = [r for r in self.responses if r.way == way]
            if not own:
                continue
            marks: list[Mark] = [Rule(0.0, is_upright=True)]
            for r in own:
                place = valves.index(r.valve)
                role, dash = _ROLES[place % len(_ROLES)], _DASHES[place % len(_DASHES)]
                marks.append(Line(1e3 * r.time, 1e-3 * r.pressure, role, r.valve, dash))
            described = "; ".join(
                f"{r.valve} half of the way in {_in_ms(r.times[1])} ms" for r in own
            )
            x, y = Scale("Time since the command", "ms"), Scale("Pressure", "kPa")
            found.append(
                Figure(
                    f"{id}-{way}",
                    word.capitalize(),
                    f"{word}: {described}.",
                    (Panel(x, y, (*marks,)),),
                    size=size,
                )
            )
        return tuple(found)

    def blocks(self, size: tuple[float, float] = PANEL) -> tuple[Block, ...]:
        """The figures with their caption, and the times, for a page."""
        caption = f"Responses over one another, as fitted: {self._chamber()}."
        times = Fold("Times of the responses", tuple(self.tables()))
        return (FigureGroup(caption, self.figures(size=size)), times)

    def _chamber(self) -> str:
        kpa = (number(1e-3 * p) for p in (self.supply_pa, self.atmosphere_pa))
        return f"{number(1e6 * self.volume_m3)} ml, {' kPa against '.join(kpa)} kPa"


def valve_of(
    law: DiscreteLaw,
    rig: Rig,
    ways: Iterable[str] = tuple(WAYS),
    moved: Mapping[str, float] | None = None,
) -> DiscreteValve | None:
    """The valve of a bundle's law; a delay that is not identified is the rig file's, or 0.

    None where a number of one of `ways` is not identified; those of other ways are placeholders.
    `moved`: numbers by key in place of the estimates.
    """
    delays = (rig.valves.on_delay_s, rig.valves.off_delay_s) if rig.valves else (0.0, 0.0)
    declared = dict(zip(DELAYS, delays, strict=True))
    values: dict[str, Any] = dict.fromkeys(FLOWS, 1.0)  # by ISO 6358 they are not used
    estimates, chosen = law.estimates(), moved or {}
    for name, key in _keys(law, ways).items():
        if not (found := estimates[key]).identified:
            return None
        values[name] = chosen.get(key, found.value)
    for name in DELAYS:
        delay = estimates.get(name)
        known = delay is not None and delay.identified
        values[name] = chosen.get(name, delay.value) if known and delay else declared[name]
    in_series = tuple(way for way, key in VALVE_ALONE.items() if key in values)
    return DiscreteValve(**values, in_series=in_series)


def _keys(law: DiscreteLaw, ways: Iterable[str]) -> dict[str, str]:
    """The law's numbers of these ways: fields of `DiscreteValve`, and keys of the law."""
    # The thesis law's critical ratios in the bundle are a check; the law itself has 0.53.
    keys = {**{key: key for key in law.thesis_keys().values()}, **law.iso_keys()}
    keys |= law.series_keys()
    flow_ways = {key: way for way in WAYS for key in FLOWS if f"_{way}" in key}
    return {
        name: key
        for name, key in keys.items()
        if flow_ways.get(name, name.rsplit("_", 1)[1]) in tuple(ways)
    }


def valve_responses(candidates: Sequence[tuple[str, Bundle, str]]) -> Responses | None:
    """Responses of the valves of `candidates` (a name, its bundle, its side) in one chamber.

    The chamber, the supply and the atmosphere are those of the first one's rig. A direction whose
    numbers are not identified has none; None where no two valves share one, or the rig file
    declares no chamber.
    """
    held = [(name, bundle, side) for name, bundle, side in candidates if _law(bundle, side)]
    if len(held) < 2:
        return None
    rig = held[0][1].rig
    volume = _largest_volume(rig, held[0][2])
    if rig.air is None or volume is None:
        return None
    air = rig.air
    gain = air.heat_capacity_ratio * air.gas_constant_j_per_kg_k * air.temperature_k / volume
    found: list[Response] = []
    for way in WAYS:
        own = []
        for name, bundle, side in held:
            made = _Candidate.of(name, bundle, side, way, rig, gain)
            own += [] if made is None else [made]
        if len(own) > 1:
            horizon = max(one.horizon() for one in own)
            found += [one.response(horizon) for one in own]
    if not found:
        return None
    return Responses(tuple(found), volume, air.supply_pressure_pa, air.atmospheric_pressure_pa)


def _law(bundle: Bundle, side: str) -> DiscreteLaw | None:
    return bundle.valve(side).discrete


def _largest_volume(rig: Rig, side: str) -> float | None:
    """The volume of a side's chamber with the piston at its far end, or a tank's, m3."""
    if rig.held_tank is not None:
        return rig.held_tank.volume_m3
    if (own := rig.cylinder) is None:
        return None
    offset, area = (
        (own.offset_a_m, own.area_a_m2) if side == "a" else (own.offset_b_m, own.area_b_m2)
    )
    return (offset + 0.5 * own.stroke_m) * area


@dataclass(frozen=True)
class _Candidate:
    """One valve in one direction, in the common chamber."""

    name: str
    way: str
    law: DiscreteLaw
    table: ParameterTable
    rig: Rig
    common: Rig
    gain: float

    @classmethod
    def of(
        cls, name: str, bundle: Bundle, side: str, way: str, common: Rig, gain: float
    ) -> _Candidate | None:
        """None where the direction is not identified."""
        law = _law(bundle, side)
        if law is None or valve_of(law, bundle.rig, (way,)) is None:
            return None
        table = bundle.parameters.parts()[f"valves.{side}.discrete"]
        return cls(name, way, law, table, bundle.rig, common, gain)

    @property
    def ends(self) -> tuple[float, float]:
        """The pressures of start and end, Pa."""
        air = self.common.require("air", "which the chamber equations need")
        ends = air.atmospheric_pressure_pa, air.supply_pressure_pa
        return ends if self.way == "fill" else (ends[1], ends[0])

    def curve(self, end: float, moved: Mapping[str, float] | None = None) -> FloatArray:
        """Pressure at `_CURVE_ROWS` times from the command to `end` s."""
        air = self.common.require("air", "which the chamber equations need")
        supplied = self.rig.air or air
        valve = valve_of(self.law, self.rig, (self.way,), moved)
        assert valve is not None
        never, command, whole = np.zeros(0), np.zeros(1), np.array([np.inf])
        fills, bleeds = (command, whole), None
        if self.way == "dis":
            fills = (-whole, command)
            if self.rig.bleeds:
                fills, bleeds = (never, never), (command, whole)
        chamber = HeldChamber(
            np.linspace(0.0, end, _CURVE_ROWS),
            *fills,
            self.gain,
            np.zeros(1),
            np.array([air.supply_pressure_pa]),
            supplied.supply_pressure_pa,
            air.temperature_k,
            bleeds,
        )
        return pressure_curve(chamber, valve, self.ends[0], 0.0, air.atmospheric_pressure_pa)

    def horizon(self) -> float:
        """When it has gone nearly all of its way, s."""
        end = 1e-3
        for _ in range(40):
            time = float(self._crossings(end, (_DRAWN_SHARE,))[0])
            if math.isfinite(time):
                return time
            end *= 2.0
        return end

    def response(self, end: float) -> Response:
        """Its curve to `end` s, with its times."""
        time = np.linspace(0.0, end, _CURVE_ROWS)
        return Response(self.name, self.way, time, self.curve(end), self._times(end))

    def _times(self, end: float) -> tuple[Estimate, ...]:
        """When it has gone each share of its way, with errors that follow from its numbers'."""
        values = self._crossings(end, _LISTED_SHARES)
        names = (*_keys(self.law, (self.way,)).values(), _DELAY_OF[self.way])
        known = self.table.estimates
        keys = [key for key in names if key in known and known[key].has_error]
        if not keys:
            return tuple(Estimate(float(v), math.nan, "s", (math.nan, math.nan)) for v in values)
        slopes = np.zeros((len(_LISTED_SHARES), len(keys)))
        for i, key in enumerate(keys):
            step, value = known[key].std, known[key].value
            ahead, behind = (
                self._crossings(1.1 * end, _LISTED_SHARES, {key: value + part * step})
                for part in (0.5, -0.5)
            )
            slopes[:, i] = (ahead - behind) / step
        variances = np.diag(slopes @ self.table.covariance(keys) @ slopes.T)
        freedom = min(known[key].degrees_of_freedom for key in keys)
        return tuple(
            Estimate.symmetric(float(value), math.sqrt(max(float(variance), 0.0)), "s", freedom)
            for value, variance in zip(values, variances, strict=True)
        )

    def _crossings(
        self, end: float, shares: Sequence[float], moved: Mapping[str, float] | None = None
    ) -> FloatArray:
        """When the pressure has gone these shares of its way, s; NaN where it has not by `end`."""
        first, last = self.ends
        gone = (self.curve(end, moved) - first) / (last - first)
        time = np.linspace(0.0, end, _CURVE_ROWS)
        return np.interp(shares, gone, time, right=math.nan)


def _in_ms(time: Estimate) -> str:
    """A time with its interval in ms."""
    shown = dataclasses.replace(time.times(1e3), unit="")
    value, _, interval, _ = estimate_cells(shown)
    return f"{value} ({interval.strip('()')})" if time.has_interval else value


__all__ = ["Response", "Responses", "valve_of", "valve_responses"]
