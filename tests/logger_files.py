"""The samples of `foreign_files` as loggers of the extra `sysid[formats]` write them."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from asammdf import MDF, Signal
from foreign_files import ANGLE_DEG, PRESSURE_KPA, SAMPLES, TIME
from mcap.writer import CompressionType, Writer
from rosbags.rosbag1 import Writer as FirstWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as SecondWriter
from rosbags.typesys import Stores, get_typestore

STARTED_NS = 1_700_000_000_000_000_000
# How long after a message's stamp it is logged.
DELAY_NS = 300_000
SLOW = TIME[::5]
NS = 1_000_000_000


def write_mdf(path: Path, version: str, compression: int = 0, **options: Any) -> Path:
    """Two groups of different rates, of which each has a `phi`; a state with names; a text."""
    file = MDF(version=version, **options)
    # 0.5 kPa a step: 1/128 kPa keeps what float32 and double give alike.
    steps = np.round(PRESSURE_KPA * 128).astype(np.uint16)
    fast = [
        Signal(steps, TIME, unit="kPa", name="P1", conversion={"a": 1 / 128, "b": 0.0}),
        Signal(ANGLE_DEG, TIME, unit="deg", name="phi"),
    ]
    names = {"val_0": 0, "val_1": 1, "text_0": b"closed", "text_1": b"open"}
    slow = [
        Signal((np.arange(len(SLOW)) % 2).astype(np.uint8), SLOW, name="state", conversion=names),
        Signal(ANGLE_DEG[::5] * 2, SLOW, unit="deg", name="phi"),
    ]
    words = [Signal(np.array([b"a", b"bc"] * 5), SLOW, name="word", encoding="utf-8")]
    for signals, group in ((fast, "fast"), (slow, "slow"), (words, "words")):
        file.append(signals, acq_name=group, comment=group, common_timebase=True)
    saved = file.save(path, overwrite=True, compression=compression)
    file.close()
    return Path(saved)


def write_mcap(
    path: Path,
    compression: CompressionType = CompressionType.ZSTD,
    chunked: bool = True,
    stamp: Any = lambda ns: ns,
) -> None:
    """JSON messages: pressures with a stamp, angles without; a null, an array, a text."""
    with path.open("wb") as file:
        writer = Writer(file, compression=compression, use_chunking=chunked, chunk_size=2048)
        writer.start()
        schema = writer.register_schema("S", "jsonschema", b'{"type": "object"}')
        pressure, angle = (
            writer.register_channel(topic, "json", schema) for topic in ("/chamber", "/angle")
        )
        for index in range(SAMPLES):
            now = STARTED_NS + index * 1_000_000
            seconds, ns = divmod(stamp(now), NS)
            message = {
                "header": {"stamp": {"sec": seconds, "nanosec": ns}, "frame_id": "rig"},
                "sensor": {"kpa": PRESSURE_KPA[index], "raw": [index, 2 * index]},
                "is_open": index % 2 == 0,
                "once": None if index else 5,
            }
            writer.add_message(pressure, now + DELAY_NS, json.dumps(message).encode(), now)
            text = json.dumps({"deg": ANGLE_DEG[index]}).encode()
            writer.add_message(angle, now + DELAY_NS, text, now)
        writer.finish()


def _ros_messages(types: Any, turned: bool) -> Iterator[tuple[str, int, str, Any]]:
    """(topic, ns, type, message): joint states, a pressure, and a number without a stamp."""
    kinds = types.types
    header, time = kinds["std_msgs/msg/Header"], kinds["builtin_interfaces/msg/Time"]
    joint, gauge = "sensor_msgs/msg/JointState", "sensor_msgs/msg/FluidPressure"
    number = "std_msgs/msg/Float64"
    for index in range(SAMPLES):
        now = STARTED_NS + index * 1_000_000
        more = {"seq": index} if "seq" in header.__dataclass_fields__ else {}
        stamped = header(stamp=time(*divmod(now, NS)), frame_id="", **more)
        names, angles = ["elbow", "wrist"], np.array([ANGLE_DEG[index], -1.0])
        if turned and index % 2:
            names, angles = names[::-1], angles[::-1].copy()
        none = np.array([])
        state = kinds[joint](
            header=stamped, name=names, position=angles, velocity=none, effort=none
        )
        yield "/joint_states", now, joint, state
        pressure = kinds[gauge](header=stamped, fluid_pressure=PRESSURE_KPA[index], variance=0.0)
        yield "/p1", now, gauge, pressure
        yield "/duty", now, number, kinds[number](data=index / 7)


def write_bag2(
    folder: Path, storage: str, mode: str | None = None, turned: bool = False, version: int = 9
) -> None:
    """A ROS 2 bag of a storage ("mcap", "sqlite3"), packed by file or message."""
    types = get_typestore(Stores.ROS2_HUMBLE)
    writer = SecondWriter(folder, version=version, storage_plugin=StoragePlugin[storage.upper()])
    if mode is not None:
        writer.set_compression(CompressionMode[mode.upper()], CompressionFormat.ZSTD)
    with writer:
        known: dict[str, Any] = {}
        for topic, now, kind, message in _ros_messages(types, turned):
            if topic not in known:
                known[topic] = writer.add_connection(topic, kind, typestore=types)
            data = types.serialize_cdr(message, kind)
            writer.write(known[topic], now + DELAY_NS, data)


def write_bag1(path: Path, packed: str | None = None) -> None:
    """A ROS 1 bag, packed by "bz2" or "lz4"."""
    types = get_typestore(Stores.ROS1_NOETIC)
    writer = FirstWriter(path)
    if packed is not None:
        writer.set_compression(FirstWriter.CompressionFormat[packed.upper()])
    with writer:
        known: dict[str, Any] = {}
        for topic, now, kind, message in _ros_messages(types, False):
            if topic not in known:
                known[topic] = writer.add_connection(topic, kind, typestore=types)
            writer.write(known[topic], now + DELAY_NS, types.serialize_ros1(message, kind))


def write_ulog(path: Path, fields: str | None = None) -> None:
    """A ULog by PX4's description of the format: a topic of two instances, nested fields."""

    def message(kind: str, data: bytes) -> bytes:
        return struct.pack("<HB", len(data), ord(kind)) + data

    begun_us = 2_000_000
    fields = fields or "uint64_t timestamp;double kpa;double deg;char[2] tag;Raw raw;"
    parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", begun_us), message("B", bytes(40))]
    parts += [message("F", f"chamber:{fields}".encode()), message("F", b"Raw:int16_t[2] step;")]
    for instance in (0, 1):
        parts.append(message("A", struct.pack("<BH", instance, instance) + b"chamber"))
    for index in range(SAMPLES):
        for instance in (0, 1):
            values = (PRESSURE_KPA[index] * (1 + instance), ANGLE_DEG[index])
            at = begun_us + 1000 * index + 200 * instance
            data = struct.pack("<HQdd2shh", instance, at, *values, b"ok", index, -index)
            parts.append(message("D", data))
    path.write_bytes(b"".join(parts))
