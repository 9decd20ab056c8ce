"""The JSON Schema of `rig.toml`, which lets editors complete, explain and check rig files.

`python -m vsalog.rig.schema_file` prints it; `docs/rig.schema.json` is its output.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import msgspec
from msgspec import inspect

from vsalog.core.document_schema import field_descriptions, structure_description
from vsalog.rig.schema import RigFile
from vsalog.rig.uncertain import TOLERANCE_SIGN

_ID = "https://json-schema.org/draft/2020-12/schema"


def rig_schema() -> dict[str, Any]:
    """Return the JSON Schema (draft 2020-12) of a rig file.

    It is msgspec's own, with four differences: a quantity may be a text with a unit, a number without unit one with a
    tolerance, descriptions come key by key from the structures' docstrings, and a file that starts from a preset may leave
    out the preset's keys.
    """
    schema: dict[str, Any] = msgspec.json.schema(RigFile)
    definitions: dict[str, Any] = schema["$defs"]
    for struct in structures():
        _describe(definitions[struct.cls.__name__], struct)
    rig = definitions.pop("RigFile")
    strict_joints = rig["properties"]["joint"]
    rig["properties"]["joint"] = {"type": "object", "description": strict_joints.pop("description", "")}
    strict_joints["additionalProperties"].pop("discriminator", None)  # OpenAPI's, not JSON Schema's
    for definition in definitions.values():
        for schema in definition.get("properties", {}).values():
            schema.pop("discriminator", None)
    return {
        "$schema": _ID,
        "title": "vsalog rig file",
        **{key: rig[key] for key in ("description", "type", "properties", "additionalProperties")},
        "if": {"required": ["preset"]},
        "else": {"properties": {"joint": strict_joints}},
        "$defs": definitions,
    }


def structures() -> list[inspect.StructType]:
    """Return all structures of a rig file, each once, outermost first."""
    found: dict[str, inspect.StructType] = {}
    queue: list[inspect.Type] = [inspect.type_info(RigFile)]
    while queue:
        kind = queue.pop(0)
        if isinstance(kind, inspect.StructType):
            if kind.cls.__name__ in found:
                continue
            found[kind.cls.__name__] = kind
            queue.extend(field.type for field in kind.fields)
        else:
            queue.extend(_inside(kind))
    return list(found.values())


def _inside(kind: inspect.Type) -> Iterator[inspect.Type]:
    if isinstance(kind, inspect.UnionType):
        yield from kind.types
    elif isinstance(kind, inspect.Metadata):
        yield kind.type
    elif isinstance(kind, inspect.DictType):
        yield kind.value_type
    elif isinstance(kind, inspect.VarTupleType):
        yield kind.item_type


def _describe(definition: dict[str, Any], struct: inspect.StructType) -> None:
    """Put descriptions on a structure's definition and its keys, and let quantities be texts."""
    definition["description"] = structure_description(struct.cls)
    descriptions = field_descriptions(struct.cls)
    for field in struct.fields:
        schema = _without_null(definition["properties"][field.encode_name])
        schema = _with_text(schema, field.type)
        if isinstance(field.type, inspect.VarTupleType):
            schema["items"] = _with_text(schema["items"], field.type.item_type)
        if field.encode_name in descriptions:
            schema["description"] = descriptions[field.encode_name]
        definition["properties"][field.encode_name] = schema
    if struct.tag_field is not None:
        definition["properties"][struct.tag_field] = {"const": struct.tag}


def _without_null(schema: dict[str, Any]) -> dict[str, Any]:
    """Drop null, which TOML does not have."""
    schema = dict(schema)
    if schema.get("default", ...) is None:
        del schema["default"]
    options = [option for option in schema.pop("anyOf", []) if option.get("type") != "null"]
    if len(options) == 1:
        return {**options[0], **schema}
    return {**schema, "anyOf": options} if options else schema


def _with_text(schema: dict[str, Any], kind: inspect.Type) -> dict[str, Any]:
    """Allow a text with a unit or a tolerance in place of a number; the number's bounds do not apply to a text."""
    options = kind.types if isinstance(kind, inspect.UnionType) else (kind,)
    extras = [option.extra or {} for option in options if isinstance(option, inspect.Metadata)]
    if schema.get("type") != "number" or not extras:
        return schema
    text = {**schema, "type": ["number", "string"]}
    if any(extra.keys() & {"units", "role"} for extra in extras):
        return text
    return schema if any(extra.get("exact") for extra in extras) else {**text, "pattern": TOLERANCE_SIGN}


def schema_text() -> str:
    """Return the schema as written to `docs/rig.schema.json`."""
    return json.dumps(rig_schema(), indent=2, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    print(schema_text(), end="")
