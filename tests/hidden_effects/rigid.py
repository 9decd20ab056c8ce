"""Rigid joints: a servo that carries a load, with one encoder and the motor's torque."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.ndimage import gaussian_filter1d

from . import _plant
from .effects import Scales
from .equations import LeftOver, Sum, Windows, _held
from .machines import Machine, _log
from .motion import LEAD, TAIL, Truth, Wanted, _grid, _multisine, _ramps, _steps
from .rig_file import channel_lines, table
from .sensors import Quality

STEP = 5e-4


@dataclass
class RigidMachine(Machine):
    """A motor and a link in one; `role` is what its encoder is recorded as."""

    role: str = "motor_position"

    def copy(self) -> RigidMachine:
        arrays = (self.motors, self.springs, self.link, self.lever, self.servos)
        return RigidMachine(self.device, *(a.copy() for a in arrays), self.torque, self.deflection, self.role)


def random_machine(device: str, rng: np.random.Generator) -> RigidMachine:
    """Draw a servo and its load; half of them hang in the vertical plane."""
    motors, link, servos = np.zeros(2, _plant.MOTOR), np.zeros(1, _plant.LINK), np.zeros(2, _plant.SERVO)
    torque = _log(rng, 0.5, 40.0)
    inertia = torque / rng.uniform(20.0, 80.0)
    part = rng.uniform(0.3, 0.7)
    motors["gain"], motors["gear"] = 1.0, rng.choice([5.0, 10.0, 30.0, 100.0])
    motors["inertia"], link["inertia"] = part * inertia, (1.0 - part) * inertia
    motors["damping"], link["damping"] = (
        part * inertia * _log(rng, 1.0, 5.0),
        (1.0 - part) * inertia * rng.uniform(0.3, 1.5),
    )
    if rng.random() < 0.6:
        link["gravity"], link["hangs_at"] = torque * rng.uniform(0.2, 0.6), rng.uniform(-0.5, 0.5)
    bandwidth = 2.0 * np.pi * rng.uniform(3.0, 8.0)
    servos["stiffness"], servos["damping"] = inertia * bandwidth**2, 1.4 * inertia * bandwidth
    servos["limit"] = 20.0 * torque
    role = "motor_position" if rng.random() < 0.7 else "link_position"
    return RigidMachine(device, motors, np.zeros(2, _plant.SPRING), link, np.zeros(2), servos, torque, 0.1, role)


def wanted(machine: Machine, duration: float, period: float, rng: np.random.Generator, poor: bool = False) -> Wanted:
    """Draw a wide slow motion with a quick part, so that accelerations ask for the torque the servo is made for."""
    time = _grid(duration, period)
    ease = np.clip((time - time[0]) / (0.8 * LEAD), 0.0, 1.0)
    slow = 0.8 * _ramps(time, (1.0, 3.0), rng) + 0.2 * _multisine(time, 0.05, 0.2, 2, rng)
    quick = 0.8 * _multisine(time, 0.5, 4.0, 6, rng) + 0.5 * _steps(time, (0.4, 1.5), 0.06, rng)
    lively = np.ones_like(time)
    for begin in rng.uniform(0.1, 0.9, 2) * time[-1]:
        lively[(time >= begin) & (time < begin + 0.15 * time[-1])] = 0.0
    quick *= gaussian_filter1d(lively, 0.2 / period, mode="nearest")
    inertia = float(machine.motors[0]["inertia"] + machine.link[0]["inertia"])
    size = 0.6 * machine.torque / inertia / np.std(np.gradient(np.gradient(quick, period), period))
    values = np.zeros((time.size, 2, 2))
    width = rng.uniform(0.8, 1.8)
    values[:, 0, 0] = ease * (float(machine.link[0]["hangs_at"]) + width * slow + min(float(size), 0.5) * quick)
    values[:, :, 1] = np.gradient(values[:, :, 0], period, axis=0)
    return Wanted(values, period, poor)


@njit(cache=True, error_model="numpy")
def _rate(motor, link, x, applied):
    """Return (q̇, q̈, ż of the motor's bristles, ż of the link's); x is q, q̇ and both bristles."""
    q, dq = x[0], x[1]
    dry, dz = _plant._bristles(motor, x[2], q, dq, 0.0, 0.0)
    dry_link, dz_link = _plant._bristles(link, x[3], q, dq, 0.0, 0.0)
    torque = motor.gain * applied + motor.offset - (motor.damping + link.damping) * dq - dry - dry_link
    if motor.cogging != 0.0:
        torque += motor.cogging * np.sin(motor.order * motor.gear * q + motor.phase)
    torque -= link.gravity * np.sin(q - link.hangs_at)
    return np.array([dq, torque / (motor.inertia + link.inertia), dz, dz_link])


@njit(cache=True, error_model="numpy")
def play(motors, link, servos, follow, period, step):
    """Let the servo follow; return positions and commands, held from their sample on."""
    motor, arm, servo = motors[0], link[0], servos[0]
    n = follow.shape[0]
    positions, commands = np.zeros(n), np.zeros(n)
    x = np.zeros(4)
    whole = int(np.floor(motor.delay / period + 1e-12))
    late = motor.delay - whole * period
    for k in range(n):
        positions[k] = x[0]
        command = servo.stiffness * (follow[k, 0] - x[0]) + servo.damping * (follow[k, 1] - x[1])
        commands[k] = min(max(command, -servo.limit), servo.limit)
        fine = 0.0
        if motor.presliding > 0.0:
            fine = (abs(x[1]) + _plant.BRISTLE_MARGIN) / motor.presliding / 1.5
        if arm.presliding > 0.0:
            fine = max(fine, (abs(x[1]) + _plant.BRISTLE_MARGIN) / arm.presliding / 1.5)
        for half in range(2):
            length = late if half == 0 else period - late
            if length < 1e-9:
                continue
            at = k - whole - (1 if half == 0 else 0)
            applied = commands[at] if at >= 0 else 0.0
            count = int(np.ceil(length * max(1.0 / step, min(fine, _plant.MOST_STEPS)) - 1e-9))
            h = length / count
            for _ in range(count):
                k1 = _rate(motor, arm, x, applied)
                k2 = _rate(motor, arm, x + 0.5 * h * k1, applied)
                k3 = _rate(motor, arm, x + 0.5 * h * k2, applied)
                k4 = _rate(motor, arm, x + h * k3, applied)
                x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return positions, commands


def happened(machine: RigidMachine, follow: Wanted) -> Truth | None:
    """Let a servo follow."""
    values = np.ascontiguousarray(follow.values[:, 0, :])
    positions, commands = play(machine.motors, machine.link, machine.servos, values, follow.period, STEP)
    return truth_of(machine, positions, commands, follow)


def truth_of(machine: RigidMachine, positions: np.ndarray, commands: np.ndarray, follow: Wanted) -> Truth | None:
    """Return what happened as roles; none where it broke."""
    if not np.isfinite(positions).all():
        return None
    lead, tail = round(LEAD / follow.period), round(TAIL / follow.period)
    time = (np.arange(positions.size) - lead) * follow.period
    roles = {machine.role: positions, "motor_torque": commands}
    return Truth(time, roles, slice(lead, positions.size - tail), follow.period)


def scales_of(machine: RigidMachine, truth: Truth) -> Scales:
    """Learn the scales from how the nominal servo moved."""
    position, torque = (truth.roles[r][truth.inside] for r in (machine.role, "motor_torque"))
    rate = np.gradient(position, truth.period)
    parts = ("motor", "link")
    both = {
        "torque": 2.0 * float(np.std(torque)), "speed": float(np.std(rate)), "fastest": float(np.max(np.abs(rate))),
    }  # fmt: skip
    turn = float(np.min(position)), float(np.max(position))
    usual = [dict.fromkeys(parts, both[k]) for k in ("torque", "speed", "fastest")]
    return Scales(*usual, 0.1, 1.0, float(truth.time[truth.inside][-1]), dict.fromkeys(parts, turn))


def left_over(
    nominal: RigidMachine, said: dict[str, np.ndarray], qualities: dict[str, Quality], inside: slice, period: float
) -> dict[str, LeftOver]:
    """Form (B + M) q̈ + (D + D_q) q̇ + g(q) − τ; parameters as `equations.left_over`."""
    windows = Windows.of(period)
    motor, link, q = nominal.motors[0], nominal.link[0], said[nominal.role]
    kernel = (motor["inertia"] + link["inertia"]) * windows.curve + (motor["damping"] + link["damping"]) * windows.rate
    equation = Sum(windows, inside)
    equation.add(q, kernel)
    equation.noisy(nominal.role, 1.0, kernel)
    equation.add(link["gravity"] * np.sin(q - link["hangs_at"]), windows.value)
    equation.noisy(nominal.role, float(link["gravity"]), windows.value)
    equation.add(-_held(said["motor_torque"]), windows.value)
    equation.noisy("motor_torque", -1.0, windows.value)
    return {"motor": equation.done(qualities)}


def rig_text(machine: Machine, roles: list[str]) -> str:
    """Return the rig file of a nominal servo."""
    name, motor, row = machine.joint, machine.motors[0], machine.link[0]
    lines = ['name = "hidden machine"', "", f"[joint.{name}]", 'kind = "rigid"', ""]
    lines += table(
        f"joint.{name}.motor", {"inertia": motor["inertia"], "damping": motor["damping"], "gear_ratio": motor["gear"]}
    )
    link = {"inertia": row["inertia"], "damping": row["damping"]}
    if row["gravity"]:
        link |= {"gravity_torque": row["gravity"], "gravity_angle": row["hangs_at"]}
    lines += table(f"joint.{name}.link", link)
    return "\n".join([*lines, *channel_lines(name, roles)]) + "\n"
