"""Inertia and damping of the link under a measured torque, as the trace has them: the filter, its noise, and what is in doubt.

Serio, Grioli, Sardellitti, Tsagarakis, Bicchi (2011), §III-B, eq. 10–12, 21–25.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vsalog.core.finding import Finding
from vsalog.core.resolution import sensor_noise
from vsalog.core.signals import JointSignals
from vsalog.core.significance import DETECTED, INTERVAL
from vsalog.effects.base import Exactness
from vsalog.effects.gravity import holding_torque
from vsalog.estimators.device import Device, spread
from vsalog.estimators.equation import SUPPORTED_SHARE
from vsalog.estimators.link_disturbance import NOTHING, disturbance_of
from vsalog.estimators.state_observer import Columns
from vsalog.estimators.windows import most_moved, rms
from vsalog.filters.link_ekf import MOST_LOST, LinkNoise, LinkState, State, estimate_link, link_start, restarted
from vsalog.filters.savitzky_golay import savgol_filter
from vsalog.mechanics.links import link_weight
from vsalog.uncertainty.errors_in_variables import MOST_NOISE
from vsalog.uncertainty.sensor_error import ENOUGH, LEAST_NOISE, sensor_error

Array = NDArray[np.float64]

# Largest factor of 1/I and N/I over the log's quotients of accelerations, velocities and torques [1].
PRIOR_WIDTH = 10.0
# Ratio of the innovations' mean square to that of noise, above which the link is not the assumed one [1].
MOST_EXCESS = INTERVAL * INTERVAL
# Pairs of opposite sign in which the torque's noise is simulated [1].
NOISE_PAIRS = 3


class LinkImpedance:
    """The link's filter of one joint.

    Parameters
    ----------
    device : of the joint
    signals : the whole log, with link_position
    weights : of a filter, shape (3 or more, window), that gives the position's derivatives
    wander : share by which I and N may change within a second
    memory : time over which innovations are averaged [s]
    """

    def __init__(self, device: Device, signals: JointSignals, weights: Array, wander: float, memory: float) -> None:
        self.device, self.period = device, signals.period
        self.memory = max(memory / signals.period, 10.0)
        q, u = signals.roles["link_position"], self._acting(signals)
        _, rate, acceleration = savgol_filter(q, weights[:3])
        torque = savgol_filter(u, weights[:1])[0]
        self.noise = _noise(signals, u, torque, rate, acceleration, wander)
        self.bias = np.maximum(
            self._bias(most_moved(signals, ["link_position"])[:ENOUGH], weights.shape[1]),
            max(Exactness.SMOOTH, _between(q, weights[2], acceleration)),
        )
        self.disturbance = disturbance_of(torque, rate, acceleration, weights.shape[1])
        if sensor_error(q[:ENOUGH], weights.shape[1]).rms(weights[2]) > MOST_NOISE * rms(acceleration):
            # Least squares of such accelerations determine nothing.
            self.disturbance = NOTHING
        self.doubt = np.maximum(self.bias, self.disturbance.moved)

    def start(self) -> LinkState:
        """Return the state before the first sample."""
        return link_start(self.noise)

    def block(self, state: LinkState, rows: JointSignals, begins: bool) -> tuple[LinkState, Columns]:
        """Return the new state and the columns: link_velocity [rad/s], link_inertia [kg·m²], link_damping [N·m·s/rad].

        Parameters
        ----------
        state : of `start` or the block before
        rows : signals as they were recorded, never across a gap
        begins : whether a run begins with them
        """
        x, P, excess, after = estimate_link(
            restarted(state) if begins else state, rows.roles["link_position"], self._acting(rows),
            self.period, self.noise, self.memory,
        )  # fmt: skip
        a, b = x[:, State.MOBILITY], x[:, State.DECAY]
        var_a, var_b, both = (
            P[:, State.MOBILITY, State.MOBILITY],
            P[:, State.DECAY, State.DECAY],
            P[:, State.MOBILITY, State.DECAY],
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            known = (a > DETECTED * np.sqrt(var_a)) & (excess <= MOST_EXCESS)
            inertia, damping = 1.0 / a, b / a
            inertia_std = np.hypot(np.sqrt(var_a) / a**2, self.doubt[0] * inertia)
            damping_std = np.sqrt(np.maximum(var_b - 2.0 * damping * both + damping**2 * var_a, 0.0)) / a
            damping_std = np.hypot(damping_std, self.doubt[1] * damping)
            # Least squares over the whole log is a cross-check, which other effects bias.
            apart = np.column_stack((inertia, damping)) - self.disturbance.plain
            inertia_std = np.hypot(inertia_std, np.nan_to_num(apart[:, 0]))
            damping_std = np.hypot(damping_std, np.nan_to_num(apart[:, 1]))
            # A link that is driven by its damping is not identified.
            known &= damping > -DETECTED * damping_std
        estimates = {"link_inertia": (inertia, inertia_std, 0), "link_damping": (damping, damping_std, 1)}
        columns = {"link_velocity": x[:, State.VELOCITY]}
        for name, (value, std, i) in estimates.items():
            given = known & bool(self.doubt[i] < SUPPORTED_SHARE)
            columns |= {name: np.where(given, value, np.nan), f"{name}_std": np.where(given, std, np.nan)}
        return after, columns

    def findings(self, state: LinkState) -> tuple[Finding, ...]:
        """Return what could not be estimated, and why, and what acts on the link along with what is known."""
        excess, lost, joint = float(state.last[1]), int(state.last[3]), self.device.joint
        found = self.disturbance.findings(joint)
        if lost > MOST_LOST:
            found.append(Finding(code="link.filter_restarted", joint=joint, value=float(lost), limit=float(MOST_LOST)))
        elif excess > MOST_EXCESS:
            found.append(Finding(code="link.not_explained", joint=joint, value=excess**0.5, limit=MOST_EXCESS**0.5))
        elif not np.all(self.bias < SUPPORTED_SHARE):
            biased = {name: float(bias) for name, bias in zip(("inertia", "damping"), self.bias, strict=True)}
            found.append(
                Finding(
                    code="link.estimate_biased",
                    joint=joint,
                    part=" and ".join(name for name, bias in biased.items() if not bias < SUPPORTED_SHARE),
                    value=max(biased.values()),
                    limit=SUPPORTED_SHARE,
                    evidence=biased,
                )
            )
        return tuple(found)

    def _acting(self, rows: JointSignals) -> Array:
        """Return the torque that turns the link: a push from outside, less its weight and what the transmissions take."""
        u = -np.sum([rows.roles[v.torque_sensor] for v in self.device.transmissions], axis=0)
        if "external_torque" in rows.roles:
            u = u + rows.roles["external_torque"]
        link = self.device.link
        if link is not None and link.gravity_torque:
            u = u - holding_torque(link_weight(link), link.gravity_angle, rows.roles["link_position"])
        return np.asarray(u)

    def _bias(self, part: JointSignals, window: int) -> Array:
        """Return by which share the sensors bias I and N: by about as much as they do when what they add is added again.

        The filter takes the torque as exact where it multiplies 1/I. Noise of either sign moves its estimates to either side;
        the mean of both is the bias. It takes the encoder's steps for white noise, which they are not where they are taken
        slowly: they would be taken for the link's motion. The farthest that they move the estimates is doubt as a whole.
        (Cook and Stefanski, "Simulation-extrapolation estimation in parametric measurement error models", JASA 89, 1994.)
        """
        q, u = part.roles["link_position"], self._acting(part)
        noises = self.noise.torque * np.random.default_rng(0).standard_normal((NOISE_PAIRS, u.size))
        steps = sensor_error(q, window).whole(q.size)
        before = self._ends(part, q, u)
        louder = np.array([self._ends(part, q, u + sign * more) for more in noises for sign in (-1.0, 1.0)])
        coarser = np.array([self._ends(part, q + sign * more, u) for more in steps for sign in (-1.0, 1.0)] or [before])
        with np.errstate(divide="ignore", invalid="ignore"):
            by_noise, by_steps = louder.mean(axis=0) / before - 1.0, coarser / before - 1.0
            shares = np.sqrt(by_noise**2 + np.max(by_steps**2, axis=0))
        return np.asarray(np.where(np.isfinite(shares), shares, np.inf))

    def _ends(self, part: JointSignals, position: Array, torque: Array) -> Array:
        """Return I and N as they are at the end of a stretch."""
        state = self.start()
        for run in _runs(part):
            q, u = position[run], torque[run]
            *_, state = estimate_link(restarted(state), q, u, self.period, self.noise, self.memory)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.asarray(np.array([1.0, state.x[State.DECAY]]) / state.x[State.MOBILITY])


def _between(position: Array, weights: Array, acceleration: Array) -> float:
    """Return what it costs that the torque between two samples is taken as their mean: T² ω² / 6 of what moves with ω.

    An inertia is estimated from accelerations, and so ω is theirs; T ω is how much they differ from one sample to the next.
    """
    error = sensor_error(position[:ENOUGH], weights.size)
    change = rms(np.diff(acceleration)) ** 2 - error.rms(np.append(weights, 0.0) - np.append(0.0, weights)) ** 2
    power = rms(acceleration) ** 2 - error.rms(weights) ** 2
    return max(change, 0.0) / power / 6.0 if power > 0.0 else np.inf


def _runs(signals: JointSignals) -> list[slice]:
    edges = sorted({0, *np.flatnonzero(signals.starts).tolist(), len(signals)})
    return [slice(a, b) for a, b in pairwise(edges)]


def _noise(
    signals: JointSignals, u: Array, torque: Array, rate: Array, acceleration: Array, wander: float
) -> LinkNoise:
    """Derive the noise of the link's filter from the log: its sensors', and what 1/I and N/I can be at most.

    Parameters
    ----------
    u : shape (N,), the torque as it was recorded
    torque, rate, acceleration : of the link, behind one filter
    """
    q = signals.roles["link_position"]
    mobility = PRIOR_WIDTH * rms(acceleration) / max(spread(u), 1e-300)
    decay = PRIOR_WIDTH * rms(acceleration) / max(rms(rate), 1e-300)
    # Taken for linear around a = b = 0, as the paper begins, the link may be lost before it is found.
    first = _least_squares(acceleration, torque, rate)
    return LinkNoise(
        position=sensor_noise(q, signals.resolution.get("link_position", 0.0), LEAST_NOISE),
        torque=sensor_noise(u, 0.0, LEAST_NOISE),
        velocity=PRIOR_WIDTH * rms(rate),
        mobility=mobility,
        decay=decay,
        wander=wander,
        first_mobility=float(np.clip(first[0], 0.0, mobility)),
        first_decay=float(np.clip(first[1], 0.0, decay)),
    )


def _least_squares(acceleration: Array, torque: Array, rate: Array) -> Array:
    """Return 1/I and N/I of q̈ = u / I − q̇ N / I, all behind one filter."""
    known = np.isfinite(acceleration) & np.isfinite(torque) & np.isfinite(rate)
    regressors = np.column_stack((torque, -rate))[known]
    if not known.any():
        return np.zeros(2)
    return np.asarray(np.linalg.lstsq(regressors, acceleration[known], rcond=None)[0])
