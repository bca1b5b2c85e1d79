"""The interface of a part tested alone to the search for a missing effect."""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import TypeVar

import numpy as np

from sysid.diagnosis.lack_of_fit import multiples_of_tests
from sysid.diagnosis.thresholds import PROBE
from sysid.errors import Failure, NotIdentifiedError, on_its_own
from sysid.estimation.linear import Estimate
from sysid.estimation.nonlinear import Parameter
from sysid.estimation.quality import FitQuality
from sysid.io.rig import Rig
from sysid.parameters import Bundle, Parts
from sysid.parameters.base import Part
from sysid.parameters.scatter import MOST_SCATTER
from sysid.parameters.valves import AUTO
from sysid.plant.base import PARAMETER_NAMES, Parameters
from sysid.plant.effects.entry import CatalogueEffect, Quantity
from sysid.types import FloatArray, IntArray

Effects = tuple[CatalogueEffect, ...]
Further = dict[str, tuple[float, float]]
"""RMSE and noise floor by channel."""
NOT_SIMULATED = "held-out tests are not simulated"


@dataclass(frozen=True)
class Law:
    """A part's law: its own parameters by name, and the effects added to it."""

    values: Mapping[str, float]
    effects: Effects = ()


class Component(ABC):
    """One part, the tests of it, and its law with or without effects.

    A test is left out as a whole: a trial, or a stretch of a long one. Residuals
    are measured less modelled, in `unit`.
    """

    channel: str
    """The predicted channel, in the log format's terms."""
    unit: str
    own_columns: Mapping[str, str] = MappingProxyType({})
    """The units by the names of the columns, where a user declared both; else empty."""
    left_out: tuple[str, ...] = ()
    """Why tests that were given are not among its own, a line each."""
    precision = 0.0
    """Share of the signal's RMS below which nothing is structure, however little noise there is."""
    has_constant: bool = True
    """Whether the law has a constant of its own: the signal's spread is about its mean then."""

    takes_laws_at_once = False
    """Whether `residuals_of` many laws cost little more than of one: a fit then has the slopes with
    every step that it tries."""
    attained: frozenset[str] = frozenset()
    """The parameters at whose bounds there are such parts."""
    refuses_misfit = False
    """Whether a fit that leaves more than it explains is refused, as no effect would mend it."""

    @property
    def outputs(self) -> tuple[tuple[str, float], ...]:
        """The channels whose samples follow one another in a test's signal, as many of each, with
        the unit of the signal in that of each channel."""
        return ((self.channel, 1.0),)

    def taken_out(self, tests: Sequence[int]) -> int:
        """How many numbers the residuals of `tests` have taken out, as each test's own start."""
        return 0

    @property
    def law_name(self) -> str:
        """The law's name, of a part that has several."""
        return ""

    def forms(self, law: str = AUTO) -> Sequence[Component]:
        """The part under each law that its tests may follow, the simplest first; `law` one alone.

        On the same rows, so that their errors compare.
        """
        return (self,)

    def settled_as(self, form: Component) -> Component:
        """The part under the law of one of its `forms`, on all of its rows."""
        return form

    def judged(self) -> Component:
        """The part on the rows by which its laws are compared, and their errors said."""
        return self

    def in_form_of(self, bundle: Bundle) -> Component:
        """The part under the law that a bundle holds."""
        return self

    @property
    @abstractmethod
    def tests(self) -> tuple[str, ...]:
        """Names of the tests; stretches of one recording have the same."""

    @property
    def recordings(self) -> dict[str, list[int]]:
        """The tests (indices) of each recording, by its name."""
        found: dict[str, list[int]] = {}
        for place, name in enumerate(self.tests):
            found.setdefault(name, []).append(place)
        return found

    @abstractmethod
    def parameters(self) -> list[Parameter]:
        """The law's own parameters, with their starting values and bounds."""

    @abstractmethod
    def effects(
        self, catalogue: Mapping[str, type[CatalogueEffect]]
    ) -> tuple[type[CatalogueEffect], ...]:
        """The effects of the catalogue that act on this part."""

    @abstractmethod
    def residuals(self, law: Law, tests: Sequence[int]) -> list[FloatArray]:
        """Measured less modelled, (n,) for each of `tests` (indices), in `unit`."""

    @abstractmethod
    def measured(self, tests: Sequence[int]) -> list[FloatArray]:
        """The signal that the law has to follow, (n,) for each of `tests`, in `unit`."""

    def residuals_of(self, laws: Sequence[Law], tests: Sequence[int]) -> list[list[FloatArray]]:
        """`residuals` of several laws that differ only in their numbers.

        A part that simulates overrides this if many laws at once cost little more than one.
        """
        return [self.residuals(law, tests) for law in laws]

    def jacobian(self, law: Law, tests: Sequence[int]) -> FloatArray | None:
        """Derivatives of the residuals by the law's own parameters, then by its effects' numbers,
        (n, p); None, where a part does not give them, has them taken by differences."""
        return None

    @abstractmethod
    def regressors(self, tests: Sequence[int]) -> dict[str, FloatArray]:
        """Regressors that a residual may depend on, by name, the tests end to end."""

    @abstractmethod
    def part(self, estimates: Mapping[str, Estimate], quality: FitQuality | None = None) -> Parts:
        """The law's section of a bundle; `estimates` are those of `parameters`, by name."""

    def identified(self, estimates: Mapping[str, Estimate]) -> Mapping[str, Estimate]:
        """What the numbers of the law, `estimates`, say of the part's parameters, by the keys of a
        bundle; by default they are its parameters."""
        return estimates

    def said_of(self, estimates: Mapping[str, Estimate]) -> tuple[str, ...]:
        """What a reader of the law's numbers has to know, a line each; by default nothing."""
        return ()

    def renewed(
        self, bundle: Bundle, estimates: Mapping[str, Estimate], quality: FitQuality | None = None
    ) -> Bundle:
        """A bundle with the law's section in place of its own, level by level."""
        sections = vars(self.part(estimates, quality)).items()
        return bundle.replaced(
            **{
                key: part if getattr(bundle, key) is None else getattr(bundle, key).overlaid(part)
                for key, part in sections
                if part not in (None, ())  # a law's section holds no effects of its own
            }
        )

    def repeats(self) -> IntArray | None:
        """Which residuals repeat one another, (n,) of all tests; None where that is not known."""
        return None

    @abstractmethod
    def law_of(self, bundle: Bundle) -> Law:
        """The law that a bundle holds, without effects. Raises NotIdentifiedError."""

    @property
    def travel(self) -> float:
        """How much of the position the tests visit, rad or m; infinite where that is unknown."""
        return math.inf

    @property
    def spacing(self) -> float:
        """From one sample to the next in the position, rad or m; infinite where it is unknown."""
        return math.inf

    def quantities_of(self, kind: type[CatalogueEffect]) -> tuple[Quantity, ...]:
        """An effect's quantities with what these tests can show of them; none: nothing."""
        return kind.within(self.travel, self.spacing) or ()

    @property
    def most_folds(self) -> int:
        """The number of folds: tests of one fold are left out together."""
        return 6

    def side(self) -> str:
        """The side that an effect of one chamber, valve or sensor acts on."""
        return "a"

    def is_possible(self, law: Law) -> bool:
        """Whether a part with this law could have given its tests at all."""
        return True

    @abstractmethod
    def noise_floor(self, law: Law) -> float:
        """What the sensors' noise leaves of a correct law's residual, RMSE in `unit`; NaN: unknown.

        Of the channels as declared or as logged, or of readings that repeat one another: a
        residual holds what the law lacks.
        """

    def of_each_test(self, law: Law, tests: Sequence[int]) -> list[FloatArray]:
        """What differs by some per cent from test to test though the law is correct, as friction.

        (n,) for each of `tests`, in `unit`; by default nothing.
        """
        return [np.zeros(len(part)) for part in self.measured(tests)]

    def scatter(self, law: Law) -> float:
        """RMSE, in `unit`, that `of_each_test` leaves of a correct law's residual."""
        own = self.of_each_test(law, range(len(self.tests)))
        return self.relative_scatter(law) * rmse(own)

    def own_shares(self, law: Law) -> FloatArray:
        """By how much each test differs in what `of_each_test` gives, (k,), relative to it; empty
        where nothing does."""
        every = range(len(self.tests))
        own = self.of_each_test(law, every)
        test = np.repeat(np.arange(len(own)), [len(part) for part in own])
        left = np.concatenate(self.residuals(law, every))
        return multiples_of_tests(left, np.concatenate(own), test)

    def relative_scatter(self, law: Law) -> float:
        """Relative standard deviation, from test to test, of what `of_each_test` gives."""
        shares = self.own_shares(law)
        return min(float(np.std(shares, ddof=1)), MOST_SCATTER) if len(shares) > 1 else 0.0

    def whitened(self, law: Law) -> Component:
        """The part whose residuals count what differs from test to test (`of_each_test`) as one
        error of each test, as a law fitted before shows it; by default as it is."""
        return self

    def further_errors(self, law: Law) -> dict[str, tuple[float, float]]:
        """RMSE and noise floor of further channels that a law is judged by; by default none.

        An axis' position, simulated open loop; one branch of a valve's loop.
        """
        return {}

    def further_errors_of(self, laws: Sequence[Law]) -> tuple[list[Further], tuple[str, ...]]:
        """`further_errors` of each law, on the same tests; empty where a law gives none.

        With notices of what is not simulated, and why.
        """
        found = [on_its_own(partial(self.further_errors, law)) for law in laws]
        reasons = dict.fromkeys(own.reason for own in found if isinstance(own, Failure))
        known = [{} if isinstance(own, Failure) else own for own in found]
        return known, tuple(f"{NOT_SIMULATED}: {why}" for why in reasons)


def law_held(
    section: str, held: Part | None, names: Sequence[str], tests: str, **absent: float
) -> Law:
    """The law of these names out of `held`, a bundle's `section` (None: the bundle has none).

    `absent` holds the values of names that may be missing. Raises NotIdentifiedError that says
    which `tests` to fit.
    """
    values = dict(absent)
    for name in names:
        estimate = None if held is None else getattr(held, name, None)
        if isinstance(estimate, Estimate) and estimate.identified:
            values[name] = estimate.value
        elif name not in absent:
            reason = "the bundle does not hold it"
            if isinstance(estimate, Estimate):
                reason = estimate.reason or ""
            raise NotIdentifiedError(
                f"{section}: {name} is not identified ({reason}); fit {tests} into the bundle"
            )
    return Law({name: values[name] for name in names})


Given = TypeVar("Given")
Read = TypeVar("Read")


def usable(trials: Sequence[Given], read: Callable[[Given], Read]) -> tuple[list[Read], list[str]]:
    """What is read of the trials that show something, and why others do not, a line each.

    Raises NotIdentifiedError where none does.
    """
    found, left_out = [], []
    for trial in trials:
        try:
            found.append(read(trial))
        except NotIdentifiedError as error:
            left_out.append(str(error))
    if not found:
        raise NotIdentifiedError(left_out[0])
    return found, [f"excluded: {line}" for line in left_out]


STRETCHES, LEAST_IN_STRETCH = 12, 2
"""Neighbouring readings of a sweep are left out together: at most so many stretches, of at least so
many readings each."""


def probes(
    kind: type[CatalogueEffect], side: str, forms: Sequence[Mapping[str, float]] = ({},)
) -> list[CatalogueEffect]:
    """The effect with one strength at a time, at its probing size, in each form (shapes).

    One at a time: two delays of the same size cancel out.
    """
    fields = {"side": side} if kind.has_side() else {}
    return [
        kind.neutral(**fields, **form, **{q.name: q.grid[-1] if q.grid else PROBE * q.typical})
        for form in forms
        for q in kind.strengths()
    ]


def smallest_probe(
    kind: type[CatalogueEffect], side: str, form: Mapping[str, float] | None = None
) -> CatalogueEffect:
    """The effect with all strengths at once, each at its smallest probing size, in its usual form
    or another (shapes)."""
    fields = {"side": side} if kind.has_side() else {}
    sizes = {q.name: q.grid[0] if q.grid else PROBE * q.typical for q in kind.strengths()}
    return kind.neutral(**fields, **sizes, **(form or {}))


def shapes(quantities: Sequence[Quantity]) -> list[dict[str, float]]:
    """Every form of an effect: its shapes' values by field, over their grids.

    A choice that has a plain form is that: a few tests of a part hardly tell an exponent.
    """
    own = [q for q in quantities if not q.is_strength]
    names = [q.name for q in own]
    grids = [_values(q) for q in own]
    return [dict(zip(names, row, strict=True)) for row in itertools.product(*grids)]


def _values(shape: Quantity) -> tuple[float, ...]:
    return (shape.grid or (shape.typical,)) if shape.plain is None else (shape.plain,)


def bends(values: FloatArray, lag: int = 1) -> FloatArray:
    """Second differences (n - 2 lag,), scaled to the spread of white noise: lines vanish."""
    return (values[2 * lag :] - 2.0 * values[lag:-lag] + values[: -2 * lag]) / math.sqrt(6.0)


def rmse(parts: Sequence[FloatArray]) -> float:
    """Root of the mean square of several residuals, pooled over their samples."""
    values = np.concatenate([np.zeros(0), *parts])
    return math.sqrt(float(np.mean(values**2))) if len(values) else math.nan


def valve_alone(rig: Rig) -> Parameters:
    """The constants of a valve without an actuator: pressures by the rig file's `[air]`, else 1 and
    6 bar, and its PWM period, else 1 s."""
    low, high = 1e5, 6e5
    if rig.air is not None:
        low, high = rig.air.atmospheric_pressure_pa, rig.air.supply_pressure_pa
    return Parameters(**dict.fromkeys(PARAMETER_NAMES, 0.0)).replace(
        atmosphere=low,
        supply=high,
        supply_reference=high,
        pwm_period=rig.pwm.period_s if rig.pwm else 1.0,
    )


__all__ = [
    "LEAST_IN_STRETCH",
    "NOT_SIMULATED",
    "STRETCHES",
    "Component",
    "Effects",
    "Further",
    "Law",
    "bends",
    "law_held",
    "probes",
    "rmse",
    "shapes",
    "smallest_probe",
    "usable",
    "valve_alone",
]
