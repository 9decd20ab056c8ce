"""Attachments behind damage are kept when a log is repaired."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from mcap.reader import make_reader
from write_logs import MS, START, McapLog, joint_state

from vsalog.core.errors import ReadError
from vsalog.writers.repair import repair


def chunk_positions(raw):
    found, at = [], 8
    while raw[at] != 15:
        if raw[at] == 6:
            found.append(at)
        at += 9 + struct.unpack_from("<Q", raw, at + 1)[0]
    return found


def attachments(path):
    with path.open("rb") as file:
        return [(one.name, one.data) for one in make_reader(file).iter_attachments()]


@pytest.mark.parametrize("summary", [True, False])
@pytest.mark.parametrize("damage", ["chunk", "its length", "attachment's length", "an attachment"])
def test_attachments_behind_damage(tmp_path, damage, summary):
    rng = np.random.default_rng(4)
    log = McapLog(chunk_size=2048)
    whole = []
    for i in range(300):
        log.add("/j", joint_state(START + i * MS, ["a"], [i]), START + i * MS)
        if i % 60 == 30:
            whole.append((f"photo {i}", rng.bytes(3000)))
            log.writer.add_attachment(1, 2, whole[-1][0], "image/jpeg", whole[-1][1])
    path = log.save(tmp_path / "log")
    raw = bytearray(path.read_bytes())
    first = raw.index(b"photo 30") - 9 - 16 - 4
    assert raw[first] == 9
    chunks = chunk_positions(raw)  # definitions are in the first, and at the end
    if damage == "chunk":
        raw[chunks[1] + 200] ^= 0x55
    elif damage == "its length":
        raw[chunks[1] + 3] ^= 0x55
    elif damage == "attachment's length":
        raw[first + 3] ^= 0x55
    else:
        raw[first + 500] ^= 0x55
    path.write_bytes(raw if summary else raw[: raw.rindex(b"\x0f\x04\0\0\0\0\0\0\0")])
    told = repair(path, tmp_path / "new.mcap")
    kept = attachments(tmp_path / "new.mcap")
    lost = whole[:1] if "attachment" in damage else []
    assert sorted(kept) == sorted(one for one in whole if one not in lost)
    assert told.messages > 200
    assert told.findings


@pytest.mark.parametrize("what", ["attachment", "metadata"])
def test_a_file_without_messages_may_hold_something_else(tmp_path, what):
    log = McapLog()
    if what == "attachment":
        log.writer.add_attachment(1, 2, "photo", "image/jpeg", b"0123")
    else:
        log.writer.add_metadata("operator", {"name": "a"})
    raw = log.save(tmp_path / "log").read_bytes()
    (tmp_path / "log").write_bytes(raw[: raw.rindex(b"\x0f\x04\0\0\0\0\0\0\0")])
    told = repair(tmp_path / "log", tmp_path / "new.mcap")
    assert told.messages == 0
    with (tmp_path / "new.mcap").open("rb") as file:
        reader = make_reader(file)
        kept = [*reader.iter_attachments()] if what == "attachment" else [*reader.iter_metadata()]
    assert [one.name for one in kept] == ["photo" if what == "attachment" else "operator"]


def test_a_file_that_holds_nothing_is_refused(tmp_path):
    path = McapLog().save(tmp_path / "log")
    with pytest.raises(ReadError, match="none of its messages"):
        repair(path, tmp_path / "new.mcap")
    assert not (tmp_path / "new.mcap").exists()
