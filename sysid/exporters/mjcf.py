"""A bundle's moving part for MuJoCo: one joint with its friction, inertia, gravity and efforts.

The chambers and valves stay outside: the cylinder is an actuator that takes an effort, which the
plant's FMU gives. What else MuJoCo's joint cannot hold is listed, in the file and to the caller.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np

from sysid.exporters.c_text import number
from sysid.io.rig import GRAVITY_M_PER_S2, Rig
from sysid.parameters import Bundle
from sysid.plant.base import MAX_STEP, Parameters
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Effect, Model, Point, overrides
from sysid.types import FloatArray

_PORTS = tuple(
    name for name in vars(Effect) if not name.startswith("_") and callable(getattr(Effect, name))
)
# Ports of the chambers, valves and sensors: their effects are outside with these.
_OUTSIDE = frozenset(
    (
        *("supply_pressure", "exhaust_pressure", "filling_flow", "exhaust_flow", "chamber_flow"),
        *("pressure_rate", "pulses", "recent_pulses", "delays"),
        *("measure", "unmeasured", "start_sensing", "sense"),
    )
)
_OF_STATES = frozenset(("initial_states", "state_rates", "settled", "is_idle"))
_SAME = 1e-9


@dataclass(frozen=True)
class Joint:
    """What the joint and its actuators hold, SI; efforts in Nm or N.

    `stiffness` and `constant` (an effort in the positive direction) gather a return spring, a
    constant offset and the effects that are of their form, `gear` those of the motor.
    `not_held`: what is left out, a sentence each.
    """

    coulomb: float
    viscous: float
    inertia: float
    gravity_moment: float
    weight: float
    stiffness: float
    constant: float
    gear: float
    max_effort: float
    max_cylinder: float
    stop: float
    not_held: tuple[str, ...]


def joint_of(rig: Rig, model: Model, effects: Sequence[CatalogueEffect]) -> Joint:
    """The joint of a model; `effects` are the model's."""
    found = _Held(model)
    for effect in effects:
        found.take(effect)
    p: Parameters = found.parameters
    spring = (p.stiffness, p.preload)
    k, preload = (0.0 if v is None else float(v) for v in spring)
    pressure = max(float(p.supply) - float(p.atmosphere), 0.0)
    area = 0.0 if rig.is_motor_alone else max(float(p.area_a), float(p.area_b))
    return Joint(
        coulomb=float(p.coulomb_effort),
        viscous=float(p.viscous),
        inertia=float(p.inertia),
        gravity_moment=float(p.gravity_moment),
        weight=float(p.weight),
        stiffness=k + found.stiffness,
        constant=float(p.offset) - preload + found.constant,
        gear=found.gear,
        max_effort=float(p.max_effort),
        max_cylinder=area * pressure * float(p.pitch_radius),
        stop=0.5 * float(p.stroke) / float(p.pitch_radius),
        not_held=(*_left_out(rig, p), *found.reasons),
    )


@dataclass
class _Held:
    """The effects so far that are of a joint's form."""

    model: Model
    stiffness: float = 0.0
    constant: float = 0.0
    gear: float = 1.0
    reasons: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.parameters: Parameters = self.model.parameters

    def take(self, effect: CatalogueEffect) -> None:
        """Take an effect into the joint, or the reason why it is left out."""
        ports = {p for p in _PORTS if overrides(effect, p)} - _OF_STATES
        if ports and ports <= _OUTSIDE:
            self.reasons.append(f"{effect.id} acts on chambers, valves or sensors")
        elif effect.states:
            self.reasons.append(f"{effect.id} has states of its own")
        elif ports == {"parameters"}:
            self._parameters(effect)
        elif ports == {"external_effort"} and (line := self._line(effect)) is not None:
            self.constant += line[0]
            self.stiffness -= line[1]
        elif ports == {"motor_effort"} and (gear := self._gear(effect)) is not None:
            self.gear *= gear
        else:
            said = ", ".join(sorted(port.replace("_", " ") for port in ports))
            self.reasons.append(f"{effect.id} changes what a joint takes for constant ({said})")

    def _parameters(self, effect: CatalogueEffect) -> None:
        now, later = (effect.parameters(self.parameters, time) for time in (0.0, 1e3))
        if now != later:
            self.reasons.append(f"{effect.id} drifts: its start is taken")
        self.parameters = now

    def _points(self) -> list[Point]:
        """Points over the travel, at rest and moving, at two pressures and motor efforts."""
        p = self.parameters
        reach = min(0.5 * float(p.stroke) / float(p.pitch_radius), math.pi)
        return [
            Point(0.0, q, w, pressure, 1.5e5, u, 0.0, 0.0, float(np.sign(w)), p)
            for q in np.linspace(-reach, reach, 5)
            for w in (-0.7, 0.0, 0.3)
            for pressure in (1e5, 2.3e5)
            for u in (-0.4, 0.9)
        ]

    def _line(self, effect: CatalogueEffect) -> tuple[float, float] | None:
        """Effort at position 0, and its slope; None where it is no line over the position."""
        points = self._points()
        values = np.array([float(effect.external_effort(0.0, point)) for point in points])
        places = np.array([float(point.position) for point in points])
        columns = np.stack([np.ones_like(places), places], axis=1)
        found: FloatArray = np.linalg.lstsq(columns, values, rcond=None)[0]
        is_line = np.abs(values - columns @ found).max() <= _SAME * (1e-12 + np.abs(values).max())
        return (float(found[0]), float(found[1])) if is_line else None

    def _gear(self, effect: CatalogueEffect) -> float | None:
        """Effort at the output per commanded effort; None where it is not one number."""
        efforts: FloatArray = np.array([-0.9, -0.2, 0.2, 0.9])
        ratios = np.array(
            [
                float(effect.motor_effort(effort, dataclasses.replace(point, motor=effort)))
                / effort
                for point in self._points()
                for effort in efforts.tolist()
            ]
        )
        return float(ratios[0]) if np.ptp(ratios) <= _SAME else None


def _left_out(rig: Rig, p: Parameters) -> Iterator[str]:
    u = rig.units
    if float(p.static_effort) > float(p.coulomb_effort):
        yield (
            f"static friction, {float(p.static_effort):.4g} {u.effort}: the joint breaks away at "
            f"its Coulomb friction, {float(p.coulomb_effort):.4g} {u.effort}"
        )
    yield (
        "friction that holds at rest: MuJoCo's is a soft constraint, and the joint creeps under a "
        "load below it"
    )
    if not rig.is_motor_alone:
        yield (
            f"chambers and valves: the actuator cylinder takes their {u.word}, which the plant's "
            f"FMU gives (cylinder_{u.word}_{u.suffix})"
        )
    if rig.travel is not None:
        yield "end stops without rebound: the joint's limits are springs"


def mjcf_text(bundle: Bundle, joint: Joint) -> str:
    """The MJCF file of a bundle's joint."""
    rig = bundle.rig
    u, name = rig.units, rig.name
    said = [
        f"Identified joint of {name}, from a bundle created {bundle.created}; by sysid export.",
        f"Units: SI. Position in {u.position}, efforts in {u.effort}. Not held:",
        *(f"- {line}" for line in joint.not_held),
    ]
    body, axis = _linear(joint) if rig.is_linear else _rotary(joint)
    attributes: dict[str, str] = {
        "name": "output",
        "type": "slide" if rig.is_linear else "hinge",
        "axis": axis,
        "damping": number(joint.viscous),
        "frictionloss": number(joint.coulomb),
        # As stiff as the solver takes: friction creeps the less, and stops give way the less.
        "solreffriction": f"{number(2.0 * MAX_STEP)} 1",
        "solimpfriction": "0.9999 0.9999 0.001",
    }
    if rig.travel is not None:
        stop = number(joint.stop)
        attributes |= {"limited": "true", "range": f"-{stop} {stop}"}
        attributes |= {
            "solreflimit": f"{number(2.0 * MAX_STEP)} 1",
            "solimplimit": "0.99 0.9999 1e-4",
        }
    if joint.stiffness > 0.0:
        attributes["stiffness"] = number(joint.stiffness)
        attributes["springref"] = number(joint.constant / joint.stiffness)
    lines = "\n".join(f"  {_comment(line)}" for line in said)
    return f"""\
<mujoco model={quoteattr(name)}>
  <!--
{lines}
  -->
  <compiler angle="radian" inertiafromgeom="false"/>
  <option timestep="{number(MAX_STEP)}" gravity="0 0 -{number(GRAVITY_M_PER_S2)}" \
integrator="implicitfast"/>
  <worldbody>
    <body name="moving"{body}>
      <joint{_attributes(attributes)}/>
{_inertial(joint, rig)}
    </body>
  </worldbody>
  <actuator>
{_actuators(joint, rig)}
  </actuator>
  <sensor>
    <jointpos name="position" joint="output"/>
    <jointvel name="velocity" joint="output"/>
  </sensor>
</mujoco>
"""


def _rotary(joint: Joint) -> tuple[str, str]:
    """Attributes of the body, and the axis: gravity acts about y, not about z."""
    return "", "0 1 0" if joint.gravity_moment else "0 0 1"


def _linear(joint: Joint) -> tuple[str, str]:
    if not joint.weight:
        return "", "1 0 0"
    own = joint.inertia * GRAVITY_M_PER_S2
    # A weight that is not that of the moving mass: the rest is borne.
    return f' gravcomp="{number(1.0 - joint.weight / own)}"', "0 0 1"


def _inertial(joint: Joint, rig: Rig) -> str:
    """A body of this inertia about the axis and this moment of gravity, which hangs at 0."""
    if rig.is_linear:
        mass, place, own = joint.inertia, 0.0, 1e-3 * joint.inertia
    elif joint.gravity_moment:
        moment = joint.gravity_moment / GRAVITY_M_PER_S2  # mass times lever
        place = 0.5 * joint.inertia / moment
        mass, own = moment / place, 0.5 * joint.inertia
    else:
        mass, place, own = 1.0, 0.0, joint.inertia
    inertia = " ".join([number(own)] * 3)
    return (
        f'      <inertial pos="0 0 {number(-place)}" mass="{number(mass)}" '
        f'diaginertia="{inertia}"/>'
    )


def _actuators(joint: Joint, rig: Rig) -> str:
    limited = math.isfinite(joint.max_effort)
    motor: dict[str, Any] = {"name": "motor", "joint": "output", "gear": number(joint.gear)}
    if limited:
        most = number(joint.max_effort)
        motor |= {"ctrllimited": "true", "ctrlrange": f"-{most} {most}"}
    lines = [f"    <motor{_attributes(motor)}/>"]
    if joint.max_cylinder > 0.0:
        most = number(joint.max_cylinder)
        cylinder = {
            "name": "cylinder",
            "joint": "output",
            "ctrllimited": "true",
            "ctrlrange": f"-{most} {most}",
        }
        lines.append(f"    <motor{_attributes(cylinder)}/>")
    if joint.constant and not joint.stiffness > 0.0:
        bias = {
            "name": "constant",
            "joint": "output",
            "gainprm": "0",
            "biastype": "affine",
            "biasprm": number(joint.constant),
        }
        lines.append(f"    <general{_attributes(bias)}/>")
    return "\n".join(lines)


def _attributes(values: dict[str, Any]) -> str:
    return "".join(f" {key}={quoteattr(str(value))}" for key, value in values.items())


def _comment(text: str) -> str:
    """Text that ends no comment."""
    return escape(text).replace("--", "- -")


__all__ = ["Joint", "joint_of", "mjcf_text"]
