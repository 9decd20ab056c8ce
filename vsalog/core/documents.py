"""Structures as JSON documents and TOML tables, and the text files that people write."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from vsalog.core.errors import VsalogError
from vsalog.core.memory import PIECE_BYTES


def document_text(document: Any) -> str:
    r"""Return a document as indented JSON with a line end behind it.

    A file's name may have bytes that are no text, which JSON cannot represent: they are written as ``\xff``.

    Parameters
    ----------
    document : structure, or what msgspec can write
    """
    return msgspec.json.format(json_text(document), indent=2) + "\n"


def json_text(document: Any) -> str:
    """Return a document as JSON in one line, with such names written likewise."""
    try:
        return msgspec.json.encode(document).decode()
    except UnicodeEncodeError:
        return msgspec.json.encode(_readable(msgspec.to_builtins(document))).decode()


def toml_tables(structure: Any) -> dict[str, Any]:
    """Return a structure as tables for TOML, without None, which TOML lacks, and without empty values."""
    tables = _without_empty(msgspec.to_builtins(structure))
    assert isinstance(tables, dict)
    return tables


def _without_empty(value: Any) -> Any:
    if isinstance(value, dict):
        kept = {key: _without_empty(item) for key, item in value.items() if item is not None}
        return {key: item for key, item in kept.items() if item not in ({}, [], ())}
    if isinstance(value, list | tuple):
        return [_without_empty(item) for item in value]
    return value


def _readable(value: Any) -> Any:
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode()
    if isinstance(value, dict):
        return {_readable(key): _readable(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_readable(item) for item in value]
    return value


def read_text(path: Path, what: str, kind: type[VsalogError], most: int | None = PIECE_BYTES) -> str:
    """Read a text file that a person wrote or was given.

    Parameters
    ----------
    path : of the file
    what : it should be, such as "rig file"
    kind : of the error
    most : bytes; None for any number

    Raises
    ------
    VsalogError
        Of that kind: the file cannot be read, is too large, or is no text.
    """
    try:
        if most is not None and path.stat().st_size > most:
            raise kind(f"{path.name}: more than {most // 1024} KiB is no {what}")
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise kind(f"{path.name}: cannot be read ({error.strerror})") from error
    except UnicodeDecodeError as error:
        raise kind(f"{path.name}: is not UTF-8 text (byte {error.start}), so it is no {what}") from error
