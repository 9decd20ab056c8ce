"""Cached results of a search: it changes one value of a rig at a time, and most of the equations stay the same."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from threading import Lock
from typing import Any, TypeVar

import numpy as np

T = TypeVar("T")


class Memory:
    """Results of functions of arrays and of values that can be hashed, such as parts of a rig.

    An array is known again by its identity; it is kept with the result, so that no other takes its place. Neither the
    arrays that go in nor those that come out may be written to.
    """

    def __init__(self, limit: int = 2**28) -> None:
        self._limit = limit
        self._bytes = 0
        self._lock = Lock()
        self._kept: OrderedDict[tuple[Any, ...], tuple[Any, int, tuple[Any, ...]]] = OrderedDict()

    def __call__(self, make: Callable[..., T], *inputs: Any) -> T:
        """Return make(*inputs), computed unless it is remembered."""
        key = (make, *((id(i), None) if isinstance(i, np.ndarray) else i for i in inputs))
        with self._lock:
            kept = self._kept.get(key)
            if kept is not None:
                self._kept.move_to_end(key)
                return kept[0]  # type: ignore[no-any-return]
        found = make(*inputs)
        size = sum(part.nbytes for part in (found, *inputs) if isinstance(part, np.ndarray))
        with self._lock:
            if key not in self._kept:
                self._kept[key] = found, size, inputs
                self._bytes += size
            while self._bytes > self._limit and len(self._kept) > 1:
                self._bytes -= self._kept.popitem(last=False)[1][1]
        return found


remembered = Memory()
