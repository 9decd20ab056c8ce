"""Text tables as programs and people really write them, each with what it says in Python's own arithmetic."""

from __future__ import annotations

import csv
import gzip
import io
from datetime import UTC, datetime, timedelta, timezone
from decimal import Decimal

import numpy as np
import pytest
from finding_codes import codes, found, values_of
from hypothesis import given, settings
from hypothesis import strategies as st

from vsalog.core.errors import ReadError
from vsalog.readers import read

S = 10**9


@pytest.fixture
def table(tmp_path):
    """Read a text as a table."""

    def table(text, **options):
        path = tmp_path / "log"
        path.write_text(text, encoding="utf-8")
        return read(path, **options)

    return table


def content(recording):
    return {name: (channel.values.tolist(), channel.unit) for name, channel in recording.channels.items()}


def stamps(recording):
    return next(iter(recording.channels.values())).stamps.tolist()


def test_words_below_the_names_are_no_units(table):
    recording = table("time,theta,tau\nelapsed,motor angle,joint torque\n0.1,1,2\n0.2,3,4\n")
    assert content(recording) == {"theta": ([1, 3], None), "tau": ([2, 4], None)}
    assert "table.words_below_header" in codes(recording)


def test_quoted_names_with_separators_quotes_and_units(table):
    recording = table('"time [ms]","arm, left [rad]","the ""best"" [Nm]"\n"1","1.5","2"\n"2","2.5","3"\n')
    assert content(recording) == {"arm, left": ([1.5, 2.5], "rad"), 'the "best"': ([2, 3], "Nm")}
    assert stamps(recording) == [1_000_000, 2_000_000]


def test_an_export_of_plotjuggler_with_two_topics(table):
    rows = [(1494360168 + i / 1000, i) for i in range(40)]
    text = "__time,/arm/q,/tool/x,/tool/y\n" + "".join(
        f"{t:.6f},{i},,\n" if i % 4 else f"{t:.6f},,{i / 3!r},{-i}\n" for t, i in rows
    )
    recording = table(text)
    assert recording.channel("/arm/q").values.tolist() == [i for _, i in rows if i % 4]
    assert recording.channel("/tool/x").values.tolist() == [i / 3 for _, i in rows if i % 4 == 0]
    expected = [int(Decimal(f"{t:.6f}") * S) for t, i in rows if i % 4 == 0]
    assert recording.channel("/tool/y").stamps.tolist() == expected
    assert recording.channel("/tool/x").stream == recording.channel("/tool/y").stream


def test_few_blank_cells_stay_as_rows_without_a_value(table):
    """A blank cell in a row that others fill is a value that was not measured, as NaN says; no clock of its own."""
    recording = table("t,x,y\n" + "".join(f"{i / 10},{i},{'' if i % 10 == 3 else i}\n" for i in range(40)))
    assert len(recording.streams) == 1
    assert np.flatnonzero(np.isnan(recording.channel("y").values)).tolist() == [3, 13, 23, 33]
    assert not np.isnan(recording.channel("x").values).any()


def rostopic(blank):
    rows = [(START + i, "" if i == blank else START - 5 + i, i) for i in range(6)]
    return "%time,field.header.stamp,field.q\n" + "".join(",".join(map(str, row)) + "\n" for row in rows)


START = 1494360168928586959


def test_a_missing_header_stamp_loses_no_row(table):
    assert stamps(table(rostopic(None))) == [START - 5 + i for i in range(6)]
    recording = table(rostopic(2))
    assert content(recording) == {"q": ([0, 1, 2, 3, 4, 5], None)}
    assert stamps(recording) == [START + i for i in range(6)]
    (doubt,) = found(recording, "clock.stamps_zero")
    assert (doubt.value, doubt.evidence["stamps"], doubt.evidence["used"]) == (1, 6, "log")


@pytest.mark.parametrize(
    ("first", "hours"),
    [
        ("2017-05-09T20:02:48", 0),
        ("2017-05-09 20:02:48Z", 0),
        ("2017-05-09T20:02:48z", 0),
        ("2017-05-09T20:02:48 UTC", 0),
        ("2017-05-09T20:02:48+02:00", 2),
        ("2017-05-09T20:02:48-0230", -2.5),
        ("2017-05-09T20:02:48+05", 5),
        ("2017-05-09 20:02:48 +0530", 5.5),
        ("20170509T200248", 0),
        ("20170509T200248Z", 0),
        ("2017/05/09 20:02:48", 0),
        ("09.05.2017 20:02:48", 0),
    ],
)
@pytest.mark.parametrize("fraction", ["", ".123456789"])
def test_dates_with_zones(table, first, hours, fraction):
    written = first.replace("48", "48" + fraction)
    recording = table(f"time;x\n{written};1\n{written.replace(':48', ':49').replace('0248', '0249')};2\n")
    zone = timezone(timedelta(hours=hours))
    begin = int(datetime(2017, 5, 9, 20, 2, 48, tzinfo=zone).timestamp()) * S + (123456789 if fraction else 0)
    assert stamps(recording) == [begin, begin + S]


@pytest.mark.parametrize(
    ("header", "date", "mark"), [("Date;Time", "2026-01-31", "."), ("Datum;Uhrzeit", "31.01.2026", ",")]
)
def test_date_and_time_in_two_columns(table, header, date, mark):
    recording = table(f"{header};x\n{date};12:00:00{mark}5;1{mark}5\n{date};12:00:01{mark}25;2{mark}5\n")
    noon = int(datetime(2026, 1, 31, 12, tzinfo=UTC).timestamp()) * S
    assert stamps(recording) == [noon + S // 2, noon + S + S // 4]
    assert content(recording) == {"x": ([1.5, 2.5], None)}


def test_remarks_between_rows_are_counted_also_where_they_look_like_rows(table):
    recording = table("x,y\n1,2\n#3,4\n  % 5,6\n# the end\n7,8\n", rate=10.0)
    assert content(recording) == {"x": ([1, 7], None), "y": ([2, 8], None)}
    assert values_of(recording, "table.remarks") == [3]


def test_a_stray_quote_in_a_table_without_quotes_costs_one_cell(table):
    rows = [f"{i / 10},{i},{-i}" for i in range(300)]
    rows[250] = '25.0,"250,-250'
    recording = table("t,x,y\n" + "\n".join(rows) + "\n")
    expected = np.arange(300.0)
    np.testing.assert_array_equal(recording.channel("y").values, -expected)
    expected[250] = np.nan
    np.testing.assert_array_equal(recording.channel("x").values, expected)


def test_a_stray_quote_in_a_table_with_quotes_makes_no_mixed_row(table):
    rows = [f'"{i / 10}","{i}","{-i}"' for i in range(300)]
    rows[250] = '"25.0","250,"-250"'
    recording = table('"t","x","y"\n' + "\n".join(rows) + "\n")
    for channel, sign in (("x", 1), ("y", -1)):
        c = recording.channel(channel)
        expected = sign * np.rint(c.stamps / 1e8)
        np.testing.assert_array_equal(np.where(np.isnan(c.values), expected, c.values), expected)
    assert recording.findings


def test_a_separator_that_is_stated(table):
    assert content(table("sep=|\ntime|x\n0.1|1\n0.2|2\n")) == {"x": ([1, 2], None)}


def test_among_decimal_commas_a_point_alone_is_no_number(table):
    """2.037 may be 2037: nobody knows, so that it is reported."""
    rows = [f"{i},5;{i},25" for i in range(20)]
    rows[3] = "3,5;2.037"
    recording = table("t;x\n" + "\n".join(rows) + "\n")
    np.testing.assert_array_equal(recording.channel("x").values, [np.nan if i == 3 else i + 0.25 for i in range(20)])
    assert values_of(recording, "table.cells_without_number") == [1]


@pytest.mark.parametrize(
    "text", ["t;x\n0,1;1.234,5\n0,2;-12.345.678,25\n", 't,x\n0.1,"1,234.5"\n0.2,"-12,345,678.25"\n']
)
def test_thousands_next_to_a_decimal_mark(table, text):
    """As spreadsheets write cells that they show so."""
    recording = table(text)
    assert content(recording) == {"x": ([1234.5, -12345678.25], None)}
    assert stamps(recording) == [S // 10, S // 5]


def test_units_in_a_table_of_blanks(table):
    recording = table("time [s]  x [rad]   y (Nm)\n0.1   1  2\n0.2   3   4\n")
    assert content(recording) == {"x": ([1, 3], "rad"), "y": ([2, 4], "Nm")}


@pytest.mark.parametrize("between", ["\u00a0", "\u202f", "'"])
@pytest.mark.parametrize("mark", [",", "."])
def test_thousands_apart_by_blanks_or_apostrophes(table, between, mark):
    """As Excel writes them in France and in Switzerland; a comma in each number is no separator of cells."""
    rows = [f"{i};-{i}{between}{100 + i}{between}000{mark}5;{i}{between}000" for i in range(1, 99)]
    recording = table("t;x;y\n" + "\n".join(rows) + "\n")
    i = np.arange(1, 99)
    np.testing.assert_array_equal(recording.channel("x").values, -(i * 10**6 + (100 + i) * 1000 + 0.5))
    np.testing.assert_array_equal(recording.channel("y").values, i * 1000)


def test_thousands_of_columns(table):
    names = [f"/robot/arm/joint_{i}/measured/position" for i in range(4000)]
    recording = table(
        "time," + ",".join(names) + "\n" + "".join(f"{t}," + ",".join(["1.5"] * 4000) + "\n" for t in (1, 2))
    )
    assert list(recording.channels) == names
    with pytest.raises(ReadError, match="has 10501 columns; more than 4096"):
        table("time," + ",".join(f"c{i}" for i in range(10500)) + "\n" + "0," * 10500 + "0\n")


@pytest.mark.parametrize("separator", [",", ";", "\t", "|", " "])
@pytest.mark.parametrize(("header", "columns"), [(True, "more than"), (False, "700000")])
def test_a_million_columns_are_refused_at_once(table, separator, header, columns, monkeypatch):
    """No time is spent on what each of them is called, and how it is written."""
    monkeypatch.setattr("vsalog.readers.tables.reader.detect", None)
    row = separator.join(["1.5"] * 700_000) + "\n"
    names = separator.join(["time", *(f"c{i}" for i in range(699_999))]) + "\n"
    with pytest.raises(ReadError, match=rf"has {columns}.* columns; more than 4096"):
        table((names if header else "") + row * 2)


def bomb(size):
    """Return what decompresses to `size` bytes of rows that are no more than zeros."""
    out = io.BytesIO()
    with gzip.GzipFile(fileobj=out, mode="wb", compresslevel=9) as file:
        file.write(b"t,x\n0.5,1\n")
        block = b"0,0\n" * 2**18
        for _ in range(size // len(block)):
            file.write(block)
    return out.getvalue()


def test_a_decompression_bomb_is_refused(tmp_path):
    path = tmp_path / "log"
    path.write_bytes(bomb(64 * 2**20))
    assert path.stat().st_size < 2**20
    with pytest.raises(ReadError, match="100 times larger"):
        read(path)


numbers = st.lists(st.floats(allow_nan=False, width=64), min_size=2, max_size=30)


@settings(max_examples=40, deadline=None)
@given(numbers, st.sampled_from([",", ";", "\t", "|"]), st.booleans(), st.booleans(), st.booleans())
def test_any_number_comes_back_exactly_in_any_notation(tmp_path_factory, cells, separator, comma, quoted, compressed):
    out = io.StringIO()
    quoting = csv.QUOTE_ALL if quoted or (comma and separator == ",") else csv.QUOTE_MINIMAL
    writer = csv.writer(out, delimiter=separator, quoting=quoting, lineterminator="\n")
    writer.writerow(["time [s]", "x [Nm]"])
    for i, cell in enumerate(cells):
        row = [f"{i}.25", repr(cell)]
        writer.writerow([text.replace(".", ",") for text in row] if comma else row)
    data = out.getvalue().encode()
    path = tmp_path_factory.mktemp("exact") / "log"
    path.write_bytes(gzip.compress(data) if compressed else data)
    channel = read(path).channel("x")
    np.testing.assert_array_equal(channel.values, cells)
    assert channel.stamps.tolist() == [i * S + S // 4 for i in range(len(cells))]
    assert channel.unit == "Nm"


def test_a_log_that_was_appended_to_another_is_put_behind_it(table):
    """Sorted by time, the two would run through each other."""
    text = "time,x\n" + "".join(f"{i / 10},{i}\n" for i in range(300)) + "time,x\n"
    recording = table(text + "".join(f"{i / 10},{1000 + i}\n" for i in range(200)))
    channel = recording.channel("x")
    assert channel.values.tolist() == [*range(300), *range(1000, 1200)]
    steps = np.diff(channel.stamps)
    assert np.flatnonzero(steps != S // 10).tolist() == [299]
    assert steps[299] > 2.5 * S / 10, "nothing is to be estimated from one log to the other"
    assert values_of(recording, "clock.log_appended") == [1]


@pytest.mark.parametrize(("row", "stamp"), [(5, "93.0"), (200, "0.0"), (298, "0.0"), (100, "9.7")])
def test_a_single_stamp_that_is_wrong_moves_no_other_row(table, row, stamp):
    rows = [f"{i / 10},{i}\n" for i in range(300)]
    rows[row] = f"{stamp},{row}\n"
    recording = table("time,x\n" + "".join(rows))
    channel = recording.channel("x")
    others = channel.values != row
    np.testing.assert_array_equal(channel.stamps[others], channel.values[others] * S / 10)
    assert others.sum() >= 298


def test_logs_with_dates_put_together_in_another_order_are_sorted(table):
    rows = [f"{1494360168 + i / 10:.1f},{i}\n" for i in range(300)]
    recording = table("time,x\n" + "".join(rows[100:] + rows[:100]))
    assert recording.channel("x").values.tolist() == list(range(300))


@pytest.mark.parametrize(
    "word",
    ["#N/A", "-", "—", "NULL", "1.#QNAN", "-1.#IND", "NaN", "-nan(ind)", "#DIV/0!", "nil", "?", "missing", "n/a"],
)
def test_words_for_no_number(table, word):
    recording = table("time,x\n" + "".join(f"{i / 10},{word if i % 20 == 3 else i}\n" for i in range(40)))
    np.testing.assert_array_equal(recording.channel("x").values, [np.nan if i % 20 == 3 else i for i in range(40)])
    assert recording.findings == ()


def test_commas_between_and_within_numbers_are_refused(table):
    with pytest.raises(ReadError, match=r"has 2 names, but rows have 4 cells.*semicolons"):
        table("time,x\n" + "".join(f"0,{i},1,{i}\n" for i in range(9)))


def test_settings_ahead_of_a_table_with_as_many_cells(table):
    rows = "".join(f"0.{i},{i}\n" for i in range(9))
    recording = table("Operator,me\nRig,A\nRate,1000\nTime [s],theta [rad]\n" + rows)
    assert content(recording) == {"theta": (list(range(9)), "rad")}
    assert recording.findings == ()


def test_an_export_of_labview(table):
    head = """LabVIEW Measurement\t
Writer_Version\t2
Separator\tTab
Decimal_Separator\t,
Date\t2024/03/13
Time\t15:59:59,5
***End_of_Header***\t
\t
Channels\t2
Samples\t60\t60
Date\t2024/03/13\t2024/03/13
Time\t15:59:59,5\t15:59:59,5
X_Dimension\tTime\tTime
X0\t0,0\t0,0
Delta_X\t0,001\t0,001
***End_of_Header***\t\t\t
X_Value\tTorque [Nm]\tAngle\tComment
"""
    recording = table(head + "".join(f"0,{i:03d}\t{i},5\t1,{i % 7}\t\n" for i in range(60)))
    assert content(recording) == {
        "Torque": ([i + 0.5 for i in range(60)], "Nm"),
        "Angle": ([float(f"1.{i % 7}") for i in range(60)], None),
    }
    assert stamps(recording) == [i * S // 1000 for i in range(60)]


def test_excel_writes_a_mark_a_separator_and_the_encoding_of_windows(tmp_path):
    path = tmp_path / "log.csv"
    for raw in (
        "\ufeffsep=;\r\nZeit [s];Winkel [°]\r\n0,1;1,5\r\n0,2;2,5\r\n".encode(),
        "Zeit [s];Winkel [°];\r\n0,1;1,5;\r\n0,2;2,5;\r\n".encode("cp1252"),
    ):
        path.write_bytes(raw)
        assert content(read(path)) == {"Winkel": ([1.5, 2.5], "°")}
        assert stamps(read(path)) == [S // 10, S // 5]


def test_seconds_far_apart_that_begin_again_are_read(table):
    """What is between them is too much to be put behind ten of their steps in 64 bits."""
    recording = table("sec,nanosec,x\n0,0,1\n1700000000,0,2\n0,5,3\n1700000001,4,4\n1700000001,5,5\n")
    assert 5 in recording.channel("x").values
