"""The rig as a hidden machine truly is, as far as a rig can say it: what a diagnosis would arrive at if it were right in all.

With it in hand a simulation should be at its noise floor, and nothing should be named; `battery --true` looks whether that is so.
"""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
import tomli_w

from . import _plant
from .machines import Flaws

MOTORS = {
    "elastic": ("motor",), "rigid": ("motor",), "bench": (), "serial": ("motor", "secondary_motor"),
    "antagonistic": ("motor_1", "motor_2"),
}  # fmt: skip


def true_rig(nominal: str, machine: Any, sensors: Any, engine: str = "own") -> str:
    """Return the rig file of a machine and its sensors as they are.

    Parameters
    ----------
    nominal : rig file of the nominal machine
    machine, sensors : with everything that is hidden in them
    engine : that simulates it; MuJoCo's friction has no bristles
    """
    rig = tomllib.loads(nominal)
    (joint,) = rig["joint"].values()
    bristles = engine == "own"
    for part, row in zip(MOTORS[machine.device], machine.motors, strict=False):
        joint[part] |= _motor(row, bristles)
    if machine.device != "rigid":
        for suffix, row in zip(machine.suffixes, machine.springs, strict=False):
            joint[f"transmission{suffix}"] |= _spring(row, joint[f"transmission{suffix}"], bristles)
    if "link" in joint:
        row = machine.link[0]
        joint["link"] |= _given(inertia=row["inertia"], damping=row["damping"], gravity_torque=row["gravity"])
        joint["link"] |= _friction(row, bristles)
    for role, signal in joint["signals"].items():
        signal |= _signal(sensors.flaws.get(role, Flaws()))
    return tomli_w.dumps(rig)


def _given(**values: float) -> dict[str, float]:
    return {k: float(v) for k, v in values.items() if v}


def _motor(row: np.void, bristles: bool) -> dict[str, Any]:
    out: dict[str, Any] = _given(inertia=row["inertia"], damping=row["damping"], torque_gain=row["gain"])
    out |= _given(torque_offset=row["offset"], torque_delay=row["delay"])
    if row["cogging"]:
        out["cogging"] = [
            {k: float(row[v]) for k, v in (("torque", "cogging"), ("order", "order"), ("phase", "phase"))}
        ]
    return out | _friction(row, bristles)


def _friction(row: np.void, bristles: bool) -> dict[str, Any]:
    out = _given(coulomb=row["level"], load=row["load"])
    if row["breakaway"] > row["level"]:
        out |= _given(static=row["breakaway"], stribeck_velocity=row["stribeck"])
    if out and bristles and row["level"]:
        out["presliding_stiffness"] = float(row["level"] / row["presliding"])
    return {"friction": out} if out else {}


def _spring(row: np.void, nominal: dict[str, Any], bristles: bool) -> dict[str, Any]:
    factor = float(row["factor"])
    out: dict[str, Any] = {k: nominal[k] * factor for k in ("stiffness", "cubic", "spring_stiffness") if k in nominal}
    out |= _given(
        damping=row["damping"], added_cubic=row["added_cubic"], backlash=row["gap"], asymmetry=row["asymmetry"],
        drift=row["drift"],
    )  # fmt: skip
    if row["loop"]:
        out["bouc_wen"] = _given(torque=row["loop"], width=row["width"])
    if row["slip_torque"]:
        shares = _plant.SLIP_SHARES if bristles else (0.01,)
        limit = float(row["slip_torque"]) / len(shares)
        out["slip"] = [{"stiffness": limit / (s * float(row["slip_width"])), "limit": limit} for s in shares]
    return out


def _signal(flaws: Flaws) -> dict[str, Any]:
    out: dict[str, Any] = _given(gain=flaws.gain, offset=flaws.offset, drift=flaws.drift, delay=flaws.delay)
    if flaws.amplitude:
        out["eccentricity"] = {"amplitude": flaws.amplitude, "phase": flaws.phase}
    return out
