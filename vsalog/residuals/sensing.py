"""Sensors and drives of the rig, undone: filtered channels become the joint's true motion, as the rig has it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from vsalog.binding.joint import offered_roles
from vsalog.binding.sensor_model import seen_by
from vsalog.core.signals import JointSignals
from vsalog.effects.calibration import reading, zeroed
from vsalog.effects.delay import late, shifted
from vsalog.effects.drive import delivered
from vsalog.effects.reading_error import ReadingError, errors_of, measured
from vsalog.residuals.channels import Channels
from vsalog.residuals.drive_torque import drive_torque
from vsalog.residuals.memory import remembered
from vsalog.rig.roles import COMMANDS
from vsalog.rig.schema import AntagonisticJoint, Joint, Motor, PneumaticJoint, RigidJoint, SerialJoint, Signal

Array = NDArray[np.float64]

# Voltages that are commanded, and held from one sample to the next as motors' torques are.
VALVES = ("valve_1", "valve_2")
EARLIEST = 0.25
"""Part of a sample by which a channel may be early before a whole sample is counted.

So a channel on time, and one half a sample late, such as a held torque, are both far from where the count changes.
"""
# Roles of no cause, which are recorded as another quantity than the joint has: a lever arm as an angle.
BOUND = ("setpoint",)


def bare(joint: Any, gains: bool = False) -> Any:
    """Return the joint as if its sensors and drives were perfect, so that its channels are bound as they were recorded.

    The rig's sensors of roles in `BOUND` are undone by binding.

    Parameters
    ----------
    joint : of the rig
    gains : keep the sensors' gains, so that channels are bound in the joint's units; see `at_joint`
    """
    signals = {}
    for role, signal in offered_roles(joint).items():
        if getattr(joint.signals, role, None) is None:
            continue  # a set-point that its runs give
        if role in BOUND:
            signals[role] = signal
            continue
        signals[role] = replace(
            signal, offset=0.0, gain=signal.gain if gains else 1.0, drift=0.0, delay=0.0, series_stiffness=None,
            **signal.no_errors(),
        )  # fmt: skip
    changed = {"signals": type(joint.signals)(**signals)}
    for name in motors_of(joint):
        motor: Motor = getattr(joint, name)
        changed[name] = replace(motor, torque_gain=1.0, torque_offset=0.0, torque_delay=0.0)
    return replace(joint, **changed)


def at_joint(joint: Any) -> Any:
    """Return the joint with all that its motors have as the joint feels it, and all readings of its sensors in the joint's units.

    So parameters are those of the equations: an offset is an angle or a torque whatever a sensor counts in, and a gain is
    relative to the rig's.
    """
    changed = {name: getattr(joint, name).reflected for name in motors_of(joint)}
    scaled = {role: _per_gain(s) for role, s in offered_roles(joint).items() if role not in BOUND and s.gain != 1.0}
    if scaled:
        changed["signals"] = replace(joint.signals, **scaled)
    return replace(joint, **changed)


def sensors_as_written(joint: Any, original: Any) -> Any:
    """Return a joint's signals in the units of another one's sensors; unchanged signals stay as they are."""
    plain, own, changed = offered_roles(at_joint(original)), offered_roles(joint), dict[str, Any]()
    for role, first in offered_roles(original).items():
        new, old = own[role], plain[role]
        if role in BOUND or getattr(original.signals, role, None) is None:
            continue
        differs = {f: getattr(new, f) for f in new.__struct_fields__ if getattr(new, f) != getattr(old, f)}
        if differs:
            counted = _times_gain(new, first.gain)
            changed[role] = replace(first, **{f: getattr(counted, f) for f in differs})
    return replace(original.signals, **changed)


def _per_gain(signal: Signal) -> Signal:
    """Return a sensor as it is when its readings are divided by its gain."""
    return replace(_times_gain(signal, 1.0 / signal.gain), gain=1.0)


def _times_gain(signal: Signal, gain: float) -> Signal:
    return replace(
        signal,
        gain=signal.gain * gain,
        offset=signal.offset * gain,
        drift=signal.drift * gain,
        resolution=None if signal.resolution is None else signal.resolution * gain,
        noise=signal.noise * gain,
        **signal.scaled_errors(gain),
    )


def as_written(motor: Motor, original: Motor) -> Motor:
    """Return a motor with its values on the side of the gear where another one has them; unchanged values stay as they are."""
    if original.side == "joint":
        return motor
    ratio, plain = original.gear_ratio, original.reflected
    rotor = replace(
        motor,
        side="rotor",
        inertia=None if motor.inertia is None else motor.inertia / ratio**2,
        damping=motor.damping / ratio**2,
        friction=motor.friction.geared(1.0 / ratio),
        **motor.geared_torques(1.0 / ratio),
        torque_offset=motor.torque_offset / ratio,
        torque_step=motor.torque_step / ratio,
    )
    same = [name for name in rotor.__struct_fields__ if getattr(motor, name) == getattr(plain, name)]
    return replace(rotor, **{name: getattr(original, name) for name in same if name != "side"})


def motors_of(joint: Joint) -> tuple[str, ...]:
    """Return the names under which a joint has motors."""
    if isinstance(joint, PneumaticJoint):
        return ()
    if isinstance(joint, AntagonisticJoint):
        return ("motor_1", "motor_2")
    if isinstance(joint, SerialJoint) and joint.secondary_motor is not None:
        return ("motor", "secondary_motor")
    return ("motor",)


def torque_role(motor: str) -> str:
    """Return the role in which the torque of a motor is recorded."""
    if motor == "secondary_motor":
        return "secondary_torque"
    return motor.replace("motor", "motor_torque")


def position_role(motor: str) -> str:
    """Return the role in which the position of a motor is recorded."""
    return "setpoint" if motor == "secondary_motor" else motor.replace("motor", "motor_position")


def each_sensor(joint: Joint, signals: JointSignals) -> dict[str, Array]:
    """Return role → shape (N,), samples with each sensor of the rig undone, but for its delay.

    Parameters
    ----------
    joint : of the rig
    signals : as recorded
    """
    offered = offered_roles(joint)
    out = {role: np.asarray(values) for role, values in signals.roles.items()}
    for role in out:
        if role in offered and role not in BOUND:
            signal = offered[role]
            out[role] = seen_by(out[role], signal, signals.time if signal.drift else None)[0]
    return out


def true_roles(joint: Joint, channels: Channels, hold: float = 0.0) -> dict[str, Array]:
    """Undo the rig's sensors and drives.

    Parameters
    ----------
    joint : of the rig
    channels : as recorded
    hold : how long after its stamp a recorded motor torque or valve's voltage acts on average, in addition to the rig's delay [s]

    Returns
    -------
    role → value, first and second derivative, shape (3, N), SI; motor torques are those that act
    """
    offered = offered_roles(joint)
    true = {
        role: values
        if role in BOUND
        else remembered(_true, values, offered.get(role, Signal()), channels.time, channels.period)
        for role, values in channels.roles.items()
    }
    hold *= channels.held[0] if len(channels.held) == 1 else 1.0
    drive = getattr(joint, "drive", None)
    if drive is not None and is_commanded(joint, channels.raw):
        position = true.get("motor_position", true.get("link_position") if isinstance(joint, RigidJoint) else None)
        if position is not None:
            true["motor_torque"] = drive_torque(drive, channels, position)
            hold = 0.0
    for name in motors_of(joint):
        role = torque_role(name)
        if role in true:
            motor: Motor = getattr(joint, name).reflected
            late = (motor.torque_delay + hold) / channels.period
            true[role] = remembered(_acting, true[role], late, motor.torque_gain, motor.torque_offset)
    for role, values in list(true.items()):
        if role in VALVES and hold:
            true[role] = remembered(shifted, values, -hold / channels.period)
        series = offered.get(role, Signal()).series_stiffness
        sensor = role.replace("deflection", "torque_sensor")
        if series is not None and sensor in true:
            true[role] = remembered(_without_series, values, true[sensor], series)
    return true


def is_commanded(joint: Any, roles: Collection[str]) -> bool:
    """Return whether a joint is moved by its drive's command, with no recorded torque taken as that of its motor.

    Parameters
    ----------
    joint : of the rig
    roles : that are recorded, or follow from them
    """
    return getattr(joint, "drive", None) is not None and any(role in roles for role in COMMANDS)


def whole_delays(joint: Joint, period: float) -> dict[str, int]:
    """Return role or motor → whole samples of its delay, where there are any; the rest is −¼ to ¾ of a sample."""
    delays = {role: signal.delay for role, signal in offered_roles(joint).items() if role not in BOUND}
    delays |= {name: getattr(joint, name).torque_delay for name in motors_of(joint)}
    return {name: whole for name, d in delays.items() if (whole := int(np.floor(d / period + EARLIEST)))}


def earlier(joint: Any, samples: Mapping[str, float], period: float) -> Any:
    """Return a joint with samples subtracted from the delays of its sensors and drives; see `whole_delays`."""
    if not samples:
        return joint
    motors, signals = motors_of(joint), {}
    changed = {}
    for name, count in samples.items():
        if name in motors:
            motor: Motor = getattr(joint, name)
            changed[name] = replace(motor, torque_delay=motor.torque_delay - count * period)
        else:
            signal = offered_roles(joint)[name]
            signals[name] = replace(signal, delay=signal.delay - count * period)
    if signals:
        changed["signals"] = replace(joint.signals, **signals)
    return replace(joint, **changed)


def read_earlier(joint: Any, samples: float, period: float) -> Any:
    """Shift all channels of a joint by a number of samples: sensors are read earlier, drives act later."""
    motors = motors_of(joint)
    sensors = set(offered_roles(joint)) - {torque_role(name) for name in motors} - set(BOUND)
    return earlier(joint, dict.fromkeys(sensors, samples) | dict.fromkeys(motors, -samples), period)


def _without_series(deflection: Array, torque: Array, stiffness: float) -> Array:
    """Subtract from a deflection that of a spring in series under a torque."""
    return deflection - torque / stiffness


def _true(m: Array, signal: Signal, time: Array, period: float) -> Array:
    """Undo m(t) = gain · x(t − delay) + offset + drift · t + errors(x(t − delay))."""
    gain = signal.gain
    if signal.offset or signal.drift:
        m = np.stack([zeroed(m[0], time, signal.offset, signal.drift), m[1] - signal.drift, m[2]])
    if any(e.largest[0] for e in signal.errors):
        m = _measured(m, gain, signal.errors)
    elif gain != 1.0:
        m = m / gain
    return shifted(m, signal.delay / period) if signal.delay else m


def _acting(commanded: Array, late: float, gain: float, offset: float) -> Array:
    """Return the torque that acts, delayed by a number of samples after its command, with its derivatives."""
    made = delivered(shifted(commanded, -late), gain, 0.0)
    return np.stack([delivered(made[0], 1.0, offset), made[1], made[2]]) if offset else made


def _measured(m: Array, gain: float, errors: tuple[ReadingError, ...]) -> Array:
    # They are small against what is measured: six rounds remove them.
    x = measured(errors, m[0], gain, 6, 0.0)
    slope = gain + sum(e.slope(x) for e in errors)
    rate = m[1] / slope
    return np.stack([x, rate, (m[2] - sum(e.curvature(x) for e in errors) * rate**2) / slope])


def sensor_reading(joint: Any, role: str, truth: Mapping[str, Array], time: Array) -> Array:
    """Return the reading of a sensor: gain · x(t − delay) + offset + drift · t + errors(x(t − delay)).

    Parameters
    ----------
    joint : of the rig
    role : of the sensor
    truth : of a simulation, name → shape (N,)
    time : shape (N,) [s]
    """
    signal = offered_roles(joint).get(role, Signal())
    suffix = role[-2:] if role.endswith(("_1", "_2")) else ""
    if role.startswith("torque_sensor"):
        name = "transmission_torque"
        x = truth.get(f"{name}{suffix}", truth.get(f"{name}_total"))
    elif role == "setpoint":
        x = truth["lever_arm"]
    else:
        x = truth[role]
    assert x is not None
    if role in BOUND:
        return np.asarray(x)
    if role.startswith("deflection") and signal.series_stiffness is not None:
        x = x + truth[f"transmission_torque{suffix}"] / signal.series_stiffness
    if signal.delay:
        x = late(x, time, signal.delay)
    read = reading(x, time, signal.gain, signal.offset, signal.drift)
    return read + errors_of(signal.errors, x) if signal.errors else read


def known(roles: Mapping[str, Array], *names: str) -> bool:
    """Return whether all of these roles are there."""
    return all(name in roles for name in names)
