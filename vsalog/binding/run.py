"""The roles of one run of a joint, resampled to one grid, block by block."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.findings import binding_findings
from vsalog.binding.grid import MOST_RATE_ERROR, OffGrid, after_long_silence, common_segments, filled, on_grid
from vsalog.binding.role import Ahead, Role
from vsalog.core.column import PART
from vsalog.core.errors import BindingError
from vsalog.core.finding import Finding
from vsalog.core.signals import Interpolated
from vsalog.filters.unwrapping import SameTurn, turnable, turned_on

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Stamps = NDArray[np.int64]


class BoundRun:
    """The roles of one run.

    Parameters
    ----------
    log, joint : their names
    roles : by name, or a constant
    origin : the log's first stamp [ns]
    noise : whether the noise of roles that have to be interpolated is computed
    period : of the grid [ns]; that of the fastest channel, `sampled`, when absent

    Raises
    ------
    BindingError
        Nothing moves, or the roles have no time in common.
    """

    def __init__(
        self, log: str, joint: str, roles: Mapping[str, Role | float], origin: int, *, noise: bool, period: int | None = None
    ) -> None:  # fmt: skip
        self.log, self.joint, self.roles, self.origin = log, joint, roles, origin
        self.moving = {name: role for name, role in roles.items() if isinstance(role, Role)}
        if not self.moving:
            raise BindingError(f"joint '{joint}': every role is a constant; there is nothing to estimate from")
        self.sampled = min(role.period for role in self.moving.values())
        self.period = self.sampled if period is None else period
        if self.period <= 0:
            raise BindingError(f"{log}: the time stamps of joint '{joint}' do not advance")
        self.segments = common_segments(log, joint, (role.stretches() for role in self.moving.values()))
        self._off_grid = {name: OffGrid() for name in (self.moving if noise else ())}
        self._turns: dict[str, SameTurn] = {}

    def blocks(self) -> Iterator[tuple[Stamps, dict[str, Array], Flags]]:
        """Yield stamps, roles and where stretches without a gap begin, in order; all else is known at the end."""
        ahead = {name: Ahead(role) for name, role in self.moving.items()}
        wrapped = [name for name, role in self.moving.items() if role.wrapped]
        self._turns = {name: SameTurn() for name in turnable(self.roles, wrapped)}
        silence = 0
        for stamps, begins in self._grid():
            roles: dict[str, Array] = {}
            for name, role in self.roles.items():
                if not isinstance(role, Role):
                    roles[name] = np.full(stamps.size, role)
                    continue
                around = ahead[name].around(int(stamps[0]), int(stamps[-1]))
                roles[name] = on_grid(around, stamps)
                if name in self._off_grid:
                    self._off_grid[name].add(around, stamps)
            starts, silence = after_long_silence(roles, silence)
            starts |= begins
            for name, state in self._turns.items():
                roles[name] = turned_on(roles["link_position"], roles[name], starts, state)
            yield stamps, roles, starts
        for one in ahead.values():
            one.finish()

    @property
    def rows(self) -> int:
        """How many rows the grid has, give or take a few."""
        return sum((last - first) // self.period + 1 for first, last in self.segments)

    def findings(self) -> tuple[Finding, ...]:
        """Return the findings about the binding of the signals."""
        tallies = {name: role.tally for name, role in self.moving.items()}
        turned = [name for name, state in self._turns.items() if state.ever]
        found = binding_findings(self.joint, self.segments, tallies, self.origin)
        return (*found, *_turned_findings(self.joint, turned))

    def told(self) -> tuple[dict[str, float], dict[str, Interpolated]]:
        """Return role → least step of its sensor, and role → noise of those that were interpolated, if requested."""
        resolution: dict[str, float] = {}
        interpolated: dict[str, Interpolated] = {}
        for name, role in self.moving.items():
            look, off = role.look(), self._off_grid.get(name)
            assert look.resolution is not None
            resolution[name] = look.resolution
            if off is not None and (off.off or role.tally.samples != off.rows):
                interpolated[name] = off.noise(look, self.period)
        return resolution, interpolated

    def _grid(self) -> Iterator[tuple[Stamps, Flags]]:
        """Yield the grid's stamps in blocks, and where runs begin.

        They are those of the fastest channel in segments where these are even, evenly spaced ones otherwise, and those of lost
        rows between segments that a few are lost between.
        """
        block: list[tuple[Stamps, Flags]] = []
        for piece in self._pieces():
            rows = sum(stamps.size for stamps, _ in block)
            # Roles are not held across a long gap.
            if block and (rows + piece[0].size > PART or piece[0][0] - block[0][0][0] > 2 * PART * self.period):
                yield _joined(block)
                block = []
            block.append(piece)
        yield _joined(block)

    def _pieces(self) -> Iterator[tuple[Stamps, Flags]]:
        fastest = min(self.moving.values(), key=lambda role: role.period)
        alike = abs(fastest.period - self.period) <= MOST_RATE_ERROR * self.period
        on_it = fastest.even(self.segments, self.period) if alike else [False] * len(self.segments)
        before: int | None = None
        for segment, even in zip(self.segments, on_it, strict=True):
            first, last = fastest.rows(segment) if even else (0, (segment[1] - segment[0]) // self.period + 1)
            for begin in range(first, last, PART):
                end = min(begin + PART, last)
                if even:
                    stamps = fastest.channel.stamps[begin:end] + fastest.shift
                else:
                    stamps = segment[0] + self.period * np.arange(begin, end, dtype=np.int64)
                begins = np.arange(begin, end) == first
                if begin == first and before is not None:
                    lost = filled(before, int(stamps[0]), self.period)
                    if lost.size:
                        yield lost, np.zeros(lost.size, dtype=np.bool_)
                        begins[0] = False
                yield stamps, begins
                before = int(stamps[-1])


def _joined(pieces: list[tuple[Stamps, Flags]]) -> tuple[Stamps, Flags]:
    stamps, begins = zip(*pieces, strict=True)
    return np.concatenate(stamps), np.concatenate(begins)


def _turned_findings(joint: str, turned: Collection[str]) -> Iterator[Finding]:
    """Yield of roles that they were turned by whole turns."""
    for role in turned:
        yield Finding(code="encoder.other_turn", joint=joint, part=role, severity="info")
