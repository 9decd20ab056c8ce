"""How long the steps of classical Runge–Kutta may be."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Largest change in one step; the defaults keep its error far below 1e-6, with a margin for springs that harden.

    Attributes
    ----------
    angle : by which a vibration may turn [rad]
    decay : part by which damping or filling may settle: rate · step
    """

    angle: float = 0.02
    decay: float = 0.3


FINE = Accuracy()
COARSE = Accuracy(angle=0.2, decay=0.6)
"""For simulations that are compared with noisy measurements: a step misses less than 1e-5."""
