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


_NAME_WORD = re.compile(r"[A-Za-z]+\d*|\d+")


def words_of(name: str, unit: str) -> str:
    """A name of a file, whose end may say its unit, in words: `back_emf_v_s_per_rad` is back emf.

    The end is left away where it spells the `unit` that was declared, and something precedes it.
    """
    words = name.split("_")
    said = "".join(word for word in _NAME_WORD.findall(unit.replace("**", ""))).lower()
    for first in range(1, len(words)):
        if "".join(word for word in words[first:] if word != "per").lower() == said:
            return " ".join(words[:first])
    return " ".join(words)


def use_word(use: str, *, before_noun: bool = False) -> str:
    """What a log is used for, from its entry in a campaign ("fit", "holdout")."""
    held_out = "held-out" if before_noun else "held out"
    return held_out if use == "holdout" else "training"


__all__ = ["capital", "use_word", "within", "words_of"]
