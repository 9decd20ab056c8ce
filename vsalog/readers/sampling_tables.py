"""A sample of a table: row groups of a Parquet file, lines of a text."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from vsalog.core.resolution import STRETCHES
from vsalog.readers.limits import PACKED_BYTES
from vsalog.readers.parquet_rows import ParquetRows
from vsalog.readers.sampling_pieces import Piece, Sample, chosen_pieces, copy_pieces
from vsalog.readers.tables.reader import TableReader
from vsalog.readers.tables.source import Source, open_text, read_beginning


def cut_parquet(source: Path, target: Path, budget: int) -> Sample | None:
    """Cut stretches of row groups out of a Parquet file; a damaged one is read as a whole. See `sampling.Cutter`."""
    try:
        rows = ParquetRows(source)
        packed = source.stat().st_size / max(sum(rows.unpacked), 1)
        sizes = [int(packed * size) for size in rows.unpacked]
        pieces, stretches = (
            chosen_pieces([Piece(i, size) for i, size in enumerate(sizes)], budget) if sizes else ([], 0)
        )
        if not pieces:
            return None
        with target.open("wb") as part, pq.ParquetWriter(part, rows.schema) as writer:
            for piece in pieces:
                table = rows.file.read_row_group(piece.position)
                if table.num_rows != rows.sizes[piece.position]:
                    return None  # damaged
                writer.write_table(table)
        totals = {source.stem: sum(rows.sizes)}
    except (pa.ArrowException, OSError, UnicodeError):
        return None  # the reader says what is wrong with it
    return Sample(sum(piece.size for piece in pieces), stretches, totals)


def cut_text(source: Path, target: Path, budget: int) -> Sample | None:
    """Cut stretches of lines out of a text table, or its beginning where lines do not tell their time. See `sampling.Cutter`."""
    reader = TableReader(source, None, thorough=False)
    size = source.stat().st_size
    with open_text(source) as file, target.open("wb") as out:
        if not (reader.has_clock and reader.seekable):
            beginning = read_beginning(file, budget)
            text = beginning.decode(reader.dialect.encoding, "replace")
            out.write(text[: text.rfind("\n") + 1].encode())
            return Sample(len(beginning), 1)
        share = budget // STRETCHES
        begins = [_next_line(file, int(at)) for at in np.linspace(0, size - share, STRETCHES)]
        pieces = [Piece(begin, _next_line(file, begin + share) - begin) for begin in begins]
        copy_pieces(file, pieces, out)
        return Sample(out.tell(), STRETCHES)


def _next_line(file: Source, position: int) -> int:
    """Return where the next line begins, the first one at the very beginning; the file's end where there is none."""
    if position == 0:
        return 0
    file.seek(position)
    return position + len(file.readline(PACKED_BYTES))
