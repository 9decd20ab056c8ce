"""The built-in units, and the names of dimensions."""

from __future__ import annotations

from math import pi

from scipy import constants

# Exponents of length, mass, time, current, temperature, amount, luminosity; and of the angle, which counts as 1.
Dimension = tuple[float, ...]


def _dimension(
    length: float = 0.0,
    mass: float = 0.0,
    time: float = 0.0,
    current: float = 0.0,
    temperature: float = 0.0,
    angle: float = 0.0,
) -> Dimension:
    return (length, mass, time, current, temperature, 0.0, 0.0, angle)


ONE = _dimension()
ANGLE = _dimension(angle=1.0)
LENGTH = _dimension(length=1.0)
MASS = _dimension(mass=1.0)
TIME = _dimension(time=1.0)
CURRENT = _dimension(current=1.0)
TEMPERATURE = _dimension(temperature=1.0)
FREQUENCY = _dimension(time=-1.0)
ANGULAR_VELOCITY = _dimension(time=-1.0, angle=1.0)
ACCELERATION = _dimension(length=1.0, time=-2.0)
FORCE = _dimension(length=1.0, mass=1.0, time=-2.0)
TORQUE = _dimension(length=2.0, mass=1.0, time=-2.0)
PRESSURE = _dimension(length=-1.0, mass=1.0, time=-2.0)
POWER = _dimension(length=2.0, mass=1.0, time=-3.0)
VOLTAGE = _dimension(length=2.0, mass=1.0, time=-3.0, current=-1.0)
RESISTANCE = _dimension(length=2.0, mass=1.0, time=-3.0, current=-2.0)
FLUX_DENSITY = _dimension(mass=1.0, time=-2.0, current=-1.0)


ATOMS: dict[str, tuple[float, Dimension]] = {
    **dict.fromkeys(("rad", "radian", "radians"), (1.0, ANGLE)),
    **dict.fromkeys(("mrad", "milliradian", "milliradians"), (1e-3, ANGLE)),
    "urad": (1e-6, ANGLE),
    **dict.fromkeys(("deg", "°", "degree", "degrees", "degs"), (pi / 180.0, ANGLE)),
    "mdeg": (pi / 180e3, ANGLE),
    **dict.fromkeys(("arcmin", "arcminute"), (pi / 10800.0, ANGLE)),
    **dict.fromkeys(("arcsec", "arcsecond"), (pi / 648000.0, ANGLE)),
    **dict.fromkeys(
        ("rev", "revs", "turn", "turns", "rotation", "rotations", "revolution", "revolutions"), (2.0 * pi, ANGLE)
    ),
    "rpm": (pi / 30.0, ANGULAR_VELOCITY),
    **dict.fromkeys(("m", "meter", "meters", "metre", "metres"), (1.0, LENGTH)),
    **dict.fromkeys(("mm", "millimeter", "millimeters", "millimetre", "millimetres"), (1e-3, LENGTH)),
    "cm": (1e-2, LENGTH),
    "um": (1e-6, LENGTH),
    "km": (1e3, LENGTH),
    **dict.fromkeys(("inch", "inches", "in"), (constants.inch, LENGTH)),
    **dict.fromkeys(("ft", "foot", "feet"), (constants.foot, LENGTH)),
    **dict.fromkeys(("kg", "kilogram", "kilograms"), (1.0, MASS)),
    **dict.fromkeys(("g", "gram", "grams"), (1e-3, MASS)),
    "mg": (1e-6, MASS),
    "lb": (constants.pound, MASS),
    "oz": (constants.pound / 16.0, MASS),
    **dict.fromkeys(("s", "sec", "second", "seconds"), (1.0, TIME)),
    "ms": (1e-3, TIME),
    "us": (1e-6, TIME),
    "ns": (1e-9, TIME),
    **dict.fromkeys(("min", "minute", "minutes"), (60.0, TIME)),
    **dict.fromkeys(("h", "hour", "hours"), (3600.0, TIME)),
    **dict.fromkeys(("Hz", "hertz"), (1.0, FREQUENCY)),
    "kHz": (1e3, FREQUENCY),
    **dict.fromkeys(("A", "amp", "amps", "ampere", "amperes"), (1.0, CURRENT)),
    "mA": (1e-3, CURRENT),
    "uA": (1e-6, CURRENT),
    **dict.fromkeys(("N", "newton", "newtons"), (1.0, FORCE)),
    "mN": (1e-3, FORCE),
    "kN": (1e3, FORCE),
    "kgf": (constants.g, FORCE),
    "gf": (constants.g * 1e-3, FORCE),
    "lbf": (constants.lbf, FORCE),
    "ozf": (constants.lbf / 16.0, FORCE),
    **dict.fromkeys(("Nm", "newtonmeter", "newtonmeters"), (1.0, TORQUE)),
    "mNm": (1e-3, TORQUE),
    "Nmm": (1e-3, TORQUE),
    "Ncm": (1e-2, TORQUE),
    "kNm": (1e3, TORQUE),
    "uNm": (1e-6, TORQUE),
    "mNmm": (1e-6, TORQUE),
    **dict.fromkeys(("J", "joule", "joules"), (1.0, TORQUE)),
    **dict.fromkeys(("Pa", "pascal", "pascals"), (1.0, PRESSURE)),
    "hPa": (1e2, PRESSURE),
    "kPa": (1e3, PRESSURE),
    "MPa": (1e6, PRESSURE),
    "bar": (1e5, PRESSURE),
    "mbar": (1e2, PRESSURE),
    "psi": (constants.lbf / constants.inch**2, PRESSURE),
    "atm": (101325.0, PRESSURE),
    "W": (1.0, POWER),
    "mW": (1e-3, POWER),
    "kW": (1e3, POWER),
    **dict.fromkeys(("V", "volt", "volts"), (1.0, VOLTAGE)),
    "mV": (1e-3, VOLTAGE),
    **dict.fromkeys(("Ω", "ohm", "ohms"), (1.0, RESISTANCE)),
    "T": (1.0, FLUX_DENSITY),
    "K": (1.0, TEMPERATURE),
    "g_n": (constants.g, ACCELERATION),
    "%": (1e-2, ONE),
}

# A factor cannot convert these, even where a temperature is wanted.
OFFSET_UNITS = frozenset({"degC", "°C", "degF", "°F", "celsius", "Celsius", "fahrenheit", "degreeC", "degree_Celsius"})

COUNTS = frozenset(
    ("count", "counts", "cnt", "cnts", "cts", "tic", "tics", "tick", "ticks", "lsb", "pulse", "pulses", "increment", "increments")
)  # fmt: skip
"""Names of an encoder's steps, which are no unit until the counts per turn are known."""

KINDS: dict[Dimension, str] = {
    ANGLE: "an angle",
    ONE: "a plain number",
    LENGTH: "a length",
    MASS: "a mass",
    TIME: "a time",
    CURRENT: "a current",
    TEMPERATURE: "a temperature",
    FREQUENCY: "a frequency",
    ANGULAR_VELOCITY: "an angular velocity",
    _dimension(length=2.0): "an area",
    _dimension(length=3.0): "a volume",
    _dimension(length=1.0, time=-1.0): "a velocity",
    ACCELERATION: "an acceleration",
    _dimension(time=-2.0, angle=1.0): "an angular acceleration",
    FORCE: "a force",
    TORQUE: "a torque",
    PRESSURE: "a pressure",
    POWER: "a power",
    VOLTAGE: "a voltage",
    RESISTANCE: "a resistance",
    FLUX_DENSITY: "a magnetic flux density",
    _dimension(length=2.0, mass=1.0): "a moment of inertia",
    _dimension(mass=1.0, time=-2.0): "the stiffness of a linear spring",
    _dimension(length=2.0, mass=1.0, time=-2.0, angle=-1.0): "a rotational stiffness",
    _dimension(length=2.0, mass=1.0, time=-2.0, angle=-3.0): "a cubic rotational stiffness",
    _dimension(length=2.0, mass=1.0, time=-1.0, angle=-1.0): "a viscous friction coefficient",
    _dimension(length=2.0, mass=1.0, time=-2.0, current=-1.0): "a torque per current",
    _dimension(length=1.0, angle=-1.0): "a travel per angle",
    _dimension(mass=1.0, time=-1.0): "a viscous friction coefficient of a sliding motion",
}

# The quantities of a rig's keys, with examples.
QUANTITIES: dict[str, str] = {
    "rad": "an angle (rad, deg, …)",
    "m": "a length (m, mm, …)",
    "A": "a current (A, mA, …)",
    "N*m": "a torque (N*m, N*mm, …)",
    "N*m/A": "a torque per current (N*m/A, mNm/A, …)",
    "N*m/rad": "a rotational stiffness (N*m/rad, N*mm/rad, N*m/deg, …)",
    "N*m/rad^3": "a cubic rotational stiffness (N*m/rad^3, N*m/deg^3, …)",
    "N*m*s/rad": "a viscous friction coefficient (N*m*s/rad, N*mm*s/rad, …)",
    "kg*m^2": "a moment of inertia (kg*m^2, g*cm^2, …)",
    "N/m": "the stiffness of a linear spring (N/m, N/mm, …)",
    "m/rad": "a travel per angle (m/rad, mm/rad, mm/rev, …)",
    "m/s^2": "an acceleration (m/s^2, g, …)",
    "Pa": "a pressure (Pa, bar, …)",
    "V": "a voltage (V, mV)",
    "m^2": "an area (m^2, mm^2, …)",
    "m^3": "a volume (m^3, cm^3, …)",
}
