"""Tables that several logs were merged into: each fills its own rows and leaves those of the others blank."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

MOSTLY_BLANK = 0.25
"""From this fraction of blank cells on, columns are taken as a log of their own."""


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
        First the columns that are (nearly) full, even if there are none; then the groups of those with many blanks.
    """
    full: list[int] = []
    sparse: dict[bytes, list[int]] = {}
    for i in columns:
        blank = np.asarray(sample[i].is_null().to_numpy(zero_copy_only=False), dtype=bool)
        if blank.mean() < MOSTLY_BLANK or blank.all():
            full.append(i)
        else:
            sparse.setdefault(blank.tobytes(), []).append(i)
    return [full, *sparse.values()]
