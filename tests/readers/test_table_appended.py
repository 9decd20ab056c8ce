"""Text tables to which another was appended, with its header."""

from __future__ import annotations

import numpy as np
import pytest
from finding_codes import codes, found, values_of

from vsalog.readers import read
from vsalog.readers.limits import DECODED_BYTES


def table(header, rows):
    return header + "\n" + "".join(",".join(map(str, row)) + "\n" for row in rows)


def appended(tmp_path, header, second):
    first = [(i / 10, i, 100 + i) for i in range(300)]
    path = tmp_path / "log.csv"
    path.write_text(table("time,pos [rad],tau", first) + table(header, second))
    return read(path)


def test_the_same_header_once_more_is_skipped(tmp_path):
    """Nothing else is lost, and no cell is said to be bad."""
    log = appended(tmp_path, "time,pos [rad],tau", [(30 + i / 10, 300 + i, 400 + i) for i in range(300)])
    np.testing.assert_array_equal(log.channels["pos"].values, np.arange(600.0))
    np.testing.assert_array_equal(log.channels["tau"].values, 100 + np.arange(600.0))
    assert values_of(log, "table.header_again") == [1]
    assert not {"table.cells_without_number", "clock.rows_without_time"} & {*codes(log)}


@pytest.mark.parametrize("header", ["time,pos [m],tau", "time,vel,current", "time,tau [deg],pos", "time,tau,tau"])
def test_nothing_is_read_below_another_header(tmp_path, header):
    """Its numbers are those of other columns, or in a unit that cannot be converted."""
    log = appended(tmp_path, header, [(30 + i / 10, 9000, -9000) for i in range(300)])
    np.testing.assert_array_equal(log.channels["pos"].values, np.arange(300.0))
    np.testing.assert_array_equal(log.channels["tau"].values, 100 + np.arange(300.0))
    assert values_of(log, "table.other_table") == [301]


def test_a_word_in_a_row_of_numbers_is_no_header(tmp_path):
    """Only the time is lost, and the rows behind stay."""
    path = tmp_path / "log.csv"
    rows = [("time" if i == 250 else i / 10, i, 100 + i) for i in range(300)]
    path.write_text(table("time,pos,tau", rows))
    assert len(read(path).channels["pos"].values) == 299


@pytest.mark.parametrize("header", ["time,tau,pos [rad]", "tau,time,pos [rad]", "pos [rad],tau,time"])
@pytest.mark.parametrize("wanted", [None, ["pos"], ["tau"]])
def test_columns_in_another_order_are_read_by_name(tmp_path, header, wanted):
    """Again and again: the third part has the first order once more."""
    names = [name.partition(" ")[0] for name in header.split(",")]
    rows = [{"time": i / 10, "pos": i, "tau": 1000 + i} for i in range(900)]
    first, second, third = rows[:300], rows[300:600], rows[600:]
    parts = [(("time", "pos", "tau"), first), (names, second), (("time", "pos", "tau"), third)]
    text = "".join(
        table(",".join("pos [rad]" if n == "pos" else n for n in order), [[row[n] for n in order] for row in part])
        for order, part in parts
    )
    (tmp_path / "log.csv").write_text(text)
    log = read(tmp_path / "log.csv", wanted)
    assert list(log.channels) == (wanted or ["pos", "tau"])
    for name, channel in log.channels.items():
        np.testing.assert_array_equal(channel.values, [row[name] for row in rows])
        np.testing.assert_array_equal(channel.stamps, np.arange(900) * 10**8)
    assert values_of(log, "table.header_again") == [2]
    assert "table.columns_reordered" in codes(log)


def test_columns_in_another_order_far_below(tmp_path):
    """What was read ahead of the header is not read twice, whatever blocks the rows come in."""
    first = [(i / 10, i, f"{1000 + i:040}") for i in range(150_000)]
    second = [(f"{150_000 + i:040}", 15_000 + i / 10, 1000 + i) for i in range(1000)]
    (tmp_path / "log.csv").write_text(table("time,pos,tau", first) + table("pos,time,tau", second))
    channel = read(tmp_path / "log.csv", ["pos"]).channels["pos"]
    np.testing.assert_array_equal(channel.values, np.arange(151_000.0))


def test_two_columns_of_one_name_in_another_order(tmp_path):
    first, second = (
        [(i / 10, i, 1000 + i, 5) for i in range(300)],
        [(30 + i / 10, 5, 300 + i, 1300 + i) for i in range(9)],
    )
    (tmp_path / "log.csv").write_text(table("time,x,x,y", first) + table("time,y,x,x", second))
    log = read(tmp_path / "log.csv")
    np.testing.assert_array_equal(log.channels["x"].values, np.arange(309.0))
    np.testing.assert_array_equal(log.channels["x#2"].values, 1000 + np.arange(309.0))


def test_nothing_but_headers_comes_to_an_end(tmp_path):
    """Each takes far longer than a row; a compressed file of them would take hours."""
    log = appended(tmp_path, "time,pos [rad],tau", [("time", "pos [rad]", "tau")] * 20_000)
    np.testing.assert_array_equal(log.channels["pos"].values, np.arange(300.0))
    assert values_of(log, "table.too_many_headers") == [301]


N = 300
FIRST = {"time": np.arange(N) / 100, "motor": 1000.0 + np.arange(N), "link": 5000.0 + np.arange(N)}
SECOND = {"time": 3 + np.arange(N) / 100, "motor": 1300.0 + np.arange(N), "link": 5300.0 + np.arange(N)}


def rows(columns, order, separator=",", scale=1.0):
    cells = zip(*(columns[name] * (scale if name == "motor" else 1) for name in order), strict=True)
    return "".join(separator.join(f"{cell:.9g}" for cell in row) + "\n" for row in cells)


def check_both(log, names=("motor", "link"), rtol=0.0):
    for name, column in zip(names, ("motor", "link"), strict=True):
        expected = np.concatenate([FIRST[column], SECOND[column]])
        np.testing.assert_allclose(log.channels[name].values, expected, rtol=rtol)
        np.testing.assert_array_equal(log.channels[name].stamps, np.arange(2 * N) * 10**7)
    assert not {"table.cells_without_number", "clock.rows_without_time"} & {*codes(log)}


@pytest.mark.parametrize("separator", [",", ";", "\t", " "])
@pytest.mark.parametrize(
    ("first", "again"),
    [("# ", "# "), ("", "# "), ("# ", ""), ("# log of today\n# ", "# log of today\n#"), ("#", "%  ")],
)
def test_a_header_in_a_remark_changes_the_order(tmp_path, separator, first, again):
    names, others = separator.join(["time", "motor", "link"]), separator.join(["time", "link", "motor"])
    above = f"{first}{names}\n{rows(FIRST, ['time', 'motor', 'link'], separator)}"
    below = f"{again}{others}\n{rows(SECOND, ['time', 'link', 'motor'], separator)}"
    (tmp_path / "log.csv").write_text(above + below)
    check_both(read(tmp_path / "log.csv"))
    (one,) = read(tmp_path / "log.csv", ["link"]).channels.values()
    np.testing.assert_array_equal(one.values, np.concatenate([FIRST["link"], SECOND["link"]]))


@pytest.mark.parametrize(
    "remark",
    [
        "# operator: link stiff",
        "# paused",
        "# link,stiff,now",
        "# time to go, motor hot, link cold",
        "# motor, link, both",
        "# 1,2,3",
        "#",
        "# motor and link",
    ],
)
@pytest.mark.parametrize("separator", [",", " "])
def test_a_remark_of_words_is_passed_over(tmp_path, remark, separator):
    order = ["time", "motor", "link"]
    text = separator.join(order) + "\n" + rows(FIRST, order, separator) + remark + "\n" + rows(SECOND, order, separator)
    (tmp_path / "log.csv").write_text(text)
    log = read(tmp_path / "log.csv")
    check_both(log)
    assert [(one.code, one.value) for one in log.findings] == [("table.remarks", 1)]


@pytest.mark.parametrize(
    "header",
    [
        "Time,Link,Motor Pos",
        "TIME [s],LINK (rad),MOTOR_POS",
        " time , link , motor-pos",
        "t [s],link,motor.pos",
        "Timestamp;Link",
    ],
)
def test_names_are_the_same_in_another_spelling(tmp_path, header):
    """Only those that mean the same: a header of two cells is none of this table."""
    above = "time,motor_pos,link\n" + rows(FIRST, ["time", "motor", "link"])
    (tmp_path / "log.csv").write_text(above + header + "\n" + rows(SECOND, ["time", "link", "motor"]))
    log = read(tmp_path / "log.csv")
    if ";" not in header:
        check_both(log, ("motor_pos", "link"))
        assert ("table.unit_stated_once" in codes(log)) == ("(rad)" in header)


@pytest.mark.parametrize(
    "again", ["time,motor,link\ns,deg,-\n", "Link,Motor [deg],Time\n", "# motor,link,time\n# [deg],[-],[s]\n"]
)
def test_numbers_in_another_unit_are_converted(tmp_path, again):
    order = [name.strip(" #").partition(" ")[0].lower() for name in again.splitlines()[0].split(",")]
    above = "time,motor,link\ns,rad,-\n" + rows(FIRST, ["time", "motor", "link"])
    (tmp_path / "log.csv").write_text(above + again + rows(SECOND, order, scale=180 / np.pi))
    log = read(tmp_path / "log.csv")
    check_both(log, rtol=1e-8)
    assert log.channels["motor"].unit == "rad"
    assert [one.evidence["columns"] for one in found(log, "table.units_converted")] == ["'motor'"]


@pytest.mark.parametrize(("unit", "scale"), [("ms", 10**3), ("us", 10**6), ("min", 1 / 60)])
@pytest.mark.parametrize("stated", ["time [s]", "time", "t_s"])
def test_times_in_another_unit_are_converted_exactly(tmp_path, unit, scale, stated):
    """Also where the first header states none, and the steps told it."""
    times = [3 + i / 100 for i in range(N)]
    above = f"{stated},motor\n" + rows(FIRST, ["time", "motor"])
    below = "".join(f"{1300 + i},{t * scale!r}\n" for i, t in enumerate(times))
    (tmp_path / "log.csv").write_text(f"{above}motor,time_{unit}\n{below}")
    (channel,) = read(tmp_path / "log.csv").channels.values()
    np.testing.assert_array_equal(channel.stamps, np.arange(2 * N) * 10**7)
    np.testing.assert_array_equal(channel.values, 1000.0 + np.arange(2 * N))


def test_decimal_commas_in_another_unit(tmp_path):
    head = "time;motor [rad]\n" + rows(FIRST, ["time", "motor"], ";").replace(".", ",")
    again = "time;motor [mrad]\n" + "".join(f"{3 + i / 100};{1_300_000.5 + 1000 * i}\n" for i in range(N)).replace(
        ".", ","
    )
    (tmp_path / "log.csv").write_text(head + again)
    (channel,) = read(tmp_path / "log.csv").channels.values()
    np.testing.assert_allclose(channel.values[N:], 1300.0005 + np.arange(N), rtol=1e-14)
    np.testing.assert_array_equal(channel.stamps, np.arange(2 * N) * 10**7)


def test_reading_goes_on_below_the_next_header_that_fits(tmp_path):
    """A table of other columns between two parts of a log costs its own rows only."""
    order = ["time", "motor", "link"]
    head = ",".join(order) + "\n"
    other = "time,current,voltage\n" + "7,8,9\n" * 50
    (tmp_path / "log.csv").write_text(head + rows(FIRST, order) + other + head + rows(SECOND, order))
    log = read(tmp_path / "log.csv")
    check_both(log)
    assert values_of(log, "table.other_table") == [301]


def test_a_header_of_several_rows_once_more(tmp_path):
    head = ",motor,,link\ntime,pos,tau,pos\ns,rad,N*m,deg\n"
    first = [(i / 10, i, 100 + i, 500 + i) for i in range(100)]
    text = "".join(",".join(map(str, row)) + "\n" for row in first)
    again = "".join(",".join(map(str, (row[0] + 10, row[1], row[3], row[2]))) + "\n" for row in first)
    (tmp_path / "log.csv").write_text(head + text + head + text + ",motor,link,motor\ntime,pos,pos,tau\n" + again)
    log = read(tmp_path / "log.csv")
    for name, offset in (("motor.pos", 0), ("motor.tau", 100), ("link.pos", 500)):
        np.testing.assert_array_equal(log.channels[name].values, np.tile(offset + np.arange(100.0), 3))


def test_what_a_header_below_few_rows_says_is_heeded(tmp_path):
    """The first rows tell how the columns are written; those of another order tell wrong."""
    few = {name: column[:20] for name, column in FIRST.items()}
    text = (
        "time,motor,link\n"
        + rows(few, ["time", "motor", "link"])
        + "motor,time,link\n"
        + rows(SECOND, ["motor", "time", "link"])
    )
    (tmp_path / "log.csv").write_text(text)
    log = read(tmp_path / "log.csv")
    np.testing.assert_array_equal(log.channels["motor"].values, np.concatenate([FIRST["motor"][:20], SECOND["motor"]]))


@pytest.mark.parametrize("words", ["ERROR,ERROR,ERROR", "Warning,,", "nan,nan,nan", "x,x,1", "---,---,---", "NULL,,"])
def test_words_that_name_no_columns_cost_their_row_only(tmp_path, words):
    order = ["time", "motor", "link"]
    text = ",".join(order) + "\n" + rows(FIRST, order) + words + "\n" + rows(SECOND, order)
    (tmp_path / "log.csv").write_text(text)
    log = read(tmp_path / "log.csv")
    np.testing.assert_array_equal(log.channels["motor"].values, np.concatenate([FIRST["motor"], SECOND["motor"]]))
    assert not {"table.other_table", "table.header_again", "table.header_below"} & {*codes(log)}


def test_a_header_at_the_border_of_two_blocks(tmp_path):
    """Whatever lines of it lie on which side."""
    head = "time,motor\ns,rad\n"
    row = "{:09.2f},{:09.0f}\n"
    size = DECODED_BYTES // len(row.format(0, 0))
    for shift in range(-3, 2):
        first = "".join(row.format(i / 100, i) for i in range(size + shift))
        again = "".join(f"{i},{(size + shift + i) / 100}\n" for i in range(5))
        (tmp_path / "log.csv").write_text(head + first + "motor,time\ndeg,s\n" + again)
        (channel,) = read(tmp_path / "log.csv").channels.values()
        np.testing.assert_allclose(channel.values[-5:], np.deg2rad(np.arange(5.0)), rtol=1e-12)
        assert len(channel.values) == size + shift + 5


@pytest.mark.parametrize("units", ["# s,rad,-", "#[s], [rad], [-]"])
def test_units_below_names_in_a_remark(tmp_path, units):
    text = f"# log of today\n# time,motor,link\n{units}\n" + rows(FIRST, ["time", "motor", "link"])
    (tmp_path / "log.csv").write_text(text)
    log = read(tmp_path / "log.csv")
    assert {name: channel.unit for name, channel in log.channels.items()} == {"motor": "rad", "link": "-"}
    np.testing.assert_array_equal(log.channels["motor"].stamps, np.arange(N) * 10**7)


def test_quotes_in_another_header_alone(tmp_path):
    again = '"Link [rad]","Motor [mrad]","Time [ms]"\n# "motor [rad]","time [s]","link [rad]"\n'
    text = "time,motor [rad],link [rad]\n" + rows(FIRST, ["time", "motor", "link"]) + again
    (tmp_path / "log.csv").write_text(text + rows(SECOND, ["motor", "time", "link"]))
    check_both(read(tmp_path / "log.csv"))


def test_a_header_below_rows_without_one_names_nothing(tmp_path):
    """What stands in the columns ahead of it nobody says."""
    text = rows(FIRST, ["time", "motor"]) + "time,motor\n" + rows(SECOND, ["time", "motor"]) + "motor,time\n"
    (tmp_path / "log.csv").write_text(text + rows(SECOND, ["motor", "time"]))
    log = read(tmp_path / "log.csv", rate=100.0)
    np.testing.assert_array_equal(log.channels["column_1"].values[: 2 * N], 1000 + np.arange(2.0 * N))
    np.testing.assert_array_equal(log.channels["column_1"].values[2 * N :], SECOND["motor"])
    assert "table.header_below" in codes(log)


@pytest.mark.parametrize(
    "words",
    [
        "Calibrating,please,wait",
        "motor,hot,now\nStopped,0,0",
        "Warning,overheat,off",
        "motor,hot,now",
        "# time is up",
        "Link,lost,again",
    ],
)
@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("separator", [",", " "])
def test_what_a_program_says_is_no_header_where_the_clock_goes_on(tmp_path, words, count, separator):
    order = ["time", "motor", "link"]
    said = (words.replace(",", separator) + "\n") * count
    text = separator.join(order) + "\n" + rows(FIRST, order, separator) + said + rows(SECOND, order, separator)
    (tmp_path / "log.csv").write_text(text)
    log = read(tmp_path / "log.csv")
    np.testing.assert_array_equal(log.channels["motor"].values, np.concatenate([FIRST["motor"], SECOND["motor"]]))
    assert "table.other_table" not in codes(log)


@pytest.mark.parametrize("words", ["Sample,Winkel,Moment", "# time pressure temperature"])
def test_a_header_of_other_names_is_one_where_the_clock_does_not_go_on(tmp_path, words):
    order = ["time", "motor", "link"]
    separator = " " if "#" in words else ","
    text = (
        separator.join(order)
        + "\n"
        + rows(FIRST, order, separator)
        + words
        + "\n"
        + rows(FIRST, order[::-1], separator)
    )
    (tmp_path / "log.csv").write_text(text)
    log = read(tmp_path / "log.csv")
    np.testing.assert_array_equal(log.channels["motor"].values, FIRST["motor"])
    assert values_of(log, "table.other_table") == [301]


@pytest.mark.parametrize("remark", ["", "# ", "#", '"', "% "])
@pytest.mark.parametrize("separator", [",", ";", " "])
def test_a_header_behind_a_row_without_an_end(tmp_path, remark, separator):
    """As `cat` puts files together: the row is lost, and columns below are others."""
    names = [f'"{name}"' if remark == '"' else name for name in ("time", "link", "motor")]
    header = remark.strip('"') + separator.join(names)
    above = separator.join(["time", "motor", "link"]) + "\n" + rows(FIRST, ["time", "motor", "link"], separator)
    (tmp_path / "log.csv").write_text(above[:-1] + header + "\n" + rows(SECOND, ["time", "link", "motor"], separator))
    log = read(tmp_path / "log.csv")
    expected = np.delete(np.concatenate([FIRST["motor"], SECOND["motor"]]), N - 1)
    np.testing.assert_array_equal(log.channels["motor"].values, expected)
    assert values_of(log, "table.lines_skipped") == [1]


@pytest.mark.parametrize(
    ("first", "again"),
    [("motor,time", "time,motor"), (",motor,time", "time,,motor"), ("row,motor,time", "row,time,motor,")],
)
def test_a_header_with_a_name_too_few_or_a_separator_too_many(tmp_path, first, again):
    """Its columns change places all the same, or nothing below it is read."""
    above = "".join(f"{i},{1000 + i},{i / 100}\n" for i in range(N))
    below = "".join(f"{i},{i / 100},{1000 + i}\n" for i in range(N, 2 * N))
    (tmp_path / "log.csv").write_text(f"{first}\n{above}{again}\n{below}")
    log = read(tmp_path / "log.csv")
    values = log.channels["motor"].values
    np.testing.assert_array_equal(values, 1000.0 + np.arange(len(values)))
    np.testing.assert_array_equal(log.channels["motor"].stamps, np.arange(len(values)) * 10**7)
    assert len(values) == 2 * N or values_of(log, "table.other_table") == [301]


def test_the_mark_at_a_files_beginning_is_in_the_middle_of_two(tmp_path):
    for first, again in (("\ufefftime,motor", "\ufeffmotor,time"), ("\ufeff# time,motor", "\ufeff# motor,time")):
        above, below = rows(FIRST, ["time", "motor"]), rows(SECOND, ["motor", "time"])
        (tmp_path / "log.csv").write_text(f"{first}\n{above}{again}\n{below}", encoding="utf-8")
        (channel,) = read(tmp_path / "log.csv").channels.values()
        np.testing.assert_array_equal(channel.values, 1000 + np.arange(2.0 * N))


def test_a_remark_at_the_end_of_a_row_is_no_header(tmp_path):
    text = "time motor link\n" + rows(FIRST, ["time", "motor", "link"], " ")
    (tmp_path / "log.csv").write_text(
        text + "3 1300 5300 # lost link again\n" + rows(SECOND, ["time", "motor", "link"], " ")
    )
    check_both(log := read(tmp_path / "log.csv"))
    (skipped,) = log.findings
    assert (skipped.code, skipped.value, skipped.evidence["cells"]) == ("table.lines_skipped", 1, 3)
    assert skipped.evidence["first"] == "3 1300 5300 # lost link again"


@pytest.mark.parametrize("channels", [["motor"], ["motor", "link"]])
@pytest.mark.parametrize("end", ["", "\t"])
def test_segments_of_labview(tmp_path, channels, end):
    """Each has a head of its own."""
    text = "LabVIEW Measurement\t\nWriter_Version\t2\n***End_of_Header***\t\n\t\n"
    for part in (FIRST, SECOND):
        per = "\t".join("{}" for _ in channels)
        text += f"Channels\t{len(channels)}\nSamples\t{per.replace('{}', '300')}\nX_Dimension\t{per.replace('{}', 'Time')}\n"
        text += "***End_of_Header***\nX_Value\t" + "\t".join(channels) + "\tComment\n"
        text += rows(part, ["time", *channels], "\t").replace("\n", end + "\n")
    (tmp_path / "log.lvm").write_text(text)
    log = read(tmp_path / "log.lvm")
    for name in channels:
        np.testing.assert_array_equal(log.channels[name].values, np.concatenate([FIRST[name], SECOND[name]]))
        np.testing.assert_array_equal(log.channels[name].stamps, np.arange(2 * N) * 10**7)
    assert "table.other_table" not in codes(log)


@pytest.mark.parametrize(
    ("first", "again"),
    [
        ("%time,field.motor,field.link", "%time,field.link,field.motor"),
        ("Zeit,motor,link", "time,link,motor"),
        ("stamp,a.motor,b.motor", "stamp,b.motor,a.motor"),
        ('time,"motor, left",link', 'time,link,"motor, left"'),
        ("time,q+,q-", "time,q-,q+"),
    ],
)
def test_names_of_many_kinds_in_another_order(tmp_path, first, again):
    text = f"{first}\n{rows(FIRST, ['time', 'motor', 'link'])}\n\n{again}\n\n{rows(SECOND, ['time', 'link', 'motor'])}"
    (tmp_path / "log.csv").write_text(text)
    log = read(tmp_path / "log.csv")
    for channel, begin in zip(log.channels.values(), (1000.0, 5000.0), strict=True):
        scale = 10**7 if first[0] != "%" else 1
        np.testing.assert_array_equal(channel.values, begin + np.arange(2.0 * N))
        assert scale == 1 or (channel.stamps == np.arange(2 * N) * scale).all()


def test_an_index_without_a_name_ahead_of_columns_that_change_places(tmp_path):
    """A blank cell begins its header, and no word."""
    text = ",time,motor,link\n" + "".join(
        f"{i},{row}\n" for i, row in enumerate(rows(FIRST, ["time", "motor", "link"]).split())
    )
    text += ",time,link,motor\n" + "".join(
        f"{i},{row}\n" for i, row in enumerate(rows(SECOND, ["time", "link", "motor"]).split())
    )
    (tmp_path / "log.csv").write_text(text)
    check_both(read(tmp_path / "log.csv"))
