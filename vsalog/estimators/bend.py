"""What noise in regressors bends a fit by that takes them for exact: errors in variables.

Where a deflection's noise e enters the regressors F as f' e, f' = ∂F/∂φ, and the torque y as ε, the normal equations are off by
what does not average out, Σ f' E[e ε] − H ξ with the noise's own energy H = Σ E[e²] f' f'ᵀ: noise of the deflection itself makes
a spring look softer, and noise of a motor's encoder, which the motor equation differentiates twice, makes it look stiffer. Both
are counted as if they never cancelled. What is estimated has been bent already: where r is the part of a functional's information
that is noise, what bends it is 1/(1 − r) times what the estimate says. What leaves a functional as it is by chance leaves it by
the next order, r of itself.
(Söderström, "Errors-in-variables methods in system identification", Automatica 43(6), 2007.)

In an integral noise becomes a walk, which goes on in all samples after it, less its mean, which the integration constant takes
up. With the weights w_k of the fit and W_j = Σ_{k≥j} w_k, an e_j has the energy W_j − W_j²/W of the run's W.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.core.signals import JointSignals
from vsalog.estimators.device import TransmissionView
from vsalog.estimators.sensor_error import ENOUGH, sensor_error
from vsalog.estimators.torque import lag_block
from vsalog.filters.conditioning import Conditioner

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Noise that is this part of a functional's information or more leaves nothing known of it.
MOST = 0.5
# A lag is followed until this part of it is left, or for so many samples.
FORGOTTEN, LONGEST = 1e-6, ENOUGH // 8


@dataclass(frozen=True, slots=True)
class Bend:
    """Noise of one transmission's deflection behind the filters.

    Attributes
    ----------
    own : its variance [rad²]
    shared : size of its covariance with the noise of the torque it is fitted to [rad·N·m]
    """

    own: float
    shared: float = 0.0


def bend_of_torque(signals: JointSignals, view: TransmissionView, conditioner: Conditioner) -> Bend | None:
    """Return what bends a fit to a torque that is measured or known; None where the filter depends on the motion."""
    if conditioner.kind == "kinematic":
        return None
    return bend_of_filters(signals, view, conditioner.weights[0])


def bend_of_residual(
    signals: JointSignals,
    view: TransmissionView,
    conditioner: Conditioner,
    motor: tuple[float, float],
    bandwidth: float,
    matched: bool,
) -> Bend | None:
    """Return what bends a fit to the residual of the motor equation; None where the filter depends on the motion.

    Parameters
    ----------
    motor : reflected inertia [kg·m²] and damping [N·m·s/rad]
    bandwidth : K_I [rad/s]
    matched : whether the regressors pass through the residual's lag too
    """
    if conditioner.kind == "kinematic":
        return None
    (inertia, damping), turn = motor, bandwidth * signals.period
    tail = min(int(np.ceil(-np.log(FORGOTTEN) * max(1.0 / turn, 1.0))), LONGEST)
    # The weights as the filter's answer to a single sample, which the lag begins before.
    answers = np.concatenate((np.zeros((1, 2)), conditioner.weights[:2].T[::-1], np.zeros((tail, 2))))
    _, slow = lag_block(np.zeros((2, 2)), answers, np.ones(len(answers), dtype=np.bool_), bandwidth, signals.period)
    (position, velocity), (late, slower) = answers.T[:, ::-1], slow.T[:, ::-1]
    # Behind the lag θ̈ is K_I times what the lag takes from θ̇ (Flacco 2012 eq. 15).
    torque = inertia * bandwidth * (velocity - slower) + damping * slower
    return bend_of_filters(signals, view, late if matched else position, torque, conditioner.window)


def bend_of_filters(
    signals: JointSignals, view: TransmissionView, seen: Array, torque: Array | None = None, window: int | None = None
) -> Bend:
    """Return what bends a fit whose regressors and torque come out of filters.

    Parameters
    ----------
    seen : weights of the filter that the regressors pass
    torque : weights of the filter that makes a torque of the motor's position, as many; None where none is made of it
    window : samples in the window of what of the filters is short, where they have a long tail
    """
    roles = view.deflection_roles(signals.roles)
    errors = {role: sensor_error(signals.roles[role][:ENOUGH], window or seen.size) for role in roles}
    shared = (
        0.0
        if torque is None or view.motor_position not in errors
        else errors[view.motor_position].product(seen, torque)
    )
    return Bend(sum(error.product(seen, seen) for error in errors.values()), abs(shared))


def bend_of_integral(signals: JointSignals, view: TransmissionView, conditioner: Conditioner) -> Bend | None:
    """Return what bends a fit to an integrated equation, a step of the walk; None where the filter depends on the motion.

    Noise alone: rounding does not walk where a position moves, and where it rests see `resting.py` and `coarser.py`.
    """
    if conditioner.kind == "kinematic":
        return None
    roles = view.deflection_roles(signals.roles)
    errors = [sensor_error(signals.roles[role][:ENOUGH], conditioner.window) for role in roles]
    return Bend(signals.period**2 * sum(error.white**2 + error.before**2 for error in errors))


class BentState(NamedTuple):
    """What noise adds to the normal equations, for n unknowns.

    Attributes
    ----------
    energy : shape (n, n), H; of the runs before where the equation is an integral
    shared : shape (n,), Σ f' E[e ε]
    steps, once, twice : shape (n, n), of the run Σ E[e²] f' f'ᵀ, and the same times W_j and times W_j²
    weight : shape (1,), W of the run
    """

    energy: Array
    shared: Array
    steps: Array
    once: Array
    twice: Array
    weight: Array

    def covariance(self, unknowns: Array) -> Array:
        """Return the square of what the normal equations are off by, shape (n, n)."""
        H = np.empty_like(self.energy)
        _whole(self, H)
        off = H @ unknowns
        return np.outer(off, off) + np.outer(self.shared, self.shared)


def bent_start(n: int) -> BentState:
    """Return the state before the first sample, for n unknowns."""
    energy, steps, once, twice = (np.zeros((n, n)) for _ in range(4))
    return BentState(energy, np.zeros(n), steps, once, twice, np.zeros(1))


def bent_block(
    state: BentState,
    bends: Sequence[Bend],
    E: Array,
    T: Array,
    unknowns: Array,
    values: Array,
    use: Flags,
    fresh: Flags,
    integral: bool,
    discount: float,
) -> tuple[BentState, Array]:
    """Say what noise in regressors bends functionals of the unknowns by.

    Parameters
    ----------
    state : of `bent_start` or a previous call
    bends : of each transmission
    E : shape (N, m, n), functionals, the first those of each transmission's stiffness, f'
    T : shape (N, m, n), P E
    unknowns, values : shapes (N, n) and (N, m), ξ̂ and E ξ̂
    use, fresh : shape (N,), samples that are learnt from, and where an integral begins anew
    integral : whether the equation is an integral
    discount : what a sample's weight is multiplied with in the next

    Returns
    -------
    state, and shape (N, m); infinite where most of what is known is noise, NaN while nothing is
    """
    new, bent = BentState._make(x.copy() for x in state), np.empty(T.shape[:2])
    own, shared = np.array([b.own for b in bends]), np.array([b.shared for b in bends])
    # Functionals picked from others lie strided in memory, which makes the loop several times as slow.
    E, values = np.ascontiguousarray(E), np.ascontiguousarray(values)
    _run(new, own, shared, E, T, unknowns, values, use, fresh, integral, discount, bent)
    return new, bent


@njit(cache=True, error_model="numpy", nogil=True)
def _run(
    s: BentState, own: Array, shared: Array, E: Array, T: Array, unknowns: Array, values: Array, use: Flags, fresh: Flags,
    integral: bool, discount: float, bent: Array,
) -> None:  # fmt: skip
    count, asked, n = T.shape
    H = np.empty((n, n)) if integral else s.energy
    for k in range(count):
        if integral and fresh[k]:
            _close(s)
        if use[k]:
            _add(s, own, shared, E[k], integral, discount)
        if integral:
            _whole(s, H)
        for m in range(asked):
            off, beside, noise, all_of_it = 0.0, 0.0, 0.0, 0.0
            for i in range(n):
                t, row = T[k, m, i], 0.0
                for j in range(n):
                    row += H[i, j] * T[k, m, j]
                off += row * unknowns[k, i]
                noise += row * t
                beside += t * s.shared[i]
                all_of_it += t * E[k, m, i]
            part = noise / all_of_it if noise > 0.0 else 0.0
            first = (abs(off) + abs(beside)) / (1.0 - min(part, MOST))
            bent[k, m] = np.hypot(first, part * values[k, m]) if not part >= MOST else np.inf


@njit(cache=True, error_model="numpy", nogil=True)
def _add(s: BentState, own: Array, shared: Array, slopes: Array, integral: bool, discount: float) -> None:
    """Add a sample that is learnt from, unless its slopes are not known."""
    n = s.shared.size
    for r in range(own.size):
        for i in range(n):
            if not np.isfinite(slopes[r, i]):
                return
    if discount != 1.0:
        s.shared[:] *= discount
        s.energy[:] *= discount
    into = s.steps if integral else s.energy
    for r in range(own.size):
        for i in range(n):
            s.shared[i] += shared[r] * slopes[r, i]
            for j in range(n):
                into[i, j] += own[r] * slopes[r, i] * slopes[r, j]
    if integral:
        for i in range(n):
            for j in range(n):
                once, steps = discount * s.once[i, j], s.steps[i, j]
                s.twice[i, j] = discount**2 * s.twice[i, j] + 2.0 * once + steps
                s.once[i, j] = once + steps
        s.weight[0] = discount * s.weight[0] + 1.0


@njit(cache=True, error_model="numpy", nogil=True)
def _whole(s: BentState, H: Array) -> None:
    """Write H of all runs."""
    H[:] = s.energy
    if s.weight[0] > 0.0:
        H += s.once - s.twice / s.weight[0]


@njit(cache=True, error_model="numpy", nogil=True)
def _close(s: BentState) -> None:
    """End a run: the noise of an integral does not go on into the next."""
    if s.weight[0] > 0.0:
        s.energy[:] += s.once - s.twice / s.weight[0]
    s.steps[:] = 0.0
    s.once[:] = 0.0
    s.twice[:] = 0.0
    s.weight[0] = 0.0
