"""Long tables: key columns name the owner of a row's values; rows of several joints or signals alternate, or are in blocks."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from itertools import combinations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.recording import Stamps
from vsalog.core.significance import REPEATS
from vsalog.readers.limits import MAX_ARRAY, MOST_EXCEPTIONS, MOST_PARTS
from vsalog.readers.reach import Stamp
from vsalog.readers.tables.cells import numbers_and_words
from vsalog.readers.tables.dates import trimmed
from vsalog.readers.tables.text import printable_cell
from vsalog.readers.tables.time_columns import ClockColumn, ClockPlan, nanoseconds
from vsalog.readers.tables.time_units import plain

MOST_KEYS = 3
"""Columns that together name a part: a robot, its arm and a joint."""
_NAMED = re.compile(
    r"(^|[_.])(robot|joint|motor|axis|actuator|sensor|device|node|link|part|channel|topic|source|signal|variable|quantity|id|name)"
    r"(_?(id|name|no|nr|index))?$"
)

BETWEEN = "\x1f"
"""The separator between the texts of several columns; no text contains it."""
Whole = Callable[[Sequence[int]], Iterable[Sequence[pa.Array]]]
"""Returns some columns from their first row to the last, part by part."""
Keys = tuple[int, ...]


def find_speakers(
    names: Sequence[str], sample: Sequence[pa.Array], plan: ClockPlan, whole: Whole
) -> tuple[Speakers | None, Finding | None]:
    """Return the owners of the rows of a table, None where there is only one, and the findings about them.

    Parameters
    ----------
    names : sequence of str
        Of the columns.
    sample : sequence of pyarrow arrays
        First rows of all columns.
    plan : ClockPlan
        Which of them are clocks.
    whole : function
        Gives all rows of some columns.
    """
    keys = find_keys(names, sample, plan, whole)
    if not keys:
        return None, None
    speakers = Speakers([names[i] for i in keys], keys, whole(keys))
    return speakers, speakers.finding()


def find_keys(names: Sequence[str], sample: Sequence[pa.Array], plan: ClockPlan, whole: Whole) -> Keys:
    """Return the columns that together name the owner of a row's values: the fewest for each of whose values the time increases.

    Columns of words may be keys where rows share their times. A column with such a name may also be one where rows alternate, and
    where they are in blocks, with the same times again; so may any where these are dates, which do not restart with
    every experiment.
    """
    clock = plan.clocks.get("column")
    if clock is None:
        return ()
    called = {i for i, name in enumerate(names) if _NAMED.search(plain(name))}
    able = [
        i
        for i, cells in enumerate(sample)
        if i not in plan.columns()
        and _may_name(cells, i in called)
        and len(cells)
        and len(pc.unique(cells)) <= MAX_ARRAY
    ]
    able = sorted(able, key=lambda i: i not in called)[:REPEATS]
    first = [[sample[i] for i in (*able, *clock.columns)]]
    keys = _keys(able, (), first, clock)
    if not keys:
        keys = next(((i,) for i in able if i in called and _alternates(sample[i])), ())
    stamps, good = nanoseconds([sample[i] for i in clock.columns], clock.form)
    dated = bool(good.any() and stamps[good].min() >= Stamp.YEAR_2000)
    others = [i for i in able if i in {*keys, *called} or dated]
    return _keys(others, keys, whole([*others, *clock.columns]), clock) if {*others} - {*keys} else keys


def _may_name(cells: pa.Array, called: bool) -> bool:
    """Return whether a column contains words, or whole numbers and has the name of a key."""
    if not (pa.types.is_string(cells.type) or pa.types.is_integer(cells.type)):
        return False
    numbers, words = numbers_and_words(pc.cast(cells, pa.string()))
    return called if numbers else words > 0


def _alternates(cells: pa.Array) -> bool:
    """Return whether few values change from row to row, mostly."""
    who = joined([cells]).dictionary_encode().indices.to_numpy()
    return 2 <= who.max() + 1 <= len(who) // 3 and bool(np.mean(np.diff(who) != 0) > 0.5)


def _keys(able: Sequence[int], known: Keys, parts: Iterable[Sequence[pa.Array]], clock: ClockColumn) -> Keys:
    """Return the fewest columns, those known among them, for each of whose values the time increases if it does not for all.

    Parameters
    ----------
    able : sequence of int
        Columns to choose from.
    known : tuple of int
        Columns that are sure.
    parts : iterable of sequences of pyarrow arrays
        Rows of the able ones and of the clock's columns, part by part.
    clock : ClockColumn
        Whose form is taken.
    """
    some = (one for size in range(len(known), MOST_KEYS + 1) for one in combinations(able, size))
    tried = {
        one: _Rows([able.index(i) for i in one], [able.index(i) for i in one if i not in known])
        for one in some
        if {*known} <= {*one}
    }
    for cells in parts:
        stamps, good = nanoseconds(cells[len(able) :], clock.form)
        texts = [joined([one]) for one in cells[: len(able)]]
        for rows in tried.values():
            rows.add(texts, stamps, good)
    before = tried.pop(known)
    for keys, rows in tried.items():
        few = MOST_PARTS if known else min(MOST_PARTS, rows.count // (3 if len(keys) == 1 else 2))
        goes_on = 2 * rows.back <= before.back and rows.back <= MOST_EXCEPTIONS * rows.count
        # Where values change from row to row, it has to go back with them; blocks are long.
        tells = before.back >= (0.5 - MOST_EXCEPTIONS) * rows.changes
        if (
            2 <= len(rows.last) <= few
            and before.back
            and goes_on
            and (tells or rows.changes <= MOST_EXCEPTIONS * rows.count)
        ):
            return tuple(sorted(keys))
    return known


class _Rows:
    """Counts how often the time does not increase for the values of some columns.

    Attributes
    ----------
    last : dict of str to int
        The last stamp [ns] of each value.
    count, back, changes : int
        Rows, those that are not later than the one before of the same value, and those where the value of new columns changes.
    """

    def __init__(self, places: Sequence[int], new: Sequence[int]) -> None:
        self._places, self._new = places, new
        self.last: dict[str, int] = {}
        self.count = self.back = self.changes = 0

    def add(self, texts: Sequence[pa.Array], stamps: Stamps, good: NDArray[np.bool_]) -> None:
        """Take rows into account, those that have a time."""
        coded, new = (
            joined([texts[k] for k in places] or [pa.nulls(len(stamps), pa.string())]).dictionary_encode()
            for places in (self._places, self._new)
        )
        self.changes += int(np.count_nonzero(np.diff(new.indices.to_numpy()[good])))
        who = coded.indices.to_numpy()[good]
        order = np.argsort(who, kind="stable")
        who, stamps = who[order], stamps[good][order]
        self.count += len(who)
        self.back += int(np.count_nonzero((np.diff(who) == 0) & (np.diff(stamps) <= 0)))
        begins = np.flatnonzero(np.diff(who, prepend=-1))
        for begin, end in zip(begins.tolist(), [*begins[1:].tolist(), len(who)], strict=False):
            name = coded.dictionary[int(who[begin])].as_py()
            self.back += name in self.last and stamps[begin] <= self.last[name]
            if name in self.last or len(self.last) <= MOST_PARTS:
                self.last[name] = int(stamps[end - 1])


def joined(cells: Sequence[pa.Array]) -> pa.Array:
    """Return the texts of several columns as one, "" for a blank."""
    texts = [pc.fill_null(trimmed(one), "") for one in cells]
    return texts[0] if len(texts) == 1 else pc.binary_join_element_wise(*texts, BETWEEN)


def _called(names: Sequence[str]) -> str:
    *others, last = (f"'{printable_cell(name)}'" for name in names)
    return f"columns {', '.join(others)} and {last}" if others else f"column {last}"


class Speakers:
    """The owners of the rows of a table.

    Parameters
    ----------
    names : sequence of str
        Of the key columns, for messages.
    columns : tuple of int
        Those columns.
    cells : iterable of sequences of pyarrow arrays
        Their cells, part by part.

    Attributes
    ----------
    columns : tuple of int
        As given.
    parts : dict of str to str
        The owners, by the suffix of the names of their channels.
    """

    def __init__(self, names: Sequence[str], columns: tuple[int, ...], cells: Iterable[Sequence[pa.Array]]) -> None:
        self.columns = columns
        self._called = _called(names)
        found: dict[str, None] = {}
        for part in cells:
            found |= dict.fromkeys(pc.unique(joined(part)).to_pylist())
            if len(found) > MOST_PARTS:
                break
        self.parts: dict[str, str] = {}
        for one in list(found)[:MOST_PARTS]:
            dotted = f"[{one.replace(BETWEEN, '.')}]"
            self.parts[f"[{one.replace(BETWEEN, '|')}]" if dotted in self.parts else dotted] = one
        self._known = pa.array(self.parts.values(), pa.string())
        self._others = 0

    def rows(self, cells: Sequence[pa.Array]) -> dict[str, NDArray[np.bool_]]:
        """Return the rows of each owner, by the suffix of the names of their channels.

        Parameters
        ----------
        cells : sequence of pyarrow arrays
            Of the key columns.
        """
        found = pc.fill_null(pc.index_in(joined(cells), self._known), -1)
        who = np.asarray(found.to_numpy(zero_copy_only=False), np.int64)
        self._others += int(np.count_nonzero(who < 0))
        return {part: who == k for k, part in enumerate(self.parts)}

    def finding(self) -> Finding:
        """Return the findings about them."""
        shown = ", ".join([part[1:-1] for part in self.parts][:6]) + (", …" if len(self.parts) > 6 else "")
        evidence = {"names": printable_cell(shown)}
        return Finding(code="table.long", part=self._called, value=len(self.parts), evidence=evidence)

    def left_out(self) -> list[Finding]:
        """Return the findings about rows without an owner, once all were given to `rows`."""
        if not self._others:
            return []
        return [Finding(code="table.others_left_out", part=self._called, value=self._others, limit=MOST_PARTS)]
