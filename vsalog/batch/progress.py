"""How a batch goes, on stderr: a bar on a terminal, a line now and then elsewhere."""

from __future__ import annotations

import time
from collections.abc import Sequence
from types import TracebackType

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from vsalog.batch.records import Answer, Log
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
