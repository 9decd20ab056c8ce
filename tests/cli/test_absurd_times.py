"""Logs whose times cannot be, or hardly: 1970, the year 2262, ahead of 1970, beyond 64 bits, lost to rounding.

Whole commands, every format: a right result, a right result with a note, or one clear line; never nonsense.
"""

import json
import struct

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from mcap.writer import Writer
from rosbags import rosbag1
from rosbags.typesys import Stores, get_typestore
from scipy.io import savemat

pytestmark = pytest.mark.share(2)

ROWS, STEP, STIFFNESS = 1000, 2_000_000, 20.0
RIG = """
[joint.knee]
kind = "elastic"
basis = {{ order = 1 }}
[joint.knee.signals]
motor_position = {{ channel = "{theta}", unit = "rad" }}
link_position = {{ channel = "{q}", unit = "rad" }}
torque_sensor = {{ channel = "{tau}", unit = "N*m" }}
"""
T = np.arange(ROWS) * STEP
THETA, Q = 0.3 * np.sin(6e-9 * T), 0.4 * np.sin(6e-9 * T + 0.3)
TAU = STIFFNESS * (Q - THETA) + 0.01 * np.random.default_rng(1).standard_normal(ROWS)
COLUMNS = {"theta": THETA, "q": Q, "tau": TAU}
MESSAGE = {"theta": "/js.position[m]", "q": "/js.position[l]", "tau": "/js.effort[m]"}
NOW, LIMIT = 1_700_000_000_000_000_000, 2**63 - 1
STORES = {True: get_typestore(Stores.ROS1_NOETIC), False: get_typestore(Stores.ROS2_HUMBLE)}


def csv(path, times):
    """Times as texts."""
    rows = zip(times, THETA, Q, TAU, strict=True)
    path.write_text("time [s],theta,q,tau\n" + "\n".join(f"{t},{a:.17g},{b:.17g},{c:.17g}" for t, a, b, c in rows))


def seconds(stamps):
    """Write whole nanoseconds as seconds, exactly."""
    return [f"{'-' if s < 0 else ''}{abs(int(s)) // 10**9}.{abs(int(s)) % 10**9:09d}" for s in stamps]


def parquet(path, times, unit=None):
    field = pa.field("time", times.type, metadata={"unit": unit} if unit else None)
    rest = [pa.field(name, pa.float64()) for name in COLUMNS]
    pq.write_table(pa.table([times, *map(pa.array, COLUMNS.values())], schema=pa.schema([field, *rest])), path)


def matlab(path, times):
    savemat(path, {"time": times, **COLUMNS}, appendmat=False)


def joint_state(i, header, ros1):
    types = STORES[ros1].types
    sec, nanosec = divmod(int(header), 10**9)
    time = types["builtin_interfaces/msg/Time"](0 if ros1 else sec, nanosec)
    head = types["std_msgs/msg/Header"](*((i,) if ros1 else ()), time, "")
    arrays = [np.array(values) for values in ((THETA[i], Q[i]), (), (TAU[i], 0.0))]
    message = types["sensor_msgs/msg/JointState"](head, ["m", "l"], *arrays)
    write = STORES[ros1].serialize_ros1 if ros1 else STORES[ros1].serialize_cdr
    raw = bytes(write(message, "sensor_msgs/msg/JointState"))
    # The library takes the seconds of ROS 1 for signed.
    return raw[:4] + struct.pack("<I", sec) + raw[8:] if ros1 else raw


def mcap(path, logs, headers):
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "test")
        text = STORES[False].generate_msgdef("sensor_msgs/msg/JointState", ros_version=2)[0]
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", text.encode())
        channel = writer.register_channel("/js", "cdr", schema)
        for i, (log, header) in enumerate(zip(logs, headers, strict=True)):
            writer.add_message(channel, int(log), joint_state(i, header, ros1=False), int(log))
        writer.finish()


def bag(path, logs, headers):
    with rosbag1.Writer(path) as writer:
        one = writer.add_connection("/js", "sensor_msgs/msg/JointState", typestore=STORES[True])
        for i, (log, header) in enumerate(zip(logs, headers, strict=True)):
            writer.write(one, int(log), joint_state(i, header, ros1=True))


def f32(stamps):
    return (stamps * 1e-9).astype(np.float32)


def dates(stamps, unit="ns"):
    return pa.array(stamps, pa.timestamp(unit))


RIGHT = {
    "csv-1970": (csv, [seconds(T)]),
    "csv-negative": (csv, [seconds(T - 3 * 10**9)]),
    "csv-before-1970": (csv, [seconds(T - 10**18)]),
    "csv-2100": (csv, [seconds(T + 4_102_000_000 * 10**9)]),
    "csv-microseconds": (csv, [[f"{s:.6f}" for s in (NOW + T) * 1e-9]]),
    "parquet-1970": (parquet, [dates(T)]),
    "parquet-negative": (parquet, [dates(T - NOW)]),
    "parquet-float64": (parquet, [pa.array((NOW + T) * 1e-9), "s"]),
    "parquet-float32-from-zero": (parquet, [pa.array(f32(T)), "s"]),
    "matlab-negative": (matlab, [T * 1e-9 - 5.0]),
    "matlab-epoch": (matlab, [(NOW + T) * 1e-9]),
    "mcap-1970": (mcap, [T, T]),
    "bag-1970": (bag, [T + 10**9, T + 10**9]),
    "bag-2106": (bag, [T + 4_294_000_000 * 10**9] * 2),
}
NOTED = {
    "mcap-header-1970": (mcap, [NOW + T, T + STEP], "clock.stamps_before_2000"),
    "mcap-header-zero": (mcap, [NOW + T, 0 * T], "clock.stamps_zero"),
    "mcap-header-2038": (mcap, [NOW + T, T + (2**31 - 10) * 10**9], "clock.stamps_far"),
    "mcap-header-negative": (mcap, [NOW + T, T - 2**31 * 10**9], "clock.stamps_before_2000"),
    "bag-header-2106": (bag, [NOW + T, T + 4_294_000_000 * 10**9], "clock."),
    "csv-one-beyond": (csv, [["1e300", *seconds(NOW + T)[1:]]], "clock.rows_without_time"),
    "csv-one-2262": (csv, [[*seconds(NOW + T)[:-1], *seconds([LIMIT])]], "clock.beyond_reach"),
    "mcap-one-beyond": (mcap, [[*(NOW + T)[:-1], 2**64 - 1], NOW + T], "clock.beyond_reach"),
}
REFUSED = {
    "csv-2262": (csv, [seconds(LIMIT - T[::-1])], "before the year 1823 or after 2116"),
    "csv-beyond": (csv, [[f"{10**12 + i}" for i in range(ROWS)]], "time"),
    "csv-infinite": (csv, [["1e300"] * ROWS], "time"),
    "csv-six-digits": (csv, [[f"{s:.6g}" for s in (NOW + T) * 1e-9]], "time"),
    "parquet-2262": (parquet, [dates(LIMIT - T[::-1])], "before the year 1823 or after 2116"),
    "parquet-3000": (parquet, [dates(32_503_680_000 + T // STEP, "s")], "time"),
    "parquet-uint64": (parquet, [pa.array(2**64 - 1 - T[::-1].astype(np.uint64)), "ns"], "time"),
    "parquet-float32": (parquet, [pa.array(f32(NOW + T)), "s"], "time"),
    "matlab-float32": (matlab, [f32(NOW + T).astype(float)], "--rate"),
    "mcap-2262": (mcap, [LIMIT - T[::-1], T], "before the year 1823 or after 2116"),
    "mcap-beyond": (mcap, [2**64 - 1 - T[::-1].astype(np.uint64), T], "before the year 1823 or after 2116"),
}


def lay(folder, write, *args):
    path = folder / "log"
    write(path, *args)
    names = MESSAGE if write in (mcap, bag) else {name: name for name in COLUMNS}
    (folder / "rig.toml").write_text(RIG.format(**names))
    return path


@pytest.fixture
def call(command):
    """Run `vsalog ARGS`, which must neither fail nor warn."""

    def call(*args, cwd):
        code, out, err = command(*args, cwd=cwd)
        assert "Traceback" not in err
        assert "Warning" not in err
        return code, out, err

    return call


def check(call, folder):
    """`inspect` tells the clock as it is, `estimate` finds the spring; returns all that was reported."""
    code, out, err = call("inspect", "log", "--json", cwd=folder)
    assert code == 0, err
    (log,) = json.loads(out)["logs"]
    stream = next(s for s in log["streams"] if s["count"])
    assert stream["rate"] == pytest.approx(500.0, rel=0.01)
    assert log["duration"] == pytest.approx(1.998, abs=0.01)
    code, out, err = call("estimate", "log", "--json", cwd=folder)
    assert code == 0, err
    trace = pq.read_table(folder / "log.stiffness.parquet").to_pydict()
    assert np.nanmedian(trace["stiffness"]) == pytest.approx(STIFFNESS, rel=0.02)
    assert trace["time"][-1] - trace["time"][0] == pytest.approx(1.998, abs=0.01)
    return json.dumps(log["findings"]) + err


@pytest.mark.parametrize("name", RIGHT)
def test_times_that_are_odd_but_right(name, tmp_path, call):
    write, args = RIGHT[name]
    lay(tmp_path, write, *args)
    check(call, tmp_path)


@pytest.mark.parametrize("name", NOTED)
def test_another_clock_or_fewer_samples_is_a_finding(name, tmp_path, call):
    write, args, code = NOTED[name]
    lay(tmp_path, write, *args)
    assert code in check(call, tmp_path)


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_is_refused_in_one_line(name, tmp_path, call):
    write, args, words = REFUSED[name]
    lay(tmp_path, write, *args)
    code, out, err = call("estimate", "log", cwd=tmp_path)
    assert (code, out) == (2, ""), (out, err)
    assert len(err.splitlines()) == 1, err
    assert words in err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log", "rig.toml"]
    code, out, err = call("inspect", "log", cwd=tmp_path)
    assert code in (0, 2), err
    assert words in out.replace("\n", " ") + err
