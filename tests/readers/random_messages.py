"""Random ROS messages of any type, and what their numbers are, told by walking the message objects."""

from __future__ import annotations

import numpy as np
from rosbags.typesys import Stores, get_typestore

STORES = {False: get_typestore(Stores.ROS2_HUMBLE), True: get_typestore(Stores.ROS1_NOETIC)}
TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
BASIC, MESSAGE, FIXED, SEQUENCE = 1, 2, 3, 4


def text(rng, unique=""):
    return "".join(rng.choice(list("abcxyzäß _"), size=rng.integers(0, 12))) + unique


def number(rng, kind, size=None):
    if kind in ("float32", "float64"):
        return rng.standard_normal(size).astype(kind) if size is not None else float(np.float32(rng.standard_normal()))
    if kind == "bool":
        return rng.integers(0, 2, size).astype(bool) if size is not None else bool(rng.integers(0, 2))
    dtype = {"char": "uint8", "byte": "uint8", "octet": "uint8"}.get(kind, kind)
    low, high = (0, 100) if dtype == "uint8" else (0, 2**6)
    return rng.integers(low, high, size).astype(dtype) if size is not None else int(rng.integers(low, high))


def make(rng, store, name, depth=0):
    values = []
    for field, (kind, detail) in store.fielddefs[name][1]:
        if int(kind) == BASIC:
            values.append(text(rng) if detail[0] == "string" else number(rng, detail[0]))
        elif int(kind) == MESSAGE:
            values.append(make(rng, store, detail, depth + 1))
        else:
            (sub, what), count = detail
            size = count if int(kind) == FIXED else int(rng.integers(0, min(count or 4, 4) + 1))
            if int(sub) == BASIC and what[0] == "string":
                values.append([text(rng, f"{field}{i}") for i in range(size)])
            elif int(sub) == BASIC:
                values.append(number(rng, what[0], size))
            else:
                values.append([make(rng, store, what, depth + 1) for _ in range(size)])
    return store.types[name](*values)


def numbers(store, message, name, path=""):
    """Return path → value of every number in a message; elements are named by index."""
    found = {}
    for field, (kind, detail) in store.fielddefs[name][1]:
        if field == "structure_needs_at_least_one_member":
            continue
        value = getattr(message, field, None)
        if value is None:
            value = getattr(message, field + "_")  # a Python keyword
        here = f"{path}.{field}" if path else field
        if int(kind) == BASIC:
            if detail[0] != "string":
                found[here] = float(value)
        elif int(kind) == MESSAGE:
            found.update(part(store, value, detail, here))
        else:
            (sub, what), _ = detail
            if int(sub) == BASIC and what[0] == "string":
                continue
            labels = labels_for(store, message, name, len(value))
            if len(value) > 64 and labels is None:
                continue
            for i, element in enumerate(value):
                at = f"{here}[{labels[i] if labels else i}]"
                if int(sub) == BASIC:
                    found[at] = float(element)
                else:
                    found.update(part(store, element, what, at))
    return found


def part(store, value, name, path):
    if name in TIMES:
        return {path: value.sec + value.nanosec * 1e-9} if path not in ("header.stamp", "stamp") else {}
    return numbers(store, value, name, path)


def labels_for(store, message, name, count):
    """Return the texts of the array of texts with as many elements, the usual names first."""
    usual = ("name", "names", "joint_names", "interface_names")
    texts = [
        field
        for field, (kind, detail) in store.fielddefs[name][1]
        if int(kind) in (FIXED, SEQUENCE) and int(detail[0][0]) == BASIC and detail[0][1][0] == "string"
    ]
    for field in sorted(texts, key=lambda f: (f not in usual, usual.index(f) if f in usual else 0)):
        labels = getattr(message, field)
        if len(labels) == count and count and all(labels) and len(set(labels)) == count:
            return labels
    return None


def same_number(a, b):
    return (np.isnan(a) and np.isnan(b)) or a == b or abs(a - b) <= 1e-9 * max(abs(a), abs(b))
