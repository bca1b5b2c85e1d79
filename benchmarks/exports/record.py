"""One motion log as the truth, the columns in which a style writes it, and the styles' registry.

All values of the truth are exact decimals in SI. A style's column has a unit, a zero and a number
of decimals; what it writes and what a reader must find are both exact, so that a comparison knows
no tolerance but that of a double.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from decimal import ROUND_HALF_EVEN, Context, Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

ATMOSPHERE = Fraction(101325)
_PI = Fraction("3.14159265358979323846264338327950288")
_PSI = Fraction("4.4482216152605") / Fraction("0.00064516")
# SI value of one unit.
UNITS: dict[str, Fraction] = {
    **{"": Fraction(1), "s": Fraction(1), "ms": Fraction(1, 10**3), "us": Fraction(1, 10**6)},
    **{"ns": Fraction(1, 10**9), "Pa": Fraction(1), "kPa": Fraction(10**3), "psi": _PSI},
    **{"MPa": Fraction(10**6), "mbar": Fraction(100), "bar": Fraction(10**5), "hPa": Fraction(100)},
    **{
        "m": Fraction(1),
        "mm": Fraction(1, 10**3),
        "cm": Fraction(1, 100),
        "um": Fraction(1, 10**6),
    },
    **{"N": Fraction(1), "kN": Fraction(10**3), "percent": Fraction(1, 100), "rad": Fraction(1)},
    **{"deg": _PI / 180, "Nm": Fraction(1), "day": Fraction(86400)},
}
_WIDE = Context(prec=60, rounding=ROUND_HALF_EVEN)
# A command's update, rows: one PWM period.
COMMAND_ROWS = 5
# Where files of several tests begin their second.
SECOND_START = 120


@dataclass(frozen=True)
class Truth:
    """The log: columns of exact SI values by their names in the log format, all of one length."""

    columns: dict[str, list[Fraction]]

    @property
    def rows(self) -> int:
        return len(self.columns["time_s"])


def draw_truth(seed: int, rows: int = 241) -> Truth:
    """A cylinder's motion under PWM and a motor, 1 kHz, values with twelve digits.

    `rows` is a multiple of `COMMAND_ROWS` and one, so that slower columns end with the log.
    """
    draw = np.random.default_rng(seed)
    time = np.arange(rows) / 1000.0

    def swing(middle: float, half: float, noise: float) -> list[Fraction]:
        turns, phase = draw.uniform(5.0, 25.0, 3), draw.uniform(0.0, 6.0, 3)
        waves = np.sin(turns * time[:, None] + phase) @ np.array([0.6, 0.3, 0.1])
        values = middle + half * waves + noise * draw.standard_normal(rows)
        return [Fraction(f"{value:.11e}") for value in values]

    duty = swing(0.5, 0.4, 0.0)
    duty = [duty[row - row % COMMAND_ROWS] for row in range(rows)]
    valve = [Fraction(int(value > Fraction(1, 2))) for value in duty]
    return Truth(
        {
            "time_s": [Fraction(row, 1000) for row in range(rows)],
            "pressure_a_pa": swing(3.5e5, 1.5e5, 300.0),
            "pressure_b_pa": swing(3.0e5, 1.2e5, 300.0),
            "position_m": swing(0.01, 0.05, 1e-6),
            "theta_rad": swing(0.2, 1.1, 1e-5),
            "duty_a": duty,
            "valve_a": valve,
            "motor_force_n": swing(4.0, 70.0, 0.05),
            "motor_torque_nm": swing(0.02, 0.7, 0.001),
        }
    )


@dataclass(frozen=True)
class Channel:
    """A column of a style: SI value = `step` * reading + `zero`.

    `decimals` is the number of decimals written; None: doubles, as they are. `every` rows have a
    sample. `unit` is what the map's entry says. `turn`: the reading counts modulo so many units.
    """

    target: str
    name: str
    unit: str = ""
    decimals: int | None = 6
    step: Fraction = Fraction(1)
    zero: Fraction = Fraction(0)
    every: int = 1
    turn: int | None = None
    mapped: bool = True

    @property
    def digit(self) -> Fraction:
        """The last digit's worth in SI; 0 for doubles."""
        return Fraction(0) if self.decimals is None else self.step / 10**self.decimals

    def written(self, truth: Truth) -> list[Decimal]:
        """The readings (rows / every,) as the style writes them."""
        own = truth.columns[self.target][:: self.every]
        return [self._reading((value - self.zero) / self.step) for value in own]

    def _reading(self, value: Fraction) -> Decimal:
        if self.decimals is None:
            return Decimal(float(value))
        scaled = round(value * 10**self.decimals)
        if self.turn is not None:
            scaled %= self.turn
        return Decimal(scaled).scaleb(-self.decimals, _WIDE)

    def expected(self, truth: Truth) -> list[Fraction]:
        """What a reader must find, exact: held for commands, else linear between own samples."""
        own = replace(self, turn=None)
        values = [self.step * Fraction(d) + self.zero for d in own.written(truth)]
        if self.every == 1:
            return values
        holds = self.target.startswith(("duty", "valve", "motor"))
        found = []
        for row in range(truth.rows):
            before, after = divmod(row, self.every)
            start = values[before]
            end = start if holds or not after else values[before + 1]
            found.append(start + (end - start) * Fraction(after, self.every))
        return found

    def entry(self) -> str:
        """The entry of `--map`."""
        colon = ":" if ":" in self.name and not self.unit else ""
        return f"{self.target}={self.name}{colon}" + (f":{self.unit}" if self.unit else "")


def column(
    target: str,
    name: str,
    unit: str = "",
    decimals: int | None = 6,
    *,
    worth: str | None = None,
    zero: Fraction | int | str = 0,
    every: int = 1,
    turn: int | None = None,
    mapped: bool = True,
) -> Channel:
    """A column in one of `UNITS` or a multiple ("20 kPa"), "(g)" for gauge.

    `worth` is the unit where `unit` is not said.
    """
    said = unit if worth is None else worth
    gauge = said.endswith("(g)")
    multiple, _, bare = said.removesuffix("(g)").rpartition(" ")
    step = UNITS[bare] * Fraction(multiple or 1)
    start = Fraction(zero) + (ATMOSPHERE if gauge else 0)
    return Channel(target, name, unit, decimals, step, start, every, turn, mapped)


def sensor(
    target: str,
    name: str,
    reading: tuple[str, str],
    quantity: tuple[str, str],
    unit: str,
    decimals: int = 5,
    **more: Any,
) -> Channel:
    """A transducer's column: `reading` from and to, which stand for `quantity` in `unit`."""
    plain = column(target, name, unit, decimals, **more)
    (low, high), (first, last) = map(Fraction, reading), map(Fraction, quantity)
    step = plain.step * (last - first) / (high - low)
    zero = plain.zero + plain.step * first - step * low
    said = f"{reading[0]}..{reading[1]} -> {quantity[0]}..{quantity[1]} {unit}"
    return replace(plain, unit=said, step=step, zero=zero)


@dataclass
class Sheet:
    """A text file before it is joined: lines above, rows of headings, rows of cells, lines below.

    `places` gives the column's index of each channel by target; `names_row` and `units_row` are
    indices in `heads`. `inserted` are lines above a body row.
    """

    heads: list[list[str]]
    body: list[list[str]]
    separator: str = ","
    above: list[str] = field(default_factory=list)
    below: list[str] = field(default_factory=list)
    ending: str = "\n"
    encoding: str = "utf-8"
    places: dict[str, int] = field(default_factory=dict)
    names_row: int | None = 0
    units_row: int | None = None
    gap_after_heads: list[str] = field(default_factory=list)
    inserted: dict[int, list[str]] = field(default_factory=dict)

    def lines(self) -> list[str]:
        """All lines; `inserted` stand above their body rows."""
        found = [*self.above, *(self.separator.join(row) for row in self.heads)]
        found += self.gap_after_heads
        for number, row in enumerate(self.body):
            found += self.inserted.get(number, [])
            found.append(self.separator.join(row))
        return found + self.below

    def line_of(self, row: int) -> int:
        """The file's line number, from 1, of a body row."""
        above = len(self.above) + len(self.heads) + len(self.gap_after_heads)
        return above + row + 1 + sum(len(v) for k, v in self.inserted.items() if k <= row)

    def bytes(self) -> bytes:
        return (self.ending.join(self.lines()) + self.ending).encode(self.encoding)


@dataclass(frozen=True)
class Record:
    """What a writer gets: the truth, the style's columns, and their readings."""

    truth: Truth
    channels: tuple[Channel, ...]

    def readings(self, target: str) -> list[Decimal]:
        return self._channel(target).written(self.truth)

    def doubles(self, target: str) -> np.ndarray[Any, np.dtype[np.float64]]:
        """The readings as nearest doubles (n,)."""
        return np.array([float(d) for d in self.readings(target)])

    def cells(self, target: str, form: str = "f", decimal: str = ".") -> list[str]:
        """The readings as text: fixed ("f") or with an exponent (".8E")."""
        decimals = self._channel(target).decimals or 0
        form = f".{decimals}f" if form == "f" else form
        return [f"{value:{form}}".replace(".", decimal) for value in self.readings(target)]

    def rows(self, form: str = "f", decimal: str = ".") -> list[list[str]]:
        """A row of cells for each sample, in the order of the columns; slower ones are empty."""
        found = []
        for channel in self.channels:
            cells = iter(self.cells(channel.target, form, decimal))
            every = channel.every
            found.append(["" if r % every else next(cells) for r in range(self.truth.rows)])
        return [list(row) for row in zip(*found, strict=True)]

    def names(self) -> list[str]:
        return [channel.name for channel in self.channels]

    def places(self, first: int = 0) -> dict[str, int]:
        return {channel.target: first + n for n, channel in enumerate(self.channels)}

    def _channel(self, target: str) -> Channel:
        return next(channel for channel in self.channels if channel.target == target)


Writer = Callable[[Path, Record], "Sheet | None"]


@dataclass(frozen=True)
class Style:
    """A program's export: how it is written, and the options of the one line that reads it.

    `starts` are the rows at which another test begins, its time from there; `timed` is False where
    no mapped column holds the time.
    """

    name: str
    file: str
    channels: tuple[Channel, ...]
    write: Writer
    options: tuple[str, ...] = ()
    starts: tuple[int, ...] = (0,)
    timed: bool = True

    def words(self, source: str, output: str) -> list[str]:
        """The command's words after `sysid`."""
        maps = [w for c in self.channels if c.mapped for w in ("--map", c.entry())]
        gauge = any("(g)" in c.unit for c in self.channels)
        more = ["--atmosphere", "101325"] if gauge else []
        return ["convert", source, "-o", output, *maps, *more, *self.options]

    def export(self, path: Path, truth: Truth) -> Sheet | None:
        """Write the file; its sheet where it is text."""
        sheet = self.write(path, Record(truth, self.channels))
        if sheet is not None:
            path.write_bytes(sheet.bytes())
        return sheet


STYLES: list[Style] = []


def style(
    name: str,
    file: str,
    channels: Sequence[Channel],
    *options: str,
    starts: tuple[int, ...] = (0,),
    timed: bool = True,
) -> Callable[[Writer], Writer]:
    """Enter a writer in `STYLES`."""

    def entered(write: Writer) -> Writer:
        STYLES.append(Style(name, file, tuple(channels), write, options, starts, timed))
        return write

    return entered


def table(record: Record, form: str = "f", decimal: str = ".", **more: Any) -> Sheet:
    """A sheet of names and rows, in the order of the columns."""
    return Sheet([record.names()], record.rows(form, decimal), places=record.places(), **more)
