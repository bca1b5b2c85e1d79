"""A map reads every format that `sysid convert` reads, as it would convert it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io
from friction_trials import UNWRITTEN
from golden_folder import BUNDLED

import sysid as si
from sysid.commands.app import main
from sysid.errors import InputError
from sysid.io.conversion import convert
from sysid.io.foreign_log import is_in_log_format
from sysid.io.logs import read_log
from sysid.io.own_kind import OwnKind, read_own_log
from sysid.io.rig import read_rig
from sysid.io.units import parse_map

RIG = read_rig(BUNDLED / "rig.toml")
P0_KPA = 100.2
LABELS = ("1", "2", "3")
MAPS = [
    "time_s=t:ms",
    "test=trial",
    "motor_torque_nm=M:mNm",
    "theta_rad=angle:deg",
    "pressure_a_pa=PA:kPa(g)",
    "pressure_b_pa=PB:kPa(g)",
]


@pytest.fixture(scope="module")
def lab() -> pd.DataFrame:
    """Three constant-torque trials in a lab's own names and units."""
    log = pd.read_parquet(BUNDLED / "friction_sliding.parquet")
    log = log[log.test.astype(str).isin(LABELS)]
    return pd.DataFrame(
        {
            "t": np.round(1e3 * log.time_s, 6),
            "trial": log.test.astype(int),
            "M": np.round(1e3 * RIG.effort_per_volt * log.motor_volts, 6)
            if "motor_volts" in log
            else np.round(1e3 * log.motor_torque_nm, 6),
            "angle": np.round(np.rad2deg(log.theta_rad), 6),
            "PA": np.round(1e-3 * log.pressure_a_pa - P0_KPA, 6),
            "PB": np.round(1e-3 * log.pressure_b_pa - P0_KPA, 6),
        }
    ).reset_index(drop=True)


def mat(frame: pd.DataFrame, path: Path) -> None:
    scipy.io.savemat(path, {name: frame[name].to_numpy() for name in frame})


def hdf5(frame: pd.DataFrame, path: Path) -> None:
    with h5py.File(path, "w") as file:
        for name in frame:
            file[name] = frame[name].to_numpy()


def german(frame: pd.DataFrame, path: Path) -> None:
    text = frame.to_csv(index=False, sep=";", decimal=",")
    path.write_text(text.replace("angle", "Winkel_°"), encoding="cp1252")


def units_row(frame: pd.DataFrame, path: Path) -> None:
    head, *rows = frame.to_csv(index=False).splitlines()
    path.write_text("\n".join([head, "ms,-,mNm,deg,kPa,kPa", *rows]) + "\n")


def utf_16(frame: pd.DataFrame, path: Path) -> None:
    path.write_text(frame.to_csv(index=False, sep="\t"), encoding="utf-16")


def xlsx(frame: pd.DataFrame, path: Path) -> None:
    frame.groupby("trial").head(400).to_excel(path, index=False)


FORMATS: dict[str, Callable[[pd.DataFrame, Path], None]] = {
    "run.mat": mat,
    "run.h5": hdf5,
    "german.csv": german,
    "units.csv": units_row,
    "utf16.txt": utf_16,
    "run.xlsx": xlsx,
}


@pytest.mark.parametrize("name", FORMATS)
def test_a_mapped_file_is_the_log_that_convert_writes(
    name: str, lab: pd.DataFrame, tmp_path: Path
) -> None:
    FORMATS[name](lab, tmp_path / name)
    given = [one.replace("=angle", "=#4") for one in MAPS]
    maps = parse_map(given)
    assert not is_in_log_format(tmp_path / name, maps, ("time_s",))
    convert(
        [tmp_path / name],
        tmp_path / "log.csv",
        maps=given,
        atmosphere_pa=RIG.atmosphere_pa,
    )
    wanted = read_log(tmp_path / "log.csv", RIG)
    found = read_log(tmp_path / name, RIG, maps)
    assert [t.label for t in found.trials] == list(LABELS)
    for one, other in zip(found.trials, wanted.trials, strict=True):
        np.testing.assert_array_equal(one.time, other.time)
        assert set(one.channels) == set(other.channels)
        for channel in one.channels:
            np.testing.assert_array_equal(one[channel], other[channel])
    assert len(found.sha256) == 64 and found.sha256 != wanted.sha256


def test_an_ordinary_log_with_maps_keeps_its_reader(lab: pd.DataFrame, tmp_path: Path) -> None:
    lab.to_csv(tmp_path / "run.csv", index=False)
    assert is_in_log_format(tmp_path / "run.csv", parse_map(MAPS), ("time_s",))
    text = (tmp_path / "run.csv").read_text().splitlines()
    text[50] = text[50].replace(",", ";", 1)
    (tmp_path / "run.csv").write_text("\n".join(text) + "\n")
    with pytest.raises(InputError, match="line 51"):
        read_log(tmp_path / "run.csv", RIG, parse_map(MAPS))


def test_without_a_map_it_is_converted_first(lab: pd.DataFrame, tmp_path: Path) -> None:
    mat(lab, tmp_path / "run.mat")
    with pytest.raises(InputError, match=r"is a MATLAB file, not a log; convert it first"):
        read_log(tmp_path / "run.mat", RIG)


@pytest.mark.parametrize(
    ("maps", "said"),
    [
        (["time_s=t:ms", "theta_rad=angel:deg"], "has no column 'angel' .*did you mean angle"),
        (["theta_rad=angle:deg"], r"time_s is not mapped.*options of `sysid convert`: convert it"),
    ],
)
def test_maps_that_do_not_fit(
    maps: list[str], said: str, lab: pd.DataFrame, tmp_path: Path
) -> None:
    mat(lab, tmp_path / "run.mat")
    with pytest.raises(InputError, match=said):
        read_log(tmp_path / "run.mat", RIG, parse_map(maps))


def test_what_is_not_mapped_is_said(lab: pd.DataFrame, tmp_path: Path) -> None:
    mat(lab.assign(extra=1.0), tmp_path / "run.mat")
    log = read_log(tmp_path / "run.mat", RIG, parse_map(MAPS))
    assert any(line.endswith("run.mat: ignored, unknown: extra") for line in log.notices)


def test_tests_and_spans_of_it_are_excluded(lab: pd.DataFrame, tmp_path: Path) -> None:
    """By the labels that the map gives, though the span holds no plausible value."""
    lab = lab.copy()
    lab.loc[(lab.trial == 2) & (lab.t < 100.0), "PA"] = 1e9
    mat(lab, tmp_path / "run.mat")
    (tmp_path / "rig.toml").write_text((BUNDLED / "rig.toml").read_text())
    with pytest.raises(InputError, match="pressure_a_pa"):
        si.read_log(tmp_path / "run.mat", maps=MAPS)
    log = si.read_log(tmp_path / "run.mat", maps=MAPS, exclude=["1", "2@:0.1", "3@0.5:0.6"])
    assert [t.label for t in log.trials] == ["2", "3 to 0.5 s", "3 from 0.6 s"]


def test_commands(
    lab: pd.DataFrame,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    mat(lab, tmp_path / "run.mat")
    (tmp_path / "rig.toml").write_text((BUNDLED / "rig.toml").read_text())
    given = [word for one in MAPS for word in ("--map", one)]
    assert main(["check", "run.mat", *given, "--json"]) == 0
    (content,) = json.loads(capsys.readouterr().out)["logs"]
    assert (content["tests"], content["rows"]) == (3, len(lab))
    assert main(["fit", "friction", "run.mat", *given, *UNWRITTEN]) in (0, 3)
    assert "sliding" in "".join(capsys.readouterr())


def test_a_campaign_maps_every_format(
    lab: pd.DataFrame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The shared map serves a .mat and a CSV of the same names alike."""
    monkeypatch.chdir(tmp_path)
    mat(lab, tmp_path / "run.mat")
    lab.to_csv(tmp_path / "run.csv", index=False)
    (tmp_path / "rig.toml").write_text((BUNDLED / "rig.toml").read_text())
    entries = "\n".join(f'{m.partition("=")[0]} = "{m.partition("=")[2]}"' for m in MAPS)
    head = '[[log]]\nkind = "friction-sliding"\n'
    logs = "".join(f'{head}file = "run.{end}"\n' for end in ("mat", "csv"))
    (tmp_path / "campaign.toml").write_text(f'rig = "rig.toml"\n[map]\n{entries}\n{logs}')
    campaign = si.read_campaign("campaign.toml")
    one, other = (campaign.read(entry) for entry in campaign.logs)
    for a, b in zip(one.trials, other.trials, strict=True):
        np.testing.assert_allclose(a["pressure_a_pa"], b["pressure_a_pa"], rtol=1e-15)
        np.testing.assert_array_equal(a.time, b.time)
    assert len(campaign.excluding(["run.mat/2"]).read(campaign.logs[0]).trials) == 3
    less = campaign.excluding(["run.mat/2"])
    assert [len(less.read(entry).trials) for entry in less.logs] == [2, 3]


def test_a_component_of_ones_own(lab: pd.DataFrame, tmp_path: Path) -> None:
    mat(lab, tmp_path / "run.mat")
    own = OwnKind("pump", {"pressure_pa": "Pa", "speed": ""})
    units = {"time_s": "s", "test": None, **own.columns}
    from sysid.io.units import parse_map_table

    table = {"time_s": "t:ms", "test": "trial", "pressure_pa": "PA:kPa(g)", "speed": "M"}
    maps = parse_map_table(table, "campaign.toml", units)
    log = read_own_log(tmp_path / "run.mat", RIG, own, maps)
    assert [t.label for t in log.trials] == list(LABELS)
    np.testing.assert_allclose(
        np.concatenate([t["pressure_pa"] for t in log.trials]), 1e3 * lab.PA + RIG.atmosphere_pa
    )
