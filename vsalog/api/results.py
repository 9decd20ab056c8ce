"""The common part of all results: text, figures, tables, findings, and their display in a notebook."""

from __future__ import annotations

import os
import sys
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, overload

import pyarrow as pa

from vsalog.core.arrow import data_frame
from vsalog.core.errors import ReadError, VsalogError, VsalogWarning, did_you_mean
from vsalog.core.finding import Finding
from vsalog.core.finding_texts import merged
from vsalog.core.notation import listed
from vsalog.core.printable import named, printable
from vsalog.core.recording import Recording
from vsalog.figures.interactive import interactive
from vsalog.figures.paper import SIZES, check_matplotlib
from vsalog.figures.screen import window
from vsalog.report.document import Document
from vsalog.report.html import fragment_of
from vsalog.report.plot import Drawn, whole_first
from vsalog.report.terminal import text_of

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure
    from plotly.graph_objects import Figure as Interactive

Logs = str | Path | Recording | Sequence[str | Path | Recording]
Paths = str | Path | Sequence[str | Path]
Found = TypeVar("Found", bound="Results")
PACKAGE = f"{Path(__file__).parent.parent}{os.sep}"


class Results(ABC):
    """The result of a function of `vsalog`.

    Findings of severity warning and invalidates are issued as Python warnings of the category `VsalogWarning` when a result is
    made; `findings` has them all.
    """

    @property
    @abstractmethod
    def data(self) -> Any:
        """What the command prints as JSON: typed, of numbers, texts, tuples and mappings."""

    @property
    @abstractmethod
    def findings(self) -> tuple[Finding, ...]:
        """The findings, each with a stable code (docs/reference/findings/)."""

    @abstractmethod
    def _document(self) -> Document:
        """Return the document of the command."""

    @abstractmethod
    def _figures(self) -> Iterable[Drawn]:
        """Return all figures, the most informative one first."""

    @abstractmethod
    def to_arrow(self) -> pa.Table:
        """Return a table of Arrow; docs/how-to/python.md says what a row is."""

    @cached_property
    def _drawn(self) -> list[Drawn]:
        return list(self._figures())

    def summary(self) -> str:
        """Return what the command prints, as text."""
        return text_of(self._document())

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds of figures that `plot` can draw."""
        return tuple(dict.fromkeys(one.chart.name for one in self._drawn))

    @overload
    def plot(
        self, kind: str | None = None, *, log: str | None = None, joint: str | None = None,
        part: str | None = None, engine: Literal["matplotlib"] = "matplotlib", style: str = "screen",
    ) -> Figure: ...  # fmt: skip

    @overload
    def plot(
        self, kind: str | None = None, *, log: str | None = None, joint: str | None = None,
        part: str | None = None, engine: Literal["plotly"], style: str = "screen",
    ) -> Interactive: ...  # fmt: skip

    def plot(
        self, kind: str | None = None, *, log: str | None = None, joint: str | None = None,
        part: str | None = None, engine: Literal["matplotlib", "plotly"] = "matplotlib", style: str = "screen",
    ) -> Figure | Interactive:  # fmt: skip
        """Draw one figure.

        A figure of matplotlib is pyplot's: ``matplotlib.pyplot.show()`` opens a window, ``savefig`` writes a file.

        Parameters
        ----------
        kind : one of `kinds`; the first when absent
        log, joint, part : which, where there are several; a part is a transmission, a signal or a cause, and the device's figure
            goes before those of its transmissions
        engine : ``matplotlib`` or ``plotly``
        style : of matplotlib: ``column`` (3.5 in), ``page`` (7.16 in) or ``screen``

        Raises
        ------
        VsalogError
            There is no such figure, or several; the message names them.
        """
        chart = self._chosen(kind, log, joint, part).chart
        if engine == "plotly":
            return interactive(chart)
        if engine != "matplotlib":
            raise VsalogError(f"there is no engine '{engine}': matplotlib or plotly")
        if style not in SIZES:
            raise VsalogError(
                f"there is no style '{style}'{did_you_mean(style, SIZES) or '.'} There are {', '.join(SIZES)}"
            )
        check_matplotlib("plot()")
        figure: Figure = window(chart, SIZES[style])
        return figure

    def _chosen(self, kind: str | None, log: str | None, joint: str | None, part: str | None) -> Drawn:
        if not self._drawn:
            raise VsalogError("there is nothing to draw")
        name = self.kinds[0] if kind is None else kind.replace("-", "_")
        own = [one for one in self._drawn if one.chart.name == name]
        if not own:
            known = ", ".join(self.kinds)
            raise VsalogError(f"there is no figure '{kind}'{did_you_mean(name, self.kinds) or '.'} There are {known}")
        for what, value in (("log", log), ("joint", joint), ("part", part)):
            there = [getattr(one, what) for one in own]
            own = [one for one, its in zip(own, there, strict=True) if value in (None, its)]
            if what == "part" and value is None:
                own = whole_first(own)
                there = [one.part for one in own]
            if not own or (value is None and len(set(there)) > 1):
                said = listed([f"'{printable(its)}'" for its in dict.fromkeys(there)])
                raise VsalogError(f"choose the figure '{name}' by {what}=…: there are {said}")
        return own[0]

    def to_pandas(self) -> pandas.DataFrame:
        """Return `to_arrow` as a data frame.

        Raises
        ------
        VsalogError
            pandas is not installed.
        """
        return data_frame(self.to_arrow())

    def _repr_html_(self) -> str:
        return fragment_of(self._document())

    def __repr__(self) -> str:
        return f"<vsalog {type(self).__name__}: {printable(self._document().title)}>"

    def __str__(self) -> str:
        return self.summary()

    def _warned(self) -> Iterable[Finding]:
        """Return the findings that the command prints."""
        return self.findings


class Listed(Results):
    """Results whose table has a row for each item."""

    @property
    @abstractmethod
    def _columns(self) -> pa.Schema:
        """The columns of the table."""

    @abstractmethod
    def _rows(self) -> Iterable[Mapping[str, object]]:
        """Return the rows of the table."""

    def to_arrow(self) -> pa.Table:
        """Return what was found as a table of Arrow; docs/how-to/python.md says what a row is."""
        return pa.Table.from_pylist([dict(row) for row in self._rows()], self._columns)


def warned(found: Found) -> Found:
    """Issue the findings of a result as warnings, at the line that asked for it, and return it."""
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_code.co_filename.startswith(PACKAGE):
        level, frame = level + 1, frame.f_back
    for severity, words in merged(found._warned()):
        if severity != "info":
            warnings.warn(printable(words), VsalogWarning, stacklevel=level)
    return found


def columns(**types: type) -> pa.Schema:
    """Return columns by name and type: str, float, int, bool, or list of texts."""
    known: dict[type, pa.DataType] = {
        str: pa.string(), float: pa.float64(), int: pa.int64(), bool: pa.bool_(), list: pa.list_(pa.string()),
    }  # fmt: skip
    return pa.schema([(name, known[kind]) for name, kind in types.items()])


def paths(given: Paths) -> list[Path]:
    """Return one path or several as a list; raises ReadError for what is no path."""
    several = [given] if isinstance(given, str | Path) else list(given) if isinstance(given, Iterable) else [given]
    for one in several:
        if not isinstance(one, str | Path):
            raise ReadError(f"a {type(one).__name__} is no path of a log")
    return [named(Path(one)) for one in several]


def logs_of(given: Paths) -> list[Path]:
    """Return `paths` of the logs that a function is about; raises ReadError for none."""
    found = paths(given)
    if not found:
        raise ReadError("no log was given")
    return found


def texts(given: Mapping[str, object] | None) -> dict[str, str]:
    """Return settings as the command line has them, as texts."""
    return {key: str(value) for key, value in (given or {}).items()}


def names(given: str | Sequence[str]) -> tuple[str, ...]:
    """Return one name or several as a tuple."""
    return (given,) if isinstance(given, str) else tuple(given)
