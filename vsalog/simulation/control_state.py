"""The state controller with feed-forward of De Luca, Schröder, Thümmel (ICRA 2007), eq. 13, on an observer's state or less.

    τ = K_P (x_d − ξ) + τ_d,   x = (θ, q, θ̇, q̇)

with x_d and τ_d from the inverse dynamics of the planned motion of the link, and the gains K_P from the eigenvalues of the joint.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline, make_interp_spline

from vsalog.core.errors import SimulationError
from vsalog.core.live_estimator import Said
from vsalog.core.recording import Recording
from vsalog.effects.drive import commanded_for
from vsalog.effects.gravity import holding_torque
from vsalog.mechanics.links import link_inertia, link_weight
from vsalog.mechanics.rigid_body import inverse_dynamics, mass_matrix
from vsalog.rig.schema import ElasticJoint, LinearTransmission, RigFile
from vsalog.simulation.control import StateFeedback
from vsalog.simulation.control_loop import EstimatorFactory, Truth, made

Array = NDArray[np.float64]

STATES = ("motor_position", "link_position", "motor_velocity", "link_velocity")
FASTER = 1.5
"""How many times as fast as the slowest the other two eigenvalues are, or as the joint's own where that is faster."""


class Plan(NamedTuple):
    """The states and torques of a planned motion of the link: x_d, shape (N, 4), and the motor's torque τ_d, shape (N,)."""

    states: Array
    torque: Array


class StateLoop:
    """The controller of one elastic joint with a linear spring.

    Parameters
    ----------
    rig, name : the nominal rig, and the joint in it
    control : as asked for
    references : joint → planned position, shape (N,), of those of its chain that have one too; others stay at zero
    time : shape (N,), uniform [s]
    estimator : makes what the controller reads, where that is not the truth

    Raises
    ------
    SimulationError
        The joint is of another kind, or the rig lacks what the controller needs.
    """

    def __init__(
        self,
        rig: RigFile,
        name: str,
        control: StateFeedback,
        references: Mapping[str, Array],
        time: Array,
        estimator: EstimatorFactory | None = None,
    ) -> None:
        joint = _known(rig, name)
        self.name, self.control = name, control
        torques, inertia = _link_torque(rig, name, references, time)
        self.plan = planned(joint, references[name], torques, time)
        self.gains = gains(joint, inertia, control.frequency, control.damping)
        self.motor = joint.motor.reflected
        self.commands = {"motor_torque": self._command(self.plan.torque)}
        self.watcher = None
        if control.feedback != "truth":
            self.watcher = made(estimator, rig, name, "acceleration-observer", control.tune)
        self.reads: Mapping[str, Collection[str]] = {} if self.watcher is None else self.watcher.reads

    def prepare(self, dry: Recording) -> None:
        """Look at a run that is driven by the feed-forward alone."""
        if self.watcher is not None:
            self.watcher.prepare(dry)

    def act(self, k: int, readings: Said, truth: Truth) -> None:
        """Command the torque for sample k + 1."""
        wanted = self.plan.states[k]
        if k + 1 >= len(self.plan.torque):
            return
        if self.watcher is None:
            x = np.array([truth[self.name][role][0] for role in STATES])
        else:
            read = self.watcher.take(k, readings)
            x = np.array([read.get(role, np.nan) for role in STATES])
        if self.control.feedback == "motor":
            # The link is taken to be where the motor is, but for the planned torsion.
            x[[1, 3]] = x[[0, 2]] + wanted[[1, 3]] - wanted[[0, 2]]
        error = np.where(np.isfinite(x), wanted - x, 0.0)
        self.commands["motor_torque"][k + 1] = self._command(self.plan.torque[k + 1] + self.gains @ error)

    def _command(self, torque: Any) -> Any:
        """Return what the drive has to be commanded for a torque to act, at most the limit."""
        command = commanded_for(torque, self.motor.torque_gain, self.motor.torque_offset)
        return np.clip(command, -self.control.limit, self.control.limit)


def _known(rig: RigFile, name: str) -> ElasticJoint:
    joint = rig.joint[name]
    if not isinstance(joint, ElasticJoint) or not isinstance(joint.transmission, LinearTransmission):
        raise SimulationError(
            f"joint '{name}': state feedback is for elastic joints with a linear transmission, whose eigenvalues can be placed"
        )
    if joint.motor.inertia is None or joint.link is None:
        raise SimulationError(f"joint '{name}': state feedback needs the motor's inertia and a link")
    return joint


def planned(joint: ElasticJoint, q: Array, torque: Array, time: Array) -> Plan:
    """Return the state and the motor's torque that go with a planned motion of the link, by inverse dynamics.

    The torsion follows from K φ + D φ̇ = −τ, with τ the torque on the link and φ = q − θ, solved exactly for a τ that is straight
    between samples.

    Parameters
    ----------
    joint : elastic, with a linear transmission, on the joint's side
    q : shape (N,), planned position of the link [rad]
    torque : shape (N,), that the link takes for it [N·m]
    time : shape (N,), uniform [s]
    """
    motor, transmission = joint.motor.reflected, joint.transmission
    assert isinstance(transmission, LinearTransmission)
    K, D, period = transmission.stiffness, transmission.damping, float(time[1] - time[0])
    phi = _torsion(-torque, K, D, period)
    spline = make_interp_spline(time, q - phi, k=5)
    theta, dtheta, ddtheta = (np.asarray(spline(time, nu)) for nu in range(3))
    dq = np.asarray(_smooth(time, q)(time, 1))
    tau = (motor.inertia or 0.0) * ddtheta + motor.damping * dtheta + torque
    return Plan(np.stack([theta, q, dtheta, dq], axis=-1), tau)


def _torsion(torque: Array, K: float, D: float, period: float) -> Array:
    """Solve K φ + D φ̇ = τ from rest, with τ straight between samples."""
    from scipy.signal import lfilter

    if D == 0.0:
        return torque / K
    a = np.exp(-K * period / D)
    share = D / (K * period) * (1.0 - a)
    # φ(k+1) = a φ(k) + [(share − a) τ(k) + (1 − share) τ(k+1)] / K
    start = torque[0] / K
    driven = lfilter([(1.0 - share) / K, (share - a) / K], [1.0, -a], torque - torque[0])
    return np.asarray(start + driven)


def gains(joint: ElasticJoint, inertia: float, frequency: float, damping: float) -> Array:
    """Return K_P, shape (4,), of x = (θ, q, θ̇, q̇): two eigenvalues at `frequency` with `damping`, two faster ones.

    Parameters
    ----------
    joint : elastic, with a linear transmission
    inertia : of the link, M [kg·m²]
    frequency, damping : of the slow pair [rad/s]
    """
    from scipy.signal import place_poles

    motor, transmission, link = joint.motor.reflected, joint.transmission, joint.link
    assert isinstance(transmission, LinearTransmission)
    assert link is not None
    K, D, B = transmission.stiffness, transmission.damping, motor.inertia or 0.0
    A = np.array(
        [
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [-K / B, K / B, -(D + motor.damping) / B, D / B],
            [K / inertia, -K / inertia, D / inertia, -(D + link.damping) / inertia],
        ]
    )
    own = float(np.sqrt(K * (1.0 / B + 1.0 / inertia)))
    slow, fast = _pair(frequency, damping), _pair(max(FASTER * frequency, own), damping)
    b = np.array([[0.0], [0.0], [1.0 / B], [0.0]])
    placed = place_poles(A, b, np.concatenate([slow, fast]))
    return np.asarray(placed.gain_matrix.ravel().real)


def _pair(frequency: float, damping: float) -> NDArray[np.complex128]:
    if damping < 1.0:
        turn = frequency * np.sqrt(1.0 - damping**2)
        return np.array([-damping * frequency + 1j * turn, -damping * frequency - 1j * turn])
    # Real ones are distinct: an algorithm that places poles wants them so.
    return np.array([-frequency, -1.02 * frequency], dtype=np.complex128)


def _smooth(time: Array, values: Array) -> BSpline:
    """Return a planned motion as a spline whose second derivative is as smooth as a torque has to be."""
    return make_interp_spline(time, values, k=7)


def _link_torque(rig: RigFile, name: str, references: Mapping[str, Array], time: Array) -> tuple[Array, float]:
    """Return the torque that a joint's link takes along the plan, shape (N,), and its inertia where the plan begins."""
    joint = rig.joint[name]
    link: Any = getattr(joint, "link", None)
    q = references[name]
    spline = _smooth(time, q)
    dq, ddq = (np.asarray(spline(time, nu)) for nu in (1, 2))
    chain = rig.chain
    if chain is None or name not in [part.joint for part in chain.link]:
        inertia = link_inertia(link)
        torque = inertia * ddq + link.damping * dq + holding_torque(link_weight(link), link.gravity_angle, q)
        return np.asarray(torque), inertia
    still = np.zeros(time.size)
    motion = []
    for part in chain.link:
        own = references.get(part.joint, still)
        along = _smooth(time, own)
        motion.append([own, along(time, 1), along(time, 2)])
    x, v, a = (np.stack([m[i] for m in motion], axis=-1) for i in range(3))
    place = [part.joint for part in chain.link].index(name)
    torque = inverse_dynamics(chain, x, v, a)[:, place] + link.damping * dq
    return torque, float(mass_matrix(chain, x[0])[place, place])
