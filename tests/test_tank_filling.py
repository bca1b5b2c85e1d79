"""A tank that a valve fills from its supply, or pumps down to a vacuum: a held chamber's tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sysid.checks.log_check import check_log
from sysid.commands.app import main
from sysid.errors import InputError, NotIdentifiedError
from sysid.io.logs import Log, Trial
from sysid.io.rig import Rig, rig_from_content
from sysid.pipeline.fit_part import bench_fit, fit_valve_discrete

P0, T = 101325.0, 293.15
AIR, HELIUM = (287.0, 1.4), (2077.0, 1.667)


def drawn(
    seed: int, is_vacuum: bool, gas: tuple[float, float] = AIR
) -> tuple[Trial, Rig, dict[str, float]]:
    """A tank of 10 ml to 100 l that takes 0.2 to 60 s, and often is not full at the end."""
    rng = np.random.default_rng([seed, is_vacuum])
    volume, lasts = 10 ** rng.uniform(-5.0, -1.0), 10 ** rng.uniform(-0.7, 1.8)
    supply = rng.uniform(5e3, 4e4) if is_vacuum else rng.uniform(3e5, 9e5)
    gain, way = gas[0] * gas[1] * T / volume, -1.0 if is_vacuum else 1.0
    # sqrt(|Ps - P|) falls evenly: by all of it in `lasts`, which the choked part precedes.
    begin = P0 if is_vacuum else 0.53 * supply
    c_fill = 2.0 * np.sqrt(way * (supply - begin)) / (gain * lasts)
    choked = c_fill * np.sqrt(supply - begin) * rng.uniform(0.95, 1.05) if way > 0.0 else np.inf
    linear = (begin - P0) / (gain * choked)
    step = lasts / rng.uniform(300.0, 900.0)
    time = step * np.arange(int((linear + lasts * rng.uniform(0.6, 2.0)) / step)) + 0.0
    root = np.sqrt(way * (supply - begin)) - 0.5 * gain * c_fill * (time - linear)
    later = supply - way * np.maximum(root, 0.0) ** 2
    pressure = np.where(time < linear, P0 + gain * choked * time, later) if way > 0.0 else later
    rest = 12
    pressure = np.concatenate([np.full(rest, P0), pressure])
    pressure = pressure + 10 ** rng.uniform(1.0, 2.0) * rng.standard_normal(len(pressure))
    on = (np.arange(len(pressure)) >= rest).astype(float)
    channels = {"pressure_a_pa": pressure, "valve_a": on}
    trial = Trial("1", step * np.arange(len(pressure)), channels, "tank.csv")
    air = {
        "gas_constant_j_per_kg_k": gas[0],
        "heat_capacity_ratio": gas[1],
        "temperature_k": T,
        "atmospheric_pressure_pa": P0,
        "supply_pressure_pa": supply,
    }
    head = {"name": "tank", "orientation": "horizontal"}
    content = {"rig": head, "air": air, "tank": {"volume_m3": volume}}
    truth = {"c_fill": c_fill} | ({} if is_vacuum else {"choked_flow_fill_kg_s": choked})
    return trial, rig_from_content(content, "rig.toml"), truth


@pytest.mark.parametrize("is_vacuum", [False, True], ids=["filled", "pumped down"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_tank_has_the_law_of_the_valve_that_fills_it(seed: int, is_vacuum: bool) -> None:
    """Whatever its size and the time that it takes."""
    trial, rig, truth = drawn(seed, is_vacuum)
    fit = fit_valve_discrete([trial], rig, find_ratio=False, law="thesis")
    found = fit.part().valves.side("a").discrete.estimates()  # type: ignore[union-attr]
    for name, true in truth.items():
        assert found[name].value == pytest.approx(true, rel=5e-3), name
    assert not found["c_dis"].identified and "not switched off" in str(found["c_dis"].reason)
    (line,) = [line for line in fit.notices if "1.4 times as large" in line]
    assert "takes no heat from the wall" in line


def test_a_tank_that_one_valve_pumps_down_and_another_bleeds() -> None:
    """It has one chamber; it was refused as a rig with two."""
    trial, rig, truth = drawn(3, True)
    content = {**rig.content, "valves": {"arrangement": "fill-and-bleed"}}
    content["valves"] |= {"on_delay_s": 0.0, "off_delay_s": 0.0}
    volume = content["tank"]["volume_m3"]
    pumped, step, rows = trial["pressure_a_pa"], trial.time[1], np.arange(300)
    low = float(np.mean(pumped[-3:]))
    c_dis = volume / (AIR[0] * AIR[1] * T * 60.0 * step)
    bled = P0 + (low - P0) * np.exp(-rows / 60.0)
    pressure = np.concatenate([pumped, np.full(20, low), bled])
    fill = np.concatenate([trial["valve_a"], np.zeros(320)])
    bleed = np.concatenate([np.zeros(len(pumped) + 20), np.ones(300)])
    channels = {"pressure_a_pa": pressure, "valve_a_fill": fill, "valve_a_bleed": bleed}
    two = Trial("1", step * np.arange(len(pressure)), channels, "tank.csv")
    fit = fit_valve_discrete(
        [two], rig_from_content(content, "rig.toml"), find_ratio=False, law="thesis"
    )
    found = fit.part().valves.side("a").discrete.estimates()  # type: ignore[union-attr]
    assert found["c_fill"].value == pytest.approx(truth["c_fill"], rel=0.01)
    assert found["c_dis"].value == pytest.approx(c_dis, rel=0.01)


@pytest.mark.parametrize("seed", [4, 5])
def test_a_tank_of_another_gas(seed: int) -> None:
    """The laws have the gas that the rig file declares."""
    trial, rig, truth = drawn(seed, False, HELIUM)
    fit = fit_valve_discrete([trial], rig, find_ratio=False)
    found = fit.part().valves.side("a").discrete.estimates()  # type: ignore[union-attr]
    for name, true in truth.items():
        assert found[name].value == pytest.approx(true, rel=5e-3), name
    assert any("1.67 times as large" in line for line in fit.notices)


def test_a_data_sheet_of_air_is_not_taken_for_another_gas() -> None:
    """ISO 6358's conductance of it would be wrong by the root of the gas constants."""
    sheet = {
        "law": "iso6358",
        "sonic_conductance_m3_per_s_pa": {"fill": 1.5e-8, "exhaust": 1.4e-8},
        "critical_ratio": {"fill": 0.3, "exhaust": 0.3},
    }
    for gas, is_air in ((AIR, True), ((296.8, 1.4), True), (HELIUM, False), ((188.9, 1.3), False)):
        _, rig, _ = drawn(4, False, gas)
        content = {**rig.content, "valve_a": sheet}
        if is_air:
            assert rig_from_content(content, "rig.toml").data_sheet("a") is not None
            continue
        with pytest.raises(InputError, match=r"^rig\.toml: \[valve_a\] is a data sheet .* of air"):
            rig_from_content(content, "rig.toml")


def test_a_tanks_discharge_names_the_fit_of_its_filling() -> None:
    trial, rig, _ = drawn(1, False)
    with pytest.raises(NotIdentifiedError, match=r"valve-discrete.* fits how it fills"):
        bench_fit("tank", [trial], rig)


def test_a_slow_tank_on_a_supply_that_moves_is_refused_all_the_same() -> None:
    """It rests for as long as it took to fill, and then follows the supply."""
    trial, rig, _ = drawn(2, False)
    step, pressure = float(np.diff(trial.time[:2])[0]), trial["pressure_a_pa"]
    supply = rig.require("air", "").supply_pressure_pa
    rest = supply + 30.0 * np.random.default_rng(1).standard_normal(3 * len(pressure))
    rest[2 * len(pressure) :] += 0.05 * supply
    full = np.concatenate([pressure, rest])
    more = Trial(
        "1",
        step * np.arange(len(full)),
        {"pressure_a_pa": full, "valve_a": (np.arange(len(full)) >= 12).astype(float)},
        "moves.csv",
    )
    with pytest.raises(NotIdentifiedError, match="supply was unsteady"):
        fit_valve_discrete([more], rig, find_ratio=False)


def filled_and_emptied(folder: Path) -> Path:
    """A campaign of valve-discrete tests of a tank, by the thesis' law in both directions."""
    gain, supply, choked = AIR[0] * AIR[1] * T / 1e-3, 4e5, 1e-4
    step, pressure, values, on = 5e-3, P0, [], []
    c_fill, c_dis = choked / np.sqrt(0.47 * supply), choked / (P0 / 0.53 - P0)
    for command, rows in ((0.0, 20), (1.0, 2000), (0.0, 3000)):
        for _ in range(rows):
            values.append(pressure)
            on.append(command)
            for _ in range(10):
                filling = min(choked, c_fill * np.sqrt(max(supply - pressure, 0.0)))
                flow = filling if command else -min(choked, c_dis * (pressure - P0))
                pressure += gain * flow * step / 10.0
    rng = np.random.default_rng(3)
    for name in ("one", "two"):
        noisy = np.array(values) + 30.0 * rng.standard_normal(len(values))
        columns = np.column_stack([step * np.arange(len(on)), noisy, on])
        head = "time_s,pressure_a_pa,valve_a"
        np.savetxt(folder / f"{name}.csv", columns, "%.9g", ",", header=head, comments="")
    (folder / "rig.toml").write_text(
        '[rig]\nname = "tank"\norientation = "horizontal"\n[air]\n'
        f"temperature_k = {T}\natmospheric_pressure_pa = {P0}\nsupply_pressure_pa = {supply}\n"
        f"gas_constant_j_per_kg_k = {AIR[0]}\nheat_capacity_ratio = {AIR[1]}\n"
        "[tank]\nvolume_m3 = 1e-3\n"
    )
    logs = "".join(
        f'[[log]]\nfile = "{name}.csv"\nkind = "valve-discrete"\nuse = "{use}"\n'
        for name, use in (("one", "fit"), ("two", "holdout"))
    )
    (folder / "campaign.toml").write_text(f'name = "tank"\nrig = "rig.toml"\n{logs}')
    return folder


def test_a_campaign_of_a_tank_asks_for_no_test_of_what_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its valve's flows are what its tests identify; there is no friction, and no motion."""
    monkeypatch.chdir(filled_and_emptied(tmp_path))
    assert main(["check", "campaign.toml"]) == 0
    checked = capsys.readouterr().out
    assert "everything is identified" in checked
    assert "c_fill" in checked and "friction" not in checked and "valve B" not in checked
    assert main(["run", "campaign.toml", "-o", "out"]) == 0
    ran = capsys.readouterr()
    assert "Next: add tank tests, which a diagnosis of a tank needs" in ran.out
    assert "a tank alone, which has no motion to simulate" in ran.out
    assert "friction" not in ran.out + ran.err
    assert main(["simulate", "one.csv", "--bundle", "out/bundle.json", "-o", "s.csv"]) == 2
    assert "rig: declares a tank alone" in capsys.readouterr().err


def test_check_says_what_a_fill_with_its_discharge_identifies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Both the law of the discharge, and by another fit the flows of the valve that fills."""
    assert main(["check", str(filled_and_emptied(tmp_path) / "one.csv")]) == 0
    checked = capsys.readouterr().out
    first = checked.splitlines()[0]
    assert "c_dis" in first and "valve A choked filling flow, c_fill" in first
    assert "(by sysid fit valve-discrete)" in checked and "exhaust flow" not in checked


@pytest.mark.parametrize("is_vacuum", [False, True], ids=["filled", "pumped down"])
def test_check_says_what_a_fill_alone_identifies(is_vacuum: bool) -> None:
    """By its columns it may be a discharge; what a fit of its valve finds, a check says."""
    trial, rig, truth = drawn(2, is_vacuum)
    log = Log(Path("tank.csv"), "", (trial,), (), rig)
    check = check_log(log, rig)
    assert check.kinds == {"valve-discrete": 1}
    names = {item.parameter for item in check.identifies if item.identified}
    wanted = {"c_fill": "valve A c_fill", "choked_flow_fill_kg_s": "valve A choked filling flow"}
    assert names == {wanted[name] for name in truth}
    told = check_log(log, rig, "valve-discrete")
    assert told.identifies == check.identifies and told.excitation == check.excitation


@pytest.mark.parametrize(
    "lasts, declared, is_said", [(1000.0, P0, False), (0.5, P0, False), (0.5, P0 - 8e3, True)]
)
def test_a_chamber_that_hardly_fills_again_does_not_say_where_it_rests(
    lasts: float, declared: float, is_said: bool
) -> None:
    """Where it would rest is fitted, with an error that is then larger than the difference.

    `lasts` s in which it fills by 1 - 1/e, after a vacuum of 30 kPa has emptied it.
    """
    rng, time = np.random.default_rng(4), 0.01 * np.arange(1200)
    on = (time >= 0.5) & (time < 7.0)
    root = np.sqrt(P0 - 3e4) - 30.0 * (time - 0.5)
    emptied = 3e4 + np.maximum(root, 0.0) ** 2
    pressure = np.where(time < 0.5, P0, emptied)
    pressure[time >= 7.0] = P0 - (P0 - emptied[700]) * np.exp((7.0 - time[time >= 7.0]) / lasts)
    channels = {"pressure_a_pa": pressure + 30.0 * rng.standard_normal(1200), "valve_a": 1.0 * on}
    air = {
        "gas_constant_j_per_kg_k": AIR[0],
        "heat_capacity_ratio": AIR[1],
        "temperature_k": T,
        "atmospheric_pressure_pa": declared,
        "supply_pressure_pa": 3e4,
    }
    head = {"name": "tank", "orientation": "horizontal"}
    rig = rig_from_content({"rig": head, "air": air, "tank": {"volume_m3": 1e-3}}, "rig.toml")
    trial = Trial("1", time, channels, "tank.csv")
    fit = fit_valve_discrete([trial], rig, find_ratio=False, law="thesis")
    assert any("the open chamber rests at" in line for line in fit.notices) == is_said
