"""Where the fit of an on/off valve starts, and which of its parameters are free."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from sysid.identification.valve_discrete.held_chamber import DELAYS, FLOWS, DiscreteValve
from sysid.identification.valve_discrete.regimes import Stretches, read_stretches
from sysid.identification.valve_discrete.trials import (
    Piece,
    Screened,
    is_switched,
    screened_tests,
)
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.plant.base import CRITICAL_RATIO


def start_of(
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


def free_parameters(
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
        # Of two valves, the one that empties opens by the other's delay of opening.
        any(
            (p.chamber.closes < p.chamber.time[-1]).any() and p.chamber.bleeds is None
            for p in pieces
        ),
    )
    for pair, delay, seen in zip((FLOWS[:2], FLOWS[2:]), DELAYS, edges, strict=True):
        alongside = sparse & set(pair) if set(pair) & set(free) else set()
        free += [n for n in pair if n in alongside]
        choked, unchoked = pair
        apart = choked not in alongside or delay in sparse
        if delay not in free and unchoked in free and seen and apart:
            free.append(delay)
    return free


def flows_not_shown(trials: Sequence[Trial], rig: Rig, valve: str) -> dict[str, str]:
    """Why a fit of these tests would not identify flows of a valve, by their names in a bundle.

    As far as their samples say before anything is fitted. Raises as
    `sysid.valve_discrete.fit_valve_discrete`.
    """
    rig.require("air", "which the valve law needs")
    screened = screened_tests([t for t in trials if is_switched(t, valve)], valve, rig)
    read = [read_stretches(p) for s in screened for p in s.pieces]
    _, reasons = start_of(screened, read, rig)
    return {name: why for name, why in reasons.items() if name in FLOWS}


__all__ = ["flows_not_shown", "free_parameters", "start_of"]
