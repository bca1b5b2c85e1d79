"""From on/off valve tests to flows, coefficients and delays (thesis 3.5.3, 3.6.6, 3.6.10).

The piston is held, the valve is switched on and off again. The interval of each regime gives
start values by 3.5.3; the whole pressure curve is then fitted by simulation error, with the
simulation in closed form, so that delays are resolved to a fraction of a sample.

The supply and the atmosphere are the pressures at which the chamber settles in each test;
where it does not settle, those of the log (`supply_pressure_pa`) or the rig file. Choked
filling is proportional to the supply: the fitted value is for the rig file's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from sysid.errors import Failure, InputError, NotIdentifiedError, error_of, input_error, on_its_own
from sysid.estimation.linear import Estimate
from sysid.estimation.quality import FitQuality
from sysid.identification.valve_discrete.curve import DELAYS, FLOWS, UNITS, CurveFit, fit_curves
from sysid.identification.valve_discrete.held_chamber import DiscreteValve
from sysid.identification.valve_discrete.notices import (
    JUMPS,
    delay_notices,
    misfit_notices,
    settled_notices,
    verdicts,
)
from sysid.identification.valve_discrete.quality import qualities
from sysid.identification.valve_discrete.ratio import DISCHARGE, FILL, critical_ratio
from sysid.identification.valve_discrete.regimes import Stretches, read_stretches
from sysid.identification.valve_discrete.result import (
    DiscreteFit,
    PressureCurve,
    ValveDiscreteResult,
)
from sysid.identification.valve_discrete.trials import Piece, Screened, screen
from sysid.io.channels import SIDES
from sysid.io.logs import Trial, any_contradiction
from sysid.io.rig import Air, Rig
from sysid.io.trial_kind import away_from_ends
from sysid.plant.base import CRITICAL_RATIO, exhaust_jump, filling_jump

__all__ = [
    "DiscreteFit",
    "PressureCurve",
    "ValveDiscreteResult",
    "fit_valve_discrete",
    "flows_not_shown",
]

# With a standard error above this share, a flow is not identified.
_LARGEST_ERROR = 0.3
# Tests from which the scatter may represent a supply that no test shows at rest.
_FEWEST_RISES = 3


def fit_valve_discrete(
    trials: Sequence[Trial], rig: Rig, *, valve: str | None = None, find_ratio: bool = True
) -> ValveDiscreteResult:
    """Fit the on/off valves that the trials switch; `valve` ("a" or "b") keeps one.

    `find_ratio`: also estimate the critical ratio, which takes longer than the rest of the fit.
    A parameter that the tests do not identify has no value and gives the reason. Raises
    InputError where a channel is missing, NotIdentifiedError where the tests identify no flow
    parameter at all.
    """
    air: Air = rig.require("air", "which the valve law needs")
    fits: dict[str, DiscreteFit] = {}
    remarks: list[str] = []
    notices: list[str] = []
    failed: list[Failure] = []
    for side in _valves(trials, valve):
        fit = partial(_fit_valve, trials, side, rig, air, find_ratio, remarks, notices)
        found = on_its_own(fit)
        if isinstance(found, Failure):
            failed.append(found)
        else:
            fits[side] = found
    reasons = [why.reason for why in failed]
    if not fits:
        raise error_of(failed, "; ".join(dict.fromkeys(reasons)))
    return ValveDiscreteResult(fits, tuple(remarks), (*notices, *reasons))


def _valves(trials: Sequence[Trial], valve: str | None) -> list[str]:
    """The valves that are switched, in order; `valve` where it is given."""
    if not trials:
        raise NotIdentifiedError("no test given: give a valve-discrete log")
    if valve is not None:
        if valve not in SIDES:
            raise input_error("valve", f"{valve!r} is neither a nor b", "write a or b")
        return [valve]
    if not any(f"valve_{v}" in t for v in "ab" for t in trials):
        raise _no_command(trials[0])
    switched = [v for v in "ab" if any(_is_switched(t, v) for t in trials)]
    if not switched:
        raise NotIdentifiedError(
            f"{trials[0].source}: no test switches a valve on (valve_a and valve_b stay 0): no "
            "flow is identified; a valve-discrete test (off, on for 3 s, off, piston held) would"
        )
    return switched


def _no_command(trial: Trial) -> InputError:
    fix = 'add them, or map them with --map "valve_a=COLUMN"'
    return input_error(trial.source, "columns valve_a and valve_b are missing", fix)


def _is_switched(trial: Trial, valve: str) -> bool:
    name = f"valve_{valve}"
    return name in trial and bool(np.any(trial[name] > 0.5))


def _fit_valve(
    trials: Sequence[Trial],
    valve: str,
    rig: Rig,
    air: Air,
    find_ratio: bool,
    remarks: list[str],
    notices: list[str],
) -> DiscreteFit:
    used = [t for t in trials if _is_switched(t, valve)]
    title = f"valve {valve.upper()}"
    if not used:
        trials[0].require([f"valve_{valve}"], f"which tells when {title} switches")
        raise NotIdentifiedError(
            f"{title}: no test switches it on (valve_{valve} stays 0): none of its parameters is "
            "identified; a valve-discrete test of it (off, on for 3 s, off, piston held) would"
        )
    screened = _screened(used, valve, rig)
    notices += [n for s in screened for n in s.notices]
    away = away_from_ends(used, rig)
    notices += [f"{title}: {away}"] if away else []
    pieces = [p for s in screened for p in s.pieces]
    read = [read_stretches(p) for p in pieces]
    start, reasons = _start(screened, read, rig)
    if all(name in reasons for name in FLOWS):
        raise NotIdentifiedError(f"{title}: {_joined(reasons)}")
    curves = fit_curves(pieces, start, _free(reasons, read, pieces))
    contradicted = any_contradiction(used)
    judged = {
        way: replace(one, contradicted=contradicted) for way, one in _judged(curves, title).items()
    }
    estimates = _estimates(curves, reasons, title, notices)
    estimates |= _ratios(curves, estimates) if find_ratio else {}
    estimates |= _jumps(curves, estimates, air)
    notices += [
        f"{title}: {name} is not identified: {estimates[name].reason}"
        for name in (*FLOWS, *DELAYS)
        if not estimates[name].identified
    ]
    notices += settled_notices(curves, title, air)
    notices += misfit_notices(curves, title)
    notices += delay_notices(estimates, title, rig)
    remarks += verdicts(estimates, title)
    return _result(valve, curves, estimates, read, air, judged)


def _screened(used: Sequence[Trial], valve: str, rig: Rig) -> list[Screened]:
    screened = [screen(t, valve, rig) for t in used]
    if len(used) >= _FEWEST_RISES and all(s.never_still for s in screened):
        # A supply that is never steady is part of the rig: the tests' scatter shows its influence.
        screened = [screen(t, valve, rig, keep_rise=True) for t in used]
    return screened


def flows_not_shown(trials: Sequence[Trial], rig: Rig, valve: str) -> dict[str, str]:
    """Why a fit of these tests would not identify flows of a valve, by their names in a bundle.

    As far as their samples say before anything is fitted. Raises as `fit_valve_discrete`.
    """
    rig.require("air", "which the valve law needs")
    screened = _screened([t for t in trials if _is_switched(t, valve)], valve, rig)
    read = [read_stretches(p) for s in screened for p in s.pieces]
    _, reasons = _start(screened, read, rig)
    return {name: why for name, why in reasons.items() if name in FLOWS}


def _judged(curves: CurveFit, title: str) -> dict[str, FitQuality]:
    """How well the law follows each direction; NotIdentifiedError where it does not."""
    judged = qualities(curves)
    wrong = [f"{title}, {q.shortfall}" for q in judged.values() if q.explains_too_little]
    if wrong:
        raise NotIdentifiedError(
            f"{'; '.join(wrong)}: look for a wrong unit or time base, the other chamber's "
            "pressure, a command that is not this valve's, or a piston that moves"
        )
    return judged


def _joined(reasons: Mapping[str, str]) -> str:
    """Each reason once, after its parameters."""
    by_reason: dict[str, list[str]] = {}
    for name in FLOWS:
        by_reason.setdefault(reasons[name], []).append(name)
    return "; ".join(f"{', '.join(n)} not identified: {why}" for why, n in by_reason.items())


def _start(
    screened: Sequence[Screened], read: Sequence[Stretches], rig: Rig
) -> tuple[DiscreteValve, dict[str, str]]:
    """Start of the fit: medians over the tests; and why parameters are missing from all."""
    names = (*FLOWS, *DELAYS)
    found = {
        n: float(np.median([r.values[n] for r in read if n in r.values]))
        for n in names
        if any(n in r.values for r in read)
    }
    reasons: dict[str, str] = {}
    cut = dict(reason for s in reversed(screened) for reason in reversed(s.reasons))
    for name in names:
        given = [r for r in read if name not in r.reasons]
        if not given:
            why = [r.reasons[name] for r in read]
            reasons[name] = cut.get(name) or (why[0] if why else "none of its tests can be used")
    declared = (rig.valves.on_delay_s, rig.valves.off_delay_s) if rig.valves else (0.002, 0.002)
    supply = rig.air.supply_pressure_pa if rig.air else 3e5
    atmosphere = rig.air.atmospheric_pressure_pa if rig.air else 1e5
    # Fixed where the data give nothing: the law that is continuous at the choked boundary.
    fill_root = math.sqrt(supply * (1.0 - CRITICAL_RATIO))
    dis_gauge = atmosphere * (1.0 / CRITICAL_RATIO - 1.0)
    choked_fill = found.get("choked_flow_fill_kg_s", found.get("c_fill", 2e-6) * fill_root)
    choked_dis = found.get("choked_flow_dis_kg_s", found.get("c_dis", 4e-9) * dis_gauge)
    valve = DiscreteValve(
        choked_flow_fill_kg_s=choked_fill,
        c_fill=found.get("c_fill", choked_fill / fill_root),
        choked_flow_dis_kg_s=choked_dis,
        c_dis=found.get("c_dis", choked_dis / dis_gauge),
        on_delay_s=found.get("on_delay_s", declared[0]),
        off_delay_s=found.get("off_delay_s", declared[1]),
    )
    return valve, reasons


def _free(
    reasons: Mapping[str, str], read: Sequence[Stretches], pieces: Sequence[Piece]
) -> list[str]:
    """The fitted parameters: the identified ones, and others that would otherwise bias them.

    A flow with too few samples still affects them: held at a guess, it would bias the other flow of
    its direction. Where no sample lies in a choked interval, its flow and the delay before it are
    identified only in combination, and the flow alone is free.
    """
    free = [n for n in (*FLOWS, *DELAYS) if n not in reasons]
    sparse = {n for r in read for n in r.sparse} & set(reasons)
    edges = (
        any(np.isfinite(p.chamber.opens).any() for p in pieces),
        any((p.chamber.closes < p.chamber.time[-1]).any() for p in pieces),
    )
    for pair, delay, seen in zip((FLOWS[:2], FLOWS[2:]), DELAYS, edges, strict=True):
        beside = sparse & set(pair) if set(pair) & set(free) else set()
        free += [n for n in pair if n in beside]
        choked, unchoked = pair
        apart = choked not in beside or delay in sparse
        if delay not in free and unchoked in free and seen and apart:
            free.append(delay)
    return free


def _estimates(
    curves: CurveFit, reasons: Mapping[str, str], title: str, notices: list[str]
) -> dict[str, Estimate]:
    found: dict[str, Estimate] = {}
    if not curves.fit.converged:
        notices.append(f"{title}: the fit did not converge ({curves.fit.message})")
    for name in (*FLOWS, *DELAYS):
        if name in reasons:
            found[name] = Estimate.unidentified(UNITS[name], reasons[name])
            continue
        estimate, scatters = curves.estimate(name)
        if estimate.identified and name in FLOWS and estimate.std > _LARGEST_ERROR * estimate.value:
            share = 100.0 * estimate.std / estimate.value
            estimate = Estimate.unidentified(
                UNITS[name],
                f"its standard error is {share:.0f} %: record more tests, or log faster",
            )
        if name in DELAYS and estimate.identified and estimate.interval[1] < 0.0:
            estimate = Estimate.unidentified(UNITS[name], _why_early(estimate, curves))
        if scatters and estimate.identified:
            notices.append(
                f"{title}: {name} differs between tests by more than the noise explains; its "
                "interval follows from the scatter of the tests"
            )
        found[name] = estimate
    return found


def _why_early(delay: Estimate, curves: CurveFit) -> str:
    """Why a pressure seems to answer before its command, and the fix."""
    rows = [float(np.median(np.diff(p.chamber.time))) for p in curves.problem.pieces]
    row = float(np.median(rows))
    low, high = (1e3 * end for end in delay.interval)
    if delay.value > -row:  # a command is seen at the row after it
        return (
            f"the command's time is known to a row of {1e3 * row:.3g} ms only, which makes it "
            f"{low:.3g} to {high:.3g} ms: log faster"
        )
    return (
        f"the pressure answers before the command ({low:.3g} to {high:.3g} ms after it): "
        "look for a command that is logged late, or an unsteady supply that is not logged"
    )


def _ratios(curves: CurveFit, estimates: Mapping[str, Estimate]) -> dict[str, Estimate]:
    """The critical ratios with the boundary left free."""
    found = {}
    for direction in (FILL, DISCHARGE):
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


def _jumps(curves: CurveFit, estimates: Mapping[str, Estimate], air: Air) -> dict[str, Estimate]:
    """Jump of the fitted law at the boundary of ratio 0.53, percent, at the rig's pressures."""
    supply, atmosphere = air.supply_pressure_pa, air.atmospheric_pressure_pa
    found = {}
    for name, (choked, unchoked) in zip(JUMPS, (FLOWS[:2], FLOWS[2:]), strict=True):
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


def _result(
    valve: str,
    curves: CurveFit,
    estimates: Mapping[str, Estimate],
    read: Sequence[Stretches],
    air: Air,
    judged: Mapping[str, FitQuality],
) -> DiscreteFit:
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
        joint=curves.joint,
    )
