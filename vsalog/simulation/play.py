"""Simulates a machine: inputs in, the true motion of every joint out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise
from typing import cast

import numpy as np
from numba.core.errors import NumbaError
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from vsalog.core.errors import ExtensionError, SimulationError
from vsalog.core.progress import counted
from vsalog.effects.backlash import engaged
from vsalog.effects.drive import PositionServo, delivered, late_command
from vsalog.effects.quantisation import rounded
from vsalog.mechanics import flexibility_torque, reaction_torque, stiffness
from vsalog.mechanics._atoms import TORQUES, planned
from vsalog.readers.limits import BLOCK_ROWS
from vsalog.rig.roles import COMMANDS
from vsalog.rig.schema import AntagonisticJoint, AwasTransmission, Motor, SerialJoint
from vsalog.simulation._integrate import ServoRow, integrate
from vsalog.simulation.inputs import Input, Motion, Servo, TorqueInput, at_samples
from vsalog.simulation.machine import BRISTLE_SPEED, DEFLECTING, Machine, MotorSlot, TransmissionSlot, drive_of

Array = NDArray[np.float64]

# Called with sample and joint → name → truth of it.
Control = Callable[[int, Mapping[str, Mapping[str, Array]]], None]


def play(
    machine: Machine,
    inputs: Mapping[str, Mapping[str, Input]],
    time: Array,
    *,
    steps: int | None = None,
    start: Mapping[str, Array] | None = None,
    restarts: Mapping[int, Mapping[str, Array]] | None = None,
    control: Control | None = None,
    speeds: Array | float = BRISTLE_SPEED,
    deflecting: float = DEFLECTING,
) -> dict[str, dict[str, Array]]:
    """Move a machine and return joint → name → truth, shape (N,); see `Experiment` for the names.

    Parameters
    ----------
    machine : from `build`
    inputs : joint → role → input; missing ones are zero; a `link_position` that is a motion prescribes the link's
    time : shape (N,), uniform [s]
    steps : integration steps per sample period; as many as the machine's fastest mode needs when absent
    start : joint → (q, q̇, θ₁, θ̇₁, …); rest when absent: the link hanging, or where its servo or its motion begins
    restarts : sample → joint → (q, q̇, θ₁, θ̇₁, …), the positions and velocities set there; bristles, loops and slip
        elements, which are not measured, stay as they are
    control : called with sample and joint → name → truth, shape (1,), of each sample when it is over, to write what is held in
        the next one into an input that is an array
    speeds, deflecting : at which bristles and loops have to be followed, see `Machine.steps`

    Raises
    ------
    SimulationError
        An input does not fit, or the motion leaves the range of the model.
    """
    period = float(time[1] - time[0])
    prescribed = [m.index for m in machine.motors if isinstance(inputs.get(m.joint, {}).get(m.role), Motion)]
    prescribed += [j for j, name in enumerate(machine.joints) if "link_position" in inputs.get(name, {})]
    suggested, stiff = machine.steps(period, prescribed, speeds, deflecting=deflecting)
    looks = _looks(machine, period)
    # Servos look again at the begin of a step.
    count = looks * -(-(suggested if steps is None else steps) // looks)
    drives = _Drives(machine, inputs, time, count, looks, start or {})
    at = machine.moved(list(drives.splines))
    x, modes = _first_state(machine, drives, start or {}), np.zeros(machine.modes, dtype=np.int64)
    work, room = machine.work()
    states, accelerations = np.empty((time.size, x.size)), np.empty((time.size, machine.freedom))
    edges = sorted({*range(0, time.size, BLOCK_ROWS if control is None else 1), *(restarts or {}), time.size})
    for first, last in counted("simulation", pairwise(edges), len(edges) - 1):
        part = slice(first, last)
        if control is not None and first > 0:
            over = slice(first - 1, first)
            control(first - 1, _truth(machine, drives, states[over], accelerations[over], over))
        restarted = restarts is not None and first in restarts
        if restarts is not None and restarted:
            _put(machine, restarts[first], x)
        # The last sample ends the motion: its period is begun only for the acceleration.
        _integrated(
            machine.numbers, at, stiff, first == 0 or restarted, period / count, float(time[first]), *drives.chunk(part), first,
            x, modes, work, room, states[part], accelerations[part],
        )  # fmt: skip
    _require_finite(states, time)
    return _truth(machine, drives, states, accelerations, slice(None))


def _integrated(*arguments: object) -> None:
    """Integrate a part of the motion.

    Raises
    ------
    ExtensionError
        A formula that a package adds cannot be compiled.
    """
    try:
        integrate(*arguments)
    except NumbaError as error:
        where = sorted({table.formula.__module__ for table in TORQUES if not table.__module__.startswith("vsalog.")})
        if not where:
            raise
        raise ExtensionError(
            f"the formula of an effect cannot be compiled ({', '.join(where)}): it may use arithmetic, and NumPy's functions of"
            " numbers; correct the package, or uninstall it"
        ) from error


def _truth(
    machine: Machine, drives: _Drives, states: Array, accelerations: Array, part: slice
) -> dict[str, dict[str, Array]]:
    """Return joint → name → truth in a part of the samples, from their states and accelerations."""
    time = drives.time[part]
    truth: dict[str, dict[str, Array]] = {name: {} for name in machine.joints}
    for j, name in enumerate(machine.joints):
        truth[name] |= _moved("link", j, states, accelerations, machine.freedom)
        truth[name]["external_torque"] = at_samples(drives.external[j], drives.time)[part]
        truth[name] |= {role: values[part] for role, values in drives.commanded_of.get(name, {}).items()}
    for slot in machine.motors:
        truth[slot.joint] |= _moved(_motor_name(slot), slot.index, states, accelerations, machine.freedom)
        if slot.role not in drives.unknown[slot.joint]:
            truth[slot.joint][slot.role] = drives.commanded(slot)[part]
    for transmission in machine.transmissions:
        truth[transmission.joint] |= _transmitted(machine, transmission, truth[transmission.joint], states, time)
    for name, joint in machine.joints.items():
        if isinstance(joint, AntagonisticJoint):
            for quantity in ("flexibility_torque", "transmission_torque", "stiffness"):
                truth[name][f"{quantity}_total"] = truth[name][f"{quantity}_1"] + truth[name][f"{quantity}_2"]
    return {name: {key: np.ascontiguousarray(values) for key, values in own.items()} for name, own in truth.items()}


class _Drives:
    """The inputs of a machine, ready to be cut into what `integrate` takes."""

    def __init__(
        self, machine: Machine, inputs: Mapping[str, Mapping[str, Input]], time: Array, steps: int, looks: int,
        start: Mapping[str, Array],
    ) -> None:  # fmt: skip
        _require_known(machine, inputs)
        self.machine, self.time, self.steps, self.looks = machine, time, steps, looks
        self.period = float(time[1] - time[0])
        self.external: list[TorqueInput] = [
            _torque(name, inputs.get(name, {}).get("external_torque", 0.0)) for name in machine.joints
        ]
        self.torques: dict[int, TorqueInput] = {}
        self.splines: dict[int, CubicSpline] = {}
        self.servos: list[tuple[MotorSlot, tuple[float, ...], Array]] = []
        self.commanded_of: dict[str, dict[str, Array]] = {}
        self.unknown: dict[str, set[str]] = {name: set() for name in machine.joints}
        for j, name in enumerate(machine.joints):
            motion = inputs.get(name, {}).get("link_position")
            if motion is not None:
                self.splines[j] = CubicSpline(time, at_samples(_motion(name, motion).position, time))
        for slot in machine.motors:
            given = inputs.get(slot.joint, {}).get(slot.role, 0.0)
            commands = {role: inputs[slot.joint][role] for role in COMMANDS if role in inputs.get(slot.joint, {})}
            servo = drive_of(machine.joints[slot.joint])
            if commands and servo is not None and slot.role == "motor_torque":
                commanded = {role: at_samples(_torque(slot.joint, command), time) for role, command in commands.items()}
                self.commanded_of[slot.joint] = commanded
                begin = 0.0 if slot.joint not in start else float(start[slot.joint][2 if slot.index else 0])
                reference = self._planned(servo, commanded, begin)
                self.servos.append((slot, _row_of_drive(slot, servo, self.period / steps, steps // looks), reference))
            elif isinstance(given, Motion):
                self.splines[slot.index] = CubicSpline(time, at_samples(given.position, time))
                self.unknown[slot.joint].add(slot.role)
            elif isinstance(given, Servo):
                reference = _followed(given, time, looks)
                self.servos.append((slot, _row_of_servo(slot, given, self.period / steps, steps), reference))
            else:
                self.torques[slot.index] = given
                at_samples(given, time[:1] if callable(given) else time)  # refuses inputs that do not fit
        self.commands = np.zeros((time.size, looks, len(self.servos)))
        self.sums = np.zeros(len(self.servos))

    def _planned(self, servo: PositionServo, commands: Mapping[str, Array], begin: float) -> Array:
        """Return position and velocity that a drive's loop follows each time it looks, shape (N, looks, 2).

        Where no position is commanded it goes on from `begin` with the velocity.
        """
        late = servo.delay / self.period
        late_commands = {role: late_command(command, late, self.looks) for role, command in commands.items()}
        rates = late_commands.get("commanded_velocity", np.zeros(self.time.size * self.looks))
        held = late_commands.get("commanded_position", begin + rates.cumsum() * self.period / self.looks)
        if servo.plans:
            speed, acceleration = (
                np.inf if one is None else one for one in (servo.speed_limit, servo.acceleration_limit)
            )
            held, rates = planned(held, self.period / self.looks, speed, acceleration)
        return np.stack([held, rates], axis=-1).reshape(self.time.size, self.looks, 2)

    def chunk(self, part: slice) -> tuple[Array, Array, Array, Array, Array, Array]:
        """Return inputs, prescribed motion, servos, reference, commands and sums for the periods `part`; see `integrate`."""
        machine, time = self.machine, self.time[part]
        n, step = machine.freedom, self.period / self.steps
        stages = (np.arange(self.steps)[:, None] + np.array([0.0, 0.5, 1.0])) * step
        grid = time[:, None, None] + stages
        inputs = np.zeros((*grid.shape, n))
        for j, torque in enumerate(self.external):
            inputs[..., j] = _over(torque, grid, self.time, 0.0)
        for slot in machine.motors:
            i, motor = slot.index, slot.motor
            if i in self.torques:
                torque = _over(self.torques[i], grid, self.time, motor.torque_delay)
                # In addition to the external torque, where motor and link are one.
                inputs[..., i] += delivered(torque, motor.torque_gain, motor.torque_offset, motor.torque_step)
        for i, spline in self.splines.items():
            inputs[..., i] = spline(grid, 2)
        prescribed = np.zeros((time.size, 2, n))
        for i, spline in self.splines.items():
            prescribed[:, 0, i], prescribed[:, 1, i] = spline(time), spline(time, 1)
        reference = np.zeros((time.size, self.looks, 2, len(self.servos)))
        for k, (_, _, followed) in enumerate(self.servos):
            reference[..., k] = followed[part]
        rows = np.array([row for _, row, _ in self.servos]).reshape(-1, len(ServoRow))
        return inputs.reshape(-1, 3, n), prescribed, rows, reference, self.commands, self.sums

    def commanded(self, slot: MotorSlot) -> Array:
        """Return the torque that was commanded at each sample, as it is recorded."""
        for k, (servo_slot, _, _) in enumerate(self.servos):
            if servo_slot.index == slot.index:
                return self.commands[:, 0, k]
        return np.asarray(rounded(at_samples(self.torques[slot.index], self.time), slot.motor.torque_step))

    def beginning(self, slot: MotorSlot) -> float | None:
        """Return where a motor under a servo or a prescribed motion begins."""
        if slot.index in self.splines:
            return float(self.splines[slot.index](self.time[0]))
        return next((float(followed[0, 0, 0]) for s, _, followed in self.servos if s.index == slot.index), None)


def _looks(machine: Machine, period: float) -> int:
    """Return how often in a sample's period the fastest drive looks at its encoder."""
    servos = [servo for joint in machine.joints.values() if (servo := drive_of(joint)) is not None]
    return max((max(1, round(period / servo.period)) for servo in servos), default=1)


def _followed(servo: Servo, time: Array, looks: int) -> Array:
    """Return position and velocity that a servo follows, shape (N, looks, 2), of which it looks at the first of each sample."""
    given = servo.reference
    if isinstance(given, np.ndarray) and given.ndim == 2:
        # As it is written during the run.
        return np.broadcast_to(given[:, None], (time.size, looks, 2))
    spline = CubicSpline(time, at_samples(given, time))
    followed = np.stack([spline(time), spline(time, 1)], axis=-1)
    return np.repeat(followed[:, None], looks, axis=1)


def _row_of_servo(slot: MotorSlot, servo: Servo, step: float, every: int) -> tuple[float, ...]:
    loop = (servo.stiffness, servo.damping, 0.0, servo.limit, 0.0)
    return (float(slot.index), *loop, *_delivery(slot.motor, step), float(every))


def _row_of_drive(slot: MotorSlot, servo: PositionServo, step: float, every: int) -> tuple[float, ...]:
    limit = np.inf if servo.torque_limit is None else servo.torque_limit
    loop = (servo.kp, servo.kd, servo.ki, limit, servo.resolution)
    return (float(slot.index), *loop, *_delivery(slot.motor, step), float(every))


def _delivery(motor: Motor, step: float) -> tuple[float, ...]:
    return motor.torque_step, motor.torque_gain, motor.torque_offset, float(round(motor.torque_delay / step))


def _require_known(machine: Machine, inputs: Mapping[str, Mapping[str, Input]]) -> None:
    for name in machine.joints:
        roles = [*(m.role for m in machine.motors if m.joint == name), "external_torque", "link_position"]
        if drive_of(machine.joints[name]) is not None:
            roles += COMMANDS
        unknown = sorted(set(inputs.get(name, {})) - set(roles))
        if unknown:
            raise SimulationError(f"joint '{name}' has no input '{unknown[0]}'; it has {', '.join(roles)}")


def _torque(name: str, given: Input) -> TorqueInput:
    if isinstance(given, Servo | Motion):
        raise SimulationError(f"joint '{name}': external_torque is a torque over time, neither a servo nor a motion")
    return given


def _motion(name: str, given: Input) -> Motion:
    if not isinstance(given, Motion):
        raise SimulationError(f"joint '{name}': link_position is a motion")
    return given


def _over(torque: TorqueInput, grid: Array, time: Array, delay: float) -> Array:
    """Return a torque at the steps' stages; samples are held, and before the first one it is the first.

    In a step within which the sample changes its mean acts, so that a delay need not be a number of steps.
    """
    if callable(torque):
        return at_samples(torque, np.maximum(grid.ravel() - delay, time[0])).reshape(grid.shape)
    if np.ndim(torque) == 0:
        return np.full(grid.shape, float(cast("float", torque)))
    held = at_samples(torque, time)
    period = time[1] - time[0]
    begin, end = ((grid[..., k] - delay - time[0]) / period for k in (0, 2))
    index = np.floor(begin).astype(np.int64)
    share = np.clip((end - index - 1.0) / (end - begin), 0.0, 1.0)  # of the step, with the next sample
    this, following = (held[np.clip(k, 0, held.size - 1)] for k in (index, index + 1))
    return np.repeat((this + share * (following - this))[..., None], 3, axis=-1)


def _first_state(machine: Machine, drives: _Drives, start: Mapping[str, Array]) -> Array:
    x = np.zeros(machine.state_size)
    for j, (name, joint) in enumerate(machine.joints.items()):
        if name in start:
            continue
        motors = [slot for slot in machine.motors if slot.joint == name]
        own = [slot for slot in motors if slot.index != j]
        driven = [drives.beginning(slot) for slot in motors if slot.role != "secondary_torque"]
        known = [position for position in driven if position is not None]
        hanging = joint.link.gravity_angle if joint.link is not None and not machine.chained else 0.0
        x[j] = sum(known) / len(known) if known else hanging
        if j in drives.splines:
            x[j] = float(drives.splines[j](drives.time[0]))
        for slot in own:
            position = drives.beginning(slot)
            x[slot.index] = (0.0 if slot.role == "secondary_torque" else x[j]) if position is None else position
    _put(machine, start, x)
    return x


def _put(machine: Machine, given: Mapping[str, Array], x: Array) -> None:
    """Set positions and velocities of joints."""
    for j, name in enumerate(machine.joints):
        if name not in given:
            continue
        indices = [j, *(slot.index for slot in machine.motors if slot.joint == name and slot.index != j)]
        state = np.array(given[name], dtype=np.float64)
        if state.shape != (2 * len(indices),):
            raise SimulationError(f"joint '{name}': the state has shape {state.shape}, not ({2 * len(indices)},)")
        for i, index in enumerate(indices):
            x[index], x[machine.freedom + index] = state[2 * i], state[2 * i + 1]


def _motor_name(slot: MotorSlot) -> str:
    return slot.role.removesuffix("_torque") if slot.role == "secondary_torque" else slot.role.replace("_torque", "")


def _moved(name: str, index: int, states: Array, accelerations: Array, n: int) -> dict[str, Array]:
    base, _, number = name.partition("_")
    suffix = f"_{number}" if number else ""
    return {
        f"{base}_position{suffix}": states[:, index],
        f"{base}_velocity{suffix}": states[:, n + index],
        f"{base}_acceleration{suffix}": accelerations[:, index],
    }


def _transmitted(
    machine: Machine, slot: TransmissionSlot, own: Mapping[str, Array], states: Array, time: Array
) -> dict[str, Array]:
    """Return a transmission's signals by their names."""
    t, s = slot.transmission, slot.suffix
    phi = own["link_position"] - own[f"motor_position{s}"]
    rate = engaged(phi, t.backlash, own["link_velocity"] - own[f"motor_velocity{s}"])
    arm, found = None, {}
    joint = machine.joints[slot.joint]
    if isinstance(joint, SerialJoint) and joint.lever is not None:
        arm = joint.lever.arm(own["secondary_position"])
        found["lever_arm"] = arm
        if bool(np.any(arm <= 0.0)):
            at = time[int(np.argmax(arm <= 0.0))]
            raise SimulationError(f"the lever arm reaches zero at t = {at:.3f} s: the secondary torque is too large")
        assert isinstance(t, AwasTransmission)
        found["reaction_torque"] = reaction_torque(t, phi, arm, joint.lever.travel, time)
    torque = flexibility_torque(t, phi, arm, time)
    transmitted = torque + t.damping * rate
    if t.bouc_wen is not None:
        transmitted = transmitted + t.bouc_wen.torque * states[:, machine.loop_state(slot.index)]
    for e in machine.slip_states(slot.index):
        transmitted = transmitted + states[:, e]
    return found | {
        f"deflection{s}": phi,
        f"flexibility_torque{s}": torque,
        f"transmission_torque{s}": transmitted,
        f"stiffness{s}": stiffness(t, phi, arm, time),
    }


def _require_finite(states: Array, time: Array) -> None:
    bad = ~np.isfinite(states).all(axis=1)
    if bool(bad.any()):
        at = time[int(np.argmax(bad))]
        raise SimulationError(
            f"the motion leaves the range of the model at t = {at:.3f} s (the integration diverges, or a mechanism such as a"
            " VSA-II's is at its singularity): take smaller torques or a higher rate"
        )
