"""The averaged law of a valve with the effects that a model has on its flow and timing."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from sysid.plant import plant
from sysid.plant.base import Array, array_namespace
from sysid.plant.effects.entry import of_side
from sysid.plant.effects.valve import DutyDeadZone, partly_lost
from sysid.plant.ports import Model, Point, overrides
from sysid.plant.valve_timing import TIME_TOLERANCE
from sysid.surfaces.averaged import AveragedLaw

# Ports on which the flow through a valve depends; a leak is not part of it.
_FLOW_PORTS = ("parameters", "filling_flow", "exhaust_flow", "supply_pressure", "exhaust_pressure")


def edge_delay(side: str, opening: bool, model: Model, like: Array) -> Array:
    """Delay of a valve's edges at the run's start, s, shaped like `like`."""
    name = "on_delay" if opening else "off_delay"
    delay, start = getattr(model.parameters, f"{name}_{side}") + 0.0 * like, 0.0 * like
    for effect in model.effects:
        delay = effect.delays(delay, start, opening, side)
    return delay


def leakage(side: str, point: Point, model: Model) -> Array:
    """Flow into a chamber in addition to its valve's, kg/s."""
    return model.through("chamber_flow", 0.0 * point.pressure(side), side, point)


@dataclass(frozen=True)
class EffectiveLaw(AveragedLaw):
    """The law with the flows of `model`, its delays, and the dead `zone` of the valve's pulses.

    The other valve counts as off, and its chamber as at the same pressure.
    """

    model: Model
    side: str
    zone: DutyDeadZone

    def _point(self, pressure: Array, is_open: float) -> Point:
        none = 0.0 * pressure
        opens: dict[str, Any] = {f"open_{self.side}": none + is_open}
        p = self.model.at(none)
        point = Point(none, none, none, pressure, pressure, none, none, none, none, p)
        return dataclasses.replace(point, **opens)

    def open_flow(self, pressure: Array) -> Array:
        """See `AveragedLaw`."""
        point = self._point(pressure, 1.0)
        choked = pressure <= plant.filling_boundary(self.side, point, self.model)
        return plant.discrete_flow(self.side, choked, point, self.model)

    def closed_flow(self, pressure: Array) -> Array:
        """See `AveragedLaw`."""
        point = self._point(pressure, 0.0)
        choked = pressure >= plant.exhaust_boundary(self.side, point, self.model)
        return plant.discrete_flow(self.side, choked, point, self.model)

    def open_share(self, duty: Array) -> Array:
        """See `AveragedLaw`; pulses and pauses below the dead time vanish, longer ones partly."""
        xp = array_namespace(duty, self.zone.dead_time_s)
        pulse, pause = self._dead_shares()
        tolerance = TIME_TOLERANCE / self.period
        partly = duty - self._lost(duty, pulse) + self._lost(1.0 - duty, pause)
        closed, opened = duty < pulse - tolerance, 1.0 - duty < pause - tolerance
        return super().open_share(xp.where(closed, 0.0, xp.where(opened, 1.0, partly)))

    def duty_of_share(self, share: Array) -> Array:
        """See `AveragedLaw`; within the dead time the nearer end of the gap."""
        duty = super().duty_of_share(share)
        xp = array_namespace(duty, self.zone.dead_time_s)
        pulse, pause = self._dead_shares()
        low, high = self._command(duty, pulse), 1.0 - self._command(1.0 - duty, pause)
        is_low = duty < self.zone.whole_ratio * pulse
        is_high = 1.0 - duty < self.zone.whole_ratio * pause
        return xp.where(is_low, low, xp.where(is_high, high, duty))

    def _dead_shares(self) -> tuple[Array, Array]:
        """Dead time of pulses, and of pauses, over the period."""
        pulse = self.zone.dead_time_s / self.period
        return pulse, self.zone.pause_ratio * pulse

    def _lost(self, share: Array, dead: Array) -> Array:
        """The loss of a pulse or pause of this share of the period by partial opening."""
        return partly_lost(share, dead, self.zone.whole_ratio)

    def _command(self, share: Array, least: Array) -> Array:
        """The shortest command that has a pulse (or pause) of this share, or the nearer end."""
        xp = array_namespace(share, self.zone.whole_ratio)
        nearer = xp.where(share < 0.5 * least, 0.0, least)
        partly = least + share * (1.0 - 1.0 / self.zone.whole_ratio)
        return xp.where(self.zone.whole_ratio > 1.0, xp.where(share > 0.0, partly, 0.0), nearer)


def averaged_law(model: Model, side: str) -> AveragedLaw:
    """The averaged law of valve "a" or "b" of a model, with what its effects do to it."""
    plain = AveragedLaw.of(model.at(0.0), side)
    flows = tuple(e for e in model.settled().effects if overrides(e, *_FLOW_PORTS))
    flows = tuple(e for e in flows if not overrides(e, "chamber_flow"))
    timed = [e for e in model.effects if overrides(e, "delays", "pulses")]
    if not flows and not timed:
        return plain
    zones = [e for e in timed if isinstance(e, DutyDeadZone) and of_side(side, e.side)]
    zone = zones[-1] if zones else DutyDeadZone()
    values = {f.name: getattr(plain, f.name) for f in dataclasses.fields(plain)}
    values["on_delay"] = edge_delay(side, True, model, 0.0)
    values["off_delay"] = edge_delay(side, False, model, 0.0)
    own = Model(model.parameters, flows)
    return EffectiveLaw(**values, model=own, side=side, zone=zone)


__all__ = ["EffectiveLaw", "averaged_law", "edge_delay", "leakage"]
