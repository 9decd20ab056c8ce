"""Compiled plant: n motors, each behind its own transmission, pull one link.

n = 1 is the elastic joint (Flacco 2012 eq. 3–4), n = 2 the antagonistic joint (eq. 7–8). Classical Runge–Kutta of fourth
order with a fixed step: the equations are not stiff (a few hundred rad/s at most), and a fixed step gives the same
numbers on every run. This file imports no other compiled file, since numba's cache does not see changes in imports.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Codes = NDArray[np.int64]

LINEAR, CUBIC, VSA2 = 0, 1, 2


@njit(cache=True)
def _flexibility_torque(code: int, p0: float, p1: float, phi: float) -> float:
    """Return τ_e [N·m]; NaN from the VSA-II's singularity on."""
    if code == LINEAR:
        return p0 * phi
    if code == CUBIC:
        return (p0 + p1 * phi * phi) * phi
    cs = p1 * np.sin(0.5 * phi)
    if abs(cs) >= 1.0 or abs(phi) >= np.pi:
        return np.nan
    beta = np.arcsin(cs) - 0.5 * phi
    slope = 0.5 * (p1 * np.cos(0.5 * phi) / np.sqrt(1.0 - cs * cs) - 1.0)
    torque: float = 2.0 * p0 * beta * slope
    return torque


@njit(cache=True)
def _derivative(
    x: Array,
    tau: Array,
    scale: float,
    codes: Codes,
    transmissions: Array,
    motors: Array,
    link: Array,
    out: Array,
) -> None:
    """Write ẋ of x = (q, q̇, θ₁, θ̇₁, …) into `out`."""
    q, dq = x[0], x[1]
    total = 0.0
    for i in range(codes.shape[0]):
        theta, dtheta = x[2 + 2 * i], x[3 + 2 * i]
        flexibility = scale * _flexibility_torque(codes[i], transmissions[i, 0], transmissions[i, 1], q - theta)
        total += flexibility
        out[2 + 2 * i] = dtheta
        out[3 + 2 * i] = (tau[i] + flexibility - motors[i, 1] * dtheta) / motors[i, 0]
    out[0] = dq
    out[1] = (-total - link[1] * dq - link[2] * np.sin(q)) / link[0]


@njit(cache=True)
def integrate_parallel(
    start: Array,
    torques: Array,
    step: float,
    drift_rate: float,
    codes: Codes,
    transmissions: Array,
    motors: Array,
    link: Array,
) -> Array:
    """Integrate the plant.

    Parameters
    ----------
    start : shape (2 + 2n,), (q, q̇, θ₁, θ̇₁, …) [rad, rad/s]
    torques : shape (n, N − 1, 2S + 1), motor torques [N·m] at the ends and the middles of the S steps in each period;
        a period has its own end value, so that a held input jumps at the border and not before
    step : [s], period / S
    drift_rate : every flexibility torque is multiplied with 1 + drift_rate · t [1/s]
    codes : shape (n,), LINEAR, CUBIC or VSA2
    transmissions : shape (n, 2), (k, 0), (k₁, k₃) or (k, C), SI
    motors : shape (n, 2), reflected inertia B and damping D_θ
    link : shape (3,), inertia M, damping D_q, gravity torque m g l

    Returns
    -------
    shape (N, 2 + 2n), the state at every sample; NaN once a VSA-II transmission has reached its singularity
    """
    n = codes.shape[0]
    periods = torques.shape[1]
    steps = (torques.shape[2] - 1) // 2
    out = np.empty((periods + 1, start.shape[0]))
    x = start.copy()
    tau = np.empty(n)
    k1, k2, k3, k4 = np.empty_like(x), np.empty_like(x), np.empty_like(x), np.empty_like(x)
    out[0] = x
    for p in range(periods):
        for s in range(steps):
            t = (p * steps + s) * step
            begin, middle, end = (
                1.0 + drift_rate * t,
                1.0 + drift_rate * (t + 0.5 * step),
                1.0 + drift_rate * (t + step),
            )
            for i in range(n):
                tau[i] = torques[i, p, 2 * s]
            _derivative(x, tau, begin, codes, transmissions, motors, link, k1)
            for i in range(n):
                tau[i] = torques[i, p, 2 * s + 1]
            _derivative(x + 0.5 * step * k1, tau, middle, codes, transmissions, motors, link, k2)
            _derivative(x + 0.5 * step * k2, tau, middle, codes, transmissions, motors, link, k3)
            for i in range(n):
                tau[i] = torques[i, p, 2 * s + 2]
            _derivative(x + step * k3, tau, end, codes, transmissions, motors, link, k4)
            x = x + (step / 6.0) * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        out[p + 1] = x
    return out
