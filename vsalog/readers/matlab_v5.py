"""MATLAB v5 files, variable by variable: a damaged one does not hide the others."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

from vsalog.errors import ReadError
from vsalog.readers.base import plural
from vsalog.readers.compression import MAX_BYTES
from vsalog.readers.matlab_v5_parts import MATRIX, variable

_HEADER = 128
_COMPRESSED = 15
_MOST_RATIO = 200
"""What becomes so many times larger in all, and more than `MAX_BYTES`, is no recording but a bomb."""


def load(path: Path, notes: list[str]) -> dict[str, Any]:
    """Return a file's variables as `matlab_v5_parts.variable` gives them; what is damaged is left out and noted.

    Raises
    ------
    ReadError
        The file cannot be opened, or nothing of it can be read.
    """
    found: dict[str, Any] = {}
    damage: list[str] = []
    try:
        with path.open("rb") as file:
            header = file.read(_HEADER)
            if len(header) < _HEADER:
                raise ReadError(f"{path}: the MATLAB file is cut off within its header; there are no variables in it")
            order = ">" if header[126:128] == b"MI" else "<"
            for element in _elements(file, order, damage):
                try:
                    name, value = _variable(element, order)
                except ValueError as error:
                    damage.append(str(error))
                    continue
                if name and not name.startswith("__"):  # MATLAB's own have no name
                    found[name] = value
    except OSError as error:
        raise ReadError(f"{path}: cannot be read: {error.strerror or error}") from error
    if damage and not found:
        raise ReadError(f"{path}: the MATLAB file is damaged: {damage[0]}")
    if not found:
        notes.append("the MATLAB file holds no variables (was it cut off?)")
    if damage:
        notes.append(f"{plural(len(damage), 'variable')} of the MATLAB file damaged, the rest was read ({damage[0]})")
    return found


def _variable(element: bytes, order: str) -> tuple[str, Any]:
    """Return name and value of a variable.

    Raises
    ------
    ValueError
        It is damaged.
    """
    if len(element) < 8:
        raise ValueError("it is cut off")
    kind, length = struct.unpack_from(order + "II", element)
    if kind != MATRIX or length > len(element) - 8:
        raise ValueError(f"an element of type {kind} with {length} bytes is no variable")
    return variable(memoryview(element)[8 : 8 + length], order)


def _elements(file: IO[bytes], order: str, damage: list[str]) -> Iterator[bytes]:
    """Yield each variable as an element that is not compressed."""
    tag = struct.Struct(order + "II")
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
