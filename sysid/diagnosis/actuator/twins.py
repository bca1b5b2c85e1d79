"""Twins: the same tests on a rig that is the fitted model and nothing more.

A twin is the model's simulation of a campaign's own commands, with the noise, quantisation
and test-to-test friction scatter that the logs show. It goes through the same steps as the
logs (smoothing, windows, screening), and so shows what a residual looks like where nothing
is missing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sysid import signals
from sysid.diagnosis.actuator.samples import TestRun, Traces, smooth
from sysid.errors import SimulationError
from sysid.io.channels import CHAMBER_PRESSURES, COMPARED
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.parallel import spend
from sysid.plant.ports import Model
from sysid.plant.sensors import measured_channels
from sysid.recording.simulation import NOT_FINITE
from sysid.types import FloatArray

if TYPE_CHECKING:
    from sysid.plant.simulator import Trajectory

# Noise is estimated from blocks of this many rows, those within this factor of the calmest fifth.
_BLOCK = 128
_CALM = 1.6
# Tests from which the noise of the position is taken, the longest.
_TESTS_OF_NOISE = 24
_NOISE_LAGS = 6
_MOST_LAGS = 33
_UNCORRELATED = 0.05
# What is slower is motion, where the sensors' own noise along it is asked for.
_PATH_HZ = 10.0


@dataclass(frozen=True)
class SensorNoise:
    """How each channel's samples err, SI: the position, then `COMPARED`.

    `kernels`: what white noise of unit variance is convolved with to give the channel's
    noise, which a sensor or its filter may colour; `quantum` (channels,) the channels' resolution.
    """

    kernels: tuple[FloatArray, ...]
    quantum: FloatArray

    @property
    def total(self) -> FloatArray:
        """Standard deviation of one sample's whole error, (channels,)."""
        power = np.array([float(k @ k) for k in self.kernels])
        return np.asarray(np.sqrt(power + self.quantum**2 / 12.0))

    def on(self, values: FloatArray, rng: np.random.Generator) -> FloatArray:
        """Measured channels (3, n) from true ones: position and pressures, as in balances."""
        noisy = np.empty_like(values)
        for i in range(len(values)):
            kernel, step = self.kernels[i], self.quantum[i]
            white = rng.standard_normal(values.shape[1] + len(kernel) - 1)
            noisy[i] = values[i] + np.convolve(white, kernel, mode="valid")
            if step > 0.0:
                noisy[i] = step * np.round(noisy[i] / step)
        return noisy


def sensor_noise(tests: Sequence[tuple[str, str, Trial]], rig: Rig) -> SensorNoise:
    """Noise of the channels, from the tests themselves.

    Position: `signals.position_floor`, white. Pressures: the autocovariance over the calmest
    blocks of all tests, where neither motion nor flow shows; so too the position of logs whose
    samples lie between measured ones, which correlates their noise.
    """
    position = rig.position_channel
    moved = _longest([t for _, _, t in tests], position)
    # Where a fast motion skips counts, the sensor's count is that of the other tests.
    floors = [signals.position_floor(t[position], t.stride_of(position)) for t in moved]
    counts = [floor.quantum for floor in floors if floor.quantum > 0.0]
    step = float(np.median(counts)) if counts else 0.0
    floors = [
        floor
        if floor.quantum > 0.0
        else signals.noise_floor(t[position], step, t.stride_of(position))
        for t, floor in zip(moved, floors, strict=True)
    ]
    noise = float(np.median([floor.noise for floor in floors])) if floors else 0.0
    kernels = [np.array([noise])]
    between = [t for _, _, t in tests if t.row_period is not None]
    lags = min(_MOST_LAGS, max([_NOISE_LAGS, *(3 * t.stride for t in between)]))
    quantum = [step]
    for name in COMPARED:
        channels = [t[name] for _, _, t in tests if name in t and np.isfinite(t[name]).all()]
        steps = [s for s in (signals.quantum(c) for c in channels[:24]) if s > 0.0]
        quantum.append(float(np.median(steps)) if steps else 0.0)
        kernels.append(_noise_kernel(channels, quantum[-1], lags))
    positions = [t[position] for t in between if position in t and t.stride_of(position) > 1]
    if positions:
        kernels[0] = _noise_kernel(positions, step, lags)
    return SensorNoise(tuple(kernels), np.array(quantum))


def _noise_kernel(channels: Sequence[FloatArray], quantum: float, count: int) -> FloatArray:
    """A filter that gives white noise the autocovariance of the channel's calmest blocks."""
    blocks = [
        channel[first : first + _BLOCK]
        for channel in channels
        for first in range(0, len(channel) - _BLOCK + 1, _BLOCK)
    ]
    if not blocks:
        return np.zeros(1)
    x = np.linspace(-1.0, 1.0, _BLOCK)
    design = np.vander(x, 4)
    table = np.array(blocks).T
    rest = table - design @ np.linalg.lstsq(design, table, rcond=None)[0]
    power = np.mean(rest**2, axis=0)
    calm = rest[:, power < _CALM * max(float(np.quantile(power, 0.2)), 1e-300)]
    lags = np.arange(count)
    covariance = np.array(
        [np.mean(calm[: _BLOCK - lag] * calm[lag:]) if calm.size else 0.0 for lag in lags]
    )
    # The cubic has used four of the block's degrees of freedom, and quantisation adds variance.
    covariance[0] = max(covariance[0] * _BLOCK / (_BLOCK - 4) - quantum**2 / 12.0, 0.0)
    covariance[np.abs(covariance) < _UNCORRELATED * covariance[0]] = 0.0
    spectrum = np.fft.rfft(np.concatenate((covariance, np.zeros(33), covariance[:0:-1]))).real
    kernel = np.fft.fftshift(np.fft.irfft(np.sqrt(np.maximum(spectrum, 0.0))))
    total = float(kernel @ kernel)
    return np.asarray(kernel * (np.sqrt(covariance[0] / total) if total > 0.0 else 0.0))


@dataclass(frozen=True)
class Scatter:
    """Relative spread of friction from test to test, one standard deviation."""

    static: float = 0.0
    sliding: float = 0.0


def simulate_twins(
    traces: Traces,
    model: Model,
    noise: SensorNoise,
    scatter: Scatter,
    count: int,
    seed: int,
    rig: Rig,
    lost: set[str] | None = None,
) -> Iterator[Traces]:
    """`count` twins of the traces of a campaign's tests.

    A test in which nothing can move does not depend on scatter and is simulated once. The
    seed determines every draw. A test whose simulation switches without end, or does not stay
    finite, is NaN in that twin; with `lost`, to which its name is added, it is the log's own: no
    effect gains more there on the log than on the twin. Raises OutOfBudgetError, and with `lost`
    SimulationError where a twin would have no test of its own.
    """
    from sysid.plant.simulator import simulate

    spend(count)
    rng = np.random.default_rng(seed)
    moving = [run for run in traces.runs if run.moves]
    held = [run for run in traces.runs if not run.moves]
    fixed = [_held(model)] * len(held)
    still = simulate([r.inputs for r in held], fixed, nan_if_endless=True)
    models = [scattered(model, scatter, rng) for _ in range(count * len(moving))]
    inputs = [run.inputs for _ in range(count) for run in moving]
    moved = simulate(inputs, models, nan_if_endless=True)
    for i in range(count):
        own = moved[i * len(moving) : (i + 1) * len(moving)]
        found = dict(zip((r.rows.start for r in [*held, *moving]), [*still, *own], strict=True))
        true = _through_sensors([found[run.rows.start] for run in traces.runs], model, rig)
        measured = noise.on(true, rng)
        for run in traces.runs:
            if run.stamps is not None:
                draw = np.random.default_rng((seed, i, run.rows.start))
                measured[:, run.rows] = _at_stamps(run, true[:, run.rows], noise, draw)
        if lost is not None:
            lost.update(_take_logs_own(measured, traces))
        yield traces.with_measured(*measured)


def _take_logs_own(measured: FloatArray, traces: Traces) -> list[str]:
    """Make channels (3, n) of a twin the log's in tests that are not finite; their names.

    Raises SimulationError where that is all of them.
    """
    own = np.array([traces.position, traces.pressure_a, traces.pressure_b])
    gone = [run for run in traces.runs if not np.isfinite(measured[:, run.rows]).all()]
    if gone and len(gone) == len(traces.runs):
        raise SimulationError(NOT_FINITE)
    for run in gone:
        measured[:, run.rows] = own[:, run.rows]
    return [f"{run.file}, test {run.label}" if run.label else run.file for run in gone]


def retraced(traces: Traces, noise: SensorNoise, seed: int) -> tuple[Traces, Traces]:
    """The logs' own motion and pressures, smoothed, as they are and as the sensors show them.

    An encoder's counts at a steady speed beat against the sampling, at a frequency that is another
    at a twin's speed.
    """
    smoothed = [
        smooth(traces.runs, values, _PATH_HZ)
        for values in (traces.position, traces.pressure_a, traces.pressure_b)
    ]
    shown = noise.on(np.array(smoothed), np.random.default_rng(seed))
    return traces.with_measured(*smoothed), traces.with_measured(*shown)


def _at_stamps(
    run: TestRun, true: FloatArray, noise: SensorNoise, rng: np.random.Generator
) -> FloatArray:
    """Channels (3, n) of an uneven test: they err at its own rows, and go to the even grid as the
    log's do, which correlates the noise."""
    stamps = run.stamps
    assert stamps is not None
    grid = np.linspace(stamps[0], stamps[-1], true.shape[1])
    rows = np.array([signals.resample(grid, channel, stamps) for channel in true])
    noisy = noise.on(rows, rng)
    return np.array([signals.resample(stamps, channel, grid) for channel in noisy])


def _held(model: Model) -> Model:
    """The model with a fixed shaft, as in the valve tests."""
    return Model(model.parameters.with_held_shaft(), model.effects)


def _longest(trials: Sequence[Trial], position: str) -> list[Trial]:
    """The longest tests in which the position's reading changes: one on a single count shows
    nothing of its sensor."""

    def shows(trial: Trial) -> bool:
        return len(trial) >= 64 and position in trial and float(np.ptp(trial[position])) > 0.0

    return sorted(filter(shows, trials), key=len)[-_TESTS_OF_NOISE:]


def scattered(model: Model, scatter: Scatter, rng: np.random.Generator) -> Model:
    static, sliding = 1.0 + np.array([scatter.static, scatter.sliding]) * rng.standard_normal(2)
    return Model(model.parameters.with_friction(sliding, static), model.effects)


def _through_sensors(simulated: Sequence[Trajectory], model: Model, rig: Rig) -> FloatArray:
    """(3, n) position and pressures of all tests end to end, as the sensors show them."""
    names = (rig.position_channel, *CHAMBER_PRESSURES)
    shown = [measured_channels(run, rig.position_channel, model) for run in simulated]
    return np.array([np.concatenate([channels[n] for channels in shown]) for n in names])
