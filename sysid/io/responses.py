"""What a log's channels say about one another: columns that were taken for other ones.

A valve that is open moves its chamber's pressure towards what it connects the chamber to: the
supply, or the atmosphere. That holds for each run of rows in which an on/off command stays, so that
runs are judged by what the pressure changes in them. Under PWM a 3/2 valve is never long in either
state, and the pressure's level follows the duty. A piston that moves changes the pressure too: what
counts is what both the pressure does and its value at the mean volume, whether the chamber is shut
or open.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.io.channels import CHAMBER_PRESSURES, SIDES
from sysid.io.rig import Rig
from sysid.signals import MIN_SAMPLES, noise_floor
from sysid.types import BoolArray, FloatArray, IntArray

# Standardized coefficients of a chamber's pressure on the valves' commands, over a log's rows.
_FOLLOWS = 0.3
_MORE = 1.5
_OPPOSED_ALONE = -0.5
# Of all that a pressure moves: other columns are named where they account for so much more of it.
_MAJORITY = 0.5
# Accounts that differ by less are alike.
_ALIKE = 0.1
# Rows at the end of a run whose median is the pressure there.
_END_ROWS = 5
# Of the travel: a held piston gives by no more.
_HELD = 0.01
# A pressure that varies by less than so many standard deviations of its noise shows no command.
_MOVED = 20.0


def response_notices(
    where: str, columns: Mapping[str, FloatArray], rig: Rig, *, knows_supply: bool = True
) -> Iterator[str]:
    """Notices of columns, (n,) each, that hold another column's values or answer another's command.

    `knows_supply`: the log does not contradict the rig file's supply, towards which valves fill.
    """
    position, effort = rig.position_channel, rig.effort_channel
    for first, second in (CHAMBER_PRESSURES, (position, effort)):
        if first in columns and second in columns and _same(columns[first], columns[second]):
            yield (
                f"{where}: {first} and {second} hold the same values in every row: one column was "
                f"mapped twice; map {second} to its own column"
            )
    if not knows_supply:
        return
    two = (_of_two(columns, side, rig) or _while_shut(columns, side, rig) for side in rig.sides)
    for line in (_answers(columns, rig), *two):
        if line:
            yield f"{where}: {line}"


def _same(first: FloatArray, second: FloatArray) -> bool:
    return bool(np.ptp(first) > 0.0 and np.array_equal(first, second))


def _answers(columns: Mapping[str, FloatArray], rig: Rig) -> str | None:
    """Whether the chambers answer the other valve's command, or the opposite of their own."""
    toward, way = columns, rig.supply_way
    if way < 0.0:
        mirrored = {name: -columns[name] for name in CHAMBER_PRESSURES if name in columns}
        toward = {**columns, **mirrored}
    for stem in ("valve", "duty"):
        commands = [f"{stem}_{side}" for side in SIDES if f"{stem}_{side}" in columns]
        active = [c for c in commands if np.ptp(columns[c]) > 0.0]
        own: list[float] = []
        cross: list[float] = []
        for side in SIDES:
            shares = _shares(toward, active, f"pressure_{side}_pa")
            for command, share in shares.items():
                (own if command[-1] == side else cross).append(share)
        if stem == "valve":
            oppose = bool(active) and all(_is_inverted(columns, c[-1], rig) for c in active)
        else:
            oppose = bool(own) and _all_oppose(toward, active, own)
        if oppose:
            return _opposed(commands, way)
        if own and cross and min(cross) > max(_FOLLOWS, _MORE * max(own)):
            return (
                "each chamber's pressure follows the other chamber's valve: "
                f"{stem}_a and {stem}_b, or the pressures, are swapped"
            )
    return None


def _all_oppose(columns: Mapping[str, FloatArray], active: list[str], own: list[float]) -> bool:
    """Whether each command and its own chamber's pressure are opposed; `own`: what the pressures
    follow of the commands together."""
    return max(own) < -_FOLLOWS and all(
        max(_shares(columns, [c], f"pressure_{c[-1]}_pa").values(), default=0.0) < _OPPOSED_ALONE
        for c in active
    )


def _opposed(commands: list[str], way: float) -> str:
    """What is said of commands, by their names, that their chambers' pressures oppose."""
    moves = "fall" if way > 0.0 else "rise"
    meant = "(1 connects the chamber to the supply)"
    if len(commands) == 1:
        said = f"the chamber's pressure {moves}s while its valve is on"
        return f"{said}: {commands[0]} is inverted {meant}"
    return (
        f"the chambers' pressures {moves} while their valves are on: {' and '.join(commands)} are "
        f"inverted {meant} or swapped"
    )


@dataclass(frozen=True)
class Pressures:
    """A chamber's pressure (n,) Pa as it is `shown`, and `at_rest`: as it were at the mean volume
    were the chamber shut, which valves alone change."""

    shown: FloatArray
    at_rest: FloatArray

    @classmethod
    def held(cls, pressure: FloatArray) -> Pressures:
        """Of a piston that does not move."""
        return cls(pressure, pressure)


@dataclass(frozen=True)
class PressureRun:
    """Rows, from `start` to `stop`, in which a chamber's commands stay: what it is connected to,
    and how far, Pa, its pressure moves towards the supply."""

    start: int
    stop: int
    fills: bool
    empties: bool
    change: float

    @property
    def is_shut(self) -> bool:
        return not (self.fills or self.empties)


def pressure_runs(
    pressures: Pressures, fills: BoolArray, empties: BoolArray, way: float, starts: IntArray
) -> list[PressureRun]:
    """The runs of a chamber's commands, (n,) each, and what its pressure changes in each.

    `way`: the rig's `supply_way`; `starts`: the rows, after the first, at which tests begin.
    """
    edges = np.flatnonzero(np.diff(2 * fills + empties)) + 1
    first, change = _moved_by_valves(pressures, edges, starts)
    stops = [*first[1:], len(pressures.shown)]
    return [
        PressureRun(int(start), int(stop), bool(fills[start]), bool(empties[start]), way * moved)
        for start, stop, moved in zip(first, stops, change.tolist(), strict=True)
    ]


def _moved_by_valves(
    pressures: Pressures, edges: IntArray, starts: IntArray
) -> tuple[IntArray, FloatArray]:
    """The first rows (m,) of the runs between edges, and what valves change the pressure in each,
    Pa, at least: what it does as it is shown and at rest."""
    first, shown = _changes(pressures.shown, edges, starts)
    if pressures.at_rest is pressures.shown:
        return first, shown
    _, at_rest = _changes(pressures.at_rest, edges, starts)
    least = np.minimum(np.abs(shown), np.abs(at_rest))
    return first, np.where(shown * at_rest > 0.0, np.sign(shown) * least, 0.0)


def _changes(
    pressure: FloatArray, edges: IntArray, starts: IntArray
) -> tuple[IntArray, FloatArray]:
    """The first rows (m,) of the runs between edges, and what the pressure changes in each, Pa.

    From the end of the run before it on, in the same test: a pressure that moves as fast as the
    rows follow is counted in the run that moves it.
    """
    tests = {0, *starts.tolist()}
    bounds = sorted({*tests, *edges.tolist(), len(pressure)})
    level, change = 0.0, np.empty(len(bounds) - 1)
    for k, (start, stop) in enumerate(itertools.pairwise(bounds)):
        if start in tests:
            level = float(np.median(pressure[start : min(start + _END_ROWS, stop)]))
        end = float(np.median(pressure[max(start, stop - _END_ROWS) : stop]))
        change[k], level = end - level, end
    return np.array(bounds[:-1]), change


def _starts(columns: Mapping[str, FloatArray]) -> IntArray:
    """The rows, after the first, at which the tests of a file begin: where its time restarts."""
    time = columns.get("time_s")
    return np.zeros(0, dtype=int) if time is None else np.flatnonzero(np.diff(time) <= 0.0) + 1


@dataclass(frozen=True)
class Unaccounted:
    """Rows (n,) in which a chamber fills (else empties) though both of its valves are off, and the
    line that says so."""

    fills: bool
    rows: BoolArray
    line: str


def moved_while_shut(
    pressures: Pressures,
    names: tuple[str, str],
    commands: tuple[FloatArray, FloatArray],
    way: float,
    noise: float,
    starts: IntArray | None = None,
) -> Iterator[Unaccounted]:
    """Where more of a pressure's rise, or fall, is while a fill and a bleed valve are off than
    while either is on; `noise` is one standard deviation, Pa, the rest as in `_mistaken`."""
    on = [command > 0.0 for command in commands]
    begins = np.zeros(0, dtype=int) if starts is None else starts
    runs = pressure_runs(pressures, on[0], on[1], way, begins)
    for sign, name, does, command in zip(
        (1.0, -1.0), names, ("fills", "empties"), commands, strict=True
    ):
        shut = [r for r in runs if r.is_shut and sign * r.change > _MOVED * noise]
        moved = sum(sign * run.change for run in shut)
        total = sum(max(sign * run.change, 0.0) for run in runs)
        if not shut or moved < _MAJORITY * total:
            continue
        rows = np.zeros(len(pressures.shown), dtype=bool)
        for run in shut:
            rows[run.start : run.stop] = True
        most = max(shut, key=lambda run: sign * run.change)
        still = "" if np.any(command > 0.0) else ", which stays 0,"
        moves = "rises" if sign * way > 0.0 else "falls"
        line = (
            f"the pressure {moves} by {abs(most.change):.4g} Pa while both valves are off: is "
            f"{name}{still} the command of the valve that {does} the chamber, or does it leak?"
        )
        yield Unaccounted(sign > 0.0, rows, line)


def mistaken_commands(columns: Mapping[str, FloatArray], side: str, rig: Rig) -> str | None:
    """How the on/off commands of a chamber's valves are swapped or inverted: a line, or None.

    `columns` (n,) each of a test of the chamber.
    """
    line = _of_two(columns, side, rig)
    if line is not None or f"valve_{side}" not in columns:
        return line
    inverted = _is_inverted(columns, side, rig)
    return _opposed([f"valve_{side}"], rig.supply_way) if inverted else None


def _is_inverted(columns: Mapping[str, FloatArray], side: str, rig: Rig) -> bool:
    """Whether a chamber's pressure moves as the inverse of a 3/2 valve's on/off command has it."""
    pressures, on = _pressures(columns, side, rig), columns.get(f"valve_{side}")
    if pressures is None or on is None:
        return False
    starts = _starts(columns)
    (share,) = _accounted(pressures, [2.0 * on - 1.0], rig.supply_way, starts)
    return bool(share < -_MAJORITY)


def _pressures(columns: Mapping[str, FloatArray], side: str, rig: Rig) -> Pressures | None:
    """A chamber's pressures; None where none is logged, or it varies by little more than noise."""
    pressure = columns.get(f"pressure_{side}_pa")
    if pressure is None or not _moves(pressure):
        return None
    position = columns.get(rig.position_channel)
    if position is None or rig.cylinder is None or rig.air is None:
        return Pressures.held(pressure)
    length = rig.cylinder.chamber_length(position, side)
    if np.min(length) <= 0.0:  # an offset or a zero of another rig
        return Pressures.held(pressure)
    volume = (length / np.mean(length)) ** rig.air.heat_capacity_ratio
    return Pressures(pressure, pressure * volume)


def _moves(pressure: FloatArray) -> bool:
    """Whether a pressure (n,) Pa varies by more than its noise."""
    if len(pressure) < MIN_SAMPLES:
        return False
    return bool(np.ptp(pressure) > _MOVED * noise_floor(pressure).total)


def _of_two(columns: Mapping[str, FloatArray], side: str, rig: Rig) -> str | None:
    """How the commands of a fill and a bleed valve are mistaken, on/off or duties: a line, or None.

    Of the ways in which people exchange and invert them, the one by which the pressure moves as it
    must.
    """
    pressures = _pressures(columns, side, rig) if rig.bleeds else None
    if pressures is None:
        return None
    names = _two_names(columns, side)
    if names is None:
        return None
    commands = columns[names[0]], columns[names[1]]
    return _mistaken(pressures, names, commands, rig.supply_way, _starts(columns))


def _two_names(columns: Mapping[str, FloatArray], side: str) -> tuple[str, str] | None:
    """The columns of a chamber's fill and bleed valve; None where the log lacks one."""
    for stem in ("valve", "duty"):
        fill, bleed = f"{stem}_{side}_fill", f"{stem}_{side}_bleed"
        if fill in columns and bleed in columns:
            return fill, bleed
    return None


def _while_shut(columns: Mapping[str, FloatArray], side: str, rig: Rig) -> str | None:
    """A line where a chamber whose piston moves empties, or fills, by no valve of the log; of a
    held one its fit says so."""
    names = _two_names(columns, side) if rig.bleeds else None
    position = columns.get(rig.position_channel)
    pressures = _pressures(columns, side, rig) if names is not None else None
    if names is None or pressures is None or position is None or rig.cylinder is None:
        return None
    if np.ptp(position) <= _HELD * (rig.travel or 0.0):
        return None
    commands, noise = (columns[names[0]], columns[names[1]]), noise_floor(pressures.shown).total
    found = moved_while_shut(pressures, names, commands, rig.supply_way, noise, _starts(columns))
    return next((one.line for one in found), None)


def _mistaken(
    pressures: Pressures,
    names: tuple[str, str],
    commands: tuple[FloatArray, FloatArray],
    way: float,
    starts: IntArray,
) -> str | None:
    (fill, bleed), (f, b) = names, commands
    toward, away = ("rises", "falls") if way > 0.0 else ("falls", "rises")
    inverted = "inverted (is it a normally open valve?); write 1 where the valve is open"
    others = {
        f"the pressure {away} while {fill} is on and {toward} while {bleed} is on: the two columns "
        "are swapped; map each to the other's": (b, f),
        f"the pressure {toward} while {bleed} is on and {away} while it is off: {bleed} is "
        f"{inverted}": (f, 1.0 - b),
        f"the pressure {toward} while {fill} is off and {away} while it is on: {fill} is "
        f"{inverted}": (1.0 - f, b),
        f"the pressure {away} while {fill} is on and {toward} while {bleed} is on, and both are on "
        f"while it stays: {fill} and {bleed} are {inverted}": (1.0 - f, 1.0 - b),
    }
    held, *shares = _accounted(
        pressures, [f - b, *(x - y for x, y in others.values())], way, starts
    )
    best = max(shares)
    if best <= _MAJORITY or best - held <= _MAJORITY:
        return None
    # Duties of which either is inverted rank alike: the two are seldom open together.
    alike = [k for k, share in zip(others, shares, strict=True) if best - share < _ALIKE]
    return min(
        alike, key=lambda said: float(np.mean((others[said][0] > 0) & (others[said][1] > 0)))
    )


def _accounted(
    pressures: Pressures, ways: Sequence[FloatArray], way: float, starts: IntArray
) -> FloatArray:
    """The share of what the pressure moves that each of some commands accounts for, less what it
    contradicts.

    `ways` (n,) each: above 0 where the valves fill the chamber, below where they empty it; `starts`
    are the rows at which tests begin. What the pressure moves is that between any edges of them;
    commands that never switch account for nothing.
    """
    signs = np.sign(np.array(ways))
    edges = np.flatnonzero(np.any(np.diff(signs, axis=1), axis=0)) + 1
    first, change = _moved_by_valves(pressures, edges, starts)
    total, noise = float(np.sum(np.abs(change))), noise_floor(pressures.shown).total
    if not len(edges) or total <= _MOVED * noise:
        return np.zeros(len(ways))
    return np.asarray(way * (signs[:, first] @ change) / total)


def _shares(
    columns: Mapping[str, FloatArray], commands: list[str], pressure: str
) -> dict[str, float]:
    """Each command's standardized regression coefficient on a pressure, 1 where it follows it."""
    if not commands or pressure not in columns:
        return {}
    p = columns[pressure]
    if len(p) < MIN_SAMPLES or np.ptp(p) == 0.0:
        return {}
    x = np.column_stack([_standard(columns[c]) for c in commands])
    solution, *_ = np.linalg.lstsq(x, _standard(p), rcond=1e-6)
    return dict(zip(commands, map(float, solution), strict=True))


def _standard(values: FloatArray) -> FloatArray:
    return np.asarray((values - values.mean()) / values.std())


__all__ = ["Pressures", "Unaccounted", "mistaken_commands", "moved_while_shut", "response_notices"]
