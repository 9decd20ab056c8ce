"""The spool: what is appended is read again, from either end, and what is changed stays changed."""

import numpy as np
import pytest

from vsalog.estimators.spool import Spool

KIND = np.dtype([("x", "f8", (2,)), ("flag", "?")])


def rows(first, last):
    made = np.zeros(last - first, KIND)
    made["x"] = np.arange(first, last)[:, None]
    made["flag"] = np.arange(first, last) % 3 == 0
    return made


@pytest.mark.parametrize("size", [1, 7, 100])
def test_rows_come_back_from_the_last_to_the_first_and_keep_what_is_changed(size):
    spool = Spool(KIND)
    for first, last in ((0, 5), (5, 5), (5, 6), (6, 40)):
        spool.append(rows(first, last))
    assert len(spool) == 40
    seen = []
    for part in spool.backwards(size):
        seen.append(part.copy())
        part["x"] += 0.5
    np.testing.assert_array_equal(np.concatenate(seen[::-1]), rows(0, 40))
    np.testing.assert_array_equal(spool.read(3, 12)["x"], rows(3, 12)["x"] + 0.5)
    np.testing.assert_array_equal(spool.read(3, 12)["flag"], rows(3, 12)["flag"])


def test_a_spool_without_rows_has_no_parts():
    assert list(Spool(KIND).backwards()) == []


def test_what_was_read_does_not_follow_later_changes():
    spool = Spool(KIND)
    spool.append(rows(0, 4))
    before = spool.read(0, 4)
    for part in spool.backwards():
        part["x"] = -1.0
    np.testing.assert_array_equal(before, rows(0, 4))
