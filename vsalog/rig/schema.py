"""The structures of `rig.toml`: everything a log does not say about the joints it was recorded on.

Every quantity is SI inside. The SI unit stands in each field's metadata (``extra["unit"]``), from which the loader
converts strings such as ``"500 N·mm/rad"``, the JSON Schema is generated and `docs/rig.md` is checked.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta, Struct


def _quantity(
    unit: str, description: str, *, gt: float | None = None, ge: float | None = None, alternative: str | None = None
) -> Meta:
    """Describe a number in `unit`, or in `alternative` where a key may hold one of two things."""
    units = (unit,) if alternative is None else (unit, alternative)
    words, extra = f"{description} [{' or '.join(units)}]", {"unit": unit, "units": units}
    # msgspec's stubs know only one bound at a time.
    if gt is not None:
        return Meta(description=words, gt=gt, extra=extra)
    return Meta(description=words, extra=extra) if ge is None else Meta(description=words, ge=ge, extra=extra)


# Fields of this type are numbers in the SI unit named here, or strings with any unit that converts to it.
Inertia = Annotated[float, _quantity("kg*m^2", "moment of inertia", gt=0.0)]
Damping = Annotated[float, _quantity("N*m*s/rad", "viscous friction coefficient", ge=0.0)]
TorqueConstant = Annotated[float, _quantity("N*m/A", "rotor torque per current", gt=0.0)]
Stiffness = Annotated[float, _quantity("N*m/rad", "rotational stiffness", gt=0.0)]
CubicStiffness = Annotated[float, _quantity("N*m/rad^3", "cubic stiffness", ge=0.0)]
LinearStiffness = Annotated[float, _quantity("N/m", "stiffness of a linear spring", gt=0.0)]
Length = Annotated[float, _quantity("m", "length", gt=0.0)]
LengthPerAngle = Annotated[float, _quantity("m/rad", "travel per angle")]
Angle = Annotated[float, _quantity("rad", "angle")]
Torque = Annotated[float, _quantity("N*m", "torque")]
DeflectionScale = Annotated[float, _quantity("rad", "deflection the powers are taken of", gt=0.0)]
SetpointScale = Annotated[float, _quantity("rad", "set-point the powers are taken of", gt=0.0, alternative="m")]
Ratio = Annotated[float, Meta(description="a number without unit", gt=0.0)]


# Numbers whose unit depends on the role they are given for (`ROLE_UNITS`).
RoleValue = Annotated[float, Meta(description="in the role's SI unit", extra={"role": True})]
RoleStep = Annotated[float, Meta(description="in the role's SI unit", gt=0.0, extra={"role": True})]

# What a role may be measured in, before torque constant and lever make a current a torque and an angle a lever arm.
ROLE_UNITS: dict[str, tuple[str, ...]] = {
    "motor_position": ("rad",),
    "link_position": ("rad",),
    "deflection": ("rad",),
    "motor_torque": ("N*m", "A"),
    "torque_sensor": ("N*m",),
    "setpoint": ("rad", "m"),
}


def role_units(role: str) -> tuple[str, ...]:
    """Return the SI units of what a role may be measured in; ``motor_position_1`` is a ``motor_position``."""
    return ROLE_UNITS[role.removesuffix("_1").removesuffix("_2")]


class Base(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """Unknown keys are refused, values never change, and defaults are not written out."""


class Motor(Base, frozen=True):
    """A motor and its gear (Flacco 2012 eq. 4). Inertia and damping are what the joint feels unless `side` says otherwise.

    Attributes
    ----------
    inertia : B [kg·m²], needed by residual-rls in its RESIDUAL modality
    damping : D_θ [N·m·s/rad]
    gear_ratio : γ ≥ 1, rotor turns per joint turn
    torque_constant : rotor torque per current [N·m/A]; needed when the motor torque is recorded as a current
    side : ``joint`` when inertia and damping are reflected through the gear (B = B_m γ²), ``rotor`` when they are the rotor's own
    """

    inertia: Inertia | None = None
    damping: Damping = 0.0
    gear_ratio: Ratio = 1.0
    torque_constant: TorqueConstant | None = None
    side: Literal["joint", "rotor"] = "joint"

    @property
    def reflected_inertia(self) -> float | None:
        """B [kg·m²] as the joint feels it: B_m γ² (Flacco 2012 §2.1)."""
        if self.inertia is None or self.side == "joint":
            return self.inertia
        return self.inertia * self.gear_ratio**2

    @property
    def reflected_damping(self) -> float:
        """D_θ [N·m·s/rad] as the joint feels it: D_θ,m γ² (Flacco 2012 §2.1)."""
        return self.damping if self.side == "joint" else self.damping * self.gear_ratio**2


class LinearTransmission(Base, frozen=True, tag="linear", tag_field="type"):
    """τ_e = k φ: a series elastic joint. `stiffness` is k [N·m/rad]."""

    stiffness: Stiffness


class CubicTransmission(Base, frozen=True, tag="cubic", tag_field="type"):
    """τ_e = k₁ φ + k₃ φ³. `stiffness` is k₁ [N·m/rad], `cubic` is k₃ [N·m/rad³]."""

    stiffness: Stiffness
    cubic: CubicStiffness


class Vsa2Transmission(Base, frozen=True, tag="vsa2", tag_field="type"):
    """The four-bar mechanism of the VSA-II (Flacco 2012 eq. 47–48).

    `stiffness` is the spring's k [N·m/rad], `geometry` is C > 1; the mechanism's singularity is at C sin(φ/2) = 1.
    """

    stiffness: Stiffness
    geometry: Annotated[float, Meta(description="geometric parameter C of the four-bar mechanism", gt=1.0)]


class AwasTransmission(Base, frozen=True, tag="awas", tag_field="type"):
    """Springs on a lever arm r (Flacco 2012 eq. 49): τ_e = k_s r² sin 2φ. `spring_stiffness` is k_s [N/m]."""

    spring_stiffness: LinearStiffness


class UnknownTransmission(Base, frozen=True, tag="unknown", tag_field="type"):
    """No nominal model is known: it is estimated all the same, only the MODEL modality is not available."""


Transmission = LinearTransmission | CubicTransmission | Vsa2Transmission | AwasTransmission | UnknownTransmission


class Link(Base, frozen=True):
    """The driven link (Flacco 2012 eq. 3), used by the simulation only; the estimators here work on the motor side.

    Attributes
    ----------
    inertia : M [kg·m²]
    damping : D_q [N·m·s/rad]
    gravity_torque : m g l [N·m], the torque that holds the link horizontal; 0 in a horizontal plane
    """

    inertia: Inertia
    damping: Damping = 0.0
    gravity_torque: Torque = 0.0


class Lever(Base, frozen=True):
    """How a secondary motor's angle sets the lever arm: r = start − travel θ_c (Flacco 2012 eq. 51).

    Where a rig has a lever, a set-point recorded as an angle is converted to the length r.
    """

    start: Length
    travel: LengthPerAngle


class Basis(Base, frozen=True):
    """The functions the flexibility torque is fitted with (Flacco 2012 eq. 25–29, 35–36).

    Attributes
    ----------
    order : n, number of terms in φ
    odd : only odd powers φ, φ³, …, φ^(2n−1) (a transmission that behaves alike in both directions); else φ⁰ … φ^(n−1)
    setpoint_order : m, number of powers of the set-point (θ_c or r) each φ-term is multiplied with; 1 without a set-point
    deflection_scale : φ is divided by this before powers are taken [rad]; the log's largest |φ| when absent
    setpoint_scale : the set-point is divided by this [rad or m]; the log's largest when absent
    branches : fit loading (|φ| grows) and unloading apart, for a transmission with hysteresis
    """

    order: Annotated[int, Meta(description="number of terms in the deflection", ge=1, le=20)] = 4
    odd: bool = True
    setpoint_order: Annotated[int, Meta(description="number of powers of the set-point", ge=1, le=10)] = 3
    deflection_scale: DeflectionScale | None = None
    setpoint_scale: SetpointScale | None = None
    branches: bool = False


class Signal(Base, frozen=True):
    """Where a role is found in the log, and how its numbers become SI on the joint's side.

    value = sign × (recorded, in SI, divided or multiplied by the gear ratio when `side` is rotor) − offset

    Attributes
    ----------
    channel : name as `vsalog inspect` prints it; ``{run}`` stands for the run's name
    constant : a value instead of a channel (a set-point that does not move)
    unit : of the channel; what the log itself says is used when this is absent, SI when neither says
    side : ``rotor`` when it was measured before the gear: positions are divided, torques multiplied by the gear ratio
    sign : −1 when the recording counts the other way round
    offset : subtracted, in SI
    resolution : least step of the sensor, in SI; taken from the data when absent
    """

    channel: str | None = None
    constant: RoleValue | None = None
    unit: str | None = None
    side: Literal["joint", "rotor"] = "joint"
    sign: Literal[1, -1] = 1
    offset: RoleValue = 0.0
    resolution: RoleStep | None = None


# A role may be given in short, as a channel's name or as a number, or in full, as a table.
SignalSpec = str | float | Signal


class SingleSignals(Base, frozen=True):
    """The roles of a joint with one transmission."""

    motor_position: SignalSpec | None = None
    motor_torque: SignalSpec | None = None
    link_position: SignalSpec | None = None
    deflection: SignalSpec | None = None
    torque_sensor: SignalSpec | None = None


class SerialSignals(SingleSignals, frozen=True):
    """The roles of a serial variable stiffness joint: those of one transmission and the set-point (θ_c, or lever arm r)."""

    setpoint: SignalSpec | None = None


class AntagonisticSignals(Base, frozen=True):
    """The roles of an antagonistic joint: one link, two motors, two transmissions.

    `torque_sensor` is one sensor for the whole joint, `torque_sensor_1` and `torque_sensor_2` are one per transmission.
    """

    motor_position_1: SignalSpec | None = None
    motor_position_2: SignalSpec | None = None
    motor_torque_1: SignalSpec | None = None
    motor_torque_2: SignalSpec | None = None
    link_position: SignalSpec | None = None
    deflection_1: SignalSpec | None = None
    deflection_2: SignalSpec | None = None
    torque_sensor: SignalSpec | None = None
    torque_sensor_1: SignalSpec | None = None
    torque_sensor_2: SignalSpec | None = None


class Run(Base, frozen=True):
    """One stretch of data under a fixed set-point, when a log or a set of logs holds several.

    `name` is what ``{run}`` in the signals' channels stands for (a group inside a file); `file` is a pattern that the
    log's name must match for the run to apply.
    """

    name: str = ""
    file: str = "*"
    setpoint: str | float | None = None


class RigidJoint(Base, frozen=True, tag="rigid", tag_field="kind"):
    """A joint without a compliant transmission: listed for completeness, there is no stiffness to estimate."""

    motor: Motor = Motor()
    link: Link | None = None
    signals: SingleSignals = SingleSignals()


class ElasticJoint(Base, frozen=True, tag="elastic", tag_field="kind"):
    """One motor, one (linear or nonlinear) transmission: a series elastic joint (Flacco 2012 eq. 3–4)."""

    motor: Motor = Motor()
    transmission: Transmission = UnknownTransmission()
    link: Link | None = None
    basis: Basis = Basis()
    signals: SingleSignals = SingleSignals()
    run: tuple[Run, ...] = ()


class SerialJoint(Base, frozen=True, tag="serial", tag_field="kind"):
    """A primary motor behind one transmission, whose stiffness a secondary motor sets (Flacco 2012 eq. 12)."""

    motor: Motor = Motor()
    secondary_motor: Motor | None = None
    transmission: Transmission = UnknownTransmission()
    lever: Lever | None = None
    link: Link | None = None
    basis: Basis = Basis()
    signals: SerialSignals = SerialSignals()
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
    run: tuple[Run, ...] = ()


Joint = RigidJoint | ElasticJoint | SerialJoint | AntagonisticJoint


class RigFile(Base, frozen=True):
    """A whole `rig.toml`.

    Attributes
    ----------
    name : what the rig is called in reports
    preset : name of a preset this file starts from; what stands here replaces what stands there
    joint : the joints by name
    """

    name: str = ""
    preset: str | None = None
    joint: dict[str, Joint] = {}
