"""Faults that a run may be given, and what a loop reports of those that it met."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.types import BoolArray, FloatArray

# Thresholds from which a run is worth a line of the report.
_SATURATED_SHARE = 0.2
_STUCK_S = 0.25
_LOST = 0.2
_EMPTY_SHARE = 0.25
_LEAST_OPEN_S = 0.2
_NEAR_HEAVIEST = 0.95


@dataclass(frozen=True)
class SensorFaults:
    """When sensors fail, s; never by default.

    From `encoder_sticks` on the encoder shows what it showed last; from `pressure_fails`
    until `pressure_recovers` pressure sensor A shows NaN, and so does the encoder within its
    two times.
    """

    encoder_sticks: float = np.inf
    pressure_fails: float = np.inf
    pressure_recovers: float = np.inf
    encoder_fails: float = np.inf
    encoder_recovers: float = np.inf


@dataclass(frozen=True)
class Evidence:
    """A run's rows as the report needs them, (n,): s, rad, Pa, Nm, share open.

    Position as it is and as the encoder shows it (`measured`), pressures as measured; `open_a`
    and `open_b` are the commands, 0 to 1; `payload` the controller's estimate, kg (NaN: none).
    """

    time: FloatArray
    reference: FloatArray
    measured: FloatArray
    position: FloatArray
    pressure_a: FloatArray
    pressure_b: FloatArray
    motor: FloatArray
    open_a: FloatArray
    open_b: FloatArray
    payload: FloatArray
    rejected: float
    invalid: float


def report_faults(
    rows: Evidence,
    *,
    max_effort: float,
    supply: float,
    atmosphere: float,
    resolution: float,
    heaviest: float = np.inf,
) -> list[str]:
    """One line for each thing that kept the loop from working as designed; empty for none.

    `max_effort` Nm or N, pressures Pa, `resolution` the encoder's step, rad or m, `heaviest`
    the largest payload that the controller can estimate, kg.
    """
    found: list[str] = []
    period = float(np.median(np.diff(rows.time)))
    if rows.rejected:
        found.append(
            f"sensor: readings were not finite in {rows.rejected:.0f} ticks; "
            "the outputs were switched off"
        )
    if rows.invalid:
        found.append(
            f"controller: {rows.invalid:.0f} ticks gave no finite output; "
            "motor and valves were switched off"
        )
    saturated = float(np.mean(np.abs(rows.motor) >= max_effort * (1.0 - 1e-9)))
    if np.isfinite(max_effort) and saturated > _SATURATED_SHARE:
        found.append(f"motor: at its limit in {_percent(saturated)} of the run")
    stuck = _longest(_still(rows, resolution)) * period
    if stuck > _STUCK_S:
        found.append(f"encoder: did not move for {stuck:.2g} s while the reference did")
    for side, pressure, share in (
        ("a", rows.pressure_a, rows.open_a),
        ("b", rows.pressure_b, rows.open_b),
    ):
        # A supply that is known to be at the atmosphere is empty, whatever the chamber holds.
        gauge = supply - atmosphere
        top = (float(np.max(pressure)) - atmosphere) / gauge if gauge > 1.0 else 0.0
        if float(np.sum(share)) * period > _LEAST_OPEN_S and top < _EMPTY_SHARE:
            found.append(
                f"supply: chamber {side} reached {_percent(top)} of the supply's gauge pressure "
                "only, with its valve open"
            )
    beyond = float(np.mean(rows.payload >= _NEAR_HEAVIEST * heaviest))
    if beyond > 0.0:
        found.append(
            f"payload: the estimate is at its limit of {heaviest:.3g} kg in {_percent(beyond)} "
            "of the run"
        )
    lost = float(np.mean(np.abs(rows.reference - rows.position) > _LOST))
    if lost > 0.0:
        found.append(
            f"tracking: more than {_LOST:g} off the reference in {_percent(lost)} of the run"
        )
    return found


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %"


def _still(rows: Evidence, resolution: float) -> BoolArray:
    """Rows at which the encoder shows the last row's position while the reference moves."""
    step = max(resolution, 1e-12)
    still = np.abs(np.diff(rows.measured)) < 0.5 * step
    # A slow reference stays on a count for a while: it counts where it crosses several.
    span = 20
    path = np.abs(rows.reference[span:] - rows.reference[:-span])
    moves = np.zeros(len(still), dtype=bool)
    moves[span - 1 :] = path > 5.0 * step
    return np.asarray(still & moves)


def _longest(flags: BoolArray) -> int:
    """Length of the longest run of true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(int), [0]))))
    return int(np.max(edges[1::2] - edges[::2], initial=0))


__all__ = ["Evidence", "SensorFaults", "report_faults"]
