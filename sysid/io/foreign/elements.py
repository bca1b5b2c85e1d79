"""Structs and cells of one sample each, `d(1).t`, `d(2).t`, ..., as the columns that they are.

A script that logs by `d(k).t = ...` or `c{k} = ...` leaves an array of as many elements as samples.
"""

from __future__ import annotations

import re

import numpy as np

from sysid.io.foreign.table import Column, ForeignTable

_ELEMENT = re.compile(
    r"(?P<whole>.*)(?:\((?P<struct>\d+)\)(?P<field>\.[^(){}]*)|\{(?P<cell>\d+)\})"
)
_FEWEST = 3


def gather_elements(table: ForeignTable) -> None:
    """Put elements of one number each into one column, "d.t" or "c"; NaN where one is empty."""
    groups: dict[str, dict[int, str]] = {}
    for name in (*table.columns, *table.skipped):
        if (match := _ELEMENT.fullmatch(name)) is not None:
            whole = match["whole"] + (match["field"] or "")
            groups.setdefault(whole, {})[int(match["struct"] or match["cell"])] = name
    for whole, elements in groups.items():
        column = _gathered(table, elements)
        if column is not None and whole not in table.columns and whole not in table.skipped:
            for name in elements.values():
                table.columns.pop(name, None)
                table.skipped.pop(name, None)
            table.columns[whole] = column


def _gathered(table: ForeignTable, elements: dict[int, str]) -> Column | None:
    """The numbers of elements 1 to n (n,); None where one is missing, or is more than a number."""
    count = len(elements)
    if count < _FEWEST or max(elements) != count:
        return None
    filled = {
        index: table.columns[name] for index, name in elements.items() if name in table.columns
    }
    empty = all(
        table.skipped[name] == "empty" for name in elements.values() if name in table.skipped
    )
    if not empty or 2 * len(filled) < count or any(len(one) != 1 for one in filled.values()):
        return None
    if len(filled) == count:
        return np.concatenate([filled[index] for index in range(1, count + 1)])
    found = np.full(count, np.nan)
    for index, value in filled.items():
        found[index - 1] = value[0]
    return found


__all__ = ["gather_elements"]
