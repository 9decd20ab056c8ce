"""Rows of SQLite bags that are read many at once: the same as read one by one, of any rows, and as soon of any file."""

import sqlite3
import struct
import time

import numpy as np
import pytest
from finding_codes import codes, values_of
from hypothesis import given, settings
from hypothesis import strategies as st

import vsalog.readers.rosbag2_sqlite as rosbag2_sqlite
import vsalog.readers.sqlite_ranges as sqlite_ranges
from vsalog.core.errors import ReadError
from vsalog.readers import read
from vsalog.readers.container import Part
from vsalog.readers.rosbag2_sqlite import SqliteContainer
from vsalog.readers.sqlite_ranges import ranges

AFFINITIES = ("topic_id INTEGER, timestamp INTEGER, data BLOB", "topic_id, timestamp, data")
TOPICS = (1, 2, 5)
PAGE, WAYS = 4096, 500


def write(path, rows, columns=AFFINITIES[0], encoding="UTF-8"):
    """Write a bag's database; rows of number, topic, time and message."""
    path.unlink(missing_ok=True)
    database = sqlite3.connect(path)
    database.execute(f"PRAGMA encoding = '{encoding}'")
    database.execute("PRAGMA synchronous = OFF")
    database.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name, type, serialization_format)")
    database.executemany("INSERT INTO topics VALUES (?, ?, 'a/T', 'cdr')", [(n, f"/t{n}") for n in TOPICS])
    database.execute(f"CREATE TABLE messages(id INTEGER PRIMARY KEY, {columns})")
    database.execute("CREATE INDEX timestamp_idx ON messages (timestamp ASC)")
    database.executemany("INSERT OR REPLACE INTO messages VALUES (?, ?, ?, ?)", rows)
    database.commit()
    database.close()
    return path


def found(container, ids=TOPICS):
    """Return topic, time and message of what a container yields."""
    packets = list(container.packets(ids))
    return [
        row
        for packet in packets
        for row in zip(packet.connection.tolist(), packet.log.tolist(), packet.messages, strict=True)
    ]


def sound(count, size=20):
    """Return rows as a recorder writes them, with messages of any bytes and up to a size."""
    rng = np.random.default_rng(count)
    return [(i, TOPICS[i % 3], 10**18 + i, rng.bytes(int(rng.integers(0, size)))) for i in range(1, count + 1)]


@pytest.fixture
def by_range(monkeypatch):
    """Return how many rows were read by ranges, in all that is done by then."""
    seen = []

    def spied(*asked):
        for end, packet in ranges(*asked):
            seen.append(len(packet.messages))
            yield end, packet

    monkeypatch.setattr(rosbag2_sqlite, "ranges", spied)
    return lambda: sum(seen)


cells = st.one_of(
    st.integers(-(2**63), 2**63 - 1),
    st.sampled_from(TOPICS),
    st.binary(max_size=12),
    st.text(max_size=4),
    st.none(),
    st.floats(),
)
odd_rows = st.lists(st.tuples(st.integers(0, 40), cells, cells, cells), max_size=3)


@settings(max_examples=200, deadline=None)
@given(odd_rows, st.sampled_from(AFFINITIES), st.integers(0, 30), st.sampled_from([TOPICS, (2,), (1, 5)]))
def test_rows_of_any_kind(tmp_path_factory, odd, columns, count, ids):
    path = write(tmp_path_factory.getbasetemp() / "any.db3", sound(count) + odd, columns)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sqlite_ranges, "FIRST_ROWS", 3)
        patch.setattr(sqlite_ranges, "BLOCK_ROWS", 7)
        container = SqliteContainer(path)
        rows = sqlite3.connect(path).execute("SELECT topic_id, timestamp, data FROM messages ORDER BY rowid").fetchall()
        proper = [row for row in rows if tuple(map(type, row)) == (int, int, bytes)]
        assert found(container, ids) == [row for row in proper if row[0] in ids]
        if ids == TOPICS and len(proper) < len(rows):
            assert "recording.rows_without_message" in codes(container)


@pytest.mark.parametrize("columns", AFFINITIES)
@pytest.mark.parametrize("odd", ["1", b"1", 1.0, None, ""])
@pytest.mark.parametrize("place", [1, 2, 3])
def test_one_cell_of_another_type(tmp_path, columns, odd, place):
    rows = sound(50)
    rows[30] = (*rows[30][:place], odd, *rows[30][place + 1 :])
    path = write(tmp_path / "bag.db3", rows, columns)
    stored = sqlite3.connect(path).execute("SELECT topic_id, timestamp, data FROM messages ORDER BY rowid").fetchall()
    assert found(SqliteContainer(path)) == [row for row in stored if tuple(map(type, row)) == (int, int, bytes)]


@pytest.mark.parametrize("ids", [TOPICS, (1, 5)])
def test_a_sound_bag_is_read_by_ranges(tmp_path, by_range, ids):
    rows = sound(40_000)
    container = SqliteContainer(write(tmp_path / "bag.db3", rows))
    expected = [row[1:] for row in rows if row[1] in ids]
    assert found(container, ids) == expected
    assert by_range() == len(expected)
    assert not container.findings


def test_a_part_of_a_log(tmp_path, by_range):
    rows = sound(3000)
    container = SqliteContainer(write(tmp_path / "bag.db3", rows))
    container.narrow(Part(10**18 + 1001, 10**18 + 2000))
    assert found(container) == [row[1:] for row in rows[1000:2000]]
    assert by_range() == 1000
    container.narrow(Part(10**18 + 1001, 10**18 + 2000, frozenset([2])))
    assert found(container) == [row[1:] for row in rows if 1001 <= row[0] <= 2000 or row[1] == 2]


def test_rows_from_a_gap_on_are_looked_at_one_by_one(tmp_path, by_range):
    rows = sound(1000)
    del rows[700:710]
    container = SqliteContainer(write(tmp_path / "bag.db3", rows))
    assert found(container) == [row[1:] for row in rows]
    assert by_range() == 32  # the next range holds the gap
    assert values_of(container, "recording.row_numbers_missing") == [10]


def test_numbers_may_begin_anywhere(tmp_path):
    for first in (0, 5):
        rows = [(number + first - 1, *row) for number, *row in sound(500)]
        container = SqliteContainer(write(tmp_path / "bag.db3", rows))
        assert found(container) == [row[1:] for row in rows]
        assert not container.findings


def test_texts_of_two_bytes_a_character(tmp_path):
    rows = sound(500)
    container = SqliteContainer(write(tmp_path / "bag.db3", rows, encoding="UTF-16le"))
    assert found(container) == [row[1:] for row in rows]


def test_large_messages_among_small_ones(tmp_path, by_range, monkeypatch):
    monkeypatch.setattr(sqlite_ranges, "PACKED_BYTES", 2**16)
    rows = sound(2000)
    for at in (900, 905, 1200):
        rows[at] = (*rows[at][:3], bytes(2**16))
    rows[1500] = (*rows[1500][:3], bytes(2**18))  # beyond all bounds of a range
    container = SqliteContainer(write(tmp_path / "bag.db3", rows))
    assert found(container) == [row[1:] for row in rows]
    assert 1200 < by_range() <= 1500


@pytest.fixture
def endless(tmp_path):
    """Return a bag of a few pages in which each inner page leads to the next one hundreds of times: 10^9 rows, as it seems."""
    path = write(tmp_path / "bag.db3", sound(2000))
    with sqlite3.connect(path) as database:
        (root,) = database.execute("SELECT rootpage FROM sqlite_master WHERE name = 'messages'").fetchone()
    raw = bytearray(path.read_bytes())
    leaves = [page for page in range(1, len(raw) // PAGE + 1) if raw[(page - 1) * PAGE] == 13 and page != 1]
    *inner, leaf = [root, *leaves[-4:]]
    for page, child in zip(inner, [*inner[1:], leaf], strict=True):
        cell = struct.pack(">IB", child, 1)
        start = PAGE - WAYS * len(cell)
        head = struct.pack(">BHHHBI", 5, 0, WAYS, start, 0, child)
        places = struct.pack(f">{WAYS}H", *range(start, PAGE, len(cell)))
        raw[(page - 1) * PAGE : page * PAGE] = (head + places).ljust(start, b"\0") + cell * WAYS
    path.write_bytes(raw)
    return path


@pytest.mark.parametrize("ids", [TOPICS, (1, 2), (99,)])
def test_pages_that_lead_to_one_page_many_times_take_no_time(endless, ids):
    begin = time.perf_counter()
    container = SqliteContainer(endless)
    assert len(found(container, ids)) <= endless.stat().st_size + 256
    assert time.perf_counter() - begin < 5
    assert "recording.database_repeats" in codes(container)


@pytest.mark.parametrize("size", [60, 900, 9000])
def test_a_file_that_ends_within_a_row_has_no_row_that_ends_in_zeros(tmp_path, size):
    """Of messages in one page, and of some that go on in others: what comes out of any part of the file was put in."""
    rows = sound(120, size)
    # No message ends with a zero, which could not be distinguished from one that SQLite has made.
    rows = [(number, topic, when, data + b"\xff" * 9) for number, topic, when, data in rows]
    whole = write(tmp_path / "whole.db3", rows).read_bytes()
    put_in, seen = {(topic, when, data) for _, topic, when, data in rows}, 0
    for length in range(len(whole) - 4 * PAGE, len(whole), 331):
        (tmp_path / "cut.db3").write_bytes(whole[:length])
        try:
            got = found(SqliteContainer(tmp_path / "cut.db3"))
        except ReadError:
            continue
        wrong = [(topic, when) for topic, when, data in got if (topic, when, bytes(data)) not in put_in]
        assert not wrong, length
        seen += len(got)
    assert seen > 1000


def test_topics_whose_row_is_damaged_say_so(tmp_path):
    path = write(tmp_path / "log", sound(30))
    with sqlite3.connect(path) as database:
        database.execute("UPDATE topics SET name = NULL, type = NULL, serialization_format = NULL WHERE id = 2")
        database.execute("UPDATE topics SET serialization_format = NULL WHERE id = 5")
    recording = read(path)
    assert (
        recording.unread["topic 2"] == recording.unread["/t5"] == "the log does not state the encoding of its messages"
    )
    damaged = [one for one in recording.findings if one.code == "recording.topic_damaged"]
    assert [(one.value, one.part) for one in damaged] == [(2, "unnamed"), (5, "/t5")]
    assert not any("None" in text for text in (*recording.notes, *recording.unread, *recording.unread.values()))


def test_rows_that_are_glimpsed_at_are_small(tmp_path):
    """Thousands of rows separate publishers and frames; of images and maps they would be all of the file."""
    write(tmp_path / "log", [(i, 1, i, bytes(10**6 if i % 3 else 20)) for i in range(1, 60)])
    packets = list(SqliteContainer(tmp_path / "log").glimpses({1}))
    assert {size for packet in packets for size in packet.messages.length.tolist()} == {20}
