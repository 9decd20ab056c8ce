"""Texts in messages that name the elements of arrays: an array of texts beside them, or a field of each element."""

from __future__ import annotations

from vsalog.readers.definitions import Node, Struct, Text

LABEL_FIELDS = ("name", "names", "joint_names", "interface_names")
ELEMENT_NAME = "name"
"""The field by which a message that is an element of an array tells which one it is."""
MAX_LABELS = 1024


def usable_labels(labels: list[str]) -> bool:
    """Tell whether texts can name the elements of an array: none empty, all different."""
    return 0 < len(labels) <= MAX_LABELS and "" not in labels and len(set(labels)) == len(labels)


def tells_its_name(node: Node) -> bool:
    """Tell whether elements of a type have names of their own."""
    return isinstance(node, Struct) and any(f == ELEMENT_NAME and isinstance(child, Text) for f, child in node.fields)


def best_label_field(fields: dict[str, list[str]], count: int) -> str | None:
    """Return which array of texts names the elements of an array of `count` values, or None."""
    fitting = [name for name, labels in fields.items() if len(labels) == count and usable_labels(labels)]
    preferred = [name for name in LABEL_FIELDS if name in fitting]
    return next(iter(preferred or fitting), None)
