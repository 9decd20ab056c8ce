"""The log of an elastic drive with known numbers: a motor with dry friction, a spring and a link, integrated here."""

import numpy as np
from scipy.integrate import solve_ivp

INERTIA, DAMPING, LINK, LINK_DAMPING = 0.05, 0.2, 0.1, 0.05
ENCODER = 2.0 * np.pi / 16384.0
NOISE = 0.02


def elastic_drive(stiffness=100.0, friction=0.0, seconds=10.0, seed=0, part=lambda time: 1.0):
    """Return time, positions of motor and link, and the torques of the motor and of the spring on the link; SI, at 500 Hz.

    A position loop follows a sum of sines up to 3 Hz. Friction is blurred over 2 mrad/s. `part` of the stiffness acts at a time.
    """
    rng = np.random.default_rng(seed)
    rates, phases = 2.0 * np.pi * np.exp(rng.uniform(np.log(0.2), np.log(3.0), 8)), rng.uniform(0.0, 2.0 * np.pi, 8)
    sizes = 0.18 / (1.0 + rates / (2.0 * np.pi))
    kp = 0.8 * stiffness
    kd = np.sqrt(kp * (INERTIA + LINK))

    def drive(t, x):
        return kp * (np.sum(sizes * np.sin(rates * t + phases)) - x[0]) - kd * x[1]

    def slopes(t, x):
        spring = part(t) * stiffness * (x[0] - x[2])
        motor = drive(t, x) - spring - DAMPING * x[1] - friction * np.tanh(x[1] / 2e-3)
        return x[1], motor / INERTIA, x[3], (spring - LINK_DAMPING * x[3]) / LINK

    time = np.arange(0.0, seconds, 0.002)
    options = {"method": "LSODA", "rtol": 1e-7, "atol": 1e-9, "max_step": 0.02}
    x = solve_ivp(slopes, (0.0, seconds), np.zeros(4), t_eval=time, **options).y
    motor, link = (np.round(x[i] / ENCODER) * ENCODER for i in (0, 2))
    torque = np.array([drive(t, state) for t, state in zip(time, x.T, strict=True)])
    noise = NOISE * rng.standard_normal((2, time.size))
    return {
        "time": time, "motor_position": motor, "link_position": link, "motor_torque": torque + noise[0],
        "torque_sensor": part(time) * stiffness * (x[2] - x[0]) + noise[1],
    }  # fmt: skip


def write_log(path, columns, leave=()):
    """Write columns as CSV, but for some."""
    kept = {name: values for name, values in columns.items() if name not in leave}
    np.savetxt(path, np.column_stack(list(kept.values())), "%.9g", ",", header=",".join(kept), comments="")
    return path
