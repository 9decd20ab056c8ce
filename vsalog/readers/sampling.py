"""A part of a large log, to see what is in it without reading all of it: a few stretches from its first sample to its last.

Of logs of messages, chunks or rows are read where they lie. Of tables, stretches of lines or row groups become a small table of
the same format in a temporary folder: the readers need not know of it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from vsalog.core.errors import ReadError
from vsalog.core.look import LOOK_BYTES
from vsalog.core.recording import Recording
from vsalog.readers.reading import message_reader, open_container, read
from vsalog.readers.remote import downloaded, local
from vsalog.readers.sampling_pieces import Sample
from vsalog.readers.sampling_tables import cut_parquet, cut_text
from vsalog.readers.sniff import sniff

Cutter = Callable[[Path, Path, int], Sample | None]
"""Copies about a given number of bytes of a log (first path) into a file (second path); None where that would be all of it."""

CUTTERS: Mapping[str, Cutter] = {"parquet": cut_parquet, "table": cut_text}


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
            small = Path(folder) / path.name  # tables are called by the file's name
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
