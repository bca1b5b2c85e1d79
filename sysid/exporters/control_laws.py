"""The controllers' laws as expressions: the functions of `sysid.controllers` evaluated on names.

Each `ControlLaw` is one function of the header. What decides or repeats (the horizon's loop, the
choice of an inverse) is written in C around them (`control.h.in`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeVar

from sysid.controllers.backstepping import BacksteppingController, BacksteppingMemory
from sysid.controllers.design_model import DesignModel
from sysid.controllers.dvmpc import DvmpcController, delayed_share
from sysid.controllers.interface import Reference, StateEstimate
from sysid.controllers.payload import PayloadEstimator, payload_mass
from sysid.controllers.prediction import Motion, euler_step, loaded, point_at
from sysid.controllers.pva import PvaController
from sysid.controllers.sensing import Readings, SensingMemory, next_sample
from sysid.exporters.symbolic import NAMESPACE, expression, symbol
from sysid.io.channels import SIDES
from sysid.plant.base import Array

_FIELDS = {"pressure_a": "pressure_a_pa", "pressure_b": "pressure_b_pa"}
_T = TypeVar("_T")


@dataclass(frozen=True)
class ControlLaw:
    """A function of the header: `results` maps what it sets to expressions.

    `arguments` are C declarations, @p@ for the prefix; `kind` is what it returns: "void", "int"
    or "@p@real", the result of the name "return". An "int" without one is 1.
    """

    name: str
    meaning: str
    arguments: tuple[str, ...]
    results: dict[str, Any]
    kind: str = "void"


def control_laws(design: DesignModel) -> Iterator[ControlLaw]:
    """Every law of a design model on names, whose inverses are the averaged laws."""
    yield from _averaged(design)
    yield _prediction_step(design)
    yield from _delayed_shares(design)
    yield _sensing()
    yield from _payload(design)
    yield _pva()
    yield _backstepping(design)
    yield _inverse_dynamics(design)


def _real(name: str) -> str:
    return f"@p@real {name}"


def _of(kind: str, name: str) -> str:
    return f"const @p@{kind} *{name}"


def _struct(kind: type[_T], name: str, **others: Any) -> _T:
    """A dataclass or named tuple whose fields are those of a C struct."""
    fields = getattr(kind, "_fields", None) or [f.name for f in dataclasses.fields(kind)]  # type: ignore[arg-type]
    values = {f: symbol(f"{name}->{_FIELDS.get(f, f)}") for f in fields if f not in others}
    return kind(**values, **others)


def _estimate() -> StateEstimate:
    return _struct(StateEstimate, "now", tick=0)


def _reference(name: str, ahead: Reference | None = None) -> Reference:
    return _struct(Reference, name, ahead=ahead)


def _returned(value: Any) -> dict[str, Any]:
    return {"return": expression(value)}


def _averaged(design: DesignModel) -> Iterator[ControlLaw]:
    for side in SIDES:
        law: Any = design.inverse_a if side == "a" else design.inverse_b
        yield ControlLaw(
            f"averaged_{side}_flow",
            f"Mean flow into chamber {side.upper()}, kg/s, over a duty (0 to 1) and pressure, Pa:"
            " the averaged law",
            (_real("duty"), _real("pressure_pa")),
            _returned(law.flow(symbol("duty"), symbol("pressure_pa"))),
            "@p@real",
        )
        yield ControlLaw(
            f"averaged_{side}_duty",
            "Its inverse: duty for a wanted mean flow, kg/s; 0 or 1 beyond what the valve passes",
            (_real("flow_kg_s"), _real("pressure_pa")),
            _returned(law.duty(symbol("flow_kg_s"), symbol("pressure_pa"))),
            "@p@real",
        )


def _prediction_step(design: DesignModel) -> ControlLaw:
    """Euler's step with either rule for the position, which `trapezoidal` chooses in C."""
    model = loaded(design, symbol("payload"))
    motion = _struct(Motion, "now")
    none, wanted = 0.0 * motion.position, symbol("wanted_velocity")
    point = point_at(motion._replace(velocity=wanted), model, none, none, wanted)
    shares = symbol("share_a"), symbol("share_b")
    after, mended = (
        euler_step(motion, shares, point, model, _as_number(symbol("step_s")), way)
        for way in (False, True)
    )
    position = NAMESPACE.where(symbol("trapezoidal"), mended.position, after.position)
    results = after._asdict() | {"position": position}
    return ControlLaw(
        "prediction_step",
        "One Euler step of step_s (4.4.2): valves A and B open for shares of it, 0 to 1; friction"
        " by the wanted velocity; payload in kg m2",
        (
            _of("motion", "now"),
            *(_real(name) for name in ("share_a", "share_b", "wanted_velocity", "payload")),
            _real("step_s"),
            "int trapezoidal",
            "@p@motion *next",
        ),
        {f"next->{_FIELDS.get(k, k)}": expression(v) for k, v in results.items()},
    )


def _as_number(value: Any) -> float:
    """A name where a signature says float."""
    found: float = value
    return found


def _delayed_shares(design: DesignModel) -> Iterator[ControlLaw]:
    names = ("command", "before", "since_s", "span_s")
    new, old, since, span = map(symbol, names)
    for side in SIDES:
        yield ControlLaw(
            f"delayed_share_{side}",
            f"Share of a step of span_s in which valve {side.upper()} is open, since_s after its"
            " command changed from before, by its delays",
            tuple(map(_real, names)),
            _returned(delayed_share(side, new, old, since, span, design.model)),
            "@p@real",
        )


def _sensing() -> ControlLaw:
    """`next_sample`, whose memory is a struct of numbers; the header's guard does the rest."""
    held = _struct(Readings, "memory")
    pairs = {
        name: tuple(symbol(f"memory->{name}[{k}]") for k in (0, 1))
        for name in ("velocity_filter", "acceleration_filter")
    }
    memory = SensingMemory(held, symbol("memory->difference"), rejected=0.0, **pairs)
    filters = [[symbol(f"filter->{k}[{i}]") for i in range(3)] for k in ("b", "a")]
    readings = Readings(*map(symbol, ("position", "pressure_a_pa", "pressure_b_pa")))
    period = _as_number(symbol("filter->period_s"))
    later, seen = next_sample(memory, readings, 0, period, filters)
    results = {f"memory->{_FIELDS.get(k, k)}": v for k, v in later.last._asdict().items()}
    results["memory->difference"] = later.difference
    results |= {f"memory->{name}[{k}]": getattr(later, name)[k] for name in pairs for k in (0, 1)}
    shown = seen._asdict()
    del shown["tick"]
    results |= {f"now->{_FIELDS.get(k, k)}": v for k, v in shown.items()}
    return ControlLaw(
        "sense",
        "A tick's readings to an estimate: differences of the position, filtered. A reading that"
        " is not finite leaves the memory as it was, is counted in rejected, and makes the"
        " estimate NaN, at which a controller lets go",
        (
            _of("filter", "filter"),
            "@p@sensing *memory",
            *map(_real, ("position", "pressure_a_pa", "pressure_b_pa")),
            "@p@estimate *now",
        ),
        {name: expression(value) for name, value in results.items()},
    )


def _payload(design: DesignModel) -> Iterator[ControlLaw]:
    estimator, payload = _struct(PayloadEstimator, "gains"), symbol("payload")
    reference = _reference("wanted")
    updated = estimator.update(payload, symbol("motor"), _estimate(), reference, design)
    yield ControlLaw(
        "payload_update",
        "The payload's inertia at its lever, kg m2, from the one before and the motor's effort"
        " now (4.4.18 to 4.4.24); it moves in the vertical only",
        (
            _of("payload_estimator", "gains"),
            _real("payload"),
            _real("motor"),
            _of("estimate", "now"),
            _of("reference", "wanted"),
        ),
        _returned(updated),
        "@p@real",
    )
    yield ControlLaw(
        "payload_mass",
        "Mass, kg, of a payload of this inertia, kg m2",
        (_real("payload"),),
        _returned(payload_mass(payload, design)),
        "@p@real",
    )
    yield ControlLaw(
        "payload_detected",
        "1 where an estimate is a payload, 0 where it cannot be told from none",
        (_of("payload_estimator", "gains"), _real("payload")),
        _returned(estimator.detects(payload, design)),
        "int",
    )


def _pva() -> ControlLaw:
    controller = _struct(PvaController, "gains")
    _, commands = controller.law((), _estimate(), _reference("wanted"))
    return ControlLaw(
        "pva_duties",
        "Duties of valves A and B, past their dead zones (4.2.1 to 4.2.3); returns 1, or 0 with"
        " both 0 where a number is not finite",
        (_of("pva", "gains"), _of("estimate", "now"), _of("reference", "wanted"), _PAIR),
        {"duty[0]": expression(commands.valve_a), "duty[1]": expression(commands.valve_b)},
        "int",
    )


_PAIR = "@p@real duty[2]"


class _TheFlow:
    """In place of an inverse: the wanted flow itself, for which C takes the inverse chosen."""

    def duty(self, flow: Array, pressure: Array) -> Array:
        return flow


def _backstepping(design: DesignModel) -> ControlLaw:
    """Flows and motor with and without the two compensations, which switches choose in C."""
    flows = dataclasses.replace(design, inverse_a=_TheFlow(), inverse_b=_TheFlow())
    q, w, a, j = ([value] for value in _reference("soon")[:4])
    reference = _reference("wanted", Reference(q, w, a, j))
    fixed = {"design": flows, "estimator": None, "preview": 1}
    found = []
    for is_on in (True, False):
        controller = _struct(
            BacksteppingController, "gains", feedforward=is_on, compensation=is_on, **fixed
        )
        memory = BacksteppingMemory(symbol("payload"), symbol("motor"))
        found.append(controller.law(memory, _estimate(), reference))
    ((later, on), (later_off, off)), where = found, NAMESPACE.where
    ahead_on, helps = symbol("gains->feedforward"), symbol("gains->compensation")
    return ControlLaw(
        "backstepping_wanted",
        "Flows into chambers A and B, kg/s (4.3.59), the motor's effort (4.3.41) and the command"
        " that gives it; soon is the reference one PWM period ahead, motor the effort now",
        (
            _of("backstepping", "gains"),
            _real("payload"),
            _real("motor"),
            _of("estimate", "now"),
            _of("reference", "wanted"),
            _of("reference", "soon"),
            "@p@real flow_kg_s[2]",
            "@p@real *effort",
            "@p@real *command",
        ),
        {
            "flow_kg_s[0]": expression(where(ahead_on, on.valve_a, off.valve_a)),
            "flow_kg_s[1]": expression(where(ahead_on, on.valve_b, off.valve_b)),
            "*effort": expression(where(helps, later.motor, later_off.motor)),
            "*command": expression(where(helps, on.motor, off.motor)),
        },
    )


def _inverse_dynamics(design: DesignModel) -> ControlLaw:
    controller = DvmpcController(
        design,
        natural_frequency=_as_number(symbol("gains->natural_frequency")),
        damping=_as_number(symbol("gains->damping")),
    )
    model = loaded(design, symbol("payload"))
    effort = controller.inverse_dynamics(_estimate(), _reference("wanted"), model)
    return ControlLaw(
        "inverse_dynamics",
        "The motor's effort (4.4.10): what the cylinder does not give, and feedback (4.4.17)",
        (
            _of("dvmpc", "gains"),
            _real("payload"),
            _of("estimate", "now"),
            _of("reference", "wanted"),
        ),
        _returned(effort),
        "@p@real",
    )


__all__ = ["ControlLaw", "control_laws"]
