"""What all commands print alike: the console of a terminal or a pipe, and a line per finding."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable

from rich.console import Console
from rich.markup import escape
from rich.measure import Measurement
from rich.table import Table

from vsalog.core.finding import Finding, Severity
from vsalog.core.finding_texts import by_severity
from vsalog.core.printable import printable

WORDS: dict[Severity, str] = {"info": "note", "warning": "warning", "invalidates": "invalid"}
"""What a line about a finding begins with."""
STYLES: dict[Severity, str] = {"info": "cyan", "warning": "yellow", "invalidates": "bold red"}


def console_for_stdout(markup: bool = False) -> Console:
    """Return a console that breaks lines on a terminal only, or where the environment states its width.

    Parameters
    ----------
    markup : whether brackets in what is printed are rich's markup
    """
    wide = not (sys.stdout.isatty() or "COLUMNS" in os.environ)
    return Console(highlight=False, emoji=False, markup=markup, width=sys.maxsize if wide else None)


def fits(table: Table, console: Console) -> bool:
    """Tell whether the table's natural width is within the console's: rich's own measure is clipped to it."""
    options = console.options.update(width=sys.maxsize, max_width=sys.maxsize)
    return Measurement.get(console, options, table).maximum <= console.width


def print_findings(findings: Iterable[Finding]) -> None:
    """Print findings for people, each after its severity, on stderr, where a pipe does not lose them."""
    errors = Console(stderr=True, highlight=False)
    for severity, sentence in by_severity(findings):
        errors.print(f"[{STYLES[severity]}]{WORDS[severity]}:[/] {escape(printable(sentence))}", soft_wrap=True)
