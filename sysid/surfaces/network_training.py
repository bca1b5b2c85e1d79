"""Levenberg-Marquardt for many restarts of a one-hidden-layer tanh network at once (torch).

The Jacobian of such a network is a closed form, so no automatic differentiation is used.
Damping by the gain ratio, one value per restart (Nielsen 1999, IMM-REP-1999-05).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from sysid.types import FloatArray

# Samples at a time: the Jacobian of a restart then stays in the cache.
_CHUNK = 2048
# Share of the restarts, of the samples and of the steps, by round of `train`.
_ROUNDS = ((1.0, 0.125, 0.2), (0.25, 0.25, 0.35), (0.05, 1.0, 1.0))


@dataclass(frozen=True)
class Samples:
    """Scaled samples: inputs `x` (2, n), target `y` (n,), root of the weight `w` (n,)."""

    x: Tensor
    y: Tensor
    w: Tensor

    def part(self, rows: Tensor) -> Samples:
        """The samples in `rows` (k,)."""
        return Samples(self.x[:, rows], self.y[rows], self.w[rows])


@dataclass(frozen=True)
class Training:
    """Result by restart: `weights` (R, 4 H + 1) at the best held-out error, `train` and
    `held_out` (R,) scaled RMSE there, `iterations` (R,)."""

    weights: FloatArray
    train: FloatArray
    held_out: FloatArray
    iterations: FloatArray


def initial_weights(seeds: list[int], hidden: int) -> FloatArray:
    """(R, 4 H + 1) starting weights by Nguyen and Widrow (1990), one seed per restart.

    Order: input weights of the first input (H), of the second (H), hidden biases (H),
    output weights (H), output bias. Inputs and target are scaled to [-1, 1].
    """
    rows = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        size = 0.7 * hidden**0.5
        angle = rng.uniform(0.0, 2.0 * np.pi, hidden)
        bias = size * np.linspace(-1.0, 1.0, hidden) if hidden > 1 else np.zeros(1)
        sign = np.sign(np.cos(angle))
        out = rng.uniform(-0.5, 0.5, hidden)
        inputs = [size * np.cos(angle), size * np.sin(angle), bias * sign]
        rows.append(np.concatenate([*inputs, out, [0.0]]))
    return np.array(rows)


def outputs(weights: Tensor, x: Tensor) -> Tensor:
    """Network output (R, n) for weights (R, 4 H + 1) and inputs x (2, n)."""
    w, b, v, c = _unpack(weights)
    h = torch.tanh(torch.baddbmm(b.unsqueeze(2), w, x.expand(len(weights), *x.shape)))
    return torch.baddbmm(c.view(-1, 1, 1), v.unsqueeze(1), h).squeeze(1)


def _unpack(weights: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    hidden = (weights.shape[1] - 1) // 4
    w = weights[:, : 2 * hidden].view(-1, 2, hidden).transpose(1, 2)
    b = weights[:, 2 * hidden : 3 * hidden]
    v = weights[:, 3 * hidden : 4 * hidden]
    return w, b, v, weights[:, 4 * hidden]


def jacobian(weights: Tensor, x: Tensor) -> tuple[Tensor, Tensor]:
    """Output (R, n) and its derivative by the weights (R, 4 H + 1, n)."""
    w, b, v, c = _unpack(weights)
    restarts, hidden = b.shape
    h = torch.tanh(torch.baddbmm(b.unsqueeze(2), w, x.expand(restarts, *x.shape)))
    j = weights.new_empty(restarts, 4 * hidden + 1, x.shape[1])
    slope = j[:, 2 * hidden : 3 * hidden]
    torch.mul(h, h, out=slope)
    slope.neg_().add_(1.0).mul_(v.unsqueeze(2))
    torch.mul(slope, x[0], out=j[:, :hidden])
    torch.mul(slope, x[1], out=j[:, hidden : 2 * hidden])
    j[:, 3 * hidden : 4 * hidden] = h
    j[:, 4 * hidden] = 1.0
    return torch.baddbmm(c.view(-1, 1, 1), v.unsqueeze(1), h).squeeze(1), j


def _gram(weights: Tensor, data: Samples) -> Tensor:
    """J'J (R, K, K) of the weighted outputs."""
    restarts, size = weights.shape
    gram = weights.new_zeros(restarts, size, size)
    for k in range(0, len(data.y), _CHUNK):
        part = slice(k, k + _CHUNK)
        _, j = jacobian(weights, data.x[:, part])
        j.mul_(data.w[part])
        gram.baddbmm_(j, j.transpose(1, 2))
    return gram


def _loss_and_gradient(weights: Tensor, data: Samples) -> tuple[Tensor, Tensor]:
    """Weighted sum of squares (R,) and half its gradient J'r (R, K)."""
    w, b, v, c = _unpack(weights)
    total = weights.new_zeros(len(weights))
    gradient = torch.zeros_like(weights)
    hidden = b.shape[1]
    for k in range(0, len(data.y), _CHUNK):
        x, target, root = data.x[:, k : k + _CHUNK], data.y[k : k + _CHUNK], data.w[k : k + _CHUNK]
        h = torch.tanh(torch.baddbmm(b.unsqueeze(2), w, x.expand(len(weights), *x.shape)))
        r = torch.baddbmm(c.view(-1, 1, 1), v.unsqueeze(1), h).squeeze(1)
        r.sub_(target).mul_(root)
        total += r.square().sum(dim=1)
        r.mul_(root)
        gradient[:, 3 * hidden : 4 * hidden] += torch.bmm(h, r.unsqueeze(2)).squeeze(2)
        gradient[:, 4 * hidden] += r.sum(dim=1)
        back = h.square_().neg_().add_(1.0).mul_(r.unsqueeze(1))
        # One product for both inputs and the bias: the rows of x with a row of ones.
        basis = torch.cat((x, torch.ones_like(x[:1])))
        parts = torch.matmul(back, basis.T).mul_(v.unsqueeze(2))
        gradient[:, : 3 * hidden] += parts.transpose(1, 2).reshape(len(weights), -1)
    return total, gradient


def _squares(weights: Tensor, data: Samples) -> Tensor:
    """Weighted sum of squared residuals (R,)."""
    total = weights.new_zeros(len(weights))
    for k in range(0, len(data.y), 4 * _CHUNK):
        part = slice(k, k + 4 * _CHUNK)
        residual = (outputs(weights, data.x[:, part]) - data.y[part]) * data.w[part]
        total += residual.square().sum(dim=1)
    return total


class _State:
    """The restarts under way; every tensor has one row a restart.

    Loss and gradient use all samples, so that the minimum is exact; J'J, most of the work,
    uses a subset (at least 12 samples per weight), which gives the curvature closely enough
    for a step.
    """

    def __init__(self, weights: Tensor, data: Samples, held_out: Samples) -> None:
        self.data, self.held_out = data, held_out
        stride = max(1, min(4, len(data.y) // (12 * weights.shape[1])))
        self.sparse = data.part(torch.arange(0, len(data.y), stride))
        self.inflation = float(data.w.square().sum() / self.sparse.w.square().sum())
        self.weights = weights
        self.loss, self.moment = _loss_and_gradient(weights, data)
        self.gram = _gram(weights, self.sparse) * self.inflation
        diagonal = self.gram.diagonal(dim1=1, dim2=2).amax(dim=1)
        self.damping = 1e-3 * diagonal
        self.growth = torch.full_like(self.damping, 2.0)
        self.best_weights = weights.clone()
        self.best_held_out = _squares(weights, held_out)
        self.stale = torch.zeros(len(weights), dtype=torch.long)
        self.iterations = torch.zeros(len(weights), dtype=torch.long)

    def step(self, active: Tensor) -> None:
        """One damped step of the restarts in `active` (k,)."""
        gram, moment, damping = self.gram[active], self.moment[active], self.damping[active]
        damped = gram + torch.diag_embed(damping.unsqueeze(1).expand(-1, gram.shape[1]))
        factor, failed = torch.linalg.cholesky_ex(damped)
        delta = -torch.cholesky_solve(moment.unsqueeze(2), factor).squeeze(2)
        trial = self.weights[active] + delta
        loss, gradient = _loss_and_gradient(trial, self.data)
        predicted = (delta * (damping.unsqueeze(1) * delta - moment)).sum(dim=1)
        gain = (self.loss[active] - loss) / predicted
        taken = (failed == 0) & torch.isfinite(loss) & (gain > 0)
        self._damp(active, taken, gain)
        self.iterations[active] += 1
        self.stale[active] += 1
        moved = active[taken]
        if len(moved):
            self.weights[moved], self.loss[moved] = trial[taken], loss[taken]
            self.moment[moved] = gradient[taken]
            self.gram[moved] = _gram(trial[taken], self.sparse) * self.inflation
            self._keep_best(moved)

    def _damp(self, active: Tensor, taken: Tensor, gain: Tensor) -> None:
        up, down = active[~taken], active[taken]
        self.damping[up] *= self.growth[up]
        self.growth[up] *= 2.0
        self.damping[down] *= torch.clamp(1.0 - (2.0 * gain[taken] - 1.0) ** 3, min=1.0 / 3.0)
        self.growth[down] = 2.0

    def _keep_best(self, moved: Tensor) -> None:
        held_out = _squares(self.weights[moved], self.held_out)
        # Better by at least a thousandth: creeping along a flat valley is not progress.
        gained = held_out < self.best_held_out[moved] * (1.0 - 1e-3)
        better = moved[held_out < self.best_held_out[moved]]
        self.stale[moved[gained]] = 0
        self.best_held_out[moved] = torch.minimum(held_out, self.best_held_out[moved])
        self.best_weights[better] = self.weights[better]

    def run(self, iterations: int, patience: int) -> None:
        """Iterate until the held-out error of every restart has stopped falling."""
        for _ in range(iterations):
            running = (self.stale < patience) & (self.damping < 1e12)
            if not running.any():
                return
            self.step(torch.nonzero(running).squeeze(1))


def train(
    weights: FloatArray,
    data: Samples,
    held_out: Samples,
    max_iter: int,
    patience: int,
    seed: int,
) -> Training:
    """Train all restarts from `weights` (R, 4 H + 1), early stopping on `held_out`.

    Most restarts show early, on few samples, that they will not win. So they run in rounds
    (successive halving, Jamieson and Talwalkar 2016): each round takes the best of the one
    before, by held-out error, with more samples and more steps. A restart that was dropped
    keeps the errors that it had.
    """
    generator = torch.Generator().manual_seed(seed)
    order = torch.randperm(len(data.y), generator=generator)
    judges = torch.randperm(len(held_out.y), generator=generator)
    best = torch.as_tensor(weights).clone()
    restarts, size = best.shape
    error = torch.full((restarts,), torch.inf, dtype=best.dtype)
    count = torch.zeros(restarts, dtype=torch.long)
    for kept, points, steps in _ROUNDS:
        chosen = torch.argsort(error, stable=True)[: max(1, math.ceil(kept * restarts))]
        few = max(int(points * len(order)), 10 * size)
        some = judges[: max(int(points * len(judges)), 5 * size)]
        state = _State(best[chosen].clone(), data.part(order[:few]), held_out.part(some))
        state.run(max(1, int(steps * max_iter)), patience)
        best[chosen] = state.best_weights
        error[chosen] = _squares(best[chosen], held_out)
        count[chosen] += state.iterations
    loss = _squares(best, data)
    return Training(
        best.numpy(),
        (loss / data.w.square().sum()).sqrt().numpy(),
        (error / held_out.w.square().sum()).sqrt().numpy(),
        count.numpy(),
    )
