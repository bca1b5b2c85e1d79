"""p-values of nested fits whose residuals follow one another in time (`estimation.nested`)."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import linalg, signal, stats

from sysid.estimation.autocovariance import error_model
from sysid.estimation.nested import nested_p_value
from sysid.types import FloatArray

RUNS, LENGTH = 3, 200
GROUPS = np.repeat(np.arange(RUNS), LENGTH)
T = np.tile(np.linspace(0.0, 3.0, LENGTH), RUNS)
LAW = np.repeat([1.0, 2.0, 3.0], LENGTH) * T * np.exp(-T)
# Poles of the errors: next to a unit root, of first order, smooth, and a slow oscillation.
ERRORS = {
    "independent": [0.0],
    "0.99": [0.99],
    "0.999": [0.999],
    "smooth 0.99": [0.99, 0.9],
    "smooth 0.999": [0.999, 0.9],
    "very smooth": [0.999, 0.9, 0.9],
    "oscillation": [0.995 * np.exp(0.03j), 0.995 * np.exp(-0.03j)],
}
EFFECTS = {"offset": np.ones_like(T), "ramp": T - 1.5, "fast": np.exp(-20.0 * T)}


def errors(rng: np.random.Generator, poles: list[complex]) -> FloatArray:
    """Stationary errors of variance 1 in each run, (RUNS * LENGTH,)."""
    burn = min(int(20.0 / (1.0 - max(map(abs, poles)))), 20000)
    white = rng.standard_normal((RUNS, LENGTH + burn))
    found = signal.lfilter([1.0], np.poly(poles), white, axis=1)
    return np.asarray((found[:, burn:] / found.std()).ravel())


def p_value(y: FloatArray, effect: FloatArray, *, first: bool = False) -> float:
    """Of the effect beside the law; its column is the `first` or the last."""
    full = np.column_stack([effect, LAW] if first else [LAW, effect])
    left = [y - x @ np.linalg.lstsq(x, y, rcond=None)[0] for x in (LAW[:, None], full)]
    squares = float(left[0] @ left[0]), float(left[1] @ left[1])
    return nested_p_value(squares, full, left[1], np.array([first, not first]), GROUPS)


@pytest.mark.parametrize("poles", ERRORS)
@pytest.mark.parametrize("effect", ["offset", "ramp"])
def test_errors_next_to_a_unit_root_are_no_effect(effect: str, poles: str) -> None:
    """Alarms at 5 and 0.5 % at about these rates; four standard errors of 80 draws are allowed."""
    rng = np.random.default_rng(21)
    found = np.array([p_value(errors(rng, ERRORS[poles]), EFFECTS[effect]) for _ in range(80)])
    for rate in (0.05, 0.005):
        allowed = rate + 4.0 * np.sqrt(rate * (1.0 - rate) / 80)
        assert np.mean(found < rate) <= allowed
    assert found.min() > 1e-5


@pytest.mark.parametrize("poles", ["0.999", "smooth 0.999", "very smooth"])
def test_a_short_transient_under_persistent_errors(poles: str) -> None:
    """The hardest case: up to 14 % are below 0.05, hardly any below what a diagnosis asks."""
    rng = np.random.default_rng(21)
    found = np.array([p_value(errors(rng, ERRORS[poles]), EFFECTS["fast"]) for _ in range(80)])
    assert np.mean(found < 0.05) < 0.25
    assert np.mean(found < 1e-4) < 0.03


def test_an_effect_under_persistent_errors_is_seen() -> None:
    rng = np.random.default_rng(22)
    noise = errors(rng, ERRORS["smooth 0.99"])
    assert p_value(noise + 100.0 * EFFECTS["ramp"], EFFECTS["ramp"]) < 1e-5


def test_of_independent_errors_it_is_the_f_test() -> None:
    y = np.random.default_rng(3).standard_normal(RUNS * LENGTH)
    assert len(error_model(np.zeros((len(y), 0)), y, GROUPS).coefficients) == 0
    full = np.column_stack([LAW, EFFECTS["ramp"]])
    left = [y - x @ np.linalg.lstsq(x, y, rcond=None)[0] for x in (LAW[:, None], full)]
    dof = len(y) - 2
    statistic = float((left[0] @ left[0]) / (left[1] @ left[1]) - 1.0) * dof
    assert p_value(y, EFFECTS["ramp"]) == pytest.approx(stats.f.sf(statistic, 1, dof), rel=1e-6)


@pytest.mark.parametrize("poles", ["independent", "0.99"])
def test_the_place_of_a_column_says_nothing(poles: str) -> None:
    y = errors(np.random.default_rng(23), ERRORS[poles]) + 0.3 * EFFECTS["ramp"]
    found = p_value(y, EFFECTS["ramp"])
    assert 1e-250 < found < 0.5
    assert p_value(y, EFFECTS["ramp"], first=True) == pytest.approx(found, rel=1e-6)


def test_columns_that_change_nothing_are_no_effect() -> None:
    y = np.random.default_rng(24).standard_normal(RUNS * LENGTH)
    assert p_value(y, np.zeros_like(T)) == 1.0
    assert p_value(y, 2.0 * LAW) == 1.0


def test_smooth_residuals_are_not_taken_to_be_white() -> None:
    """A slow sine: its neighbours' correlation is nearer to 1 than one over the samples."""
    y = np.cos(np.pi * T / 3.0)
    model = error_model(np.zeros((len(y), 0)), y, GROUPS)
    assert model.autocovariance(20)[19] > 0.9 * model.variance
    assert model.independent_samples([LENGTH] * RUNS) < 20.0
    assert np.all(linalg.eigvalsh(linalg.toeplitz(model.autocovariance(LENGTH))) > 0.0)


def test_a_tied_column_of_the_smaller_fit_takes_nothing() -> None:
    """Rounding's direction that stood for it was taken out of all columns behind it."""
    y = errors(np.random.default_rng(23), ERRORS["independent"]) + 0.3 * EFFECTS["ramp"]
    plain = np.column_stack([LAW, EFFECTS["ramp"]])
    tied = np.column_stack([LAW, 3.0 * LAW, EFFECTS["ramp"]])
    left = [y - x @ np.linalg.lstsq(x, y, rcond=None)[0] for x in (LAW[:, None], plain)]
    squares = (float(left[0] @ left[0]), float(left[1] @ left[1]))
    found = [
        nested_p_value(squares, x, left[1], np.arange(x.shape[1]) == x.shape[1] - 1, GROUPS)
        for x in (plain, tied)
    ]
    assert found[1] == pytest.approx(found[0], rel=1e-9)
