"""The averaged law of a valve with the effects that a model has on its flow and timing."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from sysid.model import plant
from sysid.model.base import Array, array_namespace
from sysid.model.effects.entry import of_side
from sysid.model.effects.valve import DutyDeadZone
from sysid.model.ports import Model, Point, overrides
from sysid.model.valve_timing import TIME_TOLERANCE
from sysid.surfaces.averaged import AveragedLaw

# What the flow through a valve depends on; a leak is no part of it.
_FLOW_PORTS = ("parameters", "filling_flow", "exhaust_flow", "supply_pressure", "exhaust_pressure")


def edge_delay(side: str, opening: bool, model: Model, like: Array) -> Array:
    """Delay of a valve's edges at the run's start, s, shaped like `like`."""
    name = "on_delay" if opening else "off_delay"
    delay, start = getattr(model.parameters, f"{name}_{side}") + 0.0 * like, 0.0 * like
    for effect in model.effects:
        delay = effect.delays(delay, start, opening, side)
    return delay


def leakage(side: str, point: Point, model: Model) -> Array:
    """Flow into a chamber beside its valve's, kg/s."""
    return model.through("chamber_flow", 0.0 * point.pressure(side), side, point)


@dataclass(frozen=True)
class EffectiveLaw(AveragedLaw):
    """The law with the flows of `model` and its delays; `dead_time` s as in `duty-dead-zone`.

    The other valve counts as off, and its chamber as at the same pressure.
    """

    model: Model
    side: str
    dead_time: Array

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
        """See `AveragedLaw`; pulses and pauses below the dead time vanish."""
        xp = array_namespace(duty, self.dead_time)
        least = (self.dead_time - TIME_TOLERANCE) / self.period
        obeyed = xp.where(duty < least, 0.0, xp.where(1.0 - duty < least, 1.0, duty))
        return super().open_share(obeyed)

    def duty_of_share(self, share: Array) -> Array:
        """See `AveragedLaw`; within the dead time the nearer end of the gap."""
        duty = super().duty_of_share(share)
        xp = array_namespace(duty, self.dead_time)
        least = self.dead_time / self.period
        short = xp.where(duty < 0.5 * least, 0.0, least)
        long = xp.where(1.0 - duty < 0.5 * least, 1.0, 1.0 - least)
        return xp.where(duty < least, short, xp.where(1.0 - duty < least, long, duty))


def averaged_law(model: Model, side: str) -> AveragedLaw:
    """The averaged law of valve "a" or "b" of a model, with what its effects do to it."""
    plain = AveragedLaw.of(model.at(0.0), side)
    flows = tuple(e for e in model.effects if overrides(e, *_FLOW_PORTS) and not e.states)
    flows = tuple(e for e in flows if not overrides(e, "chamber_flow"))
    timed = [e for e in model.effects if overrides(e, "delays", "pulses")]
    if not flows and not timed:
        return plain
    dead = [e.dead_time_s for e in timed if isinstance(e, DutyDeadZone) and of_side(side, e.side)]
    values = {f.name: getattr(plain, f.name) for f in dataclasses.fields(plain)}
    values["on_delay"] = edge_delay(side, True, model, 0.0)
    values["off_delay"] = edge_delay(side, False, model, 0.0)
    own = Model(model.parameters, flows)
    return EffectiveLaw(**values, model=own, side=side, dead_time=dead[-1] if dead else 0.0)


__all__ = ["EffectiveLaw", "averaged_law", "edge_delay", "leakage"]
