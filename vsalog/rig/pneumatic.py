"""The parts of a joint with two pneumatic artificial muscles (PAM): Shin, Ibayashi, Kogiso (2021), their Tables I and II.

Muscle 1 pulls towards positive angles. Pressures are absolute. Every effect beyond the paper's model is absent by default.
"""

from __future__ import annotations

from math import pi
from typing import Annotated

from msgspec import Meta

from vsalog.core.quantities import (
    Acceleration,
    Angle,
    AngularReturn,
    AreaPerLength,
    Base,
    Damping,
    EffectiveArea,
    Force,
    ForcePerLength,
    ForcePerLengthCubed,
    ForcePerLengthPressure,
    ForcePerLengthPressureSquared,
    ForcePerPressure,
    Fraction,
    GasConstant,
    Inertia,
    Length,
    Mass,
    OrificeArea,
    PitchAngle,
    Pressure,
    Ratio,
    Share,
    Speed,
    Temperature,
    TorqueLevel,
    TorqueTimesPressureSquared,
    Voltage,
    Volume,
    VolumePerLength,
    VolumePerLengthSquared,
)
from vsalog.rig.roles import Run, SignalSpec

HeatRatio = Annotated[float, Meta(description="ratio of specific heats", gt=1.0)]


class Air(Base, frozen=True):
    """The supply, the surroundings and the gas between them (Shin 2021 eq. 4–5).

    Attributes
    ----------
    supply_pressure : P_tank, absolute [Pa]
    outside_pressure : P_out, absolute [Pa]
    inflow_index : k₁, polytropic index of the flow term
    volume_index : k₂, polytropic index of the volume term; air that is locked in keeps P V^k₂
    heat_ratio : k of the valve's flow; it sets the critical pressure ratio (2/(k + 1))^(k/(k − 1)), 0.528 for air
    gas_constant : R [J/(kg·K)]
    temperature : T, absolute [K]
    """

    supply_pressure: Pressure
    outside_pressure: Pressure
    inflow_index: Ratio
    volume_index: Ratio
    heat_ratio: HeatRatio = 1.4
    gas_constant: GasConstant = 287.0
    temperature: Temperature = 293.0


class Valve(Base, frozen=True):
    """A proportional directional control valve: flow = A₀ (α m_in − (1 − α) m_out) with α = κ(voltage + offset).

    A₀ is area_scale · inflow_area where the sum is positive, else area_scale · outflow_area (Shin 2021 §II-B2).

    Attributes
    ----------
    inflow_area : A₁, effective area of the orifice for a flow into the muscle [m²]
    outflow_area : A₂, for a flow out of it [m²]
    voltage : points of the map κ, rising [V]
    opening : α at these points, 0 to 1, never falling; straight lines between them, constant outside
    area_scale : both areas are this many times as large
    offset : voltage that the valve adds to its command [V]
    """

    inflow_area: OrificeArea
    outflow_area: OrificeArea
    voltage: tuple[Voltage, ...]
    opening: tuple[Fraction, ...]
    area_scale: Ratio = 1.0
    offset: Voltage = 0.0


class LinearForce(Base, frozen=True, tag="linear", tag_field="type"):
    """F = v P + w with v = area_slope · l + area and w = passive_slope · l + passive (Shin 2021 eq. 6–7), P absolute.

    Attributes
    ----------
    area_slope : p_v1 [m]
    area : p_v2 [m²]
    passive_slope : p_w1 [N/m]
    passive : p_w2 [N]
    """

    area_slope: AreaPerLength
    area: EffectiveArea
    passive_slope: ForcePerLength
    passive: Force


class BraidForce(Base, frozen=True, tag="braid", tag_field="type"):
    """F = π r₀² p (a (1 − ε)² − b), a = 3/tan²α₀, b = 1/sin²α₀: the braid's geometry alone (Tondu and Lopez 2000 eq. 5).

    p is the pressure above the outside one, ε = 1 − l / rest_length the contraction.

    Attributes
    ----------
    rest_length : length without pressure and load [m]
    rest_radius : r₀ [m]
    braid_angle : α₀ between threads and axis at rest, above 0 and below 90° [rad]
    """

    rest_length: Length
    rest_radius: Length
    braid_angle: PitchAngle


class ExponentialForce(Base, frozen=True, tag="exponential", tag_field="type"):
    """F = (a₁ p + a₂) exp(a₃ ε) + a₄ p ε + a₅ p + a₆: six fitted numbers (the form of Sárosi 2012).

    p is the pressure above the outside one, ε = 1 − l / rest_length the contraction (not in per cent).

    Attributes
    ----------
    rest_length : length without pressure and load [m]
    a1 : [N/Pa]
    a2 : [N]
    a3 : exponent, negative for a force that falls as the muscle shortens
    a4, a5 : [N/Pa]
    a6 : [N]
    """

    rest_length: Length
    a1: ForcePerPressure
    a2: Force
    a3: Annotated[float, Meta(description="a number without unit")]
    a4: ForcePerPressure
    a5: ForcePerPressure
    a6: Force


class SpringForce(Base, frozen=True, tag="spring", tag_field="type"):
    """F = (c₀ + c₁ s² + c₂ p s + c₃ p²) s, a spring of stretch s (the form of Wickramatunge and Leephakpreeda 2010).

    p is the pressure above the outside one, s = l − rest_length; the rest length is that of the fullest contraction.

    Attributes
    ----------
    rest_length : [m]
    c0 : [N/m]
    c1 : [N/m³]
    c2 : [N/(m²·Pa)]
    c3 : [N/(m·Pa²)]
    """

    rest_length: Length
    c0: ForcePerLength
    c1: ForcePerLengthCubed
    c2: ForcePerLengthPressure
    c3: ForcePerLengthPressureSquared


MuscleForce = LinearForce | BraidForce | ExponentialForce | SpringForce


class Muscle(Base, frozen=True):
    """A pneumatic artificial muscle. Its volume is D₁ l² + D₂ l + D₃ of the length l (Shin 2021 eq. 3).

    Attributes
    ----------
    length : L₀, at the joint's angle 0 [m]
    volume_curvature : D₁ [m]
    volume_slope : D₂ [m²]
    volume_constant : D₃ [m³]
    force : its law over pressure and length
    force_gain : the muscle pulls this many times as strongly
    leak_area : of a hole from the muscle to the outside [m²]; tight when absent
    """

    length: Length
    volume_curvature: VolumePerLengthSquared
    volume_slope: VolumePerLength
    volume_constant: Volume
    force: MuscleForce
    force_gain: Ratio = 1.0
    leak_area: OrificeArea = 0.0


class Seesaw(Base, frozen=True):
    """The part that the muscles turn: J ψ̈ = τ − T_f − k_s ψ + τ_ext, τ = r cos ψ (F₁ − F₂) (Shin 2021 eq. 2, 8, 9).

    Attributes
    ----------
    radius : r, from the axis to a muscle's end [m]
    inertia : J [kg·m²]
    return_stiffness : k_s, torque per angle of the seesaw's own weight [N·m/rad]
    mass : M, of which the shaft is relieved by the muscles' pull [kg]
    gravity : g [m/s²]
    held_at : the angle at which the seesaw is clamped, as when the torque is measured [rad]; free when absent
    """

    radius: Length
    inertia: Inertia
    return_stiffness: AngularReturn = 0.0
    mass: Mass = 0.0
    gravity: Acceleration = 9.81
    held_at: Angle | None = None


class PressureFriction(Base, frozen=True, tag="pressure", tag_field="type"):
    """Viscous and dry friction, T_f = c_s ψ̇ + (T_s + T_p) sgn ψ̇ (Shin 2021 eq. 10 with T_s and T_p added).

    The shaft's level is T_s = shaft_radius · shaft_coefficient · |F₁ + F₂ − M g|, that of tube and mesh
    T_p = muscle · (1/(P₁ − P_out)² + 1/(P₂ − P_out)²).

    Attributes
    ----------
    shaft_radius : r_p [m]
    viscous : c_s [N·m·s/rad]
    shaft_coefficient : μ_s
    muscle : T_p′ (μ_p in the text) [N·m·Pa²]
    """

    shaft_radius: Length
    viscous: Damping = 0.0
    shaft_coefficient: Share = 0.0
    muscle: TorqueTimesPressureSquared = 0.0


class SimpleFriction(Base, frozen=True, tag="simple", tag_field="type"):
    """T_f = level · sgn ψ̇ (Shin 2021 §IV-B, model 2).

    Attributes
    ----------
    level : F_r as a torque on the joint [N·m]
    """

    level: TorqueLevel


class TonduFriction(Base, frozen=True, tag="tondu", tag_field="type"):
    """T_f = sgn ψ̇ ((static − kinetic) exp(−|ψ̇| / speed) + kinetic) (Shin 2021 §IV-B, model 3).

    Attributes
    ----------
    static : f_s as a torque on the joint, at least `kinetic` [N·m]
    kinetic : f_k [N·m]
    speed : ẋ_k, over which the level falls [rad/s]
    """

    static: TorqueLevel
    kinetic: TorqueLevel
    speed: Speed


JointFriction = PressureFriction | SimpleFriction | TonduFriction


class PneumaticSignals(Base, frozen=True):
    """The roles of a pneumatic joint.

    `torque_sensor` is a torque meter on the joint, `pressure_1` and `pressure_2` are the muscles' absolute pressures, `valve_1`
    and `valve_2` the voltages commanded; `external_torque` is a push on the joint.
    """

    link_position: SignalSpec | None = None
    torque_sensor: SignalSpec | None = None
    pressure_1: SignalSpec | None = None
    pressure_2: SignalSpec | None = None
    valve_1: SignalSpec | None = None
    valve_2: SignalSpec | None = None
    external_torque: SignalSpec | None = None


class PneumaticJoint(Base, frozen=True, tag="pneumatic", tag_field="kind"):
    """Two pneumatic muscles pull one seesaw from either side, each filled by a valve of its own (Shin 2021 eq. 2–11)."""

    air: Air
    valve_1: Valve
    valve_2: Valve
    muscle_1: Muscle
    muscle_2: Muscle
    seesaw: Seesaw
    friction: JointFriction | None = None
    signals: PneumaticSignals = PneumaticSignals()
    differs: tuple[str, ...] = ()
    run: tuple[Run, ...] = ()


def pneumatic_problem(joint: PneumaticJoint) -> tuple[tuple[str, ...], str] | None:
    """Return the key of the first contradiction in a pneumatic joint and its description; None when there is none."""
    if joint.air.supply_pressure <= joint.air.outside_pressure:
        return ("air", "supply_pressure"), "has to be above 'outside_pressure'; both are absolute pressures"
    for key, valve in (("valve_1", joint.valve_1), ("valve_2", joint.valve_2)):
        if len(valve.voltage) != len(valve.opening) or len(valve.voltage) < 2:
            return (key, "opening"), "the map needs at least two points, and one opening for each voltage"
        if any(b <= a for a, b in zip(valve.voltage, valve.voltage[1:], strict=False)):
            return (key, "voltage"), "each voltage has to be above the one before"
        if any(b < a for a, b in zip(valve.opening, valve.opening[1:], strict=False)):
            return (key, "opening"), "the opening cannot fall as the voltage rises; exchange the muscle's ports instead"
    for key, muscle in (("muscle_1", joint.muscle_1), ("muscle_2", joint.muscle_2)):
        if isinstance(muscle.force, BraidForce) and muscle.force.braid_angle >= 0.5 * pi:
            return (key, "force", "braid_angle"), "has to be below 90°; it is the threads' angle to the muscle's axis"
        l0 = muscle.length
        volume = (muscle.volume_curvature * l0 + muscle.volume_slope) * l0 + muscle.volume_constant
        if volume <= 0.0:
            return (key,), f"the volume at the length {l0:g} m would be {volume:g} m³; check volume_… and their signs"
    if isinstance(joint.friction, TonduFriction) and joint.friction.static < joint.friction.kinetic:
        return ("friction", "static"), "cannot be below 'kinetic'"
    return None
