"""`sysid refine` and the stage of `sysid run`: what is estimated, written, said and refused.

Two tests by motor of a generated rig without scatter; the bundle holds the true parameters, each
with a standard error of 1 % and correlated with others of its part, and the rig file an inertia
that is 3 % too large.
"""

from __future__ import annotations

import contextlib
import copy
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from other_catalogues import USER_EFFECT

from datasets.generator.campaign import GeneratedCampaign, Size, make_campaign
from datasets.generator.files import write_log
from datasets.generator.rigs import rig_toml
from sysid.commands.app import main
from sysid.estimation.linear import Estimate
from sysid.io.campaign import read_campaign
from sysid.parameters import (
    Bundle,
    EffectEntry,
    FittedValves,
    Friction,
    Parts,
    read_bundle,
    write_bundle,
)
from sysid.parameters.valves import LAW_KEYS
from sysid.pipeline import run as stages
from sysid.pipeline.run import RunReport, run_campaign
from sysid.plant.effects import catalogue, load_user_effects
from sysid.refinement.refine import motion_tests_of, refine
from sysid.refinement.result import Fit, RefineResult
from sysid.refinement.unknowns import unknowns_of, without_own_data

SEED = 5
SMALLEST = Size(1, 1, 1, 0.04, (1, 1), (1, 1), (1, 1))
TOO_MUCH = 1.03
UNITS = {
    "static_nm": "Nm",
    "coulomb_nm": "Nm",
    "viscous_nm_s_per_rad": "Nm s/rad",
    "choked_flow_fill_kg_s": "kg/s",
    "choked_flow_dis_kg_s": "kg/s",
    "c_fill": "kg/(s Pa^0.5)",
    "c_dis": "kg/(s Pa)",
}


@dataclass(frozen=True)
class Made:
    """A campaign in files, the bundle to refine, and the rig's true inertia, kg m2."""

    campaign: Path
    bundle: Path
    inertia: float

    def arguments(self, *more: str) -> list[str]:
        return ["refine", str(self.campaign), "--bundle", str(self.bundle), *more]


@dataclass(frozen=True)
class Outcome:
    """A command's exit status, and what it printed."""

    code: int
    out: str
    err: str


def run_command(arguments: list[str]) -> Outcome:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(arguments)
    return Outcome(code, out.getvalue(), err.getvalue())


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = tmp_path_factory.mktemp("campaign")
    generated = make_campaign(SEED, size=SMALLEST, kinds=("motion-motor",), scatter=0.0)
    content = copy.deepcopy(generated.rig.content)
    inertia = float(content["inertia"]["equivalent_kg_m2"])
    content["inertia"]["equivalent_kg_m2"] = TOO_MUCH * inertia
    path = written(generated, folder, content)
    bundle = folder / "bundle.json"
    write_bundle(true_bundle(generated.truth, path), bundle)
    return Made(path, bundle, inertia)


def written(generated: GeneratedCampaign, folder: Path, rig: dict[str, Any]) -> Path:
    """A campaign's file, with its logs and a rig file of this content next to it."""
    (folder / "rig.toml").write_text(rig_toml(rig))
    lines = ['rig = "rig.toml"']
    for log in generated.logs:
        write_log(folder / f"{log.stem}.csv", log.tests, generated.rig)
        lines += ["[[log]]", f'kind = "{log.kind}"', f'file = "{log.stem}.csv"']
        lines += [f'use = "{log.use}"']
    path = folder / "campaign.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


def true_bundle(truth: dict[str, Any], campaign: Path) -> Bundle:
    friction: dict[str, Any] = {n: known(n, value) for n, value in truth["friction"].items()}
    friction["correlation"] = correlation("coulomb_nm", "viscous_nm_s_per_rad")
    valves = {
        side: {
            "discrete": {
                **{name: known(name, value) for name, value in law.items()},
                "correlation": correlation("choked_flow_fill_kg_s", "c_fill"),
            }
        }
        for side, law in truth["valves"].items()
    }
    parts = Parts(Friction.model_validate(friction), FittedValves.model_validate(valves))
    return Bundle.new(read_campaign(campaign).rig, parts, [])


def correlation(first: str, second: str) -> dict[str, Any]:
    return {"names": [first, second], "matrix": [[1.0, -0.8], [-0.8, 1.0]]}


def known(name: str, value: float) -> Estimate:
    return Estimate(value, 0.01 * abs(value), UNITS[name], (0.98 * value, 1.02 * value))


@pytest.fixture(scope="module")
def refined(made: Made) -> tuple[Outcome, Path]:
    """The command with --json and -o, the inertia freed and all flows kept."""
    output = made.campaign.parent / "refined.json"
    free = ["--free", "rig.inertia", "--fix", "valves.a", "--fix", "valves.b"]
    return run_command(made.arguments(*free, "--json", "-o", str(output))), output


def test_motion_is_read_for_a_bundle_with_an_effect_of_the_users_own(
    made: Made, tmp_path: Path
) -> None:
    own = tmp_path / "own.py"
    own.write_text(USER_EFFECT)
    campaign = read_campaign(made.campaign)
    entry = EffectEntry(id="wind", parameters={"wind_nm": known("static_nm", 0.1)})
    bundle = read_bundle(made.bundle).with_effects([entry])
    model = bundle.model(campaign.rig, {**catalogue(), **load_user_effects(own)})
    assert motion_tests_of(campaign, campaign.logs, bundle, model, [])


@pytest.fixture(scope="module")
def content(refined: tuple[Outcome, Path]) -> dict[str, Any]:
    printed: dict[str, Any] = json.loads(refined[0].out)
    return printed


def by_name(content: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {parameter["name"]: parameter for parameter in content["parameters"]}


def test_json_is_one_object_that_names_what_was_written(
    refined: tuple[Outcome, Path], content: dict[str, Any]
) -> None:
    outcome, output = refined
    assert outcome.code == 0
    assert content["written"] == [str(output)]
    assert content["converged"] is True
    assert content["segments"] >= 1
    assert "estimating 4 parameters" in outcome.err


def test_only_what_was_asked_for_is_estimated(content: dict[str, Any]) -> None:
    assert list(by_name(content)) == [
        "friction.static_nm",
        "friction.coulomb_nm",
        "friction.viscous_nm_s_per_rad",
        "rig.inertia",
    ]
    count = len(content["parameters"])
    assert [len(row) for row in content["correlation"]] == [count] * count
    assert all(content["correlation"][i][i] == pytest.approx(1.0) for i in range(count))


def test_an_inertia_that_the_rig_file_has_wrong_is_found_and_said(
    made: Made, refined: tuple[Outcome, Path], content: dict[str, Any]
) -> None:
    found = by_name(content)["rig.inertia"]
    assert found["before"] == pytest.approx(TOO_MUCH * made.inertia)
    assert found["after"]["value"] == pytest.approx(made.inertia, rel=2e-3)
    assert found["informed_by_motion"] is True
    said = [
        line for line in content["notices"] if line.startswith("rig.inertia: the rig file says")
    ]
    assert len(said) == 1 and "correct [inertia] equivalent_kg_m2 and fit again" in said[0]
    assert said[0] in refined[0].err


def test_held_out_motion_is_followed_better(content: dict[str, Any]) -> None:
    errors = content["rmse"]["holdout"]["theta_rad"]
    assert errors["after"] < 0.5 * errors["before"]


def test_the_bundle_holds_the_record_and_the_new_numbers(
    made: Made, refined: tuple[Outcome, Path], content: dict[str, Any]
) -> None:
    first, bundle = read_bundle(made.bundle), read_bundle(refined[1])
    assert bundle.refinement is not None and first.refinement is None
    assert [value.name for value in bundle.refinement.values()] == list(by_name(content))
    assert bundle.friction is not None and bundle.friction.coulomb_nm is not None
    after = by_name(content)["friction.coulomb_nm"]["after"]
    assert bundle.friction.coulomb_nm.value == after["value"]
    # What was kept is as it was, the rig file's constants among it.
    assert bundle.valves == first.valves
    assert bundle.rig_content == first.rig_content
    assert {(e.file, e.use) for e in bundle.provenance.logs} == {
        ("motion_motor.csv", "fit"),
        ("motion_motor_2.csv", "holdout"),
    }


def test_friction_comes_with_the_correlation_of_its_new_errors(
    refined: tuple[Outcome, Path], content: dict[str, Any]
) -> None:
    """Not with the bench tests', which the valves, kept as they were, still have."""
    bundle = read_bundle(refined[1])
    assert bundle.friction is not None and bundle.friction.correlation is not None
    names = bundle.friction.correlation.names
    assert names == ["static_nm", "coulomb_nm", "viscous_nm_s_per_rad"]
    places = [list(by_name(content)).index(f"friction.{name}") for name in names]
    whole = np.array(content["correlation"])[np.ix_(places, places)]
    assert bundle.friction.correlation.array() == pytest.approx(whole, abs=1e-6)
    assert whole[1, 2] != pytest.approx(-0.8, abs=1e-3)
    for side in "ab":
        law = bundle.valve(side).discrete
        assert law is not None and law.correlation is not None
        assert law.correlation.array()[0, 1] == -0.8


def test_a_change_of_parts_drops_the_record(made: Made, refined: tuple[Outcome, Path]) -> None:
    bundle = read_bundle(refined[1])
    assert "refinement" in bundle.given()
    assert "refinement" not in bundle.merged(read_bundle(made.bundle)).given()
    assert "refinement" not in bundle.with_effects([]).given()


@pytest.mark.parametrize("option", ["--free", "--fix", "--profile"])
def test_an_unknown_name_is_refused_with_those_that_are_known(made: Made, option: str) -> None:
    outcome = run_command(made.arguments(option, "rig.colour"))
    assert (outcome.code, outcome.out) == (2, "")
    assert len(outcome.err.splitlines()) == 1
    assert "rig.colour" in outcome.err and "use one of friction.static_nm" in outcome.err


def test_nothing_left_to_estimate_is_refused(made: Made) -> None:
    outcome = run_command(made.arguments("--fix", "friction", "--fix", "valves"))
    assert outcome.code == 2
    assert "leaves nothing to estimate" in outcome.err


def test_a_campaign_without_motion_to_fit_on_is_refused(made: Made) -> None:
    path = made.campaign.with_name("held_out.toml")
    path.write_text(made.campaign.read_text().replace('use = "fit"', 'use = "holdout"'))
    outcome = run_command(["refine", str(path), "--bundle", str(made.bundle)])
    assert outcome.code == 2
    assert "holds no training motion log" in outcome.err and "motion-motor" in outcome.err


def test_a_bundle_without_the_valves_laws_cannot_be_refined(made: Made, tmp_path: Path) -> None:
    path = tmp_path / "friction.json"
    write_bundle(read_bundle(made.bundle).without("valves"), path)
    output = tmp_path / "refined.json"
    arguments = ["refine", str(made.campaign), "--bundle", str(path), "-o", str(output)]
    outcome = run_command(arguments)
    assert outcome.code == 3
    assert "holds no on/off law of both valves" in outcome.err
    assert not output.exists()


# --- the stage of `sysid run` ------------------------------------------------------------


@pytest.fixture(scope="module")
def pipeline(made: Made, tmp_path_factory: pytest.TempPathFactory) -> tuple[RunReport, RunReport]:
    """A run with the stage, and one into a copy of its folder without; the fit is the bundle."""
    with pytest.MonkeyPatch.context() as patch:
        first = read_bundle(made.bundle)
        patch.setattr(stages, "_fit", lambda run: write_bundle(first, run.path("fitted.json")))
        # Its few short tests are simulated worse with refined numbers, which a run does not take.
        patch.setattr(RefineResult, "worse", "")
        folder = tmp_path_factory.mktemp("results")
        with_stage = run_campaign(made.campaign, folder, diagnose=False)
        without = run_campaign(made.campaign, folder, diagnose=False, refine=False)
    return with_stage, without


def test_the_pipeline_refines_what_it_fitted(made: Made, pipeline: tuple[RunReport, Any]) -> None:
    run = pipeline[0]
    names = [stage.name for stage in run.stages]
    assert names == ["check", "fit", "refine", "validate", "report", "export"]
    refined = read_bundle(run.folder / "refined.json")
    assert refined.refinement is not None
    assert {value.name for value in refined.refinement.values()} == {
        "friction.static_nm",
        "friction.coulomb_nm",
        "friction.viscous_nm_s_per_rad",
        *(f"valves.{side}.{key}" for side in "ab" for key in LAW_KEYS.values()),
    }
    assert run.bundle.refinement is not None and run.bundle.validation is not None
    assert run.bundle.friction == refined.friction


def test_a_run_keeps_the_bundle_where_refined_numbers_simulate_much_worse(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = read_bundle(made.bundle)
    monkeypatch.setattr(stages, "_fit", lambda run: write_bundle(first, run.path("fitted.json")))
    run = run_campaign(made.campaign, tmp_path / "results", diagnose=False)
    assert run.bundle.refinement is None and run.bundle.friction == first.friction
    (line,) = (n for n in run.notices if n.startswith("not refined: "))
    assert "the training tests would be simulated" in line and "times worse" in line


def test_motion_by_motor_informs_friction_and_not_the_flows(
    pipeline: tuple[RunReport, Any],
) -> None:
    """With the chambers open to the atmosphere, filling is never seen."""
    assert pipeline[0].bundle.refinement is not None
    values = {value.name: value for value in pipeline[0].bundle.refinement.values()}
    assert values["friction.viscous_nm_s_per_rad"].informed_by_motion
    for side in "ab":
        filling = values[f"valves.{side}.choked_flow_fill_kg_s"]
        assert not filling.informed_by_motion
        assert float(filling.movement or 0.0) == pytest.approx(0.0, abs=1e-6)


def test_what_nothing_informs_keeps_its_error_without_a_prior(made: Made) -> None:
    """Not that of the integration, a millionth."""
    bundle = read_bundle(made.bundle)
    found = refine(read_campaign(made.campaign), bundle, prior=False)
    for side in "ab":
        name = f"valves.{side}.choked_flow_fill_kg_s"
        (filling,) = (q for q in found.parameters if q.name == name)
        assert not filling.informed
        assert filling.estimate.std == pytest.approx(filling.unknown.std, rel=1e-9)
    assert next(q for q in found.parameters if q.name == "friction.coulomb_nm").informed


def test_without_the_stage_the_fitted_bundle_is_validated(
    made: Made, pipeline: tuple[Any, RunReport]
) -> None:
    run = pipeline[1]
    outcomes = {stage.name: stage.outcome for stage in run.stages}
    assert "refine" not in outcomes
    assert outcomes["fit"] == "up to date"
    assert "repeated" in outcomes["validate"] and "repeated" in outcomes["report"]
    assert run.bundle.refinement is None
    assert run.bundle.friction == read_bundle(made.bundle).friction
    html = run.report.read_text("utf-8")
    assert '<section id="refinement"' not in html and "run sysid refine" in html


def test_friction_that_is_zero_stays_and_two_effects_of_a_kind_stay_apart(
    made: Made, tmp_path: Path
) -> None:
    content = json.loads(made.bundle.read_text("utf-8"))
    content["friction"]["viscous_nm_s_per_rad"]["value"] = -1e-5
    for side, value in (("a", 100.0), ("b", -200.0)):
        content["effects"].append(
            {
                "id": "pressure-offset",
                "parameters": {
                    "pressure_offset_pa": {"value": value, "std": 10.0, "unit": "Pa"},
                    "side": side,
                },
            }
        )
    path = tmp_path / "bundle.json"
    path.write_text(json.dumps(content), "utf-8")
    campaign = read_campaign(made.campaign)
    bundle = read_bundle(path)
    names = [u.name for u in unknowns_of(bundle, campaign.rig, bundle.model(campaign.rig))]
    assert "friction.viscous_nm_s_per_rad" not in names
    assert "friction.coulomb_nm" in names
    assert {"pressure-offset-1.pressure_offset_pa", "pressure-offset-2.pressure_offset_pa"} <= set(
        names
    )


def test_a_refined_bundle_is_no_prior_of_the_same_logs(made: Made, tmp_path: Path) -> None:
    campaign = read_campaign(made.campaign)
    refined = refine(campaign, read_bundle(made.bundle)).bundle
    assert refined.provenance.options["refinement"] == {
        "free": [],
        "fix": [],
        "prior": True,
        "robust": False,
    }
    notices: list[str] = []
    every = unknowns_of(refined, campaign.rig, refined.model(campaign.rig))
    left = without_own_data(every, refined, notices)
    assert len(notices) == 1 and "refined already" in notices[0]
    assert not any(u.has_prior for u in left if u.origin in ("friction", "valve"))


def test_numbers_that_make_up_for_what_the_model_lacks_are_said_to_do_so(
    made: Made, refined: tuple[Outcome, Path], content: dict[str, Any]
) -> None:
    """With the inertia kept at its wrong value the whole tests are simulated worse."""
    wrong = run_command(made.arguments("--fix", "valves.a", "--fix", "valves.b", "--json"))
    assert content["longest_segment_s"] > 2.0
    assert "times worse: they compensate for what the model lacks" in wrong.err
    assert "worse" not in refined[0].err
    found = {p["name"]: p["after"] for p in json.loads(wrong.out)["parameters"]}
    right = {p["name"]: p["after"] for p in content["parameters"]}
    name = "friction.coulomb_nm"
    assert found[name]["std"] > 2.0 * right[name]["std"]


def test_friction_of_each_test_is_named_where_it_explains_the_errors(made: Made) -> None:
    """And only there: what it leaves beyond noise is what a model lacks."""
    bundle = read_bundle(made.bundle)

    def result(after: float, left: list[float] | None) -> RefineResult:
        one = np.array([1.0, 1.0, np.nan])
        return RefineResult(
            parameters=(),
            correlation=np.zeros((0, 0)),
            fits={"fit": Fit(one, after * one, one, one)},
            channels=("theta_rad", "pressure_a_pa", "pressure_b_pa"),
            scatter=(0.025, 0.02),
            evaluations=1,
            converged=True,
            segments=1,
            left_out=0,
            longest=1.0,
            bundle=bundle,
            unexplained=None if left is None else np.array(left),
        )

    explained = result(1.3, [0.004, 0.0, np.nan])
    assert explained.scatters == "1.3 times worse" and not explained.worse
    for left in (None, [0.004, 0.6, np.nan]):
        lacking = result(1.3, left)
        assert lacking.worse == "1.3 times worse" and not lacking.scatters
    better = result(0.8, None)
    assert not better.worse and not better.scatters


@pytest.mark.parametrize("scatter", [0.03, 0.0])
def test_friction_of_each_test_is_named_on_a_rig_whose_friction_differs(
    scatter: float, tmp_path: Path
) -> None:
    """Of the same rig and commands; where friction is one, whole tests are simulated as before."""
    generated = make_campaign(71, size=SMALLEST, kinds=("motion-motor",), scatter=scatter)
    path = written(generated, tmp_path, generated.rig.content)
    result = refine(read_campaign(path), true_bundle(generated.truth, path))
    said = [n for n in result.notices if "simulation adds up" in n]
    assert len(said) == (scatter > 0.0) and not result.worse
    if scatter > 0.0:
        assert f"simulated {result.scatters}, as friction differs from test to test" in said[0]
