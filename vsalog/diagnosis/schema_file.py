"""The JSON Schema of `diagnosis.json`.

`python -m vsalog.diagnosis.schema_file` prints it; `docs/diagnosis.schema.json` is what it prints.
"""

from __future__ import annotations

from typing import Any

from vsalog.diagnosis import document
from vsalog.document_schema import as_text, document_schema


def diagnosis_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12)."""
    title = f"vsalog diagnosis, version {document.VERSION}"
    return document_schema(document, "Diagnosis", title, "What 'vsalog diagnose' found.")


def schema_text() -> str:
    """Return the schema as it stands in `docs/diagnosis.schema.json`."""
    return as_text(diagnosis_schema())


if __name__ == "__main__":
    print(schema_text(), end="")
