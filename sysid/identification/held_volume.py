"""The error of a held chamber's volume by its encoder, which is common to all flows of a valve.

With the piston held, a flow is the pressure's rate times the volume (thesis 3.5.2), and the
volume follows from the logged position. An encoder shows that to half a count, the same half in
every row: neither more rows nor more tests average it away.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid import signals
from sysid.estimation.covariance import JointCovariance
from sysid.estimation.linear import Estimate
from sysid.io.logs import Trial
from sysid.io.rig import Cylinder, Rig
from sysid.types import FloatArray


@dataclass(frozen=True)
class VolumeError:
    """How far half a count of the held position moves the flows, as shares of them.

    `reaches` (k,): of each position that was held, weighted by its share of the `tests`: their
    errors are independent, each uniform within its reach.
    """

    reaches: FloatArray
    tests: int

    @staticmethod
    def of(volumes: Sequence[float], side: str, rig: Rig, count: float) -> VolumeError:
        """Of tests with these volumes (m3) of chamber "a" or "b"; `count` rad or m, 0: exact."""
        if rig.held_tank is not None:
            return VolumeError(np.zeros(0), len(volumes))
        cylinder: Cylinder = rig.require("cylinder", "which gives the chamber's volume")
        per_count = _area(cylinder, side) * cylinder.pitch_radius_m * count
        if not (per_count > 0.0 and len(volumes)):
            return VolumeError(np.zeros(0), len(volumes))
        readings = np.round(np.array(volumes) / per_count)
        _, place, held = np.unique(readings, return_index=True, return_counts=True)
        shares = held / len(volumes)
        return VolumeError(shares * 0.5 * per_count / np.array(volumes)[place], len(volumes))

    @property
    def variance(self) -> float:
        """Variance of the common relative error: a third of each reach squared."""
        return float(np.sum(self.reaches**2)) / 3.0

    def in_estimate(self, flow: Estimate, *, shows_scatter: bool = False) -> Estimate:
        """A flow with this error in its standard error and interval.

        `shows_scatter`: the flow's error is that of a jackknife over the tests, which shows
        already by how much tests held at several positions differ.
        """
        if not len(self.reaches):
            return flow
        reach = flow.value * self.reaches * (math.sqrt(self._unseen) if shows_scatter else 1.0)
        largest = int(np.argmax(reach))
        others = math.sqrt(float(np.sum(np.delete(reach, largest) ** 2)) / 3.0)
        return flow.with_error(others).with_uniform_error(float(reach[largest]))

    @property
    def _unseen(self) -> float:
        """Share of the variance that the scatter of the tests does not show.

        Of independent tests in groups of sizes n_i of n, each group with an error of its own, the
        variance of the mean is v sum (n_i/n)^2; their scatter shows v (1 - sum (n_i/n)^2)/(n - 1)
        of it: nothing where all were held at one position, all where each had its own.
        """
        squares = float(np.sum((self.reaches / self.reaches.sum()) ** 2))
        seen = (1.0 - squares) / max(self.tests - 1, 1)
        return max(1.0 - seen / squares, 0.0)

    def in_joint(self, joint: JointCovariance, flows: dict[str, float]) -> JointCovariance:
        """The covariance with this error, common to the `flows` (values by name)."""
        moved = np.array([flows.get(name, 0.0) for name in joint.names])
        return JointCovariance(joint.names, joint.matrix + self.variance * np.outer(moved, moved))


def _area(cylinder: Cylinder, side: str) -> float:
    return cylinder.area_a_m2 if side == "a" else cylinder.area_b_m2


def volume_count(rig: Rig, side: str) -> float:
    """What a count of the declared encoder is of a chamber's volume, m3; 0 where none is declared.

    One that a test shows itself will not do: a piston that slips once shows one step alone.
    """
    if not rig.has_declared_encoder or rig.cylinder is None:
        return 0.0
    own = rig.cylinder
    return _area(own, side) * own.pitch_radius_m * (rig.encoder_step or 0.0)


def position_count(trials: Sequence[Trial], rig: Rig) -> float:
    """The encoder's count, rad or m: declared, else as these logs show it, else as assumed.

    0 where there is none.
    """
    if rig.has_declared_encoder:
        return rig.encoder_step or 0.0
    channel = rig.position_channel
    shown = [np.unique(t[channel]) for t in trials if channel in t]
    seen = signals.quantum(np.concatenate(shown)) if shown else 0.0
    return seen or rig.encoder_step or 0.0


__all__ = ["VolumeError", "position_count", "volume_count"]
