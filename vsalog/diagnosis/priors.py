"""How far a rig's numbers may be from the machine's before anything is measured: the prior deviations of a cause's parameters."""

from __future__ import annotations

from vsalog.diagnosis.causes.base import Parameter, Setting, Site
from vsalog.diagnosis.sensing import torque_role


def deviation_of(site: Site, parameter: Parameter, setting: Setting) -> float:
    """Return one standard deviation of a parameter about what the rig says, in its unit."""
    name, start = parameter.name, abs(parameter.start)
    torque = setting.torque_size(torque_role(site.part)) if "motor" in site.part and "position" not in site.part else setting.torque_size()
    cause = site.cause
    if name == "inertia":
        return 0.2 * start if cause != "link.payload" else 0.2 * setting.joint.link.inertia
    if name == "weight":
        return 0.2 * abs(setting.joint.link.gravity_torque)
    if cause == "link.gravity":
        return max(0.2 * start, 0.02 * torque)
    if name == "damping":
        speed = setting.speed("link_position" if site.part == "link" else "motor_position" + site.part[5:] if site.part.startswith("motor") else "link_position")
        return max(start, 0.1 * torque / speed)
    if cause in ("motor.torque_constant", "transmission.stiffness"):
        return 0.1
    if cause == "sensor.torque_gain":
        return 0.05
    if cause == "sensor.encoder_scale":
        return 1e-3 if "deflection" not in site.part else 0.01
    if cause == "sensor.encoder_offset":
        return 0.015
    if cause == "sensor.encoder_eccentricity":
        return 0.004
    if name == "delay":
        return 2e-3
    if name == "rate":
        return 0.1 / setting.duration * (1.0 if cause == "transmission.stiffness_drift" else torque)
    if name in ("asymmetry", "share"):
        return 0.1
    if name == "cubic":
        return 0.1 * setting.torque_size() / setting.deflection_size(site.part[12:]) ** 3
    if name == "gap":
        return 0.2 * setting.deflection_size(site.part[12:])
    return 0.1 * torque
