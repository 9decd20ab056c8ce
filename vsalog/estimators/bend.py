"""What noise in regressors bends a fit by that takes them for exact: errors in variables, to first order.

Where a deflection's noise e enters the regressors F as ∂F/∂φ e and the torque y as ε, the normal equations are off by what
does not average out, Σ ∂F/∂φ (E[e ε] − E[e²] σ) with the stiffness σ: noise of the deflection itself makes a spring look softer,
and noise of a motor's encoder, which the motor equation differentiates twice, makes it look stiffer. Both are counted as if they
never cancelled.
(Söderström, "Errors-in-variables methods in system identification", Automatica 43(6), 2007.)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.estimators.device import TransmissionView
from vsalog.estimators.sensor_error import ENOUGH, sensor_error
from vsalog.estimators.torque import lag_block
from vsalog.filters.conditioning import Conditioner
from vsalog.signals import JointSignals

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

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


def bent_block(
    state: Array, slopes: Array, bends: Sequence[Bend], unknowns: Array, use: Flags, discount: float
) -> tuple[Array, Array]:
    """Sum up what noise adds to the normal equations.

    Parameters
    ----------
    state : shape (n,), the sum so far
    slopes : shape (N, transmissions, n), ∂F/∂φ of each transmission at each sample
    bends : of each transmission
    unknowns : shape (N, n)
    use : shape (N,), samples that are learnt from
    discount : what a sample's weight is multiplied with in the next

    Returns
    -------
    state, and the sum after each sample, shape (N, n)
    """
    added = np.zeros_like(unknowns)
    for i, bend in enumerate(bends):
        stiffness = np.abs((slopes[:, i] * unknowns).sum(axis=1))
        added += slopes[:, i] * (bend.own * stiffness + bend.shared)[:, None]
    added[~(use & np.isfinite(added).all(axis=1))] = 0.0
    summed = np.empty_like(added)
    _sum_up(added, discount, state, summed)
    return summed[-1].copy() if len(summed) else state, summed


@njit(cache=True, nogil=True)
def _sum_up(added: Array, discount: float, state: Array, summed: Array) -> None:
    for k in range(added.shape[0]):
        for i in range(added.shape[1]):
            before = state[i] if k == 0 else summed[k - 1, i]
            summed[k, i] = discount * before + added[k, i]
