"""What acts on a link beside its inertia, its damping and the torques that are measured: dry friction, a constant torque.

Each follows something else than q̈ and q̇ do, and bends both where nobody knows of it: Coulomb friction, which has the sign of
q̇, looks like damping. So the link's equation is solved with these among its regressors too, averaged over half windows much as in
`left_over.py`. What is surely there is a finding with its size, and what it moves I and N by is doubt in them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding

Array = NDArray[np.float64]

# Averages without which nothing is found; how sure a size has to be, in its standard deviations; what counts of I and N.
AVERAGES, SURE, MOVED = 40, 5.0, 0.01


@dataclass(frozen=True, slots=True)
class Beside:
    """What else acts.

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
                limit=MOVED,
                evidence={
                    "friction": self.friction,
                    "torque": self.torque,
                    "inertia_change": inertia,
                    "damping_change": damping,
                },
            )
        ]


NOTHING = Beside(np.full(2, np.nan), np.zeros(2))


def what_else_acts(torque: Array, velocity: Array, acceleration: Array, window: int) -> Beside:
    """Look for what acts on a link.

    Parameters
    ----------
    torque : shape (N,), what is known to act [N·m]; all behind one filter
    velocity, acceleration : shape (N,), of the link
    window : samples of that filter
    """
    columns = np.column_stack((acceleration, velocity, np.sign(velocity), np.ones_like(torque), torque))
    box = max(window // 2, 1)
    whole = columns[: len(columns) // box * box].reshape(-1, box, columns.shape[1])
    averages = whole[np.isfinite(whole).all(axis=(1, 2))].mean(axis=1)
    if len(averages) < AVERAGES:
        return NOTHING
    known, target = averages[:, :-1], averages[:, -1]
    size = np.sqrt((known**2).mean(axis=0))
    plain = np.linalg.lstsq(known[:, :2], target, rcond=None)[0]
    nothing = Beside(plain, np.zeros(2))
    if not (size > 0.0).all():
        return nothing
    inverse = np.linalg.pinv((known / size).T @ (known / size))
    every = inverse @ ((known / size).T @ target)
    left = float(np.sum((target - known / size @ every) ** 2)) / (len(averages) - every.size)
    sure = np.abs(every) > SURE * np.sqrt(np.maximum(left * np.diagonal(inverse), 0.0))
    every /= size
    there = [bool(sure[2] and every[2] > 0.0), bool(sure[3])]
    kept = [0, 1, *(i + 2 for i in range(2) if there[i])]
    found = np.linalg.lstsq(known[:, kept], target, rcond=None)[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = np.abs(plain / found[:2] - 1.0)
    moved = np.where(np.isfinite(moved), moved, np.inf)
    if not any(there) or moved.max() < MOVED:
        return nothing
    return Beside(plain, moved, float(every[2]) if there[0] else 0.0, -float(every[3]) if there[1] else 0.0)
