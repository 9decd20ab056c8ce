"""The JSON Schema of `report.json`.

`python -m vsalog.validation.schema_file` prints it; `docs/report.schema.json` is what it prints.
"""

from __future__ import annotations

from typing import Any

from vsalog.document_schema import as_text, document_schema
from vsalog.validation import document


def report_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12)."""
    title = f"vsalog validation report, version {document.VERSION}"
    return document_schema(document, "Report", title, "What 'vsalog validate' found.")


def schema_text() -> str:
    """Return the schema as it stands in `docs/report.schema.json`."""
    return as_text(report_schema())


if __name__ == "__main__":
    print(schema_text(), end="")
