"""Spring benches: the motor is clamped, a dynamometer turns the spring through loops of several sizes."""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.ndimage import gaussian_filter1d

from . import _plant
from .effects import Effect, Scales, effect, link, within
from .equations import LeftOver, Sum, Windows, curve
from .machines import Machine, _log
from .motion import LEAD, TAIL, Truth, Wanted, _grid
from .rig_file import _law, channel_lines, table
from .sensors import Quality


def random_machine(device: str, rng: np.random.Generator) -> Machine:
    """Draw a spring; half of them harden."""
    springs = np.zeros(2, _plant.SPRING)
    torque, deflection = _log(rng, 1.0, 60.0), rng.uniform(0.05, 0.3)
    hardening = rng.uniform(0.1, 0.5) if rng.random() < 0.5 else 0.0
    springs["law"], springs["factor"] = _plant.CUBIC, 1.0
    springs["k1"] = torque / deflection * (1.0 - hardening)
    springs["k3"] = torque / deflection * hardening / deflection**2
    rest = np.zeros(2, _plant.MOTOR), springs, np.zeros(1, _plant.LINK), np.zeros(2), np.zeros(2, _plant.SERVO)
    return Machine(device, *rest, torque, deflection)


def wanted(machine: Machine, duration: float, period: float, rng: np.random.Generator, poor: bool = False) -> Wanted:
    """Draw the dynamometer's turns: one to three loops at each of several amplitudes, at constant speeds or as sines."""
    time = _grid(duration, period)
    shape = rng.random() < 0.5
    at, places = [time[0], 0.0], [0.0, 0.0]
    amplitudes = machine.deflection * rng.permutation(np.linspace(rng.uniform(0.25, 0.4), 1.0, int(rng.integers(3, 5))))
    speed, k = machine.deflection * rng.uniform(0.6, 1.6), 0
    while at[-1] < time[-1]:
        amplitude = amplitudes[k % amplitudes.size]
        for _ in range(int(rng.integers(1, 4))):
            for sign in (1.0, -1.0):
                places.append(sign * amplitude)
                at.append(at[-1] + abs(places[-1] - places[-2]) / speed)
        k += 1
    if shape:
        # Half a cosine from reversal to reversal.
        index = np.clip(np.searchsorted(at, time, side="right") - 1, 0, len(at) - 2)
        a, b = np.array(at), np.array(places)
        share = (time - a[index]) / np.maximum(a[index + 1] - a[index], 1e-9)
        angle = b[index] + (b[index + 1] - b[index]) * 0.5 * (1.0 - np.cos(np.pi * np.clip(share, 0.0, 1.0)))
    else:
        angle = np.interp(time, at, places)
    values = np.zeros((time.size, 2, 2))
    values[:, 0, 0] = gaussian_filter1d(angle, 0.02 / period, mode="nearest")
    values[:, 0, 1] = np.gradient(values[:, 0, 0], period)
    return Wanted(values, period, poor)


@njit(cache=True, error_model="numpy")
def _torques(spring, link, angles, rates, time, period):
    """Return the torque a dynamometer feels: the spring's, with its loops, the output's dry friction and its weight."""
    out = np.zeros(angles.size)
    z, y, bristle = 0.0, np.zeros(3), 0.0
    for k in range(angles.size):
        phi, rate = angles[k], rates[k]
        torque, _, du = _plant._transmitted(spring, phi, rate, 0.0, time[k], z, y[0], y[1], y[2])
        dry, _ = _plant._bristles(link, bristle, phi, rate, 0.0, 0.0)
        out[k] = torque + dry + link.damping * rate + link.gravity * np.sin(phi - link.hangs_at)
        # States follow the motion in steps far below their widths.
        count = 1 + int(abs(du) * period / 2e-6) if spring.slip_torque != 0.0 or spring.loop != 0.0 else 1
        count = min(max(count, 20), 400)
        h = period / count
        for _ in range(count):
            if spring.loop != 0.0:
                z += h * (du - abs(du) * z) / spring.width
            if spring.slip_torque != 0.0:
                for j in range(3):
                    y[j] += h * (du - abs(du) * y[j] ** 5) / (_plant.SLIP_SHARES[j] * spring.slip_width)
            if link.presliding > 0.0:
                bristle += h * (rate - abs(rate) * bristle) / link.presliding
    return out


def happened(machine: Machine, follow: Wanted) -> Truth | None:
    """Turn a spring."""
    lead, tail = round(LEAD / follow.period), round(TAIL / follow.period)
    angles, rates = (np.ascontiguousarray(follow.values[:, 0, i]) for i in range(2))
    time = (np.arange(angles.size) - lead) * follow.period
    torques = _torques(machine.springs[0], machine.link[0], angles, rates, time, follow.period)
    if not np.isfinite(torques).all():
        return None
    roles = {"deflection": angles, "torque_sensor": torques}
    return Truth(time, roles, slice(lead, angles.size - tail), follow.period)


def scales_of(machine: Machine, truth: Truth) -> Scales:
    """Learn the scales from how the nominal spring was turned."""
    phi, torque = (truth.roles[r][truth.inside] for r in ("deflection", "torque_sensor"))
    rate = np.gradient(phi, truth.period)
    usual = 2.0 * float(np.std(torque)), float(np.std(rate)), float(np.max(np.abs(rate)))
    scales = [dict.fromkeys(("motor", "link"), value) for value in usual]
    return Scales(*scales, float(np.max(np.abs(phi))), float(np.std(rate)), float(truth.time[truth.inside][-1]))


def left_over(
    nominal: Machine, said: dict[str, np.ndarray], qualities: dict[str, Quality], inside: slice, period: float
) -> dict[str, LeftOver]:
    """Form τ_sensor − τ_e(φ); parameters as `equations.left_over`."""
    windows = Windows.of(period)
    phi = said["deflection"]
    torque, stiffness = curve(nominal.springs[0], phi, np.zeros_like(phi))
    equation = Sum(windows, inside)
    equation.add(said["torque_sensor"] - torque, windows.value)
    equation.noisy("torque_sensor", 1.0, windows.value)
    equation.noisy("deflection", float(np.sqrt(np.mean(stiffness**2))), windows.value)
    return {"transmission": equation.done(qualities)}


def rig_text(machine: Machine, roles: list[str]) -> str:
    """Return the rig file of a nominal spring: there is no motor, and no link."""
    name = machine.joint
    lines = ['name = "hidden machine"', "", f"[joint.{name}]", 'kind = "elastic"', ""]
    lines += table(f"joint.{name}.transmission", _law(machine.springs[0]))
    return "\n".join([*lines, *channel_lines(name, roles)]) + "\n"


# A rig that has no link has no weight to be wrong.
BENCH_EFFECTS: dict[str, Effect] = {}


@effect("link.gravity", link, within(0.0, 0.5), lambda rng, *_: {"hangs_at": rng.uniform(-1.5, 1.5)}, BENCH_EFFECTS)
def _(s, shape, machine, sensors, part, scales):
    row = machine.link[0]
    row["gravity"], row["hangs_at"] = s * scales.torque["link"], shape["hangs_at"]
    return {"torque": float(row["gravity"])}
