"""How often 95 % intervals hold the truth, by estimator, errors and number of samples.

    python benchmarks/interval_coverage.py [--draws 600] [--seed 1]

Series: errors of first order (correlation 0, 0.5, 0.9) on a constant and one more regressor:
persistent noise, a sine of five periods, a ramp, white noise; and an exponential response
(gain, time constant, offset). "plain" takes the errors as independent. Clusters: tests of which
each has a gain of its own, of equal and of unequal length, with Student's t of tests - 1. The
nominal coverage is 95 %, asked are 92 to 98 %. A share of 600 draws has a standard error of
0.9 %; 2,000 samples are drawn half as often.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from sysid.estimation.linear import LinearFit, linear_fit, t_quantile
from sysid.estimation.nonlinear import LeastSquaresFit, Parameter, minimise
from sysid.types import FloatArray

CORRELATIONS = (0.0, 0.5, 0.9)
SAMPLES = (200, 2000)
CLUSTERS = (3, 5, 10)
ASKED = (0.92, 0.98)
TRUTH = np.array([1.0, 0.6, 0.2])

Regressor = Callable[[np.random.Generator, int], FloatArray]
REGRESSORS: dict[str, Regressor] = {
    "persistent": lambda rng, n: first_order(rng, n, 0.9),
    "sine": lambda rng, n: np.sin(10.0 * np.pi * np.arange(n) / n),
    "ramp": lambda rng, n: np.linspace(-1.0, 1.0, n),
    "white": lambda rng, n: rng.standard_normal(n),
}


def first_order(rng: np.random.Generator, count: int, correlation: float) -> FloatArray:
    """Stationary noise (n,) of variance 1, e[t] = correlation e[t - 1] + white."""
    from scipy.signal import lfilter

    shocks = np.sqrt(1.0 - correlation**2) * rng.standard_normal(count)
    shocks[0] /= np.sqrt(1.0 - correlation**2)
    return np.asarray(lfilter([1.0], [1.0, -correlation], shocks))


def linear_holds(fit: LinearFit) -> FloatArray:
    """(2, p): whether each coefficient's interval holds 0, plain and correlated."""
    found = fit.correlated_covariance()
    plain = t_quantile(fit.dof) * np.sqrt(np.diag(fit.covariance))
    quantiles = np.array([t_quantile(float(dof)) for dof in found.dof])
    wide = quantiles * np.sqrt(np.diag(found.matrix))
    return np.abs(fit.coefficients) <= np.array([plain, wide])


def linear_coverage(
    rng: np.random.Generator, count: int, correlation: float, regressor: Regressor, draws: int
) -> FloatArray:
    """(2, 2): plain and correlated, of the constant and the regressor's coefficient."""
    held = np.zeros((2, 2))
    for _ in range(draws):
        x = np.column_stack([np.ones(count), regressor(rng, count)])
        held += linear_holds(linear_fit(x, first_order(rng, count, correlation)))
    return held / draws


def response(values: FloatArray, t: FloatArray) -> FloatArray:
    return values[2] + values[0] * (1.0 - np.exp(-t / values[1]))


def response_jacobian(values: FloatArray, t: FloatArray) -> FloatArray:
    decay = np.exp(-t / values[1])
    return np.column_stack([1.0 - decay, -values[0] * t / values[1] ** 2 * decay, np.ones_like(t)])


def nonlinear_coverage(
    rng: np.random.Generator, count: int, correlation: float, draws: int
) -> FloatArray:
    """(2, 3): plain and correlated, of gain, time constant and offset."""
    t = np.linspace(0.0, 3.0, count)
    names = ("gain", "time_constant", "offset")
    starts = [Parameter(n, float(v)) for n, v in zip(names, TRUTH, strict=True)]
    held = np.zeros((2, 3))
    for _ in range(draws):
        y = response(TRUTH, t) + 0.03 * first_order(rng, count, correlation)
        fit = minimise(
            lambda b, y=y: response(b, t) - y, starts, jacobian=lambda b: response_jacobian(b, t)
        )
        for row, covariance in enumerate((None, fit.correlated_covariance())):
            held[row] += [
                fit.estimate(n, covariance).holds(v) for n, v in zip(names, TRUTH, strict=True)
            ]
    return held / draws


def cluster_fit(rng: np.random.Generator, lengths: list[int]) -> tuple[LeastSquaresFit, FloatArray]:
    """A gain that scatters by 1 from test to test and an offset, both truly 0; the tests' rows."""
    tests = np.repeat(np.arange(len(lengths)), lengths)
    ramp = np.concatenate([np.linspace(0.0, 1.0, n) for n in lengths])
    jacobian = np.column_stack([ramp, np.ones_like(ramp)])
    noise = np.concatenate([first_order(rng, n, 0.5) for n in lengths])
    y = rng.standard_normal(len(lengths))[tests] * ramp + 0.3 * noise
    values, *_ = np.linalg.lstsq(jacobian, y, rcond=None)
    parameters = (Parameter("gain", 0.0), Parameter("offset", 0.0))
    return (
        LeastSquaresFit(parameters, values, jacobian @ values - y, jacobian, True, "", 1),
        tests,
    )


def cluster_coverage(rng: np.random.Generator, count: int, unequal: bool, draws: int) -> FloatArray:
    """(3,): the gain's interval, plain, correlated, and by the jackknife over tests."""
    lengths = [40 + (80 * i // (count - 1) if unequal else 0) for i in range(count)]
    held = np.zeros(3)
    for _ in range(draws):
        fit, tests = cluster_fit(rng, lengths)
        found = (None, fit.correlated_covariance(tests), fit.jackknife_covariance(tests))
        held += [fit.estimate("gain", covariance).holds(0.0) for covariance in found]
    return held / draws


def shares(values: FloatArray) -> str:
    """In percent; a star on what lies outside the asked band."""
    cells = (f"{100 * v:6.1f}{' ' if ASKED[0] <= v <= ASKED[1] else '*'}" for v in values)
    return " ".join(cells)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--draws", type=int, default=600)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    began = time.perf_counter()
    print("coverage in percent (* outside 92 to 98)")
    print(f"{'n':>5} {'corr':>5} {'regressor':<12}{'plain':<24}{'correlated'}")
    for count in SAMPLES:
        draws = options.draws if count <= 200 else options.draws // 2
        for correlation in CORRELATIONS:
            for name, regressor in REGRESSORS.items():
                held = linear_coverage(rng, count, correlation, regressor, draws)
                print(f"{count:5} {correlation:5} {name:<12}{shares(held[0]):<24}{shares(held[1])}")
            held = nonlinear_coverage(rng, count, correlation, draws)
            print(
                f"{count:5} {correlation:5} {'response':<12}{shares(held[0]):<24}{shares(held[1])}"
            )
    print(f"\n{'tests':>5} {'length':<10}  {'plain':<8}{'correl.':<8}jackknife over tests")
    for count in CLUSTERS:
        for unequal in (False, True):
            held = cluster_coverage(rng, count, unequal, options.draws)
            print(f"{count:5} {'unequal' if unequal else 'equal':<10}  {shares(held)}")
    print(f"{time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main()
