"""One step of many runs at once, with every discontinuity of the plant located.

Within a sub-step the commands are constant, so only the state can leave a regime: flow
that chokes or unchokes, a shaft that stops, breaks away or meets an end stop. A step is
one step of Kutta's third-order method on the equations with the regime frozen, which are
smooth; if an event function changes sign in it, the step is cut at the first root, by the
method's own continuous extension, and the next step starts in the new regime. Runs advance
each at its own pace: one that meets an event takes one more step than one that does not.

A chamber about to reach the supply pressure obeys dD/dt = -K sqrt(D) + g with D = Ps - P,
which is stiff without bound as D -> 0 and reaches its equilibrium in finite time. There,
and only there, the pressure is advanced by an implicit method (`supply_approach`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, TypeVar

from sysid.io.channels import SIDES
from sysid.plant import base, plant, valve_laws
from sysid.plant.base import Array
from sysid.plant.events import Cubic, apart, first_event, kutta_cubic
from sysid.plant.jax_setup import jax, jnp
from sysid.plant.lanes import EventTable, Lanes, Now, Rates, Table
from sysid.plant.ports import Model, Point
from sysid.plant.ripple import Ripple
from sysid.plant.supply_approach import gap_change

_Result = TypeVar("_Result")


class Chamber(NamedTuple):
    """A chamber at the start of a step, and the regime of its valve during the step.

    `above` is 1 where the law above the choked boundary is in force, -1 below it, 0 where
    the pressure slides along it. `flow` in kg/s, `rate` in Pa/s, `volume` in m3,
    `per_flow` = k R T / V in Pa/kg.
    """

    choked: Array
    above: Array
    boundary: Array
    flow: Array
    rate: Array
    volume: Array
    per_flow: Array


@dataclass(frozen=True)
class Setting:
    """What is constant during a step: model, commands (in `point`), regime.

    `always` is true, which the compiler does not know: see `events.apart`.
    """

    model: Model
    surfaces: tuple[Any, ...]
    always: Array
    point: Point
    chambers: dict[str, Chamber]
    ripples: dict[str, Ripple]

    def applied_effort(self, point: Point) -> Array:
        """`plant.applied_effort` at the pressures as they are within a PWM period, Nm or N."""
        pressures: dict[str, Any] = {
            f"pressure_{side}": point.pressure(side) + ripple.at(point.time)
            for side, ripple in self.ripples.items()
        }
        return plant.applied_effort(dataclasses.replace(point, **pressures), self.model)

    def apart(self, function: Callable[[], _Result], like: _Result) -> _Result:
        """`events.apart` of this step."""
        return apart(self.always, function, like)


def _flow(side: str, choked: Array, point: Point, setting: Setting) -> Array:
    """Flow into a chamber, kg/s, with the regime as said."""
    if setting.surfaces:
        surfaces = setting.surfaces[SIDES.index(side)]
        mean = setting.ripples[side].mean if setting.ripples else None
        return plant.averaged_flow(side, surfaces, point, setting.model, mean)
    return plant.discrete_flow(side, choked, point, setting.model)


def _chamber(side: str, setting: Setting) -> Chamber:
    """The regime of a valve. An averaged law has no boundary.

    On the boundary itself the law is taken on the side to which it drives the pressure;
    where both sides drive it back, the pressure slides along the boundary.
    """
    point, model = setting.point, setting.model
    is_open = point.is_open(side) > 0
    p = point.parameters
    volume = plant.chamber_volume(side, plant.displacement(point, model), p)
    per_flow = p.heat_capacity_ratio * p.gas_constant * p.temperature / volume
    if setting.surfaces:
        one = jnp.ones_like(point.time)
        flow = _flow(side, is_open, point, setting)
        rate = plant.pressure_rate(side, flow, point, model)
        return Chamber(is_open, one, 0.0 * one, flow, rate, volume, per_flow)
    boundary = jnp.where(
        is_open,
        plant.filling_boundary(side, point, model),
        plant.exhaust_boundary(side, point, model),
    )
    valve = p.valve(side)
    fixed = jnp.where(
        is_open,
        valve_laws.filling_boundary(valve, p.supply),
        valve_laws.exhaust_boundary(valve, p.atmosphere),
    )
    excess = point.pressure(side) - boundary
    flow_above = _flow(side, ~is_open, point, setting)
    flow_below = _flow(side, is_open, point, setting)
    higher = excess > 0
    flow = jnp.where(higher, flow_above, flow_below)
    rate = plant.pressure_rate(side, flow, point, model)
    # On the boundary the other law may be the one in force: the rate is affine in the flow.
    jump = per_flow * (flow_above - flow_below)
    rate_above = jnp.where(higher, rate, rate + jump)
    rate_below = jnp.where(higher, rate - jump, rate)
    driven = jnp.where(rate_above > 0, 1.0, jnp.where(rate_below < 0, -1.0, 0.0))
    # An event leaves a pressure on its boundary but for rounding; one that moves with the other
    # chamber's flow leaves it behind within a step. Shares of the boundary.
    near = jnp.where(boundary == fixed, 1e-10, 1e-4)
    on_boundary = jnp.abs(excess) <= near * boundary
    above = jnp.where(on_boundary, driven, jnp.where(higher, 1.0, -1.0))
    below = above < 0
    rate = jnp.where(below, rate_below, rate_above)
    return Chamber(
        choked=below == is_open,
        above=above,
        boundary=boundary,
        flow=jnp.where(below, flow_below, flow_above),
        rate=jnp.where(above == 0, 0.0, rate),
        volume=volume,
        per_flow=per_flow,
    )


def _stop(point: Point) -> Array:
    """Position of the upper end stop; the lower one is its negative."""
    return 0.5 * point.parameters.stroke / point.parameters.pitch_radius


def _breakaway(applied: Array, point: Point, model: Model) -> tuple[Array, Array]:
    """How far a shaft at rest is from breaking away, Nm or N, and to which side.

    Positive, and so never broken, where an end stop takes the effort.
    """
    limit = plant.breakaway_effort(applied, point, model)
    way = jnp.where(applied > 0, 1.0, -1.0)
    blocked = way * point.position >= _stop(point)
    return jnp.where(blocked, limit, limit - way * applied), way


def _ripples(lanes: Lanes, ripple: Rates, duration: Array, setting: Setting) -> dict[str, Ripple]:
    """Each chamber's ripple in the sub-step; none without pulses."""
    found = {}
    per_second = 1.0 / jnp.where(duration > 0, duration, 1.0)
    for number, side in enumerate(SIDES if ripple else ()):
        start, end, mean = ripple[3 * number : 3 * number + 3]
        phase = end > start, mean
        shape = partial(plant.pulse_ripple, side, setting.surfaces[number], phase)
        swing, *bend = setting.apart(
            partial(shape, setting.point, setting.model), (lanes.time,) * 3
        )
        slope = (end - start) * per_second
        begins = lanes.time - lanes.elapsed
        found[side] = Ripple(swing, start, slope, mean, begins, (bend[0], bend[1]))
    return found


def _start(
    lanes: Lanes, now: Now, model: Model, surfaces: tuple[Any, ...], always: Array
) -> tuple[Setting, Rates, Array]:
    """The step's setting, the rates at its start and the breakaway margin there."""
    motor, open_a, open_b = now.commands
    point = Point(
        time=lanes.time,
        position=lanes.position,
        velocity=lanes.velocity,
        pressure_a=lanes.pressure_a,
        pressure_b=lanes.pressure_b,
        motor=motor,
        open_a=open_a,
        open_b=open_b,
        direction=jnp.sign(lanes.velocity),
        parameters=model.at(lanes.time),
        extra=dict(zip(model.state_names, lanes.extra, strict=True)),
    )
    setting = Setting(model, surfaces, always, point, {}, {})
    setting = dataclasses.replace(
        setting, ripples=_ripples(lanes, now.ripple, now.duration, setting)
    )
    one, flag = lanes.time, jnp.zeros_like(lanes.time, dtype=bool)
    applied = setting.apart(lambda: setting.applied_effort(point), one)
    margin, direction = setting.apart(
        lambda: _direction(applied, lanes.loose, point, model), (one, one)
    )
    point = dataclasses.replace(point, direction=direction)
    setting = dataclasses.replace(setting, point=point)
    like = Chamber(flag, *[one] * 6)
    chambers = {side: setting.apart(partial(_chamber, side, setting), like) for side in SIDES}
    setting = dataclasses.replace(setting, chambers=chambers)
    rates = (one,) * (4 + len(model.state_names))
    return setting, setting.apart(lambda: _start_rates(applied, setting), rates), margin


def _direction(applied: Array, loose: Array, point: Point, model: Model) -> tuple[Array, Array]:
    """The breakaway margin and which way the shaft slides: -1, 1, or 0 if it sticks."""
    margin, way = _breakaway(applied, point, model)
    starts = (margin < 0) | (loose * way > 0)
    moving = jnp.where(point.velocity > 0, 1.0, -1.0)
    return margin, jnp.where(point.velocity != 0, moving, jnp.where(starts, way, 0.0))


def _start_rates(applied: Array, setting: Setting) -> Rates:
    point, model, chambers = setting.point, setting.model, setting.chambers
    extra = plant.state_rates(point, {side: c.flow for side, c in chambers.items()}, model)
    return (
        point.velocity,
        plant.acceleration(applied, point, model),
        *(chamber.rate for chamber in chambers.values()),
        *(extra[name] for name in model.state_names),
    )


def _stage(
    setting: Setting, held: dict[str, tuple[Array, Array]], state: Rates, time: Array
) -> tuple[Rates, Array, Array]:
    """Derivatives of (position, velocity, pressures, extra), breakaway margin and its way.

    The regime is frozen. `held` gives the constant rate of a chamber that the stiff method
    advances, and where it does.
    """
    model = setting.model
    position, velocity, pressure_a, pressure_b, *extra = setting.apart(lambda: state, state)
    point = dataclasses.replace(
        setting.point,
        time=time,
        position=position,
        velocity=velocity,  # exactly zero while sticking
        pressure_a=pressure_a,
        pressure_b=pressure_b,
        extra=dict(zip(model.state_names, extra, strict=True)),
    )

    def derivatives(applied: Array) -> Rates:
        flows, rates = {}, []
        for side, chamber in setting.chambers.items():
            flows[side] = _flow(side, chamber.choked, point, setting)
            rate = plant.pressure_rate(side, flows[side], point, model)
            rate = jnp.where(chamber.above == 0, 0.0, rate)
            rates.append(jnp.where(*held[side], rate) if side in held else rate)
        extra_rates = plant.state_rates(point, flows, model)
        return (
            velocity,
            plant.acceleration(applied, point, model),
            *rates,
            *(extra_rates[name] for name in model.state_names),
        )

    applied = setting.apart(lambda: setting.applied_effort(point), velocity)
    margin, way = _breakaway(applied, point, model)
    return setting.apart(lambda: derivatives(applied), state), margin, way


def _near_supply(start: Rates, step: Array, setting: Setting) -> dict[str, tuple[Array, Array]]:
    """For each side: (whether the stiff method advances it, its mean rate over the step).

    Few runs need the method in a step; where none does, nothing of it is computed.
    """
    if setting.surfaces:
        return {}
    held = {}
    for side, chamber in setting.chambers.items():
        one = chamber.rate
        stiff, *gap = setting.apart(
            partial(_supply_gap, side, chamber, step, setting), (chamber.choked, one, one, one)
        )
        rate = partial(_supply_approach, side, chamber, start, step, setting, gap)
        held[side] = stiff, apart(jnp.any(stiff), rate, one)
    return held


def _supply_gap(
    side: str, chamber: Chamber, step: Array, setting: Setting
) -> tuple[Array, Array, Array, Array]:
    """Whether a chamber is near the line that it is open to, the supply or, of a valve of ISO 6358,
    the exhaust too; its gap D to it, h K and h g at the step's start."""
    point, model = setting.point, setting.model
    valve, temperature = point.parameters.valve(side), point.parameters.temperature
    pressure, is_open = point.pressure(side), point.is_open(side) > 0
    line = plant.supply_pressure(side, point, model)
    root = valve_laws.root_coefficient(valve, "fill", line, pressure, temperature)
    nears = is_open & ~chamber.choked
    if valve_laws.obeys_iso(valve, "dis"):
        exhaust = plant.exhaust_pressure(side, point, model)
        back = valve_laws.root_coefficient(valve, "dis", exhaust, pressure, temperature)
        line, root = jnp.where(is_open, line, exhaust), jnp.where(is_open, root, back)
        nears = ~chamber.choked
    gap = line - pressure
    stiffness = step * chamber.per_flow * root
    other = stiffness * base.signed_sqrt(gap) - step * chamber.rate
    # Implicit where sqrt(D) is below h K: the explicit method is exact enough above.
    reach = stiffness * stiffness + 2.0 * jnp.abs(other)
    return nears & (jnp.abs(gap) < reach), gap, stiffness, other


def _supply_approach(
    side: str, chamber: Chamber, start: Rates, step: Array, setting: Setting, gap: Sequence[Array]
) -> Array:
    """Mean rate over the step by the stiff method, Pa/s; `gap`: the last three of `_supply_gap`."""
    model, point = setting.model, setting.point
    distance, stiffness, other = gap
    # The piston's part, which is the largest, changes during the step.
    later = dataclasses.replace(point, velocity=point.velocity + step * start[1])
    swept = plant.volume_rate(side, point, model), plant.volume_rate(side, later, model)
    shrunk = 1.0 / (1.0 + 0.5 * step * (swept[0] + swept[1]) / chamber.volume)
    squeeze = point.parameters.heat_capacity_ratio * point.pressure(side) / chamber.volume
    gained = step * squeeze * (swept[1] * shrunk - swept[0])
    change = gap_change(distance, (stiffness, stiffness * shrunk), (other, other + gained))
    return -change / jnp.where(step > 0, step, 1.0)


def advance(lanes: Lanes, table: Table, model: Model, surfaces: tuple[Any, ...]) -> Lanes:
    """One step of every run, to its sub-step's end or to the first event before it."""
    always = table.count[0] >= 0
    here = table.now(lanes)
    now = apart(always, lambda: here, here)
    setting, k1, margin_1 = _start(lanes, now, model, surfaces, always)
    step = now.step
    held = _near_supply(k1, step, setting)
    if held:
        pressures = (jnp.where(*held[s], k) for s, k in zip(SIDES, k1[2:4], strict=True))
        k1 = (*k1[:2], *pressures, *k1[4:])
    state = (lanes.position, lanes.velocity, lanes.pressure_a, lanes.pressure_b, *lanes.extra)
    half = 0.5 * step
    state_2 = tuple(y + half * k for y, k in zip(state, k1, strict=True))
    stage = jax.jit(partial(_stage, setting, held))  # traced once for both stages
    k2, margin_2, _ = stage(state_2, lanes.time + half)
    state_3 = tuple(y + step * (2.0 * b - a) for y, a, b in zip(state, k1, k2, strict=True))
    k3, margin_3, way = stage(state_3, lanes.time + step)
    cubics = setting.apart(
        lambda: [kutta_cubic(*of, step) for of in zip(state, k1, k2, k3, strict=True)],
        [Cubic(y, y, y, y) for y in state],
    )
    # The stages are accurate to first order only; this parabola removes their error.
    bend = 0.5 * (margin_3 - 2.0 * margin_2 + margin_1)
    margin = Cubic(margin_1, 2.0 * (margin_2 - margin_1), bend, jnp.zeros_like(bend))
    after, cut, gone = _cut(lanes, setting, cubics, (step, margin, way))
    return after._replace(**table.moved(lanes, now, cut, gone))


def _cut(
    lanes: Lanes, setting: Setting, cubics: list[Cubic], found: tuple[Array, Cubic, Array]
) -> tuple[Lanes, Array, Array]:
    """The runs' states after the step, whether it was cut at an event, and the s it took."""
    step, margin, way = found
    direction = setting.point.direction
    sticks = direction == 0
    slowing = cubics[1].distance(direction)
    turns = Cubic(*(jnp.where(sticks, *of) for of in zip(margin, slowing, strict=True)))
    end = direction * _stop(setting.point)
    switches = [
        cubic.distance(chamber.above, chamber.boundary)
        for cubic, chamber in zip(cubics[2:4], setting.chambers.values(), strict=True)
    ]
    events = [turns, cubics[0].distance(-direction, end), *switches]
    at, (turned, hit, *switched) = first_event(events, setting.always)
    cut = at < 2.0
    # A cut step advances by at least this share, so that events cannot stall the time.
    share = jnp.where(cut, jnp.where(at > 1e-4, at, 1e-4), 1.0)
    position, velocity, *rest = (cubic(share) for cubic in cubics)
    pressures = [
        jnp.where(switch, chamber.boundary, pressure)
        for switch, chamber, pressure in zip(
            switched, setting.chambers.values(), rest[:2], strict=True
        )
    ]
    gone = share * step
    time = lanes.time + gone
    ripples = {f"ripple_{side}": ripple.at(time) for side, ripple in setting.ripples.items()}
    after = lanes._replace(
        time=time,
        position=jnp.where(hit, end, position),
        velocity=jnp.where(hit | turned, 0.0, velocity),
        pressure_a=pressures[0],
        pressure_b=pressures[1],
        extra=tuple(rest[2:]),
        loose=jnp.where(turned & sticks, way, jnp.zeros_like(time)),
        **ripples,
    )
    return after, cut, gone


__all__ = ["Chamber", "EventTable", "Lanes", "Setting", "advance"]
