"""Protobuf messages → columns of numbers."""

from __future__ import annotations

from collections.abc import Callable, Collection, ItemsView, Iterator, Mapping
from itertools import islice
from typing import Any, NamedTuple

from vsalog.readers.fields import MAX_FIELDS
from vsalog.readers.messages import MISFIT
from vsalog.readers.nested import FRAMES, STAMPS, NoSignal, part_at
from vsalog.readers.protobuf_types import message_class
from vsalog.readers.reach import Nanoseconds
from vsalog.readers.tree_messages import TreeDecoder, stamp_of

_TIMES = ("google.protobuf.Timestamp", "google.protobuf.Duration")
_CLOCKS = (("seconds", "nanos"), ("sec", "nsec"), ("sec", "nanosec"))


class _Field(NamedTuple):
    """A field of a message type.

    `implied` is its value where a message lacks it, None for none; `reason` is why it is no signal, "" where it
    may be one; `is_time` is whether it is protobuf's own time or duration, `nested` whether it contains messages.
    """

    name: str
    number: int
    implied: float | None
    reason: str
    is_time: bool
    nested: bool


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
        from google.protobuf.message import DecodeError

        self._errors = (DecodeError, RecursionError)
        self._types: dict[str, tuple[_Field, ...]] = {}
        root = self._class.DESCRIPTOR
        clocks = {path: names for path in STAMPS if (names := _clock_of(_field_at(root, path)))}
        self._stamp_path: tuple[str, ...] = next(iter(clocks), ())
        self._clock = clocks.get(self._stamp_path)
        self.stamped = self._clock is not None
        self.framed = any(_is_text(_field_at(root, path)) for path in FRAMES)

    def _loaded(self, raw: bytes) -> Any:
        try:
            return _Message(self._class.FromString(raw), self._fields_of)
        except self._errors:
            return None

    def _stamp(self, message: Any) -> tuple[tuple[str, ...], int | None]:
        if self._clock is None:
            return (), None
        time = part_at(message, self._stamp_path)
        return self._stamp_path, 0 if time is None else stamp_of(*(int(time.get(name) or 0) for name in self._clock))

    def _fields_of(self, descriptor: Any) -> tuple[_Field, ...]:
        """Return the fields of a message type; those of a repeated type are cached."""
        name = descriptor.full_name
        if name not in self._types:
            if len(descriptor.fields) > MAX_FIELDS:
                self._fields.leave(self.prefix, f"a message type with more than {MAX_FIELDS} fields")
            self._types[name] = tuple(map(_field, islice(descriptor.fields, MAX_FIELDS)))
        return self._types[name]


class _Message(Mapping[str, Any]):
    """A message as a structure, of which fields are read on access.

    ListFields has its fields: an attribute of a hostile name could be one of the library's.

    Parameters
    ----------
    message : of the library
    fields_of : function
        Returns the fields of a message type.
    """

    def __init__(self, message: Any, fields_of: Callable[[Any], tuple[_Field, ...]]) -> None:
        self._message, self._fields_of = message, fields_of

    def __getitem__(self, name: str) -> Any:
        return dict(self._parts())[name]

    def __iter__(self) -> Iterator[str]:
        return iter(dict(self._parts()))

    def __len__(self) -> int:
        return len(dict(self._parts()))

    def items(self) -> ItemsView[str, Any]:
        """Return names and values."""
        return dict(self._parts()).items()

    def get(self, name: str, default: Any = None) -> Any:
        """Return the value of a name; an omitted text is empty."""
        found = (
            self._nested(value) for field, value in type(self._message).ListFields(self._message) if field.name == name
        )
        return next(found, "" if _is_text(type(self._message).DESCRIPTOR.fields_by_name.get(name)) else default)

    def _parts(self) -> Iterator[tuple[str, Any]]:
        present = {field.number: value for field, value in type(self._message).ListFields(self._message)}
        for field in self._fields_of(type(self._message).DESCRIPTOR):
            value = present.get(field.number, field.implied)
            if value is None:
                continue
            if field.is_time:
                value = (value.seconds * Nanoseconds.SECOND + value.nanos) * 1e-9
            elif field.nested:
                value = self._nested(value)
            yield field.name, NoSignal(field.reason) if field.reason else value

    def _nested(self, value: Any) -> Any:
        """Return a message, or an array of these, as structures."""
        if hasattr(value, "DESCRIPTOR"):
            return _Message(value, self._fields_of)
        if isinstance(value, int | float | str | bytes):
            return value
        if len(value) > MAX_FIELDS:
            return NoSignal(f"array of {len(value)} values")
        return [_Message(one, self._fields_of) if hasattr(one, "DESCRIPTOR") else one for one in value]


def _field(one: Any) -> _Field:
    """Describe a field."""
    part = one.message_type
    is_map = part is not None and part.GetOptions().map_entry
    reason = "a map" if is_map else "bytes" if one.type == one.TYPE_BYTES else ""
    is_number = part is None and not reason and one.type != one.TYPE_STRING
    implied = 0.0 if is_number and not one.is_repeated and not one.has_presence else None
    is_time = part is not None and part.full_name in _TIMES and not one.is_repeated
    return _Field(one.name, one.number, implied, reason, is_time, part is not None and not is_map)


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
