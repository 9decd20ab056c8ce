"""Long tables: one column says whose values a row holds, and the rows of several joints or sensors alternate."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from vsalog.readers.headers import printable_cell
from vsalog.readers.table_cells import numbers_and_words
from vsalog.readers.time_columns import ClockPlan, nanoseconds
from vsalog.readers.time_names import plain
from vsalog.recording import Stamps

MOST = 64
"""A column with more values than this does not name parts of a machine."""
_NAMED = re.compile(
    r"(^|[_.])(joint|motor|axis|actuator|sensor|device|node|link|part|channel|topic|source|id|name)(_?(id|name|no|nr|index))?$"
)
_TELLING = 0.9
"""Fraction of rows for which a rule must hold."""


def find_speaker(names: Sequence[str], sample: Sequence[pa.Array], plan: ClockPlan) -> int | None:
    """Return the column that says whose values a row holds, None where there is none.

    Its few values either share each time among them, or come in turn. Those of a column of numbers must be called so.
    """
    clock = plan.clocks.get("column")
    if clock is None:
        return None
    stamps, good = nanoseconds([sample[i] for i in clock.columns], clock.form)
    for i, name in enumerate(names):
        called = _NAMED.search(plain(name)) is not None
        numbers, words = numbers_and_words(sample[i])
        if i not in plan.columns() and (called if numbers else words) and _alternate(sample[i], stamps, good, called):
            return i
    return None


def _alternate(cells: pa.Array, stamps: Stamps, good: NDArray[np.bool_], called: bool) -> bool:
    """Tell whether rows of few speakers alternate."""
    encoded = pc.fill_null(cells, "").dictionary_encode()
    who = encoded.indices.to_numpy(zero_copy_only=False)[good]
    count, times = len(encoded.dictionary), stamps[good]
    if not 2 <= count <= min(MOST, len(who) // 3):
        return False
    if np.mean(np.diff(times) == 0) > 1 / (2 * count):
        return len(np.unique(np.stack([times, who]), axis=1).T) > _TELLING * len(who)
    in_turn = np.mean(who[count:] == who[:-count]) > _TELLING and np.mean(np.diff(who) != 0) > _TELLING
    return bool(in_turn or (called and np.mean(np.diff(who) != 0) > 0.5))


class Speakers:
    """Whose values the rows of a table hold.

    Parameters
    ----------
    column : str
        Says whose.
    cells : iterable of pyarrow arrays
        Its cells, or the first ones.

    Attributes
    ----------
    parts : dict of str to str
        Values of the column, by what stands behind the names of their channels.
    """

    def __init__(self, column: str, cells: Iterable[pa.Array]) -> None:
        self.column = column
        found: dict[str, None] = {}
        for part in cells:
            found |= dict.fromkeys(pc.unique(_named(part)).to_pylist())
        self.parts = {f"[{name}]": name for name in found}

    def rows(self, batch: pa.RecordBatch) -> dict[str, NDArray[np.bool_]]:
        """Return which rows of a batch are whose, by what stands behind the names of their channels."""
        cells = _named(batch.column(self.column))
        return {
            part: np.asarray(pc.equal(cells, name).to_numpy(zero_copy_only=False), bool)
            for part, name in self.parts.items()
        }

    def note(self) -> str:
        """Return what to tell."""
        shown = ", ".join([*self.parts.values()][:6]) + (", …" if len(self.parts) > 6 else "")
        return (
            f"column '{self.column}' says whose values a row holds: a stream for each of its {len(self.parts)} values"
            f" ({printable_cell(shown)})"
        )


def _named(cells: pa.Array) -> pa.Array:
    return pc.fill_null(pc.utf8_trim_whitespace(cells), "")
