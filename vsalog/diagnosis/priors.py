"""How far a machine's numbers may be from its rig's before a log is seen: the prior of each cause's parameters.

A rig states tolerances, or the defaults by kind of quantity hold (`vsalog.rig.tolerance`). They break ties between causes that a
log cannot separate; values that a log determines well they hardly move.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from msgspec.structs import replace

from vsalog.diagnosis.causes.base import Parameter, Setting, Site
from vsalog.residuals.sensing import at_joint
from vsalog.rig.tolerance import default_deviation


def deviation_of(site: Site, parameter: Parameter, setting: Setting, stated: Mapping[str, float]) -> float:
    """Return one standard deviation of a parameter about the rig's value, in the parameter's unit.

    Parameters
    ----------
    site, parameter : of a cause
    setting : of the joint and its log
    stated : key's path below the joint → one standard deviation that the rig states, as the joint feels it
    """
    key = parameter.key or parameter.name
    part = (site.members[0] if site.members else site).part
    path = f"signals.{part}.{key}" if site.cause.startswith("sensor.") else f"{part}.{key}"
    if key == "stiffness":
        # A factor on a whole spring is known as well as its stiffness is.
        name, value = _stiffness(getattr(setting.joint, part))
        if f"{part}.{name}" in stated:
            return stated[f"{part}.{name}"] / value
    nominal = parameter.start if parameter.nominal is None else parameter.nominal
    own = stated.get(path, default_deviation(path, nominal, parameter.scale))
    if site.cause == "link.inertia" and "motor.inertia" in site.doubles:
        # Parts that move as one are as uncertain as both are.
        motor = setting.joint.motor.inertia
        return float(np.hypot(own, stated.get("motor.inertia", default_deviation("motor.inertia", motor, motor))))
    return own


def _stiffness(transmission: Any) -> tuple[str, float]:
    """Return the key of a spring's stiffness, and its value."""
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
