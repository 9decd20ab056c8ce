"""algebraic: operational calculus on the motor's side, non-causal FIR filters, and recursive least squares.

Ménard, Grioli, Bicchi, "A real time robust observer for an agonist-antagonist variable stiffness actuator", ICRA 2013, as Flacco,
De Luca, ICRA 2014 (§I, §VI) describes it: no derivative is taken. The motor equation is multiplied by a function w of time that
vanishes, with its derivatives, at both ends of a window, and integrated over the window; by parts, the derivatives go to w:

    ∫ (B ẅ − D ẇ) θ ds − ∫ w τ ds = Σ α_i ∫ w f_i(φ) ds

Each integral is a FIR filter of the recorded signals. Both sides belong to the same window, so that no delay separates them.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from msgspec import Meta
from numba import njit
from numpy.typing import NDArray

from vsalog.core.basis import PolynomialBasis
from vsalog.core.errors import EstimatorError, FilterError
from vsalog.core.signals import LONGER, JointSignals
from vsalog.estimators.device import Device, TransmissionView, deflection_of
from vsalog.estimators.equation import EquationRows
from vsalog.estimators.equations import OfOneTransmission, regressors
from vsalog.estimators.known_effects import KnownEffects, conditioner_of, known_of
from vsalog.estimators.needs import torque_roles
from vsalog.estimators.regression import RegressionFold
from vsalog.estimators.regressor_noise import noise_behind_filters
from vsalog.estimators.screening import screened
from vsalog.estimators.solvers import FEWEST_WINDOWS, RlsSolver, least_samples
from vsalog.estimators.tuning import RlsTuning, Seconds
from vsalog.filters.conditioning import Conditioned, Conditioner
from vsalog.uncertainty.errors_in_variables import RegressorNoise
from vsalog.uncertainty.long_run import BOX

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

NAME = "algebraic"
SUMMARY = "operational calculus and FIR filters on the motor's side (Ménard 2013); needs the motor's inertia, takes no derivative"

# w = (s (1 − s))^POWER on 0 ≤ s ≤ 1 [1]: its first two derivatives vanish at the ends too.
POWER = 3


class AlgebraicTuning(RlsTuning, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Tuning of algebraic.

    Attributes
    ----------
    span : length of the FIR filters [s]: longer suppresses more noise, shorter follows faster changes of the stiffness
    """

    default_window: ClassVar[int] = 11

    degree: Annotated[int, Meta(ge=1, le=30)] = 3
    span: Seconds = 0.15


TUNING = AlgebraicTuning


def roles(device: Device, offered: Collection[str], tuning: AlgebraicTuning) -> tuple[str, ...]:
    """Return the roles the method reads of what the rig offers; raises EstimatorError for a missing one."""
    return torque_roles(NAME, device, offered, "RESIDUAL")


def build(device: Device, signals: JointSignals, tuning: AlgebraicTuning) -> RegressionFold:
    """Assemble the estimator for a joint's signals.

    Raises
    ------
    EstimatorError
        The rig does not give a motor's inertia.
    FilterError
        The span holds too few samples, or no stretch without a gap is as long.
    """
    taps = round(tuning.span / signals.period) + 1
    _check_span(signals, tuning.span, taps)
    weights = fir_weights(taps, signals.period)
    look = screened(device, signals, tuning)
    conditioner = conditioner_of(device, signals, tuning, roles(device, signals.roles, tuning), motor=True)
    equations = tuple(_equation(device, view, signals, tuning, weights, conditioner) for view in device.transmissions)
    # Within a span residuals are correlated, as within a filter's window.
    least = least_samples(conditioner) + FEWEST_WINDOWS * taps
    solver = RlsSolver(
        tuning.initial_covariance(device, signals, 0.01, second=True), tuning.c, least, max(BOX, taps // 4)
    )
    return RegressionFold(NAME, "RESIDUAL", device, conditioner, equations, solver, look=look, memory=taps)


def fir_weights(taps: int, period: float) -> Array:
    """Return the filters ∫ w x, −∫ ẇ x and ∫ ẅ x, shape (3, taps), oldest sample first, with ∫ w = 1.

    The sums are corrected so that they are exact on polynomials: value and weight of a constant, slope of a line, curvature of a
    parabola, and nothing of lower degrees. Units 1, 1/s and 1/s².
    """
    s = np.linspace(0.0, 1.0, taps)
    t = (s - 0.5) * (taps - 1) * period
    bump = np.polynomial.Polynomial([0.0, 1.0, -1.0]) ** POWER
    value = bump(s) / bump(s).sum()
    slope = -bump.deriv(1)(s)
    slope = (slope - slope.mean()) / float((slope - slope.mean()) @ t)
    curve = bump.deriv(2)(s)
    curve = curve - curve.mean()
    return np.stack([value, slope, curve / float(curve @ (0.5 * t**2))])


def _check_span(signals: JointSignals, span: float, taps: int) -> None:
    longest = signals.longest_run
    if taps <= 2 * POWER:
        least = 2 * POWER * signals.period
        raise FilterError(
            f"{NAME}: a span of {span:.3g} s holds {taps} samples at {1.0 / signals.period:.4g} Hz, which is too few; give"
            f" --tune span={least:.2g} or more"
        )
    if taps > longest:
        raise FilterError(
            f"{NAME}: the longest stretch without a gap has {longest} samples, but the FIR filters of {span:.3g} s need {taps};"
            f" {LONGER}, or shorten them with --tune span=SECONDS"
        )


def _equation(
    device: Device,
    view: TransmissionView,
    signals: JointSignals,
    tuning: AlgebraicTuning,
    weights: Array,
    conditioner: Conditioner,
) -> AlgebraicEquation:
    inertia = view.motor.reflected_inertia
    if inertia is None:
        motor = "motor" if len(device.transmissions) == 1 else f"motor_{view.name}"
        raise EstimatorError(
            f"joint '{device.joint}': {NAME} needs the motor's inertia: set [joint.{device.joint}.{motor}] inertia in the rig, or"
            " use --estimator qr-rls, which estimates it"
        )
    known = known_of(device, view, signals, tuning, view.motor_torque, motor=True)
    damping = view.motor.reflected_damping
    noise = None
    if conditioner.kind != "kinematic":
        before = conditioner.weights[0]
        both = np.convolve(before, weights[0]), np.convolve(before, inertia * weights[2] + damping * weights[1])
        noise = RegressorNoise((noise_behind_filters(signals, view, *both),))
    return AlgebraicEquation(view, device.basis, inertia, damping, weights, known, noise)


@dataclass(frozen=True, slots=True)
class AlgebraicEquation(OfOneTransmission):
    """Σ α_i ∫ w f_i(φ) = ∫ (B ẅ − D ẇ) θ − ∫ w τ over a window that ends at each sample.

    The rig's other effects, `known`, are subtracted; where they are in doubt the window is not used.
    """

    view: TransmissionView
    basis: PolynomialBasis
    inertia: float
    damping: float
    weights: Array
    known: KnownEffects | None = None
    noise: RegressorNoise | None = None

    leading: ClassVar[int] = 0
    parameters: ClassVar[tuple[str, ...]] = ()

    @property
    def motor(self) -> tuple[float, float]:
        """Inertia [kg·m²] and damping [N·m·s/rad]."""
        return self.inertia, self.damping

    def start(self) -> tuple[Array, float, Any]:
        """Return what the filters hold before the first sample, the angle a run begins at, and the state of the hysteresis."""
        held = np.full((self.weights.shape[1] - 1, self.basis.size + 2), np.nan)
        return held, np.nan, None if self.known is None else self.known.start()

    def rows(
        self, state: tuple[Array, float, Any], block: Conditioned
    ) -> tuple[tuple[Array, float, Any], EquationRows]:
        """Form the equation for a block."""
        f = regressors(self.basis, block, self.view)
        theta, tau = block.fit[self.view.motor_position], block.fit[self.view.motor_torque]
        use, after, doubted = block.use & np.isfinite(f).all(axis=1), state[2], None
        if self.known is not None:
            after, other, doubt = self.known.block(state[2], block)
            doubted = doubt > 1.0 if self.known.doubtful else None
            use &= np.isfinite(other) & (doubt <= 1.0)
            if self.known.load > 0.0:  # |τ_e| = τ_e sign φ goes with the unknowns
                factor = 1.0 - self.known.load * self.known.way(block) * np.sign(deflection_of(block.fit, self.view))
                f, other = factor[:, None] * f, factor * other
            tau = tau + other
        held, origin = state[0], state[1]
        if block.rows.starts[0]:
            held, origin = np.full_like(held, np.nan), np.nan
        if np.isnan(origin) and use.any():
            # Filters remove a constant, but a large one only to rounding.
            origin = float(theta[np.argmax(use)])
        inputs = np.where(use[:, None], np.column_stack((f, theta - origin, tau)), np.nan)
        joined = np.concatenate((held, inputs))
        filtered = np.column_stack([_filtered(x, self.weights[0]) for x in joined[:, :-2].T])
        angle, torque = joined[:, -2:].T
        moved = _filtered(angle, self.inertia * self.weights[2] + self.damping * self.weights[1])
        y = moved - _filtered(torque, self.weights[0])
        use = np.isfinite(y) & np.isfinite(filtered).all(axis=1)
        rows = EquationRows(
            filtered,
            y,
            use,
            np.zeros_like(use),
            {self.view.name: np.full_like(y, np.nan)},
            {self.view.name: {"residual": y}},
            doubted=doubted,
            noise=self.noise,
            motion=(_filtered(angle, self.weights[0]), _filtered(angle, self.weights[1])),
        )
        return (joined[joined.shape[0] - held.shape[0] :].copy(), origin, after), rows


def _filtered(x: Array, weights: Array) -> Array:
    """Return Σ_j weights[j] x[k + j]: shape (N − taps + 1,)."""
    out = np.zeros(x.size - weights.size + 1)
    _add_up(np.ascontiguousarray(x), weights, out)
    return out


@njit(cache=True, nogil=True)
def _add_up(x: Array, weights: Array, out: Array) -> None:
    # Tap by tap: the order in which a sum is formed is the same however the log is cut, and the inner loop is parallel.
    for j in range(weights.size):
        for k in range(out.size):
            out[k] += weights[j] * x[k + j]
