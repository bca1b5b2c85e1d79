"""The monitor's part of the C header: the model's rates printed, the observers around them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np

from sysid.controllers.monitor.design import MonitorDesign, monitor_design
from sysid.controllers.monitor.drifts import CHAMBER, DRIFTS, KINDS, NAMES, SHAFT
from sysid.controllers.monitor.evidence import (
    EXCITED,
    FORGETTING,
    LEARNING,
    ODDS,
    Detectable,
    threshold,
)
from sysid.controllers.monitor.observer import CLIP, LOGISTIC, NARROW, SURE
from sysid.controllers.monitor.reference import reference_changes
from sysid.controllers.monitor.stated import change_lines, promise
from sysid.controllers.monitor.strokes import SHARE
from sysid.controllers.monitor.terms import (
    PAST,
    ChamberPoint,
    chamber_rate,
    rate_per_flow,
    shaft_effort,
    swept_rate,
)
from sysid.errors import SysidError
from sysid.exporters.c_control import function_text
from sysid.exporters.c_text import LARGEST, Names, comment_text, indented, literal, number
from sysid.exporters.control_function import ControlFunction, Number
from sysid.exporters.control_model import ControlModel
from sysid.io.channels import SIDES
from sysid.parameters import Bundle
from sysid.plant.base import Array
from sysid.plant.effects.entry import Catalogue
from sysid.plant.valve_timing import TIME_TOLERANCE

# A ratio below which nothing of a pressure's distribution is past a boundary.
_FAR_RATIO = 40.0
_POINT = (
    Number("position", "position"),
    Number("velocity", "velocity"),
    Number("pressure_pa", "pressure"),
    Number("other_pa", "pressure"),
)


@dataclass(frozen=True)
class MonitorInC:
    """A monitor of a header: its design, and the smallest changes on its reference cycle."""

    design: MonitorDesign
    changes: tuple[Detectable, float] | None


def monitor_of(
    bundle: Bundle, control: ControlModel | str, catalogue: Catalogue | None
) -> MonitorInC | str:
    """A header's monitor, or why it has none."""
    if isinstance(control, str):
        return control
    if control.ignored:
        return f"the code of {', '.join(control.ignored)} has no form in C"
    try:
        design = monitor_design(bundle, catalogue)
    except SysidError as reason:
        return str(reason)
    return MonitorInC(design, reference_changes(design))


def _rate(side: str) -> ControlFunction:
    def evaluate(
        design: Any,
        position: Array,
        velocity: Array,
        pressure: Array,
        other: Array,
        own: Array,
        its: Array,
        supply: Array,
    ) -> Array:
        at = ChamberPoint(position, velocity, pressure, other, own, its, own, own)
        return chamber_rate(design.model.settled(), side, at, own, supply)

    return ControlFunction(
        f"monitor_rate_{side}",
        f"dP/dt of chamber {side.upper()}, Pa/s; other_pa is the other chamber's pressure, the "
        "valves are open, 1, or shut, 0",
        (
            *_POINT,
            Number("is_open", "switch"),
            Number("other_open", "switch"),
            Number("supply_pa", "supply"),
        ),
        evaluate,
    )


def _swept(side: str) -> ControlFunction:
    def evaluate(
        design: Any, position: Array, velocity: Array, pressure: Array, other: Array
    ) -> Array:
        none = 0.0 * pressure
        at = ChamberPoint(position, velocity, pressure, other, none, none, none, none)
        return swept_rate(design.model.settled(), side, at)

    return ControlFunction(f"monitor_swept_{side}", "The same without any flow", _POINT, evaluate)


def _per_flow(side: str) -> ControlFunction:
    return ControlFunction(
        f"monitor_per_flow_{side}",
        f"k R T / V of chamber {side.upper()}, Pa/kg",
        _POINT[:1],
        lambda design, position: rate_per_flow(design.model.settled(), side, position),
    )


MONITOR_FUNCTIONS = (
    *(one for side in SIDES for one in (_rate(side), _swept(side), _per_flow(side))),
    ControlFunction(
        "monitor_effort",
        "All efforts less friction while the shaft moves as the velocity says, Nm or N",
        (
            *_POINT[:2],
            Number("pressure_a_pa", "pressure"),
            Number("pressure_b_pa", "pressure"),
            Number("motor", "effort"),
        ),
        lambda design, *at: shaft_effort(design.model.settled(), *at),
    ),
)
"""The model's rates, which the header's guard checks as any other law."""


def monitor_laws(control: ControlModel, n: Names) -> str:
    """The model's rates as functions of C."""
    return "\n".join(function_text(one.law(control.named), n) for one in MONITOR_FUNCTIONS)


def monitor_text(made: MonitorInC, n: Names) -> str:
    """The monitor itself."""
    design, period = made.design, float(made.design.noise.period)
    drifts = [
        f"    @P@MONITOR_DRIFT_{name.upper()}, /* {DRIFTS[k].title} */" for k, name in _named()
    ]
    text = resources.files("sysid.exporters").joinpath("monitor.h.in").read_text("utf-8")
    kinds = ", ".join(f"@P@MONITOR_{kind.upper()}" for kind in KINDS)
    pieces = {
        "title": "\n".join(_title(made)),
        "drifts": "\n".join(drifts),
        "kinds": f"@P@MONITOR_HEALTHY,\n    {kinds},\n    @P@MONITOR_UNDECIDED",
        "constants": _constants(design, n),
        "period": f"(@p@real){number(period)}",
        "share": f"{100.0 * SHARE:g}",
        "flops": f"{_flops():,}",
        "never": f"(@p@real){number(LARGEST)}",
        "chamber": str(len(CHAMBER["a"])),
        "shaft": str(len(SHAFT)),
        "columns": str(design.scatter.shape[1]),
        "learning": str(LEARNING),
        "together": f"(@p@real){number(max(TIME_TOLERANCE / period, 1e-6))}",
        "logistic": number(LOGISTIC),
        "narrow": number(NARROW),
        "past": number(PAST),
        "ratio": number(_FAR_RATIO),
        "clip": number(CLIP),
        "sure": number(SURE),
    }
    text = text.replace("each @period@ s", f"each {number(period)} s")
    for key, value in pieces.items():
        text = text.replace(f"@{key}@", value)
    return text.replace("@p@", n.lower).replace("@P@", n.upper)


def _named() -> Iterable[tuple[int, str]]:
    return enumerate(NAMES)


def _flops() -> int:
    """About what the end of a cycle takes, in multiplications and additions."""
    p, r = len(NAMES), 4
    return 1000 * round((4 * (p**3 + p**3 / 6 + p**3 / 2 + p**3) + 4 * r * p * p) / 1000)


def _title(made: MonitorInC) -> Iterator[str]:
    yield "   What left its bundle: friction, leakage, delay or supply."
    for line in (*promise(), *change_lines(made.design, made.changes)):
        yield f"   {comment_text(line)}".rstrip()


def _constants(design: MonitorDesign, n: Names) -> str:
    """The design's numbers as tables of C."""
    p, model = design.model.parameters, design.model
    pairs = [design.delays[side] for side in SIDES]
    found = [
        _one("monitor_pressure_noise", float(design.noise.pressure), "Pa", n),
        _one("monitor_position_noise", float(design.noise.position), design.units.position, n),
        _one("monitor_supply", float(p.supply), "Pa", n),
        _one("monitor_atmosphere", float(p.atmosphere), "Pa", n),
        _one("monitor_pwm_period", float(p.pwm_period), "s", n),
        _table("monitor_on_delay", [on for on, _ in pairs], n),
        _table("monitor_off_delay", [off for _, off in pairs], n),
        _table("monitor_sweep", [design.swept[side] for side in SIDES], n),
        _rows("monitor_choked", [design.choked[side] for side in SIDES], n),
        _one("monitor_inertia", float(design.shaft.inertia), design.units.inertia_unit, n),
        _one("monitor_viscous", float(design.shaft.viscous), design.units.viscous_unit, n),
        _one("monitor_breakaway", float(design.shaft.breakaway), design.units.effort, n),
        _one("monitor_acceleration_variance", float(design.shaft.variance), "", n),
        _one("monitor_travel", float(design.shaft.travel), design.units.position, n),
        _one("monitor_speed", design.speed, design.units.speed, n),
        _one("monitor_least_stroke", SHARE * design.stroke, design.units.position, n),
        _table("monitor_scales", design.scales, n),
        _rows("monitor_chamber_scales", [design.chamber_scales(side) for side in SIDES], n),
        _table("monitor_shaft_scales", design.shaft_scales, n),
        _rows("monitor_scatter", design.scatter, n),
        "/* Variances of the bundle's errors, and the covariance of friction's first two. */",
        _table("monitor_errors", np.diag(design.errors), n),
        "/* The same while the monitor learns. */",
        _table("monitor_first_errors", np.diag(design.errors) + design.learning, n),
        _one("monitor_shared_error", float(design.errors[0, 1]), "", n),
        _one("monitor_threshold", threshold(), "standard deviations", n),
        _one("monitor_log_odds", math.log(ODDS), "", n),
        _one("monitor_forgetting", FORGETTING, "", n),
        f"static const {n.lower}real {n.lower}monitor_excited = sizeof({n.lower}real) == "
        f"sizeof(float) ? {literal(1e-5, n)} : {literal(EXCITED, n)};",
        _whole("monitor_kind", [1 + KINDS.index(d.kind) if d.kind else 0 for d in DRIFTS], n),
        _whole("monitor_grows", [int(d.grows_only) for d in DRIFTS], n),
        _whole_rows("monitor_chamber_places", [CHAMBER[side] for side in SIDES], n),
        _whole("monitor_shaft_places", SHAFT, n),
    ]
    assert model.state_names == ()
    return "\n".join(found)


def _one(name: str, value: float, unit: str, n: Names) -> str:
    said = f" /* {comment_text(unit)} */" if unit else ""
    return f"static const {n.lower}real {n.lower}{name} = {literal(value, n)};{said}"


def _table(name: str, values: Iterable[float], n: Names) -> str:
    items = [literal(float(v), n) for v in values]
    head = f"static const {n.lower}real {n.lower}{name}[{len(items)}]"
    return f"{head} = {{\n{indented([', '.join(items)])}\n}};"


def _rows(name: str, rows: Sequence[Sequence[float]] | np.ndarray[Any, Any], n: Names) -> str:
    texts = ["{" + ", ".join(literal(float(v), n) for v in row) + "}" for row in rows]
    head = f"static const {n.lower}real {n.lower}{name}[{len(texts)}][{len(rows[0])}]"
    return f"{head} = {{\n{indented([', '.join(texts)])}\n}};"


def _whole(name: str, values: Sequence[int], n: Names) -> str:
    items = ", ".join(map(str, values))
    return f"static const int {n.lower}{name}[{len(values)}] = {{\n{indented([items])}\n}};"


def _whole_rows(name: str, rows: Sequence[Sequence[int]], n: Names) -> str:
    texts = ", ".join("{" + ", ".join(map(str, row)) + "}" for row in rows)
    return f"static const int {n.lower}{name}[{len(rows)}][{len(rows[0])}] = {{{texts}}};"


__all__ = ["MONITOR_FUNCTIONS", "MonitorInC", "monitor_laws", "monitor_of", "monitor_text"]
