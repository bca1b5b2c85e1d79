"""What only several logs of a campaign show together (`sysid/checks/consistency`)."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from golden_folder import BUNDLED

from sysid.blocks.sections import Lines
from sysid.checks.consistency.campaign import (
    LogReadings,
    check_consistency,
    contradictions,
    readings_of,
)
from sysid.checks.consistency.comparison import disagreements
from sysid.checks.consistency.flow import filling_flows
from sysid.checks.consistency.kinds import other_kind
from sysid.checks.consistency.levels import filled_pressures, rest_pressures
from sysid.checks.consistency.quantities import RIG, Reading, SharedQuantity
from sysid.checks.log_check import check_campaign
from sysid.checks.shown import quality_section
from sysid.commands.app import main
from sysid.io.campaign import Campaign, read_campaign
from sysid.io.logs import Trial

Change = Callable[[pd.DataFrame], pd.DataFrame]


@pytest.fixture(scope="module")
def campaign() -> Campaign:
    return read_campaign(BUNDLED / "campaign.toml")


@pytest.fixture(scope="module")
def healthy(campaign: Campaign) -> dict[str, LogReadings]:
    return {e.file: readings_of(campaign.read(e), e.kind, campaign.rig) for e in campaign.logs}


def changed(
    campaign: Campaign, healthy: dict[str, LogReadings], file: str, change: Change, folder: Path
) -> tuple[str, ...]:
    """The notices of the campaign with one of its logs changed."""
    (entry,) = (e for e in campaign.logs if e.file == file)
    path = folder / file
    change(pd.read_parquet(entry.path)).to_parquet(path)
    log = campaign.read(dataclasses.replace(entry, path=path))
    read = healthy | {file: readings_of(log, entry.kind, campaign.rig)}
    return contradictions(read.values(), campaign.rig)


def scaled(column: str, factor: float, shift: float = 0.0) -> Change:
    return lambda f: f.assign(**{column: f[column] * factor + shift})


def every_second_row(frame: pd.DataFrame) -> pd.DataFrame:
    """Rows left out with the times kept: the log seems to run twice as fast."""
    parts = []
    for _, test in frame.groupby("test", sort=False):
        half = test.iloc[::2]
        parts.append(half.assign(time_s=test["time_s"].to_numpy()[: len(half)]))
    return pd.concat(parts, ignore_index=True)


def swapped(frame: pd.DataFrame) -> pd.DataFrame:
    a, b = "pressure_a_pa", "pressure_b_pa"
    return frame.assign(**{a: frame[b], b: frame[a]})


def test_a_healthy_campaign_contradicts_nothing(
    campaign: Campaign, healthy: dict[str, LogReadings]
) -> None:
    """The bundled campaign, though an effect is in it that its rig file does not declare."""
    assert contradictions(healthy.values(), campaign.rig) == ()
    shared = {r.quantity.name for one in healthy.values() for r in one.readings}
    assert {"the inertia that is moved", "static friction"} < shared
    assert {f"the choked filling flow of valve {v}" for v in "AB"} < shared


@pytest.mark.parametrize("rig", ["rig-1", "rig-2", "rig-3", "rig-4"])
def test_the_samples_contradict_nothing(rig: str, shared_samples: Path) -> None:
    assert check_consistency(read_campaign(shared_samples / rig / "campaign.toml")) == ()


@pytest.mark.parametrize(
    ("file", "change", "said"),
    [
        (
            "motion_pwm.parquet",
            every_second_row,
            r"^motion_pwm.*inertia.*time base wrong by 0\.(5|49)",
        ),
        ("valve_pwm_a.parquet", every_second_row, r"^valve_pwm_a.*flow of valve A.*time base"),
        ("valve_discrete_b.parquet", every_second_row, r"^valve_discrete_b.*valve B.*time base"),
        ("motion_discrete.parquet", swapped, r"^motion_discrete.*chambers brake.*swapped"),
        (
            "motion_motor.parquet",
            scaled("motor_torque_nm", -1.0),
            r"^motion_motor.*sign of motor_torque_nm",
        ),
        ("motion_pwm.parquet", scaled("theta_rad", -1.0), r"sign of theta_rad is reversed"),
        (
            "motion_pwm.parquet",
            scaled("motor_torque_nm", 0.4),
            r"^motion_pwm.parquet by its motor.*gain of motor_torque_nm wrong by 0\.(4|39)",
        ),
        (
            "friction_static.parquet",
            scaled("motor_torque_nm", 0.4),
            r"^friction_static.*below the Coulomb friction",
        ),
        (
            "motion_discrete.parquet",
            lambda f: f.assign(**{p: f[p] + 100200.0 for p in ("pressure_a_pa", "pressure_b_pa")}),
            r"^motion_discrete.*at rest.*atmosphere added twice",
        ),
    ],
)
def test_a_slip_in_one_log_is_named(
    file: str,
    change: Change,
    said: str,
    campaign: Campaign,
    healthy: dict[str, LogReadings],
    tmp_path: Path,
) -> None:
    lines = changed(campaign, healthy, file, change, tmp_path)
    assert any(re.search(said, line) for line in lines), lines
    assert all(line.startswith(file) for line in lines), lines


@pytest.mark.parametrize(
    ("key", "factor", "said"),
    [
        ("equivalent_kg_m2", 10.0, r"^the rig file.*payload under \[inertia\] wrong by"),
        ("pitch_radius_m", 0.5, r"by its chambers.*areas or pitch radius \(a diameter\?\)"),
    ],
)
def test_a_slip_in_the_rig_file_is_named(
    key: str, factor: float, said: str, campaign: Campaign, tmp_path: Path
) -> None:
    text = (BUNDLED / "rig.toml").read_text()
    found = re.search(rf"{key} = ([\d.]+)", text)
    assert found is not None
    (tmp_path / "rig.toml").write_text(
        text.replace(found[0], f"{key} = {factor * float(found[1])}")
    )
    for entry in campaign.logs:
        if entry.kind.startswith("motion") and entry.path.suffix == ".parquet":
            (tmp_path / entry.file).write_bytes(entry.path.read_bytes())
    logs = "".join(
        f'[[log]]\nkind = "{e.kind}"\nfile = "{e.file}"\n'
        for e in campaign.logs
        if (tmp_path / e.file).exists()
    )
    (tmp_path / "campaign.toml").write_text(f'rig = "rig.toml"\n{logs}')
    lines = check_consistency(read_campaign(tmp_path / "campaign.toml"))
    assert any(re.search(said, line) for line in lines), lines
    for line in lines:
        assert "or an effect that the diagnosis tests" in line
        assert len(re.findall(r"\([\d.e-]+ to [\d.e-]+\)", line)) >= 1


MOVED = SharedQuantity("the inertia that is moved", "kg m2", 1.6, "a slip by {ratio}", "an effect")


def reading(source: str, value: float, share: float = 0.01) -> Reading:
    return Reading(MOVED, source, value, value * (1.0 - share), value * (1.0 + share))


def test_only_significant_and_large_differences_are_reported() -> None:
    logs = [reading("a", 1.0), reading("b", 1.01), reading(RIG, 1.3, 0.0)]
    assert list(disagreements(logs)) == []  # a payload that the diagnosis is to find
    wide = [reading("a", 1.0), reading("b", 3.0, 0.9)]
    assert list(disagreements(wide)) == []
    (found,) = disagreements([reading("a", 1.0), reading("b", 1.01), reading("ab", 4.0)])
    assert found.line.startswith("ab: ") and "a slip by 3.96" in found.line
    assert found.source == "ab"
    (found,) = disagreements([reading("a", 1.0), reading("b", 1.01), reading(RIG, 4.0, 0.0)])
    assert found.line.startswith(RIG) and found.source == RIG
    (found,) = disagreements([reading("a", 4.0), reading(RIG, 1.0, 0.0)])
    assert found.line.startswith("a: ") and found.source == "a"


def test_check_and_report_show_contradictions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    frame = every_second_row(pd.read_parquet(BUNDLED / "motion_pwm.parquet"))
    frame.to_parquet(tmp_path / "fast.parquet")
    for name in ("rig.toml", "motion_motor.parquet"):
        (tmp_path / name).write_bytes((BUNDLED / name).read_bytes())
    (tmp_path / "campaign.toml").write_text(
        'rig = "rig.toml"\n'
        '[[log]]\nkind = "motion-motor"\nfile = "motion_motor.parquet"\n'
        '[[log]]\nkind = "motion-pwm"\nfile = "fast.parquet"\n'
    )
    assert main(["check", str(tmp_path / "campaign.toml")]) == 0
    assert "notice: fast.parquet: the inertia that is moved" in capsys.readouterr().err
    campaign = read_campaign(tmp_path / "campaign.toml")
    checks = check_campaign(campaign)
    first, second = (check.to_json() for check in checks)
    assert "contradicts" not in first and len(second["contradicts"]) == 1
    assert type(checks[1]).from_json(second) == checks[1]
    section = quality_section(campaign, checks)
    shown = [b for b in section.blocks if isinstance(b, Lines) and "contradict" in b.summary]
    assert [b.lines for b in shown] == [checks[1].contradicts]


# --- the steady effort of each log, and its kind --------------------------------------------

PULLED = """
[rig]
name = "pulled"
motion = "linear"
orientation = "{orientation}"

[air]
gas_constant_j_per_kg_k = 287.0
heat_capacity_ratio = 1.4
temperature_k = 293.15
atmospheric_pressure_pa = 101325.0
supply_pressure_pa = 700000.0

[cylinder]
area_a_m2 = 1.2566e-3
area_b_m2 = 1.1027e-3
offset_a_m = 0.12
offset_b_m = 0.12
stroke_m = 0.2

[inertia]
mass_kg = 3.0
"""
GAUGES = ((0.0, 0.0), (1e5, 3e5), (4e5, 1e5), (2e5, 2.5e5))


def pulled(gauges: tuple[float, float], seed: int) -> pd.DataFrame:
    """A cylinder pulled along sines under steady pressures, with a load cell in line."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 12.0, 0.005)
    position = 0.05 * np.sin(2.0 * np.pi * 0.4 * time) + 0.02 * np.sin(2.0 * np.pi * 0.9 * time)
    velocity = np.gradient(position, time)
    pushed = gauges[0] * 1.2566e-3 - gauges[1] * 1.1027e-3
    force = 3.0 * np.gradient(velocity, time) + 30.0 * np.sign(velocity) + 100.0 * velocity - pushed
    noise = rng.normal(size=(3, len(time)))
    return pd.DataFrame(
        {
            "time_s": time,
            "position_m": position,
            "motor_force_n": force + noise[0],
            "pressure_a_pa": 101325.0 + gauges[0] + 200.0 * noise[1],
            "pressure_b_pa": 101325.0 + gauges[1] + 200.0 * noise[2],
        }
    )


def pulled_campaign(folder: Path, change: Change, *, orientation: str = "horizontal") -> Campaign:
    """Four logs, of which `change` is made to the third."""
    (folder / "rig.toml").write_text(PULLED.format(orientation=orientation))
    entries = ['rig = "rig.toml"\n']
    for place, gauges in enumerate(GAUGES, start=1):
        frame = pulled(gauges, place)
        if orientation == "vertical":
            frame["motor_force_n"] += 3.0 * 9.81
        frame = change(frame) if place == 3 else frame
        frame.to_csv(folder / f"run_{place}.csv", index=False)
        entries.append(f'[[log]]\nkind = "friction-motion"\nfile = "run_{place}.csv"\n')
    (folder / "campaign.toml").write_text("\n".join(entries))
    return read_campaign(folder / "campaign.toml")


def test_chambers_exchanged_in_one_log_of_a_pulled_cylinder_are_named(tmp_path: Path) -> None:
    (line,) = check_consistency(pulled_campaign(tmp_path, swapped))
    assert re.search(r"^run_3.*horizontal rig.*chambers exchanged.*are swapped in this log", line)


@pytest.mark.parametrize("orientation", ["horizontal", "vertical"])
def test_a_load_cell_that_was_not_zeroed_is_named(orientation: str, tmp_path: Path) -> None:
    tared = scaled("motor_force_n", 1.0, 150.0)
    (line,) = check_consistency(pulled_campaign(tmp_path, tared, orientation=orientation))
    assert re.search(r"^run_3.*steady 150 N.*the zero of motor_force_n", line)


@pytest.mark.parametrize("orientation", ["horizontal", "vertical"])
def test_steady_pressures_alone_contradict_nothing(orientation: str, tmp_path: Path) -> None:
    assert check_consistency(pulled_campaign(tmp_path, lambda f: f, orientation=orientation)) == ()


def test_logs_under_each_others_kind_are_told(tmp_path: Path) -> None:
    """Both friction kinds exchanged, and a log without the command of its kind."""
    entries = ['rig = "rig.toml"\n']
    kinds = {
        "friction_static.parquet": "friction-sliding",
        "friction_sliding.parquet": "friction-static",
        "motion_motor.parquet": "motion-pwm",
    }
    for name in ("rig.toml", *kinds):
        (tmp_path / name).write_bytes((BUNDLED / name).read_bytes())
    entries += [f'[[log]]\nkind = "{kind}"\nfile = "{file}"\n' for file, kind in kinds.items()]
    (tmp_path / "campaign.toml").write_text("\n".join(entries))
    campaign = read_campaign(tmp_path / "campaign.toml")
    said = {
        entry.file: other_kind(campaign.read(entry).trials, entry.kind, entry.file, campaign.rig)
        for entry in campaign.logs
    }
    assert "that is friction-static" in str(said["friction_static.parquet"])
    assert "that is friction-sliding" in str(said["friction_sliding.parquet"])
    assert "none of its tests commands duty_a or duty_b" in str(said["motion_motor.parquet"])
    lines = check_consistency(campaign)
    assert {line for line in said.values() if line} <= set(lines)


@pytest.mark.parametrize("slowness", [0.01, 1.0, 100.0])
def test_a_chamber_is_filled_where_neither_pressure_nor_piston_moves_at_any_pace(
    campaign: Campaign, slowness: float
) -> None:
    time = slowness * np.linspace(0.0, 8.0, 801)
    turns = time / slowness
    on = (turns >= 1.0) & (turns < 5.0)
    rig = campaign.rig

    def found(pressure: np.ndarray, angle: np.ndarray) -> list[float]:
        channels = {"valve_a": on.astype(float), "pressure_a_pa": pressure, "theta_rad": angle}
        return filled_pressures([Trial("1", time, channels, "slow.csv")], "a", rig)

    def rising(share: float) -> np.ndarray:
        """Exponentially to 300 kPa, with a time constant of that share of the time it is on."""
        return 1e5 + 2e5 * (1.0 - np.exp(-np.clip(turns - 1.0, 0.0, None) / (4.0 * share)))

    still = np.zeros(len(time))
    assert found(rising(0.05), still) == pytest.approx([3e5], rel=1e-3)
    assert found(rising(0.5), still) == []  # it is filled to 270 kPa by then
    # Held at what moves the piston, below the supply.
    assert found(rising(0.05), 0.1 * np.clip(turns - 1.0, 0.0, 4.0)) == []


@pytest.mark.parametrize("delay", [0.0, 0.002, 0.05])
def test_a_valve_s_delay_is_no_part_of_its_filling_flow(campaign: Campaign, delay: float) -> None:
    rig = campaign.rig
    cylinder, air = rig.require("cylinder", ""), rig.require("air", "")
    time = 0.001 * np.arange(1000)
    entered = 1e-4 * np.clip(time - 0.2 - delay, 0.0, None)
    volume = cylinder.offset_a_m * cylinder.area_a_m2
    per_mass = air.heat_capacity_ratio * air.gas_constant_j_per_kg_k * air.temperature_k / volume
    channels = {
        "valve_a": (time >= 0.2).astype(float),
        "pressure_a_pa": air.atmospheric_pressure_pa + per_mass * entered,
        "theta_rad": np.zeros(len(time)),
    }
    (flow,) = filling_flows(Trial("1", time, channels, "slow.csv"), "a", rig)
    assert flow == pytest.approx(1e-4, rel=0.03)


@pytest.mark.parametrize("slowness", [0.01, 1.0, 100.0])
def test_a_chamber_that_empties_is_not_at_rest_at_any_pace(
    campaign: Campaign, slowness: float
) -> None:
    turns = np.linspace(0.0, 8.0, 8001)
    emptying = 1e5 + 2e5 * np.exp(-turns / 2.0)

    def found(pressure: np.ndarray) -> list[float]:
        channels = {
            "duty_a": np.zeros(8001),
            "pressure_a_pa": pressure,
            "theta_rad": np.zeros(8001),
        }
        trial = Trial("1", slowness * turns, channels, "slow.csv")
        return rest_pressures([trial], "a", campaign.rig)

    assert found(emptying) == []
    assert found(np.full(8001, 1e5)) == [1e5]
