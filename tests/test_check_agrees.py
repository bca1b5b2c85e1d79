"""`sysid check` and `sysid fit friction` agree on what a log identifies, over kinds of log."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache, partial
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from friction_trials import PERIOD, UNWRITTEN, constant, ramp, swing
from test_friction_combinations import moved, slid

from sysid.commands.app import main
from sysid.io.logs import Trial

BUNDLED = Path(__file__).resolve().parent.parent / "datasets" / "bundled"
NAMES = {
    "static friction": "static_nm",
    "Coulomb friction": "coulomb_nm",
    "viscous friction": "viscous_nm_s_per_rad",
    "torque offset": "offset_nm",
    "inertia": "inertia_kg_m2",
}
ARM = """
[rig]
name = "arm"
orientation = "horizontal"
motion = "rotary"
"""
WAYS = {"forwards": (1.0,), "backwards": (-1.0,), "both": (1.0, -1.0)}


def static(ways: tuple[float, ...], speeds: int) -> list[Trial]:
    return [ramp(0.333, 0.208, x, int(w)) for x in (-0.5, 0.5)[:speeds] for w in ways]


def sliding(ways: tuple[float, ...], speeds: int) -> list[Trial]:
    return slid((0.25, 0.31)[:speeds], ways, 0.005)


def motion(ways: tuple[float, ...], speeds: int) -> list[Trial]:
    return [moved(ways, (0.5, 1.1)[:speeds], str(k)) for k in range(2)]


def strokes(ways: tuple[float, ...], speeds: int) -> list[Trial]:
    """Back and forth several times, or the same way with a pause between."""
    return [moved(ways * 3, (0.9, 0.4)[:speeds], "strokes")]


def mixed(ways: tuple[float, ...], speeds: int) -> list[Trial]:
    return [*static(ways, speeds), *sliding(ways, speeds), *motion(ways, speeds)]


KINDS: tuple[Callable[[tuple[float, ...], int], list[Trial]], ...] = (
    static,
    sliding,
    motion,
    strokes,
    mixed,
)


LOGS: dict[str, Callable[[], list[Trial]]] = {
    **{
        f"{kind.__name__}, {name}, {speeds} speeds": partial(kind, ways, speeds)
        for kind, (name, ways), speeds in product(KINDS, WAYS.items(), (1, 2))
    },
    "swing": lambda: [swing()],
    "held": lambda: [Trial("held", PERIOD * np.arange(900), held_channels(), "held")],
    "one stalled trial": lambda: [constant(0.15, 0.0, "stalled", kick_s=0.01)],
}


@cache
def log_of(name: str) -> list[Trial]:
    return LOGS[name]()


def held_channels() -> dict[str, np.ndarray]:
    return {"theta_rad": np.zeros(900), "motor_torque_nm": np.full(900, 0.05)}


def write(path: Path, trials: list[Trial], valves: bool) -> None:
    frames = []
    for k, one in enumerate(trials):
        frame = pd.DataFrame({"time_s": one.time, **one.channels, "test": k})
        if valves:
            frame = frame.assign(pressure_a_pa=1e5, pressure_b_pa=1e5, valve_a=0, valve_b=0)
        frames.append(frame)
    pd.concat(frames).to_csv(path, index=False)


def identified_by_fit(
    log: Path, capsys: pytest.CaptureFixture[str], *options: str
) -> tuple[set[str], str]:
    status = main(["fit", "friction", str(log), "--json", *UNWRITTEN, *options])
    said = capsys.readouterr()
    if status == 3:
        return set(), said.err
    assert status == 0, said.err
    friction = json.loads(said.out)["friction"]
    names = {key for key in NAMES.values() if friction.get(key, {}).get("value") is not None}
    for notice in json.loads(said.out)["notices"]:
        if notice.startswith("not identified: "):
            claimed = notice.removeprefix("not identified: ").split(":")[0].lower()
            assert not any(key.split("_")[0] in claimed for key in names), notice
    return names, said.err


@pytest.mark.parametrize("rig", ["valves", "no valves", "no inertia"])
@pytest.mark.parametrize("name", LOGS)
def test_check_and_fit_agree(
    name: str, rig: str, tmp_path: Path, rig_text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    inertia = "\n[inertia]\nequivalent_kg_m2 = 0.024\n" if rig == "no valves" else ""
    (tmp_path / "rig.toml").write_text(rig_text if rig == "valves" else ARM + inertia)
    log = tmp_path / "run.csv"
    write(log, log_of(name), rig == "valves")
    assert main(["check", str(log), "--json"]) == 0
    checked = json.loads(capsys.readouterr().out)["logs"][0]["identifies"]
    said = {NAMES[i["parameter"]]: i for i in checked if i["parameter"] in NAMES}
    assert set(said) == set(NAMES.values())
    yes = {key for key, item in said.items() if item["identified"]}
    fitted, _ = identified_by_fit(log, capsys)
    assert fitted - {"inertia_kg_m2"} == yes - {"inertia_kg_m2"}
    with_inertia, _ = identified_by_fit(log, capsys, "--inertia")
    assert ("inertia_kg_m2" in with_inertia) == ("inertia_kg_m2" in yes)
    assert all(item["reason"] for item in checked)
    assert not any("variance inflation" in item["reason"] for item in checked)


CYLINDER = """
[rig]
name = "cylinder"
orientation = "horizontal"
motion = "linear"
[air]
gas_constant_j_per_kg_k = 287.0
heat_capacity_ratio = 1.4
temperature_k = 293.15
atmospheric_pressure_pa = 1e5
supply_pressure_pa = 7e5
[cylinder]
area_a_m2 = 8e-4
area_b_m2 = 7e-4
offset_a_m = 0.3
offset_b_m = 0.3
stroke_m = 0.5
"""


@pytest.mark.parametrize("measured", ["position_m", "velocity_m_per_s"])
@pytest.mark.parametrize("pressures", [1, 2])
def test_check_and_fit_agree_on_a_cylinder_without_a_motor(
    pressures: int, measured: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its pressures are the effort, where both are logged."""
    rng, time = np.random.default_rng(4), np.arange(0.0, 10.0, 0.002)
    speed = 0.11 * np.sin(2.2 * time) + 0.11 * np.sin(5.6 * time)
    force = 4.0 * np.gradient(speed, time) + 18.0 * np.tanh(speed / 1e-3) + 55.0 * speed
    position = (
        0.05 * (1.0 - np.cos(2.2 * time))
        + 0.11 / 5.6 * (1.0 - np.cos(5.6 * time))
        + 1e-6 * rng.normal(size=len(time))
    )
    frame = pd.DataFrame({"time_s": time, "pressure_b_pa": 4e5 + 50 * rng.normal(size=len(time))})
    if pressures == 2:
        frame["pressure_a_pa"] = 1e5 + (force + 3e5 * 7e-4) / 8e-4 + 50 * rng.normal(size=len(time))
    frame[measured] = position if measured == "position_m" else speed
    (tmp_path / "rig.toml").write_text(CYLINDER)
    log = tmp_path / "run.csv"
    frame.to_csv(log, index=False)
    assert main(["check", str(log), "--json"]) == 0
    checked = json.loads(capsys.readouterr().out)["logs"][0]
    yes = {i["parameter"] for i in checked["identifies"] if i["identified"]}
    assert ("friction-motion" in checked["kinds"]) == (pressures == 2)
    assert main(["fit", "friction", str(log), "--json", *UNWRITTEN]) == (0 if yes else 2)
    said = capsys.readouterr()
    integrated = f"position_m is the integral of {measured}" in said.err
    assert integrated == (bool(yes) and measured != "position_m")
    if pressures == 2:
        assert {"Coulomb friction", "viscous friction", "inertia"} <= yes
        found = json.loads(said.out)["friction"]
        assert found["coulomb_n"]["value"] == pytest.approx(18.0, rel=0.1)


@pytest.mark.parametrize("torques", [1, 3])
def test_check_and_fit_agree_on_readings(
    torques: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(6)
    torque = np.repeat([0.25, 0.3, 0.4][:torques], 4)
    speed = (torque - 0.2) / 0.05 + 0.02 * rng.normal(size=len(torque))
    frame = pd.DataFrame({"time_s": np.arange(len(torque)), "velocity_rad_per_s": speed})
    frame.assign(motor_torque_nm=torque).to_csv(tmp_path / "points.csv", index=False)
    (tmp_path / "rig.toml").write_text(ARM)
    campaign = tmp_path / "campaign.toml"
    campaign.write_text(
        'rig = "rig.toml"\n\n[[log]]\nfile = "points.csv"\nkind = "friction-points"\n'
    )
    assert main(["check", str(campaign), "--json"]) == 0
    checked = json.loads(capsys.readouterr().out)["logs"][0]["identifies"]
    yes = {NAMES[i["parameter"]] for i in checked if i["identified"]}
    assert main(["fit", str(campaign), "--json"]) == 0
    friction = json.loads(capsys.readouterr().out)["friction"]
    assert len(friction.get("combinations", [])) == (0 if torques > 1 else 1)
    assert yes == {key for key in NAMES.values() if friction.get(key, {}).get("value") is not None}
    assert bool(yes) == (torques > 1)


FLOWS = {
    "valve A choked filling flow": "choked_flow_fill_kg_s",
    "valve A c_fill": "c_fill",
    "valve A choked exhaust flow": "choked_flow_dis_kg_s",
    "valve A c_dis": "c_dis",
}
# Seconds of each test that are kept, and how many rows to the next one.
CUTS = {
    "whole": (0.0, 9.0, 5),
    "slow": (0.0, 9.0, 60),
    "filling alone": (0.0, 3.9, 5),
    "the choked filling alone": (0.0, 1.06, 1),
    "no valve switched": (0.0, 0.9, 5),
}


@pytest.mark.parametrize("name", CUTS)
def test_check_and_fit_agree_on_an_on_off_valve(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, last, every = CUTS[name]
    frame = pd.read_parquet(BUNDLED / "valve_discrete_a.parquet")
    since = frame.time_s - frame.groupby("test").time_s.transform("min")
    kept = frame[(since >= first) & (since <= last) & frame.test.isin(frame.test.unique()[:3])]
    kept = kept[kept.groupby("test").cumcount() % every == 0]
    log = tmp_path / "run.csv"
    kept.to_csv(log, index=False)
    rig = (BUNDLED / "rig.toml").read_text()
    sampling = rig.replace("period_s = 0.001\n", f"period_s = {0.001 * every:g}\n")
    (tmp_path / "rig.toml").write_text(sampling)
    assert main(["check", str(log), "--json"]) == 0
    checked = json.loads(capsys.readouterr().out)["logs"][0]["identifies"]
    yes = {FLOWS[i["parameter"]] for i in checked if i["parameter"] in FLOWS and i["identified"]}
    status = main(["fit", "valve-discrete", str(log), "--json", *UNWRITTEN])
    said = capsys.readouterr()
    assert status in (0, 3), said.err
    fitted = json.loads(said.out)["valves"]["a"]["discrete"] if status == 0 else {}
    assert yes == {key for key in FLOWS.values() if fitted.get(key, {}).get("value") is not None}
    assert bool(yes) == (name != "no valve switched")
