"""`sysid check`: what logs, or a campaign's logs, can be used for."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path, PurePath
from typing import Any

import click

from sysid.blocks.titles import use_word
from sysid.checks.campaign_check import CampaignCheck
from sysid.checks.log_check import LogCheck
from sysid.commands.options import (
    component_option,
    exclude_option,
    json_option,
    logs_argument,
    map_option,
    rig_option,
    verbose_option,
)
from sysid.commands.printing import (
    Printed,
    Strong,
    grouped_notices,
    notices,
    print_blocks,
    print_json,
    progress,
)
from sysid.errors import input_error
from sysid.io.logs import exclusions_for
from sysid.io.units import parse_map
from sysid.pipeline.check import check_campaign, check_file
from sysid.pipeline.files import read_with

# Lines of remarks, the first of the campaign's logs; all with -v.
_REMARKS = 12


@click.command()
@logs_argument
@rig_option
@map_option
@component_option
@exclude_option
@verbose_option
@json_option
def check(
    logs: Sequence[Path],
    rig: Path | None,
    maps: Sequence[str],
    component: str | None,
    exclude: Sequence[str],
    verbose: bool,
    as_json: bool,
) -> None:
    """Data quality of each LOG, and what it can and cannot identify.

    A campaign file in place of a LOG stands for all logs that it lists: whether they identify
    everything, by which of them, and in what they contradict one another or the rig file; -v shows
    each log.
    """
    checked: list[LogCheck | CampaignCheck] = []
    said: list[str] = []
    alone = [path for path in logs if path.suffix != ".toml"]
    mapping = parse_map(maps)
    given = exclusions_for(exclude, alone, mapping) if alone else []
    excluded = dict(zip(alone, given, strict=True))
    for path in logs:
        if path.suffix == ".toml":
            checked.append(_campaign_check(path, rig, maps, component, exclude, said))
        elif component is not None:
            fix = "give the campaign file that lists it"
            raise input_error(path, "is not a campaign file, which --component needs", fix)
        else:
            found, notices_of_rig = check_file(path, rig, mapping, excluded[path])
            checked.append(found)
            said += notices_of_rig
    if as_json:
        _tell(checked, said, all_of_them=True)
        print_json(_content(checked))
        return
    _tell(checked, said, all_of_them=verbose)
    for one in checked:
        print_blocks(_campaign(one, verbose) if isinstance(one, CampaignCheck) else _log(one))
        print_blocks([""])


def _campaign_check(
    path: Path,
    rig: Path | None,
    maps: Sequence[str],
    component: str | None,
    exclude: Sequence[str],
    said: list[str],
) -> CampaignCheck:
    """The check of a campaign; the reader's notices are added to `said`."""
    if rig is not None or maps:
        given = "--rig" if rig is not None else "--map"
        raise input_error(
            path, f"a campaign file names its own rig and maps, {given} is for logs", "omit it"
        )
    campaign = read_with(path, component, progress(), exclude)
    said += [*campaign.notices, *campaign.rig.notices]
    return check_campaign(campaign)


def _logs_of(checked: Iterable[LogCheck | CampaignCheck]) -> Iterator[LogCheck]:
    for one in checked:
        yield from one.logs if isinstance(one, CampaignCheck) else (one,)


def _content(checked: Sequence[LogCheck | CampaignCheck]) -> dict[str, Any]:
    """What `--json` prints: the answers, what campaigns identify, and each log."""
    campaigns = [c for c in checked if isinstance(c, CampaignCheck)]
    identifies = [{"campaign": c.path, **a.to_json()} for c in campaigns for a in c.answers]
    return {
        "answers": [one.answer for one in checked],
        **({"identifies": identifies} if campaigns else {}),
        "logs": [c.to_json() for c in _logs_of(checked)],
    }


# --- printing -----------------------------------------------------------------------------


def _tell(
    checked: Sequence[LogCheck | CampaignCheck], said: Sequence[str], *, all_of_them: bool
) -> None:
    """The notices on standard error; those alike as one, unless `all_of_them`."""
    lines = [*said, *(line for c in _logs_of(checked) for line in c.notices)]
    # A terminal that shows both streams has the contradictions under the answer.
    if not (sys.stdout.isatty() and sys.stderr.isatty()):
        notices(line for c in _logs_of(checked) for line in c.contradicts)
    (notices if all_of_them else grouped_notices)(lines)


def _campaign(check: CampaignCheck, verbose: bool) -> Iterator[Printed]:
    yield Strong(check.answer)
    yield from (f"- {line}" for line in check.contradictions)
    training, held = len(check.training), len(check.entries) - len(check.training)
    yield f"{check.path}: {training} training log{'s' * (training != 1)}, {held} held out"
    if not verbose:
        for one in check.logs:
            yield from (f"{PurePath(one.file).name}: {line}" for line in one.left_out())
    yield check.table()
    yield from _quality(check, verbose)
    if verbose:
        for one in check.logs:
            yield ""
            yield from _blocks(one)
    else:
        yield "-v shows each log: channels, noise, and what it identifies by itself"


def _quality(check: CampaignCheck, verbose: bool) -> Iterator[str]:
    """One line for each log whose quality is remarkable."""
    found = list(check.remarks())
    if not found:
        noise = "" if check.noise_pa is None else ", no noise beyond the rig file's"
        yield f"quality: no gaps, no sensor stuck or saturated{noise}"
        return
    shown = found if verbose else found[:_REMARKS]
    for entry, line in shown:
        held = " (held out)" if entry.use != "fit" else ""
        yield f"{entry.file}{held}: {line}"
    if len(found) > len(shown):
        yield f"... and {len(found) - len(shown)} more logs with remarks: -v shows them"


def _log(check: LogCheck) -> Iterator[Printed]:
    yield Strong(check.answer)
    yield from (f"- {line}" for line in check.contradicts)
    yield from _blocks(check)


def _blocks(check: LogCheck) -> Iterator[Printed]:
    yield Strong(check.file)
    if check.declared is not None:
        use = use_word(check.use or "fit", before_noun=True)
        yield f"in the campaign: {check.declared}, {use}"
    if check.by_row:
        yield check.extent
    else:
        jitter = "no jitter" if check.is_even else f"jitter {check.jitter_s:.2g} s"
        yield f"{check.extent} ({jitter})"
        longest = f"{check.gaps} gaps, the longest {check.longest_gap_s:.4g} s"
        yield longest if check.gaps else "no gaps"
    yield from check.left_out()
    channels, identifies = check.tables()
    yield channels
    yield from (f"excitation: {line}" for line in check.excitation)
    yield identifies
