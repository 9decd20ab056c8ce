"""A sample of a large log, to inspect it without reading all of it: a few stretches from its first sample to its last.

Of logs of messages, chunks or rows are read in place. Of tables, stretches of lines or row groups become a small table of
the same format in a temporary folder, so that the readers need no change.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from vsalog.core.errors import ReadError
from vsalog.core.look import LOOK_BYTES
from vsalog.core.recording import Recording
from vsalog.core.resolution import STRETCHES
from vsalog.readers.limits import GLANCE_BYTES, PACKED_BYTES
from vsalog.readers.parquet_rows import ParquetRows
from vsalog.readers.reading import message_reader, open_container, read
from vsalog.readers.remote import downloaded, local
from vsalog.readers.sampling_pieces import Piece, Sample, chosen_pieces, copy_pieces
from vsalog.readers.sniff import sniff
from vsalog.readers.table_folder import tables_in
from vsalog.readers.tables.reader import TableReader
from vsalog.readers.tables.source import Source, open_text, read_beginning

Cutter = Callable[[Path, Path, int], Sample | None]
"""Copies about a given number of bytes of a log (first path) into a file (second path); None where that would be all of it."""


def read_sample(
    path: Path,
    time: str = "auto",
    rate: float | None = None,
) -> tuple[Recording, Sample | None]:
    """Read a sample of a large log; a small one, or one that can only be read as a whole, is read as a whole.

    Parameters
    ----------
    path, time, rate : as for `vsalog.readers.read`

    Returns
    -------
    Recording
        Of what was read.
    Sample or None
        Its description; None for the whole log.

    Raises
    ------
    ReadError
        The log cannot be read.
    """
    file = local(path)
    try:
        recording, sample = _sampled(file, time, rate)
    except ReadError as error:
        raise error.moved(file, path) from None
    findings = recording.findings if file is path else (downloaded(file), *recording.findings)
    return replace(recording, path=path, findings=findings), sample


def _sampled(path: Path, time: str, rate: float | None) -> tuple[Recording, Sample | None]:
    kind, size = sniff(path), _size(path)
    cut, recording = None, None
    if size >= LOOK_BYTES and kind in CUTTERS:
        with tempfile.TemporaryDirectory(prefix="vsalog-") as folder:
            small = Path(folder) / path.name  # tables are named by their file
            try:
                cut = CUTTERS[kind](path, small, LOOK_BYTES // 2)
                recording = None if cut is None else read(small, time=time, rate=rate)
            except OSError as error:
                words = f"no sample of it could be taken: {error.strerror or error}; --full reads it"
                raise ReadError(words, path) from error
            except ReadError as error:
                raise error.moved(small, path) from error
    elif size >= LOOK_BYTES and kind != "matlab":
        container = open_container(path, kind)
        cut = container.sample(LOOK_BYTES // 2)
        recording = None if cut is None else read(path, time=time, opened=message_reader(container, rate))
    if cut is None or recording is None:
        return read(path, time=time, rate=rate), None
    recording = replace(recording, findings=(*cut.findings, *recording.findings))
    return recording, replace(cut, of=size)


def _size(path: Path) -> int:
    return sum(p.stat().st_size for p in path.iterdir() if p.is_file()) if path.is_dir() else path.stat().st_size


def cut_parquet(source: Path, target: Path, budget: int) -> Sample | None:
    """Cut stretches of row groups out of a Parquet file; a damaged one is read as a whole. See `Cutter`."""
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
        return None  # the reader reports the fault
    return Sample(sum(piece.size for piece in pieces), stretches, totals)


def cut_text(source: Path, target: Path, budget: int) -> Sample | None:
    """Cut stretches of lines out of a text table, or its beginning where lines have no time. See `Cutter`."""
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


def cut_folder(source: Path, target: Path, budget: int) -> Sample | None:
    """Cut stretches out of each table of a folder, in proportion to its size; small files are copied. See `Cutter`."""
    files, cuts = tables_in(source), list[Sample]()
    whole = sum(path.stat().st_size for path in files)
    target.mkdir()
    for path in files:
        small, share = target / path.name, max(budget * path.stat().st_size // whole, 1)
        try:
            cut = CUTTERS[sniff(path)](path, small, share) if share > GLANCE_BYTES else None
        except (ReadError, KeyError):  # the reader reports the fault
            cut = None
        if cut is None:
            shutil.copyfile(path, small)
            cut = Sample(small.stat().st_size, 1)
        cuts.append(cut)
    if max(cut.stretches for cut in cuts) == 1 and sum(cut.size for cut in cuts) == whole:
        return None
    totals = {name: count for cut in cuts for name, count in cut.totals.items()}
    return Sample(sum(cut.size for cut in cuts), max(cut.stretches for cut in cuts), totals)


CUTTERS: Mapping[str, Cutter] = {"parquet": cut_parquet, "table": cut_text, "table-folder": cut_folder}
