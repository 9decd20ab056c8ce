"""What a motor's rotor and drive may have other than the rig says: inertia, cogging, torque constant, offset, delay."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vsalog.diagnosis.causes.base import (
    WAVY,
    Cause,
    Parameter,
    Remainder,
    Setting,
    Site,
    angle_of,
    link_equation,
    one_clock,
    one_field,
    position_of,
    with_part,
)
from vsalog.diagnosis.causes.motor_friction import moved_motors, scale_of
from vsalog.residuals.system import LATEST
from vsalog.rig.schema import Cogging

Array = NDArray[np.float64]

# Periods per turn of the rotor that are looked for, and how many of the best are tried.
ORDERS, TRIED = 72, 3


class MotorInertia(Cause):
    """Another inertia of the motor."""

    name = "motor.inertia"
    title = "The inertia of the {part} is not what the rig says"
    says = "its motor equation is off in proportion to the motor's acceleration"
    confirm = "Accelerate the motor with the link free, or taken off: the torque it needs is its inertia times the acceleration."
    reference = "Flacco 2012 eq. 4, B"
    signature = "motor equation: θ̈"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per motor."""
        for name in moved_motors(setting):
            if link_equation(setting) == "motor":
                continue  # the link's: what moves as one has one inertia
            inertia = getattr(setting.joint, name).inertia
            parameter = Parameter("inertia", "kg*m^2", inertia, 0.01 * inertia, 1e-3 * inertia)
            yield one_field(self.name, name, parameter, "inertia")


class MotorTorqueConstant(Cause):
    """A torque constant other than the rig's."""

    name = "motor.torque_constant"
    title = "The {part} makes another torque than is recorded of it: its torque constant is off"
    says = "its motor equation is off in proportion to the motor's torque"
    confirm = "Hold the link against a force gauge and command several torques: compare."
    reference = "Flacco 2012 eq. 4, τ"
    signature = "motor equation: τ"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per motor."""
        for name in moved_motors(setting):
            parameter = Parameter("gain", "1", getattr(setting.joint, name).torque_gain, 0.01, 0.05, 20.0)
            yield one_field(self.name, name, parameter, "torque_gain")


class MotorTorqueOffset(Cause):
    """A torque that acts when none is recorded."""

    name = "motor.torque_offset"
    title = "The {part} makes a torque when none is recorded: its drive has an offset"
    says = "its motor equation is off by a constant"
    confirm = "Command no torque and see on which side the joint comes to rest, or which torque holds it still."
    reference = "Flacco 2012 eq. 4, τ"
    signature = "motor equation: 1"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per motor."""
        for name in moved_motors(setting):
            torque, _ = scale_of(setting, name)
            parameter = Parameter("torque", "N*m", getattr(setting.joint, name).torque_offset, 1e-3 * torque)
            yield one_field(self.name, name, parameter, "torque_offset")


class MotorTorqueDelay(Cause):
    """A torque that acts later than its record says."""

    name = "motor.torque_delay"
    title = "The torque of the {part} acts later than it is recorded"
    says = "its motor equation is off in proportion to the rate of the motor's torque"
    confirm = "Command a step of torque and look at when the motor begins to accelerate."
    reference = "a drive's current loop and its bus"
    signature = "motor equation: dτ/dt"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per motor."""
        for name in () if one_clock(setting) else moved_motors(setting):
            start = getattr(setting.joint, name).torque_delay
            # Whether torques were held from sample to sample few logs tell: half a sample either way.
            blur = setting.period / 12.0**0.5
            parameter = Parameter("delay", "s", start, 0.25 * setting.period, 0.0, LATEST, blur=blur)
            yield one_field(self.name, name, parameter, "torque_delay")


class MotorCogging(Cause):
    """A torque that repeats over the rotor's turn."""

    name = "motor.cogging"
    exact = WAVY
    title = "A torque repeats over the turn of the {part}'s rotor (cogging, or a gear's teeth), and the rig does not have it"
    says = "its motor equation is off by a wave over the motor's position"
    confirm = "Let the motor turn slowly, at constant speed and without load: its torque repeats with the angle, not with time."
    reference = "Petrović, Ortega, Stanković, Tadmor (2000), IEEE Transactions on Power Electronics 15(5)"
    signature = "motor equation: sin(n θ), cos(n θ)"

    def sites(self, setting: Setting) -> Iterator[Site]:
        """Yield one per motor."""
        for name in moved_motors(setting):
            role = position_of(setting, name)
            if role not in setting.roles:
                continue
            torque, _ = scale_of(setting, name)
            ratio = getattr(setting.joint, name).gear_ratio
            theta = angle_of(setting.joint, setting.roles[role], name)
            span = float(np.nanmax(theta) - np.nanmin(theta)) * ratio or 1.0
            parameters = (
                Parameter("cosine", "N*m", 0.0, 1e-3 * torque),
                Parameter("sine", "N*m", 0.0, 1e-3 * torque),
                Parameter("order", "1", 1.0, 0.01 / span, 0.1, 1.2 * ORDERS, 1.0 / span, shape=True),
            )
            yield Site(self.name, name, parameters, _cogging(name), _waves(setting.joint, name, role), _cogging_report)


def _cogging(name: str) -> Any:
    def apply(joint: Any, values: Sequence[float]) -> Any:
        told = _cogging_report(values)
        wave = Cogging(torque=told["torque"][0], order=told["order"][0], phase=told["phase"][0])
        return with_part(joint, name, cogging=(*getattr(joint, name).cogging, wave))

    return apply


def _cogging_report(values: Sequence[float]) -> dict[str, tuple[float, str]]:
    # torque · sin(order · θ + phase) = sine · sin + cosine · cos
    cosine, sine, order = (float(v) for v in values)
    return {
        "torque": (float(np.hypot(cosine, sine)), "N*m"),
        "order": (order, "1"),
        "phase": (float(np.arctan2(cosine, sine)), "rad"),
    }


def _waves(joint: Any, name: str, role: str) -> Any:
    """Look for waves over the rotor's turn in what is left over of the motor equation."""

    def starts(left: Remainder) -> list[tuple[float, ...]]:
        residual = left.equations.get(name)
        theta = angle_of(joint, left.roles[role], name) * getattr(joint, name).gear_ratio
        if residual is None:
            residual = left.equations.get("link")
        if residual is None:
            return []
        good = np.isfinite(residual) & np.isfinite(theta)
        if np.count_nonzero(good) < 100:
            return []
        y, x = residual[good] - np.mean(residual[good]), theta[good]
        # Less than a turn tells little of slow waves.
        orders = np.unique(np.r_[np.arange(1.0, ORDERS + 1.0)])
        orders = orders[orders * np.ptp(x) > 2.0 * np.pi]
        power = [abs(np.mean(y * np.exp(-1j * n * x))) for n in orders]
        best = orders[np.argsort(power)[::-1][:TRIED]]
        found: list[tuple[float, ...]] = []
        for n in best:
            basis = np.stack([np.cos(n * x), np.sin(n * x), np.ones_like(x)], axis=-1)
            # The equation has −cogging on its left side.
            cosine, sine, _ = -np.linalg.lstsq(basis, y, rcond=None)[0]
            found.append((float(cosine), float(sine), float(n)))
        return found

    return starts
