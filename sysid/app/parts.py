"""What screens are made of: HTML whose elements say what they do, and blocks drawn with Bokeh.

An element with `data-do` sends that text to the page when it is clicked or changed (`page.js`).
Texts are escaped here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from html import escape
from importlib import import_module
from typing import Any
from urllib.parse import quote

from sysid.blocks.figures import PANEL, Figure, Picture
from sysid.blocks.html import block_html, coded, typeset
from sysid.blocks.interactive import Scheme, draw
from sysid.blocks.sections import Block, FigureGroup, Fold, Plot, Section
from sysid.errors import grouped, together

# Panel's classes have no annotations.
pn: Any = import_module("panel")
Chosen = Callable[[Figure, int, int], None]
"""Called with a figure, the number of its cloud of points, and the point that was clicked."""
# A figure wider than this, in panels, has a row of its own.
_WIDE = 1.5


def html(markup: str, **options: Any) -> Any:
    """A pane of markup, as wide as its place."""
    given = {"sizing_mode": "stretch_width", "margin": 0, "css_classes": ["markup"], **options}
    return pn.pane.HTML(markup, **given)


def words(text: object) -> str:
    """A text as markup."""
    return escape(str(text))


def message(line: str) -> str:
    """A line of the library as pages have it: signs and units typeset, what is in backticks as
    code."""
    return str(coded(typeset(line)))


def button(text: str, do: str, *, value: str = "", kind: str = "", off: bool = False,
           title: str = "") -> str:  # fmt: skip
    """A button that does something; `kind`: "primary", "small", "danger"."""
    more = f' data-value="{words(value)}"' if value else ""
    more += f' title="{words(title)}"' if title else ""
    more += " disabled" if off else ""
    return (
        f'<button type="button" class="{kind}" data-do="{words(do)}"{more}>{words(text)}</button>'
    )


def select(do: str, options: Iterable[tuple[str, str]], chosen: str, label: str) -> str:
    """A menu of (value, text); `label` names it to screen readers."""
    inner = "".join(
        f'<option value="{words(v)}"{" selected" if v == chosen else ""}>{words(t)}</option>'
        for v, t in options
    )
    return f'<select data-do="{words(do)}" aria-label="{words(label)}">{inner}</select>'


def select_grouped(
    do: str, first: str, groups: Mapping[str, Iterable[tuple[str, str]]], label: str
) -> str:
    """A menu of groups of (value, text) under their names; what is shown is `first`, no choice."""
    inner = "".join(
        f'<optgroup label="{words(name)}">'
        + "".join(f'<option value="{words(v)}">{words(t)}</option>' for v, t in options)
        + "</optgroup>"
        for name, options in groups.items()
    )
    head = f'<option value="" selected>{words(first)}</option>'
    return f'<select data-do="{words(do)}" aria-label="{words(label)}">{head}{inner}</select>'


def entry(do: str, value: object, label: str, *, size: int = 8, hint: str = "",
          kind: str = "text") -> str:  # fmt: skip
    """A field for a text or a number."""
    return (
        f'<input type="{kind}" data-do="{words(do)}" value="{words(value)}" size="{size}" '
        f'aria-label="{words(label)}" placeholder="{words(hint)}" autocomplete="off">'
    )


def tick(do: str, text: str, on: bool) -> str:
    """A box to tick."""
    state = " checked" if on else ""
    return (
        f'<label class="tick"><input type="checkbox" data-do="{words(do)}"{state}>'
        f"{words(text)}</label>"
    )


def slider(do: str, low: float, high: float, step: float, value: float, label: str) -> str:
    """A slider, which tells every move."""
    return (
        f'<input type="range" data-do="{words(do)}" min="{low!r}" max="{high!r}" '
        f'step="{step!r}" value="{value!r}" aria-label="{words(label)}">'
    )


def rows(
    headings: Sequence[str],
    lines: Iterable[Sequence[str]],
    caption: str = "",
    *,
    as_cards: bool = False,
) -> str:
    """A table of cells that are markup; a row that begins with "class:" has that class.

    `as_cards`: on a phone a row is its first cell, and beneath it the others with their headings;
    what can be clicked or chosen says itself what it is.
    """
    head = "".join(f'<th scope="col">{words(h)}</th>' for h in headings)
    body = ""
    for line in lines:
        cells = list(line)
        kind = ""
        if cells and cells[0].startswith("class:"):
            kind = f' class="{cells.pop(0)[6:]}"'
        if as_cards:
            labels = [
                "" if "data-do" in cell else words(h)
                for h, cell in zip(headings, cells, strict=True)
            ]
            shown = f'<th scope="row">{cells[0]}</th>' + "".join(
                f'<td data-label="{label}">{cell}</td>' if cell else "<td></td>"
                for label, cell in zip(labels[1:], cells[1:], strict=True)
            )
        else:
            shown = "".join(f"<td>{cell}</td>" for cell in cells)
        body += f"<tr{kind}>{shown}</tr>"
    named = f"<caption>{words(caption)}</caption>" if caption else ""
    return (
        f'<div class="scroll"><table>{named}<thead><tr>{head}</tr></thead>'
        f"<tbody>{body}</tbody></table></div>"
    )


def file_link(name: str, text: str) -> str:
    """A link to a file of the folder: a page is opened, another file is downloaded."""
    is_page = name.endswith(".html")
    more = ' target="_blank" rel="noopener"' if is_page else " download"
    said = f"{'open' if is_page else 'download'} {text}".strip()
    return f'<a href="files/{quote(name)}"{more}>{words(said)}</a>'


def listed(lines: Iterable[str]) -> str:
    """Lines as a list, what is in backticks as code; nothing without any."""
    inner = "".join(f"<li>{message(line)}</li>" for line in lines)
    return f"<ul>{inner}</ul>" if inner else ""


def notices(lines: Iterable[str], most: int) -> str:
    """A command's notices as a list, those alike as one; those beyond `most` are folded."""
    shown = grouped(together(lines), rest="see what it printed")
    more = len(shown) - most
    said = f"{more} more notice{'s' * (more > 1)}"
    return listed(shown[:most]) + (fold(said, listed(shown[most:])) if more > 0 else "")


def card(title: str, inner: str, kind: str = "") -> str:
    """A box with a heading."""
    return f'<section class="card {kind}"><h3>{words(title)}</h3>{inner}</section>'


def note(text: str, kind: str = "muted") -> str:
    """A paragraph; `kind` "error" or "warn" stands out."""
    return f'<p class="{kind}">{words(text)}</p>'


def fold(summary: str, inner: str, *, is_open: bool = False) -> str:
    """Markup behind a summary."""
    state = " open" if is_open else ""
    return f"<details{state}><summary>{words(summary)}</summary>{inner}</details>"


# --- blocks ---------------------------------------------------------------------------------


def figure_pane(figure: Figure, scheme: Scheme, chosen: Chosen | None = None) -> Any:
    """A figure drawn with Bokeh; a point that is clicked is told."""
    drawn = draw(figure, scheme)
    if chosen is not None and drawn.points:
        from bokeh.models import TapTool

        for plot in drawn.plots:
            plot.add_tools(TapTool())
        for number, source in enumerate(drawn.points):
            source.selected.on_change("indices", _told(figure, number, chosen))
    pane = pn.pane.Bokeh(
        drawn.layout,
        sizing_mode="stretch_width",
        margin=(0, 12, 8, 0),
        css_classes=["whole-row"] if figure.size[0] > _WIDE * PANEL[0] else [],
    )
    pane.min_width = 300
    return pane


def _told(figure: Figure, number: int, chosen: Chosen) -> Callable[[str, Any, Any], None]:
    def told(attr: str, old: Any, new: list[int]) -> None:
        if new:
            chosen(figure, number, new[0])

    return told


def block_panes(blocks: Iterable[Block], scheme: Scheme, chosen: Chosen | None = None) -> list[Any]:
    """Panes for blocks: figures with Bokeh, what is text and tables as HTML."""
    panes: list[Any] = []
    for block in blocks:
        if isinstance(block, FigureGroup):
            panes += _group(block, scheme, chosen)
        elif isinstance(block, Fold) and any(isinstance(b, FigureGroup) for b in block.blocks):
            panes.append(_folded(block, scheme, chosen))
        elif not isinstance(block, Plot):
            panes.append(html(block_html(block)))
    return panes


def _folded(fold: Fold, scheme: Scheme, chosen: Chosen | None) -> Any:
    """A fold whose figures are drawn when it is opened first."""
    card = pn.Card(
        title=fold.summary,
        collapsed=True,
        sizing_mode="stretch_width",
        css_classes=["unfold"],
        header_css_classes=["card-header", "unfold-head"],
        title_css_classes=["unfold-title"],
    )

    def opened(event: Any) -> None:
        if not event.new and not card.objects:
            card.objects = block_panes(fold.blocks, scheme, chosen)

    card.param.watch(opened, "collapsed")
    return card


def _group(group: FigureGroup, scheme: Scheme, chosen: Chosen | None) -> list[Any]:
    drawn = [
        html(f'<div class="panel">{f.svg}</div>')
        if isinstance(f, Picture)
        else figure_pane(f, scheme, chosen)
        for f in group.figures
    ]
    caption = [html(f"<p class='muted'>{words(group.caption)}</p>")] if group.caption else []
    return [grid(drawn), *caption]


def grid(panes: Sequence[Any], columns: int = 3) -> Any:
    """Panes next to each other, fewer where the window is narrow."""
    # A column of Bokeh holds its children itself: the page's style makes a grid of it.
    return pn.Column(
        *panes,
        sizing_mode="stretch_width",
        css_classes=["plots", f"of-{min(len(panes), columns)}"],
        margin=0,
    )


def beside(side: Sequence[Any], wide: Sequence[Any]) -> Any:
    """A list, and next to it what was chosen from it; below it where the window is narrow."""
    # Not Panel's FlexBox: its children are in a box of its own, which wraps them in any window.
    return pn.Column(
        pn.Column(*side, css_classes=["side"], margin=0),
        pn.Column(*wide, css_classes=["wide"], margin=0),
        sizing_mode="stretch_width",
        css_classes=["split"],
        margin=0,
    )


def section_panes(section: Section, scheme: Scheme, chosen: Chosen | None = None) -> list[Any]:
    """A section of the report: its heading, its first paragraphs and its blocks."""
    head = f"<h2>{words(section.title)}</h2>" + "".join(f"<p>{coded(p)}</p>" for p in section.intro)
    return [html(head), *block_panes(section.blocks, scheme, chosen)]


def column(*panes: Any) -> Any:
    """Panes below one another."""
    return pn.Column(*panes, sizing_mode="stretch_width", margin=0)


__all__ = [
    "beside",
    "block_panes",
    "button",
    "card",
    "column",
    "entry",
    "figure_pane",
    "fold",
    "grid",
    "html",
    "listed",
    "message",
    "note",
    "rows",
    "section_panes",
    "select",
    "slider",
    "tick",
    "words",
]
