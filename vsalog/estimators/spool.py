"""Rows that an estimator puts aside while it reads a log forward, and reads again from the end."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from vsalog.core.column import Column, let_go
from vsalog.estimators.folding import BLOCK

Rows = NDArray[np.void]


class Spool:
    """Rows of one structured type in a temporary file: memory does not grow with them.

    First all rows are appended; once they are read nothing is appended any more.

    Parameters
    ----------
    kind : of a row
    """

    def __init__(self, kind: np.dtype[np.void]) -> None:
        self._column: Column[np.void] = Column(kind, in_file=True)
        self._rows: Rows | None = None

    def __len__(self) -> int:
        return len(self._column)

    def append(self, rows: Rows) -> None:
        """Put rows behind all others; raises ReadError where the file cannot be written."""
        self._column.append(rows)

    def read(self, first: int, last: int) -> Rows:
        """Return a copy of rows, shape (last − first,)."""
        rows = self._mapped()[first:last]
        copy = rows.copy()
        let_go(rows)
        return copy

    def backwards(self, size: int = BLOCK) -> Iterator[Rows]:
        """Yield parts of at most `size` rows from the last to the first, as they are in the file: changes are kept."""
        for last in range(len(self), 0, -size):
            rows = self._mapped()[max(0, last - size) : last]
            yield rows
            let_go(rows)

    def _mapped(self) -> Rows:
        if self._rows is None:
            self._rows = self._column.whole(len(self))
        return self._rows
