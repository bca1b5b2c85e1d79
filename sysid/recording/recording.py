"""One test on a time grid: what every fit, balance and check of a motion is computed from.

"Effort" is torque (Nm) on a rotary rig and force (N) on a linear one; "position" is rad
or m accordingly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sysid import signals
from sysid.io.channels import CHAMBER_PRESSURES, DUTIES, VALVE_COMMANDS
from sysid.io.rig import END_MARGIN, Load, Rig
from sysid.io.samples import Trial, with_channels
from sysid.plant.base import cylinder_effort, gravity_effort, spring_effort
from sysid.types import BoolArray, FloatArray


@dataclass(frozen=True)
class Recording:
    """One test, its channels (n,) by their names in the log format, SI, on one time grid.

    `trial` holds the channels, with the test's label, source, payload and what is excluded of it.
    `period` s. `lost` (n,): samples in pauses of the recording, where no values are known.
    `gravity_moment`: of what the test carries, Nm, or the weight in N on a linear rig.
    `stride`: samples of the position whose errors are shared; `spline`: samples from one reading to
    the next of a position on a spline through them, else 0. `speed_noise`: of the measured speed
    whose integral the position is; None where the position was measured.
    """

    trial: Trial
    rig: Rig
    period: float
    lost: BoolArray
    gravity_moment: float = 0.0
    stride: int = 1
    spline: float = 0.0
    speed_noise: signals.NoiseFloor | None = None

    def __len__(self) -> int:
        return len(self.trial)

    def __contains__(self, channel: str) -> bool:
        return channel in self.trial

    def __getitem__(self, channel: str) -> FloatArray:
        return self.trial[channel]

    @property
    def label(self) -> str:
        return self.trial.label

    @property
    def source(self) -> str:
        return self.trial.source

    @cached_property
    def time(self) -> FloatArray:
        """(n,) s from the first sample on."""
        return np.asarray(self.trial.time - self.trial.time[0])

    @property
    def since_start(self) -> FloatArray:
        """(n,) s since the test's start, what is excluded of it counted."""
        return np.asarray(self.time + self.trial.begun_s)

    def named(self, label: str) -> Recording:
        """The same under another label."""
        return replace(self, trial=replace(self.trial, label=label))

    def part(self, start: int, stop: int, label: str) -> Recording:
        """The samples [start, stop) as a separate recording."""
        rows = slice(start, stop)
        channels = {name: values[rows] for name, values in self.trial.channels.items()}
        trial = replace(self.trial, label=label, time=self.time[rows], channels=channels)
        return replace(self, trial=trial, lost=self.lost[rows])

    def with_position(self, position: FloatArray) -> Recording:
        """The same with another position (n,), and what depends on it."""
        return replace(
            self, trial=with_channels(self.trial, **{self.rig.position_channel: position})
        )

    # --- motion ---------------------------------------------------------------------------

    @property
    def position(self) -> FloatArray:
        """(n,) rad or m."""
        return self.trial[self.rig.position_channel]

    @cached_property
    def near_stop(self) -> BoolArray:
        """Samples (n,) too near an end stop to count; none where the stroke, or the place in it, is
        not known."""
        travel = self.rig.travel
        if travel is None or not self.trial.place_known:
            return np.zeros(len(self), dtype=bool)
        return np.asarray(np.abs(self.position) > (0.5 - END_MARGIN) * travel)

    @property
    def inside(self) -> BoolArray:
        """Samples (n,) at a sufficient distance from both end stops."""
        return ~self.near_stop

    @cached_property
    def position_noise(self) -> signals.NoiseFloor:
        """Noise of the position; of a speed's integral, its drift by the end."""
        if self.speed_noise is not None:
            return signals.NoiseFloor(self.drift(len(self)), 0.0)
        return signals.position_floor(self.position, self.stride)

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
    def highest_speed(self) -> float:
        """The highest speed, of the filtered position, rad/s or m/s."""
        return float(np.abs(signals.filtered_speed(self.position, self.period)).max())

    # --- efforts (thesis 3.3.7) -----------------------------------------------------------

    @property
    def has_motor(self) -> bool:
        return self.rig.effort_channel in self.trial

    @cached_property
    def commanded(self) -> FloatArray:
        """The effort (n,) that the motor is commanded; 0 where none is logged."""
        if not self.has_motor:
            return np.zeros(len(self))
        return np.asarray(self.trial[self.rig.effort_channel], dtype=float)

    @cached_property
    def motor(self) -> FloatArray:
        """The motor's effort (n,), within its limit."""
        limit = self.rig.max_effort
        return self.commanded if limit is None else np.clip(self.commanded, -limit, limit)

    def pressure(self, channel: str) -> FloatArray:
        """A chamber's pressure (n,) Pa; the atmosphere's where it is not logged."""
        if channel in self.trial:
            return self.trial[channel]
        air = self.rig.require("air", "and the cylinder's effort is relative to its pressure")
        return np.full(len(self), float(air.atmospheric_pressure_pa))

    @cached_property
    def cylinder(self) -> FloatArray:
        """The cylinder's effort (n,); 0 without a cylinder, or where no pressure is logged."""
        c = self.rig.cylinder
        if c is None or not any(name in self.trial for name in self.rig.pressure_channels):
            return np.zeros(len(self))
        air = self.rig.require("air", "and the cylinder's effort is relative to its pressure")
        p0 = float(air.atmospheric_pressure_pa)
        a, b = map(self.pressure, CHAMBER_PRESSURES)
        return np.asarray(cylinder_effort(a, b, c.area_a_m2, c.area_b_m2, p0, c.pitch_radius_m))

    @cached_property
    def load_effort(self) -> FloatArray:
        """The effort (n,) of gravity and a return spring, which resists positive motion."""
        moment, linear, spring = self.gravity_moment, self.rig.is_linear, self.rig.spring_law
        weights = (0.0, moment) if linear else (moment, 0.0)
        gravity = np.asarray(gravity_effort(self.position, *weights)) + np.zeros(len(self))
        return gravity if spring is None else gravity + spring_effort(self.position, *spring)

    @property
    def applied(self) -> FloatArray:
        """The effort (n,) that friction and inertia balance: motor + cylinder - load (3.4.2)."""
        return self.motor + self.cylinder - self.load_effort

    @property
    def load(self) -> Load:
        """What the test carries in addition to the rig file's payload."""
        return self.rig.load_of(self.trial.payload_kg)

    @property
    def added_inertia(self) -> float:
        """The test's payload less the rig file's, kg m2 or kg."""
        return float(self.load.inertia)

    # --- valves ---------------------------------------------------------------------------

    @property
    def valves_on(self) -> bool:
        """Whether a valve is on at any time."""
        return any(name in self and bool(np.any(self[name])) for name in VALVE_COMMANDS)

    @property
    def is_pulsed(self) -> bool:
        """Whether a valve is ever switched within a PWM period."""
        found = (self[name] for name in DUTIES if name in self)
        return any(bool(np.any((duty > 0.0) & (duty < 1.0))) for duty in found)

    @property
    def valves_move(self) -> bool:
        """Whether a valve's command ever changes."""
        return any(name in self and bool(np.ptp(self[name]) > 0.0) for name in VALVE_COMMANDS)


__all__ = ["Recording"]
