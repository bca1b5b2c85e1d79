"""Reading a log file (`docs/reference/log-format.md`): checked, and converted to SI."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sysid import signals
from sysid.errors import InputError, input_error, one_line
from sysid.io import plausibility
from sysid.io.added_twice import added_twice
from sysid.io.channels import CHAMBER_PRESSURES, PRESSURES, VALVE_COMMANDS
from sysid.io.exclusion import Excluded, Exclusion, KeptRows, labels_in, shared_out, without
from sysid.io.foreign_log import foreign_log, in_log_format, is_in_log_format, unknown_line
from sysid.io.kinds import FRICTION_POINTS, settled_kind, settled_line
from sysid.io.measured_speed import (
    are_readings,
    check_motion,
    contradiction,
    instead_of_position,
    of_readings,
    timeless_line,
)
from sysid.io.played_header import played_header
from sysid.io.repeated_times import repeats, spread_evenly, written_twice
from sysid.io.reshaping import measured_period
from sysid.io.responses import response_notices
from sysid.io.rig import Rig
from sysid.io.samples import Log, Trial, any_contradiction, with_channels
from sysid.io.tables import LogTable, read_table
from sysid.io.time_breaks import time_breaks, without_own_time, wraps_of_seconds
from sysid.io.trust.misread import folds, without_spikes
from sysid.io.trust.repair import RepairedFile, Rows, repair, row_of
from sysid.io.units import CANONICAL_UNITS, ColumnMap, check_size, find_column, has_column, to_si
from sysid.types import FloatArray

# For kinds of test that the log format leaves open; in other logs a lab's own columns.
_SELDOM_NEEDED = (
    "velocity_rad_per_s",
    "velocity_m_per_s",
    "flow_a_kg_s",
    "upstream_pressure_pa",
    "downstream_pressure_pa",
    "time_to_pressure_s",
    "pwm_period_s",
    "pump_volts",
)
# Columns of a file that become a channel of another name.
_CONVERTED = ("motor_volts", "encoder_counts")
# Consecutive rows of a second sampling period from which a test counts as mixed.
_MIXED_RUN = 10
# Factor by which a period may drift from its median; a recorder's next rate is twice or half.
_DRIFT = 1.95
# A start later than this, s, is a date, whose digits leave few for a delay.
_LATE_S = 1e6
# Multiple of the motor's limit; no controller exceeds it by so much.
_FAR_BEYOND = 3.0


@dataclass
class LogReading:
    """A log while it is being read: columns by canonical name, and where they came from.

    `strides`: rows from one fresh reading to the next, of channels that repeat theirs. `begun`: of
    each part of a test whose start is excluded, by label, how many s after it begins. `convert`:
    the `sysid convert` that reads the file.
    """

    table: LogTable
    rig: Rig
    columns: dict[str, FloatArray] = field(default_factory=dict)
    origin: dict[str, str] = field(default_factory=dict)
    notices: list[str] = field(default_factory=list)
    unusable: dict[str, str] = field(default_factory=dict)
    maps: Mapping[str, ColumnMap] = field(default_factory=dict)
    contradictions: list[str] = field(default_factory=list)
    strides: dict[str, float] = field(default_factory=dict)
    begun: Mapping[str, float] = field(default_factory=dict)
    excluded: tuple[Excluded, ...] = ()
    convert: str = "sysid convert"

    @property
    def where(self) -> str:
        return str(self.table.path)

    def without_excluded(self, kept: KeptRows) -> None:
        """Go on with the rows that are not excluded."""
        self.table, self.begun, self.excluded = kept.table, kept.begun, kept.excluded
        self.notices += kept.notices

    def contradict(self, section: str, line: str | None) -> None:
        """Note what contradicts a section of the rig file; a notice if it was not declared."""
        if line:
            (self.notices if self.rig.assumes(section) else self.contradictions).append(line)


def read_log(
    path: Path,
    rig: Rig,
    mapping: Mapping[str, ColumnMap] | None = None,
    shared: Mapping[str, ColumnMap] | None = None,
    exclude: Sequence[Exclusion] = (),
    *,
    readings: bool = False,
) -> Log:
    """Read, check and convert one log file to SI.

    `mapping` translates foreign names and units (`sysid.io.units.parse_map`); `shared` does so
    where the file has the column and `mapping` does not override it. What `exclude` names is not
    looked at. `readings`: it may be a table without time, each row a reading by itself: of steady
    speeds and efforts (`friction-points`), or of settled flows or times over what set them. Raises
    InputError, one line that names the file, the row or column, and the fix.
    """
    table = log_table(path, {**(shared or {}), **(mapping or {})})
    return log_of(table, rig, mapping, shared, exclude, readings=readings)


def log_table(
    path: Path, maps: Mapping[str, ColumnMap], names: Collection[str] = tuple(CANONICAL_UNITS)
) -> LogTable:
    """The columns of a log file that a map names, or have one of `names`. Raises InputError.

    With maps it may be any file that `sysid convert` reads (`sysid.io.foreign_log`).
    """
    if maps and not is_in_log_format(path, maps, names):
        return foreign_log(path, maps)
    wanted = set(names) | {m.column for m in maps.values()}
    text = {"test"} | ({maps["test"].column} if "test" in maps else set())
    return read_table(path, wanted, text)


def test_labels(
    path: Path,
    mapping: Mapping[str, ColumnMap],
    shared: Mapping[str, ColumnMap] | None = None,
    units: Mapping[str, str | None] | None = None,
) -> list[str]:
    """The labels of a log's tests; one empty label without a column of them. Raises InputError.

    `units`: of the columns that it may have (None: the log format's).
    """
    known = CANONICAL_UNITS if units is None else units
    maps = {**(shared or {}), **mapping}
    table = log_table(path, maps, tuple(known))
    maps = {t: m for t, m in maps.items() if t in mapping or has_column(table.header, m)}
    if table.foreign is not None:
        table, _ = in_log_format(table, maps, 0.0, known)
        maps = {}
    return labels_in(table, maps)[1]


def exclusions_for(
    texts: Sequence[str], paths: Sequence[Path], mapping: Mapping[str, ColumnMap]
) -> list[tuple[Exclusion, ...]]:
    """The exclusions of each log by `--exclude`. Raises InputError where no log has the test."""
    if not texts:
        return [() for _ in paths]
    return shared_out(texts, [((str(p), p.name), test_labels(p, mapping)) for p in paths])


def log_of(
    table: LogTable,
    rig: Rig,
    mapping: Mapping[str, ColumnMap] | None = None,
    shared: Mapping[str, ColumnMap] | None = None,
    exclude: Sequence[Exclusion] = (),
    *,
    readings: bool = False,
) -> Log:
    """A table of `log_table` checked and converted to SI; arguments and errors of `read_log`."""
    maps, path = {**(shared or {}), **(mapping or {})}, table.path
    reading = LogReading(table, rig, maps=maps)
    for target in sorted(set(shared or {}) - set(mapping or {})):
        if not has_column(table.header, maps[target]):
            column = maps.pop(target).column
            reading.notices.append(
                f"{path}: has no column {column!r}, which the campaign maps to {target}"
            )
    if table.foreign is not None:
        table, said = in_log_format(
            table, maps, rig.atmosphere_pa, CANONICAL_UNITS, gas_constant=rig.other_gas
        )
        reading.table, maps = table, {}
        reading.notices += said
    timeless = "time_s" not in maps and "time_s" not in table.header
    by_row = _timeless_kind(table, maps, rig) if timeless else None
    if timeless and not (readings and by_row):
        raise missing_time(table, kind=by_row)
    reading.without_excluded(without(table, maps, exclude, rig))
    _take_columns(reading, maps)
    reading.origin |= {t: m.column for t, m in reading.maps.items() if t in reading.columns}
    if by_row is not None:
        reading.columns["time_s"] = np.arange(len(reading.table.frame), dtype=np.float64)
        is_friction = by_row == FRICTION_POINTS
        line = timeless_line(path) if is_friction else settled_line(path, by_row)
        reading.notices.append(line)
    groups = groups_of(reading, maps)
    _convert_position(reading)
    _convert_motor(reading)
    if not timeless:
        groups = _repaired(reading, with_own_times(reading, groups))
    _check_values(reading, groups)
    if not timeless:
        check_time_column(reading, groups)
        _count_from_the_start(reading)
        _check_tests(reading, groups)
        _use_speed(reading, groups)
    log = log_from(reading, groups)
    if timeless:
        return replace(log, trials=tuple(replace(t, is_readings=True) for t in log.trials))
    return log


def _count_from_the_start(reading: LogReading) -> None:
    """Times of a calendar, s since 1970 or so, would leave a delay few digits."""
    time = reading.columns["time_s"]
    if abs(time[0]) > _LATE_S:
        first = math.floor(time[0])
        reading.columns["time_s"] = time - first
        reading.notices.append(f"{reading.where}: time_s begins at {first} s; counted from there")


def _take_columns(reading: LogReading, maps: Mapping[str, ColumnMap]) -> None:
    table = reading.table
    known = set(CANONICAL_UNITS)
    sources = {
        t: table.header[find_column(table.header, m, reading.where)] for t, m in maps.items()
    }
    used = set(sources.values())
    for target, column in sources.items():
        if target in table.header and column != target:
            reading.notices.append(
                f"{reading.where}: {target} is taken from {column}, as mapped, not from the "
                "column of that name"
            )
    for name in table.header:
        if name in known and name not in maps and name not in used and name != "test":
            _take(reading, name, maps)
    for target, column in sources.items():
        if target != "test":
            take_column(reading, target, column, maps)
    unknown = [n for n in table.header if n not in known and n not in used]
    if unknown:
        reading.notices.append(unknown_line(table.path, unknown))
    if len(table.frame) < 2:
        raise input_error(reading.where, "holds one row only", "a test needs at least two samples")


def _absent_rows(
    reading: LogReading, target: str, column: str, maps: Mapping[str, ColumnMap]
) -> NDArray[np.bool_] | None:
    """The rows (n,) of tests in which a column is empty: there it is absent, which is said.

    None for time, and where no test lacks it.
    """
    empty = reading.table.empty(column)
    if target == "time_s" or not empty.any():
        return None
    tests = [(label, rows) for label, rows in groups_of(reading, maps) if empty[rows].all()]
    if not tests:
        return None
    absent = np.zeros(len(empty), dtype=bool)
    for _, rows in tests:
        absent[rows] = True
    where = "" if absent.all() else f" in test {', '.join(label for label, _ in tests[:30])}"
    reading.notices.append(f"{reading.where}: {column} is empty{where}: taken as absent")
    return absent


def _known(values: FloatArray) -> FloatArray:
    """A column's values but for tests in which it is absent."""
    return values[~np.isnan(values)]


def _take(reading: LogReading, name: str, maps: Mapping[str, ColumnMap]) -> None:
    """A column by its own name; one that only few kinds of test need may be unusable."""
    try:
        take_column(reading, name, name, maps)
    except InputError as error:
        if name not in _SELDOM_NEEDED:
            raise
        reading.unusable[name] = str(error)
        reading.notices.append(f"{name} is ignored: {error}")


def take_column(
    reading: LogReading,
    target: str,
    column: str,
    maps: Mapping[str, ColumnMap],
    units: Mapping[str, str | None] = CANONICAL_UNITS,
) -> None:
    """Read a column of the table in the unit that `units` has; one that is empty is absent.

    Raises InputError at a cell that is not a number, and for values beyond what can be measured.
    """
    table = reading.table
    absent = _absent_rows(reading, target, column, maps)
    if absent is not None and absent.all():
        return
    values = table.numbers(column, absent)
    if (entry := maps.get(target)) is not None:
        entry = entry.of_gas(reading.rig.other_gas)
        said = entry.notices(values, reading.where, table.place)
        stamped = table.is_stamped(column)
        values = to_si(values, entry, reading.rig.atmosphere_pa, stamped=stamped)
        reading.notices += said
    check_size(reading.where, target, _known(values), units=units)
    reading.columns[target] = values
    reading.origin[target] = column


def _timeless_kind(table: LogTable, maps: Mapping[str, ColumnMap], rig: Rig) -> str | None:
    """The kind of test that a table without time may be, each row a reading; None of a log."""
    present = {*table.header, *maps}
    return FRICTION_POINTS if of_readings(present, rig.units) else settled_kind(present)


def missing_time(table: LogTable, *, kind: str | None = None) -> InputError:
    """The error of a table without a time column, with a guess; `kind`: of readings, which have
    none, that it may also be."""
    close = difflib.get_close_matches("time_s", table.header, 1, 0.4)
    guess = close[0] if close else "COLUMN"
    named = re.search(r"[_ (\[](ms|us|min|h)[\])]?$", guess)
    unit = named[1] if named else "s"
    return input_error(
        table.path,
        f"column time_s is missing (it has {', '.join(table.header[:12])})",
        f"add it, or {plausibility.give_map('time_s', guess, unit)}"
        + (
            f'; if each row is a reading by itself, list it in a campaign as kind = "{kind}", '
            "which needs no time"
            if kind
            else ""
        ),
    )


def groups_of(reading: LogReading, maps: Mapping[str, ColumnMap]) -> list[tuple[str, Rows]]:
    """(label, rows) of each test, in the order in which they first appear."""
    codes, labels = labels_in(reading.table, maps)
    changes = np.flatnonzero(np.diff(codes)) + 1
    if len(changes) == len(labels) - 1:
        bounds = [0, *changes.tolist(), len(codes)]
        return [(labels[i], slice(bounds[i], bounds[i + 1])) for i in range(len(labels))]
    return [(label, np.flatnonzero(codes == i)) for i, label in enumerate(labels)]


def _convert_position(reading: LogReading) -> None:
    rig, columns = reading.rig, reading.columns
    check_motion(reading.where, columns, rig)
    target = rig.position_channel
    other = rig.units.other.position_channel
    if other in columns:
        raise input_error(
            reading.where,
            f"holds {other}, but {rig.source} describes a {rig.motion} rig",
            f'set [rig] motion = "{rig.units.other.motion}" there, or map {target}',
        )
    counts = columns.pop("encoder_counts", None)
    if counts is None or target in columns:
        return
    key = rig.units.encoder_counts
    per_unit = getattr(rig.sensors, key)
    if per_unit is None:
        raise input_error(
            rig.source,
            f"[sensors] {key} is missing, but {reading.where} holds encoder_counts",
            f"add {key} = ... under [sensors]",
        )
    scale = rig.units.turn / per_unit
    columns[target] = (counts - rig.sensors.encoder_zero_counts) * scale
    reading.origin[target] = "encoder_counts"


def _use_speed(reading: LogReading, groups: list[tuple[str, Rows]]) -> None:
    """A measured speed: its integral for a position that was not logged, else compared with it."""
    rig, columns = reading.rig, reading.columns
    speed, position, time = rig.units.speed_channel, rig.position_channel, columns["time_s"]
    if speed not in columns:
        return
    if position in columns:
        if rig.effort_channel not in columns or not are_readings(columns, rig):
            tests = [(time[r], columns[position][r], columns[speed][r]) for _, r in groups]
            found = contradiction(tests, rig)
            reading.notices += [] if found is None else [f"{reading.where}: {found}"]
        return
    taken, notice = instead_of_position(reading.where, columns, rig)
    reading.notices += [] if notice is None else [notice]
    if taken:
        way = np.zeros(len(time))
        for _, rows in groups:
            way[rows] = signals.integral(time[rows], columns[speed][rows])
        columns[position] = way
        reading.origin[position] = speed


def _convert_motor(reading: LogReading) -> None:
    rig, columns = reading.rig, reading.columns
    target = rig.effort_channel
    other = rig.units.other.effort_channel
    if other in columns:
        raise input_error(
            reading.where,
            f"holds {other}, but {rig.source} describes a {rig.motion} rig",
            f"map it to {target}, or correct [rig] motion",
        )
    volts = columns.pop("motor_volts", None)
    if volts is not None and target not in columns:
        if rig.effort_per_volt is None:
            key = rig.units.effort_per_volt
            raise input_error(
                rig.source,
                f"[motor] {key} is missing, but {reading.where} holds motor_volts",
                f"add {key} = ... under [motor]",
            )
        columns[target] = volts * rig.effort_per_volt
        reading.origin[target] = "motor_volts"
    if target not in columns:
        return
    known = _known(columns[target])
    plausibility.check_effort(reading.where, target, reading.origin[target], known, rig)
    limit = rig.max_effort
    if limit is not None:
        highest = float(np.max(np.abs(known)))
        over = int(np.count_nonzero(np.abs(columns[target]) > limit * (1 + 1e-6)))
        if over:
            columns[target] = np.clip(columns[target], -limit, limit)
            line = (
                f"{reading.where}: {target} exceeds the motor's limit of {limit:g} in {over} "
                "rows; the limit is used there"
            )
            share = highest / limit
            if share < _FAR_BEYOND:
                reading.notices.append(line)
            else:
                hint = f" (it reaches {share:.3g} times that: a column in volts is motor_volts)"
                reading.contradict("motor", line + hint)


def _check_arrangement(reading: LogReading) -> None:
    """InputError for commands of other valves than the rig file declares."""
    rig = reading.rig
    for name in VALVE_COMMANDS:
        values = reading.columns.get(name)
        is_of_two = name.endswith(("_fill", "_bleed"))
        if values is None or is_of_two == rig.bleeds or not np.any(_known(values)):
            continue
        said = "two on/off valves a chamber" if is_of_two else "3/2 valves"
        other = "fill-and-bleed" if is_of_two else "3/2"
        mine = ", ".join(f"{name.split('_')[0]}_{own}" for own in rig.valve_names)
        raise input_error(
            reading.where,
            f"holds {name}, a command of {said}, which {rig.source} does not declare",
            f'write [valves] arrangement = "{other}" there, or map {mine}',
        )


def _check_values(reading: LogReading, groups: Sequence[tuple[str, Rows]]) -> None:
    """Units and ranges of every channel, over the whole file."""
    _check_arrangement(reading)
    rig, columns, where = reading.rig, reading.columns, reading.where
    for name in PRESSURES:
        if name in columns:
            logged = ~np.isnan(columns[name])
            known, time = columns[name][logged], columns["time_s"][logged]
            plausibility.check_pressure(where, name, reading.origin[name], known, rig, time)
    for name in VALVE_COMMANDS:
        if name not in columns:
            continue
        if name.startswith("valve"):
            is_command = np.isin(columns[name], (0.0, 1.0)) | np.isnan(columns[name])
            bad = np.flatnonzero(~is_command)
            if bad.size:
                high = float(np.nanmax(columns[name]))
                raise input_error(
                    f"{where}, {reading.table.place(int(bad[0]))}",
                    f"{name} = {columns[name][bad[0]]:g} is neither 0 nor 1",
                    "write 0 (off) or 1 (on); for a coil's voltage or a percentage "
                    + plausibility.give_map(name, reading.origin[name], f"0..{high:g} -> 0..1")
                    + f"; a duty belongs in duty_{name.removeprefix('valve_')}",
                )
        else:
            known = _known(columns[name])
            error = plausibility.check_fraction(where, name, reading.origin[name], known)
            if error is not None:
                raise error
            _clip_duty(reading, name)
    position = rig.position_channel
    if position in columns:
        values = _known(columns[position])
        between = position in reading.strides or measured_period(reading.table.comments) is not None
        beyond = plausibility.check_position(
            where,
            position,
            reading.origin[position],
            values,
            smallest_step(values),
            rig,
            between_rows=between,
        )
        reading.contradict("cylinder", beyond)
        if not between and beyond is None:
            resolution = plausibility.check_resolution(where, position, values, rig)
            reading.contradict("sensors", resolution)
    if "temperature_k" in columns:
        plausibility.check_temperature(
            where,
            "temperature_k",
            reading.origin["temperature_k"],
            _known(columns["temperature_k"]),
        )
    if not any(np.any(_known(columns[n]) != 0.0) for n in VALVE_COMMANDS if n in columns):
        reading.contradict("air", _unlike_the_atmosphere(reading, groups))
    whole = {name: values for name, values in columns.items() if not np.isnan(values).any()}
    supply = plausibility.check_supply(where, whole, rig)
    reading.contradict("air", supply)
    reading.notices += response_notices(where, whole, rig, knows_supply=supply is None)
    reading.contradict("spring", _returned_by_nothing(reading, whole, groups))


def _returned_by_nothing(
    reading: LogReading, whole: Mapping[str, FloatArray], groups: Sequence[tuple[str, Rows]]
) -> str | None:
    """A line where the piston of one chamber returns and the rig file has no spring that does it;
    a measured effort may be that of a hand."""
    rig = reading.rig
    names = (rig.position_channel, f"pressure_{rig.sides[0]}_pa")
    if rig.effort_channel in whole or any(name not in whole for name in names):
        return None
    tests = ((whole[names[0]][rows], whole[names[1]][rows]) for _, rows in groups)
    return plausibility.check_return(tests, rig)


def _unlike_the_atmosphere(reading: LogReading, groups: Sequence[tuple[str, Rows]]) -> str | None:
    """A line where chambers of a log whose valves stay off do not rest at the atmosphere's pressure
    though the rig file or the motion says that they do."""
    rig, columns = reading.rig, reading.columns
    chambers = {name: _known(columns[name]) for name in CHAMBER_PRESSURES if name in columns}
    line = plausibility.check_rest(reading.where, chambers, rig)
    if line is not None or rig.assumes("cylinder"):
        return line
    tests = [
        {n: columns[n][groups[k][1]] for n in p}
        for p, own in _by_channels(columns, groups).items()
        for k in own
    ]
    twice = added_twice(tests, rig)
    if not twice:
        return None
    rests = float(np.median(chambers[twice[0]]))
    return (
        f"{reading.where}: {' and '.join(twice)} rest{'s' * (len(twice) == 1)} at {rests:.4g} Pa, "
        "twice the atmosphere's pressure in the rig file, and the motion shows no sign of it: the "
        "atmosphere's pressure is added twice; map an absolute pressure without (g)"
    )


def _clip_duty(reading: LogReading, name: str) -> None:
    """A duty that rounding puts beyond 0 or 1 is taken as that."""
    values = reading.columns[name]
    clipped = np.clip(values, 0.0, 1.0)
    beyond = np.abs(values - clipped)
    if np.any(beyond > 0.0):
        reading.columns[name] = clipped
        reading.notices.append(
            f"{reading.where}: {name} leaves 0 to 1 by at most {float(np.max(beyond)):.2g} in "
            f"{int(np.count_nonzero(beyond))} rows; 0 or 1 is used there"
        )


def smallest_step(values: FloatArray) -> float | None:
    """The smallest change between adjacent samples; None where nothing changes."""
    steps = np.abs(np.diff(values))
    scale = float(np.max(np.abs(values))) if len(values) else 0.0
    steps = steps[steps > 1e-9 * max(scale, 1e-12)]
    return float(np.min(steps)) if steps.size else None


def with_own_times(
    reading: LogReading, groups: Sequence[tuple[str, Rows]]
) -> list[tuple[str, Rows]]:
    """Each test's rows without those that were written twice, the rest with times of their own.

    Rows that share the stamps of a coarse clock are spread evenly. Notices say both; what remains
    is for `check_time_column` to refuse.
    """
    reading.columns["time_s"] = time = np.array(reading.columns["time_s"])
    others = {name: values for name, values in reading.columns.items() if name != "time_s"}
    twice, coarse, kept = list[int](), list[str](), list[tuple[str, Rows]]()
    for label, rows in groups:
        again = written_twice(time[rows], {name: values[rows] for name, values in others.items()})
        own = rows
        if again.any() and others:
            numbers = np.arange(len(time))[rows]
            twice += numbers[again].tolist()
            own = numbers[~again]
        shared = repeats(time[own])
        even = spread_evenly(time[own]) if shared.any() else None
        if even is not None:
            at, stamps = int(np.argmax(shared)), np.unique(time[own])
            name = f" of test {label}" if label else ""
            coarse.append(
                f"{reading.where}, {_place(reading, own, at)}: time_s{name} repeats "
                f"{time[own][at]:.9g}: a clock that counts {np.median(np.diff(stamps)):.3g} s is "
                f"too coarse for its rows; they are spread evenly, {even[1] - even[0]:.6g} s apart"
            )
            time[own] = even
        kept.append((label, own))
    if twice:
        more = f" and {len(twice) - 1} more" if len(twice) > 1 else ""
        reading.notices.append(
            f"{reading.where}, {reading.table.place(twice[0])}{more}: the row before, written "
            "twice: omitted"
        )
    if coarse:
        rest = f" (and {len(coarse) - 1} more tests alike)" if len(coarse) > 1 else ""
        reading.notices.append(f"{coarse[0]}{rest}")
    return kept


def check_time_column(reading: LogReading, groups: list[tuple[str, Rows]]) -> None:
    """Time increases within each test, at one rate; InputError otherwise, notices of less."""
    time = reading.columns["time_s"]
    periods, every = [], []
    for label, rows in groups:
        steps = np.diff(time[rows])
        name = f" of test {label}" if label else ""
        if len(steps) == 0:
            raise input_error(
                f"{reading.where}, {_place(reading, rows, 0)}",
                f"test {label} holds one row only",
                "delete it, or correct its label",
            )
        bad = np.flatnonzero(steps <= 0)
        if bad.size:
            raise _time_error(reading, rows, int(bad[0]), name)
        periods.append(float(np.median(steps)))
        every.append(steps)
        _check_mixed(reading, rows, steps, periods[-1], name)
    period, column = float(np.median(periods)), reading.origin["time_s"]
    mean = float(np.median([steps.mean() for steps in every]))
    wrong = plausibility.check_sampling(reading.where, column, period, reading.rig, mean)
    if measured_period(reading.table.comments) is None:
        reading.contradict("sampling", wrong)
    elif wrong:
        # Resampled rows are not those of the recorder.
        reading.notices.append(wrong)
    told = (
        plausibility.check_speed(
            reading.where, column, period, len(time), reading.rig, moves=_moves(reading)
        ),
        plausibility.check_evenness(reading.where, np.concatenate(every)),
    )
    reading.notices += filter(None, told)


def _moves(reading: LogReading) -> bool:
    """Whether the log holds a position, or a speed, that changes."""
    named = (reading.rig.position_channel, reading.rig.units.speed_channel)
    return any(bool(np.ptp(reading.columns[n])) for n in named if n in reading.columns)


def _place(reading: LogReading, rows: Rows, index: int) -> str:
    return reading.table.place(row_of(rows, index))


def _time_error(reading: LogReading, rows: Rows, index: int, name: str) -> InputError:
    time = reading.columns["time_s"][rows]
    before, after = (float(t) for t in time[index : index + 2])
    where = f"{reading.where}, {_place(reading, rows, index + 1)}"
    if before == after:
        count = int(np.count_nonzero(np.diff(time) == 0.0))
        if count == 1:
            fix = "delete the duplicate row or correct its time"
            what = f"time_s{name} repeats {after:.9g}, with other values"
            return input_error(where, what, fix)
        return input_error(
            where,
            f"time_s{name} repeats {after:.9g}, {without_own_time(count)}, which no even sampling "
            "explains",
            "delete these rows, or correct their times",
        )
    what = f"time_s{name} goes back from {before:.9g} to {after:.9g}"
    file = reading.table.path
    line = f"`{reading.convert} {file.name} -o {file.stem}_2.csv`"
    wraps = wraps_of_seconds(time)
    if wraps is not None and index + 1 in wraps.rows:
        return input_error(
            where, f"{what}: {wraps.name} wrapped", f"{line}, with the same maps, unwraps it"
        )
    if time_breaks(time).disordered is None:
        fix = f"{line}, with the same maps, numbers the tests in a column `test`"
        if name:
            fix = "give each recording its own label in the column `test`"
        return input_error(where, f"{what}: the recording starts again there", fix)
    fix = "sort the rows by time, or correct the time of this one"
    return input_error(where, f"{what}: rows are out of order", fix)


def _check_mixed(
    reading: LogReading, rows: Rows, steps: FloatArray, median: float, name: str
) -> None:
    """Two sampling periods in one test (single lost samples are gaps, not this)."""
    other = (steps >= _DRIFT * median) | (steps <= median / _DRIFT)
    if np.count_nonzero(other) < _MIXED_RUN:
        return
    for start, stop in signals.runs(other):
        second = steps[start:stop]
        rate = float(np.median(second)) / median
        if stop - start >= _MIXED_RUN and np.ptp(second) < 0.1 * rate * median:
            raise input_error(
                f"{reading.where}, {_place(reading, rows, start + 1)}",
                f"the sampling period{name} changes to {float(np.median(second)):.4g} s "
                f"(elsewhere {median:.4g} s)",
                "give each rate its own label in the column `test`, or bring them onto one period "
                "with `sysid convert --resample`",
            )


def _repaired(reading: LogReading, groups: list[tuple[str, Rows]]) -> list[tuple[str, Rows]]:
    """Faults of the recording that the samples themselves show, fixed with a notice.

    This precedes the check of ranges and steps, which a wrap or a jump distorts. Returns each
    test's rows, as the last ones may hold no information.
    """
    rig, name = reading.rig, reading.rig.position_channel
    counts = reading.origin.get(name) == "encoder_counts"
    repaired = list(groups)
    for present, own in _by_channels(reading.columns, groups).items():
        file = RepairedFile(
            columns={channel: reading.columns[channel] for channel in present},
            tests=[groups[k] for k in own],
            position=name,
            count=rig.encoder_step if counts else None,
            declared=rig.encoder_step if rig.has_declared_encoder else None,
            place=reading.table.place,
        )
        repair(file)
        reading.columns.update(file.columns)
        reading.notices += [f"{reading.where}: {line}" for line in file.notices]
        for channel, stride in file.strides.items():
            reading.strides[channel] = max(stride, reading.strides.get(channel, 0.0))
        for k, test in zip(own, file.tests, strict=True):
            repaired[k] = test
    return repaired


def _by_channels(
    columns: Mapping[str, FloatArray], groups: Sequence[tuple[str, Rows]]
) -> dict[tuple[str, ...], list[int]]:
    """The numbers of the tests by the channels that they have."""
    found: dict[tuple[str, ...], list[int]] = {}
    for k, (_, rows) in enumerate(groups):
        present = tuple(n for n, values in columns.items() if not np.isnan(values[rows]).any())
        found.setdefault(present, []).append(k)
    return found


def _check_tests(reading: LogReading, groups: list[tuple[str, Rows]]) -> None:
    """Faults within one test: an angle without its sign, single misread samples."""
    position = reading.rig.position_channel
    for label, rows in groups:
        where = f"{reading.where}, test {label}" if label else reading.where
        if position in reading.columns:
            values = reading.columns[position][rows]
            if folds(values):
                reading.notices.append(
                    f"{where}: {position} reverses at zero without slowing down: its sign "
                    "is missing"
                )
        for name in (position, *PRESSURES):
            if name in reading.columns and not np.isnan(reading.columns[name][rows]).any():
                _drop_spikes(reading, name, rows, where)


def _drop_spikes(reading: LogReading, name: str, rows: Rows, where: str) -> None:
    """Put single samples far outside a test's own range on the line between their neighbours."""
    values = reading.columns[name][rows]
    spikes, repaired = without_spikes(values)
    if spikes.size == 0:
        return
    column = reading.columns[name].copy()
    column[rows] = repaired
    reading.columns[name] = column
    shown = ", ".join(
        f"{values[i]:.4g} in {_place(reading, rows, int(i))}" for i in spikes.tolist()
    )
    reading.notices.append(
        f"{where}: {name}: single samples far outside all others, replaced by the line "
        f"between their neighbours: {shown}"
    )


def log_from(reading: LogReading, groups: Sequence[tuple[str, Rows]]) -> Log:
    """The log of a reading; what contradicts the rig file is the first of its notices."""
    table, wrong = reading.table, tuple(map(one_line, reading.contradictions))
    header = played_header(table.comments)
    starts = {} if header is None else header.starts
    trials = tuple(trial_of(reading, label, rows, starts) for label, rows in groups)
    notices = (*wrong, *map(one_line, reading.notices))
    return Log(
        table.path,
        table.sha256,
        trials,
        notices,
        reading.rig,
        wrong,
        reading.excluded,
        reading.table.comments,
    )


def trial_of(reading: LogReading, label: str, rows: Rows, starts: Mapping[str, float]) -> Trial:
    """One test of a reading; `starts`: where tests were designed to begin, by label, rad or m."""
    channels = {n: v[rows] for n, v in reading.columns.items() if n != "time_s"}
    channels = {n: v for n, v in channels.items() if not np.isnan(v).all()}
    time = reading.columns["time_s"][rows]
    said = measured_period(reading.table.comments)
    strides = {n: stride for n, stride in reading.strides.items() if n in channels}
    period = float(np.median(np.diff(time))) if strides else 0.0
    slow = {n: stride * period for n, stride in strides.items()}
    position = reading.rig.position_channel
    return Trial(
        label,
        time,
        channels,
        f"{reading.where}, test {label}" if label else reading.where,
        reading.unusable,
        row_period=max([*slow.values(), said or 0.0]) or None,
        slow=slow if said is None else {},
        begun_s=reading.begun.get(label, 0.0),
        read_as={name: _read_as(reading, name) for name in channels},
        contradictions=tuple(map(one_line, reading.contradictions)),
        place_known=reading.origin.get(position) != reading.rig.units.speed_channel,
        starts_at=starts.get(label, 0.0),
    )


def _read_as(reading: LogReading, name: str) -> ColumnMap:
    """The map of a channel's column: of counts or volts, which are no channels, in their place."""
    origin = reading.origin.get(name, name)
    target = origin if origin in _CONVERTED else name
    return reading.maps.get(target, ColumnMap(target, target))


__all__ = [
    "Log",
    "LogReading",
    "Trial",
    "any_contradiction",
    "check_time_column",
    "exclusions_for",
    "groups_of",
    "log_from",
    "log_of",
    "log_table",
    "missing_time",
    "read_log",
    "smallest_step",
    "take_column",
    "test_labels",
    "trial_of",
    "with_channels",
    "with_own_times",
]
