"""From log files to a bundle: what `sysid fit` does, without the command line.

Each pipeline (friction, valves) turns trials into a result; here the files are read, the
rig is found, the results become a bundle's parts, and the bundle is written.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.bundle import Source, merge, new_bundle, read_bundle, write_bundle
from sysid.campaign import FRICTION_KINDS, Campaign, read_campaign
from sysid.errors import NotIdentifiedError, input_error
from sysid.friction import FrictionResult, fit_friction
from sysid.logs import Log, Trial, read_log
from sysid.rig import Rig, find_rig_file, read_rig
from sysid.units import parse_map


@dataclass(frozen=True)
class Fitted:
    """What a fit found: the bundle, what to say about it, and where it was written."""

    bundle: dict[str, Any]
    remarks: tuple[str, ...]
    notices: tuple[str, ...]
    written: Path | None = None

    def to_json(self) -> dict[str, Any]:
        """What `--json` prints: the bundle, the remarks and the file."""
        return {
            **self.bundle,
            "remarks": list(self.remarks),
            "notices": list(self.notices),
            "written": None if self.written is None else str(self.written),
        }


def read_logs(
    paths: Sequence[Path], rig_path: Path | None, maps: Sequence[str]
) -> tuple[Rig, list[Log]]:
    """The logs of one rig: `rig_path`, or the one rig file nearest to all of them."""
    files = {find_rig_file(p) for p in paths} if rig_path is None else {rig_path}
    if len(files) > 1:
        raise input_error(
            " and ".join(sorted(map(str, files))),
            "the logs belong to different rigs",
            "fit them one by one, or name one rig file with --rig",
        )
    rig = read_rig(files.pop())
    mapping = parse_map(maps)
    return rig, [read_log(path, rig, mapping) for path in paths]


def fit_friction_logs(
    paths: Sequence[Path],
    *,
    rig: Path | None = None,
    maps: Sequence[str] = (),
    kind: str | None = None,
    estimate_inertia: bool = False,
    cutoff_hz: float = 50.0,
    output: Path | None = None,
    into: Path | None = None,
) -> Fitted:
    """`sysid fit friction`: static, Coulomb and viscous friction from log files.

    Raises InputError (unusable files) or NotIdentifiedError (the tests cannot identify it).
    """
    the_rig, logs = read_logs(paths, rig, maps)
    existing = None if into is None else read_bundle(into)
    result = fit_friction(
        [t for log in logs for t in log.trials],
        the_rig,
        kind=None if kind is None else f"friction-{kind}",
        estimate_inertia=estimate_inertia,
        cutoff_hz=cutoff_hz,
    )
    part = new_bundle(
        the_rig,
        {"friction": result.to_json()},
        [Source(log, "fit", "friction") for log in logs],
        options={"friction": {"cutoff_hz": cutoff_hz, "kind": kind}},
    )
    notices = (*the_rig.notices, *(n for log in logs for n in log.notices), *result.notices)
    return _deliver(part, result.remarks, notices, output, into, existing)


def _deliver(
    part: dict[str, Any],
    remarks: Sequence[str],
    notices: Sequence[str],
    output: Path | None,
    into: Path | None,
    existing: dict[str, Any] | None,
) -> Fitted:
    """Write the part alone (`-o`), or added to the bundle that was read from `into`."""
    bundle = part
    if into is not None and existing is not None:
        bundle = merge(existing, part, into)
    target = output or into
    if target is not None:
        write_bundle(bundle, target)
    return Fitted(bundle, tuple(remarks), tuple(notices), target)


def fit_campaign(path: Path, output: Path | None) -> Fitted:
    """`sysid fit CAMPAIGN.toml`: every part that the campaign's fit logs can identify.

    A part whose tests the campaign lacks, or that they cannot identify, is left out of the
    bundle with a notice. Raises NotIdentifiedError where nothing at all can be fitted.
    """
    campaign = read_campaign(path)
    parts: dict[str, Any] = {}
    sources: list[Source] = []
    remarks: list[str] = []
    notices = [*campaign.notices, *campaign.rig.notices]
    for stage in _STAGES:
        try:
            stage(campaign, parts, sources, remarks, notices)
        except NotIdentifiedError as error:
            notices.append(str(error))
    if not parts:
        raise NotIdentifiedError(
            f'{path}: no fit log identifies anything; add friction or valve tests with use = "fit"'
        )
    bundle = new_bundle(campaign.rig, parts, sources)
    if output is not None:
        write_bundle(bundle, output)
    return Fitted(bundle, tuple(remarks), tuple(notices), output)


Stage = Callable[[Campaign, dict[str, Any], list[Source], list[str], list[str]], None]


def _friction_stage(
    campaign: Campaign,
    parts: dict[str, Any],
    sources: list[Source],
    remarks: list[str],
    notices: list[str],
) -> None:
    trials: list[tuple[str, Trial]] = []
    for entry in campaign.select(FRICTION_KINDS):
        log = campaign.read(entry)
        sources.append(Source(log, entry.use, entry.kind))
        notices += log.notices
        trials += [(entry.kind, t) for t in log.trials]
    if not trials:
        return
    result: FrictionResult = fit_friction(
        [t for _, t in trials], campaign.rig, kind=[kind for kind, _ in trials]
    )
    parts["friction"] = result.to_json()
    remarks += result.remarks
    notices += result.notices


_STAGES: tuple[Stage, ...] = (_friction_stage,)
