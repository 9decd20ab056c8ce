"""Long tables: one column says whose values a row holds; rows of several joints or signals alternate, or come in blocks."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vsalog.readers.base import plural
from vsalog.readers.headers import printable_cell
from vsalog.readers.table_cells import numbers_and_words
from vsalog.readers.time_columns import ClockColumn, ClockPlan, nanoseconds
from vsalog.readers.time_dates import trimmed
from vsalog.readers.time_folds import COUNTED
from vsalog.readers.time_names import plain
from vsalog.recording import Stamps

MOST = 64
"""A column with more values than this in its first rows does not name parts of a machine."""
MOST_PARTS = 256
"""So many streams one table has at most."""
_NAMED = re.compile(
    r"(^|[_.])(joint|motor|axis|actuator|sensor|device|node|link|part|channel|topic|source|signal|variable|quantity|id|name)"
    r"(_?(id|name|no|nr|index))?$"
)
_TELLING = 0.9
"""Fraction of rows for which a rule must hold."""
_BACK = 0.4
"""Fraction of the changes of the speaker at which the clock goes back, where rows come in blocks: of two speakers, half."""

_LATE = 1e-3
"""Fraction of rows whose time may be damaged or late, so that the clock goes back within a block."""

Whole = Callable[[Sequence[int]], Iterable[Sequence[pa.Array]]]
"""Gives some columns from their first row to the last, part by part."""


def find_speakers(names: Sequence[str], sample: Sequence[pa.Array], plan: ClockPlan, whole: Whole) -> Speakers | None:
    """Return whose values the rows of a table hold, None where they are all of the same.

    The few values of a column either share each time among them, or come in turn, or each have a block of rows that begins
    with an earlier time than the block ahead ends. Those of a column of numbers must be called so.

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
    clock = plan.clocks.get("column")
    if clock is None:
        return None
    stamps, good = nanoseconds([sample[i] for i in clock.columns], clock.form)
    for i, name in enumerate(names[: len(sample)]):
        if i in plan.columns() or not _may_name(sample[i].type):
            continue
        called = _NAMED.search(plain(name)) is not None
        numbers, words = numbers_and_words(pc.cast(sample[i], pa.string()))
        if not (called if numbers else words):
            continue
        if _alternate(sample[i], stamps, good, called) or _in_blocks(i, sample[i], clock, called, whole):
            return Speakers(name, (i,), whole([i]))
    return None


def _may_name(kind: pa.DataType) -> bool:
    return bool(pa.types.is_string(kind) or pa.types.is_integer(kind))


def _alternate(cells: pa.Array, stamps: Stamps, good: NDArray[np.bool_], called: bool) -> bool:
    """Tell whether rows of few speakers alternate."""
    encoded = _joined([cells]).dictionary_encode()
    who = encoded.indices.to_numpy(zero_copy_only=False)[good]
    count, times = len(encoded.dictionary), stamps[good]
    if not 2 <= count <= min(MOST, len(who) // 3):
        return False
    if np.mean(np.diff(times) == 0) > 1 / (2 * count):
        return len(np.unique(np.stack([times, who]), axis=1).T) > _TELLING * len(who)
    in_turn = np.mean(who[count:] == who[:-count]) > _TELLING and np.mean(np.diff(who) != 0) > _TELLING
    return bool(in_turn or (called and np.mean(np.diff(who) != 0) > 0.5))


def _in_blocks(column: int, first: pa.Array, clock: ClockColumn, called: bool, whole: Whole) -> bool:
    """Tell whether the rows of one speaker follow those of another, with the same times once more.

    Where the column is not called so, it may tell one experiment from the next: only dates, which do not begin anew with every
    log, say that blocks are of the same time.
    """
    if not 1 <= len(pc.unique(first)) <= min(MOST, len(first) // 3):
        return False
    changes = falls = both = rows = 0
    last: tuple[str, int] | None = None
    for who, *times in whole([column, *clock.columns]):
        stamps, good = nanoseconds(times, clock.form)
        names = _joined([who])
        good &= ~_lonely(names)
        names, stamps = names.filter(pa.array(good)), stamps[good]
        if not len(names):
            continue
        if not called and stamps.min() < COUNTED:
            return False
        ahead = (names[0].as_py(), int(stamps[0])) if last is None else last
        before = pa.concat_arrays([pa.array([ahead[0]], pa.string()), names[:-1]])
        changed = np.asarray(pc.not_equal(names, before).to_numpy(zero_copy_only=False), bool)
        fell = stamps < np.concatenate([[ahead[1]], stamps[:-1]])
        changes, falls = changes + int(changed.sum()), falls + int(fell.sum())
        both, rows = both + int((changed & fell).sum()), rows + len(names)
        last = names[-1].as_py(), int(stamps[-1])
    return both > 0 and both >= _BACK * changes and falls - both <= max(both, _LATE * rows)


def _lonely(names: pa.Array) -> NDArray[np.bool_]:
    """Return which rows have another name than both their neighbours, as where a name is damaged."""
    changed = np.asarray(pc.not_equal(names[1:], names[:-1]).to_numpy(zero_copy_only=False), bool)
    lonely: NDArray[np.bool_] = np.concatenate([[False], changed]) & np.concatenate([changed, [False]])
    return lonely[: len(names)]


class Speakers:
    """Whose values the rows of a table hold.

    Parameters
    ----------
    name : str
        Of the column that says whose, for messages.
    columns : tuple of int
        That column, or those whose values together say it.
    cells : iterable of sequences of pyarrow arrays
        Their cells, part by part.

    Attributes
    ----------
    columns : tuple of int
        As given.
    parts : dict of str to str
        Whose there are, by what stands behind the names of their channels.
    """

    def __init__(self, name: str, columns: tuple[int, ...], cells: Iterable[Sequence[pa.Array]]) -> None:
        self.columns = columns
        self._name = name
        found: dict[str, None] = {}
        for part in cells:
            found |= dict.fromkeys(pc.unique(_joined(part)).to_pylist())
            if len(found) > MOST_PARTS:
                break
        self.parts = {f"[{one}]": one for one in list(found)[:MOST_PARTS]}
        self._known = pa.array(self.parts.values(), pa.string())
        self._others = 0

    def rows(self, cells: Sequence[pa.Array]) -> dict[str, NDArray[np.bool_]]:
        """Return which rows are whose, by what stands behind the names of their channels.

        Parameters
        ----------
        cells : sequence of pyarrow arrays
            Of the columns that say it.
        """
        found = pc.fill_null(pc.index_in(_joined(cells), self._known), -1)
        who = np.asarray(found.to_numpy(zero_copy_only=False), np.int64)
        self._others += int(np.count_nonzero(who < 0))
        return {part: who == k for k, part in enumerate(self.parts)}

    def note(self) -> str:
        """Return what to tell of them."""
        shown = ", ".join([*self.parts.values()][:6]) + (", …" if len(self.parts) > 6 else "")
        return (
            f"column '{self._name}' says whose values a row holds: a stream for each of its {len(self.parts)} values"
            f" ({printable_cell(shown)})"
        )

    def left_out(self) -> list[str]:
        """Return what to tell of rows that are nobody's, once all were given to `rows`."""
        if not self._others:
            return []
        return [
            f"column '{self._name}': {plural(self._others, 'row')} left out that hold the values of others than the first"
            f" {MOST_PARTS}"
        ]


def _joined(cells: Sequence[pa.Array]) -> pa.Array:
    """Return the texts of several columns as one, "" for a blank."""
    texts = [pc.fill_null(trimmed(one), "") for one in cells]
    return texts[0] if len(texts) == 1 else pc.binary_join_element_wise(*texts, ".")
