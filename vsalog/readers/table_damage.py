"""Where the rows of a damaged compressed table stop making sense."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.readers.table_cells import Cells
from vsalog.readers.text_source import trouble_at_end


class Damage:
    """Finds the first row that does not fit: from a changed byte on, what comes out of a compressed file is made up.

    Whether bytes have changed its end alone tells, so that it is read to there once a row does not fit; where there is no end,
    nobody knows.

    Parameters
    ----------
    path : Path
        The compressed file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._trouble: str | None = None
        self._row = 0

    def sound_rows(
        self, begin: int, good: NDArray[np.bool_], columns: Iterable[Cells], odd_line: int | None
    ) -> int | None:
        """Return how many rows of a block are ahead of the damage, None where there is none so far.

        Parameters
        ----------
        begin : int
            Number of the block's first row.
        good : bool array, shape (n,)
            Which of its rows have a time.
        columns : iterable of Cells
            The columns that were read up to its end.
        odd_line : int or None
            How many rows are ahead of the first line with too many or too few cells.
        """
        if self._trouble is None:
            found = [column.first_row for column in columns if column.bad and column.good]
            found += [] if good.all() else [begin + int(np.argmin(good))]
            # Lines are parsed ahead of the rows, by chance how far.
            if odd_line is not None and odd_line < begin + len(good):
                found.append(odd_line)
            if not found:
                return None
            self._row = min(found)
            self._trouble = trouble_at_end(self._path)
        if not self._trouble or self._row >= begin + len(good):
            return None
        return max(self._row - begin, 0)

    def finding(self) -> Finding:
        """Return what to tell where rows were left out."""
        missing = self._trouble == "missing"
        return Finding(code="compressed.rows_doubtful" if missing else "compressed.rows_left_out", value=self._row + 1)
