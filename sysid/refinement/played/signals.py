"""Commands of a short test: multisines and steps, between a rest and a rest.

A multisine excites many frequencies at once (Pintelon, Schoukens 2012, 5.2), steps of random level
and length everything that settles. A test begins and ends with all commands at zero and ramps
between, so that a rig may play it from a standstill and comes to one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.io.rig import Rig
from sysid.types import FloatArray

# Shares of a test: at rest with all commands at zero, and each of its ramps.
_REST, _RAMP = 0.04, 0.08
# Of a test: the shortest time until nothing is commanded any more, a rest and two ramps and more.
_SHORTEST = 0.3
_SINES, _MOST_STEPS = 4, 6
# Rows in the shortest period of a sine: at the sampling theorem's two nothing of it is seen.
_ROWS_A_PERIOD = 20
# Standard deviations of the largest change: log frequency and weight, phase in rad, level; and the
# smallest change, a share of it.
_CHANGE, _FINEST = (0.15, 0.4, 0.15), 0.1
_SMALLER = 0.75
# Range of a duty's middle, and of a switched wave's threshold, at full size.
_MIDDLE, _THRESHOLD = (0.03, 0.9), (-0.1, 0.7)


@dataclass(frozen=True, eq=False)
class Wave:
    """A signal of at most 1: `mix` of steps, the rest a multisine.

    `hz`, `phase`, `weight` (sines,); `levels` (k,) -1 to 1, each from its `at` (k,) on, shares of
    the test.
    """

    hz: FloatArray
    phase: FloatArray
    weight: FloatArray
    at: FloatArray
    levels: FloatArray
    mix: float

    @classmethod
    def drawn(cls, rng: np.random.Generator, band: tuple[float, float]) -> Wave:
        """A wave with frequencies in a band, Hz."""
        steps = int(rng.integers(2, _MOST_STEPS + 1))
        return cls(
            hz=np.exp(rng.uniform(math.log(band[0]), math.log(band[1]), _SINES)),
            phase=rng.uniform(0.0, 2.0 * math.pi, _SINES),
            weight=rng.uniform(0.1, 1.0, _SINES),
            at=np.sort(rng.uniform(_REST, 1.0 - _REST, steps)),
            levels=rng.uniform(-1.0, 1.0, steps),
            mix=float(rng.choice([0.0, 0.5, 1.0])),
        )

    def changed(
        self, rng: np.random.Generator, band: tuple[float, float], much: float = 1.0
    ) -> Wave:
        """A neighbour of it, `much` (0 to 1) off."""
        ratio, turn, step = (much * c for c in _CHANGE)
        n, k = len(self.hz), len(self.at)
        return Wave(
            hz=np.clip(self.hz * np.exp(ratio * rng.standard_normal(n)), *band),
            phase=self.phase + turn * rng.standard_normal(n),
            weight=self.weight * np.exp(ratio * rng.standard_normal(n)),
            at=np.sort(np.clip(self.at + 0.1 * step * rng.standard_normal(k), _REST, 1.0 - _REST)),
            levels=np.clip(self.levels + step * rng.standard_normal(k), -1.0, 1.0),
            mix=float(np.clip(self.mix + step * rng.standard_normal(), 0.0, 1.0)),
        )

    def values(self, time: FloatArray) -> FloatArray:
        """(n,) at `time` (n,) s from the test's first row."""
        angle = 2.0 * math.pi * self.hz[:, None] * time + self.phase[:, None]
        sines = self.weight @ np.sin(angle)
        sines /= np.abs(sines).max() or 1.0
        number = np.searchsorted(self.at, time / time[-1], side="right")
        stepped = np.concatenate([[0.0], self.levels])[number]
        return np.asarray((1.0 - self.mix) * sines + self.mix * stepped)


@dataclass(frozen=True)
class Actuators:
    """What a rig is driven by: the rows of a test, and the largest commands.

    `time` (n,) s; `effort` Nm or N, 0 without a motor; `pwm_rows` in a PWM period, 0 without;
    `hold_rows` the shortest time for which a valve stays switched, in rows; `valves` how many
    there are; `bleeds`: the second one empties the chamber that the first one fills; `reach`, rad
    or m: how far from where it rests a test may begin.
    """

    time: FloatArray
    effort: float
    pwm_rows: int
    hold_rows: int
    valves: int = 2
    bleeds: bool = False
    reach: float = 0.0

    @classmethod
    def of(
        cls, rig: Rig, row_s: float, seconds: float, effort: float, reach: float = 0.0
    ) -> Actuators:
        """Those of a rig, for tests of so many seconds."""
        time = np.asarray(np.arange(round(seconds / row_s)) * row_s, dtype=float)
        pwm = 0 if rig.pwm is None else round(rig.pwm.period_s / row_s)
        valves = rig.valves
        # A shorter pulse never opens the valve, a shorter pause never closes it.
        hold = 0.0 if valves is None else 2.0 * (valves.on_delay_s + valves.off_delay_s)
        rows = max(math.ceil(hold / row_s), 1)
        return cls(time, effort, pwm, rows, len(rig.valve_names), rig.bleeds, reach)

    @property
    def seconds(self) -> float:
        """Duration of a test, s."""
        return len(self.time) * float(self.time[1] - self.time[0])

    def band(self, rows: int) -> tuple[float, float]:
        """The frequencies that a command can have which changes every so many rows, Hz."""
        row_s = float(self.time[1] - self.time[0])
        lowest = 1.0 / self.seconds
        return lowest, max(1.0 / (_ROWS_A_PERIOD * rows * row_s), 2.0 * lowest)

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of motion test that they can do."""
        motor = ("motion-motor",) if self.effort > 0.0 else ()
        return (*motor, *(("motion-pwm",) if self.pwm_rows else ()), "motion-discrete")

    def window(self, until: float) -> FloatArray:
        """(n,) 0 at rest, 1 within, cosine ramps between; at rest again from `until` on, a share of
        the test."""
        share = self.time / self.time[-1]
        side = np.clip((np.minimum(share, until - share) - _REST) / _RAMP, 0.0, 1.0)
        return np.asarray(0.5 * (1.0 - np.cos(math.pi * side)))


@dataclass(frozen=True, eq=False)
class Drive:
    """How a test is driven: its kind, its waves, and how large they are.

    `motor` None: not driven. `valves`: of each; `middle` (valves,) of the duties, or the
    threshold above which a valve is on; `span` of the duties. `size` 0 to 1 scales all of it.
    `start`, rad or m from where the rig rests: a stroke from one side has twice the way.
    `until`: share of the test after which nothing is commanded any more: open loop, a plant off
    the model drifts away the farther the longer it is driven.
    """

    kind: str
    motor: Wave | None
    valves: tuple[Wave, ...] | None
    middle: FloatArray
    span: float
    share: float
    until: float = 1.0
    size: float = 1.0
    start: float = 0.0

    @classmethod
    def drawn(cls, kind: str, rng: np.random.Generator, rig: Actuators) -> Drive:
        """A drive of a kind.

        Two valves act in opposition, which moves the piston, together, which fills both
        chambers under hardly any motion, or each by itself.
        """
        motor_band, valve_band = rig.band(1), rig.band(_rows(kind, rig))
        with_motor = kind == "motion-motor" or (rig.effort > 0.0 and rng.random() < 0.5)
        motor = Wave.drawn(rng, motor_band) if with_motor else None
        share, span = float(rng.uniform(0.3, 1.0)), float(rng.uniform(0.3, 1.0))
        until = float(rng.uniform(_SHORTEST, 1.0))
        start = _readable(rig.reach * float(rng.choice([0.0, rng.uniform(-1.0, 1.0)])))
        if kind == "motion-motor":
            return cls(kind, motor, None, np.zeros(rig.valves), span, share, until, start=start)
        one = Wave.drawn(rng, valve_band)
        opposed = replace(one, phase=one.phase + math.pi, levels=-one.levels)
        other = (opposed, one, Wave.drawn(rng, valve_band))[int(rng.integers(3))]
        if rng.random() < 0.5:
            other = other.changed(rng, valve_band)
        low, high = _MIDDLE if kind == "motion-pwm" else _THRESHOLD
        middle = rng.uniform(low, high) * (1.0 + 0.2 * rng.uniform(-1.0, 1.0, rig.valves))
        return cls(kind, motor, (one, other)[: rig.valves], middle, span, share, until, start=start)

    def changed(self, rng: np.random.Generator, rig: Actuators) -> Drive:
        """A neighbour of it, as large as it may be."""
        band = rig.band(_rows(self.kind, rig))
        valves = self.valves
        much = float(np.exp(rng.uniform(math.log(_FINEST), 0.0)))
        step = much * _CHANGE[2]
        return replace(
            self,
            motor=None if self.motor is None else self.motor.changed(rng, rig.band(1), much),
            valves=None if valves is None else tuple(v.changed(rng, band, much) for v in valves),
            middle=self.middle * np.exp(step * rng.standard_normal(len(self.middle))),
            span=float(np.clip(self.span + step * rng.standard_normal(), 0.1, 1.0)),
            share=float(np.clip(self.share + step * rng.standard_normal(), 0.05, 1.0)),
            until=float(np.clip(self.until + step * rng.standard_normal(), _SHORTEST, 1.0)),
            size=min(1.0, self.size / _SMALLER),
            start=_readable(rig.reach * _within_one(self.start / (rig.reach or 1.0), step, rng)),
        )

    def smaller(self) -> Drive:
        """One that moves less: shorter, or weaker, whichever is left to be lessened more."""
        if self.until > max(self.size, _SHORTEST):
            return replace(self, until=max(_SMALLER * self.until, _SHORTEST))
        return replace(self, size=_SMALLER * self.size)

    def commands(self, rig: Actuators) -> tuple[FloatArray, FloatArray | None]:
        """Motor (n,) Nm or N, and valves (valves, n): duties, or 0 and 1; None: all off.

        A chamber that stays shut without a command is emptied at the end, where tests end at rest.
        """
        window, n = rig.window(self.until), len(rig.time)
        motor = np.zeros(n)
        if self.motor is not None:
            motor = np.clip(self.share * self.motor.values(rig.time), -1.0, 1.0)
            motor = self.size * rig.effort * window * motor
        if self.valves is None:
            return motor, None
        rows = _rows(self.kind, rig)
        held = np.arange(n) // rows * rows
        pairs = zip(self.valves, self.middle, strict=True)
        if self.kind == "motion-pwm":
            duties = [m * (1.0 + self.span * w.values(rig.time)) for w, m in pairs]
            found = self.size * window * np.clip(duties, 0.0, 1.0)
            found = np.round(np.clip(found, 0.0, 0.95), 4)[:, held]
            return motor, _emptied(found, rig)
        # A smaller test has shorter and fewer pulses.
        above = [w.values(rig.time) - (1.0 - self.size * (1.0 - m)) for w, m in pairs]
        inside = (window > 0.0) & (window[np.minimum(held + rows, n - 1)] > 0.0)
        return motor, _emptied(np.where(inside[held], np.asarray(above)[:, held] > 0.0, 0.0), rig)


def _emptied(valves: FloatArray, rig: Actuators) -> FloatArray:
    """The commands (valves, n) with the bleed valve on at the end, from the last ramp on."""
    if rig.bleeds:
        last = rig.time >= (1.0 - _REST - _RAMP) * rig.time[-1]
        valves[0, last], valves[1, last] = 0.0, 1.0
    return valves


def _readable(value: float) -> float:
    """As an operator reads it who brings the arm there."""
    return float(f"{value:.3g}")


def _within_one(value: float, step: float, rng: np.random.Generator) -> float:
    return float(np.clip(value + step * rng.standard_normal(), -1.0, 1.0))


def _rows(kind: str, rig: Actuators) -> int:
    return rig.pwm_rows if kind == "motion-pwm" else rig.hold_rows


def drawn_drives(
    kind: str, count: int, rig: Actuators, rng: np.random.Generator
) -> Sequence[Drive]:
    """So many drives of a kind."""
    return [Drive.drawn(kind, rng, rig) for _ in range(count)]


__all__ = ["Actuators", "Drive", "Wave", "drawn_drives"]
