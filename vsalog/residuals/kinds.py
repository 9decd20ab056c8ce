"""The parts of a diagnosis that depend on the kind of joint: the equations, and how the motion is reconstructed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.joint import offered_roles
from vsalog.residuals.balance import Motion, balance, motion_of
from vsalog.residuals.balance_pneumatic import balance_pneumatic, pneumatic_motion
from vsalog.residuals.balance_rigid import balance_rigid, rigid_motion
from vsalog.residuals.sensing import motors_of
from vsalog.residuals.system import Balance
from vsalog.rig.schema import PneumaticJoint, RigidJoint

Array = NDArray[np.float64]


def balance_for(joint: Any) -> Balance:
    """Return the function that forms the equations of a joint of this kind."""
    if isinstance(joint, RigidJoint):
        return balance_rigid
    return balance_pneumatic if isinstance(joint, PneumaticJoint) else balance


def motion_for(joint: Any, roles: Mapping[str, Array], time: Array, spread: Mapping[str, float]) -> Motion:
    """Return the motion of a joint of any kind; parameters as `balance.balance`."""
    if isinstance(joint, RigidJoint):
        return rigid_motion(joint, roles, time, spread)
    motion = pneumatic_motion if isinstance(joint, PneumaticJoint) else motion_of
    return motion(joint, roles, time, spread)


def equations_of(joint: Any) -> frozenset[str]:
    """Return the equations that a joint of this kind has: of its motors or muscles, its link and its torque sensors."""
    sensed = any(role.startswith("torque_sensor") for role in offered_roles(joint))
    if isinstance(joint, PneumaticJoint):
        return frozenset({"pressure_1", "pressure_2", "seesaw"})
    if isinstance(joint, RigidJoint):
        return frozenset({"motor", "link"} if sensed else {"motor"})
    return frozenset({*motors_of(joint), "link", *({"transmission"} if sensed else ())})
