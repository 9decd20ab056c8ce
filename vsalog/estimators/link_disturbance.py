"""What disturbs a link's equation of inertia, damping and measured torques: dry friction, a constant torque.

Neither is proportional to q̈ or q̇, and each biases both where it is not known: Coulomb friction, which has the sign of
q̇, looks like damping. So the link's equation is solved with these among its regressors too, averaged over half windows
(`row_moments.py`). What predicts the torque in blocks that it was not fitted to is a finding with its size, and its change of I
and N is doubt in them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.core.dependence import association, least_squares
from vsalog.core.finding import Finding
from vsalog.core.significance import FALSE_ALARM
from vsalog.estimators.equation import NEGLIGIBLE_SHARE
from vsalog.estimators.row_moments import row_moments_block, row_moments_start
from vsalog.uncertainty.long_run import ENOUGH_BATCHES

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Disturbance:
    """Torques on the link that its equation lacks.

    Attributes
    ----------
    plain : shape (2,), I [kg·m²] and N [N·m·s/rad] of least squares; NaN where there is too little
    moved : shape (2,), parts of I and N by which these change with what was found; 0 where nothing was
    friction, torque : dry friction, and a constant torque [N·m]; 0 where it was not found
    """

    plain: Array
    moved: Array
    friction: float = 0.0
    torque: float = 0.0

    def findings(self, joint: str) -> list[Finding]:
        """Return a finding with what acts, none where nothing does."""
        if not self.moved.any():
            return []
        inertia, damping = (float(x) for x in self.moved)
        return [
            Finding(
                code="link.other_torque",
                joint=joint,
                value=max(inertia, damping),
                limit=NEGLIGIBLE_SHARE,
                evidence={
                    "friction": self.friction,
                    "torque": self.torque,
                    "inertia_change": inertia,
                    "damping_change": damping,
                },
            )
        ]


NOTHING = Disturbance(np.full(2, np.nan), np.zeros(2))


def disturbance_of(torque: Array, velocity: Array, acceleration: Array, window: int) -> Disturbance:
    """Look for what acts on a link.

    Parameters
    ----------
    torque : shape (N,), the known torques [N·m]; all behind one filter
    velocity, acceleration : shape (N,), of the link
    window : samples of that filter
    """
    columns = np.column_stack((acceleration, velocity, np.sign(velocity), np.ones_like(torque), torque))
    starts = np.zeros(torque.size, dtype=np.bool_)
    rows = row_moments_block(row_moments_start(5), columns, ~starts, starts, max(window // 2, 1))
    if rows.rows < ENOUGH_BATCHES:
        return NOTHING
    whole = rows.blocks.sum(axis=0)
    plain, nothing = least_squares(whole, [0, 1]), Disturbance(least_squares(whole, [0, 1]), np.zeros(2))
    there = [False, False]
    for i in range(2):
        shape = association(rows.blocks, [2 + i], [0, 1, 3 - i])
        there[i] = shape is not None and 2 * shape.p_value <= FALSE_ALARM and (i == 1 or shape.coefficients[0] > 0.0)
    kept = [0, 1, *(i + 2 for i in range(2) if there[i])]
    found = least_squares(whole, kept)
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = np.abs(plain / found[:2] - 1.0)
    moved = np.where(np.isfinite(moved), moved, np.inf)
    if not any(there) or moved.max() < NEGLIGIBLE_SHARE:
        return nothing
    acts = dict(zip(kept, found, strict=True))
    return Disturbance(plain, moved, float(acts.get(2, 0.0)), -float(acts.get(3, 0.0)))
