"""Joints whose equations are written out here, moved by scipy and felt by sensors that are written out here too.

Nothing of vsalog's mechanics or simulation is used: what a test hides in a log is hidden by this file alone.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.integrate import solve_ivp

from vsalog.core.signals import JointSignals
from vsalog.residuals.channels import channels_of
from vsalog.rig import Rig

ELASTIC = """
[joint.arm]
kind = "elastic"
[joint.arm.motor]
inertia = 0.02
damping = 0.05
[joint.arm.transmission]
type = "cubic"
stiffness = 12.0
cubic = 150.0
[joint.arm.link]
inertia = 0.03
damping = 0.02
gravity_torque = 1.5
[joint.arm.signals]
motor_position = "motor position"
link_position = "link position"
motor_torque = "motor torque"
torque_sensor = "torque sensor"
"""
ROLES = ("motor_position", "link_position", "motor_torque", "torque_sensor")
# What the sensors add: steps of the encoders [rad], white noise of the torques [N·m].
STEP, NOISE = 2e-4, 5e-3


def drive(seed=0):
    """A torque of many waves, odd enough to tell all effects of an elastic joint apart: t → N·m."""
    phase = np.random.default_rng(seed).uniform(0, 6, 5).tolist()
    waves = list(zip((0.31, 0.73, 1.37, 2.3, 3.9), (0.9, 0.7, 0.5, 0.4, 0.3), phase, strict=True))

    def torque(t):
        sine = np.sin if isinstance(t, np.ndarray) else math.sin
        return sum(a * sine(2 * math.pi * f * t + p) for f, a, p in waves)

    return torque


def nothing(*_):
    """Is not there."""
    return 0.0


@dataclass(frozen=True)
class Truth:
    """What an elastic joint has, each a number of the equations in `elastic`."""

    inertia: float = 0.02
    damping: float = 0.05
    coulomb: float = 0.0
    stiffness: float = 12.0
    cubic: float = 150.0
    link_inertia: float = 0.03
    link_damping: float = 0.02
    gravity: float = 1.5
    gain: float = 1.0
    offset: float = 0.0
    delay: float = 0.0
    push: tuple = (0.0, 0.1, 0.0)
    extra: Callable = nothing
    at_motor: Callable = nothing
    at_link: Callable = nothing


def elastic(time, truth, torque=None):
    """Move the joint: role → value and two derivatives, shape (3, N), exact to the integrator's tolerance.

    B θ̈ + D θ̇ + F tanh(θ̇/v₀) − τ_e = τ + at_motor(θ, θ̇),  M q̈ + D_q q̇ + G sin q + τ_e = τ_ext + at_link(q, q̇),
    τ_e = k φ + k₃ φ³ + extra(t, θ, φ),  φ = q − θ
    """
    torque = torque or drive()
    start, length, height = truth.push

    def spring(t, theta, phi):
        return truth.stiffness * phi + truth.cubic * phi**3 + truth.extra(t, theta, phi)

    def accelerations(t, q, dq, a, da, m=math):
        e, u = spring(t, a, q - a), (t - start) / length
        pushed = height * m.sin(math.pi * u) ** 2 * ((u > 0) & (u < 1)) if height else 0.0
        rubbed = truth.coulomb * m.tanh(da / 1e-4)
        pushed = pushed + truth.at_link(q, dq)
        ddq = (pushed - e - truth.link_damping * dq - truth.gravity * m.sin(q)) / truth.link_inertia
        return ddq, (torque(t) + truth.at_motor(a, da) + e - truth.damping * da - rubbed) / truth.inertia

    def equations(t, x):
        q, dq, a, da = x.tolist()
        ddq, dda = accelerations(t, q, dq, a, da)
        return [dq, ddq, da, dda]

    method = "LSODA" if truth.coulomb else "DOP853"
    found = solve_ivp(equations, (0, time[-1]), np.zeros(4), method, time, rtol=1e-8, atol=1e-10, max_step=0.05)
    assert found.success
    q, dq, a, da = found.y
    ddq, dda = accelerations(time, q, dq, a, da, np)
    return {
        "link_position": np.stack([q, dq, ddq]),
        "motor_position": np.stack([a, da, dda]),
        "torque_sensor": derived(spring(time, a, q - a), time),
        "motor_torque": derived(torque(time), time),
    }


@cache
def motion(truth, duration, period, seed):
    """Time, and how a joint moves in it; computed once."""
    time = np.arange(round(duration / period)) * period
    return time, elastic(time, truth, drive(seed))


def derived(values, time):
    """Value and two derivatives by differences."""
    first = np.gradient(values, time)
    return np.stack([values, first, np.gradient(first, time)])


def sensed(roles, time, truth, seed=0, loud=1.0):
    """What sensors say of the joint: encoders with steps, torques with noise; the torque sensor as `truth` has it."""
    rng, step = np.random.default_rng([seed, 1]), loud * STEP
    said = {}
    for role, values in roles.items():
        x = values[0]
        if role.endswith("position"):
            shift = rng.uniform(-0.5, 0.5) * step
            said[role] = np.round((x + shift) / step) * step - shift
            continue
        if role == "torque_sensor":
            x = truth.gain * np.interp(time - truth.delay, time, x) + truth.offset
        said[role] = x + loud * NOISE * rng.standard_normal(x.size)
    return said


def signals(said, period, joint="arm"):
    """Sensors' samples as they are bound to a joint."""
    n = next(iter(said.values())).size
    stamps = np.arange(n, dtype=np.int64) * round(period * 1e9)
    starts = np.zeros(n, dtype=bool)
    starts[0] = True
    return JointSignals(joint, period, stamps, np.arange(n) * period, said, starts, np.zeros(n, dtype=np.int32))


def log(truth=None, duration=10.0, period=2e-3, seed=0, roles=ROLES, loud=1.0):
    """Samples of a joint's sensors: time and role → values; `loud` times as noisy as others."""
    truth = truth or Truth()
    felt = {"gain": 1.0, "offset": 0.0, "delay": 0.0}
    time, moved = motion(replace(truth, **felt), duration, period, seed)
    said = sensed(moved, time, truth, seed, loud)
    return time, {role: said[role] for role in roles}


def channels(truth=None, **options):
    """Filtered channels of a joint's log."""
    time, said = log(truth, **options)
    return channels_of(signals(said, time[1] - time[0]))


def write_csv(path, time, said):
    """Write samples as the log that `ELASTIC` names the channels of."""
    units = {"position": "rad", "torque": "N·m", "sensor": "N·m"}
    names = {role: role.replace("_", " ") for role in said}
    header = ",".join(["time [s]", *(f"{n} [{units[n.split()[-1]]}]" for n in names.values())])
    np.savetxt(path, np.column_stack([time, *said.values()]), "%.9g", ",", header=header, comments="", encoding="utf-8")


def joint_of(text=ELASTIC):
    """The first joint of a rig file."""
    return next(iter(Rig.from_toml(text).joints.values()))
