"""The two ways to obtain the flexibility torque from the motor's side: residual, and integrated motor equation."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsalog.core.compiled import compiled

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def residual_block(
    state: Array, theta: Array, theta_dot: Array, tau: Array, use: Flags, B: float, D: float, K_I: float, T: float,
    load: float = 0.0, other: Array | None = None, way: Array | None = None,
) -> tuple[Array, Array]:  # fmt: skip
    """Residual r_e: a first-order filtered flexibility torque, from motor position, velocity and torque (Flacco 2012 eq. 17).

    Of a motor whose friction grows with the transmitted torque, load · |τ_e + other| · way is subtracted too. That torque is the
    residual's own, so that r = known + κ |r + other| with κ = T K_I load way / (2 + T K_I); its one solution is
    r + other = (known + other) / (1 ∓ κ), with − where known + other ≥ 0.

    Parameters
    ----------
    state : shape (3,): r_e, p − ∫τ and τ of the previous sample; NaN where a run begins
    theta, theta_dot, tau : shape (N,), [rad], [rad/s], [N·m]
    use : shape (N,), samples that are there; a gap makes the residual begin again
    B, D : reflected motor inertia [kg·m²] and damping [N·m·s/rad]
    K_I : bandwidth [rad/s]
    T : period [s]
    load : friction as a share of the transmitted torque's size, below 1
    other : shape (N,), what the transmission transmits in addition to its spring's torque; it is in `tau` already [N·m]
    way : shape (N,), −1 to 1, which way friction acts

    Returns
    -------
    state, r_e (N,) [N·m]; NaN where `use` is false
    """
    new, out, nothing = state.copy(), np.empty_like(theta), np.zeros_like(theta)
    other, way = (nothing if given is None else given for given in (other, way))
    _residual(theta, theta_dot, tau, other, way, use, B, D, load, K_I, T, new, out)
    return new, out


def lag_block(state: Array, x: Array, use: Flags, K_I: float, T: float) -> tuple[Array, Array]:
    """Pass columns through the same first-order lag that the residual has, so that both sides of eq. 21 are filtered alike.

    `state` has shape (2, n): output and input of the previous sample, NaN where a run begins; `x` has shape (N, n).
    Returns the state and the filtered columns, shape (N, n).
    """
    new, out = state.copy(), np.empty_like(x)
    _lag(x, use, K_I, T, new, out)
    return new, out


def integral_block(state: Array, x: Array, use: Flags, T: float) -> tuple[Array, Array, Flags]:
    """Integrate columns over each run by the trapezoidal rule (Flacco 2014 eq. 11).

    `state` has shape (2, n): integral and last value, NaN where a run begins; `x` has shape (N, n).
    Returns the state, the integrals (N, n), and where a run begins (N,).
    """
    new, out, fresh = state.copy(), np.empty_like(x), np.zeros(x.shape[0], dtype=np.bool_)
    _integrate(x, use, T, new, out, fresh)
    return new, out, fresh


@compiled
def _residual(
    theta: Array, theta_dot: Array, tau: Array, other: Array, way: Array, use: Flags,
    B: float, D: float, load: float, K_I: float, T: float, state: Array, out: Array,
) -> None:  # fmt: skip
    a, b = (2.0 - T * K_I) / (2.0 + T * K_I), 2.0 * K_I / (2.0 + T * K_I)
    r, momentum, torque = state[0], state[1], state[2]
    for k in range(theta.shape[0]):
        if not use[k]:
            r = np.nan
            out[k] = np.nan
            continue
        p, share = B * theta_dot[k] + D * theta[k], load * way[k]
        if np.isnan(r):
            r = 0.0
        else:
            kappa = 0.5 * T * b * share
            # Eq. 17 in increments: the integral of τ would otherwise grow without bound and lose digits.
            carried = a * r + b * (p - momentum - 0.5 * T * (tau[k] + torque)) + other[k]
            r = carried / (1.0 - kappa if carried >= 0.0 else 1.0 + kappa) - other[k]
        momentum, torque = p, tau[k] - share * abs(r + other[k])
        out[k] = r
    state[0], state[1], state[2] = r, momentum, torque


@compiled
def _lag(x: Array, use: Flags, K_I: float, T: float, state: Array, out: Array) -> None:
    a, b = (2.0 - T * K_I) / (2.0 + T * K_I), T * K_I / (2.0 + T * K_I)
    for k in range(x.shape[0]):
        for i in range(x.shape[1]):
            if not use[k]:
                state[0, i] = np.nan
            elif np.isnan(state[0, i]):
                state[0, i] = 0.0
            else:
                state[0, i] = a * state[0, i] + b * (x[k, i] + state[1, i])
            state[1, i] = x[k, i]
            out[k, i] = state[0, i]


@compiled
def _integrate(x: Array, use: Flags, T: float, state: Array, out: Array, fresh: Flags) -> None:
    for k in range(x.shape[0]):
        for i in range(x.shape[1]):
            if not use[k]:
                state[0, i] = np.nan
            elif np.isnan(state[0, i]):
                state[0, i] = 0.0
                fresh[k] = True
            else:
                state[0, i] += 0.5 * T * (x[k, i] + state[1, i])
            state[1, i] = x[k, i]
            out[k, i] = state[0, i]
