"""JSON and JSON lines: objects of arrays, arrays of objects, and what pandas writes."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sysid.errors import InputError, input_error
from sysid.io.bounds import MOST_DEPTH, VARIABLE, check_columns, most_cells
from sysid.io.file_kinds import decoded
from sysid.io.foreign.table import Column, ForeignTable, ReadOptions

# Recognised by its first characters, not its name: an object with a key, or an array of objects or
# arrays. Divides the bound of cells: a value of JSON takes several times a number's memory.
_SHARE = 5
_UNITS = ("unit", "units")


def read(path: Path, file: BinaryIO, options: ReadOptions) -> ForeignTable:
    """Arrays by their keys, nested ones by dots; rows of arrays as `#1`, `#2` or by their names.

    A null, and a key that an object of an array lacks, is an empty cell. Raises InputError where
    the text is no JSON, gives a key twice, or holds more values than are read.
    """
    text = _text(path, file.read())
    table = ForeignTable(path, "JSON")
    _check_size(path, text)
    lines = [(i, line) for i, line in enumerate(text.splitlines(), start=1) if line.strip()]
    if len(lines) > 1 and _is_whole(lines[0][1]):
        table.format = "JSON lines"
        content: Any = [_parsed(path, line, number) for number, line in lines]
        table.place = lambda row: f"line {lines[row][0]}"
    else:
        content = _parsed(path, text, 1)
    try:
        _Walk(table).top(content)
    except RecursionError:
        raise _no_json(path, 1, "it is nested too deep") from None
    return table


def _text(path: Path, raw: bytes) -> str:
    is_utf16 = raw.startswith((b"\xff\xfe", b"\xfe\xff"))
    return decoded(path, raw, "utf-16" if is_utf16 else "utf-8-sig")


def _check_size(path: Path, text: str) -> None:
    values = sum(text.count(sign) for sign in ",[{")
    if values > (most := most_cells() // _SHARE):
        raise input_error(
            path,
            f"has about {values:,} values, more than the {most:,} that are read from JSON",
            f"save it as CSV or Parquet, or raise {VARIABLE}",
        )


def _is_whole(line: str) -> bool:
    try:
        return isinstance(json.loads(line), dict | list)
    except (ValueError, RecursionError):
        return False


def _parsed(path: Path, text: str, line: int) -> Any:
    try:
        return json.loads(text, object_pairs_hook=_once)
    except json.JSONDecodeError as error:
        raise _no_json(path, line + error.lineno - 1, error.msg) from None
    except (ValueError, RecursionError) as error:
        reason = str(error) if isinstance(error, ValueError) else "it is nested too deep"
        raise _no_json(path, line, reason) from None


def _no_json(path: Path, line: int, reason: str) -> InputError:
    return input_error(
        f"{path}, line {line}",
        f"cannot be read as JSON ({reason})",
        "fix it there, or delete what follows if the recording was cut off",
    )


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        keys = [key for key, _ in pairs]
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"the key {twice!r} is given twice")
    return found


class _Walk:
    """Traverses the content of a JSON text, and gives its columns to a table."""

    def __init__(self, table: ForeignTable) -> None:
        self._table = table

    def top(self, content: Any) -> None:
        """The whole content; a single table in it is known without its key, too."""
        self._visit("", content, 0)
        if not isinstance(content, dict):
            return
        holders = [key for key, value in content.items() if isinstance(value, dict | list)]
        if len(holders) != 1:
            return
        within = f"{holders[0]}."
        self._table.columns = _also_without(within, self._table.columns)
        self._table.units = _also_without(within, self._table.units)

    def _visit(self, name: str, value: Any, depth: int) -> None:
        if depth > MOST_DEPTH:
            self._table.skipped[name] = "nested too deep"
        elif isinstance(value, dict):
            self._object(name, value, depth)
        elif isinstance(value, list):
            self._array(name, value, depth)
        elif isinstance(value, str):
            self._table.skipped[name or "the text"] = "text"
        elif value is not None:
            self._put(name or "#1", [value])

    def _object(self, name: str, value: dict[str, Any], depth: int) -> None:
        names, rows = value.get("columns"), value.get("data")
        if isinstance(names, list) and isinstance(rows, list) and _all(rows, list):
            self._rows(name, rows, [str(part) for part in names])
            return
        schema = value.get("schema")
        if isinstance(schema, dict) and "fields" in schema and isinstance(rows, list):
            self._array(name, rows, depth)  # pandas' orient="table"
            return
        inner = list(value.values())
        if len(inner) > 1 and _all(inner, dict) and _are_numbers(value):
            self._records(name, inner, depth)  # pandas' orient="index"
            return
        unit = next((value[key] for key in _UNITS if isinstance(value.get(key), str)), None)
        for key, part in value.items():
            full = f"{name}.{key}" if name else key
            if isinstance(part, dict) and len(part) > 1 and _are_numbers(part) and _flat(part):
                self._put(full, list(part.values()))  # pandas' orient="columns"
                continue
            if key in _UNITS and isinstance(part, dict) and _all(part.values(), str):
                self._table.units |= {f"{name}.{k}" if name else k: u for k, u in part.items()}
                continue
            self._visit(full, part, depth + 1)
            if unit is not None and isinstance(part, list):
                self._table.units[full] = unit

    def _array(self, name: str, value: list[Any], depth: int) -> None:
        if not value:
            self._table.skipped[name or "the array"] = "empty"
        elif _all(value, dict):
            self._records(name, value, depth)
        elif _all(value, list):
            named = _all(value[0], str) and len(value) > 1
            self._rows(name, value[named:], value[0] if named else None)
            if named:
                self._table.place = lambda row: f"row {row + 2}"
        elif any(isinstance(part, dict | list) for part in value):
            self._table.skipped[name or "the array"] = "an array of values of several kinds"
        else:
            self._put(name or "#1", value)

    def _rows(self, name: str, rows: list[list[Any]], names: list[str] | None) -> None:
        """Rows of as many cells each; InputError where one has more or fewer."""
        width = len(names) if names is not None else max(map(len, rows), default=0)
        check_columns(self._table.path, width)
        for number, row in enumerate(rows, start=1):
            if len(row) != width:
                raise input_error(
                    f"{self._table.path}, row {number}" + (f" of {name}" if name else ""),
                    f"has {len(row)} values where there are {width} columns",
                    "complete the row or delete it",
                )
        for index in range(width):
            own = names[index] if names is not None else f"#{index + 1}"
            full = own if not name else f"{name}.{own}" if names is not None else f"{name}{own}"
            self._put(full, [row[index] for row in rows])

    def _records(self, name: str, rows: list[dict[str, Any]], depth: int) -> None:
        """An array of objects: a column for each key, nested ones by dots."""
        flat: list[dict[str, Any]] = []
        for row in rows:
            cells: dict[str, Any] = {}
            _flatten(cells, "", row, depth)
            flat.append(cells)
        keys = dict.fromkeys(key for cells in flat for key in cells)
        check_columns(self._table.path, len(keys))
        # An object without most of the keys is as wide as the others.
        if len(keys) * len(flat) > most_cells() // _SHARE:
            raise input_error(
                self._table.path,
                f"has {len(flat):,} objects of {len(keys):,} keys in all",
                "save the objects of each kind in a file of their own",
            )
        for key in keys:
            self._put(f"{name}.{key}" if name else key, [cells.get(key) for cells in flat])

    def _put(self, name: str, values: list[Any]) -> None:
        """A column of numbers, with NaN for null, or of texts."""
        kinds = {type(value) for value in values}
        if kinds <= {float, int, bool, type(None)}:
            if kinds == {type(None)}:
                self._table.skipped[name] = "empty"
                return
            try:
                column: Column = np.array(
                    [np.nan if value is None else value for value in values], dtype=np.float64
                )
            except OverflowError:
                column = np.array(values, dtype=object)
        elif kinds <= {float, int, bool, type(None), str}:
            column = np.array(values, dtype=object)
        else:
            self._table.skipped[name] = "an array of values of several kinds"
            return
        self._table.columns[name] = column


def _also_without(prefix: str, named: dict[str, Any]) -> dict[str, Any]:
    """What names begin with a prefix for, by the rest of these names, too."""
    found: dict[str, Any] = {}
    for name, value in named.items():
        short = name.removeprefix(prefix)
        if short not in named:
            found[short] = value
        found[name] = value
    return found


def _flatten(cells: dict[str, Any], name: str, value: Any, depth: int) -> None:
    """An object's values by dots, an array's by their numbers from 0."""
    if depth > MOST_DEPTH:
        return
    if isinstance(value, dict):
        for key, part in value.items():
            _flatten(cells, f"{name}.{key}" if name else key, part, depth + 1)
    elif isinstance(value, list):
        for index, part in enumerate(value):
            _flatten(cells, f"{name}[{index}]", part, depth + 1)
    else:
        cells[name] = value


def _all(values: Iterable[Any], kind: type) -> bool:
    """Whether there are values, all of a kind."""
    found = [isinstance(value, kind) for value in values]
    return bool(found) and all(found)


def _flat(value: dict[str, Any]) -> bool:
    return not any(isinstance(part, dict | list) for part in value.values())


def _are_numbers(value: dict[str, Any]) -> bool:
    return all(key.lstrip("-").isdecimal() for key in value)


__all__ = ["read"]
