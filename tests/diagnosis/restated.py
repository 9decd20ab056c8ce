"""One log and its rig, with one role recorded otherwise: the rig states how, so that nothing may come out differently."""

import numpy as np

from vsalog.diagnosis.run import bound_as_recorded
from vsalog.readers import read
from vsalog.rig import Rig

RATIO, COUNTS = 10.0, 4000 / (2 * np.pi)
# How a position or a torque may be recorded, and its rig: values, time → values; the signal's keys; unit in the log.
POSITIONS = {
    "unit": (lambda x, t: np.degrees(x), 'unit = "deg"', ""),
    "unit-of-log": (lambda x, t: np.degrees(x), "", "deg"),
    "gain": (lambda x, t: 2.0 * x, "gain = 2.0", ""),
    "counts": (lambda x, t: COUNTS * x + 100.0, f"gain = {COUNTS!r}, offset = 100.0", ""),
    "offset": (lambda x, t: x + 0.3, 'offset = "0.3 rad"', ""),
    "drift": (lambda x, t: x + 0.02 * t, "drift = 0.02", ""),
    "sign": (lambda x, t: -x, "sign = -1", ""),
    "delay": (lambda x, t: np.interp(t - 6e-3, t, x), 'delay = "6 ms"', ""),
    "early": (lambda x, t: np.interp(t + 6e-3, t, x), 'delay = "-6 ms"', ""),
}
TORQUES = {
    "unit": (lambda x, t: 1e3 * x, 'unit = "N·mm"', ""),
    "gain": (lambda x, t: 2.0 * x, "gain = 2.0", ""),
    "counts": (lambda x, t: 300.0 * x - 50.0, "gain = 300.0, offset = -50.0", ""),
    "offset": (lambda x, t: x + 0.3, 'offset = "0.3 N·m"', ""),
    "sign": (lambda x, t: -x, "sign = -1", ""),
    "delay": (lambda x, t: np.interp(t - 6e-3, t, x), 'delay = "6 ms"', ""),
}
ROTOR = {
    "motor_position": (lambda x, t: RATIO * x, 'side = "rotor"', ""),
    "motor_torque": (lambda x, t: x / RATIO, 'side = "rotor"', ""),
}


def changes(roles):
    """Every role with every way to record it."""
    for role in roles:
        ways = TORQUES if "torque" in role else POSITIONS
        if role == "motor_torque":
            ways = {name: TORQUES[name] for name in ("unit", "sign")}  # its drive's gain is the motor's
        yield from ((role, name, way) for name, way in ways.items())
        if role in ROTOR:
            yield role, "rotor", ROTOR[role]


def recorded(folder, time, said, rig, role="", change=None, name="log"):
    """Write a log with one role changed, and return it bound with the rig that says so, and the rig's joint."""
    said, units = dict(said), {}
    if change is not None:
        remade, keys, unit = change
        said[role], units[role] = remade(said[role], time), unit
        channel = f'{role} = "{role.replace("_", " ")}"'
        assert channel in rig
        stated = ", ".join(filter(None, [f'channel = "{role.replace("_", " ")}"', keys]))
        rig = rig.replace(channel, f"{role} = {{ {stated} }}")
    usual = {r: "N·m" if "torque" in r else "rad" for r in said}
    # A rig that states how a role is recorded goes with a log that does not.
    usual |= units
    header = ",".join(
        ["time [s]", *(f"{r.replace('_', ' ')} [{u}]" if u else r.replace("_", " ") for r, u in usual.items())]
    )
    path = folder / f"{name}.csv"
    np.savetxt(
        path, np.column_stack([time, *said.values()]), "%.12g", ",", header=header, comments="", encoding="utf-8"
    )
    (folder / f"{name}.rig.toml").write_text(rig, encoding="utf-8")
    (joint_name, joint), *_ = Rig.from_toml(rig).joints.items()
    return bound_as_recorded(read(path), joint_name, joint), joint
