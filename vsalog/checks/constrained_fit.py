"""Least squares whose coefficients may not be negative where physics says so: inertia, damping, friction, a spring's stiffness.

Block principal pivoting on the normal equations (Portugal, Júdice and Vicente, "A comparison of block pivoting and interior-point
algorithms for linear least squares problems with nonnegative variables", Math. Comput. 63, 1994), and where that does not end
soon one coefficient at a time (Lawson and Hanson, "Solving Least Squares Problems", 1974, ch. 23).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsalog.core.precision import ROUNDING

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def residual_of(y: Array, free: Array, positive: Array) -> tuple[Array, Array]:
    """Return the residual of a fit of y, shape (R,), and the coefficients that may not be negative, shape (k,).

    Linearly dependent columns have a coefficient of 0.

    Parameters
    ----------
    y : shape (R,)
    free, positive : columns whose coefficients may be anything, shape (R, m), and not negative, shape (R, k)
    """
    Q = _basis(free)
    y = y - Q @ (Q.T @ y)
    P = positive - Q @ (Q.T @ positive)
    size = np.sqrt(np.einsum("ij,ij->j", P, P))
    usable = size > np.sqrt(ROUNDING) * np.sqrt(np.einsum("ij,ij->j", positive, positive))
    scale = np.where(usable, size, 1.0)
    P = np.where(usable, P / scale, 0.0)
    x = _not_negative(P.T @ P, P.T @ y)
    return y - P @ x, x / scale


def _basis(columns: Array) -> Array:
    """Return an orthonormal basis of columns, shape (R, rank)."""
    size = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    u, s, _ = np.linalg.svd(columns / np.where(size > 0.0, size, 1.0), full_matrices=False)
    return np.asarray(u[:, s > np.sqrt(ROUNDING) * max(float(s.max(initial=0.0)), ROUNDING)])


def _not_negative(gram: Array, moments: Array) -> Array:
    """Return x ≥ 0 that minimises ½ xᵀ G x − cᵀ x."""
    tolerance = np.sqrt(ROUNDING) * max(float(np.abs(moments).max(initial=0.0)), ROUNDING)
    free = moments > 0.0
    # It seldom takes more than four steps, and may cycle.
    for _ in range(moments.size + 1):
        x = _solved(gram, moments, free)
        wrong = np.where(free, x < 0.0, moments - gram @ x > tolerance)
        if not wrong.any():
            return x
        free ^= wrong
    return _one_by_one(gram, moments, tolerance)


def _solved(gram: Array, moments: Array, free: Flags) -> Array:
    """Return the minimiser of ½ xᵀ G x − cᵀ x where all but the free ones are 0."""
    x = np.zeros(moments.size)
    if free.any():
        part, own = gram[np.ix_(free, free)], moments[free]
        # A tenth of the time of singular values, which dependent columns need.
        x[free] = np.linalg.solve(part, own) if _is_definite(part) else np.linalg.lstsq(part, own, rcond=ROUNDING)[0]
    return x


def _is_definite(gram: Array) -> bool:
    """Return whether no column of those that have these products, each of length 1, depends on the others."""
    try:
        pivots = np.diagonal(np.linalg.cholesky(gram))
    except np.linalg.LinAlgError:
        return False
    return bool(pivots.min() > np.sqrt(ROUNDING))


def _one_by_one(gram: Array, moments: Array, tolerance: float) -> Array:
    x, free = np.zeros(moments.size), np.zeros(moments.size, dtype=np.bool_)
    # Lawson and Hanson prove that it ends; with rounding it may not.
    for _ in range(3 * moments.size):
        slope = np.where(free, -np.inf, moments - gram @ x)
        if float(slope.max(initial=-np.inf)) <= tolerance:
            break
        free[int(np.argmax(slope))] = True
        while (z := _solved(gram, moments, free)).min(initial=0.0, where=free) < 0.0 or (z[free] == 0.0).any():
            below = free & (z <= 0.0)
            step = float(np.min(x[below] / np.maximum(x[below] - z[below], np.finfo(np.float64).tiny)))
            x = np.where(free, x + step * (z - x), 0.0)
            free &= ~(below & (x <= tolerance * np.finfo(np.float64).eps)) & (x > 0.0)
        x = z
    return x
