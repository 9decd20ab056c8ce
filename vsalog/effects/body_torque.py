"""A torque on a motor or a link: what an effect states of it in one place, for the plant, the equations and the estimators."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from vsalog.core.quantities import Base

Array = NDArray[np.float64]


class BodyTorque(Base, frozen=True):
    """A torque on a motor or a link that follows from its position, its velocity and the time: a table of the rig.

    The simulation adds it to what moves the body, the equations of a diagnosis have it as a term, and estimators subtract it
    from a motor's torque. A subclass has the table's keys, each with a default with which nothing acts, unless a part may have
    several of them.
    """

    @staticmethod
    def formula(x: Any, v: Any, t: Any, p: Array, at: int) -> Any:
        """Return the torque [N·m]; of numbers in the compiled plant, of arrays elsewhere.

        Parameters
        ----------
        x, v : position [rad] and velocity [rad/s], as the joint feels them
        t : time from the start [s]
        p, at : where `numbers` begin
        """
        raise NotImplementedError

    def numbers(self, ratio: float) -> tuple[float, ...]:
        """Return what `formula` takes, behind a gear of that ratio, of a table as the joint feels it."""
        raise NotImplementedError

    def slopes(self, ratio: float) -> tuple[float, float]:
        """Return the largest slope over position [N·m/rad] and over velocity [N·m·s/rad], for the step of a simulation."""
        raise NotImplementedError

    def geared(self, ratio: float) -> Self:
        """Return it as it is felt behind a gear of that ratio; one below 1 leads back."""
        return self


def body_torque(torques: Sequence[BodyTorque], ratio: float, x: Array, v: Array, time: Array) -> Array:
    """Return the sum of torques on a body [N·m], shape (N,).

    Parameters
    ----------
    torques : as the joint feels them
    ratio : of the gear that they are behind; 1 for a link
    x, v, time : shape (N,) [rad], [rad/s], [s]
    """
    total = np.zeros_like(x)
    for torque in torques:
        total += torque.formula(x, v, time, np.array(torque.numbers(ratio)), 0)
    return total
