"""The states of many runs, and the tables from which a compiled step reads their commands.

Two kinds of table. `SwitchedTable` holds what a log has: rows, and the edges at which the valves
open and close; where a sub-step ends is worked out as the run gets there. `EventTable` holds
sub-steps that were worked out before, which mean flows and closed loops need.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from sysid.plant.base import Array
from sysid.plant.jax_setup import jax, jnp
from sysid.plant.valve_timing import TIME_TOLERANCE, WHOLE_STEP

Rates = tuple[Array, ...]


class Lanes(NamedTuple):
    """Where each run is; arrays (runs,), `extra` a tuple of them.

    `index` is the sub-step (or row) of the table, `elapsed` s into it (or since the table's
    first row), `loose` the direction in which a shaft at rest has just broken away (else 0).
    `passed`: how many of A's and B's edges lie behind. `ripple_a`, `ripple_b`: of mean flows
    under PWM, how far the pressure is above that at the ends of the period, Pa.
    """

    time: Array
    position: Array
    velocity: Array
    pressure_a: Array
    pressure_b: Array
    extra: Rates
    loose: Array
    index: Array
    elapsed: Array
    passed: Rates = ()
    ripple_a: Array = 0.0
    ripple_b: Array = 0.0

    def shown(self) -> Rates:
        """Position, velocity and pressures as they are within a PWM period."""
        pressures = self.pressure_a + self.ripple_a, self.pressure_b + self.ripple_b
        return self.position, self.velocity, *pressures


class Now(NamedTuple):
    """What a table says where the lanes are, arrays (runs,).

    `commands`: motor, open_a, open_b. `step`: s to the end of the sub-step, 0 where the run has
    ended (not `active`). `duration` and `ripple` as in EventTable. `ahead`: the table's own.
    """

    active: Array
    commands: Rates
    step: Array
    duration: Array
    ripple: Rates = ()
    ahead: Rates = ()


class EventTable(NamedTuple):
    """Sub-steps of every run, arrays (runs, sub-steps); `count` (runs,) of them are real.

    `motor` in Nm or N, `open_a` and `open_b` 1 or 0 (averaged valve model: duty),
    `row` (runs, sub-steps + 1) the row of the log, since the table's first, in which the sub-step
    lies. `ripple`, of mean flows that know of the pulses: for A, then B, its start, end and mean
    in shares of a period. `most`: sub-steps that a run takes, at most, but for events.
    """

    duration: Array
    motor: Array
    open_a: Array
    open_b: Array
    row: Array
    count: Array
    ripple: Rates = ()
    most: Array = 0

    @property
    def timing(self) -> Rates:
        """What moves with a valve's delays."""
        return (self.duration,)

    def retimed(self, timing: Rates) -> EventTable:
        """The table with another `timing`."""
        return self._replace(duration=timing[0])

    def now(self, lanes: Lanes) -> Now:
        """The sub-step in which each lane is."""
        active = lanes.index < self.count
        at = jnp.where(active, lanes.index, 0)
        motor, open_a, open_b, duration = (
            _look_up(t, at) for t in (self.motor, self.open_a, self.open_b, self.duration)
        )
        rest = duration - lanes.elapsed
        step = jnp.where(active & (rest > 0), rest, 0.0)
        ripple = tuple(_look_up(t, at) for t in self.ripple)
        return Now(active, (motor, open_a, open_b), step, duration, ripple)

    def moved(self, lanes: Lanes, now: Now, cut: Array, gone: Array) -> dict[str, Any]:
        """The lanes' places after a step that was `cut` at an event, or not, and took `gone` s."""
        return {
            "index": jnp.where(now.active & ~cut, lanes.index + 1, lanes.index),
            "elapsed": jnp.where(cut, lanes.elapsed + gone, 0.0),
        }

    def rows(self, lanes: Lanes) -> Array:
        """How many rows of the table lie behind each lane, (runs,)."""
        return _look_up(self.row, lanes.index)


class SwitchedTable(NamedTuple):
    """Rows of every run and the edges of its valves in them; `count` (runs,) rows are real.

    `time` (runs, rows + 1) s since the first row, `motor` (runs, rows) Nm or N. `edges_a`,
    `edges_b` (runs, edges) s since the first row, increasing, infinite from the last real one
    on; each turns its valve, which is `open_a`, `open_b` (1 or 0) at the first row. No sub-step
    exceeds `max_step` s. Times closer than `together` s count as one (none do if it is negative:
    each edge then ends a separate sub-step, possibly of length 0, so that each has its derivative).
    `most`: sub-steps that a run takes, at most, but for events.
    """

    time: Array
    motor: Array
    edges_a: Array
    edges_b: Array
    open_a: Array
    open_b: Array
    count: Array
    max_step: Array
    together: Array
    most: Array

    @property
    def timing(self) -> Rates:
        """What moves with a valve's delays."""
        return self.edges_a, self.edges_b

    def retimed(self, timing: Rates) -> SwitchedTable:
        """The table with another `timing`."""
        return self._replace(edges_a=timing[0], edges_b=timing[1])

    def now(self, lanes: Lanes) -> Now:
        """The sub-step in which each lane is: to its next row or edge, or an equal part of it."""
        active = lanes.index < self.count
        at = jnp.where(active, lanes.index, 0)
        row_end = _look_up(self.time, at + 1)
        edges = tuple(
            _look_up(e, n) for e, n in zip((self.edges_a, self.edges_b), lanes.passed, strict=True)
        )
        b_first = edges[1] < edges[0]
        edge = jnp.where(b_first, edges[1], edges[0])
        at_row = row_end <= edge + jnp.maximum(self.together, 0.0)
        end = jnp.where(at_row, row_end, edge)
        rest = end - lanes.elapsed
        rest = jnp.where(active, rest - jax.lax.stop_gradient(jnp.minimum(rest, 0.0)), 0.0)
        parts = jnp.maximum(jnp.ceil(rest * (WHOLE_STEP / self.max_step)), 1.0)
        opens = zip((self.open_a, self.open_b), lanes.passed, strict=True)
        open_a, open_b = ((first + (n & 1)) == 1 for first, n in opens)
        commands = (
            _look_up(self.motor, at),
            jnp.where(open_a, 1.0, 0.0),
            jnp.where(open_b, 1.0, 0.0),
        )
        passes = (e <= end + self.together for e in edges)
        pass_a, pass_b = (
            p | (~at_row & first) for p, first in zip(passes, (~b_first, b_first), strict=True)
        )
        ahead = (end, parts <= 1.0, at_row, pass_a, pass_b)
        return Now(active, commands, rest / parts, rest, (), ahead)

    def moved(self, lanes: Lanes, now: Now, cut: Array, gone: Array) -> dict[str, Any]:
        """The lanes' places after a step that was `cut` at an event, or not, and took `gone` s."""
        end, last, at_row, *passes = now.ahead
        ended = now.active & ~cut & last
        return {
            "index": jnp.where(ended & at_row, lanes.index + 1, lanes.index),
            "elapsed": jnp.where(ended, end, lanes.elapsed + gone),
            "passed": tuple(
                jnp.where(ended & p, n + 1, n) for p, n in zip(passes, lanes.passed, strict=True)
            ),
        }

    def rows(self, lanes: Lanes) -> Array:
        """How many rows of the table lie behind each lane, (runs,)."""
        return lanes.index


Table = EventTable | SwitchedTable


def _look_up(table: Array, at: Array) -> Array:
    """table[i, at[i]] of every run i."""
    run = jnp.arange(at.shape[0])
    return table.at[run, at].get(mode="promise_in_bounds", wrap_negative_indices=False)


__all__ = ["TIME_TOLERANCE", "EventTable", "Lanes", "Now", "SwitchedTable", "Table"]
