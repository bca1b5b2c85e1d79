"""A logged test on an even time grid: commands held, measured signals joined by a spline."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from sysid import signals
from sysid.io.channels import VALVE_COMMANDS
from sysid.io.measured_speed import with_position
from sysid.io.rig import Rig
from sysid.io.samples import Trial
from sysid.recording.recording import Recording
from sysid.signals import MIN_SAMPLES

# A shaft moves where it crosses this share of its travel.
_MOVES = 0.02


def on_even_grid(trial: Trial, rig: Rig, names: Iterable[str] | None = None) -> Trial:
    """A trial with its channels, those of `names` only where given, on an even grid."""
    grid = signals.uniform_grid(trial.time)
    commands = (*VALVE_COMMANDS, rig.effort_channel)
    wanted = trial.channels if names is None else [name for name in names if name in trial]
    channels = {
        name: signals.resample(trial.time, trial[name], grid, hold=name in commands)
        for name in wanted
    }
    return replace(trial, time=grid, channels=channels)


def recorded(trial: Trial, rig: Rig, notices: list[str]) -> Recording:
    """A trial with the channels of its effort balance; InputError where a channel is missing.

    Missing pressures are set to P0, with a notice, as the log format specifies.
    """
    trial = with_position(trial, rig)
    trial.require([rig.position_channel], "and friction cannot be identified without motion")
    if not rig.air_alone_drives(trial.channels):
        trial.require([rig.effort_channel], "and the motor's effort is what friction balances")
    moment = rig.carrying(trial.payload_kg).gravity_moment()
    pressures = () if rig.cylinder is None else rig.pressure_channels
    names = (rig.position_channel, rig.effort_channel, *pressures, *VALVE_COMMANDS)
    even = on_even_grid(trial, rig, names)
    _check_pressures(trial, rig, notices)
    return Recording(
        trial=even,
        rig=rig,
        period=float(even.time[1] - even.time[0]) if len(even) > 1 else math.nan,
        lost=signals.in_pauses(trial.time, even.time),
        gravity_moment=moment,
        stride=trial.stride_of(rig.position_channel),
        spline=trial.slow.get(rig.position_channel, 0.0) / trial.period,
        speed_noise=_speed_noise(trial, rig),
    )


def _speed_noise(trial: Trial, rig: Rig) -> signals.NoiseFloor | None:
    """Noise of the measured speed whose integral a trial's position is; None for another."""
    if trial.place_known or len(trial) < MIN_SAMPLES:
        return None
    return signals.noise_floor(trial[rig.units.speed_channel], stride=trial.stride)


def _check_pressures(trial: Trial, rig: Rig, notices: list[str]) -> None:
    """Notices of pressures that are not logged, not used, or do not follow the motion.

    Raises InputError for logged pressures without the rig file's [air].
    """
    present = [name for name in rig.pressure_channels if name in trial]
    if rig.cylinder is None:
        if present:
            _say(notices, "the rig file has no [cylinder]: the logged pressures are not used")
        return
    if len(present) < len(rig.pressure_channels):
        missing = ", ".join(name for name in rig.pressure_channels if name not in trial)
        _say(notices, f"{missing} not logged: the chamber is assumed to be at P0")
    if not present:
        return
    way = float(np.ptp(trial[rig.position_channel]))
    moves = len(trial) >= MIN_SAMPLES and way > 0.0 and way >= _MOVES * (rig.travel or 0.0)
    for name in present:
        if moves and np.ptp(trial[name]) == 0.0:
            _say(
                notices,
                f"{name} never changes though the shaft moves: is its sensor connected? The effect "
                "of the air on the motion is taken for friction",
            )
    rig.require("air", "and the cylinder's effort is relative to atmospheric pressure")


def _say(notices: list[str], text: str) -> None:
    if text not in notices:
        notices.append(text)


def pause_line(trial: Trial) -> str | None:
    """The notice on the pauses of a trial's recording; None where it has none."""
    after = signals.pauses(trial.time)
    if not len(after):
        return None
    length, at = np.diff(trial.time)[after], float(trial.time[after[0]])
    more = f" and {len(after) - 1} more pauses" if len(after) > 1 else ""
    return (
        f"no sample for {length[0]:.3g} s at {at:.6g} s{more}: what lies in it is unknown, and not "
        "used"
    )


__all__ = ["on_even_grid", "pause_line", "recorded"]
