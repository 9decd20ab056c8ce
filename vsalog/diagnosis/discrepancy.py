"""Model error: the residual that no cause of the catalogue takes away, and its part in the weights.

On a real machine the remainder is far above the sensors' noise and coloured (Kennedy and O'Hagan 2001, JRSS B 63(3)). It is
predicted block by block from a fit of everything to the other blocks. Its covariance joins the noise's, never below it, and
correlated rows count for as many as there are independent ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsalog.core.correlation import correlation_time
from vsalog.diagnosis.linear import Linear, corrected
from vsalog.estimators.equation import NEGLIGIBLE_SHARE
from vsalog.residuals.system import System, whitener

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Weights:
    """A system whose weights are those of noise and model error together.

    Attributes
    ----------
    system : with the covariance of both; correlated rows count for as many as there are independent ones
    inflation : shape (m, m), that covariance with the noise's as the unit
    times : shape (m,), rows that count as one
    """

    system: System
    inflation: Array
    times: Array

    def deviance(self, formed: Array) -> float:
        """Return Σ rᵀ C⁻¹ r of a joint's equations, with the noise as that joint has it; see `linear.formed_of`.

        The noise of an equation depends on the numbers in it, and a fit must not gain by making it small (the sensors'
        true values are profiled out: Fuller 1987, §3.2).
        """
        system, rows = self.system, formed[0]
        used = (system.weights > 0.0).astype(np.float64)
        both = used.T @ used
        added = formed[1:] - rows
        noise = np.einsum("kri,krj->ij", added, added) / len(added)
        covariance = np.where(both > 0.0, noise / np.maximum(both, 1.0), system.covariance)
        covariance += NEGLIGIBLE_SHARE**2 * system.exact
        if not np.isfinite(covariance).all():
            return np.inf
        factor = factor_of(covariance)
        covariance = factor @ self.inflation @ factor.T
        total = 0.0
        for pattern in system.whiteners:
            own = system.pattern == pattern
            white = rows[own] @ whitener(covariance, pattern).T
            total += float(np.sum(white**2 / self.times))
        return total


def left_out(linear: Linear, system: System, chosen: Flags, blocks: Integers) -> Array:
    """Return the averaged equations of each block as predicted by a fit of some unknowns to the other blocks, shape (R, m).

    Parameters
    ----------
    linear : model
    system : whose weights the fits take
    chosen : shape (p,), the unknowns
    blocks : shape (R,), the block of each row
    """
    found = corrected(linear, system, chosen)
    of = np.repeat(blocks, len(system.names))
    J, b = found.columns @ found.calibration, found.gradients @ found.calibration
    own = [of == k for k in range(int(blocks[-1]) + 1)]
    A, g = np.stack([J[o].T @ J[o] for o in own]), np.stack([b[o].sum(axis=0) for o in own])
    whole, pull = A.sum(axis=0) + np.eye(J.shape[1]), g.sum(axis=0)
    out = np.empty_like(linear.residual)
    for k in range(len(own)):
        delta = np.linalg.solve(whole - A[k], pull - g[k])
        out[blocks == k] = linear.residual[blocks == k] + linear.columns[blocks == k][:, :, chosen] @ delta
    return np.asarray(np.where(system.weights > 0.0, out, 0.0))


def weighted_by(system: System, rows: Array) -> Weights:
    """Return the weights of a system's noise together with the excess of some rows over it.

    Parameters
    ----------
    system : with the noise's own covariance
    rows : shape (R, m), residuals of the averaged equations, 0 where they are not used
    """
    used = (system.weights > 0.0).astype(np.float64)
    both = used.T @ used
    found = np.where(both > 0.0, rows.T @ rows / np.maximum(both, 1.0), system.covariance)
    unit = factor_of(system.covariance)
    values, vectors = np.linalg.eigh(_in_units_of(unit, found))
    covariance = unit @ ((vectors * np.maximum(values, 1.0)) @ vectors.T) @ unit.T
    weighted = replace(system, covariance=covariance, whiteners={p: whitener(covariance, p) for p in system.whiteners})
    times = np.array([correlation_time(column) for column in weighted.white(rows).T])
    tempered = {p: w / np.sqrt(times)[:, None] for p, w in weighted.whiteners.items()}
    bare = factor_of(system.covariance - (1.0 - NEGLIGIBLE_SHARE**2) * system.exact)
    return Weights(replace(weighted, whiteners=tempered), _in_units_of(bare, covariance), times)


def factor_of(covariance: Array) -> Array:
    """Return L of a covariance L Lᵀ; directions of no variance are given a millionth of the others'."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(scale[:, None] * np.linalg.cholesky((vectors * np.maximum(values, 1e-6)) @ vectors.T))


def _in_units_of(factor: Array, covariance: Array) -> Array:
    inside = np.linalg.solve(factor, np.linalg.solve(factor, covariance).T)
    return np.asarray(0.5 * (inside + inside.T))
