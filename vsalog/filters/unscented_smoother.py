"""Unscented Rauch–Tung–Striebel smoother in square-root form: states given the whole log, from those of a filter.

Särkkä, Unscented Rauch–Tung–Striebel smoother, IEEE Transactions on Automatic Control 53(3), 2008, with additive noise: with the
sigma points of a filtered state, their prediction x̂' with the covariance P', and the cross-covariance C of both,

    D = C P'⁻¹,    x ← x + D (x'ₛ − x̂'),    P ← P + D (P'ₛ − P') Dᵀ.

Here the next state is an observation of the one before it, x' = f(x) + q. The state's covariance, if it were
known, is R Rᵀ = P − D P' Dᵀ, so the correction of `square_root_ukf` makes D and R at once, and nothing is subtracted:

    S ← triangle of (D S'ₛ, R).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.filters.square_root_ukf import triangularise, unscented_filter, workspace

Array = NDArray[np.float64]
Room = tuple[tuple[Array, Array, Array, Array], Array, Array]


def smoother_room(size: int, steps: int) -> Room:
    """Return the work arrays of `unscented_smoother`'s function, for n states and the number of the model's steps in a sample."""
    return workspace(size, size), np.zeros((steps, size)), np.zeros((steps, size, size))


@njit(cache=True, error_model="numpy")
def _carry_back(x: Array, S: Array, R: Array, X: Array, Y: Array, A: Array) -> None:
    """Make the smoothed mean and factor of the next state, x and S, those of this one.

    After a correction X[:, 0] is the filtered mean, Y[:, 0] the next state's prediction error, and A has the factors
    (P_yy, 0; P_xy, R) side by side.
    """
    n, rows = x.shape[0], 2 * x.shape[0]
    for k in range(n):
        variance = 0.0
        for i in range(k + 1):
            variance += A[k, i] * A[k, i]
        known = A[k, k] * A[k, k] > (n * np.finfo(np.float64).eps) ** 2 * variance
        for j in range(n + 1):
            s = Y[k, 0] if j == n else S[k, j]
            for i in range(k):
                s -= A[k, i] * Y[i, j + 1]
            Y[k, j + 1] = s / A[k, k] if known else 0.0
        for j in range(n):
            # A direction in which the next state has no information keeps this one's variance.
            X[j, n + 1 + k] = 0.0 if known else A[n + j, k]
        rows = rows if known else 3 * n
    for k in range(n):
        x[k] = X[k, 0]
        for i in range(n):
            x[k] += A[n + k, i] * Y[i, n + 1]
        for j in range(n):
            s = 0.0
            for i in range(n):
                s += A[n + k, i] * Y[i, j + 1]
            X[k, j + 1] = s
    for k in range(n):
        for j in range(n):
            A[k, j], A[k, n + j], A[k, 2 * n + j] = X[k, j + 1], R[k, j], X[k, n + 1 + j]
    triangularise(A, n, rows)
    for k in range(n):
        for j in range(k + 1):
            S[k, j] = A[k, j]


def unscented_smoother(transition: Callable[..., None]) -> Callable[..., None]:
    """Compile the backward step of a smoother for a model, as `unscented_filter` does the filter's: `transition` is the same.

    Returns
    -------
    back : compiled function (x, S, xs, Ss, u, p, steps, weights, SQ, room) → None

    x, shape (n,), and S, shape (n, n), lower, are the filter's estimate of a sample; `xs` and `Ss` the smoother's of the
    next one, which is `steps` steps of the model ahead. x and S become the smoother's. `room` is of `smoother_room`, all else is
    as for the filter's `predict`. A component of the
    prediction without variance, to a float's digits, has no information on the state before.
    """
    # The step as an observation: what `condition` calls the measurement noise is the process noise.
    predict, condition = unscented_filter(transition, transition)

    @njit(error_model="numpy", inline="always")
    def back(
        x: Array, S: Array, xs: Array, Ss: Array, u: Any, p: Any, steps: int, weights: Array, SQ: Array, room: Room
    ) -> None:
        inner, states, factors = room
        X, Y, A, _ = inner
        n = x.shape[0]
        for k in range(n):
            states[0, k] = x[k]
            for j in range(n):
                factors[0, k, j] = S[k, j]
        for i in range(1, steps):
            for k in range(n):
                states[i, k] = states[i - 1, k]
                for j in range(n):
                    factors[i, k, j] = factors[i - 1, k, j]
            predict(states[i], factors[i], u, p, weights, SQ, inner)
        for k in range(n):
            x[k] = xs[k]
            for j in range(n):
                S[k, j] = Ss[k, j]
        for i in range(steps - 1, -1, -1):
            condition(states[i], factors[i], x, u, p, weights, SQ, inner)
            _carry_back(x, S, factors[i], X, Y, A)

    return back
