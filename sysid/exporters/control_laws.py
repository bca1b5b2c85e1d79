"""The controllers' laws as expressions: the functions of `sysid.controllers` evaluated on names.

Each is one function of the header. Those that stand alone are declared once, for their C and for
their replay (`FUNCTIONS`); the others are laws inside a controller, whose decisions and repetitions
(the horizon's loop, the choice of an inverse) are written in C around them (`control.h.in`), and
which is replayed whole (`replays`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np

from sysid.controllers.backstepping import BacksteppingController, BacksteppingMemory
from sysid.controllers.design_model import DesignModel
from sysid.controllers.dvmpc import DvmpcController, delayed_share
from sysid.controllers.interface import Reference, StateEstimate
from sysid.controllers.payload import PayloadEstimator, payload_mass
from sysid.controllers.prediction import Motion, euler_step, loaded, point_at
from sysid.controllers.pva import PvaController
from sysid.controllers.sensing import (
    Readings,
    SensingMemory,
    filter_coefficients,
    next_sample,
    sense,
)
from sysid.exporters.control_function import (
    C_FIELDS,
    ControlFunction,
    ControlLaw,
    Gains,
    Number,
    Struct,
    Switch,
    Written,
    on_names,
)
from sysid.exporters.replay import Columns, Replay
from sysid.exporters.symbolic import NAMESPACE, expression, symbol
from sysid.io.channels import SIDES
from sysid.plant.base import Array, array_namespace

# Kinds of the numbers of a struct (`vectors.draws`).
ESTIMATE = ("position", "velocity", "acceleration", "velocity", "pressure", "pressure")
REFERENCE = ("wanted", "velocity", "acceleration", "jerk")
_MOTION = ("position", "velocity", "pressure", "pressure")
_NOW = Struct("estimate", "now", StateEstimate, ESTIMATE, {"tick": 0})
_WANTED = Struct("reference", "wanted", Reference, REFERENCE, {"ahead": None})
_PAYLOAD = Number("payload", "payload")
_ESTIMATOR = Gains("payload_estimator", "gains", PayloadEstimator)


def control_laws(design: DesignModel) -> Iterator[ControlLaw]:
    """Every law of a design model on names, whose inverses are the averaged laws."""
    yield from (function.law(design) for function in FUNCTIONS)
    yield _sensing()
    yield from (function.law(design) for function in PAYLOAD_FUNCTIONS)
    yield _pva()
    yield _backstepping(design)
    yield _inverse_dynamics(design)


def function_replays(design: DesignModel) -> Iterator[Replay]:
    """Those of the functions that stand alone."""
    yield from (function.replay(design) for function in FUNCTIONS)
    yield _sensing_replay()
    yield from (function.replay(design) for function in PAYLOAD_FUNCTIONS)


def _averaged(side: str) -> Iterator[ControlFunction]:
    def law(design: DesignModel) -> Any:
        return design.inverse_a if side == "a" else design.inverse_b

    pressure = Number("pressure_pa", "pressure")
    yield ControlFunction(
        f"averaged_{side}_flow",
        f"Mean flow into chamber {side.upper()}, kg/s, over a duty (0 to 1) and pressure, Pa:"
        " the averaged law",
        (Number("duty", "duty"), pressure),
        lambda design, duty, p: law(design).flow(duty, p),
    )
    yield ControlFunction(
        f"averaged_{side}_duty",
        "Its inverse: duty for a wanted mean flow, kg/s; 0 or 1 beyond what the valve passes",
        (Number("flow_kg_s", "flow"), pressure),
        lambda design, flow, p: law(design).duty(flow, p),
        answer=0.0,
    )


def _after_step(
    design: DesignModel,
    now: Motion,
    share_a: Array,
    share_b: Array,
    wanted_velocity: Array,
    payload: Array,
    step: Any,
    trapezoidal: Any,
) -> Motion:
    """Euler's step, with the rule for the position that `trapezoidal` chooses."""
    model, none = loaded(design, payload), 0.0 * now.position
    point = point_at(now._replace(velocity=wanted_velocity), model, none, none, wanted_velocity)
    after, mended = (
        euler_step(now, (share_a, share_b), point, model, step, way) for way in (False, True)
    )
    chosen = array_namespace(now.position).where(trapezoidal, mended.position, after.position)
    return after._replace(position=chosen)


_PREDICTION_STEP = ControlFunction(
    "prediction_step",
    "One Euler step of step_s (4.4.2): valves A and B open for shares of it, 0 to 1; friction"
    " by the wanted velocity; payload in kg m2",
    (
        Struct("motion", "now", Motion, _MOTION),
        Number("share_a", "share"),
        Number("share_b", "share"),
        Number("wanted_velocity", "velocity"),
        _PAYLOAD,
        Number("step_s", "step"),
        Switch("trapezoidal"),
    ),
    _after_step,
    written=Written("motion", "next", Motion),
)


def _delayed_share(side: str) -> ControlFunction:
    switches = ("command", "before")
    return ControlFunction(
        f"delayed_share_{side}",
        f"Share of a step of span_s in which valve {side.upper()} is open, since_s after its"
        " command changed from before, by its delays",
        (
            *(Number(name, "switch") for name in switches),
            *(Number(name, "step") for name in ("since_s", "span_s")),
        ),
        lambda design, command, before, since, span: delayed_share(
            side, command, before, since, span, design.model
        ),
    )


FUNCTIONS = (
    *(function for side in SIDES for function in _averaged(side)),
    _PREDICTION_STEP,
    *map(_delayed_share, SIDES),
)
PAYLOAD_FUNCTIONS = (
    ControlFunction(
        "payload_update",
        "The payload's inertia at its lever, kg m2, from the one before and the motor's effort"
        " now (4.4.18 to 4.4.24); it moves in the vertical only",
        (_ESTIMATOR, _PAYLOAD, Number("motor", "effort"), _NOW, _WANTED),
        lambda design, gains, payload, motor, now, wanted: gains.update(
            payload, motor, now, wanted, design
        ),
    ),
    ControlFunction(
        "payload_mass",
        "Mass, kg, of a payload of this inertia, kg m2",
        (_PAYLOAD,),
        lambda design, payload: payload_mass(payload, design),
    ),
    ControlFunction(
        "payload_detected",
        "1 where an estimate is a payload, 0 where it is indistinguishable from none",
        (_ESTIMATOR, _PAYLOAD),
        lambda design, gains, payload: gains.detects(payload, design),
        kind="int",
        answer=0.0,
    ),
)


def _as_number(value: Any) -> float:
    """A name where a signature says float."""
    found: float = value
    return found


def _sensing() -> ControlLaw:
    """`next_sample`, whose memory is a struct of numbers; the header's guard does the rest."""
    held = on_names(Readings, "memory")
    pairs = {
        name: tuple(symbol(f"memory->{name}[{k}]") for k in (0, 1))
        for name in ("velocity_filter", "acceleration_filter")
    }
    memory = SensingMemory(held, symbol("memory->difference"), rejected=0.0, **pairs)
    filters = [[symbol(f"filter->{k}[{i}]") for i in range(3)] for k in ("b", "a")]
    readings = Readings(*map(symbol, ("position", "pressure_a_pa", "pressure_b_pa")))
    period = _as_number(symbol("filter->period_s"))
    later, seen = next_sample(memory, readings, 0, period, filters)
    results = {f"memory->{C_FIELDS.get(k, k)}": v for k, v in later.last._asdict().items()}
    results["memory->difference"] = later.difference
    results |= {f"memory->{name}[{k}]": getattr(later, name)[k] for name in pairs for k in (0, 1)}
    shown = seen._asdict()
    del shown["tick"]
    results |= {f"now->{C_FIELDS.get(k, k)}": v for k, v in shown.items()}
    return ControlLaw(
        "sense",
        "A tick's readings to an estimate: differences of the position, filtered. A reading that"
        " is not finite leaves the memory as it was, is counted in rejected, and makes the"
        " estimate NaN, at which a controller lets go",
        (
            "const @p@filter *filter",
            "@p@sensing *memory",
            "@p@real position",
            "@p@real pressure_a_pa",
            "@p@real pressure_b_pa",
            "@p@estimate *now",
        ),
        {name: expression(value) for name, value in results.items()},
    )


def _sensing_replay() -> Replay:
    filters = filter_coefficients(1e-3)[:, :, None]

    def evaluate(v: Columns) -> list[Any]:
        memory = SensingMemory(
            Readings(*v[:3]), v[3], np.stack(v[4:6]), np.stack(v[6:8]), np.zeros(len(v[0]))
        )
        after, seen = sense(memory, Readings(*v[8:]), 0, 1e-3, filters)
        pairs = [*after.velocity_filter, *after.acceleration_filter]
        return [*after.last, after.difference, *pairs, after.rejected, *seen[1:]]

    memory = ("position_m", "pressure_a_pa", "pressure_b_pa", "difference")
    kept = [
        "position",
        *memory[1:],
        *(f"{k}_filter[{i}]" for k in ("velocity", "acceleration") for i in (0, 1)),
    ]
    shown = ("position", "velocity", "acceleration", "raw_velocity", *memory[1:3])
    outs = [f"m.{name}" for name in (*kept, "rejected")] + [f"e.{name}" for name in shown]
    lines = ["@p@sensing m;", "@p@estimate e;"]
    lines += [f"m.{name} = (real)v[{k}];" for k, name in enumerate(kept)]
    lines.append("m.rejected = 0;")
    lines.append("@p@sense(&@p@filter_defaults, &m, (real)v[8], (real)v[9], (real)v[10], &e);")
    lines += [f"out[{k}] = (double){name};" for k, name in enumerate(outs)]
    before = ("position", "pressure", "pressure", *["velocity"] * 3, *["acceleration"] * 2)
    reading = ("reading", "pressure_reading", "pressure_reading")
    return Replay("sense", (*before, *reading), "\n    ".join(lines), evaluate, None)


def _pva() -> ControlLaw:
    controller = on_names(PvaController, "gains")
    _, commands = controller.law((), _NOW.on_names(), _WANTED.on_names())
    return ControlLaw(
        "pva_duties",
        "Duties of valves A and B, past their dead zones (4.2.1 to 4.2.3); returns 1, or 0 with"
        " both 0 where a number is not finite",
        ("const @p@pva *gains", "const @p@estimate *now", "const @p@reference *wanted", _PAIR),
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
    q, w, a, j = ([value] for value in on_names(Reference, "soon", ahead=None)[:4])
    reference = on_names(Reference, "wanted", ahead=Reference(q, w, a, j))
    fixed = {"design": flows, "estimator": None, "preview": 1}
    found = []
    for is_on in (True, False):
        controller = on_names(
            BacksteppingController, "gains", feedforward=is_on, compensation=is_on, **fixed
        )
        memory = BacksteppingMemory(symbol("payload"), symbol("motor"))
        found.append(controller.law(memory, _NOW.on_names(), reference))
    ((later, on), (later_off, off)), where = found, NAMESPACE.where
    ahead_on, helps = symbol("gains->feedforward"), symbol("gains->compensation")
    return ControlLaw(
        "backstepping_wanted",
        "Flows into chambers A and B, kg/s (4.3.59), the motor's effort (4.3.41) and the command"
        " that gives it; soon is the reference one PWM period ahead, motor the effort now",
        (
            "const @p@backstepping *gains",
            "@p@real payload",
            "@p@real motor",
            "const @p@estimate *now",
            "const @p@reference *wanted",
            "const @p@reference *soon",
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
    effort = controller.inverse_dynamics(_NOW.on_names(), _WANTED.on_names(), model)
    return ControlLaw(
        "inverse_dynamics",
        "The motor's effort (4.4.10): what the cylinder does not give, and feedback (4.4.17)",
        (
            "const @p@dvmpc *gains",
            "@p@real payload",
            "const @p@estimate *now",
            "const @p@reference *wanted",
        ),
        {"return": expression(effort)},
        "@p@real",
    )


__all__ = ["ESTIMATE", "REFERENCE", "control_laws", "function_replays"]
