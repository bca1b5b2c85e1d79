"""A closed loop to be run, its record, and what is to be said of it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sysid.controllers.faults import Evidence, SensorFaults, report_faults
from sysid.controllers.interface import Controller
from sysid.controllers.metrics import TrackingMetrics, tracking_metrics
from sysid.controllers.modes import Mode
from sysid.controllers.sensing import SensorSuite
from sysid.controllers.trajectories import DesiredMotion
from sysid.plant.ports import Model
from sysid.types import FloatArray

PERIOD_S = 1e-3
"""The control period, s."""


@dataclass(frozen=True)
class Case:
    """One closed loop. `plant` is the truth, which the controller's own model need not match.

    `trajectory` is followed from rest at its start, both chambers at the atmosphere.
    """

    controller: Controller
    plant: Model
    trajectory: DesiredMotion
    mode: Mode = Mode.HYBRID
    sensors: SensorSuite = field(default_factory=SensorSuite)
    faults: SensorFaults = field(default_factory=SensorFaults)
    seed: int = 0


@dataclass(frozen=True)
class ClosedLoopRun:
    """One loop's record, (n,) at each tick before its commands act; s, rad or m, Pa, Nm or N.

    `reference` (n, 4) with derivatives; `measured` the encoder's position, `measured_a` and
    `measured_b` the sensors' pressures as the controller got them, the last good ones where a
    reading is not finite; `command_a`,
    `command_b` duty (0 to 1), or on/off as 1 and 0; `payload_kg` NaN without an estimate.
    `is_duty` says which; `faults` one line for each thing that went wrong.
    """

    time: FloatArray
    reference: FloatArray
    position: FloatArray
    velocity: FloatArray
    pressure_a: FloatArray
    pressure_b: FloatArray
    measured: FloatArray
    measured_a: FloatArray
    measured_b: FloatArray
    motor: FloatArray
    command_a: FloatArray
    command_b: FloatArray
    payload_kg: FloatArray
    is_duty: bool
    faults: tuple[str, ...]

    @property
    def metrics(self) -> TrackingMetrics:
        """RMSE, MAE, SSE, SSA of the true position (6.4)."""
        return tracking_metrics(self.time, self.reference[:, 0], self.position)


def faults_of(
    case: Case,
    time: FloatArray,
    reference: FloatArray,
    own: dict[str, FloatArray],
    counts: tuple[float, float],
) -> list[str]:
    """What went wrong in a run, one line each.

    `own`: its columns by the names of `ClosedLoopRun`; `counts`: ticks with readings that were
    not finite, and those with other numbers that were not. Judged by the controller's own model,
    without one by the plant's.
    """
    rows = Evidence(
        time=time,
        reference=reference,
        measured=own["measured"],
        position=own["position"],
        pressure_a=own["measured_a"],
        pressure_b=own["measured_b"],
        motor=own["motor"],
        open_a=own["command_a"],
        open_b=own["command_b"],
        payload=own["payload_kg"],
        rejected=counts[0],
        invalid=counts[1],
    )
    p = _declared(case).parameters
    return report_faults(
        rows,
        max_effort=float(p.max_effort),
        supply=float(p.supply),
        atmosphere=float(p.atmosphere),
        resolution=case.sensors.position_step,
        heaviest=getattr(getattr(case.controller, "estimator", None), "heaviest", np.inf),
    )


def _declared(case: Case) -> Model:
    """The model that the loop is judged by: the controller's own, or else the plant's."""
    design = getattr(case.controller, "design", None)
    return case.plant if design is None else design.model


__all__ = ["PERIOD_S", "Case", "ClosedLoopRun", "faults_of"]
