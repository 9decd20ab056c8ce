"""Bound signals that are too long for memory: they lie in a temporary file and are read block by block."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.resolution import STRETCHES
from vsalog.core.signals import JointSignals
from vsalog.core.spool import PART, Spool, SpooledColumn

Array = NDArray[np.float64]
Rows = NDArray[np.int64]


# Rows of a stretch that is looked at, as many as methods take in one piece, and of the longest run, as the longest window needs.
STRETCH, LONGEST = PART, 2 * PART


class LongSignals:
    """The signals of one joint; see `JointSignals`, of which blocks are read.

    Attributes
    ----------
    joint : the joint's name
    period : T [s], of the grid
    run_names : names of the runs
    resolution : role → least step of the sensor [SI], 0 where none could be told
    findings : what a person should know about how the signals came about
    """

    def __init__(self, joint: str, roles: Collection[str]) -> None:
        self.joint = joint
        self.period = 0.0
        self.run_names: tuple[str, ...] = ("",)
        self.resolution: dict[str, float] = {}
        self.findings: tuple[Finding, ...] = ()
        spool = Spool()
        self._stamps = SpooledColumn(spool, np.int64)
        self._roles = {role: SpooledColumn(spool, np.float64) for role in roles}
        self._starts: list[Rows] = []
        self._first_rows: list[int] = []
        self._origins: list[int] = []

    def begin_run(self, origin: int) -> None:
        """Begin a run; `origin` is its log's first stamp [ns]."""
        self._first_rows.append(len(self))
        self._origins.append(origin)

    def append(self, stamps: NDArray[np.int64], roles: Mapping[str, Array], starts: NDArray[np.bool_]) -> None:
        """Append rows to the run that was begun last."""
        self._starts.append(len(self) + np.flatnonzero(starts))
        for role, column in self._roles.items():
            column.add(len(column), roles[role])
        self._stamps.add(len(self._stamps), stamps)

    def __len__(self) -> int:
        return len(self._stamps)

    @property
    def starts(self) -> Rows:
        """The rows at which a run begins."""
        if len(self._starts) > 1:
            self._starts = [np.concatenate(self._starts)]
        return self._starts[0]

    @property
    def longest_run(self) -> int:
        """Number of samples of the longest stretch without a gap."""
        return int(np.diff(np.append(self.starts, len(self))).max())

    def __getitem__(self, part: slice) -> JointSignals:
        """Return some rows, in order and without steps."""
        first, last, _ = part.indices(len(self))
        last = max(first, last)
        stamps = self._stamps[first:last]
        run = np.searchsorted(self._first_rows, np.arange(first, last), "right") - 1
        starts = np.zeros(last - first, dtype=np.bool_)
        low, high = np.searchsorted(self.starts, (first, last))
        starts[self.starts[low:high] - first] = True
        return JointSignals(
            self.joint,
            self.period,
            stamps,
            (stamps - np.array(self._origins, dtype=np.int64)[run]).astype(np.float64) * 1e-9,
            {role: column[first:last] for role, column in self._roles.items()},
            starts,
            run.astype(np.int32),
            self.run_names,
            self.resolution,
            self.findings,
        )

    def blocks(self, size: int) -> Iterator[JointSignals]:
        """Read in blocks of at most `size` samples."""
        for start in range(0, len(self), size):
            yield self[start : start + size]

    def look(self) -> JointSignals:
        """Return stretches from which filters, scales and priors can be derived; all there is where that is little.

        They are spread evenly. Those in which a signal or a deflection is greatest or least are among them, so that its range is
        the whole log's, and so is the beginning of the longest run.
        """
        count = -(-len(self) // STRETCH)
        chosen = {*np.linspace(0, count - 1, STRETCHES).astype(int).tolist(), *self._longest(), *self._extremes()}
        looked_at = _joined([self[k * STRETCH : (k + 1) * STRETCH] for k in sorted(chosen)])
        follows = np.isin(np.array(sorted(chosen)) - 1, sorted(chosen))
        firsts = np.arange(len(chosen))[~follows] * STRETCH
        starts = looked_at.starts.copy()
        starts[firsts] = True
        return replace(looked_at, starts=starts)

    def _longest(self) -> list[int]:
        """Return the stretches at the beginning of the longest run."""
        edges = np.append(self.starts, len(self))
        first = int(edges[np.argmax(np.diff(edges))])
        last = min(first + LONGEST, len(self))
        return list(range(first // STRETCH, -(-last // STRETCH)))

    def _extremes(self) -> set[int]:
        """Return the stretches in which a signal or a deflection is greatest or least."""
        found: dict[str, list[tuple[float, float]]] = {}
        for block in self.blocks(STRETCH):
            for name, values in _told(block.roles):
                finite = values[np.isfinite(values)]
                ends = (float(finite.min()), float(finite.max())) if finite.size else (np.inf, -np.inf)
                found.setdefault(name, []).append(ends)
        extremes: set[int] = set()
        for all_ends in found.values():
            low, high = np.array(all_ends).T
            extremes |= {int(np.argmin(low)), int(np.argmax(high))}
        return extremes


def _told(roles: Mapping[str, Array]) -> Iterator[tuple[str, Array]]:
    """Yield the signals and the deflections that they make up."""
    yield from roles.items()
    if "link_position" in roles:
        for role, values in roles.items():
            if role.startswith("motor_position"):
                yield f"deflection of {role}", roles["link_position"] - values


def _joined(pieces: list[JointSignals]) -> JointSignals:
    first = pieces[0]
    return replace(
        first,
        stamps=np.concatenate([p.stamps for p in pieces]),
        time=np.concatenate([p.time for p in pieces]),
        roles={role: np.concatenate([p.roles[role] for p in pieces]) for role in first.roles},
        starts=np.concatenate([p.starts for p in pieces]),
        run=np.concatenate([p.run for p in pieces]),
    )
