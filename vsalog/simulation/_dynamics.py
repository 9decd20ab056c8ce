"""Compiled equations of motion of links and motors with transmissions between them, dry friction, loops and gaps.

Degrees of freedom: the links first, then the motors. State: positions, velocities, bristles, loops, slip elements.

What is not smooth is described by modes, which a step keeps: inside a step the equations are smooth, even a little past the point
where a mode ends. Where it ends a guard becomes negative; `_integrate` finds that point. Modes, in this order:

    friction, per degree of freedom    +1, −1 slides that way, 0 sticks (ideal friction); +1, −1 sign of the velocity (bristles)
    side, per transmission             +1, −1 which half of the spring is deflected, 0 inside the gap
    way, per transmission              +1, −1 sign of the deflection's rate (only for loops)
    slip, per element                  +1, −1 slips that way, 0 sticks
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.mechanics._atoms import (
    Element,
    Friction,
    body_torque,
    bristle_rate,
    friction_level,
    holding_torque,
    loop_rate,
    nominal_spring,
    spring,
    stiffened,
)
from vsalog.mechanics._rigid_body import Row, inverse_dynamics

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


class Mode(IntEnum):
    """Modes of the friction of a degree of freedom."""

    BACKWARD, STICK, FORWARD, FREE = range(-1, 3)


class At(IntEnum):
    """Layout of a machine's integers.

    A machine is two arrays: numbers, and integers `at` with the place among the numbers where each table begins. Structures of
    arrays would be easier to read, but every access counts a reference, which costs more than the arithmetic.
    """

    # Counts and flags.
    DOFS, LINKS, TRANSMISSIONS, SLIPS, TORQUES, CHAIN, WIDTH, GUARDED, FIRST_SLIP = range(9)
    # Where the tables of numbers begin: (n,) inertia, 0 in a chain; (n, 7) friction; (LINKS, 2) m g l and angle; numbers of
    # the effects' torques; (·, WIDTH) transmissions; (·, 2) levers; (·, 3) transmission, stiffness, limit; (·, 18) links of
    # the chain; (3,) gravity; (n, n) S and its transpose.
    INERTIA, FRICTION, GRAVITY, TORQUE_NUMBERS, ROWS, LEVERS, ELEMENTS, BODIES, FIELD, COUPLING = range(9, 19)
    # Where the tables of integers begin in `at` itself: (·, 3) link, motor, secondary motor or −1; state of each bristle
    # and each loop or −1; whether ideal friction acts; whether the motion is prescribed; (·, 3) degree of freedom of an
    # effect's torque, which effect, first of its numbers. They follow from END on.
    ENDS, BRISTLES, LOOPS, DRY, FIXED, TORQUE, END = range(19, 26)


class Work(IntEnum):
    """Rows of the work array: applied force, transmitted torque, level of friction, torque that would hold at rest.

    The rigid bodies' rows, the mass matrix with its right-hand side and a copy of it follow.
    """

    FORCE, TRANSMITTED, LEVEL, HOLDING, FIRST_BODY = range(5)


@njit(error_model="numpy", forceinline=True)
def deflection(p: Array, at: Integers, i: int, x: Array, modes: Integers) -> tuple[float, float]:
    """Return deflection less the gap, and its rate, as the mode of transmission `i` has them."""
    n, ends = at[At.DOFS], at[At.ENDS] + 3 * i
    link, motor = at[ends], at[ends + 1]
    phi, rate = x[link] - x[motor], x[n + link] - x[n + motor]
    gap = p[at[At.ROWS] + at[At.WIDTH] * i + Element.HALF_GAP]
    if gap <= 0.0:
        return phi, rate
    side = modes[n + i]
    return (phi - side * gap, rate) if side != 0 else (0.0, 0.0)


@njit(error_model="numpy", forceinline=True)
def _transmit(p: Array, at: Integers, t: float, x: Array, modes: Integers, w: Array) -> None:
    """Add what the transmissions do to links and motors."""
    width = at[At.WIDTH]
    for i in range(at[At.TRANSMISSIONS]):
        row, ends = at[At.ROWS] + width * i, at[At.ENDS] + 3 * i
        link, motor, secondary = at[ends], at[ends + 1], at[ends + 2]
        u, rate = deflection(p, at, i, x, modes)
        arm, travel = p[at[At.LEVERS] + 2 * i], p[at[At.LEVERS] + 2 * i + 1]
        if secondary >= 0:
            arm -= travel * x[secondary]
        side = modes[at[At.DOFS] + i]
        torque = spring(p, row, width, u, side, arm, t)[1] + p[row + Element.DAMPING] * rate
        loop = at[at[At.LOOPS] + i]
        if loop >= 0:
            torque += p[row + Element.LOOP_TORQUE] * x[loop]
        for e in range(at[At.SLIPS]):
            if p[at[At.ELEMENTS] + 3 * e] == i:
                torque += x[at[At.FIRST_SLIP] + e]
        w[Work.FORCE, link] -= torque
        w[Work.FORCE, motor] += torque
        w[Work.TRANSMITTED, link] += abs(torque)
        w[Work.TRANSMITTED, motor] += torque
        if secondary >= 0:
            # ∂U/∂θ_c = −b ∂U/∂r, and U goes with r² (Flacco 2012 eq. 52).
            factor = stiffened(p[row + Element.DRIFT], t, side, p[row + Element.ASYMMETRY])
            w[Work.FORCE, secondary] += 2.0 * travel / arm * factor * nominal_spring(p, row, width, u, arm)[0]


@njit(error_model="numpy", forceinline=True)
def _rub(p: Array, at: Integers, x: Array, modes: Integers, w: Array) -> None:
    """Add viscous and dry friction; leaves in HOLDING the force that ideal friction would have to balance at rest."""
    n = at[At.DOFS]
    for i in range(n):
        v, row = x[n + i], at[At.FRICTION] + 7 * i
        w[Work.FORCE, i] -= p[row + Friction.VISCOUS] * v
        if not at[At.GUARDED] or modes[i] == Mode.FREE:
            continue
        level = friction_level(p, row, v, w[Work.TRANSMITTED, i])
        w[Work.LEVEL, i] = level
        bristle = at[at[At.BRISTLES] + i]
        if bristle >= 0:
            z, stiffness = x[bristle], p[row + Friction.BRISTLE]
            rate = bristle_rate(stiffness, z, v, modes[i] * v, level)
            w[Work.FORCE, i] -= stiffness * z + p[row + Friction.BRISTLE_DAMPING] * rate
        else:
            w[Work.HOLDING, i] = w[Work.FORCE, i]
            w[Work.FORCE, i] -= modes[i] * level


@njit(error_model="numpy")
def _solve(w: Array, first: int, n: int) -> None:
    """Solve A a = b by elimination with partial pivoting; A and b are n rows of `w`, the solution is left in b."""
    for k in range(n):
        r, p = first + k, first + k
        for i in range(r + 1, first + n):
            if abs(w[i, k]) > abs(w[p, k]):
                p = i
        if p != r:
            for j in range(k, n + 1):
                w[r, j], w[p, j] = w[p, j], w[r, j]
        for i in range(r + 1, first + n):
            f = w[i, k] / w[r, k]
            if f != 0.0:
                for j in range(k, n + 1):
                    w[i, j] -= f * w[r, j]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            w[first + k, n] -= w[first + k, j] * w[first + j, n]
        w[first + k, n] /= w[first + k, k]


@njit(error_model="numpy")
def _accelerate_together(p: Array, at: Integers, x: Array, tau: Array, modes: Integers, w: Array, out: Array) -> None:
    """Accelerations where links of a chain and their motors move one another (De Luca 2007 eq. 1–2)."""
    n, size, bodies, field = at[At.DOFS], at[At.CHAIN], at[At.BODIES], at[At.FIELD]
    first, M = Work.FIRST_BODY + Row.TAU + 2 + size, Work.FIRST_BODY + Row.TAU + 2 + size + n
    q, dq, ddq, torque = (
        Work.FIRST_BODY + Row.Q,
        Work.FIRST_BODY + Row.DQ,
        Work.FIRST_BODY + Row.DDQ,
        Work.FIRST_BODY + Row.TAU,
    )
    for i in range(n):
        for j in range(n):
            w[first + i, j] = p[at[At.COUPLING] + n * i + j]
        w[first + i, i] += p[at[At.INERTIA] + i]
    for k in range(size):  # the links are the first degrees of freedom
        w[q, k], w[dq, k], w[ddq, k] = x[k], x[n + k], 0.0
    inverse_dynamics(p, bodies, size, field, 1.0, w, Work.FIRST_BODY)
    for k in range(size):
        w[Work.FORCE, k] -= w[torque, k]
        w[Work.HOLDING, k] -= w[torque, k]
        w[dq, k] = 0.0
    for k in range(size):
        w[ddq, k] = 1.0
        inverse_dynamics(p, bodies, size, field, 0.0, w, Work.FIRST_BODY)
        w[ddq, k] = 0.0
        for i in range(size):
            w[first + i, k] += w[torque, i]
    for i in range(n):
        w[first + i, n] = w[Work.FORCE, i]
        for j in range(n):
            w[M + i, j] = w[first + i, j]
        if at[at[At.FIXED] + i] or modes[i] == 0:
            for j in range(n):
                w[first + i, j] = 0.0
            w[first + i, i] = 1.0
            w[first + i, n] = tau[i] if at[at[At.FIXED] + i] else 0.0
    _solve(w, first, n)
    for i in range(n):
        out[n + i] = w[first + i, n]
    for i in range(n):
        if modes[i] == 0:
            # The torque that holds a joint at rest must also balance the others' accelerations.
            for j in range(n):
                w[Work.HOLDING, i] -= w[M + i, j] * out[n + j]


@njit(error_model="numpy")
def derivative(p: Array, at: Integers, t: float, x: Array, tau: Array, modes: Integers, w: Array, out: Array) -> None:
    """Fill `out` with ẋ.

    Parameters
    ----------
    p, at : the machine
    t : from the start [s]
    x : state
    tau : shape (n,), torque on each link from outside and on each motor [N·m]; the acceleration of prescribed motions
    modes : see above
    w : work array; afterwards its rows LEVEL and HOLDING are what the guards need
    """
    n = at[At.DOFS]
    for i in range(n):
        w[Work.FORCE, i] = tau[i]
        w[Work.TRANSMITTED, i] = 0.0
        w[Work.HOLDING, i] = 0.0
    for j in range(at[At.LINKS]):
        weight = p[at[At.GRAVITY] + 2 * j]
        if weight != 0.0:
            carried = holding_torque(weight, p[at[At.GRAVITY] + 2 * j + 1], x[j])
            w[Work.FORCE, j] -= carried
            if (
                at[At.TRANSMISSIONS] == 0
            ):  # motor and link are one, and the gear transmits the torque that holds the link
                w[Work.TRANSMITTED, j] = abs(carried)
    for c in range(at[At.TORQUES]):
        row = at[At.TORQUE] + 3 * c
        i = at[row]
        w[Work.FORCE, i] += body_torque(at[row + 1], x[i], x[n + i], t, p, at[At.TORQUE_NUMBERS] + at[row + 2])
    _transmit(p, at, t, x, modes, w)
    _rub(p, at, x, modes, w)
    for i in range(n):
        out[i] = x[n + i]
    if at[At.CHAIN] > 0:
        _accelerate_together(p, at, x, tau, modes, w, out)
    else:
        for i in range(n):
            out[n + i] = w[Work.FORCE, i] / p[at[At.INERTIA] + i]
            if at[at[At.FIXED] + i]:
                out[n + i] = tau[i]
            elif modes[i] == 0:
                out[n + i] = 0.0
    if at[At.GUARDED]:
        _deform(p, at, x, modes, w, out)


@njit(error_model="numpy", forceinline=True)
def _deform(p: Array, at: Integers, x: Array, modes: Integers, w: Array, out: Array) -> None:
    """Rates of bristles, loops and slip elements."""
    n, count = at[At.DOFS], at[At.TRANSMISSIONS]
    for i in range(n):
        bristle = at[at[At.BRISTLES] + i]
        if bristle >= 0:
            v, stiffness = x[n + i], p[at[At.FRICTION] + 7 * i + Friction.BRISTLE]
            out[bristle] = bristle_rate(stiffness, x[bristle], v, modes[i] * v, w[Work.LEVEL, i])
    for i in range(count):
        loop = at[at[At.LOOPS] + i]
        if loop >= 0:
            rate = deflection(p, at, i, x, modes)[1]
            out[loop] = loop_rate(p, at[At.ROWS] + at[At.WIDTH] * i, x[loop], rate, modes[n + count + i] * rate)
    for e in range(at[At.SLIPS]):
        element = at[At.ELEMENTS] + 3 * e
        rate = deflection(p, at, int(p[element]), x, modes)[1]
        out[at[At.FIRST_SLIP] + e] = p[element + 1] * rate if modes[n + 2 * count + e] == 0 else 0.0


@njit(error_model="numpy")
def friction_guard(at: Integers, i: int, x: Array, modes: Integers, w: Array) -> float:
    """Return a value that is negative once the friction mode of degree of freedom `i` has ended; call `derivative` before."""
    if modes[i] == Mode.FREE or at[at[At.FIXED] + i]:
        return 1.0
    if modes[i] == 0:
        spare: float = w[Work.LEVEL, i] - abs(w[Work.HOLDING, i])
        return spare
    guard: float = modes[i] * x[at[At.DOFS] + i]
    return guard


@njit(error_model="numpy")
def side_guard(p: Array, at: Integers, i: int, x: Array, modes: Integers) -> float:
    """Return a value that is negative once the deflection of transmission `i` has changed sides, where that matters."""
    row, side = at[At.ROWS] + at[At.WIDTH] * i, modes[at[At.DOFS] + i]
    gap = p[row + Element.HALF_GAP]
    if gap <= 0.0 and p[row + Element.ASYMMETRY] == 0.0:
        return 1.0
    phi = x[at[at[At.ENDS] + 3 * i]] - x[at[at[At.ENDS] + 3 * i + 1]]
    guard: float = gap - abs(phi) if side == 0 else side * phi - gap
    return guard


@njit(error_model="numpy")
def way_guard(p: Array, at: Integers, i: int, x: Array, modes: Integers) -> float:
    """Return a value that is negative once the deflection of transmission `i` has turned round, where that matters."""
    if at[at[At.LOOPS] + i] < 0:
        return 1.0
    guard: float = modes[at[At.DOFS] + at[At.TRANSMISSIONS] + i] * deflection(p, at, i, x, modes)[1]
    return guard


@njit(error_model="numpy")
def slip_guard(p: Array, at: Integers, e: int, x: Array, modes: Integers) -> float:
    """Return a value that is negative once slip element `e` begins to slip, or stops."""
    mode, element = modes[at[At.DOFS] + 2 * at[At.TRANSMISSIONS] + e], at[At.ELEMENTS] + 3 * e
    if mode == 0:
        stuck: float = p[element + 2] - abs(x[at[At.FIRST_SLIP] + e])
        return stuck
    guard: float = mode * deflection(p, at, int(p[element]), x, modes)[1]
    return guard


@njit(error_model="numpy")
def least_guard(p: Array, at: Integers, x: Array, modes: Integers, w: Array) -> float:
    """Return a value that is negative once any mode has ended: the least of all guards; call `derivative` before."""
    least = 1.0
    for i in range(at[At.DOFS]):
        least = min(least, friction_guard(at, i, x, modes, w))
    for i in range(at[At.TRANSMISSIONS]):
        least = min(least, side_guard(p, at, i, x, modes), way_guard(p, at, i, x, modes))
    for e in range(at[At.SLIPS]):
        least = min(least, slip_guard(p, at, e, x, modes))
    return least


@njit(error_model="numpy")
def stop(at: Integers, x: Array, modes: Integers, w: Array) -> bool:
    """Bring to rest, tentatively, degrees of freedom that have stopped sliding; return whether any has. `release` must follow."""
    stopped = False
    for i in range(at[At.DOFS]):
        if at[at[At.DRY] + i] and abs(modes[i]) == 1 and friction_guard(at, i, x, modes, w) < 0.0:
            x[at[At.DOFS] + i], modes[i] = 0.0, 0
            stopped = True
    return stopped


@njit(error_model="numpy")
def release(at: Integers, modes: Integers, w: Array) -> None:
    """Release what friction cannot hold; call `derivative` before."""
    for i in range(at[At.DOFS]):
        if modes[i] == 0 and not at[at[At.FIXED] + i] and abs(w[Work.HOLDING, i]) > w[Work.LEVEL, i]:
            modes[i] = 1 if w[Work.HOLDING, i] > 0.0 else -1


@njit(error_model="numpy")
def turn(p: Array, at: Integers, x: Array, modes: Integers, w: Array) -> None:
    """Change the modes of bristles, gaps, loops and slip elements that have ended."""
    n, count = at[At.DOFS], at[At.TRANSMISSIONS]
    for i in range(n):
        if at[at[At.BRISTLES] + i] >= 0 and friction_guard(at, i, x, modes, w) < 0.0:
            modes[i] = -modes[i]
    for i in range(count):
        if way_guard(p, at, i, x, modes) < 0.0:
            modes[n + count + i] = -modes[n + count + i]
        if side_guard(p, at, i, x, modes) < 0.0:
            phi = x[at[at[At.ENDS] + 3 * i]] - x[at[at[At.ENDS] + 3 * i + 1]]
            gap = p[at[At.ROWS] + at[At.WIDTH] * i + Element.HALF_GAP]
            modes[n + i] = (1 if phi > 0.0 else -1) if abs(phi) > gap or gap <= 0.0 else 0
    for e in range(at[At.SLIPS]):
        if slip_guard(p, at, e, x, modes) < 0.0:
            k, z = n + 2 * count + e, at[At.FIRST_SLIP] + e
            if modes[k] == 0:
                modes[k] = 1 if x[z] > 0.0 else -1
                x[z] = modes[k] * p[at[At.ELEMENTS] + 3 * e + 2]
            else:
                modes[k] = 0
