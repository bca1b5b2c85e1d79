"""Force control: the actuator's effort follows a wanted one (thesis, recommendation 7.3 (7)).

The wanted effort is that of a spring and a damper between the arm and the reference, with the
model's own motion, load and friction added: pushed aside, the arm gives way by the push over the
stiffness, and in contact it presses with the stiffness times the way that is missing. The
cylinder's pressures follow the pair that gives the effort, as in backstepping (4.3.19, 4.3.29), and
the motor adds what the pressures, as measured, do not give yet.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.controllers.backstepping import BacksteppingController, WantedEffort
from sysid.controllers.cases import Case, ClosedLoopRun
from sysid.controllers.design_model import DesignModel
from sysid.controllers.interface import Reference, StateEstimate
from sysid.controllers.prediction import (
    Motion,
    cylinder_effort,
    opposing_effort,
    point_at,
    sliding_friction,
)
from sysid.controllers.record import estimates_of, references_of
from sysid.io.rig import Rig
from sysid.plant.base import Array
from sysid.plant.ports import Model, Point
from sysid.types import FloatArray

# The share of the travel by which the arm gives way to a push of the cylinder's whole effort.
_WAY = 0.1


@dataclass(frozen=True)
class ForceController(BacksteppingController):
    """`stiffness` Nm/rad and `damping` Nm s/rad; `k3`, `k4` 1/s of the pressures.

    `k1`, `k2` and the motor's gains of backstepping have no part in it.
    """

    stiffness: float = 10.0
    damping: float = 1.0
    portion: float = 0.0
    feedforward: bool = False
    compensation: bool = False

    def _effort(
        self, point: Point, estimate: StateEstimate, reference: Reference, model: Model
    ) -> WantedEffort:
        """The impedance's, with the model's own."""
        p = point.parameters
        off = reference.position - estimate.position
        rate = reference.velocity - estimate.velocity
        change = reference.acceleration - estimate.acceleration
        effort = (
            self.stiffness * off
            + self.damping * rate
            + p.inertia * reference.acceleration
            + opposing_effort(point, model)
            + sliding_friction(point, model, reference.velocity)
        )
        grows = (
            self.stiffness * rate
            + self.damping * change
            + p.inertia * reference.jerk
            + p.viscous * reference.acceleration
        )
        return WantedEffort(effort, grows, 0.0 * off)

    def _motor(
        self,
        effort: Array,
        point: Point,
        estimate: StateEstimate,
        reference: Reference,
        model: Model,
    ) -> Array:
        """What the cylinder does not give."""
        return effort - cylinder_effort(point, model)


def force_controller(
    design: DesignModel, rig: Rig, stiffness: float | None = None
) -> ForceController:
    """A force controller of this stiffness, Nm/rad, critically damped.

    None: at which the cylinder's whole effort is reached at a tenth of the rig's travel.
    """
    p = design.parameters
    if stiffness is None:
        pressure = 0.5 * float(p.supply - p.atmosphere)
        effort = pressure * float(p.area_a + p.area_b) * float(p.pitch_radius)
        stiffness = effort / (_WAY * (rig.travel or 1.0))
    damping = 2.0 * float(np.sqrt(stiffness * float(p.inertia)))
    return ForceController(design, stiffness=float(stiffness), damping=damping)


def effort_errors(case: Case, run: ClosedLoopRun) -> FloatArray:
    """Wanted effort less that of cylinder and motor at every tick, Nm (n,).

    The wanted one follows from the record: it is a function of what was measured.
    """
    controller = case.controller
    assert isinstance(controller, ForceController)
    wanted = controller.wanted(estimates_of(case, run), references_of(run)).effort
    none = 0.0 * run.time
    motion = Motion(run.position, run.velocity, run.pressure_a, run.pressure_b)
    point = point_at(motion, case.plant, run.time, none, run.velocity)
    limit = float(case.plant.parameters.max_effort)
    motor = np.clip(run.motor, -limit, limit) if case.mode.uses_motor else none
    return np.asarray(wanted - cylinder_effort(point, case.plant) - motor)


__all__ = ["ForceController", "effort_errors", "force_controller"]
