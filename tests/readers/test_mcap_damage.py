"""Damaged records of MCAP files that lead astray."""

from __future__ import annotations

import struct

import numpy as np
import pytest
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
