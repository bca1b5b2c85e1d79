"""The loop that adds and removes effects, on its own and on a part that is made up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_components_repeats import KINDS, Curved, line

from sysid.diagnosis.actuator.equation_error import CHANNELS
from sysid.diagnosis.actuator.refit import Refit
from sysid.diagnosis.actuator.search import _exchanged, _TwinRounds
from sysid.diagnosis.bench.selection import select
from sysid.diagnosis.looked import QUICK, Book, SearchStage
from sysid.diagnosis.search import MOST_EFFECTS, Rounds, Step, Tried, mark_removed, run
from sysid.errors import OutOfBudgetError
from sysid.parallel import LATE, limited
from sysid.plant.base import Array
from sysid.plant.effects import catalogue
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
    history = run(rounds, Book(), no_progress)
    assert [s.id for s in rounds.steps] == ["one", "two"]
    assert [r.added.id if r.added else None for r in history] == ["one", "two", None]
    assert [t.id for t in history[0].tried] == ["one", "two"] and history[2].tried == ()


def test_what_a_later_effect_makes_superfluous_is_removed_and_not_tried_again() -> None:
    rounds = Scripted(["one", "two", "three"], {"two": "one"})
    history = run(rounds, Book(), no_progress)
    assert [s.id for s in rounds.steps] == ["two", "three"]
    assert [r.removed for r in history] == [(), ("one",), (), ()]
    assert all("one" in barred for barred in rounds.barred[1:])


def test_a_removal_that_runs_out_of_budget_leaves_the_effects() -> None:
    rounds, book = Scripted(["one", "two"], {"two": "late"}), Book()
    run(rounds, book, no_progress)
    assert [s.id for s in rounds.steps] == ["one", "two"]
    (missed,) = book.closed().missed
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

    book = Book()
    history = run(Late(["one"]), book, no_progress)
    assert [r.tried for r in history][1:] == [()]
    (missed,) = book.closed().missed
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


@dataclass
class Exchangeable(Scripted):
    """A search in which a rival of the first effect, with what follows it, may leave far less."""

    book: Book = field(default_factory=Book)
    rival: str | None = None
    after: tuple[str, ...] = ()
    less: bool = True

    def may_give_way(self) -> bool:
        return self.rival is not None

    def with_rival_first(self, book: Book) -> Exchangeable | None:
        if self.rival == "late":
            raise OutOfBudgetError
        if self.rival == "doubtful":
            return None
        assert self.rival is not None
        other = Exchangeable(list(self.after), self.without, book=book)
        other.add(Step(named(self.rival), 1e-9, 0.9, (), ()))
        return other

    def leaves_far_less_than(self, other: Exchangeable) -> bool:
        return other.less


def exchanged(rounds: Exchangeable) -> tuple[Exchangeable, list[str | None]]:
    history = run(rounds, rounds.book, no_progress)
    found, rows = _exchanged(rounds, history, no_progress)  # type: ignore[arg-type]
    return found, [r.added.id if r.added else None for r in rows]  # type: ignore[return-value]


def test_a_rival_takes_the_first_effects_place_where_it_leaves_far_less() -> None:
    start = Exchangeable(["imitation"], rival="one", after=("imitation", "two"))
    found, added = exchanged(start)
    assert added == ["one", "two", None]  # the imitation is not tried again
    assert [s.id for s in found.steps] == ["one", "two"]
    (note,) = start.book.notes
    assert note.startswith("imitation alone explains more than one,") and "one and two" in note


def test_the_first_effect_stays_where_a_rival_leaves_as_much() -> None:
    start = Exchangeable(["first"], rival="one", after=("two",), less=False)
    found, added = exchanged(start)
    assert found is start and added == ["first", None]
    assert start.book.notes == [] and start.book.missed == []


def test_of_a_rival_that_ran_out_of_budget_it_is_said() -> None:
    start = Exchangeable(["first"], {"two": "late"}, rival="one", after=("two",), less=False)
    assert exchanged(start)[0] is start
    (missed,) = start.book.missed
    assert missed.stage == SearchStage.EXCHANGE and missed.out_of_budget and not missed.decides


@pytest.mark.parametrize("rival", [None, "doubtful"])
def test_the_first_effect_stays_where_there_is_no_rival(rival: str | None) -> None:
    start = Exchangeable(["first"], rival=rival)
    with limited(evaluations=0):
        history = run(start, start.book, no_progress)
        before = list(start.book.missed)
        assert _exchanged(start, history, no_progress)[0] is start  # type: ignore[arg-type,comparison-overlap]
    assert start.book.notes == []
    assert (start.book.missed == before) == (rival is None)  # what need not be done is not missed


def test_an_exchange_that_runs_out_of_budget_leaves_the_effects_and_says_so() -> None:
    start = Exchangeable(["first"], rival="late")
    assert exchanged(start)[0] is start
    (missed,) = start.book.closed().missed
    assert missed.stage == SearchStage.EXCHANGE and missed.out_of_budget and not missed.decides
    assert missed.round == 0


def test_what_a_search_aside_missed_counts_only_where_it_is_taken() -> None:
    book = Book()
    book.enter(SearchStage.SUSPECTS, 1)
    book.miss(QUICK, "one")
    aside = book.aside()
    aside.enter(SearchStage.SUSPECTS, 2)
    aside.miss(LATE, "two")
    aside.note("noted")
    assert [m.subject for m in book.missed] == ["one"] and book.notes == []
    book.take(aside)
    assert [m.subject for m in book.missed] == ["one", "two"] and book.notes == ["noted"]


def refitted(id: str, **gains: float) -> Refit:
    """An effect that explains so much in each channel, of one row each."""
    before = np.sqrt([gains.get(channel, 0.0) for channel in CHANNELS])
    return Refit((catalogue()[id].neutral(),), before, np.zeros(len(CHANNELS)), None)  # type: ignore[arg-type]


class Judging(_TwinRounds):
    """A round beside a tube's lag, which acts on the pressures' rates alone; adds what is given."""

    def __init__(self, added: Sequence[tuple[str, bool]] = ()) -> None:
        self.added, self.asked = added, list[tuple[str, tuple[str, ...], bool]]()
        frame = SimpleNamespace(rows=lambda c: slice(CHANNELS.index(c), CHANNELS.index(c) + 1))
        self.base: Any = SimpleNamespace(frame=frame)
        self.steps = [SimpleNamespace(effect=catalogue()["tube-lag"].neutral())]  # type: ignore[list-item]
        self.book, self.progress = Book(), no_progress

    def _clear(self, fitted: Any, _: Any) -> list[Refit]:
        return list(fitted)

    def _simulating_best(self, winner: Refit, _: Any) -> Refit:
        return winner

    def _on_finer_grid(self, winner: Refit) -> Refit:
        return winner

    def _step(self, winner: Refit, _: Any, __: Any, channels: Any, *, again: bool) -> Any:
        self.asked.append((winner.id, tuple(channels), again))
        return winner.id if (winner.id, again) in self.added else None

    def best(self, *suspects: Refit, rates: float = 0.0) -> Any:
        excess = {"effort": 1000.0, "rate_a": rates, "rate_b": rates, "breakaway": 0.0}
        return self._best(excess, suspects, 2)


LINK = refitted("link-flexibility", effort=5000.0)
STRIBECK = refitted("stribeck-friction", effort=1200.0)
EVERYWHERE = ("effort", "rate_a", "rate_b")


@pytest.mark.parametrize(
    ("gain", "lower", "named"),
    [
        (1200.0, 0.05, "torque-offset"),  # one signature: simulation alone tells them apart
        (1200.0, 0.005, "stribeck-friction"),
        (1150.0, 0.05, "stribeck-friction"),
        (1150.0, 0.3, "torque-offset"),
    ],
)
def test_of_effects_that_explain_as_much_the_one_that_simulates_better(
    gain: float, lower: float, named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "sysid.diagnosis.actuator.search.with_base_refitted", lambda _, model: model
    )

    class Sum:
        def __add__(self, effect: CatalogueEffect) -> Any:
            return effect

    rounds = Judging()
    rounds.first, rounds.base.model = rounds.base, Sum()
    errors = {"stribeck-friction": 3.0, "torque-offset": 3.0 - lower}
    rounds.simulation_error = lambda effect: errors[effect.id]  # type: ignore[attr-defined]
    rival = refitted("torque-offset", effort=gain)
    assert _TwinRounds._simulating_best(rounds, STRIBECK, [STRIBECK, rival]).id == named


def test_what_may_act_where_an_effect_does_is_asked_again_where_none_does() -> None:
    rounds = Judging([("link-flexibility", True)])
    assert rounds.best(LINK, STRIBECK) == "link-flexibility"
    assert rounds.asked == [
        ("link-flexibility", EVERYWHERE, False),
        ("link-flexibility", ("effort",), True),
    ]


def test_after_one_that_is_refused_the_next_of_its_balance_has_to_simulate_better() -> None:
    drag = refitted("quadratic-drag", effort=1100.0)
    rounds = Judging([("stribeck-friction", True)])
    assert rounds.best(LINK, STRIBECK, drag) == "stribeck-friction"
    assert rounds.asked[2:] == [("stribeck-friction", ("effort",), True)]
    rounds = Judging([("quadratic-drag", True)])
    assert rounds.best(LINK, STRIBECK, drag) is None  # a third imitates what was refused
    assert [id for id, *_ in rounds.asked] == ["link-flexibility"] * 2 + ["stribeck-friction"]


@pytest.mark.parametrize("gain", [700.0, 2100.0])
def test_the_next_of_its_balance_explains_nearly_all_that_is_there(gain: float) -> None:
    rounds = Judging([("stribeck-friction", True)])
    assert rounds.best(LINK, refitted("stribeck-friction", effort=gain)) is None


def test_of_another_balance_the_next_is_judged_as_if_nothing_was_refused() -> None:
    rounds = Judging([("wall-heat-transfer", False)])
    heat = refitted("wall-heat-transfer", rate_a=300.0, rate_b=300.0)
    assert rounds.best(LINK, heat, rates=400.0) == "wall-heat-transfer"


@pytest.mark.parametrize(
    ("tests", "gain", "simulates", "shows"),
    [
        (4, 5000.0, False, True),  # nearly all that is left
        (4, 2000.0, True, True),
        (4, 2000.0, False, False),
        (3, 5000.0, True, False),  # as many may agree by chance
    ],
)
def test_a_threshold_that_few_tests_show_explains_all_that_is_left_or_simulates_better(
    tests: int, gain: float, simulates: bool, shows: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    rounds = Judging()
    rows = {channel: slice(0, 0) for channel in CHANNELS} | {"effort": slice(0, tests)}
    rounds.base = SimpleNamespace(
        frame=SimpleNamespace(rows=lambda c: rows[c], tests=np.arange(tests))
    )
    fit: Any = SimpleNamespace(diagnosis=SimpleNamespace(at_bound=()))
    each = np.full(tests, np.sqrt(gain / tests))
    found = Refit((catalogue()["backlash"].typical(),), each, np.zeros(tests), fit)
    monkeypatch.setattr(rounds, "_simulates_better", lambda _: simulates)
    excess = {"effort": 5200.0, "rate_a": 0.0, "rate_b": 0.0, "breakaway": 0.0}
    assert rounds._shows_in_few(found, excess) is shows
