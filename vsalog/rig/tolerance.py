"""How well a rig's quantities are known where it states no tolerance: one default per kind of quantity, each with its reason.

`python -m vsalog.rig.tolerance` prints the table that stands in docs/rig.md.
"""

from __future__ import annotations

import re

from vsalog.effects import effects
from vsalog.effects.base import Default
from vsalog.rig.uncertain import HALF_WIDTH_IN_DEVIATIONS

# A key that is an encoder's is named with its role: an angle is measured better than anything else.
_ENCODERS = ("motor_position", "link_position", "deflection")


def _of_encoders(key: str) -> tuple[str, ...]:
    return tuple(f"{role}.{key}" for role in _ENCODERS)


DEFAULTS = (
    *(default for effect in effects().values() for default in effect.tolerances),
    Default(("inertia",), "from CAD or a data sheet, which leave out couplings, screws and cables", share=0.2),
    Default(("mass", "distance"), "a load is seldom weighed, its centre of mass guessed", share=0.2),
    Default(
        ("gravity_torque",),
        "from CAD; a plane that is level to a degree lets 2 % of the weight act",
        share=0.1,
        share_of_scale=0.02,
    ),
    Default(("gravity_angle",), "how the base is mounted, and where the centre of mass lies", least="2 deg"),
    Default(("gear_ratio",), "teeth are counted"),
    Default(
        ("torque_constant", "torque_gain", "motor_torque.gain", "secondary_torque.gain"),
        "data sheets allow ± 10 %, and warm magnets are weaker",
        share=0.1,
    ),
    Default(("torque_offset",), "offset of a drive's current measurement", share_of_scale=0.05),
    Default(("torque_delay", "delay"), "two cycles of a 1 kHz fieldbus", least="2 ms"),
    Default(
        ("damping", "presliding_damping", "viscous"),
        "a factor of 3 upwards: a lubricant thins by as much from 20 to 50 °C",
        share=2.0,
        share_of_scale=0.1,
    ),
    Default(
        ("coulomb", "static", "kinetic", "level", "friction.muscle"),
        "temperature, load and wear change dry friction by half; a gear loses 10 % unless more is known",
        share=0.5,
        share_of_scale=0.1,
    ),
    Default(
        ("stribeck_velocity", "friction.speed", "presliding_stiffness", "bouc_wen.width"),
        "a factor of 3 upwards: seldom measured",
        share=2.0,
    ),
    Default(("load", "shaft_coefficient"), "a gear's efficiency is known to 5 points", share=0.5, least="0.05"),
    Default(("eccentricity.phase",), "nothing is known before it is measured", least="180 deg"),
    Default(
        ("stiffness", "spring_stiffness", "series_stiffness", "return_stiffness"),
        "manufacturers' tolerance of springs",
        share=0.1,
    ),
    Default(("coefficients",), "as stiffness; a term that is 0 is small, not absent", share=0.1, share_of_scale=0.05),
    Default(("transmission.scale",), "a shape, measured like stiffness", share=0.1),
    Default(("cubic",), "a curvature is measured less well than a slope", share=0.2),
    Default(("added_cubic",), "a spring keeps to its law within 10 %", share=0.5, share_of_scale=0.1),
    Default(("asymmetry",), "the two directions are two springs, ± 10 % each", least="0.1"),
    Default(("geometry",), "machined lengths of a mechanism", share=0.01),
    Default(("backlash",), "wear; a joint is free of play to 2 % of its deflection", share=0.5, share_of_scale=0.02),
    Default(
        ("bouc_wen.torque", "slip.limit"), "hysteresis of springs, cables and belts", share=0.5, share_of_scale=0.05
    ),
    Default(("slip.stiffness",), "fitted to a loop, not measured", share=0.5),
    Default(("lever.start", "lever.travel"), "machined lengths and the pitch of a screw", share=0.01),
    Default(_of_encoders("gain"), "a disc has whole lines per turn; what is left is the mounting", share=0.001),
    Default(_of_encoders("offset"), "a zero set by eye or against a stop", least="1 deg"),
    Default(_of_encoders("drift"), "a coupling or a magnet that creeps, over the log", share_of_scale=0.01),
    Default(("eccentricity.amplitude",), "a disc that is 0.1 mm off its axis at a radius of 30 mm", least="0.2 deg"),
    Default(("gain",), "calibration of a sensor as it is mounted, cross-talk included", share=0.05),
    Default(("offset",), "a zero that is not taken before each log", share_of_scale=0.05),
    Default(("drift",), "warming up, over the log", share_of_scale=0.05),
    Default(("force_gain",), "muscles of one make differ in length and diameter", share=0.1),
    Default(("inflow_area", "outflow_area", "area_scale"), "effective areas from flow curves", share=0.2),
    Default(("leak_area",), "holes nobody knows of, to 1 % of a valve's area", share=1.0, share_of_scale=0.01),
    Default(("supply_pressure", "outside_pressure"), "a gauge of class 2.5; the weather", share=0.03),
)
_BY_NAME = {name: default for default in DEFAULTS for name in default.names}


def default_deviation(quantity: str, nominal: float, scale: float) -> float:
    """Return one standard deviation, in SI, of a quantity whose tolerance the rig does not state.

    Parameters
    ----------
    quantity : its key's path below the joint, or the end of that: ``motor.inertia``, ``inertia``,
        ``signals.link_position_1.offset``; the longest end in the table counts, without indices and the suffixes _1 and _2
    nominal : its value, in SI
    scale : the value that would matter, in the same unit: of a torque, the joint's usual one; of a damping, the usual torque
        over the usual velocity; of a drift, the usual reading over the log's duration

    Raises
    ------
    KeyError
        No end of the path is in the table.
    """
    path = [re.sub(r"(\[\d+\])+$|_[12]$", "", part) for part in quantity.split(".")]
    for start in range(len(path)):
        default = _BY_NAME.get(".".join(path[start:]))
        if default is not None:
            return default.half_width(nominal, scale) / HALF_WIDTH_IN_DEVIATIONS
    raise KeyError(quantity)


def table_text() -> str:
    """Return the table as it stands in docs/rig.md."""
    rows = [f"| {', '.join(f'`{name}`' for name in d.names)} | {d.words} | {d.reason} |\n" for d in DEFAULTS]
    return "".join(["| key | tolerance | because |\n", "| --- | --- | --- |\n", *rows])


if __name__ == "__main__":
    print(table_text(), end="")
