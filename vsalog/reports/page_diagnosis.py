"""The page of a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vsalog.diagnosis.document import Diagnosis
from vsalog.diagnosis.evidence import JointEvidence
from vsalog.reports.page import assembled
from vsalog.reports.page_text import escaped
from vsalog.writers.atomic import write_text


def write_diagnosis_page(
    path: Path, diagnosis: Diagnosis, evidence: Sequence[JointEvidence], extended_rig_toml: str | None
) -> None:
    """Write a diagnosis as one page."""
    top = "".join(f"<p>{escaped(s)}</p>" for s in diagnosis.sentences)
    write_text(path, assembled(f"What is wrong in {diagnosis.log}", "Diagnosis", top, [], ""))
