"""What the causes may know of a joint and its log before anything is fitted."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.balance import motion_of
from vsalog.diagnosis.causes.base import Setting
from vsalog.diagnosis.sensing import true_roles
from vsalog.diagnosis.system import System
from vsalog.rig.schema import PneumaticJoint

Array = NDArray[np.float64]


def setting_of(joint: Any, system: System) -> Setting:
    """Look at a joint and its log as the rig has them."""
    channels = system.channels
    roles = true_roles(joint, channels, system.hold)
    deflections: Mapping[str, Array] = {}
    torques: Mapping[str, Array] = {}
    if not isinstance(joint, PneumaticJoint):
        motion = motion_of(joint, roles, channels.time, channels.spread)
        deflections, torques = {s: phi[0] for s, phi in motion.deflections.items()}, motion.torques
    duration = float(channels.time[-1] - channels.time[0])
    return Setting(joint, roles, channels.period, duration, deflections, torques, system.names)
