"""What an equation gives a solver, and what either has to offer to the fold that strings them together (`regression.py`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from vsalog.core.region import NEGLIGIBLE_SHARE as NEGLIGIBLE_SHARE
from vsalog.estimators.device import TransmissionView
from vsalog.filters.conditioning import Conditioned
from vsalog.uncertainty.errors_in_variables import RegressorNoise

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# A stiffness counts as excited when its standard deviation is below this share of it [1]; a negative one never does.
SUPPORTED_SHARE = 0.2
# A change of a stiffness or an inertia is reported beyond this share of it [1]: rigs and springs are hardly known better.
REPORTED_CHANGE = 0.03
# A residual of a torque, an angle, a rate or a stiffness is reported beyond this share of it [1]: sensors are
# hardly more accurate.
REPORTED_MISFIT = 0.05
# A property of less than this share of a log is no property of the log [1].
MOST_OF_LOG = 0.5
# Unknown of an equation: the relative error of its torque's gain.
GAIN = "gain"


def power_kept(share: float) -> float:
    """Return which part of a motion's power is left where its amplitude loses a share."""
    return (1.0 - share) ** 2


class Part(NamedTuple):
    """One of several equations of the same coefficients.

    Attributes
    ----------
    columns : shape (N, c), the regressors of the coefficients, those of unknowns of its own, and what they add up to
    use : shape (N,), samples to learn from
    slopes : shape (N, coefficients), derivatives of the coefficients' regressors in the deflection
    """

    columns: Array
    use: Flags
    slopes: Array


@dataclass(frozen=True, slots=True)
class EquationRows:
    """A block of an equation F ξ = y, linear in the unknowns ξ.

    `fresh` marks where the first unknown begins again (an integration constant); `fed` is, per transmission or in ``total``,
    the flexibility torque the estimator is fed with; `extra` are further columns of the trace, per transmission. Where the
    leading unknowns are parameters of the motor, the flexibility torque is `dynamics` times these unknowns plus `fed`. `doubted`
    marks where known effects other than the springs are in doubt, so that these samples are not used; None where they never are.
    `noise` is that of the regressors, where it is known, which biases a fit (`errors_in_variables.py`). `walk_step` is the
    variance of a step of the random walk that a torque's noise becomes in an integrated y (`integrated_noise.py`), None where y
    is no integral. `motion` is the motor's position and speed, as late as F: a residual may follow them (`residual_motion.py`).
    `plain` is F and y before they were integrated, None where they are no integrals. `parts` are several equations of the same
    coefficients.
    """

    F: Array
    y: Array
    use: Flags
    fresh: Flags
    fed: Mapping[str, Array]
    extra: Mapping[str, Mapping[str, Array]]
    dynamics: Array | None = None
    doubted: Flags | None = None
    noise: RegressorNoise | None = None
    walk_step: float | None = None
    motion: tuple[Array, Array] | None = None
    plain: tuple[Array, Array] | None = None
    parts: tuple[Part, ...] = ()


class Equation(Protocol):
    """The terms of an equation and their sum, for one or more transmissions."""

    @property
    def leading(self) -> int:
        """Unknowns before the coefficients of the first basis."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the last of these unknowns, where they have a column."""

    @property
    def motor(self) -> tuple[float, float] | None:
        """Inertia [kg·m²] and damping [N·m·s/rad] of the rig's motor, where the torque is computed from its motion."""

    @property
    def transmissions(self) -> tuple[TransmissionView, ...]:
        """The transmissions of the equation."""

    @property
    def size(self) -> int:
        """Number of unknowns."""

    def start(self) -> Any:
        """Return the state before the first sample."""

    def rows(self, state: Any, block: Conditioned) -> tuple[Any, EquationRows]:
        """Form the equation for a block."""


class Solver(Protocol):
    """How the unknowns are found."""

    @property
    def p0(self) -> float:
        """Prior covariance of the coefficients, infinite for none."""

    def start(self, size: int) -> Any:
        """Return the state before the first sample."""

    def block(
        self, state: Any, rows: EquationRows, use: Flags, E: Array, spread: Flags
    ) -> tuple[Any, Array, Array, Array, Mapping[str, Array]]:
        """Learn from a block; return state, values (N, q) and variances (N, q) of E ξ̂, ξ̂ (N, n) and extra columns."""

    def solution(self, state: Any) -> tuple[Array, Array, float]:
        """Return ξ̂ (n,), its covariance (n, n) and the noise seen in y (standard deviation)."""
