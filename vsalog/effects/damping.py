"""Viscous friction of motors, links and transmissions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from vsalog.effects.base import Default, Effect, OneNumber
from vsalog.effects.counterpart import BODIES, Counterpart, Lack, Term, term


def _tendon(transmission: Any) -> Iterator[Term | Lack]:
    if transmission.backlash > 0.0:
        yield Lack("damping", "the damper of a tendon acts within the gap of a backlash too")
    else:
        yield Term("spring", {"damping": transmission.damping})


EFFECT = Effect(
    tolerances=(
        Default(
            ("damping", "presliding_damping", "viscous"),
            "a factor of 3 upwards: a lubricant thins by as much from 20 to 50 °C",
            share=2.0,
            share_of_scale=0.1,
        ),
    ),
    counterparts=(
        *(
            Counterpart(
                part, ("damping",), lambda p: term("joint", damping=p.damping), lambda p: term("dynamics", damping=p.damping)
            )
            for part in BODIES
        ),
        Counterpart("transmission", ("damping",), _tendon),
    ),
    causes=(
        OneNumber(
            name="motor.viscous_friction", place="motor", key="damping", number="damping", unit="N*m*s/rad",
            step=lambda s: 0.01 * s.torque / s.speed, low=0.0, scale=lambda s: s.torque / s.speed,
            title="The friction of the {part} that grows with its speed differs from the rig",
            says="its motor equation is off in proportion to the motor's velocity",
            confirm="Let the motor turn at several constant speeds without load: the torque it needs rises in a straight line.",
            reference="Flacco 2012 eq. 4, D_θ",
            signature="motor equation: θ̇",
        ),
        # Of a link that is one with its motor it is the motor's.
        OneNumber(
            name="link.viscous_friction", place="link", key="damping", number="damping", unit="N*m*s/rad",
            step=lambda s: 0.01 * s.torque / s.speed, low=0.0, scale=lambda s: s.torque / s.speed,
            where=lambda s: not s.one_body,
            title="The friction of the link that grows with its speed differs from the rig",
            says="the link's equation is off in proportion to its velocity",
            confirm="Clamp the motor, let the link ring and see how fast the ringing fades.",
            reference="Flacco 2012 eq. 3, D_q",
            signature="link equation: q̇",
        ),
        OneNumber(
            name="transmission.damping", place="transmission", key="damping", number="damping", unit="N*m*s/rad",
            step=lambda s: 1e-4 * (s.torque / s.deflection), low=0.0, scale=lambda s: s.torque / s.speed,
            title="The damping of the {part} differs from the rig",
            says="the torque it transmits is off in proportion to the deflection's rate",
            confirm="Clamp the motor, deflect the link and let go: see how fast the ringing fades, with the link's own "
            "friction known.",
            reference="De Luca 2007 eq. 1, D",
            signature="transmission equation: φ̇",
        ),
    ),
)  # fmt: skip
