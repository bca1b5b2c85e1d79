"""The loop that adds and removes effects of a part, on its own and on one that is made up."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from test_components_repeats import KINDS, Curved, line

from sysid.diagnosis.bench.selection import select
from sysid.diagnosis.search import MOST_EFFECTS, Rounds, Step, Tried, mark_removed, run
from sysid.diagnosis.search_record import Recorder, SearchStage
from sysid.errors import OutOfBudgetError
from sysid.plant.base import Array
from sysid.plant.effects.entry import CatalogueEffect
from sysid.plant.ports import Point
from sysid.types import no_progress


def named(id: str) -> CatalogueEffect:
    return type(id, (Curved,), {"id": id})()  # type: ignore[no-any-return]


@dataclass
class Scripted(Rounds[Step]):
    """Proposes effects in turn; `without` maps one to what the effects added make superfluous."""

    script: list[str]
    without: dict[str, str] = field(default_factory=dict)
    steps: list[Step] = field(default_factory=list)
    tried: tuple[Tried, ...] = ()
    barred: list[frozenset[str]] = field(default_factory=list)
    stage = SearchStage.EFFECTS

    def proposal(self, number: int, barred: frozenset[str]) -> Step | None:
        self.barred.append(barred)
        self.tried = tuple(Tried(id, 1.0, 0.5) for id in self.script if id not in barred)
        found = next((t.id for t in self.tried), None)
        return None if found is None else Step(named(found), 1e-9, 0.9, (), self.tried)

    def add(self, step: Step) -> None:
        self.steps.append(step)

    def superfluous(self) -> Step | None:
        gone = self.without.get(self.steps[-1].id)
        if gone == "late":
            raise OutOfBudgetError
        return next((s for s in self.steps if s.id == gone), None)

    def remove(self, step: Step) -> None:
        self.steps.remove(step)


def test_effects_are_added_until_none_is_proposed() -> None:
    rounds = Scripted(["one", "two"])
    history = run(rounds, Recorder(), no_progress)
    assert [s.id for s in rounds.steps] == ["one", "two"]
    assert [r.added.id if r.added else None for r in history] == ["one", "two", None]
    assert [t.id for t in history[0].tried] == ["one", "two"] and history[2].tried == ()


def test_what_a_later_effect_makes_superfluous_is_removed_and_not_tried_again() -> None:
    rounds = Scripted(["one", "two", "three"], {"two": "one"})
    history = run(rounds, Recorder(), no_progress)
    assert [s.id for s in rounds.steps] == ["two", "three"]
    assert [r.removed for r in history] == [(), ("one",), (), ()]
    assert all("one" in barred for barred in rounds.barred[1:])


def test_a_removal_that_runs_out_of_budget_leaves_the_effects() -> None:
    rounds, recorder = Scripted(["one", "two"], {"two": "late"}), Recorder()
    run(rounds, recorder, no_progress)
    assert [s.id for s in rounds.steps] == ["one", "two"]
    (missed,) = recorder.closed().missed
    assert (missed.stage, missed.round) == (SearchStage.REMOVAL, 2)
    assert missed.out_of_budget and not missed.decides


def test_a_round_that_no_budget_is_left_for_tried_nothing() -> None:
    class Late(Scripted):
        def add(self, step: Step) -> None:
            super().add(step)
            self.without["late"] = ""

        def proposal(self, number: int, barred: frozenset[str]) -> Step | None:
            if "late" in self.without:
                raise OutOfBudgetError
            return super().proposal(number, barred)

    recorder = Recorder()
    history = run(Late(["one"]), recorder, no_progress)
    assert [r.tried for r in history][1:] == [()]
    (missed,) = recorder.closed().missed
    assert missed.out_of_budget and missed.decides and missed.round == 2


def test_of_a_removed_effect_it_is_said() -> None:
    shown: list[dict[str, Any]] = [
        {"added": "one", "removed": [], "suspects": [{"id": "one", "fate": "added"}]},
        {"added": "two", "removed": ["one"], "suspects": [{"id": "two", "fate": "added"}]},
    ]
    mark_removed(shown)
    assert [s["fate"] for one in shown for s in one["suspects"]] == [
        "added, and removed in round 2 as superfluous",
        "added",
    ]


@dataclass(frozen=True)
class Bent(Curved):
    """+ d exp(1.5 x): a line and a parabola in one, but for more."""

    curve_n: Array = 0.0

    id = "bent"
    title = "a bend"

    def friction_effort(self, effort: Array, point: Point) -> Array:
        return effort + self.curve_n * np.exp(1.5 * np.asarray(point))


@pytest.mark.parametrize("bent", [0.0, 2.0])
def test_an_imitation_goes_when_what_it_imitates_is_found(bent: float) -> None:
    part = line(*[(3.0, 3.0)] * 6)
    y = tuple(y + bent * np.exp(1.5 * x) for x, y in zip(part.x, part.y, strict=True))
    found = select(type(part)(part.x, y), {"bent": Bent, **KINDS})
    assert found.rounds[0].added is not None and found.rounds[0].added.id == "bent"
    kept = {addition.id for addition in found.additions}
    assert kept == ({"bent", "curved", "sloped"} if bent else {"curved", "sloped"})
    removed = [name for one in found.rounds for name in one.removed]
    assert removed == ([] if bent else ["bent"])
    assert len(found.additions) <= MOST_EFFECTS
    for place, addition in enumerate(found.additions):
        assert addition.fitted.law.effects[place].id == addition.id
        assert len(addition.fitted.law.effects) == place + 1
