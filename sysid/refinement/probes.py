"""Effects that the model lacks, at strength zero: the response to a small amount of each."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.io.channels import simulated_channels
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Model, overrides
from sysid.plant.sensors import measured_channels
from sysid.refinement.information import ProbedProblem, SensorProbe
from sysid.refinement.problem import LOCAL
from sysid.refinement.runs import Run
from sysid.refinement.unknowns import Unknown, model_at
from sysid.types import FloatArray

# Share of the usual size that is tried, and how well the slope must predict the change.
_TRIED_SHARE, _LINEAR = 0.01, 0.3
_MOST_TESTS = 6


@dataclass(frozen=True)
class Probes:
    """Effects added to a model at strength zero: their strengths as unknowns.

    One unit of each column is the strength's typical size. `effects` in the order of the columns:
    those simulated first, then those of the sensors; `sensors` are the latter's.
    """

    model: Model
    unknowns: tuple[Unknown, ...]
    sensors: tuple[SensorProbe, ...]
    effects: tuple[type[CatalogueEffect], ...]

    @property
    def columns(self) -> int:
        return len(self.unknowns) + len(self.sensors)

    def places(self) -> dict[str, list[int]]:
        """The columns of each effect's strengths, by its id, from 0."""
        found, at = {}, 0
        for effect in self.effects:
            count = len(effect.strengths())
            found[effect.id] = list(range(at, at + count))
            at += count
        return found


def probes_of(model: Model, effects: Iterable[type[CatalogueEffect]]) -> Probes:
    """A model with these effects, at strength zero, in addition to its own."""
    simulated, sensing, unknowns, sensors = [], [], [], []
    added: list[CatalogueEffect] = []
    for effect in effects:
        neutral = effect.neutral()
        if overrides(neutral, "measure"):
            sensing.append(effect)
            sensors += [SensorProbe(neutral, q.name, q.typical) for q in effect.strengths()]
            continue
        simulated.append(effect)
        added.append(neutral)
        part = len(model.effects) + len(added)
        for q in effect.strengths():
            place = f"{effect.id}.{q.label}"
            size = abs(q.typical)
            unknowns.append(
                Unknown(
                    place, (part, q.name), 0.0, math.nan, q.unit, -np.inf, np.inf, size, "effect"
                )
            )
    whole = Model(model.parameters, (*model.effects, *added))
    return Probes(whole, tuple(unknowns), tuple(sensors), (*simulated, *sensing))


def without_slope(problem: ProbedProblem, probes: Probes) -> list[str]:
    """Ids of effects that are not linear in a strength near zero: thresholds, gaps.

    A few runs are simulated with a small amount of each strength in turn. One of several that shows
    nothing at all, as gravity on a level rig, says nothing of the others.
    """
    runs = _one_by_test(problem.runs)
    one = dataclasses.replace(problem, runs=runs, whitening=problem.whitening[: len(runs)])
    slopes = [own.errors.slopes for own in one.linearised(one.first_point())]
    first = LOCAL + len(problem.unknowns) - len(probes.unknowns)
    moved = [
        model_at(problem.model, [u], np.array([_TRIED_SHARE * u.scale])) for u in probes.unknowns
    ]
    base, *shown = _simulated(one, [problem.model, *moved])
    found: dict[str, list[float]] = {}
    for i, (unknown, changed) in enumerate(zip(probes.unknowns, shown, strict=True), start=first):
        departures = [
            _lack_of_fit((c - b) / _TRIED_SHARE, own[i] / run.noise[:, None])
            for c, b, own, run in zip(changed, base, slopes, runs, strict=True)
        ]
        own_departures = found.setdefault(unknown.name.split(".")[0], [])
        if not np.isnan(departures).all():
            # Where a shaft breaks away in one run, the others show whether there is a slope.
            own_departures.append(float(np.nanmedian(departures)))
    return [name for name, own in found.items() if not own or max(own) >= _LINEAR]


def _lack_of_fit(change: FloatArray, slope: FloatArray) -> float:
    """Relative lack of fit of the change predicted by a slope; NaN where both are zero."""
    error, size = (float(np.linalg.norm(np.nan_to_num(v))) for v in (change - slope, slope))
    if max(error, size) < 1.0:  # both are in units of the noise
        return math.nan
    return error / size if size > 0.0 else math.inf


def _one_by_test(runs: Sequence[Run]) -> tuple[Run, ...]:
    """A run from the middle of each of the first tests."""
    tests = list(dict.fromkeys(run.test for run in runs))[:_MOST_TESTS]
    members = [[run for run in runs if run.test == test] for test in tests]
    return tuple(own[len(own) // 2] for own in members)


def _simulated(problem: ProbedProblem, models: Sequence[Model]) -> list[list[FloatArray]]:
    """(3, n) by model and run: what the sensors show, in units of their noise."""
    from sysid.plant.simulator import simulate

    inputs = [run.inputs for run in problem.runs]
    every = [m for m in models for _ in inputs]
    found = iter(simulate(inputs * len(models), every))
    names = simulated_channels(problem.position)
    rows: list[list[FloatArray]] = []
    for model in models:
        rows.append([])
        for run in problem.runs:
            channels = measured_channels(next(found), problem.position, model, run.inputs.elapsed)
            rows[-1].append(np.array([channels[n] for n in names]) / run.noise[:, None])
    return rows


__all__ = ["Probes", "probes_of", "without_slope"]
