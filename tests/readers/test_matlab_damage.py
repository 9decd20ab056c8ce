"""MATLAB v5 files whose parts contradict one another: refused or left out, and no library that believes them ends the process."""

from __future__ import annotations

import os
import struct
from io import BytesIO

import numpy as np
import pytest
import scipy.io
from finding_codes import codes, found, values_of
from scipy.io import savemat
from scipy.sparse import csc_matrix

from vsalog.core.errors import ReadError
from vsalog.readers import matlab_variables, read

HEADER = b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM"
T = np.arange(6) * 1e-3


def element(kind, content, order="<"):
    return struct.pack(order + "II", kind, len(content)) + content + bytes(-len(content) % 8)


def matrix(kind, shape, *parts, name=b"x", order="<"):
    head = element(6, struct.pack(order + "II", kind, 0), order)
    head += element(5, struct.pack(f"{order}{len(shape)}i", *shape), order) + element(1, name, order)
    return element(14, head + b"".join(parts), order)


def doubles(values, order="<"):
    return element(9, np.asarray(values, order + "f8").tobytes(), order)


SOUND = matrix(6, (1, 3), doubles([1, 2, 3]), name=b"sound")
BAD = {
    "more values than are there": matrix(6, (2**31 - 1, 2**31 - 1), doubles([1, 2])),
    "fewer values than are there": matrix(6, (1, 1), doubles([1, 2])),
    "no whole values": matrix(6, (1, 1), element(9, bytes(7))),
    "a negative dimension": matrix(6, (-1, -2), doubles([1, 2])),
    "an unknown type": matrix(6, (1, 1), element(99, bytes(8))),
    "a part beyond the end": matrix(6, (1, 1), struct.pack("<II", 9, 2**32 - 1)),
    "a small part of many bytes": matrix(6, (1, 1), struct.pack("<HHI", 9, 200, 0)),
    "cells that are missing": matrix(1, (10**9, 1)),
    "cells that are no arrays": matrix(1, (1, 1), doubles([1])),
    "fields without a width": matrix(2, (1, 1), element(5, bytes(4)), element(1, b"abcd"), doubles([1])),
    "names that do not fit": matrix(2, (1, 1), element(5, struct.pack("<i", 3)), element(1, b"abcd"), doubles([1])),
    "no flags": element(14, element(6, b"")),
    "nothing but a tag": element(14, b"\1"),
    "another element": element(1, b"abcdefgh"),
}


def nested(depth):
    value = matrix(6, (1, 1), doubles([1]))
    for _ in range(depth):
        value = matrix(1, (1, 1), value)
    return value


@pytest.mark.parametrize("name", BAD)
def test_what_contradicts_itself_is_left_out(tmp_path, name):
    path = tmp_path / "log"
    path.write_bytes(HEADER + SOUND + BAD[name])
    recording = read(path)
    assert recording.channel("sound").values.tolist() == [1, 2, 3]
    assert "recording.variables_damaged" in codes(recording)
    path.write_bytes(HEADER + BAD[name])
    with pytest.raises(ReadError, match="damaged"):
        read(path)


def test_cells_in_cells_in_cells_are_reported(tmp_path):
    path = tmp_path / "log"
    path.write_bytes(HEADER + SOUND + nested(200))
    recording = read(path)
    assert recording.channel("sound").values.tolist() == [1, 2, 3]
    assert any("nested too deeply" in why for why in recording.unread.values())


@pytest.mark.parametrize("compressed", [False, True])
@pytest.mark.parametrize("byte", [4, 5, 6, 7])
def test_a_variable_whose_length_is_wrong_is_reported(tmp_path, compressed, byte):
    """What is ahead of it is read; where the next begins is not known."""
    contents = {name: {"time": T, "x": T * k} for k, name in enumerate("abcd", start=1)}
    file, ahead = BytesIO(), BytesIO()
    savemat(file, contents, do_compression=compressed)
    savemat(ahead, {"a": contents["a"]}, do_compression=compressed)
    raw = bytearray(file.getvalue())
    raw[len(ahead.getvalue()) + byte] ^= 1
    (tmp_path / "log").write_bytes(raw)
    recording = read(tmp_path / "log")
    np.testing.assert_array_equal(recording.channel("a.x").values, contents["a"]["x"])
    assert "recording.variables_damaged" in codes(recording)


def test_a_variable_that_ends_the_process_takes_no_other_along(tmp_path, monkeypatch):
    own = scipy.io.loadmat
    monkeypatch.setattr(scipy.io, "loadmat", lambda file: os.abort() if b"abort" in file.getvalue() else own(file))
    (tmp_path / "log").write_bytes(HEADER + SOUND + matrix(6, (1, 1), doubles([1]), name=b"abort") + SOUND)
    recording = read(tmp_path / "log")
    assert list(recording.channels) == ["sound"]
    (damage,) = found(recording, "recording.variables_damaged")
    assert damage.value == 1


def test_a_compressed_structure_without_an_end_is_left_out(tmp_path):
    """Where the file is not cut off, its bytes have changed, and what came of them is made up."""
    file = BytesIO()
    savemat(file, {"s": {"time": T, "x": T}}, do_compression=True)
    raw = file.getvalue()
    short = raw[136:-6]
    (tmp_path / "log").write_bytes(raw[:128] + struct.pack("<II", 15, len(short)) + short + SOUND)
    assert list(read(tmp_path / "log").channels) == ["sound"]


def test_lengths_that_are_wrong_throughout_come_to_an_end(tmp_path):
    """Looking for the next variable must not begin again for each of a million that are none."""
    path = tmp_path / "log"
    path.write_bytes(HEADER + SOUND + struct.pack("<IIII", 14, 2**31, 6, 8) * 200_000)
    assert read(path).channel("sound").values.tolist() == [1, 2, 3]


def test_zeros_behind_the_variables_are_one_damage(tmp_path):
    """A disk that is full leaves them."""
    (tmp_path / "log").write_bytes(HEADER + SOUND + bytes(10**7))
    recording = read(tmp_path / "log")
    assert recording.channel("sound").values.tolist() == [1, 2, 3]
    assert values_of(recording, "recording.variables_damaged") == [1]


def test_variables_that_together_unfold_to_too_much_are_left_out_unread(tmp_path, monkeypatch):
    file = BytesIO()
    savemat(file, {"z": np.zeros(10_000_000)}, do_compression=True)
    (tmp_path / "log").write_bytes(HEADER + SOUND + file.getvalue()[128:] * 40)
    monkeypatch.setattr(matlab_variables, "_apart", None)  # not one of them has to be tried by itself
    recording = read(tmp_path / "log")
    assert {name: channel.values.size for name, channel in recording.channels.items()} == {"sound": 3, "z": 10_000_000}
    (damage,) = found(recording, "recording.variables_damaged")
    assert 37 <= damage.value < 40  # three would fit, if nothing else took memory


def test_bytes_that_would_take_eight_times_their_room_as_numbers_are_left_out(tmp_path):
    savemat(tmp_path / "log", {"x": T, "z": np.zeros(40_000_000, np.uint8)}, do_compression=True, appendmat=False)
    recording = read(tmp_path / "log")
    assert list(recording.channels) == ["x"]
    assert values_of(recording, "recording.variable_too_large") == [40000000]


def test_a_file_without_variables_says_so(tmp_path):
    path = tmp_path / "log"
    path.write_bytes(HEADER)
    assert "recording.no_variables" in codes(read(path))
    path.write_bytes(HEADER[:100])
    with pytest.raises(ReadError, match="at byte 0: it is cut off"):
        read(path)


def test_any_changed_bytes_are_read_or_refused(tmp_path):
    """Without compression nothing vouches for a file's parts."""
    file = BytesIO()
    savemat(
        file, {"s": {"time": T, "c": np.array([T, "word", {"a": T}], object)}, "z": T * 1j, "n": np.ones((2, 3, 2))}
    )
    raw, rng, path = file.getvalue(), np.random.default_rng(3), tmp_path / "log"
    for _ in range(100):
        damaged = bytearray(raw)
        for place in rng.integers(128, len(raw), rng.integers(1, 4)):
            damaged[place] = rng.choice([0, 1, 5, 9, 14, 127, 128, 255])
        path.write_bytes(damaged)
        try:
            recording = read(path)
        except ReadError:
            continue
        for channel in recording.channels.values():
            assert channel.values.shape == channel.stamps.shape
            assert (np.diff(channel.stamps) > 0).all()


def test_the_other_byte_order(tmp_path):
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\1\0MI"
    path = tmp_path / "log"
    path.write_bytes(head + matrix(6, (3, 1), doubles([1, 2, -3.5], ">"), order=">"))
    assert read(path).channel("x").values.tolist() == [1, 2, -3.5]


def test_what_is_no_array_of_numbers_is_reported(tmp_path):
    path = tmp_path / "log"
    content = {"x": T, "sparse": csc_matrix(np.eye(3)), "word": "text", "empty": np.zeros((0, 0)), "none": {}}
    savemat(path, content, appendmat=False)
    with path.open("ab") as file:
        file.write(
            element(
                14,
                element(6, struct.pack("<II", 17, 0))
                + element(1, b"obj")
                + element(1, b"MCOS")
                + element(1, b"table")
                + SOUND,
            )
        )
    recording = read(path)
    assert list(recording.channels) == ["x"]
    assert recording.unread["word"] == "text"
    assert "no array of numbers" in recording.unread["sparse"]
    assert "no array of numbers" in recording.unread["obj"]
    assert "(0, 0)" in recording.unread["empty"]
