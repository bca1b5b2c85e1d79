"""Tests that could be run next, and the information of each and of the present campaign."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sysid.errors import input_error
from sysid.estimation.autoregression import Autoregression
from sysid.io.rig import Rig
from sysid.plant.ports import Model
from sysid.recording.motion_tests import MotionTest, prepare, slowness_of
from sysid.refinement.bench_candidates import bench_candidates
from sysid.refinement.candidates import CandidateMotion
from sysid.refinement.estimation import Estimated
from sysid.refinement.information import ProbedProblem, information_of, prior_information
from sysid.refinement.lengthening import joined_runs
from sysid.refinement.probes import Probes
from sysid.refinement.problem import Iterate, Problem
from sysid.refinement.refine import SEGMENT_S
from sysid.refinement.runs import Run, runs_of
from sysid.refinement.unknowns import Unknown
from sysid.types import FloatArray


@dataclass(frozen=True)
class AdviceSetting:
    """The common setting of all advice: the bundle's model, its unknowns, `noise` (3,) of a sample.

    `scatter` of sliding and static friction from test to test, relative. `refined`: the estimate
    from the campaign's motion logs, None without any. `has_motor`: tests may drive a motor.
    """

    rig: Rig
    model: Model
    unknowns: tuple[Unknown, ...]
    noise: FloatArray
    scatter: tuple[float, float]
    has_motor: bool = True
    refined: Estimated | None = None

    def errors_of(self, run: Run) -> tuple[Autoregression, ...]:
        """The noise model of a run's channels: white noise where nothing else is known."""
        if self.refined is None:
            return tuple(Autoregression.white(float(n) ** 2) for n in run.noise)
        return self.refined.problem.whitening[0]

    @cached_property
    def slowness(self) -> float:
        """As of `slowness_of`."""
        return slowness_of(self.rig, self.model)

    @property
    def enlargement(self) -> tuple[float, ...]:
        """Enlargement of each unknown's standard error over its information (`ProbedProblem`)."""
        found = None if self.refined is None else self.refined.enlargement()
        return () if found is None else tuple(found[: len(self.unknowns)].tolist())


@dataclass(frozen=True)
class RunsOfTests:
    """The campaign's motion tests and those that could be run, as runs of one problem.

    The first `logged` tests are the campaign's.
    """

    runs: tuple[Run, ...]
    logged: int
    motions: tuple[CandidateMotion, ...]

    def only(self, motions: Sequence[int]) -> RunsOfTests:
        """The runs with some of the candidates alone, renumbered."""
        kept = [*range(self.logged), *(self.logged + i for i in motions)]
        place = {test: i for i, test in enumerate(kept)}
        runs = tuple(
            dataclasses.replace(r, test=place[r.test]) for r in self.runs if r.test in place
        )
        return RunsOfTests(runs, self.logged, tuple(self.motions[i] for i in motions))


@dataclass(frozen=True)
class Option:
    """A test that could be run and its information (k, k); `motion` its number, None on a bench."""

    kind: str
    text: str
    duration: float
    information: FloatArray
    motion: int | None = None


def noise_of(tests: Sequence[MotionTest], rig: Rig) -> FloatArray:
    """Noise (3,) of a sample, rad or m and Pa: as the motion logs show it, else the rig file's.

    Raises InputError where neither does.
    """
    own = 1 + len(rig.pressure_channels)
    shown = np.array([t.noise.total[:own] for t in tests])
    if len(shown) and np.isfinite(shown).any(axis=0).all():
        found = np.nanmedian(shown, axis=0)
        # A chamber that there is not shows nothing, and a sensor of it would be the other's.
        return np.append(found, [found[-1]] * (3 - own))
    sensors, step = rig.sensors, rig.encoder_step
    if step is None or sensors.pressure_noise_pa is None:
        raise input_error(
            rig.source,
            "declares no noise of the sensors, and no training motion log shows it",
            "add the encoder's counts and pressure_noise_pa under [sensors]",
        )
    return np.array([step / math.sqrt(12.0), *[sensors.pressure_noise_pa] * 2])


def runs_of_tests(
    setting: AdviceSetting, motions: Sequence[CandidateMotion], *, count_logs: bool
) -> RunsOfTests:
    """Runs of the refined logs and of tests that could be run, each of those after a short and
    its whole time; as long as the logs' refinement has them.
    """
    rig, noise, found = setting.rig, setting.noise, setting.refined
    first = found.problem.tests if found is not None and count_logs else 0
    runs = list(found.problem.runs) if found is not None and first else []
    every = [m.first(share * m.duration) for m in motions for share in (0.5, 1.0)]
    made = [
        prepare(m.trial(rig, noise, seed), m.kind, rig, SEGMENT_S, slowness=setting.slowness)
        for seed, m in enumerate(every)
    ]
    model, position = setting.model, rig.position_channel
    own = [r for i, test in enumerate(made) for r in runs_of(i, test, model, position)]
    own = joined_runs(own, made, 1 if found is None else found.joined, model, position)
    runs += [dataclasses.replace(run, test=first + run.test, noise=noise) for run in own]
    return RunsOfTests(tuple(runs), first, tuple(every))


def plain_problem(runs: Sequence[Run], tests: int, setting: AdviceSetting) -> Problem:
    """Runs of tests as a refinement begins with them: the sensors' noise."""
    return Problem(
        runs=tuple(runs),
        unknowns=setting.unknowns,
        model=setting.model,
        position=setting.rig.position_channel,
        whitening=tuple(setting.errors_of(run) for run in runs),
        scatter=setting.scatter,
        tests=tests,
    )


def problem_of(
    tests: RunsOfTests, probes: Probes, setting: AdviceSetting, *, by_differences: bool = False
) -> ProbedProblem:
    """The tests' equations, with effects that the model lacks, at zero, as further unknowns.

    `by_differences` as in `Problem`.
    """
    return ProbedProblem(
        runs=tests.runs,
        unknowns=(*setting.unknowns, *probes.unknowns),
        model=probes.model,
        position=setting.rig.position_channel,
        whitening=tuple(setting.errors_of(run) for run in tests.runs),
        scatter=setting.scatter,
        tests=tests.logged + len(tests.motions),
        robust=False,
        sensors=probes.sensors,
        enlargement=setting.enlargement,
        by_differences=by_differences,
    )


def point_of(problem: ProbedProblem, tests: RunsOfTests, setting: AdviceSetting) -> Iterate:
    """Where the logs' refinement ended; a test that could be run has the model's friction."""
    first, found = problem.first_point(), setting.refined
    if found is None:
        return first
    point = found.solution.point
    shared, friction, starts = np.array(first.shared), np.array(first.friction), first.starts
    shared[: len(point.shared)] = point.shared
    if problem.static_number is not None:
        friction[:, 1] = shared[problem.static_number] / problem.scatter[1]
    if tests.logged:
        friction[: tests.logged] = point.friction
        starts = np.concatenate([point.starts, starts[len(point.starts) :]])
    return Iterate(shared, friction, starts)


def information(
    problem: ProbedProblem, tests: RunsOfTests, setting: AdviceSetting
) -> tuple[FloatArray, list[Option]]:
    """Information (k, k) of the campaign with its bench tests, and of each candidate."""
    now = prior_information(problem, len(problem.unknowns) + len(problem.sensors))
    if not tests.runs:
        return now, []
    found = problem.linearised(point_of(problem, tests, setting))

    def said(test: int) -> FloatArray:
        return information_of(problem, [found[i] for i in problem.members(test)])

    for test in range(tests.logged):
        now = now + said(test)
    options = [
        Option(m.kind, m.text, m.duration, said(tests.logged + number), number)
        for number, m in enumerate(tests.motions)
        if problem.members(tests.logged + number)
    ]
    return now, options


def motion_information(
    problem: ProbedProblem, now: FloatArray, options: Sequence[Option]
) -> FloatArray:
    """Information (k, k) of all motion tests, those of the campaign and those that could be run."""
    found = now - prior_information(problem, len(now))
    for option in options:
        found = found + (option.information if option.motion is not None else 0.0)
    return found


def bench_options(problem: ProbedProblem, setting: AdviceSetting) -> list[Option]:
    """Logs of bench tests that could be made."""
    found = bench_candidates(problem, setting.rig, setting.noise, setting.has_motor)
    return [Option(b.kind, b.text, b.duration, b.information) for b in found]


__all__ = [
    "AdviceSetting",
    "Option",
    "RunsOfTests",
    "bench_options",
    "information",
    "noise_of",
    "plain_problem",
    "point_of",
    "problem_of",
    "runs_of_tests",
]
