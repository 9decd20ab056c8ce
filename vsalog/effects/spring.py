"""A spring's shape in addition to its nominal law: an added cubic, unlike directions, drift."""

from __future__ import annotations

from vsalog.effects.base import Default, Effect, OneNumber
from vsalog.effects.counterpart import Counterpart, term


def stiffened(drift: float, t: float, side: float, asymmetry: float) -> float:
    """Return how many times its nominal torque a spring has: (1 + drift t) (1 ± asymmetry); `side` is +1 or −1."""
    return (1.0 + drift * t) * (1.0 + side * asymmetry)


EFFECT = Effect(
    counterparts=(
        Counterpart("transmission", ("added_cubic",), lambda t: term("spring", cubic=t.added_cubic)),
        Counterpart("transmission", ("asymmetry",), lambda t: term("spring", asymmetry=t.asymmetry)),
    ),
    tolerances=(
        Default(("added_cubic",), "a spring keeps to its law within 10 %", share=0.5, share_of_scale=0.1),
        Default(("asymmetry",), "the two directions are two springs, ± 10 % each", least="0.1"),
    ),
    causes=(
        OneNumber(
            name="transmission.nonlinearity", place="transmission", key="added_cubic", number="cubic",
            unit="N*m/rad^3", step=lambda s: 1e-3 * (s.torque / s.deflection**3),
            scale=lambda s: s.torque / s.deflection**3,
            title="The spring of the {part} hardens or softens with its deflection, unlike that of the rig",
            says="the torque it transmits is off by the cube of the deflection",
            confirm="Clamp the link and load the joint slowly up to the largest deflection: the curve is not straight.",
            reference="Flacco 2012 eq. 25: higher powers of φ",
            signature="transmission equation: φ³",
        ),
        OneNumber(
            name="transmission.asymmetry", place="transmission", key="asymmetry", number="asymmetry", unit="1",
            step=1e-3, low=-0.95, high=0.95,
            title="The spring of the {part} is stiffer one way than the other, and the rig has it alike",
            says="the torque it transmits is off by opposite factors at positive and negative deflection",
            confirm="Clamp the link and load the joint slowly both ways: compare the two slopes.",
            reference="Flacco 2014 eq. 7: even powers of φ",
            signature="transmission equation: |τ_e(φ)|",
        ),
        OneNumber(
            name="transmission.stiffness_drift", place="transmission", key="drift", number="rate", unit="1/s",
            step=lambda s: 0.01 * (0.9 / s.duration), low=lambda s: -(0.9 / s.duration),
            high=lambda s: 10.0 * (0.9 / s.duration), scale=lambda s: 1.0 / s.duration,
            title="The spring of the {part} becomes stiffer or softer in the course of the log, and the rig has it constant",
            says="the torque it transmits is off by a factor that grows with time",
            confirm="Repeat the same slow loading in the beginning and at the end: compare the slopes.",
            reference="creep and warming of elastomers",
            signature="transmission equation: t τ_e(φ)",
        ),
    ),
)  # fmt: skip
