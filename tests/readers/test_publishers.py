"""Several publishers of one topic."""

from __future__ import annotations

import numpy as np
import pytest
from random_messages import STORES
from rosbags import rosbag1
from write_logs import JOINT_STATE, MS, START, McapLog, joint_state, serialised

from vsalog.readers import bag, open_reader, read, read_within

COUNT = 40


def publications(joints, shift):
    """What two publishers send, the second one `shift` samples later: (which, time, joint, value)."""
    both = [
        (which, START + round((i + which * shift) * MS), joints[which], i + 1000 * which)
        for which in (0, 1)
        for i in range(COUNT)
    ]
    return sorted(both, key=lambda one: one[1])


def mcap(path, sent):
    log = McapLog()
    for which, time, joint, value in sent:
        log.add("/j", joint_state(time, [joint], [value]), time, again=which, metadata={"number": str(which)})
    return log.save(path)


def bag1(path, sent):
    with rosbag1.Writer(path) as writer:
        nodes = [writer.add_connection("/j", JOINT_STATE, typestore=STORES[True], callerid=f"/node{k}") for k in (0, 1)]
        for which, time, joint, value in sent:
            message = joint_state(time, [joint], [value], ros1=True)
            writer.write(nodes[which], time, serialised(message, ros1=True))
    return path


@pytest.mark.parametrize("large", [False, True])
@pytest.mark.parametrize("shift", [0, 0.5, 15])
@pytest.mark.parametrize(("write", "names"), [(mcap, "12"), (bag1, ["/node0", "/node1"])])
def test_the_same_joint_of_two_at_a_time_is_two_streams(tmp_path, monkeypatch, write, names, shift, large):
    if large:
        monkeypatch.setattr(bag, "LEAST_BYTES", 0)
    path = write(tmp_path / "log.bag", publications("aa", shift))
    for recording in (read(path), read_within(0, path).look, read(path, start=0)):
        assert set(recording.streams) == {f"/j@{name}" for name in names}
        assert sum("2 publishers give the same values" in note for note in recording.notes) == 1
    for which, name in enumerate(names):
        values = read(path, wanted=[f"/j@{name}.position[a]"]).channel(f"/j@{name}.position[a]").values
        np.testing.assert_array_equal(values, np.arange(COUNT) + 1000 * which)
    assert {info.stream for info in open_reader(path).catalogue().channels.values()} == set(recording.streams)


@pytest.mark.parametrize(("joints", "shift"), [("ab", 0), ("aa", COUNT), ("aa", COUNT - 2)])
@pytest.mark.parametrize("write", [mcap, bag1])
def test_other_joints_or_one_after_the_other_is_one_stream(tmp_path, write, joints, shift):
    recording = read(write(tmp_path / "log.bag", publications(joints, shift)))
    assert set(recording.streams) == {"/j"}
    assert not any("publishers" in note for note in recording.notes)
