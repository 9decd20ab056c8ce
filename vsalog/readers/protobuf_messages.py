"""Protobuf messages → columns of numbers."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from itertools import islice
from typing import Any, NamedTuple

from vsalog.readers.fields import MAX_FIELDS
from vsalog.readers.messages import MISFIT
from vsalog.readers.protobuf_types import message_class
from vsalog.readers.reach import Nanoseconds
from vsalog.readers.tree_messages import FRAMES, STAMPS, NoSignal, TreeDecoder, stamp_of

_TIMES = ("google.protobuf.Timestamp", "google.protobuf.Duration")
_CLOCKS = (("seconds", "nanos"), ("sec", "nsec"), ("sec", "nanosec"))


class _Field(NamedTuple):
    """A field of a message type.

    `implied` is what it is where a message does not have it, None for nothing; `reason` is why it is no signal, "" where it
    may be one; `is_time` tells that it is protobuf's own time or duration.
    """

    name: str
    number: int
    implied: float | None
    reason: str
    is_time: bool


class ProtobufDecoder(TreeDecoder):
    """Decodes protobuf messages; see `TreeDecoder`.

    A field that a message does not have is NaN, but for those of proto3 whose absence means zero.

    Parameters
    ----------
    name : str
        Full name of the message type.
    descriptors : bytes
        A serialised ``FileDescriptorSet``.
    prefix, wanted : as for `TreeDecoder`

    Raises
    ------
    DefinitionError
        The descriptors cannot be understood, or the package ``protobuf`` is not installed.
    """

    misfit = MISFIT

    def __init__(self, name: str, descriptors: bytes, prefix: str, wanted: Collection[str] | None) -> None:
        super().__init__(prefix, wanted)
        self._class = message_class(name, descriptors)
        from google.protobuf.message import DecodeError, Message

        self._errors, self._kind = (DecodeError, RecursionError), Message
        self._types: dict[str, tuple[_Field, ...]] = {}
        root = self._class.DESCRIPTOR
        clocks = {path: names for path in STAMPS if (names := _clock_of(_field_at(root, path)))}
        self._stamp_path: tuple[str, ...] = next(iter(clocks), ())
        self._clock = clocks.get(self._stamp_path)
        self.stamped = self._clock is not None
        self.framed = any(_is_text(_field_at(root, path)) for path in FRAMES)

    def _loaded(self, raw: bytes) -> Any:
        try:
            return self._class.FromString(raw)
        except self._errors:
            return None

    def _members(self, part: Any) -> Iterable[tuple[str, Any]] | None:
        return self._parts(part) if isinstance(part, self._kind) else None

    def _parts(self, message: Any) -> Iterator[tuple[str, Any]]:
        # By ListFields: an attribute of a hostile name could be one of the library's.
        present = {field.number: value for field, value in type(message).ListFields(message)}
        for field in self._fields_of(type(message).DESCRIPTOR):
            value = present.get(field.number, field.implied)
            if value is None:
                continue
            if field.is_time and field.number in present:
                value = (value.seconds * Nanoseconds.SECOND + value.nanos) * 1e-9
            yield field.name, NoSignal(field.reason) if field.reason else value

    def _member(self, part: Any, name: str) -> Any:
        found = (value for field, value in type(part).ListFields(part) if field.name == name)
        # A text that is empty is left out of a message.
        return next(found, "" if _is_text(type(part).DESCRIPTOR.fields_by_name.get(name)) else None)

    def _stamp(self, message: Any) -> tuple[tuple[str, ...], int | None]:
        if self._clock is None:
            return (), None
        time = self._at(message, self._stamp_path)
        return self._stamp_path, 0 if time is None else stamp_of(*(int(getattr(time, name)) for name in self._clock))

    def _fields_of(self, descriptor: Any) -> tuple[_Field, ...]:
        """Return the fields of a message type; those of a type that is met again are remembered."""
        name = descriptor.full_name
        if name not in self._types:
            if len(descriptor.fields) > MAX_FIELDS:
                self._fields.leave(self.prefix, f"a message type with more than {MAX_FIELDS} fields")
            self._types[name] = tuple(map(_field, islice(descriptor.fields, MAX_FIELDS)))
        return self._types[name]


def _field(one: Any) -> _Field:
    """Describe a field."""
    part = one.message_type
    is_map = part is not None and part.GetOptions().map_entry
    reason = "a map" if is_map else "bytes" if one.type == one.TYPE_BYTES else ""
    is_number = part is None and not reason and one.type != one.TYPE_STRING
    implied = 0.0 if is_number and not one.is_repeated and not one.has_presence else None
    is_time = part is not None and part.full_name in _TIMES and not one.is_repeated
    return _Field(one.name, one.number, implied, reason, is_time)


def _field_at(descriptor: Any, path: tuple[str, ...]) -> Any:
    """Return the field of a message type at a path; None where there is none, or several values."""
    field = None
    for name in path:
        field = None if descriptor is None else descriptor.fields_by_name.get(name)
        descriptor = None if field is None or field.is_repeated else field.message_type
    return field if field is not None and not field.is_repeated else None


def _is_text(field: Any) -> bool:
    return field is not None and not field.is_repeated and field.type == field.TYPE_STRING


def _clock_of(field: Any) -> tuple[str, str] | None:
    """Return the fields with seconds and nanoseconds of a field that is a time; None for another one."""
    whole = (1, 3, 4, 5, 13, 15, 16, 17, 18)  # protobuf's types of integers
    part: Any = None if field is None else field.message_type
    for names in _CLOCKS if part is not None else ():
        fields = [part.fields_by_name.get(name) for name in names]
        if len(part.fields) <= 3 and all(f is not None and f.type in whole and not f.is_repeated for f in fields):
            return names
    return None
