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
from sysid.estimation.covariance import Covariance
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
from sysid.plant.iso6358 import (
    ANR_TEMPERATURE,
    DEFAULT_INDEX,
    HIGHEST_RATIO,
    USUAL_RATIO,
    choked_flow,
)
from sysid.surfaces.averaged import AveragedLaw, sampled_period
from sysid.surfaces.windows import FlowWindows
from sysid.types import FloatArray

N_PARAMETERS = 5
# A sample's least standard error, as a share of the largest flow: what the mean over a
# window, the ripple and the supply omit from the law.
_LEAST_ERROR = 0.002
# Rounds of windows and numbers, and the change of the windows' flows, as a share of the samples'
# errors, with which they have stayed.
_MOST_ROUNDS = 10
_STAYS = 0.1
# A rough fit: of how many samples one is that is compared alone, and the relative fall of the sum
# of squares at which each ends.
_SOME = 500
_ROUGH = 1e-3
# Share of the largest flow below which a direction's own mean flow is that of noise at rest.
_HARDLY = 1e-2
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


@dataclass(frozen=True, eq=False)
class MeanFlows:
    """Samples of one valve's mean flow in both directions.

    `duty`, `pressure` [Pa], `flow` [kg/s], its standard error `std` [kg/s], `test`, the
    number of the sample's test, `per_flow` = k R T / V of its chamber [Pa/kg], which
    says how far the pressure ripples, the `supply` of its test [Pa], the `centre` of its test's
    pulses, as a share of the PWM period after a row (NaN: not known), how many `phases` of the
    period the rows show, all (n,), and the `windows` that they are of (None: flows are given at
    their pressures).
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
    windows: FlowWindows | None = None

    def by_direction(self) -> dict[str, NDArray[np.bool_]]:
        """The samples of each direction of the flow, "fill" and "dis", (n,)."""
        return {"fill": self.flow > 0.0, "dis": self.flow < 0.0}

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
            None if self.windows is None else self.windows.select(rows),
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
class Bend:
    """By how much windows show another flow than the law at their mean pressure, kg/s (n,).

    What the law's mean over a ripple and over a window leaves out: pressures that move on while
    the pulses move them, and a flow that falls as a root next to the supply. `error` (n,): what
    the law makes of the errors of the pressures.
    """

    level: FloatArray
    error: FloatArray

    def select(self, rows: NDArray[np.bool_]) -> Bend:
        """That of the samples in `rows` (mask)."""
        return Bend(self.level[rows], self.error[rows])


@dataclass(frozen=True, eq=False)
class AveragedFit:
    """A valve's averaged law, its parameters by name and how well it follows the samples.

    `bend`: of the samples' windows, as fitted; `rmse_flow` kg/s over `n_samples` of `n_tests`.
    """

    conditions: Conditions
    solution: LeastSquaresFit
    tests: NDArray[np.intp]
    bend: Bend
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
        """The parameters by name; intervals from the scatter between tests (jackknife).

        What noise alone puts at its bound, as a critical ratio of 0, has that as its value.
        """

        def covariance(fit: LeastSquaresFit) -> Covariance:
            return fit.jackknife_covariance(self.tests)

        bounded = self.solution.at_bound_by_noise(covariance)
        found = covariance(bounded.fit)
        return {name: bounded.estimate(name, found) for name in self.solution.names}


def fit_averaged(
    flows: MeanFlows,
    conditions: Conditions,
    other: AveragedFit | None = None,
    *,
    rough: bool = False,
) -> AveragedFit:
    """The averaged law by bounded least squares over the samples of both directions.

    What the samples' windows show of the law is simulated with its numbers, and these are fitted
    anew until they stay. `other`: of another law, whose windows are taken at first. `rough`: of
    some of the samples, with the other law's windows, and only until its evidence is known; a law
    that does not describe the valve can take thousands of steps along a bound to its last digits.
    Raises NotIdentifiedError for fewer than three tests or where the pressure never leaves one
    regime far enough to show any parameter.
    """
    n_tests = len(np.unique(flows.test))
    if n_tests < FEWEST_REPEATS:
        raise NotIdentifiedError(
            f"{n_tests} tests do not identify the averaged law; valve-pwm tests at "
            f"{FEWEST_REPEATS} duties or more would"
        )
    start = (_iso_start if conditions.by_iso else _start)(flows, conditions)
    none = np.zeros(len(flows.flow))
    bend = Bend(none, none) if other is None else other.bend
    if rough:
        every = np.arange(len(flows.flow)) % max(1, len(flows.flow) // _SOME) == 0
        some = _residuals(flows.select(every), conditions, bend.select(every))
        solution = minimise(some, start, tolerance=_ROUGH, polish=False)
    else:
        for _ in range(_MOST_ROUNDS if flows.windows is not None else 0):
            residuals = _residuals(flows, conditions, bend)
            found = minimise(residuals, start, tolerance=_ROUGH, polish=False).values
            start = [
                replace(p, value=float(np.clip(v, p.lower, p.upper)))
                for p, v in zip(start, found, strict=True)
            ]
            before, bend = bend, _bend(found, flows, conditions, bend)
            moved = (bend.level - before.level) / _errors(flows, bend)
            if np.mean(moved**2) < _STAYS**2:
                break
        solution = minimise(_residuals(flows, conditions, bend), start)
    left = _mean_flow(solution.values, flows, conditions) + bend.level - flows.flow
    return AveragedFit(conditions, solution, flows.test, bend, math.sqrt(float(np.mean(left**2))))


def law_without(fit: AveragedFit, flows: MeanFlows, left_out: NDArray[np.bool_]) -> AveragedLaw:
    """The law of the samples but for those `left_out` (mask); `fit` is of all, `flows`.

    From the fit's numbers, which are next to it. Raises as `fit_averaged` does.
    """
    kept, whole = flows.select(~left_out), fit.solution
    residuals = _residuals(kept, fit.conditions, fit.bend.select(~left_out))
    weight = _errors(flows, fit.bend)[~left_out] / _errors(kept, fit.bend.select(~left_out))
    slopes = whole.jacobian[~left_out] * weight[:, None]
    values = without_rows(whole, FitStart(whole.values, residuals(whole.values), slopes), residuals)
    if values is None or len(np.unique(kept.test)) < FEWEST_REPEATS:
        return fit_averaged(kept, fit.conditions).law
    return fit.conditions.law(values)


def _residuals(flows: MeanFlows, conditions: Conditions, bend: Bend) -> Residuals:
    """Weighted residuals (n,) of the samples by the law of parameter values (5,)."""
    error, pulses = _errors(flows, bend), _Pulses(flows)

    def residuals(values: FloatArray) -> FloatArray:
        found = _mean_flow(values, flows, conditions, pulses) + bend.level
        return np.asarray((found - flows.flow) / error)

    return residuals


def _errors(flows: MeanFlows, bend: Bend) -> FloatArray:
    """Standard errors (n,) that weigh the samples, kg/s."""
    known = np.where(np.isfinite(flows.std), flows.std, 0.0)
    least = _LEAST_ERROR * float(np.abs(flows.flow).max())
    return np.asarray(np.sqrt(known**2 + least**2 + bend.error**2))


class _Pulses:
    """The samples' open shares, and what their few places in a period make of these.

    Only the delays' difference moves them: those of the last one are kept, since most of a Jacobian
    is of the flows.
    """

    def __init__(self, flows: MeanFlows) -> None:
        self._flows = flows
        self._difference = math.nan
        self._share = np.empty(0)
        self._sampled = self._share, self._share

    def under(self, law: AveragedLaw) -> tuple[FloatArray, tuple[FloatArray, FloatArray]]:
        """Share (n,) of the period in which a law's valve is open; `MeanFlows.sampled` of it."""
        if law.off_delay != self._difference:
            self._difference = law.off_delay
            self._share = law.open_share(self._flows.duty)
            self._sampled = self._flows.sampled(self._share)
        return self._share, self._sampled


def _mean_flow(
    values: FloatArray, flows: MeanFlows, conditions: Conditions, pulses: _Pulses | None = None
) -> FloatArray:
    """Flow (n,) by the law of parameter values (5,), over each sample's ripple.

    `pulses`: of samples of these duties, as from call to call.
    """
    law = conditions.law(values)
    share, sampled = (pulses or _Pulses(flows)).under(law)
    lines = flows.supply, conditions.atmosphere
    pulse = law.mean_pulse(share, flows.pressure, lines, flows.per_flow, sampled)
    return np.asarray(pulse.mean(share))


def _bend(values: FloatArray, flows: MeanFlows, conditions: Conditions, before: Bend) -> Bend:
    """The bend by the law of parameter values (5,): simulated along the samples' own pressures.

    `before`: that of the round before, by which the law missed the samples' flows. These are added
    to it, so that the simulated pressures stay with the measured ones: next to a choked boundary
    they would settle beyond it otherwise.
    """
    assert flows.windows is not None
    law, pulses = conditions.law(values), _Pulses(flows)
    share, _ = pulses.under(law)

    def by_law(pressure: FloatArray) -> FloatArray:
        return _mean_flow(values, replace(flows, pressure=pressure), conditions, pulses)

    missed = flows.flow - by_law(flows.pressure) - before.level
    chamber = flows.supply, flows.per_flow, missed
    pressure, flow = flows.windows.under(law, share, flows.centre, chamber)
    error = flows.windows.error
    # Next to the supply the flow falls as a root: a few pascals are all of it.
    by_pressure = 0.5 * np.abs(by_law(flows.pressure + error) - by_law(flows.pressure - error))
    return Bend(flow - missed - by_law(pressure), by_pressure)


def _start(flows: MeanFlows, conditions: Conditions) -> list[Parameter]:
    """Rough values: the largest flows of either sign, without a jump between the regimes."""
    supply, atmosphere = conditions.supply, conditions.atmosphere
    fill, out = _largest(flows)
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
    per_conductance = float(choked_flow(conditions.supply, 1.0, conditions.temperature))
    found = []
    for way, most in zip(("fill", "dis"), _largest(flows), strict=True):
        name = f"sonic_conductance_{way}"
        value = most / per_conductance
        found.append(Parameter(name, value, _UNITS[name], 0.0, 30.0 * value))
    for way in ("fill", "dis"):
        name = f"critical_ratio_{way}"
        found.append(Parameter(name, USUAL_RATIO, _UNITS[name], 0.0, HIGHEST_RATIO))
    return [*found, _difference(conditions)]


def _largest(flows: MeanFlows) -> tuple[float, float]:
    """Largest mean flow in and out, kg/s.

    Of one that hardly shows, as where tests only fill, the other: at rest they balance.
    """
    fill, out = float(flows.flow.max()), -float(flows.flow.min())
    least = _HARDLY * max(fill, out)
    return (fill if fill > least else out), (out if out > least else fill)


def _difference(conditions: Conditions) -> Parameter:
    # The most by which the delays may differ, as a share of the period.
    widest = 0.9 * conditions.period
    scale = 0.05 * conditions.period
    name = "delay_difference_s"
    return Parameter(name, 0.0, _UNITS[name], -widest, widest, scale=scale)


def weighted_residuals(fit: AveragedFit, flows: MeanFlows) -> dict[str, FloatArray]:
    """Residuals in standard errors of the samples, by direction of the flow, "fill" and "dis".

    `flows`: the samples that were fitted.
    """
    return {way: fit.solution.residuals[rows] for way, rows in flows.by_direction().items()}


def evidence_for(other: AveragedFit, over: AveragedFit, flows: MeanFlows) -> dict[str, float]:
    """Twice the log evidence for a law over another one, by direction of the flow.

    "fill" and "dis"; both fits are of these samples. One without enough samples is omitted.
    """
    found = {}
    left = {
        fit: _mean_flow(fit.solution.values, flows, fit.conditions) + fit.bend.level - flows.flow
        for fit in (over, other)
    }
    floor = 0.1 * _LEAST_ERROR * float(np.abs(flows.flow).max())
    for way, rows in flows.by_direction().items():
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
    "weighted_residuals",
]
