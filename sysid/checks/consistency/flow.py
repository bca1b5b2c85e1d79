"""The choked filling flow of a valve, as any log shows it in which the valve is open.

V dP/dt + k P dV/dt = k R T m (thesis 3.5.2), integrated over each stretch in which the valve is
open and the chamber's pressure stays in the choked regime, from where a quarter of the stretch's
air has entered: before, the valve and its tube may not have answered yet, however slow they are.
Under PWM the flow is over the open share of the period.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sysid import signals
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.plant.base import CRITICAL_RATIO, chamber_volume
from sysid.types import FloatArray

_LEAST_DUTY = 0.8  # below, the exhaust takes part
_ANSWERED = 0.25  # of a stretch's air
# Share of the supply: close to the choked boundary the flow falls.
_HIGHEST = 0.95 * CRITICAL_RATIO


def filling_flows(trial: Trial, valve: str, rig: Rig) -> list[float]:
    """Choked flow, kg/s, of every stretch of one test with this valve (`a`, `b`) open."""
    pressure = f"pressure_{valve}_pa"
    if rig.air is None or rig.cylinder is None or pressure not in trial:
        return []
    if rig.position_channel not in trial:
        return []
    share = _open_share(trial, valve, rig)
    if share is None or rig.supply_way < 0.0:  # a vacuum's flow is not choked by this law
        return []
    supply, ambient = rig.air.supply_pressure_pa, rig.air.atmospheric_pressure_pa
    values = trial[pressure]
    low = (values < _HIGHEST * supply) & (values > 0.9 * ambient)
    taken = _taken(trial, valve, rig)
    return [
        float(
            (taken[stop] - taken[start])
            / np.sum(share[start:stop] * np.diff(trial.time)[start:stop])
        )
        for start, stop in _stretches(share, low, taken)
    ]


def _open_share(trial: Trial, valve: str, rig: Rig) -> FloatArray | None:
    """(n,): 1 where the valve is on, the open share of the period at a high duty, else 0."""
    if f"valve_{valve}" in trial:
        return np.asarray(trial[f"valve_{valve}"], dtype=float)
    name = f"duty_{valve}"
    if name not in trial or rig.pwm is None:
        return None
    duty = trial[name]
    longer = 0.0
    if rig.valves is not None:
        longer = (rig.valves.off_delay_s - rig.valves.on_delay_s) / rig.pwm.period_s
    return np.where(duty >= _LEAST_DUTY, np.clip(duty + longer, 0.0, 1.0), 0.0)


def _taken(trial: Trial, valve: str, rig: Rig) -> FloatArray:
    """(n,): mass that entered the chamber since the first row, kg."""
    cylinder, air = rig.cylinder, rig.air
    assert cylinder is not None and air is not None
    volume = np.asarray(chamber_volume(trial[rig.position_channel], cylinder, valve))
    pressure, k = trial[f"pressure_{valve}_pa"], air.heat_capacity_ratio
    middle_v, middle_p = 0.5 * (volume[1:] + volume[:-1]), 0.5 * (pressure[1:] + pressure[:-1])
    steps = middle_v * np.diff(pressure) + k * middle_p * np.diff(volume)
    gain = k * air.gas_constant_j_per_kg_k * air.temperature_k
    return np.concatenate([[0.0], np.cumsum(steps)]) / gain


def _stretches(
    share: FloatArray, low: NDArray[np.bool_], taken: FloatArray
) -> Iterator[tuple[int, int]]:
    """[start, stop] rows of every stretch that is open, answered and choked."""
    for opened, closed in signals.runs(share > 0.0):
        above = np.flatnonzero(~low[opened:closed])
        stop = opened + int(above[0]) if above.size else closed
        stop = min(stop, len(share)) - 1
        if stop <= opened + 1:
            continue
        # While it is still shut air may leave; where that is all, it answers after the stretch.
        shut = opened + int(np.argmin(taken[opened : stop + 1]))
        entered = taken[shut : stop + 1] - taken[shut]
        start = shut + int(np.argmax(entered >= _ANSWERED * entered[-1]))
        if stop > start + 1:
            yield start, stop


__all__ = ["filling_flows"]
