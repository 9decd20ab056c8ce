"""Text tables to which another was appended, with its header."""

from __future__ import annotations

import numpy as np
import pytest

from vsalog.readers import read


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
    assert any("1 line between the rows skipped as the header once more" in note for note in log.notes)
    assert not any("without a number" in note or "without a time" in note for note in log.notes)


@pytest.mark.parametrize("header", ["time,pos [deg],tau", "time,vel,current", "time,tau,pos [deg]", "time,tau,tau"])
def test_nothing_is_read_below_another_header(tmp_path, header):
    """Its numbers are those of other columns, or in another unit."""
    log = appended(tmp_path, header, [(30 + i / 10, 9000, -9000) for i in range(300)])
    np.testing.assert_array_equal(log.channels["pos"].values, np.arange(300.0))
    np.testing.assert_array_equal(log.channels["tau"].values, 100 + np.arange(300.0))
    assert any("left out from row 301 on" in note for note in log.notes)


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
    assert any("2 lines between the rows skipped as the header once more; columns whose order" in n for n in log.notes)


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
    assert any("left out from row 301 on" in note and "one too many" in note for note in log.notes)
