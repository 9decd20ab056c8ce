"""A joint whose motor and link move as one: one inertia, one friction, one position."""

from __future__ import annotations

from msgspec.structs import replace

from vsalog.rig.parts import Friction, Link, Motor


def as_one(motor: Motor, link: Link | None) -> Link:
    """Return what a motor and its link are together, as the joint feels them: B + M, D_θ + D_q, both dry frictions.

    What makes friction depend on the load is the weight that the gear carries.
    """
    motor = motor.reflected
    if link is None:
        return Link(inertia=motor.inertia or 0.0, damping=motor.damping, friction=motor.friction)
    return replace(
        link,
        inertia=link.inertia + (motor.inertia or 0.0),
        damping=link.damping + motor.damping,
        friction=_both(motor.friction, link.friction),
    )


def _both(one: Friction, other: Friction) -> Friction:
    """Return two dry frictions at one shaft; of two Stribeck speeds or bristles it has the first one's."""
    if other == Friction():
        return one
    if one == Friction():
        return other
    falls = one.static is not None or other.static is not None
    bristled = one if one.presliding_stiffness is not None else other
    return Friction(
        coulomb=one.coulomb + other.coulomb,
        static=one.breakaway + other.breakaway if falls else None,
        stribeck_velocity=one.stribeck_velocity if one.stribeck_velocity is not None else other.stribeck_velocity,
        load=one.load + other.load,
        presliding_stiffness=bristled.presliding_stiffness,
        presliding_damping=bristled.presliding_damping,
    )
