"""Renders documents on a terminal: lines wrapped between words, tables whole, transposed or in blocks, no number cut."""

from __future__ import annotations

import os
import sys
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from io import StringIO

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table as Grid
from rich.text import Text

from vsalog.core.documents import document_text
from vsalog.core.finding import Finding, Severity
from vsalog.core.printable import printable
from vsalog.report.document import (
    SEVERITIES,
    Block,
    Cell,
    Document,
    Facts,
    Notes,
    Section,
    Table,
    Tone,
    Verdict,
    Words,
    with_severity,
)
from vsalog.report.verbosity import Verbosity, verbosity

STYLES: dict[Severity, str] = {"info": "cyan", "warning": "yellow", "invalidates": "bold red"}
STYLES_OF_TONES: dict[Tone, str] = {"": "", "good": "green", "open": "yellow", "bad": "bold red"}


def console_for(stream: str = "stdout") -> Console:
    """Return a console that breaks lines on a terminal only, or where the environment states its width.

    A quiet command prints only findings on stderr.
    """
    wide = not (getattr(sys, stream).isatty() or "COLUMNS" in os.environ)
    width = sys.maxsize if wide else None
    quiet = stream == "stderr" and verbosity() == Verbosity.QUIET
    return Console(stderr=stream == "stderr", highlight=False, emoji=False, markup=False, width=width, quiet=quiet)


def print_out(document: Document, as_json: bool) -> None:
    """Print a document for people, or its data as JSON."""
    if as_json:
        print_data(document)
    else:
        print_document(document)


def print_document(document: Document, console: Console | None = None) -> None:
    """Print a document for people: findings on stderr, where a pipe does not lose them."""
    _print(document.items, console or console_for(), 0)


def text_of(document: Document) -> str:
    """Return what is printed of a document for people, with its findings in place; no line is wrapped."""
    text = StringIO()
    # In a notebook rich would display the text there, and not write it.
    console = Console(
        file=text, width=sys.maxsize, color_system=None, force_jupyter=False, highlight=False, emoji=False, markup=False
    )
    _print(document.items, console, 0, console)
    return text.getvalue()


def print_data(document: Document) -> None:
    """Print a document's data as JSON."""
    sys.stdout.buffer.write(document_text(document.data).encode())
    sys.stdout.buffer.flush()


def print_findings(findings: Iterable[Finding], errors: Console | None = None) -> None:
    """Print findings on stderr after their severity: one line per cause, unless all are requested."""
    errors = errors or Console(stderr=True, highlight=False, emoji=False)
    for severity, sentence in with_severity(findings):
        if severity == "info" and verbosity() == Verbosity.QUIET:
            continue
        line = Text.assemble((f"{SEVERITIES[severity]}:", STYLES[severity]), f" {printable(sentence)}")
        errors.print(line, soft_wrap=True)


def _print(items: Sequence[Block], console: Console, depth: int, errors: Console | None = None) -> None:
    for i, item in enumerate(items):
        if item.where == "page":
            continue
        if isinstance(item, Section):
            if item.verdict is not None:
                _verdict(item.verdict, console)
            elif item.title:
                if i or depth:
                    console.print()
                _line(console, item.title, "", "bold")
            _print(item.items, console, depth + 1, errors)
        elif isinstance(item, Verdict):
            _verdict(item, console)
        elif isinstance(item, Words):
            _line(console, item.text, "  " if depth else "")
        elif isinstance(item, Notes):
            print_findings(item.findings, errors)
        elif isinstance(item, Facts):
            for key, value in item.pairs:
                console.print(Text(printable(f"{key}: {value}")), soft_wrap=True)
        elif isinstance(item, Table) and item.rows:
            _line(console, item.caption, "", "italic")
            for part in shaped(item, console):
                console.print(part)


def _verdict(verdict: Verdict, console: Console) -> None:
    line = Text.assemble(
        (printable(verdict.about), "bold"), ": ", (printable(verdict.word), STYLES_OF_TONES[verdict.tone])
    )
    if line.cell_len <= console.width:
        console.print(line)
    else:
        _line(console, line.plain, "", STYLES_OF_TONES[verdict.tone])
    for sentence in () if verdict.brief else verdict.sentences:
        _line(console, sentence, "  ")


def _line(console: Console, text: str, indent: str, style: str = "") -> None:
    """Print a text of any length, wrapped between words; leading spaces of its own are further indent."""
    indent += " " * (len(text) - len(text.lstrip(" ")))
    for line in _broken(text.strip(), console, indent, console.is_terminal):
        console.print(Text(line, style=style), soft_wrap=True)


def _broken(text: str, console: Console, indent: str, words: bool = True) -> list[str]:
    """Wrap a text into lines, and on request words that are longer than a line."""
    return textwrap.wrap(
        printable(text), max(console.width, 20), initial_indent=indent, subsequent_indent=indent, break_long_words=words,
        break_on_hyphens=False,
    )  # fmt: skip


def shaped(table: Table, console: Console) -> Iterator[Grid | Text]:
    """Yield a table as it fits: whole, its rows as columns, in blocks of columns, else a list per row.

    Parameters
    ----------
    table : with at least one row
    console : as wide as this is

    Returns
    -------
    What to print, of which no line that can be broken is wider than the console, and no cell is cut
    """
    turned = _turned(table) if len(table.rows) <= len(table.heads) - table.keys else table
    for below in (False, True):
        for whole in (table, turned):
            grid = _grid(whole, below)
            if _fits(grid, console):
                yield grid
                return
    blocks = list(_blocks(table, console))
    if all(_fits(block, console) for block in blocks):
        yield from blocks
        return
    for row in table.cells():
        named = list(zip(table.heads, map(_said, row), strict=True))
        names = ", ".join(f"{head} {cell}".strip() for head, cell in named[: table.keys])
        yield from (Text(line, "bold") for line in _broken(names, console, "  "))
        for head, cell in named[table.keys :]:
            if cell:
                yield from map(Text, _broken(f"{head}  {cell}".strip(), console, "    "))


def _blocks(table: Table, console: Console) -> Iterator[Grid]:
    """Yield the columns that name a row with as many others as there is room for, until all are there."""
    block: list[int] = []
    for column in range(table.keys, len(table.heads)):
        if block and not _fits(_grid(_of(table, [*block, column]), True), console):
            yield _grid(_of(table, block), True)
            block = []
        block.append(column)
    yield _grid(_of(table, block), True)


def _of(table: Table, columns: Sequence[int]) -> Table:
    """Return a table with the columns that name a row, and some of the others."""
    kept = [*range(table.keys), *columns]
    rows = tuple(tuple(row[i] for i in kept) for row in table.rows)
    texts = sum(i < table.texts for i in kept)
    return replace(table, heads=tuple(table.heads[i] for i in kept), rows=rows, texts=texts)


def _turned(table: Table) -> Table:
    """Return a table whose columns are the rows."""
    columns = zip(*table.cells(), strict=True)
    rows = tuple((head, *cells) for head, cells in zip(table.heads, columns, strict=True))
    return Table(table.caption, ("",) * (1 + len(table.rows)), rows)


def _fits(grid: Grid, console: Console) -> bool:
    """Return whether the natural width is within the console's: rich's own measure is clipped to it."""
    options = console.options.update(width=sys.maxsize, max_width=sys.maxsize)
    return Measurement.get(console, options, grid).maximum <= console.width


def _grid(table: Table, below: bool) -> Grid:
    """Return a table as rich draws it, the details of cells next to their texts, or below."""
    grid = Grid(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim", show_header=any(table.heads))
    for i, head in enumerate(table.heads):
        grid.add_column(Text(printable(head)), justify="left" if i < table.texts else "right", no_wrap=True)
    for row in table.cells():
        grid.add_row(*(Text(_said(cell, below), STYLES_OF_TONES[cell.tone]) for cell in row))
    return grid


def _said(cell: Cell, below: bool = False) -> str:
    detail = f"({printable(cell.detail)})" if cell.detail and not cell.brief else ""
    return ("\n" if below else " ").join(filter(None, (printable(cell.text), detail)))
