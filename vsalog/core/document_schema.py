"""JSON Schemas of the documents that are written: msgspec's own, with the docstrings' words for each key.

`python -m docs.make_schemas` writes them into the manual.
"""

from __future__ import annotations

import json
from types import ModuleType
from typing import Any

import msgspec

from vsalog.rig.schema_file import field_descriptions


def document_schema(module: ModuleType) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a document.

    Parameters
    ----------
    module : that holds the document's structures, their `VERSION`, and the outermost one with title and description as `SCHEMA`
    """
    root, title, description = module.SCHEMA
    schema: dict[str, Any] = msgspec.json.schema(getattr(module, root))
    definitions: dict[str, Any] = schema["$defs"]
    for name, definition in definitions.items():
        words = field_descriptions(getattr(module, name))
        for key, part in definition.get("properties", {}).items():
            if key in words:
                part["description"] = words[key]
    return {
        **definitions.pop(root),
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"{title}, version {module.VERSION}",
        "description": description,
        "$defs": definitions,
    }


def schema_text(module: ModuleType) -> str:
    """Return the schema as it stands in a file."""
    return json.dumps(document_schema(module), indent=2, ensure_ascii=False) + "\n"
