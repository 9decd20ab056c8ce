"""Links as rigid bodies: their frames, axes and mass distribution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vsalog.effects.gravity import GRAVITY, Payload
from vsalog.mechanics.kinematics import rotation_of
from vsalog.rig.schema import Chain

Array = NDArray[np.float64]
DOWN = np.array([0.0, 0.0, -1.0])
UPRIGHT, LEVEL = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])


@dataclass(frozen=True, slots=True)
class Mass:
    """A rigid body's mass.

    Attributes
    ----------
    mass : [kg]
    centre : of mass, in the body's frame, shape (3,) [m]
    axes : along which the inertia is given, shape (3, 3)
    inertia : about the centre, shape (3,) [kg·m²]
    """

    mass: float
    centre: Array
    axes: Array
    inertia: Array


@dataclass(frozen=True, slots=True)
class Body:
    """A link. Its frame is at its joint.

    Attributes
    ----------
    joint : its name in the rig
    parent : joint of the link that carries it; None for the base
    position, rotation : of its frame in its parent's, at q = 0, shapes (3,) [m] and (3, 3)
    axis : of the joint in its frame, shape (3,)
    mass : None where the rig gives none
    payload : likewise
    tip : where the next link begins, or the mass is, for a drawing, shape (3,) [m]
    """

    joint: str
    parent: str | None
    position: Array
    rotation: Array
    axis: Array
    mass: Mass | None
    payload: Mass | None
    tip: Array


def gravity_of(chain: Chain | None) -> Array:
    """Return the gravity of a model, shape (3,) [m/s²]: that of the chain where there is one."""
    return np.array(chain.gravity) if chain is not None else GRAVITY * DOWN


def is_earthly(gravity: Array) -> bool:
    """Return whether a gravity has the magnitude of that for single links, to a hundredth; shape (3,) [m/s²]."""
    return bool(np.isclose(np.linalg.norm(gravity), GRAVITY, rtol=1e-2))


def alone(joint: str, inertia: float, weight: float, angle: float, payload: Payload | None, gravity: Array) -> Body:
    """Return a link that no other carries: with a vertical axis where it has no weight, a horizontal one where it has.

    Rigs give the inertia about the axis and the torque that holds the link; many masses have both. Here half of the inertia
    is that of the centre of mass.

    Parameters
    ----------
    joint : its name
    inertia : about the axis [kg·m²]
    weight : torque that holds it horizontal [N·m]
    angle : where it hangs [rad]
    payload : on it, where it hangs
    gravity : of the model, shape (3,) [m/s²]
    """
    g = float(np.linalg.norm(gravity))
    hanging = np.array([np.sin(angle), 0.0, -np.cos(angle)]) if weight else np.array([1.0, 0.0, 0.0])
    distance = 0.5 * g * inertia / weight if weight else 0.0
    mass = weight / (g * distance) if weight else 1.0
    own = np.full(3, inertia - mass * distance**2)
    whole = Mass(mass, distance * hanging, np.eye(3), own) if inertia > 0.0 else None
    carried = None if payload is None else _point(payload, payload.distance * hanging)
    reach = abs(distance) or float(np.sqrt(inertia)) or (payload.distance if payload else 0.0)
    tip = reach * (np.sign(distance) or 1.0) * hanging
    upright = standing(-gravity / g) if weight else np.eye(3)
    return Body(joint, None, np.zeros(3), upright, LEVEL if weight else UPRIGHT, whole, carried, tip)


def chained(chain: Chain, payloads: dict[str, Payload]) -> list[Body]:
    """Return the links of a chain, from its base on (Denavit–Hartenberg: R_z(q + angle) T_z(offset) T_x(length) R_x(twist)).

    Parameters
    ----------
    chain : of the rig
    payloads : by joint, on the x-axis of the frame at the joint, at the height of the link's far end
    """
    bodies: list[Body] = []
    place, turned = np.zeros(3), np.eye(3)
    for link in chain.link:
        far, twist = np.array([link.length, 0.0, link.offset]), rotation_of([link.twist, 0.0, 0.0])
        mass = Mass(link.mass, far + twist @ np.array(link.centre), twist, np.array(link.inertia))
        payload = payloads.get(link.joint)
        carried = None if payload is None else _point(payload, np.array([payload.distance, 0.0, link.offset]))
        parent = bodies[-1].joint if bodies else None
        rotation = turned @ rotation_of([0.0, 0.0, link.angle])
        bodies.append(Body(link.joint, parent, place, rotation, UPRIGHT, mass, carried, far))
        place, turned = far, twist
    return bodies


def angles_of(rotation: Array) -> tuple[float, float, float]:
    """Return roll, pitch and yaw [rad] of R_z(yaw) R_y(pitch) R_x(roll), shape (3, 3)."""
    level = float(np.hypot(rotation[0, 0], rotation[1, 0]))
    pitch = float(np.arctan2(-rotation[2, 0], level))
    if level < 1e-9:  # straight up or down: yaw and roll are one
        return float(np.arctan2(-rotation[1, 2], rotation[1, 1])), pitch, 0.0
    return float(np.arctan2(rotation[2, 1], rotation[2, 2])), pitch, float(np.arctan2(rotation[1, 0], rotation[0, 0]))


def _point(payload: Payload, place: Array) -> Mass:
    return Mass(payload.mass, place, np.eye(3), np.zeros(3))


def standing(up: Array) -> Array:
    """Return a rotation whose z-axis points up, shape (3, 3)."""
    if np.allclose(up, -DOWN):
        return np.eye(3)
    x = np.cross(LEVEL if abs(up[1]) < 0.9 else UPRIGHT, up)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(up, x), up])
