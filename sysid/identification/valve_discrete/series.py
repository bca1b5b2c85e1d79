"""A valve and a flow control in series (3.6): the valve's own coefficients, then the other's.

One test with the flow control shows the coefficient of both alone. That of the valve is declared
(`[valve_a]` of the rig file), or follows from tests of it without its flow control; all tests are
then fitted together, as choked flows and delays are the valve's own with the flow control and
without. The coefficient of the flow control follows from the two.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from sysid.estimation.linear import Estimate
from sysid.identification.valve_discrete.curve import (
    UNITS,
    CurveFit,
    fit_curves,
    fitted_valve,
    thesis_names,
)
from sysid.identification.valve_discrete.held_chamber import DELAYS, FLOWS
from sysid.identification.valve_discrete.regimes import read_stretches
from sysid.identification.valve_discrete.start import free_parameters, start_of
from sysid.identification.valve_discrete.trials import Piece, Screened
from sysid.io.rig import Rig
from sysid.parameters.series import COMBINED, control_coefficient
from sysid.parameters.valves import FLOW_CONTROL, VALVE_ALONE, WAYS


@dataclass(frozen=True)
class ValveAlone:
    """What is known of a valve without its flow control.

    `declared`: its coefficients by direction; `pieces`: its tests, `start` and `free` of their fit
    by the names of the valve alone; `reasons`: why directions are not known.
    """

    declared: Mapping[str, float] = field(default_factory=dict)
    pieces: tuple[Piece, ...] = ()
    start: Mapping[str, float] = field(default_factory=dict)
    free: tuple[str, ...] = ()
    reasons: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_known(self) -> bool:
        """Whether anything is."""
        return bool(self.declared) or any(name in self.free for name in VALVE_ALONE.values())


def valve_alone(side: str, screened: Sequence[Screened], rig: Rig) -> ValveAlone:
    """What the rig file declares of valve "a" or "b" alone, and its tests without flow control.

    A direction that is declared is not fitted.
    """
    declared = dict(rig.valve_alone(side))
    pieces = tuple(p for s in screened for p in s.pieces)
    if not pieces:
        return ValveAlone(declared, reasons=dict.fromkeys(WAYS, COMBINED))
    read = [read_stretches(p) for p in pieces]
    start, why = start_of(screened, read, rig)
    own = {thesis_names(way)[1]: VALVE_ALONE[way] for way in WAYS}
    free = [own.get(name, name) for name in free_parameters(why, read, pieces)]
    values = {own.get(name, name): float(getattr(start, name)) for name in (*FLOWS, *DELAYS)}
    for way, value in declared.items():
        values[VALVE_ALONE[way]] = value
        free = [name for name in free if name != VALVE_ALONE[way]]
    reasons = {
        way: f"of the tests without flow control: {why[thesis_names(way)[1]]}"
        for way in WAYS
        if thesis_names(way)[1] in why
    }
    return ValveAlone(declared, pieces, values, tuple(free), reasons)


def series_fit(thesis: CurveFit, alone: ValveAlone) -> CurveFit | None:
    """The fit of all tests, with the flow control and without; None where no direction is known.

    `thesis`: the fit of the tests with the flow control by the thesis' law, from which it starts.
    """
    known = {*alone.free} | {VALVE_ALONE[way] for way in alone.declared}
    ways = tuple(
        way
        for way in WAYS
        if VALVE_ALONE[way] in known and thesis_names(way)[1] in thesis.problem.free
    )
    if not ways:
        return None
    own = {VALVE_ALONE[way]: value for way, value in alone.declared.items()} | dict(alone.start)
    # The tests without start the numbers that both have: there the choked part is the longest.
    start = dataclasses.replace(fitted_valve(thesis), in_series=ways, **own)
    free = dict.fromkeys((*thesis.problem.free, *alone.free))
    return fit_curves((*thesis.problem.pieces, *alone.pieces), start, tuple(free))


def with_flow_controls(
    estimates: Mapping[str, Estimate],
    curves: CurveFit | None,
    ways: Sequence[str],
    alone: ValveAlone,
) -> dict[str, Estimate]:
    """The estimates with the coefficients of valve and flow control of these directions.

    `curves`: the fit of all tests (`series_fit`).
    """
    found = dict(estimates)
    for way in ways:
        both, own, control = thesis_names(way)[1], VALVE_ALONE[way], FLOW_CONTROL[way]
        if curves is None or way not in curves.problem.start.in_series:
            why = alone.reasons.get(way, COMBINED)
            found |= {name: Estimate.unidentified(UNITS[name], why) for name in (own, control)}
            continue
        if way in alone.declared:
            value = alone.declared[way]
            found[own] = Estimate(value, math.nan, UNITS[own], (math.nan, math.nan))
        found[control] = control_coefficient(
            way, found[both], found[own], _covariance(curves, both, own)
        )
    return found


def flow_names(curves: CurveFit, ways: Sequence[str]) -> list[str]:
    """The numbers of both directions, with those of a flow control in some of them."""
    found = [n for way in WAYS for n in curves.problem.flow_names(way)]
    found += [name for way in ways for name in (VALVE_ALONE[way], FLOW_CONTROL[way])]
    return list(dict.fromkeys(found))


def _covariance(curves: CurveFit, one: str, other: str) -> float:
    """Of the errors of two shared parameters; 0 where one is not fitted."""
    names = curves.problem.free
    if one not in names or other not in names:
        return 0.0
    return float(curves.joint.matrix[names.index(one), names.index(other)])


__all__ = ["ValveAlone", "flow_names", "series_fit", "valve_alone", "with_flow_controls"]
