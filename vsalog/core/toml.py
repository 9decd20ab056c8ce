"""Untrusted TOML: documents that would take a parser excessive memory or time are refused first."""

from __future__ import annotations

import re
import tomllib
from typing import Any

from vsalog.core.memory import PIECE_BYTES
from vsalog.core.printable import MAX_DEPTH

_PART = r"""(?:[\w+-]++|"(?:[^"\\\n]|\\[^\n])*+"?|'[^'\n]*+'?)"""
_TOKEN = re.compile(
    r'"""(?:[^\\]|\\.)*?(?:"""|\Z)'
    r"|'''.*?(?:'''|\Z)"
    r"|\#[^\n]*+"
    rf"|(?P<key>{_PART}(?:[ \t]*+\.[ \t]*+{_PART})*+)",
    re.DOTALL,
)


def parse_toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML document.

    Raises
    ------
    ValueError
        It is no TOML, too long, nested too deeply, or has a key of more parts than any of ours, for which the standard library
        takes memory and time with the square of their number.
    """
    if len(text) > PIECE_BYTES:
        raise ValueError(f"it is longer than {PIECE_BYTES // 1024} KiB")
    for token in _TOKEN.finditer(text):
        key = token["key"]
        if key and key.count(".") >= MAX_DEPTH and len(re.findall(_PART, key)) > MAX_DEPTH:
            line = text.count("\n", 0, token.start()) + 1
            raise ValueError(f"a key has more than {MAX_DEPTH} parts (at line {line})")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
