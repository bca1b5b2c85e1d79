"""The test that says most about what is asked, among those that the rig can safely play.

A pool of short tests is drawn, each as large as the limits allow on plants off the model; of these
the set is taken that minimises the criterion, by exchange (Fedorov 1972): for one parameter its
variance (c-optimal), for several the determinant of their covariance (D-optimal), with all other
parameters unknown. The tests of the set are then varied, and the exchange repeated.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.errors import NotIdentifiedError
from sysid.io.channels import simulated_channels
from sysid.plant.base import place_at_rest
from sysid.plant.ports import Model
from sysid.plant.sensors import measured_channels
from sysid.recording.motion_tests import prepare
from sysid.refinement.candidates import CandidateMotion, inputs_of_commands
from sysid.refinement.information import ProbedProblem, covariance, information_of
from sysid.refinement.lengthening import joined_runs
from sysid.refinement.options import AdviceSetting
from sysid.refinement.played.limits import (
    MARGIN,
    MotionLimits,
    inside,
)
from sysid.refinement.played.signals import Actuators, Drive, drawn_drives
from sysid.refinement.problem import Iterate
from sysid.refinement.refine import SEGMENT_S
from sysid.refinement.runs import runs_of
from sysid.types import FloatArray, Progress

# Drives drawn of each kind, and by how much those that break a limit are made smaller, how often.
_POOL, _SMALLER, _TIMES = 60, 0.75, 7
# Rounds in which the best tests are varied, and neighbours of each.
_ROUNDS, _NEIGHBOURS = 6, 8
_SEED = 20


@dataclass(frozen=True)
class Aim:
    """What a test is for: `names`, their columns among the (k,) unknowns and probes."""

    names: tuple[str, ...]
    columns: tuple[int, ...]

    def log_std(self, information: FloatArray) -> float:
        """Mean over what is asked of log(standard error), of one, or of several as a volume."""
        own = covariance(information)[np.ix_(self.columns, self.columns)]
        return 0.5 * float(np.linalg.slogdet(own)[1]) / len(self.columns)

    def std(self, information: FloatArray) -> FloatArray:
        """Standard errors of what is asked, in the unknowns' coordinates."""
        return np.sqrt(np.diag(covariance(information))[list(self.columns)])


@dataclass(frozen=True)
class DesignStage:
    """Where tests are designed: the setting, the plants they must be safe on, their lengths.

    `problem` without runs gives unknowns and model; `plants` include the model; `fresh` are others,
    on which the result is checked; `joined` as the refinement of the logs had its segments.
    """

    setting: AdviceSetting
    problem: ProbedProblem
    rig: Actuators
    limits: MotionLimits
    plants: Sequence[Model]
    fresh: Sequence[Model]


@dataclass(frozen=True)
class _Designed:
    """A short test that is safe, and its information (k, k)."""

    drive: Drive
    motion: CandidateMotion
    information: FloatArray


@dataclass(frozen=True)
class DesignedSet:
    """The short tests of one kind, one after the other, and their information together."""

    kind: str
    motions: tuple[CandidateMotion, ...]
    information: FloatArray


def designed(
    stage: DesignStage, aim: Aim, now: FloatArray, pieces: int, progress: Progress
) -> DesignedSet:
    """The set of `pieces` short tests that is best in addition to `now` (k, k).

    Raises NotIdentifiedError where the rig can play none within its limits.
    """
    best: DesignedSet | None = None
    for kind in stage.rig.kinds:
        progress(f"designing tests: {kind}")
        found = _of_kind(stage, aim, now, pieces, kind)
        if found is not None and (
            best is None
            or aim.log_std(now + found.information) < aim.log_std(now + best.information)
        ):
            best = found
    if best is None:
        raise NotIdentifiedError(
            "advise: no test of this rig stays within its limits on plants off the model; raise "
            "the limits (--max-speed, --max-effort), or shorten the test (--duration)"
        )
    return best


def _of_kind(
    stage: DesignStage, aim: Aim, now: FloatArray, count: int, kind: str
) -> DesignedSet | None:
    rng = np.random.default_rng([_SEED, stage.rig.kinds.index(kind)])
    pool = _informed(stage, _safe(stage, drawn_drives(kind, _POOL, stage.rig, rng)))
    if not pool:
        return None
    kept = exchanged([p.information for p in pool], now, count, aim.log_std)
    for _ in range(_ROUNDS):
        chosen = [pool[i] for i in dict.fromkeys(kept)]
        near = [p.drive.changed(rng, stage.rig) for p in chosen for _ in range(_NEIGHBOURS)]
        pool = [*pool, *_informed(stage, _safe(stage, near))]
        kept = exchanged([p.information for p in pool], now, count, aim.log_std)
    chosen = _checked(
        stage, pool, kept, functools.partial(exchanged, now=now, count=count, criterion=aim.log_std)
    )
    if not chosen:
        return None
    total = sum((piece.information for piece in chosen), np.zeros_like(now))
    return DesignedSet(kind, tuple(piece.motion for piece in chosen), total)


def exchanged(
    options: Sequence[FloatArray],
    now: FloatArray,
    count: int,
    criterion: Callable[[FloatArray], float],
) -> list[int]:
    """The numbers of `count` options (k, k), repeats allowed, that minimise a criterion of the sum.

    Greedy, then one is exchanged for another as long as that helps.
    """
    if not options:
        return []
    kept: list[int] = []
    for _ in range(count):
        here = now + sum((options[i] for i in kept), np.zeros_like(now))
        kept.append(min(range(len(options)), key=lambda i, h=here: criterion(h + options[i])))  # type: ignore[misc]
    while True:
        whole = now + sum((options[i] for i in kept), np.zeros_like(now))
        tried = [
            (criterion(whole - options[kept[place]] + options[i]), place, i)
            for place, i in itertools.product(range(count), range(len(options)))
        ]
        least, place, i = min(tried)
        if least >= criterion(whole) - 1e-9:
            return sorted(kept)
        kept[place] = i


def _safe(stage: DesignStage, drives: Sequence[Drive]) -> list[Drive]:
    """The drives, each as large as is safe; those that never are, are dropped."""
    limits = stage.limits.scaled(MARGIN)
    open_, found = list(drives), []
    for _ in range(_TIMES):
        # Few leave the model's limits and stay within those of all plants: the model goes first.
        held = inside(open_, stage.rig, stage.plants[:1], limits, _SEED)
        likely = [d for d, ok in zip(open_, held, strict=True) if ok]
        held[held] = inside(likely, stage.rig, stage.plants, limits, _SEED)
        found += [d for d, ok in zip(open_, held, strict=True) if ok]
        broken = [d for d, ok in zip(open_, held, strict=True) if not ok]
        open_ = [dataclasses.replace(d, size=_SMALLER * d.size) for d in broken]
        if not open_:
            break
    return found


def _checked(
    stage: DesignStage,
    pool: list[_Designed],
    kept: list[int],
    choose: Callable[[list[FloatArray]], list[int]],
) -> list[_Designed]:
    """The chosen pieces of a pool, all safe on plants that they were not designed on.

    One that is not is replaced in the pool by a smaller one, and the choice made anew.
    """
    safe: set[Drive] = set()
    while kept:
        tried = [pool[i] for i in dict.fromkeys(kept) if pool[i].drive not in safe]
        drives = [p.drive for p in tried]
        held = inside(drives, stage.rig, stage.fresh, stage.limits, _SEED + 1, at_rest_too=True)
        safe |= {p.drive for p, ok in zip(tried, held, strict=True) if ok}
        if held.all():
            return [pool[i] for i in kept]
        broken = {p.drive for p, ok in zip(tried, held, strict=True) if not ok}
        smaller = [dataclasses.replace(d, size=_SMALLER * d.size) for d in broken]
        pool = [p for p in pool if p.drive not in broken]
        pool += _informed(stage, [d for d in smaller if d.size > _SMALLER**_TIMES])
        kept = choose([p.information for p in pool])
    return []


def _informed(stage: DesignStage, drives: Sequence[Drive]) -> list[_Designed]:
    """The drives with the information that each test carries; those that move nothing dropped."""
    motions = _motions(stage, drives)
    rig, model = stage.setting.rig, stage.problem.model
    noise, position = stage.setting.noise, stage.setting.rig.position_channel
    tests = [
        prepare(m.trial(rig, noise, seed), m.kind, rig, SEGMENT_S) for seed, m in enumerate(motions)
    ]
    runs = [r for i, test in enumerate(tests) for r in runs_of(i, test, model, position)]
    refined = stage.setting.refined
    # Without logs that show it, whole tests are taken to be followed.
    runs = joined_runs(runs, tests, 0 if refined is None else refined.joined, model, position)
    runs = [dataclasses.replace(run, noise=noise) for run in runs]
    if not runs:
        return []
    problem = dataclasses.replace(
        stage.problem,
        runs=tuple(runs),
        whitening=tuple(stage.setting.errors_of(run) for run in runs),
        tests=len(tests),
    )
    found = problem.linearised(_point(problem, stage))
    said = [
        information_of(problem, [found[i] for i in problem.members(number)])
        for number in range(len(tests))
    ]
    return [
        _Designed(d, m, own)
        for d, m, own in zip(drives, motions, said, strict=True)
        if np.isfinite(own).all() and own.any()
    ]


def _point(problem: ProbedProblem, stage: DesignStage) -> Iterate:
    """Where the logs' refinement ended, or the bundle's own values."""
    first, refined = problem.first_point(), stage.setting.refined
    if refined is None:
        return first
    shared, friction = np.array(first.shared), np.array(first.friction)
    own = refined.solution.point.shared
    shared[: len(own)] = own
    if problem.static_number is not None:
        friction[:, 1] = shared[problem.static_number] / problem.scatter[1]
    return dataclasses.replace(first, shared=shared, friction=friction)


def _motions(stage: DesignStage, drives: Sequence[Drive]) -> list[CandidateMotion]:
    """What the model's sensors show under each drive, without noise."""
    from sysid.plant.simulator import simulate

    rig, model, time = stage.setting.rig, stage.setting.model, stage.rig.time
    commands = [d.commands(stage.rig) for d in drives]
    rest = place_at_rest(model.parameters)
    inputs = [
        inputs_of_commands(d.kind, time, *c, rest) for d, c in zip(drives, commands, strict=True)
    ]
    names = simulated_channels(rig.position_channel)
    found = []
    for d, (motor, valves), run in zip(
        drives, commands, simulate(inputs, [model] * len(drives)), strict=True
    ):
        channels = measured_channels(run, rig.position_channel, model)
        shown = np.array([channels[n] for n in names])
        found.append(CandidateMotion(d.kind, said_of(d, stage), time, motor, valves, shown))
    return found


def said_of(drive: Drive, stage: DesignStage) -> str:
    """A drive in words."""
    parts = []
    motor, valves = drive.commands(stage.rig)
    if valves is not None and drive.kind == "motion-pwm":
        parts.append(f"duties to {valves.max():.2g}")
    elif valves is not None:
        parts.append(f"{int((np.diff(valves, axis=1) > 0).sum())} pulses")
    if motor.any():
        parts.append(f"motor to {np.abs(motor).max():.2g} {stage.setting.rig.units.effort}")
    return ", ".join(parts) or "nothing commanded"


__all__ = ["Aim", "DesignStage", "DesignedSet", "designed", "exchanged", "said_of"]
