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


@pytest.mark.parametrize("header", ["time,tau,pos [rad]", "time,pos [deg],tau", "time,vel,current"])
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
