"""Renders documents as HTML: a file that needs nothing else, in particular no network.

It contains plotly's script, compressed, which makes the page a third of its size; a policy in the page forbids every request.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from importlib import resources
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from vsalog.core.finding_texts import merged
from vsalog.core.printable import printable
from vsalog.figures.chart import chart_data
from vsalog.report.document import SEVERITIES, Block, Document, Figures, Section, Source, charts_in


def page_of(document: Document) -> str:
    """Return a document as HTML; every text in it is escaped by the templates."""
    library = _library() if any(charts_in(document.items)) else ("", b"")
    scripts = (_asset("page.js").encode(), library[1])
    digests = (base64.b64encode(hashlib.sha256(script).digest()).decode("ascii") for script in scripts if script)
    # plotly's surfaces make functions of texts.
    policy = " ".join(f"'sha256-{digest}'" for digest in digests) + (" 'unsafe-eval'" if library[1] else "")
    return _templates().get_template("page.html").render(document=document, library=library[0], scripts=Markup(policy))


def fragment_of(document: Document) -> str:
    """Return a document's sentences and tables as HTML for an existing page, as a notebook; every text is escaped."""
    return _templates().get_template("fragment.html").render(document=document, items=_plain(document.items))


def _plain(items: Sequence[Block]) -> tuple[Block, ...]:
    """Leave out figures, sources, and blocks for pages only."""
    kept: list[Block] = []
    for item in items:
        if isinstance(item, Section) and item.where != "page":
            kept.append(replace(item, items=_plain(item.items)))
        elif not isinstance(item, Figures | Source | Section):
            kept.append(item)
    return tuple(kept)


@cache
def _templates() -> Environment:
    """Return the templates; their output is stripped of control characters and escaped."""
    templates = Environment(
        loader=PackageLoader("vsalog.report"), autoescape=True, undefined=StrictUndefined, finalize=_printed,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    templates.filters |= {"chart": chart_data, "merged": merged}
    templates.globals |= {"asset": lambda file: Markup(_asset(file)), "severities": SEVERITIES}
    templates.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    return templates


def _printed(value: Any) -> Any:
    if isinstance(value, Markup) or not isinstance(value, str):
        return value
    return "\n".join(map(printable, value.split("\n")))


def _asset(file: str) -> str:
    return resources.files("vsalog.report").joinpath("templates", file).read_text(encoding="utf-8")


@cache
def _library() -> tuple[str, bytes]:
    """Return plotly's script, compressed, as base64, and as it is."""
    script = resources.files("plotly").joinpath("package_data", "plotly.min.js").read_bytes()
    return base64.b64encode(gzip.compress(script, 6, mtime=0)).decode("ascii"), script
