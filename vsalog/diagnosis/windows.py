"""The rig's simulation in windows, each begun anew: multiple shooting, the states at the windows' beginnings free.

A simulation that runs through a whole log drifts away for reasons of no interest, and one restarted from a measured state
carries the noise of a derivative. So every window's state at its beginning is fitted, as unknowns that belong to no cause, and
what is left over is what the rig cannot explain within a window, whatever it began with.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.channels import Channels
from vsalog.diagnosis.sensing import said, true_roles
from vsalog.diagnosis.windows_mechanical import MechanicalPlayer
from vsalog.diagnosis.windows_pneumatic import PneumaticPlayer
from vsalog.errors import SimulationError
from vsalog.rig.schema import PneumaticJoint

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Length of a window [s], its fewest samples, and how many of a long log are simulated.
WINDOW, FEWEST, MOST = 0.5, 20, 60


class Player(Protocol):
    """What plays a joint of some kind in windows."""

    def driving(self) -> list[str]:
        """Return the roles that drive the joint where they are recorded."""
        ...

    def answered(self) -> list[str]:
        """Return the recorded roles that a simulation answers to."""
        ...

    def measured_states(self) -> Array:
        """Return the states as rig and filter have them, shape (N, n), NaN where they are not known."""
        ...

    def free(self, states: Array) -> Mapping[int, tuple[float, Flags]]:
        """Return state → a small change of it, and the windows, shape (W,), in which nothing prescribes it."""
        ...

    def simulated(
        self, spans: NDArray[np.int64], states: Array, hold: bool
    ) -> Iterator[tuple[slice, Mapping[str, Array]]]:
        """Yield stretches of samples and the truth in them, windows begun with states of shape (W, n)."""
        ...


def player_of(joint: Any, channels: Channels) -> Player:
    """Return what plays a joint of this kind.

    Raises
    ------
    SimulationError
        The joint cannot be simulated, or nothing drives it.
    """
    kind = PneumaticPlayer if isinstance(joint, PneumaticJoint) else MechanicalPlayer
    return kind(joint, channels)


@dataclass(frozen=True, slots=True)
class Windows:
    """Windows of a log that a joint's simulation is held against.

    Attributes
    ----------
    channels : as recorded
    spans : first and last sample of each window, shape (W, 2)
    roles : that the simulation answers to
    hold : whether recorded torques act from sample to sample
    """

    channels: Channels
    spans: NDArray[np.int64]
    roles: tuple[str, ...]
    hold: bool

    @property
    def window(self) -> NDArray[np.int64]:
        """Window of each sample, shape (N,), −1 for none."""
        out = np.full(len(self.channels), -1, dtype=np.int64)
        for w, (first, last) in enumerate(self.spans):
            out[first:last] = w
        return out

    def part(self, chosen: Sequence[int]) -> Windows:
        """Return some of the windows."""
        return replace(self, spans=self.spans[np.asarray(chosen, dtype=np.int64)])


@dataclass(frozen=True, slots=True)
class Shot:
    """A simulation of the windows.

    Attributes
    ----------
    states : shape (W, n), at the windows' beginnings
    errors : role → recorded − simulated, shape (N,), NaN outside the windows
    """

    states: Array
    errors: Mapping[str, Array]

    def whitened(self, windows: Windows) -> Array:
        """Return the errors in the windows over their noise, all roles, shape (W·L·roles,) in the order of `blocks`."""
        return np.concatenate(
            [self.errors[r][a:b] / _floor(windows, r) for a, b in windows.spans for r in windows.roles]
        )


def windows_of(joint: Any, channels: Channels, hold: bool) -> Windows:
    """Lay windows over a log.

    Raises
    ------
    SimulationError
        The rig cannot be simulated, no input drives it, or no run of the log is long enough.
    """
    player = player_of(joint, channels)
    length = max(FEWEST, round(WINDOW / channels.period))
    roles = true_roles(joint, channels, 0.0)
    states = player.measured_states()
    good = np.isfinite(states).all(axis=1)
    for role in player.driving():
        if role in roles:
            good &= np.isfinite(roles[role][0])
    edges = np.flatnonzero(np.diff(np.r_[False, good, False].astype(np.int8)))
    cuts = np.flatnonzero(channels.starts)
    spans = []
    for first, last in edges.reshape(-1, 2):
        inner = [first, *(c for c in cuts if first < c < last), last]
        for a, b in pairwise(inner):
            spans += [(k, k + length) for k in range(a, b - length + 1, length)]
    if not spans:
        raise SimulationError(f"no run of the log is as long as {length * channels.period:g} s with all of its inputs")
    kept = np.linspace(0, len(spans) - 1, min(MOST, len(spans))).round().astype(np.int64)
    answered = tuple(r for r in player.answered() if np.ptp(channels.raw[r]) > 0.0)
    if not answered:
        raise SimulationError("nothing is recorded that a simulation could be held against")
    return Windows(channels, np.array(spans)[kept], answered, hold)


def shoot(joint: Any, windows: Windows, states: Array) -> Shot:
    """Simulate the windows from given states.

    Parameters
    ----------
    joint : of the rig
    windows : of the log
    states : shape (W, n), what they begin with

    Raises
    ------
    SimulationError
        The motion leaves what the model describes.
    """
    channels = windows.channels
    errors = {role: np.full(len(channels), np.nan) for role in windows.roles}
    for part, truth in player_of(joint, channels).simulated(windows.spans, states, windows.hold):
        time = channels.time[part.start] + np.arange(part.stop - part.start) * channels.period
        for role in windows.roles:
            errors[role][part] = channels.raw[role][part] - said(joint, role, truth, time)
    return Shot(states, errors)


def begun(joint: Any, windows: Windows, states: Array | None = None, rounds: int = 2) -> Shot:
    """Simulate the windows from the states that fit them best.

    Parameters
    ----------
    joint : of the rig
    windows : of the log
    states : to start the search with; the measured ones when absent
    rounds : Newton steps
    """
    if states is None:
        states = player_of(joint, windows.channels).measured_states()[windows.spans[:, 0]]
    shot = shoot(joint, windows, states)
    J = by_states(joint, windows, shot)
    for _ in range(rounds):
        r = in_windows(shot, windows)
        moved = shot.states - np.stack([_least(J[w], r[w]) for w in range(len(r))])
        shot = _better(joint, windows, shot, moved)
    return shot


def _better(joint: Any, windows: Windows, shot: Shot, moved: Array) -> Shot:
    """Take the new state in each window where it is better."""
    try:
        trial = shoot(joint, windows, moved)
    except SimulationError:
        return shot
    before, after = (np.sum(in_windows(s, windows) ** 2, axis=1) for s in (shot, trial))
    kept = np.where((after < before)[:, None], trial.states, shot.states)
    if (after < before).all():
        return trial
    return shoot(joint, windows, kept)


def in_windows(shot: Shot, windows: Windows) -> Array:
    """Return the errors over their noise, window by window, shape (W, L · roles)."""
    return shot.whitened(windows).reshape(len(windows.spans), -1)


def by_states(joint: Any, windows: Windows, shot: Shot) -> Array:
    """Return the change of each window's errors with its state, shape (W, L · roles, n)."""
    base = in_windows(shot, windows)
    out = np.zeros((*base.shape, shot.states.shape[1]))
    for i, (nudge, where) in player_of(joint, windows.channels).free(shot.states).items():
        states = shot.states.copy()
        states[where, i] += nudge
        change = (in_windows(shoot(joint, windows, states), windows) - base) / nudge
        out[where, :, i] = change[where]
    return out


def _least(J: Array, r: Array) -> Array:
    scale = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    return np.asarray(np.linalg.lstsq(J / scale, r, rcond=1e-8)[0] / scale)


def _floor(windows: Windows, role: str) -> float:
    noise = windows.channels.noise[role].floor
    return noise or 1e-6 * float(np.std(windows.channels.raw[role])) or 1.0
