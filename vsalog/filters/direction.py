"""Loading or unloading: which way a deflection goes, found without a derivative."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def direction_start() -> Array:
    """Return the state before the first sample, shape (2,): the last extreme [rad] and the direction (±1, 0 unknown)."""
    return np.array([np.nan, 0.0])


def loading_block(state: Array, phi: Array, band: float) -> tuple[Array, Flags]:
    """Return for each sample whether the deflection is moving away from zero.

    The direction turns when the deflection has come back from its last extreme by more than `band` (a play operator), so that
    noise at a standstill does not turn it.

    Parameters
    ----------
    state : of `direction_start` or a previous call
    phi : shape (n,), deflection [rad]; NaN keeps the direction
    band : [rad]

    Returns
    -------
    state, and shape (n,): loading; also true while the direction is not known yet
    """
    new, out = state.copy(), np.empty(phi.shape[0], dtype=np.bool_)
    _run(phi, band, new, out)
    return new, out


@njit(cache=True)
def _run(phi: Array, band: float, state: Array, out: Flags) -> None:
    extreme, direction = state[0], state[1]
    for k in range(phi.shape[0]):
        x = phi[k]
        if np.isnan(extreme):
            extreme = x
        if direction * (x - extreme) > 0.0:
            extreme = x
        elif abs(x - extreme) > band:
            direction = 1.0 if x > extreme else -1.0
            extreme = x
        out[k] = direction == 0.0 or direction * x > 0.0
    state[0], state[1] = extreme, direction
