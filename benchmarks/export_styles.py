"""Sixty and more export styles of one log, each read by one `sysid convert` line; damaged ones.

    python benchmarks/export_styles.py [--seed 0] [--only TEXT] [--damages 3] [--line] [--keep DIR]

A motion log is drawn from the seed and written as oscilloscopes, controllers, LabVIEW, ROS,
MATLAB, measurement programs and spreadsheets write it (`benchmarks/exports`). The options are
those that a user would write. The log that `sysid convert` makes of each must hold the truth to the
last digit that the style carries: the truth is rounded to the style's unit and decimals, and a
difference of half a unit of the last digit is wrong. Files of several rates are compared
at all rows: commands held, measurements on the line between their own samples.

`--damages N`: each style N times with one damage (a cell, a row, a heading, a unit, a cut file).
Right is exit 2 with a message that names the place, or a notice that does, or a log equal to the
truth, but for a row that is missing or stands twice (`sysid check` sees those). `--line` shows the
commands.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import functools
import importlib.metadata
import io
import math
import random
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import TypeVar

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))

from benchmarks.exports import STYLES, Style  # noqa: E402
from benchmarks.exports.damages import Damage, damaged  # noqa: E402
from benchmarks.exports.record import Channel, Truth, draw_truth  # noqa: E402

# For doubles: units in the last place of the column's largest value.
_PLACES = 4
_Time = TypeVar("_Time", float, Fraction)


@dataclass(frozen=True)
class Reading:
    """What `sysid convert` did: exit status, lines on standard error, the log's columns."""

    code: int
    said: tuple[str, ...]
    columns: dict[str, list[float]]
    tests: list[str]

    @property
    def error(self) -> str:
        return self.said[-1] if self.said else ""


@dataclass(frozen=True)
class Verdict:
    """`kind`: exact (nearest doubles), ok (to the last digit), refused, wrong, fault."""

    kind: str
    text: str = ""


@functools.cache
def _command() -> Callable[[list[str]], int]:
    """`sysid` as it is installed."""
    (entry,) = importlib.metadata.entry_points(group="console_scripts", name="sysid")
    main: Callable[[list[str]], int] = entry.load()
    return main


def read(style: Style, source: Path, output: Path) -> Reading:
    """The style's one line, in this process."""
    output.unlink(missing_ok=True)
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            code = _command()(style.words(str(source), str(output)))
        except BaseException as error:  # whatever it is, it should not come out
            return Reading(1, (f"escaped: {type(error).__name__}: {error}",), {}, [])
    said = tuple(err.getvalue().splitlines())
    if code or not output.exists():
        return Reading(code, said, {}, [])
    with output.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    columns = {name: [row[n] for row in rows[1:]] for n, name in enumerate(rows[0])}
    tests = columns.pop("test", [""] * (len(rows) - 1))
    numbers = {name: [float(cell) for cell in cells] for name, cells in columns.items()}
    return Reading(code, said, numbers, tests)


def judged(style: Style, truth: Truth, reading: Reading, kept: Sequence[int]) -> Verdict:
    """The log against the truth; `kept` are the truth's rows that the file holds, in its order."""
    if reading.code not in (0, 2):
        return Verdict("fault", reading.error)
    if reading.code:
        return Verdict("refused", reading.error)
    if trouble := _frame_trouble(style, reading, kept):
        return Verdict("wrong", trouble)
    exact = True
    for channel in _compared(style):
        got = reading.columns[channel.target]
        whole = channel.expected(truth)
        expected = [whole[row] for row in kept]
        if channel.target == "time_s":
            got, expected = _from_starts(style, got, kept), _from_starts(style, expected, kept)
        off = _first_off(channel, reading.columns[channel.target], got, expected)
        if off is not None:
            row, value, right = off
            return Verdict(
                "wrong", f"{channel.target}, row {row + 1}: {value!r}, right {float(right)!r}"
            )
        exact = exact and all(map(_is_nearest, got, expected))
    return Verdict("exact" if exact else "ok")


def _compared(style: Style) -> list[Channel]:
    """The style's columns; where it has no time, the truth's."""
    own = list(style.channels)
    if not any(c.target == "time_s" for c in own):
        own.append(Channel("time_s", "", decimals=9))
    return own


def _frame_trouble(style: Style, reading: Reading, kept: Sequence[int]) -> str:
    """Missing columns, another number of rows, tests that begin elsewhere; empty: none."""
    wanted = {channel.target for channel in _compared(style)}
    if missing := wanted - set(reading.columns):
        return f"without {', '.join(sorted(missing))}"
    if len(reading.tests) != len(kept):
        return f"{len(reading.tests)} rows, right {len(kept)}"
    starts = [n for n, t in enumerate(reading.tests) if not n or t != reading.tests[n - 1]]
    right = [next(n for n, row in enumerate(kept) if row >= start) for start in style.starts]
    return "" if starts == right else f"tests begin at rows {starts}, right {right}"


def _from_starts(style: Style, values: Sequence[_Time], kept: Sequence[int]) -> list[_Time]:
    """Times from their own test's first row."""
    found, first = [], values[0]
    for row, value, before in zip(kept, values, (-1, *kept), strict=False):
        if any(before < start <= row for start in style.starts):
            first = value
        found.append(value - first)
    return found


def _first_off(
    channel: Channel, raw: Sequence[float], got: Sequence[float], expected: Sequence[Fraction]
) -> tuple[int, float, Fraction] | None:
    """The first row that differs by half a digit (doubles: by some units in the last place)."""
    largest = max(map(abs, raw))
    allowed = max(channel.digit / 2, _PLACES * Fraction(math.ulp(largest)))
    for row, (value, right) in enumerate(zip(got, expected, strict=True)):
        if not math.isfinite(value) or abs(Fraction(value) - right) >= allowed:
            return row, value, right
    return None


def _is_nearest(value: float, right: Fraction) -> bool:
    return value == float(right)


def judged_damage(
    style: Style, truth: Truth, damage: Damage, reading: Reading, usual: Sequence[str]
) -> Verdict:
    """`usual` are the lines that the undamaged file gave.

    Kinds: named, unnamed (exit 2 without the place), said (a notice), same (as the truth),
    left to check, silent, fault.
    """
    if reading.code not in (0, 2):
        return Verdict("fault", reading.error)
    if reading.code == 2:
        return Verdict("named" if _names(damage, reading.error) else "unnamed", reading.error)
    rows = range(truth.rows)
    unit = damage.kind.startswith("unit")
    if not unit and judged(style, truth, reading, rows).kind in ("exact", "ok"):
        return Verdict("same")
    new = [line for line in reading.said if line not in usual]
    if any(_names(damage, line) for line in new) and (damage.names or new):
        return Verdict("said", new[-1])
    if damage.row is not None and ("missing" in damage.kind or "doubled" in damage.kind):
        kept = [r for r in rows if "doubled" in damage.kind or r != damage.row]
        kept += [damage.row] if "doubled" in damage.kind else []
        if judged(style, truth, reading, sorted(kept)).kind in ("exact", "ok"):
            return Verdict("left to check")
    if not damage.names and new and _is_beginning(style, truth, reading):
        return Verdict("said", new[-1])
    return Verdict("silent", judged(style, truth, reading, rows).text or "the unit")


def _names(damage: Damage, line: str) -> bool:
    """Whether a line has a word of each group; a number is not a longer one's beginning."""

    def holds(word: str) -> bool:
        at = line.find(word)
        while at >= 0:
            end = line[at + len(word) : at + len(word) + 1]
            if not (word[-1:].isdigit() and end.isdigit()):
                return True
            at = line.find(word, at + 1)
        return False

    return all(any(map(holds, group)) for group in damage.names)


def _is_beginning(style: Style, truth: Truth, reading: Reading) -> bool:
    """Whether a log is the truth as far as it goes."""
    kept = range(len(reading.tests))
    single = replace(style, starts=tuple(s for s in style.starts if s < len(kept)))
    return bool(kept) and judged(single, truth, reading, kept).kind in ("exact", "ok")


def try_style(style: Style, truth: Truth, folder: Path) -> tuple[Verdict, Reading]:
    """Written, read by its line, compared."""
    folder.mkdir(parents=True, exist_ok=True)
    style.export(folder / style.file, truth)
    reading = read(style, folder / style.file, folder / "log.csv")
    return judged(style, truth, reading, range(truth.rows)), reading


def try_damage(
    style: Style, truth: Truth, folder: Path, draw: random.Random, usual: Sequence[str]
) -> tuple[Damage, Verdict]:
    """The style's file once more, with one damage."""
    path = folder / style.file
    sheet = style.export(path, truth)
    damage = damaged(draw, style, sheet, path.read_bytes())
    path.write_bytes(damage.data)
    reading = read(style, path, folder / "damaged.csv")
    return damage, judged_damage(style, truth, damage, reading, usual)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="styles whose name holds this text")
    parser.add_argument("--damages", type=int, default=0, metavar="N", help="damages a style")
    parser.add_argument("--line", action="store_true", help="show each command")
    parser.add_argument("--keep", type=Path, help="folder for the files")
    arguments = parser.parse_args()
    chosen = [s for s in STYLES if arguments.only.lower() in s.name.lower()]
    truth = draw_truth(arguments.seed)
    counts: Counter[str] = Counter()
    with tempfile.TemporaryDirectory(prefix="styles-") as scratch:
        root = arguments.keep or Path(scratch)
        for number, style in enumerate(chosen):
            folder = root / f"{number:02d}"
            verdict, reading = try_style(style, truth, folder)
            counts[verdict.kind] += 1
            print(f"{style.name:44} {verdict.kind:8} {verdict.text[:220]}", flush=True)
            if arguments.line:
                print(f"    sysid {' '.join(map(repr, style.words(style.file, 'log.csv')))}")
            if verdict.kind not in ("exact", "ok"):
                continue
            for damage_number in range(arguments.damages):
                draw = random.Random(f"{arguments.seed} {style.name} {damage_number}")
                damage, found = try_damage(style, truth, folder, draw, reading.said)
                counts[f"damaged: {found.kind}"] += 1
                if found.kind in ("unnamed", "silent", "fault") or arguments.line:
                    print(f"    {damage.kind}: {found.kind}: {found.text[:260]}", flush=True)
    right = counts["exact"] + counts["ok"]
    print(f"{right} of {len(chosen)} the same log, {counts['exact']} to the nearest doubles")
    for kind, count in sorted(counts.items()):
        print(f"{kind}: {count}")


if __name__ == "__main__":
    main()
