"""The monitor over a recorded test: the observers compiled, cycle by cycle the evidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from sysid.controllers.monitor.design import MonitorDesign
from sysid.controllers.monitor.drifts import CHAMBER, SHAFT
from sysid.controllers.monitor.evidence import Cycle, Pool, Verdict
from sysid.controllers.monitor.observer import (
    ShaftNumbers,
    chamber_ahead,
    chamber_bent,
    chamber_lost,
    chamber_seen,
    chamber_start,
    chamber_switched,
    shaft_ahead,
    shaft_moves,
    shaft_seen,
    shaft_start,
)
from sysid.controllers.monitor.strokes import SHARE, Strokes
from sysid.controllers.monitor.terms import (
    ChamberPoint,
    chamber_rate,
    chamber_terms,
    past_boundary,
    shaft_effort,
)
from sysid.io.channels import SIDES
from sysid.plant.arrays import put_together, take_apart
from sysid.plant.valve_timing import (
    Grid,
    OpenIntervals,
    delayed,
    pwm_intervals,
    split_at,
    switched_intervals,
)
from sysid.types import BoolArray, FloatArray

_LENGTHS = 4096
"""Samples are filled up to a multiple of this: what is compiled serves tests of many lengths."""


@dataclass(frozen=True)
class WatchedSamples:
    """A test's readings and commands (n,), SI; `time` s since its first row.

    `valve` by side: a duty, or 1 and 0.
    """

    time: FloatArray
    position: FloatArray
    pressure: Mapping[str, FloatArray]
    motor: FloatArray
    valve: Mapping[str, FloatArray]
    is_duty: Mapping[str, bool]

    def known(self) -> BoolArray:
        """The samples (n,) whose numbers are all finite."""
        columns = (self.position, self.motor, *self.pressure.values(), *self.valve.values())
        return np.asarray(np.isfinite(np.array(columns)).all(axis=0))


@dataclass(frozen=True)
class CycleVerdict:
    """What the monitor says after the cycle that ends at `time`, s since the test's first row, and
    this cycle's own equations."""

    time: float
    row: int
    verdict: Verdict
    cycle: Cycle


def monitored(design: MonitorDesign, samples: WatchedSamples, pool: Pool) -> list[CycleVerdict]:
    """The verdict after each cycle of a test, which `pool` also collects.

    WatchedSamples that are not finite, and those after a gap, begin the observers anew.
    """
    if len(samples.time) < 2:
        return []
    stretches = _stretches(design, samples)
    seen = [_chamber(design, side, samples, stretches) for side in SIDES]
    shaft = _shaft(design, samples, stretches, [own.kink for own in seen])
    sensors = list(zip((CHAMBER[s] for s in SIDES), seen, strict=True))
    if not any(samples.is_duty.values()):
        # Under PWM the effort's ripple is not resolved well enough to speak of friction.
        sensors.append((SHAFT, shaft))
    strokes, cycle, found, begun = Strokes(SHARE * design.stroke), Cycle(), [], 0
    for k, x in enumerate(samples.position):
        if not stretches.known[k] or not strokes.ends(float(x)):
            continue
        for i, (own, shown) in enumerate(sensors):
            _collect(cycle, i, own, shown, slice(begun, k))
        found.append(CycleVerdict(float(samples.time[k]), k, pool.add(cycle), cycle))
        cycle, begun = Cycle(), k
    return found


@dataclass(frozen=True)
class _Stretches:
    """Parts of the samples between which a valve moves, and how the samples follow each other.

    `is_open` by side (m,), m stretches; `follows` (n - 1,) whether a sample is one period after
    the one before, both known.
    """

    grid: Grid
    is_open: Mapping[str, BoolArray]
    known: BoolArray
    follows: BoolArray


@dataclass(frozen=True)
class _Shown:
    """What the samples but the first show, (n - 1,): innovations, their slopes (n - 1, d).

    `counts`: whether their squares do. `kink`: how far a pressure's mean over a sample is from the
    mean of its two ends, Pa.
    """

    values: FloatArray
    slopes: FloatArray
    counts: FloatArray
    kink: FloatArray


def _stretches(design: MonitorDesign, samples: WatchedSamples) -> _Stretches:
    period = float(design.noise.period)
    opens = {side: _open(design, side, samples) for side in SIDES}
    edges = np.concatenate([e for own in opens.values() for e in (own.opens, own.closes)])
    grid = split_at(samples.time, edges, 1.5 * period)
    middle = samples.time[0] + grid.start + 0.5 * grid.duration
    known = samples.known()
    follows = known[1:] & known[:-1] & (np.diff(samples.time) < 1.5 * period)
    return _Stretches(grid, {s: own.is_open(middle) for s, own in opens.items()}, known, follows)


def _collect(cycle: Cycle, sensor: int, own: Sequence[int], shown: _Shown, span: slice) -> None:
    """Enter the innovations of samples (the one at k + 1 is row k) into a cycle."""
    slopes, values, counts = shown.slopes[span], shown.values[span], shown.counts[span]
    cycle.matrix[np.ix_(own, own)] += slopes.T @ slopes
    cycle.vector[list(own)] += slopes.T @ values
    cycle.energy += float(values @ values)
    cycle.samples += float(np.count_nonzero(values))
    # Of neighbours: what drifts or scatters slowly is no noise.
    before = np.concatenate((shown.values[:1], shown.values[:-1]))[span]
    both = counts * np.concatenate(([0.0], shown.counts[:-1]))[span]
    cycle.squares[sensor] += 0.5 * float(both @ (values - before) ** 2)
    cycle.count[sensor] += float(np.sum(both))


def _chamber(
    design: MonitorDesign, side: str, samples: WatchedSamples, stretches: _Stretches
) -> _Shown:
    grid, other = stretches.grid, "b" if side == "a" else "a"
    x, row, period = samples.position, stretches.grid.row, float(design.noise.period)
    own = stretches.is_open[side]
    before = np.concatenate(([False], own[:-1]))
    readings = samples.pressure[side]
    columns = np.array(
        [
            (0.5 * (x[1:] + x[:-1]))[row],
            (np.diff(x) / period)[row],
            readings[row],
            samples.pressure[other][row],
            own,
            stretches.is_open[other],
            own & ~before,
            before & ~own,
            grid.duration,
            readings[1:][row],
            stretches.follows[row],
            stretches.known[1:][row],
            grid.ends_sample,
        ],
        dtype=float,
    ).T
    fixed = (
        design.model,
        design.noise,
        design.chamber_scales(side),
        (design.swept[side], *design.choked[side]),
    )
    found = _run(side, fixed, columns, float(readings[0]))
    values, slopes, counts, mean, ends = (part[grid.ends_sample] for part in found)
    return _Shown(values, slopes, counts, _kink(mean - ends, stretches.follows))


def _kink(found: FloatArray, follows: BoolArray) -> FloatArray:
    return np.where(follows & np.isfinite(found), found, 0.0)


def _shaft(
    design: MonitorDesign,
    samples: WatchedSamples,
    stretches: _Stretches,
    kinks: Sequence[FloatArray],
) -> _Shown:
    pressures = [
        0.5 * (p[1:] + p[:-1]) + kink
        for p, kink in zip((samples.pressure[s] for s in SIDES), kinks, strict=True)
    ]
    x = samples.position
    columns = np.array(
        [*pressures, samples.motor[:-1], x[1:], stretches.follows, stretches.known[1:]],
        dtype=float,
    ).T
    fixed = (design.model, design.noise, design.shaft_scales, (*design.shaft, design.speed))
    values, slopes, counts = _run("", fixed, columns, float(x[0]))
    return _Shown(values, slopes, counts, np.zeros(0))


def _open(design: MonitorDesign, side: str, samples: WatchedSamples) -> OpenIntervals:
    """When a valve is open, by its commands; one that is not finite holds the last."""
    command = samples.valve[side]
    held = np.maximum.accumulate(np.where(np.isfinite(command), np.arange(len(command)), 0))
    command = np.nan_to_num(command[held])
    if samples.is_duty[side]:
        pulses = pwm_intervals(samples.time, command, float(design.model.parameters.pwm_period))
    else:
        pulses = switched_intervals(samples.time, command)
    return delayed(*pulses, *design.delays[side])


def _run(
    side: str, fixed: tuple[Any, ...], columns: FloatArray, first: float
) -> tuple[FloatArray, ...]:
    """The observer of a chamber, or of the shaft (no side), over all samples of a test."""
    from sysid.plant.jax_setup import on_processor

    count = len(columns)
    filled = np.zeros((-(-count // _LENGTHS) * _LENGTHS, columns.shape[1]))
    filled[:count] = np.where(np.isfinite(columns), columns, 0.0)
    structure, numbers = take_apart(fixed)
    with on_processor():
        found = _compiled()(
            [np.float64(n) for n in numbers],
            filled,
            np.float64(first if np.isfinite(first) else 0.0),
            side=side,
            structure=structure,
        )
        return tuple(np.asarray(part)[:count] for part in found)


@cache
def _compiled() -> Any:
    """`_observed`, compiled; jax is loaded with the first test."""
    from sysid.plant.programs import Programs

    # Of each structure of a model three are compiled: both chambers and the shaft.
    return Programs(_observed, 16)


def _observed(numbers: Any, rows: Any, first: Any, *, side: str, structure: Any) -> Any:
    """To be traced, for models of one structure."""
    fixed = put_together(structure, numbers)
    return _chamber_seen(fixed, rows, first, side) if side else _shaft_seen(fixed, rows, first)


def _chosen(follows: Any, known: Any, after: Any, anew: Any, state: Any) -> Any:
    from sysid.plant.jax_setup import jax, jnp

    return jax.tree_util.tree_map(
        lambda new, begun, old: jnp.where(follows > 0.0, new, jnp.where(known > 0.0, begun, old)),
        *(after, anew, state),
    )


def _finite(shown: Any, state: Any) -> Any:
    from sysid.plant.jax_setup import jnp

    return jnp.where(jnp.isfinite(shown.value + sum(shown.slopes) + state), 1.0, 0.0)


def _chamber_seen(fixed: Any, rows: Any, first: Any, side: str) -> Any:
    from sysid.plant.jax_setup import jax, jnp

    model, noise, scales, (swept, *choked) = fixed
    variance = noise.pressure**2

    def step(carry: Any, row: Any) -> Any:
        state, mean, begun = carry
        duration, reading, follows, known, ends = row[8:]
        share = duration / noise.period
        at = ChamberPoint(*row[:8])._replace(pressure=state.pressure)
        terms = chamber_terms(model, side, at, noise, scales, tuple(choked))
        switched = chamber_switched(state, terms.jumps)
        ahead = chamber_ahead(switched, terms, duration, swept * share)
        beyond = chamber_rate(model, side, past_boundary(at, terms), at.is_open)
        ahead = chamber_bent(switched, ahead, terms, beyond, duration)
        mean = mean + 0.5 * share * (state.pressure + ahead.pressure)
        after, shown = chamber_seen(ahead, reading, variance)
        anew = chamber_start(reading, variance)
        lost = chamber_lost(ahead, reading, variance, terms.boundary)
        ok = follows * _finite(shown, after.pressure) * jnp.where(lost, 0.0, 1.0)
        ended = _chosen(ok, known, after, anew, state)
        kept = jax.tree_util.tree_map(lambda a, b: jnp.where(ends > 0.0, a, b), ended, ahead)
        used = [jnp.where(ok > 0.0, v, 0.0) for v in (shown.value, jnp.stack(shown.slopes))]
        out = (*used, ok, mean, 0.5 * (begun + ahead.pressure))
        begun = jnp.where(ends > 0.0, kept.pressure, begun)
        return (kept, jnp.where(ends > 0.0, 0.0, mean), begun), out

    return jax.lax.scan(step, (chamber_start(first, variance), 0.0 * first, first), rows)[1]


def _shaft_seen(fixed: Any, rows: Any, first: Any) -> Any:
    from sysid.plant.jax_setup import jax, jnp

    model, noise, scales, (*held, speed) = fixed
    variance, shaft = noise.position**2, ShaftNumbers(*held)

    def step(state: Any, row: Any) -> Any:
        at_a, at_b, motor, reading, follows, known = row
        effort = shaft_effort(model, state.position, state.velocity, at_a, at_b, motor)
        counts = jnp.where(shaft_moves(state, shaft), follows, 0.0)
        ahead = shaft_ahead(state, effort, noise.period, shaft, scales)
        after, shown = shaft_seen(ahead, reading, variance)
        anew = shaft_start(reading, variance, speed**2)
        ok = follows * _finite(shown, after.velocity)
        kept = _chosen(ok, known, after, anew, state)
        counts = ok * counts
        used = [jnp.where(ok > 0.0, v, 0.0) for v in (shown.value, jnp.stack(shown.slopes))]
        return kept, (*used, counts)

    return jax.lax.scan(step, shaft_start(first, variance, speed**2), rows)[1]


__all__ = ["CycleVerdict", "WatchedSamples", "monitored"]
