"""Advice on the next test: information, candidates within the rig's limits, ties, sizes, output."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from datasets.generator.campaign import SMALL, GeneratedCampaign, make_campaign
from datasets.generator.files import write_log
from datasets.generator.one_chamber import scaled
from datasets.generator.rigs import rig_toml
from sysid.commands.app import main
from sysid.errors import InputError, NotIdentifiedError
from sysid.estimation.linear import Estimate
from sysid.io.campaign import MOTION_KINDS, Campaign, read_campaign
from sysid.io.rig import read_rig
from sysid.parameters import Bundle, Parts, read_bundle, write_bundle
from sysid.parameters.effects import entry_of
from sysid.parameters.friction import Friction
from sysid.parameters.refinement import RefinedValue, Refinement
from sysid.parameters.valves import FittedValves
from sysid.plant.effects.catalogue import catalogue
from sysid.refinement import advice as advice_module
from sysid.refinement.advice import advise
from sysid.refinement.advice_result import AdviceResult
from sysid.refinement.candidates import CandidateMotion, candidate_motions
from sysid.refinement.information import covariance

SEED = 3
STEMS = ("motion_motor", "motion_discrete")
SHARE = 0.03


def estimate(value: float) -> Estimate:
    return Estimate.symmetric(value, SHARE * abs(value), "SI", math.inf)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small campaign of motion logs, and a bundle of the true parameters, known to 3 %."""
    path = tmp_path_factory.mktemp("advice")
    write(path, make_campaign(SEED, size=SMALL, kinds=MOTION_KINDS, stems=STEMS))
    return path


def write(path: Path, made: GeneratedCampaign) -> None:
    """Its logs, and the bundle."""
    (path / "rig.toml").write_text(rig_toml(made.rig.content))
    lines = ['rig = "rig.toml"']
    for log in made.logs:
        write_log(path / f"{log.stem}.csv", log.tests, made.rig)
        lines += ["[[log]]", f'kind = "{log.kind}"', f'file = "{log.stem}.csv"', 'use = "fit"']
    (path / "campaign.toml").write_text("\n".join(lines) + "\n")
    friction = {k: estimate(v) for k, v in made.truth["friction"].items()}
    valves = {
        side: {"discrete": {k: estimate(v) for k, v in law.items()}}
        for side, law in made.truth["valves"].items()
    }
    parts = Parts(Friction.model_validate(friction), FittedValves.model_validate(valves))
    campaign = read_campaign(path / "campaign.toml")
    write_bundle(Bundle.new(campaign.rig, parts, []), path / "bundle.json")


@pytest.fixture(scope="module")
def campaign(folder: Path) -> Campaign:
    return read_campaign(folder / "campaign.toml")


@pytest.fixture(scope="module")
def bundle(folder: Path) -> Bundle:

    return read_bundle(folder / "bundle.json")


# On a level rig one of the strengths of `inertia-mismatch` shows nothing.
SOME = ("quadratic-drag", "torque-saturation", "pressure-offset", "inertia-mismatch")


@pytest.fixture(scope="module")
def motions(campaign: Campaign, bundle: Bundle) -> list[CandidateMotion]:
    """The motions that the rig can do."""
    return candidate_motions(campaign.rig, bundle.model(campaign.rig))


@pytest.fixture(scope="module")
def advice(campaign: Campaign, bundle: Bundle, motions: list[CandidateMotion]) -> AdviceResult:
    """With two candidates of each kind: all of them are simulated for every effect."""
    effects = {name: catalogue()[name] for name in SOME}
    own = [[m for m in motions if m.kind == kind] for kind in MOTION_KINDS]
    two = [m for of_kind in own for m in (of_kind[0], of_kind[-1])]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(advice_module, "candidate_motions", lambda *_: two)
        return advise(campaign, bundle, threshold=4.0, catalogue=effects)


@pytest.fixture
def few(motions: list[CandidateMotion], monkeypatch: pytest.MonkeyPatch) -> None:
    """One candidate of each kind: for what does not depend on their number."""
    one_of_each = list({motion.kind: motion for motion in motions}.values())
    monkeypatch.setattr(advice_module, "candidate_motions", lambda *_: one_of_each)


# --- standard errors -------------------------------------------------------------------


def test_no_test_makes_anything_less_certain(advice: AdviceResult) -> None:
    assert np.isfinite(advice.now).all() and (advice.now > 0.0).all()
    for candidate in advice.candidates:
        assert (candidate.std <= advice.now * (1.0 + 1e-6)).all()
        assert candidate.gain >= -1e-9
        assert candidate.motion_gain is not None and candidate.motion_gain >= -1e-9
    gains = [c.gain for c in advice.candidates]
    assert gains == sorted(gains, reverse=True)


def test_an_error_moves_the_motion_as_a_simulation_of_it_does(
    campaign: Campaign, bundle: Bundle
) -> None:
    """Against the same tests simulated with that number off; a known number moves nothing."""
    from sysid.recording.motion_tests import prepare_all
    from sysid.recording.simulation import simulate_segments
    from sysid.refinement.motion_errors import position_errors

    found = position_errors(campaign, bundle)
    assert found["friction.coulomb_nm"] > 0.0 and "mass" not in " ".join(found)
    model, tests = bundle.model(campaign.rig), []
    for entry in campaign.select(MOTION_KINDS):
        log = campaign.read(entry)
        tests += prepare_all(log.trials, entry.kind, campaign.rig, 1.0)[0][:1]
    # The errors are of logarithms of what is positive.
    viscous = model.parameters.viscous * np.exp(SHARE)
    other = dataclasses.replace(model, parameters=model.parameters.replace(viscous=viscous))
    segments = [(test, test.whole) for test in tests]
    here, there = (simulate_segments(segments, own) for own in (model, other))
    rows = [test.counted(test.whole) for test in tests]
    off = np.concatenate([(a - b)[0, :n] for a, b, n in zip(here, there, rows, strict=True)])
    rms = float(np.sqrt(np.mean(off**2)))
    assert found["friction.viscous_nm_s_per_rad"] == pytest.approx(rms, rel=1e-6)


def test_the_motion_logs_say_more_than_the_bench(advice: AdviceResult) -> None:
    flows = [i for i, p in enumerate(advice.parameters) if p.origin == "valve"]
    assert all(advice.now[i] < 0.5 * advice.parameters[i].std for i in flows)


def test_a_longer_test_says_more(advice: AdviceResult) -> None:
    by_name = {(c.kind, c.text, c.duration): c for c in advice.candidates}
    pairs = [(c, by_name[k, t, 5.0]) for (k, t, d), c in by_name.items() if d == 10.0]
    assert len(pairs) >= 6
    assert all((long.std <= short.std * (1.0 + 1e-6)).all() for long, short in pairs)


def test_bench_friction_tests_say_what_their_scatter_lets_them(advice: AdviceResult) -> None:
    """Independent breakaways: 1/std^2 adds up, each with the scatter that the logs' tests show."""
    (at,) = [i for i, p in enumerate(advice.parameters) if p.name.startswith("friction.static")]
    value, now = advice.parameters[at].value, advice.now[at]
    tests = [c for c in advice.candidates if c.kind == "friction-static"]
    each = [(c.std[at] ** -2 - now**-2) / int(c.text.split()[0]) for c in tests]
    assert len(each) > 1
    assert each == pytest.approx([each[0]] * len(each), rel=1e-6)
    # The assumed 2 %, and motion tests that hardly differ.
    assert 0.01 < each[0] ** -0.5 / value < 0.021


def test_nothing_is_foretold_that_the_integration_does_not_allow(advice: AdviceResult) -> None:
    least = 1e-6 * np.array([u.value for u in advice.parameters])
    assert (advice.now >= least).all()
    for candidate in advice.candidates:
        assert (candidate.std >= least).all()
    boundless = advice_module._std(1e20 * np.eye(len(least)), advice.parameters)
    np.testing.assert_allclose(boundless, least, rtol=1e-3)


def test_what_nothing_informs_is_not_certain() -> None:
    found = covariance(np.diag([4.0, 0.0]))
    assert found[0, 0] == pytest.approx(0.25)
    assert found[1, 1] > 1e6


# --- candidates ------------------------------------------------------------------------


def test_candidates_stay_off_the_stops_and_within_the_motor(
    campaign: Campaign, bundle: Bundle, motions: list[CandidateMotion]
) -> None:
    rig, found = campaign.rig, motions
    assert {m.kind for m in found} == set(MOTION_KINDS)
    assert rig.travel is not None and rig.max_effort is not None
    for motion in found:
        assert np.abs(motion.channels[0]).max() <= 0.45 * rig.travel
        assert np.ptp(motion.channels[0]) > 0.01 * rig.travel
        assert np.abs(motion.motor).max() <= rig.max_effort * (1.0 + 1e-9)
        if motion.valves is not None:
            assert motion.valves.min() >= 0.0 and motion.valves.max() <= 1.0
    again = candidate_motions(rig, bundle.model(rig))
    assert [m.text for m in again] == [m.text for m in found]


def test_candidates_of_a_slow_rig_take_as_many_times_longer(
    motions: list[CandidateMotion], tmp_path: Path
) -> None:
    """Ten seconds of it would be a fraction of one swing."""
    made = make_campaign(SEED, size=SMALL, kinds=MOTION_KINDS, stems=STEMS)
    write(tmp_path, scaled(made, time=8.0))
    rig, bundle = read_rig(tmp_path / "rig.toml"), read_bundle(tmp_path / "bundle.json")
    slow = candidate_motions(rig, bundle.model(rig))
    times = slow[0].duration / motions[0].duration

    def swings(found: list[CandidateMotion], kind: str) -> float:
        return max(float(np.ptp(m.channels[0])) for m in found if m.kind == kind)

    assert {m.kind for m in slow} == {m.kind for m in motions} == set(MOTION_KINDS)
    assert 4.0 < times < 16.0 and len({m.duration for m in slow}) == 1
    for kind in MOTION_KINDS:
        assert swings(slow, kind) > 0.7 * swings(motions, kind), kind


# --- ties and sizes --------------------------------------------------------------------


@pytest.mark.usefixtures("few")
def test_an_indistinguishable_effect_is_told_apart_best_by_a_named_test(
    campaign: Campaign, bundle: Bundle
) -> None:
    offset = catalogue()["torque-offset"].typical()
    entry = entry_of(offset).replaced(ambiguous_with=["asymmetric-coulomb-friction"])
    own = bundle.replaced(effects=[entry])
    known = {n: catalogue()[n] for n in ("torque-offset", "asymmetric-coulomb-friction")}
    found = advise(campaign, own, threshold=4.0, catalogue=known, sizes=False)
    (tie,) = [t for t in found.ties if t.one == "torque-offset"]
    assert tie.other == "asymmetric-coulomb-friction" and abs(tie.now) <= 1.0
    assert tie.test is None or abs(tie.after) < abs(tie.now)
    assert any(p.name == "torque-offset.offset_nm" for p in found.parameters)


def test_sizes_shrink_with_a_test_and_a_threshold_has_none(advice: AdviceResult) -> None:
    sizes = {s.effect: s for s in advice.sizes}
    assert set(sizes) == {"quadratic-drag", "pressure-offset", "inertia-mismatch"}
    assert set(advice.skipped) == {"torque-saturation"}
    for size in sizes.values():
        assert 0.0 < size.now < size.typical
        assert len(size.after) == len(advice.size_tests) > 0
        assert all(a <= size.now * (1.0 + 1e-6) for a in size.after)


# --- output and errors -----------------------------------------------------------------


def test_it_prints_and_converts(advice: AdviceResult) -> None:
    assert advice.candidates[0].name in str(advice)
    frame = advice.to_frame()
    assert len(frame) == len(advice.candidates) * len(advice.parameters)
    content = json.loads(json.dumps(advice.to_json(), allow_nan=False))
    assert content["tests"][0]["test"] == advice.candidates[0].name
    assert set(content["skipped_effects"]) == {"torque-saturation"}


def test_a_bundle_without_valves_is_refused(
    campaign: Campaign, bundle: Bundle, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(NotIdentifiedError, match="no on/off law"):
        advise(campaign, bundle.without("valves"), threshold=4.0)
    write_bundle(bundle.without("valves"), folder / "half.json")
    words = ["advise", str(folder / "campaign.toml"), "--bundle", str(folder / "half.json")]
    assert main(words) == 3
    assert "no on/off law" in capsys.readouterr().err


def test_without_motion_logs_the_rig_file_must_declare_the_noise(
    campaign: Campaign, bundle: Bundle
) -> None:
    sensors = campaign.rig.sensors.model_copy(update={"pressure_noise_pa": None})
    rig = dataclasses.replace(campaign.rig, sensors=sensors)
    bare = dataclasses.replace(campaign, logs=(), rig=rig)
    with pytest.raises(InputError, match="pressure_noise_pa"):
        advise(bare, bundle, threshold=4.0)


@pytest.mark.usefixtures("few")
def test_a_refined_bundle_knows_its_effects(campaign: Campaign, folder: Path) -> None:
    """Its motion logs are not counted again: what they said of an effect is in its error."""
    content = json.loads((folder / "bundle.json").read_text("utf-8"))
    known = {"offset_nm": {"value": 0.01, "std": 5e-4, "unit": "Nm"}}
    content["effects"] = [{"id": "torque-offset", "parameters": known}]
    path = folder / "with_effect.json"
    path.write_text(json.dumps(content), "utf-8")
    refined = read_bundle(path).replaced(refinement=Refinement(converged=True))
    effects = {"torque-offset": catalogue()["torque-offset"]}
    found = advise(campaign, refined, threshold=4.0, catalogue=effects, sizes=False)
    names = [parameter.name for parameter in found.parameters]
    assert found.now[names.index("torque-offset.offset_nm")] == pytest.approx(5e-4, rel=1e-3)


@pytest.mark.usefixtures("few")
def test_friction_from_the_counted_logs_is_no_prior(campaign: Campaign, bundle: Bundle) -> None:
    assert bundle.friction is not None
    moving = bundle.replaced(friction=bundle.friction.replaced(source="friction-motion"))
    found = advise(campaign, moving, threshold=4.0, catalogue={})
    has_prior = {parameter.name: parameter.has_prior for parameter in found.parameters}
    assert not has_prior["friction.coulomb_nm"] and has_prior["friction.static_nm"]


@pytest.mark.usefixtures("few")
def test_a_refined_bundle_counts_its_motion_logs_once(
    campaign: Campaign, bundle: Bundle, advice: AdviceResult
) -> None:
    refined = bundle.replaced(refinement=Refinement(converged=True))
    found = advise(campaign, refined, threshold=4.0, catalogue={})
    assert any("not counted again" in line for line in found.notices)
    assert (found.now > 2.0 * advice.now).any()
    np.testing.assert_allclose(found.now, [p.std for p in found.parameters], rtol=1e-6)


@pytest.mark.usefixtures("few")
def test_a_bundle_as_refine_writes_it_tells_the_sizes_of_effects(
    campaign: Campaign, bundle: Bundle, advice: AdviceResult
) -> None:
    """What was known before, and the logs: much as of the bundle that was not refined."""
    before = [
        RefinedValue(
            name=p.name, origin=p.origin, before=p.value, before_std=p.std if p.has_prior else None,
            after=Estimate.symmetric(p.value, 0.1 * abs(p.std), p.unit, 10.0), movement=0.0,
            informed_by_motion=True,
        )
        for p in advice.parameters
    ]  # fmt: skip
    refined = bundle.replaced(refinement=Refinement(converged=True, parameters=before))
    effects = {name: catalogue()[name] for name in ("stribeck-friction", "quadratic-drag")}
    found = advise(campaign, refined, threshold=4.0, catalogue=effects)
    assert found.sizes and all(math.isfinite(size.now) for size in found.sizes)
    np.testing.assert_allclose(found.now, advice.now, rtol=0.5)
