"""One part of the model from its log files: the bundle, and its page."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sysid.errors import Notice, SysidError, input_error
from sysid.io.bare_rig import read_bare_logs
from sysid.io.campaign import FRICTION_POINTS, Campaign, CampaignLog
from sysid.io.channels import CHAMBER_PRESSURES
from sysid.io.files import check_each_once, stamp_of
from sysid.io.logs import Log, exclusions_for, read_log
from sysid.io.rig import Rig, find_rig_file, read_rig
from sysid.io.source import Source
from sysid.io.tables import require_log
from sysid.io.units import parse_map
from sysid.parameters import Bundle, assumptions, read_bundle, shown_by_logs, write_bundle
from sysid.parameters.assumptions import FROM_LOG
from sysid.pipeline.fit_part import PartOptions, ValvePwmOptions, are_readings
from sysid.pipeline.request import Reported

_NOWHERE = Path("none")


@dataclass(frozen=True)
class Fitted:
    """The result of a fit: the bundle, its remarks, and where it was written."""

    bundle: Bundle
    remarks: tuple[str, ...]
    notices: tuple[str, ...]
    written: Path | None = None
    report: Path | None = None

    def assumed(self) -> list[str]:
        """A line for each assumed constant, and what the logs showed of it."""
        shown = shown_by_logs(self.bundle)
        lines = [one.line for one in assumptions(self.bundle)]
        return [*lines, f"from the log: {shown}"] if shown else lines

    def to_json(self) -> dict[str, Any]:
        """The output of `--json`: the bundle, what it rests on, the remarks and the files."""
        written = None if self.written is None else str(self.written)
        assumed = [one.to_json() for one in assumptions(self.bundle)]
        return {
            **self.bundle.to_json(),
            "remarks": list(self.remarks),
            "notices": list(self.notices),
            **({"assumed": assumed} if assumed else {}),
            "written": written,
            "bundle": written,
            "report": None if self.report is None else str(self.report),
        }


@dataclass(frozen=True, kw_only=True)
class FitFiles(Reported):
    """The files that a fit of one part reads and writes, and `exclude`: what is not read of them.

    Without `output` the bundle goes to `STEM.KIND.bundle.json` in this folder, without `report` the
    page to `STEM.KIND.report.html`; "none" and `no_report`: nowhere; `into`: a bundle to add it to.
    `without_control`: further logs, of an on/off valve without its flow control.
    """

    logs: Sequence[Path]
    rig: Path | None = None
    maps: Sequence[str] = ()
    output: Path | None = None
    into: Path | None = None
    report: Path | None = None
    no_report: bool = False
    exclude: Sequence[str] = ()
    without_control: Sequence[Path] = ()

    @property
    def every_log(self) -> tuple[Path, ...]:
        """All logs that are read."""
        return (*self.logs, *self.without_control)

    def bundle_path(self, kind: str, sources: Sequence[Source]) -> Path | None:
        """Where the bundle of a fit goes; None for nowhere. Raises InputError."""
        if self.output == _NOWHERE:
            return self.into
        return self.output or self.into or self._default(kind, "bundle.json", sources)

    def report_path(self, kind: str, sources: Sequence[Source]) -> Path | None:
        """Where its page goes; None for nowhere. Raises InputError."""
        if self.no_report:
            return None
        return self.report or self._default(kind, "report.html", sources)

    def _default(self, kind: str, suffix: str, sources: Sequence[Source]) -> Path:
        """A file of the first log's name in this folder, which is not another fit's."""
        path = Path(f"{self.logs[0].stem}.{kind}.{suffix}")
        _check_same_fit(path, kind, sources)
        return path


def fit_logs(options: PartOptions, files: FitFiles) -> Fitted:
    """Read logs, fit one part, and write it alone (`output`) or added to a bundle (`into`).

    Raises InputError for files that cannot be used or are in the way, NotIdentifiedError where
    nothing is identified.
    """
    before = stamp_of(files.into)
    existing = None if files.into is None else read_bundle(files.into)
    kind, chosen = options.part, options.recorded()
    readings = kind == "friction" and chosen["kind"] in (None, "points")
    given = _read_logs(files, existing, readings)
    rig, logs = given.rig, given.logs
    sources = [Source.of(log, "fit", kind) for log in logs]
    target, page = files.bundle_path(kind, sources), files.report_path(kind, sources)
    with given.errors():
        result = options.fitted([t for log in logs for t in log.trials], given.fitted_with)
    part = result.part()
    if given.in_volts and part.friction is not None:
        from sysid.identification.friction.volts import friction_in_volts

        has_pressures = any(name in log.channels for log in logs for name in CHAMBER_PRESSURES)
        part = friction_in_volts(part, has_pressures=has_pressures)
    bundle = Bundle.new(
        rig,
        part,
        sources,
        seeds={kind: options.seed} if isinstance(options, ValvePwmOptions) else None,
        options={kind: {**chosen, **given.options()}},
    )
    lost = [] if existing is None else list(_lost(existing, bundle))
    if existing is not None:
        if given.is_bare:  # its rig is the bundle's own, of which this log may show more
            existing = existing.replaced(rig_content=rig.content)
        bundle = existing.merged(bundle)
    if stamp_of(files.into) != before:
        raise input_error(
            str(files.into), "another command has changed it meanwhile", "run this fit again"
        )
    if target is not None:
        write_bundle(bundle, target)
    unseen: tuple[str, ...] = ()
    if page is not None:
        from sysid.pipeline.report import PageOptions, write_page

        campaign = _as_campaign(given, files, options)
        told = tuple(map(given.said, dict.fromkeys(result.notices)))
        shown = PageOptions(
            by_content=not chosen.get("kind"), progress=files.progress, notices=told
        )
        unseen = write_page(page, campaign, bundle, shown)
    wrong = (line for log in logs for line in log.contradictions)
    read = (line for log in logs for line in log.notices)
    notices = (*wrong, *lost, *given.notices, *read, *result.notices)
    said = (*unseen, *map(given.said, dict.fromkeys(notices)))
    return Fitted(bundle, tuple(map(given.said, result.remarks)), said, target, page)


# --- reading ------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Given:
    """The rig and its logs; `fitted_with` is the rig that the logs are read and fitted with.

    They differ where efforts are `in_volts`. `is_bare`: no rig file was given; the logs showed the
    constants `shown` (dotted keys).
    """

    rig: Rig
    fitted_with: Rig
    logs: tuple[Log, ...]
    notices: tuple[str, ...]
    in_volts: bool = False
    is_bare: bool = False
    shown: tuple[str, ...] = ()

    def options(self) -> dict[str, Any]:
        """The provenance of a bare log's rig."""
        return {FROM_LOG: list(self.shown)} if self.is_bare else {}

    def said(self, line: str) -> str:
        """A line about the rig, which may have no rig file."""
        said = self.rig.said(line)
        return Notice(said, line.subject) if isinstance(line, Notice) else said

    @contextlib.contextmanager
    def errors(self) -> Iterator[None]:
        """Errors in the block name the rig as it is; notes on them say what contradicts it."""
        try:
            yield
        except SysidError as error:
            # It may be why nothing was found.
            for line in dict.fromkeys(one for log in self.logs for one in log.contradictions):
                error.add_note(self.said(line))
            error.args = tuple(self.said(str(one)) for one in error.args)
            raise


def _read_logs(files: FitFiles, existing: Bundle | None, readings: bool) -> _Given:
    """As `_as_logged`, with the tests of a valve without its flow control known as such."""
    given = _as_logged(files, existing, readings)
    count = len(files.logs)
    bare = (
        replace(log, trials=tuple(replace(t, flow_control=False) for t in log.trials))
        for log in given.logs[count:]
    )
    return replace(given, logs=(*given.logs[:count], *bare))


def _as_logged(files: FitFiles, existing: Bundle | None, readings: bool) -> _Given:
    """The logs of one rig: that of `--rig`, of the rig file nearest to all of them, or a bare one.

    Parts of one bundle have one rig: a bare log that is added to a bundle has that bundle's.
    """
    check_each_once(files.every_log, "log")
    mapping = parse_map(files.maps)
    excluded = exclusions_for(files.exclude, files.every_log, mapping)
    found = {find_rig_file(p) for p in files.every_log} if files.rig is None else {files.rig}
    for log in files.every_log:
        require_log(log)
    if len(found) > 1:
        named = sorted("no rig file" if path is None else str(path) for path in found)
        raise input_error(
            " and ".join(named),
            "the logs belong to different rigs",
            "fit them one by one, or give one rig file with --rig",
        )
    (path,) = found
    if path is not None:
        rig = read_rig(path)
        logs = tuple(
            read_log(log, rig, mapping, exclude=own, readings=readings)
            for log, own in zip(files.every_log, excluded, strict=True)
        )
        return _Given(rig, rig, logs, rig.notices)
    existing_content = None if existing is None else existing.rig_content
    bare = read_bare_logs(files.every_log, mapping, existing_content, excluded, readings=readings)
    return _Given(
        bare.rig, bare.read_with, bare.logs, bare.notices, bare.in_volts, True, bare.shown
    )


# --- writing ------------------------------------------------------------------------------


def _check_same_fit(path: Path, kind: str, sources: Sequence[Source]) -> None:
    """InputError where an existing file is not from a fit of this kind of these logs."""
    if not path.exists():
        return
    own = frozenset((kind, source.sha256) for source in sources)
    if _made_from(path) != own:
        raise input_error(
            path,
            f"is in the way: it is not the result of `sysid fit {kind}` of these logs as they "
            "are now",
            f"move it, or say where to write with {_option(path)}",
        )


def _option(path: Path) -> str:
    return "-o FILE" if path.suffix == ".json" else "--report FILE"


def _made_from(path: Path) -> frozenset[tuple[str, str]] | None:
    """Kind of fit and SHA-256 of each log of a bundle or a report; None where it names none."""
    from sysid.blocks.html import origin_of

    try:
        if path.suffix == ".json":
            return read_bundle(path).provenance.fitted_on
        return origin_of(path.read_text("utf-8", errors="replace"))
    except (SysidError, OSError):
        return None


def _lost(existing: Bundle, added: Bundle) -> Iterator[str]:
    """A notice of numbers of a bundle that the part replacing them does not identify."""
    if existing.friction is None or added.friction is None:
        return
    new = added.parameters
    lost = [
        row.key
        for row in existing.parameters.fitted().rows
        if row.origin == "friction" and row.estimate.identified
        if row.path not in new or not new[row.path].estimate.identified
    ]
    if lost:
        yield (
            f"{existing.source}: {', '.join(lost)} was identified there and is not by these logs: "
            "friction is replaced whole; give all friction logs at once to keep it"
        )


def _as_campaign(given: _Given, files: FitFiles, options: PartOptions) -> Campaign:
    """The logs of one part as a report has them: each of the kind that it was fitted as."""
    mapping, chosen = parse_map(files.maps), options.recorded()
    declared = f"friction-{chosen['kind']}" if chosen.get("kind") else None
    entries = tuple(
        CampaignLog(
            declared or _kind_of(log, given.fitted_with, options.part),
            log.path.name,
            log.path,
            "fit",
            chosen.get("valve"),
            mapping,
            exclude=tuple(one.exclusion for one in log.excluded),
            flow_control=all(trial.flow_control for trial in log.trials),
        )
        for log in given.logs
    )
    return Campaign(
        given.logs[0].path,
        given.fitted_with,
        entries,
        at_hand={log.path: log for log in given.logs},
    )


def _kind_of(log: Log, rig: Rig, kind: str) -> str:
    """A campaign's kind; of friction tests the one that most of them are."""
    if kind != "friction":
        return kind
    if are_readings(log.trials):
        return FRICTION_POINTS
    from sysid.recording.friction_kind import classify_trial

    found = Counter(classify_trial(trial, rig) for trial in log.trials)
    return found.most_common(1)[0][0]


__all__ = ["FitFiles", "Fitted", "fit_logs"]
