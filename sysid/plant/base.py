"""The thesis' equations (chapter 3, corrected) as pure functions of state, inputs, parameters.

Every function takes floats, numpy arrays or jax arrays, of any shapes that broadcast, and
returns the same kind: numpy is the only array library imported here. SI, absolute
pressures. "Effort" is torque (Nm) on a rotary rig and force (N) on a linear one, whose
pitch radius is 1; "position" is rad or m accordingly.

Equation numbers are those of the thesis; where it is printed wrongly, the corrected form is used.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np

from sysid.errors import input_error
from sysid.io.channels import SIDES
from sysid.io.rig import Cylinder, Rig, require_inertia

Array = Any
"""A float, or an array of any library that follows the array API standard."""

CRITICAL_RATIO = 0.53
"""Downstream over upstream pressure below which flow is choked (3.5.1)."""

MAX_STEP = 1e-3
"""The simulator's longest step, s: samples further apart are split (accuracy:
`benchmarks/simulation.py`). No rate or lag that its explicit steps integrate is faster."""

LEAST_DIVISOR = 1e-12
"""Keeps a quotient finite where what divides may be 0, in SI: its result is then not used, or 0."""


# A tuple: asked millions of times, `isinstance` takes twice as long of a union.
_NUMPY = (float, np.ndarray, np.generic, int)


def array_namespace(*values: Array) -> Any:
    """The module whose functions take these values: numpy unless one belongs to another library."""
    for value in values:
        if isinstance(value, _NUMPY):
            continue
        namespace = getattr(value, "__array_namespace__", None)
        if namespace is not None:
            return namespace()
    return np


def is_zero(value: Array) -> bool:
    """Whether it is the number 0; of what is traced or an array nothing is known."""
    return isinstance(value, float) and value == 0.0


# Nm or N, beyond what any machine exerts. Not infinite, as the simulator multiplies it by 0.
_NEVER_OVERCOME = 1e12


@dataclass(frozen=True)
class Parameters:
    """Every number of the base model, flat, so that any of them can be fitted or batched.

    Each field is a float or an array over runs. `offset` is a constant effort in the
    direction of positive motion (0 in the base model). `choked_fill_*` holds at
    `supply_reference`, to which choked filling is proportional. Gravity is
    `gravity_moment` sin(position) + `weight`: the first on a rotary rig, the second on a
    linear one. A return spring resists positive motion with `preload` + `stiffness` position;
    None: there is none. Where `bleeds`, the two valves are chamber A's, which A's fills and B's
    empties, by A's laws, each by its own delays. A chamber that a rig lacks is the atmosphere: a
    piston of no area before a room, with a valve that passes nothing.
    """

    # mechanics: Nm, Nm s/rad, kg m2 (linear: N, N s/m, kg)
    static_effort: Array
    coulomb_effort: Array
    viscous: Array
    inertia: Array
    gravity_moment: Array
    weight: Array
    offset: Array
    max_effort: Array
    # cylinder: m2, m
    area_a: Array
    area_b: Array
    offset_a: Array
    offset_b: Array
    stroke: Array
    pitch_radius: Array
    # air: J/(kg K), -, K, Pa
    gas_constant: Array
    heat_capacity_ratio: Array
    temperature: Array
    atmosphere: Array
    supply: Array
    supply_reference: Array
    # valves: kg/s, kg/s, kg/(s Pa^0.5), kg/(s Pa), s, s
    choked_fill_a: Array
    choked_dis_a: Array
    c_fill_a: Array
    c_dis_a: Array
    on_delay_a: Array
    off_delay_a: Array
    choked_fill_b: Array
    choked_dis_b: Array
    c_fill_b: Array
    c_dis_b: Array
    on_delay_b: Array
    off_delay_b: Array
    # s
    pwm_period: Array
    # Nm/rad, Nm (linear: N/m, N)
    stiffness: Array | None = None
    preload: Array | None = None
    # valves of ISO 6358: m3/(s Pa) at ANR, -, -; a direction without obeys the thesis' law
    sonic_conductance_fill_a: Array | None = None
    critical_ratio_fill_a: Array | None = None
    subsonic_index_fill_a: Array | None = None
    sonic_conductance_dis_a: Array | None = None
    critical_ratio_dis_a: Array | None = None
    subsonic_index_dis_a: Array | None = None
    sonic_conductance_fill_b: Array | None = None
    critical_ratio_fill_b: Array | None = None
    subsonic_index_fill_b: Array | None = None
    sonic_conductance_dis_b: Array | None = None
    critical_ratio_dis_b: Array | None = None
    subsonic_index_dis_b: Array | None = None
    # the own coefficient of a valve with a flow control in series: kg/(s Pa^0.5), kg/(s Pa)
    valve_c_fill_a: Array | None = None
    valve_c_dis_a: Array | None = None
    valve_c_fill_b: Array | None = None
    valve_c_dis_b: Array | None = None
    # whether valve B is the one that empties chamber A, which is shut while both are off
    bleeds: Array = False

    def replace(self, **changes: Array) -> Parameters:
        """A copy with some fields changed."""
        if not changes.keys() <= vars(self).keys():
            return dataclasses.replace(self, **changes)
        # Called in every step of a simulation: `dataclasses.replace` takes 20 times as long.
        copy = object.__new__(type(self))
        vars(copy).update(vars(self), **changes)
        return copy

    def with_friction(self, sliding: Array, static: Array) -> Parameters:
        """A copy with so many times the friction, while it slides and at rest."""
        return self.replace(
            coulomb_effort=self.coulomb_effort * sliding,
            viscous=self.viscous * sliding,
            static_effort=self.static_effort * static,
        )

    def with_held_shaft(self) -> Parameters:
        """A copy whose shaft is fixed at rest: no effort overcomes its friction."""
        return self.replace(static_effort=_NEVER_OVERCOME, coulomb_effort=_NEVER_OVERCOME)

    def without_flow(self, side: str) -> Parameters:
        """A copy whose valve A or B passes nothing."""
        return self.replace(**{f"{name}_{side}": v for name, v in vars(_NO_VALVE).items()})

    def valve(self, side: str) -> ValveParameters:
        """Valve A's or B's flow parameters; ValueError unless `side` is "a" or "b"."""
        if side not in SIDES:
            raise ValueError(f"side is {side!r}, not one of {', '.join(SIDES)}")
        return ValveParameters(*_VALVE_NUMBERS[side](self))


@dataclass(frozen=True)
class ValveParameters:
    """The discrete law of one valve: kg/s, kg/s, kg/(s Pa^0.5), kg/(s Pa).

    A direction, "fill" or "dis", with a sonic conductance (m3/(s Pa) at ANR), critical ratio and
    subsonic index obeys ISO 6358; its numbers of the thesis' law are then 0. One with a coefficient
    of the valve's own (`valve_c_fill`) has a flow control in series (thesis 3.6): its `c_fill` is
    that of both.
    """

    choked_fill: Array
    choked_dis: Array
    c_fill: Array
    c_dis: Array
    sonic_conductance_fill: Array | None = None
    critical_ratio_fill: Array | None = None
    subsonic_index_fill: Array | None = None
    sonic_conductance_dis: Array | None = None
    critical_ratio_dis: Array | None = None
    subsonic_index_dis: Array | None = None
    valve_c_fill: Array | None = None
    valve_c_dis: Array | None = None


VALVE_NAMES: tuple[str, ...] = tuple(f.name for f in dataclasses.fields(ValveParameters))
_VALVE_NUMBERS = {side: attrgetter(*(f"{n}_{side}" for n in VALVE_NAMES)) for side in SIDES}
SPRING_NAMES = ("stiffness", "preload")
"""The parameters that a rig without a return spring does not have."""
PARAMETER_NAMES: tuple[str, ...] = tuple(
    f.name for f in dataclasses.fields(Parameters) if f.default is dataclasses.MISSING
)
_OPTIONAL = tuple(f.name for f in dataclasses.fields(Parameters) if f.default is None)


def parameter_names(parameters: Parameters) -> tuple[str, ...]:
    """The names of the numbers that parameters have: a spring's, and those of valves that obey ISO
    6358 or have a flow control in series, where there are any."""
    own = (name for name in _OPTIONAL if getattr(parameters, name) is not None)
    return (*PARAMETER_NAMES, *own)


# A chamber without a valve model holds its gas; a rig without a motor takes no command.
_NO_VALVE = ValveParameters(0.0, 0.0, 0.0, 0.0)


def parameters_from_rig(
    rig: Rig,
    *,
    static_effort: float,
    coulomb_effort: float,
    viscous: float,
    valve_a: ValveParameters = _NO_VALVE,
    valve_b: ValveParameters = _NO_VALVE,
    offset: float = 0.0,
    inertia: float | None = None,
) -> Parameters:
    """Parameters of a rig: constants from its file, the rest as given (fitted or assumed).

    `inertia` (kg m2, or kg) in place of the file's.

    Raises InputError where the rig file lacks what the model needs ([air], [cylinder], an
    inertia). Without `[pwm]` or `[valves]` the period is 1 s and the delays 0.
    """
    rig.require("air", "which the chamber equations need")
    rig.require("cylinder", "which the chamber equations need")
    delays = (rig.valves.on_delay_s, rig.valves.off_delay_s) if rig.valves else (0.0, 0.0)
    if not static_effort >= 0.0 or not coulomb_effort >= 0.0:
        raise input_error(rig.source, "friction is negative", "give static and Coulomb friction")
    valves = {"a": valve_a, "b": valve_b}
    return bare_parameters(rig).replace(
        static_effort=static_effort,
        coulomb_effort=coulomb_effort,
        viscous=viscous,
        inertia=require_inertia(rig) if inertia is None else inertia,
        offset=offset,
        **{
            f"{name}_{side}": getattr(valve, name)
            for side, valve in valves.items()
            for name in VALVE_NAMES
        },
        on_delay_a=delays[0],
        off_delay_a=delays[1],
        on_delay_b=delays[0],
        off_delay_b=delays[1],
        pwm_period=rig.pwm.period_s if rig.pwm else 1.0,
    )


_FLOWS = tuple(
    f"{name}_{side}"
    for side in SIDES
    for name in ("choked_fill", "choked_dis", "c_fill", "c_dis", "on_delay", "off_delay")
)


def bare_parameters(rig: Rig) -> Parameters:
    """The rig's constants where flow does not matter; without a cylinder the piston area is 0.

    What the rig file does not give is neutral: an atmosphere of 1e5 Pa, unlimited travel.
    """
    a, c, gravity = rig.air, rig.cylinder, rig.gravity_moment()
    atmosphere = a.atmospheric_pressure_pa if a else 1e5
    return Parameters(
        static_effort=0.0,
        coulomb_effort=0.0,
        viscous=0.0,
        inertia=1.0,
        gravity_moment=0.0 if rig.is_linear else gravity,
        weight=gravity if rig.is_linear else 0.0,
        offset=0.0,
        max_effort=np.inf if rig.max_effort is None else rig.max_effort,
        # Equations divide by a chamber's volume; the chamber exerts no force.
        area_a=c.area_a_m2 if c else 1e-15,
        area_b=c.area_b_m2 if c else 1e-15,
        offset_a=c.offset_a_m if c else 1e9,
        offset_b=c.offset_b_m if c else 1e9,
        stroke=c.stroke_m if c else 1e9,
        pitch_radius=c.pitch_radius_m if c else 1.0,
        gas_constant=a.gas_constant_j_per_kg_k if a else 287.0,
        heat_capacity_ratio=a.heat_capacity_ratio if a else 1.4,
        temperature=a.temperature_k if a else 293.15,
        atmosphere=atmosphere,
        supply=a.supply_pressure_pa if a else atmosphere,
        supply_reference=a.supply_pressure_pa if a else atmosphere,
        **dict.fromkeys(_FLOWS, 0.0),
        pwm_period=1.0,
        **dict(zip(SPRING_NAMES, rig.spring_law or (None, None), strict=True)),
        bleeds=rig.bleeds,
    )


# --- mechanics -------------------------------------------------------------------------

# pi in three parts, the first two with few enough digits that multiples of them are exact.
_PI = (3.1415926218032837, 3.178650942459171e-08, 1.2246467864107189e-16)
# 1 / 3!, 1 / 5!, ...: within pi/2 the omitted terms are below the rounding.
_SINE_SERIES = [(-1.0) ** n / math.factorial(2 * n + 1) for n in range(1, 11)]


def sine(angle: Array) -> Array:
    """sin(angle) to rounding, rad; of jax's arrays by arithmetic alone.

    Its compiler calls the C library's sine for each element, which takes as much as a quarter of
    a simulation step.
    """
    xp = array_namespace(angle)
    if getattr(xp, "__name__", "") != "jax.numpy":
        return xp.sin(angle)
    turns = xp.round(angle * (1.0 / math.pi))
    rest = ((angle - turns * _PI[0]) - turns * _PI[1]) - turns * _PI[2]
    square = rest * rest
    series = _SINE_SERIES[-1]
    for term in _SINE_SERIES[-2::-1]:
        series = series * square + term
    half = 0.5 * turns
    sign = 1.0 - 4.0 * (half - xp.floor(half))
    return sign * (rest + rest * square * series)


def cylinder_effort(
    pressure_a: Array,
    pressure_b: Array,
    area_a: Array,
    area_b: Array,
    atmosphere: Array,
    pitch_radius: Array = 1.0,
) -> Array:
    """Effort of the cylinder, Nm or N (3.3.3): (Pa Aa - Pb Ab - P0 (Aa - Ab)) r.

    Written with gauge pressures, so that it is exactly zero with both chambers open.
    """
    return ((pressure_a - atmosphere) * area_a - (pressure_b - atmosphere) * area_b) * pitch_radius


def motor_effort(volts: Array, effort_per_volt: Array, max_effort: Array = np.inf) -> Array:
    """Motor effort at the output (3.3.4): Kt Kamp N volts, within +- max_effort; Nm or N."""
    return limit_effort(volts * effort_per_volt, max_effort)


def limit_effort(effort: Array, max_effort: Array) -> Array:
    """An effort clipped to +- max_effort; NaN stays NaN."""
    xp = array_namespace(effort, max_effort)
    below = xp.where(effort >= max_effort, max_effort, effort)
    return xp.where(below <= -max_effort, -max_effort, below)


def gravity_effort(position: Array, gravity_moment: Array, weight: Array = 0.0) -> Array:
    """Effort of gravity against positive motion (3.3.8-3.3.10), Nm or N.

    Rotary: (M_arm L/2 + Mp Lp) g sin(theta), theta = 0 hanging down; `gravity_moment` is
    the bracket times g. Linear: the `weight`. Both are zero in the horizontal.
    """
    if is_zero(gravity_moment):
        return 0.0 * position + weight  # a sine of every sample costs more than all else here
    return gravity_moment * sine(position) + weight


def spring_effort(position: Array, stiffness: Array, preload: Array) -> Array:
    """Effort of a return spring against positive motion, Nm or N: preload + stiffness position."""
    return stiffness * position + preload


def load_effort(position: Array, parameters: Parameters) -> Array:
    """What the load resists positive motion with at rest, Nm or N: gravity and a return spring."""
    p = parameters
    gravity = gravity_effort(position, p.gravity_moment, p.weight)
    if p.stiffness is None or p.preload is None:
        return gravity
    return gravity + spring_effort(position, p.stiffness, p.preload)


def place_at_rest(parameters: Parameters) -> float:
    """Where it rests with its chambers at the atmosphere, rad or m: in the middle of its travel,
    or where a return spring puts it that friction does not hold there, at most at an end stop."""
    p = parameters
    if p.stiffness is None or abs(float(load_effort(0.0, p))) <= float(p.static_effort):
        return 0.0
    from scipy.optimize import brentq

    half = 0.5 * float(p.stroke) / float(p.pitch_radius)
    ends = [float(load_effort(x, p)) for x in (-half, half)]
    if ends[0] * ends[1] > 0.0:
        return -math.copysign(half, ends[0])
    return float(brentq(lambda x: float(load_effort(x, p)), -half, half))


def sliding_friction(
    velocity: Array, direction: Array, coulomb_effort: Array, viscous: Array
) -> Array:
    """Friction while moving in a direction, +1 or -1 (3.4.1): t_cf sign(w) + Cvf w, Nm or N."""
    return coulomb_effort * direction + viscous * velocity


def friction_effort(
    velocity: Array, applied: Array, static_effort: Array, coulomb_effort: Array, viscous: Array
) -> Array:
    """Friction of 3.4.1 in full, with `applied` = t_cyl + t_mot - t_grav; Nm or N.

    At rest it holds against the applied effort up to `static_effort`, and is that limit
    with the applied effort's sign beyond it.
    """
    xp = array_namespace(velocity, applied, static_effort, coulomb_effort, viscous)
    at_rest = xp.minimum(xp.maximum(applied, -static_effort), static_effort)
    moving = sliding_friction(velocity, xp.sign(velocity), coulomb_effort, viscous)
    return xp.where(velocity == 0.0, at_rest, moving)


# --- chambers --------------------------------------------------------------------------


def chamber_volume_a(position: Array, area: Array, offset: Array, pitch_radius: Array) -> Array:
    """Volume of chamber A, m3: (ya0 + r theta) Aa."""
    return (offset + pitch_radius * position) * area


def chamber_volume_b(position: Array, area: Array, offset: Array, pitch_radius: Array) -> Array:
    """Volume of chamber B, m3: (yb0 - r theta) Ab."""
    return (offset - pitch_radius * position) * area


def chamber_volume(position: Array, cylinder: Cylinder, side: str) -> Array:
    """Volume of a side's chamber, m3, by the rig file's lengths."""
    c = cylinder
    if side == "a":
        return chamber_volume_a(position, c.area_a_m2, c.offset_a_m, c.pitch_radius_m)
    return chamber_volume_b(position, c.area_b_m2, c.offset_b_m, c.pitch_radius_m)


def pressure_rate(
    pressure: Array,
    flow: Array,
    volume: Array,
    volume_rate: Array,
    heat_capacity_ratio: Array,
    gas_constant: Array,
    temperature: Array,
) -> Array:
    """dP/dt of a chamber, Pa/s (3.3.6, 3.5.2): (k R T m - k P dV/dt) / V.

    `flow` into the chamber in kg/s, `volume` in m3, `volume_rate` in m3/s.
    """
    inflow = gas_constant * temperature * flow
    return heat_capacity_ratio * (inflow - pressure * volume_rate) / volume


def flow_from_pressure_rate(
    rate: Array,
    pressure: Array,
    volume: Array,
    volume_rate: Array,
    heat_capacity_ratio: Array,
    gas_constant: Array,
    temperature: Array,
) -> Array:
    """Mass flow into a chamber, kg/s: 3.5.2 solved for it (3.5.3 with the piston held)."""
    return (volume * rate / heat_capacity_ratio + pressure * volume_rate) / (
        gas_constant * temperature
    )


# --- valves ----------------------------------------------------------------------------


def is_filling_choked(pressure: Array, supply: Array) -> Array:
    """Whether filling is choked: P <= 0.53 Ps (3.5.1)."""
    return pressure <= filling_boundary(supply)


def is_exhaust_choked(pressure: Array, atmosphere: Array) -> Array:
    """Whether the exhaust is choked: P >= P0 / 0.53 (3.5.1)."""
    return pressure >= exhaust_boundary(atmosphere)


def filling_boundary(supply: Array) -> Array:
    """Chamber pressure up to which filling is choked, Pa: 0.53 Ps."""
    return CRITICAL_RATIO * supply


def exhaust_boundary(atmosphere: Array) -> Array:
    """Chamber pressure from which on the exhaust is choked, Pa: P0 / 0.53."""
    return (1.0 / CRITICAL_RATIO) * atmosphere


def signed_sqrt(value: Array) -> Array:
    """sign(x) sqrt(|x|)."""
    xp = array_namespace(value)
    root = xp.sqrt(xp.abs(value))
    # A choice by a mask takes several times as long, and as a traced program another form.
    return np.copysign(root, value) if xp is np else xp.where(value < 0, -root, root)


def unchoked_filling_flow(pressure: Array, supply: Array, c_fill: Array) -> Array:
    """c_fill sqrt(Ps - P), and -c_fill sqrt(P - Ps) above the supply; kg/s."""
    return c_fill * signed_sqrt(supply - pressure)


def unchoked_exhaust_flow(pressure: Array, atmosphere: Array, c_dis: Array) -> Array:
    """c_dis (P0 - P): out of the chamber above P0 (negative), into it below; kg/s."""
    return c_dis * (atmosphere - pressure)


def filling_flow(
    pressure: Array,
    supply: Array,
    choked_fill: Array,
    c_fill: Array,
    supply_reference: Array | None = None,
    choked: Array | None = None,
) -> Array:
    """Flow into the chamber through an open valve, kg/s (3.6.6).

    Choked: `choked_fill`, which holds at `supply_reference` (default: the supply itself)
    and is proportional to the supply; unchoked: see unchoked_filling_flow. The law jumps
    at the boundary, as the thesis' fitted constants do. An integrator that has located
    the boundary chooses the side on which the law is taken (`choked`).
    """
    xp = array_namespace(pressure, supply, choked_fill, c_fill)
    reference = supply if supply_reference is None else supply_reference
    return xp.where(
        is_filling_choked(pressure, supply) if choked is None else choked,
        choked_fill * (supply / reference),
        unchoked_filling_flow(pressure, supply, c_fill),
    )


def exhaust_flow(
    pressure: Array,
    atmosphere: Array,
    choked_dis: Array,
    c_dis: Array,
    choked: Array | None = None,
) -> Array:
    """Flow into the chamber through a valve that is off, kg/s (3.6.7, 3.6.10).

    Negative (out) above P0: -`choked_dis` where choked, else c_dis (P0 - P), which also
    lets air in below P0. `choked` as in filling_flow.
    """
    xp = array_namespace(pressure, atmosphere, choked_dis, c_dis)
    return xp.where(
        is_exhaust_choked(pressure, atmosphere) if choked is None else choked,
        -choked_dis,
        unchoked_exhaust_flow(pressure, atmosphere, c_dis),
    )


def filling_jump(supply: Array, choked_fill: Array, c_fill: Array) -> Array:
    """Relative jump of the filling law at the choked boundary: unchoked / choked - 1."""
    boundary = unchoked_filling_flow(filling_boundary(supply), supply, c_fill)
    return boundary / choked_fill - 1.0


def exhaust_jump(atmosphere: Array, choked_dis: Array, c_dis: Array) -> Array:
    """Relative jump of the exhaust law at the choked boundary: unchoked / choked - 1."""
    boundary = unchoked_exhaust_flow(exhaust_boundary(atmosphere), atmosphere, c_dis)
    return -boundary / choked_dis - 1.0
