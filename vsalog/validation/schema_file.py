"""The JSON Schema of `report.json`.

`python -m vsalog.validation.schema_file` prints it; `docs/report.schema.json` is what it prints.
"""

from __future__ import annotations

import json
from typing import Any

import msgspec

from vsalog.rig.schema_file import field_descriptions
from vsalog.validation import document


def report_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12): msgspec's own, with the docstrings' words for each key."""
    schema: dict[str, Any] = msgspec.json.schema(document.Report)
    definitions: dict[str, Any] = schema["$defs"]
    for name, definition in definitions.items():
        words = field_descriptions(getattr(document, name))
        for key, part in definition.get("properties", {}).items():
            if key in words:
                part["description"] = words[key]
    report = definitions.pop("Report")
    return {
        **report,
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"vsalog validation report, version {document.VERSION}",
        "description": "What 'vsalog validate' found.",
        "$defs": definitions,
    }


def schema_text() -> str:
    """Return the schema as it stands in `docs/report.schema.json`."""
    return json.dumps(report_schema(), indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    print(schema_text(), end="")
