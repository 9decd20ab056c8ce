"""Document of `export`: what was written, notes on it, and what was left out."""

from __future__ import annotations

from pathlib import Path

from vsalog.core.units import shown
from vsalog.effects.counterpart import Dialect
from vsalog.export.run import Exported
from vsalog.report.document import Document, Words


def export_document(model: Exported, dialect: Dialect, output: Path | None) -> Document:
    """Return the notes on a model."""
    where = "stdout" if output is None else shown(str(output))
    lines = [f"{where}: {dialect.upper()} of {', '.join(map(shown, model.joints))}"]
    lines += [f"  {note}" for note in model.notes]
    lines += [f"  left out: {key}: {reason}" for key, reason in model.left_out.items()]
    data = {"joints": list(model.joints), "notes": list(model.notes), "left_out": dict(model.left_out)}
    return Document("Export", "", tuple(map(Words, lines)), data)
