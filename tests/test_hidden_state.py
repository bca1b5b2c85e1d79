"""A user's controller that keeps its state anywhere but in its memory runs as written."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

import sysid as si
from sysid.controllers.groups import grouped
from sysid.controllers.hidden_state import Watch, frozen
from sysid.controllers.interface import Commands, Controller, Reference, StateEstimate
from sysid.io.bundled import REFERENCE_BUNDLE, thesis_folder

PERIOD_S = 1e-3
_total: Any = 0.0


class Integral(Controller):
    """Motor effort: the integral of the error, kept where `added` keeps it."""

    def added(self, error: Any) -> Any:
        raise NotImplementedError

    def commands(
        self, memory: Any, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        error = PERIOD_S * (reference.position - estimate.position)
        return memory, Commands(self.added(error), 0.0 * error, 0.0 * error)


class InDict(Integral):
    def __init__(self) -> None:
        self.kept: dict[str, Any] = {"total": 0.0}

    def added(self, error: Any) -> Any:
        self.kept["total"] = self.kept["total"] + error
        return self.kept["total"]


class InQueue(Integral):
    def __init__(self) -> None:
        self.errors: deque[Any] = deque()

    def added(self, error: Any) -> Any:
        self.errors.append(error)
        return sum(self.errors)


class InGlobal(Integral):
    def added(self, error: Any) -> Any:
        global _total
        _total = _total + error
        return _total


class InClass(Integral):
    kept: tuple[Any, ...] = (0.0,)

    def added(self, error: Any) -> Any:
        InClass.kept = (InClass.kept[0] + error,)
        return InClass.kept[0]


class Store:
    total: Any = 0.0


class InOtherClass(Integral):
    def added(self, error: Any) -> Any:
        Store.total = Store.total + error
        return Store.total


@dataclass
class InDataclass(Integral):
    total: Any = 0.0
    errors: list[Any] = field(default_factory=list)

    def added(self, error: Any) -> Any:
        self.total = self.total + error
        return self.total


def _summing() -> Callable[[Any], Any]:
    total: Any = 0.0

    def added(error: Any) -> Any:
        nonlocal total
        total = total + error
        return total

    return added


class InClosure(Integral):
    def __init__(self) -> None:
        self.sum = _summing()

    def added(self, error: Any) -> Any:
        return self.sum(error)


class InMemory(Controller):
    """The form that is compiled; its gains, a dict among them, stay as they are."""

    def __init__(self) -> None:
        self.gains = {"integral": 1.0}

    def start(self, lanes: int) -> Any:
        return np.zeros(lanes)

    def commands(
        self, memory: Any, estimate: StateEstimate, reference: Reference
    ) -> tuple[Any, Commands]:
        memory = memory + PERIOD_S * (reference.position - estimate.position)
        effort = self.gains["integral"] * memory
        return memory, Commands(effort, 0.0 * effort, 0.0 * effort)


PLACES = {
    InDict: "itself",
    InQueue: "itself",
    InClosure: "itself",
    InDataclass: "itself",
    InGlobal: "_total",
    InClass: "InClass.kept",
    InOtherClass: "Store.total",
    InMemory: "",
}


@pytest.mark.parametrize("own", PLACES)
def test_an_integral_is_one_wherever_it_is_kept(own: type[Controller]) -> None:
    bundle = si.read_bundle(thesis_folder() / REFERENCE_BUNDLE)
    found = si.control(bundle, own, trajectory=1, mode="motor", duration_s=0.05)
    error = found.run.reference[:, 0] - found.run.measured
    np.testing.assert_allclose(found.run.motor, np.cumsum(PERIOD_S * error), atol=1e-12)
    said = [n for n in found.notices if "keeps its state" in n]
    assert len(said) == bool(PLACES[own])
    assert all(n.endswith(f"as it keeps its state in {PLACES[own]}") for n in said)


class Slots(InMemory):
    __slots__ = ("own",)
    own: Any


def _counting() -> Iterator[int]:
    count = 0
    while True:
        yield count
        count += 1


def test_what_changed_is_found_however_deep() -> None:
    watched = Slots()
    watched.own = {"list": [np.zeros(2), {1, 2}], "rng": np.random.default_rng(0), "n": _counting()}
    watched.own["again"] = watched.own
    next(watched.own["n"])
    changes: list[Callable[[], object]] = [
        lambda: watched.own["list"][0].__setitem__(1, 1.0),
        lambda: watched.own["list"][1].add(3),
        lambda: watched.own["rng"].normal(),
        lambda: next(watched.own["n"]),
    ]
    for change in changes:
        watch = Watch(watched)
        assert not watch.changed()
        change()
        assert watch.changed() == "in itself"


def test_values_that_are_equal_compare_equal() -> None:
    first, second = ({"a": [1.0, (np.arange(3), "text")], "b": {2}} for _ in range(2))
    assert frozen(first) == frozen(second)
    assert frozen([0]) != frozen([0.0])  # a type tells branches apart


def test_what_cannot_be_looked_into_is_not_taken_for_unchanged() -> None:
    deep: list[Any] = []
    for _ in range(5000):
        deep = [deep]
    watched = Slots()
    watched.own = deep
    assert Watch(watched).changed() == "in itself"


def test_a_name_that_is_assigned_later_is_no_error() -> None:
    def controller() -> type[InMemory]:
        class Own(InMemory):
            def gain(self) -> float:
                return later

        made = Own
        Watch(made())  # before the name has a value
        later = 1.0
        return made

    assert controller()().gain() == 1.0  # type: ignore[attr-defined]


def test_one_object_serves_its_lanes_as_one() -> None:
    plain, held = InMemory(), InDataclass()
    for own in (plain, held):
        groups, _ = grouped([own, own])
        assert len(groups) == 1
    groups, _ = grouped([held, InDataclass()])
    assert len(groups) == 2
