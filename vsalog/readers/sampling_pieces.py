"""The pieces of a large log for a sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import IO, NamedTuple

import numpy as np

from vsalog.core.finding import Finding
from vsalog.core.memory import PIECE_BYTES
from vsalog.core.resolution import STRETCHES
from vsalog.readers.tables.source import Source


class Piece(NamedTuple):
    """A part of a file: where it begins and how long it is [bytes]."""

    position: int
    size: int


@dataclass(frozen=True, slots=True)
class Sample:
    """The part that is read instead of a whole log, or of one file of it.

    Attributes
    ----------
    size : int
        Bytes that are read.
    stretches : int
        Separate pieces; 1 is the beginning alone.
    totals : mapping of str to int
        Samples of each stream in all, where the file states them.
    findings : tuple of Finding
        Findings about the whole file.
    of : int
        Bytes of the whole log, once that is known.
    """

    size: int
    stretches: int
    totals: Mapping[str, int] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    of: int = 0


def chosen_pieces(parts: Sequence[Piece], budget: int) -> tuple[list[Piece], int]:
    """Choose stretches of consecutive parts of a file, the first and the last part among them.

    Parameters
    ----------
    parts : in the order of the file; at least one
    budget : approximate number of bytes to choose

    Returns
    -------
    list of Piece
        The parts chosen; none where they would be half of all or more.
    int
        In how many stretches.
    """
    ends = np.cumsum([part.size for part in parts])
    share = budget // STRETCHES
    chosen = np.zeros(len(parts), dtype=np.bool_)
    for begin in np.linspace(0, max(int(ends[-1]) - share, 0), STRETCHES):
        first, last = np.searchsorted(ends, (begin, begin + share), side="right")
        chosen[first : last + 1] = True
    chosen[-1] = True
    pieces = [part for part, taken in zip(parts, chosen, strict=True) if taken]
    if 2 * sum(piece.size for piece in pieces) > ends[-1]:
        return [], 0
    return pieces, int(np.count_nonzero(np.diff(chosen, prepend=False) & chosen))


def copy_pieces(source: Source, pieces: Sequence[Piece], target: IO[bytes]) -> None:
    """Copy pieces of a file, one behind the other."""
    for piece in pieces:
        source.seek(piece.position)
        left = piece.size
        while left > 0 and (part := source.read(min(left, PIECE_BYTES))):
            target.write(part)
            left -= len(part)
