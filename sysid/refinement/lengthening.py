"""Longer segments, then whole tests, where the model follows them: the last step of a refinement.

A longer run carries more information on slow effects, and is what a user simulates; but the model's
error accumulates in it. So the data decide: segments are joined, finally to whole tests (single
shooting). Runs that the model does not follow stay separate, and the longer runs are accepted if
the estimation converges, no parameter moves by more than its standard error allows (Hausman 1978:
a correct model gives the same estimates at both lengths), and whole tests are simulated at most 2 %
worse.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Container, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.errors import OutOfBudgetError
from sysid.estimation.quality import DISAGREE
from sysid.plant.ports import Model
from sysid.recording.motion_tests import MotionTest, Segment
from sysid.refinement.estimation import (
    CLOSELY,
    UNDAMPED,
    Estimated,
    followed,
    whitening_of,
)
from sysid.refinement.problem import Iterate, Problem
from sysid.refinement.reduction import NO_INFORMATION
from sysid.refinement.runs import Run, run_of
from sysid.refinement.solver import Solution, solve
from sysid.refinement.unknowns import model_at
from sysid.refinement.whole_tests import times_worse, whole_residuals
from sysid.types import BoolArray, FloatArray, Progress, no_progress

# Whole tests may be simulated this many times worse (geometric mean over the channels).
_WORSE = 1.02
# A neighbour starts at most this share of a segment's length after the end of the one before, so
# that runs are not joined across a segment that was excluded.
_GAP = 0.5
# Number of segments that are joined; 0: all of a test, from its first row.
_JOINED = (3, 0)


@dataclass(frozen=True)
class _Piece:
    """Rows of a test as one run, and the present runs (numbers) that lie in it."""

    test: int
    segment: Segment
    members: tuple[int, ...]

    @property
    def key(self) -> tuple[int, int, int]:
        return self.test, self.segment.start, self.segment.stop


def lengthened(
    found: Estimated, tests: Sequence[MotionTest], progress: Progress = no_progress
) -> Estimated:
    """The estimate from the longest runs of these tests that the data allow."""
    before = _residuals(found, tests)
    for joined in _JOINED:
        progress(f"{joined} segments as one" if joined else "whole tests")
        try:
            longer = _longer(found, tests, joined)
        except OutOfBudgetError:  # the estimate of the shorter runs is complete
            return dataclasses.replace(found, cut_short=True)
        if longer is None:
            break
        after = _residuals(longer, tests)
        if times_worse(before, after) > _WORSE:
            break
        found, before = longer, after
    return found


def joined_runs(
    runs: Sequence[Run], tests: Sequence[MotionTest], joined: int, model: Model, position: str
) -> list[Run]:
    """Runs of tests, so many of them as one; 0: all of a test."""
    if joined == 1:
        return list(runs)
    pieces = _pieces(runs, tests, joined, ())
    return [_run_of(piece, runs, tests, model, position) for piece in pieces]


def _residuals(found: Estimated, tests: Sequence[MotionTest]) -> list[FloatArray]:
    """Of whole tests (3, n) at an estimate; NaN of one that is not simulated."""
    problem, shared = found.problem, found.solution.point.shared
    values = [u.at(float(c)) for u, c in zip(problem.unknowns, shared, strict=True)]
    model = model_at(problem.model, problem.unknowns, np.array(values))
    return whole_residuals(tests, model, problem.position)


def _longer(found: Estimated, tests: Sequence[MotionTest], joined: int) -> Estimated | None:
    """The estimate from joined segments; None where the data reject it."""
    apart: set[tuple[int, int, int]] = set()
    # Runs that the model does not follow in one stay as they were, and the others are tried again.
    for _ in range(4):
        pieces = _pieces(found.problem.runs, tests, joined, apart)
        if len(pieces) == len(found.problem.runs):
            return None
        problem, point = _problem_of(found, tests, pieces)
        broken = _broken(pieces, _follows_at_once(problem, point))
        if not broken:
            problem, solution = _solved(problem, point)
            left = solution.at.residuals
            follows = solution.counted & followed(problem, left, solution.counted)
            broken = _broken(pieces, follows)
            if not broken:
                return _accepted(found, problem, solution, joined)
        apart |= broken
    return None


def _broken(pieces: Sequence[_Piece], follows: BoolArray) -> set[tuple[int, int, int]]:
    """The joined pieces that the model does not follow."""
    pairs = zip(pieces, follows, strict=True)
    return {piece.key for piece, f in pairs if not f and len(piece.members) > 1}


def _accepted(
    found: Estimated, problem: Problem, solution: Solution, joined: int
) -> Estimated | None:
    """The longer runs' estimate if it converged and does not contradict the shorter runs'."""
    p = len(problem.unknowns)
    std = np.sqrt(np.diag(found.error_covariance())[:p])
    change = np.abs(solution.point.shared - found.solution.point.shared)
    known = std > NO_INFORMATION
    if not solution.converged or np.any(change[known] > DISAGREE * std[known]):
        return None
    evaluations = found.evaluations + solution.evaluations + 1
    return dataclasses.replace(
        found,
        problem=problem,
        solution=solution,
        evaluations=evaluations,
        shorter=found.shorter or (found if found.solution.converged else None),
        joined=joined,
    )


def _follows_at_once(problem: Problem, point: Iterate) -> BoolArray:
    """Whether the model follows each run from the point."""
    return followed(problem, problem.residuals(point), np.ones(len(problem.runs), dtype=bool))


def _solved(problem: Problem, point: Iterate) -> tuple[Problem, Solution]:
    """Solved with the shorter runs' whitening, then, if converged, with its own."""
    # Where the model follows the longer runs two or three evaluations do: they begin near the end.
    near = functools.partial(solve, most=6, near=CLOSELY, first_step=UNDAMPED, chords=True)
    first = near(problem, point)
    if not first.converged:
        return problem, first
    white = whitening_of(problem.runs, first.at.residuals)
    problem = dataclasses.replace(problem, whitening=(white,) * len(problem.runs))
    second = near(problem, first.point, known=first.at.runs)
    evaluations = first.evaluations + second.evaluations
    return problem, dataclasses.replace(second, evaluations=evaluations)


def _problem_of(
    found: Estimated, tests: Sequence[MotionTest], pieces: Sequence[_Piece]
) -> tuple[Problem, Iterate]:
    """The problem of these runs and its point: each starts as its first member did."""
    old, point = found.problem, found.solution.point
    starts = np.array([point.starts[piece.members[0]] for piece in pieces])
    runs = [_run_of(piece, old.runs, tests, old.model, old.position) for piece in pieces]
    for i, (piece, run) in enumerate(zip(pieces, runs, strict=True)):
        if run.inputs.elapsed < old.runs[piece.members[0]].inputs.elapsed:
            starts[i] = 0.0  # the test's first row: a different start
    longer = dataclasses.replace(old, runs=tuple(runs), whitening=(old.whitening[0],) * len(runs))
    start = Iterate(point.shared, point.friction, starts)
    return longer.after_run_ups(start), start


def _run_of(
    piece: _Piece, runs: Sequence[Run], tests: Sequence[MotionTest], model: Model, position: str
) -> Run:
    if len(piece.members) == 1:
        return runs[piece.members[0]]
    return run_of(piece.test, tests[piece.test], piece.segment, model, position)


def _pieces(
    runs: Sequence[Run],
    tests: Sequence[MotionTest],
    joined: int,
    apart: Container[tuple[int, int, int]],
) -> list[_Piece]:
    """The present runs, neighbours as one but where that is in `apart`."""
    found = []
    for number, test in enumerate(tests):
        rows = min((s.stop - s.start for s in test.segments), default=0)
        for group in _neighbours(_present(runs, number, test), joined, _GAP * rows):
            piece = _as_one(group, test, whole=not joined)
            found += group if piece.key in apart else [piece]
    return found


def _present(runs: Sequence[Run], number: int, test: MotionTest) -> list[_Piece]:
    """A test's runs in the order of time."""
    found = []
    for i, run in enumerate(runs):
        if run.test != number:
            continue
        start = int(np.argmin(np.abs(test.since_start - run.inputs.elapsed)))
        same = [s for s in (*test.segments, test.whole) if s.start == start]
        segment = dataclasses.replace(same[0], stop=start + len(run.inputs.time))
        found.append(_Piece(number, segment, (i,)))
    return sorted(found, key=lambda piece: piece.segment.start)


def _neighbours(pieces: Sequence[_Piece], joined: int, gap: float) -> list[list[_Piece]]:
    """Pieces that follow one another within `gap` rows, up to `joined` of them; 0: all."""
    groups: list[list[_Piece]] = []
    for piece in pieces:
        last = groups[-1][-1].segment if groups else None
        near = last and piece.segment.start - last.stop < gap
        if near and not (joined and len(groups[-1]) == joined):
            groups[-1].append(piece)
        else:
            groups.append([piece])
    return groups


def _as_one(group: Sequence[_Piece], test: MotionTest, *, whole: bool) -> _Piece:
    """A group as one piece; with `whole` all of the test, where it is all that was cut of it."""
    first, last = group[0].segment, group[-1].segment
    segment = dataclasses.replace(first, stop=last.stop)
    cut = [s for s in test.segments if s.settled]
    if whole and cut and first.start == cut[0].start and last.stop > cut[-1].start:
        segment = test.whole
    return _Piece(group[0].test, segment, tuple(m for piece in group for m in piece.members))


__all__ = ["joined_runs", "lengthened"]
