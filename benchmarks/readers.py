"""Reading logs into columns, beside rosbags on the same files in the same run.

    python -m benchmarks.readers [--minutes 10] [--rounds 3]

Four topics at 1 kHz (JointState with three joints, WrenchStamped, FluidPressure, Imu: 2.4 million messages in 10 minutes) as MCAP
(zstd), ROS 1 bag (lz4) and ROS 2 bag (sqlite3). vsalog reads all channels through `vsalog.readers.read`; rosbags deserialises
every message with its `AnyReader` and does nothing with it. The floor is reading, decompressing and copying the chunks. Each runs
in a process of its own; vsalog's tells its peak of resident memory. Exits with 1 where a target is missed. Needs Linux.
"""

from __future__ import annotations

import argparse
import shutil
import statistics
import struct
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.measure import machine

START, PERIOD = 1_700_000_000_000_000_000, 1_000_000
# Least ratio of rosbags' time to vsalog's; most memory [bytes]; most of the floor's time.
TARGETS = {"mcap": 20.0, "bag": 30.0, "db3": 6.0}
MEMORY, FLOOR = 400 * 2**20, 4.0

READ = """
import sys, time
from pathlib import Path
from vsalog.readers import read
path = Path(sys.argv[1])
read(path.with_name("short") / path.name)  # compiles, where that is still to be done
begin = time.perf_counter()
recording = read(path)
seconds = time.perf_counter() - begin
# Of this process only; what getrusage tells may be the peak of the one that started it.
status = Path("/proc/self/status").read_text().split()
print(seconds, 1024 * int(status[status.index("VmHWM:") + 1]))
"""
ROSBAGS = """
import sys, time
from pathlib import Path
from rosbags.highlevel import AnyReader
begin = time.perf_counter()
count = 0
with AnyReader([Path(sys.argv[1])]) as reader:
    for connection, stamp, raw in reader.messages():
        reader.deserialize(raw, connection.msgtype)
        count += 1
print(time.perf_counter() - begin, count)
"""
COPY = """
import struct, sys, time
import zstandard
begin = time.perf_counter()
size = 0
with open(sys.argv[1], "rb") as file:
    file.seek(8)
    while True:
        kind, length = struct.unpack("<BQ", file.read(9))
        content = file.read(length)
        if kind == 15:
            break
        if kind == 6:
            start = 40 + struct.unpack_from("<I", content, 28)[0]
            size += len(bytearray(zstandard.decompress(content[start:])))
print(time.perf_counter() - begin, size)
"""


def messages(rows: int, ros1: bool) -> Iterator[tuple[str, int, int, bytes]]:
    """Yield type's index, sequence number, time [ns] and bytes; a number in each message changes."""
    templates = [bytearray(t) for t in _templates(ros1)]
    head = 4  # encapsulation, or the header's sequence number
    for k in range(rows):
        stamp = START + k * PERIOD
        for i, template in enumerate(templates):
            struct.pack_into("<II", template, head, stamp // 10**9, stamp % 10**9)
            struct.pack_into("<d", template, len(template) - 8, 1e-3 * k)
            yield TYPES[i], k, stamp, bytes(template)


TYPES = (
    "sensor_msgs/msg/JointState",
    "geometry_msgs/msg/WrenchStamped",
    "sensor_msgs/msg/FluidPressure",
    "sensor_msgs/msg/Imu",
)
TOPICS = dict(zip(TYPES, ("/joint_states", "/wrench", "/pressure", "/imu"), strict=True))


def store(ros1: bool):  # type: ignore[no-untyped-def]
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)


def _templates(ros1: bool) -> list[bytes]:
    import numpy as np

    types = store(ros1)
    t = types.types
    header = t["std_msgs/msg/Header"](*((0,) if ros1 else ()), t["builtin_interfaces/msg/Time"](0, 0), "base")
    vector, quaternion = t["geometry_msgs/msg/Vector3"], t["geometry_msgs/msg/Quaternion"]
    three, nine = np.zeros(3), np.zeros(9)
    made = (
        t[TYPES[0]](header, ["hip", "knee", "ankle"], three, three, three),
        t[TYPES[1]](header, t["geometry_msgs/msg/Wrench"](vector(0.0, 0.0, 0.0), vector(0.0, 0.0, 0.0))),
        t[TYPES[2]](header, 1e5, 0.0),
        t[TYPES[3]](
            header, quaternion(0.0, 0.0, 0.0, 1.0), nine, vector(0.0, 0.0, 0.0), nine, vector(0.0, 0.0, 9.8), nine
        ),
    )
    serialise = types.serialize_ros1 if ros1 else types.serialize_cdr
    return [bytes(serialise(m, m.__msgtype__)) for m in made]


def write_mcap(path: Path, rows: int) -> None:
    from mcap.writer import CompressionType, Writer

    types = store(False)
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="benchmark")
        channels = {}
        for kind in TYPES:
            text = types.generate_msgdef(kind, ros_version=2)[0].encode()
            channels[kind] = writer.register_channel(TOPICS[kind], "cdr", writer.register_schema(kind, "ros2msg", text))
        for kind, k, stamp, raw in messages(rows, False):
            writer.add_message(channels[kind], stamp, raw, stamp, k)
        writer.finish()


def write_bag(path: Path, rows: int) -> None:
    from rosbags.rosbag1 import Writer

    types = store(True)
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat.LZ4)
    with writer:
        connections = {kind: writer.add_connection(TOPICS[kind], kind, typestore=types) for kind in TYPES}
        for kind, _, stamp, raw in messages(rows, True):
            writer.write(connections[kind], stamp, raw)


def write_db3(path: Path, rows: int) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer

    types = store(False)
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connections = {kind: writer.add_connection(TOPICS[kind], kind, typestore=types) for kind in TYPES}
        for kind, _, stamp, raw in messages(rows, False):
            writer.write(connections[kind], stamp, raw)


def run(code: str, path: Path) -> tuple[float, int]:
    """Run a piece of Python on a log; return the two numbers it prints, of which the first is its time [s]."""
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"failed on {path.name}: {done.stderr[-2000:]}")
    seconds, other = done.stdout.split()
    return float(seconds), int(other)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, default=3)
    asked = parser.parse_args()
    rows = round(asked.minutes * 60_000)
    print(machine("vsalog", "rosbags", "mcap", "zstandard", "numpy", "numba"))
    print(f"\n{4 * rows} messages\n")
    met = True
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "short").mkdir()
        for ending, write in (("mcap", write_mcap), ("bag", write_bag), ("db3", write_db3)):
            path = folder / f"log.{ending}" if ending != "db3" else folder / "log"
            for where, count in ((folder / "short" / path.name, 200), (path, rows)):
                write(where, count)
            ways = {"vsalog": READ, "rosbags": ROSBAGS} | ({"floor": COPY} if ending == "mcap" else {})
            found = {way: [run(code, path) for _ in range(asked.rounds)] for way, code in ways.items()}
            seconds = {way: statistics.median(t for t, _ in runs) for way, runs in found.items()}
            peak = max(m for _, m in found["vsalog"])
            ratio = seconds["rosbags"] / seconds["vsalog"]
            good = ratio >= TARGETS[ending] and peak <= MEMORY
            line = f"{ending:6}vsalog {seconds['vsalog']:6.2f} s, {peak / 2**20:5.0f} MiB;"
            line += f" rosbags {seconds['rosbags']:6.2f} s: {ratio:5.1f} x"
            if "floor" in seconds:
                over = seconds["vsalog"] / seconds["floor"]
                good &= over <= FLOOR
                line += f"; decompress and copy {seconds['floor']:5.2f} s: {over:4.1f} x that"
            print(f"{line}   {'met' if good else 'MISSED'}")
            met &= good
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
