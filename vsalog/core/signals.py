"""A recording bound to a rig: the roles of one joint in SI units on one uniform time grid."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vsalog.core.column import is_mapped, let_go
from vsalog.core.finding import Finding

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


# The advice where every stretch of a log is too short.
LONGER = "record longer, and with even stamps (jitter makes gaps; --time uses another clock)"


@dataclass(frozen=True, slots=True)
class Interpolated:
    """Noise of a sensor whose samples are not on the grid. Interpolated, neighbours share it, and differences hide it.

    Attributes
    ----------
    deviation : of white noise on the grid with as much power at low frequencies as the samples have [SI]
    share : standard deviation of an interpolated sample over that
    """

    deviation: float
    share: float


@dataclass(frozen=True, slots=True)
class JointSignals:
    """The signals of one joint, or a block of them: a slice of a `JointSignals` is one too.

    Attributes
    ----------
    joint : the joint's name
    period : T [s], of the grid
    stamps : shape (N,), int64 ns as in the log
    time : shape (N,), seconds from the start of the log
    roles : role → values, shape (N,), SI, on the joint's side of the gear; NaN where the log has none
    starts : shape (N,), where a run begins: the first sample, and the first one after a gap
    run : shape (N,), index into `run_names`
    run_names : names of the runs (groups of a file, or files); ("",) when there is just one
    resolution : role → least step of the sensor [SI], 0 where none was found
    findings : about the binding of the signals
    interpolated : role → noise of those whose samples were taken between the grid's; empty where it was not requested
    periods : of each run, its own sample time [s]; empty where that is the grid's
    """

    joint: str
    period: float
    stamps: NDArray[np.int64]
    time: Array
    roles: Mapping[str, Array]
    starts: Flags
    run: NDArray[np.int32]
    run_names: tuple[str, ...] = ("",)
    resolution: Mapping[str, float] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    interpolated: Mapping[str, Interpolated] = field(default_factory=dict)
    periods: tuple[float, ...] = ()

    def __len__(self) -> int:
        return int(self.time.shape[0])

    @property
    def longest_run(self) -> int:
        """Number of samples of the longest stretch without a gap."""
        return int(np.diff(np.append(np.flatnonzero(self.starts), len(self))).max())

    @property
    def in_file(self) -> bool:
        """Whether they are too long for memory, and are in memory-mapped files."""
        return is_mapped(self.stamps)

    def __getitem__(self, part: slice) -> JointSignals:
        return replace(
            self,
            stamps=self.stamps[part],
            time=self.time[part],
            roles={role: values[part] for role, values in self.roles.items()},
            starts=self.starts[part],
            run=self.run[part],
        )

    def joined(self, following: JointSignals) -> JointSignals:
        """Return this block and the one that follows it as one."""
        return replace(
            following,
            stamps=np.concatenate((self.stamps, following.stamps)),
            time=np.concatenate((self.time, following.time)),
            roles={r: np.concatenate((self.roles[r], v)) for r, v in following.roles.items()},
            starts=np.concatenate((self.starts, following.starts)),
            run=np.concatenate((self.run, following.run)),
        )

    def blocks(self, size: int) -> Iterator[JointSignals]:
        """Cut into blocks of at most `size` samples."""
        for start in range(0, len(self), size):
            block = self[start : start + size]
            yield block
            let_go(block.stamps, block.time, block.starts, block.run, *block.roles.values())

    def between_gaps(self) -> Iterator[JointSignals]:
        """Cut at the gaps, so that only the first sample of a piece can be a start."""
        cuts = np.flatnonzero(self.starts)
        edges = [0, *[int(c) for c in cuts if c > 0], len(self)]
        for first, last in pairwise(edges):
            if last > first:
                yield self[first:last]
