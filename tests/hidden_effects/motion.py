"""What the servos are told to follow: multisines, steps and slow ramps with many reversals, played on the nominal machine."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d

from . import _plant
from .machines import Machine, Sensors

# The machine runs for so long before the log begins, and after it ends, so that early and late sensors have something to say.
LEAD = 2.0
TAIL = 0.05
# Steps of the integrator are no longer than this [s].
STEP = 5e-4


@dataclass
class Truth:
    """What truly happened, on a grid that begins LEAD before the log and ends TAIL after it.

    Attributes
    ----------
    time : shape (N,) [s], 0 where the log begins
    roles : role → shape (N,) in SI, as perfect sensors would say it
    inside : the slice of the log
    period : [s]
    """

    time: np.ndarray
    roles: dict[str, np.ndarray]
    inside: slice
    period: float


@dataclass
class Wanted:
    """What the servos are to follow.

    Attributes
    ----------
    values : shape (N, 2, 2), per sample and motor an angle and a velocity
    period : [s]
    poor : whether little was asked for, so that much stays unseen
    """

    values: np.ndarray
    period: float
    poor: bool = False


def _grid(duration: float, period: float) -> np.ndarray:
    return np.arange(-round(LEAD / period), round((duration + TAIL) / period)) * period


def _multisine(time: np.ndarray, low: float, high: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """Sum sines of random frequencies [Hz] whose velocities are alike; rms of about 1."""
    edges = np.exp(np.linspace(np.log(low), np.log(high), count + 1))
    total = np.zeros_like(time)
    for a, b in pairwise(edges):
        f = rng.uniform(a, b)
        total += np.sqrt(low / f) * np.sin(2.0 * np.pi * f * time + rng.uniform(0.0, 2.0 * np.pi))
    return total / np.std(total)


def _steps(time: np.ndarray, dwell: tuple[float, float], rise: float, rng: np.random.Generator) -> np.ndarray:
    """Jump between random levels of −1 … 1, alternating in sign, each smoothed over `rise` [s]."""
    total, t, sign = np.zeros_like(time), time[0], rng.choice([-1.0, 1.0])
    while t < time[-1]:
        end = t + rng.uniform(*dwell)
        total[(time >= t) & (time < end)] = sign * rng.uniform(0.3, 1.0)
        t, sign = end, -sign
    return gaussian_filter1d(total, rise / (time[1] - time[0]), mode="nearest")


def _ramps(time: np.ndarray, leg: tuple[float, float], rng: np.random.Generator) -> np.ndarray:
    """Go at constant speeds from reversal to reversal between random places of −1 … 1."""
    at, places, sign = [time[0]], [0.0], rng.choice([-1.0, 1.0])
    while at[-1] < time[-1]:
        at.append(at[-1] + rng.uniform(*leg))
        places.append(sign * rng.uniform(0.5, 1.0))
        sign = -sign
    line = np.interp(time, at, places)
    return gaussian_filter1d(line, 0.02 / (time[1] - time[0]), mode="nearest")


def _fast(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return 0.8 * _multisine(time, 0.5, 3.0, 5, rng) + 0.6 * _steps(time, (0.4, 1.5), 0.05, rng)


def _shape(time: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return a wide slow part and a quick part, each of order 1, with calm stretches of the quick one."""
    slow = 0.8 * _ramps(time, (1.5, 4.0), rng) + 0.3 * _multisine(time, 0.05, 0.2, 2, rng)
    quick = _fast(time, rng)
    # For about a third of the log only the slow part moves: there dry friction and cogging show.
    lively = np.ones_like(time)
    for begin in rng.uniform(0.1, 0.9, 2) * time[-1]:
        lively[(time >= begin) & (time < begin + 0.15 * time[-1])] = 0.0
    lively = gaussian_filter1d(lively, 0.2 / (time[1] - time[0]), mode="nearest")
    return slow, quick * lively


def wanted(machine: Machine, duration: float, period: float, rng: np.random.Generator, poor: bool = False) -> Wanted:
    """Draw a trajectory whose deflections are what the machine's springs are made for.

    Parameters
    ----------
    machine : nominal
    duration : of the log [s]
    period : sample time [s]
    rng : of the trajectory
    poor : one slow sine only
    """
    time = _grid(duration, period)
    ease = np.clip((time - time[0]) / (0.8 * LEAD), 0.0, 1.0)
    ease = ease**3 * (10.0 - 15.0 * ease + 6.0 * ease**2)
    slow, quick = _shape(time, rng)
    if poor:
        slow, quick = 0.5 * np.sin(2.0 * np.pi * rng.uniform(0.1, 0.3) * time), 0.0 * quick
    values = np.zeros((time.size, 2, 2))
    width = 0.55 * machine.deflection if machine.device == "antagonistic" else rng.uniform(0.8, 1.6)
    centre = float(machine.link[0]["hangs_at"])
    squeeze = np.zeros_like(time)
    if machine.device == "antagonistic":
        squeeze = machine.deflection * (0.45 + 0.2 * _ramps(time, (1.5, 3.5), rng))
    if machine.device == "serial":
        arm = 0.75 + 0.18 * _steps(time, (1.5, 3.5), 0.25, rng) + 0.05 * _multisine(time, 0.2, 0.8, 2, rng)
        lead = (1.0 - np.clip(arm, 0.45, 1.0)) * machine.lever[0] / machine.lever[1]
        values[:, 1, 0] = lead
    quickness = 0.15
    for _ in range(6):
        common = centre + width * slow + quickness * quick
        values[:, 0, 0] = ease * (common + squeeze)
        if machine.device == "antagonistic":
            values[:, 1, 0] = ease * (common - squeeze)
        values[:, :, 1] = np.gradient(values[:, :, 0], period, axis=0)
        most = _most_deflected(machine, values, period)
        aim = machine.deflection * (1.3 if machine.device == "antagonistic" else 1.0)
        if poor or 0.85 * aim < most < 1.02 * aim:
            break
        if not np.isfinite(most):
            quickness, width, squeeze = 0.5 * quickness, 0.8 * width, 0.9 * squeeze
        else:
            quickness *= float(np.clip(aim / most, 0.5, 2.0))
    return Wanted(values, period, poor)


def _most_deflected(machine: Machine, values: np.ndarray, period: float) -> float:
    states, _, _ = _play(machine, values, period, 1e-3)
    phi = states[:, 4:5] - states[:, [0, 2]][:, : len(machine.suffixes)]
    return float(np.max(np.abs(phi))) if np.isfinite(phi).all() else float("nan")


def _play(machine: Machine, values: np.ndarray, period: float, step: float = STEP):
    x0 = np.zeros(_plant.STATES)
    return _plant.play(
        machine.code, machine.motors, machine.springs, machine.link, machine.lever, machine.servos,
        values, -round(LEAD / period) * period, period, step, x0,
    )  # fmt: skip


def happened(machine: Machine, follow: Wanted) -> Truth | None:
    """Let a machine follow; none where it broke (a four-bar mechanism beyond its singularity)."""
    states, torques, commands = _play(machine, follow.values, follow.period)
    if not (np.isfinite(states).all() and np.isfinite(torques).all()):
        return None
    lead, tail = round(LEAD / follow.period), round(TAIL / follow.period)
    time = (np.arange(states.shape[0]) - lead) * follow.period
    roles = {"link_position": states[:, 4]}
    for i, suffix in enumerate(machine.suffixes):
        roles[f"motor_position{suffix}"] = states[:, 2 * i]
        roles[f"motor_torque{suffix}"] = commands[:, i]
        roles[f"torque_sensor{suffix}"] = torques[:, i]
    if machine.device == "serial":
        roles["setpoint"], roles["secondary_torque"] = states[:, 2], commands[:, 1]
    return Truth(time, roles, slice(lead, states.shape[0] - tail), follow.period)


__all__ = ["LEAD", "TAIL", "Sensors", "Truth", "Wanted", "happened", "wanted"]
