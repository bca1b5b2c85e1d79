"""Open-loop validation: start states, refusals, errors, and what the bundle gets of them.

The logs come from the generator, whose plant is written and integrated independently, with no
scatter of friction from test to test: with the true parameters only the sensors' noise is left.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from datasets.generator.campaign import (
    SMALL,
    GeneratedCampaign,
    drawn_effects,
    make_campaign,
)
from datasets.generator.files import write_log
from datasets.generator.one_chamber import scaled
from datasets.generator.rigs import rig_toml
from datasets.generator.runs import Commands, GeneratedTest, at_atmosphere, simulated
from sysid.errors import InputError, NotIdentifiedError
from sysid.estimation.linear import Estimate
from sysid.io.campaign import MOTION_KINDS, Campaign, read_campaign
from sysid.io.logs import Trial, with_channels
from sysid.io.rig import Rig, rig_from_content
from sysid.parameters import Bundle, EffectEntry, LogRecord, Parts, read_bundle, write_bundle
from sysid.parameters.assembled_model import (
    model_from_bundle,
    parameters_from_bundle,
    surfaces_from_bundle,
)
from sysid.parameters.friction import Friction
from sysid.parameters.valves import (
    LAW_KEYS,
    AveragedRecord,
    FittedValves,
    PwmDirections,
    PwmSurfaces,
    Valve,
)
from sysid.pipeline.pages.opening import verdict
from sysid.pipeline.verdict import verdict_lines
from sysid.plant.arrays import put_together, take_apart
from sysid.plant.base import Array, array_namespace, filling_flow
from sysid.plant.effects.chamber import TubeLag
from sysid.plant.effects.entry import LIKE
from sysid.recording.motion_tests import MotionTest, channel_noise, prepare, prepare_all
from sysid.recording.simulation import simulate_segments
from sysid.recording.start_states import ChannelNoise, state_at_rest, valve_edges
from sysid.refinement.refine import motion_tests_of
from sysid.surfaces import Bipolynomial
from sysid.types import FloatArray
from sysid.validation import shown_tests
from sysid.validation.open_loop import validate
from sysid.validation.residual_tests import fit_percentage
from sysid.validation.results import Errors, LogResult, ValidationResult

SEED = 1
STEMS = ("motion_motor_2", "motion_pwm_2", "motion_discrete_2")


def generated(orientation: str = "horizontal", motion: str = "rotary") -> GeneratedCampaign:
    return make_campaign(
        SEED,
        size=SMALL,
        scatter=0.0,
        orientation=orientation,
        motion=motion,
        kinds=MOTION_KINDS,
        stems=STEMS,
    )


def written(made: GeneratedCampaign, folder: Path) -> Campaign:
    (folder / "rig.toml").write_text(rig_toml(made.rig.content))
    lines = ['rig = "rig.toml"']
    for log in made.logs:
        write_log(folder / f"{log.stem}.csv", log.tests, made.rig)
        lines += ["[[log]]", f'kind = "{log.kind}"', f'file = "{log.stem}.csv"', 'use = "holdout"']
    (folder / "campaign.toml").write_text("\n".join(lines) + "\n")
    return read_campaign(folder / "campaign.toml")


def estimate(value: float, unit: str = "SI", interval: Any = None) -> Estimate:
    return Estimate(value, 0.0, unit, interval or (math.nan, math.nan))


def true_bundle(made: GeneratedCampaign, rig: Rig) -> Bundle:
    friction = {k: estimate(v) for k, v in made.truth["friction"].items()}
    valves = {
        side: {"discrete": {k: estimate(v) for k, v in law.items()}}
        for side, law in made.truth["valves"].items()
    }
    parts = Parts(Friction.model_validate(friction), FittedValves.model_validate(valves))
    return Bundle.new(rig, parts, [])


def with_friction(bundle: Bundle, **fields: Estimate) -> Bundle:
    """The bundle with other numbers in its friction."""
    assert bundle.friction is not None
    return bundle.replaced(friction=bundle.friction.replaced(**fields))


@pytest.fixture(scope="module")
def made() -> GeneratedCampaign:
    return generated()


@pytest.fixture(scope="module")
def campaign(made: GeneratedCampaign, tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    return written(made, tmp_path_factory.mktemp("campaign"))


@pytest.fixture(scope="module")
def bundle(made: GeneratedCampaign, campaign: Campaign) -> Bundle:
    return true_bundle(made, campaign.rig)


@pytest.fixture(scope="module")
def result(campaign: Campaign, bundle: Bundle) -> ValidationResult:
    return validate(campaign, bundle)


def trial_of(test: GeneratedTest) -> Trial:
    channels = {k: v for k, v in test.columns.items() if k != "time_s"}
    return Trial(test.label, test.columns["time_s"], channels, f"log.csv, test {test.label}")


@pytest.mark.parametrize(("slower", "times"), [(10.0, 10.0), (0.2, 1.0)])
def test_segments_of_a_slow_rig_last_as_many_times_as_long(
    made: GeneratedCampaign,
    campaign: Campaign,
    bundle: Bundle,
    slower: float,
    times: float,
    tmp_path: Path,
) -> None:
    """They, and the run-ups before them, hold as much of the flows; a fast rig's start states need
    as many rows as any."""
    other = scaled(made, time=slower)
    slow = written(other, tmp_path)
    lengths, run_ups = [], []
    for logs, own in ((campaign, bundle), (slow, true_bundle(other, slow.rig))):
        tests = motion_tests_of(logs, logs.logs, own, own.model(logs.rig), [])
        segments = [(s, t.period) for t in tests for s in t.segments]
        lengths.append(np.median([(s.stop - s.start) * period for s, period in segments]))
        run_ups.append(np.median([t.run_up_rows * t.period for t in tests]))
    # What is like the reference rig is taken to be as slow as that.
    assert times / LIKE < lengths[1] / lengths[0] < times * LIKE
    assert run_ups[1] / run_ups[0] == pytest.approx(lengths[1] / lengths[0], rel=0.01)
    assert slower > 1.0 or lengths[1] == pytest.approx(lengths[0], rel=0.01)


# --- the true parameters leave nothing but noise -----------------------------------------


def test_the_true_parameters_leave_only_noise(
    made: GeneratedCampaign, result: ValidationResult
) -> None:
    logs = result.select(model="discrete")
    assert [log.file for log in logs] == [f"{stem}.csv" for stem in STEMS]
    # The converter's step adds to the generator's noise.
    noise = np.hypot(made.rig.truth.pressure_noise_pa, 26.0 / np.sqrt(12.0))
    for log in logs:
        assert (log.use, log.model) == ("holdout", "discrete")
        for name in ("pressure_a_pa", "pressure_b_pa"):
            channel = log.channels[name]
            assert channel.errors.rmse == pytest.approx(noise, rel=0.05)
            assert channel.noise_floor == pytest.approx(noise, rel=0.1)
            assert channel.ratio == pytest.approx(1.0, abs=0.1)
            assert [h.horizon_s for h in channel.horizons] == [0.1, 1.0]
            for horizon in channel.horizons:
                assert horizon.segments >= 4
                assert horizon.rmse == pytest.approx(noise, rel=0.2)
        position = log.channels["theta_rad"]
        assert position.errors.fit_percentage is not None
        assert position.errors.fit_percentage > 99.0
        short, long = (h.rmse for h in position.horizons)
        assert short is not None
        assert long is not None
        assert short < long < 2e-3


def test_white_pressure_residuals_pass_as_often_as_they_should(result: ValidationResult) -> None:
    tests = [t for log in result.select(model="discrete") for t in log.tests]
    white = [t.channels[c].whiteness for t in tests for c in t.channels if "pressure" in c]
    assert len(white) == 8
    # At 5 % false alarms, three or more of eight have a probability of 0.6 %.
    assert sum(w is not None and not w.passed for w in white) <= 2
    pulsed = next(t for t in tests if t.kind == "motion-pwm")
    assert {"duty_a", "duty_b"} <= set(pulsed.channels["pressure_a_pa"].inputs)


def test_logs_of_two_folders_may_share_a_name(
    made: GeneratedCampaign, campaign: Campaign, bundle: Bundle, tmp_path: Path
) -> None:
    """None disappears behind the other, whatever their order: day 2's position is out of scale."""
    good = campaign.logs[0].path.read_text().splitlines()
    column = good[0].split(",").index("theta_rad")
    rows = [line.split(",") for line in good[1:]]
    bad = [[*r[:column], str(0.4 * float(r[column])), *r[column + 1 :]] for r in rows]
    texts = {"day1": "\n".join(good), "day2": "\n".join([good[0], *map(",".join, bad)])}
    (tmp_path / "rig.toml").write_text(rig_toml(made.rig.content))
    for order in (("day1", "day2"), ("day2", "day1")):
        lines = ['rig = "rig.toml"']
        for day in order:
            (tmp_path / day).mkdir(exist_ok=True)
            (tmp_path / day / "motion.csv").write_text(texts[day])
            lines += ["[[log]]", f'kind = "{campaign.logs[0].kind}"']
            lines += [f'file = "{day}/motion.csv"', 'use = "holdout"']
        (tmp_path / "campaign.toml").write_text("\n".join(lines) + "\n")
        found = validate(read_campaign(tmp_path / "campaign.toml"), bundle)
        names = [f"{day}/motion.csv" for day in order]
        assert [log.name for log in found.logs] == names
        assert {log.file for log in found.logs} == {"motion.csv"}
        assert list(dict.fromkeys(test.log for test in shown_tests.tests_of(found))) == names
        count = sum(len(log.tests) for log in found.logs)
        assert len(shown_tests.tests_of(found)) == count
        said = verdict(bundle, found).sentence
        assert "does not follow" in said and f"{count} held-out tests" in said
        recorded = bundle.replaced(validation=found.record())
        assert "on 2 held-out logs" in verdict_lines(recorded, None)[0]


def test_a_wrong_friction_shows(
    campaign: Campaign, bundle: Bundle, result: ValidationResult
) -> None:
    assert bundle.friction is not None and bundle.friction.coulomb_nm is not None
    more = estimate(1.3 * bundle.friction.coulomb_nm.value)
    wrong = validate(campaign, with_friction(bundle, coulomb_nm=more), kinds=("motion-motor",))
    right = result.logs[0]
    assert wrong.logs[0].file == right.file
    error, least = (r.channels["theta_rad"].horizons[1].rmse for r in (wrong.logs[0], right))
    assert error is not None
    assert least is not None
    assert error > 10.0 * least
    test = wrong.logs[0].tests[0]
    whiteness = test.channels["theta_rad"].whiteness
    assert whiteness is not None
    assert not whiteness.passed
    growth = test.growth["theta_rad"]
    assert growth[0] < 1e-4
    assert growth[-1] > 10.0 * growth[round(0.05 * len(growth))]


@pytest.mark.parametrize(
    ("orientation", "motion"), [("vertical", "rotary"), ("vertical", "linear")]
)
def test_other_rigs(orientation: str, motion: str, tmp_path: Path) -> None:
    made = generated(orientation, motion)
    campaign = written(made, tmp_path)
    result = validate(campaign, true_bundle(made, campaign.rig))
    position = "position_m" if motion == "linear" else "theta_rad"
    for log in result.logs:
        assert set(log.channels) == {position, "pressure_a_pa", "pressure_b_pa"}
        assert log.channels["pressure_a_pa"].ratio == pytest.approx(1.0, abs=0.1)
        fit = log.channels[position].errors.fit_percentage
        assert fit is not None
        assert fit > 98.0


# --- what a bundle and a report get -------------------------------------------------------


def test_the_result_goes_into_a_bundle(
    result: ValidationResult, bundle: Bundle, tmp_path: Path
) -> None:
    path = tmp_path / "bundle.json"
    write_bundle(bundle.replaced(validation=result.record()), path)
    read = read_bundle(path).validation
    assert read is not None
    logs = read.validated()
    assert len(logs) == 4  # the test under PWM by the averaged law too
    for log in logs:
        assert {"file", "sha256", "use", "kind", "valve_model"} <= set(log.given())
        for channel in log.channels.values():
            assert {"rmse", "fit_percent", "noise_floor", "rmse_to_noise"} <= set(channel.given())
        assert isinstance(log.tests, list)
        for test in log.tests:
            assert test["channels"]["theta_rad"]["whiteness"]["band"] > 0.0


def test_arrays_are_kept(result: ValidationResult) -> None:
    test = result.logs[0].tests[0]
    residual = test.residual("theta_rad")
    assert residual.shape == test.time.shape
    error = np.sqrt(np.mean(residual[: test.counted] ** 2))
    assert test.channels["theta_rad"].errors.rmse == pytest.approx(error)
    assert result.select(use="fit") == ()
    averaged = result.select("holdout", "averaged")
    assert len(averaged) == 1
    assert len(result.select("holdout", "discrete")) == len(result.logs) - 1


def test_pooled_errors_are_those_of_all_samples() -> None:
    rng = np.random.default_rng(0)
    parts = [(rng.standard_normal(n), rng.standard_normal(n)) for n in (30, 70)]
    pooled = Errors.pooled([Errors.of(y, e) for y, e in parts])
    errors = np.concatenate([e for _, e in parts])
    spread = np.concatenate([y - y.mean() for y, _ in parts])
    assert pooled.samples == 100
    assert pooled.rmse == pytest.approx(np.sqrt(np.mean(errors**2)))
    assert pooled.largest == np.max(np.abs(errors))
    expected = 100.0 * (1.0 - np.linalg.norm(errors) / np.linalg.norm(spread))
    assert pooled.fit_percentage == pytest.approx(expected)


# --- provenance ---------------------------------------------------------------------------


def with_source(bundle: Bundle, log: LogResult, **changes: str) -> Bundle:
    entry = {"file": log.file, "sha256": log.sha256, "use": "fit", "kind": log.kind} | changes
    logs = [LogRecord.model_validate(entry)]
    return bundle.replaced(provenance=bundle.provenance.replaced(logs=logs))


def test_a_holdout_log_that_was_fitted_on_is_refused(
    campaign: Campaign, bundle: Bundle, result: ValidationResult
) -> None:
    leaked = with_source(bundle, result.logs[0], file="other_name.csv")
    with pytest.raises(InputError, match=r"held out.*was fitted on it \(other_name.csv\)"):
        validate(campaign, leaked)


def test_a_changed_log_is_refused(
    campaign: Campaign, bundle: Bundle, result: ValidationResult
) -> None:
    changed = with_source(bundle, result.logs[0], sha256="0" * 64)
    fitted = tuple(dataclasses.replace(entry, use="fit") for entry in campaign.logs)
    with pytest.raises(InputError, match="has changed since"):
        validate(dataclasses.replace(campaign, logs=fitted), changed)


def test_another_rig_file_is_said(campaign: Campaign, bundle: Bundle) -> None:
    air = {**campaign.rig.content["air"], "temperature_k": 280.0}
    other = bundle.replaced(rig_content={**bundle.rig_content, "air": air})
    found = validate(campaign, other, kinds=("motion-motor",))
    assert any("[air] differ" in notice for notice in found.notices)


# --- what a bundle must hold --------------------------------------------------------------


def test_parameters_are_the_bundles(bundle: Bundle, campaign: Campaign) -> None:
    p = parameters_from_bundle(bundle, campaign.rig)
    assert bundle.friction is not None and bundle.friction.coulomb_nm is not None
    assert p.coulomb_effort == bundle.friction.coulomb_nm.value
    law = bundle.valve("b").discrete
    assert law is not None
    assert p.c_dis_b == law.c_dis.value
    assert (p.inertia, p.offset) == (campaign.rig.total_inertia(), 0.0)
    more = with_friction(bundle, inertia_kg_m2=estimate(0.5), offset_nm=estimate(0.01))
    p = parameters_from_bundle(more, campaign.rig)
    # The base model has no offset: what a fit estimates beside friction is not part of it.
    assert (p.inertia, p.offset) == (0.5, 0.0)


def test_an_offset_of_the_friction_fit_is_said(campaign: Campaign, bundle: Bundle) -> None:
    for low, said in ((-0.01, False), (0.005, True)):
        with_offset = with_friction(bundle, offset_nm=estimate(0.01, interval=(low, 0.02)))
        found = validate(campaign, with_offset, kinds=("motion-motor",))
        assert any("offset of 0.01 Nm" in notice for notice in found.notices) == said


def test_negative_friction_is_said_and_taken_for_none(campaign: Campaign, bundle: Bundle) -> None:
    """What a lacking effect made of it is no reason to refuse to look for the effect."""
    spoilt = with_friction(bundle, coulomb_nm=estimate(-0.02, "Nm"))
    assert parameters_from_bundle(spoilt, campaign.rig).coulomb_effort == 0.0
    found = validate(campaign, spoilt, kinds=("motion-motor",))
    assert any("coulomb_nm is -0.02" in n for n in found.notices)


def test_an_incomplete_bundle_is_refused(bundle: Bundle, campaign: Campaign) -> None:
    with pytest.raises(NotIdentifiedError, match="holds no valve model"):
        validate(campaign, bundle.replaced(valves=FittedValves()))
    with pytest.raises(NotIdentifiedError, match="holds no friction"):
        validate(campaign, bundle.without("friction"))
    unknown = Estimate.unidentified("Nm s/rad", "one level only")
    with pytest.raises(NotIdentifiedError, match=r"one level only.*friction-sliding"):
        model_from_bundle(with_friction(bundle, viscous_nm_s_per_rad=unknown), campaign.rig)
    stribeck = EffectEntry(id="stribeck-friction", parameters={})
    with pytest.raises(InputError, match="stribeck"):
        bundle.with_effects([stribeck]).model(campaign.rig)


# --- PWM surfaces -------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class MeanLaw:
    """The mean of the discrete law itself as a valve's law under PWM: no surface is fitted to it.

    kg/s, kg/(s Pa^0.5), kg/(s Pa), Pa; `longer`: the delays' difference over the period.
    """

    choked_flow_fill_kg_s: Array
    c_fill: Array
    choked_flow_dis_kg_s: Array
    c_dis: Array
    supply: Array
    atmosphere: Array
    longer: Array

    def flow(self, duty: Array, pressure: Array) -> Array:
        xp = array_namespace(duty, pressure, self.supply)
        share = xp.clip(duty + self.longer, 0.0, 1.0)
        gap = self.supply - pressure
        unchoked = self.c_fill * xp.sign(gap) * xp.sqrt(xp.abs(gap))
        fill = xp.where(pressure <= 0.53 * self.supply, self.choked_flow_fill_kg_s, unchoked)
        unchoked = self.c_dis * (self.atmosphere - pressure)
        choked = pressure >= self.atmosphere / 0.53
        exhaust = xp.where(choked, -self.choked_flow_dis_kg_s, unchoked)
        return share * fill + (1.0 - share) * exhaust

    def fill(self, duty: Array, pressure: Array) -> Array:
        return array_namespace(pressure).maximum(self.flow(duty, pressure), 0.0)

    def discharge(self, duty: Array, pressure: Array) -> Array:
        return array_namespace(pressure).minimum(self.flow(duty, pressure), 0.0)

    def span(self, pressure: Array) -> Array:
        return self.fill(1.0, pressure) - self.discharge(0.0, pressure)


def mean_law(rig: Rig, law: dict[str, float]) -> MeanLaw:
    """The law of a valve on a rig."""
    assert rig.air is not None
    assert rig.pwm is not None
    assert rig.valves is not None
    flows = {name: law[name] for name in LAW_KEYS.values()}
    longer = (rig.valves.off_delay_s - rig.valves.on_delay_s) / rig.pwm.period_s
    lines = rig.air.supply_pressure_pa, rig.air.atmospheric_pressure_pa
    return MeanLaw(**flows, supply=lines[0], atmosphere=lines[1], longer=longer)


def fitted_surfaces(rig: Rig, law: dict[str, float]) -> PwmDirections:
    """A bundle's `pwm` part: bipolynomials fitted to the mean of the discrete law."""
    assert rig.air is not None
    assert rig.pwm is not None
    duty, pressure = (
        a.ravel()
        for a in np.meshgrid(
            np.linspace(0.02, 0.9, 45),
            np.linspace(rig.air.atmospheric_pressure_pa, rig.air.supply_pressure_pa, 80),
            indexing="ij",
        )
    )
    flow = mean_law(rig, law).flow(duty, pressure)
    parts = {}
    for direction, rows in (("fill", flow > 0.0), ("discharge", flow < 0.0)):
        surface = Bipolynomial().fit(np.column_stack([duty, pressure])[rows], flow[rows])
        content = {
            "pwm_period_s": rig.pwm.period_s,
            "supply_pressure_pa": rig.air.supply_pressure_pa,
            "bipolynomial": surface.to_dict(),
        }
        parts[direction] = PwmSurfaces.model_validate(content)
    return PwmDirections(**parts)


@pytest.fixture(scope="module")
def with_surfaces(made: GeneratedCampaign, campaign: Campaign, bundle: Bundle) -> Bundle:
    valves = {
        side: bundle.valve(side).replaced(pwm=fitted_surfaces(campaign.rig, law))
        for side, law in made.truth["valves"].items()
    }
    return bundle.replaced(valves=FittedValves(**valves))


def test_a_simulation_has_the_surface_itself(campaign: Campaign, with_surfaces: Bundle) -> None:
    found = surfaces_from_bundle(with_surfaces, campaign.rig, "bipolynomial")
    assert found is not None
    filling = with_surfaces.valve("b").surfaces("fill")
    assert filling is not None
    held = filling.surface("bipolynomial")
    assert held is not None
    surface = held.model()
    rng = np.random.default_rng(0)
    # Beyond the domain too, where both saturate.
    duty, pressure = rng.uniform(0.0, 1.0, 2000), rng.uniform(0.8e5, 3.4e5, 2000)
    exact = surface.flow(duty, pressure)[0]
    np.testing.assert_allclose(found[1].fill(duty, pressure), exact, rtol=1e-12)


def test_a_surface_is_the_same_in_jax(campaign: Campaign, with_surfaces: Bundle) -> None:
    from sysid.plant.jax_setup import jnp

    found = surfaces_from_bundle(with_surfaces, campaign.rig, "bipolynomial")
    assert found is not None
    duty, pressure = np.linspace(0.0, 1.0, 31), np.linspace(0.9e5, 3.3e5, 31)
    structure, numbers = take_apart(found[0])
    for shape in ((), (31, 1)):  # one law, and one a lane
        lanes = [jnp.asarray(np.broadcast_to(n, (*shape[:1], *n.shape))) for n in numbers]
        in_jax = put_together(structure, lanes)
        for name in ("fill", "discharge", "duty"):
            given = (duty - 0.5) * 1e-3 if name == "duty" else duty
            np.testing.assert_allclose(
                getattr(in_jax, name)(jnp.asarray(given), jnp.asarray(pressure)),
                getattr(found[0], name)(given, pressure),
                rtol=1e-12,
                atol=1e-18,
            )


def test_surfaces_of_another_period_are_refused(campaign: Campaign, with_surfaces: Bundle) -> None:
    assert surfaces_from_bundle(with_surfaces, campaign.rig, "ann") is None
    content = {**campaign.rig.content, "pwm": {"period_s": 0.01}}
    with pytest.raises(InputError, match=r"PWM period of 0\.005"):
        surfaces_from_bundle(with_surfaces, rig_from_content(content, "rig"), "bipolynomial")


def at_twice_the_supply(rig: Rig) -> Rig:
    air = rig.content["air"]
    assert isinstance(air, dict)
    doubled = {**air, "supply_pressure_pa": 2.0 * float(air["supply_pressure_pa"])}
    return rig_from_content({**rig.content, "air": doubled}, "rig")


def test_surfaces_of_another_supply_are_left_out(campaign: Campaign, with_surfaces: Bundle) -> None:
    rig = at_twice_the_supply(campaign.rig)
    with pytest.raises(InputError, match="was fitted at a supply of"):
        surfaces_from_bundle(with_surfaces, rig, "bipolynomial")
    held = dataclasses.replace(campaign, rig=rig)
    found = validate(held, with_surfaces, kinds=("motion-pwm",))
    assert {log.model for log in found.logs} == {"discrete", "averaged"}
    assert any("the bipolynomial model is excluded" in notice for notice in found.notices)


def test_choked_filling_is_scaled_to_another_supply(bundle: Bundle, campaign: Campaign) -> None:
    rig = at_twice_the_supply(campaign.rig)
    p, own = bundle.model(rig).parameters, bundle.model(campaign.rig).parameters
    flow = filling_flow(1.1e5, p.supply, p.choked_fill_a, p.c_fill_a, p.supply_reference)
    assert flow == pytest.approx(2.0 * own.choked_fill_a, rel=1e-12)
    laws = surfaces_from_bundle(bundle, rig, "averaged")
    assert laws is not None
    assert laws[0].fill(1.0, 1.1e5) == pytest.approx(flow, rel=1e-12)


def test_a_fitted_inertia_gets_what_the_payloads_differ_by(
    bundle: Bundle, campaign: Campaign
) -> None:
    inertia = {"equivalent_kg_m2": 0.5, "payload_mass_kg": 1.0, "payload_length_m": 0.3}
    fitted = with_friction(bundle, inertia_kg_m2=estimate(0.025, "kg m2"))
    rig = rig_from_content({**campaign.rig.content, "inertia": inertia}, "rig")
    own = campaign.rig.payload_inertia()
    assert fitted.model(rig).parameters.inertia == pytest.approx(0.025 + 0.09 - own)
    assert fitted.model(campaign.rig).parameters.inertia == 0.025
    held = dataclasses.replace(campaign, rig=rig)
    notices = validate(held, fitted, kinds=("motion-motor",)).notices
    assert any("what the payloads differ by is added" in notice for notice in notices)


def test_pulsed_motion_by_surfaces(campaign: Campaign, with_surfaces: Bundle) -> None:
    found = validate(campaign, with_surfaces, kinds=("motion-pwm", "motion-motor"))
    assert [(g.kind, g.model) for g in found.logs] == [
        ("motion-motor", "discrete"),
        ("motion-pwm", "discrete"),
        ("motion-pwm", "averaged"),
        ("motion-pwm", "bipolynomial"),
    ]
    assert any("no ann model" in n for n in found.notices)
    discrete, _, polynomial = found.logs[1:]
    for name in discrete.channels:
        # Nine terms do not follow a law that jumps where it chokes.
        assert polynomial.channels[name].errors.rmse > discrete.channels[name].errors.rmse


def test_the_averaged_law_follows_the_pulses_within_a_period(result: ValidationResult) -> None:
    """At the noise, as the law under the real pulses: the ripple is in its pressures."""
    averaged = result.select("holdout", "averaged")[0]
    assert (averaged.kind, averaged.file) == ("motion-pwm", "motion_pwm_2.csv")
    for name in ("pressure_a_pa", "pressure_b_pa"):
        assert averaged.channels[name].ratio == pytest.approx(1.0, abs=0.1)
    fit = averaged.channels["theta_rad"].errors.fit_percentage
    assert fit is not None
    assert fit > 99.0


def test_the_mean_flow_does_almost_what_the_pulses_do(
    made: GeneratedCampaign, bundle: Bundle, rig: Rig
) -> None:
    test = prepare(trial_of(made.log("motion_pwm_2").tests[0]), "motion-pwm", rig, 1.0)
    surfaces = tuple(mean_law(rig, made.truth["valves"][side]) for side in "ab")
    model = model_from_bundle(bundle, rig)
    runs = simulate_segments([(test, test.whole)], model, surfaces)
    for measured, simulated_, least in zip(test.measured, runs[0], (90.0, 80.0, 65.0), strict=True):
        fit = fit_percentage(measured, simulated_)
        assert fit is not None
        assert fit > least


def test_a_law_fitted_under_pwm_alone_simulates(
    made: GeneratedCampaign, bundle: Bundle, campaign: Campaign
) -> None:
    timing = campaign.rig.require("valves", "delays")
    difference = estimate(timing.off_delay_s - timing.on_delay_s, "s", (0.0, 1e-3))
    valves = {}
    for side, law in made.truth["valves"].items():
        flows = {k: estimate(law[k], "SI", (0.9 * law[k], 1.1 * law[k])) for k in LAW_KEYS.values()}
        fitted = AveragedRecord(**flows, delay_difference_s=difference)
        valves[side] = Valve(pwm=PwmDirections(averaged=fitted))
    alone = bundle.replaced(valves=FittedValves(**valves))
    result = validate(campaign, alone, kinds=("motion-pwm",))
    assert {log.model for log in result.logs} == {"averaged"}
    assert result.logs[0].channels["pressure_a_pa"].ratio == pytest.approx(1.0, abs=0.1)


# --- start states -------------------------------------------------------------------------


def true_states(made: GeneratedCampaign, test: GeneratedTest) -> FloatArray:
    c = test.columns
    names = ("valve_a", "valve_b", "duty_a", "duty_b")
    commands = Commands(c["motor_torque_nm"], *(c.get(name) for name in names))
    start = at_atmosphere(made.rig, test.truth["position"])
    return simulated(made.rig, made.rig.plant(), commands, start)


@pytest.mark.parametrize("stem", STEMS)
def test_start_states_are_as_good_as_they_say(made: GeneratedCampaign, stem: str) -> None:
    log = made.log(stem)
    rig = rig_from_content(made.rig.content, "rig")
    relative = []
    for test in log.tests:
        states = true_states(made, test)
        prepared = prepare(trial_of(test), log.kind, rig, 0.25)
        assert all(s.settled for s in prepared.segments)
        for segment in prepared.segments:
            error = segment.state.values - states[segment.start]
            relative.append(error / segment.state.std)
        # The first row: at rest, and the chambers at the atmosphere.
        whole = prepared.whole.state
        assert whole.values[1] == 0.0
        known = [0, 2, 3]
        assert np.all(np.abs(whole.values - states[0])[known] < 4.0 * whole.std[known])
    sizes = np.sqrt(np.mean(np.square(relative), axis=0))
    assert np.all(sizes < 1.6)
    assert np.all(sizes > 0.3)
    assert np.max(np.abs(relative)) < 6.0


def test_a_rest_counts_as_long_as_no_chamber_drifts(rig: Rig) -> None:
    """However long it is: a rig ten times slower rests ten times longer."""
    rng, rows = np.random.default_rng(4), 4000
    time = np.arange(rows) * 1e-3
    measured = rng.standard_normal((3, rows)) * np.array([[1e-4], [100.0], [100.0]])
    noise = ChannelNoise(np.array([1e-4, 100.0, 100.0]), 0.0)
    none = valve_edges(time, None, False, rig)
    still = state_at_rest(time, measured, noise, (none, none))
    assert still.samples[2] == rows and still.std[2] == pytest.approx(100.0 / np.sqrt(rows))
    leaking = measured + np.array([[0.0], [0.0], [2e3]]) * time
    found = state_at_rest(time, leaking, noise, (none, none))
    assert 1 < found.samples[2] < rows // 8
    assert abs(found.values[3]) < 5.0 * found.std[3]


def test_pulses_are_no_noise(made: GeneratedCampaign) -> None:
    test = made.log("motion_pwm_2").tests[0]
    rows = np.array([test.columns[k] for k in ("theta_rad", "pressure_a_pa", "pressure_b_pa")])
    true = np.hypot(made.rig.truth.pressure_noise_pa, 26.0 / np.sqrt(12.0))
    combed, plain = channel_noise(rows, 5).total, channel_noise(rows).total
    np.testing.assert_allclose(combed[1:], true, rtol=0.1)
    assert (plain[1:] > 1.3 * true).all()


# --- refusals -----------------------------------------------------------------------------


def test_segments_begin_with_what_the_effects_remember() -> None:
    """A tube still passes what its valve let through before: without it the air is missing."""
    seed = 4  # a rig whose pressures do not slide where the law jumps
    effects = drawn_effects(seed, [("tube-lag", "first-order", 1.0)])
    made = make_campaign(
        seed,
        size=SMALL,
        scatter=0.0,
        kinds=("motion-pwm",),
        stems=("motion_pwm_2",),
        effects=effects,
    )
    rig = rig_from_content(made.rig.content, "rig.toml")
    test = prepared(trial_of(made.logs[0].tests[0]), rig)
    first, *others = test.segments
    assert first.run_up is not None and first.run_up.start == 0
    for segment in others:
        assert segment.run_up is not None and segment.run_up.stop == segment.start + 1
        assert 0.3 < test.time[segment.start] - test.time[segment.run_up.start] < 0.5
    model = true_bundle(made, rig).model(rig) + TubeLag(effects[0].values["tube_lag_s"])
    missing = [dataclasses.replace(s, run_up=None) for s in test.segments]
    errors = []
    for segments in (test.segments, missing):
        runs = simulate_segments([(test, s) for s in segments], model)
        pairs = zip(runs, segments, strict=True)
        left = [run - test.measured[:, s.start : s.stop] for run, s in pairs]
        own = [np.sqrt(np.mean(r**2, axis=1)) / test.noise.total for r in left]
        errors.append(np.median(own, axis=0))
    assert (errors[0][1:] < 1.1).all()
    assert (errors[1][1:] > 1.3).all() and errors[1][0] > 3.0 * errors[0][0]


@pytest.fixture
def pulsed(made: GeneratedCampaign) -> Trial:
    return trial_of(made.log("motion_pwm_2").tests[0])


@pytest.fixture
def rig(made: GeneratedCampaign) -> Rig:
    return rig_from_content(made.rig.content, "rig.toml")


def part(trial: Trial, rows: Any) -> Trial:
    channels = {k: v[rows] for k, v in trial.channels.items()}
    return dataclasses.replace(trial, time=trial.time[rows], channels=channels)


def prepared(trial: Trial, rig: Rig, kind: str = "motion-pwm") -> MotionTest:
    return prepare(trial, kind, rig, 1.0)


def test_a_start_in_motion_is_refused(pulsed: Trial, rig: Rig) -> None:
    speed = np.abs(np.gradient(pulsed["theta_rad"], 0.001))
    fast = int(np.argmax(speed > 0.5 * speed.max()))
    with pytest.raises(InputError, match=r"test 1: starts while moving.*cut off"):
        prepared(part(pulsed, slice(fast, None)), rig)


def test_a_start_in_motion_is_left_out_where_others_are_at_rest(pulsed: Trial, rig: Rig) -> None:
    speed = np.abs(np.gradient(pulsed["theta_rad"], 0.001))
    moving = part(pulsed, slice(int(np.argmax(speed > 0.5 * speed.max())), None))
    tests, notices = prepare_all([pulsed, moving], "motion-pwm", rig, 1.0)
    assert [len(t.time) for t in tests] == [len(pulsed)]
    (notice,) = notices
    assert notice.startswith("excluded: ") and "starts while moving" in notice
    with pytest.raises(InputError, match="starts while moving"):
        prepare_all([moving], "motion-pwm", rig, 1.0)


def test_a_motor_that_starts_at_once_is_no_start_in_motion(
    made: GeneratedCampaign, rig: Rig
) -> None:
    trial = trial_of(made.log("motion_motor_2").tests[0])
    plant, n = made.rig.plant(), 1000
    motor = np.full(n, made.rig.max_effort)
    states = simulated(made.rig, plant, Commands(motor), at_atmosphere(made.rig, 0.0))
    step = made.rig.position_per_count
    kicked = part(trial, slice(n))
    kicked = with_channels(
        kicked,
        motor_torque_nm=motor,
        theta_rad=np.round(states[:, 0] / step) * step,
        pressure_a_pa=states[:, 2],
        pressure_b_pa=states[:, 3],
    )
    assert prepared(kicked, rig, "motion-motor").whole.state.values[1] == 0.0
    # The same motion with the motor's command shifted away cannot have begun at rest.
    with pytest.raises(InputError, match="starts while moving"):
        prepared(with_channels(kicked, motor_torque_nm=np.zeros(n)), rig, "motion-motor")


def test_a_gap_is_refused(pulsed: Trial, rig: Rig) -> None:
    kept = np.r_[0:500, 510 : len(pulsed)]
    with pytest.raises(InputError, match=r"at 0.499 s: no sample for 0.011 s"):
        prepared(part(pulsed, kept), rig)


@pytest.mark.parametrize("missing", ["duty_b", "pressure_a_pa", "theta_rad"])
def test_a_missing_channel_is_refused(pulsed: Trial, rig: Rig, missing: str) -> None:
    channels = {k: v for k, v in pulsed.channels.items() if k != missing}
    with pytest.raises(InputError, match=f"column {missing} is missing"):
        prepared(dataclasses.replace(pulsed, channels=channels), rig)


@pytest.mark.parametrize("period", [0.00487, 0.0007])
def test_rows_that_cannot_follow_the_pulses_are_refused(
    pulsed: Trial, rig: Rig, period: float
) -> None:
    odd = rig_from_content({**rig.content, "pwm": {"period_s": period}}, "rig.toml")
    with pytest.raises(InputError, match="cannot follow PWM periods"):
        prepared(pulsed, odd)


def test_rows_that_follow_the_pulses_now_and_then_will_do(pulsed: Trial, rig: Rig) -> None:
    uneven = rig_from_content({**rig.content, "pwm": {"period_s": 0.0025}}, "rig.toml")
    found = prepared(pulsed, uneven)
    # Two rows to five periods: only every second row starts one.
    assert found.segments
    assert all(s.start % 5 == 0 for s in found.segments)


def test_a_command_of_another_kind_is_refused(pulsed: Trial, rig: Rig) -> None:
    valves = {"valve_a": np.zeros(len(pulsed)), "valve_b": np.zeros(len(pulsed))}
    with pytest.raises(InputError, match=r"duty_a is commanded in a motion-discrete test"):
        prepared(with_channels(pulsed, **valves), rig, "motion-discrete")
    with pytest.raises(InputError, match="holds 10 rows"):
        prepared(part(pulsed, slice(10)), rig)


def test_pressures_that_are_not_logged(
    made: GeneratedCampaign, rig: Rig, tmp_path: Path, bundle: Bundle
) -> None:
    test = made.log("motion_motor_2").tests[0]
    columns = {k: v for k, v in test.columns.items() if "pressure" not in k}
    less = dataclasses.replace(test, columns=columns)
    log = dataclasses.replace(made.log("motion_motor_2"), tests=[less])
    campaign = written(dataclasses.replace(made, logs=[log]), tmp_path)
    found = validate(campaign, bundle)
    channels = found.logs[0].channels
    assert set(channels) == {"theta_rad"}
    fit = channels["theta_rad"].errors.fit_percentage
    assert fit is not None
    assert fit > 99.0
    assert sum("is not logged" in n for n in found.notices) == 2


def test_samples_near_an_end_stop_do_not_count(made: GeneratedCampaign, rig: Rig) -> None:
    trial = trial_of(made.log("motion_discrete_2").tests[0])
    assert rig.travel is not None
    position = trial["theta_rad"].copy()
    position[3000:3200] = 0.495 * rig.travel
    found = prepared(with_channels(trial, theta_rad=position), rig, "motion-discrete")
    assert found.counted(found.whole) == 3000
    for segment in found.segments:
        rows = np.arange(segment.start, segment.start + found.counted(segment))
        assert not np.isin(rows, np.arange(3000, 3200)).any()
    assert any("end stop at 3.000 s (200 of" in n for n in found.notices)
