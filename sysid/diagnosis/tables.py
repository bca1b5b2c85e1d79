"""A diagnosis as tables: the effects, their numbers, errors before and after, what was tried.

All are read from the dict of `sysid.diagnosis.content`; page, notebook and terminal show the same.
In a terminal effects and parameters have the ids that commands and files have, numbers are SI.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from sysid.blocks.numbers import MISSING, estimate_cells, number
from sysid.blocks.tables import NotedCell, Table, estimate_row, table
from sysid.blocks.titles import capital, within, words_of
from sysid.diagnosis.wording import (
    CORRECT_MODEL,
    SMALLEST_P,
    balance_of,
    effect_name,
    errors_by_step,
    floor_text,
    is_of_actuator,
    is_refined,
    joined,
    judged_tests,
    own_of,
    parameter_rows,
    steps,
)
from sysid.estimation.linear import Estimate
from sysid.io.own_channels import balance_unit, channel_in, error_unit
from sysid.parameters.table import title_of_field, unit_of_field

Content = Mapping[str, Any]

# Suspects of one round that a summary names.
_MOST_SUSPECTS = 6


def summary(content: Content) -> Iterator[Table]:
    """The tables that a terminal or a notebook shows of a diagnosis."""
    yield effects_table(content)
    yield parameters_table(content)
    yield errors_table(content)
    others = [
        (place, suspect)
        for place, look in enumerate(content["figures"]["looks"], start=1)
        for suspect in [s for s in look["suspects"] if s["fate"] != "added"][:_MOST_SUSPECTS]
    ]
    caption = f"Tried, and not added (at most {_MOST_SUSPECTS} a round, largest reduction first)"
    yield suspects_table(content, caption, others)


def title_of(content: Content, id: str) -> str:
    """An effect's title as it stands alone; its id where it has none that is known."""
    title = content["figures"]["titles"].get(id)
    return capital(title) if title else id


def named(content: Content, id: str) -> NotedCell:
    """An effect by its title, the id in small beneath."""
    title = title_of(content, id)
    return NotedCell(title, "" if title == id else id)


def effects_table(content: Content) -> Table:
    """Every effect that was added, and what it explained."""
    rows = [
        (
            named(content, effect["id"]),
            short_p(effect["p_value"]),
            number(100.0 * effect["share"]),
            _rivals(content, effect["ambiguous_with"]),
        )
        for effect in content["effects"]
    ]
    of = "excess" if is_of_actuator(content) else "prediction error"
    columns = ("Effect", "p", f"Share of the {of}, %", "Indistinguishable from")
    return table("Effects added, in this order", columns, rows, text=(3,))


def _rivals(content: Content, ids: Sequence[str]) -> str:
    titles = content["figures"]["titles"]
    text = joined([effect_name(id, titles) for id in ids], "or")
    shown = text if text in ids else capital(text)
    return NotedCell(shown, plain=joined(ids, "or")) if ids else MISSING


def short_p(value: float) -> str:
    """A p-value for a table; very small ones by their bound."""
    return f"< {number(SMALLEST_P, 1)}" if value < SMALLEST_P else number(value, 1)


def _reason_in_words(
    estimate: Estimate, effect: str, name: str, meanings: Mapping[str, str]
) -> Estimate:
    """An estimate whose reason names an effect's numbers by what they mean, not by their place.

    The row says which number it is: the reason begins with what is the matter with it.
    """
    if estimate.reason is None:
        return estimate
    reason = estimate.reason.removeprefix(f"{effect}/{name} is ")
    for other, meaning in meanings.items():
        reason = reason.replace(f"{effect}/{other}", within(meaning))
    return replace(estimate, reason=reason)


def parameters_table(content: Content) -> Table:
    """The parameters of every effect, with their intervals."""
    how = "by leaving out one test at a time"
    if is_refined(content):
        how = "from the refinement"
    elif not is_of_actuator(content):
        how = "by the residuals' correlation within tests, or by what differs between tests if more"
    rows: list[tuple[str, ...]] = []
    for effect in content["effects"]:
        meanings = content["figures"]["meanings"].get(effect["id"], {})
        forms = content["figures"].get("forms", {}).get(effect["id"], {})
        for name, estimate in parameter_rows(effect):
            cells = (
                (estimate, MISSING, MISSING, "")
                if isinstance(estimate, str)
                else estimate_row(_reason_in_words(estimate, effect["id"], name, meanings))
            )
            meaning = meanings.get(name, "")
            if not isinstance(estimate, str):
                cells = (_said(cells[0], forms.get(name, ()), estimate.value), *cells[1:])
            shown = NotedCell(capital(meaning), name) if meaning else name
            if name == "side":  # a chamber or its valve, as everywhere by its capital letter
                shown = NotedCell("Side", name)
                side = cells[0] if cells[0] == "both" else cells[0].upper()
                cells = (NotedCell(side, plain=cells[0]), *cells[1:])
            rows.append((named(content, effect["id"]), shown, *cells))
    columns = ("Effect", "Parameter", "Value", "Standard error", "95 % interval", "Unit")
    return table(f"Their parameters; standard errors {how}", columns, rows, text=(1, 5))


def _said(cell: str, forms: Sequence[tuple[float, str]], value: float) -> str:
    """A value's cell, with what it stands for in words where it stands for a form."""
    said = dict(forms).get(value, "")
    plain = cell.plain if isinstance(cell, NotedCell) else cell
    return NotedCell(cell, said, plain=plain) if said else cell


def refitted_table(content: Content, is_linear: bool = False) -> Table:
    """The base parameters that were re-estimated with the effects, before and after.

    `is_linear`: of a rig that slides. An actuator's are named as in the model, without units.
    """
    rows: list[tuple[Any, ...]] = []
    for entry in content["figures"].get("refitted") or []:
        value = float(entry["after"])
        unit = entry["unit"] or unit_of_field(entry["name"], is_linear=is_linear)
        after = Estimate(value, float(entry["std"]), unit, (math.nan, math.nan))
        # To the digit that the value after is written to.
        before = replace(after, value=float(entry["before"]))
        # Across 0 a change has no size in per cent.
        is_sized = value * before.value > 0.0
        change = number(100.0 * (value / before.value - 1.0), 2) if is_sized else MISSING
        cells = estimate_cells(after)
        name = entry["name"]
        title = title_of_field(name)
        if not title and own_of(content):
            title = capital(words_of(name, unit))
        shown = NotedCell(title, name) if title else name
        rows.append((shown, estimate_cells(before)[0], *cells[:2], change, cells[3]))
    columns = ("Parameter", "From", "To", "Standard error", "Change, %", "Unit")
    caption = "Parameters of the base model, estimated again"
    return table(caption, columns, rows, text=(len(columns) - 1,))


def errors_table(content: Content) -> Table:
    """Errors by channel, effect by effect, on the tests that the diagnosis is judged on."""
    rows = []
    for name, errors in errors_by_step(content).items():
        channel = channel_in(name, own_of(content))
        floor = content["residual"][name]["noise_floor"]
        unit_of, scale = error_unit(channel, is_alone=not is_of_actuator(content))
        cells = [
            NotedCell(text, plain=MISSING if math.isnan(e) else f"{e:.4g}")
            for e, text in (
                *((e, number(scale * e)) for e in errors),
                (floor, floor_text(scale * floor, scale * errors[-1])),
            )
        ]
        title = f"{channel.title} ({unit_of})" if unit_of else channel.title
        rows.append((NotedCell(title, plain=name), *cells))
    caption = f"RMSE on {judged_tests(content)}"
    if is_of_actuator(content):
        caption = "Open-loop RMSE over whole held-out tests"
    columns = ("Channel", "Original bundle", *step_names(content), CORRECT_MODEL)
    return table(caption, columns, rows)


def step_names(content: Content) -> list[str]:
    """What was done to the original bundle, the effects by their titles."""
    ids = [effect["id"] for effect in content["effects"]]
    added: list[str] = [NotedCell(f"+ {title_of(content, id)}", plain=f"+ {id}") for id in ids]
    return [*added, *steps(content)[len(added) :]]


def suspects_table(
    content: Content, caption: str, suspects: Sequence[tuple[int, Mapping[str, Any]]]
) -> Table:
    """Each suspect with the number of its round: what it explained, and its outcome."""
    reduction: tuple[str, ...] = ("Prediction error removed, %",)
    if is_of_actuator(content):
        reduction = ("Reduction", "Largest on a twin", "Refitted")
    rows = [
        (named(content, s["id"]), str(place), *_gains(s), short_p(s["p_value"]), s["fate"])
        for place, s in suspects
    ]
    columns = ("Suspect", "Round", *reduction, "p", "Outcome")
    return table(caption, columns, rows, text=(len(columns) - 1,))


def _gains(suspect: Mapping[str, Any]) -> tuple[str, ...]:
    """A suspect's reduction, on twins and refitted too, or its share of the prediction error."""
    if "twins" not in suspect:
        return (number(100.0 * suspect["gain"]),)
    return tuple(number(v) for v in (suspect["gain"], max(suspect["twins"]), suspect["refitted"]))


def remainder_table(content: Content) -> Table:
    """What the remaining residuals consist of, balance by balance."""
    rows = []
    for rest in content.get("remainder") or ():
        name, scale = balance_unit(rest["unit"], is_alone=not is_of_actuator(content))
        sizes = (
            NotedCell(number(scale * rest[k]), plain=number(rest[k]))
            for k in ("rmse", "repeatable", "scatter", "noise")
        )
        balance = balance_of(rest["channel"], own_of(content))
        rows.append((capital(balance), *sizes, NotedCell(name, plain=rest["unit"])))
    columns = ("Residual of", "RMSE", "Repeats", "Differs between tests", "Noise", "Unit")
    return table("Remainder after the effects; the squares add up", columns, rows, text=(5,))


__all__ = [
    "effects_table",
    "errors_table",
    "named",
    "parameters_table",
    "refitted_table",
    "remainder_table",
    "short_p",
    "step_names",
    "summary",
    "suspects_table",
    "title_of",
]
