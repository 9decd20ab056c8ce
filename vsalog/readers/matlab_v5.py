"""MATLAB v5 files, variable by variable: a damaged one does not hide the others."""

from __future__ import annotations

import mmap
import re
import struct
import zlib
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path
from typing import Any

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding, Findings
from vsalog.core.memory import AT_ONCE_BYTES
from vsalog.readers.compression import FILE_RATIO
from vsalog.readers.limits import MOST_PARTS
from vsalog.readers.matlab_v5_parts import DataType, variable


class Size(IntEnum):
    """Bytes of a file's header and of an element's tag (MAT-File Format, level 5)."""

    HEADER = 128
    TAG = 8


Content = mmap.mmap


def load(path: Path, findings: Findings) -> dict[str, Any]:
    """Return a file's variables as `matlab_v5_parts.variable` gives them; what is damaged is left out and among the findings.

    Raises
    ------
    ReadError
        The file cannot be opened, or nothing of it can be read.
    """
    found: dict[str, Any] = {}
    damage: dict[int, str] = {}
    try:
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            if len(content) < Size.HEADER:
                raise ReadError("the MATLAB file is cut off within its header; there are no variables in it", path)
            order = ">" if content[126:128] == b"MI" else "<"
            for begin, element in _elements(content, order, damage):
                try:
                    name, value = _variable(element, order)
                except ValueError as error:
                    damage[begin] = str(error)
                    continue
                if name and not name.startswith("__"):  # MATLAB's own have no name
                    found[name] = value
    except OSError as error:
        raise ReadError(f"cannot be read: {error.strerror or error}", path) from error
    if damage and not found:
        raise ReadError(f"the MATLAB file is damaged: {next(iter(damage.values()))}", path)
    if not found:
        findings.add(Finding(code="recording.no_variables"))
    if damage:
        first, words = next(iter(damage.items()))
        evidence = {"reason": f"at byte {first}: {words}"}
        findings.add(Finding(code="recording.variables_damaged", value=len(damage), evidence=evidence))
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
    if kind != DataType.MATRIX:
        raise ValueError(f"an element of type {kind} with {length} bytes is no variable")
    return variable(memoryview(element)[8 : 8 + length], order)


def _elements(content: Content, order: str, damage: dict[int, str]) -> Iterator[tuple[int, bytes]]:
    """Yield where each variable begins, and the element that it is, which is not compressed any more."""
    allowed = max(AT_ONCE_BYTES, FILE_RATIO * len(content))
    for begin, end in _places(content, order, damage):
        kind, _ = _tag(content, begin, order)
        if kind != DataType.COMPRESSED:
            yield begin, content[begin:end]
            continue
        try:
            element = _decompressed(content[begin + Size.TAG : end], allowed, end > len(content))
        except (zlib.error, ValueError) as error:
            damage[begin] = str(error)
            continue
        allowed -= len(element)
        yield begin, element


def _places(content: Content, order: str, damage: dict[int, str]) -> Iterator[tuple[int, int]]:
    """Yield where each variable begins, and where it ends, by what it says; behind one that is wrong, the next are looked for."""
    begin = Size.HEADER.value
    while begin < len(content) and len(damage) <= MOST_PARTS:
        end = begin + Size.TAG + _tag(content, begin, order)[1]
        yield begin, end
        if _begins(content, end, order):
            begin = end
            continue
        words = "it is cut off" if end > len(content) else f"there is no other at byte {end}, where it ends"
        damage.setdefault(begin, words)
        begin = _next_begin(content, begin + 1, order)


def _tag(content: Content, at: int, order: str) -> tuple[int, int]:
    """Return kind and length of an element; of what is left of one, a length beyond the end."""
    head = content[at : at + Size.TAG]
    kind, length = struct.unpack(order + "II", head) if len(head) == Size.TAG else (0, Size.TAG)
    return kind, length


def _begins(content: Content, at: int, order: str) -> bool:
    """Tell whether a variable may begin somewhere, or the file ends there."""
    kind, length = _tag(content, at, order)
    return at == len(content) or (
        kind in (DataType.MATRIX, DataType.COMPRESSED) and length <= len(content) - at - Size.TAG
    )


def _next_begin(content: Content, begin: int, order: str) -> int:
    """Return where the next variable surely begins, the end where none does."""

    def words(*numbers: int) -> bytes:
        return re.escape(struct.pack(f"{order}{len(numbers)}I", *numbers))

    # Flags, two dimensions, and a name, which parts of variables do not have: short ones lie in the tag.
    name = b"|".join([*(words(size << 16 | 1) for size in range(1, 5)), words(1) + b"(?!" + words(0) + b")"])
    plain = words(DataType.MATRIX) + b".{4}" + words(6, 8) + b".{8}" + words(5, 8) + b".{8}(?:" + name + b")"
    compressed = words(DataType.COMPRESSED) + b".{4}\x78[\x01\x5e\x9c\xda]"
    found = re.compile(plain + b"|" + compressed, re.DOTALL).finditer(content, begin)
    return next((match.start() for match in found if _begins(content, match.start(), order)), len(content))


def _decompressed(content: bytes, most: int, is_cut: bool) -> bytes:
    """Return a compressed element, whose checksum has to match, or what is there of one that is cut off.

    Raises
    ------
    zlib.error, ValueError
        It is damaged, has no end, or is larger than `most`.
    """
    stream = zlib.decompressobj()
    element = stream.decompress(content, most + 1)
    if len(element) > most:
        raise ValueError("it becomes larger than any recording when it is decompressed")
    if not stream.eof and not is_cut:
        raise ValueError("it is cut off")
    return element
