"""Protobuf messages → columns of numbers."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from enum import IntEnum
from itertools import islice
from typing import Any

import numpy as np

from vsalog.core.printable import LONGEST_TEXT, MAX_DEPTH, printable
from vsalog.readers.fields import LARGE_MESSAGES, LONG_NAMES, MAX_FIELDS, Fields
from vsalog.readers.frames import stated_frames
from vsalog.readers.labels import ELEMENT_NAME, best_label_field, labels_of, naming_texts
from vsalog.readers.limits import DECODED_BYTES, MAX_ARRAY
from vsalog.readers.messages import MISFIT, Decoded
from vsalog.readers.packets import Messages
from vsalog.readers.protobuf_types import message_class
from vsalog.readers.reach import Nanoseconds, Stamp


class Kind(IntEnum):
    """What a field is."""

    NUMBER, TIME, MESSAGE, TEXT, OTHER = range(5)


_TIMES = ("google.protobuf.Timestamp", "google.protobuf.Duration")
_STAMPS = (("timestamp",), ("stamp",), ("header", "stamp"), ("header", "timestamp"))
"""Where a message may have its time, best first."""
_FRAMES = (("header", "frame_id"), ("frame_id",))
"""Where a message may name its frame, best first."""
_CLOCKS = (("seconds", "nanos"), ("sec", "nsec"), ("sec", "nanosec"))


@dataclass(frozen=True, slots=True)
class _Field:
    """A field of a message type.

    `kind` is one of the constants above; `optional` tells that a message says whether it has the field. `reason` is why it is no
    signal, "" where it may be one.
    """

    name: str
    number: int
    kind: int
    repeated: bool
    optional: bool
    reason: str


class ProtobufDecoder:
    """Decodes protobuf messages: every number in them is a channel, named by its path.

    A field that a message does not have is NaN, but for those of proto3 whose absence means zero.

    Parameters
    ----------
    name : str
        Full name of the message type.
    descriptors : bytes
        A serialised ``FileDescriptorSet``.
    prefix : str
        Name of the stream, ahead of every channel's name.
    wanted : collection of str or None
        Channels to decode; None is all of them.

    Raises
    ------
    DefinitionError
        The descriptors cannot be understood, or the package ``protobuf`` is not installed.
    """

    misfit = MISFIT

    def __init__(self, name: str, descriptors: bytes, prefix: str, wanted: Collection[str] | None) -> None:
        self.prefix = prefix
        self._taken = Fields(prefix, wanted)
        self.unread = self._taken.unread
        self._class = message_class(name, descriptors)
        self._fields: dict[str, tuple[_Field, ...]] = {}
        self._stamp_path = _stamp_path(self._class.DESCRIPTOR)
        self._frame_path = _frame_path(self._class.DESCRIPTOR)
        self.stamped, self.framed = bool(self._stamp_path), bool(self._frame_path)

    def decode(self, messages: Messages) -> Decoded:
        """Decode a batch of messages; what is no message of this type counts as damaged."""
        from google.protobuf.message import DecodeError

        count = len(messages)
        result = Decoded(good=np.zeros(count, dtype=bool))
        if self._stamp_path:
            result.stamps = np.zeros(count, dtype=np.int64)
        for row, raw in enumerate(messages):
            if len(raw) > DECODED_BYTES:
                self._taken.leave(self.prefix, LARGE_MESSAGES)
                continue
            try:
                message = self._class.FromString(raw)
            except (DecodeError, RecursionError):
                continue
            self._message(message, row, result)
        return result

    def frames(self, messages: Messages) -> Messages:
        """Return the frames that messages name, as text; length -1 where that is not clear."""
        return stated_frames([self._frame(raw) for raw in messages])

    def _frame(self, raw: bytes) -> object:
        from google.protobuf.message import DecodeError

        if len(raw) > DECODED_BYTES:
            return None
        try:
            part: Any = self._class.FromString(raw)
        except (DecodeError, RecursionError):
            return None
        for name in self._frame_path:
            part = next((value for field, value in type(part).ListFields(part) if field.name == name), "")
            if part == "":
                break  # proto3 leaves empty texts out
        return part

    def _message(self, message: Any, row: int, result: Decoded) -> None:
        result.good[row] = True
        if result.stamps is not None:
            result.stamps[row] = _stamp_of(message, self._stamp_path)
        found: dict[str, float] = {}
        self._walk(message, self.prefix, found, 0)
        result.put(row, found, self._taken)

    def _walk(self, message: Any, path: str, found: dict[str, float], depth: int) -> None:
        """Collect the numbers of a message in `found`, by path."""
        # By ListFields: an attribute of a hostile name could be one of the library's.
        present = {field.number: value for field, value in type(message).ListFields(message)}
        fields = self._fields_of(type(message).DESCRIPTOR)
        texts = naming_texts((f.name, present[f.number]) for f in fields if _may_label(f) and f.number in present)
        lengths = {len(present[f.number]) for f in fields if f.repeated and not f.reason and f.number in present}
        naming = {best_label_field(texts, count) for count in lengths & {len(text) for text in texts.values()}}
        for field in fields:
            if depth == 0 and self._stamp_path == (field.name,):
                continue
            here = f"{path}.{field.name}"
            if field.number not in present:
                if not (field.optional or field.repeated or field.reason) and field.kind == Kind.NUMBER:
                    found[here] = 0.0
                continue
            if field.reason:
                if not (_may_label(field) and field.name in naming):
                    self._taken.leave(here, field.reason)
            elif field.repeated:
                self._array(field, present[field.number], here, texts, found, depth)
            else:
                self._value(field.kind, present[field.number], here, found, depth)

    def _array(
        self, field: _Field, values: Any, path: str, texts: dict[str, list[str]], found: dict[str, float], depth: int
    ) -> None:
        key = best_label_field(texts, len(values))
        labels = labels_of(texts[key]) if key else _own_names(values) if field.kind == Kind.MESSAGE else []
        if not labels and len(values) > MAX_ARRAY:
            self._taken.leave(path, f"array of {len(values)} values")
            return
        for i, value in enumerate(values):
            self._value(field.kind, value, f"{path}[{labels[i] if labels else i}]", found, depth)

    def _value(self, kind: int, value: Any, path: str, found: dict[str, float], depth: int) -> None:
        if len(found) >= MAX_FIELDS:
            self._taken.leave(self.prefix, f"more than {MAX_FIELDS} values")
        elif kind == Kind.NUMBER:
            found[path] = float(value)
        elif kind == Kind.TIME:
            if not (depth == 1 and self._is_stamp(path)):
                found[path] = (value.seconds * Nanoseconds.SECOND + value.nanos) * 1e-9
        elif depth >= MAX_DEPTH:
            self._taken.leave(path, f"nested more than {MAX_DEPTH} deep")
        elif not (depth == 1 and self._is_stamp(path)):
            self._walk(value, path, found, depth + 1)

    def _is_stamp(self, path: str) -> bool:
        return bool(self._stamp_path) and path == ".".join((self.prefix, *self._stamp_path))

    def _fields_of(self, descriptor: Any) -> tuple[_Field, ...]:
        """Return the fields of a message type; those of a type that is met again are remembered."""
        name = descriptor.full_name
        if name not in self._fields:
            if len(descriptor.fields) > MAX_FIELDS:
                self._taken.leave(self.prefix, f"a message type with more than {MAX_FIELDS} fields")
            fields = tuple(map(_field, islice(descriptor.fields, MAX_FIELDS)))
            self._fields[name] = tuple(field for field in fields if len(field.name) <= LONGEST_TEXT)
            if len(self._fields[name]) < len(fields):
                self._taken.leave(self.prefix, LONG_NAMES)
        return self._fields[name]


def _field(one: Any) -> _Field:
    """Describe a field."""
    part = one.message_type
    is_map = part is not None and part.GetOptions().map_entry
    if part is not None:
        kind, reason = (Kind.TIME if part.full_name in _TIMES else Kind.MESSAGE), "a map" if is_map else ""
    elif one.type == one.TYPE_STRING:
        kind, reason = Kind.TEXT, "text"
    elif one.type == one.TYPE_BYTES:
        kind, reason = Kind.OTHER, "bytes"
    else:
        kind, reason = Kind.NUMBER, ""
    return _Field(one.name, one.number, kind, bool(one.is_repeated), bool(one.has_presence), reason)


def _own_names(values: Any) -> list[str]:
    """Return the names that the elements of an array have themselves, none where these do not tell them apart."""
    if len(values) > MAX_FIELDS:
        return []
    parts = ({field.name: text for field, text in type(value).ListFields(value)} for value in values)
    names = [part.get(ELEMENT_NAME) for part in parts]
    texts = [printable(name) for name in names if isinstance(name, str)]
    return labels_of(texts) if len(texts) == len(names) else []


def _may_label(field: _Field) -> bool:
    return field.repeated and field.kind == Kind.TEXT


def _stamp_path(descriptor: Any) -> tuple[str, ...]:
    """Return where a message type has its time stamp, () where it has none."""
    for path in _STAMPS:
        part = descriptor
        for name in path:
            field = None if part is None else part.fields_by_name.get(name)
            part = None if field is None or field.is_repeated else field.message_type
        if part is not None and (part.full_name == _TIMES[0] or _clock_of(part)):
            return path
    return ()


def _frame_path(descriptor: Any) -> tuple[str, ...]:
    """Return where a message type names its frame, () where it does not."""
    for path in _FRAMES:
        part, field = descriptor, None
        for name in path:
            field = None if part is None else part.fields_by_name.get(name)
            part = None if field is None or field.is_repeated else field.message_type
        if field is not None and field.type == field.TYPE_STRING and not field.is_repeated:
            return path
    return ()


def _clock_of(descriptor: Any) -> tuple[str, str] | None:
    """Return the fields with seconds and nanoseconds of a time that is not protobuf's own."""
    whole = (1, 3, 4, 5, 13, 15, 16, 17, 18)  # protobuf's types of integers
    for names in _CLOCKS:
        fields = [descriptor.fields_by_name.get(name) for name in names]
        if len(descriptor.fields) <= 3 and all(f is not None and f.type in whole and not f.is_repeated for f in fields):
            return names
    return None


def _stamp_of(message: Any, path: tuple[str, ...]) -> int:
    """Return a message's time stamp [ns], 0 where it has none."""
    for name in path:
        present = {field.name: value for field, value in type(message).ListFields(message)}
        if name not in present:
            return 0
        message = present[name]
    names = _clock_of(type(message).DESCRIPTOR)
    if names is None:
        return 0
    seconds, fraction = (int(getattr(message, name)) for name in names)
    stamp = seconds * Nanoseconds.SECOND + fraction
    return stamp if 0 <= fraction < Nanoseconds.SECOND and abs(stamp) < Stamp.FARTHEST else Stamp.NEVER
