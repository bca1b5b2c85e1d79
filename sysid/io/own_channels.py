"""Columns, and units, that a user's own component declares, as they are shown.

`own` is in every function what it declares: the unit of each column, by name; empty of others.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache

from sysid.blocks.numbers import unit
from sysid.blocks.titles import capital, words_of
from sysid.io.channels import CHANNELS, Channel, channel_of

Own = Mapping[str, str]

RATE_OF = "rate of "
"""Precedes the name of a column whose rate is a regressor."""
_JOINED = " and "
_OF_SPREAD = "of the spread"


def channel_in(key: str, own: Own) -> Channel:
    """A channel as it is shown: the user's own in words, in the units that the log format's have.

    A residual of several outputs, "a and b", is in shares of their spreads.
    """
    names = key.split(_JOINED)
    if not own or any(name not in own for name in names):
        return channel_of(key)
    title = capital(_JOINED.join(words_of(name, own[name]) for name in names))
    if len(names) > 1:
        return Channel(key, None, "", title, _OF_SPREAD, 1.0, _OF_SPREAD, 1.0)
    shown, residual = shown_unit(own[key]), residual_unit(own[key])
    # No such channel of ours, whatever its unit.
    si = None if shown[0] else "dimensionless"
    return Channel(key, si, "", title, *shown, *residual)


def in_words(text: str, own: Own) -> str:
    """A text with the user's own names in words: "rate of angle_rad" is the rate of angle."""
    if not own:
        return text
    names = "|".join(map(re.escape, sorted(own, key=len, reverse=True)))
    return re.sub(rf"\b(?:{names})\b", lambda m: words_of(m[0], own[m[0]]), text)


def shown_unit(name: str) -> tuple[str, float]:
    """The unit in which signals in the unit `name` are shown, and the scale to it."""
    return _units().get(unit(name), ((unit(name), 1.0),))[0]


def residual_unit(name: str) -> tuple[str, float]:
    """The same of their residuals, errors and noise."""
    return _units().get(unit(name), ((unit(name), 1.0),))[-1]


def error_unit(channel: Channel, *, is_alone: bool) -> tuple[str, float]:
    """The unit in which all errors (SI) of a channel are shown on a page, and the scale to it.

    Those of a tank's pressure (`is_alone`: of a part alone) may be far below a kPa: they are in Pa;
    an actuator's in that of its open-loop errors.
    """
    return (
        ("Pa", 1.0)
        if is_alone and channel.is_pressure
        else (channel.residual_unit, channel.residual_scale)
    )


def balance_unit(si: str, *, is_alone: bool) -> tuple[str, float]:
    """The same by the SI unit of a balance, a fit or a prediction, as `error_unit` of a channel."""
    return (si, 1.0) if is_alone and si == "Pa" else residual_unit(si)


@cache
def _units() -> dict[str, tuple[tuple[str, float], ...]]:
    """The log format's units by that in SI: of signals, then of residuals; and those of rates."""
    found: dict[str, tuple[tuple[str, float], ...]] = {}
    for one in CHANNELS:
        if one.si and one.unit:
            pair = (one.unit, one.scale), (one.residual_unit, one.residual_scale)
            found.setdefault(unit(one.si), pair)
    rates = {f"{si}/s": tuple((f"{name}/s", k) for name, k in own) for si, own in found.items()}
    return rates | found


__all__ = [
    "RATE_OF",
    "Own",
    "balance_unit",
    "channel_in",
    "error_unit",
    "in_words",
    "residual_unit",
    "shown_unit",
]
