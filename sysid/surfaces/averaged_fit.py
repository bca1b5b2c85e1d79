"""The averaged law fitted to mean flows: no on/off test is needed.

The mean flow of `sysid.surfaces.averaged` has five parameters that mean flows can show: by the
thesis' law the two choked flows and the two coefficients of the unchoked laws, by ISO 6358 two
sonic conductances and two critical ratios; and by how much the valve closes later than it opens.
The delays themselves move the pulse within the period, which no mean shows; only their
difference does.

Both directions are fitted together: filling and discharging tests meet where the mean flow is
zero, and each holds both of the law's branches.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sysid.errors import NotIdentifiedError
from sysid.estimation.law_evidence import twice_log_evidence
from sysid.estimation.linear import Estimate
from sysid.estimation.nonlinear import (
    FitStart,
    LeastSquaresFit,
    Parameter,
    Residuals,
    minimise,
    without_rows,
)
from sysid.estimation.quality import FEWEST_REPEATS
from sysid.plant.iso6358 import ANR_TEMPERATURE, DEFAULT_INDEX, HIGHEST_RATIO, choked_flow
from sysid.surfaces.averaged import AveragedLaw, sampled_period
from sysid.types import FloatArray

N_PARAMETERS = 5
# A sample's least standard error, as a share of the largest flow: what the mean over a
# window, the ripple and the supply omit from the law.
_LEAST_ERROR = 0.002
# A rough fit: how many samples it takes, and the relative fall of its sum of squares at which it
# ends.
_SOME = 500
_ROUGH = 1e-3
_UNITS = {
    "choked_flow_fill_kg_s": "kg/s",
    "choked_flow_dis_kg_s": "kg/s",
    "c_fill": "kg/(s Pa^0.5)",
    "c_dis": "kg/(s Pa)",
    "sonic_conductance_fill": "m3/(s Pa)",
    "sonic_conductance_dis": "m3/(s Pa)",
    "critical_ratio_fill": "-",
    "critical_ratio_dis": "-",
    "delay_difference_s": "s",
}
_THESIS = ("choked_fill", "choked_dis", "c_fill", "c_dis")
_ISO = (
    "sonic_conductance_fill",
    "sonic_conductance_dis",
    "critical_ratio_fill",
    "critical_ratio_dis",
)
# The critical ratio that a fit starts from.
_RATIO = 0.3


@dataclass(frozen=True, eq=False)
class MeanFlows:
    """Samples of one valve's mean flow in both directions.

    `duty`, `pressure` [Pa], `flow` [kg/s], its standard error `std` [kg/s], `test`, the
    number of the sample's test, `per_flow` = k R T / V of its chamber [Pa/kg], which
    says how far the pressure ripples, the `supply` of its test [Pa], the `centre` of its test's
    pulses, as a share of the PWM period after a row (NaN: not known), how many `phases` of the
    period the rows show, and the `spread` of the pressure's course over the sample [Pa], all (n,).
    """

    duty: FloatArray
    pressure: FloatArray
    flow: FloatArray
    std: FloatArray
    test: NDArray[np.intp]
    per_flow: FloatArray
    supply: FloatArray
    centre: FloatArray
    phases: NDArray[np.intp]
    spread: FloatArray

    def select(self, rows: NDArray[np.bool_]) -> MeanFlows:
        """The samples in `rows` (mask)."""
        return MeanFlows(
            self.duty[rows],
            self.pressure[rows],
            self.flow[rows],
            self.std[rows],
            self.test[rows],
            self.per_flow[rows],
            self.supply[rows],
            self.centre[rows],
            self.phases[rows],
            self.spread[rows],
        )

    def sampled(self, share: FloatArray) -> tuple[FloatArray, FloatArray]:
        """`sampled_period` of each sample (n,), valves open for `share` (n,) of the period."""
        high, lead = np.zeros(len(share)), np.zeros(len(share))
        for phases in np.unique(self.phases):
            rows = (self.phases == phases) & np.isfinite(self.centre)
            high[rows], lead[rows] = sampled_period(share[rows], self.centre[rows], int(phases))
        return high, lead


@dataclass(frozen=True)
class Conditions:
    """Conditions of the law: supply and atmosphere in Pa, the PWM period in s.

    The choked filling flow is that at `supply`; tests may have been run at others. `by_iso`:
    whether both directions obey ISO 6358, with air at `temperature` K. `valve_alone`: with a flow
    control in series, the coefficients of the valve alone (kg/(s Pa^0.5), kg/(s Pa)).
    """

    supply: float
    atmosphere: float
    period: float
    temperature: float = ANR_TEMPERATURE
    by_iso: bool = False
    valve_alone: tuple[float, float] | None = None

    def law(self, values: FloatArray) -> AveragedLaw:
        """The law of parameter values (5,), in the order of the fit's names."""
        *flows, difference = (float(v) for v in values)
        numbers = dict.fromkeys(_THESIS, 0.0)
        if self.by_iso:
            numbers |= dict.fromkeys(("subsonic_index_fill", "subsonic_index_dis"), DEFAULT_INDEX)
        numbers |= dict(zip(_ISO if self.by_iso else _THESIS, flows, strict=True))
        if self.valve_alone is not None and not self.by_iso:
            numbers |= dict(zip(("valve_c_fill", "valve_c_dis"), self.valve_alone, strict=True))
        return AveragedLaw(
            **numbers,
            temperature=self.temperature,
            supply=self.supply,
            supply_reference=self.supply,
            atmosphere=self.atmosphere,
            on_delay=0.0,
            off_delay=difference,
            period=self.period,
        )


@dataclass(frozen=True, eq=False)
class AveragedFit:
    """A valve's averaged law, its parameters by name and how well it follows the samples.

    `rmse_flow` kg/s over `n_samples` of `n_tests`.
    """

    conditions: Conditions
    solution: LeastSquaresFit
    tests: NDArray[np.intp]
    rmse_flow: float

    @property
    def law(self) -> AveragedLaw:
        """The fitted law."""
        return self.conditions.law(self.solution.values)

    @property
    def n_samples(self) -> int:
        return len(self.tests)

    @property
    def n_tests(self) -> int:
        return len(np.unique(self.tests))

    @cached_property
    def estimates(self) -> Mapping[str, Estimate]:
        """The parameters by name; intervals from the scatter between tests (jackknife)."""
        covariance = self.solution.jackknife_covariance(self.tests)
        return {name: self.solution.estimate(name, covariance) for name in self.solution.names}


def fit_averaged(flows: MeanFlows, conditions: Conditions, *, rough: bool = False) -> AveragedFit:
    """The averaged law by bounded least squares over the samples of both directions.

    `rough`: of some of the samples, and only until its evidence is known; a law that does not
    describe the valve can take thousands of steps along a bound to its last digits. Raises
    NotIdentifiedError for fewer than three tests or where the pressure never leaves one regime far
    enough to show any parameter.
    """
    n_tests = len(np.unique(flows.test))
    if n_tests < FEWEST_REPEATS:
        raise NotIdentifiedError(
            f"{n_tests} tests do not identify the averaged law; valve-pwm tests at "
            f"{FEWEST_REPEATS} duties or more would"
        )
    start = (_iso_start if conditions.by_iso else _start)(flows, conditions)
    if rough:
        every = np.arange(len(flows.flow)) % max(1, len(flows.flow) // _SOME) == 0
        some = _residuals(flows.select(every), conditions)
        solution = minimise(some, start, tolerance=_ROUGH, polish=False)
        left = _mean_flow(solution.values, flows, conditions) - flows.flow
    else:
        first = minimise(_residuals(flows, conditions), start).values
        start = [
            replace(p, value=float(np.clip(v, p.lower, p.upper)))
            for p, v in zip(start, first, strict=True)
        ]
        bend = _bend(first, flows, conditions)
        solution = minimise(_residuals(flows, conditions, bend), start)
        left = solution.residuals * _errors(flows)
    return AveragedFit(conditions, solution, flows.test, math.sqrt(float(np.mean(left**2))))


def law_without(fit: AveragedFit, flows: MeanFlows, left_out: NDArray[np.bool_]) -> AveragedLaw:
    """The law of the samples but for those `left_out` (mask); `fit` is of all, `flows`.

    From the fit's numbers, which are next to it. Raises as `fit_averaged` does.
    """
    kept, whole = flows.select(~left_out), fit.solution
    bend = _bend(whole.values, kept, fit.conditions)
    residuals = _residuals(kept, fit.conditions, bend)
    weight = _errors(flows)[~left_out] / _errors(kept)
    slopes = whole.jacobian[~left_out] * weight[:, None]
    values = without_rows(whole, FitStart(whole.values, residuals(whole.values), slopes), residuals)
    if values is None or len(np.unique(kept.test)) < FEWEST_REPEATS:
        return fit_averaged(kept, fit.conditions).law
    return fit.conditions.law(values)


def _residuals(
    flows: MeanFlows, conditions: Conditions, bend: FloatArray | float = 0.0
) -> Residuals:
    """Weighted residuals (n,) of the samples by the law of parameter values (5,).

    `bend` (n,): of the flow over each sample's window, kg/s (`_bend`).
    """
    error, seen = _errors(flows), flows.flow - bend
    return lambda values: np.asarray((_mean_flow(values, flows, conditions) - seen) / error)


def _errors(flows: MeanFlows) -> FloatArray:
    """Standard errors (n,) that weigh the samples, kg/s."""
    known = np.where(np.isfinite(flows.std), flows.std, 0.0)
    return np.asarray(np.hypot(known, _LEAST_ERROR * float(np.abs(flows.flow).max())))


def _mean_flow(values: FloatArray, flows: MeanFlows, conditions: Conditions) -> FloatArray:
    """Flow (n,) by the law of parameter values (5,), over each sample's ripple."""
    law = conditions.law(values)
    share = law.open_share(flows.duty)
    lines = flows.supply, conditions.atmosphere
    sampled = flows.sampled(share)
    pulse = law.mean_pulse(share, flows.pressure, lines, flows.per_flow, sampled)
    return np.asarray(pulse.mean(share))


def _bend(values: FloatArray, flows: MeanFlows, conditions: Conditions) -> FloatArray:
    """By how much a sample's mean flow (n,) differs from that at its mean pressure, kg/s.

    A window near the supply's pressure holds a flow that falls as a root: Gauss' two points of the
    pressure's course over it.
    """
    at = [
        _mean_flow(values, replace(flows, pressure=flows.pressure + way * flows.spread), conditions)
        for way in (-1.0, 1.0)
    ]
    return 0.5 * (at[0] + at[1]) - _mean_flow(values, flows, conditions)


def _start(flows: MeanFlows, conditions: Conditions) -> list[Parameter]:
    """Rough values: the largest flows of either sign, without a jump between the regimes."""
    supply, atmosphere = conditions.supply, conditions.atmosphere
    fill = max(float(flows.flow.max()), 1e-3 * float(np.abs(flows.flow).max()))
    out = max(float(-flows.flow.min()), 1e-3 * float(np.abs(flows.flow).max()))
    half_gap = 0.47 * supply
    values = {
        "choked_flow_fill_kg_s": fill,
        "choked_flow_dis_kg_s": out,
        "c_fill": fill / math.sqrt(half_gap),
        "c_dis": out / (atmosphere / 0.53 - atmosphere),
    }
    parameters = [Parameter(n, v, _UNITS[n], 0.0, 30.0 * v) for n, v in values.items()]
    return [*parameters, _difference(conditions)]


def _iso_start(flows: MeanFlows, conditions: Conditions) -> list[Parameter]:
    """The same for ISO 6358: the largest flows are choked, from the supply."""
    largest = float(np.abs(flows.flow).max())
    per_conductance = float(choked_flow(conditions.supply, 1.0, conditions.temperature))
    found = []
    for way, most in (("fill", flows.flow.max()), ("dis", -flows.flow.min())):
        name = f"sonic_conductance_{way}"
        value = max(float(most), 1e-3 * largest) / per_conductance
        found.append(Parameter(name, value, _UNITS[name], 0.0, 30.0 * value))
    for way in ("fill", "dis"):
        name = f"critical_ratio_{way}"
        found.append(Parameter(name, _RATIO, _UNITS[name], 0.0, HIGHEST_RATIO))
    return [*found, _difference(conditions)]


def _difference(conditions: Conditions) -> Parameter:
    # The most by which the delays may differ, as a share of the period.
    widest = 0.9 * conditions.period
    scale = 0.05 * conditions.period
    name = "delay_difference_s"
    return Parameter(name, 0.0, _UNITS[name], -widest, widest, scale=scale)


def evidence_for(other: AveragedFit, over: AveragedFit, flows: MeanFlows) -> dict[str, float]:
    """Twice the log evidence for a law over another one, by direction of the flow.

    "fill" and "dis"; both fits are of these samples. One without enough samples is omitted.
    """
    found = {}
    left = {
        fit: _mean_flow(fit.solution.values, flows, fit.conditions) - flows.flow
        for fit in (over, other)
    }
    floor = 0.1 * _LEAST_ERROR * float(np.abs(flows.flow).max())
    for way, rows in (("fill", flows.flow > 0.0), ("dis", flows.flow < 0.0)):
        tests = [rows & (flows.test == test) for test in np.unique(flows.test)]
        old, new = ([left[fit][own] for own in tests] for fit in (over, other))
        value = twice_log_evidence(old, new, [floor] * len(tests))
        if value is not None:
            found[way] = value
    return found


__all__ = [
    "N_PARAMETERS",
    "AveragedFit",
    "Conditions",
    "MeanFlows",
    "evidence_for",
    "fit_averaged",
    "law_without",
]
