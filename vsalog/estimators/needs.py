"""Which roles a method needs, and how it reports that one is missing."""

from __future__ import annotations

from collections.abc import Collection

from vsalog.core.errors import EstimatorError, OtherKindError
from vsalog.estimators.device import Device, TransmissionView

# What a role is, in words to look for in a log.
MEANING = {
    "motor_position": "the motor's position θ",
    "motor_torque": "the motor's torque τ (or its current, with a torque constant in the rig)",
    "link_position": "the link's position q",
    "link_acceleration": "the link's acceleration q̈",
    "deflection": "the transmission's deflection φ = q − θ",
    "torque_sensor": "a joint torque sensor",
    "external_torque": "the torque that pushes the link from outside",
    "pressure": "the absolute pressure of a muscle",
    "valve": "the voltage commanded to a muscle's valve",
    "setpoint": "the set-point: the secondary motor's position θ_c, or the lever arm r",
}


def meaning(role: str) -> str:
    """Return what a role is, in words; that of one of two transmissions has a number at its end."""
    return MEANING[role.removesuffix("_1").removesuffix("_2")]


def require(name: str, device: Device, needed: Collection[str], offered: Collection[str]) -> None:
    """Refuse when a role that a method needs is not in the rig.

    Raises
    ------
    EstimatorError
        Names every missing role and what it means.
    OtherKindError
        A method for springs is asked of a joint that has none.
    """
    if device.pneumatic is not None and not needed:
        raise OtherKindError(
            f"joint '{device.joint}' is of kind 'pneumatic', and {name} is for springs between a motor and a link; for muscles"
            " there are pam-ukf, pam-smoother and pam-model"
        )
    missing = [role for role in dict.fromkeys(needed) if role not in offered]
    if missing:
        listed = "; ".join(f"{role} ({meaning(role)})" for role in missing)
        raise EstimatorError(
            f"joint '{device.joint}': the estimator {name} needs {', '.join(dict.fromkeys(needed))}, but there is no channel for"
            f" {listed}. Name it under [joint.{device.joint}.signals] in the rig, or choose an estimator that works"
            " without ('vsalog estimate --help' lists them)"
        )


def torque_roles(name: str, device: Device, offered: Collection[str], modality: str) -> tuple[str, ...]:
    """Return the roles of deflections and of the signals that give their torque; refuse where one is missing, as `require`.

    Parameters
    ----------
    name, device, offered : of the method and the joint
    modality : SENSOR where torques are measured, MODEL where they follow from the deflection; else motors give them
    """
    needed: list[str] = []
    for view in device.transmissions:
        needed += deflection_roles(device, view, offered)
        if modality == "SENSOR":
            needed.append(sensor_role(view, offered))
        elif modality != "MODEL":
            needed += [view.motor_position, view.motor_torque]
    require(name, device, needed, offered)
    return tuple(dict.fromkeys(needed))


def sensor_role(view: TransmissionView, offered: Collection[str]) -> str:
    """Return the transmission's own torque sensor, or the joint's where that is the only one."""
    if view.torque_sensor not in offered and "torque_sensor" in offered:
        return "torque_sensor"
    return view.torque_sensor


def deflection_roles(device: Device, view: TransmissionView, offered: Collection[str]) -> tuple[str, ...]:
    """Return the roles that give the deflection, and the set-point where the device has one."""
    roles = view.deflection_roles(offered)
    return (*roles, "setpoint") if device.has_setpoint else roles
