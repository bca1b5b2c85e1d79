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
from sysid.refinement.information import (
    ProbedProblem,
    covariance,
    information_of,
    log_volume,
)
from sysid.refinement.lengthening import joined_runs
from sysid.refinement.options import AdviceSetting
from sysid.refinement.played.limits import (
    CHECK_MARGIN,
    MARGIN,
    MotionLimits,
    inside,
)
from sysid.refinement.played.signals import Actuators, Drive, drawn_drives
from sysid.refinement.problem import Iterate
from sysid.refinement.refine import SEGMENT_S
from sysid.refinement.runs import runs_of
from sysid.types import FloatArray, Progress

# Drives drawn of each kind, and the size below which one that breaks a limit is given up.
_POOL, _SMALLEST = 100, 0.15
# Plants on which drives are tried before they are on all.
_STAGES = (1, 5)
# Rounds after which the worse half of the searches is given up, and those of the last one; what is
# tried in a round: neighbours of the best tests, and others.
_ROUNDS, _LAST_ROUNDS, _VARIED, _DRAWN = 5, 60, 64, 8
# The rounds that end a search: so many that together lower log(standard error) by less.
_PATIENCE, _WORTH = 6, 0.02
_SEED = 20


@dataclass(frozen=True)
class Aim:
    """What a test is for: `names`, their columns among the (k,) unknowns and probes."""

    names: tuple[str, ...]
    columns: tuple[int, ...]

    def log_std(self, information: FloatArray) -> FloatArray:
        """Mean over what is asked of log(standard error), of one, or of several as a volume.

        (...) of information (..., k, k).
        """
        return 0.5 * log_volume(information, self.columns) / len(self.columns)

    def std(self, information: FloatArray) -> FloatArray:
        """Standard errors of what is asked, in the unknowns' coordinates."""
        return np.sqrt(np.diag(covariance(information))[list(self.columns)])


@dataclass(frozen=True)
class DesignStage:
    """Where tests are designed: the setting, the plants they must be safe on, how many `pieces`.

    `problem` without runs gives unknowns and model; `plants` include the model; `fresh` are others,
    on which the best are checked, `last` those on which the result is.
    """

    setting: AdviceSetting
    problem: ProbedProblem
    rig: Actuators
    pieces: int
    limits: MotionLimits
    plants: Sequence[Model]
    fresh: Sequence[Model]
    last: Sequence[Model]


@dataclass(frozen=True, eq=False)
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

    @classmethod
    def of(cls, kind: str, pieces: Sequence[_Designed]) -> DesignedSet:
        """Those of the pieces."""
        total = np.sum([p.information for p in pieces], axis=0)
        return cls(kind, tuple(p.motion for p in pieces), total)


def designed(
    stages: Sequence[DesignStage], aim: Aim, now: FloatArray, progress: Progress
) -> DesignedSet:
    """The set of short tests that is best in addition to `now` (k, k), of one kind and one stage.

    All are searched for a while, the better half of them for as long again, and so on until one is
    left, which is searched until it gets no better. Raises NotIdentifiedError where the rig can
    play none within its limits.
    """
    searches = [
        _DesignSearch(stage, aim, now, kind)
        for stage, kind in itertools.product(stages, stages[0].rig.kinds)
    ]
    while len(searches) > 1:
        for search in searches:
            progress(f"designing tests: {search.text}")
            search.go_on(_ROUNDS)
        searches.sort(key=lambda s: s.log_std)
        searches = searches[: (len(searches) + 1) // 2]
    (search,) = searches
    progress(f"designing tests: {search.text}")
    search.go_on(_LAST_ROUNDS)
    found = search.checked()
    if found is None:
        raise NotIdentifiedError(
            "advise: no test of this rig stays within its limits on plants off the model; raise "
            "the limits (--max-speed, --max-effort), or shorten the test (--duration)"
        )
    return found


class _DesignSearch:
    """The search for the best set of tests of one kind at one stage."""

    def __init__(self, stage: DesignStage, aim: Aim, now: FloatArray, kind: str) -> None:
        self._stage, self._aim, self._now, self._kind = stage, aim, now, kind
        self._rng = np.random.default_rng([_SEED, stage.rig.kinds.index(kind)])
        choose = functools.partial(exchanged, now=now, count=stage.pieces, criterion=aim.log_std)
        self._pool = _Pool(stage, choose)
        self._nothing = self._mark = self.log_std = float(aim.log_std(now))
        self._idle, self._ended = 0, False
        self._pool.add(drawn_drives(kind, _POOL, stage.rig, self._rng))

    @property
    def text(self) -> str:
        """What is searched for, in words."""
        return f"{self._kind}, {self._stage.pieces} of {self._stage.rig.seconds:.2g} s"

    def go_on(self, rounds: int) -> None:
        """So many rounds more, fewer where the search ends."""
        for _ in range(rounds):
            if self._ended:
                return
            self._round()

    def _round(self) -> None:
        """Choose the best set, then vary its tests."""
        chosen = self._pool.chosen()
        if not chosen:
            self._ended = True
            return
        own = DesignedSet.of(self._kind, chosen)
        self.log_std = float(self._aim.log_std(self._now + own.information))
        self._idle += 1
        if self.log_std < self._mark - _WORTH:
            self._mark, self._idle = self.log_std, 0
        # Nothing that is drawn says anything, or varying it says no more.
        self._ended = self._mark == self._nothing or self._idle == _PATIENCE
        if self._ended:
            return
        rig, rng = self._stage.rig, self._rng
        drives = [p.drive for p in dict.fromkeys(chosen)]
        varied = [drives[i % len(drives)].changed(rng, rig) for i in range(_VARIED)]
        self._pool.add([*varied, *drawn_drives(self._kind, _DRAWN, rig, rng)])

    def checked(self) -> DesignedSet | None:
        """The set, checked on the last plants too."""
        self._pool.check_on(self._stage.last)
        chosen = self._pool.chosen()
        return DesignedSet.of(self._kind, chosen) if chosen else None


def exchanged(
    options: Sequence[FloatArray],
    now: FloatArray,
    count: int,
    criterion: Callable[[FloatArray], FloatArray],
) -> list[int]:
    """The numbers of `count` options (k, k), repeats allowed, that minimise a criterion of the sum.

    Greedy, then one is exchanged for another as long as that helps. `criterion` takes sums
    (options, k, k) and gives (options,).
    """
    if not options:
        return []
    all_ = np.array(options)
    kept: list[int] = []
    for _ in range(count):
        kept.append(int(np.argmin(criterion(now + all_[kept].sum(axis=0) + all_))))
    least = float(np.min(criterion(now + all_[kept].sum(axis=0))))
    while True:
        whole = now + all_[kept].sum(axis=0)
        # Of those that are kept more than once, one.
        places = [kept.index(i) for i in dict.fromkeys(kept)]
        tried = np.array([criterion(whole - all_[kept[place]] + all_) for place in places])
        row, best = np.unravel_index(np.argmin(tried), tried.shape)
        if tried[row, best] >= least - 1e-9:
            return sorted(kept)
        kept[places[row]], least = int(best), float(tried[row, best])


def _safe(stage: DesignStage, drives: Sequence[Drive]) -> list[Drive]:
    """The drives, each as large as is safe; those that never are, are dropped."""
    limits = stage.limits.scaled(MARGIN)
    open_, found = list(drives), []
    while open_:
        held = np.ones(len(open_), dtype=bool)
        # Most that leave the limits of all plants leave those of a few: these go first.
        for few in itertools.pairwise((0, *_STAGES, len(stage.plants))):
            likely = [d for d, ok in zip(open_, held, strict=True) if ok]
            held[held] = inside(likely, stage.rig, stage.plants[slice(*few)], limits, _SEED)
        found += [d for d, ok in zip(open_, held, strict=True) if ok]
        broken = [d for d, ok in zip(open_, held, strict=True) if not ok]
        open_ = [d.smaller() for d in broken if d.size > _SMALLEST]
    return found


class _Pool:
    """Safe short tests, of which a set is chosen."""

    def __init__(
        self, stage: DesignStage, choose: Callable[[Sequence[FloatArray]], list[int]]
    ) -> None:
        self._stage, self._choose = stage, choose
        self._pieces: list[_Designed] = []
        self._plants = stage.fresh
        self._checked: set[_Designed] = set()

    def check_on(self, plants: Sequence[Model]) -> None:
        """Have those that are chosen from now on checked on these plants too."""
        self._plants, self._checked = [*self._plants, *plants], set()

    def add(self, drives: Sequence[Drive]) -> None:
        """More of them, each as large as is safe."""
        self._pieces += _informed(self._stage, _safe(self._stage, drives))

    def chosen(self) -> list[_Designed]:
        """The chosen ones, all safe also on plants that they were not designed on.

        One that is not is replaced by a smaller one, and the choice made anew.
        """
        stage = self._stage
        limits = stage.limits.scaled(CHECK_MARGIN)
        while True:
            kept = [self._pieces[i] for i in self._choose([p.information for p in self._pieces])]
            tried = [p for p in dict.fromkeys(kept) if p not in self._checked]
            drives = [p.drive for p in tried]
            held = inside(drives, stage.rig, self._plants, limits, _SEED + 1, at_rest_too=True)
            self._checked.update(p for p, ok in zip(tried, held, strict=True) if ok)
            if held.all():
                return kept
            broken = [p for p, ok in zip(tried, held, strict=True) if not ok]
            self._pieces = [p for p in self._pieces if p not in broken]
            self.add([p.drive.smaller() for p in broken if p.drive.size > _SMALLEST])


def _informed(stage: DesignStage, drives: Sequence[Drive]) -> list[_Designed]:
    """The drives with the information that each test carries; those that move nothing dropped."""
    motions = _motions(stage, drives)
    rig, model = stage.setting.rig, stage.problem.model
    noise, position = stage.setting.noise, stage.setting.rig.position_channel
    tests = [
        prepare(m.trial(rig, noise, seed), m.kind, rig, SEGMENT_S, slowness=stage.setting.slowness)
        for seed, m in enumerate(motions)
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
        inputs_of_commands(d.kind, time, *c, rest + d.start)
        for d, c in zip(drives, commands, strict=True)
    ]
    names = simulated_channels(rig.position_channel)
    found = []
    for d, (motor, valves), run in zip(
        drives, commands, simulate(inputs, [model] * len(drives)), strict=True
    ):
        channels = measured_channels(run, rig.position_channel, model)
        shown = np.array([channels[n] for n in names])
        found.append(
            CandidateMotion(d.kind, said_of(d, stage), time, motor, valves, shown, d.start)
        )
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
