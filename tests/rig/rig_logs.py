"""Recordings made by hand: a joint that moves, and channels of it under whatever names."""

from pathlib import Path

import numpy as np

from vsalog.core.recording import Channel, Recording, Stream

JOINT_STATE = "sensor_msgs/msg/JointState"
RATE = 500.0
TIME = np.arange(4000) / RATE

MOTOR = 0.8 * np.sin(2.0 * TIME) + 0.1 * np.sin(11.0 * TIME)
DEFLECTION = 0.03 * np.sin(3.1 * TIME) + 0.01 * np.sin(7.3 * TIME)
LINK = MOTOR + DEFLECTION
RNG = np.random.default_rng(7)
TORQUE = 40.0 * DEFLECTION + 900.0 * DEFLECTION**3 + 0.02 * RNG.standard_normal(TIME.size)
MOTOR_TORQUE = TORQUE + 0.3 * np.cos(2.0 * TIME) + 0.02 * RNG.standard_normal(TIME.size)


def stamps_of(count, start=1_700_000_000_000_000_000):
    return start + np.round(np.arange(count) * 1e9 / RATE).astype(np.int64)


def recording(columns, *, stream=None, kind="csv", units=None, absolute=True, time_source="column", **extra):
    """Make a recording of {channel: values}; a name's stream is what stands before its last dot."""
    channels, streams = {}, {}
    for name, values in columns.items():
        of = stream if stream is not None else name.rpartition(".")[0]
        stamps = stamps_of(len(values))
        channels[name] = Channel(name, stamps, np.asarray(values, float), (units or {}).get(name), of, kind)
        streams[of] = Stream(of, kind, len(values), time_source)
    return Recording(Path("exp1.log"), kind, channels, streams, absolute_time=absolute, **extra)


def table(columns, **options):
    return recording(columns, stream="exp1", **options)


def joint_states(columns):
    return recording({f"/joint_states.{k}": v for k, v in columns.items()}, stream="/joint_states", kind=JOINT_STATE)


def channels_of(joint):
    return {role: guess.channel for role, guess in joint.roles.items()}


def write_csv(path, columns):
    header = ",".join(["time", *columns])
    rows = np.column_stack([TIME[: len(next(iter(columns.values())))], *columns.values()])
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.9g")
    return path
