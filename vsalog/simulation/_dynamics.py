"""Compiled equations of motion of links and motors with transmissions between them, dry friction, loops and gaps.

Degrees of freedom: the links first, then the motors. State: positions, velocities, bristles, loops, slip elements.

What is not smooth is told by modes, which a step keeps: inside a step the equations are smooth, even a little past the point
where a mode ends. Where it ends a guard becomes negative; `_integrate` finds that point. Modes, in this order:

    friction, per degree of freedom    +1, −1 slides that way, 0 sticks (ideal friction); +1, −1 sign of the velocity (bristles)
    side, per transmission             +1, −1 which half of the spring is deflected, 0 inside the gap
    way, per transmission              +1, −1 sign of the deflection's rate (only for loops)
    slip, per element                  +1, −1 slips that way, 0 sticks
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.mechanics._atoms import (
    ASYMMETRY,
    BRISTLE,
    BRISTLE_DAMPING,
    DAMPING,
    DRIFT,
    HALF_GAP,
    LOOP_TORQUE,
    VISCOUS,
    bristle_rate,
    friction_level,
    loop_rate,
    nominal_spring,
    spring,
)
from vsalog.mechanics._rigid_body import inverse_dynamics, mass_matrix

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Flags = NDArray[np.bool_]

NO_FRICTION = 2
# Rows of the scratch array: applied force, transmitted torque, level of friction, torque that would hold at rest, column.
FORCE, TRANSMITTED, LEVEL, HOLDING, POSITION, VELOCITY, ACCELERATION, TORQUE = range(8)
ROWS = 8


class Plant(NamedTuple):
    """A machine as arrays; n degrees of freedom, J of them links, T transmissions, E slip elements, N links in a chain."""

    inertia: Array  # (n,), 0 for links of the chain
    friction: Array  # (n, 7)
    dry: Flags  # (n,), ideal stick and slip
    bristles: Integers  # (n,), index of the bristle's state, −1 for none
    fixed: Flags  # (n,), moves as prescribed
    gravity: Array  # (J, 2), m g l and the angle at which the link hangs
    cogging: Array  # (C, 4), degree of freedom, amplitude, order at the joint, phase
    transmissions: Array  # (T, W)
    ends: Integers  # (T, 3), degrees of freedom: link, motor, secondary motor or −1
    levers: Array  # (T, 2), start [m] and travel [m/rad]
    loops: Integers  # (T,), index of the loop's state, −1 for none
    slips: Array  # (E, 3), transmission, stiffness, limit
    first_slip: int  # index of the first slip element's state
    guarded: bool  # whether there are any guards
    bodies: Array  # (N, 18)
    chain: Integers  # (N,), degrees of freedom of the chain's links
    field: Array  # (3,), gravity of the chain
    coupling: Array  # (n, n), S and its transpose
    coupled: bool  # whether accelerations depend on one another


class Scratch(NamedTuple):
    """Room for the equations of motion, so that no step allocates."""

    rows: Array  # (8, n)
    matrix: Array  # (n, n + 1)
    chain: Array  # (N + 1, 27)
    M: Array  # (N, N)
    zero: Array  # (max(N, 3),)
    unit: Array  # (max(N, 3),)


@njit(error_model="numpy")
def _deflection(plant: Plant, i: int, x: Array, modes: Integers) -> tuple[float, float]:
    """Return deflection less the gap, and its rate, as the mode of transmission `i` has them."""
    n = plant.inertia.shape[0]
    link, motor = plant.ends[i, 0], plant.ends[i, 1]
    phi, rate = x[link] - x[motor], x[n + link] - x[n + motor]
    gap = plant.transmissions[i, HALF_GAP]
    if gap <= 0.0:
        return phi, rate
    side = modes[n + i]
    return (phi - side * gap, rate) if side != 0 else (0.0, 0.0)


@njit(error_model="numpy")
def _transmit(plant: Plant, t: float, x: Array, modes: Integers, rows: Array) -> None:
    """Add what the transmissions do to links and motors."""
    n = plant.inertia.shape[0]
    for i in range(plant.transmissions.shape[0]):
        row = plant.transmissions[i]
        link, motor, secondary = plant.ends[i, 0], plant.ends[i, 1], plant.ends[i, 2]
        u, rate = _deflection(plant, i, x, modes)
        arm = plant.levers[i, 0]
        if secondary >= 0:
            arm -= plant.levers[i, 1] * x[secondary]
        side = modes[n + i]
        torque = spring(row, u, side, arm, t)[1] + row[DAMPING] * rate
        if plant.loops[i] >= 0:
            torque += row[LOOP_TORQUE] * x[plant.loops[i]]
        for e in range(plant.slips.shape[0]):
            if plant.slips[e, 0] == i:
                torque += x[plant.first_slip + e]
        rows[FORCE, link] -= torque
        rows[FORCE, motor] += torque
        rows[TRANSMITTED, link] += abs(torque)
        rows[TRANSMITTED, motor] += torque
        if secondary >= 0:
            # ∂U/∂θ_c = −b ∂U/∂r, and U goes with r² (Flacco 2012 eq. 52).
            factor = (1.0 + row[DRIFT] * t) * (1.0 + side * row[ASYMMETRY])
            rows[FORCE, secondary] += 2.0 * plant.levers[i, 1] / arm * factor * nominal_spring(row, u, arm)[0]


@njit(error_model="numpy")
def _rub(plant: Plant, x: Array, modes: Integers, rows: Array) -> None:
    """Add viscous and dry friction; leaves in HOLDING the force that ideal friction would have to balance at rest."""
    n = plant.inertia.shape[0]
    for i in range(n):
        v, row = x[n + i], plant.friction[i]
        rows[FORCE, i] -= row[VISCOUS] * v
        if modes[i] == NO_FRICTION:
            continue
        level = friction_level(row, v, rows[TRANSMITTED, i])
        rows[LEVEL, i] = level
        if plant.bristles[i] >= 0:
            z = x[plant.bristles[i]]
            rows[FORCE, i] -= row[BRISTLE] * z + row[BRISTLE_DAMPING] * bristle_rate(row, z, v, modes[i] * v, level)
        else:
            rows[HOLDING, i] = rows[FORCE, i]
            rows[FORCE, i] -= modes[i] * level


@njit(error_model="numpy")
def _solve(A: Array) -> None:
    """Solve A[:, :n] a = A[:, n] in place by elimination with partial pivoting; the solution is left in A[:, n]."""
    n = A.shape[0]
    for k in range(n):
        p = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[p, k]):
                p = i
        if p != k:
            for j in range(k, n + 1):
                A[k, j], A[p, j] = A[p, j], A[k, j]
        for i in range(k + 1, n):
            f = A[i, k] / A[k, k]
            if f != 0.0:
                for j in range(k, n + 1):
                    A[i, j] -= f * A[k, j]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            A[k, n] -= A[k, j] * A[j, n]
        A[k, n] /= A[k, k]


@njit(error_model="numpy")
def _accelerate_together(plant: Plant, x: Array, tau: Array, modes: Integers, s: Scratch, out: Array) -> None:
    """Accelerations where links of a chain or coupled motors move one another (De Luca 2007 eq. 1–2)."""
    n, rows, A = plant.inertia.shape[0], s.rows, s.matrix
    for i in range(n):
        for j in range(n):
            A[i, j] = plant.coupling[i, j]
        A[i, i] += plant.inertia[i]
    size = plant.chain.shape[0]
    if size > 0:
        for k in range(size):
            rows[POSITION, k], rows[VELOCITY, k] = x[plant.chain[k]], x[n + plant.chain[k]]
            rows[ACCELERATION, k] = 0.0
        q, dq, ddq, torque = rows[POSITION], rows[VELOCITY], rows[ACCELERATION], rows[TORQUE]
        inverse_dynamics(plant.bodies, plant.field, q, dq, ddq, s.chain, torque)
        for k in range(size):
            rows[FORCE, plant.chain[k]] -= torque[k]
            rows[HOLDING, plant.chain[k]] -= torque[k]
        mass_matrix(plant.bodies, q, s.zero, s.unit, s.chain, torque, s.M)
        for k in range(size):
            for j in range(size):
                A[plant.chain[k], plant.chain[j]] += s.M[k, j]
    for i in range(n):
        A[i, n] = rows[FORCE, i]
        if plant.fixed[i] or modes[i] == 0:
            for j in range(n):
                A[i, j] = 0.0
            A[i, i], A[i, n] = 1.0, tau[i] if plant.fixed[i] else 0.0
    _solve(A)
    for i in range(n):
        out[n + i] = A[i, n]
    # What holds a joint at rest must also balance what the others' accelerations do to it.
    for i in range(n):
        if modes[i] == 0:
            for j in range(n):
                rows[HOLDING, i] -= plant.coupling[i, j] * out[n + j]
    for k in range(size):
        if modes[plant.chain[k]] == 0:
            for j in range(size):
                rows[HOLDING, plant.chain[k]] -= s.M[k, j] * out[n + plant.chain[j]]


@njit(error_model="numpy")
def derivative(plant: Plant, t: float, x: Array, tau: Array, modes: Integers, s: Scratch, out: Array) -> None:
    """Fill `out` with ẋ.

    Parameters
    ----------
    t : from the start [s]
    x : state
    tau : shape (n,), torque on each link from outside and on each motor [N·m]; the acceleration of what is prescribed
    modes : see above
    s : scratch; afterwards LEVEL and HOLDING are what the guards need
    """
    n, links, rows = plant.inertia.shape[0], plant.gravity.shape[0], s.rows
    for i in range(n):
        rows[FORCE, i] = tau[i]
        rows[TRANSMITTED, i] = 0.0
        rows[HOLDING, i] = 0.0
    for j in range(links):
        rows[FORCE, j] -= plant.gravity[j, 0] * np.sin(x[j] - plant.gravity[j, 1])
    for c in range(plant.cogging.shape[0]):
        i = int(plant.cogging[c, 0])
        rows[FORCE, i] += plant.cogging[c, 1] * np.sin(plant.cogging[c, 2] * x[i] + plant.cogging[c, 3])
    _transmit(plant, t, x, modes, rows)
    _rub(plant, x, modes, rows)
    for i in range(n):
        out[i] = x[n + i]
    if plant.coupled:
        _accelerate_together(plant, x, tau, modes, s, out)
    else:
        for i in range(n):
            out[n + i] = rows[FORCE, i] / plant.inertia[i]
            if plant.fixed[i]:
                out[n + i] = tau[i]
            elif modes[i] == 0:
                out[n + i] = 0.0
    for i in range(n):
        b = plant.bristles[i]
        if b >= 0:
            v = x[n + i]
            out[b] = bristle_rate(plant.friction[i], x[b], v, modes[i] * v, rows[LEVEL, i])
    types = n + plant.transmissions.shape[0]
    for i in range(plant.transmissions.shape[0]):
        if plant.loops[i] >= 0:
            rate = _deflection(plant, i, x, modes)[1]
            out[plant.loops[i]] = loop_rate(plant.transmissions[i], x[plant.loops[i]], rate, modes[types + i] * rate)
    elements = types + plant.transmissions.shape[0]
    for e in range(plant.slips.shape[0]):
        rate = _deflection(plant, int(plant.slips[e, 0]), x, modes)[1]
        out[plant.first_slip + e] = plant.slips[e, 1] * rate if modes[elements + e] == 0 else 0.0


@njit(error_model="numpy")
def friction_guard(plant: Plant, i: int, x: Array, modes: Integers, s: Scratch) -> float:
    """Return what is negative once the friction mode of degree of freedom `i` has ended; call `derivative` before."""
    if modes[i] == NO_FRICTION or plant.fixed[i]:
        return 1.0
    if modes[i] == 0:
        return s.rows[LEVEL, i] - abs(s.rows[HOLDING, i])
    guard: float = modes[i] * x[plant.inertia.shape[0] + i]
    return guard


@njit(error_model="numpy")
def side_guard(plant: Plant, i: int, x: Array, modes: Integers) -> float:
    """Return what is negative once the deflection of transmission `i` has changed sides."""
    row, side = plant.transmissions[i], modes[plant.inertia.shape[0] + i]
    gap = row[HALF_GAP]
    if gap <= 0.0 and row[ASYMMETRY] == 0.0:
        return 1.0
    phi = x[plant.ends[i, 0]] - x[plant.ends[i, 1]]
    guard: float = gap - abs(phi) if side == 0 else side * phi - gap
    return guard


@njit(error_model="numpy")
def way_guard(plant: Plant, i: int, x: Array, modes: Integers) -> float:
    """Return what is negative once the deflection of transmission `i` has turned round, where that matters."""
    if plant.loops[i] < 0:
        return 1.0
    way = modes[plant.inertia.shape[0] + plant.transmissions.shape[0] + i]
    guard: float = way * _deflection(plant, i, x, modes)[1]
    return guard


@njit(error_model="numpy")
def slip_guard(plant: Plant, e: int, x: Array, modes: Integers) -> float:
    """Return what is negative once slip element `e` begins to slip, or stops."""
    mode = modes[plant.inertia.shape[0] + 2 * plant.transmissions.shape[0] + e]
    if mode == 0:
        stuck: float = plant.slips[e, 2] - abs(x[plant.first_slip + e])
        return stuck
    guard: float = mode * _deflection(plant, int(plant.slips[e, 0]), x, modes)[1]
    return guard


@njit(error_model="numpy")
def violated(plant: Plant, x: Array, modes: Integers, s: Scratch) -> bool:
    """Tell whether any mode has ended; call `derivative` before."""
    for i in range(plant.inertia.shape[0]):
        if friction_guard(plant, i, x, modes, s) < 0.0:
            return True
    for i in range(plant.transmissions.shape[0]):
        if side_guard(plant, i, x, modes) < 0.0 or way_guard(plant, i, x, modes) < 0.0:
            return True
    for e in range(plant.slips.shape[0]):  # noqa: SIM110  numba compiles no generator
        if slip_guard(plant, e, x, modes) < 0.0:
            return True
    return False


@njit(error_model="numpy")
def switch(plant: Plant, t: float, x: Array, tau: Array, modes: Integers, s: Scratch, out: Array) -> None:
    """Change the modes that have ended, and with them the state: what stops stands still, what slips is at its limit."""
    n, types = plant.inertia.shape[0], plant.inertia.shape[0] + plant.transmissions.shape[0]
    for i in range(n):
        if friction_guard(plant, i, x, modes, s) >= 0.0:
            continue
        if plant.bristles[i] >= 0:
            modes[i] = -modes[i]
        elif modes[i] == 0:
            modes[i] = 1 if s.rows[HOLDING, i] > 0.0 else -1
        else:
            x[n + i] = 0.0
            modes[i] = 0
            derivative(plant, t, x, tau, modes, s, out)
            if abs(s.rows[HOLDING, i]) > s.rows[LEVEL, i]:
                modes[i] = 1 if s.rows[HOLDING, i] > 0.0 else -1
                derivative(plant, t, x, tau, modes, s, out)
    for i in range(plant.transmissions.shape[0]):
        if way_guard(plant, i, x, modes) < 0.0:
            modes[types + i] = -modes[types + i]
        if side_guard(plant, i, x, modes) < 0.0:
            phi, gap = x[plant.ends[i, 0]] - x[plant.ends[i, 1]], plant.transmissions[i, HALF_GAP]
            sign = 1 if phi > 0.0 else -1
            modes[n + i] = sign if abs(phi) > gap or gap <= 0.0 else 0
    for e in range(plant.slips.shape[0]):
        if slip_guard(plant, e, x, modes) < 0.0:
            k, z = types + plant.transmissions.shape[0] + e, plant.first_slip + e
            if modes[k] == 0:
                modes[k] = 1 if x[z] > 0.0 else -1
                x[z] = modes[k] * plant.slips[e, 2]
            else:
                modes[k] = 0
