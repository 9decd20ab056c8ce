"""Compiled integration with a fixed step: Runge–Kutta of fourth order, or Rodas (fourth order too) where the equations are stiff.

Inside a step nothing switches. When a guard of `_dynamics` is found negative at a step's end, the point where it became so is
bisected, the step ends there, the modes change, and the rest of the step follows: ideal friction, gaps and loops cost no
order.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.core.source_stamp import source_stamp
from vsalog.mechanics import _atoms, _rigid_body
from vsalog.mechanics._atoms import Element, rounded
from vsalog.simulation import _dynamics
from vsalog.simulation._dynamics import At, Mode, deflection, derivative, least_guard, release, stop, turn

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

EVENT_WIDTH = 2.0**-44
"""Part of a step to which an event is found: the guards' own rounding is some bits above that of doubles."""
MOST_EVENTS = 50
"""Events in one step beyond which they are chattering, and the step is taken as it is."""

# Rodas, 6 stages, order 4, L-stable (Hairer and Wanner, Solving Ordinary Differential Equations II, §VI.4).
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


class Room(IntEnum):
    """Rows of the integrators' room, each as long as the state, behind those of the six stages."""

    STATE, TRIAL, SLOPE, OTHER, TORQUES, FIRST_JACOBIAN = range(6, 12)


@njit(error_model="numpy", forceinline=True)
def _torques(inputs: Array, k: int, fraction: float, room: Array) -> None:
    """Interpolate the inputs within step `k` by the parabola through its ends and its middle."""
    begin = 2.0 * (fraction - 0.5) * (fraction - 1.0)
    middle = 4.0 * fraction * (1.0 - fraction)
    end = 2.0 * fraction * (fraction - 0.5)
    for i in range(inputs.shape[2]):
        room[Room.TORQUES, i] = begin * inputs[k, 0, i] + middle * inputs[k, 1, i] + end * inputs[k, 2, i]


@njit(error_model="numpy", forceinline=True)
def _runge_kutta(
    p: Array, at: Integers, inputs: Array, k: int, t: float, h: float, a: float, b: float, x: Array, modes: Integers,
    w: Array, room: Array,
) -> None:  # fmt: skip
    """One step from fraction `a` to fraction `b` of the step of length `h` that begins at time `t`, to the row TRIAL."""
    size, part, tau, state = x.shape[0], (b - a) * h, room[Room.TORQUES], room[Room.STATE]
    for stage in range(4):
        c = 0.0 if stage == 0 else 1.0 if stage == 3 else 0.5
        for i in range(size):
            state[i] = x[i] if stage == 0 else x[i] + c * part * room[stage - 1, i]
        if stage != 2:  # the two in the middle have the same time
            _torques(inputs, k, a + c * (b - a), room)
        derivative(p, at, t + (a + c * (b - a)) * h, state, tau, modes, w, room[stage])
    for i in range(size):
        room[Room.TRIAL, i] = x[i] + part / 6.0 * (room[0, i] + 2.0 * (room[1, i] + room[2, i]) + room[3, i])


@njit(error_model="numpy")
def _factor(room: Array, n: int) -> None:
    """LU decomposition in place of the n rows from FIRST_JACOBIAN on, with partial pivoting; the row after holds the pivots."""
    last = Room.FIRST_JACOBIAN + n
    for k in range(n):
        r, best = Room.FIRST_JACOBIAN + k, Room.FIRST_JACOBIAN + k
        for i in range(r + 1, last):
            if abs(room[i, k]) > abs(room[best, k]):
                best = i
        room[last, k] = best - Room.FIRST_JACOBIAN
        if best != r:
            for j in range(n):
                room[r, j], room[best, j] = room[best, j], room[r, j]
        for i in range(r + 1, last):
            room[i, k] /= room[r, k]
            for j in range(k + 1, n):
                room[i, j] -= room[i, k] * room[r, j]


@njit(error_model="numpy")
def _back(room: Array, n: int, row: int) -> None:
    """Solve for the right-hand side in a row of the room, in place, with what `_factor` left."""
    for k in range(n):
        other = int(room[Room.FIRST_JACOBIAN + n, k])
        room[row, k], room[row, other] = room[row, other], room[row, k]
    for i in range(n):
        for j in range(i):
            room[row, i] -= room[Room.FIRST_JACOBIAN + i, j] * room[row, j]
    for i in range(n - 1, -1, -1):
        for j in range(i + 1, n):
            room[row, i] -= room[Room.FIRST_JACOBIAN + i, j] * room[row, j]
        room[row, i] /= room[Room.FIRST_JACOBIAN + i, i]


@njit(error_model="numpy")
def _rodas(
    p: Array, at: Integers, inputs: Array, k: int, t: float, h: float, a: float, b: float, x: Array, modes: Integers,
    w: Array, room: Array,
) -> None:  # fmt: skip
    """The same step by Rodas; Jacobian and time derivative come from differences."""
    size, part, tau, state = x.shape[0], (b - a) * h, room[Room.TORQUES], room[Room.STATE]
    slope, other = room[Room.SLOPE], room[Room.OTHER]
    # At the point itself, then along each coordinate, then a little later and a little earlier: exact for parabolic inputs.
    for j in range(-1, size + 2):
        near = 0.01 if j == size else -0.01 if j == size + 1 else 0.0
        for i in range(size):
            state[i] = x[i]
        width = 0.0
        if 0 <= j < size:
            # As wide as the root of the rounding error of the coordinate, or of its change in a step.
            width = 1.5e-8 * max(abs(x[j]), abs(part * slope[j]), 1e-6)
            state[j] += width
            width = state[j] - x[j]
        _torques(inputs, k, a + near * (b - a), room)
        derivative(p, at, t + (a + near * (b - a)) * h, state, tau, modes, w, slope if j < 0 else other)
        for i in range(size):
            if 0 <= j < size:
                room[Room.FIRST_JACOBIAN + i, j] = -(other[i] - slope[i]) / width + (4.0 / part if i == j else 0.0)
            elif j == size:
                slope[i] = other[i]
            elif j > size:
                slope[i] = (slope[i] - other[i]) / (0.02 * part)
    _factor(room, size)
    for stage in range(6):
        fraction = a + STAGE_TIME[stage] * (b - a)
        for i in range(size):
            state[i] = x[i]
            for j in range(stage):
                state[i] += STAGE[stage, j] * room[j, i]
        _torques(inputs, k, fraction, room)
        derivative(p, at, t + fraction * h, state, tau, modes, w, room[stage])
        for i in range(size):
            room[stage, i] += part * TIME_WEIGHT[stage] * slope[i]
            for j in range(stage):
                room[stage, i] += COUPLED[stage, j] / part * room[j, i]
        _back(room, size, stage)
    for i in range(size):
        room[Room.TRIAL, i] = state[i] + room[5, i]


@njit(error_model="numpy")
def _step(
    stiff: bool, p: Array, at: Integers, inputs: Array, k: int, t: float, h: float, a: float, b: float, x: Array,
    modes: Integers, w: Array, room: Array,
) -> float:  # fmt: skip
    """Take a step to the row TRIAL and return the least of the guards there: it is negative where a mode has ended."""
    if stiff:
        _rodas(p, at, inputs, k, t, h, a, b, x, modes, w, room)
    else:
        _runge_kutta(p, at, inputs, k, t, h, a, b, x, modes, w, room)
    if not at[At.GUARDED]:
        return 1.0
    _torques(inputs, k, b, room)
    derivative(p, at, t + b * h, room[Room.TRIAL], room[Room.TORQUES], modes, w, room[Room.SLOPE])
    least: float = least_guard(p, at, room[Room.TRIAL], modes, w)
    return least


@njit(error_model="numpy", forceinline=True)
def _switch(p: Array, at: Integers, t: float, x: Array, modes: Integers, w: Array, room: Array) -> None:
    """Change the modes that have ended, and with them the state: a part that stops is at rest, one that slips is at its limit."""
    turn(p, at, x, modes, w)
    if stop(at, x, modes, w):
        derivative(p, at, t, x, room[Room.TORQUES], modes, w, room[Room.SLOPE])
    release(at, modes, w)


@njit(error_model="numpy")
def _advance(
    stiff: bool, p: Array, at: Integers, inputs: Array, k: int, t: float, h: float, x: Array, modes: Integers,
    w: Array, room: Array,
) -> None:  # fmt: skip
    """Go on by one whole step, through all its events.

    Events are located by the Illinois variant of false position (Dowell and Jarratt 1971, BIT 11) with bisections.
    """
    done, before, after, events = 0.0, 0.0, 1.0, 0
    seeking = False  # between `before`, where all modes hold, and `after`, where one has ended
    held, ended, tries, moved = np.nan, 0.0, 0, 0  # the least guard at `before` and at `after`
    while True:
        to = after
        if seeking and after - before > EVENT_WIDTH:
            to = 0.5 * (before + after)
            # Every fourth trial is a bisection: it bounds the search where the guard is far from linear.
            if tries % 4 != 3 and held > 0.0:
                to = before + (after - before) * held / (held - ended)
                to = min(max(to, before + 0.5 * EVENT_WIDTH), after - 0.5 * EVENT_WIDTH)
            tries += 1
        guard = _step(stiff, p, at, inputs, k, t, h, done, to, x, modes, w, room)
        if seeking and to < after:
            if guard < 0.0:
                held *= 0.5 if moved > 0 else 1.0
                after, ended, moved = to, guard, 1
            else:
                ended *= 0.5 if moved < 0 else 1.0
                before, held, moved = to, guard, -1
            continue
        if guard < 0.0 and not seeking and events < MOST_EVENTS:
            seeking, before, held, ended, tries, moved = True, done, np.nan, guard, 0, 0
            continue
        for i in range(x.shape[0]):
            x[i] = room[Room.TRIAL, i]
        if seeking:
            _switch(p, at, t + after * h, x, modes, w, room)
            events += 1
        if after >= 1.0:
            return
        done, before, after, seeking = after, after, 1.0, False


class ServoRow(IntEnum):
    """Layout of a servo's row; `EVERY` is after how many steps it looks again, `DELAY` how many its torque is late."""

    DOF, KP, KD, KI, LIMIT, RESOLUTION, STEP, GAIN, OFFSET, DELAY, EVERY = range(11)


@njit(error_model="numpy", forceinline=True)
def _command(
    inputs: Array, period: int, s: int, steps: int, h: float, servos: Array, reference: Array, commands: Array, sums: Array,
    past: int, x: Array, n: int,
) -> None:  # fmt: skip
    """Let the servos look at the state and command torques, and add what acts in step `s` of a period to the inputs."""
    for k in range(servos.shape[0]):
        i, every = int(servos[k, ServoRow.DOF]), int(servos[k, ServoRow.EVERY])
        if s % every == 0:
            tick = s // every
            error = reference[period, tick, 0, k] - rounded(x[i], servos[k, ServoRow.RESOLUTION])
            wanted = servos[k, ServoRow.KP] * error + servos[k, ServoRow.KI] * sums[k]
            wanted += servos[k, ServoRow.KD] * (reference[period, tick, 1, k] - x[n + i])
            torque = min(max(wanted, -servos[k, ServoRow.LIMIT]), servos[k, ServoRow.LIMIT])
            if torque == wanted:
                sums[k] += error * every * h
            commands[past + period, tick, k] = rounded(torque, servos[k, ServoRow.STEP])
        late = max((past + period) * steps + s - int(servos[k, ServoRow.DELAY]), 0)
        acting = commands[late // steps, late % steps // every, k]
        for c in range(3):
            inputs[period * steps + s, c, i] += servos[k, ServoRow.GAIN] * acting + servos[k, ServoRow.OFFSET]


@njit(error_model="numpy")
def _first_modes(p: Array, at: Integers, x: Array, modes: Integers) -> None:
    """Set the modes in which a state begins; parts that could stick do."""
    n, count = at[At.DOFS], at[At.TRANSMISSIONS]
    for i in range(n):
        v = x[n + i]
        if at[at[At.BRISTLES] + i] >= 0:
            modes[i] = 1 if v >= 0.0 else -1
        elif at[at[At.DRY] + i]:
            modes[i] = 0 if v == 0.0 else 1 if v > 0.0 else -1
        else:
            modes[i] = Mode.FREE
    for i in range(count):
        phi = x[at[at[At.ENDS] + 3 * i]] - x[at[at[At.ENDS] + 3 * i + 1]]
        gap = p[at[At.ROWS] + at[At.WIDTH] * i + Element.HALF_GAP]
        modes[n + i] = 0 if abs(phi) <= gap and gap > 0.0 else 1 if phi >= 0.0 else -1
        modes[n + count + i] = 1 if deflection(p, at, i, x, modes)[1] >= 0.0 else -1
    modes[n + 2 * count :] = 0


def _compiled(stamp: str) -> Callable[..., Any]:
    @njit(cache=True, error_model="numpy", nogil=True)
    def integrate(
        p: Array, at: Integers, stiff: bool, fresh: bool, step: float, start_time: float, inputs: Array, prescribed: Array,
        servos: Array, reference: Array, commands: Array, sums: Array, past: int, x: Array, modes: Integers, w: Array,
        room: Array, states: Array, accelerations: Array,
    ) -> None:  # fmt: skip
        stamp  # noqa: B018  numba's cache tells functions apart by what they close over
        n, periods = at[At.DOFS], states.shape[0]
        steps = inputs.shape[0] // periods
        if fresh:
            _first_modes(p, at, x, modes)
        for period in range(periods):
            for i in range(n):
                if at[at[At.FIXED] + i]:
                    x[i], x[n + i] = prescribed[period, 0, i], prescribed[period, 1, i]
            k = period * steps
            _command(inputs, period, 0, steps, step, servos, reference, commands, sums, past, x, n)
            for i in range(x.shape[0]):
                states[period, i] = x[i]
            plain = not stiff and not at[At.GUARDED]
            if not plain:
                _torques(inputs, k, 0.0, room)
                derivative(p, at, start_time + k * step, x, room[Room.TORQUES], modes, w, room[0])
                for i in range(n):
                    accelerations[period, i] = room[0, n + i]
            for s in range(steps):
                if s > 0:
                    _command(inputs, period, s, steps, step, servos, reference, commands, sums, past, x, n)
                _advance(stiff, p, at, inputs, k + s, start_time + (k + s) * step, step, x, modes, w, room)
                if plain and s == 0:  # the first stage of the period's first step was taken right there
                    for i in range(n):
                        accelerations[period, i] = room[0, n + i]

    function: Callable[..., Any] = integrate
    return function


# Integrate a stretch of P sample periods of S steps, for n degrees of freedom and a state of length m.
#
#   p, at : the machine            stiff, fresh : by Rodas; the modes have yet to follow from the state
#   step, start_time : length of a step and time of the first [s]
#   inputs : (P·S, 3, n), torque or prescribed acceleration at the beginning, middle and end of each step
#   prescribed : (P, 2, n), position and velocity of what is prescribed, at the start of each period
#   servos : (K, 11), see `ServoRow`
#   reference : (P, E, 2, K), position and velocity each time that a servo looks, E times a period at most
#   commands : (periods in all, E, K), commanded torques, filled in from the row `past` on
#   sums : (K,), integral of each servo's error, at the start and changed to that at the end
#   x, modes : at the start, and changed to those at the end
#   w, room : work arrays          states, accelerations : (P, m) and (P, n), filled with what they are at each period's start
integrate = _compiled(_atoms.STAMP + _atoms.STAMP_OF_TORQUES + source_stamp(_rigid_body, _dynamics))
