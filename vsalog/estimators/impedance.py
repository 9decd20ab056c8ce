"""impedance: stiffness, and inertia and damping of the link, from a joint torque sensor and the positions. No motor data.

Serio, Grioli, Sardellitti, Tsagarakis, Bicchi (2011), §III-B: a stiffness observer on the torque that the transmission bears, and
beside it an extended Kalman filter on the link, which that torque drives. Neither needs what the other finds.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from vsalog.correlation import effective_samples
from vsalog.errors import EstimatorError
from vsalog.estimators.device import Device, TransmissionView, deflection_of
from vsalog.estimators.needs import require
from vsalog.estimators.regression import SUPPORTED_SHARE
from vsalog.estimators.tuning import Positive, Tuning
from vsalog.filters.conditioning import Conditioned, ConditionerState
from vsalog.filters.link_ekf import DECAY, MOBILITY, VELOCITY, LinkNoise, LinkState, anew, estimate_link, link_start
from vsalog.filters.savitzky_golay import savgol_filter
from vsalog.filters.stiffness_observer import observe_stiffness, observer_start
from vsalog.model import JointModel, basis_spec
from vsalog.resolution import sensor_noise
from vsalog.signals import JointSignals
from vsalog.trace import Trace

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

NAME = "impedance"
SUMMARY = "stiffness, link inertia and damping from positions and a torque sensor (Serio 2011)"
# Memories of the observer that are tried where no gain is asked for [s].
MEMORIES = tuple(np.geomspace(0.003, 3.0, 13).tolist())
# What has been learnt counts when so much of the memory is filled.
FILLED = 0.95
# 1/I and N/I may be so many times what accelerations, velocities and torques of the log are in proportion.
ROOM = 10.0
# A signal without noise and steps has some: this part of its largest value.
LEAST_NOISE = 1e-9
# 1/I is known when it is so many times its standard deviation: below, its inverse is anything.
KNOWN = 3.0
# What taking the torque between two samples as their mean may cost, as a share.
FLOOR = 1e-3


class ImpedanceTuning(Tuning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning of impedance.

    Attributes
    ----------
    alpha : gain α of the stiffness observer [1/rad]; when absent the one with which what was learnt up to a filter's window
        before tells the present torque's rate best
    derivative : ``filter`` takes rates from the Savitzky–Golay filter, ``difference`` from one sample to the next as the paper
        does (eq. 15), causal and noisy
    wander : share by which the link's inertia and damping may change within a second
    """

    alpha: Positive | None = None
    derivative: Literal["filter", "difference"] = "filter"
    wander: Annotated[float, Meta(ge=0.0)] = 1e-4

    def __post_init__(self) -> None:
        if self.filter != "savitzky-golay":
            raise ValueError("rates come from the Savitzky–Golay filter; derivative=difference is causal")


TUNING = ImpedanceTuning


def roles(device: Device, offered: Collection[str], tuning: ImpedanceTuning) -> tuple[str, ...]:
    """Return the roles the method reads of what the rig offers; raises EstimatorError for a missing one."""
    needed: list[str] = []
    for view in device.transmissions:
        needed += [*view.deflection_roles(offered), view.torque_sensor]
    require(NAME, device, needed, offered)
    beside = [role for role in ("link_position", "external_torque", "setpoint") if role in offered]
    return tuple(dict.fromkeys([*needed, *beside]))


def build(device: Device, signals: JointSignals, tuning: ImpedanceTuning) -> ImpedanceFold:
    """Assemble the estimator for a joint's signals.

    Raises
    ------
    EstimatorError
        A signal never changes.
    """
    return ImpedanceFold(device, signals, tuning)


@dataclass(slots=True)
class ImpedanceState:
    """Where the fold stands: of the filters, of each transmission's observer and one twice as fast, of the link's filter, and the
    last sample.
    """

    filters: ConditionerState
    observers: dict[str, tuple[Array, Array]]
    link: LinkState
    last: dict[str, tuple[float, float]] = field(default_factory=dict)


class ImpedanceFold:
    """Both observers as an estimator: a fold over blocks of signals that gives a trace."""

    passes = 1

    def __init__(self, device: Device, signals: JointSignals, tuning: ImpedanceTuning) -> None:
        self.device, self.period, self.tuning = device, signals.period, tuning
        self.roles = roles(device, signals.roles, tuning)
        # Set-point and push are no part of a rate.
        moving = tuple(r for r in self.roles if r not in ("setpoint", "external_torque"))
        self.conditioner = tuning.conditioner(moving, signals, rates=moving, present=False)
        self.memory = tuning.memory_samples(signals)
        fitted = self._fitted(signals)
        rates = np.concatenate([fitted[v.name][1] for v in device.transmissions])
        fast = float(np.sqrt(np.nanmean(rates**2))) if np.isfinite(rates).any() else 0.0
        if not fast > 0.0:
            raise EstimatorError(
                f"joint '{device.joint}': the deflection never changes, and so nothing tells the stiffness"
            )
        self.alpha = tuning.alpha if tuning.alpha is not None else self._best_alpha(fitted, fast)
        self.alike, self.within = self._left_over(signals, fitted)
        self.noise = self._noise(signals, fitted) if "link_position" in self.roles else None

    @property
    def derived(self) -> dict[str, float]:
        """The gain and the noise that were derived from the log."""
        noise = {} if self.noise is None else {f"noise_{n}": float(v) for n, v in self.noise._asdict().items()}
        return {"alpha": self.alpha, "alike": self.alike, "within": self.within, **noise}

    def start(self) -> ImpedanceState:
        """Return the state before the first sample."""
        link = link_start(self.noise or LinkNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        observers = {v.name: (observer_start(), observer_start()) for v in self.device.transmissions}
        return ImpedanceState(self.conditioner.start(), observers, link)

    def freeze(self, state: ImpedanceState) -> ImpedanceState:
        """Go back to the first sample."""
        return self.start()

    def step(self, state: ImpedanceState, block: JointSignals) -> tuple[ImpedanceState, list[Trace]]:
        """Take a block of samples; give the new state and the trace of the rows that are ready."""
        filters, ready = self.conditioner.step(state.filters, block)
        new = ImpedanceState(filters, dict(state.observers), state.link, dict(state.last))
        return new, [self._trace(new, part) for part in ready]

    def finish(self, state: ImpedanceState) -> tuple[ImpedanceState, list[Trace]]:
        """Give out the rows that are still held back."""
        filters, ready = self.conditioner.finish(state.filters)
        new = ImpedanceState(filters, dict(state.observers), state.link, dict(state.last))
        return new, [self._trace(new, part) for part in ready]

    def warnings(self, state: ImpedanceState) -> tuple[str, ...]:
        """Say what the link's filter could not find."""
        if self.noise is None:
            return (
                f"joint '{self.device.joint}': without link_position the link's inertia and damping are not estimated",
            )
        excess = float(state.link.last[1])
        if excess > 4.0:
            return (
                f"joint '{self.device.joint}': the link does not move as an inertia and a damping under the measured torque would"
                f" (innovations are {excess**0.5:.2g} times as large as noise makes them): weight, friction or a push may be"
                " missing in the rig, and the link's inertia and damping are as doubtful as their standard deviations say",
            )
        return ()

    def model(self, state: ImpedanceState) -> JointModel:
        """Return a model without transmissions: the stiffness is followed, not modelled."""
        return JointModel(
            estimator=NAME, modality="SENSOR", basis=basis_spec(self.device.basis), transmission=(), motor={}
        )

    def _trace(self, state: ImpedanceState, part: Conditioned) -> Trace:
        rows, parts = part.rows, dict[str, dict[str, NDArray[Any]]]()
        if len(rows) and rows.starts[0]:
            state.link, state.last = anew(state.link), {}
        for view in self.device.transmissions:
            parts[view.name] = self._observed(state, part, view)
        parts["total"] = {**_added([parts[v.name] for v in self.device.transmissions]), **self._link(state, rows)}
        return Trace.of_rows(rows, parts)

    def _observed(self, state: ImpedanceState, part: Conditioned, view: TransmissionView) -> dict[str, NDArray[Any]]:
        torque_rate, deflection_rate = self._rates(state, part, view)
        use = np.isfinite(torque_rate) & np.isfinite(deflection_rate)
        slow, fast = state.observers[view.name]
        stiffness, deviation, learnt, slow = observe_stiffness(
            slow, torque_rate, deflection_rate, use, self.alpha, self.period
        )
        quick, _, _, fast = observe_stiffness(fast, torque_rate, deflection_rate, use, 2.0 * self.alpha, self.period)
        state.observers[view.name] = slow, fast
        # An observer is late; one that is half as late lies between it and the truth. And it averages over whole swings.
        std = np.sqrt(deviation**2 * self.alike + (quick - stiffness) ** 2 + self.within**2)
        return _columns(
            deflection_of(part.fit, view), part.fit[view.torque_sensor], stiffness, std, use & (learnt >= FILLED)
        )

    def _rates(self, state: ImpedanceState, part: Conditioned, view: TransmissionView) -> tuple[Array, Array]:
        if self.tuning.derivative == "filter":
            rates = {r.removeprefix("velocity:"): v for r, v in part.fit.items() if r.startswith("velocity:")}
            return rates[view.torque_sensor], deflection_of(rates, view)
        values = part.rows.roles[view.torque_sensor], deflection_of(part.rows.roles, view)
        before = state.last.get(view.name, (np.nan, np.nan))
        if len(part.rows):
            state.last[view.name] = float(values[0][-1]), float(values[1][-1])
        torque, deflection = (np.diff(v, prepend=b) / self.period for v, b in zip(values, before, strict=True))
        return torque, deflection

    def _link(self, state: ImpedanceState, rows: JointSignals) -> dict[str, NDArray[Any]]:
        """Return what the link's filter tells, from the signals as they were recorded: it filters itself."""
        if self.noise is None:
            return {}
        x, P, _, state.link = estimate_link(
            state.link, rows.roles["link_position"], self._acting(rows), self.period, self.noise, self.memory
        )
        a, b = x[:, MOBILITY], x[:, DECAY]
        var_a, var_b, both = P[:, MOBILITY, MOBILITY], P[:, DECAY, DECAY], P[:, MOBILITY, DECAY]
        with np.errstate(divide="ignore", invalid="ignore"):
            known = a > KNOWN * np.sqrt(var_a)
            inertia, damping = 1.0 / a, b / a
            inertia_std = np.hypot(np.sqrt(var_a) / a**2, FLOOR * inertia)
            damping_std = np.sqrt(np.maximum(var_b - 2.0 * damping * both + damping**2 * var_a, 0.0)) / a
            damping_std = np.hypot(damping_std, FLOOR * damping)
        told = {
            "link_inertia": inertia,
            "link_inertia_std": inertia_std,
            "link_damping": damping,
            "link_damping_std": damping_std,
        }
        return {"link_velocity": x[:, VELOCITY], **{n: np.where(known, v, np.nan) for n, v in told.items()}}

    def _acting(self, rows: JointSignals) -> Array:
        """Return the torque that turns the link: a push from outside, less its weight and what the transmissions take."""
        u = -np.sum([rows.roles[v.torque_sensor] for v in self.device.transmissions], axis=0)
        if "external_torque" in rows.roles:
            u = u + rows.roles["external_torque"]
        link = self.device.link
        if link is not None and link.gravity_torque:
            u = u - link.gravity_torque * np.sin(rows.roles["link_position"] - link.gravity_angle)
        return np.asarray(u)

    def _fitted(self, signals: JointSignals) -> dict[str, tuple[Array, Array]]:
        """Return the whole log's rates of torque and deflection, by transmission."""
        out = {}
        for view in self.device.transmissions:
            torque, phi = signals.roles[view.torque_sensor], deflection_of(signals.roles, view)
            weights = self.conditioner.weights[1:2]
            out[view.name] = savgol_filter(torque, weights)[0], savgol_filter(phi, weights)[0]
        return out

    def _best_alpha(self, fitted: Mapping[str, tuple[Array, Array]], fast: float) -> float:
        """Return the gain of the observer that predicts best: a long memory averages noise, a short one follows the stiffness.

        By a whole window ahead, for within one the filter makes noise alike.
        """
        ahead, off = self.conditioner.window, np.zeros(len(MEMORIES))
        for i, memory in enumerate(MEMORIES):
            for torque_rate, deflection_rate in fitted.values():
                use = np.isfinite(torque_rate) & np.isfinite(deflection_rate)
                alpha = 1.0 / (memory * fast)
                found = observe_stiffness(observer_start(), torque_rate, deflection_rate, use, alpha, self.period)[0]
                error = torque_rate[ahead:] - found[:-ahead] * deflection_rate[ahead:]
                off[i] += np.nanmean(error**2) / np.nanvar(torque_rate)
        return float(1.0 / (MEMORIES[int(np.argmin(off))] * fast))

    def _left_over(self, signals: JointSignals, fitted: Mapping[str, tuple[Array, Array]]) -> tuple[float, float]:
        """Look at what the observer's predictions leave of the torque's rate.

        Returns
        -------
        alike : for how many samples what moves the observer stays alike, at least 1: the most of the transmissions
        within : how much the stiffness differs from the observer's average of it [N·m/rad], root mean square: what is left over
            but for the sensors' noise, over the deflection's rate
        """
        alike, within = 1.0, 0.0
        for view in self.device.transmissions:
            torque, phi = signals.roles[view.torque_sensor], deflection_of(signals.roles, view)
            torque_rate, deflection_rate = fitted[view.name]
            gain = float(np.sum(self.conditioner.weights[1] ** 2))
            if self.tuning.derivative == "difference":
                torque_rate, deflection_rate = np.diff(torque) / self.period, np.diff(phi) / self.period
                gain = 2.0 / self.period**2
            use = np.isfinite(torque_rate) & np.isfinite(deflection_rate)
            torque_rate, deflection_rate = torque_rate[use], deflection_rate[use]
            every = np.ones(torque_rate.size, dtype=np.bool_)
            found = observe_stiffness(observer_start(), torque_rate, deflection_rate, every, self.alpha, self.period)[0]
            left = np.nan_to_num(torque_rate - found * deflection_rate)
            alike = max(alike, left.size / effective_samples(left * np.sign(deflection_rate)))
            steps = [signals.resolution.get(role, 0.0) for role in view.deflection_roles(signals.roles)]
            noise = np.hypot(
                sensor_noise(torque, signals.resolution.get(view.torque_sensor, 0.0), LEAST_NOISE),
                float(np.nanmedian(found)) * sensor_noise(phi, float(np.linalg.norm(steps)), LEAST_NOISE),
            )
            more = max(0.0, float(np.mean(left**2)) - gain * float(noise) ** 2)
            within = max(within, float(np.sqrt(more / np.mean(deflection_rate**2))))
        return alike, within

    def _noise(self, signals: JointSignals, fitted: Mapping[str, tuple[Array, Array]]) -> LinkNoise:
        """Derive the noise of the link's filter from the log: its sensors', and what 1/I and N/I can be at most."""
        q, u = signals.roles["link_position"], self._acting(signals)
        _, rate, acceleration = savgol_filter(q, self.conditioner.weights)
        size = _rms(acceleration)
        return LinkNoise(
            position=sensor_noise(q, signals.resolution.get("link_position", 0.0), LEAST_NOISE),
            torque=sensor_noise(u, 0.0, LEAST_NOISE),
            velocity=ROOM * _rms(rate),
            mobility=ROOM * size / max(_rms(u - np.nanmean(u)), 1e-300),
            decay=ROOM * size / max(_rms(rate), 1e-300),
            wander=self.tuning.wander,
        )


def _columns(phi: Array, torque: Array, stiffness: Array, std: Array, excited: Flags) -> dict[str, NDArray[Any]]:
    nothing = np.full(phi.shape, np.nan)
    with np.errstate(invalid="ignore"):
        excited = excited & (std < SUPPORTED_SHARE * np.abs(stiffness))
    return {
        "deflection": phi,
        "flexibility_torque": torque,
        "flexibility_torque_fit": nothing,
        "stiffness": stiffness,
        "stiffness_std": std,
        "excited": excited,
        "stiffness_derivative": nothing,
        "stiffness_second_derivative": nothing,
    }


def _added(parts: list[dict[str, NDArray[Any]]]) -> dict[str, NDArray[Any]]:
    """The device's: torques and stiffnesses add up (Flacco 2012 eq. 9–10), standard deviations in squares."""
    if len(parts) == 1:
        return dict(parts[0])
    torque, stiffness = (np.sum([p[name] for p in parts], axis=0) for name in ("flexibility_torque", "stiffness"))
    std = np.sqrt(np.sum([p["stiffness_std"] ** 2 for p in parts], axis=0))
    excited = np.logical_and.reduce([p["excited"] for p in parts])
    return _columns(parts[0]["deflection"], torque, stiffness, std, excited)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values**2))) if np.isfinite(values).any() else 0.0
