"""Static figures: matplotlib's SVG, prepared for embedding in a page.

Colours are placeholders that become CSS custom properties, so that a figure follows the
page's scheme (light, dark, print); text stays text in the page's font. Each figure is named
and described for screen readers, and its ids are its own. No text that came from a file is
drawn: labels of tests go into the captions, which the template escapes.
"""

from __future__ import annotations

import html
import io
import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from sysid.blocks.drawing import draw, thinned
from sysid.blocks.figures import PANEL, SMALL_PANEL, TALL_PANEL, ColourMap, Figure, Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MatplotlibFigure


# One placeholder per role; style.css gives each its colour in either scheme.
_ROLES = ("ink", "muted", "grid", "measured", "model", "second", "third", "fourth", "band")
COLOUR = {role: f"#fe{i:02x}01" for i, role in enumerate(_ROLES)}

_MARGIN = {"left": 0.64, "right": 0.21, "top": 0.31, "bottom": 0.48}  # inches
_FONT_PT = 8.6
_STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "sysid",
    "text.parse_math": False,
    "axes.formatter.use_mathtext": False,
    "axes.unicode_minus": True,
    "axes.formatter.limits": (-3, 5),
    "axes.formatter.useoffset": False,
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": _FONT_PT,
    "text.color": COLOUR["ink"],
    "axes.labelcolor": COLOUR["ink"],
    "axes.edgecolor": COLOUR["muted"],
    "axes.titlesize": _FONT_PT,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 5.0,
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.xmargin": 0.01,
    "grid.color": COLOUR["grid"],
    "grid.linewidth": 0.5,
    "xtick.color": COLOUR["muted"],
    "ytick.color": COLOUR["muted"],
    "xtick.labelcolor": COLOUR["ink"],
    "ytick.labelcolor": COLOUR["ink"],
    "xtick.major.size": 2.5,
    "ytick.major.size": 2.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 1.1,
    "lines.solid_joinstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": _FONT_PT,
    "legend.handlelength": 1.8,
    "legend.borderaxespad": 0.2,
    "legend.labelspacing": 0.25,
    "path.simplify": True,
    "path.simplify_threshold": 0.4,
    "savefig.dpi": 144,
    "image.interpolation": "none",
}


def styled() -> Any:
    """Context in which figures are drawn and written: the report's style."""
    import matplotlib

    return matplotlib.rc_context(_STYLE)


def panel(title: str, size: tuple[float, float] = PANEL) -> tuple[MatplotlibFigure, Axes]:
    """A figure with one axes, its margins fixed in inches so that panels line up."""
    figure, axes = panels(title, (1.0,), size)
    return figure, axes[0]


def panels(
    title: str,
    heights: Sequence[float],
    size: tuple[float, float] = PANEL,
    right: float = 0.0,
    left: float = _MARGIN["left"],
) -> tuple[MatplotlibFigure, list[Axes]]:
    """A figure with axes below one another, of relative `heights`, that share the x axis.

    `right` inches more are kept free on the right (for a colour bar), `left` inches in all on
    the left (for the y axis' labels).
    """
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure as MatplotlibFigure
    from matplotlib.ticker import MaxNLocator

    width, height = size
    figure = MatplotlibFigure(figsize=size)
    FigureCanvasSVG(figure)
    start, bottom = left / width, _MARGIN["bottom"] / height
    wide = 1.0 - start - (_MARGIN["right"] + right) / width
    gap = 0.12 / height
    free = 1.0 - bottom - _MARGIN["top"] / height - gap * (len(heights) - 1)
    top = 1.0 - _MARGIN["top"] / height
    axes: list[Axes] = []
    for share in heights:
        part = free * share / sum(heights)
        axes.append(
            figure.add_axes((start, top - part, wide, part), sharex=axes[0] if axes else None)
        )
        top -= part + gap
    for ax in axes[:-1]:
        ax.tick_params(labelbottom=False)
    for ax in axes:
        steps = [1, 2, 2.5, 5, 10]
        ax.xaxis.set_major_locator(MaxNLocator(5 if width > SMALL_PANEL[0] else 4, steps=steps))
        ax.yaxis.set_major_locator(MaxNLocator(5 if len(heights) == 1 else 4, steps=steps))
    figure.text(0.06 / width, 1.0 - 0.06 / height, title, va="top", ha="left", weight="bold")
    return figure, axes


_NAMES_INSIDE, _COLOUR_BAR = 0.16, 0.62
# Inches of a row of a legend between a figure's title and its axes.
_LEGEND_ROW = 0.17
_POINTS_PER_INCH = 72.0
_LETTER_INCHES = 0.62 * _FONT_PT / _POINTS_PER_INCH
# Left of the axes besides the tick labels: the ticks, the turned label, what is between them, and
# as much at the edge.
_BESIDE_TICK_LABELS = (2.5 + 3.5 + 4.0 + 1.3 * _FONT_PT + 3.5) / _POINTS_PER_INCH


def picture(figure: Figure) -> Picture:
    """A figure's print form."""
    cells = [m for panel in figure.panels for m in panel.marks if isinstance(m, ColourMap)]
    with styled():
        made, axes = panels(
            figure.heading or figure.title,
            [panel.height for panel in figure.panels],
            figure.size,
            right=_COLOUR_BAR if cells else 0.0,
            left=_NAMES_INSIDE if figure.panels[0].has_names else _MARGIN["left"],
        )
        buckets = int(_POINTS_PER_INCH * figure.size[0])  # one a point
        for ax, panel in zip(axes, figure.panels, strict=True):
            mapped = draw(ax, panel, COLOUR, buckets)
            if mapped is not None:
                _colour_bar(made, ax, mapped, cells[0].unit)
        if not figure.panels[0].has_names:
            _make_room(made, axes)
        for ax, panel in zip(axes, figure.panels, strict=True):
            if panel.legend == "over":
                _move_to_title(made, ax)
        for ax in axes[:-1]:
            ax.set_xlabel("")
        made.align_ylabels(axes)
        return to_figure(made, figure.id, figure.title, figure.description)


def _make_room(figure: MatplotlibFigure, axes: Sequence[Axes]) -> None:
    """Move the axes' left edge to the right where wide tick labels would push the label out."""
    widest = max(
        (
            text.get_window_extent().width
            for ax in axes
            for text in ax.yaxis.get_ticklabels(which="both")
            if ax.viewLim.y0 <= text.get_position()[1] <= ax.viewLim.y1
        ),
        default=0.0,
    )
    left = (widest / figure.dpi + _BESIDE_TICK_LABELS) / figure.get_figwidth()
    for ax in axes:
        box = ax.get_position()
        if left > box.x0:
            ax.set_position((left, box.y0, box.x1 - left, box.height))


def _move_to_title(figure: MatplotlibFigure, ax: Axes) -> None:
    """A legend over the axes beside the title, where both have room: a phone shows the left end.

    Else in rows of its own between the two.
    """
    found = ax.get_legend()
    if found is None:
        return
    width, height = (float(inches) for inches in figure.get_size_inches())
    left = 0.3 + _LETTER_INCHES * len(figure.texts[0].get_text())
    wide = [_LETTER_INCHES * (len(text.get_text()) + 6) for text in found.get_texts()]
    box = ax.get_position()
    if left + sum(wide) < width:
        found.set_loc("lower left")
        found.set_bbox_to_anchor(((left / width - box.x0) / box.width, 0.99), ax.transAxes)
        return
    title = figure.texts[0].get_window_extent()
    if found.get_window_extent().x0 > title.x1:
        return
    columns = max(int((width - _MARGIN["right"]) / max(wide)), 1)
    rows = math.ceil(len(wide) / columns)
    ax.set_position((box.x0, box.y0, box.width, box.height - _LEGEND_ROW * rows / height))
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 0.99), ncols=columns)


def _colour_bar(figure: MatplotlibFigure, ax: Axes, mapped: Any, unit: str) -> None:
    """Right of the axes, its unit above it."""
    width, height = figure.get_size_inches()
    box = ax.get_position()
    bar = figure.add_axes((box.x1 + 0.09 / width, box.y0, 0.10 / width, box.height))
    figure.colorbar(mapped, cax=bar).outline.set_visible(False)
    bar.tick_params(length=0, pad=2)
    figure.text(box.x1, 1.0 - 0.06 / height, unit, va="top", ha="left")


def legend(ax: Axes, **options: Any) -> None:
    """A legend that does not hide the data beneath it, if there is anything to label."""
    if ax.get_legend_handles_labels()[0]:
        ax.legend(**{"loc": "best", **options})


def to_figure(figure: MatplotlibFigure, id: str, title: str, description: str) -> Picture:
    """The matplotlib figure as inline SVG, with its `title` and `description`.

    `id` must be the figure's own in the page. To be called within `styled()`.
    """
    buffer = io.StringIO()
    nothing = {"Date": None, "Creator": None, "Format": None, "Type": None}
    figure.savefig(buffer, format="svg", transparent=True, metadata=nothing)
    text = buffer.getvalue()
    return Picture(id, title, description, inline(text, id, title, description))


_ID = re.compile(r' id="([^"]*)"')
_REFERENCE = re.compile(r'(url\(#|href="#)([^")]*)')
_NUMBER = re.compile(r"-?\d+\.\d{3,}")
_PATH = re.compile(r'(?:\bd|points|transform|x|y|width|height)="[^"]*"')
_FONT = re.compile(r"font: |font-family: [^;\"]*;? ?")
_TAG = re.compile(r"<svg [^>]*viewBox=\"([^\"]*)\"[^>]*>")
_STYLE_BLOCK = re.compile(r"<defs>\s*<style[^>]*>.*?</style>\s*</defs>", re.DOTALL)
_ROLE = re.compile("|".join(COLOUR.values()))
_VARIABLE = {value: f"var(--{role})" for role, value in COLOUR.items()}


def inline(text: str, id: str, title: str, description: str) -> str:
    """A whole SVG document turned into an element of a page."""
    body = text[text.index("<svg ") :]
    body = _STYLE_BLOCK.sub("", re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL))
    used = {match.group(2) for match in _REFERENCE.finditer(body)}
    body = _ID.sub(lambda m: f' id="{id}-{m.group(1)}"' if m.group(1) in used else "", body)
    body = _REFERENCE.sub(rf"\g<1>{id}-\g<2>", body)
    body = body.replace("xlink:href", "href")
    body = _PATH.sub(lambda m: _NUMBER.sub(_shorter, m.group(0)).replace("\n", ""), body)
    body = _FONT.sub("", body)
    body = _ROLE.sub(lambda m: _VARIABLE[m.group(0)], body)
    body = re.sub(r">\s+<", "><", body)
    match = _TAG.match(body)
    if match is None:
        raise ValueError("matplotlib wrote no viewBox")
    width = float(match.group(1).split()[2]) * 96.0 / _POINTS_PER_INCH
    head = (
        f'<svg viewBox="{match.group(1)}" style="max-width:{width:.0f}px" role="img" '
        f'aria-labelledby="{id}-title {id}-desc"><title id="{id}-title">{html.escape(title)}'
        f'</title><desc id="{id}-desc">{html.escape(description)}</desc>'
    )
    return head + body[match.end() :]


def _shorter(match: re.Match[str]) -> str:
    return f"{float(match.group(0)):.2f}".rstrip("0").rstrip(".")


__all__ = [
    "COLOUR",
    "PANEL",
    "SMALL_PANEL",
    "TALL_PANEL",
    "inline",
    "legend",
    "panel",
    "panels",
    "picture",
    "styled",
    "thinned",
    "to_figure",
]
