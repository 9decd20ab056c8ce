"""`vsalog.inspect`: the contents of a log."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from vsalog.api.results import Listed, Paths, columns, logs_of, warned
from vsalog.core.finding import Finding
from vsalog.inspection import document
from vsalog.inspection.run import Options
from vsalog.inspection.run import inspect as run
from vsalog.report.document import Document
from vsalog.report.inspect import inspection_charts, inspection_document
from vsalog.report.plot import Drawn


class Inspection(Listed):
    """The contents of logs: streams with their clocks, channels, and the probable joints."""

    def __init__(self, data: document.Inspection, options: Options) -> None:
        self._data, self._options = data, options

    @property
    def data(self) -> document.Inspection:
        """What ``vsalog inspect --json`` prints."""
        return self._data

    @property
    def logs(self) -> tuple[document.LogReport, ...]:
        """The logs that could be read, in the order they were named."""
        return self._data.logs

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings about all logs."""
        return tuple(finding for log in self.logs for finding in log.findings)

    def _document(self) -> Document:
        return inspection_document(self._data)

    def _figures(self) -> Iterator[Drawn]:
        for log in self.logs:
            yield from inspection_charts(log, self._options)

    _columns = columns(
        log=str, stream=str, channel=str, unit=str, type=str, count=int, rate=float, minimum=float, maximum=float,
        resolution=float, noise=float, joint=str, role=str, confidence=float,
    )  # fmt: skip

    def _rows(self) -> Iterable[Mapping[str, object]]:
        for log in self.logs:
            for stream in log.streams:
                for c in stream.channels:
                    yield {
                        "log": log.path,
                        "stream": stream.name,
                        "channel": c.name,
                        "unit": c.unit,
                        "type": c.type,
                        "count": c.count,
                        "rate": stream.rate,
                        "minimum": c.minimum,
                        "maximum": c.maximum,
                        "resolution": c.resolution,
                        "noise": c.noise,
                        "joint": None if c.role is None else c.role.joint,
                        "role": None if c.role is None else c.role.role,
                        "confidence": None if c.role is None else c.role.confidence,
                    }


def inspect(
    logs: Paths,
    *,
    head: int = 0,
    full: bool = False,
    rate: float | None = None,
    time: str = "auto",
    start: str | None = None,
    end: str | None = None,
) -> Inspection:
    """Inspect the contents of logs, as ``vsalog inspect`` does.

    Parameters
    ----------
    logs : a log's path, or several; of several, those that cannot be read are in ``data.unreadable``
    head : number of first samples of each stream, in ``data.logs[…].head``
    full : read all of a large log; a sample of it when absent
    rate : samples per second of a table without a time column [Hz]
    time : which clock to trust: auto, header, log or publish
    start, end : the part of each log that is used: seconds from its beginning, ``"2 min"``, an ISO 8601 date or a time since the
        epoch

    Raises
    ------
    VsalogError
        What the input is to blame for; the message says what, where and what to do.
    """
    options = Options(head, full, rate, time, start, end)
    return warned(Inspection(run(logs_of(logs), options), options))
