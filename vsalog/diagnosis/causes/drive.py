"""What a drive that is commanded a position may do unlike the rig: the motion that it plans to its command."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from vsalog.core.significance import FALSE_ALARM
from vsalog.diagnosis.causes.base import (
    Cause,
    Parameter,
    Setting,
    Site,
    commanded,
    moved_motors,
    position_of,
    starts_of,
    with_part,
)
from vsalog.effects.base import Exactness


class _Limit(Cause):
    """A limit of the motion that a drive plans; `key` of the drive, on the derivative of the position of this order."""

    key = ""
    unit = ""
    derivative = 0
    exact = Exactness.CORNERED
    reference = "trapezoidal profiles of positioning drives"
    signature = "motor equation: r − θ while the command outruns the drive"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one where the drive's torque follows from what it is commanded."""
        if "motor" not in moved_motors(setting) or not commanded(setting):
            return
        limit = getattr(setting.joint.drive, self.key)
        if limit is not None:
            parameter = Parameter("limit", self.unit, limit, 0.02 * limit, 1e-3 * limit, key=self.key, scale=limit)
            yield Site(self.name, "drive", (parameter,), self._limited)
            return
        moved = np.abs(setting.roles[position_of(setting, "motor")][self.derivative])
        reached = float(np.nanquantile(moved, 1.0 - FALSE_ALARM))
        if not reached > 0.0:
            return
        # A limit that is not there is infinite: its inverse is nothing. What is reached may be noise in part, or overshoot.
        inverse = 1.0 / reached
        starts = tuple(inverse * 2.0**k for k in range(4))
        parameter = Parameter(
            "inverse", f"1/({self.unit})", 0.0, 0.1 * inverse, 0.0, starts=starts, key=self.key, scale=inverse
        )
        yield Site(self.name, "drive", (parameter,), self._limited_by_inverse, starts_of((parameter,)), self._reported)

    def _limited(self, joint: Any, values: Sequence[float]) -> Any:
        return with_part(joint, "drive", **{self.key: float(values[0])})

    def _limited_by_inverse(self, joint: Any, values: Sequence[float]) -> Any:
        return with_part(joint, "drive", **{self.key: 1.0 / float(values[0]) if values[0] > 0.0 else None})

    def _reported(self, values: Sequence[float]) -> dict[str, tuple[float, str]]:
        return {"limit": (1.0 / float(values[0]) if values[0] > 0.0 else float("inf"), self.unit)}


class DriveAccelerationLimit(_Limit):
    """A drive that does not accelerate faster."""

    name = "drive.acceleration_limit"
    key, unit, derivative = "acceleration_limit", "rad/s^2", 2
    title = "The drive plans its motion: it accelerates no faster than a limit of its own"
    says = "the motor equation is off while the command asks for more acceleration than the drive plans"
    confirm = "Read the drive's register of its acceleration, raise it, and record the fast motion again."


class DriveSpeedLimit(_Limit):
    """A drive that does not move faster."""

    name = "drive.speed_limit"
    key, unit, derivative = "speed_limit", "rad/s", 1
    title = "The drive plans its motion: it moves no faster than a limit of its own"
    says = "the motor equation is off while the command is faster than the drive plans"
    confirm = "Read the drive's register of its speed, raise it, and record the fast motion again."
