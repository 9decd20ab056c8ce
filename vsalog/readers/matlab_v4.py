"""MATLAB v4 files, as old versions, Octave and simulators of Modelica write them: matrices one behind the other."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from enum import IntEnum
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding, Findings
from vsalog.core.printable import LONGEST_TEXT

_HEAD = struct.Struct("5i").size

_NAME = re.compile(rb"[A-Za-z]\w*\0+", re.ASCII)
_TYPES = ("f8", "f4", "i4", "i2", "u2", "u1")


class Kind(IntEnum):
    """Kinds of matrices (MAT-File Format, level 4: T)."""

    NUMBERS, TEXT, SPARSE = range(3)


class _Matrix(NamedTuple):
    """What stands ahead of a matrix: its numbers' type, what they are, its shape, and how long its name is."""

    dtype: np.dtype[Any]
    kind: int
    shape: tuple[int, int]
    is_complex: bool
    name_length: int


def is_v4(head: bytes) -> bool:
    """Tell whether a file begins with a matrix."""
    matrix = _matrix(head)
    return matrix is not None and _NAME.fullmatch(head[_HEAD : _HEAD + matrix.name_length]) is not None


def load(path: Path, findings: Findings) -> dict[str, Any]:
    """Return a file's variables as `matlab_v5_parts.variable` gives them; what is damaged is left out and noted.

    Raises
    ------
    ReadError
        The file cannot be opened, or nothing of it can be read.
    """
    found: dict[str, Any] = {}
    try:
        with path.open("rb") as file:
            found.update(_variables(file))  # those ahead of damage are kept
    except ValueError as error:
        if not found:
            raise ReadError(f"the MATLAB file is damaged: {error}", path) from error
        evidence = {"reason": str(error)}
        findings.add(Finding(code="recording.values_doubtful", part=[*found][-1], evidence=evidence))
    except OSError as error:
        raise ReadError(f"cannot be read: {error.strerror or error}", path) from error
    return found


def _variables(file: IO[bytes]) -> Iterator[tuple[str, Any]]:
    """Yield names and values.

    Raises
    ------
    ValueError
        What comes next is no matrix, or not all of it is there.
    """
    size = file.seek(0, 2)
    file.seek(0)
    while (begin := file.tell()) < size:
        matrix = _matrix(file.read(_HEAD))
        name = file.read(matrix.name_length) if matrix else b""
        if matrix is None or not _NAME.fullmatch(name):
            raise ValueError(f"there is no variable at byte {begin}")
        rows, columns = matrix.shape
        length = rows * columns * matrix.dtype.itemsize
        if (1 + matrix.is_complex) * length > size - file.tell():
            raise ValueError(f"a variable of {rows} × {columns} values is cut off at byte {size}")
        parts = [np.frombuffer(file.read(length), matrix.dtype) for _ in range(1 + matrix.is_complex)]
        yield name.rstrip(b"\0").decode("ascii"), _value(matrix, parts)


def _value(matrix: _Matrix, parts: list[np.ndarray[Any, Any]]) -> Any:
    """Return numbers, a text, which is left empty, or None for a sparse matrix."""
    if matrix.kind != Kind.NUMBERS:
        return "" if matrix.kind == Kind.TEXT else None
    values = parts[0] + 1j * parts[1] if matrix.is_complex else parts[0]
    return values.reshape(matrix.shape, order="F")


def _matrix(head: bytes) -> _Matrix | None:
    """Return what the bytes ahead of a matrix say, None where they are something else."""
    for order in "<>":
        if len(head) < _HEAD:
            return None
        kind, rows, columns, imaginary, name_length = struct.unpack_from(f"{order}5i", head)
        machine, rest = divmod(kind, 1000)
        precision, what = divmod(rest, 10)
        right = (
            machine == "<>".index(order) and precision < len(_TYPES) and what in (Kind.NUMBERS, Kind.TEXT, Kind.SPARSE)
        )
        if right and min(rows, columns) >= 0 and imaginary in (0, 1) and 1 < name_length <= LONGEST_TEXT:
            return _Matrix(np.dtype(order + _TYPES[precision]), what, (rows, columns), bool(imaginary), name_length)
    return None
