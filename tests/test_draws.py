"""Posterior draws: the bundle's covariance, tracking errors, bands of open-loop motion."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from datasets.generator.campaign import SMALL, make_campaign
from datasets.generator.files import write_log
from sysid.commands.app import main
from sysid.controllers.tracking_draws import quantiles
from sysid.errors import NotIdentifiedError
from sysid.estimation.linear import Estimate
from sysid.io.logs import read_log
from sysid.io.rig import rig_from_content
from sysid.io.toml_text import toml_text
from sysid.parameters import Bundle, Parts, read_bundle, write_bundle
from sysid.parameters.friction import Friction
from sysid.parameters.valves import FittedValves
from sysid.refinement.draws import drawn_models, posterior_draws, with_test_scatter
from sysid.refinement.prediction_bands import open_loop_bands

SEED, SHARE = 5, 0.03


def estimate(value: float, share: float = SHARE) -> Estimate:
    return Estimate.symmetric(value, share * abs(value), "SI", math.inf)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A motion log, and a bundle of the true parameters, known to 3 %."""
    path = tmp_path_factory.mktemp("draws")
    made = make_campaign(SEED, size=SMALL, kinds=("motion-motor",), stems=("motion_motor",))
    write_log(path / "motor.csv", made.logs[0].tests[:1], made.rig)
    friction = {k: estimate(v) for k, v in made.truth["friction"].items()}
    valves = {
        side: {"discrete": {k: estimate(v) for k, v in law.items()}}
        for side, law in made.truth["valves"].items()
    }
    parts = Parts(Friction.model_validate(friction), FittedValves.model_validate(valves))
    rig = rig_from_content(made.rig.content, "rig.toml")
    write_bundle(Bundle.new(rig, parts, []), path / "bundle.json")
    return path


@pytest.fixture(scope="module")
def bundle(folder: Path) -> Bundle:
    return read_bundle(folder / "bundle.json")


# --- draws -----------------------------------------------------------------------------


def test_draws_have_the_bundles_errors(bundle: Bundle) -> None:
    drawn = posterior_draws(bundle, bundle.rig, bundle.model(), 3000, 1)
    assert len(drawn.models) == 3000 and not drawn.held
    relative = np.std(np.log(drawn.values), axis=0)
    assert relative == pytest.approx(SHARE, rel=0.06)
    at = drawn.names.index("valves.b.c_dis")
    assert drawn.models[7].parameters.c_dis_b == drawn.values[7, at]


def test_draws_have_the_correlation_of_a_fit(bundle: Bundle) -> None:
    held = json.loads(bundle.model_dump_json(by_alias=True, exclude_unset=True))
    keys = ["coulomb_nm", "viscous_nm_s_per_rad"]
    held["friction"]["correlation"] = {"names": keys, "matrix": [[1.0, -0.8], [-0.8, 1.0]]}
    own = Bundle.model_validate(held)
    drawn = posterior_draws(own, bundle.rig, bundle.model(), 2000, 1)
    places = [drawn.names.index(f"friction.{key}") for key in keys]
    logs = np.log(drawn.values[:, places])
    assert np.corrcoef(logs.T)[0, 1] == pytest.approx(-0.8, abs=0.03)


def test_a_draw_is_the_same_in_any_number(bundle: Bundle) -> None:
    few, many = (posterior_draws(bundle, bundle.rig, bundle.model(), n, 4) for n in (3, 9))
    assert np.array_equal(few.values, many.values[:3])
    other = posterior_draws(bundle, bundle.rig, bundle.model(), 3, 5)
    assert not np.array_equal(few.values, other.values)


def test_a_number_without_an_error_is_held_and_said(bundle: Bundle) -> None:
    assert bundle.friction is not None
    bare = Estimate(0.1, math.nan, "Nm", (math.nan, math.nan))
    own = bundle.replaced(friction=bundle.friction.replaced(coulomb_nm=bare))
    drawn = posterior_draws(own, own.rig, own.model(), 5, 1)
    assert drawn.held == ("friction.coulomb_nm",)
    assert "friction.coulomb_nm keep the bundle's value" in drawn.notices()[0]
    assert {m.parameters.coulomb_effort for m in drawn.models} == {0.1}
    assert drawn_models(own, own.rig, own.model(), 5, 1) == []


def test_nothing_can_be_drawn_without_errors(bundle: Bundle) -> None:
    nothing = Estimate(1.0, math.nan, "SI", (math.nan, math.nan))
    fields = dict.fromkeys(bundle.friction.estimates(), nothing) if bundle.friction else {}
    assert bundle.friction is not None
    own = bundle.replaced(friction=bundle.friction.replaced(**fields)).without("valves")
    model = bundle.model()
    with pytest.raises(NotIdentifiedError, match="no fitted number has a standard error"):
        posterior_draws(own, bundle.rig, model, 5, 1)


def test_each_test_has_its_own_friction(bundle: Bundle) -> None:
    model = bundle.model()
    found = with_test_scatter(bundle, [model] * 2000, 3)
    ratio = [m.parameters.coulomb_effort / model.parameters.coulomb_effort for m in found]
    assert np.std(np.log(ratio)) == pytest.approx(0.02, rel=0.1)  # where no bench test shows it
    both = [m.parameters.viscous / model.parameters.viscous for m in found]
    assert ratio == pytest.approx(both)


def test_a_quantile_is_that_of_a_further_draw() -> None:
    """Of 19 draws the smallest is the 5 % quantile: one in twenty further draws lies below."""
    rng = np.random.default_rng(1)
    samples = rng.standard_normal((20, 4000))
    low, high = quantiles(samples[:19], (0.05, 0.95))
    assert np.array_equal(low, samples[:19].min(axis=0))
    inside = np.mean((samples[19] > low) & (samples[19] < high))
    assert inside == pytest.approx(0.9, abs=0.02)


# --- bands -----------------------------------------------------------------------------


def test_a_band_holds_the_motion_of_a_drawn_rig(folder: Path, bundle: Bundle) -> None:
    """The log is the truth's, the bundle's numbers are the truth: the band is about it."""
    log = read_log(folder / "motor.csv", bundle.rig)
    drawn = posterior_draws(bundle, bundle.rig, bundle.model(), 40, 2)
    (bands,) = open_loop_bands(bundle, bundle.rig, drawn, log.trials, 2)
    trial = log.trials[0]
    assert set(bands) == {bundle.rig.position_channel, "pressure_a_pa", "pressure_b_pa"}
    for name, band in bands.items():
        assert (band.high >= band.low).all()
        assert band.holds(trial[name]).mean() > 0.6
    wide = bands[bundle.rig.position_channel]
    assert wide.high[-1] - wide.low[-1] > 10.0 * (wide.high[0] - wide.low[0])


def test_simulate_writes_bands(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["simulate", str(folder / "motor.csv"), "--bundle", str(folder / "bundle.json")]
    more = ["--draws", "20", "--seed", "3", "--json", "-o"]
    assert main([*words, *more, str(tmp_path / "one.csv")]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["draws"]["count"] == 20 and told["draws"]["share"] == 0.9
    assert main([*words, "--jobs", "2", *more, str(tmp_path / "two.csv")]) == 0
    capsys.readouterr()
    texts = [(tmp_path / name).read_text() for name in ("one.csv", "two.csv")]
    assert texts[0] == texts[1]
    frame = pd.read_csv(tmp_path / "one.csv", comment="#")
    assert (frame["theta_rad_p05"] <= frame["theta_rad_p95"]).all()
    assert main([*words, "--draws", "20", "--valve-model", "averaged", "-o", "x.csv"]) in (2, 3)


def test_validate_counts_what_lies_in_the_bands(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "rig.toml").write_text(toml_text(read_bundle(folder / "bundle.json").rig.content))
    (tmp_path / "motor.csv").write_bytes((folder / "motor.csv").read_bytes())
    entry = '[[log]]\nkind = "motion-motor"\nfile = "motor.csv"\nuse = "holdout"\n'
    (tmp_path / "campaign.toml").write_text(f'rig = "rig.toml"\n{entry}')
    words = ["validate", str(tmp_path / "campaign.toml"), "--bundle", str(folder / "bundle.json")]
    assert main([*words, "--draws", "20", "--json"]) == 0
    bands = json.loads(capsys.readouterr().out)["bands"]
    (log,) = bands["logs"]
    assert bands["draws"] == 20 and log["use"] == "holdout"
    assert set(log["in_band"]) == {"theta_rad", "pressure_a_pa", "pressure_b_pa"}
    assert all(0.5 < share <= 1.0 for share in log["in_band"].values())


# --- closed loop -----------------------------------------------------------------------


def test_control_shows_the_distribution(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["control", str(folder / "bundle.json"), "--controller", "pva", "--trajectory", "1"]
    words += ["--mode", "pneumatic", "--draws", "33"]
    assert main([*words, "-o", str(tmp_path / "out"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    drawn = told["draws"]
    values = np.array(drawn["rmse_rad"]["values"])
    assert len(values) == drawn["count"] == 33 and np.std(values) > 0.0
    assert drawn["rmse_rad"]["p05"] < drawn["rmse_rad"]["median"] < drawn["rmse_rad"]["p95"]
    frame = pd.read_csv(tmp_path / "out" / "draws.csv", comment="#")
    assert frame["rmse_rad"].to_numpy() == pytest.approx(values, rel=1e-12)
    assert "valves.a.c_fill" in frame
    bands = pd.read_csv(tmp_path / "out" / "bands.csv", comment="#")
    assert (bands["error_rad_p05"] <= bands["error_rad_p95"]).all()
    names = {Path(p).name for p in told["written"]}
    assert {"draws.csv", "bands.csv", "run.csv"} <= names
    assert main(["--jobs", "2", *words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["draws"] == drawn
    assert main(words) == 0
    assert "Over 33 draws of the plant" in capsys.readouterr().out
