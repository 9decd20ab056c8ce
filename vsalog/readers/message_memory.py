"""What was met in messages that have no shape in common: their names, and a number for each thing in them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsalog.readers.base import MAX_ARRAY, MAX_DEPTH
from vsalog.readers.fields import MAX_NAME
from vsalog.readers.labels import MAX_LABELS
from vsalog.readers.message_scan import Found, Limits, Tables, Work, scan
from vsalog.readers.packets import Bytes, Integers

# Room for what is numbered, for labels and their characters, and for texts of a message.
_IDS, _LABELS, _POOL, _HELD = 2**15, 2**13, 2**18, 4096


class Memory:
    """What was met so far: names, and what is numbered by what is around it, place and name.

    Attributes
    ----------
    keys : int64 array, shape (n, 3)
        Of each number: the number of what is around it, 0 for the message; the place; and the name: 0 for none, -1 - i for the
        index i, or the number of a label.
    """

    def __init__(self) -> None:
        self.keys = np.zeros((_IDS, 3), np.int64)
        counters = np.array([1, 1, 0, 0], np.int64)
        tables = np.full(4 * _IDS, -1, np.int64), np.zeros((_LABELS, 3), np.int64), np.full(4 * _LABELS, -1, np.int64)
        self._tables = Tables(self.keys, counters, *tables, np.zeros(_POOL, np.uint8))
        limits = Limits(MAX_LABELS, MAX_NAME, MAX_ARRAY)
        self._work = Work(
            limits, *(np.zeros(shape, np.int64) for shape in ((_HELD, 3), (2 * MAX_DEPTH, 5), (_HELD, 4), _HELD))
        )

    def label(self, number: int) -> str:
        """Return a label by its number."""
        at, length, _ = self._tables.spans[number].tolist()
        return self._tables.pool[at : at + length].tobytes().decode("ascii")

    def scan(
        self, steps: Integers, cdr: bool, data: Bytes, start: Integers, length: Integers, found: Found
    ) -> tuple[NDArray[np.bool_], Integers, int]:
        """Walk messages until there is no room for another one's numbers.

        Parameters
        ----------
        steps : int64 array, shape (k, 5)
            Of a `vsalog.readers.message_program.Program`.
        cdr : bool
            ROS 2's encoding, or ROS 1's.
        data : uint8 array
            Where messages lie.
        start, length : int64 arrays, shape (n,)
            Of each.
        found : Found
            Room for what will be found, for `MOST_FOUND` at least.

        Returns
        -------
        bool array, shape (k,)
            Which of the messages that were walked are sound and not odd.
        int64 array, shape (k,)
            Where their time stamps lie in `data`, -1 for none.
        int
            How much was found in them.
        """
        data = data.view()
        data.flags.writeable = False  # always, so that the loops are compiled once
        good, stamps = np.zeros(start.size, np.bool_), np.full(start.size, -1, np.int64)
        walked, count = scan(steps, cdr, data, start, length, good, stamps, found, self._tables, self._work)
        return good[:walked], stamps[:walked], int(count)
