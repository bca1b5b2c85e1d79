"""The plant over one control period: valve commands in, their delayed edges, the next state.

What `simulate` prepares for a whole log is here done a period at a time, so that a controller
can be between two of them. The commanded on-intervals of a valve are kept until they have
no more effect; a valve is open from an interval's start plus the switch-on delay to its end
plus the switch-off delay. All arrays are (lanes,), one lane a closed loop.
"""

from __future__ import annotations

from typing import NamedTuple

from sysid.io.channels import SIDES
from sysid.plant.base import Array
from sysid.plant.jax_setup import jax, jnp
from sysid.plant.ports import Model
from sysid.plant.stepper import EventTable, Lanes, advance
from sysid.plant.valve_timing import TIME_TOLERANCE

# On-intervals that may still act: with delays shorter than the shortest command no more do.
KEPT_INTERVALS = 4


class ValveIntervals(NamedTuple):
    """A valve's last commanded on-intervals, newest first: (KEPT_INTERVALS, lanes), s.

    The newest one's `off` is infinite while an on/off command lasts.
    """

    on: Array
    off: Array


def no_intervals(lanes: int) -> ValveIntervals:
    """A valve that was never on."""
    never = jnp.full((KEPT_INTERVALS, lanes), -jnp.inf)
    return ValveIntervals(never, never)


def command_duty(
    valve: ValveIntervals, time: Array, duty: Array, period: Array, starts: Array
) -> ValveIntervals:
    """The intervals after a PWM period's start at `time` (s), where `starts` says so.

    On for `duty` (clipped to 0 to 1) times `period`; an interval that joins the last one
    prolongs it, so that a duty of 1 leaves no gap. The shortest pulse still opens the valve for
    the delays' difference, as in the open-loop simulation.
    """
    end = time + jnp.clip(duty, 0.0, 1.0) * period
    pushes = starts & (duty > 0.0)
    joins = pushes & (time - valve.off[0] <= TIME_TOLERANCE)
    prolonged = valve._replace(off=valve.off.at[0].set(jnp.where(joins, end, valve.off[0])))
    return _pushed(prolonged, time, end, pushes & ~joins)


def command_switch(valve: ValveIntervals, time: Array, on: Array, acts: Array) -> ValveIntervals:
    """The intervals after an on/off command at `time` (s) to the lanes where `acts`."""
    was_on = jnp.isinf(valve.off[0]) & (valve.off[0] > 0)
    closed = jnp.where(acts & was_on & ~on, time, valve.off[0])
    valve = valve._replace(off=valve.off.at[0].set(closed))
    return _pushed(valve, time, jnp.inf, acts & on & ~was_on)


def _pushed(valve: ValveIntervals, on: Array, off: Array, where: Array) -> ValveIntervals:
    def column(old: Array, new: Array) -> Array:
        first = jnp.broadcast_to(new, old[:1].shape)
        return jnp.where(where, jnp.concatenate([first, old[:-1]]), old)

    return ValveIntervals(column(valve.on, on), column(valve.off, off))


class _Edges(NamedTuple):
    """When a valve opens and closes: (KEPT_INTERVALS, lanes), s."""

    opens: Array
    closes: Array

    def next_after(self, time: Array) -> Array:
        """Time of the first edge later than `time`, infinite without one."""
        edges = jnp.concatenate([self.opens, self.closes])
        return jnp.min(jnp.where(edges > time + TIME_TOLERANCE, edges, jnp.inf), axis=0)

    def is_open(self, time: Array) -> Array:
        """1 where the valve is open just after `time`, else 0."""
        now = time + TIME_TOLERANCE
        return jnp.where(jnp.any((self.opens <= now) & (now < self.closes), axis=0), 1.0, 0.0)


def _edges(valve: ValveIntervals, until: Array, side: str, model: Model) -> _Edges:
    """The edges, with the model's effects on pulses and delays."""
    on, off = _passed_pulses(valve, until, side, model)
    opens = on + _delays(on, True, side, model)
    closes = off + _delays(off, False, side, model)
    # An edge that is overtaken cancels, and with it the pulse.
    real = closes - opens > TIME_TOLERANCE
    return _Edges(jnp.where(real, opens, -jnp.inf), jnp.where(real, closes, -jnp.inf))


def _passed_pulses(valve: ValveIntervals, until: Array, side: str, model: Model) -> ValveIntervals:
    """The intervals as the model's effects let them pass; `until` as in `advance_period`."""
    on, off = valve
    for effect in model.effects:
        on, off = effect.recent_pulses(on, off, until, side)
    return ValveIntervals(on, off)


def _delays(times: Array, opening: bool, side: str, model: Model) -> Array:
    """Delay of every edge commanded at `times`, (KEPT_INTERVALS, lanes), s."""
    name = "on_delay" if opening else "off_delay"
    delays = jnp.broadcast_to(getattr(model.parameters, f"{name}_{side}"), times.shape)
    for effect in model.effects:
        delays = effect.delays(delays, times, opening, side)
    return delays


def advance_period(
    lanes: Lanes,
    valves: tuple[ValveIntervals, ValveIntervals],
    motor: Array,
    span: tuple[Array, Array, Array],
    model: Model,
) -> Lanes:
    """Every lane from span[0] to span[1] (s) under its motor effort (Nm or N) and valves.

    The step ends at every valve edge and event of the plant in between; the valves follow
    the discrete law. Delays are those of the model's parameters and effects; span[2], (lanes,)
    or a number, is when the next pulse may start. The velocity of a lane that switches without end
    is NaN from there on.
    """
    start, end, until = span
    edges = tuple(
        _edges(valve, until, side, model) for valve, side in zip(valves, SIDES, strict=True)
    )
    zero = jnp.zeros_like(lanes.time)

    def unfinished(carry: tuple[Lanes, Array, Array]) -> Array:
        return jnp.any(carry[1] < end - TIME_TOLERANCE)

    def once(carry: tuple[Lanes, Array, Array]) -> tuple[Lanes, Array, Array]:
        lanes, since, steps = carry
        until = jnp.minimum(jnp.minimum(*(e.next_after(since) for e in edges)), end)
        table = EventTable(
            duration=(until - since)[:, None],
            motor=motor[:, None],
            open_a=edges[0].is_open(since)[:, None],
            open_b=edges[1].is_open(since)[:, None],
            row=jnp.zeros((len(motor), 2), dtype=int),
            count=jnp.where(since < end - TIME_TOLERANCE, 1, 0),
        )
        lanes = advance(lanes._replace(index=jnp.zeros_like(lanes.index)), table, model, ())
        since = jnp.where(lanes.index > 0, until, since)
        # No tick needs nearly as many steps for its events: more would be an endless loop.
        endless = (since < end - TIME_TOLERANCE) & (steps >= 5000)
        lanes = lanes._replace(velocity=jnp.where(endless, jnp.nan, lanes.velocity))
        return lanes, jnp.where(jnp.isnan(lanes.velocity), end, since), steps + 1

    lanes, _, _ = jax.lax.while_loop(unfinished, once, (lanes, zero + start, jnp.asarray(0)))
    return lanes


__all__ = [
    "KEPT_INTERVALS",
    "ValveIntervals",
    "advance_period",
    "command_duty",
    "command_switch",
    "no_intervals",
]
