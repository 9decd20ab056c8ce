"""A rig's joint, played: torques in, what the sensors record and the truth out."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from vsalog.errors import SimulationError
from vsalog.mechanics import flexibility_torque, reaction_torque, stiffness
from vsalog.rig.schema import (
    AntagonisticJoint,
    AwasTransmission,
    CubicTransmission,
    ElasticJoint,
    LinearTransmission,
    Link,
    Motor,
    PneumaticJoint,
    RigFile,
    RigidJoint,
    SerialJoint,
    Transmission,
    UnknownTransmission,
    Vsa2Transmission,
)
from vsalog.simulation._awas import integrate_awas
from vsalog.simulation._parallel import CUBIC, LINEAR, VSA2, integrate_parallel
from vsalog.simulation.channels import named_signals
from vsalog.simulation.experiment import Experiment, JointRecord, sample_stamps
from vsalog.simulation.inputs import TorqueInput, at_samples, at_steps
from vsalog.simulation.sensors import IDEAL, Sensors, sense

Array = NDArray[np.float64]

# Per step, a damped motion may decay by this much (D/B · h) and a vibration turn by this angle [rad]; both keep the
# Runge–Kutta step's error far below 1e-6, the latter with a margin for springs that harden as they deflect.
DAMPING_PER_STEP, ANGLE_PER_STEP = 0.5, 0.05
FEWEST_STEPS, MOST_STEPS = 4, 2000


def simulate(
    rig: RigFile,
    torques: Mapping[str, TorqueInput],
    duration: float,
    *,
    joint: str | None = None,
    period: float = 1e-3,
    steps: int | None = None,
    seed: int = 0,
    sensors: Sensors = IDEAL,
    drift_rate: float = 0.0,
    start: Array | None = None,
    name: str = "simulated",
) -> Experiment:
    """Move one joint of a rig and record it.

    Parameters
    ----------
    rig : the machine; motors need an inertia, transmissions a type, and there must be a link
    torques : role → torque on the joint's side of the gear [N·m], a continuous function of an array of times [s] or one
        value per sample (N), held until the next: ``motor_torque`` (elastic, serial), ``motor_torque_1`` and ``_2``
        (antagonistic), ``secondary_torque`` (serial). Missing ones are zero
    duration : [s]; N = duration / period + 1 samples, the first at rest before anything moves
    joint : its name; the rig's first when absent
    period : sample time T [s]
    steps : integration steps per period; as many as the fastest damping and the springs at rest need when absent
    seed : of all noise; equal seeds give equal recordings, bit for bit
    sensors : what they make of the truth; ideal when absent
    drift_rate : every transmission's torque is multiplied with 1 + drift_rate · t [1/s]
    start : initial state, (q, q̇, θ₁, θ̇₁, …) [rad, rad/s]; rest at zero, the lower equilibrium, when absent
    name : of the experiment

    Raises
    ------
    SimulationError
        The rig lacks what a simulation needs, a torque input does not fit, or the motion leaves what the model describes.
    """
    joint_name = next(iter(rig.joint), "") if joint is None else joint
    if joint_name not in rig.joint:
        raise SimulationError(f"rig '{rig.name}' has no joint '{joint_name}' to simulate")
    if not (np.isfinite(duration) and duration > 0.0 and period > 0.0 and (steps is None or steps >= 1)):
        raise SimulationError("a simulation needs a positive duration, period and number of steps")
    count = round(duration / period) + 1
    time = np.arange(count, dtype=np.float64) * period
    plant = rig.joint[joint_name]
    if isinstance(plant, RigidJoint):
        raise SimulationError(f"joint '{joint_name}' is rigid: it has no transmission to simulate")
    if isinstance(plant, PneumaticJoint):
        raise SimulationError(f"joint '{joint_name}' is pneumatic: simulate_pneumatic plays it")
    steps = _steps(plant, period) if steps is None else steps
    if isinstance(plant, SerialJoint):
        truth = _serial(plant, torques, time, period, steps, drift_rate, start)
    else:
        truth = _parallel(plant, torques, time, period, steps, drift_rate, start)
    measured, resolution = sense(truth, sensors, seed, set(named_signals(plant)))
    record = JointRecord(measured, truth, resolution)
    return Experiment(name, rig, period, sample_stamps(count, period), time, {joint_name: record})


def _parallel(
    joint: AntagonisticJoint | ElasticJoint,
    torques: Mapping[str, TorqueInput],
    time: Array,
    period: float,
    steps: int,
    drift_rate: float,
    start: Array | None,
) -> dict[str, Array]:
    if isinstance(joint, AntagonisticJoint):
        suffixes, motors = ["_1", "_2"], [joint.motor_1, joint.motor_2]
        transmissions = [joint.transmission_1, joint.transmission_2]
    else:
        suffixes, motors, transmissions = [""], [joint.motor], [joint.transmission]
    inputs = _inputs(torques, [f"motor_torque{s}" for s in suffixes])
    coded = [_coded(t) for t in transmissions]
    states = integrate_parallel(
        _start(start, 2 + 2 * len(motors)),
        np.stack([at_steps(torque, time, steps) for torque in inputs]),
        period / steps,
        drift_rate,
        np.array([code for code, _, _ in coded], dtype=np.int64),
        np.array([(p0, p1) for _, p0, p1 in coded]),
        np.array([_motor(m) for m in motors]),
        _link(joint.link),
    )
    _require_finite(states, time)
    truth = {"link_position": states[:, 0], "link_velocity": states[:, 1]}
    scale = 1.0 + drift_rate * time
    for i, suffix in enumerate(suffixes):
        phi = states[:, 0] - states[:, 2 + 2 * i]
        truth[f"motor_position{suffix}"] = states[:, 2 + 2 * i]
        truth[f"motor_velocity{suffix}"] = states[:, 3 + 2 * i]
        truth[f"motor_torque{suffix}"] = at_samples(inputs[i], time)
        truth[f"deflection{suffix}"] = phi
        truth[f"flexibility_torque{suffix}"] = scale * flexibility_torque(transmissions[i], phi)
        truth[f"stiffness{suffix}"] = scale * stiffness(transmissions[i], phi)
    if len(motors) > 1:
        for quantity in ("flexibility_torque", "stiffness"):
            truth[f"{quantity}_total"] = truth[f"{quantity}_1"] + truth[f"{quantity}_2"]
    return _contiguous(truth)


def _serial(
    joint: SerialJoint,
    torques: Mapping[str, TorqueInput],
    time: Array,
    period: float,
    steps: int,
    drift_rate: float,
    start: Array | None,
) -> dict[str, Array]:
    if not isinstance(joint.transmission, AwasTransmission) or joint.lever is None:
        raise SimulationError("a serial joint is simulated with an 'awas' transmission and a lever only")
    if joint.secondary_motor is None:
        raise SimulationError("a serial joint without a secondary motor cannot be simulated")
    inputs = _inputs(torques, ["motor_torque", "secondary_torque"])
    spring, lever = joint.transmission.spring_stiffness, joint.lever
    states = integrate_awas(
        _start(start, 6),
        np.stack([at_steps(torque, time, steps) for torque in inputs]),
        period / steps,
        drift_rate,
        np.array([spring, lever.start, lever.travel]),
        np.array(_motor(joint.motor)),
        np.array(_motor(joint.secondary_motor)),
        _link(joint.link),
    )
    _require_finite(states, time)
    phi, arm = states[:, 0] - states[:, 2], lever.start - lever.travel * states[:, 4]
    if bool(np.any(arm <= 0.0)):
        at = time[int(np.argmax(arm <= 0.0))]
        raise SimulationError(f"the lever arm reaches zero at t = {at:.3f} s: the secondary torque is too large")
    scale = 1.0 + drift_rate * time
    return _contiguous(
        {
            "link_position": states[:, 0],
            "link_velocity": states[:, 1],
            "motor_position": states[:, 2],
            "motor_velocity": states[:, 3],
            "motor_torque": at_samples(inputs[0], time),
            "secondary_position": states[:, 4],
            "secondary_velocity": states[:, 5],
            "secondary_torque": at_samples(inputs[1], time),
            "lever_arm": arm,
            "deflection": phi,
            "flexibility_torque": scale * flexibility_torque(joint.transmission, phi, arm),
            "stiffness": scale * stiffness(joint.transmission, phi, arm),
            "reaction_torque": scale * reaction_torque(joint.transmission, phi, arm, lever.travel),
        }
    )


def _steps(joint: AntagonisticJoint | ElasticJoint | SerialJoint, period: float) -> int:
    """Return enough integration steps per period for a rig's fastest mode, the AwAS' secondary motor aside."""
    if isinstance(joint, AntagonisticJoint):
        motors, transmissions = [joint.motor_1, joint.motor_2], [joint.transmission_1, joint.transmission_2]
    else:
        motors, transmissions = [joint.motor], [joint.transmission]
    arm = joint.lever.start if isinstance(joint, SerialJoint) and joint.lever else None
    mass, friction, _ = _link(joint.link)
    springs = [float(stiffness(t, 0.0, arm)) for t in transmissions if not isinstance(t, UnknownTransmission)]
    rates = [friction / mass] + [damping / inertia for inertia, damping in map(_motor, motors)]
    lightest = min([mass, *(inertia for inertia, _ in map(_motor, motors))])
    frequency = np.sqrt(sum(springs) / lightest)
    needed = max(period * max(rates) / DAMPING_PER_STEP, period * frequency / ANGLE_PER_STEP)
    if needed > MOST_STEPS:
        raise SimulationError(
            f"the rig's fastest mode needs more than {MOST_STEPS} integration steps per period: are inertia, damping"
            " and stiffness in the units the rig states?"
        )
    return max(FEWEST_STEPS, int(np.ceil(needed)))


def _inputs(torques: Mapping[str, TorqueInput], roles: list[str]) -> list[TorqueInput]:
    unknown = sorted(set(torques) - set(roles))
    if unknown:
        raise SimulationError(f"no torque input '{unknown[0]}' here; this joint has {', '.join(roles)}")
    return [torques.get(role, 0.0) for role in roles]


def _coded(transmission: Transmission) -> tuple[int, float, float]:
    match transmission:
        case LinearTransmission(stiffness=k):
            return LINEAR, k, 0.0
        case CubicTransmission(stiffness=k1, cubic=k3):
            return CUBIC, k1, k3
        case Vsa2Transmission(stiffness=k, geometry=c):
            return VSA2, k, c
        case _:
            raise SimulationError(
                "a transmission without a type that holds without a set-point (linear, cubic, vsa2) cannot be"
                " simulated here"
            )


def _motor(motor: Motor) -> tuple[float, float]:
    inertia = motor.reflected_inertia
    if inertia is None:
        raise SimulationError("a motor without an inertia cannot be simulated: give 'inertia' in the rig")
    return inertia, motor.reflected_damping


def _link(link: Link | None) -> Array:
    if link is None:
        raise SimulationError("a joint without a link cannot be simulated: give 'link.inertia' in the rig")
    return np.array([link.inertia, link.damping, link.gravity_torque])


def _start(start: Array | None, size: int) -> Array:
    state = np.zeros(size) if start is None else np.array(start, dtype=np.float64)
    if state.shape != (size,):
        raise SimulationError(f"the initial state has shape {state.shape}, not ({size},)")
    return state


def _require_finite(states: Array, time: Array) -> None:
    bad = ~np.isfinite(states).all(axis=1)
    if bool(bad.any()):
        at = time[int(np.argmax(bad))]
        raise SimulationError(
            f"the motion leaves what the model describes at t = {at:.3f} s (a VSA-II's four-bar mechanism at its"
            " singularity, or an integration that diverges): take smaller torques or more steps"
        )


def _contiguous(truth: Mapping[str, Array]) -> dict[str, Array]:
    return {name: np.ascontiguousarray(values) for name, values in truth.items()}
