"""A diagnosis always ends with a verdict: out of time, or where a suspect's fit fails."""

from __future__ import annotations

import json
import os
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_components_points import AXIS, KIND, breakaway_log, breakaways
from test_diagnosis import loop, made
from test_parallel import is_alive, told_and_slept

import sysid.diagnosis.actuator.diagnose as actuator_diagnose
import sysid.diagnosis.actuator.loop as actuator_loop
import sysid.diagnosis.actuator.search as actuator_search
from datasets.generator.campaign import Size, drawn_effects, make_campaign
from datasets.generator.files import write_campaign
from datasets.generator.rigs import reference_rig
from sysid.bundle import Bundle, read_bundle
from sysid.commands.app import main
from sysid.diagnosis.actuator.loop import Loop
from sysid.diagnosis.bench.diagnose import diagnose_component
from sysid.diagnosis.bench.fitting import fit_law
from sysid.diagnosis.bench.selection import select
from sysid.diagnosis.looked import SearchStage
from sysid.diagnosis.wording import sentence
from sysid.errors import InputError, SimulationError
from sysid.model.effects import catalogue
from sysid.parallel import (
    VARIABLE,
    Failure,
    OutOfTimeError,
    attempt_all,
    attempt_in_threads,
    check_time,
    time_limit,
)

BUNDLED = Path(__file__).resolve().parent.parent / "datasets" / "bundled" / "campaign.toml"
SIZE = Size(2, 0, 2, 0.04, (2, 1), (1, 1), (1, 1), slidings=8)
KINDS = (
    "friction-static", "friction-sliding", "valve-discrete", "motion-motor", "motion-discrete",
)  # fmt: skip
SEAL = ("seal-friction", "sum", 1.0)


# --- time limits -------------------------------------------------------------------------


def watchful(seconds: float) -> float:
    """A job that looks at the time."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        check_time()
        time.sleep(0.01)
    return seconds


def broken(_: int) -> float:
    raise np.linalg.LinAlgError("Singular matrix")


@pytest.mark.parametrize("jobs", ["1", "2"])
@pytest.mark.parametrize("run", [attempt_all, attempt_in_threads])
def test_what_fails_or_is_late_does_not_take_the_others_along(
    run: Any, jobs: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, jobs)
    monkeypatch.delenv("SYSID_DEBUG", raising=False)
    run([partial(watchful, 0.0)] * 2)  # workers take their time to start
    work = [partial(watchful, 0.01), partial(broken, 0), partial(watchful, 60.0)]
    with time_limit(2.0):
        first, second, third = run(work)
    assert first == 0.01
    assert second == Failure("LinAlgError: Singular matrix")
    assert isinstance(third, Failure) and third.out_of_time
    assert run([partial(watchful, 0.0)]) == [0.0]


def test_a_worker_that_overruns_is_killed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "2")
    begin = time.monotonic()
    with time_limit(4.0):
        found = attempt_all([partial(told_and_slept, str(tmp_path))] * 2)
    assert all(isinstance(one, Failure) and one.out_of_time for one in found)
    assert time.monotonic() - begin < 30.0
    workers = [int(file.name) for file in tmp_path.iterdir()]
    assert workers and os.getpid() not in workers
    deadline = time.monotonic() + 10.0
    while any(map(is_alive, workers)) and time.monotonic() < deadline:
        time.sleep(0.1)
    assert not any(map(is_alive, workers))


# --- the search --------------------------------------------------------------------------


def steps_of(found: Loop) -> list[tuple[Any, ...]]:
    return [(s.refit.effects, s.model, s.p_value, s.ambiguous, s.tried) for s in found.search.steps]


def test_within_the_budget_the_result_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    campaign = made(SEAL, scatter=0.02)
    monkeypatch.setenv(VARIABLE, "2")
    with time_limit(600.0):
        limited = loop(*campaign)
    monkeypatch.setenv(VARIABLE, "1")
    free = loop(*campaign)
    assert limited.looked == free.looked and limited.looked.is_complete
    assert steps_of(limited) == steps_of(free)
    np.testing.assert_array_equal(limited.search.last.rest, free.search.last.rest)


def test_a_suspect_that_cannot_be_fitted_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SYSID_DEBUG", raising=False)
    monkeypatch.setenv(VARIABLE, "2")
    refit = actuator_search.refit

    broken: set[str] = set()

    def fails(base: Any, starts: Any, held: Any = ()) -> Any:
        if starts[-1].id == "seal-friction":
            return refit(base, starts, held)
        broken.add(starts[-1].id)
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(actuator_search, "refit", fails)
    found = loop(*made(SEAL, scatter=0.02))
    assert [step.refit.id for step in found.search.steps] == ["seal-friction"]
    assert found.looked.fitted == ("seal-friction",) and broken
    assert {m.subject for m in found.looked.missed} == broken <= set(found.looked.screened)
    whys = {(m.reason, m.out_of_time) for m in found.looked.missed}
    assert whys == {("LinAlgError: Singular matrix", False)}
    # What could not be fitted may be the cause as well.
    assert broken <= set(found.search.steps[0].ambiguous)


def test_out_of_time_the_best_that_was_fitted_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """And what was not fitted may be the cause as well."""
    monkeypatch.setenv(VARIABLE, "1")
    refit = actuator_search.refit
    ended: list[str] = []

    def only_one(base: Any, starts: Any, held: Any = ()) -> Any:
        if ended:
            raise OutOfTimeError
        ended.append(starts[-1].id)
        return refit(base, starts, held)

    monkeypatch.setattr(actuator_search, "refit", only_one)
    found = loop(*made(SEAL, scatter=0.02))
    (first, *_) = found.search.steps
    assert first.refit.id == ended[0]
    suspects = (SearchStage.SUSPECTS, 1)
    late = {m.subject for m in found.looked.missed if (m.stage, m.round) == suspects}
    assert late and late <= set(first.ambiguous)
    assert all(m.out_of_time for m in found.looked.missed)


def test_a_search_that_fails_leaves_nothing_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    (file, kind, trial), *_ = made(SEAL)[0]
    log = SimpleNamespace(path=Path(file), trials=(trial,))
    ended: list[str] = []
    monkeypatch.setattr(actuator_diagnose, "forget", lambda: ended.append("forgotten"))

    def fails(*_: Any, **__: Any) -> Any:
        raise InputError("a log that cannot be used")

    monkeypatch.setattr(actuator_diagnose, "close_loop", fails)
    _, rig, model = made(SEAL)
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
    assert printed["verdict"] in ("adequate", "effects-found", "unexplained")
    made = read_bundle(extended).provenance.options.get("diagnosis", {})
    assert made.get("search") == (None if search["complete"] else search)
    report = (folder / f"report-{budget}.html").read_text()
    assert ("The search is incomplete" in report) == (not search["complete"])
    assert not list(folder.glob("*.tmp*"))
    return printed


def test_the_bundled_campaign_gets_a_verdict_at_once(tmp_path: Path, capsys: Any) -> None:
    printed = diagnosed(BUNDLED, tmp_path, "0.1", capsys)
    assert not printed["search"]["complete"] and printed["search"]["fitted"] == []
    # Nothing was looked at: that is no adequate model.
    assert printed["verdict"] == "unexplained" and printed["unexplained"]
    assert {m["reason"] for m in printed["search"]["missed"]} == {"out of time"}
    assert any("--budget" in line for line in printed["notices"])
    assert "The search is incomplete" in sentence(printed)


@pytest.fixture(scope="module")
def lagging(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("lagging")
    effects = drawn_effects(7, [("pressure-lag", "first-order", 1.0)])
    campaign = make_campaign(7, size=SIZE, rig=reference_rig(), kinds=KINDS, effects=effects)
    write_campaign(folder, campaign, "made by a test")
    return folder


@pytest.mark.parametrize("budget", ["0.1", "5"])
def test_a_rig_with_a_lag_gets_a_verdict(budget: str, lagging: Path, capsys: Any) -> None:
    begin = time.monotonic()
    printed = diagnosed(lagging / "campaign.toml", lagging, budget, capsys)
    assert time.monotonic() - begin < 120.0
    if not printed["effects"] and not printed["search"]["complete"]:
        assert printed["verdict"] == "unexplained"


@pytest.mark.parametrize("budget", ["0", "-1", "soon", "nan"])
def test_a_bad_budget_is_refused(budget: str, tmp_path: Path, capsys: Any) -> None:
    words = ["diagnose", str(BUNDLED), "--bundle", str(tmp_path / "b.json"), "--budget", budget]
    assert main(words) == 2
    assert "--budget" in capsys.readouterr().err


# --- a part tested alone -----------------------------------------------------------------


def test_a_part_gets_a_verdict_out_of_time() -> None:
    component = breakaways(sine=0.3)
    free = select(component, catalogue())
    assert free.additions and free.looked.is_complete
    with time_limit(1e-9):
        late = select(component, catalogue())
    assert not late.additions and not late.looked.is_decided
    assert {m.reason for m in late.looked.missed} == {"out of time"}
    np.testing.assert_array_equal(late.folds, free.folds)


@pytest.mark.parametrize(("offset", "because"), [(0.0, "unfinished search"), (0.1, "structure")])
def test_what_an_unfinished_search_leaves_is_structure_only_where_it_is(
    offset: float, because: str
) -> None:
    component = breakaways(asymmetry=offset)
    bundle = Bundle.new(AXIS, fit_law(component, (), range(len(component.tests))).part(), [])
    with time_limit(1e-9):
        late = diagnose_component(
            KIND, [breakaway_log(asymmetry=offset)], [], AXIS, bundle, catalogue()
        )
    printed = late.to_json()
    assert printed["verdict"] == "unexplained" and printed["because"] == because
    assert ("structure remains" in sentence(printed)) == (because == "structure")
    assert "The search is incomplete: not done: fit of effects, round 1." in sentence(printed)


def test_a_model_that_cannot_be_simulated_gets_a_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    """No effect is named without twins, and nothing is called adequate."""
    monkeypatch.delenv("SYSID_DEBUG", raising=False)

    def fails(*_: Any) -> Any:
        raise SimulationError("simulation: the model switches without end")

    monkeypatch.setattr(actuator_loop, "simulate_twins", fails)
    found = loop(*made(SEAL, scatter=0.02))
    assert found.search.steps == () and not found.looked.is_decided
    assert {m.stage for m in found.looked.missed} == {
        SearchStage.TWIN,
        SearchStage.TWINS,
    }
