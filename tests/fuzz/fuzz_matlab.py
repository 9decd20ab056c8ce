"""Fuzz target: MATLAB files: version 5, its elements plain or compressed, and versions 4 and 7.3, whose bytes are changed."""

from __future__ import annotations

import struct
import zlib
from io import BytesIO
from pathlib import Path

import numpy as np
from fuzz_contract import exercise, put
from fuzz_frames import framed, frames

HEADER = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
V73 = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(384)
PLAIN, COMPRESSED = range(2)
FOOT = Path(__file__).parents[2] / "sample_logs" / "desr_foot"


def one(data: bytes) -> None:
    """Read what the input makes: how to read it, which version, and frames of elements (or bytes as they are)."""
    if len(data) < 2:
        return
    make = (lambda raw: assemble(frames(raw)), bytes, V73.__add__, V73.__add__)[data[1] & 3]
    exercise(put(make(data[2:]), "log.mat"), data[0])


def assemble(parts) -> bytes:
    """Put a file of version 5 together: elements of matrices, as they are or compressed."""
    elements = []
    for kind, content in parts:
        element = struct.pack("<II", 14, len(content)) + content
        packed = zlib.compress(element)
        elements.append(element if kind % 2 == PLAIN else struct.pack("<II", 15, len(packed)) + packed)
    return HEADER + b"".join(elements)


def seeds():
    """Yield files with vectors, structures, cells, texts and their clocks."""
    from scipy.io import savemat

    t = np.arange(6) * 1e-3
    contents = (
        {"time": t, "q": np.sin(t), "M": np.ones((6, 2)), "i": np.arange(6, dtype=np.int16)},
        {"run": {"t": t, "x": {"y": t * 2, "name": "text"}}, "z": np.ones(3, dtype=complex)},
        {"c": np.array([t, "word", {"a": t}], dtype=object), "s": np.array([[1.0]]), "e": np.zeros((0, 0))},
    )
    for content in contents:
        file = BytesIO()
        savemat(file, content)
        raw = file.getvalue()
        yield bytes([0x00, 1]) + raw
        parts, at = [], 128
        while at + 8 <= len(raw):
            length = struct.unpack_from("<I", raw, at + 4)[0]
            parts.append((PLAIN, raw[at + 8 : at + 8 + length]))
            at += 8 + length
        yield bytes([0x28, 0]) + framed(parts)
        yield bytes([0x38, 0]) + framed([(COMPRESSED, part) for _, part in parts])
    yield bytes([0x28, 2]) + hdf5()
    file = BytesIO()
    savemat(file, {"time": t, "q": np.sin(t), "M": np.ones((6, 2)), "name": "text"}, format="4")
    yield bytes([0x28, 1]) + file.getvalue()


def hdf5() -> bytes:
    """Return a small file of version 7.3, behind its first 512 bytes."""
    import h5py

    file = BytesIO()
    with h5py.File(file, "w", libver=("earliest", "v108")) as target:
        for name, values in (("time", np.arange(6) * 1e-3), ("q", np.sin(np.arange(6)))):
            node = target.create_dataset(name, data=values[None, :], chunks=(1, 3), compression="gzip", fletcher32=True)
            node.attrs["MATLAB_class"] = np.bytes_("double")
        group = target.create_group("run")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        node = group.create_dataset("x", data=np.ones((2, 6)))
        node.attrs["MATLAB_class"] = np.bytes_("double")
    return file.getvalue()
