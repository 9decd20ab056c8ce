"""Progress of the compilation on a first run: which numerical loop, and how many there are."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

ANNOUNCED = (
    "compiling numerical loops; this happens once, later runs load them from a cache ('vsalog warm' compiles all of them"
    " ahead)"
)


@dataclass(frozen=True, slots=True)
class Compiling:
    """A loop that is being compiled.

    Attributes
    ----------
    name : module and function
    count : of loops so far, this one included
    most : upper bound of the count: the loops of all modules in use
    seconds : that compiling has taken so far
    done : nothing is being compiled any more
    """

    name: str
    count: int
    most: int
    seconds: float
    done: bool


@contextmanager
def compiling(show: Callable[[Compiling], None]) -> Iterator[None]:
    """Show each loop that numba compiles because it is not in the cache yet, and when it is done."""
    from numba.core import event

    class Listener(event.Listener):
        depth = count = 0
        seconds = begun = 0.0
        name = ""

        def on_start(self, event: event.Event) -> None:
            self.begun = self.begun if self.depth else time.monotonic()
            self.depth += 1
            function = event.data["dispatcher"].py_func
            if function.__module__.startswith("vsalog."):  # and no part of numba's own
                self.count += 1
                self.name = f"{function.__module__}.{function.__name__}".removeprefix("vsalog.")
            self.tell(time.monotonic() - self.begun)

        def on_end(self, event: event.Event) -> None:
            self.depth -= 1
            if not self.depth:
                self.seconds += time.monotonic() - self.begun
                self.tell(0.0, done=True)

        def tell(self, more: float, done: bool = False) -> None:
            show(Compiling(self.name, self.count, self.count + _left(), self.seconds + more, done))

    with event.install_listener("numba:compile", Listener()):
        yield


def where_loops_are() -> str:
    """Return the folder that compiled loops are kept in: the package's, or the user's cache where that cannot be written."""
    folders = sorted({loop.stats.cache_path for loop in _loops() if loop.stats.cache_path})
    return os.path.commonpath(folders) if folders else "no cache"


def _left() -> int:
    """Return how many loops of the modules in use are not compiled for anything."""
    return sum(not loop.signatures for loop in _loops())


def _loops() -> list[Any]:
    """Return the loops of the modules in use."""
    from numba.core.dispatcher import Dispatcher

    modules = [module for name, module in list(sys.modules.items()) if name.startswith("vsalog.")]
    loops = {id(loop): loop for module in modules for loop in vars(module).values() if isinstance(loop, Dispatcher)}
    return list(loops.values())
