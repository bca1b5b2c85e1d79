"""All forms of all effects along the logs, and along twins of the model, as one linear problem."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np

from sysid.diagnosis.actuator.columns import Columns, FormColumns, Proposal
from sysid.diagnosis.actuator.equation_error import CHANNELS
from sysid.diagnosis.actuator.misfit import ResidualChannel, rise, weights_of
from sysid.diagnosis.actuator.null_distribution import MARGIN, Null
from sysid.diagnosis.actuator.projection import Projected, channel_squares
from sysid.diagnosis.actuator.signatures import Candidate, Signatures
from sysid.diagnosis.search_record import Recorder
from sysid.diagnosis.thresholds import IMITATED
from sysid.parallel import attempt_in_threads, in_threads, spend
from sysid.plant.effects.entry import CatalogueEffect
from sysid.types import FloatArray

_Made = TypeVar("_Made")

# A form with a state takes as long as so many without.
_OF_A_STATE = 10
# A few effects span fewer directions than what a model may lack: the whole catalogue spans 13 to 15
# in a chamber's balance, and 25 in the torque's (`Columns.directions`).
_DIRECTIONS = 12.0


@dataclass(frozen=True)
class Screening:
    """The forms that could be screened, in the order of the blocks of `columns`."""

    forms: tuple[Candidate, ...]
    columns: Columns

    def without(self, names: Collection[str]) -> Screening:
        """The same without some effects."""
        kept = [i for i, form in enumerate(self.forms) if form.id not in names]
        if len(kept) == len(self.forms):
            return self
        return Screening(tuple(self.forms[i] for i in kept), self.columns.of(kept))

    def among(self, channels: tuple[ResidualChannel, ...]) -> Screening:
        """The same with what is known of the channels' noise."""
        return replace(self, columns=self.columns.among(channels))

    def effects(self, proposal: Proposal) -> list[CatalogueEffect]:
        """The effects of a proposed set: a threshold is where it was screened."""
        pairs = zip(proposal.forms, proposal.strengths, strict=True)
        return [_effect(self.forms[f], own) for f, own in pairs]


def _effect(form: Candidate, strengths: FloatArray) -> CatalogueEffect:
    values = {}
    for q, (name, step), own in zip(form.effect.strengths(), form.steps, strengths, strict=True):
        value = step if q.grid else float(own) * q.usual_size
        values[name] = float(np.clip(value, q.lower, q.upper))
    return form.effect.neutral(**dict(form.shape) | values)


def noise_channels(
    base: Projected, null: Null, none: FloatArray, directions: FloatArray
) -> tuple[ResidualChannel, ...]:
    """Each channel's rows, draws and noise: the mean square of the twin with most.

    `none` (channels,): the squares that the model without effects leaves; `directions` (channels,)
    those of all forms.
    """
    frame, expected, found = base.frame, null.expected(base), []
    for name, origin, most in zip(CHANNELS, none, directions, strict=True):
        rows = frame.rows(name)
        tests = len(np.unique(frame.windows[name].run))
        square = float(np.mean(expected[rows])) if tests else 1.0
        draws = max(min(float(tests), max(float(most), _DIRECTIONS)), 1.0)
        found.append(ResidualChannel(rows.stop - rows.start, draws, square, float(origin)))
    return tuple(found)


def screened(
    base: Projected,
    forms: Sequence[Candidate],
    channels: tuple[ResidualChannel, ...],
    recorder: Recorder,
    known: dict[str, Signed] | None = None,
) -> Screening:
    """Every form's columns against a residual. Raises OutOfBudgetError.

    `known`: signatures of effects without any other, which serve again given a set,
    and to which what is computed here is added. Effects that cannot be screened are noted, those
    that show in no test omitted.
    """
    signed = {} if known is None else known
    names = list(dict.fromkeys(form.id for form in forms))
    new = [form for form in forms if form.id not in signed]
    signed |= _of_each([base], new, recorder, _signed)[0]
    # What shows in none of the tests, as friction where nothing moves, they cannot judge.
    names = [name for name in names if name in signed and signed[name].columns.any()]
    parts = in_threads(lambda name: _projections(base, signed[name]), names)
    kept = tuple(form for part in parts for form in part.forms)
    size = sum(part.gradient.shape[1] for part in parts)
    recorder.screened += names
    squares = channel_squares(base, base.rest)
    gram, gradient = np.zeros((len(CHANNELS), size, size)), np.zeros((len(CHANNELS), size))
    for place, name in enumerate(CHANNELS):
        rows = base.frame.rows(name)
        own = np.hstack([part.columns[rows] for part in parts])
        acts = np.flatnonzero(np.any(own != 0.0, axis=0))
        used = own[:, acts].astype(float)
        gram[place][np.ix_(acts, acts)] = used.T @ used
        gradient[place, acts] = used.T @ base.rest[rows]
    blocks = tuple(_blocks(kept))
    columns = Columns(channels, blocks, gram, gradient, squares, np.zeros(len(blocks)))
    return Screening(kept, columns)


@dataclass(frozen=True)
class Signed:
    """An effect's forms with their signatures (rows, m) of one usual size.

    Whitened, but friction's scatter is not weighed yet, nor anything projected out.
    """

    forms: tuple[Candidate, ...]
    columns: FloatArray


@dataclass(frozen=True)
class _Projections:
    """An effect's forms with their columns (rows, m) of one usual size, projected; gradients and
    lengths by channel (channels, m)."""

    forms: tuple[Candidate, ...]
    columns: FloatArray
    gradient: FloatArray
    length: FloatArray


def _of_each(
    bases: Sequence[Projected],
    forms: Sequence[Candidate],
    recorder: Recorder,
    job: Callable[[Projected, FloatArray, Sequence[Candidate]], _Made],
) -> list[dict[str, _Made]]:
    """By residual, job(residual, its errors in the bare frame, forms) of the forms of each effect.

    All at once: no core waits for the last effect of a residual. Raises OutOfBudgetError.
    """
    # The forms of one effect stay together: those on both sides build on those on either.
    groups = [list(group) for _, group in itertools.groupby(forms, key=lambda f: f.id)]
    if not groups:
        return [{} for _ in bases]
    # What takes long begins first.
    order = sorted(range(len(groups)), key=lambda i: -_duration(groups[i]))
    errors = in_threads(lambda base: base.frame.bare.residual(base.model), bases)
    pairs = zip(bases, errors, strict=True)
    done = attempt_in_threads(partial(job, *pair, groups[i]) for pair in pairs for i in order)
    names, found = [group[0].id for group in groups], []
    for first in range(0, len(done), len(order)):
        tried = dict(zip(order, done[first : first + len(order)], strict=True))
        found.append(dict(recorder.results(names, [tried[i] for i in range(len(order))])))
    spend(0)
    return found


def _duration(forms: Sequence[Candidate]) -> int:
    return len(forms) * (_OF_A_STATE if forms[0].effect.states else 1)


def _signed(base: Projected, errors: FloatArray, forms: Sequence[Candidate]) -> Signed:
    signatures = Signatures(base.frame.bare, base.model, errors)
    columns = [signatures(form) / _steps_in_usual_sizes(form) for form in forms]
    return Signed(tuple(forms), np.hstack(columns).astype(np.float32))


def _screened(base: Projected, errors: FloatArray, forms: Sequence[Candidate]) -> _Projections:
    return _projections(base, _signed(base, errors, forms))


def _projections(base: Projected, signed: Signed) -> _Projections:
    plain = base.frame.scattered(signed.columns.astype(float))
    columns = base.project(plain)
    imitated = np.linalg.norm(columns, axis=0) <= IMITATED * np.linalg.norm(plain, axis=0)
    columns[:, imitated] = 0.0
    rows = [base.frame.rows(name) for name in CHANNELS]
    gradient = np.array([columns[own].T @ base.rest[own] for own in rows])
    length = np.array([np.linalg.norm(columns[own], axis=0) for own in rows])
    return _Projections(signed.forms, columns.astype(np.float32), gradient, length)


def _steps_in_usual_sizes(form: Candidate) -> FloatArray:
    """(strengths,): the probing sizes over the usual ones."""
    strengths = form.effect.strengths()
    return np.array(
        [step / q.usual_size for q, (_, step) in zip(strengths, form.steps, strict=True)]
    )


def _blocks(forms: Sequence[Candidate]) -> Iterator[FormColumns]:
    first = 0
    for form in forms:
        strengths = form.effect.strengths()
        sizes = np.array([q.usual_size for q in strengths])
        lower = np.array([q.lower for q in strengths])
        upper = np.array([q.upper for q in strengths])
        yield FormColumns(
            form.id,
            range(first, first + len(strengths)),
            lower / sizes,
            upper / sizes,
            frozenset(form.neutral().states),
            form.is_plain,
        )
        first += len(strengths)


class Bias:
    """What the columns' gradients are where nothing is missing, as twins show them.

    What smoothing and windows put into a balance looks like some effects, on twins as on the logs.
    Each effect is screened on the twins once it is asked for.
    """

    def __init__(self, twins: Sequence[Projected]) -> None:
        self._twins: Sequence[Projected] = twins
        # (twins, channels, columns) of each effect, in standard deviations of the columns.
        self._known: dict[str, FloatArray] = {}

    @property
    def known(self) -> Collection[str]:
        """The effects that have been screened on the twins."""
        return self._known.keys()

    def ask(self, names: Collection[str], forms: Sequence[Candidate], recorder: Recorder) -> None:
        """Screen the twins for these effects. Raises OutOfBudgetError."""
        own = [f for f in forms if f.id in names]
        parts = _of_each(self._twins, own, recorder, _screened)
        for name in names:
            if all(name in part for part in parts):
                # A twin's column is as long as it moves.
                self._known[name] = np.array(
                    [p[name].gradient / np.maximum(p[name].length, 1e-300) for p in parts]
                )

    def without_twins(self) -> None:
        """Let go of the twins, which are large; what was asked stays known."""
        self._twins = ()

    def counted(self, some: Screening) -> Screening:
        """The same with what its known effects gain where nothing is missing."""
        columns = some.columns
        known = [f for f, form in enumerate(some.forms) if form.id in self._known]
        chance = np.zeros(len(some.forms))
        for f, alone in zip(known, columns.proposals([(f,) for f in known]), strict=True):
            weights = weights_of(columns.channels, alone.squares)
            chance[f] = rise(columns.channels, alone.squares, self.gained(some, (f,), weights))
        return replace(some, columns=columns.with_chance(chance))

    def gained(self, some: Screening, forms: Sequence[int], weights: FloatArray) -> FloatArray:
        """The squares (channels,) that forms may explain together where nothing is missing, fitted
        with the channels at weights (channels,).

        As much as on the twins, in the mean, whose root a rig's own numerics may exceed; 0
        of those that were not asked for.
        """
        own: list[int] = []
        parts = []
        for block in (some.columns.blocks[form] for form in forms):
            every = _columns_of(some.columns, block.name)
            shown = self._known.get(block.name)
            if shown is not None and len(every) == shown.shape[2]:
                own += block.columns
                parts.append(shown[:, :, [every.index(i) for i in block.columns]])
        if not own:
            return np.zeros(len(weights))
        gradients = np.concatenate(parts, axis=2) * _lengths(some.columns, own)
        grams = some.columns.gram[:, own][:, :, own]
        gram = np.einsum("c,cij->ij", weights, grams)
        slopes = np.einsum("c,tci->it", weights, gradients)
        found = np.linalg.solve(gram + np.eye(len(own)), slopes)
        falls = 2.0 * np.einsum("tci,it->ct", gradients, found)
        falls -= np.einsum("it,cij,jt->ct", found, grams, found)
        return np.asarray(MARGIN**2 * np.mean(falls, axis=1))


def _columns_of(columns: Columns, name: str) -> list[int]:
    return [i for block in columns.blocks if block.name == name for i in block.columns]


def _lengths(columns: Columns, own: Sequence[int]) -> FloatArray:
    """(channels, k)."""
    return np.sqrt([np.diag(gram)[own] for gram in columns.gram])


__all__ = ["Bias", "Screening", "noise_channels", "screened"]
