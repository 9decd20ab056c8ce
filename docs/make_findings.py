"""Writes docs/findings.md from the catalogue of findings: ``python docs/make_findings.py``."""

import re
from itertools import groupby
from pathlib import Path

from vsalog.core.finding_texts import texts
from vsalog.core.printable import plural

FIELD = re.compile(r"{(\w+)(?::[^}]*)?}")
COUNTED = re.compile(r"{(\w+):n ([^}]*)}")


def plain(words: str) -> str:
    """Return a text with the names of its fields in place of formats."""
    return FIELD.sub(r"⟨\1⟩", COUNTED.sub(lambda found: f"⟨{found[1]}⟩ {plural(2, found[2])[2:]}", words))


def reference() -> str:
    """Return the catalogue as Markdown."""
    parts = [
        "# Findings",
        "",
        "Written by `python docs/make_findings.py` from the catalogue in `vsalog/core/finding_texts.py`.",
    ]
    parts += [
        "",
        "A finding has a `code`, the `log`, the `joint` and the `part` (a transmission, roles, a stream, a column, a file) that",
        "it is about, a `severity` (`info`, `warning`, or `invalidates`: the estimate is not to be used), the `value` that was",
        "compared with a `limit`, their `unit`, and `evidence`, what else was measured, by name. `vsalog estimate --json` lists",
        "those of the logs and the rig under `findings`, those of a joint under `findings` of the joint; `vsalog inspect --json`",
        "those of each log. Codes are stable; the words may change.",
        "",
    ]
    catalogue = texts()
    for family, codes in groupby(catalogue, key=lambda code: code.split(".")[0]):
        parts += [f"## {family}", ""]
        for code in codes:
            text = catalogue[code]
            parts += [f"### {code}", "", plain(text.says), ""]
            parts += [plain(text.advice), ""] if text.advice else []
    return "\n".join(parts)


if __name__ == "__main__":
    Path(__file__).with_name("findings.md").write_text(reference(), encoding="utf-8")
