"""MATLAB v7.3 files, which are HDF5: groups are structures, object references cell arrays and arrays of structures."""

from __future__ import annotations

from functools import partial
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from vsalog.core.errors import ReadError
from vsalog.core.printable import LONGEST_TEXT, MAX_DEPTH
from vsalog.readers.limits import MAX_ARRAY, MOST_STEPS
from vsalog.readers.sandbox import TOO_MUCH, SandboxError, sandboxed

_TYPES = {
    b"double": "IEEE_F64LE",
    b"single": "IEEE_F32LE",
    b"logical": "STD_U8LE",
    **{
        f"{sign}int{bits}".encode(): f"STD_{sign.upper() or 'I'}{bits}LE"
        for sign in ("", "u")
        for bits in (8, 16, 32, 64)
    },
}
"""MATLAB's classes of numbers; these old layouts have no other check of the numbers' description."""


_OWN = "#"
"""MATLAB's own groups: what references point to, and its objects."""


def load(path: Path, more: int) -> tuple[dict[str, Any], list[str]]:
    """Return a file's variables as `matlab_variables.load` does.

    Damaged, absurdly large or external variables are left out.

    Parameters
    ----------
    path : Path
        The file.
    more : int
        Bytes of memory that it takes at most.

    Raises
    ------
    ReadError
        The file cannot be read, or h5py is not installed.
    """
    try:
        import h5py
    except ImportError:
        raise ReadError(
            "is a MATLAB v7.3 file, for which h5py is needed: pip install 'vsalog[matlab]';"
            " or save it in MATLAB with save('file.mat', '-v7')",
            path,
        ) from None
    try:
        found, damage = sandboxed(partial(_read, h5py, path, more), more)
        return found, damage
    except SandboxError as error:
        raise ReadError(
            f"the MATLAB v7.3 file cannot be read: {error}; if MATLAB opens it, save('file.mat', '-v7') there", path
        ) from error


def _read(h5py: Any, path: Path, most: int) -> tuple[dict[str, Any], list[str]]:
    """Return the variables, and the faults of the others."""
    with h5py.File(path, "r") as file:
        walk = _Walk(h5py, most)
        return walk.members(file, 0), walk.damage


class _Walk:
    """One pass over a file."""

    def __init__(self, h5py: Any, most: int) -> None:
        self.damage: list[str] = []
        self._h5py = h5py
        self._allowed = most
        self._objects = 0
        self._walked = set[tuple[int, int]]()

    def members(self, group: Any, depth: int) -> dict[str, Any]:
        """Return the contents of a group; links to other places are not followed.

        Raises
        ------
        ValueError
            The group was walked before, as MATLAB writes none: it is a part of itself, or unfolds to no end of others.
        """
        info = self._h5py.h5o.get_info(group.id)
        place = (info.fileno, info.addr)
        if place in self._walked:
            raise ValueError("it is in several places of the file")
        self._walked.add(place)
        found: dict[str, Any] = {}
        for name in group:
            if isinstance(name, bytes):  # h5py cannot follow it
                self.damage.append("its name is no text")
                continue
            if depth == 0 and name.startswith(_OWN):
                continue
            # The name is listed, but damage prevents finding the link.
            if isinstance(group.get(name, getlink=True), self._h5py.HardLink | None):
                self._add(found, str(name), group, depth)
        return found

    def _add(self, found: dict[str, Any], name: str, group: Any, depth: int) -> None:
        try:
            found[name] = self._value(group[name], depth)
        except Exception as error:  # HDF5's library raises whatever damage provokes
            self.damage.append(TOO_MUCH if isinstance(error, MemoryError) else str(error) or type(error).__name__)

    def _value(self, node: Any, depth: int) -> Any:
        self._objects += 1
        if depth > MAX_DEPTH or self._objects > MOST_STEPS:
            raise ValueError("it is nested too deeply, or has too many parts")
        kind = node.attrs.get("MATLAB_class", b"")
        if isinstance(node, self._h5py.Group):
            return self._structures(node, depth) if "MATLAB_sparse" not in node.attrs else None
        if kind == b"char":
            return _text(node)
        if node.dtype == self._h5py.ref_dtype:
            return [self._value(node.file[reference], depth + 1) for reference in self._array(node).T.flat[:MAX_ARRAY]]
        if "MATLAB_empty" in node.attrs:
            return np.zeros((0, 0))
        if not kind:
            raise ValueError("it does not state the class of its array")
        if bytes(kind) not in _TYPES:
            return None
        if not node.id.get_type().equal(getattr(self._h5py.h5t, _TYPES[bytes(kind)])):
            raise ValueError("its numbers are not of the type that they should have")
        return self._array(node).T

    def _structures(self, group: Any, depth: int) -> dict[str, Any] | list[dict[str, Any]]:
        """Return a structure, or the structures of an array, whose members are arrays of references without a class."""
        members = self.members(group, depth + 1)
        arrays = {
            name: value
            for name, value in members.items()
            if isinstance(value, list) and "MATLAB_class" not in group[name].attrs
        }
        if not arrays or len(arrays) < len(members):
            return members
        count = min(len(value) for value in arrays.values())
        return [{name: value[i] for name, value in arrays.items()} for i in range(count)]

    def _array(self, node: Any) -> Any:
        """Return a dataset's content, as MATLAB wrote it: its dimensions in reverse."""
        if node.is_virtual or node.external:
            raise ValueError("its values are in another file")
        if node.shape is None:
            raise ValueError("its values are missing")
        if node.nbytes > self._allowed:
            raise ValueError(f"it announces {node.nbytes} bytes: no recording is compressed so much")
        self._allowed -= node.nbytes
        if node.chunks is not None:
            self._refuse_filters(node)
            _refuse_gaps(node)
        elif node.nbytes and not node.id.get_storage_size():
            raise ValueError("its values are missing")
        return np.asarray(node[()])

    def _refuse_filters(self, node: Any) -> None:
        """Refuse a dataset that is not compressed as MATLAB does it.

        Raises
        ------
        ValueError
            It is not.
        """
        kinds, plan = self._h5py.h5z, node.id.get_create_plist()
        filters = [plan.get_filter(i)[0] for i in range(plan.get_nfilters())]
        known = (kinds.FILTER_DEFLATE, kinds.FILTER_SHUFFLE, kinds.FILTER_FLETCHER32)
        if not set(filters) <= set(known) or len(set(filters)) < len(filters):
            raise ValueError("it is not compressed as MATLAB does it")


def _text(node: Any) -> str:
    """Return a text, which is stored in UTF-16, "" where it is longer than a name."""
    if not 0 < node.size <= LONGEST_TEXT or "MATLAB_empty" in node.attrs:
        return ""
    units = "".join(map(chr, node[()].flat))
    return units.encode("utf-16-le", "surrogatepass").decode("utf-16-le", "replace")


def _refuse_gaps(node: Any) -> None:
    """Refuse a dataset that lacks chunks, for which HDF5's library gives zeros, or has some of another size than it should.

    Raises
    ------
    ValueError
        It does.
    """
    lines = [range(0, size, step) for size, step in zip(node.shape, node.chunks, strict=True)]
    if node.id.get_num_chunks() < prod(map(len, lines)):
        raise ValueError("parts of its values are missing")
    if not node.id.get_create_plist().get_nfilters():  # or the list of filters was lost
        sizes: set[int] = set()
        node.id.chunk_iter(lambda chunk: sizes.add(chunk.size))
        if sizes != {prod(node.chunks) * node.dtype.itemsize}:
            raise ValueError("parts of its values are not as large as they should be")
    for place in product(*lines):
        # Searched as the library does: the list of chunks may be sound where the path to them is not.
        try:
            node.id.read_direct_chunk(place)
        except Exception as error:  # HDF5's library raises whatever damage provokes
            raise ValueError("parts of its values are missing") from error
