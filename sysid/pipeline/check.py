"""The quality of a log, and what it can identify."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from sysid.checks.campaign_check import Answer, CampaignCheck, check_whole
from sysid.checks.identifiability import readable
from sysid.checks.log_check import CheckedLog, LogCheck, check_entry, check_log, listed
from sysid.checks.log_check import check_campaign as check_logs
from sysid.io.bare_rig import read_bare_logs
from sysid.io.campaign import Campaign
from sysid.io.exclusion import Exclusion
from sysid.io.logs import read_log
from sysid.io.rig import Rig, find_rig_file, read_rig
from sysid.io.samples import Log
from sysid.io.tables import require_log
from sysid.io.units import ColumnMap
from sysid.pipeline.given_tests import rig_of


def check(log: Log, rig: Rig | None = None) -> LogCheck:
    """A log's data quality, and which parameters it can and cannot identify.

    `rig` None: that of the log. Noise and resolution are in each channel's unit, times in s.

    >>> checked = si.check(log)
    >>> [item.parameter for item in checked.identifies if item.identified][0]
    'static friction'
    >>> [si.check(campaign.read(entry)).gaps for entry in campaign.logs[:2]]
    [0, 0]
    """
    return check_log(log, rig_of(log, rig))


def check_file(
    path: Path, rig: Path | None, mapping: Mapping[str, ColumnMap], exclude: Sequence[Exclusion]
) -> tuple[LogCheck, tuple[str, ...]]:
    """The check of one log in a file, and notices of what is assumed of its rig.

    `rig` None: the nearest rig file; without one by what the log shows and the reference rig.
    `exclude`: what is not read. Raises InputError for files that cannot be used.
    """
    rig_file = rig or find_rig_file(path)
    require_log(path)
    if rig_file is not None:
        known = read_rig(rig_file)
        log = read_log(path, known, mapping, None, exclude, readings=True)
        return check_log(log, known), ()
    bare = read_bare_logs([path], mapping, exclude=[exclude], readings=True)
    assumed = (
        f"{path}: no rig file: {', '.join(bare.rig.assumed)} are assumed, as on the reference rig "
        f"(`sysid init --from {path.name} rig.toml` writes one to correct)"
    )
    found, said = check_log(bare.logs[0], bare.read_with), bare.rig.said
    found = replace(
        found,
        identifies=tuple(replace(i, reason=said(i.reason)) for i in found.identifies),
        notices=tuple(map(said, found.notices)),
        contradicts=tuple(map(said, found.contradicts)),
    )
    return found, (assumed, *bare.notices)


def check_campaign(
    campaign: Campaign,
    logs: Sequence[Log] | None = None,
    checked: Sequence[CheckedLog] | None = None,
) -> CampaignCheck:
    """Every log of a campaign, and whether its training logs identify everything.

    `logs` are the campaign's, `checked` what `check_entry` gave for them, where these were read and
    checked before. Raises InputError for a log that cannot be read.
    """
    if not _is_own(campaign):
        return check_whole(campaign, logs, checked)
    from sysid.components.log_check import check_own

    return check_own(campaign)


def checks_of(campaign: Campaign, *, by_content: bool = False) -> Sequence[LogCheck]:
    """What each log of a campaign can be used for; errors as `check_campaign`.

    `by_content`: a log that no campaign declares may hold tests of several kinds.
    """
    if not _is_own(campaign):
        return check_logs(campaign, by_content=by_content)
    return check_campaign(campaign).logs


def _is_own(campaign: Campaign) -> bool:
    """Whether a campaign was read with a component of the user's own."""
    if campaign.own is None:
        return False
    from sysid.components.loading import component_in

    return component_in(campaign) is not None


__all__ = [
    "Answer",
    "CampaignCheck",
    "CheckedLog",
    "LogCheck",
    "check",
    "check_campaign",
    "check_entry",
    "check_file",
    "checks_of",
    "listed",
    "readable",
]
