"""Logs that were put one behind another into a file, as by ``cat a.mcap b.mcap``.

Each has numbers of its own for its channels, so each is read for itself.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import IO

from vsalog.core.finding import Finding, Findings
from vsalog.core.memory import PIECE_BYTES
from vsalog.readers.container import Container
from vsalog.readers.file_sequence import SeveralContainer
from vsalog.readers.mcap_file import McapContainer
from vsalog.readers.mcap_walk import MAGIC
from vsalog.readers.rosbag1 import Rosbag1Container, begins_bag
from vsalog.readers.rosbag1_walk import VERSION

_MCAP_BEGINS = MAGIC + b"\x01"  # with a header


def opened_mcap(path: Path) -> Container:
    """Open an MCAP file, or several in one.

    Raises
    ------
    ReadError
        The file cannot be opened.
    """
    first = McapContainer(path)
    if first.has_index():
        return first  # which is that of a file as long as this one
    return _opened(path, first, McapContainer, _MCAP_BEGINS, lambda file, at: not _is_attached(file, at))


def opened_rosbag1(path: Path) -> Container:
    """Open a ROS 1 bag, or several in one; errors as for `Rosbag1Container`."""
    first = Rosbag1Container(path)
    if first.has_index():
        return first
    return _opened(path, first, Rosbag1Container, VERSION, begins_bag)


def _opened(
    path: Path,
    whole: Container,
    kind: Callable[[Path, tuple[int, int]], Container],
    mark: bytes,
    begins: Callable[[IO[bytes], int], bool],
) -> Container:
    """Open each log that begins in a file, or all of it where only one does."""
    with path.open("rb") as file:
        places = [0, *(at for at in _places(file, mark) if at and begins(file, at)), file.seek(0, 2)]
    if len(places) == 2:
        return whole
    further = ", ".join(map(str, places[1:-1][:5])) + (", …" if len(places) > 7 else "")
    joined = Finding(code="recording.joined", value=len(places) - 1, evidence={"further": further})
    return SeveralContainer([kind(path, span) for span in pairwise(places)], whole.format, Findings([joined]))


def _places(file: IO[bytes], mark: bytes) -> Iterator[int]:
    """Yield where a mark is in a file."""
    start, piece = 0, b""
    while True:
        file.seek(start)
        piece = file.read(PIECE_BYTES + len(mark) - 1)
        if len(piece) < len(mark):
            return
        at = piece.find(mark)
        while at >= 0:
            yield start + at
            at = piece.find(mark, at + 1)
        start += PIECE_BYTES


def _is_attached(file: IO[bytes], at: int) -> bool:
    """Tell whether an MCAP file is the content of an attachment of another one, whose length stands ahead of it."""
    file.seek(at - 8)
    length = int.from_bytes(file.read(8), "little")
    file.seek(0, 2)
    if not len(MAGIC) < length <= file.tell() - at:
        return False
    file.seek(at + length - len(MAGIC))
    return file.read(len(MAGIC)) == MAGIC
