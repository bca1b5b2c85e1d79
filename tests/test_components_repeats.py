"""Whether a choice returns on parts of the tests: on a part that is made up here."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from sysid.diagnosis.bench.component import Component, Law
from sysid.diagnosis.bench.fitting import fit_law
from sysid.diagnosis.bench.selection import select
from sysid.diagnosis.bench.stability import Repeats, parts, repeats
from sysid.errors import NotIdentifiedError
from sysid.estimation.linear import Estimate
from sysid.estimation.nonlinear import Parameter
from sysid.estimation.quality import FitQuality
from sysid.parameters import Bundle, Parts
from sysid.plant.base import Array
from sysid.plant.effects.entry import CatalogueEffect, Quantity
from sysid.plant.ports import Point
from sysid.types import FloatArray

ROWS = 60
NOISE = 0.1


@dataclass(frozen=True)
class Curved(CatalogueEffect):
    """+ d (x^2 - 1/3), which leaves the level alone."""

    curve_n: Array = 0.0

    id = "curved"
    title = "a parabola"
    subsystem = "friction"
    quantities = (Quantity("curve_n", "N", 1.0, -10.0, 10.0, "at x = 1"),)
    signature = "x squared"
    source = "this test"

    def friction_effort(self, effort: Array, point: Point) -> Array:
        return effort + self.curve_n * (np.asarray(point) ** 2 - 1.0 / 3.0)


@dataclass(frozen=True)
class Sloped(Curved):
    """+ d x."""

    curve_n: Array = 0.0

    id = "sloped"
    title = "a line"

    def friction_effort(self, effort: Array, point: Point) -> Array:
        return effort + self.curve_n * np.asarray(point)


def quartic(limit: float) -> type[CatalogueEffect]:
    """+ d (x^4 - 1/5), with d plausible up to a limit."""

    @dataclass(frozen=True)
    class Quartic(Curved):
        share: Array = 0.0

        id = "quartic"
        quantities = (Quantity("share", "-", 0.5 * limit, -limit, limit, "at x = 1"),)

        def friction_effort(self, effort: Array, point: Point) -> Array:
            return effort + self.share * (np.asarray(point) ** 4 - 0.2)

    return Quartic


KINDS: dict[str, type[CatalogueEffect]] = {"curved": Curved, "sloped": Sloped}


@dataclass(frozen=True)
class Line(Component):
    """y = level, and what effects add to it at x."""

    x: tuple[FloatArray, ...]
    y: tuple[FloatArray, ...]

    channel = "y"
    unit = "N"

    @property
    def tests(self) -> tuple[str, ...]:
        return tuple(str(i) for i in range(len(self.x)))

    def parameters(self) -> list[Parameter]:
        return [Parameter("level", 1.0, "N")]

    def effects(
        self, catalogue: Mapping[str, type[CatalogueEffect]]
    ) -> tuple[type[CatalogueEffect], ...]:
        return tuple(catalogue.values())

    def measured(self, tests: Sequence[int]) -> list[FloatArray]:
        return [self.y[t] for t in tests]

    def residuals(self, law: Law, tests: Sequence[int]) -> list[FloatArray]:
        found = []
        for t in tests:
            modelled: Any = law.values["level"] + np.zeros(len(self.x[t]))
            for effect in law.effects:
                modelled = effect.friction_effort(modelled, self.x[t])  # type: ignore[arg-type]
            found.append(self.y[t] - modelled)
        return found

    def regressors(self, tests: Sequence[int]) -> dict[str, FloatArray]:
        return {"x": np.concatenate([self.x[t] for t in tests])}

    def noise_floor(self, law: Law) -> float:
        return NOISE

    def part(self, estimates: Mapping[str, Estimate], quality: FitQuality | None = None) -> Parts:
        return Parts()

    def law_of(self, bundle: Bundle) -> Law:
        raise NotIdentifiedError("none")


def line(*sizes: tuple[float, float]) -> Line:
    """A test for each pair: how much of the parabola and of the line it holds."""
    rng = np.random.default_rng(len(sizes))
    xs = [rng.permutation(np.linspace(-1.0, 1.0, ROWS)) for _ in sizes]
    ys = [
        2.0 + curve * (x**2 - 1.0 / 3.0) + slope * x + NOISE * rng.standard_normal(ROWS)
        for (curve, slope), x in zip(sizes, xs, strict=True)
    ]
    return Line(tuple(xs), tuple(ys))


def test_what_all_tests_hold_is_named_by_each_part() -> None:
    (addition,) = select(line(*[(1.0, 0.0)] * 6), KINDS).additions
    assert addition.repeats == Repeats("curved", ("curved", "curved", "curved"))
    assert addition.repeats.sentence == ""
    assert addition.ambiguous == () and not addition.is_ambiguous


def test_an_effect_that_a_part_names_instead_makes_it_ambiguous() -> None:
    """The fourth test lacks the parabola: what is fitted without it does not predict it."""
    addition, *_ = select(line(*[(2.0, 0.6)] * 3, (0.0, 0.6)), KINDS).additions
    assert addition.repeats == Repeats("curved", ("sloped", "curved", "curved"))
    assert addition.ambiguous == addition.repeats.others == ("sloped",)
    assert addition.is_ambiguous
    assert addition.repeats.sentence == (
        "curved: ambiguous: of 3 parts of the fitted tests 1 names sloped"
    )
    named = ["sloped", "curved", "curved"]
    assert addition.repeats.to_json() == {"parts": 3, "agree": 2, "named": named}


@pytest.mark.parametrize(("limit", "named"), [(10.0, "quartic"), (0.9, "curved")])
def test_a_strength_beyond_what_is_plausible_goes_behind(limit: float, named: str) -> None:
    """It predicts best at its limit, too, but what is there is larger than it can be."""
    part = line(*[(0.0, 0.0)] * 6)
    part = Line(part.x, tuple(y + x**4 - 0.2 for x, y in zip(part.x, part.y, strict=True)))
    addition, *_ = select(part, {"curved": Curved, "quartic": quartic(limit)}).additions
    assert max(addition.tried, key=lambda one: one.reduction).id == "quartic"
    assert addition.id == named
    assert addition.repeats.named == (named, named, named)


def test_a_part_too_weak_to_tell_names_no_effect() -> None:
    """In one test of three alone, an effect predicts no other."""
    part = line((3.0, 0.0), (0.0, 0.0), (0.0, 0.0))
    found = repeats(part, fit_law(part, (), range(3)), [fit_law(part, [Curved], range(3))])
    assert found.named == (None, None, None)
    assert "3 name no effect" in found.sentence and found.others == ()


def test_what_fits_but_does_not_predict_is_ambiguous_where_parts_name_it() -> None:
    """Two tests of three hold the parabola, the third a little of its reverse."""
    found = select(line((1.0, 0.0), (1.0, 0.0), (-0.2, 0.0)), KINDS)
    assert found.additions == ()
    assert found.undecided == (Repeats("curved", ("curved", "curved", None)),)
    assert "2 of 3 parts of them name it" in found.undecided[0].undecided_sentence


def test_what_does_not_fit_is_not_ambiguous() -> None:
    assert select(line(*[(0.0, 0.0)] * 3), KINDS).undecided == ()


@pytest.mark.parametrize(
    ("count", "expected"),
    [
        (2, []),
        (3, [[1, 2], [0, 2], [0, 1]]),
        (5, [[1, 2, 4], [0, 2, 3], [0, 1, 3, 4]]),
        (6, [[0, 3], [1, 4], [2, 5]]),
    ],
)
def test_parts_are_disjoint_where_there_are_tests_enough(
    count: int, expected: list[list[int]]
) -> None:
    assert parts(line(*[(1.0, 0.0)] * count)) == expected


def test_the_winner_is_the_fit_that_was_tried() -> None:
    """It is not fitted again, and its numbers are those of its law."""
    part = line(*[(1.0, 0.0)] * 4)
    (addition,) = select(part, KINDS).additions
    base = fit_law(part, (), range(4))
    again = fit_law(part, [Curved], range(4), base.law)
    assert addition.fitted.law == again.law
    assert addition.effect == Curved(addition.fitted.fit["curved/curve_n"])
    assert addition.fitted.fit["curved/curve_n"] == pytest.approx(1.0, abs=0.1)
