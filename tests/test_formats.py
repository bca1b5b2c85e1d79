"""Formats of laboratories' loggers, written by each format's own library."""

from __future__ import annotations

import json
import random
import sys
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from foreign_files import (
    ANGLE_DEG,
    ATMOSPHERE,
    PRESSURE_KPA,
    SAMPLES,
    TIME,
    expect_samples,
    log_of,
    maps,
    refused,
    write_tdms,
)
from golden_folder import BUNDLED
from logger_files import (
    DELAY_NS,
    NS,
    SLOW,
    STARTED_NS,
    write_bag1,
    write_bag2,
    write_mcap,
    write_mdf,
    write_ulog,
)
from mcap.writer import CompressionType
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import savemat

from sysid.commands.app import main
from sysid.errors import InputError
from sysid.io.campaign import read_campaign
from sysid.io.conversion import convert
from sysid.io.foreign import ForeignTable, ReadOptions, read_any
from sysid.io.logs import read_log


def table_of(path: Path) -> ForeignTable:
    return read_any(path, "a file", ReadOptions()).table


def without_time(pressure: str, angle: str) -> list[str]:
    return maps("t", pressure, angle)[1:]


def expect_clock(found: ForeignTable, name: str, times: Any, tolerance: float = 1e-12) -> None:
    assert len(found.columns[name]) == len(times)
    assert_allclose(found.clocks[name], times, rtol=0, atol=tolerance)


# --- MDF ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("version", "compression", "options"),
    [
        ("3.30", 0, {}),
        ("4.10", 0, {}),
        ("4.10", 1, {}),
        ("4.20", 2, {}),
        ("4.20", 2, {"column_storage": True}),
    ],
)
def test_mdf(tmp_path: Path, version: str, compression: int, options: dict[str, Any]) -> None:
    path = write_mdf(tmp_path / "rec", version, compression, **options)
    found = table_of(path)
    assert found.format == f"MDF {version}"
    assert set(found.columns) >= {"P1", "fast/phi", "slow/phi", "state", "fast/time", "slow/time"}
    assert found.units["P1"] == "kPa" and found.units["slow/phi"] == "deg"
    assert "state" not in found.units and found.skipped["word"] == "text"
    assert_allclose(found.columns["P1"], np.round(PRESSURE_KPA * 128) / 128)
    assert_array_equal(found.columns["state"], np.arange(len(SLOW)) % 2)
    assert_allclose(found.columns["slow/phi"], ANGLE_DEG[::5] * 2)
    expect_clock(found, "P1", TIME)
    expect_clock(found, "slow/phi", SLOW)
    assert (found.origin is None) == (version == "3.30")


def test_channels_of_one_clock_need_no_time(tmp_path: Path) -> None:
    path, out = write_mdf(tmp_path / "rec", "4.10"), tmp_path / "log.csv"
    report = convert(path, out, maps=without_time("P1", "fast/phi"), atmosphere_pa=ATMOSPHERE)
    log = log_of(out)
    assert_allclose(log["time_s"], TIME, atol=1e-15)
    assert_allclose(log["theta_rad"], np.deg2rad(ANGLE_DEG))
    assert any("time follows from the file's own times" in notice for notice in report.notices)


def test_mdf_samples_marked_invalid_are_left_out(tmp_path: Path) -> None:
    from asammdf import MDF, Signal

    invalid = np.zeros(SAMPLES, dtype=bool)
    invalid[[3, 4]] = True
    marked = Signal(ANGLE_DEG, TIME, name="phi", invalidation_bits=invalid)
    file = MDF(version="4.10")
    file.append([marked, Signal(PRESSURE_KPA, TIME, name="P1")])
    found = table_of(Path(file.save(tmp_path / "rec", overwrite=True)))
    assert_array_equal(found.columns["phi"], ANGLE_DEG[~invalid])
    expect_clock(found, "phi", TIME[~invalid])
    assert len(found.columns["P1"]) == SAMPLES
    assert any("invalid are omitted: 2 of phi" in notice for notice in found.notices)


# --- MCAP ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("compression", "chunked"),
    [
        (CompressionType.ZSTD, True),
        (CompressionType.LZ4, True),
        (CompressionType.NONE, True),
        (CompressionType.NONE, False),
    ],
)
def test_mcap_of_json(tmp_path: Path, compression: CompressionType, chunked: bool) -> None:
    path = tmp_path / "rec.mcap"
    write_mcap(path, compression, chunked)
    found = table_of(path)
    assert_array_equal(found.columns["/chamber.sensor.kpa"], PRESSURE_KPA)
    assert_array_equal(found.columns["/chamber.sensor.raw[1]"], 2 * np.arange(SAMPLES))
    assert_array_equal(found.columns["/chamber.is_open"], np.arange(SAMPLES) % 2 == 0)
    assert found.skipped["/chamber.header.frame_id"] == "text"
    expect_clock(found, "/chamber.once", [0.0])
    expect_clock(found, "/chamber.sensor.kpa", TIME)
    expect_clock(found, "/angle.deg", TIME + DELAY_NS / NS)
    assert found.origin == pd.Timestamp(STARTED_NS, unit="ns", tz="UTC")
    assert any("header.stamp: /chamber" in notice for notice in found.notices)
    assert any("time of logging" in n and n.endswith(": /angle") for n in found.notices)


def test_a_stamp_may_be_mapped_as_the_time(tmp_path: Path) -> None:
    path, out = tmp_path / "rec.mcap", tmp_path / "log.csv"
    write_mcap(path)
    entries = ["time_s=/chamber.header.stamp", "pressure_a_pa=/chamber.sensor.kpa:kPa"]
    convert(path, out, maps=entries)
    assert_allclose(log_of(out)["time_s"], TIME, atol=1e-12)


@pytest.mark.parametrize(
    ("stamp", "what", "clock"),
    [
        (lambda ns: 0, "header.stamp is not set", TIME),
        (lambda ns: 2 * STARTED_NS - ns, "header.stamp goes back", TIME),
        (lambda ns: ns - STARTED_NS, "header.stamp counts on another clock", TIME),
    ],
)
def test_stamps_that_are_no_clock(
    tmp_path: Path, stamp: Callable[[int], int], what: str, clock: Any
) -> None:
    path = tmp_path / "rec.mcap"
    write_mcap(path, stamp=stamp)
    found = table_of(path)
    expect_clock(found, "/chamber.sensor.kpa", clock)
    assert any(what in notice and notice.endswith(": /chamber") for notice in found.notices)


def test_an_mcap_file_that_was_cut_off_is_read_up_to_there(tmp_path: Path) -> None:
    path = tmp_path / "rec.mcap"
    write_mcap(path)
    raw = path.read_bytes()
    path.write_bytes(raw[: len(raw) // 2])
    found = table_of(path)
    read = len(found.columns["/angle.deg"])
    assert 0 < read < SAMPLES
    assert_array_equal(found.columns["/angle.deg"], ANGLE_DEG[:read])
    assert any("it was cut off" in notice for notice in found.notices)
    path.write_bytes(raw[:60])
    refused(path, tmp_path / "log.csv", "ends before its first message.*mcap recover")


def test_an_mcap_file_that_is_damaged_is_not_read_in_part(tmp_path: Path) -> None:
    path = tmp_path / "rec.mcap"
    write_mcap(path, CompressionType.NONE)
    raw = bytearray(path.read_bytes())
    raw[len(raw) // 2] ^= 1
    path.write_bytes(raw)
    refused(path, tmp_path / "log.csv", "check sum is wrong.*mcap recover")


def test_messages_that_are_not_decoded_say_why(tmp_path: Path) -> None:
    from mcap.writer import Writer

    path = tmp_path / "rec.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("S", "cddl", b"")
        channel = writer.register_channel("/p", "cbor", schema)
        writer.add_message(channel, 1, b"\x01", 1)
        writer.finish()
    refused(path, tmp_path / "log.csv", "holds no numbers: /p: .*encoded as 'cbor'")


def test_protobuf_without_its_library_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mcap.writer import Writer

    path = tmp_path / "rec.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("lab.Gauge", "protobuf", b"")
        channel = writer.register_channel("/p", "protobuf", schema)
        writer.add_message(channel, 1, b"", 1)
        writer.finish()
    monkeypatch.setitem(sys.modules, "google", None)
    monkeypatch.delitem(sys.modules, "google.protobuf", raising=False)
    refused(path, tmp_path / "log.csv", r"/p: its messages are protobuf \(pip install protobuf\)")


# --- ROS bags -----------------------------------------------------------------------------------


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
@pytest.mark.parametrize("mode", [None, "file", "message"])
def test_ros_2_bag(tmp_path: Path, storage: str, mode: str | None) -> None:
    if (storage, mode) == ("mcap", "message"):
        pytest.skip("rosbag2 packs chunks of MCAP, not messages")
    folder, out = tmp_path / "bag", tmp_path / "log.csv"
    write_bag2(folder, storage, mode)
    found = table_of(folder)
    assert found.format == "ROS 2 bag"
    assert_array_equal(found.columns["/joint_states.position[0]"], ANGLE_DEG)
    assert_array_equal(found.columns["/joint_states.position[elbow]"], ANGLE_DEG)
    assert_array_equal(found.columns["/joint_states.position[wrist]"], np.full(SAMPLES, -1.0))
    assert found.skipped["/joint_states.velocity"] == "empty"
    expect_clock(found, "/p1.fluid_pressure", TIME)
    expect_clock(found, "/duty.data", TIME + DELAY_NS / NS)
    entries = without_time("/p1.fluid_pressure", "/joint_states.position[elbow]")
    report = convert(folder, out, maps=entries, atmosphere_pa=ATMOSPHERE)
    expect_samples(out)
    assert len(report.sources[0].sha256) == 64


def test_a_bag_s_folder_is_a_log_with_a_map(tmp_path: Path) -> None:
    """As `convert` would write it, in a campaign too; its digest is that of its files."""
    folder, out = tmp_path / "bag", tmp_path / "log.csv"
    write_bag2(folder, "sqlite3")
    entries = without_time("/p1.fluid_pressure", "/joint_states.position[elbow]")
    convert(folder, out, maps=entries, atmosphere_pa=ATMOSPHERE)
    rig_file = (BUNDLED / "rig.toml").read_text()
    (tmp_path / "rig.toml").write_text(rig_file)
    maps = "\n".join(f'{t} = "{c}"' for t, c in (entry.split("=", 1) for entry in entries))
    (tmp_path / "campaign.toml").write_text(
        f'rig = "rig.toml"\n[[log]]\nkind = "valve-discrete"\nfile = "bag"\n[map]\n{maps}\n'
    )
    campaign = read_campaign(tmp_path / "campaign.toml")
    ambient = campaign.rig.atmosphere_pa
    assert ambient is not None
    (trial,), (other,) = (
        campaign.read(campaign.logs[0]).trials,
        read_log(out, campaign.rig).trials,
    )
    assert_array_equal(trial["theta_rad"], other["theta_rad"])
    assert trial["pressure_a_pa"] - ambient == pytest.approx(other["pressure_a_pa"] - ATMOSPHERE)
    assert len(campaign.sources()[0].sha256) == 64
    with pytest.raises(InputError, match=r"is a ROS 2 bag, not a log; convert it first"):
        read_log(folder, campaign.rig)


def test_a_file_of_packed_messages_alone(tmp_path: Path) -> None:
    write_bag2(tmp_path / "bag", "sqlite3", "message")
    (file,) = (tmp_path / "bag").glob("*.db3")
    assert_array_equal(table_of(file).columns["/p1.fluid_pressure"], PRESSURE_KPA)


def test_joints_that_change_their_order_are_known_by_their_names(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    write_bag2(folder, "mcap", turned=True)
    found = table_of(folder)
    assert_array_equal(found.columns["/joint_states.position[elbow]"], ANGLE_DEG)
    assert "/joint_states.position[0]" not in found.columns
    assert "map one by its name" in found.skipped["/joint_states.position"]


def test_a_file_of_a_ros_2_bag_alone(tmp_path: Path) -> None:
    write_bag2(tmp_path / "bag", "sqlite3")
    folder = (tmp_path / "bag").rename(tmp_path / "bag #1? 100%")
    (file,) = folder.glob("*.db3")
    assert_array_equal(table_of(file).columns["/p1.fluid_pressure"], PRESSURE_KPA)
    (folder / "metadata.yaml").unlink()
    found = table_of(folder)
    assert_array_equal(found.columns["/p1.fluid_pressure"], PRESSURE_KPA)
    assert any("no metadata.yaml" in notice for notice in found.notices)


def test_types_of_an_older_bag_are_ros_own(tmp_path: Path) -> None:
    """Before version 8 a bag of SQLite did not define its messages' types."""
    import sqlite3

    folder = tmp_path / "bag"
    write_bag2(folder, "sqlite3")
    (file,) = folder.glob("*.db3")
    with sqlite3.connect(file) as opened:
        opened.executescript(
            "DROP TABLE message_definitions; DROP TABLE schema; DROP TABLE metadata;"
        )
    found = table_of(file)
    assert_array_equal(found.columns["/p1.fluid_pressure"], PRESSURE_KPA)
    with sqlite3.connect(file) as opened:
        opened.execute("UPDATE topics SET type = 'lab_msgs/msg/Gauge' WHERE name = '/p1'")
    assert "does not define" in table_of(file).skipped["/p1"]
    with sqlite3.connect(file) as opened:
        opened.execute("UPDATE topics SET type = 'std_msgs/msg/Float64' WHERE name = '/p1'")
    found = table_of(file)
    assert "do not fit" in found.skipped["/p1"]
    assert_array_equal(found.columns["/joint_states.position[0]"], ANGLE_DEG)


def test_folders_and_databases_that_are_no_bags(tmp_path: Path) -> None:
    import sqlite3

    refused(tmp_path, tmp_path / "log.csv", "is a directory")
    path = tmp_path / "some.db3"
    with sqlite3.connect(path) as opened:
        opened.execute("CREATE TABLE readings (t)")
    refused(path, tmp_path / "log.csv", "an SQLite file, not a ROS 2 bag")
    endless = (
        "CREATE TABLE topics (id, name, type, serialization_format, offered_qos_profiles);"
        "CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n)"
        " SELECT id, 1 AS topic_id, id AS timestamp, x'00' AS data FROM n;"
    )
    with sqlite3.connect(path) as opened:
        opened.executescript(endless)
    refused(path, tmp_path / "log.csv", "messages are computed, not stored")
    folder = tmp_path / "bag"
    write_bag2(folder, "sqlite3")
    next(folder.glob("*.db3")).unlink()
    refused(folder, tmp_path / "log.csv", r"bag.db3 is missing")


@pytest.mark.parametrize("packed", [None, "bz2", "lz4"])
def test_ros_1_bag(tmp_path: Path, packed: str | None) -> None:
    path, out = tmp_path / "rec.bag", tmp_path / "log.csv"
    write_bag1(path, packed)
    entries = without_time("/p1.fluid_pressure", "/joint_states.position[0]")
    report = convert(path, out, maps=entries, atmosphere_pa=ATMOSPHERE)
    expect_samples(out)
    assert report.sources[0].format == "ROS 1 bag"


def test_a_ros_1_bag_without_its_index(tmp_path: Path) -> None:
    path = tmp_path / "rec.bag"
    write_bag1(path)
    raw = bytearray(path.read_bytes())
    place = raw.index(b"index_pos=") + len(b"index_pos=")
    raw[place : place + 8] = bytes(8)
    path.write_bytes(raw)
    refused(path, tmp_path / "log.csv", "has no index .*rosbag reindex rec.bag")


def test_a_definition_is_not_run() -> None:
    """rosbags makes Python of a definition: its names must be names."""
    from sysid.io.foreign.ros_types import ros_decoder

    for name, text in (
        ("a/msg/B", "float64 x\n===\nMSG: c/D\nfloat64 x"),
        ("a/msg/B:\n    x = print(1)\nclass C", "float64 x"),
        ("a/msg/B", "float64 x'); print(1); ('"),
    ):
        with pytest.raises(Exception) as caught:
            ros_decoder(name, text, "ros2msg", is_cdr=True)(b"\0\1\0\0")
        assert not isinstance(caught.value, SyntaxError | NameError)


# --- ULog ---------------------------------------------------------------------------------------


def test_ulog(tmp_path: Path) -> None:
    path, out = tmp_path / "rec.ulg", tmp_path / "log.csv"
    write_ulog(path)
    found = table_of(path)
    assert_array_equal(found.columns["chamber.kpa"], PRESSURE_KPA)
    assert_array_equal(found.columns["chamber[1].kpa"], 2 * PRESSURE_KPA)
    assert_array_equal(found.columns["chamber.raw.step[1]"], -np.arange(SAMPLES))
    assert found.skipped["chamber.tag[0]"] == "text"
    assert found.units["chamber.timestamp"] == "us"
    expect_clock(found, "chamber.kpa", TIME)
    expect_clock(found, "chamber[1].kpa", TIME + 2e-4)
    convert(path, out, maps=without_time("chamber.kpa", "chamber.deg"), atmosphere_pa=ATMOSPHERE)
    expect_samples(out)


def test_ulog_cut_off(tmp_path: Path) -> None:
    path = tmp_path / "rec.ulg"
    write_ulog(path)
    whole, content = table_of(path), path.read_bytes()
    assert not any("cut off" in notice for notice in whole.notices)
    for end in (len(content) - 1, 3 * len(content) // 4, 3 * len(content) // 4 + 1):
        path.write_bytes(content[:end])
        found = table_of(path)
        rows = max(map(len, found.columns.values()))
        assert rows <= max(map(len, whole.columns.values()))
        line = f"ends within a message: the recording was cut off after {rows} rows"
        assert any(line in notice for notice in found.notices)


def test_ulog_without_timestamps_and_with_too_many_fields(tmp_path: Path) -> None:
    path = tmp_path / "rec.ulg"
    write_ulog(path)
    raw = path.read_bytes()
    first = (2_000_000).to_bytes(8, "little")
    at = raw.index(first, 20)
    path.write_bytes(raw[:at] + bytes(8) + raw[at + 8 :])
    found = table_of(path)
    assert len(found.columns["chamber.kpa"]) == SAMPLES - 1
    assert any("1 messages have no timestamp" in notice for notice in found.notices)
    write_ulog(path, "uint64_t timestamp;Raw[65535] raw;")
    refused(path, tmp_path / "log.csv", "more than 100,000 columns")
    write_ulog(path, "uint64_t timestamp;chamber again;")
    refused(path, tmp_path / "log.csv", "nested too deep")


# --- numpy --------------------------------------------------------------------------------------


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_npz(tmp_path: Path, save: Any) -> None:
    path, out = tmp_path / "rec.npz", tmp_path / "log.csv"
    fields = np.zeros(SAMPLES, dtype=[("deg", "f8"), ("raw", "i2", (2,))])
    fields["deg"] = ANGLE_DEG
    both = np.column_stack([TIME, PRESSURE_KPA])
    save(path, both=both, rec=fields, odd=np.array([1, "a"], dtype=object))
    found = table_of(path)
    assert set(found.columns) == {"both#1", "both#2", "rec.deg", "rec.raw#1", "rec.raw#2"}
    assert "may run code" in found.skipped["odd"]
    convert(path, out, maps=maps("both#1", "both#2", "rec.deg"), atmosphere_pa=ATMOSPHERE)
    expect_samples(out)


def test_npy(tmp_path: Path) -> None:
    path, out = tmp_path / "rec.npy", tmp_path / "log.csv"
    np.save(path, np.asfortranarray(np.vstack([TIME, PRESSURE_KPA, ANGLE_DEG])))
    convert(path, out, maps=maps("#1", "#2", "#3"), atmosphere_pa=ATMOSPHERE)
    expect_samples(out)
    rows = np.zeros(SAMPLES, dtype=[("t", "f8"), ("kpa", "f8"), ("deg", "f8")])
    rows["t"], rows["kpa"], rows["deg"] = TIME, PRESSURE_KPA, ANGLE_DEG
    np.save(path, rows)
    convert(path, out, maps=maps("t", "kpa", "deg"), atmosphere_pa=ATMOSPHERE)
    expect_samples(out)
    path.write_bytes(path.read_bytes()[:-9])
    out.unlink()
    refused(path, out, "damaged or not a numpy file")


def test_a_numpy_archive_is_no_workbook(tmp_path: Path) -> None:
    path = tmp_path / "rec.npz"
    np.savez(path, t=TIME)
    path.write_bytes(path.read_bytes()[:-40])
    refused(path, tmp_path / "log.csv", "damaged or not a NumPy archive")
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("note.txt", "nothing")
    refused(path, tmp_path / "log.csv", "holds no columns")


# --- JSON ---------------------------------------------------------------------------------------

ROWS = [
    {"t": t, "kpa": p, "deg": a}
    for t, p, a in zip(TIME.tolist(), PRESSURE_KPA.tolist(), ANGLE_DEG.tolist(), strict=True)
]
ARRAYS = {"t": TIME.tolist(), "kpa": PRESSURE_KPA.tolist(), "deg": ANGLE_DEG.tolist()}
FRAME = pd.DataFrame(ARRAYS)
CELLS = [[row["t"], row["kpa"], row["deg"]] for row in ROWS]
TEXTS = {
    "arrays": (json.dumps(ARRAYS), "t kpa deg"),
    "objects": (json.dumps(ROWS, indent=1), "t kpa deg"),
    "nested": (json.dumps([{"t": r["t"], "s": {"p": r["kpa"], "a": [r["deg"]]}} for r in ROWS]),
               "t s.p s.a[0]"),
    "within": (json.dumps({"rig": "3", "data": ARRAYS}), "t kpa deg"),
    "within, whole": (json.dumps({"rig": "3", "data": ARRAYS}), "data.t data.kpa data.deg"),
    "within, rows": (json.dumps({"rig": "3", "rows": ROWS}), "rows.t rows.kpa rows.deg"),
    "split": (json.dumps({"columns": ["t", "kpa", "deg"], "data": CELLS}), "t kpa deg"),
    "pandas": (FRAME.to_json(double_precision=15), "t kpa deg"),
    "pandas, split": (FRAME.to_json(orient="split", double_precision=15), "t kpa deg"),
    "pandas, index": (FRAME.to_json(orient="index", double_precision=15), "t kpa deg"),
    "pandas, table": (FRAME.to_json(orient="table", double_precision=15), "t kpa deg"),
    "rows": (json.dumps(CELLS), "#1 #2 #3"),
    "rows under names": (json.dumps([["t", "kpa", "deg"], *CELLS]), "t kpa deg"),
    "lines": ("\n".join(json.dumps(row) for row in ROWS) + "\n", "t kpa deg"),
    "lines of rows": ("\r\n".join(json.dumps(row) for row in CELLS), "#1 #2 #3"),
}  # fmt: skip


@pytest.mark.parametrize("layout", TEXTS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
def test_json(tmp_path: Path, layout: str, encoding: str) -> None:
    text, names = TEXTS[layout]
    path, out = tmp_path / "rec.json", tmp_path / "log.csv"
    path.write_text(text, encoding=encoding, newline="")
    convert(path, out, maps=maps(*names.split()), atmosphere_pa=ATMOSPHERE)
    log = log_of(out)
    assert_allclose(log["time_s"], TIME, rtol=1e-13, atol=1e-15)
    assert_allclose(log["pressure_a_pa"], PRESSURE_KPA * 1000 + ATMOSPHERE, rtol=1e-13)
    assert_allclose(log["theta_rad"], np.deg2rad(ANGLE_DEG), rtol=1e-12, atol=1e-14)


def test_json_units_and_stamps(tmp_path: Path) -> None:
    path, out = tmp_path / "rec.json", tmp_path / "log.csv"
    stamps = [f"2026-01-02T03:04:05.{i:03d}Z" for i in range(3)]
    signals = {"p": {"unit": "kPa", "values": [1, 2, 3]}, "at": stamps}
    path.write_text(json.dumps(signals))
    assert table_of(path).units == {"p.values": "kPa"}
    convert(path, out, maps=["time_s=at", "pressure_a_pa=p.values:kPa"])
    assert_allclose(log_of(out)["time_s"], [0, 0.001, 0.002], atol=1e-9)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ('[{"t": 0, "p": 1}, {"t": 1, "p": null}]', "row 2: column p .* is empty"),
        ('[{"t": 0, "p": 1}, {"t": 1}]', "row 2: column p .* is empty"),
        ('{"t": 0, "p": 1}\n{"t": 1, "p": null}\n', "line 2: column p .* is empty"),
        ('{"t": 0, "p": 1}\n{"t": 1, "p"', "line 2: cannot be read as JSON"),
        ('{"t": [0, 1],\n "p": [1, 2', "line 2: cannot be read as JSON"),
        ('{"t": [0], "p": [1], "t": [2]}', "the key 't' is given twice"),
        ('{"columns": ["t", "p"], "data": [[0, 1], [1]]}', "row 2: has 1 values where .* 2"),
        ('{"t": [0, 1], "p": [1]}', "differ in length"),
        ('{"note": "nothing"}', "holds no columns"),
        ("[" * 5000, "nested too deep"),
    ],
)
def test_json_that_is_refused(tmp_path: Path, text: str, what: str) -> None:
    path = tmp_path / "rec.json"
    path.write_text(text)
    entries = ["time_s=t", "pressure_a_pa=p:kPa"]
    refused(path, tmp_path / "log.csv", what, maps=entries)


def test_a_table_that_begins_with_a_bracket_is_no_json(tmp_path: Path) -> None:
    path, out = tmp_path / "rec.txt", tmp_path / "log.csv"
    path.write_text("[s],[kPa]\n0,1\n1,2\n")
    convert(path, out, maps=["time_s=[s]", "pressure_a_pa=[kPa]:kPa"])
    assert_array_equal(log_of(out)["pressure_a_pa"], [1000, 2000])


# --- MATLAB -------------------------------------------------------------------------------------


def mat_object(path: Path, name: str, kind: str) -> None:
    """A version 5 file that holds an object of MATLAB, by MathWorks' layout of its head."""

    def element(code: int, data: bytes) -> bytes:
        return np.array([code, len(data)], "<u4").tobytes() + data + bytes(-len(data) % 8)

    words = np.array([0xDD000000, 2, 1, 1, 1, 1], "<u4").tobytes()
    inner = element(6, np.array([13, 0], "<u4").tobytes())
    inner += element(5, np.array([6, 1], "<i4").tobytes()) + element(1, b"") + element(6, words)
    body = element(6, np.array([17, 0], "<u4").tobytes())
    for text in (name, "MCOS", kind):
        body += element(1, text.encode())
    body += element(14, inner)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    path.write_bytes(head + element(14, body))


@pytest.mark.parametrize(
    ("kind", "line"),
    [
        ("table", r's = table2struct\(run3, "ToScalar", true\)'),
        ("timetable", r"timetable2table\(run3"),
        ("timeseries", r"t = run3.Time; y = run3.Data"),
        ("Simulink.SimulationOutput", r"d = run3.logsout; t = d\{1\}.Values.Time"),
    ],
)
def test_matlab_objects_say_how_to_export_them(tmp_path: Path, kind: str, line: str) -> None:
    path, out = tmp_path / "rec.mat", tmp_path / "log.csv"
    mat_object(path, "run3", kind)
    refused(path, out, rf"holds one MATLAB {kind} \(run3\).*{line}.*rec_plain.mat")
    whole = path.read_bytes()
    savemat(path, {"t": TIME})
    path.write_bytes(path.read_bytes() + whole[128:])
    refused(path, out, rf"run3 \(mapped to time_s\) .* a MATLAB {kind}", maps=["time_s=run3.t"])
    said = rf"no column 'x' \(mapped to theta_rad\), but run3 is a MATLAB {kind}.* map one of t$"
    refused(path, out, said, maps=["time_s=t", "theta_rad=x"])
    with h5py.File(path, "w", userblock_size=512) as file:
        data = file.create_dataset("run3", data=np.zeros((1, 6), dtype=np.uint32))
        data.attrs["MATLAB_class"], data.attrs["MATLAB_object_decode"] = np.bytes_(kind), 3
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(508) + b"\x00\x02IM")
    refused(path, out, rf"holds one MATLAB {kind} \(run3\).*{line}")


def test_a_cell_of_texts_is_no_column(tmp_path: Path) -> None:
    path = tmp_path / "rec.mat"
    savemat(path, {"t": np.array([["0.0"], ["0.1"]], dtype=object), "q": [1.0, 2.0]})
    refused(path, tmp_path / "log.csv", r"t\{1\} \(mapped to time_s\) is not a column: text",
            maps=["time_s=t", "theta_rad=q"])  # fmt: skip


def test_a_table_within_a_struct_says_how_to_export_it(tmp_path: Path) -> None:
    path, out = tmp_path / "rec.mat", tmp_path / "log.csv"
    with h5py.File(path, "w") as file:
        data = file.create_group("run").create_dataset("T", data=np.zeros((1, 6), dtype=np.uint32))
        data.attrs["MATLAB_class"], data.attrs["MATLAB_object_decode"] = np.bytes_("table"), 3
    refused(path, out, r's = table2struct\(run.T, "ToScalar", true\)')


def test_simulink_structure_with_time(tmp_path: Path) -> None:
    path, out = tmp_path / "rec.mat", tmp_path / "log.csv"
    signals = np.zeros((1, 2), dtype=[("values", object), ("label", object)])
    for index, values in enumerate((PRESSURE_KPA, ANGLE_DEG)):
        signals[0, index]["values"], signals[0, index]["label"] = values[:, None], "s"
    savemat(path, {"out": {"time": TIME[:, None], "signals": signals, "blockName": "m/Scope"}})
    entries = maps("out.time", "out.signals(1).values", "out.signals(2).values")
    convert(path, out, maps=entries, atmosphere_pa=ATMOSPHERE)
    expect_samples(out)


# --- libraries, bounds, damage ------------------------------------------------------------------

WRITERS: dict[str, tuple[str, str, Callable[[Path], Any]]] = {
    "asammdf": ("rec.mf4", "an MDF4 file", lambda path: write_mdf(path, "4.10", 2)),
    "mcap": ("rec.mcap", "an MCAP file", write_mcap),
    "rosbags": ("rec.bag", "a ROS bag", write_bag1),
    "pyulog": ("rec.ulg", "a ULog file", write_ulog),
}


@pytest.mark.parametrize("library", WRITERS)
def test_a_library_that_is_not_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, library: str
) -> None:
    name, what, write = WRITERS[library]
    path = tmp_path / name
    write(path)
    for module in [m for m in sys.modules if m.partition(".")[0] == library]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setitem(sys.modules, library, None)
    refused(path, tmp_path / "log.csv", rf'is {what}, .*pip install "sysid\[formats\]"')


def packed_mcap(path: Path, says: int, holds: int) -> None:
    import zstandard
    from mcap.data_stream import RecordBuilder
    from mcap.records import Chunk, Header

    builder = RecordBuilder()
    builder.write(b"\x89MCAP0\r\n")
    Header("", "").write(builder)
    data = zstandard.compress(bytes(holds))
    Chunk("zstd", data, 0, 0, 0, says).write(builder)
    path.write_bytes(builder.end())


def large_mdf(path: Path, cycles: int) -> None:
    """A file whose first group says that it has so many samples."""
    write_mdf(path, "4.10")
    raw = bytearray(path.read_bytes())
    at = raw.index(b"##CG")
    links = int.from_bytes(raw[at + 16 : at + 24], "little")
    place = at + 24 + 8 * links + 8
    raw[place : place + 8] = cycles.to_bytes(8, "little")
    path.write_bytes(raw)


def npz_of(path: Path, shape: str) -> None:
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}}}".encode()
    with zipfile.ZipFile(path, "w") as archive:
        member = b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + bytes(80)
        archive.writestr("t.npy", member)


def ringed_mdf(path: Path) -> None:
    write_mdf(path, "4.10")
    raw = bytearray(path.read_bytes())
    at = raw.index(b"##DG")
    raw[at + 24 : at + 32] = at.to_bytes(8, "little")
    path.write_bytes(raw)


def bombed_bag(path: Path) -> None:
    import lz4.frame
    import rosbags.rosbag1.writer as writing

    class Packing:
        def __call__(self, data: bytes) -> bytes:
            return bytes(lz4.frame.compress(data + bytes(200_000_000)))

    writer = writing.Writer(path)
    writer.set_compression(writing.Writer.CompressionFormat.LZ4)
    writer.compressor = Packing()
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS1_NOETIC)
    kind = "std_msgs/msg/Float64"
    with writer:
        topic = writer.add_connection("/x", kind, typestore=types)
        writer.write(topic, 1, types.serialize_ros1(types.types[kind](data=1.0), kind))


@pytest.mark.parametrize(
    ("name", "make", "what"),
    [
        ("a.mcap", lambda p: packed_mcap(p, 1 << 40, 10), "a chunk unpacks to more than"),
        ("b.mcap", lambda p: packed_mcap(p, 1000, 1 << 28), "a chunk unpacks to more than"),
        ("a.mf4", lambda p: large_mdf(p, 1 << 40), "more than the 100,000,000 cells"),
        ("b.mf4", lambda p: large_mdf(p, 10_000), "fewer samples than it says"),
        ("c.mf4", ringed_mdf, "form a loop"),
        ("a.npz", lambda p: npz_of(p, "(1000000000,)"), "more than the 100,000,000 cells"),
        ("b.npz", lambda p: npz_of(p, "(1000,)"), "damaged or not a numpy file"),
        ("a.bag", bombed_bag, "a chunk unpacks to more than"),
        ("a.json", lambda p: p.write_text("[" + "0," * 21_000_000 + "0]"), "read from JSON"),
    ],
)
def test_files_that_ask_for_more_than_they_hold(
    tmp_path: Path, name: str, make: Callable[[Path], Any], what: str
) -> None:
    path = tmp_path / name
    make(path)
    refused(path, tmp_path / "log.csv", what)


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("healthy")
    for name, _, write in WRITERS.values():
        write(folder / name)
    write_mdf(folder / "old", "3.30")
    write_mcap(folder / "plain.mcap", CompressionType.NONE, chunked=False)
    write_bag2(folder / "bag", "sqlite3")
    (folder / "bag" / "bag.db3").rename(folder / "rec.db3")
    np.savez_compressed(folder / "rec.npz", t=TIME, p=PRESSURE_KPA)
    np.save(folder / "rec.npy", TIME)
    (folder / "rec.json").write_text(json.dumps(ROWS[:5]))
    return sorted(path for path in folder.iterdir() if path.is_file())


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("change", ["flip", "cut", "fill"])
def test_damage_is_one_line(
    tmp_path: Path, healthy: list[Path], change: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """Whatever is changed, a file is read or refused in one line; nothing else is printed."""
    rng = random.Random(3)
    assert len(healthy) == 10
    for path in healthy:
        whole = path.read_bytes()
        for _ in range(25):
            raw = bytearray(whole)
            at = rng.randrange(len(raw))
            if change == "flip":
                raw[at] ^= 1 << rng.randrange(8)
            elif change == "cut":
                del raw[max(at, 1) :]
            else:
                raw[at : at + 8] = b"\xff" * 8
            damaged = tmp_path / f"x{path.suffix}"
            damaged.write_bytes(raw)
            try:
                table_of(damaged)
            except InputError as error:
                assert "\n" not in str(error)
    assert capfd.readouterr() == ("", "")


# --- what a file holds --------------------------------------------------------------------------


def listed(path: Path, capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    """The JSON of `sysid convert PATH --list`."""
    assert main(["convert", str(path), "--list", "--json", *words]) == 0
    (found,) = json.loads(capsys.readouterr().out)["files"]
    assert found["path"] == str(path)
    return {channel["name"]: channel for channel in found["channels"]} | found["skipped"]


def test_list_of_every_format(
    tmp_path: Path, healthy: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    FRAME.to_parquet(tmp_path / "rec.parquet")
    FRAME.to_excel(tmp_path / "rec.xlsx", index=False)
    FRAME.to_csv(tmp_path / "rec.csv", index=False)
    savemat(tmp_path / "rec.mat", {"rec": ARRAYS})
    with h5py.File(tmp_path / "rec.h5", "w") as file:
        file["p"] = PRESSURE_KPA
        file["p"].attrs["units"] = "kPa"
    write_tdms(tmp_path / "rec.tdms", (0.001, 0.002))
    for path in (*healthy, *sorted(tmp_path.iterdir())):
        found = listed(path, capsys)
        assert any(isinstance(c, dict) and c["rows"] > 0 and c["first"] for c in found.values())
    assert listed(tmp_path / "rec.h5", capsys)["p"]["unit"] == "kPa"
    assert listed(tmp_path / "rec.tdms", capsys)["run/angle"]["rate_hz"] == pytest.approx(500)
    assert_allclose(listed(tmp_path / "rec.xlsx", capsys)["kpa"]["first"], PRESSURE_KPA[:3])


def test_list_for_people(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A line for each channel, with its name whole, however long it is."""
    path = write_mdf(tmp_path / "rec", "4.10")
    assert main(["convert", str(path), "--list", "-o", str(tmp_path / "log.csv")]) == 0
    said = capsys.readouterr()
    assert "notice: --list writes nothing" in said.err
    assert not (tmp_path / "log.csv").exists()
    lines = {line.split()[0]: line.split()[1:] for line in said.out.splitlines()[1:]}
    assert lines["P1"][:4] == ["kPa", "1000", "Hz", str(SAMPLES)]
    assert lines["slow/phi"][:4] == ["deg", "200", "Hz", str(len(SLOW))]
    assert lines["word:"] == ["text"]
    long = "a" * 300
    (tmp_path / "rec.json").write_text(json.dumps({f"{long}{i}": [1, None] for i in range(3000)}))
    assert main(["convert", str(tmp_path / "rec.json"), "--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert sum(line.startswith(f"{long}2999 ") and "1, (empty)" in line for line in lines) == 1


def test_list_shows_names_as_they_are(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_bag2(tmp_path / "bag", "mcap")
    assert main(["convert", str(tmp_path / "bag"), "--list"]) == 0
    out = capsys.readouterr().out
    assert "/joint_states.position[elbow] = /joint_states.position[0] " in out
    assert "100 Hz" not in out and "1000 Hz" in out
    assert listed(tmp_path / "bag", capsys)["/joint_states.position[wrist]"]["also"] == [
        "/joint_states.position[1]"
    ]


def test_records_of_hdf5(tmp_path: Path) -> None:
    """PyTables' and h5py's compound data sets: each field that is a number is a column."""
    fields = [("t", "f8"), ("imu", [("w", "f4"), ("id", "S4")]), ("p", "f8", (2,)), ("on", "?")]
    records = np.zeros(9, dtype=[*fields, ("word", "S4")])
    records["t"], records["imu"]["w"], records["p"][:, 1] = np.arange(9), 2.5, 7.0
    with h5py.File(tmp_path / "rec.h5", "w") as file:
        file.create_dataset("log", data=records, compression="gzip")
        file["log"].attrs["names"] = "some"
        named = np.dtype([("t", "f8"), ("text", h5py.string_dtype())])
        file.create_dataset("other", (9,), dtype=named)
    found = table_of(tmp_path / "rec.h5")
    assert list(found.columns) == ["log.t", "log.imu.w", "log.p#1", "log.p#2", "log.on", "other.t"]
    assert found.columns["log.t"].tolist() == list(range(9))
    assert set(found.columns["log.imu.w"]) == {2.5} and set(found.columns["log.p#2"]) == {7.0}
    assert set(found.skipped) == {"log.imu.id", "log.word", "other.text"}


def test_list_reads_as_a_conversion_does(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "rec.csv"
    path.write_text("made by hand\nt|p\n0|1,5\n1|2,5\n")
    words = ("--skip-rows", "1", "--delimiter", "|", "--decimal", ",")
    assert listed(path, capsys, *words)["p"]["first"] == [1.5, 2.5]
    spec = tmp_path / "spec.toml"
    spec.write_text('[options]\nskip_rows = 1\ndelimiter = "|"\ndecimal = ","\n')
    assert listed(path, capsys, "--spec", str(spec))["p"]["first"] == [1.5, 2.5]
    assert main(["convert", str(tmp_path / "none.csv"), "--list"]) == 2
    assert "no such file" in capsys.readouterr().err
    assert main(["convert", str(path), "--list", "--skip-rows", "-1"]) == 2


def test_messages_where_nothing_is_mapped_point_to_the_list(tmp_path: Path) -> None:
    path = write_mdf(tmp_path / "rec", "4.10")
    refused(path, tmp_path / "log.csv", r"sysid convert rec.mf4 --list")


@pytest.mark.parametrize(
    ("name", "signature"),
    [
        ("a.mf4", b"MDF     4.10    sysid   " + bytes(4) + (410).to_bytes(2, "little")),
        ("a.mdf", b"MDF     3.30    sysid   " + bytes(4) + (330).to_bytes(2, "little")),
        ("b.mf4", b"UnFinMF 4.11    sysid   " + bytes(4) + (411).to_bytes(2, "little")),
        ("a.mcap", b"\x89MCAP0\r\n"),
        ("a.bag", b"#ROSBAG V2.0\n"),
        ("a.db3", b"SQLite format 3\x00"),
        ("a.ulg", b"ULog\x01\x12\x35\x01"),
        ("a.npy", b"\x93NUMPY\x01\x00"),
        ("a.npz", b"PK\x03\x04"),
        ("a.json", b'{"t": '),
    ],
)
@pytest.mark.parametrize("rest", [b"", bytes(3000), b"\xff" * 3000, b"garbage " * 400])
def test_a_signature_alone_is_no_file(
    tmp_path: Path, name: str, signature: bytes, rest: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    path.write_bytes(signature + rest)
    refused(path, tmp_path / "log.csv", "; ")
    assert capfd.readouterr() == ("", "")


def test_hdf5_by_its_netcdf_attributes(tmp_path: Path) -> None:
    packed = np.arange(9, dtype="i2")
    with h5py.File(tmp_path / "rec.h5", "w", userblock_size=1024) as file:
        for name in ("plain", "packed", "gaps"):
            file[name] = packed
            file[name].attrs["_FillValue"] = np.array([-1], dtype="i2")
        file["packed"].attrs["scale_factor"], file["packed"].attrs["add_offset"] = 0.5, [10.0]
        file["gaps"].attrs["_FillValue"] = 3
    found = table_of(tmp_path / "rec.h5")
    assert found.columns["plain"].tolist() == packed.tolist()
    assert found.columns["packed"].tolist() == (10.0 + 0.5 * packed).tolist()
    assert np.flatnonzero(np.isnan(found.columns["gaps"])).tolist() == [3]
    assert len(found.notices) == 2


@pytest.mark.parametrize(
    ("content", "what"),
    [
        (b"\xef\xbb\xbf\n<!DOCTYPE html><html><table>", "a web page .*; download the file itself"),
        (b"version https://git-lfs.github.com/spec/v1\n", "Git LFS .*; fetch it: git lfs pull"),
        (b"# Created by Octave 8.4\n# name: t\n", "Octave; save it in Octave with save -v7"),
        (b"BZh91AY&SY", r"bzip2\); unpack it with bunzip2 first"),
        (b"ARROW1\0\0", r"Arrow .*; save it as Parquet"),
        (b"<?xml version='1.0'?>", "an XML file; export it as CSV"),
    ],
)
def test_files_that_are_no_recordings_are_named(tmp_path: Path, content: bytes, what: str) -> None:
    (tmp_path / "rec.csv").write_bytes(content)
    with pytest.raises(InputError, match=f"rec.csv: is .*{what}"):
        table_of(tmp_path / "rec.csv")


def test_parquet_of_two_columns_of_one_name(tmp_path: Path) -> None:
    columns = [pa.array([1.0, 2.0]), pa.array([3.0, 4.0]), pa.array([5.0, 6.0])]
    pq.write_table(pa.Table.from_arrays(columns, names=["t", "u", "u"]), tmp_path / "rec.parquet")
    found = table_of(tmp_path / "rec.parquet")
    assert list(found.columns) == ["t"] and found.skipped == {"u": "it names 2 columns"}
