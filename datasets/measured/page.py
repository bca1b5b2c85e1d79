"""The page of the measured sets: what each lacked, errors before and after, the remainder.

It uses the frame, style, tables and figures of a campaign's report
(`sysid.blocks`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from datasets.measured import figures
from datasets.measured.findings import (
    COLUMNS,
    Errors,
    agreement,
    error_cells,
    errors_of,
    found_text,
    mains,
    overview,
    remains_text,
    repeats_of,
)
from sysid.blocks import svg
from sysid.blocks.html import fill
from sysid.blocks.numbers import MISSING, estimate_cells, number
from sysid.blocks.sections import Block, FigureGroup, Heading, Lines, Section
from sysid.blocks.tables import NotedCell, table
from sysid.diagnosis.tables import short_p
from sysid.diagnosis.wording import joined, parameter_rows, regressor_name
from sysid.estimation.linear import Estimate
from sysid.io.files import write_atomic
from sysid.parameters.table import in_words_of
from sysid.parameters.titles import named

Content = Mapping[str, Any]

_TEMPLATE = Path(__file__).with_name("page.html")
# Curves drawn per campaign.
_MOST_CURVES = 6


def write_page(path: Path, results: Content) -> None:
    """Write the page of the results of `run_sets`: one self-contained file, whole or not at all.

    Raises InputError where the file cannot be written.
    """
    write_atomic(path, render_page(results))


def render_page(results: Content) -> str:
    """The page of `write_page` as text."""
    with svg.styled():
        sections = [_section(measured) for measured in results["sets"]]
    summary = table(
        "The campaigns fitted and diagnosed, with the errors on held-out recordings (SI units)",
        ("Set", "Found", "RMSE of", "Before", "After", "Correct model", "Remains"),
        [_on_page(row) for row in overview(results)],
        text=(1, 2, 6),
    )
    return fill(
        _TEMPLATE.name,
        folder=_TEMPLATE.parent,
        summary=summary,
        sections=sections,
        sentence=_sentence(results),
        level=_level(results),
    )


def _on_page(row: Sequence[str]) -> tuple[str, ...]:
    """A row of the overview with its ratios beneath what they are of.

    The base model stands in each section.
    """
    cells = dict(zip(COLUMNS, row, strict=True))
    down, times = cells["Down by"], cells["After / correct"]
    after = NotedCell(cells["After"], "" if down == MISSING else f"down by {down}")
    correct = NotedCell(cells["Correct model"], "" if times == MISSING else f"after: {times} times")
    of = cells["Held-out RMSE of"]
    unit = figures.unit_of(of)
    judged = of if of == MISSING else NotedCell(figures.title_of(of), unit)
    return (cells["Set"], cells["Found"], judged, cells["Before"], after, correct, cells["Remains"])


def _sentence(results: Content) -> str:
    """How many sets and campaigns ran, and their outcome."""
    campaigns = [c for measured in results["sets"] for c in measured["campaigns"]]
    verdicts: dict[str, int] = {}
    for campaign in campaigns:
        verdict = "failed" if campaign["diagnosis"] is None else campaign["diagnosis"]["verdict"]
        verdicts[verdict] = verdicts.get(verdict, 0) + 1
    broken = [m["name"] for m in results["sets"] if m["problem"] is not None]
    counts = joined([f"{count} {verdict}" for verdict, count in sorted(verdicts.items())])
    text = f"{_count(len(results['sets']), 'set')}, {_count(len(campaigns), 'campaign')}"
    text += f": {counts}." if counts else "."
    return text + (f" Not run: {joined(broken)}." if broken else "")


def _count(number_of: int, word: str) -> str:
    return f"{number_of} {word}{'' if number_of == 1 else 's'}"


def _level(results: Content) -> str:
    parts = [e for m in results["sets"] for e in (m, *m["campaigns"])]
    return "poor" if any(e["problem"] is not None for e in parts) else "none"


# --- a set ------------------------------------------------------------------------------


def _section(measured: Content) -> Section:
    name = str(measured["name"])
    if "question" not in measured:  # its set.toml could not be read
        return Section(_id(name), name, (f"Failed: {measured['problem']}",))
    intro = [
        str(measured["question"]),
        f"Recorded by: {measured['source']}. Licence: {measured['licence']}.",
    ]
    if measured["problem"] is not None:
        intro.append(f"Failed: {measured['problem']}")
    blocks: list[Block] = list(_bars(measured))
    for main in mains(measured):
        blocks += _campaign_blocks(measured, main)
    if measured["notices"]:
        blocks.append(Lines(tuple(measured["notices"]), "Notices"))
    return Section(_id(name), str(measured["title"]), tuple(intro), tuple(blocks))


def _id(name: str) -> str:
    """An id unique to the set: letters, digits and dashes."""
    return "set-" + "".join(c if c.isascii() and c.isalnum() else "-" for c in name)


def _place(measured: Content, campaign: Content) -> int:
    """A campaign's number in its set, from 1."""
    return 1 + [c["file"] for c in measured["campaigns"]].index(campaign["file"])


def _named(measured: Content, campaign: Content) -> str:
    return f"{_place(measured, campaign)}: {campaign['name']}"


def _campaign_blocks(measured: Content, main: Content) -> list[Block]:
    id = f"{_id(measured['name'])}-{_place(measured, main)}"
    blocks: list[Block] = [Heading(id, f"Campaign {_named(measured, main)}")]
    diagnosis = main["diagnosis"]
    if diagnosis is None:
        blocks.append(Lines((f"Failed: {main['problem']}",)))
    else:
        blocks.append(Lines((_verdict_line(diagnosis),)))
    if main["law"]:
        blocks.append(_law_table(main["law"]))
    if diagnosis is not None:
        blocks += _diagnosis_blocks(main, diagnosis)
        blocks += _curves(main, id)
    blocks += _repeat_blocks(measured, main)
    if diagnosis is not None and diagnosis.get("notices"):
        blocks.append(Lines(tuple(diagnosis["notices"]), "Notices of the diagnosis"))
    return blocks


def _verdict_line(diagnosis: Content) -> str:
    return (
        f"Verdict: {diagnosis['verdict']}. Found: {found_text(diagnosis)}. "
        f"Remains: {remains_text(diagnosis)}."
    )


def _law_table(law: Mapping[str, Content]) -> Block:
    rows = [
        (named(name), *estimate_cells(in_words_of(Estimate.from_json(e))))
        for name, e in law.items()
    ]
    columns = ("Parameter", "Value", "Standard error", "95 % interval", "Unit")
    return table("Base law, as fitted before any effect was added", columns, rows, text=(4,))


def _diagnosis_blocks(main: Content, diagnosis: Content) -> list[Block]:
    blocks: list[Block] = []
    if diagnosis["effects"]:
        blocks.append(_effects_table(diagnosis))
    errors = errors_of(main)
    if errors:
        caption = "RMSE on the held-out recordings, in each channel's SI unit"
        heads = ("Channel", "Before", "After", "Correct model", "After / correct", "Down by")
        cells = [
            (NotedCell(figures.title_of(n), n), *sizes) for n, *sizes in map(error_cells, errors)
        ]
        blocks.append(table(caption, heads, cells))
    if diagnosis["unexplained"]:
        rows = [
            (
                figures.title_of(e["channel"]),
                regressor_name(e["regressor"]),
                f"{number(100.0 * e['share'], 2)} %",
            )
            for e in diagnosis["unexplained"]
        ]
        columns = ("Channel", "Follows most", "Share of the residual's variance")
        blocks.append(table("Unexplained remainder", columns, rows, text=(1,)))
    return blocks


def _effects_table(diagnosis: Content) -> Block:
    rows = []
    for effect in diagnosis["effects"]:
        p = effect.get("p_value")
        whole = (
            MISSING if p is None else short_p(p),
            joined(effect["ambiguous_with"], "or") or MISSING,
        )
        head = effect["id"]
        for name, estimate in parameter_rows(effect):
            cells = (
                (estimate, MISSING, MISSING, "")
                if isinstance(estimate, str)
                else estimate_cells(estimate)
            )
            rows.append((head, name, *cells, *whole))
            head, whole = "", ("", "")
    columns = (
        "Effect",
        "Parameter",
        "Value",
        "Standard error",
        "95 % interval",
        "Unit",
        "p",
        "Indistinguishable from",
    )
    return table("Effects added, in this order", columns, rows, text=(1, 5, 7))


# --- pictures ---------------------------------------------------------------------------


def _bars(measured: Content) -> list[Block]:
    """The errors of a set's campaigns without the repeats, one figure per channel."""
    errors: dict[str, dict[int, Errors]] = {}
    for campaign in mains(measured):
        for error in errors_of(campaign):
            errors.setdefault(error.channel, {})[_place(measured, campaign)] = error
    if not errors:
        return []
    drawn = tuple(
        figures.bars(f"{_id(measured['name'])}-bars-{i}", places)
        for i, places in enumerate(errors.values(), start=1)
    )
    names = "; ".join(_named(measured, campaign) for campaign in mains(measured))
    return [FigureGroup(f"RMSE on the held-out recordings. Campaign {names}.", drawn)]


def _curves(main: Content, id: str) -> list[Block]:
    """The mean residual over possible regressors, if the diagnosis gives it."""
    curves = main["diagnosis"].get("curves") or []
    if not curves:
        return []
    panels = tuple(
        figures.curve(f"{id}-curve-{place}", content)
        for place, content in enumerate(curves[:_MOST_CURVES], start=1)
    )
    caption = "Mean residual over possible regressors, before and after."
    return [FigureGroup(caption, panels)]


# --- repeats ----------------------------------------------------------------------------


def _repeat_blocks(measured: Content, main: Content) -> list[Block]:
    repeats = repeats_of(measured, main)
    if not repeats:
        return []
    rows = [(_named(measured, c), *_repeat_row(c)) for c in (main, *repeats)]
    columns = (
        "Campaign",
        "Verdict",
        "Found",
        "RMSE of",
        "Before",
        "After",
        "Correct model",
        "After / correct",
        "Down by",
    )
    caption = "Does the verdict repeat? The campaign and its repeats"
    blocks: list[Block] = [table(caption, columns, rows, text=(1, 2, 3))]
    answer = agreement(measured, main)
    if answer is not None:
        counted = (
            " An effect indistinguishable from it in a repeat's recordings, or in the campaign's, "
            "counts as the same."
        )
        blocks.append(Lines((answer.sentence + counted,)))
    return blocks


def _repeat_row(campaign: Content) -> Sequence[str]:
    diagnosis, blank = campaign["diagnosis"], (MISSING,) * 6
    if diagnosis is None:
        return ("failed", str(campaign["problem"]), *blank)
    errors = errors_of(campaign)
    cells = error_cells(errors[0]) if errors else blank
    return (diagnosis["verdict"], found_text(diagnosis), *cells)


__all__ = ["render_page", "write_page"]
