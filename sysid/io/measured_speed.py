"""A measured speed in addition to a log's position, or in place of it.

Where a motion log holds a speed and no position, the position is the speed's integral: its
changes are right, its place in the stroke is not known (`Trial.place_known`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Set
from dataclasses import replace

import numpy as np

from sysid import signals
from sysid.errors import input_error
from sysid.io.channels import CHAMBER_PRESSURES, VALVE_COMMANDS, VELOCITY_CHANNELS
from sysid.io.motion import MotionUnits
from sysid.io.plausibility import SIZE_KNOWN_TO
from sysid.io.rig import Rig
from sysid.io.samples import Trial, with_channels
from sysid.io.unit_text import TAKEN_FOR_SI
from sysid.types import FloatArray

# Windows of a test over which position and speed are compared, and the least of all tests.
_WINDOWS = 50
_FEWEST = 10
_ALIKE, _STRANGERS = 0.9, 0.5
_STANDARD_ERRORS = 5.0
_NOISE = 3.0
# Declared sampling periods from which rows are no recording.
_SAMPLED = 10.0


def check_motion(where: str, present: Iterable[str], rig: Rig) -> None:
    """InputError where a log holds the speed of another motion than the rig's."""
    other = rig.units.speed_channel
    for name in VELOCITY_CHANNELS.values():
        if name in present and name != other:
            raise input_error(
                where,
                f"holds {name}, but {rig.source} describes a {rig.motion} rig",
                f'set [rig] motion = "{rig.units.other.motion}" there, or map {other}',
            )


def moves(speed: FloatArray) -> bool:
    """Whether speeds (n,) show more than their noise."""
    if len(speed) < 2 * _FEWEST:
        return bool(np.any(speed != speed[0]))
    return float(np.std(speed)) > _NOISE * signals.noise_floor(speed).total


def place_needed(rig: Rig) -> str | None:
    """Why the position's place in the stroke matters to a balance of efforts; None: it does not."""
    if rig.is_vertical and not rig.is_linear:
        return "gravity's torque follows from the angle"
    if rig.spring is not None:
        return "a spring's effort follows from the position"
    return None


def of_readings(present: Set[str], units: MotionUnits) -> bool:
    """Whether columns hold what a reading of friction needs, and nothing of chambers or valves."""
    needed = {units.speed_channel, units.effort_channel}
    return needed <= present and not present & {*CHAMBER_PRESSURES, *VALVE_COMMANDS}


def timeless_line(where: object) -> str:
    """The notice of a table of readings, which has no time."""
    return (
        f"{where}: holds no time_s, but speeds and efforts: each row is a reading of friction by "
        "itself (friction-points)"
    )


def are_readings(channels: Mapping[str, FloatArray], rig: Rig) -> bool:
    """Whether rows (n,) are settled readings of friction (`friction-points`), not a recording.

    None of them at rest among others, each with an effort along its speed, and not at the rig's
    sampling: a recorded motion starts at rest and is slowed down. `channels` include `time_s`.
    """
    speed, effort = channels[rig.units.speed_channel], channels[rig.effort_channel]
    period = float(np.median(np.diff(channels["time_s"])))
    if rig.sampling is not None and period < _SAMPLED * rig.sampling.period_s:
        return False
    return bool(np.all(speed == 0.0) or np.all(speed * effort > 0.0))


def instead_of_position(
    where: str, channels: Mapping[str, FloatArray], rig: Rig
) -> tuple[bool, str | None]:
    """Whether a log's position is taken from its speed, and what a notice says of it.

    `channels` (n,) of the whole file. Not where the place matters, and not where a valve moves:
    the chambers' volumes follow from it.
    """
    speed, position = rig.units.speed_channel, rig.position_channel
    if position in channels or speed not in channels:
        return False, None
    if rig.effort_channel not in channels:
        if not rig.air_alone_drives(channels):
            return False, None
    elif are_readings(channels, rig):
        return False, None
    if (why := place_needed(rig)) is not None:
        return False, f"{where}: holds {speed} but no {position}, which is needed: {why}"
    if any(np.ptp(channels[name]) > 0.0 for name in VALVE_COMMANDS if name in channels):
        return False, (
            f"{where}: holds {speed} but no {position}: friction is fitted from the speed; flows "
            f"need {position}, from which the chambers' volumes follow"
        )
    return True, (
        f"{where}: {position} is the integral of {speed}, from 0 at the start of each test: where "
        "in the stroke it moves is not known"
    )


def with_position(trial: Trial, rig: Rig) -> Trial:
    """A trial whose position is its speed's integral where it has none; else as it is.

    For balances of efforts. Raises InputError where the place matters.
    """
    name, speed = rig.position_channel, rig.units.speed_channel
    if name in trial or speed not in trial:
        return trial
    if (why := place_needed(rig)) is not None:
        raise input_error(
            trial.source, f"holds {speed} but no {name}, and {why}", f"log {name} as well"
        )
    way = signals.integral(trial.time, trial[speed])
    return replace(with_channels(trial, **{name: way}), place_known=False)


def contradiction(
    tests: Iterable[tuple[FloatArray, FloatArray, FloatArray]], rig: Rig
) -> str | None:
    """The contradiction between a logged position and a logged speed; None without any.

    `tests`: times (n,) s, positions and speeds (n,) of each. Compared are the ways over windows,
    in which the noise of both is small.
    """
    ways, sums = [], []
    for time, position, speed in tests:
        step = max(1, (len(time) - 1) // _WINDOWS)
        if len(time) > _FEWEST and np.ptp(position) > 0.0 and moves(speed):
            ways.append(np.diff(position[::step]))
            sums.append(np.diff(signals.integral(time, speed)[::step]))
    if not ways:
        return None
    way, total = np.concatenate(ways), np.concatenate(sums)
    if len(way) < _FEWEST or not np.any(way) or not np.any(total):
        return None
    share = float(way @ total) / math.sqrt(float(way @ way) * float(total @ total))
    ratio = math.copysign(math.sqrt(float(way @ way) / float(total @ total)), share)
    name, speed_name = rig.position_channel, rig.units.speed_channel
    if share**2 < _STRANGERS:
        return f"{name} and {speed_name} do not belong to one motion ({name} is used)"
    error = math.sqrt(max(1.0 - share**2, 0.0) / len(way))
    if share**2 < _ALIKE or abs(ratio - 1.0) <= max(SIZE_KNOWN_TO, _STANDARD_ERRORS * error):
        return None
    if abs(ratio + 1.0) <= max(SIZE_KNOWN_TO, _STANDARD_ERRORS * error):
        return f"{speed_name} has the opposite sign of the motion of {name} ({name} is used)"
    units = TAKEN_FOR_SI[rig.units.speed]
    unit = next((u for u, f in units.items() if abs(abs(ratio) / f - 1.0) < SIZE_KNOWN_TO), None)
    guess = f": is it in {unit}?" if unit else ""
    return f"{name} moves {ratio:.4g} times as far as {speed_name} says ({name} is used){guess}"


__all__ = [
    "are_readings",
    "check_motion",
    "contradiction",
    "instead_of_position",
    "moves",
    "of_readings",
    "place_needed",
    "timeless_line",
    "with_position",
]
