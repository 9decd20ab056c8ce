"""Errors-in-variables bias: the effect of noise in regressors on a fit that takes them as exact.

Where a deflection's noise e enters the regressors F as f' e, f' = ∂F/∂φ, and the torque y as ε, the normal equations are off by
the terms that do not average out, Σ f' E[e ε] − H ξ with the noise's own energy H = Σ E[e²] f' f'ᵀ: noise of the deflection
itself makes a spring look softer, and noise of a motor's encoder, which the motor equation differentiates twice, makes it look
stiffer. Both are counted as if they never cancelled. The estimate itself is biased already: where r is the part of a functional's
information that is noise, the bias is 1/(1 − r) times the estimate, with the largest r of all functionals, for each is a
combination of the same unknowns. Noise that happens not to change a functional changes it in the next order, by r of itself.
(Söderström, "Errors-in-variables methods in system identification", Automatica 43(6), 2007.)

In an integral noise becomes a random walk, which goes on in all samples after it, less its mean, which the integration constant
takes up. With the weights w_k of the fit and W_j = Σ_{k≥j} w_k, an e_j has the energy W_j − W_j²/W of the run's W.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vsalog.core.compiled import compiled

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Noise that is this part of a rate, of a power or of a functional's information leaves nothing known of it [1]: of the latter the
# series in r diverges soon.
MOST_NOISE = 0.5


@dataclass(frozen=True, slots=True)
class DeflectionNoise:
    """Noise of one transmission's deflection behind the filters.

    Attributes
    ----------
    own : its variance [rad²]
    shared : size of its covariance with the noise of the torque it is fitted to [rad·N·m]
    """

    own: float
    shared: float = 0.0


@dataclass(frozen=True, slots=True)
class RegressorNoise:
    """Noise in the regressors of an equation.

    Attributes
    ----------
    deflections : of each transmission; integrated along with the equation where that is an integral
    direct : shape (n,), variance of each regressor's own noise, whether integral or not; None for none
    """

    deflections: tuple[DeflectionNoise, ...]
    direct: Array | None = None


class BiasState(NamedTuple):
    """What noise adds to the normal equations, for n unknowns.

    Attributes
    ----------
    energy : shape (n, n), H; where the equation is an integral that of the runs before, and of noise that is not integrated
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
        """Return the square of the normal equations' error, shape (n, n)."""
        H = self.energy + (self.once - self.twice / self.weight[0] if self.weight[0] > 0.0 else 0.0)
        off = H @ unknowns
        return np.outer(off, off) + np.outer(self.shared, self.shared)


def bias_start(n: int) -> BiasState:
    """Return the state before the first sample, for n unknowns."""
    energy, steps, once, twice = (np.zeros((n, n)) for _ in range(4))
    return BiasState(energy, np.zeros(n), steps, once, twice, np.zeros(1))


def bias_block(
    state: BiasState,
    noise: RegressorNoise,
    E: Array,
    T: Array,
    unknowns: Array,
    values: Array,
    use: Flags,
    fresh: Flags,
    integral: bool,
    discount: float,
) -> tuple[BiasState, Array]:
    """Return by how much noise in regressors biases functionals of the unknowns.

    Parameters
    ----------
    state : of `bias_start` or a previous call
    noise : of the equation's regressors
    E : shape (N, m, n), functionals, the first those of each transmission's stiffness, f'
    T : shape (N, m, n), P E
    unknowns, values : shapes (N, n) and (N, m), ξ̂ and E ξ̂
    use, fresh : shape (N,), samples that are used, and where an integral begins again
    integral : whether the equation is an integral
    discount : what a sample's weight is multiplied with in the next

    Returns
    -------
    state, and shape (N, m); infinite where most of the information is noise, NaN while there is none
    """
    new, bias = BiasState(*(x.copy() for x in state)), np.empty(T.shape[:2])
    own, shared = np.array([d.own for d in noise.deflections]), np.array([d.shared for d in noise.deflections])
    direct = np.zeros(T.shape[2]) if noise.direct is None else noise.direct
    # Functionals picked from others are strided in memory, which makes the loop several times as slow.
    E, values, parts = np.ascontiguousarray(E), np.ascontiguousarray(values), np.empty(T.shape[1])
    _loop(integral)(own, shared, direct, E, T, unknowns, values, use, fresh, discount, parts, *new, bias)
    return new, bias


@cache
def _loop(integral: bool) -> Callable[..., None]:
    """Return the loop over samples, compiled for one kind of equation: code for the other is left out."""

    @compiled
    def run(
        own: Array, with_torque: Array, direct: Array, E: Array, T: Array, unknowns: Array, values: Array, use: Flags,
        fresh: Flags, discount: float, parts: Array, energy: Array, shared: Array, steps: Array, once: Array, twice: Array,
        weight: Array, bias: Array,
    ) -> None:  # fmt: skip
        count, asked, n = T.shape
        for k in range(count):
            known = use[k]
            for r in range(own.size):
                for i in range(n):
                    known &= math.isfinite(E[k, r, i])
            if integral and fresh[k] and weight[0] > 0.0:
                # The noise of an integral does not go on into the next run.
                for i in range(n):
                    for j in range(n):
                        energy[i, j] += once[i, j] - twice[i, j] / weight[0]
                        steps[i, j] = once[i, j] = twice[i, j] = 0.0
                weight[0] = 0.0
            if known:
                weight[0] = discount * weight[0] + 1.0 if integral else 0.0
                for i in range(n):
                    shared[i] *= discount
                    for j in range(n):
                        step = 0.0
                        for r in range(own.size):
                            step += own[r] * E[k, r, i] * E[k, r, j]
                        if integral:
                            energy[i, j] *= discount
                            steps[i, j] += step
                            before = discount * once[i, j]
                            twice[i, j] = discount**2 * twice[i, j] + 2.0 * before + steps[i, j]
                            once[i, j] = before + steps[i, j]
                        else:
                            energy[i, j] = discount * energy[i, j] + step
                    energy[i, i] += direct[i]
                    for r in range(own.size):
                        shared[i] += with_torque[r] * E[k, r, i]
            largest = 0.0
            for m in range(asked):
                off, common, noise, information = 0.0, 0.0, 0.0, 0.0
                for i in range(n):
                    row = 0.0
                    for j in range(n):
                        row += energy[i, j] * T[k, m, j]
                        if integral and weight[0] > 0.0:
                            row += (once[i, j] - twice[i, j] / weight[0]) * T[k, m, j]
                    off += row * unknowns[k, i]
                    noise += row * T[k, m, i]
                    common += T[k, m, i] * shared[i]
                    information += T[k, m, i] * E[k, m, i]
                parts[m] = noise / information if noise > 0.0 else 0.0
                largest = max(largest, parts[m])
                bias[k, m] = abs(off) + abs(common)
            for m in range(asked):
                first, next_order = bias[k, m] / (1.0 - min(largest, MOST_NOISE)), parts[m] * values[k, m]
                bias[k, m] = math.sqrt(first**2 + next_order**2) if not parts[m] >= MOST_NOISE else math.inf

    return run
