"""How good a log is, and what it can identify."""

from __future__ import annotations

from sysid.checks.log_check import LogCheck, check_log
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


__all__ = ["check"]
