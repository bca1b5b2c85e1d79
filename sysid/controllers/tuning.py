"""Options of the named controllers in addition to the bundle, and which apply to which."""

from __future__ import annotations

from dataclasses import dataclass

from sysid.controllers.backstepping import BacksteppingController, backstepping_type
from sysid.controllers.design_model import DesignModel
from sysid.controllers.dvmpc import DvmpcController
from sysid.controllers.payload import PayloadEstimator
from sysid.errors import input_error
from sysid.io.rig import Rig

# The best of `benchmarks/controllers.py --only varying`, ticks.
_VARYING_HOLD, _VARYING_HORIZON = 7, 39
_LONGEST_HORIZON = 200
_OWNERS = {
    "horizon": ("dvmpc",),
    "varying_input": ("dvmpc",),
    "type": ("backstepping",),
    "estimate_payload": ("dvmpc", "backstepping"),
    "stiffness": ("force",),
}


@dataclass(frozen=True)
class Tuning:
    """Options of the named controllers; None for their own defaults.

    `horizon` ticks that DVMPC predicts; `varying_input`: its input may change within them, and
    it predicts the valves' delays; `type` 1 to 4 of backstepping (Table 5.4.3);
    `estimate_payload`: whether the payload is estimated while the loop runs; `stiffness` Nm/rad
    of force control.
    """

    horizon: int | None = None
    varying_input: bool | None = None
    type: int | None = None
    estimate_payload: bool | None = None
    stiffness: float | None = None

    def given(self) -> dict[str, float | bool]:
        """The options that were given, by name."""
        return {name: value for name in _OWNERS if (value := getattr(self, name)) is not None}

    def check(self, controller: str | None) -> None:
        """InputError for an option that does not apply to a controller (None: a user's own)."""
        for name in self.given():
            owners = _OWNERS[name]
            if controller not in owners:
                who = "a controller of your own" if controller is None else controller
                raise input_error(
                    f"option {name}",
                    f"does not go with {who}",
                    f"use it with {' or '.join(owners)}",
                )
        shortest = _VARYING_HOLD + DvmpcController.coarse if self.varying_input else 1
        if self.horizon is not None and not shortest <= self.horizon <= _LONGEST_HORIZON:
            raise input_error(
                f"horizon {self.horizon}",
                "is out of range" + (" with a varying input" if self.varying_input else ""),
                f"give {shortest} to {_LONGEST_HORIZON} ticks",
            )
        if self.stiffness is not None and not self.stiffness > 0.0:
            raise input_error(f"stiffness {self.stiffness:g}", "is not positive", "give N m/rad")
        if self.type not in (None, 1, 2, 3, 4):
            raise input_error(f"backstepping type {self.type}", "is unknown", "give 1 to 4")

    def estimator(self, by_itself: bool, rig: Rig) -> PayloadEstimator | None:
        """The payload's estimator; `by_itself` is the default.

        InputError on a horizontal rig, where a payload has no weight to be known by.
        """
        wanted = by_itself if self.estimate_payload is None else self.estimate_payload
        if wanted and not rig.is_vertical:
            raise input_error(
                rig.source,
                "the rig is horizontal, and a payload is estimated from its weight",
                "omit the estimate",
            )
        return PayloadEstimator() if wanted else None

    def dvmpc(
        self, design: DesignModel, horizon: int, estimator: PayloadEstimator | None
    ) -> DvmpcController:
        """DVMPC with these options; `horizon` ticks by default."""
        if not self.varying_input:
            return DvmpcController(design, horizon=self.horizon or horizon, estimator=estimator)
        return DvmpcController(
            design,
            horizon=self.horizon or _VARYING_HORIZON,
            hold=_VARYING_HOLD,
            predicts_delays=True,
            trapezoidal=True,
            varying=True,
            estimator=estimator,
        )

    def backstepping(
        self, design: DesignModel, portion: float, estimator: PayloadEstimator | None
    ) -> BacksteppingController:
        """Backstepping with these options; type 4, both compensations, by default."""
        return backstepping_type(self.type or 4, design, portion=portion, estimator=estimator)


NO_TUNING = Tuning()

__all__ = ["NO_TUNING", "Tuning"]
