"""Controllers on numbers that are not finite: they let go, keep what they remember, and count.

Every number that a controller reads (estimate, reference, memory, gains, its model), in lanes of
their own: one or two of them are not finite.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pytest

from datasets.thesis.reference_rig import bipolynomial_design, design, plant
from sysid.controllers.backstepping import BacksteppingController
from sysid.controllers.dvmpc import DvmpcController
from sysid.controllers.faults import SensorFaults
from sysid.controllers.feedforward import FeedforwardController
from sysid.controllers.force import ForceController
from sysid.controllers.guard import GuardedController
from sysid.controllers.interface import Commands, Controller, Reference, StateEstimate
from sysid.controllers.loop import Case, ClosedLoopRun, closed_loop
from sysid.controllers.payload import PayloadEstimator
from sysid.controllers.pva import PvaController
from sysid.controllers.sensing import (
    Readings,
    SensingMemory,
    filter_coefficients,
    sense,
    start_sensing,
)
from sysid.controllers.trajectories import DesiredMotion, thesis_trajectory
from sysid.plant.arrays import put_together, take_apart
from sysid.plant.effects.supply import SupplyDroop
from sysid.plant.period_step import jax
from sysid.types import FloatArray

CALLS = 10_000
BAD = (np.nan, np.inf, -np.inf)
UPRIGHT = {"orientation": "vertical", "payload_kg": 0.2}


def drooping() -> Any:
    """The design with an effect that has numbers of its own."""
    own = design()
    droop = SupplyDroop(**{q.name: q.typical for q in SupplyDroop.quantities})
    return dataclasses.replace(own, model=own.model + droop)


MAKERS: dict[str, Callable[[], GuardedController]] = {
    "pva": PvaController,
    "backstepping": lambda: BacksteppingController(design(UPRIGHT), estimator=PayloadEstimator()),
    "bipolynomial": lambda: BacksteppingController(bipolynomial_design()),
    "effect": lambda: BacksteppingController(drooping()),
    "feedforward": lambda: FeedforwardController(design()),
    "force": lambda: ForceController(design()),
    "dvmpc": lambda: DvmpcController(design(UPRIGHT), horizon=6, estimator=PayloadEstimator()),
    "varying": lambda: DvmpcController(
        design(), horizon=9, hold=1, varying=True, predicts_delays=True
    ),
}
make = cache(lambda name: MAKERS[name]())


def built_in() -> set[type]:
    """Every controller of the package."""
    found: set[type] = set()
    kinds: list[type] = [GuardedController]
    while kinds:
        more = kinds.pop().__subclasses__()
        found.update(more)
        kinds += more
    return {kind for kind in found if kind.__module__.startswith("sysid.")}


def test_every_controller_is_here() -> None:
    assert {type(make(name)) for name in MAKERS} == built_in()


class Call:
    """A controller's call as one list of numbers (n, lanes), and back."""

    def __init__(self, controller: GuardedController, lanes: int, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self._structure, numbers = take_apart(controller)
        self._tables = {k: x for k, x in enumerate(numbers) if np.ndim(x) > 0}
        gains = [np.zeros(lanes) + x for k, x in enumerate(numbers) if k not in self._tables]
        memory = [x + np.zeros(lanes) for x in controller.start(lanes)]
        self._memory = type(controller.start(1))
        n = len(gains), len(memory)
        self._parts = np.cumsum([n[0], n[1], 6, 4])
        signals = rng.normal(0.0, 1.0, (10, lanes)) * np.array(
            [[0.1], [0.3], [1.0], [0.3], [2e4], [2e4], [0.1], [0.3], [1.0], [5.0]]
        )
        signals[4:6] += 2e5
        preview = controller.preview
        ahead = signals[6:] + 0.01 * rng.normal(0.0, 1.0, (preview, 4, lanes))
        self.good = np.concatenate([gains, memory, signals, ahead.reshape(-1, lanes)])
        self.preview = preview
        # The count may be anything that it was; a motor without a limit has an infinite one.
        self.counts = n[0] + self._memory._fields.index("rejected")
        limit = max_effort(controller)
        self.limits = [k for k in range(n[0]) if limit is not None and np.all(gains[k] == limit)]

    def controller(self, numbers: Any) -> GuardedController:
        gains = iter(numbers[: self._parts[0]])
        count = int(self._parts[0]) + len(self._tables)
        parts = [self._tables[k] if k in self._tables else next(gains) for k in range(count)]
        made: GuardedController = put_together(self._structure, parts)
        return made

    def memory(self, numbers: Any) -> Any:
        return self._memory(*numbers[self._parts[0] : self._parts[1]])

    def __call__(self, numbers: Any, memory: Any = None) -> tuple[Any, Commands]:
        _, b, c, d = self._parts
        estimate = StateEstimate(0, *numbers[b:c])  # type: ignore[arg-type]
        later = None
        if self.preview:
            ahead = numbers[d:].reshape(self.preview, 4, -1)
            later = Reference(*(ahead[:, i] for i in range(4)))
        reference = Reference(*numbers[c:d], later)
        before = self.memory(numbers) if memory is None else memory
        return self.controller(numbers).commands(before, estimate, reference)

    def spoilt(self, seed: int = 1) -> FloatArray:
        """One or two numbers of each lane not finite."""
        rng = np.random.default_rng(seed)
        found = self.good.copy()
        lanes = np.arange(found.shape[1])
        places = np.array([k for k in range(len(found)) if k != self.counts])
        first = np.resize(places, len(lanes))
        value = rng.choice(BAD, len(lanes))
        found[first, lanes] = np.where(np.isin(first, self.limits), np.nan, value)
        second = lanes[rng.random(len(lanes)) < 0.5]
        found[rng.choice(places, len(second)), second] = np.nan
        return found


def max_effort(controller: Any) -> float | None:
    own = getattr(controller, "design", None)
    return None if own is None else float(own.parameters.max_effort)


def check(before: Any, found: tuple[Any, Commands]) -> None:
    """Let go in every lane."""
    after, commands = (jax.tree.map(np.asarray, part) for part in found)
    for command in commands[:3]:
        assert np.array_equal(command, np.zeros_like(command))
    assert np.isnan(commands.payload_kg).all()
    for name, was, now in zip(before._fields, before, after, strict=True):
        if name == "rejected":
            assert np.array_equal(now, was + 1.0)
        else:
            np.testing.assert_array_equal(now, was, name)


@pytest.mark.parametrize("name", MAKERS)
def test_a_number_that_is_not_finite_lets_go(name: str) -> None:
    """10,000 calls, in numpy; good lanes between them are as they are alone, to the last bit."""
    call = Call(make(name), CALLS)
    good = call(call.good)
    assert all(np.isfinite(c).all() for c in good[1][:3]) and not np.any(good[0].rejected)
    assert sum(np.abs(c).sum() for c in good[1][:3]) > 0.0
    spoilt = call.spoilt()
    assert not np.isfinite(spoilt).all(axis=0).any()
    check(call.memory(spoilt), call(spoilt))
    mixed = np.where(np.arange(CALLS) % 2 == 0, spoilt, call.good)
    after, commands = call(mixed)
    for alone, among in zip((*good[0], *good[1]), (*after, *commands), strict=True):
        np.testing.assert_array_equal(alone[1::2], among[1::2])


@pytest.mark.parametrize("name", ["pva", "backstepping", "dvmpc"])
def test_the_compiled_does_the_same(name: str) -> None:
    call = Call(make(name), 2000)
    spoilt = call.spoilt()
    check(call.memory(spoilt), jax.jit(call)(jax.numpy.asarray(spoilt)))


@pytest.mark.parametrize("name", MAKERS)
def test_bad_samples_leave_no_trace(name: str) -> None:
    """100 good samples, with and without bad ones before and among them: to the last bit."""
    call = Call(make(name), 100)
    rng = np.random.default_rng(3)
    memories = [jax.tree.map(lambda x: x[:1], call.memory(call.good)) for _ in range(2)]
    count = 0
    for k in range(100):
        for _ in range(int(rng.integers(0, 3))):
            bad = call.good[:, k : k + 1].copy()
            bad[rng.integers(call._parts[1], call._parts[3]), 0] = rng.choice(BAD)
            memories[1], commands = call(bad, memories[1])
            assert not any(np.any(c) for c in commands[:3])
            count += 1
        sample = call.good[:, k : k + 1]
        answers = []
        for i in range(2):
            memories[i], commands = call(sample, memories[i])
            answers.append([*commands, *memories[i]._replace(rejected=np.zeros(1))])
        np.testing.assert_array_equal(*answers)
    assert count > 50 and memories[1].rejected == count and memories[0].rejected == 0


def test_overflow_lets_go() -> None:
    """Finite inputs from which infinite numbers follow would be hidden by a limit."""
    for name in MAKERS:
        call = Call(make(name), 6)
        numbers = call.good.copy()
        for lane in range(6):
            numbers[call._parts[1] + lane, lane] = 1e308
        after, commands = call(numbers)
        finite = np.isfinite(np.stack(commands[:3])).all(axis=0)
        assert finite.all() and (after.rejected.any() or name == "feedforward")
        assert all(np.isfinite(x).all() for x in after)


def test_an_empty_memory_counts_from_the_start() -> None:
    one = np.zeros(1)
    lost = StateEstimate(0, *[one + np.nan] * 6)  # type: ignore[arg-type]
    after, commands = PvaController().commands((), lost, Reference(one, one, one, one))
    assert after.rejected == 1.0 and not commands.valve_a.any()


def test_a_motor_without_a_limit_is_no_fault() -> None:
    call = Call(BacksteppingController(design(max_effort=np.inf)), 3)
    assert not call(call.good)[0].rejected.any()


def test_a_payload_follows_from_what_is_known() -> None:
    estimator, own, one = PayloadEstimator(), design(UPRIGHT), np.ones(1)
    estimate = StateEstimate(0, one, one, one, one, 2e5 * one, 2e5 * one)  # type: ignore[arg-type]
    reference = Reference(one, one, one, one)
    assert np.isfinite(estimator.update(0.1 * one, one, estimate, reference, own)).all()
    for bad in BAD:
        lost = estimate._replace(pressure_a=bad * one)
        with np.errstate(invalid="ignore"):
            for motor, seen in ((one, lost), (bad * one, estimate)):
                assert np.isnan(estimator.update(0.1 * one, motor, seen, reference, own)).all()


# --- sensing ---------------------------------------------------------------------------------


def readings(lanes: int, seed: int) -> FloatArray:
    rng = np.random.default_rng(seed)
    return rng.normal(0.0, 1.0, (3, lanes)) * [[0.1], [1e4], [1e4]] + [[0.0], [2e5], [2e5]]


def test_readings_that_are_not_finite_leave_no_trace() -> None:
    """10,000 ticks with one or two bad readings; then 100 good ones."""
    filters = filter_coefficients(1e-3)[:, :, None]
    lanes = CALLS // 100
    first = readings(lanes, 0)
    alone = with_bad = start_sensing(Readings(*first))
    rng = np.random.default_rng(1)
    for k in range(100):
        bad = readings(lanes, k)
        for _ in range(2):
            bad[rng.integers(0, 3, lanes), np.arange(lanes)] = rng.choice(BAD, lanes)
        with_bad, seen = sense(with_bad, Readings(*bad), k, 1e-3, filters)  # type: ignore[arg-type]
        assert np.isnan(seen[1:]).all()
    assert (with_bad.rejected == 100).all()
    for k in range(100):
        sample = Readings(*readings(lanes, 1000 + k))
        alone, one = sense(alone, sample, k, 1e-3, filters)  # type: ignore[arg-type]
        with_bad, other = sense(with_bad, sample, k, 1e-3, filters)  # type: ignore[arg-type]
        np.testing.assert_array_equal(one[1:], other[1:])
    same_memory(alone, with_bad)


def same_memory(one: SensingMemory, other: SensingMemory) -> None:
    for a, b in zip(one[:-1], other[:-1], strict=True):
        np.testing.assert_array_equal(a, b)


def test_sensing_starts_at_the_first_good_readings() -> None:
    filters = filter_coefficients(1e-3)[:, :, None]
    good = Readings(*readings(1, 0))
    memory = start_sensing(good._replace(position=np.array([np.nan])))
    memory, seen = sense(memory, good._replace(pressure_b=np.array([np.inf])), 0, 1e-3, filters)  # type: ignore[arg-type]
    assert np.isnan(seen[1:]).all()
    memory, seen = sense(memory, good, 1, 1e-3, filters)  # type: ignore[arg-type]
    assert seen.position == good.position and seen.velocity == seen.acceleration == 0.0
    same_memory(memory, start_sensing(good))


def test_a_filter_that_is_not_finite_is_bad() -> None:
    filters = filter_coefficients(1e-3)[:, :, None].copy()
    good = Readings(*readings(1, 0))
    filters[1, 2] = np.nan
    memory, seen = sense(start_sensing(good), good, 0, 1e-3, filters)  # type: ignore[arg-type]
    assert np.isnan(seen[1:]).all() and memory.rejected == 1


# --- the loop --------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Holed:
    """A trajectory with one tick that is not finite."""

    inner: DesiredMotion
    tick: int
    value: float

    def sample(self, time: FloatArray) -> FloatArray:
        rows = self.inner.sample(time).copy()
        rows[self.tick, 0] = self.value
        return rows


class Summing(Controller):
    """A user's own: keeps a sum, and at some ticks gives what is not finite."""

    def __init__(self, bad: tuple[int, ...] = (), value: float = np.nan) -> None:
        self.bad, self.value = bad, value

    def start(self, lanes: int) -> Any:
        return {"sum": np.zeros(lanes), "pair": (np.zeros((2, lanes)), 0)}

    def commands(
        self, memory: Any, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        is_bad = sum((estimate.tick == k) * 1 for k in self.bad) > 0 if self.bad else False
        xp = np if isinstance(estimate.position, np.ndarray) else jax.numpy
        total = memory["sum"] + xp.where(is_bad, self.value, 1.0 + 0.0 * estimate.position)
        pair, ticks = memory["pair"]
        on = xp.ones_like(total)
        return {"sum": total, "pair": (pair + 1.0, ticks + 1)}, Commands(
            0.1 * on, on, xp.where(is_bad, self.value, total / 1000.0)
        )


def loop(cases: list[Case], compiled: bool, ticks: int = 60) -> list[ClosedLoopRun]:
    return closed_loop(cases, 1e-3 * ticks, compiled=compiled)


@pytest.mark.parametrize("compiled", [True, False])
def test_a_bad_reference_in_a_loop(compiled: bool) -> None:
    path = thesis_trajectory(3)
    controllers = [PvaController(), BacksteppingController(design()), make("dvmpc")]
    cases = [Case(c, plant(), Holed(path, 30, np.nan)) for c in controllers]
    lost = dataclasses.replace(PvaController(), velocity_gain=np.nan)
    cases += [Case(PvaController(), plant(), path), Case(lost, plant(), path)]
    runs = loop(cases, compiled)
    for case, run in zip(cases[:3], runs[:3], strict=True):
        off = ~(run.motor.astype(bool) | run.command_a.astype(bool) | run.command_b.astype(bool))
        preview = case.controller.preview
        assert off[30 - preview : 31].all() and not off[:30].all()
        assert f"controller: {preview + 1} ticks" in " ".join(run.faults)
    assert not runs[3].faults and runs[3].command_a.any()
    assert not runs[4].command_a.any() and "controller: 60 ticks" in " ".join(runs[4].faults)
    (alone,) = loop([cases[3]], compiled)
    np.testing.assert_allclose(alone.position, runs[3].position, atol=1e-12)


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("value", BAD)
def test_a_users_controller_lets_go(value: float, compiled: bool) -> None:
    """All of its commands are 0 in such a tick, and it goes on from the memory before it."""
    one, other = Summing(), Summing((20, 21), value)
    cases = [Case(c, plant(), thesis_trajectory(3)) for c in (one, other)]
    healthy, run = loop(cases, compiled)
    for column in (run.motor, run.command_a, run.command_b):
        assert not column[20:22].any() and column[:20].all() and column[22:].all()
    np.testing.assert_array_equal(run.command_b[22:], healthy.command_b[20:-2])
    assert (
        "controller: 2 ticks gave no finite output; motor and valves were switched off"
        in run.faults
    )
    assert not any("controller" in line for line in healthy.faults)


class Strict(Summing):
    """Raises where it is given what is not finite."""

    def commands(
        self, memory: Any, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        assert np.isfinite(float(estimate.position[0]))
        return super().commands(memory, estimate, reference)


def test_a_lost_sensor_in_a_loop() -> None:
    """The controller lets go, is not called where it is Python's, and goes on as before."""
    faults = SensorFaults(pressure_fails=0.02, pressure_recovers=0.03)
    strict = Case(Strict(), plant(), thesis_trajectory(3), faults=faults)
    (run,) = loop([strict], compiled=False)
    assert not run.command_a[20:30].any() and run.command_a[30:].all()
    assert run.command_b[30] == pytest.approx(0.021)
    assert np.isfinite(run.measured_a).all() and len(set(run.measured_a[19:30])) == 1
    assert run.faults[0].startswith("sensor: readings were not finite in 10 ticks")
    assert not any(line.startswith("controller") for line in run.faults)
    (run,) = loop([dataclasses.replace(strict, controller=make("dvmpc"))], compiled=True)
    assert not run.command_a[20:30].any() and not run.motor[20:30].any()
    assert not any(line.startswith("controller") for line in run.faults)


class Count(NamedTuple):
    rejected: Any


class Spring(GuardedController):
    """A user's own outside a loop."""

    def start(self, lanes: int) -> Count:
        return Count(np.zeros(lanes))

    def law(
        self, memory: Any, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        error = reference.position - estimate.position
        return memory, Commands(6.0 * error, 0.0 * error, 0.0 * error)


def test_a_users_controller_outside_a_loop() -> None:
    one = np.array([0.1, np.inf])
    seen = StateEstimate(0, one, *[np.zeros(2)] * 5)  # type: ignore[arg-type]
    own = Spring()
    after, commands = own.commands(own.start(2), seen, Reference(*[np.zeros(2)] * 4))
    assert commands.motor.tolist() == [-0.6000000000000001, 0.0]
    assert after.rejected.tolist() == [0.0, 1.0]
