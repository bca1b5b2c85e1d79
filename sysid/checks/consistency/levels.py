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


def rest_pressures(trials: Sequence[Trial], side: str, rig: Rig) -> list[float]:
    """The chamber's steady pressure, Pa, at the start of each test with its valves off.

    Steady is what stays as it is until a valve opens or the piston moves: a chamber that begins to
    empty at the supply's pressure is not at rest, however slowly it does.
    """
    air = rig.require("air", "and the air's readings need it")
    least = LEAST_OF_PRESSURE * air.atmospheric_pressure_pa
    found = []
    for trial in trials:
        pressure = trial.channels.get(f"pressure_{side}_pa")
        if pressure is None or len(trial) < _START_ROWS or not _off_at_start(trial):
            continue
        room = _room(trial, side, rig)
        left = np.abs(room / room[0] - 1.0) > 0.1 * LEAST_OF_PRESSURE
        for name in VALVE_COMMANDS:
            if name in trial:
                left |= trial[name] != 0.0
        stop = max(int(np.argmax(left)) if left.any() else len(trial), _START_ROWS)
        first, last = pressure[:_START_ROWS], pressure[stop - _START_ROWS : stop]
        if np.ptp(first) < least and abs(float(np.median(last) - np.median(first))) < least:
            found.append(float(np.median(first)))
    return found


def _off_at_start(trial: Trial) -> bool:
    return trial.has_its_start and not any(
        np.any(trial[n][:_START_ROWS] != 0.0) for n in VALVE_COMMANDS if n in trial
    )


def filled_pressures(trials: Sequence[Trial], valve: str, rig: Rig) -> list[float]:
    """The chamber's steady pressure, Pa, where its valve has been on until it no longer fills.

    It no longer does where the second half of the time that the valve is on shows neither a rise
    nor a moving piston, whatever that time is: a chamber that grows is below its supply.
    """
    air = rig.require("air", "and the air's readings need it")
    found = []
    for trial in trials:
        if f"valve_{valve}" not in trial or f"pressure_{valve}_pa" not in trial:
            continue
        values, on = trial[f"pressure_{valve}_pa"], trial[f"valve_{valve}"] > 0.0
        room = _room(trial, valve, rig)
        edges = np.flatnonzero(np.diff(on.astype(np.int8), prepend=0))
        for start, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=False):
            rows = (stop - start) // 4
            if rows < _START_ROWS:
                continue
            before, last = (slice(stop - 2 * rows, stop - rows), slice(stop - rows, stop))
            steady = 0.1 * LEAST_OF_PRESSURE
            rise = float(np.mean(values[last]) - np.mean(values[before]))
            grows = float(np.mean(room[last]) / np.mean(room[before])) - 1.0
            if abs(rise) < steady * air.atmospheric_pressure_pa and abs(grows) < steady:
                found.append(float(np.median(values[last])))
    return found


def _room(trial: Trial, valve: str, rig: Rig) -> FloatArray:
    """Length of a valve's chamber, m (rows,); 1 where it does not change or is not known."""
    own = rig.cylinder
    if own is None or rig.position_channel not in trial or not trial.place_known:
        return np.ones(len(trial))
    room = own.chamber_length(trial[rig.position_channel], valve)
    return room if np.all(room > 0.0) else np.ones(len(trial))


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
