"""The Kalman filter and the Rauch–Tung–Striebel smoother of a random walk, in square-root (array) form.

Of x_{k+1} = x_k + w_k and z_k = H_k x_k + e_k.

Covariances are P = Uᵀ U with U upper triangular, and every step is a triangularisation by orthogonal rotations, so that they stay
symmetric and positive (Kailath, Sayed, Hassibi, *Linear Estimation*, 2000, §12; smoother: Park and Kailath, "New square-root
smoothing algorithms", IEEE Trans. Automatic Control 41(5), 1996, in the form with Joseph's symmetric update).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.core.compiled import compiled
from vsalog.core.precision import ROUNDING

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Smoothed(NamedTuple):
    """Estimates of a state at K instants, each from all measurements, and from those up to it.

    Attributes
    ----------
    mean, root : shapes (K, n) and (K, n, n), upper triangular U with P = Uᵀ U, of all measurements
    filtered_mean, filtered_root : of the measurements up to each instant
    before : shape (K, n, n), roots of the measurements before each instant
    log_likelihood : of the measurements, without the constants −½ log 2π
    """

    mean: Array
    root: Array
    filtered_mean: Array
    filtered_root: Array
    before: Array
    log_likelihood: float


def smooth(measurements: Array, steps: Array, start_mean: Array, start_root: Array, backward: bool = True) -> Smoothed:
    """Filter forward and, if asked for, smooth backward.

    Parameters
    ----------
    measurements : shape (K, m, n + 1), rows [H z] with independent noise of variance one; rows of zeros measure nothing
    steps : shape (K − 1, r, n), rows W of the random walk: w_k = Wᵀ u with u of variance one, cov(w_k) = Wᵀ W
    start_mean, start_root : shapes (n,) and (n, n), of the state at the first instant before its measurement
    backward : whether to smooth; else `mean` and `root` are those of the filter
    """
    count, n = measurements.shape[0], start_mean.size
    mean, root = np.empty((count, n)), np.empty((count, n, n))
    before = np.empty((count, n, n))
    moving = np.asarray(steps.any(axis=(1, 2)), dtype=np.bool_)
    likelihood = _forward(measurements, steps, moving, start_mean.copy(), start_root.copy(), mean, root, before)
    if not backward:
        return Smoothed(mean, root, mean, root, before, likelihood)
    smoothed_mean, smoothed_root = mean.copy(), root.copy()
    _backward(steps, moving, mean, root, before, smoothed_mean, smoothed_root)
    return Smoothed(smoothed_mean, smoothed_root, mean, root, before, likelihood)


@compiled
def triangularise(A: Array, columns: int, dots: Array) -> None:
    """Make the first columns of A, shape (rows, width), upper triangular in place by Householder reflections.

    Loops go along rows, which are contiguous; `dots` is scratch, shape (width,).
    """
    rows, width = A.shape
    for j in range(min(columns, rows)):
        norm = 0.0
        for i in range(j, rows):
            norm += A[i, j] * A[i, j]
        norm = math.sqrt(norm)
        if norm == 0.0:
            continue
        head = A[j, j]
        alpha = -norm if head > 0.0 else norm
        beta = norm * (norm + abs(head))  # half of the squared length of the reflection's vector
        A[j, j] = head - alpha
        for c in range(j + 1, width):
            dots[c] = 0.0
        for i in range(j, rows):
            own = A[i, j]
            if own != 0.0:
                for c in range(j + 1, width):
                    dots[c] += own * A[i, c]
        for i in range(j, rows):
            own = A[i, j] / beta
            if own != 0.0:
                for c in range(j + 1, width):
                    A[i, c] -= own * dots[c]
            A[i, j] = 0.0
        A[j, j] = alpha


@compiled
def _copy(source: Array, target: Array, row: int) -> None:
    """Copy as many rows of one matrix as fit into another, from a row of the other on."""
    for i in range(min(source.shape[0], target.shape[0] - row)):
        for j in range(target.shape[1]):
            target[row + i, j] = source[i, j]


@compiled
def _forward(
    measurements: Array, steps: Array, moving: Flags, x: Array, U: Array, mean: Array, root: Array, before: Array
) -> float:
    """Filter from x and U, which are overwritten."""
    count, m, n = measurements.shape[0], measurements.shape[1], x.size
    r = steps.shape[1]
    walk, array, dots = np.empty((n + r, n)), np.empty((m + n, m + n)), np.empty(m + n)
    innovation = np.empty(m)
    likelihood = 0.0
    for k in range(count):
        if k > 0 and moving[k - 1]:
            _copy(U, walk, 0)
            _copy(steps[k - 1], walk, n)
            triangularise(walk, n, dots)
            _copy(walk, U, 0)
        _copy(U, before[k], 0)
        # [1 0; U Hᵀ U] → [E K; 0 U⁺]: E of the innovations' covariance Eᵀ E, K of the gain Kᵀ E⁻ᵀ.
        for i in range(m):
            innovation[i] = measurements[k, i, n]
            for j in range(n):
                innovation[i] -= measurements[k, i, j] * x[j]
            for j in range(m + n):
                array[i, j] = 1.0 if i == j else 0.0
        for i in range(n):
            for j in range(m):
                total = 0.0
                for h in range(i, n):
                    total += U[i, h] * measurements[k, j, h]
                array[m + i, j] = total
            for j in range(n):
                array[m + i, m + j] = U[i, j]
        triangularise(array, m + n, dots)
        for i in range(m):
            for h in range(i):
                innovation[i] -= array[h, i] * innovation[h]
            innovation[i] /= array[i, i]
            likelihood -= 0.5 * innovation[i] * innovation[i] + math.log(abs(array[i, i]))
            for j in range(n):
                x[j] += array[i, m + j] * innovation[i]
        for i in range(n):
            mean[k, i] = x[i]
            for j in range(n):
                U[i, j] = array[m + i, m + j]
                root[k, i, j] = U[i, j]
    return likelihood


@compiled
def _backward(
    steps: Array, moving: Flags, mean: Array, root: Array, before: Array, smoothed_mean: Array, smoothed_root: Array
) -> None:
    count, n = mean.shape
    r = steps.shape[1]
    C, stack, change, dots = np.empty((n, n)), np.empty((2 * n + r, n)), np.empty(n), np.empty(n)
    pivots = np.empty(n)
    for k in range(count - 2, -1, -1):
        if not moving[k]:
            for j in range(n):
                smoothed_mean[k, j] = smoothed_mean[k + 1, j]
            _copy(smoothed_root[k + 1], smoothed_root[k], 0)
            continue
        # C = P (P⁻)⁻¹, row by row: Cᵀ solves U⁻ᵀ U⁻ Cᵀ = P.
        U, V = root[k], before[k + 1]
        # What other unknowns determine exactly adds nothing.
        for j in range(n):
            norm = 0.0
            for h in range(j + 1):
                norm += V[h, j] * V[h, j]
            pivots[j] = V[j, j] if abs(V[j, j]) > ROUNDING * math.sqrt(norm) else np.inf
        for i in range(n):
            for j in range(n):
                total = 0.0
                for h in range(min(i, j) + 1):
                    total += U[h, i] * U[h, j]
                C[i, j] = total
        for i in range(n):
            for j in range(n):
                for h in range(j):
                    C[i, j] -= V[h, j] * C[i, h]
                C[i, j] /= pivots[j]
            for j in range(n - 1, -1, -1):
                for h in range(j + 1, n):
                    C[i, j] -= V[j, h] * C[i, h]
                C[i, j] /= pivots[j]
        for j in range(n):
            change[j] = smoothed_mean[k + 1, j] - mean[k, j]
        for i in range(n):
            for j in range(n):
                smoothed_mean[k, i] += C[i, j] * change[j]
        # P_s = (1 − C) P (1 − C)ᵀ + C (Wᵀ W + P_s⁺) Cᵀ
        for i in range(n):
            for j in range(n):
                own, after = U[i, j], 0.0
                for h in range(n):
                    own -= U[i, h] * C[j, h]
                    after += smoothed_root[k + 1, i, h] * C[j, h]
                stack[i, j], stack[n + r + i, j] = own, after
        for i in range(r):
            for j in range(n):
                total = 0.0
                for h in range(n):
                    total += steps[k, i, h] * C[j, h]
                stack[n + i, j] = total
        triangularise(stack, n, dots)
        _copy(stack, smoothed_root[k], 0)
