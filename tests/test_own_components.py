"""Components of the user's own: the two worked ones through the commands, and as a library."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from own_components import CYLINDER, MOTOR, done, refused

import sysid as si
from datasets.components import logs
from sysid.components import LogColumn, Parameter, Quantity, StaticComponent, Term
from sysid.components.own_tests import tests_of as own_tests
from sysid.components.own_tests import training_part
from sysid.diagnosis.bench.component import Law
from sysid.parameters import read_bundle

# Not the seed that the examples were written with (1).
SEED = 11


@pytest.fixture(scope="module", autouse=True)
def _one_process() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SYSID_JOBS", "1")
        yield


@pytest.fixture(scope="module")
def servo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("servo")
    logs.servo(folder, SEED)
    return folder


@pytest.fixture(scope="module")
def cylinder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cylinder")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(logs, "_CYLINDER_S", 2.5)  # enough to find what is missing
        logs.cylinder(folder, SEED)
    return folder


@pytest.fixture(scope="module")
def servo_found(servo: Path) -> dict[str, Any]:
    """What a diagnosis of the servo printed; its bundles are `b.json` and `e.json`."""
    return held(servo, MOTOR, logs.SERVO)


@pytest.fixture(scope="module")
def cylinder_found(cylinder: Path) -> dict[str, Any]:
    """The same of the cylinder."""
    return held(cylinder, CYLINDER, logs.CYLINDER)


def held(folder: Path, which: Path, truth: dict[str, float]) -> dict[str, Any]:
    """Fit, diagnose; what was printed, after the bundle's numbers were compared with the truth."""
    campaign, fitted, longer = (folder / n for n in ("campaign.toml", "b.json", "e.json"))
    told = done("fit", campaign, "--component", which, "-o", fitted)
    assert f"runs the user's own code: {which}" in told.err
    told = done(
        "diagnose", campaign, "--bundle", fitted, "--component", which, "-o", longer, "--json"
    )
    assert f"runs the user's own code: {which}" in told.err
    bundle = read_bundle(longer)
    assert bundle.component is not None and bundle.component.file == which.name
    numbers = {**bundle.component.parameters, **bundle.effects[0].numbers()}
    for name, value in truth.items():
        estimate = numbers[name]
        # Its interval, doubled: five at once, and the plant's friction is sharper than the law's.
        low, high = estimate.interval
        reach = max(high - low, 0.02 * abs(value))
        assert low - reach < value < high + reach, (name, value, estimate)
    printed: dict[str, Any] = json.loads(told.out)
    return printed


def test_a_geared_motor_lacks_its_unbalanced_load(servo: Path, servo_found: dict[str, Any]) -> None:
    printed = servo_found
    assert printed["verdict"] == "effects-found"
    assert [e["id"] for e in printed["effects"]] == ["unbalance"]
    for name in ("current_a", "angle_rad"):
        errors = printed["residual"][name]
        assert errors["after"] < 0.2 * errors["before"]
    # With it in the bundle nothing is missing, and its numbers are kept.
    extended = servo / "e.json"
    again = done(
        "diagnose", servo / "campaign.toml", "--bundle", extended, "--component", MOTOR, "--json"
    )
    assert json.loads(again.out)["verdict"] == "adequate"


def test_a_geared_motor_that_lacks_nothing_is_adequate(tmp_path: Path) -> None:
    logs.servo(tmp_path, SEED + 1, unbalance=False)
    campaign = si.read_campaign(tmp_path / "campaign.toml", component=MOTOR)
    bundle = si.fit(campaign)
    found = si.diagnose(campaign, bundle)
    assert found.verdict == "adequate" and found.bundle.effects == []
    assert bundle.component is not None
    for name, value in logs.SERVO.items():
        if name in bundle.component.parameters:
            estimate = bundle.component.parameters[name]
            assert estimate.value == pytest.approx(value, rel=0.05), name


def test_a_spring_return_cylinder_lacks_its_seal_friction(cylinder_found: dict[str, Any]) -> None:
    printed = cylinder_found
    assert printed["verdict"] == "effects-found"
    assert [e["id"] for e in printed["effects"]] == ["seal-friction"]
    # Friction's smoothed sign is not the plant's: not all of the error goes.
    for name in ("position_m", "pressure_pa"):
        errors = printed["residual"][name]
        assert errors["after"] < 0.5 * errors["before"]


def test_derivatives_are_those_of_the_simulation(cylinder: Path) -> None:
    campaign = si.read_campaign(cylinder / "campaign.toml", component=CYLINDER)
    part = training_part(own_tests(campaign))
    # Away from where friction's smoothed sign is steeper than a difference's step.
    law = Law({p.name: p.value for p in part.parameters()})
    seal = part.effects({})[0](seal_n_per_pa=3e-5)
    law = Law(law.values, (seal,))
    every = range(len(part.tests))
    exact = part.jacobian(law, every)
    assert exact is not None
    for i, parameter in enumerate(part.parameters()):
        step = 1e-6 * parameter.size
        ends = [
            np.concatenate(part.residuals(Law({**law.values, parameter.name: at}, (seal,)), every))
            for at in (parameter.value - step, parameter.value + step)
        ]
        slope = (ends[1] - ends[0]) / (2.0 * step)
        assert np.linalg.norm(exact[:, i] - slope) < 1e-4 * np.linalg.norm(slope), parameter.name


def test_simulation_converges_in_its_steps(cylinder: Path) -> None:
    from sysid.components import with_component

    text = CYLINDER.read_text("utf-8")
    finer = cylinder / "finer.py"
    finer.write_text(text.replace("substeps = 8", "substeps = 64"), "utf-8")
    outputs = []
    for source in (CYLINDER, finer):
        part = training_part(own_tests(with_component(cylinder / "campaign.toml", source)))
        law = Law({name: logs.CYLINDER[name] for name in [p.name for p in part.parameters()]})
        outputs.append(part.predicted(law, [0])[0])
    for name, least in (("position_m", 1e-4), ("pressure_pa", 500.0)):
        gap = outputs[0][name] - outputs[1][name]
        assert float(np.sqrt(np.mean(gap**2))) < least


@pytest.mark.usefixtures("cylinder_found")
def test_it_is_checked_validated_and_reported(cylinder: Path) -> None:
    campaign, fitted, page = (cylinder / n for n in ("campaign.toml", "own.json", "own.html"))
    given = ("--component", CYLINDER)
    checks = json.loads(done("check", campaign, *given, "--json").out)["logs"]
    assert [c["use"] for c in checks] == ["fit", "fit", "fit", "holdout"]
    assert all(i["identified"] for i in checks[0]["identifies"])
    shutil.copy(cylinder / "b.json", fitted)
    told = done(
        "validate", campaign, "--bundle", fitted, *given, "-o", fitted, "--report", page, "--json"
    )
    found = json.loads(told.out)["validation"]["logs"][-1]
    bundle = read_bundle(fitted)
    assert bundle.validation is not None and len(bundle.validation.validated()) == 4
    # By hand: the held-out log, from its start, with the bundle's numbers.
    part = training_part(own_tests(si.read_campaign(campaign, component=CYLINDER)))
    trial = own_tests(si.read_campaign(campaign, component=CYLINDER)).held_out[0]
    shown = part.open_loop(part.law_of(bundle), [(trial, 0, len(trial))])[0]
    for name, channel in found["channels"].items():
        gap = trial[name] - shown[name]
        spread = trial[name] - trial[name].mean()
        assert channel["rmse"] == pytest.approx(float(np.sqrt(np.mean(gap**2))))
        fit = 100.0 * (1.0 - np.linalg.norm(gap) / np.linalg.norm(spread))
        assert channel["fit_percent"] == pytest.approx(fit) and fit > 50.0
    text = page.read_text("utf-8")
    assert "Component of the user" in text and "fig-own-pressure_pa-0" in text
    assert "open loop: fit" in text and "stiffness_n_per_m" in text
    # Each error has its unit, and a log's use is the word of every other table.
    errors = re.findall(r'<td data-label="(Use|Unit)"[^>]*>([^<]*)</td>', text)
    assert {("Use", "held out"), ("Use", "training"), ("Unit", "mm"), ("Unit", "kPa")} <= {*errors}
    assert ("Use", "fit") not in errors
    # Names in words with the key beneath, units as people write them.
    assert ">Stiffness<" in text and "N·s/m" in text and "N*s/m" not in text
    assert 'data-label="Output">Position<' in text and ">position_m<" not in text
    assert ">1e5<" not in text and ">Residual (kPa)<" in text  # no power of ten beside an axis


def test_a_law_that_changed_since_the_fit_is_said(tmp_path: Path) -> None:
    path, law = write_springs(tmp_path, 0.0), tmp_path / "spring.py"
    text = """
from sysid.components import LogColumn, Parameter, StaticComponent

class Law(StaticComponent):
    kind = "spring"
    columns = {"position_m": LogColumn("m", "input"), "force_n": LogColumn("N", "output")}
    parameters = (Parameter("stiffness_n_per_m", 100.0, "N/m", 0.0),)

    def predict(self, columns, values):
        return values["stiffness_n_per_m"] * columns["position_m"]
"""
    law.write_text(text, "utf-8")
    campaign = si.read_campaign(path, component=law)
    bundle = si.fit(campaign)
    assert not any("SHA-256" in line for line in si.validate(campaign, bundle).notices)
    law.write_text(text.replace('["position_m"]\n', '["position_m"] + 1.5\n'), "utf-8")
    edited = si.read_campaign(path, component=law)
    for found in (si.validate(edited, bundle), si.refine(edited, bundle)):
        assert any("spring.py is not the file" in line for line in found.notices)


@pytest.mark.usefixtures("servo_found")
def test_it_is_refined_with_the_starts_free(servo: Path) -> None:
    campaign = si.read_campaign(servo / "campaign.toml", component=MOTOR)
    longer = read_bundle(servo / "e.json")
    refined = si.refine(campaign, longer)
    numbers = {
        **refined.bundle.component.parameters,  # type: ignore[union-attr]
        **refined.bundle.effects[0].numbers(),
    }
    for name, value in logs.SERVO.items():
        assert numbers[name].value == pytest.approx(value, rel=0.02), name
        assert numbers[name].std > 0.0
    assert refined.after["current_a"] < 1.1 * refined.before["current_a"]  # type: ignore[union-attr]
    assert "unbalance/unbalance_nm" in str(refined)


def test_starts_that_are_off_are_estimated(servo: Path) -> None:
    """The derivatives by the starts: runs begun elsewhere are brought back to the data."""
    campaign = si.read_campaign(servo / "campaign.toml", component=MOTOR)
    part = training_part(own_tests(campaign), ["unbalance"])
    truth = dict(logs.SERVO)
    truth["unbalance/unbalance_nm"] = truth.pop("unbalance_nm")
    law = Law(truth)
    zero = np.zeros((3, 2))
    jacobian = part.jacobian_from(law, zero)  # type: ignore[attr-defined]
    step = 1e-6
    for run in range(3):
        for state in range(2):
            off = zero.copy()
            off[run, state] = step
            ends = [part.residuals_from(law, s * off) for s in (-1.0, 1.0)]  # type: ignore[attr-defined]
            slope = (ends[1] - ends[0]) / (2.0 * step)
            given = jacobian[:, 5 + 1 + 2 * run + state]
            assert np.linalg.norm(given - slope) < 1e-4 * np.linalg.norm(slope)


def test_the_whole_run_and_what_a_bundle_of_one_is_not_for(servo: Path, tmp_path: Path) -> None:
    results = tmp_path / "results"
    line = ("run", servo / "campaign.toml", "--component", f"{MOTOR}:GearedMotor", "-o", results)
    first = json.loads(done(*line, "--json").out)
    assert [s["name"] for s in first["stages"]] == [
        "check", "fit", "diagnose", "refine", "validate", "report",
    ]  # fmt: skip
    assert first["diagnosis"]["effects"][0]["id"] == "unbalance" and first["exports"] == {}
    assert all(s["why"] is None for s in json.loads(done(*line, "--json").out)["stages"])
    bundle = read_bundle(results / "bundle.json")
    assert bundle.component is not None and bundle.effects[0].id == "unbalance"
    said = refused("export", results / "bundle.json", "--format", "c", "-o", tmp_path / "x.h")
    assert "holds a component of your own (GearedMotor)" in said


def test_a_check_says_what_is_missing_or_implausible(cylinder: Path, tmp_path: Path) -> None:
    for name in ("rig.toml", "campaign.toml", "test_1.csv", "test_2.csv", "test_3.csv"):
        (tmp_path / name).write_text((cylinder / name).read_text("utf-8"), "utf-8")
    rows = (cylinder / "test_4.csv").read_text("utf-8").splitlines()
    (tmp_path / "test_4.csv").write_text("\n".join(r.rpartition(",")[0] for r in rows), "utf-8")
    scaled = [
        ",".join([t, f"{100 * float(u):g}", *more])
        for t, u, *more in (
            row.split(",") for row in (tmp_path / "test_2.csv").read_text("utf-8").splitlines()[1:]
        )
    ]
    (tmp_path / "test_2.csv").write_text("\n".join([rows[0], *scaled, ""]), "utf-8")
    still = [
        ",".join([t, "0", *more])
        for t, _, *more in (
            row.split(",") for row in (tmp_path / "test_3.csv").read_text("utf-8").splitlines()[1:]
        )
    ]
    (tmp_path / "test_3.csv").write_text("\n".join([rows[0], *still, ""]), "utf-8")
    told = done("check", tmp_path / "campaign.toml", "--component", CYLINDER)
    said = [line for line in told.err.splitlines() if "notice" in line]
    assert any("column pressure_pa (Pa) is missing" in line for line in said)
    assert any("command runs from" in line and "-1 to 1 dimensionless" in line for line in said)
    assert "command does not change: it excites nothing" in told.out


@pytest.mark.slow
def test_an_axis_of_the_emps_benchmark(shared_data: Path, tmp_path: Path) -> None:
    """The public servo's mass and friction, by the second file of the worked motor."""
    source = shared_data / "emps"
    for name, file in (("estimation", "DATA_EMPS.mat"), ("pulses", "DATA_EMPS_PULSES.mat")):
        maps = ("time_s=t:s", "position_m=qm:m", "motor_force_n=vir:35.15 N")
        given = [word for text in maps for word in ("--map", text)]
        done("convert", source / file, "-o", tmp_path / f"{name}.csv", *given)
    rig = '[rig]\nname = "EMPS"\nmotion = "linear"\norientation = "horizontal"\n'
    (tmp_path / "rig.toml").write_text(rig, "utf-8")
    logged = [
        f'[[log]]\nkind = "servo-axis"\nfile = "{n}.csv"\nuse = "{use}"'
        for n, use in (("estimation", "fit"), ("pulses", "holdout"))
    ]
    path = tmp_path / "campaign.toml"
    path.write_text("\n".join(['rig = "rig.toml"', *logged, ""]), "utf-8")
    campaign = si.read_campaign(path, component=MOTOR)
    bundle = si.fit(campaign)
    assert bundle.component is not None and bundle.component.name == "ServoAxis"
    numbers = {name: e.value for name, e in bundle.component.parameters.items()}
    # The benchmark's own values (benchmarks/figures.jsonl); the base law lacks what differs between
    # the directions.
    assert numbers["mass_kg"] == pytest.approx(95.1, rel=0.1)
    assert numbers["viscous_n_s_per_m"] == pytest.approx(203.5, rel=0.1)
    found = si.diagnose(campaign, bundle)
    assert found.effects[0].id == "uneven-viscous"
    after = found.bundle.component.parameters["mass_kg"]  # type: ignore[union-attr]
    assert after.value == pytest.approx(95.1, rel=0.05)
    assert found.residual["position_m"].after < 0.8 * found.residual["position_m"].before
    checked = si.validate(campaign, bundle)
    errors = checked.select("holdout")[0].channels["position_m"]
    second = next(h for h in errors.horizons if h.horizon_s == 1.0)
    assert second.rmse is not None and second.rmse < 2e-3


def write_springs(folder: Path, cubic: float) -> Path:
    """Three tests of a spring to fit on, one held out: rows of position, force."""
    lines = ['rig = "rig.toml"']
    (folder / "rig.toml").write_text(
        '[rig]\nname = "spring"\norientation = "horizontal"\n', "utf-8"
    )
    for k in range(4):
        rng = np.random.default_rng([SEED, k])
        x = np.linspace(-0.02, 0.03, 200) + 1e-3 * rng.standard_normal(200)
        force = 800.0 * x + 1.5 + cubic * x**3 + 0.02 * rng.standard_normal(200)
        pairs = enumerate(zip(x, force, strict=True))
        rows = [f"{i * 0.1:.1f},{1e3 * a:.6f},{f:.6f}" for i, (a, f) in pairs]
        text = "\n".join(["time_s,travel,force_n", *rows, ""])
        (folder / f"{k}.csv").write_text(text, "utf-8")
        use = "fit" if k < 3 else "holdout"
        lines += ["[[log]]", 'kind = "spring"', f'file = "{k}.csv"', f'use = "{use}"']
        lines += ['map = { position_m = "travel:mm" }']
    (folder / "campaign.toml").write_text("\n".join([*lines, ""]), "utf-8")
    return folder / "campaign.toml"


class Spring(StaticComponent):
    """A law in a column, in numpy."""

    kind = "spring"
    columns = {"position_m": LogColumn("m", "input"), "force_n": LogColumn("N", "output")}  # noqa: RUF012
    parameters = (
        Parameter("stiffness_n_per_m", 100.0, "N/m", 0.0),
        Parameter("offset_n", 0.0, "N", scale=1.0),
    )
    terms = (
        Term(
            "hardening",
            "a spring that stiffens",
            (Quantity("cubic_n_per_m3", "N/m**3", 1e5, -1e9, 1e9, "per travel cubed"),),
            lambda columns, values: values["cubic_n_per_m3"] * columns["position_m"] ** 3,
        ),
        Term(
            "dry-friction",
            "friction that resists motion",
            (Quantity("friction_n", "N", 0.1, 0.0, 10.0, "half the loop"),),
            lambda columns, values: (
                values["friction_n"] * np.sign(np.gradient(columns["position_m"]))
            ),
        ),
    )

    def predict(self, columns: Any, values: Any) -> Any:
        return values["stiffness_n_per_m"] * columns["position_m"] + values["offset_n"]


@pytest.mark.parametrize("given", [Spring, Spring()])
def test_a_law_of_a_class_or_an_object(tmp_path: Path, given: Any) -> None:
    campaign = si.read_campaign(write_springs(tmp_path, 4e5), component=given)
    bundle = si.fit(campaign)
    assert bundle.component is not None and bundle.component.file is None
    assert "stiffness_n_per_m" in str(bundle)
    found = si.diagnose(campaign, bundle)
    assert found.verdict == "effects-found"
    assert [e.id for e in found.effects] == ["hardening"]
    numbers = {**found.bundle.component.parameters, **found.bundle.effects[0].numbers()}  # type: ignore[union-attr]
    assert numbers["cubic_n_per_m3"].value == pytest.approx(4e5, rel=0.02)
    assert numbers["stiffness_n_per_m"].value == pytest.approx(800.0, rel=0.01)
    errors = found.residual["force_n"]
    assert errors.after == pytest.approx(0.02, rel=0.15) and errors.before > 3.0 * errors.after


def test_a_law_without_a_fitting_term_is_unexplained(tmp_path: Path) -> None:
    class Bare(Spring):
        terms = ()

    campaign = si.read_campaign(write_springs(tmp_path, 4e5), component=Bare)
    found = si.diagnose(campaign, si.fit(campaign))
    assert found.verdict == "unexplained"
    assert found.detail.to_json()["unexplained"][0]["regressor"] == "position_m"


@pytest.mark.usefixtures("servo_found")
def test_several_processes_run_the_file_again(servo: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SYSID_JOBS", "2")
    campaign = si.read_campaign(servo / "campaign.toml", component=f"{MOTOR}:GearedMotor")
    found = si.diagnose(campaign, read_bundle(servo / "b.json"))
    assert [e.id for e in found.effects] == ["unbalance"] and found.record.is_complete
