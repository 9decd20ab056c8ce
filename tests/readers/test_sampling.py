"""Samples of large logs: what they hold is what the whole log holds there."""

from __future__ import annotations

import gzip
import shutil
import struct
from contextlib import suppress

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from finding_codes import codes
from rosbags.rosbag1 import Writer as Rosbag1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer
from write_logs import JOINT_STATE, MS, START, STORES, McapLog, joint_state, joints_mcap, serialised

from vsalog.core.errors import ReadError
from vsalog.readers import read, sampling, sampling_pieces

ROWS = 12_000
BUDGET = 10_000


@pytest.fixture(autouse=True)
def small(monkeypatch):
    """Make everything a large log."""
    monkeypatch.setattr(sampling, "LOOK_BYTES", 2 * BUDGET)


def bag(path, ros1):
    rng = np.random.default_rng(1)
    writer = Rosbag1Writer(path) if ros1 else Rosbag2Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
    if ros1:
        writer.chunk_threshold = 4000
    with writer:
        connection = writer.add_connection("/j", JOINT_STATE, typestore=STORES[ros1])
        for i in range(ROWS // 4):
            stamp = START + i * MS
            writer.write(
                connection, stamp, serialised(joint_state(stamp, ["a"], rng.standard_normal(1), ros1=ros1), ros1)
            )
    return path


def mcap(path, **options):
    return joints_mcap(path, ROWS // 4, chunk_size=4000, **options)


def csv(path):
    rng = np.random.default_rng(1)
    values = rng.standard_normal(ROWS)
    path.write_text("time [s],q [rad]\n" + "".join(f"{i}e-3,{v!r}\n" for i, v in enumerate(values.tolist())))
    return path


def parquet(path):
    table = pa.table({"time": np.arange(ROWS) / 1000, "q": np.random.default_rng(1).standard_normal(ROWS)})
    pq.write_table(table, path, row_group_size=100, compression="none")
    return path


LOGS = {
    "mcap": mcap,
    "rosbag1": lambda path: bag(path, True),
    "sqlite": lambda path: next(bag(path, False).glob("*.db3")),
    "folder": lambda path: bag(path, False),
    "csv": csv,
    "parquet": parquet,
}


def is_part_of(part, whole):
    """Tell that a recording holds the values of another at its stamps, from the first to the last of these."""
    assert part.channels.keys() == whole.channels.keys()
    for name, channel in part.channels.items():
        full = whole.channel(name)
        rows = np.searchsorted(full.stamps, channel.stamps)
        np.testing.assert_array_equal(full.stamps[rows], channel.stamps)
        np.testing.assert_array_equal(full.values[rows], channel.values)
        assert (channel.unit, channel.stream) == (full.unit, full.stream)
        assert rows[0] == 0
        yield name, rows, full


@pytest.mark.parametrize("kind", LOGS)
def test_a_sample_is_stretches_of_the_log_from_its_begin_to_its_end(tmp_path, kind):
    path = LOGS[kind](tmp_path / "log")
    part, sample = sampling.read_sample(path)
    assert sample is not None
    assert sample.of > 4 * BUDGET
    assert sample.size < sample.of / 2
    assert part.path == path
    assert part.findings == ()
    whole = read(path)
    for _, rows, full in is_part_of(part, whole):
        assert rows[-1] == full.stamps.size - 1
        assert np.count_nonzero(np.diff(rows) > 1) == sample.stretches - 1 == 7
        assert sample.totals.get(full.stream, full.stamps.size) == full.stamps.size
    if kind in ("mcap", "rosbag1", "parquet"):
        assert sample.totals
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log"]


@pytest.mark.parametrize("kind", LOGS)
def test_a_small_log_is_read_as_a_whole(tmp_path, monkeypatch, kind):
    monkeypatch.setattr(sampling, "LOOK_BYTES", 2 * 2**25)
    path = LOGS[kind](tmp_path / "log")
    part, sample = sampling.read_sample(path)
    assert sample is None
    for _, rows, full in is_part_of(part, read(path)):
        assert rows.size == full.stamps.size


def test_without_chunks_the_beginning_is_read(tmp_path):
    path = mcap(tmp_path / "log", use_chunking=False)
    part, sample = sampling.read_sample(path)
    assert sample is not None
    assert sample.stretches == 1
    for _, rows, _full in is_part_of(part, read(path)):
        assert 50 < rows.size < 500
        assert (np.diff(rows) == 1).all()


def test_what_cannot_be_read_from_the_middle_is_read_from_its_beginning(tmp_path):
    plain = csv(tmp_path / "plain")
    rows = plain.read_text()
    zipped, no_time, wide = tmp_path / "zipped", tmp_path / "no_time", tmp_path / "wide"
    zipped.write_bytes(gzip.compress(rows.encode(), 1))
    no_time.write_text("\n".join(row.partition(",")[2] for row in rows.splitlines()))
    wide.write_bytes(rows.encode("utf-16"))
    for path in (zipped, no_time, wide):
        part, sample = sampling.read_sample(path)
        assert sample is not None
        assert sample.stretches == 1
        for _, found, _full in is_part_of(part, read(path)):
            assert 100 < found.size < ROWS / 2
            assert (np.diff(found) == 1).all()


def test_a_log_that_was_cut_off_has_samples_up_to_its_end(tmp_path):
    path = mcap(tmp_path / "log")
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
    part, sample = sampling.read_sample(path)
    assert sample is not None
    assert "recording.no_summary" in codes(part)
    whole = read(path)
    for _, rows, full in is_part_of(part, whole):
        assert rows[-1] >= full.stamps.size - 50


def test_a_bag_without_an_index(tmp_path):
    path = bag(tmp_path / "log", True)
    raw = bytearray(path.read_bytes())
    at = raw.index(b"index_pos=") + len(b"index_pos=")
    raw[at : at + 8] = bytes(8)
    path.write_bytes(raw)
    part, sample = sampling.read_sample(path)
    assert sample is not None
    assert "recording.no_index" in codes(part)
    for _, rows, full in is_part_of(part, read(path)):
        assert rows[-1] == full.stamps.size - 1


@pytest.mark.parametrize("kind", LOGS)
def test_damage_is_no_crash(tmp_path, kind):
    path = LOGS[kind](tmp_path / "log")
    files = [path] if path.is_file() else sorted(path.iterdir())
    sound = {file: file.read_bytes() for file in files}
    rng = np.random.default_rng(2)
    for k in range(9):
        for file, content in sound.items():
            raw = bytearray(content)
            if k % 3 == 0:
                del raw[int(rng.integers(len(raw))) :]
            for at in rng.integers(max(len(raw), 1), size=4).tolist() if raw else ():
                raw[at] ^= int(rng.integers(1, 256))
            if k % 3 == 1:  # where indexes are
                at = len(raw) - 9 - int(rng.integers(300))
                raw[at : at + 8] = struct.pack("<Q", int(rng.integers(2**63)))
            file.write_bytes(raw)
        with suppress(ReadError):
            sampling.read_sample(path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log"]


def test_damage_within_a_sample_names_the_log(tmp_path, monkeypatch):
    path = csv(tmp_path / "log")

    def broken(source, target, budget):
        shutil.copyfile(source, target)
        target.write_bytes(b"PAR1" + bytes(100))
        return sampling_pieces.Sample(1, 1)

    monkeypatch.setattr(sampling, "CUTTERS", {"table": broken})
    with pytest.raises(ReadError) as caught:
        sampling.read_sample(path)
    assert str(path) in str(caught.value)


def test_the_rig_is_in_the_sample(tmp_path):
    log = McapLog(chunk_size=4000)
    log.writer.add_metadata("vsalog.rig", {"toml": "preset = 'sea'"})
    for i in range(5000):
        log.add("/j", joint_state(START + i * MS, ["a"], [i]), START + i * MS)
    part, sample = sampling.read_sample(log.save(tmp_path / "log"))
    assert sample is not None
    assert part.rig_text == "preset = 'sea'"
