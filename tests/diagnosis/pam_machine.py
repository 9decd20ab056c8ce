"""Two pneumatic muscles and a seesaw, written out by hand and integrated by scipy: logs whose truth is known.

Numbers are those of Shin 2021 Table II but for wider orifices, another inertia and a load of springs. Friction is a steep
hyperbolic tangent, so that scipy needs no events; pressures are in bar inside. Nothing of vsalog's mechanics is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from math import cos, sin, sqrt, tanh
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from vsalog.rig import Rig
from vsalog.rig.schema import PneumaticJoint

Array = NDArray[np.float64]

TANK, OUTSIDE, GAS = 7.1, 1.013, 287.0 * 293.0
SMOOTH = 1e-4  # velocity over which friction turns round [rad/s]

RIG = """
name = "bench"

[joint.arm]
kind = "pneumatic"

[joint.arm.air]
supply_pressure = "7.1 bar"
outside_pressure = "1.013 bar"
inflow_index = 1.1
volume_index = 0.4545
temperature = "293 K"

[joint.arm.valve_1]
inflow_area = "0.156 mm^2"
outflow_area = "0.234 mm^2"
voltage = [0.0, 5.0, 10.0]
opening = [0.0, 0.5, 1.0]

[joint.arm.valve_2]
inflow_area = "0.156 mm^2"
outflow_area = "0.234 mm^2"
voltage = [0.0, 5.0, 10.0]
opening = [0.0, 0.5, 1.0]

[joint.arm.muscle_1]
length = "165 mm"
volume_curvature = "-2.440e-2 m"
volume_slope = "6.824e-3 m^2"
volume_constant = "-4.254e-4 m^3"
force = { type = "linear", area_slope = 7.045e-3, area = -1.017e-3, passive_slope = -556.8, passive = 72.86 }

[joint.arm.muscle_2]
length = "165 mm"
volume_curvature = "-2.440e-2 m"
volume_slope = "6.824e-3 m^2"
volume_constant = "-4.254e-4 m^3"
force = { type = "linear", area_slope = 6.423e-3, area = -9.184e-4, passive_slope = -197.8, passive = 15.75 }

[joint.arm.seesaw]
radius = "36.5 mm"
inertia = "8e-4 kg*m^2"
return_stiffness = "0.6 N*m/rad"
mass = "0.256 kg"
gravity = "9.8 m/s^2"

FRICTION

[joint.arm.signals]
link_position = { channel = "angle", unit = "rad" }
torque_sensor = { channel = "torque", unit = "N*m" }
pressure_1 = { channel = "p1", unit = "Pa" }
pressure_2 = { channel = "p2", unit = "Pa" }
valve_1 = { channel = "u1", unit = "V" }
valve_2 = { channel = "u2", unit = "V" }
"""

PAPER = """
[joint.arm.friction]
type = "pressure"
viscous = 5e-3
shaft_radius = "6 mm"
shaft_coefficient = 0.05
muscle = 1e9
"""
LEVEL = """
[joint.arm.friction]
type = "simple"
level = 0.02
"""


@dataclass(frozen=True)
class Bench:
    """What is true; the defaults are what the rig states."""

    gain: tuple[float, float] = (1.0, 1.0)
    leak: tuple[float, float] = (0.0, 0.0)  # [mm²]
    scale: tuple[float, float] = (1.0, 1.0)
    valve: tuple[float, float] = (0.0, 0.0)  # [V]
    gauge: tuple[float, float] = (0.0, 0.0)  # offsets of the pressure sensors [Pa]
    meter: float = 1.0
    tube: float = 1e9  # T_p' [N·m·Pa²]; none where the level below is given
    level: float | None = None
    held: float | None = None


def nozzle(up: float, down: float) -> float:
    """Flow in kg/s of 1 mm², pressures in bar."""
    if up < down:
        return -nozzle(down, up)
    ratio = max(down / up, (2.0 / 2.4) ** 3.5)
    return 0.1 * up * sqrt(7.0 / GAS * max(ratio ** (10.0 / 7.0) - ratio ** (12.0 / 7.0), 0.0))


def voltages(t: float) -> tuple[float, float]:
    turn = 2.0 * np.pi * t
    slow, both = 1.5 * sin(0.45 * turn) + 0.6 * sin(1.7 * turn + 1.0), 0.9 * sin(0.2 * turn + 2.0)
    return 4.0 + both + slow, 4.0 + both - slow + 0.4 * sin(1.1 * turn)


def pulls(bench: Bench, psi: float, a: float, b: float) -> tuple[float, float]:
    l1, l2 = 0.165 - 0.0365 * sin(psi), 0.165 + 0.0365 * sin(psi)
    f1 = (7.045e-3 * l1 - 1.017e-3) * a * 1e5 - 556.8 * l1 + 72.86
    f2 = (6.423e-3 * l2 - 9.184e-4) * b * 1e5 - 197.8 * l2 + 15.75
    return bench.gain[0] * f1, bench.gain[1] * f2


def rates(bench: Bench, x: Array, u: tuple[float, float]) -> list[float]:
    """Return the rates of (ψ, ψ̇, P₁, P₂) under two voltages."""
    psi, omega = x[0], x[1]
    f1, f2 = pulls(bench, psi, x[2], x[3])
    if bench.held is None:
        if bench.level is None:
            tubes = bench.tube * 1e-10 * sum((p - OUTSIDE) ** -2.0 for p in (x[2], x[3]))
            dry, wet = 0.006 * 0.05 * abs(f1 + f2 - 0.256 * 9.8) + tubes, 5e-3 * omega
        else:
            dry, wet = bench.level, 0.0
        torque = 0.0365 * cos(psi) * (f1 - f2) - 0.6 * psi - dry * tanh(omega / SMOOTH) - wet
        out = [omega, torque / 8e-4]
    else:
        omega, out = 0.0, [0.0, 0.0]
    for i, sign in ((0, -1.0), (1, 1.0)):
        p, length = x[2 + i], 0.165 + sign * 0.0365 * sin(psi)
        volume = -2.44e-2 * length**2 + 6.824e-3 * length - 4.254e-4
        swelling = (6.824e-3 - 4.88e-2 * length) * sign * 0.0365 * cos(psi) * omega
        opening = min(max((u[i] + bench.valve[i]) / 10.0, 0.0), 1.0)
        flow = opening * nozzle(TANK, p) - (1.0 - opening) * nozzle(p, OUTSIDE)
        flow *= bench.scale[i] * (0.156 if flow > 0.0 else 0.234)
        flow -= bench.leak[i] * nozzle(p, OUTSIDE)
        out.append(1.1 * GAS * flow / volume * 1e-5 - 0.4545 * swelling / volume * p)
    return out


def torque_of(bench: Bench, x: Array) -> float:
    f1, f2 = pulls(bench, x[0], x[2], x[3])
    return 0.0365 * cos(x[0]) * (f1 - f2)


@cache
def moved(bench: Bench, duration: float, rate: float) -> tuple[Array, Array]:
    """Return the states, shape (4, N), and the voltages, (2, N), a second after the start."""
    time = np.arange(round((duration + 1.0) * rate)) / rate
    start = [bench.held or 0.0, 0.0, 3.5, 3.5]
    solution = solve_ivp(
        lambda t, x: rates(bench, x, voltages(t)), (0.0, time[-1]), start, "LSODA", time, rtol=1e-7, atol=1e-9, max_step=0.01
    )  # fmt: skip
    assert solution.success
    kept = time >= 1.0
    return solution.y[:, kept], np.array([voltages(t) for t in time[kept]]).T


def played(bench: Bench, duration: float = 8.0, rate: float = 500.0, seed: int = 0) -> dict[str, Array]:
    """Return channel → samples: what the sensors say, with noise."""
    x, u = moved(bench, duration, rate)
    rng, n, step = np.random.default_rng(seed), x.shape[1], 2.0 * np.pi / 2**16
    torque = np.array([torque_of(bench, state) for state in x.T])
    return {
        "time": np.arange(n) / rate,
        "angle": np.round(x[0] / step) * step,
        "torque": bench.meter * torque + 0.004 * rng.standard_normal(n),
        "p1": 1e5 * x[2] + bench.gauge[0] + 250.0 * rng.standard_normal(n),
        "p2": 1e5 * x[3] + bench.gauge[1] + 250.0 * rng.standard_normal(n),
        "u1": u[0],
        "u2": u[1],
    }


def joint_of(bench: Bench, friction: str = PAPER) -> PneumaticJoint:
    """Return the joint as its rig states it is."""
    joint = Rig.from_toml(rig_text(bench, friction)).joints["arm"]
    assert isinstance(joint, PneumaticJoint)
    return joint


def rig_text(bench: Bench, friction: str = PAPER) -> str:
    text = RIG.replace("FRICTION", friction)
    if bench.held is not None:
        text = text.replace("[joint.arm.seesaw]\n", f"[joint.arm.seesaw]\nheld_at = {bench.held!r}\n")
    return text


def write(folder: Path, bench: Bench, name: str = "log", friction: str = PAPER, **how: float) -> Path:
    """Write a CSV log and the rig file next to it, and return the log's path."""
    columns = played(bench, **how)
    path = folder / f"{name}.csv"
    np.savetxt(
        path, np.column_stack(list(columns.values())), delimiter=",", header=",".join(columns), comments="", fmt="%.9g"
    )
    (folder / f"{name}.rig.toml").write_text(rig_text(bench, friction))
    return path
