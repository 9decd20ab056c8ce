"""What is compiled on a first run: which numerical loop, how many there are, and that it happens only once."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

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
    most : as many as can be at this point: those of all modules in use
    seconds : since the first of them
    """

    name: str
    count: int
    most: int
    seconds: float


@contextmanager
def compiling(show: Callable[[Compiling | None], None]) -> Iterator[None]:
    """Show each loop that numba compiles because it is not in the cache yet, and None when it is done."""
    from numba.core import event

    class Listener(event.Listener):
        depth = count = 0
        begun = time.monotonic()

        def on_start(self, event: event.Event) -> None:
            self.begun = self.begun if self.count else time.monotonic()
            self.depth += 1
            self.count += 1
            function = event.data["dispatcher"].py_func
            name = f"{function.__module__}.{function.__name__}".removeprefix("vsalog.")
            show(Compiling(name, self.count, self.count + _left(), time.monotonic() - self.begun))

        def on_end(self, event: event.Event) -> None:
            self.depth -= 1
            if not self.depth:
                show(None)

    with event.install_listener("numba:compile", Listener()):
        yield


def _left() -> int:
    """Return how many loops of the modules in use are not compiled for anything."""
    from numba.core.dispatcher import Dispatcher

    modules = [module for name, module in list(sys.modules.items()) if name.startswith("vsalog.")]
    loops = {id(loop): loop for module in modules for loop in vars(module).values() if isinstance(loop, Dispatcher)}
    return sum(not loop.signatures for loop in loops.values())
