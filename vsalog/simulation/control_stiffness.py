"""Stiffness control on an estimate: the motors of a joint make the link's position and the joint's stiffness follow references.

A feed-forward finds the set-point by the rig's springs: with m the deflection that holds the link's weight and p the
co-contraction (the secondary motor's angle of a serial joint), σ(m, p) = σ_d. What the springs truly are need not be known: the
stiffness that an estimator finds comes back (Flacco 2012 §9), and an integral corrects the factor by which it differs:

    σ(m, p) = σ_d exp I,   İ = ω ln(σ_m / σ̂),

with σ_m the reference as it arrives behind the motors' position loops. With the springs' own inverse before it the loop has the
same speed ω wherever the stiffness is, and a spring that is softer everywhere by the same part is one number to be found.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vsalog.core.errors import SimulationError
from vsalog.core.live_estimator import Said
from vsalog.core.recording import Recording
from vsalog.effects.gravity import holding_torque
from vsalog.mechanics.links import link_weight
from vsalog.mechanics.transmissions import torque_and_stiffness
from vsalog.rig.parts import Lever, Motor, Transmission
from vsalog.rig.schema import AntagonisticJoint, Joint, RigFile, SerialJoint
from vsalog.simulation.control import StiffnessControl
from vsalog.simulation.control_loop import EstimatorFactory, Truth, made
from vsalog.simulation.inputs import Servo, at_samples, loop_gains

Array = NDArray[np.float64]

NO_FEEDBACK, TRUE_FEEDBACK = "none", "truth"


class Search(NamedTuple):
    """How set-points are looked up.

    Attributes
    ----------
    points : of the table of stiffness over set-point [1]: to a thousandth of its range
    above : the stiffest that is in it, over the stiffest reference [1]: springs may be as much softer than in the rig
    shortest : lever arm in it, over the longest [1]
    steps : of the iteration for the deflection under the link's weight [1], each of which about halves the error
    last_steps : of it in a sample, which begins with the result of the one before [1]
    """

    points: int = 1000
    above: float = 3.0
    shortest: float = 0.02
    steps: int = 24
    last_steps: int = 3


SEARCH = Search()


class Springs(Protocol):
    """The springs of a joint, as the rig has them, over the mean deflection m and the set-point p."""

    def at(self, m: Array, p: Array) -> tuple[Array, Array]:
        """Return torque on the link [N·m] and stiffness [N·m/rad] of the device."""
        ...

    def motors(self, q: Array, m: Array, p: Array) -> dict[str, Array]:
        """Return motor's role → position reference [rad] with which the link is at q."""
        ...


class Pair:
    """Two motors that pull against each other: their deflections are m − p and m + p."""

    def __init__(self, joint: AntagonisticJoint, loops: Mapping[str, Servo]) -> None:
        self.springs: tuple[Transmission, Transmission] = (joint.transmission_1, joint.transmission_2)
        self.loops = loops

    def at(self, m: Array, p: Array) -> tuple[Array, Array]:
        """Add both up (Flacco 2012 eq. 9, 11)."""
        (t1, s1), (t2, s2) = self._each(m, p)
        return t1 + t2, s1 + s2

    def motors(self, q: Array, m: Array, p: Array) -> dict[str, Array]:
        """Return both, corrected for the position error that the spring's torque makes in each loop."""
        (t1, _), (t2, _) = self._each(m, p)
        return {
            role: q - phi - torque / self.loops[role].stiffness
            for role, phi, torque in (("motor_torque_1", m - p, t1), ("motor_torque_2", m + p, t2))
        }

    def _each(self, m: Array, p: Array) -> list[tuple[Array, Array]]:
        return [torque_and_stiffness(spring, phi) for spring, phi in zip(self.springs, (m - p, m + p), strict=True)]


class Series:
    """A spring behind one motor, and another motor at θ_c = p that sets its stiffness."""

    def __init__(self, transmission: Transmission, lever: Lever, loops: Mapping[str, Servo]) -> None:
        self.transmission, self.lever, self.loops = transmission, lever, loops

    def at(self, m: Array, p: Array) -> tuple[Array, Array]:
        """Evaluate the spring at the lever arm (Flacco 2012 eq. 51)."""
        return torque_and_stiffness(self.transmission, m, self.lever.arm(p))

    def motors(self, q: Array, m: Array, p: Array) -> dict[str, Array]:
        """Return both, the primary one corrected for the position error that the spring's torque makes in its loop."""
        torque, _ = self.at(m, p)
        return {"motor_torque": q - m - torque / self.loops["motor_torque"].stiffness, "secondary_torque": p}


class SetPoints(NamedTuple):
    """Set-point over stiffness of the unloaded joint, in the order of the stiffness."""

    stiffness: Array
    setpoint: Array

    def of(self, stiffness: Array) -> Array:
        """Return the set-point that makes a stiffness, at most the last of the table."""
        return np.interp(stiffness, self.stiffness, self.setpoint)


class StiffnessLoop:
    """The controller of one joint.

    Parameters
    ----------
    rig, name : the nominal rig, and the joint in it
    control : as asked for
    time : shape (N,), uniform [s]
    estimator : makes what the controller reads

    Raises
    ------
    SimulationError
        The joint's stiffness cannot be set, or the rig lacks what the controller needs.
    """

    def __init__(
        self, rig: RigFile, name: str, control: StiffnessControl, time: Array, estimator: EstimatorFactory | None = None
    ) -> None:
        joint = rig.joint[name]
        self.name, self.control, self.period = name, control, float(time[1] - time[0])
        motors = _motors(name, joint)
        self.commands = {role: self._loop(motor, time) for role, motor in motors.items()}
        self.springs = _springs(name, joint, self.commands)
        self.position, self.wanted = at_samples(control.position, time), at_samples(control.reference, time)
        if not (np.all(self.wanted >= 0.0) and np.any(self.wanted > 0.0)):
            raise SimulationError(f"joint '{name}': the reference of its stiffness has to be above zero")
        self.table = _table(name, joint, self.springs, float(self.wanted.max()))
        self.load = self._weight(rig, joint)
        last = list(motors)[-1]  # that sets the stiffness, in a pair as fast as the first
        self.arriving = _arriving(self.wanted, motors[last], self.commands[last], self.period)
        self.integral = 0.0
        unloaded = np.zeros(time.size), np.ones(time.size)
        self._command(slice(None), self.wanted, unloaded, SEARCH.steps)
        self.begin = unloaded[0][:1], unloaded[1][:1]
        feedback = control.feedback
        unwatched = feedback in (NO_FEEDBACK, TRUE_FEEDBACK)
        self.watcher = None if unwatched else made(estimator, rig, name, feedback, control.tune)
        self.reads: Mapping[str, Collection[str]] = {} if self.watcher is None else self.watcher.reads

    def prepare(self, dry: Recording) -> None:
        """Look at a run that is driven by the feed-forward alone."""
        if self.watcher is not None:
            self.watcher.prepare(dry)

    def act(self, k: int, readings: Said, truth: Truth) -> None:
        """Write the references of the motors' loops for sample k + 1."""
        found = self._found(k, readings, truth)
        if k + 1 >= self.wanted.size or self.control.feedback == NO_FEEDBACK:
            return
        low, high = self.table.stiffness[[0, -1]]
        if found > 0.0 and self.arriving[k] > low:
            change = self.control.bandwidth * self.period * float(np.log(self.arriving[k] / found))
            asked = self.wanted[k] * np.exp(self.integral)
            if (low < asked or change > 0.0) and (asked < high or change < 0.0):  # at an end the integral stops
                self.integral += change
        following = slice(k + 1, k + 2)
        self._command(following, self.wanted[following] * np.exp(self.integral), self.begin, SEARCH.last_steps)

    def _found(self, k: int, readings: Said, truth: Truth) -> float:
        """Return the stiffness that is fed back; NaN where the estimate is not excited."""
        if self.control.feedback == TRUE_FEEDBACK:
            own = truth[self.name]
            return float(own.get("stiffness_total", own.get("stiffness", np.array([np.nan])))[0])
        if self.watcher is None:
            return np.nan
        read = self.watcher.take(k, readings)
        return read.get("stiffness", np.nan) if read.get("excited") else np.nan

    def _command(self, part: slice, stiffness: Array, begin: tuple[Array, Array], steps: int) -> None:
        """Write the references of the motors' loops for a part of the samples.

        Parameters
        ----------
        part : of the samples
        stiffness : reference for the nominal springs
        begin : deflection m, and the stiffness of the unloaded joint as a part of it, to begin with
        steps : of the iteration
        """
        load, (m, share), ends = self.load[part], begin, self.table.stiffness[[0, -1]]
        wanted = np.clip(stiffness, *ends)
        for _ in range(steps):
            p = self.table.of(wanted * share)
            torque, found = self.springs.at(m, p)
            # A reference beyond the ends does not grow from step to step.
            nearer, same = m - (torque + load) / found, np.clip(wanted * share * wanted / found, *ends) / wanted
            known = np.isfinite(nearer) & np.isfinite(same)
            m, share = np.where(known, nearer, m), np.where(known, same, share)
        self.begin = m[-1:], share[-1:]
        p = self.table.of(wanted * share)
        for role, where in self.springs.motors(self.position[part], m, p).items():
            np.asarray(self.commands[role].reference)[part, 0] = where

    def _loop(self, motor: Motor, time: Array) -> Servo:
        """Return the position loop of a motor, whose reference is written sample by sample."""
        if motor.inertia is None:
            raise SimulationError(f"joint '{self.name}': stiffness_control needs the inertia of every motor in the rig")
        gains = loop_gains(motor, 0.0, self.control.frequency, 0.0, self.period)
        return Servo(np.zeros((time.size, 2)), *gains, self.control.limit)

    def _weight(self, rig: RigFile, joint: Joint) -> Array:
        """Return the torque that holds the link where it is to be, shape (N,) [N·m]; zero in an arm, whose springs give way."""
        link = getattr(joint, "link", None)
        if link is None or (rig.chain is not None and self.name in [part.joint for part in rig.chain.link]):
            return np.zeros_like(self.position)
        return np.asarray(holding_torque(link_weight(link), link.gravity_angle, self.position))


def _motors(name: str, joint: Joint) -> dict[str, Motor]:
    """Return role → motor on the joint's side, the one that sets the stiffness last."""
    if isinstance(joint, AntagonisticJoint):
        return {"motor_torque_1": joint.motor_1.reflected, "motor_torque_2": joint.motor_2.reflected}
    if isinstance(joint, SerialJoint) and joint.secondary_motor is not None:
        return {"motor_torque": joint.motor.reflected, "secondary_torque": joint.secondary_motor.reflected}
    raise SimulationError(
        f"joint '{name}': stiffness_control is for joints whose stiffness motors set: an antagonistic one, or a serial one with a"
        " secondary_motor"
    )


def _springs(name: str, joint: Joint, loops: Mapping[str, Servo]) -> Springs:
    if isinstance(joint, AntagonisticJoint):
        return Pair(joint, loops)
    assert isinstance(joint, SerialJoint)
    if joint.lever is None or joint.lever.travel == 0.0:
        raise SimulationError(f"joint '{name}': stiffness_control needs the travel of the lever: give 'lever.travel'")
    return Series(joint.transmission, joint.lever, loops)


def _table(name: str, joint: Joint, springs: Springs, stiffest: float) -> SetPoints:
    """Return the stiffness of the unloaded joint over the set-points that may be taken, as far as it rises or falls with them."""
    if isinstance(joint, SerialJoint):
        assert joint.lever is not None
        p = np.linspace(0.0, (1.0 - SEARCH.shortest) * joint.lever.start / joint.lever.travel, SEARCH.points)[::-1]
        sigma = springs.at(np.zeros_like(p), p)[1]
    else:
        end, softest = np.pi, float(springs.at(np.zeros(1), np.zeros(1))[1][0])
        most = SEARCH.above * max(stiffest, softest)
        while True:
            p = np.linspace(0.0, end, SEARCH.points)
            with np.errstate(over="ignore", invalid="ignore"):
                sigma = springs.at(np.zeros_like(p), p)[1]
            inside = np.isfinite(sigma) & (sigma < most)
            count = int(np.argmin(inside)) if not inside.all() else p.size
            if count > p.size // 2 or count < 2:
                break
            end = float(p[count])
        p, sigma = p[:count], sigma[:count]
    rising = np.flatnonzero(~(np.diff(sigma) > 0.0))
    # A spring that is hardened no more, or is linear from the beginning.
    last = int(rising[0]) + 1 if rising.size else sigma.size
    p, sigma = p[:last], sigma[:last]
    if sigma.size < 2 or not sigma[0] <= stiffest <= sigma[-1]:
        span = f"{sigma[0]:.4g} to {sigma[-1]:.4g}" if sigma.size else "none"
        raise SimulationError(
            f"joint '{name}': by its rig its motors can set a stiffness of {span} N·m/rad, and up to {stiffest:.4g} N·m/rad is"
            " asked for"
        )
    return SetPoints(sigma, p)


def _arriving(wanted: Array, motor: Motor, loop: Servo, period: float) -> Array:
    """Return a reference as it arrives behind a motor's loop, K_p / (B s² + (D + K_d) s + K_p), held between samples."""
    from scipy.signal import cont2discrete, lfilter, lfilter_zi

    lower = np.array([motor.inertia or 0.0, motor.damping + loop.damping, loop.stiffness])
    upper, held, _ = cont2discrete((lower[-1:], lower), period)
    upper = np.ravel(upper)
    found, _ = lfilter(upper, held, wanted, zi=lfilter_zi(upper, held) * wanted[0])
    return np.asarray(found)
