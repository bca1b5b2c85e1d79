"""A section that cannot be made or drawn does not end its page: it says so, and why."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from sysid.blocks import svg
from sysid.blocks.figures import Figure
from sysid.blocks.sections import Block, FigureGroup, Fold, Section
from sysid.errors import Failure, on_its_own


def section_or_why(id: str, title: str, build: Callable[[], Section | None]) -> Section | None:
    """The section that `build` makes, its figures drawn; None where it has no content.

    Where it cannot be made, a section of this id and title that says why.
    """
    built = on_its_own(lambda: _drawn(build()))
    if not isinstance(built, Failure):
        return built
    return Section(id, title, (f"This section could not be made: {built.reason}.",))


def _drawn(section: Section | None) -> Section | None:
    return None if section is None else replace(section, blocks=drawn(section.blocks))


def drawn(blocks: Sequence[Block]) -> tuple[Block, ...]:
    """The blocks with each figure as the picture that a page holds."""
    return tuple(map(_drawn_block, blocks))


def _drawn_block(block: Block) -> Block:
    if isinstance(block, Fold):
        return replace(block, blocks=drawn(block.blocks))
    if isinstance(block, FigureGroup):
        pictures = (svg.picture(f) if isinstance(f, Figure) else f for f in block.figures)
        return replace(block, figures=tuple(pictures))
    return block


__all__ = ["drawn", "section_or_why"]
