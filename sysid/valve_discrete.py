"""From on/off valve tests to flows and delays (thesis 3.5.3, 3.6.6, 3.6.10, or ISO 6358).

The piston is held, the valve is switched on and off again. The interval of each regime gives
start values by 3.5.3; the whole pressure curve is then fitted by simulation error, with the
simulation in closed form, so that delays are resolved to a fraction of a sample.

The supply and the atmosphere are the pressures at which the chamber settles in each test;
where it does not settle, those of the log (`supply_pressure_pa`) or the rig file. Choked
filling is proportional to the supply: the fitted value is for the rig file's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from sysid.errors import (
    Failure,
    InputError,
    NotIdentifiedError,
    about,
    error_of,
    input_error,
    on_its_own,
)
from sysid.identification.held_volume import VolumeError, position_count
from sysid.identification.valve_discrete.curve import CurveFit, fit_curves
from sysid.identification.valve_discrete.estimates import (
    boundary_jumps,
    critical_ratios,
    fit_of,
    flows_and_delays,
    with_lost_edges,
    with_volume_error,
)
from sysid.identification.valve_discrete.held_chamber import DELAYS, FLOWS
from sysid.identification.valve_discrete.law_choice import AUTO, LAWS, SERIES, chosen
from sysid.identification.valve_discrete.notices import (
    delay_notices,
    lack_of_fit_notices,
    law_remarks,
    settled_notices,
    tank_notices,
    time_slip,
    verdicts,
)
from sysid.identification.valve_discrete.quality import judged
from sysid.identification.valve_discrete.regimes import read_stretches
from sysid.identification.valve_discrete.result import (
    DiscreteFit,
    PressureCurve,
    ValveDiscreteResult,
)
from sysid.identification.valve_discrete.series import (
    ValveAlone,
    flow_names,
    series_fit,
    valve_alone,
    with_flow_controls,
)
from sysid.identification.valve_discrete.start import free_parameters, start_of
from sysid.identification.valve_discrete.trials import is_switched, screened_tests
from sysid.io.channels import SIDES
from sysid.io.logs import Trial, any_contradiction
from sysid.io.rig import Air, Rig
from sysid.io.trial_kind import away_from_ends

__all__ = [
    "DiscreteFit",
    "PressureCurve",
    "ValveDiscreteResult",
    "fit_valve_discrete",
]


def fit_valve_discrete(
    trials: Sequence[Trial],
    rig: Rig,
    *,
    valve: str | None = None,
    find_ratio: bool = True,
    law: str = AUTO,
) -> ValveDiscreteResult:
    """Fit the on/off valves that the trials switch; `valve` ("a" or "b") keeps one.

    `find_ratio`: also estimate the thesis law's critical ratio, which takes longer than the rest of
    the fit. `law`: "thesis", "iso6358", "thesis-series", or "auto", by which the tests choose.
    Trials without the valve's flow control (`Trial.flow_control`), or a declaration in the rig
    file, give the valve's own coefficients, from which "thesis-series" finds the flow control's.
    A parameter that the tests do not identify has no value and gives the reason. Raises
    InputError where a channel is missing, NotIdentifiedError where the tests identify no flow
    parameter at all.
    """
    if law not in (AUTO, *LAWS):
        raise input_error("law", f"{law!r} is no flow law", f"write {', '.join((*LAWS, AUTO))}")
    rig.require("air", "which the valve law needs")
    fits: dict[str, DiscreteFit] = {}
    remarks: list[str] = []
    notices: list[str] = []
    failed: list[Failure] = []
    for side in _valves(trials, valve, rig):
        said: list[str] = []
        fit = partial(_fit_valve, trials, side, rig, (find_ratio, law), remarks, said)
        found = on_its_own(fit)
        notices += about(f"valves.{side}.discrete", said)
        if isinstance(found, Failure):
            failed.append(found)
        else:
            fits[side] = found
    reasons = [why.reason for why in failed]
    if not fits:
        raise error_of(failed, "; ".join(dict.fromkeys(reasons)))
    return ValveDiscreteResult(fits, tuple(remarks), (*notices, *about("valve-discrete", reasons)))


def _valves(trials: Sequence[Trial], valve: str | None, rig: Rig) -> list[str]:
    """The rig's valves that are switched, in order; `valve` where it is given."""
    if not trials:
        raise NotIdentifiedError("no test given: give a valve-discrete log")
    if valve is not None:
        if valve not in SIDES:
            raise input_error("valve", f"{valve!r} is neither a nor b", "write a or b")
        rig.require_side(valve, trials[0].source)
        return [valve]
    names = [f"valve_{rig.filled_by(v)}" for v in rig.sides]
    if not any(f"valve_{name}" in t for name in rig.valve_names for t in trials):
        raise _no_command(trials[0], names, rig)
    switched = [v for v in rig.sides if any(is_switched(t, v) for t in trials)]
    if not switched:
        names = [f"valve_{v}" for v in rig.valve_names]
        verb = "stay" if len(names) > 1 else "stays"
        raise NotIdentifiedError(
            f"{trials[0].source}: no test switches a valve on ({' and '.join(names)} {verb} 0): no "
            f"flow is identified; a valve-discrete test ({rig.valve_steps}) would"
        )
    return switched


def _no_command(trial: Trial, names: Sequence[str], rig: Rig) -> InputError:
    if len(names) > 1:
        what, them = f"columns {' and '.join(names)} are missing", "them"
    else:
        what, them = f"column {names[0]} is missing", "it"
    fix = f'add {them}, or map {them} with --map "{names[0]}=COLUMN"'
    pairs = {f"valve_{v}": f"valve_b{v[1:]}" for v in rig.valve_names}
    if rig.sides == ("a",) and all(other in trial for other in pairs.values()):
        both = {**pairs, "pressure_a_pa": "pressure_b_pa"}
        given = " ".join(f'--map "{name}={other}"' for name, other in both.items())
        what += f", and {pairs[names[0]]} is of a chamber B, which {rig.source} does not list"
        return input_error(trial.source, what, f"map what is of its only chamber with {given}")
    own = [v for v in rig.valve_names if f"duty_{v}" in trial]
    if own and all(np.isin(trial[f"duty_{v}"], (0.0, 1.0)).all() for v in own):
        maps = " ".join(f'--map "valve_{v}=duty_{v}"' for v in own)
        verb, them = ("are", "them") if len(own) > 1 else ("is", "it")
        duties = " and ".join(f"duty_{v}" for v in own)
        fix = f"{duties} {verb} 0 or 1 throughout: map {them} with {maps}"
    return input_error(trial.source, what, fix)


def _fit_valve(
    trials: Sequence[Trial],
    valve: str,
    rig: Rig,
    wanted: tuple[bool, str],
    remarks: list[str],
    notices: list[str],
) -> DiscreteFit:
    """The fit of one valve; `wanted`: whether the critical ratio is, and by which law."""
    air: Air = rig.require("air", "which the valve law needs")
    find_ratio, law = wanted
    switched = [t for t in trials if is_switched(t, valve)]
    used = [t for t in switched if t.flow_control]
    bare = [t for t in switched if not t.flow_control]
    title = f"valve {valve.upper()}"
    if bare and not used:
        raise NotIdentifiedError(
            f"{title}: all of its tests are without its flow control: add tests with it, or leave "
            "flow_control out where the valve has none"
        )
    if not used:
        own = f"valve_{rig.filled_by(valve)}"
        trials[0].require([own], f"which tells when {title} switches")
        raise NotIdentifiedError(
            f"{title}: no test switches it on ({own} stays 0): none of its parameters is "
            f"identified; a valve-discrete test of it ({rig.valve_steps}) would"
        )
    screened = screened_tests(used, valve, rig)
    notices += dict.fromkeys(n for s in screened for n in s.notices)
    away = away_from_ends(used, rig)
    notices += [f"{title}: {away}"] if away else []
    pieces = [p for s in screened for p in s.pieces]
    read = [read_stretches(p) for p in pieces]
    start, reasons = start_of(screened, read, rig)
    if all(name in reasons for name in FLOWS):
        raise NotIdentifiedError(f"{title}: {_joined(reasons)}")
    by_thesis = fit_curves(pieces, start, free_parameters(reasons, read, pieces))
    alone, series = _in_series(bare, valve, rig, by_thesis, law, notices)
    curves, choice = chosen(by_thesis, law, series)
    if series is not None and curves is series:  # whose regimes are others
        reasons = {name: why for name, why in reasons.items() if name not in curves.problem.free}
    estimates = flows_and_delays(curves, reasons, title, notices, choice.delays)
    fills = f"valve_{rig.filled_by(valve)}"
    others = f"valve_{valve}_bleed" if rig.bleeds else fills
    estimates = with_lost_edges(estimates, used, (fills, others), title, notices)
    slip = time_slip(estimates, rig)
    contradicted = any_contradiction(used) or slip is not None
    quality = {
        way: replace(one, contradicted=contradicted)
        for way, one in judged(curves, title, choice.better).items()
    }
    ways = [way for way, name in choice.laws.items() if name == SERIES]
    estimates = with_flow_controls(estimates, series, ways, alone)
    estimates |= critical_ratios(curves, estimates) if find_ratio else {}
    estimates |= boundary_jumps(curves, estimates, air)
    volumes = {p.source: p.volume for p in pieces}
    error = VolumeError.of(list(volumes.values()), valve, rig, position_count(trials, rig))
    estimates, joint = with_volume_error(curves, estimates, error)
    notices += [
        f"{title}: {name} is not identified: {estimates[name].reason}"
        for name in (*flow_names(curves, ways), *DELAYS)
        if not estimates[name].identified
    ]
    notices += tank_notices(pieces, title, rig)
    notices += settled_notices(curves, title, air)
    notices += lack_of_fit_notices(curves, title, choice)
    notices += delay_notices(estimates, title, rig, slip)
    remarks += [*law_remarks(choice, title), *verdicts(estimates, title)]
    return fit_of(valve, curves, estimates, read, air, quality, joint, choice)


def _in_series(
    bare: Sequence[Trial],
    valve: str,
    rig: Rig,
    by_thesis: CurveFit,
    law: str,
    notices: list[str],
) -> tuple[ValveAlone, CurveFit | None]:
    """What is known of the valve without its flow control, and the fit of both in series."""
    screened = screened_tests(bare, valve, rig)
    notices += [n for s in screened for n in s.notices]
    alone = valve_alone(valve, screened, rig)
    if law not in (AUTO, SERIES):
        if alone.pieces:
            notices.append(
                f"valve {valve.upper()}: the logs without flow control are not used: --law {law} "
                "has no flow control"
            )
        return alone, None
    return alone, series_fit(by_thesis, alone) if alone.is_known else None


def _joined(reasons: Mapping[str, str]) -> str:
    """Each reason once, after its parameters."""
    by_reason: dict[str, list[str]] = {}
    for name in FLOWS:
        by_reason.setdefault(reasons[name], []).append(name)
    return "; ".join(f"{', '.join(n)} not identified: {why}" for why, n in by_reason.items())
