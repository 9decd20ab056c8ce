"""Where a fit may begin: at the numbers with which a joint's equations hold for the recorded motion.

With recorded positions and torques the equations are linear in inertias, damping, dry friction and the stiffness of a linear
spring, so that their fit has one optimum, and needs no simulation. Noise of derivatives biases it: it only begins another fit.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from msgspec import structs
from numpy.typing import NDArray
from scipy.optimize import least_squares

from vsalog.checks.fault import RULE
from vsalog.identification.unknowns import Unknown, as_felt, felt
from vsalog.residuals.channels import Channels
from vsalog.residuals.kinds import balance_for
from vsalog.residuals.sensing import is_commanded, motors_of, torque_role
from vsalog.residuals.system import build_system

Array = NDArray[np.float64]


class Equations(NamedTuple):
    """How a joint's equations fit its channels.

    Attributes
    ----------
    values : of the unknowns, with which they fit best, shape (p,)
    squares : sum of squares that is left, over the noise
    """

    values: Array
    squares: float


def by_equations(joint: Any, unknowns: Sequence[Unknown], channels: Channels) -> Equations | None:
    """Fit a joint's equations to its channels; none where it has no equation.

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
        return np.concatenate([system.whitened(felt(joint, unknowns, values)).ravel(), values])

    def jacobian(values: Array) -> Array:
        here, steps = residual(values), [u.step(float(v)) for u, v in zip(unknowns, values, strict=True)]
        there = [residual(values + h * own) for h, own in zip(steps, np.eye(values.size), strict=True)]
        return np.stack([(t - here) / h for t, h in zip(there, steps, strict=True)], axis=-1)

    # Numbers may begin at a bound, from where an interior method makes no progress.
    found = least_squares(residual, np.clip(0.0, low, high), jacobian, (low, high), "dogbox", x_scale="jac")
    return Equations(np.asarray(found.x), 2.0 * float(found.cost))


def turned_signs(joint: Any, unknowns: Sequence[Unknown], channels: Channels) -> Iterator[tuple[str, float]]:
    """Yield the motors' torques with which the equations fit far better if their sign is reversed, and the part of squares left.

    A joint that its drive's command moves has none: a torque recorded of it is not used.

    Parameters
    ----------
    joint, unknowns, channels : as of `by_equations`
    """
    if is_commanded(joint, channels.raw):
        return
    as_recorded = by_equations(joint, unknowns, channels)
    for name in motors_of(joint):
        if as_recorded is None or torque_role(name) not in channels.roles:
            continue
        motor = getattr(joint, name)
        turned = structs.replace(joint, **{name: structs.replace(motor, torque_gain=-motor.torque_gain)})
        other = by_equations(turned, unknowns, channels)
        if other is not None and other.squares < RULE.left * as_recorded.squares:
            yield torque_role(name), other.squares / as_recorded.squares
