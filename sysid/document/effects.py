"""The effects that a diagnosis found: a sentence on each, its picture, and its parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from sysid.blocks.figures import Picture
from sysid.blocks.numbers import MISSING, estimate_cells, number
from sysid.blocks.sections import Block, FigureGroup, Lines, Terms
from sysid.blocks.tables import NotedCell, Table, table
from sysid.diagnosis.wording import SMALLEST_P, effect_name, is_refined, joined, parameter_rows
from sysid.document import diagnosis_panels as panels
from sysid.estimation.linear import Estimate

Content = Mapping[str, Any]


def effect_blocks(content: Content, share: str, std: str, is_linear: bool) -> list[Block]:
    """What each effect is, what it adds along the tests, and its numbers.

    `share` heads the column of what each explained, `std` says where standard errors are from.
    """
    blocks: list[Block] = [effects_table(content, share), explained(content)]
    shown = content["figures"].get("shows") or []
    if shown:
        figures = tuple(
            _figure(place, entry, content, is_linear) for place, entry in enumerate(shown)
        )
        caption = (
            "What each effect adds to the model along the training tests, at its estimated size, "
            "over the quantity that it depends on most. Line: mean; shaded: the middle 90 %."
        )
        if any("unit" not in entry for entry in shown):
            caption += " Torques and forces count in the direction of positive motion."
        blocks.append(FigureGroup(caption, figures))
    return [*blocks, parameters_table(content, std), *_refitted(content)]


def _refitted(content: Content) -> list[Block]:
    """The base parameters that were estimated again beside the effects, from what to what."""
    if is_refined(content):
        line = (
            "The other parameters were estimated again beside these: from what to what each of "
            "them moved is in the section on the refinement."
        )
        return [Lines((line,))]
    rows: list[tuple[Any, ...]] = []
    for entry in content["figures"].get("refitted") or []:
        value, unit = float(entry["after"]), entry["unit"]
        after = Estimate(value, float(entry["std"]), unit, (math.nan, math.nan))
        before = Estimate(float(entry["before"]), math.nan, unit, (math.nan, math.nan))
        # Across 0 a change has no size in per cent.
        is_sized = value * before.value > 0.0
        change = number(100.0 * (value / before.value - 1.0), 2) if is_sized else MISSING
        cells = estimate_cells(after)
        rows.append((entry["name"], estimate_cells(before)[0], *cells[:2], change, cells[3]))
    if not rows:
        return []
    columns = ["Parameter", "From", "To", "Standard error", "Change, %", "Unit"]
    text: tuple[int, ...] = (len(columns) - 1,)
    # The names of an actuator's parameters have none in the model; they are in SI units.
    if not any(row[-1] for row in rows):
        columns, rows, text = columns[:-1], [row[:-1] for row in rows], ()
    caption = "Parameters of the base model, estimated again (SI units)"
    return [table(caption, columns, rows, text=text)]


def title_of(content: Content, id: str) -> str:
    """An effect's title; its id where it has none that is known."""
    return str(content["figures"]["titles"].get(id) or id)


def named(content: Content, id: str) -> NotedCell:
    """An effect by its title, the id in small beneath."""
    title = title_of(content, id)
    return NotedCell(title, "" if title == id else id)


def effects_table(content: Content, share: str) -> Table:
    """Every effect that was added; `share` heads the column of what each explained."""
    rows = [
        (
            named(content, effect["id"]),
            short_p(effect["p_value"]),
            number(100.0 * effect["share"]),
            _joined(content, effect["ambiguous_with"]) or MISSING,
        )
        for effect in content["effects"]
    ]
    columns = ("Effect", "p", share, "Indistinguishable from")
    return table("Effects added, in this order", columns, rows, text=(3,))


def _joined(content: Content, ids: Sequence[str]) -> str:
    """Effects in a cell, by their titles."""
    titles = content["figures"]["titles"]
    text = joined([effect_name(id, titles) for id in ids], "or")
    return text if text in ids else text[:1].upper() + text[1:]


def explained(content: Content) -> Terms:
    """What each effect does, in a sentence of the catalogue's."""
    laws = content["figures"].get("laws", {})
    pairs = [
        (title_of(content, id), id, laws[id])
        for effect in content["effects"]
        for id in (effect["id"],)
        if laws.get(id)
    ]
    return Terms(tuple(pairs))


def short_p(value: float) -> str:
    """A p-value for a table; very small ones by their bound."""
    return f"< {number(SMALLEST_P, 1)}" if value < SMALLEST_P else number(value, 1)


def parameters_table(content: Content, std: str) -> Table:
    """The parameters of every effect, with their intervals."""
    how = "from the refinement" if is_refined(content) else std
    caption = f"Their parameters; standard errors {how}"
    rows = []
    for effect in content["effects"]:
        meanings = content["figures"]["meanings"].get(effect["id"], {})
        for name, estimate in parameter_rows(effect):
            cells = (
                (estimate, MISSING, MISSING, "")
                if isinstance(estimate, str)
                else estimate_cells(estimate)
            )
            meaning = meanings.get(name, "")
            shown = NotedCell(meaning[:1].upper() + meaning[1:], name) if meaning else name
            rows.append((named(content, effect["id"]), shown, *cells))
    columns = ("Effect", "Parameter", "Value", "Standard error", "95 % interval", "Unit")
    return table(caption, columns, rows, text=(1, 5))


def _figure(place: int, entry: Content, content: Content, is_linear: bool) -> Picture:
    title = title_of(content, entry["id"])
    return panels.influence(f"fig-effect-{place}", title, entry, is_linear)


__all__ = ["effect_blocks", "named", "parameters_table", "short_p", "title_of"]
