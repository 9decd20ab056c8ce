"""How far a machine's numbers may be from its rig's before a log is seen: the prior of each cause's parameters.

A rig states tolerances, or the defaults by kind of quantity hold (`vsalog.rig.tolerance`). They break ties between causes that a
log cannot tell apart; what a log tells well they hardly move.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace

from vsalog.diagnosis.causes.base import Parameter, Setting, Site, suffix_of
from vsalog.diagnosis.causes.motor_friction import scale_of
from vsalog.residuals.sensing import at_joint
from vsalog.rig.tolerance import default_deviation

# Parameter of a cause → key of the rig below the cause's part, where the two are called otherwise.
_KEYS = {
    ("motor.torque_constant", "gain"): "torque_gain",
    ("motor.torque_offset", "torque"): "torque_offset",
    ("motor.torque_delay", "delay"): "torque_delay",
    ("motor.coulomb_friction", "torque"): "friction.coulomb",
    ("motor.stribeck_friction", "torque"): "friction.coulomb",
    ("motor.stribeck_friction", "excess"): "friction.static",
    ("motor.load_dependent_friction", "share"): "friction.load",
    ("motor.cogging", "cosine"): "cogging.torque",
    ("motor.cogging", "sine"): "cogging.torque",
    ("transmission.stiffness", "factor"): "stiffness",
    ("transmission.nonlinearity", "cubic"): "added_cubic",
    ("transmission.hysteresis", "torque"): "bouc_wen.torque",
    ("transmission.hysteresis", "slip_limit"): "slip.limit",
    ("transmission.backlash", "gap"): "backlash",
    ("transmission.stiffness_drift", "rate"): "drift",
    ("link.gravity", "torque"): "gravity_torque",
    ("link.coulomb_friction", "torque"): "friction.coulomb",
    ("link.payload", "inertia"): "inertia",
    ("link.payload", "weight"): "gravity_torque",
    ("link.contact", "torque"): "friction.coulomb",
    ("sensor.torque_drift", "rate"): "drift",
    ("sensor.encoder_eccentricity", "sine"): "eccentricity.amplitude",
    ("sensor.encoder_eccentricity", "cosine"): "eccentricity.amplitude",
    ("pneumatic.leak", "area"): "leak_area",
    ("pneumatic.orifice_area", "scale"): "area_scale",
    ("pneumatic.force_gain", "gain"): "force_gain",
    ("pneumatic.muscle_friction", "muscle"): "friction.muscle",
    ("pneumatic.muscle_friction", "torque"): "coulomb",
}


def deviation_of(site: Site, parameter: Parameter, setting: Setting, stated: Mapping[str, float]) -> float:
    """Return one standard deviation of a parameter about the rig's value, in the parameter's unit.

    Parameters
    ----------
    site, parameter : of a cause
    setting : of the joint and its log
    stated : key's path below the joint → one standard deviation that the rig states, as the joint feels it
    """
    key = _KEYS.get((site.cause, parameter.name), parameter.name)
    path = f"signals.{site.part}.{key}" if site.cause.startswith("sensor.") else f"{site.part}.{key}"
    nominal, scale = _size(site, parameter, setting, key)
    if key == "stiffness":
        # A factor on a whole spring is known as well as its stiffness is.
        part = (site.members[0] if site.members else site).part
        name, value = _stiffness(getattr(setting.joint, part))
        if f"{part}.{name}" in stated:
            return stated[f"{part}.{name}"] / value
    own = stated.get(path, default_deviation(path, nominal, scale))
    if site.cause == "link.inertia" and "motor.inertia" in site.doubles:
        # What moves as one is as unsure as both parts are.
        motor = setting.joint.motor.inertia
        return float(np.hypot(own, stated.get("motor.inertia", default_deviation("motor.inertia", motor, motor))))
    return own


def _size(site: Site, parameter: Parameter, setting: Setting, key: str) -> tuple[float, float]:
    """Return what a parameter nominally is, and the value of it that would matter in this log."""
    cause, part, joint = site.cause, site.part, setting.joint
    if cause == "link.payload":
        # A load is anything up to the link itself.
        own = joint.link.inertia if parameter.name == "inertia" else abs(joint.link.gravity_torque)
        return own, own
    if cause.startswith("pneumatic."):
        # Their steps are so small parts of what they are of: a valve's area or voltage, a pressure, a torque.
        return parameter.start, parameter.step * (1e3 if cause == "pneumatic.muscle_friction" else 1e4)
    if part.startswith(("motor", "secondary_motor")) and cause.startswith("motor."):
        torque, speed = scale_of(setting, part)
        return parameter.start, torque / speed if key == "damping" else torque
    suffix = suffix_of(part)
    torque = setting.torque_size(part if part.startswith("torque_sensor") else None)
    scales = {
        "damping": torque / setting.speed("link_position"),
        "added_cubic": setting.torque_size() / setting.deflection_size(suffix) ** 3,
        "backlash": setting.deflection_size(suffix),
        "drift": (torque if cause == "sensor.torque_drift" else 1.0) / setting.duration,
    }
    return parameter.start, scales.get(key, torque)


def _stiffness(transmission: Any) -> tuple[str, float]:
    """Return the key that says how stiff a spring is, and its value."""
    for name in ("stiffness", "spring_stiffness"):
        if hasattr(transmission, name):
            return name, float(getattr(transmission, name))
    return "coefficients[0]", float(abs(transmission.coefficients[0]))


def felt(joint: Any, stated: Mapping[str, float]) -> dict[str, float]:
    """Return tolerances as the joint feels them: before a gear's ratio and a sensor's gain as `sensing.at_joint` undoes them.

    Parameters
    ----------
    joint : as the rig writes it
    stated : key's path below the joint → one standard deviation in SI, on the side that the rig writes it
    """
    plain, out = at_joint(joint), dict[str, float]()
    for path, deviation in stated.items():
        keys = path.split(".")
        value = _value(joint, keys)
        if value is None:
            out[path] = deviation  # one of a list, which neither gears nor sensors change
            continue
        if keys[-1] == "gain":
            out[path] = deviation / abs(value)
            continue
        moved = at_joint(_with_value(joint, keys, value + deviation))
        now, then = _value(plain, keys), _value(moved, keys)
        out[path] = deviation if now is None or then is None else abs(then - now)
    return out


def _value(part: Any, keys: Sequence[str]) -> float | None:
    for key in keys:
        part = getattr(part, key, None)
    return float(part) if isinstance(part, int | float) else None


def _with_value(part: Any, keys: Sequence[str], value: float) -> Any:
    own = value if len(keys) == 1 else _with_value(getattr(part, keys[0]), keys[1:], value)
    return replace(part, **{keys[0]: own})
