"""Long tables, in which the rows of several joints alternate."""

from __future__ import annotations

from itertools import product

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from finding_codes import codes, found, values_of

from vsalog.readers import read

N = 400


def long_table(path, column, names, stamp, header="time"):
    rows = [(stamp(i), names[i % len(names)], 1000 * (i % len(names)) + i // len(names)) for i in range(N)]
    path.write_text(f"{header},{column},pos\n" + "".join(f"{t},{name},{pos}\n" for t, name, pos in rows))
    return read(path)


@pytest.mark.parametrize(
    ("column", "names"), [("joint", ["a", "b"]), ("motor_id", ["1", "2", "3", "4"]), ("label", ["x y", "b"])]
)
@pytest.mark.parametrize("together", [True, False])
def test_each_has_a_stream_of_its_own(tmp_path, column, names, together):
    """Read as one signal they would jump to and fro, or all but one be dropped as duplicates."""
    if not together and column == "label":
        return  # words that alternate may say what one machine does
    count = len(names)
    log = long_table(tmp_path / "log.csv", column, names, lambda i: i // count / 100 if together else i / 1000)
    assert list(log.channels) == [f"pos[{name}]" for name in names]
    for k, name in enumerate(names):
        np.testing.assert_array_equal(log.channels[f"pos[{name}]"].values, 1000 * k + np.arange(N // count))
        begin = 0 if together else k * 10**6
        assert log.channels[f"pos[{name}]"].stamps[0] == begin
    assert [one.part for one in found(log, "table.long")] == [f"column '{column}'"]


def test_one_channel_can_be_wanted(tmp_path):
    long_table(tmp_path / "log.csv", "joint", ["a", "b"], lambda i: i // 2 / 100)
    log = read(tmp_path / "log.csv", ["pos[b]"])
    assert list(log.channels) == ["pos[b]"]


def test_each_clock_begins_again_at_midnight_by_itself(tmp_path):
    def stamp(i):
        seconds = 86_399 + i // 2 / 100
        return f"{int(seconds // 3600) % 24:02d}:{int(seconds // 60) % 60:02d}:{seconds % 60:06.3f}"

    log = long_table(tmp_path / "log.csv", "joint", ["a", "b"], stamp)
    for channel in log.channels.values():
        assert channel.stamps[-1] - channel.stamps[0] == pytest.approx((N // 2 - 1) * 10**7, abs=10**6)


@pytest.mark.parametrize("column", ["mode", "joint"])
def test_words_that_stay_for_long_name_nobody(tmp_path, column):
    """They say what the machine was doing; so do those of each row at random."""
    rows = "".join(f"{i / 100},{'idle' if i % 100 < 50 else 'run'},{i}\n" for i in range(N))
    (tmp_path / "log.csv").write_text(f"time,{column},pos\n{rows}")
    assert list(read(tmp_path / "log.csv").channels) == ["pos"]


def test_a_number_that_alternates_is_a_signal(tmp_path):
    rows = "".join(f"{i / 100},{i % 2},{i}\n" for i in range(N))
    (tmp_path / "log.csv").write_text(f"time,watchdog,pos\n{rows}")
    assert list(read(tmp_path / "log.csv").channels) == ["watchdog", "pos"]


def in_blocks(path, column, names, begin, count=500):
    """Write a table with all rows of one name, then all of the next, with the same times; return what is read."""
    rows = [(begin + i / 100, name, 1000.0 * k + i) for k, name in enumerate(names) for i in range(count)]
    if path.suffix == ".csv":
        text = f"time,{column},value\n" + "".join(f"{t:.2f},{name},{value}\n" for t, name, value in rows)
        path.write_text(text)
    else:
        times, who, values = zip(*rows, strict=True)
        pq.write_table(pa.table({"time": times, column: pa.array(who).dictionary_encode(), "value": values}), path)
    return read(path)


@pytest.mark.parametrize("name", ["log.csv", "log.parquet"])
@pytest.mark.parametrize(
    ("column", "begin"), [("signal", 0), ("signal", 1_700_000_000), ("label", 1_700_000_000), ("motor id", 0)]
)
def test_blocks_of_rows_with_the_same_times_are_streams(tmp_path, name, column, begin):
    """Read as one signal, all but the first would be dropped as duplicates."""
    who = ["4", "7", "9"] if column == "motor id" else ["theta", "tau", "q"]
    log = in_blocks(tmp_path / name, column, who, begin)
    assert list(log.channels) == [f"value[{one}]" for one in who]
    for k, one in enumerate(who):
        channel = log.channels[f"value[{one}]"]
        np.testing.assert_array_equal(channel.values, 1000 * k + np.arange(500.0))
        np.testing.assert_allclose(
            channel.stamps - begin * 10**9, np.arange(500) * 10**7, atol=300
        )  # as floats resolve
    assert not any(stream.conflicts or stream.duplicates or stream.inversions for stream in log.streams.values())
    assert codes(log) == ["table.long"]


def test_blocks_that_are_written_in_turn(tmp_path):
    """A recorder writes what it has of each signal every now and then, each with times of its own."""
    rows = [
        (k * 3 + i / 100 + 0.001 * (name == "b"), name, k * 300 + i)
        for k in range(5) for name in "ab" for i in range(300)
    ]  # fmt: skip
    (tmp_path / "log.csv").write_text("time,channel,v\n" + "".join(f"{t:.3f},{n},{v}\n" for t, n, v in rows))
    log = read(tmp_path / "log.csv")
    for name in "ab":
        np.testing.assert_array_equal(log.channels[f"v[{name}]"].values, np.arange(1500.0))


def test_experiments_one_behind_the_other_are_no_speakers(tmp_path):
    """Each has times from zero on, and its name says nothing of a signal."""
    log = in_blocks(tmp_path / "log.csv", "condition", ["soft", "stiff"], 0)
    np.testing.assert_array_equal(log.channels["value"].values, np.r_[0:500, 1000:1500])
    assert "clock.log_appended" in codes(log)


def test_what_the_machine_did_with_dates_is_no_speaker(tmp_path):
    """The time goes on where the word changes."""
    rows = "".join(f"{1_700_000_000 + i / 100},{'idle' if i < 300 else 'run'},{i}\n" for i in range(600))
    (tmp_path / "log.csv").write_text(f"time,mode,pos\n{rows}")
    assert list(read(tmp_path / "log.csv").channels) == ["pos"]


@pytest.mark.parametrize("kind", [pa.string(), pa.large_string(), pa.string_view(), pa.int16()])
def test_rows_in_turn_of_a_parquet_file(tmp_path, kind):
    who = pa.array([i % 2 for i in range(N)]).cast(kind if pa.types.is_integer(kind) else pa.string()).cast(kind)
    pq.write_table(pa.table({"time": [i // 2 / 100 for i in range(N)], "joint": who, "pos": range(N)}), tmp_path / "a")
    log = read(tmp_path / "a")
    assert {name: list(channel.values) for name, channel in log.channels.items()} == {
        "pos[0]": list(range(0, N, 2)),
        "pos[1]": list(range(1, N, 2)),
    }


def test_more_speakers_than_a_table_can_have_are_reported(tmp_path):
    """Made-up names of a damaged table would take ever more memory."""
    log = in_blocks(tmp_path / "log.csv", "signal", [f"s{k}" for k in range(300)], 0, count=250)
    assert len(log.channels) == 256
    assert values_of(log, "table.others_left_out") == [11000]


@pytest.mark.parametrize("bad", [b"\xde", b"z", b" "])
def test_a_damaged_name_among_blocks_costs_its_row(tmp_path, bad):
    path = tmp_path / "log.csv"
    in_blocks(path, "signal", ["x", "y"], 0)
    raw = path.read_bytes()
    for row in (b"\n1.00,x", b"\n3.00,y"):
        raw = raw.replace(row, row[:-1] + bad)
    path.write_bytes(raw)
    log = read(path)
    np.testing.assert_array_equal(log.channels["value[x]"].values, np.delete(np.arange(500.0), 100))
    np.testing.assert_array_equal(log.channels["value[y]"].values, np.delete(1000 + np.arange(500.0), 300))


def test_a_damaged_time_among_blocks_costs_its_row(tmp_path):
    path = tmp_path / "log.csv"
    in_blocks(path, "signal", ["x", "y"], 0)
    path.write_bytes(path.read_bytes().replace(b"\n3.00,x", b"\n\x1e.005,x"))
    log = read(path)
    assert np.isin(np.delete(np.arange(500.0), 300), log.channels["value[x]"].values).all()
    np.testing.assert_array_equal(log.channels["value[y]"].values, 1000 + np.arange(500.0))


ROBOTS, JOINTS, SIGNALS = ["r1", "r2"], ["hip", "knee", "toe"], ["pos", "tau"]


def melted(path, header, keys, order):
    """Write a row for each time and each combination of keys; return what is read."""
    rows = [(t, *key, 1000.0 * k + t) for (k, key), t in product(enumerate(product(*keys)), range(250))]
    rows.sort(key=order)
    names = [*header.split(",")]
    if path.suffix == ".csv":
        path.write_text(
            "".join(",".join(map(str, row)) + "\n" for row in [names, *((0.01 * r[0], *r[1:]) for r in rows)])
        )
    else:
        columns = dict(zip(names, zip(*((0.01 * r[0], *r[1:]) for r in rows), strict=True), strict=True))
        pq.write_table(pa.table({name: pa.array(cells) for name, cells in columns.items()}), path)
    return read(path)


@pytest.mark.parametrize("name", ["log.csv", "log.parquet"])
@pytest.mark.parametrize(
    ("header", "keys"),
    [
        ("time,robot,joint,value", (ROBOTS, JOINTS)),
        ("time,joint,signal,value", (JOINTS, SIGNALS)),
        ("time,robot,joint,signal,value", (ROBOTS, JOINTS, SIGNALS)),
        ("time,joint_id,signal,value", (["1", "2"], SIGNALS)),
        ("time,which,what,value", (ROBOTS, SIGNALS)),
    ],
)
@pytest.mark.parametrize(
    "order",
    [lambda row: row[0], lambda row: row[1:-1], lambda row: (row[-2], row[0])],
    ids=["times", "keys", "last key"],
)
def test_several_columns_say_whose_values_a_row_holds(tmp_path, name, header, keys, order):
    """By one of them alone, the values of several would be mixed, or dropped as duplicates."""
    if "which" in header and order((0, "a", "b", 1)) != 0:
        return  # blocks of one experiment each, with times from zero on
    log = melted(tmp_path / name, header, keys, order)
    assert set(log.channels) == {f"value[{'.'.join(key)}]" for key in product(*keys)}
    for k, key in enumerate(product(*keys)):
        channel = log.channels[f"value[{'.'.join(key)}]"]
        np.testing.assert_array_equal(channel.values, 1000.0 * k + np.arange(250))
        np.testing.assert_array_equal(np.rint(channel.stamps / 1e7), np.arange(250))
    assert not any(stream.conflicts or stream.duplicates or stream.inversions for stream in log.streams.values())


def test_columns_that_add_nothing_are_no_keys(tmp_path):
    """One that stays the same, one that goes with another; being text, they are no signals."""
    rows = [
        f"{i / 100},r1,{j},{j.upper()},{unit},{i}\n" for i in range(200) for j, unit in (("hip", "Nm"), ("knee", "Nm"))
    ]
    (tmp_path / "log.csv").write_text("time,robot,joint,label,unit,value\n" + "".join(rows))
    log = read(tmp_path / "log.csv")
    assert list(log.channels) == ["value[hip]", "value[knee]"]
    assert dict(log.unread) == {"robot": "text", "label": "text", "unit": "text"}


def test_texts_of_two_keys_that_look_alike_together(tmp_path):
    rows = [
        f"{i / 100},{a},{b},{1000 * k + i}\n"
        for i in range(200)
        for k, (a, b) in enumerate((("a.b", "c"), ("a", "b.c"), ("a", "c")))
    ]
    (tmp_path / "log.csv").write_text("time,robot,joint,value\n" + "".join(rows))
    log = read(tmp_path / "log.csv")
    assert list(log.channels) == ["value[a.b.c]", "value[a|b.c]", "value[a.c]"]
    np.testing.assert_array_equal(log.channels["value[a|b.c]"].values, 1000 + np.arange(200.0))


@pytest.mark.parametrize("begin", [0, 1_700_000_000])
@pytest.mark.parametrize(
    ("column", "words"), [("direction", ["up", "down"]), ("foot", ["left", "right"]), ("phase", ["a", "b", "c"])]
)
@pytest.mark.parametrize("signal", ["smooth", "noise", "constant", "sign"])
def test_a_word_that_changes_in_each_row_is_no_speaker_where_values_go_on(tmp_path, begin, column, words, signal):
    """They say what one machine does."""
    x = {
        "smooth": np.sin(np.arange(N) / 30),
        "noise": np.random.default_rng(5).normal(size=N),
        "constant": np.full(N, 5.0),
        "sign": np.arange(N) % len(words),
    }[signal]
    rows = "".join(f"{begin + i / 100:.2f},{words[i % len(words)]},{x[i]:.9g}\n" for i in range(N))
    (tmp_path / "log.csv").write_text(f"time,{column},pos\n{rows}")
    log = read(tmp_path / "log.csv")
    assert list(log.channels) == ["pos"]
    assert len(log.channels["pos"].values) == N


@pytest.mark.parametrize("begin", [0, 1_700_000_000])
def test_late_rows_make_no_speaker_of_a_word_that_changes_in_each_row(tmp_path, begin):
    """Of each word by itself, the time goes on even there; coarse times are those of several rows, too."""
    late = np.arange(N) // 2 * 2 / 100 + begin
    late[[100, 200, 300]], late[[101, 201, 301]] = late[[101, 201, 301]] + 0.01, late[[100, 200, 300]]
    rows = "".join(f"{t:.2f},{('up', 'down')[i % 3 % 2]},{i}\n" for i, t in enumerate(late))
    (tmp_path / "log.csv").write_text(f"time,direction,pos\n{rows}")
    assert list(read(tmp_path / "log.csv").channels) == ["pos"]


def test_rows_without_any_time_name_nobody(tmp_path):
    rows = "".join(f"{i // 2 / 100},{'ab'[i % 2]},{i}\n" for i in range(N))
    (tmp_path / "log.csv").write_text(f"time,joint,pos\n{rows}" + "".join(f",a,{i}\n" for i in range(400_000)))
    assert list(read(tmp_path / "log.csv").channels) == ["pos[a]", "pos[b]"]
