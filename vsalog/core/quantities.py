"""The types of a rig's numbers, each with its SI unit, its meaning, and its possible values.

The SI unit is in the type's metadata (``extra["unit"]``), from which the loader converts strings such as
``"500 N·mm/rad"``, the JSON Schema is generated and `docs/reference/rig` is checked.
"""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct


def quantity(
    unit: str,
    description: str,
    *,
    gt: float | None = None,
    ge: float | None = None,
    alternative: str | None = None,
    exact: bool = False,
) -> Meta:
    """Describe a number in `unit`, or in `alternative` where a key may hold one of two things; an exact one is chosen."""
    units = (unit,) if alternative is None else (unit, alternative)
    words, extra = f"{description} [{' or '.join(units)}]", {"unit": unit, "units": units, "exact": exact}
    # msgspec's stubs know only one bound at a time.
    if gt is not None:
        return Meta(description=words, gt=gt, extra=extra)
    return Meta(description=words, extra=extra) if ge is None else Meta(description=words, ge=ge, extra=extra)


# Fields of this type are numbers in the SI unit named here, or strings with any unit that converts to it.
Acceleration = Annotated[float, quantity("m/s^2", "acceleration")]
Angle = Annotated[float, quantity("rad", "angle")]
AngularAcceleration = Annotated[float, quantity("rad/s^2", "angular acceleration", gt=0.0)]
AngleRange = Annotated[float, quantity("rad", "angle", gt=0.0)]
AngleWidth = Annotated[float, quantity("rad", "angle", ge=0.0)]
BodyInertia = Annotated[float, quantity("kg*m^2", "moment of inertia about the centre of mass", ge=0.0)]
Coordinate = Annotated[float, quantity("m", "coordinate")]
CoupledInertia = Annotated[float, quantity("kg*m^2", "inertia that couples a motor to a link")]
CubicStiffness = Annotated[float, quantity("N*m/rad^3", "cubic stiffness", ge=0.0)]
AddedCubicStiffness = Annotated[float, quantity("N*m/rad^3", "cubic stiffness")]
CornerDeflection = Annotated[float, quantity("rad", "deflection at which a stiffness jumps", exact=True)]
Damping = Annotated[float, quantity("N*m*s/rad", "viscous friction coefficient", ge=0.0)]
DeflectionScale = Annotated[float, quantity("rad", "deflection the powers are taken of", gt=0.0, exact=True)]
Duration = Annotated[float, quantity("s", "duration", gt=0.0)]
Inertia = Annotated[float, quantity("kg*m^2", "moment of inertia", gt=0.0)]
IntegralGain = Annotated[float, quantity("N*m/(rad*s)", "torque per integral of an angle", ge=0.0)]
Length = Annotated[float, quantity("m", "length", gt=0.0)]
LengthPerAngle = Annotated[float, quantity("m/rad", "travel per angle")]
LinearStiffness = Annotated[float, quantity("N/m", "stiffness of a linear spring", gt=0.0)]
Mass = Annotated[float, quantity("kg", "mass", ge=0.0)]
Rate = Annotated[float, quantity("1/s", "relative change per second")]
SetpointScale = Annotated[
    float, quantity("rad", "set-point the powers are taken of", gt=0.0, alternative="m", exact=True)
]
Speed = Annotated[float, quantity("rad/s", "angular velocity", gt=0.0)]
Stiffness = Annotated[float, quantity("N*m/rad", "rotational stiffness", gt=0.0)]
Time = Annotated[float, quantity("s", "time")]
TimeSpan = Annotated[float, quantity("s", "time", ge=0.0)]
Torque = Annotated[float, quantity("N*m", "torque")]
TorqueConstant = Annotated[float, quantity("N*m/A", "rotor torque per current", gt=0.0)]
TorqueLimit = Annotated[float, quantity("N*m", "torque", gt=0.0)]
TorqueLevel = Annotated[float, quantity("N*m", "torque", ge=0.0)]

# Of pneumatic joints.
AngularReturn = Annotated[float, quantity("N*m/rad", "torque per angle")]
AreaPerLength = Annotated[float, quantity("m", "change of an area per length")]
EffectiveArea = Annotated[float, quantity("m^2", "force per pressure")]
Force = Annotated[float, quantity("N", "force")]
ForcePerLength = Annotated[float, quantity("N/m", "force per length")]
ForcePerLengthCubed = Annotated[float, quantity("N/m^3", "force per length cubed")]
ForcePerLengthPressure = Annotated[float, quantity("N/(m^2*Pa)", "force per length squared and pressure")]
ForcePerLengthPressureSquared = Annotated[float, quantity("N/(m*Pa^2)", "force per length and pressure squared")]
ForcePerPressure = Annotated[float, quantity("N/Pa", "force per pressure")]
GasConstant = Annotated[float, quantity("J/(kg*K)", "specific gas constant", gt=0.0)]
OrificeArea = Annotated[float, quantity("m^2", "area of an orifice", ge=0.0)]
PitchAngle = Annotated[float, quantity("rad", "angle of the threads", gt=0.0)]
Pressure = Annotated[float, quantity("Pa", "absolute pressure", gt=0.0)]
Temperature = Annotated[float, quantity("K", "absolute temperature", gt=0.0)]
TorqueTimesPressureSquared = Annotated[float, quantity("N*m*Pa^2", "torque times pressure squared", ge=0.0)]
Voltage = Annotated[float, quantity("V", "voltage")]
Volume = Annotated[float, quantity("m^3", "volume")]
VolumePerLength = Annotated[float, quantity("m^2", "volume per length")]
VolumePerLengthSquared = Annotated[float, quantity("m", "volume per length squared")]

# Numbers without a unit.
Order = Annotated[float, Meta(description="periods per turn", gt=0.0, extra={"exact": True})]
CountsPerTurn = Annotated[float, Meta(description="encoder counts per turn", ge=1.0, extra={"exact": True})]
Ratio = Annotated[float, Meta(description="a number without unit", gt=0.0)]
Share = Annotated[float, Meta(description="a number without unit, zero or more", ge=0.0)]
Fraction = Annotated[float, Meta(description="a share of the whole, 0 to 1", ge=0.0, le=1.0)]
Signed = Annotated[float, Meta(description="a number without unit", ge=-1.0, le=1.0)]

# Numbers whose unit depends on the role they are given for.
RoleValue = Annotated[float, Meta(description="in the role's SI unit", extra={"role": True})]
RoleStep = Annotated[float, Meta(description="in the role's SI unit", gt=0.0, extra={"role": True})]
RoleSpread = Annotated[float, Meta(description="in the role's SI unit", ge=0.0, extra={"role": True})]
RoleRate = Annotated[float, Meta(description="in the role's SI unit per second", extra={"role": True})]


class Base(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True, omit_defaults=True):
    """Unknown keys are refused, values never change, and defaults are not written out."""
