"""JSON messages → columns of numbers."""

from __future__ import annotations

import json
from collections.abc import Collection
from typing import Any

import numpy as np

from vsalog.printable import printable
from vsalog.readers.base import MAX_ARRAY
from vsalog.readers.labels import BAD_NAMES, ELEMENT_NAME, are_bad, best_label_field, labels_of
from vsalog.readers.layout import MAX_FIELDS
from vsalog.readers.messages import Decoded
from vsalog.readers.packets import Messages

MAX_DEPTH = 32


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

    def __init__(self, prefix: str, wanted: Collection[str] | None) -> None:
        self.prefix = prefix
        self.wanted = wanted
        self.unread: dict[str, str] = {}
        self.stamped = True

    def decode(self, messages: Messages) -> Decoded:
        """Decode a batch of messages; what is no JSON object counts as damaged."""
        import msgspec

        count = len(messages)
        result = Decoded(good=np.zeros(count, dtype=bool))
        decoder = msgspec.json.Decoder()
        for i, raw in enumerate(messages):
            try:
                message = decoder.decode(raw)
            except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                message = _with_nan(raw)
            if isinstance(message, dict):
                self._message(message, i, count, result)
        return result

    def _message(self, message: dict[str, Any], row: int, count: int, result: Decoded) -> None:
        result.good[row] = True
        stamp = _header_stamp(message)
        if stamp is not None:
            if result.stamps is None:
                result.stamps = np.zeros(count, dtype=np.int64)
            result.stamps[row] = stamp
        found: dict[str, float] = {}
        self._flatten(message, self.prefix, found, 0)
        if not result.put(row, found, self.wanted):
            self.unread.setdefault(self.prefix, f"more than {MAX_FIELDS} different fields")

    def _flatten(self, value: Any, path: str, found: dict[str, float], depth: int) -> None:
        """Collect the numbers below `value` in `found`, by path."""
        if isinstance(value, bool | int | float):
            try:
                found[path] = float(value)
            except OverflowError:
                self.unread[path] = "integer beyond the range of numbers"
        elif isinstance(value, str):
            self.unread.setdefault(path, "text")
        elif depth >= MAX_DEPTH:
            self.unread.setdefault(path, f"nested more than {MAX_DEPTH} deep")
        elif isinstance(value, dict):
            self._flatten_object(value, path, found, depth)
        elif isinstance(value, list):
            self._flatten_list(value, path, None, found, depth)

    def _flatten_object(self, value: dict[str, Any], path: str, found: dict[str, float], depth: int) -> None:
        texts = {
            key: [printable(text) for text in child]
            for key, child in value.items()
            if isinstance(child, list) and child and all(isinstance(text, str) for text in child)
        }
        for key, child in value.items():
            child_path = f"{path}.{printable(key)}"
            if depth == 0 and _is_stamp_member(key, child):
                continue
            if isinstance(child, list) and key not in texts:
                label_field = best_label_field(texts, len(child))
                labels = labels_of(texts[label_field]) if label_field else None
                self._flatten_list(child, child_path, labels, found, depth)
            elif key in texts:
                if are_bad(key, texts):
                    self.unread.setdefault(child_path, BAD_NAMES)
            else:
                self._flatten(child, child_path, found, depth + 1)

    def _flatten_list(
        self, value: list[Any], path: str, labels: list[str] | None, found: dict[str, float], depth: int
    ) -> None:
        labels = labels or _own_names(value)
        if labels is None and len(value) > MAX_ARRAY:
            self.unread.setdefault(path, f"array of {len(value)} values")
            return
        for i, child in enumerate(value):
            self._flatten(child, f"{path}[{labels[i] if labels else i}]", found, depth + 1)


def _own_names(value: list[Any]) -> list[str] | None:
    """Return the names that the elements of a list have themselves, None where these do not tell them apart."""
    names = [child.get(ELEMENT_NAME) if isinstance(child, dict) else None for child in value]
    texts = [printable(name) for name in names if isinstance(name, str)]
    return (labels_of(texts) if len(texts) == len(names) else []) or None


def _with_nan(raw: bytes) -> Any:
    """Return what is in a message that has the numbers NaN or Infinity, as Python writes them and JSON has none; else None."""
    if b"NaN" not in raw and b"Infinity" not in raw:
        return None
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
    stamp = seconds * 1_000_000_000 + fraction
    return stamp if abs(stamp) < 2**63 else None


def _is_stamp_member(key: str, child: Any) -> bool:
    """Tell whether a member of the message is its clock, which is no channel."""
    if key == "timestamp":
        return _stamp(child) is not None
    return key == "header" and isinstance(child, dict) and _stamp(child.get("stamp")) is not None
