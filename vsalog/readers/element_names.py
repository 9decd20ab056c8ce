"""Texts in messages that name the elements of arrays: an array of texts beside them, or a field of each element."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable
from itertools import islice

from vsalog.core.printable import LONGEST_TEXT, printable
from vsalog.readers.fields import MAX_FIELDS
from vsalog.readers.limits import MAX_ARRAY
from vsalog.readers.message_definitions import Node, Struct, Text

LABEL_FIELDS = ("name", "names", "joint_names", "interface_names")
BAD_NAMES = "text; some of its names are empty or there twice: what they name goes by its index"
ELEMENT_NAME = "name"
"""The field by which a message that is an element of an array tells which one it is."""


def usable_labels(labels: list[str]) -> bool:
    """Tell whether texts can name the elements of an array: none empty or very long, all different."""
    if not 0 < len(labels) <= MAX_FIELDS or "" in labels or len(set(labels)) < len(labels):
        return False
    return max(map(len, labels)) <= LONGEST_TEXT


def naming_texts(arrays: Iterable[tuple[str, Collection[str]]]) -> dict[str, list[str]]:
    """Return those arrays of texts, by name, that may name elements of others: not too many, none too long."""
    short = ((name, texts) for name, texts in arrays if len(texts) <= MAX_FIELDS)
    return {name: [printable(text) for text in texts] for name, texts in islice(short, MAX_ARRAY)}


def tells_its_name(node: Node) -> bool:
    """Tell whether elements of a type have names of their own."""
    return isinstance(node, Struct) and any(f == ELEMENT_NAME and isinstance(child, Text) for f, child in node.fields)


def labels_of(names: list[str]) -> list[str]:
    """Return what elements go by: their names, or their index where a name is empty or there twice; [] where none has a name."""
    often = Counter(names)
    good = [bool(name) and often[name] == 1 and len(name) <= LONGEST_TEXT for name in names]
    labels = [name if is_good else str(i) for i, (name, is_good) in enumerate(zip(names, good, strict=True))]
    return labels if any(good) and usable_labels(labels) else []


def are_bad(field: str, texts: dict[str, list[str]]) -> bool:
    """Tell whether an array of texts is there to name something, and cannot wholly."""
    return field in LABEL_FIELDS and bool(texts[field]) and not usable_labels(texts[field])


def best_label_field(fields: dict[str, list[str]], count: int) -> str | None:
    """Return which array of texts names the elements, or some of them, of an array of `count` values, or None."""
    fitting = [name for name, labels in fields.items() if len(labels) == count]
    usable = [name for name in fitting if usable_labels(fields[name])]
    usual = [name for name in LABEL_FIELDS if name in fitting]
    preferred = (
        [name for name in usual if name in usable] + usable + [name for name in usual if labels_of(fields[name])]
    )
    return next(iter(preferred), None)
