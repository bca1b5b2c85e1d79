"""The result of on/off valve tests: estimates by name, and the fitted curves."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from sysid.blocks.drawing import plot_panels
from sysid.blocks.numbers import number
from sysid.blocks.quality import quality_table
from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table, estimate_records, estimate_table
from sysid.estimation.covariance import JointCovariance
from sysid.estimation.linear import Estimate
from sysid.estimation.named import NamedEstimates
from sysid.estimation.quality import FitQuality
from sysid.identification.valve_discrete.law_choice import LawChoice
from sysid.identification.valve_discrete.shown import PressureCurve, curves_panel
from sysid.parameters import Correlation, DiscreteLaw, FittedValves, Parts, Valve
from sysid.parameters.quality import records_of
from sysid.parameters.valves import ISO_KEYS, by_direction

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, repr=False)
class DiscreteFit(NamedEstimates, Shown):
    """The result of one valve's tests.

    `estimates` by name: the four flow parameters, both delays, both critical ratios, both
    jumps of the law at the choked boundary (percent, unchoked over choked less one).
    `stretches`: the start values, by 3.5.3. `choked_flow_fill_kg_s` holds at `supply` Pa.
    `rmse`, `noise` Pa; `fit_percent` 100 (1 - NRMSE) over all tests; `quality` by direction,
    "fill" and "discharge"; `joint`: the covariance of flows, coefficients and delays; `choice`: the
    law of each direction, and why. A direction that obeys ISO 6358 has `sonic_conductance_fill` (or
    `_dis`), `critical_ratio_fill` and `subsonic_index_fill` in place of the thesis' numbers.
    """

    valve: str
    estimates: Mapping[str, Estimate]
    stretches: Mapping[str, float]
    supply: float
    rmse: float
    noise: float
    fit_percent: float
    curves: tuple[PressureCurve, ...] = field(repr=False)
    quality: Mapping[str, FitQuality] = field(default_factory=dict)
    joint: JointCovariance | None = field(default=None, repr=False)
    choice: LawChoice | None = field(default=None, repr=False)

    def by_name(self) -> Mapping[str, Estimate]:
        """The estimates."""
        return self.estimates

    def headline(self) -> str:
        """Which valve, and how well its law fits the tests."""
        return f"valve {self.valve.upper()}, on/off, fit {number(self.fit_percent)} %"

    def records(self) -> list[dict[str, Any]]:
        """One record per estimate: value, std, limits of the 95 % interval, unit."""
        return estimate_records(self.estimates, valve=self.valve)

    def tables(self) -> Iterable[Table]:
        """The estimates, and how well the law follows the tests."""
        yield estimate_table(f"Valve {self.valve.upper()}", self.estimates)
        yield quality_table(self.quality)

    def plot(self, ax: Axes | None = None) -> Axes:
        """Chamber pressure over time, each test as measured and as fitted; returns the axes."""
        return plot_panels((curves_panel(self.valve, self.curves),), ax)[0]

    @property
    def correlation(self) -> Correlation | None:
        """Correlation of the errors of the identified; None for fewer than two."""
        known = [name for name, e in self.estimates.items() if e.identified]
        keys = {name: ISO_KEYS.get(name, name) for name in known}
        return None if self.joint is None else Correlation.of(self.joint, known, keys)

    def law(self) -> DiscreteLaw:
        """`valves.<a|b>.discrete` of the bundle."""
        content: dict[str, Any] = {
            **by_direction(self.estimates, {} if self.choice is None else self.choice.laws),
            "supply_pressure_pa": self.supply,
            "rmse_pa": self.rmse,
            "noise_pa": self.noise,
            "fit_percent": self.fit_percent,
            "quality": records_of(self.quality),
            "tests": sorted({c.test for c in self.curves}),
        }
        if self.choice is not None and (decision := self.choice.decision()) is not None:
            content["choice"] = decision
        if (correlation := self.correlation) is not None:
            content["correlation"] = correlation
        return DiscreteLaw.model_validate(content)


@dataclass(frozen=True, repr=False)
class ValveDiscreteResult(Shown):
    """The fitted valves, "a" and "b" or one of them, with notices and remarks."""

    valves: Mapping[str, DiscreteFit]
    remarks: tuple[str, ...]
    notices: tuple[str, ...]

    def __getitem__(self, valve: str) -> DiscreteFit:
        return self.valves[valve]

    def headline(self) -> str:
        """Which valves."""
        return f"on/off law of valve {' and '.join(v.upper() for v in self.valves)}"

    def records(self) -> list[dict[str, Any]]:
        """One record per estimate of each valve."""
        return [record for fit in self.valves.values() for record in fit.records()]

    def tables(self) -> Iterable[Table]:
        """The estimates, one table per valve."""
        return (table for fit in self.valves.values() for table in fit.tables())

    def plot(self, axes: Axes | Iterable[Axes] | None = None) -> list[Axes]:
        """Chamber pressures as measured and as fitted, one panel per valve; returns the axes."""
        panels = [curves_panel(v, fit.curves) for v, fit in self.valves.items()]
        return plot_panels(panels, axes)

    def part(self) -> Parts:
        """The bundle's `valves`, each with its on/off law."""
        found = {name: Valve(discrete=fit.law()) for name, fit in self.valves.items()}
        return Parts(valves=FittedValves(**found))


__all__ = ["DiscreteFit", "PressureCurve", "ValveDiscreteResult"]
