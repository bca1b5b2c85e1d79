"""Readable numbers: as many digits as their error supports, and readable units."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from typing import Any

from sysid.estimation.linear import Estimate, finite_or_none

MINUS = "\N{MINUS SIGN}"
MISSING = "\N{EM DASH}"
_SUPERSCRIPT = str.maketrans("-0123456789", "\N{SUPERSCRIPT MINUS}⁰¹²³⁴⁵⁶⁷⁸⁹")
_UNIT_SIGNS = {"Nm": "N·m", "**": "^", "*": "·", "^0.5": "⁰·⁵", "^1": ""}
_NO_UNIT = ("-", "1", "dimensionless")
# Divided by several units, one after another.
_DIVIDED = re.compile(r"(?:/[A-Za-z]+(?:\*\*\d|\^?\d)?){2,}$")
_OHM = re.compile(r"\bohm\b")
_TIMES = re.compile(r" (?=(?:s|m|Pa|K|rad|kg)[23]?\b)")
_POWER = re.compile(r"(?<=[A-Za-z])\^?([23])\b")
# Times and mass flows below this are shown in a thousandth of their unit, as in the figures.
_THOUSANDTHS_BELOW = 0.1
_THOUSANDTHS = {"s": "ms", "kg/s": "g/s"}
# Powers of ten that are written out.
_PLAIN = range(-3, 6)
# Powers of ten from which a terminal writes them; the most digits that make ends differ.
_LEAST_POWER, _MOST_DIGITS = 6, 9
# Values in SI from here on are written without decimals.
_WHOLE = 1e4


def known(content: Any) -> Any:
    """Content for a file of JSON, with None for each number in it that is not finite."""
    if isinstance(content, Mapping):
        return {key: known(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [known(value) for value in content]
    return finite_or_none(content) if isinstance(content, float) else content


def unit(text: str) -> str:
    """A bundle's or a user's unit as it is printed: `Nm s/rad` or `N*m*s/rad` as `N·m·s/rad`."""
    if text in _NO_UNIT:
        return ""
    text = _DIVIDED.sub(lambda m: f"/({m[0][1:].replace('/', '*')})", text)
    text = _TIMES.sub("·", text)
    for plain, sign in _UNIT_SIGNS.items():
        text = text.replace(plain, sign)
    text = _POWER.sub(lambda m: m[1].translate(_SUPERSCRIPT), text)
    return _OHM.sub("Ω", text)


def number(value: float | None, digits: int = 3) -> str:
    """A value with this number of significant digits; an em dash for None and NaN."""
    if value is None or math.isnan(value):
        return MISSING
    if math.isinf(value):
        return "∞" if value > 0 else f"{MINUS}∞"
    if value == 0.0:
        return "0"
    exponent = _exponent(value, digits)
    if exponent in _PLAIN:
        return fixed(value, max(digits - 1 - exponent, 0))
    return f"{fixed(value / 10.0**exponent, digits - 1)}{_power(exponent)}"


def span(low: float | None, high: float | None, digits: int = 3) -> str:
    """A range, its ends with these digits; a power of ten that both have stands behind brackets.

    What is small against the other end is written without a power, which would seem to be of both.
    """
    ends = number(low, digits), number(high, digits)
    if low is None or high is None or not math.isfinite(low - high) or "×" not in "".join(ends):
        return " to ".join(ends)
    exponent = _exponent(max(abs(low), abs(high)), digits)
    scale = 1.0 if exponent in _PLAIN else 10.0**exponent
    decimals = max(digits - 1 - exponent, 0) if scale == 1.0 else digits - 1
    least = 0.5 * 10.0**-decimals

    def end(value: float) -> str:
        if value == 0.0:
            return "0"
        # One digit of what these decimals do not show.
        is_lost = 0.0 < abs(value / scale) < least
        more = -_exponent(value / scale, 1) if is_lost else decimals
        return fixed(value / scale, more)

    inner = f"{end(low)} to {end(high)}"
    return inner if scale == 1.0 else f"({inner}){_power(exponent)}"


def _exponent(value: float, digits: int) -> int:
    return int(f"{abs(value):.{digits - 1}e}".partition("e")[2])


def fixed(value: float, decimals: int) -> str:
    """A value with this number of decimals and a true minus sign."""
    text = f"{value:.{decimals}f}"
    return text.replace("-", MINUS)


def _power(exponent: int) -> str:
    return f" × 10{str(exponent).translate(_SUPERSCRIPT)}"


def percent(value: float | None, digits: int = 3) -> str:
    """A value in percent, with the percent sign."""
    return MISSING if value is None else f"{number(value, digits)} %"


def estimate_cells(estimate: Estimate) -> tuple[str, str, str, str]:
    """Value, standard error, 95 % interval and unit of a bundle's parameter.

    All are written with the value's power of ten, to the second digit of the error.
    """
    if estimate.reason is not None:
        return "not identified", MISSING, estimate.reason, ""
    value, name = estimate.value, unit(estimate.unit)
    std, low, high = (x if math.isfinite(x) else None for x in (estimate.std, *estimate.interval))
    if name in _THOUSANDTHS and abs(value) < _THOUSANDTHS_BELOW:
        name = _THOUSANDTHS[name]
        value = 1e3 * value
        std, low, high = (None if x is None else 1e3 * x for x in (std, low, high))
    places = _decimals(value, std)
    exponent = _exponent(max(abs(value), std or 0.0) or 1.0, 4)
    is_plain = exponent in _PLAIN
    power = "" if is_plain else _power(exponent)
    scale = 1.0 if is_plain else 10.0**exponent
    decimals = places if is_plain else max(places + exponent, 0)

    def shown(x: float | None, missing: str) -> str:
        return missing if x is None else fixed(x / scale, decimals)

    interval = MISSING
    if low is not None or high is not None:
        interval = f"{shown(low, MINUS + '∞')} to {shown(high, '∞')}"
        interval = f"({interval}){power}" if power else interval
    return (
        shown(value, MISSING) + power,
        shown(std, MISSING) + (power if std is not None else ""),
        interval,
        name,
    )


def _decimals(value: float, std: float | None) -> int:
    """Decimal places (of the plain number) that show two digits of the error, at most six
    significant ones of the value."""
    size = _exponent(max(abs(value), std or 0.0) or 1.0, 4)
    if std is None or std <= 0.0:
        return max(3 - size, 0)
    return max(min(1 - _exponent(std, 2), 5 - size), 0)


def si_cells(estimate: Estimate) -> tuple[str, str, str]:
    """Value, 95 % interval and unit of a parameter as bundles have them, in ASCII."""
    if estimate.reason is not None:
        return "not identified", estimate.reason, ""
    low, high = estimate.interval
    if not (math.isfinite(low) and math.isfinite(high)):
        has_one_end = math.isfinite(low) != math.isfinite(high) and not math.isnan(low - high)
        interval = f"{low:.4g} to {high:.4g}" if has_one_end else ""
        return f"{estimate.value:.4g}", interval, estimate.unit
    write = _form(estimate)
    return write(estimate.value), f"{write(low)} to {write(high)}", estimate.unit


def _form(estimate: Estimate) -> Callable[[float], str]:
    """How a value and its interval's ends are written alike: to the second digit of the error, at
    least to the digit in which the ends differ."""
    low, high = estimate.interval
    value, std = estimate.value, estimate.std
    size = max(abs(value), std if math.isfinite(std) else 0.0) or 1.0
    exponent = _exponent(size, 4)
    places = _decimals(value, std if math.isfinite(std) else None)
    is_plain = exponent in range(_PLAIN.start, _LEAST_POWER)
    while True:
        decimals = max(places if is_plain else places + exponent, 0)
        scale, power = (1.0, "") if is_plain else (10.0**exponent, f"e{exponent:+03d}")
        ends = [f"{end / scale:.{decimals}f}{power}" for end in (low, high)]
        if ends[0] != ends[1] or low == high or decimals >= _MOST_DIGITS:
            return lambda number: f"{number / scale:.{decimals}f}{power}"
        places += 1


def si_number(value: float, digits: int = 4) -> str:
    """A value in SI in ASCII; a large one, such as a pressure, as a whole number."""
    return f"{value:.0f}" if abs(value) >= _WHOLE else f"{value:.{digits}g}"


_ASCII = str.maketrans(
    {
        MINUS: "-",
        "\N{EN DASH}": "-",
        MISSING: "-",
        "∞": "inf",
        "·": " ",
        "²": "2",
        "³": "3",
        "±": "+/-",
    }
)
_DIGITS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")


def ascii_text(text: str) -> str:
    """Text of this module as terminals and files have it: `6.5e-4`, `kg/(s Pa)`."""

    def power(found: re.Match[str]) -> str:
        exponent = f"e{found[2].translate(_DIGITS)}"
        return f"{found[1]}{exponent}" if found[1].isdigit() else f"{found[1]} x 1{exponent}"

    text = re.sub("(.) × 10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)", power, text)
    return text.replace("⁰·⁵", "^0.5").translate(_ASCII)


def duration(seconds: float) -> str:
    """A time: in ms below a tenth of a second, else in s."""
    if abs(seconds) < _THOUSANDTHS_BELOW:
        return f"{number(1e3 * seconds)} ms"
    return f"{number(seconds)} s"
