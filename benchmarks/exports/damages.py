"""What befalls an export: a cell, a row, a heading, a unit, a cut file.

Not drawn is what nobody can see: a digit in place of another, a number that lost its last digits,
a cut between two lines, rows missing where no time is written, a sample missing in a slower column.
"""

from __future__ import annotations

import copy
import random
import re
from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.exports.record import Sheet, Style


@dataclass(frozen=True)
class Damage:
    """A damaged file, and what a message has to name: one word of each group."""

    kind: str
    data: bytes
    names: tuple[tuple[str, ...], ...]
    row: int | None = None


_Change = Callable[[random.Random, Style, Sheet], "Damage | None"]


def damaged(draw: random.Random, style: Style, sheet: Sheet | None, data: bytes) -> Damage:
    """One damage, drawn among those that this file can suffer."""
    if sheet is None or not sheet.places:
        return _binary(draw, data)
    for change in draw.sample(_CHANGES, len(_CHANGES)):
        found = change(draw, style, copy.deepcopy(sheet))
        if found is not None:
            return found
    raise ValueError(f"{style.name}: no damage applies")


def _binary(draw: random.Random, data: bytes) -> Damage:
    if draw.random() < 0.6:
        end = draw.randrange(len(data) // 10, len(data) * 19 // 20)
        while data[end - 1] in b"}\n":  # a line's end: nothing of it is missing
            end -= 1
        return Damage(f"cut off after {end} of {len(data)} bytes", data[:end], ())
    changed = bytearray(data)
    place = draw.randrange(16)
    changed[place] ^= 1 << draw.randrange(8)
    return Damage(f"byte {place} changed", bytes(changed), ())


def _row(draw: random.Random, sheet: Sheet, least: int = 1) -> int:
    """A row of the body, not the last, that no start stands at."""
    near = {row + shift for row in sheet.inserted for shift in (-1, 0)}
    return draw.choice([r for r in range(least, len(sheet.body) - 2) if r not in near])


def _place(sheet: Sheet, row: int, shift: int = 0) -> tuple[str, ...]:
    """The words for a body row: its line in the file, or its number in the table."""
    return tuple(
        f"{word} {number}"
        for n in (row, row + shift)
        for word, number in (("line", sheet.line_of(n)), ("row", n + 1))
    )


def _cell(kind: str, change: Callable[[random.Random, str], str | None]) -> _Change:
    """A damage of one cell of a mapped column."""

    def apply(draw: random.Random, style: Style, sheet: Sheet) -> Damage | None:
        channel = draw.choice([c for c in style.channels if c.target in sheet.places])
        place, row = sheet.places[channel.target], _row(draw, sheet)
        cell = sheet.body[row][place]
        new = change(draw, cell) if cell else None
        if new is None or new == cell:
            return None
        sheet.body[row][place] = new
        column = (channel.name, f"#{place + 1}", channel.target, new.strip() or "fields")
        said = f"{kind}: {cell!r} to {new!r} ({channel.name}, line {sheet.line_of(row)})"
        more = ("fields",) if new.count(sheet.separator) > cell.count(sheet.separator) else ()
        return Damage(said, sheet.bytes(), (_place(sheet, row), (*column, *more)), row)

    return apply


def _letter(draw: random.Random, cell: str) -> str | None:
    digits = [n for n, sign in enumerate(cell) if sign.isdigit()]
    at = draw.choice(digits)
    return cell[:at] + draw.choice("xOl?") + cell[at + 1 :]


def _other_sign(draw: random.Random, cell: str) -> str | None:
    """The last decimal sign exchanged; a time of day keeps its own (ISO 8601 knows both)."""
    found = re.search(r"[.,](?=\d*(?:[eE][+-]?\d+)?\D*$)", cell)
    if found is None or cell.count(":"):
        return None
    return cell[: found.start()] + {".": ",", ",": "."}[found[0]] + cell[found.end() :]


def _group(draw: random.Random, cell: str) -> str | None:
    """A sign between thousands, where the number has none."""
    match = re.fullmatch(r'(.*?)([+-]?\d{4,6})([.,]\d+)?("?(?: \|)?)', cell.strip())
    if match is None or not match[3]:
        return None
    sign = {".": ",", ",": "."}[match[3][0]]
    return f"{match[1]}{match[2][:-3]}{sign}{match[2][-3:]}{match[3]}{match[4]}"


def _whole_row(kind: str) -> Callable[[Callable[[random.Random, Sheet, int], bool]], _Change]:
    def made(change: Callable[[random.Random, Sheet, int], bool]) -> _Change:
        def apply(draw: random.Random, style: Style, sheet: Sheet) -> Damage | None:
            row = _row(draw, sheet)
            before = copy.deepcopy(sheet)
            if ("missing" in kind or "doubled" in kind) and not style.timed:
                return None
            slowest = max(channel.every for channel in style.channels)
            if "missing" in kind and slowest > 1 and row % slowest == 0:
                return None
            if not change(draw, sheet, row):
                return None
            said = f"{kind} (line {before.line_of(row)})"
            return Damage(said, sheet.bytes(), (_place(before, row, 1),), row)

        return apply

    return made


@_whole_row("a row missing")
def _missing(draw: random.Random, sheet: Sheet, row: int) -> bool:
    del sheet.body[row]
    sheet.inserted = {k - (k > row): v for k, v in sheet.inserted.items()}
    return True


@_whole_row("a row doubled")
def _doubled(draw: random.Random, sheet: Sheet, row: int) -> bool:
    sheet.body.insert(row, list(sheet.body[row]))
    sheet.inserted = {k + (k > row): v for k, v in sheet.inserted.items()}
    return True


@_whole_row("a row cut")
def _cut(draw: random.Random, sheet: Sheet, row: int) -> bool:
    """Within a cell before the last: fields are lost, not only digits."""
    filled = [n for n, cell in enumerate(sheet.body[row]) if cell]
    if len(filled) < 2:
        return False
    at = draw.choice(filled[:-1])
    cell = sheet.body[row][at]
    first = len(cell) - len(cell.lstrip()) + 1
    sheet.body[row] = [*sheet.body[row][:at], cell[: draw.randrange(first, len(cell) + 1)]]
    return True


@_whole_row("two rows run together")
def _joined(draw: random.Random, sheet: Sheet, row: int) -> bool:
    first, second = sheet.body[row], sheet.body.pop(row + 1)
    sheet.body[row] = [*first[:-1], first[-1] + second[0], *second[1:]]
    sheet.inserted = {k - (k > row): v for k, v in sheet.inserted.items()}
    return len(first) > 1


@_whole_row("a row shifted by a cell")
def _shifted(draw: random.Random, sheet: Sheet, row: int) -> bool:
    """By an empty cell, or over its first."""
    if not sheet.separator.strip() and sheet.separator != "\t":
        return False
    cells = sheet.body[row]
    sheet.body[row] = ["", *cells[:-1]] if draw.random() < 0.5 else [*cells[1:], ""]
    return sheet.body[row] != cells


def _misspelt(draw: random.Random, style: Style, sheet: Sheet) -> Damage | None:
    if sheet.names_row is None:
        return None
    heads = sheet.heads[sheet.names_row]
    named = [
        c
        for c in style.channels
        if not c.name.startswith("#") and any(c.name in name for name in heads)
    ]
    if not named:
        return None
    channel = draw.choice(named)
    at = next(n for n, name in enumerate(heads) if channel.name in name)
    letters = [n for n, sign in enumerate(heads[at]) if sign.isalnum()]
    spot = draw.choice(letters)
    heads[at] = heads[at][:spot] + draw.choice("qwz") + heads[at][spot + 1 :]
    said = f"heading misspelt: {channel.name!r} to {heads[at]!r}"
    return Damage(said, sheet.bytes(), ((channel.name,),))


def _headless(draw: random.Random, style: Style, sheet: Sheet) -> Damage | None:
    if sheet.names_row is None or all(c.name.startswith("#") for c in style.channels):
        return None
    if sheet.inserted:
        return None
    del sheet.heads[sheet.names_row]
    names = tuple(c.name for c in style.channels if not c.name.startswith("#"))
    return Damage("row of headings missing", sheet.bytes(), ((*names, "heading", "header"),))


_OTHERS = {
    **{"bar": "mbar", "mbar": "bar", "mm": "cm", "ms": "us", "N": "kN", "kPa": "hPa", "s": "ms"},
    **{"m": "mm", "deg": "rad", "rad": "deg"},
}


def _unit(draw: random.Random, style: Style, sheet: Sheet) -> Damage | None:
    """Another unit of the same quantity in the row of units."""
    if sheet.units_row is None:
        return None
    units, choices = sheet.heads[sheet.units_row], []
    for channel in style.channels:
        at = sheet.places[channel.target]
        bare = re.sub(r'["()\s]|Unit:', "", units[at])
        if bare in _OTHERS:
            choices.append((channel, at, bare))
    if not choices:
        return None
    channel, at, bare = draw.choice(choices)
    units[at] = units[at].replace(bare, _OTHERS[bare])
    said = f"unit of {channel.name}: {bare} to {_OTHERS[bare]}"
    return Damage(said, sheet.bytes(), ((channel.name, channel.target), (_OTHERS[bare],)))


_CHANGES: tuple[_Change, ...] = (
    _cell("a letter in a cell", _letter),
    _cell("a cell emptied", lambda draw, cell: ""),
    _cell("decimal sign exchanged", _other_sign),
    _cell("digits grouped", _group),
    _missing,
    _doubled,
    _cut,
    _joined,
    _shifted,
    _misspelt,
    _headless,
    _unit,
)
