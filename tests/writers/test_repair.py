"""`inspect --repair`: what can be read of a log becomes a sound MCAP file."""

from __future__ import annotations

import json

import numpy as np
import pytest
from click.testing import CliRunner
from finding_codes import codes, found, values_of
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from scipy.io import savemat

from vsalog.cli import cli
from vsalog.core.errors import ReadError, WriteError
from vsalog.readers import read
from vsalog.writers.repair import repair

START = 1_700_000_000_000_000_000
COUNT = 3000


def times_of(message):
    return message.sequence, message.log_time, message.publish_time


def content(path):
    """Return all that the mcap library finds in a file, checksums verified."""
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        messages = [
            (c.topic, c.message_encoding, dict(c.metadata), s and (s.name, s.encoding, s.data), *times_of(m), m.data)
            for s, c, m in reader.iter_messages(log_time_order=False)
        ]
        attachments = list(reader.iter_attachments())
        metadata = [(m.name, m.metadata) for m in reader.iter_metadata()]
        profile = reader.get_header().profile
    assert summary is not None
    assert summary.statistics.message_count == len(messages)
    return messages, attachments, metadata, profile


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """Protobuf, JSON and channels without a schema, two publishers, attachments, metadata: nothing we could decode wrongly."""
    path = tmp_path_factory.mktemp("original") / "log.mcap"
    rng = np.random.default_rng(1)
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.LZ4, chunk_size=10_000)
        writer.start(profile="own", library="test")
        writer.add_attachment(1, 2, "photo", "image/jpeg", rng.bytes(1000))
        writer.add_metadata("about", {"who": "mü"})
        schema = writer.register_schema("p.Q", "protobuf", bytes(range(256)))
        same = [writer.register_channel("/p", "protobuf", schema, {"k": str(k)}) for k in range(2)]
        bare = writer.register_channel("/j", "json", 0)
        for i in range(COUNT):
            channel = bare if i % 3 == 0 else same[i % 2]
            data = json.dumps({"i": i}).encode() if i % 3 == 0 else rng.bytes(int(rng.integers(60)))
            writer.add_message(channel, START + i, data, START - i, i + 7)
        writer.finish()
    return path


def test_a_sound_file_is_kept_bit_for_bit(original, tmp_path):
    done = repair(original, tmp_path / "new.mcap")
    assert content(tmp_path / "new.mcap") == content(original)
    assert (done.messages, done.channels, done.findings) == (COUNT, 3, ())


def test_what_a_damaged_file_still_holds_is_kept(original, tmp_path):
    raw = bytearray(original.read_bytes())
    with original.open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    bad = chunks[2]
    raw[bad.chunk_start_offset + 100] ^= 1
    end = chunks[-3].chunk_start_offset + 50  # cut off within a chunk
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(raw[:end])
    before = damaged.read_bytes()
    done = repair(damaged, tmp_path / "new.mcap")
    whole = content(original)
    lost = [(bad.message_start_time, bad.message_end_time), (chunks[-3].message_start_time, 2**63)]
    expected = [m for m in whole[0] if not any(low <= m[5] <= high for low, high in lost)]
    found = content(tmp_path / "new.mcap")
    assert found == (expected, *whole[1:])
    assert done.messages == len(expected)
    assert values_of(done, "recording.chunks_damaged") == [1]
    assert "recording.truncated" in codes(done)
    assert damaged.read_bytes() == before
    assert read(tmp_path / "new.mcap").findings == ()


def test_messages_of_a_lost_channel_are_counted(tmp_path):
    path = tmp_path / "log.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, use_chunking=False)
        writer.start()
        a, b = (writer.register_channel(topic, "json", 0) for topic in ("/a", "/b"))
        for i in range(10):
            writer.add_message(a if i % 2 else b, START + i, b'{"i": 1}', START + i)
        writer.finish()
    raw = path.read_bytes()
    data_end = raw.rindex(b"\x0f\x04" + bytes(7))
    path.write_bytes(raw[:data_end].replace(b"/b", b"\xff\xff"))
    done = repair(path, tmp_path / "new.mcap")
    assert done.messages == 5
    assert values_of(done, "repair.unknown_channels") == [5]


def test_damage_anywhere_is_no_crash(original, tmp_path):
    raw, sound = original.read_bytes(), content(original)[0]
    rng = np.random.default_rng(3)
    # Attachment and metadata lie at the beginning, the summary at the end.
    for place in (*rng.integers(8, 1300, 20).tolist(), *rng.integers(1300, len(raw), 10).tolist()):
        bad = bytearray(raw)
        bad[place] ^= int(rng.integers(1, 256))
        path = tmp_path / "bad.mcap"
        path.write_bytes(bad)
        repair(path, tmp_path / "new.mcap")
        messages, attachments, _, _ = content(tmp_path / "new.mcap")
        assert {m[4:] for m in messages} <= {m[4:] for m in sound}
        assert len(messages) > COUNT / 2
        assert all(len(a.data) == 1000 for a in attachments)


def test_messages_that_do_not_fit_their_definition_are_kept_and_counted(tmp_path):
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    expected = [b"\1\2\3" if i % 5 == 0 else np.float64(i).tobytes() for i in range(20)]
    with Writer1(tmp_path / "log") as writer:
        good, mixed, bad = (
            writer.add_connection(t, "std_msgs/msg/Float64", typestore=store) for t in ("/a", "/b", "/c")
        )
        for i, raw in enumerate(expected):
            writer.write(good, START + i, np.float64(i).tobytes())
            writer.write(mixed, START + i, raw)
            writer.write(bad, START + i, b"")
    done = repair(tmp_path / "log", tmp_path / "new.mcap")
    assert [m[-1] for m in content(tmp_path / "new.mcap")[0] if m[0] == "/b"] == expected
    assert done.messages == 60
    unfit = found(done, "recording.messages_damaged")
    assert [(one.part, one.value, one.evidence["messages"]) for one in unfit] == [("/b", 4, 20), ("/c", 20, 20)]
    assert {one.evidence["done"] for one in unfit} == {"copied as they are"}


@pytest.mark.parametrize("ros1", [True, False])
def test_messages_of_bags_are_kept_bit_for_bit(tmp_path, ros1):
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    kind = "std_msgs/msg/Float64"
    path = tmp_path / "log"
    writer = Writer1(path) if ros1 else Writer2(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
    expected = []
    with writer:
        connection = writer.add_connection("/x", kind, typestore=store)
        for i in range(100):
            message = store.types[kind](i / 7)
            raw = bytes(store.serialize_ros1(message, kind) if ros1 else store.serialize_cdr(message, kind))
            writer.write(connection, START + i * 1000, raw)
            expected.append(("/x", START + i * 1000, raw))
    repair(path, tmp_path / "new.mcap")
    messages, _, _, profile = content(tmp_path / "new.mcap")
    assert [(m[0], m[5], m[7]) for m in messages] == expected
    assert {m[1:4:2] for m in messages} == {
        ("ros1" if ros1 else "cdr", (kind.replace("/msg/", "/") if ros1 else kind, f"{profile}msg", b"float64 data\n"))
    }
    assert profile == ("ros1" if ros1 else "ros2")
    before, after = read(path).channel("/x.data"), read(tmp_path / "new.mcap").channel("/x.data")
    np.testing.assert_array_equal(before.values, after.values)
    np.testing.assert_array_equal(before.stamps, after.stamps)


def test_a_table_keeps_values_times_and_units(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("time [s],q [deg],/j.position[a] [mm],x\n0.1,1.5,2,-0.1\n0.2,0.1,nan,1e300\n")
    repair(path, tmp_path / "new.mcap")
    recording = read(tmp_path / "new.mcap")
    assert {n: (c.values.tolist(), c.unit) for n, c in recording.channels.items() if "[a]" not in n} == {
        "/q.data": ([1.5, 0.1], "deg"),
        "/x.data": ([-0.1, 1e300], None),
    }
    assert recording.channel("/q.data").stamps.tolist() == [100_000_000, 200_000_000]
    assert recording.channel("/j.position[a]").unit == "mm"
    path.write_text("q\n1\n2\n3\n")
    with pytest.raises(ReadError, match="--rate"):
        repair(path, tmp_path / "other.mcap")
    assert repair(path, tmp_path / "other.mcap", rate=10.0).messages == 3


def test_vectors_without_a_time_are_left_out(tmp_path):
    savemat(
        tmp_path / "log", {"run": {"time": np.arange(5.0), "x": np.arange(5.0)}, "y": np.arange(9.0)}, appendmat=False
    )
    done = repair(tmp_path / "log", tmp_path / "new.mcap")
    assert (done.messages, done.channels) == (5, 1)
    assert "repair.no_time" in codes(done)
    assert list(read(tmp_path / "new.mcap").channels) == ["/run/x.data"]


def test_the_source_is_never_written_to_and_nothing_half_written(original, tmp_path):
    path = tmp_path / "log.mcap"
    path.write_bytes(original.read_bytes())
    (tmp_path / "link.mcap").symlink_to(path)
    for target in (path, tmp_path / "link.mcap"):
        with pytest.raises(WriteError, match="is the log itself"):
            repair(path, target)
    assert path.read_bytes() == original.read_bytes()
    empty = tmp_path / "empty.mcap"
    empty.write_bytes(path.read_bytes()[:50])
    with pytest.raises(ReadError, match="none of its messages"):
        repair(empty, tmp_path / "new.mcap")
    assert {p.name for p in tmp_path.iterdir()} == {"log.mcap", "link.mcap", "empty.mcap"}


def test_the_command_says_what_it_wrote(original, tmp_path):
    target = tmp_path / "new.mcap"
    done = CliRunner().invoke(cli, ["inspect", str(original), "--repair", str(target), "--json"])
    assert done.exit_code == 0
    repaired = json.loads(done.stdout)["repaired"]
    assert repaired == {"path": str(target), "messages": COUNT, "channels": 3, "notes": [], "findings": []}
    assert f"{COUNT} messages of 3 channels written" in done.stderr
    both = CliRunner().invoke(cli, ["inspect", str(original), str(original), "--repair", str(target)])
    assert both.exit_code == 2
    assert "name one LOG" in both.output
    part = CliRunner().invoke(cli, ["inspect", str(original), "--start", "1", "--repair", str(tmp_path / "part.mcap")])
    assert part.exit_code == 2
    assert "writes the whole log" in part.output
    assert not (tmp_path / "part.mcap").exists()


def test_a_file_that_is_there_stays_unless_it_is_forced(original, tmp_path):
    target = tmp_path / "new.mcap"
    target.write_text("mine")
    line = ["inspect", str(original), "--repair", str(target)]
    assert isinstance(CliRunner().invoke(cli, line).exception, WriteError)
    assert target.read_text() == "mine"
    done = CliRunner().invoke(cli, [*line, "--force"])
    assert done.exit_code == 0, done.output
    assert content(target) == content(original)
    # The log itself is never replaced, and the error does not offer it.
    itself = CliRunner().invoke(cli, ["inspect", str(target), "--repair", str(target), "--force"])
    assert isinstance(itself.exception, WriteError)
    assert content(target) == content(original)
