"""Each campaign of a fleet under the monitor of its rig's first: has the rig drifted since?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from sysid import parallel
from sysid.errors import Failure
from sysid.fleet.rows import FleetRow
from sysid.io.campaign import MOTION_KINDS, read_campaign
from sysid.parameters import read_bundle
from sysid.pipeline.monitor import MonitorOptions, monitor
from sysid.pipeline.run import BUNDLE_FILE
from sysid.plant.effects.catalogue import EffectSource
from sysid.types import Progress, no_progress


def with_alarms(
    rows: Sequence[FleetRow],
    folder: Path,
    effects: EffectSource = None,
    progress: Progress = no_progress,
) -> list[FleetRow]:
    """The rows with the kind of drift that a monitor of the rig's first campaign alarms for, on the
    motion logs of each later one; as they were where that bundle or these logs allow no monitor.
    """
    first: dict[str, FleetRow] = {}
    jobs = {}
    for row in sorted((r for r in rows if r.origin and not r.failure), key=_when):
        assert row.origin is not None
        before = first.setdefault(row.origin.rig, row)
        if before is not row:
            bundle = folder / before.folder / BUNDLE_FILE
            jobs[row.folder] = partial(_alarm, bundle, Path(row.campaign), effects)
    if jobs:
        progress("monitoring")
    found = dict(zip(jobs, parallel.attempt_all(list(jobs.values())), strict=True))
    alarms = {name: said for name, said in found.items() if not isinstance(said, Failure)}
    return [replace(row, alarm=alarms.get(row.folder)) for row in rows]


def _when(row: FleetRow) -> tuple[str, str]:
    return (row.origin.date.isoformat() if row.origin else "", row.campaign)


def _alarm(bundle: Path, path: Path, effects: EffectSource) -> str | None:
    """What the monitor says last; "" for no alarm, None where there is no log of motion."""
    campaign = read_campaign(path)
    logs = campaign.select(MOTION_KINDS)
    if not logs:
        return None
    trials = [trial for entry in logs for trial in campaign.read(entry).trials]
    return monitor(trials, read_bundle(bundle), MonitorOptions(effects=effects)).alarm_in_words


__all__ = ["with_alarms"]
