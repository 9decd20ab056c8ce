"""Writes a validation's report: `report.json`, `report.html`, and figures for papers; each whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from vsalog.core.documents import document_text
from vsalog.report.html import page_of
from vsalog.report.joint_figures import Drawings
from vsalog.report.paper_figures import check_matplotlib, write_figures
from vsalog.report.validate import report_document
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

    def pairs(self) -> Iterator[tuple[str, str]]:
        """Yield what each file is, and its path."""
        yield "report", str(self.page)
        yield "data", str(self.document)


def write_report(report: Report, drawings: Drawings, outputs: Outputs) -> None:
    """Write all of it.

    Raises
    ------
    WriteError
        A file cannot be written.
    """
    make_folder(outputs.document.parent)
    if outputs.figures is not None:
        write_figures(outputs.figures, drawings.paper, [log.log for log in report.logs])
    with together():
        write_text(outputs.page, page_of(report_document(report, drawn=drawings.page)))
        write_text(outputs.document, document_text(report))
