"""A sample of an MCAP file: whole chunks, copied bit for bit."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from mcap.opcode import Opcode

from vsalog.core.finding import Finding
from vsalog.core.printable import printable
from vsalog.readers.concatenated_files import opened_mcap
from vsalog.readers.file_sequence import SeveralContainer
from vsalog.readers.limits import MOST_STEPS
from vsalog.readers.sampling_pieces import Cut, Piece, chosen_pieces, copy_pieces

MAGIC = b"\x89MCAP0\r\n"

_HEAD = struct.Struct("<BQ")
_END = _HEAD.pack(Opcode.DATA_END, 4) + bytes(4) + _HEAD.pack(Opcode.FOOTER, 20) + bytes(20) + MAGIC


@dataclass(frozen=True, slots=True)
class _Plan:
    """What can be cut out of a file.

    Attributes
    ----------
    chunks : whole records
    others : records that are needed in any case
    definitions : schemas and channels as the summary repeats them, serialised
    totals : messages of each topic
    """

    chunks: list[Piece]
    others: list[Piece]
    definitions: bytes
    totals: dict[str, int]


def cut_mcap(source: Path, target: Path, budget: int) -> Cut | None:
    """Cut stretches of chunks out of an MCAP file; of one without chunks its beginning, of several in one file nothing.

    See `sampling.Cutter`.
    """
    if isinstance(opened_mcap(source), SeveralContainer):
        return None
    with source.open("rb") as file:
        plan = _by_summary(file) or _by_walk(file)
        pieces, stretches = chosen_pieces(plan.chunks, budget) if plan.chunks else ([_beginning(file, budget)], 1)
        if not pieces:
            return None
        with target.open("wb") as out:
            out.write(MAGIC)
            if plan.chunks:
                copy_pieces(file, plan.others, out)
                out.write(plan.definitions)
            copy_pieces(file, pieces, out)
            out.write(_END)
    findings = () if plan.totals else (Finding(code="recording.no_summary"),)
    return Cut(sum(piece.size for piece in pieces), stretches, plan.totals, findings)


def _by_summary(file: IO[bytes]) -> _Plan | None:
    """Plan by the summary at the file's end; None where it is missing, damaged or incomplete, or knows of no chunk."""
    from mcap.reader import make_reader

    try:
        file.seek(0)
        summary = make_reader(file).get_summary()
        counts = summary.statistics if summary else None
        if summary is None or counts is None or not summary.chunk_indexes:
            return None
        if (counts.chunk_count, counts.channel_count) != (len(summary.chunk_indexes), len(summary.channels)):
            return None
        chunks = [Piece(index.chunk_start_offset, index.chunk_length) for index in summary.chunk_indexes]
        metadata = [Piece(index.offset, index.length) for index in summary.metadata_indexes]
        if not all(_is(file, piece, Opcode.CHUNK) for piece in chunks) or not all(
            _is(file, p, Opcode.METADATA) for p in metadata
        ):
            return None
        first = next(record_heads(file))[1]
        return _Plan(sorted(chunks), [first, *metadata], _serialised(summary), _totals(summary))
    except Exception:  # damage anywhere in the summary: the walk will find what there is
        return None


def _serialised(summary: Any) -> bytes:
    """Return the summary's schemas and channels as records."""
    from mcap.data_stream import RecordBuilder

    builder = RecordBuilder()
    for record in (*summary.schemas.values(), *summary.channels.values()):
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


def _totals(summary: Any) -> dict[str, int]:
    """Return the messages of each topic, but of those with several types or publishers, whose streams are others."""
    topics = Counter(channel.topic for channel in summary.channels.values())
    counts = summary.statistics.channel_message_counts
    return {
        printable(channel.topic): counts.get(number, 0)
        for number, channel in summary.channels.items()
        if topics[channel.topic] == 1
    }


def _by_walk(file: IO[bytes]) -> _Plan:
    """Plan by the heads of the records, as far as they are sound."""
    plan = _Plan([], [], b"", {})
    for _, (kind, piece) in zip(range(MOST_STEPS), record_heads(file), strict=False):
        if kind == Opcode.CHUNK:
            plan.chunks.append(piece)
        elif piece.position == len(MAGIC) or kind in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA):
            plan.others.append(piece)
    return plan


def _beginning(file: IO[bytes], budget: int) -> Piece:
    """Return the first records, of about `budget` bytes."""
    end = len(MAGIC)
    for _, piece in record_heads(file):
        if end > budget:
            break
        end = piece.position + piece.size
    return Piece(len(MAGIC), end - len(MAGIC))


def record_heads(file: IO[bytes]) -> Iterator[tuple[int, Piece]]:
    """Yield kind and place of the records of the data section without reading them, up to its end or to damage."""
    size, position = file.seek(0, 2), len(MAGIC)
    while True:
        file.seek(position)
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return
        kind, length = _HEAD.unpack(head)
        end = position + _HEAD.size + length
        if kind in (0, Opcode.FOOTER, Opcode.DATA_END) or end > size:
            return
        yield kind, Piece(position, end - position)
        position = end


def _is(file: IO[bytes], piece: Piece, kind: int) -> bool:
    """Tell whether there is a record of that kind and size."""
    file.seek(piece.position)
    return file.read(_HEAD.size) == _HEAD.pack(kind, piece.size - _HEAD.size)
