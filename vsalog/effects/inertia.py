"""Inertia of a motor and of its link."""

from __future__ import annotations

from vsalog.effects.base import Default, Effect, OneNumber
from vsalog.effects.counterpart import Counterpart, term

EFFECT = Effect(
    tolerances=(
        Default(("inertia",), "from CAD or a data sheet, which leave out couplings, screws and cables", share=0.2),
    ),
    counterparts=(
        Counterpart(
            "motor", ("inertia",), lambda m: term("joint", armature=m.inertia), lambda m: term("rotor", inertia=m.inertia)
        ),
        Counterpart(
            "link", ("inertia",), lambda k: term("inertial", inertia=k.inertia), lambda k: term("inertial", inertia=k.inertia)
        ),
    ),
    causes=(
        # Motor and link that move as one have one inertia: it is the link's.
        OneNumber(
            name="motor.inertia", place="motor", key="inertia", number="inertia", unit="kg*m^2",
            step=lambda s: 0.01 * s.value, low=lambda s: 1e-3 * s.value, where=lambda s: not s.one_body,
            title="The inertia of the {part} differs from the rig",
            says="its motor equation is off in proportion to the motor's acceleration",
            confirm="Accelerate the motor with the link free, or taken off: the torque it needs is its inertia times the "
            "acceleration.",
            reference="Flacco 2012 eq. 4, B",
            signature="motor equation: θ̈",
        ),
        OneNumber(
            name="link.inertia", place="link", key="inertia", number="inertia", unit="kg*m^2",
            step=lambda s: 0.01 * s.value, low=lambda s: 1e-3 * s.value, doubles=("motor.inertia",),
            doubled=lambda s: s.one_body and s.rotor, order=-1,
            title="The inertia of the link differs from the rig",
            says="the link's equation is off in proportion to its acceleration",
            confirm="Clamp the motor and let the link swing on the spring: its frequency gives the inertia.",
            reference="Flacco 2012 eq. 3, M",
            signature="link equation: q̈",
        ),
    ),
)  # fmt: skip
