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
from sysid.io.rig import HELD_SHARE, Rig
from sysid.signals import MIN_SAMPLES, noise_floor, travel
from sysid.types import BoolArray, FloatArray, IntArray

# Standardized coefficients of a chamber's pressure on the valves' commands, over a log's rows.
_FOLLOWS = 0.3
_TIMES_STRONGER = 1.5
_OPPOSED_ALONE = -0.5
# Of all that a pressure moves: other columns are named where they account for so much more of it.
_MAJORITY = 0.5
# Accounts that differ by less are alike.
_ALIKE = 0.1
# Rows at the end of a run whose median is the pressure there.
_END_ROWS = 5
MOVED = 20.0
"""A pressure that varies by less than so many standard deviations of its noise shows no command."""


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
    for line in (_answers(columns, rig), *(_of_chamber(columns, side, rig) for side in rig.sides)):
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
        if own and cross and min(cross) > max(_FOLLOWS, _TIMES_STRONGER * max(own)):
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
    were the chamber shut, which valves alone change. `noise`: one standard deviation, Pa."""

    shown: FloatArray
    at_rest: FloatArray
    noise: float

    @classmethod
    def held(cls, pressure: FloatArray, noise: float) -> Pressures:
        """Of a piston that does not move."""
        return cls(pressure, pressure, noise)


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
    starts: IntArray | None = None,
) -> Iterator[Unaccounted]:
    """Where more of a pressure's rise, or fall, is while a fill and a bleed valve are off than
    while either is on.

    `way`: the rig's `supply_way`; `starts`: the rows, after the first, at which tests begin.
    """
    fills, empties = (command > 0.0 for command in commands)
    edges = np.flatnonzero(np.diff(2 * fills + empties)) + 1
    begins = np.zeros(0, dtype=int) if starts is None else starts
    first, change = _moved_by_valves(pressures, edges, begins)
    toward, is_shut = way * change, ~(fills | empties)[first]
    lengths = np.diff([*first, len(pressures.shown)])
    for sign, name, does, command in zip(
        (1.0, -1.0), names, ("fills", "empties"), commands, strict=True
    ):
        along = np.maximum(sign * toward, 0.0)
        shut = is_shut & (along > MOVED * pressures.noise)
        if not shut.any() or np.sum(along[shut]) < _MAJORITY * np.sum(along):
            continue
        still = "" if np.any(command > 0.0) else ", which stays 0,"
        moves = "rises" if sign * way > 0.0 else "falls"
        line = (
            f"the pressure {moves} by {np.max(along[shut]):.4g} Pa while both valves are off: is "
            f"{name}{still} the command of the valve that {does} the chamber, or does it leak?"
        )
        yield Unaccounted(sign > 0.0, np.repeat(shut, lengths), line)


def mistaken_commands(columns: Mapping[str, FloatArray], side: str, rig: Rig) -> str | None:
    """How the on/off commands of a chamber's valves are swapped or inverted: a line, or None.

    `columns` (n,) each of a test of the chamber.
    """
    two = _two_valves(columns, side, rig)
    line = None if two is None else _mistaken(two)
    if line is not None or f"valve_{side}" not in columns:
        return line
    inverted = _is_inverted(columns, side, rig)
    return _opposed([f"valve_{side}"], rig.supply_way) if inverted else None


def _is_inverted(columns: Mapping[str, FloatArray], side: str, rig: Rig) -> bool:
    """Whether a chamber's pressure moves as the inverse of a 3/2 valve's on/off command has it."""
    pressures, on = _pressures(columns, side, rig), columns.get(f"valve_{side}")
    if pressures is None or on is None:
        return False
    (share,) = _accounted(pressures, [2.0 * on - 1.0], rig.supply_way, _starts(columns))
    return bool(share < -_MAJORITY)


def _pressures(columns: Mapping[str, FloatArray], side: str, rig: Rig) -> Pressures | None:
    """A chamber's pressures; None where none is logged, or it varies by little more than noise."""
    pressure = columns.get(f"pressure_{side}_pa")
    if pressure is None or len(pressure) < MIN_SAMPLES:
        return None
    noise = noise_floor(pressure).total
    if np.ptp(pressure) <= MOVED * noise:
        return None
    position = columns.get(rig.position_channel)
    if position is None or rig.cylinder is None or rig.air is None:
        return Pressures.held(pressure, noise)
    length = rig.cylinder.chamber_length(position, side)
    if np.min(length) <= 0.0:  # an offset or a zero of another rig
        return Pressures.held(pressure, noise)
    volume = (length / np.mean(length)) ** rig.air.heat_capacity_ratio
    return Pressures(pressure, pressure * volume, noise)


@dataclass(frozen=True)
class _TwoValves:
    """A chamber's pressures, and the commands (n,) of its fill and its bleed valve, by their
    columns. `way`: the rig's `supply_way`; `starts`: the rows at which tests begin."""

    pressures: Pressures
    names: tuple[str, str]
    commands: tuple[FloatArray, FloatArray]
    way: float
    starts: IntArray


def _two_valves(columns: Mapping[str, FloatArray], side: str, rig: Rig) -> _TwoValves | None:
    """On/off or duties; None of other rigs, where the log lacks one, or the pressure stays."""
    names = _two_names(columns, side) if rig.bleeds else None
    pressures = _pressures(columns, side, rig) if names is not None else None
    if names is None or pressures is None:
        return None
    commands = columns[names[0]], columns[names[1]]
    return _TwoValves(pressures, names, commands, rig.supply_way, _starts(columns))


def _two_names(columns: Mapping[str, FloatArray], side: str) -> tuple[str, str] | None:
    """The columns of a chamber's fill and bleed valve; None where the log lacks one."""
    for stem in ("valve", "duty"):
        fill, bleed = f"{stem}_{side}_fill", f"{stem}_{side}_bleed"
        if fill in columns and bleed in columns:
            return fill, bleed
    return None


def _of_chamber(columns: Mapping[str, FloatArray], side: str, rig: Rig) -> str | None:
    """A line on a chamber with a fill and a bleed valve: how their commands are mistaken, or that
    it empties, or fills, by no valve of the log while its piston moves; of a held one its fit says
    so."""
    two, position = _two_valves(columns, side, rig), columns.get(rig.position_channel)
    if two is None:
        return None
    line = _mistaken(two)
    if line is not None or position is None or rig.cylinder is None:
        return line
    if travel(position) <= HELD_SHARE * (rig.travel or 0.0):
        return None
    found = moved_while_shut(two.pressures, two.names, two.commands, two.way, two.starts)
    return next((one.line for one in found), None)


def _mistaken(two: _TwoValves) -> str | None:
    """How the commands of a fill and a bleed valve are mistaken: a line, or None.

    Of the ways in which people exchange and invert them, the one by which the pressure moves as it
    must.
    """
    (fill, bleed), (f, b) = two.names, two.commands
    toward, away = ("rises", "falls") if two.way > 0.0 else ("falls", "rises")
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
        two.pressures, [f - b, *(x - y for x, y in others.values())], two.way, two.starts
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
    total = float(np.sum(np.abs(change)))
    if not len(edges) or total <= MOVED * pressures.noise:
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


__all__ = [
    "MOVED",
    "Pressures",
    "Unaccounted",
    "mistaken_commands",
    "moved_while_shut",
    "response_notices",
]
