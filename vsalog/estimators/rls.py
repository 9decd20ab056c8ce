"""Recursive least squares: eq. 23 of Flacco 2012, and the enhanced form of eq. 39–41 (after Bittanti et al. 1990).

With a(k) = (c + c ρ)/(1 + c ρ) the enhanced update is the same as weighting every sample with the constant c: by the matrix
inversion lemma P(k)⁻¹ = P(k−1)⁻¹ + c F Fᵀ. So its estimate is that of plain RLS with P(0) replaced by c P(0), which is why
the paper finds that only the product p(0)·c matters, and the closed form is ridge regression:
α̂ = (Σ F Fᵀ + (c P(0))⁻¹)⁻¹ (Σ F y + (c P(0))⁻¹ α(0)).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vsalog.core.compiled import compiled

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class RlsState:
    """Coefficients α, shape (n,), and covariance factor P, shape (n, n)."""

    __slots__ = ("P", "alpha")

    def __init__(self, alpha: Array, P: Array) -> None:
        self.alpha, self.P = alpha, P

    @classmethod
    def start(cls, size: int, p0: float = 1e6, alpha: Array | None = None) -> RlsState:
        """Begin with α(0) (zero when None) and P(0) = p0 I."""
        return cls(np.zeros(size) if alpha is None else alpha.copy(), np.eye(size) * p0)

    def copy(self) -> RlsState:
        """Return an independent copy."""
        return RlsState(self.alpha.copy(), self.P.copy())


def rls_block(
    state: RlsState, F: Array, y: Array, use: Flags, E: Array, spread: Flags, c: float, p0: float
) -> tuple[RlsState, Array, Array, Array, Array, Array, Array]:
    """Update with a block of samples and evaluate linear functionals of the coefficients after each.

    Parameters
    ----------
    state : before the block
    F : shape (N, n), regressors
    y : shape (N,), what they shall add up to
    use : shape (N,), samples to use; the others leave the state as it is
    E : shape (N, q, n), functionals to evaluate
    spread : shape (q,), which of them need a variance
    c : of eq. 40–41; c = 1 is plain RLS (eq. 23)
    p0 : of P(0) = p0 I

    Returns
    -------
    state
    values : shape (N, q), E α̂
    directions : shape (N, m, n), c P E of the m functionals whose variance is asked for: what the noise is multiplied by
    pulled : shape (N, m), how far the prior may have pulled them to zero
    coefficients : shape (N, n)
    left : shape (N,), recursive residuals, which have the noise's variance; NaN where no sample was used
    factor : shape (N,), stability factor a(k)
    """
    new = state.copy()
    count, q, n = E.shape
    asked = np.flatnonzero(spread)
    values, directions, pulled = np.empty((count, q)), np.empty((count, asked.size, n)), np.empty((count, asked.size))
    coefficients, left, factor = np.empty((count, n)), np.full(count, np.nan), np.full(count, np.nan)
    work = np.empty((2, n))
    _run(F, y, use, E, asked, c, p0, new.alpha, new.P, work, values, directions, pulled, coefficients, left, factor)
    return new, values, directions, pulled, coefficients, left, factor


@compiled
def _run(
    F: Array, y: Array, use: Flags, E: Array, asked: NDArray[np.int64], c: float, p0: float, alpha: Array, P: Array, work: Array,
    values: Array, directions: Array, pulled: Array, coefficients: Array, left: Array, factor: Array,
) -> None:  # fmt: skip
    """Update in place (eq. 23, 39, 41), and evaluate.

    One pass over P writes it and multiplies it by what comes next: the regressors of the following sample, and the functionals of
    this one. The pass before the first sample only multiplies.
    """
    count, q, n = E.shape
    g, following = work[0], work[1]  # P F of this sample and of the following one
    for k in range(-1, count):
        used = k >= 0 and use[k]
        gain, step = 0.0, 0.0
        if used:
            rho, error = 0.0, y[k]
            for i in range(n):
                rho += F[k, i] * g[i]
                error -= F[k, i] * alpha[i]
            gain = c / (1.0 + c * rho)  # a / (1 + ρ)
            step = gain * error
            factor[k] = gain * (1.0 + rho)
            left[k] = error / math.sqrt(1.0 + c * rho)
        for i in range(n):
            g[i] = g[i] if used else 0.0
            following[i] = 0.0
        row = min(k + 1, count - 1)
        for i in range(n):
            h, f = g[i], F[row, i]
            alpha[i] += step * h
            # The product g_i g_j comes first: it is the same bits as g_j g_i, so P stays symmetric to the last one. Whole rows
            # are cheaper than one triangle and its mirror image, whose scattered writes no compiler can join.
            for j in range(n):
                P[i, j] -= gain * (h * g[j])
                following[j] += P[i, j] * f
        for i in range(n):
            g[i] = following[i]
        if k < 0:
            continue
        for s in range(q):
            value = 0.0
            for i in range(n):
                value += E[k, s, i] * alpha[i]
            values[k, s] = value
        for i in range(n):
            coefficients[k, i] = alpha[i]
        for m in range(asked.size):
            for j in range(n):
                directions[k, m, j] = 0.0
            for i in range(n):
                e = c * E[k, asked[m], i]
                for j in range(n):
                    directions[k, m, j] += P[i, j] * e
            pull = 0.0
            for i in range(n):
                pull += directions[k, m, i] * alpha[i]
            pulled[k, m] = pull / (c * p0)
