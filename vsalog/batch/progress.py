"""How a batch goes, on stderr: a bar on a terminal, a line now and then elsewhere; and what came of it, on stdout."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from types import TracebackType

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from vsalog.batch.records import Answer, Do, Log, Record
from vsalog.batch.run import Outcome
from vsalog.core.documents import document_text
from vsalog.core.printable import plural
from vsalog.report.page_text import plain

LINE_INTERVAL = 30.0
"""Seconds between two lines of progress where there is no terminal: a job's log stays short, and shows that work goes on."""


class Shown:
    """A watch (`vsalog.batch.run.Watch`) for people; a context manager."""

    def __init__(self) -> None:
        self._console = Console(stderr=True, highlight=False)
        self._bar: Progress | None = None
        self._id = TaskID(0)
        self._logs = self._bytes = self._done = self._done_bytes = self._kept = self._failed = 0
        self._start = self._last = time.monotonic()

    def __enter__(self) -> Shown:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            self._bar.stop()

    @property
    def done(self) -> int:
        """How many logs are finished."""
        return self._done

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
        if self._console.is_terminal:
            self._bar = Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                TimeElapsedColumn(),
                console=self._console,
                transient=True,
            )
            self._id = self._bar.add_task(self._words(), total=self._bytes)
            self._bar.start()

    def add(self, log: Log, answer: Answer) -> None:
        """Count a log, and print a failure."""
        self._done += 1
        self._done_bytes += log.size + 1
        self._kept += answer.kept
        record = answer.record
        if record is not None and record.status == "failed":
            self._failed += 1
            self.say(f"failed: {_reason(record)}")
        if self._bar is not None:
            self._bar.update(self._id, completed=self._done_bytes, description=escape(self._words()))
        elif time.monotonic() - self._last > LINE_INTERVAL:
            self._last = time.monotonic()
            self.say(self._words())

    def _words(self) -> str:
        """Say how many are done, how fast, and how long it still takes, by the size of what is left."""
        words = f"{self._done} of {plural(self._logs, 'log')}"
        if self._failed:
            words += f", {self._failed} failed"
        fresh, taken = self._done - self._kept, time.monotonic() - self._start
        if fresh > 0 and taken > 0.0:
            left = taken * (self._bytes - self._done_bytes) / max(self._done_bytes, 1)
            words += f", {fresh / taken:.3g} logs/s, {duration(left)} left"
        return words


def _reason(record: Record) -> str:
    """Return a failed log's name and why it failed; most reasons begin with the name."""
    return record.reason if record.reason.startswith(f"{record.log}: ") else f"{record.log}: {record.reason}"


def duration(seconds: float) -> str:
    """Return a duration as people write it."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"


def summary_words(outcome: Outcome, do: Do) -> list[str]:
    """Return what came of it, in lines."""
    done = outcome.planned - len(outcome.failures)
    before = f" ({outcome.kept} of them before)" if outcome.kept else ""
    lines = [
        f"{plural(outcome.planned, 'log')} in {duration(outcome.seconds)}: {done} done{before},"
        f" {len(outcome.failures)} failed"
    ]
    if outcome.everything > outcome.planned:
        lines.append(f"of all shares {outcome.finished} of {plural(outcome.everything, 'log')} finished")
    if outcome.missed:
        lines.append(f"{plural(len(outcome.missed), 'log')} missed the threshold")
    where = outcome.where
    places = [f"data set: {where}/traces"] if do == "estimate" else []
    lines.append("   ".join([*places, f"table: {where}/summary.parquet", f"page: {where}/index.html"]))
    return lines


def print_outcome(outcome: Outcome, do: Do) -> None:
    """Print what came of it; what failed goes to stderr, in one line."""
    for line in summary_words(outcome, do):
        print(plain(line))
    if outcome.failures:
        print(plain(failure_words(outcome)), file=sys.stderr)


def failure_words(outcome: Outcome) -> str:
    """Say how many failed, and where they are listed."""
    count = len(outcome.failures)
    listed = f"{outcome.where}/index.html and {outcome.where}/summary.parquet say which and why"
    return f"vsalog: {count} of {plural(outcome.planned, 'log')} failed; {listed}"


def print_json(outcome: Outcome, do: Do) -> None:
    """Print one JSON document on stdout."""
    where = plain(outcome.where)
    document = {
        "do": do,
        "logs": outcome.planned,
        "done": outcome.planned - len(outcome.failures),
        "kept": outcome.kept,
        "failed": [{"log": plain(r.log), "kind": r.kind, "reason": plain(r.reason)} for r in outcome.failures],
        "missed": [plain(name) for name in outcome.missed],
        "shares": {"finished": outcome.finished, "logs": outcome.everything},
        "seconds": outcome.seconds,
        "outputs": {"traces": f"{where}/traces", "summary": f"{where}/summary.parquet", "page": f"{where}/index.html"},
    }
    sys.stdout.write(document_text(document))
    if outcome.failures:
        print(plain(failure_words(outcome)), file=sys.stderr)
