"""Quantities that a rig keeps from log to log: chambers at rest, supply, friction."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sysid.errors import SysidError
from sysid.estimation.linear import Estimate
from sysid.friction import fit_friction
from sysid.identification.friction.result import FrictionResult
from sysid.io.channels import VALVE_COMMANDS
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.types import FloatArray

_START_ROWS = 10
# Share of a pressure: repeats within one log do not show what changes from log to log.
LEAST_OF_PRESSURE = 0.03
_PLATEAU_S = 0.1


def rest_pressures(trials: Sequence[Trial], pressure: str, ambient_pa: float) -> list[float]:
    """The chamber's steady pressure, Pa, at the start of each test with its valves off."""
    found = []
    for trial in trials:
        if pressure not in trial or len(trial) < _START_ROWS or not _off_at_start(trial):
            continue
        first = trial[pressure][:_START_ROWS]
        if np.ptp(first) < LEAST_OF_PRESSURE * ambient_pa:
            found.append(float(np.median(first)))
    return found


def _off_at_start(trial: Trial) -> bool:
    return trial.has_its_start and not any(
        np.any(trial[n][:_START_ROWS] != 0.0) for n in VALVE_COMMANDS if n in trial
    )


def filled_pressures(trials: Sequence[Trial], valve: str, ambient_pa: float) -> list[float]:
    """The chamber's steady pressure, Pa, where its valve has been on until it no longer fills."""
    found = []
    for trial in trials:
        if f"valve_{valve}" not in trial or f"pressure_{valve}_pa" not in trial:
            continue
        values, on = trial[f"pressure_{valve}_pa"], trial[f"valve_{valve}"] > 0.0
        rows = max(_START_ROWS, round(_PLATEAU_S / trial.period))
        closing = np.flatnonzero(on[:-1] & ~on[1:])
        for stop in closing:
            last = values[max(0, stop - rows) : stop]
            before = values[max(0, stop - 2 * rows) : max(0, stop - rows)]
            held = len(before) == rows and on[max(0, stop - 2 * rows) : stop].all()
            steady = 0.1 * LEAST_OF_PRESSURE * ambient_pa
            if held and abs(float(np.mean(last) - np.mean(before))) < steady:
                found.append(float(np.median(last)))
    return found


def sliding_fit(trials: Sequence[Trial], kind: str, rig: Rig) -> FrictionResult | None:
    """The friction fit of one log, `kind` "sliding" or "motion"; None without one.

    From motion the inertia is estimated too, so that a wrong one in the rig file moves nothing.
    """
    needed = (rig.position_channel, rig.effort_channel)
    usable = [t for t in trials if all(n in t for n in needed)]
    if rig.cylinder is not None:
        usable = [t for t in usable if all(n in t for n in rig.pressure_channels)]
    if not usable:
        return None
    try:
        return fit_friction(usable, rig, kind=kind, estimate_inertia=kind == "motion")
    except SysidError:
        return None


def sliding_friction(found: FrictionResult | None) -> dict[str, Estimate]:
    """Coulomb and viscous friction of a fit by these names, where both are identified."""
    if found is None:
        return {}
    pairs = {name: found.parameters[name] for name in ("coulomb", "viscous")}
    return pairs if all(_usable(e) for e in pairs.values()) else {}


def _usable(estimate: Estimate) -> bool:
    known = estimate.identified and estimate.value > 0.0
    return known and all(map(math.isfinite, estimate.interval))


def breakaway(trials: Sequence[Trial], rig: Rig) -> Estimate | None:
    """Static friction of one log of ramps; None where it is not identified."""
    try:
        found = fit_friction(trials, rig, kind="static")
    except SysidError:
        return None
    estimate = found.parameters["static"]
    return estimate if _usable(estimate) else None


def interval_of(values: FloatArray | Sequence[float], least: float) -> tuple[float, float, float]:
    """Median of repeated values and limits about it: from their quartiles (McGill, Tukey, Larsen
    1978), at least the share `least`."""
    middle, low, high = (float(np.quantile(values, q)) for q in (0.5, 0.25, 0.75))
    reach = max(1.57 * (high - low) / math.sqrt(len(values)), least * abs(middle))
    return middle, middle - reach, middle + reach


__all__ = [
    "LEAST_OF_PRESSURE",
    "breakaway",
    "filled_pressures",
    "interval_of",
    "rest_pressures",
    "sliding_fit",
    "sliding_friction",
]
