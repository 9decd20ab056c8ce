"""Compiled integration with a fixed step: Runge–Kutta of fourth order, or Rodas (fourth order too) where the equations are stiff.

Inside a step nothing switches. When a guard of `_dynamics` is found negative at a step's end, the point where it became so is
bisected, the step ends there, the modes change, and what is left of the step follows: ideal friction, gaps and loops cost no
order.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.mechanics import _atoms, _rigid_body
from vsalog.mechanics._atoms import HALF_GAP
from vsalog.simulation import _dynamics
from vsalog.simulation._dynamics import (
    NO_FRICTION,
    Plant,
    Scratch,
    _deflection,
    derivative,
    switch,
    violated,
)

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# An event is found to this part of a step; more events than this in one step are chattering, and the step is taken as it is.
EVENT_WIDTH, MOST_EVENTS = 2.0**-44, 50

# Rodas, 6 stages, order 4, L-stable (Hairer and Wanner, Solving Ordinary Differential Equations II, §VI.4).
GAMMA = 0.25
STAGE_TIME = np.array([0.0, 0.386, 0.21, 0.63, 1.0, 1.0])
TIME_WEIGHT = np.array([0.25, -0.1043, 0.1035, -0.0362, 0.0, 0.0])
STAGE = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [1.544, 0.0, 0.0, 0.0, 0.0],
        [0.9466785280815826, 0.2557011698983284, 0.0, 0.0, 0.0],
        [3.314825187068521, 2.896124015972201, 0.9986419139977817, 0.0, 0.0],
        [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 0.0],
        [1.221224509226641, 6.019134481288629, 12.53708332932087, -0.6878860361058950, 1.0],
    ]
)
COUPLED = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [-5.6688, 0.0, 0.0, 0.0, 0.0],
        [-2.430093356833875, -0.2063599157091915, 0.0, 0.0, 0.0],
        [-0.1073529058151375, -9.594562251023355, -20.47028614809616, 0.0, 0.0],
        [7.496443313967647, -10.24680431464352, -33.99990352819905, 11.70890893206160, 0.0],
        [8.083246795921522, -7.981132988064893, -31.52159432874371, 16.31930543123136, -6.058818238834054],
    ]
)


class Drive(NamedTuple):
    """What moves the machine during a stretch of P sample periods of S steps each, for n degrees of freedom."""

    inputs: Array  # (P, S, 3, n), torque or prescribed acceleration at the beginning, middle and end of each step
    prescribed: Array  # (P, 2, n), position and velocity of what is prescribed, at the start of each period
    servos: Array  # (K, 8): degree of freedom, Kp, Kd, limit, least step, gain, offset, delay in steps
    reference: Array  # (P, 2, K), position and velocity
    commands: Array  # (past + P, K), commanded torques; those of the past first, the rest is filled in
    past: int  # periods before this stretch


class Room(NamedTuple):
    """Scratch of the integrators, for a state of length m."""

    stages: Array  # (6, m)
    state: Array  # (m,)
    trial: Array  # (m,)
    slope: Array  # (m,)
    other: Array  # (m,)
    tau: Array  # (n,)
    jacobian: Array  # (m, m)
    pivots: Integers  # (m,)


@njit(error_model="numpy")
def _torques(drive: Drive, p: int, s: int, fraction: float, tau: Array) -> None:
    """Interpolate the inputs within a step by the parabola through its ends and its middle."""
    begin = 2.0 * (fraction - 0.5) * (fraction - 1.0)
    middle = 4.0 * fraction * (1.0 - fraction)
    end = 2.0 * fraction * (fraction - 0.5)
    rows = drive.inputs[p, s]
    for i in range(tau.shape[0]):
        tau[i] = begin * rows[0, i] + middle * rows[1, i] + end * rows[2, i]


@njit(error_model="numpy")
def _runge_kutta(
    plant: Plant, drive: Drive, p: int, s: int, t: float, h: float, a: float, b: float, x: Array, modes: Integers,
    scratch: Scratch, room: Room, out: Array,
) -> None:  # fmt: skip
    """One step from fraction `a` to fraction `b` of the step of length `h` that begins at time `t`."""
    k, state, size, part = room.stages, room.state, x.shape[0], (b - a) * h
    for stage in range(4):
        c = 0.0 if stage == 0 else 1.0 if stage == 3 else 0.5
        for i in range(size):
            state[i] = x[i] if stage == 0 else x[i] + c * part * k[stage - 1, i]
        if stage != 2:  # the two in the middle have the same time
            _torques(drive, p, s, a + c * (b - a), room.tau)
        derivative(plant, t + (a + c * (b - a)) * h, state, room.tau, modes, scratch, k[stage])
    for i in range(size):
        out[i] = x[i] + part / 6.0 * (k[0, i] + 2.0 * (k[1, i] + k[2, i]) + k[3, i])


@njit(error_model="numpy")
def _factor(A: Array, pivots: Integers) -> None:
    """LU decomposition in place, with partial pivoting."""
    n = A.shape[0]
    for k in range(n):
        p = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[p, k]):
                p = i
        pivots[k] = p
        if p != k:
            for j in range(n):
                A[k, j], A[p, j] = A[p, j], A[k, j]
        for i in range(k + 1, n):
            A[i, k] /= A[k, k]
            for j in range(k + 1, n):
                A[i, j] -= A[i, k] * A[k, j]


@njit(error_model="numpy")
def _back(A: Array, pivots: Integers, b: Array) -> None:
    """Solve A x = b in place with what `_factor` made of A."""
    n = A.shape[0]
    for k in range(n):
        p = pivots[k]
        b[k], b[p] = b[p], b[k]
    for i in range(n):
        for j in range(i):
            b[i] -= A[i, j] * b[j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            b[i] -= A[i, j] * b[j]
        b[i] /= A[i, i]


@njit(error_model="numpy")
def _rodas(
    plant: Plant, drive: Drive, p: int, s: int, t: float, h: float, a: float, b: float, x: Array, modes: Integers,
    scratch: Scratch, room: Room, out: Array,
) -> None:  # fmt: skip
    """The same step by Rodas; the Jacobian comes from differences."""
    u, state, A, tau, size, part = room.stages, room.state, room.jacobian, room.tau, x.shape[0], (b - a) * h
    _torques(drive, p, s, a, tau)
    derivative(plant, t + a * h, x, tau, modes, scratch, room.slope)
    for j in range(size):
        state[:] = x
        # Differences as wide as the root of the rounding error, of the coordinate or of what it does in a step.
        width = 1.5e-8 * max(abs(x[j]), abs(part * room.slope[j]), 1e-6)
        state[j] += width
        derivative(plant, t + a * h, state, tau, modes, scratch, room.other)
        for i in range(size):
            A[i, j] = -(room.other[i] - room.slope[i]) / (state[j] - x[j])
        A[j, j] += 1.0 / (part * GAMMA)
    _factor(A, room.pivots)
    # ∂f/∂t is exact for inputs that are parabolas.
    near = 0.01 * (b - a)
    _torques(drive, p, s, a + near, tau)
    derivative(plant, t + (a + near) * h, x, tau, modes, scratch, room.slope)
    _torques(drive, p, s, a - near, tau)
    derivative(plant, t + (a - near) * h, x, tau, modes, scratch, room.other)
    for i in range(size):
        room.slope[i] = (room.slope[i] - room.other[i]) / (2.0 * near * h)
    for stage in range(6):
        fraction = a + STAGE_TIME[stage] * (b - a)
        for i in range(size):
            value = x[i]
            for j in range(stage):
                value += STAGE[stage, j] * u[j, i]
            state[i] = value
        _torques(drive, p, s, fraction, tau)
        derivative(plant, t + fraction * h, state, tau, modes, scratch, u[stage])
        for i in range(size):
            value = u[stage, i] + part * TIME_WEIGHT[stage] * room.slope[i]
            for j in range(stage):
                value += COUPLED[stage, j] / part * u[j, i]
            u[stage, i] = value
        _back(A, room.pivots, u[stage])
    for i in range(size):
        out[i] = state[i] + u[5, i]


@njit(error_model="numpy")
def _step(
    stiff: bool, plant: Plant, drive: Drive, p: int, s: int, t: float, h: float, a: float, b: float, x: Array,
    modes: Integers, scratch: Scratch, room: Room, out: Array,
) -> bool:  # fmt: skip
    """Take a step and tell whether a mode has ended in it."""
    if stiff:
        _rodas(plant, drive, p, s, t, h, a, b, x, modes, scratch, room, out)
    else:
        _runge_kutta(plant, drive, p, s, t, h, a, b, x, modes, scratch, room, out)
    if not plant.guarded:
        return False
    _torques(drive, p, s, b, room.tau)
    derivative(plant, t + b * h, out, room.tau, modes, scratch, room.slope)
    return violated(plant, out, modes, scratch)


@njit(error_model="numpy")
def _advance(
    stiff: bool, plant: Plant, drive: Drive, p: int, s: int, t: float, h: float, x: Array, modes: Integers,
    scratch: Scratch, room: Room,
) -> None:  # fmt: skip
    """Go on by one whole step, through all its events."""
    done, trial = 0.0, room.trial
    for _ in range(MOST_EVENTS):
        if not _step(stiff, plant, drive, p, s, t, h, done, 1.0, x, modes, scratch, room, trial):
            x[:] = trial
            return
        before, after = done, 1.0
        while after - before > EVENT_WIDTH:
            middle = 0.5 * (before + after)
            if _step(stiff, plant, drive, p, s, t, h, done, middle, x, modes, scratch, room, trial):
                after = middle
            else:
                before = middle
        _step(stiff, plant, drive, p, s, t, h, done, after, x, modes, scratch, room, trial)
        x[:] = trial
        switch(plant, t + after * h, x, room.tau, modes, scratch, room.slope)
        done = after
        if done >= 1.0:
            return
    _step(stiff, plant, drive, p, s, t, h, done, 1.0, x, modes, scratch, room, trial)
    x[:] = trial


@njit(error_model="numpy")
def _command(drive: Drive, p: int, x: Array, n: int) -> None:
    """Let the servos look at the state and command torques, and put what acts during this period into the inputs."""
    steps = drive.inputs.shape[1]
    for k in range(drive.servos.shape[0]):
        servo = drive.servos[k]
        i = int(servo[0])
        torque = servo[1] * (drive.reference[p, 0, k] - x[i]) + servo[2] * (drive.reference[p, 1, k] - x[n + i])
        torque = min(max(torque, -servo[3]), servo[3])
        if servo[4] > 0.0:
            torque = np.round(torque / servo[4]) * servo[4]
        now = drive.past + p
        drive.commands[now, k] = torque
        for s in range(steps):
            late = max(now * steps + s - int(servo[7]), 0) // steps
            for c in range(3):
                drive.inputs[p, s, c, i] = servo[5] * drive.commands[late, k] + servo[6]


@njit(error_model="numpy")
def first_modes(plant: Plant, x: Array, modes: Integers) -> None:
    """Set the modes that a state begins in; what could stick does."""
    n, count = plant.inertia.shape[0], plant.transmissions.shape[0]
    for i in range(n):
        v = x[n + i]
        if plant.bristles[i] >= 0:
            modes[i] = 1 if v >= 0.0 else -1
        elif plant.dry[i]:
            modes[i] = 0 if v == 0.0 else 1 if v > 0.0 else -1
        else:
            modes[i] = NO_FRICTION
    for i in range(count):
        phi, gap = x[plant.ends[i, 0]] - x[plant.ends[i, 1]], plant.transmissions[i, HALF_GAP]
        side = 1 if phi >= 0.0 else -1
        modes[n + i] = 0 if abs(phi) <= gap and gap > 0.0 else side
        modes[n + count + i] = 1 if _deflection(plant, i, x, modes)[1] >= 0.0 else -1
    modes[n + 2 * count :] = 0


def source_stamp(*modules: ModuleType) -> str:
    """Return what changes when one of the files changes: numba's cache looks at a function's own file only."""
    return " ".join(str(Path(str(module.__file__)).stat().st_mtime_ns) for module in modules)


def _compiled(stamp: str) -> Callable[..., Any]:
    @njit(cache=True, error_model="numpy")
    def integrate(
        plant: Plant, drive: Drive, stiff: bool, step: float, start_time: float, x: Array, modes: Integers,
        scratch: Scratch, room: Room, states: Array, accelerations: Array,
    ) -> None:  # fmt: skip
        stamp  # noqa: B018  numba's cache tells functions apart by what they close over
        periods, n = drive.inputs.shape[0], plant.inertia.shape[0]
        steps = drive.inputs.shape[1]
        for p in range(periods):
            for i in range(n):
                if plant.fixed[i]:
                    x[i], x[n + i] = drive.prescribed[p, 0, i], drive.prescribed[p, 1, i]
            _command(drive, p, x, n)
            _torques(drive, p, 0, 0.0, room.tau)
            derivative(plant, start_time + p * steps * step, x, room.tau, modes, scratch, room.slope)
            states[p] = x
            accelerations[p] = room.slope[n : 2 * n]
            for s in range(steps):
                t = start_time + (p * steps + s) * step
                _advance(stiff, plant, drive, p, s, t, step, x, modes, scratch, room)

    function: Callable[..., Any] = integrate
    return function


# Integrate a stretch: from the state `x` and its `modes`, which are changed, to the state P periods later. Fills `states`,
# shape (P, m), and `accelerations`, shape (P, n), with what they are at the start of each period, under the inputs in force
# from then on.
integrate = _compiled(source_stamp(_atoms, _rigid_body, _dynamics))
