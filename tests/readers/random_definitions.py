"""Random message definitions, as ROS 1 text, ROS 2 text and IDL, and the library's types made of the ROS text."""

from __future__ import annotations

from dataclasses import dataclass

from hypothesis import strategies as st
from random_messages import STORES
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

RULE = "=" * 80
NUMBERS = (
    "bool", "byte", "char", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64", "float32", "float64",
)  # fmt: skip
IDL = {
    "bool": "boolean", "byte": "octet", "char": "uint8", "float32": "float", "float64": "double", "int16": "short",
    "int32": "long", "int64": "long long", "uint16": "unsigned short", "uint32": "unsigned long",
    "uint64": "unsigned long long",
}  # fmt: skip
BUILTIN = {
    "time": "builtin_interfaces/msg/Time",
    "duration": "builtin_interfaces/msg/Duration",
    "header": "std_msgs/msg/Header",
}


@dataclass(frozen=True)
class FieldOf:
    """A field: of a kind (a number, string, key of `BUILTIN` or other type), alone or an array of one `shape`."""

    name: str
    kind: str
    shape: str = ""  # "", "3", "<=3" or "*"

    def ros(self, ros1):
        kind = {"header": "std_msgs/Header"}.get(self.kind, self.kind)
        if not ros1:
            kind = {"time": "builtin_interfaces/Time", "duration": "builtin_interfaces/Duration"}.get(kind, kind)
        shape = "" if self.shape == "*" or (ros1 and "<" in self.shape) else self.shape
        return f"{kind}[{shape}] {self.name}" if self.shape else f"{kind} {self.name}"

    def idl(self):
        kind = BUILTIN.get(self.kind, self.kind)
        kind = IDL.get(kind, kind.replace("a/T", "a/msg/T").replace("/", "::"))
        if self.shape.isdigit():
            return f"{kind} {self.name}[{self.shape}];"
        if self.shape:
            kind = f"sequence<{kind}{self.shape.replace('<=', ', ').replace('*', '')}>"
        return f"{kind} {self.name};"


@dataclass(frozen=True)
class Definition:
    """Types ``a/T0``, which is the message's, ``a/T1`` …, each with its fields."""

    types: tuple[tuple[FieldOf, ...], ...]

    def ros(self, ros1):
        parts = ["".join(field.ros(ros1) + "\n" for field in fields) for fields in self.types]
        return f"{RULE}\nMSG: a/T".join([parts[0], *(f"{i}\n{part}" for i, part in enumerate(parts[1:], 1))])

    def idl(self):
        return "".join(
            f"{RULE}\nIDL: a/msg/T{i}\nmodule a {{ module msg {{ struct T{i} {{\n"
            + "\n".join(field.idl() for field in fields)
            + "\n};\n};\n};\n"
            for i, fields in reversed(list(enumerate(self.types)))
        )

    def store(self, ros1):
        """Return the library's types, which it makes of the ROS text."""
        store = get_typestore(Stores.EMPTY)
        store.register({name: STORES[ros1].fielddefs[name] for name in BUILTIN.values()})
        store.register(get_types_from_msg(self.ros(ros1), "a/msg/T0"))
        return store


@st.composite
def definitions(draw):
    """Draw a definition of up to four types, of which each may hold those behind it."""
    count = draw(st.integers(1, 4))
    types = []
    for i in range(count):
        others = [f"a/T{k}" for k in range(i + 1, count)]
        kind = st.sampled_from([*NUMBERS, "string", "time", "duration", *others, *others])
        shape = st.sampled_from(["", "", "", "1", "3", "70", "<=3", "*", "*"])
        fields = draw(st.lists(st.tuples(kind, shape), min_size=1, max_size=6))
        named = [FieldOf(f"f{k}", *field) for k, field in enumerate(fields)]
        if i == 0 and draw(st.booleans()):
            named.insert(0, FieldOf("header", "header"))
        if draw(st.integers(0, 3)) == 0:
            named.insert(draw(st.integers(0, len(named))), FieldOf("name", "string", "*"))
        types.append(tuple(named))
    return Definition(tuple(types))
