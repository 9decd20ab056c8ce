"""The terms of equations and their sums: the torque equation and the integrated motor equation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from vsalog.core.basis import PolynomialBasis
from vsalog.estimators.device import TransmissionView, deflection_of
from vsalog.estimators.equation import EquationRows
from vsalog.estimators.function_roles import function_roles
from vsalog.estimators.known_effects import KnownEffects
from vsalog.estimators.torque import integral_block, lag_block, residual_block
from vsalog.filters.conditioning import Conditioned
from vsalog.uncertainty.errors_in_variables import RegressorNoise

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def regressors(basis: PolynomialBasis, block: Conditioned, view: TransmissionView, derivative: int = 0) -> Array:
    """Return the functions of the basis, or a derivative in φ, at each sample of a block, shape (N, n)."""
    if not derivative and (roles := function_roles(view, basis))[0] in block.fit:
        return np.column_stack([block.fit[role] for role in roles])
    c = block.fit.get("setpoint") if basis.has_setpoint else None
    return basis.rows(deflection_of(block.fit, view), c, derivative, block.loading_fit.get(view.name))[:, derivative]


class OfOneTransmission:
    """What equations of a single transmission share: the coefficients of its basis are all that is unknown."""

    __slots__ = ()

    view: TransmissionView
    basis: PolynomialBasis

    @property
    def transmissions(self) -> tuple[TransmissionView, ...]:
        """The one transmission."""
        return (self.view,)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.basis.size


@dataclass(frozen=True, slots=True)
class TorqueEquation:
    """F(φ, c) α = τ_e (Flacco 2012 eq. 21) with a torque that is measured or computed at every sample.

    Several transmissions under one sensor add up: F(φ₁) α₁ + F(φ₂) α₂ = τ_e,t (eq. 9). What the rig knows of their damping and
    hysteresis, `known`, is subtracted from the measured torque.
    """

    transmissions: tuple[TransmissionView, ...]
    basis: PolynomialBasis
    torque: Callable[[Conditioned], Array]
    known: tuple[KnownEffects, ...] = ()
    noise: RegressorNoise | None = None

    leading: ClassVar[int] = 0
    parameters: ClassVar[tuple[str, ...]] = ()

    @property
    def motor(self) -> None:
        """The torque is not computed from a motor's motion."""

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.basis.size * len(self.transmissions)

    def start(self) -> tuple[Array, ...]:
        """Return the state before the first sample: that of the hysteresis."""
        return tuple(known.start() for known in self.known)

    def rows(self, state: tuple[Array, ...], block: Conditioned) -> tuple[tuple[Array, ...], EquationRows]:
        """Form the equation for a block."""
        y, doubted = self.torque(block), None
        states = []
        for own, known in zip(state, self.known, strict=True):
            after, other, doubt = known.block(own, block)
            y = y - other
            states.append(after)
            doubted = doubt > 1.0 if doubted is None else doubted | (doubt > 1.0)
        if doubted is not None:
            y = np.where(doubted, np.nan, y)
        F = np.hstack([regressors(self.basis, block, t) for t in self.transmissions])
        use = block.use & np.isfinite(y) & np.isfinite(F).all(axis=1)
        # One sensor for several transmissions does not determine each alone.
        alone = len(self.transmissions) == 1
        fed = {t.name: y if alone else np.full_like(y, np.nan) for t in self.transmissions}
        if not alone:
            fed["total"] = y
        motor = self.transmissions[0].motor_position
        motion = (block.fit[motor], block.fit[f"velocity:{motor}"]) if motor in block.fit else None
        rows = EquationRows(F, y, use, np.zeros_like(use), fed, {}, doubted=doubted, noise=self.noise, motion=motion)
        return tuple(states), rows


@dataclass(frozen=True, slots=True)
class ResidualEquation(OfOneTransmission):
    """F(φ, c) α = r_e, the residual of the motor equation (Flacco 2012 eq. 15–17, 21).

    The residual is τ_e behind a first-order lag of bandwidth K_I. With `matched` the regressors pass through the same lag, so
    that the two sides belong together; the paper leaves them as they are. The rig's other effects, `known`: their torque
    is subtracted; where it is in doubt the residual is not known, nor until its lag has decayed.
    """

    view: TransmissionView
    basis: PolynomialBasis
    inertia: float
    damping: float
    bandwidth: float
    period: float
    matched: bool
    known: KnownEffects | None = None
    noise: RegressorNoise | None = None

    leading: ClassVar[int] = 0
    parameters: ClassVar[tuple[str, ...]] = ()

    @property
    def motor(self) -> tuple[float, float]:
        """Inertia [kg·m²] and damping [N·m·s/rad]."""
        return self.inertia, self.damping

    def start(self) -> tuple[Any, ...]:
        """Return the states of residual, regressors' lag, hysteresis and doubt's lag before the first sample."""
        known, lag = None if self.known is None else self.known.start(), np.full((2, self.basis.size), np.nan)
        return np.full(3, np.nan), lag, known, np.full((2, 1), np.nan)

    def rows(self, state: tuple[Any, ...], block: Conditioned) -> tuple[tuple[Any, ...], EquationRows]:
        """Form the equation for a block."""
        F = regressors(self.basis, block, self.view)
        use = block.use & np.isfinite(F).all(axis=1)
        residual, r_e, after, lagged_doubt = self._residual(state, block, use)
        lag, lagged = lag_block(state[1], F, use, self.bandwidth, self.period)
        doubted = None
        if self.known is not None and self.known.doubtful:
            doubted = lagged_doubt[1][:, 0] > 1.0
            r_e, use = np.where(doubted, np.nan, r_e), use & ~doubted
        rows = EquationRows(
            lagged if self.matched else F,
            r_e,
            use,
            np.zeros_like(use),
            {self.view.name: r_e},
            {self.view.name: {"residual": r_e}},
            doubted=doubted,
            noise=self.noise,
            motion=(block.fit[self.view.motor_position], block.fit[f"velocity:{self.view.motor_position}"]),
        )
        return (residual, lag, after, lagged_doubt[0]), rows

    def _residual(
        self, state: tuple[Any, ...], block: Conditioned, use: Flags
    ) -> tuple[Array, Array, Array | None, tuple[Array, Array]]:
        """Return state and values of the residual, the state of the hysteresis, and state and values of the doubt behind the lag.

        `use` is narrowed to where what is known is known.
        """
        view, fit, known = self.view, block.fit, self.known
        theta, velocity, tau = fit[view.motor_position], fit[f"velocity:{view.motor_position}"], fit[view.motor_torque]
        motor = (self.inertia, self.damping)
        if known is None:
            new, r_e = residual_block(state[0], theta, velocity, tau, use, *motor, self.bandwidth, self.period)
            return new, r_e, None, (state[3], np.empty((0, 1)))
        after, other, doubt = known.block(state[2], block)
        use &= np.isfinite(other)
        lagged = lag_block(state[3], doubt[:, None], use, self.bandwidth, self.period)
        loaded = (known.load, other, known.way(block)) if known.load > 0.0 else ()
        new, r_e = residual_block(
            state[0], theta, velocity, tau + other, use, *motor, self.bandwidth, self.period, *loaded
        )
        return new, r_e, after, lagged


@dataclass(frozen=True, slots=True)
class IntegratedMotorEquation(OfOneTransmission):
    """B θ̇ + D θ − Σ α_i ∫ f_i(φ) ds = ∫ τ ds + const (Flacco 2014 eq. 11), no motor parameter needed.

    The unknowns are the constant, B, D and α. The paper begins at rest in the origin, where the constant is zero; a log
    begins anywhere, and again after every gap. Other known effects, `known`, are subtracted from the torque before it is
    integrated; where it is in doubt the integrals begin again, as after a gap, because what was missed there would stay in them.

    Friction that grows with the transmitted torque, load · |τ_e| · way, goes with the unknowns: |τ_e| = τ_e sign φ, so that the
    f_i are multiplied with 1 − load · way · sign φ.
    """

    view: TransmissionView
    basis: PolynomialBasis
    period: float
    known: KnownEffects | None = None
    torque_noise: float = 0.0  # of a sample of the motor's torque, standard deviation [N·m]
    noise: RegressorNoise | None = None
    exact: bool = False  # whether the filter's acceleration is the derivative of its velocity

    leading: ClassVar[int] = 3
    parameters: ClassVar[tuple[str, ...]] = ("motor_inertia", "motor_damping")

    @property
    def motor(self) -> None:
        """Inertia and damping are unknowns here."""

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return 3 + self.basis.size

    def start(self) -> tuple[Array, Array | None, Array]:
        """Return the states of the integrals and of the hysteresis before the first sample, and that sample, which is none."""
        hysteresis = None if self.known is None else self.known.start()
        return np.full((2, self.basis.size + 1), np.nan), hysteresis, np.full((1, self.basis.size + 3), np.nan)

    def rows(self, state: tuple[Array, Array | None, Array], block: Conditioned) -> tuple[Any, EquationRows]:
        """Form the equation for a block."""
        view, fit, known = self.view, block.fit, self.known
        f = regressors(self.basis, block, view)
        theta, velocity = fit[view.motor_position], fit[f"velocity:{view.motor_position}"]
        tau, fed, after, doubted, factor = fit[view.motor_torque], None, None, None, None
        use = block.use & np.isfinite(f).all(axis=1)
        if known is not None and state[1] is not None:
            after, other, doubt = known.block(state[1], block)
            use &= np.isfinite(other)
            if known.doubtful:
                doubted = doubt > 1.0
                use &= ~doubted
            if known.load > 0.0:
                factor = 1.0 - known.load * known.way(block) * np.sign(deflection_of(fit, view))
                fed = -tau / factor - other
                tau, f = tau + factor * other, factor[:, None] * f
            else:
                tau = tau + other
        integrated, integrals, fresh = integral_block(state[0], np.column_stack((f, tau)), use, self.period)
        F = np.column_stack((np.ones_like(theta), velocity, theta, -integrals[:, :-1]))
        # B θ̈ + D θ̇ − τ = τ_e: the torque by the equation, where the filter gives an acceleration.
        acceleration = fit.get(f"acceleration:{view.motor_position}", np.full_like(theta, np.nan))
        dynamics = np.column_stack((np.zeros_like(theta), acceleration, velocity))
        fed = -tau if fed is None else fed
        if factor is not None:
            dynamics /= factor[:, None]
        if doubted is not None:
            fed = np.where(doubted, np.nan, fed)
        fed_to = {view.name: fed}
        seen = np.vstack((state[2], np.where(use[:, None], np.column_stack((velocity, theta, f, tau)), np.nan)))
        # Where rates are not exact, from sample to sample by the trapezoidal rule: the change of the speed, the mean of all else.
        change, mean = np.diff(seen, axis=0) / self.period, 0.5 * (seen[1:] + seen[:-1])
        if self.exact:
            change, mean = np.column_stack((acceleration, velocity)), seen[1:]
        plain = np.column_stack((np.zeros_like(theta), change[:, :2], -mean[:, 2:-1])), mean[:, -1]
        rows = EquationRows(
            F, integrals[:, -1], use, fresh, fed_to, {}, dynamics, doubted, self.noise,
            walk_step=(self.period * self.torque_noise) ** 2, motion=(theta, velocity), plain=plain,
        )  # fmt: skip
        return (integrated, after, seen[-1:]), rows
