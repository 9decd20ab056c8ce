"""External names as names of files and partitions: a name from a path or a rig never becomes a path of its own."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Sequence
from urllib.parse import quote

from vsalog.core.printable import LONGEST_NAME

TRACES = "traces"
PART = "part.parquet"
# Readers interpret this as "no value".
UNNAMED = "unnamed"


def encoded(text: str) -> str:
    """Return a text as one name of a file or partition, percent-encoded as Hive's readers decode it.

    Letters, digits, ``_``, ``-`` and ``.`` stay; a leading dot does not, since it would hide the file or name a folder.

    Parameters
    ----------
    text : any text without lone surrogates
    """
    name = quote(text, safe="").replace("~", "%7E")
    return f"%2E{name[1:]}" if name.startswith(".") else name


def trace_name(device: str, date: str, log: str) -> str:
    """Return the path of a log's trace in the batch; all three are encoded, so that none can be a path."""
    return f"{TRACES}/device={encoded(device)}/date={encoded(date)}/log={encoded(log)}/{PART}"


def shown(text: str) -> str:
    """Return a text that can be written as UTF-8: names of files may contain bytes that are no text."""
    return text.encode("utf-8", "backslashreplace").decode()


def readable(path: bytes) -> str:
    """Return a log's relative path as text that can be encoded: another text for another path.

    Bytes that are no UTF-8 are shown as hexadecimal escapes, and too long a path loses its beginning; both get a hash of the
    original bytes, so that no two paths become one.

    Parameters
    ----------
    path : as the file system has it, with slashes between
    """
    try:
        text, exact = path.decode("utf-8"), True
    except UnicodeDecodeError:
        text, exact = path.decode("utf-8", "backslashreplace"), False
    return text if exact and _fits(text) else _cut(text, path)


def device_name(text: str) -> str:
    """Return the name of a rig as the value of a partition."""
    text = text.encode("utf-8", "replace").decode()
    if not text:
        return UNNAMED
    return text if _fits(text) else _cut(text, text.encode())


def told_apart(texts: Sequence[str]) -> list[str]:
    """Return texts of which no two differ by capitals alone: not every file system distinguishes them.

    Parameters
    ----------
    texts : all different
    """
    seen = Counter(text.casefold() for text in texts)
    return [
        _cut(text, text.encode()) if seen[text.casefold()] > 1 and text != text.casefold() else text for text in texts
    ]


def _fits(text: str) -> bool:
    return len(encoded(text)) <= LONGEST_NAME


def _cut(text: str, origin: bytes) -> str:
    """Return the end of a text, the more specific part of a path, with a hash."""
    mark = f"~{hashlib.sha256(origin).hexdigest()[:12]}"
    begin = max(len(text) - LONGEST_NAME, 0)
    while not _fits(text[begin:] + mark):
        begin += 1
    return text[begin:] + mark
