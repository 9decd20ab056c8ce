"""In what order a stream's samples are, and which of them are copies."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from vsalog.core.column import Column, is_mapped, parts
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
        Samples that have values where others of their stamp have none are none of these: nothing of them is lost.
    late : float
        How late samples of a file came that had to be sorted in memory for that [s]; 0 where there are none.
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
    """Tell how to make stamps strictly increasing.

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
    if not columns:  # nothing to keep or to compare
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
    if not is_mapped(stamps):
        return _at_once(stamps, columns)
    disorder = Disorder.of(stamps)
    if disorder.increasing or not columns:
        return stamps, columns, Order(None, disorder.inversions, 0, 0)
    if disorder.waiting > MOST_WAITING:
        return _at_once(stamps, columns, disorder.late * 1e-9)
    return _piece_by_piece(stamps, columns, disorder)


def _at_once(stamps: Stamps, columns: dict[str, Values], late: float = 0.0) -> tuple[Stamps, dict[str, Values], Order]:
    order = replace(put_in_order(stamps, [*columns.values()]), late=late)
    # Taken one by one, so that there are not two of each at once.
    return order.kept(stamps), {name: order.kept(columns.pop(name)) for name in list(columns)}, order


def _piece_by_piece(
    stamps: Stamps, columns: dict[str, Values], disorder: Disorder
) -> tuple[Stamps, dict[str, Values], Order]:
    out = Column(np.int64, in_file=True)
    out_columns = {name: Column(np.float64, in_file=True) for name in columns}
    duplicates = conflicts = 0
    waiting, waiting_columns = stamps[:0], {name: values[:0] for name, values in columns.items()}
    for first, last in parts(stamps, *columns.values()):
        waiting = np.concatenate((waiting, stamps[first:last]))
        for name, values in columns.items():
            waiting_columns[name] = np.concatenate((waiting_columns[name], values[first:last]))
        # Nothing that is still to come is earlier than this.
        sure = (waiting < waiting.max() - disorder.late) | (last == len(stamps))
        done = [values[sure] for values in waiting_columns.values()]
        order = put_in_order(waiting[sure], done)
        out.append(order.kept(waiting[sure]))
        for column, values in zip(out_columns.values(), done, strict=True):
            column.append(order.kept(values))
        duplicates, conflicts = duplicates + order.duplicates, conflicts + order.conflicts
        waiting, waiting_columns = waiting[~sure], {name: values[~sure] for name, values in waiting_columns.items()}
    count = len(out)
    return (
        out.whole(count),
        {name: column.whole(count) for name, column in out_columns.items()},
        Order(None, disorder.inversions, duplicates, conflicts),
    )


class Disorder:
    """How far a stream's stamps are from strictly increasing.

    Attributes
    ----------
    inversions : samples earlier than one before them
    late : how much a sample is earlier than the latest one before it, at most [ns]
    waiting : so many samples are at most less than `late` apart
    increasing : no stamp comes twice or out of order
    """

    def __init__(self) -> None:
        self.inversions, self.late, self.waiting, self.increasing = 0, 0, 0, True

    @classmethod
    def of(cls, stamps: Stamps) -> Disorder:
        """Go through a stream's stamps."""
        found = cls()
        latest: int | None = None
        before: int | None = None
        for first, last in parts(stamps):
            now = stamps[first:last]
            steps = np.diff(now, prepend=now[0] - 1 if before is None else before)
            found.increasing = found.increasing and bool(steps.min() > 0)
            so_far = np.maximum.accumulate(now if latest is None else np.maximum(now, latest))
            found.inversions += int(np.count_nonzero(now < so_far))
            found.late = max(found.late, int((so_far - now).max()))
            latest, before = int(so_far[-1]), int(now[-1])
        if found.late:
            found.waiting = found._most_waiting(stamps)
        return found

    def _most_waiting(self, stamps: Stamps) -> int:
        """Return how many samples have to be kept at most, until none can come that belongs before them."""
        most = 0
        waiting = np.empty(0, np.int64)
        for first, last in parts(stamps):
            waiting = np.concatenate((waiting, stamps[first:last]))
            most = max(most, waiting.size)
            if most > MOST_WAITING:
                break
            waiting = waiting[waiting >= waiting.max() - self.late]
        return most
