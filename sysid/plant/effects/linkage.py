"""Effects between cylinder, motor and load: geometry, gears, springs, inertia."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from sysid import signals
from sysid.io.channels import VELOCITY_CHANNELS
from sysid.plant.base import (
    LEAST_DIVISOR,
    MAX_STEP,
    Array,
    Parameters,
    array_namespace,
    cylinder_effort,
    gravity_effort,
    is_zero,
    limit_effort,
)
from sysid.plant.effects.entry import CatalogueEffect, Quantity, bent, either
from sysid.plant.effects.sensor import lagged, position_channels
from sysid.plant.ports import Point

# Backlash: the least inertia behind it (share), the gap from which on it is all the motor's, rad;
# a flank's stiffness, as the rate at which the motor oscillates on it, rad/s, and damping ratio: as
# stiff as steps of 1 ms follow, and as a measured position, differentiated, lets it be.
_LEAST_SHARE = 0.01
_LEAST_GAP = 1e-5
_CONTACT_RATE = 2.0 * math.pi * 60.0
_CONTACT_DAMPING = 0.5
LEAST_INERTIA = 0.02
"""What a mismatch leaves of the declared inertia at least."""
# Share of the inertia behind a link's spring from which on it carries all that gravity pulls at:
# one near 0 would hang down on its spring.
_LEAST_CARRYING = 0.1
# Through these a flexible link acts where the encoder is behind its spring.
_SENSOR_PORTS = ("measure", "unmeasured", "sense", "start_sensing")


@dataclass(frozen=True)
class Backlash(CatalogueEffect):
    """A dead gap in the motor's gear: the motor's torque is lost while the gap is crossed.

    The state is the place in the gap, -1 to 1, which tends to the flank that the motor pushes
    against, at a rate proportional to its torque: nine tenths of the gap take
    gap / (crossing_speed * torque in Nm). At that flank the motor gives all of its torque,
    further away none. No rate is faster than the simulator can follow; where the motor's is,
    the loss is weighted so that the lost impulse stays right to first order, and 0 at no gap.

    With a motor_share of the inertia behind the gap (from 1 % on) the motor crosses it by its
    own inertia instead, and what it gained there it gives back in the impact: no impulse is
    lost. Its angle and speed are states; a flank pushes as a damped spring at which the motor
    would oscillate at 60 Hz, and does not pull. A gap below 1e-5 rad acts in proportion.
    """

    gap_rad: Array = 0.0
    crossing_speed_rad_per_s: Array = 2.0
    motor_share: Array = 0.0
    states = ("backlash_place", "backlash_motor_rad", "backlash_motor_rad_per_s")
    fastest_rate = _CONTACT_RATE

    id = "backlash"
    title = "Backlash in the motor's gear"
    subsystem = "mechanics"
    quantities = (
        Quantity(
            "gap_rad",
            "rad",
            0.004,
            0.0,
            0.1,
            "dead gap at the output shaft",
            grid=(1.5e-3, 4e-3),
        ),
        Quantity(
            "crossing_speed_rad_per_s",
            "rad/s",
            2.0,
            0.1,
            50.0,
            "speed in the gap under 1 Nm of motor torque, without inertia behind it",
            is_strength=False,
            grid=(0.5, 2.0, 8.0),
            radius_power=2.0,
        ),
        Quantity(
            "motor_share",
            "-",
            0.0,
            0.0,
            0.5,
            "share of the inertia behind the gap; below 0.01: none",
            is_strength=False,
            grid=(0.0, 0.1),
            absent=0.0,
            jumps=True,
        ),
    )
    signature = "pulses where the motor's torque reverses"
    rivals = ("amplifier-lag",)
    tie_breaker = (
        "motor torque reversed slowly and quickly: the pulse of a lag scales with the rate"
    )
    source = "Nordin, Gutman, Automatica 38(10), 2002"

    def _push(self, point: Point) -> Array:
        """Rate towards the flank times the gap, rad/s: nine tenths are -1 to 0.8 of a gap."""
        xp = array_namespace(point.motor, self.gap_rad)
        return math.log(10.0) * self.crossing_speed_rad_per_s * xp.abs(point.motor)

    def _uncoupled(self) -> Array:
        """How much of the motor's inertia is on its own, 0 to 1: all of it behind a real gap."""
        xp = array_namespace(self.gap_rad, self.motor_share)
        has_inertia = xp.where(self.motor_share >= _LEAST_SHARE, 1.0, 0.0)
        return has_inertia * xp.minimum(self.gap_rad / _LEAST_GAP, 1.0)

    def _motor_inertia(self, point: Point) -> Array:
        xp = array_namespace(self.motor_share, point.parameters.inertia)
        whole = point.parameters.inertia / (1.0 - self._uncoupled() * self.motor_share)
        return xp.maximum(self.motor_share, _LEAST_SHARE) * whole

    def _contact_effort(self, point: Point) -> Array:
        """The effort of the touching flank on the shaft, Nm or N."""
        xp = array_namespace(point.position, self.gap_rad, point.extra["backlash_motor_rad"])
        ahead = point.extra["backlash_motor_rad"] - point.position
        faster = point.extra["backlash_motor_rad_per_s"] - point.velocity
        inertia, half = self._motor_inertia(point), 0.5 * self.gap_rad
        damping = 2.0 * _CONTACT_DAMPING * _CONTACT_RATE * inertia
        into = ahead - xp.clip(ahead, -half, half)
        pushed = inertia * _CONTACT_RATE * _CONTACT_RATE * into + damping * faster
        up = xp.where(into > 0.0, xp.maximum(pushed, 0.0), 0.0)
        return xp.where(into < 0.0, xp.minimum(pushed, 0.0), up)

    def parameters(self, parameters: Parameters, time: Array) -> Parameters:
        left = 1.0 - self._uncoupled() * self.motor_share
        return parameters.replace(inertia=parameters.inertia * left)

    def motor_effort(self, effort: Array, point: Point) -> Array:
        xp = array_namespace(effort, self.gap_rad)
        towards = xp.sign(effort)
        place = point.extra.get("backlash_place", towards)
        lost = xp.clip(10.0 * 0.5 * (1.0 - place * towards), 0.0, 1.0)
        fastest = self.gap_rad / MAX_STEP
        weight = xp.minimum(fastest / xp.maximum(self._push(point), LEAST_DIVISOR), 1.0)
        without = effort - effort * (weight * lost)
        if "backlash_motor_rad" not in point.extra:
            return without
        behind = effort + self._uncoupled() * (self._contact_effort(point) - effort)
        return xp.where(self.motor_share >= _LEAST_SHARE, behind, without)

    def initial_states(self, point: Point) -> dict[str, Array]:
        xp = array_namespace(point.motor)
        side = xp.sign(point.motor) + 0.0 * point.position
        return {
            "backlash_place": side,
            "backlash_motor_rad": point.position + 0.5 * self.gap_rad * side,
            "backlash_motor_rad_per_s": point.velocity + 0.0,
        }

    def state_rates(self, point: Point, flows: Mapping[str, Array]) -> dict[str, Array]:
        xp = array_namespace(point.motor, self.gap_rad)
        rate = xp.minimum(
            self._push(point) / xp.maximum(self.gap_rad, LEAST_DIVISOR), 1.0 / MAX_STEP
        )
        towards = xp.sign(point.motor)
        effort = limit_effort(point.motor, point.parameters.max_effort)
        pushed = (effort - self._contact_effort(point)) / self._motor_inertia(point)
        return {
            "backlash_place": rate * (towards - point.extra["backlash_place"]),
            "backlash_motor_rad": point.extra["backlash_motor_rad_per_s"],
            "backlash_motor_rad_per_s": pushed,
        }


def _second_harmonic(name: str, phase: str) -> Quantity:
    return bent(name, 0.0, -1.0, 1.0, f"second harmonic over the wave, {phase}")


@dataclass(frozen=True)
class GearMeshRipple(CatalogueEffect):
    """Torque that varies with the mesh of the rack: + s sin(n theta) + c cos(n theta).

    Teeth that change over twice a pitch, or are worn, add the second harmonic: of a wave
    A sin(x) that is A (a sin(2 x) + b cos(2 x)), a and b the shares of it.
    """

    mesh_sine_nm: Array = 0.0
    mesh_cosine_nm: Array = 0.0
    mesh_wave_per_rad: Array = 20.0
    second_sine: Array = 0.0
    second_cosine: Array = 0.0

    id = "gear-mesh-ripple"
    title = "Gear mesh ripple"
    subsystem = "mechanics"
    quantities = (
        Quantity("mesh_sine_nm", "Nm", 0.02, -0.5, 0.5, "amplitude of the sine"),
        Quantity("mesh_cosine_nm", "Nm", 0.02, -0.5, 0.5, "amplitude of the cosine"),
        Quantity(
            "mesh_wave_per_rad",
            "1/rad",
            20.0,
            5.0,
            120.0,
            "teeth per turn over 2 pi, or teeth of the pinion",
            is_strength=False,
            grid=tuple(float(n) for n in (*range(6, 30), *range(30, 62, 2), *range(64, 100, 4))),
            is_wave=True,
        ),
        _second_harmonic("second_sine", "in phase with the wave"),
        _second_harmonic("second_cosine", "a quarter of its own period ahead"),
    )
    signature = "a line in the torque's spectrum over angle"
    rivals = ("torque-ripple",)
    tie_breaker = "motion driven by the valves alone: a motor's ripple disappears"
    source = "Michalec, Precision Gearing, 1966"

    def external_effort(self, effort: Array, point: Point) -> Array:
        xp = array_namespace(point.position, self.mesh_sine_nm)
        phase = self.mesh_wave_per_rad * point.position
        sine, cosine = xp.sin(phase), xp.cos(phase)
        wave = self.mesh_sine_nm * sine + self.mesh_cosine_nm * cosine
        if is_zero(self.second_sine) and is_zero(self.second_cosine):
            return effort + wave
        ahead = self.mesh_sine_nm * cosine - self.mesh_cosine_nm * sine
        # Never zero: a root of zero has no derivative.
        height = xp.sqrt(self.mesh_sine_nm**2 + self.mesh_cosine_nm**2 + LEAST_DIVISOR**2)
        second = self.second_sine * 2.0 * wave * ahead
        second = second + self.second_cosine * (ahead**2 - wave**2)
        return effort + wave + second / height


@dataclass(frozen=True)
class PitchEccentricity(CatalogueEffect):
    """The pinion turns off its centre: r (1 + c cos theta + s sin theta), and y its integral.

    With `lever_arm_only` the piston's place stays as it was, and the rates of the volumes, as
    where the angle that is logged was worked out from it.
    """

    eccentricity_cosine: Array = 0.0
    eccentricity_sine: Array = 0.0
    lever_arm_only: Array = 0.0

    id = "pitch-eccentricity"
    title = "Eccentric pinion"
    subsystem = "mechanics"
    quantities = (
        Quantity("eccentricity_cosine", "-", 0.005, -0.2, 0.2, "relative, in phase with theta = 0"),
        Quantity("eccentricity_sine", "-", 0.005, -0.2, 0.2, "relative, a quarter turn off"),
        either(
            "lever_arm_only",
            "1: the lever arm alone varies; 0: the piston's place with it",
            "what varies",
            ("the lever arm, and the piston's place with it", "the lever arm alone"),
        ),
    )
    signature = "torque against the cylinder's torque times cos theta"
    rivals = ("torque-constant-error",)
    tie_breaker = "static weights at several angles"
    source = "thesis 3.3.3; Michalec, Precision Gearing, 1966"

    def _longer(self, point: Point) -> Array:
        """By how much the lever arm is longer, as a share."""
        xp = array_namespace(point.position, self.eccentricity_cosine)
        cosine, sine = xp.cos(point.position), xp.sin(point.position)
        return self.eccentricity_cosine * cosine + self.eccentricity_sine * sine

    def pitch_radius(self, radius: Array, point: Point) -> Array:
        longer = point.parameters.pitch_radius * self._longer(point)
        return radius + (1.0 - self.lever_arm_only) * longer

    def displacement(self, displacement: Array, point: Point) -> Array:
        xp = array_namespace(point.position, self.eccentricity_cosine)
        change = self.eccentricity_cosine * xp.sin(point.position) + self.eccentricity_sine * (
            1.0 - xp.cos(point.position)
        )
        moved = point.parameters.pitch_radius * change
        return displacement + (1.0 - self.lever_arm_only) * moved

    def external_effort(self, effort: Array, point: Point) -> Array:
        p = point.parameters
        more = cylinder_effort(
            point.pressure_a,
            point.pressure_b,
            p.area_a,
            p.area_b,
            p.atmosphere,
            p.pitch_radius * self._longer(point),
        )
        return effort + self.lever_arm_only * more

    def is_idle(self, port: str) -> bool:
        """See `Effect`: where the lever arm alone varies, neither the piston's place nor the
        volumes' rates follow it."""
        alone = self.lever_arm_only
        if not isinstance(alone, int | float | np.ndarray | np.generic):
            return False
        if port == "external_effort":
            return bool(np.all(alone == 0.0))
        return port in ("displacement", "pitch_radius") and bool(np.all(alone == 1.0))


@dataclass(frozen=True)
class LinkFlexibility(CatalogueEffect):
    """A share of the inertia is attached by a spring: a second inertia with a resonance.

    States: the sprung inertia's angle and speed. The share is the strength, and the shaft
    keeps the remainder; the resonance is that of the sprung inertia with the shaft held. The
    encoder is on the shaft, or behind the spring, where it shows the sprung inertia's angle: the
    twist that it sees depends on the resonance, and not on the share.

    The masses that gravity pulls at are behind the spring, as in a flexible joint: what they bend
    it by changes with the angle. Of a share below a tenth, which carries hardly all of them, in
    proportion; with the encoder behind the spring the bend by gravity is neglected.
    """

    flexible_share: Array = 0.0
    link_frequency_hz: Array = 25.0
    link_damping: Array = 0.03
    encoder_on_link: Array = 0.0
    states = ("link_angle_rad", "link_speed_rad_per_s")

    id = "link-flexibility"
    title = "Flexible link"
    subsystem = "mechanics"
    quantities = (
        Quantity("flexible_share", "-", 0.5, 0.0, 0.9, "share of the inertia behind the spring"),
        Quantity(
            "link_frequency_hz",
            "Hz",
            25.0,
            5.0,
            60.0,
            "resonance with the shaft held",
            is_strength=False,
            grid=(12.0, 18.0, 25.0, 35.0),
        ),
        Quantity(
            "link_damping", "-", 0.03, 0.0, 0.5, "damping ratio", is_strength=False, grid=(0.05,)
        ),
        either(
            "encoder_on_link",
            "1: the encoder is behind the spring; 0: on the shaft",
            "place of the encoder",
            ("on the shaft", "behind the spring"),
        ),
    )
    signature = "a resonance: torque that rings after every step"
    rivals = ("amplifier-lag", "inertia-mismatch")
    tie_breaker = "a tap on the link at rest"
    source = "Spong, ASME Journal of Dynamic Systems 109(4), 1987"

    def _hanging_share(self) -> Array:
        """Share of gravity's moment that acts on the sprung inertia, 0 to 1."""
        xp = array_namespace(self.flexible_share, self.encoder_on_link)
        return xp.minimum(self.flexible_share / _LEAST_CARRYING, 1.0) * (1.0 - self.encoder_on_link)

    def _weight_acceleration(self, position: Array, point: Point) -> Array:
        """Acceleration of the sprung inertia by gravity, at an angle of it, rad/s2."""
        xp = array_namespace(position, self.flexible_share)
        moment = point.parameters.gravity_moment
        if is_zero(moment):
            return 0.0 * position
        whole = point.parameters.inertia / (1.0 - self.flexible_share)
        sprung = xp.maximum(self.flexible_share, LEAST_DIVISOR) * whole
        return -self._hanging_share() * gravity_effort(position, moment) / sprung

    def _hanging_acceleration(self, point: Point) -> Array:
        """Acceleration of the sprung inertia by its spring, rad/s2."""
        rate = 2.0 * math.pi * self.link_frequency_hz
        bend = point.position - point.extra["link_angle_rad"]
        bending = point.velocity - point.extra["link_speed_rad_per_s"]
        return rate * rate * bend + 2.0 * self.link_damping * rate * bending

    def parameters(self, parameters: Parameters, time: Array) -> Parameters:
        return parameters.replace(inertia=parameters.inertia * (1.0 - self.flexible_share))

    def external_effort(self, effort: Array, point: Point) -> Array:
        if "link_angle_rad" not in point.extra:
            return effort
        # point.parameters holds the inertia that remains on the shaft, 1 - share of the whole.
        hanging = self.flexible_share / (1.0 - self.flexible_share) * point.parameters.inertia
        bent = effort - hanging * self._hanging_acceleration(point)
        # The shaft's equation counts gravity's moment as its own.
        moment = point.parameters.gravity_moment
        return bent + self._hanging_share() * gravity_effort(point.position, moment)

    def initial_states(self, point: Point) -> dict[str, Array]:
        rate = 2.0 * math.pi * self.link_frequency_hz
        return {
            "link_angle_rad": point.position
            + self._weight_acceleration(point.position, point) / (rate * rate),
            "link_speed_rad_per_s": point.velocity + 0.0,
        }

    def state_rates(self, point: Point, flows: Mapping[str, Array]) -> dict[str, Array]:
        return {
            "link_angle_rad": point.extra["link_speed_rad_per_s"],
            "link_speed_rad_per_s": self._hanging_acceleration(point)
            + self._weight_acceleration(point.extra["link_angle_rad"], point),
        }

    def is_idle(self, port: str) -> bool:
        """See `Effect`: an encoder on the shaft is no sensor's error, nor is one without a link."""
        numbers = self.encoder_on_link, self.flexible_share
        known = all(isinstance(n, int | float | np.ndarray | np.generic) for n in numbers)
        return port in _SENSOR_PORTS and known and not all(np.any(n) for n in numbers)

    def measure(self, channels: Mapping[str, Array], time: Array) -> dict[str, Array]:
        """See `Effect`: of a position that is linear between its samples; the sprung inertia
        begins with the shaft's speed."""
        found = dict(channels)
        if not (float(self.encoder_on_link) and float(self.flexible_share)):
            return found
        step = np.diff(np.asarray(time, dtype=float))
        for name in position_channels(channels):
            true = np.asarray(channels[name], dtype=float)
            if len(step) == 0:
                continue
            # The twist rings freely between the samples, and is struck where the speed changes.
            struck = np.diff(np.diff(true) / step, prepend=true[1] - true[0])
            struck[0] = 0.0
            pole = complex(*self._pole(np))
            forgets = np.exp(pole * step)
            ringing = signals.recursion(forgets, -struck * forgets)
            twist = np.concatenate([[0.0], ringing.imag / pole.imag])
            found[name] = true + twist
            if (speed := VELOCITY_CHANNELS[name]) in channels:
                rate = np.concatenate([[0.0], ringing.real]) + pole.real * twist
                found[speed] = channels[speed] + rate
        return found

    def unmeasured(self, channels: Mapping[str, Array], time: Array) -> dict[str, Array]:
        """See `Effect`: the spring's twist follows from the sprung inertia's acceleration."""
        found = dict(channels)
        period, rate = float(time[1] - time[0]), 2.0 * math.pi * float(self.link_frequency_hz)
        for name in position_channels(channels):
            bend = signals.second_derivative(channels[name], period) / rate**2
            found[name] = channels[name] + lagged(bend, time, 2.0 * self.link_damping / rate)
        return found

    def _pole(self, xp: Any) -> tuple[Array, Array]:
        """Pole of the free twist with the shaft held, 1/s: real and imaginary part."""
        rate = 2.0 * math.pi * self.link_frequency_hz
        return -self.link_damping * rate, rate * xp.sqrt(1.0 - self.link_damping**2)

    def start_sensing(self, channels: Mapping[str, Array], step: float) -> tuple[Array, ...]:
        """See `Effect`: the last position and speed, and the twist's ringing (its rate less the
        conjugate pole times it), real and imaginary part."""
        rows = []
        for name in position_channels(channels):
            nothing = 0.0 * channels[name]
            rows += [channels[name], nothing, nothing, nothing]
        return tuple(rows)

    def sense(
        self, channels: Mapping[str, Array], memory: tuple[Array, ...], time: Array, step: float
    ) -> tuple[dict[str, Array], tuple[Array, ...]]:
        """See `Effect`: the recursion of `measure`."""
        found, kept = dict(channels), []
        xp = array_namespace(time, self.link_frequency_hz, self.encoder_on_link)
        damping, rate = self._pole(xp)
        decay = xp.exp(damping * step)
        turn, across = decay * xp.cos(rate * step), decay * xp.sin(rate * step)
        is_seen = (self.encoder_on_link > 0.0) & (self.flexible_share > 0.0)
        rows = iter(memory)
        for name in position_channels(channels):
            last, speed, real, imag = (next(rows) for _ in range(4))
            after = (channels[name] - last) / step
            real = real - (after - speed)
            real, imag = turn * real - across * imag, across * real + turn * imag
            kept += [channels[name], after, real, imag]
            twist = imag / rate
            shown = {name: twist, VELOCITY_CHANNELS[name]: real + damping * twist}
            found |= {
                n: xp.where(is_seen, channels[n] + more, channels[n])
                for n, more in shown.items()
                if n in channels
            }
        return found, tuple(kept)


@dataclass(frozen=True)
class CableSpring(CatalogueEffect):
    """Cables and hoses pull the shaft back to where they are slack: - d (theta - rest)."""

    stiffness_nm_per_rad: Array = 0.0
    spring_rest_rad: Array = 0.0

    id = "cable-spring"
    title = "Spring of cables and hoses"
    subsystem = "mechanics"
    quantities: ClassVar[tuple[Quantity, ...]] = (
        Quantity("stiffness_nm_per_rad", "Nm/rad", 0.05, -0.5, 5.0, "torque per angle"),
        Quantity(
            "spring_rest_rad",
            "rad",
            0.0,
            -1.0,
            1.0,
            "angle at which the spring is slack",
            is_strength=False,
            grid=(-0.4, 0.0, 0.4),
            absent=0.0,
        ),
    )
    signature = "torque against angle"
    rivals = ("mounting-tilt", "position-dependent-friction")
    tie_breaker = "large angles: a spring's torque keeps growing, gravity's sine does not"
    source = "thesis 3.3.7, a term of the torque balance"

    def external_effort(self, effort: Array, point: Point) -> Array:
        return effort - self.stiffness_nm_per_rad * (point.position - self.spring_rest_rad)


@dataclass(frozen=True)
class SpringAtZero(CableSpring):
    """The same, slack at 0: for a law with a constant effort of its own, which says where it is."""

    quantities = tuple(q for q in CableSpring.quantities if q.is_strength)


@dataclass(frozen=True)
class MountingTilt(CatalogueEffect):
    """The rig is not mounted level, so gravity acts: - d sin(theta + phase)."""

    tilt_sine_nm: Array = 0.0
    tilt_cosine_nm: Array = 0.0

    id = "mounting-tilt"
    title = "Rig not mounted level"
    subsystem = "mechanics"
    quantities = (
        Quantity("tilt_sine_nm", "Nm", 0.012, -2.0, 2.0, "gravity's torque at theta = pi/2"),
        Quantity("tilt_cosine_nm", "Nm", 0.012, -2.0, 2.0, "gravity's torque at theta = 0"),
    )
    signature = "torque against sin theta and cos theta"
    rivals = (
        "torque-offset",
        "cable-spring",
        "asymmetric-coulomb-friction",
        "ambient-pressure-error",
        "area-error",
    )
    tie_breaker = "breakaway in both directions at angles far apart"
    source = "thesis 3.3.8 to 3.3.10"

    def external_effort(self, effort: Array, point: Point) -> Array:
        xp = array_namespace(point.position, self.tilt_sine_nm)
        return effort - (
            self.tilt_sine_nm * xp.sin(point.position)
            + self.tilt_cosine_nm * xp.cos(point.position)
        )


@dataclass(frozen=True)
class InertiaMismatch(CatalogueEffect):
    """The moving inertia differs from the declared one: + d, and gravity with it.

    In proportion, as if the extra mass were distributed like the declared one, and by a share more
    or less where it sits further in or out; no gravity on a horizontal rig. A change below -98 %
    of the declared inertia acts on it as -98 %.
    """

    inertia_change_kg_m2: Array = 0.0
    gravity_change: Array = 0.0

    id = "inertia-mismatch"
    title = "Inertia differs from its declared value"
    subsystem = "mechanics"
    quantities = (
        Quantity(
            "inertia_change_kg_m2", "kg m2", 0.003, -0.02, 0.2, "added to the declared inertia"
        ),
        Quantity(
            "gravity_change",
            "-",
            0.05,
            -0.98,
            5.0,
            "gravity's change, beyond the inertia's share",
            absent=0.0,
        ),
    )
    signature = "torque against acceleration"
    rivals = ("torque-constant-error", "link-flexibility")
    tie_breaker = "a known mass added to the arm"
    source = "thesis 3.3.2"

    def parameters(self, parameters: Parameters, time: Array) -> Parameters:
        xp = array_namespace(self.inertia_change_kg_m2, parameters.inertia)
        declared = parameters.inertia
        # A fit may try a change that takes away more than there is: acceleration divides by it.
        share = self.inertia_change_kg_m2 / xp.maximum(declared, LEAST_DIVISOR)
        return parameters.replace(
            inertia=xp.maximum(declared + self.inertia_change_kg_m2, LEAST_INERTIA * declared),
            gravity_moment=parameters.gravity_moment * (1.0 + share + self.gravity_change),
            weight=parameters.weight * (1.0 + share + self.gravity_change),
        )


@dataclass(frozen=True)
class AreaError(CatalogueEffect):
    """The area of the piston's rod side differs from the declared one: A_b + d."""

    area_change_m2: Array = 0.0

    needs_chamber_b = True
    id = "area-error"
    title = "Piston area differs from its declared value"
    subsystem = "mechanics"
    quantities = (
        Quantity("area_change_m2", "m2", 3e-6, -1e-4, 1e-4, "added to the declared area of B"),
    )
    signature = "torque against the pressure in B"
    rivals = (
        "torque-offset",
        "mounting-tilt",
        "ambient-pressure-error",
        "asymmetric-coulomb-friction",
    )
    tie_breaker = "static torque at two pressures in B"
    source = "thesis 3.3.3"

    def parameters(self, parameters: Parameters, time: Array) -> Parameters:
        return parameters.replace(area_b=parameters.area_b + self.area_change_m2)


EFFECTS = (
    Backlash,
    GearMeshRipple,
    PitchEccentricity,
    LinkFlexibility,
    CableSpring,
    MountingTilt,
    InertiaMismatch,
    AreaError,
)
