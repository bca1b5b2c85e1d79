"""What limits a verdict: its colour is that of the worst finding on the model it recommends."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sysid.blocks.quality import quality_name
from sysid.blocks.titles import within
from sysid.diagnosis.wording import above_noise, joined, own_of
from sysid.io.own_channels import channel_in
from sysid.parameters import Bundle
from sysid.parameters.titles import title_of

LEVELS = ("good", "fair", "poor")
"""Colours of a verdict, from the best to the worst."""
WELL, ROUGHLY = 90.0, 70.0
"""Least fit percentages over whole open-loop tests of a good and of a fair level."""
_MOST_NAMED = 5


@dataclass(frozen=True)
class Concern:
    """One thing below a verdict: its `level`, and its name where it is worse than good."""

    level: str
    name: str


def level_of_fit(fit: float) -> str:
    """The level of a fit percentage over whole open-loop tests."""
    return "good" if fit >= WELL else "fair" if fit >= ROUGHLY else "poor"


def worst(levels: Iterable[str]) -> str:
    """The worst of several levels; "none" where nothing is judged."""
    known = [LEVELS.index(level) for level in levels if level in LEVELS]
    return LEVELS[max(known)] if known else "none"


def advised_against(bundle: Bundle) -> set[str]:
    """The places in a bundle of laws that the page advises against: no model to trust uses them."""
    if bundle.valves is None:
        return set()
    from sysid.identification.valve_pwm.choice import not_recommended

    sides = bundle.valves.sides()
    return {place for side, valve in sides.items() for place in not_recommended(valve, side)}


def of_bundle(bundle: Bundle, unidentified: Sequence[str]) -> Iterator[Concern]:
    """Every law that is recommended by the verdict on its own fit, and what no data identify."""
    left_out = advised_against(bundle)
    for place, one in bundle.qualities().items():
        if place in left_out:
            continue
        level = "poor" if one.is_doubtful else "good" if one.misses_little else "fair"
        yield Concern(level, f"the fit of {within(quality_name(place))}")
    if unidentified:
        titles = [within(title_of(name)) for name in unidentified[:_MOST_NAMED]]
        more = len(unidentified) - len(titles)
        listed = joined([*titles, f"{more} more"] if more else titles)
        yield Concern("fair", f"{listed} not identified")


def of_diagnosis(diagnosis: Mapping[str, Any] | None) -> Iterator[Concern]:
    """The open questions of a diagnosis; none without a diagnosis."""
    found = (diagnosis or {}).get("verdict")
    if found is None or diagnosis is None:
        return
    if found == "unexplained":
        is_far_off = diagnosis.get("because") == "held-out errors"
        yield Concern("poor" if is_far_off else "fair", "the diagnosis, unexplained")
    elif found == "incomplete":
        yield Concern("fair", "the diagnosis, incomplete")
    else:
        yield Concern("good", "the diagnosis")
    for name, times in above_noise(diagnosis):
        channel = channel_in(name, own_of(diagnosis))
        yield Concern("fair", f"errors of {channel.name} {times:.0f} times the noise")


def sentence(level: str, concerns: Sequence[Concern], own: str) -> str:
    """Why the colour is worse than the sentence's `own` level; empty where it is not."""
    if level == own or level not in LEVELS[1:]:
        return ""
    names = list(dict.fromkeys(c.name for c in concerns if c.level == level))
    more = len(names) - _MOST_NAMED
    listed = "; ".join(names[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")
    rated = "" if own == "none" else "That rates how much of the signal is followed. "
    return (
        f"{rated}The colour is that of the worst part of the recommended model ({level}): {listed}."
    )


__all__ = [
    "LEVELS",
    "ROUGHLY",
    "WELL",
    "Concern",
    "advised_against",
    "level_of_fit",
    "of_bundle",
    "of_diagnosis",
    "sentence",
    "worst",
]
