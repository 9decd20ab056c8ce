"""The output of a command as one tree: `terminal` prints it, `html` renders it as a page, and its data are its JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

from vsalog.core.finding import Finding, Severity
from vsalog.core.finding_texts import by_severity, merged
from vsalog.core.notation import transmission_title
from vsalog.figures.chart import Chart, Charts
from vsalog.report.verbosity import Verbosity, verbosity

Tone = Literal["", "good", "open", "bad"]
"""The colour of a verdict; its word has the same meaning."""
TONES: dict[str, Tone] = {
    "holds": "good",
    "fails": "bad",
    "undecided": "open",
    "cannot be judged": "open",
    "consistent": "good",
    "consistent as far as checked": "good",
    "explained": "",
    "partly explained": "open",
    "unexplained": "bad",
}
"""The tones of a validation's and a diagnosis' verdicts."""
Where = Literal["both", "page", "terminal"]
"""Where a block is rendered: a terminal leaves out what fills screens, a page what names the page."""

SEVERITIES: dict[Severity, str] = {"info": "note", "warning": "warning", "invalidates": "invalid"}
"""The first word of a line about a finding."""


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of a table: plain texts all of them.

    Attributes
    ----------
    text : its content
    detail : printed in smaller letters, such as an interval
    brief : a terminal leaves the detail out
    tone : of a verdict
    share : what a bar shows next to the text, 0 to 1
    value : what the table is sorted by; the text when None
    links : texts and addresses
    more : what a page shows on a click
    """

    text: str
    detail: str = ""
    brief: bool = False
    tone: Tone = ""
    share: float | None = None
    value: float | str | None = None
    links: tuple[tuple[str, str], ...] = ()
    more: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Words:
    """A paragraph."""

    kind: ClassVar[str] = "words"
    text: str
    where: Where = "both"


@dataclass(frozen=True, slots=True)
class Verdict:
    """A verdict: a word, and sentences that explain it.

    Attributes
    ----------
    about, word, tone : what is judged, the word, and its colour
    sentences : that explain it
    brief : a terminal leaves them out, since a table below has the same content
    """

    kind: ClassVar[str] = "verdict"
    about: str
    word: str
    tone: Tone
    sentences: tuple[str, ...] = ()
    where: Where = "both"
    brief: bool = False


@dataclass(frozen=True, slots=True)
class Notes:
    """Findings, which a terminal prints on stderr."""

    kind: ClassVar[str] = "notes"
    findings: tuple[Finding, ...]
    where: Where = "both"


@dataclass(frozen=True, slots=True)
class Facts:
    """Keys and values."""

    kind: ClassVar[str] = "facts"
    pairs: tuple[tuple[str, str], ...]
    where: Where = "both"


@dataclass(frozen=True, slots=True)
class Table:
    """A table.

    Attributes
    ----------
    caption : a few words
    heads : of the columns
    rows : of cells; a text is a cell with that text
    keys : number of leading columns that name the row
    texts : number of leading columns of words; the others hold numbers
    sortable : a page sorts it by the heading that is clicked
    """

    kind: ClassVar[str] = "table"
    caption: str
    heads: tuple[str, ...]
    rows: tuple[tuple[Cell | str, ...], ...]
    keys: int = 1
    texts: int = 1
    sortable: bool = False
    where: Where = "both"

    def cells(self) -> Iterator[list[Cell]]:
        """Yield the rows as cells."""
        for row in self.rows:
            yield [Cell(cell) if isinstance(cell, str) else cell for cell in row]

    def without_first(self) -> Table:
        """Return the table without its first column, which names a row."""
        rows = tuple(row[1:] for row in self.rows)
        return replace(self, heads=self.heads[1:], rows=rows, keys=self.keys - 1, texts=self.texts - 1)


@dataclass(frozen=True, slots=True)
class Source:
    """A text of several lines as it is: a rig, or the difference of two."""

    kind: ClassVar[str] = "source"
    caption: str
    text: str
    folded: bool = False
    where: Where = "page"


@dataclass(frozen=True, slots=True)
class Figures:
    """Charts; those of one group are zoomed together."""

    kind: ClassVar[str] = "figures"
    charts: tuple[Chart, ...]
    group: str = ""
    where: Where = "page"


@dataclass(frozen=True, slots=True)
class Section:
    """A part with a heading; a terminal prints the verdict instead of the heading where there is one."""

    kind: ClassVar[str] = "section"
    title: str
    items: tuple[Block, ...]
    verdict: Verdict | None = None
    where: Where = "both"


Block = Words | Verdict | Notes | Facts | Table | Source | Figures | Section


@dataclass(frozen=True, slots=True)
class Document:
    """The whole output of a command.

    Attributes
    ----------
    title : of the page
    about : what the page is
    items : the blocks
    data : what is printed as JSON
    """

    title: str
    about: str
    items: tuple[Block, ...]
    data: Any = None


def charts_in(items: Sequence[Block]) -> Iterator[Chart]:
    """Yield the charts of all blocks."""
    for item in items:
        if isinstance(item, Section):
            yield from charts_in(item.items)
        elif isinstance(item, Figures):
            yield from item.charts


def led(
    charts: Charts, name: str, key: str, about: Mapping[str, Sequence[Block]] | None = None
) -> tuple[list[Block], list[Block]]:
    """Return the figure that a joint begins with, of its last transmission, which is the sum of several; and its other figures.

    Parameters
    ----------
    charts : of a joint
    name : of the chart that leads
    key : of the joint: its figures over time are zoomed together, transmission by transmission
    about : texts above a transmission's figures
    """
    last = list(charts)[-1] if charts else ""
    lead = [chart for chart in charts.get(last, ()) if chart.name == name]
    rest: list[Block] = []
    for part, own in charts.items():
        shown = tuple(chart for chart in own if part != last or chart.name != name)
        title = "" if len(charts) == 1 else transmission_title(part)
        rest.append(Section(title, (*(about or {}).get(part, ()), Figures(shown, f"{key}{part}"))))
    return [Figures(tuple(lead), f"{key}{last}")] if lead else [], rest


def provenance(pairs: Sequence[tuple[str, str]], rig: str) -> Section:
    """Return the origin of the results: keys and values, and the rig as TOML."""
    return Section("Provenance", (Facts(tuple(pairs)), Source("The rig, as TOML", rig, folded=True)), where="page")


def with_severity(findings: Iterable[Finding]) -> tuple[tuple[Severity, str], ...]:
    """Return sentences, each with its severity: one per cause, unless all are requested."""
    return (by_severity if verbosity() == Verbosity.VERBOSE else merged)(findings)
