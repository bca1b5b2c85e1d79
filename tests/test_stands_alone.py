"""What was not asked for does not end what was: parts, comparisons, stages, sections, logs."""

from __future__ import annotations

import dataclasses
import json
import math
import shutil
from collections.abc import Callable
from html import unescape
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
from golden_folder import BUNDLED, golden_bundle
from test_valve_pwm import make_rig, make_trials

from sysid import valve_discrete, valve_pwm
from sysid.blocks.sections import Plot, Section
from sysid.checks.consistency import campaign as consistency
from sysid.diagnosis.bench.component import Component
from sysid.diagnosis.bench.diagnose import _held_out
from sysid.errors import (
    Failure,
    InputError,
    NotIdentifiedError,
    OutOfBudgetError,
    SimulationError,
    error_of,
    on_its_own,
)
from sysid.estimation.linear import Estimate
from sysid.identification.friction import shown as friction
from sysid.io.campaign import Campaign, read_campaign
from sysid.io.logs import Log
from sysid.parameters import Bundle, read_bundle
from sysid.parameters.assembled_model import assumed_parameters
from sysid.pipeline import run as stages
from sysid.pipeline.export import ExportOptions
from sysid.pipeline.fit import fit_campaign
from sysid.pipeline.pages import report as page
from sysid.pipeline.pages.report import render_report
from sysid.pipeline.report import PageOptions, write_page
from sysid.pipeline.run import RunReport, run_campaign
from sysid.surfaces.comparison import SurfaceComparison
from sysid.validation import open_loop
from sysid.validation.open_loop import validate
from sysid.valve_pwm import fit_valve_pwm


@pytest.fixture(autouse=True)
def as_for_a_user(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SYSID_DEBUG", raising=False)
    monkeypatch.setenv("SYSID_JOBS", "1")


def failing(error: Exception) -> Callable[..., NoReturn]:
    def fails(*_: Any, **__: Any) -> NoReturn:
        raise error

    return fails


def only(campaign: Campaign, *kinds: str) -> Campaign:
    """The campaign with its logs of these kinds alone."""
    logs = tuple(entry for entry in campaign.logs if entry.kind in kinds)
    return dataclasses.replace(campaign, logs=logs)


@pytest.fixture(scope="module")
def bundled() -> Campaign:
    return read_campaign(BUNDLED / "campaign.toml")


# --- the mechanism ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error", "reason", "status"),
    [
        (InputError("log.csv: no rows; give some"), "log.csv: no rows; give some", 2),
        (NotIdentifiedError("no flow"), "no flow", 3),
        (np.linalg.LinAlgError("Singular matrix"), "cannot be solved: Singular matrix", 3),
        (FloatingPointError("overflow"), "cannot be solved: overflow", 3),
        (KeyError("effort"), "KeyError: 'effort' (a fault in sysid itself", 1),
    ],
)
def test_a_part_that_fails_is_a_reason(error: Exception, reason: str, status: int) -> None:
    found = on_its_own(failing(error))
    assert isinstance(found, Failure)
    assert reason in found.reason and found.status == status


def test_faults_are_raised_for_those_who_look_for_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SYSID_DEBUG", "1")
    with pytest.raises(KeyError):
        on_its_own(failing(KeyError("effort")))
    assert isinstance(on_its_own(failing(NotIdentifiedError("no flow"))), Failure)


@pytest.mark.parametrize("error", [OutOfBudgetError(), OSError(28, "No space left")])
def test_what_is_not_the_parts_own_passes(error: Exception) -> None:
    with pytest.raises(type(error)):
        on_its_own(failing(error))


@pytest.mark.parametrize(
    ("statuses", "kind"),
    [((2, 2), InputError), ((2, 3), NotIdentifiedError), ((), NotIdentifiedError),
     ((3, 1), RuntimeError)],
)  # fmt: skip
def test_a_whole_without_a_part_fails_as_its_parts(
    statuses: tuple[int, ...], kind: type[Exception]
) -> None:
    errors = {2: InputError("a; b"), 3: NotIdentifiedError("c"), 1: None}
    failures = [Failure(f"why {n}", error=errors[n]) for n in statuses]
    assert type(error_of(failures, "why")) is kind
    for failure in failures:
        assert error_of(failures, failure.reason) is failure.error or failure.error is None


# --- fits ---------------------------------------------------------------------------------


def few_duties() -> list[Any]:
    """Filling tests at four duties, two of them inside: a dead zone leaves no more."""
    trials = make_trials("a", directions=("fill",))
    return [t for t in trials if float(t["duty_a"].max()) in (0.22, 0.42, 0.62, 0.82)]


def test_too_few_tests_to_compare_surfaces_do_not_end_their_fit() -> None:
    found = fit_valve_pwm(few_duties(), make_rig(), surface="both")
    fit = found.fits["a", "fill"]
    assert fit.bipolynomial is not None and fit.comparison is None
    (notice,) = (n for n in found.notices if "not compared" in n)
    assert notice.startswith("valve A, filling: the surfaces are not compared: ")
    assert "2 tests inside the duty range are too few for 4 folds" in notice
    assert found.part().valves.a.pwm.fill.bipolynomial is not None  # type: ignore[union-attr]


def test_a_surface_that_cannot_be_had_leaves_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sysid.surfaces.ann.DutyNetwork.fit", failing(NotIdentifiedError("why")))
    found = fit_valve_pwm(few_duties(), make_rig(), surface="both")
    assert set(found.fits["a", "fill"].errors) == {"bipolynomial"}
    assert "not identified: valve A, filling, ann: why" in found.notices
    with pytest.raises(NotIdentifiedError, match="valve A, filling: why"):
        fit_valve_pwm(few_duties(), make_rig(), surface="ann")


def test_a_comparison_recommends_a_surface_that_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    trials = make_trials("a", directions=("fill",))
    error = fit_valve_pwm(trials, make_rig()).fits["a", "fill"].errors["bipolynomial"]["fitted"]
    chosen = SurfaceComparison(error, error, math.nan, "ann", "it is better", 20, 4, 0)
    monkeypatch.setattr(valve_pwm, "compare_surfaces", lambda *_: chosen)
    monkeypatch.setattr("sysid.surfaces.ann.DutyNetwork.fit", failing(NotIdentifiedError("why")))
    comparison = fit_valve_pwm(trials, make_rig(), surface="both").fits["a", "fill"].comparison
    assert comparison is not None and comparison.recommended == "bipolynomial"
    assert comparison.reason == "the ann is not identified"


def test_one_valve_that_lacks_a_channel_leaves_the_other() -> None:
    broken = []
    for trial in make_trials("b"):
        channels = {k: v for k, v in trial.channels.items() if k != "pressure_b_pa"}
        broken.append(dataclasses.replace(trial, channels=channels))
    found = fit_valve_pwm([*make_trials("a"), *broken], make_rig())
    assert {valve for valve, _ in found.fits} == {"a"}
    assert "pressure_b_pa" in found.unidentified["b", "fill"]
    with pytest.raises(InputError, match="pressure_b_pa"):
        fit_valve_pwm(broken, make_rig())


@pytest.mark.parametrize("error", [InputError("place: what; fix"), KeyError("flow")])
def test_a_part_of_a_campaign_that_fails_leaves_the_others(
    error: Exception, bundled: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sysid.pipeline.fit.fit_valve_discrete", failing(error))
    some = only(bundled, "friction-static", "friction-sliding", "valve-discrete")
    found = fit_campaign(some)
    assert found.bundle.friction is not None and found.bundle.valves is None
    said = "place: what; fix" if isinstance(error, InputError) else "a fault in sysid itself"
    assert any(said in notice for notice in found.notices)
    kind = InputError if isinstance(error, InputError) else RuntimeError
    with pytest.raises(kind):
        fit_campaign(only(bundled, "valve-discrete"))


def test_a_critical_ratio_that_cannot_be_found_leaves_the_flows(
    bundled: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    singular = failing(np.linalg.LinAlgError("Singular matrix"))
    monkeypatch.setattr("sysid.identification.valve_discrete.estimates.critical_ratio", singular)
    entry = only(bundled, "valve-discrete").logs[0]
    found = valve_discrete.fit_valve_discrete(bundled.read(entry).trials, bundled.rig)
    estimates = found[entry.valve or "a"].estimates
    assert estimates["choked_flow_fill_kg_s"].identified
    assert "Singular matrix" in str(estimates["critical_ratio_fill"].reason)


def test_a_log_that_cannot_be_compared_is_said(
    bundled: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(consistency, "_breakaway", failing(ZeroDivisionError("division by zero")))
    (line,) = consistency.check_consistency(only(bundled, "friction-static", "friction-sliding"))
    assert line.startswith("friction_static.") and "not compared with the other logs" in line


# --- motion -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def fitted(bundled: Campaign) -> Bundle:
    kinds = ("friction-static", "friction-sliding", "valve-discrete")
    return fit_campaign(only(bundled, *kinds)).bundle


def test_a_motion_log_with_a_gap_leaves_the_others(
    bundled: Campaign, fitted: Bundle, monkeypatch: pytest.MonkeyPatch
) -> None:
    some = only(bundled, "motion-motor", "motion-discrete")
    read = Campaign.read

    def without_rows(self: Campaign, entry: Any) -> Log:
        log = read(self, entry)
        if entry.kind != "motion-motor":
            return log
        trials = []
        for trial in log.trials:
            kept = np.r_[0:500, 1500 : len(trial)]
            channels = {name: values[kept] for name, values in trial.channels.items()}
            trials.append(dataclasses.replace(trial, time=trial.time[kept], channels=channels))
        return dataclasses.replace(log, trials=tuple(trials))

    monkeypatch.setattr(Campaign, "read", without_rows)
    found = validate(some, fitted)
    assert {log.kind for log in found.logs} == {"motion-discrete"}
    left_out = [n for n in found.notices if n.startswith("excluded: ") and "no sample for" in n]
    assert len(left_out) == sum(e.kind == "motion-motor" for e in some.logs)
    with pytest.raises(InputError, match="no sample for"):
        validate(only(bundled, "motion-motor"), fitted)


def test_a_valve_model_that_cannot_be_simulated_leaves_the_others(
    bundled: Campaign, fitted: Bundle, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulated = open_loop._simulated

    def but_discrete(cases: Any, rig: Any, model: Any, valves: Any) -> Any:
        if valves.name == "discrete":
            raise NotIdentifiedError("it does not stay finite")
        return simulated(cases, rig, model, valves)

    monkeypatch.setattr(open_loop, "_simulated", but_discrete)
    found = validate(only(bundled, "motion-pwm"), fitted)
    assert {log.model for log in found.logs} == {"averaged"}
    said = "the discrete valve model is excluded: it does not stay finite"
    assert said in found.notices
    with pytest.raises(NotIdentifiedError, match="does not stay finite"):
        validate(only(bundled, "motion-discrete"), fitted)


def test_an_inertia_that_cannot_be_is_named(bundled: Campaign, fitted: Bundle) -> None:
    """The rig file's stands in for it; a rig file without one leaves nothing to simulate with."""
    friction = fitted.friction
    assert friction is not None
    wrong = friction.replaced(inertia_kg_m2=Estimate.symmetric(-0.5, 0.2, "kg m2", 9.0))
    spoilt = fitted.replaced(friction=wrong)
    assert spoilt.model(bundled.rig).parameters.inertia == bundled.rig.total_inertia()
    assert any("inertia_kg_m2 is -0.50 (-0.95 to -0.05)" in n for n in assumed_parameters(spoilt))
    with pytest.raises(NotIdentifiedError, match=r"inertia is -0\.5 kg m2, which is impossible"):
        spoilt.model(dataclasses.replace(bundled.rig, inertia=None))


@dataclasses.dataclass
class Held:
    """Held-out tests of a part whose first law cannot be simulated."""

    channel: str = "motor_torque_nm"
    tests: tuple[str, ...] = ("1",)
    further_errors_of = Component.further_errors_of

    def noise_floor(self, law: float) -> float:
        return 0.5

    def residuals(self, law: float, tests: Any) -> list[Any]:
        return [np.full(4, law)]

    def further_errors(self, law: float) -> dict[str, tuple[float, float]]:
        if law == 2.0:
            raise SimulationError("it switches without end")
        return {"theta_rad": (0.1, 0.01)}


def test_a_law_that_cannot_be_simulated_leaves_a_parts_diagnosis() -> None:
    errors, floors, notices = _held_out(Held(), [2.0, 1.0])  # type: ignore[arg-type, list-item]
    assert [e["motor_torque_nm"] for e in errors] == [2.0, 1.0]
    assert math.isnan(errors[0]["theta_rad"]) and errors[1]["theta_rad"] == 0.1
    assert floors == {"theta_rad": 0.01}  # that of the balance is from training tests
    assert notices == ("held-out tests are not simulated: it switches without end",)


# --- run ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def friction_alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A campaign whose run takes seconds: friction tests and one motion log."""
    folder = tmp_path_factory.mktemp("campaign")
    path = folder / "campaign.toml"
    blocks = (BUNDLED / "campaign.toml").read_text().split("[[log]]")
    kinds = ("friction-static", "friction-sliding")
    path.write_text("[[log]]".join([blocks[0], *(b for b in blocks if any(k in b for k in kinds))]))
    shutil.copy(BUNDLED / "rig.toml", folder)
    for file in BUNDLED.glob("friction_s*.parquet"):
        shutil.copy(file, folder)
    return path


def run(campaign: Path, folder: Path) -> RunReport:
    return run_campaign(campaign, folder, refine=False)


@pytest.mark.parametrize("error", [np.linalg.LinAlgError("Singular matrix"), TypeError("fault")])
def test_a_diagnosis_that_fails_leaves_the_rest_of_a_run(
    error: Exception, friction_alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stages, "diagnose", failing(error))
    done = run(friction_alone, tmp_path)
    assert done.diagnosis is None and str(error) in done.not_diagnosed
    assert any(n.startswith("not diagnosed: ") and str(error) in n for n in done.notices)
    assert done.report.is_file() and set(done.exports) == {"c", "mat", "json"}


def test_a_file_that_cannot_be_made_is_said_and_tried_again(
    friction_alone: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = stages.export_file

    def but_matlab(source: Path, path: Path, options: ExportOptions) -> tuple[str, ...]:
        if options.format == "mat":
            raise ValueError("not for MATLAB")
        return write(source, path, options)

    monkeypatch.setattr(stages, "diagnose", failing(NotIdentifiedError("no motion")))
    assert "mat" in run(friction_alone, tmp_path).exports
    (tmp_path / "bundle.json").unlink()  # all that follows from it is made anew
    (tmp_path / "report.html").unlink()
    (tmp_path / "export" / "model.h").unlink()
    monkeypatch.setattr(stages, "export_file", but_matlab)
    monkeypatch.setattr(page, "_fill", failing(KeyError("template")))
    second = run(friction_alone, tmp_path)
    assert set(second.exports) == {"c", "json"} and set(second.to_json()["exports"]) == {
        "c",
        "json",
    }
    assert not (tmp_path / "export" / "model.mat").exists()  # that of the first call
    assert second.to_json()["report"] is None
    assert any(n.startswith("no export/model.mat: ") for n in second.notices)
    assert any(n.startswith("no report: KeyError") for n in second.notices)
    outcomes = {stage.name: stage.complete for stage in second.stages}
    assert not outcomes["report"] and not outcomes["export"] and outcomes["fit"]
    monkeypatch.undo()
    monkeypatch.setattr(stages, "diagnose", failing(NotIdentifiedError("no motion")))
    third = run(friction_alone, tmp_path)
    assert third.report.is_file() and "mat" in third.exports


# --- pages --------------------------------------------------------------------------------


def test_a_section_that_cannot_be_made_says_why(
    bundled: Campaign, fitted: Bundle, monkeypatch: pytest.MonkeyPatch
) -> None:
    some = only(bundled, "friction-static", "friction-sliding", "valve-discrete")
    monkeypatch.setattr(friction, "friction_section", failing(IndexError("no row")))
    html = unescape(render_report(campaign=some, bundle=fitted))
    said = "This section could not be made: IndexError: no row (a fault in sysid itself"
    assert said in html and '<section id="friction"' in html and '<section id="valves"' in html
    monkeypatch.setenv("SYSID_DEBUG", "1")
    with pytest.raises(IndexError):
        render_report(campaign=some, bundle=fitted)


def test_a_plot_of_what_is_no_number_does_not_end_its_page(
    bundled: Campaign, fitted: Bundle, monkeypatch: pytest.MonkeyPatch
) -> None:
    plot = Plot("p", "plot", "of nothing", "caption", {}, {"y": [math.nan]}, ())
    drawn = Section("friction", "Friction", (), (plot,))
    monkeypatch.setattr(friction, "friction_section", lambda *_: drawn)
    html = render_report(campaign=only(bundled, "friction-static"), bundle=fitted)
    assert "This section could not be made" in html and "of nothing" not in html


def test_a_page_is_made_without_what_it_shows_beside(
    bundled: Campaign, fitted: Bundle, tmp_path: Path
) -> None:
    some = only(bundled, "friction-static", "friction-sliding")
    page = tmp_path / "report.html"
    lacking = PageOptions(validation=failing(NotIdentifiedError("no law")))
    assert write_page(page, some, fitted, lacking) == ("not validated: no law",)
    assert page.is_file() and write_page(page, some, fitted, PageOptions()) == ()


def test_a_verdict_that_cannot_be_worked_out_says_why(
    bundled: Campaign, fitted: Bundle, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(page, "verdict", failing(ZeroDivisionError("division by zero")))
    html = render_report(campaign=only(bundled, "friction-static"), bundle=fitted)
    assert "No verdict could be reached" in html and '<section id="friction"' in html


@pytest.mark.parametrize("way", ["fill", "dis"])
def test_a_flow_that_surfaces_alone_show_is_taken_from_them(way: str, tmp_path: Path) -> None:
    """Without on/off tests and averaged law the surface at the largest opening has the flow."""
    content = json.loads(golden_bundle("diagnosed").read_text())
    valve = content["valves"]["a"]
    assert "averaged" not in valve["pwm"]
    known = read_bundle(golden_bundle("diagnosed")).model().parameters
    for key in (f"choked_flow_{way}_kg_s", f"c_{way}"):
        valve["discrete"][key] = {"value": None, "identified": False, "reason": "unsteady supply"}
    path = tmp_path / "bundle.json"
    path.write_text(json.dumps(content))
    bundle = read_bundle(path)
    name = f"choked_{way}_a"
    found, wanted = (float(getattr(p, name)) for p in (bundle.model().parameters, known))
    assert found == pytest.approx(wanted, rel=0.1)
    said = [line for line in assumed_parameters(bundle) if "valves.a" in line]
    assert len(said) == 2 and "surface of its PWM tests" in said[0] + said[1]
