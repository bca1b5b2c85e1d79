"""Signals: filtering, derivatives, resampling, quantum and noise floor."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import signal

from sysid import signals
from sysid.errors import InputError
from sysid.recording.encoder import counts_at_rest
from sysid.types import FloatArray

PERIOD = 1e-3


def test_lowpass_has_no_phase_and_halves_at_the_cutoff() -> None:
    t = np.arange(4000) * PERIOD
    for frequency, gain in ((5.0, 1.0), (50.0, 0.5), (200.0, 0.0)):
        x = np.sin(2 * np.pi * frequency * t)
        y = signals.lowpass(x, PERIOD, 50.0)[1000:3000]
        in_phase = 2.0 * np.mean(y * x[1000:3000])
        quadrature = 2.0 * np.mean(y * np.cos(2 * np.pi * frequency * t[1000:3000]))
        assert in_phase == pytest.approx(gain, abs=0.01)
        assert quadrature == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize(("period", "usual_hz"), [(1e-3, 50.0), (4e-3, 50.0), (0.01, 20.0)])
def test_the_usual_cutoff_stays_clear_of_the_nyquist_frequency(
    period: float, usual_hz: float
) -> None:
    x = np.random.default_rng(2).normal(size=200)
    np.testing.assert_array_equal(signals.lowpass(x, period), signals.lowpass(x, period, usual_hz))


def test_lowpass_keeps_a_line_up_to_its_ends() -> None:
    t = np.arange(500) * PERIOD
    assert signals.lowpass(3.0 * t + 1.0, PERIOD) == pytest.approx(3.0 * t + 1.0, abs=1e-7)


@pytest.mark.parametrize("shape", [(4,), (7,), (150,), (2000,), (300, 3)])
def test_lowpass_is_scipys_zero_phase_filter(shape: tuple[int, ...]) -> None:
    x = np.random.default_rng(1).normal(size=shape)
    sections = signal.butter(signals.FILTER_ORDER, 20.0 * 2.0 * PERIOD, output="sos")
    pad = min(shape[0] - 1, 3 * signals.filter_length(PERIOD, 20.0))
    expected = signal.sosfiltfilt(sections, x, axis=0, padlen=pad)
    np.testing.assert_array_equal(signals.lowpass(x, PERIOD, 20.0), expected)


@pytest.mark.parametrize("cutoff", [0.0, -1.0, 500.0, 600.0])
def test_lowpass_names_a_cutoff_that_cannot_be(cutoff: float) -> None:
    with pytest.raises(InputError, match="Nyquist frequency, 500 Hz"):
        signals.lowpass(np.zeros(100), PERIOD, cutoff)


def test_an_event_stays_within_the_filter_length() -> None:
    impulse = np.zeros(401)
    impulse[200] = 1.0
    response = np.abs(signals.lowpass(impulse, PERIOD, 50.0))
    reach = signals.filter_length(PERIOD, 50.0)
    outside = np.abs(np.arange(401) - 200) > reach
    assert response[outside].max() < 0.01 * response.max()


def test_derivatives_are_exact_on_a_parabola() -> None:
    t = np.arange(50) * 0.02
    x = 2.0 * t**2 - t
    assert signals.first_derivative(x, 0.02) == pytest.approx(4.0 * t - 1.0, abs=1e-7)
    assert signals.second_derivative(x, 0.02) == pytest.approx(np.full(50, 4.0), abs=1e-7)


def test_resampling_a_wobbling_clock_gives_back_the_course() -> None:
    rng = np.random.default_rng(1)
    time = np.arange(1000) * PERIOD + rng.uniform(-2e-4, 2e-4, 1000)
    grid = signals.uniform_grid(time)
    assert np.ptp(np.diff(grid)) < 1e-12
    measured = signals.resample(time, np.sin(20.0 * time), grid)
    assert measured == pytest.approx(np.sin(20.0 * grid), abs=1e-6)


def test_a_command_is_held_not_interpolated() -> None:
    time = np.array([0.0, 1.0, 2.1, 3.0])
    held = signals.resample(
        time, np.array([0.0, 5.0, 7.0, 1.0]), np.array([0.0, 0.9, 1.5, 2.5, 3.0]), hold=True
    )
    assert held.tolist() == [0.0, 0.0, 5.0, 7.0, 1.0]


def test_quantum_of_counts_written_with_few_digits() -> None:
    rng = np.random.default_rng(2)
    step = 2.0 * np.pi / 80000
    counts = np.round(500.0 * np.sin(np.arange(3000) / 300.0) + rng.normal(size=3000))
    assert signals.quantum(np.round(counts * step, 7)) == pytest.approx(step, rel=1e-5)
    assert signals.quantum(rng.normal(size=3000)) == 0.0
    assert signals.quantum(np.full(10, 3.0)) == 0.0


def test_quantum_where_no_two_readings_are_one_count_apart() -> None:
    x = np.round(3.37 * np.arange(400))
    assert signals.quantum(x) == pytest.approx(1.0)


@pytest.mark.parametrize("ratio", [0.0, 0.1, 0.25, 0.6])
def test_the_mean_error_of_a_converter(ratio: float) -> None:
    """Against many readings of each value."""
    rng = np.random.default_rng(4)
    values = np.linspace(-2.31, 3.07, 37)
    readings = values + ratio * rng.standard_normal((200_000, len(values)))
    floor = signals.NoiseFloor(2.0 * ratio, 2.0)
    found = floor.rounding(2.0 * values)
    np.testing.assert_allclose(
        found, 2.0 * (np.round(readings).mean(axis=0) - values), atol=0.2 if ratio == 0.0 else 0.015
    )
    assert not signals.NoiseFloor(1.0, 0.0).rounding(values).any()


@pytest.mark.parametrize("ratio", [0.1, 0.2, 0.3, 0.5, 1.0, 3.0, 10.0])
@pytest.mark.parametrize("counts_a_sample", [0.003, 0.013, 0.3])
def test_noise_floor_over_a_slow_ramp(ratio: float, counts_a_sample: float) -> None:
    """Noise from a tenth of a count to ten counts, with the signal on a ramp."""
    rng = np.random.default_rng([3, round(100 * ratio)])
    n = 8000
    truth = counts_a_sample * np.arange(n)
    x = np.round(truth + ratio * rng.normal(size=n))
    floor = signals.noise_floor(0.01 * x)
    error = 0.01 * float(np.std(x - truth))
    assert floor.quantum == pytest.approx(0.01, rel=1e-6)
    assert floor.total == pytest.approx(error, rel=0.10)
    # Quantisation of a ramp of a third of a count a sample looks like noise of 0.1 counts.
    if counts_a_sample < 0.1 or ratio >= 0.2:
        assert floor.noise == pytest.approx(0.01 * ratio, rel=0.15)


def test_a_position_at_rest_is_known_to_its_least_change() -> None:
    moving = np.cumsum(np.random.default_rng(3).uniform(2e-4, 6e-4, 140))
    written = np.concatenate([np.zeros(600), moving, np.full(600, moving[-1])])
    assert signals.noise_floor(written).total == 0.0
    assert signals.position_floor(written).total == pytest.approx(2e-4 / math.sqrt(12), rel=0.1)
    assert signals.position_floor(np.full(300, 0.5)).total == 0.0


@pytest.mark.parametrize("rows", [10, 18, 40])
def test_noise_between_jumps_in_every_block(rows: int) -> None:
    """An effort that a cog or a reversal moves up and down, a few rows apart."""
    rng = np.random.default_rng(rows)
    jumps = 5.0 * np.sign(np.sin(np.pi * (np.arange(3000) + 0.3) / rows))
    noise = 0.1 * rng.standard_normal(3000)
    assert signals.noise_floor(jumps + noise).total > 0.5
    assert signals.noise_floor(jumps + noise, between_jumps=True).total == pytest.approx(
        0.1, rel=0.35
    )


@pytest.mark.parametrize("rows", [20, 200, 5000])
def test_travel_is_what_noise_and_counts_do_not_explain(rows: int) -> None:
    noise = np.random.default_rng(rows).standard_normal(rows)
    assert signals.travel(noise) < 2.0 < float(np.ptp(noise))
    creep = np.linspace(0.0, 30.0, rows)
    assert signals.travel(creep + noise) == pytest.approx(30.0, abs=8.0)
    slip = np.where(np.arange(rows) < rows // 2, 0.0, 1.0)
    assert signals.travel(slip) > 0.8  # one step, with noise or without, may be a motion
    assert signals.travel(slip, 1.0) == 0.0  # but for an encoder whose count it is


def test_noise_between_jumps_is_noise_as_it_is_where_there_are_none() -> None:
    rng = np.random.default_rng(1)
    white, tails = rng.standard_normal(2000), rng.standard_t(3, 2000)
    coloured = signal.lfilter([0.2], [1.0, -0.8], white)
    for values in (white, tails, coloured, np.round(white), np.repeat(white, 5)):
        assert signals.noise_floor(values, between_jumps=True) == signals.noise_floor(values)


def test_noise_floor_is_not_fooled_by_motion() -> None:
    rng = np.random.default_rng(4)
    t = np.arange(6000) * PERIOD
    motion = 300.0 * np.sin(2 * np.pi * t) + 1000.0 * np.exp(-t / 0.2)
    noise = rng.normal(size=6000)
    assert signals.noise_floor(motion + noise).total == pytest.approx(1.0, rel=0.06)
    kicked = motion + noise
    kicked[2000:] += 500.0
    assert signals.noise_floor(kicked).total == pytest.approx(1.0, rel=0.06)


@pytest.mark.parametrize("memory", [0.3, 0.45, 0.7])
def test_noise_that_the_sensor_coloured_counts_in_full(memory: float) -> None:
    rng = np.random.default_rng(5)
    white = rng.normal(size=8000) * np.sqrt(1.0 - memory**2)
    noise = np.zeros(8000)
    for i in range(1, 8000):
        noise[i] = memory * noise[i - 1] + white[i]
    motion = 300.0 * np.sin(2 * np.pi * np.arange(8000) * PERIOD)
    assert signals.noise_floor(motion + noise).total == pytest.approx(1.0, rel=0.08)


def test_a_resting_encoder_keeps_the_share_of_its_count() -> None:
    floor = signals.noise_floor(np.full(500, 7.0), resolution=1.0)
    assert floor.noise == 0.0
    assert floor.total == pytest.approx(1.0 / np.sqrt(12.0))


def test_runs_of_a_mask() -> None:
    mask = np.array([1, 1, 0, 1, 0, 0, 1, 1, 1], dtype=bool)
    assert signals.runs(mask) == [(0, 2), (3, 4), (6, 9)]
    assert signals.longest_run(mask) == (6, 9)
    assert signals.longest_run(mask[:6]) == (0, 2)
    assert signals.runs(mask[:0]) == signals.runs(~mask[:2]) == []
    assert signals.longest_run(~mask[:2]) == (0, 0)


def test_a_step_whose_square_vanishes_is_none() -> None:
    values = 1e-170 * np.arange(40.0) % 7e-170
    assert signals.noise_floor(values).quantum == 0.0


def readings_of(position: FloatArray) -> tuple[NDArray[np.intp], int]:
    """Rows at which the next count of 1 begins, and how many rows there are."""
    return np.flatnonzero(np.diff(np.floor(position))) + 1, len(position)


@pytest.mark.parametrize("edge", [0.05, 0.3, 0.7, 0.999])
@pytest.mark.parametrize("power", [1.0, 2.0, 3.0])
@pytest.mark.parametrize("rows", [30, 300, 3000])
def test_a_count_that_a_motion_passes_is_no_rest(power: float, edge: float, rows: int) -> None:
    """At constant speed, where it turns and where it slows down, anywhere within a count."""
    way = np.linspace(-2.0, 2.0, rows)
    position = edge + np.sign(way) ** (power % 2.0) * np.abs(way) ** power
    assert not counts_at_rest(*readings_of(position)).any()


def test_a_rest_between_two_motions_is_one() -> None:
    way = np.linspace(0.0, 3.0, 60)
    position = np.concatenate([way, np.full(400, 3.5), 3.5 + way])
    changes, count = readings_of(position)
    rests = counts_at_rest(changes, count)
    (rest,) = np.flatnonzero(rests)
    assert (changes[rest - 1], changes[rest]) == (59, 470)
    assert counts_at_rest(np.empty(0, dtype=np.intp), 50).all()


def test_a_slow_stretch_is_longer_than_a_reversal() -> None:
    speed = np.ones(60)
    speed[10:13] = speed[30:40] = 0.0
    found = np.flatnonzero(signals.slow_stretches(speed, 0.1, 5))
    np.testing.assert_array_equal(found, np.arange(30, 40))


def test_pauses_are_three_periods_and_need_no_median_without_any(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    random = np.random.default_rng(3)
    for spread, gap in ((0.0, 2.9), (0.3, 3.5), (2.0, 0.0), (0.0, 4.0)):
        steps = 1.0 + spread * (random.random(200) - 0.5)
        steps[70] += gap
        time = np.concatenate(([0.0], np.cumsum(steps)))
        wanted = np.flatnonzero(np.diff(time) > signals.PAUSE * np.median(np.diff(time)))
        np.testing.assert_array_equal(signals.pauses(time), wanted)
    monkeypatch.setattr(np, "median", None)
    assert signals.pauses(1e-3 * np.arange(1000)).size == 0
