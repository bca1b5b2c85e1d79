"""What the loops of the thesis' tables run on, and how a loop in words becomes a case.

Backstepping takes its duties from bipolynomials, as in the thesis; DVMPC predicts 40 ticks unless a
table says otherwise.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sysid.controllers.backstepping import backstepping_type
from sysid.controllers.cases import Case, ClosedLoopRun
from sysid.controllers.design_model import DesignModel, design_from_bundle, with_bipolynomials
from sysid.controllers.dvmpc import DvmpcController
from sysid.controllers.effective_law import averaged_law
from sysid.controllers.feedforward import FeedforwardController
from sysid.controllers.interface import Controller
from sysid.controllers.modes import Mode
from sysid.controllers.payload import PayloadEstimator
from sysid.controllers.prediction import with_payload
from sysid.controllers.pva import PvaController
from sysid.controllers.sensing import SensorSuite
from sysid.controllers.task import HORIZON, MOTOR_SHARE, check_rotary, check_travel
from sysid.controllers.trajectories import (
    DURATION_S,
    TRAJECTORIES,
    DesiredMotion,
    thesis_trajectory,
)
from sysid.errors import input_error
from sysid.io.channels import SIDES
from sysid.io.rig import GRAVITY_M_PER_S2, Rig
from sysid.parameters.content import BundleContent
from sysid.plant.ports import Model
from sysid.thesis.declaration import TableLoop, printed

_DELAYS = ("on_delay_a", "on_delay_b", "off_delay_a", "off_delay_b")
_FLOWS = tuple(f"{n}_{s}" for n in ("choked_fill", "c_fill", "choked_dis", "c_dis") for s in SIDES)
Setup = tuple[Controller, int, Mode]
"""A closed loop on the rig as it is: controller, trajectory, mode."""


@dataclass(frozen=True)
class TableRig:
    """The setting of a table's loops: the plant, what controllers know of it, its sensors.

    `bipolynomial` is `design` with the thesis' inverse; `is_vertical` chooses the trajectories.
    `arm_moment`: gravity's torque on the arm when it is level, Nm, None if it is not known;
    `reach`: half of the travel, rad, beyond which a loop is unstable. `source` names the rig in
    errors.
    """

    plant: Model
    design: DesignModel
    bipolynomial: DesignModel
    sensors: SensorSuite
    is_vertical: bool = False
    arm_moment: float | None = None
    reach: float = math.inf
    source: str = "rig"

    @classmethod
    def of(cls, bundle: BundleContent) -> TableRig:
        """A bundle's rig. Raises InputError or NotIdentifiedError as `task.prepared` does."""
        rig = bundle.rig
        check_rotary(rig)
        for number in TRAJECTORIES:
            check_travel(rig, number)
        for section in ("motor", "pwm"):
            rig.require(section, "which the tables' controllers need")
        design = design_from_bundle(bundle)
        return cls(
            plant=design.model,
            design=design,
            bipolynomial=with_bipolynomials(design),
            sensors=SensorSuite.of(rig),
            is_vertical=rig.is_vertical,
            arm_moment=arm_moment(rig),
            reach=0.5 * (rig.travel or math.inf),
            source=rig.source,
        )

    def case(self, controller: Controller, number: int, mode: Mode, seed: int = 0) -> Case:
        """The closed loop of a controller, trajectory and mode on the rig as it is."""
        path = thesis_trajectory(number, self.is_vertical)
        return Case(controller, self.plant, path, mode, self.sensors, seed=seed)

    def run(self, cases: Sequence[Case], duration: float = DURATION_S) -> list[ClosedLoopRun]:
        """All cases in one batch."""
        from sysid.controllers.loop import closed_loop

        return closed_loop(cases, duration)

    def rmse(self, setups: Sequence[Setup]) -> list[float]:
        """RMSE, rad, of every loop, in one batch."""
        return [r.metrics.rmse for r in self.run([self.case(*setup) for setup in setups])]

    def backstepping(self, kind: int, mode: Mode, **options: Any) -> Controller:
        """Type 1 to 4; without the motor's share where the motor is off."""
        portion = MOTOR_SHARE if mode.uses_motor else 0.0
        return backstepping_type(kind, self.bipolynomial, portion=portion, **options)

    def dvmpc(self, horizon: int = HORIZON, **options: Any) -> DvmpcController:
        """DVMPC with this horizon, ticks."""
        return DvmpcController(self.design, horizon=horizon, **options)

    def named(self, name: str, mode: Mode) -> Controller:
        """The controller of a row of Tables 4.5.1 to 4.5.3."""
        if name == "pva":
            return PvaController()
        return self.dvmpc() if name == "dvmpc" else self.backstepping(4, mode)

    # --- loops in words ------------------------------------------------------------------

    def case_of(self, loop: TableLoop) -> Case:
        """The closed loop that a table declares. Raises InputError for what the rig lacks."""
        rig = self.turned(loop.orientation == "vertical") if loop.orientation else self
        path: DesiredMotion
        if isinstance(loop.trajectory, int):
            path = thesis_trajectory(loop.trajectory, rig.is_vertical)
        else:
            path = loop.trajectory
        plant = rig.plant
        if loop.carried_kg is not None:
            plant = rig._carrying(
                dataclasses.replace(rig.design, model=plant), loop.carried_kg
            ).model
        if loop.assumed_kg is not None:
            rig = rig.assuming(loop.assumed_kg)
        return Case(rig._controller(loop), plant, path, loop.mode, self.sensors, seed=loop.seed)

    def turned(self, vertical: bool) -> TableRig:
        """The same rig, horizontal or vertical."""
        if vertical == self.is_vertical:
            return self
        if vertical and self.arm_moment is None:
            raise input_error(
                self.source,
                "[inertia] arm_mass_kg is missing, and the table is one of a vertical rig",
                "add arm_mass_kg and arm_length_m under [inertia]",
            )
        payload = GRAVITY_M_PER_S2 * self.design.payload_mass * self.design.payload_length
        moment = float(self.arm_moment or 0.0) + float(payload) if vertical else 0.0

        def turn(model: Model) -> Model:
            parameters = model.parameters.replace(gravity_moment=moment)
            return dataclasses.replace(model, parameters=parameters)

        changes: dict[str, Any] = {"plant": turn(self.plant), "is_vertical": vertical}
        for name in ("design", "bipolynomial"):
            own: DesignModel = getattr(self, name)
            changes[name] = dataclasses.replace(own, model=turn(own.model), gravity=float(vertical))
        return dataclasses.replace(self, **changes)

    def limited(self, max_torque: float) -> TableRig:
        """The same rig, whose motor gives this torque, Nm, as its controllers know.

        Raises InputError for a torque that is not positive.
        """
        if not max_torque > 0.0:
            raise input_error(f"largest torque {max_torque:g} N m", "is not positive", "give more")

        return self._changed({"max_effort": float(max_torque)})

    def without_delays(self) -> TableRig:
        """The same rig with valves that switch at once, as its controllers know."""
        return self._changed(dict.fromkeys(_DELAYS, 0.0), refit=True)

    def with_flow(self, factor: float) -> TableRig:
        """The same rig with valves of so many times the flow, as its controllers know."""
        own = self.plant.parameters
        return self._changed({name: factor * getattr(own, name) for name in _FLOWS}, refit=True)

    def with_friction(self, more: float) -> TableRig:
        """The same rig with more Coulomb and static friction, Nm, than its controllers know."""
        own = self.plant.parameters
        values = {name: getattr(own, name) + more for name in ("coulomb_effort", "static_effort")}
        plant = dataclasses.replace(self.plant, parameters=own.replace(**values))
        return dataclasses.replace(self, plant=plant)

    def _changed(self, values: Mapping[str, float], refit: bool = False) -> TableRig:
        """The same rig with other parameters of plant and controllers' models.

        `refit`: the duties' inverses depend on them.
        """

        def change(model: Model) -> Model:
            return dataclasses.replace(model, parameters=model.parameters.replace(**values))

        def known(own: DesignModel) -> DesignModel:
            model = change(own.model)
            if not refit:
                return dataclasses.replace(own, model=model)
            a, b = (averaged_law(model, side) for side in SIDES)
            return dataclasses.replace(own, model=model, inverse_a=a, inverse_b=b)

        design = known(self.design)
        bipolynomial = with_bipolynomials(design) if refit else known(self.bipolynomial)
        return dataclasses.replace(
            self, plant=change(self.plant), design=design, bipolynomial=bipolynomial
        )

    def assuming(self, payload_kg: float) -> TableRig:
        """The same rig, with controllers that take this payload, kg, into account."""
        return dataclasses.replace(
            self,
            design=self._carrying(self.design, payload_kg),
            bipolynomial=self._carrying(self.bipolynomial, payload_kg),
        )

    def _carrying(self, design: DesignModel, payload_kg: float) -> DesignModel:
        """The model with this payload, kg, in place of its own."""
        lever = float(design.payload_length)
        if payload_kg > 0.0 and not lever > 0.0:
            raise input_error(
                self.source,
                "[inertia] payload_length_m is missing, and the table is one of payloads",
                "add its distance from the shaft",
            )
        model = with_payload(design, payload_kg * lever**2)
        return dataclasses.replace(design, model=model, payload_mass=float(payload_kg))

    def _controller(self, loop: TableLoop) -> Controller:
        options = dict(loop.options)
        if loop.controller == "pva":
            return PvaController(**options)
        if loop.has_estimator:
            options["estimator"] = PayloadEstimator()
        if loop.controller == "dvmpc":
            return self.dvmpc(**(self._tested() if loop.as_tested else {}) | options)
        if loop.controller == "feedforward":
            return FeedforwardController(self.bipolynomial)
        exact = dataclasses.replace(self, bipolynomial=self.design)
        chosen = self if loop.inverse == "bipolynomial" else exact
        return chosen.backstepping(loop.type, loop.mode, **options)

    def _tested(self) -> dict[str, Any]:
        """DVMPC's settings in the experiments (Table 4.4.5), the motor's gains on this arm."""
        row = next(row for row in printed("table_4_4") if row["table"] == "4.4.5")
        inertia = float(self.design.parameters.inertia)
        frequency = math.sqrt(float(row["motor_p_nm_per_rad"]) / inertia)
        damping = float(row["motor_d_nm_s_per_rad"]) / (2.0 * frequency * inertia)
        return {
            "horizon": int(row["horizon"]),
            "natural_frequency": frequency,
            "damping": damping,
        }


def arm_moment(rig: Rig) -> float | None:
    """Gravity's torque on the bare arm when it is level, Nm (3.3.8); None if not declared."""
    i = rig.inertia
    if i is None or i.arm_mass_kg is None or i.arm_length_m is None:
        return None
    return 0.5 * i.arm_mass_kg * i.arm_length_m * GRAVITY_M_PER_S2


__all__ = ["TRAJECTORIES", "Setup", "TableRig", "arm_moment"]
