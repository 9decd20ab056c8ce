"""Types of Parquet columns, and what Arrow adds to the footer to tell them."""

from __future__ import annotations

import base64
from decimal import Decimal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from finding_codes import codes

from vsalog.readers import parquet_rows, read
from vsalog.readers.limits import BLOCK_ROWS
from vsalog.readers.parquet_rows import ParquetRows

START = 1_700_000_000_123_000_000
N = 300
ISO = [f"2024-01-02T03:04:05.{i:03d}" for i in range(N)]
SECONDS = [Decimal(START + i * 10**6) / 10**9 for i in range(N)]
STAMPS = np.arange(START, START + N * 10**6, 10**6)


@pytest.mark.parametrize(
    ("times", "begin"),
    [
        (pa.array(SECONDS, pa.decimal128(20, 9)), START),
        (pa.array(SECONDS, pa.decimal256(50, 9)), START),
        (pa.array(ISO).dictionary_encode(), 1_704_164_645 * 10**9),
        (pa.array(ISO, pa.string_view()), 1_704_164_645 * 10**9),
        (pa.array(ISO, pa.large_string()), 1_704_164_645 * 10**9),
        (pa.array(np.arange(N) / 1000).dictionary_encode(), 0),
        (pa.array([f"{i / 1000:.3f}" for i in range(N)]).dictionary_encode(), 0),
        (pa.array(STAMPS, pa.timestamp("ns", "Europe/Berlin")), START),
        (pa.array(STAMPS // 1000, pa.timestamp("us", "+05:30")), START),
        (pa.array(STAMPS, pa.timestamp("ns")).dictionary_encode(), START),
        (pa.array(STAMPS.astype(np.uint64)), START),
    ],
)
def test_clocks_of_every_type(tmp_path, times, begin):
    pq.write_table(pa.table({"time": times, "x": np.arange(N) * 1.0}), tmp_path / "log.parquet")
    channel = read(tmp_path / "log.parquet").channels["x"]
    np.testing.assert_array_equal(channel.stamps, begin + np.arange(N) * 10**6)
    np.testing.assert_array_equal(channel.values, np.arange(N))


@pytest.mark.parametrize(
    "cells",
    [
        pa.array([Decimal(i) / 4 for i in range(N)], pa.decimal128(30, 10)),
        pa.array([Decimal(i) / 4 for i in range(N)], pa.decimal256(50, 10)),
        pa.array(np.arange(N) / 4).dictionary_encode(),
        pa.array([f"{i / 4}" for i in range(N)]).dictionary_encode(),
        pa.array([f"{i / 4}" for i in range(N)], pa.string_view()),
        pa.array([f"{i / 4}" for i in range(N)], pa.large_string()),
        pa.array((np.arange(N) / 4).astype(np.float16)),
    ],
)
def test_values_of_every_type(tmp_path, cells):
    pq.write_table(pa.table({"time": np.arange(N) / 1000, "x": cells}), tmp_path / "log.parquet")
    np.testing.assert_array_equal(read(tmp_path / "log.parquet").channels["x"].values, np.arange(N) / 4)


def test_what_is_no_number_says_of_what_type_it_is(tmp_path):
    columns = {
        "time": np.arange(N) / 1000,
        "x": np.arange(N) * 1.0,
        "raw": pa.array([b"1"] * N),
        "word": pa.array(["on"] * N).dictionary_encode(),
        "nothing": pa.nulls(N),
    }
    pq.write_table(pa.table(columns), tmp_path / "log.parquet")
    assert read(tmp_path / "log.parquet").unread == {
        "raw": "column of type binary",
        "word": "text",
        "nothing": "column of type null",
    }


@pytest.mark.parametrize("where", [0.1, 0.3, 0.5, 0.7, 0.9])
@pytest.mark.parametrize("new", [b"!", b"\xff"])
def test_a_byte_that_changed_in_arrows_words_on_the_columns_loses_only_these(tmp_path, where, new):
    """They say again what the footer says; without them there are no units, and a duration is a plain number."""
    fields = [pa.field("time", pa.float64()), pa.field("x", pa.float64(), metadata={"unit": "rad"})]
    table = pa.table([pa.array(np.arange(N) / 1000), pa.array(np.arange(N) * 1.0)], schema=pa.schema(fields))
    path = tmp_path / "log.parquet"
    pq.write_table(table, path)
    raw = bytearray(path.read_bytes())
    told = base64.b64encode(table.schema.serialize())[:-4]
    begin = raw.rindex(b"ARROW:schema") + 16
    place = begin + int(where * len(told))
    raw[place : place + 1] = new
    path.write_bytes(raw)
    log = read(path)
    np.testing.assert_array_equal(log.channels["x"].values, np.arange(N))
    np.testing.assert_array_equal(log.channels["x"].stamps, np.arange(N) * 10**6)
    assert log.channels["x"].unit is None
    assert "recording.footer_damaged" in codes(log)


@pytest.mark.parametrize("order", [[0, 1], [1, 0]])
def test_a_list_and_a_number_of_one_name(tmp_path, order):
    fields = [pa.field("x", pa.list_(pa.float64())), pa.field("x", pa.float64())]
    cells = [pa.array([[1.0, 2.0]] * N), pa.array(np.arange(N) * 1.0)]
    table = pa.table(
        [pa.array(np.arange(N) / 1000), *(cells[i] for i in order)],
        schema=pa.schema([pa.field("time", pa.float64()), *(fields[i] for i in order)]),
    )
    pq.write_table(table, tmp_path / "log.parquet")
    log = read(tmp_path / "log.parquet")
    np.testing.assert_array_equal(log.channels["x"].values, np.arange(N))
    np.testing.assert_array_equal(log.channels["x[1]"].values, np.full(N, 2.0))


@pytest.mark.parametrize("kind", [pa.decimal128(20, 12), pa.decimal256(40, 12)])
def test_decimals_are_rounded_once(tmp_path, kind):
    numbers = [Decimal(int(i)).scaleb(-12) for i in np.random.default_rng(4).integers(-(10**18), 10**18, N)]
    pq.write_table(pa.table({"time": np.arange(N) / 1000, "x": pa.array(numbers, kind)}), tmp_path / "log.parquet")
    assert read(tmp_path / "log.parquet").channels["x"].values.tolist() == [float(number) for number in numbers]


def test_an_hour_at_rest(tmp_path):
    """Columns that stay the same are packed into next to nothing; they are no bomb."""
    many = 1_600_000
    columns = {"time": START + 2_000_000 * np.arange(many)} | {f"q{i}": np.full(many, i / 8) for i in range(21)}
    rest = [name for name in columns if name != "time"]
    options = {"use_dictionary": rest, "column_encoding": {"time": "DELTA_BINARY_PACKED"}}
    pq.write_table(pa.table(columns), tmp_path / "log", compression="zstd", **options)
    assert (tmp_path / "log").stat().st_size < 2**20
    found = read(tmp_path / "log").channel("q3")
    assert found.stamps[-1] == columns["time"][-1]
    assert (found.values == 0.375).all()


def test_equal_numbers_take_no_more_memory_at_once_than_others(tmp_path, monkeypatch):
    """The footer counts a byte or so of a page whose numbers are all the same."""
    columns = {f"x{k}": np.zeros(100_000) for k in range(20)}
    pq.write_table(pa.table({"time": np.arange(100_000) / 1e3, **columns}), tmp_path / "log.parquet")
    monkeypatch.setattr(parquet_rows, "AT_ONCE_BYTES", 2**22)
    rows = ParquetRows(tmp_path / "log.parquet")
    assert max(rows.unpacked) < 2**22
    sizes = [batch.num_rows for _, batch in rows.batches(rows.schema.names, {"time"})]
    assert sum(sizes) == 100_000
    assert max(sizes) <= BLOCK_ROWS
