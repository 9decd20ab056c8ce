"""Damaged records of MCAP files that lead astray."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from finding_codes import found
from hypothesis import given
from hypothesis import strategies as st
from mcap.opcode import Opcode
from mcap.writer import CompressionType
from write_logs import MS, START, joints_mcap

from vsalog.readers import read


@pytest.mark.parametrize("whole", [True, False])
@pytest.mark.parametrize("place", [0, 1, 4, 8, 36, 37, 41, 45, 48, 57])
def test_no_message_of_a_chunk_with_a_damaged_head_is_taken_unverified(tmp_path, place, whole):
    """Of the first chunk, ahead of which nothing tells that the file has chunks; one of its values is damaged, too."""
    path = joints_mcap(tmp_path / "log", compression=CompressionType.NONE, chunk_size=2048)
    raw = bytearray(path.read_bytes())
    (begin, *_) = chunks = [
        i for i in range(len(raw)) if raw[i] == 6 and raw[i + 37 : i + 41] == bytes(4) and raw[i + 8] == 0
    ]
    raw[begin + place] ^= 0x10
    value = raw.index(struct.pack("<d", 5.0), begin)
    assert value < chunks[1]
    raw[value + 6] ^= 0x10
    path.write_bytes(raw if whole else raw[: len(raw) // 2])
    recording = read(path)
    assert recording.findings
    if not whole:  # what tells the channels was in the first chunk
        assert not recording.channels
        return
    channel = recording.channel("/joint_states.position[elbow]")
    np.testing.assert_array_equal(channel.values, (channel.stamps - START) // MS)
    assert channel.values[0] > 5


@pytest.fixture(scope="module")
def pieces(tmp_path_factory):
    """The records of a file with several chunks, each with what follows it up to the next one, and the values of each chunk."""
    raw = joints_mcap(tmp_path_factory.mktemp("log") / "log", chunk_size=2048).read_bytes()
    cuts, at = [], 8
    while raw[at] != Opcode.DATA_END:
        if raw[at] == Opcode.CHUNK:
            cuts.append(at)
        at += 9 + int.from_bytes(raw[at + 1 : at + 9], "little")
    assert len(cuts) > 5
    return [raw[: cuts[0]], *(raw[a:b] for a, b in zip(cuts, [*cuts[1:], at], strict=True)), raw[at:]]


@given(data=st.data())
def test_chunks_that_were_cut_out_at_the_borders_of_records_are_missed(pieces, tmp_path_factory, data):
    """Nothing is damaged then; but the statistics at the end count all messages, and know all channels."""
    first, *chunks, end = pieces
    kept = data.draw(
        st.lists(st.booleans(), min_size=len(chunks), max_size=len(chunks)).filter(lambda k: any(k) and not all(k))
    )
    path = tmp_path_factory.mktemp("cut") / "log.mcap"
    path.write_bytes(first + b"".join(chunk for chunk, keep in zip(chunks, kept, strict=True) if keep) + end)
    recording = read(path)
    channel = recording.channel("/joint_states.position[elbow]")
    np.testing.assert_array_equal(channel.values, (channel.stamps - START) // MS)
    (missing,) = found(recording, "recording.messages_missing")
    assert missing.value + len(channel.values) == missing.evidence["expected"]
