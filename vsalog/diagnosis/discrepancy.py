"""What a joint's equations leave over whatever the catalogue's causes are: model error, and its part in the weights.

On a real machine the remainder is far above the sensors' noise and coloured (Kennedy and O'Hagan 2001, JRSS B 63(3)). It is
predicted block by block from a fit of everything to the other blocks. Its covariance joins the noise's, never below it, and
correlated rows count for as many as there are independent ones.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.linear import Linear, whitened_columns
from vsalog.diagnosis.system import System, whitener

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]

# The noise that is measured on copies may be so many times the variance of the true one: a coarse encoder at rest may chatter in
# the copy and not in the log.
OVERSTATED = 1.0


def left_out(linear: Linear, system: System, chosen: Flags, blocks: Integers) -> Array:
    """Return the averaged equations of each block as predicted by a fit of some unknowns to the other blocks, shape (R, m).

    Parameters
    ----------
    linear : model
    system : whose weights the fits take
    chosen : shape (p,), the unknowns
    blocks : shape (R,), the block of each row
    """
    m = len(system.names)
    J, r = whitened_columns(linear.columns, system)[:, chosen], system.white(linear.residual).ravel()
    of = np.repeat(blocks, m)
    count = int(blocks[-1]) + 1
    A = np.stack([J[of == b].T @ J[of == b] for b in range(count)])
    g = np.stack([J[of == b].T @ r[of == b] for b in range(count)])
    whole, pull = A.sum(axis=0) + np.eye(J.shape[1]), g.sum(axis=0)
    out = np.empty_like(linear.residual)
    for b in range(count):
        delta = -np.linalg.solve(whole - A[b], pull - g[b])
        own = blocks == b
        out[own] = linear.residual[own] + linear.columns[own][:, :, chosen] @ delta
    return np.asarray(np.where(system.weights > 0.0, out, 0.0))


def weighted_by(system: System, rows: Array) -> System:
    """Return a system whose weights are those of its noise together with the excess of some rows over it.

    Parameters
    ----------
    system : with the noise's own covariance
    rows : shape (R, m), what is left over of the averaged equations, 0 where they are not used
    """
    noise = system.covariance
    used = system.weights > 0.0
    both = used.astype(np.float64).T @ used
    found = np.where(both > 0.0, rows.T @ rows / np.maximum(both, 1.0), noise)
    scale = np.linalg.cholesky(noise + 1e-12 * np.diag(np.diag(noise)))
    excess = np.linalg.solve(scale, np.linalg.solve(scale, found).T)
    values, vectors = np.linalg.eigh(0.5 * (excess + excess.T))
    inside = (vectors * np.maximum(values, OVERSTATED)) @ vectors.T
    covariance = scale @ inside @ scale.T
    weighted = replace(system, covariance=covariance, whiteners={p: whitener(covariance, p) for p in system.whiteners})
    times = np.array([correlation_time(column) for column in weighted.white(rows).T])
    tempered = {p: w / np.sqrt(times)[:, None] for p, w in weighted.whiteners.items()}
    return replace(weighted, whiteners=tempered, temper=times)


def correlation_time(x: Array) -> float:
    """Return how many rows count as one: 1 + 2 Σ ρ, over the initial positive pairs (Geyer 1992, Statistical Science 7(4)), ≥ 1."""
    n = x.size
    if n < 8 or not np.any(x):
        return 1.0
    spectrum = np.abs(np.fft.rfft(x, 2 * n)) ** 2
    rho = np.fft.irfft(spectrum)[: n // 4]
    rho = rho / rho[0]
    pairs = rho[1 : 1 + 2 * ((rho.size - 1) // 2)].reshape(-1, 2).sum(axis=1)
    ends = np.flatnonzero(pairs <= 0.0)
    total = float(pairs[: ends[0] if ends.size else pairs.size].sum())
    return max(1.0 + 2.0 * total, 1.0)
