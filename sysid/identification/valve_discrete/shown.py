"""On/off valves as they are shown: parameters, measured and fitted pressure (Figures 3.7, 3.8)."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sysid.blocks.figures import (
    TALL_PANEL,
    Dash,
    Figure,
    Line,
    Mark,
    Panel,
    Points,
    Role,
    Rule,
    Scale,
)
from sysid.blocks.numbers import number, percent
from sysid.blocks.sections import Block, FigureGroup, Lines, Section
from sysid.blocks.tables import Table, table
from sysid.estimation.quality import root_mean_square
from sysid.identification.valve_discrete.held_chamber import (
    DELAYS,
    FLOWS,
    DiscreteValve,
    pressure_curve,
)
from sysid.identification.valve_discrete.responses import valve_of, valve_responses
from sysid.identification.valve_discrete.trials import Piece, is_switched, screen
from sysid.io.logs import Log
from sysid.io.own_channels import balance_unit
from sysid.io.rig import Rig
from sysid.parameters import Bundle, DiscreteLaw
from sysid.parameters.base import read_number
from sysid.parameters.valves import LAW_NAMES, SERIES, VALVE_ALONE, LawDecision
from sysid.plant.effects.catalogue import catalogue
from sysid.types import FloatArray

_STYLES: tuple[tuple[Role, Dash], ...] = (("second", "dashed"), ("third", "dotted"))
# Subsystems whose effects change the pressure of a held chamber.
_ON_PRESSURE = ("valve", "supply", "chamber", "sensor")


@dataclass(frozen=True)
class PressureCurve:
    """One test's pressure, measured and simulated: `time` (n,) s, pressures (n,) Pa.

    `opens` and `closes`: when the valve is switched, s. `rejected`: the pressure by the laws that
    were fitted and not chosen, by their names.
    """

    test: str
    time: FloatArray
    measured: FloatArray
    simulated: FloatArray
    opens: FloatArray = field(default_factory=lambda: np.zeros(0))
    closes: FloatArray = field(default_factory=lambda: np.zeros(0))
    rejected: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def rmse(self) -> float:
        """Pa."""
        return math.sqrt(float(np.mean((self.measured - self.simulated) ** 2)))


def discrete_section(
    bundle: Bundle, logs: Sequence[tuple[str | None, Log]], rig: Rig
) -> Section | None:
    """The section on a bundle's on/off valves and their logs; None where neither is fitted."""
    fitted = {} if bundle.valves is None else bundle.valves.discrete_laws()
    if not fitted:
        return None
    held = {side: law for side, law in fitted.items() if isinstance(law.tests, list) and law.tests}
    blocks: list[Block] = [_fit_table(held, is_alone=rig.is_tank_alone)] if held else []
    parts = bundle.parameters.parts()
    blocks += [parts[f"valves.{s}.discrete"].shown(f"Valve {s.upper()}") for s in fitted]
    decided = {s: law.choice for s, law in fitted.items() if isinstance(law.choice, LawDecision)}
    if decided:
        blocks.append(
            Lines(
                tuple(_decision_line(*one, is_alone=rig.is_tank_alone) for one in decided.items())
            )
        )
    drawn = {side: _curves(side, law, logs, rig) for side, law in fitted.items()}
    curves = {side: own for side, own in drawn.items() if own}
    if curves:
        blocks.append(_figures(curves, _effects_on_flow(bundle)))
    both = valve_responses([(f"valve {side.upper()}", bundle, side) for side in fitted])
    if both is not None:
        blocks += both.blocks()
    intro = (
        f"{_how(rig)}; flows, coefficients and delays are those whose simulated pressure is "
        "closest to the measured one."
        if held
        else "Coefficients are those whose simulated pressure is closest to the measured one while "
        "a tank of constant volume empties through the valve or port.",
    )
    return Section("valves", "On/off valves", intro, tuple(blocks))


def _how(rig: Rig) -> str:
    """How the tests of a valve are made, in words."""
    if rig.held_tank is not None:
        return "The volume is the tank's, and the valve is switched on and off again"
    if rig.bleeds:
        return "The piston is held, one valve fills the chamber, and another one empties it"
    return "The piston is held, and the valve is switched on and off again"


def _effects_on_flow(bundle: Bundle) -> tuple[str, ...]:
    """The effects of a bundle, by title, that change the pressure of a held chamber.

    The law's numbers were estimated together with them: without them it is another curve.
    """
    known = catalogue()
    found = (known[entry.id] for entry in bundle.effects if entry.id in known)
    return tuple(effect.title for effect in found if effect.subsystem in _ON_PRESSURE)


_PASCALS = re.compile(r"(?<![\w.])(\d[\d.]*(?:e[+-]\d+)?) Pa\b")


def _decision_line(side: str, decision: LawDecision, *, is_alone: bool) -> str:
    """Why a valve has its law, as a sentence, its errors in the unit of the table above it."""
    unit, scale = balance_unit("Pa", is_alone=is_alone)
    why = _PASCALS.sub(lambda m: f"{number(scale * float(m[1]))} {unit}", decision.why)
    return f"Flow law of valve {side.upper()}: {why}."


def _fit_table(fitted: Mapping[str, DiscreteLaw], *, is_alone: bool) -> Table:
    unit, scale = balance_unit("Pa", is_alone=is_alone)
    found = {
        side: [read_number(n) for n in (law.rmse_pa, law.noise_pa)] for side, law in fitted.items()
    }
    rows = [
        (
            f"Valve {side.upper()}",
            str(len(law.tests) if isinstance(law.tests, list) else 0),
            *(number(None if n is None else scale * n) for n in found[side]),
            percent(read_number(law.fit_percent), 4),
        )
        for side, law in fitted.items()
    ]
    columns = ("Valve", "Tests", f"RMSE ({unit})", f"Sensor noise ({unit})", "Fit")
    return table("Fit of the pressure curves", columns, rows)


def _curves(
    side: str, law: DiscreteLaw, logs: Sequence[tuple[str | None, Log]], rig: Rig
) -> list[PressureCurve]:
    """The training tests' curves, simulated from the bundle; none without all four flows."""
    valve = valve_of(law, rig)
    curves: list[PressureCurve] = []
    if valve is None:
        return curves
    others = _rejected(law)
    for named, log in logs:
        if named not in (None, side):
            continue
        for trial in log.trials:
            if not is_switched(trial, side):
                continue
            curves += [_curve(piece, valve, others) for piece in screen(trial, side, rig).pieces]
    return curves


def _rejected(law: DiscreteLaw) -> dict[str, DiscreteValve]:
    """The valve by each law that was fitted and not chosen, by the law's name."""
    decision = law.choice if isinstance(law.choice, LawDecision) else None
    fields = {f.name for f in dataclasses.fields(DiscreteValve)}
    unused: dict[str, Any] = {**dict.fromkeys(FLOWS, 1.0), **dict.fromkeys(DELAYS, 0.0)}
    plain = DiscreteValve(**unused)
    found = {}
    for one in decision.rejected if decision is not None else ():
        own: dict[str, Any] = {k: float(v) for k, v in one.numbers.items() if k in fields}
        if one.law == SERIES:
            own["in_series"] = tuple(way for way, key in VALVE_ALONE.items() if key in own)
        if all(f"sonic_conductance_{way}" in own or f"c_{way}" in own for way in ("fill", "dis")):
            found[LAW_NAMES[one.law]] = dataclasses.replace(plain, **own)
    return found


def _curve(
    piece: Piece, valve: DiscreteValve, others: Mapping[str, DiscreteValve]
) -> PressureCurve:
    chamber = piece.chamber

    def simulated(one: DiscreteValve) -> FloatArray:
        own = one if piece.flow_control else one.alone()
        return pressure_curve(chamber, own, piece.initial, piece.supply_shift, piece.atmosphere)

    # Of tests without the flow control, laws that know none say nothing.
    rejected = {k: simulated(v) for k, v in others.items() if piece.flow_control or v.in_series}
    start = chamber.time[0]
    edges = (np.asarray(e)[np.isfinite(e)] - start for e in (chamber.opens, chamber.closes))
    opens, closes = (e[(e >= 0.0) & (e < chamber.time[-1] - start)] for e in edges)
    time = chamber.time - start
    return PressureCurve(
        piece.label, time, piece.pressure, simulated(valve), opens, closes, rejected
    )


def _figures(
    curves: Mapping[str, Sequence[PressureCurve]], effects: Sequence[str] = ()
) -> FigureGroup:
    """Of each valve the test with the worst fit: whole, one filling and one discharge close up.

    `effects`: those that belong to the law's numbers, and are not simulated here.
    """
    named = "law alone" if effects else "fitted"
    figures, chosen, rejected = [], [], dict[str, None]()
    for side, own in curves.items():
        # Of tests without the flow control there is no law to compare with.
        worst = max([c for c in own if c.rejected] or own, key=lambda c: c.rmse)
        figures.append(_panel(side, worst, "whole test", None, "whole", named))
        for edges, name in ((worst.opens, "filling"), (worst.closes, "discharge")):
            if edges.size:
                figures.append(_panel(side, worst, name, float(edges[0]), name, named))
        if len(own) > 1:
            shown = f"test {worst.test}" if worst.test else "one"
            chosen.append(f"valve {side.upper()}, {shown} of {len(own)}")
        rejected |= dict.fromkeys(worst.rejected)
    caption = "Measured and fitted pressure, residual below"
    caption += f"; the test with the worst fit: {'; '.join(chosen)}." if chosen else "."
    if rejected:
        caption += f" Broken lines: the law that was not chosen ({' and '.join(rejected)})."
    if effects:
        caption += (
            f" The law's numbers were estimated together with the effect {'; '.join(effects)}, "
            "which acts on this pressure and is not drawn: the law alone does not show how well "
            "both fit."
        )
    return FigureGroup(caption, tuple(figures))


def _panel(
    side: str, curve: PressureCurve, what: str, edge: float | None, tag: str, named: str
) -> Figure:
    rows = slice(None)
    if edge is not None:
        first, last = (edge + d for d in (-0.02, 0.6))
        near = np.flatnonzero((curve.time >= first) & (curve.time <= last))
        rows = slice(int(near[0]), int(near[-1]) + 1)
    time, measured, fitted = curve.time[rows], curve.measured[rows], curve.simulated[rows]
    residual = measured - fitted
    both: tuple[Mark, ...] = (
        Line(time, 1e-3 * measured, "measured", "measured", width=2.4),
        Line(time, 1e-3 * fitted, "model", named, width=1.0),
    )
    both += tuple(
        Line(time, 1e-3 * other[rows], role, f"not chosen: {name}", dash, 0.9)
        for (role, dash), (name, other) in zip(_STYLES, curve.rejected.items(), strict=False)
    )
    below: tuple[Mark, ...] = (
        Line(time, 1e-3 * residual, "model", width=0.6),
        Rule(0.0, width=0.6),
    )
    below += tuple(
        Line(time, 1e-3 * (measured - other[rows]), role, "", dash, 0.6)
        for (role, dash), other in zip(_STYLES, curve.rejected.values(), strict=False)
    )
    x = Scale("Time", "s")
    rmse = math.sqrt(float(np.mean(residual**2)))
    description = (
        f"Chamber {side.upper()} between {number(float(time[0]))} and {number(float(time[-1]))} s: "
        f"measured pressure from {number(1e-3 * float(measured.min()))} to "
        f"{number(1e-3 * float(measured.max()))} kPa; the model is off by "
        f"{number(1e-3 * rmse)} kPa rms, at most "
        f"{number(1e-3 * float(np.abs(residual).max()))} kPa."
    ) + "".join(
        f" By the law that was not chosen, {name}, it is off by "
        f"{number(1e-3 * root_mean_square(measured - other[rows]))} kPa rms."
        for name, other in curve.rejected.items()
    )
    return Figure(
        f"fig-valve-{side}-{tag}",
        f"Valve {side.upper()}: {what}",
        description,
        (
            Panel(x, Scale("Pressure", "kPa"), both, 2.4, legend="above"),
            Panel(x, Scale("Residual", "kPa"), below),
        ),
        size=TALL_PANEL,
    )


def curves_panel(side: str, curves: Sequence[PressureCurve]) -> Panel:
    """Every test over the time since its start, as measured and as fitted."""
    marks: list[Mark] = []
    for i, curve in enumerate(curves):
        measured, fitted = ("measured", "fitted") if i == 0 else ("", "")
        since = curve.time - curve.time[0]
        marks.append(Points(since, 1e-3 * curve.measured, label=measured, marker=".", size=2.0))
        marks.append(Line(since, 1e-3 * curve.simulated, "model", fitted, width=0.8))
    return Panel(Scale("Time", "s"), Scale(f"Pressure {side.upper()}", "kPa"), tuple(marks))


__all__ = ["PressureCurve", "curves_panel", "discrete_section"]
