"""A log's motor torques, played again by MuJoCo in the model that vsalog exports."""

import numpy as np

from vsalog.binding.joint import offered_roles
from vsalog.export.run import export
from vsalog.rig import Rig
from vsalog.simulation.run import Options, prepare


def recorded(rig, **options):
    """Simulate a rig without noise; return the rig, times, and channel → samples."""
    job = prepare(rig, Options(ideal=True, **options))
    recording = job.run()
    channels = {name: np.asarray(c.values) for name, c in recording.channels.items()}
    stamps = next(iter(recording.channels.values())).stamps
    return job.rig, (stamps - stamps[0]) * 1e-9, channels


def replay(rig, time, channels, leave_out=False):
    """Return position's name → as logged and as MuJoCo moves it, shape (N,)."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(export(rig, "mjcf", leave_out=leave_out).text)
    data = mujoco.MjData(model)
    logged, controls = {}, {}
    for name, joint in rig.joints.items():
        for role, signal in offered_roles(joint).items():
            if signal.channel not in channels:
                continue
            values = channels[signal.channel]
            if role.startswith("motor_torque"):
                controls[f"{name}_{role.replace('motor_torque', 'motor')}"] = values
            elif role.endswith(("position", "position_1", "position_2")):
                logged[f"{name}_{role.replace('_position', '')}"] = values
    for name, values in logged.items():
        data.joint(name).qpos[0] = values[0]
    period = time[1] - time[0]
    steps = round(period / model.opt.timestep)
    assert steps * model.opt.timestep == period or abs(steps * model.opt.timestep - period) < 1e-12
    moved = {name: np.empty(time.size) for name in logged}
    for k in range(time.size):
        for name in logged:
            moved[name][k] = data.joint(name).qpos[0]
        for j in range(steps if k + 1 < time.size else 0):
            part = (j + 0.5) / steps
            for name, values in controls.items():
                data.actuator(name).ctrl[0] = (1.0 - part) * values[k] + part * values[k + 1]
            mujoco.mj_step(model, data)
    return {name: (values, moved[name]) for name, values in logged.items()}


def off(rig, leave_out=False, **options):
    """Return position's name → largest error as a part of its span."""
    pairs = replay(*recorded(rig, **options), leave_out=leave_out)
    return {name: float(np.max(np.abs(a - b)) / np.ptp(a)) for name, (a, b) in pairs.items()}


def rig_of(text):
    """Load a rig from TOML."""
    return Rig.from_toml(text)
