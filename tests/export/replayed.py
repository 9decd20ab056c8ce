"""A log's motor torques, played again by MuJoCo in the model that vsalog exports."""

import mujoco
import numpy as np

from vsalog.binding.joint import offered_roles
from vsalog.export.run import export
from vsalog.simulation.run import Options, prepare


def recorded(rig, **options):
    """Simulate a rig without noise, as `vsalog simulate --ideal` does; return the rig, times, and channel → samples."""
    job = prepare(rig, Options(ideal=True, **options))
    recording = job.run()
    stamps = next(iter(recording.channels.values())).stamps
    channels = {name: np.asarray(c.values) for name, c in recording.channels.items()}
    return job.rig, (stamps - stamps[0]) * 1e-9, channels


def logged(rig, channels):
    """Return the positions and the controls of a log by the names they have in the model."""
    positions, controls = {}, {}
    for name, joint in rig.joints.items():
        for role, signal in offered_roles(joint).items():
            if signal.channel in channels:
                if role.startswith("motor_torque"):
                    controls[f"{name}_{role.replace('motor_torque', 'motor')}"] = channels[signal.channel]
                elif "_position" in role:
                    positions[f"{name}_{role.replace('_position', '')}"] = channels[signal.channel]
    return positions, controls


def moved(text, time, start, controls):
    """Return joint → position in MuJoCo, shape (N,); controls are straight between samples."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    for name, position in start.items():
        data.joint(name).qpos[0] = position
    steps = round((time[1] - time[0]) / model.opt.timestep)
    found = {name: np.empty(time.size) for name in start}
    for k in range(time.size):
        for name, values in found.items():
            values[k] = data.joint(name).qpos[0]
        for j in range(steps if k + 1 < time.size else 0):
            part = (j + 0.5) / steps
            for name, values in controls.items():
                data.actuator(name).ctrl[0] = (1.0 - part) * values[k] + part * values[k + 1]
            mujoco.mj_step(model, data)
    return found


def replay(model_rig, rig, time, channels, leave_out=False):
    """Return position's name → as logged and as MuJoCo moves it, shape (N,); `model_rig` is exported, `rig` was recorded."""
    positions, controls = logged(rig, channels)
    text = export(model_rig, "mjcf", leave_out=leave_out).text
    found = moved(text, time, {name: values[0] for name, values in positions.items()}, controls)
    return {name: (values, found[name]) for name, values in positions.items()}


def off(pair):
    """Return the largest difference as a part of the span."""
    return float(np.max(np.abs(pair[1] - pair[0])) / np.ptp(pair[0]))
