"""The limits that readers share, each on both sides: what is just within it is read, what is beyond is not."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from write_logs import START, McapLog

from vsalog.core.errors import ReadError
from vsalog.core.recording import Recording
from vsalog.readers import sampling
from vsalog.readers.base import Block
from vsalog.readers.compression import DamagedDataError, refuse_bomb
from vsalog.readers.fields import Fields
from vsalog.readers.header_frames import Frames, stated_frames
from vsalog.readers.header_stamps import are_few
from vsalog.readers.json_messages import JsonDecoder
from vsalog.readers.mcap_file import McapContainer
from vsalog.readers.message_definitions import DefinitionError, parse_definition
from vsalog.readers.message_layout import TooManyPartsError, places_in
from vsalog.readers.message_reader import BagReader
from vsalog.readers.nested import NoSignal, usable_labels
from vsalog.readers.packets import Messages
from vsalog.readers.protobuf_types import message_class
from vsalog.readers.record_walk import walk_findings
from vsalog.readers.sniff import looks_like_text, sniff
from vsalog.readers.stream_samples import Gathered
from vsalog.readers.tables.dialect import detect
from vsalog.readers.tables.source import may_be_cut

MI = 2**20


def channels_of(text):
    return len(JsonDecoder("t", None).decode(Messages.of([text.encode()])).columns)


@pytest.mark.parametrize(("size", "words"), [(MI, "damaged|not complete"), (MI + 1, "are not read")])
def test_a_piece_holds_descriptors(size, words):
    with pytest.raises(DefinitionError, match=words):
        message_class("a.B", b"\xff" * size)


@pytest.mark.parametrize("text", [40_000, 65_536])
def test_a_glance_tells_text_from_others(tmp_path, text):
    path = tmp_path / "log"
    path.write_bytes((b"1,2\n" * text)[:text] + bytes(range(8)) * 8000)
    if text < 2**16:
        with pytest.raises(ReadError):
            sniff(path)
    else:
        assert sniff(path) == "table"


@pytest.mark.parametrize(
    ("compressed", "size", "good"),
    [
        (1, 16 * MI, True),
        (1, 16 * MI + 1, False),
        (20_000, 20_640_000, True),
        (20_000, 20_640_001, False),
        (256 * MI, 256 * MI, True),
        (256 * MI, 256 * MI + 1, False),
    ],
)
def test_what_unfolds_to_little_or_a_thousandfold_is_no_bomb(compressed, size, good):
    if good:
        refuse_bomb(compressed, size)
    else:
        with pytest.raises(DamagedDataError):
            refuse_bomb(compressed, size)


def test_a_block_has_8192_rows(tmp_path):
    log = McapLog(profile="", chunk_size=2**22)
    for i in range(20_000):
        log.add_json("/t", {"x": i}, START + i)
    blocks = [*BagReader(McapContainer(log.save(tmp_path / "log"))).blocks(None)]
    assert max(len(block.clocks["log"]) for block in blocks) == 8192


def test_structures_are_followed_32_deep():
    def nested(depth):
        return '{"x":' * depth + "1" + "}" * depth

    assert (channels_of(nested(32)), channels_of(nested(33))) == (1, 0)


def test_arrays_of_64_are_signals():
    assert (channels_of(f'{{"x":{[0] * 64}}}'), channels_of(f'{{"x":{[0] * 65}}}')) == (64, 0)


def test_256_frames_are_separated():
    numbers = Frames().numbers(stated_frames([f"frame_{i}" for i in range(257)]))
    assert numbers.tolist() == [*range(256), -1]


@pytest.mark.parametrize(("count", "good"), [(80_000, True), (95_000, False)])
def test_a_message_is_walked_for_262144_parts(count, good):
    """An element takes three steps: itself, its field, and the text in it."""
    root = parse_definition("a/A", f"B[] x\n{'=' * 80}\nMSG: a/B\nstring text\n", "msg", True)
    raw = struct.pack("<I", count) + bytes(4 * count)
    if good:
        assert places_in(raw, root, False)[0] == {"x": NoSignal(f"array of {count} values")}
    else:
        with pytest.raises(TooManyPartsError):
            places_in(raw, root, False)


def test_256_lines_tell_what_columns_are():
    assert len(detect(b"time,x\n" + b"0.1,2\n" * 1000, True).rows) == 255


@pytest.mark.parametrize(("ahead", "found"), [(32, True), (33, False)])
def test_32_rows_may_be_ahead_of_a_header(ahead, found):
    text = "".join(f"{i},{i}.5\n" for i in range(ahead)) + "time,pos\n" + "".join(f"{i},{i}.5\n" for i in range(100))
    assert (detect(text.encode(), True).names == ("time", "pos")) is found


def test_10_rows_show_a_pattern():
    assert may_be_cut(["1,2.50"] * 10, "1,2.5", ",")
    assert not may_be_cut(["1,2.50"] * 9, "1,2.5", ",")


def test_three_places_are_shown():
    (found,) = walk_findings([(k, k + 1) for k in range(4)], None)
    assert found.evidence["where"] == "0, 1, 2, …"


def test_texts_that_name_elements():
    assert usable_labels([str(i) for i in range(4096)])
    assert not usable_labels([str(i) for i in range(4097)])
    assert usable_labels(["x" * 256])
    assert not usable_labels(["x" * 257])


def test_a_stream_has_4096_channels():
    fields = Fields("t", None)
    assert [fields.take(f"t.{i}") for i in range(4097)] == [True] * 4096 + [False]


@pytest.mark.parametrize(("size", "good"), [(2**18, True), (2**18 + 1, False)])
def test_a_definition_has_262144_characters(size, good):
    text = "float64 x\n".ljust(size, "#")
    if good:
        assert len(parse_definition("a/A", text, "msg", False).fields) == 1
    else:
        with pytest.raises(DefinitionError):
            parse_definition("a/A", text, "msg", False)


def test_one_stamp_in_twenty_may_be_none():
    assert (are_few(1, 20), are_few(1, 19), are_few(0, 20)) == (True, False, False)
    assert np.all([are_few(k, 100) for k in range(1, 6)])


@pytest.mark.parametrize(("zeros", "text"), [(4, True), (5, False)])
def test_a_thousandth_of_a_text_may_have_become_zero(zeros, text):
    assert looks_like_text(b"1,2\n" * 999 + bytes(zeros)) is text


@pytest.mark.parametrize(("size", "good"), [(4 * MI, True), (4 * MI + 1, False)])
def test_a_message_of_4_mebibytes_becomes_objects(size, good):
    decoded = JsonDecoder("t", None).decode(Messages.of([b'{"x":1}'.ljust(size)]))
    assert (decoded.good.tolist(), len(decoded.columns)) == (([True], 1) if good else ([False], 0))


def test_memory_is_taken_for_33554432_samples_ahead_of_them():
    gathered = Gathered("t")
    gathered.add(Block("/t", "t", {"log": np.zeros(1, np.int64)}, {"x": np.zeros(1)}, expected=2**40))
    whole = gathered.columns["x"].so_far().base
    assert whole is not None
    assert whole.size == 33_554_432


@pytest.mark.parametrize(("size", "cut"), [(64 * MI - 1, []), (64 * MI, [32 * MI])])
def test_of_a_log_of_64_mebibytes_half_is_looked_at(tmp_path, monkeypatch, size, cut):
    path, asked = tmp_path / "log.csv", []
    path.write_bytes(b"t,x\n" + b"0.1,1\n0.2,2\n" * 1000)
    with path.open("r+b") as file:
        file.truncate(size)
    monkeypatch.setitem(sampling.CUTTERS, "table", lambda whole, small, most: asked.append(most))
    monkeypatch.setattr(sampling, "read", lambda path, **options: Recording(path, "csv", {}, {}, {}))
    monkeypatch.setattr(sampling, "sniff", lambda path: "table")
    sampling.read_sample(path)
    assert asked == cut
