"""Recursive least squares by Givens rotations: QR-RLS, Flacco 2014 eq. 18–23.

Rather than a covariance, the triangular factor R of the weighted data is kept, which stays well conditioned where excitation is
poor. The first unknown may be a nuisance parameter that belongs to one run of samples (an integration constant): at the
start of a new run the first row of R is dropped, which is exactly the marginalisation of that parameter, because every
other row of a triangular R is free of it.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class QrState:
    """Triangular factor with the data vector as last column: [R p], shape (n, n + 1)."""

    __slots__ = ("Rp",)

    def __init__(self, Rp: Array) -> None:
        self.Rp = Rp

    @classmethod
    def start(cls, size: int, leading: int = 0, p0: float = np.inf) -> QrState:
        """Begin with no data at all (the first n samples then set up R, Flacco 2014 §IV), or with a prior.

        Parameters
        ----------
        size : n, number of unknowns
        leading : the first unknowns, which have no prior
        p0 : the other unknowns begin at zero with covariance p0 I, as in RLS; infinite for no prior
        """
        Rp = np.zeros((size, size + 1))
        for i in range(leading, size):
            Rp[i, i] = p0**-0.5
        return cls(Rp)

    def copy(self) -> QrState:
        """Return an independent copy."""
        return QrState(self.Rp.copy())

    def solve(self) -> Array:
        """ξ̂ = R⁻¹ p (eq. 20), shape (n,); NaN for what the data do not determine."""
        xi = np.empty(self.Rp.shape[0])
        qr_solve(self.Rp, xi)
        return xi


def qr_block(
    state: QrState,
    F: Array,
    y: Array,
    use: Flags,
    fresh: Flags,
    E: Array,
    spread: Flags,
    forgetting: float,
    leading: int = 0,
    p0: float = np.inf,
) -> tuple[QrState, Array, Array, Array, Array, Array]:
    """Update with a block of samples and evaluate linear functionals of the unknowns after each.

    Parameters
    ----------
    state : before the block
    F : shape (N, n), regressors
    y : shape (N,), what they shall add up to
    use : shape (N,), samples to learn from
    fresh : shape (N,), samples at which the first unknown begins again
    E : shape (N, q, n), functionals to evaluate
    spread : shape (q,), which of them need a variance
    forgetting : λ of eq. 21–22; R is multiplied by it, so a sample's squared error is discounted by λ² a step
    leading, p0 : as the state was started with

    Returns
    -------
    state
    values : shape (N, q), E ξ̂; NaN while undetermined, like all that follows
    directions : shape (N, m, n), (RᵀR)⁻¹ E of the m functionals whose variance is asked for: what the noise is multiplied by
    pulled : shape (N, m), how far the prior may have pulled them to zero
    unknowns : shape (N, n)
    left : shape (N,), recursive residuals, which have the noise's variance; NaN where no sample was used
    """
    new = state.copy()
    count, q, n = E.shape
    asked = int(np.count_nonzero(spread))
    values, directions, pulled = (
        np.empty((count, q)),
        np.full((count, asked, n), np.nan),
        np.full((count, asked), np.nan),
    )
    unknowns, left = np.empty((count, n)), np.full(count, np.nan)
    # With forgetting the prior is forgotten too.
    prior = 1.0 / p0 if forgetting == 1.0 else 0.0
    _run(F, y, use, fresh, E, spread, forgetting, leading, prior, new.Rp, values, directions, pulled, unknowns, left)
    return new, values, directions, pulled, unknowns, left


@njit(cache=True, error_model="numpy")
def qr_update(F: Array, y: float, forgetting: float, Rp: Array, row: Array) -> None:
    """Rotate one sample into [R p] in place (eq. 21–22); `row` is scratch, shape (n + 1,), its last is the recursive residual."""
    n = Rp.shape[0]
    for j in range(n):
        row[j] = F[j]
    row[n] = y
    for i in range(n):
        if forgetting != 1.0:
            for j in range(i, n + 1):
                Rp[i, j] *= forgetting
        x = row[i]
        if x == 0.0:
            continue
        r = Rp[i, i]
        h = np.sqrt(r * r + x * x)
        if h == 0.0:
            # A high power of a deflection at rest has a square that no floating-point number can be.
            continue
        cos, sin = r / h, x / h
        Rp[i, i] = h
        for j in range(i + 1, n + 1):
            a, b = Rp[i, j], row[j]
            Rp[i, j] = cos * a + sin * b
            row[j] = cos * b - sin * a


@njit(cache=True, error_model="numpy")
def qr_solve(Rp: Array, xi: Array) -> bool:
    """Back-substitute ξ = R⁻¹ p (eq. 23) in place; returns False and NaN where R is singular to working precision."""
    n = Rp.shape[0]
    known = True
    for i in range(n - 1, -1, -1):
        column = 0.0
        for j in range(i + 1):
            column = max(column, abs(Rp[j, i]))
        if abs(Rp[i, i]) <= 1e-15 * column:
            known = False
            break
        s = Rp[i, n]
        for j in range(i + 1, n):
            s -= Rp[i, j] * xi[j]
        xi[i] = s / Rp[i, i]
    if not known:
        for i in range(n):
            xi[i] = np.nan
    return known


@njit(cache=True, error_model="numpy")
def _forward(Rp: Array, inverse: Array, z: Array) -> None:
    """Solve Rᵀ x = z in place, given the reciprocals of R's diagonal; by rows of R, which are contiguous."""
    n = z.shape[0]
    for i in range(n):
        x = z[i]
        # Functionals of the stiffness have no part in the leading unknowns.
        if x == 0.0:
            continue
        x *= inverse[i]
        z[i] = x
        for j in range(i + 1, n):
            z[j] -= Rp[i, j] * x


@njit(cache=True, error_model="numpy")
def _backward(Rp: Array, inverse: Array, z: Array) -> None:
    """Solve R x = z in place, given the reciprocals of R's diagonal."""
    n = z.shape[0]
    for i in range(n - 1, -1, -1):
        x = z[i]
        for j in range(i + 1, n):
            x -= Rp[i, j] * z[j]
        z[i] = x * inverse[i]


@njit(cache=True, error_model="numpy")
def _run(
    F: Array,
    y: Array,
    use: Flags,
    fresh: Flags,
    E: Array,
    spread: Flags,
    forgetting: float,
    leading: int,
    prior: float,
    Rp: Array,
    values: Array,
    directions: Array,
    pulled: Array,
    unknowns: Array,
    left: Array,
) -> None:
    count, q, n = E.shape
    row, xi, z, inverse = np.empty(n + 1), np.empty(n), np.empty(n), np.empty(n)
    wide = np.any(spread)
    known = qr_solve(Rp, xi)
    for k in range(count):
        if use[k]:
            if fresh[k]:
                for j in range(n + 1):
                    Rp[0, j] = 0.0
            qr_update(F[k], y[k], forgetting, Rp, row)
            known = qr_solve(Rp, xi)
            if known:
                left[k] = row[n]
        if wide and known:
            for i in range(n):
                inverse[i] = 1.0 / Rp[i, i]
        m = 0
        for s in range(q):
            value = 0.0
            for i in range(n):
                value += E[k, s, i] * xi[i]
            values[k, s] = value
            if not spread[s]:
                continue
            if known:
                for i in range(n):
                    z[i] = E[k, s, i]
                _forward(Rp, inverse, z)
                _backward(Rp, inverse, z)
                pull = 0.0
                for i in range(n):
                    directions[k, m, i] = z[i]
                    pull += z[i] * xi[i] if i >= leading else 0.0
                pulled[k, m] = prior * pull
            m += 1
        for i in range(n):
            unknowns[k, i] = xi[i]
