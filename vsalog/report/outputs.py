"""Output files: the files of a run, named before anything is done, never an input, and all written or none.

An existing file is overwritten with `--force`, or if it is an earlier result of the same logs: one that contains their
SHA-256. Files that people edit, as rigs and models, are sealed: an edited one is no result any more.
"""

from __future__ import annotations

import mmap
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from hashlib import sha256 as hashed
from pathlib import Path

from vsalog.core.documents import document_text
from vsalog.core.errors import WriteError
from vsalog.estimation.job import sha256
from vsalog.report.document import Document
from vsalog.report.html import page_of
from vsalog.rig.find import rig_beside
from vsalog.writers.atomic import FILE_SUFFIXES, check_path, made_folder, together, write_text


@dataclass(frozen=True, slots=True)
class Outputs:
    """The output files; a page, figures and a log of the trace only on request."""

    trace: Path
    model: Path
    mcap: Path | None = None
    page: Path | None = None
    figures: Path | None = None

    @classmethod
    def named(
        cls,
        logs: Sequence[Path],
        output: str | None,
        mcap: Path | None,
        page: Path | None = None,
        figures: Path | None = None,
    ) -> Outputs:
        """Name the results after the first log, in the current folder, or as `output` says.

        That is a folder if it exists or ends with a slash.

        Raises
        ------
        WriteError
            A result would overwrite one of the logs or another result, or the folder of a file does not exist.
        """
        stem = _stem(logs[0])
        if output is None or output.endswith(("/", os.sep)) or Path(output).is_dir():
            folder = Path(output or "")
            trace = folder / f"{stem}.stiffness.parquet"
        else:
            trace = Path(output)
            check_path(trace)
            folder = trace.parent
            stem = re.sub(r"(\.stiffness)?\.parquet$", "", trace.name)
        outputs = cls(trace, folder / f"{stem}.model.toml", mcap, page, figures)
        taken = {outputs.trace.resolve(): "-o", outputs.model.resolve(): "-o"}
        for path, option in ((mcap, "--mcap"), (page, "--report")):
            if path is not None:
                if path.resolve() in taken:
                    raise WriteError(f"{path}: is named twice, by {option} and by {taken[path.resolve()]}")
                taken[path.resolve()] = option
        if figures is not None and figures.exists() and not figures.is_dir():
            raise WriteError(f"{figures}: is no folder; name one for the figures")
        for path in (outputs.trace, outputs.model, outputs.mcap, outputs.page):
            if path is not None and any(path.exists() and log.exists() and path.samefile(log) for log in logs):
                raise WriteError(f"{path}: is the log itself; choose another name with -o")
        if trace.suffix.lower() in FILE_SUFFIXES and trace.suffix.lower() != ".parquet":
            raise WriteError(
                f"{trace}: a trace is a Parquet file, '{trace.with_suffix('.parquet')}'; for CSV, open that in Python:"
                " pandas.read_parquet(FILE).to_csv(OTHER)"
            )
        return outputs

    @property
    def written(self) -> dict[str, str]:
        """The files that the summary names: what each is → its path."""
        named = {"trace": self.trace, "model": self.model, "log of the trace": self.mcap}
        return {what: str(path) for what, path in named.items() if path is not None}


def _stem(log: Path) -> str:
    name = log.resolve().name
    return name if log.is_dir() else Path(name).stem


def report_paths(folder: Path | None, name: str, page: Path | None = None) -> tuple[Path, Path]:
    """Return the files for the page and the data of a report, in a folder, the current one when absent.

    Without a folder, the data are next to a page that is given, with its name.

    Raises
    ------
    WriteError
        The page cannot be written there.
    """
    if page is not None:
        check_path(page)
        return page, page.with_suffix(".json") if folder is None else folder / f"{name}.json"
    where = Path() if folder is None else folder
    return where / f"{name}.html", where / f"{name}.json"


def write_report(
    document: Document,
    folder: Path | None,
    name: str,
    others: Mapping[str, tuple[Path, str]] | None = None,
    page: Path | None = None,
) -> dict[str, str]:
    """Write a document as a page and its data as JSON, and other texts along with them: all of it or nothing.

    Parameters
    ----------
    document : of a command, with its figures
    folder : which is made; the current one when absent
    name : of both files, without a suffix
    others : what each is, its path in that folder, and its text
    page : file of the page, if not in that folder

    Returns
    -------
    What each file is, and its path

    Raises
    ------
    WriteError
        A file cannot be written.
    """
    page, data = report_paths(folder, name, page)
    texts = {"report": (page, page_of(document)), "data": (data, document_text(document.data)), **(others or {})}
    with made_folder(data.parent), together():
        for path, _ in texts.values():
            check_path(path)
        for path, text in texts.values():
            write_text(path, text)
    return {what: str(path) for what, (path, _) in texts.items()}


def inputs_of(logs: Iterable[Path], rig: str | Path | None = None) -> list[Path]:
    """Return the files that a command reads: the logs, what a bag's folder holds, the rig that is given or is next to them."""
    logs = list(logs)
    parts = [part for log in logs if log.is_dir() for part in log.iterdir()]
    rigs = [rig_beside(log) for log in logs] if rig is None else [Path(rig)]
    return [*logs, *parts, *(path for path in rigs if path is not None)]


SEAL = "# vsalog: written by vsalog, SHA-256 of the lines above and of the logs: "


def sealed(text: str, logs: Iterable[str]) -> str:
    """Return a TOML text with a last line that identifies it as long as nobody edits it.

    Parameters
    ----------
    text : of a rig, a model or a scenario
    logs : SHA-256 of each log that it comes from
    """
    return f"{text}{SEAL}{' '.join([_digest(text), *logs])}\n"


def require_new(
    outputs: Path | Iterable[Path | None] | None, force: bool, logs: Sequence[Path] = ()
) -> tuple[Path, ...]:
    """Refuse to overwrite existing files, except earlier results of the same logs.

    Parameters
    ----------
    outputs : files, or folders of figures
    force : overwrite them in any case
    logs : that a run reads; none where its results are of no log

    Returns
    -------
    The files that will be overwritten.

    Raises
    ------
    WriteError
        One exists, is no such result, and `force` is not given.
    """
    named = [outputs] if outputs is None or isinstance(outputs, Path) else outputs
    there = tuple(path for path in named if path is not None and _holds_something(path))
    if not there or force:
        return there
    digests = [sha256(log).encode() for log in logs if log.exists()]
    for path in there:
        if path.is_dir():
            raise WriteError(
                f"{path}: is a folder that contains files already; --force writes into it, another name keeps both"
            )
        if not digests or len(digests) < len(logs) or not _is_result(path, digests):
            results = " and is no unchanged result of the same log" if logs else ""
            raise WriteError(f"{path}: exists already{results}; --force overwrites it, another name keeps both")
    return there


def _holds_something(path: Path) -> bool:
    """Return whether something would be lost; what is neither a file nor a folder is refused elsewhere."""
    return any(path.iterdir()) if path.is_dir() else path.is_file()


def _is_result(path: Path, digests: Sequence[bytes]) -> bool:
    """Return whether a file contains the digests of all logs, and its seal is valid, which every TOML file has."""
    try:
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            if any(content.find(digest) < 0 for digest in digests):
                return False
            seal = content.rfind(SEAL.encode())
            if seal < 0:
                return path.suffix != ".toml"
            last, end, below = content[seal + len(SEAL.encode()) :].partition(b"\n")
            return bool(end) and not below and last.split()[:1] == [_digest(content[:seal]).encode()]
    except (OSError, ValueError):  # it cannot be read, or is empty
        return False


def _digest(text: str | bytes) -> str:
    return hashed(text.encode() if isinstance(text, str) else text).hexdigest()


def keep_inputs(outputs: Sequence[Path], inputs: Sequence[Path]) -> None:
    """Refuse to overwrite inputs, before anything is done.

    Raises
    ------
    WriteError
        An output is one of the inputs, or no file can be written there.
    """
    for output in outputs:
        for given in inputs:
            if output.exists() and given.exists() and output.samefile(given):
                raise WriteError(f"{output}: is an input; choose another output file")
        if output.is_dir():
            raise WriteError(f"{output}: is a folder; name a file")
