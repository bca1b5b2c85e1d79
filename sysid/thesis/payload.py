"""Tables 5.4.4 to 5.4.26: the controller takes the payload for another than is carried.

A row of `table_5_4.csv` is three printed cells: everything about the loop, and its error with a
lighter payload than the controller assumes, with that one, and with a heavier one
(`table_5_4_payloads.csv`, Table 5.4.1).
"""

from __future__ import annotations

from sysid.controllers.modes import Mode
from sysid.thesis.declaration import (
    Cell,
    Column,
    Declaration,
    TableLoop,
    figure,
    printed,
    rows_of,
)

_CASES = ("below", "equal", "above")
_NAMES = {
    "mode": "{}",
    "type": "type {}",
    "trajectory": "trajectory {}",
    "estimator": "estimator {}",
    "controller_payload_kg": "{} kg",
}


def carried() -> dict[str, tuple[str, ...]]:
    """Payloads on the plant by the controller's, kg as printed: lighter, equal, heavier."""
    found: dict[str, tuple[str, ...]] = {}
    for row in printed("table_5_4_payloads"):
        key = row["controller_payload_kg"]
        found[key] = (*found.get(key, ()), row["actual_payload_kg"])
    return found


def by_payload(table: str, rows: tuple[str, ...], groups: str) -> Declaration:
    """A table whose rows differ in the keys `rows` and its groups of columns in `groups`."""
    given = rows_of("table_5_4", table)
    parts = list(dict.fromkeys(row[groups] for row in given))
    payloads = {row["controller_payload_kg"] for row in given}
    carries = carried()
    titles = [f"{kg} kg" for kg in carries[min(payloads)]]
    if len(payloads) > 1:
        titles = ["lighter", "equal", "heavier"]
    columns = tuple(Column(t, _NAMES[groups].format(part)) for part in parts for t in titles)
    lines: dict[tuple[str, ...], list[Cell]] = {}
    for row in given:
        lines.setdefault(tuple(row[key] for key in rows), []).extend(_cells(row, carries))
    named = tuple((_label(rows, key, carries), tuple(cells)) for key, cells in lines.items())
    return Declaration(columns, named)


def _label(
    keys: tuple[str, ...], values: tuple[str, ...], carries: dict[str, tuple[str, ...]]
) -> str:
    words = []
    for key, value in zip(keys, values, strict=True):
        word = _NAMES[key].format(value)
        if key == "controller_payload_kg":
            word = f"{word} for {', '.join(carries[value])}"
        words.append(word)
    return ", ".join(words)


def _cells(row: dict[str, str], carries: dict[str, tuple[str, ...]]) -> list[Cell]:
    assumed = row["controller_payload_kg"]
    return [
        Cell((_loop(row, float(kg)),), figure(row[f"{case}_rmse_rad"]))
        for case, kg in zip(_CASES, carries[assumed], strict=True)
    ]


def _loop(row: dict[str, str], carried_kg: float) -> TableLoop:
    return TableLoop(
        row["controller"],
        Mode(row["mode"]),
        int(row["trajectory"]),
        type=int(row["type"]),
        orientation=row["orientation"],
        assumed_kg=float(row["controller_payload_kg"]),
        carried_kg=carried_kg,
        has_estimator=row["estimator"] == "on",
    )


__all__ = ["by_payload", "carried"]
