"""The rig's simulation in windows, each begun again: multiple shooting, the states at the windows' beginnings free.

A simulation that runs through a whole log drifts away for irrelevant reasons, and one restarted from a measured state
carries the noise of a derivative. So every window's state at its beginning is fitted, as unknowns that belong to no cause, and
the residual is what the rig cannot explain within a window, whatever it began with.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import SimulationError
from vsalog.effects.delay import LATEST
from vsalog.estimators.equation import NEGLIGIBLE_SHARE
from vsalog.residuals.channels import Channels, span_of
from vsalog.residuals.per_log import PerLog, any_of
from vsalog.residuals.sensing import known, sensor_reading, true_roles
from vsalog.residuals.windows_bench import BenchPlayer
from vsalog.residuals.windows_mechanical import MechanicalPlayer, free_motors, link_told, movable, remembers
from vsalog.residuals.windows_pneumatic import PneumaticPlayer
from vsalog.residuals.windows_rigid import RigidPlayer
from vsalog.rig.schema import ElasticJoint, PneumaticJoint, RigidJoint

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]

FEWEST = 20
"""Samples of a window at least."""
MOST = 40
"""Windows of a long log that are simulated."""
RUNS = 4
"""Runs in which they are chosen."""
WITHIN = 2.0
"""Times their noise within which an equation closes, and times the mean square of its noise within which a simulation is
right: noise is measured to about a third."""


class Player(Protocol):
    """What simulates a joint of some kind in windows.

    Attributes
    ----------
    model : the joint without the parts that are left out
    window : how long a window is to be [s]
    settling : how long after a run's beginning unmeasured states are not known yet; windows may be shorter then [s]
    """

    model: Any
    window: float
    settling: float

    def driving(self) -> list[str]:
        """Return the roles that drive the joint where they are recorded, as they were recorded."""
        ...

    def followed(self) -> list[str]:
        """Return the recorded roles that prescribe the joint's motion, filtered."""
        ...

    def answered(self) -> list[str]:
        """Return the recorded roles that a simulation predicts."""
        ...

    def moving(self) -> list[str]:
        """Return the parts of the joint, as `motor`, that torques move; all others move as they were measured."""
        ...

    def measured_states(self) -> Array:
        """Return the states as rig and filter have them, shape (N, n), NaN where they are not known."""
        ...

    def free(self, states: Array) -> Mapping[int, tuple[float, Flags]]:
        """Return state → a small change of it, and the windows, shape (W,), in which nothing prescribes it."""
        ...

    def after(self, truth: Mapping[str, Array], sample: int) -> Array:
        """Return the state one sample later than one of the truth, shape (n,), NaN where that is not known."""
        ...

    def simulated(
        self, spans: NDArray[np.int64], states: Array, hold: bool
    ) -> Iterator[tuple[slice, Mapping[str, Array]]]:
        """Yield stretches of samples and the truth in them, windows begun with states of shape (W, n)."""
        ...


def player_of(joint: Any, channels: Channels) -> Player:
    """Return what simulates a joint of this kind.

    Raises
    ------
    SimulationError
        The joint cannot be simulated, or nothing drives it.
    """
    joint = any_of(joint)
    if isinstance(joint, PneumaticJoint):
        return PneumaticPlayer(joint, channels)
    if isinstance(joint, RigidJoint):
        return RigidPlayer(joint, channels)
    if movable(joint, channels):
        return MechanicalPlayer(joint, channels)
    if joint.link is None and not link_told(joint, channels) and isinstance(joint, ElasticJoint):
        # No encoder measures the link, and nothing drives it: a torque sensor measures its torque.
        alone = RigidJoint(motor=joint.motor, signals=joint.signals)
        if free_motors(joint, channels) and known(channels.roles, "motor_position", "torque_sensor"):
            return RigidPlayer(alone, channels)
    return BenchPlayer(joint, channels)


@dataclass(frozen=True, slots=True)
class Windows:
    """Windows of a log that a joint's simulation is compared with.

    Attributes
    ----------
    channels : as recorded
    spans : first and last sample of each window, shape (W, 2)
    roles : that the simulation predicts
    hold : whether recorded torques act from sample to sample
    scale : role → error from noise, the sensors' and that of the recorded torques, by which errors are weighted; the
        sensors' alone where absent
    """

    channels: Channels
    spans: NDArray[np.int64]
    roles: tuple[str, ...]
    hold: bool
    scale: Mapping[str, float] | None = None

    @property
    def window(self) -> NDArray[np.int64]:
        """Window of each sample, shape (N,), −1 for none."""
        out = np.full(len(self.channels), -1, dtype=np.int64)
        for w, (first, last) in enumerate(self.spans):
            out[first:last] = w
        return out

    def part(self, chosen: Sequence[int] | Integers) -> Windows:
        """Return some of the windows."""
        return replace(self, spans=self.spans[np.asarray(chosen, dtype=np.int64)])

    def first(self, share: float) -> Windows:
        """Return the first part of each window."""
        length = max(FEWEST, int(share * (self.spans[0, 1] - self.spans[0, 0])))
        ends = np.minimum(self.spans[:, 0] + length, self.spans[:, 1])
        return replace(self, spans=np.stack([self.spans[:, 0], ends], axis=-1))


@dataclass(frozen=True, slots=True)
class Shot:
    """A simulation of the windows.

    Attributes
    ----------
    states : shape (W, n), at the windows' beginnings
    errors : role → recorded − simulated, shape (N,), NaN outside the windows
    ends : shape (W, n), states where the windows end, NaN where they are not known
    far : windows whose errors stay far above what a Gauss–Newton step predicts
    """

    states: Array
    errors: Mapping[str, Array]
    ends: Array
    far: Integers = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    @property
    def is_linear(self) -> bool:
        """Whether most windows respond to their initial states as linearly as a Gauss–Newton step assumes."""
        return 2 * self.far.size <= len(self.states)

    def part(self, chosen: Integers) -> Shot:
        """Return the simulation of some of the windows."""
        return Shot(self.states[chosen], self.errors, self.ends[chosen])

    def whitened(self, windows: Windows) -> Array:
        """Return the errors in the windows over their noise, all roles, shape (W·L·roles,) in the order of `blocks`."""
        return np.concatenate(
            [self.errors[r][a:b] / floor_of(windows, r) for a, b in windows.spans for r in windows.roles]
        )


def windows_of(joint: Any, channels: Channels, hold: bool) -> Windows:
    """Lay windows over a log.

    Raises
    ------
    SimulationError
        The rig cannot be simulated, no input drives it, or no run of the log is long enough.
    """
    player = player_of(joint, channels)
    length = max(FEWEST, round(player.window / channels.period))
    roles = true_roles(joint, channels, 0.0)
    answered = tuple(r for r in player.answered() if span_of(channels.raw[r]) > 0.0)
    if not answered:
        raise SimulationError("nothing is recorded that a simulation could be compared with")
    good = np.isfinite(player.measured_states()).all(axis=1)
    for role in answered:
        good &= np.isfinite(channels.raw[role])
    for role in (*player.driving(), *player.followed()):
        if role in roles:
            good &= np.isfinite(roles[role][0])
    edges = np.flatnonzero(np.diff(np.r_[False, good, False].astype(np.int8)))
    cuts = np.flatnonzero(channels.starts)
    # Channels may turn out to be late or early: a window's initial state and inputs must be known then too.
    margin = round(LATEST / channels.period) + 2
    before = margin + round(player.settling / channels.period)
    runs = []
    for first, last in edges.reshape(-1, 2):
        inner = [first, *(c for c in cuts if first < c < last), last]
        runs += [(a + before, b - margin) for a, b in pairwise(inner)]
    if player.settling:
        longest = max((b - a for a, b in runs), default=0)
        length = max(FEWEST, min(length, longest))
    spans = [(k, k + length) for a, b in runs for k in range(a, b - length + 1, length)]
    if not spans:
        raise SimulationError(f"no run of the log is as long as {length * channels.period:g} s with all of its inputs")
    return Windows(channels, np.array(spans)[in_runs(len(spans), MOST)], answered, hold)


def in_runs(count: int, most: int) -> Integers:
    """Choose windows in a few runs, spread over the log: loops and bristles go on from one window to the next."""
    if count <= most:
        return np.arange(count)
    length = most // RUNS
    begin = np.linspace(0, count - length, RUNS).round().astype(np.int64)
    return np.unique(begin[:, None] + np.arange(length))


def shoot(joint: Any, windows: Windows, states: Array) -> Shot:
    """Simulate the windows from given states.

    Parameters
    ----------
    joint : of the rig
    windows : of the log
    states : shape (W, n), initial states

    Raises
    ------
    SimulationError
        The motion leaves the range of the model.
    """
    if isinstance(joint, PerLog):
        return _each_log(joint, windows, states)
    channels, player = windows.channels, player_of(joint, windows.channels)
    errors = {role: np.full(len(channels), np.nan) for role in windows.roles}
    ends = np.full_like(states, np.nan)
    for part, truth in player.simulated(windows.spans, states, windows.hold):
        for w in np.flatnonzero((windows.spans[:, 0] >= part.start) & (windows.spans[:, 1] <= part.stop)):
            ends[w] = player.after(truth, int(windows.spans[w, 1]) - 1 - part.start)
        time = channels.time[part.start] + np.arange(part.stop - part.start) * channels.period
        for role in windows.roles:
            errors[role][part] = channels.raw[role][part] - sensor_reading(joint, role, truth, time)
    return Shot(states, errors, ends)


def _each_log(joint: PerLog, windows: Windows, states: Array) -> Shot:
    """Simulate each log's windows with the joint as it is there."""
    log = windows.channels.log
    assert log is not None
    errors = {role: np.full(len(windows.channels), np.nan) for role in windows.roles}
    shot = Shot(states.copy(), errors, np.full_like(states, np.nan))
    for k, one in enumerate(joint.joints):
        own = np.flatnonzero(log[windows.spans[:, 0]] == k)
        if own.size:
            shot = _merged(windows, shot, own, shoot(one, windows.part(own), states[own]))
    return shot


def begun(
    joint: Any,
    windows: Windows,
    states: Array | None = None,
    rounds: int = 2,
    *,
    near: Shot | None = None,
    slopes: Array | None = None,
) -> Shot:
    """Simulate the windows from the states that fit them best.

    Parameters
    ----------
    joint : of the rig
    windows : of the log
    states : to start the search with; the measured ones when absent
    rounds : Newton steps with one set of derivatives; windows that are still far off begin again
    near : simulation with a rig that is much like this one, to go on from instead
    slopes : of that rig, see `by_states`, to step with at first
    """
    if near is not None:
        states = near.states
    elif states is None:
        states = player_of(joint, windows.channels).measured_states()[windows.spans[:, 0]]
    if not player_of(joint, windows.channels).free(states):
        return shoot(joint, windows, states)
    # An unstable motion depends on its beginning non-linearly, the more the later it is: the first part of a window
    # shows its beginning well enough for the rest to be linear.
    for share in (0.1, 0.3) if near is None and not _remembers(joint, windows) else ():
        first = windows.first(share)
        states = _nearer(joint, first, shoot(joint, first, states), 1)[0].states
    shot, far = _nearer(joint, windows, shoot(joint, windows, states), rounds, slopes)
    shot, far = _gone_on(joint, windows, shot, far)
    # Windows in which something sticks are not linear either: they are fitted again with derivatives at their new states. A fit
    # that goes on from another rig's simulation calls again with such derivatives.
    for _ in range(2 if near is None else 0):
        if not far.size:
            break
        some = np.arange(len(windows.spans)) if _remembers(joint, windows) else far
        near, still = _nearer(joint, windows.part(some), shot.part(some), 1)
        if np.array_equal(near.states, shot.states[some]):
            break
        shot, far = _merged(windows, shot, some, near), some[still]
    return replace(shot, far=far)


def begun_as(joint: Any, windows: Windows, shot: Shot, other: Shot) -> Shot:
    """Try another rig's beginnings in the windows where those led that rig nearer, and go on from there.

    Of two rigs none must look worse only because the search for its states ended early.
    """
    worse = np.flatnonzero(_squares(shot, windows) > _squares(other, windows))
    if not worse.size:
        return shot
    shot, left = _better(joint, windows, shot, worse, other.states[worse])
    moved = np.setdiff1d(worse, left)
    if not moved.size:
        return shot
    some = np.arange(len(windows.spans)) if _remembers(joint, windows) else moved
    near, _ = _nearer(joint, windows.part(some), shot.part(some), 1)
    return _merged(windows, shot, some, near)


def _gone_on(joint: Any, windows: Windows, shot: Shot, far: Integers) -> tuple[Shot, Integers]:
    """Begin windows that are far off where the windows before them end, one after another: a part may stick on."""
    spans = windows.spans
    for _ in range(far.size):
        follow = np.array([w for w in far if w > 0 and spans[w, 0] == spans[w - 1, 1]], dtype=np.int64)
        follow = follow[np.isfinite(shot.ends[follow - 1]).all(axis=1)]
        if not follow.size:
            break
        shot, left = _better(joint, windows, shot, follow, shot.ends[follow - 1])
        if left.size == follow.size:
            break
    return shot, far


def _remembers(joint: Any, windows: Windows) -> bool:
    """Return whether the joint's state goes on from one window to the next, so that none is simulated alone."""
    return remembers(player_of(joint, windows.channels).model)


def _nearer(
    joint: Any, windows: Windows, shot: Shot, rounds: int, slopes: Array | None = None
) -> tuple[Shot, Integers]:
    """Take Newton steps with one set of derivatives; in each window the least damped one that is better.

    Returns
    -------
    The simulation, and the windows that are still far from what the derivatives predict
    """
    J = by_states(joint, windows, shot) if slopes is None else slopes.copy()
    norms = np.linalg.norm(J, axis=1)
    # A part that sticks forgets its velocity: a beginning must not be moved far by a slope with next to no information.
    J *= (norms > NEGLIGIBLE_SHARE * np.median(norms, axis=0))[:, None, :]
    promised = np.zeros(len(windows.spans))
    for _ in range(rounds):
        r = in_windows(shot, windows)
        step = np.stack([_least(J[w], r[w]) for w in range(len(r))])
        promised = np.mean((r - np.einsum("wln,wn->wl", J, step)) ** 2, axis=1)
        left = np.flatnonzero(_squares(shot, windows) > (1.0 + NEGLIGIBLE_SHARE) * promised)
        # From Gauss–Newton to a short step of gradient descent.
        for damping in (0.0, 1e-3, 0.03, 1.0):
            if not left.size:
                break
            # A state that a window hardly shows, as the velocity of a link without an encoder, must not leave the linear range.
            if damping:
                step[left] = np.stack([_least(J[w], r[w], damping) for w in left])
            shot, left = _better(joint, windows, shot, left, shot.states[left] - step[left])
    return shot, np.flatnonzero(_squares(shot, windows) > WITHIN * promised)


def _better(joint: Any, windows: Windows, shot: Shot, some: Integers, states: Array) -> tuple[Shot, Integers]:
    """Take new states in each of some windows where they are better; return the windows where they are not, too."""
    part, whole = windows.part(some), some
    if _remembers(joint, windows):
        # A run's memory goes on from its beginning.
        runs = np.cumsum(np.r_[True, windows.spans[1:, 0] != windows.spans[:-1, 1]])
        whole = np.flatnonzero(np.isin(runs, runs[some]))
    begin = shot.states.copy()
    begin[some] = states
    try:
        there = shoot(joint, windows.part(whole), begin[whole])
    except SimulationError:
        return shot, some
    there = there.part(np.searchsorted(whole, some))
    better = _squares(there, part) < _squares(shot.part(some), part)
    if not better.any():
        return shot, some
    return _merged(windows, shot, some[better], there.part(np.flatnonzero(better))), some[~better]


def _merged(windows: Windows, shot: Shot, some: Integers, other: Shot) -> Shot:
    """Put another simulation of some windows into one of all."""
    states, errors = shot.states.copy(), {role: e.copy() for role, e in shot.errors.items()}
    ends = shot.ends.copy()
    states[some], ends[some] = other.states, other.ends
    for first, last in windows.spans[some]:
        for role, kept in errors.items():
            kept[first:last] = other.errors[role][first:last]
    return Shot(states, errors, ends)


def _squares(shot: Shot, windows: Windows) -> Array:
    """Return the mean square of the errors over their noise in each window, shape (W,)."""
    return np.asarray(np.mean(in_windows(shot, windows) ** 2, axis=1))


def in_windows(shot: Shot, windows: Windows) -> Array:
    """Return the errors over their noise, window by window, shape (W, L · roles)."""
    return shot.whitened(windows).reshape(len(windows.spans), -1)


def by_states(joint: Any, windows: Windows, shot: Shot) -> Array:
    """Return the change of each window's errors with its state, shape (W, L · roles, n)."""
    base = in_windows(shot, windows)
    out = np.zeros((*base.shape, shot.states.shape[1]))
    free = player_of(joint, windows.channels).free(shot.states)

    def moved(i: int) -> None:
        nudge, where = free[i]
        states = shot.states.copy()
        states[where, i] += nudge
        change = (in_windows(shoot(joint, windows, states), windows) - base) / nudge
        out[where, :, i] = change[where]

    # Compiled simulations leave the interpreter to one another.
    with ThreadPoolExecutor(max(1, min(len(free), os.cpu_count() or 1))) as pool:
        list(pool.map(moved, free))
    return out


def _least(J: Array, r: Array, damping: float = 0.0) -> Array:
    """Return the step, in states of equal effect, that makes r − J step + damping · step least, in squares (Levenberg)."""
    scale = np.linalg.norm(J, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    A = J / scale
    if damping:
        return np.asarray(np.linalg.solve(A.T @ A + damping * np.eye(scale.size), A.T @ r) / scale)
    return np.asarray(np.linalg.lstsq(A, r, rcond=1e-8)[0] / scale)


def floor_of(windows: Windows, role: str) -> float:
    """Return the weight of a role's error."""
    if windows.scale is not None:
        return windows.scale[role]
    noise = windows.channels.noise[role].floor
    return noise or 1e-6 * float(np.std(windows.channels.raw[role])) or 1.0
