"""Is anything wrong with a rig at all: one p-value, before any cause is named.

Were the rig right, the score of the causes' unknowns would be a sum of independent contributions of the blocks of a log, each as
likely with the one sign as with the other. So flipping their signs draws the score's own distribution, whatever the noise is and
however it is coloured (Hemerik, Goeman and Finos 2020, JRSS B 82(3), sign-flipping score contributions).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from vsalog.core.precision import ROUNDING
from vsalog.core.significance import DRAWS
from vsalog.diagnosis.linear import Linear, corrected
from vsalog.residuals.system import System

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Integers = NDArray[np.int64]


def p_value(linear: Linear, system: System, chosen: Flags, blocks: Integers, seed: int = 0) -> float:
    """Return the probability of a log that contradicts the rig at least as much, were the rig right.

    Parameters
    ----------
    linear : the equations about the rig
    system : whose weights are used
    chosen : shape (p,), the unknowns whose scores are looked at
    blocks : shape (R,), the block of each row
    seed : of the signs, and of what filters leave
    """
    m = len(system.names)
    of = np.repeat(blocks, m)
    count = int(blocks[-1]) + 1 if blocks.size else 0
    rng = np.random.default_rng(seed)
    # Filters are exact to a part of the torques only: so much is drawn and added, so that it does not speak against the rig.
    blur = rng.standard_normal(linear.residual.shape) * np.sqrt(np.diag(system.exact)) * (system.weights > 0.0)
    normal = corrected(replace(linear, residual=linear.residual + blur), system, chosen)
    J, made = normal.columns, normal.gradients
    parts = np.stack([made[of == b].sum(axis=0) for b in range(count)])
    # In units of the prior's deviations: what is expected to be large counts for more.
    lower = np.linalg.cholesky(J.T @ J + np.eye(J.shape[1]))
    seen = np.linalg.solve(lower, parts.T).T
    signs = rng.choice([-1.0, 1.0], (DRAWS - 1, count))
    found = float(np.sum(seen.sum(axis=0) ** 2))
    flipped = np.sum((signs @ seen) ** 2, axis=1)
    # The same signs drawn once more add up to the same but for rounding.
    return float((1 + np.count_nonzero(flipped >= found * (1.0 - ROUNDING))) / DRAWS)
