"""Texts for messages: of logs, rigs and file names, which may contain anything, and numbers of things."""

from __future__ import annotations

import unicodedata
from pathlib import Path
from shlex import quote

LONGEST_TEXT = 256
"""Characters of a name or a quantity in a file: nested fields are put behind one another, numbers have all their digits."""

MAX_DEPTH = 32
"""Nested structures that are followed; messages of robots and rigs have fewer than ten levels, damaged ones any number."""

LONGEST_NAME = 180
"""Characters of a name, and bytes in a file's: file systems end at 255, and a prefix (``device=``), an ending come with it."""


def printable(text: str) -> str:
    """Return a text without active characters: control, format and surrogate characters become visible."""
    if text.isprintable():
        return text
    return "".join("�" if unicodedata.category(c) in ("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp") else c for c in text)


def command(*words: object) -> str:
    """Return a command of vsalog as it is typed: each word, such as a path, is quoted where a shell would change it."""
    return printable(" ".join(["vsalog", *(quote(str(word)) for word in words)]))


def named(path: Path) -> Path:
    """Return a path that ends with a name, for messages and the names of results; ``.`` and ``..`` end with none."""
    return path if path.name not in ("", "..") else path.resolve()


def plural(count: int, noun: str) -> str:
    """Return "1 message", "2 messages", "2 copies"."""
    if count == 1:
        return f"1 {noun}"
    return f"{count} {noun[:-1]}ies" if noun.endswith("y") else f"{count} {noun}s"


def size_text(size: float) -> str:
    """Return a number of bytes with a suitable unit, "1.5 GB"."""
    return f"{size / 1e9:.3g} GB" if size >= 1e9 else f"{size / 1e6:.3g} MB"
