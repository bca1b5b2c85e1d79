"""Each notice of a fit under the numbers that it is about."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace

from sysid.blocks.sections import Block, Fold, Lines, Notes, Section
from sysid.io.campaign import FRICTION_KINDS, MOTION_KINDS, Campaign

_OTHERS = "fits"
_SECTIONS = {
    **dict.fromkeys(FRICTION_KINDS, "friction"),
    "valve-discrete": "valves",
    "valve-pwm": "surfaces",
    **dict.fromkeys(set(MOTION_KINDS) - set(FRICTION_KINDS), "validation"),
}
# A fit of on/off tests names its valve alone, one under PWM the direction too, or its law.
_ABOUT = (
    (re.compile(r"averaged law|PWM|^valve [AB], "), "surfaces"),
    (re.compile(r"^valve [AB]:|choked|valve"), "valves"),
    (re.compile(r"friction|coulomb|viscous|static|offset_n"), "friction"),
)
_MOST = 4


def by_section(notices: Sequence[str], campaign: Campaign) -> dict[str, list[str]]:
    """The notices of a campaign's fit by the id of the report's section that they belong to.

    By the log that one names, else by the parameter; files without their folder.
    """
    found: dict[str, list[str]] = {}
    for line in dict.fromkeys(notices):
        said = line
        for entry in campaign.logs:
            said = said.replace(str(entry.path), entry.path.name)
        found.setdefault(_section_of(said, campaign), []).append(said)
    return found


def _section_of(line: str, campaign: Campaign) -> str:
    for entry in campaign.logs:
        if entry.path.name in line and entry.kind in _SECTIONS:
            return _SECTIONS[entry.kind]
    return next((section for about, section in _ABOUT if about.search(line)), _OTHERS)


def excluded_lines(campaign: Campaign) -> Iterator[str]:
    """What the campaign excludes, in a line of the first screen; none where it excludes nothing."""
    counts = {entry.path.name: len(entry.exclude) for entry in campaign.logs if entry.exclude}
    if counts:
        listed = "; ".join(f"{name}: {count}" for name, count in counts.items())
        yield f"Tests and spans excluded by the campaign, with reasons in Data: {listed}."


def with_notices(section: Section, notices: Sequence[str]) -> Section:
    """The section with the notices that it does not say already, the first of them in sight."""
    known = set(map(_without_numbers, _said(section.blocks)))
    new = tuple(line for line in notices if _without_numbers(line) not in known)
    if not new:
        return section
    shown: list[Block] = [Notes(new[:_MOST])]
    if len(new) > _MOST:
        shown.append(Lines(new[_MOST:], "Further notices of this fit"))
    return replace(section, blocks=(*shown, *section.blocks))


def _without_numbers(line: str) -> str:
    return re.sub(r"[-\d.]+", "", line)


def _said(blocks: Sequence[Block]) -> Iterator[str]:
    for block in blocks:
        if isinstance(block, Lines | Notes):
            yield from block.lines
        elif isinstance(block, Fold):
            yield from _said(block.blocks)


__all__ = ["by_section", "excluded_lines", "with_notices"]
