"""Compiled plant: the AwAS, a serial joint whose secondary motor moves the lever arm (Flacco 2012 eq. 12, 49–52).

The secondary motor is stiff: B_c θ̈_c + D_c θ̇_c = τ_c − ψ_e with D_c/B_c ≈ 1.1e5 1/s: an explicit step must be
shorter than 25 µs although nothing of interest happens that fast. Hence a change of coordinates: with ε = B_c/D_c,

    z = θ_c + ε θ̇_c    obeys    ż = (τ_c − ψ_e)/D_c    exactly,

which is slow and goes through the same Runge–Kutta step as the rest, while θ̇_c relaxes towards ż and is advanced by the
exact (exponential) solution for a ż that is linear within the step. Inside a step θ_c = z − ε ż is used for the lever arm,
which neglects the relaxation after a jump of ż: some 1e-6 of the travel, for some 10 µs.
Where the secondary motor is not stiff (step · D_c/B_c ≤ 0.5) it is integrated like everything else.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Largest step · D_c/B_c at which the plain Runge–Kutta step is taken (its stability ends at 2.78).
EXPLICIT_LIMIT = 0.5


@njit(cache=True)
def _derivative(
    x: Array,
    tau: float,
    tau_c: float,
    scale: float,
    transmission: Array,
    motor: Array,
    secondary: Array,
    link: Array,
    stiff: bool,
    out: Array,
) -> None:
    """Write ẋ of x = (q, q̇, θ, θ̇, θ_c, θ̇_c) into `out`; with `stiff`, x[4] is z and x[5] is left alone."""
    k, r0, b = transmission[0], transmission[1], transmission[2]
    phi = x[0] - x[2]
    squared = np.sin(phi) ** 2
    b_c, d_c = secondary[0], secondary[1]
    if stiff:
        # ψ_e depends on θ_c through r, but ε ż is so small that ψ_e at z serves.
        reaction = -2.0 * scale * k * b * (r0 - b * x[4]) * squared
        out[4] = (tau_c - reaction) / d_c
        out[5] = 0.0
        r = r0 - b * (x[4] - b_c / d_c * out[4])
    else:
        r = r0 - b * x[4]
        reaction = -2.0 * scale * k * b * r * squared
        out[4] = x[5]
        out[5] = (tau_c - reaction - d_c * x[5]) / b_c
    flexibility = scale * k * r * r * np.sin(2.0 * phi)
    out[0] = x[1]
    out[1] = (-flexibility - link[1] * x[1] - link[2] * np.sin(x[0])) / link[0]
    out[2] = x[3]
    out[3] = (tau + flexibility - motor[1] * x[3]) / motor[0]


@njit(cache=True)
def integrate_awas(
    start: Array,
    torques: Array,
    step: float,
    drift_rate: float,
    transmission: Array,
    motor: Array,
    secondary: Array,
    link: Array,
) -> Array:
    """Integrate the plant.

    Parameters
    ----------
    start : shape (6,), (q, q̇, θ, θ̇, θ_c, θ̇_c) [rad, rad/s]
    torques : shape (2, N − 1, 2S + 1), primary and secondary motor torque, reflected [N·m], at the ends and the middles
        of the S steps in each period
    step : [s], period / S
    drift_rate : the springs' stiffness is multiplied with 1 + drift_rate · t [1/s]
    transmission : (k_s [N/m], r₀ [m], b [m/rad])
    motor, secondary : shape (2,), reflected inertia and damping
    link : shape (3,), inertia M, damping D_q, gravity torque m g l

    Returns
    -------
    shape (N, 6), the state at every sample
    """
    periods = torques.shape[1]
    steps = (torques.shape[2] - 1) // 2
    out = np.empty((periods + 1, 6))
    b_c, d_c = secondary[0], secondary[1]
    stiff = step * d_c > EXPLICIT_LIMIT * b_c
    x = start.copy()
    velocity = start[5]
    eps, decay, ramp = 0.0, 0.0, 0.0
    if stiff:
        eps = b_c / d_c
        decay = np.exp(-step / eps)
        # Weight of the slope in v(h) = ż(h) − ramp · (ż(h) − ż(0)) + decay · (v(0) − ż(0)).
        ramp = eps / step * (1.0 - decay)
        x[4] = start[4] + eps * velocity
    k1, k2, k3, k4 = np.empty_like(x), np.empty_like(x), np.empty_like(x), np.empty_like(x)
    out[0] = start
    for p in range(periods):
        for s in range(steps):
            t = (p * steps + s) * step
            begin, middle, end = (
                1.0 + drift_rate * t,
                1.0 + drift_rate * (t + 0.5 * step),
                1.0 + drift_rate * (t + step),
            )
            tau, tau_c = torques[0, p, 2 * s], torques[1, p, 2 * s]
            _derivative(x, tau, tau_c, begin, transmission, motor, secondary, link, stiff, k1)
            tau, tau_c = torques[0, p, 2 * s + 1], torques[1, p, 2 * s + 1]
            _derivative(x + 0.5 * step * k1, tau, tau_c, middle, transmission, motor, secondary, link, stiff, k2)
            _derivative(x + 0.5 * step * k2, tau, tau_c, middle, transmission, motor, secondary, link, stiff, k3)
            tau, tau_c = torques[0, p, 2 * s + 2], torques[1, p, 2 * s + 2]
            _derivative(x + step * k3, tau, tau_c, end, transmission, motor, secondary, link, stiff, k4)
            x = x + (step / 6.0) * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
            if stiff:
                velocity = k4[4] - ramp * (k4[4] - k1[4]) + decay * (velocity - k1[4])
        out[p + 1] = x
        if stiff:
            out[p + 1, 4] = x[4] - eps * velocity
            out[p + 1, 5] = velocity
    return out
