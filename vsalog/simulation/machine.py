"""Joints of a rig as one machine that the compiled integrator moves: and its layout."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import SimulationError
from vsalog.effects.body_torque import BodyTorque
from vsalog.mechanics._atoms import TORQUES
from vsalog.mechanics.links import link_inertia, link_weight
from vsalog.mechanics.rigid_body import bodies, mass_matrix
from vsalog.mechanics.rigid_joint import as_one
from vsalog.mechanics.transmissions import coded, stiffness
from vsalog.rig.schema import (
    AntagonisticJoint,
    AwasTransmission,
    Chain,
    ElasticJoint,
    Friction,
    Joint,
    KnownTransmission,
    Link,
    Motor,
    PositionServo,
    RigidJoint,
    SerialJoint,
    UnknownTransmission,
)
from vsalog.simulation import _dynamics as d
from vsalog.simulation.accuracy import FINE, Accuracy

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

Movable = RigidJoint | ElasticJoint | SerialJoint | AntagonisticJoint

STIFF_STEPS = 16
"""Steps per period for the sake of damping alone beyond which implicit steps are cheaper: the equations are stiff."""
MOST_STEPS = 2000
"""Integration steps per sample period beyond which a unit in the rig is likelier wrong than a mode that fast."""
BRISTLE_SPEED = 10.0
"""Speed at which bristles have to be followed where none is known [rad/s]; they stay stable at five times this."""
DEFLECTING = 1.0
"""The same of deflections, for loops [rad/s]: springs deflect by a fraction of what a joint turns."""


@dataclass(frozen=True, slots=True)
class MotorSlot:
    """A motor in a machine: its joint, the role its torque has there, its suffix in names, its degree of freedom.

    The motor of a rigid joint has the link's.
    """

    joint: str
    role: str
    name: str
    motor: Motor
    index: int


@dataclass(frozen=True, slots=True)
class TransmissionSlot:
    """A transmission in a machine: its joint, the suffix of its signals' names, its row."""

    joint: str
    suffix: str
    transmission: KnownTransmission
    index: int


@dataclass(frozen=True, slots=True)
class Machine:
    """One joint, or the joints of a chain.

    Attributes
    ----------
    joints : by name, in the order of their links' degrees of freedom
    motors, transmissions : where they are
    numbers, at : the machine as the compiled functions read it, see `_dynamics`
    state_size : m
    inertia : the least that each degree of freedom has in any position, shape (n,)
    """

    joints: Mapping[str, Movable]
    motors: Sequence[MotorSlot]
    transmissions: Sequence[TransmissionSlot]
    numbers: Array
    at: Integers
    state_size: int
    inertia: Array

    @property
    def freedom(self) -> int:
        """Number of degrees of freedom n."""
        return len(self.inertia)

    @property
    def chained(self) -> bool:
        """Whether the joints form a chain."""
        return bool(self.at[d.At.CHAIN])

    @property
    def modes(self) -> int:
        """Number of modes."""
        return self.freedom + 2 * len(self.transmissions) + int(self.at[d.At.SLIPS])

    def work(self) -> tuple[Array, Array]:
        """Return the work arrays of the compiled functions: that of the equations of motion and that of the integrators."""
        n, m, links = self.freedom, self.state_size, int(self.at[d.At.CHAIN])
        return np.zeros((9 + links + 2 * n, max(27, n + 1))), np.zeros((12 + m, m))

    def moved(self, fixed: Sequence[int]) -> Integers:
        """Return `at` with these degrees of freedom moving as prescribed."""
        at = self.at.copy()
        at[at[d.At.FIXED] + np.array(fixed, dtype=np.int64)] = 1
        return at

    def loop_state(self, transmission: int) -> int:
        """Return where in the state the loop of a transmission is, −1 for none."""
        return int(self.at[self.at[d.At.LOOPS] + transmission])

    def slip_states(self, transmission: int) -> list[int]:
        """Return where in the state the slip elements of a transmission are."""
        elements = [s.index for s in self.transmissions for _ in s.transmission.slip]
        return [int(self.at[d.At.FIRST_SLIP]) + e for e, owner in enumerate(elements) if owner == transmission]

    def steps(
        self,
        period: float,
        fixed: Sequence[int] = (),
        speeds: Array | float = BRISTLE_SPEED,
        accuracy: Accuracy = FINE,
        deflecting: float = DEFLECTING,
    ) -> tuple[int, bool]:
        """Return the integration steps per period that the fastest mode needs, and whether the equations are stiff.

        Parameters
        ----------
        period : T [s]
        fixed : degrees of freedom that move as prescribed, however fast they would be
        speeds : at which bristles have to be followed, one or shape (freedom,) [rad/s]
        deflecting : speed of the deflections at which loops have to be followed [rad/s]
        accuracy : of a step

        Raises
        ------
        SimulationError
            More than `MOST_STEPS` are needed.
        """
        with np.errstate(all="ignore"):  # huge numbers give a huge number of steps
            needed, stiff = self._needed(period, fixed, speeds, accuracy, deflecting)
        if not needed <= MOST_STEPS:
            raise SimulationError(
                f"the rig's fastest mode needs more than {MOST_STEPS} integration steps per period: are inertia, damping"
                " and stiffness in the units the rig states?"
            )
        return max(1, int(np.ceil(needed))), stiff

    def _needed(
        self, period: float, fixed: Sequence[int], speeds: Array | float, accuracy: Accuracy, deflecting: float
    ) -> tuple[float, bool]:
        n, rates, load, inertia = self.freedom, [], np.zeros(self.freedom), self.inertia.copy()
        inertia[list(fixed)] = np.inf
        for slot in self.transmissions:
            link, motor, _ = self.at[self.at[d.At.ENDS] + 3 * slot.index :][:3]
            load[[link, motor]] += self._stiffness(slot)
            rates += [slot.transmission.damping / inertia[link], slot.transmission.damping / inertia[motor]]
            if loop := slot.transmission.bouc_wen:
                # How fast a loop forgets, at its edge: the slope of ż in z.
                steepest = loop.exponent * max(1.0, abs(2.0 * loop.shape - 1.0))
                rates.append(steepest * deflecting / loop.width)
        for j, joint in enumerate(self.joints.values()):
            # A chain's weight grows with its inertia.
            load[j] += 0.0 if self.chained or joint.link is None else abs(_gravity(joint.link)[0])
        for index, torque, ratio in _torques([j.link for j in self.joints.values()], self.motors):
            over_position, over_velocity = torque.slopes(ratio)
            load[index] += over_position
            rates.append(over_velocity / inertia[index])
        friction = self.numbers[self.at[d.At.FRICTION] :][: 7 * n].reshape(n, 7)
        viscous, static, bristle, bristle_damping = friction[:, [0, 2, 5, 6]].T
        load += bristle
        rates += list((viscous + bristle_damping) / inertia)
        rates += list(np.where(bristle > 0.0, bristle * speeds / np.maximum(static, 1e-12), 0.0))
        vibration = period * float(np.sqrt(np.max(load / inertia))) / accuracy.angle
        decay = period * max(rates) / accuracy.decay
        needed = vibration if decay > STIFF_STEPS else max(vibration, decay)
        return needed, decay > STIFF_STEPS

    def _stiffness(self, slot: TransmissionSlot) -> float:
        joint, t = self.joints[slot.joint], slot.transmission
        arm = joint.lever.start if isinstance(joint, SerialJoint) and joint.lever else None
        own = abs(float(stiffness(t, 0.5 * t.backlash + 1e-9, arm)))
        loop = t.bouc_wen.torque / t.bouc_wen.width if t.bouc_wen else 0.0
        return own + loop + sum(element.stiffness for element in t.slip)


def drive_of(joint: Joint) -> PositionServo | None:
    """Return the drive of a joint that is commanded a position, None where none is."""
    return joint.drive if isinstance(joint, RigidJoint | ElasticJoint | SerialJoint) else None


def build(joints: Mapping[str, Movable], chain: Chain | None = None) -> Machine:
    """Lay out one joint, or the joints of a chain.

    Parameters
    ----------
    joints : by name; those of a chain in its order
    chain : that they form; its link inertia and gravity replace those of the joints

    Raises
    ------
    SimulationError
        The rig lacks what a simulation needs.
    """
    motors = [slot for name, joint in joints.items() for slot in _motors(name, joint)]
    order = list(joints)
    rigid = {name for name, joint in joints.items() if isinstance(joint, RigidJoint)}
    if rigid and chain is not None:
        raise SimulationError(
            f"joint '{min(rigid)}': a chain of joints is simulated where all of them have transmissions only"
        )
    free = count(len(joints))
    motors = [
        MotorSlot(m.joint, m.role, m.name, m.motor, order.index(m.joint) if m.joint in rigid else next(free))
        for m in motors
    ]
    moving = [m for m in motors if m.joint not in rigid]
    where = {(m.joint, m.role): m.index for m in motors}
    slots: list[TransmissionSlot] = []
    ends, levers = [], []
    for j, (name, joint) in enumerate(joints.items()):
        for suffix, transmission in _transmissions(name, joint):
            slots.append(TransmissionSlot(name, suffix, transmission, len(slots)))
            secondary = where.get((name, "secondary_torque"), -1)
            ends.append((j, where[name, f"motor_torque{suffix}"], secondary))
            lever = joint.lever if isinstance(joint, SerialJoint) else None
            levers.append((lever.start, lever.travel) if lever else (0.0, 0.0))
    links = [_moved_link(name, joint) for name, joint in joints.items()]
    numbers, at, size = _coded(links, motors, moving, slots, ends, levers, order, chain)
    inertia = numbers[at[d.At.INERTIA] :][: len(joints) + len(moving)].copy()
    if chain is not None:
        inertia[: len(joints)] = _least_inertia(chain)
    return Machine(joints, motors, slots, numbers, at, size, inertia)


def _coded(
    links: Sequence[Link],
    motors: Sequence[MotorSlot],
    moving: Sequence[MotorSlot],
    slots: Sequence[TransmissionSlot],
    ends: Sequence[tuple[int, int, int]],
    levers: Sequence[tuple[float, float]],
    names: Sequence[str],
    chain: Chain | None,
) -> tuple[Array, Integers, int]:
    """Return the two arrays that `_dynamics` describes, and the length of the state.

    The motors that are `moving` have degrees of freedom of their own.
    """
    n = len(links) + len(moving)
    frictions = [*(k.friction for k in links), *(m.motor.friction for m in moving)]
    damping = [*(k.damping for k in links), *(m.motor.damping for m in moving)]
    bristled = np.array([f.presliding_stiffness is not None for f in frictions])
    dry = ~bristled & np.array([f.rubs for f in frictions])
    looped = np.array([s.transmission.bouc_wen is not None for s in slots])
    slips = [(float(s.index), e.stiffness, e.limit) for s in slots for e in s.transmission.slip]
    split = any(s.transmission.backlash > 0.0 or s.transmission.asymmetry for s in slots)
    payloads = {name: link.payload for name, link in zip(names, links, strict=True) if link.payload is not None}
    rows = [coded(s.transmission) for s in slots]
    width = max((row.size for row in rows), default=0)
    torques = list(_torques(links, motors))
    rows_of_torques = [torque.numbers(ratio) for _, torque, ratio in torques]
    first_of_torques = np.cumsum([0, *map(len, rows_of_torques)])[:-1]
    tables: list[Array] = [  # in the order of `_dynamics`
        np.array(
            [*(link_inertia(k) if chain is None else 0.0 for k in links), *(m.motor.inertia or 0.0 for m in moving)]
        ),
        np.array([_friction(c, f) for c, f in zip(damping, frictions, strict=True)]),
        np.array([_gravity(k) if chain is None else (0.0, 0.0) for k in links]),
        np.concatenate([np.zeros(0), *map(np.array, rows_of_torques)]),
        np.array([np.pad(row, (0, width - row.size)) for row in rows]),
        np.array(levers),
        np.array(slips),
        np.zeros(0) if chain is None else bodies(chain, payloads),
        np.zeros(3) if chain is None else np.array(chain.gravity),
        _coupling(chain, names, motors, n),
    ]
    bristles, first_slip = 2 * n, 2 * n + int(bristled.sum()) + int(looped.sum())
    integers: list[Integers] = [
        np.array(ends, dtype=np.int64).ravel(),
        _numbered(bristled, bristles),
        _numbered(looped, bristles + int(bristled.sum())),
        dry.astype(np.int64),
        np.zeros(n, dtype=np.int64),
        np.array(
            [(i, TORQUES.index(type(t)), k) for (i, t, _), k in zip(torques, first_of_torques, strict=True)],
            dtype=np.int64,
        ).ravel(),
    ]
    guarded = bool(dry.any() or bristled.any() or looped.any() or slips or split)
    counts = [n, len(links), len(slots), len(slips), len(torques), 0 if chain is None else len(links), width, guarded]
    first_numbers = np.cumsum([0, *(t.size for t in tables)])
    first_integers = d.At.END + np.cumsum([0, *(t.size for t in integers)])
    header = [*counts, first_slip, *first_numbers[:-1], *first_integers[:-1]]
    at = np.concatenate([np.array(header, dtype=np.int64), *integers])
    return np.concatenate([t.ravel() for t in tables]), at, first_slip + len(slips)


def _torques(links: Sequence[Link | None], motors: Sequence[MotorSlot]) -> Iterator[tuple[int, BodyTorque, float]]:
    """Yield the torques of effects: the degree of freedom each acts on, itself, and the gear ratio it is behind."""
    for j, link in enumerate(links):
        for torque in () if link is None else link.torques:
            yield j, torque, 1.0
    for m in motors:
        for torque in m.motor.torques:
            yield m.index, torque, m.motor.gear_ratio


def _numbered(flags: NDArray[np.bool_], first: int) -> NDArray[np.int64]:
    """Number the flagged elements from `first` on; −1 for the rest."""
    return np.where(flags, first + np.cumsum(flags) - 1, -1).astype(np.int64)


def _motors(name: str, joint: Movable) -> list[MotorSlot]:
    if isinstance(joint, AntagonisticJoint):
        named = [("motor_torque_1", "motor_1", joint.motor_1), ("motor_torque_2", "motor_2", joint.motor_2)]
    else:
        named = [("motor_torque", "motor", joint.motor)]
    if isinstance(joint, SerialJoint):
        if joint.secondary_motor is None or joint.lever is None:
            raise SimulationError(
                f"joint '{name}': a serial joint is simulated with a secondary motor and a lever only"
            )
        named.append(("secondary_torque", "secondary_motor", joint.secondary_motor))
    for _, key, motor in named:
        if motor.inertia is None and not (isinstance(joint, RigidJoint) and joint.link is not None):
            raise SimulationError(f"joint '{name}': {key} has no inertia: give '{key}.inertia' in the rig")
    return [MotorSlot(name, role, key, motor.reflected, 0) for role, key, motor in named]


def _transmissions(name: str, joint: Movable) -> list[tuple[str, KnownTransmission]]:
    if isinstance(joint, RigidJoint):
        return []
    if isinstance(joint, AntagonisticJoint):
        named = [("_1", joint.transmission_1), ("_2", joint.transmission_2)]
    else:
        named = [("", joint.transmission)]
    known: list[tuple[str, KnownTransmission]] = []
    for suffix, transmission in named:
        if isinstance(transmission, UnknownTransmission):
            raise SimulationError(
                f"joint '{name}': a transmission of unknown type cannot be simulated: give transmission{suffix}.type in the rig"
            )
        if isinstance(joint, SerialJoint) and not isinstance(transmission, AwasTransmission):
            raise SimulationError(f"joint '{name}': a serial joint is simulated with an 'awas' transmission only")
        known.append((suffix, transmission))
    return known


def _moved_link(name: str, joint: Movable) -> Link:
    if isinstance(joint, RigidJoint):
        return as_one(joint.motor, joint.link)
    if joint.link is None:
        raise SimulationError(f"joint '{name}' has no link to move: give 'link.inertia' in the rig")
    return joint.link


def _gravity(link: Link) -> tuple[float, float]:
    return link_weight(link), link.gravity_angle


def _least_inertia(chain: Chain) -> Array:
    """Return the least inertia that a torque on one link of a chain accelerates, 1 / (M⁻¹)_ii, in many positions.

    Payloads are left out: they only increase it.
    """
    count = len(chain.link)
    # As many positions as show its extremes.
    positions = np.vstack([np.zeros(count), np.random.default_rng(0).uniform(-np.pi, np.pi, (50, count))])
    yielding = [np.diag(np.linalg.pinv(mass_matrix(chain, q), hermitian=True)) for q in positions]
    return np.asarray(1.0 / np.maximum(np.max(yielding, axis=0), 1e-300))


def _friction(damping: float, f: Friction) -> tuple[float, ...]:
    bristle = f.presliding_stiffness or 0.0
    return damping, f.coulomb, f.breakaway, f.stribeck_velocity or 1.0, f.load, bristle, f.presliding_damping


def _coupling(chain: Chain | None, joints: Sequence[str], motors: Sequence[MotorSlot], n: int) -> Array:
    S = np.zeros((n, n))
    for c in chain.coupling if chain is not None else ():
        motor = next(m.index for m in motors if m.joint == c.motor and m.role != "secondary_torque")
        link = joints.index(c.link)
        S[link, motor] = S[motor, link] = c.inertia
    return S
