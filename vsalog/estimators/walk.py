"""What white noise of a torque makes of a fit to its integral: a random walk, whose like the regressors are.

Of a walk a fit leaves little over, because integrals are slow too: left-overs do not show how large it is where the log has few
samples. But the noise of a torque is known, and what it makes of the score Σ F n, with n the sum of all noise so far, follows:
with G_j = Σ_{k≥j} F_k its covariance is Σ_j s_j² G_j G_jᵀ, for steps of s_j = σ T.

Jumps of the torque between two samples are steps of their own (`jumps.py`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class WalkState(NamedTuple):
    """Sums over the rows so far, of n regressors.

    Attributes
    ----------
    Q : shape (n, n), Σ_j s_j² G_j G_jᵀ of the run
    done : shape (n, n), the same of the runs before, each less its constant
    H, R, S : shape (n,), Σ_j s_j² G_j, Σ_j s_j² r_j G_j with r_j the rows from the j-th on, and Σ F
    sums : shape (4,), rows of the run, and Σ s_j², Σ s_j² r_j and Σ s_j² r_j²
    """

    Q: Array
    done: Array
    H: Array
    R: Array
    S: Array
    sums: Array


def walk_start(n: int) -> WalkState:
    """Return the state before the first sample."""
    return WalkState(np.zeros((n, n)), np.zeros((n, n)), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(4))


def walk_block(
    state: WalkState, F: Array, use: Flags, fresh: Flags, directions: Array, steps: Array, discount: float
) -> tuple[WalkState, Array]:
    """Go on with the sums; return what a walk makes of functionals after each row.

    Parameters
    ----------
    F : shape (N, n), regressors, the first of which is one
    use : shape (N,), rows that are learnt from
    fresh : shape (N,), where the integral begins anew
    directions : shape (N, m, n), P times the functionals
    steps : shape (N,), s_j², variances of the walk's steps [(N·m·s)²]
    discount : λ², by which the weight of all rows before falls with each

    Returns
    -------
    state, and variances, shape (N, m)
    """
    new = WalkState(*(part.copy() for part in state))
    made = np.zeros(directions.shape[:2])
    _run(F, use, fresh, directions, steps, discount, *new, made)
    return new, made


@njit(cache=True, error_model="numpy", nogil=True)
def _run(
    F: Array, use: Flags, fresh: Flags, directions: Array, steps: Array, discount: float, Q: Array, done: Array, H: Array,
    R: Array, S: Array, sums: Array, made: Array,
) -> None:  # fmt: skip
    n = H.size
    for k in range(F.shape[0]):
        if fresh[k] and sums[0] > 0.0:
            _finish_run(Q, done, H, R, S, sums)
        if use[k]:
            sums[0] += 1.0
            sums[3] += 2.0 * sums[2] + sums[1] + steps[k]
            sums[1] += steps[k]
            sums[2] += sums[1]
            for i in range(n):
                for j in range(n):
                    mixed = H[i] * F[k, j] + F[k, i] * H[j]
                    Q[i, j] = discount * discount * Q[i, j] + discount * mixed + sums[1] * F[k, i] * F[k, j]
                    done[i, j] *= discount * discount
            for i in range(n):
                R[i] = discount * (R[i] + H[i]) + sums[2] * F[k, i]
                H[i] = discount * H[i] + sums[1] * F[k, i]
                S[i] = discount * S[i] + F[k, i]
        for m in range(directions.shape[1]):
            total = 0.0
            for i in range(n):
                along = 0.0
                for j in range(n):
                    along += (Q[i, j] + done[i, j]) * directions[k, m, j]
                total += directions[k, m, i] * along
            made[k, m] = max(total, 0.0)


@njit(cache=True, error_model="numpy", nogil=True)
def _finish_run(Q: Array, done: Array, H: Array, R: Array, S: Array, sums: Array) -> None:
    """Add a run to those before: less its own constant, which nobody asks for any more."""
    rows, squares, n = sums[0], sums[3], H.size
    for i in range(1, n):
        for j in range(1, n):
            a, b = S[i] / rows, S[j] / rows
            done[i, j] += Q[i, j] - R[i] * b - a * R[j] + squares * a * b
    Q[:, :], H[:], R[:], S[:], sums[:] = 0.0, 0.0, 0.0, 0.0, 0.0
