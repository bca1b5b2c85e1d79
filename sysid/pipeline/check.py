"""How good a log is, and what it can identify."""

from __future__ import annotations

from collections.abc import Sequence

from sysid.checks.campaign_check import CampaignCheck, check_whole
from sysid.checks.log_check import LogCheck, check_log
from sysid.checks.log_check import check_campaign as check_logs
from sysid.components.loading import component_in
from sysid.io.campaign import Campaign
from sysid.io.rig import Rig
from sysid.io.samples import Log
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


def check_campaign(campaign: Campaign) -> CampaignCheck:
    """Every log of a campaign, and whether its training logs identify everything.

    Raises InputError for a log that cannot be read.
    """
    if component_in(campaign) is None:
        return check_whole(campaign)
    from sysid.components.log_check import check_own

    return check_own(campaign)


def checks_of(campaign: Campaign, *, by_content: bool = False) -> Sequence[LogCheck]:
    """What each log of a campaign is good for; errors as `check_campaign`.

    `by_content`: a log that no campaign declares may hold tests of several kinds.
    """
    if component_in(campaign) is None:
        return check_logs(campaign, by_content=by_content)
    return check_campaign(campaign).logs


__all__ = ["check", "check_campaign", "checks_of"]
