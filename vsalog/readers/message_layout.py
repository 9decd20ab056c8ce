"""Where the numbers lie in a serialised ROS message.

Most messages of a topic have the same shape. One of them is walked with its definition, which gives a *layout*: the byte
offset of every number, and the *guards*, the bytes that have to be the same in another message for the layout to hold
there too (array lengths, text lengths, the names that name array elements). All messages that match are then read at once
by NumPy.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.core.compiled import compiled
from vsalog.core.printable import printable
from vsalog.readers import element_names as naming
from vsalog.readers.fields import MAX_FIELDS
from vsalog.readers.known_units import unit_of
from vsalog.readers.limits import MAX_ARRAY, MOST_STEPS
from vsalog.readers.message_definitions import Array, Node, Scalar, Struct, Text, Time, is_placeholder

Bytes = NDArray[np.uint8]
Integers = NDArray[np.int64]

_ENCODINGS = tuple(name for name in ("CDR", "PL_CDR", "XML", "XCDR2", "D_CDR2", "PL_CDR2") for _ in "><")
"""By the second byte of a CDR message, for either byte order (DDS-XTypes 1.3, 7.6.3.1.2)."""


class DamagedMessageError(Exception):
    """The bytes of a message do not fit its definition."""


class EncodingError(DamagedMessageError):
    """A message is encoded in a way that is not read; its text says which."""


class TooManyPartsError(DamagedMessageError):
    """A message has so many parts that no other of its kind should be tried."""


class Field(NamedTuple):
    """One number in a message: its path, where it starts and what it is.

    `code` is a NumPy type with byte order, or that of seconds and nanoseconds, ``<i4,<u4``.
    """

    path: str
    offset: int
    code: str
    unit: str | None


@dataclass(frozen=True, slots=True)
class Layout:
    """Where the numbers lie in messages of `length` bytes whose guards equal those of `sample`.

    Attributes
    ----------
    length : int
        Bytes of the message.
    mask : uint8 array
        255 for the bytes that must be equal, the guards; up to the last of them.
    sample : uint8 array, of the mask's shape
        How the message begins that the layout was learnt from.
    stamp : Field or None
        The header's time stamp.
    fields : tuple of Field
        The numbers.
    unread : dict of str to str
        Paths that are no signal, with the reason.
    """

    length: int
    mask: Bytes
    sample: Bytes
    stamp: Field | None
    fields: tuple[Field, ...]
    unread: dict[str, str]

    def matches(self, data: Bytes, start: Integers) -> NDArray[np.bool_]:
        """Tell which messages of this length, beginning at `start`, shape (n,), in a buffer, this layout holds for."""
        out = np.empty(start.size, dtype=np.bool_)
        _equal(data, start, self.mask, self.sample, out)
        return out


@compiled
def _equal(data: Bytes, start: Integers, mask: Bytes, sample: Bytes, out: NDArray[np.bool_]) -> None:
    """Tell which messages have the sample's bytes where the mask is set.

    To the mask's end, without a way out before, and with unsigned indices: the compiler compares many bytes at once.
    """
    for k in range(start.size):
        at, other = np.uint64(start[k]), np.uint8(0)
        for i in range(np.uint64(mask.size)):
            other |= (data[at + i] ^ sample[i]) & mask[i]
        out[k] = other == 0


def learn(raw: bytes, root: Struct, cdr: bool) -> Layout:
    """Return the layout of one message.

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
    walk.struct(root, "", None)
    spare = len(raw) - walk.pos
    if spare < 0 or spare > (3 if cdr else 0):  # CDR may be padded to a multiple of four
        raise DamagedMessageError("its length differs from what the definition says")
    mask = _mask(walk.guards)
    return Layout(
        length=len(raw),
        mask=mask,
        sample=np.frombuffer(raw[: mask.size], np.uint8),
        stamp=walk.stamp,
        fields=tuple(walk.fields),
        unread=walk.unread,
    )


def _mask(ranges: list[tuple[int, int]]) -> Bytes:
    """Return 255 for the bytes in some ranges, 0 for the others."""
    mask = np.zeros(max((stop for _, stop in ranges), default=0), dtype=np.uint8)
    for start, stop in ranges:
        mask[start:stop] = 255
    return mask


class _Walk:
    """One pass over a message: knows the position, collects fields and guards."""

    def __init__(self, raw: bytes, cdr: bool) -> None:
        self.raw = raw
        self.cdr = cdr
        self.pos = 0
        self.order = "<"
        self.guards: list[tuple[int, int]] = []
        self.fields: list[Field] = []
        self.unread: dict[str, str] = {}
        self.stamp: Field | None = None
        self.emitting = True
        self.guarding = True
        self.steps = 0
        if cdr:
            self._encapsulation()

    def _encapsulation(self) -> None:
        if len(self.raw) < 4 or self.raw[0] != 0 or self.raw[1] >= len(_ENCODINGS):
            raise DamagedMessageError("its CDR header is none")
        if self.raw[1] > 1:
            kind = f"{_ENCODINGS[self.raw[1]]} (0x{self.raw[1]:04x})"
            raise EncodingError(f"messages encoded as {kind} are not supported, only plain CDR as ROS 2 writes it is")
        self.order = "<" if self.raw[1] else ">"
        self.guards.append((0, 2))
        self.pos = 4

    def struct(self, node: Struct, path: str, unit: str | None) -> None:
        """Walk the fields of a message."""
        texts, counts = self._label_arrays(node) if node.named and self.emitting else ({}, set())
        for field, child in node.fields:
            self._step()
            child_path = f"{path}.{field}" if path else field
            child_unit = unit_of(node.name, field) or unit
            if isinstance(child, Array):
                is_key = field in texts and len(texts[field]) in counts
                self._array(child, child_path, child_unit, texts, is_key)
            else:
                self._node(child, child_path, child_unit)

    def _step(self) -> None:
        self.steps += 1
        if self.steps > MOST_STEPS:
            raise TooManyPartsError("it has too many parts")

    def _label_arrays(self, node: Struct) -> tuple[dict[str, list[str]], set[int]]:
        """Look ahead: the arrays of texts in this message, and the lengths of its other arrays."""
        before = (self.pos, self.emitting, self.guarding)
        self.emitting = self.guarding = False
        texts: dict[str, list[str]] = {}
        counts: set[int] = set()
        for field, child in node.fields:
            if not isinstance(child, Array):
                self._node(child, "", None)
            elif isinstance(child.element, Text):
                found = self._texts(self._count(child))
                texts |= naming.naming_texts([(field, found)] if len(texts) < MAX_ARRAY else [])
            else:
                start = self.pos
                counts.add(self._count(child))
                self.pos = start
                self._array(child, "", None, {}, False)
        self.pos, self.emitting, self.guarding = before
        return texts, counts

    def _node(self, node: Node, path: str, unit: str | None) -> None:
        self._step()
        if isinstance(node, Scalar):
            self._align(node.size)
            self._emit(path, self.order + node.code, unit)
            self._advance(node.size)
        elif isinstance(node, Time):
            self._time(path, node.code(self.order))
        elif isinstance(node, Text):
            self._texts(1)
            if self.emitting and path not in ("header.frame_id", "frame_id"):
                self.unread[path] = "text"
        elif isinstance(node, Struct):
            self.struct(node, path, unit)
        else:
            self._array(node, path, unit, {}, False)

    def _time(self, path: str, code: str) -> None:
        self._align(4)
        if path in ("header.stamp", "stamp") and self.stamp is None and self.emitting:
            self.stamp = Field(path, self.pos, code, "s")
        else:
            self._emit(path, code, "s")
        self._advance(8)

    def _array(self, node: Array, path: str, unit: str | None, texts: dict[str, list[str]], is_key: bool) -> None:
        """Walk an array; its elements are named by one of `texts`, or else by their index."""
        count = self._count(node)
        if isinstance(node.element, Text):
            self._texts(count, guard=is_key)
            if self.emitting and not is_key and count:
                self.unread[path] = "text"
            elif self.emitting and is_key and naming.are_bad(path.rpartition(".")[2], texts):
                self.unread[path] = naming.BAD_NAMES
            return
        key = naming.best_label_field(texts, count)
        named = naming.labels_of(texts[key]) if key else self._own_names(node.element, count)
        labels = named or [str(i) for i in range(min(count, MAX_ARRAY + 1))]
        silent = self.emitting and not named and count > MAX_ARRAY
        if silent:
            self.unread[path] = f"array of {count} values"
            self.emitting = False
        if isinstance(node.element, Scalar):
            self._numbers(node.element, count, path, unit, labels)
        else:
            self._elements(node.element, count, path, unit, labels)
        if silent:
            self.emitting = True

    def _own_names(self, node: Node, count: int) -> list[str]:
        """Look ahead: the names that elements have themselves; none where these do not tell them apart."""
        if (
            not self.emitting
            or not 0 < count <= MAX_FIELDS
            or not isinstance(node, Struct)
            or not naming.tells_its_name(node)
        ):
            return []
        start, guarding = self.pos, self.guarding
        self.emitting = False
        names: list[str] = []
        for field, child in node.fields * count:
            self.guarding = guarding and field == naming.ELEMENT_NAME
            if field == naming.ELEMENT_NAME:
                names += map(printable, self._texts(1, guard=True))
            else:
                self._node(child, "", None)
        self.pos, self.emitting, self.guarding = start, True, guarding
        return naming.labels_of(names)

    def _numbers(self, node: Scalar, count: int, path: str, unit: str | None, labels: list[str]) -> None:
        if not count:
            return
        self._align(node.size)
        if self.emitting:
            code, places = self.order + node.code, range(self.pos, len(self.raw), node.size)
            self._add([Field(f"{path}[{label}]", at, code, unit) for label, at in zip(labels, places, strict=False)])
        self._advance(count * node.size)

    def _elements(self, node: Node, count: int, path: str, unit: str | None, labels: list[str]) -> None:
        guards = len(self.guards)
        for i in range(count):
            end = self.pos
            self._node(node, f"{path}[{labels[i]}]" if self.emitting else "", unit)
            stride = self.pos - end
            fixed = len(self.guards) == guards and self.guarding
            if not self.emitting and fixed and i and stride % 8 == 0:
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

    def _texts(self, count: int, guard: bool = False) -> list[str]:
        """Pass texts; their lengths are guarded, and what they say where asked for."""
        raw, pos = self.raw, self.pos
        order: Literal["little", "big"] = "little" if self.order == "<" else "big"
        texts = []
        for _ in range(count):
            pos = self._aligned(pos, 4)
            begin = pos + 4
            end = begin + int.from_bytes(raw[pos:begin], order)
            if end > len(raw):
                raise DamagedMessageError("it ends too early")
            if self.guarding:
                self.guards.append((pos, end if guard else begin))
            texts.append(raw[begin:end].rstrip(b"\0").decode("utf-8", "replace"))
            pos = end
        self.pos = pos
        return texts

    def _word(self) -> int:
        start = self.pos
        self._advance(4)
        if self.guarding:
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

    def _emit(self, path: str, code: str, unit: str | None) -> None:
        if self.emitting and not is_placeholder(path.rpartition(".")[2]):
            self._add([Field(path, self.pos, code, unit)])

    def _add(self, fields: list[Field]) -> None:
        room = MAX_FIELDS - len(self.fields)
        self.fields += fields[:room]
        if len(fields) > room:
            self.unread[fields[room].path.partition(".")[0]] = f"more than {MAX_FIELDS} values"
