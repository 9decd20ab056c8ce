"""The noise of a deflection behind the filters of each equation, for the errors-in-variables bias."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from vsalog.core.precision import ROUNDING
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import TransmissionView
from vsalog.estimators.torque import lag_block
from vsalog.filters.conditioning import Conditioner
from vsalog.uncertainty.errors_in_variables import DeflectionNoise, RegressorNoise
from vsalog.uncertainty.sensor_error import ENOUGH, sensor_error

Array = NDArray[np.float64]


def noise_for_torque(signals: JointSignals, view: TransmissionView, conditioner: Conditioner) -> DeflectionNoise | None:
    """Return the noise in a fit to a torque that is measured or known; None where the filter depends on the motion."""
    if conditioner.kind == "kinematic":
        return None
    return noise_behind_filters(signals, view, conditioner.weights[0])


def noise_for_residual(
    signals: JointSignals,
    view: TransmissionView,
    conditioner: Conditioner,
    motor: tuple[float, float],
    bandwidth: float,
    matched: bool,
) -> DeflectionNoise | None:
    """Return the noise in a fit to the residual of the motor equation; None where the filter depends on the motion.

    Parameters
    ----------
    motor : reflected inertia [kg·m²] and damping [N·m·s/rad]
    bandwidth : K_I [rad/s]
    matched : whether the regressors pass through the residual's lag too
    """
    if conditioner.kind == "kinematic":
        return None
    (inertia, damping), turn = motor, bandwidth * signals.period
    # The lag is followed until only rounding is left of it, or for a good part of the samples that determine the noise.
    tail = min(int(np.ceil(-np.log(ROUNDING) * max(1.0 / turn, 1.0))), ENOUGH // 8)
    # The weights as the filter's response to a single sample, which the lag begins before.
    answers = np.concatenate((np.zeros((1, 2)), conditioner.weights[:2].T[::-1], np.zeros((tail, 2))))
    _, slow = lag_block(np.zeros((2, 2)), answers, np.ones(len(answers), dtype=np.bool_), bandwidth, signals.period)
    (position, velocity), (late, slower) = answers.T[:, ::-1], slow.T[:, ::-1]
    # Behind the lag θ̈ is K_I times what the lag takes from θ̇ (Flacco 2012 eq. 15).
    torque = inertia * bandwidth * (velocity - slower) + damping * slower
    return noise_behind_filters(signals, view, late if matched else position, torque, conditioner.window)


def noise_behind_filters(
    signals: JointSignals, view: TransmissionView, seen: Array, torque: Array | None = None, window: int | None = None
) -> DeflectionNoise:
    """Return the noise in a fit whose regressors and torque come out of filters.

    Parameters
    ----------
    seen : weights of the filter that the regressors pass
    torque : weights of the filter that computes a torque from the motor's position, as many; None where none is computed
    window : samples in the window of the short filters, where others have a long tail
    """
    roles = view.deflection_roles(signals.roles)
    errors = {role: sensor_error(signals.roles[role][:ENOUGH], window or seen.size) for role in roles}
    shared = (
        0.0
        if torque is None or view.motor_position not in errors
        else errors[view.motor_position].product(seen, torque)
    )
    return DeflectionNoise(sum(error.product(seen, seen) for error in errors.values()), abs(shared))


def noise_for_integral(
    signals: JointSignals, view: TransmissionView, conditioner: Conditioner
) -> DeflectionNoise | None:
    """Return the noise in a fit to an integrated equation, a step of the walk; None where the filter depends on the motion.

    Noise alone: rounding makes no random walk where a position moves, and where it rests see `quantisation.py`.
    """
    if conditioner.kind == "kinematic":
        return None
    roles = view.deflection_roles(signals.roles)
    errors = [sensor_error(signals.roles[role][:ENOUGH], conditioner.window) for role in roles]
    return DeflectionNoise(signals.period**2 * sum(error.white**2 + error.before**2 for error in errors))


def regressor_noise(parts: Sequence[DeflectionNoise | None], direct: Array | None = None) -> RegressorNoise | None:
    """Return the noise in an equation's regressors; None where that of a deflection is not known.

    Parameters
    ----------
    parts : of each transmission
    direct : shape (n,), variance of each regressor's own noise
    """
    known = tuple(part for part in parts if part is not None)
    return RegressorNoise(known, direct) if len(known) == len(parts) else None
