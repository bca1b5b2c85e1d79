"""What is left of a part's error: what repeats is told from what differs between tests."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
import pytest

from sysid.diagnosis import wording
from sysid.diagnosis.bench.component import Component, Law
from sysid.diagnosis.bench.unexplained import left_over as remainder
from sysid.types import FloatArray

SAMPLES = 1500
NOISE = 0.1


@dataclass(frozen=True)
class Bench:
    """Residuals of tests: a wave over the position, an offset of each test's own, and noise."""

    positions: list[FloatArray]
    left: list[FloatArray]
    channel: str = "motor_force_n"
    unit: str = "N"
    most_folds: int = 5

    @property
    def tests(self) -> tuple[str, ...]:
        return tuple(map(str, range(len(self.left))))

    def residuals(self, law: Law, tests: Sequence[int]) -> list[FloatArray]:
        return [self.left[i] for i in tests]

    def regressors(self, tests: Sequence[int]) -> dict[str, FloatArray]:
        position = np.concatenate([self.positions[i] for i in tests])
        return {"position": position, "motor": 3.0 * position, "time": np.zeros_like(position)}


def bench(wave: float, scatter: float, seed: int, tests: int = 40) -> Component:
    rng = np.random.default_rng(seed)
    positions = [rng.uniform(-1.0, 1.0, SAMPLES) for _ in range(tests)]
    # As many tests above as below: the offsets are no constant that repeats.
    offsets = scatter * np.where(np.arange(tests) % 2, 1.0, -1.0)
    left = [
        wave * np.sin(9.0 * p) + own + NOISE * rng.standard_normal(SAMPLES)
        for p, own in zip(positions, rng.permutation(offsets), strict=True)
    ]
    return cast(Component, Bench(positions, left))


@pytest.mark.parametrize("held_out", [True, False])
def test_squares_are_told_apart(held_out: bool) -> None:
    outside = bench(0.5, 0.2, 2, tests=10) if held_out else None
    found = remainder(bench(0.5, 0.2, 1), outside, Law({}), NOISE)
    assert found is not None
    assert found.repeatable == pytest.approx(0.5 / np.sqrt(2.0), rel=0.1)
    assert found.scatter == pytest.approx(0.2, rel=0.1)
    assert found.noise == NOISE
    total = np.hypot(np.hypot(found.repeatable, found.scatter), found.noise)
    assert total == pytest.approx(found.rmse)
    assert "motor" not in found.regressors


def test_noise_alone_repeats_nothing() -> None:
    found = remainder(bench(0.0, 0.0, 3), bench(0.0, 0.0, 4), Law({}), NOISE)
    assert found is not None
    assert found.repeatable < 0.02 and found.scatter < 0.02


def test_a_few_readings_say_nothing() -> None:
    few: Any = bench(0.5, 0.2, 5, tests=1)
    assert remainder(few, None, Law({}), NOISE) is None
    assert wording.left({"remainder": []}) == ()


def test_what_repeats_is_structure_only_where_most_tests_have_it() -> None:
    found = remainder(bench(0.5, 0.2, 1, tests=6), bench(0.5, 0.2, 2, tests=2), Law({}), NOISE)
    assert found is not None and (found.agreeing, found.tests) == (8, 8)
    assert found.is_steady and found.is_large(before=0.6)
    assert not found.is_large(before=100.0)  # below a tenth of what was there
    few = replace(found, agreeing=4)
    assert not few.is_steady
    alike = remainder(bench(0.0, 0.5, 1, tests=6), bench(0.0, 0.5, 2, tests=2), Law({}), NOISE)
    assert alike is not None and not alike.is_steady


def test_in_words() -> None:
    found = remainder(bench(0.5, 0.2, 1), bench(0.5, 0.2, 2), Law({}), NOISE)
    assert found is not None
    (said,) = wording.left({"remainder": [found.to_json()]})
    assert "repeat from test to test over position and time" in said
    assert "0.1 N are noise" in said or "0.100 N are noise" in said
