"""The parts of a rig's joints for a model of any format."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from msgspec.structs import replace

from vsalog.core.errors import ExportError
from vsalog.core.units import matching, shown
from vsalog.effects.counterpart import Dialect
from vsalog.effects.friction import Friction
from vsalog.effects.gravity import Payload
from vsalog.export.bodies import Body, alone, chained, gravity_of, is_earthly
from vsalog.export.collect import Lacking, Parts, collect
from vsalog.rig.checks import motors, transmissions
from vsalog.rig.decode import key_path
from vsalog.rig.load import Rig
from vsalog.rig.schema import (
    AntagonisticJoint,
    ElasticJoint,
    KnownTransmission,
    Link,
    Motor,
    PneumaticJoint,
    RigidJoint,
    SerialJoint,
    Signal,
    UnknownTransmission,
)

Movable = RigidJoint | ElasticJoint | SerialJoint | AntagonisticJoint
STOOD_FOR = ("inertia", "gravity_torque", "gravity_angle")
"""Keys of a link that the chain's replace."""


@dataclass(frozen=True, slots=True)
class Spring:
    """A transmission in a model.

    Attributes
    ----------
    motor : key of the motor that it ends at
    transmission : with its law
    arm : lever arm [m] of one that has a lever
    parts : the model's terms for its effects
    """

    motor: str
    transmission: KnownTransmission
    arm: float | None
    parts: Parts


@dataclass(frozen=True, slots=True)
class Taken:
    """A joint in a model.

    Attributes
    ----------
    joint : of the rig
    body : its link
    link : what turns with the link; its motors too, where they are one with it
    motors, springs : by their keys in the rig
    one_body : whether motors and link are one
    """

    joint: Movable
    body: Body
    link: Parts
    motors: Mapping[str, Parts]
    springs: Mapping[str, Spring]
    one_body: bool

    def driven_by_current(self, motor: str) -> bool:
        """Return whether a motor's torque is recorded as a current."""
        signal = getattr(self.joint.signals, motor.replace("motor", "motor_torque"), None)
        unit = signal.unit if isinstance(signal, Signal) else None
        return unit is not None and matching(unit, ("N*m", "A")) == "A"


@dataclass(frozen=True, slots=True)
class Assembly:
    """A rig taken apart.

    Attributes
    ----------
    rig : it
    joints : by name, those of the chain in its order and first
    lacking : keys that the model's format does not support
    """

    rig: Rig
    joints: dict[str, Taken] = field(default_factory=dict)
    lacking: Lacking = field(default_factory=dict)


def take_apart(rig: Rig, dialect: Dialect) -> Assembly:
    """Take a rig apart for a model.

    In URDF, which has no springs, motor and link of each joint are one.

    Raises
    ------
    ExportError
        The rig lacks what any model needs, or has no joint that a model can have.
    """
    found = Assembly(rig)
    movable = _movable(rig, found.lacking)
    links = _chained(rig, movable)
    for name in [*links, *(name for name in movable if name not in links)]:
        joint = movable[name]
        one_body = dialect == "urdf" or isinstance(joint, RigidJoint)
        parts, actuators, springs = _parts(found, dialect, name, joint, one_body, name in links)
        if name not in links:
            body = _alone(found, dialect, name, parts, one_body)
        else:
            body = links[name]
            for key, motor in actuators.items():
                if one_body and motor.of("rotor", "inertia"):
                    found.lacking["joint", name, key, "inertia"] = "URDF has no rotor that turns faster than its joint"
        found.joints[name] = Taken(joint, body, parts, actuators, springs, one_body)
    return found


def _movable(rig: Rig, lacking: Lacking) -> dict[str, Movable]:
    """Return the joints that a model can have."""
    movable: dict[str, Movable] = {}
    for name, joint in rig.joints.items():
        if isinstance(joint, PneumaticJoint):
            lacking["joint", name] = "it is moved by compressed air, which models of rigid bodies do not have"
        else:
            movable[name] = joint
    if not movable:
        why = "".join(f"{key_path(path)}: {reason}; " for path, reason in lacking.items())
        raise ExportError(f"{rig.where}: {why}there is no joint to export")
    return movable


def _chained(rig: Rig, movable: Mapping[str, Movable]) -> dict[str, Body]:
    """Return the links of the chain by their joints."""
    if rig.file.chain is None:
        return {}
    payloads: dict[str, Payload] = {}
    for i, link in enumerate(rig.file.chain.link):
        if link.joint not in movable:
            raise ExportError(f"{rig.where}: the chain cannot be exported without its joint '{shown(link.joint)}'")
        least, middle, most = sorted(link.inertia)
        if most > (least + middle) * (1.0 + 1e-9):
            raise ExportError(
                f"{rig.where}: chain.link[{i}].inertia: no body has it: the largest exceeds the sum of the other two, and"
                " simulators refuse that"
            )
        own = movable[link.joint].link
        if own is not None and own.payload is not None:
            payloads[link.joint] = own.payload
    return {body.joint: body for body in chained(rig.file.chain, payloads)}


def _alone(found: Assembly, dialect: Dialect, name: str, parts: Parts, one_body: bool) -> Body:
    """Return a link outside of the chain."""
    gravity = gravity_of(found.rig.file.chain if dialect == "mjcf" else None)
    inertia = parts.of("inertial", "inertia") + (parts.of("rotor", "inertia") if one_body else 0.0)
    weight, angle = parts.of("inertial", "weight"), parts.of("inertial", "angle")
    payload = next((Payload(**one.attributes) for one in parts.terms if one.element == "payload"), None)
    if weight and not is_earthly(gravity):
        found.lacking["joint", name, "link", "gravity_torque"] = "a model has one gravity, and the chain's is another"
        weight = 0.0
    return alone(name, inertia, weight, angle, payload, gravity)


def _parts(
    found: Assembly, dialect: Dialect, name: str, joint: Movable, one_body: bool, in_chain: bool
) -> tuple[Parts, dict[str, Parts], dict[str, Spring]]:
    path, lacking = ("joint", name), found.lacking
    if joint.link is None and not isinstance(joint, RigidJoint):
        raise ExportError(
            f"{found.rig.where}: joint '{shown(name)}' has no link to move: give 'link.inertia' in the rig"
        )
    parts, actuators, springs = Parts(), {}, {}
    geared = {key: motor.reflected for key, motor in motors(joint) if key != "secondary_motor"}
    link = joint.link
    if isinstance(joint, SerialJoint) and joint.secondary_motor is not None:
        lacking[(*path, "secondary_motor")] = "models have no lever that a motor moves; it stays at lever.start"
    if isinstance(joint, RigidJoint) and link is not None:
        geared["motor"], link = _rubbing_once(geared["motor"], link)
    if link is not None:
        collect(dialect, "link", link, (*path, "link"), parts, lacking, STOOD_FOR if in_chain else ())
    for key, motor in geared.items():
        if motor.inertia is None and not one_body:
            raise ExportError(
                f"{found.rig.where}: joint '{shown(name)}': {key} has no inertia: give '{key}.inertia' in the rig"
            )
        actuators[key] = Parts()
        collect(dialect, "motor", motor, (*path, key), actuators[key], lacking)
        drive = None if isinstance(joint, AntagonisticJoint) else joint.drive
        if drive is not None:
            collect(dialect, "drive", drive, (*path, "drive"), actuators[key], lacking)
            if motor.torque_delay:
                lacking[(*path, key, "torque_delay")] = "a model delays what is commanded to the drive, not its torque"
        if one_body:
            parts.absorb(actuators[key])
    for key, transmission in transmissions(joint):
        if isinstance(transmission, UnknownTransmission):
            raise ExportError(
                f"{found.rig.where}: joint '{shown(name)}': a transmission of unknown type cannot be exported: give"
                f" {key}.type in the rig"
            )
        if dialect == "urdf":
            lacking[(*path, key)] = "URDF has no springs between bodies; motor and link become one"
            continue
        arm = joint.lever.start if isinstance(joint, SerialJoint) and joint.lever is not None else None
        own = Parts()
        collect(dialect, "transmission", transmission, (*path, key), own, lacking)
        springs[key] = Spring(key.replace("transmission", "motor"), transmission, arm, own)
    return parts, actuators, springs


def _rubbing_once(motor: Motor, link: Link) -> tuple[Motor, Link]:
    """Assign the dry friction of a rigidly coupled motor and link to one of them, as the simulation does."""
    both = motor.friction.along_with(link.friction)
    if motor.friction == Friction():
        return motor, replace(link, friction=both)
    return replace(motor, friction=both), replace(link, friction=Friction())
