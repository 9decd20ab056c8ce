"""The positions of the numbers in a serialised ROS message.

Most messages of a topic have the same shape. One of them is walked with its definition, which gives nested `Place`s, and the
*guards*, the bytes that have to be the same in another message for the places to hold there too (array lengths, text lengths,
the names that name array elements). All messages that match are then read at once by NumPy.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, overload

import numpy as np
from numpy.typing import NDArray

from vsalog.core.compiled import compiled
from vsalog.readers.fields import MAX_FIELDS
from vsalog.readers.known_units import unit_of
from vsalog.readers.limits import MAX_ARRAY, MOST_STEPS
from vsalog.readers.message_definitions import Array, Node, Scalar, Struct, Text, Time, is_placeholder
from vsalog.readers.nested import ELEMENT_NAME, NoSignal, Place

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]
Range = tuple[int, int]

_ENCODINGS = tuple(name for name in ("CDR", "PL_CDR", "XML", "XCDR2", "D_CDR2", "PL_CDR2") for _ in "><")
"""By the second byte of a CDR message, for either byte order (DDS-XTypes 1.3, 7.6.3.1.2)."""


class DamagedMessageError(Exception):
    """The bytes of a message do not fit its definition."""


class EncodingError(DamagedMessageError):
    """A message has an unsupported encoding; the message names it."""


class TooManyPartsError(DamagedMessageError):
    """A message has too many parts: no other of its kind should be tried."""


class PlacedText(str):
    """A text in a message, and its bytes with its length."""

    __slots__ = ("bytes",)
    bytes: Range


class PlacedNumbers(Sequence[Place]):
    """An array of numbers in a message."""

    def __init__(self, first: Place, size: int, count: int) -> None:
        self._first, self._size, self._count = first, size, count

    def __len__(self) -> int:
        return self._count

    @overload
    def __getitem__(self, i: int) -> Place: ...
    @overload
    def __getitem__(self, i: slice) -> Sequence[Place]: ...
    def __getitem__(self, i: int | slice) -> Any:
        if isinstance(i, slice) or not 0 <= i < self._count:
            raise IndexError(i)
        return Place(self._first.offset + i * self._size, self._first.code, self._first.unit)


@dataclass(frozen=True, slots=True)
class Layout:
    """The positions of the numbers in messages of one length whose guards equal those of `sample`.

    Attributes
    ----------
    mask : uint8 array
        255 for the bytes that must be equal, the guards; up to the last of them.
    sample : uint8 array, of the mask's shape
        The beginning of the message that the layout is from.
    stamp : Place or None
        The header's time stamp.
    names : tuple of (str, str or None)
        Channels and their units.
    places : dict of str to (list of int, int64 array), both of length k
        By type of number: which of the channels, and their offsets.
    """

    mask: Bytes
    sample: Bytes
    stamp: Place | None
    names: tuple[tuple[str, str | None], ...]
    places: dict[str, tuple[list[int], Integers]]

    @classmethod
    def of(cls, raw: bytes, guards: Sequence[Range], stamp: Place | None, found: dict[str, Place]) -> Layout:
        """Return the layout of a message, of its guards, and of the numbers that are wanted by name."""
        mask = np.zeros(max((stop for _, stop in guards), default=0), dtype=np.uint8)
        for start, stop in guards:
            mask[start:stop] = 255
        places: dict[str, tuple[list[int], list[int]]] = {}
        for k, one in enumerate(found.values()):
            which, offsets = places.setdefault(one.code, ([], []))
            which.append(k)
            offsets.append(one.offset)
        return cls(
            mask,
            np.frombuffer(raw[: mask.size], np.uint8),
            stamp,
            tuple((name, one.unit) for name, one in found.items()),
            {code: (which, np.array(offsets)) for code, (which, offsets) in places.items()},
        )

    def matches(self, data: Bytes, start: Integers) -> NDArray[np.bool_]:
        """Return which messages of its length, beginning at `start`, shape (n,), in a buffer, have this layout."""
        out = np.empty(start.size, dtype=np.bool_)
        _equal(data, start, self.mask, self.sample, out)
        return out


@compiled
def _equal(data: Bytes, start: Integers, mask: Bytes, sample: Bytes, out: NDArray[np.bool_]) -> None:
    """Return which messages have the sample's bytes where the mask is set.

    To the mask's end, without a way out before, and with unsigned indices: the compiler compares many bytes at once.
    """
    for k in range(start.size):
        at, other = np.uint64(start[k]), np.uint8(0)
        for i in range(np.uint64(mask.size)):
            other |= (data[at + i] ^ sample[i]) & mask[i]
        out[k] = other == 0


def places_in(raw: bytes, root: Struct, cdr: bool) -> tuple[dict[str, Any], list[Range]]:
    """Return the positions of a message's numbers, as nested values, and its guards except for names.

    Parameters
    ----------
    raw : bytes
        The serialised message.
    root : Struct
        Its definition.
    cdr : bool
        ROS 2's encoding (aligned, four bytes ahead that tell the byte order) or ROS 1's.

    Raises
    ------
    DamagedMessageError
        The message does not fit the definition.
    """
    walk = _Walk(raw, cdr)
    places = walk.struct(root, None)
    spare = len(raw) - walk.pos
    if spare < 0 or spare > (3 if cdr else 0):  # CDR may be padded to a multiple of four
        raise DamagedMessageError("its length differs from that of the definition")
    return places, walk.guards


class _Walk:
    """One pass over a message: knows the position, collects guards."""

    def __init__(self, raw: bytes, cdr: bool) -> None:
        self.raw = raw
        self.cdr = cdr
        self.pos = 0
        self.order = "<"
        self.guards: list[Range] = []
        self.steps = 0
        if cdr:
            self._encapsulation()

    def _encapsulation(self) -> None:
        if len(self.raw) < 4 or self.raw[0] != 0 or self.raw[1] >= len(_ENCODINGS):
            raise DamagedMessageError("its CDR header is invalid")
        if self.raw[1] > 1:
            kind = f"{_ENCODINGS[self.raw[1]]} (0x{self.raw[1]:04x})"
            raise EncodingError(f"messages encoded as {kind} are not supported, only plain CDR as ROS 2 writes it is")
        self.order = "<" if self.raw[1] else ">"
        self.guards.append((0, 2))
        self.pos = 4

    def struct(self, node: Struct, unit: str | None) -> dict[str, Any]:
        """Walk the fields of a message; its parts have a unit of their own or that of the message."""
        places: dict[str, Any] = {}
        for field, child in node.fields:
            self._step()
            own = unit_of(node.name, field) or unit
            if isinstance(child, Array):
                places[field] = self._array(child, own, node.named)
            else:
                places[field] = self._node(child, own)
            if is_placeholder(field):
                del places[field]
        return places

    def _step(self) -> None:
        self.steps += 1
        if self.steps > MOST_STEPS:
            raise TooManyPartsError("it has too many parts")

    def _node(self, node: Node, unit: str | None) -> Any:
        self._step()
        if isinstance(node, Scalar):
            return self._number(node, unit, 1)
        if isinstance(node, Time):
            self._align(4)
            place = Place(self.pos, node.code(self.order), "s")
            self._advance(8)
            return place
        if isinstance(node, Text):
            return self._text()
        if isinstance(node, Struct):
            return self.struct(node, unit)
        return self._array(node, unit, False)

    def _number(self, node: Scalar, unit: str | None, count: int) -> Place:
        """Return the place of the first of some numbers."""
        self._align(node.size)
        place = Place(self.pos, self.order + node.code, unit)
        self._advance(count * node.size)
        return place

    def _array(self, node: Array, unit: str | None, named: bool) -> Sequence[Any] | NoSignal:
        """Walk an array; `named` is whether there are texts next to it that may name its elements."""
        count, element = self._count(node), node.element
        if isinstance(element, Scalar):
            return PlacedNumbers(self._number(element, unit, count), element.size, count) if count else []
        if isinstance(element, Text):
            return [self._text() for _ in range(count)]
        named = named or _tells_its_name(element)
        if count <= (MAX_FIELDS if named else MAX_ARRAY):
            return [self._node(element, unit) for _ in range(count)]
        self._pass_by(element, count)
        return NoSignal(f"array of {count} values")

    def _pass_by(self, node: Node, count: int) -> None:
        """Walk elements that are no signal."""
        guards = len(self.guards)
        for i in range(count):
            begin = self.pos
            self._node(node, None)
            stride = self.pos - begin
            if len(self.guards) == guards and i and stride % 8 == 0:
                self._advance(stride * (count - 1 - i))  # every further element looks the same
                return

    def _count(self, node: Array) -> int:
        if node.count is not None:
            count = node.count
        else:
            self._align(4)
            count = self._word()
        if count > len(self.raw):  # every element takes a byte at least
            raise DamagedMessageError(f"it claims an array of {count} values")
        return count

    def _text(self) -> PlacedText:
        """Pass a text, whose length is guarded."""
        begin = self._aligned(self.pos, 4)
        middle = begin + 4
        order: Literal["little", "big"] = "little" if self.order == "<" else "big"
        self.pos = middle + int.from_bytes(self.raw[begin:middle], order)
        if self.pos > len(self.raw):
            raise DamagedMessageError("it ends too early")
        self.guards.append((begin, middle))
        text = PlacedText(self.raw[middle : self.pos].rstrip(b"\0").decode("utf-8", "replace"))
        text.bytes = (begin, self.pos)
        return text

    def _word(self) -> int:
        start = self.pos
        self._advance(4)
        self.guards.append((start, self.pos))
        return int(struct.unpack_from(f"{self.order}I", self.raw, start)[0])

    def _aligned(self, pos: int, size: int) -> int:
        return 4 + ((pos - 4 + size - 1) & -size) if self.cdr else pos

    def _align(self, size: int) -> None:
        self.pos = self._aligned(self.pos, size)

    def _advance(self, size: int) -> None:
        self.pos += size
        if self.pos > len(self.raw):
            raise DamagedMessageError("it ends too early")


def _tells_its_name(node: Node) -> bool:
    """Return whether elements of a type have names of their own."""
    return isinstance(node, Struct) and any(f == ELEMENT_NAME and isinstance(child, Text) for f, child in node.fields)
