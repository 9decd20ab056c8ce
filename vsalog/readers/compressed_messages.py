"""Messages that a ROS 2 bag compresses one by one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from vsalog.readers.compression import DamagedDataError, decompress_message, unfolded_size
from vsalog.readers.container import ZSTD_MAGIC
from vsalog.readers.limits import PACKED_BYTES
from vsalog.readers.packets import Messages, Packet


def plain(packet: Packet) -> Packet:
    """Return a packet with its messages decompressed, where a ROS 2 bag compresses them one by one."""
    compressed = packet.messages.beginning_with(ZSTD_MAGIC)
    if not compressed.any():
        return packet
    content = [_decompressed(m) if c else m for m, c in zip(packet.messages, compressed.tolist(), strict=True)]
    return replace(packet, messages=Messages.of(content))


def plain_packets(packets: Iterator[Packet]) -> Iterator[Packet]:
    """Yield packets with their messages decompressed, so few at a time that they stay small."""
    for packet in packets:
        if not packet.compressed or not packet.messages.beginning_with(ZSTD_MAGIC).any():
            yield packet
            continue
        sizes = np.array([unfolded_size(message) for message in packet.messages], dtype=np.int64)
        rows = np.arange(sizes.size)
        for group in np.split(rows, np.flatnonzero(np.diff(np.cumsum(sizes) // PACKED_BYTES)) + 1):
            yield plain(packet.some(group))


def _decompressed(message: bytes) -> bytes:
    try:
        return decompress_message(message)
    except DamagedDataError:
        return b"\xff\xff\xff"  # no message of any type: it will be counted as damaged
