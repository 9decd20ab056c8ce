"""Joints whose motor and link move as one, simulated in windows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import SimulationError
from vsalog.residuals.balance_rigid import rigid_motion
from vsalog.residuals.channels import Channels
from vsalog.residuals.sensing import is_commanded, true_roles
from vsalog.residuals.windows_mechanical import NUDGES, MechanicalPlayer
from vsalog.simulation.inputs import Input, TorqueInput, sum_of, table

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

SIMULATED = ("motor_position", "link_position")


class RigidPlayer(MechanicalPlayer):
    """Simulates a rigid joint; the states are (q, q̇). See `windows.Player`.

    A link that the rig does not have is replaced by the torque sensor's reading.

    Parameters
    ----------
    joint : of the rig
    channels : of the log

    Raises
    ------
    SimulationError
        Neither the motor's torque nor a drive's command is recorded: nothing drives the joint.
    """

    def __init__(self, joint: Any, channels: Channels) -> None:
        if "motor_torque" not in channels.raw and not is_commanded(joint, channels.raw):
            raise SimulationError("the torque of the motor is not recorded, so that nothing drives the joint")
        super().__init__(joint, channels)

    def measured(self) -> tuple[tuple[str, ...], bool]:
        """Return that nothing moves as it was measured."""
        return (), False

    def followed(self) -> list[str]:
        """Return the torque sensor where it replaces the link."""
        return ["torque_sensor"] if self._pulled() else []

    def answered(self) -> list[str]:
        """Return the recorded positions."""
        return [r for r in self.channels.roles if r in SIMULATED]

    def moving(self) -> list[str]:
        """Return the part that has what resists the motion: motor and link are one body."""
        link = self.joint.link
        return ["motor"] if link is None or (link.damping == 0.0 and not link.friction.rubs) else ["link"]

    def measured_states(self) -> Array:
        """Return the states as rig and filter have them, shape (N, 2)."""
        channels = self.channels
        q = rigid_motion(self.joint, true_roles(self.joint, channels), channels.time, channels.spread).link
        if q is None:
            raise SimulationError("the position of the joint is not recorded, and cannot be determined")
        return np.stack([q[0], q[1]], axis=-1)

    def free(self, states: Array) -> Mapping[int, tuple[float, Flags]]:
        """Return both states, but for a joint that is commanded a position."""
        if self.commanded:
            return {}
        return {i: (NUDGES[i], np.ones(len(states), dtype=np.bool_)) for i in range(2)}

    def inputs(self, roles: Mapping[str, Array], part: slice, hold: bool) -> dict[str, Input]:
        """Return the motor's torque, and what else acts on the link."""
        given = super().inputs(roles, part, hold)
        if self._pulled():
            time = self.times(part)
            torque: TorqueInput = table(time, roles["torque_sensor"][0][part])
            external = given.get("external_torque")
            given["external_torque"] = torque if external is None else sum_of(external, torque)  # type: ignore[arg-type]
        return given

    def _pulled(self) -> bool:
        return self.joint.link is None and "torque_sensor" in self.channels.roles
