"""The on/off valves: their parameters, and measured and fitted pressure (Figures 3.7, 3.8)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.blocks.figures import Picture
from sysid.blocks.numbers import number, percent
from sysid.blocks.sections import Block, FigureGroup, Section
from sysid.blocks.tables import Table, table
from sysid.document import svg
from sysid.document.friction import parameters_table
from sysid.document.svg import COLOUR
from sysid.estimation.linear import Estimate
from sysid.identification.valve_discrete.held_chamber import DiscreteValve, pressure_curve
from sysid.identification.valve_discrete.trials import Piece, screen
from sysid.io.logs import Log
from sysid.io.rig import Rig
from sysid.parameters import Bundle, DiscreteLaw
from sysid.parameters.base import read_number
from sysid.types import FloatArray

_FLOWS = ("choked_flow_fill_kg_s", "c_fill", "choked_flow_dis_kg_s", "c_dis")
_DELAYS = ("on_delay_s", "off_delay_s")
_CLOSE_UP_S = (-0.02, 0.6)
_BUCKETS = 320


@dataclass(frozen=True)
class _Curve:
    """One test's pressure, kPa over s, measured and by the fitted law."""

    label: str
    time: FloatArray
    measured: FloatArray
    fitted: FloatArray
    opens: FloatArray
    closes: FloatArray

    @property
    def rmse(self) -> float:
        return math.sqrt(float(np.mean((self.measured - self.fitted) ** 2)))


def discrete_section(
    bundle: Bundle, logs: Sequence[tuple[str | None, Log]], rig: Rig
) -> Section | None:
    """From the bundle's valves and the valve-discrete logs; None where neither is fitted."""
    fitted = {} if bundle.valves is None else bundle.valves.discrete_laws()
    if not fitted:
        return None
    held = {side: law for side, law in fitted.items() if isinstance(law.tests, list) and law.tests}
    blocks: list[Block] = [_fit_table(held)] if held else []
    parts = bundle.parameters.parts()
    for side, law in fitted.items():
        part = parts[f"valves.{side}.discrete"]
        blocks.append(parameters_table(f"Valve {side.upper()}", part))
        curves = _curves(side, law, logs, rig)
        if curves:
            blocks.append(_figures(side, curves))
    intro = (
        "The piston is held, and the valve is switched on and off again; flows, coefficients and "
        "delays are those whose simulated pressure is closest to the measured one."
        if held
        else "Coefficients are those whose simulated pressure is closest to the measured one while "
        "a tank of constant volume empties through the valve or port.",
    )
    return Section("valves", "On/off valves", intro, tuple(blocks))


def _fit_table(fitted: Mapping[str, DiscreteLaw]) -> Table:
    rows = [
        (
            f"Valve {side.upper()}",
            str(len(law.tests) if isinstance(law.tests, list) else 0),
            number(read_number(law.rmse_pa)),
            number(read_number(law.noise_pa)),
            percent(read_number(law.fit_percent), 4),
        )
        for side, law in fitted.items()
    ]
    columns = ("Valve", "Tests", "RMSE (Pa)", "Sensor noise (Pa)", "Fit")
    return table("Fit of the pressure curves", columns, rows)


def _curves(
    side: str, law: DiscreteLaw, logs: Sequence[tuple[str | None, Log]], rig: Rig
) -> list[_Curve]:
    """The training tests' curves, simulated from the bundle; none without all four flows."""
    valve = _valve(law, rig)
    curves: list[_Curve] = []
    if valve is None:
        return curves
    for named, log in logs:
        if named not in (None, side):
            continue
        for trial in log.trials:
            command = trial.channels.get(f"valve_{side}")
            if command is None or not np.any(command > 0.5):
                continue
            curves += [_curve(piece, valve) for piece in screen(trial, side, rig).pieces]
    return curves


def _valve(law: DiscreteLaw, rig: Rig) -> DiscreteValve | None:
    """The law of the bundle; a delay that is not identified is the rig file's."""
    delays = (rig.valves.on_delay_s, rig.valves.off_delay_s) if rig.valves else (0.0, 0.0)
    declared = dict(zip(_DELAYS, delays, strict=True))
    values: dict[str, float] = {}
    # The critical ratios in the bundle are a check; the law itself has 0.53.
    for name in (*_FLOWS, *_DELAYS):
        found = getattr(law, name)
        if isinstance(found, Estimate) and found.identified:
            values[name] = found.value
        elif name in _FLOWS:
            return None
        else:
            values[name] = declared[name]
    return DiscreteValve(**values)


def _curve(piece: Piece, valve: DiscreteValve) -> _Curve:
    chamber = piece.chamber
    fitted = pressure_curve(chamber, valve, piece.initial, piece.supply_shift, piece.atmosphere)
    start = chamber.time[0]
    edges = (np.asarray(e)[np.isfinite(e)] - start for e in (chamber.opens, chamber.closes))
    opens, closes = (e[(e >= 0.0) & (e < chamber.time[-1] - start)] for e in edges)
    return _Curve(
        piece.label, chamber.time - start, piece.pressure / 1e3, fitted / 1e3, opens, closes
    )


def _figures(side: str, curves: Sequence[_Curve]) -> FigureGroup:
    """The test with the worst fit: whole, and close-ups of one filling and one discharge."""
    worst = max(curves, key=lambda c: c.rmse)
    figures = [_panel(side, worst, "whole test", None, "whole")]
    for edges, name in ((worst.opens, "filling"), (worst.closes, "discharge")):
        if edges.size:
            figures.append(_panel(side, worst, name, float(edges[0]), name))
    shown = f"test {worst.label}" if worst.label else "the test"
    caption = (
        f"Valve {side.upper()}, measured and fitted pressure, residual below. "
        f"Of {len(curves)} tests the one with the worst fit is shown: {shown}."
        if len(curves) > 1
        else f"Valve {side.upper()}, measured and fitted pressure, residual below."
    )
    return FigureGroup(caption, tuple(figures))


def _panel(side: str, curve: _Curve, what: str, edge: float | None, tag: str) -> Picture:
    rows = slice(None)
    if edge is not None:
        first, last = (edge + d for d in _CLOSE_UP_S)
        near = np.flatnonzero((curve.time >= first) & (curve.time <= last))
        rows = slice(int(near[0]), int(near[-1]) + 1)
    time, measured, fitted = curve.time[rows], curve.measured[rows], curve.fitted[rows]
    residual = measured - fitted
    figure, (top, bottom) = svg.panels(f"Valve {side.upper()}: {what}", (2.4, 1.0), svg.TALL_PANEL)
    kept = svg.thinned(time, [measured, fitted, residual], _BUCKETS)
    t = time[kept]
    top.plot(t, measured[kept], color=COLOUR["measured"], linewidth=2.4, label="measured")
    top.plot(t, fitted[kept], color=COLOUR["model"], linewidth=1.0, label="fitted")
    bottom.plot(t, residual[kept], color=COLOUR["second"], linewidth=0.6)
    bottom.axhline(0.0, color=COLOUR["muted"], linewidth=0.6)
    top.set_ylabel("Pressure (kPa)")
    bottom.set_ylabel("Residual (kPa)")
    bottom.set_xlabel("Time (s)")
    svg.legend(top, loc="best")
    figure.align_ylabels([top, bottom])
    rmse = math.sqrt(float(np.mean(residual**2)))
    description = (
        f"Chamber {side.upper()} between {number(float(time[0]))} and {number(float(time[-1]))} s: "
        f"measured pressure from {number(float(measured.min()))} to "
        f"{number(float(measured.max()))} kPa; the fitted curve is off by {number(1e3 * rmse)} Pa "
        f"rms, at most {number(1e3 * float(np.abs(residual).max()))} Pa."
    )
    return svg.to_figure(
        figure, f"fig-valve-{side}-{tag}", f"Valve {side.upper()}, {what}", description
    )
