"""Joints with pneumatic muscles, simulated in windows: the valves' voltages in, angle, pressures and torque out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.constants import bar

from vsalog.core.errors import SimulationError
from vsalog.core.significance import DETECTED
from vsalog.filters.savitzky_golay import savgol_weights
from vsalog.residuals.balance_pneumatic import ANGLE, PRESSURES, pneumatic_motion
from vsalog.residuals.channels import DEGREE, Channels
from vsalog.residuals.sensing import VALVES, true_roles
from vsalog.residuals.windows_mechanical import FREE, NUDGES, acting
from vsalog.rig.schema import PneumaticJoint
from vsalog.simulation.accuracy import COARSE
from vsalog.simulation.inputs import TorqueInput, table
from vsalog.simulation.pneumatic import needed_steps, simulate_pneumatic

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Pressures of a window's states are in bar, so that all states are of about one size; these are nudged too.
PNEUMATIC_NUDGES = (*NUDGES, 1e-4, 1e-4)
SIMULATED = (ANGLE, "torque_sensor", *PRESSURES)


class PneumaticPlayer:
    """Simulates a joint with muscles; the states are (ψ, ψ̇, P₁, P₂) with pressures in bar. See `windows.Player`.

    Parameters
    ----------
    joint : of the rig
    channels : of the log

    Raises
    ------
    SimulationError
        The voltage of a valve is not recorded: nothing drives its muscle.
    """

    window, settling = FREE.window, 0.0

    def __init__(self, joint: PneumaticJoint, channels: Channels) -> None:
        for role in VALVES:
            if role not in channels.raw:
                raise SimulationError(f"the voltage of {role} is not recorded, so that nothing drives its muscle")
        self.joint, self.channels, self.model = joint, channels, joint
        self.roles = true_roles(joint, channels, 0.0)

    def driving(self) -> list[str]:
        """Return the valves' roles."""
        return list(VALVES)

    def followed(self) -> list[str]:
        """Return nothing: no motion is prescribed."""
        return []

    def answered(self) -> list[str]:
        """Return the recorded angle, pressures and torque meter."""
        return [r for r in self.channels.roles if r in SIMULATED]

    def moving(self) -> list[str]:
        """Return the link."""
        return ["link"]

    def measured_states(self) -> Array:
        """Return the states as rig and filter have them, shape (N, 4); a velocity that may be noise is zero."""
        channels = self.channels
        motion = pneumatic_motion(self.joint, self.roles, channels.time, channels.spread)
        for role in (ANGLE, *PRESSURES):
            if role not in motion.roles:
                raise SimulationError(f"{role} is not recorded, and cannot be determined")
        psi, (p1, p2) = motion.roles[ANGLE], (motion.roles[r][0] / bar for r in PRESSURES)
        noise = channels.noise[ANGLE].floor if ANGLE in channels.noise else 0.0
        own = noise * float(np.linalg.norm(savgol_weights(channels.window, DEGREE, 2, channels.period)[1]))
        # One that has no sign begins at rest.
        rate = np.where(np.abs(psi[1]) <= DETECTED * own, 0.0, psi[1])
        return np.stack([psi[0], np.where(np.isfinite(psi[1]), rate, np.nan), p1, p2], axis=-1)

    def free(self, states: Array) -> Mapping[int, tuple[float, Flags]]:
        """Return all states, but for the angle of a seesaw that is clamped, and the velocity of one that rests."""
        every = np.ones(len(states), dtype=np.bool_)
        free = {i: (PNEUMATIC_NUDGES[i], every) for i in range(4)}
        if self.joint.friction is not None:
            free[1] = NUDGES[1], states[:, 1] != 0.0
        if self.joint.seesaw.held_at is not None:
            del free[0], free[1]
        return free

    def after(self, truth: Mapping[str, Array], sample: int) -> Array:
        """Return that nothing is known of it."""
        return np.full(4, np.nan)

    def simulated(
        self, spans: NDArray[np.int64], states: Array, hold: bool
    ) -> Iterator[tuple[slice, Mapping[str, Array]]]:
        """Yield the windows' truth, one by one."""
        channels = self.channels
        for (first, last), state in zip(spans, states, strict=True):
            part = slice(int(first), int(last))
            time = channels.time[first] + np.arange(last - first) * channels.period
            inputs: dict[str, TorqueInput] = {}
            for role in VALVES:
                voltage = self.roles[role][0][part]
                inputs[role] = acting(voltage, time, channels, int(first), hold)
            if "external_torque" in self.roles:
                inputs["external_torque"] = table(time, self.roles["external_torque"][0][part])
            begin = state * np.array([1.0, 1.0, bar, bar])
            steps = needed_steps(self.joint, begin, channels.period, COARSE)
            yield part, simulate_pneumatic(self.joint, inputs, time, steps, begin)
