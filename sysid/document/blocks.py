"""The elements of a section of the report: tables, figures, plots, lines of text.

Everything is plain text that the template escapes; the only markup is a figure's SVG, which
`sysid.document.svg` makes and which holds no text from a file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

# Longer text may be wrapped.
_LONGEST_CELL = 36


class NotedCell(str):
    """A cell with a line in small beneath its text: an id, a key. Equal to its text alone."""

    __slots__ = ("small",)
    small: str

    def __new__(cls, text: str, small: str = "") -> NotedCell:
        """The text, and what is written in small beneath it."""
        cell = super().__new__(cls, text)
        cell.small = small
        return cell


@dataclass(frozen=True)
class HtmlTable:
    """A table: the first cell of each row is its header.

    `numeric` columns are right-aligned, `code` is monospaced; only `prose` may wrap.
    """

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: frozenset[int] = frozenset()
    code: frozenset[int] = frozenset()
    prose: frozenset[int] = frozenset()
    kind: Literal["table"] = "table"


@dataclass(frozen=True)
class ComparedCell:
    """Our figure above the other one and the factor between them; `level` tints the cell.

    -2 to 2: far below, below, near, above, far above.
    """

    ours: str
    other: str
    factor: str
    level: int = 0


@dataclass(frozen=True)
class ComparedTable:
    """A table of our figures and others; `groups` are names and widths above the columns."""

    caption: str
    heading: str
    groups: tuple[tuple[str, int], ...]
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[ComparedCell, ...]], ...]
    id: str = ""
    kind: Literal["compared"] = "compared"


@dataclass(frozen=True)
class Figure:
    """A static figure. `svg` is safe markup; `title` names it, `description` puts it in words."""

    id: str
    title: str
    description: str
    svg: str


@dataclass(frozen=True)
class FigureGroup:
    """Figures next to each other under one caption, which may name the matching thesis figures."""

    caption: str
    figures: tuple[Figure, ...]
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
    static: tuple[Figure, ...]
    kind: Literal["plot"] = "plot"


@dataclass(frozen=True)
class Lines:
    """Lines of text; with a `summary` they are collapsed behind it."""

    lines: tuple[str, ...]
    summary: str = ""
    kind: Literal["lines"] = "lines"


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


Block = HtmlTable | ComparedTable | FigureGroup | Plot | Lines | Heading | Terms | Fold


@dataclass(frozen=True)
class Section:
    """A numbered section; `intro` are its first paragraphs."""

    id: str
    title: str
    intro: tuple[str, ...] = ()
    blocks: tuple[Block, ...] = field(default=())


def table(
    caption: str,
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    text: Sequence[int] = (),
    code: Sequence[int] = (),
) -> HtmlTable:
    """A table whose columns are numbers except the first and those in `text` and `code`."""
    words = {0, *text, *code}
    numeric = frozenset(i for i in range(len(columns)) if i not in words)
    prose = frozenset(
        i for i in words.difference(code) if any(len(row[i]) > _LONGEST_CELL for row in rows)
    )
    cells = tuple(tuple(row) for row in rows)
    return HtmlTable(caption, tuple(columns), cells, numeric, frozenset(code), prose)
