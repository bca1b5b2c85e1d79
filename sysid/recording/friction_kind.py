"""Which kind of friction test a recording is, and the stretch over which its effort is constant."""

from __future__ import annotations

import numpy as np

from sysid import signals
from sysid.errors import InputError
from sysid.io.measured_speed import place_needed
from sysid.io.rig import Rig
from sysid.io.samples import Trial
from sysid.recording.even import recorded
from sysid.recording.recording import Recording
from sysid.signals import MIN_SAMPLES
from sysid.types import FloatArray

STATIC, SLIDING, MOTION = "friction-static", "friction-sliding", "friction-motion"
KINDS = (STATIC, SLIDING, MOTION)
# Of the largest value in a test: an effort is constant, and a shaft at rest, to within this.
_CONSTANT = 0.01


def balances(trial: Trial, rig: Rig) -> bool:
    """Whether a motion trial has every channel of the balance that friction closes: without a
    pressure, the cylinder's effort would be mistaken for friction. Where air alone drives the rig,
    no effort is needed."""
    pressures = () if rig.cylinder is None else rig.pressure_channels
    shows_motion = rig.position_channel in trial or (
        rig.units.speed_channel in trial and place_needed(rig) is None
    )
    efforts = () if rig.air_alone_drives(trial.channels) else (rig.effort_channel,)
    return shows_motion and all(c in trial for c in (*efforts, *pressures))


def classify_trial(trial: Trial, rig: Rig) -> str:
    """`friction-static`, `friction-sliding` or `friction-motion`, by the trial's content.

    Static: the motor's effort grows from zero, without falling back, for most of the test.
    Sliding: it is constant to within 1 % for at least half of the test, at a level that its noise
    does not hide, and the shaft moves under it. A test in which a valve moves, and any other test,
    is motion: one that rests after a move under a controller's constant effort too. A ramp whose
    start is excluded is still a ramp.
    """
    try:
        recording = recorded(trial, rig, [])
    except InputError:
        return MOTION
    return classify(recording)


def classify(recording: Recording) -> str:
    """`classify_trial` of what is already recorded on an even grid."""
    drive = recording.motor
    if recording.valves_move or len(recording) < MIN_SAMPLES or not np.any(drive):
        return MOTION
    if _is_ramp(drive, recording.trial.has_its_start):
        return STATIC
    return SLIDING if _is_under_constant_effort(recording) else MOTION


def _is_under_constant_effort(recording: Recording) -> bool:
    """Whether a level of the motor's effort lasts for half of a test, and is what the test shows.

    A shaft that was never moved is under it, too.
    """
    drive, place = recording.motor, recording.position
    start, stop = constant_run(drive)
    if stop - start < 0.5 * len(drive):
        return False
    if np.ptp(place[start:stop]) < _CONSTANT * np.ptp(place):
        return False
    return abs(float(np.mean(drive[start:stop]))) > level_tolerance(drive)


def _is_ramp(drive: FloatArray, from_zero: bool) -> bool:
    size = np.abs(drive)
    top = int(np.argmax(size))
    still = int(np.argmax(size > 0.02 * size[top]))
    rise = drive[still : top + 1]
    if len(rise) < 0.5 * len(drive) or (from_zero and size[0] > 0.1 * size[top]):
        return False
    way = float(np.sum(np.abs(np.diff(rise))))
    straight = np.corrcoef(np.arange(len(rise)), rise)[0, 1] if len(rise) > 2 else 0.0
    return way < 1.2 * abs(rise[-1] - rise[0]) and abs(float(straight)) > 0.98


def constant_run(drive: FloatArray) -> tuple[int, int]:
    """Longest interval [start, stop) in which the drive stays at its level.

    The tolerance is 1 % of the largest drive, or five times its noise where it was measured.
    """
    n = len(drive)
    level = float(np.median(drive[n // 2 :])) if n else 0.0
    return signals.longest_run(np.abs(drive - level) <= level_tolerance(drive))


def level_tolerance(drive: FloatArray) -> float:
    """The variation of a drive (n,) at one level."""
    noise = signals.noise_floor(drive).noise if len(np.unique(drive)) > 10 else 0.0
    return max(_CONSTANT * float(np.max(np.abs(drive))), 5.0 * noise)
