"""MATLAB v5 files, variable by variable: a damaged one does not hide the others."""

from __future__ import annotations

import struct
import warnings
import zlib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import IO, Any, cast

from vsalog.errors import ReadError
from vsalog.readers.base import plural
from vsalog.readers.compression import MAX_BYTES

_HEADER = 128
_COMPRESSED = 15
_MOST_RATIO = 200
"""What becomes so many times larger in all, and more than `MAX_BYTES`, is no recording but a bomb."""


def load(path: Path, notes: list[str]) -> dict[str, Any]:
    """Return a file's variables as scipy gives them; what is damaged is left out and noted.

    Raises
    ------
    ReadError
        The file cannot be opened, or nothing of it can be read.
    """
    from scipy.io import loadmat

    found: dict[str, Any] = {}
    damage: list[str] = []
    try:
        with path.open("rb") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of variables that scipy passes by: they are not in what it returns
            header = file.read(_HEADER)
            for element in _elements(file, header, damage):
                try:
                    content = loadmat(cast(Any, BytesIO(header + element)), chars_as_strings=True)
                except Exception as error:  # scipy raises whatever a damaged file provokes
                    damage.append(str(error) or type(error).__name__)
                    continue
                found.update((name, value) for name, value in content.items() if not name.startswith("__"))
    except OSError as error:
        raise ReadError(f"{path}: cannot be read: {error.strerror or error}") from error
    if damage and not found:
        raise ReadError(f"{path}: the MATLAB file is damaged: {damage[0]}")
    if damage:
        notes.append(f"{plural(len(damage), 'variable')} of the MATLAB file damaged, the rest was read ({damage[0]})")
    return found


def _elements(file: IO[bytes], header: bytes, damage: list[str]) -> Iterator[bytes]:
    """Yield each variable as an element that is not compressed."""
    tag = struct.Struct(">II" if header[126:128] == b"MI" else "<II")
    size = file.seek(0, 2)
    file.seek(_HEADER)
    allowed = max(MAX_BYTES, _MOST_RATIO * size)
    while head := file.read(tag.size):
        kind, length = tag.unpack(head) if len(head) == tag.size else (0, size)
        if length > size - file.tell():
            damage.append(f"it is cut off at byte {size}")
            return
        content = file.read(length)
        if kind != _COMPRESSED:
            yield head + content
            continue
        try:
            element = _decompressed(content, allowed)
        except (zlib.error, ValueError) as error:
            damage.append(str(error))
            continue
        allowed -= len(element)
        yield element


def _decompressed(content: bytes, most: int) -> bytes:
    """Return a compressed element, whose checksum has to match.

    Raises
    ------
    zlib.error, ValueError
        It is damaged, cut off, or larger than `most`.
    """
    stream = zlib.decompressobj()
    element = stream.decompress(content, most + 1)
    if len(element) > most:
        raise ValueError("it becomes larger than any recording when it is decompressed")
    if not stream.eof:
        raise ValueError("it is cut off")
    return element
