"""A trial as used by the friction fits: even samples, separate efforts, and its kind.

"Effort" is torque (Nm) on a rotary rig and force (N) on a linear one; "position" is rad
or m accordingly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid import signals
from sysid.errors import InputError
from sysid.estimation.quality import LeftOut, root_mean_square
from sysid.io.channels import CHAMBER_PRESSURES, VALVE_COMMANDS
from sysid.io.logs import Trial
from sysid.io.measured_speed import place_needed, velocity_channel, with_position
from sysid.io.rig import Rig
from sysid.plant.base import cylinder_effort, gravity_effort
from sysid.types import FloatArray

STATIC, SLIDING, MOTION = "friction-static", "friction-sliding", "friction-motion"
KINDS = (STATIC, SLIDING, MOTION)
# Samples within this share of the stroke from an end are not part of the model (log-format.md).
END_MARGIN = 0.01
MIN_SAMPLES = 50
# A shaft moves where it crosses this share of its travel.
_MOVES = 0.02
BLOCK_S = 0.05  # blocks over which speeds are averaged
_PUSHED = 0.3  # correlation of speed and push


@dataclass(frozen=True)
class EvenTrial:
    """One trial on an even time grid, all arrays (n,).

    `motor`, `cylinder` and `gravity` are efforts as in thesis 3.3.7: the first two drive,
    the third resists. `limit` is the largest |position| at a sufficient distance from an end stop
    (infinite where the rig declares no stroke). `stride`: samples whose errors are shared;
    `spline`: samples from one reading to the next of a position on a spline through them, else 0.
    `lost`: samples in pauses of the recording, of which nothing is known. `speed_noise`: of the
    measured speed whose integral the position is; None where the position was measured.
    `has_its_start`: whether the test's first row is its own, or it follows what is excluded.
    `added_inertia`: what its payload is more than the rig file's, kg m2 or kg.
    """

    label: str
    source: str
    period: float
    time: FloatArray
    position: FloatArray
    motor: FloatArray
    cylinder: FloatArray
    gravity: FloatArray
    limit: float
    travel: float | None
    lost: NDArray[np.bool_]
    valves_move: bool = False
    valves_on: bool = False
    has_motor: bool = True
    stride: int = 1
    spline: float = 0.0
    speed_noise: signals.NoiseFloor | None = None
    has_its_start: bool = True
    added_inertia: float = 0.0

    def __len__(self) -> int:
        return len(self.time)

    def part(self, start: int, stop: int, label: str) -> EvenTrial:
        """The rows [start, stop) as a trial of their own."""
        rows = slice(start, stop)
        own = {
            name: getattr(self, name)[rows]
            for name in ("position", "motor", "cylinder", "gravity", "lost")
        }
        time = self.time[rows] - self.time[start]
        return replace(self, label=label, time=time, **own)

    @property
    def applied(self) -> FloatArray:
        """What friction and inertia balance: motor + cylinder - gravity (3.4.2)."""
        return self.motor + self.cylinder - self.gravity

    @cached_property
    def position_noise(self) -> signals.NoiseFloor:
        """Of a speed's integral: how far it has drifted by the end."""
        if self.speed_noise is not None:
            return signals.NoiseFloor(self.drift(len(self)), 0.0)
        return signals.noise_floor(self.position, stride=self.stride)

    def drift(self, samples: int) -> float:
        """Noise of the position, of a speed's integral as it grows over so many samples."""
        if self.speed_noise is not None:
            return self.speed_noise.total * self.period * math.sqrt(samples)
        return self.position_noise.total

    def mean_speed_noise(self, samples: int) -> float:
        """Noise of the mean speed over so many samples."""
        if self.speed_noise is not None:
            return self.speed_noise.total / math.sqrt(samples)
        return self.position_noise.total / (samples * self.period)

    @property
    def inside(self) -> NDArray[np.bool_]:
        """Samples that are far enough from both end stops."""
        return np.asarray(np.abs(self.position) < self.limit)


@dataclass
class TrialUse:
    """The outcome of one trial: used, or left out and why, and the values read from it.

    `has_stopped`: a ramp's effort had stopped growing before the shaft moved.
    """

    label: str
    source: str
    kind: str
    used: bool = True
    reason: str = ""
    values: dict[str, float] = field(default_factory=dict)
    has_stopped: bool = False

    @property
    def title(self) -> str:
        """ "test 3", or the file of a test without a label."""
        return f"test {self.label}" if self.label else Path(self.source).name

    def leave_out(self, reason: str) -> None:
        self.used, self.reason = False, reason

    def to_json(self) -> dict[str, Any]:
        name = self.label or Path(self.source).name
        table: dict[str, Any] = {"test": name, "kind": self.kind, "used": self.used}
        if self.reason:
            table["reason"] = self.reason
        return table | self.values


def pause_line(trial: Trial) -> str | None:
    """What a notice says of the pauses of a trial's recording; None where it has none."""
    after = signals.pauses(trial.time)
    if not len(after):
        return None
    length, at = np.diff(trial.time)[after], float(trial.time[after[0]])
    more = f" and {len(after) - 1} more pauses" if len(after) > 1 else ""
    return (
        f"no sample for {length[0]:.3g} s at {at:.6g} s{more}: what lies in it is unknown, and not "
        "used"
    )


def left_out_lines(uses: Sequence[TrialUse]) -> list[str]:
    """Each reason for leaving tests out, once, with their number and their names."""
    left_out = by_reason([use for use in uses if not use.used])
    return [f"{len(own)} left out ({titles(own)}): {why}" for why, own in left_out.items()]


def tests_left_out(uses: Sequence[TrialUse], asked: tuple[FloatArray, FloatArray]) -> LeftOut:
    """What a fit left out of its tests; `asked`: what was measured in, and what the law leaves of,
    the tests (n,) that it can be asked about, used or not."""
    measured, left = asked
    used = sum(use.used for use in uses)
    unasked = len(uses) - max(len(measured), used)
    out = LeftOut("tests", len(uses) - used, len(uses), unasked)
    if len(measured) <= used:
        return out
    size = root_mean_square(measured)
    return replace(out, rmse=root_mean_square(left), spread=size)


def against_motion(uses: Sequence[TrialUse]) -> bool:
    """Whether the effort works against the motion in most of the tests that tell."""
    works = [work for use in uses if (work := _work(use.values)) is not None]
    return 2 * sum(work < 0.0 for work in works) > len(works)


def _work(values: Mapping[str, float]) -> float | None:
    """What friction takes, or a ramp's effort gives; below zero where that cannot be."""
    if "breakaway" in values:
        return values["breakaway"] * values["direction"]
    return values["friction"] * values["speed"] if "friction" in values else None


def by_reason(uses: Sequence[TrialUse]) -> dict[str, list[TrialUse]]:
    """The tests by the reason for leaving them out, in the order of the first of each."""
    groups: dict[str, list[TrialUse]] = {}
    for use in uses:
        groups.setdefault(use.reason, []).append(use)
    return groups


def titles(uses: Sequence[TrialUse]) -> str:
    """ "tests 1, 2, 3"; those without a label by their files."""
    labels = [use.label for use in uses if use.label]
    files = [use.title for use in uses if not use.label]
    named = [f"test{'s' * (len(labels) > 1)} {', '.join(labels)}"] if labels else []
    return ", ".join([*named, *files])


def even_trial(trial: Trial, rig: Rig, notices: list[str]) -> EvenTrial:
    """Resample a trial and separate its efforts; InputError where a channel is missing.

    Missing pressures are set to P0, with a notice, as the log format specifies.
    """
    trial = with_position(trial, rig)
    trial.require([rig.position_channel], "and friction cannot be identified without motion")
    if not rig.air_alone_drives(trial.channels):
        trial.require([rig.effort_channel], "and the motor's effort is what friction balances")
    grid = signals.uniform_grid(trial.time)

    def even(name: str, hold: bool = False) -> FloatArray:
        return signals.resample(trial.time, trial[name], grid, hold=hold)

    position = even(rig.position_channel)
    has_motor = rig.effort_channel in trial
    motor = even(rig.effort_channel, hold=True) if has_motor else np.zeros(len(grid))
    if rig.max_effort is not None:
        motor = np.clip(motor, -rig.max_effort, rig.max_effort)
    moment = rig.carrying(trial.payload_kg).gravity_moment()
    weights = (0.0, moment) if rig.is_linear else (moment, 0.0)
    gravity = np.asarray(gravity_effort(position, *weights)) + np.zeros(len(grid))
    travel = rig.travel
    return EvenTrial(
        label=trial.label,
        source=trial.source,
        period=float(grid[1] - grid[0]) if len(grid) > 1 else math.nan,
        time=grid - grid[0],
        position=position,
        motor=motor,
        cylinder=_cylinder(trial, rig, even, len(grid), notices),
        gravity=gravity,
        limit=(
            (0.5 - END_MARGIN) * travel if travel is not None and trial.place_known else math.inf
        ),
        travel=travel,
        lost=signals.in_pauses(trial.time, grid),
        stride=trial.stride_of(rig.position_channel),
        spline=trial.slow.get(rig.position_channel, 0.0) / trial.period,
        speed_noise=_speed_noise(trial, rig),
        has_its_start=trial.has_its_start,
        has_motor=has_motor,
        valves_on=any(name in trial and np.any(trial[name]) for name in VALVE_COMMANDS),
        added_inertia=float(rig.load_of(trial.payload_kg).inertia),
        valves_move=any(name in trial and np.ptp(trial[name]) > 0.0 for name in VALVE_COMMANDS),
    )


def _speed_noise(trial: Trial, rig: Rig) -> signals.NoiseFloor | None:
    """Of the measured speed that a trial's position is the integral of; None for another."""
    if trial.place_known or len(trial) < MIN_SAMPLES:
        return None
    return signals.noise_floor(trial[velocity_channel(rig)], stride=trial.stride)


def _cylinder(trial: Trial, rig: Rig, even: Any, n: int, notices: list[str]) -> FloatArray:
    present = [name for name in CHAMBER_PRESSURES if name in trial]
    if rig.cylinder is None:
        if present:
            _say(notices, "the rig file has no [cylinder]: the logged pressures are not used")
        return np.zeros(n)
    if len(present) < 2:
        missing = ", ".join(name for name in CHAMBER_PRESSURES if name not in trial)
        _say(notices, f"{missing} not logged: the chamber is assumed to be at P0")
    if not present:
        return np.zeros(n)
    way = float(np.ptp(trial[rig.position_channel]))
    moves = len(trial) >= MIN_SAMPLES and way > 0.0 and way >= _MOVES * (rig.travel or 0.0)
    for name in present:
        if moves and np.ptp(trial[name]) == 0.0:
            _say(
                notices,
                f"{name} never changes though the shaft moves: is its sensor connected? What the "
                "air does to the motion is taken for friction",
            )
    air = rig.require("air", "and the cylinder's effort is relative to atmospheric pressure")
    p0 = float(air.atmospheric_pressure_pa)
    a, b = (even(name) if name in trial else np.full(n, p0) for name in CHAMBER_PRESSURES)
    c = rig.cylinder
    return np.asarray(cylinder_effort(a, b, c.area_a_m2, c.area_b_m2, p0, c.pitch_radius_m))


def _say(notices: list[str], text: str) -> None:
    if text not in notices:
        notices.append(text)


def balances(trial: Trial, rig: Rig) -> bool:
    """Whether a motion trial has every channel of the balance that friction closes: without a
    pressure, what the cylinder does would be taken for friction."""
    pressures = () if rig.cylinder is None else CHAMBER_PRESSURES
    shows_motion = rig.position_channel in trial or (
        velocity_channel(rig) in trial and place_needed(rig) is None
    )
    return shows_motion and all(c in trial for c in (rig.effort_channel, *pressures))


def classify_trial(trial: Trial, rig: Rig) -> str:
    """`friction-static`, `friction-sliding` or `friction-motion`, by the trial's content.

    Static: the motor's effort grows from zero, without falling back, for most of the test.
    Sliding: it is constant to within 1 % for at least half of the test. A test in which a
    valve moves, and any other test, is motion. Of a ramp whose start is excluded the rest is one.
    """
    try:
        even = even_trial(trial, rig, [])
    except InputError:
        return MOTION
    return classify(even)


def classify(trial: EvenTrial) -> str:
    """`classify_trial` of a trial that is already even."""
    drive = trial.motor
    if trial.valves_move or len(trial) < MIN_SAMPLES or not np.any(drive):
        return MOTION
    if _is_ramp(drive, trial.has_its_start):
        return STATIC
    start, stop = constant_run(drive)
    return SLIDING if stop - start >= 0.5 * len(drive) and drive[start] != 0.0 else MOTION


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
    """What a drive (n,) may vary by at one level."""
    noise = signals.noise_floor(drive).noise if len(np.unique(drive)) > 10 else 0.0
    return max(0.01 * float(np.max(np.abs(drive))), 5.0 * noise)


def pushed_along(trials: Sequence[EvenTrial]) -> str | None:
    """A notice where the chambers' air pushes the motion along though only the motor drives it.

    Air that breathes through open exhausts resists: its effort and the speed have opposite signs
    in the mean over all trials. None where they do, or where the trials do not tell.
    """
    pairs = [_blocks(t) for t in trials if not t.valves_move and np.any(t.motor)]
    pairs = [(v, c) for v, c in pairs if np.any(c)]
    if not pairs:
        return None
    speed, push = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    size = math.sqrt(float(speed @ speed) * float(push @ push))
    if size == 0.0 or float(speed @ push) < _PUSHED * size:
        return None
    return (
        "the chambers' pressures push the motion along though only the motor drives it: are "
        "pressure_a_pa and pressure_b_pa swapped, or is the position's sign reversed?"
    )


def _blocks(trial: EvenTrial) -> tuple[FloatArray, FloatArray]:
    """Mean speed and mean effort of the cylinder over blocks of 50 ms, (m,) each."""
    size = max(1, round(BLOCK_S / trial.period))
    count = (len(trial) - 1) // size
    marks = size * np.arange(count + 1)
    push = trial.cylinder[: count * size].reshape(count, size).mean(axis=1)
    return np.diff(trial.position[marks]) / (size * trial.period), push
