"""From the fitted curves of a valve to its parameters, each with an interval or why it has none."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from types import MappingProxyType

import numpy as np

from sysid.errors import Failure, on_its_own
from sysid.estimation.covariance import JointCovariance
from sysid.estimation.linear import Estimate
from sysid.estimation.quality import MOST_STD, FitQuality
from sysid.identification.held_volume import VolumeError
from sysid.identification.valve_discrete.curve import (
    UNITS,
    CurveFit,
    iso_names,
    thesis_names,
)
from sysid.identification.valve_discrete.held_chamber import DELAYS, FLOWS
from sysid.identification.valve_discrete.law_choice import LawChoice
from sysid.identification.valve_discrete.notices import JUMPS
from sysid.identification.valve_discrete.quality import qualities
from sysid.identification.valve_discrete.ratio import critical_ratio, directions
from sysid.identification.valve_discrete.regimes import Stretches
from sysid.identification.valve_discrete.result import DiscreteFit, PressureCurve
from sysid.io.logs import Trial
from sysid.io.rig import Air
from sysid.parameters.valves import (
    BY_ISO,
    DIRECTIONS,
    FLOW_CONTROL,
    ISO6358,
    SERIES,
    THESIS,
    VALVE_ALONE,
    WAYS,
)
from sysid.plant.base import exhaust_jump, filling_jump
from sysid.plant.valve_timing import switched_intervals
from sysid.signals import SAMPLE_MISSING
from sysid.types import FloatArray


def flows_and_delays(
    curves: CurveFit,
    reasons: Mapping[str, str],
    title: str,
    notices: list[str],
    delays: Mapping[str, CurveFit] = MappingProxyType({}),
) -> dict[str, Estimate]:
    """The flow parameters and delays; `reasons` say why some are not identified, `delays` are the
    fits from which delays are taken that are held in this one."""
    found: dict[str, Estimate] = {}
    if not curves.fit.converged:
        notices.append(f"{title}: the fit did not converge ({curves.fit.message})")
    flows = [name for way in WAYS for name in curves.problem.flow_names(way)]
    why = {**reasons, **_iso_reasons(curves, reasons)}
    for name in (*flows, *DELAYS):
        if name in why:
            found[name] = Estimate.unidentified(UNITS[name], why[name])
            continue
        if name in flows and name not in curves.problem.free:
            value = float(getattr(curves.problem.start, name))
            found[name] = Estimate(value, 0.0, UNITS[name], (value, value))
            continue
        estimate, scatters = delays.get(name, curves).estimate(name)
        size = 1.0 if name.startswith("critical_ratio") else estimate.value
        if estimate.identified and name in flows and estimate.std > MOST_STD * size:
            share = 100.0 * estimate.std / size
            estimate = Estimate.unidentified(
                UNITS[name],
                f"its standard error is {share:.0f} %: record more tests, or log faster",
            )
        if name in DELAYS and estimate.identified and estimate.interval[1] < 0.0:
            estimate = Estimate.unidentified(UNITS[name], _why_early(name, estimate, curves))
        if scatters and estimate.identified:
            notices.append(
                f"{title}: {name} differs between tests by more than the noise explains; its "
                "interval follows from the scatter of the tests"
            )
        found[name] = estimate
    by_iso = {n: Estimate.unidentified(UNITS[n], BY_ISO) for n in FLOWS if n not in found}
    return found | by_iso


def with_lost_edges(
    estimates: Mapping[str, Estimate],
    trials: Sequence[Trial],
    commands: tuple[str, str],
    title: str,
    notices: list[str],
) -> dict[str, Estimate]:
    """The estimates, of which delays may be longer where rows are missing before a command's edge.

    `commands`: whose edges begin what each of `DELAYS` delays; the same one for on and off.
    """
    found = dict(estimates)
    for name, command, rises in zip(
        DELAYS, commands, (True, commands[0] != commands[1]), strict=True
    ):
        lost = [e for t in trials if command in t for e in _lost_before(t, command, rises)]
        mean = float(np.mean(lost)) if lost else 0.0
        estimate = found[name]
        if not mean > 0.0 or not estimate.identified:
            continue
        low, high = estimate.interval
        found[name] = replace(
            estimate,
            std=math.hypot(estimate.std, mean / math.sqrt(3.0)),
            interval=(low, high + mean),
        )
        notices.append(
            f"{title}: rows are missing before {command} switches in "
            f"{np.count_nonzero(lost)} of {len(lost)} cases, so that its time is known to "
            f"{1e3 * mean:.3g} ms on average, by which {name} may be longer"
        )
    return found


def _lost_before(trial: Trial, command: str, rises: bool) -> FloatArray:
    """Time, s, in which each edge of a test's command may have been before its row."""
    opens, closes = switched_intervals(trial.time, trial[command])
    edges = opens if rises else closes
    steps = np.diff(trial.time)
    usual = float(np.median(steps))
    row = np.searchsorted(trial.time, edges[np.isfinite(edges)])
    before = steps[row[row > 0] - 1]
    return np.where(before >= SAMPLE_MISSING * usual, before - usual, 0.0)


def _iso_reasons(curves: CurveFit, reasons: Mapping[str, str]) -> dict[str, str]:
    """Why numbers of ISO 6358 are not identified: as those of the thesis' law would not be.

    A ratio of the fit needs no reason: its boundary is not where the thesis' law has it.
    """
    found = {}
    for way in WAYS:
        if curves.problem.law(way) == ISO6358:
            choked, unchoked = (reasons.get(name) for name in thesis_names(way))
            conductance, ratio, _ = iso_names(way)
            if choked and unchoked:
                found[conductance] = choked
            if unchoked and ratio not in curves.problem.free:
                found[ratio] = unchoked
    return found


def _why_early(name: str, delay: Estimate, curves: CurveFit) -> str:
    """Why a pressure seems to respond before its command, and the fix."""
    rows = [float(np.median(np.diff(p.chamber.time))) for p in curves.problem.pieces]
    row = float(np.median(rows))
    low, high = (1e3 * end for end in delay.interval)
    if delay.value > -row:  # a command is seen at the row after it
        return (
            f"the command's time is known to a row of {1e3 * row:.3g} ms only, which makes it "
            f"{low:.3g} to {high:.3g} ms: log faster"
        )
    direction = dict(zip(DELAYS, DIRECTIONS, strict=True))[name]
    quality = qualities(curves).get(direction)
    if quality is not None and quality.lack_of_fit.is_significant:
        return (
            f"the law misses the {direction} by {quality.rmse:.3g} Pa rms (noise "
            f"{quality.scatter:.3g} Pa), and a delay of {low:.3g} to {high:.3g} ms makes good a "
            "part of it: take a law that follows it (--law), or have diagnose find what it lacks"
        )
    return (
        f"the pressure responds before the command ({low:.3g} to {high:.3g} ms after it): "
        "check for a command logged late, or an unsteady supply that is not logged"
    )


def with_volume_error(
    curves: CurveFit, estimates: Mapping[str, Estimate], volume: VolumeError
) -> tuple[dict[str, Estimate], JointCovariance]:
    """The estimates, and the joint covariance, with the held position's error in every flow.

    It is in no delay, no critical ratio and no jump.
    """
    conductances = (iso_names(way)[0] for way in WAYS)
    names = (*FLOWS, *conductances, *VALVE_ALONE.values(), *FLOW_CONTROL.values())
    known = {name: estimates[name] for name in names if name in estimates}
    flows = {name: e for name, e in known.items() if e.identified and math.isfinite(e.std)}
    wider = {
        name: volume.in_estimate(flow, shows_scatter=name in curves.scattering)
        for name, flow in flows.items()
    }
    values = {name: flow.value for name, flow in flows.items()}
    held = {n: estimates[n].std ** 2 for n in DELAYS if n not in curves.problem.free}
    known_errors = {n: v for n, v in held.items() if math.isfinite(v)}
    return {**estimates, **wider}, volume.in_joint(curves.joint.joined(known_errors), values)


def critical_ratios(curves: CurveFit, estimates: Mapping[str, Estimate]) -> dict[str, Estimate]:
    """The critical ratios with the boundary left free."""
    found = {}
    for way, direction in zip(WAYS, directions(curves), strict=True):
        if curves.problem.law(way) != THESIS:
            continue
        missing = [n for n in direction.free if not estimates[n].identified]
        if missing:
            why = f"{', '.join(missing)} not identified"
            found[direction.ratio] = Estimate.unidentified("-", why)
            continue
        ratio = on_its_own(partial(critical_ratio, curves, direction))
        if isinstance(ratio, Failure):
            ratio = Estimate.unidentified("-", ratio.reason)
        found[direction.ratio] = ratio
    return found


def boundary_jumps(
    curves: CurveFit, estimates: Mapping[str, Estimate], air: Air
) -> dict[str, Estimate]:
    """Jump of the fitted law at the boundary of ratio 0.53, percent, at the rig's pressures."""
    supply, atmosphere = air.supply_pressure_pa, air.atmospheric_pressure_pa
    found = {}
    for name, way in zip(JUMPS, WAYS, strict=True):
        if curves.problem.law(way) == ISO6358:
            continue
        choked, unchoked = thesis_names(way)
        if curves.problem.law(way) == SERIES:
            if VALVE_ALONE[way] not in curves.problem.free:
                continue
            unchoked = VALVE_ALONE[way]  # at whose own boundary the law jumps
        m, c = estimates[choked], estimates[unchoked]
        if not (m.identified and c.identified):
            why = "needs both the choked and the unchoked interval"
            found[name] = Estimate.unidentified("%", why)
            continue
        value = (
            float(filling_jump(supply, m.value, c.value))
            if name == JUMPS[0]
            else float(exhaust_jump(atmosphere, m.value, c.value))
        )
        i, k = (curves.fit.names.index(n) for n in (choked, unchoked))
        shared = float(curves.covariance.matrix[i, k]) / (m.value * c.value)
        variance = (m.std / m.value) ** 2 + (c.std / c.value) ** 2 - 2.0 * shared
        std = 100.0 * (1.0 + value) * math.sqrt(max(variance, 0.0))
        dof = float(min(curves.covariance.dof[i], curves.covariance.dof[k]))
        found[name] = Estimate.symmetric(100.0 * value, std, "%", dof)
    return found


def fit_of(
    valve: str,
    curves: CurveFit,
    estimates: Mapping[str, Estimate],
    read: Sequence[Stretches],
    air: Air,
    judged: Mapping[str, FitQuality],
    joint: JointCovariance,
    choice: LawChoice,
) -> DiscreteFit:
    """A valve's fit with its curves; `read` are the start values of each test, `joint` the
    covariance of flows, coefficients and delays."""
    pieces = curves.problem.pieces
    measured = np.concatenate([p.pressure for p in pieces])
    residuals = curves.fit.residuals
    spread = float(np.linalg.norm(measured - measured.mean()))
    nrmse = float(np.linalg.norm(residuals)) / spread
    return DiscreteFit(
        valve=valve,
        estimates=dict(estimates),
        stretches={
            n: float(np.median([r.values[n] for r in read if n in r.values]))
            for n in (*FLOWS, *DELAYS)
            if any(n in r.values for r in read)
        },
        supply=air.supply_pressure_pa,
        rmse=float(np.sqrt(np.mean(residuals**2))),
        noise=float(np.median([p.noise for p in pieces])),
        fit_percent=100.0 * (1.0 - nrmse),
        curves=tuple(
            PressureCurve(p.label, p.chamber.time, p.pressure, p.pressure + curves.residuals(i))
            for i, p in enumerate(pieces)
        ),
        quality=judged,
        joint=joint,
        choice=choice,
    )


__all__ = [
    "boundary_jumps",
    "critical_ratios",
    "fit_of",
    "flows_and_delays",
    "with_lost_edges",
    "with_volume_error",
]
