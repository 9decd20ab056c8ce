"""What `batch` says: on stderr how it goes, by a bar on a terminal and a line now and then elsewhere; on stdout the outcome."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from vsalog.core.documents import document_text
from vsalog.core.printable import plural
from vsalog.report.quantities import plain

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

    def begin(self, sizes: Sequence[int]) -> None:
        """Show what is going to be done: logs of these sizes [bytes]."""
        self._logs, self._bytes = len(sizes), sum(sizes) + len(sizes)
        self._start = self._last = time.monotonic()
        self._bar.add_task(self._words(), total=self._bytes)
        self._bar.start()

    def add(self, size: int, kept: bool, failure: str) -> None:
        """Count a log: its size [bytes], whether it was finished before, and why it failed, where it did."""
        self.done += 1
        self._done_bytes += size + 1
        self._kept += kept
        if failure:
            self._failed += 1
            self.say(f"failed: {failure}")
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


def print_outcome(document: Mapping[str, Any], as_json: bool) -> None:
    """Print what came of it, for people or as one JSON document; what failed goes to stderr, in one line."""
    logs, bad, places = document["logs"], len(document["failed"]), document["outputs"]
    if as_json:
        sys.stdout.write(document_text(document))
    else:
        before = f" ({document['kept']} of them before)" if document["kept"] else ""
        print(
            f"{plural(logs, 'log')} in {duration(document['seconds'])}: {document['done']} done{before}, {bad} failed"
        )
        if document["shares"]["logs"] > logs:
            print(
                f"of all shares {document['shares']['finished']} of {plural(document['shares']['logs'], 'log')} finished"
            )
        if document["missed"]:
            print(f"{plural(len(document['missed']), 'log')} missed the threshold")
        data = f"data set: {places['traces']}   " if document["do"] == "estimate" else ""
        print(f"{data}table: {places['summary']}   page: {places['page']}")
    if bad:
        listed = f"{places['page']} and {places['summary']} say which and why"
        print(f"vsalog: {bad} of {plural(logs, 'log')} failed; {listed}", file=sys.stderr)
