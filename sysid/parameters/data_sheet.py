"""A valve's data sheet in place of what no test identifies (`[valve_a]`, `[valve_b]`)."""

from __future__ import annotations

import math
from typing import Any

from sysid.errors import Notice
from sysid.estimation.linear import Estimate
from sysid.io.rig import Rig
from sysid.io.rig_sections import ValveSheet
from sysid.parameters.valves import (
    ISO6358,
    ISO_QUANTITIES,
    LAW_KEYS,
    THESIS,
    WAYS,
    ByDirection,
    DiscreteLaw,
    FittedValves,
    LawNames,
    Valve,
)

_UNITS = {"sonic_conductance": "m3/(s Pa)", "critical_ratio": "-", "subsonic_index": "-"}
_NO_TEST = "no test identifies it"
_DECLARED = "the direction obeys ISO 6358 by the rig file's data sheet"


def with_data_sheets(
    valves: FittedValves | None, rig: Rig
) -> tuple[FittedValves | None, tuple[str, ...]]:
    """The fitted valves with a data sheet's numbers where no test identifies a direction's flow.

    Returns them with a notice for each valve that has any. Such a number has no standard error.
    """
    notices = []
    for side in rig.sides:
        sheet = rig.data_sheet(side)
        if sheet is None:
            continue
        valve = Valve() if valves is None else valves.side(side)
        law, taken = _completed(valve.discrete, sheet)
        if not taken:
            continue
        own = FittedValves(**{side: valve.replaced(discrete=law)})
        valves = own if valves is None else valves.replaced(**{side: own.side(side)})
        line = (
            f"valve {side.upper()}: {', '.join(taken)} are the data sheet's in {rig.source} "
            f"([valve_{side}]): no test identifies them"
        )
        notices.append(Notice(line, f"valves.{side}.discrete"))
    return valves, tuple(notices)


def _completed(law: DiscreteLaw | None, sheet: ValveSheet) -> tuple[DiscreteLaw, list[str]]:
    """The law with the data sheet's numbers where it lacks them, and their keys."""
    if law is None:
        none = Estimate.unidentified("", _NO_TEST)
        law = DiscreteLaw.model_validate(dict.fromkeys(LAW_KEYS.values(), none))
    taken: list[str] = []
    for number, (way, key) in enumerate(WAYS.items()):
        quantities = _lacking(law, way)
        if not quantities:
            continue
        found: dict[str, Any] = {}
        for quantity in quantities:
            declared = _declared(sheet, quantity, number)
            held = getattr(law, quantity) or ByDirection()
            found[quantity] = held.replaced(**{key: declared})
            taken.append(f"{quantity}.{key}")
        if law.law_of(way) == THESIS:
            found["law"] = (law.law or LawNames(fill="thesis", exhaust="thesis")).replaced(
                **{key: ISO6358}
            )
            by_sheet = Estimate.unidentified("", _DECLARED)
            found |= {k: by_sheet for n, k in LAW_KEYS.items() if n.endswith(f"_{way}")}
        law = law.replaced(**found)
    return law.replaced(declared=taken) if taken else law, taken


def _lacking(law: DiscreteLaw, way: str) -> tuple[str, ...]:
    """The quantities of ISO 6358 that a direction needs of a data sheet."""
    estimates = law.estimates()
    if law.law_of(way) == THESIS:
        keys = [key for name, key in law.thesis_keys().items() if name.endswith(f"_{way}")]
        return () if any(estimates[key].identified for key in keys) else ISO_QUANTITIES
    known = {
        name.removesuffix(f"_{way}"): estimates[key].identified
        for name, key in law.iso_keys().items()
        if name.endswith(f"_{way}")
    }
    if not known["sonic_conductance"]:
        return ISO_QUANTITIES
    return () if known["critical_ratio"] else ("critical_ratio",)


def _declared(sheet: ValveSheet, quantity: str, number: int) -> Estimate:
    key = "sonic_conductance_m3_per_s_pa" if quantity == "sonic_conductance" else quantity
    value = float(getattr(sheet, key)[number])
    return Estimate(value, math.nan, _UNITS[quantity], (math.nan, math.nan))


__all__ = ["with_data_sheets"]
