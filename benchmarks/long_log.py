"""`vsalog estimate` on logs of an hour and of ten: memory that does not grow with the log, time in proportion to it.

    python -m benchmarks.long_log [--hours 1 10] [--estimator auto] [--folder DIR] [--keep]

The log is an MCAP file as a robot's recorder writes it: four topics of `sensor_msgs/JointState` with two joints each at 1 kHz,
interleaved, in chunks of a second that are compressed with zstd, with message indexes and a summary. A joint with a secondary
motor moves in closed form, so its stiffness is known at every sample; the encoders have steps, and the torque noise. Messages
are filled in by NumPy, thousands at a time. Each log is estimated in a process of its own, whose peak of resident memory is
taken, and the trace is compared with the stiffness it was made with. Needs a Unix, and for ten hours some 30 GB of room in the
folder. Exits with 1 where a target is missed.
"""

from __future__ import annotations

import argparse
import struct
import subprocess
import sys
import tempfile
import time
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from itertools import product
from pathlib import Path
from typing import IO, Any

import numpy as np

from benchmarks.estimated import DAMPING, INERTIA, RATE, START, estimate, make_apart, measured
from benchmarks.measure import machine

# Targets: peak of memory, and how much more than its share of the time the longest log may take.
MOST_MEMORY, MOST_TIME = 10**9, 1.3
# Seconds in a chunk of the file, and in what is computed at once.
CHUNK, AT_ONCE = 1, 20

# Topic → element and the role whose recorded quantity it holds.
TOPICS = {
    "/motor": ("motor", "motor_position", "position"),
    "/drive": ("drive", "motor_torque", "effort"),
    "/link": ("elbow", "link_position", "position"),
    "/lever": ("lever", "setpoint", "position"),
}
FIELDS = ("position", "velocity", "effort")
# τ_e = (K_0 + K_C c) φ + K_3 φ³ [SI], with the lever arm c.
K_0, K_C, K_3 = 10.0, 100.0, 2000.0
RIG = f"""name = "long"

[joint.elbow]
kind = "serial"

[joint.elbow.motor]
inertia = {INERTIA}
damping = {DAMPING}

[joint.elbow.basis]
order = 2
odd = true
setpoint_order = 2

[joint.elbow.signals]
""" + "\n".join(
    f'{role} = {{ channel = "{topic}.{quantity}[{element}]"{", unit = " + repr("m") if role == "setpoint" else ""} }}'
    for topic, (element, role, quantity) in TOPICS.items()
)


def lever_arm(t):
    """Return the lever arm over time [m]."""
    return 0.1 + 0.02 * np.sin(2.0 * np.pi * 0.013 * t)


def stiffness(phi, c):
    """Return the stiffness that a log is made with [N·m/rad]."""
    return K_0 + K_C * c + 3.0 * K_3 * phi**2


def sensed(t, rng) -> dict[str, np.ndarray]:
    """Return what the sensors say at times t [s], by role."""
    c = lever_arm(t)
    return {
        **measured(t, lambda phi: (K_0 + K_C * c) * phi + K_3 * phi**3, rng),
        "setpoint": np.round(c / 1e-6) * 1e-6,
    }


class Messages:
    """The records of one topic's messages: bytes that all share, and where the numbers go."""

    def __init__(self, channel: int, topic: str) -> None:
        from vsalog.writers.recording_messages import merged_messages
        from vsalog.writers.recording_topics import JOINT_STATE, Topic

        element, self.role, self.quantity = TOPICS[topic]
        # Of a second joint that nobody asks for, as messages of joint states have it.
        marks = {(name, of): np.array([1.25 + k]) for k, (of, name) in enumerate(product((element, "other"), FIELDS))}
        # Thirteen seconds and seventeen nanoseconds are found again as 13 and 17.
        stamp = np.array([13 * 10**9 + 17], dtype=np.int64)
        ((_, _, _, message),) = merged_messages([Topic(topic, JOINT_STATE, stamp, marks)], cdr=True)
        head = struct.pack("<BQHIQQ", 5, 22 + len(message), channel, 0, 0, 0)
        self.shared = np.frombuffer(head + message, np.uint8)
        self.stamp_at = (head + message).index(struct.pack("<iI", 13, 17))
        self.values_at = [(head + message).index(struct.pack("<d", mark[0])) for mark in marks.values()]

    def fill(self, first: int, stamps, values, rng):
        """Return records, shape (n, bytes), for so many stamps [ns]; `first` is the number of the first."""
        out = np.tile(self.shared, (stamps.size, 1))

        def put(at: int, column, kind: str) -> None:
            size = np.dtype(kind).itemsize
            out[:, at : at + size] = np.ascontiguousarray(column, kind).view(np.uint8).reshape(-1, size)

        # Received some 0.2 ms after the sample was taken.
        received = stamps + 200_000 + rng.integers(0, 20_000, stamps.size)
        put(11, np.arange(first, first + stamps.size), "<u4")
        put(15, received, "<u8")
        put(23, received, "<u8")
        put(self.stamp_at, stamps // 10**9, "<i4")
        put(self.stamp_at + 4, stamps % 10**9, "<u4")
        for k, at in enumerate(self.values_at):
            put(at, values if k == FIELDS.index(self.quantity) else rng.normal(size=stamps.size), "<f8")
        return out, received


@dataclass
class Mcap:
    """An MCAP file that is written chunk by chunk, with indexes and a summary; its format: https://mcap.dev/spec."""

    file: IO[bytes]
    chunks: list[tuple[int, ...]] = field(default_factory=list)
    counts: dict[int, int] = field(default_factory=dict)
    definitions: bytes = b""

    def begin(self) -> None:
        """Write magic, header, schema, channels and the rig."""
        from mcap.data_stream import RecordBuilder
        from mcap.records import Channel, Header, Schema

        from vsalog.writers.recording_messages import typestore
        from vsalog.writers.recording_topics import JOINT_STATE

        definitions = RecordBuilder()
        text, _ = typestore(True).generate_msgdef(JOINT_STATE, ros_version=2)
        Schema(id=1, name=JOINT_STATE, encoding="ros2msg", data=text.encode()).write(definitions)
        for number, topic in enumerate(TOPICS, 1):
            Channel(id=number, schema_id=1, topic=topic, message_encoding="cdr", metadata={}).write(definitions)
        self.definitions = definitions.end()
        head = RecordBuilder()
        Header(profile="ros2", library="vsalog benchmarks").write(head)
        self.file.write(b"\x89MCAP0\r\n" + head.end() + self.definitions)
        self.rig_at = self.file.tell()
        self.file.write(self._rig())

    def _rig(self) -> bytes:
        from mcap.data_stream import RecordBuilder
        from mcap.records import Metadata

        builder = RecordBuilder()
        Metadata(name="vsalog.rig", metadata={"toml": RIG}).write(builder)
        return bytes(builder.end())

    def add(self, records: Any, times: Any, compressor: Any) -> None:
        """Write a chunk of messages that are interleaved, topic after topic: bytes (n, topics, size), log times (n, topics)."""
        plain = records.reshape(-1)
        packed = compressor.compress(plain.data)
        at = self.file.tell()
        content = struct.pack("<QQQII", times.min(), times.max(), plain.size, zlib.crc32(plain.data), 4) + b"zstd"
        self.file.write(struct.pack("<BQ", 6, len(content) + 8 + len(packed)) + content)
        self.file.write(struct.pack("<Q", len(packed)) + packed)
        after, places = self.file.tell(), []
        for topic in range(times.shape[1]):
            offsets = (np.arange(times.shape[0]) * times.shape[1] + topic) * records.shape[2]
            entries = np.column_stack((times[:, topic], offsets)).astype("<u8").tobytes()
            places.append(self.file.tell())
            self.file.write(struct.pack("<BQHI", 7, 6 + len(entries), topic + 1, len(entries)) + entries)
            self.counts[topic + 1] = self.counts.get(topic + 1, 0) + times.shape[0]
        size = self.file.tell() - after
        self.chunks.append((times.min(), times.max(), at, after - at, size, len(packed), plain.size, *places))

    def end(self) -> None:
        """Write the end of the data, the summary and the footer."""
        self.file.write(struct.pack("<BQI", 15, 4, 0))
        summary = self.file.tell()
        out = BytesIO()
        out.write(self.definitions)
        first, last = min(c[0] for c in self.chunks), max(c[1] for c in self.chunks)
        counts = b"".join(struct.pack("<HQ", number, count) for number, count in self.counts.items())
        total = sum(self.counts.values())
        statistics = struct.pack("<QHIIIIQQI", total, 1, len(TOPICS), 0, 1, len(self.chunks), first, last, len(counts))
        out.write(struct.pack("<BQ", 11, len(statistics) + len(counts)) + statistics + counts)
        for begin, until, at, length, index, packed, plain, *places in self.chunks:
            entries = b"".join(struct.pack("<HQ", number, place) for number, place in enumerate(places, 1))
            content = struct.pack("<QQQQI", begin, until, at, length, len(entries)) + entries
            content += struct.pack("<QI", index, 4) + b"zstd" + struct.pack("<QQ", packed, plain)
            out.write(struct.pack("<BQ", 8, len(content)) + content)
        name = b"vsalog.rig"
        rig = struct.pack("<QQI", self.rig_at, len(self._rig()), len(name)) + name
        out.write(struct.pack("<BQ", 13, len(rig)) + rig)
        footer = struct.pack("<BQQQ", 2, 20, summary, 0)
        checksum = zlib.crc32(footer, zlib.crc32(out.getvalue()))
        self.file.write(out.getvalue() + footer + struct.pack("<I", checksum) + b"\x89MCAP0\r\n")


def make(path: Path, seconds: int) -> None:
    """Write a log of so many seconds."""
    import zstandard

    rng = np.random.default_rng(1)
    compressor = zstandard.ZstdCompressor(level=1)
    topics = [Messages(number, topic) for number, topic in enumerate(TOPICS, 1)]
    with path.open("wb") as file:
        log = Mcap(file)
        log.begin()
        for begin in range(0, seconds, AT_ONCE):
            ticks = np.arange(begin * RATE, min(begin + AT_ONCE, seconds) * RATE, dtype=np.int64)
            stamps, roles = START + ticks * (10**9 // RATE), sensed(ticks / RATE, rng)
            filled = [one.fill(int(ticks[0]), stamps, roles[one.role], rng) for one in topics]
            records = np.stack([rows for rows, _ in filled], axis=1)
            times = np.stack([received for _, received in filled], axis=1)
            for first in range(0, ticks.size, CHUNK * RATE):
                part = slice(first, first + CHUNK * RATE)
                log.add(records[part], times[part], compressor)
        log.end()


def error(trace: Path) -> tuple[float, float, int]:
    """Return the stiffness' error, root mean square and as a share of the stiffness, where it is supported, and the rows."""
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    square, power, count = 0.0, 0.0, 0
    names = ["transmission", "deflection", "setpoint", "stiffness", "excited"]
    for batch in pq.ParquetFile(trace).iter_batches(columns=names):
        some = batch.filter(pc.and_(pc.equal(batch["transmission"].cast("string"), "1"), batch["excited"]))
        phi, c, sigma = (np.asarray(some[name].to_numpy(zero_copy_only=False)) for name in names[1:4])
        true = stiffness(phi, c)
        square, power = square + float(np.sum((sigma - true) ** 2)), power + float(np.sum(true**2))
        count += len(some)
    return (square / max(count, 1)) ** 0.5, (square / max(power, 1e-300)) ** 0.5, count


def measure(folder: Path, hours: float, estimator: str, keep: bool) -> Iterator[tuple[str, float]]:
    """Make a log, estimate it and yield what there is to say."""
    log = folder / f"long-{hours:g}h.mcap"
    start = time.perf_counter()
    make_apart("benchmarks.long_log", log, round(hours * 3600))
    yield "making the log [s]", time.perf_counter() - start
    yield "log on disk [GB]", log.stat().st_size / 1e9
    done = estimate(log, estimator)
    trace = done.trace
    yield "time of vsalog estimate [s]", done.seconds
    yield "peak of resident memory [MB]", done.peak / 1e6
    yield "trace on disk [GB]", trace.stat().st_size / 1e9
    code = f"from benchmarks.long_log import *; print(*error(Path({str(trace)!r})))"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    yield "error of the stiffness [N·m/rad]", float(said[0])
    yield "  as a share of it", float(said[1])
    yield "rows at which it is supported", float(said[2])
    if not keep:
        for file in (log, trace, trace.with_name(f"{log.stem}.model.toml")):
            file.unlink(missing_ok=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, nargs="+", default=[1.0, 10.0])
    parser.add_argument("--estimator", default="auto")
    parser.add_argument(
        "--folder", type=Path, help="where the logs are made and removed again; a temporary one if absent"
    )
    parser.add_argument("--keep", action="store_true", help="leave the logs and traces there")
    parser.add_argument("--make", nargs=2, metavar=("PATH", "SECONDS"), help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.make:
        make(Path(asked.make[0]), int(asked.make[1]))
        return 0
    print(machine("vsalog", "numba", "numpy", "scipy", "pyarrow", "zstandard"))
    found: dict[float, dict[str, float]] = {}
    with tempfile.TemporaryDirectory(dir=asked.folder) as temporary:
        folder = asked.folder if asked.keep and asked.folder else Path(temporary)
        for hours in asked.hours:
            found[hours] = {}
            print(
                f"\n{hours:g} h at {RATE} Hz, {len(TOPICS)} topics, {hours * 3600 * RATE * len(TOPICS):.3g} messages\n"
            )
            for name, value in measure(folder, hours, asked.estimator, asked.keep):
                found[hours][name] = value
                print(f"{name:40}{value:14.5g}", flush=True)
    least, most = min(found), max(found)
    share = found[most]["time of vsalog estimate [s]"] / found[least]["time of vsalog estimate [s]"] / (most / least)
    peak = max(one["peak of resident memory [MB]"] for one in found.values())
    met = peak <= MOST_MEMORY / 1e6 and share <= MOST_TIME
    print(f"\ntime per hour of the longest, times that of the shortest: {share:.2f}")
    print(f"targets: {MOST_MEMORY / 1e6:.0f} MB at most, {MOST_TIME} times at most: {'met' if met else 'MISSED'}")
    return 0 if met else 1


if __name__ == "__main__":
    sys.exit(main())
