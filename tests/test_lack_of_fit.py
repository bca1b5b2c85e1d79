"""Remainder of a part's error: what repeats is told from what differs between tests."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.diagnosis import wording
from sysid.diagnosis.bench.component import Component, Law
from sysid.diagnosis.bench.unexplained import curves
from sysid.diagnosis.bench.unexplained import left_over as remainder
from sysid.diagnosis.lack_of_fit import ResidualTable, dependences, per_direction
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

    @property
    def recordings(self) -> dict[str, list[int]]:
        return {test: [place] for place, test in enumerate(self.tests)}

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
    assert wording.remainder_lines({"remainder": []}) == ()


def test_what_repeats_is_structure_beyond_the_noise_and_a_tenth_of_the_error() -> None:
    found = remainder(bench(0.5, 0.2, 1, tests=6), bench(0.5, 0.2, 2, tests=2), Law({}), NOISE)
    assert found is not None and (found.agreeing, found.tests) == (2, 2)
    assert found.regressors == ("position",)
    assert found.is_structure(before=0.6)
    assert not found.is_structure(before=100.0)  # below a tenth of what was there
    alike = remainder(bench(0.0, 0.5, 1, tests=6), bench(0.0, 0.5, 2, tests=2), Law({}), NOISE)
    assert alike is not None and alike.repeatable == 0.0 and not alike.is_structure(before=0.6)


def test_the_noise_is_given_and_no_more_than_what_no_test_predicts() -> None:
    """A wave finer than a dozen bins, of tests whose sensors are far quieter."""
    parts = cast(Any, bench(0.5, 0.0, 7, tests=6))
    fine = [w + 0.5 * np.sin(200.0 * p) for w, p in zip(parts.left, parts.positions, strict=True)]
    part = cast(Component, replace(cast(Any, parts), left=fine))
    quiet, loud, unknown = (remainder(part, None, Law({}), n) for n in (1e-3, 10.0, math.nan))
    assert quiet is not None and loud is not None and unknown is not None
    assert quiet.noise == 1e-3
    assert loud.noise == unknown.noise == pytest.approx(NOISE, rel=0.5)
    assert quiet.repeatable == pytest.approx(0.5, rel=0.05)


def test_what_holds_the_residual_explains_nothing() -> None:
    """The effort of a balance holds whatever the balance lacks."""
    found = curves(bench(0.5, 0.0, 1, tests=6), Law({}), Law({}))
    assert {curve.regressor for curve in found} == {"position"}


def test_in_words() -> None:
    found = remainder(bench(0.5, 0.2, 1), bench(0.5, 0.2, 2), Law({}), NOISE)
    assert found is not None
    (said,) = wording.remainder_lines({"remainder": [found.to_json()]})
    assert "repeat from test to test over position" in said
    assert "0.1 N are noise" in said or "0.100 N are noise" in said


@pytest.mark.parametrize(("repeats", "is_weighed"), [(0.0, True), (0.56, False)])
def test_a_share_that_is_not_of_the_size_says_so(repeats: float, is_weighed: bool) -> None:
    """ "31 % of its variance" does not stand next to "0 repeat" without a word."""
    rest = {"channel": "theta_rad", "rmse": 1.0, "repeatable": repeats}
    entry = {"channel": "theta_rad", "regressor": "velocity", "share": 0.31}
    content = {"verdict": "unexplained", "effects": [], "residual": {}, "because": "structure",
               "unexplained": [entry], "remainder": [rest]}  # fmt: skip
    assert "(31 % of the residual's variance" in wording.sentence(content)
    assert (wording.WEIGHED in wording.sentence(content)) is is_weighed
    # A part alone is judged by its size.
    assert wording.WEIGHED not in wording.sentence({**content, "component": "tank"})


def test_a_small_share_says_what_most_of_the_residual_is() -> None:
    rest = {"channel": "theta_rad", "rmse": 1.0, "repeatable": 0.1, "scatter": 0.9, "noise": 0.42}
    entry = {"channel": "theta_rad", "regressor": "velocity", "share": 0.01}
    content = {"verdict": "unexplained", "effects": [], "residual": {}, "because": "structure",
               "unexplained": [entry], "remainder": [rest]}  # fmt: skip
    assert "(1.0 % of the residual's variance; 81 % differs from test to test)" in (
        wording.sentence(content)
    )


def test_what_nothing_logged_predicts_is_not_said_to_be_over_a_quantity() -> None:
    rest = {"channel": "theta_rad", "rmse": 1.0, "repeatable": 0.0, "scatter": 0.9, "noise": 0.42}
    entry = {"channel": "theta_rad", "regressor": "pressure_a", "share": 0.0}
    content = {"verdict": "unexplained", "effects": [], "residual": {}, "because": "structure",
               "unexplained": [entry], "remainder": [rest]}  # fmt: skip
    said = wording.sentence(content)
    assert "nothing logged predicts it (81 % differs from test to test)" in said
    assert "pressure" not in said and "structure" not in said
    assert wording.advice_on_rest(content)[0].startswith("The remainder is another in each test")
    # Of an actuator a share that is nothing of the residual's size says as much.
    entry["share"] = 5e-4
    assert wording.sentence(content) == said
    entry["share"] = 0.3
    assert "wider range" in wording.advice_on_rest(content)[0]


def test_a_search_that_a_quick_run_cuts_short_has_not_failed() -> None:
    missed = [{"stage": "twins", "reason": "left out by --quick"}]
    content = {"verdict": "unexplained", "effects": [], "residual": {}, "unexplained": [],
               "because": "unfinished search", "search": {"missed": missed}}  # fmt: skip
    said = wording.sentence(content)
    assert "may have missed an effect" in said and "failed" not in said
    assert said.count("did not complete") == 1 and "incomplete: not done:" not in said


# --- the statistic --------------------------------------------------------------------------


def campaign_without_structure(seed: int, fewest: int = 3) -> ResidualTable:
    """Tests whose residuals are correlated, of unlike spread, and off by friction of their own."""
    rng = np.random.default_rng(seed)
    tests, samples = int(rng.integers(fewest, 9)), 400
    correlation = rng.choice([0.0, 0.5, 0.9, 0.98])
    scatter, unlike = rng.choice([0.0, 0.3, 1.0]), rng.choice([0.0, 1.0])
    time = 0.01 * np.arange(samples)
    columns: dict[str, list[FloatArray]] = {"position": [], "velocity": [], "time": []}
    left = []
    for number in range(tests):
        phase = 0.2 * number + rng.uniform(0.0, 6.0) * rng.integers(0, 2)
        position = np.sin(2.0 * np.pi * time / 1.7 + phase)
        velocity = np.gradient(position, time)
        white = rng.standard_normal(samples)
        noise = lfilter([math.sqrt(1.0 - correlation**2)], [1.0, -correlation], white)
        size = math.exp(unlike * rng.standard_normal())
        left.append(size * noise + scatter * rng.standard_normal() * np.sign(velocity))
        for name, values in (("position", position), ("velocity", velocity), ("time", time)):
            columns[name].append(values)
    found = {name: np.concatenate(parts) for name, parts in columns.items()}
    found["way"] = per_direction(found["position"], found["velocity"])
    # As a fitted law leaves it.
    law = np.column_stack([np.sign(found["velocity"]), found["velocity"], np.ones(len(left) * 400)])
    whole = np.concatenate(left)
    whole = whole - law @ np.linalg.lstsq(law, whole, rcond=None)[0]
    return ResidualTable(found, whole, np.repeat(np.arange(tests), samples))


def test_chance_is_not_structure() -> None:
    """At most one in a hundred."""
    found = [dependences(campaign_without_structure(seed)) for seed in range(100)]
    assert sum(any(d.is_significant for d in of_one) for of_one in found) <= 1


@pytest.mark.parametrize("waves", [1.0, 5.0, 15.0])
def test_a_wave_is_found_at_any_length_that_the_sampling_resolves(waves: float) -> None:
    for seed in range(6):
        table = campaign_without_structure(seed, fewest=6)
        size = float(np.std(table.left))
        wave = size * math.sqrt(2.0) * np.sin(waves * np.pi * table.columns["position"] + 0.3)
        best = dependences(replace(table, left=table.left + wave))[0]
        assert best.is_significant and best.regressors[0] in ("position", "way")
        assert best.share > 0.1


def test_two_tests_do_not_say_how_tests_differ() -> None:
    table = campaign_without_structure(1)
    assert dependences(replace(table, test=np.minimum(table.test, 1))) == []
