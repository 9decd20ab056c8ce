"""ROS 1 and ROS 2 bags against what was written with rosbags."""

from __future__ import annotations

import shutil
import sqlite3

import numpy as np
import pytest
from finding_codes import codes, found, values_of
from random_messages import STORES
from rosbags import rosbag1, rosbag2
from write_logs import JOINT_STATE, MS, START, joint_state, joints_mcap, serialised

from vsalog.core.errors import ReadError
from vsalog.readers import open_reader, read, sampling
from vsalog.writers.repair import repair

COUNT = 300


def write_bag1(path, compression=None, chunk_threshold=4096):
    writer = rosbag1.Writer(path)
    writer.chunk_threshold = chunk_threshold
    if compression:
        writer.set_compression(compression)
    with writer:
        connection = writer.add_connection("/joint_states", JOINT_STATE, typestore=STORES[True])
        for i in range(COUNT):
            message = joint_state(START + i * MS, ["elbow", "knee"], [i, -i], ros1=True)
            writer.write(connection, START + i * MS + 50_000, serialised(message, ros1=True))
    return path


def write_bag2(folder, storage, mode=None, version=9):
    writer = rosbag2.Writer(folder, version=version, storage_plugin=storage)
    if mode:
        writer.set_compression(mode, rosbag2.CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/joint_states", JOINT_STATE, typestore=STORES[False])
        for i in range(COUNT):
            message = joint_state(START + i * MS, ["elbow", "knee"], [i, -i])
            writer.write(connection, START + i * MS + 50_000, serialised(message))
    return folder


def check(recording, count=COUNT):
    elbow = recording.channel("/joint_states.position[elbow]")
    np.testing.assert_array_equal(elbow.values, np.arange(count))
    np.testing.assert_array_equal(recording.channel("/joint_states.position[knee]").values, -np.arange(count))
    np.testing.assert_array_equal(elbow.stamps, START + np.arange(count) * MS)
    assert recording.streams["/joint_states"].time_source == "header"
    assert recording.streams["/joint_states"].type == JOINT_STATE


@pytest.mark.parametrize(
    "compression", [None, rosbag1.Writer.CompressionFormat.BZ2, rosbag1.Writer.CompressionFormat.LZ4]
)
def test_ros1_bag(tmp_path, compression):
    recording = read(write_bag1(tmp_path / "log", compression))
    assert recording.format == "rosbag1"
    assert recording.findings == ()
    check(recording)
    assert "/joint_states.header.seq" in recording.channels


def test_ros1_log_time(tmp_path):
    recording = read(write_bag1(tmp_path / "log"), time="log")
    stamps = recording.channel("/joint_states.position[elbow]").stamps
    np.testing.assert_array_equal(stamps, START + 50_000 + np.arange(COUNT) * MS)
    assert recording.streams["/joint_states"].time_source == "log"


@pytest.mark.parametrize("fraction", [0.3, 0.6, 0.9])
def test_a_ros1_bag_that_was_cut_off(tmp_path, fraction):
    path = write_bag1(tmp_path / "log")
    raw = path.read_bytes()
    path.write_bytes(raw[: int(len(raw) * fraction)])
    recording = read(path)
    check(recording, recording.streams["/joint_states"].count)
    assert 0 < recording.streams["/joint_states"].count < COUNT
    assert "recording.index_cut_off" in codes(recording)


def test_a_ros1_bag_without_index(tmp_path):
    path = write_bag1(tmp_path / "log")
    raw = path.read_bytes()
    at = raw.index(b"index_pos=") + len(b"index_pos=")
    path.write_bytes(raw[:at] + bytes(8) + raw[at + 8 :])
    recording = read(path)
    check(recording)
    assert "recording.no_index" in codes(recording)


def test_a_ros1_bag_with_a_bad_chunk(tmp_path):
    path = write_bag1(tmp_path / "log", rosbag1.Writer.CompressionFormat.LZ4)
    raw = bytearray(path.read_bytes())
    at = raw.index(b"\x04\x22\x4d\x18", len(raw) // 2)  # lz4's magic
    raw[at : at + 4] = b"oops"
    path.write_bytes(raw)
    recording = read(path)
    assert 0 < recording.streams["/joint_states"].count < COUNT
    assert "recording.chunks_damaged" in codes(recording)


@pytest.mark.parametrize("compression", ["BZ2", "LZ4"])
def test_of_a_damaged_chunk_is_reported_which_it_is_and_what_it_cost(tmp_path, compression):
    path = write_bag1(tmp_path / "log", rosbag1.Writer.CompressionFormat[compression])
    with rosbag1.Reader(path) as bag:
        chunks = sorted(bag.chunk_infos, key=lambda chunk: chunk.pos)
    lost = sum(chunks[2].connection_counts.values())
    before = sum(sum(chunk.connection_counts.values()) for chunk in chunks[:2])
    raw = bytearray(path.read_bytes())
    end = raw.index(b"op=\x04", chunks[2].pos)  # its index
    raw[end - 200 : end - 100] = bytes(100)
    path.write_bytes(raw)
    recording = read(path)
    damage, loss = recording.findings
    assert (damage.code, damage.value, damage.evidence["chunks"]) == ("recording.chunks_damaged", 1, len(chunks))
    assert f"chunk 3 at byte {chunks[2].pos}: cannot be decompressed" in damage.evidence["where"]
    assert (loss.code, loss.value) == ("recording.messages_lost", lost)
    kept = np.r_[0:before, before + lost : COUNT]
    np.testing.assert_array_equal(recording.channel("/joint_states.position[elbow]").values, kept)


def test_a_damaged_chunk_of_a_bag_without_index(tmp_path):
    path = write_bag1(tmp_path / "log", rosbag1.Writer.CompressionFormat.LZ4)
    with rosbag1.Reader(path) as bag:
        chunks = sorted(bag.chunk_infos, key=lambda chunk: chunk.pos)
    raw = bytearray(path.read_bytes())
    end = raw.index(b"op=\x04", chunks[2].pos)
    raw[end - 200 : end - 100] = bytes(100)
    path.write_bytes(raw[: chunks[5].pos])
    assert "recording.loss_unknown" in codes(read(path))


def test_ros1_bags_of_another_version_are_refused(tmp_path):
    path = tmp_path / "log"
    path.write_bytes(b"#ROSBAG V1.2\nwhatever")
    with pytest.raises(ReadError, match="rosbag migrate"):
        read(path)


@pytest.mark.parametrize("storage", list(rosbag2.StoragePlugin))
@pytest.mark.parametrize("mode", [None, rosbag2.CompressionMode.FILE, rosbag2.CompressionMode.MESSAGE])
@pytest.mark.parametrize("version", [8, 9])
def test_ros2_bag(tmp_path, storage, mode, version):
    recording = read(write_bag2(tmp_path / "bag", storage, mode, version))
    assert recording.format == f"rosbag2-{storage.name.lower()}"
    check(recording)


@pytest.mark.parametrize("storage", list(rosbag2.StoragePlugin))
def test_a_single_file_of_a_ros2_bag(tmp_path, storage):
    folder = write_bag2(tmp_path / "bag", storage)
    (path,) = (path for path in folder.iterdir() if path.name != "metadata.yaml")
    recording = read(path)
    assert recording.format == ("mcap" if storage is rosbag2.StoragePlugin.MCAP else "rosbag2-sqlite3")
    check(recording)
    assert read(path, wanted=["/joint_states.position[knee]"]).channels.keys() == {"/joint_states.position[knee]"}


def test_a_ros2_bag_in_pieces_without_metadata(tmp_path):
    folder = tmp_path / "bag"
    folder.mkdir()
    for number in (10, 9, 2):
        joints_mcap(folder / f"bag_{number}", 10)
    (folder / "remark.txt").write_text("hello")
    recording = read(folder)
    assert recording.streams["/joint_states"].duplicates == 20  # the same ten messages in each file
    assert values_of(recording, "recording.no_file_list") == [3]


def test_a_folder_of_several_logs_is_no_bag(tmp_path):
    for name in ("walk.mcap", "run_0.mcap", "run_1.mcap"):
        joints_mcap(tmp_path / name, 10)
    with pytest.raises(ReadError, match=r"several logs.*run_0\.mcap, run_1\.mcap, walk\.mcap"):
        read(tmp_path)


@pytest.mark.parametrize("metadata", [True, False])
def test_logs_next_to_a_bag_are_named(tmp_path, metadata):
    joints_mcap(tmp_path / "run_0.mcap", 10)
    (tmp_path / "other.csv").write_text("time,a\n0,1\n1,2\n")
    if metadata:
        joints_mcap(tmp_path / "walk.mcap", 5)
        names = "  relative_file_paths:\n    - run_0.mcap\n"
        (tmp_path / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n{names}")
    recording = read(tmp_path)
    assert recording.streams["/joint_states"].count == 10
    (others,) = found(recording, "recording.other_logs")
    assert others.evidence["logs"] == ("other.csv, walk.mcap" if metadata else "other.csv")


def test_metadata_never_lead_out_of_the_folder(tmp_path):
    folder = tmp_path / "bag"
    folder.mkdir()
    joints_mcap(tmp_path / "outside", 10)
    joints_mcap(folder / "inside", 5)
    names = "  relative_file_paths:\n    - ../outside\n    - /etc/passwd\n    - ..\\inside\n"
    (folder / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n{names}")
    recording = read(folder)
    assert recording.streams["/joint_states"].count == 5
    assert values_of(recording, "recording.files_missing") == [2]


def test_a_broken_file_of_a_ros2_bag_does_not_hide_the_others(tmp_path):
    folder = write_bag2(tmp_path / "bag", rosbag2.StoragePlugin.MCAP)
    metadata = folder / "metadata.yaml"
    metadata.write_text(metadata.read_text().replace("- bag.mcap", "- bag.mcap\n  - empty.mcap"))
    (folder / "empty.mcap").write_bytes(b"")
    recording = read(folder)
    check(recording)
    (left_out,) = found(recording, "recording.file_left_out")
    assert (left_out.part, left_out.evidence["reason"]) == ("empty.mcap", "is empty")


def test_files_that_are_missing_by_their_numbers(tmp_path):
    for number in (0, 2, 3):
        joints_mcap(tmp_path / f"run_{number}.mcap", 10)
    assert values_of(read(tmp_path), "recording.files_missing") == [1]
    (tmp_path / "run_2.mcap").rename(tmp_path / "run_1.mcap")
    (tmp_path / "run_3.mcap").rename(tmp_path / "run_2.mcap")
    assert "recording.files_missing" not in codes(read(tmp_path))


@pytest.mark.parametrize("closed", ["bag_1.mcap", "metadata.yaml"])
def test_a_file_of_a_bag_that_may_not_be_read(tmp_path, monkeypatch, closed):
    for number in range(2):
        joints_mcap(tmp_path / f"bag_{number}.mcap", 10)
    names = "".join(f"    - bag_{number}.mcap\n" for number in range(2))
    (tmp_path / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n  relative_file_paths:\n{names}")
    sound = type(tmp_path).open

    def refuse(path, *args, **options):
        if path.name == closed:
            raise PermissionError(13, "Permission denied", str(path))
        return sound(path, *args, **options)

    monkeypatch.setattr(type(tmp_path), "open", refuse)
    recording = read(tmp_path)
    check(recording, 10)
    assert recording.streams["/joint_states"].duplicates == (0 if closed == "bag_1.mcap" else 10)
    code = "recording.file_left_out" if closed == "bag_1.mcap" else "recording.no_file_list"
    assert [one.part for one in found(recording, code)] == [closed]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "- 1\n",
        "rosbag2_bagfile_information:\n  version: 5\n",
        "a:\n  relative_file_paths: [other.db3]\n",
        "a: [b\n",
    ],
)
def test_metadata_that_name_no_file_do_not_hide_the_bag(tmp_path, text):
    folder = write_bag2(tmp_path / "bag", rosbag2.StoragePlugin.SQLITE3)
    (folder / "metadata.yaml").write_text(text)
    recording = read(folder)
    check(recording)
    assert values_of(recording, "recording.no_file_list") == [1]


def test_a_folder_with_metadata_only(tmp_path):
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    with pytest.raises(ReadError, match="no bag files"):
        read(tmp_path)


def test_a_database_with_a_log_of_changes_not_written_back(tmp_path):
    folder = write_bag2(tmp_path / "bag", rosbag2.StoragePlugin.SQLITE3)
    (path,) = (path for path in folder.iterdir() if path.name != "metadata.yaml")
    writer = sqlite3.connect(path)
    writer.execute("PRAGMA journal_mode=WAL")
    extra = serialised(joint_state(START + COUNT * MS, ["elbow", "knee"], [COUNT, -COUNT]))
    writer.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)", (START + COUNT * MS, extra))
    writer.commit()
    check(read(path), COUNT + 1)
    writer.close()


@pytest.fixture
def unfinished(tmp_path, request):
    """A bag whose recorder was killed: part of it is in a log of changes."""
    left = ("", "-wal", *getattr(request, "param", ()))
    folder = write_bag2(tmp_path / "bag", rosbag2.StoragePlugin.SQLITE3)
    (path,) = (path for path in folder.iterdir() if path.name != "metadata.yaml")
    writer = sqlite3.connect(path)
    writer.execute("PRAGMA journal_mode=WAL")
    for i in (COUNT, COUNT + 1):
        extra = serialised(joint_state(START + i * MS, ["elbow", "knee"], [i, -i]))
        writer.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)", (START + i * MS, extra))
    writer.commit()
    killed = tmp_path / "killed"
    killed.mkdir()
    for ending in left:
        shutil.copy(f"{path}{ending}", killed / f"{path.name}{ending}")
    writer.close()
    return killed / path.name


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.parametrize("unfinished", [(), ("-shm",)], indirect=True)
@pytest.mark.parametrize("how", ["alone", "folder", "sample", "repaired", "read-only"])
def test_nothing_is_left_next_to_a_database(unfinished, monkeypatch, how):
    folder, before = unfinished.parent, contents(unfinished.parent)
    assert f"{unfinished.name}-wal" in before
    if how == "sample":
        monkeypatch.setattr(sampling, "LOOK_BYTES", 2 * 4000)
        recording, sample = sampling.read_sample(unfinished)
        assert sample is not None
        stamps = recording.channel("/joint_states.position[elbow]").stamps
        assert stamps[-1] == START + (COUNT + 1) * MS  # which is in the log of changes
    elif how == "repaired":
        repair(unfinished, folder.parent / "out.mcap")
        check(read(folder.parent / "out.mcap"), COUNT + 2)
    elif how == "read-only":
        for path in (*folder.iterdir(), folder):
            path.chmod(0o555 if path.is_dir() else 0o444)
        check(read(unfinished), COUNT + 2)
    else:
        check(read(folder if how == "folder" else unfinished), COUNT + 2)
    assert contents(folder) == before


def test_a_database_whose_log_of_changes_is_gone(unfinished):
    unfinished.with_name(f"{unfinished.name}-wal").unlink()
    before = contents(unfinished.parent)
    check(read(unfinished))
    assert contents(unfinished.parent) == before


def test_a_database_that_is_being_written(tmp_path):
    """The files that the writer has next to it stay as they are, and it can go on."""
    folder = write_bag2(tmp_path / "bag", rosbag2.StoragePlugin.SQLITE3)
    (path,) = (path for path in folder.iterdir() if path.name != "metadata.yaml")
    writer = sqlite3.connect(path)
    writer.execute("PRAGMA journal_mode=WAL")
    for i in range(COUNT, COUNT + 3):
        extra = serialised(joint_state(START + i * MS, ["elbow", "knee"], [i, -i]))
        writer.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)", (START + i * MS, extra))
        writer.commit()
        names = set(contents(folder))
        check(read(path), i + 1)
        assert set(contents(folder)) == names
    writer.close()


def test_a_damaged_database_gives_the_rest(tmp_path):
    folder = write_bag2(tmp_path / "bag", rosbag2.StoragePlugin.SQLITE3)
    (path,) = (path for path in folder.iterdir() if path.name != "metadata.yaml")
    raw = bytearray(path.read_bytes())
    page = 4096 * (len(raw) // 4096 // 2)
    raw[page : page + 4096] = b"\xa5" * 4096
    path.write_bytes(raw)
    recording = read(path)
    assert COUNT / 2 < recording.streams["/joint_states"].count < COUNT
    assert "recording.rows_unreadable" in codes(recording)


def test_a_database_that_is_no_bag(tmp_path):
    path = tmp_path / "db"
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE x(a)")
    with pytest.raises(ReadError, match="no ROS 2 bag"):
        read(path)


def test_catalogue_of_a_bag(tmp_path):
    path = write_bag1(tmp_path / "log")
    assert list(open_reader(path).catalogue().channels) == list(read(path).channels)
