"""The torque on a rotor except its transmission's: motor torque plus torques of effects minus dry friction, before filtering.

Dry friction jumps where the velocity changes its sign. Computed from filtered signals and subtracted from a filtered torque, the
jump would be sharp on one side and smeared on the other; so it is subtracted first, and all is filtered alike.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from vsalog.core.signals import JointSignals
from vsalog.core.significance import DETECTED
from vsalog.effects.body_torque import body_torque
from vsalog.estimators.device import TransmissionView
from vsalog.filters.conditioning import FilterName
from vsalog.filters.kinematic import PAPER_TRACKING_INDEX, KinematicSettings, kinematic_filter
from vsalog.filters.savitzky_golay import filter_together, savgol_lag, savgol_polynomials, savgol_weights
from vsalog.mechanics.friction import friction_block, friction_start
from vsalog.rig.schema import Motor

Array = NDArray[np.float64]

# The sign is that of the velocity of a cubic fitted to this number of samples: enough to see slow motion, and few enough to
# see where it turns.
DIRECTION_WINDOW, CUBIC = 21, 3
# Samples to either side of a change of sign by which the cubic may miss it [1]: where the acceleration jumps, as it does when
# friction turns round, the cubic's velocity is off by the jump times 0.81 samples, and a jump may be twice what is seen.
REVERSAL_REACH = 2.0


def extended(motor: Motor) -> bool:
    """Return whether the rig gives a motor dry friction, or a torque of an effect such as cogging."""
    return motor.friction.rubs or bool(motor.torques)


def way_role(view: TransmissionView) -> str:
    """Name of the signal of the direction in which friction acts, −1 to 1."""
    return f"way:{view.motor_torque}"


def doubt_role(view: TransmissionView) -> str:
    """Name of the signal of the error that friction may have [N·m]."""
    return f"doubt:{view.motor_torque}"


@dataclass(slots=True)
class FrictionCompensationState:
    """Samples of the run so far, those still held back or inside the window, and the states of frictions and filters."""

    seen: int = 0
    tail: JointSignals | None = None
    frictions: dict[str, Array] = field(default_factory=dict)
    kalman: dict[str, Array] = field(default_factory=dict)


class FrictionCompensation:
    """Replace each motor torque by the net torque: plus effects such as cogging, minus dry friction.

    With a causal filter the velocity is the kinematic Kalman filter's; else that of a cubic fitted around each sample, which
    holds samples back by half its window.

    Parameters
    ----------
    views : transmissions whose motors are `extended`
    signals : a block or the whole, for its period and the encoders' resolutions
    kind : of the filter that follows
    shape : α of the MKKF
    """

    def __init__(
        self, views: tuple[TransmissionView, ...], signals: JointSignals, kind: FilterName, shape: float
    ) -> None:
        self.views, self.period = views, signals.period
        self.motors = {v.name: v.motor.reflected for v in views}
        self.roles = tuple(role for v in views if v.motor.friction.rubs for role in (way_role(v), doubt_role(v)))
        self.centred = kind == "savitzky-golay"
        self.lag = savgol_lag(DIRECTION_WINDOW) if self.centred else 0
        steps = {v.name: signals.resolution.get(v.motor_position, 0.0) for v in views}
        if self.centred:
            self.weights = savgol_weights(DIRECTION_WINDOW, CUBIC, 1, self.period)[1:]
            self.polynomials = savgol_polynomials(DIRECTION_WINDOW, CUBIC)
            spread, self.reach = float(np.linalg.norm(self.weights)), REVERSAL_REACH
            self.floors = {name: DETECTED * spread * step / 12.0**0.5 for name, step in steps.items()}
        else:
            self.settings = {n: KinematicSettings.for_resolution(s, self.period, shape) for n, s in steps.items()}
            spread, self.reach = _kinematic_velocity(PAPER_TRACKING_INDEX)
            self.floors = {name: DETECTED * spread / self.period * step / 12.0**0.5 for name, step in steps.items()}

    def start(self) -> FrictionCompensationState:
        """Return the state before the first sample."""
        return FrictionCompensationState()

    def step(
        self, state: FrictionCompensationState, block: JointSignals
    ) -> tuple[FrictionCompensationState, list[JointSignals]]:
        """Take a block; give the new state and the samples that are ready."""
        out: list[JointSignals] = []
        for piece in block.between_gaps():
            if piece.starts[0]:
                out += self.finish(state)[1]
                state = self.start()
            state, ready = self._within_run(state, piece)
            out += ready
        return state, out

    def finish(self, state: FrictionCompensationState) -> tuple[FrictionCompensationState, list[JointSignals]]:
        """Give out what is held back; the velocity is not known at a run's very end."""
        if state.tail is None or not self.centred:
            return self.start(), []
        held = state.tail[len(state.tail) - min(self.lag, state.seen) :]
        unknown = {v.name: np.full(len(held), np.nan) for v in self.views}
        return self.start(), [self._netted(dict(state.frictions), held, unknown)]

    def _within_run(
        self, state: FrictionCompensationState, piece: JointSignals
    ) -> tuple[FrictionCompensationState, list[JointSignals]]:
        frictions, seen = dict(state.frictions), state.seen + len(piece)
        if not self.centred:
            kalman, velocities = dict(state.kalman), {}
            for v in self.views:
                raw = piece.roles[v.motor_position]
                settings = self.settings[v.name]
                _, velocities[v.name], kalman[v.name] = kinematic_filter(raw, self.period, settings, kalman.get(v.name))
            netted = self._netted(frictions, piece, velocities)
            return FrictionCompensationState(seen, None, frictions, kalman), [netted]
        joined = piece if state.tail is None else state.tail.joined(piece)
        first, last = max(state.seen - self.lag, 0), max(seen - self.lag, 0)
        rows, velocities = slice(first - (seen - len(joined)), last - (seen - len(joined))), {}
        for v in self.views:
            encoder = {v.name: joined.roles[v.motor_position]}
            found = filter_together(encoder, {v.name: 0}, self.weights, self.polynomials)[v.name][0]
            missing = max(last - first - found.size, 0)  # a run's first half window
            velocities[v.name] = np.concatenate(
                (np.full(missing, np.nan), found[found.size - (last - first - missing) :])
            )
        new = FrictionCompensationState(seen, joined[max(len(joined) - DIRECTION_WINDOW + 1, 0) :], frictions)
        return new, [self._netted(frictions, joined[rows], velocities)] if last > first else []

    def _netted(self, frictions: dict[str, Array], rows: JointSignals, velocities: dict[str, Array]) -> JointSignals:
        """Return rows with net torques; moves the states of `frictions` on."""
        roles = dict(rows.roles)
        for v in self.views:
            motor, tau = self.motors[v.name], rows.roles[v.motor_torque]
            net = tau
            if motor.torques:
                moved = rows.roles[v.motor_position], velocities[v.name], rows.time
                net = tau + body_torque(motor.torques, motor.gear_ratio, *moved)
            if motor.friction.rubs:
                before = frictions.get(v.name)
                # The transmitted torque is about the motor's own; the estimator adds its estimate of that.
                frictions[v.name], torque, roles[way_role(v)], roles[doubt_role(v)] = friction_block(
                    friction_start() if before is None else before, motor.friction, velocities[v.name],
                    np.nan_to_num(tau), self.floors[v.name], self.reach, self.period,
                )  # fmt: skip
                net = net - torque
            roles[v.motor_torque] = net
        return replace(rows, roles=roles)


def _kinematic_velocity(index: float) -> tuple[float, float]:
    """Return the velocity's standard deviation, in encoder steps per sample, and by how many samples it lags.

    The steady state of the Kalman filter with a tracking index Λ is the α–β filter of Kalata (IEEE TAES 20(2), 1984).
    """
    r = (4.0 + index - (8.0 * index + index**2) ** 0.5) / 4.0
    alpha = 1.0 - r**2
    beta = 2.0 * (2.0 - alpha) - 4.0 * (1.0 - alpha) ** 0.5
    variance = beta * (alpha - 0.5 * beta) / (1.0 - alpha)
    return variance**0.5, (alpha - 0.5 * beta) / beta
