"""Start states of simulated runs, estimated from the samples around the start."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from sysid.io.channels import CHAMBER_PRESSURES
from sysid.io.rig import Rig
from sysid.plant import valve_timing
from sysid.types import FloatArray, IntArray

# Half-widths of the smoothing around a start: s, periods of PWM ripple, and the fewest rows.
_HALF_WINDOW_S = 0.010
_HALF_WINDOW_RIPPLES = 4
_LEAST_HALF = 4
_TWO_SIDED = NormalDist().inv_cdf(0.975)  # errors that are exceeded by chance in 5 %
# The channels that show a state, of those that a simulation is compared in.
_OF_STATES = slice(0, 1 + len(CHAMBER_PRESSURES))
_NO_TIMES: FloatArray = np.zeros(0)


@dataclass(frozen=True)
class InitialState:
    """A start state and its standard errors, each (4,), and from how many samples each is.

    Position, velocity, pressures A and B: rad or m, rad/s or m/s, Pa, Pa. A test's first
    row is at rest, so its velocity is 0 and comes from no sample.
    """

    values: FloatArray
    std: FloatArray
    samples: IntArray


@dataclass(frozen=True)
class ChannelNoise:
    """Standard deviation of one sample of each channel, (3,): position, pressures A and B.

    `quantum` is the encoder's resolution, 0 where none shows.
    """

    total: FloatArray
    quantum: float

    @property
    def still(self) -> float:
        """How far two positions may differ and still count as the same."""
        return max(1.01 * self.quantum, 4.0 * float(self.total[0]))


@dataclass(frozen=True)
class ValveEdges:
    """One valve's edges as they take effect and as commanded, (m,) s, and when it is open."""

    effective: FloatArray
    commanded: FloatArray
    open: valve_timing.OpenIntervals

    def pending(self, at: float) -> bool:
        """Whether an edge commanded before `at` takes effect only after it."""
        tolerance = valve_timing.TIME_TOLERANCE
        under_way = (self.commanded < at - tolerance) & (self.effective > at + tolerance)
        return bool(under_way.any())

    def moves_near(self, at: float, window: float) -> bool:
        """Whether the valve moves within `window` s of a time, or is about to."""
        return self.pending(at) or bool(np.any(np.abs(self.effective - at) < window))

    def was_open(self, at: float) -> bool:
        """Whether the valve is open just before a time."""
        return bool(self.open.is_open(np.array([at - valve_timing.TIME_TOLERANCE]))[0])


def valve_edges(time: FloatArray, command: FloatArray | None, pulsed: bool, rig: Rig) -> ValveEdges:
    """A valve's edges over a test, by the declared delays; `command` (n,), None: stays off."""
    if command is None:
        return ValveEdges(_NO_TIMES, _NO_TIMES, valve_timing.OpenIntervals(_NO_TIMES, _NO_TIMES))
    on_delay, off_delay = (rig.valves.on_delay_s, rig.valves.off_delay_s) if rig.valves else (0, 0)
    if pulsed:
        period = rig.require("pwm", "which a test under PWM needs").period_s
        on, off = valve_timing.pwm_intervals(time, command, period)
    else:
        on, off = valve_timing.switched_intervals(time, command)
    is_open = valve_timing.delayed(on, off, on_delay, off_delay)
    effective = np.concatenate([is_open.opens, is_open.closes])
    commanded = np.concatenate([is_open.opens - on_delay, is_open.closes - off_delay])
    return ValveEdges(effective, commanded, is_open)


def state_at_rest(
    time: FloatArray,
    measured: FloatArray,
    noise: ChannelNoise,
    edges: tuple[ValveEdges, ValveEdges],
) -> InitialState:
    """State at a test's first row: the mean while no valve has opened and nothing has moved.

    `time` (n,) s, `measured` (3, n): position and pressures. The rest is shortened to where no
    channel drifts.
    """
    opened = min((float(e.effective.min()) for e in edges if e.effective.size), default=math.inf)
    moved = np.maximum.accumulate(np.abs(measured[0] - measured[0, 0]) > noise.still)
    samples = max(1, int(np.count_nonzero((time <= opened) & ~moved)))
    rest = samples
    while rest > 1 and _drifts(measured[:, :rest], noise.total):
        rest //= 2
    # A drift just below the noise biases the mean of the whole rest by several standard errors, the
    # mean of half of it by one.
    samples = rest if rest == samples else max(1, rest // 2)
    position, pressure_a, pressure_b = measured[_OF_STATES, :samples].mean(axis=1)
    std = noise.total / math.sqrt(samples)
    # A quantisation error that does not change is not averaged away.
    std[0] = max(std[0], noise.quantum / math.sqrt(12.0))
    return InitialState(
        np.array([position, 0.0, pressure_a, pressure_b]),
        np.array([std[0], 0.0, std[1], std[2]]),
        np.array([samples, 0, samples, samples]),
    )


def _drifts(rest: FloatArray, noise: FloatArray) -> bool:
    """Whether the halves of a rest (3, n) differ by more than their noise (3,) explains."""
    half = rest.shape[1] // 2
    change = rest[:, half : 2 * half].mean(axis=1) - rest[:, :half].mean(axis=1)
    # Exceeded without a drift in one rest of twenty, by channel. A channel that is not logged is
    # NaN and does not count.
    return bool(np.any(np.abs(change) > _TWO_SIDED * noise * math.sqrt(2.0 / half)))


def half_window(period: float, stride: int | None) -> int:
    """Rows on either side of a start that `state_within` may use."""
    return max(_rows_of(_HALF_WINDOW_S, period), _HALF_WINDOW_RIPPLES * (stride or 0))


def _rows_of(span: float, period: float) -> int:
    return max(math.ceil(span / period), _LEAST_HALF)


def state_within(
    at: float,
    time: FloatArray,
    measured: FloatArray,
    noise: ChannelNoise,
    edges: tuple[ValveEdges, ValveEdges],
    stride: int | None,
) -> InitialState:
    """State at a time inside a test, by local cubics over the samples given.

    `time` (m,) s, evenly around `at`, which is one of them; `measured` (3, m). `stride`:
    under PWM, rows after which the ripple repeats; None for valves that do not pulse, whose
    pressures are smoothed between the valve's own edges only. Where a cubic does not follow
    the samples (a flow that chokes bends the pressure), the window shrinks until it does.
    """
    since = time - at
    period = float(time[-1] - time[0]) / (len(time) - 1)
    rows = _rows_of(_HALF_WINDOW_S, period)
    halves = [(h + 0.5) * period for h in (rows, max(rows // 2, _LEAST_HALF), _LEAST_HALF)]
    found = [_position(since, measured[0], noise, halves)]
    if stride is None:
        halves = [*halves[:2], 0.5 * period]
    else:
        ripples = (_HALF_WINDOW_RIPPLES, _HALF_WINDOW_RIPPLES // 2)
        halves = [*((n * stride + 0.5) * period for n in ripples), 0.5 * period]
    for i, pressure in enumerate(measured[_OF_STATES][1:]):
        if np.isnan(pressure).all():
            found.append(_LocalFit(np.full(2, np.nan), np.full(2, np.nan), 0))
            continue
        keep = np.ones(len(time), dtype=bool)
        if stride is None:
            keep = _between_edges(edges[i], at, time)
        fit = _local_fit(
            since[keep], pressure[keep], float(noise.total[1 + i]), halves, stride or 1
        )
        found.append(fit)
    position, *pressures = found
    return InitialState(
        np.array([*position.value, *(p.value[0] for p in pressures)]),
        np.array([*position.std, *(p.std[0] for p in pressures)]),
        np.array([position.samples, position.samples, *(p.samples for p in pressures)]),
    )


def _between_edges(edges: ValveEdges, at: float, time: FloatArray) -> NDArray[np.bool_]:
    """Rows on the same side of every edge of the valve as the start."""
    tolerance = valve_timing.TIME_TOLERANCE
    before = edges.effective[edges.effective <= at + tolerance]
    after = edges.effective[edges.effective > at + tolerance]
    low = before.max() if before.size else -math.inf
    high = after.min() if after.size else math.inf
    return np.asarray((time >= min(low, at) - tolerance) & (time <= high + tolerance))


@dataclass(frozen=True)
class _LocalFit:
    """Value and slope of a channel at the start, (2,), their errors, and the samples used."""

    value: FloatArray
    std: FloatArray
    samples: int


def _position(
    since: FloatArray, position: FloatArray, noise: ChannelNoise, halves: list[float]
) -> _LocalFit:
    """Position and velocity; a shaft without any visible motion is at rest."""
    near = np.abs(since) < halves[0]
    if np.ptp(position[near]) <= 1.01 * noise.quantum:
        error = noise.quantum / math.sqrt(12.0)
        value = np.array([position[near].mean(), 0.0])
        return _LocalFit(value, np.array([error, error / halves[0]]), int(near.sum()))
    return _local_fit(since, position, float(noise.total[0]), halves, 1)


def _local_fit(
    since: FloatArray, values: FloatArray, noise: float, halves: list[float], stride: int
) -> _LocalFit:
    """A cubic around time 0 over the widest of the windows (half-widths, s) that it follows.

    The order is lower where samples are few; a single sample is its own value. Under PWM
    each place within the pulses has its own offset in addition to the cubic; place 0 is the
    start's own, whose offset is part of the value that is wanted. Where even the last window
    shows more than noise, the errors grow accordingly.
    """
    for half in halves:
        near = np.abs(since) < half
        time, own = since[near], values[near]
        order = min(3, (len(time) - 1) // 3)
        reach = float(np.max(np.abs(time))) or 1.0
        columns = [(time / reach) ** k for k in range(max(order, 1) + 1)]
        if stride > 1 and len(time) > 2 * stride:
            place = (np.arange(len(time)) - int(np.argmin(np.abs(time)))) % stride
            columns += [np.asarray(place == k, dtype=float) for k in range(1, stride)]
        design = np.column_stack(columns)
        inverse = np.linalg.pinv(design)
        freedom = len(time) - design.shape[1]
        excess = 1.0
        if freedom > 0 and noise > 0.0:
            residual = own - design @ (inverse @ own)
            excess = math.sqrt(float(residual @ residual) / freedom) / noise
        if excess < 1.0 + 3.0 / math.sqrt(2.0 * max(freedom, 1)):
            break
    scale = np.array([1.0, 1.0 / reach])
    gains = np.linalg.norm(inverse[:2], axis=1) * max(1.0, excess)
    return _LocalFit((inverse[:2] @ own) * scale, gains * noise * scale, len(time))
