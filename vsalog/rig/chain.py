"""Joints in a row: an arm whose links move one another (De Luca 2007 eq. 1–2)."""

from __future__ import annotations

from vsalog.core.quantities import (
    Acceleration,
    Angle,
    Base,
    BodyInertia,
    Coordinate,
    CoupledInertia,
    Mass,
)


class Accelerometer(Base, frozen=True):
    """The mounting of an accelerometer on a link. It measures specific force, R (a − g): +g upwards when at rest.

    Attributes
    ----------
    position : x, y, z in the link's frame [m]
    orientation : roll, pitch, yaw of its axes in the link's frame, R_z(yaw) R_y(pitch) R_x(roll) [rad]
    """

    position: tuple[Coordinate, ...] = (0.0, 0.0, 0.0)
    orientation: tuple[Angle, ...] = (0.0, 0.0, 0.0)


class ChainLink(Base, frozen=True):
    """One link of an arm; its frame sits at its far end (Denavit–Hartenberg: R_z(q + angle) T_z(offset) T_x(length) R_x(twist)).

    Attributes
    ----------
    joint : name of the joint that moves it
    length, offset : a, d [m]
    twist, angle : α, and the offset of q [rad]
    mass : [kg]
    centre : x, y, z of the centre of mass in the link's frame [m]
    inertia : about the centre of mass, along the frame's axes: I_xx, I_yy, I_zz [kg·m²]
    accelerometer : on this link
    """

    joint: str
    length: Coordinate = 0.0
    offset: Coordinate = 0.0
    twist: Angle = 0.0
    angle: Angle = 0.0
    mass: Mass = 0.0
    centre: tuple[Coordinate, ...] = (0.0, 0.0, 0.0)
    inertia: tuple[BodyInertia, ...] = (0.0, 0.0, 0.0)
    accelerometer: Accelerometer | None = None


class Coupling(Base, frozen=True):
    """One element of S: the coupling of the accelerations of a link and of a motor that it carries.

    Attributes
    ----------
    link : joint of the link, nearer to the base than `motor` (S is strictly upper triangular)
    motor : joint of the motor
    inertia : [kg·m²], reduced to the joint
    """

    link: str
    motor: str
    inertia: CoupledInertia


class Chain(Base, frozen=True):
    """The arm that the joints form. Joints outside it move alone; inside, its links replace `link.inertia` and gravity.

    Attributes
    ----------
    gravity : in the base's frame [m/s²]
    link : from the base to the tip, [[chain.link]]
    coupling : elements of the inertial coupling S between motors and links, [[chain.coupling]]
    """

    gravity: tuple[Acceleration, ...] = (0.0, 0.0, -9.81)
    link: tuple[ChainLink, ...] = ()
    coupling: tuple[Coupling, ...] = ()
