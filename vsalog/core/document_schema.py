"""JSON Schemas of the documents that are written: msgspec's own, with the docstrings' words for each key.

`python -m docs.make_schemas` writes them into the manual.
"""

from __future__ import annotations

import inspect
import json
import re
from types import ModuleType
from typing import Any

import msgspec


def field_descriptions(cls: type) -> dict[str, str]:
    """Return key → description from the "Attributes" of a structure's docstring, and of those it extends."""
    found: dict[str, str] = {}
    for each in reversed(cls.__mro__):
        _, _, attributes = inspect.cleandoc(each.__doc__ or "").partition("Attributes\n----------\n")
        for names, words in re.findall(r"^(\w+(?:, \w+)*) : (.*(?:\n[ ]+.*)*)", attributes, re.MULTILINE):
            for name in names.split(", "):
                found[name] = " ".join(words.split())
    return found


def structure_description(cls: type) -> str:
    """Return what a structure's docstring says before its "Attributes", which releases of msgspec indent in different ways."""
    return (inspect.getdoc(cls) or "").partition("\n\nAttributes\n")[0]


def document_schema(module: ModuleType) -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a document.

    Parameters
    ----------
    module : with the document's structures, and the outermost one with title and description as `SCHEMA`; their version is
        its `VERSION`, or the outermost one's own default
    """
    root, title, description = module.SCHEMA
    defaults = {f.name: f.default for f in msgspec.structs.fields(getattr(module, root))}
    version = module.VERSION if hasattr(module, "VERSION") else defaults["version"]
    schema: dict[str, Any] = msgspec.json.schema(getattr(module, root))
    definitions: dict[str, Any] = schema["$defs"]
    for name, definition in definitions.items():
        words = field_descriptions(getattr(module, name))
        definition["description"] = structure_description(getattr(module, name))
        for key, part in definition.get("properties", {}).items():
            if key in words:
                part["description"] = words[key]
    return {
        **definitions.pop(root),
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"{title}, version {version}",
        "description": description,
        "$defs": definitions,
    }


def schema_text(module: ModuleType) -> str:
    """Return the schema as written to a file."""
    return json.dumps(document_schema(module), indent=2, ensure_ascii=False) + "\n"
