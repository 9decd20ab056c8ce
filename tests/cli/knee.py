"""The log and the rig that tests of the command line are simulated with: a knee with a spring of 20 N·m/rad that a sine moves."""

import numpy as np

RIG = """
[joint.knee]
kind = "elastic"
[joint.knee.motor]
inertia = 0.1
[joint.knee.signals]
motor_position = "theta"
motor_torque = "tau"
link_position = "q"
torque_sensor = "sensor"
"""
HEADER = "time [s],theta [rad],tau [N·m],q [rad],sensor [N·m]"


def write_log(path, rows=3000, period=1e-3, stiffness=20.0, header=HEADER, **columns):
    """Write the log as a table; columns that are given take the place of its own."""
    t = np.arange(rows) * period
    theta, q = 0.3 * np.sin(6.0 * t), 0.4 * np.sin(6.0 * t + 0.3)
    torque = stiffness * (q - theta)
    own = {"time": t, "theta": theta, "tau": -0.1 * 36.0 * theta - torque, "q": q}
    own["sensor"] = torque + 0.01 * np.random.default_rng(1).standard_normal(rows)
    table = zip(*(columns.get(name, values) for name, values in own.items()), strict=True)
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in table)]))


def lay(folder, **log):
    """Put the log into a folder, and its rig next to it."""
    write_log(folder / "log.csv", **log)
    (folder / "rig.toml").write_text(RIG)
