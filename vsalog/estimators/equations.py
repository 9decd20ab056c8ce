"""What is known to add up to what: the torque equation and the integrated motor equation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from vsalog.basis import PolynomialBasis
from vsalog.estimators.device import TransmissionView, deflection_of
from vsalog.estimators.regression import EquationRows
from vsalog.estimators.torque import integral_block, lag_block, residual_block
from vsalog.filters.conditioning import Conditioned

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


def _regressors(basis: PolynomialBasis, block: Conditioned, view: TransmissionView) -> Array:
    c = block.fit.get("setpoint") if basis.setpoint_order > 1 else None
    return basis.rows(deflection_of(block.fit, view), c, 0, block.loading_fit.get(view.name))[:, 0]


@dataclass(frozen=True, slots=True)
class TorqueEquation:
    """F(φ, c) α = τ_e (Flacco 2012 eq. 21) with a torque that is measured or computed at every sample.

    Several transmissions under one sensor add up: F(φ₁) α₁ + F(φ₂) α₂ = τ_e,t (eq. 9).
    """

    transmissions: tuple[TransmissionView, ...]
    basis: PolynomialBasis
    torque: Callable[[Conditioned], Array]

    leading: ClassVar[int] = 0
    parameters: ClassVar[tuple[str, ...]] = ()

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.basis.size * len(self.transmissions)

    def start(self) -> None:
        """Return the state before the first sample: there is none."""

    def rows(self, state: None, block: Conditioned) -> tuple[None, EquationRows]:
        """Form the equation for a block."""
        y = self.torque(block)
        F = np.hstack([_regressors(self.basis, block, t) for t in self.transmissions])
        use = block.use & np.isfinite(y) & np.isfinite(F).all(axis=1)
        # One sensor for several transmissions says nothing of each alone.
        alone = len(self.transmissions) == 1
        fed = {t.name: y if alone else np.full_like(y, np.nan) for t in self.transmissions}
        if not alone:
            fed["total"] = y
        return None, EquationRows(F, y, use, np.zeros_like(use), fed, {})


@dataclass(frozen=True, slots=True)
class ResidualEquation:
    """F(φ, c) α = r_e, the residual of the motor equation (Flacco 2012 eq. 15–17, 21).

    The residual is τ_e behind a first-order lag of bandwidth K_I. With `matched` the regressors pass through the same lag, so
    that the two sides belong together; the paper leaves them as they are.
    """

    view: TransmissionView
    basis: PolynomialBasis
    inertia: float
    damping: float
    bandwidth: float
    period: float
    matched: bool

    leading: ClassVar[int] = 0
    parameters: ClassVar[tuple[str, ...]] = ()

    @property
    def transmissions(self) -> tuple[TransmissionView, ...]:
        """The one transmission."""
        return (self.view,)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.basis.size

    def start(self) -> tuple[Array, Array]:
        """Return the states of residual and lag before the first sample."""
        return np.full(3, np.nan), np.full((2, self.basis.size), np.nan)

    def rows(self, state: tuple[Array, Array], block: Conditioned) -> tuple[tuple[Array, Array], EquationRows]:
        """Form the equation for a block."""
        view, fit = self.view, block.fit
        F = _regressors(self.basis, block, view)
        use = block.use & np.isfinite(F).all(axis=1)
        residual, r_e = residual_block(
            state[0],
            fit[view.motor_position],
            fit[f"velocity:{view.motor_position}"],
            fit[view.motor_torque],
            use,
            self.inertia,
            self.damping,
            self.bandwidth,
            self.period,
        )
        lag, lagged = lag_block(state[1], F, use, self.bandwidth, self.period)
        rows = EquationRows(
            lagged if self.matched else F,
            r_e,
            use,
            np.zeros_like(use),
            {view.name: r_e},
            {view.name: {"residual": r_e}},
        )
        return (residual, lag), rows


@dataclass(frozen=True, slots=True)
class IntegratedMotorEquation:
    """B θ̇ + D θ − Σ α_i ∫ f_i(φ) ds = ∫ τ ds + const (Flacco 2014 eq. 11), no motor parameter needed.

    The unknowns are the constant, B, D and α. The paper begins at rest in the origin, where the constant is zero; a log
    begins anywhere, and again after every gap.
    """

    view: TransmissionView
    basis: PolynomialBasis
    period: float

    leading: ClassVar[int] = 3
    parameters: ClassVar[tuple[str, ...]] = ("motor_inertia", "motor_damping")

    @property
    def transmissions(self) -> tuple[TransmissionView, ...]:
        """The one transmission."""
        return (self.view,)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return 3 + self.basis.size

    def start(self) -> Array:
        """Return the state of the integrals before the first sample."""
        return np.full((2, self.basis.size + 1), np.nan)

    def rows(self, state: Array, block: Conditioned) -> tuple[Array, EquationRows]:
        """Form the equation for a block."""
        view, fit = self.view, block.fit
        f = _regressors(self.basis, block, view)
        theta, velocity = fit[view.motor_position], fit[f"velocity:{view.motor_position}"]
        tau = fit[view.motor_torque]
        use = block.use & np.isfinite(f).all(axis=1)
        state, integrals, fresh = integral_block(state, np.column_stack((f, tau)), use, self.period)
        F = np.column_stack((np.ones_like(theta), velocity, theta, -integrals[:, :-1]))
        # B θ̈ + D θ̇ − τ = τ_e: what the equation says of the torque, where the filter gives an acceleration.
        acceleration = fit.get(f"acceleration:{view.motor_position}", np.full_like(theta, np.nan))
        dynamics = np.column_stack((np.zeros_like(theta), acceleration, velocity))
        fed = {view.name: -tau}
        return state, EquationRows(F, integrals[:, -1], use, fresh, fed, {}, dynamics)
