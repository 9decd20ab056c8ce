"""acceleration-observer: the whole state of an elastic joint from motor position, motor torque and accelerations of the links.

De Luca, Schröder, Thümmel (ICRA 2007): eq. 6 with the link acceleration measured, eq. 7 with inertial coupling between motors and
links, eq. 12 from accelerometers on the links of an arm. No link encoder, and nothing of the links' masses is needed.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from vsalog.core.errors import EstimatorError
from vsalog.core.finding import Finding
from vsalog.core.resolution import sensor_noise
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimators.acceleration_group import NAME, Group, group_of
from vsalog.estimators.accelerometer_check import accelerometer_findings
from vsalog.estimators.device import PLACES, Device, largest
from vsalog.estimators.equation import NEGLIGIBLE_SHARE
from vsalog.estimators.friction_compensation import FrictionCompensation, FrictionCompensationState, extended
from vsalog.estimators.state_observer import StateObserver, Unfiltered, UnfilteredTuning, state_columns
from vsalog.estimators.tuning import Positive
from vsalog.estimators.windows import rms
from vsalog.filters.acceleration_arm import Arm, ArmState, Since, arm_start, axis_rows, observe_arm
from vsalog.filters.acceleration_observer import (
    ElasticMotor,
    Input,
    SampledObserver,
    State,
    characteristic,
    error_powers,
    error_variances,
    observer_gains,
    sampled_observer,
)
from vsalog.uncertainty.sensor_error import ENOUGH, LEAST_NOISE, sensor_error

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

SUMMARY = "positions, velocities and torque from motor position and link accelerations, no link encoder (De Luca 2007)"
# The paper's bandwidth [rad/s], and the most that an observer may turn in a sample [rad].
PAPER_FREQUENCY, TURN_PER_SAMPLE = 250.0, 0.5
# The observer is as fast as the paper's, unless the noise of the deflection is smaller by this factor with a slower one [1].
NOISE_WORTH = 1.5
# A deflection is plausible up to this multiple of that of the motor's largest torque and the observer's noise together [1]:
# springs overshoot.
LARGEST_OVERSHOOT = 5.0


class AccelerationTuning(UnfilteredTuning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning of acceleration-observer.

    Attributes
    ----------
    frequency : ω of all four eigenvalues [rad/s]; when absent the paper's 250, or less where the sample time or noise ask for it
    damping : ζ of the eigenvalues, at most 1
    torque : ``held`` where a sample of the motor's torque holds until the next, as a digital drive's does; else ``linear``
    reach : least arm between a joint's axis and the accelerometers at which the joint's acceleration is used [m]
    """

    frequency: Positive | None = None
    damping: Annotated[float, Meta(gt=0.0, le=1.0)] = 1.0
    torque: Literal["held", "linear"] = "held"
    reach: Positive = 0.05


TUNING = AccelerationTuning


def printed(device: Device) -> Mapping[str, str]:
    """Return the tuning that the paper prints: "well damped eigenvalues with angular frequencies around 250 rad/s" (§V)."""
    return {"frequency": f"{PAPER_FREQUENCY:g}"}


def roles(device: Device, offered: Collection[str], tuning: AccelerationTuning) -> tuple[str, ...]:
    """Return the roles the method reads, those of other joints as ``JOINT/ROLE``; raises EstimatorError for a missing one."""
    return group_of(device, offered).roles


def build(device: Device, signals: JointSignals, tuning: AccelerationTuning) -> AccelerationFold:
    """Assemble the estimator for a joint's signals.

    Raises
    ------
    EstimatorError
        A signal has no value, or the frequency is too high for the sample time.
    """
    return AccelerationFold(device, group_of(device, signals.roles), signals, tuning)


@dataclass(frozen=True, slots=True)
class AccelerationState:
    """State of the fold: the observers, the motors' friction, samples seen, those without an estimate, and how often the
    observers have diverged.
    """

    observers: ArmState
    friction: FrictionCompensationState | None
    seen: int = 0
    masked: int = 0
    lost: int = 0


class AccelerationFold(StateObserver):
    """The observers of a joint and of those it has to be looked at with, as a fold that gives the joint's trace."""

    name, modality = NAME, "STATES"
    conditioner = Unfiltered()

    def __init__(self, device: Device, group: Group, signals: JointSignals, tuning: AccelerationTuning) -> None:
        self.device, self.group, self.tuning, self.period = device, group, tuning, signals.period
        self.noise = {role: _noise(device, signals, role) for role in group.roles}
        rubbing = tuple(m.view for m in group.members if extended(m.view.motor))
        self.friction = FrictionCompensation(rubbing, signals, "kinematic", tuning.shape) if rubbing else None
        plain = self._plain_arm()
        usual = self._usual_deviation(plain, signals)
        self.frequencies = [self._frequency(i, float(usual[i])) for i in range(len(group.members))]
        self.arm = self._with_observers(plain)._replace(farthest=self._farthest(usual, signals))
        self.variances = self._variances(signals)
        self.noticed = (*self._noisy(usual, signals), *accelerometer_findings(plain, group, signals))

    @property
    def derived(self) -> dict[str, float]:
        """The observer's frequency, and the noise that was estimated from the log."""
        own = self.group.members[self.group.place]
        return {
            "frequency": self.frequencies[self.group.place],
            "noise_motor_position": self.noise[own.view.motor_position],
            "noise_motor_torque": self.noise[own.view.motor_torque],
            "noise_acceleration": self.arm.unit_noise,
        }

    def start(self) -> AccelerationState:
        """Return the state before the first sample."""
        return AccelerationState(
            arm_start(len(self.group.members)), None if self.friction is None else self.friction.start()
        )

    def step(self, state: AccelerationState, block: JointSignals) -> tuple[AccelerationState, list[Trace]]:
        """Take a block of samples; give the new state and their trace."""
        friction, blocks = state.friction, [block]
        if self.friction is not None:
            friction, blocks = self.friction.step(friction or self.friction.start(), block)
        observers, seen, masked, lost, traces = state.observers, state.seen, state.masked, state.lost, []
        for piece in (piece for part in blocks for piece in part.between_gaps()):
            if piece.starts[0]:
                observers = arm_start(len(self.group.members))
            x, acceleration, deviation, since, observers = observe_arm(self.arm, observers, *self.inputs(piece))
            columns = self._estimates(x[:, self.group.place], acceleration, deviation, since[:, self.group.place])
            traces.append(Trace.of_rows(piece, {"total": columns}))
            seen += len(piece)
            masked += int(np.count_nonzero(since[:, self.group.place] < 0))
            lost += int(np.count_nonzero(since[:, self.group.place] == Since.LOST))
        return AccelerationState(observers, friction, seen, masked, lost), traces

    def findings(self, state: AccelerationState) -> tuple[Finding, ...]:
        """Return where the accelerations do not determine this joint's, and that the observers diverged."""
        found, joint = list(self.noticed), self.device.joint
        if state.masked > NEGLIGIBLE_SHARE * state.seen:
            found.append(
                Finding(
                    code="acceleration.masked",
                    joint=joint,
                    severity="info",
                    value=state.masked / state.seen,
                    limit=NEGLIGIBLE_SHARE,
                    evidence={"reach": self.tuning.reach},
                )
            )
        if state.lost:
            found.append(Finding(code="observer.diverged", joint=joint, value=float(state.lost), limit=0.0))
        return tuple(found)

    def _estimates(self, x: Array, acceleration: Array, deviation: Array, since: Integers) -> Mapping[str, Any]:
        """Return the columns of the trace; NaN where an input of the observer is missing."""
        place, known = self.group.place, since >= 0
        std = self._deviations(deviation, since)
        K, nothing = self.group.members[place].motor.K, np.full(len(x), np.nan)
        phi = x[:, State.LINK_POSITION] - x[:, State.MOTOR_POSITION]
        # The stiffness is the rig's, for users who need the model along with the state: the log does not determine its accuracy.
        columns = state_columns(phi, K * phi, np.full(len(x), K), nothing, np.zeros(len(x), dtype=np.bool_))
        excited = columns.pop("excited")
        columns |= {"deflection_std": std[:, 4], "flexibility_torque_std": K * std[:, 4]}
        states = (
            ("link_position", State.LINK_POSITION),
            ("link_velocity", State.LINK_VELOCITY),
            ("motor_position", State.MOTOR_POSITION),
            ("motor_velocity", State.MOTOR_VELOCITY),
        )
        for name, i in states:
            columns |= {name: x[:, i], f"{name}_std": std[:, i]}
        shown = {name: np.where(known, values, np.nan) for name, values in columns.items()}
        # The acceleration's uncertainty is reported even where the rest is not.
        shown |= {"link_acceleration": np.where(known, acceleration[:, place], np.nan)}
        shown |= {"link_acceleration_std": deviation[:, place]}
        return shown | {"excited": excited}

    def _deviations(self, deviation: Array, since: Integers) -> Array:
        """Return the standard deviations of θ, q, θ̇, q̇ and q − θ, shape (n, 5): noise through the observer, and its start.

        The arms change slowly compared with the observer, so its stationary error goes with the present noise of q̈.
        """
        place, own = self.group.place, self.group.members[self.group.place].view
        table = self.variances[np.clip(since, 0, len(self.variances) - 1)]
        accelerations = deviation**2
        carried = accelerations @ self.group.coupling[:, place] ** 2
        encoder, torque, once = (
            np.full(len(since), variance)
            for variance in (self.noise[own.motor_position] ** 2, self.noise[own.motor_torque] ** 2, 1.0)
        )
        weights = np.stack((encoder, torque, accelerations[:, place], carried, once), axis=-1)
        return np.asarray(np.sqrt(np.einsum("ns,nsi->ni", weights, table)))

    def _noisy(self, usual: Array, signals: JointSignals) -> tuple[Finding, ...]:
        """Find a deflection that is noise; an observer that is made so by its tuning is refused.

        Raises
        ------
        EstimatorError
            The frequency that was asked for is so low that the deflection's noise is larger than the motor's torque deflects the
            joint.
        """
        own, settled = self.group.members[self.group.place], np.array([len(self.variances) - 1])
        noise = float(self._deviations(usual[None], settled)[0, 4])
        most = largest(signals.roles[own.view.motor_torque]) / own.motor.K
        if noise <= most:
            return ()
        if self.tuning.frequency is not None:
            frequency = self.frequencies[self.group.place]
            raise EstimatorError(
                f"joint '{self.device.joint}': an observer of {frequency:.4g} rad/s would have a noise of {noise:.2g} rad in"
                f" the deflection, which the motor's torque never makes larger than {most:.2g} rad; ask for a higher frequency,"
                " or leave it out"
            )
        return (
            Finding(
                code="deflection.below_noise",
                joint=self.device.joint,
                severity="invalidates",
                value=noise,
                limit=float(most),
                unit="rad",
            ),
        )

    def _plain_arm(self) -> Arm:
        """Return the arm as the compiled functions read it, still without observers."""
        group, axes = self.group, self.group.axes
        noise = np.array([self.noise[axis.role] for axis in axes])
        return Arm(
            links=np.array([(k.length, k.offset, np.cos(k.twist), np.sin(k.twist), k.angle) for k in group.links]),
            gravity=group.gravity,
            row_link=np.array([axis.place for axis in axes], dtype=np.int64),
            row_direct=np.array([axis.direct for axis in axes], dtype=np.int64),
            row_point=np.array([axis.point for axis in axes]),
            row_axis=np.array([axis.direction for axis in axes]),
            row_noise=noise,
            Phi=np.empty(0),
            before=np.empty(0),
            after=np.empty(0),
            K=np.array([m.motor.K for m in group.members]),
            farthest=np.full(len(group.members), np.inf),
            coupling=group.coupling,
            reach=self.tuning.reach,
            unit_noise=float(noise.max()),
            period=self.period,
        )

    def _with_observers(self, plain: Arm) -> Arm:
        """Return the arm with an observer for each joint."""
        found = [self._observer(m.motor, f) for m, f in zip(self.group.members, self.frequencies, strict=True)]
        Phi, before, after = (np.array(part) for part in zip(*found, strict=True))
        return plain._replace(Phi=Phi, before=before, after=after)

    def _farthest(self, usual: Array, signals: JointSignals) -> Array:
        """Return the deflection of each joint beyond which its observer has diverged [rad]."""
        found = []
        for i, member in enumerate(self.group.members):
            noise = self._deflection_variance(i, self.frequencies[i], float(usual[i])) ** 0.5
            found.append(
                LARGEST_OVERSHOOT * (largest(signals.roles[member.view.motor_torque]) / member.motor.K + noise)
            )
        return np.array(found)

    def _deflection_variance(self, i: int, frequency: float, deviation: float) -> float:
        """Return the variance of a joint's deflection behind an observer from its sensors, q̈ having that deviation [rad²]."""
        member = self.group.members[i]
        inputs = np.array([self.noise[member.view.motor_position], self.noise[member.view.motor_torque], deviation])
        observer = self._observer(member.motor, frequency)
        return float(error_variances(observer, np.zeros(4), 1)[-1, :3, 4] @ inputs**2)

    def _observer(self, motor: ElasticMotor, frequency: float) -> SampledObserver:
        gains = observer_gains(motor, characteristic(frequency, self.tuning.damping))
        return sampled_observer(motor, gains, self.period, held=self.tuning.torque == "held")

    def inputs(self, piece: JointSignals) -> tuple[Array, Array, Array]:
        """Return motor positions and torques, shape (n, N), and measured accelerations, shape (n, M)."""
        views = [m.view for m in self.group.members]
        return (
            _columns(piece, [view.motor_position for view in views]),
            _columns(piece, [view.motor_torque for view in views]),
            _columns(piece, [axis.role for axis in self.group.axes]),
        )

    def _usual_deviation(self, arm: Arm, signals: JointSignals) -> Array:
        """Return the median standard deviation of each joint's q̈ along the log, at the motors' positions, shape (N,) [rad/s²]."""
        theta = _columns(signals, [m.view.motor_position for m in self.group.members])
        theta = theta[np.isfinite(theta).all(axis=1)]
        worst = arm.unit_noise / self.tuning.reach
        if not len(theta):
            raise EstimatorError(f"joint '{self.device.joint}': the motors' positions are never known all at once")
        found = []
        for q in theta[np.linspace(0, len(theta) - 1, PLACES).astype(np.int64)]:
            seen = axis_rows(arm, q, np.zeros_like(q))[0] / arm.row_noise[:, None]
            found.append(np.sqrt(np.diag(np.linalg.inv(seen.T @ seen + np.eye(q.size) / worst**2))))
        return np.asarray(np.median(found, axis=0))

    def _frequency(self, i: int, deviation: float) -> float:
        """Return ω of a joint's observer [rad/s]: as asked for, or the fastest that is worth its noise in the deflection."""
        most = TURN_PER_SAMPLE / self.period
        if self.tuning.frequency is not None:
            if self.tuning.frequency > 4.0 * most:
                raise EstimatorError(
                    f"joint '{self.device.joint}': at {1.0 / self.period:.4g} Hz an observer of {self.tuning.frequency:.4g} rad/s"
                    f" would be faster than the samples; ask for at most {4.0 * most:.4g}"
                )
            return self.tuning.frequency
        choices = min(PAPER_FREQUENCY, most) * 0.9 ** np.arange(40)
        noise = np.array([self._deflection_variance(i, float(frequency), deviation) for frequency in choices])
        worth = np.flatnonzero(noise <= NOISE_WORTH**2 * noise.min())
        if not worth.size:
            raise EstimatorError(
                f"joint '{self.device.joint}': with this tuning no observer's noise can be determined; leave out damping and"
                " reach, or bring them nearer to their defaults"
            )
        return float(choices[worth[0]])

    def _variances(self, signals: JointSignals) -> Array:
        """Return the variances of this joint's observer since its start, see `error_variances`."""
        own, frequency = self.group.members[self.group.place], self.frequencies[self.group.place]
        theta, tau = signals.roles[own.view.motor_position], signals.roles[own.view.motor_torque]
        # The joint may have been moving as the log has it, and its spring deflected by any of the log's torques.
        few = max(1, min(round(1.0 / (frequency * self.period)), len(theta) - 1))
        speed = rms((theta[few:] - theta[:-few]) / (few * self.period))
        start = np.array([self.noise[own.view.motor_position], rms(tau) / own.motor.K, speed, speed], dtype=np.float64)
        # Its error falls with 1/(ζ ω) until only rounding is left of the start.
        forgotten = -np.log(np.finfo(np.float64).eps)
        count = int(np.ceil(forgotten / (self.tuning.damping * frequency * self.period))) + 1
        index = self.group.place
        observer = SampledObserver(self.arm.Phi[index], self.arm.before[index], self.arm.after[index])
        table = error_variances(observer, start, min(count, ENOUGH))
        # Quantisation is no white noise where the motion passes the encoder's steps slowly.
        rounding = sensor_error(theta[:ENOUGH], 2 * few + 1).rounding
        if rounding:
            powers = np.mean([error_powers(observer, Input.ENCODER, added) for added in rounding], axis=0)
            white = table[-1, Input.ENCODER] * self.noise[own.view.motor_position] ** 2
            table[:, Input.ENCODER] *= np.fmax(powers / white, 1.0)
        return table


def _noise(device: Device, signals: JointSignals, role: str) -> float:
    finite = signals.roles[role][np.isfinite(signals.roles[role])]
    if finite.size == 0:
        raise EstimatorError(f"joint '{device.joint}': {role} has no value in this log")
    return sensor_noise(finite, signals.resolution.get(role, 0.0), LEAST_NOISE)


def _columns(signals: JointSignals, roles: Collection[str]) -> Array:
    return np.stack([signals.roles[role] for role in roles], axis=-1)
