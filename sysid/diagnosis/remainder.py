"""The remainder of a residual: how much of it repeats from test to test, how much is scatter.

Repeatable is what one set of tests says of another's residual, over everything that was logged
together: a gradient boosting of trees (Friedman, Ann. Statist. 29 (2001) 1189-1232), by
scikit-learn, judged on tests that it was not fitted on. The rest above the noise differs from test
to test, and no law in these quantities takes it away.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sysid.types import FloatArray, IntArray

LEAST_REPEATABLE = 0.1
"""Share of the error of the law without effects below which what repeats is not looked into."""
LEAST_AGREEING = 0.75
"""Share of the tests that must have the structure in common."""
# They hold the noise of what is predicted.
_NOISY = ("motor", "acceleration")
_MOST_SAMPLES = 20_000
_TREES, _LEAVES, _LEAST_IN_LEAF, _SEED = 80, 15, 40, 0


@dataclass(frozen=True)
class Remainder:
    """RMSE of a channel's residual, in its unit, and its parts, whose squares add up to its own.

    `noise`: from one sample to the next; `repeatable`: what other tests predict over `regressors`;
    `scatter`: the remaining part, from test to test. `agreeing`: of `tests`, the training tests
    excluded in turn and the held-out ones, those whose residual others predict at all.
    """

    channel: str
    unit: str
    rmse: float
    noise: float
    repeatable: float
    scatter: float
    regressors: tuple[str, ...]
    agreeing: int
    tests: int

    def is_large(self, before: float) -> bool:
        """Whether what repeats is more than noise, and than a tenth of `before`.

        `before`: the RMSE of the law without the effects added, in the channel's unit.
        """
        return self.repeatable > max(self.noise, LEAST_REPEATABLE * before)

    @property
    def is_steady(self) -> bool:
        """Whether most tests have it in common.

        Where friction is another in each test, a few are alike by chance, but seldom most.
        """
        return self.agreeing >= LEAST_AGREEING * self.tests

    @property
    def share(self) -> float:
        """Share of the variance that repeats, 0 to 1."""
        return (self.repeatable / self.rmse) ** 2 if self.rmse > 0.0 else 0.0

    def to_json(self) -> dict[str, Any]:
        """The numbers by name."""
        return {**vars(self), "regressors": list(self.regressors)}


@dataclass(frozen=True)
class ResidualTable:
    """Regressors (n, k) by `names`, residuals (n,), and whose test's (n,)."""

    names: tuple[str, ...]
    inputs: FloatArray
    left: FloatArray
    test: IntArray

    @staticmethod
    def of(columns: Mapping[str, FloatArray], left: FloatArray, test: IntArray) -> ResidualTable:
        """A table of regressors by name, without those that contain the residual's noise."""
        used = {n: v for n, v in columns.items() if n not in _NOISY}
        inputs = np.column_stack([*used.values()]) if used else np.zeros((len(left), 0))
        return ResidualTable(tuple(used), inputs, left, test)

    def __len__(self) -> int:
        return len(self.left)

    def divided(self, out: Sequence[int]) -> tuple[ResidualTable, ResidualTable]:
        """Without some tests, and those."""
        those = np.isin(self.test, list(out))
        return self._rows(~those), self._rows(those)

    def _rows(self, rows: NDArray[np.bool_]) -> ResidualTable:
        return ResidualTable(self.names, self.inputs[rows], self.left[rows], self.test[rows])


def remainder(
    own: ResidualTable,
    outside: ResidualTable | None,
    folds: Sequence[Sequence[int]],
    noise: float,
    channel: str,
    unit: str,
) -> Remainder | None:
    """Of held-out tests as the training tests predict them; without any of the training tests in
    turn, fold by fold. None where too few samples or tests are there to say.

    `noise` in the channel's unit.
    """
    if not math.isfinite(noise):
        return None
    pairs = [own.divided(fold) for fold in folds]
    if outside is not None:
        pairs.append((own, outside))
    judged = pairs[-1:] if outside is not None else pairs
    enough = all(len(fit) >= 2 * _LEAST_IN_LEAF and len(new) for fit, new in pairs)
    if not own.names or not judged or not enough:
        return None
    gains = [_gains(fit, new) for fit, new in pairs]
    squares, missed = np.sum([np.sum(g, axis=0) for g in gains[-len(judged) :]], axis=0)
    rmse = math.sqrt(squares / sum(len(new) for _, new in judged))
    share = max(1.0 - missed / squares, 0.0) if squares > 0.0 else 0.0
    noise = min(noise, rmse * math.sqrt(1.0 - share))
    tests = np.concatenate(gains)
    return Remainder(
        channel,
        unit,
        rmse,
        noise,
        rmse * math.sqrt(share),
        math.sqrt(max(rmse**2 * (1.0 - share) - noise**2, 0.0)),
        own.names,
        int(np.count_nonzero(tests[:, 1] < tests[:, 0])),
        len(tests),
    )


def _gains(fit: ResidualTable, new: ResidualTable) -> FloatArray:
    """Squares of each new test's residuals, and of what they are off from what `fit` predicts.

    (tests, 2).
    """
    from sklearn.ensemble import HistGradientBoostingRegressor

    stride = -(-len(fit) // _MOST_SAMPLES)
    trees = HistGradientBoostingRegressor(
        max_iter=_TREES,
        max_leaf_nodes=_LEAVES,
        min_samples_leaf=_LEAST_IN_LEAF,
        early_stopping=False,
        random_state=_SEED,
    ).fit(fit.inputs[::stride], fit.left[::stride])
    off = new.left - trees.predict(new.inputs)
    which = np.unique(new.test, return_inverse=True)[1]
    return np.column_stack([np.bincount(which, values**2) for values in (new.left, off)])


__all__ = ["LEAST_AGREEING", "LEAST_REPEATABLE", "Remainder", "ResidualTable", "remainder"]
