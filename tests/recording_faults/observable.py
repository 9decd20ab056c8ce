"""Whether a fault can be noticed at all: by a fit of a joint's equations that is written apart from vsalog's.

Savitzky-Golay derivatives, springs that rise with the deflection, and scipy's non-negative least squares. A fault of what
channels have to do with one another can be noticed where an equation leaves ten times as much of its target as of the sound log.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, signal

from vsalog.core.recording import Recording

Array = NDArray[np.float64]

NOTICED = 10.0
WINDOW = 41
EVERY = 10


def left_by_equations(recording: Recording, channels: Mapping[str, str]) -> dict[str, float]:
    """Return what equations leave of a joint's channels, over the spread of their targets."""
    first = recording.channels[next(iter(channels.values()))]
    t = (first.stamps - first.stamps[0]) * 1e-9
    period = float(np.median(np.diff(t)))
    at: dict[tuple[str, int], Array] = {}
    for role, name in channels.items():
        channel = recording.channels[name]
        x = np.interp(t, (channel.stamps - first.stamps[0]) * 1e-9, channel.values)
        for order in range(3):
            d = signal.savgol_filter(x, WINDOW, 4, deriv=order, delta=period)
            at[role, order] = d[WINDOW:-WINDOW:EVERY]
    out: dict[str, float] = {}
    has = set(channels)
    for s in ("", "_1", "_2"):
        if {"link_position", f"motor_position{s}"} <= has:
            phi = at["link_position", 0] - at[f"motor_position{s}", 0]
            rate = at["link_position", 1] - at[f"motor_position{s}", 1]
            if f"torque_sensor{s}" in has:
                out[f"spring{s}"] = _left(at[f"torque_sensor{s}", 0], [*_ramps(phi, at, has), rate], [])
            if not s:
                out["pair"] = float(np.var(phi) / np.var(at["link_position", 0]))
        if {f"motor_torque{s}", f"motor_position{s}", f"torque_sensor{s}"} <= has:
            total = at[f"motor_torque{s}", 0] + at[f"torque_sensor{s}", 0]
            out[f"motor{s}"] = _left(total, _resistance(at, f"motor_position{s}"), [], at[f"motor_torque{s}", 0])
    if "link_position" in has and not any(r.startswith("motor_position") for r in has):
        q = at["link_position", 0]
        for torque in {"motor_torque", "torque_sensor"} & has:
            out[f"body {torque}"] = _left(at[torque, 0], _resistance(at, "link_position"), [np.sin(q), np.cos(q)])
    return out


def noticed(sound: Mapping[str, float], faulty: Mapping[str, float]) -> bool:
    """Tell whether an equation leaves so much more that a fault can be noticed."""
    return any(faulty[e] > NOTICED * sound[e] for e in sound)


def _resistance(at: Mapping[tuple[str, int], Array], role: str) -> list[Array]:
    speed = at[role, 1]
    return [at[role, 2], speed, np.tanh(20.0 * speed / np.std(speed))]


def _ramps(phi: Array, at: Mapping[tuple[str, int], Array], has: set[str]) -> list[Array]:
    """Return functions that rise with the deflection, over a set-point where there is one."""
    knots = np.linspace(float(phi.min()), float(phi.max()), 13)
    ramps = [np.clip(phi - a, 0.0, b - a) for a, b in pairwise(knots.tolist())]
    if "setpoint" not in has:
        return ramps
    r = at["setpoint", 0]
    r = (r - r.min()) / (np.ptp(r) or 1.0)
    return [ramp * power for ramp in ramps for power in (np.ones_like(r), r, r**2, 1.0 - r)]


def _left(y: Array, positive: list[Array], free: list[Array], target: Array | None = None) -> float:
    free = [np.ones_like(y), *free]
    columns = np.column_stack([*positive, *free, *(-f for f in free)])
    size = np.linalg.norm(columns, axis=0)
    _, norm = optimize.nnls(columns / np.where(size > 0.0, size, 1.0), y)
    target = y if target is None else target
    return float(norm**2 / np.sum((target - target.mean()) ** 2))
