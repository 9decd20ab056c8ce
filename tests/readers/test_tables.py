"""Text tables in all the ways people write them."""

from __future__ import annotations

import gzip

import numpy as np
import pytest
from finding_codes import codes, values_of
from hypothesis import given, settings
from hypothesis import strategies as st

from vsalog.core.errors import ReadError
from vsalog.core.finding_texts import sentence
from vsalog.readers import open_reader, read

S = 10**9


def table(tmp_path, text, name="log.csv", encoding="utf-8"):
    path = tmp_path / name
    path.write_bytes(text.encode(encoding))
    return path


def values(recording):
    return {name: channel.values.tolist() for name, channel in recording.channels.items()}


def stamps(recording):
    assert len(recording.streams) == 1
    return next(iter(recording.channels.values())).stamps.tolist()


@pytest.mark.parametrize("separator", [",", ";", "\t", "|", " ", "   "])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_separators_and_encodings(tmp_path, separator, encoding):
    rows = [["time", "Winkelübertrag", "tau"], ["0.000", "1.5", "-2"], ["0.001", "1.25e1", "nan"], ["0.002", "3", "4"]]
    text = "\r\n".join(separator.join(row) for row in rows) + "\r\n"
    recording = read(table(tmp_path, text, encoding=encoding))
    assert stamps(recording) == [0, 1_000_000, 2_000_000]
    assert recording.channel("Winkelübertrag").values.tolist() == [1.5, 12.5, 3]
    np.testing.assert_array_equal(recording.channel("tau").values, [-2, np.nan, 4])
    assert recording.format == "csv"
    assert recording.findings == ()
    assert recording.streams["log"].time_source == "column"
    assert not recording.absolute_time


def test_units_in_the_header(tmp_path):
    text = "t [ms],theta [deg],torque (N·mm),q (filtered),/j.position[elbow],plain\n0,1,2,3,4,5\n1,1,2,3,4,5\n"
    recording = read(table(tmp_path, text))
    assert stamps(recording) == [0, 1_000_000]
    assert {name: channel.unit for name, channel in recording.channels.items()} == {
        "theta": "deg",
        "torque": "N·mm",
        "q (filtered)": None,
        "/j.position[elbow]": None,
        "plain": None,
    }


def test_units_in_a_row_of_their_own(tmp_path):
    recording = read(table(tmp_path, "time;theta;tau\n[s];[deg];Nm\n0,5;1,5;-1\n1,0;2,5;-2\n"))
    assert stamps(recording) == [S // 2, S]
    assert recording.channel("theta").unit == "deg"
    assert recording.channel("tau").unit == "Nm"
    assert recording.channel("theta").values.tolist() == [1.5, 2.5]


@pytest.mark.parametrize("text", ["t;x\n0,1;1,5\n0,2;-2,25e1\n", 't,x\n"0,1","1,5"\n"0,2","-2,25e1"\n'])
def test_decimal_comma(tmp_path, text):
    recording = read(table(tmp_path, text))
    assert stamps(recording) == [S // 10, S // 5]
    assert values(recording) == {"x": [1.5, -22.5]}


@pytest.mark.parametrize(
    ("cells", "header", "expected"),
    [
        (["0", "0.001", "0.002"], "time", [0, 1_000_000, 2_000_000]),
        (["0", "1", "2"], "time [ms]", [0, 1_000_000, 2_000_000]),
        (["0", "1", "2"], "time_us", [0, 1000, 2000]),
        (["0", "1", "2"], "t (s)", [0, S, 2 * S]),
        (["0", "1000", "2000"], "t", [0, 1_000_000, 2_000_000]),
        (["0", "1000000", "2000000"], "t", [0, 1_000_000, 2_000_000]),
        (["1494360168928586959", "1494360168928586960"], "timestamp", [1494360168928586959, 1494360168928586960]),
        (["1494360168.928586959", "1494360168.928586960"], "stamp", [1494360168928586959, 1494360168928586960]),
        (["1494360168928.586959", "1494360168929"], "Time", [1494360168928586959, 1494360168929000000]),
        (["1494360168928586", "1494360168928587"], "__time", [1494360168928586000, 1494360168928587000]),
        (["1.5e-3", "2.5e-3"], "secs", [1_500_000, 2_500_000]),
        (["2017-05-09T20:02:48.928586959Z", "2017-05-09T20:02:49Z"], "time", [1494360168928586959, 1494360169 * S]),
        (["2017-05-09 20:02:48.5", "2017-05-09 20:02:49.25"], "date_time", [1494360168500000000, 1494360169250000000]),
        (["2017-05-09T22:02:48+02:00", "2017-05-09T22:02:49+02:00"], "time", [1494360168 * S, 1494360169 * S]),
        (["12:00:00.5", "12:00:01"], "time", [43200_500_000_000, 43201 * S]),
    ],
)
def test_time_columns_are_exact(tmp_path, cells, header, expected):
    text = f"x,{header}\n" + "".join(f"{i},{cell}\n" for i, cell in enumerate(cells))
    recording = read(table(tmp_path, text))
    assert stamps(recording) == expected
    assert list(recording.channels) == ["x"]
    assert recording.absolute_time == (expected[0] > 946684800 * S)


def test_a_guessed_unit_is_reported(tmp_path):
    recording = read(table(tmp_path, "t,x\n0,1\n5,2\n10,3\n"))
    assert "clock.unit_by_steps" in codes(recording)


def test_date_and_time_in_two_columns(tmp_path):
    recording = read(table(tmp_path, "date,time,x\n2017-05-09,20:02:48.5,1\n2017-05-09,20:02:49,2\n"))
    assert stamps(recording) == [1494360168500000000, 1494360169000000000]


def test_seconds_and_nanoseconds_in_two_columns(tmp_path):
    text = "header.stamp.sec,header.stamp.nanosec,x\n1494360168,928586959,1\n1494360169,5,2\n"
    recording = read(table(tmp_path, text))
    assert stamps(recording) == [1494360168928586959, 1494360169000000005]
    assert values(recording) == {"x": [1, 2]}


def test_export_of_rostopic(tmp_path):
    text = "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.q\n"
    rows = [(1494360168928586959 + i * 1000, i, 1494360168925000928 + i * 1000, "base", i / 4) for i in range(4)]
    text += "".join(",".join(map(str, row)) + "\n" for row in rows)
    path = table(tmp_path, text)
    recording = read(path)
    assert list(recording.channels) == ["header.seq", "q"]
    assert recording.unread == {"header.frame_id": "text"}
    assert stamps(recording) == [row[2] for row in rows]
    stream = recording.streams["log"]
    assert stream.time_source == "header"
    assert stream.delay_median == pytest.approx(3.586031e-3)
    assert stamps(read(path, time="log")) == [row[0] for row in rows]
    zero = table(tmp_path, text.replace("14943601689250009", "0").replace("0,0,028", "0"), "zero.csv")
    assert read(zero).streams["zero"].time_source in ("log", "column")


def test_no_header(tmp_path):
    recording = read(table(tmp_path, "1,2.5\n2,3.5\n3,4.5\n"))
    assert values(recording) == {"column_0": [1, 2, 3], "column_1": [2.5, 3.5, 4.5]}
    assert "table.no_header" in codes(recording)


def test_without_time_a_rate_is_needed(tmp_path):
    path = table(tmp_path, ",a,b\n0,0.1,5\n1,0.2,6\n2,0.3,7\n")
    recording = read(path)
    assert recording.streams["log"].time_source == "none"
    assert list(recording.channels) == ["column_0", "a", "b"]
    assert "clock.missing" in codes(recording)
    recording = read(path, rate=400.0)
    assert recording.streams["log"].time_source == "rate"
    assert stamps(recording) == [0, 2_500_000, 5_000_000]
    assert list(open_reader(path).catalogue().channels) == ["column_0", "a", "b"]
    with pytest.raises(ReadError, match="positive"):
        read(path, rate=0.0)


def test_a_column_that_looks_like_time_is_reported_not_taken(tmp_path):
    rows = "".join(f"{i},{i * 0.003 - 0.0043},{i % 3}\n" for i in range(20))
    recording = read(table(tmp_path, ",header,joint_position\n" + rows))
    assert recording.streams["log"].time_source == "none"
    assert "header" in recording.channels
    assert "clock.perhaps" in codes(recording)


@pytest.mark.parametrize(
    ("first", "step"),
    [
        (lambda i: f"{i * 0.002 + 0.1:g}", 2_000_000),
        (lambda i: str(4 * i), 4_000_000),
        (lambda i: str(i * 2000), 2_000_000),
    ],
)
def test_a_first_column_that_rises_evenly_is_the_time_where_none_is_called_so(tmp_path, first, step):
    path = table(tmp_path, "x,joint_position\n" + "".join(f"{first(i)},{i % 3}\n" for i in range(20)))
    recording = read(path)
    assert list(recording.channels) == ["joint_position"]
    assert set(np.diff(stamps(recording))) == {step}
    assert "clock.guessed_by_rise" in codes(recording)
    assert list(read(path, rate=100.0).channels) == ["x", "joint_position"]  # who states a rate means all columns


@pytest.mark.parametrize(
    ("header", "first"),
    [
        ("x [rad],q", lambda i: f"{i * 0.002:g}"),  # an angle, by its unit
        ("x,q", lambda i: str(i)),  # the number of the row
        ("x,q", lambda i: f"{0.002 * i * (20 - i):g}"),  # it falls
        ("x,q", lambda i: f"{2.0**i + 0.5:g}"),  # its steps grow
        ("x,q,time", lambda i: f"{i * 0.002:g}"),  # another is called so
    ],
)
def test_a_first_column_that_is_no_time(tmp_path, header, first):
    rows = "".join(f"{first(i)},{i % 3}" + (f",{i * 0.01:g}" if "time" in header else "") + "\n" for i in range(20))
    recording = read(table(tmp_path, f"{header}\n{rows}"))
    assert "x" in recording.channels
    assert "clock.guessed_by_rise" not in codes(recording)


def test_comments_and_lines_ahead_of_the_header(tmp_path):
    text = "# rig: awas\n% operator, me, you\n\nSetup,A\n\ntime,x,y\n0.0,1,2\n# paused\n0.1,2,3\n0.2,3,4\n"
    recording = read(table(tmp_path, text))
    assert values(recording) == {"x": [1, 2, 3], "y": [2, 3, 4]}
    assert [(one.code, one.value) for one in recording.findings] == [("table.remarks", 1)]


def test_header_in_a_comment(tmp_path):
    recording = read(table(tmp_path, "# a file\n# time theta\n0.0 1\n0.1 2\n0.2 3\n"))
    assert values(recording) == {"theta": [1, 2, 3]}


def test_ragged_lines_are_skipped_and_counted(tmp_path):
    recording = read(table(tmp_path, "t,x,y\n0.0,1,2\n0.1,1\n0.2,1,2,3\n0.3,4,5\n0.4,6,7\n0.5,6"))
    assert values(recording) == {"x": [1, 4, 6], "y": [2, 5, 7]}
    assert values_of(recording, "table.lines_skipped") == [3]


def test_bad_cells_text_columns_and_empty_cells(tmp_path):
    text = 't,x,mode,gap,inf,on\n0.0,1,idle,,inf,true\n0.1,oops\x07,"run, fast",5,-Infinity,False\n0.2,3,idle,,1e400,TRUE\n'
    recording = read(table(tmp_path, text))
    np.testing.assert_array_equal(recording.channel("x").values, [1, np.nan, 3])
    np.testing.assert_array_equal(recording.channel("gap").values, [5])
    np.testing.assert_array_equal(recording.channel("inf").values, [np.inf, -np.inf, np.inf])
    assert recording.channel("on").values.tolist() == [1, 0, 1]
    assert recording.unread == {"mode": "text"}
    assert recording.channel("gap").stamps.tolist() == [S // 10]
    (cells,) = (one for one in recording.findings if one.code != "table.columns_apart")
    assert (cells.code, cells.part, cells.value) == ("table.cells_without_number", "x", 1)
    assert cells.evidence["row"] == 2
    assert sentence(cells).isprintable()
    assert open_reader(tmp_path / "log.csv").catalogue().unread == {"mode": "text"}


def test_merged_logs_are_taken_apart(tmp_path):
    rows = [f"{i / 1000},{i},,{'' if i % 2 else i},7\n" if i % 4 else f"{i / 1000},,{-i},{i},7\n" for i in range(40)]
    path = table(tmp_path, "time,a,b [rad],c,d\n" + "".join(rows))
    recording = read(path)
    every = np.arange(40)
    np.testing.assert_array_equal(recording.channel("a").values, every[every % 4 != 0])
    np.testing.assert_array_equal(recording.channel("b").values, -every[every % 4 == 0])
    np.testing.assert_array_equal(recording.channel("c").stamps, every[every % 2 == 0] * 1_000_000)
    assert recording.channel("d").stream == "log"
    assert recording.channel("b").unit == "rad"
    assert len(recording.streams) == 4
    catalogue = open_reader(path).catalogue()
    assert {n: i.stream for n, i in catalogue.channels.items()} == {
        c.name: c.stream for c in recording.channels.values()
    }
    assert "table.columns_apart" in codes(recording)


def test_rows_without_a_time_are_left_out(tmp_path):
    recording = read(table(tmp_path, "time,x\n0.0,1\n,2\n0.2,3\nnan,4\n0.4,5\n"))
    assert values(recording) == {"x": [1, 3, 5]}
    assert values_of(recording, "clock.rows_without_time") == [2]


def test_equal_names_are_separated(tmp_path):
    assert list(read(table(tmp_path, "t,x,x\n0.0,1,2\n0.1,1,2\n")).channels) == ["x", "x#2"]


def test_header_with_one_name_fewer_than_cells(tmp_path):
    recording = read(table(tmp_path, "time,x\n1,0.0,5\n2,0.1,6\n3,0.2,7\n"))
    assert values(recording) == {"column_0": [1, 2, 3], "x": [5, 6, 7]}
    assert stamps(recording) == [0, S // 10, S // 5]
    trailing = read(table(tmp_path, "time,x\n0.0,5,\n0.1,6,\n", "trailing.csv"))
    assert trailing.channel("x").values.tolist() == [5, 6]


def test_compressed_and_cut_off(tmp_path):
    rows = "".join(f"{i / 1000},{(i * 7919) % 1013}\n" for i in range(50_000))
    path = tmp_path / "log"
    path.write_bytes(gzip.compress(("t,x\n" + rows).encode()))
    assert read(path).streams["log"].count == 50_000
    path.write_bytes(path.read_bytes()[:-1000])
    recording = read(path)
    assert 0 < recording.streams["log"].count < 50_000
    assert "compressed.truncated" in codes(recording)


def test_only_wanted_columns(tmp_path):
    assert list(read(table(tmp_path, "t,x,y\n0,1,2\n0.1,3,4\n"), wanted={"y"}).channels) == ["y"]


def test_bytes_that_are_no_text_deep_in_the_file(tmp_path):
    path = tmp_path / "log"
    rows = "".join(f"{i / 1000},{i},ok\n" for i in range(40_000))
    path.write_bytes(b"t,x,s\n" + rows.encode() + b"40.0,\xff\xfe,\xb0C\n40.001,7,ok\n")
    recording = read(path)
    assert recording.channel("x").values[-1] == 7
    assert np.isnan(recording.channel("x").values[-2])


@pytest.mark.parametrize(
    "text",
    [
        "preset = 'sea'\n\n[[joints]]\nname = 'elbow'\n",
        "| file | what |\n| --- | --- |\n| a.csv | a log |\n| b.csv | one |\n",
    ],
)
def test_text_without_numbers_is_refused(tmp_path, text):
    with pytest.raises(ReadError, match="no table"):
        read(table(tmp_path, text))


def test_a_lone_header_is_refused(tmp_path):
    with pytest.raises(ReadError, match="no row of values"):
        read(table(tmp_path, "time,x\n"))


numbers = st.lists(st.floats(width=64), min_size=1, max_size=50)


@settings(max_examples=60, deadline=None)
@given(numbers, st.sampled_from([",", ";", "\t", " "]))
def test_any_number_comes_back_exactly(tmp_path_factory, cells, separator):
    path = tmp_path_factory.mktemp("exact") / "log"
    path.write_text(f"time{separator}x\n" + "".join(f"{i}e-3{separator}{cell!r}\n" for i, cell in enumerate(cells)))
    channel = read(path).channels.get("x")
    if channel is None:  # all of them NaN
        assert np.isnan(cells).all()
        return
    np.testing.assert_array_equal(channel.values, cells)
    assert channel.stamps.tolist() == [i * 1_000_000 for i in range(len(cells))]


@settings(max_examples=60, deadline=None)
@given(st.text(max_size=300))
def test_any_text_is_read_or_refused(tmp_path_factory, text):
    path = tmp_path_factory.mktemp("text") / "log"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        recording = read(path)
    except ReadError:
        return
    assert all(name.isprintable() for name in recording.channels)
