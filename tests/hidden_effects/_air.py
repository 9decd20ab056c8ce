"""Compiled: two pneumatic muscles pull a seesaw, a valve each fills and empties them (Shin, Ibayashi, Kogiso 2021 eq. 2–11).

Friction is bristles that hold up to the level of eq. 10, so that it has no corner; classical Runge–Kutta steps. This file imports
no other of the package, and nothing of vsalog.
"""

from __future__ import annotations

import numpy as np
from numba import njit

AIR = np.dtype(
    [
        ("supply", "f8"),
        ("outside", "f8"),
        ("inflow_index", "f8"),
        ("volume_index", "f8"),
        ("heat_ratio", "f8"),
        ("gas", "f8"),  # R T [J/kg]
    ]
)
# A muscle with its valve.
MUSCLE = np.dtype(
    [
        ("length", "f8"),
        ("d1", "f8"),
        ("d2", "f8"),
        ("d3", "f8"),
        ("pv1", "f8"),
        ("pv2", "f8"),
        ("pw1", "f8"),
        ("pw2", "f8"),
        ("gain", "f8"),
        ("leak", "f8"),
        ("inflow", "f8"),
        ("outflow", "f8"),
        ("scale", "f8"),
        ("offset", "f8"),
    ]
)
SEESAW = np.dtype(
    [
        ("radius", "f8"),
        ("inertia", "f8"),
        ("return_stiffness", "f8"),
        ("mass", "f8"),
        ("gravity", "f8"),
        ("viscous", "f8"),
        ("shaft_radius", "f8"),
        ("shaft_coefficient", "f8"),
        ("muscle", "f8"),
        ("presliding", "f8"),
        ("heating", "f8"),  # level that friction has gained when it is warm [N·m]
        ("warm_up", "f8"),
        ("warm_speed", "f8"),
        ("bump", "f8"),  # a magnet's torque at one angle [N·m]
        ("bump_at", "f8"),
        ("bump_width", "f8"),
    ]
)
# Angle, velocity, two pressures, bristles, their warmth.
STATES = 6


@njit(cache=True, error_model="numpy")
def flow(air, up, down):
    """Return the mass flow per area from one absolute pressure to another, of an isentropic nozzle (eq. 5) [kg/(s·m²)]."""
    high, low = max(up, down), min(up, down)
    k = air.heat_ratio
    ratio = max(low / high, (2.0 / (k + 1.0)) ** (k / (k - 1.0)))
    size = high * np.sqrt(2.0 * k / (k - 1.0) * (ratio ** (2.0 / k) - ratio ** ((k + 1.0) / k)) / air.gas)
    return size if up > down else -size


@njit(cache=True, error_model="numpy")
def pull(muscle, pressure, length):
    """Return F = gain ((p_v1 l + p_v2) P + p_w1 l + p_w2) (eq. 6–7) [N]."""
    return muscle.gain * ((muscle.pv1 * length + muscle.pv2) * pressure + muscle.pw1 * length + muscle.pw2)


@njit(cache=True, error_model="numpy")
def valve_flow(air, muscle, opening, pressure):
    """Return the mass flow of a valve into its muscle (below eq. 5) [kg/s]."""
    net = opening * flow(air, air.supply, pressure) - (1.0 - opening) * flow(air, pressure, air.outside)
    return muscle.scale * (muscle.inflow if net > 0.0 else muscle.outflow) * net


@njit(cache=True, error_model="numpy")
def dry_level(air, seesaw, p1, p2, f1, f2, warmth):
    """Return T_s + T_p of eq. 10, and what warmth has added [N·m]."""
    shaft = seesaw.shaft_radius * seesaw.shaft_coefficient * abs(f1 + f2 - seesaw.mass * seesaw.gravity)
    g1, g2 = max(p1 - air.outside, 1e3), max(p2 - air.outside, 1e3)
    return shaft + seesaw.muscle * (1.0 / g1**2 + 1.0 / g2**2) + seesaw.heating * warmth


@njit(cache=True, error_model="numpy")
def rates(air, muscles, seesaw, x, openings, out):
    """Write ẋ into `out`; return the muscles' torque (eq. 9)."""
    travel = seesaw[0].radius * np.sin(x[0])
    turning = seesaw[0].radius * np.cos(x[0])
    f1 = pull(muscles[0], x[2], muscles[0].length - travel)
    f2 = pull(muscles[1], x[3], muscles[1].length + travel)
    torque = turning * (f1 - f2)
    level = dry_level(air[0], seesaw[0], x[2], x[3], f1, f2, x[5])
    out[0] = x[1]
    total = torque - level * x[4] - seesaw[0].viscous * x[1] - seesaw[0].return_stiffness * x[0]
    if seesaw[0].bump != 0.0:
        s = (x[0] - seesaw[0].bump_at) / seesaw[0].bump_width
        total -= seesaw[0].bump * s * np.exp(0.5 * (1.0 - s * s))
    out[1] = total / seesaw[0].inertia
    out[4] = (x[1] - abs(x[1]) * x[4]) / seesaw[0].presliding
    out[5] = 0.0
    if seesaw[0].heating != 0.0:
        out[5] = (abs(x[1]) / seesaw[0].warm_speed - x[5]) / seesaw[0].warm_up
    for i in range(2):
        muscle, sign = muscles[i], -1.0 if i == 0 else 1.0
        length = muscle.length + sign * travel
        volume = (muscle.d1 * length + muscle.d2) * length + muscle.d3
        swelling = (2.0 * muscle.d1 * length + muscle.d2) * sign * turning * x[1]
        p = x[2 + i]
        net = valve_flow(air[0], muscle, openings[i], p) - muscle.leak * flow(air[0], p, air[0].outside)
        out[2 + i] = (air[0].inflow_index * air[0].gas * net - air[0].volume_index * swelling * p) / volume
    return torque


@njit(cache=True, error_model="numpy")
def play(air, muscles, seesaw, maps, voltages, period, step, x0):
    """Play voltages that are held from sample to sample.

    Parameters
    ----------
    air, muscles, seesaw : the machine
    maps : shape (2, 2, K), per valve the voltages and the openings of its map
    voltages : shape (N, 2), commanded [V]
    period, step : sample time, and how long steps may be [s]
    x0 : shape (STATES,)

    Returns
    -------
    states : shape (N, STATES), before the sample's voltage acts
    torques : shape (N,), the muscles' [N·m]
    """
    n = voltages.shape[0]
    states, torques = np.zeros((n, STATES)), np.zeros(n)
    x, y = x0.copy(), np.zeros(STATES)
    k1, k2, k3, k4 = np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros(STATES)
    openings = np.zeros(2)
    for k in range(n):
        for i in range(2):
            openings[i] = np.interp(voltages[k, i] + muscles[i].offset, maps[i, 0], maps[i, 1])
        states[k] = x
        torques[k] = rates(air, muscles, seesaw, x, openings, k1)
        relaxing = (abs(x[1]) + 0.15) / seesaw[0].presliding / 1.5
        count = int(np.ceil(period * min(max(1.0 / step, relaxing), 2e6) - 1e-9))
        h = period / count
        for _ in range(count):
            rates(air, muscles, seesaw, x, openings, k1)
            for m in range(STATES):
                y[m] = x[m] + 0.5 * h * k1[m]
            rates(air, muscles, seesaw, y, openings, k2)
            for m in range(STATES):
                y[m] = x[m] + 0.5 * h * k2[m]
            rates(air, muscles, seesaw, y, openings, k3)
            for m in range(STATES):
                y[m] = x[m] + h * k3[m]
            rates(air, muscles, seesaw, y, openings, k4)
            for m in range(STATES):
                x[m] += h / 6.0 * (k1[m] + 2.0 * k2[m] + 2.0 * k3[m] + k4[m])
    return states, torques
