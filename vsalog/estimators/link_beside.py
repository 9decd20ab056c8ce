"""What acts on a link beside its inertia, its damping and the torques that are measured: dry friction, a constant torque.

Each follows something else than q̈ and q̇ do, and bends both where nobody knows of it: Coulomb friction, which has the sign of
q̇, looks like damping. So the link's equation is solved with these among its regressors too, averaged over half windows much as in
`left_over.py`. What is surely there is told with its size, and what it moves I and N by is doubt in them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.estimators.equation import SUPPORTED_SHARE

Array = NDArray[np.float64]

# Averages without which nothing is said; how sure a size has to be, in its standard deviations; what counts of I and N.
AVERAGES, SURE, MOVED = 40, 5.0, 0.01


@dataclass(frozen=True, slots=True)
class Beside:
    """What else acts.

    Attributes
    ----------
    plain : shape (2,), I [kg·m²] and N [N·m·s/rad] of least squares; NaN where there is too little
    found : in words, with its size
    moved : shape (2,), parts of I and N by which these change with it; 0 where nothing is found
    """

    plain: Array
    found: tuple[str, ...]
    moved: Array

    def said(self, joint: str) -> tuple[str, ...]:
        """Say what was found."""
        if not self.found:
            return ()
        return (
            f"joint '{joint}': the link moves as if {' and '.join(self.found)} acted on it too, of which neither rig nor torque"
            f" sensor says anything; with that its inertia would change by {self.moved[0]:.0%}, its damping by"
            f" {self.moved[1]:.0%}: so much is added to their deviations, and what changes by {SUPPORTED_SHARE:.0%} is left out",
        )


NOTHING = Beside(np.full(2, np.nan), (), np.zeros(2))


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
    nothing = Beside(plain, (), np.zeros(2))
    if not (size > 0.0).all():
        return nothing
    inverse = np.linalg.pinv((known / size).T @ (known / size))
    every = inverse @ ((known / size).T @ target)
    left = float(np.sum((target - known / size @ every) ** 2)) / (len(averages) - every.size)
    sure = np.abs(every) > SURE * np.sqrt(np.maximum(left * np.diagonal(inverse), 0.0))
    every /= size
    words = (f"dry friction of {every[2]:.2g} N·m", f"a torque of {-every[3]:.2g} N·m")
    there = [bool(sure[2] and every[2] > 0.0), bool(sure[3])]
    kept = [0, 1, *(i + 2 for i in range(2) if there[i])]
    found = np.linalg.lstsq(known[:, kept], target, rcond=None)[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        moved = np.abs(plain / found[:2] - 1.0)
    moved = np.where(np.isfinite(moved), moved, np.inf)
    if not any(there) or moved.max() < MOVED:
        return nothing
    return Beside(plain, tuple(w for w, t in zip(words, there, strict=True) if t), moved)
