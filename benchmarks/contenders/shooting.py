"""The job as residuals for a least-squares solver: unknowns, stages, and the sparsity.

The stages are those of sysid and of `job.c`: each channel of a segment counts by its own size and
static friction waits; each log's static friction is scanned; again with all unknowns; then the
errors as they are, without segments that the model does not follow.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix, identity, vstack

SHARED, START, SCATTER = 8, 4, 0.02
# Where the shared unknowns lie among the plant's numbers.
PLACES = np.array([0, 1, 2, 17, 19, 18, 20, 21])
# When scipy's least squares ends, and on what scale it steps.
DESCENT: dict[str, Any] = {"x_scale": "jac", "ftol": 1e-6, "xtol": 1e-9, "gtol": None}


class Job:
    """A job and where its estimation is: `x` all unknowns, `free` those that may move.

    Logarithms over where they start: static and Coulomb friction, viscous over Coulomb friction,
    five flows; each log's sliding and static friction, with a prior about the first two. Then the
    segments' starts in units of their widths.
    """

    def __init__(self, path: str, simulate: Callable[..., Any]) -> None:
        self.data = dict(np.load(path))
        self.simulate = simulate
        self.test = self.data["test"].astype(int)
        self.count, self.tests = len(self.test), int(self.test.max()) + 1
        self.x = np.zeros(SHARED + 2 * self.tests + START * self.count)
        self.first_start = SHARED + 2 * self.tests
        self.static = np.array([0, *range(SHARED + 1, self.first_start, 2)])
        # A shaft at rest stays so: its velocity is no unknown.
        self.known = np.flatnonzero(self.data["widths"].ravel() < 1e-8) + self.first_start
        self.counted = np.ones(self.count, dtype=bool)
        self.robust, self.evaluations = True, 0
        self.prior = self.priors()
        self.hold(self.static)

    def hold(self, more: Any = ()) -> None:
        """Let all unknowns move but those at rest and these."""
        self.free = np.ones(len(self.x), dtype=bool)
        self.free[self.known] = False
        self.free[np.asarray(more, dtype=int)] = False

    def with_free(self, free: Any) -> Any:
        """All unknowns with other values of those that move."""
        x = self.x.copy()
        x[self.free] = free
        return x

    def plants(self, x: Any) -> Any:
        """Each segment's plant (n, 25)."""
        moved = np.tile(x[:SHARED], (self.count, 1))
        sliding, static = x[SHARED : self.first_start].reshape(-1, 2)[self.test].T
        moved[:, 0], moved[:, 1], moved[:, 2] = static, sliding, x[2] + sliding
        plants = np.tile(self.data["plant"], (self.count, 1))
        plants[:, PLACES] *= np.exp(moved)
        return plants

    def errors(self, x: Any) -> Any:
        """Simulated less measured over the noise, (n, 3, rows)."""
        self.evaluations += 1
        d, local = self.data, x[self.first_start :].reshape(-1, START)
        starts = d["starts"] + d["widths"] * local
        inputs = (d["time"], d["motor"], d["edges_a"], d["edges_b"])
        found = self.simulate(self.plants(x), starts, *inputs)
        found -= d["measured"]
        found /= d["noise"][:, None]
        return found

    def scale(self, errors: Any) -> Any:
        """What each channel is multiplied by (n, 3, 1), so that its squares are its cost."""
        if not self.robust:
            return self.counted[:, None, None].astype(float)
        size = np.maximum(np.mean(errors**2, axis=2, keepdims=True), 1e-12)
        return np.sqrt(np.log1p(size) / size) * self.counted[:, None, None]

    def residual(self, free: Any) -> Any:
        """All residuals, the priors of friction and starts at the end."""
        x = self.with_free(free)
        errors = self.errors(x)
        errors *= self.scale(errors)
        return np.concatenate([errors.ravel(), self.prior @ x])

    def priors(self) -> Any:
        """Rows over all unknowns: the logs' friction about the model's, the starts."""
        rows = identity(len(self.x), format="lil")[SHARED:]
        for i in range(2 * self.tests):
            rows[i, SHARED + i], rows[i, 1 - i % 2] = 1.0 / SCATTER, -1.0 / SCATTER
        return rows.tocsr()

    def sparsity(self) -> Any:
        """Which residuals depend on which of the unknowns that move."""
        rows = self.data["measured"][0].size
        own = np.zeros((self.count, len(self.x)))
        own[:, :SHARED] = 1.0
        for i, test in enumerate(self.test):
            own[i, SHARED + 2 * test : SHARED + 2 * test + 2] = 1.0
            own[i, self.first_start + START * i : self.first_start + START * (i + 1)] = 1.0
        every = vstack([csr_matrix(np.repeat(own, rows, axis=0)), self.prior], format="csc")
        return every[:, np.flatnonzero(self.free)].tocsr()

    def costs(self, x: Any) -> Any:
        """By segment."""
        errors = self.errors(x)
        return np.sum((errors * self.scale(errors)) ** 2, axis=(1, 2))

    def scan(self) -> None:
        """Static friction of each log where its segments cost least: breakaway is a staircase."""
        own = self.x[SHARED : self.first_start].reshape(-1, 2)[:, 1]  # a view
        for width in (1.0, 0.05):
            middle, least = own.copy(), np.bincount(self.test, self.costs(self.x))
            best = middle.copy()
            for k in range(-20, 21):
                own[:] = middle + k * width * SCATTER
                cost = np.bincount(self.test, self.costs(self.x))
                best, least = np.where(cost < least, own, best), np.minimum(cost, least)
            own[:] = best
        self.x[0] = own.mean()

    def leave_out(self) -> None:
        """Segments whose errors are not like those of the others."""
        cost = self.costs(self.x) / self.data["measured"][0].size
        self.counted = cost <= 9.0 * max(float(np.median(cost)), 1.0)

    def solve(self, descend: Callable[[Job], Any], out: str) -> None:
        """All stages; `descend` returns better values of the unknowns that move. Writes them."""
        self.x[self.free] = descend(self)
        self.scan()
        self.hold()
        self.x[self.free] = descend(self)
        self.robust = False
        self.leave_out()
        self.x[self.free] = descend(self)
        self.x[2] += self.x[1]
        values = [self.evaluations, *self.x[:SHARED]]
        Path(out).write_text("\n".join(repr(float(v)) for v in values) + "\n")


__all__ = ["DESCENT", "Job"]
