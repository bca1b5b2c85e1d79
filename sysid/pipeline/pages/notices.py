"""Each notice of a fit under the numbers that it is about."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

from sysid.blocks.sections import Block, Fold, Lines, Notes, Section
from sysid.errors import subject_of
from sysid.io.campaign import BENCH_KINDS, FRICTION_KINDS, MOTION_KINDS, Campaign
from sysid.io.channels import SIDES

_OTHERS = "data"
# By the kind of a log, and by what a place in a bundle begins with.
_SECTIONS = {
    **dict.fromkeys(FRICTION_KINDS, "friction"),
    "valve-discrete": "valves",
    "valve-pwm": "surfaces",
    **dict.fromkeys(set(MOTION_KINDS) - set(FRICTION_KINDS), "validation"),
    **dict.fromkeys(BENCH_KINDS, "part"),
    "friction": "friction",
    **{f"valves.{side}.discrete": "valves" for side in SIDES},
    **{f"valves.{side}.pwm": "surfaces" for side in SIDES},
}
_MOST_SHOWN = 4
_OF_TESTS = re.compile(r"([^:,]+), tests (\d+(?:, \d+)+): (.+)")


def by_section(
    notices: Sequence[str], campaign: Campaign, present: Collection[str]
) -> dict[str, list[str]]:
    """The notices of a campaign's fit by the id of the report's section that they belong to.

    By what each is about; those whose section is not among the `present` ones are with the data.
    Files without their folder.
    """
    found: dict[str, list[str]] = {}
    for line in dict.fromkeys(notices):
        said = line
        for entry in campaign.logs:
            said = said.replace(str(entry.path), entry.path.name)
        section = section_of(subject_of(line))
        found.setdefault(section if section in present else _OTHERS, []).append(said)
    return found


def section_of(subject: str) -> str:
    """The section on a subject: a kind of log, or a place in a bundle or one within it."""
    while subject not in _SECTIONS:
        subject, _, within = subject.rpartition(".")
        if not within:
            return _OTHERS
    return _SECTIONS[subject]


def excluded_lines(campaign: Campaign) -> Iterator[str]:
    """What the campaign excludes, in a line of the first screen; none where it excludes nothing."""
    counts = {entry.path.name: len(entry.exclude) for entry in campaign.logs if entry.exclude}
    if counts:
        listed = "; ".join(f"{name}: {count}" for name, count in counts.items())
        yield f"Tests and spans excluded by the campaign, with reasons in Data: {listed}."


def with_notices(section: Section, notices: Sequence[str], *, is_first: bool = True) -> Section:
    """The section with the notices that it does not say already, the first of them in sight.

    `is_first`: the section's numbers are those of this fit, not estimated again since.
    """
    known = set(map(_without_numbers, (*section.intro, *_said(section.blocks))))
    new = tuple(line for line in notices if _without_numbers(line) not in known)
    if not new:
        return section
    shown: list[Block] = []
    if not is_first and section.id == "friction":
        shown.append(Lines(("Of the fit to these tests alone, before effects and refinement:",)))
    new = _together(new)
    shown.append(Notes(new[:_MOST_SHOWN]))
    if len(new) > _MOST_SHOWN:
        shown.append(Lines(new[_MOST_SHOWN:], "Further notices of this fit"))
    return replace(section, blocks=(*shown, *section.blocks))


def _together(lines: Sequence[str]) -> tuple[str, ...]:
    """What is said of several valves, or of tests of several logs, as one line, at the place of
    the first."""
    found: dict[str, list[str]] = {}
    for line in lines:
        of_tests = _OF_TESTS.match(line)
        if of_tests is None:
            subject, said = line.split(": ", 1) if ": " in line else ("", line)
        else:
            log, tests, said = of_tests.groups()
            subject = f"{log}, tests {_runs(tests.split(', '))}"
        found.setdefault(said, []).append(subject)
    return tuple(
        f"{'; '.join(sorted(own))}: {said}" if any(own) else said for said, own in found.items()
    )


def _runs(labels: Sequence[str]) -> str:
    """Tests by their numbers, runs of at least three as "45 to 50"."""
    found: list[list[int]] = []
    for number in map(int, labels):
        if found and number == found[-1][-1] + 1:
            found[-1].append(number)
        else:
            found.append([number])
    parts = ([f"{run[0]} to {run[-1]}"] if len(run) > 2 else list(map(str, run)) for run in found)
    return ", ".join(part for own in parts for part in own)


def _without_numbers(line: str) -> str:
    return re.sub(r"[-\d.]+", "", line)


def notices_in(sections: Sequence[Section]) -> frozenset[str]:
    """Every line that the sections' lists say."""
    return frozenset(line for section in sections for line in _said(section.blocks))


def _said(blocks: Sequence[Block]) -> Iterator[str]:
    for block in blocks:
        if isinstance(block, Lines | Notes):
            yield from block.lines
        elif isinstance(block, Fold):
            yield from _said(block.blocks)


__all__ = ["by_section", "excluded_lines", "notices_in", "section_of", "with_notices"]
