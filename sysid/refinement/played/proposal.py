"""A test to play for what is asked: aim, limits and plants put together, designed and checked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.errors import NotIdentifiedError, input_error
from sysid.plant.effects.catalogue import catalogue as own_catalogue
from sysid.plant.effects.entry import Catalogue
from sysid.plant.effects.linear import possible_on
from sysid.plant.ports import Model
from sysid.refinement.advice import Beginning
from sysid.refinement.candidates import MOST_STATIC, TRAVEL_USED, row_period, usual_duration
from sysid.refinement.information import ProbedProblem
from sysid.refinement.options import RunsOfTests, information, problem_of, runs_of_tests
from sysid.refinement.played.design import Aim, DesignedSet, DesignStage, designed
from sysid.refinement.played.limits import MARGIN, MotionLimits, extremes, held_reach, off_plants
from sysid.refinement.played.result import Expected, PlayedTest, Reached
from sysid.refinement.played.signals import Actuators
from sysid.refinement.probes import Probes, probes_of
from sysid.refinement.refine import SEGMENT_S
from sysid.refinement.unknowns import numbers_of
from sysid.types import FloatArray, Progress, no_progress

# A short test is cut as a refinement cuts motion: into a segment, which may start a little later.
_PIECE_S = 1.25 * SEGMENT_S
# Open loop, a plant off the model drifts: of shorter tests, so many as many, each may do more.
_TIMES_AS_MANY = 2
# Plants on which a test is designed, others on which the best are checked as the search goes, and
# those on which the result is.
_TRIED, _FRESH, _LAST = 24, 64, 512
# Of the motor's limit; the rest is for the controller that plays the test.
_EFFORT_USED = 0.95


@dataclass(frozen=True)
class PlayRequest:
    """`asked`: names of parameters or effects (none: all parameters); `duration` s of all tests,
    None: as long as a test usually takes on the rig.

    `speed` rad/s or m/s and `effort` Nm or N: what may not be exceeded; None: the fastest motion
    of the logs, the rig file's limit of the motor.
    """

    asked: tuple[str, ...] = ()
    duration: float | None = None
    speed: float | None = None
    effort: float | None = None


def played_test(
    began: Beginning,
    request: PlayRequest,
    catalogue: Catalogue | None = None,
    progress: Progress = no_progress,
) -> PlayedTest:
    """The test that says most about what is asked, and is safe to play.

    Raises InputError for an unknown name or a duration that is too short, NotIdentifiedError
    where nothing that the rig can safely do says anything about it.
    """
    setting, rig = began.setting, began.setting.rig
    rig.require("cylinder", "whose stroke limits a motion test")
    piece_s = _PIECE_S * setting.slowness
    duration = request.duration or usual_duration(setting.slowness)
    pieces = int(duration / piece_s + 1e-9)
    if pieces < 1:
        raise input_error(
            "--duration", f"{duration:g} s is too short", f"give at least {piece_s:.3g} s"
        )
    probes, aim = aimed(began, request.asked, catalogue)
    problem, now = _known(began, probes)
    row = row_period(rig)
    limits = _limits(began, request)
    effort = _largest_effort(began, limits)
    off = off_plants(began.bundle, rig, setting.model, _TRIED + _FRESH + _LAST, _SEED)
    plants = [setting.model, *off[:_TRIED]]
    fresh, last = off[_TRIED:-_LAST], off[-_LAST:]
    reach = held_reach(off, limits.scaled(MARGIN))
    stages = []
    for number in (pieces, _TIMES_AS_MANY * pieces):
        actuators = Actuators.of(rig, row, duration / number, effort, reach)
        stages.append(DesignStage(setting, problem, actuators, number, limits, plants, fresh, last))
    found = designed(stages, aim, now, progress)
    expected = _expected(aim, problem, now, found)
    if not any(e.after < e.now for e in expected):
        raise NotIdentifiedError(
            f"advise: no test that this rig can safely play says anything about "
            f"{', '.join(aim.names)}; ask for other parameters"
        )
    reached = _reached(found, off[_TRIED:])
    notices = began.notices if math.isfinite(limits.speed) else (*began.notices, _NO_SPEED)
    return PlayedTest(
        rig, found.kind, found.motions, expected, limits, reached, len(off) - _TRIED, notices
    )


_SEED = 8
_NO_SPEED = (
    "no training motion log shows how fast the rig may move: the test's speed is not limited; "
    "give --max-speed"
)


def aimed(
    began: Beginning, asked: Sequence[str], catalogue: Catalogue | None
) -> tuple[Probes, Aim]:
    """The effects that are asked for as probes, and the columns of all that is asked."""
    setting = began.setting
    known = possible_on(own_catalogue() if catalogue is None else catalogue, setting.rig)
    held = {entry.id for entry in began.bundle.effects}
    effects = [name for name in asked if name in known and name not in held]
    probes = probes_of(setting.model, [known[name] for name in effects])
    own = numbers_of(setting.unknowns, [n for n in asked if n not in effects])
    if not asked:
        own = list(range(len(setting.unknowns)))
    p = len(setting.unknowns)
    places = probes.places()
    columns = [*own, *(p + at for name in effects for at in places[name])]
    names = [setting.unknowns[i].name for i in own]
    names += [f"{e}.{q.label}" for e in effects for q in known[e].strengths()]
    return probes, Aim(tuple(names), tuple(columns))


def _known(began: Beginning, probes: Probes) -> tuple[ProbedProblem, FloatArray]:
    """The problem with the probes, and the campaign's information (k, k)."""
    tests = runs_of_tests(began.setting, (), count_logs=began.counts_logs)
    problem = problem_of(tests, probes, began.setting)
    now, _ = information(problem, RunsOfTests(tests.runs, tests.logged, ()), began.setting)
    return problem, now


def _limits(began: Beginning, request: PlayRequest) -> MotionLimits:
    rig = began.setting.rig
    fastest = max((test.highest_speed for test in began.logged), default=math.inf)
    speed = request.speed or fastest
    effort = request.effort or _EFFORT_USED * (rig.max_effort or math.inf)
    return MotionLimits(TRAVEL_USED * 0.5 * float(rig.travel or 0.0), speed, effort)


def _largest_effort(began: Beginning, limits: MotionLimits) -> float:
    """The motor's largest command: its limit, else so many times static friction; 0 without one."""
    rig = began.setting.rig
    if rig.motor is None:
        return 0.0
    static = float(began.setting.model.parameters.static_effort)
    return min(limits.effort, MOST_STATIC * static)


def _expected(
    aim: Aim, problem: ProbedProblem, now: FloatArray, found: DesignedSet
) -> tuple[Expected, ...]:
    pairs = zip(aim.std(now), aim.std(now + found.information), strict=True)
    known = [(u.unit, abs(u.slope(u.start)), u.value) for u in problem.unknowns]
    known += [("", probe.typical, 0.0) for probe in problem.sensors]
    return tuple(
        Expected(name, known[at][2], known[at][0], known[at][1] * before, known[at][1] * after)
        for name, at, (before, after) in zip(aim.names, aim.columns, pairs, strict=True)
    )


def _reached(found: DesignedSet, plants: Sequence[Model]) -> Reached:
    far, fast = extremes(found.motions, plants)
    return Reached(far, fast, max(float(np.abs(m.motor).max()) for m in found.motions))


__all__ = ["PlayRequest", "aimed", "played_test"]
