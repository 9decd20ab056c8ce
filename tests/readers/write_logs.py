"""Small logs for the tests, written with the formats' own libraries."""

from __future__ import annotations

import json
from io import BytesIO

import numpy as np
from mcap.writer import CompressionType, Writer
from random_messages import STORES

START = 1_700_000_000_123_456_789
MS = 1_000_000
JOINT_STATE = "sensor_msgs/msg/JointState"


def joint_state(stamp, names, position, velocity=(), effort=(), ros1=False):
    types = STORES[ros1].types
    time = types["builtin_interfaces/msg/Time"](int(stamp) // 10**9, int(stamp) % 10**9)
    head = (1,) if ros1 else ()
    header = types["std_msgs/msg/Header"](*head, time, "base")
    arrays = [np.asarray(values, float) for values in (position, velocity, effort)]
    return types[JOINT_STATE](header, list(names), *arrays)


def serialised(message, ros1=False):
    store = STORES[ros1]
    name = message.__msgtype__
    return bytes(store.serialize_ros1(message, name) if ros1 else store.serialize_cdr(message, name))


class McapLog:
    """An MCAP file in the making.

    >>> log = McapLog(); log.add("/t", message, START); log.save(path)
    """

    def __init__(self, profile="ros2", **options):
        self.file = BytesIO()
        self.writer = Writer(self.file, **{"compression": CompressionType.ZSTD, **options})
        self.writer.start(profile, "test")
        self.channels = {}

    def channel(self, topic, name, encoding="cdr", language="ros2msg", text=None, metadata=None, again=0):
        key = (topic, name, again)
        if key not in self.channels:
            if text is None and name:
                text = STORES[False].generate_msgdef(name, ros_version=2)[0]
            schema = self.writer.register_schema(name, language, text.encode()) if name else 0
            self.channels[key] = self.writer.register_channel(topic, encoding, schema, metadata or {})
        return self.channels[key]

    def add(self, topic, message, log, publish=None, **options):
        channel = self.channel(topic, message.__msgtype__, **options)
        self.raw(channel, serialised(message), log, publish)

    def add_json(self, topic, content, log):
        channel = self.channel(topic, "", encoding="json")
        self.raw(channel, json.dumps(content).encode(), log)

    def raw(self, channel, data, log, publish=None):
        self.writer.add_message(channel, int(log), data, int(log if publish is None else publish))

    def bytes(self):
        self.writer.finish()
        return self.file.getvalue()

    def save(self, path):
        path.write_bytes(self.bytes())
        return path


def joints_mcap(path, count=100, **options):
    """Two joints at 1 kHz; position[i] is i and -i."""
    log = McapLog(**options)
    for i in range(count):
        message = joint_state(START + i * MS, ["elbow", "knee"], [i, -i], [0.5 * i, 0], [])
        log.add("/joint_states", message, START + i * MS + 100_000)
    return log.save(path)


def at(channel, stamps):
    """A channel's values at some stamps, NaN where it has no sample there."""
    known = dict(zip(channel.stamps.tolist(), channel.values.tolist(), strict=True))
    return np.array([known.get(int(stamp), np.nan) for stamp in stamps])
