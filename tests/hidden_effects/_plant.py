"""Compiled: the hidden machines. Elastic, antagonistic and serial joints, stepped by classical Runge–Kutta.

One or two motors, their springs, one link. Every effect is smooth enough for a fixed step: friction is bristles (LuGre: Canudas
de Wit, Olsson, Åström, Lischinsky 1995), a gap has damped walls, hysteresis is a Bouc–Wen loop or slipping springs. This file
imports no other of the package, and nothing of vsalog.
"""

from __future__ import annotations

import numpy as np
from numba import njit

ELASTIC, ANTAGONISTIC, SERIAL = 0, 1, 2
CUBIC, FOUR_BAR, LEVER = 0, 1, 2

# Numbers of a machine. All are as the joint feels them; everything but the first few of each is an effect and absent at zero.
BRISTLES = [
    ("level", "f8"),  # kinetic level of dry friction [N·m]
    ("breakaway", "f8"),  # level at rest, at least `level` [N·m]
    ("stribeck", "f8"),  # velocity over which it falls [rad/s]
    ("load", "f8"),  # level per transmitted torque
    ("presliding", "f8"),  # travel of the bristles until they slip [rad]
    ("heating", "f8"),  # level that the friction has gained when it is warm [N·m]
    ("warm_up", "f8"),  # time over which it warms [s]
    ("warm_speed", "f8"),  # mean speed at which it becomes warm [rad/s]
    ("uneven", "f8"),  # share of the level by which it rises and falls over the position
    ("uneven_order", "f8"),  # periods per radian
    ("uneven_phase", "f8"),
]
MOTOR = np.dtype(
    [
        ("inertia", "f8"),
        ("damping", "f8"),
        ("gear", "f8"),
        ("gain", "f8"),
        ("offset", "f8"),
        ("delay", "f8"),
        ("cogging", "f8"),
        ("order", "f8"),  # per turn of the rotor
        ("phase", "f8"),
        ("detent", "f8"),  # height of a magnetic bump at one angle [N·m]
        ("detent_at", "f8"),
        ("detent_width", "f8"),
        ("ripple", "f8"),  # share of the drive's torque that comes and goes over the rotor's turn
        ("ripple_order", "f8"),
        ("ripple_phase", "f8"),
        ("lag", "f8"),  # time constant of the drive's first-order filter [s]
        *BRISTLES,
    ]
)
SPRING = np.dtype(
    [
        ("law", "f8"),
        ("k1", "f8"),  # N·m/rad; of the lever N/m
        ("k3", "f8"),  # N·m/rad³; of the four-bar mechanism its geometry C
        ("factor", "f8"),
        ("added_cubic", "f8"),
        ("asymmetry", "f8"),
        ("gap", "f8"),  # whole width [rad]
        ("wall", "f8"),  # damping of the gap's walls per torque [s/rad]
        ("drift", "f8"),
        ("damping", "f8"),
        ("loop", "f8"),  # half the height of a Bouc–Wen loop [N·m]
        ("width", "f8"),
        ("slip_torque", "f8"),  # half the height of three slipping springs' loop [N·m]
        ("slip_width", "f8"),  # deflection at which the last of them slips [rad]
        ("yields", "f8"),  # how far the spring's rest moves [rad]
        ("yields_at", "f8"),  # and when [s]
    ]
)
LINK = np.dtype(
    [
        ("inertia", "f8"),
        ("damping", "f8"),
        ("gravity", "f8"),
        ("hangs_at", "f8"),
        ("push", "f8"),
        ("push_at", "f8"),
        ("push_lasts", "f8"),
        ("drag", "f8"),  # torque per velocity squared [N·m·s²/rad²]
        ("base_inertia", "f8"),  # of what the joint is mounted on; 0 for the ground
        ("base_stiffness", "f8"),
        ("base_damping", "f8"),
        *BRISTLES,
    ]
)
SERVO = np.dtype([("stiffness", "f8"), ("damping", "f8"), ("limit", "f8"), ("quantum", "f8")])

# Where what stands in the state: two motors, the link, bristles, their warmth, loops, three slipping springs of each, the base.
MOTOR_AT, LINK_AT, BRISTLE_AT, WARMTH_AT, LOOP_AT, SLIP_AT, BASE_AT, STATES = 0, 4, 6, 9, 12, 14, 20, 22
# Three equal springs that slip one after another, at these shares of `slip_width`.
SLIP_SHARES = (0.25, 0.6, 1.0)
# Speed that a part may gain within a sample [rad/s], and the most steps per second.
BRISTLE_MARGIN, MOST_STEPS = 0.2, 6e4
# How fast a spring yields [s].
YIELD_TIME = 0.02


@njit(cache=True, error_model="numpy")
def spring_torque(spring, u, arm):
    """Return the torque of the bare spring [N·m]; `arm` is the lever's [m]."""
    if spring.law == CUBIC:
        return (spring.k1 + spring.k3 * u * u) * u
    if spring.law == FOUR_BAR:
        # β = asin(C sin(φ/2)) − φ/2 and τ = 2 k β dβ/dφ (Flacco 2012 eq. 47–48)
        s = spring.k3 * np.sin(0.5 * u)
        slope = 0.5 * (spring.k3 * np.cos(0.5 * u) / np.sqrt(1.0 - s * s) - 1.0)
        return 2.0 * spring.k1 * (np.arcsin(s) - 0.5 * u) * slope
    return spring.k1 * arm * arm * np.sin(2.0 * u)


@njit(cache=True, error_model="numpy")
def _transmitted(spring, phi, rate, arm, t, z, y1, y2, y3):
    """Return the transmitted torque, and the deflection beyond the gap with its rate."""
    if spring.yields != 0.0:
        phi -= 0.5 * spring.yields * (1.0 + np.tanh((t - spring.yields_at) / YIELD_TIME))
    half = 0.5 * spring.gap
    u, du = phi, rate
    if half > 0.0:
        u = phi - half if phi > half else phi + half if phi < -half else 0.0
        du = rate if u != 0.0 else 0.0
    scale = (1.0 + spring.drift * t) * (1.0 + spring.asymmetry if u > 0.0 else 1.0 - spring.asymmetry)
    torque = scale * (spring.factor * spring_torque(spring, u, arm) + spring.added_cubic * u * u * u)
    if half > 0.0:
        # Walls that give way more reluctantly the faster they are hit (Hunt and Crossley 1975); they do not pull.
        torque *= max(1.0 + spring.wall * du * np.sign(u), 0.0)
    torque += spring.damping * du + spring.loop * z
    torque += spring.slip_torque * (y1 + y2 + y3) / 3.0
    return torque, u, du


@njit(cache=True, error_model="numpy")
def _bristles(part, z, x, v, load, warmth):
    """Return friction torque and ż of bristles; z is normalised to the kinetic level, or to the level if that varies."""
    level = part.level + part.load * abs(load) + part.heating * warmth
    if part.presliding <= 0.0:
        return 0.0, 0.0
    if part.uneven != 0.0:
        level *= 1.0 + part.uneven * np.sin(part.uneven_order * x + part.uneven_phase)
    ratio = 1.0
    if level > 0.0 and part.breakaway > part.level:
        s = v / part.stribeck
        ratio = level / (level + (part.breakaway - part.level) * np.exp(-s * s))
    return level * z, (v - abs(v) * z * ratio) / part.presliding


@njit(cache=True, error_model="numpy")
def _warming(part, v, warmth):
    if part.heating == 0.0:
        return 0.0
    return (abs(v) / part.warm_speed - warmth) / part.warm_up


@njit(cache=True, error_model="numpy")
def _rates(device, motors, springs, links, lever, x, t, applied, out, torques):
    """Write ẋ into `out` and the transmitted torques into `torques`; `applied` are the torques the drives make."""
    link = links[0]
    q, dq = x[LINK_AT], x[LINK_AT + 1]
    total = 0.0
    reaction = 0.0
    for i in range(2 if device == ANTAGONISTIC else 1):
        spring = springs[i]
        arm = lever[0] - lever[1] * x[2] if device == SERIAL else 0.0
        theta, dtheta = x[2 * i], x[2 * i + 1]
        y = SLIP_AT + 3 * i
        torque, u, du = _transmitted(spring, q - theta, dq - dtheta, arm, t, x[LOOP_AT + i], x[y], x[y + 1], x[y + 2])
        torques[i] = torque
        total += torque
        if spring.loop != 0.0:
            out[LOOP_AT + i] = (du - abs(du) * x[LOOP_AT + i]) / spring.width
        else:
            out[LOOP_AT + i] = 0.0
        for j in range(3 if spring.slip_torque != 0.0 else 0):
            # A slipping spring is a sharp Bouc–Wen loop: exponent 5 instead of 1.
            z = x[y + j]
            z2 = z * z
            out[y + j] = (du - abs(du) * z * z2 * z2) / (SLIP_SHARES[j] * spring.slip_width)
        if device == SERIAL:
            # ψ_e = ∂U/∂θ_c with U = scale · k r² sin²φ (Flacco 2012 eq. 52)
            side = 1.0 + spring.asymmetry if u > 0.0 else 1.0 - spring.asymmetry
            scale = spring.factor * (1.0 + spring.drift * t) * side
            reaction = -2.0 * scale * spring.k1 * lever[1] * arm * np.sin(u) ** 2
    for i in range(1 if device == ELASTIC else 2):
        motor = motors[i]
        theta, dtheta = x[2 * i], x[2 * i + 1]
        load = reaction if device == SERIAL and i == 1 else torques[i]
        dry, dz = _bristles(motor, x[BRISTLE_AT + i], theta, dtheta, load, x[WARMTH_AT + i])
        torque = motor.gain * applied[i] + motor.offset - motor.damping * dtheta - dry
        if motor.ripple != 0.0:
            torque += motor.ripple * applied[i] * np.sin(motor.ripple_order * motor.gear * theta + motor.ripple_phase)
        if motor.cogging != 0.0:
            torque += motor.cogging * np.sin(motor.order * motor.gear * theta + motor.phase)
        if motor.detent != 0.0:
            s = (theta - motor.detent_at) / motor.detent_width
            torque -= motor.detent * s * np.exp(0.5 * (1.0 - s * s))
        torque += -reaction if device == SERIAL and i == 1 else torques[i]
        out[2 * i], out[2 * i + 1] = dtheta, torque / motor.inertia
        out[BRISTLE_AT + i] = dz
        out[WARMTH_AT + i] = _warming(motor, dtheta, x[WARMTH_AT + i])
    dry, dz = _bristles(link, x[BRISTLE_AT + 2], q, dq, total, x[WARMTH_AT + 2])
    torque = -link.damping * dq - dry - link.drag * dq * abs(dq) - total
    # What the joint pushes the link with, it pushes its base back with; rotors are small behind their gears.
    base, shaken = x[BASE_AT], 0.0
    if link.base_inertia > 0.0:
        shaken = (-torque - link.base_stiffness * base - link.base_damping * x[BASE_AT + 1]) / link.base_inertia
    out[BASE_AT], out[BASE_AT + 1] = x[BASE_AT + 1], shaken
    if link.gravity != 0.0:
        torque -= link.gravity * np.sin(q + base - link.hangs_at)
    if link.push != 0.0 and 0.0 < t - link.push_at < link.push_lasts:
        torque += link.push * np.sin(np.pi * (t - link.push_at) / link.push_lasts) ** 2
    out[LINK_AT], out[LINK_AT + 1] = dq, torque / link.inertia - shaken
    out[BRISTLE_AT + 2] = dz
    out[WARMTH_AT + 2] = _warming(link, dq, x[WARMTH_AT + 2])


@njit(cache=True, error_model="numpy")
def _relaxing(motors, links, x):
    """Return how many steps per second the bristles ask for: they relax over their travel, at the speed they are dragged."""
    most = 0.0
    for i in range(2):
        if motors[i].presliding > 0.0:
            most = max(most, (abs(x[2 * i + 1]) + BRISTLE_MARGIN) / motors[i].presliding)
    if links[0].presliding > 0.0:
        most = max(most, (abs(x[LINK_AT + 1]) + BRISTLE_MARGIN) / links[0].presliding)
    return min(most / 1.5, MOST_STEPS)


@njit(cache=True, error_model="numpy")
def rates(device, motors, springs, link, lever, x, t, applied):
    """Return ẋ and the transmitted torques."""
    out, torques = np.zeros(STATES), np.zeros(2)
    _rates(device, motors, springs, link, lever, x, t, applied, out, torques)
    return out, torques


@njit(cache=True, error_model="numpy")
def play(device, motors, springs, link, lever, servos, wanted, start, period, step, x0):
    """Let the servos follow what is wanted, and record what happens.

    Parameters
    ----------
    device, motors, springs, link, lever : the machine; `motors`, `springs`, `servos` have two rows, `lever` is (r₀, b)
    wanted : shape (N, 2, 2), per sample and motor the wanted angle [rad] and velocity [rad/s]
    start : time of the first sample [s]
    period : sample time [s]
    step : no longer are steps [s]; bristles may ask for shorter ones
    x0 : shape (STATES,), the state at the start

    Returns
    -------
    states : shape (N, STATES), before the sample's command acts
    torques : shape (N, 2), transmitted [N·m]
    commands : shape (N, 2), held from this sample to the next [N·m]
    """
    n = wanted.shape[0]
    states, torques, commands = np.zeros((n, STATES)), np.zeros((n, 2)), np.zeros((n, 2))
    x = x0.copy()
    k1, k2, k3, k4 = np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros(STATES)
    y = np.zeros(STATES)
    applied, scratch, heard, filtered = np.zeros(2), np.zeros(2), np.zeros(2), np.zeros(2)
    late = np.zeros(2)
    whole = np.zeros(2, dtype=np.int64)
    for i in range(2):
        whole[i] = int(np.floor(motors[i].delay / period + 1e-12))
        late[i] = motors[i].delay - whole[i] * period
    edges = np.array([0.0, min(late[0], late[1]), max(late[0], late[1]), period])
    for k in range(n):
        t = start + k * period
        states[k] = x
        _rates(device, motors, springs, link, lever, x, t, applied, k1, scratch)
        torques[k] = scratch
        for i in range(2):
            command = servos[i].stiffness * (wanted[k, i, 0] - x[2 * i]) + servos[i].damping * (
                wanted[k, i, 1] - x[2 * i + 1]
            )
            if servos[i].quantum > 0.0:
                command = np.round(command / servos[i].quantum) * servos[i].quantum
            commands[k, i] = min(max(command, -servos[i].limit), servos[i].limit)
        for part in range(3):
            length = edges[part + 1] - edges[part]
            if length < 1e-9:
                continue
            for i in range(2):
                # Until a late drive has heard of it, the command before acts on.
                at = k - whole[i] - (1 if edges[part] < late[i] - 1e-12 else 0)
                heard[i] = commands[at, i] if at >= 0 else 0.0
                applied[i] = heard[i]
            count = int(np.ceil(length * max(1.0 / step, _relaxing(motors, link, x)) - 1e-9))
            h = length / count
            for j in range(count):
                s = t + edges[part] + j * h
                for i in range(2):
                    if motors[i].lag > 0.0:
                        # What a first-order filter makes of a held command, on average over the step.
                        decay, far = np.exp(-h / motors[i].lag), filtered[i] - heard[i]
                        applied[i] = heard[i] + far * (1.0 - decay) * motors[i].lag / h
                        filtered[i] = heard[i] + far * decay
                _rates(device, motors, springs, link, lever, x, s, applied, k1, scratch)
                for m in range(STATES):
                    y[m] = x[m] + 0.5 * h * k1[m]
                _rates(device, motors, springs, link, lever, y, s + 0.5 * h, applied, k2, scratch)
                for m in range(STATES):
                    y[m] = x[m] + 0.5 * h * k2[m]
                _rates(device, motors, springs, link, lever, y, s + 0.5 * h, applied, k3, scratch)
                for m in range(STATES):
                    y[m] = x[m] + h * k3[m]
                _rates(device, motors, springs, link, lever, y, s + h, applied, k4, scratch)
                for m in range(STATES):
                    x[m] += h / 6.0 * (k1[m] + 2.0 * k2[m] + 2.0 * k3[m] + k4[m])
    return states, torques, commands


@njit(cache=True, error_model="numpy")
def deflections_under(spring, torques, arms, period):
    """Return the deflection that a bare spring and its damper have under sampled torques, by second-order backward steps."""
    out = np.zeros(torques.shape[0])
    u, before = 0.0, 0.0
    most = 1.99 * np.arcsin(1.0 / spring.k3) if spring.law == FOUR_BAR else 1.5
    h = 1e-6
    for k in range(torques.shape[0]):
        guess, damper = u, spring.damping / period
        for _ in range(50):
            rate = 1.5 * guess - 2.0 * u + 0.5 * before
            miss = spring_torque(spring, guess, arms[k]) + damper * rate - torques[k]
            slope = (spring_torque(spring, guess + h, arms[k]) - spring_torque(spring, guess - h, arms[k])) / (2.0 * h)
            change = min(max(-miss / (slope + 1.5 * damper), -0.1), 0.1)
            guess = min(max(guess + change, -most), most)
            if abs(change) < 1e-12:
                break
        before, u = u, guess
        out[k] = guess
    return out
