"""Whole records that were cut out of a ROS 1 bag: nothing is damaged then, and yet what is missing is reported."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_bags import COUNT, write_bag1

from vsalog.core.errors import ReadError
from vsalog.readers import read


@pytest.fixture(scope="module")
def pieces(tmp_path_factory):
    """The bag's magic with its header, and its records, each by itself."""
    raw = write_bag1(tmp_path_factory.mktemp("log") / "log", chunk_threshold=1024).read_bytes()
    cuts = [len(b"#ROSBAG V2.0\n")]
    while cuts[-1] < len(raw):
        at = cuts[-1]
        for _ in range(2):  # head and content
            at += 4 + int.from_bytes(raw[at : at + 4], "little")
        cuts.append(at)
    assert cuts[-1] == len(raw)
    records = [raw[a:b] for a, b in pairwise(cuts)]
    assert sum(b"op=\x05" in record[:100] for record in records) > 5
    return raw[: cuts[1]], records[1:]


@given(data=st.data())
def test_no_message_goes_without_a_word(pieces, tmp_path_factory, data):
    first, records = pieces
    size = len(records)
    cut = data.draw(st.sets(st.integers(0, size - 1), min_size=1, max_size=4))
    path = tmp_path_factory.mktemp("cut") / "log.bag"
    path.write_bytes(first + b"".join(record for k, record in enumerate(records) if k not in cut))
    try:
        recording = read(path)
    except ReadError:
        return
    channel = recording.channels.get("/joint_states.position[elbow]")
    values = np.zeros(0) if channel is None else channel.values
    assert np.all(np.diff(values) > 0.0)
    assert recording.findings or len(values) == COUNT
