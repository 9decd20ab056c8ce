"""What a command does while it works, on stderr: a batch by a bar on a terminal, and by a line now and then elsewhere."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from types import TracebackType

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar
from rich.status import Status

from vsalog.core.notation import duration
from vsalog.core.printable import plural, printable

LINE_INTERVAL = 30.0
"""Seconds between two lines of progress where there is no terminal: a job's log stays short, and shows that work goes on."""


class Progress:
    """One line on stderr that says what is being done, on a terminal; a log file gets the slow steps only."""

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        self._status: Status | None = None

    def __enter__(self) -> Progress:
        if self._console.is_terminal:
            self._status = self._console.status("starting")
            self._status.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._status is not None:
            self._status.stop()

    def say(self, text: str) -> None:
        """Show what is being done."""
        if self._status is not None:
            self._status.update(escape(printable(text)))

    def saying_when_compiling(self) -> AbstractContextManager[None]:
        """Say so, once, when numba begins to compile a numerical loop that is not in its cache yet."""
        return saying_when_compiling(self._console)


@contextmanager
def saying_when_compiling(console: Console) -> Iterator[None]:
    """Say so on this console, once, when numba begins to compile a numerical loop that is not in its cache yet."""
    from numba.core import event

    class Once(event.Listener):
        said = False

        def on_start(self, event: object) -> None:
            if not self.said:
                console.print("first run: compiling the numerical loops takes a few seconds …", soft_wrap=True)
            self.said = True

        def on_end(self, event: object) -> None:
            pass

    with event.install_listener("numba:compile", Once()):
        yield


class BatchProgress:
    """Show people how a batch goes; a context manager.

    Parameters
    ----------
    of : what the batch consists of, in the singular
    """

    def __init__(self, of: str = "log") -> None:
        self.done, self._of, self._now = 0, of, ""
        self._console = Console(stderr=True, highlight=False)
        columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()
        self._bar = Bar(*columns, console=self._console, transient=True, disable=not self._console.is_terminal)
        self._logs = self._bytes = self._done_bytes = self._kept = self._failed = 0
        self._start = self._last = self._added = time.monotonic()

    def __enter__(self) -> BatchProgress:
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
        self._console.print(escape(printable(text)), soft_wrap=True)

    def saying_when_compiling(self) -> AbstractContextManager[None]:
        """Say so, once, when numba begins to compile a numerical loop that is not in its cache yet."""
        return saying_when_compiling(self._console)

    def now(self, text: str) -> None:
        """Show what is being done next to how far it is."""
        self._now = text
        self._show()

    def begin(self, sizes: Sequence[int]) -> None:
        """Show what is going to be done: logs of these sizes [bytes], or what else takes as long as it is large."""
        self._logs, self._bytes = len(sizes), sum(sizes) + len(sizes)
        self._start = self._last = self._added = time.monotonic()
        self._bar.add_task(self._words(), total=self._bytes)
        self._bar.start()

    def add(self, size: int, kept: bool, failure: str) -> None:
        """Count a log: its size [bytes], whether it was finished before, and why it failed, where it did."""
        self.done += 1
        self._added = time.monotonic()
        self._done_bytes += size + 1
        self._kept += kept
        if failure:
            self._failed += 1
            self.say(f"failed: {failure}")
        self._show()

    def _show(self) -> None:
        self._bar.update(self._bar.task_ids[0], completed=self._done_bytes, description=escape(self._words()))
        if self._bar.disable and time.monotonic() - self._last > LINE_INTERVAL:
            self._last = time.monotonic()
            self.say(self._words())

    def _words(self) -> str:
        """Say how many are done, how fast, and how long it still takes, by the size of what is left."""
        words = f"{self.done} of {plural(self._logs, self._of)}"
        if self._failed:
            words += f", {self._failed} failed"
        fresh, taken = self.done - self._kept, self._added - self._start
        if fresh > 0 and taken > 0.0:
            # What is under way has taken some of its time already.
            left = taken * (self._bytes - self._done_bytes) / max(self._done_bytes, 1)
            left = max(left - (time.monotonic() - self._added), 0.0)
            words += f", {fresh / taken:.3g} {self._of}s/s, {duration(left)} left"
        return f"{words}; {printable(self._now)}" if self._now else words
