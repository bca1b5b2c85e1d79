"""What a page, a terminal or a notebook is made of: tables, figures and text, in sections.

All text is plain: each renderer escapes it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from sysid.blocks.figures import Figure, Picture
from sysid.blocks.tables import ComparedTable, Table


class Said(str):
    """A line, and `about`: the names in files of the numbers that it says are not identified."""

    __slots__ = ("about",)
    about: tuple[str, ...]

    def __new__(cls, text: str, *about: str) -> Said:
        """The line, and what it is about."""
        line = super().__new__(cls, text)
        line.about = about
        return line


@dataclass(frozen=True)
class FigureGroup:
    """Figures next to each other under one caption, which may name the matching thesis figures."""

    caption: str
    figures: tuple[Figure | Picture, ...]
    kind: Literal["figures"] = "figures"


@dataclass(frozen=True)
class Plot:
    """An interactive plot, and the static figures shown in its place.

    `document` is Bokeh's JSON, which plots may share; `samples` are this plot's own.
    """

    id: str
    title: str
    description: str
    caption: str
    document: dict[str, Any]
    samples: dict[str, Any]
    static: tuple[Picture, ...]
    kind: Literal["plot"] = "plot"


@dataclass(frozen=True)
class Lines:
    """Lines of text; with a `summary` they are collapsed behind it."""

    lines: tuple[str, ...]
    summary: str = ""
    kind: Literal["lines"] = "lines"


@dataclass(frozen=True)
class Notes:
    """What limits a number, shown next to the number."""

    lines: tuple[str, ...]
    kind: Literal["notes"] = "notes"


@dataclass(frozen=True)
class Heading:
    """A heading below the section's own."""

    id: str
    text: str
    kind: Literal["heading"] = "heading"


@dataclass(frozen=True)
class Terms:
    """What something is, in a sentence: (its title, its id, the sentence) each."""

    pairs: tuple[tuple[str, str, str], ...]
    kind: Literal["terms"] = "terms"


@dataclass(frozen=True)
class Fold:
    """Blocks collapsed behind a summary."""

    summary: str
    blocks: tuple[Block, ...]
    kind: Literal["fold"] = "fold"


Block = Table | ComparedTable | FigureGroup | Plot | Lines | Notes | Heading | Terms | Fold


@dataclass(frozen=True)
class Section:
    """A numbered section; `intro` are its first paragraphs."""

    id: str
    title: str
    intro: tuple[str, ...] = ()
    blocks: tuple[Block, ...] = field(default=())


__all__ = ["Block", "FigureGroup", "Fold", "Heading", "Lines", "Notes", "Plot", "Section", "Terms"]
