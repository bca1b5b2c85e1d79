"""Rigs with one chamber and a return spring: rig file, simulation, fits, forms of effects."""

from __future__ import annotations

import dataclasses
import math
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from export_compiler import Compiled, header

from datasets.generator.campaign import GeneratedCampaign, stream
from datasets.generator.files import log_frame, write_campaign
from datasets.generator.one_chamber import (
    free_place,
    make_one_chamber_campaign,
    random_one_chamber_rig,
    scaled,
)
from datasets.generator.rigs import GeneratedRig
from datasets.generator.runs import Commands, logged, simulated
from datasets.generator.valve_tests import held_start
from sysid.balance.motion import default_cutoff
from sysid.balance.samples import motion_samples
from sysid.blocks.figures import Figure, Line
from sysid.blocks.sections import FigureGroup
from sysid.checks.identifiability import valves_identified
from sysid.commands.app import main
from sysid.controllers.design_model import design_from_bundle
from sysid.diagnosis.actuator.signatures import candidates
from sysid.diagnosis.actuator.twins import sensor_noise
from sysid.errors import InputError, NotIdentifiedError
from sysid.estimation.linear import Estimate
from sysid.exporters.base_laws import mechanics
from sysid.exporters.c_header import render
from sysid.exporters.flat import flatten
from sysid.friction import fit_friction
from sysid.identification.valve_discrete.held_chamber import FLOWS
from sysid.identification.valve_discrete.shown import discrete_section
from sysid.identification.valve_discrete.start import flows_not_shown
from sysid.io.bare_rig import read_bare_logs
from sysid.io.campaign import read_campaign
from sysid.io.logs import Log, Trial, read_log
from sysid.io.responses import response_notices
from sysid.io.rig import Rig, read_rig, rig_from_content
from sysid.io.rig_sections import Motor
from sysid.io.samples import with_channels
from sysid.io.units import parse_map
from sysid.parameters import Bundle, Parts, write_bundle
from sysid.parameters.assembled_model import _discrete_law
from sysid.parameters.effects import EffectEntry
from sysid.parameters.friction import Friction
from sysid.parameters.valves import FittedValves
from sysid.pipeline.fit import fit
from sysid.plant import base, plant
from sysid.plant.base import ValveParameters, parameters_from_rig
from sysid.plant.effects.catalogue import catalogue
from sysid.plant.ports import Model, Point
from sysid.plant.trials import simulate_trials
from sysid.recording.even import recorded
from sysid.recording.friction_kind import balances
from sysid.recording.motion_tests import prepare
from sysid.refinement import candidates as candidates_of_motion
from sysid.refinement.advice import begin
from sysid.refinement.candidates import candidate_motions, leaves_travel
from sysid.refinement.played import design, proposal
from sysid.refinement.played.proposal import PlayRequest, played_test
from sysid.types import FloatArray
from sysid.valve_discrete import fit_valve_discrete
from sysid.valve_pwm import fit_valve_pwm

ALONE = ("friction-motion", "valve-discrete", "motion-discrete")


@pytest.fixture(scope="module")
def made() -> GeneratedCampaign:
    return make_one_chamber_campaign(41, motion="linear", with_motor=False, kinds=ALONE)


@pytest.fixture(scope="module")
def folder(made: GeneratedCampaign, tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("one")
    write_campaign(place, made, "generated")
    return place


def log_of(folder: Path, stem: str) -> Log:
    return read_log(folder / f"{stem}.csv", read_rig(folder / "rig.toml"))


def simulated_and_measured(
    made: GeneratedCampaign, folder: Path
) -> tuple[Mapping[str, FloatArray], Trial]:
    """The held-out motion by the simulator, with the generator's own numbers, and as it was."""
    log, t = log_of(folder, "motion_discrete_2"), made.rig.truth
    factors, law = made.log("motion_discrete_2").tests[0].truth, t.valve_a
    assert log.rig is not None
    truth = parameters_from_rig(
        log.rig,
        static_effort=t.static_friction * factors["static_factor"],
        coulomb_effort=t.coulomb_friction * factors["sliding_factor"],
        viscous=t.viscous_friction * factors["sliding_factor"],
        valve_a=ValveParameters(
            law.choked_flow_fill_kg_s, law.choked_flow_dis_kg_s, law.c_fill, law.c_dis
        ),
    )
    (run,) = simulate_trials(log.trials, log.rig, truth)
    return run, log.trials[0]


def content(text: str, **sections: Any) -> dict[str, Any]:
    found = tomllib.loads(text)
    for name, table in sections.items():
        found[name] = {**found.get(name, {}), **table}
    return found


# --- the rig file -------------------------------------------------------------------------


def one_chamber(rig_text: str, **sections: Any) -> Rig:
    kept = "\n".join(
        line for line in rig_text.splitlines() if not line.startswith(("area_b", "offset_b"))
    )
    own = {"cylinder": {"chambers": ["a"]}, **sections}
    return rig_from_content(content(kept, **own), "rig.toml")


@pytest.mark.parametrize(
    ("bleed", "exponent"), [(1.0, 0.0), (0.0, 1.0), (0.0, 1.4)], ids=["vented", "warm", "cold"]
)
def test_what_a_piston_does_to_its_chamber_is_no_command(
    bleed: float, exponent: float, rig_text: str
) -> None:
    """A chamber breathes through an open valve; a shut one is compressed, whatever its heat."""
    rig = one_chamber(rig_text, valves={"arrangement": "fill-and-bleed"})
    assert rig.cylinder is not None
    time = np.arange(0.0, 4.3, 1e-3)
    angle = 1.2 * np.sin(2.0 * math.pi * 0.5 * time + 0.3)
    length = rig.cylinder.chamber_length(angle, "a")
    breath = 3e3 * np.cos(2.0 * math.pi * 0.5 * time + 0.3)
    shown = 1e5 * (length / length[0]) ** -exponent - bleed * breath
    noise = np.random.default_rng(1).normal(0.0, 50.0, len(time))
    columns = {
        "time_s": time,
        "theta_rad": angle,
        "pressure_a_pa": shown + noise,
        "valve_a_fill": np.zeros(len(time)),
        "valve_a_bleed": np.full(len(time), bleed),
    }
    assert list(response_notices("run.csv", columns, rig)) == []


def test_one_chamber_needs_no_key_of_the_other(rig_text: str) -> None:
    rig = one_chamber(rig_text)
    assert rig.sides == ("a",) and rig.pressure_channels == ("pressure_a_pa",)
    assert rig.notices == ()
    again = rig_from_content(rig.content, "bundle, rig")
    assert again.cylinder == rig.cylinder
    unused = rig_from_content(content(rig_text, cylinder={"chambers": ["a"]}), "rig.toml")
    assert unused.cylinder == rig.cylinder
    assert any("area_b_m2 is not used: the rig has no chamber B" in line for line in unused.notices)


@pytest.mark.parametrize(
    ("sections", "line"),
    [
        ({"cylinder": {"chambers": ["b"]}}, r"chambers = \['b'\] is unknown; write \[\"a\"\] or"),
        ({"cylinder": {"chambers": ["a", "b"]}}, "area_b_m2 is missing; add"),
        ({"spring": {"preload_nm": 1.0}}, "stiffness_nm_per_rad is missing; add it"),
        (
            {"spring": {"stiffness_n_per_m": 100.0}},
            "stiffness_n_per_m on a rotary rig; give stiffness_nm_per_rad in its place",
        ),
        ({"spring": {"stiffness_nm_per_rad": -1.0}}, "stiffness_nm_per_rad = -1 is not plausible"),
    ],
)
def test_a_wrong_key_is_one_line(rig_text: str, sections: dict[str, Any], line: str) -> None:
    with pytest.raises(InputError, match=line):
        one_chamber(rig_text, **sections)


def test_the_preload_is_the_effort_where_chamber_a_is_smallest(rig_text: str) -> None:
    rig = one_chamber(rig_text, spring={"stiffness_nm_per_rad": 0.5, "preload_nm": 0.2})
    p, travel = base.bare_parameters(rig), rig.travel
    assert travel is not None
    assert base.load_effort(-0.5 * travel, p) == pytest.approx(0.2)
    assert base.load_effort(0.5 * travel, p) == pytest.approx(0.2 + 0.5 * travel)


# --- equations ----------------------------------------------------------------------------


def test_the_simulation_is_the_generators(made: GeneratedCampaign, folder: Path) -> None:
    """Two programs, written independently, with the true numbers: they differ by sensors' noise."""
    run, measured = simulated_and_measured(made, folder)
    t = made.rig.truth
    assert "pressure_b_pa" not in run
    noise = np.std(run["pressure_a_pa"] - measured["pressure_a_pa"])
    assert noise < 1.1 * t.pressure_noise_pa
    way = np.ptp(measured["position_m"])
    assert np.max(np.abs(run["position_m"] - measured["position_m"])) < 0.01 * way


def test_the_open_side_stays_at_the_atmosphere(folder: Path) -> None:
    rig = read_rig(folder / "rig.toml")
    p = parameters_from_rig(rig, static_effort=1.0, coulomb_effort=1.0, viscous=1.0)
    full = plant.chamber_volume("b", np.array([-0.05, 0.05]), p)
    assert float(np.ptp(full)) / float(full[0]) < 1e-9
    leak = 1e-3  # kg/s, more than any leak past a seal
    rate = p.heat_capacity_ratio * p.gas_constant * p.temperature * leak / full
    assert np.all(rate < 1.0)  # Pa/s


def test_a_test_that_begins_at_its_stop_counts_until_it_is_back(folder: Path) -> None:
    log = log_of(folder, "motion_discrete_2")
    rig, trial = log.rig, log.trials[0]
    assert rig is not None and rig.travel is not None
    stop, n = 0.5 * rig.travel, len(trial)
    position = np.full(n, -0.999 * stop)
    position[n // 4 : n // 2] = 0.0
    moved = with_channels(trial, position_m=position)
    test = prepare(moved, "motion-discrete", rig, 1.0)
    assert test.counted(test.whole) == n // 2
    still = with_channels(trial, position_m=np.full(n, -0.999 * stop))
    assert prepare(still, "motion-discrete", rig, 1.0).counted(test.whole) == 0
    free = rig_from_content({k: v for k, v in rig.content.items() if k != "spring"}, "rig.toml")
    assert prepare(moved, "motion-discrete", free, 1.0).counted(test.whole) == 0


# --- fits ---------------------------------------------------------------------------------


def test_friction_of_a_motion_that_air_and_spring_drive(
    made: GeneratedCampaign, folder: Path
) -> None:
    log = log_of(folder, "friction_motion")
    assert log.rig is not None and "motor_force_n" not in log.channels
    found = fit_friction(log.trials, log.rig).parameters
    t = made.rig.truth
    assert found["coulomb"].value == pytest.approx(t.coulomb_friction, rel=0.06)
    assert found["viscous"].value == pytest.approx(t.viscous_friction, rel=0.1)
    # No motor ramps: it is that of the rests from which air and spring move the piston.
    static, own = found["static"], made.log("friction_motion").tests
    factor = float(np.mean([test.truth["static_factor"] for test in own]))
    assert static.value == pytest.approx(factor * t.static_friction, rel=0.04)
    assert static.value > 1.2 * found["coulomb"].interval[1]
    without = read_rig(folder / "rig.toml")
    bare = rig_from_content({k: v for k, v in without.content.items() if k != "spring"}, "rig.toml")
    wrong = fit_friction(log.trials, bare).parameters["coulomb"]
    assert not wrong.identified or abs(wrong.value / t.coulomb_friction - 1.0) > 0.2


def test_a_campaign_s_motion_that_air_and_spring_drive_gives_friction(
    made: GeneratedCampaign, folder: Path
) -> None:
    log = log_of(folder, "motion_discrete_2")
    assert log.rig is not None and "motor_force_n" not in log.channels
    assert all(balances(t, log.rig) for t in log.trials)
    path = folder / "motion_alone.toml"
    entry = '[[log]]\nkind = "motion-discrete"\nfile = "motion_discrete.csv"\n'
    path.write_text(f'rig = "rig.toml"\n{entry}')
    friction = fit(read_campaign(path)).friction
    assert friction is not None and friction.coulomb_n is not None
    assert friction.coulomb_n.value == pytest.approx(made.rig.truth.coulomb_friction, rel=0.15)


def test_a_piston_that_nothing_returns_is_said(
    folder: Path, evacuated: tuple[GeneratedCampaign, Path]
) -> None:
    """The rig file lacks the spring: what the air does not explain would pass for friction."""
    for place in (folder, evacuated[1]):
        rig = read_rig(place / "rig.toml")
        path = place / "motion_discrete.csv"
        assert not read_log(path, rig).contradictions
        own = {name: table for name, table in rig.content.items() if name != "spring"}
        (line,) = read_log(path, rig_from_content(own, "rig.toml")).contradictions
        # Of the rig file, whichever log shows it: once is enough.
        assert line.startswith("rig.toml: the piston returns against pressure_")
        assert "motion_discrete" not in line
        assert f"add one, with {rig.units.stiffness} and {rig.units.preload}" in line
        held = read_log(place / "valve_discrete_a.csv", rig_from_content(own, "rig.toml"))
        assert not held.contradictions


def test_a_crest_between_the_readings_leaves_static_friction_open(
    made: GeneratedCampaign, folder: Path
) -> None:
    """The piston breaks away at a crest of the pulses' ripple, of which a reading every 10 ms shows
    nothing: what was read was up to 17 % too small, within a few per cent as it said."""
    log = log_of(folder, "friction_motion")
    assert log.rig is not None
    slow = [
        dataclasses.replace(
            t, time=t.time[::10], channels={n: v[::10] for n, v in t.channels.items()}
        )
        for t in log.trials
    ]
    found = fit_friction(slow, log.rig)
    static = found.parameters["static"]
    truth = made.rig.truth.static_friction
    assert math.isinf(static.interval[1]) and static.interval[0] < truth
    assert any("is at least what these rests show" in line for line in found.notices)
    assert math.isfinite(fit_friction(log.trials, log.rig).parameters["static"].interval[1])


def test_a_test_that_mostly_rests_keeps_its_motion(folder: Path) -> None:
    """The spring brings the piston back, and friction holds it: longer filters show no motion."""
    log = log_of(folder, "friction_motion")
    assert log.rig is not None
    trial = log.trials[0]
    later = trial.time[-1] + trial.period * np.arange(1, 2 * len(trial))
    rested = {
        name: np.concatenate([values, np.full(len(later), values[-1])])
        for name, values in trial.channels.items()
    }
    time = np.concatenate([trial.time, later])
    long = dataclasses.replace(trial, time=time, channels=rested)
    moving, resting = (recorded(t, log.rig, []) for t in (trial, long))
    assert default_cutoff(resting, 50.0) == default_cutoff(moving, 50.0) == 50.0
    used = len(motion_samples(moving, 50.0).effort)
    assert len(motion_samples(resting, 50.0).effort) == pytest.approx(used, rel=0.1)


def test_held_pistons_say_nothing_of_the_encoder(folder: Path) -> None:
    """A rig without friction tests of a motor has more tests of its valve than motions."""
    moving, held = (log_of(folder, n) for n in ("friction_motion", "valve_discrete_a"))
    assert moving.rig is not None and moving.rig.encoder_step is not None
    alone = [("", "friction-motion", trial) for trial in moving.trials]
    others = [("", "valve-discrete", trial) for trial in held.trials] * 4
    found = sensor_noise([*alone, *others], moving.rig)
    assert found.quantum[0] == pytest.approx(moving.rig.encoder_step, rel=1e-3)
    assert found.quantum[0] == sensor_noise(alone, moving.rig).quantum[0]


def test_the_valve_of_the_one_chamber(made: GeneratedCampaign, folder: Path) -> None:
    log, law = log_of(folder, "valve_discrete_a"), made.rig.truth.valve_a
    assert log.rig is not None
    found = fit_valve_discrete(log.trials, log.rig, find_ratio=False)
    assert list(found.valves) == ["a"]
    for key, true in dataclasses.asdict(law).items():
        assert found["a"].estimates[key].value == pytest.approx(true, rel=0.01), key
    with pytest.raises(InputError, match=r"chambers lists no chamber B, but .* is of valve B"):
        fit_valve_discrete(log.trials, log.rig, valve="b")


def test_effects_of_the_other_chamber_are_not_offered() -> None:
    both, one = candidates(catalogue().values()), candidates(catalogue().values(), sides=("a",))
    assert {dict(c.shape).get("side") for c in one if c.id != "end-cushion"} == {None, "a"}
    # Its stroke has two ends all the same.
    assert {dict(c.shape)["side"] for c in one if c.id == "end-cushion"} == {"a", "b", "both"}
    assert {c.id for c in both} - {c.id for c in one} == {"area-error", "piston-leakage"}


# --- a vacuum supply ----------------------------------------------------------------------


@pytest.fixture(scope="module")
def evacuated(tmp_path_factory: pytest.TempPathFactory) -> tuple[GeneratedCampaign, Path]:
    kinds = ("valve-discrete", "motion-discrete")
    made = make_one_chamber_campaign(7, motion="rotary", with_motor=False, vacuum=True, kinds=kinds)
    place = tmp_path_factory.mktemp("vacuum")
    write_campaign(place, made, "generated")
    return made, place


def test_a_supply_is_above_the_atmosphere_or_a_vacuum(rig_text: str) -> None:
    def supplied(pressure: float) -> Rig:
        return rig_from_content(content(rig_text, air={"supply_pressure_pa": pressure}), "rig.toml")

    assert supplied(3e5).supply_way == 1.0 and supplied(3e4).supply_way == -1.0
    for pressure in (1e5, 0.97e5):
        with pytest.raises(InputError, match="is not above atmospheric_pressure_pa"):
            supplied(pressure)
    with pytest.raises(InputError, match="supply_pressure_pa = 600 is not plausible"):
        supplied(600.0)


def test_the_spring_of_a_vacuum_returns_to_the_other_end(rig_text: str) -> None:
    spring = {"stiffness_nm_per_rad": 0.5, "preload_nm": 0.2}
    rig = one_chamber(rig_text, spring=spring, air={"supply_pressure_pa": 3e4})
    p, travel = base.bare_parameters(rig), rig.travel
    assert travel is not None
    assert base.load_effort(0.5 * travel, p) == pytest.approx(-0.2)
    assert base.load_effort(-0.5 * travel, p) == pytest.approx(-0.2 - 0.5 * travel)


def test_a_valve_that_evacuates(evacuated: tuple[GeneratedCampaign, Path]) -> None:
    made, place = evacuated
    log, law, delays = log_of(place, "valve_discrete_a"), made.rig.truth.valve_a, made.rig.content
    assert log.rig is not None and not log.contradictions
    fit = fit_valve_discrete(log.trials, log.rig, find_ratio=False)
    found = fit["a"].estimates
    for key, true in (
        ("c_fill", law.c_fill),
        ("c_dis", law.c_dis),
        ("on_delay_s", delays["valves"]["on_delay_s"]),
        ("off_delay_s", delays["valves"]["off_delay_s"]),
    ):
        assert abs(found[key].value - true) < 4.0 * found[key].std, key
    assert not found["choked_flow_fill_kg_s"].identified
    assert "vacuum" in str(found["choked_flow_fill_kg_s"].reason)


def test_an_evacuated_motion_is_the_generators(evacuated: tuple[GeneratedCampaign, Path]) -> None:
    made, place = evacuated
    run, measured = simulated_and_measured(made, place)
    t = made.rig.truth
    assert measured["pressure_a_pa"].min() < 0.7 * made.rig.atmosphere
    noise = np.std(run["pressure_a_pa"] - measured["pressure_a_pa"])
    assert noise < 1.1 * t.pressure_noise_pa
    way = np.ptp(measured["theta_rad"])
    assert np.max(np.abs(run["theta_rad"] - measured["theta_rad"])) < 0.01 * way


def test_the_c_of_a_vacuum_has_the_models_flows(
    evacuated: tuple[GeneratedCampaign, Path], tmp_path: Path
) -> None:
    """Its flow never chokes: what the law lacks there is taken as the simulation takes it."""
    log = log_of(evacuated[1], "valve_discrete_a")
    assert log.rig is not None and log.rig.air is not None
    fit = fit_valve_discrete(log.trials, log.rig, find_ratio=False)
    bundle = Bundle.new(log.rig, fit.part(), [])
    header(bundle, tmp_path)
    c = Compiled(tmp_path, {"valve_a_filling_flow": 2, "valve_a_exhaust_flow": 2}, ())
    v, supply, ambient = (
        _discrete_law(bundle, log.rig, "a"),
        log.rig.air.supply_pressure_pa,
        log.rig.air.atmospheric_pressure_pa,
    )
    pressure = np.linspace(0.4 * supply, 2.2 * ambient, 301)
    for line in (supply, 1.1 * supply):
        filled = base.filling_flow(pressure, line, v.choked_fill, v.c_fill, supply)
        found, _ = c("valve_a_filling_flow", pressure, line)
        np.testing.assert_allclose(found, filled, rtol=1e-12, atol=1e-18)
    emptied = base.exhaust_flow(pressure, ambient, v.choked_dis, v.c_dis)
    found, _ = c("valve_a_exhaust_flow", pressure, ambient)
    np.testing.assert_allclose(found, emptied, rtol=1e-12, atol=1e-18)


def test_no_surface_is_fitted_under_a_vacuum(rig_text: str) -> None:
    rig = one_chamber(rig_text, air={"supply_pressure_pa": 3e4})
    with pytest.raises(NotIdentifiedError, match="the supply is a vacuum, under which no PWM"):
        fit_valve_pwm([], rig)


# --- a fill and a bleed valve -------------------------------------------------------------


@pytest.fixture(scope="module")
def shut(tmp_path_factory: pytest.TempPathFactory) -> tuple[GeneratedCampaign, Path]:
    made = make_one_chamber_campaign(
        7,
        motion="linear",
        with_motor=False,
        bleeds=True,
        kinds=("valve-discrete", "motion-discrete"),
    )
    place = tmp_path_factory.mktemp("shut")
    write_campaign(place, made, "generated")
    return made, place


@pytest.fixture(scope="module")
def shut_vacuum(tmp_path_factory: pytest.TempPathFactory) -> tuple[GeneratedCampaign, Path]:
    made = make_one_chamber_campaign(
        9, motion="linear", with_motor=False, vacuum=True, bleeds=True, kinds=("valve-discrete",)
    )
    place = tmp_path_factory.mktemp("shut_vacuum")
    write_campaign(place, made, "generated")
    return made, place


@pytest.fixture(params=["shut", "shut_vacuum"], ids=["pressure", "vacuum"])
def shut_by(request: pytest.FixtureRequest) -> tuple[GeneratedCampaign, Path]:
    """A chamber with a fill and a bleed valve, by a supply of either kind."""
    made: tuple[GeneratedCampaign, Path] = request.getfixturevalue(request.param)
    return made


def with_arrangement(rig_text: str, chambers: list[str]) -> Rig:
    valves = {"arrangement": "fill-and-bleed"}
    found = content(rig_text, cylinder={"chambers": chambers}, valves=valves)
    return rig_from_content(found, "rig.toml")


def test_two_valves_are_of_one_chamber(rig_text: str) -> None:
    rig = with_arrangement(rig_text, ["a"])
    assert rig.bleeds and rig.valve_names == ("a_fill", "a_bleed")
    with pytest.raises(InputError, match="on a rig with two chambers, of which no model"):
        with_arrangement(rig_text, ["a", "b"])
    with pytest.raises(InputError, match="arrangement = '5/3' is unknown; write one of '3/2'"):
        rig_from_content(content(rig_text, valves={"arrangement": "5/3"}), "rig.toml")


def test_commands_of_other_valves_are_one_line(
    shut: tuple[GeneratedCampaign, Path], tmp_path: Path
) -> None:
    _, place = shut
    rig = read_rig(place / "rig.toml")
    plain = {**rig.content, "valves": dict.fromkeys(("on_delay_s", "off_delay_s"), 0.002)}
    with pytest.raises(InputError, match="holds valve_a_fill, a command of two on/off valves"):
        read_log(place / "motion_discrete.csv", rig_from_content(plain, "rig.toml"))
    text = (place / "motion_discrete.csv").read_text("utf-8")
    (tmp_path / "log.csv").write_text(text.replace("valve_a_fill", "valve_a"), "utf-8")
    with pytest.raises(InputError, match="holds valve_a, a command of 3/2 valves"):
        read_log(tmp_path / "log.csv", rig)


def test_a_fill_and_a_bleed_valve(shut: tuple[GeneratedCampaign, Path]) -> None:
    made, place = shut
    log, law = log_of(place, "valve_discrete_a"), made.rig.truth.valve_a
    assert log.rig is not None and not log.contradictions
    fit = fit_valve_discrete(log.trials, log.rig)
    found = fit["a"].estimates
    for key, true in dataclasses.asdict(law).items():
        assert abs(found[key].value - true) < 4.0 * found[key].std, key
    for key in ("critical_ratio_fill", "critical_ratio_dis"):
        assert found[key].value == pytest.approx(0.53, abs=3e-3), key
    delay = made.rig.content["valves"]["on_delay_s"]
    assert abs(found["on_delay_s"].value - delay) < 4.0 * found["on_delay_s"].std
    assert not found["off_delay_s"].identified
    # The report draws the curve, and says where its law has an effect that it does not draw.
    for effects, said in ((), "fitted"), ((EffectEntry(id="supply-droop", parameters={}),), "law"):
        parts = dataclasses.replace(fit.part(), effects=effects)
        section = discrete_section(Bundle.new(log.rig, parts, []), [("a", log)], log.rig)
        assert section is not None
        (group,) = (b for b in section.blocks if isinstance(b, FigureGroup) and len(b.figures) > 2)
        first = group.figures[0]
        assert isinstance(first, Figure)
        lines = [m for m in first.panels[0].marks if isinstance(m, Line)]
        assert lines[1].label.startswith(said)
        assert ("together with the effect" in group.caption) is bool(effects)


def test_a_shut_chamber_is_the_generators(shut: tuple[GeneratedCampaign, Path]) -> None:
    made, place = shut
    run, measured = simulated_and_measured(made, place)
    t = made.rig.truth
    both_off = (measured["valve_a_fill"] == 0.0) & (measured["valve_a_bleed"] == 0.0)
    assert np.mean(both_off) > 0.3 and np.ptp(measured["pressure_a_pa"][both_off]) > 2e4
    noise = np.std(run["pressure_a_pa"] - measured["pressure_a_pa"])
    assert noise < 1.1 * t.pressure_noise_pa
    way = np.ptp(measured["position_m"])
    assert np.max(np.abs(run["position_m"] - measured["position_m"])) < 0.01 * way


def test_flows_of_two_valves_add_up(rig_text: str) -> None:
    rig = with_arrangement(rig_text, ["a"])
    law = ValveParameters(7e-4, 3e-4, 1.5e-6, 3.7e-9)
    p = parameters_from_rig(rig, static_effort=0.0, coulomb_effort=0.0, viscous=0.0, valve_a=law)
    state = dict.fromkeys(("time", "position", "velocity", "motor", "direction"), np.zeros(4))
    fills, bleeds = np.array([0.0, 1.0, 0.0, 1.0]), np.array([0.0, 0.0, 1.0, 1.0])
    pressure = np.full(4, 1.5e5)
    point = Point(
        **state,
        pressure_a=pressure,
        pressure_b=np.full(4, 1e5),
        open_a=fills,
        open_b=bleeds,
        parameters=p,
    )
    # At 1.5 bar of 3: filling choked, emptying not.
    flow = plant.discrete_flow("a", fills > 0.0, point, Model(p))
    out = 3.7e-9 * (1e5 - 1.5e5)
    assert flow == pytest.approx([0.0, 7e-4, out, 7e-4 + out])
    assert plant.shared_flow("a", fills, point, Model(p)) == pytest.approx(flow)
    assert not np.any(plant.discrete_flow("b", fills > 0.0, point, Model(p)))


# --- held chambers of two valves, as people log them ---------------------------------------

FILL, BLEED = "valve_a_fill", "valve_a_bleed"
Spans = tuple[tuple[float, float], ...]  # from when to when a valve is on, s


def bench_frame(made: GeneratedCampaign) -> pd.DataFrame:
    """The bench tests of a campaign, as its log holds them."""
    return log_frame(made.log("valve_discrete_a").tests, made.rig)


def read_back(frame: pd.DataFrame, place: Path, folder: Path) -> Log:
    """A frame written as a log, and read with the rig file of `place`."""
    frame.to_csv(folder / "bench.csv", index=False)
    return read_log(folder / "bench.csv", read_rig(place / "rig.toml"))


def switched(rig: GeneratedRig, fills: Spans, bleeds: Spans, filled: bool) -> Any:
    """A test of a held chamber of this rig, shut and `filled` or not where it begins."""
    n = round(5.0 / rig.row_period)
    commands = []
    for spans in (fills, bleeds):
        command = np.zeros(n)
        for on, off in spans:
            command[round(on / rig.row_period) : round(off / rig.row_period)] = 1.0
        commands.append(command)
    start = dataclasses.replace(held_start(rig, "a", filled), opened=(0, 0))
    given = Commands(np.zeros(n), valve_a=commands[0], bleed=commands[1], log_motor=False)
    states = simulated(rig, rig.plant(), given, start)
    noise, rng = rig.truth.pressure_noise_pa, np.random.default_rng(5)
    return logged("1", rig, given, states, noise, rng, {})


MISTAKES: dict[str, tuple[Any, str]] = {
    "swapped": (
        lambda f: f.rename(columns={FILL: BLEED, BLEED: FILL}),
        r"valve_a_fill is on and \w+ while valve_a_bleed is on: the two columns are swapped",
    ),
    "a normally open bleed valve": (
        lambda f: f.assign(**{BLEED: 1 - f[BLEED]}),
        "while it is off: valve_a_bleed is inverted",
    ),
    "a normally open fill valve": (
        lambda f: f.assign(**{FILL: 1 - f[FILL]}),
        "while it is on: valve_a_fill is inverted",
    ),
    "both": (
        lambda f: f.assign(**{FILL: 1 - f[FILL], BLEED: 1 - f[BLEED]}),
        "valve_a_fill and valve_a_bleed are inverted",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistaken_commands_of_two_valves_are_named(
    name: str, shut_by: tuple[GeneratedCampaign, Path], tmp_path: Path
) -> None:
    made, place = shut_by
    change, line = MISTAKES[name]
    log = read_back(change(bench_frame(made)), place, tmp_path)
    assert log.rig is not None and any(re.search(line, notice) for notice in log.notices)
    for why in flows_not_shown(log.trials, log.rig, "a").values():
        assert re.search(line, why) and "bench.csv" in why
    with pytest.raises(NotIdentifiedError, match=line):
        fit_valve_discrete(log.trials, log.rig)
    as_it_was = read_back(bench_frame(made), place, tmp_path)
    assert not any("swapped" in n or "inverted" in n for n in as_it_was.notices)


@pytest.mark.parametrize("stem", ["motion_discrete", "motion_pwm", "friction_motion"])
def test_a_motion_names_mistaken_commands_too(stem: str, tmp_path: Path) -> None:
    kinds = (stem.replace("_", "-"),)
    made = make_one_chamber_campaign(7, motion="linear", with_motor=False, bleeds=True, kinds=kinds)
    write_campaign(tmp_path, made, "generated")
    frame = log_frame(made.log(stem).tests, made.rig)
    fill, bleed = (c for c in frame if str(c).endswith(("_fill", "_bleed")))
    plain = read_back(frame, tmp_path, tmp_path)
    assert not any("swapped" in n or "inverted" in n for n in plain.notices)
    swapped = read_back(frame.rename(columns={fill: bleed, bleed: fill}), tmp_path, tmp_path)
    assert any("the two columns are swapped" in n for n in swapped.notices)
    # An inverted duty fills all the time where the other one never exceeds it.
    for command in (fill, bleed) if stem == "motion_discrete" else (bleed,):
        inverted = frame.assign(**{command: 1.0 - frame[command]})
        said = read_back(inverted, tmp_path, tmp_path).notices
        assert any(f"{command} is inverted" in n for n in said)


def test_a_log_of_two_valves_needs_no_rig_file(
    shut: tuple[GeneratedCampaign, Path], tmp_path: Path
) -> None:
    """Its columns say that there are two of one chamber, and where that is open and filled."""
    made, _ = shut
    bench_frame(made).to_csv(tmp_path / "bench.csv", index=False)
    bare = read_bare_logs([tmp_path / "bench.csv"], {})
    air, true = bare.rig.air, made.rig.content["air"]
    assert bare.rig.bleeds and bare.rig.sides == ("a",) and air is not None
    assert air.supply_pressure_pa == pytest.approx(true["supply_pressure_pa"], rel=2e-3)
    assert air.atmospheric_pressure_pa == pytest.approx(true["atmospheric_pressure_pa"], rel=2e-3)
    found = fit_valve_discrete(bare.logs[0].trials, bare.rig, find_ratio=False)["a"].estimates
    # Its volume is assumed: flows are in proportion to it, and to one another.
    law, flows = made.rig.truth.valve_a, {name: found[name].value for name in FLOWS}
    factor = flows["c_fill"] / law.c_fill
    for name, value in flows.items():
        assert value / getattr(law, name) == pytest.approx(factor, rel=0.01), name


@pytest.mark.parametrize("two", [False, True], ids=["3/2", "fill and bleed"])
def test_a_log_shows_that_its_supply_is_a_vacuum(
    two: bool,
    evacuated: tuple[GeneratedCampaign, Path],
    shut_vacuum: tuple[GeneratedCampaign, Path],
    tmp_path: Path,
) -> None:
    made, _ = shut_vacuum if two else evacuated
    bench_frame(made).to_csv(tmp_path / "bench.csv", index=False)
    bare = read_bare_logs([tmp_path / "bench.csv"], {})
    air, true = bare.rig.air, made.rig.content["air"]
    assert air is not None and bare.rig.bleeds is two and bare.rig.supply_way < 0.0
    assert air.supply_pressure_pa == pytest.approx(true["supply_pressure_pa"], rel=0.01)
    assert air.atmospheric_pressure_pa == pytest.approx(true["atmospheric_pressure_pa"], rel=2e-3)
    assert not bare.notices and not bare.logs[0].contradictions
    found = fit_valve_discrete(bare.logs[0].trials, bare.rig, find_ratio=False)["a"].estimates
    ratio = found["c_dis"].value / found["c_fill"].value
    law = made.rig.truth.valve_a
    assert ratio == pytest.approx(law.c_dis / law.c_fill, rel=0.02)


@pytest.mark.parametrize("column", [FILL, BLEED])
def test_a_motion_by_no_valve_of_the_log_is_said(
    column: str, shut: tuple[GeneratedCampaign, Path], tmp_path: Path
) -> None:
    made, place = shut
    frame = log_frame(made.log("motion_discrete").tests, made.rig)
    line = f"while both valves are off: is {column}, which stays 0, the command of the valve that"
    assert any(line in n for n in read_back(frame.assign(**{column: 0}), place, tmp_path).notices)
    assert not any("both valves are off" in n for n in read_back(frame, place, tmp_path).notices)


def test_an_emptying_that_no_command_shows_is_said(
    shut_by: tuple[GeneratedCampaign, Path], tmp_path: Path
) -> None:
    """The bleed valve's column is zeros: filling is fitted as with it, emptying is not, and what is
    checked says so as well."""
    made, place = shut_by
    log = read_back(bench_frame(made).assign(**{BLEED: 0}), place, tmp_path)
    assert log.rig is not None
    lacking = flows_not_shown(log.trials, log.rig, "a")
    found = fit_valve_discrete(log.trials, log.rig, find_ratio=False)["a"].estimates
    assert set(lacking) == {name for name in FLOWS if not found[name].identified}
    assert abs(found["c_fill"].value - made.rig.truth.valve_a.c_fill) < 4.0 * found["c_fill"].std
    why = str(found["c_dis"].reason)
    assert re.search("while both valves are off: is valve_a_bleed, which stays 0, the command", why)


def test_a_log_without_the_bleed_valves_command_shows_how_the_chamber_fills(
    shut_by: tuple[GeneratedCampaign, Path], tmp_path: Path
) -> None:
    """As with it; of the exhaust it is said which column would show it."""
    made, place = shut_by
    whole = bench_frame(made)
    logs = [read_back(frame, place, tmp_path) for frame in (whole, whole.drop(columns=BLEED))]
    rig = logs[0].rig
    assert rig is not None
    own, lacking = (fit_valve_discrete(log.trials, rig, find_ratio=False) for log in logs)
    one, other = own["a"].estimates, lacking["a"].estimates
    for name in (name for name in FLOWS if one[name].identified):
        if name.startswith("choked_flow_dis") or name == "c_dis":
            assert not other[name].identified
            assert f"column {BLEED} is missing" in str(other[name].reason)
        else:
            assert other[name].holds(one[name].value)
            assert other[name].std < 3.0 * one[name].std
    said = [line for line in lacking.notices if f"are fitted in which {FILL} is on" in line]
    assert len(said) == 1 and f"bench.csv: column {BLEED}" in said[0]
    # A simulation lacks the same, and no flow of which no test under a vacuum says anything.
    with pytest.raises(NotIdentifiedError, match=f"column {BLEED} is missing"):
        _discrete_law(Bundle.new(rig, lacking.part(), []), rig, "a")


@pytest.mark.parametrize("alone", [False, True], ids=["whole log", "discharges alone"])
def test_a_log_without_the_fill_valves_command_shows_how_the_chamber_empties(
    alone: bool, shut_by: tuple[GeneratedCampaign, Path], tmp_path: Path
) -> None:
    """Either valve alone is tested so: the rows are fitted in which the other one is on."""
    made, place = shut_by
    log = read_back(unfilled(made, alone), place, tmp_path)
    assert log.rig is not None
    fit = fit_valve_discrete(log.trials, log.rig, find_ratio=False)
    found, law = fit["a"].estimates, made.rig.truth.valve_a
    said = [line for line in fit.notices if f"are fitted in which {BLEED} is on" in line]
    assert len(said) == 1 and f"column {FILL} is missing" in said[0]
    lacking = flows_not_shown(log.trials, log.rig, "a")
    assert "c_fill" in lacking and FILL in lacking["c_fill"]
    assert set(lacking) == {name for name in FLOWS if not found[name].identified}
    for name in FLOWS[2:]:
        if name not in lacking:
            assert abs(found[name].value - getattr(law, name)) < 4.0 * found[name].std, name


def unfilled(made: GeneratedCampaign, alone: bool) -> pd.DataFrame:
    """The bench log without the fill valve's column; `alone`: after the last filling only."""
    frame = bench_frame(made)
    if alone:
        last = frame["test"].map(frame[frame[FILL] > 0.5].groupby("test").time_s.max())
        frame = frame[frame["time_s"] > last + 0.02]
    return frame.drop(columns=FILL)


@pytest.mark.parametrize("alone", [False, True], ids=["whole log", "discharges alone"])
def test_discharges_need_no_rig_file(
    alone: bool, shut: tuple[GeneratedCampaign, Path], tmp_path: Path
) -> None:
    made, _ = shut
    unfilled(made, alone).to_csv(tmp_path / "bench.csv", index=False)
    bare = read_bare_logs([tmp_path / "bench.csv"], {})
    assert bare.rig.bleeds and bare.rig.supply_way > 0.0
    found = fit_valve_discrete(bare.logs[0].trials, bare.rig, find_ratio=False)["a"].estimates
    # Its volume is assumed: flows are in proportion to it, and to one another.
    law = made.rig.truth.valve_a
    ratio = found["choked_flow_dis_kg_s"].value / found["c_dis"].value
    assert ratio == pytest.approx(law.choked_flow_dis_kg_s / law.c_dis, rel=0.01)


@pytest.mark.parametrize(
    ("fills", "bleeds", "filled"),
    [
        (((2.0, 4.0),), ((0.5, 1.5),), True),
        (((0.3, 0.33), (0.6, 2.0)), ((2.2, 2.3), (2.6, 4.9)), False),
        (((0.3, 2.3),), ((2.0, 2.1), (2.5, 4.9)), False),
    ],
    ids=["emptied first", "in steps", "both on for a while"],
)
def test_a_chamber_is_switched_in_any_order(
    fills: Spans,
    bleeds: Spans,
    filled: bool,
    shut: tuple[GeneratedCampaign, Path],
    tmp_path: Path,
) -> None:
    made, place = shut
    test = switched(made.rig, fills, bleeds, filled)
    log = read_back(log_frame([test], made.rig), place, tmp_path)
    assert log.rig is not None and not flows_not_shown(log.trials, log.rig, "a")
    found = fit_valve_discrete(log.trials, log.rig, find_ratio=False)["a"].estimates
    for key, true in dataclasses.asdict(made.rig.truth.valve_a).items():
        assert abs(found[key].value - true) < 4.0 * found[key].std, key


def test_an_emptying_alone_gives_its_flows(
    shut: tuple[GeneratedCampaign, Path], tmp_path: Path
) -> None:
    made, place = shut
    test = switched(made.rig, (), ((0.5, 4.9),), True)
    log = read_back(log_frame([test], made.rig), place, tmp_path)
    assert log.rig is not None
    assert set(flows_not_shown(log.trials, log.rig, "a")) == {"choked_flow_fill_kg_s", "c_fill"}
    found = fit_valve_discrete(log.trials, log.rig, find_ratio=False)["a"].estimates
    for key in ("choked_flow_dis_kg_s", "c_dis"):
        true = getattr(made.rig.truth.valve_a, key)
        assert abs(found[key].value - true) < 4.0 * found[key].std, key
    delay = made.rig.content["valves"]["on_delay_s"]
    assert abs(found["on_delay_s"].value - delay) < 4.0 * found["on_delay_s"].std


def test_a_later_cycle_counts_too(folder: Path, made: GeneratedCampaign) -> None:
    """A 3/2 valve that is on as the log begins, in a chamber that is filled: the next cycle shows
    the filling."""
    log = log_of(folder, "valve_discrete_a")
    assert log.rig is not None
    first, second = log.trials[:2]
    begun = int(np.flatnonzero(first["valve_a"] > 0.5)[0]) + 2000
    time = np.concatenate([first.time[begun:], first.time[-1] + 0.001 + second.time])
    channels = {n: np.concatenate([v[begun:], second[n]]) for n, v in first.channels.items()}
    both = dataclasses.replace(first, time=time, channels=channels)
    assert not flows_not_shown([both], log.rig, "a")
    found = fit_valve_discrete([both], log.rig, find_ratio=False)["a"].estimates
    for key, true in dataclasses.asdict(made.rig.truth.valve_a).items():
        assert abs(found[key].value - true) < 4.0 * found[key].std, key


def test_an_inverted_command_is_why_a_3_2_valve_is_not_identified(folder: Path) -> None:
    log = log_of(folder, "valve_discrete_a")
    assert log.rig is not None
    inverted = [with_channels(t, valve_a=1.0 - t["valve_a"]) for t in log.trials]
    with pytest.raises(NotIdentifiedError, match="while its valve is on: valve_a is inverted"):
        fit_valve_discrete(inverted, log.rig)


def test_a_supply_of_the_other_kind_is_said(
    evacuated: tuple[GeneratedCampaign, Path], folder: Path, tmp_path: Path
) -> None:
    """What falls below the atmosphere is no inverted command, and what rises above it neither."""
    _, place = evacuated
    for own, supply, line in (
        (place, 3e5, "falls to .* while valve_a is on, .* or is the supply a vacuum"),
        (folder, 4e4, "reaches .* while valve_a is on, the rig file's supply_pressure_pa is 4e"),
    ):
        content = read_rig(own / "rig.toml").content
        air = {**content["air"], "supply_pressure_pa": supply}
        rig = rig_from_content({**content, "air": air}, "rig.toml")
        log = read_log(own / "valve_discrete_a.csv", rig)
        assert any(re.search(line, said) for said in log.contradictions)
        assert not any("inverted" in notice for notice in log.notices)
        with pytest.raises(NotIdentifiedError, match=line):
            fit_valve_discrete(log.trials, rig)


def test_a_gauge_pressure_of_a_vacuum_is_told_from_a_unit(
    evacuated: tuple[GeneratedCampaign, Path], tmp_path: Path
) -> None:
    made, place = evacuated
    frame, ambient = bench_frame(made), made.rig.atmosphere
    gauge = frame.assign(pressure_a_pa=frame["pressure_a_pa"] - ambient)
    with pytest.raises(InputError, match=r"looks like a gauge pressure in Pa: .*:Pa\(g\)"):
        read_back(gauge, place, tmp_path)
    counted = frame.assign(pressure_a_pa=ambient - frame["pressure_a_pa"])
    with pytest.raises(InputError, match="vacuum gauge, which counts Pa below") as refused:
        read_back(counted, place, tmp_path)
    advice = re.search(r'--map "([^"]*)"', str(refused.value))
    assert advice is not None
    mapping = parse_map([advice[1]])
    mapped = read_log(tmp_path / "bench.csv", read_rig(place / "rig.toml"), mapping)
    assert mapped.trials[0]["pressure_a_pa"] == pytest.approx(frame["pressure_a_pa"][:6000])


def test_no_surface_is_promised_where_none_is_fitted(rig_text: str) -> None:
    bleeds = with_arrangement(rig_text, ["a"])
    vacuum = one_chamber(rig_text, air={"supply_pressure_pa": 3e4})
    for rig, why in (
        (bleeds, "a fill and a bleed valve, of which"),
        (vacuum, "is a vacuum, under"),
    ):
        assert not any("PWM" in i.parameter for i in valves_identified({}, rig))
        asked = [i for i in valves_identified({"valve-pwm": []}, rig) if "PWM" in i.parameter]
        assert asked and all(not i.identified and why in i.reason for i in asked)
        with pytest.raises(NotIdentifiedError, match=why):
            fit_valve_pwm([], rig)


def test_no_surface_is_asked_for_where_none_is_fitted(
    shut: tuple[GeneratedCampaign, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made, place = shut
    rig = read_rig(place / "rig.toml")
    friction = bundle_of(made.rig, rig).friction
    assert friction is not None
    entry = '[[log]]\nkind = "motion-discrete"\nfile = "motion_discrete.csv"\n'
    (place / "motion.toml").write_text(f'rig = "rig.toml"\n{entry}')
    write_bundle(Bundle.new(rig, Parts(friction), []), tmp_path / "bundle.json")
    words = ["--bundle", str(tmp_path / "bundle.json")]
    assert main(["validate", str(place / "motion.toml"), *words]) == 3
    said = capsys.readouterr().err
    assert "fit valve-discrete tests of its valves into the bundle" in said


def test_commands_in_other_columns_are_mapped(
    shut: tuple[GeneratedCampaign, Path], tmp_path: Path
) -> None:
    made, place = shut
    frame = bench_frame(made)
    duties = frame.rename(columns={FILL: "duty_a_fill", BLEED: "duty_a_bleed"})
    log = read_back(duties, place, tmp_path)
    assert log.rig is not None
    with pytest.raises(InputError, match=r'0 or 1 throughout: map them with --map "valve_a_fill='):
        fit_valve_discrete(log.trials, log.rig)
    of_b = {FILL: "valve_b_fill", BLEED: "valve_b_bleed", "pressure_a_pa": "pressure_b_pa"}
    log = read_back(frame.rename(columns=of_b), place, tmp_path)
    with pytest.raises(InputError, match=r"valve_b_fill is of a chamber B, which \S*rig.toml does"):
        fit_valve_discrete(log.trials, log.rig)
    with pytest.raises(InputError, match=r'"valve_a_fill=valve_a_fill:0\.\.100 -> 0\.\.1"'):
        read_back(frame.assign(**{FILL: 100 * frame[FILL]}), place, tmp_path)


# --- commands -----------------------------------------------------------------------------


def test_check_speaks_of_the_one_chamber(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(folder / "motion_discrete.csv")]) == 0
    said = capsys.readouterr().out
    assert "valve A" in said and "valve B" not in said and "pressure_b_pa" not in said


def test_simulated_channels_are_those_of_the_one_chamber(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_bundle(true_bundle(folder), tmp_path / "bundle.json")
    words = ["--bundle", str(tmp_path / "bundle.json"), "-o", str(tmp_path / "out.csv")]
    assert main(["simulate", str(folder / "motion_discrete_2.csv"), *words]) == 0
    said = capsys.readouterr().out
    assert "pressure_a_pa" in said and "pressure_b_pa" not in said


def true_bundle(folder: Path) -> Bundle:
    """A bundle of the numbers behind seed 41's rig, known to 3 %."""
    made = random_one_chamber_rig(stream(41, "rig", 1000), "linear", False)
    return bundle_of(made, read_rig(folder / "rig.toml"))


def bundle_of(made: GeneratedRig, rig: Rig) -> Bundle:
    def known(values: Mapping[str, float]) -> dict[str, Estimate]:
        return {k: Estimate.symmetric(v, 0.03 * v, "SI", math.inf) for k, v in values.items()}

    truth = made.truth_content()
    valves = {"a": {"discrete": known(truth["valves"]["a"])}}
    friction = Friction.model_validate(known(truth["friction"]))
    return Bundle.new(rig, Parts(friction, FittedValves.model_validate(valves)), [])


def test_friction_motion_that_a_valve_drives_is_simulated(folder: Path) -> None:
    log = log_of(folder, "friction_motion")
    assert log.rig is not None and "motor_force_n" not in log.trials[0]
    test = prepare(log.trials[0], "friction-motion", log.rig, 2.0)
    assert test.pulsed and test.commands[0] is not None
    rig = dataclasses.replace(log.rig, motor=Motor(force_per_volt_n=1.0, max_force_n=9.0))
    idle = with_channels(log.trials[0], duty_a=np.zeros(len(log.trials[0])))
    with pytest.raises(InputError, match="column motor_force_n is missing"):
        prepare(idle, "friction-motion", rig, 2.0)


def test_a_test_begins_where_the_spring_rests_the_piston(rig_text: str) -> None:
    def rest(preload: float) -> float:
        spring = {"stiffness_nm_per_rad": 0.5, "preload_nm": preload}
        return base.place_at_rest(base.bare_parameters(one_chamber(rig_text, spring=spring)))

    half = 0.5 * float(one_chamber(rig_text).travel or 0.0)
    assert rest(-0.2) == pytest.approx(0.4 - half)
    assert rest(0.2) == -half and rest(-0.5 * half) == pytest.approx(0.0, abs=1e-9)
    assert base.place_at_rest(base.bare_parameters(one_chamber(rig_text))) == 0.0
    out, back = np.array([-0.95, 0.0]) * half, np.array([0.0, 0.95]) * half
    assert not leaves_travel(out, 0.9 * half, -half).any()
    assert list(leaves_travel(back, 0.9 * half, -half)) == [False, True]


def test_no_motor_is_proposed_where_there_is_none(
    made: GeneratedCampaign, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(candidates_of_motion, "DURATION_S", 3.0)
    monkeypatch.setattr(candidates_of_motion, "_DRAWS", 8)
    rig = read_rig(folder / "rig.toml")
    found = candidate_motions(rig, bundle_of(made.rig, rig).model(rig), has_motor=False)
    assert found and not any(m.motor.any() for m in found)
    for motion in found:
        assert motion.channels[0, 0] == pytest.approx(free_place(made.rig), abs=1e-3)
        assert np.ptp(motion.channels[0]) > 0.1 * made.rig.half_travel
        assert len(motion.valve_columns(rig)) == 1


@pytest.mark.slow
def test_a_test_to_play_of_two_valves(
    shut: tuple[GeneratedCampaign, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made, place = shut
    monkeypatch.setattr(design, "_POOL", 8)
    monkeypatch.setattr(design, "_ROUNDS", 0)
    monkeypatch.setattr(proposal, "_TRIED", 6)
    monkeypatch.setattr(proposal, "_FRESH", 4)
    monkeypatch.setattr(proposal, "_LAST", 8)
    entry = '[[log]]\nkind = "valve-discrete"\nfile = "valve_discrete_a.csv"\nvalve = "a"\n'
    (place / "bench.toml").write_text(f'rig = "rig.toml"\n{entry}')
    campaign = read_campaign(place / "bench.toml")
    asked = PlayRequest(("valves.a.c_dis",), 1.25, speed=2.0)
    found = played_test(begin(campaign, bundle_of(made.rig, campaign.rig)), asked)
    (expected,) = found.expected
    assert expected.after < 0.9 * expected.now
    log = read_log(found.write(tmp_path / "next.csv"), campaign.rig)
    trial = log.trials[0]
    stem = "duty" if found.kind == "motion-pwm" else "valve"
    fill, bleed = trial[f"{stem}_a_fill"], trial[f"{stem}_a_bleed"]
    assert fill.any() and fill[-1] == 0.0 and bleed[-1] == 1.0
    assert "motor_force_n" not in trial
    rest = base.place_at_rest(found_model(made, campaign.rig).parameters)
    placed = with_channels(trial, position_m=np.full(len(trial), rest))
    (run,) = simulate_trials([placed], campaign.rig, found_model(made, campaign.rig))
    assert 0.02 * made.rig.half_travel < np.ptp(run["position_m"])
    assert np.abs(run["position_m"]).max() < found.limits.position
    assert abs(run["pressure_a_pa"][-1] - made.rig.atmosphere) < 0.3 * np.ptp(run["pressure_a_pa"])


def found_model(made: GeneratedCampaign, rig: Rig) -> Model:
    return bundle_of(made.rig, rig).model(rig)


def test_controllers_of_two_chambers_say_so(rig_text: str) -> None:
    rig = one_chamber(rig_text)
    bundle = Bundle.new(rig, Parts(), [])
    with pytest.raises(NotIdentifiedError, match=r"the rig has one chamber, and .* steer two"):
        design_from_bundle(bundle)


def test_exported_constants_are_those_of_the_chamber_and_the_spring(rig_text: str) -> None:
    rig = one_chamber(rig_text, spring={"stiffness_nm_per_rad": 0.5, "preload_nm": 0.2})
    flat = flatten(Bundle.new(rig, Parts(), []), "0")
    names = set(flat.constants)
    assert "area_a_m2" in names and not names & {"area_b_m2", "offset_b_m"}
    assert list(flat.valves) == ["a"] and not any("valves.b" in name for name in flat.missing)
    text = render(flat, "sysid_", [], Bundle.new(rig, Parts(), [])).text
    assert "sysid_cylinder_torque(sysid_real pressure_a_pa)" in " ".join(text.split())
    (law,) = (law for law in mechanics(flat) if law.feature == "HAS_SPRING")
    p = base.bare_parameters(rig)
    assert law.evaluate(p, 0.3) == pytest.approx(base.spring_effort(0.3, p.stiffness, p.preload))
    assert law.evaluate(p, 0.3) == pytest.approx(base.load_effort(0.3, p))


# --- the generator's sizes ----------------------------------------------------------------


def test_a_campaign_of_another_size_is_similar(
    made: GeneratedCampaign, folder: Path, tmp_path: Path
) -> None:
    """The numbers that a fit should find belong to the scaled logs, to the simulator's accuracy."""
    other = scaled(made, time=10.0, area=0.1, length=0.5)
    write_campaign(tmp_path, other, "generated")
    run, measured = simulated_and_measured(other, tmp_path)
    noise = np.std(run["pressure_a_pa"] - measured["pressure_a_pa"])
    assert noise < 1.1 * other.rig.truth.pressure_noise_pa
    assert measured.time[-1] == pytest.approx(
        10.0 * log_of(folder, "motion_discrete_2").trials[0].time[-1]
    )
    way = np.ptp(measured["position_m"])
    assert np.max(np.abs(run["position_m"] - measured["position_m"])) < 0.01 * way


def test_no_effect_of_a_motor_is_tried_where_there_is_none(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nor is its command among what a residual may depend on."""
    campaign, bundle = str(folder / "campaign.toml"), str(tmp_path / "b.json")
    assert main(["fit", campaign, "-o", bundle]) == 0
    capsys.readouterr()
    out = str(tmp_path / "d.json")
    assert main(["diagnose", campaign, "--bundle", bundle, "-o", out, "--quick"]) == 0
    said = capsys.readouterr().out
    assert "Remainder of chamber A's balance" in said
    # What a quick diagnosis leaves out is no structure that nothing explains.
    assert said.startswith("Adequate")
    for name in ("torque-ripple", "torque-constant-error", "amplifier-lag", "motor command"):
        assert name not in said, name
