"""Integrated noise: the random walk that white noise of a torque becomes in an integrated equation.

A fit to an integral absorbs most of a random walk, because integrals are slow too: where the log is short, residuals do not
show how large it is. But the noise of a torque is known, and its effect on the score Σ F n, with n the sum of all noise so
far, follows: with G_j = Σ_{k≥j} F_k its covariance is s² Σ_j G_j G_jᵀ, for steps of s = σ T.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class WalkState(NamedTuple):
    """Sums over the rows so far, of n regressors, for steps of variance one.

    Attributes
    ----------
    Q : shape (n, n), Σ_j G_j G_jᵀ of the run
    done : shape (n, n), the same of the runs before, each less its constant
    H, R, S : shape (n,), Σ_j G_j, Σ_j r_j G_j with r_j the rows from the j-th on, and Σ F
    rows : shape (1,), of the run
    """

    Q: Array
    done: Array
    H: Array
    R: Array
    S: Array
    rows: Array


def walk_start(n: int) -> WalkState:
    """Return the state before the first sample."""
    return WalkState(np.zeros((n, n)), np.zeros((n, n)), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(1))


def walk_block(
    state: WalkState, F: Array, use: Flags, fresh: Flags, directions: Array, discount: float
) -> tuple[WalkState, Array]:
    """Go on with the sums; return the effect of a random walk of steps of variance one on functionals after each row.

    Parameters
    ----------
    F : shape (N, n), regressors, the first of which is one
    use : shape (N,), rows that are used
    fresh : shape (N,), where the integral begins again
    directions : shape (N, m, n), P times the functionals
    discount : λ², by which the weight of all rows before falls with each

    Returns
    -------
    state, and variances, shape (N, m)
    """
    new = WalkState(*(part.copy() for part in state))
    made = np.zeros(directions.shape[:2])
    _run(F, use, fresh, directions, discount, *new, made)
    return new, made


@njit(cache=True, error_model="numpy", nogil=True)
def _run(
    F: Array, use: Flags, fresh: Flags, directions: Array, discount: float, Q: Array, done: Array, H: Array, R: Array, S: Array,
    rows: Array, made: Array,
) -> None:  # fmt: skip
    n = H.size
    for k in range(F.shape[0]):
        if fresh[k] and rows[0] > 0.0:
            # Less its own constant, which is not needed any more.
            N = rows[0]
            squares = N * (N + 1.0) * (2.0 * N + 1.0) / 6.0
            for i in range(1, n):
                for j in range(1, n):
                    a, b = S[i] / N, S[j] / N
                    done[i, j] += Q[i, j] - R[i] * b - a * R[j] + squares * a * b
            for i in range(n):
                H[i] = R[i] = S[i] = 0.0
                for j in range(n):
                    Q[i, j] = 0.0
            rows[0] = 0.0
        if use[k]:
            rows[0] += 1.0
            N = rows[0]
            for i in range(n):
                for j in range(n):
                    mixed = H[i] * F[k, j] + F[k, i] * H[j]
                    Q[i, j] = discount * discount * Q[i, j] + discount * mixed + N * F[k, i] * F[k, j]
                    done[i, j] *= discount * discount
            for i in range(n):
                R[i] = discount * (R[i] + H[i]) + 0.5 * N * (N + 1.0) * F[k, i]
                H[i] = discount * H[i] + N * F[k, i]
                S[i] = discount * S[i] + F[k, i]
        for m in range(directions.shape[1]):
            total = 0.0
            for i in range(n):
                along = 0.0
                for j in range(n):
                    along += (Q[i, j] + done[i, j]) * directions[k, m, j]
                total += directions[k, m, i] * along
            made[k, m] = max(total, 0.0)
