"""A sample of an MCAP file: whole chunks, copied bit for bit."""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import IO

from mcap.opcode import Opcode

from vsalog.core.finding import Finding
from vsalog.core.printable import printable
from vsalog.readers.concatenated_files import opened_mcap
from vsalog.readers.limits import MOST_STEPS
from vsalog.readers.mcap_file import McapContainer
from vsalog.readers.mcap_summary import summary_records
from vsalog.readers.mcap_walk import MAGIC, Walk
from vsalog.readers.sampling_pieces import Cut, Piece, chosen_pieces, copy_pieces

_HEAD = struct.Struct("<BQ")
_DEFINITIONS = (Opcode.SCHEMA, Opcode.CHANNEL)
_CHUNK_COUNT, _CHUNK_PLACE, _PLACE = map(struct.Struct, ("<22xI", "<16xQQ", "<QQ"))
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
    log = opened_mcap(source)
    if not isinstance(log, McapContainer):
        return None
    with source.open("rb") as file:
        plan = _by_summary(log, file) or _by_walk(file)
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


def _by_summary(log: McapContainer, file: IO[bytes]) -> _Plan | None:
    """Plan by the summary at the file's end; None where it is missing, damaged or incomplete, or knows of no chunk."""
    if not log.has_summary() or not log.chunks:
        return None
    records = list(summary_records(file) or ())
    counted = [_CHUNK_COUNT.unpack_from(content)[0] for kind, content in records if kind == Opcode.STATISTICS]
    chunks = [Piece(*_CHUNK_PLACE.unpack_from(content)) for kind, content in records if kind == Opcode.CHUNK_INDEX]
    metadata = [Piece(*_PLACE.unpack_from(content)) for kind, content in records if kind == Opcode.METADATA_INDEX]
    if counted != [len(chunks)]:
        return None
    if not all(_is(file, p, Opcode.CHUNK) for p in chunks) or not all(_is(file, p, Opcode.METADATA) for p in metadata):
        return None
    definitions = (_HEAD.pack(kind, len(content)) + content for kind, content in records if kind in _DEFINITIONS)
    # Topics with several types or publishers may be several streams.
    topics = Counter(channel.topic for channel in log.channels.values())
    totals = {
        printable(channel.topic): log.counts().get(number, 0)
        for number, channel in log.channels.items()
        if topics[channel.topic] == 1
    }
    header = [Piece(at, end - at) for _, at, end in islice(Walk(file, verify=False).heads(), 1)]
    return _Plan(sorted(chunks), [*header, *metadata], b"".join(definitions), totals)


def _by_walk(file: IO[bytes]) -> _Plan:
    """Plan by the heads of the records, as far as they are sound."""
    plan = _Plan([], [], b"", {})
    for kind, at, end in islice(Walk(file, verify=False).heads(), MOST_STEPS):
        if kind == Opcode.CHUNK:
            plan.chunks.append(Piece(at, end - at))
        elif at == len(MAGIC) or kind in (*_DEFINITIONS, Opcode.METADATA):
            plan.others.append(Piece(at, end - at))
    return plan


def _beginning(file: IO[bytes], budget: int) -> Piece:
    """Return the first records, of about `budget` bytes."""
    end = len(MAGIC)
    for _, _, following in Walk(file, verify=False).heads():
        if end > budget:
            break
        end = following
    return Piece(len(MAGIC), end - len(MAGIC))


def _is(file: IO[bytes], piece: Piece, kind: int) -> bool:
    """Tell whether there is a record of that kind and size."""
    file.seek(piece.position)
    return file.read(_HEAD.size) == _HEAD.pack(kind, piece.size - _HEAD.size)
