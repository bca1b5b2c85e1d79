"""Compiled functions: each structure once, and no more than are kept; factors of equations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from sysid.plant.effects.friction import StribeckFriction
from sysid.plant.jax_setup import jax, jnp, on_processor
from sysid.plant.ports import Model
from sysid.plant.programs import Programs
from sysid.refinement.factors import triangular, triangular_of_squares
from sysid.types import FloatArray


def traced(most: int) -> tuple[Programs, list[tuple[int, Any]]]:
    """A power compiled for each exponent, and what it was traced for."""
    seen: list[tuple[int, Any]] = []

    def power(x: Any, *, exponent: int) -> Any:
        seen.append((exponent, x.shape))
        return x**exponent

    return Programs(power, most), seen


@on_processor()
def test_a_structure_is_compiled_once_while_it_is_kept() -> None:
    programs, seen = traced(most=2)
    for exponent in (1, 2, 1, 2, 2):
        assert np.asarray(programs(np.full(3, 2.0), exponent=exponent))[0] == 2.0**exponent
    assert seen == [(1, (3,)), (2, (3,))]
    programs(np.ones(4), exponent=2)  # another shape, for which the one not used longest goes
    programs(np.ones(3), exponent=2)
    assert len(programs) == 2 and seen[2:] == [(2, (4,))]
    programs(np.ones(3), exponent=1)
    assert len(programs) == 2 and seen[3:] == [(1, (3,))]


def test_a_model_is_compiled_for_its_structure_whatever_its_numbers() -> None:
    from benchmarks.rigs import random_runs
    from sysid.plant import simulator

    inputs, models = random_runs(seed=1, count=2, seconds=0.02)
    kept = len(simulator._advance_chunk)
    for strength in (0.1, 0.2, 0.3):
        friction = StribeckFriction(strength, 0.1)
        simulator.simulate(inputs, [Model(m.parameters, (friction,)) for m in models])
    assert len(simulator._advance_chunk) <= kept + 1


def rows_of(scale: float) -> FloatArray:
    """Equations (300, 6): columns of very different sizes, the last two `scale` apart."""
    rng = np.random.default_rng(0)
    found = rng.normal(size=(300, 6)) * [1e-6, 1.0, 1e3, 1e6, 1.0, 1.0]
    found[:, 4] = found[:, 1] + scale * found[:, 4]
    return found


@pytest.mark.parametrize("scale", [1.0, 1e-3, 1e-7, 0.0])
def test_normal_equations_say_what_the_equations_do_or_these_are_taken(scale: float) -> None:
    """The least squares of the first columns for the last, and its cost, from either factor."""
    rows, asked = rows_of(scale), []

    def whole() -> Sequence[FloatArray]:
        asked.append(scale)
        return [rows[:100], rows[100:]]

    factor = triangular_of_squares(rows.T @ rows, whole)
    assert bool(asked) == (scale < 1e-5)
    np.testing.assert_allclose(np.triu(factor), factor)
    exact = triangular([rows])
    np.testing.assert_allclose(np.abs(factor[-1, -1]), np.abs(exact[-1, -1]), rtol=1e-9)
    if scale:
        own, other = (np.linalg.lstsq(f[:, :-1], f[:, -1])[0] for f in (factor, exact))
        np.testing.assert_allclose(own, other, rtol=1e-7)


def test_a_column_that_is_a_sum_of_others_needs_no_rows() -> None:
    rows, of = rows_of(1.0), np.array([0.0, 0.3, -2.0, 0.0, 0.0, 0.0])
    rows[:, 3] = rows @ of
    asked = lambda: pytest.fail("asked for the rows")  # noqa: E731
    factor = triangular_of_squares(rows.T @ rows, asked, (3, of))
    assert not factor[3].any()
    np.testing.assert_allclose(factor.T @ factor, rows.T @ rows, rtol=1e-9, atol=1e-9)


def test_a_column_of_nothing_has_no_factor_of_its_own() -> None:
    rows = rows_of(1.0)
    rows[:, 2] = 0.0
    factor = triangular_of_squares(rows.T @ rows, lambda: pytest.fail("asked for the rows"))
    assert not factor[:, 2].any() and not factor[2].any()
    np.testing.assert_allclose(factor.T @ factor, rows.T @ rows, rtol=1e-9, atol=1e-9)


@on_processor()
def test_the_start_of_a_step_is_made_without_a_program() -> None:
    from sysid.refinement import solver

    compiled: list[str] = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda event, seconds, **of: compiled.append(event) if "backend_compile" in event else None
    )
    assert solver._none(np.zeros((3, 296))).shape == (296,)
    assert not compiled
    jnp.zeros(297)  # what it would be otherwise
    assert compiled
