"""Long tables: columns say whose values a row holds; rows of several joints or signals alternate, or come in blocks."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.recording import Stamps, Values
from vsalog.core.significance import REPEATS
from vsalog.readers.limits import MAX_ARRAY, MOST_EXCEPTIONS, MOST_PARTS, TIMES_LARGER
from vsalog.readers.reach import Stamp
from vsalog.readers.tables.cells import numbers_and_words
from vsalog.readers.tables.dates import trimmed
from vsalog.readers.tables.text import printable_cell
from vsalog.readers.tables.time_columns import ClockColumn, ClockPlan, nanoseconds
from vsalog.readers.tables.time_names import plain
from vsalog.readers.tables.time_numbers import floats

MOST_KEYS = 3
"""Columns that together name a part: a robot, its arm and a joint."""
_NAMED = re.compile(
    r"(^|[_.])(robot|joint|motor|axis|actuator|sensor|device|node|link|part|channel|topic|source|signal|variable|quantity|id|name)"
    r"(_?(id|name|no|nr|index))?$"
)

BETWEEN = "\x1f"
"""Stands between the texts of several columns; no text has it."""
Whole = Callable[[Sequence[int]], Iterable[Sequence[pa.Array]]]
"""Gives some columns from their first row to the last, part by part."""
Numbers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class _Candidate:
    """A column of few words, or of few numbers that is called so.

    Attributes
    ----------
    column : int
        Which.
    called : bool
        Its name says that it names parts of a machine.
    who : int array, shape (n,)
        Its values in the first rows that have a time, as numbers.
    """

    column: int
    called: bool
    who: Numbers


def find_keys(
    names: Sequence[str], sample: Sequence[pa.Array], plan: ClockPlan, whole: Whole
) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the columns that together say whose values a row holds, and those that may but are not called so.

    Rows of different parts of a machine share each time among them, or come in turn, or come in blocks, each of which begins
    with an earlier time than the block ahead ends. Words that change from row to row while the time goes on tell the parts apart
    only where their column is called so, or values jump with them: else they say what one machine does.

    Parameters
    ----------
    names, sample, plan, whole : as for `vsalog.readers.tables.long_tables.find_speakers`
    """
    clock = plan.clocks.get("column")
    if clock is None:
        return (), ()
    stamps, good = nanoseconds([sample[i] for i in clock.columns], clock.form)
    rows = _FirstRows(names, sample, plan, stamps, good)
    named = [*rows.candidates(False)]
    keys = rows.sharing(named)
    while len(keys) < MOST_KEYS:
        others = [one for one in named if one.column not in keys]
        more = next((one for one in others if rows.take_turns(one, keys)), None) or next(
            (one for one in others if _in_blocks(one, sample[one.column], keys, clock, whole)), None
        )
        if more is None:
            break
        keys = tuple(sorted((*keys, more.column)))
    return keys, rows.sharing([*rows.candidates(True)]) if rows.repeat and not keys else ()


class _FirstRows:
    """The first rows of a table that have a time."""

    def __init__(
        self, names: Sequence[str], sample: Sequence[pa.Array], plan: ClockPlan, stamps: Stamps, good: NDArray[np.bool_]
    ) -> None:
        self._names, self._sample, self._clocks = names, sample, plan.columns()
        self._good, self._times = good, stamps[good]

    @property
    def repeat(self) -> bool:
        """Whether rows share their times."""
        return len(self._times) > 1 and bool(np.mean(np.diff(self._times) == 0) > 1 / (2 * MOST_PARTS))

    def candidates(self, numbered: bool) -> Iterator[_Candidate]:
        """Yield the columns that may say whose values rows hold, those of numbers that are not called so only if asked for."""
        for i, name in enumerate(self._names[: len(self._sample)]):
            cells = self._sample[i]
            if i in self._clocks or not (pa.types.is_string(cells.type) or pa.types.is_integer(cells.type)):
                continue
            called = _NAMED.search(plain(name)) is not None
            numbers, words = numbers_and_words(pc.cast(cells, pa.string()))
            if (called if numbers else words) or (numbered and _whole(cells)):
                yield self._candidate(i, called)

    def _candidate(self, column: int, called: bool) -> _Candidate:
        codes = joined([self._sample[column]]).dictionary_encode().indices
        return _Candidate(column, called, np.asarray(codes.to_numpy(zero_copy_only=False), np.int64)[self._good])

    def sharing(self, candidates: Sequence[_Candidate]) -> tuple[int, ...]:
        """Return the fewest columns that tell the rows of each time apart, none where rows do not share their times."""
        if not self.repeat:
            return ()
        few = [one for one in candidates if 2 <= len(np.unique(one.who)) <= min(MAX_ARRAY, len(one.who) // 3)]
        few = sorted(few, key=lambda one: not one.called)[:REPEATS]
        for size in range(1, MOST_KEYS + 1):
            for some in combinations(few, size):
                who = _together([one.who for one in some])
                count = len(np.unique(who))
                most = len(who) // 3 if size == 1 else min(MOST_PARTS, len(who) // 2)
                if 2 <= count <= most and self._share(who, count) and self._tell_apart(who):
                    return tuple(sorted(one.column for one in some))
        return ()

    def _share(self, who: Numbers, count: int) -> bool:
        return bool(np.mean(np.diff(self._times) == 0) > 1 / (2 * count))

    def _tell_apart(self, who: Numbers) -> bool:
        return len(np.unique(np.stack([self._times, who]), axis=1).T) > (1 - MOST_EXCEPTIONS) * len(who)

    def take_turns(self, candidate: _Candidate, keys: Sequence[int]) -> bool:
        """Tell whether rows of few parts of a machine alternate, among those that other columns say to be of one."""
        others = (
            _together([self._candidate(i, True).who for i in keys]) if keys else np.zeros(len(candidate.who), np.int64)
        )
        groups = [np.flatnonzero(others == other) for other in np.unique(others)]
        return bool(groups) and all(self._alternate(candidate, rows) for rows in groups)

    def _alternate(self, candidate: _Candidate, rows: Numbers) -> bool:
        who, times = candidate.who[rows], self._times[rows]
        count = len(np.unique(who))
        if not 2 <= count <= min(MAX_ARRAY, len(who) // 3) or np.mean(np.diff(times) == 0) > 1 / (2 * count):
            return False
        changes = np.mean(np.diff(who) != 0)
        if candidate.called and changes > 0.5:
            return True
        in_turn = np.mean(who[count:] == who[:-count]) > (1 - MOST_EXCEPTIONS) and changes > (1 - MOST_EXCEPTIONS)
        return bool(in_turn) and any(_jump(values[rows], who) for values in self._values(candidate.column))

    def _values(self, but: int) -> Iterator[Values]:
        """Yield the columns of numbers."""
        for i, cells in enumerate(self._sample):
            if i != but and i not in self._clocks and np.isfinite(values := floats(cells)).any():
                yield values[self._good]


def _whole(cells: pa.Array) -> bool:
    values = floats(cells)
    return bool(np.isfinite(values).all() and (np.rint(values) == values).all())


def _jump(values: Values, who: Numbers) -> bool:
    """Tell whether values differ more from row to row than from one row of the same speaker to its next."""
    order = np.argsort(who, kind="stable")
    own = np.abs(np.diff(values[order]))[np.diff(who[order]) == 0]
    across = np.abs(np.diff(values))
    own, across = own[np.isfinite(own)], across[np.isfinite(across)]
    if not own.size or not across.size or not own.any():  # what stays the same says no more than the words do
        return False
    return bool(np.median(across) > TIMES_LARGER * np.median(own))


def _in_blocks(candidate: _Candidate, first: pa.Array, keys: Sequence[int], clock: ClockColumn, whole: Whole) -> bool:
    """Tell whether the rows of one speaker follow those of another, with the same times once more.

    Where the column is not called so, it may tell one experiment from the next: only dates, which do not begin again with every
    log, say that blocks are of the same time. Where other columns are known to say whose values rows hold, the rows of each are
    looked at by themselves.
    """
    if not 1 <= len(pc.unique(first)) <= min(MAX_ARRAY, len(first) // 3):
        return False
    changes = falls = both = 0
    last: dict[str, tuple[str, int]] = {}
    for cells in whole([candidate.column, *keys, *clock.columns]):
        stamps, good = nanoseconds(cells[1 + len(keys) :], clock.form)
        names, others = joined(cells[:1]), joined(cells[1 : 1 + len(keys)]) if keys else None
        if others is not None:  # each one's rows behind one another
            order = pc.array_sort_indices(others.dictionary_encode().indices)
            names, others, stamps, good = names.take(order), others.take(order), stamps[order], good[order]
        good &= ~_lonely(names)
        kept = pa.array(good)
        names, stamps = names.filter(kept), stamps[good]
        if not len(names):
            continue
        if not candidate.called and stamps.min() < Stamp.YEAR_2000:
            return False
        changed, fell = _steps(names, stamps, others.filter(kept) if others is not None else None, last)
        changes, falls = changes + int(changed.sum()), falls + int(fell.sum())
        both += int((changed & fell).sum())
    # Where rows come in blocks, the clock goes back at half the changes of two speakers, or more of more.
    return both > 0 and both >= (0.5 - MOST_EXCEPTIONS) * changes and falls <= 2 * both


def _steps(
    names: pa.Array, stamps: Stamps, others: pa.Array | None, last: dict[str, tuple[str, int]]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return where the speaker changes and where the clock goes back, from each row to the next of the same others.

    Of those, `last` has the last row so far.
    """
    begins = np.zeros(len(names), bool)
    begins[0] = True
    if others is not None:
        begins[1:] = np.asarray(pc.not_equal(others[1:], others[:-1]).to_numpy(zero_copy_only=False), bool)
    changed = np.zeros(len(names), bool)
    changed[1:] = np.asarray(pc.not_equal(names[1:], names[:-1]).to_numpy(zero_copy_only=False), bool)
    fell = np.concatenate([[False], np.diff(stamps) < 0])
    starts = np.flatnonzero(begins)
    for start, end in zip(starts, [*starts[1:], len(names)], strict=True):
        other = "" if others is None else others[int(start)].as_py()
        name, stamp = last.get(other, (names[int(start)].as_py(), int(stamps[start])))
        changed[start], fell[start] = names[int(start)].as_py() != name, stamps[start] < stamp
        last[other] = names[int(end) - 1].as_py(), int(stamps[end - 1])
    return changed, fell


def _lonely(names: pa.Array) -> NDArray[np.bool_]:
    """Return which rows have another name than both their neighbours, as where a name is damaged."""
    changed = np.asarray(pc.not_equal(names[1:], names[:-1]).to_numpy(zero_copy_only=False), bool)
    lonely: NDArray[np.bool_] = np.concatenate([[False], changed]) & np.concatenate([changed, [False]])
    return lonely[: len(names)]


def _together(columns: Sequence[Numbers]) -> Numbers:
    """Return one number for each row that tells the values of several columns apart."""
    _, codes = np.unique(np.stack(columns), axis=1, return_inverse=True)
    return np.asarray(codes, np.int64).ravel()


def joined(cells: Sequence[pa.Array]) -> pa.Array:
    """Return the texts of several columns as one, "" for a blank."""
    texts = [pc.fill_null(trimmed(one), "") for one in cells]
    return texts[0] if len(texts) == 1 else pc.binary_join_element_wise(*texts, BETWEEN)


def find_speakers(
    names: Sequence[str], sample: Sequence[pa.Array], plan: ClockPlan, whole: Whole
) -> tuple[Speakers | None, Finding | None]:
    """Return whose values the rows of a table hold, None where they are all of the same, and what to tell of that.

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
    keys, perhaps = find_keys(names, sample, plan, whole)
    if keys:
        speakers = Speakers([names[i] for i in keys], keys, whole(keys))
        return speakers, speakers.finding()
    if not perhaps:
        return None, None
    return None, Finding(code="table.perhaps_long", part=_called([names[i] for i in perhaps]))


def _called(names: Sequence[str]) -> str:
    *others, last = (f"'{printable_cell(name)}'" for name in names)
    return f"columns {', '.join(others)} and {last}" if others else f"column {last}"


class Speakers:
    """Whose values the rows of a table hold.

    Parameters
    ----------
    names : sequence of str
        Of the columns whose values together say whose, for messages.
    columns : tuple of int
        Those columns.
    cells : iterable of sequences of pyarrow arrays
        Their cells, part by part.

    Attributes
    ----------
    columns : tuple of int
        As given.
    parts : dict of str to str
        Whose there are, by what stands behind the names of their channels.
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
        """Return which rows are whose, by what stands behind the names of their channels.

        Parameters
        ----------
        cells : sequence of pyarrow arrays
            Of the columns that say it.
        """
        found = pc.fill_null(pc.index_in(joined(cells), self._known), -1)
        who = np.asarray(found.to_numpy(zero_copy_only=False), np.int64)
        self._others += int(np.count_nonzero(who < 0))
        return {part: who == k for k, part in enumerate(self.parts)}

    def finding(self) -> Finding:
        """Return what to tell of them."""
        shown = ", ".join([part[1:-1] for part in self.parts][:6]) + (", …" if len(self.parts) > 6 else "")
        evidence = {"names": printable_cell(shown)}
        return Finding(code="table.long", part=self._called, value=len(self.parts), evidence=evidence)

    def left_out(self) -> list[Finding]:
        """Return what to tell of rows that are nobody's, once all were given to `rows`."""
        if not self._others:
            return []
        return [Finding(code="table.others_left_out", part=self._called, value=self._others, limit=MOST_PARTS)]
