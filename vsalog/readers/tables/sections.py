"""Several logs in one table: side by side, each with its clock (``time,position,time.1,torque``), or merged, with blank cells."""

from __future__ import annotations

import re
from bisect import bisect
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from vsalog.readers.columns_together import LEAST_TOGETHER
from vsalog.readers.tables.time_columns import ClockColumn, ClockPlan, nanoseconds


class Section(NamedTuple):
    """Columns that share a clock.

    Attributes
    ----------
    clocks : mapping of str to ClockColumn
        By kind, as in `ClockPlan`.
    columns : list of int
        Those of its channels.
    """

    clocks: Mapping[str, ClockColumn]
    columns: list[int]


def find_sections(
    names: Sequence[str], sample: Sequence[pa.Array], plan: ClockPlan, channels: Sequence[int]
) -> list[Section]:
    """Return which columns are on which clock: where the clock's name is repeated, the following columns are on that one.

    Parameters
    ----------
    names : sequence of str
        Of all columns, the second of one name with the suffix ``#2``, or ``.1`` where pandas wrote the table.
    sample : sequence of pyarrow arrays
        First rows of all columns.
    plan : ClockPlan
        The table's clocks.
    channels : sequence of int
        The columns that are no clocks of `plan`.
    """
    clock = plan.clocks.get("column")
    if clock is None or len(clock.columns) > 1:
        return [Section(plan.clocks, [*channels])]
    first = clock.columns[0]
    again = [i for i in _called_again(names, first) if i in channels and _rises(sample[i], clock.form)]
    clocks = [first, *again]
    ahead = first > 0 and clocks[-1] == len(names) - 1  # values are before their clock
    sections = [Section({"column": ClockColumn((at,), clock.form)}, []) for at in clocks]
    others = set(again)
    for i in channels:
        if i not in others:
            sections[bisect(clocks if ahead else again, i)].columns.append(i)
    return sections if all(section.columns for section in sections) else [Section(plan.clocks, [*channels])]


def group_by_blanks(sample: Sequence[pa.Array], columns: Sequence[int]) -> list[list[int]]:
    """Group columns that fill the same rows.

    Parameters
    ----------
    sample : sequence of pyarrow arrays
        First rows of all columns.
    columns : sequence of int
        The columns to group.

    Returns
    -------
    list of list of int
        First the columns that are (nearly) full, or blank throughout, even if there are none; then the groups of others.
    """
    full: list[int] = []
    sparse: dict[bytes, list[int]] = {}
    for i in columns:
        blank = np.asarray(pc.is_null(sample[i], nan_is_null=True).to_numpy(zero_copy_only=False), bool)
        if blank.all() or blank.mean() < 1 - LEAST_TOGETHER:
            full.append(i)
        else:
            sparse.setdefault(blank.tobytes(), []).append(i)
    return [full, *sparse.values()]


def _called_again(names: Sequence[str], first: int) -> list[int]:
    """Return the columns with the clock's name again: the same name, or one that programs derive from it.

    A number is that of a further log only where others have it too: ``time,position,time_1,position_1``.
    """
    written = re.compile(rf"{re.escape(names[first])}(?:#\d+|\.\d+|(?P<number>[_ -]?\d+|[_ ]*\(\d+\)))")
    again = [(i, match["number"]) for i, name in enumerate(names) if (match := written.fullmatch(name))]
    return [i for i, number in again if number is None or _follows(names, i, number)]


def _follows(names: Sequence[str], at: int, number: str) -> bool:
    return any(name.removesuffix(number) in names for name in names[at + 1 :] if name.endswith(number))


def _rises(cells: pa.Array, form: str) -> bool:
    stamps, good = nanoseconds([cells], form)
    return bool(good.any() and (np.diff(stamps[good]) >= 0).all())
