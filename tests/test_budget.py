"""A diagnosis always ends with a verdict: out of its budget, or where a suspect's fit fails."""

from __future__ import annotations

import itertools
import json
import os
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from limited_jobs import broken, busy, spending, told_and_busy, used_by
from small_campaign import write_small
from test_components_points import AXIS, KIND, breakaway_log, breakaways
from test_diagnosis import loop, made
from test_parallel import is_alive

import sysid.diagnosis.actuator.diagnose as actuator_diagnose
import sysid.diagnosis.actuator.finder as actuator_finder
import sysid.diagnosis.actuator.loop as actuator_loop
from datasets.generator.campaign import Size, drawn_effects, make_campaign
from datasets.generator.files import write_campaign
from datasets.generator.rigs import reference_rig
from sysid.commands.app import main
from sysid.diagnosis.actuator.loop import Loop
from sysid.diagnosis.bench.diagnose import diagnose_component
from sysid.diagnosis.bench.fitting import fit_law
from sysid.diagnosis.bench.selection import select
from sysid.diagnosis.search_record import SearchStage
from sysid.diagnosis.wording import sentence
from sysid.errors import Failure, InputError, OutOfBudgetError, SimulationError
from sysid.parallel import LATE, VARIABLE, attempt_all, attempt_in_threads, limited, run_all, spend
from sysid.parameters import Bundle, read_bundle
from sysid.plant.effects import catalogue

BUNDLED = Path(__file__).resolve().parent.parent / "datasets" / "bundled" / "campaign.toml"
SIZE = Size(2, 0, 2, 0.04, (2, 1), (1, 1), (1, 1), slidings=8)
KINDS = ("friction-static", "friction-sliding", "valve-discrete", "motion-discrete")
# Tests to fit on of a small rig with undeclared seal friction, the rig, and its true base model.
sealed = partial(made, ("seal-friction", "sum", 1.0), scatter=0.02, size=SIZE)


# --- limits ------------------------------------------------------------------------------


@pytest.mark.parametrize("jobs", ["1", "2"])
@pytest.mark.parametrize("run", [attempt_all, attempt_in_threads])
def test_what_fails_or_is_late_does_not_take_the_others_along(
    run: Any, jobs: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, jobs)
    monkeypatch.delenv("SYSID_DEBUG", raising=False)
    work = [partial(spending, 3), partial(broken, 0), partial(spending, 1000)]
    with limited(evaluations=10):
        assert run(work) == [3, Failure("LinAlgError: Singular matrix"), LATE]
    assert run([partial(spending, 0)]) == [0]


@pytest.mark.parametrize("run", [attempt_all, attempt_in_threads])
def test_what_ends_does_not_depend_on_the_number_of_jobs(
    run: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of several jobs may make all the evaluations that are left as they begin."""
    found = set()
    for jobs in ("1", "2", "3"):
        monkeypatch.setenv(VARIABLE, jobs)
        with limited(evaluations=10) as limit:
            first = run([partial(spending, n) for n in (2, 4)])
            second = run([partial(spending, n) for n in (3, 9, 4, 5)])
            found.add((*first, *second, limit.made))
            assert run([partial(spending, 0)]) == [LATE]
    assert found == {(2, 4, 3, LATE, 4, LATE, 21)}


def test_what_is_not_cut_short_counts_as_well() -> None:
    with limited(evaluations=5) as limit:
        with limited():
            spending(20)
        with pytest.raises(OutOfBudgetError):
            spend()
    assert limit.made == 20


@pytest.mark.parametrize("jobs", ["1", "2"])
@pytest.mark.parametrize("run", [attempt_all, attempt_in_threads])
def test_processor_time_is_that_of_all_who_work(
    run: Any, jobs: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, jobs)
    with limited(seconds=0.6):
        assert run([partial(busy, 0.05)] * 2) == [0.05] * 2
        assert run([partial(busy, 60.0)] * 2) == [LATE] * 2
        assert run([partial(busy, 0.0)]) == [LATE]


def test_what_a_worker_did_before_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "2")
    run_all([partial(used_by, 1.0)] * 2)
    with limited(seconds=0.6):
        assert attempt_all([partial(busy, 0.05)] * 2) == [0.05] * 2
        spend()


def test_waiting_uses_no_processor_time() -> None:
    with limited(seconds=0.5):
        time.sleep(0.7)
        spend()


def test_a_worker_that_overruns_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "2")
    with limited(seconds=0.5):
        assert attempt_all([partial(told_and_busy, str(tmp_path))] * 2) == [LATE] * 2
    workers = [int(file.name) for file in tmp_path.iterdir()]
    assert workers and os.getpid() not in workers
    deadline = time.monotonic() + 10.0
    while any(map(is_alive, workers)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(map(is_alive, workers))


# --- the search --------------------------------------------------------------------------


def steps_of(found: Loop) -> list[tuple[Any, ...]]:
    return [(s.refit.effects, s.model, s.p_value, s.ambiguous, s.tried) for s in found.search.steps]


@pytest.fixture(scope="module")
def free_and_made() -> tuple[Loop, float]:
    """A search without a bound, in one process, and how many evaluations it made."""
    with pytest.MonkeyPatch.context() as patch, limited() as one:
        patch.setenv(VARIABLE, "1")
        return loop(*sealed()), one.made


def test_within_the_budget_the_result_is_the_same(
    free_and_made: tuple[Loop, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign = sealed()
    free, made_free = free_and_made
    monkeypatch.setenv(VARIABLE, "2")
    with limited(evaluations=1e6, seconds=6000.0) as two:
        bounded = loop(*campaign)
    assert made_free == two.made > 100
    assert bounded.record == free.record and bounded.record.is_complete
    assert steps_of(bounded) == steps_of(free)
    np.testing.assert_array_equal(bounded.search.last.rest, free.search.last.rest)
    # Where it is cut short does not depend on the number of jobs either.
    cut = []
    for jobs in ("1", "2"):
        monkeypatch.setenv(VARIABLE, jobs)
        with limited(evaluations=0.8 * made_free) as less:
            cut.append((loop(*campaign), less.made))
    (first, made_first), (second, made_second) = cut
    assert first.record == second.record and first.record.cut_short
    assert made_first == made_second < made_free
    assert steps_of(first) == steps_of(second)


@pytest.mark.parametrize("jobs", ["1", "2"])
def test_nothing_but_a_budget_looks_at_a_clock(
    jobs: str, free_and_made: tuple[Loop, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """However slow the machine: between any two looks at a clock an hour goes by."""
    campaign = sealed()
    expected, made_free = free_and_made
    monkeypatch.setenv(VARIABLE, jobs)
    hours = itertools.count()
    for name in ("monotonic", "perf_counter", "process_time", "time"):
        monkeypatch.setattr(time, name, lambda: 3600.0 * next(hours))
    with limited(evaluations=1e6) as slow:
        found = loop(*campaign)
    monkeypatch.undo()
    assert slow.made == made_free and found.record == expected.record
    assert steps_of(found) == steps_of(expected)


def test_a_suspect_that_cannot_be_fitted_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SYSID_DEBUG", raising=False)
    monkeypatch.setenv(VARIABLE, "2")
    fit_set = actuator_finder.fit_set

    broken: set[str] = set()

    def fails(base: Any, channels: Any, starts: Any, *others: Any) -> Any:
        names = {start.id for start in starts}
        if names == {"seal-friction"}:
            return fit_set(base, channels, starts, *others)
        broken.update(names)
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(actuator_finder, "fit_set", fails)
    found = loop(*sealed())
    assert [step.id for step in found.search.steps] == ["seal-friction"]
    assert found.record.fitted == ("seal-friction",) and broken - {"seal-friction"}
    missed = {m.subject for m in found.record.missed}
    assert broken - {"seal-friction"} <= missed <= set(found.record.screened)
    whys = {(m.reason, m.out_of_budget) for m in found.record.missed}
    assert whys == {("LinAlgError: Singular matrix", False)}


def test_out_of_budget_the_best_that_was_fitted_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "1")
    fit_set = actuator_finder.fit_set
    ended: list[str] = []

    def only_one(base: Any, channels: Any, starts: Any, *others: Any) -> Any:
        if ended:
            raise OutOfBudgetError
        ended.extend(start.id for start in starts)
        return fit_set(base, channels, starts, *others)

    monkeypatch.setattr(actuator_finder, "fit_set", only_one)
    found = loop(*sealed())
    assert [step.id for step in found.search.steps] == ended == ["seal-friction"]
    suspects = {SearchStage.SUSPECTS}
    late = {m.subject for m in found.record.missed if m.stage in suspects}
    assert late and late <= set(found.record.screened)
    assert all(m.out_of_budget for m in found.record.missed)


def test_a_search_that_fails_leaves_nothing_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    (file, kind, trial), *_ = sealed()[0]
    log = SimpleNamespace(path=Path(file), trials=(trial,))
    ended: list[str] = []
    monkeypatch.setattr(actuator_diagnose, "forget", lambda: ended.append("forgotten"))

    def fails(*_: Any, **__: Any) -> Any:
        raise InputError("a log that cannot be used")

    monkeypatch.setattr(actuator_diagnose, "close_loop", fails)
    _, rig, model = sealed()
    with pytest.raises(InputError):
        actuator_diagnose.diagnose([("fit", kind, log)], rig, model, {})  # type: ignore[list-item]
    assert ended == ["forgotten"]


# --- the command -------------------------------------------------------------------------


def diagnosed(campaign: Path, folder: Path, budget: str, capsys: Any) -> dict[str, Any]:
    """What the command prints, after its files have been looked at."""
    bundle, extended = folder / "bundle.json", folder / f"extended-{budget}.json"
    if not bundle.exists():
        assert main(["fit", str(campaign), "-o", str(bundle)]) == 0
    capsys.readouterr()
    outputs = ["-o", str(extended), "--report", str(folder / f"report-{budget}.html")]
    words = ["diagnose", str(campaign), "--bundle", str(bundle), "--budget", budget, *outputs]
    assert main([*words, "--json"]) == 0
    printed: dict[str, Any] = json.loads(capsys.readouterr().out)
    search = printed["search"]
    late = [m for m in search["missed"] if m["out_of_time"]]
    keys = ("stage", "round", "subject")
    assert [[m[k] for k in keys] for m in late] == [list(m.values()) for m in printed["not_done"]]
    assert (printed["verdict"] == "incomplete") == bool(late)
    assert not any(m["round"] == 1 for m in late)
    made = read_bundle(extended).provenance.options.get("diagnosis", {})
    assert made.get("verdict") == (printed["verdict"] if made else None)
    assert made.get("search") == (None if search["complete"] else search)
    report = (folder / f"report-{budget}.html").read_text()
    assert ("Incomplete: the budget ended before the search did" in report) == bool(late)
    assert not list(folder.glob("*.tmp*"))
    return printed


@pytest.fixture
def two_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    """They share a budget of processor time: how far it leads depends on their number."""
    monkeypatch.setenv(VARIABLE, "2")


@pytest.mark.usefixtures("two_processes")
def test_the_bundled_campaign_is_not_called_unexplained(tmp_path: Path, capsys: Any) -> None:
    printed = diagnosed(write_small(tmp_path / "given"), tmp_path, "0.1", capsys)
    assert printed["verdict"] == "incomplete" and printed["because"] is None
    assert [effect["id"] for effect in printed["effects"]] == ["seal-friction"]
    assert {"stage": "screening", "round": 2, "effect": None} in printed["not_done"]
    assert {m["reason"] for m in printed["search"]["missed"]} == {"out of budget"}
    assert any("--budget" in line for line in printed["notices"])
    said = sentence(printed)
    assert "effects so far: seal-friction" in said and "Not done: screening, round 2" in said


@pytest.fixture(scope="module")
def lagging(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lagging")
    effects = drawn_effects(7, [("pressure-lag", "first-order", 1.0)])
    size = Size(1, 0, 1, 0.04, (1, 1), (1, 1), (1, 1), slidings=6)
    campaign = make_campaign(7, size=size, rig=reference_rig(), kinds=KINDS, effects=effects)
    write_campaign(folder, campaign, "made by a test")
    return folder


@pytest.mark.parametrize("budget", ["0.1", pytest.param("5", marks=pytest.mark.slow)])
def test_a_rig_with_a_lag_gets_a_verdict(budget: str, lagging: Path, capsys: Any) -> None:
    printed = diagnosed(lagging / "campaign.toml", lagging, budget, capsys)
    assert printed["search"]["screened"]


@pytest.mark.parametrize("budget", ["0", "-1", "soon", "nan"])
def test_a_bad_budget_is_refused(budget: str, tmp_path: Path, capsys: Any) -> None:
    words = ["diagnose", str(BUNDLED), "--bundle", str(tmp_path / "b.json"), "--budget", budget]
    assert main(words) == 2
    assert "--budget" in capsys.readouterr().err


# --- a part tested alone -----------------------------------------------------------------


def test_a_part_s_first_round_ends_without_a_budget() -> None:
    component = breakaways(sine=0.3)
    free = select(component, catalogue())
    assert free.additions and free.record.is_complete
    with limited(evaluations=0):
        late = select(component, catalogue())
    (first,) = late.additions
    assert first.effect == free.additions[0].effect and first.p_value == free.additions[0].p_value
    assert late.record.cut_short and {m.reason for m in late.record.missed} == {"out of budget"}
    assert not any(m.round == 1 and m.decides for m in late.record.missed)
    np.testing.assert_array_equal(late.folds, free.folds)


@pytest.mark.parametrize("asymmetry", [0.0, 0.1])
def test_a_part_that_is_cut_short_is_incomplete(asymmetry: float) -> None:
    component = breakaways(sine=0.3, asymmetry=asymmetry)
    bundle = Bundle.new(AXIS, fit_law(component, (), range(len(component.tests))).part(), [])
    with limited(evaluations=0):
        late = diagnose_component(
            KIND, [breakaway_log(sine=0.3, asymmetry=asymmetry)], [], AXIS, bundle, catalogue()
        )
    printed = late.to_json()
    assert printed["verdict"] == "incomplete" and printed["because"] is None
    assert printed["not_done"] and printed["effects"]
    assert sentence(printed).startswith("Incomplete: the budget ended before the search did;")


def test_a_model_that_cannot_be_simulated_gets_a_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    """No effect is named without twins, and nothing is called adequate."""
    monkeypatch.delenv("SYSID_DEBUG", raising=False)

    def fails(*_: Any) -> Any:
        raise SimulationError("simulation: the model switches without end")

    monkeypatch.setattr(actuator_loop, "simulate_twins", fails)
    found = loop(*sealed())
    assert found.search.steps == () and not found.record.is_decided
    assert {m.stage for m in found.record.missed} == {
        SearchStage.TWIN,
        SearchStage.TWINS,
    }
