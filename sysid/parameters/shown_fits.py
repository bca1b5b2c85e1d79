"""How well each fitted law follows its own tests, and the verdict on it."""

from __future__ import annotations

from collections.abc import Collection
from functools import partial

from sysid.blocks.quality import quality_table
from sysid.blocks.sections import Block, Fold, Lines, Section
from sysid.estimation.quality import (
    GOOD_SHARE,
    LEAST_EXPLAINED,
    SCATTER_TIMES,
    SIGNIFICANT,
    USABLE_SHARE,
    WITH_LACK_OF_FIT,
)
from sysid.io.own_channels import balance_unit
from sysid.parameters import Bundle


def fits_section(bundle: Bundle, advised_against: Collection[str] = ()) -> Section | None:
    """The section on the judgements in the bundle; None where it holds none (an older file).

    Those at the places that are `advised_against` are folded.
    """
    judged = bundle.qualities()
    if not judged:
        return None
    intro = (
        "Each law against the tests that it was fitted to (PWM: held-out tests, where "
        "there are enough). The verdict depends on how much of the signal's spread the law misses "
        f"beyond the scatter of the measurement: good up to {100 * GOOD_SHARE:.0f} %, usable up to "
        f"{100 * USABLE_SHARE:.0f} %, else poor. A law that explains less than "
        f"{100 * LEAST_EXPLAINED:.0f} % of the signal's variance beyond its scatter, or has "
        "impossible parameters, is kept only where a missing effect may be the cause.",
        "Lack of fit is an F test against repeats where conditions were repeated, else the "
        "residual over the measurement's known scatter, else a test of the residual's runs. A "
        f"significant one (p < {SIGNIFICANT:g}, or more than {SCATTER_TIMES:g} times the scatter) "
        "shows that the law lacks something, which may be small. Such a fit is not called good: "
        f'"{WITH_LACK_OF_FIT}" misses less than {100 * GOOD_SHARE:.0f} % of the spread, though '
        "more than noise; what it misses is the diagnosis' question.",
    )
    # Friction first, then valve A, then B.
    ordered = dict(sorted(judged.items(), key=lambda item: _side(item[0])))
    main = {place: one for place, one in ordered.items() if place not in advised_against}
    others = {place: one for place, one in ordered.items() if place in advised_against}
    shown_in = partial(balance_unit, is_alone=bundle.rig.is_tank_alone)
    blocks: list[Block] = [quality_table(main or ordered, "Fits", shown_in)]
    if main and others:
        table = quality_table(others, "Fits of laws that are not recommended", shown_in)
        blocks.append(Fold("Laws that are not recommended", (table,)))
    blocks.append(Lines(intro, "What the verdicts mean"))
    return Section("fits", "How well the laws follow their tests", (), tuple(blocks))


def _side(place: str) -> str:
    """Sort key of the rows: friction first, then valve A, then B."""
    return place[: len("valves.a")] if place.startswith("valves.") else ""


__all__ = ["fits_section"]
