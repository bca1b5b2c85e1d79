"""The result of PWM valve tests: mean-flow surfaces, one pair per valve, and their errors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.blocks.drawing import plot_panels
from sysid.blocks.figures import Panel
from sysid.blocks.plots import some_axes
from sysid.blocks.quality import quality_table
from sysid.blocks.shown import Shown
from sysid.blocks.tables import Table
from sysid.estimation.linear import Estimate
from sysid.estimation.quality import FitQuality
from sysid.identification.valve_pwm.quality import duty_quality
from sysid.identification.valve_pwm.samples import FlowSamples
from sysid.identification.valve_pwm.shown import DIRECTIONS, flow_figure
from sysid.parameters import FittedValves, Parts, PwmSurfaces, Valve
from sysid.parameters.quality import QualityRecord, records_of
from sysid.parameters.valves import (
    AVERAGED,
    ISO6358,
    SERIES,
    THESIS,
    WAYS,
    AveragedRecord,
    PwmDirections,
    by_direction,
)
from sysid.surfaces.averaged_fit import AveragedFit
from sysid.surfaces.bipolynomial import Bipolynomial
from sysid.surfaces.comparison import ResolutionStudy, SurfaceComparison, SurfaceError
from sysid.surfaces.domain import Domain, level_flows
from sysid.surfaces.samples import SurfacePoints

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from sysid.surfaces.ann import DutyNetwork, SizeSweep


@dataclass(frozen=True, repr=False)
class DirectionFit(Shown):
    """Surfaces of one valve in one direction ("fill" or "discharge").

    `samples` are the measured mean flows, `points` the even reduction that was fitted.
    `bipolynomial` and `network` are None where not asked for. `errors` holds each surface's
    error in duty by its name, on held-out tests (`held_out`) and on the training tests
    (`fitted`). `comparison`: both on the same held-out tests. `resolution`:
    Table 3.7.1, None for unevenly spaced duties. `sweep`: hidden sizes, where asked for.
    `boundaries_pa`: the choked boundaries, at which the flow jumps. `supply_pressure_pa`: the
    supply that the tests show, at which the surfaces hold. `off_supply`: the samples with those at
    other supplies, as logged, and their domain; None where there are none. `contradicted`: whether
    a log of them contradicts the rig file.
    """

    valve: str
    direction: str
    supply_pressure_pa: float
    pwm_period_s: float
    samples: FlowSamples
    points: SurfacePoints
    domain: Domain
    bipolynomial: Bipolynomial | None = None
    network: DutyNetwork | None = None
    errors: dict[str, dict[str, SurfaceError]] = field(default_factory=dict)
    comparison: SurfaceComparison | None = None
    resolution: ResolutionStudy | None = None
    sweep: SizeSweep | None = None
    boundaries_pa: tuple[float, ...] = ()
    off_supply: tuple[FlowSamples, Domain] | None = None
    contradicted: bool = False

    @property
    def flows(self) -> tuple[FlowSamples, Domain]:
        """The samples of the averaged law, which knows the supply of each, and their domain."""
        return self.off_supply or (self.samples, self.domain)

    @property
    def by_kind(self) -> dict[str, Bipolynomial | DutyNetwork]:
        """The fitted surfaces by name, `bipolynomial` and `ann`."""
        both = {"bipolynomial": self.bipolynomial, "ann": self.network}
        return {name: surface for name, surface in both.items() if surface is not None}

    @property
    def noise_rmse(self) -> float | None:
        """RMSE in duty that the noise of the flow alone gives; None where it is not known."""
        return None if self.comparison is None else self.comparison.noise_rmse

    @property
    def quality(self) -> dict[str, FitQuality]:
        """How well each surface follows the tests, by its name."""
        return {
            name: replace(
                duty_quality(errors, self.points.duty, self.noise_rmse),
                contradicted=self.contradicted,
            )
            for name, errors in self.errors.items()
        }

    def tables(self) -> Iterable[Table]:
        """The surfaces' errors, and how well they follow the tests."""
        yield from super().tables()
        yield quality_table(self.quality)

    def headline(self) -> str:
        """Valve, direction and number of tests."""
        tests = len(np.unique(self.samples.test))
        return f"{self._title}, {tests} tests"

    def records(self) -> list[dict[str, Any]]:
        """One record per surface: its error in duty on held-out tests (else: training tests)."""
        return [
            {
                "valve": self.valve,
                "direction": self.direction,
                "surface": name,
                "rmse_duty": error.rmse,
                "max_relative_error_percent": error.max_relative_error_percent,
                "judged_on": "held-out tests" if "held_out" in errors else "training tests",
            }
            for name, errors in self.errors.items()
            for error in [errors.get("held_out", errors["fitted"])]
        ]

    def plot(self, ax: Axes | None = None) -> Axes:
        """Mean flow over pressure at a few duties, as measured and by the surfaces; the axes."""
        return plot_panels(self._panels(), ax, self._title)[0]

    def _panels(self) -> tuple[Panel, ...]:
        s = self.samples
        levels = level_flows(s.duty, s.pressure, s.flow)
        return flow_figure(self._title, self.direction, levels, self.by_kind).panels

    @property
    def _title(self) -> str:
        return f"valve {self.valve.upper()}, {DIRECTIONS[self.direction]}"

    def surfaces(self) -> PwmSurfaces:
        """`valves.<v>.pwm.<direction>` of a bundle."""
        content: dict[str, Any] = {
            "supply_pressure_pa": self.supply_pressure_pa,
            "pwm_period_s": self.pwm_period_s,
            "n_tests": len(np.unique(self.samples.test)),
            "n_samples": len(self.samples),
        }
        for name, surface in self.by_kind.items():
            content[name] = {**surface.to_dict(), **self._errors(name)}
        if self.comparison is not None:
            content["comparison"] = self.comparison.to_dict()
        if self.resolution is not None:
            content["resolution_study"] = asdict(self.resolution)
        if self.sweep is not None:
            content["hidden_size_sweep"] = asdict(self.sweep)
        return PwmSurfaces(**content)

    def _errors(self, name: str) -> dict[str, Any]:
        found = self.errors[name]
        judged = found.get("held_out", found["fitted"])
        return {
            "rmse_duty": judged.rmse,
            "max_relative_error_duty_percent": judged.max_relative_error_percent,
            "errors_duty": {use: asdict(error) for use, error in found.items()},
            "quality": QualityRecord.of(self.quality[name]),
        }


@dataclass(frozen=True)
class ValveAverage:
    """A valve's averaged law, and its errors in duty by direction and use.

    `estimates`: the law's parameters by name, with the error of the held position in every flow.
    Use is "fitted" or "held_out": the latter on the tests that the surfaces' comparison
    holds out, fold by fold. `quality` by direction. `notices`: why it is not judged on those.
    """

    fit: AveragedFit
    estimates: Mapping[str, Estimate]
    errors: dict[str, dict[str, SurfaceError]]
    quality: dict[str, FitQuality]
    notices: tuple[str, ...] = ()

    def record(self) -> AveragedRecord:
        """`valves.<v>.pwm.averaged` of a bundle."""
        conditions = self.fit.conditions
        errors = {
            direction: {use: asdict(error) for use, error in found.items()}
            for direction, found in self.errors.items()
        }
        in_series = SERIES if conditions.valve_alone is not None else THESIS
        law = ISO6358 if conditions.by_iso else in_series
        content: dict[str, Any] = by_direction(self.estimates, dict.fromkeys(WAYS, law))
        return AveragedRecord(
            **content,
            supply_pressure_pa=conditions.supply,
            pwm_period_s=conditions.period,
            rmse_flow_kg_s=self.fit.rmse_flow,
            n_tests=self.fit.n_tests,
            n_samples=self.fit.n_samples,
            errors_duty=errors,  # type: ignore[arg-type]  # validated to DutyErrors
            quality=records_of(self.quality),
        )


@dataclass(frozen=True, repr=False)
class ValvePwmFit(Shown):
    """Surfaces of every valve and direction that the tests hold.

    `fits` by (valve, direction); `unidentified`: for each of the others, the reason.
    `averaged`: each valve's averaged law. `remarks` summarize, `notices` report what was excluded
    or is doubtful.
    """

    fits: dict[tuple[str, str], DirectionFit]
    unidentified: dict[tuple[str, str], str]
    remarks: tuple[str, ...]
    notices: tuple[str, ...]
    seed: int
    averaged: dict[str, ValveAverage] = field(default_factory=dict)

    def headline(self) -> str:
        """Which valves and directions."""
        fitted = (f"{v.upper()} {DIRECTIONS[direction]}" for v, direction in self.fits)
        return f"PWM surfaces of valve {', '.join(fitted)}"

    def records(self) -> list[dict[str, Any]]:
        """One record per valve, direction and surface."""
        return [record for fit in self.fits.values() for record in fit.records()]

    def tables(self) -> Iterable[Table]:
        """The surfaces' errors, and how well they and the averaged laws follow the tests."""
        yield from super().tables()
        surfaces = {
            f"{v}.{direction}.{name}": quality
            for (v, direction), fit in self.fits.items()
            for name, quality in fit.quality.items()
        }
        averaged = {
            f"{v}.{AVERAGED}.{direction}": quality
            for v, average in self.averaged.items()
            for direction, quality in average.quality.items()
        }
        yield quality_table(surfaces | averaged)

    def plot(self, axes: Axes | Iterable[Axes] | None = None) -> list[Axes]:
        """Mean flow over pressure, one panel per valve and direction; returns the axes."""
        panels = some_axes(len(self.fits), axes)
        return [fit.plot(ax) for fit, ax in zip(self.fits.values(), panels, strict=True)]

    def part(self) -> Parts:
        """The bundle's `valves`, each with its surfaces by direction."""
        found: dict[str, dict[str, Any]] = {}
        for (valve, direction), fit in self.fits.items():
            found.setdefault(valve, {})[direction] = fit.surfaces()
        for (valve, direction), reason in self.unidentified.items():
            if valve in found:
                missing = {"value": None, "identified": False, "reason": reason}
                found[valve][direction] = PwmSurfaces.model_validate(missing)
        for valve, average in self.averaged.items():
            found[valve][AVERAGED] = average.record()
        return Parts(
            valves=FittedValves(
                **{v: Valve(pwm=PwmDirections(**held)) for v, held in found.items()}
            )
        )


__all__ = ["DIRECTIONS", "DirectionFit", "ValveAverage", "ValvePwmFit"]
