"""A sensor's range as its data sheet states it: `0.5..4.5 V -> 0..100 psi(g)`.

On the left the readings at both ends, as the file holds them; on the right what they mean. Ends
are separated by `..`, `...`, `to`, a dash or a hyphen; decimals, exponents and signs as usual, a
decimal comma too. The readings' unit may be omitted.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from sysid import signals
from sysid.errors import InputError, input_error
from sysid.io.unit_text import LARGEST, Conversion, is_ratio, parse_unit, ratio_of
from sysid.types import FloatArray

_ARROW = re.compile(r"\s*(?:[-=]+>|→|⇒|➔)\s*")
_NUMBER = r"[+-]?(?:\d+(?:[.,]\d+)?|[.,]\d+)(?:[eE][+-]?\d+)?"
_UNIT = r"[^\s\d.,+-][^\s]*?"
_BETWEEN = r"\s*(?:\.{2,3}|…|–|—|~|to|bis)\s*|-|\s+-\s+"
_SIDE = re.compile(
    rf"\s*(?P<low>{_NUMBER})(?:\s*(?P<first>{_UNIT}))??(?:{_BETWEEN})(?P<high>{_NUMBER})"
    r"(?:\s*(?P<unit>(?:1\s*/)?[^\s\d.,+-].*))?\s*"
)
_DOTS = re.compile(rf"{_NUMBER}\s*(?:\.\.|…)|(?:\.\.|…)\s*{_NUMBER}")
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+(?![\d,.])")
# What the readings of a converter are called; pint knows no such unit.
_RAW = re.compile(r"counts?|digits?|lsb|raw|steps?|inc(?:rements?)?|adc|codes?|bits?|units?", re.I)
_EXAMPLE = "0.5..4.5 V -> 0..100 psi(g)"
# NAMUR NE 43: 4 to 20 mA are a measurement, below 3.6 and above 21 mA are a fault.
_FAULT_BELOW = 0.4 / 16.0
_FAULT_ABOVE = 1.0 / 16.0
_NOISE = 5.0


@dataclass(frozen=True)
class SensorRange:
    """The readings (in the file's unit) at the two ends of a sensor's range.

    `unit` is the readings' unit where it is written, for comparison with the file's own.
    """

    start: float
    end: float
    unit: str = ""

    def beyond(self, readings: FloatArray) -> tuple[int, str] | None:
        """The first of readings (n,) outside the range, and what a notice says of them all.

        Outside by more than a transmitter's reserve and than their noise; None if all are inside.
        """
        low, high = sorted((self.start, self.end))
        finite = readings[np.isfinite(readings)]
        noise = (
            signals.noise_floor(finite).total
            if len(finite) >= signals.FEWEST_FOR_NOISE and np.ptp(finite) > 0.0
            else 0.0
        )
        noise = min(_NOISE * noise, high - low) if math.isfinite(noise) else 0.0
        least = low - max(_FAULT_BELOW * (high - low), noise)
        most = high + max(_FAULT_ABOVE * (high - low), noise)
        outside = np.flatnonzero((readings < least) | (readings > most))
        if not outside.size:
            return None
        first = float(readings[outside[0]])
        share = 100.0 * outside.size / len(readings)
        unit = f" {self.unit}" if self.unit else ""
        why = "is the range right?"
        if low > 0.0 and np.all(np.abs(readings[outside]) < 0.5 * low):
            why = "a broken wire, or is the range wrong?"
        return int(outside[0]), (
            f"{first:.4g} is the first of {outside.size} readings of {len(readings)} ({share:.3g} "
            f"%) outside the sensor's range of {self.start:g} to {self.end:g}{unit}: {why}"
        )


def is_range(text: str) -> bool:
    """Whether a unit's text is, or begins as, a sensor's range."""
    return _ARROW.search(text) is not None or _DOTS.search(text) is not None


def parse_range(text: str, si: str, where: str) -> tuple[SensorRange, Conversion]:
    """A range as written, and what turns a reading into the SI unit `si`.

    Raises InputError, that opens with `where`, for a range that is incomplete or has no width, and
    for units that are unknown or of another quantity.
    """
    sides = _ARROW.split(text.replace("\u2212", "-").replace("\u00a0", " ").strip())
    if len(sides) != 2 or not all(sides):
        what = "has two arrows" if len(sides) > 2 else "lacks one of its two sides"
        raise _unlike(text, what, where)
    (readings, unit), (values, target) = (_side(side, text, where) for side in sides)
    if unit and target and _swapped(unit, target, si):
        raise input_error(
            where,
            f"the range {text!r} is reversed: readings go on its left",
            f"write {sides[1].strip()} -> {sides[0].strip()}",
        )
    return sensor_range(readings, unit, values, target, si, where)


def sensor_range(
    readings: tuple[Fraction, Fraction],
    unit: str,
    values: tuple[Fraction, Fraction],
    target: str,
    si: str,
    where: str,
) -> tuple[SensorRange, Conversion]:
    """The same from numbers: `readings` in `unit` ("": not said) mean `values` in `target`."""
    for what, ends in (("readings", readings), ("values", values)):
        if ends[0] == ends[1]:
            raise input_error(
                where,
                f"the range's {what} begin and end at {float(ends[0]):g}: it has no width",
                f"give both ends, as in {_EXAMPLE}",
            )
    if unit and not _RAW.fullmatch(unit) and ratio_of(unit, unit) is None:
        raise input_error(
            where,
            f"{unit!r}, of the readings, is not a known unit",
            "correct or omit it, or write counts",
        )
    if not target and not is_ratio(si):
        raise input_error(
            where,
            f"the range's values {float(values[0]):g} to {float(values[1]):g} have no unit",
            f"write it behind them, as in {_EXAMPLE}",
        )
    plain = parse_unit(target, si, where) if target else Conversion(None, 1.0, 0.0)
    size = Fraction(repr(plain.factor))
    slope = (values[1] - values[0]) / (readings[1] - readings[0])
    offset = (values[0] - slope * readings[0]) * size + Fraction(repr(plain.offset))
    found = Conversion(
        plain.gauge, float(slope * size), float(offset), plain.remark, plain.standard
    )
    return SensorRange(float(readings[0]), float(readings[1]), unit), found


def range_text(ends: tuple[Fraction, Fraction]) -> str:
    """Two ends as they are typed."""
    return "..".join(repr(float(end)).removesuffix(".0") for end in ends)


def ends_of(value: Any, key: str, where: str) -> tuple[Fraction, Fraction]:
    """The two numbers of a TOML key. Raises InputError for anything else."""
    numbers = value if isinstance(value, list | tuple) else ()
    fine = all(isinstance(n, int | float) and not isinstance(n, bool) for n in numbers)
    if len(numbers) != 2 or not fine:
        example = "[0.5, 4.5]" if key == "from" else "[0, 100]"
        raise input_error(
            where, f"{key} = {value!r} is not two numbers", f"write {key} = {example}"
        )
    low, high = (_exact(n, where) for n in numbers)
    return low, high


def _side(side: str, text: str, where: str) -> tuple[tuple[Fraction, Fraction], str]:
    """Both numbers of one side, and its unit."""
    grouped = _GROUPED.search(side)
    if grouped is not None:
        raise input_error(
            where,
            f"{grouped.group()} in the range {text!r} may be grouped or a decimal",
            f"write {grouped.group().replace(',', '')} or {grouped.group().replace(',', '.', 1)}",
        )
    match = _SIDE.fullmatch(side)
    if match is None:
        raise _unlike(text, f"has no two numbers in {side.strip()!r}", where)
    first, unit = match["first"] or "", (match["unit"] or "").strip()
    if first and unit and first != unit:
        raise _unlike(text, f"has two units, {first} and {unit}, on one side", where)
    low, high = (_exact(match[name].replace(",", "."), where) for name in ("low", "high"))
    return (low, high), unit or first


def _exact(number: str | float, where: str) -> Fraction:
    """A number as its digits say. Raises InputError for one that no sensor has."""
    try:
        value = float(number)
    except OverflowError:  # TOML's integers are unlimited here
        value = math.inf
    if value != 0.0 and not 1.0 / LARGEST <= abs(value) <= LARGEST:
        raise input_error(where, f"{str(number)[:40]} is not the end of a range", "give another")
    return Fraction(repr(value))


def _swapped(unit: str, target: str, si: str) -> bool:
    """Whether the readings' unit is the quantity's, and the values' unit is not."""

    def fits(one: str) -> bool:
        try:
            parse_unit(one, si, "")
        except InputError:
            return False
        return True

    return fits(unit) and not fits(target)


def _unlike(text: str, what: str, where: str) -> InputError:
    return input_error(where, f"the range {text!r} {what}", f"write it as {_EXAMPLE}")


__all__ = ["SensorRange", "ends_of", "is_range", "parse_range", "range_text", "sensor_range"]
