"""Long tables: columns say whose values a row holds; rows of several joints or signals alternate, or come in blocks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.readers.limits import MOST_PARTS
from vsalog.readers.tables.keys import BETWEEN, Whole, find_keys, joined
from vsalog.readers.tables.text import printable_cell
from vsalog.readers.tables.time_columns import ClockPlan


def find_speakers(
    names: Sequence[str], sample: Sequence[pa.Array], plan: ClockPlan, whole: Whole
) -> tuple[Speakers | None, Finding | None]:
    """Return whose values the rows of a table hold, None where they are all of the same, and what to tell of columns besides.

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
        return Speakers([names[i] for i in keys], keys, whole(keys)), None
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
