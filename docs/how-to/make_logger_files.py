"""The same half second as data loggers, numpy and a web service write it."""

import json

import numpy as np
from asammdf import MDF, Signal
from mcap.writer import Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

time = np.arange(500) / 1000.0  # s
pressure = 2.0 - 0.5 * np.cos(2 * np.pi * 3.0 * time)  # bar, gauge
angle = 20.0 * np.sin(2 * np.pi * 3.0 * time)  # degrees
start = 1_760_000_000_000_000_000  # ns since 1970

# A measurement system with groups of two rates.
with MDF(version="4.10") as file:
    fast = [
        Signal(pressure, time, name="P1", unit="bar"),
        Signal(angle, time, name="phi", unit="deg"),
    ]
    file.append(fast, acq_name="fast", common_timebase=True)
    slow = [Signal(angle[::5], time[::5], name="phi", unit="deg")]
    file.append(slow, acq_name="slow")
    file.save("logger.mf4", overwrite=True)

# A robot's logger: JSON messages with a stamp.
with open("logger.mcap", "wb") as file:
    writer = Writer(file)
    writer.start()
    schema = writer.register_schema("Chamber", "jsonschema", b'{"type": "object"}')
    channel = writer.register_channel("/chamber", "json", schema)
    for t, p, a in zip(time, pressure, angle):
        at = start + round(t * 1e9)
        stamp = {"sec": at // 10**9, "nanosec": at % 10**9}
        message = {"header": {"stamp": stamp}, "bar": p, "deg": a}
        writer.add_message(channel, at + 250_000, json.dumps(message).encode(), at)
    writer.finish()

# ROS 2: a bag of joint states.
types = get_typestore(Stores.ROS2_HUMBLE)
kinds = types.types
kind = "sensor_msgs/msg/JointState"
with BagWriter("bag", version=9, storage_plugin=StoragePlugin.MCAP) as bag:
    topic = bag.add_connection("/joint_states", kind, typestore=types)
    for t, a in zip(time, np.deg2rad(angle)):
        at = start + round(t * 1e9)
        stamp = kinds["builtin_interfaces/msg/Time"](at // 10**9, at % 10**9)
        state = kinds[kind](
            header=kinds["std_msgs/msg/Header"](stamp, "rig"),
            name=["elbow"],
            position=np.array([a]),
            velocity=np.array([]),
            effort=np.array([0.2 * a]),
        )
        bag.write(topic, at + 250_000, types.serialize_cdr(state, kind))

# numpy, and JSON lines.
np.savez("arrays.npz", t=time, signals=np.column_stack([pressure, angle]))
with open("lines.jsonl", "w") as file:
    for t, p, a in zip(time, pressure, np.deg2rad(angle)):
        file.write(json.dumps({"t": t, "sensor": {"bar": p}, "rad": a}) + "\n")
