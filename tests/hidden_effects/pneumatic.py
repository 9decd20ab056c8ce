"""Pneumatic joints: random machines, what they are driven with, their equations, their rig file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d, uniform_filter1d

from . import _air
from .equations import LeftOver, Sum, Windows
from .motion import LEAD, TAIL, Truth, Wanted
from .rig_file import channel_lines, table
from .sensors import Quality

STEP = 2.5e-4
# Where the seesaw moves more slowly than this within a window, the direction of friction is not known [rad/s].
SLOW = 0.03


@dataclass
class PneumaticMachine:
    """A pneumatic joint, as it is or as its rig states it is.

    Attributes
    ----------
    air, seesaw : one row each; muscles : two rows, each with its valve
    maps : shape (2, 2, K), per valve voltages and openings
    """

    air: np.ndarray
    muscles: np.ndarray
    seesaw: np.ndarray
    maps: np.ndarray
    device: str = "pneumatic"

    def copy(self) -> PneumaticMachine:
        return PneumaticMachine(*(a.copy() for a in (self.air, self.muscles, self.seesaw, self.maps)))

    @property
    def joint(self) -> str:
        return "shoulder"

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Of the transmissions: there are none."""
        return ()


def random_machine(device: str, rng: np.random.Generator) -> PneumaticMachine:
    """Draw a machine about that of Shin 2021 Table II; each size of it may be some tenths off."""
    air, muscles, seesaw = np.zeros(1, _air.AIR), np.zeros(2, _air.MUSCLE), np.zeros(1, _air.SEESAW)
    air[0] = (rng.uniform(0.6e6, 0.8e6), 0.1013e6, rng.uniform(1.0, 1.3), rng.uniform(0.4, 1.2), 1.4, 287.0 * 293.0)
    pulls = ((7.045e-3, -1.017e-3, -556.8, 72.86), (6.423e-3, -9.184e-4, -197.8, 15.75))
    strength, wide = rng.uniform(0.8, 1.3), rng.uniform(2.0, 5.0)
    for muscle, pull in zip(muscles, pulls, strict=True):
        muscle["length"] = 0.165
        muscle["d1"], muscle["d2"], muscle["d3"] = -2.44e-2, 6.824e-3, -4.254e-4
        own = strength * rng.uniform(0.97, 1.03)
        muscle["pv1"], muscle["pv2"], muscle["pw1"], muscle["pw2"] = (own * x for x in pull)
        muscle["gain"] = muscle["scale"] = 1.0
        muscle["inflow"], muscle["outflow"] = 5.184e-8 * wide, 7.776e-8 * wide
    row = seesaw[0]
    row["radius"], row["inertia"] = 36.5e-3, 4.263e-4 * rng.uniform(0.8, 3.0)
    # The paper's seesaw is next to free; here it works against a load, so that there is a torque to be seen.
    row["return_stiffness"], row["mass"], row["gravity"] = rng.uniform(1.0, 4.0), 0.256, 9.8
    row["viscous"] = 2.256e-3 * rng.uniform(0.8, 3.0)
    row["shaft_radius"], row["shaft_coefficient"] = 6e-3, rng.uniform(0.02, 0.1)
    # A rig of this kind cannot say how far bristles give way before they slip: less than the finest encoder counts (6e-6 rad),
    # or a clean machine is none.
    row["muscle"], row["presliding"] = 4e8 * rng.uniform(2.0, 10.0), 2e-6
    middle = rng.uniform(4.8, 5.6)
    maps = np.zeros((2, 2, 7))
    maps[:, 0] = (0.0, middle - 1.5, middle - 0.5, middle, middle + 0.5, middle + 1.0, 10.0)
    maps[:, 1] = (0.0, rng.uniform(0.15, 0.25), 0.44, 0.5, 0.6, rng.uniform(0.75, 0.85), 1.0)
    return PneumaticMachine(air, muscles, seesaw, maps)


def wanted(
    machine: PneumaticMachine, duration: float, period: float, rng: np.random.Generator, poor: bool = False
) -> Wanted:
    """Draw voltages of both valves: steps of the sum and of the difference, with slow waves."""
    time = np.arange(-round(LEAD / period), round((duration + TAIL) / period)) * period
    middle = float(machine.maps[0, 0, 3])
    both = np.zeros((time.size, 2, 1))
    for i in range(2):
        levels = np.zeros_like(time)
        t, sign = time[0], (-1.0) ** i
        while t < time[-1]:
            end = t + rng.uniform(0.5, 2.0)
            levels[(time >= t) & (time < end)] = sign * rng.uniform(0.2, 1.0)
            t, sign = end, -sign
        steps = gaussian_filter1d(levels, rng.uniform(0.01, 0.1) / period, mode="nearest")
        f = rng.uniform(0.1, 0.6, 2)
        waves = np.sin(2.0 * np.pi * f[0] * time + rng.uniform(0, 6)) + np.sin(2.0 * np.pi * f[1] * time)
        size = (0.2, 0.2) if poor else (2.2, 0.5)
        both[:, i, 0] = np.clip(middle + 0.15 + size[0] * steps + size[1] * waves, 0.0, 10.0)
    return Wanted(both, period, poor)


def happened(machine: PneumaticMachine, follow: Wanted) -> Truth | None:
    """Play voltages; none where a pressure leaves what is possible."""
    x0 = np.array([0.0, 0.0, 0.35e6, 0.35e6, 0.0, 0.0])
    voltages = np.ascontiguousarray(follow.values[:, :, 0])
    states, torques = _air.play(
        machine.air, machine.muscles, machine.seesaw, machine.maps, voltages, follow.period, STEP, x0
    )
    if not (np.isfinite(states).all() and np.max(np.abs(states[:, 0])) < 0.8):
        return None
    lead, tail = round(LEAD / follow.period), round(TAIL / follow.period)
    time = (np.arange(states.shape[0]) - lead) * follow.period
    roles = {"link_position": states[:, 0], "torque_sensor": torques}
    for i in range(2):
        roles[f"pressure_{i + 1}"], roles[f"valve_{i + 1}"] = states[:, 2 + i], voltages[:, i]
    return Truth(time, roles, slice(lead, states.shape[0] - tail), follow.period)


def left_over(
    nominal: PneumaticMachine, said: dict[str, np.ndarray], qualities: dict[str, Quality], inside: slice, period: float
) -> dict[str, LeftOver]:
    """Form the nominal machine's equations of channels; parameters as `equations.left_over`.

    seesaw        J ψ̈ + c ψ̇ + k ψ + T_f − τ(P₁, P₂, ψ)      where the direction of friction is known
    transmission  τ_sensor − τ(P₁, P₂, ψ)
    pressure_i    Ṗ + k₂ (V̇/V) P − k₁ R T m(P, u) / V
    """
    windows = Windows.of(period)
    w0, w1, w2 = windows.value, windows.rate, windows.curve
    air, seesaw, psi = nominal.air[0], nominal.seesaw[0], said["link_position"]
    p = [said["pressure_1"], said["pressure_2"]]
    travel, turning = seesaw["radius"] * np.sin(psi), seesaw["radius"] * np.cos(psi)
    lengths = [nominal.muscles[0]["length"] - travel, nominal.muscles[1]["length"] + travel]
    slopes = [m["pv1"] * x + m["pv2"] for m, x in zip(nominal.muscles, lengths, strict=True)]
    pulls = [a * x + m["pw1"] * y + m["pw2"] for m, a, x, y in zip(nominal.muscles, slopes, p, lengths, strict=True)]
    torque = turning * (pulls[0] - pulls[1])
    stiffness = _rms(np.gradient(torque)) / max(_rms(np.gradient(psi)), 1e-12)

    def add_torque(equation: Sum) -> None:
        equation.add(-torque, w0)
        for i, sign in enumerate((-1.0, 1.0)):
            equation.noisy(f"pressure_{i + 1}", sign * _rms(turning * slopes[i]), w0)

    out = {}
    equation = Sum(windows, inside)
    kernel = seesaw["inertia"] * w2 + seesaw["viscous"] * w1 + seesaw["return_stiffness"] * w0
    equation.add(psi, kernel)
    equation.noisy("link_position", 1.0, kernel)
    rate = uniform_filter1d(np.gradient(psi, period), max(1, round(0.004 / period)))
    gauges = [np.maximum(x - air["outside"], 1e3) for x in p]
    load = np.abs(pulls[0] + pulls[1] - seesaw["mass"] * seesaw["gravity"])
    level = seesaw["shaft_radius"] * seesaw["shaft_coefficient"] * load
    level = level + seesaw["muscle"] * (gauges[0] ** -2.0 + gauges[1] ** -2.0)
    equation.add(level * np.sign(rate), w0)
    add_torque(equation)
    # Friction has a direction only where the seesaw has moved one way for longer than the window.
    about = round(3 * 0.025 / period)
    moving = (np.abs(uniform_filter1d(np.sign(rate), about)) > 0.999) & (np.abs(rate) > SLOW)
    found = equation.done(qualities)
    out["seesaw"] = LeftOver(found.values[moving[inside]], found.noise)
    if "torque_sensor" in said:
        equation = Sum(windows, inside)
        equation.add(said["torque_sensor"], w0)
        equation.noisy("torque_sensor", 1.0, w0)
        add_torque(equation)
        equation.noisy("link_position", stiffness, w0)
        out["transmission"] = equation.done(qualities)
    for i in range(2):
        out[f"pressure_{i + 1}"] = _filling(
            nominal, i, said, (lengths[i], turning), qualities, period, Sum(windows, inside)
        )
    return out


def _filling(nominal, i, said, shape, qualities, period, equation) -> LeftOver:
    length, turning = shape
    air, muscle, role = nominal.air[0], nominal.muscles[i], f"pressure_{i + 1}"
    w0, w1 = equation.windows.value, equation.windows.rate
    pressure = said[role]
    volume = (muscle["d1"] * length + muscle["d2"]) * length + muscle["d3"]
    sign = -1.0 if i == 0 else 1.0
    swelling = (2.0 * muscle["d1"] * length + muscle["d2"]) * sign * turning
    # A voltage is held from its sample on.
    voltage = said[f"valve_{i + 1}"]
    now, before = (_flows(nominal, i, u, pressure) for u in (voltage, np.concatenate([voltage[:1], voltage[:-1]])))
    flowing = air["inflow_index"] * air["gas"] * 0.5 * (now + before) / volume
    bending = air["volume_index"] * swelling / volume * pressure
    equation.add(pressure, w1)
    equation.noisy(role, 1.0, w1)
    # The angle's rate goes onto the window, the slowly changing factor stays where it is: product rule.
    rate = np.gradient(said["link_position"], period)
    equation.add(bending * rate, w0)
    equation.noisy("link_position", _rms(bending), w1)
    equation.add(-flowing, w0)
    return equation.done(qualities)


def _flows(nominal, i, voltage, pressure) -> np.ndarray:
    opening = np.interp(voltage, *nominal.maps[i])
    return np.array(
        [_air.valve_flow(nominal.air[0], nominal.muscles[i], a, x) for a, x in zip(opening, pressure, strict=True)]
    )


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def rig_text(machine: PneumaticMachine, roles: list[str]) -> str:
    """Return the rig file of a nominal machine."""
    name, air, seesaw = machine.joint, machine.air[0], machine.seesaw[0]
    lines = ['name = "hidden machine"', "", f"[joint.{name}]", 'kind = "pneumatic"', ""]
    keys = {
        "supply_pressure": air["supply"],
        "outside_pressure": air["outside"],
        "inflow_index": air["inflow_index"],
        "volume_index": air["volume_index"],
        "heat_ratio": air["heat_ratio"],
        "gas_constant": 287.0,
        "temperature": air["gas"] / 287.0,
    }
    lines += table(f"joint.{name}.air", keys)
    for i, muscle in enumerate(machine.muscles):
        lines += table(
            f"joint.{name}.valve_{i + 1}", {"inflow_area": muscle["inflow"], "outflow_area": muscle["outflow"]}
        )
        lines[-1:] = [f"{k} = {[float(x) for x in machine.maps[i, j]]}" for j, k in enumerate(("voltage", "opening"))]
        lines.append("")
        size = {"length": "length", "volume_curvature": "d1", "volume_slope": "d2", "volume_constant": "d3"}
        lines += table(f"joint.{name}.muscle_{i + 1}", {k: muscle[v] for k, v in size.items()})
        law = {"area_slope": "pv1", "area": "pv2", "passive_slope": "pw1", "passive": "pw2"}
        lines += table(
            f"joint.{name}.muscle_{i + 1}.force", {"type": "linear"} | {k: muscle[v] for k, v in law.items()}
        )
    lines += table(
        f"joint.{name}.seesaw", {k: seesaw[k] for k in ("radius", "inertia", "return_stiffness", "mass", "gravity")}
    )
    friction = {k: seesaw[k] for k in ("viscous", "shaft_radius", "shaft_coefficient", "muscle")}
    lines += table(f"joint.{name}.friction", {"type": "pressure"} | friction)
    return "\n".join([*lines, *channel_lines(name, roles)]) + "\n"
