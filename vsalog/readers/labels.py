"""Texts in messages that name the elements of arrays: an array of texts beside them, or a field of each element."""

from __future__ import annotations

from collections import Counter

from vsalog.readers.definitions import Node, Struct, Text

LABEL_FIELDS = ("name", "names", "joint_names", "interface_names")
BAD_NAMES = "text; some of its names are empty or there twice: what they name goes by its index"
ELEMENT_NAME = "name"
"""The field by which a message that is an element of an array tells which one it is."""
MAX_LABELS = 1024


def usable_labels(labels: list[str]) -> bool:
    """Tell whether texts can name the elements of an array: none empty, all different."""
    return 0 < len(labels) <= MAX_LABELS and "" not in labels and len(set(labels)) == len(labels)


def tells_its_name(node: Node) -> bool:
    """Tell whether elements of a type have names of their own."""
    return isinstance(node, Struct) and any(f == ELEMENT_NAME and isinstance(child, Text) for f, child in node.fields)


def labels_of(names: list[str]) -> list[str]:
    """Return what elements go by: their names, or their index where a name is empty or there twice; [] where none has a name."""
    often = Counter(names)
    labels = [name if name and often[name] == 1 else str(i) for i, name in enumerate(names)]
    some = any(name and often[name] == 1 for name in names)
    return labels if some and usable_labels(labels) else []


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
