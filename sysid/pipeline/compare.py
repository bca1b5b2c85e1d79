"""Bundles compared with each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from sysid.blocks.sections import FigureGroup, Section
from sysid.blocks.tables import Table
from sysid.errors import grouped, together
from sysid.fleet.comparison import VALVES, Comparison, compare_bundles
from sysid.identification.valve_discrete.responses import Responses, valve_responses
from sysid.io.channels import SIDES
from sysid.io.files import write_atomic
from sysid.parameters import Bundle
from sysid.pipeline.request import require


def compare(*bundles: Bundle) -> Comparison:
    """Parameters of bundles side by side, and what moved against the first; or valve B against A.

    `moved` are the parameters that moved by more than the standard errors of both explain, the
    false discovery rate being 5 % over the whole comparison; `effects` says which appeared,
    disappeared, grew or shrank. `responses` draws the on/off valves over one another, each filling
    and emptying the first rig's chamber (thesis 3.2.1). One bundle: its valve B against its valve
    A. Raises InputError for one bundle without two valves, for rotary and linear rigs together, and
    for bundles that have no part in common.

    >>> si.write_bundle(bundle, "fitted.json")
    >>> si.compare(bundle, si.read_bundle("fitted.json")).moved
    ()
    """
    for bundle in bundles:
        require(bundle, "bundles", "Bundle")
    names = shown_names([bundle.source for bundle in bundles])
    found = compare_bundles(bundles, names)
    return replace(found, respond=partial(_responses, bundles, names))


def _responses(bundles: Sequence[Bundle], names: Sequence[str]) -> Responses | None:
    """Of every on/off valve of the bundles."""
    return valve_responses(
        [
            (said if len(bundles) == 1 else f"{name}, {said}", bundle, side)
            for name, bundle in zip(names, bundles, strict=True)
            for side, said in zip(SIDES, VALVES, strict=True)
        ]
    )


def write_comparison(path: Path, found: Comparison) -> None:
    """Write a comparison as one self-contained HTML page, whole or not at all.

    Raises InputError where that is not possible.
    """
    from sysid.blocks.html import fill

    numbers, moved, effects, *_ = found.tables()
    drawn = FigureGroup("", (found.figure(),)) if found.movements else None
    shown = tuple(one for one in (drawn, moved, effects, numbers) if one is not None)
    shown = tuple(one for one in shown if not isinstance(one, Table) or one.rows)
    sections = [Section("parameters", "Parameters", (), shown)]
    if isinstance(found.responses, Responses):
        intro = (
            "Each valve fills and empties the same chamber from the same supply by its own fitted "
            "law, with its own delays (thesis 3.2.1).",
        )
        # Across the page's one column: its curves have whole names of bundles.
        drawn_over = found.responses.blocks(size=(7.0, 2.6))
        sections.append(Section("responses", "Responses", intro, drawn_over))
    page = fill(
        "control.html",
        name=found.names[0],
        subject="comparison",
        facts=[("Compared", ", ".join(found.names))],
        level="fair" if found.moved else "good",
        sentence=f"{found.headline(is_titled=True)}.",
        metrics=None,
        notes=[f"Notice: {line}." for line in grouped(together(found.notices))],
        sections=sections,
    )
    write_atomic(path, page)


def shown_names(sources: Sequence[str]) -> list[str]:
    """Names that distinguish files: their own, with folders where needed, numbered if the same."""
    paths = {source: Path(source) for source in sources}
    short: dict[str, str] = {}
    for length in range(1, max((len(p.parts) for p in paths.values()), default=1) + 1):
        short = {source: "/".join(p.parts[-length:]) for source, p in paths.items()}
        if len(set(short.values())) == len(short):
            break
    seen: Counter[str] = Counter()
    names = []
    for source in sources:
        seen[source] += 1
        times = seen[source]
        names.append(short[source] if times == 1 else f"{short[source]} ({times})")
    return names


__all__ = ["compare", "shown_names", "write_comparison"]
