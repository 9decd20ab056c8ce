"""A small log cut out of a large one, to see what is in it without reading all of it.

What is cut out is a sound log of the same format, in a temporary folder: the readers need not know of it. It holds whole
chunks (row groups, rows, lines), bit for bit, in a few stretches from the log's first sample to its last.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from vsalog.core.errors import ReadError
from vsalog.core.finding import Finding
from vsalog.core.look import LOOK_BYTES
from vsalog.core.recording import Recording
from vsalog.readers.reading import read
from vsalog.readers.remote import downloaded, local
from vsalog.readers.sampling_bags import cut_folder, cut_rosbag1, cut_sqlite
from vsalog.readers.sampling_mcap import cut_mcap
from vsalog.readers.sampling_pieces import Cut
from vsalog.readers.sampling_tables import cut_parquet, cut_text
from vsalog.readers.sniff import sniff


@dataclass(frozen=True, slots=True)
class Sample:
    """What was read instead of a whole log.

    Attributes
    ----------
    size, of : int
        Bytes read, and of the whole log.
    stretches : int
        Pieces that do not join; 1 is the log's beginning alone.
    totals : mapping of str to int
        Samples of each stream in the whole log, where the log says so.
    """

    size: int
    of: int
    stretches: int
    totals: Mapping[str, int]


Cutter = Callable[[Path, Path, int], Cut | None]
"""Cuts about so many bytes of a log (first path) into a file (second path); None where that is no less than the whole."""

CUTTERS: Mapping[str, Cutter] = {
    "mcap": cut_mcap,
    "rosbag1": cut_rosbag1,
    "rosbag2": cut_sqlite,
    "rosbag2-folder": cut_folder,
    "parquet": cut_parquet,
    "table": cut_text,
}


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
        What that is; None for the whole log.

    Raises
    ------
    ReadError
        The log cannot be read.
    """
    file = local(path)
    try:
        with _cut(file, sniff(file)) as (small, sample, findings):
            try:
                recording = read(small, time=time, rate=rate)
            except ReadError as error:
                raise error.moved(small, file) from error
    except ReadError as error:
        raise error.moved(file, path) from None
    if file is not path:
        findings = (downloaded(file), *findings)
    return replace(recording, path=path, findings=(*findings, *recording.findings)), sample


@contextmanager
def _cut(path: Path, kind: str) -> Iterator[tuple[Path, Sample | None, tuple[Finding, ...]]]:
    """Give the path of a sample of a log, or of the log itself, and what was noticed."""
    size = _size(path)
    cutter = CUTTERS.get(kind)
    if cutter is None or size < LOOK_BYTES:
        yield path, None, ()
        return
    with tempfile.TemporaryDirectory(prefix="vsalog-") as folder:
        small = Path(folder) / path.name  # tables are called by the file's name
        try:
            cut = cutter(path, small, LOOK_BYTES // 2)
        except OSError as error:
            raise ReadError(
                f"no sample of it could be taken: {error.strerror or error}; --full reads it", path
            ) from error
        if cut is None:
            yield path, None, ()
        else:
            yield small, Sample(cut.size, size, cut.stretches, cut.totals), cut.findings


def _size(path: Path) -> int:
    return sum(p.stat().st_size for p in path.iterdir() if p.is_file()) if path.is_dir() else path.stat().st_size
