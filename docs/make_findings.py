"""Writes docs/findings.md from the catalogue of findings: ``python docs/make_findings.py``."""

import re
from itertools import groupby
from pathlib import Path

from vsalog.core.finding_texts import texts

FIELD = re.compile(r"{(\w+)(?::[^}]*)?}")


def plain(words: str) -> str:
    """Return a text with the names of its fields in place of formats."""
    return FIELD.sub(r"⟨\1⟩", words)


def reference() -> str:
    """Return the catalogue as Markdown."""
    parts = [
        "# Findings",
        "",
        "Written by `python docs/make_findings.py` from the catalogue in `vsalog/core/finding_texts.py`.",
    ]
    parts += [
        "",
        "A finding has a `code`, the `joint` and the `part` of it that it is about, a `severity` (`info`, `warning`, or",
    ]
    parts += [
        "`invalidates`: the estimate is not to be used), the `value` that was compared with a `limit`, their `unit`, and"
    ]
    parts += [
        "`evidence`, further numbers by name. `vsalog estimate --json` lists them under `findings` of each joint. Codes are"
    ]
    parts += ["stable; the words may change.", ""]
    catalogue = texts()
    for family, codes in groupby(catalogue, key=lambda code: code.split(".")[0]):
        parts += [f"## {family}", ""]
        for code in codes:
            text = catalogue[code]
            parts += [f"### {code}", "", plain(text.says), "", plain(text.advice), ""]
    return "\n".join(parts)


if __name__ == "__main__":
    Path(__file__).with_name("findings.md").write_text(reference(), encoding="utf-8")
