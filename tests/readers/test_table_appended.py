"""Text tables to which another was appended, with its header."""

from __future__ import annotations

import numpy as np
import pytest
from finding_codes import codes, values_of

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
    """Nothing else is lost, and no cell is reported to be bad."""
    log = appended(tmp_path, "time,pos [rad],tau", [(30 + i / 10, 300 + i, 400 + i) for i in range(300)])
    np.testing.assert_array_equal(log.channels["pos"].values, np.arange(600.0))
    np.testing.assert_array_equal(log.channels["tau"].values, 100 + np.arange(600.0))
    assert values_of(log, "table.header_again") == [1]
    assert not {"table.cells_without_number", "clock.rows_without_time"} & {*codes(log)}


@pytest.mark.parametrize(
    "header",
    [
        "time,pos [m],tau",
        "time,vel,current",
        "time,tau,pos [rad]",
        "tau,time,pos [rad]",
        "time,tau,tau",
        "time,pos",
        "# pos [rad],time,tau",
    ],
)
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


def test_reading_goes_on_below_the_next_header_that_fits(tmp_path):
    """A table of other columns between two parts of a log costs its own rows only."""
    order = ["time", "motor", "link"]
    head = ",".join(order) + "\n"
    other = "time,current,voltage\n" + "7,8,9\n" * 50
    (tmp_path / "log.csv").write_text(head + rows(FIRST, order) + other + head + rows(SECOND, order))
    log = read(tmp_path / "log.csv")
    check_both(log)
    assert values_of(log, "table.other_table") == [301]


@pytest.mark.parametrize("words", ["ERROR,ERROR,ERROR", "Warning,,", "nan,nan,nan", "x,x,1", "---,---,---", "NULL,,"])
def test_words_that_name_no_columns_cost_their_row_only(tmp_path, words):
    order = ["time", "motor", "link"]
    text = ",".join(order) + "\n" + rows(FIRST, order) + words + "\n" + rows(SECOND, order)
    (tmp_path / "log.csv").write_text(text)
    log = read(tmp_path / "log.csv")
    np.testing.assert_array_equal(log.channels["motor"].values, np.concatenate([FIRST["motor"], SECOND["motor"]]))
    assert not {"table.other_table", "table.header_again"} & {*codes(log)}


@pytest.mark.parametrize("units", ["# s,rad,-", "#[s], [rad], [-]"])
def test_units_below_names_in_a_remark(tmp_path, units):
    text = f"# log of today\n# time,motor,link\n{units}\n" + rows(FIRST, ["time", "motor", "link"])
    (tmp_path / "log.csv").write_text(text)
    log = read(tmp_path / "log.csv")
    assert {name: channel.unit for name, channel in log.channels.items()} == {"motor": "rad", "link": "-"}
    np.testing.assert_array_equal(log.channels["motor"].stamps, np.arange(N) * 10**7)


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


def test_nothing_but_headers_comes_to_an_end(tmp_path):
    """Each takes far longer than a row."""
    log = appended(tmp_path, "time,pos [rad],tau", [("time", "pos [rad]", "tau")] * 20_000)
    np.testing.assert_array_equal(log.channels["pos"].values, np.arange(300.0))


def test_a_header_of_several_rows_once_more(tmp_path):
    head = "time,pos,tau\ns,rad,N*m\n"
    text = rows(FIRST, ["time", "motor", "link"])
    (tmp_path / "log.csv").write_text(head + text + head + rows(SECOND, ["time", "motor", "link"]))
    log = read(tmp_path / "log.csv")
    check_both(log, ("pos", "tau"))
    assert values_of(log, "table.header_again") == [2]


@pytest.mark.parametrize(
    "head", ["time,motor,link\n", '"time","motor","link"\n', "# time,motor,link\n", "time,motor,link,\n"]
)
def test_a_header_that_comes_again_in_the_middle_of_two_files(tmp_path, head):
    """With the mark of the encoding, as files that were put together have it."""
    order = ["time", "motor", "link"]
    (tmp_path / "log.csv").write_text(
        f"\ufeff{head}{rows(FIRST, order)}\ufeff{head}{rows(SECOND, order)}", encoding="utf-8"
    )
    check_both(read(tmp_path / "log.csv"))


def test_a_header_at_the_border_of_two_blocks(tmp_path):
    row = "{:09.2f},{:09.0f}\n"
    size = DECODED_BYTES // len(row.format(0, 0))
    for shift in range(-3, 2):
        first = "".join(row.format(i / 100, i) for i in range(size + shift))
        again = "".join(row.format((size + shift + i) / 100, size + shift + i) for i in range(5))
        (tmp_path / "log.csv").write_text(f"time,motor\n{first}time,motor\n{again}")
        (channel,) = read(tmp_path / "log.csv").channels.values()
        np.testing.assert_array_equal(channel.values, np.arange(size + shift + 5.0))
