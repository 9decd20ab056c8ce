"""The equations that a mechanical joint's roles allow, as residuals: not zero where the rig and the log disagree.

    motor          B θ̈ + D θ̇ + friction − τ_T − τ            (Flacco 2012 eq. 4, 8, 12)
    secondary      B_c θ̈_c + D_c θ̇_c + friction + ψ_e − τ_c    (Flacco 2012 eq. 12, 52)
    transmission   τ_sensor − τ_T(φ, φ̇, θ_c, t)
    link           M q̈ + D q̇ + friction + g(q) + Σ τ_T − τ_ext  (Flacco 2012 eq. 3, 7)
    sensors        two sensors of one quantity

with φ = q − θ. A position that is not recorded follows from the torque sensor through the transmission, or, without a sensor,
from the motor equation; that equation is then used up.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vsalog.binding.joint import offered_roles
from vsalog.core.significance import DETECTED
from vsalog.effects.backlash import engaged
from vsalog.effects.body_torque import BodyTorque, body_torque
from vsalog.effects.friction import stribeck
from vsalog.effects.gravity import holding_torque
from vsalog.mechanics import flexibility_torque, reaction_torque
from vsalog.mechanics.links import link_inertia, link_weight
from vsalog.mechanics.transmissions import coded
from vsalog.residuals._inverse import deflection_under
from vsalog.residuals._loops import bristle_torque, loop_torque
from vsalog.residuals.memory import remembered
from vsalog.residuals.sensing import is_commanded, known
from vsalog.rig.schema import (
    AntagonisticJoint,
    AwasTransmission,
    ElasticJoint,
    Friction,
    KnownTransmission,
    Lever,
    Link,
    Motor,
    RigidJoint,
    SerialJoint,
    UnknownTransmission,
    Vsa2Transmission,
)

Array = NDArray[np.float64]
Mechanical = ElasticJoint | SerialJoint | AntagonisticJoint
Side = Literal["motor", "transmission", "link", "sensor", "pneumatic"]


@dataclass(frozen=True, slots=True)
class Equation:
    """The residual of one equation of a joint.

    Attributes
    ----------
    name : motor, motor_1, secondary_motor, transmission, link, deflection, …
    side : of the joint it is about
    unit : SI
    residual : shape (N,), but for what is `shaped`
    shaped : shape (N,), or 0: computed from filtered channels, with corners or waves that the filter would have removed;
        it has yet to pass the filter
    rate : shape (N,), the velocity whose sign dry friction depends on; none where there is no friction
    """

    name: str
    side: Side
    unit: str
    residual: Array
    shaped: Array | float = 0.0
    rate: Array | None = None

    @property
    def whole(self) -> Array:
        """The residual at every sample, shape (N,)."""
        return self.residual + self.shaped


@dataclass(frozen=True, slots=True)
class Motion:
    """The motion of a joint by its rig and its channels; each of shape (3, N): value and first and second derivative.

    Attributes
    ----------
    roles : the true roles
    motors : suffix → θ
    link : q; none where nothing determines it
    deflections : suffix → φ
    torques : suffix → τ_T, shape (N,), what the transmission transmits
    measured : suffixes whose τ_T is the torque sensor's, or the motor equation's, so that φ follows from it
    spent : suffixes whose motor equation gave τ_T
    slacks : suffix or "link" → changes of the position that may be noise [rad]
    """

    roles: Mapping[str, Array]
    motors: Mapping[str, Array]
    link: Array | None
    deflections: Mapping[str, Array]
    torques: Mapping[str, Array]
    measured: frozenset[str]
    spent: frozenset[str]
    slacks: Mapping[str, float]


def balance(joint: Mechanical, roles: Mapping[str, Array], time: Array, spread: Mapping[str, float]) -> list[Equation]:
    """Form every equation that the roles allow.

    Parameters
    ----------
    joint : of the rig
    roles : role → value and derivatives, shape (3, N), of `true_roles`
    time : shape (N,) [s]
    spread : role → standard deviation of its noise after the filter
    """
    motion = motion_of(joint, roles, time, spread)
    equations: list[Equation] = []
    for suffix, motor in _motors(joint).items():
        role = f"motor_torque{suffix}"
        closed = suffix in motion.torques and suffix in motion.motors and suffix not in motion.spent
        if motor.inertia is not None and role in roles and closed:
            theta, torque = motion.motors[suffix], motion.torques[suffix]
            residual = remembered(turned, motor, theta, torque, roles[role])
            load = torque if motor.friction.load else None
            shaped = remembered(_resisted, motor, theta, load, motion.slacks[suffix], time)
            equations.append(
                recorded(Equation(f"motor{suffix}", "motor", "N*m", residual, shaped, theta[1]), motor, joint, roles)
            )
    if isinstance(joint, SerialJoint):
        equations += _secondary(joint, motion, time)
    equations += _transmissions(joint, motion)
    if joint.link is not None and motion.link is not None and len(motion.torques) == len(_motors(joint)):
        first, *others = motion.torques.values()
        total = remembered(np.add, first, *others) if others else first
        residual = remembered(driven, joint.link, motion.link, total, roles.get("external_torque"))
        load = total if joint.link.friction.load else None
        shaped = remembered(rubbing, joint.link.friction, motion.link, load, motion.slacks["link"])
        shaped = less_torques(joint.link.torques, 1.0, motion.link, time, shaped)
        equation = Equation("link", "link", "N*m", residual, shaped, motion.link[1])
        equations.append(in_angles(scaled(equation, torque_unit(joint, roles)), joint, roles))
        if "link_acceleration" in roles and "link_position" in roles:
            off = roles["link_acceleration"][0] - motion.link[2]
            equations.append(Equation("link_acceleration", "sensor", "rad/s^2", off))
    return equations


def recorded(equation: Equation, motor: Motor, joint: Mechanical | RigidJoint, roles: Mapping[str, Array]) -> Equation:
    """Return a motor's equation in its recorded input: its torque, or the error of a commanded position.

    Were all torques, inertias and gains smaller by one factor, the equations would be so, too, and noise would seem explained.
    Formed in recorded quantities they stay as they are: a scale that all torques have in common cannot be determined.
    """
    equation = scaled(equation, 1.0 / motor.torque_gain)
    if motor is getattr(joint, "motor", None):
        return in_angles(equation, joint, roles)
    return equation


def in_angles(equation: Equation, joint: Mechanical | RigidJoint, roles: Mapping[str, Array]) -> Equation:
    """Return an equation of torques as the position errors that cause them where nothing else determines the scale of torques."""
    drive = getattr(joint, "drive", None)
    if drive is None or not is_commanded(joint, roles):
        return equation
    return replace(scaled(equation, 1.0 / drive.kp), unit="rad")


def torque_unit(joint: Mechanical | RigidJoint, roles: Mapping[str, Array]) -> float:
    """Return a recorded torque over a true one [1]: of the first motor that has one, else of a torque sensor."""
    for suffix, motor in _motors(joint).items():
        if f"motor_torque{suffix}" in roles:
            return 1.0 / motor.torque_gain
    sensor = next((r for r in roles if r.startswith("torque_sensor")), None)
    return 1.0 if sensor is None else abs(_gain(joint, sensor))


def scaled(equation: Equation, factor: float) -> Equation:
    """Return an equation times a factor."""
    if factor == 1.0:
        return equation
    residual, shaped = (
        remembered(np.multiply, factor, part) if np.ndim(part) else factor * part
        for part in (equation.residual, equation.shaped)
    )
    return replace(equation, residual=np.asarray(residual), shaped=shaped)


def motion_of(joint: Mechanical, roles: Mapping[str, Array], time: Array, spread: Mapping[str, float]) -> Motion:
    """Return the motion of a joint; see `Motion`."""
    suffixes = list(_motors(joint))
    motors = {s: roles[f"motor_position{s}"] for s in suffixes if f"motor_position{s}" in roles}
    link = roles.get("link_position")
    for s in suffixes:
        phi = roles.get(f"deflection{s}")
        if phi is not None and link is None and s in motors:
            link = remembered(np.add, motors[s], phi)
        elif phi is not None and link is not None and s not in motors:
            motors[s] = remembered(np.subtract, link, phi)
    deflections, torques = {}, {}
    measured, spent = set(), set()
    for s in suffixes:
        transmission = _transmission(joint, s)
        if isinstance(transmission, UnknownTransmission):
            continue
        arm = roles["setpoint"] if isinstance(transmission, AwasTransmission) and "setpoint" in roles else None
        if isinstance(transmission, AwasTransmission) and arm is None:
            continue
        lever = None if arm is None else remembered(_value, arm)
        if f"deflection{s}" in roles or (link is not None and s in motors):
            phi = roles[f"deflection{s}"] if f"deflection{s}" in roles else remembered(np.subtract, link, motors[s])
            sensed = [f"deflection{s}"] if f"deflection{s}" in roles else ["link_position", f"motor_position{s}"]
            slack = DETECTED * float(np.hypot.reduce([spread.get(r, 0.0) for r in sensed]))
            deflections[s], torques[s] = phi, remembered(transmitted, transmission, phi, lever, time, slack)
            continue
        felt = _felt(joint, s, roles, motors, time)
        if felt is None or s not in motors:
            continue
        slack = DETECTED * spread.get(f"torque_sensor{s}", spread.get(f"motor_torque{s}", 0.0))
        deflections[s] = remembered(_deflected, transmission, felt, lever, time, slack)
        torques[s] = felt
        measured.add(s)
        if f"torque_sensor{s}" not in roles:
            spent.add(s)
    sides = [s for s in deflections if s in motors]
    if link is None and sides:
        link = remembered(np.add, motors[sides[0]], deflections[sides[0]])
    slacks = {s: DETECTED * spread.get(f"motor_position{s}", 0.0) for s in suffixes}
    slacks["link"] = DETECTED * spread.get("link_position", max(slacks.values()) / DETECTED)
    return Motion(roles, motors, link, deflections, torques, frozenset(measured), frozenset(spent), slacks)


def transmitted(
    transmission: KnownTransmission, phi: Array, arm: Array | None, time: Array, slack: float = 0.0
) -> Array:
    """Return τ_T of a deflection, shape (3, N), and a lever arm: spring, damping, hysteresis.

    Hysteresis ignores changes below `slack` [rad], which are noise.
    """
    torque = flexibility_torque(transmission, phi[0], arm, time)
    if transmission.damping:
        torque = torque + transmission.damping * engaged(phi[0], transmission.backlash, phi[1])
    if transmission.bouc_wen is not None or transmission.slip:
        elements = np.array([(e.stiffness, e.limit) for e in transmission.slip]).reshape(-1, 2)
        torque = torque + loop_torque(coded(transmission), elements, phi[0], slack)
    return torque


def _felt(
    joint: Mechanical, suffix: str, roles: Mapping[str, Array], motors: Mapping[str, Array], time: Array
) -> Array | None:
    """Return τ_T of the torque sensor, else of the motor equation."""
    if f"torque_sensor{suffix}" in roles:
        return remembered(_value, roles[f"torque_sensor{suffix}"])
    motor = _motors(joint)[suffix]
    if f"motor_torque{suffix}" in roles and suffix in motors and motor.inertia is not None:
        return remembered(_transferred, motor, motors[suffix], roles[f"motor_torque{suffix}"], time)
    return None


def _transferred(motor: Motor, theta: Array, recorded: Array, time: Array) -> Array:
    """Return the part of a motor's torque that is left for its transmission."""
    return np.asarray(_moved(motor, theta) + _resisted(motor, theta, None, 0.0, time) - recorded[0])


def _value(x: Array) -> Array:
    """Return the value of a signal with its derivatives."""
    return np.asarray(x[0])


def _deflected(transmission: KnownTransmission, torque: Array, arm: Array | None, time: Array, slack: float) -> Array:
    """Return φ and its derivatives under a torque, shape (3, N); the inverse of `transmitted`.

    Damping and loops are part of the transmitted torque: all of it is undone together.
    """
    largest = float(np.fmax.reduce(np.abs(torque)))
    elements = np.array([(e.stiffness, e.limit) for e in transmission.slip]).reshape(-1, 2)
    lever = np.zeros_like(torque) if arm is None else arm
    near = float(np.finfo(np.float64).eps) ** (2.0 / 3.0) * largest
    phi = deflection_under(coded(transmission), elements, torque, lever, time, _limit(transmission), slack, near)
    rate = slope_of(phi, time)
    return np.stack([phi, rate, slope_of(rate, time)])


def _limit(transmission: KnownTransmission) -> float:
    """Return the largest deflection up to which a spring's torque rises [rad]."""
    if isinstance(transmission, Vsa2Transmission):
        # A four-bar mechanism ends at its singularity, and hardens long before it.
        return 1.98 * float(np.arcsin(1.0 / transmission.geometry))
    return 0.25 * np.pi if isinstance(transmission, AwasTransmission) else 10.0


def slope_of(values: Array, time: Array) -> Array:
    """Return the derivative of evenly spaced samples, shape (N,): central differences of fourth order.

    It is NaN next to what is not known. Those of second order would attenuate a motion of 10 Hz by 1 %.
    """
    out = np.full_like(values, np.nan)
    if values.size > 4:
        period = time[1] - time[0]
        out[2:-2] = (8.0 * (values[3:-1] - values[1:-3]) - (values[4:] - values[:-4])) / (12.0 * period)
    return out


def turned(motor: Motor, theta: Array, torque: Array, recorded: Array) -> Array:
    """Return B θ̈ + D θ̇ − τ_T − τ."""
    return np.asarray(_moved(motor, theta) - torque - recorded[0])


def _moved(motor: Motor, theta: Array) -> Array:
    """Return B θ̈ + D θ̇."""
    motor = motor.reflected
    assert motor.inertia is not None
    return np.asarray(motor.inertia * theta[2] + motor.damping * theta[1])


def _resisted(motor: Motor, theta: Array, load: Array | None, slack: float, time: Array) -> Array | float:
    """Return dry friction less the torques of effects."""
    motor = motor.reflected
    return less_torques(motor.torques, motor.gear_ratio, theta, time, rubbing(motor.friction, theta, load, slack))


def less_torques(
    torques: tuple[BodyTorque, ...], ratio: float, x: Array, time: Array, resisting: Array | float
) -> Array | float:
    """Return a torque that a motor or a link has to overcome, less the torques of effects, such as cogging or a push.

    Parameters
    ----------
    torques : of effects, as the joint feels them
    ratio : of the gear that they are behind
    x : motion of the body, shape (3, N)
    time : shape (N,) [s]
    resisting : shape (N,), or 0
    """
    if not torques:
        return resisting
    return np.asarray(np.subtract(resisting, remembered(_added, torques, ratio, x, time)))


def _added(torques: tuple[BodyTorque, ...], ratio: float, x: Array, time: Array) -> Array:
    return body_torque(torques, ratio, x[0], x[1], time)


def rubbing(friction: Friction, x: Array, load: Array | None, slack: float) -> Array | float:
    """Return the torque of dry friction over a motion, shape (3, N); at rest it is not known."""
    if not friction.rubs:
        return 0.0
    level = np.full_like(x[1], friction.coulomb)
    if friction.static is not None and friction.stribeck_velocity is not None:
        level += stribeck(friction.static - friction.coulomb, friction.stribeck_velocity, x[1])
    if friction.load and load is not None:
        level += friction.load * np.abs(load)
    if friction.presliding_stiffness is not None:
        return bristle_torque(x[0], level, friction.presliding_stiffness, slack)
    return np.asarray(level * np.sign(x[1]))


def driven(link: Link, q: Array, torque: Array, external: Array | None) -> Array:
    """Return M q̈ + D q̇ + g(q) + τ_T − τ_ext."""
    weight = holding_torque(link_weight(link), link.gravity_angle, q[0])
    carried = link_inertia(link) * q[2] + link.damping * q[1] + weight + torque
    return np.asarray(carried if external is None else carried - external[0])


def lever_angle(lever: Lever, arm: Array) -> Array:
    """Return the secondary motor's angle of a lever arm, both of shape (3, N)."""
    return np.asarray(np.stack([lever.start - arm[0], -arm[1], -arm[2]]) / lever.travel)


def _secondary(joint: SerialJoint, motion: Motion, time: Array) -> list[Equation]:
    motor, lever, roles = joint.secondary_motor, joint.lever, motion.roles
    if motor is None or motor.inertia is None or lever is None or "" not in motion.deflections:
        return []
    if not known(roles, "setpoint", "secondary_torque") or not isinstance(joint.transmission, AwasTransmission):
        return []
    arm = roles["setpoint"]
    theta, length, phi = (
        remembered(lever_angle, lever, arm), remembered(_value, arm), remembered(_value, motion.deflections[""])
    )  # fmt: skip
    reaction = remembered(reaction_torque, joint.transmission, phi, length, lever.travel, time)
    residual = remembered(turned, motor, theta, remembered(np.negative, reaction), roles["secondary_torque"])
    shaped = remembered(_resisted, motor, theta, reaction, 0.0, time)
    return [recorded(Equation("secondary_motor", "motor", "N*m", residual, shaped, theta[1]), motor, joint, roles)]


def _transmissions(joint: Mechanical, motion: Motion) -> list[Equation]:
    """Return the equations of torque sensors, and of deflections that two sensors determine."""
    roles, equations = motion.roles, []
    for s, torque in motion.torques.items():
        if f"torque_sensor{s}" in roles and s not in motion.measured:
            off = remembered(_misread, _gain(joint, f"torque_sensor{s}"), roles[f"torque_sensor{s}"], torque)
            equations.append(Equation(f"transmission{s}", "transmission", "N*m", off))
        if known(roles, f"deflection{s}", f"motor_position{s}", "link_position"):
            off = roles[f"deflection{s}"][0] - roles["link_position"][0] + roles[f"motor_position{s}"][0]
            equations.append(Equation(f"deflection{s}", "sensor", "rad", off))
    if "torque_sensor" in roles and len(motion.torques) == 2:
        total = remembered(np.add, *motion.torques.values())
        off = remembered(_misread, _gain(joint, "torque_sensor"), roles["torque_sensor"], total)
        equations.append(Equation("transmission", "transmission", "N*m", off))
    if len(motion.measured) == 2 and motion.link is not None:
        # Both transmissions hang on one link: where each puts it must agree.
        second = list(motion.deflections)[1]
        off = motion.link[0] - motion.motors[second][0] - motion.deflections[second][0]
        equations.append(Equation("agreement", "transmission", "rad", off))
    return equations


def _misread(gain: float, sensor: Array, torque: Array) -> Array:
    """Return the difference of a torque sensor's reading from the rig's."""
    return np.asarray(gain * (sensor[0] - torque))


def _gain(joint: Mechanical | RigidJoint, role: str) -> float:
    """Return a sensor's gain: the equation is formed in its readings, so that a large gain does not make it small."""
    return offered_roles(joint)[role].gain


def _motors(joint: Mechanical | RigidJoint) -> dict[str, Motor]:
    if isinstance(joint, AntagonisticJoint):
        return {"_1": joint.motor_1, "_2": joint.motor_2}
    return {"": joint.motor}


def _transmission(joint: Mechanical, suffix: str) -> KnownTransmission | UnknownTransmission:
    return getattr(joint, f"transmission{suffix}")  # type: ignore[no-any-return]
