"""Progress events for watchers: the progress of a step, the rig that was found. By default nobody watches."""

from __future__ import annotations

import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Sized
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

Item = TypeVar("Item")


@dataclass(frozen=True, slots=True)
class Advanced:
    """The progress of a step.

    Attributes
    ----------
    step : a code; the command line has its words
    share : done of it, 0 to 1
    at_most : the rest may turn out not to be needed, as of an iteration that converges
    """

    step: str
    share: float
    at_most: bool = False


Watcher = Callable[[object], None]

_watchers: list[Watcher] = []


@contextmanager
def watched(watcher: Watcher) -> Iterator[None]:
    """Send all events within to a watcher, too."""
    _watchers.append(watcher)
    try:
        yield
    finally:
        _watchers.remove(watcher)


def is_watched() -> bool:
    """Return whether anybody watches, where an event takes a while to compute."""
    return bool(_watchers)


def tell(event: object) -> None:
    """Send an event to the watchers, if any."""
    for watcher in _watchers:
        watcher(event)


class _Step:
    """The outermost active step, and the part of it that inner ones share in."""

    name, low, high, at_most = "", 0.0, 1.0, False


_step = _Step()


def counted(
    step: str, items: Iterable[Item], total: int | None = None, at_most: bool = False
) -> Generator[Item, None, None]:
    """Yield items, and report how many of them are done; within another step, as a share of that one.

    Parameters
    ----------
    step : a code
    items : each of which takes about as long
    total : how many they are about; their length when absent
    at_most : the loop may end before the last of them
    """
    if threading.current_thread() is not threading.main_thread():
        yield from items  # of several in parallel none is the active step
        return
    count = total if total is not None else len(items) if isinstance(items, Sized) else 1
    name, low, high, earlier = _step.name, _step.low, _step.high, _step.at_most
    width = (high - low) / max(count, 1)
    try:
        _step.name, _step.at_most = name or step, earlier or at_most
        for i, item in enumerate(items):
            _step.low, _step.high = min(low + i * width, high), min(low + (i + 1) * width, high)
            tell(Advanced(_step.name, _step.low, _step.at_most))
            yield item
        tell(Advanced(_step.name, high, _step.at_most))
    finally:
        _step.name, _step.low, _step.high, _step.at_most = name, low, high, earlier
