"""What the causes are worth: simulation errors before and after, on windows that the causes were not fitted to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import SimulationError
from vsalog.core.significance import DRAWS, SIGNIFICANCE
from vsalog.residuals.channels import Channels
from vsalog.residuals.windows import (
    WITHIN,
    Shot,
    Windows,
    begun,
    begun_as,
    by_states,
    floor_of,
    in_runs,
    in_windows,
    player_of,
    shoot,
)
from vsalog.residuals.windows_mechanical import MechanicalPlayer
from vsalog.uncertainty.long_run import ENOUGH_BATCHES

Array = NDArray[np.float64]

# Parts of a log that determine as much as the whole [1]: windows that are fitted, or simulated where that takes long, and blocks.
PARTS = 20
# Integration steps per sample up to which all windows are simulated [1]; and how many of these a stiff one takes as long as.
AFFORDABLE_STEPS, COST_OF_STIFF_STEP = 16, 12


def reduction_of(before: Array, after: Array) -> tuple[float, tuple[float, float]]:
    """Return 1 − after / before of root mean squares, and its 95 % interval: a bootstrap over parts of the data.

    Parameters
    ----------
    before, after : shape (W,), squares of the errors in each part
    """
    count = before.size
    counts = np.random.default_rng(0).multinomial(count, np.full(count, 1.0 / count), size=DRAWS)
    drawn = 1.0 - np.sqrt((counts @ after) / np.maximum(counts @ before, 1e-300))
    low, high = np.quantile(drawn, [0.5 * SIGNIFICANCE, 1.0 - 0.5 * SIGNIFICANCE])
    return float(1.0 - np.sqrt(after.sum() / max(before.sum(), 1e-300))), (float(low), float(high))


@dataclass(frozen=True, slots=True)
class Compared:
    """The original rig and its extension, on the same windows.

    Attributes
    ----------
    windows : of the log
    before, after : simulations; `after` is `before` where nothing was found
    floor : role → error from noise alone
    """

    windows: Windows
    before: Shot
    after: Shot
    floor: Mapping[str, float]

    def squares(self, shot: Shot, role: str) -> Array:
        """Return Σ of squares of a role's error in each window, shape (W,)."""
        return np.array([np.sum(shot.errors[role][a:b] ** 2) for a, b in self.windows.spans])

    def rmse(self, shot: Shot, role: str) -> float:
        """Return the root mean square error of a role."""
        samples = int(np.sum(self.windows.spans[:, 1] - self.windows.spans[:, 0]))
        return float(np.sqrt(self.squares(shot, role).sum() / samples))

    def reduction(self, role: str) -> tuple[float, tuple[float, float]]:
        """Return 1 − after / before and its 95 % interval, from windows drawn again."""
        return reduction_of(self.squares(self.before, role), self.squares(self.after, role))

    def within(self, shot: Shot) -> bool:
        """Return whether every signal is within its noise."""
        return all(self.rmse(shot, role) <= WITHIN * noise for role, noise in self.floor.items() if noise > 0.0)

    @property
    def helps(self) -> bool:
        """Whether the extended rig is better on these windows: against the noise of all roles together, and on their average."""
        pairs = [(self.rmse(self.before, role), self.rmse(self.after, role)) for role in self.floor]
        changes = [np.log(after / before) for before, after in pairs if before > 0.0 and after > 0.0]
        return self.whole(self.after) < self.whole(self.before) and float(np.sum(changes)) <= 0.0

    def whole(self, shot: Shot) -> float:
        """Return the Σ of squares of all roles over their noise."""
        return float(np.sum(in_windows(shot, self.windows) ** 2))


@dataclass(frozen=True, slots=True)
class Share:
    """How far a signal's simulation is from one of several logs.

    Attributes
    ----------
    log : its number
    role : of the signal
    before, after : root mean square error with the original rig, and extended
    """

    log: int
    role: str
    before: float
    after: float


def shares_of(gain: Compared) -> tuple[Share, ...]:
    """Return the errors on each log's windows of the original rig, and extended."""
    windows = gain.windows
    log = windows.channels.log
    assert log is not None
    own = log[windows.spans[:, 0]]
    length = int(windows.spans[0, 1] - windows.spans[0, 0])

    def rms(shot: Shot, role: str, k: int) -> float:
        return float(np.sqrt(gain.squares(shot, role)[own == k].mean() / length))

    return tuple(
        Share(int(k), role, rms(gain.before, role, k), rms(gain.after, role, k))
        for k in np.unique(own)
        for role in windows.roles
    )


@dataclass(frozen=True, slots=True)
class Standing:
    """How far the original rig is from the log that is diagnosed.

    Attributes
    ----------
    windows : of the log
    shot : their simulation, from the states that fit them best
    floor : role → error from noise alone
    through : role → root mean square error of one simulation from the first window's beginning to the end of its run; empty
        where it does not get through
    """

    windows: Windows
    shot: Shot
    floor: Mapping[str, float]
    through: Mapping[str, float]

    def rmse(self, role: str) -> float:
        """Return the root mean square error of a role in the windows."""
        return float(np.sqrt(np.nanmean(self.shot.errors[role] ** 2)))


def standing(joint: Any, windows: Windows, known: Compared | None = None) -> Standing:
    """Simulate a log with the original rig, in windows and as a whole.

    Parameters
    ----------
    joint : of the rig
    windows : of the log
    known : the same windows simulated before, if they were

    Raises
    ------
    SimulationError
        The rig cannot be simulated there.
    """
    windows = weighed(joint, windows) if known is None else known.windows
    shot = begun(joint, windows) if known is None else known.before
    floor = floors(joint, windows, shot, draws=_draws(windows)) if known is None else known.floor
    first = int(windows.spans[0, 0])
    cuts = [int(k) for k in np.flatnonzero(windows.channels.starts) if k > first]
    last = min([int(windows.spans[-1, 1]), *cuts])
    whole = replace(windows, spans=np.array([[first, last]]))
    try:
        errors = shoot(joint, whole, shot.states[:1]).errors
    except SimulationError:
        return Standing(windows, shot, floor, {})
    through = {role: float(np.sqrt(np.nanmean(errors[role][first:last] ** 2))) for role in windows.roles}
    return Standing(windows, shot, floor, {r: e for r, e in through.items() if np.isfinite(e)})


def compared(before: Any, after: Any, windows: Windows) -> Compared:
    """Simulate windows with two rigs, each from the states that fit it best.

    Parameters
    ----------
    before, after : the original rig, and extended
    windows : of the log

    Raises
    ------
    SimulationError
        The original rig cannot be simulated there.
    """
    windows = weighed(after, _affordable(after, windows))
    one = begun(before, windows)
    two = one
    if after is not before:
        two = begun(after, windows)
        one, two = begun_as(before, windows, one, two), begun_as(after, windows, two, one)
    return Compared(windows, one, two, floors(after, windows, two, draws=_draws(windows)))


def weighed(joint: Any, windows: Windows) -> Windows:
    """Return windows whose errors are weighted by their noise, measured on a few of them.

    A fine encoder on a motor whose recorded torque is coarse is followed no better than that torque allows; weighted by the
    encoder's noise alone, everything else would be biased to follow it.
    """
    if windows.scale is not None:
        return windows
    count = len(windows.spans)
    few = windows.part(np.unique(np.linspace(0, count - 1, min(count, PARTS)).round().astype(np.int64)))
    states = player_of(joint, windows.channels).measured_states()[few.spans[:, 0]]
    try:
        found = floors(joint, few, shoot(joint, few, states), np.median)
    except SimulationError:
        return windows
    return replace(windows, scale=found) if all(v > 0.0 for v in found.values()) else windows


def _affordable(joint: Any, windows: Windows) -> Windows:
    """Return fewer windows of a machine that takes many integration steps, as stiff bristles do."""
    player = player_of(joint, windows.channels)
    if not isinstance(player, MechanicalPlayer):
        return windows
    share = AFFORDABLE_STEPS / (player.steps * (COST_OF_STIFF_STEP if player.stiff else 1))
    count = len(windows.spans)
    kept = int(np.clip(share * count, min(PARTS, count), count))
    return windows if kept == count else windows.part(in_runs(count, kept))


def floors(
    joint: Any, windows: Windows, shot: Shot, typical: Callable[..., Any] = np.mean, draws: int = 1
) -> dict[str, float]:
    """Return the error of each role from noise alone: its sensor's, and what noise in the recorded torques moves.

    The second is measured: the windows are simulated with torques, voltages or prescribed motions that carry noise of the same
    kind once more, and what the states at the beginnings can make up for is taken off.

    Parameters
    ----------
    joint : of the rig
    windows : of the log
    shot : their simulation
    typical : of the windows' mean squares
    draws : of noise
    """
    channels, player = windows.channels, player_of(joint, windows.channels)
    own = {role: channels.noise[role].floor for role in windows.roles}
    scale = np.array([floor_of(windows, r) for r in windows.roles])
    S, squares = by_states(joint, windows, shot), []
    for draw in range(draws):
        rng, raw = np.random.default_rng([0, draw]), dict(channels.raw)
        for role in player.driving():
            if role in raw and channels.noise[role].deviation:
                raw[role] = raw[role] + channels.noise[role].deviation * rng.standard_normal(raw[role].size)
        try:
            noisy = _followed_again(channels, player.followed(), draw).driven_by(raw)
            moved = shoot(joint, replace(windows, channels=noisy), shot.states)
        except SimulationError:
            return own
        off = in_windows(moved, windows) - in_windows(shot, windows)
        left = np.stack([d - s @ np.linalg.lstsq(s, d, rcond=1e-8)[0] for d, s in zip(off, S, strict=True)])
        length = left.shape[1] // len(windows.roles)
        squares.append(np.mean(left.reshape(len(left), len(windows.roles), length) ** 2, axis=2))
    rms = np.sqrt(typical(np.concatenate(squares), axis=0)) * scale
    return {role: float(np.hypot(own[role], rms[i])) for i, role in enumerate(windows.roles)}


def _draws(windows: Windows) -> int:
    """Return how many draws of noise make enough windows: what integrates noise has one number a window."""
    return -(-ENOUGH_BATCHES // len(windows.spans))


def _followed_again(channels: Channels, followed: Sequence[str], draw: int) -> Channels:
    """Return the channels, those that are followed with their sensors' noise once more.

    Two measurements of one motion differ by the noise of both.
    """
    if not followed:
        return channels
    one, other = (channels.with_noise(seed).roles for seed in (2 * draw + 1, 2 * draw + 2))
    again = {r: channels.roles[r] + (one[r] - other[r]) / 2.0**0.5 for r in followed}
    return replace(channels, roles={**channels.roles, **again})
