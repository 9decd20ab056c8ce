"""What is written is read back with the formats' own libraries, bit for bit."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Message
from numpy.typing import NDArray
from rosbags.rosbag1 import Reader as Bag
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from vsalog.core.errors import WriteError
from vsalog.core.recording import Channel, Recording, Stamps
from vsalog.simulation import awas_experiment, vsa2_experiment
from vsalog.writers.recording_mcap import write_mcap, write_topics_mcap
from vsalog.writers.recording_messages import merged_messages
from vsalog.writers.recording_rosbags import write_rosbag1
from vsalog.writers.recording_tables import write_csv
from vsalog.writers.recording_topics import FLOAT64, JOINT_STATE, Topic, scalar_topic, topic_name, topics_of

Array = NDArray[np.float64]
Writer = Callable[[Recording, Path], None]
WRITERS: list[Writer] = [write_mcap, write_rosbag1, write_csv]
START = 1_700_000_000_123_456_789


def recording(**channels: tuple[Stamps, Array] | tuple[Stamps, Array, str]) -> Recording:
    made = {}
    for key, (stamps, values, *unit) in channels.items():
        made[key] = Channel(key, stamps, values, unit[0] if unit else None, key.partition(".")[0], "")
    return Recording(Path("x"), "simulation", made, {})


def odd_numbers(count: int) -> Array:
    """Numbers of all magnitudes, and those that text or a sloppy cast would lose."""
    values = np.random.default_rng(5).standard_normal(count) * 10.0 ** np.linspace(-300, 300, count)
    values[:6] = [0.1, -0.0, np.inf, np.nan, 5e-324, 1.7976931348623157e308]
    return values


def mixed() -> Recording:
    fast, slow = START + np.arange(9000) * 1_000_001, START + 17 + np.arange(100) * 50_000_000
    return recording(
        **{
            "/js.position[a]": (fast, odd_numbers(9000)),
            "/js.position[bcd]": (fast, odd_numbers(9000)[::-1].copy()),
            "/js.effort[bcd]": (fast, np.arange(9000.0)),
            "/pressure.data": (slow, odd_numbers(100)),
        }
    )


def decoded_mcap(path: Path) -> list[tuple[str, Message, Any]]:
    """(topic, record, message) in the order of time, decoded with the definitions embedded in the file."""
    types = get_typestore(Stores.EMPTY)
    with path.open("rb") as file:
        rows = []
        for schema, channel, record in make_reader(file).iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            if schema.name not in types.types:
                types.register(get_types_from_msg(schema.data.decode(), schema.name))
            rows.append((channel.topic, record, types.deserialize_cdr(record.data, schema.name)))
    return rows


def assert_same_bits(a: object, b: Array) -> None:
    assert np.asarray(a, dtype=np.float64).tobytes() == b.tobytes()


def test_mcap_reads_back_with_its_own_libraries(tmp_path: Path) -> None:
    written, path = mixed(), tmp_path / "a.mcap"
    write_mcap(written, path, rig_text="name = 'Größe'\n")
    with path.open("rb") as file:
        reader = make_reader(file)
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
        summary = reader.get_summary()
        assert reader.get_header().profile == "ros2"
    assert metadata == {"vsalog.rig": {"toml": "name = 'Größe'\n"}}
    assert summary is not None
    assert {s.name for s in summary.schemas.values()} == {JOINT_STATE, FLOAT64}
    assert {c.compression for c in summary.chunk_indexes} == {"zstd"}
    rows = decoded_mcap(path)
    times = [m.log_time for _, m, _ in rows]
    assert times == sorted(times)
    joints = [(m, d) for topic, m, d in rows if topic == "/js"]
    stamps = written.channels["/js.position[a]"].stamps
    assert [d.header.stamp.sec * 10**9 + d.header.stamp.nanosec for _, d in joints] == stamps.tolist()
    assert [m.log_time for m, _ in joints] == [m.publish_time for m, _ in joints] == stamps.tolist()
    assert [m.sequence for m, _ in joints] == list(range(9000))
    assert all(d.name == ["a", "bcd"] and list(d.velocity) == [] for _, d in joints)
    assert_same_bits([d.position[0] for _, d in joints], written.channels["/js.position[a]"].values)
    assert_same_bits([d.position[1] for _, d in joints], written.channels["/js.position[bcd]"].values)
    assert_same_bits([d.effort[1] for _, d in joints], written.channels["/js.effort[bcd]"].values)
    assert np.isnan([d.effort[0] for _, d in joints]).all()
    scalars = [(m, d) for topic, m, d in rows if topic == "/pressure"]
    assert [m.log_time for m, _ in scalars] == written.channels["/pressure.data"].stamps.tolist()
    assert_same_bits([d.data for _, d in scalars], written.channels["/pressure.data"].values)


def test_rosbag1_reads_back_with_its_own_library(tmp_path: Path) -> None:
    written, path = mixed(), tmp_path / "a.bag"
    write_rosbag1(written, path)
    types = get_typestore(Stores.ROS1_NOETIC)
    with Bag(path) as bag:
        rows = [(c.topic, stamp, types.deserialize_ros1(raw, c.msgtype)) for c, stamp, raw in bag.messages()]
    joints = [(t, d) for topic, t, d in rows if topic == "/js"]
    stamps = written.channels["/js.position[a]"].stamps.tolist()
    assert [t for t, _ in joints] == stamps
    assert [d.header.stamp.sec * 10**9 + d.header.stamp.nanosec for _, d in joints] == stamps
    assert [d.header.seq for _, d in joints] == list(range(9000))
    assert joints[0][1].name == ["a", "bcd"]
    assert joints[0][1].velocity.size == 0
    assert_same_bits([d.position[1] for _, d in joints], written.channels["/js.position[bcd]"].values)
    assert_same_bits([d.effort[1] for _, d in joints], written.channels["/js.effort[bcd]"].values)
    scalars = [d.data for topic, _, d in rows if topic == "/pressure"]
    assert_same_bits(scalars, written.channels["/pressure.data"].values)


@pytest.mark.parametrize("cdr", [True, False])
def test_messages_are_those_of_a_reference_serialiser(cdr: bool) -> None:
    types = get_typestore(Stores.ROS2_HUMBLE if cdr else Stores.ROS1_NOETIC)
    names = ["a", "motor_12", "größe"]
    stamps = np.array([START], dtype=np.int64)
    for fields in (("position",), ("velocity", "effort"), ("position", "velocity", "effort")):
        columns = {(f, n): np.array([i * 1.5 + len(f)]) for f in fields for i, n in enumerate(names)}
        arrays = {
            f: np.array([columns[f, n][0] for n in names]) if f in fields else np.zeros(0)
            for f in ("position", "velocity", "effort")
        }
        stamp = types.types["builtin_interfaces/msg/Time"](sec=START // 10**9, nanosec=START % 10**9)
        extra = {} if cdr else {"seq": 0}
        header = types.types["std_msgs/msg/Header"](stamp=stamp, frame_id="", **extra)
        message = types.types[JOINT_STATE](header=header, name=names, **arrays)
        serialise = types.serialize_cdr if cdr else types.serialize_ros1
        (_, _, _, raw), *rest = merged_messages([Topic("/t", JOINT_STATE, stamps, columns)], cdr)
        assert not rest
        assert raw == bytes(serialise(message, JOINT_STATE))


def test_csv_reads_back_bit_for_bit(tmp_path: Path) -> None:
    written, path = mixed(), tmp_path / "a.csv"
    write_csv(written, path)
    header, *rows = csv.reader(path.open(encoding="utf-8"))
    assert header == ["time [ns]", *written.channels]
    stamps = np.array([int(row[0]) for row in rows])
    for i, channel in enumerate(written.channels.values(), start=1):
        filled = [(s, row[i]) for s, row in zip(stamps, rows, strict=True) if row[i]]
        assert [s for s, _ in filled] == channel.stamps.tolist()
        assert_same_bits([float(text) for _, text in filled], channel.values)


def test_csv_headers_carry_units_and_seconds_are_exact(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    stamps = START + np.array([0, 1, 2_000_000_003], dtype=np.int64)
    one = np.ones(3)
    write_csv(recording(**{"torque, left": (stamps, one, "N·mm"), "q": (stamps, one)}), path, time="s")
    header, *rows = csv.reader(path.open(encoding="utf-8"))
    assert header == ["time [s]", "torque, left [N·mm]", "q"]
    assert [row[0] for row in rows] == ["0.000000000", "0.000000001", "2.000000003"]


def test_topics_with_their_own_clocks(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    topics = [
        scalar_topic("/late", np.array([5, 9]), np.array([1.0, 2.0])),
        scalar_topic("/early", np.array([1, 5]), np.array([3.0, 4.0])),
    ]
    write_topics_mcap(topics, path, metadata={"other": {"k": "v"}})
    order = [(topic, m.log_time, d.data) for topic, m, d in decoded_mcap(path)]
    assert sorted(order) == [("/early", 1, 3.0), ("/early", 5, 4.0), ("/late", 5, 1.0), ("/late", 9, 2.0)]


def test_an_experiment_keeps_its_names(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    experiment = awas_experiment(duration=0.05)
    write_mcap(experiment.recording(truth=True), path)
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    topics = {c.topic for c in summary.channels.values()}
    assert {"/joint_states", "/joint_torque", "/truth/stiffness", "/truth/lever_arm"} <= topics


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("/joint_states", "/joint_states"),
        ("DESR_N.x00.torque", "/DESR_N/x00/torque"),
        ("motor position", "/motor_position"),
        ("/raw.data[3]", "/raw/data/_3"),
        ("/a//b/", "/a/b"),
        ("φ", "/_"),
    ],
)
def test_topic_names_are_valid(name: str, expected: str) -> None:
    assert topic_name(name) == expected


@pytest.mark.parametrize("writer", WRITERS)
def test_an_empty_recording_makes_a_valid_file(writer: Writer, tmp_path: Path) -> None:
    none = np.zeros(0, dtype=np.int64)
    for i, empty in enumerate((recording(), recording(**{"/a.data": (none, np.zeros(0))}))):
        path = tmp_path / f"a{i}"
        writer(empty, path)
        assert path.stat().st_size > 0


@pytest.mark.parametrize("writer", WRITERS)
def test_equal_recordings_make_equal_files(writer: Writer, tmp_path: Path) -> None:
    for name in ("a", "b"):
        writer(vsa2_experiment(duration=0.2).recording(), tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


@pytest.mark.parametrize("writer", WRITERS)
def test_a_missing_folder_is_reported(writer: Writer, tmp_path: Path) -> None:
    with pytest.raises(WriteError, match="does not exist"):
        writer(mixed(), tmp_path / "no" / "a")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("writer", WRITERS)
def test_nothing_is_left_behind_and_the_old_file_stays(
    writer: Writer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a"
    path.write_text("old")

    def full(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("vsalog.writers.recording_mcap.merged_messages", full)
    monkeypatch.setattr("vsalog.writers.recording_rosbags.merged_messages", full)
    monkeypatch.setattr("vsalog.writers.recording_tables.pa_csv.write_csv", full)
    with pytest.raises(WriteError, match="No space left"):
        writer(mixed(), path)
    assert [p.name for p in tmp_path.iterdir()] == ["a"]
    assert path.read_text() == "old"


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (
            {
                "/t.position[a]": (np.array([1]), np.ones(1)),
                "/t.effort[a]": (np.array([2]), np.ones(1)),
            },
            "stamps differ",
        ),
        ({"/t.data": (np.array([1]), np.ones(1)), "/t": (np.array([1]), np.ones(1))}, "one topic"),
        (
            {"/t.position[a]": (np.array([1]), np.ones(1)), "/t.data": (np.array([1]), np.ones(1))},
            "one topic",
        ),
        ({"/t.data": (np.array([-1]), np.ones(1))}, "outside"),
        ({"/t.data": (np.array([2**31 * 10**9]), np.ones(1))}, "outside"),
    ],
)
def test_what_makes_no_topics_is_reported(bad: dict[str, tuple[Stamps, Array]], words: str) -> None:
    with pytest.raises(WriteError, match=words):
        topics_of(recording(**bad))
