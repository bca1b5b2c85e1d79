"""A bundle's content as flat JSON: numbers by name, and their units in a parallel table."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from sysid.exporters.flat import DIRECTIONS, FORMAT, Flat, clean_text, units, values
from sysid.exporters.surface_tables import (
    DOMAIN_UNITS,
    ExportedSurface,
    domain_arrays,
)
from sysid.surfaces.kinds import SURFACES

_STATIC = "static_by_position"


def render(flat: Flat) -> str:
    """The file's text (UTF-8, no NaN). Unknown numbers are null; `not_identified` says why."""
    return json.dumps(content(flat), indent=2, allow_nan=False, ensure_ascii=False) + "\n"


def content(flat: Flat) -> dict[str, Any]:
    """The JSON object: `constants`, `friction`, `valves`, ... and `units` of the same shape."""
    rig = flat.rig
    position = f"position_{rig.units.position}"
    numbers: dict[str, Any] = {
        "constants": values(flat.constants),
        "friction": {
            **values(flat.friction),
            _STATIC: {
                position: [row[0] for row in flat.static_by_position],
                static_name(flat): [row[1] for row in flat.static_by_position],
            },
        },
        "valves": {},
        "effects": [{"id": e.id, "parameters": e.values} for e in flat.effects],
    }
    friction_units = units(flat.friction)
    by_position = {
        position: rig.units.position,
        static_name(flat): friction_units[static_name(flat)],
    }
    table: dict[str, Any] = {
        "constants": units(flat.constants),
        "friction": {**friction_units, _STATIC: by_position},
        "valves": {},
        "effects": [{"id": e.id, "parameters": e.units} for e in flat.effects],
    }
    for side, valve in flat.valves.items():
        numbers["valves"][side] = {"discrete": values(valve.discrete), "pwm": {}}
        table["valves"][side] = {"discrete": units(valve.discrete), "pwm": {}}
        for direction in DIRECTIONS:
            part = valve.pwm[direction]
            pairs = {kind: surface_content(part.surfaces[kind]) for kind in SURFACES}
            numbers["valves"][side]["pwm"][direction] = {
                **values(part.conditions),
                **{kind: pair[0] for kind, pair in pairs.items()},
            }
            table["valves"][side]["pwm"][direction] = {
                **units(part.conditions),
                **{kind: pair[1] for kind, pair in pairs.items()},
            }
    return {
        "format": FORMAT,
        "rig": rig_text(flat),
        **numbers,
        "units": table,
        "not_identified": dict(flat.missing),
        "provenance": dict(flat.provenance),
    }


def rig_text(flat: Flat) -> dict[str, str]:
    """Name, orientation and motion of the rig."""
    rig = flat.rig
    return {"name": clean_text(rig.name), "orientation": rig.orientation, "motion": rig.motion}


def static_name(flat: Flat) -> str:
    """Key of static friction: `static_nm` or `static_n`."""
    return flat.rig.units.key("static")


def surface_content(surface: ExportedSurface | None) -> tuple[dict[str, Any] | None, Any]:
    """A surface's numbers and, of the same shape, their units."""
    if surface is None:
        return None, None
    model = surface.model
    exported = model.exported()
    numbers: dict[str, Any] = {part.key: np.asarray(part.values).tolist() for part in exported}
    table: dict[str, Any] = {part.key: part.unit for part in exported}
    scaled = model.scaled_units
    numbers["scaling"] = {
        name: {"centre": row[0], "half_range": row[1]}
        for name, row in zip(scaled, model.scaling_.tolist(), strict=True)
    }
    table["scaling"] = {name: {"centre": u, "half_range": u} for name, u in scaled.items()}
    domain = model.domain_
    numbers["domain"] = {
        "duty_range": list(domain.duty_range),
        "pressure_range_pa": list(domain.pressure_range),
        "nodes": {name: array.tolist() for name, array in domain_arrays(domain).items()},
    }
    table["domain"] = {"duty_range": "1", "pressure_range_pa": "Pa", "nodes": dict(DOMAIN_UNITS)}
    numbers["errors"] = {name: pair[0] for name, pair in surface.errors.items()}
    table["errors"] = {name: pair[1] for name, pair in surface.errors.items()}
    return numbers, table
