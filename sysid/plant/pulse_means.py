"""A valve's pulses as means over PWM periods, and the ripple of the pressure within a period.

The mean-flow models know a chamber's pressure at the ends of the periods. Within one, it rises
above the straight line between them while the valve is open and falls back while it is not:
by `ripple` times its pressure rise over a period, k R T / V T (open flow - closed flow).
The ripple may break away a shaft that the mean effort alone would not move. A period begins when
its pulse can begin, a switch-on delay after the command's. numpy only; all times in s.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.plant.valve_timing import TIME_TOLERANCE, OpenIntervals
from sysid.types import FloatArray


@dataclass(frozen=True)
class PulseMeans:
    """One valve over the sub-steps of a run, (n,) each.

    `period`: number of the PWM period, -1 before the first. `share` of it in which the valve is
    open, 0 to 1. `ripple_start`, `ripple_end`: at the sub-step's ends, and `ripple_mean` over
    the period, in shares of a period.
    """

    period: NDArray[np.intp]
    share: FloatArray
    ripple_start: FloatArray
    ripple_end: FloatArray
    ripple_mean: FloatArray


def pulse_means(
    begins: FloatArray,
    intervals: OpenIntervals,
    start: FloatArray,
    duration: FloatArray,
    end: float,
) -> PulseMeans:
    """Means over the periods that begin at `begins` (periods,), by sub-step.

    Sub-steps begin at `start` (n,) and last `duration` (n,); the last period ends at `end`.
    Before the first period the valve is as it was, without ripple.
    """
    ends = np.concatenate((begins[1:], [end]))
    # A valve may have been open since before the run and stay open after it: only the run counts.
    first_time, last_time = min(start[0], begins[0]) - 1.0, max(end, start[-1] + duration[-1]) + 1.0
    intervals = OpenIntervals(
        np.maximum(intervals.opens, first_time), np.minimum(intervals.closes, last_time)
    )
    shares = intervals.open_fraction(begins, ends)
    # The area under the triangle; two pulses in a period make it smaller, which is rare.
    middles = 0.5 * shares * (1.0 - shares)
    k = np.searchsorted(begins, start + TIME_TOLERANCE, side="right") - 1
    known = np.maximum(k, 0)
    was_open = float(intervals.is_open(start[:1])[0])
    first, length, share = begins[known], (ends - begins)[known], shares[known]

    def ripple(time: FloatArray) -> FloatArray:
        open_time = intervals.open_time(first, np.maximum(time, first))
        return np.where(k < 0, 0.0, (open_time - share * (time - first)) / length)

    return PulseMeans(
        period=k,
        share=np.where(k < 0, was_open, share),
        ripple_start=ripple(start),
        ripple_end=ripple(start + duration),
        ripple_mean=np.where(k < 0, 0.0, middles[known]),
    )


__all__ = ["PulseMeans", "pulse_means"]
