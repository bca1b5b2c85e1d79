"""A dynamic component on its tests, simulated open loop, each from its own start."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np

from sysid.components.definition import DynamicComponent
from sysid.components.parts import OwnPart
from sysid.components.simulation import Runs, runs_of, simulated, slopes, with_starts
from sysid.diagnosis.bench.component import Law
from sysid.errors import SysidError
from sysid.io.logs import Trial
from sysid.types import FloatArray, IntArray

_FEWEST_ROWS = 4


@dataclass(frozen=True)
class DynamicPart(OwnPart):
    """A right-hand side on its tests. Residuals are those of every `stride`-th row."""

    @property
    def made(self) -> DynamicComponent:
        """The user's own class, as an object."""
        return cast(DynamicComponent, self.definition)

    @property
    def stride(self) -> int:
        """Rows from one residual to the next."""
        rows = sum(s.stop - s.start for s in self.stretches)
        # Residuals of all tests and outputs that are kept; rows between are simulated.
        return max(1, -(-rows * len(self.made.outputs) // 12_000))

    @cached_property
    def pieces(self) -> tuple[tuple[int, int, int], ...]:
        """Stretch, first and last row + 1 of every run: whole stretches, or segments of them."""
        return tuple(self._pieces())

    def _pieces(self) -> Iterator[tuple[int, int, int]]:
        for k, stretch in enumerate(self.stretches):
            rows = stretch.stop - stretch.start
            if self.made.segment_s is not None:
                rows = max(_FEWEST_ROWS, round(self.made.segment_s / stretch.trial.period))
            edges = [*range(stretch.start, stretch.stop, rows), stretch.stop]
            if len(edges) > 2 and edges[-1] - edges[-2] < max(_FEWEST_ROWS, rows // 2):
                del edges[-2]
            yield from ((k, a, b) for a, b in itertools.pairwise(edges))

    @cached_property
    def runs(self) -> Runs:
        """All stretches' runs, in turn."""
        trials = [(self.stretches[k].trial, a, b) for k, a, b in self.pieces]
        return runs_of(self.made, trials)

    def _rows(self, piece: tuple[int, int, int]) -> IntArray:
        """Rows of the trial whose residual counts, in one run."""
        _, start, stop = piece
        return np.arange(start, stop, self.stride)

    def vector(self, law: Law) -> FloatArray:
        """A law's numbers in the order of the compiled model."""
        return np.array(list(self.numbers(law).values()))

    def _of_tests(self, outputs: FloatArray, tests: Sequence[int]) -> list[dict[str, FloatArray]]:
        """(runs, n, outputs) as each output of each test, on the rows that count."""
        found: list[dict[str, FloatArray]] = []
        for t in tests:
            parts = [
                outputs[r, self._rows(piece) - piece[1]]
                for r, piece in enumerate(self.pieces)
                if piece[0] == t
            ]
            joined = np.concatenate(parts)
            found.append({n: joined[:, i] for i, n in enumerate(self.made.outputs)})
        return found

    def predicted(self, law: Law, tests: Sequence[int]) -> list[dict[str, FloatArray]]:
        return self._of_tests(self._simulated([law])[0], tests)

    def open_loop(
        self, law: Law, pieces: Sequence[tuple[Trial, int, int]]
    ) -> list[dict[str, FloatArray]]:
        outputs = self._simulated([law], runs_of(self.made, pieces))[0]
        return [
            {n: outputs[r, : stop - start, i] for i, n in enumerate(self.made.outputs)}
            for r, (_, start, stop) in enumerate(pieces)
        ]

    def _simulated(self, laws: Sequence[Law], runs: Runs | None = None) -> FloatArray:
        """(laws, runs, n, outputs); what diverges is set far off. Raises InputError."""
        return self.bounded(self._as_simulated(laws, runs or self.runs))

    def unbounded(self, law: Law) -> Iterator[tuple[Trial, int, FloatArray]]:
        outputs = self._as_simulated([law], self.runs)[0]
        for r, (k, start, stop) in enumerate(self.pieces):
            yield self.stretches[k].trial, start, outputs[r, : stop - start]

    def _as_simulated(self, laws: Sequence[Law], runs: Runs) -> FloatArray:
        vectors = np.stack([self.vector(law) for law in laws])
        try:
            return simulated(self.made, vectors, runs)
        except SysidError:
            raise
        except Exception as error:
            raise self.loaded.error(error) from None

    def residuals_of(self, laws: Sequence[Law], tests: Sequence[int]) -> list[list[FloatArray]]:
        outputs = self._simulated(laws)
        return [self._scaled_residuals(self._of_tests(one, tests), tests) for one in outputs]

    def jacobian(self, law: Law, tests: Sequence[int]) -> FloatArray:
        """Derivatives of the residuals by the law's numbers, then its effects', (n, p)."""
        wanted = [
            *(p.name for p in self.parameters()),
            *(f"{e.id}/{q.name}" for e in law.effects for q in type(e).quantities),
        ]
        found = _none_if_steep(self.slopes_of(law, wanted))
        columns = []
        for one in found:
            by_test = self._of_tests(one, tests)
            columns.append(np.concatenate([self._scaled(test) for test in by_test]))
        return -np.column_stack(columns)

    def slopes_of(self, law: Law, wanted: Sequence[str]) -> FloatArray:
        """Derivatives (wanted, runs, n, outputs) of the outputs by numbers of a law, as found."""
        names, states = list(self.numbers(law)), len(self.made.states)
        directions = np.zeros((len(wanted), len(names) + states))
        for i, name in enumerate(wanted):
            directions[i, names.index(name)] = 1.0
        starts = np.zeros((len(self.pieces), states))
        return slopes(self.made, self.vector(law), starts, self.runs, directions)

    def residuals_from(self, law: Law, starts: FloatArray) -> FloatArray:
        """All residuals (n,) where the runs start `starts` (runs, states) off their own starts."""
        every = range(len(self.stretches))
        outputs = with_starts(self.made, self.vector(law), starts, self.runs)
        return np.concatenate(
            self._scaled_residuals(self._of_tests(self.bounded(outputs), every), every)
        )

    def jacobian_from(self, law: Law, starts: FloatArray) -> FloatArray:
        """Derivatives of these by the parameters, then by each run's start, (n, p)."""
        names, states = list(self.numbers(law)), len(self.made.states)
        own = [names.index(p.name) for p in self.parameters()]
        places = [*own, *range(len(names), len(names) + states)]
        directions = np.eye(len(names) + states)[places]
        found = slopes(self.made, self.vector(law), starts, self.runs, directions)
        found = _none_if_steep(found)
        every = range(len(self.stretches))

        def column(outputs: FloatArray) -> FloatArray:
            return np.concatenate([self._scaled(t) for t in self._of_tests(outputs, every)])

        columns = [column(one) for one in found[: len(own)]]
        for r in range(len(self.pieces)):
            # The start of a run changes that run alone.
            alone = np.zeros((len(self.pieces), 1, 1))
            alone[r] = 1.0
            columns += [column(one * alone) for one in found[len(own) :]]
        return -np.column_stack(columns)

    def state_sizes(self, law: Law) -> FloatArray:
        """A size of each state (states,): the change of its start that moves the outputs by about
        a tenth of their spread."""
        states = len(self.made.states)
        starts = np.zeros((len(self.pieces), states))
        reach = np.linalg.norm(self.jacobian_from(law, starts), axis=0)[len(self.parameters()) :]
        spread = float(np.linalg.norm(np.concatenate(self.measured(range(len(self.stretches))))))
        each = np.sqrt(np.sum(reach.reshape(-1, states) ** 2, axis=0))
        sizes: FloatArray = 0.1 * spread / np.maximum(each, 1e-12 * spread)
        return sizes

    def _scaled(self, outputs: dict[str, FloatArray]) -> FloatArray:
        pairs = zip(self.made.outputs, self.scales, strict=True)
        return np.concatenate([outputs[n] / scale for n, scale in pairs])

    def shown(self, tests: Sequence[int]) -> list[dict[str, FloatArray]]:
        found = []
        for t in tests:
            rows = self._rows_of(t)
            found.append({n: self.stretches[t].trial[n][rows] for n in self.made.outputs})
        return found

    def _rows_of(self, test: int) -> IntArray:
        return np.concatenate([self._rows(p) for p in self.pieces if p[0] == test])

    def regressors_of(self, test: int) -> dict[str, FloatArray]:
        """Inputs, outputs and their rates as measured, and time."""
        trial, rows = self.stretches[test].trial, self._rows_of(test)
        found = {n: trial[n][rows] for n in self.made.columns}
        found |= {f"rate of {n}": _rate_of(trial, n)[rows] for n in self.made.outputs}
        return {**found, "time": trial.time[rows] - trial.time[0]}

    def noise_of(self, name: str, law: Law) -> float:
        """The measurement's own noise: from the channel itself, or from one row's residual to the
        next, whichever is less: motion adds to both."""
        outputs, i = self._simulated([law])[0], self.made.outputs.index(name)
        steps = [
            np.diff(self.stretches[k].trial[name][a:b] - outputs[r, : b - a, i])
            for r, (k, a, b) in enumerate(self.pieces)
        ]
        by_rows = math.sqrt(0.5 * float(np.mean(np.concatenate(steps) ** 2)))
        return min(self.noise_as_logged(name), by_rows)


def _none_if_steep(slopes: FloatArray) -> FloatArray:
    # Slopes beyond this are invalid: their squares would overflow.
    return np.where(np.abs(slopes) < 1e100, slopes, 0.0)


def _rate_of(trial: Trial, name: str) -> FloatArray:
    """A column's smoothed time derivative, (n,)."""
    # Rows on each side through which the rate of a column is smoothed, as a regressor: 15.
    width = 2 * 15 + 1
    if len(trial) < width:
        return np.gradient(trial[name], trial.time)
    from scipy.signal import savgol_filter

    return np.asarray(savgol_filter(trial[name], width, 2, deriv=1, delta=trial.period))


__all__ = ["DynamicPart"]
