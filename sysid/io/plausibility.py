"""Wrong units that a log's own numbers reveal.

A reader that takes 3 (bar) for 3 Pa silently gives wrong parameters. A channel is
rejected by comparison with the rig file, never by guessing a unit: the message names the
likely unit and the `--map` entry that converts it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from sysid.errors import SysidError, input_error
from sysid.io.channels import SIDES
from sysid.io.declaration import range_of
from sysid.io.rig import Air, Rig
from sysid.io.unit_text import TAKEN_FOR_SI
from sysid.signals import quantum, runs
from sysid.types import FloatArray

# Least noise of a real sensor, as a share of the atmospheric pressure.
_LEAST_SPREAD = 5e-4
_SLOWEST_S = 0.25
_SHORTEST_S = 1e-7
# Ratio of the long to the short steps from which a log counts as uneven.
_UNEVEN = 1.2
_LEAST_ROWS = 200
# A gauge pressure is near 0 wherever a chamber is open. One that begins at the atmosphere's is
# absolute, and a closed chamber that is pulled open may then fall far below it.
_LOWEST_SHARE_OF_ATMOSPHERE = 0.5
_LOWEST_FROM_REST = 0.1
_AT_REST = 0.2
_HIGHEST_SHARE_OF_SUPPLY = 4.0
# Fewer readings out of range than this share are a fault of the recording, not a wrong unit.
_FAULT_SHARE = 0.2
# Pressures within this factor may be one: gauges, supplies and the weather differ by less.
SAME_PRESSURE = 1.15
# Share of the travel by which a piston returns that is moved, not only compressed air that gives.
_RETURNED = 0.05
# Share of a chamber's room by which it has become smaller: the pressure rises by little more.
_COMPRESSED = 0.01
TWICE = 0.05
"""Pressures within this share of twice the atmosphere's: gauges and the weather differ by less."""
_HIGH_QUANTILE = 0.9
# Share of the travel: a stop yields, and a pitch radius is known to a few percent.
SIZE_KNOWN_TO = 0.05
# Levels from which a channel's resolution shows, and how far it may be from the declared one.
_LEAST_LEVELS = 100
_SAME_STEP = 0.1
# A factor typed with three digits is off by at most this much; so is a converter's zero.
TYPED_TO = 5e-3
_NAMES = {
    "deg": "degrees",
    "rev": "revolutions",
    "mrad": "milliradians",
    "mm": "millimetres",
    "um": "micrometres",
    "cm": "centimetres",
}


_GIVE = 'give --map "{}={}:{}"'
_GIVEN = re.compile(_GIVE.format(r"(\w+)", '[^"]*', r'([^":]+?)(\(g\))?'))


def give_map(target: str, column: str, unit: str) -> str:
    """The words that ask for an entry of `--map`."""
    return _GIVE.format(target, column, unit)


def with_maps(text: str, said: Callable[[str, str, bool], str]) -> str:
    """`text`, where each `give_map` in it is what `said` makes of the log's column, of the unit,
    and of whether that is a gauge's."""
    return _GIVEN.sub(lambda found: said(found[1], found[2], found[3] is not None), text)


def _mapping(target: str, column: str, unit: str) -> str:
    return f"if it is in {unit}, {give_map(target, column, unit)}"


def check_pressure(
    where: str,
    target: str,
    column: str,
    values: FloatArray,
    rig: Rig,
    time: FloatArray | None = None,
) -> None:
    """Absolute pressure (n,) Pa against the rig's atmosphere and supply; `time` (n,) s, where the
    log has one, says when a few readings went wrong."""
    if rig.air is None:
        return
    ambient, supply = rig.air.atmospheric_pressure_pa, rig.air.supply_pressure_pa
    low, high = float(np.min(values)), float(np.max(values))
    rests = abs(float(values[0]) / ambient - 1.0) < _AT_REST
    floor = (_LOWEST_FROM_REST if rests else _LOWEST_SHARE_OF_ATMOSPHERE) * min(ambient, supply)
    ceiling = _HIGHEST_SHARE_OF_SUPPLY * max(ambient, supply)
    if low >= floor and high <= ceiling:
        return
    what = f"{target} runs from {low:.4g} to {high:.4g}, which is not plausible as absolute Pa"
    fix = _looks_like(target, column, values, ambient, supply)
    if fix is None:
        odd = np.flatnonzero((values < floor) | (values > ceiling))
        if len(odd) < _FAULT_SHARE * len(values):
            span = "" if time is None else _span(time, odd)
            fix = (
                f"{len(odd)} of {len(values)} readings are below {floor:.3g} or above "
                f"{ceiling:.3g} Pa{span}: exclude the fault with --exclude"
            )
        else:
            fix = _mapping(target, column, "kPa") + " (or bar, psi; add (g) to a gauge pressure)"
    raise input_error(where, what, fix)


def _span(time: FloatArray, rows: NDArray[np.int64]) -> str:
    """The span of some rows; the first alone where `time` (n,) s starts again."""
    if np.all(np.diff(time) > 0.0):
        return f", from {time[rows[0]]:.6g} to {time[rows[-1]]:.6g} s"
    return f", the first at {time[rows[0]]:.6g} s"


def _looks_like(
    target: str, column: str, values: FloatArray, ambient: float, supply: float
) -> str | None:
    """The unit in which the readings at rest would be the atmosphere's, as in an open chamber."""
    low, high = float(np.min(values)), float(np.max(values))
    floor = _LOWEST_SHARE_OF_ATMOSPHERE * min(ambient, supply)
    ceiling = _HIGHEST_SHARE_OF_SUPPLY * max(ambient, supply)
    # The end of the readings that is not the supply's.
    rest = high if supply < ambient else low
    for gauge in (False, True):
        shift = ambient if gauge else 0.0
        for unit, factor in TAKEN_FOR_SI["Pa"].items():
            fits = low * factor + shift >= floor and high * factor + shift <= ceiling
            rests = abs(rest * factor + shift - ambient) < _AT_REST * ambient
            # Every gauge unit reads zero at rest; a real sensor shows some noise there.
            lives = (high - low) * factor > _LEAST_SPREAD * ambient
            if fits and rests and lives:
                kind = "a gauge pressure" if gauge else "an absolute pressure"
                name = f"{unit}(g)" if gauge else unit
                return f"it looks like {kind} in {unit}: " + _mapping(target, column, name)
    if supply < ambient and abs(low) < _AT_REST * ambient and floor <= ambient - high:
        return (
            "it looks like a vacuum gauge, which counts Pa below the atmosphere: if so, "
            + give_map(target, column, f"0..{ambient:g} -> {ambient:g}..0 Pa")
        )
    return None


def check_position(
    where: str,
    target: str,
    column: str,
    values: FloatArray,
    step: float | None,
    rig: Rig,
    *,
    between_rows: bool = False,
) -> str | None:
    """Position (n,) rad or m against the stroke and the encoder's resolution.

    `step` is the smallest change in the data, or None where it is unknown. Raises InputError on a
    wrong unit; a line where the zero cannot lie in the middle of the stroke, else None. A log whose
    rows lie between measured ones (`between_rows`) shows no resolution.
    """
    if not between_rows:
        _check_step(where, target, column, step, rig)
    return _beyond_stops(where, target, column, values, rig)


def _beyond_stops(where: str, target: str, column: str, values: FloatArray, rig: Rig) -> str | None:
    if rig.travel is None:
        return None
    low, high = float(np.min(values)), float(np.max(values))
    unit, si = "mm" if rig.is_linear else "deg", rig.units.position
    if high - low <= 1.15 * rig.travel < 1.5 * rig.travel < max(-low, high):
        raise input_error(
            where,
            f"{target} runs from {low:.4g} to {high:.4g} {si}, far outside the stroke of "
            f"{rig.travel:.4g} {si} about 0: its unit is wrong, or its zero is not the middle of "
            "the stroke",
            _mapping(target, column, unit)
            + ", else subtract the reading at mid-stroke (encoder_counts: [sensors] "
            "encoder_zero_counts)",
        )
    if high - low > 1.15 * rig.travel:
        raise input_error(
            where,
            f"{target} runs from {low:.4g} to {high:.4g} {si}, "
            f"more than the stroke of {rig.travel:.4g} {si} allows",
            _mapping(target, column, unit) + f", or correct {_lengths(rig)} in the rig file",
        )
    if max(-low, high) <= (0.5 + SIZE_KNOWN_TO) * rig.travel:
        return None
    return (
        f"{where}: {target} runs from {low:.4g} to {high:.4g} {si}, beyond the end stops at "
        f"+-{0.5 * rig.travel:.4g} {si}: its zero is not the middle of the stroke, or "
        f"{_lengths(rig)} is wrong{_from_an_end(low, high, rig.travel, si)}"
    )


def _from_an_end(low: float, high: float, travel: float, si: str) -> str:
    """How a position that counts from an end of the stroke is mapped; empty where it does not."""
    if min(low, travel - high) < -SIZE_KNOWN_TO * travel:
        return ""
    return f"; readings from one end on are mapped as 0..{travel:.4g} {si} -> " + (
        f"-{0.5 * travel:.4g}..{0.5 * travel:.4g} {si}"
    )


def _lengths(rig: Rig) -> str:
    """The keys of the rig file from which the travel follows."""
    return "stroke_m" if rig.is_linear else "stroke_m or pitch_radius_m"


def check_resolution(where: str, target: str, values: FloatArray, rig: Rig) -> str | None:
    """A line where all readings are multiples of another step than the encoder's."""
    per_unit = _counts_per_unit(rig)
    if per_unit is None or len(np.unique(values)) < _LEAST_LEVELS:
        return None
    step = quantum(values)
    ratio = step * per_unit
    # Rounding to few decimals adds a step of the file's own.
    if step == 0.0 or abs(ratio - 1.0) < _SAME_STEP or _is_decimal(step):
        return None
    si = rig.units.position
    return (
        f"{where}: {target} is resolved in steps of {step:.4g} {si}, the encoder declared in the "
        f"rig file in {1.0 / per_unit:.4g} {si}: {target} is scaled by {ratio:.3g} (a diameter for "
        "a radius, a gear ratio, the encoder's decoding), or the key under [sensors] is wrong"
    )


def _is_decimal(step: float) -> bool:
    """Whether a step is 1, 2 or 5 times a power of ten, to the accuracy of a refined step."""
    first = step / 10.0 ** math.floor(math.log10(step))
    return min(abs(first / d - 1.0) for d in (1.0, 2.0, 5.0, 10.0)) < 1e-3


def _counts_per_unit(rig: Rig) -> float | None:
    """The encoder's counts per rad or m as declared."""
    counts = getattr(rig.sensors, rig.units.encoder_counts)
    return None if counts is None else counts / rig.units.turn


def _check_step(where: str, target: str, column: str, step: float | None, rig: Rig) -> None:
    """The smallest change in the data against the encoder's resolution: the unit that it shows."""
    per_unit = _counts_per_unit(rig)
    if per_unit is None or not step:
        return
    si = rig.units.position
    for unit, worth in TAKEN_FOR_SI[si].items():
        factor = 1.0 / worth
        if abs(step * per_unit / factor - 1.0) < 0.02:
            raise input_error(
                where,
                f"{target} moves in steps of {step:.3g}, {factor:.3g} times the encoder's "
                f"resolution of {1.0 / per_unit:.3g} {si}: it looks like {_NAMES[unit]}",
                _mapping(target, column, unit),
            )


def check_effort(where: str, target: str, column: str, values: FloatArray, rig: Rig) -> None:
    """Motor torque or force (n,) at the output against the rig's limit."""
    limit = rig.max_effort
    if limit is None:
        return
    highest = float(np.max(np.abs(values)))
    if highest > 20.0 * limit:
        unit = "mN" if rig.is_linear else "mN m"
        raise input_error(
            where,
            f"{target} reaches {highest:.4g}, {highest / limit:.0f} times the motor's limit of "
            f"{limit:.4g}",
            _mapping(target, column, unit) + ", or correct [motor] in the rig file",
        )


def check_fraction(where: str, target: str, column: str, values: FloatArray) -> SysidError | None:
    """Duty (n,): the error to raise where it leaves 0 to 1 by more than rounding."""
    low, high = float(np.min(values)), float(np.max(values))
    if low >= -TYPED_TO and high <= 1.0 + TYPED_TO:
        return None
    if low >= 0.0 and 1.5 < high <= 100.0:
        fix = _mapping(target, column, "percent")
    elif low >= 0.0 and high > 100.0 and not np.any(values % 1.0):
        # A converter's or timer's full scale.
        full = (1 << int(high).bit_length()) - 1
        fix = f"if {full} is full duty, {give_map(target, column, f'1/{full}')}"
    else:
        fix = (
            "fix the values: a duty lies between 0 and 1 (a command of 5 to 10 V: --map "
            f'"{target}={column}:5..10 -> 0..1")'
        )
    return input_error(where, f"{target} runs from {low:.4g} to {high:.4g}, outside 0 to 1", fix)


def check_sampling(
    where: str, column: str, period: float, rig: Rig, mean: float | None = None
) -> str | None:
    """Sampling period (s) against the rig's: raises on a wrong unit, else a line or None.

    `period` is the median of the steps, `mean` their mean (None: the same): of steps that vary
    either may be what the rig file declares.
    """
    if period < _SHORTEST_S:
        raise input_error(
            where,
            f"time_s advances by {period:.4g} s per row, less than {_SHORTEST_S:g} s",
            _mapping("time_s", column, "d") + " (or h; a unit smaller than the second was mapped "
            "to it?)",
        )
    if rig.sampling is None:
        return None
    declared = rig.sampling.period_s
    ratio = period / declared
    for unit, factor in TAKEN_FOR_SI["s"].items():
        if abs(ratio * factor - 1.0) < 0.02:
            raise input_error(
                where,
                f"time_s advances by {period:.4g} s per row, but the rig file declares "
                f"{declared:.4g} s",
                _mapping("time_s", column, unit),
            )
    if all(abs(one / declared - 1.0) > 0.02 for one in (period, mean or period)):
        return (
            f"{where}: sampled every {period:.4g} s, the rig file declares {declared:.4g} s: "
            f"time_s or [sampling] period_s is wrong by {max(ratio, 1.0 / ratio):.3g}; the log's "
            "is used"
        )
    return None


def check_speed(
    where: str, column: str, period: float, rows: int, rig: Rig, *, moves: bool = True
) -> str | None:
    """A notice of rows so far apart that no actuator is measured by them; or None.

    `period` s, of a recording of `rows` rows; a short table of readings is no recording, and a
    part alone that has no place and so never `moves`, as a tank, may be slow.
    """
    slow = period > _SLOWEST_S and rows >= _LEAST_ROWS
    if rig.sampling is not None or not slow or not (moves or rig.cylinder is not None):
        return None
    unit = "ms" if period * TAKEN_FOR_SI["s"]["ms"] <= _SLOWEST_S else "us"
    return (
        f"{where}: time_s advances by {period:.4g} s per row, too slow for an actuator's motion "
        "unless it is a slow one: " + _mapping("time_s", column, unit)
    )


def check_evenness(where: str, steps: FloatArray) -> str | None:
    """A notice of a period that drifts, as that of a PC's loop does; `steps` (n,) s. Or None."""
    short, period, long = (float(q) for q in np.quantile(steps, (0.05, 0.5, 0.95)))
    if len(steps) < _LEAST_ROWS or long < _UNEVEN * short:
        return None
    return (
        f"{where}: sampled unevenly, every {short:.4g} to {long:.4g} s: where an even period is "
        f"needed it is {period:.4g} s, with measurements on a spline through their rows and "
        "commands held"
    )


def check_rest(where: str, pressures: Mapping[str, FloatArray], rig: Rig) -> str | None:
    """Chamber pressures, (n,) Pa each, of a log whose valves never switch: a line where all of them
    rest at another pressure than the atmosphere's, else None.

    Only of a rig whose valves vent its chambers: others may be under a regulator's pressure.
    """
    if rig.air is None or rig.valves is None or rig.bleeds or not pressures:
        return None
    ambient = float(rig.air.atmospheric_pressure_pa)
    rests = [float(np.median(values)) for values in pressures.values()]
    ratios = [rest / ambient for rest in rests]
    # A moving piston compresses one chamber and expands the other.
    if min(ratios) < SAME_PRESSURE and max(ratios) > 1.0 / SAME_PRESSURE:
        return None
    fix = (
        "is the atmosphere's pressure added twice? Map an absolute pressure without (g)"
        if all(abs(ratio / 2.0 - 1.0) <= TWICE for ratio in ratios)
        else "is its unit wrong, or [air] atmospheric_pressure_pa?"
    )
    return (
        f"{where}: {' and '.join(pressures)} rest at {rests[0]:.4g} Pa though no valve opens, the "
        f"atmosphere of the rig file is {ambient:.4g} Pa: {fix}"
    )


def check_supply(where: str, columns: Mapping[str, FloatArray], rig: Rig) -> str | None:
    """A log's columns (n,), SI: a line where its supply is not the rig file's, else None.

    The logged supply, or the pressure of a chamber while its valve connects it to the supply. A
    piston that moves into the chamber compresses its air above that of the supply.
    """
    if rig.air is None:
        return None
    declared, ambient = float(rig.air.supply_pressure_pa), float(rig.air.atmospheric_pressure_pa)
    said = f"the rig file's supply_pressure_pa is {declared:.4g} Pa"
    if "supply_pressure_pa" in columns:
        supply = columns["supply_pressure_pa"]
        # Tests from several supplies contradict none of them.
        low, high = (float(q) for q in np.quantile(supply, (1.0 - _HIGH_QUANTILE, _HIGH_QUANTILE)))
        if low / SAME_PRESSURE <= declared <= high * SAME_PRESSURE:
            return None
        logged = float(np.median(supply))
        return f"{where}: supply_pressure_pa is {logged:.4g} Pa, {said}: one of the two is wrong"
    for side in SIDES:
        valve = f"valve_{rig.filled_by(side)}"
        pressure, on = columns.get(f"pressure_{side}_pa"), columns.get(valve)
        if pressure is None or on is None or not np.any(on > 0.0):
            continue
        while_on = f"while {valve} is on"
        wrong = "one of the two is wrong (a gauge pressure in the rig file?)"
        judged = (on > 0.0) & ~_compressed(columns, side, on > 0.0, rig)
        high = float(np.quantile(pressure[judged], _HIGH_QUANTILE)) if judged.any() else 0.0
        low = float(np.quantile(pressure[on > 0.0], 1.0 - _HIGH_QUANTILE))
        if high > SAME_PRESSURE * max(declared, ambient):
            reached = f"pressure_{side}_pa reaches {high:.4g} Pa {while_on}, {said}"
            return f"{where}: {reached}: {wrong}"
        if low < min(declared, ambient) / SAME_PRESSURE:
            reached = f"pressure_{side}_pa falls to {low:.4g} Pa {while_on}, {said}"
            fix = wrong if declared < ambient else f"{wrong[:-1]}, or is the supply a vacuum?)"
            return f"{where}: {reached}: {fix}"
    return None


def _compressed(
    columns: Mapping[str, FloatArray], side: str, on: NDArray[np.bool_], rig: Rig
) -> NDArray[np.bool_]:
    """Rows (n,) in which a chamber is smaller than it was since its valve opened."""
    smaller = np.zeros(len(on), dtype=bool)
    position, cylinder = columns.get(rig.position_channel), rig.cylinder
    if position is None or cylinder is None:
        return smaller
    room = cylinder.chamber_length(position, side)
    for start, stop in runs(on):
        own = room[start:stop]
        smaller[start:stop] = own < (1.0 - _COMPRESSED) * np.maximum.accumulate(own)
    return smaller


def check_return(tests: Iterable[tuple[FloatArray, FloatArray]], rig: Rig) -> str | None:
    """Tests of a rig with one chamber, each its position (n,) rad or m and its pressure (n,) Pa: a
    line where the piston moves against the pressure though the rig file has nothing that moves it
    so, else None. It is of the rig file, the same for every log."""
    alone = len(rig.sides) == 1 and rig.spring is None and rig.motor is None
    if not alone or rig.air is None or rig.travel is None or rig.orientation == "vertical":
        return None
    for position, pressure in tests:
        way = rig.supply_way * position
        behind = np.maximum.accumulate(way) - way
        last = int(np.argmax(behind))
        first = int(np.argmax(way[: last + 1]))
        pushes = rig.supply_way * (pressure[first : last + 1] - rig.air.atmospheric_pressure_pa)
        if behind[last] > _RETURNED * rig.travel and float(np.mean(pushes)) > 0.0:
            u = rig.units
            return (
                f"{rig.source}: the piston returns against pressure_{rig.sides[0]}_pa, and no "
                f"[spring] is declared that returns it; add one, with {u.stiffness} and {u.preload}"
            )
    return None


def check_temperature(where: str, target: str, column: str, values: FloatArray) -> None:
    """Ambient temperature (n,) K: InputError where a rig file could not declare it."""
    from scipy.constants import zero_Celsius

    low, high = float(np.min(values)), float(np.max(values))
    possible = range_of(Air, "temperature_k").holds
    if possible(low) and possible(high):
        return
    # Degrees Celsius are named where they would make the readings possible.
    as_celsius = possible(low + zero_Celsius) and possible(high + zero_Celsius)
    fix = "fix the values, or omit the column (a sensor that is not connected?)"
    if as_celsius:
        fix = _mapping(target, column, "degC")
    raise input_error(where, f"{target} runs from {low:.4g} to {high:.4g} K", fix)
