"""Encodings and types that ROS 2 can write and that are not read: they are reported by name, and left out."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from finding_codes import values_of
from write_logs import MS, START, McapLog

from vsalog.readers import read
from vsalog.readers.message_definitions import DefinitionError, Scalar, parse_definition

IDL = "module a {{ module msg {{ struct T {{ {} }}; }}; }};"
# Of struct { double x; long n; }, by the DDS specification: with a length ahead, or each member behind its number.
PLAIN = struct.pack("<di", 1.5, 7)
BODIES = {
    0x02: ("PL_CDR", PLAIN),
    0x03: ("PL_CDR", struct.pack("<HHd", 1, 8, 1.5) + struct.pack("<HHi", 2, 4, 7) + struct.pack("<HH", 1, 0)),
    0x04: ("XML", b"<x>1.5</x>"),
    0x06: ("XCDR2", struct.pack(">di", 1.5, 7)),
    0x07: ("XCDR2", PLAIN),
    0x08: ("D_CDR2", struct.pack(">Idi", 12, 1.5, 7)),
    0x09: ("D_CDR2", struct.pack("<Idi", 12, 1.5, 7)),
    0x0A: ("PL_CDR2", PLAIN),
    0x0B: ("PL_CDR2", struct.pack("<IIdIi", 24, 3 << 28 | 1, 1.5, 2 << 28 | 2, 7)),
}


@pytest.mark.parametrize("kind", BODIES)
@pytest.mark.parametrize("count", [1, 100])
def test_other_encodings_are_refused_by_their_names(tmp_path, kind, count):
    name, body = BODIES[kind]
    log = McapLog()
    channel = log.channel("/t", "a/msg/T", text="float64 x\nint32 n\n")
    for i in range(count):
        log.raw(channel, bytes([0, kind, 0, 0]) + body, START + i * MS)
    recording = read(log.save(tmp_path / "log"))
    assert not recording.channels
    assert f"encoded as {name} (0x{kind:04x})" in recording.unread["/t"]


def test_messages_of_two_encodings(tmp_path):
    log = McapLog()
    channel = log.channel("/t", "a/msg/T", text="float64 x\nint32 n\n")
    for i in range(100):
        log.raw(channel, bytes([0, 7 if i % 10 == 0 else 1, 0, 0]) + PLAIN, START + i * MS)
    recording = read(log.save(tmp_path / "log"))
    np.testing.assert_array_equal(recording.channel("/t.x").values, [1.5] * 90)
    assert "XCDR2" in recording.unread["/t"]
    assert values_of(recording, "recording.messages_damaged") == [10]


@pytest.mark.parametrize(
    ("language", "text", "words"),
    [
        ("msg", "wstring s\nfloat64 x\n", "type wstring"),
        ("msg", "float64 x\n wstring<=10 s\n", "type wstring"),
        ("msg", "wstring[] s\n", "type wstring"),
        ("idl", IDL.format("wstring s; double x;"), "type wstring"),
        ("idl", IDL.format("double x; sequence<wstring<5>> s;"), "type wstring"),
        ("idl", IDL.format("wchar c;"), "type wchar"),
        ("idl", IDL.format("long c; @optional double x;"), "optional"),
        ("idl", IDL.format("@optional(TRUE) double x;"), "optional"),
    ],
)
def test_types_that_are_refused_by_their_names(language, text, words):
    with pytest.raises(DefinitionError, match=words):
        parse_definition("a/msg/T", text, language, False)


@pytest.mark.parametrize(
    ("language", "text"),
    [
        ("msg", "# no wstring\nfloat64 x # wstring\n"),
        ("msg", "float64 x\nstring W='wstring'\n"),
        ("idl", IDL.format("/* wstring\n@optional */ double x; // @optional wchar\n")),
        ("idl", IDL.format('@verbatim (language="comment", text="an @optional wstring") double x;')),
    ],
)
def test_remarks_on_these_types_do_not_matter(language, text):
    assert parse_definition("a/msg/T", text, language, False).fields == (("x", Scalar("f8", 8)),)
