"""Parquet and MATLAB files."""

from __future__ import annotations

import datetime
import re

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

from vsalog.errors import ReadError
from vsalog.readers import open_reader, read
from vsalog.readers.parquet_pages import page_sizes

START = 1_700_000_000_123_456_789


def parquet(tmp_path, columns, units=None, name="log.parquet", **options):
    fields = []
    for column, array in columns.items():
        metadata = {"unit": units[column]} if units and column in units else None
        fields.append(pa.field(column, array.type, metadata=metadata))
    pq.write_table(pa.table(list(columns.values()), schema=pa.schema(fields)), tmp_path / name, **options)
    return tmp_path / name


def test_columns_types_and_units(tmp_path):
    columns = {
        "stamp": pa.array(START + np.arange(4) * 1_000_000),
        "time": pa.array(np.arange(4) * 1e-3),
        "q": pa.array([1.5, None, float("nan"), 4.5]),
        "n [N*m]": pa.array([1, 2, 3, 4], pa.int32()),
        "on": pa.array([True, False, True, True]),
        "mode": pa.array(["a", "b", "c", "d"]),
        "list": pa.array([[1], [2], [3], [4]]),
    }
    path = parquet(tmp_path, columns, {"stamp": "ns", "q": "rad"})
    recording = read(path)
    assert recording.format == "parquet"
    assert list(recording.channels) == ["time", "q", "n", "on"]
    np.testing.assert_array_equal(recording.channel("q").values, [1.5, np.nan, np.nan, 4.5])
    np.testing.assert_array_equal(recording.channel("q").stamps, START + np.arange(4) * 1_000_000)
    assert recording.channel("q").unit == "rad"
    assert recording.channel("n").unit == "N*m"
    assert recording.unread["mode"] == "text"
    assert "list" in recording.unread["list"]
    assert recording.absolute_time
    assert list(read(path, wanted=["on"]).channels) == ["on"]
    assert list(open_reader(path).catalogue().channels) == list(recording.channels)


@pytest.mark.parametrize(
    ("kind", "factor"),
    [(pa.timestamp("ms"), 1_000_000), (pa.timestamp("ns", "Europe/Berlin"), 1), (pa.duration("us"), 1000)],
)
def test_time_types(tmp_path, kind, factor):
    times = pa.array(np.arange(1, 5) * 5).cast(kind)
    recording = read(parquet(tmp_path, {"time": times, "x": pa.array([1.0, 2.0, 3.0, 4.0])}))
    assert recording.channel("x").stamps.tolist() == [5 * factor, 10 * factor, 15 * factor, 20 * factor]


def test_time_as_dates_with_gaps(tmp_path):
    when = datetime.datetime(2024, 1, 1)
    times = pa.array([when, None, when + datetime.timedelta(seconds=1)])
    recording = read(parquet(tmp_path, {"time": times, "x": pa.array([1.0, 2.0, 3.0])}))
    assert recording.channel("x").values.tolist() == [1, 3]
    assert any("1 row without a time" in note for note in recording.notes)


@pytest.mark.filterwarnings("error")
def test_a_time_that_is_a_signalling_nan_is_none(tmp_path):
    times = np.array([0.1, 0.2, 0.3, 0.4])
    times[1:2] = np.frombuffer(b"\1\0\0\0\0\0\xf0\x7f")
    recording = read(parquet(tmp_path, {"time [s]": pa.array(times), "x": pa.array([1.0, 2.0, 3.0, 4.0])}))
    assert recording.channel("x").values.tolist() == [1, 3, 4]


def test_a_trace_of_several_parts_is_several_streams(tmp_path):
    columns = {
        "stamp": pa.array(np.repeat(np.arange(3) * 1_000_000, 2)),
        "joint": pa.array(["elbow"] * 6).dictionary_encode(),
        "transmission": pa.array(["agonist", "antagonist"] * 3),
        "stiffness": pa.array([1.0, 10.0, 2.0, 20.0, 3.0, 30.0]),
    }
    recording = read(parquet(tmp_path, columns, {"stamp": "ns", "stiffness": "N*m/rad"}))
    assert recording.channel("stiffness[elbow.agonist]").values.tolist() == [1, 2, 3]
    assert recording.channel("stiffness[elbow.antagonist]").values.tolist() == [10, 20, 30]
    assert recording.channel("stiffness[elbow.agonist]").unit == "N*m/rad"
    assert recording.notes == ()


def test_many_row_groups_and_no_time(tmp_path):
    path = parquet(tmp_path, {"x": pa.array(np.arange(1000.0))}, row_group_size=100)
    recording = read(path, rate=1000)
    np.testing.assert_array_equal(recording.channel("x").values, np.arange(1000))
    np.testing.assert_array_equal(recording.channel("x").stamps, np.arange(1000) * 1_000_000)
    assert read(path).streams["log"].time_source == "none"


def test_a_cut_off_parquet_file_is_refused(tmp_path):
    path = parquet(tmp_path, {"x": pa.array(np.arange(1000.0))})
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(ReadError, match="Parquet"):
        read(path)


def test_structures_with_their_clocks(tmp_path):
    t = np.arange(50) / 1000
    content = {
        "DEVICE": {
            "x00": {"timeJIM": t[:, None], "angle": np.sin(t)[None, :], "torque": t * 2, "label": "soft"},
            "x10": {"time": t * 2, "torque": t * 3, "setting": 10.0},
        },
        "curve": np.arange(7.0),
        "table": np.arange(40.0).reshape(2, 20),
        "image": np.zeros((100, 200)),
        "spectrum": np.array([1j, 2j]),
    }
    path = tmp_path / "log.mat"
    savemat(path, content)
    recording = read(path)
    assert recording.format == "matlab"
    torque = recording.channel("DEVICE.x00.torque")
    np.testing.assert_array_equal(torque.values, t * 2)
    np.testing.assert_array_equal(torque.stamps, np.arange(50) * 1_000_000)
    assert torque.stream == "DEVICE.x00"
    assert recording.streams["DEVICE.x00"].time_source == "column"
    np.testing.assert_array_equal(recording.channel("DEVICE.x10.torque").stamps, np.arange(50) * 2_000_000)
    assert recording.unread["DEVICE.x00.label"] == "text"
    assert recording.unread["DEVICE.x10.setting"] == "a single value"
    assert recording.unread["image"] == "array of 100 values"
    assert recording.unread["spectrum"] == "complex numbers"
    np.testing.assert_array_equal(recording.channel("table[1]").values, np.arange(20, 40))
    assert recording.streams["log (7 values)"].time_source == "none"
    assert read(path, rate=10.0).streams["log (7 values)"].time_source == "rate"
    assert list(read(path, wanted=["curve"]).channels) == ["curve"]
    assert list(open_reader(path).catalogue().channels) == list(recording.channels)


def test_a_clock_serves_the_structures_below(tmp_path):
    t = np.arange(20) / 100
    signals = np.array([{"values": t + 1}, {"values": t + 2}], dtype=object)
    savemat(tmp_path / "log", {"out": {"time": t, "signals": signals}}, appendmat=False)
    recording = read(tmp_path / "log")
    channel = recording.channel("out.signals[1].values")
    np.testing.assert_array_equal(channel.values, t + 2)
    np.testing.assert_array_equal(channel.stamps, np.arange(20) * 10_000_000)


def test_a_cell_array_is_a_stream_of_its_own(tmp_path):
    cells = np.empty(2, dtype=object)
    cells[0], cells[1] = np.arange(30.0), np.arange(30.0) * 2
    savemat(tmp_path / "log", {"x": np.arange(7.0), "cells": cells}, appendmat=False)
    recording = read(tmp_path / "log")
    found = {name: (c.values.tolist(), c.stream) for name, c in recording.channels.items()}
    assert found == {
        "x": (list(range(7)), "log"),
        "cells[0]": (list(range(30)), "cells"),
        "cells[1]": (list(range(0, 60, 2)), "cells"),
    }


def test_time_that_does_not_rise_is_a_channel(tmp_path):
    savemat(tmp_path / "log", {"time": np.zeros(5), "x": np.arange(5.0)}, appendmat=False)
    recording = read(tmp_path / "log")
    assert list(recording.channels) == ["time", "x"]
    assert any("--rate" in note for note in recording.notes)


def test_a_cut_off_matlab_file_is_refused(tmp_path):
    path = tmp_path / "log"
    savemat(path, {"x": np.random.default_rng(1).random(1000)}, appendmat=False)
    path.write_bytes(path.read_bytes()[:-500])
    with pytest.raises(ReadError, match="damaged"):
        read(path)


def damaged(raw, rng, k):
    """Return a file with a byte changed, or cut off."""
    bad = bytearray(raw)
    if k % 4 == 0:
        return bad[: int(rng.integers(len(bad)))]
    bad[int(rng.integers(len(bad)))] ^= int(rng.integers(1, 256))
    return bad


def numbers(path):
    return {
        name: dict(zip(c.stamps.tolist(), c.values.tolist(), strict=True)) for name, c in read(path).channels.items()
    }


def write_parquet(path, t, x):
    table = pa.table({"time": t, "x": x, "y": np.round(x, 3)})
    pq.write_table(table, path, row_group_size=100, write_page_checksum=True)


def write_matlab(path, t, x):
    content = {"one": {"time": t, "x": x, "in": {"time": t, "y": -x}}, "two": {"time": t, "z": x + 1}}
    savemat(path, content, do_compression=True, appendmat=False)


@pytest.mark.parametrize("write", [write_parquet, write_matlab])
def test_damage_is_no_crash_and_no_wrong_value(tmp_path, write):
    """Both have checksums: what does not match is left out, and the rest is read."""
    rng = np.random.default_rng(1)
    path = tmp_path / "log"
    write(path, np.arange(1000) / 1000, rng.standard_normal(1000))
    raw, sound = path.read_bytes(), numbers(path)
    most = 0
    for k in range(150):
        path.write_bytes(damaged(raw, rng, k))
        try:
            found = numbers(path)
        except ReadError:
            continue
        for name in found.keys() & sound.keys():
            assert found[name].items() <= sound[name].items()
        kept = sum(len(found[name]) for name in found.keys() & sound.keys())
        most += 0.3 < kept / sum(map(len, sound.values())) < 1
    assert most > 30  # of which a part was damaged, and the rest read


def test_pages_that_are_no_longer_taken_for_some_are_missed(tmp_path, monkeypatch):
    path = parquet(tmp_path, {"time [s]": pa.array(np.arange(30.0)), "x": pa.array(np.arange(30.0))}, row_group_size=10)
    own = pq.ParquetFile.iter_batches
    monkeypatch.setattr(pq.ParquetFile, "iter_batches", lambda *a, **k: (batch[:8] for batch in own(*a, **k)))
    assert "6 rows of those that the file counts were not found" in read(path).notes


def test_a_name_that_is_no_text_is_refused(tmp_path):
    path = parquet(tmp_path, {"time [s]": pa.array([0.0, 1.0]), "xyz": pa.array([1.0, 2.0])}, store_schema=False)
    path.write_bytes(path.read_bytes().replace(b"xyz", b"\xd6\xd6\xd6"))
    with pytest.raises(ReadError, match="cannot be read"):
        read(path)


def test_a_damaged_row_group_moves_no_row(tmp_path):
    path = tmp_path / "log"
    pq.write_table(
        pa.table({"x": np.arange(1000.0)}), path, row_group_size=100, write_page_checksum=True, compression="none"
    )
    raw = bytearray(path.read_bytes())
    raw[raw.index(np.float64(350).tobytes())] ^= 1
    path.write_bytes(raw)
    recording = read(path, rate=1000.0)
    channel = recording.channel("x")
    np.testing.assert_array_equal(channel.stamps, channel.values.astype(np.int64) * 1_000_000)
    assert channel.values.size == 900
    assert any("1 of 10 row groups damaged" in note for note in recording.notes)


def test_a_matlab_bomb_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("vsalog.readers.matlab_v5.MAX_BYTES", 2**20)
    path = tmp_path / "log"
    savemat(path, {"zeros": np.zeros(1_000_000), "x": np.arange(9.0)}, do_compression=True, appendmat=False)
    assert path.stat().st_size < 2**14
    recording = read(path)
    assert list(recording.channels) == ["x"]
    assert any("larger than any recording" in note for note in recording.notes)


def test_rows_of_a_stream_do_not_depend_on_what_else_is_read(tmp_path):
    """A row is there for a stream where any of its columns has a sample, even one that nobody asks for."""
    cells = {"a.x": [1.0, None, 3.0, None], "a.y": [1.0, 2.0, None, None], "b.z": [None, None, None, 4.0]}
    fields = [pa.field(name, pa.float64(), metadata={"stream": name[0]}) for name in cells]
    schema = pa.schema([pa.field("time", pa.int64(), metadata={"unit": "ns"}), *fields])
    path = tmp_path / "log"
    pq.write_table(pa.table([pa.array(range(4)), *map(pa.array, cells.values())], schema=schema), path)
    together = read(path)
    assert together.channel("a.x").stamps.tolist() == together.channel("a.y").stamps.tolist() == [0, 1, 2]
    assert together.channel("b.z").stamps.tolist() == [3]
    for name, channel in together.channels.items():
        alone = read(path, wanted=[name]).channel(name)
        np.testing.assert_array_equal(alone.stamps, channel.stamps)
        np.testing.assert_array_equal(alone.values, channel.values)


@pytest.mark.parametrize(
    "options",
    [
        {"compression": "zstd"},
        {"compression": "snappy", "use_dictionary": False, "data_page_size": 4096},
        {"compression": "gzip", "data_page_version": "2.0", "write_page_checksum": True, "write_page_index": True},
        {"compression": "none", "store_decimal_as_integer": True},
    ],
)
def test_what_pages_announce_adds_up_to_what_the_footer_says(tmp_path, options):
    rng, path = np.random.default_rng(1), tmp_path / "log"
    texts = pa.array(["x" * int(k) for k in rng.integers(0, 2000, 3000)])  # of which the statistics are long
    table = pa.table({"a": rng.standard_normal(3000), "b": np.arange(3000) % 2 == 0, "c": texts})
    pq.write_table(table, path, row_group_size=1000, **options)
    metadata = pq.ParquetFile(path).metadata
    with path.open("rb") as file:
        for column in (metadata.row_group(k).column(i) for k in range(3) for i in range(3)):
            sizes = np.array(list(page_sizes(file, column)))
            heads = column.total_compressed_size - sizes[:, 1].sum()
            assert 0 < heads < 5000 * len(sizes)
            assert sizes[:, 0].sum() + heads == column.total_uncompressed_size


def lying(path):
    """Write a column that a page of 300 MiB is in, and a footer in which it has a thousand bytes."""
    table = pa.table({"time": [0.0, 1.0], "x": [1.0, 2.0], "b": pa.array([bytes(300 * 2**20), b""], pa.binary())})
    pq.write_table(table, path, compression="zstd", use_dictionary=False)
    raw = bytearray(path.read_bytes())
    footer = len(raw) - 8 - int.from_bytes(raw[-8:-4], "little")
    group = pq.ParquetFile(path).metadata.row_group(0)
    for said in (group.column(2).total_uncompressed_size, group.total_byte_size):
        for at in [m.start() for m in re.finditer(re.escape(varint(said)), bytes(raw)) if m.start() > footer]:
            raw[at : at + 5] = varint(1000, 5)
    path.write_bytes(raw)


def varint(number, size=0):
    """Return a number as Thrift's compact protocol writes it, in so many bytes at least."""
    number *= 2
    out = bytearray()
    while number > 127 or len(out) < size - 1:
        out.append(number & 127 | 128)
        number >>= 7
    return bytes([*out, number])


def test_a_footer_that_lies_about_a_page(tmp_path):
    path = tmp_path / "log"
    lying(path)
    assert pq.ParquetFile(path).metadata.row_group(0).total_byte_size == 1000
    with pytest.raises(ReadError, match=r"a page of column 'b' announces 3145728\d\d bytes out of"):
        read(path)
