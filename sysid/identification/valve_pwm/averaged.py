"""A valve's averaged law from constant-duty tests of both directions, and its errors in duty."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from sysid.errors import Failure, NotIdentifiedError, on_its_own
from sysid.estimation.law_evidence import DECISIVE
from sysid.estimation.linear import Estimate
from sysid.estimation.quality import root_mean_square, scatter_test
from sysid.identification.denied_ratio import denied_sentence, denied_ways
from sysid.identification.held_volume import VolumeError
from sysid.identification.valve_pwm.quality import CHECK, duty_quality, fails
from sysid.identification.valve_pwm.result import DIRECTIONS, DirectionFit, ValveAverage
from sysid.io.rig import Rig
from sysid.parameters.series import COMBINED, control_coefficient
from sysid.parameters.valves import (
    AUTO,
    FLOW_CONTROL,
    ISO6358,
    ISO_KEYS,
    LAW_KEYS,
    LAWS,
    SERIES,
    THESIS,
    VALVE_ALONE,
)
from sysid.surfaces.averaged import AveragedLaw
from sysid.surfaces.averaged_fit import (
    N_PARAMETERS,
    AveragedFit,
    Conditions,
    MeanFlows,
    evidence_for,
    fit_averaged,
    law_without,
    weighted_residuals,
)
from sysid.surfaces.comparison import SurfaceError, duty_errors
from sysid.surfaces.holdout import group_folds
from sysid.surfaces.samples import SurfacePoints
from sysid.surfaces.windows import FlowWindows
from sysid.types import BoolArray, FloatArray


def average_of(
    directions: Mapping[str, DirectionFit],
    rig: Rig,
    folds: int,
    seed: int,
    count: float,
    law: str = AUTO,
) -> ValveAverage:
    """The averaged law of one valve, whose tests are given by direction.

    `folds`, `seed`: of the held-out tests, which are those of the surfaces' comparison; `count`:
    the encoder's, rad or m, whose half every flow may be wrong by; `law`: "thesis", "iso6358",
    "thesis-series" (with the valve's own coefficients of the rig file), or "auto", by which the
    tests choose.
    Raises NotIdentifiedError where the tests do not identify it.
    """
    air = rig.require("air", "which the averaged law needs")
    first = next(iter(directions.values()))
    # Its choked filling flow is scaled from each test's supply to the rig file's, unlike surfaces.
    conditions = Conditions(
        float(air.supply_pressure_pa),
        air.atmospheric_pressure_pa,
        first.pwm_period_s,
        air.temperature_k,
        valve_alone=_declared(rig, first.valve),
    )
    flows, offsets = _together(list(directions.values()))
    fit, said = fit_by_law(flows, conditions, law)
    unknown = [name for name, estimate in fit.estimates.items() if not estimate.identified]
    if unknown:
        raise NotIdentifiedError(
            f"the averaged law: {fit.estimates[unknown[0]].reason}; valve-pwm tests in both "
            "directions at more duties would identify it"
        )
    errors, quality, notices = {}, {}, list(said)
    if any(found.off_supply is not None for found in directions.values()):
        notices.append(
            "the averaged law: rows at another supply than the rig file's are taken at the one "
            "that was logged"
        )
    for (direction, found), offset in zip(directions.items(), offsets, strict=True):
        points, of_points = found.points, _Chambers.of(found)
        errors[direction] = {
            "fitted": _judged(_duty(fit.law, fit.conditions, points, of_points), points)
        }
        if len(np.unique(points.test)) >= folds + 4:
            tests, held = (offset, of_points), (folds, seed)
            duties = on_its_own(partial(_held_out_duties, points, flows, fit, tests, held))
            if isinstance(duties, Failure):
                title = f"{DIRECTIONS[direction]}: the averaged law is not judged on held-out tests"
                notices.append(f"{title}: {duties.reason}")
            else:
                errors[direction]["held_out"] = _judged(duties, points)
        short = fails(errors[direction], points.duty, found.noise_rmse)
        if short is not None:
            raise NotIdentifiedError(f"the averaged law: {DIRECTIONS[direction]}: {short}; {CHECK}")
        quality[direction] = duty_quality(errors[direction], points.duty, found.noise_rmse)
    volumes = [v for found in directions.values() for v in _volumes(found)]
    position = VolumeError.of(volumes, first.valve, rig, count)
    estimates = {
        name: position.in_estimate(e, shows_scatter=True) if name in _WITH_VOLUME else e
        for name, e in fit.estimates.items()
    }
    if fit.conditions.valve_alone is not None:
        estimates |= _in_series(estimates, fit.conditions.valve_alone)
    return ValveAverage(fit, estimates, errors, quality, tuple(notices))


# What a rough fit, whose last step gained a thousandth, may still take from its sum of squares.
_STILL_TO_GAIN = 0.1
_WITH_VOLUME = {*LAW_KEYS.values(), *(name for name in ISO_KEYS if name.startswith("sonic"))}


def fit_by_law(
    flows: MeanFlows, conditions: Conditions, law: str
) -> tuple[AveragedFit, tuple[str, ...]]:
    """The fit by the law that is asked for or that the samples show, and what to say of it.

    With what the valve is without its flow control, that of both in series is one of them.
    """
    series, plain = conditions, replace(conditions, valve_alone=None)
    if law == SERIES or (law == AUTO and series.valve_alone is not None):
        if series.valve_alone is None:
            return fit_averaged(flows, plain), (f"the averaged law: {COMBINED}",)
        fit = fit_averaged(flows, series)
        if law == SERIES:
            return fit, ()
        single, _ = fit_by_law(flows, plain, AUTO)
        total = sum(evidence_for(fit, single, flows).values())
        said = f"twice the log evidence for a flow control in series {total:.3g}"
        if total >= -DECISIVE:
            return fit, (f"the averaged law: the valve and its flow control in series ({said})",)
        return single, (f"the averaged law: these tests are evidence against one ({said})",)
    conditions = plain
    if law == ISO6358:
        return fit_averaged(flows, replace(conditions, by_iso=True)), ()
    thesis = fit_averaged(flows, conditions)
    if law == THESIS:
        return thesis, ()
    by_iso = replace(conditions, by_iso=True)
    rough = on_its_own(partial(fit_averaged, flows, by_iso, thesis, rough=True))
    if isinstance(rough, Failure):
        return thesis, ()
    # Twice the log evidence of n samples grows by at most n for each share of the sum of squares.
    within_reach = DECISIVE + _STILL_TO_GAIN * len(flows.flow)
    if sum(evidence_for(rough, thesis, flows).values()) < -within_reach:
        return thesis, ()
    iso = on_its_own(partial(fit_averaged, flows, by_iso, thesis))
    if isinstance(iso, Failure):
        return thesis, ()
    evidence = evidence_for(iso, thesis, flows)
    total, against = sum(evidence.values()), min(evidence.values(), default=0.0)
    shown = ", ".join(f"{way} {value:.3g}" for way, value in evidence.items())
    left = weighted_residuals(iso, flows)
    denied = denied_ways(
        iso.solution,
        {way: f"critical_ratio_{way}" for way in left},
        lambda way: scatter_test(root_mean_square(left[way]), 1.0).is_significant,
    )
    if denied and total >= -DECISIVE:
        said = f"{denied_sentence(denied)} (twice the log evidence for ISO 6358: {shown})"
        return thesis, (f"the averaged law: {said}; --law iso6358 takes the other",)
    if total > DECISIVE and against >= -DECISIVE:
        said = f"ISO 6358 follows these tests better (twice the log evidence for it: {shown})"
        stuck = [e.reason for e in iso.estimates.values() if not e.identified]
        if stuck and all(e.identified for e in thesis.estimates.values()):
            return thesis, (f"the averaged law: {said}, but {stuck[0]}; the thesis' law is kept",)
        return iso, (f"the averaged law: {said}",)
    if abs(total) <= DECISIVE and evidence:
        said = f"the laws are indistinguishable in these tests (twice the log evidence: {shown})"
        return thesis, (f"the averaged law: {said}; the thesis' law is kept",)
    return thesis, ()


def _declared(rig: Rig, valve: str) -> tuple[float, float] | None:
    """The rig file's coefficients of a valve without its flow control, filling and exhaust."""
    own = rig.valve_alone(valve)
    return (own["fill"], own["dis"]) if own else None


def _in_series(
    estimates: Mapping[str, Estimate], valve_alone: tuple[float, float]
) -> dict[str, Estimate]:
    """The coefficients of the valve, as declared, and of its flow control."""
    found = {}
    for way, value in zip(VALVE_ALONE, valve_alone, strict=True):
        both = estimates[f"c_{way}"]
        own = Estimate(value, math.nan, both.unit, (math.nan, math.nan))
        found[VALVE_ALONE[way]] = own
        found[FLOW_CONTROL[way]] = control_coefficient(way, both, own)
    return found


def _volumes(found: DirectionFit) -> list[float]:
    """The chamber's volume, m3, in each test of a direction that gives samples."""
    return [found.samples.volumes[test] for test in np.unique(found.samples.test)]


def _together(found: Sequence[DirectionFit]) -> tuple[MeanFlows, list[int]]:
    """The samples of all directions at duties that the flow answers to, each of one law.

    Each direction's tests are numbered on from an offset.
    """
    parts, windows, offsets = [], [], [0]
    for direction in found:
        s, duties = direction.flows
        kept = duties.holds_duty(s.duty) & ~s.crosses
        sampling = np.array(s.sampling)[s.test]
        phases = sampling[:, 1].astype(np.intp)
        of_tests = s.per_flow_of(s.test), s.supply, sampling[:, 0], phases
        columns = (s.duty, s.pressure, s.flow, s.std, s.test + offsets[-1], *of_tests)
        parts.append([column[kept] for column in columns])
        windows.append(s.windows.select(kept))
        offsets.append(offsets[-1] + len(s.labels))
    joined: list[Any] = [np.concatenate(column) for column in zip(*parts, strict=True)]
    joined.append(FlowWindows.joined(windows))
    return MeanFlows(*joined), offsets[:-1]


@dataclass(frozen=True, eq=False)
class _Chambers:
    """Conditions at each of a direction's points: k R T / V in Pa/kg and supply in Pa, (n,)."""

    per_flow: FloatArray
    supply: FloatArray

    @classmethod
    def of(cls, found: DirectionFit) -> _Chambers:
        points, samples = found.points, found.samples
        supply = np.empty(len(points.test))
        for test in np.unique(points.test):
            # A test passes each pressure once: there the supply of its samples is the point's.
            own, at = points.test == test, np.flatnonzero(samples.test == test)
            at = at[np.argsort(samples.pressure[at])]
            supply[own] = np.interp(points.pressure[own], samples.pressure[at], samples.supply[at])
        return cls(samples.per_flow_of(points.test), supply)

    def select(self, rows: BoolArray) -> _Chambers:
        return _Chambers(self.per_flow[rows], self.supply[rows])


def _duty(
    law: AveragedLaw, conditions: Conditions, points: SurfacePoints, chambers: _Chambers
) -> FloatArray:
    """Duty (n,) at the points by a law, with the ripple of their chambers."""
    lines = chambers.supply, conditions.atmosphere
    return np.asarray(law.held_duty(points.flow, points.pressure, lines, chambers.per_flow))


def _held_out_duties(
    points: SurfacePoints,
    flows: MeanFlows,
    whole: AveragedFit,
    tests: tuple[int, _Chambers],
    held_out: tuple[int, int],
) -> FloatArray:
    """Duty at each of a direction's points (n,) by the law from all tests but the point's fold.

    `whole`: the fit of all tests, near which those of the folds are searched for.
    `tests`: offset of the direction's test numbers in `flows`, its points' chambers.
    `held_out`: number of folds, seed. NaN for the tests at the ends of the duty range.
    """
    folds, seed = held_out
    offset, chambers = tests
    duty = np.full(len(points.duty), np.nan)
    for held in group_folds(points.test, points.duty, folds, seed):
        left_out = np.isin(flows.test, points.test[held] + offset)
        law = law_without(whole, flows, left_out)
        duty[held] = _duty(law, whole.conditions, points.select(held), chambers.select(held))
    return duty


def _judged(duty: FloatArray, points: SurfacePoints) -> SurfaceError:
    """Errors of duties (n,) at the points; those that are NaN do not count."""
    known = np.isfinite(duty)
    p = points.select(known)
    return duty_errors(duty[known], p.duty, p.pressure, p.flow, N_PARAMETERS)


__all__ = ["AUTO", "LAWS", "average_of", "fit_by_law"]
