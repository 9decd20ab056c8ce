"""Columns of samples: the same numbers in memory and in a file, whose pages come back when they are asked for again."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vsalog.core.column import ABSENT_BITS, Column, is_mapped, let_go, parts


def column_of(values, sizes, room=0, *, in_file=False):
    column, at = Column(values.dtype.type, room, in_file=in_file), 0
    for size in sizes:
        column.append(values[at : at + size])
        at += size
    return column


@given(
    st.lists(st.integers(0, 3000), max_size=8),
    st.integers(0, 5000),
    st.sampled_from([np.int64, np.float64, np.bool_, np.int32]),
)
def test_a_column_is_what_was_added_wherever_it_is(sizes, room, kind):
    values = (np.random.default_rng(0).normal(size=sum(sizes)) * 10).astype(kind)
    for in_file in (False, True):
        column = column_of(values, sizes, room, in_file=in_file)
        np.testing.assert_array_equal(column.so_far(), values)
        whole = column.whole(values.size)
        np.testing.assert_array_equal(whole, values)
        assert whole.dtype == kind
        assert is_mapped(whole) == (in_file and values.size > 0)


@pytest.mark.parametrize("moved", [None, 0, 2, 4])
def test_what_a_block_lacks_is_absent_before_and_after_a_column_moves_to_a_file(moved):
    column = Column(np.float64)
    for k, at in enumerate((10, 25, 25_000, 200_000)):
        if k == moved:
            column.to_file()
        column.add(at, np.arange(10.0))
    if moved == 4:
        column.to_file()
    values = column.whole(300_000)
    there = np.zeros(300_000, bool)
    for at in (10, 25, 25_000, 200_000):
        there[at : at + 10] = True
        np.testing.assert_array_equal(values[at : at + 10], np.arange(10.0))
    assert (values[~there].view(np.int64) == ABSENT_BITS).all()
    assert np.isnan(values[~there]).all()


def test_pages_that_were_let_go_of_come_back():
    values = np.arange(300_000.0)
    column = column_of(values, [values.size], in_file=True).whole(values.size)
    part = column[1000:250_001][3:]
    kept = part[5:10]
    let_go(part, values[:10])
    np.testing.assert_array_equal(kept, values[1008:1013])
    rows = [(first, last) for first, last in parts(column) if column[first:last].sum() > 0.0]
    assert rows[0][0] == 0
    assert rows[-1][1] == column.size
    assert all(last == first for (_, last), (first, _) in pairwise(rows))
    np.testing.assert_array_equal(column, values)
    assert is_mapped(part)
    assert not is_mapped(column.copy())
    assert not is_mapped(column + 1.0)
