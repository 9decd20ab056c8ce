"""Scenarios that fit any rig: torques sized to its transmissions, links and motors. All shares are chosen.

A motor's torque stays within two bounds. It deflects the transmission to a share of its range and no further; and it does
not swing the link round: where gravity holds the link, all motors together stay below the torque that lifts it to the
horizontal, and where nothing does, below what gives it a moderate acceleration and speed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import asin, pi, sqrt

import numpy as np
from msgspec.structs import replace

from vsalog.core.errors import SimulationError, did_you_mean
from vsalog.mechanics import flexibility_torque, stiffness
from vsalog.mechanics.links import link_inertia, link_weight
from vsalog.rig.schema import (
    AntagonisticJoint,
    CubicTransmission,
    ElasticJoint,
    ExponentialTransmission,
    Joint,
    Lever,
    Motor,
    PneumaticJoint,
    PolynomialTransmission,
    RigFile,
    RigidJoint,
    SerialJoint,
    Transmission,
    UnknownTransmission,
    Vsa2Transmission,
)
from vsalog.simulation.inputs import loop_gains
from vsalog.simulation.machine import drive_of
from vsalog.simulation.scenario_schema import (
    Chirp,
    Constant,
    Drives,
    Multisine,
    Parts,
    Sawtooth,
    ScenarioFile,
    ServoDrive,
    Sine,
    Square,
    Steps,
)

GENERIC = {
    "sines": "any rig: a slow and a faster sine on each motor",
    "multisine": "any rig: many sines at once, with low peaks",
    "chirp": "any rig: a sine that becomes faster",
    "steps": "any rig: levels that are held for a while",
    "sawtooth": "any rig: ramps that fall back at once",
    "square": "any rig: two levels in turn, sharp edges",
    "servo": "any rig: position loops on the motors follow slow sines",
}


@dataclass(frozen=True, slots=True)
class Excitation:
    """How far and how fast a rig without a scenario of its own is moved; a scenario's file can state otherwise.

    Attributes
    ----------
    singularity : part of the way to a VSA-II's singularity, which encoders' noise is far from
    gravity : part of the torque that holds a link horizontal: it swings without turning over
    deflection : of springs without a scale of their own [rad]
    acceleration, speed : of links that nothing holds [rad/s²], [rad/s]
    resonance : highest frequency, over that of the link on its springs
    frequency : highest one where there are no springs [Hz]
    servo, secondary : natural frequencies of closed loops [rad/s]
    swing, swinging : of position loops: amplitude [rad] and frequency [Hz]
    lever, levering : of lever arms: part of the way to one of no length, and frequency [Hz]
    valve : part of a valve's range of voltages
    """

    singularity: float = 0.55
    gravity: float = 0.7
    deflection: float = 0.15
    acceleration: float = 10.0
    speed: float = 3.0
    resonance: float = 0.35
    frequency: float = 3.0
    servo: float = 25.0
    secondary: float = 2.0 * pi
    swing: float = 0.4
    swinging: float = 0.1
    lever: float = 0.4
    levering: float = 0.05
    valve: float = 0.4


EXCITATION = Excitation()


@dataclass(frozen=True, slots=True)
class _Drive:
    """One motor of a joint, and the limits of its input.

    Attributes
    ----------
    key : of `Drives`
    place : counts all drives of the rig, so that each gets frequencies of its own
    level : largest torque [N·m], or voltage about `centre` [V]
    top : highest frequency [Hz]
    centre : offset, the voltage of a valve that neither fills nor empties
    """

    key: str
    place: int
    level: float
    top: float
    centre: float = 0.0

    @property
    def spread(self) -> float:
        """By how much this drive is faster than the first."""
        return 1.0 + 0.37 * (self.place % 8)


def generic(kind: str, rig: RigFile, period: float = 1e-3) -> ScenarioFile:
    """Return a scenario of a kind, sized to a rig.

    Parameters
    ----------
    kind : one of `GENERIC`
    rig : the machine
    period : sample time, which bounds the gains of servos [s]

    Raises
    ------
    SimulationError
        There is no such kind, or a transmission's values allow no torque.
    """
    if kind not in GENERIC:
        raise SimulationError(f"there is no scenario '{kind}'{did_you_mean(kind, GENERIC) or '.'}")
    joints: dict[str, Drives] = {}
    place = 0
    for name, joint in rig.joint.items():
        if isinstance(joint, RigidJoint) and joint.drive is None:
            continue
        drives: dict[str, Parts | ServoDrive] = {}
        if isinstance(joint, SerialJoint) and joint.secondary_motor is not None and joint.lever is not None:
            drives["secondary_servo"] = _lever_servo(joint.secondary_motor, joint.lever)
        if kind == "servo" and not isinstance(joint, PneumaticJoint) and drive_of(joint) is None:
            drives.update(servos(name, joint, rig, place, period))
        else:
            drives.update(
                {d.key: _with_centre(d, _PARTS.get(kind, _sines)(d)) for d in _driven(name, joint, rig, place)}
            )
        place += len(drives)
        joints[name] = Drives(**drives)  # type: ignore[arg-type]
    return ScenarioFile(name=kind, description=GENERIC[kind], period=period, joint=joints)


def _sines(d: _Drive) -> Parts:
    slow, fast = 0.1 * d.spread, min(1.0, d.top) / sqrt(d.spread)
    return (Sine(amplitude=0.6 * d.level, frequency=slow), Sine(amplitude=0.4 * d.level, frequency=fast))


def _multisine(d: _Drive) -> Parts:
    # A third of the level: the peaks of random phases reach three times the rms.
    top = max(d.top, 0.5)
    return (Multisine(rms=abs(d.level) / 3.0, spacing=0.1, highest_frequency=top, phases="random", seed=d.place),)


def _chirp(d: _Drive) -> Parts:
    phase = 0.5 * pi * (d.place % 4)
    return (Chirp(amplitude=0.6 * d.level, start_frequency=0.1 * d.spread, end_frequency=d.top, phase=phase),)


def _steps(d: _Drive) -> Parts:
    pattern = np.array([0.5, -0.5, 0.25, 0.5, -0.25, -0.5, 0.0])
    times = 0.5 + 2.7 * np.arange(7) + 0.9 * (d.place % 3)
    values = d.level * np.roll(pattern, d.place)
    return (Steps(times=tuple(times.tolist()), values=tuple(values.tolist()), rise=0.3 / d.top),)


def _sawtooth(d: _Drive) -> Parts:
    return (Sawtooth(amplitude=0.3 * d.level, frequency=0.2 * d.spread),)


def _square(d: _Drive) -> Parts:
    return (Square(amplitude=0.3 * d.level, frequency=0.15 * d.spread),)


_PARTS: dict[str, Callable[[_Drive], Parts]] = {
    "sines": _sines,
    "multisine": _multisine,
    "chirp": _chirp,
    "steps": _steps,
    "sawtooth": _sawtooth,
    "square": _square,
}


def _with_centre(d: _Drive, parts: Parts) -> Parts:
    return (Constant(value=d.centre), *parts) if d.centre else parts


def _driven(name: str, joint: Joint, rig: RigFile, place: int) -> Iterator[_Drive]:
    if isinstance(joint, PneumaticJoint):
        for i, (key, valve) in enumerate((("valve_1", joint.valve_1), ("valve_2", joint.valve_2))):
            centre = float(np.interp(0.5, valve.opening, valve.voltage))
            level = EXCITATION.valve * (valve.voltage[-1] - valve.voltage[0])
            # The muscles take turns: air fills one and leaves the other.
            yield _Drive(key, place + i, -level if i else level, 1.0, centre)
        return
    if drive_of(joint) is not None:
        yield _Drive("commanded_position", place, EXCITATION.swing, EXCITATION.frequency)
        return
    motors = _motors(joint)
    for i, (suffix, motor, transmission) in enumerate(motors):
        level = min(_spring_torque(transmission, joint), _load_torque(name, joint, rig, motor) / len(motors))
        if not (np.isfinite(level) and level > 0.0):
            raise SimulationError(
                f"joint '{name}': no torque can be derived from its link and its transmission; give a scenario file"
            )
        yield _Drive(f"motor_torque{suffix}", place + i, level, _top_frequency(name, joint, rig))


def _motors(joint: Joint) -> list[tuple[str, Motor, Transmission]]:
    """Return suffix, motor as the joint feels it, and transmission of each motor."""
    match joint:
        case AntagonisticJoint():
            pairs = [("_1", joint.motor_1, joint.transmission_1), ("_2", joint.motor_2, joint.transmission_2)]
            return [(suffix, motor.reflected, spring) for suffix, motor, spring in pairs]
        case ElasticJoint() | SerialJoint():
            return [("", joint.motor.reflected, joint.transmission)]
        case RigidJoint() | PneumaticJoint():
            return []


def _deflection(transmission: Transmission) -> float:
    """Return how far a transmission is deflected at most [rad]."""
    match transmission:
        case Vsa2Transmission(geometry=c):
            return EXCITATION.singularity * 2.0 * asin(1.0 / c)
        case CubicTransmission(stiffness=k1, cubic=k3) if k3 > 0.0:
            return min(EXCITATION.deflection, sqrt(k1 / (3.0 * k3)))  # where the stiffness has doubled
        case ExponentialTransmission(scale=s) | PolynomialTransmission(scale=s):
            return s
        case _:
            return EXCITATION.deflection


def _spring_torque(transmission: Transmission, joint: Joint) -> float:
    """Return the torque at that deflection [N·m]; no bound where the spring is not known."""
    if isinstance(transmission, UnknownTransmission):
        return float("inf")
    arm = joint.lever.start if isinstance(joint, SerialJoint) and joint.lever is not None else None
    # The torque of the nominal spring: a gap would hide it, and an asymmetry belongs to one side.
    return abs(float(flexibility_torque(transmission, _deflection(transmission) + 0.5 * transmission.backlash, arm)))


def _load_torque(name: str, joint: Joint, rig: RigFile, motor: Motor) -> float:
    """Return the torque that all motors of a joint may make together [N·m]."""
    inertia, damping, gravity = _load(name, joint, rig)
    free = ((motor.inertia or 0.0) + inertia) * EXCITATION.acceleration + (motor.damping + damping) * EXCITATION.speed
    return EXCITATION.gravity * gravity if gravity > 0.1 * free else free


def _load(name: str, joint: Joint, rig: RigFile) -> tuple[float, float, float]:
    """Return the inertia [kg·m²], damping and gravity torque [N·m] that a joint moves, a stretched arm's where there is one."""
    link = None if isinstance(joint, PneumaticJoint) else joint.link
    damping = link.damping if link is not None else 0.0
    names = [part.joint for part in rig.chain.link] if rig.chain is not None else []
    if rig.chain is None or name not in names:
        if link is None:
            return 0.0, damping, 0.0
        return link_inertia(link), damping, abs(link_weight(link))
    reach = inertia = moment = 0.0
    for part in rig.chain.link[names.index(name) :]:
        centre = reach + abs(part.length + part.centre[0])
        inertia += part.mass * centre**2 + max(part.inertia)
        moment += part.mass * centre
        held = rig.joint[part.joint]
        if not isinstance(held, PneumaticJoint) and held.link is not None and held.link.payload is not None:
            load = held.link.payload
            inertia += load.mass * (reach + load.distance) ** 2
            moment += load.mass * (reach + load.distance)
        reach += sqrt(part.length**2 + part.offset**2)
    return inertia, damping, moment * float(np.linalg.norm(rig.chain.gravity))


def _top_frequency(name: str, joint: Joint, rig: RigFile) -> float:
    """Return a frequency well below that of the link on its springs [Hz]."""
    inertia, _, _ = _load(name, joint, rig)
    springs = [t for _, _, t in _motors(joint) if not isinstance(t, UnknownTransmission)]
    if not springs or inertia <= 0.0:
        return EXCITATION.frequency
    arm = joint.lever.start if isinstance(joint, SerialJoint) and joint.lever is not None else None
    at = [float(stiffness(t, 0.5 * t.backlash + 1e-3 * _deflection(t), arm)) for t in springs]
    return max(min(EXCITATION.frequency, EXCITATION.resonance * sqrt(max(sum(at), 0.0) / inertia) / (2.0 * pi)), 0.2)


def servos(name: str, joint: Joint, rig: RigFile, place: int, period: float) -> Iterator[tuple[str, ServoDrive]]:
    """Yield a position loop for each motor of a joint, sized to the rig.

    Parameters
    ----------
    name, joint, rig : of the machine
    place : counts all drives of the rig, so that each gets a frequency of its own
    period : sample time, which bounds the gains [s]
    """
    inertia, _, gravity = _load(name, joint, rig)
    motors = _motors(joint)
    if isinstance(joint, RigidJoint):
        # Motor and link are one body, which no spring bounds.
        motor = joint.motor.reflected
        motors = [("", replace(motor, inertia=(motor.inertia or 0.0) + inertia), UnknownTransmission())]
        inertia = 0.0
    frequency = EXCITATION.swinging * (1.0 + 0.37 * (place % 8))
    # Gravity's torque at the end of a swing goes through the springs, in addition to that of the swing itself.
    borne = 0.5 * sum(_spring_torque(transmission, joint) for _, _, transmission in motors)
    reach = asin(min(1.0, borne / gravity)) if gravity > 0.0 else EXCITATION.swing
    swing = Sine(amplitude=min(EXCITATION.swing, reach), frequency=frequency)
    for i, (suffix, motor, transmission) in enumerate(motors):
        reference: Parts = (swing,)
        if len(motors) > 1:
            # The motors of a pair also draw apart and together again, which stiffens the joint in between.
            apart = 0.25 * _deflection(transmission) * (-1.0 if i else 1.0)
            reference = (swing, Sine(amplitude=apart, frequency=0.5 * frequency, phase=-0.5 * pi, offset=apart))
        least = 10.0 * gravity / len(motors)  # so that gravity pulls it off by no more than a tenth of a radian
        yield f"motor_servo{suffix}", _servo(motor, inertia, EXCITATION.servo, least, period, reference)


def _servo(motor: Motor, load: float, rate: float, least: float, period: float, reference: Parts) -> ServoDrive:
    """Return a critically damped loop of that natural frequency [rad/s], or stiffer where `least` [N·m/rad] asks for it."""
    stiffness, damping = loop_gains(motor, load, rate, least, period)
    return ServoDrive(stiffness=stiffness, damping=damping, reference=reference)


def _lever_servo(motor: Motor, lever: Lever) -> ServoDrive:
    """Return a loop that draws the lever in and lets it out again."""
    half = 0.5 * EXCITATION.lever * lever.start / lever.travel if lever.travel else 0.0
    slow = Sine(amplitude=half, frequency=EXCITATION.levering, phase=-0.5 * pi, offset=half)
    return _servo(motor.reflected, 0.0, EXCITATION.secondary, 0.0, 1e-3, (slow,))
