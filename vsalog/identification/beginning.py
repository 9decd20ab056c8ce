"""Where a fit may begin: at the numbers with which a joint's equations hold for the recorded motion.

With recorded positions and torques the equations are linear in inertias, damping, dry friction and the stiffness of a linear
spring, so that their fit has one optimum, and needs no simulation. Noise of derivatives biases it: it only begins another fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from vsalog.identification.unknowns import Unknown, as_felt, placed
from vsalog.residuals.channels import Channels
from vsalog.residuals.kinds import balance_for
from vsalog.residuals.system import build_system

Array = NDArray[np.float64]


def by_equations(joint: Any, unknowns: Sequence[Unknown], channels: Channels) -> Array | None:
    """Return the values with which a joint's equations fit its channels best, shape (p,); none where it has no equation.

    Parameters
    ----------
    joint : of the rig, as it is written
    unknowns : p of them, whose prior counts as one observation each
    channels : of the log
    """
    system = build_system(as_felt(joint), channels.thinned(), balance_for(joint), 0.5 * channels.period)
    if not system.count or not unknowns:
        return None
    low, high = np.array([u.bounds for u in unknowns]).T

    def residual(values: Array) -> Array:
        return np.concatenate([system.whitened(as_felt(placed(joint, unknowns, values))).ravel(), values])

    def jacobian(values: Array) -> Array:
        here, steps = residual(values), [u.step(float(v)) for u, v in zip(unknowns, values, strict=True)]
        there = [residual(values + h * own) for h, own in zip(steps, np.eye(values.size), strict=True)]
        return np.stack([(t - here) / h for t, h in zip(there, steps, strict=True)], axis=-1)

    # Numbers may begin at a bound, from where an interior method makes no progress.
    return np.asarray(
        least_squares(residual, np.clip(0.0, low, high), jacobian, (low, high), "dogbox", x_scale="jac").x
    )
