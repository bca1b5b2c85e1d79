"""Tests that could be run next, and what each and the campaign at hand say of the parameters."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.errors import input_error
from sysid.io.rig import Rig
from sysid.model.ports import Model
from sysid.refinement.bench_candidates import bench_candidates
from sysid.refinement.candidates import DURATION_S, CandidateMotion
from sysid.refinement.expected_errors import expected_errors
from sysid.refinement.information import ProbedProblem, information_of, prior_information
from sysid.refinement.probes import Probes, probes_of
from sysid.refinement.refine import SEGMENT_S
from sysid.refinement.runs import Run, runs_of
from sysid.refinement.unknowns import Unknown
from sysid.refinement.whitening import Whitening
from sysid.types import FloatArray
from sysid.validation.motion_tests import MotionTest, prepare

_SHORT_S = 5.0


@dataclass(frozen=True)
class AdviceSetting:
    """What all of the advice shares: the bundle's model, its unknowns, `noise` (3,) of a sample.

    `scatter` of sliding and static friction from test to test, relative. `whitening` by channel.
    `enlargement` of each unknown's standard error over its information (`ProbedProblem`).
    """

    rig: Rig
    model: Model
    unknowns: tuple[Unknown, ...]
    noise: FloatArray
    scatter: tuple[float, float]
    whitening: tuple[Whitening, ...] = ()
    enlargement: tuple[float, ...] = ()

    def errors_of(self, run: Run) -> tuple[Whitening, ...]:
        """What a run's errors are like, by channel: white noise, where nothing else is known."""
        return self.whitening or tuple(Whitening.white(float(n)) for n in run.noise)


@dataclass(frozen=True)
class RunsOfTests:
    """The campaign's motion tests and those that could be run, as runs of one problem.

    The first `logged` tests are the campaign's.
    """

    runs: tuple[Run, ...]
    logged: int
    motions: tuple[CandidateMotion, ...]

    def only(self, motions: Sequence[int]) -> RunsOfTests:
        """With some of the candidates alone, numbered anew."""
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
    """(3,) of a sample, rad or m and Pa: as the motion logs show it, else as the rig file says.

    Raises InputError where neither does.
    """
    shown = np.array([t.noise.total for t in tests])
    if len(shown) and np.isfinite(shown).any(axis=0).all():
        return np.asarray(np.nanmedian(shown, axis=0))
    sensors = rig.sensors
    counts = sensors.encoder_counts_per_m if rig.is_linear else sensors.encoder_counts_per_rev
    if counts is None or sensors.pressure_noise_pa is None:
        raise input_error(
            rig.source,
            "declares no noise of the sensors, and no motion log to fit on shows it",
            "add the encoder's counts and pressure_noise_pa under [sensors]",
        )
    step = (1.0 if rig.is_linear else 2.0 * math.pi) / counts
    return np.array([step / math.sqrt(12.0), *[sensors.pressure_noise_pa] * 2])


def runs_of_tests(
    logged: Sequence[MotionTest], motions: Sequence[CandidateMotion], setting: AdviceSetting
) -> RunsOfTests:
    """Runs of all tests; those that could be run are cut as if they had been logged."""
    rig, noise = setting.rig, setting.noise
    made = [
        prepare(m.trial(rig, noise, seed), m.kind, rig, SEGMENT_S) for seed, m in enumerate(motions)
    ]
    runs = [
        run if test < len(logged) else dataclasses.replace(run, noise=noise)
        for test, prepared in enumerate((*logged, *made))
        for run in runs_of(test, prepared, setting.model, rig.position_channel)
    ]
    return RunsOfTests(tuple(runs), len(logged), tuple(motions))


def problem_of(tests: RunsOfTests, probes: Probes, setting: AdviceSetting) -> ProbedProblem:
    """The tests' equations, with effects that the model lacks at zero beside its unknowns."""
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
    )


def information(problem: ProbedProblem, tests: RunsOfTests) -> tuple[FloatArray, list[Option]]:
    """Of the campaign with the bench tests (k, k), and each motion test that could be run."""
    now = prior_information(problem, len(problem.unknowns) + len(problem.sensors))
    if not tests.runs:
        return now, []
    found = problem.linearised(problem.first_point())
    for test in range(tests.logged):
        members = problem.members(test)
        if members:
            now = now + information_of(problem, [found[i] for i in members])
    options = []
    for number, motion in enumerate(tests.motions):
        members = problem.members(tests.logged + number)
        for length in (_SHORT_S, DURATION_S):
            ends = [problem.runs[i].inputs.elapsed + SEGMENT_S for i in members]
            own = [found[i] for i, end in zip(members, ends, strict=True) if end <= length]
            if own:
                said = information_of(problem, own)
                options.append(Option(motion.kind, motion.text, length, said, number))
    return now, options


def with_expected_errors(setting: AdviceSetting, logged: Sequence[MotionTest]) -> AdviceSetting:
    """The setting with errors as the logged tests show them; white noise without such tests."""
    tests = runs_of_tests(logged, [], setting)
    if not tests.runs:
        return setting
    problem = problem_of(tests, probes_of(setting.model, []), setting)
    found = expected_errors(dataclasses.replace(problem, robust=True))
    return dataclasses.replace(
        setting, whitening=found.whitening, enlargement=tuple(found.enlargement)
    )


def bench_options(problem: ProbedProblem, setting: AdviceSetting) -> list[Option]:
    """Logs of bench tests that could be made."""
    found = bench_candidates(problem, setting.rig, setting.noise)
    return [Option(b.kind, b.text, b.duration, b.information) for b in found]


__all__ = [
    "AdviceSetting",
    "Option",
    "RunsOfTests",
    "bench_options",
    "information",
    "noise_of",
    "problem_of",
    "runs_of_tests",
    "with_expected_errors",
]
