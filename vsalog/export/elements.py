"""XML as models of all formats write it. Nothing here reads XML, and no other module of vsalog knows it."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np

from vsalog.core.printable import printable

Element = ET.Element


def number(value: Any) -> str:
    """Return a number, several numbers or a text as an attribute has them; all digits that a float has, no needless ones."""
    if isinstance(value, str):
        return value
    values = np.atleast_1d(np.asarray(value, dtype=np.float64))
    return " ".join(repr(float(v) + 0.0).removesuffix(".0") for v in values)


def child(parent: ET.Element, element: str, **attributes: Any) -> ET.Element:
    """Add an element; numbers become text."""
    return ET.SubElement(parent, element, {name.rstrip("_"): number(value) for name, value in attributes.items()})


def comment(parent: ET.Element, text: str) -> None:
    """Add a comment; two dashes in a row would end it."""
    parent.append(ET.Comment(f" {re.sub('-(?=-)', '- ', printable(text))} "))


def plain_names(names: Iterable[str]) -> dict[str, str]:
    """Return names → unique names of letters, digits and underscores."""
    found: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"\W", "_", name, flags=re.ASCII) or "_"
        while plain in found.values():
            plain += "_"
        found[name] = plain
    return found


def text_of(root: ET.Element) -> str:
    """Return the document, indented."""
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
