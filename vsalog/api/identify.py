"""`vsalog.identify`: the rig's parameters, fitted to a log."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from msgspec.structs import asdict

from vsalog.api.results import Listed, Paths, columns, names, paths, texts, warned
from vsalog.core.finding import Finding
from vsalog.identification import document
from vsalog.identification.run import Options
from vsalog.identification.run import identify as run
from vsalog.report.document import Document
from vsalog.report.identify import identification_charts, identification_document
from vsalog.report.plot import Drawn
from vsalog.rig import Rig


class Identification(Listed):
    """A rig's parameters, fitted to a log, with intervals, and which of them the log determines."""

    def __init__(self, found: document.Identification, rig: Rig) -> None:
        self._found, self._rig = found, rig

    @property
    def data(self) -> document.Identification:
        """What ``vsalog identify --json`` prints."""
        return self._found

    @property
    def rig(self) -> Rig:
        """The rig with the identified parameters."""
        return self._rig

    @property
    def numbers(self) -> tuple[document.IdentifiedNumber, ...]:
        """The fitted parameters."""
        return self._found.numbers

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The findings."""
        return self._found.findings

    def _document(self) -> Document:
        return identification_document(self._found)

    def _figures(self) -> Iterator[Drawn]:
        yield from (Drawn(chart, joint) for joint, chart in identification_charts(self._found).items())

    _columns = columns(
        joint=str, key=str, unit=str, rig=float, value=float, low=float, high=float, determined=str, correlated_with=str,
        correlation=float,
    )  # fmt: skip

    def _rows(self) -> Iterator[Mapping[str, object]]:
        yield from map(asdict, self.numbers)


def identify(
    log: str | Path,
    rig: Rig | str | Path | None = None,
    *,
    holdouts: Paths = (),
    free: str | Sequence[str] = (),
    fix: str | Sequence[str] = (),
    joints: str | Sequence[str] = (),
    set: Mapping[str, object] | None = None,
    rate: float | None = None,
    time: str = "auto",
    start: str | None = None,
    end: str | None = None,
) -> Identification:
    """Fit a rig's parameters to a log by simulation, as ``vsalog identify`` does, without writing files.

    Parameters
    ----------
    log : a log's path
    rig : a rig, its file or a preset's name; that in the log, or next to it, when absent
    holdouts : other logs of the same machine, to judge the fit by; the last third of the log when empty
    free : keys below a joint, or patterns, that are fitted too, as ``"motor.friction.*"``
    fix : keys or patterns that keep the rig's values
    joints : names of the joints wanted; all when empty
    set : changes to the rig, e.g. ``{"joint.elbow.motor.damping": "1 N*mm*s/rad"}``
    rate : samples per second of a table without a time column [Hz]
    time : which clock to trust: auto, header, log or publish
    start, end : the part of each log that is used: seconds from its beginning, ``"2 min"``, an ISO 8601 date or a time since the
        epoch

    Raises
    ------
    VsalogError
        What the input is to blame for; the message says what, where and what to do.
    """
    options = Options(rig, names(joints), texts(set), rate, time, start, end, names(free), names(fix))
    return warned(Identification(*run(paths(log)[0], paths(holdouts), options)))
