"""Bundles with effects: built into a model, written back, simulated, validated, exported."""

from __future__ import annotations

import dataclasses
import json
import math
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export_bundles import RISING, whole_bundle
from other_catalogues import USER_EFFECT
from test_validation import true_bundle, written

from datasets.generator.campaign import SMALL, make_campaign
from datasets.generator.effects import Injected
from sysid.commands.app import main
from sysid.errors import InputError
from sysid.estimation.linear import Estimate
from sysid.exporters import export_bundle
from sysid.io.campaign import MOTION_KINDS
from sysid.io.logs import Trial
from sysid.io.rig import Rig, rig_from_content
from sysid.parameters import Bundle, HeldOutError, bundle_text, read_bundle, write_bundle
from sysid.parameters.assembled_model import (
    effects_from_bundle,
    model_from_bundle,
    parameters_from_bundle,
)
from sysid.parameters.effects import effect_from_entry, entry_of
from sysid.parameters.files import bundle_from_json
from sysid.plant.effects.catalogue import catalogue
from sysid.plant.effects.chamber import NEVER_SETTLES_S, TemperatureDrift
from sysid.plant.effects.entry import CatalogueEffect, Quantity
from sysid.plant.effects.linkage import Backlash, LinkFlexibility
from sysid.plant.effects.supply import ExhaustBackPressure
from sysid.plant.effects.valve import DutyDeadZone
from sysid.plant.ports import Model
from sysid.plant.sensors import before_sensors, through_sensors
from sysid.plant.simulator import Inputs, ValveCommand, open_intervals, simulate
from sysid.plant.trials import simulate_trials
from sysid.recording.motion_tests import MotionTest, Segment
from sysid.recording.simulation import simulate_segments
from sysid.recording.start_states import ChannelNoise
from sysid.validation.open_loop import validate


class Described(CatalogueEffect):
    """Test-only: what the entry of an effect needs beside its own."""

    title = "test"
    signature = "test"
    source = "test"


@dataclass(frozen=True)
class Push(Described):
    """Test-only: a torque that grows with the test's time."""

    push_nm: Any = 0.0
    push_rate_nm_per_s: Any = 0.0
    id = "push"
    subsystem = "mechanics"
    quantities = (
        Quantity("push_nm", "Nm", 0.01, -2.0, 2.0, "torque"),
        Quantity("push_rate_nm_per_s", "Nm/s", 0.01, -2.0, 2.0, "its growth"),
    )

    def external_effort(self, effort: Any, point: Any) -> Any:
        return effort + self.push_nm + self.push_rate_nm_per_s * point.time


@dataclass(frozen=True)
class Sensor(Described):
    """Test-only: a pressure sensor's offset and gain, and its drift with the test's time."""

    offset_pa: Any = 0.0
    gain_error: Any = 0.0
    drift_pa_per_s: Any = 0.0
    side: str = "both"
    id = "sensor"
    subsystem = "sensor"
    quantities = (
        Quantity("offset_pa", "Pa", 1e3, -1e5, 1e5, "added"),
        Quantity("gain_error", "-", 0.01, -0.1, 0.1, "relative"),
        Quantity("drift_pa_per_s", "Pa/s", 1e3, -1e5, 1e5, "growth"),
    )

    def measure(self, channels: Any, time: Any) -> dict[str, Any]:
        found = dict(channels)
        for side in "ab":
            name = f"pressure_{side}_pa"
            if self.side in (side, "both") and name in found:
                shown = found[name] * (1.0 + self.gain_error) + self.offset_pa
                found[name] = shown + self.drift_pa_per_s * time
        return found


@dataclass(frozen=True)
class Late(Described):
    """Test-only: delays that grow with the test's time, and one extra state."""

    growth: Any = 0.0
    id = "late"
    subsystem = "valve"
    quantities = (Quantity("growth", "-", 1e-3, 0.0, 0.1, "delay per time"),)
    states = ("late_state",)

    def delays(self, delays: Any, times: Any, opening: bool, side: str) -> Any:
        return delays + self.growth * np.maximum(times, 0.0)

    def initial_states(self, point: Any) -> dict[str, Any]:
        return {"late_state": 0.0}

    def state_rates(self, point: Any, flows: Any) -> dict[str, Any]:
        return {"late_state": 0.0 * point.time}


CATALOGUE = {e.id: e for e in (Push, Sensor, Late)}


def fitted(value: float, std: float, unit: str) -> Estimate:
    """A number with its standard error, and no interval."""
    return Estimate(value, std, unit, (math.nan, math.nan))


@pytest.fixture
def bundle(rig_text: str) -> Bundle:
    """A whole bundle, with two effects."""
    push = {"push_nm": Estimate(0.25, 0.01, "Nm", (0.24, math.inf))}
    sensor = {"offset_pa": fitted(2e3, 5.0, "Pa"), "gain_error": fitted(0.01, math.nan, "-")}
    effects = [entry_of(Push(0.25, 0.0), push), entry_of(Sensor(2e3, 0.01, side="a"), sensor)]
    return whole_bundle(rig_text, [RISING] * 4).replaced(effects=effects)


@pytest.fixture
def content(bundle: Bundle) -> dict[str, Any]:
    """The bundle as its file holds it."""
    found: dict[str, Any] = json.loads(bundle_text(bundle))
    return found


@pytest.fixture
def rig(rig_text: str) -> Rig:
    return rig_from_content(tomllib.loads(rig_text), "rig.toml")


# --- there and back -----------------------------------------------------------------------


def test_round_trip_through_a_file(content: dict[str, Any], tmp_path: Path) -> None:
    content["effects"][0] |= {
        "p_value": 1e-40,
        "holdout_rmse": {"theta_rad": {"before": 0.021, "after": 0.0031}},
        "ambiguous_with": ["cable-spring"],
    }
    path = tmp_path / "bundle.json"
    write_bundle(bundle_from_json(content, path), path)
    found = read_bundle(path)
    assert found.to_json() == content
    assert effects_from_bundle(found, CATALOGUE) == (
        Push(0.25, 0.0),
        Sensor(2e3, 0.01, 0.0, "a"),
    )
    assert (found.effects[0].p_value, found.effects[0].ambiguous_with) == (1e-40, ["cable-spring"])
    assert found.effects[0].holdout_rmse == {"theta_rad": HeldOutError(before=0.021, after=0.0031)}
    push, sensor = (e["parameters"] for e in found.to_json()["effects"])
    assert push["push_nm"] == {"value": 0.25, "std": 0.01, "unit": "Nm", "interval": [0.24, None]}
    assert push["push_rate_nm_per_s"] == {"value": 0.0, "std": None, "unit": "Nm/s"}
    assert sensor["gain_error"]["std"] is None
    assert sensor["side"] == "a" and "side" not in push


def test_an_effect_of_arrays_or_with_unknown_names_is_not_written() -> None:
    with pytest.raises(ValueError, match="pull_nm"):
        entry_of(Push(0.1, 0.0), {"pull_nm": fitted(0.1, 0.1, "Nm")})
    with pytest.raises(ValueError, match="push_nm is not finite"):
        entry_of(Push(math.nan, 0.0))


def test_the_project_s_catalogue_is_the_default(bundle: Bundle, rig: Rig) -> None:
    for cls in catalogue().values():
        effect = cls.typical(**({"side": "b"} if cls.has_side() else {}))
        estimates = {q.name: fitted(getattr(effect, q.name), 0.1, q.unit) for q in cls.quantities}
        made = bundle.replaced(effects=[entry_of(effect, estimates)])
        assert model_from_bundle(made, rig).effects == (effect,)
        # What is not one-to-one in JSON would be lost here.
        content = made.to_json()
        assert json.loads(json.dumps(content)) == content
        assert effects_from_bundle(bundle_from_json(content, Path("b.json"))) == (effect,)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda e: e.pop("id"), "'id' is a required property"),
        (lambda e: e.pop("parameters"), "'parameters' is a required property"),
        (
            lambda e: e["parameters"].update(side="c"),
            r"side: 'c' is not one of \['a', 'b', 'both'\]",
        ),
        (lambda e: e["parameters"].update(side={"value": 1.0}), "side: .* is not one of"),
        (lambda e: e["parameters"].update(offset_pa=2.0), "offset_pa: 2.0 is not of type 'object'"),
        (lambda e: e["parameters"].update(offset_pa={"std": 2.0}), "offset_pa: 'value' is a req"),
        (
            lambda e: e["parameters"]["offset_pa"].update(value="2"),
            "offset_pa.value: '2' is not of",
        ),
        (lambda e: e["parameters"]["offset_pa"].update(value=True), "value: True is not of type"),
        (lambda e: e["parameters"]["offset_pa"].update(std=-1.0), "offset_pa.std: -1.0 is less"),
        (
            lambda e: e["parameters"]["offset_pa"].update(interval=[1.0]),
            r"interval: \[1.0\] is too",
        ),
    ],
)
def test_an_entry_that_is_none_is_one_clear_line(
    content: dict[str, Any], spoil: Any, message: str
) -> None:
    spoil(content["effects"][1])
    with pytest.raises(InputError, match=message) as caught:
        bundle_from_json(content, Path("b.json"))
    assert str(caught.value).startswith("b.json: effects.1") and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda e: e.update(id="other"), r"b\.json, effect other: .*--effects FILE"),
        (lambda e: e["parameters"].pop("offset_pa"), "sensor: offset_pa is missing; its param"),
        (lambda e: e["parameters"].pop("side"), "sensor: side is missing"),
        (lambda e: e["parameters"].update(more={"value": 1.0}), "has no parameter more"),
        (lambda e: e["parameters"]["offset_pa"].update(value=math.nan), "nan is out of its bounds"),
        (lambda e: e["parameters"]["offset_pa"].update(value=2e5), "200000 is out of its bounds"),
        (lambda e: e["parameters"]["offset_pa"].update(unit="bar"), "is in 'bar', not 'Pa'"),
        (
            lambda e: e["parameters"].update(
                offset_pa={"value": None, "identified": False, "reason": "one pressure only"}
            ),
            r"offset_pa: is not identified \(one pressure only\)",
        ),
        (
            lambda e: e["parameters"].update(offset_pa={"value": None}),
            "offset_pa: is not identified: its value is null",
        ),
    ],
)
def test_a_bad_effect_is_one_clear_line(
    content: dict[str, Any], rig: Rig, spoil: Any, message: str
) -> None:
    spoil(content["effects"][1])
    bundle = bundle_from_json(content, Path("b.json"))
    with pytest.raises(InputError, match=message) as caught:
        model_from_bundle(bundle, rig, CATALOGUE)
    assert str(caught.value).startswith("b.json, effect ") and "\n" not in str(caught.value)


def test_a_choice_is_one_of_its_values() -> None:
    link = LinkFlexibility(0.3, encoder_on_link=1.0)
    assert effect_from_entry(entry_of(link), "b.json", catalogue()) == link
    between = entry_of(dataclasses.replace(link, encoder_on_link=0.5))
    with pytest.raises(InputError, match=r"encoder_on_link: 0\.5 is none of 0, 1"):
        effect_from_entry(between, "b.json", catalogue())


def test_a_lag_is_as_slow_as_its_sensor() -> None:
    """A slow gauge's on a tank takes seconds; of what may be negative the bounds are its own."""
    known = {q.name: q for effect in catalogue().values() for q in effect.quantities}
    assert known["pressure_lag_s"].anywhere == (0.0, math.inf)
    assert known["time_skew_s"].anywhere == (-0.02, 0.02)


def test_a_side_in_a_number_s_place_is_refused(bundle: Bundle, rig: Rig) -> None:
    """A file cannot hold it: the schema refuses it first."""
    entry = bundle.effects[1]
    spoilt = entry.replaced(parameters={**entry.parameters, "offset_pa": "a"})
    with pytest.raises(InputError, match='sensor, offset_pa: is not an object with a "value"'):
        model_from_bundle(bundle.replaced(effects=[spoilt]), rig, CATALOGUE)


def test_two_effects_that_share_a_state_are_refused(bundle: Bundle, rig: Rig) -> None:
    twice = bundle.replaced(effects=[entry_of(Late(0.1))] * 2)
    with pytest.raises(InputError, match="effect late: is listed twice"):
        model_from_bundle(twice, rig, CATALOGUE)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("side", "c"),
        ("offset_pa", 2.0),
        ("offset_pa", {"std": 1.0}),
        ("offset_pa", {"value": 1.0, "std": -1.0}),
        ("offset_pa", {"value": 1.0, "std": 0.1, "interval": [1.0]}),
    ],
)
def test_the_schema_knows_an_effect(
    content: dict[str, Any], key: str, value: Any, tmp_path: Path
) -> None:
    path = tmp_path / "bundle.json"
    content["effects"][1]["parameters"][key] = value
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=rf"effects\.1\.parameters\.{key}"):
        read_bundle(path)


# --- the simulator's clock ----------------------------------------------------------------


def _commands(n: int = 200) -> tuple[Any, ValveCommand]:
    time = 3.0 + np.arange(n) * 1e-3
    values = np.zeros(n)
    values[20:60] = 1.0
    return time, ValveCommand(values)


def test_a_segment_counts_time_from_the_test_s_start(bundle: Bundle, rig: Rig) -> None:
    p = parameters_from_bundle(bundle, rig)
    time, valve = _commands()
    inputs = Inputs(time, np.zeros(len(time)), valve_a=valve)
    later = dataclasses.replace(inputs, elapsed=2.0)
    pushed = simulate(
        [inputs, later, inputs], [Model(p) + e for e in (Push(0.6, 0.1), *[Push(0.4, 0.1)] * 2)]
    )
    # 0.4 Nm and 0.1 Nm/s after 2 s are 0.6 Nm and 0.1 Nm/s; at the start they are less.
    np.testing.assert_allclose(pushed[1].position, pushed[0].position, rtol=0, atol=1e-12)
    assert pushed[0].position[-1] > pushed[2].position[-1] + 1e-3
    model = Model(p) + Late(1e-3)
    early, late = (open_intervals(i, "a", model) for i in (inputs, later))
    np.testing.assert_allclose(late.opens - early.opens, 2e-3, rtol=0, atol=1e-12)
    np.testing.assert_allclose(late.closes - early.closes, 2e-3, rtol=0, atol=1e-12)


# --- sensors ------------------------------------------------------------------------------


def test_a_measured_start_is_taken_back_through_the_sensors(bundle: Bundle, rig: Rig) -> None:
    base = Model(parameters_from_bundle(bundle, rig))
    model = base + Sensor(2e3, 0.01, 10.0, "a") + Sensor(-500.0, 0.0, 0.0, "b")
    true = {"theta_rad": 0.2, "pressure_a_pa": 1.5e5, "pressure_b_pa": 1.2e5}
    rows = {name: np.full(3, value) for name, value in true.items()}
    shown = through_sensors(rows, np.array([5.0, 5.001, 5.002]), model)
    assert shown["pressure_a_pa"][0] == pytest.approx(1.5e5 * 1.01 + 2e3 + 50.0)
    start = {name: float(values[0]) for name, values in shown.items()}
    found = before_sensors(start, model, elapsed=5.0)
    assert found["theta_rad"] == 0.2
    # Two rounds leave the sensor's error, 3550 Pa, times its gain error squared.
    assert found["pressure_a_pa"] == pytest.approx(1.5e5, abs=1.01 * 0.01**2 * 3550.0)
    assert found["pressure_b_pa"] == pytest.approx(1.2e5, abs=1e-9)
    # Neutral sensors change nothing, to the last bit.
    assert before_sensors(true, base + Sensor(), elapsed=5.0) == true
    assert before_sensors(true, base) == true


def _trial(**channels: float) -> Trial:
    time = 5.0 + np.arange(201) * 1e-3
    return Trial("1", time, {k: np.full(201, v) for k, v in channels.items()}, "log.csv test 1")


def test_simulation_with_a_bundle_s_effects_is_the_model_plus_effects(
    bundle: Bundle, rig: Rig
) -> None:
    trial = _trial(duty_a=0.4, pressure_a_pa=1.2e5, theta_rad=0.1)
    found = simulate_trials([trial], rig, bundle.model(rig, CATALOGUE))[0]
    base = Model(parameters_from_bundle(bundle, rig))
    composed = simulate_trials([trial], rig, base + Push(0.25) + Sensor(2e3, 0.01, 0.0, "a"))[0]
    plain = simulate_trials([trial], rig, base)[0]
    for name, values in composed.items():
        np.testing.assert_array_equal(found[name], values)
    assert found["theta_rad"][-1] > plain["theta_rad"][-1] + 1e-3
    # The first row is what was measured; an unlogged chamber is shown through its sensor too.
    assert found["pressure_a_pa"][0] == pytest.approx(1.2e5, abs=1.0)
    assert found["pressure_b_pa"][0] == 1e5
    neutral = simulate_trials([trial], rig, bundle.replaced(effects=[]).model(rig))[0]
    for name, values in plain.items():
        np.testing.assert_array_equal(neutral[name], values)


def _segments(test: MotionTest) -> list[tuple[MotionTest, Segment]]:
    whole = test.whole
    return [(test, whole), (test, dataclasses.replace(whole, start=100))]


def _motion_test(rig: Rig, theta: float, pressure_a: float, pressure_b: float) -> MotionTest:
    """A test whose every row, and so the state that is estimated there, shows these values."""
    from sysid.recording.start_states import InitialState

    time, valve = _commands()
    n = len(time)
    state = np.array([theta, 0.0, pressure_a, pressure_b])
    shown = {"theta_rad": theta, "pressure_a_pa": pressure_a, "pressure_b_pa": pressure_b}
    channels = {name: np.full(n, value) for name, value in shown.items()}
    channels |= {"motor_torque_nm": np.full(n, 0.5), "valve_a": valve.values}
    return MotionTest(
        trial=Trial("1", time, channels, "log.csv, test 1"),
        rig=rig,
        period=float(time[1] - time[0]),
        lost=np.zeros(n, dtype=bool),
        pulsed=False,
        noise=ChannelNoise(np.zeros(3), 0.0),
        whole=Segment(0, n, InitialState(state, np.zeros(4), np.ones(4, dtype=np.intp))),
    )


def test_validation_sees_through_the_sensors(bundle: Bundle, rig: Rig) -> None:
    base = Model(parameters_from_bundle(bundle, rig))
    true = simulate_segments(_segments(_motion_test(rig, 0.1, 1.4e5, 1.1e5)), base)
    shown = _motion_test(rig, 0.1, 1.4e5 + 2e3, 1.1e5)
    found = simulate_segments(_segments(shown), base + Sensor(2e3, side="a"))
    blind = simulate_segments(_segments(shown), base)
    for with_effect, without, bare in zip(found, true, blind, strict=True):
        np.testing.assert_allclose(with_effect[0], without[0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(with_effect[1], without[1] + 2e3, rtol=0, atol=1e-3)
        np.testing.assert_allclose(with_effect[2], without[2], rtol=0, atol=1e-3)
        # Taken at face value the offset would push the arm.
        assert np.abs(bare[0] - without[0]).max() > 1e-4
    # A drift goes on where the segment starts, 0.1 s into the test.
    found = simulate_segments(_segments(shown), base + Sensor(0.0, 0.0, 1e4, "b"))
    lower = simulate_segments(_segments(_motion_test(rig, 0.1, 1.4e5 + 2e3, 1.1e5 - 1e3)), base)
    for with_effect, without, since in zip(found, (blind[0], lower[1]), (0.0, 0.1), strict=True):
        assert with_effect[2][0] == pytest.approx(1.1e5, abs=1e-6)
        drift = 1e4 * (since + 1e-3 * np.arange(len(without[2])))
        np.testing.assert_allclose(with_effect[2], without[2] + drift, rtol=0, atol=1e-3)


def test_a_chamber_that_is_not_logged_starts_at_the_atmosphere(bundle: Bundle, rig: Rig) -> None:
    model = Model(parameters_from_bundle(bundle, rig)) + Sensor(2e3, side="both")
    test = _motion_test(rig, 0.1, 1.4e5, math.nan)
    found = simulate_segments([(test, test.whole)], model)[0]
    assert found[1][0] == pytest.approx(1.4e5, abs=1e-6)
    assert found[2][0] == pytest.approx(1e5 + 2e3, abs=1e-6)


def test_an_undeclared_offset_is_mended_by_its_effect(tmp_path: Path) -> None:
    made = make_campaign(
        1,
        size=SMALL,
        scatter=0.0,
        kinds=MOTION_KINDS,
        stems=("motion_discrete_2",),
        effects=(Injected("pressure-offset", "constant", "a", {"pressure_offset_pa": 4e3}),),
    )
    campaign = written(made, tmp_path)
    plain = true_bundle(made, campaign.rig)
    effect = entry_of(Sensor(4e3, side="a"), {"offset_pa": fitted(4e3, 5.0, "Pa")})
    before = validate(campaign, plain).logs[0].channels
    extended = plain.with_effects([effect])
    after = validate(campaign, extended, catalogue=CATALOGUE).logs[0].channels
    assert before["pressure_a_pa"].errors.rmse > 4.0 * after["pressure_a_pa"].errors.rmse
    # Segments start from measured pressures, whose offset would push the arm.
    pushed, mended = (found["theta_rad"].horizons[1].rmse for found in (before, after))
    assert pushed is not None and mended is not None
    assert pushed > 20.0 * mended
    for name in ("pressure_a_pa", "pressure_b_pa"):
        assert after[name].ratio == pytest.approx(1.0, abs=0.1)


# --- the command line ---------------------------------------------------------------------


def test_a_user_s_effect_is_given_by_its_file(
    content: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wind = {"wind_nm": {"value": 0.5, "std": 0.1, "unit": "Nm"}}
    content["effects"] = [{"id": "wind", "parameters": wind}]
    source, user = tmp_path / "bundle.json", tmp_path / "user.py"
    write_bundle(bundle_from_json(content, source), source)
    user.write_text(USER_EFFECT)
    log = tmp_path / "commands.csv"
    rows = [f"{k * 1e-3:.3f},0.0,0.0" for k in range(300)]
    log.write_text("\n".join(["time_s,motor_torque_nm,theta_rad", *rows]) + "\n")
    out = tmp_path / "out.csv"
    simulation = ["simulate", str(log), "--bundle", str(source), "-o", str(out)]
    export = ["export", str(source), "--format", "json", "-o", str(tmp_path / "out.json")]
    for command in (simulation, export):
        capsys.readouterr()
        assert main(command) == 2
        error = capsys.readouterr().err
        assert "effect wind: is not in the catalogue" in error and "--effects FILE" in error
        assert error.count("\n") == 1
        assert main([*command, "--effects", str(user)]) == 0
    rows = [line for line in out.read_text().splitlines() if not line.startswith("#")]
    place = rows[0].split(",").index("theta_rad")
    assert float(rows[-1].split(",")[place]) > 0.1
    found = json.loads((tmp_path / "out.json").read_text())
    assert found["effects"] == [{"id": "wind", "parameters": {"wind_nm": 0.5}}]


# --- exports ------------------------------------------------------------------------------


def test_sides_survive_the_export(bundle: Bundle, tmp_path: Path) -> None:
    from scipy.io import loadmat

    export_bundle(bundle, tmp_path / "out.json", "json")
    found = json.loads((tmp_path / "out.json").read_text())
    assert found["effects"][1]["parameters"]["side"] == "a"
    assert found["effects"][1]["parameters"]["offset_pa"] == 2e3
    assert found["units"]["effects"][1]["parameters"]["offset_pa"] == "Pa"
    export_bundle(bundle, tmp_path / "out.mat", "mat")
    cells = loadmat(tmp_path / "out.mat", simplify_cells=True)["sysid"]["effects"]
    assert cells[1]["id"] == "sensor" and cells[1]["parameters"]["side"] == "a"


def test_an_entry_is_as_it_was_after_its_effect_was_read(bundle: Bundle) -> None:
    entry = bundle.effects[1]
    before = entry.to_json()
    assert effect_from_entry(entry, "b.json", CATALOGUE) == Sensor(2e3, 0.01, 0.0, "a")
    assert bundle.effects[1].to_json() == before


@pytest.mark.parametrize(
    ("effect", "newer"),
    [
        (ExhaustBackPressure(1e7, 0.5, 0.25), {"linear_share": 1.0}),
        (TemperatureDrift(0.1, 5.0), {"settling_time_s": NEVER_SETTLES_S}),
        (DutyDeadZone(1e-3, "a", 2.0), {"whole_ratio": 1.0}),
        (Backlash(0.004, 2.0, 0.1), {"motor_share": 0.0}),
    ],
    ids=lambda value: getattr(value, "id", ""),
)
def test_a_bundle_older_than_a_parameter_has_the_older_form(
    effect: CatalogueEffect, newer: dict[str, float], bundle: Bundle, tmp_path: Path
) -> None:
    """Read as the older law, kept as it is in the file, and exported with it."""
    entry = entry_of(effect)
    old = entry.replaced(parameters={k: v for k, v in entry.parameters.items() if k not in newer})
    read = effect_from_entry(old, "b.json", catalogue())
    assert read == dataclasses.replace(effect, **newer)  # type: ignore[type-var]
    assert not newer.keys() & old.to_json()["parameters"].keys()
    export_bundle(bundle.replaced(effects=[old]), tmp_path / "old.h", "c")
    text = (tmp_path / "old.h").read_text()
    has_law = effect.id in ("exhaust-back-pressure", "temperature-drift")
    assert f"EFFECTS_CONTAINED {int(has_law)}" in text
    assert not any(name in text for name in newer)
