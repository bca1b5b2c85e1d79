"""PWM surfaces as they are shown: measured, fitted, errors in duty, and which one to use."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sysid.blocks.figures import (
    ColourMap,
    Dash,
    Figure,
    Line,
    Mark,
    Panel,
    Points,
    Role,
    Scale,
    Words,
)
from sysid.blocks.numbers import MISSING, estimate_cells, fixed, number, span
from sysid.blocks.sections import Block, FigureGroup, Fold, Heading, Lines, Section
from sysid.blocks.tables import Table, estimate_table, table
from sysid.blocks.titles import capital
from sysid.identification.valve_pwm import choice as choices
from sysid.identification.valve_pwm.remarks import Remarks
from sysid.identification.valve_pwm.samples import FlowSamples, sample_tests
from sysid.identification.valve_pwm.selection import select_tests
from sysid.io.logs import Log
from sysid.io.rig import Rig
from sysid.parameters import FittedValves, PwmSurfaces, Valve
from sysid.parameters.valves import (
    AVERAGED,
    LAW_KEYS,
    AveragedRecord,
    DutyErrors,
    ResolutionRecord,
    SurfaceChoice,
)
from sysid.surfaces.averaged import AveragedLaw
from sysid.surfaces.domain import Domain, LevelFlows, level_flows
from sysid.types import FloatArray

_NAMES = {"bipolynomial": "Bipolynomial", "ann": "Network", "averaged": "Averaged law"}
DIRECTIONS = {"fill": "filling", "discharge": "discharging"}
_STYLES: tuple[tuple[Role, Dash], ...] = (
    ("model", "solid"),
    ("second", "dashed"),
    ("third", "dotted"),
)
# Columns of the comparison that say nothing where one surface alone was fitted.
_MAY_BE_EMPTY = ("Noise alone", "Choice")
# Room for a duty's name beyond the curves of a figure, as a share of the pressures' range.
_NAME_ROOM = 0.16
# Half of a duty's name as it is drawn, as shares of the pressures' range and of the largest flow.
_NAME_WIDTH, _NAME_HEIGHT = 0.075, 0.045
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
class _HeldLaw:
    """The averaged law of a held chamber, with the ripple of its pulses, drawn as a surface is.

    `lines`: supply and atmosphere, Pa; `per_flow`: k R T / V, Pa/kg.
    """

    law: AveragedLaw
    lines: tuple[float, float]
    per_flow: float
    domain_: Domain

    def flow(self, duty: FloatArray, pressure: FloatArray) -> tuple[FloatArray]:
        """Mean flow, kg/s, over a period."""
        share = self.law.open_share(duty)
        found = self.law.mean_pulse(share, pressure, self.lines, self.per_flow)
        return (np.asarray(found.mean(share)),)

    def duty(self, flow: FloatArray, pressure: FloatArray) -> tuple[FloatArray]:
        """Duty for a mean flow."""
        return (np.asarray(self.law.held_duty(flow, pressure, self.lines, self.per_flow)),)


@dataclass(frozen=True)
class _Measured:
    """One valve and direction: measured flow by duty and pressure, and the laws fitted to it.

    `surfaces` by kind, the averaged law among them where it can be drawn.
    """

    side: str
    direction: str
    valve: Valve
    levels: LevelFlows | None
    surfaces: dict[str, Any]

    @property
    def held(self) -> PwmSurfaces:
        """What the bundle holds of this direction."""
        return self.valve.surfaces(self.direction) or PwmSurfaces()

    @property
    def errors(self) -> list[tuple[str, DutyErrors | None, DutyErrors | None]]:
        """Kind, errors on held-out tests and on all, of each surface and the averaged law."""
        found = [
            (k, s.errors("held_out"), s.errors("fitted")) for k, s in self.held.surfaces().items()
        ]
        law = self.valve.averaged()
        if law is not None:
            held, fitted = (law.errors(self.direction, use) for use in ("held_out", "fitted"))
            found.append((AVERAGED, held, fitted))
        return found

    @property
    def choice(self) -> SurfaceChoice | None:
        """Both surfaces next to each other, where both were fitted."""
        return choices.choice_of(self.held)

    @property
    def best(self) -> str | None:
        """The kind to use."""
        return choices.recommended(self.valve, self.direction)

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
    blocks = _compared(parts)
    folded: list[Block] = []
    for part in parts:
        heading = Heading(f"surface-{part.tag}", part.title)
        drawn, more = _part_blocks(part, is_first=part is parts[0])
        blocks += [heading, *drawn] if drawn else []
        folded += [replace(heading, id=f"{heading.id}-more"), *more] if more else []
    laws = tuple(_laws(parts))
    blocks += [Fold("Numbers of the averaged law", laws)] if laws else []
    if folded:
        kinds = {k: _NAMES[k].lower() for p in parts for k in p.surfaces if k != p.best}
        rivals = f"{' and '.join(kinds.values())}, where not recommended; " if kinds else ""
        summary = f"{rivals}coefficients and weights"
        blocks.append(Fold(capital(summary), tuple(folded)))
    intro = (
        "Mean mass flow of a pulsed valve over duty and chamber pressure, from constant-duty "
        "tests with the piston held. Errors are in duty, the quantity that a controller needs: in "
        "points (hundredths), and relative to the duty. The averaged law is the on/off law over a "
        "period, here fitted to these tests alone; a simulation takes that of the on/off tests "
        "where there are any.",
    )
    return Section("surfaces", "PWM surfaces", (*intro, *_obedience(parts)), tuple(blocks))


def _obedience(parts: Sequence[_Measured]) -> Iterator[str]:
    """Directions in which a valve obeys the averaged law, by held-out error in duty."""
    obeyed = []
    names: list[str] = []
    for part in parts:
        rivals = choices.rivals(part.valve, part.direction)
        kind = choices.rival(part.valve, part.direction)
        if rivals is None or kind is None:
            continue
        law, surface = rivals
        name = _NAMES[kind].lower()
        if choices.is_averaged(part.valve, part.direction):
            obeyed.append(part.title[0].lower() + part.title[1:])
            names.append(name)
            continue
        yield (
            f"{part.title}: the valve does not obey the averaged law. Its error is "
            f"{number(_points(law.rmse))} points of duty on held-out tests, the {name}'s "
            f"{number(_points(surface.rmse))}: use the {name} there."
        )
    if obeyed:
        is_all = len(obeyed) == len(parts) > 1
        named = "every valve, filling and discharging" if is_all else "; ".join(obeyed)
        yield (
            "On held-out tests the averaged law gives the duty as closely as the "
            f"{' or the '.join(dict.fromkeys(names))}, or within twice what noise alone causes: "
            f"{named}."
        )


def _laws(parts: Sequence[_Measured]) -> list[Table]:
    """The averaged laws that were fitted to the PWM tests, one table a valve."""
    tables = []
    for side, law in {p.side: p.valve.averaged() for p in parts}.items():
        if law is None:
            continue
        named = {_LAW_NAMES[key]: estimate for key, estimate in law.estimates().items()}
        caption = f"Valve {side.upper()}: averaged law from the PWM tests alone"
        tables.append(estimate_table(caption, named, "page"))
    return tables


def _parts(
    valves: FittedValves, logs: Sequence[tuple[str | None, Log]], rig: Rig
) -> list[_Measured]:
    found = []
    for side, valve in sorted(valves.sides().items()):
        samples = _samples(side, logs, rig) if valve.pwm is not None else {}
        for direction in DIRECTIONS:
            held = valve.surfaces(direction)
            if held is None or not held.surfaces():
                continue
            surfaces = {kind: surface.model() for kind, surface in held.surfaces().items()}
            levels, own = None, samples.get(direction)
            if own is not None:
                levels = level_flows(own.duty, own.pressure, own.flow)
                law = _held_law(valve.averaged(), own, rig, next(iter(surfaces.values())).domain_)
                surfaces |= {} if law is None else {AVERAGED: law}
            found.append(_Measured(side, direction, valve, levels, surfaces))
    return found


def _samples(side: str, logs: Sequence[tuple[str | None, Log]], rig: Rig) -> dict[str, FlowSamples]:
    """Measured flow by direction, sampled from the fit tests as the fit does."""
    trials = [t for named, log in logs if named in (None, side) for t in log.trials]
    tests = select_tests(trials, rig, side, Remarks())
    found = {}
    for direction in DIRECTIONS:
        samples = sample_tests([t for t in tests if t.filling == (direction == "fill")], rig)
        if len(samples):
            found[direction] = samples
    return found


def _held_law(
    record: AveragedRecord | None, samples: FlowSamples, rig: Rig, domain: Domain
) -> _HeldLaw | None:
    """The averaged law under the conditions of a direction's tests; None without one."""
    period = None if record is None else record.pwm_period_s
    if record is None or rig.air is None or not isinstance(period, int | float):
        return None
    numbers = record.estimates()
    keys = {**record.flow_keys(), "off_delay": "delay_difference_s"}
    if not all(numbers[key].identified for key in keys.values()):
        return None
    values = {name: float(numbers[key].value) for name, key in keys.items()}
    reference = float(rig.air.supply_pressure_pa)
    law = AveragedLaw(
        **{**dict.fromkeys(LAW_KEYS, 0.0), **values},
        temperature=rig.air.temperature_k,
        supply=reference,
        supply_reference=reference,
        atmosphere=rig.air.atmospheric_pressure_pa,
        on_delay=0.0,
        period=float(period),
    )
    supply, per_flow = float(np.median(samples.supplies)), float(np.median(samples.per_flow))
    return _HeldLaw(law, (supply, rig.air.atmospheric_pressure_pa), per_flow, domain)


# --- tables ----------------------------------------------------------------------------


def _compared(parts: Sequence[_Measured]) -> list[Block]:
    """What is recommended, and next to it folded what is not; everything where nothing is."""
    every = _comparison(parts)
    is_chosen = every.headings[-1] == "Choice"
    best = [row for row in every.rows if is_chosen and row[-1]]
    if not best or len(best) == len(every.rows):
        return [every]
    rest = "Surfaces compared, those that are not recommended among them"
    return [replace(every, rows=tuple(best)), Fold(rest, (every,))]


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
    caption = "Surfaces compared: errors of the duty for a wanted flow, in duty points"
    every = table(caption, (*columns[:-1], "Choice"), rows, text=(8,)).without(*_MAY_BE_EMPTY)
    if _MAY_BE_EMPTY[0] not in every.headings:
        return every
    said = "noise alone: what the scatter of the measured flow causes"
    return replace(every, caption=f"{caption}; {said}")


def _figure(of: DutyErrors | SurfaceChoice | None, name: str) -> float | None:
    value = None if of is None else getattr(of, name)
    return None if value is None else float(value)


def _points(duty: float | None) -> float | None:
    return None if duty is None else 100.0 * duty


def _part_blocks(part: _Measured, *, is_first: bool) -> tuple[list[Block], list[Block]]:
    """What is shown of a direction, and what is folded."""
    blocks, folded = _figure_blocks(part, is_first)
    if "bipolynomial" in part.surfaces:
        folded.append(_coefficients(part))
    if "ann" in part.surfaces:
        folded.append(_weights(part))
    study = part.held.resolution_study
    if isinstance(study, ResolutionRecord):
        folded.append(_resolution(study))
    if part.choice is not None:
        said = Lines((f"Of the two surfaces: {part.choice.reason}.",))
        # Where neither is recommended it is of use only to who wants one nevertheless.
        (folded if part.best == AVERAGED else blocks).append(said)
    return blocks, folded


def _figure_blocks(part: _Measured, is_first: bool) -> tuple[list[Block], list[Block]]:
    """The figures, and those of laws that are not recommended; the first caption says all."""
    blocks: list[Block] = []
    folded: list[Block] = []
    figures, others = _figures(part)
    if figures:
        caption = (
            "Flow over pressure at a few duties (dots: measured, the number is the duty), flow by "
            "the law, and the duty that it gives for a flow less the true one. "
            "Grey: not visited, or outside the domain. A cell of the map of errors averages its "
            "flow, and is further off than single samples (table) where the flow jumps within it."
            if is_first
            else ""
        )
        blocks.append(FigureGroup(caption, tuple(figures)))
    if others:
        caption = "The same of what is not recommended, and the measured flow."
        folded.append(FigureGroup(caption, tuple(others)))
    return blocks, folded


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
        (number(step), number(None if flow is None else 1e3 * flow), str(n),
         "coarsest that suffices" if step == study.coarsest else "")
        for step, flow, n in zip(study.steps, study.max_flow, study.tests, strict=True)
    ]  # fmt: skip
    columns = ("Step of duty", "Largest mean flow (g/s)", "Tests", "Remark")
    return table(
        "Resolution of duty: the coarsest step of the tests that gives the same surface",
        columns,
        rows,
        text=(3,),
    )


# --- figures ---------------------------------------------------------------------------


def _figures(part: _Measured) -> tuple[list[Figure], list[Figure]]:
    """Those to show, and those of laws that are not recommended.

    Of the recommended law (of all where none is): flow over pressure, its map and its error in
    duty. Of the others the same, and the map of what was measured.
    """
    levels = part.levels
    if levels is None:
        return [], []
    flow, pressure = 1e3 * levels.flow, levels.pressure / 1e3
    limits = (float(np.nanmin(flow)), float(np.nanmax(flow)))
    shown_kinds = [k for k in part.surfaces if part.best in (None, k)] or list(part.surfaces)
    shown: list[Figure] = []
    others: list[Figure] = []
    for kinds, figures in (
        (shown_kinds, shown),
        ([k for k in part.surfaces if k not in shown_kinds], others),
    ):
        own = {kind: part.surfaces[kind] for kind in kinds}
        if not own:
            continue
        tag = part.tag if figures is shown else f"{part.tag}-others"
        figures.append(flow_figure(part.title, tag, levels, own))
        errors = {kind: _duty_error(surface, levels) for kind, surface in own.items()}
        known = [np.abs(e[np.isfinite(e)]) for e in errors.values()]
        largest = max((float(np.percentile(k, 99)) for k in known if k.size), default=1.0)
        for kind, surface in own.items():
            grid, title = (levels.duty, pressure, errors[kind]), f"{_NAMES[kind]}: error in duty"
            figures += [
                _map(part, kind, f"{_NAMES[kind]}: flow", _fitted(surface), limits),
                _map(part, f"{kind}-error", title, grid, (-largest, largest), True),
            ]
    measured = _map(part, "measured", "Measured flow", (levels.duty, pressure, flow), limits)
    (others or shown).append(measured)
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
        f"{part.title}, over pressures of "
        f"{span(float(pressure.min()), float(pressure.max()))} kPa and duties of "
        f"{span(float(duty.min()), float(duty.max()))}: "
    )
    if is_error:
        rms = float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
        worst = float(np.abs(known).max()) if known.size else float("nan")
        description += (
            f"error {number(rms)} points rms, at most {number(worst)}; colours end at "
            f"{number(limits[1])}."
        )
    else:
        description += f"flow from {span(*limits)} g/s."
    unit = "points" if is_error else "g/s"
    mark = ColourMap(pressure, duty, values, limits, unit, is_error)
    panel = Panel(Scale("Pressure", "kPa"), Scale("Duty", limits=(0.0, 1.0)), (mark,))
    whole = f"{part.title}. {title}"
    return Figure(f"fig-{part.tag}-{tag}", whole, description, (panel,), title)


def flow_figure(title: str, tag: str, levels: LevelFlows, surfaces: Mapping[str, Any]) -> Figure:
    """Flow over pressure at a few duties: measured points, and a line for each law.

    Each duty is at its curve's end, on the side where the flows are largest.
    """
    domain = next(iter(surfaces.values())).domain_
    inside = np.flatnonzero(domain.holds_duty(levels.duty))
    chosen = inside[np.linspace(0, len(inside) - 1, min(5, len(inside))).astype(int)]
    marks: list[Mark] = []
    for row in chosen:
        seen = levels.count[row] > 0
        flow = 1e3 * levels.flow[row, seen]
        marks.append(Points(levels.pressure[seen] / 1e3, flow, size=2.2, is_filled=True))
    for (kind, surface), (role, dash) in zip(surfaces.items(), _STYLES, strict=False):
        label = _NAMES[kind].lower()
        for row in chosen:
            p = _visited(levels, row)
            if len(p) < 2:
                continue
            flow = 1e3 * surface.flow(np.full_like(p, levels.duty[row]), p)[0]
            marks.append(Line(p / 1e3, flow, role, label, dash))
            label = ""
    marks += _duties_named(levels, chosen)
    duties = ", ".join(number(float(levels.duty[r]), 2) for r in chosen)
    description = f"{title}: measured and fitted flow over pressure at duties of {duties}."
    seen = levels.pressure[(levels.count[chosen] > 0).any(axis=0)] / 1e3
    room = _NAME_ROOM * float(np.ptp(levels.pressure)) / 1e3
    ends = (float(seen.min()) - room, float(seen.max()) + room) if len(seen) else (None, None)
    x, y = Scale("Pressure", "kPa", ends), Scale("Flow", "g/s", margin=0.1)
    panel = Panel(x, y, tuple(marks), legend="above")
    heading = "Flow at a few duties"
    return Figure(f"fig-{tag}-cuts", f"{title}. {heading}", description, (panel,), heading)


def _visited(levels: LevelFlows, row: int) -> FloatArray:
    """Pressures over what a level visited, Pa, so close that a bend of the law shows."""
    known = levels.pressure[np.isfinite(levels.flow[row])]
    return np.linspace(known[0], known[-1], 120) if len(known) > 1 else known


def _duties_named(levels: LevelFlows, rows: Sequence[int]) -> list[Words]:
    """The duty of each level, outside of its curve's end, all on the side of the larger flows.

    One that would lie over another, or over a curve, is omitted.
    """
    reach, span = float(np.ptp(levels.pressure)) / 1e3, 1e3 * float(np.nanmax(np.abs(levels.flow)))
    drawn = {row: np.flatnonzero(np.isfinite(levels.flow[row])) for row in rows}
    drawn = {row: known for row, known in drawn.items() if len(known)}
    ends = [np.abs(levels.flow[row, known[[0, -1]]]) for row, known in drawn.items()]
    if not ends:
        return []
    side, outwards = (0, -0.08) if np.diff(np.sum(ends, axis=0))[0] <= 0.0 else (-1, 0.08)
    curves = {
        row: (levels.pressure[known] / 1e3, 1e3 * levels.flow[row, known])
        for row, known in drawn.items()
    }
    marks: list[Words] = []
    for row, known in drawn.items():
        x = float(levels.pressure[known[side]]) / 1e3 + outwards * reach
        y, text = 1e3 * float(levels.flow[row, known[side]]), fixed(float(levels.duty[row]), 2)
        is_clear = not any(
            np.any((np.abs(p - x) < _NAME_WIDTH * reach) & (np.abs(q - y) < _NAME_HEIGHT * span))
            for other, (p, q) in curves.items()
            if other != row
        )
        if is_clear and all(
            abs(x - m.x) > 2.0 * _NAME_WIDTH * reach or abs(y - m.y) > 2.0 * _NAME_HEIGHT * span
            for m in marks
        ):
            marks.append(Words(x, y, text, is_small=True))
    return marks


__all__ = ["DIRECTIONS", "flow_figure", "surfaces_section"]
