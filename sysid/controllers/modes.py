"""Actuation modes (thesis Table 4.3.1): which of the two actuators a loop may use."""

from __future__ import annotations

from enum import Enum


class Mode(Enum):
    """Pneumatic: the motor is off. Motor: the valves are off. Hybrid: both act."""

    PNEUMATIC = "pneumatic"
    MOTOR = "motor"
    HYBRID = "hybrid"

    @property
    def uses_valves(self) -> bool:
        """Whether the valves are commanded."""
        return self is not Mode.MOTOR

    @property
    def uses_motor(self) -> bool:
        """Whether the motor is commanded."""
        return self is not Mode.PNEUMATIC


__all__ = ["Mode"]
