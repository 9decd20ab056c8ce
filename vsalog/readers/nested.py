"""Nested values, as messages are → their numbers, each named by its path.

Values are numbers (also `Place`, where one lies in a message), texts, structures (mappings), arrays of these or `NoSignal`.
An array's elements are named by an array of texts next to it, by the field ``name`` of each, or else by their index.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

from vsalog.core.printable import LONGEST_TEXT, MAX_DEPTH, printable
from vsalog.readers.fields import LONG_NAMES, MAX_FIELDS, Fields
from vsalog.readers.limits import MAX_ARRAY

LABEL_FIELDS = ("name", "names", "joint_names", "interface_names")
BAD_NAMES = "text; some of its names are empty or repeated: their elements are named by index"
ELEMENT_NAME = "name"
"""The field that names a structure that is an element of an array."""
STAMPS: tuple[tuple[str, ...], ...] = (("header", "stamp"), ("timestamp",), ("stamp",), ("header", "timestamp"))
"""Where a message may have its time, best first."""
FRAMES: tuple[tuple[str, ...], ...] = (("header", "frame_id"), ("frame_id",))
"""Where a message may name its frame, best first."""


@dataclass(frozen=True, slots=True)
class NoSignal:
    """A description of a value that is no signal."""

    reason: str


@dataclass(slots=True)
class Place:
    """The position of a number in a message, its type, and its unit.

    `code` is a NumPy type with byte order, or that of seconds and nanoseconds, ``<i4,<u4``.
    """

    offset: int
    code: str
    unit: str | None


def part_at(value: Any, path: Sequence[str]) -> Any:
    """Return what a structure has at a path; None where it has nothing there."""
    for name in path:
        value = value.get(name) if isinstance(value, Mapping) else None
    return value


class Numbers:
    """The numbers in a structure.

    Parameters
    ----------
    value : mapping of str to nested values
        The structure.
    fields : Fields
        Collects fields that are no signal.
    passed_over : collection of str
        Full names of values that are neither signals nor reported as none.

    Attributes
    ----------
    found : dict of str to int, float or Place
        By full name.
    names : list of str
        Texts that name elements, or should do so.
    """

    def __init__(self, value: Mapping[str, Any], fields: Fields, passed_over: Collection[str]) -> None:
        self.found: dict[str, Any] = {}
        self.names: list[str] = []
        self._fields, self._passed_over = fields, passed_over
        self._left = 2 * MAX_FIELDS  # as many numbers as there may be, each in a structure of its own
        self._value(value, fields.prefix, 0)
        if self._left <= 0:
            fields.leave(fields.prefix, f"more than {2 * MAX_FIELDS} parts in a message; those beyond were left out")

    def _value(self, value: Any, path: str, depth: int) -> None:
        self._left -= 1
        if isinstance(value, int | float | Place):
            self.found[path] = value
        elif isinstance(value, str):
            self._fields.leave(path, "text")
        elif isinstance(value, NoSignal):
            self._fields.leave(path, value.reason)
        elif depth >= MAX_DEPTH:
            self._fields.leave(path, f"nested more than {MAX_DEPTH} deep")
        elif isinstance(value, Mapping):
            self._structure(value, path, depth)
        elif isinstance(value, Sequence):
            self._array(value, path, None, depth)

    def _structure(self, value: Mapping[str, Any], path: str, depth: int) -> None:
        known = list(islice(value.items(), max(self._left, 0)))
        parts = {name: part for name, part in known if len(name) <= LONGEST_TEXT}
        if len(parts) < len(known):
            self._fields.leave(path, LONG_NAMES)
        arrays = {name: part for name, part in parts.items() if _is_array(part)}
        texts = _naming_texts(arrays)
        counts = {len(part) for name, part in arrays.items() if name not in texts} if texts else ()
        naming = {count: best_label_field(texts, count) for count in counts}
        for name, part in parts.items():
            if self._left <= 0:
                return
            here = f"{path}.{printable(name)}"
            if here in self._passed_over:
                continue
            if name not in arrays:
                self._value(part, here, depth + 1)
            elif name not in texts:
                key = naming.get(len(part))
                self._array(part, here, labels_of(texts[key]) if key else None, depth)
            else:
                if len(part) in counts:
                    self.names += part
                if name in LABEL_FIELDS and not usable_labels(texts[name]):
                    self._fields.leave(here, BAD_NAMES)
                elif name not in naming.values():
                    self._fields.leave(here, "text")

    def _array(self, parts: Sequence[Any], path: str, labels: list[str] | None, depth: int) -> None:
        self._left -= 1
        labels = labels or self._own_names(parts)
        if not labels and len(parts) > MAX_ARRAY:
            self._fields.leave(path, f"array of {len(parts)} values")
            return
        for i, part in enumerate(parts):
            if self._left <= 0:
                return
            self._value(part, f"{path}[{labels[i] if labels else i}]", depth + 1)

    def _own_names(self, parts: Sequence[Any]) -> list[str]:
        """Return the names in the elements; none where these are not unique."""
        if not 0 < len(parts) <= MAX_FIELDS or not isinstance(parts[0], Mapping):
            return []
        names = [part_at(part, (ELEMENT_NAME,)) for part in parts]
        if not all(isinstance(name, str) for name in names):
            return []
        self.names += names
        return labels_of([printable(name) for name in names])


def usable_labels(labels: list[str]) -> bool:
    """Return whether texts can name the elements of an array: none empty or very long, all different."""
    if not 0 < len(labels) <= MAX_FIELDS or "" in labels or len(set(labels)) < len(labels):
        return False
    return max(map(len, labels)) <= LONGEST_TEXT


def labels_of(names: list[str]) -> list[str]:
    """Return the labels of elements: their names, or their index where a name is empty or repeated; [] where none has a name."""
    often = Counter(names)
    good = [bool(name) and often[name] == 1 and len(name) <= LONGEST_TEXT for name in names]
    labels = [name if is_good else str(i) for i, (name, is_good) in enumerate(zip(names, good, strict=True))]
    return labels if any(good) and usable_labels(labels) else []


def best_label_field(fields: dict[str, list[str]], count: int) -> str | None:
    """Return which array of texts names the elements, or some of them, of an array of `count` values, or None."""
    fitting = [name for name, labels in fields.items() if len(labels) == count]
    usable = [name for name in fitting if usable_labels(fields[name])]
    usual = [name for name in LABEL_FIELDS if name in fitting]
    preferred = (
        [name for name in usual if name in usable] + usable + [name for name in usual if labels_of(fields[name])]
    )
    return next(iter(preferred), None)


def _naming_texts(arrays: Mapping[str, Sequence[Any]]) -> dict[str, list[str]]:
    """Return those arrays, by name, whose texts may name elements of others: not too many of them."""
    fitting = (
        (name, texts)
        for name, texts in arrays.items()
        if 0 < len(texts) <= MAX_FIELDS and all(isinstance(text, str) for text in texts)
    )
    return {name: [printable(text) for text in texts] for name, texts in islice(fitting, MAX_ARRAY)}


def _is_array(part: Any) -> bool:
    # The first question is the fast one.
    return not isinstance(part, float | int | str | dict | bytes | Place) and isinstance(part, Sequence)
