"""The likelihood of a state that walks along few directions, without a covariance of the whole state at every instant.

Of x_k = c + Σ_i d_i s_ki and z_k = H_k x_k + e_k: c is constant, and the r ≪ n scalars s_k are a random walk that begins at zero.
Rotations split the rows of an instant into r that have the scalars and others that have c alone; eliminating the scalars one
instant after the other leaves a triangle on c, whatever the prior of c is (least squares of bordered block-bidiagonal form:
Golub and Van Loan, *Matrix Computations*, §6.5 on sequential elimination by QR).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vsalog.core.compiled import compiled
from vsalog.filters.square_root_smoother import triangularise

Array = NDArray[np.float64]


class RandomWalk:
    """Measurements of a state that walks along given directions.

    Parameters
    ----------
    measurements : shape (K, m, n + 1), rows [H z] with independent noise of variance one
    directions : shape (r, n)
    """

    def __init__(self, measurements: Array, directions: Array) -> None:
        r, width = len(directions), measurements.shape[2]
        rows = triangle_of(np.concatenate((measurements[:, :, :-1] @ directions.T, measurements), axis=2))
        self._fronts = np.ascontiguousarray(rows[:, :r])
        self._rest = triangle_of(rows[:, r:, r:].reshape(-1, width))
        self._found: dict[bytes, tuple[Array, float]] = {}

    def triangle(self, shares: Array) -> tuple[Array, float]:
        """Return the information of the measurements about c, with the walk marginalised.

        Parameters
        ----------
        shares : shape (K − 1,), standard deviation of each step of the scalars; zero where they do not change

        Returns
        -------
        triangle : shape (at most n + 1, n + 1), rows [R z] with independent noise of variance one
        logarithm : to add to the log likelihood
        """
        # Hypotheses that differ in what is known of c have the same steps.
        key = shares.tobytes()
        if key not in self._found:
            self._found[key] = self._eliminated(shares)
        return self._found[key]

    def _eliminated(self, shares: Array) -> tuple[Array, float]:
        fronts = self._fronts
        rows, logarithm = np.zeros((len(fronts), fronts.shape[1], fronts.shape[2] - fronts.shape[1])), 0.0
        if fronts.shape[1]:
            logarithm = _eliminate(fronts, shares, rows)
        stack = np.vstack((self._rest, rows.reshape(-1, rows.shape[2])))
        return triangle_of(stack), -logarithm


def log_likelihood(triangle: Array, deviations: Array) -> float:
    """Return the log likelihood of rows [R z], shape (m, n + 1), without the constant, of an x of zero mean.

    Parameters
    ----------
    deviations : shape (n,), of x, independent
    """
    logarithm: float = _log_likelihood(triangle, deviations)
    return logarithm


def triangle_of(rows: Array) -> Array:
    """Return the triangular factor R of rows, Rᵀ R = rowsᵀ rows, over the last two dimensions."""
    return np.asarray(np.linalg.qr(rows, mode="r"))


@compiled
def _log_likelihood(triangle: Array, deviations: Array) -> float:
    m, n = triangle.shape[0], deviations.size
    # In units of the deviations, so that none is divided by.
    stack = np.zeros((m + n, n + 1))
    for i in range(m):
        for j in range(n):
            stack[n + i, j] = triangle[i, j] * deviations[j]
        stack[n + i, n] = triangle[i, n]
    for i in range(n):
        stack[i, i] = 1.0
    triangularise(stack, n + 1, np.empty(n + 1))
    logarithm = -0.5 * stack[n, n] ** 2
    for i in range(n):
        logarithm -= math.log(abs(stack[i, i]))
    return float(logarithm)


@compiled
def _eliminate(fronts: Array, shares: Array, rows: Array) -> float:
    """Eliminate the scalars; return the logarithm of their determinant.

    Parameters
    ----------
    fronts : shape (K, r, r + n + 1), rows [s c z]
    shares : shape (K − 1,)
    rows : shape (K, r, n + 1), where what is left of the rows goes
    """
    count, r, width = fronts.shape
    known, step = np.zeros((2 * r, width)), np.zeros((2 * r, r + width))
    dots = np.empty(r + width)
    logarithm, walks = 0.0, False
    for k in range(count):
        if k > 0 and shares[k - 1] > 0.0:
            # Rows [s_k s_k+1 c z]: what is known of s_k, and how far it steps.
            step[:] = 0.0
            for i in range(r):
                if walks:
                    for j in range(r):
                        step[i, j] = known[i, j]
                    for j in range(r, width):
                        step[i, r + j] = known[i, j]
                    step[r + i, i] = -1.0 / shares[k - 1]
                step[r + i, r + i] = 1.0 / shares[k - 1]
                logarithm += math.log(shares[k - 1])
            if walks:
                triangularise(step, r, dots)
                for i in range(r):
                    logarithm += math.log(abs(step[i, i]))
            for i in range(r):
                for j in range(width):
                    known[i, j] = step[r + i, r + j]
            walks = True
        for i in range(r):
            for j in range(width):
                known[r + i, j] = fronts[k, i, j]
        if walks:
            triangularise(known, r, dots)
        for i in range(r):
            for j in range(r, width):
                rows[k, i, j - r] = known[r + i, j]
    for i in range(r if walks else 0):
        logarithm += math.log(abs(known[i, i]))
    return logarithm
