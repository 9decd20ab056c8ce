"""Writes a validation's report: `report.json`, `report.html`, and figures for papers; each whole or not at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from vsalog.errors import WriteError
from vsalog.validation.document import Report
from vsalog.validation.evidence import JointEvidence
from vsalog.writers.atomic import write_text


@dataclass(frozen=True, slots=True)
class Outputs:
    """Where the report goes."""

    document: Path
    page: Path
    figures: Path | None = None

    @classmethod
    def within(cls, folder: Path | None, figures: Path | None) -> Outputs:
        """Name the files; the folder is made when it is not there.

        Raises
        ------
        WriteError
            The folder cannot be made.
        """
        where = Path() if folder is None else folder
        for made in (where, figures):
            if made is not None:
                try:
                    made.mkdir(parents=True, exist_ok=True)
                except OSError as error:
                    raise WriteError(f"{made}: cannot be made a folder: {error.strerror}") from error
        return cls(where / "report.json", where / "report.html", figures)


def write_report(report: Report, evidence: Sequence[Sequence[JointEvidence]], outputs: Outputs) -> None:
    """Write all of it.

    Raises
    ------
    WriteError
        A file cannot be written.
    """
    write_text(outputs.document, msgspec.json.format(msgspec.json.encode(report), indent=2).decode() + "\n")
