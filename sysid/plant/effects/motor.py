"""Effects of the motor and its amplifier."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from sysid.plant import base
from sysid.plant.base import Array, array_namespace, limit_effort
from sysid.plant.effects.entry import CatalogueEffect, Quantity, state_lag
from sysid.plant.ports import Point


def _command(point: Point) -> Array:
    """Commanded effort within the declared limit, Nm or N."""
    return limit_effort(point.motor, point.parameters.max_effort)


@dataclass(frozen=True)
class TorqueRipple(CatalogueEffect):
    """The motor's torque varies with its angle: torque (1 + s sin(n theta) + c cos(n theta))."""

    ripple_sine: Array = 0.0
    ripple_cosine: Array = 0.0
    ripple_wave_per_rad: Array = 12.0

    id = "torque-ripple"
    needs_motor = True
    title = "Torque ripple of the motor"
    subsystem = "motor"
    quantities = (
        Quantity("ripple_sine", "-", 0.02, -0.5, 0.5, "relative"),
        Quantity("ripple_cosine", "-", 0.02, -0.5, 0.5, "relative"),
        Quantity(
            "ripple_wave_per_rad",
            "1/rad",
            12.0,
            3.0,
            120.0,
            "pole pairs, slots or teeth per turn of the output",
            is_strength=False,
            grid=tuple(float(n) for n in (*range(4, 30), *range(30, 62, 2), *range(64, 100, 4))),
            is_wave=True,
        ),
    )
    signature = "a ripple over angle that grows with the motor's torque"
    rivals = ("gear-mesh-ripple",)
    tie_breaker = "motion driven by the valves alone: the ripple disappears"
    source = "Jahns, Soong, IEEE Trans. Industrial Electronics 43(2), 1996"

    def motor_effort(self, effort: Array, point: Point) -> Array:
        xp = array_namespace(point.position, self.ripple_sine)
        phase = self.ripple_wave_per_rad * point.position
        share = self.ripple_sine * xp.sin(phase) + self.ripple_cosine * xp.cos(phase)
        return effort + effort * share


@dataclass(frozen=True)
class TorqueSaturation(CatalogueEffect):
    """The motor gives less than the declared limit: u / (1 + |d u|^(1/s))^s, never beyond 1/d.

    At a softness s of 0 it is clipped; iron that saturates bends before (near 0.4 much as a tanh).
    """

    inverse_limit_per_nm: Array = 0.0
    saturation_softness: Array = 0.0

    id = "torque-saturation"
    needs_motor = True
    title = "Motor torque that saturates early"
    subsystem = "motor"
    quantities = (
        Quantity(
            "inverse_limit_per_nm",
            "1/Nm",
            1.8,
            0.0,
            50.0,
            "1 over the torque at which the motor saturates",
            grid=(1.3, 1.5, 1.8, 2.1, 2.5, 3.2, 4.5),
        ),
        Quantity(
            "saturation_softness",
            "-",
            0.0,
            0.0,
            0.6,
            "0 clips; above it what is given bends before the limit, 0.5 as a hyperbola",
            is_strength=False,
            grid=(0.0, 0.4),
            absent=0.0,
        ),
    )
    signature = "torque missing at high command, on one side of it"
    rivals = ("torque-constant-error",)
    tie_breaker = "a sweep of the command's amplitude"
    source = "thesis 3.3.4"

    def motor_effort(self, effort: Array, point: Point) -> Array:
        xp = array_namespace(effort, self.inverse_limit_per_nm)
        # In units of the limit, so that 0 clips nothing: the excess over 1 is divided out again.
        used = xp.abs(effort) * self.inverse_limit_per_nm
        clipped = 1.0 / xp.maximum(used, 1.0)
        if not base.is_zero(self.saturation_softness):
            # A saturation that is harder is clipped, but for 0.1 % at the limit itself.
            softness = xp.maximum(self.saturation_softness, 1e-3)
            # (1 + used^n)^-s, with no power of what is above 1. Never zero: its logarithm counts.
            ratio = xp.maximum(xp.minimum(used, 1.0) * clipped, 1e-12)
            bent = clipped * (1.0 + ratio ** (1.0 / softness)) ** -softness
            clipped = xp.where(self.saturation_softness > 0.0, bent, clipped)
        return effort - effort * (1.0 - clipped)


@dataclass(frozen=True)
class TorqueConstantError(CatalogueEffect):
    """The motor's torque differs from the commanded one: torque (1 + d)."""

    torque_gain_error: Array = 0.0

    id = "torque-constant-error"
    needs_motor = True
    title = "Torque constant differs from its declared value"
    subsystem = "motor"
    quantities = (Quantity("torque_gain_error", "-", 0.05, -0.5, 0.5, "relative"),)
    signature = "torque against the motor's torque"
    rivals = ("pitch-eccentricity", "inertia-mismatch", "torque-saturation")
    tie_breaker = "static weights on the arm, held by the motor"
    source = "thesis 3.3.4"

    def motor_effort(self, effort: Array, point: Point) -> Array:
        return effort + self.torque_gain_error * effort


@dataclass(frozen=True)
class AmplifierLag(CatalogueEffect):
    """The amplifier follows the command with a first-order lag.

    With the state x, dx/dt = (u - x)/T, T = max(tau, 1 ms), the torque is u + (tau/T)(x - u):
    exact from 1 ms on, right to first order below, the command itself at 0.
    """

    amplifier_lag_s: Array = 0.0
    states = ("amplifier_effort",)

    id = "amplifier-lag"
    needs_motor = True
    title = "Lag of the amplifier"
    subsystem = "motor"
    quantities = (Quantity("amplifier_lag_s", "s", 0.002, 0.0, 0.05, "time constant"),)
    signature = "torque against the rate of the motor's torque"
    rivals = ("backlash", "link-flexibility")
    tie_breaker = "steps of motor torque with the arm held"
    source = "thesis 3.3.4; Krishnan, Electric Motor Drives, 2001"

    def motor_effort(self, effort: Array, point: Point) -> Array:
        command = _command(point)
        behind = point.extra.get("amplifier_effort", command) - command
        return effort + self.amplifier_lag_s / state_lag(self.amplifier_lag_s) * behind

    def initial_states(self, point: Point) -> dict[str, Array]:
        return {"amplifier_effort": _command(point)}

    def state_rates(self, point: Point, flows: Mapping[str, Array]) -> dict[str, Array]:
        behind = _command(point) - point.extra["amplifier_effort"]
        return {"amplifier_effort": behind / state_lag(self.amplifier_lag_s)}


@dataclass(frozen=True)
class TorqueOffset(CatalogueEffect):
    """A constant torque: + d."""

    offset_nm: Array = 0.0

    id = "torque-offset"
    title = "Torque offset"
    subsystem = "motor"
    quantities = (Quantity("offset_nm", "Nm", 0.01, -1.0, 1.0, "in the positive direction"),)
    signature = "constant torque"
    rivals = (
        "asymmetric-coulomb-friction",
        "mounting-tilt",
        "ambient-pressure-error",
        "area-error",
    )
    tie_breaker = "breakaway in both directions at several angles"
    source = "thesis 3.3.7"

    def external_effort(self, effort: Array, point: Point) -> Array:
        return effort + self.offset_nm


EFFECTS = (
    TorqueRipple,
    TorqueSaturation,
    TorqueConstantError,
    AmplifierLag,
    TorqueOffset,
)
