"""JSON messages → columns of numbers."""

from __future__ import annotations

import json
from collections.abc import Collection
from functools import cache
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from vsalog.core.printable import LONGEST_TEXT, MAX_DEPTH, printable
from vsalog.readers.fields import LARGE_MESSAGES, LONG_NAMES, MAX_FIELDS, Fields
from vsalog.readers.frames import stated_frames
from vsalog.readers.labels import BAD_NAMES, ELEMENT_NAME, are_bad, best_label_field, labels_of, naming_texts
from vsalog.readers.limits import DECODED_BYTES, MAX_ARRAY
from vsalog.readers.messages import Decoded
from vsalog.readers.packets import Messages
from vsalog.readers.reach import Nanoseconds, Stamp

if TYPE_CHECKING:
    import msgspec


_FRAME = b"frame_id"


class JsonDecoder:
    """Decodes JSON objects: every number in them is a channel, named by its path.

    ``header.stamp`` or ``timestamp`` with the members ``sec`` and ``nanosec`` (or ``nsec``) is the header's time stamp.

    Parameters
    ----------
    prefix : str
        Name of the stream, ahead of every channel's name.
    wanted : collection of str or None
        Channels to decode; None is all of them.
    """

    misfit = ("are no JSON objects", "is a JSON object")
    framed = True

    def __init__(self, prefix: str, wanted: Collection[str] | None) -> None:
        self.prefix = prefix
        self.stamped = True
        self._fields = Fields(prefix, wanted)
        self.unread = self._fields.unread
        self._left = 0  # parts of the message that may still be looked at

    def decode(self, messages: Messages) -> Decoded:
        """Decode a batch of messages; what is no JSON object counts as damaged."""
        import msgspec

        count = len(messages)
        result = Decoded(good=np.zeros(count, dtype=bool))
        decoder = msgspec.json.Decoder()
        for i, raw in enumerate(messages):
            if len(raw) > DECODED_BYTES:
                self._fields.leave(self.prefix, LARGE_MESSAGES)
                continue
            message = _loaded(decoder, raw)
            if message is not None:
                self._message(message, i, count, result)
        return result

    def frames(self, messages: Messages) -> Messages:
        """Return ``header.frame_id``, or else ``frame_id``, of messages, as text; length -1 where they have none."""
        return stated_frames([_frame(raw) if _FRAME in raw and len(raw) <= DECODED_BYTES else None for raw in messages])

    def _message(self, message: dict[str, Any], row: int, count: int, result: Decoded) -> None:
        result.good[row] = True
        stamp = _header_stamp(message)
        if stamp is not None:
            if result.stamps is None:
                result.stamps = np.zeros(count, dtype=np.int64)
            result.stamps[row] = stamp
        found: dict[str, float] = {}
        self._left = 2 * MAX_FIELDS  # as many numbers as there may be, each in a structure of its own
        self._flatten(message, self.prefix, found, 0)
        if self._left <= 0:
            self._fields.leave(
                self.prefix, f"more than {2 * MAX_FIELDS} parts in a message; those beyond were left out"
            )
        result.put(row, found, self._fields)

    def _flatten(self, value: Any, path: str, found: dict[str, float], depth: int) -> None:
        """Collect the numbers below `value` in `found`, by path."""
        self._left -= 1
        if isinstance(value, bool | int | float):
            try:
                found[path] = float(value)
            except OverflowError:
                self._fields.leave(path, "integer beyond the range of numbers")
        elif isinstance(value, str):
            self._fields.leave(path, "text")
        elif depth >= MAX_DEPTH:
            self._fields.leave(path, f"nested more than {MAX_DEPTH} deep")
        elif isinstance(value, dict):
            self._flatten_object(value, path, found, depth)
        elif isinstance(value, list):
            self._flatten_list(value, path, None, found, depth)

    def _flatten_object(self, value: dict[str, Any], path: str, found: dict[str, float], depth: int) -> None:
        members = {key: child for key, child in islice(value.items(), self._left) if len(key) <= LONGEST_TEXT}
        if len(members) < min(len(value), self._left):
            self._fields.leave(path, LONG_NAMES)
        texts = naming_texts((key, child) for key, child in members.items() if _is_texts(child))
        for key, child in members.items():
            if self._left <= 0:
                return
            child_path = f"{path}.{printable(key)}"
            if depth == 0 and _is_stamp_member(key, child):
                continue
            if isinstance(child, list) and key not in texts:
                label_field = best_label_field(texts, len(child))
                labels = labels_of(texts[label_field]) if label_field else None
                self._flatten_list(child, child_path, labels, found, depth)
            elif key in texts:
                if are_bad(key, texts):
                    self._fields.leave(child_path, BAD_NAMES)
            else:
                self._flatten(child, child_path, found, depth + 1)

    def _flatten_list(
        self, value: list[Any], path: str, labels: list[str] | None, found: dict[str, float], depth: int
    ) -> None:
        self._left -= 1
        labels = labels or _own_names(value)
        if labels is None and len(value) > MAX_ARRAY:
            self._fields.leave(path, f"array of {len(value)} values")
            return
        for i, child in enumerate(value):
            if self._left <= 0:
                return
            self._flatten(child, f"{path}[{labels[i] if labels else i}]", found, depth + 1)


def _is_texts(value: Any) -> bool:
    """Tell whether a member is an array of texts, short enough to name something."""
    return isinstance(value, list) and 0 < len(value) <= MAX_FIELDS and all(isinstance(text, str) for text in value)


def _own_names(value: list[Any]) -> list[str] | None:
    """Return the names that the elements of a list have themselves, None where these do not tell them apart."""
    if len(value) > MAX_FIELDS:
        return None
    names = [child.get(ELEMENT_NAME) if isinstance(child, dict) else None for child in value]
    texts = [printable(name) for name in names if isinstance(name, str)]
    return (labels_of(texts) if len(texts) == len(names) else []) or None


def _loaded(decoder: msgspec.json.Decoder[Any], raw: bytes) -> dict[str, Any] | None:
    """Return the object that a message is, or None."""
    import msgspec

    try:
        message = decoder.decode(raw)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        message = _leniently(raw)
    return message if isinstance(message, dict) else None


def _frame(raw: bytes) -> object:
    """Return the frame that a message names, or something that is no text."""
    import msgspec

    try:
        found = _frame_decoder().decode(raw)
        return found.frame_id if found.header is None else found.header.frame_id
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
        pass  # of other members by these names
    message = _loaded(msgspec.json.Decoder(), raw)
    header = None if message is None else message.get("header")
    return None if message is None else (header if isinstance(header, dict) else message).get("frame_id")


@cache
def _frame_decoder() -> msgspec.json.Decoder[Any]:
    """Return what decodes nothing of a message but its frame, which is several times as fast."""
    import msgspec

    header = msgspec.defstruct("Header", [("frame_id", str | None, None)])
    return msgspec.json.Decoder(
        msgspec.defstruct("Framed", [("header", header | None, None), ("frame_id", str | None, None)])
    )


def _leniently(raw: bytes) -> Any:
    """Return what is in a message as Python reads it, NaN, numbers beyond infinity and halves of characters too, or None."""
    try:
        return json.loads(raw)
    except (ValueError, RecursionError):
        return None


def _header_stamp(message: dict[str, Any]) -> int | None:
    """Return the header's time stamp [ns], or None."""
    header = message.get("header")
    for candidate in (header.get("stamp") if isinstance(header, dict) else None, message.get("timestamp")):
        stamp = _stamp(candidate)
        if stamp is not None:
            return stamp
    return None


def _stamp(value: Any) -> int | None:
    if not isinstance(value, dict):
        return None
    seconds = value.get("sec", value.get("secs"))
    fraction = value.get("nanosec", value.get("nsec", value.get("nsecs")))
    if not isinstance(seconds, int) or not isinstance(fraction, int):
        return None
    stamp = seconds * Nanoseconds.SECOND + fraction
    return stamp if 0 <= fraction < Nanoseconds.SECOND and abs(stamp) < Stamp.FARTHEST else Stamp.NEVER


def _is_stamp_member(key: str, child: Any) -> bool:
    """Tell whether a member of the message is its clock, which is no channel."""
    if key == "timestamp":
        return _stamp(child) is not None
    return key == "header" and isinstance(child, dict) and _stamp(child.get("stamp")) is not None
