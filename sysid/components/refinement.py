"""A dynamic component estimated by simulation error over whole tests, their starts free."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from sysid.blocks.numbers import number
from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table, estimate_records, table
from sysid.components.definition import DynamicComponent
from sysid.components.dynamic import DynamicPart
from sysid.components.own_tests import tests_of, training_part
from sysid.components.parts import OwnPart, effects_in
from sysid.components.validation import validate_own
from sysid.diagnosis.bench.component import Law
from sysid.errors import InputError, NotIdentifiedError
from sysid.estimation.linear import Estimate
from sysid.estimation.nonlinear import LeastSquaresFit, Parameter, minimise
from sysid.io.campaign import Campaign
from sysid.parameters import Bundle
from sysid.types import FloatArray, Progress, no_progress


@dataclass(frozen=True, repr=False)
class OwnRefinement(Shown):
    """The bundle with refined numbers; `estimates` by name, terms' as `TERM/QUANTITY`.

    `before` and `after`: RMSE of whole held-out tests (training tests without any) by output, each
    test simulated from its own measured start. All are empty where there was nothing to refine.
    """

    bundle: Bundle
    estimates: dict[str, Estimate]
    moved_from: dict[str, float]
    before: dict[str, float]
    after: dict[str, float]
    notices: tuple[str, ...] = ()
    worse = ""
    """In words how much worse tests are simulated: the numbers are those that simulate best."""

    def headline(self) -> str:
        """What was done."""
        if not self.estimates:
            return "Nothing to refine: the bundle is unchanged."
        return f"{len(self.estimates)} parameters by simulation error, the starts of the tests free"

    def records(self) -> list[dict[str, Any]]:
        """One record per parameter."""
        return estimate_records(self.estimates)

    def tables(self) -> Iterable[Table]:
        """Each parameter before and after, and the errors of whole tests."""
        rows = [
            (
                name,
                number(self.moved_from[name]),
                number(e.value) if e.identified else "not identified",
                number(e.std) if e.identified else "",
                e.unit,
            )
            for name, e in self.estimates.items()
        ]
        columns = ("parameter", "before", "after", "std. error", "unit")
        yield table("Parameters", columns, tuple(rows))
        errors = [(n, number(self.before[n]), number(self.after[n])) for n in self.before]
        yield table("RMSE of whole tests", ("output", "before", "after"), tuple(errors))

    def to_json(self) -> dict[str, Any]:
        """Estimates, and errors before and after."""
        rmse = {n: {"before": self.before[n], "after": self.after[n]} for n in self.before}
        return {"parameters": {n: e.to_json() for n, e in self.estimates.items()}, "rmse": rmse}


def refine_own(
    campaign: Campaign, bundle: Bundle, *, progress: Progress = no_progress
) -> OwnRefinement:
    """Estimate a dynamic component's parameters, and its terms', by simulation error.

    Whole tests (with `segment_s` its segments) are simulated from starts that are estimated with
    the parameters: a start read from noisy columns biases them. A static component has no start and
    no simulation: its fit is this already, and a notice says so. Raises InputError for logs, code
    or effects that cannot be used, NotIdentifiedError where the bundle lacks the law.
    """
    tests = tests_of(campaign, bundle)
    part = training_part(tests, [effect.id for effect in effects_in(bundle, tests.loaded)])
    law = part.law_of(bundle)
    if not isinstance(tests.loaded.definition, DynamicComponent):
        line = f"{tests.loaded.kind}: a static law: its fit is already the refinement"
        return OwnRefinement(bundle, {}, {}, {}, {}, (*tests.notices, line))
    progress(f"refining {tests.loaded.name} on {len(part.trials)} tests")
    fit = _fit(cast(DynamicPart, part), law)
    names = [p.name for p in part.parameters()]
    covariance = fit.correlated_covariance(_groups(part))
    estimates = {name: fit.estimate(name, covariance) for name in names}
    refined = part.with_numbers(bundle, estimates)
    stays = [name for name, estimate in estimates.items() if not estimate.identified]
    notices = [
        *tests.notices,
        *(f"{name} is not identified: it keeps its value" for name in stays),
    ]
    try:
        before, after = (_errors(campaign, b, progress) for b in (bundle, refined))
    except (InputError, NotIdentifiedError) as error:
        # The numbers are found by now, from the training tests alone.
        before, after = {}, {}
        notices.append(f"errors of whole tests are not known: {error}")
    used = campaign.sources("fit")
    start = {name: law.values[name] for name in names}
    return OwnRefinement(
        refined.with_sources(used), estimates, start, before, after, tuple(notices)
    )


def _fit(part: DynamicPart, law: Law) -> LeastSquaresFit:
    """Over the parameters, then the offsets of every run's start, state by state."""
    own = [
        Parameter(p.name, law.values[p.name], p.unit, p.lower, p.upper, p.size)
        for p in part.parameters()
    ]
    sizes = part.state_sizes(law)
    starts = [
        Parameter(f"start of {state}, run {r + 1}", 0.0, "", scale=float(sizes[i]))
        for r in range(len(part.pieces))
        for i, state in enumerate(part.made.states)
    ]
    count, shape = len(own), (len(part.pieces), len(part.made.states))

    def split(values: FloatArray) -> tuple[Law, FloatArray]:
        numbers = {p.name: float(v) for p, v in zip(own, values[:count], strict=True)}
        return Law(numbers), values[count:].reshape(shape)

    return minimise(
        lambda values: part.residuals_from(*split(values)),
        [*own, *starts],
        jacobian=lambda values: part.jacobian_from(*split(values)),
        tolerance=1e-8,
        max_evaluations=50,
        polish=False,
    )


def _groups(part: OwnPart) -> Any:
    every = range(len(part.tests))
    counts = [len(values) for values in part.measured(every)]
    return np.repeat(np.arange(len(counts)), counts)


def _errors(campaign: Campaign, bundle: Bundle, progress: Progress) -> dict[str, float]:
    result = validate_own(campaign, bundle, progress=progress)
    logs = result.select("holdout") or result.logs
    found = {}
    for name in logs[0].channels:
        errors = [log.channels[name].errors for log in logs]
        squares, samples = sum(e.squares for e in errors), sum(e.samples for e in errors)
        found[name] = float(np.sqrt(squares / samples))
    return found


__all__ = ["OwnRefinement", "refine_own"]
