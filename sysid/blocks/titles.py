"""Titles as they stand within sentences."""

from __future__ import annotations

import re

# Names of people and of valves, and abbreviations.
_NAME = re.compile(r"Coulomb|Stribeck|LuGre|Valve [A-Z]\b|.[^a-z ]|.$")


def within(title: str) -> str:
    """A title within a sentence: with a small letter, unless a name begins it."""
    return title if _NAME.match(title) else f"{title[:1].lower()}{title[1:]}"


__all__ = ["within"]
