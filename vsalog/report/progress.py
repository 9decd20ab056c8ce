"""What a command does while it works, on stderr."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType

from rich.console import Console
from rich.markup import escape
from rich.status import Status

from vsalog.core.printable import printable


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

    @contextmanager
    def saying_when_compiling(self) -> Iterator[None]:
        """Say so, once, when numba begins to compile a numerical loop that is not in its cache yet."""
        from numba.core import event

        console = self._console

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
