"""What is left of a part's prediction error: how much of it repeats, and how much is scatter.

Repeatable is what one set of tests says of another's residual, over everything that was logged
together: a gradient boosting of trees (Friedman, Ann. Statist. 29 (2001) 1189-1232), by
scikit-learn, judged on tests that it was not fitted on. The rest above the noise differs from test
to test, and no law in these quantities takes it away.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.diagnosis.bench.component import Component, Law
from sysid.diagnosis.bench.selection import folds_of
from sysid.types import FloatArray, IntArray

# They hold the noise of what is predicted.
_NOISY = ("motor", "acceleration")
_MOST_SAMPLES = 20_000
_TREES, _LEAVES, _LEAST_IN_LEAF, _SEED = 80, 15, 40, 0


@dataclass(frozen=True)
class Remainder:
    """RMSE of a channel's residual, in its unit, and its parts, whose squares add up to its own.

    `noise`: from one sample to the next; `repeatable`: what other tests predict over `regressors`;
    `scatter`: the rest, from test to test.
    """

    channel: str
    unit: str
    rmse: float
    noise: float
    repeatable: float
    scatter: float
    regressors: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """The numbers by name."""
        return {**vars(self), "regressors": list(self.regressors)}


def remainder(
    component: Component, outside: Component | None, law: Law, noise: float
) -> Remainder | None:
    """Of held-out tests as the training tests predict them; without any of the training tests in
    turn. None where too few samples or tests are there to say.

    `noise` in the channel's unit.
    """
    if not math.isfinite(noise):
        return None
    names, inputs, left, test = _table(component, law)
    if outside is not None:
        _, other, found, _ = _table(outside, law)
        pairs = [((inputs, left), (other, found))]
    else:
        out = [np.isin(test, list(fold)) for fold in folds_of(component)]
        pairs = [((inputs[~o], left[~o]), (inputs[o], left[o])) for o in out]
    enough = all(len(fit[1]) >= 2 * _LEAST_IN_LEAF and len(new[1]) for fit, new in pairs)
    if not names or not pairs or not enough:
        return None
    squares = sum(float(np.sum(new[1] ** 2)) for _, new in pairs)
    missed = sum(_missed(fit, new) for fit, new in pairs)
    rmse = math.sqrt(squares / sum(len(new[1]) for _, new in pairs))
    share = max(1.0 - missed / squares, 0.0) if squares > 0.0 else 0.0
    noise = min(noise, rmse * math.sqrt(1.0 - share))
    scatter = math.sqrt(max(rmse**2 * (1.0 - share) - noise**2, 0.0))
    repeatable = rmse * math.sqrt(share)
    return Remainder(component.channel, component.unit, rmse, noise, repeatable, scatter, names)


_Table = tuple[FloatArray, FloatArray]


def _table(
    component: Component, law: Law
) -> tuple[tuple[str, ...], FloatArray, FloatArray, IntArray]:
    """Names (k,) of the regressors, their values (n, k), residuals (n,), and whose test's (n,)."""
    every = range(len(component.tests))
    parts = component.residuals(law, every)
    columns = {n: v for n, v in component.regressors(every).items() if n not in _NOISY}
    test = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    return tuple(columns), np.column_stack([*columns.values()]), np.concatenate(parts), test


def _missed(fit: _Table, new: _Table) -> float:
    """Squares of the residuals of new tests about what those that were fitted on predict."""
    from sklearn.ensemble import HistGradientBoostingRegressor

    stride = -(-len(fit[1]) // _MOST_SAMPLES)
    trees = HistGradientBoostingRegressor(
        max_iter=_TREES,
        max_leaf_nodes=_LEAVES,
        min_samples_leaf=_LEAST_IN_LEAF,
        early_stopping=False,
        random_state=_SEED,
    ).fit(fit[0][::stride], fit[1][::stride])
    return float(np.sum((new[1] - trees.predict(new[0])) ** 2))


__all__ = ["Remainder", "remainder"]
