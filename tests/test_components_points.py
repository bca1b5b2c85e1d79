"""Friction from readings: made ones with an effect and without, and the thesis' tables."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from datasets.measured.sets import PROJECT, SETS_FOLDER, read_set
from datasets.thesis.recompute import sliding_friction, static_friction
from sysid.commands.app import main
from sysid.diagnosis.bench.component import Law
from sysid.diagnosis.bench.diagnose import diagnose_component
from sysid.diagnosis.bench.fitting import fit_law
from sysid.diagnosis.bench.friction_readings import KIND, FrictionPoints, friction_points
from sysid.diagnosis.bench.registry import component_of
from sysid.diagnosis.bench.selection import Selection, folds_of, select
from sysid.errors import InputError, NotIdentifiedError
from sysid.estimation.linear import Estimate
from sysid.io.campaign import BENCH_KINDS, read_campaign
from sysid.io.conversion import convert
from sysid.io.logs import Trial
from sysid.io.rig import Rig
from sysid.parameters import Bundle, Parts
from sysid.parameters.files import shipped_schema
from sysid.pipeline.fit_part import bench_fit
from sysid.plant.effects import catalogue
from sysid.plant.effects.linear import for_rig
from sysid.types import FloatArray

AXIS, LINEAR_AXIS = (Rig("axis", "horizontal", motion) for motion in ("rotary", "linear"))
SPEED, TORQUE = "velocity_rad_per_s", "motor_torque_nm"
STATIC, COULOMB, VISCOUS = 0.33, 0.2, 0.05  # Nm, Nm, Nm s/rad
ANGLES = np.repeat(np.linspace(-1.5, 1.5, 7), 4)  # rad
WAYS = np.where(np.arange(len(ANGLES)) % 2, -1.0, 1.0)
NOISE_NM, NOISE_RAD_PER_S = 0.01, 0.05
TORQUES = np.repeat([0.25, 0.3, 0.35, 0.4, 0.5], 6)  # Nm


def readings(speed: Any, torque: Any, angle: Any = None, label: str = "t") -> Trial:
    channels = {SPEED: np.asarray(speed, dtype=float), TORQUE: np.asarray(torque, dtype=float)}
    if angle is not None:
        channels["theta_rad"] = np.asarray(angle, dtype=float)
    return Trial(label, np.arange(len(channels[SPEED]), dtype=np.float64), channels, "made.csv")


def noise(count: int, seed: int = 0) -> FloatArray:
    return np.asarray(np.random.default_rng(seed).normal(size=count))


def breakaways(sine: float = 0.0, asymmetry: float = 0.0, seed: int = 0) -> FrictionPoints:
    """Breakaway at seven angles, twice each way; in closed form, not through the ports."""
    return friction_points([breakaway_log(sine, asymmetry, seed)], AXIS)


def breakaway_log(sine: float = 0.0, asymmetry: float = 0.0, seed: int = 0) -> Trial:
    torque = STATIC * WAYS * (1.0 + sine * np.sin(1.2 * ANGLES)) + asymmetry
    return readings(0.0 * WAYS, torque + NOISE_NM * noise(len(WAYS), seed), ANGLES)


def steady(drag: float, seed: int = 0, torques: FloatArray = TORQUES) -> FrictionPoints:
    """Speeds at torques set: coulomb + viscous v + drag v^2 = torque, solved for v."""
    excess = torques - COULOMB
    speed = 2.0 * excess / (VISCOUS + np.sqrt(VISCOUS**2 + 4.0 * drag * excess))
    return friction_points(
        [readings(speed + NOISE_RAD_PER_S * noise(len(speed), seed), torques)], AXIS
    )


def swept(
    speed: FloatArray, seed: int = 0, stribeck: float = 0.0, scatter: float = 0.02
) -> FrictionPoints:
    """Torques that followed speeds which a controller set, each both ways."""
    speed = np.concatenate([speed, -speed])
    size = np.abs(speed)
    torque = COULOMB + VISCOUS * size + stribeck * np.exp(-size / 0.3)
    torque = np.sign(speed) * (torque + scatter * noise(len(speed), seed))
    return friction_points([readings(speed, torque)], AXIS)


def sliding_along(drag: float, seed: int = 0) -> FrictionPoints:
    """Forces (N) that followed speeds (m/s) of a linear axis, each both ways."""
    speed = np.repeat([0.02, 0.05, 0.1, 0.2, 0.3], 6) * np.tile([1.0, -1.0], 15)
    force = np.sign(speed) * (12.0 + 40.0 * np.abs(speed) + drag * speed**2)
    force += 0.1 * noise(len(speed), seed)
    channels = {"velocity_m_per_s": speed, "motor_force_n": force}
    time = np.arange(len(speed), dtype=np.float64)
    return friction_points([Trial("t", time, channels, "made.csv")], LINEAR_AXIS)


def ids(component: FrictionPoints) -> set[str]:
    return {kind.id for kind in component.effects(catalogue())}


def found(selection: Selection) -> list[str]:
    return [addition.id for addition in selection.additions]


# --- made readings ---------------------------------------------------------------------


@pytest.mark.parametrize(
    ("component", "effect"),
    [
        (breakaways(), None),
        (breakaways(sine=0.3), "position-dependent-friction"),
        (breakaways(asymmetry=0.04), "asymmetric-coulomb-friction"),
        (steady(0.0), None),
        (steady(0.02), "quadratic-drag"),
    ],
    ids=["breakaway", "position", "direction", "sliding", "drag"],
)
def test_what_is_missing_is_found_and_nothing_else(
    component: FrictionPoints, effect: str | None
) -> None:
    selection = select(component, catalogue())
    assert found(selection) == ([] if effect is None else [effect])
    for name, true in (("static_nm", STATIC), ("coulomb_nm", COULOMB)):
        if name in selection.base.law.values and effect is None:
            estimate = selection.base.base_estimates()[name]
            assert abs(estimate.value - true) < 4.0 * estimate.std
    folds = selection.additions[-1].folds if effect else selection.folds
    assert math.sqrt(float(np.mean(folds))) == pytest.approx(
        component.noise_floor(selection.final.law), rel=0.3
    )


def test_a_linear_axis_has_forces_and_a_way() -> None:
    effects = for_rig(catalogue(), is_linear=True)
    plain = select(sliding_along(0.0), effects)
    assert found(plain) == [] and plain.base.component.unit == "N"
    estimates = plain.base.base_estimates()
    for name, true, unit in (("coulomb_n", 12.0, "N"), ("viscous_n_s_per_m", 40.0, "N s/m")):
        assert abs(estimates[name].value - true) < 4.0 * estimates[name].std
        assert estimates[name].unit == unit
    dragged = select(sliding_along(60.0), effects)
    assert found(dragged) == ["quadratic-drag"]
    addition = dragged.additions[0]
    drag = addition.fitted.estimates(addition.effect)["drag_nm_s2_per_rad2"]
    assert abs(drag.value - 60.0) < 4.0 * drag.std


def test_a_table_without_time_is_converted_checked_and_fitted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    part = sliding_along(0.0)
    rows = [f"{1e3 * v};{1e-3 * f}" for v, f in zip(part.velocity, part.effort, strict=True)]
    Path("curve.csv").write_text("\n".join(["v (mm/s);F (kN)", *rows, ""]))
    maps = ["--map", "velocity_m_per_s=v (mm/s)", "--map", "motor_force_n=F (kN)"]
    assert main(["convert", "curve.csv", "-o", "log.csv", *maps, "--trim", "0:1"]) == 2
    assert "holds no time" in capsys.readouterr().err and not Path("log.csv").exists()
    assert main(["convert", "curve.csv", "-o", "log.csv", *maps]) == 0
    assert main(["check", "log.csv"]) == 0
    told = capsys.readouterr()
    assert "1 x friction-points; 30 readings" in told.out and "every" not in told.out
    assert main(["check", "log.csv", "--json"]) == 0
    (log,) = json.loads(capsys.readouterr().out)["logs"]
    assert log["by_row"] and all(channel["noise_std"] is None for channel in log["channels"])
    assert main(["fit", "friction", "log.csv", "--no-report", "--json"]) == 0
    told = capsys.readouterr()
    assert "from the log: sampling period" not in told.err
    coulomb = json.loads(told.out)["friction"]["coulomb_n"]
    assert coulomb["interval"][0] < 12.0 < coulomb["interval"][1]


def test_strengths_are_those_of_the_made_readings() -> None:
    for component, true in (
        (breakaways(sine=0.3), {"friction_sine": 0.3, "friction_wave_per_rad": 1.2}),
        (breakaways(asymmetry=0.04), {"asymmetry_nm": 0.04}),
        (steady(0.02), {"drag_nm_s2_per_rad2": 0.02}),
    ):
        addition = select(component, catalogue()).additions[0]
        estimates = addition.fitted.estimates(addition.effect)
        for name, value in true.items():
            assert abs(estimates[name].value - value) < 4.0 * estimates[name].std, name


def off_centre(
    offset: float, seed: int = 0, is_speed_set: bool = True, is_linear: bool = False
) -> Trial:
    """Readings both ways of a rig, whose efforts or speeds scatter, with a constant effort."""
    size = np.repeat([0.1, 0.2, 0.4, 0.7, 1.0], 4)
    way = np.repeat([1.0, -1.0], len(size))
    if is_speed_set:
        speed = way * np.tile(size, 2)
        effort = COULOMB * way + VISCOUS * speed + offset + 0.004 * noise(len(way), seed)
    else:
        effort = way * (COULOMB + abs(offset) + 0.1 * np.tile(size, 2))
        speed = (effort - offset - COULOMB * way) / VISCOUS + 0.02 * noise(len(way), seed)
    names = ("velocity_m_per_s", "motor_force_n") if is_linear else (SPEED, TORQUE)
    time = np.arange(len(way), dtype=np.float64)
    return Trial("t", time, dict(zip(names, (speed, effort), strict=True)), "made.csv")


@pytest.mark.parametrize("is_linear", [False, True], ids=["rotary", "linear"])
@pytest.mark.parametrize("is_speed_set", [True, False], ids=["speed set", "effort set"])
def test_readings_both_ways_show_an_offset(is_speed_set: bool, is_linear: bool) -> None:
    rig = LINEAR_AXIS if is_linear else AXIS
    trial = off_centre(0.05, 4, is_speed_set, is_linear)
    component = friction_points([trial], rig)
    assert component.is_speed_set is is_speed_set
    fitted = fit_law(component, (), range(len(trial)))
    estimates, u = fitted.base_estimates(), rig.units
    for name, true in (("coulomb", COULOMB), ("viscous", VISCOUS), ("offset", 0.05)):
        estimate = estimates[u.key(name)]
        assert abs(estimate.value - true) < 4.0 * estimate.std < 0.4 * true
        assert estimate.unit == u.unit(name)
    assert fitted.quality().verdict == "good"
    # An offset is what differs with the direction: nothing else does so more simply.
    assert "asymmetric-coulomb-friction" not in {k.id for k in component.effects(catalogue())}
    part = bench_fit(KIND, [trial], rig)
    assert part.part().friction.offset == estimates[u.key("offset")]  # type: ignore[union-attr]
    assert any("with the direction: an offset of 0.0" in line for line in part.notices)


def test_an_offset_is_in_the_table_the_bundle_and_no_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("rig.toml").write_text('[rig]\nname = "axis"\norientation = "horizontal"\n')
    head = 'rig = "rig.toml"\n\n[[log]]\nkind = "friction-points"\nfile = "readings.csv"\n'
    Path("campaign.toml").write_text(head)
    trial = off_centre(0.05, 4)
    rows = [f"{v},{e}" for v, e in zip(trial[SPEED], trial[TORQUE], strict=True)]
    Path("readings.csv").write_text("\n".join([f"{SPEED},{TORQUE}", *rows, ""]))
    assert main(["fit", "campaign.toml", "-o", "bundle.json"]) == 0
    told = capsys.readouterr()
    assert "friction differs with the direction" in told.err + told.out
    offset = json.loads(Path("bundle.json").read_text())["friction"]["offset_nm"]
    assert offset["value"] == pytest.approx(0.05, abs=4.0 * offset["std"])
    assert main(["diagnose", "campaign.toml", "--bundle", "bundle.json", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["verdict"] == "adequate" and not found["effects"]


def test_no_offset_is_made_up() -> None:
    trial = off_centre(0.0, 3)
    whole = fit_law(friction_points([trial], AXIS), (), range(len(trial))).base_estimates()
    low, high = whole["offset_nm"].interval
    assert low < 0.0 < high and high - low < 0.1 * COULOMB
    assert not any("offset" in line for line in bench_fit(KIND, [trial], AXIS).notices)
    # Of one direction it is not known.
    ahead = trial[SPEED] > 0.0
    one_way = friction_points([readings(trial[SPEED][ahead], trial[TORQUE][ahead])], AXIS)
    assert [p.name for p in one_way.parameters()] == ["coulomb_nm", "viscous_nm_s_per_rad"]


def at_one_level(how: str, ways: tuple[float, ...], seed: int) -> Trial:
    """Eight readings each way at one speed or torque, the offset 0.05; friction scatters by 3 %."""
    way = np.repeat(ways, 8)
    friction = 1.0 + 0.03 * noise(len(way), seed)
    if how == "torque":
        torque = 0.3 * way
        return readings(way * ((way * (torque - 0.05)) / friction - COULOMB) / VISCOUS, torque)
    speed = np.where(way > 0.0, 0.5, -0.6) if how == "a speed each way" else 0.5 * way
    if how == "measured speed":
        speed = speed * (1.0 + 0.01 * noise(len(way), 50 + seed))
    return readings(speed, (COULOMB * way + VISCOUS * speed) * friction + 0.05)


@pytest.mark.parametrize("how", ["speed", "a speed each way", "measured speed", "torque"])
@pytest.mark.parametrize("ways", [(1.0, -1.0), (1.0,)], ids=["both ways", "one way"])
def test_one_level_identifies_the_sum_of_friction_and_the_offset(
    how: str, ways: tuple[float, ...]
) -> None:
    truth = {"coulomb_nm": COULOMB, "viscous_nm_s_per_rad": VISCOUS, "offset_nm": 0.05}
    held, offsets = [], []
    for seed in range(40):
        found = bench_fit(KIND, [at_one_level(how, ways, seed)], AXIS).part().friction
        assert found is not None
        if len(found.sums()) != 1:  # by chance the scatter shows a slope
            continue
        (row,) = found.sums().values()
        wanted = sum(c * truth[name] for c, name in zip(row.coefficients, row.of, strict=True))
        held.append(row.estimate.holds(wanted))
        assert not any(getattr(found, name).identified for name in row.of)
        assert ("offset_nm" in row.of) == (len(ways) == 1)
        if len(ways) == 2:
            assert found.offset_nm is not None
            offsets.append(found.offset_nm.holds(0.05))
    assert len(held) >= 34 and sum(held) >= 0.87 * len(held)
    assert sum(offsets) >= 0.87 * len(offsets)


def test_the_scatter_decides_whether_speeds_are_one() -> None:
    """Two speeds a tenth apart: of exact readings two numbers, of noisy ones the sum."""
    speed = np.repeat([0.5, 0.55, -0.5, -0.55], 3)
    for size, told in ((0.0005, True), (0.06, False)):
        torque = COULOMB * np.sign(speed) + VISCOUS * speed + size * noise(12, 1)
        friction = bench_fit(KIND, [readings(speed, torque)], AXIS).part().friction
        assert friction is not None and friction.coulomb_nm is not None
        assert friction.coulomb_nm.identified is told and (not friction.sums()) is told


def test_readings_at_one_speed_are_diagnosed_by_their_sum(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rig.toml").write_text('[rig]\nname = "axis"\norientation = "horizontal"\n')
    log = f'[[log]]\nkind = "{KIND}"\nfile = "{{0}}.csv"\nuse = "{{1}}"\n'
    logs = log.format("one", "fit") + log.format("other", "holdout")
    (tmp_path / "campaign.toml").write_text(f'rig = "rig.toml"\n{logs}')
    for seed, name in enumerate(["one", "other"]):
        trial = at_one_level("speed", (1.0, -1.0), seed)
        rows = [f"{v},{e}" for v, e in zip(trial[SPEED], trial[TORQUE], strict=True)]
        Path(f"{name}.csv").write_text("\n".join([f"{SPEED},{TORQUE}", *rows, ""]))
    assert main(["check", "one.csv", "--json"]) == 0
    known = {
        row["parameter"]: row
        for row in json.loads(capsys.readouterr().out)["logs"][0]["identifies"]
    }
    assert known["torque offset"]["identified"] and not known["Coulomb friction"]["identified"]
    assert main(["fit", "campaign.toml", "-o", "bundle.json"]) == 0
    assert "readings at another speed would separate its parts" in capsys.readouterr().err
    assert main(["diagnose", "campaign.toml", "--bundle", "bundle.json", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["verdict"] == "adequate"
    assert told["residual"][TORQUE]["before"] < 0.02


def test_held_out_readings_of_one_direction_have_the_offset_of_both() -> None:
    component = friction_points([off_centre(0.05, 4)], AXIS)
    fitted = fit_law(component, (), range(len(component.tests)))
    bundle = Bundle.new(AXIS, fitted.part(), [])
    ahead = friction_points([readings([0.2, 0.7], [0.26, 0.285])], AXIS).in_form_of(bundle)
    law = ahead.law_of(bundle)
    assert law.values == fitted.law.values
    assert np.concatenate(ahead.residuals(law, [0, 1])) == pytest.approx([0.0, 0.0], abs=0.01)


def test_the_slope_is_not_flattened_by_the_scatter_of_the_speeds() -> None:
    torques = np.repeat([0.25, 0.27], 200)
    component = steady(0.0, torques=torques)
    speed = component.velocity
    flattened = np.polyfit(speed, torques, 1)[0]
    fitted = fit_law(component, (), range(len(torques))).base_estimates()["viscous_nm_s_per_rad"]
    assert abs(fitted.value - VISCOUS) < 3.0 * fitted.std < VISCOUS - flattened


def test_what_was_set_is_what_repeats_or_over_which_the_other_is_smooth() -> None:
    assert not steady(0.0).is_speed_set
    levels = np.repeat(np.linspace(0.3, 3.0, 5), 6)
    assert swept(levels).is_speed_set
    # Means over a stretch of each motion repeat no value; friction falls, then rises with speed.
    means = np.linspace(0.01, 3.0, 40) * (1.0 + 1e-3 * noise(40, 3))
    assert swept(means, stribeck=0.1, scatter=1e-3).is_speed_set
    # Nothing shows it: as in the thesis.
    assert not swept(np.array([0.5, 1.0, 1.6]), scatter=0.0).is_speed_set
    assert not breakaways().is_speed_set


def test_the_slope_is_not_steepened_by_the_scatter_of_the_torques() -> None:
    component = swept(np.repeat(np.linspace(0.1, 1.0, 8), 12))
    size, effort = np.abs(component.velocity), np.abs(component.effort)
    steepened = 1.0 / np.polyfit(effort, size, 1)[0]
    fitted = fit_law(component, (), range(len(size))).base_estimates()
    viscous, coulomb = fitted["viscous_nm_s_per_rad"], fitted["coulomb_nm"]
    assert abs(viscous.value - VISCOUS) < 3.0 * viscous.std < steepened - VISCOUS
    assert abs(coulomb.value - COULOMB) < 3.0 * coulomb.std
    assert (component.channel, component.unit) == (TORQUE, "Nm")
    assert component.noise_floor(Law({})) == pytest.approx(0.02, rel=0.15)


def test_readings_without_repeats_have_neighbours_of_one_way() -> None:
    component = swept(np.linspace(0.01, 3.0, 60) * (1.0 + 1e-3 * noise(60, 3)), stribeck=0.1)
    assert component.is_speed_set
    assert component.noise_floor(Law({})) == pytest.approx(0.02, rel=0.25)


def test_held_out_readings_are_of_what_followed_in_the_fitted_ones() -> None:
    component = swept(np.repeat(np.linspace(0.1, 1.0, 8), 12))
    fitted = fit_law(component, (), range(len(component.tests)))
    part = component.part(fitted.base_estimates(), fitted.quality())
    bundle = Bundle.new(AXIS, part, [])
    few = friction_points([readings([0.2, 0.7], [0.21, 0.24])], AXIS)
    assert not few.is_speed_set and few.in_form_of(bundle).channel == TORQUE
    residuals = few.in_form_of(bundle).residuals(fitted.law, [0, 1])
    known = [0.21 - COULOMB - 0.2 * VISCOUS, 0.24 - COULOMB - 0.7 * VISCOUS]
    assert np.concatenate(residuals) == pytest.approx(known, abs=0.01)
    assert steady(0.0).in_form_of(Bundle.new(AXIS, Parts(), [])).channel == SPEED


def test_effects_are_tried_only_where_the_conditions_tell_them_from_the_law() -> None:
    # Sets at two torques: any curve over the speed passes as a line.
    assert ids(steady(0.0, torques=np.repeat([0.25, 0.27], 6))) == set()
    curved = {"quadratic-drag", "stribeck-friction", "power-law-friction"}
    assert ids(steady(0.0)) == curved
    acting = ids(breakaways())
    assert {"position-dependent-friction", "asymmetric-coulomb-friction"} <= acting
    assert not acting & {*curved, "seal-friction", "backlash", "presliding", "torque-offset"}
    one_way = friction_points([readings(np.zeros(9), STATIC + 0.01 * noise(9))], AXIS)
    assert ids(one_way) == set()


def test_each_reading_is_left_out_by_itself() -> None:
    component = breakaways()
    assert len(component.tests) == len(ANGLES) == component.most_folds
    assert folds_of(component) == [[i] for i in range(len(ANGLES))]


def test_the_noise_floor_is_the_spread_of_repeats_or_of_neighbours() -> None:
    torque = [0.3, 0.34, 0.4, 0.42]
    pairs = friction_points([readings(np.zeros(4), torque, [0.0, 0.0, 1.0, 1.0])], AXIS)
    law = Law({"static_nm": STATIC})
    assert pairs.noise_floor(law) == pytest.approx(math.sqrt((2 * 0.02**2 + 2 * 0.01**2) / 2))
    alone = friction_points([readings(np.zeros(4), torque, [0.0, 1.0, 2.0, 3.0])], AXIS)
    assert alone.noise_floor(law) == pytest.approx(math.sqrt(0.5 * np.mean(np.diff(torque) ** 2)))


# --- the bundle and bad input ------------------------------------------------------------


@pytest.mark.parametrize("component", [breakaways(), steady(0.0)], ids=["breakaway", "sliding"])
def test_the_part_is_in_the_schema_and_gives_the_law_back(component: FrictionPoints) -> None:
    import jsonschema

    values = {p.name: p.value for p in component.parameters()}
    part = component.part({n: Estimate(v, 0.1, "Nm", (0.0, 1.0)) for n, v in values.items()})
    assert part.friction is not None
    whole = shipped_schema()
    schema = {"$defs": whole["$defs"], **whole["properties"]["friction"]}
    jsonschema.validate(part.friction.to_json(), schema)
    assert component.law_of(Bundle.new(AXIS, part, [])).values == values
    absent = {"static_nm", "coulomb_nm", "viscous_nm_s_per_rad"} - values.keys()
    for name in absent:
        assert "no reading shows it" in str(part.friction.estimates()[name].reason)
    with pytest.raises(NotIdentifiedError, match="fit friction-points"):
        component.law_of(Bundle.new(AXIS, Parts(), []))


@pytest.mark.parametrize(
    ("speed", "torque", "said"),
    [
        ([0.0, 1.0], [0.3, 0.3], "are mixed with sliding"),
        ([0.0, 0.0], [0.3, 0.0], "reading 2: motor_torque_nm = 0 is zero"),
        ([1.0, -1.0], [0.3, 0.3], "reading 2.*against the motion at -1"),
    ],
)
def test_readings_that_cannot_be_used(speed: Any, torque: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        friction_points([readings(speed, torque)], AXIS)


def test_what_is_not_there_is_said() -> None:
    with pytest.raises(NotIdentifiedError, match="give breakaway or sliding readings"):
        friction_points([], AXIS)
    bare = readings([0.0], [0.3])
    for name in (SPEED, TORQUE):
        channels = {n: v for n, v in bare.channels.items() if n != name}
        with pytest.raises(InputError, match=f"column {name} is missing"):
            friction_points([Trial("t", bare.time, channels, "made.csv")], AXIS)
    level = friction_points([readings([1.0, 1.1, -1.0], [0.3, 0.3, -0.3])], AXIS)
    told = fit_law(level, (), range(3)).part().friction
    assert told is not None and told.viscous is not None
    assert "readings at another torque" in (told.viscous.reason or "")
    with pytest.raises(NotIdentifiedError, match=r"static_nm is not identified.*of breakaway"):
        breakaways().residuals(Law({"coulomb_nm": 0.2, "viscous_nm_s_per_rad": 0.05}), [0])


# --- the thesis' tables ------------------------------------------------------------------


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The set's logs, converted by its recipes, beside its campaigns."""
    folder = tmp_path_factory.mktemp("thesis_friction")
    measured = read_set(SETS_FOLDER / "thesis_friction")
    assert measured.data == "project" and KIND in BENCH_KINDS
    for entry in measured.conversions:
        sources = [PROJECT / entry.folder / source for source in entry.sources]
        convert(
            sources, folder / entry.log, spec_file=measured.path / entry.recipe, rows=entry.rows
        )
    for path in measured.path.glob("*.toml"):
        (folder / path.name).write_text(path.read_text())
    return folder


def trials_of(path: Path) -> list[Trial]:
    campaign = read_campaign(path)
    return [t for entry in campaign.logs for t in campaign.read(entry).trials]


def component_at(path: Path) -> FrictionPoints:
    component = component_of(KIND, trials_of(path), read_campaign(path).rig)
    assert isinstance(component, FrictionPoints)
    return component


def test_the_fits_are_those_of_the_friction_pipeline(tables: Path) -> None:
    static = component_at(tables / "static.toml")
    assert len(static.tests) == 18 and set(static.position) == {-1.0, 0.0, 1.0}
    fitted = fit_law(static, (), range(18)).law.values
    assert fitted["static_nm"] == pytest.approx(static_friction().estimate.value, rel=1e-5)
    sliding = component_at(tables / "sliding.toml")
    fitted = fit_law(sliding, (), range(12)).law.values
    known = sliding_friction()
    assert fitted["coulomb_nm"] == pytest.approx(known.coulomb.value, rel=1e-4)
    assert fitted["viscous_nm_s_per_rad"] == pytest.approx(known.viscous.value, rel=1e-4)


def test_three_parts_share_no_reading(tables: Path) -> None:
    parts = [component_at(tables / f"repeat_{k}.toml") for k in (1, 2, 3)]
    whole = component_at(tables / "static.toml")
    for place in (-1.0, 0.0, 1.0):
        dealt = [effort for part in parts for effort in part.effort[part.position == place]]
        assert dealt == list(whole.effort[whole.position == place])


def diagnosed(path: Path) -> Any:
    component = component_at(path)
    fitted = fit_law(component, (), range(len(component.tests)))
    rig = read_campaign(path).rig
    bundle = Bundle.new(rig, component.part(fitted.base_estimates()), [])
    return diagnose_component(KIND, trials_of(path), [], rig, bundle, catalogue())


def test_static_friction_depends_on_the_place(tables: Path) -> None:
    """As the F test of `datasets.thesis.recompute` says; left out one by one."""
    assert static_friction().tests["position"].p_value < 1e-4
    result = diagnosed(tables / "static.toml")
    assert [e.effect.id for e in result.effects] == ["position-dependent-friction"]
    error = result.residual[TORQUE]
    assert error.after < 0.7 * error.before
    # The pooled spread at one place, which a mean for each place leaves, and the numbers' errors.
    assert 1.0 < error.noise_floor / static_friction().repeatability < 1.3


def test_one_line_describes_the_two_torques(tables: Path) -> None:
    result = diagnosed(tables / "sliding.toml")
    assert result.verdict == "adequate" and not result.effects
    assert result.residual[SPEED].before == result.residual[SPEED].after
