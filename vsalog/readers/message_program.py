"""A message definition as a list of steps, for the compiled walk through messages that have no shape in common.

It does what `vsalog.readers.layout.learn` does, in the same order, for the types that it can be written down for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.readers.base import MAX_DEPTH
from vsalog.readers.definitions import Array, Node, Scalar, Struct, Text, Time
from vsalog.readers.known_units import unit_of
from vsalog.readers.labels import LABEL_FIELDS, MAX_ARRAYS, tells_its_name
from vsalog.readers.message_scan import Step

_MOST_STEPS = 2000


@dataclass(frozen=True, slots=True)
class Place:
    """Where in a definition numbers or texts come from.

    Attributes
    ----------
    path : str
        From the innermost element of an array that it is in, or from the message, on.
    code : str
        NumPy type with byte order as of `vsalog.readers.layout.Field`, "" for texts.
    unit : str or None
        As the message type implies.
    array : bool
        It is an array, whose elements have names or numbers.
    """

    path: str
    code: str
    unit: str | None
    array: bool = False


@dataclass(frozen=True, slots=True)
class Program:
    """A definition, flattened.

    Attributes
    ----------
    steps : int64 array, shape (n, 5)
        What to do, and a, b, c, d of it.
    places : tuple of Place
        By number.
    stamp : str
        The type of the header's time stamp, "" where there is none.
    """

    steps: NDArray[np.int64]
    places: tuple[Place, ...]
    stamp: str


class _TooLargeError(Exception):
    """A definition cannot be written as a program of reasonable length."""


def program_of(root: Struct) -> Program | None:
    """Return the program of a message type; None where it would be too long, or names do not come before what they may name."""
    writer = _Writer()
    try:
        writer.struct(root, "", None)
        writer.add(Step.DONE)
    except _TooLargeError:
        return None
    return Program(np.array(writer.steps, dtype=np.int64), tuple(writer.places), writer.stamp)


class _Writer:
    def __init__(self) -> None:
        self.steps: list[tuple[int, int, int, int, int]] = []
        self.places: list[Place] = []
        self.depth = 0
        self.stamp = ""

    def add(self, op: int, a: int = 0, b: int = 0, c: int = 0, d: int = 0) -> int:
        if len(self.steps) >= _MOST_STEPS:
            raise _TooLargeError
        self.steps.append((op, a, b, c, d))
        return len(self.steps) - 1

    def place(self, path: str, code: str, unit: str | None, array: bool = False) -> int:
        self.places.append(Place(path, code, unit, array))
        return len(self.places) - 1

    def struct(self, node: Struct, path: str, unit: str | None) -> None:
        ranks = _ranks(node) if node.named else {}
        if ranks:
            self.add(Step.STRUCT, len(ranks))
        for field, child in node.fields:
            child_path = f"{path}.{field}" if path or self.depth else field
            child_unit = unit_of(node.name, field) or unit
            if isinstance(child, Array):
                self.array(child, child_path, child_unit, ranks.get(field, -1), len(ranks))
            else:
                self.node(child, child_path, child_unit)
        for field, rank in ranks.items():
            own = f"{path}.{field}" if path or self.depth else field
            self.add(Step.UNUSED, len(ranks), self.place(own, "", None), rank)
        if ranks:
            self.add(Step.END, len(ranks))

    def node(self, node: Node, path: str, unit: str | None) -> None:
        if isinstance(node, Scalar):
            self.add(Step.NUMBER, node.size, self.place(path, "<" + node.code, unit))
        elif isinstance(node, Time):
            code = node.code("<")
            is_stamp = path in ("header.stamp", "stamp") and not self.depth and not self.stamp
            self.stamp = code if is_stamp else self.stamp
            self.add(Step.STAMP if is_stamp else Step.TIME, 0, self.place(path, code, "s"))
        elif isinstance(node, Text):
            silent = path in ("header.frame_id", "frame_id") and not self.depth
            self.add(Step.TEXT, 0, -1 if silent else self.place(path, "", None))
        elif isinstance(node, Struct):
            self.struct(node, path, unit)
        else:
            raise _TooLargeError  # an array of arrays: no definition has one

    def array(self, node: Array, path: str, unit: str | None, rank: int, ranks: int) -> None:
        count = -1 if node.count is None else node.count
        if isinstance(node.element, Text):
            self.add(Step.TEXTS, count, self.place(path, "", None) if rank < 0 else -1, rank, ranks)
        elif isinstance(node.element, Scalar):
            place = self.place(path, "<" + node.element.code, unit, array=True)
            self.add(Step.NUMBERS, count, place, node.element.size, ranks)
        elif tells_its_name(node.element):
            raise _TooLargeError  # the names come with the elements
        else:
            at = self.add(Step.LOOP, count, self.place(path, "", None, array=True), 0, ranks)
            self.depth += 1
            if self.depth > MAX_DEPTH:
                raise _TooLargeError
            self.node(node.element, "", unit)
            self.depth -= 1
            self.add(Step.NEXT, at, self.steps[at][2])
            self.steps[at] = (*self.steps[at][:3], len(self.steps), ranks)


def _ranks(node: Struct) -> dict[str, int]:
    """Return the arrays of texts of a struct, in the order in which they are asked for names."""
    arrays = [(field, child) for field, child in node.fields if isinstance(child, Array)]
    texts = [field for field, child in arrays if isinstance(child, Array) and isinstance(child.element, Text)]
    if [field for field, _ in arrays][: len(texts)] != texts or len(texts) > MAX_ARRAYS:
        raise _TooLargeError
    return {field: rank for rank, field in enumerate(sorted(texts, key=_usual))}


def _usual(field: str) -> int:
    return LABEL_FIELDS.index(field) if field in LABEL_FIELDS else len(LABEL_FIELDS)
