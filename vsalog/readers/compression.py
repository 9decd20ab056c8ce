"""Decompression that never returns more than was announced."""

from __future__ import annotations

import bz2
from collections.abc import Callable
from typing import Any

from vsalog.core.memory import AT_ONCE_BYTES
from vsalog.readers.limits import PACKED_BYTES

FILE_RATIO = 100
"""Largest ratio of a table's or MATLAB file's unpacked bytes, or of a log's samples in memory, to the size of its file [1]. Real
ones reach some tens; a large file beyond is refused as a decompression bomb."""

MAX_RATIO = 1032
"""Largest compression ratio of a chunk or page [1]: zlib's limit (zlib.net/zlib_tech.html), which no recording exceeds with other
codecs either."""


class DamagedDataError(Exception):
    """Compressed data cannot be read; the message has the reason."""


def decompress(kind: str, data: bytes, size: int) -> bytes:
    """Return decompressed data.

    Parameters
    ----------
    kind : str
        ``zstd``, ``lz4``, ``bz2``, or ``none`` or "" for data as it is.
    data : bytes
        Compressed.
    size : int
        Announced number of decompressed bytes.

    Raises
    ------
    DamagedDataError
        The data are damaged, of another size or another kind, or too large to be a recording.
    """
    refuse_bomb(len(data), size)
    if not data and not size:
        return b""
    if kind not in ("zstd", *_STREAMING, "none", ""):
        raise DamagedDataError(f"compression '{kind[:20]}' is not supported")
    try:
        whole = data
        if kind == "zstd":
            whole = _zstd(data, size)
        elif kind in _STREAMING:
            whole = _streamed(kind, data, size)
    except Exception as error:  # each compression library has exceptions of its own
        raise DamagedDataError((str(error).splitlines() or [type(error).__name__])[0]) from error
    if len(whole) != size:
        raise DamagedDataError(f"it contains {len(whole)} bytes or more, but {size} are announced")
    return whole


def beginning(kind: str, data: bytes, most: int) -> bytes:
    """Return the beginning of decompressed data, of which there may be only a part; "" where there is nothing.

    Parameters
    ----------
    kind, data : as for `decompress`
    most : int
        So many bytes, or little more, are enough.
    """
    try:
        if kind == "zstd":
            import zstandard

            with zstandard.ZstdDecompressor().stream_reader(data) as reader:
                return reader.read(most)
        if kind in _STREAMING:
            return bytes(_STREAMING[kind]().decompress(data, max_length=most))
    except Exception:  # each compression library has its own; the damage is reported when the data are read
        return b""
    return data[:most] if kind in ("", "none") else b""


def refuse_bomb(compressed: int, size: int) -> None:
    """Raise DamagedDataError where data announce more bytes than any recording has."""
    if size > AT_ONCE_BYTES:
        raise DamagedDataError(f"it announces {size} bytes; more than {AT_ONCE_BYTES} are not read at once")
    if size > PACKED_BYTES and size > MAX_RATIO * compressed:
        raise DamagedDataError(f"it announces {size} bytes out of {compressed}: no recording is compressed so much")


def decompress_message(data: bytes) -> bytes:
    """Return a message that is compressed with zstd; as it is, where it is not compressed after all.

    Raises
    ------
    DamagedDataError
        It would become too large.
    """
    import zstandard

    try:
        size = zstandard.frame_content_size(data)
        refuse_bomb(len(data), size)
        if size >= 0:
            return zstandard.ZstdDecompressor().decompress(data)
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=_most(data))
    except zstandard.ZstdError:
        return data


def unfolded_size(data: bytes) -> int:
    """Return the size of a message after decompression; an upper bound where it does not state it."""
    import zstandard

    try:
        size = zstandard.frame_content_size(data)
    except zstandard.ZstdError:
        return len(data)
    return size if size >= 0 else _most(data)


def _most(data: bytes) -> int:
    return max(PACKED_BYTES, min(AT_ONCE_BYTES, MAX_RATIO * len(data)))


def _zstd(data: bytes, size: int) -> bytes:
    import zstandard

    stated = zstandard.frame_content_size(data)
    if stated not in (-1, size):  # what the frame states is allocated at once
        raise DamagedDataError(f"it contains {stated} bytes, but {size} are announced")
    return zstandard.ZstdDecompressor().decompress(data, max_output_size=size, allow_extra_data=False)


def _lz4() -> Any:
    from lz4.frame import LZ4FrameDecompressor

    return LZ4FrameDecompressor()


_STREAMING: dict[str, Callable[[], Any]] = {"lz4": _lz4, "bz2": bz2.BZ2Decompressor}


def _streamed(kind: str, data: bytes, size: int) -> bytes:
    """Decompress at most one byte more than announced."""
    decompressor = _STREAMING[kind]()
    whole: bytes = decompressor.decompress(data, max_length=size + 1)
    if len(whole) == size and not decompressor.eof:
        whole += decompressor.decompress(b"", max_length=1)  # the checksum at the end
    if len(whole) == size and (not decompressor.eof or decompressor.unused_data):
        raise DamagedDataError("its compressed data do not end where they should")
    return whole
