"""What a number of a model is called for readers, found from its name in files and commands."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache

from sysid.blocks.tables import NotedCell
from sysid.blocks.titles import capital, within
from sysid.parameters.table import in_words, title_of_key

# An effect's place or the prefix of its numbers: its id, with a side or a count where it has one.
_EFFECT = re.compile(r"(?:effect )?([a-z0-9-]+?)(?:-(\d+))?(?: \((\w+)\))?(?: (\d+))?\.(\w+)")
_EFFECT_PLACE = re.compile(r"effect ([a-z0-9-]+)(?: \((\w+)\))?(?: (\d+))?")
_CONSTANTS = {
    "inertia": "Inertia",
    "gravity_moment": "Moment of gravity",
    "weight": "Weight",
    "area_a": "Piston area of chamber A",
    "area_b": "Piston area of chamber B",
    "dead_length_a": "Length of chamber A in the middle",
    "dead_length_b": "Length of chamber B in the middle",
    "supply_pressure": "Supply pressure",
    "on_delay_a": "Valve A, delay, on",
    "off_delay_a": "Valve A, delay, off",
    "on_delay_b": "Valve B, delay, on",
    "off_delay_b": "Valve B, delay, off",
}


def title_of(name: str) -> str:
    """A number's title by its path or alias, of a sum those of its parts; the name itself where it
    has none that is known.
    """
    if " " in name and (said := in_words(name)) != name:
        return said
    place, _, key = name.rpartition(".")
    if place == "rig":
        return _CONSTANTS.get(key, name)
    if place in ("friction", "friction.cross_check"):
        title = title_of_key(key)
        return "Offset of friction" if title == "Offset" else title or name
    first, *rest = name.split(".")
    if first == "valves" and len(rest) > 1:
        return _of_valve(f"Valve {rest[0].upper()}, ", rest[1:]) or name
    if first.startswith("valve "):  # one bundle's valves against one another
        title = _of_valve("", rest)
        return capital(title) or name
    found = _EFFECT.fullmatch(name)
    return (_of_effect(*found.groups("")) if found else "") or name


def short_title(name: str, longest: int = 44) -> str:
    """A number's title for a figure, shortened at the end of a word."""
    title = title_of(name)
    if len(title) <= longest:
        return title
    cut = title[: longest - 1].rpartition(" ")[0].rstrip(" ,:")
    return f"{cut or title[: longest - 2]} \N{HORIZONTAL ELLIPSIS}"


def part_title(part: str) -> str:
    """What a part is called, by its place; the place itself where it has no title."""
    found = _EFFECT_PLACE.fullmatch(part)
    if found and (title := _effects().get(found[1], ("", {}))[0]):
        return f"{title}{_which(*found.groups('')[1:])}"
    first, *rest = part.split(".")
    if first == "valves" and rest:
        law = {"discrete": "on/off", "pwm": "PWM"}.get(rest[-1], rest[-1])
        return f"Valve {rest[0].upper()}, {law}"
    return {"friction": "Friction"}.get(part, part)


def _of_valve(valve: str, keys: Sequence[str]) -> str:
    """Keys from the law on; a direction's numbers are keys within keys."""
    title = title_of_key(".".join(keys[-2:])) or title_of_key(keys[-1])
    law = ", averaged law" if "averaged" in keys else ""
    return f"{valve}{within(title)}{law}" if title else ""


def _of_effect(id: str, number: str, side: str, count: str, label: str) -> str:
    title, meanings = _effects().get(id, ("", {}))
    if label not in meanings:
        return ""
    return f"{title}{_which(side, number or count)}: {meanings[label]}"


def _which(*said: str) -> str:
    """An effect's side, and its number where there are several of it."""
    return "".join(f" ({one.upper()})" for one in said if one)


@cache
def _effects() -> dict[str, tuple[str, dict[str, str]]]:
    """Title, and meanings of the numbers, of every effect of the catalogue, rotary and linear."""
    from sysid.plant.effects.catalogue import catalogue
    from sysid.plant.effects.linear import linear_form

    found = {}
    for id, effect in catalogue().items():
        quantities = (*linear_form(effect).quantities, *effect.quantities)
        found[id] = (effect.title, {q.label: q.title for q in quantities})
    return found


def named(name: str) -> NotedCell:
    """A cell of a number: its title, with its name in files beneath; in a terminal that name."""
    title = title_of(name)
    return NotedCell(title, "" if title == name else name, plain=name)


__all__ = ["named", "part_title", "short_title", "title_of"]
