"""`sysid diagnose` as a user meets it: JSON, summary, extended bundle, report, bad input."""

from __future__ import annotations

import contextlib
import io
import json
import math
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import sysid.commands.diagnose
from datasets.generator.campaign import Size, drawn_effects, make_campaign
from datasets.generator.files import write_campaign
from datasets.generator.rigs import reference_rig
from sysid.blocks.standing import drawn
from sysid.commands.app import main
from sysid.commands.diagnose import Diagnosed
from sysid.diagnosis import content as findings
from sysid.diagnosis.actuator.diagnose import diagnose, rivals_of, with_rival
from sysid.diagnosis.actuator.evidence import TwinEvidence
from sysid.diagnosis.actuator.loop import Memory
from sysid.diagnosis.actuator.search import Rival
from sysid.diagnosis.actuator.signatures import base_parameters
from sysid.diagnosis.refined import with_refined_numbers, without_contradicted
from sysid.diagnosis.result import Diagnosis
from sysid.diagnosis.rivals import may_be_better, simulating_best
from sysid.diagnosis.search_record import SearchStage
from sysid.diagnosis.shown import diagnosis_section
from sysid.estimation.linear import Estimate
from sysid.io.campaign import read_campaign
from sysid.parallel import LATE
from sysid.parameters import read_bundle
from sysid.pipeline.diagnose import extended_bundle
from sysid.plant.effects.catalogue import catalogue
from sysid.plant.effects.entry import Catalogue, CatalogueEffect
from sysid.plant.effects.friction import StictionAfterRest

SEED = 5
SIZE = Size(2, 0, 2, 0.04, (2, 1), (1, 1), (1, 1), slidings=8)
KINDS = ("friction-static", "friction-sliding", "valve-discrete", "motion-discrete")
LARGEST_BYTES = 6_000_000


@dataclass(frozen=True)
class Ran:
    """One call of the command on a rig with undeclared Stribeck friction, and what it left."""

    folder: Path
    code: int
    output: str
    diagnosed: Diagnosed
    truth: dict[str, float]

    @property
    def printed(self) -> dict[str, Any]:
        content: dict[str, Any] = json.loads(self.output)
        return content

    @property
    def campaign(self) -> Path:
        return self.folder / "campaign.toml"

    @property
    def bundle(self) -> Path:
        return self.folder / "bundle.json"

    @property
    def extended(self) -> Path:
        return self.folder / "extended.json"


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    folder = tmp_path_factory.mktemp("rig")
    effects = drawn_effects(SEED, [("stribeck-friction", "gaussian", 1.0)])
    made = make_campaign(SEED, size=SIZE, rig=reference_rig(), kinds=KINDS, effects=effects)
    write_campaign(folder, made, "made by a test")
    arguments = [str(folder / "campaign.toml"), "--bundle", str(folder / "bundle.json")]
    found: list[Diagnosed] = []
    original = sysid.commands.diagnose.diagnose_campaign

    def kept(*args: Any, **options: Any) -> Diagnosed:
        found.append(original(*args, **options))
        return found[0]

    outputs = ["-o", str(folder / "extended.json"), "--report", str(folder / "report.html")]
    printed = io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()):
        patch.setattr(sysid.commands.diagnose, "diagnose_campaign", kept)
        assert main(["fit", arguments[0], "-o", arguments[2]]) == 0
        with contextlib.redirect_stdout(printed):
            code = main(["diagnose", *arguments, *outputs, "--json"])
    assert found, "the command did not diagnose"
    return Ran(folder, code, printed.getvalue(), found[0], dict(effects[0].values))


# --- what it prints ------------------------------------------------------------------------


def test_json_is_as_the_contract_says(ran: Ran) -> None:
    assert ran.code == 0
    printed = ran.printed
    assert {"verdict", "effects", "residual", "unexplained"} <= set(printed)
    assert printed["verdict"] == "effects-found"
    effect = printed["effects"][0]
    assert {"id", "parameters", "p_value", "holdout_rmse", "ambiguous_with"} <= set(effect)
    assert {"value", "std"} <= set(effect["parameters"]["stribeck_torque_nm"])
    channels = {"theta_rad", "pressure_a_pa", "pressure_b_pa"}
    assert set(effect["holdout_rmse"]) == set(printed["residual"]) == channels
    for errors in effect["holdout_rmse"].values():
        assert set(errors) == {"before", "after"}
    for errors in printed["residual"].values():
        assert set(errors) == {"before", "after", "noise_floor"}
    assert printed["unexplained"] == []
    assert [Path(p).name for p in printed["written"]] == ["extended.json", "report.html"]


def test_the_effect_is_the_one_that_was_put_in(ran: Ran) -> None:
    (effect,) = ran.printed["effects"]
    assert effect["id"] == "stribeck-friction"
    found = effect["parameters"]["stribeck_torque_nm"]["value"]
    assert found == pytest.approx(ran.truth["stribeck_torque_nm"], rel=0.01)
    assert effect["p_value"] < 1e-6
    # The one test held out has friction 1.5 % below the others': the true model leaves 4 mrad.
    position = ran.printed["residual"]["theta_rad"]
    assert position["after"] < 1.5 * position["noise_floor"]


def test_the_numbers_are_those_of_simulation(ran: Ran, tmp_path: Path) -> None:
    """Printed, in the bundle and in its refinement alike, and nearer to the truth."""
    assert ran.printed["refined"] is True
    extended = read_bundle(ran.extended)
    (entry,) = extended.effects
    assert extended.refinement is not None
    record = {p.name: p.after.value for p in extended.refinement.values()}
    found = ran.printed["effects"][0]["parameters"]["stribeck_torque_nm"]["value"]
    assert found == entry.parameters["stribeck_torque_nm"].value
    assert found == record["stribeck-friction.stribeck_torque_nm"]
    diagnosis = ran.diagnosed.found.detail
    assert diagnosis.refinement is not None
    before = next(p.unknown.value for p in diagnosis.refinement.parameters
                  if p.name.endswith("stribeck_torque_nm"))  # fmt: skip
    true = ran.truth["stribeck_torque_nm"]
    assert abs(found - true) < abs(before - true)


def _fails(*_: Any, **__: Any) -> Any:
    raise RuntimeError("the simulation does not stay finite")


def _overflows(*_: Any, **__: Any) -> Any:
    raise OverflowError("math range error")


def _is_worse(*_: Any, **__: Any) -> Any:
    fit = SimpleNamespace(before=np.array([0.02, 300.0, 300.0]))
    misfits = np.full((12, 3), 1.5)
    return SimpleNamespace(worse="2 times worse", fits={"fit": fit}, misfits=misfits)


@pytest.mark.parametrize(
    ("outcome", "why"),
    [
        (_fails, "does not stay finite"),
        (_overflows, "math range error"),
        (_is_worse, "2 times worse"),
    ],
)
def test_a_refinement_that_does_not_hold_is_not_taken(
    ran: Ran, outcome: Callable[..., Any], why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("SYSID_DEBUG", raising=False)
    monkeypatch.setattr("sysid.refinement.refine.refine", outcome)
    before = replace(ran.diagnosed.found.detail, refinement=None)
    campaign, extended = read_campaign(ran.campaign), read_bundle(ran.extended)
    found = with_refined_numbers(before, campaign, extended, catalogue(), lambda bundle: {})
    assert found.effects == before.effects and found.residual == before.residual
    assert why in found.not_refined and why in found.notices[-1]
    assert found.to_json()["refined"] is False


@pytest.mark.parametrize(("over_std", "is_taken"), [(0.01, False), (30.0, True)])
def test_a_refinement_that_would_miss_what_the_balances_found_is_not_taken(
    ran: Ran, over_std: float, is_taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A strength a hundredth of its standard error from 0, as that of the balances is."""
    refinement = ran.diagnosed.found.detail.refinement
    assert refinement is not None
    strengths = {q.name for q in type(ran.diagnosed.found.detail.effects[0].effect).strengths()}

    def coarse(parameter: Any) -> Any:
        if parameter.unknown.direction[1] not in strengths:
            return parameter
        e = parameter.estimate
        estimate = Estimate.symmetric(e.value, e.value / over_std, e.unit, math.inf)
        return replace(parameter, estimate=estimate)

    found = replace(refinement, parameters=tuple(coarse(p) for p in refinement.parameters))
    monkeypatch.setattr("sysid.refinement.refine.refine", lambda *_, **__: found)
    before = replace(ran.diagnosed.found.detail, refinement=None)
    campaign, extended = read_campaign(ran.campaign), read_bundle(ran.extended)
    after = with_refined_numbers(before, campaign, extended, catalogue(), lambda bundle: {})
    assert (after.refinement is found) is is_taken
    assert is_taken or "motion says too little of stribeck-friction" in after.not_refined


def _simulated(found: Diagnosis, *after: float) -> Diagnosis:
    """As if whole tests to fit on were simulated with these errors, by numbers that no refinement
    gave; without any, as if they were not."""
    errors = np.array(after) if after else None
    return replace(found, refinement=None, misfits=None, simulated=errors)


@pytest.mark.parametrize(
    ("own", "rival", "is_rival"),
    [
        ((0.02, 300.0, 300.0), (0.01, 300.0, 310.0), True),
        ((0.01, 300.0, 310.0), (0.02, 300.0, 300.0), False),
        ((0.02, 300.0, 300.0), (), False),
        ((), (), False),
    ],
)
def test_of_what_the_balances_do_not_tell_apart_the_better_simulating_is_taken(
    ran: Ran, own: tuple[float, ...], rival: tuple[float, ...], is_rival: bool
) -> None:
    found, other = (_simulated(ran.diagnosed.found.detail, *one) for one in (own, rival))
    assert (simulating_best(found, other) is other) is is_rival


def test_a_refined_rival_is_taken_where_the_first_was_not_simulated(ran: Ran) -> None:
    rival = ran.diagnosed.found.detail
    assert simulating_best(_simulated(rival), rival) is rival


def _judged(found: Diagnosis, id: str, ratio: float, behind: float = 0.0) -> Diagnosis:
    """As if this effect had been found, and every segment were off by so many times the noise."""
    effects = (replace(found.effects[0], effect=catalogue()[id].neutral(), ambiguous_with=()),)
    misfits = np.full((12, 3), ratio)
    evidence: Any = found.evidence
    loop = evidence.loop
    loop = replace(loop, search=replace(loop.search, behind=behind))
    evidence = replace(evidence, loop=loop)
    return replace(found, effects=effects, misfits=misfits, evidence=evidence)


def _proposed(found: Diagnosis) -> Rival:
    """A diagnosis that was made by hand as the search proposes it."""
    evidence: Any = found.evidence
    return Rival(frozenset(e.id for e in found.effects), evidence.loop.search.behind)


@pytest.mark.parametrize(
    ("ratio", "rival_ratio", "behind", "named", "doubtful"),
    [
        (1.1, 1.1, 2.0, "presliding", True),  # nothing decides
        (1.1, 1.1, 15.0, "presliding", False),  # the balances do
        (1.1, 3.0, 2.0, "presliding", False),
        (3.0, 1.1, 15.0, "stribeck-friction", False),  # motion does
        (0.9, 0.2, 2.0, "presliding", True),  # below the noise nothing is shown
        (1.2, 1.1, 2.0, "stribeck-friction", True),
    ],
)
def test_balances_and_segments_of_motion_decide_between_rivals(
    ran: Ran, ratio: float, rival_ratio: float, behind: float, named: str, doubtful: bool
) -> None:
    given = ran.diagnosed.found.detail
    found = _judged(given, "presliding", ratio)
    rival = _judged(given, "stribeck-friction", rival_ratio, behind)
    (effect,) = simulating_best(found, rival).effects
    other = {"presliding": "stribeck-friction", "stribeck-friction": "presliding"}[named]
    assert effect.id == named
    assert effect.ambiguous_with == ((other,) if doubtful else ())
    assert bool(effect.advice) >= doubtful


@pytest.mark.parametrize(
    ("ratio", "rival_ratio", "is_tried", "is_taken"),
    [
        (3.0, 1.1, True, True),  # motion pays for it
        (1.3, 1.1, True, False),  # it would, were more left to explain
        (1.2, 0.1, False, False),  # too little is left that could pay
        (1.0, 1.0, False, False),
    ],
)
def test_one_more_effect_is_taken_beyond_doubt_only(
    ran: Ran, ratio: float, rival_ratio: float, is_tried: bool, is_taken: bool
) -> None:
    given = ran.diagnosed.found.detail
    found = _judged(given, "stribeck-friction", ratio)
    longer = _judged(given, "stribeck-friction", rival_ratio, behind=10.0)
    further = replace(_judged(given, "backlash", 1.0).effects[0], p_value=1.0)
    longer = replace(longer, effects=(*longer.effects, further))
    assert may_be_better(found, _proposed(longer)) is is_tried
    best = simulating_best(found, longer)
    assert (len(best.effects) == 2) is is_taken
    assert best.effects[0] == found.effects[0]
    # Motion shows the further one, whatever the balances say of it.
    assert all(e.p_value < 1e-6 for e in best.effects[1:])
    assert simulating_best(found, replace(longer, refinement=None)) is found
    assert simulating_best(replace(found, misfits=None), longer).effects == found.effects
    # The segments are followed as well with numbers that were refused.
    best = simulating_best(replace(found, refinement=None), longer)
    assert (len(best.effects) == 2) is is_taken


def test_what_was_not_refined_is_compared_with_its_rivals(ran: Ran) -> None:
    given = ran.diagnosed.found.detail
    rival = _judged(given, "presliding", 1.0, behind=18.0)
    followed = _judged(given, "stribeck-friction", 1.0)
    assert may_be_better(replace(followed, misfits=None), _proposed(rival))
    assert not may_be_better(followed, _proposed(rival))
    assert may_be_better(_judged(given, "stribeck-friction", 2.0), _proposed(rival))


def test_a_rival_whose_refinement_was_refused_takes_no_place_untested(ran: Ran) -> None:
    found, rival = (
        _simulated(ran.diagnosed.found.detail, *one) for one in ((), (0.02, 300.0, 300.0))
    )
    refused = replace(rival, refinement=None)
    assert simulating_best(found, refused) is found
    assert simulating_best(_simulated(found, 0.03, 300.0, 300.0), refused) is refused


def test_a_rival_that_the_budget_left_untested_makes_the_diagnosis_incomplete(ran: Ran) -> None:
    found = ran.diagnosed.found.detail
    unjudged = _simulated(found).with_missed(SearchStage.REFINEMENT, LATE)
    best = simulating_best(found, unjudged)
    assert best.effects == found.effects and best.refinement is found.refinement
    assert best.verdict == "incomplete" and best.missed[-1].stage is SearchStage.RIVALS
    assert "fit of rivals" in best.notices[-1] and "--budget" in best.notices[-1]


def test_a_rival_is_diagnosed_as_if_it_had_been_found_first(ran: Ran) -> None:
    """Its effects, errors and remainder are its own."""
    campaign, bundle = read_campaign(ran.campaign), read_bundle(ran.bundle)
    logs = [(entry.use, entry.kind, campaign.read(entry)) for entry in campaign.logs]
    rig, model = campaign.rig, bundle.model(campaign.rig)
    tried = {name: catalogue()[name] for name in ("stribeck-friction", "presliding")}
    memory = Memory()
    found = diagnose(logs, rig, model, tried, memory=memory)
    assert [e.id for e in found.effects] == ["stribeck-friction"]
    other, _ = rivals_of(found)
    rival = with_rival(found, other, memory, logs, rig, model)
    assert [e.id for e in rival.effects] == ["presliding"]
    assert rival.effects[0].ambiguous_with == ("stribeck-friction",)
    assert set(rival.residual) == set(found.residual)
    for name, error in rival.residual.items():
        assert error.before == pytest.approx(found.residual[name].before)
        assert error.after == pytest.approx(rival.effects[0].holdout[name].after)
    # What is left is what that leaves: without any effect Stribeck's friction.
    none = with_rival(found, Rival(frozenset(), 0.0), memory, logs, rig, model)
    left, known = (
        next(rest.rmse for rest in one.remainder if rest.channel == rig.position_channel)
        for one in (none, found)
    )
    assert left > 1.3 * known
    assert none.verdict == "unexplained" and none.unexplained and not found.unexplained
    # Without a log held out no error is known.
    fitted = [log for log in logs if log[0] == "fit"]
    rival = with_rival(found, other, memory, fitted, rig, model)
    assert not any(np.isfinite(error.after) for error in rival.residual.values())
    assert any("no held-out motion log" in notice for notice in rival.notices)


class _Looks:
    """A diagnosis made by hand: the first with the effects given, the next without any."""

    def __init__(self, first: Diagnosis) -> None:
        self.first, self.tried = first, []  # type: ignore[var-annotated]

    def __call__(self, effects: Catalogue) -> Diagnosis:
        self.tried.append(set(effects))
        if len(self.tried) == 1:
            return self.first
        return replace(self.first, effects=(), refinement=None, notices=())


@pytest.fixture
def balances_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of effects made by hand the balances of a true diagnosis show nothing."""
    monkeypatch.setattr(TwinEvidence, "unseen", lambda *_: [])


def test_the_search_is_made_again_without_an_effect_whose_size_explains_no_balance(
    ran: Ran,
) -> None:
    """Motion gives it a size, which is not that of what it was found by."""
    given = ran.diagnosed.found.detail
    (one, *others) = given.effects
    strengths = type(one.effect).strengths()
    turned = {q.name: -float(getattr(one.effect, q.name)) for q in strengths}
    other = replace(one, effect=replace(one.effect, **turned))  # type: ignore[type-var]
    look = _Looks(replace(given, effects=(other, *others)))
    found = without_contradicted(look, catalogue())
    assert found.contradicted == (one.id,)
    assert look.tried[1] == set(catalogue()) - {one.id}
    assert "gives it a size that explains nothing of them (" in found.notices[0]


def test_an_effect_that_motion_confirms_stays(ran: Ran) -> None:
    look = _Looks(ran.diagnosed.found.detail)
    found = without_contradicted(look, catalogue())
    assert found == look.first
    assert look.tried == [set(catalogue())]


def _with_strengths(
    found: Diagnosis,
    effect: CatalogueEffect,
    over_std: tuple[float, ...],
    correlation: float,
    std: float = 0.3,
) -> Diagnosis:
    """As if the effect had been found, its first numbers so many standard errors from 0, each of
    which is `std` of the usual size."""
    quantities = type(effect).quantities[: len(over_std)]
    names = [q.name for q in quantities]
    parameters = [
        SimpleNamespace(
            unknown=SimpleNamespace(direction=(1, q.name)),
            estimate=Estimate.symmetric(
                std * q.usual_size * z, std * q.usual_size, q.unit, math.inf
            ),
            informed=True,
        )
        for q, z in zip(quantities, over_std, strict=True)
    ]
    other = SimpleNamespace(
        unknown=SimpleNamespace(direction=(0, "viscous")),
        estimate=Estimate.symmetric(1.0, 1e-3, "", math.inf),
        informed=True,
    )
    refinement: Any = SimpleNamespace(
        bundle=SimpleNamespace(effects=[None]),
        parameters=(other, *parameters),
        correlation=np.array([[1, 0, 0], [0, 1, correlation], [0, correlation, 1]]),
    )
    estimates = dict(zip(names, (p.estimate for p in parameters), strict=True))
    one = replace(found.effects[0], effect=effect, estimates=estimates)
    return replace(found, effects=(one,), refinement=refinement)


@pytest.mark.usefixtures("balances_agree")
@pytest.mark.parametrize(
    ("over_std", "correlation", "stays"),
    [
        ((0.1, -0.3), 0.0, False),
        ((0.1, -9.0), 0.0, True),
        # Neither is told from 0, their difference is.
        ((1.5, -1.5), 0.9, True),
        ((1.5, 1.5), 0.9, False),
    ],
)
def test_the_search_is_made_again_without_an_effect_to_which_motion_gives_no_strength(
    ran: Ran, over_std: tuple[float, float], correlation: float, stays: bool
) -> None:
    delay = catalogue()["valve-delay"].typical()
    look = _Looks(_with_strengths(ran.diagnosed.found.detail, delay, over_std, correlation))
    lines: list[str] = []
    found = without_contradicted(look, catalogue(), lines.append)
    if stays:
        assert found == look.first
        return
    assert look.tried == [set(catalogue()), set(catalogue()) - {"valve-delay"}]
    assert found.verdict == "adequate" and not found.effects
    assert found.contradicted == ("valve-delay",)
    assert found.to_json()["removed"] == ["valve-delay"]
    (notice,) = found.notices
    assert notice.startswith("valve-delay") and "on_delay_s" in notice and "off_delay_s" in notice
    assert "valve-delay" in lines[0]


@pytest.mark.usefixtures("balances_agree")
@pytest.mark.parametrize(("over_std", "stays"), [(3.5, False), (9.0, True)])
def test_a_strength_far_below_the_usual_has_to_be_surer(
    ran: Ran, over_std: float, stays: bool
) -> None:
    """Of an effect of one ten-thousandth of its usual size, none is likelier than 3.5 errors."""
    delay = catalogue()["valve-delay"].typical()
    strengths = (over_std / math.sqrt(2.0),) * 2
    look = _Looks(_with_strengths(ran.diagnosed.found.detail, delay, strengths, 0.0, 1e-4))
    found = without_contradicted(look, catalogue())
    assert found.contradicted == (() if stays else ("valve-delay",))


@pytest.mark.usefixtures("balances_agree")
@pytest.mark.parametrize(("correlation", "stays"), [(0.99, True), (-0.99, True), (0.0, False)])
def test_a_strength_is_told_from_none_with_the_shape_as_it_is(
    ran: Ran, correlation: float, stays: bool
) -> None:
    """A gap that is crossed so fast: motion tells the time alone."""
    backlash = catalogue()["backlash"].typical()
    look = _Looks(_with_strengths(ran.diagnosed.found.detail, backlash, (0.6, 0.7), correlation))
    found = without_contradicted(look, catalogue())
    assert found.contradicted == (() if stays else ("backlash",))


@pytest.mark.usefixtures("balances_agree")
@pytest.mark.parametrize(
    ("loss", "position_after", "stays"), [(2.0, 0.02, False), (2.0, 0.005, True), (0.1, 0.02, True)]
)
@pytest.mark.parametrize("held_out", [0.5, 1.0, 2.0])
def test_the_search_is_made_again_without_an_effect_at_its_limit_that_makes_errors_larger(
    ran: Ran, loss: float, position_after: float, stays: bool, held_out: float
) -> None:
    """By the training tests, whatever the held-out ones do."""
    given = ran.diagnosed.found.detail
    assert given.refinement is not None
    one = replace(given.effects[0], effect=StictionAfterRest(loss, 0.25))
    after = np.array([position_after, 100.0, np.nan])
    errors = replace(
        given.refinement.fits["fit"], before=np.array([0.01, 200.0, np.nan]), after=after
    )
    fits = {**given.refinement.fits, "fit": errors}
    refinement = replace(given.refinement, fits=fits, with_own_friction=None)
    other = {n: replace(e, after=held_out * e.before) for n, e in given.residual.items()}
    look = _Looks(replace(given, effects=(one,), refinement=refinement, residual=other))
    found = without_contradicted(look, catalogue())
    if stays:
        assert found == look.first
        return
    assert found.contradicted == ("stiction-after-rest",)
    assert "limit of its range (fresh_loss_nm 2.00 Nm)" in found.notices[0]


def test_summary_says_verdict_effects_errors_and_what_was_tried(
    ran: Ran, capsys: pytest.CaptureFixture[str]
) -> None:
    from sysid.commands.diagnose import show_diagnosis

    show_diagnosis(ran.diagnosed, as_json=False)
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("Effects found: stribeck-friction")
    text = "\n".join(lines)
    found = ran.printed["effects"][0]["parameters"]["stribeck_torque_nm"]
    # To the second digit of its error.
    shown = re.search(r"stribeck_torque_nm\D*([\d.]+)", text)
    assert shown is not None
    assert float(shown[1]) == pytest.approx(found["value"], abs=0.05 * found["std"])
    for error in ran.printed["residual"]["theta_rad"].values():
        assert f"{error:.4g}" in text
    rejected = ran.diagnosed.found.detail.effects[0].suspects[1]
    assert rejected.id in text.split("Tried, and not added")[1]
    assert "written:" in text and str(ran.extended.name) in text


# --- what it writes ------------------------------------------------------------------------


def test_the_extended_bundle_is_a_bundle_that_simulates(ran: Ran, tmp_path: Path) -> None:
    given, extended = read_bundle(ran.bundle), read_bundle(ran.extended)
    assert [entry.id for entry in extended.effects] == ["stribeck-friction"]
    assert given.effects == []
    assert extended.friction is not None and given.friction is not None
    assert extended.friction.coulomb_nm != given.friction.coulomb_nm
    inputs = ran.folder / "motion_discrete_2.csv"
    outputs = []
    for bundle in (ran.bundle, ran.extended):
        output = tmp_path / f"{bundle.stem}.csv"
        arguments = ["simulate", str(inputs), "--bundle", str(bundle), "-o", str(output)]
        assert main([*arguments, "--json"]) == 0
        outputs.append(output.read_text())
    assert outputs[0] != outputs[1]


def test_intervals_of_refitted_base_parameters_have_the_degrees_of_freedom(ran: Ran) -> None:
    """As found, and as if three rows more than numbers had been fitted on."""
    diagnosis = replace(ran.diagnosed.found.detail, refinement=None)
    evidence = diagnosis.evidence
    assert isinstance(evidence, TwinEvidence)
    search = evidence.loop.search
    (effect,) = diagnosis.effects
    numbers = len(base_parameters(search.model)) + len(type(effect.effect).quantities)
    assert search.base_dof == len(search.last.rest) - numbers
    short = replace(search.last, basis=search.last.basis[: numbers + 3])
    loop = replace(evidence.loop, search=replace(search, last=short))
    few = replace(diagnosis, evidence=replace(evidence, loop=loop))
    campaign = read_campaign(ran.campaign)
    for found, quantile in ((diagnosis, 1.96), (few, 3.182)):
        extended = extended_bundle(read_bundle(ran.bundle), found, campaign)
        law = extended.valve("a").discrete
        assert extended.friction is not None and law is not None
        for renewed in (extended.friction.coulomb_nm, law.c_dis):
            assert renewed is not None
            low, high = renewed.interval
            assert high - renewed.value == pytest.approx(quantile * renewed.std, rel=2e-3)
            assert renewed.value - low == pytest.approx(quantile * renewed.std, rel=2e-3)


def test_the_report_shows_the_diagnosis(ran: Ran) -> None:
    path = ran.folder / "report.html"
    html = path.read_text("utf-8")
    assert path.stat().st_size < LARGEST_BYTES
    assert '<section id="diagnosis"' in html
    for figure in ("error-theta_rad", "curve-0", "suspects-1"):
        assert f'aria-labelledby="fig-diagnosis-{figure}-title' in html
    first = html[html.index('id="verdict"') : html.index('id="data"')]
    assert "Effects found: Stribeck" in first


def test_the_section_is_the_same_from_what_a_file_holds(ran: Ran) -> None:
    content = findings.content(ran.diagnosed.found.detail)
    kept = json.loads(json.dumps(content, allow_nan=False))
    one, two = (diagnosis_section(c, False) for c in (kept, content))
    assert replace(one, blocks=drawn(one.blocks)) == replace(two, blocks=drawn(two.blocks))


def test_curves_show_where_the_effect_acts(ran: Ran) -> None:
    """Stribeck friction is a torque at low speed, and it is gone from the extended model."""
    curves = findings.figures(ran.diagnosed.found.detail)["curves"]
    first = next(c for c in curves if c["channel"] == "effort")
    assert first["regressor"] == "velocity"
    largest = max(range(len(first["centres"])), key=lambda i: abs(first["before"]["means"][i]))
    assert abs(first["centres"][largest]) < 0.1
    before, after = (max(abs(m) for m in first[k]["means"]) for k in ("before", "after"))
    assert before > 0.3 * ran.truth["stribeck_torque_nm"]
    assert after < 0.3 * before


def test_looks_say_what_became_of_every_suspect(ran: Ran) -> None:
    looks = ran.diagnosed.found.detail.evidence.rounds_shown()
    assert [look["added"] for look in looks] == ["stribeck-friction", None]
    for look in looks:
        added = [s["id"] for s in look["suspects"] if s["fate"] == "added"]
        assert added == ([look["added"]] if look["added"] else [])
        assert all(s["fate"] and s["twins"] for s in look["suspects"])


# --- bad input -----------------------------------------------------------------------------


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Exit code and the one line of a call that fails before anything is computed."""
    code = main(["diagnose", *arguments])
    captured = capsys.readouterr()
    assert captured.out == "" and "Traceback" not in captured.err
    errors = [line for line in captured.err.splitlines() if line.startswith("sysid: error:")]
    assert len(errors) == 1
    return code, errors[0]


def test_a_missing_bundle(ran: Ran, capsys: pytest.CaptureFixture[str]) -> None:
    missing = ran.folder / "nowhere.json"
    code, line = refused([str(ran.campaign), "--bundle", str(missing)], capsys)
    assert code == 2 and "nowhere.json" in line


def test_a_bundle_without_valves_cannot_be_diagnosed(
    ran: Ran, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = json.loads(ran.bundle.read_text())
    del content["valves"]
    bundle = tmp_path / "friction.json"
    bundle.write_text(json.dumps(content))
    code, line = refused([str(ran.campaign), "--bundle", str(bundle)], capsys)
    assert code == 3 and "valve-discrete" in line


def test_a_log_that_changed_since_the_fit(
    ran: Ran, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(ran.folder, tmp_path, dirs_exist_ok=True)
    log = tmp_path / "friction_sliding.csv"
    log.write_text("# changed\n" + log.read_text())
    arguments = [str(tmp_path / "campaign.toml"), "--bundle", str(tmp_path / "bundle.json")]
    code, line = refused(arguments, capsys)
    assert code == 2 and "friction_sliding.csv" in line


def test_a_held_out_log_that_was_fitted_on(
    ran: Ran, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(ran.folder, tmp_path, dirs_exist_ok=True)
    path = tmp_path / "campaign.toml"
    head, *blocks = path.read_text().split("[[log]]")
    blocks = [
        b.replace('use = "fit"', 'use = "holdout"') if "friction_sliding" in b else b
        for b in blocks
    ]
    path.write_text("[[log]]".join([head, *blocks]))
    code, line = refused([str(path), "--bundle", str(tmp_path / "bundle.json")], capsys)
    assert code == 2 and "fitted on it" in line


def test_a_file_of_effects_that_does_not_run(
    ran: Ran, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    effects = tmp_path / "own.py"
    effects.write_text("raise ValueError('no effect')\n")
    arguments = [str(ran.campaign), "--bundle", str(ran.bundle), "--effects", str(effects)]
    code, line = refused(arguments, capsys)
    assert code == 2 and "own.py" in line
