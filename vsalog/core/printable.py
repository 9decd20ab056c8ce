"""Texts from logs, rigs and file names, for messages: they may hold anything."""

from __future__ import annotations


def printable(text: str) -> str:
    """Return a text with everything replaced that a terminal would obey, or that has no looks."""
    return text if text.isprintable() else "".join(c if c.isprintable() else "�" for c in text)
