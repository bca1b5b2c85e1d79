"""`sysid fit`: log files in, a bundle out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sysid.assembly import PartResult, fit_campaign
from sysid.bundle.content import merge, new_bundle, read_bundle, write_bundle
from sysid.errors import input_error
from sysid.friction import fit_friction
from sysid.io.campaign import read_campaign
from sysid.io.logs import Log, Trial, read_log
from sysid.io.rig import Rig, find_rig_file, read_rig
from sysid.io.source import Source
from sysid.io.units import parse_map
from sysid.types import Progress, no_progress
from sysid.valve_discrete import fit_valve_discrete
from sysid.valve_pwm import fit_valve_pwm


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
    cutoff_hz: float | None = None,
    output: Path | None = None,
    into: Path | None = None,
) -> Fitted:
    """`sysid fit friction`: static, Coulomb and viscous friction from log files.

    Raises InputError (unusable files) or NotIdentifiedError (the tests cannot identify it).
    """
    return _fit_part(
        "friction",
        lambda trials, the_rig: fit_friction(
            trials, the_rig, kind=kind, estimate_inertia=estimate_inertia, cutoff_hz=cutoff_hz
        ),
        _Files(paths, rig, maps, output, into),
        options={"cutoff_hz": cutoff_hz, "kind": kind},
    )


def fit_valve_discrete_logs(
    paths: Sequence[Path],
    *,
    rig: Path | None = None,
    maps: Sequence[str] = (),
    valve: str | None = None,
    output: Path | None = None,
    into: Path | None = None,
) -> Fitted:
    """`sysid fit valve-discrete`: flows and delays of the on/off valves. Raises as friction."""
    return _fit_part(
        "valve-discrete",
        lambda trials, the_rig: fit_valve_discrete(trials, the_rig, valve=valve),
        _Files(paths, rig, maps, output, into),
        options={"valve": valve},
    )


def fit_valve_pwm_logs(
    paths: Sequence[Path],
    *,
    rig: Path | None = None,
    maps: Sequence[str] = (),
    valve: str | None = None,
    surface: str = "both",
    seed: int = 0,
    sweep: bool = False,
    output: Path | None = None,
    into: Path | None = None,
) -> Fitted:
    """`sysid fit valve-pwm`: surfaces of mean flow over duty and pressure. Raises as friction."""
    return _fit_part(
        "valve-pwm",
        lambda trials, the_rig: fit_valve_pwm(
            trials, the_rig, valve=valve, surface=surface, seed=seed, sweep=sweep
        ),
        _Files(paths, rig, maps, output, into),
        seeds={"valve-pwm": seed},
        options={"valve": valve, "surface": surface},
    )


@dataclass(frozen=True)
class _Files:
    """What a partial fit reads and writes."""

    paths: Sequence[Path]
    rig: Path | None
    maps: Sequence[str]
    output: Path | None
    into: Path | None


def _fit_part(
    kind: str,
    fit: Callable[[list[Trial], Rig], PartResult],
    files: _Files,
    *,
    seeds: Mapping[str, int] | None = None,
    options: Mapping[str, Any] | None = None,
) -> Fitted:
    """Read the logs, fit, and write the part alone (`-o`) or added to a bundle (`--into`)."""
    rig, logs = read_logs(files.paths, files.rig, files.maps)
    existing = None if files.into is None else read_bundle(files.into)
    result = fit([t for log in logs for t in log.trials], rig)
    key = "friction" if kind == "friction" else "valves"
    bundle = new_bundle(
        rig,
        {key: result.to_json()},
        [Source.of(log, "fit", kind) for log in logs],
        seeds=seeds,
        options={kind: options or {}},
    )
    if files.into is not None and existing is not None:
        bundle = merge(existing, bundle, files.into)
    target = files.output or files.into
    if target is not None:
        write_bundle(bundle, target)
    notices = (*rig.notices, *(n for log in logs for n in log.notices), *result.notices)
    return Fitted(bundle, tuple(result.remarks), notices, target)


def fit_campaign_file(
    path: Path,
    output: Path | None,
    *,
    surface: str = "both",
    seed: int = 0,
    progress: Progress = no_progress,
) -> Fitted:
    """`sysid fit CAMPAIGN.toml`: every part that the campaign's fit logs can identify.

    Raises InputError for unusable files and as `sysid.assembly.fit_campaign` does.
    """
    found = fit_campaign(read_campaign(path), surface=surface, seed=seed, progress=progress)
    if output is not None:
        write_bundle(found.bundle, output)
    return Fitted(found.bundle, found.remarks, found.notices, output)
