"""From log files to a bundle: what `sysid fit` does, without the command line.

Each pipeline (friction, valves) turns trials into a result; here the files are read, the
rig is found, the results become a bundle's parts, and the bundle is written.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from sysid.bundle import Source, merge, merge_valves, new_bundle, read_bundle, write_bundle
from sysid.campaign import (
    BENCH_KINDS,
    FRICTION_KINDS,
    MOTION_KINDS,
    Campaign,
    CampaignLog,
    read_campaign,
)
from sysid.errors import NotIdentifiedError, input_error
from sysid.friction import fit_friction
from sysid.logs import Log, Trial, read_log
from sysid.rig import Rig, find_rig_file, read_rig
from sysid.units import parse_map
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


class _Result(Protocol):
    """What every pipeline returns."""

    @property
    def remarks(self) -> tuple[str, ...]: ...

    @property
    def notices(self) -> tuple[str, ...]: ...

    def to_json(self) -> dict[str, Any]: ...


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
    fit: Callable[[list[Trial], Rig], _Result],
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


@dataclass
class _Assembly:
    """A campaign's bundle while its parts come in."""

    campaign: Campaign
    progress: Callable[[str], None]
    parts: dict[str, Any] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
    notices: list[str] = field(default_factory=list)

    def read(self, entries: Sequence[CampaignLog]) -> list[Trial]:
        """All trials of these entries."""
        trials: list[Trial] = []
        for entry in entries:
            log = self.campaign.read(entry)
            self.notices += log.notices
            trials += log.trials
        return trials

    def add(self, name: str, fit: Callable[[], _Result]) -> dict[str, Any]:
        """A pipeline's part; empty, with a notice, where the tests do not identify it."""
        self.progress(name)
        try:
            result = fit()
        except NotIdentifiedError as error:
            self.notices.append(str(error))
            return {}
        self.remarks += result.remarks
        self.notices += result.notices
        return result.to_json()


def fit_campaign(
    path: Path,
    output: Path | None,
    *,
    surface: str = "both",
    seed: int = 0,
    progress: Callable[[str], None] = lambda stage: None,
) -> Fitted:
    """`sysid fit CAMPAIGN.toml`: every part that the campaign's fit logs can identify.

    A part whose tests the campaign lacks, or that they cannot identify, is left out of the
    bundle with a notice. Raises NotIdentifiedError where nothing at all can be fitted.
    `progress` is told the name of each part as its fit begins.
    """
    campaign = read_campaign(path)
    assembly = _Assembly(campaign, progress)
    assembly.notices += [*campaign.notices, *campaign.rig.notices]
    _add_friction(assembly)
    _add_valves(assembly, surface, seed)
    _add_bench(assembly)
    if not assembly.parts:
        raise NotIdentifiedError(
            f'{path}: no fit log identifies anything; add friction or valve tests with use = "fit"'
        )
    bundle = new_bundle(
        campaign.rig,
        assembly.parts,
        # On motion logs only a diagnosis fits.
        [s for s in campaign.sources() if s.use == "holdout" or s.kind not in MOTION_KINDS],
        seeds={"valve-pwm": seed},
        options={"valve-pwm": {"surface": surface}},
    )
    if output is not None:
        write_bundle(bundle, output)
    return Fitted(bundle, tuple(assembly.remarks), tuple(assembly.notices), output)


def _add_friction(assembly: _Assembly) -> None:
    entries = assembly.campaign.select(FRICTION_KINDS)
    if not entries:
        return
    trials: list[Trial] = []
    kinds: list[str] = []
    for entry in entries:
        own = assembly.read([entry])
        trials += own
        kinds += [entry.kind] * len(own)
    rig = assembly.campaign.rig
    part = assembly.add("friction", lambda: fit_friction(trials, rig, kind=kinds))
    if part:
        assembly.parts["friction"] = part


@dataclass(frozen=True)
class _BenchFit:
    """The law of a part on a bench, as a pipeline returns it."""

    part: dict[str, Any]
    remarks: tuple[str, ...] = ()
    notices: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        return self.part


def _add_bench(assembly: _Assembly) -> None:
    """The law of a tank or a valve that was tested alone."""
    for kind in BENCH_KINDS:
        entries = assembly.campaign.select([kind])
        if entries:
            fit = partial(_bench_fit, kind, assembly.read(entries), assembly.campaign.rig)
            for key, part in assembly.add(kind, fit).items():
                known = assembly.parts.get(key, {})
                assembly.parts[key] = merge_valves(known, part) if key == "valves" else part


def _bench_fit(kind: str, trials: list[Trial], rig: Rig) -> _BenchFit:
    from sysid.components.build import component_of
    from sysid.components.fitting import fit_law

    component = component_of(kind, trials, rig)
    fitted = fit_law(component, (), range(len(component.tests)))
    return _BenchFit(component.part(fitted.base_estimates()))


@dataclass(frozen=True)
class _ValveJob:
    """One valve pipeline on the trials of the entries that name the same valve."""

    kind: str
    valve: str | None
    trials: list[Trial]
    rig: Rig
    surface: str
    seed: int

    @property
    def name(self) -> str:
        return self.kind if self.valve is None else f"{self.kind}, valve {self.valve.upper()}"

    def fit(self) -> tuple[dict[str, Any], tuple[str, ...], tuple[str, ...]]:
        """The part, remarks and notices; an empty part where nothing is identified."""
        try:
            result: _Result
            if self.kind == "valve-discrete":
                result = fit_valve_discrete(self.trials, self.rig, valve=self.valve)
            else:
                result = fit_valve_pwm(
                    self.trials, self.rig, valve=self.valve, surface=self.surface, seed=self.seed
                )
        except NotIdentifiedError as error:
            return {}, (), (str(error),)
        return result.to_json(), tuple(result.remarks), tuple(result.notices)


def _add_valves(assembly: _Assembly, surface: str, seed: int) -> None:
    """Both kinds of valve test, each valve a job of its own; the jobs share the cores."""
    jobs = []
    for kind in ("valve-pwm", "valve-discrete"):
        entries = assembly.campaign.select([kind])
        # Entries that do not say which valve are told by what moves.
        for valve in dict.fromkeys(e.valve for e in entries):
            trials = assembly.read([e for e in entries if e.valve == valve])
            jobs.append(_ValveJob(kind, valve, trials, assembly.campaign.rig, surface, seed))
    if not jobs:
        return
    import joblib

    assembly.progress("; ".join(job.name for job in jobs))
    workers = min(len(jobs), joblib.cpu_count())
    found = joblib.Parallel(n_jobs=workers)(joblib.delayed(job.fit)() for job in jobs)
    valves: dict[str, Any] = {}
    for part, remarks, notices in reversed(found):
        valves = merge_valves(valves, part)
        assembly.remarks += remarks
        assembly.notices += notices
    if valves:
        assembly.parts["valves"] = valves
