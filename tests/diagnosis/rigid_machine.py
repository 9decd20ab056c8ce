"""Rigid joints whose equations are written out here, moved by scipy and felt by sensors that are written out here too.

Nothing of vsalog's mechanics or simulation is used: what a test hides in a log is hidden by this file alone.
"""

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.integrate import solve_ivp

RIGID = """
[joint.arm]
kind = "rigid"
[joint.arm.motor]
inertia = 0.02
damping = 0.05
gear_ratio = 10.0
[joint.arm.motor.friction]
coulomb = 0.2
[joint.arm.link]
inertia = 0.05
gravity_torque = 1.5
[joint.arm.signals]
motor_position = "motor position"
motor_torque = "motor torque"
"""
ROLES = ("motor_position", "motor_torque")
STEP, NOISE = 1e-4, 5e-3
SWITCH = 2e-3  # [rad/s], over which friction changes its sign


@dataclass(frozen=True)
class Truth:
    """What a rigid joint has, each a number of the equation in `moved`; then what its sensors and its drive have."""

    inertia: float = 0.07
    damping: float = 0.05
    coulomb: float = 0.2
    excess: float = 0.0
    stribeck: float = 0.3
    load: float = 0.0
    cogging: tuple = (0.0, 6.0, 0.4)
    gravity: float = 1.5
    constant: float = 1.0
    torque_offset: float = 0.0
    torque_delay: float = 0.0
    push: tuple = (0.0, 0.1, 0.0)
    detent: tuple = (0.0, 0.3, 0.1)
    offset: float = 0.0
    scale: float = 1.0
    eccentricity: tuple = (0.0, 0.0)
    late: float = 0.0


def drive(seed=0):
    """A torque of many waves: t → N·m."""
    phase = np.random.default_rng(seed).uniform(0, 6, 6).tolist()
    waves = list(zip((0.13, 0.41, 0.83, 1.57, 2.6, 4.1), (1.2, 1.1, 0.8, 0.6, 0.5, 0.4), phase, strict=True))

    def torque(t):
        sine = np.sin if isinstance(t, np.ndarray) else math.sin
        return sum(a * sine(2 * math.pi * f * t + p) for f, a, p in waves)

    return torque


@cache
def moved(truth, duration, period, seed):
    """Time, and the joint's position in it.

    J q̈ + D q̇ + (C + E exp(−(q̇/v_s)²) + μ |G sin q|) tanh(q̇/v₀) + G sin q = k τ(t − d) + τ₀ + A sin(n γ q + α) + push + detent
    """
    torque, (start, length, height) = drive(seed), truth.push
    amplitude, order, phase = truth.cogging
    depth, place, width = truth.detent

    def equations(t, x):
        q, dq = x.tolist()
        weight, u = truth.gravity * math.sin(q), (t - start) / length
        level = truth.coulomb + truth.excess * math.exp(-((dq / truth.stribeck) ** 2)) + truth.load * abs(weight)
        acts = truth.constant * torque(max(t - truth.torque_delay, 0.0)) + truth.torque_offset
        acts += amplitude * math.sin(order * 10.0 * q + phase) + (
            height * math.sin(math.pi * u) ** 2 if 0 < u < 1 else 0.0
        )
        acts += depth * math.exp(-(((q - place) / width) ** 2))
        return [dq, (acts - truth.damping * dq - level * math.tanh(dq / SWITCH) - weight) / truth.inertia]

    time = np.arange(round(duration / period)) * period
    found = solve_ivp(equations, (0, time[-1]), [0.0, 0.0], "LSODA", time, rtol=1e-8, atol=1e-10, max_step=5e-3)
    assert found.success
    return time, found.y[0]


def log(truth=None, duration=12.0, period=2e-3, seed=0, roles=ROLES, loud=1.0):
    """Samples of a joint's sensors: time and role → values."""
    truth = truth or Truth()
    sensed = {"offset": 0.0, "scale": 1.0, "eccentricity": (0.0, 0.0), "late": 0.0}
    time, q = moved(replace(truth, **sensed), duration, period, seed)
    rng = np.random.default_rng([seed, 2])
    x = np.interp(time - truth.late, time, q)
    amplitude, phase = truth.eccentricity
    x = truth.scale * x + truth.offset + amplitude * np.sin(x + phase)
    step, shift = loud * STEP, rng.uniform(-0.5, 0.5)
    angle = (np.round(x / step + shift) - shift) * step
    torque = drive(seed)(time) + loud * NOISE * rng.standard_normal(time.size)
    said = {"motor_position": angle, "link_position": angle, "motor_torque": torque}
    return time, {role: said[role] for role in roles}
