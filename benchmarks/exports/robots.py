"""ROS, MCAP, PlotJuggler, PX4."""

from __future__ import annotations

import json
import struct
import tempfile
from pathlib import Path
from typing import Any

from benchmarks.exports.record import Channel, Record, Sheet, column, style, table

_START_NS = 1715693370_000000000


def _state(prefix: str, unit: str = "bar", decimals: int | None = None) -> tuple[Channel, ...]:
    return (
        column("pressure_a_pa", f"{prefix}.pressure_a", unit, decimals),
        column("pressure_b_pa", f"{prefix}.pressure_b", unit, decimals),
        column("theta_rad", f"{prefix}.angle", "deg", decimals),
    )


@style(
    "rostopic echo -p",
    "joint.csv",
    [
        column("time_s", "%time", "ns", 0, zero=-_START_NS // 10**9),
        column("theta_rad", "field.position", "rad", 12),
        column("motor_torque_nm", "field.effort", "Nm", 12),
    ],
)
def rostopic(path: Path, record: Record) -> Sheet:
    """`%time` in nanoseconds and `field.` names; the message's own stamp beside it."""
    sheet = table(record)
    sheet.heads = [["%time", "field.header.seq", "field.header.frame_id", *sheet.heads[0][1:]]]
    sheet.body = [
        [time, str(number), "base", position, effort]
        for number, (time, position, effort) in enumerate(sheet.body)
    ]
    sheet.places = {"time_s": 0, "theta_rad": 3, "motor_torque_nm": 4}
    return sheet


@style(
    "PlotJuggler CSV",
    "plot.csv",
    [
        column("time_s", "__time", "s", 9, zero=-_START_NS // 10**9),
        column("theta_rad", "/joint_states/arm/position", "rad", 15),
        column("duty_a", "/valves/duty[0]", "", 15, every=5),
    ],
)
def plot_juggler(path: Path, record: Record) -> Sheet:
    """One time of all topics; a topic's cells are empty at the others' times."""
    return table(record)


_IDL = "float64 pressure_a\nfloat64 pressure_b\nfloat64 angle"
_DEFINITION = "std_msgs/Header header\n" + _IDL


def _write_bag(path: Path, record: Record, version: int, storage: str = "") -> None:
    """A bag of one topic of a message type of the laboratory's own."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    name = "cylinder_msgs/msg/State"
    store.register(get_types_from_msg(_DEFINITION, name))
    kinds: Any = store.types
    if version == 1:
        path.unlink(missing_ok=True)  # the writer replaces no file
        writer: Any = rosbag1.Writer(path)
    else:
        plugin = rosbag2.StoragePlugin[storage]
        writer = rosbag2.Writer(path, version=8, storage_plugin=plugin)
    columns = [record.doubles(c.target) for c in record.channels]
    with writer:
        connection = writer.add_connection("/cylinder", name, typestore=store)
        for row, values in enumerate(zip(*columns, strict=True)):
            stamp = _START_NS + row * 1_000_000
            time = kinds["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
            counted = {"seq": row} if version == 1 else {}
            header = kinds["std_msgs/msg/Header"](stamp=time, frame_id="base", **counted)
            message = kinds[name](header, *(float(v) for v in values))
            encode = store.serialize_ros1 if version == 1 else store.serialize_cdr
            writer.write(connection, stamp, encode(message, name))


@style("ROS 1 bag", "run.bag", _state("/cylinder"), timed=False)
def ros1(path: Path, record: Record) -> None:
    _write_bag(path, record, 1)


def _file_of_bag(path: Path, record: Record, storage: str, suffix: str) -> None:
    """The file inside a ROS 2 bag's folder, as people hand it on."""
    with tempfile.TemporaryDirectory(prefix="bag-") as scratch:
        folder = Path(scratch) / "run"
        _write_bag(folder, record, 2, storage)
        path.write_bytes(next(folder.glob(f"*{suffix}")).read_bytes())


@style("ROS 2 bag, SQLite", "run_0.db3", _state("/cylinder"), timed=False)
def ros2_sqlite(path: Path, record: Record) -> None:
    _file_of_bag(path, record, "SQLITE3", ".db3")


@style("ROS 2 bag, MCAP", "run_0.mcap", _state("/cylinder"), timed=False)
def ros2_mcap(path: Path, record: Record) -> None:
    _file_of_bag(path, record, "MCAP", ".mcap")


@style(
    "MCAP, JSON messages",
    "foxglove.mcap",
    _state("/cylinder", "kPa", 6),
    timed=False,
)
def mcap_json(path: Path, record: Record) -> None:
    from mcap.writer import Writer

    schema = {"type": "object", "properties": {n: {"type": "number"} for n in ("pressure_a",)}}
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        known = writer.register_schema("State", "jsonschema", json.dumps(schema).encode())
        channel = writer.register_channel("/cylinder", "json", known)
        columns = [record.cells(c.target) for c in record.channels]
        names = [c.name.removeprefix("/cylinder.") for c in record.channels]
        for row, cells in enumerate(zip(*columns, strict=True)):
            body = ", ".join(f'"{n}": {cell}' for n, cell in zip(names, cells, strict=True))
            stamp = _START_NS + row * 1_000_000
            writer.add_message(channel, stamp, f"{{{body}}}".encode(), stamp)
        writer.finish()


def _ulog_message(kind: bytes, content: bytes) -> bytes:
    return struct.pack("<HB", len(content), kind[0]) + content


@style(
    "PX4 ULog",
    "log_1.ulg",
    _state("cylinder_state"),
    timed=False,
)
def ulog(path: Path, record: Record) -> None:
    """Header, flag bits, the format of one message, its subscription and data (ULog version 1)."""
    form = b"cylinder_state:uint64_t timestamp;double pressure_a;double pressure_b;double angle;"
    parts = [
        b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 100_000_000),
        _ulog_message(b"B", bytes(40)),
        _ulog_message(b"F", form),
        _ulog_message(b"A", struct.pack("<BH", 0, 0) + b"cylinder_state"),
    ]
    columns = [record.doubles(c.target) for c in record.channels]
    for row, values in enumerate(zip(*columns, strict=True)):
        data = struct.pack("<HQ3d", 0, 100_000_000 + 1000 * row, *values)
        parts.append(_ulog_message(b"D", data))
    path.write_bytes(b"".join(parts))


@style(
    "ulog2csv",
    "log_1_cylinder_state_0.csv",
    [
        column("time_s", "timestamp", "us", 0, zero=-100),
        column("pressure_a_pa", "pressure_a", "bar", 8),
        column("valve_a", "valve", "", 0),
    ],
)
def ulog_csv(path: Path, record: Record) -> Sheet:
    return table(record)
