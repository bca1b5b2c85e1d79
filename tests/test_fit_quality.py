"""A fit judges itself: numbers, test for lack of fit, verdict; nonsense is no result."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from friction_trials import UNWRITTEN
from golden_folder import BUNDLED, BUNDLES, golden_bundle
from test_components_tank import made as made_tank
from test_components_valves import swept, timed
from test_valve_pwm import make_rig, make_trials, samples_of

import sysid as si
from sysid.blocks.quality import quality_name, quality_table
from sysid.commands.app import main
from sysid.diagnosis.bench.component import Component
from sysid.diagnosis.bench.fitting import fit_law
from sysid.errors import NotIdentifiedError
from sysid.estimation.linear import Estimate
from sysid.estimation.quality import (
    LEAST_EXPLAINED,
    NOT_TESTABLE,
    SCATTER_TIMES,
    USABLE_SHARE,
    FitQuality,
    LackOfFit,
    lack_of_fit_text,
    repeated_scatter,
    repeats_test,
    runs_test,
    scatter_test,
)
from sysid.friction import fit_friction
from sysid.identification.valve_pwm.quality import require_sign
from sysid.io.campaign import Campaign, read_campaign
from sysid.io.logs import Trial, read_log, with_channels
from sysid.io.rig import Rig
from sysid.parameters import Bundle, Parts, read_bundle
from sysid.parameters.quality import QualityRecord, qualities_in
from sysid.pipeline.fit import fit_campaign
from sysid.pipeline.pages.report import render_report
from sysid.types import FloatArray
from sysid.valve_pwm import fit_valve_pwm


def judged(rmse: float, scatter: float | None = None, spread: float = 1.0) -> FitQuality:
    return FitQuality("effort", "Nm", 100, rmse, spread, scatter=scatter)


# --- the judgement itself -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("quality", "verdict", "refused"),
    [
        (judged(0.05), "good", False),
        (judged(0.2), "usable", False),
        (judged(0.6), "poor: the law explains 64 %", False),
        (judged(0.8), "poor: the law explains 36 %", True),
        (judged(0.4, scatter=0.39), "good", False),
        (judged(0.9, scatter=0.9), "poor: the scatter is as large", False),
        (judged(0.9, scatter=0.1), "poor: the law explains 19 %", True),
        (judged(0.1, spread=0.0), "poor: the effort does not vary", True),
        (
            dataclasses.replace(judged(0.01), impossible=("it is below zero",)),
            "impossible: it is below",
            False,
        ),
    ],
)
def test_the_verdict_goes_by_what_is_missed_beyond_the_scatter(
    quality: FitQuality, verdict: str, refused: bool
) -> None:
    assert quality.verdict.startswith(verdict)
    assert quality.explains_too_little is refused


def test_a_significant_lack_of_fit_is_no_good_fit() -> None:
    """By whichever test, and where the scatter hides it from the error."""
    for method in ("repeats", "runs"):
        for p_value, verdict in ((0.5, "good"), (1e-3, "usable: lack of fit")):
            told = LackOfFit(method, 3.0, p_value)
            for quality in (judged(0.05), judged(0.4, scatter=0.39)):
                found = dataclasses.replace(quality, lack_of_fit=told)
                assert found.verdict.startswith(verdict)
                said = lack_of_fit_text(found.to_json()["lack_of_fit"])
                assert said.startswith("significant") is (found.verdict != "good")
    # So is a residual above a scatter that is known, beyond that scatter's own error.
    for rmse, verdict in ((0.012, "good"), (0.015, "usable: lack of fit"), (0.3, "usable")):
        told = scatter_test(rmse, 0.01)
        found = dataclasses.replace(judged(rmse, scatter=0.01), lack_of_fit=told)
        assert told.is_significant is (rmse > 0.013)
        assert found.verdict == verdict


def test_numbers_are_those_of_the_signal() -> None:
    x = np.linspace(-1.0, 1.0, 200)
    left = 0.1 * np.cos(40.0 * x)
    about_mean = FitQuality.of("effort", "Nm", 5.0 + 3.0 * x, left, has_constant=True)
    about_zero = FitQuality.of("effort", "Nm", 5.0 + 3.0 * x, left, has_constant=False)
    y = 5.0 + 3.0 * x
    assert about_mean.rmse == pytest.approx(np.sqrt(np.mean(left**2)))
    assert about_mean.share == pytest.approx(about_mean.rmse / np.std(y))
    assert about_mean.r2 == pytest.approx(1.0 - np.sum(left**2) / np.sum((y - y.mean()) ** 2))
    assert about_zero.share == pytest.approx(about_mean.rmse / np.sqrt(np.mean(y**2)))


def test_a_true_law_under_any_noise_is_never_refused() -> None:
    """Friction of one direction hardly varies; its scatter may exceed all that viscous adds."""
    rng = np.random.default_rng(11)
    for scatter in (0.01, 0.1, 0.3):
        speed = np.repeat([0.5, 1.0, 1.5], 5)
        truth = 1.0 + 0.02 * speed
        measured = truth * (1.0 + scatter * rng.normal(size=15))
        found = FitQuality.of(
            "friction", "Nm", measured, measured - truth,
            has_constant=False, scatter=repeated_scatter(measured - truth, speed),
        )  # fmt: skip
        assert found.verdict == "good" and not found.explains_too_little


def test_p_values_of_repeats_are_uniform_and_see_a_wrong_law() -> None:
    rng = np.random.default_rng(5)
    cells = np.repeat(np.arange(6), 4)
    x = np.column_stack([np.ones(24), cells])
    p_values = []
    for _ in range(400):
        y = 2.0 + 0.3 * cells + rng.normal(size=24)
        left = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
        p_values.append(repeats_test(left, cells, 2).p_value or 0.0)
    assert np.mean(np.array(p_values) < 0.05) == pytest.approx(0.05, abs=0.03)
    assert np.median(p_values) == pytest.approx(0.5, abs=0.1)
    y = 0.5 * (cells - 2.5) ** 2 + 0.3 * rng.normal(size=24)
    left = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    assert (repeats_test(left, cells, 2).p_value or 1.0) < 1e-4


def test_runs_are_normal_for_noise_and_few_for_waves() -> None:
    rng = np.random.default_rng(7)
    z = [runs_test([rng.normal(size=80), rng.normal(size=40)]).statistic or 0.0 for _ in range(500)]
    assert np.mean(z) == pytest.approx(0.0, abs=0.15)
    assert np.std(z) == pytest.approx(1.0, abs=0.1)
    wave = runs_test([np.sin(np.arange(200) / 10.0)])
    assert wave.statistic is not None and wave.statistic < -10.0


def test_what_cannot_be_tested_says_so() -> None:
    ones = np.ones(5)
    assert repeats_test(ones, np.arange(5), 2) == NOT_TESTABLE
    assert scatter_test(1.0, 0.0) == NOT_TESTABLE
    assert runs_test([ones]) == NOT_TESTABLE
    assert repeated_scatter(ones, np.arange(5)) is None
    assert lack_of_fit_text(NOT_TESTABLE.to_json()) == "not testable from these tests"
    assert lack_of_fit_text(scatter_test(3.0, 2.0).to_json()) == "residual 1.5 times the scatter"
    assert (
        lack_of_fit_text(scatter_test(2.001, 2.0).to_json()) == "residual as large as the scatter"
    )


def test_the_thresholds_are_in_order() -> None:
    refused = np.sqrt(1.0 - LEAST_EXPLAINED)
    assert 0.0 < USABLE_SHARE < refused and SCATTER_TIMES > 1.0


# --- every kind of fit says it ------------------------------------------------------------


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    return read_campaign(BUNDLED / "campaign.toml")


@pytest.fixture(scope="module")
def bundle(campaign: Campaign) -> Bundle:
    """The bundled campaign, PWM of one valve, with the surface that is fast to fit."""
    logs = tuple(e for e in campaign.logs if e.kind != "valve-pwm" or e.valve == "a")
    return fit_campaign(dataclasses.replace(campaign, logs=logs), surface="bipolynomial").bundle


def test_a_healthy_campaign_is_judged_whole_and_never_poor(bundle: Bundle) -> None:
    found = bundle.qualities()
    assert set(found) == {
        "friction, friction-static",
        "friction, friction-sliding",
        "friction, friction-motion",
        "valves.a.pwm.fill.bipolynomial",
        "valves.a.pwm.discharge.bipolynomial",
        "valves.a.pwm.averaged, fill",
        "valves.a.pwm.averaged, discharge",
        *(f"valves.{side}.discrete, {way}" for side in "ab" for way in ("fill", "discharge")),
    }
    assert not [place for place, one in found.items() if one.is_doubtful]
    for one in found.values():
        assert one.r2 == pytest.approx(1.0 - one.rmse_share**2)
    assert found["friction, friction-sliding"].lack_of_fit.method == "repeats"
    assert found["valves.a.discrete, fill"].lack_of_fit.method == "scatter"
    assert found["valves.a.discrete, fill"].lack_of_fit.statistic == pytest.approx(1.0, abs=0.1)


def test_the_judgement_outlives_the_file(bundle: Bundle, tmp_path: Path) -> None:
    path = tmp_path / "bundle.json"
    si.write_bundle(bundle, path)
    assert read_bundle(path).qualities() == bundle.qualities()


def test_a_bundle_of_before_reads_and_has_none() -> None:
    old = read_bundle(golden_bundle(BUNDLES[0]))
    assert old.qualities() == {}


def test_the_report_shows_every_fit(bundle: Bundle, campaign: Campaign) -> None:
    html = render_report(campaign=campaign, bundle=bundle)
    section = html[html.index('id="fits"') :]
    for place, one in bundle.qualities().items():
        assert quality_name(place) in section
        assert one.verdict in section


def test_the_report_opens_with_what_is_poor(bundle: Bundle, campaign: Campaign) -> None:
    assert bundle.friction is not None and isinstance(bundle.friction.quality, dict)
    wrong = bundle.friction.quality["friction-motion"].replaced(verdict="impossible: it is -3 Nm")
    friction = bundle.friction.replaced(quality={"friction-motion": wrong})
    html = render_report(campaign=campaign, bundle=bundle.replaced(friction=friction))
    top = html[: html.index('id="data"')]
    assert "Friction, motion: impossible: it is \N{MINUS SIGN}3 N·m" in top


def test_an_old_bundle_has_a_report_without_the_section(bundle: Bundle, campaign: Campaign) -> None:
    assert bundle.friction is not None
    bare = bundle.without("valves").replaced(friction=bundle.friction.without("quality"))
    assert 'id="fits"' not in render_report(campaign=campaign, bundle=bare)


def test_the_command_prints_it_and_json_holds_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["fit", "friction", str(BUNDLED / "friction_sliding.parquet"), *UNWRITTEN]
    assert main(words) == 0
    printed = capsys.readouterr().out
    assert "How well the laws follow their tests" in printed
    assert "Friction, constant effort" in printed and "good" in printed
    assert main([*words, "--json"]) == 0
    held = json.loads(capsys.readouterr().out)["friction"]["quality"]["friction-sliding"]
    assert {"rmse", "rmse_share", "r2", "lack_of_fit", "verdict"} <= set(held)


def test_results_of_the_library_show_it() -> None:
    log = si.read_log(BUNDLED / "valve_discrete_a.parquet")
    found = si.fit_valve_discrete(log, find_ratio=False)
    assert "R2" in str(found) and "good" in str(found)
    assert found["a"].quality["fill"].r2 > 0.999


@pytest.mark.parametrize(
    ("part", "place"),
    [
        (lambda: made_tank(3), "valves.a.discrete, discharge"),
        (lambda: swept([]), "valves.a.steady"),
        (lambda: timed([], (0.04, 0.05)), "valves.a.timing"),
    ],
)
def test_parts_on_a_bench_are_judged(part: Callable[[], Component], place: str) -> None:
    component = part()
    parts: Parts = fit_law(component, (), range(len(component.tests))).part()
    found = dict(qualities_in(parts.valves, "valves"))
    assert list(found) == [place]
    assert found[place].verdict == "good"
    assert found[place].unit == component.unit


# --- nonsense is no result ----------------------------------------------------------------


def by_test(frame: pd.DataFrame, column: str, change: Callable[[FloatArray], FloatArray]) -> Any:
    parts = [change(g[column].to_numpy()) for _, g in frame.groupby("test", sort=False)]
    return frame.assign(**{column: np.concatenate(parts)})


def sine(pressure: FloatArray) -> FloatArray:
    noise = 150.0 * np.random.default_rng(2).normal(size=len(pressure))
    return np.asarray(2e5 + 1e5 * np.sin(0.005 * np.arange(len(pressure))) + noise)


@pytest.mark.parametrize("change", [lambda p: p[::-1], sine], ids=["backwards", "sine"])
def test_a_valve_whose_pressure_does_something_else_is_exit_3(
    change: Callable[[FloatArray], FloatArray],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    frame = pd.read_parquet(BUNDLED / "valve_discrete_a.parquet")
    by_test(frame, "pressure_a_pa", change).to_parquet(tmp_path / "log.parquet")
    written = tmp_path / "bundle.json"
    words = [
        "fit",
        "valve-discrete",
        str(tmp_path / "log.parquet"),
        "-o",
        str(written),
        "--no-report",
    ]
    assert main([*words, "--rig", str(BUNDLED / "rig.toml")]) == 3
    said = capsys.readouterr().err
    assert "of the pressure while discharging" in said and "check for a wrong unit" in said
    assert not written.exists()


def test_a_campaign_says_which_valve_is_nonsense_and_leaves_it_out(
    campaign: Campaign, tmp_path: Path
) -> None:
    entries = {e.valve: e for e in campaign.logs if e.kind == "valve-discrete"}
    frame = pd.read_parquet(entries["a"].path)
    path = tmp_path / "a.parquet"
    by_test(frame, "pressure_a_pa", lambda p: p[::-1]).to_parquet(path)
    logs = (dataclasses.replace(entries["a"], path=path, file=path.name), entries["b"])
    found = fit_campaign(dataclasses.replace(campaign, logs=logs))
    assert found.bundle.valve("a").discrete is None
    assert found.bundle.valve("b").discrete is not None
    assert any("valve A, the law explains" in n for n in found.notices)


@pytest.mark.parametrize("direction", ["fill", "discharge"])
def test_a_flow_of_the_wrong_sign_gives_no_surface(direction: str) -> None:
    rig = make_rig()
    samples = samples_of(make_trials(), rig, "a", filling=direction == "fill")
    require_sign(samples, direction)
    with pytest.raises(NotIdentifiedError, match="the flow has the wrong sign"):
        require_sign(dataclasses.replace(samples, flow=-samples.flow), direction)


def test_a_pressure_mirrored_at_the_atmosphere_gives_no_surface() -> None:
    mirrored = [
        with_channels(t, pressure_a_pa=1e5 - 0.3 * (t["pressure_a_pa"] - 1e5))
        for t in make_trials(directions=("fill",))
    ]
    with pytest.raises(NotIdentifiedError, match="no usable test"):
        fit_valve_pwm(mirrored, make_rig())


def friction_trials(campaign: Campaign, name: str) -> list[Trial]:
    return list(read_log(BUNDLED / f"{name}.parquet", campaign.rig).trials)


def scaled(trials: list[Trial], factor: float, rig: Rig) -> list[Trial]:
    name = rig.effort_channel
    return [with_channels(t, **{name: factor * t[name]}) for t in trials]


def test_a_start_up_torque_out_of_proportion_is_no_result(campaign: Campaign) -> None:
    rig = dataclasses.replace(campaign.rig, motor=None)
    static = friction_trials(campaign, "friction_static")
    sliding = friction_trials(campaign, "friction_sliding")
    fit_friction([*static, *sliding], rig).require_possible()
    found = fit_friction([*scaled(static, 1000.0, rig), *sliding], rig)
    with pytest.raises(NotIdentifiedError, match=r"static_nm is .* times what coulomb_nm is"):
        found.require_possible()
    assert found.quality["friction-static"].verdict.startswith("impossible")
    assert found.quality["friction-sliding"].verdict == "good"


def test_a_start_up_torque_at_the_motors_limit_is_no_result(campaign: Campaign) -> None:
    """Volts as Nm: the command is clipped at the limit, and every ramp ends there."""
    rig = campaign.rig
    trials = scaled(friction_trials(campaign, "friction_static"), 50.0, rig)
    found = fit_friction(trials, rig, kind="static")
    assert found.static_nm.value == pytest.approx(rig.max_effort, rel=1e-3)
    with pytest.raises(NotIdentifiedError, match=r"motor's declared limit.* times its scatter"):
        found.require_possible()


def test_friction_beyond_motor_and_cylinder_is_no_result(campaign: Campaign) -> None:
    found = fit_friction(friction_trials(campaign, "friction_sliding"), campaign.rig)
    assert not found.impossible
    gauge = campaign.rig.air.supply_pressure_pa - campaign.rig.air.atmospheric_pressure_pa
    cylinder = campaign.rig.cylinder
    assert found.most_effort == pytest.approx(
        campaign.rig.max_effort + gauge * cylinder.area_a_m2 * cylinder.pitch_radius_m
    )
    beyond = Estimate.symmetric(1.1 * found.most_effort, 0.01, "Nm", 9.0)
    wrong = dataclasses.replace(found, parameters={**found.parameters, "coulomb": beyond})
    with pytest.raises(NotIdentifiedError, match="motor and cylinder together give at most"):
        wrong.require_possible()


def test_impossible_friction_of_a_campaign_carries_its_verdict(
    campaign: Campaign, tmp_path: Path
) -> None:
    """The diagnosis needs the number: a missing effect may cause it; the bundle says so."""
    (entry,) = campaign.select(["friction-motion"])
    frame = pd.read_parquet(entry.path).assign(motor_torque_nm=lambda f: -f["motor_torque_nm"])
    path = tmp_path / "motion.parquet"
    frame.to_parquet(path)
    logs = (dataclasses.replace(entry, path=path, file=path.name),)
    found = fit_campaign(dataclasses.replace(campaign, logs=logs))
    judged = found.bundle.qualities()["friction, friction-motion"]
    assert judged.verdict.startswith("impossible: coulomb_nm is")
    assert any(n.startswith("friction tests: coulomb_nm is") for n in found.notices)


def test_a_record_and_its_table_say_the_same() -> None:
    record = QualityRecord.of(judged(0.2))
    table = quality_table({"valves.b.pwm.fill.ann": record})
    assert table.rows[0][0] == "Valve B, PWM, filling, network"
    assert table.rows[0][3:] == ("20", "0.9600", "not testable from these tests", "usable")
    assert not record.is_doubtful
