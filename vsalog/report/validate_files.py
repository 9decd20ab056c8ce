"""Writes a validation's report: `report.json`, `report.html`, and figures for papers; each whole or not at all."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from vsalog.core.documents import document_text
from vsalog.core.errors import WriteError
from vsalog.report.drawings import Drawings
from vsalog.report.page import write_page
from vsalog.report.paper_figures import check_matplotlib, write_figures
from vsalog.rig.find import rig_beside
from vsalog.validation.document import Report
from vsalog.writers.atomic import make_folder, together, write_text


@dataclass(frozen=True, slots=True)
class Outputs:
    """Where the report goes."""

    document: Path
    page: Path
    figures: Path | None = None

    @classmethod
    def within(cls, folder: Path | None, figures: Path | None) -> Outputs:
        """Name the files; whether the figures can be drawn at all is seen before anything is done.

        Raises
        ------
        FigureError
            matplotlib is not installed.
        """
        if figures is not None:
            check_matplotlib()
        where = Path() if folder is None else folder
        return cls(where / "report.json", where / "report.html", figures)


def inputs_of(logs: Iterable[Path], rig: str | Path | None = None) -> list[Path]:
    """Return the files that a command reads: the logs, what a bag's folder holds, the rig that is given or lies next to them."""
    logs = list(logs)
    parts = [part for log in logs if log.is_dir() for part in log.iterdir()]
    rigs = [rig_beside(log) for log in logs] if rig is None else [Path(rig)]
    return [*logs, *parts, *(path for path in rigs if path is not None)]


def keep_inputs(outputs: Sequence[Path], inputs: Sequence[Path]) -> None:
    """Refuse to write over what is read, before anything is done.

    Raises
    ------
    WriteError
        An output is one of the inputs, or no file can be written there.
    """
    for output in outputs:
        for given in inputs:
            if output.exists() and given.exists() and output.samefile(given):
                raise WriteError(f"{output}: is what is read; choose another place for what is written")
        if output.is_dir():
            raise WriteError(f"{output}: is a folder; name a file")


def write_report(report: Report, drawings: Drawings, outputs: Outputs) -> None:
    """Write all of it.

    Raises
    ------
    WriteError
        A file cannot be written.
    """
    make_folder(outputs.document.parent)
    title = f"{report.model} against {', '.join(log.log for log in report.logs)}"
    if outputs.figures is not None:
        write_figures(outputs.figures, drawings.paper(), report)
    with together():
        write_page(outputs.page, title, report, drawings.page())
        write_text(outputs.document, document_text(report))
