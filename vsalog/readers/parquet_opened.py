"""Opening Parquet files, also with damage in Arrow's additions to their footer."""

from __future__ import annotations

import mmap
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from vsalog.core.finding import Finding
from vsalog.core.printable import printable
from vsalog.readers.opened import for_arrow

_KEY = b"ARROW:schema"
"""The key under which the footer repeats the columns' types in Arrow's format, and their units."""

_END = b"PAR1"


def open_parquet(path: Path) -> tuple[pq.ParquetFile, list[Finding]]:
    """Return a Parquet file, opened, and the damage of its footer.

    Raises
    ------
    ArrowException, OSError, UnicodeError
        It cannot be opened.
    """
    try:
        return _opened(for_arrow(path)), []
    except (pa.ArrowException, OSError, UnicodeError) as error:
        try:
            file = _opened(_without_key(path))
        except (pa.ArrowException, OSError, UnicodeError):
            raise error from None
        evidence = {"reason": printable(str(error).strip())[:80]}
        return file, [Finding(code="recording.footer_damaged", evidence=evidence)]


def missing_footer(path: Path) -> str:
    """Return in words why a file has no footer that can be read, "" where it has one."""
    with path.open("rb") as file:
        file.seek(max(file.seek(0, 2) - len(_END), 0))
        end = file.read()
    if end == b"PARE":
        return "it is encrypted"
    if end != _END:
        return "it ends without its footer, the index of all its parts, as when it is cut off or was never closed"
    return ""


def _opened(source: Any) -> pq.ParquetFile:
    file = pq.ParquetFile(source, page_checksum_verification=True)
    _ = file.schema_arrow.names  # which may be no text
    return file


def _without_key(path: Path) -> pa.NativeFile:
    """Return a file with another name for the key, in memory: Arrow ignores unknown names."""
    with path.open("rb") as file:
        content = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY)
    begin = content.rfind(_KEY)
    if begin < 0:
        raise OSError("it has no such key")
    content[begin : begin + len(_KEY)] = _KEY[::-1]
    return pa.BufferReader(pa.py_buffer(content))
