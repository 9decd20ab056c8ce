"""The observer of De Luca, Schröder, Thümmel (ICRA 2007) for one elastic joint: eq. 6 and 7, derived again, exact over a sample.

With x = (θ, q, θ̇, q̇) and the motor equation B θ̈ + D_θ θ̇ + D (θ̇ − q̇) + K (θ − q) = τ − Sᵀ q̈, the observer follows

    ξ̇ = A ξ + (0, 0, 1/B, 0)ᵀ (τ − Sᵀ q̈) + (0, 0, 0, 1)ᵀ q̈ + L (θ − ξ₁)

with θ, τ and q̈ measured. The link's own dynamics appear nowhere, so the error e = x − ξ obeys ė = (A − L C) e whatever the link
is. The characteristic polynomial of A − L C is, with a = K/B, b = D/B and c = (D + D_θ)/B,

    λ⁴ + (c + L₁) λ³ + (a + c L₁ + L₃) λ² + (a L₂ + b L₄) λ + a L₄,

and comparing coefficients gives the gains. For D_θ = 0 they are those of the paper's remark 3.

Print of De Luca 2007: eq. 4's f₄ lacks the link's friction d(q, q̇) of eq. 1, which changes nothing, for q̈ measures f₄.
Comparing coefficients gives L₃ = a₂ − (D/B) a₃ + (D² − K B)/B²; whether the paper's last denominator is B or B² the text at hand
does not show. Motor friction is taken to be compensated; its viscous part D_θ is kept here. Eq. 9 adds g₀, which has to be −g: an
accelerometer at rest reads upwards.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class State(IntEnum):
    """Of motor and link."""

    MOTOR_POSITION, LINK_POSITION, MOTOR_VELOCITY, LINK_VELOCITY = range(4)


class Input(IntEnum):
    """θ, τ, q̈ and Sᵀ q̈."""

    ENCODER, TORQUE, ACCELERATION, CARRIED = range(4)


# Positions, velocities and the deflection, as rows over the state.
TOLD = np.vstack((np.eye(4), [-1.0, 1.0, 0.0, 0.0]))


class ElasticMotor(NamedTuple):
    """Motor and transmission of a joint, on the joint's side of the gear.

    Attributes
    ----------
    B : inertia [kg·m²]
    K, D : stiffness [N·m/rad] and damping [N·m·s/rad] of the transmission
    D_theta : viscous friction of the motor [N·m·s/rad]
    """

    B: float
    K: float
    D: float
    D_theta: float


class SampledObserver(NamedTuple):
    """ξ(k+1) = Phi ξ(k) + before u(k) + after u(k+1) with u = (θ, τ, q̈, Sᵀ q̈).

    Attributes
    ----------
    Phi, before, after : shape (4, 4)
    """

    Phi: Array
    before: Array
    after: Array


def characteristic(frequency: float, damping: float) -> Array:
    """Return a₃, a₂, a₁, a₀ of (λ² + 2 ζ ω λ + ω²)², shape (4,): all four eigenvalues at one frequency.

    Parameters
    ----------
    frequency : ω > 0 [rad/s]
    damping : ζ, 1 for four real eigenvalues −ω, less for two pairs that swing
    """
    pair = np.array([1.0, 2.0 * damping * frequency, frequency**2])
    return np.convolve(pair, pair)[1:]


def observer_gains(motor: ElasticMotor, polynomial: Array) -> Array:
    """Return L₁ … L₄, shape (4,), that give A − L C this characteristic polynomial (De Luca 2007, remark 3).

    Parameters
    ----------
    motor : B and K above 0
    polynomial : a₃, a₂, a₁, a₀
    """
    a3, a2, a1, a0 = polynomial
    a, b, c = motor.K / motor.B, motor.D / motor.B, (motor.D + motor.D_theta) / motor.B
    first = a3 - c
    last = a0 / a
    return np.array([first, (a1 - b * last) / a, a2 - a - c * first, last])


def error_matrix(motor: ElasticMotor, gains: Array) -> Array:
    """Return A − L C, shape (4, 4), by which the error decays (De Luca 2007, theorem 1)."""
    a, b, c = motor.K / motor.B, motor.D / motor.B, (motor.D + motor.D_theta) / motor.B
    A = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [-a, a, -c, b], [0.0, 0.0, 0.0, 0.0]])
    A[:, State.MOTOR_POSITION] -= gains
    return A


def sampled_observer(motor: ElasticMotor, gains: Array, period: float, held: bool = False) -> SampledObserver:
    """Return the observer over a sample, exact where θ and q̈ are linear between samples, and τ is, or is held.

    With the inputs and their rate as further states the exponential of one matrix holds all three.

    Parameters
    ----------
    motor, gains : of the observer
    period : T [s]
    held : whether a sample of τ holds until the next, as a digital drive's does
    """
    whole = np.zeros((12, 12))
    whole[:4, :4] = error_matrix(motor, gains)
    whole[:4, 4 + Input.ENCODER] = gains
    whole[State.MOTOR_VELOCITY, 4 + Input.TORQUE] = 1.0 / motor.B
    whole[State.LINK_VELOCITY, 4 + Input.ACCELERATION] = 1.0
    whole[State.MOTOR_VELOCITY, 4 + Input.CARRIED] = -1.0 / motor.B
    whole[4:8, 8:] = np.eye(4) / period
    from scipy.linalg import expm

    moved = expm(whole * period)
    before, after = moved[:4, 4:8] - moved[:4, 8:], moved[:4, 8:].copy()
    if held:
        before[:, Input.TORQUE] += after[:, Input.TORQUE]
        after[:, Input.TORQUE] = 0.0
    return SampledObserver(moved[:4, :4], before, after)


def error_variances(observer: SampledObserver, start: Array, count: int) -> Array:
    """Return the variances of the error from white noise of the inputs and an unknown start, sample after sample.

    With e(k) = z(k) + after w(k), z(k+1) = Phi z(k) + (Phi after + before) w(k), and w(k) independent of z(k), so that the
    covariance of z settles to the solution of a discrete Lyapunov equation, Z − Phi^k Z Phiᵀ^k after k samples.

    Parameters
    ----------
    observer : of `sampled_observer`
    start : shape (4,), standard deviations of the state at the first sample
    count : samples; the last row is the stationary one

    Returns
    -------
    shape (count, 5, 5): per source, the inputs with unit variance and the start, the variance of θ, q, θ̇, q̇ and q − θ
    """
    Phi, before, after = observer
    powers = np.empty((count, 4, 4))
    powers[0] = np.eye(4)
    for k in range(1, count):
        powers[k] = powers[k - 1] @ Phi
    powers[-1] = 0.0
    out = np.empty((count, 5, 5))
    for source in range(4):
        driven = (Phi @ after + before)[:, source]
        Z = _settled(Phi, np.outer(driven, driven))
        covariance = Z - powers @ Z @ powers.transpose(0, 2, 1) + np.outer(after[:, source], after[:, source])
        out[:, source] = np.einsum("ri,nij,rj->nr", TOLD, covariance, TOLD)
    out[:, 4] = np.sum((TOLD @ powers * start) ** 2, axis=2)
    return np.maximum(out, 0.0)


def error_powers(observer: SampledObserver, source: int, added: Array) -> Array:
    """Return the mean squares in θ, q, θ̇, q̇ and q − θ from an input's error, shape (5,): the error as it is, not white.

    Parameters
    ----------
    observer : of `sampled_observer`
    source : the input
    added : shape (N,), its error; it is taken as periodic
    """
    Phi, before, after = observer
    spectrum = np.fft.rfft(added)
    turn = np.exp(2j * np.pi * np.fft.rfftfreq(added.size))
    driven = (Phi @ after + before)[:, source]
    answers = np.linalg.solve(
        turn[:, None, None] * np.eye(4) - Phi, np.broadcast_to(driven[:, None], (turn.size, 4, 1))
    )
    states = (answers[:, :, 0] + after[:, source]) * spectrum[:, None]
    power = np.abs(states @ TOLD.T) ** 2
    # The other half of the spectrum is the mirror of this one.
    power[1 : (added.size + 1) // 2] *= 2.0
    return np.asarray(power.sum(axis=0) / added.size**2)


def _settled(Phi: Array, Q: Array) -> Array:
    """Return Z = Phi Z Phiᵀ + Q, that is Q + Phi Q Phiᵀ + …, by doubling the number of terms (Smith 1968).

    A solver of linear equations finds them ill-conditioned where the eigenvalues of a slow observer are all near 1.
    """
    Z, power = Q, Phi
    while np.abs(power).max() > 1e-20:
        Z, power = Z + power @ Z @ power.T, power @ power
    return Z
