"""The whole loop for one campaign: residual, twins, suspects, extended model, before and after."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sysid.diagnosis.actuator.bias_correction import corrected
from sysid.diagnosis.actuator.equation_error import EquationError, equation_error, forget
from sysid.diagnosis.actuator.finder import Finder
from sysid.diagnosis.actuator.logged_supply import logged_supply
from sysid.diagnosis.actuator.moving_boundaries import moving_boundaries
from sysid.diagnosis.actuator.null_distribution import Null
from sysid.diagnosis.actuator.projection import Projected, friction_scatter_of, projected
from sysid.diagnosis.actuator.refit import own_columns, with_base_refitted
from sysid.diagnosis.actuator.samples import Traces, commanded_lengths, prepare
from sysid.diagnosis.actuator.search import Rival, Search, Simulated, search, search_of
from sysid.diagnosis.actuator.signatures import Candidate, candidates, one_form_each
from sysid.diagnosis.actuator.starting_friction import with_sliding_friction
from sysid.diagnosis.actuator.twins import (
    Scatter,
    SensorNoise,
    sensor_noise,
    simulate_twins,
)
from sysid.diagnosis.actuator.whitening import (
    Frame,
    ResidualNoise,
    build_frame,
    friction_scatter,
    noise_of,
)
from sysid.diagnosis.search_record import Recorder, SearchRecord, SearchStage
from sysid.errors import Failure, SimulationError, some_of
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.parallel import attempt, in_threads, limited
from sysid.parameters.scatter import MOST_SCATTER
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.effects.rig_sizes import RigSizes, of_size
from sysid.plant.effects.supply import times_the_usual_flow
from sysid.plant.ports import Model
from sysid.recording.simulation import NOT_FINITE

TWINS = 4
CORRECTION_TWINS = 2
_QUICK_TWINS = 1
# Tests that a notice names.
_SHOWN = 5


@dataclass(frozen=True)
class Loop:
    """Everything that the loop found on the training logs.

    `scatter` is friction's from test to test as the twins have it, `scatter_after` as the
    extended model leaves it; `colour` the noise of each balance; `record`: what was examined, and
    what not.
    """

    traces: Traces
    noise: SensorNoise
    scatter: Scatter
    scatter_after: Scatter
    search: Search
    colour: ResidualNoise
    record: SearchRecord

    @property
    def null(self) -> Null:
        """What twins of the model that was found show."""
        return self.search.null

    @cached_property
    def error(self) -> EquationError:
        """What the model found leaves, its base parameters where they suit the tests best.

        What a fit's own error leaves repeats from test to test, and is no effect.
        """
        model = with_base_refitted(self.search.first, self.search.last.model)
        return equation_error(self.search.last.frame.traces, model)


@dataclass(frozen=True)
class Start:
    """What a search begins with: the tests, the noise in each balance, and what the twins show.

    `logged`: the weighted balances of the logs themselves; `forms`: those of the catalogue that
    are tried; `moving`: effects that may move a choked boundary.
    """

    logged: Frame
    model: Model
    noise: SensorNoise
    scatter: Scatter
    colour: ResidualNoise
    forms: list[Candidate]
    moving: tuple[CatalogueEffect, ...]
    null: Null

    @property
    def traces(self) -> Traces:
        """The logs."""
        return self.logged.traces

    def frame(self, traces: Traces) -> Frame:
        """The weighted balances of twins of the logs."""
        return build_frame(traces, self.model, self.colour, self.scatter.sliding, self.moving)


@dataclass
class Memory:
    """What a search of some tests worked out, for the next one without some of its effects.

    `shown`: the effects that motion spoke for.
    """

    start: Start | None = None
    finder: Finder | None = None
    shown: frozenset[str] = frozenset()


def begin(
    tests: Sequence[tuple[str, str, Trial]],
    rig: Rig,
    model: Model,
    catalogue: Iterable[type[CatalogueEffect]],
    recorder: Recorder,
    *,
    seed: int = 0,
    progress: Callable[[str], None] = lambda line: None,
) -> Start:
    """Simulate what `close_loop` judges by; notes in `recorder` what failed."""
    with limited():
        noise = sensor_noise(tests, rig)
        traces = prepare(tests, rig, model)
        model = with_sliding_friction(traces, model)
        has_motor = bool(np.any(traces.motor))
        own = [e for e in catalogue if not e.averaged_only and (has_motor or not e.needs_motor)]
        own = of_size(own, RigSizes.of(model.parameters))
        flows = times_the_usual_flow(model.parameters)
        lengths = commanded_lengths(traces.runs, model)
        forms = candidates(own, traces.travel, rig.sides, flows, lengths)
        if recorder.quick:
            forms = one_form_each(forms)
            recorder.left_out(SearchStage.FORMS)
        pilot = _pilot(traces, model, noise, rig, seed + 1, recorder)
        # The noise's colour in the residuals comes from a twin; scatter does not affect it.
        colour = noise_of(pilot, model, noise, seed + 3)

        def away(moving: Sequence[CatalogueEffect]) -> Projected:
            return projected(build_frame(traces, model, colour, 0.0, tuple(moving)), model)

        bare = away(())
        moving = moving_boundaries(bare, forms, away)
        if moving:
            bare = away(moving)
        spread = min(friction_scatter(bare.frame, bare.rest), MOST_SCATTER)
        logged = replace(bare.frame, scatter=spread)
        sensors = _sensor_squares(logged)
    scatter = Scatter(spread, spread)
    progress(f"friction scatters by {100 * spread:.1f} % from test to test")

    def frame_of(twin: Traces) -> Frame:
        return build_frame(twin, model, colour, spread, moving)

    def twin_frame(twin: Traces) -> Projected:
        return projected(frame_of(twin), model)

    def twins_given(base: Projected) -> list[Projected]:
        """Twins of the model of a residual, with as much scatter of friction as that leaves; in
        the same frame as the logs."""
        left = min(friction_scatter_of(base.frame, base.model), spread)
        own = Scatter(left, left)
        found = simulate_twins(traces, base.model, noise, own, CORRECTION_TWINS, seed + 4, rig)

        def of_twin(twin: Traces) -> Projected:
            frame = replace(frame_of(twin), scatter=base.frame.scatter)
            return projected(frame, base.model, own_columns(frame, base.model))

        return in_threads(of_twin, [twin for twin in found if twin.is_finite()])

    count = _QUICK_TWINS if recorder.quick else TWINS
    if recorder.quick:
        recorder.left_out(SearchStage.TWINS)
    recorder.enter(SearchStage.TWINS)
    progress(f"simulating {count} twin{'s' * (count > 1)}")
    judged: list[Projected] = []

    def judge() -> None:
        twins = simulate_twins(traces, model, noise, scatter, count, seed, rig, set())
        judged.extend(in_threads(twin_frame, list(twins)))

    with limited():
        ended = attempt(judge)
        if isinstance(ended, Failure):
            recorder.miss(ended, decides=False)
        null = Null(
            judged or [twin_frame(pilot)],
            sensors,
            twins_given,
            is_of_twins=bool(judged) or pilot is not traces,
        )
    return Start(logged, model, noise, scatter, colour, forms, moving, null)


def close_loop(
    tests: Sequence[tuple[str, str, Trial]],
    rig: Rig,
    model: Model,
    catalogue: Iterable[type[CatalogueEffect]],
    *,
    simulated: Simulated,
    seed: int = 0,
    quick: bool = False,
    memory: Memory | None = None,
    progress: Callable[[str], None] = lambda line: None,
) -> Loop:
    """Find what a fitted model lacks on training tests, given as (file, kind, trial).

    Of the numbers with and without the twins' correction, those are kept with which the fitted
    motion tests are `simulated` better. Ends within the limit in force (`sysid.parallel`), save for
    what no verdict can do without: the residual, the twins and the first round. `quick`: a first
    look, with one twin, one form of each effect, one effect at most and no correction. `memory`: of
    an earlier search of these tests with more effects.
    """
    recorder, memory = Recorder(quick=quick), memory or Memory()
    catalogue = tuple(catalogue)
    if memory.start is None or memory.finder is None:
        start = begin(tests, rig, model, catalogue, recorder, seed=seed, progress=progress)
        with limited():
            first = projected(start.logged, start.model)
            supply = logged_supply(start.traces, start.model)
        finder = Finder(first, start.forms, start.null, recorder, progress, supply)
        memory.start, memory.finder = start, finder
    else:
        start, finder = memory.start, memory.finder
        gone = {form.id for form in start.forms} - {e.id for e in catalogue}
        finder.bar(gone, recorder, memory.shown)
    found = search(finder, simulated, memory.shown - finder.barred)
    forget()
    if found.steps and quick:
        recorder.left_out(SearchStage.CORRECTION)
    elif found.steps:
        recorder.enter(SearchStage.CORRECTION)
        progress("correcting the numbers with twins of the extended model")
        before = found
        better = attempt(lambda: _corrected(before, start, rig, simulated, seed + 2))
        if isinstance(better, Failure):
            recorder.miss(better, decides=False)
        else:
            found = better
    return Loop(
        start.traces,
        start.noise,
        start.scatter,
        _scatter_after(start, found.model),
        found,
        start.colour,
        recorder.closed(),
    )


def loop_of(rival: Rival, found: Loop, memory: Memory) -> Loop:
    """The same loop with a rival's effects in the place of those that were found first.

    `memory`: of that search. Raises OutOfBudgetError.
    """
    assert memory.start is not None and memory.finder is not None
    other = search_of(memory.finder, rival)
    return replace(found, search=other, scatter_after=_scatter_after(memory.start, other.model))


def _scatter_after(start: Start, model: Model) -> Scatter:
    """Friction's scatter from test to test as an extended model leaves it."""
    with limited():
        after = build_frame(start.traces, model, start.colour, 0.0, start.moving)
        left = min(friction_scatter_of(after, model), start.scatter.sliding)
    return Scatter(left, left)


def _sensor_squares(frame: Frame) -> dict[str, float]:
    """Mean whitened square of the sensors' noise along the logs' own motion, by balance."""
    squares = {name: frame.whitened(name, values) ** 2 for name, values in frame.sensors.items()}
    return {name: float(np.mean(rows)) for name, rows in squares.items() if len(rows)}


def _pilot(
    traces: Traces, model: Model, noise: SensorNoise, rig: Rig, seed: int, recorder: Recorder
) -> Traces:
    """A twin without scatter; the logs themselves where the model cannot be simulated.

    No effect gains more on the logs than on those, so that none is named then.
    """
    recorder.enter(SearchStage.TWIN)
    lost: set[str] = set()
    try:
        found = next(iter(simulate_twins(traces, model, noise, Scatter(), 1, seed, rig, lost)))
        if lost:
            recorder.note(
                f"{some_of(sorted(lost), _SHOWN)}: {NOT_FINITE} with the given model: only an "
                "effect that shows in the other tests is found"
            )
        return found
    except SimulationError as error:
        recorder.miss(Failure(str(error)))
        return traces


def _corrected(
    found: Search,
    start: Start,
    rig: Rig,
    simulated: Simulated,
    seed: int,
) -> Search:
    """The search with its numbers corrected by twins, where that simulates better."""
    try:
        twins = simulate_twins(
            start.traces, found.model, start.noise, Scatter(), CORRECTION_TWINS, seed, rig
        )
        scatter = found.first.frame.scatter
        frames = in_threads(start.frame, [twin for twin in twins if twin.is_finite()])
        other = corrected(found, [replace(frame, scatter=scatter) for frame in frames])
        return min(found, other, key=lambda s: simulated(s.model))
    except SimulationError:
        return found


__all__ = ["Loop", "Memory", "Start", "begin", "close_loop", "loop_of"]
