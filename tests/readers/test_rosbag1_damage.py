"""Damaged records within a chunk of a ROS 1 bag."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from finding_codes import codes, found
from test_bags import COUNT, write_bag1

from vsalog.readers import read
from vsalog.readers.rosbag1_scan import messages_in


@pytest.mark.parametrize("indexed", [True, False])
@pytest.mark.parametrize(("field", "byte"), [(b"op=\x02", 0), (b"op=\x02", -1), (b"conn=", 2), (b"time=", 1)])
def test_messages_behind_a_bad_record_in_a_chunk_are_read(tmp_path, field, byte, indexed):
    """The header of the fourth message is damaged: that one is lost, and none of those behind it."""
    path = write_bag1(tmp_path / "log")
    raw = bytearray(path.read_bytes())
    at = 0
    for _ in range(4):
        at = raw.index(b"op=\x02", at + 1)
    at = raw.rindex(field, 0, at + 40) if field != b"op=\x02" else at
    raw[at - 4 + byte if byte > 0 else at + (byte - 3 if byte < 0 else 0)] ^= 0x55
    path.write_bytes(raw if indexed else raw[: raw.rindex(b"op=\x05")])
    recording = read(path)
    values = recording.channel("/joint_states.position[elbow]").values
    lost = np.setdiff1d(np.arange(COUNT if indexed else values.max() + 1), values)
    np.testing.assert_array_equal(lost, [3])
    assert ("recording.messages_lost" if indexed else "recording.loss_unknown") in codes(recording)
    assert "some of its records" in found(recording, "recording.chunks_damaged")[0].evidence["where"]


@pytest.mark.parametrize("change", [-30, 30, 10**6])
def test_a_message_of_another_length_costs_no_other(tmp_path, change):
    path = write_bag1(tmp_path / "log")
    raw = bytearray(path.read_bytes())
    at = 0
    for _ in range(4):
        at = raw.index(b"op=\x02", at + 1)
    begin = raw.rindex(struct.pack("<I", 38), 0, at) + 42
    raw[begin : begin + 4] = struct.pack("<I", struct.unpack("<I", raw[begin : begin + 4])[0] + change)
    path.write_bytes(raw)
    recording = read(path)
    values = recording.channel("/joint_states.position[elbow]").values
    np.testing.assert_array_equal(np.setdiff1d(np.arange(COUNT), values), [3, 4] if change == 30 else [3])
    assert "some of its records" in found(recording, "recording.chunks_damaged")[0].evidence["where"]


def record(content, op=2, time=1):
    fields = b"conn=" + struct.pack("<I", 5), b"op=" + bytes([op]), b"time=" + struct.pack("<II", time, 0)
    head = b"".join(struct.pack("<I", len(one)) + one for one in fields)
    return struct.pack("<I", len(head)) + head + struct.pack("<I", len(content)) + content


def test_what_only_looks_like_a_message_is_none():
    """Content of a damaged record: a message that nothing follows where it ends."""
    inner = record(bytes(90))[:-30]
    data = np.frombuffer(record(b"first") + record(inner + bytes(40), op=99) + record(b"last", time=2), np.uint8)
    packet, sound, _ = messages_in(data, np.array([5]))
    assert list(packet.messages) == [b"first", b"last"]
    assert packet.log.tolist() == [10**9, 2 * 10**9]
    assert not sound
