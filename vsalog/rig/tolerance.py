"""Default tolerances of a rig's quantities: one per kind of quantity, each with its reason.

`python -m vsalog.rig.tolerance` prints the table in docs/reference/rig/tolerances.md.
"""

from __future__ import annotations

import re

from vsalog.core.significance import INTERVAL
from vsalog.effects import effects
from vsalog.effects.base import Default

DEFAULTS = (
    *(default for effect in effects().values() for default in effect.tolerances),
    Default(("gear_ratio",), "teeth are counted"),
    Default(
        ("stiffness", "spring_stiffness", "series_stiffness", "return_stiffness"),
        "manufacturers' tolerance of springs",
        share=0.1,
    ),
    Default(("coefficients",), "as stiffness; a term that is 0 is small, not absent", share=0.1, share_of_scale=0.05),
    Default(("transmission.scale",), "a shape, measured like stiffness", share=0.1),
    Default(("cubic",), "a curvature is measured less well than a slope", share=0.2),
    Default(("geometry",), "machined lengths of a mechanism", share=0.01),
    Default(("lever.start", "lever.travel"), "machined lengths and the pitch of a screw", share=0.01),
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
            return default.half_width(nominal, scale) / INTERVAL
    raise KeyError(quantity)


def table_text() -> str:
    """Return the table in docs/reference/rig/tolerances.md."""
    rows = [f"| {', '.join(f'`{name}`' for name in d.names)} | {d.words} | {d.reason} |\n" for d in DEFAULTS]
    return "".join(["| key | tolerance | because |\n", "| --- | --- | --- |\n", *rows])


if __name__ == "__main__":
    print(table_text(), end="")
