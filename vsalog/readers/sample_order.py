"""The order of a stream's samples, and its copies."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from vsalog.core.column import Column, is_mapped, let_go, parts
from vsalog.core.recording import Stamps, Values
from vsalog.readers.limits import MOST_WAITING

Number = TypeVar("Number", np.int64, np.float64)


@dataclass(frozen=True, slots=True)
class Order:
    """How to bring samples into strictly increasing order.

    Attributes
    ----------
    keep : int64 array, shape (m,), or None
        Indices of the samples to keep, in order; None means all as they are.
    inversions, duplicates, conflicts : int
        Samples earlier than one before them, exact copies, and samples with the stamp of another but other values.
        Samples that have values where others of their stamp have none are none of these: they are merged.
    late : float
        The largest delay of samples for which very many had to be sorted at once [s]; 0 for none.
    """

    keep: NDArray[np.intp] | None
    inversions: int
    duplicates: int
    conflicts: int
    late: float = 0.0

    def kept(self, values: NDArray[Number]) -> NDArray[Number]:
        """Return the values that are kept, in order."""
        return values if self.keep is None else values[self.keep]


def put_in_order(stamps: Stamps, columns: list[NDArray[np.float64]]) -> Order:
    """Return how to make stamps strictly increasing.

    Of samples with equal stamps the first in the log is kept, with the first of their values of each column where it has
    none itself. The others are copies where all their values are the same, and conflicts where one is another.

    Parameters
    ----------
    stamps : int64 array, shape (n,)
        Nanoseconds.
    columns : list of float64 array, shape (n,)
        The stream's values; those that kept samples take over from others are put into them.
    """
    steps = np.diff(stamps)
    if not len(steps) or steps.min() > 0:
        return Order(None, 0, 0, 0)
    inversions = int(np.count_nonzero(stamps < np.maximum.accumulate(stamps)))
    if not columns:  # nothing to compare
        return Order(None, inversions, 0, 0)
    order = np.argsort(stamps, kind="stable") if inversions else np.arange(len(stamps))
    ordered = stamps[order]
    first = np.concatenate([[True], np.diff(ordered) > 0])
    leader = order[np.flatnonzero(first)[np.cumsum(first) - 1]]  # the kept sample with the same stamp
    repeats = np.flatnonzero(~first)
    copies, agree = np.ones(len(repeats), dtype=bool), np.ones(len(repeats), dtype=bool)
    for values in columns:
        mine, kept = values[order[repeats]], values[leader[repeats]]
        copies &= (mine == kept) | (np.isnan(mine) & np.isnan(kept))
        taken = np.flatnonzero(np.isnan(kept) & ~np.isnan(mine))[::-1]  # the first last, which remains
        values[leader[repeats[taken]]] = mine[taken]
        agree &= (mine == values[leader[repeats]]) | np.isnan(mine)
    duplicates = int(np.count_nonzero(copies))
    return Order(order[first], inversions, duplicates, int(np.count_nonzero(~agree)))


def in_order(stamps: Stamps, columns: dict[str, Values]) -> tuple[Stamps, dict[str, Values], Order]:
    """Return a stream's stamps, strictly increasing, its columns, which are taken, and what was done; see `put_in_order`."""
    if all(bool((np.diff(stamps[max(0, first - 1) : last]) > 0).all()) for first, last in parts(stamps)):
        return stamps, columns, Order(None, 0, 0, 0)
    if not columns or not is_mapped(stamps):
        order = put_in_order(stamps, [*columns.values()])
        # Taken one by one, so that there are not two of each at once.
        return order.kept(stamps), {name: order.kept(columns.pop(name)) for name in list(columns)}, order
    out = Column(np.int64, in_file=True)
    out_columns = {name: Column(np.float64, in_file=True) for name in columns}
    orders, late = [], 0
    for first, last in _pieces(stamps):
        piece, values = stamps[first:last], [column[first:last].copy() for column in columns.values()]
        let_go(*(column[first:last] for column in columns.values()))
        order = put_in_order(piece, values)
        out.append(order.kept(piece))
        for column, some in zip(out_columns.values(), values, strict=True):
            column.append(order.kept(some))
        orders.append(order)
        if last - first > MOST_WAITING:
            late = max(late, int((np.maximum.accumulate(piece) - piece).max()))
    count = len(out)
    inversions, duplicates = (sum(one.inversions for one in orders), sum(one.duplicates for one in orders))
    done = Order(None, inversions, duplicates, sum(one.conflicts for one in orders), late * 1e-9)
    return out.whole(count), {name: column.whole(count) for name, column in out_columns.items()}, done


def _pieces(stamps: Stamps) -> Iterator[tuple[int, int]]:
    """Yield first row and last row, that one excluded, of pieces behind which no sample is as early as one in them."""
    earliest = [int(stamps[first:last].min()) for first, last in parts(stamps)]
    behind = [*np.minimum.accumulate(earliest[:0:-1])[::-1].tolist(), np.iinfo(np.int64).max]
    begin, latest = 0, np.iinfo(np.int64).min
    for (first, last), least in zip(parts(stamps), behind, strict=True):
        now = stamps[first:last]
        so_far = np.maximum(np.maximum.accumulate(now), latest)
        still_to_come = np.minimum(np.append(np.minimum.accumulate(now[:0:-1])[::-1], least), least)
        ends = np.flatnonzero(so_far < still_to_come) + first + 1
        if ends.size:
            yield begin, int(ends[-1])
            begin = int(ends[-1])
        latest = int(so_far[-1])
    if begin < len(stamps):
        yield begin, len(stamps)
