"""The joint errors of the bench fits: right against repetition, and kept in bundles."""

from __future__ import annotations

import copy
import dataclasses
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from friction_trials import BARE, RIG, swing
from golden_folder import golden_bundle
from test_bundle import FRICTION, LAW, estimate
from test_friction import points
from test_valve_discrete import NOISE_PA, VALVE_A, Bench, changed, fit_quickly, make_rig

from sysid.errors import InputError
from sysid.estimation.covariance import JointCovariance, correlation_of, shrunk
from sysid.estimation.linear import Estimate
from sysid.friction import SlidingPoints, fit_friction, fit_sliding
from sysid.io.logs import Trial
from sysid.io.motion import ROTARY
from sysid.io.rig import Rig
from sysid.parameters import Bundle, Correlation, FittedValves, Friction, Parts, Valve, read_bundle
from sysid.parameters.correlation import CorrelatedPart
from sysid.parameters.files import bundle_from_json
from sysid.parameters.valves import THESIS
from sysid.types import FloatArray
from sysid.valve_discrete import fit_valve_discrete


def empirical(values: Sequence[Sequence[float]]) -> FloatArray:
    return np.asarray(np.corrcoef(np.array(values).T))


# --- the fits ----------------------------------------------------------------------------


@pytest.mark.parametrize("drag", [0.0, 0.15])
def test_sliding_friction_against_repetition(drag: float) -> None:
    """300 sets of 18 trials with 2 % scatter: the fit's correlation is that of its errors."""
    rng = np.random.default_rng(61)
    levels = np.concatenate([np.repeat([s * 0.24, s * 0.28, s * 0.32], 3) for s in (1.0, -1.0)])
    levels += drag * np.sign(levels) * (np.abs(levels) - 0.208) / 0.0488
    values, said = [], []
    for _ in range(300):
        fit = fit_sliding(points(0.02 * rng.normal(size=18), levels, drag), ROTARY)
        own = (fit.coulomb, fit.viscous, fit.offset)
        values.append([e.value for e in own])
        assert fit.joint is not None
        assert np.sqrt(np.diag(fit.joint.matrix)) == pytest.approx([e.std for e in own])
        said.append(fit.joint.correlation(fit.joint.names)[1])
    assert fit.joint.names == ("coulomb", "viscous", "offset")
    shown = empirical(values)
    assert shown[0, 1] < -0.8
    assert np.median(said, axis=0) == pytest.approx(shown, abs=0.1)


def test_trials_own_laws_against_repetition() -> None:
    """Intercepts and slopes that share their scatter: 400 sets of 40 trials."""
    rng = np.random.default_rng(62)
    way = np.tile([1.0, -1.0], 20)
    values, said = [], []
    for _ in range(400):
        common, own = rng.normal(size=40), rng.normal(size=40)
        law = way * (0.208 + 0.004 * common), 0.0488 - 0.0008 * common - 0.0006 * own
        set_points = SlidingPoints(
            tuple(map(str, range(40))), way, 0.3 * way, 0.3 * way, 2.0 * way, law
        )
        fit = fit_sliding(set_points, ROTARY)
        values.append([fit.coulomb.value, fit.viscous.value, fit.offset.value])
        assert fit.joint is not None
        assert np.sqrt(np.diag(fit.joint.matrix)) == pytest.approx(
            [fit.coulomb.std, fit.viscous.std, fit.offset.std]
        )
        said.append(fit.joint.correlation(fit.joint.names)[1])
    assert empirical(values)[0, 1] < -0.7
    assert np.median(said, axis=0) == pytest.approx(empirical(values), abs=0.15)


@pytest.mark.parametrize(
    ("tests", "rig", "runs"),
    [(1, RIG, 100), (1, BARE, 100), (4, RIG, 60)],
    ids=["one test", "with the inertia", "four tests"],
)
def test_friction_from_motion_against_repetition(tests: int, rig: Rig, runs: int) -> None:
    """One test, and four fitted one by one, under coloured errors of the effort."""
    base = [swing(3.0, phase=0.4 * k) for k in range(tests)]
    rng = np.random.default_rng(63)
    values, said = [], []
    for _ in range(runs):
        result = fit_friction([disturbed(t, rng) for t in base], rig, kind="motion")
        assert result.correlation is not None
        values.append([result[n].value for n in result.correlation.names])
        said.append(result.correlation.array())
    assert len(result.correlation.names) == (3 if rig is RIG else 4)
    shown = empirical(values)
    assert shown[0, 1] < -0.8
    assert np.median(said, axis=0) == pytest.approx(shown, abs=0.35)
    assert np.median(said, axis=0)[0, 1] == pytest.approx(shown[0, 1], abs=0.08)


def disturbed(test: Trial, rng: np.random.Generator) -> Trial:
    """The test with an error of the effort of 0.05 Nm, an autoregression of 0.9."""
    error = rng.standard_normal(len(test))
    for i in range(1, len(error)):
        error[i] = 0.9 * error[i - 1] + math.sqrt(1.0 - 0.9**2) * error[i]
    return changed(test, motor_torque_nm=test["motor_torque_nm"] + 0.05 * error)


def test_a_valves_law_against_repetition(rig_text: str) -> None:
    """100 times the same test with new noise: flows, coefficients and delays go together."""
    rig = make_rig(rig_text)
    quiet = Bench(on=0.3, off=1.6, end=2.8, noise=0.0).trial(0)
    rng = np.random.default_rng(64)
    values, said = [], []
    for _ in range(100):
        noisy = quiet["pressure_a_pa"] + NOISE_PA * rng.standard_normal(len(quiet))
        # By the law that the test is made with: to fit the other one as well changes no number.
        noisy_test = changed(quiet, pressure_a_pa=noisy)
        fit = fit_valve_discrete([noisy_test], rig, find_ratio=False, law=THESIS)["a"]
        assert fit.correlation is not None
        values.append([fit[n].value for n in fit.correlation.names])
        said.append(fit.correlation.array())
    names, shown = fit.correlation.names, empirical(values)
    assert len(names) == 6
    flow, delay = names.index("choked_flow_fill_kg_s"), names.index("on_delay_s")
    assert shown[flow, delay] > 0.8
    # Three standard errors of a correlation of 0 over 100 repetitions are 0.3.
    assert np.median(said, axis=0) == pytest.approx(shown, abs=0.3)
    assert np.median(said, axis=0)[flow, delay] == pytest.approx(shown[flow, delay], abs=0.1)


def test_what_differs_from_test_to_test_together_is_correlated(rig_text: str) -> None:
    """All flows by one factor a test; the noise alone would say that they go against each other."""
    rng = np.random.default_rng(65)
    trials = []
    for k in range(8):
        share = 1.0 + 0.03 * rng.standard_normal()
        flows = ("choked_flow_fill_kg_s", "c_fill", "choked_flow_dis_kg_s", "c_dis")
        valve = dataclasses.replace(VALVE_A, **{n: share * getattr(VALVE_A, n) for n in flows})
        trials.append(Bench(valve, on=0.3, off=1.6, end=2.8).trial(k, str(k)))
    found = fit_quickly(trials, make_rig(rig_text)).valves["a"].correlation
    assert found is not None
    places = [found.names.index(n) for n in flows]
    matrix = found.array()[np.ix_(places, places)]
    assert matrix[np.triu_indices(4, 1)] == pytest.approx(0.5, abs=0.25)


def test_two_tests_tie_nothing_exactly() -> None:
    tied = np.array([[4.0, 6.0], [6.0, 9.0]])
    assert correlation_of(tied)[0, 1] == pytest.approx(1.0)
    found = shrunk(tied, 1.0)
    assert np.diag(found) == pytest.approx([4.0, 9.0])
    assert correlation_of(found)[0, 1] == pytest.approx(1.0 / 4.0)
    against = shrunk(tied, 1.0, towards=np.array([[1.0, -0.8], [-0.8, 1.0]]))
    assert correlation_of(against)[0, 1] == pytest.approx((1.0 - 3.0 * 0.8) / 4.0)
    assert correlation_of(shrunk(tied, 1e6))[0, 1] == pytest.approx(1.0, abs=1e-5)


# --- the bundle --------------------------------------------------------------------------

NAMES = ["coulomb_nm", "viscous_nm_s_per_rad"]


def correlated(r: float = -0.9) -> dict[str, Any]:
    return {"names": list(NAMES), "matrix": [[1.0, r], [r, 1.0]]}


@pytest.fixture
def rig(rig_text: str) -> Rig:
    return make_rig(rig_text)


@pytest.fixture
def bundle(rig: Rig) -> Bundle:
    friction = Friction.model_validate({**FRICTION, "correlation": correlated()})
    joint = JointCovariance(("c_fill", "c_dis"), np.array([[4.0, 1.0], [1.0, 1.0]]))
    law = LAW.replaced(correlation=Correlation.of(joint, ["c_fill", "c_dis"]))
    return Bundle.new(rig, Parts(friction, FittedValves(a=Valve(discrete=law))), [])


def test_a_bundle_keeps_correlations(bundle: Bundle) -> None:
    content = json.loads(json.dumps(bundle.to_json()))
    assert content["friction"]["correlation"] == correlated()
    assert content["valves"]["a"]["discrete"]["correlation"] == {
        "names": ["c_fill", "c_dis"],
        "matrix": [[1.0, 0.5], [0.5, 1.0]],
    }
    again = bundle_from_json(content, Path("b.json"))
    assert again.to_json() == content
    law = again.valve("a").discrete
    assert law is not None and isinstance(law.correlation, Correlation)


def test_an_older_bundle_has_none() -> None:
    older = read_bundle(golden_bundle("diagnosed"))
    assert older.friction is not None and older.friction.correlation is None
    assert "correlation" not in older.friction.given()


@pytest.mark.parametrize(
    ("spoilt", "message"),
    [
        ({"matrix": [[1.0, 0.5], [0.4, 1.0]]}, "not symmetric"),
        ({"matrix": [[1.0, 1.5], [1.5, 1.0]]}, "outside -1 to 1"),
        ({"matrix": [[1.0, 10**400], [0.0, 1.0]]}, "outside -1 to 1"),
        ({"matrix": [[0.9, 0.0], [0.0, 1.0]]}, "diagonal that is not 1"),
        ({"matrix": [[1.0, 0.5]]}, "not a matrix of 2 rows"),
        ({"matrix": [[1.0], [0.5, 1.0]]}, "not a matrix of 2 rows"),
        ({"names": ["coulomb_nm", "coulomb_nm"]}, "names a parameter twice"),
        ({"names": [], "matrix": []}, "names no parameter"),
        ({"names": ["coulomb_nm", "colour"]}, "of colour, which it does not hold"),
        ({"matrix": "none"}, "friction.correlation"),
        ({"names": [1, 2]}, "friction.correlation"),
        (
            {
                "names": ["coulomb_nm", "viscous_nm_s_per_rad", "static_nm"],
                "matrix": [[1.0, 0.9, 0.9], [0.9, 1.0, -0.9], [0.9, -0.9, 1.0]],
            },
            "negative eigenvalue",
        ),
    ],
)
def test_a_damaged_one_is_refused(bundle: Bundle, spoilt: dict[str, Any], message: str) -> None:
    content = copy.deepcopy(bundle.to_json())
    content["friction"]["correlation"] |= spoilt
    with pytest.raises(InputError, match=message) as refused:
        bundle_from_json(content, Path("b.json"))
    assert len(str(refused.value).splitlines()) == 1 and "b.json" in str(refused.value)


def test_numbers_that_are_replaced_lose_it(bundle: Bundle) -> None:
    friction = bundle.friction
    assert friction is not None
    new = Estimate.symmetric(0.3, 0.01, "Nm", 8.0)
    for made in (
        friction.replaced(coulomb_nm=new),
        friction.overlaid(Friction.model_validate({"coulomb_nm": estimate(0.3)})),
    ):
        assert made.correlation is None and "correlation" not in made.to_json()
        assert made.coulomb_nm is not None and made.coulomb_nm.value == 0.3
    # What is no part of it leaves it, and another one takes its place.
    assert friction.replaced(static_nm=new).correlation == friction.correlation
    other = Correlation.model_validate(correlated(0.3))
    assert friction.replaced(coulomb_nm=new, correlation=other).correlation == other
    assert friction.correlation is not None


def test_a_part_that_is_merged_brings_its_own(bundle: Bundle, rig: Rig) -> None:
    plain = Bundle.new(rig, Parts(Friction.model_validate(FRICTION)), [])
    merged = bundle.merged(plain)
    assert merged.friction is not None and merged.friction.correlation is None
    law = merged.valve("a").discrete
    assert law is not None and law.correlation is not None


def test_a_fitted_bundle_holds_it(rig_text: str) -> None:
    fit = fit_quickly(Bench(on=0.3, off=1.6, end=2.8).trials(66, 1), make_rig(rig_text))
    valves = fit.part().valves
    assert valves is not None
    law = valves.side("a").discrete
    assert isinstance(law, CorrelatedPart) and law.correlation == fit["a"].correlation
    assert law.correlation is not None and len(law.correlation.names) == 6
    friction = fit_friction([swing(3.0)], RIG).part().friction
    assert friction is not None and friction.correlation is not None
    assert friction.correlation.names == ["coulomb_nm", "viscous_nm_s_per_rad", "offset_nm"]
