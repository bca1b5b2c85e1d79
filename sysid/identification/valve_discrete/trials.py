"""The rows of a valve-discrete test that can be fitted, and known values (log format).

A test in which the piston moves is excluded. Rows where the sensor is clipped, or in which
the chamber was filled from an unsteady supply, are cut out: the rows between the cuts form
separate pieces, each with its own initial pressure.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid import signals
from sysid.estimation.quality import FEWEST_REPEATS
from sysid.identification.held_volume import volume_count
from sysid.identification.valve_discrete.held_chamber import HeldChamber
from sysid.io.logs import Trial
from sysid.io.plausibility import check_supply
from sysid.io.responses import MOVED, Pressures, mistaken_commands, moved_while_shut
from sysid.io.rig import HELD_SHARE, Air, Cylinder, Rig
from sysid.plant.base import CRITICAL_RATIO, chamber_volume
from sysid.plant.valve_timing import switched_intervals
from sysid.signals import NoiseFloor
from sysid.types import BoolArray, FloatArray

FILLING = ("choked_flow_fill_kg_s", "c_fill", "on_delay_s")
DISCHARGING = ("choked_flow_dis_kg_s", "c_dis", "off_delay_s")
# A supply that differs by this share from the assumed one changes the flows visibly.
SUPPLY_TOLERANCE = 0.005
_BLOCK_S = 0.02
_SUPPLY_BLOCK_S = 0.01
_SUPPLY_STEP_PA = 100.0
# Share of the way to the minimum of an unsteady supply; a rise up to there hardly depends on it.
_RISE_SHARE = 0.9
# After a command's edge the valve's state is known once the slowest valve has switched.
EDGE_GUARD_S = 0.05
FEWEST_ROWS = 10
# Smallest noise assumed, Pa: below it, rounding in the file dominates.
_LEAST_NOISE_PA = 5.0


_VOLUME = (
    "which gives the chamber's volume (where no sensor shows it: the place at which the piston is "
    "held, the same in every row)"
)


@dataclass(frozen=True)
class Piece:
    """Rows of one test that one simulation covers, and the values assumed known.

    `pressure` (n,) Pa at `chamber.time`; `initial`, `atmosphere` Pa are start values of the fit;
    `supply_shift` Pa is added to the chamber's supply. `fits_supply` and `fits_atmosphere`:
    the piece shows the settled pressure, so that the fit estimates it. `sensor`: its noise floor,
    Pa; `volume` m3.
    `flow_control`: whether the flow control that the valve has, if any, was in place. `way`: 1
    where the declared supply fills the chamber, -1 where it is a vacuum. `saturated`: whether its
    test's sensor is at an end of its range in rows that are excluded.
    """

    label: str
    source: str
    chamber: HeldChamber
    pressure: FloatArray
    sensor: NoiseFloor
    initial: float
    supply_shift: float
    fits_supply: bool
    atmosphere: float
    fits_atmosphere: bool
    supply_logged: bool
    volume: float
    fits_initial: bool = True
    flow_control: bool = True
    way: float = 1.0
    saturated: bool = False

    @property
    def noise(self) -> float:
        """The whole error of a sample, Pa; never so little that rounding counts."""
        return max(self.sensor.total, _LEAST_NOISE_PA)

    @property
    def supply(self) -> float:
        """Mean supply, Pa, from which the fit starts."""
        return float(np.mean(self.chamber.supply)) + self.supply_shift


@dataclass(frozen=True)
class Screened:
    """A test's pieces, its notices, and why it does not identify a parameter.

    `never_still`: the supply was unsteady in all of its fillings.
    """

    pieces: tuple[Piece, ...]
    notices: tuple[str, ...] = ()
    reasons: tuple[tuple[str, str], ...] = ()
    never_still: bool = False


def is_switched(trial: Trial, valve: str) -> bool:
    """Whether a test switches valve "a" or "b" on, or one of the two that the chamber has."""
    names = (f"valve_{valve}", f"valve_{valve}_fill", f"valve_{valve}_bleed")
    return any(name in trial and bool(np.any(trial[name] > 0.5)) for name in names)


def screened_tests(used: Sequence[Trial], valve: str, rig: Rig) -> list[Screened]:
    """Each test of valve "a" or "b" in pieces; a supply that rises in every test is kept."""
    screened = [screen(t, valve, rig) for t in used]
    if len(used) >= FEWEST_REPEATS and all(s.never_still for s in screened):
        # A supply that is never steady is part of the rig: the tests' scatter shows its influence.
        screened = [screen(t, valve, rig, keep_rise=True) for t in used]
    return screened


def screen(trial: Trial, valve: str, rig: Rig, *, keep_rise: bool = False) -> Screened:
    """Pieces of one test of valve "a" or "b". Raises InputError where a channel is missing.

    `keep_rise`: a filling from an unsteady supply is cut only close to the supply.
    """
    command, channel = f"valve_{rig.filled_by(valve)}", f"pressure_{valve}_pa"
    bleed = f"valve_{valve}_bleed"
    if not rig.bleeds or bleed not in trial or command in trial.unusable:
        trial.require([command], f"which shows when valve {valve.upper()} switches")
    trial.require([channel], f"which valve {valve.upper()}'s flow is computed from")
    if rig.held_tank is None:
        trial.require([rig.position_channel], _VOLUME)
    air = rig.require("air", "which the chamber equations need")
    volume, change = _volume(trial, valve, rig)
    if change > HELD_SHARE:
        moved = (
            f"the piston moved and changed chamber {valve.upper()} by {100 * change:.2g} %; "
            "hold it at an end"
        )
        return Screened((), (f"{trial.source}: excluded: {moved}",), _all_reasons(moved))
    if rig.bleeds and bleed in trial.unusable:
        trial.require([bleed], "which shows when the chamber empties")
    mistaken = mistaken_commands(trial.channels, valve, rig)
    if mistaken is not None:
        # Columns exchanged or a supply of the other kind: a pressure beyond both ends says which.
        said = check_supply(trial.source, trial.channels, rig) or f"{trial.source}: {mistaken}"
        why = said.removeprefix(f"{trial.source}: ")
        return Screened((), (f"{trial.source}: excluded: {why}",), _all_reasons(said))
    whole = _whole(trial, trial[channel], valve, air, volume, rig.supply_way)
    return _cut(trial, whole, valve, air, keep_rise)


def _all_reasons(why: str) -> tuple[tuple[str, str], ...]:
    return tuple((n, why) for n in (*FILLING, *DISCHARGING))


def air_gain(air: Air, trial: Trial, volume: float) -> float:
    """k R T / V, Pa/kg, at the logged ambient temperature, else the rig's."""
    temperature = temperature_of(trial, air)
    return air.heat_capacity_ratio * air.gas_constant_j_per_kg_k * temperature / volume


def temperature_of(trial: Trial, air: Air) -> float:
    """The logged ambient temperature, else the rig's, K."""
    logged = "temperature_k" in trial
    return float(np.mean(trial["temperature_k"])) if logged else air.temperature_k


def _volume(trial: Trial, valve: str, rig: Rig) -> tuple[float, float]:
    """The chamber's volume, m3, and the largest change of it in the test as a share."""
    if rig.held_tank is not None:
        return rig.held_tank.volume_m3, 0.0
    cylinder: Cylinder = rig.require("cylinder", "which gives the chamber's volume")
    position = trial[rig.position_channel]
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(position, min(5, len(position))), 1)
    volumes = np.asarray(chamber_volume(smooth, cylinder, valve))
    middle = float(np.median(volumes))
    return middle, signals.travel(volumes, volume_count(rig, valve)) / middle


def _whole(
    trial: Trial, pressure: FloatArray, valve: str, air: Air, volume: float, way: float
) -> Piece:
    """The test as one piece, before anything is cut."""
    time, sensor = trial.time, signals.noise_floor(pressure)
    fill, bleed = f"valve_{valve}_fill", f"valve_{valve}_bleed"
    two = fill in trial or bleed in trial

    def switched(command: str) -> tuple[FloatArray, FloatArray]:
        never = np.zeros(0), np.zeros(0)
        return switched_intervals(time, trial[command]) if command in trial else never

    opens, closes = switched(fill if two else f"valve_{valve}")
    bleeds = switched(bleed) if two else None
    logged = "supply_pressure_pa" in trial
    supply_from, supply = time[:1], np.array([air.supply_pressure_pa])
    if logged:
        supply_from, supply = _logged_supply(time, trial["supply_pressure_pa"])
    chamber = HeldChamber(
        time,
        opens,
        closes,
        air_gain(air, trial, volume),
        supply_from,
        supply,
        air.supply_pressure_pa,
        temperature_of(trial, air),
        bleeds,
    )
    p0 = air.atmospheric_pressure_pa
    return Piece(
        trial.label, trial.source, chamber, pressure, sensor, float(pressure[0]), 0.0, False, p0,
        False, logged, volume, flow_control=trial.flow_control, way=way,
    )  # fmt: skip


def _logged_supply(time: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The logged supply as steps: start (m,) s and pressure (m,) Pa of each.

    Means over blocks; blocks that differ by no more than the noise form one step.
    """
    starts, means = _blocks(time, values, _SUPPLY_BLOCK_S)
    per_block = max(1, len(values) // len(means))
    noise = signals.noise_floor(values).total
    step = max(4.0 * noise / np.sqrt(per_block), _SUPPLY_STEP_PA)
    first, level, count = [0], [float(means[0])], 1
    for i in range(1, len(means)):
        if abs(means[i] - level[-1]) > step:
            first.append(i)
            level.append(float(means[i]))
            count = 1
        else:
            count += 1
            level[-1] += (float(means[i]) - level[-1]) / count
    return starts[first], np.array(level)


def _blocks(time: FloatArray, values: FloatArray, span: float) -> tuple[FloatArray, FloatArray]:
    """Means over blocks of about `span` s: starts (m,) and means (m,)."""
    size = max(1, round(span / float(np.median(np.diff(time)))))
    starts = np.arange(0, len(time), size)
    counts = np.diff(np.append(starts, len(time)))
    return time[starts], np.add.reduceat(values, starts) / counts


def _cut(trial: Trial, whole: Piece, valve: str, air: Air, keep_rise: bool) -> Screened:
    notices: list[str] = []
    reasons: list[tuple[str, str]] = []
    time = whole.chamber.time
    # Which edges an excluded start left under way is unknown.
    bad = ~np.array(trial.has_its_start) & (time < time[0] + EDGE_GUARD_S)
    clipped, lines = _clipped(whole, valve)
    if lines:
        whole = replace(whole, saturated=True)
        bad |= clipped
        notices += [f"{trial.source}: pressure_{valve}_pa {line}" for line in lines]
    for cut in _of_two_valves(trial, whole, valve):
        bad |= cut.rows
        place = cut.place or trial.source
        line = f"{place}: {cut.why}"
        notices.append(f"{line}; {cut.used}")
        # By the thesis' law a vacuum's flow has no choked part, which no test shows.
        reasons += [(n, line) for n in cut.names if whole.way > 0.0 or not n.startswith("choked")]
    if len(whole.chamber.opens) and whole.chamber.opens[0] <= time[0] and trial.has_its_start:
        notices.append(
            f"{trial.source}: valve {valve.upper()} is on in the first row; log some rows before "
            "it is switched on"
        )
    plateaus = []
    wandering = 0
    for opened, closed in zip(whole.chamber.opens, whole.chamber.closes, strict=True):
        unsteady = None if whole.supply_logged else _unsteady(whole, bad, opened, closed)
        if unsteady is not None:
            wandering += 1
            risen = _risen(whole, bad, opened, closed) if keep_rise else opened
            bad |= (time >= risen) & (time < closed - EDGE_GUARD_S)
            why = f"{unsteady} while valve {valve.upper()} was on: the supply was unsteady"
            fix = "steady the supply, or log supply_pressure_pa"
            used = "fitted to its rise, at the declared supply" if keep_rise else "excluded"
            notices.append(f"{trial.source}: {why}; its filling is {used}; {fix}")
            reasons += [(name, f"{why}; {fix}") for name in FILLING if not keep_rise]
        # In an unsteady filling only the last rows, after the cut, are used, at one level.
        last = closed - EDGE_GUARD_S
        if unsteady is not None:
            whole = _levelled(whole, bad, last, closed)
        plateaus.append(
            (opened, closed, _settled(whole, bad, opened, closed))
            if unsteady is None
            else (last, closed, _mean_level(whole, bad, last, closed))
        )
    pieces = [_piece(whole, rows, plateaus, air) for rows in _segments(whole, bad)]
    if lines and not pieces:
        reasons += _all_reasons(
            f"{trial.source}: pressure_{valve}_pa {lines[0]}, which leaves none"
        )
    never_still = 0 < wandering == len(whole.chamber.opens)
    return Screened(tuple(pieces), tuple(notices), tuple(reasons), never_still)


@dataclass(frozen=True)
class _Cut:
    """Rows (n,) of a test that no law of a valve alone follows, why, and of which numbers.

    `place` where that is said (by default the test), with what is `used`.
    """

    rows: BoolArray
    why: str
    names: tuple[str, ...]
    place: str = ""
    used: str = "those rows are excluded"


def _of_two_valves(trial: Trial, whole: Piece, valve: str) -> Iterator[_Cut]:
    """Rows in which a fill and a bleed valve do not say by which of them the chamber is moved."""
    if whole.chamber.bleeds is None:
        return
    names = f"valve_{valve}_fill", f"valve_{valve}_bleed"
    of_filling, of_emptying = FILLING, DISCHARGING[:2]
    if names[1] not in trial:
        yield _without(trial, names[1], "when the chamber empties", of_emptying, names[0])
        return
    if names[0] not in trial:
        yield _without(trial, names[0], "when the chamber fills", of_filling, names[1])
        return
    fills, empties = (trial[name] > 0.5 for name in names)
    both = fills & empties
    if both.any():
        said = f"{' and '.join(names)} are on together, whose flows add up: switch one at a time"
        yield _Cut(both, said, (*of_filling, *of_emptying))
    commands = trial[names[0]], trial[names[1]]
    held = Pressures.held(whole.pressure, whole.noise)
    for one in moved_while_shut(held, names, commands, whole.way):
        yield _Cut(one.rows, one.line, of_filling if one.fills else of_emptying)


def _without(trial: Trial, missing: str, what: str, of_it: tuple[str, ...], other: str) -> _Cut:
    """What is not known without the command of one of two valves: all rows but those in which the
    `other` one is on, and the one before, at whose pressure it opens."""
    on = trial[other] > 0.5
    from_there = on.copy()
    from_there[:-1] |= on[1:]
    why = (
        f"column {missing} is missing, which shows {what}; add it, or map it with "
        f'--map "{missing}=COLUMN"'
    )
    used = f"of its tests the rows are fitted in which {other} is on"
    return _Cut(~from_there, why, of_it, trial.source.partition(", test ")[0], used)


def _risen(piece: Piece, bad: BoolArray, opened: float, closed: float) -> float:
    """When a chamber has filled most of the way to the minimum of its supply, s."""
    rows = _on_rows(piece, bad, opened, closed)
    pressure = piece.way * piece.pressure[rows]
    start, top = float(pressure[0]), int(np.argmax(pressure))
    level = start + _RISE_SHARE * (float(np.min(pressure[top:])) - start)
    return float(piece.chamber.time[rows[int(np.argmax(pressure >= level))]])


def _clipped(piece: Piece, valve: str) -> tuple[BoolArray, list[str]]:
    """Rows at which the sensor is at an end of its range, and a notice for each end."""
    p = piece.pressure
    clipped = np.zeros(len(p), dtype=bool)
    lines = []
    middle = 0.5 * (float(p.min()) + float(p.max()))
    supply = "logged supply" if piece.supply_logged else "rig file's supply"
    for end, name, inner in ((p.max(), "flat-topped", -1.0), (p.min(), "flat-bottomed", 1.0)):
        run = signals.longest_run(p == end)
        elsewhere = (p < middle) if inner < 0 else (p >= middle)
        if signals.is_cut_off(p, run, piece.sensor, _longest_repeat(p[elsewhere])):
            near = (p - end) * inner <= 4.0 * piece.noise
            clipped |= signals.widened(near, 3)
            of = f"{supply}, on which valve {valve.upper()}'s c_fill depends"
            if (inner < 0.0) != (piece.way > 0.0):
                of = "rig file's atmosphere"
            lines.append(
                f"is saturated ({name} at {end:.6g} Pa, {run[1] - run[0]} equal samples in a row); "
                f"those rows are excluded, and the chamber is taken to settle at the {of}"
            )
    return clipped, lines


def _longest_repeat(values: FloatArray) -> int:
    """Length of the longest run of equal values."""
    first, last = signals.longest_run(np.diff(values) == 0.0)
    return last - first + 1 if len(values) else 0


def _on_rows(piece: Piece, bad: BoolArray, opened: float, closed: float) -> NDArray[np.intp]:
    time = piece.chamber.time
    return np.flatnonzero((time >= opened) & (time < closed) & ~bad)


def _unsteady(piece: Piece, bad: BoolArray, opened: float, closed: float) -> str | None:
    """How the filled chamber's pressure drifted with the valve on; None where it was steady.

    The pressure of a chamber open to a constant supply rises to it and stays. It must not
    fall, nor rest at one level and then move to another.
    """
    rows = _on_rows(piece, bad, opened, closed)
    if len(rows) < 4 * FEWEST_ROWS:
        return None
    time, way = piece.chamber.time[rows], piece.way
    flat = 10  # blocks
    # What rests for as long as it took to rise: a slow tank hardly moves in a cylinder's time.
    span = max(_BLOCK_S, _rise_time(time, way * piece.pressure[rows]) / flat)
    _, means = _blocks(time, way * piece.pressure[rows], span)
    means = means[:-1]
    per_block = max(1, len(rows) // max(len(means), 1))
    wobble = 6.0 * piece.noise / np.sqrt(per_block) + 20.0
    if len(means) < 2 * flat:
        return None
    last = float(np.mean(means[-flat // 2 :]))
    limit = max(SUPPLY_TOLERANCE * abs(last), wobble)
    # Of one that still rises, the highest lies among the last.
    highest = float(means[: -flat // 2].max())
    if highest - last > limit:
        fell = "fell" if way > 0.0 else "rose"
        return f"the pressure {fell} from {way * highest:.6g} to {way * last:.6g} Pa"
    windows = np.lib.stride_tricks.sliding_window_view(means, flat)
    level, spread = windows.mean(axis=1), np.ptp(windows, axis=1)
    # Before its valve opens a chamber rests too: at its initial level.
    began = way * float(piece.pressure[rows[0]])
    resting = (spread < wobble) & (last - level > limit) & (level - began > 2.0 * limit)
    if np.any(resting):
        at, rose = way * float(level[np.argmax(resting)]), "rose" if way > 0.0 else "fell"
        return f"the pressure rested at {at:.6g} Pa and then {rose} to {way * last:.6g} Pa"
    return None


def _rise_time(time: FloatArray, values: FloatArray) -> float:
    """The time, s, in which values (n,) rise by 1 - 1/e of all that they rise."""
    level = values[0] + (1.0 - np.exp(-1.0)) * (np.max(values) - values[0])
    return float(time[int(np.argmax(values >= level))] - time[0])


def _settled(piece: Piece, bad: BoolArray, opened: float, closed: float) -> float | None:
    """The pressure at which the chamber settled with the valve on, Pa; None: it did not."""
    level = _resting_level(piece.pressure[_on_rows(piece, bad, opened, closed)], piece.noise)
    if level is None:
        return None
    if piece.way < 0.0:
        reached = abs(level - piece.supply) < abs(level - piece.atmosphere)
    else:
        reached = level >= 1.1 * CRITICAL_RATIO * piece.supply
    return level if reached else None


def _mean_level(piece: Piece, bad: BoolArray, begin: float, end: float) -> float | None:
    """Mean pressure with the valve on, between two times, Pa; None without a row."""
    rows = _on_rows(piece, bad, begin, end)
    return float(np.mean(piece.pressure[rows])) if len(rows) else None


def _levelled(piece: Piece, bad: BoolArray, begin: float, end: float) -> Piece:
    """The piece with the pressure between two times, s, level at that of the second.

    There the chamber follows its supply. A mean would be off by half of what the supply moves in
    that time, and the delay of the valve that closes by as long as the discharge takes for it.
    """
    rows = _on_rows(piece, bad, begin, end)
    if len(rows) < FEWEST_ROWS:
        return piece
    until = piece.chamber.time[rows] - end
    pressure = piece.pressure.copy()
    pressure[rows] -= float(np.polyfit(until, pressure[rows], 1)[0]) * until
    return replace(piece, pressure=pressure)


def _resting_level(pressure: FloatArray, noise: float) -> float | None:
    """Mean of the last fifth, where it equals that of the fifth before."""
    size = int(0.2 * len(pressure))
    if size < FEWEST_ROWS:
        return None
    last, before = float(np.mean(pressure[-size:])), float(np.mean(pressure[-2 * size : -size]))
    # Sensor noise may be coloured: twice the white standard error, at three of them.
    return last if abs(last - before) < 6.0 * noise * np.sqrt(2.0 / size) else None


def _segments(piece: Piece, bad: BoolArray) -> list[slice]:
    """Runs of good rows in which the pressure moves."""
    if not bad.any():
        return [slice(0, len(bad))]
    runs = [_after_guard(piece, slice(*run)) for run in signals.runs(~bad)]
    return [
        run
        for run in runs
        if run.stop - run.start >= 2 * FEWEST_ROWS
        and np.ptp(piece.pressure[run]) > MOVED * piece.noise
    ]


def _after_guard(piece: Piece, run: slice) -> slice:
    """The part of the run from where the valve's state is certain."""
    if run.start == 0:
        return run
    time, start = piece.chamber.time, run.start
    c = piece.chamber
    for edge in (*c.opens, *c.closes, *(np.concatenate(c.bleeds) if c.bleeds else ())):
        if edge <= time[start] < edge + EDGE_GUARD_S:
            start = int(np.searchsorted(time, edge + EDGE_GUARD_S))
    return slice(min(start, run.stop), run.stop)


def _piece(
    whole: Piece, rows: slice, plateaus: list[tuple[float, float, float | None]], air: Air
) -> Piece:
    """One run of rows as a piece: valve state, initial pressure, pressures at rest.

    `plateaus`: from when to when, s, the chamber is open to the supply, and its level there, Pa.
    """
    c, p = whole.chamber, whole.pressure[rows]
    time = c.time[rows]
    later = c.closes > time[0] - 0.5 * EDGE_GUARD_S
    opens, closes = c.opens[later].copy(), c.closes[later]
    begun = opens < time[0]
    # A vacuum has it below the atmosphere.
    way = whole.way
    high = way * (float(np.median(p[:5])) - air.atmospheric_pressure_pa) > 8.0 * whole.noise
    if rows.start == 0 and high and c.bleeds is None:
        # On from the first row and already filled: it was on before the log began.
        begun |= opens <= time[0]
    opens[begun] = -np.inf
    supplies = [
        level
        for begin, end, level in plateaus
        if level is not None and begin < time[-1] and end > time[0]
    ]
    inside = (c.supply_from >= time[0]) & (c.supply_from <= time[-1])
    inside[max(int(np.searchsorted(c.supply_from, time[0], side="right")) - 1, 0)] = True
    chamber = replace(
        c, time=time, opens=opens, closes=closes, supply_from=c.supply_from[inside],
        supply=c.supply[inside],
    )  # fmt: skip
    shift = float(np.mean(supplies) - np.mean(chamber.supply)) if supplies else 0.0
    atmosphere = _atmosphere(chamber, p, whole.noise)
    return replace(
        whole,
        chamber=chamber,
        pressure=p,
        initial=float(np.mean(p[: min(10, len(p))])),
        supply_shift=shift,
        fits_supply=bool(supplies),
        atmosphere=air.atmospheric_pressure_pa if atmosphere is None else atmosphere,
        fits_atmosphere=atmosphere is not None,
    )


def _atmosphere(chamber: HeldChamber, pressure: FloatArray, noise: float) -> float | None:
    """The pressure at which the chamber rests with the valve off, Pa; None: it does not."""
    time = chamber.time
    if chamber.bleeds is not None:
        for begin, end in zip(*chamber.bleeds, strict=True):
            until = min(float(end), float(time[-1]))
            rows = (time >= begin + 0.3 * (until - begin)) & (time < until)
            if (level := _resting_level(pressure[rows], noise)) is not None:
                return level
        return None
    first = chamber.opens[0] if len(chamber.opens) else np.inf
    before = pressure[time < first]
    level = _resting_level(before, noise)
    if level is not None:
        return level
    last = chamber.closes[-1] if len(chamber.closes) else -np.inf
    if not np.isfinite(last):
        return None
    return _resting_level(pressure[time >= last + 0.3 * (time[-1] - last)], noise)
