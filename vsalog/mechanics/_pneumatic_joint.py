"""Compiled plant: two pneumatic muscles, their valves, and a seesaw with dry friction (Shin, Ibayashi, Kogiso 2021 eq. 2–11).

While the joint slips one way, or sticks, its equations are smooth (but for kinks of the flows, which cost a step of h some h²
of a small number): classical Runge–Kutta with a fixed step. Where slipping ends (ψ̇ comes to 0) or sticking (the torque
reaches the friction's level) within a step, the moment is found by halving the step, the step is cut there, and the rest of it
goes on in the other way. So the order of the method is kept through stick and slip, which the paper's implicit Euler form
of the friction solves at order one. The equations are not stiff: air flows within seconds, the seesaw swings at some 20 Hz.

This file imports no other compiled file, since numba's cache does not see changes in imports. The formulas are in
`vsalog.mechanics.pneumatics` and its neighbours too, with their derivations, for arrays.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Pull(IntEnum):
    """Laws of the force of muscles."""

    LINEAR, BRAID, EXPONENTIAL, SPRING = range(4)


class Friction(IntEnum):
    """Laws of friction."""

    NONE, PRESSURE, SIMPLE, TONDU = range(4)


class Way(IntEnum):
    """How the seesaw moves: against friction towards positive or negative angles, not at all, or without any friction."""

    BACKWARD, STICK, FORWARD, FREE = range(-1, 3)


MOST_EVENTS = 20
"""Changes within one step after which the joint sticks for the rest of it; where anything happens there are two or three."""


@njit(cache=True, error_model="numpy")
def _flow(up: float, down: float, air: Array) -> float:
    """Return the mass flow per area from `up` to `down`; see `orifice_flow`."""
    if up < down:
        return -_flow_down(down, up, air)
    return _flow_down(up, down, air)


@njit(cache=True, error_model="numpy")
def _flow_down(high: float, low: float, air: Array) -> float:
    k, ratio = air[3], low / high
    if ratio <= air[4]:
        choked: float = high * air[7]
        return choked
    # r^(2/k) − r^((k+1)/k) with one power only.
    root = ratio ** (1.0 / k)
    inside = max(root * (root - ratio), 0.0)
    flow: float = high * np.sqrt(2.0 * k / (k - 1.0) * inside / air[2])
    return flow


@njit(cache=True, error_model="numpy")
def _force(i: int, pressure: float, length: float, muscles: Array, outside: float) -> float:
    """Return the pull of the i-th muscle; see `contraction_force`."""
    code, p = int(muscles[i, 8]), pressure - outside
    c0, c1, c2, c3 = muscles[i, 9], muscles[i, 10], muscles[i, 11], muscles[i, 12]
    rest = muscles[i, 15]
    if code == Pull.LINEAR:
        force = (c0 * length + c1) * pressure + c2 * length + c3
    elif code == Pull.BRAID:
        force = c0 * p * (c1 * (length / rest) ** 2 - c2)
    elif code == Pull.EXPONENTIAL:
        contraction = 1.0 - length / rest
        force = (c0 * p + c1) * np.exp(c2 * contraction) + (c3 * contraction + muscles[i, 13]) * p + muscles[i, 14]
    else:
        s = length - rest
        force = (c0 + c1 * s * s + c2 * p * s + c3 * p * p) * s
    result: float = muscles[i, 4] * force
    return result


@njit(cache=True, error_model="numpy")
def _pulls(x: Array, air: Array, muscles: Array, seesaw: Array) -> tuple[float, float]:
    travel = seesaw[0] * np.sin(x[0])
    f1 = _force(0, x[2], muscles[0, 0] - travel, muscles, air[1])
    f2 = _force(1, x[3], muscles[1, 0] + travel, muscles, air[1])
    return f1, f2


@njit(cache=True, error_model="numpy")
def _level(
    speed: float, p1: float, p2: float, f1: float, f2: float, air: Array, seesaw: Array, friction: Array
) -> float:
    """Return the dry friction's level; see `friction_level`."""
    if int(friction[0]) == Friction.PRESSURE:
        g1, g2 = max(abs(p1 - air[1]), friction[4]), max(abs(p2 - air[1]), friction[4])
        return float(friction[2] * abs(f1 + f2 - seesaw[3]) + friction[3] * (1.0 / (g1 * g1) + 1.0 / (g2 * g2)))
    if int(friction[0]) == Friction.SIMPLE:
        return float(friction[2])
    if int(friction[0]) == Friction.TONDU:
        level: float = (friction[2] - friction[3]) * np.exp(-abs(speed) / friction[4]) + friction[3]
        return level
    return 0.0


@njit(cache=True, error_model="numpy")
def _drive(x: Array, external: float, f1: float, f2: float, seesaw: Array) -> float:
    """Return the torque on the seesaw but for friction, τ − k_s ψ + τ_ext."""
    drive: float = seesaw[0] * np.cos(x[0]) * (f1 - f2) - seesaw[2] * x[0] + external
    return drive


@njit(cache=True, error_model="numpy")
def _derivative(
    x: Array, way: int, inputs: Array, air: Array, muscles: Array, seesaw: Array, friction: Array, out: Array
) -> None:
    """Write ẋ of x = (ψ, ψ̇, P₁, P₂) into `out`; `inputs` is (α₁, α₂, τ_ext)."""
    sine, cosine = np.sin(x[0]), np.cos(x[0])
    if way == Way.STICK:
        out[0], out[1] = 0.0, 0.0
    else:
        f1, f2 = _pulls(x, air, muscles, seesaw)
        torque = _drive(x, inputs[2], f1, f2, seesaw)
        if way != Way.FREE:
            torque -= friction[1] * x[1] + way * _level(x[1], x[2], x[3], f1, f2, air, seesaw, friction)
        out[0], out[1] = x[1], torque / seesaw[1]
    for i in range(2):
        muscle, pressure, side = muscles[i], x[2 + i], -1.0 if i == 0 else 1.0
        length = muscle[0] + side * seesaw[0] * sine
        volume = (muscle[1] * length + muscle[2]) * length + muscle[3]
        swelling = (2.0 * muscle[1] * length + muscle[2]) * side * seesaw[0] * cosine * out[0]
        if not (volume > 0.0 and pressure > 0.0):
            out[2 + i] = np.nan
            continue
        outflow = _flow(pressure, air[1], air)
        flow = inputs[i] * _flow(air[0], pressure, air) - (1.0 - inputs[i]) * outflow
        flow *= muscle[6] if flow > 0.0 else muscle[7]
        flow -= muscle[5] * outflow
        out[2 + i] = (air[5] * air[2] * flow - air[6] * swelling * pressure) / volume


@njit(cache=True, error_model="numpy")
def _interpolate(nodes: Array, s: float, out: Array) -> None:
    """Write the inputs at the fraction s of a step into `out`, by the parabola through its begin, middle and end."""
    for i in range(3):
        out[i] = (
            nodes[i, 0] * (1.0 - s) * (1.0 - 2.0 * s)
            + 4.0 * nodes[i, 1] * s * (1.0 - s)
            + nodes[i, 2] * s * (2.0 * s - 1.0)
        )
    for i in range(2):
        out[i] = min(max(out[i], 0.0), 1.0)


@njit(cache=True, error_model="numpy")
def _advance(
    x: Array,
    way: int,
    nodes: Array,
    begin: float,
    share: float,
    step: float,
    air: Array,
    muscles: Array,
    seesaw: Array,
    friction: Array,
    work: Array,
    out: Array,
) -> None:
    """Write into `out` the state after the part of a step that begins at the fraction `begin` and takes `share` of it."""
    h, inputs = share * step, work[5, :3]
    _interpolate(nodes, begin, inputs)
    _derivative(x, way, inputs, air, muscles, seesaw, friction, work[0])
    _interpolate(nodes, begin + 0.5 * share, inputs)
    for i in range(4):
        work[4, i] = x[i] + 0.5 * h * work[0, i]
    _derivative(work[4], way, inputs, air, muscles, seesaw, friction, work[1])
    for i in range(4):
        work[4, i] = x[i] + 0.5 * h * work[1, i]
    _derivative(work[4], way, inputs, air, muscles, seesaw, friction, work[2])
    _interpolate(nodes, begin + share, inputs)
    for i in range(4):
        work[4, i] = x[i] + h * work[2, i]
    _derivative(work[4], way, inputs, air, muscles, seesaw, friction, work[3])
    for i in range(4):
        out[i] = x[i] + h / 6.0 * (work[0, i] + 2.0 * work[1, i] + 2.0 * work[2, i] + work[3, i])


@njit(cache=True, error_model="numpy")
def _ended(
    x: Array, way: int, external: float, air: Array, muscles: Array, seesaw: Array, friction: Array, held: bool
) -> bool:
    """Return whether the seesaw's mode has ended: slipping where ψ̇ has turned, sticking where torque wins."""
    if way == Way.FREE or held:
        return False
    if way != Way.STICK:
        return bool(way * x[1] < 0.0)
    f1, f2 = _pulls(x, air, muscles, seesaw)
    return abs(_drive(x, external, f1, f2, seesaw)) > _level(x[1], x[2], x[3], f1, f2, air, seesaw, friction)


@njit(cache=True, error_model="numpy")
def _way_from_rest(x: Array, external: float, air: Array, muscles: Array, seesaw: Array, friction: Array) -> int:
    """Return what a seesaw at rest does next."""
    f1, f2 = _pulls(x, air, muscles, seesaw)
    drive = _drive(x, external, f1, f2, seesaw)
    if abs(drive) <= _level(x[1], x[2], x[3], f1, f2, air, seesaw, friction):
        return Way.STICK.value
    return Way.FORWARD.value if drive > 0.0 else Way.BACKWARD.value


@njit(cache=True, nogil=True, error_model="numpy")
def integrate_pam(
    start: Array, inputs: Array, step: float, air: Array, muscles: Array, seesaw: Array, friction: Array, held: bool
) -> Array:
    """Integrate the plant.

    Parameters
    ----------
    start : shape (4,), (ψ, ψ̇, P₁, P₂) [rad, rad/s, Pa]; ψ̇ is taken as 0 where `held`
    inputs : shape (3, N − 1, 2S + 1), α₁, α₂ and the external torque [N·m] at the ends and the middles of the S steps in
        each period; a period has its own end value, so that a held input jumps at the border and not before
    step : [s], period / S
    air : P_tank, P_out [Pa], R T [J/kg], k, critical ratio, k₁, k₂, and the flow of a choked orifice [kg/(s·m²·Pa)]
    muscles : shape (2, 16): L₀, D₁, D₂, D₃, force gain, leak area, A₁, A₂ [m²], code of the force model and its numbers
        (up to 6), rest length
    seesaw : r, J, k_s, M g
    friction : code, c_s, and the model's own: r_p μ_s, T_p′, least P − P_out; or level; or f_s, f_k, speed
    held : the seesaw is clamped where it starts

    Returns
    -------
    shape (N, 4), the state at every sample, ψ̇ exactly 0 where the joint sticks; NaN once a volume or a pressure is not
    positive
    """
    periods, steps = inputs.shape[1], (inputs.shape[2] - 1) // 2
    out, work = np.empty((periods + 1, 4)), np.empty((6, 4))
    x, trial = start.copy(), np.empty(4)
    at_event = np.empty(3)
    if held:
        x[1] = 0.0
    way = Way.FREE.value
    if held:
        way = Way.STICK.value
    elif int(friction[0]) != Friction.NONE:
        way = Way.STICK.value if x[1] == 0.0 else int(np.sign(x[1]))
    out[0] = x
    for p in range(periods):
        for s in range(steps):
            nodes = inputs[:, p, 2 * s : 2 * s + 3]
            if way == Way.STICK and not held:
                way = _way_from_rest(x, nodes[2, 0], air, muscles, seesaw, friction)
            begin = 0.0
            for event in range(MOST_EVENTS + 1):
                if event == MOST_EVENTS:
                    way, x[1] = Way.STICK.value, 0.0
                share = 1.0 - begin
                _advance(x, way, nodes, begin, share, step, air, muscles, seesaw, friction, work, trial)
                if event == MOST_EVENTS or not _ended(trial, way, nodes[2, 2], air, muscles, seesaw, friction, held):
                    x[:] = trial
                    break
                before, after = 0.0, share
                while True:
                    middle = 0.5 * (before + after)
                    if not before < middle < after:  # known to the last bit
                        break
                    _advance(x, way, nodes, begin, middle, step, air, muscles, seesaw, friction, work, trial)
                    _interpolate(nodes, begin + middle, at_event)
                    if _ended(trial, way, at_event[2], air, muscles, seesaw, friction, held):
                        after = middle
                    else:
                        before = middle
                _advance(x, way, nodes, begin, after, step, air, muscles, seesaw, friction, work, trial)
                x[:] = trial
                x[1] = 0.0
                begin += after
                _interpolate(nodes, begin, at_event)
                way = _way_from_rest(x, at_event[2], air, muscles, seesaw, friction)
                if begin >= 1.0:
                    break
        out[p + 1] = x
    return out
