"""The pneumatic feedforward alone (thesis 4.3.3.3, Figure 4.11)."""

from __future__ import annotations

from dataclasses import dataclass

from sysid.controllers.backstepping import BacksteppingController
from sysid.controllers.interface import Reference, StateEstimate
from sysid.plant.base import Array
from sysid.plant.ports import Model, Point


@dataclass(frozen=True)
class FeedforwardController(BacksteppingController):
    """Backstepping's feedforward without its feedback, and without a motor."""

    portion: float = 0.0
    compensation: bool = False

    def _feedback(
        self, point: Point, estimate: StateEstimate, reference: Reference, model: Model
    ) -> tuple[tuple[Array, Array], Array]:
        none = 0.0 * estimate.position
        return (none, none), none


__all__ = ["FeedforwardController"]
