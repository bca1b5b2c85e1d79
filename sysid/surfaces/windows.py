"""What the windows of a held chamber's pressure make of a valve's law.

A sample of mean flow is the slope of a moving mean over a window of rows. Where pulses move the
pressure far, next to how far the law stays the same, no formula says which flow and which pressure
come out: the chamber is simulated over the window, pulse by pulse, and what its rows give is taken.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sysid.plant.base import Array
from sysid.plant.steps import heun
from sysid.surfaces.averaged import AveragedLaw
from sysid.types import FloatArray, IntArray

# Of a PWM period, at least. Half of them move the numbers of a chamber that fills in six periods by
# four tenths of their standard errors, these by a tenth.
_STEPS = 40
# Places of the pulses that stand for all of them where it is not known.
_PLACES = (np.arange(4) + 0.5) / 4

Chamber = tuple[FloatArray, ...]
"""Of each window's chamber (n,): supply [Pa], k R T / V [Pa/kg], a further flow into it [kg/s]."""


@dataclass(frozen=True, eq=False)
class FlowWindows:
    """Of which rows of its test each sample is made; all (n,).

    `row`: the first one, `rows`: how many, `start`: the pressure there [Pa], `block`: how many rows
    a moving mean takes, `period`: from row to row [s], `error`: of the mean pressure [Pa].
    """

    row: NDArray[np.intp]
    rows: NDArray[np.intp]
    start: FloatArray
    block: NDArray[np.intp]
    period: FloatArray
    error: FloatArray

    def __len__(self) -> int:
        return len(self.row)

    def select(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> FlowWindows:
        """Those of the samples in `rows`."""
        return FlowWindows(*(getattr(self, field.name)[rows] for field in fields(self)))

    @classmethod
    def joined(cls, parts: list[FlowWindows]) -> FlowWindows:
        """The windows of all parts, one after the other."""
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in names))

    def under(
        self, law: AveragedLaw, share: FloatArray, centre: FloatArray, chamber: Chamber
    ) -> tuple[FloatArray, FloatArray]:
        """Mean pressure, Pa, and flow, kg/s, (n,) that the windows show of a valve of this law.

        `share` of the PWM period in which it is open, about `centre` of it, counted from the test's
        first row (NaN: the mean over all places), both (n,).
        """
        pressure, flow = np.empty(len(self)), np.empty(len(self))
        known = np.isfinite(centre)
        for rows, places in (
            (known, (centre,)),
            (~known, [np.full(len(self), p) for p in _PLACES]),
        ):
            for own in self._alike(rows):
                windows, given = self.select(own), tuple(column[own] for column in chamber)
                found = [_seen(law, windows, share[own], place[own], given) for place in places]
                pressure[own], flow[own] = np.mean(found, axis=0)
        return pressure, flow

    def _alike(self, rows: NDArray[np.bool_]) -> Iterator[NDArray[np.intp]]:
        """Numbers of those windows in `rows` that have one period and block, the longest first."""
        order = np.argsort(-self.rows, kind="stable")
        kinds = np.unique(np.column_stack((self.period, self.block)), axis=0)
        for period, block in kinds:
            own = rows & (self.period == period) & (self.block == block)
            if own.any():
                yield order[own[order]]


def _seen(
    law: AveragedLaw,
    windows: FlowWindows,
    share: FloatArray,
    centre: FloatArray,
    chamber: Chamber,
) -> tuple[FloatArray, FloatArray]:
    """`FlowWindows.under` for windows of one period and block, the longest first."""
    period, block = float(windows.period[0]), int(windows.block[0])
    course = _course(law, windows, share, centre, chamber)
    total = np.vstack((np.zeros(len(share)), np.cumsum(course, axis=0)))
    means = (total[block:] - total[:-block]) / block
    count = windows.rows - block + 1
    kept = np.arange(len(means)) < count[:, None]
    end = np.cumsum(count)
    rate, pressure = slopes(means.T[kept], end - count, end, period)
    return pressure, rate / chamber[1]


def _course(
    law: AveragedLaw,
    windows: FlowWindows,
    share: FloatArray,
    centre: FloatArray,
    chamber: Chamber,
) -> FloatArray:
    """Pressure (rows, n), Pa, at the windows' rows; 0 beyond a window's end."""
    pwm, period = float(law.period), float(windows.period[0])
    parts = int(np.ceil(_STEPS * period / pwm))
    step = period / parts
    course = np.zeros((int(windows.rows[0]), len(share)))
    course[0] = pressure = windows.start
    before, opens = windows.row.astype(float), centre - 0.5 * share
    begun = _opened(before * period / pwm, share, opens)
    # How many windows, the longest first, have each row.
    counts = np.searchsorted(-windows.rows, -np.arange(len(course)), side="left").tolist()
    n = -1
    for row in range(1, len(course)):
        if n != counts[row]:
            n = counts[row]
            pressure, begun, before = pressure[:n], begun[:n], before[:n]
            share, opens = share[:n], opens[:n]
            supply, per_flow, added = (column[:n] for column in chamber)
            flow_between = law.between((supply, law.atmosphere))
        for part in range(1, parts + 1):
            until = _opened(((before + (row - 1)) * period + part * step) / pwm, share, opens)
            # The valve moves within a step: it is open for a part of it.
            rates = partial(_rates, flow_between, (until - begun) * pwm / step, per_flow, added)
            (pressure,) = heun([pressure], rates([pressure]), rates, step)
            begun = until
        course[row, :n] = pressure
    return course


def _rates(
    flow_between: Callable[[Array, Array], Array],
    share: FloatArray,
    per_flow: FloatArray,
    added: FloatArray,
    state: Sequence[Array],
) -> list[Array]:
    """dP/dt (n,), Pa/s, of held chambers at the pressures in `state`."""
    return [per_flow * (flow_between(share, state[0]) + added)]


def _opened(turns: Array, share: FloatArray, opens: FloatArray) -> FloatArray:
    """For how many PWM periods, of so many turns since a test's first row, the valve was open.

    `opens`: after how many turns it first does.
    """
    since = turns - opens
    whole = np.floor(since)
    return np.asarray(whole * share + np.minimum(since - whole, share))


def slopes(
    values: FloatArray, begin: IntArray, end: IntArray, period: float
) -> tuple[FloatArray, FloatArray]:
    """Least-squares slope [Pa/s] of each window, and the mean pressure with its weights.

    `values` [Pa] are evenly spaced by `period` [s]; `begin` and `end` bound each window, in order
    and without overlap. The slope over n points is the mean of the differences between
    neighbours, weighted by i (n - i), i = 1..n-1; the pressure is the mean of the neighbours'
    midpoints, weighted alike.
    """
    n = (end - begin).astype(float)
    # Windows may leave gaps: every second segment of reduceat is one of them.
    bounds = np.column_stack((begin, end)).ravel()
    c = np.arange(len(values)) - np.repeat(*_centres(begin, end, len(values)))
    padded = np.concatenate((values, [0.0]))
    c = np.concatenate((c, [0.0]))
    sums = [np.add.reduceat(padded * c**k, bounds)[::2] for k in range(3)]
    slope = 12.0 * sums[1] / (n * (n * n - 1.0)) / period
    half = 0.25 * (n * n - 1.0)
    pressure = 6.0 * (half * sums[0] - sums[2]) / (n * (n * n - 1.0))
    return np.asarray(slope), np.asarray(pressure)


def _centres(begin: IntArray, end: IntArray, size: int) -> tuple[FloatArray, IntArray]:
    """Centre index of the window that each of `size` points belongs to, as repeats."""
    centre = 0.5 * (begin + end - 1)
    bounds = np.concatenate((begin, [size]))
    bounds[0] = 0
    return np.asarray(centre), np.diff(bounds)


__all__ = ["FlowWindows", "slopes"]
