"""What static and dynamic components share as a `Component` of the diagnosis."""

from __future__ import annotations

import dataclasses
import functools
import math
from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sysid import signals
from sysid.components.definition import OwnComponent, Term
from sysid.components.loading import LoadedComponent
from sysid.diagnosis.bench.component import Component, Law, rmse
from sysid.diagnosis.bench.stability import pieces_of
from sysid.errors import NotIdentifiedError
from sysid.estimation.linear import Estimate
from sysid.estimation.nonlinear import Parameter
from sysid.estimation.quality import FitQuality
from sysid.io.logs import Trial
from sysid.parameters import Bundle, ComponentRecord, EffectEntry, Parts
from sysid.parameters.effects import effect_from_entry, entry_of
from sysid.parameters.quality import quality_field
from sysid.plant.effects.entry import CatalogueEffect, Quantity
from sysid.types import FloatArray

_TERM_MODULE = "sysid_user_terms"


@dataclass(frozen=True)
class Stretch:
    """Rows `start` to `stop` of a trial that are excluded together: all of it, or a part."""

    label: str
    trial: Trial
    start: int
    stop: int

    @property
    def rows(self) -> slice:
        """Its rows of the trial."""
        return slice(self.start, self.stop)


@dataclass(frozen=True)
class OwnPart(Component):
    """A component of the user's own on its tests.

    `kept`: ids of the terms that its law already holds; their quantities are parameters, named
    `TERM/QUANTITY`. `scales` (outputs,): what a residual of each output is divided by, so that
    several count alike: the spreads of the training tests; 1 for a single one.
    """

    loaded: LoadedComponent
    stretches: tuple[Stretch, ...]
    scales: tuple[float, ...]
    kept: tuple[str, ...] = ()
    channel: str = field(default="", init=False)
    unit: str = field(default="", init=False)

    def __post_init__(self) -> None:
        outputs = self.definition.outputs
        one = len(outputs) == 1
        object.__setattr__(self, "channel", " and ".join(outputs))
        unit = self.definition.columns[outputs[0]].unit if one else "of the spread"
        object.__setattr__(self, "unit", unit)

    @property
    def own_columns(self) -> Mapping[str, str]:  # type: ignore[override]
        return dict(self.loaded.columns)

    @property
    def outputs(self) -> tuple[tuple[str, float], ...]:
        return tuple(zip(self.definition.outputs, self.scales, strict=True))

    @property
    def definition(self) -> OwnComponent:
        """The user's own class, as an object."""
        return self.loaded.definition

    @property
    def tests(self) -> tuple[str, ...]:
        return tuple(s.label for s in self.stretches)

    @property
    def trials(self) -> tuple[Trial, ...]:
        """Its whole trials, in turn."""
        return tuple({id(s.trial): s.trial for s in self.stretches}.values())

    def parameters(self) -> list[Parameter]:
        found = list(self.definition.parameters)
        for term in self.definition.terms:
            if term.id in self.kept:
                found += [
                    Parameter(_key(term, q), _start(q), q.unit, q.lower, q.upper, abs(q.typical))
                    for q in term.quantities
                ]
        return found

    def effects(
        self, catalogue: Mapping[str, type[CatalogueEffect]]
    ) -> tuple[type[CatalogueEffect], ...]:
        """The terms that its law does not hold; those of the catalogue act on our equations."""
        return tuple(term_class(t) for t in self.definition.terms if t.id not in self.kept)

    @abstractmethod
    def predicted(self, law: Law, tests: Sequence[int]) -> list[dict[str, FloatArray]]:
        """Each output on the rows that count of each of `tests`, in its own unit, (n,)."""

    @abstractmethod
    def shown(self, tests: Sequence[int]) -> list[dict[str, FloatArray]]:
        """Each output as measured there, (n,)."""

    @abstractmethod
    def open_loop(
        self, law: Law, pieces: Sequence[tuple[Trial, int, int]]
    ) -> list[dict[str, FloatArray]]:
        """Each output on every row from the first to the last of pieces of trials, (n,)."""

    @abstractmethod
    def unbounded(self, law: Law) -> Iterator[tuple[Trial, int, FloatArray]]:
        """Trial, its first row and the outputs (n, outputs) from there, as the law gives them."""

    def is_far(self, outputs: FloatArray) -> NDArray[np.bool_]:
        """Whether each of (..., outputs) is not finite, or far beyond the measured range."""
        largest = [np.max([np.max(np.abs(t[n])) for t in self.trials]) for n in self._outputs]
        # Farther beyond the largest measured value a prediction is invalid: its square overflows.
        return ~(np.abs(outputs) <= 1e12 * np.where(largest, largest, 1.0))

    def bounded(self, outputs: FloatArray) -> FloatArray:
        """(..., outputs) with what `is_far` set far off, so that a fit steps back from there."""
        far = self.is_far(outputs)
        if not far.any():
            return outputs
        spread = [np.std(np.concatenate([t[n] for t in self.trials])) or 1.0 for n in self._outputs]
        # What a residual counts, in spreads of its output, where a law gives no number.
        return np.where(far, 1e3 * np.array(spread), outputs)

    @property
    def _outputs(self) -> tuple[str, ...]:
        return self.definition.outputs

    def residuals(self, law: Law, tests: Sequence[int]) -> list[FloatArray]:
        return self._scaled_residuals(self.predicted(law, tests), tests)

    def _scaled_residuals(
        self, predicted: Iterable[Mapping[str, FloatArray]], tests: Sequence[int]
    ) -> list[FloatArray]:
        found = []
        for modelled, measured in zip(predicted, self.shown(tests), strict=True):
            gaps = [measured[n] - modelled[n] for n in self.definition.outputs]
            found.append(np.concatenate([g / s for g, s in zip(gaps, self.scales, strict=True)]))
        return found

    def measured(self, tests: Sequence[int]) -> list[FloatArray]:
        zero = [{n: np.zeros(len(v)) for n, v in one.items()} for one in self.shown(tests)]
        return self._scaled_residuals(zero, tests)

    @abstractmethod
    def regressors_of(self, test: int) -> dict[str, FloatArray]:
        """What a test's residual may depend on, (n,) by name, on the rows that count."""

    def regressors(self, tests: Sequence[int]) -> dict[str, FloatArray]:
        times = len(self.definition.outputs)
        each = [self.regressors_of(t) for t in tests]
        names = each[0] if each else {}
        return {n: np.concatenate([np.tile(one[n], times) for one in each]) for n in names}

    def part(self, estimates: Mapping[str, Estimate], quality: FitQuality | None = None) -> Parts:
        own = {p.name: estimates[p.name] for p in self.definition.parameters}
        record = ComponentRecord.model_validate(
            {
                "kind": self.loaded.kind,
                "name": self.loaded.name,
                **({"file": self.loaded.file} if self.loaded.file else {}),
                **({"sha256": self.loaded.sha256} if self.loaded.sha256 else {}),
                "parameters": own,
                **quality_field(quality),
            }
        )
        return Parts(component=record)

    def renewed(
        self, bundle: Bundle, estimates: Mapping[str, Estimate], quality: FitQuality | None = None
    ) -> Bundle:
        """Also with the numbers of the terms that the law held before."""
        found = super().renewed(bundle, estimates, quality)
        return self.with_numbers(found, estimates) if self.kept else found

    def with_numbers(self, bundle: Bundle, estimates: Mapping[str, Estimate]) -> Bundle:
        """A bundle with other numbers of the parameters, and of the terms that it holds.

        What was not identified this time, as it ended at a bound, keeps its number.
        """
        record = bundle.component
        assert record is not None
        own = {
            name: estimates[name] if estimates[name].identified else before
            for name, before in record.parameters.items()
        }
        return bundle.replaced(
            component=record.replaced(parameters=own),
            effects=[self._renewed_entry(entry, estimates) for entry in bundle.effects],
        )

    def _renewed_entry(self, entry: EffectEntry, estimates: Mapping[str, Estimate]) -> EffectEntry:
        if entry.id not in self.kept:
            return entry
        term = self.term(entry.id)
        found = {q.name: estimates[_key(term, q)] for q in term.quantities}
        if not all(estimate.identified for estimate in found.values()):
            return entry
        numbers = {name: estimate.value for name, estimate in found.items()}
        return entry.replaced(parameters=entry_of(term_class(term)(**numbers), found).parameters)

    def law_of(self, bundle: Bundle) -> Law:
        """The law that a bundle holds, with the terms in it. Raises NotIdentifiedError."""
        values = {}
        held = bundle.component.parameters if bundle.component is not None else {}
        for parameter in self.definition.parameters:
            estimate = held.get(parameter.name)
            if estimate is None or not estimate.identified:
                reason = "the bundle does not hold it" if estimate is None else estimate.reason
                raise NotIdentifiedError(
                    f"component {self.loaded.kind}: {parameter.name} is not identified ({reason}); "
                    f"fit {self.loaded.kind} tests into the bundle"
                )
            values[parameter.name] = estimate.value
        for effect in effects_in(bundle, self.loaded):
            term = self.term(effect.id)
            values |= {_key(term, q): float(getattr(effect, q.name)) for q in term.quantities}
        return Law(values)

    def term(self, name: str) -> Term:
        """The term of an id."""
        return next(t for t in self.definition.terms if t.id == name)

    def numbers(self, law: Law) -> dict[str, float]:
        """Every number by name: the parameters, then the quantities of all terms, absent or not."""
        found = {p.name: law.values[p.name] for p in self.definition.parameters}
        added = {e.id: e for e in law.effects}
        for term in self.definition.terms:
            for q in term.quantities:
                key = _key(term, q)
                absent = 0.0 if q.is_strength else q.typical
                given = getattr(added.get(term.id), q.name, absent)
                found[key] = law.values.get(key, float(given))
        return found

    def active(self, law: Law) -> tuple[Term, ...]:
        """The terms in a law."""
        ids = {*self.kept, *(e.id for e in law.effects)}
        return tuple(t for t in self.definition.terms if t.id in ids)

    def further_errors(self, law: Law) -> dict[str, tuple[float, float]]:
        """Errors before and after of each of several outputs, in its own unit."""
        outputs = self.definition.outputs
        if len(outputs) == 1:
            return {}
        every = range(len(self.stretches))
        pairs = list(zip(self.shown(every), self.predicted(law, every), strict=True))
        return {n: (rmse([m[n] - p[n] for m, p in pairs]), self.noise_of(n, law)) for n in outputs}

    def noise_floor(self, law: Law) -> float:
        """The noise floor of all outputs together, each over its scale."""
        outputs = zip(self.definition.outputs, self.scales, strict=True)
        noise = [self.noise_of(name, law) / scale for name, scale in outputs]
        return math.sqrt(float(np.mean(np.square(noise))))

    @abstractmethod
    def noise_of(self, name: str, law: Law) -> float:
        """The noise of an output, in its unit."""

    def noise_as_logged(self, name: str) -> float:
        """The noise that an output's column shows by itself, in its unit; infinite: too short."""
        long = [t for t in self.trials if len(t) >= signals.FEWEST_FOR_NOISE]
        floors = [signals.noise_floor(t[name], stride=t.stride_of(name)).total for t in long]
        return math.sqrt(float(np.mean(np.square(floors)))) if floors else math.inf


def _key(term: Term, quantity: Quantity) -> str:
    return f"{term.id}/{quantity.name}"


def _start(quantity: Quantity) -> float:
    return float(np.clip(quantity.typical, quantity.lower, quantity.upper))


@functools.cache
def term_class(term: Term) -> type[CatalogueEffect]:
    """A term as an effect that the diagnosis can add."""
    return dataclasses.make_dataclass(
        term.id.title().replace("-", ""),
        [(q.name, float, 0.0 if q.is_strength else q.typical) for q in term.quantities],
        bases=(CatalogueEffect,),
        frozen=True,
        namespace={
            "__module__": _TERM_MODULE,
            "id": term.id,
            "title": term.title,
            "subsystem": "mechanics",
            "quantities": term.quantities,
            "signature": term.title,
            "tie_breaker": term.tie_breaker,
            "source": "the user's own component",
        },
    )


def effects_in(bundle: Bundle, loaded: LoadedComponent) -> list[CatalogueEffect]:
    """The terms that a bundle lists as effects. Raises InputError for one that is unknown."""
    own = {t.id: term_class(t) for t in loaded.definition.terms}
    return [effect_from_entry(entry, bundle.source, own) for entry in bundle.effects]


def stretches_of(trials: Sequence[Trial]) -> tuple[Stretch, ...]:
    """Trials to exclude one at a time; fewer than three are cut into stretches."""
    pieces = pieces_of(len(trials))
    found = []
    for trial in trials:
        count = max(1, min(pieces, len(trial) // 8))
        edges = np.linspace(0, len(trial), count + 1).astype(int)
        for k in range(count):
            found.append(Stretch(trial.title, trial, int(edges[k]), int(edges[k + 1])))
    return tuple(found)


def scales_of(loaded: LoadedComponent, trials: Sequence[Trial]) -> tuple[float, ...]:
    """The spread of each output on these trials; 1 for a single output."""
    outputs = loaded.definition.outputs
    if len(outputs) == 1:
        return (1.0,)
    spreads = (float(np.std(np.concatenate([t[n] for t in trials]))) for n in outputs)
    return tuple(s or 1.0 for s in spreads)


__all__ = [
    "OwnPart",
    "Stretch",
    "effects_in",
    "scales_of",
    "stretches_of",
    "term_class",
]
