"""The readings of sensors, as the rig's signals describe them: `Signal` lists the effects."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from vsalog.core.errors import SimulationError
from vsalog.effects.calibration import reading
from vsalog.effects.quantisation import rounded
from vsalog.effects.reading_error import errors_of
from vsalog.mechanics.kinematics import LinkMotion, chain_motion, specific_force
from vsalog.rig.roles import COMMANDS
from vsalog.rig.schema import Chain, Joint, RigFile, Signal
from vsalog.simulation.channels import is_lever_arm, named_signals
from vsalog.simulation.experiment import JointRecord

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Truth = Mapping[str, Mapping[str, Array]]

# Roles whose truth goes by another name: the first one there is. A torque sensor feels all that a transmission transmits,
# in an antagonistic joint the sum of both.
SENSED = {
    "torque_sensor": ("transmission_torque_total", "transmission_torque"),
    "torque_sensor_1": ("transmission_torque_1",),
    "torque_sensor_2": ("transmission_torque_2",),
    "setpoint": ("secondary_position",),
}
ACCELEROMETER = {"accelerometer_x": 0, "accelerometer_y": 1, "accelerometer_z": 2}

# Roles that may be held from sample to sample: a cubic would overshoot where they jump.
HELD = (*COMMANDS, "motor_torque", "secondary_torque", "external_torque", "valve")


@dataclass(frozen=True, slots=True)
class _Topic:
    """The stamps of a topic: how far they are off [s], and which samples there are; None for right and all."""

    late: Array | None
    kept: Flags | None


def sense(joints: Truth, rig: RigFile, time: Array, seed: int, ideal: bool) -> dict[str, JointRecord]:
    """Return the readings of each joint's sensors: the roles that the rig names a channel for and that there is a truth of.

    With x the truth, m(t) = gain · x(t − delay) + offset + drift · t + errors(x(t − delay)) + noise, rounded to the
    resolution. A recorded deflection without a resolution of its own is the difference of what the two encoders count.
    Each role has its own stream of random numbers, and each topic too.

    Parameters
    ----------
    joints : joint → name → shape (N,), the truth, see `JointRecord`
    rig : with the signals of its joints
    time : shape (N,), seconds from the start
    seed : of all random numbers
    ideal : without noise, steps, jitter and dropped samples; systematic errors stay

    Raises
    ------
    SimulationError
        An accelerometer sits on a link that the chain does not describe, or the seed is negative.
    """
    if seed < 0:
        raise SimulationError(f"the seed {seed} is negative; choose 0, 1, 2, …")
    signals = {
        name: {role: s for role, s in named_signals(rig.joint[name]).items() if s.channel is not None}
        for name in joints
    }
    topics = {} if ideal else _topics(signals, time.size, seed)
    records = {}
    sensed = rig.chain is not None and any(role in ACCELEROMETER for own in signals.values() for role in own)
    motion = _chain_motion(joints, rig.chain) if sensed and rig.chain is not None else None
    for name, truth in joints.items():
        accelerations = _accelerations(name, motion, rig.chain, signals[name])
        measured, resolution, late, kept = {}, {}, {}, {}
        for role, signal in signals[name].items():
            x, step = _seen(rig.joint[name], role, signal, {**truth, **accelerations}, time, ideal)
            if x is None:
                continue
            if signal.series_stiffness is not None:
                torque = truth[role.replace("deflection", "transmission_torque")]
                x = x + _delayed(torque, time, signal.delay) / signal.series_stiffness
            measured[role] = _reading(signal, x, time, _generator(seed, "joint", name, role), ideal)
            resolution[role] = step
            topic = topics.get(_topic_of(signal))
            if topic is not None and topic.late is not None:
                late[role] = topic.late
            if topic is not None and topic.kept is not None:
                kept[role] = topic.kept
        records[name] = JointRecord(measured, truth, resolution, late, kept)
    return records


class LiveSensors:
    """Sensors that are read sample by sample, as a controller does; their readings are those of `sense` for the whole.

    Parameters
    ----------
    rig : with the signals of its joints
    wanted : joint → roles that are read
    time, seed, ideal : as of `sense`

    Raises
    ------
    SimulationError
        A signal that is wanted is not recorded, or is late: its reading of a sample would be known later only.
    """

    def __init__(
        self, rig: RigFile, wanted: Mapping[str, Collection[str]], time: Array, seed: int, ideal: bool
    ) -> None:
        self.rig, self.time, self.ideal = rig, time, ideal
        self.signals: dict[str, dict[str, Signal]] = {}
        self.random = {}
        for name, roles in wanted.items():
            named = named_signals(rig.joint[name])
            for role in roles:
                signal = named.get(role)
                if signal is None or signal.channel is None:
                    raise SimulationError(
                        f"joint '{name}': the controller reads {role}, for which the rig names no channel"
                    )
                if signal.delay:
                    raise SimulationError(
                        f"joint '{name}': the controller reads {role}, which is late; set its delay to 0"
                    )
                self.signals.setdefault(name, {})[role] = signal
                self.random[name, role] = _generator(seed, "joint", name, role)

    def read(self, k: int, truth: Truth) -> dict[str, dict[str, float]]:
        """Return joint → role → the sensor's reading of sample `k`, whose truth has shape (1,); call it once for each in turn."""
        time, readings = self.time[k : k + 1], dict[str, dict[str, float]]()
        chain, motion = self.rig.chain, None
        for name in truth.keys() & self.signals.keys():
            signals = self.signals[name]
            if chain is not None and motion is None and any(role in ACCELEROMETER for role in signals):
                motion = _chain_motion(truth, chain)
            own = {**truth[name], **_accelerations(name, motion, chain, signals)}
            readings[name] = {}
            for role, signal in signals.items():
                x, _ = _seen(self.rig.joint[name], role, signal, own, time, self.ideal)
                if x is not None:
                    reading = _reading(signal, x, time, self.random[name, role], self.ideal)
                    readings[name][role] = float(reading[0])
        return readings


def _seen(
    joint: Joint, role: str, signal: Signal, truth: Mapping[str, Array], time: Array, ideal: bool
) -> tuple[Array | None, float]:
    """Return the truth that a role's sensor sees, late as it is, and the sensor's least step; None where there is no truth."""
    step = 0.0 if ideal else signal.resolution or 0.0
    if is_lever_arm(role, signal):
        names: tuple[str, ...] = ("lever_arm",)
    else:
        names = (*SENSED.get(role, ()), role)
    name = next((name for name in names if name in truth), None)
    if name is None:
        return None, step
    if role.startswith("deflection") and not ideal and signal.resolution is None:
        # A controller logs the difference of what its encoders count.
        motor = role.replace("deflection", "motor_position")
        steps = [_resolution(joint, encoder) for encoder in ("link_position", motor)]
        if any(steps):
            q, theta = (_delayed(truth[encoder], time, signal.delay) for encoder in ("link_position", motor))
            return rounded(q, steps[0]) - rounded(theta, steps[1]), steps[0] if steps[0] == steps[1] else 0.0
    return _delayed(truth[name], time, signal.delay, held=role.startswith(HELD)), step


def _resolution(joint: Joint, role: str) -> float:
    signal = named_signals(joint).get(role)
    return 0.0 if signal is None or signal.resolution is None else signal.resolution


def _reading(signal: Signal, x: Array, time: Array, random: np.random.Generator, ideal: bool) -> Array:
    m = reading(x, time, signal.gain, signal.offset, signal.drift)
    if signal.errors:
        m += errors_of(signal.errors, x)
    if ideal:
        return np.asarray(m)
    if signal.noise > 0.0:
        m += signal.noise * random.standard_normal(m.shape)
    return np.asarray(rounded(m, signal.resolution or 0.0))


def _delayed(x: Array, time: Array, delay: float, held: bool = False) -> Array:
    """Return x(t − delay); before the first sample it is the first, after the last the last."""
    if delay == 0.0:
        return x
    then = np.clip(time - delay, time[0], time[-1])
    return np.asarray(np.interp(then, time, x) if held else CubicSpline(time, x)(then))


def _topic_of(signal: Signal) -> str:
    return (signal.channel or "").partition(".")[0]


def _topics(signals: Mapping[str, Mapping[str, Signal]], count: int, seed: int) -> dict[str, _Topic]:
    """Return the stamps of each topic: the jitter and the losses of a message are those of all it holds, the largest stated."""
    stated: dict[str, tuple[float, float]] = {}
    for roles in signals.values():
        for signal in roles.values():
            jitter, dropped = stated.get(_topic_of(signal), (0.0, 0.0))
            stated[_topic_of(signal)] = max(jitter, signal.jitter), max(dropped, signal.dropped)
    topics = {}
    for name, (jitter, dropped) in stated.items():
        if jitter == 0.0 and dropped == 0.0:
            continue
        random = _generator(seed, "topic", name)
        # Both are drawn, so that one does not change the other.
        late, lot = random.standard_normal(count) * jitter, random.random(count)
        topics[name] = _Topic(late if jitter > 0.0 else None, lot >= dropped if dropped > 0.0 else None)
    return topics


def _chain_motion(joints: Truth, chain: Chain) -> list[LinkMotion]:
    """Return how the links of a chain move."""
    q, dq, ddq = (
        np.stack([joints[link.joint][f"link_{what}"] for link in chain.link], axis=-1)
        for what in ("position", "velocity", "acceleration")
    )
    return chain_motion(chain, q, dq, ddq)


def _accelerations(
    name: str, motion: Sequence[LinkMotion] | None, chain: Chain | None, signals: Mapping[str, Signal]
) -> dict[str, Array]:
    """Return what the accelerometer on a joint's link reads, from how the chain's links move."""
    if not any(role in ACCELEROMETER for role in signals):
        return {}
    links = [] if chain is None else list(chain.link)
    place = next((i for i, link in enumerate(links) if link.joint == name), None)
    mounting = None if place is None else links[place].accelerometer
    if chain is None or motion is None or place is None or mounting is None:
        raise SimulationError(
            f"joint '{name}' has an accelerometer, but its place is not stated: give the joint's [[chain.link]] an"
            " accelerometer = { position = […], orientation = […] }, or leave the roles accelerometer_… out"
        )
    reading = specific_force(motion[place], mounting, chain.gravity)
    return {role: np.ascontiguousarray(reading[..., axis]) for role, axis in ACCELEROMETER.items()}


def _generator(seed: int, *names: str) -> np.random.Generator:
    """Return a stream of random numbers of its own, by name."""
    return np.random.default_rng([seed, *"\0".join(names).encode("utf-8", "replace")])
