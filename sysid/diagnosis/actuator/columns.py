"""Every form of every effect as columns of one linear problem, channel by channel.

A strength has a normal prior of one usual size about 0, so that a set's marginal likelihood is that
of Laplace's approximation: exact but for the weights of the channels, which follow from what is
left (iteratively reweighted least squares).
"""

from __future__ import annotations

import functools
import itertools
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sysid.diagnosis.actuator.misfit import ResidualChannel, cost, weights_of
from sysid.estimation.law_evidence import ODDS
from sysid.types import BoolArray, FloatArray, IntArray

_PASSES = 6
# A pass that lowers minus twice the log likelihood by less changes no decision.
_SETTLED = 1e-2


@dataclass(frozen=True)
class FormColumns:
    """A form of an effect: the effect's name, its columns, and what it may not be combined with.

    `lower`, `upper` (k,): bounds of its strengths, in usual sizes. `claims`: of two forms that
    claim the same, only one may be there. `is_plain`: whether its choices are the effect's usual
    ones.
    """

    name: str
    columns: range
    lower: FloatArray
    upper: FloatArray
    claims: frozenset[str]
    is_plain: bool = True


@dataclass(frozen=True)
class Proposal:
    """A set of forms (their numbers), strengths in usual sizes, and twice its log evidence.

    `squares` (channels,): the remaining sum of squares of each.
    """

    forms: tuple[int, ...]
    strengths: tuple[FloatArray, ...]
    evidence: float
    squares: FloatArray


@dataclass(frozen=True, eq=False)
class Columns:
    """The normal equations of all forms, (channels, m, m), (channels, m), squares (channels,).

    Of a residual r and columns X of one usual size each: X'X, X'r and r'r, channel by channel. The
    residual of strengths s is r + X s. `chance` (blocks,): twice the log of what each gains where
    nothing is missing. `solved` keeps every set that was asked for, its evidence without `penalty`.
    """

    channels: tuple[ResidualChannel, ...]
    blocks: tuple[FormColumns, ...]
    gram: FloatArray
    gradient: FloatArray
    squares: FloatArray
    chance: FloatArray
    solved: dict[tuple[int, ...], Proposal] = field(default_factory=dict, repr=False)

    def of(self, blocks: Sequence[int]) -> Columns:
        """The columns of some blocks alone."""
        own = [self.blocks[b] for b in blocks]
        index = np.array([i for block in own for i in block.columns], dtype=int)
        edges = np.cumsum([0, *(len(block.columns) for block in own)]).tolist()
        moved = (
            replace(b, columns=range(*e))
            for b, e in zip(own, itertools.pairwise(edges), strict=True)
        )
        return Columns(
            self.channels,
            tuple(moved),
            self.gram[:, index[:, None], index],
            self.gradient[:, index],
            self.squares,
            self.chance[list(blocks)],
        )

    def among(self, channels: tuple[ResidualChannel, ...]) -> Columns:
        """The same with what is known of the channels' noise."""
        return replace(self, channels=channels, solved={})

    def with_chance(self, chance: FloatArray) -> Columns:
        """The same with what each block (blocks,) gains where nothing is missing."""
        return replace(self, chance=chance)

    def directions(self) -> FloatArray:
        """(channels,): in how many directions a channel's columns lie, every effect counting alike.

        The exponential of the entropy of the shares of their principal components.
        """
        forms = Counter(block.name for block in self.blocks)
        share = np.array(
            [1.0 / forms[b.name] / len(b.columns) for b in self.blocks for _ in b.columns]
        )
        return np.array([_directions(gram, share) for gram in self.gram])

    @functools.cached_property
    def tried(self) -> FloatArray:
        """(blocks,): what evidence for a block has to exceed whatever it gains on twins.

        Odds of 20 to 1, and twice the log of how many effects, and forms of the effect, were tried:
        the best of so many gains as much by chance. The same odds for a form over the plain one:
        an interval of its strength says nothing of a choice that is wrong.
        """
        forms = Counter(block.name for block in self.blocks)
        counts = [2.0 * math.log(len(forms) * forms[block.name]) for block in self.blocks]
        odds = [ODDS if block.is_plain else 2.0 * ODDS for block in self.blocks]
        return np.asarray(np.add(odds, counts))

    @functools.cached_property
    def penalty(self) -> FloatArray:
        """(blocks,): what evidence for a block has to exceed, its `chance` with it."""
        return np.asarray(self.tried + self.chance)

    @functools.cached_property
    def lower(self) -> FloatArray:
        """(m,)."""
        return np.concatenate([block.lower for block in self.blocks])

    @functools.cached_property
    def upper(self) -> FloatArray:
        """(m,)."""
        return np.concatenate([block.upper for block in self.blocks])

    def proposals(self, sets: Sequence[tuple[int, ...]]) -> list[Proposal]:
        """Each set of forms, at its strengths; -inf where one of its forms has none."""
        unknown = [forms for forms in sets if forms not in self.solved]
        columns = {f: tuple(i for b in f for i in self.blocks[b].columns) for f in unknown}
        for _, group in itertools.groupby(
            sorted(columns, key=lambda f: len(columns[f])), key=lambda f: len(columns[f])
        ):
            own = list(group)
            self.solved.update(self._solved(own, np.array([columns[f] for f in own])))
        penalty = self.penalty.tolist()
        found = [(self.solved[forms], sum(penalty[f] for f in forms)) for forms in sets]
        return [Proposal(p.forms, p.strengths, p.evidence - less, p.squares) for p, less in found]

    def _solved(
        self, sets: Sequence[tuple[int, ...]], index: IntArray
    ) -> Iterator[tuple[tuple[int, ...], Proposal]]:
        """Sets with as many columns each, (k, size); what twins gain is not subtracted."""
        gram = self.gram[:, index[:, :, None], index[:, None, :]]
        gradient = self.gradient[:, index]
        none = np.broadcast_to(self.squares, (len(index), len(self.squares)))
        squares, best = none, np.full(len(index), math.inf)
        strengths, log_det = np.zeros(index.shape), np.zeros(len(index))
        left, present = np.array(none), np.zeros(index.shape, dtype=bool)
        for _ in range(_PASSES):
            weights = weights_of(self.channels, squares)
            curvature = np.einsum("kc,ckij->kij", weights, gram)
            slope = np.einsum("kc,cki->ki", weights, gradient)
            moved, free, size = self._bounded(curvature, slope, index)
            squares = none + np.einsum(
                "ki,cki->kc", moved, 2.0 * gradient + np.einsum("ckij,kj->cki", gram, moved)
            )
            squares = np.maximum(squares, 0.0)
            total = cost(self.channels, squares) + np.sum(moved**2, axis=1)
            better = total < best - _SETTLED
            best = np.where(better, total, best)
            strengths[better], log_det[better] = moved[better], size[better]
            left[better], present[better] = squares[better], free[better]
            if not better.any():
                break
        evidence = (float(cost(self.channels, self.squares)) - best - log_det).tolist()
        for k, forms in enumerate(sets):
            yield forms, self._proposal(forms, strengths[k], present[k], evidence[k], left[k])

    def _bounded(
        self, curvature: FloatArray, slope: FloatArray, index: IntArray
    ) -> tuple[FloatArray, BoolArray, FloatArray]:
        """Strengths (k, size) with their prior, which of them are there, and the log determinant.

        One that would have to leave a bound at 0 is absent.
        """
        eye = np.eye(index.shape[1])
        low, high = self.lower[index], self.upper[index]
        free = np.ones(index.shape, dtype=bool)
        while True:
            both = free[:, :, None] & free[:, None, :]
            matrix = np.where(both, curvature, 0.0) + eye
            found = -np.linalg.solve(matrix, np.where(free, slope, 0.0)[:, :, None])[:, :, 0]
            wrong = free & (((found < 0.0) & (low == 0.0)) | ((found > 0.0) & (high == 0.0)))
            if not wrong.any():
                break
            free &= ~wrong
        size = np.linalg.slogdet(matrix)[1]
        return np.clip(found, low, high), free, size

    def _proposal(
        self,
        forms: tuple[int, ...],
        strengths: FloatArray,
        present: BoolArray,
        evidence: float,
        squares: FloatArray,
    ) -> Proposal:
        edges = np.cumsum([0, *(len(self.blocks[f].columns) for f in forms)])
        own = [slice(*pair) for pair in itertools.pairwise(edges)]
        if not all(present[part].any() for part in own):
            evidence = -math.inf
        parts = tuple(strengths[part] for part in own)
        return Proposal(forms, parts, evidence, squares)


def _directions(gram: FloatArray, share: FloatArray) -> float:
    """Of columns (m,) by their Gram matrix, each counted by its `share`."""
    acts = np.diag(gram) > 0.0
    if not acts.any():
        return 1.0
    size = np.sqrt(share[acts] / np.diag(gram)[acts])
    parts = np.linalg.eigvalsh(size[:, None] * gram[np.ix_(acts, acts)] * size)
    parts = parts[parts > 0.0] / np.sum(parts[parts > 0.0])
    return float(np.exp(-np.sum(parts * np.log(parts))))


__all__ = ["ODDS", "Columns", "FormColumns", "Proposal"]
