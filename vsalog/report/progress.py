"""Progress of a command on stderr: a bar on a terminal, and elsewhere a line now and then."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from types import TracebackType

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, ProgressColumn, SpinnerColumn, Task, TaskID, TextColumn, TimeElapsedColumn
from rich.progress import Progress as Bar
from rich.table import Column
from rich.text import Text

from vsalog.core.notation import duration
from vsalog.core.printable import plural, printable
from vsalog.core.progress import Advanced, watched
from vsalog.core.units import shown
from vsalog.report.compiling import ANNOUNCED, Compiling, compiling
from vsalog.report.rigs import rig_in_errors, rig_words, unused_rigs_words
from vsalog.report.verbosity import Verbosity, verbosity
from vsalog.rig.find import RigFound

LINE_INTERVAL = 30.0
"""Seconds between two lines of progress where there is no terminal: a job's log stays short, and shows progress."""

STEPS = {
    "causes": "searching the sets of causes",
    "checks": "running checks",
    "equations": "linearising the equations",
    "estimate": "filtering",
    "experiments": "simulating candidates",
    "fit": "iterating",
    "isolations": "assuming each cause in turn",
    "modalities": "",
    "perturbations": "perturbing the estimate",
    "reading": "",
    "recording_faults": "searching faults of the recording",
    "sensors": "simulating candidates",
    "simulation": "",
    "trajectories": "fitting trajectories",
    "warm": "",
    "writing": "",
}
"""The words for the steps of `vsalog.core.progress`."""


class _Left(ProgressColumn):
    """The time a step still takes, extrapolated, else the time it has taken."""

    def render(self, task: Task) -> Text:
        begun, share = task.fields["begun"], task.completed
        taken = time.monotonic() - begun
        if task.total is None or share <= 0.0:
            return Text(duration(taken))
        left = duration(taken * (1.0 - share) / share)
        return Text(f"{'at most ' if task.fields['at_most'] else ''}{left} left")


def _cut() -> Column:
    """Return the column of a bar's words: a bar is one line, which the terminal is wide enough for."""
    return Column(ratio=1, no_wrap=True, overflow="ellipsis")


class Progress:
    """What is being done, on stderr: a bar with an estimate of the time left on a terminal; which rig is used, everywhere.

    Parameters
    ----------
    replaced : files that will be overwritten
    rigs : print which rig is used

    Attributes
    ----------
    loops : what was compiled so far; None where everything was in the cache
    """

    def __init__(self, replaced: Sequence[Path] = (), rigs: bool = True) -> None:
        self._console = Console(stderr=True, highlight=False)
        columns = SpinnerColumn(), TextColumn("{task.description}", table_column=_cut()), BarColumn(16), _Left()
        self._shown = self._console.is_terminal and verbosity() > Verbosity.QUIET
        self._bar = Bar(*columns, console=self._console, transient=True, disable=not self._shown, expand=True)
        self._task = self._bar.add_task("starting", total=None, begun=time.monotonic(), at_most=False)
        self._row: TaskID | None = None
        self.loops: Compiling | None = None
        self._rigs, self._stack = rigs, ExitStack()
        self._lines: list[str] = []  # without a terminal: after an error only the error is printed
        self._said: set[str] = set()
        self._words, self._step, self._share, self._announced = "", "", 0.0, False
        self._begun = self._looked = self._since = time.monotonic()
        self.replacing(replaced)

    def __enter__(self) -> Progress:
        self._stack.enter_context(watched(self._hear))
        if self._rigs:
            self._stack.enter_context(rig_in_errors(self._rig))
        self._stack.enter_context(self._bar)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._end_step()
        self._stack.__exit__(kind, error, trace)
        if error is None:
            for line in self._lines:
                self._console.print(escape(line), soft_wrap=True)

    def say(self, text: str) -> None:
        """Show what is being done."""
        self._end_step()
        self._words, self._step, self._share = printable(text), "", 0.0
        self._begun = time.monotonic()
        self._bar.update(self._task, description=escape(self._words), total=None, completed=0, begun=self._begun)

    def note(self, text: str) -> None:
        """Print a note, which is no warning."""
        if verbosity() > Verbosity.QUIET:
            self._tell(f"note: {printable(text)}")

    def replacing(self, files: Sequence[Path]) -> None:
        """Print which files will be overwritten."""
        if files and verbosity() > Verbosity.QUIET:
            self._tell(f"replacing {', '.join(shown(str(path)) for path in files)}")

    def saying_when_compiling(self) -> AbstractContextManager[None]:
        """Show when numba compiles a numerical loop that is not in its cache yet; explain it once."""
        return compiling(self._compiling)

    def _end_step(self) -> None:
        if self._words and verbosity() >= Verbosity.VERBOSE:
            self._tell(f"{self._words}: {time.monotonic() - self._begun:.2f} s")

    def _tell(self, line: str) -> None:
        """Print a line, once; without a terminal when all is done."""
        if line in self._said:
            return
        self._said.add(line)
        if self._console.is_terminal:
            self._console.print(escape(line), soft_wrap=True)
        else:
            self._lines.append(line)

    def _rig(self, found: RigFound) -> str:
        return rig_words(found, verbosity() >= Verbosity.VERBOSE)

    def _hear(self, event: object) -> None:
        if isinstance(event, RigFound) and self._rigs:
            if verbosity() > Verbosity.QUIET:
                self._tell(self._rig(event))
            if unused := unused_rigs_words(event):
                self._tell(f"warning: {unused}")
        elif isinstance(event, Advanced) and self._shown:
            self._advance(event)

    def _advance(self, event: Advanced) -> None:
        now = time.monotonic()
        if event.step != self._step or event.share < self._share:
            self._since = now
        self._step, self._share = event.step, event.share
        # A short step needs no bar, and a loop over samples reports each.
        if min(now - self._since, now - self._looked) < 1.0 / self._bar.live.refresh_per_second:
            return
        self._looked = now
        words = ": ".join(filter(None, (self._words, STEPS.get(event.step, ""))))
        self._bar.update(
            self._task, description=escape(words), total=1.0, completed=event.share, begun=self._since, at_most=event.at_most
        )  # fmt: skip

    def _compiling(self, loop: Compiling) -> None:
        self.loops = loop
        if not self._announced and verbosity() > Verbosity.QUIET:
            self._console.print(ANNOUNCED, soft_wrap=not self._shown)
            self._announced = True
        if not loop.done and verbosity() >= Verbosity.VERBOSE:
            self._console.print(f"compiling {escape(loop.name)}", soft_wrap=True)
        if not self._shown:
            return
        if self._row is not None and loop.done:
            self._bar.update(self._row, visible=False)
        elif not loop.done:
            words = f"compiling loop {loop.count} of at most {loop.most}: {loop.name}"
            if self._row is None:
                self._row = self._bar.add_task(words, total=1.0, begun=time.monotonic(), at_most=True)
            begun = time.monotonic() - loop.seconds
            self._bar.update(
                self._row, description=escape(words), completed=(loop.count - 1) / loop.most, begun=begun, visible=True
            )  # fmt: skip


class BatchProgress:
    """Show the progress of a batch; a context manager.

    Parameters
    ----------
    of : what the batch consists of, in the singular
    """

    def __init__(self, of: str = "log") -> None:
        self.done, self._of, self._now, self._announced = 0, of, "", False
        self._console = Console(stderr=True, highlight=False)
        self._shown = self._console.is_terminal and verbosity() > Verbosity.QUIET
        columns = TextColumn("{task.description}", table_column=_cut()), BarColumn(16), TimeElapsedColumn()
        self._bar = Bar(*columns, console=self._console, transient=True, disable=not self._shown, expand=True)
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

    def note(self, text: str) -> None:
        """Print what a quiet command leaves out."""
        if verbosity() > Verbosity.QUIET:
            self.say(text)

    def saying_when_compiling(self) -> AbstractContextManager[None]:
        """Print once that numba compiles a numerical loop that is not in its cache yet."""
        return compiling(self._announce)

    def _announce(self, _: Compiling) -> None:
        if not self._announced:
            self._announced = True
            self.note(ANNOUNCED)

    def now(self, text: str) -> None:
        """Show the current step next to the progress."""
        self._now = text
        self._show()

    def begin(self, sizes: Sequence[int]) -> None:
        """Show the planned work: logs of these sizes [bytes], or other items whose time grows with their size."""
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
        if (
            not self._console.is_terminal
            and verbosity() > Verbosity.QUIET
            and time.monotonic() - self._last > LINE_INTERVAL
        ):
            self._last = time.monotonic()
            self.say(self._words())

    def _words(self) -> str:
        """Return how many are done, how fast, and the remaining time, by the size of the rest."""
        words = f"{self.done} of {plural(self._logs, self._of)}"
        if self._failed:
            words += f", {self._failed} failed"
        fresh, taken = self.done - self._kept, self._added - self._start
        if fresh > 0 and taken > 0.0:
            # Items in progress have taken some of their time already.
            left = taken * (self._bytes - self._done_bytes) / max(self._done_bytes, 1)
            left = max(left - (time.monotonic() - self._added), 0.0)
            words += f", {fresh / taken:.3g} {self._of}s/s, {duration(left)} left"
        return f"{words}; {printable(self._now)}" if self._now else words
