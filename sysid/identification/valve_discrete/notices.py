"""Notices and remarks on a fitted on/off valve."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from sysid.estimation.linear import NORMAL, Estimate
from sysid.estimation.quality import FEWEST_ROWS, SCATTER_TIMES, root_mean_square
from sysid.identification.valve_discrete.curve import CurveFit
from sysid.identification.valve_discrete.held_chamber import DELAYS
from sysid.identification.valve_discrete.law_choice import LawChoice
from sysid.identification.valve_discrete.trials import SUPPLY_TOLERANCE, Piece
from sysid.io.plausibility import give_map
from sysid.io.rig import Air, Rig
from sysid.io.unit_text import TAKEN_FOR_SI
from sysid.parameters.valves import AUTO, ISO6358, LAW_NAMES, SERIES
from sysid.plant.base import CRITICAL_RATIO
from sysid.types import BoolArray, FloatArray

RATIOS = ("critical_ratio_fill", "critical_ratio_dis")
JUMPS = ("jump_fill_percent", "jump_dis_percent")
_LAWS = {ISO6358: "law of ISO 6358", SERIES: "law of a flow control in series"}
# Of a delay, how far it may be from its data sheet's.
_DELAY_TOLERANCE = 0.15
# By how much data sheets are wrong at most, which is less than the units of a time differ by.
_DATA_SHEET = 5.0
_RATIO_TOLERANCE = 0.02


def tank_notices(pieces: Sequence[Piece], title: str, rig: Rig) -> list[str]:
    """Of a tank: what flows are if its wall keeps the gas at the room's temperature."""
    if rig.held_tank is None or not pieces:
        return []
    k = rig.require("air", "which the valve law needs").heat_capacity_ratio
    return [
        f"{title}: by its law the tank's gas takes no heat from the wall (3.3.6), as while it "
        "fills or empties at once; where the wall keeps it as warm as the room, flows and "
        f"coefficients {k:.3g} times as large would be right"
    ]


def settled_notices(curves: CurveFit, title: str, air: Air) -> list[str]:
    """Tests that settle at other pressures than the rig file's (or the logged supply)."""
    lines = []
    for i, piece in enumerate(curves.problem.pieces):
        shift = curves.value("supply_shift", i)
        supply = float(np.mean(piece.chamber.supply)) + shift
        declared = air.supply_pressure_pa
        fills = bool(np.isfinite(piece.chamber.opens).any())
        if piece.supply_logged and abs(shift) > SUPPLY_TOLERANCE * declared:
            lines.append(
                f"{piece.source}: the chamber fills to {supply:.6g} Pa, {abs(shift):.3g} Pa off "
                "the logged supply: one of the two sensors has an offset; "
                f"{title} is fitted to the chamber's sensor"
            )
        elif fills and abs(supply - declared) > SUPPLY_TOLERANCE * declared:
            seen = "logged supply is" if piece.supply_logged else "chamber fills to"
            lines.append(
                f"{piece.source}: the {seen} {supply:.6g} Pa, the rig file's supply_pressure_pa is "
                f"{declared:.6g} Pa: {title}'s c_fill is fitted with the former and its choked "
                "filling flow is scaled to the latter"
            )
        if fills and not (piece.fits_supply or piece.supply_logged or piece.saturated):
            lines.append(
                f"{piece.source}: the filling does not settle, so the supply is assumed to be the "
                f"rig file's {declared:.6g} Pa; {title}'s c_fill depends on that"
            )
        rest, unsure = curves.value("atmosphere", i), NORMAL * curves.error("atmosphere", i)
        # A chamber that hardly begins to empty does not say where it would rest.
        if abs(rest - air.atmospheric_pressure_pa) > max(SUPPLY_TOLERANCE * rest, unsure):
            lines.append(
                f"{piece.source}: the open chamber rests at {rest:.6g} Pa, the rig file's "
                f"atmospheric_pressure_pa is {air.atmospheric_pressure_pa:.6g} Pa: {title}'s c_dis "
                "is fitted with the former"
            )
    return lines


def lack_of_fit_notices(curves: CurveFit, title: str, choice: LawChoice) -> list[str]:
    """Fillings and discharges that the law misses by more than the noise.

    Pieces with too few rows in motion to be judged alone are judged together. A direction of
    which no flow is fitted gives no notice.
    """
    lines = []
    problem = curves.problem
    for what, way, rises in (("filling", "fill", True), ("discharge", "dis", False)):
        # Of two valves either one's opening begins what it does.
        two = all(piece.chamber.bleeds is not None for piece in problem.pieces)
        delay = DELAYS[0 if rises or two else 1]
        names = problem.flow_names(way)[:2]
        if not set(names) & set(problem.free):
            continue
        law = _LAWS.get(problem.law(way), "two-regime law")
        of_the_delay = (
            f"{delay} is that of {LAW_NAMES[choice.better[way]]}, which follows it better"
            if delay in choice.delays
            else f"{delay} is biased by what it misses"
        )
        said = (law, what, (*names, of_the_delay))
        short = []
        for i, piece in enumerate(curves.problem.pieces):
            residuals = curves.residuals(i)[_in_motion(curves, i, rises)]
            if len(residuals) >= FEWEST_ROWS:
                lines += _lack_of_fit([(piece, residuals)], piece.source, said, title)
            elif len(residuals):
                short.append((piece, residuals))
        if sum(len(residuals) for _, residuals in short) >= FEWEST_ROWS:
            together = f"{len({piece.source for piece, _ in short})} tests together"
            lines += _lack_of_fit(short, together, said, title)
    return lines


def _in_motion(curves: CurveFit, index: int, rises: bool) -> BoolArray:
    """Rows (n,) of a piece in which the fitted pressure rises (or falls), away from its ends."""
    piece = curves.problem.pieces[index]
    fitted = piece.pressure + curves.residuals(index)
    away = 3.0 * piece.noise
    rest, supply = curves.value("atmosphere", index), piece.supply
    moving = (np.abs(fitted - rest) > away) & (np.abs(fitted - supply) > away)
    return np.asarray(moving & ((np.gradient(fitted) > 0.0) == rises))


def _lack_of_fit(
    judged: Sequence[tuple[Piece, FloatArray]],
    source: str,
    said: tuple[str, str, Sequence[str]],
    title: str,
) -> list[str]:
    """A line where the residuals of the pieces, Pa, are more than their noise.

    `said`: the law, what it misses, the two numbers that this touches, and what of the delay.
    """
    law, what, names = said
    rms = root_mean_square(np.concatenate([residuals for _, residuals in judged]))
    noise = root_mean_square(np.repeat([p.noise for p, _ in judged], [len(r) for _, r in judged]))
    if rms <= SCATTER_TIMES * noise:
        return []
    return [
        f"{source}: the {law} misses the {what} by {rms:.3g} Pa rms "
        f"(noise {noise:.3g} Pa): {title}'s {names[0]} and {names[1]} are its "
        f"best approximation, not the valve's law, and {names[2]}"
    ]


def delay_notices(
    estimates: Mapping[str, Estimate], title: str, rig: Rig, slip: str | None
) -> list[str]:
    """Measured delays that differ from the declared ones; `slip`: their `time_slip`."""
    if rig.valves is None:
        return []
    if slip is not None:
        return [f"{title}: {slip}"]
    lines = []
    for name, declared in zip(DELAYS, (rig.valves.on_delay_s, rig.valves.off_delay_s), strict=True):
        e = estimates[name]
        if (
            e.identified
            and not e.holds(declared)
            and abs(e.value - declared) > _DELAY_TOLERANCE * max(abs(e.value), declared)
        ):
            lines.append(
                f"{title}: {name} is {1e3 * e.value:.3g} ms ({1e3 * e.interval[0]:.3g} to "
                f"{1e3 * e.interval[1]:.3g}), the rig file declares {1e3 * declared:.3g} ms"
            )
    return lines


def time_slip(estimates: Mapping[str, Estimate], rig: Rig) -> str | None:
    """A line where all delays are so many times the declared ones that the log's time is not in s.

    By the factor of another unit: a data sheet is not that wrong, and flows are as wrong.
    """
    if rig.valves is None or rig.assumes("valves"):
        return None
    sheet = zip(DELAYS, (rig.valves.on_delay_s, rig.valves.off_delay_s), strict=True)
    times = [
        estimates[name].value / declared
        for name, declared in sheet
        if name in estimates and estimates[name].identified and declared > 0.0
    ]
    if not times or min(times) <= 0.0:
        return None
    middle = float(np.exp(np.mean(np.log(times))))
    factors = [power for f in TAKEN_FOR_SI["s"].values() for power in (f, 1.0 / f)]
    nearest = min(factors, key=lambda factor: abs(math.log(middle / factor)))
    if not all(nearest / _DATA_SHEET < t < nearest * _DATA_SHEET for t in times):
        return None
    said = "large" if nearest > 1.0 else "small"
    units = [unit for unit, f in TAKEN_FOR_SI["s"].items() if math.isclose(1.0 / f, nearest)]
    fix = give_map("time_s", "time_s", units[0]) if units else "map the time with its unit"
    return (
        f"all delays are about {max(nearest, 1.0 / nearest):g} times too {said} for the rig "
        "file's: time_s is not in s (or the rig file's delays are not), and every flow is as "
        f"wrong; {fix}"
    )


def law_remarks(choice: LawChoice, title: str) -> list[str]:
    """Which law was chosen and why, where it is not plainly the thesis'."""
    names = choice.laws.values()
    unlike = choice.undecided or choice.disagrees or choice.denied
    plain = not (unlike or {ISO6358, SERIES} & {*names})
    if choice.asked == AUTO and plain and choice.series is None:
        return []
    why = choice.why()
    if choice.series is not None and SERIES not in names:
        why = (
            f"{why}; these tests are evidence against a flow control in series (twice the log "
            f"evidence for it {choice.series:.3g}), so that the logs without one are not used"
        )
    kept = "; the thesis' law is kept" if choice.undecided and choice.asked == AUTO else ""
    return [f"{title}: {why}{kept}"] if why else []


def verdicts(estimates: Mapping[str, Estimate], title: str) -> list[str]:
    """The critical ratio against 0.53, and the size of the jump, by direction."""
    lines = []
    for ratio, jump, what in zip(RATIOS, JUMPS, ("filling", "exhaust"), strict=True):
        r, j = estimates.get(ratio), estimates.get(jump)
        if r is None or j is None or not (r.identified and j.identified):
            continue
        off = not r.holds(CRITICAL_RATIO) and abs(r.value - CRITICAL_RATIO) > _RATIO_TOLERANCE
        verdict = f"not {CRITICAL_RATIO}" if off else f"{CRITICAL_RATIO} fits"
        lines.append(
            f"{title}, {what}: critical ratio {r.value:.3f} ({r.interval[0]:.3f} to "
            f"{r.interval[1]:.3f}; {verdict}), the law jumps by {j.value:.1f} % at the boundary"
        )
    return lines
