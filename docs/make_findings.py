"""Writes docs/reference/findings from the catalogue of findings: ``python docs/make_findings.py``."""

import ast
from collections import defaultdict
from itertools import groupby
from pathlib import Path

import vsalog
from vsalog.core.finding_texts import TEXTS
from vsalog.report.explain import Explanation, explained_findings

FOLDER = Path(__file__).parent / "reference" / "findings"
# Page → title, and the families of codes that stand there; other families stand on the last page.
REST = "estimates"
PAGES: dict[str, tuple[str, tuple[str, ...]]] = {
    "recordings": ("files and tables", ("channel", "compressed", "recording", "repair", "table")),
    "clocks": ("clocks", ("clock",)),
    "signals": (
        "signals and sensors",
        (
            "acceleration", "accelerometer", "deflection", "encoder", "external_torque", "motor_torque", "pressure", "sampling",
            "sensor", "setpoint", "signal", "torque",
        ),
    ),
    "rigs": ("rig files", ("guess", "rig")),
    "validation": ("validation", ("error", "validation")),
    "diagnosis": ("diagnosis and identification", ("diagnosis", "identification")),
    REST: ("estimates", ()),
}  # fmt: skip


def severities() -> dict[str, list[str]]:
    """Return code → the severities of the `Finding`s and `partial`s that the package raises it with; a code may be in a table."""
    found = defaultdict[str, set[str]](set)
    for path in Path(vsalog.__file__).parent.rglob("*.py"):
        nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
        partials = {
            target.id: _severity(node.value, {})
            for node in nodes
            if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call)
            for target in node.targets
            if isinstance(target, ast.Name)
        }
        tables = {
            ast.unparse(node.target if isinstance(node, ast.AnnAssign) else node.targets[0]): node.value
            for node in nodes
            if isinstance(node, ast.Assign | ast.AnnAssign) and isinstance(node.value, ast.Dict)
        }
        for call in (node for node in nodes if isinstance(node, ast.Call)):
            given = [c for k in call.keywords if k.arg == "code" for c in ast.walk(k.value)]
            given += [c for name in given if isinstance(name, ast.Name) for c in ast.walk(tables.get(name.id, name))]
            for code in given:
                if isinstance(code, ast.Constant) and code.value in TEXTS:
                    found[code.value].add(_severity(call, partials))
    return {code: sorted(found[code]) or ["warning"] for code in TEXTS}


def _severity(call: ast.Call, partials: dict[str, str]) -> str:
    """Return the severity that a call gives, or the `partial` that it completes."""
    given = (k.value.value for k in call.keywords if k.arg == "severity" and isinstance(k.value, ast.Constant))
    return str(next(given, partials.get(call.func.id, "warning") if isinstance(call.func, ast.Name) else "warning"))


HEAD = """# Findings

Written by `python docs/make_findings.py` from the catalogue in `vsalog/core/finding_texts.py` and what checks add to it.

A finding has a `code`, the `log`, the `joint` and the `part` (a transmission, roles, a stream, a column, a file) that it is
about, a `severity`, the `value` that was compared with a `limit`, their `unit`, and `evidence`, what else was measured, by
name. Codes are stable; the words may change. The severity is `info` where something is good to know, `invalidates` where the
result is not to be used, and `warning` else: of an estimate that is invalidated nothing counts as excited, and a model cannot
be judged by what invalidates a validation. A false-alarm rate is the probability with which a sound joint or channel has the
finding by chance.

`--json` of `estimate`, `validate`, `diagnose`, `compare` and `inspect` lists them under `findings`, those of a joint with the
joint, and a validation those that its verdict rests on under `reasons`; `report.json` and `diagnosis.json` have the same. A
trace's Parquet file has them as JSON in its own metadata (`vsalog.findings`), the summary of a batch their codes in the column
`codes`. `vsalog explain CODE` prints the texts of these pages.
"""


def _page_of(family: str) -> str:
    return next((stem for stem, (_, families) in PAGES.items() if family in families), REST)


def entry(found: Explanation, severity: list[str]) -> list[str]:
    """Return what a page has of a code."""
    texts = (*found.texts, *(f"{what}: {fact}" for what, fact in found.facts.items()))
    return [
        f"## {found.name}",
        "",
        f"Severity: {', '.join(severity)}.",
        "",
        *(line for text in texts for line in (text, "")),
    ]


def pages() -> dict[str, str]:
    """Return the catalogue: name of a page → Markdown."""
    found = explained_findings()
    raised = severities()
    lines = {stem: [f"# Findings: {title}", ""] for stem, (title, _) in PAGES.items()}
    index = [HEAD, "| codes | page |", "| --- | --- |"]
    for family, codes in groupby(found, key=lambda code: code.split(".")[0]):
        stem = _page_of(family)
        index.append(f"| `{family}.…` | [{PAGES[stem][0]}]({stem}.md) |")
        for code in codes:
            lines[stem] += entry(found[code], raised[code])
    index += ["", "```{toctree}", ":hidden:", "", *PAGES, "```", ""]
    return {"index": "\n".join(index), **{stem: "\n".join(text) for stem, text in lines.items()}}


if __name__ == "__main__":
    for name, page in pages().items():
        (FOLDER / f"{name}.md").write_text(page, encoding="utf-8")
