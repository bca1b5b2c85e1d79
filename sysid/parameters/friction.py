"""A bundle's friction: its parameters, and the tests that they are based on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import ConfigDict, Field, JsonValue

from sysid.estimation.linear import Estimate
from sysid.io.motion import FRICTION, LINEAR, ROTARY, MotionUnits
from sysid.parameters.base import Absent, Lenient, Number, Part
from sysid.parameters.correlation import CorrelatedPart
from sysid.parameters.quality import QualityByName


class StaticAtPosition(Part):
    """Static friction (Nm or N) at one position (rad or m), and its number of tests."""

    position: Number
    static: Estimate
    tests: Absent[int] = None


class FTestRecord(Part):
    """An F test: its statistic, degrees of freedom and p-value."""

    f: Number | None
    dof_numerator: Number
    dof_denominator: Number
    p_value: Number | None


class TestUse(Part):
    """The outcome of one friction test; the values read from it are further keys."""

    # pytest must not take this for a test.
    __test__ = False

    test: str
    kind: str
    used: bool
    reason: Absent[str] = None

    def reading(self, name: str) -> float | None:
        """A value read from the test (`speed`, `friction`, `position`, ...); None without it."""
        value = (self.model_extra or {}).get(name)
        return float(value) if isinstance(value, int | float) else None


class CombinationRecord(Part):
    """A sum of parameters that the tests identify though not its parts: its value and interval,
    the parameters' names and factors, and the test that would separate them."""

    of: list[str]
    coefficients: list[Number]
    expression: str
    value: Number
    std: Number | None
    unit: str
    interval: list[Number | None]
    test: str

    @property
    def estimate(self) -> Estimate:
        """The sum."""
        return Estimate.from_json(self.to_json())


# Keys that the friction of a rotary or a linear rig has to hold.
_WHOLE: list[list[str]] = [list(map(units.key, FRICTION)) for units in (ROTARY, LINEAR)]


class Friction(CorrelatedPart):
    """Static, Coulomb and viscous friction (thesis 3.4.1), in Nm and rad or in N and m.

    `source` is the kind of test that gave Coulomb and viscous friction, `cross_check` the
    estimates of the other kind; `rmse_nm` (linear: `rmse_n`) and `quality` of each fit by kind
    of test; `trials` the outcome of each test; `combinations` the sums that are identified where
    their parts are not; `correlation` of the errors of what moving tests gave.
    """

    model_config = ConfigDict(json_schema_extra={"anyOf": [{"required": [*own]} for own in _WHOLE]})

    static_nm: Absent[Estimate] = None
    coulomb_nm: Absent[Estimate] = None
    viscous_nm_s_per_rad: Absent[Estimate] = None
    offset_nm: Absent[Estimate] = None
    inertia_kg_m2: Absent[Estimate] = None
    static_n: Absent[Estimate] = None
    coulomb_n: Absent[Estimate] = None
    viscous_n_s_per_m: Absent[Estimate] = None
    offset_n: Absent[Estimate] = None
    mass_kg: Absent[Estimate] = None
    source: Lenient[str | None] = None
    rmse_nm: Lenient[dict[str, Number] | None] = None
    rmse_n: Lenient[dict[str, Number] | None] = None
    quality: QualityByName = None
    explained: Absent[Lenient[dict[str, Number] | None]] = None
    cross_check: Lenient[dict[str, Estimate]] = Field(default_factory=dict)
    combinations: list[Lenient[CombinationRecord]] = Field(default_factory=list)
    trials: Lenient[list[TestUse]] = Field(default_factory=list)
    static_by_position: list[Lenient[StaticAtPosition]] = Field(default_factory=list)
    static_tests: Lenient[dict[str, FTestRecord] | None] = None
    static_criterion: Lenient[str | None] = None
    clusters: JsonValue = None
    offset_p_value: Lenient[Number | None] = None
    sliding_lack_of_fit: Lenient[FTestRecord | None] = None
    motion_rule: Lenient[str | None] = None
    cutoff_hz: Lenient[Number | None] = None

    @classmethod
    def _check_form(cls, data: Mapping[str, Any]) -> None:
        super()._check_form(data)
        if not any(data.keys() >= set(own) for own in _WHOLE):
            raise ValueError("lacks static, Coulomb or viscous friction")

    def used(self, kind: str) -> list[TestUse]:
        """The tests of a kind that the fit used."""
        return [test for test in self.tests() if test.used and test.kind == kind]

    def tests(self) -> list[TestUse]:
        """The outcome of each friction test; none where the bundle does not hold it."""
        return self.trials if isinstance(self.trials, list) else []

    def positions(self) -> list[StaticAtPosition]:
        """Static friction by position."""
        return [row for row in self.static_by_position if isinstance(row, StaticAtPosition)]

    def sums(self) -> dict[str, CombinationRecord]:
        """The combinations by expression."""
        rows = [row for row in self.combinations if isinstance(row, CombinationRecord)]
        return {row.expression: row for row in rows}

    @property
    def sum_in_motion(self) -> CombinationRecord | None:
        """The sum that holds Coulomb friction, where tests in one direction or at one speed do not
        separate its parts: all friction of such motion. None where Coulomb friction is known."""
        coulomb, key = self.coulomb, self.units.key("coulomb")
        if coulomb is None or coulomb.identified:
            return None
        return next((row for row in self.sums().values() if key in row.of), None)

    def in_motion(self, name: str) -> Estimate | None:
        """A parameter by its name, or what stands for it in motion like that of the tests.

        Where these identify only sums, that with Coulomb friction is Coulomb friction, that with an
        offset the offset, and what either holds besides is 0.
        """
        own, key = self.parameter(name), self.units.key(name)
        if own is None or own.identified:
            return own
        sums = [row for row in self.sums().values() if key in row.of]
        if not sums:
            return own
        leads = [row for row in sums if row.of[0] == key]
        if leads:
            return leads[0].estimate
        return Estimate(0.0, 0.0, own.unit or self.units.unit(name), (0.0, 0.0))

    def with_sum_of(self, before: Friction) -> Friction:
        """The same, its Coulomb friction back in the sum that stood for it `before`.

        What follows from a model that took the sum for Coulomb friction is an estimate of the sum.
        """
        held, coulomb = before.sum_in_motion, self.coulomb
        if held is None or coulomb is None or not coulomb.identified:
            return self
        key = self.units.key("coulomb")
        new = CombinationRecord.model_validate({**held.to_json(), **coulomb.to_json()})
        rows = [new if row == held else row for row in before.combinations]
        return self.replaced(**{key: before.coulomb, "combinations": rows})

    @property
    def units(self) -> MotionUnits:
        """The units of its keys."""
        held = (getattr(self, key) for key in LINEAR.keys.values())
        return LINEAR if any(one is not None for one in held) else ROTARY

    def parameter(self, name: str) -> Estimate | None:
        """A parameter by its name, `coulomb` for example; None without it."""
        found: Estimate | None = getattr(self, self.units.key(name))
        return found

    @property
    def static(self) -> Estimate | None:
        """Static friction, Nm or N."""
        return self.parameter("static")

    @property
    def coulomb(self) -> Estimate | None:
        """Coulomb friction, Nm or N."""
        return self.parameter("coulomb")

    @property
    def viscous(self) -> Estimate | None:
        """Viscous friction, Nm s/rad or N s/m."""
        return self.parameter("viscous")

    @property
    def offset(self) -> Estimate | None:
        """Constant effort that the friction tests show, Nm or N."""
        return self.parameter("offset")

    @property
    def inertia(self) -> Estimate | None:
        """The inertia (kg m2) or mass (kg), where the tests gave it."""
        return self.parameter("inertia")


__all__ = ["CombinationRecord", "FTestRecord", "Friction", "StaticAtPosition", "TestUse"]
