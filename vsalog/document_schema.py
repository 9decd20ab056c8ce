"""JSON Schemas of the documents that are written: msgspec's own, with the docstrings' words for each key."""

from __future__ import annotations

import json
from types import ModuleType
from typing import Any

import msgspec

from vsalog.rig.schema_file import field_descriptions


def document_schema(module: ModuleType, root: str, title: str, description: str) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a document.

    Parameters
    ----------
    module : that holds the document's structures
    root : name of the outermost
    title, description : of the schema
    """
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
        "title": title,
        "description": description,
        "$defs": definitions,
    }


def as_text(schema: dict[str, Any]) -> str:
    """Return a schema as it stands in a file."""
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"
