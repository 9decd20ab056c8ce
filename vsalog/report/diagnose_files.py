"""Writes a diagnosis: `diagnosis.json`, `diagnosis.html` and `extended.rig.toml`; each whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from vsalog.core.documents import document_text
from vsalog.diagnosis.document import Diagnosis
from vsalog.diagnosis.evidence import JointEvidence
from vsalog.report.diagnose import diagnosis_document
from vsalog.report.html import page_of
from vsalog.report.quantities import plain
from vsalog.writers.atomic import check_path, make_folder, together, write_text


@dataclass(frozen=True, slots=True)
class Outputs:
    """Where the diagnosis goes.

    Attributes
    ----------
    document, page, rig : files
    rig_is : what became of `rig`: planned, written, none (there is nothing to extend), or old (nothing to extend, and a file of
        that name from before was left as it is)
    scenario : the experiment that is proposed; none where it was not asked for, or nothing is proposed
    """

    document: Path
    page: Path
    rig: Path
    rig_is: Literal["planned", "written", "none", "old"] = "planned"
    scenario: Path | None = None

    @classmethod
    def within(cls, folder: Path | None, suggest: bool = False) -> Outputs:
        """Name the files in a folder, the current one when absent; with a scenario where `suggest` says so."""
        where = Path() if folder is None else folder
        scenario = where / "next.scenario.toml" if suggest else None
        return cls(where / "diagnosis.json", where / "diagnosis.html", where / "extended.rig.toml", scenario=scenario)

    def pairs(self) -> Iterator[tuple[str, str]]:
        """Yield what each file is, and its path; and what became of a rig from before."""
        yield "report", str(self.page)
        yield "data", str(self.document)
        if self.rig_is == "written":
            yield "extended rig", str(self.rig)
        if self.scenario is not None:
            yield "next experiment", str(self.scenario)
        if self.rig_is == "old":
            was = "is from before and was left as it is: this diagnosis found nothing to extend the rig by."
            yield "note", f"{self.rig} {was}"


def write_diagnosis(
    diagnosis: Diagnosis,
    evidence: Sequence[JointEvidence],
    extended_rig_toml: str | None,
    outputs: Outputs,
    scenario_toml: str | None = None,
) -> Outputs:
    """Write all of it.

    Parameters
    ----------
    diagnosis : the document
    evidence : what the page's figures draw
    extended_rig_toml : the rig with the causes filled in; None where there is nothing to fill in: a file of that name that is
        there from before is never deleted, and said to be old
    outputs : where to
    scenario_toml : the experiment that is proposed; None where none is

    Returns
    -------
    The outputs, with what became of the extended rig and the scenario

    Raises
    ------
    WriteError
        A file cannot be written.
    """
    make_folder(outputs.document.parent)
    # Before anything is written, so that all are there or none is.
    proposed = outputs.scenario if scenario_toml is not None else None
    for path in (outputs.document, outputs.page, outputs.rig, *([proposed] if proposed else [])):
        check_path(path)
    with together():
        document = diagnosis_document(diagnosis, evidence=evidence, extended=extended_rig_toml)
        write_text(outputs.page, page_of(document))
        if extended_rig_toml is not None:
            write_text(outputs.rig, _heading(diagnosis) + extended_rig_toml)
            became = replace(outputs, rig_is="written")
        else:
            became = replace(outputs, rig_is="old" if outputs.rig.exists() else "none")
        if proposed is not None and scenario_toml is not None:
            write_text(proposed, scenario_toml)
        write_text(outputs.document, document_text(diagnosis))
    return replace(became, scenario=proposed)


def _heading(diagnosis: Diagnosis) -> str:
    """Say in the rig itself where it comes from; what a log is called must not end the comment."""
    causes = ", ".join(f"{c.cause} in joint {c.joint}" for c in diagnosis.causes)
    return plain(f"# Extended by vsalog {diagnosis.vsalog} with what {diagnosis.log} shows: {causes}") + "\n"
