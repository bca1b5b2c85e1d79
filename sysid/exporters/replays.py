"""Which functions of the header are replayed: how C calls each, and Python's own answer."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from sysid.controllers.backstepping import BacksteppingMemory, backstepping_type
from sysid.controllers.design_model import DesignModel
from sysid.controllers.dvmpc import DvmpcController, DvmpcMemory
from sysid.controllers.interface import Commands, Reference, StateEstimate
from sysid.controllers.payload import PayloadEstimator
from sysid.controllers.prediction import loaded
from sysid.controllers.pva import PvaController
from sysid.exporters.c_control import AVERAGED, gains, inverses
from sysid.exporters.control_laws import ESTIMATE, REFERENCE, function_replays
from sysid.exporters.flat import DIRECTIONS, Flat
from sysid.exporters.replay import Columns, Replay
from sysid.io.channels import SIDES
from sysid.surfaces.hull import FlowLaw, ValveLaw
from sysid.types import BoolArray, FloatArray


def control_replays(flat: Flat, design: DesignModel) -> Iterator[Replay]:
    """The replays of the controllers' part."""
    yield from function_replays(design)
    yield _pva()
    yield _backstepping(flat, design)
    yield _costs(design)
    yield _dvmpc(design)


def _signals(v: Columns) -> tuple[StateEstimate, Reference]:
    return StateEstimate(0, *v[:6]), Reference(v[6], v[7], v[8], v[9])


def _pva() -> Replay:
    def evaluate(v: Columns) -> list[Any]:
        after, commands = PvaController().commands((), *_signals(v))
        return _answers(commands, after.rejected)

    return Replay(
        "pva_control",
        (*ESTIMATE, *REFERENCE),
        """const @p@estimate e = estimate_of(v);
    const @p@reference r = reference_of(v + 6);
    @p@pva_state state = @p@pva_start();
    @p@commands c;
    out[3] = @p@pva_control_counted(&@p@pva_defaults, &state, &e, &r, &c);
    answers_of(&c, state.rejected, out);
    out[4] += out[3] != @p@pva_control(&@p@pva_defaults, &e, &r, &c);""",
        evaluate,
        None,
    )


def _answers(commands: Commands, rejected: Any) -> list[Any]:
    """Motor, valves, what the C function returns, and its count."""
    return [commands.motor, commands.valve_a, commands.valve_b, 1.0 - rejected, rejected]


def _backstepping(flat: Flat, design: DesignModel) -> Replay:
    known = [_with_inverse(flat, design, name) for name in inverses(flat)]

    def rows(v: Columns, key: tuple[float, ...]) -> list[Any]:
        number, inverse, estimated = map(int, key)
        now, wanted = _signals(v)
        q, w, a, j = (np.stack([column]) for column in v[10:14])
        controller = dataclasses.replace(
            backstepping_type(number, known[inverse % len(known)]),
            portion=gains_of.portion,
            preview=1,
            estimator=PayloadEstimator() if estimated else None,
        )
        memory = BacksteppingMemory(v[14], v[15])
        after, commands = controller.commands(
            memory, now, wanted._replace(ahead=Reference(q, w, a, j))
        )
        return [*_answers(commands, after.rejected), after.payload, after.motor]

    gains_of = gains(design, flat.rig.motor is not None)["backstepping"]
    return Replay(
        "backstepping_control",
        (*ESTIMATE, *REFERENCE, *REFERENCE, "payload", "effort", "type", "inverse", "switch"),
        f"""const @p@estimate e = estimate_of(v);
    const @p@reference r = reference_of(v + 6), soon = reference_of(v + 10);
    @p@backstepping gains = @p@backstepping_type((int)v[16]);
    @p@backstepping_state state;
    @p@commands c;
    state.payload = (real)v[14];
    state.motor = (real)v[15];
    state.rejected = 0;
    gains.inverse = (int)v[17] % {len(known)};
    out[3] = @p@backstepping_control(&gains, v[18] > 0 ? &@p@payload_estimator_defaults : NULL,
                                     &state, &e, &r, &soon, &c);
    answers_of(&c, state.rejected, out);
    out[5] = (double)state.payload;
    out[6] = (double)state.motor;""",
        lambda v: _grouped(v, v[16:19], rows, 7),
        None,
    )


def _with_inverse(flat: Flat, design: DesignModel, kind: str) -> DesignModel:
    """The design with the surfaces themselves as inverses; the averaged laws are its own."""
    if kind == AVERAGED:
        return design
    a, b = (ValveLaw(*_laws(flat, side, kind)) for side in SIDES)
    return dataclasses.replace(design, inverse_a=a, inverse_b=b)


def _laws(flat: Flat, side: str, kind: str) -> Iterator[FlowLaw]:
    """A valve's laws of a kind that it holds in both directions."""
    for direction in DIRECTIONS:
        held = flat.valves[side].pwm[direction].surfaces[kind]
        assert held is not None
        yield held.model.law


def _grouped(
    v: Columns,
    keys: Columns,
    rows: Callable[[Columns, tuple[float, ...]], list[Any]],
    outputs: int,
) -> list[FloatArray]:
    """`rows` on each group of equal keys: columns (n,)."""
    found = np.zeros((outputs, len(v[0])))
    for key in sorted(set(zip(*keys, strict=True))):
        chosen = np.all([column == k for column, k in zip(keys, key, strict=True)], axis=0)
        result = rows([column[chosen] for column in v], key)
        found[: len(result), chosen] = np.broadcast_arrays(*result)
    return list(found)


_DVMPC_INPUTS = (*ESTIMATE, *REFERENCE, "payload", "effort", "switch", "switch", "variant")
_DVMPC_START = """static @p@reference ahead[256];
    const @p@estimate e = estimate_of(v);
    @p@dvmpc gains = @p@dvmpc_defaults;
    @p@dvmpc_state state;
    state.payload = (real)v[10];
    state.motor = (real)v[11];
    state.valve_a = (real)v[12];
    state.valve_b = (real)v[13];
    state.tick = 0;
    state.rejected = 0;
    gains.predicts_delays = (int)v[14] & 1;
    gains.trapezoidal = (int)v[14] >> 1 & 1;
    gains.filtered_velocity = (int)v[14] >> 2 & 1;
    gains.varying = (int)v[14] >> 3;
    trajectory_of(v + 6, (double)gains.period_s, gains.horizon, ahead);"""


def _controller(design: DesignModel, variant: float, estimated: bool) -> DvmpcController:
    """DVMPC with the switches that a variant's bits set, as in `_DVMPC_START`."""
    delays, trapezoidal, filtered, varying = (bool(int(variant) >> k & 1) for k in range(4))
    found: DvmpcController = dataclasses.replace(
        gains(design)["dvmpc"],
        predicts_delays=delays,
        trapezoidal=trapezoidal,
        filtered_velocity=filtered,
        varying=varying,
        estimator=PayloadEstimator() if estimated else None,
    )
    return found


def _trajectory(v: Columns, controller: DvmpcController) -> Reference:
    """The reference over the horizon: a cubic in time, from the four columns at the start."""
    t = controller.period * np.arange(1, controller.horizon + 1)[:, None]
    q, w, a, j = v
    ahead = Reference(
        position=q + t * (w + t * (a / 2.0 + t * (j / 6.0))),
        velocity=w + t * (a + t * (j / 2.0)),
        acceleration=a + t * j,
        jerk=j + 0.0 * t,
    )
    return Reference(q, w, a, j, ahead)


def _cost_rows(
    design: DesignModel, v: Columns, key: tuple[float, ...], payload: FloatArray
) -> FloatArray:
    controller = _controller(design, key[0], False)
    reference = _trajectory(v[6:10], controller)
    now, model = StateEstimate(0, *v[:6]), loaded(design, payload)
    return np.asarray(controller.costs((v[12], v[13]), now, reference, model))


def _costs(design: DesignModel) -> Replay:
    def rows(v: Columns, key: tuple[float, ...]) -> list[Any]:
        return list(_cost_rows(design, v, key, v[10]))

    call = """
    double_costs(&gains, &state, &e, ahead, out);"""
    return Replay(
        "dvmpc_costs",
        _DVMPC_INPUTS,
        _DVMPC_START + call,
        lambda v: _grouped(v, v[14:15], rows, 16),
    )


def _dvmpc(design: DesignModel) -> Replay:
    def rows(v: Columns, key: tuple[float, ...]) -> list[Any]:
        controller = _controller(design, key[0], key[1] > 0.0)
        reference = _trajectory(v[6:10], controller)
        memory = DvmpcMemory(v[12], v[13], v[10], v[11])
        after, commands = controller.commands(memory, StateEstimate(0, *v[:6]), reference)
        return [*_answers(commands, after.rejected), after.payload, after.motor, after.tick]

    def gap(v: Columns, key: tuple[float, ...]) -> list[Any]:
        """How much dearer the second best first input is than the best, as a share."""
        costs = _cost_rows(design, v, key, v[16])
        best, second = np.sort(costs.reshape(4, -1, costs.shape[1]).min(axis=1), axis=0)[:2]
        return [second / np.where(best > 0.0, best, 1.0) - 1.0]

    def is_tie(v: Columns) -> BoolArray:
        now, wanted = _signals(v)
        seen = PayloadEstimator().update(v[10], v[11], now, wanted, design)
        payload = np.where(v[15] > 0.0, seen, v[10])
        # Costs that single precision may take for equal, as a share.
        return _grouped([*v, payload], v[14:15], gap, 1)[0] < 1e-3

    call = """
    {
        @p@commands c;
        out[3] = @p@dvmpc_control(&gains, v[15] > 0 ? &@p@payload_estimator_defaults : NULL,
                                  &state, &e, ahead, &c);
        answers_of(&c, state.rejected, out);
        out[5] = (double)state.payload;
        out[6] = (double)state.motor;
        out[7] = state.tick;
    }"""
    return Replay(
        "dvmpc_control",
        (*_DVMPC_INPUTS, "switch"),
        _DVMPC_START + call,
        lambda v: _grouped(v, v[14:16], rows, 8),
        None,
        is_tie,
    )


HELPERS = """\
static @p@estimate estimate_of(const double *v)
{
    @p@estimate e;
    e.position = (real)v[0];
    e.velocity = (real)v[1];
    e.acceleration = (real)v[2];
    e.raw_velocity = (real)v[3];
    e.pressure_a_pa = (real)v[4];
    e.pressure_b_pa = (real)v[5];
    return e;
}

static @p@reference reference_of(const double *v)
{
    @p@reference r;
    r.position = (real)v[0];
    r.velocity = (real)v[1];
    r.acceleration = (real)v[2];
    r.jerk = (real)v[3];
    return r;
}

/* A cubic in time from the reference at v on: horizon + 1 ticks. */
static void trajectory_of(const double *v, double period, int horizon, @p@reference *ahead)
{
    int k;
    for (k = 0; k <= horizon; k++) {
        const double t = period * k;
        ahead[k].position = (real)(v[0] + t * (v[1] + t * (v[2] / 2 + t * (v[3] / 6))));
        ahead[k].velocity = (real)(v[1] + t * (v[2] + t * (v[3] / 2)));
        ahead[k].acceleration = (real)(v[2] + t * v[3]);
        ahead[k].jerk = (real)v[3];
    }
}

/* Motor and valves into out[0] to out[2], the count into out[4]. */
static void answers_of(const @p@commands *c, unsigned rejected, double *out)
{
    out[0] = (double)c->motor;
    out[1] = (double)c->valve_a;
    out[2] = (double)c->valve_b;
    out[4] = (double)rejected;
}

static void double_costs(const @p@dvmpc *gains, const @p@dvmpc_state *state, const @p@estimate *e,
                         const @p@reference *ahead, double out[16])
{
    real costs[16] = {0};
    int k;
    @p@dvmpc_costs(gains, state, e, ahead, costs);
    for (k = 0; k < 16; k++) {
        out[k] = (double)costs[k];
    }
}
"""

__all__ = ["HELPERS", "control_replays"]
