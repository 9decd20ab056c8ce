"""NumPy columns as Arrow's, without pandas, which `pyarrow.array` imports for a type check: half a second."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from vsalog.core.documents import json_text
from vsalog.core.errors import VsalogError
from vsalog.core.finding import Finding

if TYPE_CHECKING:
    import pandas

_TYPES = {"f8": pa.float64(), "i8": pa.int64(), "i4": pa.int32(), "b1": pa.bool_()}


def arrow_column(values: NDArray[Any]) -> pa.Array[Any]:
    """Return a column of float64, int64, int32 or bool; NaN stays NaN, nothing is null.

    Raises
    ------
    KeyError
        For another type.
    """
    kind = _TYPES[values.dtype.str[1:]]
    flat = np.packbits(values, bitorder="little") if values.dtype == np.bool_ else np.ascontiguousarray(values)
    return pa.Array.from_buffers(kind, len(values), [None, pa.py_buffer(flat)])


def arrow_texts(texts: Sequence[str]) -> pa.Array[Any]:
    """Return a column of texts."""
    encoded = [text.encode() for text in texts]
    ends = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    return pa.Array.from_buffers(pa.string(), len(encoded), [None, pa.py_buffer(ends), pa.py_buffer(b"".join(encoded))])


def data_frame(table: pa.Table) -> pandas.DataFrame:
    """Return a table as a data frame.

    Raises
    ------
    VsalogError
        pandas is not installed.
    """
    try:
        import pandas  # noqa: F401
    except ImportError:
        raise VsalogError("to_pandas() needs pandas, which is not installed: pip install 'vsalog[pandas]'") from None
    return table.to_pandas()


def findings_entry(findings: Iterable[Iterable[Finding]]) -> dict[str, str]:
    """Return a file's own metadata for the findings of all joints, which are complete at the end."""
    return {"vsalog.findings": json_text([finding for of_joint in findings for finding in of_joint])}
