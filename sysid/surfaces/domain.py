"""Where a surface is valid: the duties that the flow responds to, and the hull of the data.

The rule is the same for both surfaces and uses only the samples:

1. A test has one duty. Tests of equal duty (to 1e-4) form a level; a level's flow as a
   function of pressure is its mean in each of 64 pressure bins.
2. The local slope dm/du between levels at least 0.02 apart (median over 12 pressure bins of
   the range that both visited), as a fraction of the typical slope at the same pressure
   (median; of the levels that are not dead where most are), shows whether the valve still
   responds. From each end of the duty range inward, levels are excluded while that fraction
   is below one half: there (pulses that vanish, a valve that never closes, a chamber that
   stays within the noise of the supply pressure) flow and pressure do not determine the duty.
   The level at which the flat stretch begins is kept.
3. The hull of the remaining levels: duty and pressure range, and as functions of pressure the
   lowest and highest duty and flow that were seen, widened by one grid step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sysid.errors import NotIdentifiedError, input_error
from sysid.surfaces.estimator import checked_samples
from sysid.types import FloatArray, IntArray

SAME_SUPPLY = 0.02
"""Share by which supplies may differ and be one to a surface: choked flow has the same error."""
PRESSURE_BINS = 64
DUTY_RESOLUTION = 1e-4
PAIR_BINS = 12
SLOPE_WINDOW = 0.02
DEAD_FRACTION = 0.5
# Slopes vary over pressure with the valve's open flow, by a factor of about 4. Where the typical
# one is this share of the largest, all levels that meet there are dead and show their noise.
_LEAST_SLOPE = 0.05
# Dead levels' slopes lie below this share of the steepest tenth's, a bent valve's above it: the
# median of a flow that follows the duty's n-th power is (5/9)^(n-1) of that, 0.17 for the fourth.
_DEAD_SLOPE = 0.1


@dataclass(frozen=True, eq=False)
class LevelFlows:
    """Mean flow by duty level and pressure bin.

    `duty` (L,); `pressure` (B,) bin centres, Pa; `flow` (L, B) kg/s, interpolated inside
    the pressure range that the level visited and NaN outside it; `count` (L, B) samples;
    `level` (n,) the level of each sample.
    """

    duty: FloatArray
    pressure: FloatArray
    flow: FloatArray
    count: IntArray
    level: IntArray


@dataclass(frozen=True, eq=False)
class Domain:
    """The hull in which a surface is valid.

    `duty_range`, `pressure_range` [Pa]: (low, high). On the nodes `pressure` (G,) [Pa]:
    `duty_low`, `duty_high` and `flow_low`, `flow_high` [kg/s], all (G,); linear between.
    """

    duty_range: tuple[float, float]
    pressure_range: tuple[float, float]
    pressure: FloatArray
    duty_low: FloatArray
    duty_high: FloatArray
    flow_low: FloatArray
    flow_high: FloatArray

    @classmethod
    def from_samples(cls, duty: ArrayLike, pressure: ArrayLike, flow: ArrayLike) -> Domain:
        """The domain of samples (n,) of constant-duty tests in one direction.

        Raises NotIdentifiedError where there are fewer than 3 duties, the pressure does
        not vary, or the flow does not grow with the duty.
        """
        u, p, m = checked_samples(duty, pressure, flow)
        levels = level_flows(u, p, m)
        first, last = _answering_levels(levels, p, m)
        if first > 0 or last < len(levels.duty) - 1:
            p = p[(levels.level >= first) & (levels.level <= last)]
        held = slice(first, last + 1)
        return cls._hull(levels, held, float(p.min()), float(p.max()))

    @classmethod
    def _hull(cls, levels: LevelFlows, held: slice, low: float, high: float) -> Domain:
        nodes = np.linspace(low, high, 25)
        step = nodes[1] - nodes[0]
        reach = np.abs(levels.pressure[None, :] - nodes[:, None]) <= 1.01 * step
        duty, flow = levels.duty[held], levels.flow[held]
        seen = np.isfinite(flow)
        rows = []
        for near in reach:
            present = seen & near[None, :]
            if not present.any():
                rows.append([np.nan] * 4)
                continue
            duties, flows = duty[present.any(axis=1)], flow[present]
            rows.append([duties.min(), duties.max(), flows.min(), flows.max()])
        table = np.array(rows, dtype=float)
        known = np.isfinite(table[:, 0])
        filled = [np.interp(nodes, nodes[known], column[known]) for column in table.T]
        return cls((float(duty[0]), float(duty[-1])), (low, high), nodes, *filled)

    def with_points(self, duty: FloatArray, pressure: FloatArray, flow: FloatArray) -> Domain:
        """The domain that holds points (k,) at pressures of its range, too; its nodes stay."""
        if len(duty) == 0:
            return self
        step = self.pressure[1] - self.pressure[0]
        near = np.abs(pressure[None, :] - self.pressure[:, None]) <= 1.01 * step

        def edge(known: FloatArray, values: FloatArray, sign: float) -> FloatArray:
            reached = np.where(near, sign * values, -np.inf).max(axis=1)
            return np.asarray(sign * np.maximum(sign * known, reached))

        return Domain(
            (
                min(self.duty_range[0], float(duty.min())),
                max(self.duty_range[1], float(duty.max())),
            ),
            self.pressure_range,
            self.pressure,
            edge(self.duty_low, duty, -1.0),
            edge(self.duty_high, duty, 1.0),
            edge(self.flow_low, flow, -1.0),
            edge(self.flow_high, flow, 1.0),
        )

    def holds_duty(self, duty: ArrayLike) -> NDArray[np.bool_]:
        """Whether each duty (n,) lies in the identified duty range."""
        u = np.asarray(duty, dtype=float)
        low, high = self.duty_range
        return np.asarray((u >= low - DUTY_RESOLUTION) & (u <= high + DUTY_RESOLUTION))

    def hull(self) -> dict[str, FloatArray]:
        """The numbers that every `FlowLaw` holds, by its fields."""
        return {
            "duty_range": np.array(self.duty_range),
            "pressure_range": np.array(self.pressure_range),
            "pressure": self.pressure,
            "duty_low": self.duty_low,
            "duty_high": self.duty_high,
            "flow_low": self.flow_low,
            "flow_high": self.flow_high,
        }

    def duty_limits(self, pressure: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest duty that was seen at each pressure (n,)."""
        return (
            np.interp(pressure, self.pressure, self.duty_low),
            np.interp(pressure, self.pressure, self.duty_high),
        )

    def flow_limits(self, pressure: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Lowest and highest flow [kg/s] that was seen at each pressure (n,)."""
        return (
            np.interp(pressure, self.pressure, self.flow_low),
            np.interp(pressure, self.pressure, self.flow_high),
        )

    def to_dict(self) -> dict[str, Any]:
        """JSON-able; `from_dict` reads it."""
        return {
            "duty": list(self.duty_range),
            "pressure_pa": list(self.pressure_range),
            "nodes": {
                "pressure_pa": self.pressure.tolist(),
                "duty_low": self.duty_low.tolist(),
                "duty_high": self.duty_high.tolist(),
                "flow_low_kg_s": self.flow_low.tolist(),
                "flow_high_kg_s": self.flow_high.tolist(),
            },
        }

    @classmethod
    def from_dict(cls, content: dict[str, Any]) -> Domain:
        """Read `to_dict`'s form. Raises InputError for a missing key."""
        keys = ("pressure_pa", "duty_low", "duty_high", "flow_low_kg_s", "flow_high_kg_s")
        try:
            duty, pressure = content["duty"], content["pressure_pa"]
            nodes = [np.asarray(content["nodes"][key], dtype=float) for key in keys]
        except KeyError as error:
            raise input_error(
                "PWM surface", f"domain has no {error.args[0]}", "fit the surface again"
            ) from None
        if any(node.shape != nodes[0].shape or node.ndim != 1 for node in nodes):
            raise input_error("PWM surface", "domain nodes differ in length", "fit it again")
        return cls(
            (float(duty[0]), float(duty[1])), (float(pressure[0]), float(pressure[1])), *nodes
        )


def duty_levels(duty: FloatArray) -> tuple[FloatArray, IntArray]:
    """Duty of each level (L,) and the level of each sample (n,).

    Duties are distinguished to 1e-4, or to 0.01 where that gives more than 400 levels.
    """
    resolution = DUTY_RESOLUTION
    while True:
        key = np.rint(duty / resolution).astype(np.intp)
        count = np.bincount(key)
        held = np.flatnonzero(count)
        if len(held) <= 400 or resolution >= 0.01:
            break
        resolution = 0.01
    index = np.zeros(len(count), dtype=np.intp)
    index[held] = np.arange(len(held))
    level = index[key]
    return np.bincount(level, duty) / count[held], level


def pressure_bins(pressure: FloatArray, bins: int) -> tuple[FloatArray, IntArray]:
    """Bin edges (bins + 1,) over the range, and the bin of each sample (n,)."""
    low, high = float(pressure.min()), float(pressure.max())
    if high - low < 1e-3 * high:
        raise NotIdentifiedError(
            f"the pressure stays at {low:.0f} Pa, so the flow over pressure cannot be "
            "identified; a valve-pwm test that fills or empties the chamber would"
        )
    index = ((pressure - low) * (bins / (high - low))).astype(np.intp)
    np.minimum(index, bins - 1, out=index)
    return np.linspace(low, high, bins + 1), index


def level_flows(duty: FloatArray, pressure: FloatArray, flow: FloatArray) -> LevelFlows:
    """Mean flow by duty level and pressure bin, from samples (n,)."""
    levels, level = duty_levels(duty)
    if len(levels) < 3:
        raise NotIdentifiedError(
            f"flow over duty needs at least 3 duties and the samples hold {len(levels)}; "
            "valve-pwm tests at more duties (one test each) would identify it"
        )
    edges, column = pressure_bins(pressure, PRESSURE_BINS)
    shape = (len(levels), PRESSURE_BINS)
    cell = level * PRESSURE_BINS + column
    size = shape[0] * shape[1]
    count = np.bincount(cell, minlength=size).reshape(shape)
    total = np.maximum(count, 1)
    mean_pressure = np.bincount(cell, pressure, size).reshape(shape) / total
    mean_flow = np.bincount(cell, flow, size).reshape(shape) / total
    centre = 0.5 * (edges[1:] + edges[:-1])
    table = np.full(shape, np.nan)
    for row in range(shape[0]):
        held = np.flatnonzero(count[row])
        span = slice(held[0], held[-1] + 1)
        table[row, span] = np.interp(centre[span], mean_pressure[row, held], mean_flow[row, held])
    return LevelFlows(levels, centre, table, count, level)


def _answering_levels(
    levels: LevelFlows, pressure: FloatArray, flow: FloatArray
) -> tuple[int, int]:
    """First and last level at which the flow responds to the duty (rule 2 above)."""
    held, slope = _typical_slope(levels)

    def samples(index: int) -> tuple[FloatArray, FloatArray]:
        rows = levels.level == index
        return pressure[rows], flow[rows]

    def answers(near: int, step: int) -> bool:
        far = near + step
        gap = levels.duty[far] - levels.duty[near]
        while 0 < far < len(levels.duty) - 1 and abs(gap) < SLOPE_WINDOW - 1e-9:
            far += step
            gap = levels.duty[far] - levels.duty[near]
        centre, difference = _flow_difference(samples(near), samples(far))
        if difference.size == 0:  # never at the same pressure: no evidence that it is dead
            return True
        rise = difference / (gap * np.interp(centre, held, slope))
        return float(np.median(rise)) >= DEAD_FRACTION

    first, last = 0, len(levels.duty) - 1
    while first < last - 2 and not answers(first, 1):
        first += 1
    while last > first + 2 and not answers(last, -1):
        last -= 1
    return first, last


def _typical_slope(levels: LevelFlows) -> tuple[FloatArray, FloatArray]:
    """Median dm/du over the levels at the pressures (B,) where enough of them meet.

    Where most levels are dead the median would be theirs: then it is the others'.
    """
    slopes = np.diff(levels.flow, axis=0) / np.diff(levels.duty)[:, None]
    known = np.isfinite(slopes).sum(axis=0)
    # Where few levels meet, those few may all be dead and would set the scale themselves.
    wide = np.flatnonzero(known >= max(1, known.max() // 2))
    typical = np.array([_slope_of_most(slopes[:, b]) for b in wide])
    rising = typical > _LEAST_SLOPE * typical.max(initial=0.0)
    if rising.sum() < 0.5 * len(wide) or not rising.any():
        raise NotIdentifiedError(
            "the mean flow does not grow with the duty, so duty(flow, pressure) cannot be "
            "identified; check which valve moved and that each test holds one duty"
        )
    return levels.pressure[wide[rising]], typical[rising]


def _slope_of_most(slopes: FloatArray) -> float:
    """Median of the finite slopes (k,), or of those that are not dead where most are."""
    middle, steep = np.nanquantile(slopes, (0.5, 0.9))
    if steep <= 0.0 or middle >= _DEAD_SLOPE * steep:
        return float(middle)
    return float(np.median(slopes[slopes > _DEAD_SLOPE * steep]))


def _flow_difference(
    near: tuple[FloatArray, FloatArray], far: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Pressures in the range that both levels visited, and far's flow less near's there.

    Each level's flow is the mean in 12 bins of that range, so that a level which hardly
    leaves the supply pressure is resolved as well as one that crosses the whole range.
    """
    low = max(near[0].min(), far[0].min())
    high = min(near[0].max(), far[0].max())
    if not high > low:
        return np.empty(0), np.empty(0)
    curves = []
    for pressure, flow in (near, far):
        inside = (pressure >= low) & (pressure <= high)
        index = ((pressure[inside] - low) * (PAIR_BINS / (high - low))).astype(np.intp)
        index = np.minimum(index, PAIR_BINS - 1)
        count = np.bincount(index, minlength=PAIR_BINS)
        held = count > 0
        mean = [
            np.bincount(index, v[inside], PAIR_BINS)[held] / count[held] for v in (pressure, flow)
        ]
        curves.append(mean)
    if any(len(mean[0]) == 0 for mean in curves):
        return np.empty(0), np.empty(0)
    centre = low + (np.arange(PAIR_BINS) + 0.5) * (high - low) / PAIR_BINS
    values = [np.interp(centre, mean[0], mean[1]) for mean in curves]
    return centre, values[1] - values[0]
