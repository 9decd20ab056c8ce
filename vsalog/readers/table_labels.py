"""Text tables without a header whose cells say what they are: ``t:0.01,angle:0.5``, as for the plotter of a microcontroller."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence

import pyarrow as pa
import pyarrow.compute as pc

from vsalog.readers.limits import MOST_EXCEPTIONS

_LABELLED = re.compile(r"^\s*([A-Za-z_][^:=\"{}]*?)\s*[:=]\s*(.*)$")


def labels_of(rows: Sequence[Sequence[str]], width: int) -> tuple[str, ...]:
    """Return what stands ahead of the number in each cell of a column, none where a column's cells have no label in common."""
    labels = []
    for cells in zip(*(row for row in rows if len(row) == width), strict=True):
        found = Counter(match[1] for cell in cells if (match := _LABELLED.match(cell)))
        (label, count), *_ = found.most_common(1) or [("", 0)]
        if count < (1 - MOST_EXCEPTIONS) * len(cells):
            return ()
        labels.append(label)
    return tuple(labels) if len(set(labels)) == width else ()


def without_label(cell: str) -> str:
    """Return what stands behind a cell's label.

    >>> without_label("angle = 0.5")
    '0.5'
    """
    match = _LABELLED.match(cell)
    return match[2] if match else cell


def without_labels(cells: pa.Array, label: str) -> pa.Array:
    """Return cells without the label of their column; one with another label stays as it is, and is no number."""
    return pc.replace_substring_regex(cells, rf"^\s*{re.escape(label)}\s*[:=]\s*", "")
