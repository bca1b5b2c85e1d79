"""Residual statistics: their values, and above all how often they raise an alarm."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.special import bdtr, bdtrc

from sysid.estimation.autoregression import Autoregression, burg
from sysid.types import FloatArray
from sysid.validation.residual_tests import (
    autocovariance,
    cross_correlation_test,
    fit_percentage,
    max_error,
    prewhitened,
    rmse,
    spread_lags,
    whiteness_test,
)

# A right rate fails one such check in ten thousand.
RARE = 1e-4


def is_plausible(alarms: int, sequences: int, rate: float = 0.05) -> bool:
    """Whether a count of alarms agrees with their rate (binomial, both tails)."""
    return bool(bdtr(alarms, sequences, rate) > RARE and bdtrc(alarms - 1, sequences, rate) > RARE)


def sine(n: int, rng: np.random.Generator) -> FloatArray:
    """A clipped sine of a few periods: what drives a motion test."""
    phase = rng.uniform(0.0, 2.0 * np.pi) + 2.0 * np.pi * rng.uniform(2, 6) * np.arange(n) / n
    return np.asarray(np.clip(np.sin(phase), -0.8, 0.8))


def autoregressive(n: int, pole: float, rng: np.random.Generator) -> FloatArray:
    return np.asarray(lfilter([1.0], [1.0, -pole], rng.standard_normal(n + 500))[500:])


def test_errors_and_fit_percentage() -> None:
    measured = np.array([1.0, 2.0, 3.0, 4.0])
    simulated = np.array([1.0, 2.0, 3.0, 2.0])
    assert rmse(measured - simulated) == pytest.approx(1.0)
    assert max_error(measured - simulated) == 2.0
    # norm(error) = 2, norm(y - mean) = sqrt(5)
    assert fit_percentage(measured, simulated) == pytest.approx(100.0 * (1.0 - 2.0 / 5.0**0.5))
    assert fit_percentage(measured, measured) == 100.0
    assert fit_percentage(measured, np.full(4, 2.5)) == pytest.approx(0.0)
    assert fit_percentage(np.ones(4), simulated) is None


def test_autocovariance_is_the_sum_it_stands_for() -> None:
    x = np.random.default_rng(1).standard_normal(157) + 3.0
    d = x - x.mean()
    direct = [float(d[k:] @ d[: len(d) - k]) / len(d) for k in range(12)]
    np.testing.assert_allclose(autocovariance(x, 11), direct, atol=1e-12)


@pytest.mark.parametrize("n", [200, 1000])
@pytest.mark.parametrize("shape", ["normal", "uniform"])
def test_whiteness_alarms_in_one_white_sequence_of_twenty(n: int, shape: str) -> None:
    rng = np.random.default_rng(2)
    sequences, alarms = 1000, 0
    for _ in range(sequences):
        x = rng.standard_normal(n) if shape == "normal" else rng.random(n)
        test = whiteness_test(x)
        assert test is not None
        alarms += not test.passed
        assert test.passed == (test.outside == 0) == (test.p_value >= 0.05)
    assert is_plausible(alarms, sequences)


def test_whiteness_sees_a_faint_colour() -> None:
    rng = np.random.default_rng(3)
    found = [whiteness_test(autoregressive(6000, 0.08, rng)) for _ in range(20)]
    assert sum(t is not None and not t.passed for t in found) >= 18
    first = found[0]
    assert first is not None
    assert first.correlations[0] == pytest.approx(0.08, abs=0.05)
    assert first.to_json()["at_lag"] == 1


def test_nothing_to_test() -> None:
    rng = np.random.default_rng(4)
    noise = rng.standard_normal(200)
    assert whiteness_test(np.full(200, 3.0)) is None
    assert whiteness_test(noise[:20]) is None
    assert cross_correlation_test(np.full(200, 3.0), {"u": noise}) == {}
    assert cross_correlation_test(noise, {"u": np.ones(200)}) == {}
    assert set(cross_correlation_test(noise, {"u": np.ones(200), "v": sine(200, rng)})) == {"v"}
    # An input that moves in the last row only is constant at every other lag.
    late = np.append(np.zeros(199), 1.0)
    found = cross_correlation_test(noise, {"late": late})
    assert np.isfinite(found["late"].correlations).all()


@pytest.mark.parametrize("n", [200, 1000])
def test_cross_correlation_alarms_in_one_white_sequence_of_twenty(n: int) -> None:
    rng = np.random.default_rng(5)
    sequences, alarms = 300, 0
    for _ in range(sequences):
        inputs = {"u": sine(n, rng), "v": autoregressive(n, 0.95, rng)}
        found = cross_correlation_test(rng.standard_normal(n), inputs)
        alarms += not found["u"].passed
        inside = found["u"].outside + found["v"].outside == 0
        assert found["u"].passed == found["v"].passed == inside
    assert is_plausible(alarms, sequences)


def test_cross_correlation_allows_for_a_coloured_residual() -> None:
    rng = np.random.default_rng(6)
    sequences, n = 300, 1000
    alarms = naive = 0
    for _ in range(sequences):
        residual = autoregressive(n, 0.9, rng)
        inputs = {"u": autoregressive(n, 0.95, rng)}
        alarms += not cross_correlation_test(residual, inputs)["u"].passed
        naive += not cross_correlation_test(residual, inputs, max_order=0)["u"].passed
    assert is_plausible(alarms, sequences)
    assert naive > 0.4 * sequences


@pytest.mark.parametrize("delay", [0, 40])
def test_cross_correlation_sees_what_an_input_leaves(delay: int) -> None:
    rng = np.random.default_rng(7)
    found = 0
    for _ in range(20):
        u = autoregressive(3000, 0.8, rng)
        left = 0.1 * np.concatenate([np.zeros(delay), u[: len(u) - delay]])
        tests = cross_correlation_test(
            left / u.std() + rng.standard_normal(3000), {"u": u}, lags=np.arange(0, 60, 5)
        )
        found += not tests["u"].passed
    assert found >= 18


def test_the_band_knows_that_neighbouring_lags_are_alike() -> None:
    rng = np.random.default_rng(8)
    slow, quick = sine(2000, rng), rng.standard_normal(2000)
    noise = rng.standard_normal(2000)
    lags = np.arange(26)
    one = cross_correlation_test(noise, {"u": slow}, lags)["u"].band[0]
    many = cross_correlation_test(noise, {"u": quick}, lags)["u"].band[0]
    single = 1.96 / np.sqrt(2000)
    # Twenty-six independent lags need 3.1 standard errors (Sidak); a slow sine hardly two.
    assert single < one < 1.25 * single
    assert many == pytest.approx(3.1 / np.sqrt(2000), rel=0.03)


def test_prewhitening_finds_the_coefficients() -> None:
    rng = np.random.default_rng(9)
    x = np.asarray(lfilter([1.0], [1.0, -1.8, 0.9], rng.standard_normal(20_000)))
    coefficients = Autoregression.of_reflections(*burg(x, [slice(0, len(x))], 30)).coefficients
    np.testing.assert_allclose(coefficients[:2], [1.8, -0.9], atol=0.03)
    assert np.all(np.abs(coefficients[2:]) < 0.03)
    assert prewhitened(x, [], max_order=1)[2] == 1
    # Drift under sensor noise has no finite order: what is left is white all the same.
    drift = np.asarray(lfilter([1.0, -0.6], [1.0, -0.95], rng.standard_normal(6000)))
    left = whiteness_test(prewhitened(drift, [])[0])
    assert left is not None
    assert left.passed


def test_long_sequences_are_summed_in_pieces() -> None:
    rng = np.random.default_rng(10)
    n = 40_000
    e, u = rng.standard_normal(n), autoregressive(n, 0.5, rng)
    lags = np.array([0, 7, 30])
    found = cross_correlation_test(e, {"u": u}, lags, max_order=0)["u"]
    direct = [np.corrcoef(e[30:], u[30 - k : n - k])[0, 1] for k in lags]
    np.testing.assert_allclose(found.correlations, direct, atol=1e-12)


def test_spread_lags() -> None:
    lags = spread_lags(6000)
    assert lags[0] == 0
    assert lags[-1] == 599
    assert (np.diff(lags) > 0).all()
