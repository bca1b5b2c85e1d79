"""A static component on its tests: the law predicts every row by itself."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from sysid.components.definition import StaticComponent, outputs_of
from sysid.components.parts import OwnPart, Stretch
from sysid.diagnosis.bench.component import Law
from sysid.io.logs import Trial
from sysid.types import FloatArray


@dataclass(frozen=True)
class StaticPart(OwnPart):
    """A law in the logged columns on its tests."""

    @property
    def _law(self) -> StaticComponent:
        return cast(StaticComponent, self.definition)

    def predicted(self, law: Law, tests: Sequence[int]) -> list[dict[str, FloatArray]]:
        return [self._on_rows(self.stretches[t], law) for t in tests]

    def open_loop(
        self, law: Law, pieces: Sequence[tuple[Trial, int, int]]
    ) -> list[dict[str, FloatArray]]:
        chosen = [Stretch(trial.label, trial, start, stop) for trial, start, stop in pieces]
        return [self._on_rows(one, law) for one in chosen]

    def unbounded(self, law: Law) -> Iterator[tuple[Trial, int, FloatArray]]:
        for one in self.stretches:
            yield one.trial, one.start, self.on(_columns(one, self._law), law)

    def _on_rows(self, stretch: Stretch, law: Law) -> dict[str, FloatArray]:
        outputs = self.bounded(self.on(_columns(stretch, self._law), law))
        return dict(zip(self._outputs, outputs.T, strict=True))

    def on(self, columns: Mapping[str, FloatArray], law: Law) -> FloatArray:
        """(n, outputs) from the inputs (n,). Raises InputError where the user's code fails."""
        numbers = self.numbers(law)
        own = {p.name: numbers[p.name] for p in self._law.parameters}
        rows = len(columns["time_s"])
        try:
            with np.errstate(all="ignore"):
                found = outputs_of(self._law.predict(columns, own), self._law)
                for term in self.active(law):
                    given = {q.name: numbers[f"{term.id}/{q.name}"] for q in term.quantities}
                    added = outputs_of(term.adds(columns, {**own, **given}), self._law)
                    found = {n: v + added.get(n, 0.0) for n, v in found.items()}
            each = [np.broadcast_to(np.asarray(found[n], float), (rows,)) for n in self._outputs]
            return np.column_stack(each)
        except Exception as error:
            raise self.loaded.error(error) from None

    def shown(self, tests: Sequence[int]) -> list[dict[str, FloatArray]]:
        chosen = [self.stretches[t] for t in tests]
        return [{n: s.trial[n][s.rows] for n in self._law.outputs} for s in chosen]

    def regressors_of(self, test: int) -> dict[str, FloatArray]:
        columns = _columns(self.stretches[test], self._law)
        try:
            own = self._law.regressors(columns)
        except Exception as error:
            raise self.loaded.error(error) from None
        return {**{n: np.asarray(v, float) for n, v in own.items()}, "time": columns["time_s"]}

    def noise_of(self, name: str, law: Law) -> float:
        """The measurement's own noise, or the change of the residual from one row to the next,
        whichever is less: rows in any order change by more than noise."""
        every = range(len(self.stretches))
        pairs = zip(self.shown(every), self.predicted(law, every), strict=True)
        steps = np.concatenate([np.diff(m[name] - p[name]) for m, p in pairs])
        by_rows = math.sqrt(0.5 * float(np.mean(steps**2))) if len(steps) else math.nan
        return min(self.noise_as_logged(name), by_rows)


def _columns(stretch: Stretch, law: StaticComponent) -> dict[str, FloatArray]:
    trial = stretch.trial
    columns = {name: trial[name][stretch.rows] for name in law.inputs}
    return {**columns, "time_s": trial.since_start[stretch.rows]}


__all__ = ["StaticPart"]
