"""The nominal machine as a `rig.toml`: what its owner believes."""

from __future__ import annotations

import numpy as np

from . import _plant
from .machines import Machine

# Which channel a role is recorded in.
CHANNELS = {
    "motor_position": "motor angle",
    "motor_position_1": "motor 1 angle",
    "motor_position_2": "motor 2 angle",
    "motor_torque": "motor torque",
    "motor_torque_1": "motor 1 torque",
    "motor_torque_2": "motor 2 torque",
    "link_position": "link angle",
    "torque_sensor": "joint torque",
    "torque_sensor_1": "spring 1 torque",
    "torque_sensor_2": "spring 2 torque",
    "setpoint": "lever motor angle",
    "secondary_torque": "lever motor torque",
    "pressure_1": "muscle 1 pressure",
    "pressure_2": "muscle 2 pressure",
    "deflection": "spring angle",
    "valve_1": "valve 1 voltage",
    "valve_2": "valve 2 voltage",
}
UNITS = {
    "position": "rad",
    "deflection": "rad",
    "setpoint": "rad",
    "torque": "N*m",
    "sensor": "N*m",
    "pressure": "Pa",
    "valve": "V",
}


def unit_of(role: str) -> str:
    return next(unit for word, unit in UNITS.items() if word in role)


def rig_text(machine: Machine, roles: list[str]) -> str:
    """Return the rig file of a nominal machine; all numbers are on the joint's side of the gear."""
    name = machine.joint
    lines = ['name = "hidden machine"', "", f"[joint.{name}]", f'kind = "{machine.device}"', ""]
    motors = {"elastic": ["motor"], "serial": ["motor", "secondary_motor"], "antagonistic": ["motor_1", "motor_2"]}
    for part, row in zip(motors[machine.device], machine.motors, strict=False):
        lines += table(
            f"joint.{name}.{part}",
            {"inertia": row["inertia"], "damping": row["damping"], "gear_ratio": row["gear"]},
        )
    for suffix, row in zip(machine.suffixes, machine.springs, strict=False):
        lines += table(f"joint.{name}.transmission{suffix}", _law(row))
    if machine.device == "serial":
        lines += table(f"joint.{name}.lever", {"start": machine.lever[0], "travel": machine.lever[1]})
    row = machine.link[0]
    link = {"inertia": row["inertia"], "damping": row["damping"]}
    if row["gravity"]:
        link |= {"gravity_torque": row["gravity"], "gravity_angle": row["hangs_at"]}
    lines += table(f"joint.{name}.link", link)
    return "\n".join([*lines, *channel_lines(name, roles)]) + "\n"


def channel_lines(name: str, roles: list[str]) -> list[str]:
    """Return the table of a joint's signals."""
    lines = [f'{role} = {{ channel = "{CHANNELS[role]}", unit = "{unit_of(role)}" }}' for role in roles]
    return [f"[joint.{name}.signals]", *lines]


def _law(row: np.void) -> dict[str, object]:
    if row["law"] == _plant.CUBIC:
        law = {"type": "cubic", "stiffness": row["k1"], "cubic": row["k3"]}
        if not row["k3"]:
            law = {"type": "linear", "stiffness": row["k1"]}
    elif row["law"] == _plant.FOUR_BAR:
        law = {"type": "vsa2", "stiffness": row["k1"], "geometry": row["k3"]}
    else:
        law = {"type": "awas", "spring_stiffness": row["k1"]}
    return law | ({"damping": row["damping"]} if row["damping"] else {})


def table(name: str, values: dict[str, object]) -> list[str]:
    """Return a table of numbers and texts, and an empty line."""
    rows = [f'{k} = "{v}"' if isinstance(v, str) else f"{k} = {float(v)!r}" for k, v in values.items()]
    return [f"[{name}]", *rows, ""]
