"""The structures of `rig.toml`: the properties of joints that a log does not contain.

Every quantity is SI inside; `core.quantities` has the types, `effects` the keys of effects, `parts` what joints are made of,
`roles` where they are recorded.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, field

from vsalog.core.quantities import Base, CornerDeflection, DeflectionScale, SetpointScale
from vsalog.effects.drive import PositionServo
from vsalog.effects.friction import Friction
from vsalog.effects.gravity import Payload
from vsalog.effects.hysteresis import BoucWen, SlipElement
from vsalog.rig.chain import Accelerometer, Chain, ChainLink, Coupling
from vsalog.rig.parts import (
    AwasTransmission,
    CubicTransmission,
    ExponentialTransmission,
    KnownTransmission,
    Lever,
    LinearTransmission,
    Link,
    Motor,
    PolynomialTransmission,
    Transmission,
    TransmissionEffects,
    UnknownTransmission,
    Vsa2Transmission,
)
from vsalog.rig.pneumatic import (
    Air,
    BraidForce,
    ExponentialForce,
    JointFriction,
    LinearForce,
    Muscle,
    MuscleForce,
    PneumaticJoint,
    PneumaticSignals,
    PressureFriction,
    Seesaw,
    SimpleFriction,
    SpringForce,
    TonduFriction,
    Valve,
)
from vsalog.rig.roles import (
    AntagonisticSignals,
    Run,
    SerialSignals,
    Signal,
    SignalSpec,
    SingleSignals,
    role_units,
)

__all__ = [
    "Accelerometer",
    "Air",
    "AntagonisticJoint",
    "AntagonisticSignals",
    "AwasTransmission",
    "Basis",
    "BoucWen",
    "BraidForce",
    "Chain",
    "ChainLink",
    "Coupling",
    "CubicTransmission",
    "ElasticJoint",
    "ExponentialForce",
    "ExponentialTransmission",
    "Friction",
    "Joint",
    "JointFriction",
    "KnownTransmission",
    "Lever",
    "LinearForce",
    "LinearTransmission",
    "Link",
    "Motor",
    "Muscle",
    "MuscleForce",
    "Payload",
    "PneumaticJoint",
    "PneumaticSignals",
    "PolynomialTransmission",
    "PositionServo",
    "PressureFriction",
    "RigFile",
    "RigidJoint",
    "Run",
    "Seesaw",
    "SerialJoint",
    "SerialSignals",
    "Signal",
    "SignalSpec",
    "SimpleFriction",
    "SingleSignals",
    "SlipElement",
    "SpringForce",
    "TonduFriction",
    "Transmission",
    "TransmissionEffects",
    "UnknownTransmission",
    "Valve",
    "Vsa2Transmission",
    "role_units",
]


class Basis(Base, frozen=True):
    """The functions the flexibility torque is fitted with (Flacco 2012 eq. 25–29, 35–36).

    Attributes
    ----------
    order : n, number of terms in φ
    odd : only odd powers φ, φ³, …, φ^(2n−1) (a symmetric transmission); else φ⁰ … φ^(n−1)
    setpoint_order : m, number of powers of the set-point (θ_c or r) each φ-term is multiplied with; 1 without a set-point
    deflection_scale : φ is divided by this before powers are taken [rad]; the log's largest |φ| when absent
    setpoint_scale : the set-point is divided by this [rad or m]; the log's largest when absent
    branches : fit loading (|φ| grows) and unloading separately, for a transmission with hysteresis
    knots : of a quadratic spline on either side of zero, for a spring with a corner or a knee; none when 0
    setpoint_knots : pieces of a quadratic spline along the log's range of the set-point, for a torque that is no polynomial of
        it; none when 0
    corners : deflections at which the stiffness jumps [rad]
    """

    order: Annotated[int, Meta(description="number of terms in the deflection", ge=1, le=20)] = 4
    odd: bool = True
    setpoint_order: Annotated[int, Meta(description="number of powers of the set-point", ge=1, le=10)] = 3
    deflection_scale: DeflectionScale | None = None
    setpoint_scale: SetpointScale | None = None
    branches: bool = False
    knots: Annotated[int, Meta(description="knots on either side of zero", ge=0, le=20)] = 0
    setpoint_knots: Annotated[int, Meta(description="pieces of a spline along the set-point", ge=0, le=20)] = 0
    corners: tuple[CornerDeflection, ...] = ()


class RigidJoint(Base, frozen=True, tag="rigid", tag_field="kind"):
    """A joint whose motor and link move as one: it has no stiffness to estimate, but `diagnose` compares it with a log.

    `drive` is that of a motor that is commanded a position.
    """

    motor: Motor = Motor()
    drive: PositionServo | None = None
    link: Link | None = None
    signals: SingleSignals = SingleSignals()
    differs: tuple[str, ...] = ()


class ElasticJoint(Base, frozen=True, tag="elastic", tag_field="kind"):
    """One motor, one (linear or nonlinear) transmission: a series elastic joint (Flacco 2012 eq. 3–4).

    `drive` is that of a motor that is commanded a position.
    """

    motor: Motor = Motor()
    drive: PositionServo | None = None
    transmission: Transmission = UnknownTransmission()
    link: Link | None = None
    basis: Basis = Basis()
    signals: SingleSignals = SingleSignals()
    differs: tuple[str, ...] = ()
    run: tuple[Run, ...] = ()


class SerialJoint(Base, frozen=True, tag="serial", tag_field="kind"):
    """A primary motor behind one transmission, whose stiffness a secondary motor sets (Flacco 2012 eq. 12).

    `drive` is that of a primary motor that is commanded a position.
    """

    motor: Motor = Motor()
    drive: PositionServo | None = None
    secondary_motor: Motor | None = None
    transmission: Transmission = UnknownTransmission()
    lever: Lever | None = None
    link: Link | None = None
    basis: Basis = Basis()
    signals: SerialSignals = SerialSignals()
    differs: tuple[str, ...] = ()
    run: tuple[Run, ...] = ()


class AntagonisticJoint(Base, frozen=True, tag="antagonistic", tag_field="kind"):
    """Two motors behind two nonlinear transmissions pull one link (Flacco 2012 eq. 7–8)."""

    motor_1: Motor = Motor()
    motor_2: Motor = Motor()
    transmission_1: Transmission = UnknownTransmission()
    transmission_2: Transmission = UnknownTransmission()
    link: Link | None = None
    basis: Basis = Basis()
    signals: AntagonisticSignals = AntagonisticSignals()
    differs: tuple[str, ...] = ()
    run: tuple[Run, ...] = ()


Joint = RigidJoint | ElasticJoint | SerialJoint | AntagonisticJoint | PneumaticJoint


class RigFile(Base, frozen=True):
    """A whole `rig.toml`.

    Attributes
    ----------
    name : of the rig in reports
    preset : name of a preset this file starts from; keys here replace those there
    joint : the joints by name
    chain : the arm that joints form
    """

    name: str = ""
    preset: str | None = None
    joint: dict[str, Joint] = field(default_factory=dict)
    chain: Chain | None = None
