"""Validated tests as the report draws them: by test, all valve models together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from sysid.blocks.titles import use_word
from sysid.estimation.linear import NORMAL
from sysid.io.channels import Channel, shown_of
from sysid.types import FloatArray
from sysid.validation.results import Errors

if TYPE_CHECKING:
    from sysid.validation import TestResult, ValidationResult


MODEL_NAMES = {
    "discrete": "on/off law",
    "averaged": "averaged law",
    "bipolynomial": "bipolynomial",
    "ann": "network",
}
"""The valve models that a validation may hold; the first follows every pulse."""
NOISE_BAND = NORMAL
"""Half-width of the noise band in standard deviations: 95 % of pure noise lies inside."""


@dataclass(frozen=True)
class ShownTest:
    """One test; `results` by valve model, the primary one first."""

    log: str
    kind: str
    use: str
    test: str
    results: Mapping[str, TestResult]

    @property
    def first(self) -> TestResult:
        """Under the primary valve model."""
        return next(iter(self.results.values()))

    @property
    def source(self) -> str:
        """Its file and its label, as messages name it."""
        return f"{self.first.file}, test {self.test}" if self.test else self.first.file

    @property
    def title(self) -> str:
        """Log, test and use; text from a file, to be escaped."""
        test = f", test {self.test}" if self.test else ""
        return f"{self.log}{test} ({self.kind}, {use_word(self.use)})"

    def under(self, models: Sequence[str]) -> ShownTest:
        """The same under some of its valve models; under its own where it has none of them."""
        kept = {model: result for model, result in self.results.items() if model in models}
        return replace(self, results=kept or self.results)

    def channels(self) -> list[Channel]:
        """The measured channels, position first."""
        return shown_of(self.first.measured)

    def lack_of_fit(self) -> float:
        """The position's residual (else any channel's), as a share of its variation."""
        fits = [r.errors.fit_percentage for r in self.first.channels.values()]
        known = [f for f in fits if f is not None]
        return 100.0 - known[0] if known else 0.0


def recommended_models(validation: ValidationResult) -> tuple[str, ...]:
    """The primary valve model, and of the others the one that follows the position best.

    On the held-out logs that it simulates; on the training logs where none is held out.
    """
    logs = validation.select("holdout") or validation.logs
    order = [model for model in MODEL_NAMES if validation.select(model=model)]
    errors: dict[str, float] = {}
    for model in order[1:]:
        channels = [log.channels for log in logs if log.model == model]
        key = next((c.key for c in shown_of(name for own in channels for name in own)), "")
        parts = [own[key].errors for own in channels if key in own]
        if parts:
            errors[model] = Errors.pooled(parts).rmse
    best = min(errors, key=errors.__getitem__, default=None)
    return tuple(order[:1]) if best is None else (order[0], best)


def shown_channels(validation: ValidationResult) -> list[Channel]:
    """The channels present in any log, position first."""
    return shown_of(name for log in validation.logs for name in log.channels)


def tests_of(validation: ValidationResult) -> list[ShownTest]:
    """Every test, in the campaign's order, with its results by valve model."""
    groups: dict[tuple[str, str, str, str], dict[str, TestResult]] = {}
    for validated in validation.logs:
        for result in validated.tests:
            key = (result.log, result.kind, result.use, result.test)
            groups.setdefault(key, {})[result.model] = result
    tests = []
    for (log, kind, use, label), results in groups.items():
        order = sorted(results, key=lambda m: list(MODEL_NAMES).index(m))
        tests.append(ShownTest(log, kind, use, label, {m: results[m] for m in order}))
    return tests


def tests_to_show(tests: Sequence[ShownTest]) -> list[ShownTest]:
    """Held-out tests, and of each kind without held-out tests the one with the worst fit.

    At most `8`; if there are more, those with the worst fit in each kind.
    """
    held = {test.kind for test in tests if test.use == "holdout"}
    ranked: dict[tuple[str, str], list[ShownTest]] = {}
    for test in sorted(tests, key=ShownTest.lack_of_fit, reverse=True):
        ranked.setdefault((test.use, test.kind), []).append(test)
    order = sorted(
        (
            (0 if use == "holdout" else 1, place, test)
            for (use, _), group in ranked.items()
            for place, test in enumerate(group)
            if use == "holdout" or (place == 0 and test.kind not in held)
        ),
        key=lambda item: item[:2],
    )
    kept = [id(test) for *_, test in order[:8]]
    chosen = [test for test in tests if id(test) in kept]
    return sorted(chosen, key=lambda t: t.use != "holdout")


def speed(result: TestResult, position: str) -> FloatArray:
    """Speed (n,), per second, from the zero-phase filtered position."""
    from sysid import signals

    period = float(np.median(np.diff(result.time)))
    return signals.filtered_speed(result.measured[position], period)
