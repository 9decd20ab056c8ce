"""The link's equation of motion: the external torque less that of its motion is the torque of the transmissions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.estimators.equations import TorqueEquation
from vsalog.estimators.transmission_torque import Weight
from vsalog.filters.conditioning import Conditioned

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
State = tuple[tuple[Array, ...], Array]


class LinkRows(NamedTuple):
    """Rows of a link's equation, at each sample, or from each to the next by the trapezoidal rule.

    Attributes
    ----------
    F : shape (N, n), regressors of the coefficients
    motion : shape (N, 3), acceleration, velocity, and which way the link moves, −1 to 1
    moving : shape (N,), torque of the rig's link: inertia, damping and weight [N·m]
    torque : shape (N,), that of the transmissions [N·m]
    use : shape (N,), samples to learn from
    """

    F: Array
    motion: Array
    moving: Array
    torque: Array
    use: Flags


@dataclass(frozen=True, slots=True)
class LinkEquation:
    """F(φ, c) α = τ_ext − M q̈ − D_q q̇ − g(q) (Flacco 2012 eq. 3), of all transmissions together.

    Attributes
    ----------
    pushed : the equation of the torque that pushes the link
    inertia, damping, weight : of the link and its payload [kg·m², N·m·s/rad]
    period : [s]
    exact : whether the filter's acceleration is the derivative of its velocity
    """

    pushed: TorqueEquation
    inertia: float
    damping: float
    weight: Weight | None
    period: float
    exact: bool = False

    def start(self) -> State:
        """Return the states before the first sample: of the hysteresis, and that sample, which is none."""
        return self.pushed.start(), np.full((1, self.pushed.size + 5), np.nan)

    def rows(
        self, state: tuple[tuple[Array, ...], Array], block: Conditioned
    ) -> tuple[tuple[tuple[Array, ...], Array], LinkRows]:
        """Form the equation for a block."""
        own, rows = self.pushed.rows(state[0], block)
        q, velocity = block.fit["link_position"], block.fit["velocity:link_position"]
        weight = np.zeros_like(q) if self.weight is None else self.weight.of(q)
        columns = np.column_stack((velocity, q, np.sign(velocity), weight, rows.y, rows.F))
        seen = np.vstack((state[1], np.where(rows.use[:, None], columns, np.nan)))
        # Where rates are not exact, the change of speed and position, the mean of all else.
        change, mean = np.diff(seen[:, :2], axis=0) / self.period, 0.5 * (seen[1:] + seen[:-1])[:, 2:]
        if self.exact:
            change, mean = np.column_stack((block.fit["acceleration:link_position"], velocity)), seen[1:, 2:]
        moving = change @ np.array([self.inertia, self.damping]) + mean[:, 1]
        torque, F = mean[:, 2] - moving, mean[:, 3:]
        use = rows.use & np.isfinite(torque) & np.isfinite(F).all(axis=1)
        return (own, seen[-1:]), LinkRows(F, np.column_stack((change, mean[:, 0])), moving, torque, use)
