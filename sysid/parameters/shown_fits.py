"""How well each fitted law follows its own tests, and the verdict on it."""

from __future__ import annotations

from sysid.blocks.quality import quality_table
from sysid.blocks.sections import Section
from sysid.estimation.quality import GOOD_SHARE, LEAST_EXPLAINED, USABLE_SHARE
from sysid.parameters import Bundle


def fits_section(bundle: Bundle) -> Section | None:
    """The section on the judgements in the bundle; None where it holds none (an older file)."""
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
        "significant one shows that the law lacks something, which may be small.",
    )
    # Friction first, then valve A, then B.
    ordered = dict(sorted(judged.items(), key=lambda item: _side(item[0])))
    blocks = (quality_table(ordered, "Fits"),)
    return Section("fits", "How well the laws follow their tests", intro, blocks)


def _side(place: str) -> str:
    """Sort key of the rows: friction first, then valve A, then B."""
    return place[: len("valves.a")] if place.startswith("valves.") else ""


__all__ = ["fits_section"]
