"""Springs in series with dry friction, driven by a deflection: in parallel they make a loop of any shape (Maxwell slip).

They begin to slip at once (Prandtl and Ishlinskii), or smoothly (Dahl 1968). An element's torque is its stiffness times the
deflection of its spring.

Dahl, "A solid friction model", The Aerospace Corporation, TOR-0158(3107-18), 1968.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from vsalog.core.compiled import compiled

Array = NDArray[np.float64]


@compiled
def slip_deflections(phi: Array, slips: Array, smooth: bool) -> Array:
    """Return the deflections of elements' springs, shape (n, N), which are 0 at first.

    Parameters
    ----------
    phi : shape (N,), all finite
    slips : shape (n,), deflections after which they slip
    smooth : whether they begin to do so smoothly
    """
    out = np.zeros((slips.size, phi.size))
    for i in range(slips.size):
        slip, strain = slips[i], 0.0
        for k in range(1, phi.size):
            change = phi[k] - phi[k - 1]
            if smooth:
                # The solution of dz = (1 − z sign(dφ) / slip) dφ for a deflection that does not turn in between.
                end = slip if change > 0.0 else -slip
                strain = end - (end - strain) * math.exp(-abs(change) / slip)
            else:
                strain = min(slip, max(-slip, strain + change))
            out[i, k] = strain
    return out
