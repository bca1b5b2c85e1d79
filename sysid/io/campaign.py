"""The campaign file: a rig's tests together, and what each may be used for."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import Field

from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table, table
from sysid.errors import InputError, input_error, shortened
from sysid.io.declaration import ChoiceKey, NumberKey, TextKey, TomlTable, declared_keys, range_of
from sysid.io.effort_timing import effort_is_read, readings_line, with_commands
from sysid.io.exclusion import Exclusion, exclusions_of, shared_out
from sysid.io.file_kinds import is_bag
from sysid.io.foreign import digest_of
from sysid.io.kinds import (
    BALANCED_KINDS,
    BENCH_KINDS,
    FRICTION_KINDS,
    FRICTION_POINTS,
    KINDS,
    MOTION_KINDS,
    READ_BY_ROW,
    SIMULATED_KINDS,
    VALVE_KINDS,
)
from sysid.io.logs import Log, read_log, test_labels
from sysid.io.own_kind import OwnKind, read_own_log
from sysid.io.rig import Inertia, Pwm, Rig, read_rig, read_toml, reject_misspelt
from sysid.io.samples import Trial
from sysid.io.source import Source
from sysid.io.units import CANONICAL_UNITS, ColumnMap, parse_map_table

Use = Literal["fit", "holdout"]
USES: tuple[str, ...] = get_args(Use)

_TWO_NUMBERS = {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2}
# A log's column as "column:unit", or as a table, with a sensor's range: readings and their values.
_COLUMN_SCHEMA = {
    "anyOf": [
        {"type": "string"},
        {
            "type": "object",
            "properties": {
                "column": {"type": "string"},
                "unit": {"type": "string"},
                "from": _TWO_NUMBERS,
                "to": _TWO_NUMBERS,
            },
            "required": ["column"],
            "dependentRequired": {"from": ["to"], "to": ["from"]},
            "additionalProperties": False,
        },
    ]
}
_PAYLOAD = range_of(Inertia, "payload_mass_kg")
_PERIOD = range_of(Pwm, "period_s")

# A table that says which column of a log holds which column of the log format.
ColumnTable = Annotated[
    dict[str, str | dict[str, Any]],
    Field(
        json_schema_extra={
            "propertyNames": {"enum": [*CANONICAL_UNITS]},
            "additionalProperties": _COLUMN_SCHEMA,
        }
    ),
]


class ExcludedSpan(TomlTable):
    """An entry of `exclude`: a test, or a span of one, that is not used."""

    test: Annotated[str, TextKey("Label of the test; empty for the only test of a file.")] = ""
    from_s: Annotated[float | None, Field(description="Start, s since the test's first row.")] = (
        None
    )
    to_s: Annotated[float | None, Field(description="End, s since the test's first row.")] = None
    why: Annotated[str, TextKey("The reason, which the report lists.")] = ""


class LogEntry(TomlTable):
    """`[[log]]`: the file of at least one test of a kind, and what it may be used for."""

    file: Annotated[str, TextKey("Path of the log, relative to the campaign file.")]
    kind: Annotated[
        str,
        ChoiceKey("What was done in the tests.", KINDS),
        Field(json_schema_extra={"enum": [*KINDS]}),
    ]
    use: Annotated[
        Use, ChoiceKey("Fitted on, or held out: never used to fit anything.", get_args(Use))
    ] = "fit"
    valve: Annotated[
        Literal["a", "b"] | None, ChoiceKey("The valve that was tested.", ("a", "b"))
    ] = None
    map: ColumnTable = Field(
        default_factory=dict,
        description="This log's own columns, each as \"column:unit\" or with a sensor's range; it "
        "must have them.",
    )
    payload_mass_kg: Annotated[
        float | None,
        NumberKey("What was carried, in place of the rig file's payload.", _PAYLOAD),
    ] = None
    flow_control: Annotated[
        bool,
        Field(
            description="Whether the valve's flow control was in place (valve-discrete): false for "
            "a log of the valve alone, from which thesis-series takes its own coefficients."
        ),
    ] = True
    pwm_period_s: Annotated[
        float | None,
        NumberKey(
            "PWM period of a valve-pwm log at another frequency than the rig file's, for choosing "
            "the frequency; by default what the ripple in its pressure shows.",
            _PERIOD,
        ),
    ] = None
    exclude: list[str | ExcludedSpan] = Field(
        default_factory=list,
        description="What is excluded: labels of whole tests, or tables with a span of one "
        "(`test`, `from_s`, `to_s`, s since its first row) and a reason (`why`).",
    )


class CampaignFile(TomlTable):
    """The campaign file: a rig's tests together, and what each may be used for."""

    rig: Annotated[str, TextKey("Path of the rig file, relative to the campaign file.")]
    name: Annotated[str | None, TextKey("The campaign's name, for readers.")] = None
    log: Annotated[list[LogEntry], Field(description="One entry per log.", min_length=1)]
    map: ColumnTable = Field(
        default_factory=dict,
        description='Columns of the logs that have them, each as "column:unit" or with a sensor\'s '
        "range.",
    )


@dataclass(frozen=True)
class CampaignLog:
    """One `[[log]]` entry. `file` is as written, `path` its location.

    `mapping` is its own `map`, `shared` the campaign's, of columns that not every log has;
    `exclude` is what is not read of it; `payload_kg` what it carried (None: the rig's payload);
    `flow_control`: whether the valve's flow control was in place; `pwm_period_s` the period of its
    pulses, if declared.
    """

    kind: str
    file: str
    path: Path
    use: str
    valve: str | None
    mapping: Mapping[str, ColumnMap]
    shared: Mapping[str, ColumnMap] = field(default_factory=dict)
    exclude: tuple[Exclusion, ...] = ()
    payload_kg: float | None = None
    flow_control: bool = True
    pwm_period_s: float | None = None


@dataclass(frozen=True, repr=False)
class Campaign(Shown):
    """A campaign file as read; its logs are read when they are used.

    `own` is the kind of log that a component of the user's own brings, None without one; `name` is
    for readers, empty without one. `at_hand`: logs that were read before, by their paths.

    >>> entry = campaign.select(["friction-sliding"], use="fit")[0]
    >>> campaign.read(entry).trials[0].label
    '1'
    """

    path: Path
    rig: Rig
    logs: tuple[CampaignLog, ...]
    notices: tuple[str, ...] = ()
    own: OwnKind | None = None
    name: str = ""
    at_hand: Mapping[Path, Log] = field(default_factory=dict)

    def headline(self) -> str:
        """Its name or file, its rig, and the number of its logs by use."""
        uses = [e.use for e in self.logs]
        counts = f"{uses.count('fit')} training logs, {uses.count('holdout')} held out"
        return f"campaign {self.name or self.path.name} of rig {self.rig.name}: {counts}"

    def records(self) -> list[dict[str, Any]]:
        """One record per log: its file, kind, use, valve, payload and number of exclusions."""
        return [
            {
                "file": e.file,
                "kind": e.kind,
                "use": e.use,
                "valve": e.valve or "",
                "payload_kg": e.payload_kg,
                "excluded": len(e.exclude),
            }
            for e in self.logs
        ]

    def tables(self) -> Iterable[Table]:
        """The logs, one row per kind of test."""
        rows = []
        for kind in dict.fromkeys(e.kind for e in self.logs):
            mine = self.select([kind], None)
            by_use = (_listed([e.file for e in mine if e.use == use]) for use in USES)
            excluded = sum(len(e.exclude) for e in mine)
            rows.append((kind, *by_use, str(excluded or "")))
        yield table("", ("kind", "training", "held out", "excluded"), rows, text=(1, 2))

    def select(self, kinds: Sequence[str], use: str | None = "fit") -> tuple[CampaignLog, ...]:
        """The entries of these kinds and this use (None: either), in the file's order."""
        return tuple(e for e in self.logs if e.kind in kinds and use in (None, e.use))

    def training_kinds(self) -> tuple[str, ...]:
        """The kinds of the training logs, each once, which say what the campaign is about.

        Of all logs if the campaign has no training logs.
        """
        logs = [e for e in self.logs if e.use == "fit"] or self.logs
        return tuple(dict.fromkeys(e.kind for e in logs))

    def sources(self, use: str | None = None) -> list[Source]:
        """The logs of this use (None: all) as a bundle's provenance lists them.

        Raises InputError for one that cannot be opened.
        """
        chosen = (e for e in self.logs if use in (None, e.use))
        return [
            Source(
                e.path.name,
                digest_of(e.path, "a log"),
                e.use,
                e.kind,
                _as_given(e.exclude),
                e.payload_kg,
                e.flow_control,
            )
            for e in chosen
        ]

    def excluding(self, texts: Sequence[str]) -> Campaign:
        """The campaign without what `--exclude` names too, in every log that has such a test.

        `LOG/TEST` names the test of one log. Raises InputError where none has it.
        """
        if not texts:
            return self
        units = None if self.own is None else self.own.units
        named = [
            (
                (self.name_of(e.path), e.file, e.path.name),
                test_labels(e.path, e.mapping, e.shared, units),
            )
            for e in self.logs
        ]
        logs = tuple(
            replace(e, exclude=(*e.exclude, *more))
            for e, more in zip(self.logs, shared_out(texts, named), strict=True)
        )
        return replace(self, logs=logs)

    def name_of(self, path: Path) -> str:
        """A log's file name; its `file` where the campaign has another log of that name."""
        alike = {e.path: e.file for e in self.logs if e.path.name == path.name}
        return path.name if len(alike) == 1 else alike[path]

    def copies(self, sources: Sequence[Source]) -> list[str]:
        """Notices of files that hold the same bytes: a copy is not further evidence.

        `sources` are those of all logs (`sources()`).
        """
        first: dict[str, CampaignLog] = {}
        notices = []
        for entry, source in zip(self.logs, sources, strict=True):
            before = first.setdefault(source.sha256, entry)
            if before.path != entry.path:
                held = before.use != entry.use
                notices.append(
                    f"{entry.path} is a copy of {before.path}, byte for byte"
                    + (": what is fitted is not held out" if held else "")
                )
        return notices

    def read(self, entry: CampaignLog) -> Log:
        """Read one entry's log. Raises InputError."""
        if self.own is not None and entry.kind == self.own.kind:
            own, maps = self.own, (entry.mapping, entry.shared)
            return read_own_log(entry.path, self.rig, own, *maps, entry.exclude)
        log = self._as_recorded(entry)
        if entry.kind not in BALANCED_KINDS or not self._effort_is_read:
            return log
        line = f"{self.path}: {readings_line(self.rig)}"
        trials = with_commands(log.trials, self.rig)
        return replace(log, trials=trials, notices=(*log.notices, line))

    def _as_recorded(self, entry: CampaignLog) -> Log:
        log = self.at_hand.get(entry.path) or read_log(
            entry.path,
            self.rig,
            entry.mapping,
            entry.shared,
            entry.exclude,
            readings=entry.kind in READ_BY_ROW,
        )
        changed: dict[str, Any] = {} if entry.flow_control else {"flow_control": False}
        if entry.payload_kg is not None:
            changed["payload_kg"] = entry.payload_kg
        if not changed:
            return log
        return replace(log, trials=tuple(replace(trial, **changed) for trial in log.trials))

    @cached_property
    def _effort_is_read(self) -> bool:
        """Whether force or torque are readings, by the training logs."""
        if self.rig.motor is not None:
            return False
        trials: list[Trial] = []
        for entry in self.select(BALANCED_KINDS):
            with contextlib.suppress(InputError):  # it is raised where that log is read
                trials += self._as_recorded(entry).trials
        return effort_is_read(trials, self.rig)


def _listed(files: Sequence[str]) -> str:
    """Files in one line: the first by its name, further ones by their number."""
    return "" if not files else files[0] + (f" and {len(files) - 1} more" if files[1:] else "")


def kinds_named(path: Path) -> list[str]:
    """The kinds of a campaign file's logs as they are there, known or not. Raises InputError."""
    entries = read_toml(path, "a campaign file").get("log")
    tables = entries if isinstance(entries, list) else []
    return [str(t["kind"]) for t in tables if isinstance(t, dict) and "kind" in t]


def read_campaign(path: Path, own: OwnKind | None = None) -> Campaign:
    """Read and check a campaign file. Raises InputError naming the key or entry.

    `own` is a kind of log in addition to those of the log format.
    """
    content = read_toml(path, "a campaign file")
    source = str(path)
    notices = reject_misspelt(content, CampaignFile.model_fields, "", source)
    rig_file = content.get("rig")
    if isinstance(rig_file, dict):
        raise input_error(
            path,
            "is a rig file, not a campaign",
            "give the path of a campaign file; sysid init campaign.toml writes a template",
        )
    if not isinstance(rig_file, str) or not rig_file:
        raise input_error(path, "rig is missing", 'add rig = "rig.toml" at the top')
    rig_path = path.parent / rig_file
    _check_name(path, "rig", rig_path)
    if not rig_path.is_file():
        what = "is a directory" if rig_path.is_dir() else "no such file"
        raise input_error(
            path, f"rig = {rig_file!r}: {what}", "paths are relative to the campaign file"
        )
    entries = content.get("log")
    if not isinstance(entries, list) or not entries:
        raise input_error(path, "no [[log]] entry", "add one [[log]] with kind and file per test")
    shared = content.get("map", {})
    logs = tuple(
        _entry(path, number, table, shared, notices, own)
        for number, table in enumerate(entries, start=1)
    )
    _reject_used_twice(path, logs)
    name = content.get("name")
    shown = name if isinstance(name, str) else ""
    rig = read_rig(rig_path)
    for number, entry in enumerate(logs, start=1):
        rig.carrying(entry.payload_kg, f"{path}, [[log]] entry {number} ({entry.file}),")
    return Campaign(path, rig, logs, tuple(notices), own, shown)


def _as_given(exclusions: Sequence[Exclusion]) -> tuple[dict[str, Any], ...]:
    return tuple(one.to_json() for one in exclusions)


def _entry(
    path: Path,
    number: int,
    table: Any,
    shared: Any,
    notices: list[str],
    own_kind: OwnKind | None,
) -> CampaignLog:
    where = f"[[log]] entry {number}"
    if not isinstance(table, dict):
        raise input_error(path, f"{where} is not a table", "write [[log]] with kind and file")
    notices += reject_misspelt(table, LogEntry.model_fields, f"{where}: ", str(path))
    file = table.get("file")
    if not isinstance(file, str) or not file:
        raise input_error(path, f"{where}: file is missing", 'add file = "..."')
    where = f"{where} ({shortened(file)})"
    chosen = _choices(path, where, table, own_kind)
    log_path = path.parent / file
    _check_name(path, where, log_path)
    if log_path.is_dir() and not is_bag(log_path):
        raise input_error(path, f"{where}: is a directory", "name a log in it")
    if not log_path.exists():
        raise input_error(path, f"{where}: no such file", "paths are relative to the campaign file")
    maps = table.get("map", {})
    if not isinstance(maps, dict) or not isinstance(shared, dict):
        raise input_error(path, f"{where}: map is not a table", 'write map = { time_s = "t:s" }')
    units = {**CANONICAL_UNITS, **(own_kind.columns if own_kind else {})}
    own, common = (parse_map_table(m, str(path), units) for m in (maps, shared))
    entry = LogEntry.model_construct(file=file, map=maps, **chosen)
    excluded = exclusions_of(table.get("exclude", []), where, str(path))
    payload, period = (
        _number(path, where, table, name) for name in ("payload_mass_kg", "pwm_period_s")
    )
    in_place = table.get("flow_control", True)
    if not isinstance(in_place, bool):
        what = f"{where}: flow_control = {in_place!r} is neither true nor false"
        raise input_error(path, what, "write it without quotes")
    return CampaignLog(
        entry.kind,
        file,
        log_path,
        entry.use,
        entry.valve,
        own,
        common,
        excluded,
        payload,
        in_place,
        period,
    )


def _check_name(path: Path, where: str, named: Path) -> None:
    """InputError for a path that no file can have."""
    try:
        named.exists()
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise input_error(path, f"{where}: {reason}", "give the path of a file") from None


def _number(path: Path, where: str, table: Mapping[str, Any], name: str) -> float | None:
    """A number of an entry; None where it is not given."""
    if (value := table.get(name)) is None:
        return None
    return float(declared_keys(LogEntry)[name].check(value, f"{where}: {name}", str(path)))


def _choices(path: Path, where: str, table: dict[str, Any], own: OwnKind | None) -> dict[str, Any]:
    """The entry's values that are choices, in the order of `LogEntry`."""
    more = {"kind": () if own is None else (own.kind,)}
    return {
        name: _one_of(path, where, name, table.get(name), (*key.allowed, *more.get(name, ())))
        for name, key in declared_keys(LogEntry).items()
        if isinstance(key, ChoiceKey)
        and (name in table or LogEntry.model_fields[name].is_required())
    }


def _one_of(path: Path, where: str, key: str, value: Any, allowed: Sequence[str]) -> str:
    if value not in allowed:
        what = f"{where}: {key} is missing" if value is None else f"{where}: {key} = {value!r}"
        fix = f"write one of {', '.join(allowed)}"
        if key == "kind" and value is not None:
            fix += ", or give the file of your own component with --component"
        raise input_error(path, what, fix)
    return str(value)


def _reject_used_twice(path: Path, logs: Sequence[CampaignLog]) -> None:
    """A training log cannot be held out as well, and no log is evidence twice."""
    uses: dict[str, str] = {}
    seen: set[tuple[str, str, str | None]] = set()
    for entry in logs:
        key = os.path.realpath(entry.path)
        if uses.setdefault(key, entry.use) != entry.use:
            raise input_error(path, f"{entry.file} is both fit and holdout", "give it one use")
        same = (key, entry.kind, entry.valve)
        if same in seen:
            raise input_error(
                path, f"{entry.file} is given twice as {entry.kind}", "delete one of its [[log]]s"
            )
        seen.add(same)


__all__ = [
    "BENCH_KINDS",
    "FRICTION_KINDS",
    "FRICTION_POINTS",
    "KINDS",
    "MOTION_KINDS",
    "SIMULATED_KINDS",
    "USES",
    "VALVE_KINDS",
    "Campaign",
    "CampaignFile",
    "CampaignLog",
    "ExcludedSpan",
    "LogEntry",
    "Use",
    "kinds_named",
    "read_campaign",
]
