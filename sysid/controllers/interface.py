"""What a controller is: an estimate of the state and a reference in, commands out.

A controller of one's own derives from `Controller` and implements `commands`:

    class MyController(Controller):
        def commands(self, memory, estimate, reference):
            error = reference.position - estimate.position
            return memory, Commands(motor=20.0 * error, valve_a=0.0 * error, valve_b=0.0 * error)

Arrays are (lanes,), one closed loop per lane; SI, absolute pressures, rad and Nm
(linear rigs: m and N).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

from sysid.plant.base import Array


class StateEstimate(NamedTuple):
    """What is known of the plant at a tick: measured and filtered signals, (lanes,).

    `position` rad or m as the encoder counts it; `velocity` and `acceleration` its filtered
    differences; `raw_velocity` the difference of the last two positions over the period,
    unfiltered; pressures Pa. `tick` counts control periods from 0.
    """

    tick: Array
    position: Array
    velocity: Array
    acceleration: Array
    raw_velocity: Array
    pressure_a: Array
    pressure_b: Array


class Reference(NamedTuple):
    """The trajectory at a tick: rad, rad/s, rad/s2, rad/s3 (linear: m); (lanes,).

    `ahead` is the same for the next `Controller.preview` ticks, arrays (preview, lanes), the
    first of them one tick ahead; None within itself.
    """

    position: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    ahead: Reference | None = None


class Commands(NamedTuple):
    """To the actuators, (lanes,): motor effort Nm or N; valves by duty (0 to 1) or on/off.

    `payload_kg` is the controller's estimate of the payload, for the record; NaN for none.
    """

    motor: Array
    valve_a: Array
    valve_b: Array
    payload_kg: Array = float("nan")


class Controller(ABC):
    """A controller for many lanes at once.

    `preview`: ticks of the reference that it needs in advance. `is_duty`: its valve commands are
    PWM duties, taken over where a PWM period starts; else each tick's on (1) or off (0).

    A controller that is a frozen dataclass may differ in its numbers from lane to lane; any other
    serves its lanes as one object. `commands` is compiled with the loop if it takes jax
    arrays (`closed_loop(..., compiled=False)` if it does not).
    """

    preview: int = 0
    is_duty: bool = True

    def start(self, lanes: int) -> Any:
        """Memory at the start of a run (reset): None, an array, or tuples of these."""
        return ()

    @abstractmethod
    def commands(
        self, memory: Any, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        """The memory for the next tick, shaped like this one, and this tick's commands."""


__all__ = ["Commands", "Controller", "Reference", "StateEstimate"]
