"""What a fit shows of its bundle: the parameters of friction and valves, and remarks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from sysid.blocks.numbers import si_cells
from sysid.blocks.tables import Table, estimate_table, table
from sysid.parameters import Bundle, FittedValves
from sysid.parameters.base import read_number
from sysid.pipeline.fit_logs import Fitted


def friction_tables(fitted: Fitted) -> Iterable[Table]:
    """The friction parameters, and static friction by position."""
    yield from _of_friction(fitted.bundle)
    yield _remarks(fitted)


def _of_friction(bundle: Bundle) -> Iterable[Table]:
    friction = bundle.friction
    if friction is not None:
        yield estimate_table("Friction", friction.estimates(), "command")
        sums = {name: row.estimate for name, row in friction.sums().items()}
        yield estimate_table("Identified only together", sums, "command")
        for effect in bundle.effects:
            yield estimate_table(effect.id, effect.numbers(), "command")
        columns = ("position", "tests", "value", "95 % interval", "unit")
        rows = tuple(
            (f"{row.position:.4g}", str(row.tests), *si_cells(row.static))
            for row in friction.positions()
        )
        yield table("Static friction by position", columns, rows)


def valve_tables(fitted: Fitted) -> Iterable[Table]:
    """Each valve's flow parameters and delays, and its surfaces' errors."""
    valves = fitted.bundle.valves or FittedValves()
    for name, valve in valves.sides().items():
        if valve.discrete is not None:
            yield estimate_table(
                f"Valve {name.upper()}, on/off", valve.discrete.estimates(), "command"
            )
    columns = (
        "valve", "direction", "surface", "RMSE", "largest relative error, %", "parameters",
    )  # fmt: skip
    title = "PWM surfaces, error in duty on held-out tests"
    yield table(title, columns, tuple(_surface_rows(valves)))
    yield _remarks(fitted)


def _surface_rows(valves: FittedValves) -> Iterator[tuple[str, ...]]:
    for name, valve in valves.sides().items():
        for direction, held in (valve.pwm.directions() if valve.pwm else {}).items():
            for kind, surface in held.surfaces().items():
                numbers = (surface.rmse_duty, surface.max_relative_error_duty_percent)
                cells = [f"{read_number(n):.3g}" for n in numbers]
                count = "41" if kind == "ann" else "9"
                yield name.upper(), direction, kind, *cells, count


def _remarks(fitted: Fitted) -> Table:
    return table("Remarks", ("",), tuple((remark,) for remark in fitted.remarks))


def campaign_tables(fitted: Fitted) -> Iterable[Table]:
    """Every part of a campaign's bundle, or the parameters of a component of the user's own."""
    record = fitted.bundle.component
    if record is not None:
        yield estimate_table(f"{record.name} ({record.kind})", record.parameters, "command")
    yield from _of_friction(fitted.bundle)
    yield from valve_tables(fitted)


__all__ = ["campaign_tables", "friction_tables", "valve_tables"]
