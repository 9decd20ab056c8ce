"""Least squares whose coefficients may not be negative where physics says so: inertia, damping, friction, a spring's stiffness.

Lawson and Hanson, "Solving Least Squares Problems", 1974, ch. 23, on the normal equations.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vsalog.core.precision import ROUNDING

Array = NDArray[np.float64]


def residual_of(y: Array, free: Array, positive: Array) -> tuple[Array, Array]:
    """Return what a fit leaves of y, shape (R,), and the coefficients that may not be negative, shape (k,).

    Raises nothing: columns that say nothing of their own have a coefficient of 0.

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
    """Return x ≥ 0 that makes ½ xᵀ G x − cᵀ x least."""
    count = moments.size
    x, free = np.zeros(count), np.zeros(count, dtype=np.bool_)
    tolerance = np.sqrt(ROUNDING) * max(float(np.abs(moments).max(initial=0.0)), ROUNDING)
    for _ in range(3 * count):
        slope = moments - gram @ x
        slope[free] = -np.inf
        if count == 0 or float(slope.max()) <= tolerance:
            break
        free[int(np.argmax(slope))] = True
        while True:
            z = np.zeros(count)
            z[free] = np.linalg.lstsq(gram[np.ix_(free, free)], moments[free], rcond=ROUNDING)[0]
            below = free & (z <= 0.0)
            if not below.any():
                x = z
                break
            step = float(np.min(x[below] / np.maximum(x[below] - z[below], np.finfo(float).tiny)))
            x = x + step * (z - x)
            free &= x > tolerance * np.finfo(float).eps
            if not free.any():
                break
    return x
