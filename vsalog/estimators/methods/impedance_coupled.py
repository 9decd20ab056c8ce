"""impedance-coupled: stiffness, and inertia and damping of the link, from the external torque on the link.

Serio, Grioli, Sardellitti, Tsagarakis, Bicchi (2011) §III-A, eq. 8–9: a Kalman filter of the link and a stiffness observer, each
fed with the other's estimate. The paper gives it to show what its decoupled observer (`impedance`) avoids; it is for comparison.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, NamedTuple

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from vsalog.core.errors import EstimatorError
from vsalog.core.finding import Finding
from vsalog.core.signals import JointSignals
from vsalog.core.trace import Trace
from vsalog.estimators.averaging_error import AveragingError, averaging_error
from vsalog.estimators.device import Device, deflection_of
from vsalog.estimators.equation import REPORTED_MISFIT, SUPPORTED_SHARE
from vsalog.estimators.needs import require
from vsalog.estimators.observer_fold import FILLED_MEMORY, MEMORIES, ObserverTuning
from vsalog.estimators.screening import screened
from vsalog.estimators.state_observer import Columns, StateObserver, state_columns
from vsalog.estimators.torque_rates import Rates, typical_speed
from vsalog.estimators.transmission_torque import Weight, carried_by, effects_left_in
from vsalog.estimators.windows import KEPT, rates_of, rms, suitable_windows, with_window
from vsalog.filters.coupled_observer import CoupledNoise, CoupledState, coupled_start, observe_coupled
from vsalog.filters.derivative_weights import derivative_weights
from vsalog.filters.derivatives import Derivatives, DerivativesState, Differentiated
from vsalog.filters.savitzky_golay import savgol_filter
from vsalog.uncertainty.errors_in_variables import MOST_NOISE
from vsalog.uncertainty.sensor_error import ENOUGH, sensor_error

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

NAME = "impedance-coupled"
SUMMARY = "stiffness, link inertia and damping in one loop, from a measured push (Serio 2011, §III-A); for comparison"
# Factor of the guessed inertia with which another loop begins [1], without damping: where the two disagree, neither is right.
ANOTHER_GUESS = 2.0
# Derivatives that the loop reads, by role.
ORDERS = {"external_torque": 1, "link_position": 3}


class ImpedanceCoupledTuning(ObserverTuning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning of impedance-coupled.

    Attributes
    ----------
    inertia, damping : initial guesses of I [kg·m²] and N [N·m·s/rad]; the rig's link when absent
    wander : share of the initial guess by which I and N may change within a second
    """

    unused: ClassVar[tuple[str, ...]] = ("shape", "settle")

    degree: Annotated[int, Meta(ge=3, le=30)] = 5
    inertia: Annotated[float, Meta(ge=0.0)] | None = None
    damping: Annotated[float, Meta(ge=0.0)] | None = None
    wander: Annotated[float, Meta(ge=0.0)] = 0.1


TUNING = ImpedanceCoupledTuning
BEFORE_A_RUN = tuple(np.full(4, np.nan))


def roles(device: Device, offered: Collection[str], tuning: ImpedanceCoupledTuning) -> tuple[str, ...]:
    """Return the roles the method reads of what the rig offers; raises EstimatorError for a missing one."""
    if len(device.transmissions) > 1:
        raise EstimatorError(two_transmissions(device))
    needed = [role for view in device.transmissions for role in view.deflection_roles(offered)]
    needed += ["link_position", "external_torque"] if device.transmissions else []
    require(NAME, device, needed, offered)
    return tuple(dict.fromkeys(needed))


def two_transmissions(device: Device) -> str:
    """Return why this method cannot estimate a joint with two transmissions."""
    return (
        f"joint '{device.joint}': {NAME} cannot estimate it: two transmissions drive the link, and its motion determines only"
        " the sum of both"
    )


def build(device: Device, signals: JointSignals, tuning: ImpedanceCoupledTuning) -> ImpedanceCoupledFold:
    """Assemble the estimator for a joint's signals.

    Raises
    ------
    EstimatorError
        Two transmissions drive the link, there is no initial guess of its inertia, nothing pushes it, or the deflection never
        changes.
    """
    return ImpedanceCoupledFold(device, signals, tuning)


class Motion(NamedTuple):
    """What the loop reads, shape (N,) each: f = τ̇_ext − ġ [N·m/s], q⃛ [rad/s³], q̈ [rad/s²], φ̇ [rad/s]."""

    f: Array
    jerk: Array
    acceleration: Array
    deflection: Array

    @property
    def use(self) -> Flags:
        """Where all is known, shape (N,)."""
        return np.asarray(np.isfinite(np.stack(self)).all(axis=0))


@dataclass(slots=True)
class ImpedanceCoupledState:
    """State of the fold: of the filters, of the loop, of one twice as fast and of one that began elsewhere, and the differenced
    values of the last sample.
    """

    filters: DerivativesState
    loops: tuple[CoupledState, ...]
    last: tuple[float, ...] = BEFORE_A_RUN


class ImpedanceCoupledFold(StateObserver):
    """The loop as an estimator: a fold over blocks of signals that gives a trace."""

    name, modality = NAME, "EXTERNAL"

    def __init__(self, device: Device, signals: JointSignals, tuning: ImpedanceCoupledTuning) -> None:
        self.device, self.period = device, signals.period
        if len(device.transmissions) != 1:
            raise EstimatorError(two_transmissions(device))
        (self.view,) = device.transmissions
        self.guess, self.weight = self._guess(tuning)
        push = signals.roles["external_torque"]
        if not np.isfinite(push).any() or np.nanmax(push) == np.nanmin(push):
            raise EstimatorError(
                f"joint '{device.joint}': external_torque never changes, and without a push whose size is known nothing separates"
                f" inertia, damping and stiffness from any multiple of all three; {NAME} cannot begin"
            )
        self.look = screened(device, signals, tuning)
        tuning = with_window(tuning, signals, quiet_window(device, signals, tuning))
        orders = dict.fromkeys(self.view.deflection_roles(signals.roles), 1) | ORDERS
        self.conditioner = Derivatives(orders, signals.period, tuning.window_for(signals), tuning.degree)
        self.difference = tuning.derivative == "difference"
        whole = self.conditioner.whole(signals)
        motion, _ = self._motion(whole, BEFORE_A_RUN)
        known = Motion(*(v[motion.use] for v in motion))
        speed = typical_speed(device, [Rates(known.f, known.deflection)])
        # Samples within a filter's window count as one.
        rate = unexplained(known) * self.conditioner.window**0.5
        sizes = [float(np.sqrt(np.mean(v**2))) for v in (known.jerk, known.acceleration, known.deflection)]
        # Neither noise nor a guess is nothing.
        least = float(np.finfo(np.float64).eps)
        inertia = max(self.guess[0], least)
        # A damping may be guessed to be none: it is then as uncertain as one with the effect of the inertia.
        damping = self.guess[1] or inertia * sizes[0] / sizes[1]
        self.noise = CoupledNoise(max(rate, least), inertia, damping, tuning.wander, FILLED_MEMORY)
        self.alpha = tuning.alpha if tuning.alpha is not None else self._best_alpha(known, speed)
        self.average = self._average_of(signals, self._deflection(whole)[motion.use], known)
        # The spring's deviation from its average biases the link's estimates, as far as φ̇ correlates with q⃛ or q̈.
        self.shares = sizes[2] / np.array(sizes[:2])
        self.noisy = self._noisy(signals, sizes)

    @property
    def derived(self) -> dict[str, float]:
        """What was derived from the log."""
        window = (self.conditioner.window - 1) * self.period
        return {
            "alpha": self.alpha, "alike": self.average.alike, "within": self.average.within, "window": window,
            "inertia": self.guess[0], "damping": self.guess[1], "noise_rate": self.noise.rate,
        }  # fmt: skip

    def start(self) -> ImpedanceCoupledState:
        """Return the state before the first sample."""
        return ImpedanceCoupledState(self.conditioner.start(), self._loops())

    def step(self, state: ImpedanceCoupledState, block: JointSignals) -> tuple[ImpedanceCoupledState, list[Trace]]:
        """Take a block of samples; give the new state and the trace of the rows that are ready."""
        return self._follow(state, *self.conditioner.step(state.filters, block))

    def finish(self, state: ImpedanceCoupledState) -> tuple[ImpedanceCoupledState, list[Trace]]:
        """Give out the rows that are still held back."""
        return self._follow(state, *self.conditioner.finish(state.filters))

    def findings(self, state: ImpedanceCoupledState) -> tuple[Finding, ...]:
        """Return, among others, whether the loop depends on what it began with."""
        found = [*self.look.findings, *effects_left_in(NAME, self.device)]
        inertia, other = float(state.loops[0].link[0]), float(state.loops[2].link[0])
        limit = 0.5 * SUPPORTED_SHARE * max(inertia, 0.0)
        if inertia <= 0.0 or abs(inertia - other) > limit:
            found.append(
                Finding(
                    code="link.guess_matters",
                    joint=self.device.joint,
                    value=abs(inertia - other),
                    limit=limit,
                    unit="kg*m^2",
                    evidence={
                        "guess": self.guess[0],
                        "inertia": inertia,
                        "factor": ANOTHER_GUESS,
                        "other_inertia": other,
                    },
                )
            )
        return tuple(found)

    def _guess(self, tuning: ImpedanceCoupledTuning) -> tuple[tuple[float, float], Weight | None]:
        """Return the initial guess of I and N, and the link's weight."""
        link = self.device.link
        inertia, weight = carried_by(link) if link is not None else (None, None)
        inertia = tuning.inertia if tuning.inertia is not None else inertia
        if inertia is None:
            raise EstimatorError(
                f"joint '{self.device.joint}': {NAME} begins with a guess of the link's inertia: set"
                f" [joint.{self.device.joint}.link] inertia in the rig, or give --tune inertia=KG_M2"
            )
        damping = tuning.damping if tuning.damping is not None else link.damping if link is not None else 0.0
        return (inertia, damping), weight

    def _loops(self) -> tuple[CoupledState, ...]:
        first = coupled_start(*self.guess, self.noise)
        return first, first, coupled_start(ANOTHER_GUESS * self.guess[0], 0.0, self.noise)

    def _follow(
        self, state: ImpedanceCoupledState, filters: DerivativesState, ready: list[Differentiated]
    ) -> tuple[ImpedanceCoupledState, list[Trace]]:
        loops, last, traces = state.loops, state.last, []
        for part in ready:
            if len(part.rows) and part.rows.starts[0]:
                last = BEFORE_A_RUN
            motion, last = self._motion(part, last)
            loops, own = self._columns(loops, motion, part)
            name = self.view.name
            traces.append(Trace.of_rows(part.rows, {name: {c: own[c] for c in own if "link" not in c}, "total": own}))
        return ImpedanceCoupledState(filters, loops, last), traces

    def _columns(
        self, loops: tuple[CoupledState, ...], motion: Motion, part: Differentiated
    ) -> tuple[tuple[CoupledState, ...], Columns]:
        gains = (self.alpha, 2.0 * self.alpha, self.alpha)
        (here, link, slow), (quick, _, fast), (elsewhere, other, far) = (
            observe_coupled(loop, *motion, motion.use, gain, self.period, self.noise)
            for loop, gain in zip(loops, gains, strict=True)
        )
        K, deviation, learnt = here.T
        late, apart = quick[:, 0] - K, elsewhere[:, 0] - K
        # An observer is late and averages over whole swings; an estimate that depends on the guess is as uncertain as the guess,
        # and the link's inertia is uncertain by what may be the spring's.
        doubt = link[:, 2] / self.shares[0]
        # The bias of I, N and K by noise in q⃛, q̈ and φ̇ may each be K's.
        biased = np.hypot(self.noisy[2] * K, np.linalg.norm(self.noisy[:2] * link[:, :2] / self.shares, axis=1))
        phi = self._deflection(part)
        biases = late**2 + apart**2 + doubt**2 + biased**2 + self.average.square(phi)
        std = np.sqrt(deviation**2 * self.average.alike + biases)
        taken = link[:, 0] * part.of["link_position"][2] + link[:, 1] * part.of["link_position"][1]
        torque = part.of["external_torque"][0] - self._weighs(part) - taken
        known = bool(np.all(self.noisy < MOST_NOISE**2)) and not self.look.blind
        supported = motion.use & (learnt >= FILLED_MEMORY) & (link[:, 0] > 0.0) & known
        spread = np.sqrt(
            link[:, 2:] ** 2
            + (other[:, :2] - link[:, :2]) ** 2
            + (self.average.within * self.shares) ** 2
            + (biased[:, None] * self.shares) ** 2
        )
        own = state_columns(phi, torque, K, std, supported)
        # Neither is known without the other.
        found = np.where(own["excited"], 1.0, np.nan)
        return (slow, fast, far), {
            **own,
            "link_inertia": found * link[:, 0],
            "link_inertia_std": found * spread[:, 0],
            "link_damping": found * link[:, 1],
            "link_damping_std": found * spread[:, 1],
        }

    def _motion(self, part: Differentiated, last: tuple[float, ...]) -> tuple[Motion, tuple[float, ...]]:
        """Return what the loop reads of a block, from the last sample before it, and its own last sample."""
        q, push = part.of["link_position"], part.of["external_torque"]
        phi, phi_dot = (deflection_of({r: v[n] for r, v in part.of.items()}, self.view) for n in (0, 1))
        if self.difference:
            values = (push[0] - self._weighs(part), q[2], q[1], phi)
            rates = (np.diff(v, prepend=before) / self.period for v, before in zip(values, last, strict=True))
            return Motion(*rates), tuple(float(v[-1]) for v in values) if len(part.rows) else last
        pulled = 0.0 if self.weight is None else self.weight.rate(q[0], q[1])
        return Motion(push[1] - pulled, q[3], q[2], phi_dot), last

    def _weighs(self, part: Differentiated) -> Array | float:
        return 0.0 if self.weight is None else self.weight.of(part.of["link_position"][0])

    def _best_alpha(self, known: Motion, speed: float) -> float:
        """Return the gain with which the loops, from whichever guess, predict f best."""
        off = []
        for memory in MEMORIES:
            alpha, error = 1.0 / (memory * speed), 0.0
            for loop in (self._loops()[0], self._loops()[2]):
                stiffness, link, _ = observe_coupled(loop, *known, known.use, alpha, self.period, self.noise)
                ahead = self.conditioner.window
                spring = (
                    known.f[ahead:]
                    - link[:-ahead, 0] * known.jerk[ahead:]
                    - link[:-ahead, 1] * known.acceleration[ahead:]
                )
                left = spring - stiffness[:-ahead, 0] * known.deflection[ahead:]
                finite = left[np.isfinite(left)]
                error += float(np.mean(finite**2)) if finite.size else np.inf
            off.append(error)
        return float(1.0 / (MEMORIES[int(np.argmin(off))] * speed))

    def _noisy(self, signals: JointSignals, sizes: Sequence[float]) -> Array:
        """Return which share of the power of q⃛, q̈ and φ̇ is noise."""
        q, weights = signals.roles["link_position"], self.conditioner.weights
        added = [sensor_error(q[:ENOUGH], self.conditioner.window).rms(w) for w in (weights[3], weights[2])]
        _, (noise,) = rates_of(self.device, signals[:ENOUGH], weights[:2])
        return np.minimum(np.array([*added, noise]) / sizes, 1.0) ** 2

    def _deflection(self, part: Differentiated) -> Array:
        return deflection_of({role: values[0] for role, values in part.of.items()}, self.view)

    def _average_of(self, signals: JointSignals, phi: Array, known: Motion) -> AveragingError:
        """Return the residual of the loop's spring torque."""
        stiffness, link, _ = observe_coupled(self._loops()[0], *known, known.use, self.alpha, self.period, self.noise)
        spring = known.f - link[:, 0] * known.jerk - link[:, 1] * known.acceleration
        push, q = (
            sensor_error(signals.roles[role][:ENOUGH], self.conditioner.window)
            for role in ("external_torque", "link_position")
        )
        weights = self.conditioner.weights
        rate = np.hypot(push.rms(weights[1]), self.guess[0] * q.rms(weights[3]))
        return averaging_error(phi, Rates(spring, known.deflection), stiffness[:, 0], float(rate))


def quiet_window(device: Device, signals: JointSignals, tuning: ImpedanceCoupledTuning) -> int:
    """Return the shortest window, in samples, that leaves φ̇ and q⃛ quiet and keeps the motion.

    Where none does, that of those quiet in φ̇ behind which the least part of q⃛ is noise.
    """
    order = ORDERS["link_position"]
    windows, shares, kept = suitable_windows(device, signals, tuning, order), [], -np.inf
    q = signals.roles["link_position"][:ENOUGH]
    for window in windows:
        weights = derivative_weights(window, tuning.degree, order, signals.period)[order:]
        jerk, noise = rms(savgol_filter(q, weights)[0]), sensor_error(q, window).rms(weights[0])
        motion = jerk**2 - noise**2
        if motion < kept:
            break
        shares.append(noise / (max(jerk, noise) or 1.0))
        if shares[-1] <= REPORTED_MISFIT:
            break
        if shares[-1] <= MOST_NOISE:
            # How large noise is, is known no better than to its own size.
            kept = max(kept, KEPT * motion - noise**2)
    return windows[int(np.argmin(shares))]


def unexplained(known: Motion) -> float:
    """Return the RMS residual of f with constant I, N and K [N·m/s]: least squares over a whole log."""
    regressors = np.column_stack((known.jerk, known.acceleration, known.deflection))
    left = known.f - regressors @ np.linalg.lstsq(regressors, known.f, rcond=None)[0]
    return float(np.sqrt(np.mean(left**2)))
