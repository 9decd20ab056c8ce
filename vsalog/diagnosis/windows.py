"""The rig's simulation in windows, each begun anew: multiple shooting, the states at the windows' beginnings free.

A simulation that runs through a whole log drifts away for reasons of no interest, and one restarted from a measured state
carries the noise of a derivative. So every window's state at its beginning is fitted, as unknowns that belong to no cause, and
what is left over is what the rig cannot explain within a window, whatever it began with.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.binding import offered_roles
from vsalog.diagnosis.balance import motion_of
from vsalog.diagnosis.channels import Channels
from vsalog.diagnosis.sensing import motors_of, torque_role, true_roles
from vsalog.errors import SimulationError
from vsalog.rig.schema import Signal
from vsalog.simulation.inputs import Input, Motion, table
from vsalog.simulation.machine import build
from vsalog.simulation.play import play

Array = NDArray[np.float64]

# Length of a window [s], its fewest samples, and how many of a long log are simulated.
WINDOW, FEWEST, MOST = 0.5, 20, 60
# Perturbations of positions [rad] and velocities [rad/s] that tell how a window depends on its beginning.
NUDGES = (1e-5, 1e-3)
ROUNDS = 4
NAME = "joint"
SIMULATED = ("motor_position", "link_position", "deflection", "torque_sensor", "setpoint")


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
    build({NAME: joint})
    length = max(FEWEST, round(WINDOW / channels.period))
    roles = true_roles(joint, channels, 0.0)
    states = measured_states(joint, channels)
    good = np.isfinite(states).all(axis=1)
    driving = [torque_role(m) for m in motors_of(joint)]
    for role in driving:
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
    moving = [r for r in channels.roles if np.ptp(channels.raw[r]) > 0.0 and not _drives(joint, channels, r)]
    answered = tuple(r for r in moving if r.removesuffix("_1").removesuffix("_2") in SIMULATED)
    if not answered:
        raise SimulationError("nothing is recorded that a simulation could be held against")
    return Windows(channels, np.array(spans)[kept], answered, hold)


def _drives(joint: Any, channels: Channels, role: str) -> bool:
    """Tell whether a position prescribes a motor's motion, because its torque is not recorded."""
    torque = "secondary_torque" if role == "setpoint" else role.replace("motor_position", "motor_torque")
    return torque != role and torque not in channels.roles


def measured_states(joint: Any, channels: Channels) -> Array:
    """Return (q, q̇, θ₁, θ̇₁, …) as rig and filter have them, shape (N, n)."""
    roles = true_roles(joint, channels, 0.0)
    motion = motion_of(joint, roles, channels.time, channels.spread)
    if motion.link is None:
        raise SimulationError("the position of the link is not recorded, and nothing tells it")
    columns = [motion.link[0], motion.link[1]]
    for name in motors_of(joint):
        if name == "secondary_motor":
            arm, lever = roles.get("setpoint"), joint.lever
            if arm is None or lever is None:
                raise SimulationError("the set-point is not recorded")
            columns += [(lever.start - arm[0]) / lever.travel, -arm[1] / lever.travel]
            continue
        suffix = name.removeprefix("motor")
        if suffix not in motion.motors:
            raise SimulationError(f"the position of the {name} is not recorded, and nothing tells it")
        columns += [motion.motors[suffix][0], motion.motors[suffix][1]]
    return np.stack(columns, axis=-1)


def simulated(joint: Any, windows: Windows, states: Array, step: Array | None = None) -> dict[str, Array]:
    """Simulate the windows and return role → what the sensors would say, shape (N,); NaN outside.

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
    machine = build({NAME: joint})
    roles = true_roles(joint, channels, 0.0)
    out = {role: np.full(len(channels), np.nan) for role in windows.roles}
    # Windows that touch are one run with restarts.
    for first_w, last_w in _stretches(windows.spans):
        first, last = int(windows.spans[first_w, 0]), int(windows.spans[last_w - 1, 1])
        time = channels.time[first] + np.arange(last - first) * channels.period
        inputs = _inputs(joint, channels, roles, slice(first, last), windows.hold)
        restarts = {int(windows.spans[w, 0]) - first: {NAME: states[w]} for w in range(first_w, last_w)}
        truth = play(machine, {NAME: inputs}, time, start=restarts[0], restarts=restarts)[NAME]
        for role in windows.roles:
            out[role][first:last] = _said(joint, role, truth, time)
    return out


def _stretches(spans: NDArray[np.int64]) -> list[tuple[int, int]]:
    breaks = [0, *(w + 1 for w in range(len(spans) - 1) if spans[w, 1] != spans[w + 1, 0]), len(spans)]
    return list(pairwise(breaks))


def _inputs(joint: Any, channels: Channels, roles: Mapping[str, Array], part: slice, hold: bool) -> dict[str, Input]:
    """Return what drives the machine: recorded torques, and motions where no torque is recorded."""
    time, given = channels.time[part], dict[str, Input]()
    time = time[0] + np.arange(time.size) * channels.period
    for name in motors_of(joint):
        role = torque_role(name)
        if role in channels.raw:
            torque = channels.raw[role][part]
            given[role] = torque if hold else table(time, torque)
        elif name == "secondary_motor":
            given[role] = Motion((joint.lever.start - roles["setpoint"][0][part]) / joint.lever.travel)
        else:
            given[role] = Motion(roles[name.replace("motor", "motor_position")][0][part])
    if "external_torque" in roles:
        given["external_torque"] = table(time, roles["external_torque"][0][part])
    return given


def _said(joint: Any, role: str, truth: Mapping[str, Array], time: Array) -> Array:
    """Return what a sensor makes of the truth: gain · x(t − delay) + offset + drift · t + eccentricity."""
    signal = offered_roles(joint).get(role, Signal())
    suffix = role[-2:] if role.endswith(("_1", "_2")) else ""
    if role.startswith("torque_sensor"):
        name = "transmission_torque"
        x = truth.get(f"{name}{suffix}", truth.get(f"{name}_total"))
    elif role == "setpoint":
        x = truth["lever_arm"]
    else:
        x = truth[role]
    assert x is not None
    if role.startswith("deflection") and signal.series_stiffness is not None:
        x = x + truth[f"transmission_torque{suffix}"] / signal.series_stiffness
    if signal.delay:
        x = np.interp(time - signal.delay, time, x)
    said = signal.gain * x + signal.offset + signal.drift * time
    if signal.eccentricity is not None:
        said = said + signal.eccentricity.amplitude * np.sin(x + signal.eccentricity.phase)
    return said


def shoot(joint: Any, windows: Windows, states: Array) -> Shot:
    """Simulate the windows from given states."""
    said = simulated(joint, windows, states)
    return Shot(states, {role: windows.channels.raw[role] - said[role] for role in windows.roles})


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
        states = measured_states(joint, windows.channels)[windows.spans[:, 0]]
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
    out = np.empty((*base.shape, shot.states.shape[1]))
    out[:] = 0.0
    for i in free_states(joint, windows):
        nudge = NUDGES[i % 2]
        states = shot.states.copy()
        states[:, i] += nudge
        out[..., i] = (in_windows(shoot(joint, windows, states), windows) - base) / nudge
    return out


def free_states(joint: Any, windows: Windows) -> list[int]:
    """Return the states that nothing prescribes."""
    free = [0, 1]
    for k, name in enumerate(motors_of(joint)):
        if torque_role(name) in windows.channels.raw:
            free += [2 + 2 * k, 3 + 2 * k]
    return free


def _least(J: Array, r: Array) -> Array:
    scale = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    return np.asarray(np.linalg.lstsq(J / scale, r, rcond=1e-8)[0] / scale)


def _floor(windows: Windows, role: str) -> float:
    noise = windows.channels.noise[role].floor
    return noise or 1e-6 * float(np.std(windows.channels.raw[role])) or 1.0
