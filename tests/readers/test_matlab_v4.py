"""MATLAB v4 files."""

from __future__ import annotations

import struct
from io import BytesIO

import numpy as np
import pytest
from scipy.io import savemat
from scipy.sparse import csc_matrix

from vsalog.core.errors import ReadError
from vsalog.readers import read

T = np.arange(50) / 100


def matrix(name, values, order="<", kind=0, rows=None):
    """Return a variable as the format's description has it."""
    columns = np.atleast_2d(values)
    head = (
        kind + (1000 if order == ">" else 0),
        len(columns) if rows is None else rows,
        columns.shape[1],
        0,
        len(name) + 1,
    )
    return struct.pack(order + "5i", *head) + name.encode() + b"\0" + columns.astype(order + "f8").tobytes(order="F")


def test_numbers_of_every_type(tmp_path):
    content = {
        "time": T,
        "column": T[:, None] * 2,
        "single": (T * 4).astype(np.float32),
        "table": np.stack([T, T + 1], axis=1),
        **{kind: np.arange(50).astype(kind) for kind in ("int32", "int16", "uint16", "uint8")},
        "word": "text",
        "c": T * 1j,
        "sparse": csc_matrix(np.eye(3)),
        "one": 5.0,
    }
    savemat(tmp_path / "log", content, format="4", appendmat=False)
    recording = read(tmp_path / "log")
    assert recording.format == "matlab"
    assert recording.findings == ()
    expected = {"column": T * 2, "single": (T * 4).astype(np.float32), "table[0]": T, "table[1]": T + 1}
    expected |= dict.fromkeys(("int32", "int16", "uint16", "uint8"), np.arange(50))
    assert recording.channels.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(recording.channel(name).values, values)
        np.testing.assert_array_equal(recording.channel(name).stamps, np.arange(50) * 10**7)
    assert recording.unread == {
        "word": "text",
        "c": "complex numbers",
        "sparse": "MATLAB object that is no array of numbers",
        "one": "a single value",
    }


@pytest.mark.parametrize("order", ["<", ">"])
def test_either_byte_order(tmp_path, order):
    (tmp_path / "log").write_bytes(matrix("t", T, order) + matrix("x", np.stack([T, T * 3], axis=1), order))
    recording = read(tmp_path / "log")
    np.testing.assert_array_equal(recording.channel("x[1]").values, T * 3)
    np.testing.assert_array_equal(recording.channel("x[1]").stamps, np.arange(50) * 10**7)


@pytest.mark.parametrize(
    "bad",
    [
        matrix("x", T, rows=2**30),
        matrix("x", T, rows=-1),
        matrix("x", T, kind=70),
        matrix("x", T, kind=3),
        matrix("x", T)[:-1],
        matrix("x", T)[:10],
    ],
)
def test_a_damaged_file_is_refused(tmp_path, bad):
    """Nothing tells that a variable is as long as it should be."""
    (tmp_path / "log").write_bytes(matrix("t", T) + matrix("q", T * 3) + bad)
    with pytest.raises(ReadError, match="the MATLAB file is damaged"):
        read(tmp_path / "log")


def test_any_changed_bytes_are_read_or_refused(tmp_path):
    file = BytesIO()
    savemat(file, {"time": T, "x": T, "word": "text", "n": np.ones((2, 3)), "z": T * 1j}, format="4")
    raw, rng, path = file.getvalue(), np.random.default_rng(3), tmp_path / "log"
    for _ in range(100):
        damaged = bytearray(raw)
        for place in rng.integers(0, len(raw), rng.integers(1, 4)):
            damaged[place] = rng.choice([0, 1, 5, 9, 14, 127, 128, 255])
        path.write_bytes(damaged[: rng.integers(len(raw)) if rng.random() < 0.2 else None])
        try:
            recording = read(path)
        except ReadError:
            continue
        for channel in recording.channels.values():
            assert channel.values.shape == channel.stamps.shape
            assert (np.diff(channel.stamps) > 0).all()
