"""Effects of the sensors: what a log shows compared with the true values.

They act through `measure`, on numpy arrays (n,) by log-format names; a channel that is
absent stays absent. In a closed loop they act through `sense`, a sample at a time. The ambient
pressure, which is no channel, acts as a parameter.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid import signals
from sysid.io.channels import SIDES, VELOCITY_CHANNELS
from sysid.plant.base import LEAST_DIVISOR, Array, Parameters, array_namespace
from sysid.plant.effects.entry import CatalogueEffect, Quantity, bent, either, of_side
from sysid.types import FloatArray

# What a critically damped lag lacks of its second order: its stages are never equal, as the root of
# zero has no derivative.
_APART = 1e-8


def lagged(values: Array, time: Array, lag: float, second: float = 0.0) -> FloatArray:
    """Exact lag of a signal that is linear between its samples; starts at rest.

    `values` (n,), `time` (n,) s increasing, evenly or not, `lag` s, 0 for none, and that of a
    `second` stage, no longer.
    """
    shown = np.array(values, dtype=float)
    if lag <= 0.0 or len(shown) < 2 or not np.any(shown != shown[0]):
        return shown
    step = np.diff(time)
    forgets = -np.expm1(-step / lag)
    # How far the lagged signal is behind: it decays, and the slope feeds it.
    fed = np.diff(shown) * (lag / step) * forgets
    behind = signals.recursion(1.0 - forgets, fed)
    if second > 0.0:
        before = np.concatenate([[0.0], behind[:-1]])
        fed = _fed_second(before, np.diff(shown) / step, step, lag, second)
        behind = signals.recursion(np.exp(-step / second), fed)
    shown[1:] -= behind
    return shown


def _fed_second(first: Array, slope: Array, step: Array, lag: Array, second: Array) -> Array:
    """What a step adds to how far a second stage is behind what the first one is fed.

    `first`: how far the first stage was behind before the step. It nears slope times `lag` as
    exp(-t/lag), which the second stage sees through its own exp(-t/second).
    """
    xp = array_namespace(first, lag, second)
    apart = xp.maximum(step / second - step / lag, LEAST_DIVISOR)
    carried = (step / second) * xp.exp(-step / lag) * -xp.expm1(-apart) / apart
    return (first - slope * lag) * carried - slope * (lag + second) * xp.expm1(-step / second)


def delayed(values: Array, time: Array, delay: float) -> FloatArray:
    """A signal `delay` s later (negative: earlier), linear between samples, held at its ends."""
    at = np.asarray(time, dtype=float)
    result: FloatArray = np.interp(at - delay, at, np.asarray(values, dtype=float))
    return result


def _changed_pressures(
    channels: Mapping[str, Array], chosen: str, change: Callable[[Array], Array]
) -> dict[str, Array]:
    """The channels with the pressures of the chosen side changed."""
    found = dict(channels)
    for side in SIDES:
        name = f"pressure_{side}_pa"
        if of_side(side, chosen) and name in found:
            found[name] = change(found[name])
    return found


def _pressures(channels: Mapping[str, Array], chosen: str) -> list[Array]:
    """The pressures of the chosen side that are there, in the order of `_changed_pressures`."""
    names = [f"pressure_{side}_pa" for side in SIDES if of_side(side, chosen)]
    return [channels[name] for name in names if name in channels]


def position_channels(channels: Mapping[str, Array]) -> list[str]:
    """The position's name, where it is there."""
    return [name for name in VELOCITY_CHANNELS if name in channels]


@dataclass(frozen=True)
class PressureOffset(CatalogueEffect):
    """A pressure sensor shows P + d."""

    pressure_offset_pa: Array = 0.0
    side: str = "both"

    id = "pressure-offset"
    forgets_in_gaps = True
    measures_each_row = True
    title = "Offset of a pressure sensor"
    subsystem = "sensor"
    quantities = (
        Quantity("pressure_offset_pa", "Pa", 1.7e3, -2e4, 2e4, "added to the true pressure"),
    )
    signature = "constant difference of a pressure"
    rivals = ("pressure-gain",)
    tie_breaker = "read the sensor at two known pressures"
    source = "textbook: static errors of a sensor"

    def measure(self, channels: Mapping[str, Array], time: Array) -> dict[str, Array]:
        return _changed_pressures(channels, self.side, lambda p: p + self.pressure_offset_pa)


@dataclass(frozen=True)
class PressureGain(CatalogueEffect):
    """A pressure sensor shows P + d (P - zero), P absolute; a gauge's zero is the ambient's."""

    pressure_gain_error: Array = 0.0
    side: str = "both"
    gain_zero_pa: Array = 0.0

    id = "pressure-gain"
    forgets_in_gaps = True
    measures_each_row = True
    title = "Gain of a pressure sensor"
    subsystem = "sensor"
    quantities = (
        Quantity("pressure_gain_error", "-", 5e-3, -0.1, 0.1, "relative error of the gain"),
        Quantity(
            "gain_zero_pa",
            "Pa",
            0.0,
            0.0,
            1.1e5,
            "absolute pressure that the sensor shows rightly",
            is_strength=False,
            grid=(0.0, 101_325.0),
            absent=0.0,
        ),
    )
    signature = "difference proportional to a pressure"
    rivals = ("pressure-offset",)
    tie_breaker = "read the sensor at two known pressures"
    source = "textbook: static errors of a sensor"

    def measure(self, channels: Mapping[str, Array], time: Array) -> dict[str, Array]:
        gain, zero = self.pressure_gain_error, self.gain_zero_pa
        return _changed_pressures(channels, self.side, lambda p: p + gain * (p - zero))


@dataclass(frozen=True)
class PressureLag(CatalogueEffect):
    """A pressure sensor lags, by first or second order; it is at rest at the first sample.

    1 + T s + q (T s)^2 / 4 in its denominator: of first order with q = 0, critically damped with
    q = 1 (a sensor and its filter, or a sensor on a tube). Two stages one after the other.
    """

    pressure_lag_s: Array = 0.0
    side: str = "both"
    second_order_share: Array = 0.0

    id = "pressure-lag"
    forgets_in_gaps = True
    title = "Lag of a pressure sensor"
    subsystem = "sensor"
    quantities = (
        Quantity("pressure_lag_s", "s", 2e-3, 0.0, 0.05, "time constant of the sensor"),
        bent(
            "second_order_share",
            0.0,
            0.0,
            1.0,
            "0: of first order, 1: of second order, critically damped",
            "share of second order in the lag",
            ((0.0, "of first order"), (1.0, "of second order, critically damped")),
        ),
    )
    signature = "timing of a pressure at valve edges"
    rivals = ("time-skew", "tube-lag", "valve-delay")
    tie_breaker = "a second, faster sensor at the same chamber"
    source = "textbook: first-order sensor, two in series"

    def _stages(self) -> tuple[Array, Array]:
        """The time constants, s."""
        xp = array_namespace(self.pressure_lag_s, self.second_order_share)
        apart = xp.sqrt(1.0 - (1.0 - _APART) * self.second_order_share)
        return 0.5 * self.pressure_lag_s * (1.0 + apart), 0.5 * self.pressure_lag_s * (1.0 - apart)

    def measure(self, channels: Mapping[str, Array], time: Array) -> dict[str, Array]:
        first, second = map(float, self._stages())
        return _changed_pressures(channels, self.side, lambda p: lagged(p, time, first, second))

    def unmeasured(self, channels: Mapping[str, Array], time: Array) -> dict[str, Array]:
        """See `Effect`: a lag is behind by its time constant times the slope of what it shows."""

        def before(shown: Array) -> Array:
            for lag in map(float, self._stages()):
                shown = shown + lag * np.gradient(shown, time)
            return shown

        return _changed_pressures(channels, self.side, before)

    def start_sensing(self, channels: Mapping[str, Array], step: float) -> tuple[Array, ...]:
        """See `Effect`: of each pressure its last value and how far either stage is behind."""
        return tuple(row for p in _pressures(channels, self.side) for row in (p, 0.0 * p, 0.0 * p))

    def sense(
        self, channels: Mapping[str, Array], memory: tuple[Array, ...], time: Array, step: float
    ) -> tuple[dict[str, Array], tuple[Array, ...]]:
        """See `Effect`: the recursion of `lagged`."""
        xp = array_namespace(time, self.pressure_lag_s, self.second_order_share)
        lag, second = (stage + LEAST_DIVISOR for stage in self._stages())
        shown, kept = [], []
        rows = zip(memory[::3], memory[1::3], memory[2::3], strict=True)
        for p, (last, first, behind) in zip(_pressures(channels, self.side), rows, strict=True):
            slope = (p - last) / step
            fed = _fed_second(first, slope, step, lag, second)
            behind = xp.exp(-step / second) * behind + fed
            first = xp.exp(-step / lag) * first - slope * lag * xp.expm1(-step / lag)
            shown.append(p - behind)
            kept += [p, first, behind]
        rest = iter(shown)
        return _changed_pressures(channels, self.side, lambda _: next(rest)), tuple(kept)


@dataclass(frozen=True)
class TimeSkew(CatalogueEffect):
    """A pressure channel is late by d (negative: early), as one from another recorder would be."""

    time_skew_s: Array = 0.0
    side: str = "both"

    id = "time-skew"
    forgets_in_gaps = True
    title = "Pressure channel shifted in time"
    subsystem = "sensor"
    quantities = (Quantity("time_skew_s", "s", 2e-3, -0.02, 0.02, "delay of the channel"),)
    signature = "timing of a pressure at valve edges"
    rivals = ("pressure-lag", "tube-lag", "valve-delay")
    tie_breaker = "sweep the PWM frequency; feed one signal to both channels"
    source = "textbook: transport delay of a channel"

    def measure(self, channels: Mapping[str, Array], time: Array) -> dict[str, Array]:
        skew = float(self.time_skew_s)
        return _changed_pressures(channels, self.side, lambda p: delayed(p, time, skew))

    def unmeasured(self, channels: Mapping[str, Array], time: Array) -> dict[str, Array]:
        """See `Effect`: as much earlier."""
        skew = float(self.time_skew_s)
        return _changed_pressures(channels, self.side, lambda p: delayed(p, time, -skew))

    def start_sensing(self, channels: Mapping[str, Array], step: float) -> tuple[Array, ...]:
        """See `Effect`: each pressure's last values, newest first, (rows, lanes)."""
        longest = float(np.max(np.maximum(self.time_skew_s, 0.0)))
        rows = np.zeros((math.ceil(longest / step) + 2, 1))
        return tuple(rows + p for p in _pressures(channels, self.side))

    def sense(
        self, channels: Mapping[str, Array], memory: tuple[Array, ...], time: Array, step: float
    ) -> tuple[dict[str, Array], tuple[Array, ...]]:
        """See `Effect`; a channel that would be early is on time, as no loop sees ahead."""
        xp = array_namespace(time, self.time_skew_s)
        late = xp.maximum(self.time_skew_s, 0.0) / step
        shown, kept = [], []
        for p, last in zip(_pressures(channels, self.side), memory, strict=True):
            rows = xp.concatenate([p[None], last[:-1]])
            whole = xp.minimum(xp.floor(late), len(rows) - 2.0)
            place = (whole + 0.0 * p).astype(int)[None]
            newer, older = (xp.take_along_axis(rows, place + i, axis=0)[0] for i in (0, 1))
            shown.append(newer + (late - whole) * (older - newer))
            kept.append(rows)
        rest = iter(shown)
        return _changed_pressures(channels, self.side, lambda _: next(rest)), tuple(kept)


@dataclass(frozen=True)
class EncoderEccentricity(CatalogueEffect):
    """The encoder's disc is mounted off centre: theta + s sin theta + c cos theta."""

    encoder_sine_rad: Array = 0.0
    encoder_cosine_rad: Array = 0.0

    id = "encoder-eccentricity"
    title = "Eccentric encoder"
    subsystem = "sensor"
    quantities = (
        Quantity("encoder_sine_rad", "rad", 7e-4, -0.05, 0.05, "amplitude of sin theta"),
        Quantity("encoder_cosine_rad", "rad", 7e-4, -0.05, 0.05, "amplitude of cos theta"),
    )
    signature = "error of the angle, once per turn; often too small to see"
    tie_breaker = "turn the disc on its shaft and repeat a test"
    source = "textbook: eccentricity of an encoder's disc"

    def measure(self, channels: Mapping[str, Array], time: Array) -> dict[str, Array]:
        found = dict(channels)
        for name in position_channels(channels):
            true = found[name]
            xp = array_namespace(true, self.encoder_sine_rad)
            sine = self.encoder_sine_rad * xp.sin(true)
            found[name] = true + sine + self.encoder_cosine_rad * xp.cos(true)
        return found


@dataclass(frozen=True)
class LostCounts(CatalogueEffect):
    """The encoder loses counts in fast motion: a share d of what is beyond a speed.

    With `lost_of_all` it is that share of all counts while the motion is faster.
    """

    lost_share: Array = 0.0
    counted_speed_rad_per_s: Array = 1.0
    lost_of_all: Array = 0.0

    id = "lost-counts"
    title = "Encoder that loses counts"
    subsystem = "sensor"
    quantities = (
        Quantity("lost_share", "-", 0.1, 0.0, 1.0, "of the counts"),
        Quantity(
            "counted_speed_rad_per_s",
            "rad/s",
            1.0,
            0.05,
            100.0,
            "speed up to which every count is seen",
            is_strength=False,
            grid=(0.5, 1.0, 2.0, 4.0),
            jumps=True,
        ),
        either(
            "lost_of_all",
            "1: a share of all counts while it is faster; 0: of what is beyond the speed",
            "counts that are lost",
            ("a share of those beyond the speed", "a share of all while it is faster"),
        ),
    )
    signature = "angle that falls behind in fast motion and does not come back"
    rivals = ("pitch-eccentricity",)
    tie_breaker = "move fast to a stop and slowly back to the other: the stops must read the same"
    source = "textbook: frequency limit of an incremental encoder's counter"

    def measure(self, channels: Mapping[str, Array], time: Array) -> dict[str, Array]:
        found = dict(channels)
        for name in position_channels(channels):
            true = np.asarray(found[name], dtype=float)
            lost = self._lost(np, np.diff(true), np.diff(np.asarray(time, dtype=float)))
            found[name] = true - np.concatenate([[0.0], np.cumsum(lost)])[: len(true)]
        return found

    def start_sensing(self, channels: Mapping[str, Array], step: float) -> tuple[Array, ...]:
        """See `Effect`: the last true position and what was lost so far."""
        return tuple(
            row for n in position_channels(channels) for row in (channels[n], 0.0 * channels[n])
        )

    def sense(
        self, channels: Mapping[str, Array], memory: tuple[Array, ...], time: Array, step: float
    ) -> tuple[dict[str, Array], tuple[Array, ...]]:
        """See `Effect`."""
        found, kept = dict(channels), []
        for name, last, lost in zip(
            position_channels(channels), memory[::2], memory[1::2], strict=True
        ):
            true = channels[name]
            lost = lost + self._lost(array_namespace(true, self.lost_share), true - last, step)
            found[name] = true - lost
            kept += [true, lost]
        return found, tuple(kept)

    def _lost(self, xp: Any, moved: Array, step: Array) -> Array:
        beyond = xp.maximum(xp.abs(moved) - self.counted_speed_rad_per_s * step, 0.0)
        whole = xp.where(beyond > 0.0, xp.abs(moved), 0.0)
        return self.lost_share * (beyond + self.lost_of_all * (whole - beyond)) * xp.sign(moved)


@dataclass(frozen=True)
class AmbientPressureError(CatalogueEffect):
    """Atmospheric pressure differs from the declared one: P0 + d."""

    ambient_pressure_pa: Array = 0.0

    id = "ambient-pressure-error"
    title = "Atmospheric pressure differs from its declared value"
    subsystem = "sensor"
    quantities = (
        Quantity("ambient_pressure_pa", "Pa", 1e3, -1e4, 1e4, "added to the declared pressure"),
    )
    signature = "constant torque; exhaust that ends at a different pressure"
    rivals = ("torque-offset", "asymmetric-coulomb-friction", "mounting-tilt", "area-error")
    tie_breaker = "read a barometer"
    source = "thesis 3.3.3 and 3.6.10"

    def parameters(self, parameters: Parameters, time: Array) -> Parameters:
        return parameters.replace(atmosphere=parameters.atmosphere + self.ambient_pressure_pa)


EFFECTS: tuple[type[CatalogueEffect], ...] = (
    PressureOffset,
    PressureGain,
    PressureLag,
    TimeSkew,
    EncoderEccentricity,
    LostCounts,
    AmbientPressureError,
)
