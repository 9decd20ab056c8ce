"""Results as JSON documents."""

from __future__ import annotations

from typing import Any

import msgspec


def document_text(document: Any) -> str:
    r"""Return a document as indented JSON with a line end behind it.

    A file's name may have bytes that are no text, which JSON has no place for: they are written as ``\xff``.

    Parameters
    ----------
    document : structure, or what msgspec can write
    """
    try:
        raw = msgspec.json.encode(document)
    except UnicodeEncodeError:
        raw = msgspec.json.encode(_readable(msgspec.to_builtins(document)))
    return msgspec.json.format(raw, indent=2).decode() + "\n"


def _readable(value: Any) -> Any:
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode()
    if isinstance(value, dict):
        return {_readable(key): _readable(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_readable(item) for item in value]
    return value
