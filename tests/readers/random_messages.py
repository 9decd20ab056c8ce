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
    """Return a number of a kind, or an array of them, of any bits that it can have."""
    dtype = np.dtype({"char": "uint8", "byte": "uint8", "octet": "uint8"}.get(kind, kind))
    if kind in ("byte", "octet"):  # the library takes one for signed, arrays of them for unsigned
        values = rng.integers(0, 128, size or 1).astype(dtype)
    elif kind == "bool":
        values = rng.integers(0, 2, size or 1).astype(bool)
    else:
        values = np.frombuffer(rng.bytes((size or 1) * dtype.itemsize), dtype).copy()
        if dtype.kind == "f" and rng.integers(0, 2):
            values[:] = rng.standard_normal(values.size)
    if size is not None:
        return values[:size]
    return values[0].item()


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
                alike = bool(
                    rng.integers(0, 2)
                )  # in length, as names that change places without a trace in the lengths
                values.append([f"{field}{i}" if alike else text(rng, f"{field}{i}") for i in range(size)])
            elif int(sub) == BASIC:
                values.append(number(rng, what[0], size))
            else:
                values.append([make(rng, store, what, depth + 1) for _ in range(size)])
    return store.types[name](*values)


def vary(rng, store, message, name):
    """Return a message of the same shape with other numbers; texts in arrays may change places."""
    values = []
    for field, (kind, detail) in store.fielddefs[name][1]:
        value = getattr(message, field, None)
        value = getattr(message, field + "_") if value is None else value  # a Python keyword
        if int(kind) == MESSAGE:
            value = vary(rng, store, value, detail)
        elif int(kind) == BASIC:
            value = value if detail[0] == "string" else number(rng, detail[0])
        elif int(detail[0][0]) == MESSAGE:
            value = [vary(rng, store, one, detail[0][1]) for one in value]
        elif detail[0][1][0] == "string":
            value = [str(one) for one in rng.permutation(value)] if rng.integers(0, 2) else value
        else:
            value = number(rng, detail[0][1][0], len(value))
        values.append(value)
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
                found[here] = _float(store, value, detail[0])
        elif int(kind) == MESSAGE:
            found.update(part(store, value, detail, here))
        else:
            (sub, what), _ = detail
            if int(sub) == BASIC and what[0] == "string":
                continue
            labels = labels_for(store, message, name, len(value)) or own_names(store, value, sub, what)
            if len(value) > 64 and labels is None:
                continue
            for i, element in enumerate(value):
                at = f"{here}[{labels[i] if labels else i}]"
                if int(sub) == BASIC:
                    found[at] = _float(store, element, what[0])
                else:
                    found.update(part(store, element, what, at))
    return found


def _float(store, value, kind):
    """Return a number; a byte is signed in ROS 1 and unsigned in ROS 2, which the library mixes up."""
    if kind in ("byte", "octet"):
        return float(int(value) % 256 - 256 * (_is_ros1(store) and int(value) % 256 > 127))
    return float(value)


def _is_ros1(store):
    return store.fielddefs["std_msgs/msg/Header"][1][0][0] == "seq"


def nanoseconds(store, value, name=TIMES[0]):
    """Return a time or a duration; the library takes those of ROS 1 for those of ROS 2, which have other signs."""
    seconds, fraction = value.sec, value.nanosec
    if _is_ros1(store) and name == TIMES[0]:
        seconds %= 2**32
    if _is_ros1(store) and name == TIMES[1]:
        fraction -= 2**32 * (fraction >= 2**31)
    return seconds * 10**9 + fraction


def stamp_of(store, value):
    """Return a header's time stamp; one with nanoseconds beyond a second is none, which the readers mark by this number."""
    return nanoseconds(store, value) if 0 <= value.nanosec < 10**9 else 1 - 2**62


def part(store, value, name, path):
    if name in TIMES:
        return {path: nanoseconds(store, value, name) * 1e-9} if path not in ("header.stamp", "stamp") else {}
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
    for field in usual:
        labels = getattr(message, field) if field in texts else []
        if len(labels) == count and count and (some := with_indices(labels)):
            return some
    return None


def with_indices(names):
    """Return names, those that are empty or there twice replaced by their index; None where none is left."""
    good = [bool(name) and list(names).count(name) == 1 for name in names]
    labels = [name if fine else str(i) for i, (name, fine) in enumerate(zip(names, good, strict=True))]
    return labels if any(good) and len(set(labels)) == len(labels) else None


def own_names(store, value, sub, what):
    """Return the names of the elements of an array of messages, where they separate them."""
    if (
        int(sub) != MESSAGE
        or what in TIMES
        or ("name", (BASIC, ("string", 0)))
        not in [(field, (int(kind), detail)) for field, (kind, detail) in store.fielddefs[what][1]]
    ):
        return None
    names = [element.name for element in value]
    return with_indices(names)


def same_number(a, b):
    """Tell whether two numbers are the same bit for bit, or both none."""
    return np.float64(a).tobytes() == np.float64(b).tobytes() or bool(np.isnan(a) and np.isnan(b))
