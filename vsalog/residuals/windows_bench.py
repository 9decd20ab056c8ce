"""Transmissions of which only the motion of the ends is known: the measured deflection in, the torque sensor out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import SimulationError
from vsalog.residuals.balance import motion_of
from vsalog.residuals.channels import Channels
from vsalog.residuals.sensing import true_roles
from vsalog.residuals.windows_mechanical import FREE

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class BenchPlayer:
    """Simulates the transmissions of a joint on their measured deflections; see `windows.Player`.

    Nothing has a beginning that could be fitted: loops follow the deflection through the whole log, as in the equations.

    Parameters
    ----------
    joint : of the rig
    channels : of the log

    Raises
    ------
    SimulationError
        No deflection is recorded whose torque is measured too.
    """

    window, settling = FREE.window, 0.0

    def __init__(self, joint: Any, channels: Channels) -> None:
        self.joint, self.channels, self.model = joint, channels, joint
        motion = motion_of(joint, true_roles(joint, channels), channels.time, channels.spread)
        self.deflections = {s: phi for s, phi in motion.deflections.items() if s not in motion.measured}
        self.torques = {s: motion.torques[s] for s in self.deflections}
        if not self.answered():
            raise SimulationError("no deflection is recorded whose torque a sensor measures")

    def driving(self) -> list[str]:
        """Return nothing: no torque drives the motion."""
        return []

    def followed(self) -> list[str]:
        """Return the sensors that determine the deflections, and the set-point."""
        kinds = ("deflection", "link_position", "motor_position", "setpoint")
        return [r for r in self.channels.roles if r.startswith(kinds)]

    def answered(self) -> list[str]:
        """Return the recorded torque sensors of these transmissions, and that of both together."""
        whole = ["torque_sensor"] if len(self.torques) == 2 else []
        return [r for r in (*(f"torque_sensor{s}" for s in self.torques), *whole) if r in self.channels.roles]

    def moving(self) -> list[str]:
        """Return nothing: all of it moves as it was measured."""
        return []

    def measured_states(self) -> Array:
        """Return the deflections, shape (N, n): all states of a window's beginning."""
        return np.stack([phi[0] for phi in self.deflections.values()], axis=-1)

    def free(self, states: Array) -> Mapping[int, tuple[float, Flags]]:
        """Return nothing: the measured deflection prescribes all."""
        return {}

    def after(self, truth: Mapping[str, Array], sample: int) -> Array:
        """Return that nothing is known of it."""
        return np.full(len(self.deflections), np.nan)

    def simulated(
        self, spans: NDArray[np.int64], states: Array, hold: bool
    ) -> Iterator[tuple[slice, Mapping[str, Array]]]:
        """Yield the windows' torques, one by one."""
        total = np.add(*self.torques.values()) if len(self.torques) == 2 else None
        for first, last in spans:
            part = slice(int(first), int(last))
            truth = {f"transmission_torque{s}": torque[part] for s, torque in self.torques.items()}
            yield part, truth if total is None else truth | {"transmission_torque_total": total[part]}
