"""A torque that jumps between two samples: when it did, no sample tells.

A motor's torque that is switched has jumped somewhere between two samples. The trapezoidal rule takes the middle; the moment is
as likely any other, which leaves a sample of Δ/√12 unknown, however exact the sensor. An integral keeps that (`walk.py`); what
has a filter's memory has it in a pulse, and of a few pulses left-overs tell too little. What these make of the score Σ F e has
the covariance Σ Δ²/12 F Fᵀ.

A third difference is the whole jump at first; it is √20 times as large as white noise, and nearly nothing of what is smooth.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vsalog.core.resolution import sensor_noise
from vsalog.core.signals import JointSignals
from vsalog.estimators.device import TransmissionView
from vsalog.estimators.sensor_error import LEAST_NOISE

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Third differences of so many times what noise makes of them are jumps.
BEYOND = 5.0 * 20.0**0.5
# The next two show the rest of a jump, up to twice as large; what is larger is another one.
REST, ANOTHER = 2.0, 2.5


def jumps_start() -> Array:
    """Return the state before the first sample of a run."""
    return np.array([np.nan, np.nan, np.nan, 0.0, 0.0])


def torque_noise(signals: JointSignals, view: TransmissionView) -> float:
    """Return the standard deviation of a sample of a motor's torque [N·m]."""
    role = view.motor_torque
    return sensor_noise(signals.roles[role], signals.resolution.get(role, 0.0), LEAST_NOISE)


def jumps(state: Array, torque: Array, noise: float) -> tuple[Array, Array]:
    """Return what of a torque's jumps is not known.

    Parameters
    ----------
    state : of `jumps_start` or a previous call, shape (5,): three samples, the last jump, and how many show the rest of it
    torque : shape (N,), as it was measured [N·m]
    noise : its standard deviation [N·m]

    Returns
    -------
    state, and shape (N,), a variance at the first sample behind a jump, else zero [(N·m)²]
    """
    new, unknown = state.copy(), np.zeros(torque.size)
    _jumps(torque, BEYOND * noise, new, unknown)
    return new, unknown


@njit(cache=True, error_model="numpy", nogil=True)
def _jumps(torque: Array, least: float, s: Array, unknown: Array) -> None:
    for k in range(torque.size):
        jump = torque[k] - 3.0 * (s[2] - s[1]) - s[0]
        s[4] -= 1.0
        if abs(jump) > least and (s[4] < 0.0 or abs(jump) > ANOTHER * s[3]):
            unknown[k] = jump * jump / 12.0
            s[3], s[4] = abs(jump), REST
        s[0], s[1], s[2] = s[1], s[2], torque[k]


def jumped_block(state: Array, F: Array, use: Flags, unknown: Array, directions: Array) -> tuple[Array, Array]:
    """Say what jumps make of functionals.

    Parameters
    ----------
    state : shape (n, n), Σ Δ²/12 F Fᵀ so far
    F : shape (N, n), regressors
    use : shape (N,), rows that are learnt from
    unknown : shape (N,), of `jumps`, as late as F
    directions : shape (N, m, n), P times the functionals

    Returns
    -------
    state, and variances, shape (N, m)
    """
    new, made = state.copy(), np.zeros(directions.shape[:2])
    if state.any() or (unknown[use] > 0.0).any():
        _run(F, use, unknown, directions, new, made)
    return new, made


@njit(cache=True, error_model="numpy", nogil=True)
def _run(F: Array, use: Flags, unknown: Array, directions: Array, M: Array, made: Array) -> None:
    n = M.shape[0]
    for k in range(F.shape[0]):
        if use[k] and unknown[k] > 0.0:
            for i in range(n):
                for j in range(n):
                    M[i, j] += unknown[k] * F[k, i] * F[k, j]
        for m in range(directions.shape[1]):
            for i in range(n):
                along = 0.0
                for j in range(n):
                    along += M[i, j] * directions[k, m, j]
                made[k, m] += directions[k, m, i] * along
