"""PWM surfaces as they are shown: measured, fitted, errors in duty, and which one to use."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.blocks.figures import ColourMap, Dash, Figure, Line, Mark, Panel, Points, Role, Scale
from sysid.blocks.numbers import MISSING, estimate_cells, number
from sysid.blocks.sections import Block, FigureGroup, Fold, Heading, Lines, Section
from sysid.blocks.tables import Table, estimate_table, table
from sysid.identification.valve_pwm.remarks import Remarks
from sysid.identification.valve_pwm.samples import sample_tests
from sysid.identification.valve_pwm.selection import select_tests
from sysid.io.logs import Log
from sysid.io.rig import Rig
from sysid.parameters import FittedValves, PwmSurfaces
from sysid.parameters.valves import AveragedRecord, DutyErrors, ResolutionRecord, SurfaceChoice
from sysid.surfaces.comparison import obeys_averaged_law
from sysid.surfaces.domain import LevelFlows, level_flows
from sysid.types import FloatArray

_NAMES = {"bipolynomial": "Bipolynomial", "ann": "Network", "averaged": "Averaged law"}
DIRECTIONS = {"fill": "filling", "discharge": "discharging"}
_STYLES: tuple[tuple[Role, Dash], ...] = (("model", "solid"), ("second", "dashed"))
_LAW_NAMES = {
    "choked_flow_fill_kg_s": "Choked flow, filling",
    "choked_flow_dis_kg_s": "Choked flow, discharging",
    "c_fill": "Coefficient, filling",
    "c_dis": "Coefficient, discharging",
    "sonic_conductance.fill": "Sonic conductance, filling",
    "sonic_conductance.exhaust": "Sonic conductance, discharging",
    "critical_ratio.fill": "Critical ratio, filling",
    "critical_ratio.exhaust": "Critical ratio, discharging",
    "subsonic_index.fill": "Subsonic index, filling",
    "subsonic_index.exhaust": "Subsonic index, discharging",
    "delay_difference_s": "Closing delay less opening delay",
}


@dataclass(frozen=True)
class _Measured:
    """One valve and direction: measured flow by duty and pressure, and the fitted surfaces."""

    side: str
    direction: str
    held: PwmSurfaces
    levels: LevelFlows | None
    surfaces: dict[str, Any]
    averaged: AveragedRecord | None = None

    @property
    def errors(self) -> list[tuple[str, DutyErrors | None, DutyErrors | None]]:
        """Kind, errors on held-out tests and on all, of each surface and the averaged law."""
        found = [
            (k, s.errors("held_out"), s.errors("fitted")) for k, s in self.held.surfaces().items()
        ]
        law = self.averaged
        if law is not None:
            held, fitted = (law.errors(self.direction, use) for use in ("held_out", "fitted"))
            found.append(("averaged", held, fitted))
        return found

    @property
    def choice(self) -> SurfaceChoice | None:
        """Both surfaces next to each other, where both were fitted."""
        made = self.held.comparison
        return made if isinstance(made, SurfaceChoice) else None

    @property
    def rivals(self) -> tuple[DutyErrors, DutyErrors] | None:
        """Held-out errors of the averaged law and of the network; None without both."""
        errors = {kind: held for kind, held, _ in self.errors}
        law, network = errors.get("averaged"), errors.get("ann")
        return None if law is None or network is None else (law, network)

    @property
    def obeys_averaged_law(self) -> bool:
        """Whether both are there, and the averaged law follows as well as the network."""
        if self.rivals is None:
            return False
        law, network = self.rivals
        return obeys_averaged_law(law.rmse, network.rmse, _figure(self.choice, "noise_rmse"))

    @property
    def best(self) -> str | None:
        """The kind to use: the averaged law where it is obeyed, else the better surface."""
        if self.obeys_averaged_law:
            return "averaged"
        return None if self.choice is None else self.choice.recommended

    @property
    def tag(self) -> str:
        return f"{self.side}-{self.direction}"

    @property
    def title(self) -> str:
        return f"Valve {self.side.upper()}, {DIRECTIONS[self.direction]}"


def surfaces_section(
    valves: FittedValves, logs: Sequence[tuple[str | None, Log]], rig: Rig
) -> Section | None:
    """The section on a bundle's surfaces and their logs; None where no surface is fitted."""
    parts = _parts(valves, logs, rig)
    if not parts:
        return None
    blocks: list[Block] = [_comparison(parts), *_laws(parts)]
    for part in parts:
        blocks += _part_blocks(part)
    intro = (
        "Mean mass flow of a pulsed valve over duty and chamber pressure, from constant-duty "
        "tests with the piston held. Errors are in duty, the quantity that a controller needs: in "
        "points (hundredths), and relative to the duty, where small duties weigh "
        "most. The averaged law is the on/off law over a period, here fitted to these tests alone; "
        "a simulation takes that of the on/off tests where there are any.",
    )
    return Section("surfaces", "PWM surfaces", (*intro, *_obedience(parts)), tuple(blocks))


def _obedience(parts: Sequence[_Measured]) -> Iterator[str]:
    """Directions in which a valve obeys the averaged law, by held-out error in duty."""
    obeyed = []
    for part in parts:
        if part.rivals is None:
            continue
        law, network = part.rivals
        if part.obeys_averaged_law:
            obeyed.append(part.title[0].lower() + part.title[1:])
            continue
        yield (
            f"{part.title}: the valve does not obey the averaged law. Its error is "
            f"{number(_points(law.rmse))} points of duty on held-out tests, the network's "
            f"{number(_points(network.rmse))}: use the network there."
        )
    if obeyed:
        yield f"The averaged law is obeyed by {'; '.join(obeyed)}."


def _laws(parts: Sequence[_Measured]) -> list[Table]:
    """The averaged laws that were fitted to the PWM tests, one table a valve."""
    found = {p.side: p.averaged for p in parts if p.averaged is not None}
    tables = []
    for side, law in found.items():
        named = {_LAW_NAMES[key]: estimate for key, estimate in law.estimates().items()}
        caption = f"Valve {side.upper()}: averaged law from the PWM tests alone"
        tables.append(estimate_table(caption, named, "page"))
    return tables


def _parts(
    valves: FittedValves, logs: Sequence[tuple[str | None, Log]], rig: Rig
) -> list[_Measured]:
    found = []
    for side, valve in sorted(valves.sides().items()):
        levels = _levels(side, logs, rig) if valve.pwm is not None else {}
        for direction in DIRECTIONS:
            held = valve.surfaces(direction)
            if held is None or not held.surfaces():
                continue
            surfaces = {kind: surface.model() for kind, surface in held.surfaces().items()}
            found.append(
                _Measured(side, direction, held, levels.get(direction), surfaces, valve.averaged())
            )
    return found


def _levels(side: str, logs: Sequence[tuple[str | None, Log]], rig: Rig) -> dict[str, LevelFlows]:
    """Measured flow by direction, sampled from the fit tests as the fit does."""
    trials = [t for named, log in logs if named in (None, side) for t in log.trials]
    tests = select_tests(trials, rig, side, Remarks())
    found = {}
    for direction in DIRECTIONS:
        samples = sample_tests([t for t in tests if t.filling == (direction == "fill")], rig)
        if len(samples):
            found[direction] = level_flows(samples.duty, samples.pressure, samples.flow)
    return found


# --- tables ----------------------------------------------------------------------------


def _comparison(parts: Sequence[_Measured]) -> Table:
    """Errors of every surface in duty: tables 3.7.2 to 3.7.4 of the thesis for these data."""
    rows = []
    for part in parts:
        choice, best = part.choice, part.best
        for kind, held, fitted in part.errors:
            judged = held or fitted
            rows.append(
                (
                    f"{part.title}: {_NAMES[kind].lower()}",
                    MISSING if judged is None else str(judged.n_parameters),
                    number(_points(_figure(fitted, "rmse"))),
                    number(_points(_figure(held, "rmse"))),
                    number(_figure(judged, "p95_error_points")),
                    number(_figure(judged, "max_error_points")),
                    number(_figure(judged, "max_relative_error_percent")),
                    number(_points(_figure(choice, "noise_rmse"))),
                    "use this" if kind == best else "",
                )
            )
    columns = (
        "Surface", "Parameters", "RMSE, fitted", "RMSE, held-out tests", "95th percentile",
        "Largest", "Largest relative (%)", "Noise alone", "",
    )  # fmt: skip
    caption = (
        "Surfaces compared: errors of the duty that each gives for a wanted flow, in duty points; "
        "noise alone is the error that the scatter of the measured flow causes"
    )
    return table(caption, (*columns[:-1], "Choice"), rows, text=(8,))


def _figure(of: DutyErrors | SurfaceChoice | None, name: str) -> float | None:
    value = None if of is None else getattr(of, name)
    return None if value is None else float(value)


def _points(duty: float | None) -> float | None:
    return None if duty is None else 100.0 * duty


def _part_blocks(part: _Measured) -> list[Block]:
    blocks: list[Block] = [Heading(f"surface-{part.tag}", part.title), *_figure_blocks(part)]
    folded: list[Block] = []
    if "bipolynomial" in part.surfaces:
        folded.append(_coefficients(part))
    if "ann" in part.surfaces:
        folded.append(_weights(part))
    study = part.held.resolution_study
    if isinstance(study, ResolutionRecord):
        folded.append(_resolution(study))
    if part.choice is not None:
        blocks.append(Lines((f"Choice: {part.choice.reason}.",)))
    if folded:
        blocks.append(Fold(f"{part.title}: coefficients and weights", tuple(folded)))
    return blocks


def _figure_blocks(part: _Measured) -> list[Block]:
    """The figures, those of laws that are not recommended folded."""
    blocks: list[Block] = []
    figures, others = _figures(part)
    if figures:
        caption = (
            f"{part.title}: measured and fitted mean flow, flow over pressure at a few duties "
            "(dots: measured), and the duty that the surface gives for a flow less the true "
            "one. Grey: not visited, or outside the domain."
        )
        blocks.append(FigureGroup(caption, tuple(figures)))
    if others:
        names = " and ".join(_NAMES[kind].lower() for kind in part.surfaces if kind != part.best)
        caption = f"{part.title}: the same of what is not recommended."
        group = FigureGroup(caption, tuple(others))
        blocks.append(Fold(f"{part.title}: maps of the {names}, not recommended", (group,)))
    return blocks


def _coefficients(part: _Measured) -> Table:
    rows = []
    for term, estimate in part.surfaces["bipolynomial"].terms().items():
        value, std, interval, unit = estimate_cells(estimate)
        rows.append((_powers(term), value, std, interval, _powers(unit)))
    caption = f"{part.title}: bipolynomial, the flow (kg/s) as a sum of these products of "
    caption += "powers of the duty and the pressure P (Pa), each with its coefficient"
    columns = ("Term", "Coefficient", "Std. error", "95 % interval", "Unit")
    return table(caption, columns, rows, text=(4,))


def _powers(text: str) -> str:
    for power, sign in (("^0", "⁰"), ("^1", "¹"), ("^2", "²")):
        text = text.replace(power, sign)
    return text


def _weights(part: _Measured) -> Table:
    ann = part.surfaces["ann"]
    hidden, bias, output = ann.hidden_weights_, ann.hidden_bias_, ann.output_weights_
    rows = [
        (str(i + 1), number(w[0], 5), number(w[1], 5), number(b, 5), number(o, 5))
        for i, (w, b, o) in enumerate(zip(hidden, bias, output, strict=True))
    ]
    rows.append(("output bias", "", "", number(float(ann.output_bias_), 5), ""))
    caption = (
        f"{part.title}: network, inputs and output scaled; single weights have no interval, since "
        "many sets of weights give the same surface"
    )
    return table(caption, ("Neuron", "From flow", "From pressure", "Bias", "To output"), rows)


def _resolution(study: ResolutionRecord) -> Table:
    rows = [
        (number(step), number(flow), str(n), "coarsest that suffices" if step == study.coarsest
         else "")
        for step, flow, n in zip(study.steps, study.max_flow, study.tests, strict=True)
    ]  # fmt: skip
    columns = ("Step of duty", "Largest mean flow (kg/s)", "Tests", "Remark")
    return table(
        "Resolution of duty: the coarsest step of the tests that gives the same surface",
        columns,
        rows,
        text=(3,),
    )


# --- figures ---------------------------------------------------------------------------


def _figures(part: _Measured) -> tuple[list[Figure], list[Figure]]:
    """Those to show, and those of laws that are not recommended.

    First flow over pressure by each surface, then the recommended one's map and its error in duty
    (those of all where none is recommended), then what was measured.
    """
    levels = part.levels
    if levels is None:
        return [], []
    flow, pressure = 1e3 * levels.flow, levels.pressure / 1e3
    limits = (float(np.nanmin(flow)), float(np.nanmax(flow)))
    errors = {k: _duty_error(s, levels) for k, s in part.surfaces.items()}
    known = [np.abs(e[np.isfinite(e)]) for e in errors.values()]
    largest = max((float(np.percentile(k, 99)) for k in known if k.size), default=1.0)
    shown = [flow_figure(part.title, part.tag, levels, part.surfaces)]
    others: list[Figure] = []
    for kind, surface in part.surfaces.items():
        grid, title = (levels.duty, pressure, errors[kind]), f"{_NAMES[kind]}: error in duty"
        maps = [
            _map(part, kind, f"{_NAMES[kind]}: flow", _fitted(surface), limits),
            _map(part, f"{kind}-error", title, grid, (-largest, largest), True),
        ]
        (shown if part.best in (None, kind) else others).extend(maps)
    shown.append(_map(part, "measured", "Measured flow", (levels.duty, pressure, flow), limits))
    return shown, others


def _fitted(surface: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Duties (n,), pressures (m,) kPa and flow (n, m) g/s; NaN outside the domain."""
    domain = surface.domain_
    duty = np.linspace(domain.duty_range[0], domain.duty_range[1], 72)
    pressure = np.linspace(domain.pressure_range[0], domain.pressure_range[1], 72)
    flow = surface.flow(duty[:, None], pressure[None, :])[0]
    low, high = domain.duty_limits(pressure)
    outside = (duty[:, None] < low[None, :]) | (duty[:, None] > high[None, :])
    return duty, pressure / 1e3, 1e3 * np.where(outside, np.nan, flow)


def _duty_error(surface: Any, levels: LevelFlows) -> FloatArray:
    """Fitted less true duty at the measured flows, in points (L, B); NaN outside the domain."""
    inside = surface.domain_.holds_duty(levels.duty)
    low, high = surface.domain_.pressure_range
    seen = np.isfinite(levels.flow) & inside[:, None]
    seen &= ((levels.pressure >= low) & (levels.pressure <= high))[None, :]
    rows, columns = np.nonzero(seen)
    fitted = surface.duty(levels.flow[rows, columns], levels.pressure[columns])[0]
    error = np.full(levels.flow.shape, np.nan)
    error[rows, columns] = 100.0 * (fitted - levels.duty[rows])
    return error


_Grid = tuple[FloatArray, FloatArray, FloatArray]


def _map(
    part: _Measured,
    tag: str,
    title: str,
    grid: _Grid,
    limits: tuple[float, float],
    is_error: bool = False,
) -> Figure:
    duty, pressure, values = grid
    known = values[np.isfinite(values)]
    description = (
        f"{part.title}, over pressures of {number(float(pressure.min()))} to "
        f"{number(float(pressure.max()))} kPa and duties of {number(float(duty.min()))} to "
        f"{number(float(duty.max()))}: "
    )
    if is_error:
        rms = float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
        worst = float(np.abs(known).max()) if known.size else float("nan")
        description += (
            f"error {number(rms)} points rms, at most {number(worst)}; colours end at "
            f"{number(limits[1])}."
        )
    else:
        description += f"flow from {number(limits[0])} to {number(limits[1])} g/s."
    unit = "points" if is_error else "g/s"
    mark = ColourMap(pressure, duty, values, limits, unit, is_error)
    panel = Panel(Scale("Pressure", "kPa"), Scale("Duty", limits=(0.0, 1.0)), (mark,))
    whole = f"{part.title}. {title}"
    return Figure(f"fig-{part.tag}-{tag}", whole, description, (panel,), title)


def flow_figure(title: str, tag: str, levels: LevelFlows, surfaces: Mapping[str, Any]) -> Figure:
    """Flow over pressure at a few duties: measured points, fitted lines by the surface's kind."""
    domain = next(iter(surfaces.values())).domain_
    inside = np.flatnonzero(domain.holds_duty(levels.duty))
    chosen = inside[np.linspace(0, len(inside) - 1, min(5, len(inside))).astype(int)]
    marks: list[Mark] = []
    for row in chosen:
        seen = levels.count[row] > 0
        flow = 1e3 * levels.flow[row, seen]
        marks.append(Points(levels.pressure[seen] / 1e3, flow, size=2.2, is_filled=True))
    low, high = domain.pressure_range
    pressure = np.linspace(low, high, 60)
    for (kind, surface), (role, dash) in zip(surfaces.items(), _STYLES, strict=False):
        label = _NAMES[kind].lower()
        for row in chosen:
            ends = levels.pressure[np.flatnonzero(np.isfinite(levels.flow[row]))[[0, -1]]]
            p = pressure[(pressure >= ends[0]) & (pressure <= ends[1])]
            if len(p) < 2:
                continue
            flow = 1e3 * surface.flow(np.full_like(p, levels.duty[row]), p)[0]
            marks.append(Line(p / 1e3, flow, role, label, dash))
            label = ""
    duties = ", ".join(number(float(levels.duty[r]), 2) for r in chosen)
    description = f"{title}: measured and fitted flow over pressure at duties of {duties}."
    panel = Panel(Scale("Pressure", "kPa"), Scale("Flow", "g/s"), tuple(marks))
    heading = "Flow at a few duties"
    return Figure(f"fig-{tag}-cuts", f"{title}. {heading}", description, (panel,), heading)


__all__ = ["DIRECTIONS", "flow_figure", "surfaces_section"]
