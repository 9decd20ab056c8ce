"""Recursive least squares: eq. 23 of Flacco 2012, and the enhanced form of eq. 39–41 (after Bittanti et al. 1990).

With a(k) = (c + c ρ)/(1 + c ρ) the enhanced update is the same as weighting every sample with the constant c: by the matrix
inversion lemma P(k)⁻¹ = P(k−1)⁻¹ + c F Fᵀ. So its estimate is that of plain RLS with P(0) replaced by c P(0), which is why
the paper finds that only the product p(0)·c matters, and the closed form is ridge regression:
α̂ = (Σ F Fᵀ + (c P(0))⁻¹)⁻¹ (Σ F y + (c P(0))⁻¹ α(0)).
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

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
    use : shape (N,), samples to learn from; the others leave the state as it is
    E : shape (N, q, n), functionals to evaluate
    spread : shape (q,), which of them need a variance
    c : of eq. 40–41; c = 1 is plain RLS (eq. 23)
    p0 : of P(0) = p0 I

    Returns
    -------
    state
    values : shape (N, q), E α̂
    directions : shape (N, m, n), c P E of the m functionals whose variance is asked for: what the noise is multiplied by
    pulled : shape (N, m), what the prior may have pulled them to zero by
    coefficients : shape (N, n)
    left : shape (N,), recursive residuals, which have the noise's variance; NaN where nothing was learnt
    factor : shape (N,), stability factor a(k)
    """
    new = state.copy()
    count, q, n = E.shape
    asked = int(np.count_nonzero(spread))
    values, directions, pulled = np.empty((count, q)), np.empty((count, asked, n)), np.empty((count, asked))
    coefficients, left, factor = np.empty((count, n)), np.full(count, np.nan), np.full(count, np.nan)
    _run(F, y, use, E, spread, c, p0, new.alpha, new.P, values, directions, pulled, coefficients, left, factor)
    return new, values, directions, pulled, coefficients, left, factor


@njit(cache=True, error_model="numpy", forceinline=True)
def _times(P: Array, x: Array, out: Array) -> None:
    """P x of a symmetric P. Sums run in the same order for every n, whichever way they are computed."""
    n = x.shape[0]
    if n < 8:
        for i in range(n):
            s = 0.0
            for j in range(n):
                s += P[i, j] * x[j]
            out[i] = s
        return
    # A sum must not be reordered and cannot be vectorised, but many sums can go side by side: columns are rows here.
    for i in range(n):
        out[i] = 0.0
    whole = n - n % 4
    for j in range(0, whole, 4):
        a, b, c, d = x[j], x[j + 1], x[j + 2], x[j + 3]
        for i in range(n):
            out[i] = (((out[i] + P[j, i] * a) + P[j + 1, i] * b) + P[j + 2, i] * c) + P[j + 3, i] * d
    for j in range(whole, n):
        for i in range(n):
            out[i] += P[j, i] * x[j]


@njit(cache=True, error_model="numpy", forceinline=True)
def rls_update(
    F: Array, y: float, c: float, alpha: Array, P: Array, g: Array, following: Array, scratch: Array
) -> tuple[float, float, float]:
    """One enhanced RLS update in place (eq. 23, 39, 41). Returns ε, ρ, a.

    `g` holds P F on entry and P times the regressors of the `following` sample on return: the pass that writes P computes
    it, since a second pass would cost as much as the first. `scratch` has the same shape.
    """
    n = alpha.shape[0]
    rho, error = 0.0, y
    for i in range(n):
        rho += F[i] * g[i]
        error -= F[i] * alpha[i]
    gain = c / (1.0 + c * rho)  # a / (1 + ρ)
    step = gain * error
    for j in range(n):
        scratch[j] = 0.0
    for i in range(n):
        h, f = g[i], following[i]
        alpha[i] += step * h
        # The product g_i g_j comes first: it is the same bits as g_j g_i, so P stays symmetric to the last one. Whole rows
        # are cheaper than one triangle and its mirror image, whose scattered writes no compiler can join.
        for j in range(n):
            P[i, j] -= gain * (h * g[j])
            scratch[j] += P[i, j] * f
    for j in range(n):
        g[j] = scratch[j]
    return error, rho, gain * (1.0 + rho)


@njit(cache=True, error_model="numpy")
def _run(
    F: Array,
    y: Array,
    use: Flags,
    E: Array,
    spread: Flags,
    c: float,
    p0: float,
    alpha: Array,
    P: Array,
    values: Array,
    directions: Array,
    pulled: Array,
    coefficients: Array,
    left: Array,
    factor: Array,
) -> None:
    count, q, n = E.shape
    g, scratch, t = np.empty(n), np.empty(n), np.empty(n)
    known = False  # whether g is P F[k] already
    for k in range(count):
        if use[k]:
            if not known:
                _times(P, F[k], g)
            error, rho, a = rls_update(F[k], y[k], c, alpha, P, g, F[min(k + 1, count - 1)], scratch)
            factor[k] = a
            left[k] = error / np.sqrt(1.0 + c * rho)
        known = use[k]
        m = 0
        for s in range(q):
            value = 0.0
            for i in range(n):
                value += E[k, s, i] * alpha[i]
            values[k, s] = value
            if spread[s]:
                pull = 0.0
                _times(P, E[k, s], t)
                for i in range(n):
                    directions[k, m, i] = c * t[i]
                    pull += t[i] * alpha[i]
                pulled[k, m] = pull / p0
                m += 1
        for i in range(n):
            coefficients[k, i] = alpha[i]
