"""Inputs as frames: a kind, a length and content each.

A fuzzer that changes a byte of a file breaks a checksum or the length of a compressed chunk, and gets no further. So it is given
the parts that files are made of, plain; the file is put together, compressed and its checksums computed, for each input. A frame
at the end that is cut off is as long as what is left, so that any bytes are frames.
"""

from __future__ import annotations

import struct

_HEAD = struct.Struct("<BH")


def sized(content: bytes) -> bytes:
    """Write bytes after their number in four, as most formats do."""
    return struct.pack("<I", len(content)) + content


def framed(parts) -> bytes:
    """Write (kind, content) as frames; what is longer than a frame can be is cut off."""
    return b"".join(_HEAD.pack(kind, min(len(part), 0xFFFF)) + part[:0xFFFF] for kind, part in parts)


def frames(data: bytes) -> list[tuple[int, bytes]]:
    """Read frames."""
    found, at = [], 0
    while at + _HEAD.size <= len(data):
        kind, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        found.append((kind, data[at : at + length]))
        at += length
    return found
