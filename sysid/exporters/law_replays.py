"""The replays of the header's base laws and surfaces (`replays.Replay`)."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

from sysid.exporters.c_constants import parameter_values
from sysid.exporters.c_surfaces import surface_functions
from sysid.exporters.flat import Flat, NumberTable
from sysid.exporters.replay import Replay, simple
from sysid.io.channels import SIDES
from sysid.plant import base
from sysid.plant.base import Parameters


def law_replays(flat: Flat, constants: NumberTable, features: Collection[str]) -> Iterator[Replay]:
    """Those of every law that the header holds, with the header's own constants."""
    p = Parameters(**parameter_values(flat, constants))
    yield from (replay for feature, replay in _mechanics(flat, p) if feature in features)
    for side in SIDES:
        yield from (replay for feature, replay in _chamber(side, p) if feature in features)
    yield from (function.replay() for function in surface_functions(flat))


def _mechanics(flat: Flat, p: Parameters) -> Iterator[tuple[str, Replay]]:
    word = flat.rig.units.word
    pressures = ("pressure", "pressure")

    def cylinder(a: Any, b: Any) -> Any:
        return base.cylinder_effort(a, b, p.area_a, p.area_b, p.atmosphere, p.pitch_radius)

    def gravity(position: Any) -> Any:
        return base.gravity_effort(position, p.gravity_moment, p.weight) + 0.0 * position

    def sliding(velocity: Any) -> Any:
        return base.sliding_friction(velocity, p.coulomb_effort, p.viscous)

    def friction(velocity: Any, applied: Any) -> Any:
        laws = p.static_effort, p.coulomb_effort, p.viscous
        return base.friction_effort(velocity, applied, *laws)

    yield "HAS_CYLINDER", simple(f"cylinder_{word}", pressures, cylinder)
    yield "HAS_GRAVITY", simple(f"gravity_{word}", ("position",), gravity)
    yield "HAS_SLIDING_FRICTION", simple(f"sliding_friction_{word}", ("velocity",), sliding)
    yield "HAS_FRICTION", simple(f"friction_{word}", ("velocity", "effort"), friction)


def _chamber(side: str, p: Parameters) -> Iterator[tuple[str, Replay]]:
    valve, upper = p.valve(side), side.upper()
    volume = base.chamber_volume_a if side == "a" else base.chamber_volume_b
    area, offset = getattr(p, f"area_{side}"), getattr(p, f"offset_{side}")
    swept = area * p.pitch_radius * (1.0 if side == "a" else -1.0)
    air = p.heat_capacity_ratio, p.gas_constant, p.temperature

    def fill(pressure: Any, supply: Any) -> Any:
        return base.filling_flow(
            pressure, supply, valve.choked_fill, valve.c_fill, p.supply_reference
        )

    def exhaust(pressure: Any, atmosphere: Any) -> Any:
        return base.exhaust_flow(pressure, atmosphere, valve.choked_dis, valve.c_dis)

    def volumes(position: Any, velocity: Any) -> tuple[Any, Any]:
        return volume(position, area, offset, p.pitch_radius), swept * velocity

    def rate(pressure: Any, position: Any, velocity: Any, flow: Any) -> Any:
        return base.pressure_rate(pressure, flow, *volumes(position, velocity), *air)

    def flow(rate: Any, pressure: Any, position: Any, velocity: Any) -> Any:
        rates = volumes(position, velocity)
        return base.flow_from_pressure_rate(rate, pressure, *rates, *air)

    yield (
        f"HAS_VALVE_{upper}_FILLING",
        simple(f"valve_{side}_filling_flow", ("pressure", "supply"), fill),
    )
    yield (
        f"HAS_VALVE_{upper}_EXHAUST",
        simple(f"valve_{side}_exhaust_flow", ("pressure", "atmosphere"), exhaust),
    )
    moving = ("pressure", "position", "velocity")
    yield (
        f"HAS_CHAMBER_{upper}",
        simple(f"pressure_rate_{side}", (*moving, "flow"), rate),
    )
    yield (
        f"HAS_CHAMBER_{upper}",
        simple(f"flow_for_pressure_rate_{side}", ("rate", *moving), flow),
    )


__all__ = ["law_replays"]
