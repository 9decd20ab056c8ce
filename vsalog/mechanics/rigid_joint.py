"""A joint whose motor and link move as one: one inertia, one friction, one position."""

from __future__ import annotations

from msgspec.structs import replace

from vsalog.rig.parts import Link, Motor


def as_one(motor: Motor, link: Link | None) -> Link:
    """Return what a motor and its link are together, as the joint feels them: B + M, D_θ + D_q, both dry frictions.

    The load of load-dependent friction is the weight that the gear carries.
    """
    motor = motor.reflected
    if link is None:
        return Link(inertia=motor.inertia or 0.0, damping=motor.damping, friction=motor.friction)
    return replace(
        link,
        inertia=link.inertia + (motor.inertia or 0.0),
        damping=link.damping + motor.damping,
        friction=motor.friction.along_with(link.friction),
    )
