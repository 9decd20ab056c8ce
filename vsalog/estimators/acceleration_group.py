"""Which joints of an arm have to be looked at together for one of them to be observed from accelerations, and what they read."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.joint import offered_roles
from vsalog.binding.neighbours import role_of
from vsalog.core.errors import EstimatorError
from vsalog.estimators.device import Device, TransmissionView, device_of
from vsalog.estimators.needs import require
from vsalog.filters.acceleration_observer import ElasticMotor
from vsalog.mechanics.kinematics import rotation_of
from vsalog.rig.schema import Chain, ChainLink, LinearTransmission

Array = NDArray[np.float64]

NAME = "acceleration-observer"
DIRECT = "link_acceleration"
AXES = ("accelerometer_x", "accelerometer_y", "accelerometer_z")
MOTOR_ROLES = ("motor_position", "motor_torque")


@dataclass(frozen=True, slots=True)
class Member:
    """A joint of the group.

    Attributes
    ----------
    joint : its name
    view : its transmission; its roles are named as the method reads them
    motor : the parameters the observer needs
    """

    joint: str
    view: TransmissionView
    motor: ElasticMotor


@dataclass(frozen=True, slots=True)
class Axis:
    """A measured acceleration: the role, its joint's place in the group, and for an accelerometer position and direction [m]."""

    role: str
    place: int
    direct: bool
    point: Array
    direction: Array


@dataclass(frozen=True, slots=True)
class Group:
    """Joints that are observed together.

    Attributes
    ----------
    members : from the base on
    links : their links; empty links where no accelerometer asks for a chain
    axes : the measured accelerations
    gravity : in the base's frame [m/s²]
    coupling : shape (N, N), S, element (i, j) couples link i and motor j [kg·m²]
    place : of the joint that is asked for
    """

    members: tuple[Member, ...]
    links: tuple[ChainLink, ...]
    axes: tuple[Axis, ...]
    gravity: Array
    coupling: Array
    place: int

    @property
    def roles(self) -> tuple[str, ...]:
        """All roles the group reads."""
        motors = (role for m in self.members for role in (m.view.motor_position, m.view.motor_torque))
        return (*motors, *(axis.role for axis in self.axes))


def senses_acceleration(device: Device, offered: Collection[str]) -> bool:
    """Return whether the joint's acceleration is measured, or an accelerometer sits on its link or one beyond."""
    names = _chain_names(device)
    beyond = names[names.index(device.joint) :] if device.joint in names else [device.joint]
    return DIRECT in offered or any(role in AXES for name in beyond for role in _offered(device, name, offered))


def group_of(device: Device, offered: Collection[str]) -> Group:
    """Return the joints that one has to be observed with: itself alone where its acceleration is measured and nothing couples.

    Raises
    ------
    EstimatorError
        A role, the place of an accelerometer or a parameter of a motor or transmission is missing, or the transmission is not
        linear.
    """
    if device.pneumatic is not None:
        require(NAME, device, (), ())
    names = _direct_group(device, offered) or _cartesian_group(device, offered)
    chain = None if device.rig is None else device.rig.chain
    by_name = {} if chain is None else {link.joint: link for link in chain.link}
    links = tuple(by_name.get(name, ChainLink(joint=name)) for name in names)
    members = tuple(_member(device, name, offered) for name in names)
    direct = all(DIRECT in _offered(device, name, offered) for name in names)
    axes = [a for i, link in enumerate(links) for a in _axes(device, link, i, offered, accelerometers=not direct)]
    if len(axes) < len(names):
        raise EstimatorError(
            f"joint '{device.joint}': {NAME} has {len(axes)} measured accelerations for the {len(names)} joints"
            f" {', '.join(names)}; there have to be at least as many axes of accelerometers as joints up to the last that has one"
        )
    coupling = np.zeros((len(names), len(names)))
    for c in () if chain is None else chain.coupling:
        if c.link in names and c.motor in names:
            coupling[names.index(c.link), names.index(c.motor)] += c.inertia
    gravity = np.zeros(3) if chain is None else np.array(chain.gravity)
    return Group(members, links, tuple(axes), gravity, coupling, names.index(device.joint))


def _direct_group(device: Device, offered: Collection[str]) -> list[str]:
    """Return the joint, and those whose links carry its motor, from the base on; nothing where not all their q̈ are measured.

    Of a motor that a moving link carries eq. 7 needs that link's acceleration too.
    """
    chain = None if device.rig is None else device.rig.chain
    needed, names = {device.joint}, _chain_names(device)
    for name in reversed(names):
        if name in needed and chain is not None:
            needed |= {c.link for c in chain.coupling if c.motor == name}
    if any(DIRECT not in _offered(device, name, offered) for name in needed):
        return []
    return [name for name in names if name in needed] or [device.joint]


def _cartesian_group(device: Device, offered: Collection[str]) -> list[str]:
    """Return all joints up to the last that has an accelerometer: its reading depends on all of them."""
    names = _chain_names(device)
    sensing = [i for i, name in enumerate(names) if {*AXES, DIRECT} & set(_offered(device, name, offered))]
    if device.joint not in names or not sensing or max(sensing) < names.index(device.joint):
        where = "" if device.joint in names or not set(AXES) & set(offered) else ", with its place in a [[chain.link]]"
        raise EstimatorError(
            f"joint '{device.joint}': {NAME} needs the link's acceleration, but there is no channel for link_acceleration"
            f" (q̈), nor one of an accelerometer (accelerometer_x, …) on this link or one beyond{where}. Name it under"
            f" [joint.{device.joint}.signals] in the rig"
        )
    return names[: max(sensing) + 1]


def _member(device: Device, name: str, offered: Collection[str]) -> Member:
    own = device if name == device.joint else _neighbour(device, name)
    if not own.transmissions:
        require(NAME, own, (), ())
    if len(own.transmissions) != 1:
        raise EstimatorError(
            f"joint '{name}': {NAME} is for one motor behind one transmission, and an antagonistic joint has two"
        )
    (view,) = own.transmissions
    require(NAME, own, MOTOR_ROLES, _offered(device, name, offered))
    motor, spring = view.motor.reflected, view.nominal
    if not isinstance(spring, LinearTransmission) or not _plain(spring):
        raise EstimatorError(
            f"joint '{name}': {NAME} needs the transmission's stiffness and damping, and a transmission that is linear"
            f' (type = "linear", without backlash, hysteresis, asymmetry, drift or cubic part) under [joint.{name}.transmission]'
        )
    if motor.inertia is None:
        raise EstimatorError(f"joint '{name}': {NAME} needs the motor's inertia; give it under [joint.{name}.motor]")
    if motor.friction.load > 0.0:
        raise EstimatorError(
            f"joint '{name}': {NAME} subtracts a motor's dry friction, but not friction that grows with the transmitted torque"
            " (friction.load)"
        )
    position, torque = (role_of(name, role, device.joint) for role in MOTOR_ROLES)
    named = replace(view, name=name, motor_position=position, motor_torque=torque)
    return Member(name, named, ElasticMotor(motor.inertia, spring.stiffness, spring.damping, motor.damping))


def _plain(spring: LinearTransmission) -> bool:
    effects = (spring.added_cubic, spring.asymmetry, spring.backlash, spring.drift)
    return not any(effects) and spring.bouc_wen is None and not spring.slip


def _axes(device: Device, link: ChainLink, place: int, offered: Collection[str], *, accelerometers: bool) -> list[Axis]:
    there, nothing = _offered(device, link.joint, offered), np.zeros(3)
    axes = []
    if DIRECT in there:
        axes.append(Axis(role_of(link.joint, DIRECT, device.joint), place, True, nothing, nothing))
    for i, role in enumerate(AXES):
        if role not in there or not accelerometers:
            continue
        if link.accelerometer is None:
            raise EstimatorError(
                f"joint '{link.joint}' has an accelerometer, but its place is not stated: give the joint's [[chain.link]] an"
                " accelerometer = { position = […], orientation = […] }"
            )
        direction = rotation_of(link.accelerometer.orientation)[:, i]
        point = np.array(link.accelerometer.position)
        axes.append(Axis(role_of(link.joint, role, device.joint), place, False, point, direction))
    return axes


def _chain_names(device: Device) -> list[str]:
    chain: Chain | None = None if device.rig is None else device.rig.chain
    return [] if chain is None else [link.joint for link in chain.link]


def _offered(device: Device, name: str, offered: Collection[str]) -> Collection[str]:
    if name == device.joint:
        return offered
    assert device.rig is not None
    return offered_roles(device.rig.joint[name])


def _neighbour(device: Device, name: str) -> Device:
    assert device.rig is not None
    try:
        return device_of(name, device.rig.joint[name])
    except EstimatorError as error:
        raise EstimatorError(
            f"joint '{device.joint}': its accelerations depend on joint '{name}' too, and {error}"
        ) from None
