"""The tables of a block of runs, a piece of the runs at a time: the host's side of `lanes`."""

from __future__ import annotations

import functools
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from sysid.plant.lanes import EventTable, SwitchedTable, Table
from sysid.plant.preparation import PreparedRun, SwitchedRun
from sysid.plant.valve_timing import TIME_TOLERANCE
from sysid.types import FloatArray, IntArray

Timing = tuple[FloatArray, ...]
"""What moves with the delays of a run's valves: s, or s per unit of what moves it."""

# Bytes at whose multiples XLA's arrays begin.
_ALIGNED = 64


class Block(ABC):
    """Prepared runs, padded to `width` with idle ones, in pieces of `rows` rows or sub-steps."""

    def __init__(self, runs: Sequence[Any], width: int, rows: int) -> None:
        self.runs, self.width, self.rows = runs, width, rows

    def tables(self) -> Iterator[tuple[int, Table]]:
        """Every piece's first row or sub-step, and its table, which is good until the next."""
        for start in range(0, max(len(run) for run in self.runs), self.rows):
            yield start, self.table(start)

    @abstractmethod
    def table(self, start: int) -> Table:
        """The piece from a row or sub-step on."""

    @abstractmethod
    def timing_slopes(self, start: int, moved: Sequence[dict[int, Timing]], count: int) -> Timing:
        """How the piece's `timing` moves, each (count, runs, ...).

        `moved`: by run and tangent (below `count`), how the run's timing does.
        """

    def _unfinished(self, start: int) -> Iterator[tuple[int, Any, slice]]:
        """Every run that has rows or sub-steps from `start` on: number, run, and which."""
        for i, run in enumerate(self.runs):
            if start < len(run):
                yield i, run, slice(start, min(start + self.rows, len(run)))


class SwitchedBlock(Block):
    """Runs under the on/off law: rows and edges.

    `apart`: every edge ends a separate sub-step, as derivatives require.
    """

    def __init__(
        self, runs: Sequence[SwitchedRun], width: int, rows: int, max_step: float, apart: bool
    ) -> None:
        super().__init__(runs, width, rows)
        self.max_step = max_step
        # -1: no two times count as one.
        self.together = -1.0 if apart else TIME_TOLERANCE
        self.bounds = self._bounds()
        # One for every two rows, as at usual PWM, or more where there are more; and a last one
        # that stays infinite.
        most, self.edges = int(np.diff(self.bounds).max()), max(self.rows // 2, 1)
        while self.edges <= most:
            self.edges *= 2

    @functools.cached_property
    def _arrays(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Times, motor and edges of a piece: fresh memory for each would cost as much again."""
        time, motor = _aligned(self.width, self.rows + 1), _aligned(self.width, self.rows)
        edges = _aligned(2, self.width, self.edges)
        # What a run without rows looks at.
        time[:, :2], motor[:, 0], edges[:, :, 0] = 0.0, 0.0, np.inf
        return time, motor, edges

    def _bounds(self) -> IntArray:
        """How many edges of each valve and run lie before each piece and after the last,
        (2, width, pieces + 1)."""
        most = max(len(run) for run in self.runs)
        starts = np.append(np.arange(0, most, self.rows), most)
        found = np.zeros((2, self.width, len(starts)), dtype=int)
        side = "right" if self.together > 0.0 else "left"
        marks, of = np.empty(0), None
        for i, run in enumerate(self.runs):
            if run.time is not of:  # neighbours of one run share their times
                of = run.time
                marks = of[np.minimum(starts, len(run))] + max(self.together, 0.0)
            for valve, edges in enumerate(run.edges):
                found[valve, i] = edges.searchsorted(marks, side)
        return found

    def table(self, start: int) -> SwitchedTable:
        """The piece from a row on; times from there. It lies where the one before lay."""
        time, motor, edges = self._arrays
        count = np.zeros(self.width, dtype=int)
        begin = np.zeros(self.width)
        shared = len({id(run.time) for run in self.runs}) == 1
        for i, run, rows in self._unfinished(start):
            n = count[i] = rows.stop - start
            begin[i] = run.time[start]
            if not shared:
                np.subtract(run.time[start : rows.stop + 1], begin[i], out=time[i, : n + 1])
            motor[i, :n] = run.motor[rows]
        if shared:
            n = int(count[0])
            np.subtract(self.runs[0].time[start : start + n + 1], begin[0], out=time[:, : n + 1])
        opens = self._edges_into(edges, start, begin)
        (edges_a, edges_b), (open_a, open_b) = edges, opens
        return SwitchedTable(
            time, motor, edges_a, edges_b, open_a, open_b, count, *self._limits(start, time, count)
        )

    def _limits(self, start: int, time: FloatArray, count: IntArray) -> tuple[Any, Any, Any]:
        """The longest sub-step, s, what counts as together, s, and the most sub-steps of a run."""
        k = start // self.rows
        edges = (self.bounds[:, :, k + 1] - self.bounds[:, :, k]).sum(axis=0)
        whole = time[np.arange(self.width), count] / self.max_step
        most = np.array(int((count + edges + whole).max()) + 1)
        return np.array(self.max_step), np.array(self.together), most

    def _edges_into(self, edges: FloatArray, start: int, begin: FloatArray) -> IntArray:
        """The piece's edges since `begin` (width,) s into their places (2, width, edges), and
        whether each valve is open at its first row, (2, width)."""
        k = start // self.rows
        first, last = self.bounds[:, :, k], self.bounds[:, :, k + 1]
        for valve, ends in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
            for own, run, f, e, b in zip(
                edges[valve], self.runs, *ends, begin.tolist(), strict=False
            ):
                np.subtract(run.edges[valve][f:e], b, out=own[: e - f])
                own[e - f] = np.inf
        return first & 1

    def _edges_here(self, run: int, start: int) -> list[slice]:
        """Which edges of each valve lie in the piece."""
        k = start // self.rows
        return [slice(int(b[k]), int(b[k + 1])) for b in self.bounds[:, run]]

    def timing_slopes(self, start: int, moved: Sequence[dict[int, Timing]], count: int) -> Timing:
        """As in Block: derivatives of each valve's edges, (count, runs, edges)."""
        slopes = np.zeros((2, count, self.width, self.edges))
        for i, _, _ in self._unfinished(start):
            for side, here in enumerate(self._edges_here(i, start)):
                for j, timing in moved[i].items():
                    own = timing[side][here]
                    slopes[side, j, i, : len(own)] = own
        return slopes[0], slopes[1]


class EventBlock(Block):
    """Runs under mean flows: sub-steps."""

    runs: Sequence[PreparedRun]

    def table(self, start: int) -> EventTable:
        """The piece from a sub-step on."""
        numbers = _aligned(4 + len(self.runs[0].ripple), self.width, self.rows)
        numbers[:, :, 0] = 0.0  # what a run without sub-steps looks at
        row = np.zeros((self.width, self.rows + 1), dtype=int)
        count = np.zeros(self.width, dtype=int)
        for i, run, rows in self._unfinished(start):
            n = count[i] = rows.stop - start
            columns = (run.grid.duration, run.motor, *run.opens.values(), *run.ripple)
            for table, values in zip(numbers, columns, strict=True):
                table[i, :n] = values[rows]
            np.cumsum(run.grid.ends_sample[rows], out=row[i, 1 : n + 1])
        duration, motor, open_a, open_b, *ripple = numbers
        most = count.max()
        return EventTable(duration, motor, open_a, open_b, row, count, tuple(ripple), most)

    def timing_slopes(self, start: int, moved: Sequence[dict[int, Timing]], count: int) -> Timing:
        """As in Block: derivatives of the durations, (count, runs, sub-steps)."""
        slopes = np.zeros((count, self.width, self.rows))
        for i, _, rows in self._unfinished(start):
            for j, (duration,) in moved[i].items():
                slopes[j, i, : rows.stop - start] = duration[rows]
        return (slopes,)


def _aligned(*shape: int) -> FloatArray:
    """Memory that begins where a compiled function takes it as it is, without a copy."""
    whole = np.empty(math.prod(shape) + _ALIGNED // 8)
    first = -whole.ctypes.data % _ALIGNED // 8
    return whole[first : first + math.prod(shape)].reshape(shape)


def block_of(
    runs: Sequence[PreparedRun | SwitchedRun],
    width: int,
    rows: int,
    max_step: float,
    apart: bool = False,
) -> Block:
    """The block of runs prepared alike."""
    if isinstance(runs[0], SwitchedRun):
        return SwitchedBlock(runs, width, rows, max_step, apart)  # type: ignore[arg-type]
    return EventBlock(runs, width, rows)


__all__ = ["Block", "Timing", "block_of"]
