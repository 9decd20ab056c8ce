"""Square-root unscented Kalman filter: the factor of a covariance is carried, never the covariance.

The unscented filter of Julier and Uhlmann with the scaled points of Wan and van der Merwe (The unscented Kalman filter, in
Haykin, ed., Kalman Filtering and Neural Networks, 2001, §7.3); Shin, Ibayashi, Kogiso (2021) eq. 13–24 are its case α = 1,
β = 0, κ = 0. Wan and van der Merwe's own square-root form (§7.4) takes the measurement's share off by one downdate per output,
which loses digits where a measurement is much better than the prediction. Here, as in Arasaratnam and Haykin's cubature filter
(IEEE TAC 54, 2009), outputs and states are triangularised side by side, so that a filter whose weights are not negative
subtracts nothing at all:

    ( √w ΔY   √w ΔX )         ( Ryy  Ryx )
    (  S_Rᵀ      0  )  = Q ·  (  0   Rxx ),   x ← x + Ryxᵀ e,  Ryyᵀ e = z − ŷ,   S ← Rxxᵀ.

Points are drawn again between prediction and correction, as Shin's algorithm does: the correction then includes the process
noise. Print of Shin 2021: eq. 24 takes K Pyy Kᵀ off with a Pyy that already holds R (eq. 21), which is right, but K below it
adds R again; K is Pxy Pyy⁻¹ here. Their points' index of eq. 13–15 begins at 1.

A column of the factor may be zero: a state that is known exactly stays so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.stats import chi2

from vsalog.core.errors import FilterError

Array = NDArray[np.float64]

WATCHED = 100
"""Samples over which innovations outside the filter's band are counted."""


class Weight(IntEnum):
    """Layout of the weights that the compiled functions take."""

    SPREAD, MEAN, COVARIANCE, OTHER = range(4)


@dataclass(frozen=True, slots=True)
class UnscentedWeights:
    """Places and weights of sigma points.

    Attributes
    ----------
    size : n, number of states
    spread : √(n + λ), in standard deviations
    mean : W₀ of the mean, of the point in the middle
    covariance : W₀ of the covariance; where it is negative a covariance is a difference, and may fail to be one
    other : W_i of each of the 2 n points around it, of both
    """

    size: int
    spread: float
    mean: float
    covariance: float
    other: float

    @classmethod
    def scaled(cls, size: int, alpha: float = 1.0, beta: float = 0.0, kappa: float = 0.0) -> UnscentedWeights:
        """Return Wan and van der Merwe's weights, λ = α² (n + κ) − n, W₀ = λ/(n + λ), + 1 − α² + β for the covariance.

        With α = 1, β = 0 they are Shin 2021's, W₀ = κ/(n + κ) and W_i = 1/(2 (n + κ)). (Their eq. 17–22 leave it open whether
        1/2(n + κ) is that; only so do they sum to one.)

        Raises
        ------
        FilterError
            There are no states, or n + λ is not a positive number.
        """
        total = alpha * alpha * (size + kappa)
        if size < 1 or not (np.isfinite(total) and total > 0.0 and np.isfinite(beta)):
            raise FilterError(
                f"unscented filter: alpha² (n + kappa) has to be positive, not {total:g} with n = {size}, alpha = {alpha:g},"
                f" kappa = {kappa:g}"
            )
        mean = (total - size) / total
        return cls(size, float(np.sqrt(total)), mean, mean + 1.0 - alpha * alpha + beta, 0.5 / total)

    def packed(self) -> Array:
        """Return what the compiled functions take, shape (4,)."""
        return np.array([self.spread, self.mean, self.covariance, self.other])


class UnscentedTrace(NamedTuple):
    """A filter's estimates of N samples.

    Attributes
    ----------
    x : shape (N, n), states given the samples so far
    S : shape (N, n, n), lower factors of their covariances
    nis : shape (N,), innovation squared, normalised; NaN where nothing corrected
    diverged : shape (N,), whether most of the latest samples are outside the filter's band, or the state is not finite
    """

    x: Array
    S: Array
    nis: Array
    diverged: NDArray[np.bool_]


def workspace(size: int, outputs: int) -> tuple[Array, Array, Array, Array]:
    """Return the work arrays of `unscented_filter`'s functions, for n states and m outputs; they hold nothing between calls."""
    points, rows = 2 * size + 1, 2 * size + 1 + max(size, outputs)
    wide = np.zeros((max(size, outputs), points))
    return np.zeros((size, points)), wide, np.zeros((size + outputs, rows)), np.zeros(size + outputs)


@njit(cache=True, error_model="numpy")
def triangularise(A: Array, columns: int, rows: int) -> None:
    """Bring a tall matrix to triangular form by Householder reflections, in place.

    Its j-th *column* is A[j, :rows], so that columns lie in one piece. On return A[j, k], k ≤ j < columns, is the lower factor L
    with L Lᵀ = (matrix)ᵀ (matrix), its diagonal not negative; what is beyond the diagonal is the rest. A column's scale does not
    touch the accuracy of the others. Missing rows (rows < columns) count as zeros.
    """
    for k in range(min(columns, rows)):
        square = 0.0
        for i in range(k + 1, rows):
            square += A[k, i] * A[k, i]
        if square > 0.0:
            # Away from zero, so that nothing cancels.
            head = A[k, k]
            length = np.sqrt(square + head * head)
            end = -length if head > 0.0 else length
            first = head - end
            scale = 1.0 / (end * first)
            for j in range(k + 1, columns):
                s = A[j, k] * first
                for i in range(k + 1, rows):
                    s += A[j, i] * A[k, i]
                s *= scale
                A[j, k] += s * first
                for i in range(k + 1, rows):
                    A[j, i] += s * A[k, i]
            A[k, k] = end
        if A[k, k] < 0.0:
            for j in range(k, columns):
                A[j, k] = -A[j, k]
    for k in range(rows, columns):
        for j in range(k, columns):
            A[j, k] = 0.0


@njit(cache=True, error_model="numpy")
def downdate(A: Array, columns: int, d: Array) -> bool:
    """Take d dᵀ off L Lᵀ, in place; L is A[j, k], k ≤ j < columns. Returns False, L unchanged, where no factor would be left.

    By rotations as LINPACK's dchdd does (Stewart 1979); `d` is overwritten.
    """
    square = 0.0
    for i in range(columns):
        s = d[i]
        for k in range(i):
            s -= A[i, k] * d[k]
        if A[i, i] == 0.0:
            # A row without variance can only lose nothing.
            if s != 0.0:
                return False
            d[i] = 0.0
        else:
            d[i] = s / A[i, i]
        square += d[i] * d[i]
    if not square < 1.0:
        return False
    rest = np.sqrt(1.0 - square)
    # One column after the other, from the last, is rotated with a column that is zero at first and d at the end.
    for k in range(columns - 1, -1, -1):
        length = np.sqrt(rest * rest + d[k] * d[k])
        c, s = rest / length, d[k] / length
        d[k] = 0.0
        for i in range(k, columns):
            other = d[i]
            d[i] = c * other + s * A[i, k]
            A[i, k] = c * A[i, k] - s * other
        rest = length
    return True


@njit(cache=True, error_model="numpy", forceinline=True)
def _draw(x: Array, S: Array, spread: float, X: Array) -> None:
    """Write the sigma points into the columns of X: the middle, then for each column of S one to either side along it."""
    n = x.shape[0]
    for k in range(n):
        X[k, 0] = x[k]
        for j in range(n):
            # The factor is lower: the states before the j-th stay where they are, to the last bit.
            step = spread * S[k, j] if j <= k else 0.0
            X[k, 2 * j + 1], X[k, 2 * j + 2] = x[k] + step, x[k] - step


@njit(cache=True, error_model="numpy", forceinline=True)
def _average(Y: Array, k: int, first: int, weight: float) -> float:
    """Return the weighted mean of Y[k, first:].

    The weights sum to one: only differences to the first point are weighted, and a large negative W₀ cancels nothing.
    """
    s, begin = 0.0, Y[k, first]
    for i in range(first + 1, Y.shape[1]):
        s += Y[k, i] - begin
    return float(begin + weight * s)


def unscented_filter(
    transition: Callable[..., None], observation: Callable[..., None]
) -> tuple[Callable[..., bool], Callable[..., tuple[float, int, bool]]]:
    """Compile the two halves of a filter's step for a model; they allocate nothing and call no LAPACK.

    Parameters
    ----------
    transition : compiled function (X, first, u, p, Y) → None that writes the next state of each column X[:, i], i ≥ first, into
        Y[:n, i]; X has shape (n, 2 n + 1), `u` and `p` are what the model needs. All points at once, so that what they
        share is computed once; with a lower factor, points along a later state share the earlier ones, to the last bit
    observation : likewise for the outputs, into Y[:m, i]

    Returns
    -------
    predict : compiled function (x, S, u, p, weights, SQ, room) → whole
    correct : compiled function (x, S, z, u, p, weights, SR, room) → nis, used, whole

    Both change x, shape (n,), and S, shape (n, n), lower, S Sᵀ = P, in place. SQ and SR are lower factors of the process and
    the measurement noise, (n, n) and (m, m); `weights` is of `UnscentedWeights.packed`, `room` of `workspace`. z, shape (m,), may
    hold NaN: a missing output corrects nothing, and with none of them x and S stay as they are. `nis` is the innovation's
    square normalised by its expectation, νᵀ Pyy⁻¹ ν, which is χ² of `used` degrees of freedom where the model holds.
    `whole` is False where the negative W₀ would have left no covariance; the middle point's share is then left out, which is
    the larger covariance.

    Nothing is raised: a model that returns NaN makes the state NaN. The functions are made per model and not cached: a cached
    function that calls them has to find them among its module's globals (numba takes what a function closes over into the
    cache's key, and a compiled function has another each time), and to close over a stamp of the files.
    """

    # Inlined before numba counts references to arrays, which would cost as much as a third of a step.
    @njit(error_model="numpy", inline="always")
    def predict(
        x: Array, S: Array, u: Any, p: Any, weights: Array, SQ: Array, room: tuple[Array, Array, Array, Array]
    ) -> bool:
        X, Y, A, d = room
        n, spread, root, middle = (
            x.shape[0],
            weights[Weight.SPREAD],
            np.sqrt(weights[Weight.OTHER]),
            weights[Weight.COVARIANCE],
        )
        first = 1 if weights[Weight.MEAN] == 0.0 and middle == 0.0 else 0
        _draw(x, S, spread, X)
        transition(X, first, u, p, Y)
        share, rows = np.sqrt(abs(middle)), 3 * n
        for k in range(n):
            x[k] = _average(Y, k, first, weights[Weight.OTHER])
            for i in range(2 * n):
                A[k, i] = root * (Y[k, i + 1] - x[k])
            for i in range(n):
                A[k, 2 * n + i] = SQ[k, i]
            if middle != 0.0:
                d[k] = share * (Y[k, 0] - x[k])
                A[k, rows] = d[k]
        triangularise(A, n, rows + 1 if middle > 0.0 else rows)
        whole = downdate(A, n, d) if middle < 0.0 else True
        for j in range(n):
            for k in range(j + 1):
                S[j, k] = A[j, k]
        return whole

    @njit(error_model="numpy", inline="always")
    def correct(
        x: Array, S: Array, z: Array, u: Any, p: Any, weights: Array, SR: Array, room: tuple[Array, Array, Array, Array]
    ) -> tuple[float, int, bool]:
        X, Y, A, d = room
        n, m, spread, root, middle = (
            x.shape[0], z.shape[0], weights[Weight.SPREAD], np.sqrt(weights[Weight.OTHER]), weights[Weight.COVARIANCE],
        )  # fmt: skip
        used = 0
        for k in range(m):
            if not np.isnan(z[k]):
                used += 1
        if used == 0:
            return 0.0, 0, True
        first = 1 if weights[Weight.MEAN] == 0.0 and middle == 0.0 else 0
        _draw(x, S, spread, X)
        observation(X, first, u, p, Y)
        share, columns, rows, c = np.sqrt(abs(middle)), used + n, n + m, 0
        # Two opposite points as their difference and their sum: the states' own are symmetric, and their sums are zero. So
        # the even part of the outputs, and their noise, is brought to a triangle by itself first.
        half = root / np.sqrt(2.0)
        for k in range(m):
            if np.isnan(z[k]):
                continue
            mean = _average(Y, k, first, weights[Weight.OTHER])
            for j in range(n):
                up, down = Y[k, 2 * j + 1] - mean, Y[k, 2 * j + 2] - mean
                Y[k, 2 * j + 1] = half * (up - down)
                A[c, j] = half * (up + down)
            for i in range(m):
                A[c, n + i] = SR[k, i]
            if middle != 0.0:
                d[c] = share * (Y[k, 0] - mean)
                A[c, rows] = d[c]
            Y[k, 0] = z[k] - mean
            c += 1
        triangularise(A, used, rows + 1 if middle > 0.0 else rows)
        c = 0
        for k in range(m):
            if np.isnan(z[k]):
                continue
            for i in range(used):
                A[c, n + i] = A[c, i] if i <= c else 0.0
            for j in range(n):
                A[c, j] = Y[k, 2 * j + 1]
            c += 1
        for k in range(n):
            for j in range(n):
                # √(w/2) · 2 · spread · S = S
                A[used + k, j] = S[k, j]
            for i in range(used):
                A[used + k, n + i] = 0.0
            d[used + k] = 0.0
        triangularise(A, columns, columns)
        whole = downdate(A, columns, d) if middle < 0.0 else True
        nis, c = 0.0, 0
        for k in range(m):
            if np.isnan(z[k]):
                continue
            s = Y[k, 0]
            for i in range(c):
                s -= A[c, i] * d[i]
            # An output without any variance, neither of its own nor of the state's, has nothing to correct.
            d[c] = s / A[c, c] if A[c, c] > 0.0 else 0.0
            nis += d[c] * d[c]
            c += 1
        for k in range(n):
            for i in range(used):
                x[k] += A[used + k, i] * d[i]
            for j in range(k + 1):
                S[k, j] = A[used + k, used + j]
        return nis, used, whole

    return predict, correct


def surprise_limits(outputs: int) -> Array:
    """Return the χ² of 0, 1, … m outputs that one normal innovation in a thousand exceeds, shape (m + 1,)."""
    return np.array([0.0, *(float(chi2.isf(1e-3, k)) for k in range(1, outputs + 1))])


@njit(cache=True, error_model="numpy")
def keep(
    k: int, x: Array, S: Array, nis: float, used: int, limits: Array, surprise: Array, xs: Array, Ss: Array, squares: Array,
    diverged: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Write the filter's estimate of sample k into row k of `xs`, `Ss`, `squares` (left alone with no output used), `diverged`.

    surprise[0] is the share of samples beyond the `limits`, and changes; a state that is not finite has diverged, too.
    """
    if used > 0:
        squares[k] = nis
        surprise[0] += ((1.0 if nis > limits[used] else 0.0) - surprise[0]) / WATCHED
    # The majority: single outliers are not enough.
    lost = surprise[0] > 0.5
    for i in range(x.shape[0]):
        lost = lost or not np.isfinite(x[i])
        xs[k, i] = x[i]
        for j in range(x.shape[0]):
            Ss[k, i, j] = S[i, j]
    diverged[k] = lost
