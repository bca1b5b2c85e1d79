"""Estimates: regression, covariances, F test, Satterthwaite, Fieller."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy import stats

from benchmarks.interval_coverage import first_order, linear_holds
from sysid.errors import NotIdentifiedError
from sysid.estimation import linear as estimation
from sysid.estimation.linear import Estimate
from sysid.estimation.multiple_tests import adjusted


def test_estimate_as_the_bundle_holds_it() -> None:
    estimate = Estimate(0.2, 0.01, "Nm", (0.18, math.inf))
    assert estimate.to_json() == {
        "value": 0.2,
        "std": 0.01,
        "unit": "Nm",
        "interval": [0.18, None],
    }
    missing = Estimate.unidentified("Nm", "no test")
    assert not missing.identified
    assert missing.to_json() == {"value": None, "identified": False, "reason": "no test"}
    json.dumps([estimate.to_json(), missing.to_json()], allow_nan=False)


@pytest.mark.parametrize("dof", [1.0, 3.5, 10.0, math.inf])
def test_t_quantile_and_p_value(dof: float) -> None:
    expected = stats.norm.ppf(0.975) if math.isinf(dof) else stats.t.ppf(0.975, dof)
    assert estimation.t_quantile(dof) == pytest.approx(expected)
    assert estimation.t_p_value(-2.0, 7.0) == pytest.approx(2.0 * stats.t.sf(2.0, 7.0))
    assert estimation.t_quantile(0.0) == math.inf


def test_weighted_fit_against_the_normal_equations() -> None:
    rng = np.random.default_rng(1)
    x = np.column_stack([np.ones(30), rng.normal(size=30), 1e6 * rng.normal(size=30)])
    y, w = rng.normal(size=30), rng.uniform(0.5, 2.0, 30)
    fit = estimation.linear_fit(x, y, w)
    normal = np.linalg.inv(x.T @ (w[:, None] * x))
    assert fit.coefficients == pytest.approx(normal @ x.T @ (w * y), rel=1e-8)
    variance = float(w @ (y - x @ fit.coefficients) ** 2) / 27
    assert fit.covariance == pytest.approx(variance * normal, rel=1e-8)
    assert fit.leverage.sum() == pytest.approx(3.0)


def test_dependent_columns_are_named() -> None:
    x = np.column_stack([np.ones(10), np.arange(10.0), 2.0 * np.arange(10.0)])
    with pytest.raises(NotIdentifiedError, match="speed, twice the speed"):
        estimation.linear_fit(x, np.ones(10), names=("one", "speed", "twice the speed"))


def test_f_test_is_the_one_way_analysis_of_variance() -> None:
    rng = np.random.default_rng(2)
    groups = np.repeat(["a", "b", "c"], [4, 6, 8])
    y = rng.normal(size=18) + 0.5 * (groups == "b")
    test = estimation.nested_f_test(estimation.indicator(groups), np.ones((18, 1)), y)
    expected = stats.f_oneway(*(y[groups == g] for g in "abc"))
    assert test is not None
    assert (test.dof_numerator, test.dof_denominator) == (2, 15)
    assert test.statistic == pytest.approx(expected.statistic)
    assert test.p_value == pytest.approx(expected.pvalue)
    assert estimation.nested_f_test(np.ones((18, 1)), np.ones((18, 1)), y) is None


def test_satterthwaite_is_welch_for_two_means() -> None:
    a, b = np.array([1.0, 2.0, 4.0]), np.array([3.0, 3.5, 3.2, 3.1])
    shares = np.array([a.var(ddof=1) / 3, b.var(ddof=1) / 4])
    expected = stats.ttest_ind(a, b, equal_var=False).df
    assert estimation.satterthwaite(shares, np.array([2.0, 3.0])) == pytest.approx(expected)


def test_fieller_against_its_closed_form() -> None:
    n, d, dof = 3.0, 2.0, 8.0
    share = np.array([[[0.04, 0.01], [0.01, 0.09]]])
    q = estimation.t_quantile(dof)
    (vn, c), (_, vd) = share[0]
    g = q**2 * vd / d**2
    middle = n / d - g * c / vd
    root = vn - 2 * (n / d) * c + (n / d) ** 2 * vd - g * (vn - c**2 / vd)
    half = q / d * math.sqrt(root)
    expected = ((middle - half) / (1 - g), (middle + half) / (1 - g))
    found = estimation.fieller_interval(n, d, share, np.array([dof]))
    assert found == pytest.approx(expected, rel=1e-6)


def test_fieller_is_unbounded_where_the_denominator_may_be_zero() -> None:
    share = np.array([[[0.01, 0.0], [0.0, 1.0]]])
    low, high = estimation.fieller_interval(1.0, 0.5, share, np.array([20.0]))
    assert math.isinf(low) or math.isinf(high)


def test_fieller_with_a_variance_for_each_group_covers() -> None:
    """Ratio of an intercept's contrast to a slope, two levels with unequal scatter."""
    rng = np.random.default_rng(3)
    level = np.repeat([0.25, 0.27], 6)
    groups = np.repeat([0, 1], 6)
    x = np.column_stack([level, -np.ones(12)])
    held = 0
    runs = 500
    for _ in range(runs):
        y = (level - 0.208) / 0.0488 + rng.normal(size=12) * np.where(groups == 0, 0.04, 0.09)
        fit = estimation.linear_fit(x, y)
        residuals = np.vstack([fit.residuals, fit.residuals])
        shares, dofs = estimation.group_covariances(fit, fit.influence, residuals, groups)
        swap = np.array([[0.0, 1.0], [1.0, 0.0]])
        low, high = estimation.fieller_interval(
            fit.coefficients[1], fit.coefficients[0], swap @ shares @ swap, dofs
        )
        held += low <= 0.208 <= high
    # Three standard errors of a share of 95 % in 500 runs are 2.9 %.
    assert 0.921 <= held / runs <= 0.98


def test_correlated_covariance_covers_where_the_usual_one_does_not() -> None:
    """Regression on a slow regressor with errors that follow one another (AR(1), 0.9)."""
    rng = np.random.default_rng(4)
    n, runs = 1500, 300
    x = np.column_stack([np.ones(n), np.sin(np.arange(n) / 80.0)])
    held = np.zeros(2)
    for _ in range(runs):
        fit = estimation.linear_fit(x, first_order(rng, n, 0.9))
        held += linear_holds(fit)[:, 1]
    assert held[0] / runs < 0.6
    # Four standard errors of a share of 95 % in 300 runs are 5 %.
    assert 0.90 <= held[1] / runs <= 1.0


def test_mean_estimate_is_students() -> None:
    values = np.array([0.31, 0.35, 0.33, 0.36])
    expected = stats.t.interval(0.95, 3, values.mean(), stats.sem(values))
    assert estimation.mean_estimate(values, "Nm").interval == pytest.approx(expected)


@pytest.mark.parametrize("size", [0, 1, 2, 25])
def test_p_values_for_the_false_discovery_rate_are_scipys(size: int) -> None:
    p_values = np.random.default_rng(size).uniform(size=size) ** 3
    wanted = stats.false_discovery_control(p_values, method="by") if size else p_values
    assert np.allclose(adjusted(p_values.tolist()), wanted, rtol=1e-14)
