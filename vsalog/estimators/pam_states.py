"""States of a pneumatic joint from its two pressures: angle, velocity, torque and stiffness by an unscented Kalman filter.

Shin, Ibayashi, Kogiso (2021): the model eq. 2–11, the filter eq. 13–24 with g(x) = (P₁, P₂). Only the pressures and the valves'
commands are read.

A step of the model is half a drift, a kick, half a drift. A drift turns the seesaw at constant velocity with the air locked in,
P V^k₂ constant (eq. 4 without flow). The kick, at the angle in the middle, lets in what flows at the pressures before, and adds
torque and friction to the velocity in eq. 10's implicit form, so that a joint that sticks rests to the last bit (the
paper's Runge–Kutta would creep). Second order in swinging, first in filling and in where friction begins and ends.

Print of Shin 2021: eq. 10's Z is J/T; the units ask for T/J. Q, R and P(0) are printed without units or reasons, and κ twice,
for the valve's map and the points'; `pam_noise` derives the noise instead. The state is (P₁, P₂, ψ, ψ̇) here: with a lower
factor, sigma points along ψ and ψ̇ then leave the pressures alone, and the flows, which cost most, are not computed again.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.core.errors import EstimatorError, SimulationError
from vsalog.core.source_stamp import source_stamp
from vsalog.estimators.equation import NEGLIGIBLE_SHARE
from vsalog.estimators.pam_noise import PamNoise, filling_rates
from vsalog.filters import square_root_ukf as ukf
from vsalog.filters import unscented_smoother as smoothing
from vsalog.mechanics import _pneumatic_joint
from vsalog.mechanics import pneumatics as pneu
from vsalog.mechanics.pneumatic_numbers import air_numbers, friction_numbers, muscle_numbers, seesaw_numbers
from vsalog.rig.schema import PneumaticJoint

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# The most steps of the model in a sample [1].
MOST_STEPS = 1000
# Samples for which a command that is missing is taken to be the one before [1].
COMMAND_HELD = 10
# Beyond the fitted range D₁ l² + D₂ l + D₃ falls to zero; a sigma point out there has this share of the volume at rest [1].
LEAST_VOLUME = 0.02


class Column(IntEnum):
    """Columns of the state."""

    PRESSURE_1 = 0
    PRESSURE_2 = 1
    ANGLE = 2
    VELOCITY = 3


class PamState(NamedTuple):
    """State of the fold.

    Attributes
    ----------
    x : shape (4,), P₁, P₂ [Pa], ψ [rad], ψ̇ [rad/s]; meaningless before the start
    S : shape (4, 4), lower factor of their covariance
    u : shape (3,), openings α₁, α₂ and external torque [N·m] of the sample before, which act until the next
    age : shape (2,), for how many samples the openings have been held because a command was missing
    surprise : share of the latest samples outside the filter's band, 0 to 1
    started : whether a sample with both pressures has been seen
    """

    x: Array
    S: Array
    u: Array
    age: Integers
    surprise: float
    started: bool


class PamFold:
    """The filter as a fold over blocks of samples: any cut into blocks gives the same numbers, bit for bit."""

    def __init__(self, joint: PneumaticJoint, period: float, noise: PamNoise, *, correct: bool = True) -> None:
        """Prepare for a joint; the sigma points are Shin's, κ = 0.

        Parameters
        ----------
        joint : of the rig; one that is held stays where it is held
        period : T [s]
        noise : of `pam_noise`
        correct : whether the pressures correct the state; else they only begin it, and the model goes on alone, without noise

        Raises
        ------
        EstimatorError
            The period is not positive, or so long that the model would need very many steps in it.
        """
        self.joint, self.period, self.noise, self.correct = joint, period, noise, correct
        self.steps = _steps(joint, period)
        least = [LEAST_VOLUME * float(pneu.muscle_volume(m, m.length)) for m in (joint.muscle_1, joint.muscle_2)]
        muscles = np.array(
            [muscle_numbers(joint.muscle_1, joint.valve_1), muscle_numbers(joint.muscle_2, joint.valve_2)]
        )
        # The last is room of the transition's passes.
        self._model: Any = (
            air_numbers(joint), muscles, seesaw_numbers(joint), friction_numbers(joint), np.array(least), period / self.steps,
            joint.seesaw.held_at is not None, np.zeros((8, 9)),
        )  # fmt: skip
        # One process noise for each of the four cases of valves known and unknown.
        known = [np.where([i & 1, i & 2, 0, 0], [*noise.unknown_flow, 0.0, 0.0], noise.process) for i in range(4)]
        noises = (self.steps**-0.5 if correct else 0.0) * np.array([np.diag(q) for q in known])
        self._numbers = (
            ukf.UnscentedWeights.scaled(4).packed(),
            noises,
            np.diag(np.array(noise.pressure)),
            ukf.surprise_limits(2),
        )
        self._spread = np.diag([*noise.pressure, *noise.start]) * float(correct)
        self._room, self._run = ukf.workspace(4, 2), _run
        self._back_room, self._back = smoothing.smoother_room(4, self.steps), _back

    def start(self) -> PamState:
        """Return the state before the first sample."""
        return PamState(np.full(4, np.nan), np.zeros((4, 4)), np.full(3, np.nan), np.zeros(2, np.int64), 0.0, False)

    def block(
        self, state: PamState, pressure_1: Array, pressure_2: Array, valve_1: Array | None = None,
        valve_2: Array | None = None, external_torque: Array | None = None,
    ) -> tuple[PamState, ukf.UnscentedTrace]:  # fmt: skip
        """Estimate a block of samples.

        Parameters
        ----------
        state : of `start` or of the block before
        pressure_1, pressure_2 : shape (N,), measured, absolute [Pa]; NaN where missing (the other alone then corrects)
        valve_1, valve_2 : shape (N,), commands [V], each held until the next sample, and for `COMMAND_HELD` missing ones (NaN);
            where they are not known, also where None, the pressure stays as it is but for what the joint's motion does, and may
            change as fast as the valve can
        external_torque : shape (N,), push on the joint [N·m]; none where absent or NaN

        Returns
        -------
        state, trace of (P₁, P₂, ψ, ψ̇), NaN before the first sample with both pressures; the state given is left as it is

        Raises
        ------
        EstimatorError
            The signals' lengths differ, or the muscles hold the joint nowhere at the first pressures.
        """
        count = np.shape(pressure_1)[0]
        nothing = np.full(count, np.nan)
        z = _columns(count, pressure_1, pressure_2)
        u, age = self.acting(state, count, valve_1, valve_2, external_torque)
        trace = ukf.UnscentedTrace(
            np.empty((count, 4)), np.empty((count, 4, 4)), nothing.copy(), np.zeros(count, np.bool_)
        )
        first, x, S, held = 0, state.x.copy(), state.S.copy(), state.u.copy()
        if not state.started:
            both = np.flatnonzero(np.isfinite(z).all(axis=1))
            first = int(both[0]) + 1 if both.size else count
            trace.x[:first], trace.S[:first] = np.nan, np.nan
            if not both.size:
                return state._replace(u=u[-1].copy() if count else state.u, age=age), trace
            held = u[first - 1]
            x, S = np.array([*z[first - 1], self._rest(z[first - 1], held[2]), 0.0]), self._spread.copy()
            trace.x[first - 1], trace.S[first - 1] = x, S
        surprise = np.array([state.surprise])
        acting = np.vstack([held, u[first:]])
        unknown = np.isnan(acting[:-1, 0]) + 2 * np.isnan(acting[:-1, 1])
        self._run(
            z[first:], acting[:-1], unknown, x, S, surprise, self._model, self.steps, self.correct, self._numbers, self._room,
            trace.x[first:], trace.S[first:], trace.nis[first:], trace.diverged[first:],
        )  # fmt: skip
        return PamState(x, S, acting[-1], age, float(surprise[0]), True), trace

    def acting(
        self, state: PamState, count: int, valve_1: Array | None, valve_2: Array | None, external_torque: Array | None
    ) -> tuple[Array, Integers]:
        """Return what acts from each sample to the next, shape (N, 3): α₁, α₂, NaN where not known, and the external torque.

        Parameters as for `block`. The second is for how many samples the openings have been held at the end, shape (2,).
        """
        given = (np.full(count, np.nan) if c is None else c for c in (valve_1, valve_2, external_torque))
        u, age = _columns(count, *given), state.age.copy()
        for i, valve in enumerate((self.joint.valve_1, self.joint.valve_2)):
            u[:, i], age[i] = _held(pneu.valve_opening(valve, u[:, i]), float(state.u[i]), int(age[i]))
        u[:, 2] = np.nan_to_num(u[:, 2], nan=0.0)
        return u, age

    def smooth(self, x: Array, S: Array, u: Array, goes_on: NDArray[np.bool_], x_next: Array, S_next: Array) -> None:
        """Smooth a block of filtered samples in place: their states given all samples, not only those so far.

        Parameters
        ----------
        x, S : shape (N, 4) and (N, 4, 4), of the filter's trace
        u : shape (N, 3), of `acting`
        goes_on : shape (N,), whether the next sample has information on this one; else it stays as filtered
        x_next, S_next : shape (4,) and (4, 4), the smoothed sample after the block, where the last one goes on
        """
        unknown = np.isnan(u[:, 0]) + 2 * np.isnan(u[:, 1])
        weights, SQ = self._numbers[:2]
        self._back(x, S, u, unknown, goes_on, x_next, S_next, self._model, self.steps, weights, SQ, self._back_room)

    def estimates(self, trace: ukf.UnscentedTrace) -> dict[str, Array]:
        """Return what the states imply, each shape (N,), and each NAME_std, one standard deviation.

        ``torque`` τ of eq. 9 [N·m]; ``stiffness`` −dτ/dψ with the air locked in and ``stiffness_isobaric`` −∂τ/∂ψ at constant
        pressures [N·m/rad]. The deviation is the states' by the filter's covariance, without doubts of the muscles' numbers.
        """
        functions = {
            "torque": pneu.joint_torque, "stiffness": pneu.trapped_stiffness, "stiffness_isobaric": pneu.isobaric_stiffness,
        }  # fmt: skip
        # The state itself, and one deviation to both sides along the factors' columns; no function looks at the velocity.
        at = np.stack([trace.x, *(trace.x + side * trace.S[:, :, j] for j in range(3) for side in (1.0, -1.0))])
        found: dict[str, Array] = {}
        for name, function in functions.items():
            values = function(self.joint, at[..., Column.ANGLE], at[..., Column.PRESSURE_1], at[..., Column.PRESSURE_2])
            found[name] = values[0]
            found[f"{name}_std"] = np.sqrt(np.sum(((values[1::2] - values[2::2]) / 2.0) ** 2, axis=0))
        return found

    def _rest(self, pressures: Array, external: float) -> float:
        try:
            return pneu.resting_angle(self.joint, float(pressures[0]), float(pressures[1]), float(external))
        except SimulationError as error:
            raise EstimatorError(f"pam-ukf: {error}") from error


def _held(openings: Array, before: float, age: int) -> tuple[Array, int]:
    """Hold each opening over a few missing ones; `age`, also returned, counts missing ones in a row so far."""
    known = np.isfinite(openings)
    index = np.arange(openings.size)
    last = np.maximum.accumulate(np.where(known, index, -1))
    ages = np.where(last >= 0, index - last, index + 1 + age)
    held = np.where(last >= 0, openings[last], before)
    return np.where(ages <= COMMAND_HELD, held, np.nan), int(ages[-1]) if ages.size else age


def _columns(count: int, *columns: Array) -> Array:
    if any(np.shape(c) != (count,) for c in columns):
        raise EstimatorError(f"pam-ukf: all signals need {count} samples, not {[np.shape(c) for c in columns]}")
    out = np.column_stack([np.asarray(c, dtype=np.float64) for c in columns])
    out[~np.isfinite(out)] = np.nan
    return out


def _steps(joint: PneumaticJoint, period: float) -> int:
    supply = joint.air.supply_pressure
    # Away from the middle the spring may be twice as stiff.
    stiffest = 2.0 * abs(float(pneu.trapped_stiffness(joint, 0.0, supply, supply))) + abs(joint.seesaw.return_stiffness)
    swing = np.sqrt(stiffest / joint.seesaw.inertia) if joint.seesaw.held_at is None else 0.0
    fill = max(filling_rates(joint)) / supply
    # Drift and kick make a stiffness off by (ω h)²/12 and, first order in filling, a pressure by half the square of what fills.
    needed = max(swing * (NEGLIGIBLE_SHARE * 12.0) ** -0.5, fill * (NEGLIGIBLE_SHARE * 2.0) ** -0.5) * period
    if not 0.0 < needed <= MOST_STEPS:
        raise EstimatorError(
            f"pam-ukf: a sample period of {period:g} s takes {needed:.3g} steps; are the rig's units right?"
        )
    return max(1, int(np.ceil(needed)))


@njit(error_model="numpy", forceinline=True)
def _volume(i: int, length: float, muscles: Array, least: Array) -> float:
    """Return the volume of eq. 3, not less than a small part of that at rest; see `muscle_volume`."""
    volume = (muscles[i, 1] * length + muscles[i, 2]) * length + muscles[i, 3]
    return float(volume if volume > least[i] else least[i])


@njit(error_model="numpy", forceinline=True)
def _squeezed(before: float, after: float, index: float) -> float:
    """Return (before/after)^index for volumes that differ little; off by some (difference/volume)³."""
    both, share = before + after, index * (before - after)
    return (both + share) / (both - share)


@njit(error_model="numpy")
def _fill(X: Array, first: int, u: Array, air: Array, muscles: Array, W: Array) -> None:
    """Write what flows into the muscles but for their volume, k₁ R T (m − leak) [Pa m³/s]; see `valve_flow`, `pressure_rate`."""
    for i in range(2):
        known, rate, opening = np.nan, 0.0, u[i]
        for j in range(first, X.shape[1]):
            pressure = X[i, j]
            if pressure != known and not np.isnan(opening):
                known = pressure
                outflow = _pneumatic_joint._flow(pressure, air[1], air)
                flow = opening * _pneumatic_joint._flow(air[0], pressure, air) - (1.0 - opening) * outflow
                flow *= muscles[i, 6] if flow > 0.0 else muscles[i, 7]
                rate = air[5] * air[2] * (flow - muscles[i, 5] * outflow)
            W[i, j] = rate


@njit(error_model="numpy")
def pam_transition(X: Array, first: int, u: Array, p: Any, Y: Array) -> None:
    """One step of the model for the columns X[:, first:], (P₁, P₂, ψ, ψ̇); u = (α₁, α₂, τ_ext).

    In passes over all points, since what each pass computes then overlaps.
    """
    air, muscles, seesaw, friction, least, h, held, W = p
    half_step, index, radius, z = 0.0 if held else 0.5 * h, air[6], seesaw[0], h / seesaw[1]
    l0, l1, points = muscles[0, 0], muscles[1, 0], X.shape[1]
    _fill(X, first, u, air, muscles, W)
    for j in range(first, points):
        middle = X[2, j] + half_step * X[3, j]
        W[2, j], W[3, j] = np.sin(middle), np.cos(middle)
    for j in range(first, points):
        # sin ψ before the drift, from that after it: the drift is a small part of a radian.
        half, sine, cosine = half_step * X[3, j], W[2, j], W[3, j]
        travel = radius * sine
        began = travel - radius * half * (cosine + 0.5 * half * (sine - half * cosine * (1.0 / 3.0)))
        v0, v1 = _volume(0, l0 - travel, muscles, least), _volume(1, l1 + travel, muscles, least)
        p0 = X[0, j] * _squeezed(_volume(0, l0 - began, muscles, least), v0, index)
        p1 = X[1, j] * _squeezed(_volume(1, l1 + began, muscles, least), v1, index)
        in_0, in_1 = h * W[0, j] / v0, h * W[1, j] / v1
        W[0, j], W[1, j], W[4, j], W[5, j] = p0 + in_0, p1 + in_1, v0, v1
        W[6, j], W[7, j] = p0 + 0.5 * in_0, p1 + 0.5 * in_1
    for j in range(first, points):
        travel, p0, p1 = radius * W[2, j], W[6, j], W[7, j]
        f1 = _pneumatic_joint._force(0, p0, l0 - travel, muscles, air[1])
        f2 = _pneumatic_joint._force(1, p1, l1 + travel, muscles, air[1])
        W[6, j], W[7, j] = f1 - f2, z * _pneumatic_joint._level(X[3, j], p0, p1, f1, f2, air, seesaw, friction)
    damping = 1.0 / (1.0 + z * friction[1])
    for j in range(first, points):
        middle, sine, cosine = X[2, j] + half_step * X[3, j], W[2, j], W[3, j]
        free = X[3, j] + z * (radius * cosine * W[6, j] - seesaw[2] * middle + u[2])
        # Eq. 10, as in `kikuuwe_friction`: the end of the kick obeys the friction.
        slip = abs(free) - W[7, j]
        slip = slip * damping if slip > 0.0 and not held else 0.0
        speed = slip if free > 0.0 else -slip
        half = half_step * speed
        travel = radius * sine
        ended = travel + radius * half * (cosine - 0.5 * half * (sine + half * cosine * (1.0 / 3.0)))
        Y[0, j] = W[0, j] * _squeezed(W[4, j], _volume(0, l0 - ended, muscles, least), index)
        Y[1, j] = W[1, j] * _squeezed(W[5, j], _volume(1, l1 + ended, muscles, least), index)
        Y[2, j], Y[3, j] = middle + half, speed


@njit(error_model="numpy")
def pam_observation(X: Array, first: int, u: Array, p: Any, Y: Array) -> None:
    """What is measured, (P₁, P₂)."""
    for j in range(first, X.shape[1]):
        Y[0, j], Y[1, j] = X[0, j], X[1, j]


_predict, _correct = ukf.unscented_filter(pam_transition, pam_observation)
_step_back = smoothing.unscented_smoother(pam_transition)


def _compiled(stamp: str) -> Callable[..., None]:
    @njit(cache=True, error_model="numpy")
    def run(
        z: Array, u: Array, choice: Any, x: Array, S: Array, surprise: Array, p: Any, steps: int, correct: bool,
        numbers: Any, room: Any, xs: Array, Ss: Array, nis: Array, diverged: Any,
    ) -> None:  # fmt: skip
        stamp  # noqa: B018  numba's cache tells functions apart by what they close over
        weights, SQ, SR, limits = numbers
        for k in range(z.shape[0]):
            for _ in range(steps):
                _predict(x, S, u[k], p, weights, SQ[choice[k]], room)
            square, used = 0.0, 0
            if correct:
                square, used, _ = _correct(x, S, z[k], u[k], p, weights, SR, room)
            ukf.keep(k, x, S, square, used, limits, surprise, xs, Ss, nis, diverged)

    return run


def _compiled_back(stamp: str) -> Callable[..., None]:
    @njit(cache=True, error_model="numpy")
    def back(
        x: Array, S: Array, u: Array, choice: Any, goes_on: Any, x_next: Array, S_next: Array, p: Any, steps: int, weights: Array,
        SQ: Array, room: Any,
    ) -> None:  # fmt: skip
        stamp  # noqa: B018  as in `run`
        for k in range(x.shape[0] - 1, -1, -1):
            if goes_on[k]:
                _step_back(x[k], S[k], x_next, S_next, u[k], p, steps, weights, SQ[choice[k]], room)
            x_next, S_next = x[k], S[k]

    return back


_run = _compiled(source_stamp(ukf, _pneumatic_joint))
_back = _compiled_back(source_stamp(ukf, smoothing, _pneumatic_joint))
