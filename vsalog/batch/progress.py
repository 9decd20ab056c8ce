"""How a batch goes, on stderr: a bar on a terminal, a line now and then elsewhere; and what came of it, on stdout."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from vsalog.batch.records import Answer, Do, Log, Record
from vsalog.core.documents import document_text
from vsalog.core.printable import plural
from vsalog.report.page_text import plain

LINE_INTERVAL = 30.0
"""Seconds between two lines of progress where there is no terminal: a job's log stays short, and shows that work goes on."""


class Shown:
    """Show people how a batch goes; a context manager."""

    def __init__(self) -> None:
        self.done = 0
        self._console = Console(stderr=True, highlight=False)
        columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()
        self._bar = Progress(*columns, console=self._console, transient=True, disable=not self._console.is_terminal)
        self._logs = self._bytes = self._done_bytes = self._kept = self._failed = 0
        self._start = self._last = time.monotonic()

    def __enter__(self) -> Shown:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    @property
    def begun(self) -> bool:
        """Whether work has begun."""
        return self._logs > 0

    def say(self, text: str) -> None:
        """Print a remark."""
        self._console.print(escape(plain(text)), soft_wrap=True)

    def begin(self, logs: Sequence[Log]) -> None:
        """Show what is going to be done."""
        self._logs, self._bytes = len(logs), sum(log.size + 1 for log in logs)
        self._start = self._last = time.monotonic()
        self._bar.add_task(self._words(), total=self._bytes)
        self._bar.start()

    def add(self, log: Log, answer: Answer) -> None:
        """Count a log, and print a failure."""
        self.done += 1
        self._done_bytes += log.size + 1
        self._kept += answer.kept
        record = answer.record
        if record is not None and record.status == "failed":
            self._failed += 1
            # Most reasons begin with the name.
            reason = record.reason.removeprefix(f"{record.log}: ")
            self.say(f"failed: {record.log}: {reason}")
        self._bar.update(self._bar.task_ids[0], completed=self._done_bytes, description=escape(self._words()))
        if self._bar.disable and time.monotonic() - self._last > LINE_INTERVAL:
            self._last = time.monotonic()
            self.say(self._words())

    def _words(self) -> str:
        """Say how many are done, how fast, and how long it still takes, by the size of what is left."""
        words = f"{self.done} of {plural(self._logs, 'log')}"
        if self._failed:
            words += f", {self._failed} failed"
        fresh, taken = self.done - self._kept, time.monotonic() - self._start
        if fresh > 0 and taken > 0.0:
            left = taken * (self._bytes - self._done_bytes) / max(self._done_bytes, 1)
            words += f", {fresh / taken:.3g} logs/s, {duration(left)} left"
        return words


def duration(seconds: float) -> str:
    """Return a duration as people write it."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"


@dataclass(slots=True)
class Outcome:
    """What came of it.

    Attributes
    ----------
    where : of the batch
    planned : logs of this run (of this share, where there are shares)
    records : of these logs, by their names
    kept : of these, were finished before
    everything, finished : logs of all shares, and of these those that have a record
    others : logs of earlier runs that are not asked for any more, and whose results are still there
    seconds : how long it took
    """

    where: str
    planned: int
    records: dict[str, Record] = field(default_factory=dict)
    kept: int = 0
    everything: int = 0
    finished: int = 0
    others: int = 0
    seconds: float = 0.0

    @property
    def failures(self) -> list[Record]:
        """Records of the logs that failed, sorted by name."""
        return sorted((r for r in self.records.values() if r.status == "failed"), key=lambda record: record.log)

    @property
    def missed(self) -> list[str]:
        """Names of the logs that missed a threshold."""
        return sorted(r.log for r in self.records.values() if r.status == "done" and not r.met)

    @property
    def code(self) -> int:
        """The exit code: 1 where a failure is a bug of ours, 2 where a log failed, 3 where a threshold was missed."""
        if any(r.kind == "bug" for r in self.failures):
            return 1
        return 2 if self.failures else 3 if self.missed else 0


def print_outcome(outcome: Outcome, do: Do, as_json: bool) -> None:
    """Print what came of it, for people or as one JSON document; what failed goes to stderr, in one line."""
    where, bad = plain(outcome.where), len(outcome.failures)
    places = {"traces": f"{where}/traces", "summary": f"{where}/summary.parquet", "page": f"{where}/index.html"}
    if as_json:
        sys.stdout.write(document_text(_document(outcome, do, places)))
    else:
        before = f" ({outcome.kept} of them before)" if outcome.kept else ""
        logs = f"{plural(outcome.planned, 'log')} in {duration(outcome.seconds)}"
        print(f"{logs}: {outcome.planned - bad} done{before}, {bad} failed")
        if outcome.everything > outcome.planned:
            print(f"of all shares {outcome.finished} of {plural(outcome.everything, 'log')} finished")
        if outcome.missed:
            print(f"{plural(len(outcome.missed), 'log')} missed the threshold")
        data = f"data set: {places['traces']}   " if do == "estimate" else ""
        print(f"{data}table: {places['summary']}   page: {places['page']}")
    if bad:
        listed = f"{places['page']} and {places['summary']} say which and why"
        print(f"vsalog: {bad} of {plural(outcome.planned, 'log')} failed; {listed}", file=sys.stderr)


def _document(outcome: Outcome, do: Do, places: dict[str, str]) -> dict[str, Any]:
    return {
        "do": do,
        "logs": outcome.planned,
        "done": outcome.planned - len(outcome.failures),
        "kept": outcome.kept,
        "failed": [{"log": plain(r.log), "kind": r.kind, "reason": plain(r.reason)} for r in outcome.failures],
        "missed": [plain(name) for name in outcome.missed],
        "shares": {"finished": outcome.finished, "logs": outcome.everything},
        "seconds": outcome.seconds,
        "outputs": places,
    }
