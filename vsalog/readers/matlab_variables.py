"""MATLAB v4 and v5 files by scipy, variable by variable: a damaged one does not hide the others."""

from __future__ import annotations

import re
import struct
import warnings
import zlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from enum import IntEnum
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from vsalog.core.printable import LONGEST_TEXT, MAX_DEPTH, printable
from vsalog.readers.limits import MAX_ARRAY, MOST_PARTS, MOST_STEPS
from vsalog.readers.sandbox import TOO_MUCH, SandboxError, sandboxed


class V5(IntEnum):
    """Of the MAT-File Format, level 5: bytes of the header, ahead of the byte order, and of a tag; a kind of element."""

    HEADER, ORDER, TAG, COMPRESSED = 128, 126, 8, 15


_V4 = struct.Struct("5i").size
_PRECISIONS = len(("f8", "f4", "i4", "i2", "u2", "u1"))
_NAME = re.compile(rb"[A-Za-z]\w*\0+", re.ASCII)


class Part(NamedTuple):
    """The position of a variable in a file, the header that makes it a file by itself, and its unpacked size [bytes].

    There are no bytes of a header where the file has none.
    """

    begin: int
    end: int
    head: bytes
    unfolded: int


def is_v4(head: bytes) -> bool:
    """Return whether a file begins with a matrix of version 4."""
    if len(head) < _V4:
        return False
    for number, order in enumerate("<>"):
        kind, rows, columns, imaginary, name = struct.unpack_from(f"{order}5i", head)
        machine, rest = divmod(kind, 1000)
        precision, what = divmod(rest, 10)
        right = machine == number and precision < _PRECISIONS and what in (0, 1, 2) and imaginary in (0, 1)
        if right and min(rows, columns) >= 0 and _NAME.fullmatch(head[_V4 : _V4 + max(name, 0)]):
            return True
    return False


def load(path: Path, more: int) -> tuple[dict[str, Any], list[str]]:
    """Return a file's variables, and the faults of the others.

    Parameters
    ----------
    path : Path
        The file.
    more : int
        Bytes of memory that it takes at most.

    Returns
    -------
    dict of array, dict, list, str or None
        Numbers; a structure; the first elements of a cell array or an array of structures; a text; None for anything else.
    list of str
        A reason for each variable that is left out.
    """
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(0)
        whole = is_v4(file.read(_V4 + LONGEST_TEXT))  # the format has no checksum of a variable's length
        parts = [Part(0, size, b"", size)] if whole else list(_parts(file, size))
    parts, refused = _that_fit(parts, more)
    try:
        results = sandboxed(partial(_read, path, parts), more)
    except SandboxError:  # one of them is the cause
        results = [one for part in parts[:MOST_PARTS] for one in _apart(path, part, more)]
    found = {name: value for one in results if isinstance(one, dict) for name, value in one.items()}
    return found, [one for one in results if isinstance(one, str)] + refused


def _that_fit(parts: Sequence[Part], more: int) -> tuple[list[Part], list[str]]:
    """Return the variables that together announce no more than this number of bytes, and a reason for each of the others."""
    taken, refused = [], []
    for part in parts:
        if part.unfolded > more:
            refused.append(f"at byte {part.begin}: {TOO_MUCH}")
        else:
            taken.append(part)
            more -= part.unfolded
    return taken, refused


def _apart(path: Path, part: Part, more: int) -> list[dict[str, Any] | str]:
    """Return the result of `_read` for one variable, also where it ends the process."""
    try:
        results: list[dict[str, Any] | str] = sandboxed(partial(_read, path, [part]), more)
    except SandboxError as error:
        return [f"at byte {part.begin}: {error}"]
    return results


def _read(path: Path, parts: Sequence[Part]) -> list[dict[str, Any] | str]:
    """Return each variable, by its name, or its fault in words; none where it is MATLAB's own."""
    from scipy.io import loadmat

    results: list[dict[str, Any] | str] = []
    with path.open("rb") as file, warnings.catch_warnings(action="ignore"):
        size = file.seek(0, 2)
        for begin, end, head, _ in parts:
            try:
                if end > size:
                    raise ValueError("it is cut off")
                file.seek(begin)
                variables = loadmat(BytesIO(head + file.read(end - begin)))  # type: ignore[arg-type]
            except Exception as error:  # scipy raises whatever a damaged file provokes
                words = TOO_MUCH if isinstance(error, MemoryError) else str(error) or type(error).__name__
                results.append(f"at byte {begin}: {printable(words)[:LONGEST_TEXT]}")
                continue
            results.append({_name(name, one): _plain(one, 0) for name, one in variables.items() if name[:2] != "__"})
    return results


def _name(name: str, value: Any) -> str:
    """Return a variable's name; that of an object of a class is at a place that scipy does not read."""
    from scipy.io.matlab import MatlabOpaque

    return value["s0"].flat[0].decode("utf-8", "replace") if isinstance(value, MatlabOpaque) else name


def _plain(value: Any, depth: int) -> Any:
    """Return a value of scipy's as `load` does."""
    from scipy.io.matlab import MatlabFunction, MatlabObject, MatlabOpaque

    if not isinstance(value, np.ndarray) or isinstance(value, MatlabFunction | MatlabObject | MatlabOpaque):
        return None
    if value.dtype.kind == "U":
        return "".join(value.reshape(-1)[:1])
    if depth > MAX_DEPTH or value.dtype.kind not in "OV":
        return None if value.dtype.kind in "OV" else value
    elements = value.reshape(-1, order="F")[:MAX_ARRAY]
    names = value.dtype.names
    if names is None:
        return [_plain(element, depth + 1) for element in elements]
    structures = [{name: _plain(element[name], depth + 1) for name in names} for element in elements]
    return structures[0] if value.size == 1 else structures


def _parts(file: IO[bytes], size: int) -> Iterator[Part]:
    """Yield the variables of a file of version 5, whose elements state their length; of empty ones in a row the first."""
    file.seek(0)
    head = file.read(V5.HEADER)
    if size < V5.HEADER:
        yield Part(0, V5.HEADER, b"", 0)
    order = ">" if head[V5.ORDER :] == b"MI" else "<"
    at, length = V5.HEADER.value, 1
    for _ in range(MOST_STEPS):
        if at >= size:
            return
        file.seek(at)
        before = length
        kind, length = struct.unpack(order + "II", file.read(V5.TAG).ljust(V5.TAG, b"\0"))
        begin, at = at, at + V5.TAG + length
        if length or before:  # a disk that is full leaves zeros
            yield Part(begin, at, head, _announced(file.read(LONGEST_TEXT), order) if kind == V5.COMPRESSED else length)


def _announced(compressed: bytes, order: str) -> int:
    """Return the length in the tag of the element that is compressed, 0 where there is none."""
    with suppress(zlib.error):
        tag = zlib.decompressobj().decompress(compressed, V5.TAG)
        return int(struct.unpack(order + "II", tag)[1]) if len(tag) == V5.TAG else 0
    return 0
