"""The parts of a joint: motor, transmission, link, and their effects. Every effect is absent by default."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, Self, TypeAlias

import numpy as np
from msgspec import Meta
from msgspec.structs import replace
from numpy.typing import NDArray

from vsalog.core.quantities import (
    AddedCubicStiffness,
    Angle,
    AngleRange,
    AngleWidth,
    Base,
    CubicStiffness,
    Damping,
    DeflectionScale,
    Inertia,
    Length,
    LengthPerAngle,
    LinearStiffness,
    Rate,
    Ratio,
    Signed,
    Stiffness,
    TimeSpan,
    Torque,
    TorqueConstant,
    TorqueLevel,
)
from vsalog.effects.friction import Friction
from vsalog.effects.gravity import Payload
from vsalog.effects.hysteresis import BoucWen, SlipElement
from vsalog.rig.effect_tables import Body, composed

Array = NDArray[np.float64]


class MotorCore(Body, frozen=True):
    """A motor and its gear (Flacco 2012 eq. 4). Values are reduced to the joint unless `side` is ``rotor``.

    The acting torque is torque_gain · τ(t − torque_delay) + torque_offset + terms of effects − friction, where τ is the
    recorded one.

    Attributes
    ----------
    inertia : B [kg·m²], needed by residual-rls in its RESIDUAL modality and by the simulation
    damping : D_θ, viscous friction [N·m·s/rad]
    gear_ratio : γ ≥ 1, rotor turns per joint turn
    torque_constant : rotor torque per current [N·m/A]; needed when the motor torque is recorded as a current
    side : ``joint`` when all values are reduced to the joint (B = B_m γ²), ``rotor`` when they are the rotor's own
    friction : dry friction
    torque_gain : acting torque per recorded torque
    torque_offset : acting torque when the recorded one is zero [N·m]
    torque_delay : of the acting after the recorded torque [s]
    torque_step : least step of the commanded torque, a drive's resolution [N·m]; none when absent
    """

    inertia: Inertia | None = None
    damping: Damping = 0.0
    gear_ratio: Ratio = 1.0
    torque_constant: TorqueConstant | None = None
    side: Literal["joint", "rotor"] = "joint"
    friction: Friction = Friction()
    torque_gain: Ratio = 1.0
    torque_offset: Torque = 0.0
    torque_delay: TimeSpan = 0.0
    torque_step: TorqueLevel = 0.0

    @property
    def reflected(self) -> Self:
        """The motor with all values reduced to the joint (Flacco 2012 §2.1: B = B_m γ²); itself if it is given so."""
        if self.side == "joint":
            return self
        ratio = self.gear_ratio
        return replace(
            self,
            side="joint",
            inertia=None if self.inertia is None else self.inertia * ratio**2,
            damping=self.damping * ratio**2,
            friction=self.friction.geared(ratio),
            **self.geared_torques(ratio),
            torque_offset=self.torque_offset * ratio,
            torque_step=self.torque_step * ratio,
        )

    @property
    def reflected_inertia(self) -> float | None:
        """B [kg·m²], reduced to the joint."""
        return self.reflected.inertia

    @property
    def reflected_damping(self) -> float:
        """D_θ [N·m·s/rad], reduced to the joint."""
        return self.reflected.damping


class TransmissionEffects(Base, frozen=True):
    """The effects of any transmission in addition to its spring. With u the deflection less the gap,

    τ = (1 + drift t) (1 ± asymmetry) (τ_spring(u) + added_cubic u³) + damping u̇ + hysteresis(u), with + where u > 0.

    Attributes
    ----------
    damping : of the transmission, D in De Luca 2007 eq. 1 [N·m·s/rad]
    added_cubic : cubic stiffness that the spring has in addition to its nominal torque [N·m/rad³]
    asymmetry : part by which the spring is stiffer at positive than at negative deflection, −1 to 1
    backlash : whole width of the gap in which no torque is transmitted [rad]
    drift : relative change of the spring's torque per second [1/s]
    bouc_wen : hysteresis with a smooth loop
    slip : hysteresis of springs that slip, [[…transmission.slip]]
    """

    damping: Damping = 0.0
    added_cubic: AddedCubicStiffness = 0.0
    asymmetry: Signed = 0.0
    backlash: AngleWidth = 0.0
    drift: Rate = 0.0
    bouc_wen: BoucWen | None = None
    slip: tuple[SlipElement, ...] = ()


class LinearTransmission(TransmissionEffects, frozen=True, kw_only=True, tag="linear", tag_field="type"):
    """τ_e = k φ: a series elastic joint. `stiffness` is k [N·m/rad]."""

    stiffness: Stiffness


class CubicTransmission(TransmissionEffects, frozen=True, kw_only=True, tag="cubic", tag_field="type"):
    """τ_e = k₁ φ + k₃ φ³. `stiffness` is k₁ [N·m/rad], `cubic` is k₃ [N·m/rad³]."""

    stiffness: Stiffness
    cubic: CubicStiffness


class PolynomialTransmission(TransmissionEffects, frozen=True, kw_only=True, tag="polynomial", tag_field="type"):
    """τ_e = Σ c_i (φ/s)^i, i = 1, 2, …: any smooth spring, symmetric or not.

    Attributes
    ----------
    coefficients : c₁, c₂, … [N·m]
    scale : s, the deflection that the powers are taken of [rad]
    """

    coefficients: tuple[Torque, ...]
    scale: DeflectionScale


class ExponentialTransmission(TransmissionEffects, frozen=True, kw_only=True, tag="exponential", tag_field="type"):
    """τ_e = k s sinh(φ/s): an exponential spring on either side. `stiffness` is k [N·m/rad] at rest, `scale` is s [rad]."""

    stiffness: Stiffness
    scale: AngleRange


class Vsa2Transmission(TransmissionEffects, frozen=True, kw_only=True, tag="vsa2", tag_field="type"):
    """The four-bar mechanism of the VSA-II (Flacco 2012 eq. 47–48).

    `stiffness` is the spring's k [N·m/rad], `geometry` is C > 1; the mechanism's singularity is at C sin(φ/2) = 1.
    """

    stiffness: Stiffness
    geometry: Annotated[float, Meta(description="geometric parameter C of the four-bar mechanism", gt=1.0)]


class AwasTransmission(TransmissionEffects, frozen=True, kw_only=True, tag="awas", tag_field="type"):
    """Springs on a lever arm r (Flacco 2012 eq. 49): τ_e = k_s r² sin 2φ. `spring_stiffness` is k_s [N/m]."""

    spring_stiffness: LinearStiffness


class UnknownTransmission(Base, frozen=True, tag="unknown", tag_field="type"):
    """No nominal model is known: the stiffness is estimated nevertheless, but without the MODEL modality."""


KnownTransmission = (
    LinearTransmission
    | CubicTransmission
    | PolynomialTransmission
    | ExponentialTransmission
    | Vsa2Transmission
    | AwasTransmission
)
Transmission = KnownTransmission | UnknownTransmission


class LinkCore(Body, frozen=True):
    """The driven link (Flacco 2012 eq. 3), for the simulation; the estimators work on the motor side.

    Attributes
    ----------
    inertia : M [kg·m²]
    damping : D_q [N·m·s/rad]
    gravity_torque : m g l [N·m], the torque that holds the link horizontal; 0 in a horizontal plane
    gravity_angle : position q at which the link hangs [rad]
    friction : dry friction
    payload : a mass on the link
    """

    inertia: Inertia
    damping: Damping = 0.0
    gravity_torque: Torque = 0.0
    gravity_angle: Angle = 0.0
    friction: Friction = Friction()
    payload: Payload | None = None


if TYPE_CHECKING:
    Motor: TypeAlias = MotorCore
    Link: TypeAlias = LinkCore
else:
    Motor, Link = composed(MotorCore, "motor"), composed(LinkCore, "link")


class Lever(Base, frozen=True):
    """The lever arm for a secondary motor's angle: r = start − travel θ_c (Flacco 2012 eq. 51).

    Where a rig has a lever, a set-point recorded as an angle is converted to the length r.
    """

    start: Length
    travel: LengthPerAngle

    def arm(self, angle: Array) -> Array:
        """Return r [m] at angles θ_c [rad], shape of `angle`."""
        return self.start - self.travel * angle
