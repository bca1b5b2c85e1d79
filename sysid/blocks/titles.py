"""Titles and words as they stand alone and within sentences."""

from __future__ import annotations

import re

# Names of people and of valves, and abbreviations.
_NAME = re.compile(r"Coulomb|Stribeck|LuGre|Valve [A-Z]\b|.[^a-z ]|.$")


def within(title: str) -> str:
    """A title within a sentence: with a small letter, unless a name begins it."""
    return title if _NAME.match(title) else f"{title[:1].lower()}{title[1:]}"


def capital(text: str) -> str:
    """A text as it stands alone, or begins a sentence: with a capital letter; the rest as it is."""
    return f"{text[:1].upper()}{text[1:]}"


def use_word(use: str, *, before_noun: bool = False) -> str:
    """What a log is used for, from its entry in a campaign ("fit", "holdout")."""
    held_out = "held-out" if before_noun else "held out"
    return held_out if use == "holdout" else "training"


__all__ = ["capital", "use_word", "within"]
