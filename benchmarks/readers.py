"""Reading logs into columns, next to rosbags and rerun-sdk on the same files in the same run.

    python -m benchmarks.readers [--minutes 10] [--rows 10000000] [--rounds 5]

Four topics at 1 kHz (JointState with three joints, WrenchStamped, FluidPressure, Imu: 2.4 million messages in 10 minutes) as
MCAP (zstd), ROS 1 bag (lz4) and ROS 2 bag (sqlite3). Every number is noise in steps, but for covariances, which are zero as
most drivers leave them. vsalog reads all channels through `vsalog.readers.read`; rosbags deserialises every message with its
`AnyReader` and does nothing with it, rerun-sdk turns an MCAP file into Arrow. The floor is reading, decompressing and copying
the chunks. Last, MCAP files of JointStates of 1 to 200 joints at random, always in one order or in another one in every
message. A text table of ten million rows of six numbers is compared with polars, and the same as Parquet with pyarrow, both to
NumPy arrays. Each runs in a process of its own, in turn, round after round; compared are the least times. vsalog's process
tells its peak of resident memory. Exits with 1 where a target is missed. Needs Linux.
"""

from __future__ import annotations

import argparse
import shutil
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from benchmarks.measure import machine

START, PERIOD = 1_700_000_000_000_000_000, 1_000_000
BLOCK, MARK = 10_000, 0.123456789
# Least ratio of rosbags' time to vsalog's, and of rerun-sdk's; most memory [bytes]; most of the floor's time.
TARGETS = {"mcap": 20.0, "bag": 25.0, "db3": 6.0, "random": 0.5, "shuffled": 0.05}
RERUN, MEMORY, FLOOR = 2.5, 400 * 2**20, 1.5
# Most of the time that polars takes for a text table and pyarrow for Parquet; most memory [bytes].
TABLES, TABLE_MEMORY = {"csv": 1.2, "parquet": 1.5}, 2**30
JOINTS, RANDOM_ROWS = 200, 10_000
# Seconds that each way of reading has in a round.
A_TURN = 2.0

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
RERUN_SDK = """
import sys, time
from rerun.chunk import McapReader
begin = time.perf_counter()
rows = sum(chunk.num_rows for chunk in McapReader(sys.argv[1]).stream().to_chunks())
print(time.perf_counter() - begin, rows)
"""
READ_TABLE = """
import sys, time
from pathlib import Path
from vsalog.readers import read
path = Path(sys.argv[1])
read(path.with_stem("short"))
begin, cpu = time.perf_counter(), time.process_time()
recording = read(path)
status = Path("/proc/self/status").read_text().split()
print(time.process_time() - cpu, time.perf_counter() - begin, 1024 * int(status[status.index("VmHWM:") + 1]))
"""
POLARS = """
import sys, time
from pathlib import Path
import polars
path = Path(sys.argv[1])
polars.read_csv(path.with_stem("short"))
begin, cpu = time.perf_counter(), time.process_time()
table = polars.read_csv(path)
columns = [table[name].to_numpy() for name in table.columns]
print(time.process_time() - cpu, time.perf_counter() - begin, 0)
"""
PYARROW = """
import sys, time
from pathlib import Path
import pyarrow.parquet
path = Path(sys.argv[1])
pyarrow.parquet.read_table(path.with_stem("short"))
begin, cpu = time.perf_counter(), time.process_time()
table = pyarrow.parquet.read_table(path)
columns = [column.to_numpy() for column in table.columns]
print(time.process_time() - cpu, time.perf_counter() - begin, 0)
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
    """Yield type's index, sequence number, time [ns] and bytes."""
    import numpy as np

    head = 4  # encapsulation, or the header's sequence number
    rng = np.random.default_rng(1)
    templates = [np.frombuffer(t, np.uint8) for t in _templates(ros1)]
    for first in range(0, rows, BLOCK):
        stamps = START + PERIOD * np.arange(first, min(first + BLOCK, rows))
        blocks = []
        for template in templates:
            block = np.tile(template, (stamps.size, 1))
            block[:, head : head + 8] = np.stack([stamps // 10**9, stamps % 10**9], 1).astype("<u4").view(np.uint8)
            for at in _measured(template):
                noise = np.round(rng.normal(size=(stamps.size, 1)) * 4096) / 4096
                block[:, at : at + 8] = noise.astype("<f8").view(np.uint8)
            blocks.append(block)
        for k, stamp in enumerate(stamps.tolist()):
            for i, block in enumerate(blocks):
                yield TYPES[i], first + k, stamp, block[k].tobytes()


def _measured(template) -> list[int]:  # type: ignore[no-untyped-def]
    """Return where the numbers lie that are not zero."""
    raw, mark = template.tobytes(), struct.pack("<d", MARK)
    return [at for at in range(len(raw) - 7) if raw[at : at + 8] == mark]


def random_joints(rows: int, shuffled: bool = False) -> Iterator[tuple[str, int, int, bytes]]:
    """Yield the same for JointStates of a random number of joints, in the same order or in another one in every message."""
    import numpy as np

    rng = np.random.default_rng(2)
    types = store(False)
    t = types.types
    for k in range(rows):
        stamp = START + k * PERIOD
        time = t["builtin_interfaces/msg/Time"](stamp // 10**9, stamp % 10**9)
        count = int(rng.integers(1, JOINTS + 1))
        values = rng.normal(size=(3, count))
        order = rng.permutation(count) if shuffled else range(count)
        message = t[TYPES[0]](t["std_msgs/msg/Header"](time, "base"), [f"joint_{i}" for i in order], *values)
        yield TYPES[0], k, stamp, bytes(types.serialize_cdr(message, TYPES[0]))


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
    three, nine, one = np.full(3, MARK), np.zeros(9), vector(MARK, MARK, MARK)
    made = (
        t[TYPES[0]](header, ["hip", "knee", "ankle"], three, three, three),
        t[TYPES[1]](header, t["geometry_msgs/msg/Wrench"](one, one)),
        t[TYPES[2]](header, MARK, 0.0),
        t[TYPES[3]](header, quaternion(MARK, MARK, MARK, MARK), nine, one, nine, one, nine),
    )
    serialise = types.serialize_ros1 if ros1 else types.serialize_cdr
    return [bytes(serialise(m, m.__msgtype__)) for m in made]


def write_random(path: Path, rows: int) -> None:
    write_mcap(path, min(rows, RANDOM_ROWS), random_joints)


def write_shuffled(path: Path, rows: int) -> None:
    write_mcap(path, min(rows, RANDOM_ROWS), partial(random_joints, shuffled=True))


def write_mcap(path: Path, rows: int, content: Callable[..., Iterator] | None = None) -> None:
    from mcap.writer import CompressionType, Writer

    types = store(False)
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="benchmark")
        channels = {}
        for kind in TYPES:
            text = types.generate_msgdef(kind, ros_version=2)[0].encode()
            channels[kind] = writer.register_channel(TOPICS[kind], "cdr", writer.register_schema(kind, "ros2msg", text))
        for kind, k, stamp, raw in content(rows) if content else messages(rows, False):
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


WRITERS = {"mcap": write_mcap, "bag": write_bag, "db3": write_db3, "random": write_random, "shuffled": write_shuffled}


def write_table(path: Path, rows: int) -> None:
    import numpy as np
    import pyarrow as pa
    import pyarrow.csv

    values = np.random.default_rng(1).standard_normal((5, rows)).round(9)
    columns = {f"x{k}": column for k, column in enumerate(values)}
    pyarrow.csv.write_csv(pa.table({"time": np.arange(rows) / 1000, **columns}), path)


def tables(folder: Path, rows: int, rounds: int) -> bool:
    """Print CPU and wall-clock time of reading a text table and the same as Parquet; tell whether targets are met."""
    import pyarrow.csv
    import pyarrow.parquet

    met = True
    for stem, count in (("short", 200), ("table", rows)):
        write_table(folder / f"{stem}.csv", count)
        pyarrow.parquet.write_table(pyarrow.csv.read_csv(folder / f"{stem}.csv"), folder / f"{stem}.parquet")
    for ending, name, code in (("csv", "polars", POLARS), ("parquet", "pyarrow", PYARROW)):
        path = folder / f"table.{ending}"
        found: dict[str, list[tuple[float, ...]]] = {"vsalog": [], name: []}
        for _ in range(rounds):
            found["vsalog"].append(run(READ_TABLE, path))
            found[name].append(run(code, path))
        (cpu, wall, _), (other_cpu, other_wall, _) = (map(min, zip(*runs, strict=True)) for runs in found.values())
        peak = max(memory for _, _, memory in found["vsalog"])
        good = wall <= TABLES[ending] * other_wall and peak <= TABLE_MEMORY
        met &= good
        print(
            f"{ending:9}vsalog {wall:6.2f} s, {cpu:6.2f} s of CPU, {peak / 2**20:5.0f} MiB; {name} {other_wall:6.2f} s, "
            f"{other_cpu:6.2f} s: {wall / other_wall:5.2f} x, {cpu / other_cpu:5.2f} x that   {'met' if good else 'MISSED'}",
            flush=True,
        )
        path.unlink()
    return met


def run(code: str, path: Path) -> tuple[float, ...]:
    """Run a piece of Python on a log; return the numbers it prints, of which the first is its time [s]."""
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"failed on {path.name}: {done.stderr[-2000:]}")
    return tuple(map(float, done.stdout.split()))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--rows", type=int, default=10_000_000, help="of the tables")
    parser.add_argument("--rounds", type=int, default=5)
    asked = parser.parse_args()
    rows = round(asked.minutes * 60_000)
    print(machine("vsalog", "rosbags", "rerun-sdk", "mcap", "zstandard", "numpy", "numba"))
    print(f"\n{4 * rows} messages\n")
    met = True
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "short").mkdir()
        if find_spec("polars"):
            met &= tables(folder, asked.rows, asked.rounds)
        for ending, write in WRITERS.items():
            path = folder / {"db3": "log", "mcap": "log.mcap", "bag": "log.bag"}.get(ending, f"{ending}.mcap")
            for where, count in ((folder / "short" / path.name, 200), (path, rows)):
                write(where, count)
            ways = {"vsalog": READ, "rosbags": ROSBAGS}
            if ending == "mcap":
                ways |= {"floor": COPY} | ({"rerun": RERUN_SDK} if find_spec("rerun") else {})
            found: dict[str, list[tuple[float, ...]]] = {way: [] for way in ways}
            for _ in range(asked.rounds):
                for way, code in ways.items():
                    # What else a machine does strikes a short run more than a long one: each has its time.
                    spent = 0.0
                    while spent < A_TURN:
                        found[way].append(run(code, path))
                        spent += found[way][-1][0]
            met &= told(
                ending,
                {way: min(t for t, _ in runs) for way, runs in found.items()},
                max(m for _, m in found["vsalog"]),
            )
            shutil.rmtree(path) if path.is_dir() else path.unlink()
    return 0 if met else 1


def told(ending: str, seconds: dict[str, float], peak: float) -> bool:
    """Print a line and tell whether its targets are met."""
    own = seconds["vsalog"]
    ratio = seconds["rosbags"] / own
    good = ratio >= TARGETS[ending] and peak <= MEMORY
    line = (
        f"{ending:9}vsalog {own:6.2f} s, {peak / 2**20:5.0f} MiB; rosbags {seconds['rosbags']:6.2f} s: {ratio:5.1f} x"
    )
    if "rerun" in seconds:
        good &= seconds["rerun"] / own >= RERUN
        line += f"; rerun-sdk {seconds['rerun']:5.2f} s: {seconds['rerun'] / own:4.1f} x"
    if "floor" in seconds:
        good &= own / seconds["floor"] <= FLOOR
        line += f"; decompress and copy {seconds['floor']:5.2f} s: {own / seconds['floor']:4.1f} x that"
    print(f"{line}   {'met' if good else 'MISSED'}", flush=True)
    return good


if __name__ == "__main__":
    sys.exit(main())
