"""What the causes may know of a joint and its log before anything is fitted."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.causes.base import Setting
from vsalog.residuals.kinds import motion_for
from vsalog.residuals.sensing import true_roles
from vsalog.residuals.system import System

Array = NDArray[np.float64]


def setting_of(joint: Any, system: System, fitted: Mapping[str, str] = MappingProxyType({})) -> Setting:
    """Look at a joint and its log as the rig has them; the springs of some transmissions were fitted to the log."""
    channels = system.channels
    roles = true_roles(joint, channels, system.hold)
    motion = motion_for(joint, roles, channels.time, channels.spread)
    deflections = {s: phi[0] for s, phi in motion.deflections.items()}
    duration = float(channels.time[-1] - channels.time[0])
    return Setting(joint, roles, channels.period, duration, deflections, motion.torques, system.names, fitted)
