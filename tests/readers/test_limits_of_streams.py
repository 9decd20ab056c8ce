"""Streams, files and queries, on both sides of what any recording has: what is together, damaged, or more than is read."""

import gzip
import sqlite3

import numpy as np
import pytest

from vsalog.core.errors import ReadError
from vsalog.readers.columns_together import together
from vsalog.readers.container import Connection
from vsalog.readers.sqlite_ranges import ranges
from vsalog.readers.tables.source import open_text
from vsalog.readers.topic_streams import _refuse_absurd

MI = 2**20


@pytest.mark.parametrize(("shared", "groups"), [(80, 1), (70, 2)])
def test_values_come_together_in_three_of_four_messages(shared, groups):
    rows = np.arange(200)  # in a hundred of which either is
    a, b = rows < 50 + shared // 2, (rows >= 50 - shared // 2) & (rows < 100)
    carried = {"a": np.packbits(a), "b": np.packbits(b)}
    assert len(together(["a", "b"], carried, 200)) == groups


@pytest.mark.parametrize(("count", "good"), [(2**14, True), (2**14 + 1, False)])
def test_a_log_has_16384_topics(count, good):
    named = [(Connection(k, f"/t{k}", "a/T", "cdr", "msg", ""), f"/t{k}") for k in range(count)]
    if good:
        _refuse_absurd(named)
    else:
        with pytest.raises(ReadError):
            _refuse_absurd(named)


@pytest.mark.parametrize(("times", "good"), [(70, True), (140, False)])
def test_a_table_becomes_ten_times_smaller_and_not_a_hundred(tmp_path, times, good):
    path, size = tmp_path / "log.csv.gz", 300_000
    noise = np.random.default_rng(0).integers(0, 256, size, np.uint8).tobytes()
    path.write_bytes(gzip.compress(noise, 1) + gzip.compress(bytes((times - 1) * size), 9))
    with open_text(path) as file:
        if good:
            assert sum(iter(lambda: len(file.read(MI)), 0)) == times * size
        else:
            with pytest.raises(ReadError):
                sum(iter(lambda: len(file.read(MI)), 0))


@pytest.mark.parametrize(("steps", "read"), [(20_000, True), (90_000, False)])
def test_a_query_takes_some_more_steps_than_reading_rows_does(steps, read):
    """Of 32 rows it may take 32 000, of which SQLite tells when they are over, and once more as many."""
    database = sqlite3.connect(":memory:")
    database.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    database.executemany("INSERT INTO messages VALUES (?, 1, ?, x'00')", [(k, k) for k in range(1, 33)])
    counted = 0

    def count():
        nonlocal counted
        counted += 1

    def only(rows):
        counter = f"WITH RECURSIVE c(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM c WHERE i < {rows})"
        return f"AND ({counter} SELECT count(*) FROM c) > 0"

    database.set_progress_handler(count, 100)
    database.execute(f"SELECT count(*) FROM messages WHERE 1 {only(10_000)}").fetchall()
    database.set_progress_handler(None, 0)
    found = list(ranges(database, 1, 32, only(10_000 * steps // (100 * counted))))
    assert [end for end, _ in found] == [32] * read
