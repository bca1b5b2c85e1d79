"""Signatures: how the residual changes with an effect's strength, or with a base parameter."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.diagnosis.actuator.equation_error import (
    EFFORT,
    FLOW_PARAMETERS,
    FRICTION_PARAMETERS,
    channels_of,
)
from sysid.diagnosis.actuator.whitening import Frame
from sysid.diagnosis.thresholds import PROBE
from sysid.io.channels import SIDES
from sysid.plant.effects.entry import SIDE_CHOICES, CatalogueEffect
from sysid.plant.ports import Model
from sysid.types import FloatArray

_BASE_STEP = 0.01
_NO_LENGTHS = np.zeros(0)


@dataclass(frozen=True)
class Candidate:
    """An effect of one form: its class, its side, its shape, and where strengths are probed.

    `shape`: field and value of each shape parameter, and of the side. `steps`: field and
    probing size of each strength.
    """

    effect: type[CatalogueEffect]
    shape: tuple[tuple[str, Any], ...]
    steps: tuple[tuple[str, float], ...]

    @property
    def id(self) -> str:
        return self.effect.id

    @property
    def is_plain(self) -> bool:
        """Whether the choices that have a plain form are in it."""
        chosen = dict(self.shape)
        return all(q.plain in (None, chosen.get(q.name, q.plain)) for q in self.effect.shapes())

    def on(self, side: str) -> Candidate:
        """The same form on another side."""
        shape = tuple((n, side if n == "side" else v) for n, v in self.shape)
        return Candidate(self.effect, shape, self.steps)

    def neutral(self) -> CatalogueEffect:
        """The effect in this form at neutral strength."""
        return self.effect.neutral(**dict(self.shape))

    def with_strengths(self, coefficients: Sequence[float]) -> CatalogueEffect:
        """The effect with its strengths, each given in units of its probing size."""
        strengths = {n: c * s for (n, s), c in zip(self.steps, coefficients, strict=True)}
        return self.effect.neutral(**dict(self.shape) | strengths)


def candidates(
    catalogue: Iterable[type[CatalogueEffect]],
    travel: float = math.inf,
    sides: Sequence[str] = SIDES,
    flows: float = 1.0,
    lengths: FloatArray = _NO_LENGTHS,
) -> list[Candidate]:
    """Every form of every effect that screening tries, on logs that visit so much of the position
    (rad or m), of a rig with the chambers `sides` and so many times the reference rig's `flows`,
    and whose valves' commands and pauses last so long (`lengths`, (n,) s).
    """
    found = []
    chambers = SIDE_CHOICES if len(sides) > 1 else tuple(sides)
    for effect in catalogue:
        quantities = effect.within(travel)
        if quantities is None or not effect.is_of(sides):
            continue
        axes: list[list[tuple[str, Any]]] = []
        if effect.has_side():
            choices = SIDE_CHOICES if effect.is_of_an_end else chambers
            axes.append([("side", side) for side in choices])
        for quantity in (q for q in quantities if not q.is_strength):
            values = quantity.grid or (quantity.typical,)
            axes.append([(quantity.name, value) for value in values])
        strengths = [
            [(q.name, s) for s in (q.grid or (PROBE * q.typical,))]
            for q in (q.at_flows(flows).at_lengths(lengths) for q in effect.strengths())
        ]
        found += [
            Candidate(effect, shape, steps)
            for shape in itertools.product(*axes)
            for steps in itertools.product(*strengths)
        ]
    return found


def one_form_each(forms: Sequence[Candidate]) -> list[Candidate]:
    """Of each effect, side and size the form in the middle of those that are tried."""
    groups: dict[tuple[Any, ...], list[Candidate]] = {}
    for form in forms:
        side = dict(form.shape).get("side")
        groups.setdefault((form.id, side, form.steps), []).append(form)
    return [group[len(group) // 2] for group in groups.values()]


class Signatures:
    """Signatures of forms along one frame, each computed once.

    To first order an effect on both sides is the sum of the effects on either side, if it does not
    act between them.
    """

    def __init__(self, frame: Frame, model: Model, base: FloatArray) -> None:
        self._frame, self._model, self._base = frame, model, base
        self._known: dict[Candidate, FloatArray] = {}

    def __call__(self, candidate: Candidate) -> FloatArray:
        """Change of the whitened residual with each strength, (rows, strengths)."""
        sides = dict(candidate.shape).get("side")
        if sides != "both" or candidate.effect.is_between_sides:
            found = self._known.get(candidate)
            if found is None:
                found = signature(self._frame, self._model, self._base, candidate)
                if sides is not None:
                    self._known[candidate] = found
            return found
        return np.asarray(sum(self(candidate.on(side)) for side in SIDES))


def signature(frame: Frame, model: Model, base: FloatArray, candidate: Candidate) -> FloatArray:
    """Change of the whitened residual with each strength, (rows, strengths).

    Per probing size; `base` (rows,) is the residual of the model without the effect. Each strength
    is probed on top of those before it, so that all together are as they are: a valve that opens
    and closes later by as much changes far less than either delay alone.
    """
    channels = channels_of(candidate.neutral(), model.effects)
    columns, before, count = [], base, len(candidate.steps)
    for i in range(count):
        probed = candidate.with_strengths([float(j <= i) for j in range(count)])
        changed = frame.residual(model + probed, channels)
        column = np.zeros(len(base))
        for name in channels:
            rows = frame.rows(name)
            column[rows] = changed[rows] - before[rows]
        columns.append(column)
        before = changed
    return np.column_stack(columns)


def base_parameters(model: Model) -> tuple[str, ...]:
    """The base parameters that a fit estimated: friction, and the flows of both valves."""
    names = FRICTION_PARAMETERS + FLOW_PARAMETERS
    values = {n: getattr(model.parameters, n) for n in names}
    return tuple(n for n, v in values.items() if v is not None and float(v) > 0.0)


def channel_of(name: str) -> str:
    """The balance that a base parameter belongs to."""
    return EFFORT if name in FRICTION_PARAMETERS else f"rate_{name[-1]}"


def base_jacobian(frame: Frame, model: Model, base: FloatArray, names: Sequence[str]) -> FloatArray:
    """Change of the whitened residual per relative change of each base parameter."""
    columns = []
    for name in names:
        channel = channel_of(name)
        value = getattr(model.parameters, name)
        changed = Model(
            model.parameters.replace(**{name: value * (1.0 + _BASE_STEP)}), model.effects
        )
        column = np.zeros(len(base))
        moved, rows = frame.residual(changed, (channel,)), frame.rows(channel)
        column[rows] = (moved[rows] - base[rows]) / _BASE_STEP
        columns.append(column)
    return np.column_stack(columns)


__all__ = [
    "Candidate",
    "Signatures",
    "base_jacobian",
    "base_parameters",
    "candidates",
    "channel_of",
]
