"""Effects of friction, in addition to Coulomb and viscous friction with breakaway."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sysid.plant import base, plant
from sysid.plant.base import LEAST_DIVISOR, MAX_STEP, Array, array_namespace
from sysid.plant.effects.entry import CatalogueEffect, Quantity, bent, either
from sysid.plant.ports import Model, Point

# The presliding state relaxes no faster than the simulator's explicit steps can follow, 1/s.
_FASTEST_RATE = 1.2 / MAX_STEP
# Nor does a bristle and the inertia on it swing faster, rad/s.
_FASTEST_RESONANCE = 0.5 / MAX_STEP
# Speed within one step of standstill, rad/s: bristles stiffer than a step resolves fade there.
_LEAST_SPEED = 1e-2
# Pressures are raised to a power in bars, Pa.
_BAR = 1e5
# Square of a wave's height that is none: of no wave the height has no slope.
_NO_HEIGHT = 1e-24


@dataclass(frozen=True)
class StribeckFriction(CatalogueEffect):
    """Friction falls from rest to sliding: + d exp(-|w/ws|^n) sign w, n = 2 Gaussian."""

    stribeck_torque_nm: Array = 0.0
    stribeck_velocity_rad_per_s: Array = 0.07
    stribeck_exponent: Array = 2.0

    id = "stribeck-friction"
    title = "Stribeck friction"
    subsystem = "friction"
    quantities = (
        Quantity("stribeck_torque_nm", "Nm", 0.12, 0.0, 2.0, "beyond Coulomb friction at rest"),
        Quantity(
            "stribeck_velocity_rad_per_s",
            "rad/s",
            0.07,
            0.01,
            1.0,
            "velocity scale of the decay",
            is_strength=False,
            grid=(0.02, 0.05, 0.1, 0.2, 0.4),
        ),
        Quantity(
            "stribeck_exponent",
            "-",
            2.0,
            0.5,
            3.0,
            "shape of the decay: 1 exponential, 2 Gaussian",
            is_strength=False,
            grid=(1.0, 2.0),
        ),
    )
    signature = "torque at low speed, against the motion"
    rivals = ("quadratic-drag",)
    tie_breaker = "slow ramps through zero speed, and constant torques at three or more speeds"
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994"

    def friction_effort(self, effort: Array, point: Point) -> Array:
        xp = array_namespace(point.velocity, self.stribeck_torque_nm)
        # Never zero: a power of zero has no derivative.
        ratio = xp.abs(point.velocity) / self.stribeck_velocity_rad_per_s + 1e-12
        fade = xp.exp(-(ratio**self.stribeck_exponent))
        return effort + self.stribeck_torque_nm * fade * point.direction


@dataclass(frozen=True)
class AsymmetricCoulombFriction(CatalogueEffect):
    """Coulomb friction differs by direction: + d while moving either way."""

    asymmetry_nm: Array = 0.0

    id = "asymmetric-coulomb-friction"
    title = "Coulomb friction that differs by direction"
    subsystem = "friction"
    quantities = (
        Quantity("asymmetry_nm", "Nm", 0.017, -0.5, 0.5, "half the difference of the directions"),
    )
    signature = "constant torque while moving"
    rivals = ("torque-offset", "mounting-tilt", "ambient-pressure-error", "area-error")
    tie_breaker = "breakaway in both directions at several angles"
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994"

    def friction_effort(self, effort: Array, point: Point) -> Array:
        return effort + self.asymmetry_nm * (point.direction * point.direction)


@dataclass(frozen=True)
class PositionDependentFriction(CatalogueEffect):
    """Coulomb friction varies along the travel: t_cf (1 + s sin(n theta) + c cos(n theta)).

    A place that is tight or worn is no sine: with `friction_peakedness` r the wave of the same
    height from trough to crest has its harmonics at r, r^2, ... of it (a Poisson kernel), so that
    its crests are peaks, or below 0 its troughs dips; under a long wave one peak is in the travel.
    """

    friction_sine: Array = 0.0
    friction_cosine: Array = 0.0
    friction_wave_per_rad: Array = 2.5
    friction_peakedness: Array = 0.0

    id = "position-dependent-friction"
    title = "Coulomb friction that varies with position"
    subsystem = "friction"
    quantities = (
        Quantity("friction_sine", "-", 0.3, -1.5, 1.5, "relative, odd about the middle"),
        Quantity("friction_cosine", "-", 0.3, -1.5, 1.5, "relative, even about the middle"),
        Quantity(
            "friction_wave_per_rad",
            "1/rad",
            2.5,
            0.3,
            15.0,
            "wave number along the travel",
            is_strength=False,
            grid=(0.6, 1.2, 2.0, 3.0, 4.5, 7.0, 10.0),
        ),
        # A sine shows where a peak is.
        bent(
            "friction_peakedness",
            0.0,
            -0.95,
            0.95,
            "0: a sine; towards 1: crests are peaks, towards -1: troughs are dips",
            "how sharp its crests are, below 0 its troughs",
            ((0.0, "a sine"),),
            is_smooth=False,
        ),
    )
    signature = "torque against angle, with the sign of the velocity"
    rivals = ("cable-spring",)
    tie_breaker = "reversals at the same angle"
    source = "thesis 3.4.1, Table 3.4.1; Olsson et al., European Journal of Control 4(3), 1998"

    def friction_effort(self, effort: Array, point: Point) -> Array:
        xp = array_namespace(point.position, self.friction_sine)
        phase = self.friction_wave_per_rad * point.position
        share = self.friction_sine * xp.sin(phase) + self.friction_cosine * xp.cos(phase)
        if not base.is_zero(self.friction_peakedness):
            share = self._peaked(xp, share)
        return effort + point.parameters.coulomb_effort * share * point.direction

    def _peaked(self, xp: Any, wave: Array) -> Array:
        """The wave with its harmonics, from trough to crest as high as it was: of a wave x of
        height 1, (1 - r^2) (x - r) / (1 - 2 r x + r^2)."""
        r = self.friction_peakedness
        square = self.friction_sine**2 + self.friction_cosine**2
        height = xp.sqrt(square + _NO_HEIGHT)
        kernel = (wave * height - r * square) / ((1.0 + r**2) * height - 2.0 * r * wave)
        return (1.0 - r**2) * kernel


@dataclass(frozen=True)
class SealFriction(CatalogueEffect):
    """Seals press harder under pressure: + d (gauge Pa + Pb) sign w.

    Rod and piston seals feel the gauge pressures, a piston's lip seal their difference: a
    blend of (gauge Pa + Pb) and |Pa - Pb| by `difference_share`. Each pressure p counts as
    (p / 1 bar)^n bars: rubber slips the more easily the harder it is pressed, n below 1. A lip
    presses no less below the atmosphere (`only_above_atmosphere`: the share of such). Static
    friction grows by `breakaway_share` of it.
    """

    seal_torque_nm_per_pa: Array = 0.0
    difference_share: Array = 0.0
    pressure_exponent: Array = 1.0
    only_above_atmosphere: Array = 0.0
    breakaway_share: Array = 0.0

    id = "seal-friction"
    title = "Seal friction that grows with pressure"
    subsystem = "friction"
    quantities = (
        Quantity(
            "seal_torque_nm_per_pa", "Nm/Pa", 2e-7, 0.0, 2e-5, "per pressure on the seals, at 1 bar"
        ),
        Quantity(
            "difference_share",
            "-",
            0.0,
            0.0,
            1.0,
            "0: the sum of the gauge pressures, 1: their difference",
            is_strength=False,
            caption="share of the pressures' difference in what presses on the seals",
            forms=((0.0, "the sum of the gauge pressures alone"), (1.0, "their difference alone")),
            grid=(0.0, 0.5, 1.0),
        ),
        bent(
            "pressure_exponent",
            1.0,
            0.5,
            1.5,
            "power of the pressure, in bars: 1 in proportion",
            "power of the pressure that it grows with",
            ((1.0, "in proportion"),),
        ),
        bent(
            "only_above_atmosphere",
            0.0,
            0.0,
            1.0,
            "0: a pressure below the atmosphere relieves the seals, 1: it does not",
            "share of the seals that no pressure below the atmosphere relieves",
            ((0.0, "none"), (1.0, "all")),
        ),
        # Sliding does not show it: the refinement alone moves it.
        bent(
            "breakaway_share",
            0.0,
            0.0,
            3.0,
            "of it that static friction grows by: 0 none, 1 as while sliding",
            "share of it that static friction grows by",
            ((0.0, "none"), (1.0, "as while sliding")),
        ),
    )
    signature = "torque against the sum of the pressures, against the motion"
    rivals = ("torque-constant-error", "inertia-mismatch")
    tie_breaker = "motion at several common-mode pressures"
    source = (
        "Andrighetto, Valdiero, Carlotto, Study of the friction behaviour, COBEM 2005; "
        "Schallamach, Proc. Phys. Soc. B 65, 1952 (rubber and load)"
    )

    def friction_effort(self, effort: Array, point: Point) -> Array:
        return effort + self._on_seals(point) * point.direction

    def static_effort(self, effort: Array, point: Point) -> Array:
        return effort + self.breakaway_share * self._on_seals(point)

    def is_idle(self, port: str) -> bool:
        """See `Effect`."""
        return port == "static_effort" and base.is_zero(self.breakaway_share)

    def _on_seals(self, point: Point) -> Array:
        """Friction of the seals by pressure alone, Nm or N."""
        p, a, b = point.parameters.atmosphere, point.pressure_a, point.pressure_b
        xp = array_namespace(a, self.difference_share)
        if base.is_zero(self.pressure_exponent - 1.0) and base.is_zero(self.only_above_atmosphere):
            gauge, difference = a + b - 2.0 * p, xp.abs(a - b)
        else:
            gauge = self._pressed(xp, a - p) + self._pressed(xp, b - p)
            difference = self._raised(xp, a - b)
        pressure = gauge + self.difference_share * (difference - gauge)
        return self.seal_torque_nm_per_pa * pressure

    def _pressed(self, xp: Any, gauge: Array) -> Array:
        """What presses on the seals at a gauge pressure, Pa."""
        below = self.only_above_atmosphere - 1.0
        return self._raised(xp, gauge) * xp.where(gauge < 0.0, below, 1.0)

    def _raised(self, xp: Any, pressure: Array) -> Array:
        """The size of a pressure to the power, Pa."""
        # Never zero: a power of zero has no derivative.
        size = xp.maximum(xp.abs(pressure), LEAST_DIVISOR)
        return size * (size / _BAR) ** (self.pressure_exponent - 1.0)


@dataclass(frozen=True)
class LoadDependentFriction(CatalogueEffect):
    """Friction grows with the load, as in a gear: + d |effort| sign w.

    The effort is the motor's at the output or, with `load_is_transmitted` 1, all that the drive
    transmits to the load: the motor's and the cylinder's together.
    """

    load_friction: Array = 0.0
    load_is_transmitted: Array = 0.0

    id = "load-dependent-friction"
    title = "Friction that grows with the load"
    subsystem = "friction"
    quantities = (
        # Of 1 no effort would move anything.
        Quantity("load_friction", "-", 0.05, 0.0, 0.9, "share of the effort"),
        either(
            "load_is_transmitted",
            "0: of the motor's effort, 1: of the motor's and the cylinder's together",
            "effort with which it grows",
            ("the motor's", "the motor's and the cylinder's together"),
            absent=None,
        ),
    )
    signature = "torque against the effort's magnitude, against the motion"
    rivals = ("torque-constant-error", "seal-friction")
    tie_breaker = "two payloads, each logged with its payload_mass_kg"
    source = "Hamon, Gautier, Garrec, IROS 2010, 6187-6193; thesis 7.3 (2)"

    def friction_effort(self, effort: Array, point: Point) -> Array:
        xp = array_namespace(point.motor, point.pressure_a, self.load_friction)
        p = point.parameters
        cylinder = base.cylinder_effort(
            point.pressure_a, point.pressure_b, p.area_a, p.area_b, p.atmosphere, p.pitch_radius
        )
        motor = base.limit_effort(point.motor, p.max_effort)
        load = xp.abs(motor + self.load_is_transmitted * cylinder)
        return effort + self.load_friction * load * point.direction


@dataclass(frozen=True)
class Presliding(CatalogueEffect):
    """Friction builds up over a small displacement after a reversal (Dahl's and LuGre's bristle).

    The strength is the bristle's compliance 1/sigma_0, so that 0 is the rigid base law. The state
    z is the share of Coulomb friction t_cf that the bristle carries. It nears the level at which it
    slides, g = 1 + (t_s / t_cf) exp(-(w/ws)^2), over a displacement of compliance t_cf:
    dz/dt = |w| (sign w - z/g) / (compliance t_cf); Dahl's law has t_s = 0. While it gives, the
    bristle is damped. It takes the place of dry friction, at rest too: the shaft creeps as the
    effort on it changes. A bristle too stiff or too fast for a step to follow takes a part of that
    place alone. Where measured motion rests, it is as far as the effort holds it.
    """

    bristle_compliance_rad_per_nm: Array = 0.0
    bristle_static_torque_nm: Array = 0.1
    stribeck_velocity_rad_per_s: Array = 0.02
    bristle_damping_nm_s_per_rad: Array = 0.5
    states = ("presliding_share",)

    id = "presliding"
    title = "Presliding displacement"
    subsystem = "friction"
    quantities = (
        Quantity(
            "bristle_compliance_rad_per_nm",
            "rad/Nm",
            1.0 / 400.0,
            0.0,
            0.1,
            "1/stiffness, 1/sigma",
            grid=(1.0 / 400.0, 3.0 / 400.0),
            is_smooth=True,
        ),
        Quantity(
            "bristle_static_torque_nm",
            "Nm",
            0.1,
            0.0,
            2.0,
            "beyond Coulomb friction, up to which it holds at rest",
            is_strength=False,
            grid=(0.1,),
            is_smooth=True,
            absent=0.0,
        ),
        Quantity(
            "stribeck_velocity_rad_per_s",
            "rad/s",
            0.02,
            1e-3,
            0.5,
            "velocity scale of the fall from that to sliding",
            is_strength=False,
            grid=(0.02,),
            is_smooth=True,
            absent=0.02,
        ),
        Quantity(
            "bristle_damping_nm_s_per_rad",
            "Nm s/rad",
            0.5,
            0.0,
            20.0,
            "of the bristle while it gives",
            is_strength=False,
            grid=(0.5,),
            is_smooth=True,
            absent=0.0,
        ),
    )
    signature = "hysteresis at reversals: friction builds up over a small displacement"
    rivals = ("stribeck-friction",)
    tie_breaker = "small reversals within the presliding range"
    source = "Canudas de Wit, Olsson, Astrom, Lischinsky, IEEE TAC 40(3), 1995"

    def _span(self, point: Point) -> Array:
        """Displacement over which Coulomb friction builds up, rad."""
        return self.bristle_compliance_rad_per_nm * point.parameters.coulomb_effort

    def _level(self, point: Point, speed: Array) -> Array:
        """The share at which the bristle slides at a speed, of Coulomb friction."""
        xp = array_namespace(speed, self.bristle_static_torque_nm)
        beyond = self.bristle_static_torque_nm / xp.maximum(
            point.parameters.coulomb_effort, LEAST_DIVISOR
        )
        return 1.0 + beyond * xp.exp(-((speed / self.stribeck_velocity_rad_per_s) ** 2))

    def _weight(self, point: Point, speed: Array) -> Array:
        """The part of dry friction whose place the bristle takes, 0 to 1."""
        xp = array_namespace(speed, self.bristle_compliance_rad_per_nm)
        followed = _FASTEST_RATE * self._span(point) / xp.maximum(speed, _LEAST_SPEED)
        stiffest = _FASTEST_RESONANCE**2 * point.parameters.inertia
        soft = stiffest * self.bristle_compliance_rad_per_nm
        return xp.minimum(xp.minimum(followed, soft), 1.0)

    def friction_effort(self, effort: Array, point: Point) -> Array:
        if "presliding_share" not in point.extra:
            return effort
        speed = array_namespace(point.velocity).abs(point.velocity)
        dry = self._weight(point, speed) * point.parameters.coulomb_effort * point.direction
        return effort - dry

    def static_effort(self, effort: Array, point: Point) -> Array:
        if "presliding_share" not in point.extra:
            return effort
        return effort * (1.0 - self._weight(point, 0.0 * point.velocity))

    def external_effort(self, effort: Array, point: Point) -> Array:
        if "presliding_share" not in point.extra:
            return effort
        xp = array_namespace(point.velocity, self.bristle_compliance_rad_per_nm)
        share, speed = point.extra["presliding_share"], xp.abs(point.velocity)
        gives = point.velocity - speed * share / self._level(point, speed)
        carried = point.parameters.coulomb_effort * share
        carried = carried + self.bristle_damping_nm_s_per_rad * gives
        return effort - self._weight(point, speed) * carried

    def initial_states(self, point: Point) -> dict[str, Array]:
        xp = array_namespace(point.velocity)
        return {"presliding_share": xp.sign(point.velocity) + 0.0 * point.position}

    def state_rates(self, point: Point, flows: Mapping[str, Array]) -> dict[str, Array]:
        xp = array_namespace(point.velocity, self.bristle_compliance_rad_per_nm)
        p, share = point.parameters, point.extra["presliding_share"]
        speed = xp.abs(point.velocity)
        level = self._level(point, speed)
        span = xp.maximum(self._span(point) * level, LEAST_DIVISOR)
        sliding = xp.minimum(speed / span, _FASTEST_RATE)
        # Measured motion that rests: the shaft on its bristle nears what the effort asks for no
        # faster than it swings.
        swings = xp.maximum(self.bristle_compliance_rad_per_nm * p.inertia, _FASTEST_RATE**-2)
        held = plant.applied_effort(point, Model(p)) / xp.maximum(p.coulomb_effort, LEAST_DIVISOR)
        at_rest = point.direction == 0
        target = xp.where(at_rest, xp.clip(held, -level, level), level * point.direction)
        rate = xp.where(at_rest, 1.0 / xp.sqrt(swings), sliding)
        return {"presliding_share": rate * (target - share)}


@dataclass(frozen=True)
class QuadraticDrag(CatalogueEffect):
    """Drag that grows faster than the speed: + d |w|^n sign w, n = 2 with its square."""

    drag_nm_s2_per_rad2: Array = 0.0
    drag_exponent: Array = 2.0

    id = "quadratic-drag"
    title = "Quadratic drag"
    subsystem = "friction"
    quantities = (
        Quantity(
            "drag_nm_s2_per_rad2", "Nm s2/rad2", 0.005, 0.0, 0.5, "at a speed of one unit, squared"
        ),
        Quantity(
            "drag_exponent",
            "-",
            2.0,
            1.5,
            2.0,
            "of the speed: 2 square, 1.75 turbulent flow past a smooth wall, 1.5 in between",
            is_strength=False,
            # Of a fitted one next to the strength neither would be known well.
            grid=(1.5, 1.75, 2.0),
            absent=2.0,
            is_choice=True,
        ),
    )
    signature = "torque at high speed"
    rivals = ("stribeck-friction",)
    tie_breaker = "constant torques at three or more speeds"
    source = "Olsson et al., European Journal of Control 4(3), 1998"

    def friction_effort(self, effort: Array, point: Point) -> Array:
        xp = array_namespace(point.velocity, self.drag_nm_s2_per_rad2)
        # Never zero: a power of zero has no derivative.
        speed = xp.maximum(xp.abs(point.velocity), base.LEAST_DIVISOR)
        growth = speed ** (self.drag_exponent - 1.0)
        return effort + self.drag_nm_s2_per_rad2 * point.velocity * growth


@dataclass(frozen=True)
class AsymmetricViscousFriction(CatalogueEffect):
    """Viscous friction differs by direction: + d |w| while moving either way."""

    viscous_asymmetry_nm_s_per_rad: Array = 0.0

    id = "asymmetric-viscous-friction"
    title = "Viscous friction that differs by direction"
    subsystem = "friction"
    quantities = (
        Quantity(
            "viscous_asymmetry_nm_s_per_rad",
            "Nm s/rad",
            0.01,
            -1.0,
            1.0,
            "half the difference of the directions",
        ),
    )
    signature = "torque against the speed's magnitude, with the same sign in both directions"
    rivals = ("asymmetric-coulomb-friction", "torque-offset")
    tie_breaker = "constant torques at three or more speeds, in both directions"
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994"

    def friction_effort(self, effort: Array, point: Point) -> Array:
        return effort + self.viscous_asymmetry_nm_s_per_rad * (point.velocity * point.direction)


@dataclass(frozen=True)
class PowerLawFriction(CatalogueEffect):
    """Viscous friction levels off with speed: + d |w|^n sign w, n below 1."""

    power_law_nm: Array = 0.0
    power_law_exponent: Array = 0.5

    id = "power-law-friction"
    title = "Viscous friction that levels off with speed"
    subsystem = "friction"
    quantities = (
        # A torque over a speed to the power of the typical exponent, 0.5.
        Quantity(
            "power_law_nm", "Nm", 0.05, 0.0, 10.0, "at a speed of one unit", radius_power=-1.5
        ),
        Quantity(
            "power_law_exponent",
            "-",
            0.5,
            0.1,
            0.95,
            "exponent of the speed; 1 would be viscous friction",
            is_strength=False,
            grid=(0.3, 0.5, 0.7),
        ),
    )
    signature = "torque that rises steeply at low speed and flattens"
    rivals = ("stribeck-friction", "quadratic-drag")
    tie_breaker = "slow ramps through zero speed, and constant torques at three or more speeds"
    source = "Olsson et al., European Journal of Control 4(3), 1998"

    def friction_effort(self, effort: Array, point: Point) -> Array:
        xp = array_namespace(point.velocity, self.power_law_nm)
        # Never zero: a power of zero has no derivative.
        speed = xp.abs(point.velocity) + 1e-12
        return effort + self.power_law_nm * speed**self.power_law_exponent * point.direction


@dataclass(frozen=True)
class StictionAfterRest(CatalogueEffect):
    """Static friction grows while at rest: - d T / (T + rest), from the last motion on.

    The state is T / (T + rest): 1 while moving and at the start of a test, and at rest
    ds/dt = - s^2 / T. Static friction as the bench shows it is that after a long rest.
    """

    fresh_loss_nm: Array = 0.0
    recovery_time_s: Array = 0.3
    states = ("fresh_share",)

    id = "stiction-after-rest"
    title = "Static friction that grows while at rest"
    subsystem = "friction"
    quantities = (
        Quantity("fresh_loss_nm", "Nm", 0.06, 0.0, 2.0, "missing right after motion"),
        Quantity(
            "recovery_time_s",
            "s",
            0.3,
            0.02,
            20.0,
            "rest after which half of it is back",
            is_strength=False,
            grid=(0.05, 0.2, 1.0),
        ),
    )
    signature = "torque at which the shaft breaks away, against the rest before"
    rivals = ("stribeck-friction",)
    tie_breaker = "slow ramps from rest, after rests of different lengths"
    source = "Armstrong-Helouvry, Dupont, Canudas de Wit, Automatica 30(7), 1994"

    def static_effort(self, effort: Array, point: Point) -> Array:
        return effort - self.fresh_loss_nm * point.extra.get("fresh_share", 1.0)

    def initial_states(self, point: Point) -> dict[str, Array]:
        return {"fresh_share": 1.0 + 0.0 * point.position}

    def state_rates(self, point: Point, flows: Mapping[str, Array]) -> dict[str, Array]:
        xp = array_namespace(point.velocity, self.recovery_time_s)
        share = point.extra["fresh_share"]
        at_rest = -share * share / self.recovery_time_s
        # Motion of some 10 ms makes a contact anew, 1/s.
        return {"fresh_share": xp.where(point.direction == 0, at_rest, 100.0 * (1.0 - share))}


EFFECTS = (
    StribeckFriction,
    AsymmetricCoulombFriction,
    PositionDependentFriction,
    SealFriction,
    LoadDependentFriction,
    Presliding,
    QuadraticDrag,
    AsymmetricViscousFriction,
    PowerLawFriction,
    StictionAfterRest,
)
