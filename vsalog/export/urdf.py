"""URDF: a tree of links and joints, which has damping and dry friction, but no springs, drives or gravity of its own."""

from __future__ import annotations

import numpy as np

from vsalog.export.assembly import Assembly, Taken
from vsalog.export.bodies import Array, Mass, angles_of, gravity_of, is_earthly, standing
from vsalog.export.elements import Element, child, number, plain_names


def urdf(found: Assembly) -> tuple[Element, list[str]]:
    """Return a rig as URDF, and notes on the model.

    Parameters
    ----------
    found : the rig, taken apart for URDF; it gets the chain's keys that URDF lacks
    """
    names, chain = plain_names(found.joints), found.rig.file.chain
    root = Element("robot", name=plain_names([found.rig.name or "rig"]).popitem()[1])
    child(root, "link", name="base_link")
    base = np.eye(3)
    if chain is not None:
        gravity = gravity_of(chain)
        if is_earthly(gravity):
            base = standing(-gravity / np.linalg.norm(gravity)).T
        else:
            found.lacking["chain", "gravity"] = "URDF has no gravity; simulators have the earth's"
        for i, coupling in enumerate(chain.coupling):
            if coupling.inertia:
                found.lacking["chain", "coupling", f"[{i}]"] = "URDF has no rotors that other links carry along"
    for name, taken in found.joints.items():
        _joint(root, names, name, taken, base)
    return root, ["gravity is the simulator's, along -z"]


def _joint(root: Element, names: dict[str, str], name: str, taken: Taken, base: Array) -> None:
    body, own = taken.body, names[name]
    _link(root, f"{own}_link", body.mass)
    parent = "base_link" if body.parent is None else f"{names[body.parent]}_link"
    turned = base @ body.rotation if body.parent is None else body.rotation
    joint = child(root, "joint", name=own, type="continuous")
    child(joint, "parent", link=parent)
    child(joint, "child", link=f"{own}_link")
    child(joint, "origin", xyz=base @ body.position if body.parent is None else body.position, rpy=angles_of(turned))
    child(joint, "axis", xyz=body.axis)
    dynamics = {key: taken.link.of("dynamics", key) for key in ("damping", "friction")}
    if any(dynamics.values()):
        child(joint, "dynamics", **dynamics)
    if body.payload is not None:
        _link(root, f"{own}_payload", body.payload)
        fixed = child(root, "joint", name=f"{own}_payload", type="fixed")
        child(fixed, "parent", link=f"{own}_link")
        child(fixed, "child", link=f"{own}_payload")
    for key, motor in taken.motors.items():
        gear = child(root, "transmission", name=f"{own}_{key}")
        child(gear, "type").text = "transmission_interface/SimpleTransmission"
        child(child(gear, "joint", name=own), "hardwareInterface").text = "hardware_interface/EffortJointInterface"
        actuator = child(gear, "actuator", name=f"{own}_{key}")
        child(actuator, "mechanicalReduction").text = number(motor.of("transmission", "mechanicalReduction") or 1.0)


def _link(root: Element, name: str, mass: Mass | None) -> None:
    link = child(root, "link", name=name)
    if mass is None:
        return
    inertial = child(link, "inertial")
    child(inertial, "origin", xyz=mass.centre, rpy=angles_of(mass.axes))
    child(inertial, "mass", value=mass.mass)
    ixx, iyy, izz = np.maximum(mass.inertia, 1e-12)
    child(inertial, "inertia", ixx=ixx, ixy=0.0, ixz=0.0, iyy=iyy, iyz=0.0, izz=izz)
